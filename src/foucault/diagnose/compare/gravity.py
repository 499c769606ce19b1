"""The error of local gravity that several results owe to the same number.

Two results that were given gravity of the same place are wrong by it in the same direction: their
difference does not know it, and more of them do not make it smaller. A result that was made of
others (merged, or with an earlier one as prior) says itself how much of it is left, site by site.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.coefficients import CoefficientVector
from foucault.models.layouts import is_cluster
from foucault.models.references import gravity_slope
from foucault.result import Result

FloatArray = npt.NDArray[np.float64]
Site = tuple[Any, ...]
"""Gravity, its standard deviation, latitude and height."""

KEY = "gravity_errors"
"""Where a result that was made of others keeps them, in its diagnostics."""


def gravity_errors(result: Result, vector: CoefficientVector) -> dict[Site, FloatArray]:
    """Return the errors that gravity makes in `vector`, per standard deviation of it.

    Parameters
    ----------
    result : Result
        The result [SI].
    vector : CoefficientVector
        Its coefficients, turned perhaps into other axes [SI].

    Returns
    -------
    dict of tuple to ndarray, shape (n,)
        Site -> error of each coefficient [SI]; empty where gravity plays no part.
    """
    kept = result.diagnostics.get(KEY)
    if kept is not None:
        return {
            tuple(row["site"]): np.array([row["error"].get(n, 0.0) for n in vector.names])
            for row in kept
        }
    part = (result.diagnostics.get("budget") or {}).get("local gravity")
    gravity, sd = result.site.get("gravity"), result.site.get("gravity_sd")
    if not (part and gravity and sd) or is_cluster(result.coefficients):
        return {}
    site = (gravity, sd, result.site.get("latitude"), result.site.get("height"))
    return {site: gravity_slope(vector) * sd / gravity}


def as_kept(errors: Mapping[Site, Mapping[str, float]]) -> list[dict[str, Any]]:
    """Return errors as the diagnostics of a result keep them.

    Parameters
    ----------
    errors : mapping of tuple to mapping of str to float
        Site -> coefficient -> its error per standard deviation of gravity [SI].
    """
    return [{"site": list(site), "error": dict(error)} for site, error in errors.items()]
