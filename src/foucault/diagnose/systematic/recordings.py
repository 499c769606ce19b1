"""Several recordings of one instrument: what its biases were in each, and whether that can be.

Of n recordings the bias of each is ``b + e_k``, ``e_k`` of standard deviation r: the
repeatability from one switch-on to the next. Differences ``d = D e`` with ``D D' = I`` have
covariance r^2 before the session, and ``r^2 (1 - L)`` after it. Along an eigenvector of L, with its
eigenvalue l, readings alone say ``y = d / l``, of variance ``r^2 / l``: ``sum l y^2 / r^2`` is
chi-square if r is right.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose import words
from foucault.errors import Finding, finding
from foucault.estimate.chi_square import FALSE_ALARM, chi_square_limits
from foucault.models.ins_errors import TURN_ON
from foucault.result import Check
from foucault.tables import AXES
from foucault.units import plain

SEEN = 1e-7
"""A difference that a session tells less of than this is not seen, but for rounding [1]."""

EACH = FALSE_ALARM / 8
"""False-alarm rate of the check, as of the others of the session [1]."""

SAID = {"gyro": (np.radians(1.0) / 3600.0, "deg/h"), "accel": (9.80665e-6, "ug")}
"""Unit that biases of each triad are told in [SI], and its name."""


def lasting(states: CoefficientVector) -> CoefficientVector:
    """Return the coefficients that all recordings have in common.

    `states`: what the filter estimates [SI].
    """
    return states.chosen(n for n in states.names if f".{TURN_ON}" not in n)


@dataclass(frozen=True)
class Between:
    """What the biases of one triad differ by between recordings."""

    triad: str
    declared: float  # by what was declared: standard deviation of each [SI]
    count: int  # number of recordings [1]
    apart: FloatArray  # (k,) differences that the readings alone tell [SI]
    variance: FloatArray  # (k,) their variances, but for the repeatability [SI^2]

    def square(self, sd: float) -> float:
        """Return the sum of squared differences, normalised, with a repeatability [1].

        `sd`: the repeatability [SI].
        """
        return float(np.sum(self.apart**2 / (self.variance + sd**2)))

    @property
    def share(self) -> float:
        """Sum of squares with what was declared, over what it stays below but for chance [1]."""
        if not len(self.apart):
            return 0.0
        return self.square(self.declared) / chi_square_limits(len(self.apart), 2 * EACH)[1]

    @property
    def scatter(self) -> float:
        """The repeatability that explains the differences; 0 where noise does [SI]."""
        from scipy.optimize import brentq

        n = len(self.apart)
        most = float(np.sqrt(np.sum(self.apart**2)))
        if not n or self.square(0.0) <= n:
            return 0.0
        return float(brentq(lambda sd: self.square(sd) - n, 0.0, most, xtol=1e-6 * most))


def between(states: CoefficientVector, triad: str, declared: float, count: int) -> Between:
    """Compare the biases of recordings with what was declared of them.

    `states`: what was found, with covariance [SI]; `declared`: standard deviation of what the
    bias of each recording is off by [SI]; `count`: number of recordings [1].
    """
    e = states.chosen(f"{triad}.{TURN_ON}{k}.{axis}" for k in range(1, count + 1) for axis in AXES)
    assert e.cov is not None
    apart = np.linalg.svd(np.ones((1, count)))[2][1:]
    D = np.kron(apart, np.eye(3))
    told, ways = np.linalg.eigh(np.eye(len(D)) - D @ e.cov @ D.T / declared**2)
    seen = told > SEEN
    told, y = told[seen], (ways.T @ D @ e.values)[seen]
    return Between(triad, declared, count, y / told, declared**2 * (1.0 / told - 1.0))


def check(some: list[Between]) -> Check:
    """Return the check `switch-on`: do the biases of the recordings agree as they should?"""
    each = [
        f"those of the {b.triad} scatter by {_said(b, b.scatter)}, and "
        f"{b.triad}_bias_repeatability is {_said(b, b.declared)}" for b in some if b.share > 1.0
    ]  # fmt: skip
    given = {"each": "; ".join(each)}
    return words.check("recordings", "switch-on", max(b.share for b in some), None, 1.0, given)


def told(some: list[Between]) -> Finding:
    """Say whose biases are reported."""
    return finding("systematic.recordings", count=some[0].count,
                   declared=" and ".join(_said(b, b.declared) for b in some))  # fmt: skip


def summary(
    states: CoefficientVector, some: list[Between], times: list[tuple[float, float]]
) -> dict[str, Any]:
    """Return the biases of each recording [SI], for result.json.

    `states`: what was found, with covariance [SI]; `times`: begin and end of each recording [s].
    """
    assert states.cov is not None
    out: list[dict[str, Any]] = []
    for k, (start, end) in enumerate(times, 1):
        row: dict[str, Any] = {"start": start, "end": end}
        for b in some:
            mean, own = (
                [states.layout.index(f"{b.triad}.{group}.{axis}") for axis in AXES]
                for group in ("bias", f"{TURN_ON}{k}")
            )
            A = np.zeros((3, len(states)))
            A[range(3), mean] = A[range(3), own] = 1.0
            sd = np.sqrt(np.diag(A @ states.cov @ A.T))
            row[b.triad] = {"bias": (A @ states.values).tolist(), "sd": sd.tolist()}
        out.append(row)
    return {
        "repeatability": {b.triad: b.declared for b in some},
        "scatter": {b.triad: b.scatter for b in some}, "each": out,
    }  # fmt: skip


def _said(b: Between, value: float) -> str:
    size, unit = SAID[b.triad]
    return f"{plain(value / size, 3)} {unit}"
