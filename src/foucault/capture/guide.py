"""A guide through a session: what to do next and why, what is wrong, and when it is enough.

It is fed with samples as they come and keeps the rests that `LiveRests` finds. After each of them
the way of the procedure says how well everything is known by then, and of all that could be done
next the guide takes what lowers the worst coefficient most for the time that it takes. With s_i
the standard deviations and w_i those wanted, the worst counts most in ``sum (s_i / w_i)^SHARP``.

Whether somebody obeys does not matter: what was done is what counts, and the next step follows
from that.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.capture.step import Reached, Step, Way
from foucault.detect.live import LiveRests
from foucault.detect.stretches import HAND, How
from foucault.diagnose.live import Watchman
from foucault.errors import Finding, FoucaultError
from foucault.kernels.rotation import integrate_turns
from foucault.logs.description import LogDescription
from foucault.models.rotation import aligning, exp, log
from foucault.result import Result
from foucault.tables import Log

SHARP = 8.0
"""Power with which the worst coefficient counts above the others [1]."""

BESIDE = 5.0
"""Time that every step takes beside turn and rest: it is read, and the instrument settles [s]."""

BESIDES = 3.0
"""What is not wanted is to be known to so many times what is usual, before a solution [1]."""

GAINS = 0.9
"""A ratio of sds above it is not what a step is for [1]."""

LONGER = 4
"""Of so many of the best steps it is tried whether to rest twice as long [1]."""

OTHER = np.radians(25.0)
"""A rest that is farther from what was asked is another one [rad]."""

CREEPS = 6.0, 3e-4
"""Halves of a rest differ by more than so many standard deviations and by more than this part of
gravity: something pulls [1]."""

COARSE = 12.0
"""A turn whose angle changes by so many standard deviations when every other sample is left out is
too fast for the rate: what the rule then misses is a quarter of that [1]."""

FLOOR = 0.9
"""What is left out is looked into where it is so much of what is wanted [1]."""

SELDOM = 4
"""Rests until what everything would show is computed again [1]."""

PATIENCE = 6
"""Rests after enough of them that a verdict may still take to become a pass [1]."""

Phase = Literal["learn", "move", "rest", "next", "done"]


@dataclass(frozen=True)
class Why:
    """What a step is for."""

    name: str  # coefficient that gains
    ratio: float  # its sd after over before [1]


@dataclass(frozen=True)
class Mistake:
    """What somebody did that harms: a key of the words, and what fills them."""

    key: str
    values: dict[str, Any]
    at: float  # when [s]


@dataclass
class Guide:
    """A session that is guided."""

    way: Way
    used: LogDescription  # complete description of the log
    judge: Callable[[Log], Result]  # calibrates what was recorded
    how: How = HAND
    step: Step | None = None
    why: Why | None = None
    reached: Reached | None = None
    expected: FloatArray | None = None  # (p,) sd after the step [SI]
    rests: int = 0  # that were kept [1]
    mistakes: list[Mistake] = field(default_factory=list)
    result: Result | None = None
    floored: dict[str, str] = field(default_factory=dict)  # coefficient -> group that sets a floor
    stopped: Literal["", "enough", "floor", "verdict", "list"] = ""
    sounds: int = 0  # rests that have ended so far: each is told by a sound [1]

    def __post_init__(self) -> None:
        """Begin."""
        self.found = LiveRests(self.how)
        self._watch = Watchman(self.found, self.used)
        self._handled = -1  # sample at which the last complete rest was looked at
        self._still: tuple[int, float] | None = None  # rest that lasts: where it began, its length
        self._attitude: tuple[int, FloatArray] | None = None
        self._tried, self._asked = 0, 0
        self._before = 0  # mistakes before the rest that ended last [1]
        self._best: FloatArray | None = None
        self.step = self.way.first_step()

    # -- what is seen ------------------------------------------------------------------------

    def add(self, part: Log) -> bool:
        """Take samples; tell whether a rest has ended with them [SI]."""
        self.found.add(part)
        found, before = self.found, self._still
        if not found.samples or self.step is None:
            return False
        since = found.still_since
        self._still = None if since is None else (since, found.run)
        if since is None or since < self._handled:
            if before is not None and since is None and before[0] >= self._handled:
                self._left_early(*before)
            elif before is not None and since is None and self.done is not None:
                self._look(again=True)  # a spin went on after what was asked
            return False
        if found.run < self.step.seconds:
            return False
        self._handled = len(found)
        self.rests += 1
        self.sounds += 1
        self._before = len(self.mistakes)
        self._look()
        return True

    def _left_early(self, since: int, length: float) -> None:
        assert self.step is not None
        if 0.25 * self.step.seconds < length < self.step.seconds:
            self._mistake("moved", since, held=length, wanted=self.step.seconds)

    def _mistake(self, key: str, sample: int, **values: Any) -> None:
        time = self.found.log.time
        at = float(time[min(sample, len(time) - 1)] - time[0])
        self.mistakes.append(Mistake(key, values, at))

    def recent(self, count: int) -> list[Mistake]:
        """Return the last mistakes; why it was not enough only until the next rest.

        `count`: of how many [1].
        """
        first = max(0, len(self.mistakes) - count)
        return [m for k, m in enumerate(self.mistakes)
                if k >= first and (k >= self._before or m.key != "refused")]  # fmt: skip

    def still(self) -> tuple[IntArray, IntArray]:
        """Return first and one-past-last sample of every rest so far, shape (n,) each.

        Spins are among them where the way asks for them.
        """
        first, last, turns = self.found.rests()
        kept = ~turns | self.way.spins
        return first[kept], last[kept]

    # -- after a rest ------------------------------------------------------------------------

    def _look(self, again: bool = False) -> None:
        first, last = self.still()
        if not len(first):
            return
        log = self.found.log
        if not again:
            self._wrongs(log, first, last)
        reached = self.way.reached(log, first, last)
        if reached is None:
            return
        self.reached = reached
        if reached.C_nb.shape[0] == len(first):
            self._attitude = (int(last[-1]), reached.C_nb[-1])
        if self.way.unlisted and not again:
            self._mistake("unlisted", int(first[-1]))
        if reached.solved or self._listed:
            self._floors(log, first, last)
            if self._enough():
                self._judge(log)
        if not self.stopped:
            self._choose()

    def open_(self) -> FloatArray:
        """Whether a coefficient is still to be lowered, and can be, shape (p,)."""
        wanted = self.way.wanted
        assert self.reached is not None
        out = self.reached.sd > wanted.sd
        return np.asarray(out & [n not in self.floored for n in wanted.names])

    def _enough(self) -> bool:
        return self._listed or not self.open_().any()

    @property
    def _listed(self) -> bool:
        """Whether there is a list, and all of it is done."""
        return self.done is not None and self.done[0] == self.done[1]

    def _floors(self, log: Log, first: IntArray, last: IntArray) -> None:
        """Look whether what is left out keeps a coefficient above what is wanted, for good."""
        reached, wanted = self.reached, self.way.wanted
        assert reached is not None
        self.floored = {}
        if reached.floor is None:
            return
        near = (np.sqrt(reached.floor) > FLOOR * wanted.sd) & (reached.sd > wanted.sd)
        if near.any() and (self._best is None or self.rests >= self._asked + SELDOM):
            self._asked = self.rests
            self._best = self.way.everything(log, first, last, reached).sd
        if self._best is not None:
            lost = np.flatnonzero(near & (self._best > wanted.sd))
            self.floored = {wanted.names[k]: reached.by[k] for k in lost}

    def _judge(self, log: Log) -> None:
        """Calibrate, and end where the verdict is earned or more rests do not help it."""
        self._tried += 1
        try:
            self.result = self.judge(log)
        except FoucaultError as problem:
            self._mistake("refused", len(log) - 1, reason=problem.message)
            self.stopped = "list" if self._listed else ""
            self.step = None if self.stopped else self.step
            return
        if self.floored:
            self.stopped = "floor"
        elif self.result.verdict.level == "pass" and not self.open_().any():
            self.stopped = "enough"
        elif self._listed:
            self.stopped = "list"
        elif self._tried > PATIENCE:
            self.stopped = "verdict"
        if self.stopped:
            self.step = None
        else:
            self._mistake("refused", len(log) - 1, reason=self.result.verdict.reasons[0])

    def cost(self, sd: FloatArray) -> FloatArray:
        """Return how far `sd` (..., p) are from what is wanted, the worst first [1]."""
        wanted, limit = self.way.wanted, self._limit
        counts = np.isfinite(limit) & [n not in self.floored for n in wanted.names]
        ratio = np.asarray(sd)[..., counts] / limit[counts]
        most = ratio.max(axis=-1, keepdims=True, initial=1e-300)
        sharp = np.log(np.sum((ratio / most) ** SHARP, axis=-1)) / SHARP
        return np.asarray(np.log(most[..., 0]) + sharp)

    @property
    def _limit(self) -> FloatArray:
        """What is wanted, shape (p,); before a solution of everything, for that takes all [SI]."""
        wanted = self.way.wanted
        if self.reached is None or self.reached.solved:
            return wanted.sd
        return np.where(np.isfinite(wanted.sd), wanted.sd, BESIDES * wanted.typical)

    def _choose(self) -> None:
        reached = self.reached
        assert reached is not None
        steps = self.way.candidates(reached)
        if not steps:
            return
        if self.done is not None:  # the list says what is next
            self.step, self.why = steps[0], None
            self.expected = self.way.after(reached, steps[:1])[0]
            return
        after, gain = self._gain(reached, steps)
        best = np.argsort(-gain)[:LONGER]
        twice = [replace(steps[k], seconds=2 * steps[k].seconds) for k in best]
        more, gain_of_more = self._gain(reached, twice)
        steps, after = [*steps, *twice], np.append(after, more, 0)
        k = int(np.argmax(np.append(gain, gain_of_more)))
        self.step, self.expected = steps[k], after[k]
        self.why = self._why(after[k] / reached.sd)

    def _why(self, ratio: FloatArray) -> Why:
        """Say what gains by a step: the worst, else what gains most of all that lack."""
        assert self.reached is not None
        names = self.way.wanted.names
        need = self.reached.sd / self._limit
        need[[n in self.floored for n in names]] = 0.0
        best = int(np.argmax(need))
        for some in (need > 0.7 * need.max(), need > 1.0, need > 0.0):
            if ratio[best] > GAINS and some.any():
                best = int(np.argmin(np.where(some, ratio, np.inf)))
        return Why(names[best], float(ratio[best]))

    def _gain(self, reached: Reached, steps: list[Step]) -> tuple[FloatArray, FloatArray]:
        """Return the sds after each of `steps`, and what that gains for the time it takes."""
        after = self.way.after(reached, steps)
        times = np.array([s.seconds + s.turn_time + BESIDE for s in steps])
        return after, (self.cost(reached.sd) - self.cost(after)) / times

    # -- mistakes ----------------------------------------------------------------------------

    def _wrongs(self, log: Log, first: IntArray, last: IntArray) -> None:
        assert log.accel is not None
        a, b = int(first[-1]), int(last[-1])
        part = log.accel[a:b]
        half = len(part) // 2
        if half > 4:
            one, two = part[:half], part[half:]
            moved = np.abs(two.mean(axis=0) - one.mean(axis=0))
            sd = np.sqrt((one.var(axis=0) + two.var(axis=0)) / half)
            limit = np.maximum(CREEPS[0] * sd, CREEPS[1] * np.linalg.norm(part.mean(axis=0)))
            if (moved > limit).any():
                angle = float(np.linalg.norm(moved) / np.linalg.norm(part.mean(axis=0)))
                self._mistake("pulled", a, angle=np.degrees(angle))
        if self.step is not None and self.done is None:
            up = part.mean(axis=0)
            off = float(np.arccos(np.clip(up @ self.step.up / np.linalg.norm(up), -1, 1)))
            if off > OTHER:
                self._mistake("other", a, up=up / np.linalg.norm(up), asked=self.step.up)
        if log.gyro is not None and len(first) > 1 and self.done is None:
            self._too_fast(log, int(last[-2]) - 1, a)

    def _too_fast(self, log: Log, first: int, last: int) -> None:
        """Integrate a turn with half of its samples: where it then differs, they are too few."""
        last -= (last - first) % 2
        if last - first < 8 or first < 2 or last + 3 > len(log) or log.sampled == "increment":
            return
        assert log.gyro is not None
        angle, rows = [], slice(first - 2, last + 3)
        time, gyro = log.time[rows] - log.time[rows][0], log.gyro[rows]
        for stride in (1, 2):
            w = np.ascontiguousarray(gyro[::stride])
            ends = np.array([2 // stride]), np.array([(2 + last - first) // stride])
            t, none = np.ascontiguousarray(time[::stride]), np.zeros((3, 3))
            C, *_ = integrate_turns(t, w, np.zeros_like(w), none, *ends, False)
            angle.append(C[0])
        apart = float(np.linalg.norm(log_of(angle[0].T @ angle[1])))
        sd = (
            self.found.quiet.get("gyro", 0.0)
            * float(np.sqrt(3 * (last - first)))
            * self.found.interval
        )
        if apart > COARSE * sd and apart > 4 * TOO_COARSE:
            rate = float(np.degrees(np.linalg.norm(gyro, axis=1).max()))
            self._mistake("fast", first, rate=rate, hz=1.0 / self.found.interval)

    @property
    def done(self) -> tuple[int, int] | None:
        """How much of a list is done, and how much it has; None where there is no list [1]."""
        return self.way.done

    def findings(self) -> tuple[Finding, ...]:
        """Return what looks wrong in the readings so far."""
        return self._watch.findings()

    # -- what is shown -----------------------------------------------------------------------

    @property
    def phase(self) -> Phase:
        """What is going on."""
        if self.stopped:
            return "done"
        if not self.found.samples:
            return "learn"
        since = self.found.still_since
        if since is None:
            return "move"
        return "next" if since < self._handled else "rest"

    @property
    def ring(self) -> float:
        """How much of the rest that is asked has passed, 0 to 1, shape () [1]."""
        if self.phase == "next":
            return 1.0
        if self.phase != "rest" or self.step is None:
            return 0.0
        return min(1.0, self.found.run / self.step.seconds)

    def attitude(self) -> FloatArray:
        """Return how the instrument is held now, C_nb, shape (3, 3) [1]."""
        log, n = self.found.log, len(self.found)
        assert log.accel is not None
        if self._attitude is None or log.gyro is None:
            up = log.accel[max(0, n - 5) :].mean(axis=0)
            return np.asarray(aligning(up / np.linalg.norm(up), np.array([0.0, 0.0, 1.0])))
        at, C = self._attitude
        gyro = log.gyro[at:n]
        if self.reached is not None and hasattr(self.reached.state, "model"):
            _, corrected = self.reached.state.model.compensate(None, gyro)
            gyro = gyro if corrected is None else corrected
        size = max(1, round(0.02 / self.found.interval))  # a picture needs no more
        for k in range(0, len(gyro), size):
            some = gyro[k : k + size]
            C = C @ exp(some.mean(axis=0) * len(some) * self.found.interval)
        self._attitude = (n, C)
        return np.asarray(C)

    @property
    def heading(self) -> float:
        """Which way the front of the first rest points, shape () [rad].

        Clockwise from the second level axis of n: whoever is guided looks that way.
        """
        if self.reached is None or not len(self.reached.C_nb):
            return 0.0
        front = self.reached.C_nb[0][:, 1]
        return float(np.arctan2(front[0], front[1]))

    def bars(self) -> list[tuple[str, str, float, float, float]]:
        """Return of each group its worst coefficient: group, name, reached, expected, wanted [SI].

        Expected is what the next step will leave; NaN where nothing is known yet.
        """
        wanted, out = self.way.wanted, []
        for group, mine in wanted.groups().items():
            limit = wanted.sd[mine]
            if self.reached is None:
                out.append((group, wanted.names[mine[0]], np.nan, np.nan, float(limit[0])))
                continue
            scale = np.where(np.isfinite(limit), limit, wanted.typical[mine])
            k = mine[int(np.argmax(self.reached.sd[mine] / scale))]
            after = self.reached.sd if self.expected is None else self.expected
            out.append((group, wanted.names[k], float(self.reached.sd[k]), float(after[k]),
                        float(wanted.sd[k])))  # fmt: skip
        return out


TOO_COARSE = np.radians(0.01)
"""Less than this is lost by no turn that is too fast [rad]."""


def log_of(C: FloatArray) -> FloatArray:
    """Return the rotation vector of a rotation `C` (3, 3), shape (3,) [rad]."""
    return np.asarray(log(C[None])[0])
