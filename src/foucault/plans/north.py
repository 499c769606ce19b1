"""Which stops of a north seeker show its heading best: how well they do, and a search.

How well they do is told quickly, by the solution, linearised and level. Readings are linear in the
rates along x_b and y_b, the offset and a linear drift of the gyro; with the covariance S of white
and slow noise over the stops, and all but the two rates eliminated,

    F = X_r' S^-1 X_r - X_r' S^-1 X_o (X_o' S^-1 X_o + prior)^-1 X_o' S^-1 X_r

is what they say of the rates; accelerometers likewise of the tilt, which turns the vertical rate
into a horizontal one. With latitude known the rates move with the heading alone, along
``w_ie cos L (cos psi, sin psi)``, and ``var = 1 / (e' F e)`` over the square of that rate. An
error by drift that the solution does not estimate is added, squared. `diagnose.north_stops.predict`
solves readings instead, tilted ones too; this is for a search that judges many plans.

A plan is a sequence of stops, index angle and length, that together with the moves between them
takes the time of a set-up. Angles are the detents, or multiples of 1 deg; lengths of 0.1 s: what
is found is what is written. The cost is the logarithm of the heading's root mean square error,
by `root_mean_square`, over that of the order to beat; comparisons are by
`diagnose.north_stops.predict`, which solves readings.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import ceil, cos, degrees, floor, inf, isfinite, log, pi, radians, sin, sqrt
from typing import Any, Literal

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import Finding, error
from foucault.estimate.north_reduction import NEARLY_FREE, spans
from foucault.models.earth import EARTH_RATE, gravity
from foucault.models.noise import TriadNoise, window_covariance
from foucault.models.north_seeker import Dwells
from foucault.plans.limit import Limit
from foucault.plans.north_orders import dwells_at
from foucault.plans.north_stops import HEADINGS, Conditions, poses, predict
from foucault.plans.optimise import Space
from foucault.units import span

COLLINEAR = 1e-9
"""A smaller eigenvalue below this times the larger one is rounding: a direction not seen [1]."""

EYE = np.eye(2)


@dataclass(frozen=True)
class Known:
    """What the solution is told, and what the stops are seen by."""

    conditions: Conditions  # instrument and place; drift is below, tilt does not count here [SI]
    drift: float = 0.0  # linear drift of the gyro that is expected [rad/s^2]
    # whether the solution estimates it, as in [procedure]
    solved: Literal["auto", "none", "linear"] = "auto"
    drift_sd: float | None = None  # standard deviation that it gives it [rad/s^2]
    # whether two accelerometers stay with the case, or one turns with the gyro
    on_case: bool = False
    # of a rough heading, from which the angles count; None where they count from forward [rad]
    rough_sd: float | None = None

    @cached_property
    def towards(self) -> FloatArray:
        """How the rates change with the heading, for the headings averaged over, (m, 2) [1]."""
        at = HEADINGS if self.rough_sd is None else np.array([1.0, -1.0]) * self.rough_sd
        return np.stack([np.cos(at), np.sin(at)], 1)

    @cached_property
    def white_tilt(self) -> TriadNoise:
        """Noise of the accelerometers, never none: then they would show a tilt by one stop."""
        noise = self.conditions.noise.accel
        return replace(noise, white=max(noise.white, 1e-9))


@dataclass(frozen=True)
class Seen:
    """What stops show."""

    # of the heading's error over the headings, infinite where one is not seen [rad^2]
    mean_square: float
    # what the solution gives the drift beforehand: 0 none, infinite where it is free [rad/s^2]
    drift_sd: float


def seen(angle: FloatArray, start: FloatArray, time: FloatArray, known: Known) -> Seen:
    """Return what stops show of the heading.

    `angle` (k,): index angles, from north, where a rough heading is known [rad]; `start`, `time`
    (k,): when each stop begins and how long it is measured [s].
    """
    e = np.stack([np.sin(angle), np.cos(angle)], 1)
    t = start + time / 2
    t = t - (t @ time) / time.sum()
    noise = known.conditions.noise.gyro
    white = _white(noise, time)
    X = np.column_stack([e, np.ones_like(t), t])
    SX = X / white[:, None]
    if noise.bias_instability or noise.random_walk:
        SX = np.linalg.solve(np.diag(white) + window_covariance(start, start + time, noise), X)
    N = X.T @ SX
    tilt = _tilt(e, time, known)
    best, owed = _told(N, len(angle), known)
    if best is None or tilt is None:
        return Seen(inf, owed)
    c = known.conditions
    up = EARTH_RATE * sin(c.latitude)
    F = best @ _inverse(EYE + up**2 * tilt @ best)
    if not c.latitude_known:
        if not _spans(F):
            return Seen(inf, owed)
        C = _inverse(F)
        gain = known.towards
        variance = np.einsum("mi,ij,mj->m", gain, C, gain)
    else:
        gain = known.towards @ F
        told = np.sum(gain * known.towards, axis=1)
        if not (told > COLLINEAR * np.trace(F)).all():
            return Seen(inf, owed)
        gain, variance = gain / told[:, None], 1.0 / told
    if known.rough_sd is None and not _spans(best):
        return Seen(inf, owed)
    if known.drift and owed == 0:  # what it does to the rates, and they to the heading
        share = N[:2, 2] / (N[2, 2] + known.conditions.offset_sd**-2.0)
        moved = np.linalg.pinv(best, hermitian=True) @ (N[:2, 3] - share * N[2, 3])
        variance = variance + (known.drift * (gain @ moved)) ** 2
    rate = EARTH_RATE * cos(c.latitude)
    return Seen(float(variance.mean()) / rate**2, owed)


def _white(noise: TriadNoise, time: FloatArray) -> FloatArray:
    """Return the variance of means by white noise, as `models.readings` has it of means."""
    return np.maximum(noise.white**2 / time, 1e-24)


def _left(N: FloatArray, prior: tuple[float, ...]) -> FloatArray:
    """Return the information on the two rates, the others eliminated, with priors on those."""
    for k in range(1 + len(prior), 1, -1):
        column = N[:k, k]
        N = N[:k, :k] - np.outer(column, column) / (N[k, k] + prior[k - 2])
    return np.asarray(N)


def _inverse(F: FloatArray) -> FloatArray:
    """Invert a matrix of 2 x 2."""
    (a, b), (c, d) = F.tolist()
    det = a * d - b * c
    return np.array([[d / det, -b / det], [-c / det, a / det]])


def _told(N: FloatArray, count: int, known: Known) -> tuple[FloatArray | None, float]:
    """Return the information on the rates, and what the drift is given: as `drift_sd` does."""
    offset = known.conditions.offset_sd**-2.0
    plain = _left(N, (offset,))
    if known.solved == "none":
        return plain, 0.0
    if known.drift_sd is not None:
        if known.drift_sd == 0:
            return plain, 0.0
        return _left(N, (offset, known.drift_sd**-2.0)), known.drift_sd
    if count < 2 or not N[3, 3] > 0:
        return plain, 0.0
    free = _left(N, (offset, 0.0))
    if known.solved == "linear":
        return free, inf
    collinear = not _spans(plain)
    if count < (4 if collinear else 5):  # no reading to spare
        return plain, 0.0
    if collinear:  # what is not seen at all grows by nothing
        return free, inf
    # The larger variance is one over the smaller information.
    ratio = _least(plain) / _least(free)
    return (free, inf) if ratio < NEARLY_FREE**2 else (plain, 0.0)


def _spans(F: FloatArray) -> bool:
    """Tell whether both eigenvalues of a matrix of 2 x 2 are above zero, rounding apart."""
    (a, b), (_, d) = F.tolist()
    return bool(a + d > 0 and a * d - b * b > COLLINEAR * (a + d) ** 2)


def _least(F: FloatArray) -> float:
    """Return the smaller eigenvalue of a matrix of 2 x 2."""
    (a, b), (_, d) = F.tolist()
    return float((a + d) / 2 - sqrt(((a - d) / 2) ** 2 + b * b))


def _tilt(e: FloatArray, time: FloatArray, known: Known) -> FloatArray | None:
    """Return the covariance of the tilt, (2, 2) [rad^2]; None where it is not seen."""
    c = known.conditions
    level = 0.0 if c.level_sd is None else c.level_sd**-2.0
    F = level * EYE
    g = gravity(c.latitude)
    if known.on_case:
        F = F + g**2 * float(np.sum(1.0 / _white(known.white_tilt, time))) * EYE
    elif c.level_sd is None:
        X = np.column_stack([e, np.ones(len(e))])
        F = F + g**2 * _left(X.T @ (X / _white(known.white_tilt, time)[:, None]), (0.0,))
    return _inverse(F) if _spans(F) else None


def root_mean_square(angle: FloatArray, start: FloatArray, time: FloatArray, known: Known) -> float:
    """Return the root mean square error of the heading [rad].

    `angle` (k,): index angles, from north, where a rough heading is known [rad]; `start`, `time`
    (k,): when each stop begins and how long it is measured [s].
    """
    return sqrt(seen(angle, start, time, known).mean_square)


Move = tuple[list[int], list[int]]

UNIT = radians(1e-3)  # Unit of the angles of a plan [rad].
TURN, HALF, DEGREE = 360_000, 180_000, 1000  # Units in a turn, in half of one, and in a degree [1].
FINEST = radians(1.0)  # Angles without detents are multiples of this [rad].
TICK = 0.1  # Lengths of stops are multiples of this [s].
TRIES = 20  # So many draws or moves are tried before a plan is returned as it was [1].


@dataclass(frozen=True)
class Schedule:
    """Stops in order."""

    index: tuple[int, ...]  # index angles, in units of 0.001 deg [1]
    dwell: tuple[int, ...]  # how long each lasts, in units of 0.1 s [1]

    def __len__(self) -> int:
        return len(self.index)


@dataclass(frozen=True, kw_only=True)
class Rig:
    """What the base can do, and the time there is: it draws orders of stops and changes them."""

    total: float  # time of a set-up, moves included [s]
    move: float  # from one stop to the next [s]
    shortest: float  # shortest stop [s]
    settle: float = 0.0  # left out of each stop [s]
    most: int = 24  # most stops [1]
    index_limit: float = inf  # how far the base turns either way from 0 [rad]
    index_step: float | None = None  # detents; None for any angle [rad]
    opposite: bool = True  # whether every stop has its opposite

    @property
    def step(self) -> float:
        """Between the angles that there are [rad]."""
        return FINEST if self.index_step is None else self.index_step

    @cached_property
    def angles(self) -> tuple[int, ...]:
        """All angles that differ, each by its smallest turn; with opposites, those that have."""
        widest = floor(min(self.index_limit, pi) / self.step + 1e-9)
        some = (round(n * self.step / UNIT) for n in range(-widest, widest + 1))
        there = {reduced(a) if abs(a) >= HALF else a for a in some}
        if self.opposite:
            there = {a for a in there if reduced(a + HALF) in there}
        return tuple(sorted(there))

    def fits(self, count: int) -> int | None:
        """Return the time that `count` [1] stops share [0.1 s]; None where it is too short."""
        left = floor((self.total - (count - 1) * self.move) / TICK + 1e-6)
        return left if left >= count * self._least else None

    @cached_property
    def _least(self) -> int:
        return ceil((self.shortest + self.settle) / TICK - 1e-6)

    def draw(self, rng: np.random.Generator) -> Schedule | None:
        """Return random stops; None where none fit the time."""
        most = max(n for n in range(2, self.most + 1) if self.fits(n) is not None)
        for _ in range(TRIES):
            found = self._drawn(rng, most)
            if found is not None:
                return found
        return None

    def _drawn(self, rng: np.random.Generator, most: int) -> Schedule | None:
        angles = [self._any(rng) for _ in range(int(rng.integers(1, 4)))]
        if self.opposite:
            angles += [across(a) for a in angles]
        count = int(rng.integers(2, most + 1))
        index = [*angles, *rng.choice(angles, max(count - len(angles), 0)).tolist()]
        rng.shuffle(index)
        return self._settled(index[:most], [1] * len(index[:most]))

    def _any(self, rng: np.random.Generator) -> int:
        return self.angles[int(rng.integers(len(self.angles)))]

    def _settled(self, index: list[int], dwell: list[int]) -> Schedule | None:
        """Join neighbours at one angle and let the stops fill the time; None where they cannot."""
        angles, lengths = [index[0]], [dwell[0]]
        for a, t in zip(index[1:], dwell[1:], strict=True):
            if a == angles[-1]:
                lengths[-1] += t
            else:
                angles.append(a)
                lengths.append(t)
        whole = self.fits(len(angles))
        if whole is None or not 2 <= len(angles) <= self.most:
            return None
        spare = whole - len(angles) * self._least
        above = [max(t - self._least, 0) for t in lengths]
        if sum(above) != spare:
            size = sum(above)
            above = [a * spare // size for a in above] if size else [0] * len(above)
            even, more = divmod(spare - sum(above), len(above))
            above = [a + even + (i < more) for i, a in enumerate(above)]
        return Schedule(tuple(angles), tuple(a + self._least for a in above))

    def moved(self, plan: Schedule, rng: np.random.Generator, heat: float) -> Schedule:
        """Return a neighbour of `plan`.

        `heat`: 1 at the beginning, 0 at the end: how large moves are [1].
        """
        moves = (self._time, self._time, self._swap, self._reverse, self._turned, self._insert,
                 self._remove, self._mirror, self._even, self._square)  # fmt: skip
        for _ in range(TRIES):
            one = moves[int(rng.integers(len(moves)))]
            index = [a if a in self.there else reduced(a) for a in plan.index]
            found = self._settled(*one(index, list(plan.dwell), rng, heat))
            if found not in (None, plan) and self.there.issuperset(found.index):
                return found
        return plan

    def _time(self, a: list[int], t: list[int], rng: np.random.Generator, heat: float) -> Move:
        """Give time of one stop to another."""
        i, j = (int(x) for x in rng.integers(len(t), size=2))
        size = min(t[i] - self._least, 1 + round(heat * t[i] * rng.random()))
        t[i], t[j] = t[i] - size, t[j] + size
        return a, t

    def _swap(self, a: list[int], t: list[int], rng: np.random.Generator, _: float) -> Move:
        """Exchange two stops."""
        i, j = (int(x) for x in rng.integers(len(t), size=2))
        a[i], a[j] = a[j], a[i]
        return a, t

    def _reverse(self, a: list[int], t: list[int], rng: np.random.Generator, _: float) -> Move:
        """Go through some of the stops backwards."""
        i, j = sorted(int(x) for x in rng.integers(len(t) + 1, size=2))
        a[i:j], t[i:j] = a[i:j][::-1], t[i:j][::-1]
        return a, t

    def _turned(self, a: list[int], t: list[int], rng: np.random.Generator, heat: float) -> Move:
        """Turn the stops at one angle, and those opposite."""
        old = a[int(rng.integers(len(a)))]
        widest = max(1, round(heat * radians(90.0) / self.step))
        steps = int(rng.integers(-widest, widest + 1))
        new = reduced(round((old * UNIT / self.step + steps) * self.step / UNIT))
        if new not in self.there:
            return a, t
        change = {old: new}
        if self.opposite:
            change[across(old)] = across(new)
        return [change.get(x, x) for x in a], t

    @cached_property
    def there(self) -> frozenset[int]:
        return frozenset(self.angles)

    def _insert(self, a: list[int], t: list[int], rng: np.random.Generator, _: float) -> Move:
        """Stop once more, mostly at an angle that there is; a new one brings its opposite."""
        new = [a[int(rng.integers(len(a)))] if rng.random() < 0.8 else self._any(rng)]
        if self.opposite and across(new[0]) not in a:
            new.append(across(new[0]))
        for one in new:
            i = int(rng.integers(len(a) + 1))
            a.insert(i, one)
            t.insert(i, max(sum(t) // (len(t) + 1), self._least))
        return a, t

    def _remove(self, a: list[int], t: list[int], rng: np.random.Generator, _: float) -> Move:
        """Leave a stop out; with the last at its angle go those opposite."""
        i = int(rng.integers(len(a)))
        gone = a.pop(i)
        t.pop(i)
        if self.opposite and gone not in a:
            keep = [k for k, x in enumerate(a) if x != across(gone)]
            a, t = [a[k] for k in keep], [t[k] for k in keep]
        return (a, t) if a else ([gone], [self._least])

    def _mirror(self, a: list[int], t: list[int], _: np.random.Generator, __: float) -> Move:
        """Go through all stops and back."""
        return a + a[::-1], [x // 2 for x in t + t[::-1]]

    def _even(self, a: list[int], t: list[int], rng: np.random.Generator, _: float) -> Move:
        """Let all stops last as long, or all but the first and the last."""
        if len(a) < 3 or rng.random() < 0.5:
            return a, [10 * self._least] * len(a)
        ends = 10 * self._least
        return a, [ends, *[2 * ends] * (len(a) - 2), ends]

    def _square(self, a: list[int], t: list[int], _: np.random.Generator, __: float) -> Move:
        """Turn all stops to the nearest of forward, right, back and left."""
        return [reduced(HALF // 2 * round(x / (HALF // 2))) for x in a], t

    @property
    def words(self) -> str:
        """All of it in words."""
        limit, r = self.index_limit, self
        words = [] if limit == inf else [f"index angles up to {degrees(limit):g} deg"]
        words += [] if r.index_step is None else [f"detents every {degrees(r.index_step):g} deg"]
        words += ["opposite stops"] if r.opposite else []
        return ", ".join([*words, f"at most {r.most} stops in {span(r.total)}"])

    def times(self, plan: Schedule) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return angle, beginning and length of what is measured of each stop, shape (k,) each."""
        length = TICK * np.array(plan.dwell, float)
        start = np.cumsum(length + self.move) - length - self.move
        angle = UNIT * np.array(plan.index, float)
        return angle, start + self.settle, length - self.settle


