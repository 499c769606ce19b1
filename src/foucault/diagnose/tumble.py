"""A platform tumble: input, checks, and what its motion shows.

The white residuals r of the filter are independent and of unit variance where noise, model and
motion are what was said. What the fit absorbs of them is known, so that the sum of any of their
squares is chi-square with ``sum(1 - leverage)`` degrees of freedom: over the whole log, axis by
axis, and stretch by stretch, which shows where a slip or a knock happened. Sums of residuals over
longer parts show what is too slow to be seen in neighbours: noise of the gyros, above all. What the
others predict of a stretch shows what the fit has bent to.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.coefficients import CoefficientVector, Layout, coefficients_of
from foucault.diagnose.checks import check, hardly, status_check
from foucault.diagnose.fit_checks import held_out_check
from foucault.diagnose.observability import LinearSegment, Observability, Sensitivity, observability
from foucault.diagnose.references import (
    earth_findings,
    known_checks,
    likelier,
    steps_unnoticed,
)
from foucault.errors import Finding, Status, error, finding, listed
from foucault.estimate.tumble import STATES, Fit, Prior, State, Tumble, attitudes, sensitivities
from foucault.estimate.tumble_solution import Solution
from foucault.infer.gauss_newton import FALSE_ALARM, chi_square_limits
from foucault.infer.information import Information
from foucault.models.cluster import CONSTANTS, angles_of, normalised
from foucault.models.noise import noise_json
from foucault.models.rotation import cross_matrix, exp, log
from foucault.plans.tumble import Nominal, TorquingPlan
from foucault.result import Check, TableData
from foucault.tables import AXES, Log

LONG = 1.5  # An interval longer than this many usual ones has lost rows [1].
STEP = 0.01  # A change of the command by more than this, over its largest size, is a step [1].

ROUGHNESS = float(np.sqrt(70.0)) / 6.0
"""Sd of a reading less what its four neighbours predict, over that of a reading [1]."""

ENOUGH = 20  # Fewer changes of a command do not show how long it holds [1].
MOSTLY = 0.9  # So many of its changes are where they usually are, unless rows are lost [1].

MANY = 0.1  # Where more readings than this jump, that is how they are [1].
ROUNDS = 5  # Times that outlying readings are sought beside those that were found [1].
SHIFTED = 120  # A command is searched for so many steps of its plan, earlier and later [1].


def plan_findings(
    log: Log, plan: TorquingPlan, told: Nominal, from_its_time: bool
) -> list[Finding]:
    """Compare a log's command [SI] with its plan; `from_its_time`: it begins at its row."""
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
    hold = max(step, _hold(log))
    last = np.searchsorted(plan.ends, since + hold, side="right") - 1
    miss[np.asarray(since < plan.ends[last] + plan.ramp + hold)] = 0.0
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


