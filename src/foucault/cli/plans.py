"""The command about plans for tables and sequences of rests and turns: plans."""

from __future__ import annotations

from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foucault.cli.options import command
from foucault.cli.screen import Screen

if TYPE_CHECKING:
    from foucault.arrays import FloatArray
    from foucault.plans.efficiency import Efficiency
    from foucault.plans.sequence import CalibrationSequence
    from foucault.procedures.systematic.quick import Stills

MODEL = "systematic"
"""What the command calls them."""

LATITUDE = 45.0
"""Where it is said what a sequence shows [deg]."""

CLASS = "navigation"
"""With the noise of which class."""


def sequences(screen: Screen, name: str | None, steps: bool, output: Path | None) -> None:
    """List the built-in sequences and what they show, or print one for the one who turns the table.

    Parameters
    ----------
    screen : Screen
        Where to print.
    name : str or None
        A built-in sequence, several joined by " + ", a file of a sequence, or a campaign.
    steps : bool
        Whether the actions of one are printed.
    output : Path or None
        CSV file for the actions, or TOML.
    """
    from foucault.errors import error

    if name is not None:
        _one_sequence(screen, sequence_of(name), steps, output)
    elif output is not None:
        raise error("plan.which", path=output)
    else:
        _all_sequences(screen)


def sequence_of(name: str) -> CalibrationSequence:
    """Return the sequence that `name` stands for."""
    from foucault import campaign
    from foucault.errors import error
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
    from foucault.files import parse_toml, read_text

    try:
        return "procedure" in parse_toml(read_text(path))
    except (OSError, ValueError):
        return False  # the reader of sequences says why


def _all_sequences(screen: Screen) -> None:
    from math import radians

    from foucault.models.deflection import MODELS
    from foucault.models.earth import Site
    from foucault.models.noise import grade
    from foucault.plans.sequence import BUILT_IN
    from foucault.procedures.systematic.plan import shown

    site, noise = Site.at(radians(LATITUDE)), grade(CLASS).noise
    rows, ranks, documents = [], [], []
    kept: Stills = {}
    for name, make in BUILT_IN.items():
        whole = f"19 positions + {name}" if name.startswith("spins") else name
        s = sequence_of(whole)
        (seen, count), models = shown(s, site, noise, kept)
        demands = _demands(make())
        rows.append((name, *demands, f"{seen} of {count}"))
        ranks.append((whole, *(f"{told}/{n}" for told, n in models.values())))
        documents.append(_of_sequence(make()) | {
            "judged": whole, "errors": [seen, count], "deflection": models,
        })  # fmt: skip
    screen.table(
        "sequences of systematic calibration",
        ("sequence", "rests", "turns", "time (min)", "fastest (deg/s)", "errors shown"),
        rows,
    )
    screen.table(
        "combinations of the deflection of dithered gyros that are told better than 3 arcsec/g",
        ("sequence", *MODELS), ranks,
    )  # fmt: skip
    screen.say(
        f"At {LATITUDE:.0f} deg of latitude, with the noise of a {CLASS} grade instrument. Spins "
        "are judged after the 19 positions: they begin without a rest.",
        "Actions: foucault plans --model systematic NAME. Better ones: foucault optimise.",
    )
    screen.data({"model": MODEL, "sequences": documents})


def _demands(s: CalibrationSequence) -> tuple[str, str, str, str]:
    from math import degrees

    fastest = max((getattr(a, "rate", 0.0) for a in s.actions), default=0.0)
    return (
        str(len(s.positions)), str(len(s.moves)), f"{s.duration / 60:.1f}",
        f"{degrees(fastest):.4g}",
    )  # fmt: skip


def _of_sequence(s: CalibrationSequence) -> dict[str, Any]:
    return {
        "name": s.name, "rests": len(s.positions), "turns": len(s.moves), "duration": s.duration,
        "fastest": max((getattr(a, "rate", 0.0) for a in s.actions), default=0.0),
    }  # fmt: skip


