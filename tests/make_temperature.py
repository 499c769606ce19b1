"""Calibrations at several temperatures, drawn from functions that are known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from foucault.coefficients import CoefficientVector
from foucault.models.temperature import TemperatureModel
from foucault.procedures.temperature import Session
from foucault.result import Result
from make_result import make_result

ZERO = 273.15
ROOM = ZERO + 25.0
SPAN = 40.0  # [K], half of the range

# change of each family over SPAN: linear, quadratic and cubic part, in sd of its calibrations
TERMS: Mapping[str, tuple[float, ...]] = {
    "accel.bias": (60.0, -25.0), "accel.scale": (-50.0,), "gyro.bias": (90.0, 40.0),
    "gyro.scale": (45.0,),
}  # fmt: skip


def truth(
    terms: Mapping[str, tuple[float, ...]] = TERMS, seed: int = 7
) -> tuple[TemperatureModel, Result]:
    """Return functions that are known, and a result with the covariance of one calibration."""
    start = make_result(seed)
    vector = replace(start.coefficients, prior_sd=np.full(len(start.coefficients), np.inf))
    weights = np.zeros((len(vector), 4))
    weights[:, 0] = vector.values
    rng = np.random.default_rng(seed)
    for i, name in enumerate(vector.names):
        for k, size in enumerate(terms.get(name.rpartition(".")[0], ()), start=1):
            weights[i, k] = size * vector.sd[i] * rng.uniform(0.7, 1.3) / SPAN**k
    n = len(vector)
    model = TemperatureModel(vector.layout, weights, np.zeros((4 * n, 4 * n)), ROOM,
                             ROOM - SPAN, ROOM + SPAN)  # fmt: skip
    return model, replace(start, coefficients=vector)


_usual = cache(truth)  # nothing changes what it returns


def sessions(
    temperatures: Sequence[float], seed: int = 1, *, model: TemperatureModel | None = None,
    scatter: Mapping[str, float] | None = None, noise: float = 1.0,
) -> list[Session]:  # fmt: skip
    """Return calibrations at temperatures [degC]; `scatter` is in sd of a calibration."""
    known, template = _usual()
    model = model or known
    rng = np.random.default_rng([seed, 11])
    vector = template.coefficients
    root = np.linalg.cholesky(vector.cov)
    own = np.array([(scatter or {}).get(n.rpartition(".")[0], 0.0) for n in vector.names])
    own = own * typical(vector)
    out = []
    for k, degrees in enumerate(temperatures):
        T = ZERO + degrees
        values = model.values(T) + noise * root @ rng.normal(size=len(vector))
        values = values + own * rng.normal(size=len(vector))
        validity = {"temperature": [T - 0.4, T + 0.3], "temperature_mean": T,
                    "accel": [-12.0, 12.0], "gyro": [-4.0, 4.0]}  # fmt: skip
        log = {"file": f"run{k}.csv", "sha256": f"{seed:032x}{k:032x}"}
        result = replace(template, coefficients=replace(vector, values=values), validity=validity,
                         tables={}, provenance=template.provenance | {"inputs": [log]})  # fmt: skip
        out.append(Session.of(f"run{k}", result))
    return out


def typical(vector: CoefficientVector) -> np.ndarray:
    """Return the root mean square sd of the family of each coefficient."""
    families = [n.rpartition(".")[0] for n in vector.names]
    mean = {f: np.sqrt(np.mean([s**2 for s, g in zip(vector.sd, families, strict=True) if g == f]))
            for f in families}  # fmt: skip
    return np.array([mean[f] for f in families])
