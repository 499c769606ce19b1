"""Simulate what instruments say on a table, as means over rests and whole turns, many at once.

In a rest the mean specific force is g along up, and the mean rate that of the Earth. Over whole
turns of the outer axis, o in body axes and tilted by the plumb errors of the table::

    f = g cos(tilt) o - h^2 (r - (r.o) o)       w = h o,    h = true rate + Earth's rate along o

exactly, but for the square of the tilt. `log` simulates the same sample by sample.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields

import numpy as np

from foucault.arrays import FloatArray
from foucault.models.deflection import felt
from foucault.models.earth import Site
from foucault.models.gyro_scale import readout
from foucault.models.imu import LAYOUT, LINEAR_LOWER, ImuModel, coefficient_slot, products
from foucault.models.noise import ImuNoise, grade
from foucault.models.readings import Readings, mean_variance
from foucault.models.rotation import exp
from foucault.models.turntable import TableErrors, TablePlan, chain, earth_rate_t


@dataclass(frozen=True)
class Rig:
    """A table with its errors, and how the instrument sits on it.

    Where an array may have a first axis N it holds one value per instrument.
    """

    # (6,) or (N, 6) errors that all positions share, in the order of `models.turntable.COMMON`
    # [rad]
    common: FloatArray = field(default_factory=lambda: np.zeros(6))
    # sd of another error of the middle and of the inner angle in each position [rad]
    position_sd: float = 0.0
    # (N,) relative error of all spin rates, true over said minus 1 [1]
    rate_error: float | FloatArray = 0.0
    rate_jitter: float = 0.0  # sd of another relative error of the rate of each spin [1]
    # (3,) or (N, 3) rotation of the body axes: ``C_bk = Exp(-[mounting x])`` [rad]
    mounting: FloatArray = field(default_factory=lambda: np.zeros(3))
    # (3,) or (N, 3) the accelerometers from the centre of the table, body axes [m]
    lever_arm: FloatArray = field(default_factory=lambda: np.zeros(3))
    heading: float = 0.0  # azimuth of table y at outer angle zero [rad]

    @property
    def mounting_matrix(self) -> FloatArray:
        """C_bk, shape (3, 3) or (N, 3, 3) [1]."""
        return exp(-self.mounting)

    def outer_t(self) -> FloatArray:
        """Return the direction of the outer axis in table axes, shape (3,) or (N, 3) [1]."""
        x, y = self.common[..., 0], self.common[..., 1]
        return np.stack([np.sin(y), -np.sin(x) * np.cos(y), np.cos(x) * np.cos(y)], axis=-1)

    def draw(
        self, plan: TablePlan, instruments: int, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Draw what differs from one position to the next.

        `instruments`: number N of instruments [1]. Returns `position` (N, n, 2): errors of the
        middle and of the inner angle [rad]; `rate` (N, n): true rates of the outer axis, 0 at
        rest [rad/s].
        """
        shape = (instruments, len(plan))
        position = self.position_sd * rng.standard_normal((*shape, 2))
        jitter = self.rate_jitter * rng.standard_normal(shape)
        return position, plan.rate * (1.0 + np.reshape(self.rate_error, (-1, 1)) + jitter)


