"""Judge a calibration on a rate table: can it be made, and is it right."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.checks import (
    drift_check,
    judge_prior,
    plausible_scales,
    reversed_earth_check,
    status_check,
)
from foucault.diagnose.rate_table.steps import name_of
from foucault.errors import Finding, finding
from foucault.estimate import gauss_newton
from foucault.estimate.chi_square import chi_square_limits
from foucault.estimate.drift import Drift, find_drift
from foucault.estimate.rate_table.likelihood import (
    Trust,
    true_rate,
)
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.rate_steps import Steps
from foucault.result import Check, Estimate, Problem
from foucault.units import plain

ENOUGH = 6
"""Fewer readings beyond those that the coefficients need hardly show a bad step [1]."""

LARGE_DRIFT = 3.0
"""A bias that moves by more than this many times the noise of a step is no constant [1]."""

LARGE_TERM = 0.05
"""A scale factor that changes by more over its range is a wrong reading, not a gyro [1]."""


@dataclass(frozen=True)
class RateEvidence:
    """Everything the checks look at."""

    steps: Steps  # what was measured [SI]
    names: tuple[str, ...]
    trust: Trust  # what was believed of table, fixture and place, with the scatter that was added
    problem: Problem
    estimate: Estimate
    site: Site  # gravity and latitude; None for a latitude that does not count
    declared: bool  # whether the noise was declared
    unknown: bool  # whether the noise was taken from the residuals
    before: tuple[float, float, float]  # sum of squares without added scatter, and its limits [1]
    added: float  # relative scatter of the steps that was added [1]

    @property
    def model(self) -> ImuModel:
        """The error model found."""
        model: ImuModel = self.estimate.state.model
        return model

    @property
    def speed(self) -> FloatArray:
        """True rate along each axis in its steps, with sign, shape (n,) [rad/s]."""
        return true_rate(self.steps, self.trust, self.estimate.state)[0] * self.steps.sense

    @property
    def drift(self) -> float:
        """How far the bias moves, in units of the noise of a typical step [1]."""
        noise = np.sqrt(np.trace(self.steps.cov, axis1=1, axis2=2) / 3)
        return float(self.trust.bias_sd / np.median(noise)) if self.trust.bias_sd else 0.0


def limits(estimate: Estimate) -> tuple[float, float, float]:
    """Return the sum of squares of an estimate and its limits [1]."""
    if estimate.dof < 1:
        return estimate.chi_square, 0.0, np.inf
    return (estimate.chi_square, *chi_square_limits(estimate.dof))


def checks(e: RateEvidence) -> tuple[Check, ...]:
    """Return every test of the result; a failed one carries its reason."""
    vector = e.estimate.coefficients
    out = [status_check(e.estimate.status, e.estimate.weakest), _redundancy(e)]
    out += judge_prior(e.estimate)
    out += [*plausible_scales(vector), *_bent(e)]
    out += drift_check(_clearest_drift(e), vector.layout)
    if not e.unknown and e.estimate.dof > 0:
        out.append(_explained(e))
    if e.trust.bias_sd:
        out.append(_drift(e))
    sign = reversed_earth_check(vector, e.site)
    out += [sign] if sign is not None else []
    return tuple(out)


def _clearest_drift(e: RateEvidence) -> Drift | None:
    at = e.problem.linearise(e.estimate.state, e.estimate.weights)
    at = gauss_newton.with_prior(e.problem, e.estimate.state, at)
    return find_drift(at, e.names, e.steps.middle)


def _redundancy(e: RateEvidence) -> Check:
    n, fine = e.estimate.dof, e.estimate.dof >= ENOUGH
    words = f"{len(e.steps)} steps give {n} readings more than the unknowns need" + (
        "." if fine else f": at least {ENOUGH} are needed to notice a bad step. Add rates."
    )
    return Check("redundancy", n, ENOUGH, None, fine, words)


def _bent(e: RateEvidence) -> list[Check]:
    """Judge how much the scale factors change with the rate, where that is estimated."""
    if e.model.straight:
        return []
    top = float(np.abs(e.steps.rate).max())
    change = np.maximum(np.abs(e.model.gyro_asymmetry), np.abs(e.model.gyro_cubic) * top**2)
    worst = float(change.max())
    fine = worst < LARGE_TERM
    words = f"The scale factors change by {worst * 1e6:.3g} ppm over the rates measured" + (
        "." if fine else ": that is saturation or a wrong rate of the table, not a gyro."
    )
    return [Check("scale factor terms", 1e6 * worst, None, 1e6 * LARGE_TERM, fine, words)]


def _explained(e: RateEvidence) -> Check:
    value, low, high = e.before
    ratio = np.sqrt(value / e.estimate.dof)
    inside = low <= value <= high
    if inside:
        words = f"The residuals of the steps are as large as the noise says ({ratio:.2f} times)."
    elif value < low:
        words = (
            f"The residuals of the steps are only {ratio:.2f} times what the noise says: it is "
            "overstated and so are the uncertainties."
        )
    elif e.added or e.trust.bias_sd:
        more = [f"{e.added * 1e6:.3g} ppm of scatter"] if e.added else []
        more += [f"a bias that moves by {_per_hour(e.trust)} deg/h"] if e.trust.bias_sd else []
        words = (
            f"The residuals of the steps are {ratio:.1f} times what noise and jitter explain; "
            f"{' and '.join(more)} {'was' if e.trust.bias_sd else 'were'} added to the "
            "uncertainties."
        )
    else:
        words = (
            f"The residuals of the steps are {ratio:.1f} times what noise and jitter explain, and "
            "the uncertainties do not know it."
        )
    if value > high and e.trust.bias_sd > 0 and not e.added:
        # A bias that moves is judged by a check of its own.
        return Check("noise of the steps", value, low, None, True, words)
    # Noise that was measured too large only makes the uncertainties careful.
    least = low if e.declared else None
    return Check("noise of the steps", value, least, high, value <= high, words)


def _drift(e: RateEvidence) -> Check:
    """Judge a bias that moves: within the noise it is any gyro's, beyond it a constant is wrong."""
    fine = e.drift <= LARGE_DRIFT
    words = f"The gyro bias moved by {_moved(e.trust)}, {e.drift:.2g} times the noise of a step" + (
        "; it is part of the uncertainties."
        if fine
        else ": let the gyros warm up, or hold the steps shorter. It is part of the uncertainties."
    )
    return Check("bias drift", e.drift, None, LARGE_DRIFT, fine, words)


