"""What rests say of units, axes and signs: gravity, the Earth's rate, and which way up was.

At rest the mean specific force is gravity and the mean rate the Earth's, so that::

    |f| = g,    |w| = w_ie,    f . w / |f| = w_ie sin L

What contradicts them is tried on the usual mistakes. One rest shows only what lies along up: what
leaves f . w as it is cannot show, triads that are both mirrored, or both turned, alike (two columns
swapped or one sign wrong in both).

Between two rests the direction of gravity in the body turns as the gyros say. Where it does not,
every signed exchange of gyro axes is tried, alone with every usual mistake of unit, and the
unit of one gyro alone. Mirrored triads show where a turn tilts the instrument, and not where it
turns about up alone (by other angles than half a turn, methods of alignment then contradict one
another).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.detect.faces import require_gravity
from foucault.detect.stretches import How, Rests, find_rests, require_finite, require_live_gyros
from foucault.errors import Finding, FoucaultError, error, finding
from foucault.estimate import norm_observation
from foucault.guard.mistakes import (
    DEGREE,
    NONE,
    Mistake,
    exchange_words,
    exchanges,
    explain,
    factors,
    likely,
    one_unit,
)
from foucault.kernels.rotation import integrate_turns
from foucault.logs.description import LogDescription
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.rests_and_turns import Session
from foucault.navigate.increments import Increments
from foucault.tables import AXES, Log, gaps
from foucault.units import convert, plain, span

if TYPE_CHECKING:
    from foucault.detect.sequence import FoundSequence
    from foucault.navigate.inertial_frame import SensorErrors

SUSPICIOUS = np.radians(10.0)
"""A miss of the direction of gravity that no calibration error explains, rms [rad]."""

AS_GOOD = np.radians(2.0)
"""Exchanges that miss by less are told apart by calibration errors alone: the simplest is named,
rms [rad]."""

BETTER, WELL = 0.35, 0.1
"""An exchange is blamed when it reduces the miss to the first part, even where gyros are saturated
when it is to the second [1]."""


@dataclass(frozen=True)
class _Turns:
    """Turns between rests, as gyros and accelerometers tell them."""

    log: Log
    up_b: FloatArray  # (n, 3) direction of up at each rest, from the accelerometers, frame b [1]
    bias: FloatArray  # (3,) mean rate at rest [rad/s]
    first: IntArray  # (n - 1,) first and last sample of each turn
    last: IntArray

    @cached_property
    def _known(self) -> dict[float, FloatArray]:
        return {}

    def _turned(self, rate: FloatArray) -> FloatArray:
        """Return the rotation of each turn (n - 1, 3, 3) [1] by rates (samples, 3) [rad/s]."""
        summed = self.log.sampled == "increment"
        zero, none = np.zeros((3, 3)), np.empty((0, 3))
        C, *_ = integrate_turns(
            self.log.time, rate, none, zero, self.first, self.last, summed
        )  # fmt: skip
        return np.asarray(C)

    def miss(self, mistake: Mistake) -> float:
        """Return the angle between predicted and observed up, rms [rad]."""
        assert self.log.gyro is not None
        rate, E = self.log.gyro - self.bias, np.eye(3)
        if mistake.one_axis:
            C_se = self._turned(np.ascontiguousarray(mistake.right(rate)))
        else:
            # Exchanged rates turn what they integrate to, ``C(E w) = E C(w) E'``: a factor and a
            # sense are integrated once for all 24 rotations of the axes.
            sense = -1.0 if mistake.left_handed else 1.0
            factor, E = sense * mistake.factor, sense * mistake.exchange
            if factor not in self._known:
                self._known[factor] = self._turned(factor * rate)
            C_se = self._known[factor]
        predicted = np.einsum("nji,nj->ni", C_se, self.up_b[:-1] @ E) @ E.T
        angle = np.arccos(np.clip(np.sum(predicted * self.up_b[1:], axis=1), -1, 1))
        return float(np.sqrt(np.mean(angle**2)))


def problem(
    log: Log, up_b: FloatArray, bias: FloatArray, first: IntArray, last: IntArray,
    *, alone: bool = False,
) -> FoucaultError | None:  # fmt: skip
    """Return what contradicts the turns between rests; None where nothing does.

    `log`: readings [SI]; `up_b` (n, 3): direction of up at each rest, by the accelerometers,
    frame b [1]; `bias` (3,): mean rate at rest [rad/s]; `first`, `last` (n - 1,): first and last
    sample of each turn; `alone`: whether another explanation that is as good is told instead.
    """
    turns = _Turns(log, up_b, bias, first, last)
    known = {1.0: ""} | {
        1.0 / ratio: words for ratio, words in factors("gyro", log.interval).items()
    }
    tried = [Mistake(words, scale, E) for scale, words in known.items() for E in exchanges()]
    tried.sort(key=lambda mistake: mistake.weight)
    tried += one_unit("gyro", (DEGREE, 1.0 / DEGREE))
    within = SUSPICIOUS if alone else AS_GOOD
    seen = explain(turns.miss, tried, wrong=SUSPICIOUS, better=BETTER, within=within)
    clipped = [f.message for f in log.findings if f.code == "log.saturated" and "gyro" in f.message]
    said = {"declared": f"{np.degrees(seen.now):.0f}", "better": f"{np.degrees(seen.least):.1f}"}
    if clipped and seen.now >= SUSPICIOUS and not seen.least <= WELL * seen.now:
        return error("gyro.saturated", declared=said["declared"], where=" ".join(clipped))
    if not seen.by:
        return None
    if alone and len(seen.by) > 1:
        return error("faces.moves", count=len(seen.by), causes=_several(seen.by), **said)
    likely = seen.by[0]
    if likely.one_axis:
        return error("gyro.one_axis", axis=likely.words, factor=f"{likely.one_axis:.4g}", **said)
    if np.array_equal(likely.exchange, np.eye(3)):
        return error("gyro.unit", factor=f"{likely.factor:.4g}", cause=likely.words, **said)
    code = "gyro.left_handed" if likely.left_handed else "gyro.axes"
    if np.array_equal(likely.exchange, -np.eye(3)):
        code = "gyro.reversed"
    return error(code, exchange=exchange_words(likely.exchange), **said)


def _several(every: Sequence[Mistake]) -> str:
    """Return the simplest explanations in words: of the axes, and of axes and unit."""
    units = sorted(every, key=lambda m: -np.trace(m.exchange))
    chosen = [every[0]] + [m for m in units[:1] if m is not every[0]]
    times = {m.factor: f", times {m.factor:.4g}" * (m.factor != 1.0) for m in chosen}
    return " or ".join(exchange_words(m.exchange) + times[m.factor] for m in chosen)


def between_rests(
    log: Log,
    first: IntArray,
    last: IntArray,
    up_b: FloatArray | None = None,
    *,
    alone: bool = False,
) -> None:
    """Refuse gyros whose axes or unit contradict how up turned from rest to rest.

    `log`: readings [SI]; `first`, `last` (n,): first sample of each rest and the sample after its
    last; `up_b` (n, 3) or None: direction of up in each, None takes their means [1]; `alone`: rests
    on faces, which calibrate where moves say too little.
    """
    if log.gyro is None or log.accel is None or log.averaged is not None:
        return
    spans = list(zip(first, last, strict=True))
    if up_b is None:
        up_b = np.array([log.accel[a:b].mean(axis=0) for a, b in spans])
        up_b /= np.linalg.norm(up_b, axis=1)[:, None]
    bias = np.mean([log.gyro[a:b].mean(axis=0) for a, b in spans], axis=0)
    found = problem(log, up_b, bias, last[:-1] - 1, first[1:], alone=alone)
    # Saturated moves between faces are told, and do no harm: the rests calibrate.
    if found is not None and not (alone and found.code == "gyro.saturated"):
        raise found


def of_increments(increments: Increments, rests: Sequence[tuple[float, float]]) -> None:
    """Refuse gyro axes or units that the turns between the rests of an alignment contradict.

    `increments`: the log [rad], [m/s]; `rests`: start and end of each rest, in order [s].
    """
    dt = increments.dt[:, None]
    log = Log(increments.time, increments.dtheta_b / dt, increments.dvel_b / dt, "increment")
    first, last = np.searchsorted(log.time, np.array(rests).T, side="right")
    between_rests(log, first, last)


SURE = 5.0
"""A contradiction is one beyond this many standard deviations: one in a million by chance [1]."""

GRAVITY_BAND = 1.25
"""The mean specific force is gravity within this factor, whatever the calibration [1]."""

RAW_BAND = 2.0
"""And so it is of instruments that nobody has calibrated yet [1]."""

ALIKE, RAW = 0.05, 0.2
"""Magnitudes whose logarithms are within this are one if calibrated, and if not so [1]."""

OFF_GRAVITY = 0.002
"""Accelerometers fit to navigate by see gravity within this part, calibrated or not [1]."""

RATE_BAND = 0.2
"""A factor explains a rate that is the Earth's within this part [1]."""

