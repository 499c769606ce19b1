"""Coefficients that change with temperature, each a function of it.

Every coefficient c_i is a sum of functions of the temperature T that all of them share::

    c_i(T) = sum over k of w_ik phi_k(T)

    polynomial:        phi_k(T) = (T - T0)^k,                       w_ik [unit of c_i / K^k]
    piecewise linear:  phi_k(T) = 1 at knot k, 0 at every other,    w_ik [unit of c_i]

and a straight line from knot to knot. A coefficient that does not change has w_ik = 0 for k > 0,
or the same w_ik at all knots. The covariance is that of all w_ik together.

The functions hold from `low` to `high`, the temperatures they were found at. Nothing is said
beyond: a polynomial is worth nothing there.

`scatter` is how far a coefficient is from its function each time the instrument is measured anew
(repeatability from one switch-on to the next). The covariance of the functions does not contain
it: it does not shrink however many sessions there are.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector, Layout
from foucault.errors import FoucaultError, error
from foucault.models.imu import ImuModel
from foucault.models.layouts import of_one_sample
from foucault.models.size_effect import SizeEffect
from foucault.tables import Log
from foucault.units import ZERO_CELSIUS

KELVIN_IN_CELSIUS = 150.0
"""No inertial instrument works above this temperature; kelvin read as degC do [degC]."""

SAME = 1e-6
"""Temperatures closer than this are the same but for rounding [K]."""


@dataclass(frozen=True)
class TemperatureModel:
    """Coefficients as functions of temperature."""

    layout: Layout
    # (n, p) w_ik of the equation above [SI unit of the coefficient, per K^k of a polynomial]
    weights: FloatArray
    # (n p, n p) covariance of the weights, those of a coefficient side by side [products of their
    # units]
    cov: FloatArray
    reference: float  # t0, at which a polynomial is its first weight [K]
    # low, high: where the functions hold [K]
    low: float
    high: float
    # (p,) or (0,) knots of functions that are piecewise linear; none of polynomials [K]
    knots: FloatArray = field(default_factory=lambda: np.zeros(0))
    # (n,) standard deviation of each coefficient about its function, from one session to the next;
    # NaN where the sessions do not tell [SI unit]
    scatter: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if self.scatter.size == 0:
            object.__setattr__(self, "scatter", np.zeros(len(self.layout)))

    @property
    def kind(self) -> str:
        """The kind of function: "polynomial" or "piecewise linear"."""
        return "piecewise linear" if self.knots.size else "polynomial"

    def basis(self, temperature: FloatArray | float) -> FloatArray:
        """Return phi_k(T), shape (..., p) [K^k of a polynomial, 1 of piecewise linear functions].

        `temperature` (...,): temperature [K].
        """
        return basis(temperature, self.weights.shape[1], self.reference, self.knots)

    def values(self, temperature: FloatArray | float) -> FloatArray:
        """Return the coefficients, shape (..., n) [SI unit of each].

        `temperature` (...,): temperature [K].
        """
        return np.asarray(self.basis(temperature) @ self.weights.T)

    def sd(self, temperature: FloatArray, *, scatter: bool = False) -> FloatArray:
        """Return the standard deviations of the functions, shape (m, n) [SI unit of each].

        `temperature` (m,): temperature [K]; `scatter`: add the scatter: what to expect of the
        instrument when it is next switched on.
        """
        n, p = self.weights.shape
        blocks = np.einsum("kakb->kab", self.cov.reshape(n, p, n, p))
        phi = self.basis(temperature)
        variance = np.einsum("ma,kab,mb->mk", phi, blocks, phi)
        if scatter:
            variance = variance + np.nan_to_num(self.scatter) ** 2
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def at(self, temperature: float) -> CoefficientVector:
        """Return the coefficients at one temperature, with the covariance of the functions.

        `temperature`: temperature within the range of validity [K].
        """
        if not self.low - SAME <= temperature <= self.high + SAME:
            raise error("temperature.asked_outside", given=_celsius(temperature),
                        low=_celsius(self.low), high=_celsius(self.high))  # fmt: skip
        n, p = self.weights.shape
        phi = self.basis(temperature)
        cov = np.einsum("iajb,a,b->ij", self.cov.reshape(n, p, n, p), phi, phi)
        free = np.diag(cov) > 0
        return CoefficientVector(self.layout, self.values(temperature), (cov + cov.T) / 2, free)

    def varying(self) -> tuple[str, ...]:
        """Return the names of the coefficients that change with temperature."""
        first = self.weights[:, :1] if self.knots.size else 0.0 * self.weights[:, :1]
        rest = self.weights if self.knots.size else self.weights[:, 1:]
        moved = (rest != first).any(axis=1)
        return tuple(n for n, m in zip(self.layout.names, moved, strict=True) if m)

    # -- on a log --------------------------------------------------------------------------------

    def apply(self, log: Log) -> Log:
        """Return the log without the errors that the instrument had at each sample's temperature.

        `log`: readings with their temperature, all of it within the range of validity [SI].
        """
        self.refuse_outside(log)
        assert log.temperature is not None
        vector = self.constant()
        size = SizeEffect.of(vector)
        names = of_one_sample(vector).names
        at = [self.layout.index(name) for name in names]
        model = ImuModel.of_samples(names, self.values(self.held(log.temperature))[:, at])
        return size.apply(model, log)

    def constant(self) -> CoefficientVector:
        """Return the coefficients at T0 without covariance, which is all that some ever are."""
        return CoefficientVector(self.layout, self.values(self.reference))

    def held(self, temperature: FloatArray) -> FloatArray:
        """Return temperatures, shape (m,) [K], with those outside at the nearer end of the range.

        `temperature` (m,): temperature [K].
        """
        return np.clip(temperature, self.low, self.high)

    def outside(self, temperature: FloatArray) -> npt.NDArray[np.bool_]:
        """Return where the functions do not hold, shape (m,).

        `temperature` (m,): temperature [K].
        """
        inside = (temperature >= self.low - SAME) & (temperature <= self.high + SAME)
        return np.asarray(~inside)  # what is no number is outside

    def refuse_outside(self, log: Log, first: int = 0) -> None:
        """Raise where a log has no temperature, or one that the functions do not hold at.

        `log`: the log [SI]; `first`: number of its first row, where it is a part of another [1].
        """
        file = log.source.get("file", "The log")
        if log.temperature is None:
            raise error("temperature.unlogged", file=file, low=_celsius(self.low),
                        high=_celsius(self.high))  # fmt: skip
        rows = np.flatnonzero(self.outside(log.temperature))
        if rows.size:
            raise self._outside(file, log, int(rows[0]), first, rows.size)

    def _outside(self, file: str, log: Log, row: int, first: int, count: int) -> FoucaultError:
        assert log.temperature is not None
        given = float(log.temperature[row])
        # Only the wrong unit takes a room, or a whole oven, so far away.
        hint = ""
        if given - ZERO_CELSIUS > KELVIN_IN_CELSIUS:
            hint = f" Kelvin said to be degC look like this: is it {given - 2 * ZERO_CELSIUS:.1f}?"
        elif given < KELVIN_IN_CELSIUS:
            hint = f" Degrees Celsius said to be K look like this: is it {given:.1f} degC?"
        return error("temperature.outside", file=file, row=first + row, time=f"{log.time[row]:.3f}",
                     given=_celsius(given), low=_celsius(self.low), high=_celsius(self.high),
                     count=count, hint=hint)  # fmt: skip


def basis(
    temperature: FloatArray | float, terms: int, reference: float, knots: FloatArray
) -> FloatArray:
    """Return phi_k(T), shape (..., p) [K^k of a polynomial, 1 of piecewise linear functions].

    `temperature` (...,): temperature [K]; `terms`: p of a polynomial [1]; `reference`: t0 of a
    polynomial [K]; `knots` (p,) or (0,): knots in rising order, none for a polynomial [K].
    """
    T = np.asarray(temperature, float)
    if not knots.size:
        return np.asarray((T - reference)[..., None] ** np.arange(terms))
    at = np.clip(np.searchsorted(knots, T, side="right") - 1, 0, knots.size - 2)
    part = (T - knots[at]) / (knots[at + 1] - knots[at])
    out = np.zeros((*T.shape, knots.size))
    np.put_along_axis(out, at[..., None], (1.0 - part)[..., None], axis=-1)
    np.put_along_axis(out, at[..., None] + 1, part[..., None], axis=-1)
    return out


def without(model: TemperatureModel, names: tuple[str, ...]) -> TemperatureModel:
    """Return the model with the coefficients `names` at zero."""
    weights = model.weights.copy()
    for name in names:
        weights[model.layout.index(name)] = 0.0
    return replace(model, weights=weights)


def _celsius(kelvin: float) -> str:
    return f"{kelvin - ZERO_CELSIUS:.2f}"
