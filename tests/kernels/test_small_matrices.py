"""Rows that share few causes are made white as by the factor of their whole covariance."""

from collections.abc import Callable

import numpy as np
import pytest

from foucault.kernels.small_matrices import decorrelate


@pytest.mark.parametrize("form", [decorrelate, decorrelate.py_func])
@pytest.mark.parametrize("k", [0, 1, 4])
def test_few_causes_are_taken_off_as_by_the_whole_matrix(form: Callable[..., None], k: int) -> None:
    rng = np.random.default_rng(k)
    u, x = 30 * rng.standard_normal((25, k)), rng.standard_normal((25, 7))
    white = np.linalg.solve(np.linalg.cholesky(np.eye(25) + u @ u.T), x)
    form(u, x)
    np.testing.assert_allclose(x, white, rtol=1e-9, atol=1e-11)


def test_causes_far_larger_than_the_noise_keep_its_digits() -> None:
    # Of two rows with one cause of size s the second leaves 1.25 - s^2 / (1 + s^2), of variance
    # (1 + 2 s^2) / (1 + s^2). The factor of the whole matrix keeps two of these digits.
    s, x = 1e7, np.array([[1.0], [1.25]])
    decorrelate(np.array([[s], [s]]), x)
    assert x[1, 0] == pytest.approx(0.25 / np.sqrt(2.0), rel=1e-8)