GROSS = 0.03
"""Axes are suspected where what lies along up is off by more than this part of the Earth's rate,
0.45 deg/h: less may be a bias, and some exchange of axes that read little explains any [1]."""

SHOWN = 3
"""Exchanges of axes that are named [1]."""

NEAR_POLE = 0.1
"""Cosine of the latitude below which the level part of the Earth's rate is small [1]."""

FLAT = 0.05
"""Directions of up that are flatter lie in one plane [1]."""

MANY_TIMES = 1000.0
"""Rests that turn so many times as fast as the Earth are of another unit, not of a bias [1]."""

NEAR, SAME = 1.2, 0.7
"""A rate is another within this factor, and goes round with the attitude where its mean over all
rests is less than this part of it [1]."""

LEAST, MANY = 0.01, 3.0
"""What lies along up of the Earth's rate is wrong beyond the first as part of the Earth's rate and
the second times the largest angle between the ups of two rests [1]."""


# -- which way up --------------------------------------------------------------------------------


def first_rest(described: Log | LogDescription, up_b: FloatArray) -> list[Finding]:
    """Refuse a first rest in another orientation than declared; say so where none is.

    `described`: the log, whose source keeps its description, or the description itself; `up_b`
    (3,): direction of up at the first rest, frame b [1]. Raises ``accel.orientation``.
    """
    if isinstance(described, Log):
        said = (described.source.get("description") or {}).get("accel") or {}
        declared = said.get("first_rest")
    else:
        declared = described.accel and described.accel.first_rest
    if not declared:
        return [finding("accel.sign_unknown")]
    axis, sense = str(declared).split()
    cosine = float(up_b[AXES.index(axis)]) * (1.0 if sense == "up" else -1.0)
    if cosine > np.cos(np.radians(45)):
        return []
    advice = (
        'All signs are turned: set reads = "gravity" in [log.accel], or correct first_rest.'
        if cosine < -np.cos(np.radians(45))
        else "Correct the order of `columns` in [log.accel] and [log.gyro], or first_rest."
    )
    from foucault.detect.coverage import direction_words

    words = {"declared": declared, "measured": direction_words(up_b), "advice": advice}
    raise error("accel.orientation", **words)


