"""Transfer alignment: the slave's errors from its master's messages, pass by pass.

The equations are those of `estimate.transfer.system`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector, Layout
from foucault.errors import FoucaultError
from foucault.estimate.ins_filter import Updates, run, seen_at_place
from foucault.estimate.linear_filter import LinearRun, kalman, smoothed
from foucault.estimate.transfer.measured import Known, Slave
from foucault.estimate.transfer.system import Free, free_run
from foucault.kernels.ins_filter import corrected
from foucault.models.rotation import exp
from foucault.models.transfer import Matching, Messages, Mount
from foucault.navigate.state import State, state_of

MOST = 0.5
"""A delay that leaves less of the messages inside the slave's log is none [1]."""


@dataclass(frozen=True)
class Transfer:
    """What a transfer alignment has found."""

    free: Free  # the last free run
    run: LinearRun  # the last pass of the filter
    at: Known  # the point it is linear about
    passes: tuple[FloatArray, ...]  # (n - 9,) all but the errors of navigation after each pass [SI]

    @property
    def point(self) -> FloatArray:
        """What is added to the states after the ninth, shape (n - 9,) [SI]."""
        return _point(self.free.layout, self.at)

    @property
    def estimate(self) -> CoefficientVector:
        """Coefficients, installation, and what else was a state, at the last message [SI]."""
        layout = Layout(self.free.layout.coefficients[9:])
        values = self.point + self.run.states[-1, 9:]
        return CoefficientVector(layout, values, self.run.cov[9:, 9:])


def _point(layout: Layout, at: Known) -> FloatArray:
    out = np.zeros(len(layout))
    p = len(at.coefficients)
    out[9 : 9 + p] = at.coefficients
    out[layout.group("installation")] = at.installation
    if "master.delay" in layout.names:
        out[layout.index("master.delay")] = at.delay
    return out[9:]


def solve(
    slave: Slave,
    master: Messages,
    mount: Mount,
    matching: Matching,
    prior: Known,
    sd: FloatArray,
    *,
    passes: int = 2,
    settled: float = 0.0,
    gate: float = np.inf,
) -> Transfer:
    """Estimate the slave's errors with a Kalman filter.

    `prior`: what was known beforehand, the first pass is linear about it; `sd` (n,): how well,
    see `free_run` [SI]; `passes`: how often at most, each later pass is linear about the start
    that the one before has found [1]; `settled`: no more passes follow one that has moved nothing
    by more of its uncertainty [1]; `gate`: measurements beyond so many standard deviations are
    left out in the last pass [1].
    """
    at, seen = prior, []
    free = free_run(slave, master, mount, matching, at, prior, sd)
    for k in range(passes):
        found = kalman(free.system, keep=k + 1 < passes)
        seen.append(_point(free.layout, at) + found.states[-1, 9:])
        if k + 1 == passes or (k > 0 and last_step(seen, found) < settled):
            break
        further = moved(free, at, smoothed(free.system, found).start)
        if not _possible(further, slave, master):
            break  # passes that go astray: what the last one found is as much as there is
        try:
            free = free_run(slave, master, mount, matching, further, prior, sd)
        except FoucaultError:  # navigated with such errors nothing stays finite
            break
        at = further
    if np.isfinite(gate):
        found = kalman(free.system, gate=gate)
    return Transfer(free, found, at, tuple(seen))


def _possible(at: Known, slave: Slave, master: Messages) -> bool:
    """Tell whether a point is one to be linear about: finite, most messages inside the log."""
    numbers = (at.coefficients, at.installation, at.state.velocity_n, at.state.C_nb, [at.delay])
    if not all(np.isfinite(x).all() for x in numbers):
        return False
    valid, time = master.time - at.delay, slave.increments.time
    inside = (valid > time[slave.first]) & (valid < time[-1])
    return bool(np.mean(inside) > MOST)


def last_step(passes: Sequence[FloatArray], run: LinearRun) -> float:
    """Return by how much of its uncertainty the last pass has moved anything [1].

    `passes` (n - 9,): what two passes or more have found [SI].
    """
    return float(np.max(np.abs(passes[-1] - passes[-2]) / run.sd[-1, 9:]))