@dataclass(frozen=True)
class Fleet:
    """The error models of N instruments, stacked; the blocks of `ImuModel` with an axis more.

    Attributes
    ----------
    accel_matrix, gyro_matrix, g_sensitivity : ndarray, shape (N, 3, 3)
        As in `ImuModel` [SI].
    accel_bias, gyro_bias, gyro_asymmetry, gyro_cubic, accel_asymmetry : ndarray, shape (N, 3)
        As in `ImuModel` [SI].
    accel_quadratic : ndarray, shape (N, 3, 6)
        As in `ImuModel` [SI].
    deflection : ndarray, shape (N, 3, 3, 3)
        As in `ImuModel` [SI].
    """

    accel_matrix: FloatArray
    accel_bias: FloatArray
    accel_quadratic: FloatArray
    gyro_matrix: FloatArray
    gyro_bias: FloatArray
    g_sensitivity: FloatArray
    gyro_asymmetry: FloatArray
    gyro_cubic: FloatArray
    accel_asymmetry: FloatArray
    deflection: FloatArray

    def __len__(self) -> int:
        return len(self.accel_bias)

    @classmethod
    def of(cls, models: Sequence[ImuModel]) -> Fleet:
        """Stack models."""
        return cls(**{f.name: np.stack([getattr(m, f.name) for m in models]) for f in fields(cls)})

    @classmethod
    def from_values(cls, names: Sequence[str], values: FloatArray) -> Fleet:
        """Build the models from coefficients.

        `values` (N, p): their values [SI].
        """
        stacked = cls.of([ImuModel()])
        n = len(values)
        out = cls(**{f.name: np.repeat(getattr(stacked, f.name), n, 0) for f in fields(cls)})
        for k, name in enumerate(names):
            block, where = coefficient_slot(name)
            at = where if isinstance(where, tuple) else (where,)
            getattr(out, block)[(slice(None), *at)] += values[:, k]
        return out

    @classmethod
    def draw(cls, grade_name: str, instruments: int, seed: int) -> Fleet:
        """Draw the errors of many instruments of a class, as `simulate.hand_rotated` does of one.

        `instruments`: number N of instruments [1]; `seed`: seed [1].
        """
        spread = grade(grade_name).spread
        sd = np.array([spread[name.rpartition(".")[0]] for name in LINEAR_LOWER])
        drawn = np.random.default_rng(seed).standard_normal((instruments, len(sd)))
        return cls.from_values(LINEAR_LOWER, sd * drawn)

    def model(self, i: int) -> ImuModel:
        """Return instrument `i`, shape () [1]."""
        return ImuModel(*(getattr(self, f.name)[i] for f in fields(self)))

    def values(self, names: Iterable[str]) -> FloatArray:
        """Return the named coefficients of all instruments, shape (N, p) [SI]."""
        identity = ImuModel()
        out = []
        for name in names:
            LAYOUT.index(name)
            block, where = coefficient_slot(name)
            at = where if isinstance(where, tuple) else (where,)
            stacked = getattr(self, block)[(slice(None), *at)]
            out.append(stacked - getattr(identity, block)[where])
        return np.stack(out, axis=1)

    def measure(self, f_b: FloatArray, w_ib_b: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute what the instruments say, without noise, shape (N, n, 3) each [SI].

        `f_b` (N, n, 3) or (1, n, 3): true specific force, frame b [m/s^2]; `w_ib_b` (N, n, 3) or
        (1, n, 3): true angular rate, frame b [rad/s].
        """
        sensed = f_b @ np.swapaxes(self.accel_matrix, 1, 2)
        accel = sensed + self.accel_bias[:, None]
        if self.accel_asymmetry.any():
            accel = accel + self.accel_asymmetry[:, None] * np.abs(sensed)
        if self.accel_quadratic.any():
            accel = accel + products(f_b) @ np.swapaxes(self.accel_quadratic, 1, 2)
        gyro = w_ib_b @ np.swapaxes(self.gyro_matrix, 1, 2)
        if self.deflection.any():
            gyro = gyro + felt(self.deflection, f_b, w_ib_b)
        if self.gyro_asymmetry.any() or self.gyro_cubic.any():
            gyro = readout(gyro, self.gyro_asymmetry[:, None], self.gyro_cubic[:, None])
        gyro = gyro + self.gyro_bias[:, None]
        if self.g_sensitivity.any():
            gyro = gyro + f_b @ np.swapaxes(self.g_sensitivity, 1, 2)
        return accel, gyro


@dataclass(frozen=True)
class SimulatedReadings:
    """Means that N instruments gave in the n positions of a plan, and the truth."""

    plan: TablePlan  # what the table was told
    fleet: Fleet  # true errors: of N instruments, or of the one that all of them are
    accel: FloatArray  # (N, n, 3) mean specific force as measured [m/s^2]
    gyro: FloatArray  # (N, n, 3) mean rate as measured [rad/s]
    # accel_variance, gyro_variance: (n,) variance of the noise of each axis of these means [SI]
    accel_variance: FloatArray
    gyro_variance: FloatArray
    # (N, n, 3) or (1, n, 3) true direction of up (rest) or of the outer axis (spin), body axes [1]
    direction: FloatArray
    # (N, n, 2) true errors of the middle and of the inner angle in each position [rad]
    position: FloatArray
    rate: FloatArray  # (N, n) true rate of the outer axis [rad/s]
    interval: float  # sample interval behind the means, 0 where none was assumed [s]

    def __len__(self) -> int:
        return len(self.accel)

    def readings(self, i: int) -> Readings:
        """Return what instrument `i`, shape () [1], gave, with the covariance of its noise."""
        plan = self.plan
        turns = np.round(np.abs(plan.rate) * plan.time / (2 * np.pi))
        start = np.concatenate([[0.0], np.cumsum(plan.time)[:-1]])
        eye = np.eye(3)
        return Readings(
            plan.angles, plan.rate, turns, start, plan.time, self.accel[i], self.gyro[i],
            self.accel_variance[:, None, None] * eye, self.gyro_variance[:, None, None] * eye,
            self.interval, declared=True,
        )  # fmt: skip


def simulate_readings(
    plan: TablePlan,
    *,
    models: Fleet | Sequence[ImuModel] | ImuModel,
    noise: ImuNoise,
    site: Site,
    rig: Rig | None = None,
    draws: int | None = None,
    interval: float = 0.0,
    seed: int = 0,
) -> SimulatedReadings:
    """Simulate the means that instruments give in the positions of a plan.

    `models`: errors of N instruments, or of one that is drawn again and again; `noise`: noise of
    the instruments [SI]; `site`: gravity, and latitude if the Earth's rotation is to be felt;
    `rig`: table and mounting, None for perfect ones; `draws`: number N of draws where there is
    one model, None for one per model [1]; `interval`: sample interval, which rounding needs, 0
    where unknown [s]; `seed`: seed of noise, position errors and rate jitter [1].
    """
    rig = rig or Rig()
    fleet = models if isinstance(models, Fleet) else Fleet.of(_listed(models))
    N = len(fleet) if draws is None else draws
    rng = np.random.default_rng(seed)
    position, rate = rig.draw(plan, N, rng)
    f_b, w_b, direction = _means(plan, rig, site, position, rate)
    accel, gyro = fleet.measure(f_b, w_b)
    variance = [mean_variance(n, plan.time, interval) for n in (noise.accel, noise.gyro)]
    shape = (N, len(plan), 3)
    silent = [n == type(n)() for n in (noise.accel, noise.gyro)]
    sd = [np.zeros_like(v) if s else np.sqrt(v) for v, s in zip(variance, silent, strict=True)]
    accel = accel + sd[0][:, None] * rng.standard_normal(shape)
    gyro = gyro + sd[1][:, None] * rng.standard_normal(shape)
    return SimulatedReadings(
        plan, fleet, accel, gyro, variance[0], variance[1], direction, position, rate, interval
    )


def _listed(models: Sequence[ImuModel] | ImuModel) -> Sequence[ImuModel]:
    return [models] if isinstance(models, ImuModel) else models


def _means(
    plan: TablePlan, rig: Rig, site: Site, position: FloatArray, rate: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return true mean specific force, rate, and up or the outer axis, body axes."""
    C_tk, outer_k = _attitudes(plan, rig, position)
    C_kb = np.swapaxes(rig.mounting_matrix, -1, -2)
    spin = plan.rate != 0.0
    o = np.where(spin[:, None], outer_k, C_tk[..., 2, :]) @ C_kb
    o_t = np.atleast_2d(rig.outer_t())
    w_t = np.zeros(3) if site.latitude is None else earth_rate_t(site.latitude, rig.heading)
    h = np.where(spin, rate + (o_t @ w_t)[:, None], 0.0)
    r = np.atleast_2d(rig.lever_arm)[:, None, :]
    across = r - np.sum(o * r, axis=2, keepdims=True) * o
    g = site.gravity * np.where(spin, o_t[:, 2:], 1.0)
    f_b = g[..., None] * o - (h**2)[..., None] * across
    at_rest = (np.swapaxes(C_tk, -1, -2) @ w_t) @ C_kb
    return f_b, np.where(spin[:, None], h[..., None] * o, at_rest), o


def _attitudes(plan: TablePlan, rig: Rig, position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return attitude and outer axis in case axes for every instrument, or for all at once."""
    n = len(plan)
    alike = rig.position_sd == 0.0 and rig.common.ndim == 1
    N = 1 if alike else len(position)
    common = np.broadcast_to(rig.common, (N, 6))
    # `chain` takes one value per row of angles just as well as one for all.
    errors = TableErrors(*np.repeat(common, n, axis=0).T)
    at = chain(np.tile(plan.angles, (N, 1)), errors, position[:N].reshape(-1, 2))
    return at.C_tk.reshape(N, n, 3, 3), at.outer_k.reshape(N, n, 3)