# -- gravity -------------------------------------------------------------------------------------


def same_unit(mean: FloatArray, gravity: float) -> None:
    """Refuse rests that read gravity only if one accelerometer is of another unit.

    With its factor the magnitude is gravity in all rests, and without it in those alone in which
    its axis is level.

    `mean` (n, 3): mean specific force of each rest [m/s^2]; `gravity`: local gravity [m/s^2].
    """
    if len(mean) < 3:
        return

    def spread(mistake: Mistake) -> float:
        size = np.maximum(np.linalg.norm(mistake.right(mean), axis=1), 1e-300)
        near = 1 / NEAR < np.median(size) / gravity < NEAR
        return float(np.log(size.max() / size.min())) if near or mistake is NONE else np.inf

    ratios = list(factors("accel", np.nan))
    seen = explain(spread, one_unit("accel", ratios), wrong=ALIKE, fits=RAW, better=BETTER)
    if seen.by:
        one = seen.by[0]
        raise error("accel.one_axis", axis=one.words, factor=f"{1 / one.one_axis:.4g}")


def wrong_force(seen: float, gravity: float, interval: float) -> FoucaultError | None:
    """Return what explains a specific force at rest that is not gravity by far.

    `seen`: its magnitude [m/s^2]; `gravity`: local gravity [m/s^2]; `interval`: usual interval
    between samples [s]. Returns None where it is gravity but for errors of accelerometers.
    """
    ratio = seen / gravity
    if 1 / GRAVITY_BAND < ratio < GRAVITY_BAND:
        return None
    cause = likely(ratio, factors("accel", interval), GRAVITY_BAND)
    return error("alignment.force", given=f"{seen:.4g}", ratio=f"{ratio:.4g}",
                 cause=cause or "no usual mistake makes this")  # fmt: skip


