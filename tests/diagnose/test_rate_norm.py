"""The sd of the norm of a compensated rate, against draws and against a single bias."""

from __future__ import annotations

import numpy as np

from foucault.coefficients import CoefficientVector
from foucault.diagnose.references import rate_norm_sd
from foucault.models.imu import LAYOUT, ImuModel

NAMES = tuple(
    n for n in LAYOUT.names if n.startswith(("gyro.bias", "gyro.scale", "gyro.mis", "gyro.g_sens"))
)


def test_noise_alone_is_carried_over_by_the_matrix():
    vector = CoefficientVector(LAYOUT.subset(NAMES), np.zeros(len(NAMES)))
    model = ImuModel(gyro_matrix=2.0 * np.eye(3))
    w = np.array([[0.1, 0.0, 0.0], [0.0, 0.06, 0.08]])
    cov = np.stack([np.diag([4.0, 9.0, 16.0])] * 2)
    expected = [2.0 / 2, np.sqrt(0.36 * 9 + 0.64 * 16) / 2]
    np.testing.assert_allclose(rate_norm_sd(model, vector, w, None, cov), expected, rtol=1e-12)


def test_sd_is_the_spread_of_norms_drawn_from_the_covariance():
    rng = np.random.default_rng(3)
    layout = LAYOUT.subset(NAMES)
    sd = np.array([1e-4 if "g_sens" not in n else 1e-5 for n in layout.names])
    mix = np.eye(len(layout)) + 0.3 * rng.normal(size=(len(layout),) * 2)
    cov = mix @ mix.T * np.outer(sd, sd)
    values = 10 * sd * rng.normal(size=len(layout))
    vector = CoefficientVector(layout, values, cov)
    model = ImuModel.from_coefficients(vector)
    f, gyro = np.array([[3.0, -4.0, 8.4]]), np.array([[0.1, 0.12, -0.05]])
    noise = 1e-4**2 * np.eye(3)[None]
    w = model.compensate(f, gyro)[1]
    found = rate_norm_sd(model, vector, w, f, noise)
    n = 4000
    draws = rng.multivariate_normal(values, cov, n)
    norms = [
        np.linalg.norm(
            ImuModel.from_coefficients(CoefficientVector(layout, d)).compensate(f, gyro + e)[1]
        )
        for d, e in zip(draws, 1e-4 * rng.normal(size=(n, 3)), strict=True)
    ]
    # The sd of 4000 draws is known to 1.1 %: 4 of its sd.
    np.testing.assert_allclose(np.std(norms), found[0], rtol=0.045)
