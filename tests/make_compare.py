"""Calibrations of one instrument or several at several dates, with errors of known covariance."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from foucault.coefficients import CoefficientVector
from foucault.diagnose.comparable import Entry, Series
from foucault.diagnose.compare import YEAR
from foucault.result import Result
from make_result import make_result

START = 1.7e9
"""Time of the first result, in November 2023 [s]."""


def make_series(n: int, names: tuple[str, ...], seed: int, cov: np.ndarray | None = None) -> Series:
    """Return results of an instrument that stays the same, with errors that are correlated."""
    rng, p = np.random.default_rng(seed), len(names)
    if cov is None:
        mixing = rng.normal(size=(n, p, p)) + 2 * np.eye(p)
        sd = np.exp(rng.uniform(-14, -7, p))
        cov = mixing @ mixing.swapaxes(1, 2) * np.outer(sd, sd)
    moved = np.einsum("nij,nj->ni", np.linalg.cholesky(cov), rng.normal(size=(n, p)))
    time = START + YEAR * np.arange(n)
    return Series(names, time, 0.02 + moved, cov, np.zeros((n, p, 0)))


def make_results(n: int = 4, seed: int = 3, **changes: Any) -> list[Result]:
    """Return calibrations of one instrument that does not change; no two of one log."""
    plain = make_result(**changes)
    vector = plain.coefficients
    rng = np.random.default_rng(seed)
    assert vector.cov is not None
    root = np.linalg.cholesky(vector.cov)
    out = []
    for i in range(n):
        moved = vector.values + root @ rng.normal(size=len(vector))
        values = CoefficientVector(vector.layout, moved, vector.cov, vector.free)
        made = plain.provenance | {
            "inputs": [{"file": f"{i}.csv", "sha256": f"{seed:04d}{i:04d}" * 8}],
            "created": f"{2024 + i}-03-14T09:00:00+00:00",
        }
        out.append(dataclasses.replace(plain, coefficients=values, provenance=made))
    return out


def moved(result: Result, **changes: float) -> Result:
    """Return a result with coefficients moved by so many sd; dots are written as __."""
    vector = result.coefficients
    values = {
        (name := key.replace("__", ".")): vector.value(name)
        + size * float(vector.sd[vector.layout.index(name)])
        for key, size in changes.items()
    }
    return dataclasses.replace(result, coefficients=vector.with_values(values))


def make_entries(results: list[Result], instrument: str = "IMU 7") -> list[Entry]:
    """Return results as entries a year apart."""
    return [
        Entry(f"run {i}", r, instrument, START + i * YEAR, "given", f"{instrument} {i}")
        for i, r in enumerate(results)
    ]