def up_of_rests(data: Session) -> FloatArray:
    """Return the directions of up in the body, shape (n, 3); refuse forces that cannot be right.

    `data`: the session, reduced to its rests [SI]. Raises a wrong unit, rests in a plane.
    """
    from foucault.detect.coverage import coverage  # not for a rest alone

    same_unit(data.accel_mean, data.site.gravity)
    require_gravity(data.log, data.accel_mean, data.site.gravity, RAW_BAND)
    solved = norm_observation.solve(data.accel_mean, data.site.gravity)
    spread = coverage(data.accel_mean / np.linalg.norm(data.accel_mean, axis=1)[:, None])
    if solved is None or spread.flatness < FLAT:
        why = (
            "up stays in one plane of the body"
            if spread.flatness < FLAT
            else "the directions of up are too much alike to fit an ellipsoid"
        )
        missing = ", ".join(words for _, words in spread.missing) or "more directions"
        raise error("rests.plane", given=len(data.accel_mean), why=why, missing=missing)
    f_b = np.linalg.solve(solved[0], (data.accel_mean - solved[1]).T).T
    return np.asarray(f_b / np.linalg.norm(f_b, axis=1)[:, None])


# -- rests with turns between them ---------------------------------------------------------------


def enough_rests(log: Log, rests: Rests, needed: int, shortest: float) -> None:
    """Refuse no numbers, or fewer rests, of `shortest` [s], than coefficients `needed` [1]."""
    if log.accel is None:
        raise error("session.no_accel")
    require_finite(log)
    require_live_gyros(log)
    if len(rests) < needed:
        short = find_rests(log, How(window=shortest / 2, shortest=shortest / 4))
        more = f" {len(short)} quiet times are shorter than that or were left out."
        raise error("rests.too_few", given=len(rests), shortest=f"{shortest:g}", names=needed,
                    needed=needed, hint=more if len(short) > len(rests) else "")  # fmt: skip


def check_session(data: Session) -> list[Finding]:
    """Refuse what cannot be right; say what cannot be known.

    `data`: the session, reduced to its rests [SI]. Raises a wrong unit, rests in a plane,
    exchanged axes, a declared orientation that is not so.
    """
    up_b = up_of_rests(data)
    told = first_rest(data.log, up_b[0])
    if data.gyro_mean is None:
        return [*told, finding("session.no_gyro")]
    between_rests(data.log, data.first, data.last, up_b)
    return told


def require_live(log: Log) -> None:
    """Refuse a log (both triads [SI]) in which a sensor reads one value from first row to last."""
    stuck = [
        f"{name} {axis}"
        for name in ("gyro", "accel")
        for axis, x in zip(AXES, getattr(log, name).T, strict=True)
        if not np.ptp(x) > 0
    ]
    if stuck:
        raise error("systematic.one_value", sensors=", ".join(stuck))


BRIDGED = 0.5
"""So long a gap within a rest is bridged: white noise that it hides is nothing [s]."""


def held_still(log: Log, spans: Sequence[tuple[int, int]]) -> IntArray:
    """Return the rows before short gaps that lie within rests, `spans` of `log`, (k,) [1]."""
    dt = np.diff(log.time)
    rows = np.flatnonzero(gaps(dt) & (dt <= BRIDGED))
    inside = [any(a <= k and k + 1 < b for a, b in spans) for k in rows.tolist()]
    return np.asarray(rows[np.array(inside, bool)], np.int64)


