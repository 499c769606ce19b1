"""The information pass: compiled and as Python; the Gram matrix is that of its rows."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.kernels.cluster_information import COLUMNS, RESIDUAL, information_pass
from foucault.models.earth import earth_rate_n
from foucault.models.rotation import exp
from make_cluster import G, make_cluster


def arguments(steps=12, block=1, mean=False, delay=0.0, seed=0):
    rng = np.random.default_rng(seed)
    used = rng.random(steps) > 0.2
    rows = np.zeros((steps // block + 1, 3, COLUMNS))
    return [
        rng.uniform(0.1, 0.5, steps), rng.normal(0.0, 0.05, (steps, 3)),
        rng.normal(size=(steps, 3)), used, make_cluster(seed, 30.0).packed(G),
        rng.uniform(0.5, 2.0, 46), exp(rng.normal(size=3)),
        earth_rate_n(0.6), 1e-6, 1e-3, rng.normal(0.0, 0.1, (3, 3)), G, mean, block, rows,
        np.array([3, steps - 1]), delay,
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("block", "mean", "delay"), [(1, False, 0.0), (4, True, 0.0), (3, False, 0.02)]
)
def test_compiled_as_python(block, mean, delay):
    compiled, plain = arguments(12, block, mean, delay), arguments(12, block, mean, delay)
    for a, b in zip(information_pass(*compiled), information_pass.py_func(*plain), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(compiled[14], plain[14], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("steps", [7, 64, 200])
def test_gram_is_that_of_the_rows(steps):
    given = arguments(steps)
    out = information_pass(*given)
    rows = given[14][: len(out[9])].reshape(-1, COLUMNS)
    np.testing.assert_allclose(np.triu(out[0][0]), np.triu(rows.T @ rows), rtol=1e-10, atol=1e-9)
    assert len(out[9]) == given[3].sum()
    np.testing.assert_allclose(np.triu(out[5][-1]), np.triu(out[0][0]), rtol=1e-12)


def test_without_gyro_noise_nothing_is_filtered():
    """The rows are then plain sensitivities over the noise: linear in what one unit is."""
    given = arguments(20)
    given[8] = 0.0
    information_pass(*given)
    once = given[14].copy()
    again = arguments(20)
    again[8], again[5] = 0.0, 3.0 * given[5]
    information_pass(*again)
    np.testing.assert_allclose(again[14][..., :46], 3.0 * once[..., :46], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(again[14][..., RESIDUAL], once[..., RESIDUAL], rtol=1e-12)