def held_findings(log: Log, plan: Nominal | None, from_its_time: bool) -> list[Finding]:
    """Tell of a command that is repeated in the log [SI] for longer than the rig held it.

    `plan` or None: what was to be commanded, at each interval of the log; `from_its_time`: the
    command of a row begins there. A rig's own steps are all as long; on rows that are whole numbers
    of more than one, and longer than that, they are those of a column that is written anew less
    often. Where it is as slow as these, its plan alone tells: held commands are those of the middle
    of their time, or of its beginning, and repeated ones are of neither.
    """
    assert log.gyro is not None
    command = log.gyro[:-1] if from_its_time else log.gyro[1:]
    change = np.diff(command, axis=0)
    new = 1 + np.flatnonzero((change != 0).any(axis=1))
    runs, size = np.diff(new), np.abs(change[new - 1])
    if len(runs) < ENOUGH or np.median(size.max(axis=1)) > STEP * np.abs(command).max():
        return []  # steps of a plan alone, which last as long as it says
    usual = int(np.median(runs))
    whole = [k for k in range(2, usual + 1) if np.mean(runs % k == 0) > MOSTLY]
    # A coarse command goes on by single counts, whenever it comes to the next one.
    size = size[:, int(np.argmax((size > 0).sum(axis=0)))]
    size = size[size > 0]
    coarse = np.mean(np.abs(size / np.median(size) - 1) < 1e-6) > 0.2
    if whole and np.mean(runs == whole[-1]) < MOSTLY and not coarse:
        return [_held(whole[-1], log.interval)]
    n = 0 if plan is None or usual not in whole else min(len(command), len(plan.command))
    first = new[new < n][::usual]  # together they are as late as others are
    if plan is None or len(first) < 3 or len(log) != 1 + round(log.duration / log.interval):
        return []  # where rows are missing, commands are not those of the plan at their number
    slope = np.gradient(plan.command[:n], log.interval, axis=0)
    miss = command[:n] - plan.command[:n]
    number = np.diff(first)[:, None]
    slope, miss = (np.add.reduceat(x, first)[:-1] / number for x in (slope, miss))
    steady = np.linalg.norm(slope, axis=1) * usual * log.interval < STEP * np.abs(command).max()
    slope, miss = slope[steady], miss[steady]
    square = float(np.sum(slope**2))
    late = -float(np.sum(slope * miss)) / square if square > 0 else 0.0
    repeated = log.interval / 4 < late < (usual / 2 - 0.25) * log.interval
    if not repeated or np.sum((miss + late * slope) ** 2) > 0.3 * np.sum(miss**2):
        return []
    return [_held(usual, log.interval)]


def _held(rows: int, interval: float) -> Finding:
    return finding("tumble.held", rows=rows, time=f"{rows * interval:.4g}")


def _hold(log: Log) -> float:
    """How long a command is held, judged by how often it changes [s]."""
    assert log.gyro is not None
    changes = log.time[1:][np.any(np.diff(log.gyro, axis=0) != 0, axis=1)]
    return float(np.median(np.diff(changes))) if len(changes) > 1 else log.interval


