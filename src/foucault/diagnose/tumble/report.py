"""What the report of a tumble shows: course of the estimate, residuals, sensitivities, path.

Everything is computed here; the report draws it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.diagnose.observability import Observability
from foucault.diagnose.tumble import checks as tumble_checks
from foucault.diagnose.tumble import observability
from foucault.diagnose.tumble.checks import Evidence
from foucault.diagnose.tumble.observability import STATE
from foucault.estimate.tumble.fit import Tumble, attitudes
from foucault.models.cluster import CONSTANTS, angles_of, normalised
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise, noise_json
from foucault.result import TableData
from foucault.tables import AXES

DRAWN = 400
"""Rows of a table that is drawn as curves [1]."""

SUBDIVIDED = np.radians(15.0)
"""For the rank of the motion every constant rate is cut into turns of at most this [rad]."""

MOST_SEGMENTS = 96
"""Into so many parts the motion is cut at most [1]."""

SHORT = 0.01
"""A leg shorter than this part of the whole is one with its neighbour [1]."""

WEAKEST, STRONG = 6, 0.9
"""Combinations shown, and correlations from which pairs are shown [1]."""


def diagnostics(e: Evidence, site: Site, noise: ImuNoise) -> dict[str, Any]:
    """Return what result.json tells beside coefficients and checks.

    `noise`: white noise that was weighed [SI].
    """
    C_pn = e.fit.C_np.T
    return {
        "gravity": site.gravity,
        "iterations": e.fit.passes,
        "averaged": float(np.median(np.diff(e.fit.time))) if len(e.fit.time) > 1 else None,
        "noise": {"source": "declared"} | noise_json(noise),
        "chi_square": {"accel": tumble_checks.whole_square(e)},
        "attitude": {
            "C_pn": C_pn.tolist(),
            "sd": np.sqrt(np.diag(e.fit.cov)[:3]).tolist(),
            "start_sd": np.sqrt(np.diag(e.fit.start_cov)[:3]).tolist(),
            "start": angles_of(e.fit.start.C_np.T).tolist(),
            "believed": e.believed.tolist(),
        },
        "delay": {
            "estimated": bool(e.prior.sd[-1] > 0),
            "value": e.delay,
            "sd": float(np.sqrt(e.fit.cov[-1, -1])) if e.prior.sd[-1] > 0 else e.fit.late[1],
        },
    }


def observability_json(e: Evidence) -> dict[str, Any]:
    """Return what the motion shows and what it leaves, in words and numbers."""
    information = observability.information_of(e.fit, e.prior)
    prior_sd = e.prior.sd[: len(STATE)]
    motion, until = piecewise(e)
    whole = information.with_prior(prior_sd)
    return {
        "rank": motion.rank,
        "states": len(STATE),
        "smallest": motion.smallest,
        "legs": legs(e.tumble),
        "growth": {
            "until": until,
            "rank": [gain.rank for gain in motion.gains],
            "alone": _alone([gain.alone for gain in motion.gains]),
        },
        "unseen": [c.words for c in motion.unseen],
        "remaining": [r.words for r in information.remaining(prior_sd, WEAKEST)],
        "weakest": [c.words for c in whole.weakest(WEAKEST)],
        "correlated": [[a, b, value] for a, b, value in whole.correlated(STRONG)],
        "of_prior": {
            name: float(sd / before)
            for name, sd, before in zip(STATE.names, whole.sd, prior_sd, strict=True)
        },
    }


def _alone(newly: Sequence[Sequence[str]]) -> list[int]:
    """Count the states seen each by itself; one that rounding hides for a while counts once."""
    seen: set[str] = set()
    return [len(seen := seen | set(names)) for names in newly]


def piecewise(e: Evidence) -> tuple[Observability, list[float]]:
    """Return the stripped observability of the motion as it was, and when each short turn ends."""
    rates, path, times = segments(e)
    reading_sd = float(np.sqrt(e.tumble.accel_variance / e.tumble.block))
    motion = observability.piecewise(rates, path, times, e.prior, reading_sd)
    return motion, np.cumsum(times).tolist()


def segments(e: Evidence) -> tuple[list[FloatArray], list[FloatArray], list[float]]:
    """Return rate, C_pn in the middle and time of each part of the motion."""
    t = e.tumble
    turned = np.concatenate([[0.0], np.cumsum(np.linalg.norm(t.command, axis=1) * t.dt)])
    part = max(SUBDIVIDED, float(turned[-1]) / MOST_SEGMENTS)
    edges = [0]
    for a, b in pairwise(_jumps(t)):
        n = max(1, int(np.ceil((turned[b] - turned[a]) / part - 1e-6)))
        edges += np.linspace(a, b, n + 1).astype(int)[1:].tolist()
    edges = sorted(set(edges))
    time = _time(t)
    middle = np.array([(a + b) // 2 for a, b in pairwise(edges)])
    path = attitudes(t, e.fit.start, middle)
    rates = [np.average(t.command[a:b], axis=0, weights=t.dt[a:b]) for a, b in pairwise(edges)]
    times = [float(time[b] - time[a]) for a, b in pairwise(edges)]
    return rates, list(path), times


def legs(t: Tumble) -> list[dict[str, Any]]:
    """Return start, end [s] and mean command [rad/s] of every leg of the motion: what is drawn."""
    time = _time(t)
    kept = [0]
    for edge in _jumps(t)[1:-1]:
        # Steps of a ramp are no legs of their own.
        if min(time[edge] - time[kept[-1]], time[-1] - time[edge]) > SHORT * time[-1]:
            kept.append(edge)
    return [
        {
            "start": float(time[a]),
            "end": float(time[b]),
            "rate": np.average(t.command[a:b], axis=0, weights=t.dt[a:b]).tolist(),
        }
        for a, b in pairwise([*kept, len(t.dt)])
    ]


def _jumps(t: Tumble) -> list[int]:
    """Intervals at which the command jumps, the first and the end of the last among them."""
    fastest = float(np.abs(t.command).max())
    step = np.linalg.norm(np.diff(t.command, axis=0), axis=1) > 0.01 * fastest
    return [0, *(np.flatnonzero(step) + 1).tolist(), len(t.dt)]


def _time(t: Tumble) -> FloatArray:
    """When each interval begins, and the last ends [s]."""
    return np.concatenate([[0.0], np.cumsum(t.dt)])


def tables(e: Evidence, site: Site) -> dict[str, TableData]:
    """Return the tables of the report."""
    return {
        "course": _course(e, site),
        "residuals": _residuals(e),
        "sensitivity": _sensitivity(e, site),
        "path": _path(e),
    }


def _course(e: Evidence, site: Site) -> TableData:
    """The estimate as it was in the course of time: value and sd of every coefficient [SI]."""
    history = e.fit.history
    if history is None:
        return {"time": np.zeros(0)}
    factor = 1 / normalised(site.gravity)
    out: dict[str, npt.NDArray[Any]] = {"time": history.time}
    values = (e.fit.start.constants + history.step[:, 3:45]) * factor
    sd = history.sd[:, 3:45] * factor
    for k, name in enumerate(CONSTANTS.names):
        out[name], out[f"{name}.sd"] = values[:, k], sd[:, k]
    # Where attitude was believed to be then, minus where the whole log says that it was.
    for k, axis in enumerate(AXES):
        out[f"attitude.{axis}"] = history.step[:, k]
        out[f"attitude.{axis}.sd"] = history.sd[:, k]
    return out


def _residuals(e: Evidence) -> TableData:
    white = e.residuals
    return {"time": e.fit.time} | {a: white[:, k] for k, a in enumerate(AXES)}


def _sensitivity(e: Evidence, site: Site) -> TableData:
    """d(reading)/d(coefficient) along the motion, thinned [m/s^2 per SI unit]."""
    factor = normalised(site.gravity)
    thin = observability.curves(e.tumble, e.fit.start, site.gravity, factor).thinned(DRAWN)
    out: dict[str, npt.NDArray[Any]] = {"time": thin.time}
    for i, axis in enumerate(AXES):
        for k, name in enumerate(thin.layout.names):
            out[f"{axis}.{name}"] = thin.slopes[:, i, k]
    return out


def _path(e: Evidence) -> TableData:
    """Directions of the cluster axes in East-North-Up, and the three angles."""
    n = len(e.tumble.dt)
    rows = np.unique(np.linspace(0, n, DRAWN).astype(np.int64))
    C_pn = attitudes(e.tumble, e.fit.start, rows)
    time = _time(e.tumble)[rows]
    out: dict[str, npt.NDArray[Any]] = {"time": time}
    for i, axis in enumerate(AXES):
        for k, where in enumerate(("east", "north", "up")):
            out[f"{axis}.{where}"] = C_pn[:, i, k]
    angles = np.unwrap(angles_of(C_pn), axis=0)
    for k, word in enumerate(("outer", "middle", "inner")):
        out[word] = angles[:, k]
    return out
