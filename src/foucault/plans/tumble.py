"""How a torqued cluster is turned within what its rig allows, and better ways to turn it.

A plan says how the cluster p turns relative to n, resolved in p. The command of a gyro-stabilised
cluster is a rate relative to inertial space, so that the Earth's rate is added, open loop, at the
attitude that the plan has in the middle of each interval of the command::

    w_cmd = w_np_p + C_pn(middle) w_in_n,    C_pn(t + h) = Exp(-w_np_p h) C_pn(t)

Within an interval the command stands still, and so does the rate of the plan: where a step begins
or a ramp passes, it is the mean over the interval.

Better motions are sequences of turns about its axes, judged by their bound. What is searched is a
tuple of (turn, slots): which of the allowed rates, and for how many slots of time. The
bound is that of `kernels.cluster_information` at the latitude of the site and at errors of usual
size; how good the best plan is at other latitudes and with other errors is looked at in the end.

References
----------
.. [1] Ding, Cai, Yang, Lian, "Continuous self-calibration and self-alignment method for floated
   inertial platform", J. NUDT 37(3), 2015, section 3 (the plan of four steps).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from math import ceil, inf, log
from typing import Any

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.errors import error, suggestion
from foucault.kernels.cluster_information import COLUMNS, information_pass
from foucault.kernels.cluster_plan import KNOWN, attitudes, commanded, remaining
from foucault.models.cluster import angles_of, attitude_of
from foucault.models.earth import earth_rate_n
from foucault.models.rotation import cross_matrix
from foucault.plans.limit import Limit
from foucault.plans.optimise import QuickSpace, require_seen
from foucault.tables import AXES, whole_samples

Motion = tuple[tuple[float, float, tuple[float, float, float]], ...]

TOLERANCE = 1e-6  # Times nearer than this are the same time [s].


@dataclass(frozen=True)
class Step:
    """One rate, held for a time."""

    rate: FloatArray  # (3,) rate of the cluster relative to n, frame p [rad/s]
    time: float  # how long it is held [s]
    label: str = ""  # for figures and messages


@dataclass(frozen=True)
class TorquingPlan:
    """What the cluster is to do."""

    name: str  # as people call it
    start: FloatArray  # (3,) outer, middle and inner angle at the beginning [rad]
    steps: tuple[Step, ...]
    # time in which each rate is reached from the one before, and rest at the end; the angles of the
    # steps stay what they are, so that the plan takes that much longer [s]
    ramp: float = 0.0

    def __post_init__(self) -> None:
        if not self.steps:
            raise error("torquing.empty", name=self.name)
        for k, step in enumerate(self.steps, 1):
            if np.shape(step.rate) != (3,) or not np.isfinite(step.rate).all():
                given = ", ".join(f"{x:g}" for x in np.ravel(step.rate))
                raise error("torquing.rate", step=k, name=self.name, given=f"{given} rad/s")
            if not 0 < step.time < np.inf:
                raise error("torquing.time", what=f"Step {k}", name=self.name, given=step.time)
        if not 0 <= self.ramp < np.inf:
            raise error("torquing.time", what="The ramp", name=self.name, given=self.ramp)

    @property
    def rates(self) -> FloatArray:
        """Rate of each step, frame p, shape (k, 3) [rad/s]."""
        return np.array([step.rate for step in self.steps])

    @property
    def ends(self) -> FloatArray:
        """When each step begins, and the last one ends, without ramp, shape (k + 1,) [s]."""
        return np.concatenate([[0.0], np.cumsum([step.time for step in self.steps])])

    @property
    def duration(self) -> float:
        """Time of the whole [s]."""
        return float(self.ends[-1]) + self.ramp

    @property
    def motion(self) -> Motion:
        """Beginning, end [s] and rates about x, y, z [rad/s] of each step, without ramp."""
        rates = [(float(x), float(y), float(z)) for x, y, z in self.rates]
        ends = self.ends.tolist()
        return tuple(zip(ends, ends[1:], rates, strict=False))

    def within(self, limit: float) -> TorquingPlan:
        """Return the plan itself; refuse it where a rate is beyond `limit` [rad/s]."""
        for k, step in enumerate(self.steps, 1):
            worst = int(np.argmax(np.abs(step.rate)))
            if abs(step.rate[worst]) > limit * (1 + 1e-9):
                raise error(
                    "torquing.limit", step=k, name=self.name, axis=AXES[worst],
                    given=f"{np.degrees(abs(step.rate[worst])):.6g}",
                    limit=f"{np.degrees(limit):.6g}",
                )  # fmt: skip
        return self

    def mean_rates(self, time: FloatArray) -> FloatArray:
        """Return the mean rate between neighbours of `time`, frame p, shape (m, 3) [rad/s].

        `time` (m + 1,): times from the beginning of the plan [s].
        """
        mean = np.diff(self._turned(time), axis=0) / np.diff(time)[:, None]
        # Between two changes the rate itself, to the last bit.
        ends = self.ends
        at = np.clip(np.searchsorted(ends, time[:-1] + TOLERANCE) - 1, 0, len(self.steps) - 1)
        steady = time[:-1] >= ends[at] + self.ramp - TOLERANCE
        steady &= time[1:] <= ends[at + 1] + TOLERANCE
        return np.where(steady[:, None], self.rates[at], mean)

    def _turned(self, time: FloatArray) -> FloatArray:
        """Integral of the rate up to `time`, shape (n, 3): with a ramp, a moving mean of it."""
        ends, rates = self.ends, self.rates
        turned = np.concatenate([np.zeros((1, 3)), np.cumsum(rates * np.diff(ends)[:, None], 0)])
        if self.ramp == 0:
            return np.column_stack([np.interp(time, ends, column) for column in turned.T])
        half = np.diff(ends)[:, None] * (turned[1:] + turned[:-1]) / 2
        area = np.concatenate([np.zeros((1, 3)), np.cumsum(half, axis=0)])
        held = np.concatenate([rates, np.zeros((1, 3))])

        def integral(t: FloatArray) -> FloatArray:
            t = np.maximum(t, 0.0)
            k = np.searchsorted(ends, t, side="right") - 1
            dt = (t - ends[k])[:, None]
            return np.asarray(area[k] + turned[k] * dt + held[k] * dt**2 / 2)

        return (integral(time) - integral(time - self.ramp)) / self.ramp


@dataclass(frozen=True)
class Nominal:
    """What a plan commands, and where it takes a cluster without errors."""

    time: FloatArray  # (m + 1,) when each command begins, and the last one ends [s]
    rate: FloatArray  # (m, 3) rate relative to n, frame p [rad/s]
    # (m, 3) open-loop command, a rate relative to inertial space, frame p [rad/s]
    command: FloatArray
    C_pn: FloatArray  # (m + 1, 3, 3) attitude at each time: maps East-North-Up to the cluster [1]


def nominal(plan: TorquingPlan, latitude: float, interval: float = 1.0) -> Nominal:
    """Return the command of a plan and the attitude it is meant to give.

    `latitude`: geodetic latitude [rad]; `interval`: how long each command is held, the last one
    may outlast the plan [s].
    """
    m = whole_samples(np.ceil((plan.duration - TOLERANCE) / interval))
    time = interval * np.arange(m + 1, dtype=float)
    rate = plan.mean_rates(time)
    C_pn, middle = np.empty((m + 1, 3, 3)), np.empty((m, 3, 3))
    C_pn[0] = attitude_of(np.asarray(plan.start, float))
    # One rotation from the first of each run of equal rates.
    first = np.flatnonzero(np.append(True, (rate[1:] != rate[:-1]).any(axis=1)))
    for a, b in zip(first, [*first[1:], m], strict=True):
        since = time[a + 1 : b + 1] - time[a]
        C_pn[a + 1 : b + 1] = _turned(C_pn[a], rate[a], since)
        middle[a:b] = _turned(C_pn[a], rate[a], since - interval / 2)
    return Nominal(time, rate, rate + middle @ earth_rate_n(latitude), C_pn)


def _turned(C_pn: FloatArray, rate: FloatArray, time: FloatArray) -> FloatArray:
    """Return ``Exp(-rate t) C_pn`` at all times t; the axis is one and the same."""
    speed = float(np.linalg.norm(rate))
    K = cross_matrix(rate / speed) if speed else np.zeros((3, 3))
    sine, versine = np.sin(speed * time), 2 * np.sin(speed * time / 2) ** 2
    turned = np.eye(3) - sine[:, None, None] * K + versine[:, None, None] * (K @ K)
    return np.asarray((turned.reshape(-1, 3) @ C_pn).reshape(-1, 3, 3))


# -- plans -----------------------------------------------------------------------------------

RATE = float(np.radians(0.1))  # Rate of the published plan [rad/s].
DURATION = 5400.0  # Its time [s].


def _turning(word: str, angle: float, rate: float) -> Step:
    """Turn through `angle` about the signed axis `word`."""
    sign = -1.0 if word[0] == "-" else 1.0
    axis = np.eye(3)[AXES.index(word[-1])]
    return Step(sign * rate * axis + 0.0, angle / rate, f"{word} {np.degrees(angle):.4g} deg")


def published(rate: float = RATE) -> TorquingPlan:
    """Return the plan of ref. [1]: half and quarter turns that put every axis up or down.

    `rate`: rate of every step [rad/s].
    """
    turns = (("-x", np.pi), ("-z", np.pi / 2), ("-y", np.pi), ("+z", np.pi / 2))
    steps = tuple(_turning(word, float(angle), rate) for word, angle in turns)
    return TorquingPlan("published", np.zeros(3), steps)


PUBLISHED = published()  # The plan of ref. [1], 5400 s.
NAMES = ("published",)  # Plans that have a name.

_SIGNED = re.compile(r"^[+-]?[xyz]$")


def sequence(
    words: str, rate: float = RATE, *, segment: float | None = None, total: float | None = None
) -> TorquingPlan:
    """Return a plan of equal segments about one axis each.

    `words`: signed axes in order, such as ``"-x -z -y +z"``; `rate`: rate of every segment
    [rad/s]; `segment`: time of each, None shares `total` out evenly [s]; `total`: time of the
    whole, where `segment` is not given, None for that of the published plan [s].
    """
    signed = words.lower().replace(",", " ").split()
    if not signed:
        raise error("torquing.empty", name=words)
    for word in signed:
        if not _SIGNED.match(word):
            allowed = (*NAMES, *(f"{s}{a}" for a in AXES for s in "+-"))
            hint = suggestion(word, allowed)
            raise error("torquing.sequence", word=word, hint=hint, allowed=", ".join(allowed))
    if segment is None:
        segment = (DURATION if total is None else total) / len(signed)
    words = " ".join(word if word[0] in "+-" else f"+{word}" for word in signed)
    if not 0 < rate < np.inf:
        raise error("torquing.rate", step=1, name=words, given=f"{rate:g} rad/s")
    steps = tuple(_turning(word, rate * segment, rate) for word in words.split())
    return TorquingPlan(words, np.zeros(3), steps)


def from_rates(rates: Sequence[FloatArray], times: Sequence[float]) -> TorquingPlan:
    """Return a plan of any rates.

    `rates` (3,): rate of each step, frame p [rad/s]; `times`: how long each is held [s].
    """
    steps = tuple(
        Step(np.asarray(rate, float), float(time), f"step {k}")
        for k, (rate, time) in enumerate(zip(rates, times, strict=True), 1)
    )
    return TorquingPlan("user plan", np.zeros(3), steps)


def starting(plan: TorquingPlan, start: FloatArray, ramp: float = 0.0) -> TorquingPlan:
    """Return the plan from other angles, with ramps.

    `start` (3,): outer, middle and inner angle at the beginning [rad]; `ramp`: time in which each
    rate is reached [s].
    """
    return replace(plan, start=np.asarray(start, float), ramp=ramp)


@dataclass(frozen=True)
class Reach:
    """How far a rig is taken, or may be."""

    # largest angle between where up is in the cluster and where it was at the start [rad]
    tilt: float
    middle: float  # largest middle angle [rad]
    cable: float  # largest turn of the outer and of the inner gimbal from the start [rad]

    @classmethod
    def of(cls, C_pn: FloatArray) -> Reach:
        """Return how far a motion goes.

        `C_pn` (n, 3, 3): attitudes in close succession: maps East-North-Up to the cluster [1].
        """
        angles = np.unwrap(angles_of(C_pn), axis=0)
        return cls.since(C_pn[0], angles[0], C_pn, angles)

    @classmethod
    def since(
        cls, first: FloatArray, wound: FloatArray, C_pn: FloatArray, angles: FloatArray
    ) -> Reach:
        """Return how far a part of a motion goes from where the whole began.

        `first` (3, 3): attitude at the start [1]; `wound` (3,): outer, middle and inner angle
        there [rad]; `C_pn` (n, 3, 3): attitudes of the part [1]; `angles` (n, 3): its angles,
        counted on beyond whole turns [rad].
        """
        up = np.clip(C_pn[..., 2] @ first[:, 2], -1.0, 1.0)
        return cls(
            float(np.arccos(up).max()),
            float(np.abs(angles[:, 1]).max()),
            float(np.abs(angles - wound)[:, [0, 2]].max()),
        )


@dataclass(frozen=True)
class Limits:
    """What a rig allows; None where it allows everything."""

    rate: float | None = None  # largest rate about an axis [rad/s]
    # tilt, middle, cable: as in `Reach` [rad]
    tilt: float | None = None
    middle: float | None = None
    cable: float | None = None

    @property
    def angles(self) -> tuple[float, ...]:
        """The angles that are limited, shape (k,) [rad]."""
        return tuple(v for v in (self.tilt, self.middle, self.cable) if v is not None)

    def keep(self, reach: Reach) -> bool:
        """Whether so far is not too far."""
        far = ((reach.tilt, self.tilt), (reach.middle, self.middle), (reach.cable, self.cable))
        return all(limit is None or value <= limit for value, limit in far)


def needs(plan: TorquingPlan, limits: Limits) -> tuple[Limit, ...]:
    """Return rate, tilt and cable that a plan needs, beside what the rig allows."""
    # The Earth's rate does not matter to where the cluster points relative to the ground.
    reach, fastest = Reach.of(nominal(plan, 0.0).C_pn), float(np.abs(plan.rates).max())
    return (
        Limit("rate about an axis", "angular rate", fastest, limits.rate),
        Limit("tilt from the start", "angle", reach.tilt, limits.tilt),
        Limit("middle angle", "angle", reach.middle, limits.middle),
        Limit("turn of the outer and inner gimbal", "angle", reach.cable, limits.cable),
    )


FINEST = float(np.radians(6.0))
"""Largest turn in a slot: its bounds are a few per cent too large, and order plans all the same."""

USUAL = 24  # Segments that a random plan has at most, where nothing limits their length [1].
FEWEST = 4  # Segments that a plan has at least [1].
UNSEEN = 0.5  # A coefficient that keeps more than this share of its prior is not seen [1].
SAMPLED = 48  # So many random plans show together what can be seen at all [1].
TRIED = 40  # Random plans that are drawn in search of such as keep the limits [1].
PARTS = 6  # In so many points of a slot the gimbals are looked at: one per degree [1].

LOCK = float(np.radians(88.0))
"""Middle angle from which on the turns of outer and inner gimbal mean nothing [rad]."""

STRIDE = 0.05
"""Largest part of the whole time that one move shifts from one segment to another [1]."""

NO_ROWS, NO_GAINS = np.zeros((0, 3, COLUMNS)), np.zeros((0, 5, 3, 3))
NO_MOMENTS: IntArray = np.zeros(0, np.int64)
"""Neither white rows nor gains nor the course in time are wanted."""

Turns = tuple[tuple[int, int], ...]

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

    # -- plans: which turn, for how many slots

    @cached_property
    def begun(self) -> FloatArray:
        """Attitude at the beginning, shape (3, 3): maps East-North-Up to the cluster [1]."""
        return np.ascontiguousarray(attitude_of(self.start))

    def fits(self, plan: Turns) -> bool:
        """Whether the gimbals can follow."""
        limited = bool(self.limits.angles)
        return not limited or self._keeps(Reach.of(self._path(plan, self.begun)))

    def _keeps(self, reach: Reach) -> bool:
        limits = self.limits
        # Where the middle angle is 90 deg, outer and inner gimbal turn at will.
        return limits.keep(reach) and (limits.cable is None or reach.middle < LOCK)

    def _path(self, plan: Turns, C_pn: FloatArray) -> FloatArray:
        turns = np.array(plan)
        rates, slot = self.turns[turns[:, 0]], self.slot / PARTS
        return np.asarray(attitudes(rates, turns[:, 1] * PARTS, slot, C_pn))

    def draw(self, rng: np.random.Generator) -> Turns:
        """Return a random plan; mostly one whose gimbals keep their limits."""
        k = int(rng.integers(FEWEST, self.most + 1))
        cuts = np.sort(rng.choice(self.slots - k * self.least + k - 1, k - 1, replace=False))
        spare = np.diff([-1, *cuts, self.slots - k * self.least + k - 1]) - 1
        turns = rng.integers(len(self.turns), size=k).tolist()
        if self.limits.angles:
            turns = self._within(turns, (spare + self.least).tolist(), rng)
        return self._tidy([(t, int(s) + self.least) for t, s in zip(turns, spare, strict=True)])

    def _within(self, turns: list[int], slots: list[int], rng: np.random.Generator) -> list[int]:
        """Exchange turns that would take the gimbals beyond their limits, where others do not."""
        out: list[int] = []
        C, first = self.begun, angles_of(self.begun)
        wound = first
        for turn, n in zip(turns, slots, strict=True):
            for other in (turn, *rng.permutation(len(self.turns)).tolist()):
                path = self._path(((other, n),), C)
                angles = np.unwrap(np.vstack([wound, angles_of(path)[1:]]), axis=0)
                if self._keeps(Reach.since(self.begun, first, path, angles)):
                    break
            out.append(other)
            C, wound = path[-1], angles[-1]
        return out

    def moved(self, plan: Turns, rng: np.random.Generator, heat: float) -> Turns:
        """Return a plan with one thing changed; shifts of time shrink with `heat`, shape () [1]."""
        new, k = list(plan), len(plan)
        i, j = int(rng.integers(k)), int(rng.integers(k))
        turn = int(rng.integers(len(self.turns)))
        what = rng.random()
        if what < 0.2:
            new[i] = (turn, new[i][1])
        elif what < 0.55:
            most = 1 + int(heat * STRIDE * self.slots)
            shift = min(int(rng.integers(1, most + 1)), new[i][1])
            new[i] = (new[i][0], new[i][1] - shift)
            new[j] = (new[j][0], new[j][1] + shift)
        elif what < 0.65:
            new[i], new[j] = new[j], new[i]
        elif what < 0.8:
            if new[i][1] >= 2 * self.least:
                cut = int(rng.integers(self.least, new[i][1] - self.least + 1))
                new[i : i + 1] = [(new[i][0], cut), (turn, new[i][1] - cut)]
        elif what < 0.88:
            new.insert(j, new.pop(i))
        elif what < 0.95:
            a, b = min(i, j), max(i, j) + 1
            new[a:b] = new[a:b][::-1]
        else:
            new[i] = (turn, new[i][1])
            new[j] = (int(rng.integers(len(self.turns))), new[j][1])
        return self._tidy(new)

    def _tidy(self, plan: list[tuple[int, int]]) -> Turns:
        """Join neighbours that turn alike; give the time of segments too short to one beside."""
        out: list[tuple[int, int]] = []
        owed = 0
        for turn, slots in plan:
            if slots < self.least:
                owed += slots
            elif out and out[-1][0] == turn:
                out[-1] = (turn, out[-1][1] + slots + owed)
                owed = 0
            else:
                out.append((turn, slots + owed))
                owed = 0
        if owed:
            out[-1] = (out[-1][0], out[-1][1] + owed)
        return tuple(out)

    def torquing(self, plan: Turns) -> TorquingPlan:
        """Return a plan as it is commanded."""
        steps = []
        for turn, slots in plan:
            rate, time = self.turns[turn], slots * self.slot
            words = " ".join(f"{v:+z.4g}" for v in np.degrees(rate * time))
            steps.append(Step(rate, time, f"by {words} deg"))
        return TorquingPlan("found", self.start, tuple(steps), self.ramp)


@dataclass(frozen=True)
class Conditions:
    """What the bound of a plan depends on beside the plan: local gravity is 1."""

    w_ie_n: FloatArray  # (3,) the Earth's rate in n [rad/s]
    constants: FloatArray  # (42,) where it is linearised, packed
    prior_sd: FloatArray  # (46,) of attitude [rad] and constants [packed], all above zero
    C_np: FloatArray  # (3, 3) true attitude at the start [1]
    gyro_psd: float  # white noise of the gyros [rad^2/s]
    accel_psd: float  # white noise of the accelerometers [local g^2 s]
    arms: FloatArray  # (3, 3) positions of the accelerometers [m]
    gravity: float  # local gravity [m/s^2]


@dataclass(frozen=True, kw_only=True)
class TorquingSpace(QuickSpace):
    """The torquing plans that are allowed, judged by the bound over the prior of the constants."""

    allowed: Allowed
    conditions: Conditions  # what the bound depends on
    reference_sd: FloatArray  # (42,) bound over prior of the plan to beat [1]
    # bound over bound of the plan to beat that no constant that counts should exceed [1]
    worst: float
    prior_sd: FloatArray | float = 1.0  # the unit of the bound [1]
    hidden = UNSEEN

    # -- what is seen

    @cached_property
    def beaten(self) -> FloatArray:
        """Bound over prior of the plan to beat, shape (42,) [1]."""
        return self.reference_sd

    def bound(self, plan: Turns) -> FloatArray:
        """Return the bound over the prior of the 42 constants [1]."""
        return np.asarray(remaining(self.information(plan))[3:])

    def information(self, plan: Turns) -> FloatArray:
        """Return what a plan tells of attitude and constants, lower half, shape (45, 45) [1].

        One reading stands for the mean over a slot.
        """
        c, a, turns = self.conditions, self.allowed, np.array(plan)
        command = commanded(a.turns[turns[:, 0]], turns[:, 1], a.slot, a.begun, c.w_ie_n)
        dt, reading, used = self._readings
        gram = information_pass(
            dt, command, reading, used, c.constants, c.prior_sd, np.ascontiguousarray(c.C_np),
            c.w_ie_n, c.gyro_psd, c.accel_psd / a.slot, c.arms, c.gravity, True, 1, NO_ROWS,
            NO_MOMENTS, 0.0, NO_GAINS,
        )[0][0]  # fmt: skip
        return np.ascontiguousarray(gram[:KNOWN, :KNOWN].T)

    @cached_property
    def _readings(self) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Length of the slots, readings, which do not matter, and that all of them count."""
        n = self.allowed.slots
        return np.full(n, self.allowed.slot), np.zeros((n, 3)), np.ones(n, bool)

    @cached_property
    def unseen(self) -> tuple[str, ...]:
        """Constants that no allowed plan shows; refuses where one of them counts."""
        rng = np.random.default_rng(0)
        plans = []
        for tried in range(TRIED):
            plan = self.draw(rng)
            if self.fits(plan):
                plans.append(plan)
            if len(plans) == SAMPLED or (not plans and tried == TRIED - 1):
                break
        if not plans:
            raise error("optimise.limits", tried=TRIED, limits=self.allowed.words)
        left = remaining(np.sum([self.information(plan) for plan in plans], axis=0))[3:]
        return require_seen(self.names, self.weights, left > UNSEEN, self.allowed.words)

    def exact_cost(self, plan: Turns) -> float:
        """Return the cost by what a calibration would state at the site, limits kept exactly."""
        kept = all(limit.kept for limit in self.needs(plan))
        return super().exact_cost(plan) if kept else inf

    def price(self, plan: Turns, sd: FloatArray, beaten: FloatArray) -> float:
        """Return the weighted mean logarithm of the ratios, and the excess of the worst.

        `sd`, `beaten` (42,): of the plan and of that to beat [unit of each name].
        """
        ratio = np.log(sd / beaten)
        mean = float(self.weights @ ratio / self.weights.sum())
        if not np.isfinite(mean):
            return inf
        return mean + max(0.0, float(ratio[self.weights > 0].max()) - log(self.worst))

    # -- what is written of them

    def done(self, plan: Turns | TorquingPlan) -> TorquingPlan:
        """Return a plan as it is commanded."""
        return plan if isinstance(plan, TorquingPlan) else self.allowed.torquing(plan)

    def changes(self, plan: Turns) -> Mapping[str, Mapping[str, Any]]:
        """Return the keys of [procedure] that make a campaign do this plan."""
        steps = [
            {
                "rate": [f"{v:z.12g} deg/s" for v in np.degrees(step.rate)],
                "time": f"{step.time!r} s",
            }
            for step in self.done(plan).steps
        ]
        return {"procedure": {"plan": None, "rate": None, "segment": None, "steps": steps}}

    def motion(self, plan: Turns | TorquingPlan) -> Motion:
        """Return beginning, end [s] and rates [rad/s] of every step."""
        return self.done(plan).motion

    def needs(self, plan: Turns | TorquingPlan) -> tuple[Limit, ...]:
        """Return what of the rig the plan needs, and how much of it is allowed."""
        return needs(self.done(plan), self.allowed.limits)

    def steps(self, plan: Turns | TorquingPlan) -> tuple[tuple[str, ...], ...]:
        """Return the plan as a table: time, rates and angle of every step."""
        rows: list[tuple[str, ...]] = [
            ("from (s)", "to (s)", "x (deg/s)", "y (deg/s)", "z (deg/s)", "turn (deg)")
        ]
        for begins, ends, rate in self.motion(plan):
            rates = [f"{v:z.4g}" for v in np.degrees(rate)]
            angle = np.degrees(np.linalg.norm(rate) * (ends - begins))
            rows.append((f"{begins:g}", f"{ends:g}", *rates, f"{angle:.4g}"))
        return tuple(rows)