def _one_sequence(screen: Screen, s: CalibrationSequence, steps: bool, output: Path | None) -> None:
    from foucault.plans.sequence import pointing
    from foucault.plans.sequence_file import rows, write_steps

    if output is not None:
        write_steps(s, output)
    rests, turns, minutes, fastest = _demands(s)
    screen.say(
        f"{s.name}: {rests} rests and {turns} turns in {minutes} min, at most {fastest} deg/s.",
        f"It starts with x, y, z to {', '.join(pointing(s.start))}.",
    )
    headings, *lines = rows(s)
    if steps:
        screen.table("", headings, lines)
    if output is not None:
        screen.say(f"Actions: {output}")
    screen.data(_of_sequence(s) | {"headings": headings, "actions": lines})


SAMPLE = "fibonacci 24"
"""Stands in the list for the plans of any number of positions."""

DEFLECTION = "deflection"
"""The model that poses for spins are judged for."""

# What the sd of a coefficient is in, for noise of 1 ug in one reading.
_UNITS = {"bias": "ug", "scale": "ppm", "misalignment": "urad", "quadratic": "ug/g^2"}


@command(
    "foucault plans",
    'foucault plans --model "accel quadratic"',
    'foucault plans "icosahedron 12" -o angles.csv',
    "foucault plans angles.csv",
    'foucault plans --model deflection "optimised 6"',
    "foucault plans --model systematic campaign.toml -o actions.csv",
)
def plans(
    ctx: typer.Context,
    name: Annotated[
        str | None,
        typer.Argument(
            help='A plan, such as "icosahedron 12" or "fibonacci 30", or a CSV file with the '
            'columns outer,middle,inner in deg; of a sequence "19 positions", several joined by '
            '" + ", or a TOML file: a sequence, or a campaign. All plans if left out.'
        ),
    ] = None,
    model: Annotated[
        str,
        typer.Option(
            help="What is to be found: accel (norm of gravity, also for the norm of the rate), "
            '"accel quadratic", "accel table" (the angles of the table are known), deflection '
            "(poses for spins about a level axis, for gyros on dither springs), or systematic "
            "(sequences of rests and turns)."
        ),
    ] = "accel",
    angles: Annotated[
        bool,
        typer.Option(
            "--angles/--no-angles",
            help="Whether to print the table angles or the actions of a plan.",
        ),
    ] = True,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="CSV file to write, with a plan: its angles or actions; of a sequence TOML too.",
        ),
    ] = None,
) -> None:
    """List plans for a table and how good they are, or print one.

    A plan is printed with its table angles or its actions, and what it cannot tell apart.
    """
    from foucault.errors import error
    from foucault.plans.efficiency import model_named

    screen: Screen = ctx.obj
    if model.strip().lower() == DEFLECTION:
        _poses(screen, name, angles, output)
        return
    if model.strip().lower() == MODEL:
        sequences(screen, name, angles, output)
        return
    known = model_named(model)
    if name is not None:
        _one(screen, name, known, angles, output)
    elif output is not None:
        raise error("plan.which", path=output)
    else:
        _all(screen, known)


def _all(screen: Screen, model: str) -> None:
    from foucault.plans.directions import DIRECTIONS, directions
    from foucault.plans.efficiency import efficiency

    judged = {name: efficiency(directions(name), model) for name in (*DIRECTIONS, SAMPLE)}
    first = next(iter(judged.values()))
    screen.table(
        f"plans for the model '{model}' ({len(first.names)} coefficients)",
        ("plan", "positions", "D-efficiency", "redundant", "verdict"),
        [_row(name, found) for name, found in judged.items()],
    )
    screen.say(
        "D-efficiency: against directions spread evenly over the sphere. redundant: equations "
        "beyond the coefficients.",
        "'fibonacci N' spreads any number N of positions. Angles: foucault plans NAME",
    )
    screen.data({"model": model, "plans": [_document(n, e) for n, e in judged.items()]})


def _row(name: str, found: Efficiency) -> tuple[str, ...]:
    return (
        name,
        str(len(found.directions)),
        "singular" if found.singular else f"{found.d_efficiency:.3f}",
        str(found.redundant),
        found.verdict,
    )


def _one(screen: Screen, name: str, model: str, angles: bool, output: Path | None) -> None:
    from foucault.models.turntable import up_k
    from foucault.plans.directions import write_positions
    from foucault.plans.efficiency import refuse_singular

    known, at = _positions(name)
    found = refuse_singular(known, up_k(at), model)
    if output is not None:
        write_positions(at, output)
    screen.say(
        f"{known}: {len(at)} positions, {found.equations} equations for {len(found.names)} "
        f"coefficients, D-efficiency {found.d_efficiency:.3f}.",
        f"Verdict: {found.verdict}.",
        *_reliability(found),
    )
    screen.table("", ("coefficient", "sd for 1 ug of noise in a reading"), _sds(found))
    if angles:
        screen.table("", ("position", "outer (deg)", "middle (deg)", "inner (deg)"), _angles(at))
    if output is not None:
        screen.say(f"Angles: {output}")
    screen.data(_document(known, found) | {"angles": at.tolist()})