def check_sequence(log: Log, found: FoundSequence, site: Site) -> tuple[Finding, ...]:
    """Refuse readings of a wrong unit, axis or sign, whatever the sequence of a table.

    All of this comes before the turns are compared with a sequence, so that the table is not
    blamed for columns of the log.

    `log`: readings [SI]; `site`: where it stood, the latitude must be known. Raises samples are
    missing, a mistake explains the readings, or gyros and accelerometers contradict one another.
    """
    dt = np.diff(log.time)
    rows = np.setdiff1d(np.flatnonzero(gaps(dt)), held_still(log, found.rests.spans))
    if len(rows):
        places = ", ".join(f"{plain(float(log.time[k]), 8)} s" for k in rows[:3])
        raise error(
            "systematic.gap", where=places + (" ..." if len(rows) > 3 else ""), count=len(rows),
            longest=span(float(dt[rows].max())), usual=span(log.interval),
        )  # fmt: skip
    same_unit(found.accel, site.gravity)
    norm = np.linalg.norm(found.accel, axis=1)
    problem = wrong_force(float(np.median(norm)), site.gravity, log.interval)
    if problem is not None:
        raise problem
    up = found.accel / norm[:, None]
    told = np.einsum("nij,nj->ni", found.C_0k, up)  # all the same, in axes of the first rest
    _rests_turn_fast(found, log.interval)
    miss = np.arccos(np.clip(np.sum(told[:-1] * told[1:], axis=1), -1.0, 1.0))
    # Written so that a miss that is not a number passes no further.
    if len(miss) and not miss.max() < SUSPICIOUS:
        first, last = found.rests.first, found.rests.last
        between_rests(log, first, last, up)
        worst = int(np.argmax(miss))
        raise error(
            "systematic.turn_contradicts", start=f"{log.time[last[worst] - 1]:.1f}",
            end=f"{log.time[first[worst + 1]]:.1f}", angle=f"{np.degrees(miss[worst]):.0f}",
            count=int(np.count_nonzero(miss >= SUSPICIOUS)), turns=len(miss),
        )  # fmt: skip
    return _earth_of_rests(found, told, site)


def _rests_turn_fast(found: FoundSequence, interval: float) -> None:
    """Refuse a unit of the gyros by which the rests turn many times as fast as the Earth.

    A bias is the same in all rests; the Earth's rate goes round with the attitude.
    """
    size = float(np.median(np.linalg.norm(found.gyro, axis=1)))
    same, ratio = float(np.linalg.norm(found.gyro.mean(axis=0))), size / EARTH_RATE
    large = {k: words for k, words in factors("gyro", interval).items() if k > MANY_TIMES}
    cause = likely(ratio, large, NEAR)
    if cause is not None and same < SAME * size:
        raise error("systematic.rest_rate", rate=f"{np.degrees(size):.3g}", ratio=f"{ratio:.0f}",
                    cause=cause)  # fmt: skip


def _earth_of_rests(found: FoundSequence, told: FloatArray, site: Site) -> tuple[Finding, ...]:
    """Compare what lies along up of the Earth's rate, told from the bias by the rests together."""
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
        raise error("alignment.vertical_sign", given=_dph(seen), wanted=_dph(wanted), sd=_dph(sd))
    level = float(np.sqrt(max(size**2 - seen**2, (LEAST * EARTH_RATE) ** 2)))
    shown = np.degrees(np.arcsin(np.clip(seen / size, -1, 1)))
    words = {"seen": f"{shown:.1f}", "sd": f"{np.degrees(sd / level):.2g}",
             "declared": f"{np.degrees(site.latitude):.1f}"}  # fmt: skip
    if abs(seen - wanted) > max(band, GROSS * EARTH_RATE):  # no filter from there settles
        raise error("systematic.latitude", **words)
    return (finding("systematic.latitude", **words),)


# -- one rest ------------------------------------------------------------------------------------


def contradictions(
    increments: Increments, site: Site, sensors: SensorErrors
) -> tuple[Finding, ...]:
    """Compare the means of a rest with gravity and the Earth's rate.

    `increments`: one rest [rad], [m/s]; `site`: where it stood, the latitude must be known.
    Raises a wrong unit, axis or sign explains what the data contradict.
    """
    from foucault.navigate.align import measured_errors  # few rests are alignments

    assert site.latitude is not None
    f, w, noise = measured_errors(increments, sensors)
    cov = noise.mean_cov(float(increments.dt.sum()))
    f_sd, w_sd = (float(np.sqrt(np.diag(each).max())) for each in cov)
    interval = float(np.median(increments.dt))
    told: tuple[Finding, ...] = ()
    seen, given = float(np.linalg.norm(f)), site.gravity
    if (problem := wrong_force(seen, given, interval)) is not None:
        raise problem
    if abs(seen - given) > max(OFF_GRAVITY * given, SURE * f_sd):
        told = (finding("alignment.gravity", seen=f"{seen:.5g}", given=f"{given:.5g}",
                        off=f"{100 * (seen / given - 1):+.2g}"),)  # fmt: skip
    if SURE * w_sd > EARTH_RATE:
        return told  # the Earth's rate does not stand out
    _unit_of_rate(f, w, w_sd, site.latitude, interval)
    return told + _along_up(f, w, w_sd, float(np.hypot(w_sd, np.linalg.norm(w) * f_sd / given)),
                            site.latitude)  # fmt: skip


