"""What a table is told to do: rests in a set of positions, and spins of its outer axis in each."""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.models.turntable import TablePlan
from foucault.plans.table.directions import Positions, positions

FOUR_POSITIONS = np.radians(
    [[0.0, 0.0, 0.0], [0.0, 90.0, 0.0], [180.0, 0.0, 0.0], [180.0, 90.0, 0.0]]
)
"""Outer, middle and inner angle of the published frame unification (Dong et al. 2018, table 2)."""


def table_plan(
    name_or_positions: Positions,
    *,
    spin_rate: float,
    rest_time: float,
    turns: int,
    spins: bool = True,
    both_senses: bool = False,
    four_positions: bool = False,
) -> TablePlan:
    """Plan rests in all positions, then spins of the outer axis in all of them.

    `name_or_positions` (n, 3): name of a set of positions, or outer, middle and inner angles
    [rad]; `spin_rate`: rate of the outer axis, counter-clockwise seen from above [rad/s];
    `rest_time`: length of each rest [s]; `turns`: whole turns of each spin [1]; `both_senses`:
    whether each spin is followed by one the other way; `four_positions`: whether the rests and
    spins that the published frame unification needs are added where they are missing.
    """
    name, angles = positions(name_or_positions)
    if spins and not (spin_rate and turns >= 1):
        raise error("plan.spin", rate=f"{np.degrees(spin_rate):g}", turns=turns)
    if not rest_time > 0:
        raise error("plan.rest_time", given=f"{rest_time:g}")
    spun = angles
    if four_positions:
        spun = _with_missing(angles, FOUR_POSITIONS[:2], outer=False)
        angles = _with_missing(angles, FOUR_POSITIONS, outer=True)
    if not spins:
        spun = angles[:0]
    senses = (1.0, -1.0) if both_senses else (1.0,)
    rate = np.tile([spin_rate * s for s in senses], len(spun))
    one_spin = turns * 2 * np.pi / abs(spin_rate) if spins else 0.0
    return TablePlan(
        name,
        np.concatenate([angles, np.repeat(spun, len(senses), axis=0)]),
        np.concatenate([np.zeros(len(angles)), rate]),
        np.concatenate([np.full(len(angles), rest_time), np.full(len(rate), one_spin)]),
    )


def _with_missing(angles: FloatArray, needed: FloatArray, outer: bool) -> FloatArray:
    """Add those of the needed positions that are missing; in spins the outer angle is free."""
    first = 0 if outer else 1
    apart = np.abs(np.sin((angles[:, None, first:] - needed[:, first:]) / 2)).max(axis=2)
    return np.concatenate([angles, needed[(apart > 1e-9).all(axis=0)]])
