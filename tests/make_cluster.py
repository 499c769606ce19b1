"""A torqued cluster with errors of every kind, for the tests of the tumble."""

from __future__ import annotations

import numpy as np

from foucault.coefficients import CoefficientVector
from foucault.models.cluster import CONSTANTS, ClusterModel

G = 9.80665
DEG_H = np.radians(1.0) / 3600
ARCSEC = np.radians(1.0) / 3600
UG = 1e-6 * G

SIZES = {
    "angular rate": DEG_H, "g-sensitivity": 0.5 * DEG_H / G,
    "g-squared sensitivity": 0.05 * DEG_H / G**2, "scale factor error": 4e-4,
    "misalignment": 120 * ARCSEC, "specific force": 100 * UG, "quadratic": 1e-4 / G,
}  # fmt: skip


def make_cluster(seed=1, size=1.0):
    """Return a cluster whose errors are drawn, of usual size times `size`."""
    drawn = np.random.default_rng(seed).standard_normal(len(CONSTANTS))
    scale = np.array([SIZES[c.kind] for c in CONSTANTS.coefficients])
    return ClusterModel.from_coefficients(CoefficientVector(CONSTANTS, size * scale * drawn))


def one_error(name, value):
    """Return a cluster with one error."""
    return ClusterModel.from_coefficients(
        CoefficientVector(CONSTANTS.subset([name]), np.array([value]))
    )
