"""Single-pass filters of a tumble: the published one of three angles, and small-angle filters.

The published filter [1]_ estimates outer, middle and inner angle and the 42 constants in one pass
of an extended Kalman filter, with the readings of the accelerometers as measurement and eq. (14)
as kinematics. As printed (`LITERAL`: from zero, with the noise of the readings from the first one
on) it diverges: after the first readings it is far surer of itself than it is right. With noise
that fades to its value, sd + extra exp(-t / fading), and first readings that are linearised five
times (`ANNEALED`) it comes to a few times the bound where the start is a few degrees off as in
[1]_, and not always: it does not say so, for its innovations are small against the noise it
believes. `estimate.tumble.fit` is better than both.

The motive of [1]_ are filters of misalignment angles, which take the attitude for nearly known.
`filter_misalignment` is such a filter, in two forms. *Planned*: everything is linearised once,
about the attitude that the command gives from the mean of the prior; rotation and constants are an
error state that is never fed back: a linear Kalman filter. *Integrated*: the constants are fed
back, and the attitude is integrated with them, but its misalignment stays a small angle beside it.
In both, readings are linear in that angle, so that an angle a leaves errors of a^2 / 2.

The planned form takes more than the start for small: drift of 1 deg/h alone leads 1.5 deg away in
an hour and a half. Where only the start is to tell, the constants must be known or small; or the
integrated form is used.

References
----------
.. [1] Ding, Cai, Yang, Lian, "Continuous self-calibration and self-alignment method for floated
   inertial platform", J. NUDT 37(3), 2015, section 3 and eqs. (9)-(23).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.errors import Status
from foucault.estimate.tumble.fit import STATES, History, Prior, State, Tumble, attitudes
from foucault.kernels import cluster_transition as kernels
from foucault.kernels.cluster_filter import run
from foucault.models.cluster import angle_rates, angles_of, attitude_of
from foucault.models.rotation import exp, log

DIVERGED = 2.0
"""Mean square of the innovations of the second half beyond which the filter is not believed, in
units of what it expects of them [1]."""

_ADVICE = {
    kernels.INDEFINITE: (
        "At interval {k} the covariance lost its sign: the prior is too wide against the noise of "
        "the readings for a filter that carries a covariance. Use a narrower prior, noise that "
        "fades, or Gauss-Newton."
    ),
    kernels.NOT_FINITE: (
        "At interval {k} the filter met a number that is not finite. Look for saturated or missing "
        "samples with `foucault inspect`."
    ),
    kernels.SINGULAR: (
        "At interval {k} the middle angle came to 90 deg, where outer and inner angle cannot be "
        "told apart. Use Gauss-Newton, which knows no such attitude, or another plan."
    ),
}
_DIVERGING = (
    "The filter diverged: over its second half the innovations are {ratio:.3g} times as large as "
    "it expects. Use noise that fades and more linearisations of the first readings, or "
    "Gauss-Newton."
)
_CONVERGED = "The innovations are no larger than the filter expects."


@dataclass(frozen=True)
class Options:
    """How the filter of angles runs."""

    # the inverse of the input axes stands in front of the drift too; False as printed in eqs. (19)
    # and (20), which costs 6e-4 deg/h
    full_rate: bool = True
    extra_sd: float = 1e-4  # added to the sd of the readings at first [local g]
    fading: float = 1000.0  # time constant with which that goes [s]
    iterations: int = 5  # how often the first readings are linearised [1]

    def variance(self, time: FloatArray, sd: float) -> FloatArray:
        """Return the variance of the readings at `time` since the start, shape (n, 3) [local g^2].

        `time` (n,): since the start [s]; `sd`: of one reading [local g].
        """
        now = sd + self.extra_sd * np.exp(-time / self.fading)
        return np.repeat(now[:, None] ** 2, 3, axis=1)


ANNEALED = Options()
"""Noise that fades and five linearisations of the first readings."""

LITERAL = Options(full_rate=False, extra_sd=0.0, iterations=1)
"""As printed: it diverges."""

CONSTANT = Options(extra_sd=0.0, iterations=1)
"""With the noise of the readings from the first one on, and the full rate."""


@dataclass(frozen=True)
class Course:
    """The estimate in the course of time."""

    time: FloatArray  # (c,) since the start [s]
    angles: FloatArray  # (c, 3) outer, middle and inner angle [rad]
    constants: FloatArray  # (c, 42) packed as in `models.cluster.CONSTANTS`: local gravity is 1
    sd: FloatArray  # (c, 45) standard deviations of angles [rad] and constants
    # (c,) mean square of the normalised innovations since the moment before; 1 is expected [1]
    innovation: FloatArray
    readings: IntArray  # (c,) how many innovations these were [1]


@dataclass(frozen=True)
class Filtered:
    """What one pass of a filter found; finite numbers whatever became of it."""

    C_np: FloatArray  # (3, 3) attitude at the end, or where the filter stopped [1]
    constants: FloatArray  # (42,) packed as in `models.cluster.CONSTANTS`: local gravity is 1
    cov: FloatArray  # (45, 45) covariance of attitude (rotation vector in p) [rad] and constants
    status: Status
    advice: str  # the same in words
    intervals: int  # how many intervals were filtered [1]
    # mean square of the normalised innovations over the second half; 1 is expected [1]
    innovation: float
    course: Course  # the estimate in the course of time, up to where the filter stopped

    @property
    def angles(self) -> FloatArray:
        """Outer, middle and inner angle, shape (3,) [rad]."""
        return angles_of(self.C_np.T)


def filter_angles(
    tumble: Tumble, prior: Prior, options: Options = ANNEALED, *, moments: int = 200
) -> Filtered:
    """Run the published filter: three angles and 42 constants, one pass.

    `tumble`: the log, every reading is used by itself, whatever its `block`; `prior`: where the
    filter starts, and with what covariance, a delay is not among its states; `moments`: in how
    many moments the estimate is kept [1].
    """
    return _filtered(tumble, prior, options, kernels.FREE_ANGLES, moments)


def filter_misalignment(
    tumble: Tumble,
    prior: Prior,
    *,
    integrated: bool = False,
    options: Options = CONSTANT,
    moments: int = 200,
) -> Filtered:
    """Run a filter of small misalignment angles and 42 constants, one pass.

    `tumble`: the log, every reading is used by itself, whatever its `block`; `prior`: attitude
    and constants about which all is linearised, and with what covariance. About the truth, the
    planned form has the Cramer-Rao bound for its covariance; `integrated`: feed the constants
    back and integrate the attitude with them; `options`: how it runs, readings of a linear filter
    need no second linearisation, so that the number of `iterations` does not matter; `moments`:
    in how many moments the estimate is kept [1].
    """
    form = kernels.INTEGRATED if integrated else kernels.PLANNED
    return _filtered(tumble, prior, options, form, moments)


def _filtered(t: Tumble, prior: Prior, options: Options, form: int, moments: int) -> Filtered:
    n = len(t.dt)
    start = np.concatenate([prior.mean.constants, angles_of(prior.mean.C_np.T)])
    after = np.unique(np.linspace(n / moments, n, moments).round().astype(np.int64))
    estimate, sd = np.zeros((len(after), 45)), np.zeros((len(after), 45))
    nis, count = np.zeros(len(after)), np.zeros(len(after), np.int64)
    time = np.cumsum(t.dt)
    P, q = _start_cov(prior, start[42:], form), np.full(3, t.gyro_psd)
    variance = options.variance(time, np.sqrt(t.accel_variance))
    out = run(
        t.dt, t.command, t.reading, t.used, variance, t.mean, start, P, t.w_ie_n, q, t.arms,
        t.gravity, form, options.full_rate, options.iterations, after, estimate, sd, nis, count,
    )  # fmt: skip
    code, done, kept = out[:3]
    order = np.r_[42:45, 0:42]
    course = Course(
        time[after[:kept] - 1],
        estimate[:kept, 42:],
        estimate[:kept, :42],
        sd[:kept][:, order],
        nis[:kept] / np.maximum(count[:kept], 1),
        count[:kept],
    )
    late = slice(kept // 2, kept)
    innovation = float(nis[late].sum() / max(count[late].sum(), 1))
    status, advice = _verdict(code, done, innovation)
    C_np, constants, cov = _end(out[3:], form)
    return Filtered(C_np, constants, cov, status, advice, done, innovation, course)


def _start_cov(prior: Prior, angles: FloatArray, form: int) -> FloatArray:
    """Return the prior's covariance, shape (45, 45): constants, then angles or rotation of p."""
    cov = np.zeros((45, 45))
    cov[:42, :42] = np.diag(prior.sd[3:45] ** 2)
    slope = prior.mean.C_np.T
    if form == kernels.FREE_ANGLES:
        slope = angle_rates(angles) @ slope
    cov[42:, 42:] = slope @ np.diag(prior.sd[:3] ** 2) @ slope.T
    return cov