def reduced(angle: int) -> int:
    """Return the direction of `angle` [0.001 deg] by the smallest turn."""
    return HALF - (HALF - angle) % TURN


def across(angle: int) -> int:
    """Return the direction opposite to `angle` [0.001 deg]."""
    return reduced(angle + HALF)


def schedule(index: FloatArray, dwell: FloatArray, rig: Rig) -> Schedule:
    """Return stops as a plan of the whole time there is.

    `index` (k,): index angles [rad]; `dwell` (k,): how long each lasts, scaled to the time [s].
    """
    whole = rig.total - (len(index) - 1) * rig.move
    ends = np.rint(np.cumsum(dwell) / dwell.sum() * floor(whole / TICK + 1e-6)).astype(int)
    turns = np.rint(np.asarray(index) / UNIT).astype(int)
    return Schedule(tuple(turns.tolist()), tuple(np.diff(ends, prepend=0).tolist()))


TILTED = radians(10.0)  # Up to which the case is tilted in one of the comparisons [rad].
ELSEWHERE = radians(60.0)  # Latitude of another, north or south as the site is [rad].
DRAWN = 100  # Random plans by which it is told whether any shows the heading [1].

PLAIN = 2e-4
"""What a stop, or another index angle, costs: of plans that are alike the simpler is wanted [1]."""


