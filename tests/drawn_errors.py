"""Errors of readings, drawn from the sources of a model."""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.infer.mixed import Linearisation


def drawn(at: Linearisation, rng: np.random.Generator) -> FloatArray:
    """Draw the errors of all readings for one Monte Carlo trial, shape (n, d) [SI]."""
    out = np.zeros_like(at.residuals)
    for source in at.sources:
        for root, causes in ((source.each, len(out)), (source.shared, 1)):
            if root is not None:
                u = rng.standard_normal((causes, root.shape[2]))
                out += (source.sd or 0.0) * np.einsum(
                    "ndc,nc->nd", root, np.broadcast_to(u, (len(out), u.shape[1]))
                )
    return out