def moved(free: Free, at: Known, x: FloatArray) -> Known:
    """Return the point to be linear about next.

    `x` (n,): errors at the start [SI].
    """
    layout, p = free.layout, len(at.coefficients)
    seen = seen_at_place(at.state.packed()[None])[0] @ x[:9]
    state = replace(at.state, C_nb=exp(seen[:3]) @ at.state.C_nb,
                    velocity_n=at.state.velocity_n - seen[3:6])  # fmt: skip
    delay = at.delay
    if "master.delay" in layout.names:
        delay += float(x[layout.index("master.delay")])
    return Known(state, at.coefficients + x[9 : 9 + p],
                 at.installation + x[layout.group("installation")], delay)  # fmt: skip


@dataclass(frozen=True)
class HandOver:
    """The slave as it goes on alone."""

    state: State  # where it is, how fast and how turned
    coefficients: CoefficientVector  # errors of its sensors, with covariance [SI]
    cov: FloatArray  # (9, 9) covariance of (phi, velocity, position), frame n [SI]
    row: int  # row of the increments at whose end all this holds [1]


def hand_over(
    slave: Slave, found: Transfer, time: float, *, position: State | None = None
) -> HandOver:
    """Carry what was found at the last message on to the hand-over.

    `time`: when it is handed over, by the slave's clock, after the last message holds [s];
    `position` or None: where it was when the last message held, by the master: a free run does
    not know.
    """
    p = len(slave.sensors)
    x, rows = found.run.states[-1], found.free.rows
    state = state_of(corrected(found.free.history[-1:], x[None, :9])[0])
    if position is not None:
        state = replace(state, latitude=position.latitude, longitude=position.longitude,
                        height=position.height)  # fmt: skip
    end = max(slave.increments.row_at(time), int(rows[-1]))
    values, cov = found.at.coefficients + x[9 : 9 + p], found.run.cov[: 9 + p, : 9 + p]
    try:
        on = run(
            slave.increments, state, slave.sensors, Updates.none(np.array([end])), cov,
            slave.noise, first=int(rows[-1]), estimate=values,
            gravity_offset=slave.gravity_offset,
        )  # fmt: skip
    except FoucaultError:  # of passes that went astray: nothing goes on from there
        vector = CoefficientVector(slave.sensors.layout, values, cov[9:, 9:])
        return HandOver(state, vector, cov[:9, :9], int(rows[-1]))
    return HandOver(on.trajectory.state(-1), on.estimate, on.cov_at_place(), end)


@dataclass(frozen=True)
class DelayFit:
    """The delay for which the messages are likeliest."""

    # delay, sd: delay and its standard deviation, from the curvature of the likelihood [s]
    delay: float
    sd: float
    # tried, log_likelihood: (k,) what was tried [s], and how likely [1]
    tried: FloatArray
    log_likelihood: FloatArray
    at_edge: bool  # whether it lies at an end of the bracket: it may be outside


def likeliest_delay(
    slave: Slave, master: Messages, mount: Mount, matching: Matching, prior: Known, sd: FloatArray,
    bracket: tuple[float, float],
) -> DelayFit:  # fmt: skip
    """Return the delay of maximum likelihood, the rest being estimated for each that is tried.

    `matching`: what of the messages is used, not the delay as a state; `prior`: what was known
    beforehand, its delay is not used; `sd` (n,): how well, see `free_run` [SI]; `bracket`: where
    it may lie [s].

    Messages that hold before the start of the run with the largest delay are left out for all, so
    that every delay is judged by the same ones.
    """
    from scipy.optimize import minimize_scalar

    start = float(slave.increments.time[slave.first])
    interval = float(np.median(slave.increments.dt))
    same = master[master.time - bracket[1] > start + 2 * interval]
    tried: list[tuple[float, float]] = []

    def against(tau: float) -> float:
        free = free_run(slave, same, mount, matching, replace(prior, delay=tau), prior, sd)
        tried.append((tau, kalman(free.system).log_likelihood))
        return -tried[-1][1]

    found = minimize_scalar(against, bounds=bracket, method="bounded",
                            options={"xatol": 1e-5, "maxiter": 40})  # fmt: skip
    tau = float(found.x)
    width = max(2e-4, 0.01 * (bracket[1] - bracket[0]))
    sides = [against(tau + d) - found.fun for d in (-width, width)]
    curvature = float(np.sum(sides)) / width**2
    each, likely = np.array(sorted(tried)).T
    edge = min(tau - bracket[0], bracket[1] - tau) < width
    return DelayFit(tau, curvature**-0.5 if curvature > 0 else np.inf, each, likely, edge)
