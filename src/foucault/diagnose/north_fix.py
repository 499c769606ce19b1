"""Judge north fixes: gross mistakes of readings, checks of every set-up, what to do next."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from foucault.diagnose.north_noise import signal_to_noise
from foucault.errors import Finding, error, finding
from foucault.estimate.chi_square import chi_square_limits
from foucault.estimate.north_reduction import UNSEEN, Pairs
from foucault.estimate.north_seeking import Fixes, Known, compensated, solve, turned
from foucault.models.dwells import Dwells
from foucault.models.earth import EARTH_RATE
from foucault.models.noise import ImuNoise
from foucault.models.north_seeker import Compensation
from foucault.result import Check, Level

FloatArray = npt.NDArray[np.float64]

TOO_FAST = 1.5
"""Horizontal rate, in Earth rates, that no noise within reason gives [1]."""

MANY_SD = 6.0
"""What differs by so many standard deviations is no noise [1]."""

SEES = 3.0
"""Horizontal Earth rate over its sd below which heading is guesswork [1]."""

STEEP = np.radians(89.5)
"""At a tilt beyond this heading is hardly defined [rad]."""

SAME = np.radians(1.0)
"""Index angles nearer than this are one stop [rad]."""


@dataclass(frozen=True)
class Judged:
    """What the judgement looks at.

    Attributes
    ----------
    dwells : Dwells
        Readings [SI].
    pairs : Pairs
        Four numbers of every set-up [SI].
    fixes : Fixes
        Solutions [rad].
    known : Known
        Place, and what decided between solutions.
    noise : ImuNoise
        Noise that was taken [SI].
    noise_source : str
        Where it comes from.
    accuracy : float or None
        Wanted standard deviation of the heading [rad].
    """

    dwells: Dwells
    pairs: Pairs
    fixes: Fixes
    known: Known
    noise: ImuNoise
    noise_source: str
    accuracy: float | None


def stops(dwells: Dwells, known: Known) -> tuple[Finding, ...]:
    """Look at the index angles of every set-up: missing, repeated, too few.

    Parameters
    ----------
    dwells : Dwells
        Readings [SI].
    known : Known
        A rough heading and how level the case stands, if they were given.

    Raises
    ------
    FoucaultError
        ``north.stops`` and ``north.stops_tilt`` where they do not show the heading or the tilt.
    """
    patterns = [_pattern(dwells.of(i)) for i in range(len(dwells.names))]
    found: list[Finding] = []
    for name, angles in zip(dwells.names, patterns, strict=True):
        distinct = sorted(set(angles))
        if not _spans(distinct):
            if known.near is None:
                raise error("north.stops", name=name, stops=_list(distinct))
            on_base = dwells.accel is not None and dwells.accel.shape[1] == 1
            if on_base and known.level_sd is None:
                raise error("north.stops_tilt", name=name, stops=_list(distinct))
        found += _opposites(name, angles, distinct) if len(angles) < 24 else []
    usual, times = Counter(map(tuple, map(sorted, patterns))).most_common(1)[0]
    if times > 1 and times > len(patterns) / 2:
        for name, angles in zip(dwells.names, patterns, strict=True):
            if len(angles) != len(usual):
                found.append(
                    finding("north.stops_differ", name=name, given=len(angles),
                            angles=_list(angles), most=len(usual))
                )  # fmt: skip
    return tuple(found)


def _pattern(d: Dwells) -> list[int]:
    """Return the index angles of a set-up in order, in whole degrees."""
    return [round(float(np.degrees(a))) % 360 for a in d.index]


def _list(angles: list[int]) -> str:
    some = ", ".join(str(a) for a in angles[:12])
    return some + (", ..." if len(angles) > 12 else "")


def _spans(angles: list[int]) -> bool:
    """Tell whether constant, cosine and sine over these angles can be told apart."""
    a = np.radians(np.array(angles, float))
    design = np.stack([np.ones_like(a), np.cos(a), np.sin(a)], 1)
    return len(a) >= 3 and bool(np.linalg.svd(design, compute_uv=False)[-1] > 0.05)


def _opposites(name: str, angles: list[int], distinct: list[int]) -> list[Finding]:
    found = []
    for stop in distinct:
        missing = (stop + 180) % 360
        if not any(abs((a - missing + 180) % 360 - 180) <= 2 for a in distinct):
            found.append(finding("north.opposite_missing", name=name, stop=stop, missing=missing))
            break
    twice = [a for a, b in pairwise(angles) if a == b]
    if twice and len(set(Counter(angles).values())) > 1:  # a palindrome has each as often
        rest = _list([a for a in distinct if a != twice[0]])
        found.append(finding("north.stop_repeated", name=name, stop=twice[0], other=rest))
    return found


def require_plausible(
    dwells: Dwells, pairs: Pairs, known: Known, compensation: Compensation
) -> None:
    """Refuse more than the Earth's rate, and more than gravity.

    Parameters
    ----------
    dwells : Dwells
        For the names of the set-ups.
    pairs : Pairs
        Set-ups [SI].
    known : Known
        Gravity.
    compensation : Compensation
        Errors of the instrument.
    """
    numbers = compensated(pairs.values, known.gravity, compensation)
    cov = pairs.cov
    for axes, limit, size, code in (
        (slice(0, 2), TOO_FAST, EARTH_RATE, "north.too_fast"),
        (slice(2, 4), 1.0, known.gravity, "north.tilt"),
    ):
        length = np.linalg.norm(numbers[:, axes], axis=1)
        sd = np.sqrt(np.einsum("nii->n", cov[:, axes, axes])) / size
        wrong = np.flatnonzero((length - limit > MANY_SD * sd) & (sd < np.sqrt(UNSEEN) * 1e-2))
        if len(wrong):
            worst = int(wrong[np.argmax(length[wrong])])
            raise error(code, name=dwells.names[worst], size=f"{length[worst]:.4g}")


def checks(j: Judged, calibration: Level | None) -> tuple[tuple[Check, ...], ...]:
    """Return the tests of every set-up.

    Parameters
    ----------
    j : Judged
        Readings and solutions.
    calibration : Level or None
        Verdict of the calibration that was used.
    """
    ratio = signal_to_noise(j.fixes)
    return tuple(_checks(j, i, float(ratio[i]), calibration) for i in range(len(j.fixes)))


def _checks(j: Judged, i: int, ratio: float, calibration: Level | None) -> tuple[Check, ...]:
    out = [_solved(j, i), _sees(ratio, bool(j.fixes.clamped[i]))]
    if j.noise_source != "from the residuals":
        out += [c for k in (0, 1) if (c := _scatter(j, i, k)) is not None]
    if j.known.latitude is not None and j.known.level_sd is None:
        out.append(_norm(j, i))
    out.append(_ambiguous(j, i))
    out.append(_upright(j, i))
    if j.accuracy is not None:
        out.append(_accurate(j, i))
    if calibration is not None and calibration is not Level.PASS:
        words = f"The calibration that was used is {calibration.value}."
        out.append(Check("calibration", 0.0, 1.0, None, False, words, calibration))
    return tuple(out)


def _solved(j: Judged, i: int) -> Check:
    status, finite = int(j.fixes.status[i]), bool(np.isfinite(j.fixes.angles[i]).all())
    fine = status in (0, 1) and finite
    words = {
        0: "The solution converged.",
        1: "The rate along the axis of the base is lost in the noise: both its signs are covered "
        "by the uncertainty.",
        2: "The solution did not settle.",
        3: "The readings do not determine the attitude.",
    }.get(status, "A reading is not a finite number.")
    return Check("solved", float(fine), 1.0, None, fine, words, Level.UNUSABLE)


def _sees(ratio: float, clamped: bool) -> Check:
    fine = ratio >= SEES
    words = f"The Earth's horizontal rate is {ratio:.3g} times the uncertainty of the rates"
    if not fine:
        words += (
            f": the gyro is too noisy by a factor of {SEES / max(ratio, 1e-9):.2g}; dwell "
            f"{(SEES / max(ratio, 1e-9)) ** 2:.2g} times as long, or take a better gyro"
        )
    return Check("sees the Earth", ratio, SEES, None, fine, words + ".", Level.UNUSABLE)


def _scatter(j: Judged, i: int, sensor: int) -> Check | None:
    dof = int(j.pairs.dof[i, sensor])
    if dof < 1 or (sensor == 1 and not j.noise.accel.white):
        return None
    value = float(j.pairs.chi_square[i, sensor])
    _, high = chi_square_limits(dof, tests=2)
    fine = value <= high
    what = ("gyro", "accelerometer")[sensor]
    words = f"The readings of the {what} scatter by {np.sqrt(value / dof):.2f} times their noise"
    words += "." if fine else ": a disturbance, a drift, or more noise than was said."
    return Check(f"{what} over index angle", value, None, high, fine, words)


def _norm(j: Judged, i: int) -> Check:
    value, high = float(j.fixes.square[i]), chi_square_limits(1)[1]
    fine = value <= high
    words = f"The Earth's rate as measured fits the latitude to {np.sqrt(value):.2f} sd"
    if not fine:
        words += ": latitude, scale factor or sign of the accelerometer are wrong"
    return Check("rate and latitude", value, None, high, fine, words + ".")


def _ambiguous(j: Judged, i: int) -> Check:
    fine = not bool(j.fixes.ambiguous[i])
    words = "No other heading fits." if fine else (
        f"Heading {np.degrees(j.fixes.other[i, 0]):.3f} deg fits as well."
    )  # fmt: skip
    return Check("one heading", float(fine), 1.0, None, fine, words)


def _upright(j: Judged, i: int) -> Check:
    _, pitch, roll, _ = j.fixes.angles[i]
    tilt = float(np.arccos(np.clip(np.cos(pitch) * np.cos(roll), -1.0, 1.0)))
    fine = tilt < STEEP
    words = f"The tilt is {np.degrees(tilt):.2f} deg"
    words += "." if fine else ": heading is hardly defined there."
    limit = float(np.degrees(STEEP))
    return Check("tilt", float(np.degrees(tilt)), None, limit, fine, words)


def _accurate(j: Judged, i: int) -> Check:
    assert j.accuracy is not None
    sd = float(j.fixes.sd[i, 0])
    fine = sd <= j.accuracy
    words = f"The heading has a standard deviation of {np.degrees(sd):.4g} deg"
    words += "." if fine else f"; {np.degrees(j.accuracy):.4g} deg was wanted."
    return Check("accuracy", float(np.degrees(sd)), None, float(np.degrees(j.accuracy)), fine,
                 words)  # fmt: skip


def findings(j: Judged) -> tuple[tuple[Finding, ...], ...]:
    """Return what was noticed of every set-up.

    Parameters
    ----------
    j : Judged
        Readings and solutions.
    """
    return tuple(tuple(_findings(j, i)) for i in range(len(j.fixes)))


def _findings(j: Judged, i: int) -> list[Finding]:
    name, f = j.dwells.names[i], j.fixes
    found = []
    if f.ambiguous[i]:
        other, latitude = np.degrees(f.other[i, [0, 3]])
        found.append(finding("north.ambiguous", name=name, other=f"{other:.3f}",
                             latitude=f"{latitude:.2f}"))  # fmt: skip
    if f.clamped[i] and j.known.latitude is None:
        size = np.linalg.norm(j.pairs.values[i, :2]) / EARTH_RATE
        found.append(finding("north.clamped", name=name, size=f"{size:.4f}"))
    if j.accuracy is not None and not f.sd[i, 0] <= j.accuracy:
        sd, wanted = (f"{np.degrees(v):.4g}" for v in (f.sd[i, 0], j.accuracy))
        cure = _longer(j, i)
        found.append(finding("north.dwell_short", name=name, sd=sd, wanted=wanted, cure=cure))
    return found + _outlier(j, i)


def _longer(j: Judged, i: int) -> str:
    """Say how long to dwell, where that helps."""
    assert j.accuracy is not None
    white = sum(v[i, 0] for k, v in j.fixes.sources.items() if k in ("gyro noise", "tilt: noise"))
    rest = float(j.fixes.cov[i, 0, 0] - white)
    room = j.accuracy**2 - rest
    if room <= 0:
        sources = {k: v[i, 0] for k, v in j.fixes.sources.items() if "noise" not in k}
        largest = max(sources, key=lambda k: float(sources[k]))
        return (
            f"Longer dwells do not help: {np.degrees(np.sqrt(rest)):.4g} deg come from other "
            f"sources, most of all {largest}."
        )
    dwell = float(np.median(j.dwells.of(i).time)) * float(white) / room
    return f"Dwell at least {dwell:.0f} s at each stop, with the same order."


def _outlier(j: Judged, i: int) -> list[Finding]:
    """Name the reading that stands out; with one redundant reading all look alike."""
    rows = np.flatnonzero(j.dwells.setup == i)
    if j.pairs.dof[i, 0] < 2 or j.noise_source == "from the residuals":
        return []
    size = np.abs(np.nan_to_num(j.pairs.residuals[rows]))
    worst = int(np.argmax(size))
    if size[worst] ** 2 <= chi_square_limits(1, tests=len(rows))[1]:
        return []
    stop = f"{np.degrees(j.dwells.index[rows[worst]]) % 360:.1f}"
    return [finding("north.reading_outlier", name=j.dwells.names[i], stop=stop,
                    size=f"{size[worst]:.1f}")]  # fmt: skip


def drift_effect(
    pairs: Pairs, fixes: Fixes, known: Known, compensation: Compensation, drift: float
) -> FloatArray:
    """Return what a linear drift that is not estimated does to each heading, shape (m,) [rad].

    Parameters
    ----------
    pairs : Pairs
        Set-ups, with what a drift does to the four numbers [SI].
    fixes : Fixes
        Their solutions [rad].
    known : Known
        Place.
    compensation : Compensation
        Errors of the instrument.
    drift : float
        [rad/s^2].
    """
    near = np.where(np.isfinite(fixes.angles[:, 0]), fixes.angles[:, 0], 0.0)
    step = 1e-3 * drift
    moved = replace(pairs, values=pairs.values + step * pairs.drift_slope)
    again = solve(moved, known, compensation)
    return np.asarray(turned(again.angles[:, 0] - near) / 1e-3)
