"""In which units a log is, from its titles and from what its numbers must be.

Gravity gives the size of what accelerometers read, turns the size of what gyros read times that of
the clock, and the interval of the samples the clock. A unit is a size that people use; where
several fit, titles and the usual rates of loggers decide, and what is still open is a question.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import inf, isfinite, log
from pathlib import Path
from typing import Any

from foucault.errors import FoucaultError
from foucault.logs.layout import scaled_unit
from foucault.models.earth import EARTH_RATE
from foucault.units import STANDARD_GRAVITY

NEAR = log(1.07)
"""A size is a usual one within this, in logarithm: instruments are off by some percent [1]."""

FAR = log(1.3)
"""A unit in a title is wrong beyond this, in logarithm [1]."""

USUAL: dict[str, Any] = tomllib.loads(
    Path(__file__).with_name("usual.toml").read_text(encoding="utf-8")
)
"""Rates of loggers [Hz], units that they use [SI], counts of converters, and words."""

LIKELY_RATES, POSSIBLE_RATES = (15.0, 2500.0), (2.0, 20000.0)
"""Of loggers of inertial instruments [Hz]."""

PEAK = 0.02, 60.0
"""Whoever turns an instrument turns it so fast at most at some time [rad/s]."""


@dataclass(frozen=True)
class Sense:
    """What tells the unit of one kind of sensor, and how odd some units are."""

    name: str
    told: str  # what tells the size of a reading
    rates: tuple[str, dict[str, float]]  # what it measures, and the usual units [SI]
    sums: tuple[str, dict[str, float]]  # the same of increments [SI]
    sum_unit: tuple[str, float]  # in which increments of no usual unit are written [SI]
    one: float  # what the counts of converters are given for [SI]
    of: str  # the same in words
    per: tuple[float, ...]  # those counts [count]
    rare: float  # how odd a unit is that few use [1]
    alone: float  # how odd a scale is that no one uses [1]


ACCELS, GYROS = (Sense(name, **USUAL[name]) for name in ("accel", "gyro"))


@dataclass(frozen=True)
class Seen:
    """What the numbers of a log say, in the units of its columns."""

    interval: float  # median step of the time column, 1 without one [raw]
    timed: bool  # whether there is a time column
    radius: float | None  # length of the accelerometers' readings at rest [raw]
    turn: float | None  # of a reading of the gyros, over one of the clock [rad/raw]
    peak: float  # largest reading of the gyros [raw]
    still: float  # length of the mean readings of the gyros, of a log that only rests, else 0 [raw]
    whole: tuple[bool, bool]  # whether accelerometers, gyros are whole numbers
    increments: bool | None  # what titles say: sums over the interval; None where nothing


@dataclass(frozen=True)
class Titled:
    """Units that titles give, "" where they give none."""

    time: str = ""
    accel: str = ""
    gyro: str = ""
    given: tuple[str, ...] = ()  # those that a user has said: no number overrules them
    # triad -> what a user has said of its counts, as a text and per count [SI]
    scales: Mapping[str, tuple[str, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Unit:
    """One unit, how it is known, and what speaks against it."""

    text: str  # as [log] has it; "count" with a scale
    si: float  # [SI]
    scale: str = ""  # of counts
    cost: float = 0.0  # how odd it is [1]
    why: str = ""


@dataclass(frozen=True)
class Reading:
    """One set of units that fits."""

    time: Unit | None  # None where a rate is taken
    rate: float  # [Hz]
    accel: Unit | None
    gyro: Unit | None
    increments: bool
    cost: float  # how odd it is [1]

    def like(self, other: Reading) -> bool:
        """Tell whether another one has the same clock, and the same size of what gyros read."""
        same = self.increments == other.increments and abs(log(self.rate / other.rate)) < NEAR
        if self.gyro is None or other.gyro is None:
            return same
        # Gravity and turns calibrate whatever a scale is off by.
        return same and abs(log(abs(self.gyro.si / other.gyro.si))) < 2 * NEAR

    @property
    def hangs(self) -> bool:
        """Whether no one can tell its rate: counts of gyros, and no clock."""
        return self.time is None and self.gyro is not None and self.gyro.text == "count"


def readings(seen: Seen, titled: Titled) -> list[Reading]:
    """Return the sets of units that fit a log, the likeliest first."""
    found = [
        one
        for increments in ((False, True) if seen.increments is None else (seen.increments,))
        for clock in _clocks(seen, titled, increments)
        for one in _with_clock(seen, titled, clock, increments)
    ]
    return sorted(found, key=lambda r: r.cost)


def _clocks(seen: Seen, titled: Titled, increments: bool) -> Iterator[Unit]:
    """Yield the units that the time column may have, or the intervals of samples without one."""
    if seen.timed and titled.time:
        si = 1.0 if titled.time == "iso" else scaled_unit(titled.time, "time")
        yield Unit(titled.time, si, why="title")
        rate = 1.0 / (si * seen.interval)
        if LIKELY_RATES[0] / 4 <= rate <= LIKELY_RATES[1] * 2 or "time" in titled.given:
            return
        for text, other in USUAL["time"].items():  # a title that cannot be
            if text != titled.time:
                yield Unit(text, other, cost=3.0, why=f"not {titled.time} as its title says")
        return
    if seen.timed:
        for text, si in USUAL["time"].items():
            rare = text in ("100 us", "day")
            yield Unit(text, si, cost=1.6 * rare, why="the rate it gives")
        return
    _, gyros = GYROS.sums if increments else GYROS.rates
    if seen.turn is None:
        yield Unit("", 1 / 100.0, cost=4.0, why="nothing")
        return
    wanted = [scaled_unit(titled.gyro, "angular rate")] if titled.gyro and not increments \
        and titled.gyro != "count" else list(gyros.values())  # fmt: skip
    if seen.whole[1] and not titled.gyro:
        wanted += [GYROS.one / k for k in GYROS.per]
    for si in wanted if not increments else ():
        rate = si / seen.turn
        usual = min(USUAL["rates"], key=lambda r: abs(log(r / rate)))
        off = abs(log(usual / rate))
        if POSSIBLE_RATES[0] < rate < POSSIBLE_RATES[1]:
            # 100 Hz is likelier than 104: what is round wins where gyros are off by percents.
            rounds = [r for r in (50, 100, 200, 400, 500, 1000) if abs(log(r / rate)) < 0.04]
            best = rounds[0] if rounds else usual
            yield Unit("", 1.0 / (best if abs(log(best / rate)) < 0.06 else rate),
                       cost=0.5 + 10 * off, why="the gyros' turns")  # fmt: skip
    if increments and seen.radius:
        si = seen.radius / STANDARD_GRAVITY  # m/s over m/s^2
        usual = min(USUAL["rates"], key=lambda r: abs(log(r * si)))
        if abs(log(usual * si)) < 0.1:
            yield Unit("", 1.0 / usual, cost=1.0, why="gravity in m/s")


_EARTH = "it sees the Earth turn"


def _with_clock(seen: Seen, titled: Titled, clock: Unit, increments: bool) -> Iterator[Reading]:
    """Yield the readings of a log with one clock."""
    step = clock.si * seen.interval
    rate = 1.0 / step if step > 0 else inf
    if not (isfinite(rate) and POSSIBLE_RATES[0] <= rate <= POSSIBLE_RATES[1]):
        return
    cost = clock.cost + 1.5 * (increments and seen.increments is None)
    cost += 2.0 * (not LIKELY_RATES[0] <= rate <= LIKELY_RATES[1])
    accels: list[Unit | None] = [None]
    if seen.radius is not None:
        size = STANDARD_GRAVITY * (step if increments else 1.0) / seen.radius
        accels = [*_fitting(ACCELS, size, titled, seen.whole[0], increments)]
    gyros: list[Unit | None] = [None]
    if seen.peak > 0:
        turn = None
        if seen.turn is not None:
            turn = seen.turn * seen.interval if increments else seen.turn / clock.si
        gyros = [*_fitting(GYROS, turn, titled, seen.whole[1], increments)]
    for accel in accels:
        for gyro in gyros:
            more = (0.0 if accel is None else accel.cost) + (0.0 if gyro is None else gyro.cost)
            if gyro is not None and seen.still > 0:
                turns = seen.still * abs(gyro.si) * (rate if increments else 1.0)
                if abs(turns / EARTH_RATE - 1.0) < 0.05:
                    more -= 1.5
                    gyro = replace(gyro, why=gyro.why if gyro.why == "title" else _EARTH)
            elif gyro is not None:
                fastest = seen.peak * abs(gyro.si) * (rate if increments else 1.0)
                more += 2.5 * (gyro.text == "deg/h" and gyro.why != "title")
                more += 3.0 * (not PEAK[0] < fastest < PEAK[1]) + 1.0 * (fastest < 0.2)
            yield Reading(clock if seen.timed else None, rate, accel, gyro, increments, cost + more)


def _fitting(
    sense: Sense, size: float | None, known_by: Titled, whole: bool, increments: bool
) -> Iterator[Unit]:
    """Yield units of a triad one reading of which is of a `size` [SI], None where nothing tells."""
    titled = getattr(known_by, sense.name)
    kind, known = sense.sums if increments else sense.rates
    if sense.name in known_by.scales:
        text, si = known_by.scales[sense.name]
        yield Unit("count", si, text, why="given")
        return
    si = 0.0
    if titled and titled != "count":
        if titled in ("rad", "deg") and not increments:
            titled += "/s"
        try:
            si = scaled_unit(titled, kind)
        except FoucaultError:  # a unit of something else
            si = 0.0
    if si and (size is None or abs(log(size / si)) < FAR or sense.name in known_by.given):
        yield Unit(titled, si, why="title")
        return
    if size is None:
        why = "nothing but what is usual"
        counts = titled == "count" or (whole and not titled and not increments)
        for per in sense.per[1:] if counts else ():
            yield Unit("count", sense.one / per, f"{per:.10g} count/{sense.of}", 2.0, why)
        for text in list(known)[:2] if titled != "count" else ():
            yield Unit(text, known[text], cost=2.0 + 0.3 * counts, why=why)
        return
    why = f"not {titled} as its title says" if si else sense.told
    extra = 3.0 * bool(si)
    for text, one in known.items():
        off = abs(log(size / one))
        if off < NEAR and titled != "count":
            rare = sense.rare * (one not in (1.0, sense.one))
            yield Unit(text, one, cost=extra + 8 * off + rare, why=why)
    if increments:
        unit, one = sense.sum_unit
        yield Unit(f"{size / one:.6g} {unit}", size, cost=3.5 + extra, why=sense.told)
        return
    usual = min(sense.per, key=lambda k: abs(log(k * size / sense.one)))
    off = abs(log(usual * size / sense.one))
    if whole and off < NEAR:
        yield Unit("count", sense.one / usual, f"{usual:.10g} count/{sense.of}", 0.4 + 8 * off,
                   f"{sense.told}, and a usual converter")  # fmt: skip
    yield Unit("count", size, f"{1 / size:.6g} count/({next(iter(known))})",
               sense.alone + extra + 1.5 * (not whole), f"{sense.told} alone")  # fmt: skip
