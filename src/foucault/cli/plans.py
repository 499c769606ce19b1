"""The command about plans for tables and sequences of rests and turns: plans."""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from foucault.cli.options import command
from foucault.cli.screen import Screen
from foucault.errors import error
from foucault.files import parse_toml, read_text

if TYPE_CHECKING:
    from foucault.arrays import FloatArray
    from foucault.plans.efficiency import Efficiency
    from foucault.plans.sequence import CalibrationSequence
    from foucault.procedures.systematic.quick import Stills
    from foucault.report.page import Document

MODEL, DEFLECTION = "systematic", "deflection"
"""The model of sequences, and the one that poses for spins are judged for."""

LATITUDE = 45.0  # Where it is said what a sequence shows [deg].
CLASS = "navigation"  # With the noise of which class.
SAMPLE = "fibonacci 24"  # Stands in the list for the plans of any number of positions.


class Told(NamedTuple):
    """What there is to say of plans, as JSON too, and how one is written to a file."""

    document: Document
    data: dict[str, Any]
    write: Callable[[Path], None] | None = None
    what: str = "Angles"  # is written


@command(
    "foucault plans",
    'foucault plans --model "accel quadratic"',
    'foucault plans "icosahedron 12" -o angles.csv',
    "foucault plans angles.csv",
    'foucault plans --model deflection "optimised 6"',
    "foucault plans --model systematic campaign.toml -o actions.csv",
)
def plans(
    screen: Screen,
    name: Annotated[str | None, typer.Argument()] = None,
    model: str = "accel",
    angles: Annotated[bool, typer.Option("--angles/--no-angles")] = True,
    output: Annotated[Path | None, typer.Option("-o", "--output")] = None,
) -> None:
    """List plans for a table and how good they are, or print one.

    A plan is printed with its table angles or its actions, and what it cannot tell apart.
    """
    if name is None and output is not None:
        raise error("plan.which", path=output)
    makers = {DEFLECTION: _poses, MODEL: _sequences}
    told = makers.get(model.strip().lower(), _directions)(model, name, angles)
    if output is not None and told.write is not None:
        told.write(output)
    where = [] if output is None else [f"{told.what}: {output}"]
    raise screen.tell(told.document, told.data, *where)


def _directions(model: str, name: str | None, angles: bool) -> Told:
    """List plans of positions, or judge one."""
    from foucault.models.turntable import up_k
    from foucault.plans.directions import DIRECTIONS, directions, write_positions
    from foucault.plans.efficiency import efficiency, model_named, refuse_singular
    from foucault.report import plans as report

    known = model_named(model)
    if name is None:
        judged = {one: efficiency(directions(one), known) for one in (*DIRECTIONS, SAMPLE)}
        listed = [_document(one, found) for one, found in judged.items()]
        return Told(report.directions(known, judged), {"model": known, "plans": listed})
    called, at = _positions(name)
    found = refuse_singular(called, up_k(at), known)
    return Told(
        report.one(called, found, at if angles else None),
        _document(called, found) | {"angles": at},
        lambda file: write_positions(at, file),
    )


def _poses(_: str, name: str | None, angles: bool) -> Told:
    """List sets of poses for spins about a level axis, or judge one."""
    from foucault.plans.directions import write_positions
    from foucault.plans.sequence import COEFFICIENTS, NAMES, poses_named, quality
    from foucault.report import plans as report

    sets = [poses_named(n) for n in ((*NAMES, "optimised 6") if name is None else (name,))]
    found = [quality(at) for _, at in sets]
    at = sets[0][1]
    listed = [
        {"name": n, "angles": each, "condition": q.condition, "rms_sd": q.spread,
         "sd": dict(zip(COEFFICIENTS, q.sd, strict=True))}
        for (n, each), q in zip(sets, found, strict=True)
    ]  # fmt: skip
    return Told(
        report.poses(sets, found, at if angles and name is not None else None),
        {"model": DEFLECTION, "poses": listed},
        lambda file: write_positions(at, file, ("about_z", "about_east")),
    )


def _sequences(_: str, name: str | None, steps: bool) -> Told:
    """List the built-in sequences and what they show, or one for the one who turns the table."""
    from foucault.models.earth import Site
    from foucault.models.noise import grade
    from foucault.plans.sequence import BUILT_IN
    from foucault.plans.sequence_file import rows, write_steps
    from foucault.procedures.systematic.plan import shown
    from foucault.report import plans as report

    if name is not None:
        s = sequence_of(name)
        headings, *lines = rows(s)
        data = report.demands(s) | {"headings": headings, "actions": lines}
        return Told(report.sequence(s, (headings, *lines) if steps else ()), data,
                    lambda file: write_steps(s, file), "Actions")  # fmt: skip
    site, noise = Site.at(radians(LATITUDE)), grade(CLASS).noise
    kept: Stills = {}
    listed = []
    for one, make in BUILT_IN.items():
        whole = f"19 positions + {one}" if one.startswith("spins") else one
        seen, models = shown(sequence_of(whole), site, noise, kept)
        listed.append(
            report.demands(make()) | {"judged": whole, "errors": list(seen), "deflection": models}
        )
    at = f"At {LATITUDE:.0f} deg of latitude, with the noise of a {CLASS} grade instrument."
    return Told(report.sequences(list(BUILT_IN), listed, at),
                {"model": MODEL, "sequences": listed})  # fmt: skip


def sequence_of(name: str) -> CalibrationSequence:
    """Return the sequence that `name` stands for."""
    from foucault import campaign
    from foucault.plans.sequence import CalibrationSequence, built_in
    from foucault.plans.sequence_file import read_sequence
    from foucault.procedures.systematic.settings import planned

    path = Path(name)
    if path.suffix.lower() != ".toml":
        return reduce(
            CalibrationSequence.then, [built_in(part.strip()) for part in name.split("+")]
        )
    if not _is_campaign(path):
        return read_sequence(path)
    asked = campaign.load(path)
    if asked.procedure != MODEL:
        raise error("sequence.campaign", path=path, procedure=asked.procedure)
    return planned(asked.settings, asked.session)


def _is_campaign(path: Path) -> bool:
    try:
        return "procedure" in parse_toml(read_text(path))
    except (OSError, ValueError):
        return False  # the reader of sequences says why


def _positions(name: str) -> tuple[str, FloatArray]:
    from foucault.plans.directions import positions, read_positions

    if name.lower().endswith(".csv") or Path(name).is_file():
        return Path(name).name, read_positions(name)
    return positions(name)


def _document(name: str, found: Efficiency) -> dict[str, Any]:
    """What is known of a plan, as JSON."""

    return {
        "name": name,
        "positions": len(found.directions),
        "equations": found.equations,
        "coefficients": len(found.names),
        "singular": found.singular,
        "reason": found.reason,
        "d_efficiency": found.d_efficiency,
        "a_efficiency": found.a_efficiency,
        "log10_det": found.log10_det,
        "redundant": found.redundant,
        "noticed": found.noticed,
        "named": found.named,
        "likeness": found.likeness,
        "hidden_shift": found.hidden_shift,
        "sd": dict(zip(found.names, found.sd, strict=True)),
        "verdict": found.verdict,
    }
