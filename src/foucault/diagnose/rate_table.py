"""Constant rates of a table: steps, norms, and the report of both.

From readings on a rate table to steps: which axis was up, and at which rate the table turned.

Accelerometers tell which axis is along the vertical and in which sense; without them the gyros tell
the axis and the table the sense. Where the log carries no rate of the table, the rates that were
commanded are matched to the steps by what the gyros say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.errors import Finding, error, finding
from foucault.models.earth import Site
from foucault.models.noise import Readings, wander_variance
from foucault.models.rests_and_turns import Steps, mean_force_of_steps
from foucault.tables import AXES
from foucault.units import plain

ON_AXIS = np.cos(np.radians(30.0))
"""An axis whose direction cosine to the vertical is less is not along it [1]."""

OTHER_RATE = 0.2  # A step at another rate than commanded differs by more than this part of it [1].
SLOW = np.radians(0.05)  # Differences of rate below this may be the bias of a gyro [rad/s].
LARGEST_BIAS = np.radians(20.0)  # No gyro has a larger bias [rad/s].


@dataclass(frozen=True)
class Commanded:
    """What the campaign says of the session."""

    # (k,) rates of the table in each placement, in order; empty where not given [rad/s]
    rates: FloatArray
    # axis along the vertical and its sense, such as "x up", in order; empty where not given
    axes: tuple[str, ...] = ()


def rate_steps(
    readings: Readings, commanded: Commanded, *, told: bool, site: Site
) -> tuple[Steps, list[Finding]]:
    """Find axis, sense and rate of every step.

    `commanded`: rates and placements as the campaign gives them [SI]; `told`: whether the log
    carries the rate of the table. Raises no gyros, no rates, an axis that is not vertical, other
    placements than declared, a sense reversed, a wrong unit, a rate that was not commanded.
    """
    if readings.gyro is None:
        raise error("rate_table.no_gyro")
    if not told and not len(commanded.rates):
        raise error("rate_table.no_rates")
    up = _up(readings, commanded, told)
    change = np.any(up[1:] != up[:-1], axis=1)
    placement = np.concatenate([[0], np.cumsum(change)]).astype(np.int64)
    if commanded.axes:
        _as_declared(up, placement, commanded.axes)
    rates = commanded.rates
    between = rests_between(rates)  # a rest between the rates need not be listed
    listed = np.append(rates, 0.0) if between else rates
    seen = _along(readings.gyro, up, readings.rate if told else None, listed)
    rate = readings.rate
    if told:
        _one_sense(rate, seen, up)
    else:
        rate = np.zeros(len(seen))
        turning = np.abs(seen) > SLOW if between else np.ones(len(seen), bool)
        rate[turning] = _matched(seen[turning], placement[turning], up[turning], rates)
    findings = _missing(rate, placement, up, rates)
    slow, cov = None, readings.gyro_cov
    if readings.slow is not None:
        slow = readings.slow.gyro
        cov = cov - wander_variance(slow, readings.time)[:, None, None] * np.eye(3)
    steps = Steps(
        up, placement, rate, readings.time, readings.gyro, cov,
        mean_force_of_steps(up, placement, rate, readings.accel, site), readings.start, slow,
        readings.angles[:, 0],
    )  # fmt: skip
    return steps, findings


def rests_between(rates: FloatArray) -> bool:
    """Tell whether a step without rate is a rest for sure, `rates`, shape (k,) [rad/s], listed."""
    return len(rates) > 0 and bool((np.abs(rates) > 4 * SLOW).all())


def name_of(up: FloatArray) -> str:
    """Return the name of a placement, given its `up`, shape (3,) [1]."""
    axis = int(np.abs(up).argmax())
    return f"{AXES[axis]} {'up' if up[axis] > 0 else 'down'}"


def _unit(name: str) -> FloatArray:
    axis, sense = name.split()
    return np.asarray((1.0 if sense == "up" else -1.0) * np.eye(3)[AXES.index(axis)])


def _nearest_axis(v: FloatArray) -> FloatArray:
    """Return the axis nearest to each of `v`, shape (n, 3), with its sense."""
    axis = np.abs(v).argmax(axis=1)
    return np.asarray(np.eye(3)[axis] * np.sign(v[np.arange(len(v)), axis])[:, None])


def _up(readings: Readings, commanded: Commanded, told: bool) -> FloatArray:
    assert readings.gyro is not None
    n, axes = len(readings), commanded.axes
    if readings.accel is not None:
        f = readings.accel / np.linalg.norm(readings.accel, axis=1, keepdims=True)
        off = np.flatnonzero(np.abs(f).max(axis=1) < ON_AXIS)
        if len(off):
            k = int(off[0])
            lean = np.degrees(np.arccos(np.abs(f[k]).max()))
            raise error(
                "rate_table.between_axes", step=k + 1, start=f"{readings.start[k]:.1f}",
                axis=AXES[int(np.abs(f[k]).argmax())], lean=f"{lean:.0f}",
            )  # fmt: skip
        return _nearest_axis(f)
    if len(set(axes)) == 1:
        return np.asarray(np.repeat([_unit(axes[0])], n, axis=0))
    if axes:
        per = len(commanded.rates) if len(commanded.rates) else n // len(axes)
        if n != per * len(axes):
            raise error("rate_table.count", given=n, placements=len(axes), rates=per)
        return np.asarray(np.repeat([_unit(name) for name in axes], per, axis=0))
    if not told:
        raise error("rate_table.no_up")
    # Each axis is level in most steps: the median of its readings is about its bias.
    turning = (readings.gyro - np.median(readings.gyro, axis=0)) * np.sign(readings.rate)[:, None]
    spins = np.flatnonzero(readings.spin)
    if not len(spins):
        raise error("rate_table.no_up")
    nearest = np.abs(np.arange(n)[:, None] - spins).argmin(axis=1)
    return _nearest_axis(turning[spins[nearest]])


def _as_declared(up: FloatArray, placement: IntArray, axes: Sequence[str]) -> None:
    seen = [name_of(up[placement == p][0]) for p in np.unique(placement)]
    wanted = [a for k, a in enumerate(axes) if k == 0 or a != axes[k - 1]]
    if seen != wanted:
        raise error("rate_table.axes", seen=", ".join(seen), declared=", ".join(axes))


def _along(
    gyro: FloatArray, up: FloatArray, rate: FloatArray | None, listed: FloatArray
) -> FloatArray:
    """Return the rate that the gyros say along up, less about their bias, shape (n,) [rad/s].

    The bias of an axis that is level in some step is what it reads there. One that is never level
    has the bias that brings its readings nearest to the rates, `rate` of the table, shape (n,), or
    those that are `listed`.
    """
    level, bias = np.abs(up) < 0.5, np.zeros(3)
    for i in range(3):
        rows, y = level[:, i], gyro[:, i]
        if rows.any():
            bias[i] = np.median(y[rows])
        elif rate is not None:
            bias[i] = np.median(y - up[:, i] * rate)
        elif len(listed):
            bias[i] = _matching_bias(y, up[:, i], listed)
    return np.asarray(np.sum((gyro - bias) * up, axis=1))


def _matching_bias(y: FloatArray, sense: FloatArray, listed: FloatArray) -> float:
    """Return the smallest bias of all with which the most readings are at a listed rate [rad/s].

    What is larger than any gyro's bias is none: rates that are really other ones stay so.
    """
    tried = (y[:, None] - sense[:, None] * listed).ravel()
    tried = np.append(tried[np.abs(tried) < LARGEST_BIAS], 0.0)
    turned = sense * (y - tried[:, None])  # a row per bias
    away = np.abs(turned[:, :, None] - listed)
    missed = (away / (OTHER_RATE * np.abs(listed) + SLOW)).min(axis=2)
    fits = np.sum(missed <= 1.0, axis=1)
    if 2 * fits.max() < len(y):
        return 0.0  # other rates than listed, and not a bias
    # The middle of those that fit equally many: scale factors are off by some per cent too.
    best = tried[fits == fits.max()]
    return float(np.median(best[np.abs(best) <= np.abs(best).min() + LARGEST_BIAS / 10]))


def _degrees(rate: float) -> str:
    return plain(float(np.degrees(rate)), 4)


def _one_sense(rate: FloatArray, seen: FloatArray, up: FloatArray) -> None:
    """Refuse rates of the table that turn against the gyros."""
    clear = np.abs(rate) > 2 * SLOW
    against = np.flatnonzero(clear & (seen * rate < 0))
    if len(against):
        k = int(against[0])
        steps = f"{len(against)} of {int(clear.sum())} steps"
        raise error(
            "rate_table.sense", steps=steps, step=k + 1, placement=name_of(up[k]),
            told=_degrees(rate[k]), seen=_degrees(seen[k]),
        )  # fmt: skip


def _matched(
    seen: FloatArray, placement: IntArray, up: FloatArray, rates: FloatArray
) -> FloatArray:
    """Give every step the commanded rate nearest to what the gyros say."""
    if not len(seen):
        return seen
    ratio = float(np.abs(rates).max() / max(np.abs(seen).max(), 1e-12))
    one = np.degrees(1.0)
    for factor, is_unit, says in ((one, "deg/s", "rad/s"), (1 / one, "rad/s", "deg/s")):
        if abs(np.log(ratio / factor)) < np.log(1 + OTHER_RATE):
            raise error(
                "rate_table.unit", told=_degrees(np.abs(rates).max()),
                seen=_degrees(np.abs(seen).max()), likely=is_unit, given=says,
            )  # fmt: skip
    near = rates[np.abs(seen[:, None] - rates).argmin(axis=1)]
    for p in np.unique(placement):
        _not_reversed(seen[placement == p], rates, near[placement == p], up[placement == p][0])
    off = np.flatnonzero(np.abs(seen - near) > OTHER_RATE * np.abs(near) + SLOW)
    if len(off):
        k = int(off[0])
        raise error(
            "rate_table.other_rate", step=k + 1, placement=name_of(up[k]), seen=_degrees(seen[k]),
            nearest=_degrees(near[k]),
        )  # fmt: skip
    return np.asarray(near)


def _not_reversed(seen: FloatArray, rates: FloatArray, near: FloatArray, up: FloatArray) -> None:
    """Refuse a placement whose steps, in order, turn as commanded but the other way."""
    allowed = OTHER_RATE * np.abs(rates) + SLOW
    listed = len(seen) == len(rates)
    as_told = listed and bool((np.abs(seen - rates) <= allowed).all())
    mirrored = listed and bool((np.abs(seen + rates) <= allowed).all())
    # Rates that were commanded one way only and seen the other way only.
    far = np.abs(seen - near) > OTHER_RATE * np.abs(near) + SLOW
    other = -rates[np.abs(seen[:, None] + rates).argmin(axis=1)]
    turned = bool((np.abs(seen - other) <= OTHER_RATE * np.abs(other) + SLOW).all())
    if (mirrored and not as_told) or (far.all() and turned):
        k = int(np.abs(seen).argmax())
        raise error(
            "rate_table.sense", steps=f"{len(seen)} of {len(seen)} steps", step=k + 1,
            placement=name_of(up), told=_degrees(rates[k] if listed else -seen[k]),
            seen=_degrees(seen[k]),
        )  # fmt: skip


def _missing(
    rate: FloatArray, placement: IntArray, up: FloatArray, rates: FloatArray
) -> list[Finding]:
    """Name the steps that were commanded and are not there."""
    words = []
    for p in np.unique(placement):
        mine = placement == p
        there = rate[mine][:, None]
        gone = [r for r in rates if not (np.abs(there - r) <= 0.05 * abs(r) + 1e-6).any()]
        if gone:
            listed = ", ".join(_degrees(r) for r in gone)
            words.append(f"{listed} deg/s with {name_of(up[mine][0])}")
    return [finding("rate_table.missing", steps="; ".join(words))] if words else []


def lacking(steps: Steps) -> list[str]:
    """Say what steps [SI] lack to tell scale factors."""
    out = []
    for i, a in enumerate(AXES):
        speed = (steps.rate * steps.sense)[steps.axis == i]
        if not speed.any():
            out.append(f"no step turns about {a}")
            continue
        if (speed >= 0).all() or (speed <= 0).all():
            out.append(f"about {a} all steps turn the same way")
        if np.ptp(np.abs(speed)) < 0.05 * np.abs(speed).max():
            out.append(f"about {a} all steps have the same speed")
    return out
