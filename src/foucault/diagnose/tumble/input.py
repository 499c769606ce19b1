"""What is wrong with the log of a tumble, found before anything is estimated."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.diagnose.tumble.motion import motion_findings as motion_findings
from foucault.diagnose.tumble.motion import nearest
from foucault.errors import Finding, error, finding
from foucault.estimate.chi_square import FALSE_ALARM
from foucault.models.cluster import attitude_of
from foucault.models.earth import EARTH_RATE, Site
from foucault.plans.tumble.torquing import Nominal, TorquingPlan
from foucault.tables import AXES, Log

WRONG_SIZE = 0.05
"""Readings whose mean size is this far from gravity have a wrong unit [1]."""

WRONG_WAY = np.radians(120.0)
"""First readings that point this far from where the start puts up are reversed [rad]."""

LONG = 1.5
"""An interval longer than this many usual ones has lost rows [1]."""

STEP = 0.01
"""A change of the command by more than this, over its largest size, is a step [1]."""

ROUGHNESS = float(np.sqrt(70.0)) / 6.0
"""Sd of a reading less what its four neighbours predict, over that of a reading [1]."""

MANY = 0.1
"""Where more readings than this jump, that is how they are [1]."""

ROUNDS = 5
"""Times that outlying readings are sought beside those that were found [1]."""

SHIFTED = 120
"""A command is searched for so many steps of its plan, earlier and later [1]."""


def require_readings(log: Log, site: Site, rate_limit: float | None) -> None:
    """Refuse a log without command, accelerometers, latitude, or with impossible values.

    `log`: command in the gyro columns, and readings [SI]; `rate_limit` or None: largest rate
    about an axis that the rig allows [rad/s].
    """
    if log.accel is None:
        raise error("tumble.no_accel")
    if log.gyro is None:
        raise error("tumble.no_command", what="[log.gyro] is missing")
    lost = ~np.isfinite(log.gyro).all(axis=1)
    if lost.any():
        first = int(np.argmax(lost))
        what = f"{int(lost.sum())} rows, the first at {log.time[first]:.6g} s"
        raise error("tumble.no_command", what=what)
    if site.latitude is None:
        raise error("tumble.no_latitude")
    fastest = float(np.abs(log.gyro).max(initial=0.0))
    if fastest < 3 * EARTH_RATE:
        raise error("tumble.still", given=f"{np.degrees(fastest) * 3600:.3g}")
    if rate_limit is not None and fastest > rate_limit * 1.05:
        row, axis = divmod(int(np.argmax(np.abs(log.gyro))), 3)
        raise error(
            "tumble.rate_limit", time=f"{log.time[row]:.6g}", axis=AXES[axis],
            given=f"{np.degrees(fastest):.4g}", limit=f"{np.degrees(rate_limit):.4g}",
        )  # fmt: skip


def require_gravity(log: Log, site: Site, start: FloatArray) -> None:
    """Refuse readings that have not the size of gravity, or point down.

    `log`: command and readings [SI]; `start` (3,): outer, middle and inner angle at the first
    row, as believed [rad].
    """
    assert log.accel is not None
    good = log.accel[np.isfinite(log.accel).all(axis=1)]
    if len(good) == 0:
        return  # too short, which is said elsewhere
    size = float(np.median(np.linalg.norm(good, axis=1)))
    if abs(size / site.gravity - 1) > WRONG_SIZE:
        raise error(
            "tumble.gravity", given=f"{size:.5g}", gravity=f"{site.gravity:.5f}",
            likely=_likely_unit(size / site.gravity, log.interval),
        )  # fmt: skip
    up = attitude_of(start)[:, 2]
    first = good[: max(1, round(1.0 / log.interval))].mean(axis=0)
    away = float(np.arccos(np.clip(up @ first / np.linalg.norm(first), -1, 1)))
    if away > WRONG_WAY:
        raise error("tumble.sign", angle=f"{np.degrees(away):.0f}")


_SIZES = {
    9.80665: "m/s^2 was taken for g",
    1 / 9.80665: "g was taken for m/s^2",
    1e-3: "g was taken for mg",
    1e3: "mg was taken for g",
    1e3 / 9.80665: "mg was taken for m/s^2",
    1e6 / 9.80665: "ug was taken for m/s^2",
}


def _likely_unit(factor: float, interval: float) -> str:
    known = {interval: 'increments are no readings: give kind = "increment"'} | _SIZES
    return nearest(known, factor, "the unit or the count scale")


def plan_findings(
    log: Log, plan: TorquingPlan, told: Nominal, from_its_time: bool
) -> list[Finding]:
    """Compare the command of a log with that of its plan.

    `log`: command in the gyro columns [SI]; `from_its_time`: whether the command of a row begins
    at its time.
    """
    assert log.gyro is not None
    out = []
    step = float(told.time[1] - told.time[0])
    if abs(log.duration - plan.duration) > 2 * max(step, log.interval):
        out.append(
            finding(
                "tumble.plan_time", given=f"{log.duration:.6g}", wanted=f"{plan.duration:.6g}",
                name=plan.name,
            )
        )  # fmt: skip
    since = log.time[:-1] - log.time[0]
    command = log.gyro[:-1] if from_its_time else log.gyro[1:]
    inside = since < told.time[-1] - 1e-9
    since, command = since[inside], command[inside]
    wanted = told.command[np.searchsorted(told.time, since + 1e-9, side="right") - 1]
    miss = np.linalg.norm(command - wanted, axis=1)
    miss[_between(since, plan, max(step, _hold(log)))] = 0.0
    fastest = float(np.abs(told.command).max())
    rms = float(np.sqrt(np.mean(miss**2)))
    if rms > 0.02 * fastest:
        each = max(1, round(step / log.interval))
        late = _shift(command[::each], wanted[::each]) * each * log.interval
        more = "" if late == 0 else f" It fits when shifted by {late:.6g} s."
        out.append(
            finding(
                "tumble.plan_other", name=plan.name, given=f"{np.degrees(rms) * 3600:.3g}",
                time=f"{log.time[int(np.argmax(miss))]:.6g}", more=more,
            )
        )  # fmt: skip
    return out


def _hold(log: Log) -> float:
    """How long a command is held, judged by how often it changes [s]."""
    assert log.gyro is not None
    changes = log.time[1:][np.any(np.diff(log.gyro, axis=0) != 0, axis=1)]
    return float(np.median(np.diff(changes))) if len(changes) > 1 else log.interval


def _between(since: FloatArray, plan: TorquingPlan, hold: float) -> npt.NDArray[np.bool_]:
    """Return where the rate of a plan changes: commands held otherwise are others there."""
    last = np.searchsorted(plan.ends, since + hold, side="right") - 1
    return np.asarray(since < plan.ends[last] + plan.ramp + hold)


def _shift(command: FloatArray, wanted: FloatArray) -> int:
    """Return by how many rows the command is later than wanted, 0 where no shift explains it."""
    most = min(len(command) // 4, SHIFTED)

    def miss(k: int) -> float:
        a, b = (command[k:], wanted[: len(wanted) - k]) if k >= 0 else (command[:k], wanted[-k:])
        return float(np.mean((a - b) ** 2))

    best = min(range(-most, most + 1), key=miss)
    return best if miss(best) < 0.05 * miss(0) else 0


def gap_findings(log: Log) -> list[Finding]:
    """Tell of intervals in which the command is not known.

    `log`: command and readings [SI].
    """
    assert log.gyro is not None
    dt, limit = np.diff(log.time), LONG * log.interval
    long = np.flatnonzero(dt > limit)
    if len(long) == 0:
        return []
    change = np.linalg.norm(log.gyro[long + 1] - log.gyro[long], axis=1)
    lost = long[change > STEP * np.linalg.norm(log.gyro, axis=1).max()]
    if len(lost):
        time, after = log.time[lost[0]], log.time[lost[0] + 1]
        raise error("tumble.gap_command", time=f"{time:.6g}", after=f"{after:.6g}")
    worst = int(long[np.argmax(dt[long])])
    return [
        finding(
            "tumble.gap", count=len(long), limit=f"{limit:.3g}", longest=f"{dt[worst]:.4g}",
            time=f"{log.time[worst]:.6g}",
        )
    ]  # fmt: skip


def edges(time: FloatArray, command: FloatArray, after: float) -> npt.NDArray[np.bool_]:
    """Return which intervals end within `after` [s] of a step of the command, shape (n,).

    `time` (n + 1,): of the rows [s]; `command` (n, 3): rate commanded in every interval [rad/s];
    `after`: how long the angular acceleration of a step may last [s].
    """
    step = np.linalg.norm(np.diff(command, axis=0, prepend=np.zeros((1, 3))), axis=1)
    steps = time[:-1][step > STEP * np.linalg.norm(command, axis=1).max()]
    out: npt.NDArray[np.bool_] = np.zeros(len(command), bool)
    first = np.searchsorted(time[1:], steps - 1e-9, side="right")
    last = np.searchsorted(time[1:], steps + after + 1e-9, side="right")
    for a, b in zip(first, last, strict=True):
        out[a:b] = True
    return out


def outlying(log: Log, sd: float) -> npt.NDArray[np.bool_]:
    """Find rows whose readings jump farther from their neighbours than any would by chance, (n,).

    A cubic through two neighbours on either side, at the ends through four on one, predicts a
    reading; a command that steps bends the readings, by no
    more than a third of the step times gravity and the interval.

    `log`: command, and readings that move slowly against their rate [SI]; `sd`: of a reading by
    its noise: what is less is no jump [m/s^2].
    """
    from scipy.interpolate import CubicSpline
    from scipy.special import ndtri

    assert log.accel is not None and log.gyro is not None
    n = len(log)
    out: npt.NDArray[np.bool_] = np.zeros(n, bool)
    if n < 50:
        return out
    step = np.linalg.norm(np.diff(log.gyro, axis=0), axis=1)
    stepped = np.flatnonzero(step > STEP * np.linalg.norm(log.gyro, axis=1).max())
    bent = np.zeros(n)
    for k in range(-3, 5):
        at = np.clip(stepped + k, 0, n - 1)
        bent[at] += 0.5 * step[stepped] * float(np.nanmedian(np.linalg.norm(log.accel, axis=1)))
    allowed = bent[:, None] * log.interval
    x = log.accel.copy()
    missing = ~np.isfinite(x).all(axis=1)
    limit = -float(ndtri(FALSE_ALARM / (2 * 3 * n)))
    for _ in range(ROUNDS):
        if out.any():  # what is found is not to hide what is beside it
            good = ~(missing | out)
            x[out] = CubicSpline(log.time[good], log.accel[good])(log.time[out])
        rough = np.full(x.shape, np.nan)
        rough[2:-2] = x[2:-2] - (4 * (x[1:-3] + x[3:-1]) - x[:-4] - x[4:]) / 6
        for a, b in (((0, 1), 1), ((n - 1, n - 2), -1)):
            for k in a:
                ends = 4 * x[k + b] - 6 * x[k + 2 * b] + 4 * x[k + 3 * b] - x[k + 4 * b]
                rough[k] = (x[k] - ends) / 6  # which scatters as much
        rough = np.sign(rough) * np.maximum(np.abs(rough) - allowed, 0.0)
        seen = np.isfinite(rough).all(axis=1)
        if np.count_nonzero(seen) < 50:
            return np.zeros(n, bool)
        spread = np.maximum(1.4826 * np.median(np.abs(rough[seen]), axis=0), ROUGHNESS * sd)
        size = np.max(np.abs(rough) / np.maximum(spread, 1e-300), axis=1)
        size = np.where(seen, size, 0.0)
        around = np.max([np.roll(size, k) for k in (-2, -1, 1, 2)], axis=0)
        new = (size > limit) & (size > around)  # its neighbours are predicted from it
        for ends in (slice(0, 3), slice(n - 3, n)):  # which of them it is does not show there
            new[ends] = size[ends].max() > limit
        new &= ~out
        if not new.any():
            break
        out |= new
    return out if out.mean() < MANY else np.zeros(n, bool)


def measured_white(log: Log) -> float:
    """Measure the white noise of the accelerometers by third differences [m/s^2/sqrt(Hz)].

    `log`: readings that move slowly against their rate [SI].
    """
    assert log.accel is not None
    good = log.accel[np.isfinite(log.accel).all(axis=1)]
    rough = np.diff(good, n=3, axis=0)  # of white noise: 1 + 9 + 9 + 1 = 20 times its variance
    spread = 1.4826 * np.median(np.abs(rough - np.median(rough, axis=0)), axis=0)
    return float(np.sqrt(np.mean(spread**2) / 20.0 * log.interval))
