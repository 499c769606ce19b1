"""The trajectory of a tumble: where it may begin, where it leads, what the readings depend on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.estimate.tumble.one_pass import NO_MOMENTS, run
from foucault.estimate.tumble.state import STATES, Prior, State, Tumble
from foucault.models.rotation import aligning, exp


def levelled(tumble: Tumble, prior: Prior, seconds: float = 1.0) -> State:
    """Return the mean of the prior, turned the shortest way so that the first readings are up.

    `seconds`: over how long the readings are averaged [s].
    """
    first = np.flatnonzero(tumble.used)
    within = np.cumsum(tumble.dt)[first] <= np.cumsum(tumble.dt)[first[:1]] + seconds
    mean = tumble.reading[first[within]].mean(axis=0)
    C_np = prior.mean.C_np
    up_n = C_np @ (mean / np.linalg.norm(mean))
    return replace(prior.mean, C_np=aligning(up_n, np.array([0.0, 0.0, 1.0])) @ C_np)


def beginning(tumble: Tumble, prior: Prior, constants: FloatArray, C_np: FloatArray) -> State:
    """Return the state at the start that ends in an attitude.

    `tumble`: the log, its readings say about where it began; `constants` (42,): packed: local
    gravity is 1; `C_np` (3, 3): attitude at the end [1].
    """
    at = replace(levelled(tumble, prior), constants=constants)
    last = np.array([len(tumble.dt)])
    C_in = exp(tumble.w_ie_n * tumble.dt.sum())
    for _ in range(4):  # drift depends on attitude, by a part in a thousand
        C_ip = C_in @ attitudes(tumble, at, last)[0].T
        at = replace(at, C_np=C_in @ C_np @ C_ip.T @ at.C_np)
    return at


def attitudes(tumble: Tumble, at: State, rows: IntArray) -> FloatArray:
    """Return C_pn at rows of the log along the trajectory of a state, shape (k, 3, 3).

    `rows` (k,): ascending: 0 is the start, n the end of the last interval [1].
    """
    blind = replace(tumble, used=np.zeros(len(tumble.dt), bool))
    later = rows[rows > 0]
    out, _ = run(blind, at, np.ones(STATES), later - 1, False)
    C_ip = np.concatenate([np.repeat(at.C_np[None], len(rows) - len(later), axis=0), out[8]])
    time = np.concatenate([np.zeros(len(rows) - len(later)), out[4]])
    return np.swapaxes(C_ip, -1, -2) @ exp(time[:, None] * tumble.w_ie_n)


def sensitivities(tumble: Tumble, at: State, scale: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return time, shape (b,) [s], and d reading / d state times `scale`, shape (b, 3, 46).

    `scale` (46,): what one unit of each is, such as its prior sd [rad, packed, s].
    """
    # No noise: the gain is zero.
    still = replace(tumble, gyro_psd=0.0, accel_variance=1.0, shared=0.0)
    out, rows = run(still, at, scale, NO_MOMENTS, True)
    block = tumble.block
    total = np.concatenate([[0], np.cumsum(tumble.used)])
    count = np.diff(np.append(total[:-1:block], total[-1]))
    white = np.sqrt(count[count > 0])
    return out[9], rows[:, :, :STATES] / white[:, None, None]
