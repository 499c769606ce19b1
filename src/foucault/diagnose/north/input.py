"""Look at readings before north is sought: stops, times, and sizes that cannot be."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise

import numpy as np

from foucault.errors import Finding, FoucaultError, error, finding
from foucault.estimate.north.attitude import Known, compensated
from foucault.estimate.north.reduction import UNSEEN, Pairs, turn_rate
from foucault.logs.axes import long_enough, noisy, standstill
from foucault.logs.checks import moment
from foucault.models.dwells import Dwells
from foucault.models.earth import EARTH_RATE
from foucault.models.north_seeker import Compensation
from foucault.tables import IndexedLog
from foucault.units import plain, span

TOO_FAST = 1.5
"""Horizontal rate, in Earth rates, that no noise within reason gives [1]."""

ROWS = 8
"""Fewer rows may well read the same [1]."""

SIDES = ("right accelerometer", "forward accelerometer")
"""Two accelerometers that stay with the case."""

MANY_SD = 6.0
"""What differs by so many standard deviations is no noise [1]."""

OVERLAP = 0.9
"""Means that begin within this share of the one before overlap; clocks are coarse [1]."""

UNITS = ("north.index_unit", "north.gyro_unit", "north.accel_unit")
"""Findings of the reader that a unit looks wrong."""

BY_UNITS = (
    "north.sense", "north.index_zero", "north.gyro_scale", "north.undetermined", "north.too_fast",
    "north.tilt",
)  # fmt: skip
"""Errors that a wrong unit leads to."""


def alive(log: IndexedLog) -> tuple[Finding, ...]:
    """Refuse a sensor that reads one value throughout; name one that does so for a while.

    `log`: readings [SI].
    """
    columns = [("gyro", "gyro", log.gyro)]
    # A log that is free of noise, as made up ones are, has no stuck accelerometers.
    if log.accel is not None and (log.averaged is not None or noisy(log.gyro)):
        names = ("accelerometer",) if log.accel.shape[1] == 1 else SIDES
        columns += [("accel", *each) for each in zip(names, log.accel.T, strict=True)]
    needed = ROWS if log.averaged is not None else long_enough(log.interval)
    found = []
    for triad, sensor, x in columns:
        if triad == "accel" and log.averaged is not None and not x.any():
            continue  # means that say 0 throughout: it was levelled, to the digits that are given
        still = (0, len(x) - 1) if len(x) >= ROWS and np.ptp(x) == 0 else None
        still = still or standstill(x, needed)
        if still is None:
            continue
        start, end = still
        rows = end + 1 - start
        if triad == "gyro" or rows == len(x):
            unit, one = ("deg/h", np.pi / 180 / 3600) if triad == "gyro" else ("m/s^2", 1.0)
            value = f"{plain(float(x[start]) / one, 5)} {unit}"
            raise error("north.stuck", sensor=sensor, triad=triad, value=value, rows=rows,
                        of=len(x))  # fmt: skip
        axis = "column" if len(columns) == 2 else sensor.split()[0]
        first, last = (moment(log.time[k] - log.time[0]) for k in still)
        found.append(finding("log.stuck", triad=triad, axis=axis, start=first, end=last))
    return tuple(found)


def stops(dwells: Dwells, known: Known) -> tuple[Finding, ...]:
    """Look at the index angles of every set-up: missing, repeated, too few.

    `dwells`: readings [SI]; `known`: a rough heading and how level the case stands, if they were
    given. Raises ``north.stops`` and ``north.stops_tilt`` where they do not show the heading or
    the tilt.
    """
    patterns = [_pattern(dwells.of(i)) for i in range(len(dwells.names))]
    found: list[Finding] = []
    times = Counter(map(tuple, patterns))
    for pattern, count in times.items():  # set-ups with the same stops are named once
        angles = list(pattern)
        name = dwells.names[patterns.index(angles)]
        name += f" and {count - 1} more" * (count > 1)
        distinct = sorted(set(angles))
        if not spans(distinct):
            if known.near is None:
                raise error("north.stops", name=name, stops=_list(distinct))
            on_base = dwells.accel is not None and dwells.accel.shape[1] == 1
            if on_base and known.level_sd is None:
                raise error("north.stops_tilt", name=name, stops=_list(distinct))
        found += _opposites(name, angles, distinct) if len(angles) < 24 else []
    found += _overlaps(dwells)
    usual, often = Counter(map(tuple, map(sorted, patterns))).most_common(1)[0]
    if often > 1 and often > len(patterns) / 2:
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


def spans(angles: list[int]) -> bool:
    """Tell whether constant, cosine and sine over these angles can be told apart.

    `angles`: index angles that differ, in whole degrees [deg].
    """
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


def late_index(dwells: Dwells, lag_sd: float | None) -> tuple[Finding, ...]:
    """Say what a late index angle does where the base turns, and nobody said how late it can be.

    `dwells`: readings [SI]; `lag_sd` or None: as declared [s].
    """
    first = dwells.of(0)
    if lag_sd is not None or not len(first) or not first.rotates:
        return ()
    rate = turn_rate(first)
    half = dwells.interval / 2
    return (
        finding("north.index_lag", rate=f"{np.degrees(rate):.3g}", lag=span(half),
                effect=f"{np.degrees(rate * half):.2g}"),
    )  # fmt: skip


def _overlaps(dwells: Dwells) -> list[Finding]:
    """Notice means that begin long before the one before has ended."""
    step = np.diff(dwells.start)
    early = (step < OVERLAP * dwells.time[:-1]) & (np.diff(dwells.setup) == 0)
    if not early.any():
        return []
    row = int(np.argmax(early))
    return [finding("north.overlap", name=dwells.names[dwells.setup[row]],
                    dwell=f"{dwells.time[row]:.4g}", step=f"{step[row]:.4g}")]  # fmt: skip


def require_plausible(
    dwells: Dwells, pairs: Pairs, known: Known, compensation: Compensation
) -> None:
    """Refuse more than the Earth's rate, and more than gravity.

    `pairs`: set-ups [SI].
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


@contextmanager
def units_first(findings: tuple[Finding, ...]) -> Iterator[None]:
    """Let a wrong unit that the reader has noticed explain what fails because of it."""
    try:
        yield
    except FoucaultError as problem:
        for seen in findings:
            if problem.code in BY_UNITS and seen.code in UNITS:
                words = f"{problem.message} {seen.message}"
                raise FoucaultError(seen.code, words, seen.cure) from None
        raise
