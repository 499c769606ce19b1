"""Results with chosen terms, larger than any real instrument's, for tests of what applies them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from foucault.coefficients import CoefficientVector
from foucault.export.densities import Densities
from foucault.export.request import ALL, family
from foucault.models.imu import LINEAR_LOWER
from foucault.models.temperature import TemperatureModel
from foucault.result import Result
from make_result import make_result

Same = Callable[[Any, Any], None]
Readings = tuple[np.ndarray, np.ndarray]

SIZES = {
    "accel.bias": 0.3, "accel.scale": 0.02, "accel.misalignment": 0.01,
    "accel.quadratic": 3e-4, "accel.cross": 2e-4,
    "gyro.bias": 0.02, "gyro.scale": 0.02, "gyro.misalignment": 0.01,
    "gyro.g_sensitivity": 2e-4, "gyro.asymmetry": 0.01, "gyro.cubic": 1e-4,
    "accel.asymmetry": 0.01, "gyro.deflection": 2e-4, "accel.lever": 0.05, "accel.delay": 3e-3,
}  # fmt: skip
"""Large, so that a wrong sign or transpose shows [SI]."""


LOUD = Densities(
    {
        f"{one}{triad}.{name}": np.asarray(value if one else value * np.array([1.0, 0.8, 0.9]))
        for one in ("", "one:")
        for triad, name, value in (
            ("accel", "white", 2e-3), ("accel", "walk", 3e-5),
            ("gyro", "white", 1.7e-4), ("gyro", "walk", 2e-6),
        )
    },
    ("Noise: made up.",),
    200.0,
    100.0,
)  # fmt: skip
"""Noise for estimators, as of an Allan run at 200 Hz."""


def with_terms(*families: str, seed: int = 5, **changes: Any) -> Result:
    """Return a result with random coefficients of these families."""
    rng = np.random.default_rng(seed)
    names = [
        n
        for n in ALL.names
        if family(n) in families and (n in LINEAR_LOWER or not n.startswith("accel.misalignment"))
    ]
    values = np.array([SIZES[family(n)] * rng.uniform(0.3, 1) for n in names])
    values *= rng.choice([-1.0, 1.0], len(values))
    root = rng.normal(size=(len(names), len(names)))
    cov = root @ root.T * np.outer(values, values) * 1e-4
    vector = CoefficientVector(ALL.subset(names), values, (cov + cov.T) / 2)
    return replace(make_result(**changes), coefficients=vector, tables={})


LOW, HIGH, T0 = 250.0, 340.0, 300.0


def a_model(*families: str, knots: tuple[float, ...] = (), seed: int = 4) -> TemperatureModel:
    """Return a model of which every coefficient of these families changes by about its size."""
    vector = with_terms(*(families or SIZES)).coefficients
    rng = np.random.default_rng(seed)
    if knots:
        weights = vector.values[:, None] * rng.uniform(0.5, 1.5, (len(vector), len(knots)))
    else:
        size = np.array([1.0, 1 / 60, 1 / 60**2])
        weights = vector.values[:, None] * size * rng.uniform(0.3, 0.8, (len(vector), 3))
    for i, name in enumerate(vector.names):
        if name.startswith(("accel.lever", "accel.delay")):
            weights[i] = weights[i, 0] * (1.0 if knots else np.eye(3)[0])
    root = rng.normal(size=(weights.size, weights.size)) * np.abs(weights).ravel()[:, None] * 1e-3
    cov = root @ root.T
    cov = (cov + cov.T) / 2
    return TemperatureModel(vector.layout, weights, cov, T0, LOW, HIGH, np.array(knots))
