"""Why the Earth's rate does not fit the latitude: mistakes that are tried one by one.

The angle between the Earth's rate and gravity is known, 90 deg plus the latitude. Where readings
depart from it, they are changed back as each mistake would have changed them, and solved again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.errors import Finding, finding
from foucault.estimate.chi_square import chi_square_limits
from foucault.estimate.north.attitude import PLAUSIBLE, Fixes, Hemisphere, Known, solve
from foucault.estimate.north.reduction import Pairs
from foucault.models.dwells import Dwells
from foucault.models.north_seeker import Compensation
from foucault.models.rotation import turned
from foucault.units import STANDARD_GRAVITY, plain

ENOUGH = 200
"""Set-ups that are tried: more say the same [1]."""


@dataclass(frozen=True)
class _Mistake:
    """What may have gone wrong: in words, and the four numbers without it as a matrix."""

    words: str
    undo: FloatArray
    on_case: bool = False
    opposite_latitude: bool = False


def _undo(*rows: tuple[int, float]) -> FloatArray:
    """Return the matrix with one entry per row: its column and its value."""
    out = np.zeros((4, 4))
    for row, (column, value) in enumerate(rows):
        out[row, column] = value
    return out


def _scaled(gyro: float, accel: float) -> FloatArray:
    return _undo((0, gyro), (1, gyro), (2, accel), (3, accel))


MISTAKES = (
    _Mistake("the accelerometers have the other sign, `reads` in [log.accel] or --accel-reads",
             _scaled(1.0, -1.0)),
    _Mistake("the gyro has the other sign", _scaled(-1.0, 1.0)),
    _Mistake("the latitude has the other sign", _scaled(1.0, 1.0), opposite_latitude=True),
    _Mistake("the two accelerometers are exchanged",
             _undo((0, 1.0), (1, 1.0), (3, 1.0), (2, 1.0)), on_case=True),
    _Mistake('index angles count the other way, sense = "counter-clockwise" in [log.index]',
             _undo((0, -1.0), (1, 1.0), (2, 1.0), (3, 1.0)), on_case=True),
    _Mistake('index angle 90 deg is forward, zero = "90 deg" in [log.index]',
             _undo((1, -1.0), (0, 1.0), (2, 1.0), (3, 1.0)), on_case=True),
    _Mistake('index angle 180 deg is forward, zero = "180 deg" in [log.index]',
             _scaled(-1.0, 1.0), on_case=True),
    _Mistake('index angle 270 deg is forward, zero = "270 deg" in [log.index]',
             _undo((1, 1.0), (0, -1.0), (2, 1.0), (3, 1.0)), on_case=True),
    _Mistake("the accelerometers are in g where m/s^2 is said",
             _scaled(1.0, STANDARD_GRAVITY)),
    _Mistake("the accelerometers are in m/s^2 where g is said",
             _scaled(1.0, 1 / STANDARD_GRAVITY)),
    _Mistake("the gyro is in deg/s where deg/h is said", _scaled(3600.0, 1.0)),
    _Mistake("the gyro is in rad/s where deg/s is said", _scaled(float(np.degrees(1.0)), 1.0)),
)  # fmt: skip
"""In the order in which they are named."""


def causes(
    dwells: Dwells, pairs: Pairs, fixes: Fixes, known: Known, compensation: Compensation
) -> tuple[Finding, ...]:
    """Name the mistakes that explain why the Earth's rate does not fit the latitude.

    `pairs`: set-ups [SI]; `fixes`: their solutions [rad].
    """
    if known.latitude is None or dwells.accel is None:
        return ()
    finite = np.flatnonzero(np.isfinite(fixes.square))
    some = finite[:: -(-len(finite) // ENOUGH) or 1]
    if not len(some):
        return ()
    square, most = float(fixes.square[some].sum()), chi_square_limits(len(some))[1]
    if square < most + PLAUSIBLE:
        return ()
    on_case = dwells.accel.shape[1] == 2
    chosen = _chosen(pairs, some)
    place = known.of(some)
    found: list[str] = []
    change = 0.0
    for mistake in MISTAKES:
        if mistake.on_case and not on_case:
            continue
        again = _without(mistake, chosen, place, compensation)
        if np.nansum(again.square) < most:
            found.append(mistake.words)
            change = max(change, _change(again, fixes, some))
    if not found:
        found, change = _elsewhere(chosen, place, compensation, most, fixes, some)
    if not found:
        return ()
    size = f"{np.sqrt(square / len(some)):.1f}"
    return (finding("north.misfit", size=size, causes="; or ".join(found),
                    change=plain(float(np.degrees(change)), 2)),)  # fmt: skip


def _chosen(pairs: Pairs, some: npt.NDArray[np.int64]) -> Pairs:
    sources = {name: S[some] for name, S in pairs.sources.items()}
    return replace(pairs, values=pairs.values[some], sources=sources)


def _without(
    mistake: _Mistake, pairs: Pairs, known: Known, compensation: Compensation
) -> Fixes:  # fmt: skip
    T = mistake.undo
    sources = {name: T @ S @ T.T for name, S in pairs.sources.items()}
    place = known
    if mistake.opposite_latitude and known.latitude is not None:
        place = replace(known, latitude=-known.latitude)
    return solve(replace(pairs, values=pairs.values @ T.T, sources=sources), place, compensation)


def _change(again: Fixes, fixes: Fixes, some: npt.NDArray[np.int64]) -> float:
    return float(np.nanmax(np.abs(turned(again.angles[:, 0] - fixes.angles[some, 0]))))


def _elsewhere(
    pairs: Pairs, known: Known, compensation: Compensation, most: float, fixes: Fixes,
    some: npt.NDArray[np.int64],
) -> tuple[list[str], float]:  # fmt: skip
    """Try the latitude that the readings themselves give."""
    assert known.latitude is not None
    if isinstance(known.latitude, np.ndarray):  # no one latitude explains several places
        return [], 0.0
    there: Hemisphere = "north" if known.latitude >= 0 else "south"
    free = solve(pairs, replace(known, latitude=None, hemisphere=there), compensation)
    weight = 1.0 / free.cov[:, 3, 3]
    good = np.isfinite(weight) & np.isfinite(free.angles[:, 3])
    if not good.any():
        return [], 0.0
    latitude = float(np.average(free.angles[good, 3], weights=weight[good]))
    again = solve(pairs, replace(known, latitude=latitude), compensation)
    if np.nansum(again.square) >= most:
        return [], 0.0
    factor = np.cos(latitude) / np.cos(known.latitude)
    words = (
        f"the latitude is {np.degrees(latitude):.3f} deg, or the gyro says {factor:.4f} times the "
        "rate"
    )
    return [words], _change(again, fixes, some)