@dataclass(frozen=True, kw_only=True)
class NorthSpace(Space):
    """Orders of stops that a base allows, for the heading."""

    allowed: Rig
    known: Known  # instrument, place, and what the solution is told [SI]
    Plan = Schedule

    @classmethod
    def of(
        cls, rig: Rig, known: Known, reference: Schedule, name: str,
        findings: tuple[Finding, ...] = (),
    ) -> NorthSpace:  # fmt: skip
        """Return the orders to compare with one, `reference`, that the base may not be able to do.

        Beside the site's level set-up they are compared tilted and elsewhere.
        """
        if rig.fits(2) is None:
            least = 2 * (rig.shortest + rig.settle) + rig.move
            raise error("north_search.too_short", given=span(rig.total), least=span(least),
                        stop=span(rig.shortest + rig.settle))  # fmt: skip
        away = -ELSEWHERE if known.conditions.latitude < 0 else ELSEWHERE
        at: dict[str, dict[str, Any]] = {
            "level": {},
            f"tilted by up to {degrees(TILTED):.0f} deg": {"tilt": TILTED},
            f"at latitude {degrees(away):.0f} deg": {"latitude": away},
        }
        return cls(
            allowed=rig, known=known, names=("heading",), kinds=("angle",), weights=np.ones(1),
            reference=reference, reference_name=name, cases=tuple(at),
            stated=partial(_stated, rig, known, at), findings=findings,
        )  # fmt: skip

    def draw(self, rng: np.random.Generator) -> Schedule:
        """Return a random plan that the rig allows."""
        return self.allowed.draw(rng) or self.reference

    def shows(self) -> bool:
        """Tell whether any of many random plans shows the heading."""
        rng = np.random.default_rng(0)
        return len(self.allowed.angles) > 1 and any(
            isfinite(self.cost(self.draw(rng))) for _ in range(DRAWN)
        )

    # -- how good they are ---------------------------------------------------------------------

    def cost(self, plan: Schedule) -> float:
        """Return the logarithm of the sd over that of the order to beat, level; and `PLAIN`."""
        if not self._can(plan):
            return inf
        value = self._price(plan)
        return value - self._to_beat if isfinite(value) else inf

    @cached_property
    def _to_beat(self) -> float:
        value = self._price(self.reference)
        return value if isfinite(value) else 0.0

    def _price(self, plan: Schedule) -> float:
        value = self.bound(plan)
        return log(value) + PLAIN * (len(plan) + len(set(plan.index))) if isfinite(value) else inf

    def bound(self, plan: Schedule) -> float:
        """Return the error by the quick bound; infinite where nothing is left of a stop [rad]."""
        return _error(self.allowed, self.known, plan)

    def _can(self, plan: Schedule) -> bool:
        there = {reduced(a) for a in plan.index}
        if not there <= self.allowed.there:
            return False
        if max(abs(a) for a in plan.index) * UNIT > self.allowed.index_limit * (1 + 1e-9):
            return False
        if self._spread and not spans(sorted({round(a / DEGREE) % 360 for a in there})):
            return False
        return not self.allowed.opposite or all(across(a) in there for a in there)

    @property
    def _spread(self) -> bool:
        """Whether stops along one line are refused, as a fix refuses them."""
        by_level = self.known.on_case or self.known.conditions.level_sd is not None
        return self.known.rough_sd is None or not by_level

    # -- plans as text -------------------------------------------------------------------------

    def changes(self, plan: Schedule) -> dict[str, dict[str, Any]]:
        """Return what makes a campaign do this plan: keys of its tables, as in the file.

        One that counts from north is for a fix: one set-up that faces north.
        """
        order = [{"index": f"{a} deg", "dwell": f"{t} s"} for a, t in self._texts(plan)]
        if self.known.rough_sd is None:
            return {"simulate": {"order": order}}
        near = {"near": "0 deg", "near_sd": f"{degrees(self.known.rough_sd):.12g} deg"}
        return {"procedure": near, "simulate": {"order": order, "headings": 1}}

    def _texts(self, plan: Schedule) -> list[tuple[str, str]]:
        angle = [f"{a / DEGREE:.10g}" for a in plan.index]
        return list(zip(angle, [f"{TICK * t:.10g}" for t in plan.dwell], strict=True))

    def steps(self, plan: Schedule) -> tuple[tuple[str, ...], ...]:
        """Return the plan as a table for people: the headings, then one row per stop."""
        counted = "index from north (deg)" if self.known.rough_sd is not None else "index (deg)"
        start = self.allowed.times(plan)[1] - self.allowed.settle
        rows = [
            (f"{round(s, 1):.10g}", a, t)
            for (a, t), s in zip(self._texts(plan), start, strict=True)
        ]
        return (("start (s)", counted, "dwell (s)"), *rows)

    def needs(self, plan: Schedule) -> tuple[Limit, ...]:
        """Return what a plan needs of the base."""
        widest = UNIT * max(abs(a) for a in plan.index)
        allowed = None if self.allowed.index_limit == inf else self.allowed.index_limit
        return (Limit("index angle", "angle", widest, allowed),)

    def duration(self, plan: Schedule) -> float:
        """Return the time of a set-up, moves included [s]."""
        return TICK * sum(plan.dwell) + (len(plan) - 1) * self.allowed.move


