"""What sessions and ramps say of coefficients and their change with temperature.

A **session** is a calibration: its coefficients with their covariance, at its mean temperature.

A **ramp** is a log of the instrument at rest in one position while its temperature changes. The
means over short parts of it say ``reading = constant + H (c(T) - c(T0))`` along each sensor, with H
the derivative of the reading by the coefficients at the specific force of that position. The
constant holds the Earth's rate, gravity, and whatever of the coefficients does not change, and is
of no interest: no attitude is needed, and no level of a bias is found, only its change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector, Layout
from foucault.errors import error
from foucault.estimate.temperature.fit import Evidence
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.layouts import is_imu, of_sensors
from foucault.models.temperature import KELVIN_IN_CELSIUS
from foucault.result import Level, Result
from foucault.tables import Log
from foucault.units import ZERO_CELSIUS

PART = 60.0
"""Means of a ramp are over about this long [s]."""

PARTS = (12, 80)
"""No fewer and no more means than this in a ramp [1]."""

SPAN = 2.0
"""A log whose temperature changes by less is no ramp [K]."""

TILTED = 0.5
"""Means of accelerometers that change by more are those of an instrument that was turned [m/s^2].
"""

MOVED = 8.0
"""A part of a ramp that is so many times as noisy as the quietest quarter was no rest [1]."""

SENSORS = ("gyro", "accel")


@dataclass(frozen=True)
class Session:
    """One calibration and its temperature.

    Attributes
    ----------
    name : str
        How to call it.
    result : Result
        The calibration [SI].
    temperature : float
        Mean over the session [K].
    low, high : float
        Lowest and highest in the session [K].
    """

    name: str
    result: Result
    temperature: float
    low: float
    high: float

    @classmethod
    def of(cls, name: str, result: Result, declared: float | None = None) -> Session:
        """Take the temperature from the log of the session, or as declared.

        Parameters
        ----------
        name : str
            How to call it.
        result : Result
            The calibration [SI].
        declared : float or None
            Temperature of the session, where its log has none or says it wrongly [K].
        """
        _suits(name, result)
        if declared is not None:
            plausible(declared, name)
            return cls(name, result, declared, declared, declared)
        span = result.validity.get("temperature")
        if not span or None in span:
            raise error("temperature.unknown", name=name)
        low, high = float(span[0]), float(span[1])
        mean = result.validity.get("temperature_mean")
        # A mean of equal numbers may be off by a bit.
        middle = 0.5 * (low + high) if mean is None else min(max(float(mean), low), high)
        for value in (low, high):
            plausible(value, name)
        return cls(name, result, middle, low, high)

    @property
    def vector(self) -> CoefficientVector:
        """The errors of the sensors."""
        return of_sensors(self.result.coefficients)

    @property
    def dead(self) -> bool:
        """Whether the sensor of temperature never moved in the whole session."""
        measured = self.result.validity.get("temperature_mean") is not None
        return measured and self.low == self.high


@dataclass(frozen=True)
class Ramp:
    """Means over parts of a log at rest whose temperature changes."""

    name: str  # how to call it
    temperature: FloatArray  # (k,) mean of each part [K]
    rising: FloatArray  # (k,) 1 where the temperature rises, -1 where it falls [1]
    readings: FloatArray  # (k, s) means of the sensors: gyros [rad/s], then accelerometers [m/s^2]
    variance: FloatArray  # (k, s) variance of the means by the noise of the samples [unit^2]
    triads: tuple[str, ...]  # which triads the log has
    # low, high: lowest and highest temperature [K]
    low: float
    high: float

    @classmethod
    def of(cls, name: str, log: Log) -> Ramp:
        """Take the means of a log.

        `log`: the instrument at rest in one position [SI].
        """
        T = log.temperature
        if T is None:
            raise error("temperature.no_column", file=name)
        low, high = float(T.min()), float(T.max())
        plausible(low, name)
        plausible(high, name)
        if high - low < SPAN:
            raise error("temperature.no_ramp", name=name, change=f"{high - low:.2f}",
                        least=f"{SPAN:g}")  # fmt: skip
        triads = tuple(t for t in SENSORS if getattr(log, t) is not None)
        data = np.concatenate([getattr(log, t) for t in triads], axis=1)
        count = int(np.clip(round(log.duration / PART), *PARTS))
        cuts = np.linspace(0, len(log), count + 1).astype(int)
        if np.diff(cuts).min() < 2:
            raise error("temperature.short_ramp", name=name, samples=len(log), least=2 * count)
        parts = [slice(a, b) for a, b in pairwise(cuts)]
        means = np.array([data[p].mean(axis=0) for p in parts])
        # Differences of neighbours: the ramp itself is no noise.
        spread = np.array([(np.diff(data[p], axis=0) ** 2).mean(axis=0) / 2 for p in parts])
        _at_rest(name, spread, means[:, 3 * triads.index("accel") :][:, :3] if "accel" in triads
                 else means[:, :0], log.time[cuts[:-1]])  # fmt: skip
        middle = np.array([T[p].mean() for p in parts])
        rising = np.where(np.gradient(middle) >= 0, 1.0, -1.0)
        variance = spread / np.diff(cuts)[:, None]
        # A sensor of few bits repeats itself: the rounding is uncertain all the same.
        variance = np.maximum(variance, 1e-6 * np.median(variance, axis=0) + 1e-30)
        return cls(name, middle, rising, means, variance, triads, low, high)

    def derivative(self, layout: Layout) -> FloatArray:
        """Return the derivative of the readings by the coefficients, shape (s, n) [SI]."""
        force = np.zeros(3)
        if "accel" in self.triads:
            at = 3 * self.triads.index("accel")
            force = self.readings[:, at : at + 3].mean(axis=0)
        out = np.zeros((3 * len(self.triads), len(layout)))
        still = dict(zip(("accel", "gyro"), ImuModel().measure(force, np.zeros(3)), strict=True))
        for i, name in enumerate(layout.names):
            if name not in LAYOUT:
                continue  # lever arms and delay: nothing turns
            one = ImuModel.from_coefficients(CoefficientVector(layout.subset([name]), np.ones(1)))
            said = dict(zip(("accel", "gyro"), one.measure(force, np.zeros(3)), strict=True))
            out[:, i] = np.concatenate([said[t] - still[t] for t in self.triads])
        return out


def plausible(temperature: float, name: str) -> None:
    """Refuse what no instrument has: kelvin said to be degC, or the other way round.

    `temperature`: a temperature of a log [K].
    """
    if not ZERO_CELSIUS - KELVIN_IN_CELSIUS <= temperature <= ZERO_CELSIUS + KELVIN_IN_CELSIUS:
        said = f"{temperature - ZERO_CELSIUS:.1f}"
        raise error("temperature.implausible", name=name, given=said, kelvin=f"{temperature:.1f}")


def of_sessions(
    sessions: Sequence[Session], layout: Layout, unit: FloatArray, basis: FloatArray,
    family: npt.NDArray[np.int64], constants: int,
) -> list[Evidence]:  # fmt: skip
    """Return what sessions say, in units of `unit`.

    `unit` (n,): a typical uncertainty of each [SI]; `basis` (m, b): functions of temperature of
    each session [any]; `family` (n,): the family of each coefficient [1]; `constants`: how many
    constants there are besides the coefficients [1].
    """
    out = []
    for session, phi in zip(sessions, basis, strict=True):
        vector = session.vector
        keep = np.flatnonzero(vector.free)
        at = np.array([layout.index(vector.names[i]) for i in keep], np.int64)
        assert vector.cov is not None
        H = np.zeros((len(keep), len(layout) + constants))
        H[np.arange(len(keep)), at] = 1.0
        cov = vector.cov[np.ix_(keep, keep)] / np.outer(unit[at], unit[at])
        out.append(Evidence(phi, vector.values[keep] / unit[at], cov, H, family[at]))
    return out


def of_ramps(
    ramps: Sequence[Ramp], layout: Layout, unit: FloatArray, basis: Sequence[FloatArray],
    groups: int,
) -> list[Evidence]:  # fmt: skip
    """Return what ramps say, each sensor in units of its own noise.

    `unit` (n,): a typical uncertainty of each [SI]; `basis` (k, b): functions of temperature of
    each part of each ramp [any]; `groups`: number of the group of the gyros, that of the
    accelerometers follows [1].
    """
    constants = sum(r.readings.shape[1] for r in ramps)
    out, first = [], len(layout)
    for ramp, functions in zip(ramps, basis, strict=True):
        s = ramp.readings.shape[1]
        size = np.sqrt(ramp.variance.mean(axis=0))
        H = np.zeros((s, len(layout) + constants))
        H[:, : len(layout)] = ramp.derivative(layout) * unit / size[:, None]
        H[np.arange(s), first + np.arange(s)] = 1.0
        first += s
        group = np.repeat([groups + SENSORS.index(t) for t in ramp.triads], 3)
        for k, phi in enumerate(functions):
            cov = np.diag(ramp.variance[k] / size**2)
            out.append(
                Evidence(phi, (ramp.readings[k] - ramp.readings.mean(axis=0)) / size, cov, H, group)
            )
    return out


def _suits(name: str, result: Result) -> None:
    """Refuse a result that cannot be taken."""
    if not is_imu(result.coefficients) or not len(of_sensors(result.coefficients)):
        raise error("temperature.not_imu", name=name, procedure=result.procedure)
    if result.temperature is not None:
        raise error("temperature.twice", name=name)
    if result.verdict.level is Level.UNUSABLE:
        reasons = " ".join(result.verdict.reasons) or "No reason is given."
        raise error("temperature.unusable", name=name, reasons=reasons)
    vector = of_sensors(result.coefficients)
    sd = vector.sd[vector.free]
    if not (np.isfinite(vector.values).all() and np.isfinite(sd).all() and (sd > 0).all()):
        raise error("temperature.no_covariance", name=name)


def _at_rest(name: str, spread: FloatArray, accel: FloatArray, start: FloatArray) -> None:
    """Refuse a ramp during which the instrument was moved."""
    turned = np.abs(accel - accel[:1]).max(axis=1, initial=0.0)
    if turned.max() > TILTED:
        when = start[int(np.argmax(turned > TILTED))]
        raise error("temperature.turned", name=name, time=f"{when:.0f}",
                    change=f"{turned.max():.2f}")  # fmt: skip
    quiet = np.quantile(spread, 0.25, axis=0)
    noisy = np.sqrt(spread / np.maximum(quiet, 1e-300)).max(axis=1)
    if noisy.max() > MOVED and (quiet > 0).any():
        raise error("temperature.moved", name=name, time=f"{start[int(np.argmax(noisy))]:.0f}",
                    ratio=f"{noisy.max():.0f}")  # fmt: skip
