"""Positions of a table, one after the other: which of them are done, and what those have shown.

A position is recognised by which way is up in the instrument, a spin by its rate besides; in which
order they come does not matter. What is known after some of them is what the plan of the campaign
foresees for these alone, and when all are done, or enough is known, the session is calibrated.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.capture.step import UP, Reached, Step, Wanted, Way
from foucault.coefficients import CoefficientVector
from foucault.models.rotation import aligning
from foucault.models.turntable import TablePlan, chain
from foucault.procedures.on_table.plan import Bench
from foucault.tables import Log

NEAR = np.radians(15.0)
"""Up is so near that of a position, or half as far as the next position, if that is less [rad]."""

LONG = 0.9
"""A rest or spin of so much of its time counts [1]."""

EDGES = 1.0
"""Of what a table does by its program, so much is taken for motion before and after [s]."""

AS_FAST = 0.5
"""A quiet time that turns by so much of the rate of a spin is one [1]."""


@dataclass
class OnTable(Way):
    """What positions of a table have shown, and which of the list is next."""

    bench: Bench
    plan: TablePlan
    wanted: Wanted
    hold: float | None = None  # time to rest, None: of the plan [s]
    gyro: bool = True
    spins: bool = True  # quiet times that turn are looked at, too
    ticked: BoolArray = field(init=False)  # (n,)
    # what is done -> sd of everything (p,) [SI]
    _sds: dict[bytes, FloatArray] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        """Begin with nothing done."""
        self.ticked = np.zeros(len(self.plan), bool)

    @cached_property
    def up(self) -> FloatArray:
        """What is up in each position, shape (n, 3) [1]."""
        at = chain(self.plan.angles)
        return np.where(self.spun[:, None], at.outer_k, at.up_k)

    @cached_property
    def spun(self) -> BoolArray:
        """Which of the list are spins, shape (n,)."""
        return np.asarray(self.plan.rate != 0.0)

    @cached_property
    def near(self) -> float:
        """How far up may be from that of a position, shape () [rad]."""
        apart = np.arccos(np.clip(self.up @ self.up.T, -1.0, 1.0))
        others = apart[apart > np.radians(1.0)]
        return float(min(NEAR, others.min(initial=np.pi) / 2))

    def seconds(self, k: int) -> float:
        """Return how long one of the list takes, shape () [s]; `k`: its number [1]."""
        if self.hold is not None and not self.spun[k]:
            return self.hold
        time = float(self.plan.time[k])
        return max(LONG * time, time - EDGES)

    @property
    def done(self) -> tuple[int, int]:
        return int(self.ticked.sum()), len(self.ticked)

    def step(self, k: int) -> Step:
        """Return what is to be done for one of the list; `k`: its number [1]."""
        angles = ", ".join(f"{np.degrees(a):.4g}" for a in self.plan.angles[k])
        kind: Any = "spin" if self.spun[k] else "rest"
        return Step(kind, self.up[k], self.seconds(k), name=f"{k + 1} ({angles} deg)")

    def first_step(self) -> Step:
        return self.step(0)

    def reached(self, log: Log, first: IntArray, last: IntArray) -> Reached:
        assert log.accel is not None
        self.ticked[:] = False
        C_nb = np.empty((len(first), 3, 3))
        for i, (a, b) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
            f = log.accel[a:b].mean(axis=0)
            up = f / np.linalg.norm(f)
            rate = 0.0 if log.gyro is None else float(log.gyro[a:b].mean(axis=0) @ up)
            seconds = float(log.time[b - 1] - log.time[a]) + log.interval
            self.unlisted = not self._tick(up, rate, seconds)
            C_nb[i] = aligning(up, UP)
        return self._known(self.ticked, C_nb)

    def _tick(self, up: FloatArray, rate: float, seconds: float) -> bool:
        """Tick the position of a rest or spin; tell whether it is one of the list."""
        of_spins = self.plan.rate[self.spun]
        spun = bool(len(of_spins)) and abs(rate) > AS_FAST * float(np.abs(of_spins).min())
        off = np.arccos(np.clip(self.up @ up, -1.0, 1.0))
        same = (off < self.near) & (self.spun == spun)
        if spun:
            same &= np.sign(self.plan.rate) == np.sign(rate)
        long = np.array([LONG * self.seconds(k) <= seconds for k in range(len(off))])
        fits = np.flatnonzero(same & long & ~self.ticked)
        if len(fits):
            self.ticked[fits[np.argmin(off[fits])]] = True
        return bool(same.any())

    def _known(self, done: BoolArray, C_nb: FloatArray) -> Reached:
        """Return what the positions that are `done` (n,) show; `C_nb` (m, 3, 3): attitudes [1]."""
        prior = CoefficientVector.prior(self.wanted.layout, dict(self.bench.prior))
        none: Any = None
        sd = self._sd(done)
        enough = bool(done.all() or (sd <= self.wanted.sd).all())
        return Reached(sd, none, none, {}, prior, C_nb, none, solved=enough)

    def _sd(self, done: BoolArray) -> FloatArray:
        key, p = done.tobytes(), self.plan
        if done.any() and key not in self._sds:  # what a step was to show is what it then shows
            found = self.bench.bound(TablePlan(p.name, p.angles[done], p.rate[done], p.time[done]))
            sd = dict(zip(found.names, found.sd.tolist(), strict=True))
            self._sds[key] = np.array([sd.get(name, np.inf) for name in self.wanted.names])
        return self._sds.get(key, np.full(len(self.wanted.layout), np.inf))

    def candidates(self, reached: Reached) -> list[Step]:
        left = np.flatnonzero(~self.ticked)
        return [self.step(int(left[0]))] if len(left) else []

    def after(self, reached: Reached, steps: list[Step]) -> FloatArray:
        done = self.ticked.copy()
        done[np.flatnonzero(~done)[: len(steps)]] = True
        return self._sd(done)[None]

    def everything(self, log: Log, first: IntArray, last: IntArray, reached: Reached) -> Reached:
        return self._known(np.ones(len(self.ticked), bool), reached.C_nb)
