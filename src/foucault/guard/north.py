"""Why the Earth's rate does not fit the latitude: mistakes that are tried one by one.

The angle between the Earth's rate and gravity is known, 90 deg plus the latitude. Where readings
depart from it, they are changed back as each mistake would have changed them, and solved again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.errors import Finding, finding
from foucault.estimate.north import PLAUSIBLE, Fixes, Hemisphere, Known, solve
from foucault.estimate.north_reduction import Pairs
from foucault.guard.mistakes import DEGREE, Mistake, explain
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.north_seeker import Compensation, Dwells
from foucault.models.rotation import turned
from foucault.units import STANDARD_GRAVITY, plain

ENOUGH = 200
"""Set-ups that are tried: more say the same [1]."""


def _undo(words: str, *rows: tuple[int, float], of: str = "any") -> Mistake:
    """Return a mistake of the four numbers of a set-up: the column and the factor of each row."""
    undo = np.zeros((4, 4))
    for row, (column, value) in enumerate(rows):
        undo[row, column] = value
    return Mistake(words, exchange=undo, of=of)


def _scaled(words: str, gyro: float, accel: float, of: str = "any") -> Mistake:
    return _undo(words, (0, gyro), (1, gyro), (2, accel), (3, accel), of=of)


MISTAKES = (
    _scaled("the accelerometers have the other sign, `reads` in [log.accel] or --accel-reads",
            1.0, -1.0),
    _scaled("the gyro has the other sign", -1.0, 1.0),
    _scaled("the latitude has the other sign", 1.0, 1.0, of="latitude"),
    _undo("the two accelerometers are exchanged", (0, 1.0), (1, 1.0), (3, 1.0), (2, 1.0),
          of="case"),
    _undo('index angles count the other way, sense = "counter-clockwise" in [log.index]',
          (0, -1.0), (1, 1.0), (2, 1.0), (3, 1.0), of="case"),
    _undo('index angle 90 deg is forward, zero = "90 deg" in [log.index]',
          (1, -1.0), (0, 1.0), (2, 1.0), (3, 1.0), of="case"),
    _scaled('index angle 180 deg is forward, zero = "180 deg" in [log.index]', -1.0, 1.0,
            of="case"),
    _undo('index angle 270 deg is forward, zero = "270 deg" in [log.index]',
          (1, 1.0), (0, -1.0), (2, 1.0), (3, 1.0), of="case"),
    _scaled("the accelerometers are in g where m/s^2 is said", 1.0, STANDARD_GRAVITY),
    _scaled("the accelerometers are in m/s^2 where g is said", 1.0, 1 / STANDARD_GRAVITY),
    _scaled("the gyro is in deg/s where deg/h is said", 3600.0, 1.0),
    _scaled("the gyro is in rad/s where deg/s is said", 1 / DEGREE, 1.0),
)  # fmt: skip
"""In the order in which they are named; those of the case where the accelerometers are on it."""


def causes(
    dwells: Dwells, of: Callable[[IntArray], Pairs], fixes: Fixes, known: Known,
    compensation: Compensation,
) -> tuple[Finding, ...]:  # fmt: skip
    """Name mistakes that explain why the Earth's rate contradicts the latitude.

    `dwells`: readings [SI]; `of`: set-ups of numbers (k,) -> their four numbers [SI]; `fixes`:
    solutions [rad].
    """
    if known.latitude is None or dwells.accel is None:
        return ()
    finite = np.flatnonzero(np.isfinite(fixes.square))
    some = finite[:: -(-len(finite) // ENOUGH) or 1]
    if not len(some):
        return ()
    place = known.of(some)
    given = place.latitude
    assert given is not None
    chosen = of(some)
    square, most = float(fixes.square[some].sum()), chi_square_limits(len(some))[1]

    def solved(mistake: Mistake, latitude: float | FloatArray | None = None) -> Fixes:
        T = mistake.exchange
        sources = {name: T @ S @ T.T for name, S in chosen.sources.items()}
        other = given if latitude is None else latitude
        readings = replace(chosen, values=mistake.right(chosen.values), sources=sources)
        there = replace(place, latitude=-other if mistake.of == "latitude" else other)
        return solve(readings, there, compensation)

    def miss(mistake: Mistake) -> float:
        return float(np.nansum(solved(mistake).square))

    on_case = dwells.accel.shape[1] == 2
    tried = [m for m in MISTAKES if on_case or m.of != "case"]
    seen = explain(miss, tried, wrong=most + PLAUSIBLE, fits=most, within=most, now=square)
    if seen.now < most + PLAUSIBLE:
        return ()
    explained = [(m.words, solved(m)) for m in seen.by]
    if not explained and (latitude := _latitude_seen(chosen, place, compensation)) is not None:
        again = solved(_scaled("", 1.0, 1.0), latitude)
        factor = np.cos(latitude) / np.cos(given)
        if np.nansum(again.square) < most:
            words = f"the latitude is {np.degrees(latitude):.3f} deg, or the gyro says "
            explained = [(f"{words}{factor:.4f} times the rate", again)]
    if not explained:
        return ()
    change = max(
        float(np.nanmax(np.abs(turned(again.angles[:, 0] - fixes.angles[some, 0]))))
        for _, again in explained
    )
    size = f"{np.sqrt(square / len(some)):.1f}"
    return (finding("north.misfit", size=size, causes="; or ".join(words for words, _ in explained),
                    change=plain(float(np.degrees(change)), 2)),)  # fmt: skip


def _latitude_seen(pairs: Pairs, known: Known, compensation: Compensation) -> float | None:
    """Return the latitude that the readings themselves give, of one place [rad]."""
    if known.latitude is None or isinstance(known.latitude, np.ndarray):
        return None  # no one latitude explains several places
    there: Hemisphere = "north" if known.latitude >= 0 else "south"
    free = solve(pairs, replace(known, latitude=None, hemisphere=there), compensation)
    weight = 1.0 / free.cov[:, 3, 3]
    good = np.isfinite(weight) & np.isfinite(free.angles[:, 3])
    if not good.any():
        return None
    return float(np.average(free.angles[good, 3], weights=weight[good]))