def _stated(
    rig: Rig, known: Known, cases: Mapping[str, Mapping[str, Any]], plan: Schedule, case: str
) -> FloatArray:
    """Return the root mean square error of the heading in one of `cases`, shape (1,) [rad]."""
    if not isfinite(_error(rig, known, plan)):
        return np.array([inf])
    owed = seen(*rig.times(plan), known).drift_sd
    ignored = owed == 0 and known.drift > 0
    c = replace(known.conditions, **cases[case], drift=known.drift if ignored else owed,
                drift_estimated=not ignored)  # fmt: skip
    at = poses(c.tilt)
    found = predict(_dwells(rig, known, plan, at), at, c, near=known.rough_sd is not None,
                    drift=False, on_case=known.on_case)  # fmt: skip
    return np.array([found.sd])


def _error(rig: Rig, known: Known, plan: Schedule) -> float:
    if min(plan.dwell) * TICK <= rig.settle:  # the order to beat may not fit the time
        return inf
    return root_mean_square(*rig.times(plan), known)


def _dwells(rig: Rig, known: Known, plan: Schedule, at: FloatArray) -> Dwells:
    """Return the stops of set-ups at many headings, with readings still zero."""
    angle, start, time = rig.times(plan)
    index = np.tile(angle, (len(at), 1))
    if known.rough_sd is not None:  # wrong either way, heading by heading
        wrong = np.where(np.unique(at[:, 0], return_inverse=True)[1] % 2, -1.0, 1.0)
        index -= (at[:, 0] + wrong * known.rough_sd)[:, None]
    return dwells_at(start, time, index)
