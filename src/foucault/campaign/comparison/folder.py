"""The folder of a comparison: one document that says everything, and the page made from it.

::

    compare.json    results with their hashes, changes, drifts, limits, verdict [SI, rad]
    report.html     for people, written by `report.compare`
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from foucault.campaign.comparison import Comparison
from foucault.campaign.comparison.verdict import Judged
from foucault.campaign.folder import write
from foucault.campaign.tolerance import Tolerance
from foucault.diagnose.compare.changes import History
from foucault.diagnose.compare.comparable import Comparable, Entry
from foucault.diagnose.compare.instruments import Between
from foucault.errors import error
from foucault.files import plain_json, read_document
from foucault.result import provenance
from foucault.run_folder import RESULT_FILE

SCHEMA = "foucault.compare/1"
COMPARE_FILE = "compare.json"

FOREIGN = (RESULT_FILE, "fleet.json", "navigation.json", "north.json", "optimise.json")
"""Documents of other folders, which are not written over."""


def document(comparison: Comparison, seconds: float = 0.0) -> dict[str, Any]:
    """Return everything that compare.json says.

    `comparison`: what was found [SI]; `seconds`: how long it took [s].
    """
    c = comparison
    number = {id(e): i for i, e in enumerate(c.entries)}
    out = {
        "schema": SCHEMA,
        "verdict": {"level": c.verdict.level, "reasons": list(c.verdict.reasons)},
        "results": [_result(e) for e in c.entries],
        "coefficients": _coefficients(c),
        "instruments": [
            {"name": j.name, "results": [number[id(e)] for e in j.entries]} | _history(j)
            for j in c.instruments
        ],
        "between": _between(c.between, c.shared),
        "tolerance": None if c.tolerance is None else c.tolerance.as_json(),
        "decisions": [asdict(d) for d in c.decisions],
        "findings": [f.as_dict() for f in c.findings],
        "provenance": {k: v for k, v in provenance({}, seconds).items() if k != "input"},
    }
    return {key: plain_json(value) for key, value in out.items()}


def _result(e: Entry) -> dict[str, Any]:
    r, v = e.result, e.result.coefficients
    return {
        "label": e.label,
        "instrument": e.instrument,
        "procedure": r.procedure,
        "time": e.time,
        "dated": e.dated,
        "verdict": str(r.verdict.level),
        "temperature_mean": r.validity.get("temperature_mean"),
        "gauge": r.gauge,
        "sha256": e.sha256,
        "coefficients": {
            n: [float(x), float(s) if free else math.nan]
            for n, x, s, free in zip(v.names, v.values, v.sd, v.free, strict=True)
        },
    }


def _coefficients(c: Comparison) -> list[dict[str, Any]]:
    """Return every coefficient of any result, each once, with its limits."""
    layouts = [j.comparable.layout for j in c.instruments if j.comparable is not None]
    layouts += [] if c.shared is None else [c.shared.layout]
    layouts += [e.result.coefficients.layout for e in c.entries]
    every = list({k.name: k for layout in layouts for k in layout.coefficients}.values())
    limits = c.tolerance or Tolerance(())
    names = [k.name for k in every]
    allowed = (limits.limits(names)[0], *limits.changes(names))
    keys = ("limit", "change", "drift_per_year")
    return [
        {"name": k.name, "symbol": k.symbol, "kind": k.kind, "unit": k.unit}
        | {key: float(limit[i]) for key, limit in zip(keys, allowed, strict=True)}
        for i, k in enumerate(every)
    ]


def _history(judged: Judged) -> dict[str, Any]:
    if judged.history is None:
        return {"compared": None}
    h: History = judged.history
    return {
        "compared": {
            "names": h.series.names,
            "values": h.series.values,
            "sd": h.series.sd,
            "chi_square": h.chi_square,
            "dof": h.dof,
            "limits": [h.low, h.high],
            "changed": h.changed,
            "standing_out": [h.courses[k].name for k in h.standing_out],
            "likeliest": h.courses[h.likeliest].name,
            "alone": h.alone,
            "coefficient_limit": h.limit,
            "drift_limit": h.drift_limit,
            "pair_limit": h.pair_limit,
            "z_limit": h.z_limit,
            "courses": [asdict(course) for course in h.courses],
            "pairs": [
                {
                    "first": p.first, "second": p.second, "chi_square": p.chi_square,
                    "change": p.change, "sd": p.sd, "z": p.z, "w": p.w,
                    "alone": None if p.alone is None else h.series.names[p.alone],
                }
                for p in h.pairs
            ],
        }
    }  # fmt: skip


def _between(between: Between | None, shared: Comparable | None) -> dict[str, Any] | None:
    if between is None or shared is None:
        return None
    return {
        "names": between.series.names,
        "values": between.series.values,
        "sd": between.series.sd,
        "limit": between.limit,
        "spreads": [asdict(s) for s in between.spreads],
        "outlying": [asdict(o) for o in between.outlying],
    }


def save(about: Mapping[str, Any], folder: str | Path) -> Path:
    """Write the folder of a comparison, without its report.

    `folder`: made where it does not exist, an earlier comparison in it is replaced.
    """
    folder = Path(folder)
    _refuse_foreign(folder, FOREIGN)
    write(folder, COMPARE_FILE, about)
    return folder / COMPARE_FILE


def _refuse_foreign(folder: Path, names: Sequence[str]) -> None:
    for name in names:
        if (folder / name).exists():
            raise error("compare.folder", folder=folder, what=name)


def load(folder: str | Path) -> dict[str, Any]:
    """Read what compare.json in a folder says."""
    return read_document(Path(folder) / COMPARE_FILE, SCHEMA)
