"""Every instrument error from velocities at rest.

Systematic calibration: every instrument error from the velocity error at rest alone.

The instrument navigates through turns and rests whose angles nobody needs to know. At rest its
velocity is zero and its position that of the site; what the navigator says instead is the sum of
what all errors have done since the start, each through the motion as it was. The filter is that of
`navigate.ins_filter`; here are its measurements, and a pass over all recordings.

A coefficient that turns up only in the second part of a session (the deflection of dithered gyros)
must be a state from the beginning: carried over without it, the covariance of the first part is
too small, and misalignments take up what is not theirs. Why the place of a rest is told once, and
how later passes go back to the start: design/README.md.

The two steps of the source: first without the deflection, then with it.

The first part of the session is filtered with the errors of the instrument alone (33 states). Its
coefficients start a second filter with those of the deflection (39 states) over the rest, with
uncertainties that are set anew: carried over they would be too small, for the first filter took
deflection for misalignment.

References
----------
.. [1] Wu, Chen, Yan, Yuan, Guan, "Calibration and compensation of gyro sensitive-axis deflection
   under continuous rotation", *Navigation and Control* 2023(5), eqs. (13)-(19); the two
   steps: (17)-(19).
.. [2] Xie Bo, "Multi-position systematic calibration for a laser strapdown inertial measurement
   unit", thesis, National University of Defense Technology, 2011.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.coefficients import CoefficientVector
from foucault.models.earth import Site
from foucault.models.ins_errors import Sensors
from foucault.models.noise import ImuNoise
from foucault.models.rotation import exp
from foucault.navigate.increments import Increments
from foucault.navigate.ins_filter import FilterRun, Updates, run, start_cov
from foucault.navigate.strapdown import State

BETWEEN = 2.0  # Longest epoch during turns [s].


STAYS = 1e-4  # How well an instrument at rest stays where it is [m].


@dataclass(frozen=True)
class AtRest:
    """What is known of an instrument at rest."""

    velocity_sd: float = 1e-3  # how still it stands, each component [m/s]
    # how near the same place it comes to rest every time; where, it then stays [m]
    position_sd: float = 1e-2
    interval: float = 1.0  # time between updates [s]
    # whether each rest starts anew with velocity and position: what turns did to them is not taken
    # for what the coefficients did. The cure where the accelerometers are not at one point and
    # their lever arms are not estimated
    decorrelate: bool = False
    # how still it stays while it turns about itself, each component; None: nothing is measured in
    # turns [m/s]
    turning_sd: float | None = None

    def updates(
        self, increments: Increments, rests: Sequence[tuple[int, int]], site: Site, first: int
    ) -> Updates:
        """Return the measurements of all rests, and the start, where nothing is measured.

        `rests`: first and last row of each rest, in order [1]; `site`: where it stands, the
        latitude must be known; `first`: row after which measurements count [1].
        """
        assert site.latitude is not None
        each = max(1, round(self.interval / float(np.median(increments.dt))))
        rows = [np.arange(max(a, first) + each, b + 1, each) for a, b in rests if b > first + each]
        measured = np.concatenate(rows)
        starts = np.array([r[0] for r in rows[1:] if len(r) > 1], np.int64)
        # Where it came to rest is told once. From the next sample on that place is the one to stay
        # at: told every second, one miss of a centimetre would count as hundreds that average out.
        there = starts if self.decorrelate else starts + 1
        # Noise comes in where epochs begin and end: turns are cut up too.
        cut = max(each, round(BETWEEN / self.interval) * each) if self.turning_sd is None else each
        between = np.arange(first, measured[-1], cut)
        out = Updates.at_rest(
            reduce(np.union1d, (measured, between, there)), velocity_sd=self.velocity_sd,
            position=(site.latitude, 0.0, site.height), position_sd=self.position_sd,
        )  # fmt: skip
        out.sd[~np.isin(out.rows, measured)] = np.inf
        if self.turning_sd is not None:
            out.sd[_between(out.rows, rests), :3] = self.turning_sd
        anew = np.searchsorted(out.rows, there)
        out.restart[anew] = True
        if not self.decorrelate:
            out.sd[anew, :3], out.sd[anew, 3:] = np.inf, STAYS
        return out


def _between(rows: IntArray, rests: Sequence[tuple[int, int]]) -> BoolArray:
    """Return which rows lie between one rest and the next."""
    starts, ends = np.array(rests).T
    after = np.searchsorted(ends, rows)  # rests that are over
    next_start = starts[np.minimum(after, len(rests) - 1)]
    return np.asarray((after > 0) & (after < len(rests)) & (rows < next_start))


@dataclass(frozen=True)
class Start:
    """Where a recording begins."""

    first: int  # row at whose end it starts, at rest [1]
    C_nb: FloatArray  # (3, 3) attitude there [1]
    cov: FloatArray  # (9, 9) covariance of the errors of navigation [SI]


@dataclass(frozen=True)
class SystematicModel:
    """What a session is: all that a pass of the filter takes, but for where it begins."""

    increments: Increments  # the log as measured
    site: Site  # where it stood; the latitude is known
    sensors: Sensors  # what is estimated
    rests: Sequence[tuple[int, int]]  # first and last row of each rest, in order [1]
    noise: ImuNoise  # white noise of the sensors [SI]
    at_rest: AtRest = AtRest()  # what is known at rest

    def filtered(
        self, starts: Sequence[Start], values: FloatArray, sd: FloatArray, *, keep: bool = False
    ) -> FilterRun:
        """Estimate all coefficients in one filter over the whole session.

        `starts`: of every recording of the instrument, in order: each begins with the coefficients
        of the one before, and with an attitude, velocity and position of its own; `values`, `sd`
        (p,): what is known of the coefficients, and where the equations are linear about first
        [SI]; `keep`: whether it keeps what a smoother needs.
        """
        assert self.site.latitude is not None
        runs: list[FilterRun] = []
        known, gone = np.diag(sd**2), self.sensors.wanders
        ends = [*(start.first for start in starts[1:]), len(self.increments)]
        for number, (start, end) in enumerate(zip(starts, ends, strict=True)):
            mine = [(a, b) for a, b in self.rests if a < end and b > start.first]
            measured = self.at_rest.updates(self.increments, mine, self.site, start.first)
            P = np.zeros((9 + len(sd),) * 2)
            P[:9, :9], P[9:, 9:] = start.cov, known
            state = State.at_rest(start.C_nb, self.site.latitude, 0.0, self.site.height)
            runs.append(run(
                self.increments, state, self.sensors.during(number), measured, P, self.noise,
                first=start.first, estimate=values, gravity_offset=self.site.anomaly, keep=keep,
            ))  # fmt: skip
            # Of one recording for the next, what stays.
            values = np.where(gone, 0.0, runs[-1].coefficients[-1])
            known = np.where(gone[:, None] | gone, np.diag(sd**2), runs[-1].cov[9:, 9:])
        return FilterRun.joined(runs, self.sensors)


def attitude_at_start(
    found: FilterRun, C_nb: FloatArray, values: FloatArray | None = None
) -> FloatArray:
    """Return the attitude that a pass should have begun with, shape (3, 3).

    The error psi that the filter has found at the end, and what it fed back at every epoch, are
    carried back to the start with the coefficients of the end. White noise of the gyros is left
    out, which a smoother would not: to linearise about, this is as good.

    `C_nb` (3, 3): the attitude that it began with [1]; `values` (p,): the coefficients, None for
    those at its end [SI].
    """
    last = found.coefficients[-1] if values is None else values
    before = np.concatenate([found.coefficients[:1] - found.corrections[:1, 9:],
                             found.coefficients[:-1]])  # fmt: skip
    missing = last - before  # in the epoch that ends at each row
    missing[:, found.decay > 0] = 0.0  # what wanders is at the end not what it was
    made = np.einsum("kij,kj->ki", found.transitions[:, :3, 9:], missing)
    psi, back = np.zeros(3), np.linalg.inv(found.transitions[:, :3, :3])
    for k in range(len(made) - 1, -1, -1):
        psi = back[k] @ (psi + found.corrections[k, :3] - made[k])
    return np.asarray(exp(psi) @ C_nb)


RESET = {
    "gyro.bias": np.radians(0.003) / 3600.0,
    "gyro.scale": 5e-6,
    "gyro.misalignment": np.radians(5.0 / 3600.0),
    "accel.bias": 10e-6 * 9.80665,
    "accel.scale": 5e-6,
    "accel.misalignment": np.radians(5.0 / 3600.0),
    "accel.asymmetry": 5e-6,
}
"""Standard deviations that the second step starts with; others keep theirs [SI]."""


def second_step(
    model: SystematicModel, first: FilterRun, estimate: CoefficientVector, prior: CoefficientVector
) -> tuple[FilterRun, FloatArray]:
    """Go on with the deflection from where the first step has ended, in one pass.

    `model`: the whole session, with the coefficients of the second step: those of the first, and
    more; `estimate`: what the first has found, with covariance [SI]; `prior`: what was known of
    those that it did not have: values and prior_sd [SI]. Returns the run, and the coefficients
    (p,) it began with [SI].
    """
    at_rest, increments, layout = model.at_rest, model.increments, model.sensors.layout
    values, sd = prior.values.copy(), prior.prior_sd.copy()
    keep = [layout.index(name) for name in estimate.layout.names]
    values[keep], sd[keep] = estimate.values, estimate.sd
    for group, reset in RESET.items():
        sd[layout.group(group)] = reset
    last = increments.row_at(float(first.time[-1]))
    P = start_cov(first.attitude_cov, at_rest.velocity_sd, at_rest.position_sd, sd)
    two = run(
        increments, first.trajectory.state(-1), model.sensors,
        at_rest.updates(increments, model.rests, model.site, last), P, model.noise, first=last,
        estimate=values, gravity_offset=model.site.anomaly, keep=True,
    )  # fmt: skip
    return two, values
