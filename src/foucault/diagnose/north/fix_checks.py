"""Judge north fixes: gross mistakes of readings, checks of every set-up, what to do next."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.north.noise import signal_to_noise
from foucault.diagnose.words import check
from foucault.errors import Finding, finding
from foucault.estimate.chi_square import chi_square_limits
from foucault.estimate.north.attitude import Fixes, Known, solve
from foucault.estimate.north.reduction import Pairs
from foucault.models.dwells import Dwells
from foucault.models.earth import EARTH_RATE
from foucault.models.noise import ImuNoise
from foucault.models.north_seeker import Compensation
from foucault.models.rotation import turned
from foucault.result import Check, Level
from foucault.units import plain

SEES = 3.0
"""Horizontal Earth rate over its sd below which heading is guesswork [1]."""

TESTS = 4
"""Statistical tests of a set-up, which share its false alarms: scatter of gyro and accelerometer,
rate and latitude, level [1]."""

FAR_OUT = 6.0
"""A set-up whose readings scatter by more than this was disturbed [sd]."""

STEEP = np.radians(89.5)
"""At a tilt beyond this heading is hardly defined [rad]."""


@dataclass(frozen=True)
class Judged:
    """What the judgement looks at."""

    dwells: Dwells  # readings [SI]
    pairs: Pairs  # four numbers of every set-up [SI]
    fixes: Fixes  # solutions [rad]
    known: Known  # place, and what decided between solutions
    noise: ImuNoise  # noise that was taken [SI]
    noise_source: str  # where it comes from
    accuracy: float | None  # wanted standard deviation of the heading [rad]
    # (m,) how far the accelerometers depart from level, of `level_square` [1]; None where there are
    # none, or nothing was said of the level
    level: FloatArray | None = None


def checks(j: Judged, calibration: Level | None) -> tuple[tuple[Check, ...], ...]:
    """Return the tests of every set-up.

    `calibration` or None: verdict of the calibration that was used.
    """
    ratio = signal_to_noise(j.fixes, j.pairs)
    shared: list[Check] = []
    if j.noise_source != "from the residuals" and len(j.fixes) > 1:
        shared = [c for k in (0, 1) if (c := _scatter_of_all(j, k)) is not None]
    return tuple(_checks(j, i, float(ratio[i]), calibration, shared) for i in range(len(j.fixes)))


def _checks(
    j: Judged, i: int, ratio: float, calibration: Level | None, shared: list[Check]
) -> tuple[Check, ...]:
    if not np.isfinite(j.fixes.angles[i]).all():
        return (_solved(j, i),)
    out = [_solved(j, i), _sees(ratio)]
    if j.noise_source != "from the residuals":
        out += [c for k in (0, 1) if (c := _scatter(j, i, k)) is not None] + shared
    elif (fitting := _fitting(j, i)) is not None:
        out.append(fitting)
    if j.known.latitude is not None:
        out.append(_norm(j, i))
    if j.level is not None:
        out.append(_level(float(j.level[i])))
    out.append(_ambiguous(j, i))
    out.append(_upright(j, i))
    if j.accuracy is not None:
        out.append(_accurate(float(j.fixes.sd[i, 0]), j.accuracy))
    if calibration is not None and calibration is not Level.PASS:
        given = {"level": calibration.value}
        out.append(check("calibration used", "calibration", 0.0, 1.0, None, given,
                         fails=calibration))  # fmt: skip
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
    given = {"advice": words}
    return check("converged", "solved", float(fine), 1.0, None, given, fails=Level.UNUSABLE)


def _sees(ratio: float) -> Check:
    factor = SEES / max(ratio, 1e-9)
    given = {"ratio": plain(ratio, 3), "factor": factor, "times": factor**2}
    name = "sees the Earth"
    return check(name, name, ratio, SEES, None, given, fails=Level.UNUSABLE)


def _scatter(j: Judged, i: int, sensor: int) -> Check | None:
    dof, value = int(j.pairs.dof[i, sensor]), float(j.pairs.chi_square[i, sensor])
    what = ("gyro", "accelerometer")[sensor]
    then = ": a disturbance, a drift, too few digits, or more noise than was said."
    return _noise(j, sensor, f"{what} over index angle", f"the {what}", value, dof, then)


def _scatter_of_all(j: Judged, sensor: int) -> Check | None:
    """Test all set-ups together, but those far out: a little too much noise in each."""
    dof, value = j.pairs.dof[:, sensor], j.pairs.chi_square[:, sensor]
    usual = (dof > 0) & (value <= FAR_OUT**2 * dof)
    total, n = float(value[usual].sum()), int(dof[usual].sum())
    name = ("gyro", "accelerometer")[sensor] + " over all set-ups"
    then = ": there is more noise than was said, or the bias wanders."
    return None if n < 2 else _noise(j, sensor, name, f"the {name}", total, n, then)


def _noise(
    j: Judged, sensor: int, name: str, what: str, value: float, dof: int, then: str
) -> Check | None:
    if dof < 1 or (sensor == 1 and not j.noise.accel.white):
        return None
    given = {"what": what, "ratio": np.sqrt(value / dof), "dof": dof, "then": then}
    return check("noise", name, value, None, chi_square_limits(dof, tests=TESTS)[1], given)


def _norm(j: Judged, i: int) -> Check:
    value, high = float(j.fixes.square[i]), chi_square_limits(1, tests=TESTS)[1]
    name = "rate and latitude"
    return check(name, name, value, None, high, {"sd": np.sqrt(value)})


def _level(value: float) -> Check:
    given = {"what": "case", "ratio": np.sqrt(value / 2)}
    return check("level", "level", value, None, chi_square_limits(2, tests=TESTS)[1], given)


def _ambiguous(j: Judged, i: int) -> Check:
    heading, latitude = np.degrees(j.fixes.other[i, [0, 3]])
    given = {"heading": heading, "latitude": latitude}
    fine = float(not j.fixes.ambiguous[i])
    return check("one heading", "one heading", fine, 1.0, None, given)


def _upright(j: Judged, i: int) -> Check:
    _, pitch, roll, _ = j.fixes.angles[i]
    tilt = np.arccos(np.clip(np.cos(pitch) * np.cos(roll), -1.0, 1.0))
    return check("tilt", "tilt", float(np.degrees(tilt)), None, float(np.degrees(STEEP)))


def _accurate(sd: float, wanted: float) -> Check:
    return check("accuracy", "accuracy", float(np.degrees(sd)), None, float(np.degrees(wanted)))


def findings(j: Judged) -> tuple[tuple[Finding, ...], ...]:
    """Return what was noticed of every set-up."""
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
    if j.known.near is not None:
        near = np.broadcast_to(j.known.near, len(f))[i]
        away = abs(float(turned(f.angles[i, 0] - near)))
        if away > 3 * j.known.near_sd:
            found.append(finding("north.far", name=name, away=f"{np.degrees(away):.0f}"))
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
            f"sources, most of all '{largest}'."
        )
    dwell = float(np.median(j.dwells.of(i).time)) * float(white) / room
    return f"Dwell at least {dwell:.0f} s at each stop, with the same order."


def _worst(j: Judged, i: int) -> tuple[int, float, float] | None:
    """Return the reading that fits worst: its row, its test over the limit, and its size [sd].

    Noise measured by the residuals of the file is measured anew without it.
    """
    from scipy.special import fdtri

    rows = np.flatnonzero(j.dwells.setup == i)
    total = int(j.pairs.dof[:, 0].sum())
    if j.pairs.dof[i, 0] < 1:
        return None
    square = np.nan_to_num(j.pairs.residuals[rows]) ** 2
    limit = chi_square_limits(1, tests=len(rows))[1]
    if j.noise_source == "from the residuals":
        square = square * total / (total - 2.0)  # as it was before Student's factor
        square = square * (total - 1.0) / np.maximum(total - square, 1e-9)
        limit = float(fdtri(1.0, total - 1.0, 1 - 0.01 / len(j.dwells)))
    worst = int(np.argmax(square))
    return int(rows[worst]), float(square[worst] / limit), float(np.sqrt(square[worst]))


def _fitting(j: Judged, i: int) -> Check | None:
    found = _worst(j, i)
    if found is None:
        return None
    given = {"what": "reading", "size": found[2]}
    return check("worst", "every reading fits", found[1], None, 1.0, given)


def _outlier(j: Judged, i: int) -> list[Finding]:
    """Name the reading that stands out; with one redundant reading all look alike."""
    found = _worst(j, i)
    if found is None or found[1] <= 1 or j.pairs.dof[i, 0] < 2:
        return []
    stop = f"{np.degrees(j.dwells.index[found[0]]) % 360:.1f}"
    return [finding("north.reading_outlier", name=j.dwells.names[i], stop=stop,
                    size=f"{found[2]:.1f}")]  # fmt: skip


def drift_effect(
    pairs: Pairs, fixes: Fixes, known: Known, compensation: Compensation, drift: float
) -> FloatArray:
    """Return what a linear drift that is not estimated does to each heading, shape (m,) [rad].

    `pairs`: set-ups, with what a drift does to the four numbers [SI]; `fixes`: their solutions
    [rad]; `drift`: [rad/s^2].
    """
    near = np.where(np.isfinite(fixes.angles[:, 0]), fixes.angles[:, 0], 0.0)
    step = 1e-3 * drift
    moved = replace(pairs, values=pairs.values + step * pairs.drift_slope)
    again = solve(moved, known, compensation)
    return np.asarray(turned(again.angles[:, 0] - near) / 1e-3)
