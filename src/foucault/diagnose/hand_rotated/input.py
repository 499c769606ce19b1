"""What can be wrong with a session of rests before anything is estimated.

Norms at rest show a wrong unit of specific force; the directions of up show rests in a plane;
the turns show exchanged axes and a wrong unit of the gyros. What none of them can show is said.
"""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose import axes
from foucault.diagnose.coverage import coverage
from foucault.diagnose.first_rest import first_rest_orientation
from foucault.diagnose.rests import Rests, find_rests, require_live_gyros
from foucault.errors import Finding, error, finding
from foucault.estimate import norm_observation
from foucault.models.rests_and_turns import Session
from foucault.tables import Log


def need_samples(log: Log) -> None:
    """Refuse a log whose rows are means: the turns between them are not in it.

    `log`: readings [SI].
    """
    if log.averaged is not None:
        raise error("session.means")


def enough_rests(log: Log, rests: Rests, needed: int, shortest: float) -> None:
    """Refuse a log without numbers, or with fewer rests than coefficients.

    `log`: readings [SI]; `needed`: number of accelerometer coefficients [1]; `shortest`: length
    that was asked of a rest [s].
    """
    if log.accel is None:
        raise error("session.no_accel")
    for what, x in (("accel", log.accel), ("gyro", log.gyro)):
        bad = None if x is None else np.flatnonzero(~np.isfinite(x).all(axis=1))
        if bad is not None and len(bad):
            raise error("session.not_finite", what=what, index=int(bad[0]))
    require_live_gyros(log)
    if len(rests) < needed:
        short = find_rests(log, window=shortest / 2, shortest=shortest / 4)
        hint = (
            f" {len(short)} quiet times are shorter than that or were left out."
            if len(short) > len(rests)
            else ""
        )
        raise error(
            "rests.too_few",
            given=len(rests),
            shortest=f"{shortest:g}",
            names=needed,
            needed=needed,
            hint=hint,
        )


def check_input(data: Session) -> list[Finding]:
    """Refuse what cannot be right; say what cannot be known.

    `data`: the session, reduced to its rests [SI]. Raises A wrong unit, rests in a plane,
    exchanged axes, a declared orientation that is not so.
    """
    up_b = check_forces(data)
    findings = first_rest_orientation(data.log, up_b[0])
    if data.gyro_mean is None:
        return [*findings, finding("session.no_gyro")]
    turns = (data.last[:-1] - 1, data.first[1:])
    declared, best = axes.explain_turns(data.log, up_b, data.gyro_mean.mean(axis=0), *turns)
    problem = axes.mistake(data.log, declared, best)
    if problem is not None:
        raise problem
    return findings


def check_forces(data: Session) -> FloatArray:
    """Return the directions of up in the body, shape (n, 3); refuse forces that cannot be right.

    `data`: the session, reduced to its rests [SI]. Raises A wrong unit, rests in a plane.
    """
    norm = float(np.median(np.linalg.norm(data.accel_mean, axis=1)))
    ratio = norm / data.site.gravity
    if not 0.5 < ratio < 2.0:
        raise error("accel.scale_impossible", given=f"{norm:.4g}", ratio=f"{ratio:.3g}")
    solved = norm_observation.solve(data.accel_mean, data.site.gravity)
    raw = data.accel_mean / np.linalg.norm(data.accel_mean, axis=1)[:, None]
    spread = coverage(raw)
    if solved is None or spread.flatness < 0.05:
        why = (
            "up stays in one plane of the body"
            if spread.flatness < 0.05
            else "the directions of up are too much alike to fit an ellipsoid"
        )
        missing = ", ".join(words for _, words in spread.missing) or "more directions"
        raise error("rests.plane", given=len(raw), why=why, missing=missing)
    f_b = np.linalg.solve(solved[0], (data.accel_mean - solved[1]).T).T
    return np.asarray(f_b / np.linalg.norm(f_b, axis=1)[:, None])