def _unit_of_rate(
    f: FloatArray, w: FloatArray, w_sd: float, latitude: float, interval: float
) -> None:
    """Refuse a unit by which the rate is the Earth's, in size and along up."""
    size, up = float(np.linalg.norm(w)), f / np.linalg.norm(f)
    if abs(size - EARTH_RATE) < max(RATE_BAND * EARTH_RATE, SURE * w_sd):
        return
    known = factors("gyro", interval)
    ratio = min(known, key=lambda k: abs(np.log(max(size, 1e-300) / EARTH_RATE / k)))
    # A unit changes what lies along up as much; a bias of that size hardly does.
    off = max(abs(size / ratio - EARTH_RATE),
              abs(abs(up @ w) / ratio - EARTH_RATE * abs(np.sin(latitude))))  # fmt: skip
    if off < RATE_BAND * EARTH_RATE:
        raise error("alignment.gyro_unit", given=_dph(size), earth=_dph(EARTH_RATE),
                    factor=f"{1 / ratio:.4g}", then=_dph(size / ratio),
                    cause=known[ratio])  # fmt: skip


def _along_up(
    f: FloatArray, w: FloatArray, w_sd: float, sd: float, latitude: float
) -> tuple[Finding, ...]:
    """Check f . w against g w_ie sin L, with its standard deviation `sd` [rad/s]."""
    from foucault.navigate.align import latitude_seen

    up, size = f / np.linalg.norm(f), float(np.linalg.norm(w))
    seen, wanted = float(up @ w), float(EARTH_RATE * np.sin(latitude))
    if abs(seen - wanted) < SURE * sd:
        return ()
    words = {"given": _dph(seen), "wanted": _dph(wanted), "sd": _dph(sd)}
    whole = abs(size - EARTH_RATE) < SURE * w_sd
    # Biases that nobody declared are small against the Earth's rate where its sign is turned.
    clear = min(abs(wanted), size) > RATE_BAND * EARTH_RATE > abs(size - EARTH_RATE)
    near = SURE * sd if whole else RATE_BAND * abs(wanted) if clear else 0.0
    if abs(seen + wanted) < near:
        raise error("alignment.vertical_sign", **words)
    if not whole:
        return (finding("alignment.earth_rate", given=_dph(size), vertical=_dph(seen),
                        earth=_dph(EARTH_RATE), wanted=_dph(wanted), sd=_dph(sd)),)  # fmt: skip
    shown = latitude_seen(f, w)
    fits = [x for x in exchanges()[1:] if abs(up @ x @ w - wanted) < SURE * sd]
    if fits and abs(seen - wanted) > GROSS * EARTH_RATE:
        more = "".join(f", or {exchange_words(x)}" for x in fits[1:SHOWN])
        more += f", and {len(fits) - SHOWN} more" if len(fits) > SHOWN else ""
        raise error("alignment.axes", exchange=exchange_words(fits[0]), more=more,
                    latitude=f"{abs(np.degrees(shown)):.2f}", **words)  # fmt: skip
    # Of reversed gyros a calibration takes the biases off the wrong way, so that they are twice.
    if clear and abs(seen + wanted) < RATE_BAND * abs(wanted):
        raise error("alignment.vertical_sign", **words)
    level = EARTH_RATE * max(np.cos(shown), NEAR_POLE)
    return (finding("alignment.latitude", seen=f"{np.degrees(shown):.2f}",
                    sd=f"{np.degrees(sd / level):.2g}",
                    declared=f"{np.degrees(latitude):.2f}"),)  # fmt: skip


def _dph(rate: float) -> str:
    return f"{convert(rate, 'angular rate', 'deg/h'):.4g}"
