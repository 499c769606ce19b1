"""Kernels of the Allan variances, compiled and as plain Python, against their definitions."""

from __future__ import annotations

import math

import numpy as np
import pytest

from foucault.kernels import allan

FORMS = pytest.mark.parametrize("form", ["compiled", "python"])
M = np.array([1, 2, 3, 7, 40])


def _form(kernel, form):
    return kernel if form == "compiled" else kernel.py_func


def _third_differences(x, m):
    return [x[i + 3 * m] - 3 * x[i + 2 * m] + 3 * x[i + m] - x[i] for i in range(len(x) - 3 * m)]


def _second_differences(x, m):
    return [x[i + 2 * m] - 2 * x[i + m] + x[i] for i in range(len(x) - 2 * m)]


def _means(d, m):
    return [np.mean(d[i : i + m]) for i in range(len(d) - m + 1)]


DEFINITIONS = {
    "overlapping": _second_differences,
    "hadamard": _third_differences,
    "modified": lambda x, m: _means(_second_differences(x, m), m),
}


@FORMS
@pytest.mark.parametrize("kind", DEFINITIONS)
def test_mean_squares_are_those_of_the_definition(form, kind):
    x = np.random.default_rng(1).normal(size=200).cumsum()
    got = _form(getattr(allan, kind), form)(x, M)
    want = [np.mean(np.square(DEFINITIONS[kind](x, m))) for m in M]
    np.testing.assert_allclose(got, want, rtol=1e-12)


@FORMS
def test_phase_is_the_sum(form):
    y = np.random.default_rng(2).normal(size=2000) * 10.0 ** np.arange(2000).clip(0, 8)
    got = np.full(2001, np.nan)
    _form(allan.integrate, form)(y, 0.5, got)
    want = [math.fsum(y[:k] - 0.5) for k in range(2001)]
    # Half a spacing of the largest sum per step.
    np.testing.assert_allclose(got, want, rtol=0, atol=2000 * np.spacing(np.abs(want).max()) / 2)


@pytest.mark.parametrize("kind", DEFINITIONS)
def test_blocks_join_without_a_seam(kind):
    # Longer than every block, and not a multiple of one.
    x = np.random.default_rng(3).normal(size=100_003).cumsum()
    m = np.array([1, 1000, 5000])
    for each, got in zip(m, getattr(allan, kind)(x, m), strict=True):
        d = x[2 * each :] - 2 * x[each:-each] + x[: -2 * each]
        if kind == "hadamard":
            d = d[each:] - d[:-each]
        if kind == "modified":
            sums = np.concatenate([[0.0], np.cumsum(d)])
            d = (sums[each:] - sums[:-each]) / each
        assert got == pytest.approx(np.mean(d**2), rel=1e-9)


@pytest.mark.parametrize("kind", DEFINITIONS)
def test_a_nan_is_handed_on(kind):
    x = np.ones(300)
    x[150] = np.nan
    assert np.isnan(getattr(allan, kind)(x, M)).all()
