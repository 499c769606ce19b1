"""How much each coefficient counts when plans are compared."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.coefficients import Layout
from foucault.errors import error, suggestion


def weights_of(layout: Layout, given: Mapping[str, float]) -> FloatArray:
    """Return the weight of every coefficient, shape (n,), over the largest of them [1].

    `given`: weights of coefficients or of groups of them, 1 where nothing is said, the longer
    name wins [1]. Raises ``optimise.weight``: an unknown name, a weight below zero, or nothing
    left above zero.
    """
    weights = np.ones(len(layout.names))
    groups = {n.rpartition(".")[0] for n in layout.names}
    known = sorted({*layout.names, *groups, *(n.split(".")[0] for n in layout.names)} - {""})
    for name in sorted(given, key=len):
        if name not in known:
            hint = suggestion(name, known)
            allowed = ", ".join(sorted(groups - {""}) or layout.names)
            raise error("optimise.weight_name", name=name, hint=hint, allowed=allowed)
        if not (isfinite(given[name]) and given[name] >= 0):
            raise error("optimise.weight", name=name, given=given[name])
        weights[layout.group(name)] = given[name]
    if not weights.any():
        raise error("optimise.weightless")
    return np.asarray(weights / weights.max())


def require_seen(
    names: tuple[str, ...], weights: FloatArray, unseen: npt.NDArray[np.bool_], limits: str
) -> tuple[str, ...]:
    """Return the names that no allowed plan shows; refuse those of them that count.

    `weights` (n,): how much each counts [1]; `unseen` (n,): whether no allowed plan shows it.
    """
    counting = [n for n, w, u in zip(names, weights, unseen, strict=True) if u and w > 0]
    if counting:
        some = ", ".join(counting)
        raise error("optimise.unseen", count=len(counting), names=some, limits=limits)
    return tuple(n for n, u in zip(names, unseen, strict=True) if u)
