"""The information pass: compiled and as Python; the Gram matrix is that of its rows.

What answers changes of a log: against the matrices that it is, one change at a time.
"""

from __future__ import annotations

import numpy as np
import pytest

from foucault.kernels.cluster_information import COLUMNS, RESIDUAL, answer, information_pass
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
        np.array([3, steps - 1]), delay, np.zeros((steps // block + 2, 5, 3, 3)),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("block", "mean", "delay"), [(1, False, 0.0), (4, True, 0.0), (3, False, 0.02)]
)
def test_compiled_as_python(block, mean, delay):
    compiled, plain = arguments(12, block, mean, delay), arguments(12, block, mean, delay)
    for a, b in zip(information_pass(*compiled), information_pass.py_func(*plain), strict=True):
        size = np.abs(b)
        if b.shape[1:] == (48, 48):  # an entry rounds as the squares on the diagonal
            own = np.sqrt(np.einsum("nii->ni", b))
            size = own[:, :, None] * own[:, None]
        assert (np.abs(a - b) <= 1e-12 * (1.0 + size)).all()
    for k in (14, 17):
        np.testing.assert_allclose(compiled[k], plain[k], rtol=1e-12, atol=1e-12)


def test_without_room_for_gains_the_rest_is_the_same():
    given, without = arguments(30, 4), arguments(30, 4)
    without[17] = np.zeros((0, 5, 3, 3))
    out, other = information_pass(*given), information_pass(*without)
    for a, b in zip(out[:10], other[:10], strict=True):
        np.testing.assert_array_equal(a, b)
    assert len(other[10]) == 0


def test_a_step_ends_at_every_residual_where_nothing_is_read_for_long_and_at_the_end():
    given = arguments(20, 4, True)
    given[3][:] = True
    given[3][4:8] = False
    out = information_pass(*given)
    ends, gains = out[10], given[17][: len(out[10])]
    read = gains[:, 4, 0, 0] > 0
    assert read.tolist() == [True, False, True, True, True, False]
    np.testing.assert_allclose(ends[read], out[9])
    np.testing.assert_allclose(ends[[1, 5]], np.cumsum(given[0])[[7, 19]])
    assert not gains[~read, 2:].any() and gains[:, :2].any(axis=(1, 2, 3)).all()


def filtered(gains, turned, missed):
    """Return the white rows (m, 3) of one change, and what is left at the end (3,)."""
    b, rows = np.zeros(3), []
    for (F, A, H, K, L), da, dz in zip(gains, turned, missed, strict=True):
        b = b + F @ b - A @ da
        s = H @ b + dz
        b = b - K @ s
        if L[0, 0] > 0:
            root = np.tril(L, -1) + np.diag(1 / np.diag(L))
            rows.append(np.linalg.solve(root, s))
        else:
            rows.append(np.zeros(3))
    return np.array(rows), b


@pytest.mark.parametrize("form", ["compiled", "python"])
def test_changes_are_filtered_with_the_gains(form):
    given = arguments(40, 4, True)
    given[3][8:12] = False
    m = len(information_pass(*given)[10])
    gains, rng = given[17][:m], np.random.default_rng(1)
    read = gains[:, 4, 0, 0] > 0
    turned, missed = rng.normal(size=(2, m, 3, 5))
    missed[~read] = 0.0
    rows = missed.copy()
    b = (answer if form == "compiled" else answer.py_func)(gains, turned, rows)
    for j in range(5):
        white, left = filtered(gains, turned[:, :, j], missed[:, :, j])
        np.testing.assert_allclose(rows[:, :, j], white, rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(b[:, j], left, rtol=1e-10, atol=1e-10)


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
