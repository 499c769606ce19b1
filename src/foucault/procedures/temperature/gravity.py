"""Local gravity that all sessions were given: its error is one, however many sessions there are.

It is taken out of the covariance of every session before functions are fitted, and put back into
that of their constant part: functions that fit sessions all wrong by L are wrong by L themselves,
at every temperature.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.compare.gravity import Site, gravity_errors
from foucault.estimate.fusion import at_most
from foucault.models.temperature import TemperatureModel
from foucault.procedures.temperature.evidence import Session

Common = dict[Site, dict[str, float]]
"""Site -> coefficient -> its error per standard deviation of gravity [SI]."""


def taken_out(sessions: Sequence[Session]) -> tuple[list[Session], Common]:
    """Take what all sessions owe to the same gravity out of their covariances.

    Returns the same with covariances of what is their own; unchanged where nothing is common;
    what was taken out, the mean over the sessions [SI].
    """
    vectors = [s.result.coefficients for s in sessions]
    errors = [gravity_errors(s.result, v) for s, v in zip(sessions, vectors, strict=True)]
    sites = [site for site in errors[0] if all(site in one for one in errors)]
    if len(sessions) < 2 or not sites or any(v.cov is None for v in vectors):
        return list(sessions), {}
    shared = [
        _shared(v, np.stack([one[site] for site in sites], axis=1))
        for v, one in zip(vectors, errors, strict=True)
    ]
    alone = [
        replace(s, result=replace(s.result, coefficients=replace(v, cov=v.cov - L @ L.T)))
        for s, v, L in zip(sessions, vectors, shared, strict=True)
        if v.cov is not None
    ]
    common: Common = {}
    for k, site in enumerate(sites):
        said: dict[str, list[float]] = {}
        for vector, L in zip(vectors, shared, strict=True):
            for name, value in zip(vector.names, L[:, k].tolist(), strict=True):
                said.setdefault(name, []).append(value)
        common[site] = {name: float(np.mean(values)) for name, values in said.items()}
    return alone, common


def _shared(vector: CoefficientVector, L: FloatArray) -> FloatArray:
    """Return errors that are part of the covariance: what is held has none."""
    known = np.flatnonzero(vector.sd > 0)
    out = np.zeros_like(L)
    out[known] = at_most(vector.chosen(vector.names[i] for i in known), L[known])
    return out


def put_back(model: TemperatureModel, common: Common) -> TemperatureModel:
    """Return functions whose covariance knows the error of gravity too.

    `model`: the functions fitted to what is the sessions' own; `common`: what was taken out [SI].
    """
    p = model.weights.shape[1]
    ones = np.ones(p) if model.knots.size else np.eye(p)[0]
    cov = model.cov.copy()
    for error in common.values():
        flat = np.outer([error.get(name, 0.0) for name in model.layout.names], ones).ravel()
        cov += np.outer(flat, flat)
    return replace(model, cov=cov)
