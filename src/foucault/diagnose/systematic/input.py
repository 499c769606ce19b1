"""What can be wrong with the readings of a systematic calibration, whatever its sequence.

Norms at rest show a wrong unit of specific force. From one rest to the next up turns in the body
as the gyros say: where it does not, exchanged axes, signs and units are tried (`diagnose.axes`).
The rests together tell the Earth's rate from the bias of the gyros, and what of it lies along up
is ``w_ie sin L``: of the other sign where the accelerometers read gravity. All of this comes before
the turns are compared with a sequence, so that the table is not blamed for columns of the log.
"""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.alignment.input import SURE
from foucault.diagnose.axes import SUSPICIOUS, explain_turns, mistake
from foucault.diagnose.force_at_rest import one_axis_off, wrong_force
from foucault.diagnose.systematic.rests import FoundSequence
from foucault.errors import Finding, error, finding
from foucault.models.earth import EARTH_RATE, Site
from foucault.navigate.increments import GAP
from foucault.tables import AXES, Log
from foucault.units import plain, span

RATES = {
    3600.0: "arcsec were declared as deg, or deg/h as deg/s",
    3600.0 * float(np.degrees(1.0)): "arcsec were declared as rad, or deg/h as rad/s",
}
"""By so much the Earth's rate is too large in rests, by what [1]."""

NEAR, SAME = 1.2, 0.7
"""A rate is another within this factor, and goes round with the attitude where its mean over all
rests is less than this part of it [1]."""

LEAST, MANY = 0.01, 3.0
"""What lies along up of the Earth's rate is wrong beyond the first as part of the Earth's rate and
the second times the largest angle between the ups of two rests [1]."""


def check_readings(log: Log, found: FoundSequence, site: Site) -> tuple[Finding, ...]:
    """Refuse readings of a wrong unit, axis or sign.

    `log`: readings [SI]; `site`: where it stood, the latitude must be known. Raises samples are
    missing, a mistake explains the readings, or gyros and accelerometers contradict one another.
    """
    _check_gaps(log)
    off = one_axis_off(found.accel, site.gravity)
    if off is not None:
        raise error("accel.one_axis", axis=AXES[off[0]], factor=f"{off[1]:.4g}")
    norm = float(np.median(np.linalg.norm(found.accel, axis=1)))
    problem = wrong_force(norm, site.gravity, log.interval)
    if problem is not None:
        raise problem
    up = found.accel / np.linalg.norm(found.accel, axis=1)[:, None]
    told = np.einsum("nij,nj->ni", found.C_0k, up)  # all the same, in axes of the first rest
    _check_rates(found)
    _check_turns(log, found, up, told)
    return _check_vertical(found, told, site)


def require_readings(log: Log) -> None:
    """Refuse a log in which a sensor reads one value from the first row to the last.

    `log`: readings of both triads [SI].
    """
    stuck = [
        f"{name} {axis}"
        for name in ("gyro", "accel")
        for axis, x in zip(AXES, getattr(log, name).T, strict=True)
        if not np.ptp(x) > 0
    ]
    if stuck:
        raise error("systematic.one_value", sensors=", ".join(stuck))


def _check_rates(found: FoundSequence) -> None:
    """Refuse a unit of the gyros by which the rests turn many times as fast as the Earth.

    A bias is the same in all rests; the Earth's rate goes round with the attitude.
    """
    size = float(np.median(np.linalg.norm(found.gyro, axis=1)))
    same = float(np.linalg.norm(found.gyro.mean(axis=0)))
    ratio = size / EARTH_RATE
    for factor, words in RATES.items():
        if same < SAME * size and 1 / NEAR < ratio / factor < NEAR:
            raise error("systematic.rest_rate", rate=f"{np.degrees(size):.3g}",
                        ratio=f"{ratio:.0f}", cause=words)  # fmt: skip


def _check_gaps(log: Log) -> None:
    dt = np.diff(log.time)
    rows = np.flatnonzero(dt > GAP * log.interval)
    if len(rows):
        places = ", ".join(f"{plain(float(log.time[k]), 8)} s" for k in rows[:3])
        raise error(
            "systematic.gap", where=places + (" ..." if len(rows) > 3 else ""), count=len(rows),
            longest=span(float(dt[rows].max())), usual=span(log.interval),
        )  # fmt: skip


def _check_turns(log: Log, found: FoundSequence, up: FloatArray, told: FloatArray) -> None:
    if len(told) < 2:
        return
    miss = np.arccos(np.clip(np.sum(told[:-1] * told[1:], axis=1), -1.0, 1.0))
    worst = int(np.argmax(miss))
    # Written so that a miss that is not a number passes no further.
    if miss[worst] < SUSPICIOUS:
        return
    turns = found.rests.last[:-1] - 1, found.rests.first[1:]
    bias = np.median(found.gyro, axis=0)
    problem = mistake(log, *explain_turns(log, up, bias, *turns))
    if problem is not None:
        raise problem
    raise error(
        "systematic.turn_contradicts", start=f"{log.time[turns[0][worst]]:.1f}",
        end=f"{log.time[turns[1][worst]]:.1f}", angle=f"{np.degrees(miss[worst]):.0f}",
        count=int(np.count_nonzero(miss >= SUSPICIOUS)), turns=len(miss),
    )  # fmt: skip


def _check_vertical(found: FoundSequence, told: FloatArray, site: Site) -> tuple[Finding, ...]:
    up = told[0]
    if found.earth_b is None or found.earth_cov is None or site.latitude is None:
        return ()
    seen, sd = float(up @ found.earth_b), float(np.sqrt(up @ found.earth_cov @ up))
    wanted = EARTH_RATE * np.sin(site.latitude)
    size = float(np.linalg.norm(found.earth_b))
    # Errors of the gyros turn rest against rest, as up shows, and the Earth's rate in each as much.
    apart = float(np.arccos(np.clip(told @ up, -1.0, 1.0)).max())
    band = max(SURE * sd, (LEAST + MANY * apart) * EARTH_RATE)
    if abs(seen - wanted) < band or abs(size - EARTH_RATE) > band:
        return ()  # as it should be, or no Earth's rate
    if abs(seen + wanted) < band:
        given, should, spread = (f"{np.degrees(x) * 3600:.4g}" for x in (seen, wanted, sd))
        raise error("alignment.vertical_sign", given=given, wanted=should, sd=spread)
    level = float(np.sqrt(max(size**2 - seen**2, (LEAST * EARTH_RATE) ** 2)))
    return (
        finding(
            "systematic.latitude", seen=f"{np.degrees(np.arcsin(np.clip(seen / size, -1, 1))):.1f}",
            sd=f"{np.degrees(sd / level):.2g}", declared=f"{np.degrees(site.latitude):.1f}",
        ),
    )  # fmt: skip
