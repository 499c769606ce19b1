"""The rows of a fleet: one per instrument, and what is decided of all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray
from foucault.campaign.tolerance import DECISIONS, FAIL, PASS, UNDECIDED, Tolerance
from foucault.diagnose import fleet as diagnose
from foucault.diagnose.fleet import Distribution, Outlying
from foucault.errors import FoucaultError
from foucault.models.imu import LAYOUT
from foucault.result import Level, Result
from foucault.tables import AXES

BROKEN = "broken"
"""Status of an instrument without a result."""

TRIADS = ("accel", "gyro")


@dataclass(frozen=True)
class Row:
    """One instrument."""

    serial: str
    # status, verdict: how the computation ended, and the level of the verdict
    status: str
    verdict: str
    # values, sd: coefficients [SI]
    values: Mapping[str, float] = field(default_factory=dict)
    sd: Mapping[str, float] = field(default_factory=dict)
    # chi_square, redundancy: (2,) of the residuals of accelerometers and gyros; NaN where not
    # tested [1]
    chi_square: FloatArray = field(default_factory=lambda: np.full(2, np.nan))
    redundancy: FloatArray = field(default_factory=lambda: np.full(2, np.nan))
    # (3,) the accelerometers from the centre of the table; NaN where unknown [m]
    lever_arm: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    # folder, report: run folder and report, relative to the folder of the fleet; empty where there
    # is none
    folder: str = ""
    report: str = ""
    reasons: tuple[str, ...] = ()  # why the verdict is not a pass
    problem: FoucaultError | None = None  # why there is no result

    @classmethod
    def broken(cls, serial: str, problem: FoucaultError) -> Row:
        """Return the row of an instrument without a result."""
        return cls(serial, BROKEN, BROKEN, problem=problem)

    @classmethod
    def of(cls, serial: str, result: Result, folder: str, report: str) -> Row:
        """Return the row of a result."""
        c = result.coefficients
        squares = np.array([_squares(result, triad) for triad in TRIADS])
        rig = result.tables.get("rig", {})
        found = dict(zip(rig.get("name", ()), rig.get("value", ()), strict=True))
        arm = np.array([float(found.get(f"lever_arm.{a}", np.nan)) for a in AXES])
        return cls(
            serial, str(result.status), str(result.verdict.level),
            dict(zip(c.names, c.values.tolist(), strict=True)),
            dict(zip(c.names, c.sd.tolist(), strict=True)),
            squares[:, 0], squares[:, 1], arm, folder, report, result.verdict.reasons,
        )  # fmt: skip


def _squares(result: Result, triad: str) -> tuple[float, float]:
    """Return chi-square and redundancy of a triad, as the procedure gives them."""
    given: Mapping[str, Any] = result.diagnostics.get("chi_square") or {}
    mine = [v for k, v in given.items() if k.startswith(triad) and len(v) == 4]
    if not mine:
        return float("nan"), float("nan")
    return float(sum(v[0] for v in mine)), float(sum(v[3] for v in mine))


@dataclass(frozen=True)
class FleetTable:
    """All instruments, those with a result first."""

    names: tuple[str, ...]
    rows: tuple[Row, ...]
    # values, sd: (N, p) coefficients and standard deviations, NaN where an instrument has none [SI]
    values: FloatArray
    sd: FloatArray
    # (N, p) numbers of `tolerance.DECISIONS`; None without a tolerance
    decisions: IntArray | None = None
    tolerance: Tolerance | None = None

    @classmethod
    def of(cls, names: Sequence[str], rows: Sequence[Row]) -> FleetTable:
        """Stack the rows; coefficients that no instrument has are left out."""
        ordered = sorted(rows, key=lambda r: r.problem is not None)
        some = tuple(n for n in names if any(n in r.values for r in rows))
        nan = float("nan")
        values = np.array([[r.values.get(n, nan) for n in some] for r in ordered], float)
        sd = np.array([[r.sd.get(n, nan) for n in some] for r in ordered], float)
        shape = (len(rows), len(some))
        return cls(some, tuple(ordered), values.reshape(shape), sd.reshape(shape))

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def good(self) -> npt.NDArray[np.bool_]:
        """Which instruments have a result, shape (N,)."""
        return np.array([r.problem is None for r in self.rows], bool)

    @property
    def problems(self) -> dict[str, FoucaultError]:
        """Serial number -> why there is no result."""
        return {r.serial: r.problem for r in self.rows if r.problem is not None}

    def decided(self, tolerance: Tolerance | None) -> FleetTable:
        """Return the table with the decisions that a tolerance makes."""
        if tolerance is None:
            return self
        decisions = tolerance.decide(self.names, self.values, self.sd)
        return replace(self, decisions=decisions, tolerance=tolerance)

    @property
    def outcomes(self) -> list[str]:
        """Pass, undecided, fail or broken of each instrument; without a tolerance the verdict.

        A result that is unusable decides nothing.
        """
        out = []
        for i, row in enumerate(self.rows):
            if row.problem is not None:
                out.append(BROKEN)
            elif self.decisions is None:
                out.append(row.verdict)
            else:
                worst = int(np.max(self.decisions[i], initial=PASS))
                if row.verdict == Level.UNUSABLE:
                    worst = UNDECIDED
                out.append(DECISIONS[worst])
        return out

    def counts(self) -> dict[str, int]:
        """Return how many instruments have each outcome."""
        words = DECISIONS if self.decisions is not None else tuple(map(str, Level))
        order = ("pass", "fail", "undecided") if self.decisions is not None else words
        outcomes = self.outcomes
        return {word: outcomes.count(word) for word in (*order, BROKEN)}

    def misses(self, i: int) -> list[tuple[str, str]]:
        """Return the coefficients of instrument `i`, shape () [1], that do not pass, and how."""
        if self.decisions is None or self.rows[i].problem is not None:
            return []
        found = [(self.names[k], DECISIONS[d]) for k, d in enumerate(self.decisions[i]) if d]
        return sorted(found, key=lambda pair: pair[1] != DECISIONS[FAIL])

    def distributions(self) -> list[Distribution]:
        """Return how each coefficient is distributed over the instruments that can be used."""
        usable = np.array([row.verdict != Level.UNUSABLE for row in self.rows], bool)
        return diagnose.distributions(self.names, self.values[usable], self.sd[usable])

    def outlying(self) -> list[Outlying]:
        """Return what stands out of the fleet, the farthest first."""
        return [
            *diagnose.outlying(self.names, self.values, self.sd),
            *diagnose.noisy(self.chi_square, self.redundancy),
        ]

    @property
    def chi_square(self) -> FloatArray:
        """Chi-square of both triads, shape (N, 2) [1]."""
        return np.array([r.chi_square for r in self.rows]).reshape(-1, 2)

    @property
    def redundancy(self) -> FloatArray:
        """Redundancy of both triads, shape (N, 2) [1]."""
        return np.array([r.redundancy for r in self.rows]).reshape(-1, 2)

    @property
    def ratio(self) -> FloatArray:
        """Size of the residuals over what the noise says, shape (N, 2) [1]."""
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.sqrt(self.chi_square / self.redundancy)
        return np.where(self.redundancy >= 0.5, ratio, np.nan)

    def columns(self) -> dict[str, tuple[Any, str]]:
        """Return the columns of fleet.parquet with their SI units."""
        text = {
            "serial": [r.serial for r in self.rows],
            "outcome": self.outcomes,
            "status": [r.status for r in self.rows],
            "verdict": [r.verdict for r in self.rows],
            "reason": [_reason(r) for r in self.rows],
            "code": ["" if r.problem is None else r.problem.code for r in self.rows],
            "folder": [r.folder for r in self.rows],
        }
        out: dict[str, tuple[Any, str]] = {k: (v, "") for k, v in text.items()}
        passed = [None if self.decisions is None else o == "pass" for o in self.outcomes]
        out["pass"] = (np.array(passed, object), "")
        units = [LAYOUT.coefficients[LAYOUT.index(n)].unit for n in self.names]
        for what, block in (("", self.values), ("sd.", self.sd)):
            for k, name in enumerate(self.names):
                out[what + name] = (block[:, k], units[k])
        for t, triad in enumerate(TRIADS):
            out[f"chi_square.{triad}"] = (self.chi_square[:, t], "1")
            out[f"redundancy.{triad}"] = (self.redundancy[:, t], "1")
            out[f"residual_ratio.{triad}"] = (self.ratio[:, t], "1")
        arms = np.array([r.lever_arm for r in self.rows]).reshape(-1, 3)
        return out | {f"lever_arm.{a}": (arms[:, k], "m") for k, a in enumerate(AXES)}

    def document(self) -> dict[str, Any]:
        """Return what fleet.json says of the instruments."""
        return {
            "instruments": len(self),
            "counts": self.counts(),
            "broken": [
                {"serial": s, "code": p.code, "message": p.message, "cure": p.cure}
                for s, p in self.problems.items()
            ],
            "outlying": [
                {"serial": self.rows[o.index].serial, "name": o.name, "value": o.value, "z": o.z}
                for o in self.outlying()
            ],
            "distributions": [
                {
                    "name": d.name, "unit": LAYOUT.coefficients[LAYOUT.index(d.name)].unit,
                    "count": d.count, "median": d.median, "spread": d.spread,
                    "lowest": d.lowest, "highest": d.highest,
                    "sd": d.sd if np.isfinite(d.sd) else None,
                }
                for d in self.distributions()
            ],
        }  # fmt: skip


def _reason(row: Row) -> str:
    if row.problem is not None:
        return f"{row.problem.message} {row.problem.cure}"
    return " ".join(row.reasons)
