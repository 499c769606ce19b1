"""The command about plans for tables: plans."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foucault.cli import sequences, words
from foucault.cli.screen import Screen

if TYPE_CHECKING:
    from foucault.arrays import FloatArray
    from foucault.plans.table.efficiency import Efficiency

SAMPLE = "fibonacci 24"
"""Stands in the list for the plans of any number of positions."""

DEFLECTION = "deflection"
"""The model that poses for spins are judged for."""

# What the sd of a coefficient is in, for noise of 1 ug in one reading.
_UNITS = {"bias": "ug", "scale": "ppm", "misalignment": "urad", "quadratic": "ug/g^2"}


def add_to(app: typer.Typer) -> None:
    """Add the command of this module to the program."""
    app.command(
        "plans",
        epilog=words.epilog(
            "foucault plans",
            'foucault plans --model "accel quadratic"',
            'foucault plans "icosahedron 12" -o angles.csv',
            "foucault plans angles.csv",
            'foucault plans --model deflection "optimised 6"',
            "foucault plans --model systematic campaign.toml -o actions.csv",
        ),
    )(plans)


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
    from foucault.plans.table.efficiency import model_named

    screen: Screen = ctx.obj
    if model.strip().lower() == DEFLECTION:
        _poses(screen, name, angles, output)
        return
    if model.strip().lower() == sequences.MODEL:
        sequences.sequences(screen, name, angles, output)
        return
    known = model_named(model)
    if name is not None:
        _one(screen, name, known, angles, output)
    elif output is not None:
        raise error("plan.which", path=output)
    else:
        _all(screen, known)


def _all(screen: Screen, model: str) -> None:
    from foucault.plans.table.directions import DIRECTIONS, directions
    from foucault.plans.table.efficiency import efficiency

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
    from foucault.plans.table.efficiency import refuse_singular
    from foucault.plans.table.file import write_positions

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
    from foucault.plans.systematic.pose_search import poses_named
    from foucault.plans.systematic.spin_poses import COEFFICIENTS, NAMES, quality
    from foucault.plans.table.file import write_positions

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
    from foucault.plans.table.directions import positions
    from foucault.plans.table.file import read_positions

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
