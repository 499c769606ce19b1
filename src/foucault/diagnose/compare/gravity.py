"""The error of local gravity that several results owe to the same number.

Two results that were given gravity of the same place are wrong by it in the same direction: their
difference does not know it, and more of them do not make it smaller. A procedure that uses gravity
otherwise than for the norm of specific force says itself what its error makes, and so does a result
that was made of others (merged, or with an earlier one as prior), site by site.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.models.layouts import is_cluster
from foucault.models.references import gravity_slope
from foucault.result import Result

Site = tuple[Any, ...]
"""Gravity, its standard deviation, latitude and height."""

KEY = "gravity_errors"
"""Where a result that says so itself keeps them, in its diagnostics."""


def gravity_errors(result: Result, vector: CoefficientVector) -> dict[Site, FloatArray]:
    """Return the errors that gravity makes in `vector`, per standard deviation of it.

    `result`: the result [SI]; `vector`: its coefficients, turned perhaps into other axes [SI].
    Returns (n,): site -> error of each coefficient [SI]; empty where gravity plays no part.
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
    return {site_of(result.site): gravity_slope(vector) * sd / gravity}


def site_of(said: Mapping[str, Any]) -> Site:
    """Return which gravity it is that a result was given, from its `site`."""
    gravity, sd, latitude, height = map(said.get, ("gravity", "gravity_sd", "latitude", "height"))
    return gravity, sd, latitude, height


def as_kept(errors: Mapping[Site, Mapping[str, float]]) -> list[dict[str, Any]]:
    """Return errors as the diagnostics of a result keep them.

    `errors`: site -> coefficient -> its error per standard deviation of gravity [SI].
    """
    return [{"site": list(site), "error": dict(error)} for site, error in errors.items()]


def of_site(
    said: Mapping[str, Any], names: tuple[str, ...], error: FloatArray
) -> dict[str, list[dict[str, Any]]]:
    """Return the diagnostics of a result that was given one gravity.

    `names` (n,): coefficients; `error` (n,): their errors per standard deviation of gravity [SI].
    """
    return {KEY: as_kept({site_of(said): dict(zip(names, error.tolist(), strict=True))})}
