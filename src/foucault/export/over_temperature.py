"""Biases over temperature in the form of flight stacks: a cubic in the distance from a temperature.

    b(T) = k0 + k1 d + k2 d^2 + k3 d^3,    d = T - reference

A polynomial of order 3 or less is such a cubic whatever it is centred on, and nothing is lost. What
is of higher order, or straight from knot to knot, is fitted by least squares over the range of the
calibration; the largest residual is told, as the stacks compute it in single precision. Outside the
range there is nothing: the stacks hold the temperature at its ends. The constant goes into the
plain offset, which is that of the cubic at the reference temperature of the calibration. Scale
factors over temperature have no place: they stay at that temperature, and what they change over
the range is told at 1 g.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial
from numpy.polynomial.polynomial import polyfit

from foucault.arrays import FloatArray
from foucault.export.request import TemperatureTerms
from foucault.units import STANDARD_GRAVITY, ZERO_CELSIUS

ORDER = 3  # Highest power of the stacks [1].

_POINTS = 201  # temperatures at which cubic and functions are compared


@dataclass(frozen=True)
class Warmth:
    """Biases as the stacks have them."""

    # accel_bias, gyro_bias: (3,) at the reference temperature of the calibration [SI]
    accel_bias: FloatArray
    gyro_bias: FloatArray
    # accel.warm_1 ... gyro.warm_3 (3,) [SI per K^n]; warm.low, high, reference, calibrated [degC]
    values: Mapping[str, FloatArray]
    said: list[str]  # how well the form fits, line by line


def over_temperature(terms: TemperatureTerms, reference: float | None) -> Warmth:
    """Return biases over temperature as cubics.

    `terms`: the matrices as functions of temperature; `reference`: what powers count from, None
    takes the reference temperature of the calibration [degC].
    """
    f = terms.functions
    T = np.linspace(f.low, f.high, _POINTS)
    at = f.reference if reference is None else reference + ZERO_CELSIUS
    values = {
        f"warm.{name}": np.asarray(kelvin - ZERO_CELSIUS)
        for name, kelvin in (("low", f.low), ("high", f.high), ("reference", at),
                             ("calibrated", f.reference))
    }  # fmt: skip
    range_ = f"{f.low - ZERO_CELSIUS:.2f} to {f.high - ZERO_CELSIUS:.2f} degC"
    said, bias = [], {}
    for triad, unit in (("accel", "m/s^2"), ("gyro", "rad/s")):
        b = f.basis(T) @ terms.block(f"{triad}_bias")
        k = _cubic(T - at, b)
        bias[triad] = (f.reference - at) ** np.arange(ORDER + 1) @ k
        given = _as_computed(k, np.append(T, f.reference) - at)
        left = float(np.abs(given[:-1] - given[-1] + np.float32(bias[triad]) - b).max())
        values |= {f"{triad}.warm_{n}": k[n] for n in range(1, ORDER + 1)}
        said.append(
            f"Biases of the {triad} over temperature as cubics, {range_}: they differ from the "
            f"calibration by {left:.2g} {unit} at most in single precision; outside the stack "
            "holds the nearer end."
        )
    scale = np.einsum("tii->ti", np.tensordot(f.basis(T), terms.block("accel_matrix"), 1))
    here = np.einsum("ii->i", np.tensordot(f.basis(f.reference), terms.block("accel_matrix"), 1))
    change = STANDARD_GRAVITY * float(np.abs(scale - here).max())
    if change > 0:
        said.append(
            f"Scale factors of accelerometers over temperature have no place: they are those at "
            f"{f.reference - ZERO_CELSIUS:.2f} degC, which leaves {change:.2g} m/s^2 at 1 g."
        )
    return Warmth(bias["accel"], bias["gyro"], values, said)


def _as_computed(k: FloatArray, d: FloatArray) -> FloatArray:
    """Return cubics without their constant as the stacks compute them, in single precision.

    `k` (4, 3): by power [SI]; `d` (m,): distances in temperature [K]; returns (m, 3).
    """
    c, x = k.astype(np.float32), d.astype(np.float32)[:, None]
    return np.asarray(((c[3] * x + c[2]) * x + c[1]) * x, float)


def _cubic(d: FloatArray, b: FloatArray) -> FloatArray:
    """Return k (4, 3) of cubics through `b` (m, 3) at `d` (m,) [SI]."""
    # Fitted about the middle of the range: far from it the powers are nearly the same function.
    middle, half = (d.max() + d.min()) / 2, (d.max() - d.min()) / 2
    inner = Polynomial([-middle / half, 1 / half])
    axes = [Polynomial(polyfit((d - middle) / half, x, ORDER))(inner) for x in b.T]
    return np.array([np.resize(np.append(p.coef, np.zeros(4)), ORDER + 1) for p in axes]).T