def _shift(command: FloatArray, wanted: FloatArray) -> int:
    """Return by how many rows the command is later than wanted, 0 where no shift explains it."""
    most = min(len(command) // 4, SHIFTED)

    def miss(k: int) -> float:
        a, b = (command[k:], wanted[: len(wanted) - k]) if k >= 0 else (command[:k], wanted[-k:])
        return float(np.mean((a - b) ** 2))

    best = min(range(-most, most + 1), key=miss)
    return best if miss(best) < 0.05 * miss(0) else 0


def gap_findings(log: Log) -> list[Finding]:
    """Tell of intervals of a log [SI] in which the command is not known."""
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


def edges(time: FloatArray, command: FloatArray, after: float) -> BoolArray:
    """Tell which of `time` [s] end within `after` of a step of `command` (n, 3) [rad/s]."""
    step = np.linalg.norm(np.diff(command, axis=0, prepend=np.zeros((1, 3))), axis=1)
    steps = time[:-1][step > STEP * np.linalg.norm(command, axis=1).max()]
    out: BoolArray = np.zeros(len(command), bool)
    first = np.searchsorted(time[1:], steps - 1e-9, side="right")
    last = np.searchsorted(time[1:], steps + after + 1e-9, side="right")
    for a, b in zip(first, last, strict=True):
        out[a:b] = True
    return out


def outlying(log: Log, sd: float) -> BoolArray:
    """Find rows whose readings jump farther from their neighbours than any would by chance, (n,).

    A cubic through two neighbours on either side, at the ends through four on one, predicts a
    reading; a command that steps bends it, by no more than a third of step, gravity and interval.

    `log`: command, and readings that move slowly against their rate [SI]; `sd`: of a reading by
    its noise: what is less is no jump [m/s^2].
    """
    from scipy.special import ndtri

    assert log.accel is not None and log.gyro is not None
    n = len(log)
    out: BoolArray = np.zeros(n, bool)
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
            from scipy.interpolate import CubicSpline

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
    """Measure white noise by third differences of slow readings [m/s^2/sqrt(Hz)]."""
    assert log.accel is not None
    good = log.accel[np.isfinite(log.accel).all(axis=1)]
    rough = np.diff(good, n=3, axis=0)  # of white noise: 1 + 9 + 9 + 1 = 20 times its variance
    spread = 1.4826 * np.median(np.abs(rough - np.median(rough, axis=0)), axis=0)
    return float(np.sqrt(np.mean(spread**2) / 20.0 * log.interval))


STRETCHES = 12  # The log is tested in so many stretches [1].
KINDS = {
    "drift": "the drift of the gyros changed",
    "attitude": "the cluster turned otherwise than commanded",
    "biases": "the biases of the accelerometers changed",
    "drift, slowly": "the drift of the gyros grows through the log",
    "biases, slowly": "the biases of the accelerometers grow through the log",
}
"""What may change, in words."""

PARTS = 60  # Slow errors are sought in the sums over so many parts of the log [1].

EACH = FALSE_ALARM / 10
"""False-alarm rate of each of ten tests, so that all together keep about 1 % [1]."""

ALIKE = {
    "gyro.torquer_scale": "a wrong clock, or unit of the command,",
    "accel.scale": "a wrong gravity or unit",
}
"""What puts the scale factors of a triad off alike."""

LOOSE = np.radians(0.5)
"""An azimuth less certain than this bends what depends on it beyond the linear [rad]."""


def checks(e: Solution) -> tuple[Check, ...]:
    """Return every test of the result; a failed one carries its reason."""
    ended = status_check(e.fit.status, ())
    if e.advice:
        ended = replace(ended, sentence=e.advice)
    if e.fit.status is not Status.CONVERGED:
        return (ended,)  # there is nothing to be judged
    out = [ended, *_scatter(e), _stretches(e)]
    known = CoefficientVector(CONSTANTS, e.fit.start.constants, e.fit.start_cov[3:45, 3:45],
                              prior_sd=e.prior.sd[3:45])  # fmt: skip
    earth, shifts = likelier(e.earth, _shifts(e), 2 * EACH)
    out += known_checks(earth, known, e.prior.mean.constants, ALIKE, EACH)
    out += [_start(e), _seen(e)]
    if not e.slow:  # slow noise looks like all of these
        out += [_neighbours(e), _slow(e), *shifts, _held_out(e), _delay(e)]
    return tuple(out)


def _square(
    e: Solution, tests: int, rows: slice | IntArray, columns: slice | int = slice(None)
) -> list[float]:
    """Return the sum of squares of some residuals, its limits and degrees of freedom."""
    value, dof = e.white.square(rows, columns)
    low, high = chi_square_limits(dof, EACH, tests)
    return [value, low, float("inf") if e.slow else high, dof]


def whole_square(e: Solution) -> list[float]:
    """Return the chi-square of all residuals, its limits, and its degrees of freedom."""
    return _square(e, 1, slice(None))


def _scatter(e: Solution) -> list[Check]:
    """Test the residuals as a whole, and axis by axis."""
    found = [whole_square(e)]
    found += [_square(e, 3, slice(None), k) for k in range(3)]
    out = []
    for axis, (value, low, high, dof) in zip(("", *AXES), found, strict=True):
        given = {"axis": axis, "ratio": np.sqrt(value / dof)}
        key, name = "tumble readings", "residuals"
        if axis:
            key, name = "tumble axis", f"accelerometer {axis}"
        out.append(check(key, name, value, low, high if np.isfinite(high) else None, given))
    return out


def _stretches(e: Solution) -> Check:
    """Test the log stretch by stretch; the sentence names the worst one."""
    parts = e.white.parts(STRETCHES)
    found = [_square(e, len(parts), p) for p in parts]
    outside = float(sum(not low <= value <= high for value, low, high, _ in found))
    ratio = [np.sqrt(value / max(dof, 1e-9)) for value, _, _, dof in found]
    worst = int(np.argmax(np.abs(np.log(np.maximum(ratio, 1e-9)))))
    begin, end = (float(e.fit.time[parts[worst][k]]) for k in (0, -1))
    given = {"parts": len(parts), "begin": begin, "end": end, "ratio": ratio[worst]}
    return check("stretches", "stretches", outside, None, 0.0, given)


def _neighbours(e: Solution) -> Check:
    """Test whether neighbouring residuals are related: a motion that the model lacks."""
    from scipy.special import ndtri

    total, mean, sd = e.white.neighbours()
    related = (total - mean) / sd
    limit = float(ndtri(1 - EACH / 2))
    given = {"correlation": (total - mean) / e.white.residuals.size}
    return check("neighbours", "neighbours", related, -limit, limit, given)


def _slow(e: Solution) -> Check:
    """Test sums over parts of the log: noise of the gyros, slow errors."""
    sums, cov = e.white.sums(min(PARTS, len(e.white.residuals) // 4 + 1))
    value, dof = float(sums @ sums), max(float(np.trace(cov)), 1.0)
    low, high = chi_square_limits(dof, EACH)
    return check("slow errors", "slow errors", value, low, high, {"ratio": np.sqrt(value / dof)})


def _held_out(e: Solution) -> Check:
    """Predict every stretch from all others, which the fit has not bent to it."""
    parts = e.white.parts(STRETCHES)
    found = e.white.parts_out(parts, EACH)
    begin, end = (float(e.fit.time[parts[found.worst][k]]) for k in (0, -1))
    return held_out_check(found, "readings", f", worst from {begin:.0f} to {end:.0f} s")


def _shifts(e: Solution) -> list[Check]:
    """Ask what changed for good within the log."""
    if e.shift is None:
        return []
    one, when = e.shift.found, e.shift.kinds
    each = (KINDS[k] + ("" if t is None else f" at {t:.0f} s") for k, t in when.items())
    return [check("shifts", "shifts", one.square, None, one.limit, {"what": " or ".join(each)})]


def unnoticed(e: Solution) -> list[str]:
    """Say which changes within the log need not show."""
    if e.shift is None:
        return []
    least = e.shift.least
    return [steps_unnoticed(least["drift"], e.site.gravity * least["biases"])]


def _start(e: Solution) -> Check:
    miss, _ = e.prior.rows(e.fit.start)
    value = float(np.sum(miss[:3] ** 2))
    limit = chi_square_limits(3, 2 * EACH)[1]  # one-sided
    away = float(np.degrees(np.linalg.norm(log(e.fit.start.C_np @ e.prior.mean.C_np.T))))
    return check("start", "start", value, None, limit, {"away": away})


def _seen(e: Solution) -> Check:
    """Count the coefficients that the motion shows: a result of priors is none."""
    unseen, count = len(hardly(e.coefficients.chosen(CONSTANTS.names))), len(CONSTANTS)
    given = {"shown": count - unseen, "count": count}
    return check("seen by the motion", "seen", float(unseen), None, float(count // 2), given)


def _delay(e: Solution) -> Check:
    """Test the delay that was held; one that is estimated has no test."""
    from scipy.special import ndtri

    late, sd = e.fit.late
    z, limit = (late / sd if sd > 0 else 0.0), float(ndtri(1 - EACH / 2))
    key = "delay" if 0 < sd < np.inf else "delay estimated" if sd == 0 else "delay not seen"
    given = {"ms": 1e3 * (late + e.prior.mean.delay), "sds": abs(z)}
    return check(key, "delay", z, -limit, limit, given)


def findings(e: Solution) -> list[Finding]:
    """Return what the user should know: delay, start, and what the motion shows badly."""
    earth, _ = likelier(e.earth, _shifts(e), 2 * EACH)
    out, (late, sd) = earth_findings(earth, 2 * EACH), e.fit.late
    if e.fit.status is Status.CONVERGED and not e.slow and not _delay(e).passed:
        out.append(
            finding(
                "tumble.delay", given=f"{1e3 * (late + e.prior.mean.delay):.3g}",
                sd=f"{1e3 * sd:.2g}", believed=f"{1e3 * e.prior.mean.delay:.3g}",
            )
        )  # fmt: skip
    phi = log(e.fit.start.C_np @ e.prior.mean.C_np.T)
    sds = float(np.linalg.norm(phi / e.prior.sd[:3]))
    if sds > 4:
        outer, middle, inner = np.degrees(angles_of(e.fit.start.C_np.T))
        out.append(
            finding(
                "tumble.start", angle=f"{np.degrees(np.linalg.norm(phi)):.3g}", sds=f"{sds:.1f}",
                outer=f"{outer:.2f}", middle=f"{middle:.2f}", inner=f"{inner:.2f}",
            )
        )  # fmt: skip
    return out + of_motion(e)


def of_motion(e: Solution) -> list[Finding]:
    """Return what can be said beforehand: a singular attitude, poor condition, what is not seen."""
    out, middle = list[Finding](), float(angles_of(e.fit.C_np.T)[1])
    if abs(np.cos(middle)) < 0.02:
        out.append(finding("tumble.singular", given=f"{np.degrees(middle):.2f}"))
    if e.fit.orthogonal:
        out.append(finding("tumble.condition"))
    names = hardly(e.coefficients.chosen(CONSTANTS.names))
    if names:
        out.append(finding("tumble.unseen", count=len(names), names=listed(names)))
    C_np = e.fit.C_np
    azimuth = float(np.sqrt((C_np @ e.fit.cov[:3, :3] @ C_np.T)[2, 2]))
    if azimuth > LOOSE:
        out.append(finding("tumble.azimuth", given=f"{np.degrees(azimuth):.2f}"))
    return out


STATE = Layout((*coefficients_of("cluster_start"), *CONSTANTS.coefficients))
"""What the readings depend on: the attitude at the start, and the constants."""


# -- what the motion shows -------------------------------------------------------------------


def curves(tumble: Tumble, at: State, gravity: float, normalised: FloatArray) -> Sensitivity:
    """Return d(reading)/d(state) along the motion: attitude at the start, then 42 constants.

    `gravity`: local gravity [m/s^2]; `normalised` (42,): factors that turn SI into packed units.
    """
    scale = np.concatenate([np.ones(3), normalised, [1.0]])
    time, slopes = sensitivities(tumble, at, scale)
    return Sensitivity(
        time, STATE, tuple(AXES),
        gravity * slopes[:, :, : STATES - 1],
    )  # fmt: skip


def information_of(fit: Fit, prior: Prior) -> Information:
    """Return what the data alone say: of the attitude at the start, and of the constants."""
    n = STATES - 1
    values, vectors = np.linalg.eigh(fit.information[:n, :n])
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    return Information(STATE, root / prior.unit[:n])


def piecewise(
    rates: Sequence[FloatArray], attitudes: Sequence[FloatArray], times: Sequence[float],
    prior: Prior, reading_sd: float,
) -> Observability:  # fmt: skip
    """Return the stripped observability of a plan of constant segments.

    `rates` (3,): rate of each segment, frame p [rad/s]; `attitudes` (3, 3): C_pn in the middle of
    each segment [1]; `times`: how long each takes [s]; `prior`: its mean is where the model is
    linearised; `reading_sd`: standard deviation of a reading [local g].
    """
    F, H = _slopes(prior.mean.constants, np.array(rates), np.array(attitudes))
    segments = [LinearSegment(*parts) for parts in zip(F, H, times, strict=True)]
    return observability(segments, STATE, prior.sd[: STATES - 1], reading_sd)


def _slopes(
    constants: FloatArray, rate: FloatArray, C_pn: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Linearise motion and readings at each attitude by central differences.

    Returns F (s, 45, 45) [1/s] and H (s, 3, 45) [local g], all segments at once: equations of one
    reading are those of arrays.
    """
    from foucault.kernels.cluster import actual_rate, inverse_input_axes, readings

    n, step = STATES - 1, 1e-6
    d = step * np.eye(n)
    both = np.stack([d, -d])  # up and down, (2, n, n)
    # Of the states the first three alone, a rotation, change the force that is felt.
    turned = exp(-both[..., :3])
    f = np.stack([turned @ C[:, 2] for C in C_pn], axis=-1)  # (2, n, 3, s)
    theta = np.moveaxis(constants + both[..., 3:], -1, 0)[..., None]  # (42, 2, n, 1)
    Ti = np.empty((3, 3, 2, n, 1))
    inverse_input_axes.py_func(theta, Ti)
    force, still = np.moveaxis(f, 2, 0), np.zeros(3)
    w = actual_rate(theta, Ti, *rate.T[:, None, None], *force)
    z = readings.py_func(theta, *force, *w, *still, np.zeros((3, 3)), 1.0)
    moved, H = (np.moveaxis((x[:, 0] - x[:, 1]) / (2 * step), 2, 0) for x in map(np.array, (w, z)))
    F = np.zeros((len(rate), n, n))
    F[:, :3] = moved
    F[:, :3, :3] -= np.array([cross_matrix(one) for one in rate])
    return F, H


DRAWN = 400  # Rows of a table that is drawn as curves [1].

SUBDIVIDED = np.radians(15.0)
"""For the rank of the motion every constant rate is cut into turns of at most this [rad]."""

MOST_SEGMENTS = 96  # Into so many parts the motion is cut at most [1].
SHORT = 0.01  # A leg shorter than this part of the whole is one with its neighbour [1].
WEAKEST, STRONG = 6, 0.9  # Combinations shown, and correlations from which pairs are shown [1].


def diagnostics(e: Solution) -> dict[str, Any]:
    """Return what result.json tells beside coefficients and checks."""
    C_pn = e.fit.C_np.T
    return {
        "gravity": e.site.gravity,
        "iterations": e.fit.passes,
        "averaged": float(np.median(np.diff(e.fit.time))) if len(e.fit.time) > 1 else None,
        "noise": {"source": "declared"} | noise_json(e.noise),
        "chi_square": {"accel": whole_square(e)},
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


def observability_json(e: Solution) -> dict[str, Any]:
    """Return what the motion shows and what it leaves, in words and numbers."""
    information = information_of(e.fit, e.prior)
    prior_sd = e.prior.sd[: len(STATE)]
    motion, until = motion_seen(e)
    whole = information.with_prior(prior_sd)
    newly = [gain.alone for gain in motion.gains]
    seen: set[str] = set()  # one that rounding hides for a while counts once
    return {
        "rank": motion.rank,
        "states": len(STATE),
        "smallest": motion.smallest,
        "legs": legs(e.tumble),
        "growth": {
            "until": until,
            "rank": [gain.rank for gain in motion.gains],
            "alone": [len(seen := seen | set(names)) for names in newly],
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


def motion_seen(e: Solution) -> tuple[Observability, list[float]]:
    """Return the stripped observability of the motion as it was, and when each short turn ends."""
    rates, path, times = segments(e)
    reading_sd = float(np.sqrt(e.tumble.accel_variance / e.tumble.block))
    motion = piecewise(rates, path, times, e.prior, reading_sd)
    return motion, np.cumsum(times).tolist()


def segments(e: Solution) -> tuple[list[FloatArray], list[FloatArray], list[float]]:
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


def tables(e: Solution) -> dict[str, TableData]:
    """Return the tables of the report."""
    white = e.white.residuals
    return {
        "course": _course(e),
        "residuals": {"time": e.fit.time} | {a: white[:, k] for k, a in enumerate(AXES)},
        "sensitivity": _sensitivity(e),
        "path": _path(e),
    }


def _course(e: Solution) -> TableData:
    """The estimate as it was in the course of time: value and sd of every coefficient [SI]."""
    history = e.fit.history
    if history is None:
        return {"time": np.zeros(0)}
    factor = 1 / normalised(e.site.gravity)
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


def _sensitivity(e: Solution) -> TableData:
    """d(reading)/d(coefficient) along the motion, thinned [m/s^2 per SI unit]."""
    factor = normalised(e.site.gravity)
    thin = curves(e.tumble, e.fit.start, e.site.gravity, factor).thinned(DRAWN)
    out: dict[str, npt.NDArray[Any]] = {"time": thin.time}
    for i, axis in enumerate(AXES):
        for k, name in enumerate(thin.layout.names):
            out[f"{axis}.{name}"] = thin.slopes[:, i, k]
    return out


def _path(e: Solution) -> TableData:
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
