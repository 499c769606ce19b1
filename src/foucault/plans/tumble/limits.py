"""What a rig allows a torqued cluster to do, and into what slots of time a search cuts it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import ceil

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.plans.tumble.reach import Limits
from foucault.tables import AXES

FINEST = float(np.radians(6.0))
"""Largest turn in a slot: its bounds are a few per cent too large, and order plans all the same."""

USUAL = 24
"""Segments that a random plan has at most, where nothing limits their length [1]."""

FEWEST = 4
"""Segments that a plan has at least [1]."""


NO_LIMITS = Limits()


@dataclass(frozen=True)
class Allowed:
    """What the rig can do, and the user wants."""

    rates: tuple[float, ...]  # rates about an axis [rad/s]
    axes: str  # axes that may be turned
    together: bool  # whether several axes may turn at once, each at the same rate
    total: float  # time of the whole [s]
    shortest: float  # of a segment [s]
    start: FloatArray  # (3,) outer, middle and inner angle at the beginning [rad]
    ramp: float = 0.0  # time in which each rate is reached, which comes on top of the whole [s]
    limits: Limits = NO_LIMITS  # what the rig could do, and where its gimbals end

    def __post_init__(self) -> None:
        fastest = max(self.rates)
        if fastest * self.total < 2 * np.pi * (1 - 1e-9):
            raise error(
                "optimise.time", rate=f"{np.degrees(fastest):.4g}", total=f"{self.total:g}",
                angle=np.degrees(fastest * self.total), needed=ceil(2 * np.pi / fastest),
            )  # fmt: skip
        if FEWEST * self.shortest > self.total:
            raise error(
                "optimise.segment", shortest=f"{self.shortest:g}", total=f"{self.total:g}",
                fitting=int(self.total / self.shortest), least=FEWEST,
                longest=self.total / FEWEST,
            )  # fmt: skip

    @cached_property
    def turns(self) -> FloatArray:
        """Rates that a segment may have, frame p, shape (m, 3) [rad/s]."""
        free = [(-1.0, 0.0, 1.0) if axis in self.axes else (0.0,) for axis in AXES]
        signs = [s for s in product(*free) if any(s)]
        if not self.together:
            signs = [s for s in signs if sum(map(abs, s)) == 1]
        return np.array([[r * v + 0.0 for v in s] for r in self.rates for s in signs])

    @cached_property
    def slots(self) -> int:
        """Number of slots of the whole [1]."""
        fastest = float(np.linalg.norm(self.turns, axis=1).max())
        fewest = ceil(self.total * fastest / FINEST - 1e-9)
        whole = [n for n in range(fewest, 2 * fewest) if (self.total / n).is_integer()]
        return whole[0] if whole else fewest  # times in whole seconds, where there are such

    @property
    def slot(self) -> float:
        """Length of a slot [s]."""
        return self.total / self.slots

    @property
    def least(self) -> int:
        """Slots of the shortest segment [1]."""
        return max(1, min(ceil(self.shortest / self.slot - 1e-9), self.slots // FEWEST))

    @property
    def most(self) -> int:
        """Segments of a random plan at most: enough to go to and fro between the limits [1]."""
        turned = self.total * max(self.rates)
        to_and_fro = [ceil(2 * turned / limit) for limit in self.limits.angles]
        return min(max([USUAL, *to_and_fro]), self.slots // self.least)

    @property
    def words(self) -> str:
        """All of it in words."""
        rates = ", ".join(f"{np.degrees(r):.4g}" for r in self.rates)
        how = "together or one at a time" if self.together else "one at a time"
        out = f"turns about {', '.join(self.axes)}, {how}, at {rates} deg/s for {self.total:g} s"
        for name in ("tilt", "middle", "cable"):
            limit = getattr(self.limits, name)
            out += "" if limit is None else f", {name} limit {np.degrees(limit):g} deg"
        return out
