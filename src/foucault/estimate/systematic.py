"""Systematic calibration: every instrument error from the velocity error at rest alone.

The instrument navigates through turns and rests whose angles nobody needs to know. At rest its
velocity is zero and its position that of the site; what the navigator says instead is the sum of
what all errors have done since the start, each through the motion as it was. The filter is that of
`estimate.ins_filter`; here are its measurements, its passes, and the two steps of the source.

A coefficient that turns up only in the second part of a session (the deflection of dithered gyros)
must be a state from the beginning: carried over without it, the covariance of the first part is
too small, and misalignments take up what is not theirs.

References
----------
.. [1] Wu, Chen, Yan, Yuan, Guan, "Calibration and compensation of gyro sensitive-axis deflection
   under continuous rotation", *Navigation and Control* 2023(5), eqs. (13)-(19).
.. [2] Xie Bo, "Multi-position systematic calibration for a laser strapdown inertial measurement
   unit", thesis, National University of Defense Technology, 2011.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from foucault.coefficients import CoefficientVector
from foucault.estimate.ins_filter import FilterRun, Updates, run
from foucault.estimate.smoother import smooth
from foucault.models.earth import Site, gravity
from foucault.models.ins_errors import Sensors
from foucault.models.noise import ImuNoise
from foucault.navigate.increments import Increments
from foucault.navigate.state import State

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


BETWEEN = 2.0
"""Longest epoch during turns [s]."""


@dataclass(frozen=True)
class AtRest:
    """What is known of an instrument at rest.

    Attributes
    ----------
    velocity_sd : float
        How still it stands, each component [m/s].
    position_sd : float
        How well it stays in its place [m].
    interval : float
        Time between updates [s].
    decorrelate : bool
        Whether each rest starts anew with velocity and position: what turns did to them is not
        taken for what the coefficients did. The cure where the accelerometers are not at one
        point and their lever arms are not estimated.
    """

    velocity_sd: float = 1e-3
    position_sd: float = 1e-2
    interval: float = 1.0
    decorrelate: bool = False

    def updates(
        self, increments: Increments, rests: Sequence[tuple[int, int]], site: Site, first: int
    ) -> Updates:
        """Return the measurements of all rests, and the start, where nothing is measured.

        Parameters
        ----------
        increments : Increments
            The whole log.
        rests : sequence of (int, int)
            First and last row of each rest, in order [1].
        site : Site
            Where it stands; the latitude must be known.
        first : int, shape ()
            Row after which measurements count [1].
        """
        assert site.latitude is not None
        each = max(1, round(self.interval / float(np.median(increments.dt))))
        rows = [np.arange(max(a, first) + each, b + 1, each) for a, b in rests if b > first + each]
        measured = np.concatenate(rows)
        # Noise comes in where epochs begin and end: turns are cut up too.
        between = np.arange(first, measured[-1], max(each, round(BETWEEN / self.interval) * each))
        out = Updates.at_rest(
            np.union1d(measured, between), velocity_sd=self.velocity_sd,
            position=(site.latitude, 0.0, site.height), position_sd=self.position_sd,
        )  # fmt: skip
        out.sd[~np.isin(out.rows, measured)] = np.inf
        starts = np.array([r[0] for r in rows[1:]])
        if self.decorrelate:
            out.restart[np.searchsorted(out.rows, starts)] = True
        return out


@dataclass(frozen=True)
class SystematicRun:
    """What a session has shown.

    Attributes
    ----------
    run : FilterRun
        The last pass of the filter.
    estimate : CoefficientVector
        The coefficients with covariance.
    passes : tuple of ndarray, each shape (p,)
        The coefficients after each pass [SI].
    """

    run: FilterRun
    estimate: CoefficientVector
    passes: tuple[FloatArray, ...]


def solve(
    increments: Increments,
    C_nb: FloatArray,
    site: Site,
    sensors: Sensors,
    rests: Sequence[tuple[int, int]],
    P0: FloatArray,
    noise: ImuNoise,
    *,
    at_rest: AtRest | None = None,
    first: int = 0,
    estimate: FloatArray | None = None,
    passes: int = 1,
    keep: bool = False,
) -> SystematicRun:
    """Estimate all coefficients in one filter over the whole session.

    Parameters
    ----------
    increments : Increments
        The session as measured.
    C_nb : ndarray, shape (3, 3)
        Attitude at the end of row `first` [1].
    site : Site
        Where it stands; the latitude must be known.
    sensors : Sensors
        Coefficients to estimate.
    rests : sequence of (int, int)
        First and last row of each rest, in order [1].
    P0 : ndarray, shape (9 + p, 9 + p)
        Covariance at the start, see `estimate.ins_filter.start_cov` [SI].
    noise : ImuNoise
        White noise of the sensors [SI].
    at_rest : AtRest or None
        What is known at rest; None takes the defaults.
    first : int, shape ()
        Row at whose end the run starts, at rest [1].
    estimate : ndarray, shape (p,), or None
        Coefficients at the start, zero by default [SI].
    passes : int, shape ()
        How often the session is gone through; each later pass starts from the coefficients and
        the attitude that the one before has found, so that the equations are linear about them
        [1].
    keep : bool
        Whether the last pass keeps what a smoother needs.

    Notes
    -----
    A later pass keeps P0: it is the same prior, about another point of linearisation. The prior
    mean is zero, or `estimate`, in the first pass only; with priors much wider than the result this
    makes no difference.
    """
    assert site.latitude is not None
    updates = (at_rest or AtRest()).updates(increments, rests, site, first)
    state = State.at_rest(C_nb, site.latitude, 0.0, site.height)
    offset = site.gravity - float(gravity(site.latitude, site.height))
    seen: list[FloatArray] = []
    for k in range(passes):
        again = k + 1 < passes
        found = run(
            increments, state, sensors, updates, P0, noise, first=first, estimate=estimate,
            gravity_offset=offset, keep=keep or again,
        )  # fmt: skip
        estimate = found.coefficients[-1]
        seen.append(estimate)
        if again:
            state = replace(state, C_nb=smooth(found).trajectory.C_nb[0])
    return SystematicRun(found, found.estimate, tuple(seen))