def _poses(screen: Screen, name: str | None, angles: bool, output: Path | None) -> None:
    """List sets of poses for spins about a level axis, or print one."""
    import numpy as np

    from foucault.errors import error
    from foucault.plans.directions import write_positions
    from foucault.plans.sequence import COEFFICIENTS, NAMES, poses_named, quality

    if name is None and output is not None:
        raise error("plan.which", path=output)
    sets = [poses_named(n) for n in ((*NAMES, "optimised 6") if name is None else (name,))]
    if output is not None:
        write_positions(sets[0][1], output, ("about_z", "about_east"))
    found = [quality(at) for _, at in sets]
    screen.table(
        "poses for six coefficients of deflection",
        ("poses", "number", "condition", "rms sd"),
        [(n, str(len(at)), f"{q.condition:.2f}", f"{q.spread:.3f}")
         for (n, at), q in zip(sets, found, strict=True)],
    )  # fmt: skip
    screen.say(
        "rms sd: of a coefficient, for sd 1 of 2 tilt / (turned angle x g) in each pose.",
        "'optimised N' finds N poses; no set has an rms sd below 3.52 / sqrt(N).",
    )
    if name is not None and angles:
        screen.table(
            "", ("pose", "about z (deg)", "about East (deg)"),
            [(str(k), *(f"{a:z.6f}" for a in row))
             for k, row in enumerate(np.degrees(sets[0][1]), 1)],
        )  # fmt: skip
    if output is not None:
        screen.say(f"Angles: {output}")
    screen.data({
        "model": DEFLECTION,
        "poses": [
            {"name": n, "angles": at.tolist(), "condition": q.condition, "rms_sd": q.spread,
             "sd": dict(zip(COEFFICIENTS, q.sd.tolist(), strict=True))}
            for (n, at), q in zip(sets, found, strict=True)
        ],
    })  # fmt: skip


def _positions(name: str) -> tuple[str, FloatArray]:
    from foucault.plans.directions import positions, read_positions

    if name.lower().endswith(".csv") or Path(name).is_file():
        return Path(name).name, read_positions(name)
    return positions(name)


def _reliability(found: Efficiency) -> list[str]:
    out = []
    if found.noticed:
        worst = float(found.detectable.max())
        out.append(
            f"An error of one position is noticed from {worst:.1f} times the noise of a reading; "
            f"below that it moves a coefficient by up to {found.hidden_shift:.1f} sd."
        )
    return out + [f"Weakest: {c.words}." for c in found.information.weakest(2)]


def _sds(found: Efficiency) -> list[tuple[str, str]]:
    return [
        (name, f"{sd:.3f} {_UNITS[name.split('.')[1]]}")
        for name, sd in zip(found.names, found.sd, strict=True)
    ]


def _angles(at: FloatArray) -> list[tuple[str, ...]]:
    import numpy as np

    degrees = np.degrees(at)
    return [(str(k + 1), *(f"{a:.6f}" for a in row)) for k, row in enumerate(degrees)]


def _document(name: str, found: Efficiency) -> dict[str, Any]:
    """What is known of a plan, as JSON."""
    import math

    def finite(value: float) -> float | None:
        return float(value) if math.isfinite(value) else None

    return {
        "name": name,
        "positions": len(found.directions),
        "equations": found.equations,
        "coefficients": len(found.names),
        "singular": found.singular,
        "reason": found.reason,
        "d_efficiency": found.d_efficiency,
        "a_efficiency": found.a_efficiency,
        "log10_det": finite(found.log10_det),
        "redundant": found.redundant,
        "noticed": found.noticed,
        "named": found.named,
        "likeness": found.likeness,
        "hidden_shift": finite(found.hidden_shift),
        "sd": {n: finite(s) for n, s in zip(found.names, found.sd.tolist(), strict=True)},
        "verdict": found.verdict,
    }