def _verdict(code: int, done: int, innovation: float) -> tuple[Status, str]:
    if code != kernels.RUNNING:
        not_finite = code == kernels.NOT_FINITE
        status = Status.NOT_FINITE if not_finite else Status.NOT_CONVERGED
        return status, _ADVICE[code].format(k=done)
    if innovation > DIVERGED:
        return Status.NOT_CONVERGED, _DIVERGING.format(ratio=np.sqrt(innovation))
    return Status.CONVERGED, _CONVERGED


def _end(out: Any, form: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return attitude, constants and covariance, attitude first, from what the kernel leaves."""
    C_np, estimate, error, P = out
    slope = np.eye(45)
    if form == kernels.FREE_ANGLES:
        C_np = attitude_of(estimate[42:45]).T
        slope[42:, 42:] = np.linalg.inv(angle_rates(estimate[42:45]))
    else:
        C_np = C_np @ exp(error[42:45])
    cov = slope @ P[:, :45] @ slope.T
    order = np.r_[42:45, 0:42]
    return C_np, estimate[:42] + error[:42], (cov + cov.T)[np.ix_(order, order)] / 2


def history(tumble: Tumble, found: Filtered, start: State) -> History:
    """Return the course of a filter beside the trajectory that its end leads back to.

    Standard deviations of the attitude are NaN: the course has those of angles only.
    """
    course = found.course
    rows = np.searchsorted(np.cumsum(tumble.dt), course.time - 1e-9) + 1
    C_np = np.swapaxes(attitudes(tumble, start, rows), -1, -2)
    there = np.swapaxes(attitude_of(course.angles), -1, -2)
    step, sd = np.zeros((len(rows), STATES)), np.full((len(rows), STATES), np.nan)
    step[:, :3] = log(np.swapaxes(C_np, -1, -2) @ there)
    step[:, 3:45] = course.constants - start.constants
    sd[:, 3:45] = course.sd[:, 3:]
    return History(course.time, step, sd, C_np)
