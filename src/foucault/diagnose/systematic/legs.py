"""What a calibration does to the velocity of every rest: navigated there with it and without.

From the end of each rest the instrument is navigated through the turns that follow to the end of
the next, from the attitude that the smoothed filter has: with the calibration and without it. With
it the velocity is zero but for noise and for what is still uncertain; the standard deviation
promised is that of a run whose noise is not known. As the same readings made the calibration the
errors are a little smaller than that.

Where the filter starts every rest anew, so do these runs: what turns do to the velocity is not what
the calibration is to explain, and the velocity at the end of a rest is what it has gained there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.estimate.ins_filter import FilterRun, Updates, run
from foucault.estimate.smoother import smooth
from foucault.estimate.systematic.fit import SystematicModel
from foucault.navigate.state import State
from foucault.navigate.strapdown import navigate

EPOCH = 10.0
"""Noise is taken in so often [s]."""


@dataclass(frozen=True)
class Legs:
    """Navigation from rest to rest."""

    # (m,) number among the rests used of the one that each leg ends with [1]
    rest: npt.NDArray[np.int64]
    # start, end: (m,) when it begins and ends [s]
    start: FloatArray
    end: FloatArray
    # before, after: (m, 3) velocity at its end without and with the calibration: east, north, up
    # [m/s]
    before: FloatArray
    after: FloatArray
    sd: FloatArray  # (m, 3) what is promised of `after` [m/s]
    # (k,) numbers among the rests used of those that the filter went through [1]
    seen: npt.NDArray[np.int64]
    C_nb: FloatArray  # (k, 3, 3) attitudes at their ends [1]
    anew: bool  # whether velocities are those gained since the rest began


def legs_of(model: SystematicModel, found: FilterRun) -> Legs:
    """Navigate from each rest to the next; `found` is the last pass, made with ``keep=True``."""
    increments, rests, site, at_rest = model.increments, model.rests, model.site, model.at_rest
    assert site.latitude is not None
    seen, offset = smooth(found), site.anomaly
    ends = np.array([b for _, b in rests])
    # The last epoch of the filter in each rest; a filter may have begun after the first ones.
    epoch = np.searchsorted(found.time, increments.time[ends] + 1e-9, side="right") - 1
    there = np.flatnonzero(epoch >= 0)
    C_nb = seen.trajectory.C_nb[epoch[there]]
    rows = [increments.row_at(float(t)) for t in found.time[epoch[there]]]
    each = max(1, round(EPOCH / float(np.median(increments.dt))))
    before, after, sd = [], [], []
    recording = np.searchsorted(found.begins, epoch[there], side="right")
    legs = [k for k in range(len(rows) - 1) if recording[k] == recording[k + 1]]
    for k in legs:
        a, b = rows[k], rows[k + 1]
        state = State.at_rest(C_nb[k], site.latitude, 0.0, site.height)
        raw = navigate(increments, state, first=a, last=b, gravity_offset=offset).velocity_n
        start = max(rests[there[k + 1]][0], a) + 1
        before.append(raw[-1] - raw[start - a] if at_rest.decorrelate else raw[-1])
        P = seen.cov[epoch[there[k]]].copy()
        P[3:9], P[:, 3:9] = 0.0, 0.0  # at rest, and in its place
        epochs = np.unique([*range(a, b, each), start, b])
        updates = Updates.none(epochs)
        if at_rest.decorrelate:
            anew = np.searchsorted(epochs, start)
            updates.restart[anew] = True
            updates.position[anew] = site.latitude, 0.0, site.height
            updates.sd[anew] = np.repeat([at_rest.velocity_sd, at_rest.position_sd], 3)
        free = run(
            increments, state, found.sensors.during(int(recording[k])), updates, P, model.noise,
            first=a, estimate=seen.coefficients[epoch[there[k]]], gravity_offset=offset,
        )  # fmt: skip
        after.append(free.trajectory.velocity_n[-1])
        sd.append(free.sd[-1, 3:6])
    time = increments.time[rows]
    before_n, after_n, sd_n = (np.reshape(v, (-1, 3)) for v in (before, after, sd))
    last = np.array(legs, np.int64) + 1
    return Legs(there[last], time[last - 1], time[last], before_n, after_n, sd_n, there, C_nb,
                at_rest.decorrelate)  # fmt: skip
