"""What a tumble owes to errors that its filter does not weigh: slow noise, latitude, gravity.

Near the solution the estimate is linear in readings, command and place. An error of them moves it
by what one more pass over the changed log says; an error with several independent modes adds its
covariance mode by mode::

    dx = x(log + mode) - x(log),    cov = sum_modes dx dx'

The slow part of a noise, a random walk or a bias that wanders with a correlation time, is split
into its modes over the log (Karhunen and Loeve): the eigenvectors of its covariance at some nodes.

References
----------
.. [1] JCGM 100:2008, *Guide to the expression of uncertainty in measurement*, section 5.1.
.. [2] H. L. Van Trees, *Detection, Estimation, and Modulation Theory*, part I, 1968, section 3.4.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.estimate.tumble.fit import rougher
from foucault.estimate.tumble.one_pass import look
from foucault.estimate.tumble.state import STATES, Prior, State, Tumble
from foucault.kernels.cluster_information import RESIDUAL
from foucault.models.cluster import CONSTANTS, POWERS
from foucault.models.earth import EARTH_RATE
from foucault.models.noise import TriadNoise
from foucault.models.rotation import exp, log

NODES = 400
"""At so many times the covariance of a slow noise is taken [1]."""

BATCH, MOST = 8, 200
"""Modes are added so many at a time, and so many at most [1]."""

SMALL = 0.01
"""Modes are added until a batch adds less than this share to every variance [1]."""


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


def sources(
    t: Tumble, prior: Prior, at: State, *, accel: TriadNoise, gyro: TriadNoise, latitude: float,
    latitude_sd: float, gravity_sd: float,
) -> dict[str, FloatArray]:  # fmt: skip
    """Return what each source adds to the covariance of attitude at the end and constants.

    `accel`: noise of the accelerometers, its slow part counts here [local g]; `gyro`: noise of
    the drift of the gyros, its slow part counts here [rad/s]; `latitude`: where the cluster
    stands [rad]; `latitude_sd`: sd of that [rad]; `gravity_sd`: sd of local gravity over gravity
    [1]. Returns (46, 46): in the order and units of `tumble.Fit.cov`; sources that are zero are
    left out.
    """
    rough = rougher(t) or t  # slow noise needs no short averages
    time = np.cumsum(rough.dt)
    given = {
        "slow noise of accelerometers": (rough, _readings(rough, _modes(accel, time))),
        "slow noise of gyros": (rough, _commands(rough, _modes(gyro, time))),
        "latitude": (t, _places(t, latitude, latitude_sd)),
    }
    out: dict[str, FloatArray] = {}
    for name, (log_, changes) in given.items():
        total, here = np.zeros((STATES, STATES)), None
        for batch in changes:
            added = np.zeros((STATES, STATES))
            for changed in batch:
                here = here or _solution(log_, prior, at)
                C_np, values = _solution(changed, prior, at)
                moved = np.concatenate([log(here[0].T @ C_np), values - here[1]])
                added += np.outer(moved, moved)
            total += added
            if np.all(np.diag(added) <= SMALL * np.diag(total)):
                break
        if total.any():
            out[name] = total
    if gravity_sd > 0:
        moved = gravity_sd * _heavier(at)
        out["local gravity"] = np.outer(moved, moved)
    return out


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


def _modes(noise: TriadNoise, time: FloatArray) -> FloatArray:
    slow = noise.bias_instability > 0 or noise.random_walk > 0
    return slow_modes(noise, time) if slow else np.zeros((0, len(time)))


def _readings(t: Tumble, modes: FloatArray) -> Iterator[Iterable[Tumble]]:
    for k in range(0, len(modes), BATCH):
        yield (
            replace(t, reading=t.reading + mode[:, None] * axis)
            for mode in modes[k : k + BATCH]
            for axis in np.eye(3)
        )


def _commands(t: Tumble, modes: FloatArray) -> Iterator[Iterable[Tumble]]:
    # Drift and command act on the same axes, but for the torquer scale factor, a part in 2,000.
    for k in range(0, len(modes), BATCH):
        yield (
            replace(t, command=t.command + mode[:, None] * axis)
            for mode in modes[k : k + BATCH]
            for axis in np.eye(3)
        )


def _places(t: Tumble, latitude: float, sd: float) -> Iterator[Iterable[Tumble]]:
    if sd > 0:
        north, up = np.cos(latitude + sd), np.sin(latitude + sd)
        yield [replace(t, w_ie_n=EARTH_RATE * np.array([0.0, north, up]))]


def _solution(t: Tumble, prior: Prior, at: State) -> tuple[FloatArray, FloatArray]:
    """Return where one step from `at` leads: C_np at the end, and constants and delay, (43,)."""
    found = look(t, prior, at)
    Y, C_ip = found.out[1][0], found.out[3][0]
    psi = Y[:, :STATES] @ found.x - Y[:, RESIDUAL]
    return exp(t.w_ie_n * t.dt.sum()).T @ exp(psi) @ C_ip, (found.x * prior.unit)[3:]
