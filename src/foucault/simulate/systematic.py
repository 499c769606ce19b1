"""Simulate a systematic calibration: a table turns the instrument through a sequence, at one place.

In every action of a sequence the body turns about an axis a that is fixed in it, by an angle s(t)
of known profile (`plans.sequence`). Gravity and the Earth's rate are constant vectors of
the level frame, so that with their components f_k, e_k in the body when the action begins::

    f_b    = Exp(-a s) f_k             w_ib_b = a s' + Exp(-a s) e_k
    w_ib_b' = a s'' - a s' x Exp(-a s) e_k

Accelerometer i sits at r_i from the point the table turns about and feels, along its own axis,
``(w x (w x r_i) + w' x r_i)_i`` more (size effect). Increments are integrals of what the
instrument says, by Gauss-Legendre quadrature between the samples and wherever a profile changes:
exact to rounding, coning, sculling and products of errors included. At rest they are constants.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.polynomial import legendre

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.models.earth import Site, earth_rate_n
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise
from foucault.models.rotation import exp
from foucault.models.size_effect import SizeEffect
from foucault.plans.manoeuvres import Profile, Rotate
from foucault.plans.sequence import CalibrationSequence
from foucault.simulate.noise import noisy_log
from foucault.tables import Log, whole_samples

_NODES, _WEIGHTS = legendre.leggauss(5)
_STEP = 0.25  # of a ramp: longest interval over which five nodes give all digits
_CHUNK = 8192  # intervals worked on at once: their arrays stay in the cache


@dataclass(frozen=True)
class TableErrors:
    """What a table does otherwise than told."""

    angle_sd: float = 0.0  # sd of the error of each turn; errors add up from turn to turn [rad]
    # (3,) rotation vector from the start as told to the true one, East, North, Up [rad]
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class SystematicSimulation:
    """A simulated systematic calibration."""

    log: Log  # what the instrument said [SI]
    model: ImuModel  # the errors it had
    arms: FloatArray  # (3, 3) places of the x, y and z accelerometer in its rows, frame b [m]
    delay: float  # what the accelerometers say was true so long before the time of the row [s]
    # told, sequence: what the table was told, and what it did
    told: CalibrationSequence
    sequence: CalibrationSequence
    site: Site

    @property
    def size_effect(self) -> SizeEffect:
        """Lever arms and delay as a calibration finds them."""
        return SizeEffect(self.arms - self.arms[2], self.delay)

    def attitude(self, time: FloatArray) -> FloatArray:
        """Return the true C_nb, shape (n, 3, 3) [1], at `time`, shape (n,) [s]."""
        return self.sequence.at(time)[0]

    def truth_json(self) -> dict[str, Any]:
        """Return the truth beside the coefficients."""
        return {
            "sequence": self.told.name,
            "gravity": self.site.gravity,
            "latitude": self.site.latitude,
            "C_nb_start": self.sequence.start.tolist(),
            "angles": [a.angle for a in self.sequence.actions if isinstance(a, Rotate)],
            "arms": self.arms.tolist(),
            "delay": self.delay,
        }


def simulate_systematic(
    sequence: CalibrationSequence,
    *,
    site: Site,
    model: ImuModel | None = None,
    noise: ImuNoise | None = None,
    rate: float = 200.0,
    table: TableErrors | None = None,
    arms: FloatArray | None = None,
    delay: float = 0.0,
    seed: int = 0,
) -> SystematicSimulation:
    """Simulate the log of a sequence: increments.

    `sequence`: what the table is told. Every action is made to begin on a sample; `site`: where
    it stands, the latitude must be known; `model`: errors of the instrument, None for none;
    `noise`: its noise [SI], None for none; `rate`: sample rate [Hz]; `table`: errors of the
    table, None for none; `arms` (3, 3): places of the x, y and z accelerometer in its rows, from
    the point the table turns about, frame b [m], None for zero; `delay`: what the accelerometers
    say was true so long before the time of the row [s]; `seed`: seed of noise and table [1].

    The first sample is at time 0, after one interval of rest; so are first samples of
    `simulate.motion`.
    """
    if site.latitude is None:
        raise error("systematic.site", what="the simulation")
    model, noise, table = model or ImuModel(), noise or ImuNoise(), table or TableErrors()
    places = np.zeros((3, 3)) if arms is None else np.asarray(arms, float)
    _checked(rate, delay, places, table.angle_sd)
    rng = np.random.default_rng(seed)
    told = sequence.on_samples(rate)
    done = _disturbed(told, table, rng)
    felt = _Felt(done, site.gravity, earth_rate_n(site.latitude), model, places)
    time = np.arange(-1, whole_samples(np.round(done.duration * rate)) + 1) / rate
    accel, gyro = felt.means(time)
    if delay:
        accel, _ = felt.means(time - delay)
    log = noisy_log(time[1:], accel, gyro, sampled="increment", noise=noise, rng=rng)
    return SystematicSimulation(log, model, places, delay, told, done, site)


def _checked(rate: float, delay: float, arms: FloatArray, angle_sd: float) -> None:
    for key, given, good, allowed in (
        ("rate", rate, 0 < rate < np.inf, "above zero"),
        ("delay", delay, bool(np.isfinite(delay)), "a finite number"),
        ("arms", arms.shape, arms.shape == (3, 3) and bool(np.isfinite(arms).all()),
         "three finite places, shape (3, 3)"),
        ("angle_sd", angle_sd, 0 <= angle_sd < np.inf, "zero or more"),
    ):  # fmt: skip
        if not good:
            raise error("systematic.value", key=key, given=given, allowed=allowed)


def _disturbed(
    told: CalibrationSequence, table: TableErrors, rng: np.random.Generator
) -> CalibrationSequence:
    """Return what the table does: each turn misses its angle, in the time it was to take."""
    actions = list(told.actions)
    for k in told.moves if table.angle_sd else ():
        action = actions[k]
        assert isinstance(action, Rotate)
        angle = action.angle + table.angle_sd * rng.standard_normal()
        steady = max(abs(action.angle) / action.rate, action.ramp)
        actions[k] = replace(action, angle=angle, rate=abs(angle) / steady)
    start = exp(np.array(table.start)) @ told.start
    return replace(told, start=start, actions=tuple(actions))


@dataclass(frozen=True)
class _Felt:
    """What the instrument says, as a function of time."""

    sequence: CalibrationSequence
    gravity: float
    earth_n: FloatArray
    model: ImuModel
    arms: FloatArray

    def means(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the mean readings between neighbours of `time`, shape (n - 1, 3) each."""
        joints = self._joints(time)
        edges = np.union1d(time, joints)
        h = np.diff(edges) / 2
        middle = edges[:-1] + h
        begins = np.concatenate([[-np.inf], self.sequence.times[1:-1], [np.inf]])
        cuts = np.searchsorted(middle, begins)
        accel, gyro = np.empty((2, len(h), 3))
        for k, profile in enumerate(self.sequence.profiles):
            if profile is None:
                rows = slice(cuts[k], cuts[k + 1])
                accel[rows], gyro[rows] = self._still(k)
                continue
            for first in range(cuts[k], cuts[k + 1], _CHUNK):
                rows = slice(first, min(first + _CHUNK, cuts[k + 1]))
                t = (middle[rows, None] + h[rows, None] * _NODES).ravel() - self.sequence.times[k]
                f, w = self._turning(k, profile, np.clip(t, 0.0, profile.time))
                accel[rows] = _WEIGHTS / 2 @ f.reshape(-1, 5, 3)
                gyro[rows] = _WEIGHTS / 2 @ w.reshape(-1, 5, 3)
        if len(edges) == len(time):
            return accel, gyro
        begin = np.searchsorted(edges, time[:-1])
        share = (2 * h / np.repeat(np.diff(time), np.diff([*begin, len(h)])))[:, None]
        return np.add.reduceat(accel * share, begin), np.add.reduceat(gyro * share, begin)

    def _joints(self, time: FloatArray) -> FloatArray:
        """Where a profile begins or changes; and in between, where samples are far apart."""
        marks = []
        for begin, profile in zip(self.sequence.times[:-1], self.sequence.profiles, strict=True):
            if profile is None:
                continue
            at = np.array([0.0, profile.ramp, profile.time / 2, profile.time - profile.ramp])
            at = np.unique(np.append(at, profile.time))
            step = _STEP * min(profile.ramp, 1.0 / max(abs(profile.peak), 1e-9))
            if np.diff(time).max() > step:
                parts = int(np.ceil(profile.time / step))
                at = np.union1d(at, np.linspace(0.0, profile.time, parts + 1))
            marks.append(begin + at)
        inner = np.concatenate(marks) if marks else np.empty(0)
        inner = inner[(inner > time[0]) & (inner < time[-1])]
        near = np.abs(time[np.clip(np.searchsorted(time, inner), 1, len(time) - 1)] - inner)
        before = np.abs(time[np.clip(np.searchsorted(time, inner) - 1, 0, None)] - inner)
        return np.asarray(inner[np.minimum(near, before) > 1e-9])

    def _still(self, k: int) -> tuple[FloatArray, FloatArray]:
        f, e = self._begin(k)
        zero = np.zeros(1)
        return self._read(f[None], e[None], np.zeros((1, 3)), zero)

    def _begin(self, k: int) -> tuple[FloatArray, FloatArray]:
        C_bn = self.sequence.attitudes[k].T
        return C_bn @ np.array([0.0, 0.0, self.gravity]), C_bn @ self.earth_n

    def _turning(self, k: int, profile: Profile, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        angle, rate, growth = profile.at(t)
        a = self.sequence.axis_b[k]
        s, c = np.sin(angle)[:, None], np.cos(angle)[:, None]
        f, e = (_turned_back(a, s, c, v) for v in self._begin(k))
        w = a * rate[:, None] + e
        dw = a * growth[:, None] - np.cross(a, e) * rate[:, None]
        return self._read(f, w, dw, rate)

    def _read(
        self, f: FloatArray, w: FloatArray, dw: FloatArray, rate: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        accel, gyro = self.model.measure(f, w)
        if self.arms.any():
            # each accelerometer has a place of its own, and only the gyros are all at the centre
            away = np.stack([_component(i, w, dw, r) for i, r in enumerate(self.arms)], axis=-1)
            accel = self.model.measure(f + away, w)[0]
        return accel, gyro


def _component(i: int, w: FloatArray, dw: FloatArray, r: FloatArray) -> FloatArray:
    """Return component i of ``w x (w x r) + dw x r``, shape (n,) [m/s^2]."""
    j, k = (i + 1) % 3, (i + 2) % 3
    along = w @ r
    square = np.einsum("ni,ni->n", w, w)
    return np.asarray(w[:, i] * along - r[i] * square + dw[:, j] * r[k] - dw[:, k] * r[j])


def _turned_back(a: FloatArray, s: FloatArray, c: FloatArray, v: FloatArray) -> FloatArray:
    """Return ``Exp(-a angle) v``, shape (n, 3), from sine and cosine of the angle, (n, 1)."""
    along = a * (a @ v)
    return np.asarray(along + c * (v - along) - s * np.cross(a, v))
