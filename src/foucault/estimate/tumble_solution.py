"""Single-pass filters of a tumble: the published one of three angles, and small-angle filters.

The published filter [1]_ estimates outer, middle and inner angle and the 42 constants in one pass
of an extended Kalman filter, with the readings of the accelerometers as measurement and eq. (14)
as kinematics. As printed (`LITERAL`: from zero, with the noise of the readings from the first one
on) it diverges: after the first readings it is far surer of itself than it is right. With noise
that fades to its value, sd + extra exp(-t / fading), and first readings that are linearised five
times (`ANNEALED`) it comes to a few times the bound where the start is a few degrees off as in
[1]_, and not always: it does not say so, for its innovations are small against the noise it
believes. `estimate.tumble` is better than both.

The motive of [1]_ are filters of misalignment angles, which take the attitude for nearly known.
`filter_misalignment` is such a filter, in two forms. *Planned*: everything is linearised once,
about the attitude that the command gives from the mean of the prior; rotation and constants are an
error state that is never fed back: a linear Kalman filter. *Integrated*: the constants are fed
back, and the attitude is integrated with them, but its misalignment stays a small angle beside it.
In both, readings are linear in that angle, so that an angle a leaves errors of a^2 / 2.

The planned form takes more than the start for small: drift of 1 deg/h alone leads 1.5 deg away in
an hour and a half. Where only the start is to tell, the constants must be known or small; or the
integrated form is used.

A tumble solved: what it says, what it owes to errors that its filter does not weigh, the Earth.

Near the solution the estimate is linear in readings, command and place. Slow noise moves it by
what `estimate.tumble_answers` says, latitude by what one more pass says; an error with several
independent modes adds its covariance mode by mode [2]_::

    dx = x(log + mode) - x(log),    cov = sum_modes dx dx'

The slow part of a noise, a random walk or a bias that wanders with a correlation time, is split
into its modes over the log (Karhunen and Loeve [3]_): the eigenvectors of its covariance at some
nodes.

The filter takes the Earth's rate for known. The white residuals r of the fit, those of the prior
with them, change by ``D x`` where it is taken for more by x along north and up, and everything else
is fitted anew: see `navigate.ins_filter`.

References
----------
.. [1] Ding, Cai, Yang, Lian, "Continuous self-calibration and self-alignment method for floated
   inertial platform", J. NUDT 37(3), 2015, section 3 and eqs. (9)-(23).
.. [2] JCGM 100:2008, *Guide to the expression of uncertainty in measurement*, section 5.1.
.. [3] H. L. Van Trees, *Detection, Estimation, and Modulation Theory*, part I, 1968, section 3.4.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.coefficients import CoefficientVector
from foucault.errors import Finding, Status
from foucault.estimate.tumble import (
    STATES,
    Fit,
    History,
    Prior,
    State,
    Tumble,
    attitudes,
    by_source,
    linearised,
    look,
    rougher,
)
from foucault.estimate.tumble_answers import Change, Linear
from foucault.infer.filtered import Whitened
from foucault.infer.gauss_newton import FALSE_ALARM, chi_square_limits
from foucault.infer.linear_filter import Shock, likeliest
from foucault.kernels import cluster_transition as kernels
from foucault.kernels.cluster_filter import run
from foucault.kernels.cluster_information import RESIDUAL
from foucault.models.cluster import (
    CONSTANTS,
    LAYOUT,
    POWERS,
    angle_rates,
    angles_of,
    attitude_of,
    normalised,
)
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.rotation import exp, log, turned
from foucault.navigate.ins_filter import STEP, EarthSeen

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
        """Return the variance of readings of `sd` [local g], `time` (n,) after the start [s]."""
        now = sd + self.extra_sd * np.exp(-time / self.fading)
        return np.repeat(now[:, None] ** 2, 3, axis=1)


ANNEALED = Options()  # Noise that fades and five linearisations of the first readings.
LITERAL = Options(full_rate=False, extra_sd=0.0, iterations=1)  # As printed: it diverges.

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


NODES = 400  # At so many times the covariance of a slow noise is taken [1].
BATCH, MOST = 8, 200  # Modes are added so many at a time, and so many at most [1].
SMALL = 0.01  # Modes are added until a batch adds less than this share to every variance [1].


TIMES = 60  # A change that stays is looked for at so many times, then near the likeliest [1].
ALIKE = 9.0  # Kinds of change that gain as much but for this are not told apart [1].
EACH = FALSE_ALARM / 10  # How often one is found where there is none [1].


@dataclass(frozen=True)
class Shift:
    """The likeliest change that stays, which explains what is left, or is none."""

    # kinds of `Linear.shifts` that explain it about as well, the best first -> when; None for what
    # grows through the log [s]
    kinds: Mapping[str, float | None]
    found: Shock
    # kind -> a change that would be noticed in half of the log [rad/s], [rad], [local g]
    least: Mapping[str, float]

    @property
    def seen(self) -> bool:
        """Whether it is more than chance makes."""
        return self.found.square > self.found.limit


@dataclass(frozen=True)
class Solution:
    """A tumble solved, with what led to it: everything the checks look at."""

    tumble: Tumble  # the log as it was solved
    prior: Prior  # what was known beforehand, as it was solved
    fit: Fit
    site: Site  # where it stood; the latitude is known
    noise: ImuNoise  # noise that was weighed [SI]
    latitude_sd: float  # standard deviation of the latitude [rad]
    # (3,) outer, middle and inner angle where the start was believed to be [rad]
    believed: FloatArray
    # (46, 46) the bound of its covariance, in the order of `Fit.cov`; None for that
    least: FloatArray | None = None
    advice: str = ""  # how a published filter ended, in words
    findings: tuple[Finding, ...] = ()
    # more: source -> (46, 46) what else the covariance has, in the order of `Fit.cov` [its units]
    more: Mapping[str, FloatArray] = field(default_factory=dict)
    # (b, 3, c) what of the white rows terms that are not sought took up, independent ones [1]
    absorbed: FloatArray | None = None
    # what is said of the Earth's rate, where that was asked before a cause was enlarged
    asked: EarthSeen | None = None
    # what has changed for good, where that was
    changed: Shift | None = None

    @property
    def slow(self) -> bool:
        """Whether noise that is not white was declared: residuals may be larger and related."""
        return is_slow(self.noise.accel) or is_slow(self.noise.gyro)

    @cached_property
    def earth(self) -> EarthSeen | None:
        """What the session says of the Earth's rate; None where nothing is asked of it."""
        return self.earth_beside() if self.asked is None else self.asked

    def earth_beside(self, E: FloatArray | None = None) -> EarthSeen | None:
        """Return the same beside terms that are not sought, each of one size.

        `E` (r, c) or None: what one size of each changes of the white residuals [1].
        """
        fit, latitude = self.fit, self.site.latitude
        assert latitude is not None
        if self.slow or self.advice or fit.status is not Status.CONVERGED:
            return None

        def left(changed: Tumble) -> FloatArray:
            found = linearised(changed, self.prior, fit)
            return np.concatenate([found.rows[..., -1].ravel(), self.prior.rows(found.start)[0]])

        r = left(self.tumble)
        D = [(left(replace(self.tumble, w_ie_n=self.tumble.w_ie_n + STEP * EARTH_RATE * way)) - r)
             / STEP for way in np.eye(3)[1:]]  # fmt: skip
        rows = np.stack([-r, *D])
        if E is not None:  # their covariance is I + E E'
            if len(E) != len(r):
                return None  # averaged otherwise
            U, size, _ = np.linalg.svd(E, full_matrices=False)
            rows -= (rows @ U * (1 - 1 / np.sqrt(1 + size**2))) @ U.T
        known = self.latitude_sd * np.array([-np.sin(latitude), np.cos(latitude)])
        return EarthSeen.of(rows[0], rows[1:], latitude, np.outer(known, known))

    @cached_property
    def shift(self) -> Shift | None:
        """What may have changed for good; None where it does not explain what is left."""
        solved = self.fit.status is Status.CONVERGED and self.least is None and not self.slow
        if self.changed is not None or not solved:
            return self.changed
        linear = Linear(self.tumble, self.prior, self.fit.start)
        white, kinds = linear.white(self.absorbed), dict[str, tuple[Shock, int]]()
        n, least = len(white.residuals), dict[str, float]()
        at = np.unique(np.linspace(0, n, TIMES + 2).astype(np.int64)[1:-1])
        best = ""
        for _ in range(2):
            for kind, moved in linear.shifts(at).items():
                if self.absorbed is not None and kind.endswith("slowly"):
                    continue  # drifts are counted with, at their size
                one = likeliest(*white.told(moved), ways=5, times=TIMES, false_alarm=EACH)
                least.setdefault(kind, one.least)
                if kind not in kinds or one.square > kinds[kind][0].square:
                    kinds[kind] = one, int(at[one.epoch])
            best = max(kinds, key=lambda kind: kinds[kind][0].square)
            beside = kinds[best][1] + np.linspace(-1, 1, TIMES // 2) * n / TIMES
            at = np.unique(np.clip(beside, at[0], at[-1]).astype(np.int64))
        found = kinds[best][0]
        value, dof = self.white.square(slice(None))
        if found.square > found.limit and value - found.square > chi_square_limits(dof, EACH)[1]:
            return None
        order = sorted(kinds, key=lambda kind: -kinds[kind][0].square)
        alike = [kind for kind in order if kinds[kind][0].square > found.square - ALIKE]
        time = {k: None if "slowly" in k else float(self.fit.time[kinds[k][1]]) for k in alike}
        return Shift(time, found, least)

    @cached_property
    def white(self) -> Whitened:
        """The white rows at the solution, by the unknowns in units of the prior."""
        unit = self.prior.unit
        return Whitened(self.fit.rows[..., -1], self.fit.rows[..., :STATES],
                        self.fit.start_cov / np.outer(unit, unit), self.absorbed)  # fmt: skip

    @property
    def delay(self) -> float:
        """Delay of the readings: estimated, or what the test of a held one found [s]."""
        found = self.fit.start.delay if self.prior.sd[-1] > 0 else self.fit.late[0]
        return found - self.prior.mean.delay  # whole intervals were put back

    @cached_property
    def coefficients(self) -> CoefficientVector:
        """What was found, named, with covariance [SI]."""
        factor = 1 / normalised(self.site.gravity)
        values = np.concatenate([self.fit.start.constants * factor, angles_of(self.fit.C_np.T)])
        sd = np.concatenate([self.prior.sd[3:45] * factor, np.full(3, np.inf)])
        cov = np.sum(list(self.parts.values()), axis=0)
        return CoefficientVector(LAYOUT, values, cov, prior_sd=sd)

    @cached_property
    def parts(self) -> dict[str, FloatArray]:
        """Covariance of the coefficients by source, each shape (45, 45) [SI]."""
        if self.fit.status is not Status.CONVERGED:  # there is no solution to be moved
            return {"noise and prior": self._public(self.fit.cov)}
        # The covariance of a published filter is its own, and its gains are not the best ones.
        best = {"noise and prior": self.fit.cov}
        if self.least is None:
            best = by_source(self.tumble, self.prior, self.fit)
        out = {name: self._public(cov, self.fit.cov) for name, cov in best.items()}
        besides = {**self._owed(), **self.more}
        return out | {name: self._public(cov) for name, cov in besides.items()}

    @property
    def bound(self) -> FloatArray:
        """Cramer-Rao bound of the coefficients, as sd, shape (45,) [SI]."""
        least = self.fit.cov if self.least is None else self.least
        return np.sqrt(np.diag(self._public(least)))

    def _public(self, cov: FloatArray, whole: FloatArray | None = None) -> FloatArray:
        """Return the covariance of the 45 coefficients; `cov` (46, 46): as `Fit.cov`.

        `whole` (46, 46): what it is part of, by which the angles bend, to its share [as `cov`].
        """
        whole = cov if whole is None else whole
        to_public = np.zeros((len(LAYOUT), STATES))
        to_public[:42, 3:45] = np.diag(1 / normalised(self.site.gravity))
        # d angles = T dphi, dphi in p: truth ahead.
        to_public[42:, :3] = angle_rates(angles_of(self.fit.C_np.T))
        out = np.asarray(to_public @ cov @ to_public.T)
        share = float(np.trace(cov[:3, :3]) / np.trace(whole[:3, :3])) if whole is not cov else 1.0
        out[42:, 42:] += share * _bent(self.fit.C_np, whole[:3, :3])
        return out

    def _owed(self) -> dict[str, FloatArray]:
        """Return the covariance by what the filter does not weigh, (46, 46), where there is any."""
        latitude, gravity, noise = self.site.latitude, self.site.gravity, self.noise
        assert latitude is not None
        slow = noise.accel.bias_instability / gravity, noise.accel.random_walk / gravity
        accel = replace(noise.accel, bias_instability=slow[0], random_walk=slow[1])
        t, rough = self.tumble, rougher(self.tumble) or self.tumble  # slow noise needs no more
        given = {
            "slow noise of accelerometers": _modes(rough, accel, "reading"),
            # Drift and command act on the same axes, but for the torquer scale factor, a part in
            # 2,000.
            "slow noise of gyros": _modes(rough, noise.gyro, "command"),
        }
        linear = Linear(rough, self.prior, self.fit.start) if self.slow else None
        out: dict[str, FloatArray] = {}
        for name, batches in given.items():
            total = np.zeros((STATES, STATES))
            for changes in batches:
                assert linear is not None
                moved = linear.answers(changes)[1]
                added = moved @ moved.T
                total += added
                if np.all(np.diag(added) <= SMALL * np.diag(total)):
                    break
            if total.any():
                out[name] = total
        if self.latitude_sd > 0:
            north = np.array([0.0, np.cos(latitude + self.latitude_sd),
                              np.sin(latitude + self.latitude_sd)])  # fmt: skip
            here, there = (_moved_to(one, self.prior, self.fit.start)
                           for one in (t, replace(t, w_ie_n=EARTH_RATE * north)))  # fmt: skip
            moved = np.concatenate([log(here[0].T @ there[0]), there[1] - here[1]])
            out["latitude"] = np.outer(moved, moved)
        if self.site.gravity_sd > 0:
            moved = self.site.gravity_sd / gravity * _heavier(self.fit.start)
            out["local gravity"] = np.outer(moved, moved)
        return out


def is_slow(noise: TriadNoise) -> bool:
    """Whether a noise has more than a white part."""
    return noise.bias_instability > 0 or noise.random_walk > 0


def slow_modes(noise: TriadNoise, time: FloatArray) -> FloatArray:
    """Return the modes of the slow part of a noise, largest first, shape (modes, n).

    Its covariance is the sum of their outer products.

    `noise`: bias instability with its correlation time, and random walk [unit]; `time` (n,):
    since the start [s].
    """
    nodes = np.linspace(0.0, float(time[-1]), NODES)
    apart = np.abs(nodes[:, None] - nodes)
    cov = noise.random_walk**2 * np.minimum(nodes[:, None], nodes)
    if noise.bias_instability > 0:
        cov = cov + noise.bias_instability**2 * np.exp(-apart / noise.correlation_time)
    variance, modes = np.linalg.eigh(cov)
    keep = np.argsort(-variance)[:MOST]
    keep = keep[variance[keep] > 0]
    scaled = (modes[:, keep] * np.sqrt(variance[keep])).T
    return np.array([np.interp(time, nodes, mode) for mode in scaled]).reshape(-1, len(time))


def _modes(t: Tumble, noise: TriadNoise, what: str) -> Iterator[list[Change]]:
    """Yield modes of a slow noise on each axis of `what`, batch by batch."""
    if not is_slow(noise):
        return
    modes = slow_modes(noise, np.cumsum(t.dt))
    for k in range(0, len(modes), BATCH):
        few = [mode[:, None] * axis for mode in modes[k : k + BATCH] for axis in np.eye(3)]
        yield [Change(**{what: one}) for one in few]


def _moved_to(t: Tumble, prior: Prior, at: State) -> tuple[FloatArray, FloatArray]:
    """Return where one step from `at` leads: C_np at the end, and constants and delay, (43,)."""
    found = look(t, prior, at)
    Y, C_ip = found.out[1][0], found.out[3][0]
    psi = Y[:, :STATES] @ found.x - Y[:, RESIDUAL]
    return exp(t.w_ie_n * t.dt.sum()).T @ exp(psi) @ C_ip, (found.x * prior.unit)[3:]


def _heavier(at: State) -> FloatArray:
    """Return how the solution moves with the logarithm of the gravity that is believed, (46,).

    Readings over a larger gravity are smaller: bias, 1 + scale factor error and quadratic term are,
    packed. In SI every constant moves with its power of gravity besides.
    """
    moved, c = np.zeros(STATES), at.constants
    bias, scale, quadratic = (CONSTANTS.group(f"accel.{w}") for w in ("bias", "scale", "quadratic"))
    moved[3:45] = -POWERS * c
    moved[3 + bias] -= c[bias]
    moved[3 + scale] -= 1 + c[scale]
    moved[3 + quadratic] -= c[quadratic]
    return moved


def _bent(C_np: FloatArray, cov: FloatArray) -> FloatArray:
    """Return what the bend of the angles adds to their covariance, shape (3, 3).

    An azimuth known to a few degrees bends outer and inner angle beyond the linear. Along each
    principal axis of the covariance the second difference d of the angles is what z^2 / 2 of a
    normal z multiplies, with the second moment 3/4 d d'.
    """
    out = np.zeros((3, 3))
    for variance, axis in zip(*(part.T for part in np.linalg.eigh(cov)), strict=True):
        step = np.sqrt(max(variance, 0.0)) * axis
        ends = np.array([angles_of((C_np @ exp(sign * step)).T) for sign in (-1.0, 0.0, 1.0)])
        second = turned(ends[2] - ends[1]) - turned(ends[1] - ends[0])
        out += 0.75 * np.outer(second, second)
    return out