def _per_hour(trust: Trust) -> str:
    return plain(float(np.degrees(trust.bias_sd)) * 3600, 2)


def _moved(trust: Trust) -> str:
    """Say how far the bias moved, and how fast."""
    if not trust.drifts:
        return f"{_per_hour(trust)} deg/h (sd) from step to step"
    if np.isinf(trust.bias_time):
        straight = "(sd) along a straight line, and is that of the middle of the session"
        return f"{_per_hour(trust)} deg/h {straight}"
    return f"{_per_hour(trust)} deg/h (sd) over {plain(trust.bias_time / 60, 2)} min"


def hints(e: RateEvidence) -> list[Finding]:
    """Return findings about the session: outliers, scatter, an unknown latitude."""
    out = []
    weights = e.estimate.weights
    norms = gauss_newton.block_norms(e.estimate.residuals, e.estimate.blocks, weights)
    for k in np.flatnonzero(weights < 0.5).tolist():
        rate = plain(float(np.degrees(e.steps.rate[k])), 4)
        words = {"step": k + 1, "rate": rate, "placement": name_of(e.steps.up[k])}
        out.append(finding("rate_table.outlier", norm=f"{norms[k]:.0f}", **words))
    if e.added:
        out.append(finding("rate_table.scatter", ppm=f"{e.added * 1e6:.3g}"))
    if e.trust.bias_sd:
        out.append(finding("rate_table.bias_moved", moved=_moved(e.trust)))
    if e.trust.latitude is None:
        sd = np.degrees(e.trust.vertical_sd) * 3600
        out.append(finding("rate_table.no_latitude", sd=f"{sd:.1f}"))
    return out
