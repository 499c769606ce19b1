"""Residuals that a fit has bent to: what is left of related neighbours."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2, norm

from foucault.infer.filtered import Whitened


def test_neighbours_are_judged_by_what_the_fit_leaves() -> None:
    """Right residuals of a fit with many smooth columns, mean and scatter two-sided at 1 %."""
    rng, (b, q, n), draws = np.random.default_rng(0), (120, 3, 40), 1500
    t = np.linspace(0.0, 1.0, b)
    slopes = 20 * np.cos(np.pi * np.arange(n) * t[:, None, None] + np.arange(q)[:, None])
    H = slopes.reshape(-1, n)
    cov = np.linalg.inv(H.T @ H + np.eye(n))
    z, plain = np.empty(draws), np.empty(draws)
    for i in range(draws):
        y = H @ rng.normal(size=n) + rng.normal(size=b * q)
        r = (y - H @ (cov @ H.T @ y)).reshape(b, q)
        total, mean, sd = Whitened(r, slopes, cov).neighbours()
        z[i], plain[i] = (total - mean) / sd, total / np.sqrt(q * (b - 1))
    away = norm.ppf(0.9975) / np.sqrt(draws)
    assert abs(z.mean()) < away < abs(plain.mean())  # not taken for what it leaves it is biased
    low, high = chi2.ppf([0.0025, 0.9975], draws - 1) / (draws - 1)
    assert low < z.var(ddof=1) < high


def test_related_residuals_are_found() -> None:
    rng = np.random.default_rng(1)
    e = rng.normal(size=(401, 3))
    r = (e[1:] + 0.3 * e[:-1]) / np.hypot(1, 0.3)
    total, mean, sd = Whitened(r, np.zeros((400, 3, 1)), np.eye(1)).neighbours()
    assert mean == 0.0 and (total - mean) / sd > 5.0
