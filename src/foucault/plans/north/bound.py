"""How well stops of a north seeker show the heading, quickly: the solution, linearised and level.

Readings are linear in the rates along x_b and y_b, the offset and a linear drift of the gyro; with
the covariance S of white and slow noise over the stops, and all but the two rates eliminated,

    F = X_r' S^-1 X_r - X_r' S^-1 X_o (X_o' S^-1 X_o + prior)^-1 X_o' S^-1 X_r

is what they say of the rates; accelerometers likewise of the tilt, which turns the vertical rate
into a horizontal one. With latitude known the rates move with the heading alone, along
``w_ie cos L (cos psi, sin psi)``, and ``var = 1 / (e' F e)`` over the square of that rate. An
error by drift that the solution does not estimate is added, squared. `diagnose.north.plan.predict`
solves readings instead, tilted ones too; this is for a search that judges many plans.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import cos, inf, sin, sqrt
from typing import Literal

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.north.noise import NEARLY_FREE
from foucault.diagnose.north.plan import HEADINGS, Conditions
from foucault.models.earth import EARTH_RATE, gravity
from foucault.models.noise import TriadNoise
from foucault.models.session_noise import window_covariance

COLLINEAR = 1e-9
"""A smaller eigenvalue below this times the larger one is rounding: a direction not seen [1]."""

EYE = np.eye(2)


@dataclass(frozen=True)
class Known:
    """What the solution is told, and what the stops are seen by."""

    conditions: Conditions  # instrument and place; drift is below, tilt does not count here [SI]
    drift: float = 0.0  # linear drift of the gyro that is expected [rad/s^2]
    # whether the solution estimates it, as in [procedure]
    solved: Literal["auto", "none", "linear"] = "auto"
    drift_sd: float | None = None  # standard deviation that it gives it [rad/s^2]
    # whether two accelerometers stay with the case, or one turns with the gyro
    on_case: bool = False
    # of a rough heading, from which the angles count; None where they count from forward [rad]
    rough_sd: float | None = None

    @cached_property
    def towards(self) -> FloatArray:
        """How the rates change with the heading, for the headings averaged over, (m, 2) [1]."""
        at = HEADINGS if self.rough_sd is None else np.array([1.0, -1.0]) * self.rough_sd
        return np.stack([np.cos(at), np.sin(at)], 1)

    @cached_property
    def white_tilt(self) -> TriadNoise:
        """Noise of the accelerometers, never none: then they would show a tilt by one stop."""
        noise = self.conditions.noise.accel
        return replace(noise, white=max(noise.white, 1e-9))


@dataclass(frozen=True)
class Seen:
    """What stops show."""

    # of the heading's error over the headings, infinite where one is not seen [rad^2]
    mean_square: float
    # what the solution gives the drift beforehand: 0 none, infinite where it is free [rad/s^2]
    drift_sd: float


def seen(angle: FloatArray, start: FloatArray, time: FloatArray, known: Known) -> Seen:
    """Return what stops show of the heading.

    `angle` (k,): index angles, from north, where a rough heading is known [rad]; `start`, `time`
    (k,): when each stop begins and how long it is measured [s].
    """
    e = np.stack([np.sin(angle), np.cos(angle)], 1)
    t = start + time / 2
    t = t - (t @ time) / time.sum()
    noise = known.conditions.noise.gyro
    white = _white(noise, time)
    X = np.column_stack([e, np.ones_like(t), t])
    SX = X / white[:, None]
    if noise.bias_instability or noise.random_walk:
        SX = np.linalg.solve(np.diag(white) + window_covariance(start, start + time, noise), X)
    N = X.T @ SX
    tilt = _tilt(e, time, known)
    best, owed = _told(N, len(angle), known)
    if best is None or tilt is None:
        return Seen(inf, owed)
    c = known.conditions
    up = EARTH_RATE * sin(c.latitude)
    F = best @ _inverse(EYE + up**2 * tilt @ best)
    if not c.latitude_known:
        if not _spans(F):
            return Seen(inf, owed)
        C = _inverse(F)
        gain = known.towards
        variance = np.einsum("mi,ij,mj->m", gain, C, gain)
    else:
        gain = known.towards @ F
        told = np.sum(gain * known.towards, axis=1)
        if not (told > COLLINEAR * np.trace(F)).all():
            return Seen(inf, owed)
        gain, variance = gain / told[:, None], 1.0 / told
    if known.rough_sd is None and not _spans(best):
        return Seen(inf, owed)
    if known.drift and owed == 0:  # what it does to the rates, and they to the heading
        share = N[:2, 2] / (N[2, 2] + known.conditions.offset_sd**-2.0)
        moved = np.linalg.pinv(best, hermitian=True) @ (N[:2, 3] - share * N[2, 3])
        variance = variance + (known.drift * (gain @ moved)) ** 2
    rate = EARTH_RATE * cos(c.latitude)
    return Seen(float(variance.mean()) / rate**2, owed)


def _white(noise: TriadNoise, time: FloatArray) -> FloatArray:
    """Return the variance of means by white noise, as `models.readings` has it of means."""
    return np.maximum(noise.white**2 / time, 1e-24)


def _left(N: FloatArray, prior: tuple[float, ...]) -> FloatArray:
    """Return the information on the two rates, the others eliminated, with priors on those."""
    for k in range(1 + len(prior), 1, -1):
        column = N[:k, k]
        N = N[:k, :k] - np.outer(column, column) / (N[k, k] + prior[k - 2])
    return np.asarray(N)


def _inverse(F: FloatArray) -> FloatArray:
    """Invert a matrix of 2 x 2."""
    (a, b), (c, d) = F.tolist()
    det = a * d - b * c
    return np.array([[d / det, -b / det], [-c / det, a / det]])


def _told(N: FloatArray, count: int, known: Known) -> tuple[FloatArray | None, float]:
    """Return the information on the rates, and what the drift is given: as `drift_sd` does."""
    offset = known.conditions.offset_sd**-2.0
    plain = _left(N, (offset,))
    if known.solved == "none":
        return plain, 0.0
    if known.drift_sd is not None:
        if known.drift_sd == 0:
            return plain, 0.0
        return _left(N, (offset, known.drift_sd**-2.0)), known.drift_sd
    if count < 2 or not N[3, 3] > 0:
        return plain, 0.0
    free = _left(N, (offset, 0.0))
    if known.solved == "linear":
        return free, inf
    collinear = not _spans(plain)
    if count < (4 if collinear else 5):  # no reading to spare
        return plain, 0.0
    if collinear:  # what is not seen at all grows by nothing
        return free, inf
    # The larger variance is one over the smaller information.
    ratio = _least(plain) / _least(free)
    return (free, inf) if ratio < NEARLY_FREE**2 else (plain, 0.0)


def _spans(F: FloatArray) -> bool:
    """Tell whether both eigenvalues of a matrix of 2 x 2 are above zero, rounding apart."""
    (a, b), (_, d) = F.tolist()
    return bool(a + d > 0 and a * d - b * b > COLLINEAR * (a + d) ** 2)


def _least(F: FloatArray) -> float:
    """Return the smaller eigenvalue of a matrix of 2 x 2."""
    (a, b), (_, d) = F.tolist()
    return float((a + d) / 2 - sqrt(((a - d) / 2) ** 2 + b * b))


def _tilt(e: FloatArray, time: FloatArray, known: Known) -> FloatArray | None:
    """Return the covariance of the tilt, (2, 2) [rad^2]; None where it is not seen."""
    c = known.conditions
    level = 0.0 if c.level_sd is None else c.level_sd**-2.0
    F = level * EYE
    g = gravity(c.latitude)
    if known.on_case:
        F = F + g**2 * float(np.sum(1.0 / _white(known.white_tilt, time))) * EYE
    elif c.level_sd is None:
        X = np.column_stack([e, np.ones(len(e))])
        F = F + g**2 * _left(X.T @ (X / _white(known.white_tilt, time)[:, None]), (0.0,))
    return _inverse(F) if _spans(F) else None


def root_mean_square(angle: FloatArray, start: FloatArray, time: FloatArray, known: Known) -> float:
    """Return the root mean square error of the heading [rad].

    `angle` (k,): index angles, from north, where a rough heading is known [rad]; `start`, `time`
    (k,): when each stop begins and how long it is measured [s].
    """
    return sqrt(seen(angle, start, time, known).mean_square)
