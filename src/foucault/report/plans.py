"""What is said of plans for a table, of poses for spins, and of sequences of rests and turns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.models.deflection import MODELS
from foucault.plans.efficiency import Efficiency
from foucault.plans.sequence import CalibrationSequence, PoseQuality, pointing
from foucault.report.page import Document, Heading, Section, Table, columns, section, told

# What the sd of a coefficient is in, for noise of 1 ug in one reading.
_UNITS = {"bias": "ug", "scale": "ppm", "misalignment": "urad", "quadratic": "ug/g^2"}


def directions(model: str, judged: Mapping[str, Efficiency]) -> Document:
    """Return how good plans are for a model."""
    first = next(iter(judged.values()))
    rows = [
        [
            name, str(len(found.directions)),
            "singular" if found.singular else f"{found.d_efficiency:.3f}",
            str(found.redundant), found.verdict,
        ]
        for name, found in judged.items()
    ]  # fmt: skip
    heads = columns("plan | positions: number | D-efficiency: number | redundant: number | verdict")
    title, line = f"Plans for the model '{model}'", f"{len(first.names)} coefficients"
    head = Heading(title, [line], "plain", "", [])
    return Document.of(head, section("plans.directions", Table(heads, rows), told("plans.angles")))


def one(name: str, found: Efficiency, at: FloatArray | None) -> Document:
    """Return how good a plan is; `at` (n, 3) or None: its angles of the table [rad]."""
    head = Heading(
        f"{name}: {len(found.directions)} positions, {found.equations} equations for "
        f"{len(found.names)} coefficients", [f"D-efficiency {found.d_efficiency:.3f}"], "plain",
        f"Verdict: {found.verdict}", [],
    )  # fmt: skip
    rows = [
        [name, f"{sd:.3f} {_UNITS[name.split('.')[1]]}"]
        for name, sd in zip(found.names, found.sd, strict=True)
    ]
    heads = columns("coefficient: name | sd for 1 ug of noise in a reading: number")
    coefficients = section("plans.coefficients", Table(heads, rows), _reliability(found))
    return Document.of(head, coefficients, _angles(["outer", "middle", "inner"], at))


def _reliability(found: Efficiency) -> list[str]:
    out = []
    if found.noticed:
        worst = float(found.detectable.max())
        out.append(
            f"An error of one position is noticed from {worst:.1f} times the noise of a reading; "
            f"below that it moves a coefficient by up to {found.hidden_shift:.1f} sd."
        )
    return out + [f"Weakest: {c.words}." for c in found.information.weakest(2)]


def _angles(names: Sequence[str], at: FloatArray | None) -> Section | None:
    if at is None:
        return None
    rows = [[str(k), *(f"{a:z.6f}" for a in row)] for k, row in enumerate(np.degrees(at), 1)]
    heads = columns("number", *(f"{name} (deg): number" for name in names))
    return section("plans.positions", Table(heads, rows))


def poses(
    sets: Sequence[tuple[str, FloatArray]], found: Sequence[PoseQuality], at: FloatArray | None
) -> Document:
    """Return how good sets of poses are; `at` (n, 2) or None: angles of the only one [rad]."""
    rows = [
        [name, str(len(each)), f"{q.condition:.2f}", f"{q.spread:.3f}"]
        for (name, each), q in zip(sets, found, strict=True)
    ]
    heads = columns("poses | number: number | condition: number | rms sd: number")
    head = Heading("Poses for six coefficients of deflection", [], "plain", "", [])
    listed = section("plans.poses", Table(heads, rows))
    return Document.of(head, listed, _angles(["about z", "about East"], at))


# -- sequences of rests and turns ------------------------------------------------------------


def demands(s: CalibrationSequence) -> dict[str, Any]:
    """Return what a sequence asks of a table, in SI."""
    return {
        "name": s.name, "rests": len(s.positions), "turns": len(s.moves), "duration": s.duration,
        "fastest": max((getattr(a, "rate", 0.0) for a in s.actions), default=0.0),
    }  # fmt: skip


def _cells(said: Mapping[str, Any]) -> list[str]:
    return [str(said["rests"]), str(said["turns"]), f"{said['duration'] / 60:.1f}",
            f"{degrees(said['fastest']):.4g}"]  # fmt: skip


def sequences(names: Sequence[str], listed: Sequence[Mapping[str, Any]], at: str) -> Document:
    """Return what sequences ask for and show; `at`: where, and with which noise."""
    rows = [
        [name, *_cells(one), "{} of {}".format(*one["errors"])]
        for name, one in zip(names, listed, strict=True)
    ]
    heads = columns("sequence | rests: number | turns: number | time (min): number",
                    "fastest (deg/s): number | errors shown: number")  # fmt: skip
    ranks = [
        [one["judged"], *(f"{seen}/{n}" for seen, n in one["deflection"].values())]
        for one in listed
    ]
    models = columns("sequence", *(f"{model}: number" for model in MODELS))
    head = Heading("Sequences of systematic calibration", [at], "plain", "", [])
    return Document.of(
        head,
        section("plans.sequences", Table(heads, rows)),
        section("plans.deflection", Table(models, ranks)),
    )


def sequence(s: CalibrationSequence, steps: Sequence[Sequence[str]]) -> Document:
    """Return one sequence; `steps`: headings and actions, or none."""
    rests, turns, minutes, fastest = _cells(demands(s))
    head = Heading(
        f"{s.name}: {rests} rests and {turns} turns in {minutes} min, at most {fastest} deg/s",
        [f"It starts with x, y, z to {', '.join(pointing(s.start))}."], "plain", "", [],
    )  # fmt: skip
    if not steps:
        return Document.of(head)
    heads, *rows = steps
    return Document.of(head, section("plans.actions", Table(columns(*heads), rows)))
