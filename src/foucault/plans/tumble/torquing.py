"""How a torqued cluster is turned: rates relative to East-North-Up, step by step.

A plan says how the cluster p turns relative to n, resolved in p. The command of a gyro-stabilised
cluster is a rate relative to inertial space, so that the Earth's rate is added, open loop, at the
attitude that the plan has in the middle of each interval of the command::

    w_cmd = w_np_p + C_pn(middle) w_in_n,    C_pn(t + h) = Exp(-w_np_p h) C_pn(t)

Within an interval the command stands still, and so does the rate of the plan: where a step begins
or a ramp passes, it is the mean over the interval.

References
----------
.. [1] Ding, Cai, Yang, Lian, "Continuous self-calibration and self-alignment method for floated
   inertial platform", J. NUDT 37(3), 2015, section 3 (the plan of four steps).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error, suggestion
from foucault.models.cluster import attitude_of
from foucault.models.earth import earth_rate_n
from foucault.models.rotation import cross_matrix
from foucault.tables import AXES, whole_samples

Motion = tuple[tuple[float, float, tuple[float, float, float]], ...]

TOLERANCE = 1e-6
"""Times nearer than this are the same time [s]."""


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

RATE = float(np.radians(0.1))
"""Rate of the published plan [rad/s]."""

DURATION = 5400.0
"""Its time [s]."""


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


PUBLISHED = published()
"""The plan of ref. [1], 5400 s."""

NAMES = ("published",)
"""Plans that have a name."""

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


def from_rates(
    rates: Sequence[FloatArray], times: Sequence[float], name: str = "user plan"
) -> TorquingPlan:
    """Return a plan of any rates.

    `rates` (3,): rate of each step, frame p [rad/s]; `times`: how long each is held [s].
    """
    steps = tuple(
        Step(np.asarray(rate, float), float(time), f"step {k}")
        for k, (rate, time) in enumerate(zip(rates, times, strict=True), 1)
    )
    return TorquingPlan(name, np.zeros(3), steps)


def starting(plan: TorquingPlan, start: FloatArray, ramp: float = 0.0) -> TorquingPlan:
    """Return the plan from other angles, with ramps.

    `start` (3,): outer, middle and inner angle at the beginning [rad]; `ramp`: time in which each
    rate is reached [s].
    """
    return replace(plan, start=np.asarray(start, float), ramp=ramp)
