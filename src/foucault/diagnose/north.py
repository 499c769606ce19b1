"""What a north seeker's stops show, whether they agree, and what made them disagree.

Stops, times and sizes are looked at before north is sought; noise and drift are measured where
nobody has said what they are; fixes are judged, set-up by set-up.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray, begins, by_number
from foucault.diagnose.checks import check
from foucault.errors import Finding, FoucaultError, error, finding
from foucault.estimate.north import Fixes, Known, compensated
from foucault.estimate.north_reduction import (
    NEARLY_FREE,
    UNSEEN,
    Nuisance,
    Pairs,
    Squares,
    rates_of,
    spans,
    turn_rate,
)
from foucault.infer.gauss_newton import Component, chi_square_limits
from foucault.logs.axes import long_enough, noisy, standstill
from foucault.logs.checks import moment
from foucault.models.earth import EARTH_RATE
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.north_seeker import Compensation, Dwells
from foucault.models.rotation import turned
from foucault.result import Check, Level, Verdict
from foucault.tables import IndexedLog
from foucault.units import plain, span

TOO_FAST = 1.5  # Horizontal rate, in Earth rates, that no noise within reason gives [1].
ROWS = 8  # Fewer rows may well read the same [1].

SIDES = ("right accelerometer", "forward accelerometer")
"""Two accelerometers that stay with the case."""

MANY_SD = 6.0  # What differs by so many standard deviations is no noise [1].

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
    """Refuse a sensor that reads one value throughout; name one that does so for a while [SI]."""
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

    `known`: a rough heading and how level the case stands, if they were given. Raises
    ``north.stops`` and ``north.stops_tilt`` where they do not show the heading or the tilt.
    """
    patterns = _patterns(dwells)
    found: list[Finding] = []
    for pattern, those in patterns.items():  # set-ups with the same stops are named once
        angles, name = list(pattern), dwells.names[those[0]]
        name += f" and {len(those) - 1} more" * (len(those) > 1)
        distinct = sorted(set(angles))
        if not spans(distinct):
            if known.near is None:
                raise error("north.stops", name=name, stops=_list(distinct))
            on_base = dwells.accel is not None and dwells.accel.shape[1] == 1
            if on_base and known.level_sd is None:
                raise error("north.stops_tilt", name=name, stops=_list(distinct))
        found += _opposites(name, angles, distinct) if len(angles) < 24 else []
    found += _overlaps(dwells)
    alike: Counter[tuple[int, ...]] = Counter()
    for pattern, those in patterns.items():
        alike[tuple(sorted(pattern))] += len(those)
    usual, often = alike.most_common(1)[0]
    if often > 1 and often > len(dwells.names) / 2:
        others = {i: p for p, those in patterns.items() if len(p) != len(usual)
                  for i in those.tolist()}  # fmt: skip
        for i in sorted(others):
            found.append(
                finding("north.stops_differ", name=dwells.names[i], given=len(others[i]),
                        angles=_list([*others[i]]), most=len(usual))
            )  # fmt: skip
    return tuple(found)


def _patterns(d: Dwells) -> dict[tuple[int, ...], IntArray]:
    """Return the different stops in whole degrees, as they appear, and the set-ups of each."""

    def whole(rows: IntArray | slice) -> IntArray:
        return np.rint(np.degrees(d.index[rows])).astype(int) % 360

    edges = d.first
    count, out = np.diff(edges), []
    for k in np.unique(count).tolist():
        some = np.flatnonzero(count == k)
        code = np.zeros(len(some), np.int64)
        for stop in range(k):  # set-ups whose stops were alike so far have one code
            rows = edges[some] + stop
            if (d.index[rows] != d.index[rows[0]]).any():
                code = np.unique(360 * code + whole(rows), return_inverse=True)[1].reshape(-1)
        order = np.argsort(code, kind="stable")
        out += np.split(some[order], np.flatnonzero(np.diff(code[order])) + 1)
    out.sort(key=lambda those: int(those[0]))
    return {tuple(whole(slice(*edges[i[0] : i[0] + 2])).tolist()): i for i in out}


def _list(angles: list[int]) -> str:
    some = ", ".join(str(a) for a in angles[:12])
    return some + (", ..." if len(angles) > 12 else "")


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
    """Say what an index late by `lag_sd` [s], which nobody said, does where the base turns."""
    first = dwells.of(0)
    if lag_sd is not None or not len(first) or not first.rotates:
        return ()
    rate = float(turn_rate(first))
    half = dwells.interval / 2
    return (
        finding("north.index_lag", rate=f"{np.degrees(rate):.3g}", lag=span(half),
                effect=f"{np.degrees(rate * half):.2g}"),
    )  # fmt: skip


def _overlaps(dwells: Dwells) -> list[Finding]:
    """Notice means that begin long before the one before has ended."""
    step = np.diff(dwells.start)
    early = (step < OVERLAP * dwells.time[:-1]) & ~begins(dwells.setup)[1:]
    if not early.any():
        return []
    row = int(np.argmax(early))
    return [finding("north.overlap", name=dwells.names[dwells.setup[row]],
                    dwell=f"{dwells.time[row]:.4g}", step=f"{step[row]:.4g}")]  # fmt: skip


class Implausible(NamedTuple):
    """The set-up that reads most beyond what there is."""

    code: str  # of the error
    size: float  # of what it reads, over what there is [1]; 0 where none does
    name: str  # of the set-up


def implausible(
    dwells: Dwells, pairs: Pairs, known: Known, compensation: Compensation
) -> tuple[Implausible, ...]:
    """Return which of `pairs` [SI] says most beyond the Earth's rate, and beyond gravity."""
    numbers = compensated(pairs.values, known.gravity, compensation)
    cov, out = pairs.cov, []
    for axes, limit, size, code in (
        (slice(0, 2), TOO_FAST, EARTH_RATE, "north.too_fast"),
        (slice(2, 4), 1.0, known.gravity, "north.tilt"),
    ):
        length = np.linalg.norm(numbers[:, axes], axis=1)
        sd = np.sqrt(np.einsum("nii->n", cov[:, axes, axes])) / size
        wrong = np.flatnonzero((length - limit > MANY_SD * sd) & (sd < np.sqrt(UNSEEN) * 1e-2))
        worst = int(wrong[np.argmax(length[wrong])]) if len(wrong) else 0
        out.append(Implausible(code, float(length[worst]) if len(wrong) else 0.0,
                               dwells.names[worst]))  # fmt: skip
    return tuple(out)


def require_plausible(found: Sequence[Implausible]) -> None:
    """Refuse what says more than the Earth's rate, or more than gravity."""
    for code, size, name in found:
        if size:
            raise error(code, name=name, size=f"{size:.4g}")


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


GUESS = ImuNoise(TriadNoise(white=1e-3), TriadNoise(white=1e-6))
"""Noise to start from where none is known [SI]."""

FEWEST = 5  # Redundant readings that a noise level needs at least [1].


def from_residuals(
    left: Pairs | Squares, accelerometers: bool, more: Sequence[Component] = ()
) -> ImuNoise | None:
    """Measure white noise by what the fits over the index angle leave.

    `left`: of set-ups, reduced with the noise of `GUESS` [1]; `more`: how gyro, and accelerometers,
    fit over the set-ups, with the noise of `GUESS`. Returns white noise of both [SI]; None where
    either has too few redundant readings.
    """
    square, dof = left.chi_square.sum(axis=0), left.dof.sum(axis=0).astype(float)
    for k, over in enumerate(more):
        square[k] += over.chi_square
        dof[k] += over.redundancy
    if dof[0] < FEWEST or (accelerometers and dof[1] < FEWEST):
        return None
    # From few readings the noise itself is uncertain: errors over their sd are then Student's t,
    # whose variance is dof / (dof - 2).
    scale = np.sqrt(square / np.maximum(dof - 2.0, 1.0))
    accel = replace(GUESS.accel, white=GUESS.accel.white * float(scale[1]))
    gyro = replace(GUESS.gyro, white=GUESS.gyro.white * float(scale[0]))
    return ImuNoise(accel if accelerometers else TriadNoise(), gyro)


def drift_sd(
    dwells: Dwells, noise: ImuNoise, wanted: Literal["auto", "none", "linear"], known: float | None
) -> float:
    """Return the standard deviation that the drift is given beforehand [rad/s^2].

    `known` or None: declared standard deviation [rad/s^2]. Returns 0 where the drift is taken as
    none, infinite where it is estimated freely.
    """
    if wanted == "none":
        return 0.0
    if known is not None:
        return known
    if wanted == "linear":
        return float("inf")
    for group in rates_of(dwells, noise, [Nuisance(), Nuisance(drift_sd=np.inf)]):
        (alone, _), (cov, dof) = group
        if np.any(dof < 1) or not np.all(_larger(cov) < NEARLY_FREE**2 * _larger(alone)):
            return 0.0
    return float("inf")


def _larger(cov: FloatArray) -> FloatArray:
    """Return the larger variance that `cov` (g, 2, 2) of two rates has, shape (g,) [unit of it]."""
    return np.asarray(np.linalg.eigvalsh(cov)[:, 1])


def signal_to_noise(fixes: Fixes, pairs: Pairs) -> FloatArray:
    """Return the Earth's horizontal rate over the gyro's uncertainty across it, shape (m,) [1].

    Level that is ``w_ie cos L / sd``: one over what the gyro alone leaves uncertain of the heading.

    `fixes`: solutions with their budget [rad].
    """
    gyro = [v[:, 0] for name, v in fixes.sources.items() if name.startswith("gyro")]
    out = np.asarray(1.0 / np.sqrt(np.maximum(np.sum(gyro, axis=0), 1e-300)))
    # Where the rate along z is lost it is that, and not the gyro, which leaves heading uncertain.
    lost = fixes.status == 1
    sd = np.sqrt(_larger(pairs.cov[lost, :2, :2]))
    out[lost] = EARTH_RATE * np.cos(fixes.angles[lost, 3]) / sd
    return out


SEES = 3.0  # Horizontal Earth rate over its sd below which heading is guesswork [1].

TESTS = 4
"""Statistical tests of a set-up, which share its false alarms: scatter of gyro and accelerometer,
rate and latitude, level [1]."""

FAR_OUT = 6.0  # A set-up whose readings scatter by more than this was disturbed [sd].
STEEP = np.radians(89.5)  # At a tilt beyond this heading is hardly defined [rad].


@dataclass(frozen=True)
class Judged:
    """What the judgement looks at."""

    dwells: Dwells  # readings [SI]
    pairs: Pairs  # four numbers of every set-up [SI]
    fixes: Fixes  # solutions [rad]
    ratio: FloatArray  # (m,) of `signal_to_noise` [1]
    known: Known  # place, and what decided between solutions
    noise: ImuNoise  # noise that was taken [SI]
    noise_source: str  # where it comes from
    accuracy: float | None  # wanted standard deviation of the heading [rad]
    # (m,) how far the accelerometers depart from level, of `level_square` [1]; None where there are
    # none, or nothing was said of the level
    level: FloatArray | None = None
    drift_effect: FloatArray | None = None  # (m,) of `drift_effect` [s^2]
    # most, row: (m,) how far the worst reading is off [sd], and which of its set-up it is [1]
    most: FloatArray = field(default_factory=lambda: np.zeros(0))
    row: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))

    @cached_property
    def worst(self) -> Worst:
        """The reading of every set-up that fits worst."""
        return _worst(self)


SURE = 1e-3
"""A drift of the offset is there where chance makes so much of it less often than this [1]."""

MATTERS = 0.5  # What it moves a result by counts from this part of its standard deviation on [1].


def offset_drift(pairs: Pairs, dwells: Dwells) -> float | None:
    """Return how the offset drifts from set-up to set-up, 0 where it does by no more than chance.

    Alike in every set-up, a drift within it leaves no residual. None where it was estimated, or
    where too few set-ups would tell it [rad/s^2].
    """
    from scipy.special import stdtrit

    first = dwells.first
    if pairs.drift.any() or len(pairs) < 4:
        return None
    t = np.add.reduceat(dwells.start, first[:-1]) + np.add.reduceat(dwells.time, first[:-1]) / 2
    t /= np.diff(first)
    if np.ptp(t) <= 0:
        return None
    t = t - t.mean()
    slope = float(t @ pairs.offset / (t @ t))
    left = pairs.offset - pairs.offset.mean() - slope * t
    dof = len(t) - 2  # few set-ups tell their scatter badly: Student's t
    sd = float(np.sqrt(left @ left / dof / (t @ t)))
    return slope if abs(slope) > float(stdtrit(dof, 1 - SURE / 2)) * sd else 0.0


@dataclass(frozen=True)
class Test:
    """One test of every set-up: numbers and limits of all, and the sentence of one."""

    key: str  # of its sentences
    name: str
    value: FloatArray  # (m,) [unit of the sentence]
    # low, high: its limits, of all or of each [unit of the sentence]; None where there is none
    low: float | None = None
    high: float | FloatArray | None = None
    at: BoolArray | None = None  # (m,) set-ups that it is made of, None for all of them
    given: Callable[[int], Mapping[str, Any]] | None = None  # what else its sentence says
    fails: Level = Level.DOUBTFUL

    def of(self, i: int) -> Check:
        """Return the test of set-up `i` [1]."""
        high = self.high[i] if isinstance(self.high, np.ndarray) else self.high
        high = None if high is None else float(high)
        value, given = float(self.value[i]), {} if self.given is None else self.given(i)
        return check(self.key, self.name, value, self.low, high, given, fails=self.fails)

    @property
    def failed(self) -> BoolArray:
        """Where it fails, shape (m,)."""
        below = np.zeros(len(self.value), bool) if self.low is None else self.value < self.low
        above = False if self.high is None else self.value > self.high
        return np.asarray((below | above) & (True if self.at is None else self.at))


T = TypeVar("T")


@dataclass(frozen=True)
class Each(Sequence[T]):
    """Something of m set-ups, made when it is asked for: of many set-ups few are read."""

    size: int  # set-ups [1]
    of: Callable[[int], T]

    def __len__(self) -> int:
        return self.size

    def __getitem__(self, i: Any) -> Any:
        if isinstance(i, slice):
            return tuple(self[k] for k in range(*i.indices(self.size)))
        return self.of(range(self.size)[i])


@dataclass(frozen=True)
class Tests:
    """The tests of m set-ups, and what they say."""

    each: tuple[Test, ...]
    shared: tuple[Check, ...] = ()  # that every set-up has

    def of(self, i: int) -> tuple[Check, ...]:
        """Return those of set-up `i` [1]."""
        return (*(t.of(i) for t in self.each if t.at is None or t.at[i]), *self.shared)

    def levels(self, told: tuple[Finding, ...]) -> IntArray:
        """Return the level of every set-up, in the order of `Level`, shape (m,) [1].

        `told`: what was noticed of the whole file.
        """
        order = list(Level)
        least = order.index(Verdict.of(self.shared).doubted(told).level)
        out = np.full(len(self.each[0].value), least)
        for t in self.each:
            worse = order.index(t.fails)
            if worse > least:
                np.copyto(out, worse, where=t.failed & (out < worse))
        return out


def checks(j: Judged, calibration: Level | None, shared: tuple[Check, ...] = ()) -> Tests:
    """Return the tests of every set-up.

    `calibration` or None: verdict of the calibration that was used; `shared`: tests that all have.
    """
    m = len(j.fixes)
    solved = np.asarray(np.isfinite(j.fixes.angles).all(axis=1))
    made: list[Test | None] = [_sees(j.ratio)]
    if j.noise_source == "from the residuals":
        made.append(_fitting(j))
    else:
        made += [_scatter(j, k) for k in (0, 1)]
        made += [_scatter_of_all(j, k) for k in (0, 1) if m > 1]
    if j.known.latitude is not None:
        made.append(_norm(j))
    if j.level is not None:
        made.append(_level(j.level))
    made += [_one_heading(j), _upright(j)]
    if j.accuracy is not None:
        made.append(_accurate(j.fixes.sd[:, 0], j.accuracy))
    if calibration is not None and calibration is not Level.PASS:
        said = {"level": calibration.value}
        made.append(Test("calibration used", "calibration", np.zeros(m), 1.0,
                         given=lambda _: said, fails=calibration))  # fmt: skip
    kept = (t for t in made if t is not None)
    each = [replace(t, at=solved if t.at is None else solved & t.at) for t in kept]
    return Tests((_solved(j, solved), *each, *_drifting(j)), shared)


def _drifting(j: Judged) -> list[Test]:
    """Test what the drift of the offset does to the headings."""
    drift = offset_drift(j.pairs, j.dwells)
    if drift is None or j.drift_effect is None:
        return []
    sd = j.fixes.sd[:, 0]
    moved = np.abs(drift * j.drift_effect)
    with np.errstate(invalid="ignore"):
        sds = moved / sd

    def given(i: int) -> dict[str, Any]:
        return {"rate": np.degrees(drift) * 3600**2, "size": np.degrees(moved[i]) * 60,
                "sds": sds[i]}  # fmt: skip

    name = "offset drift of a fix"
    return [Test(name, "offset drift", sds, high=MATTERS, at=np.isfinite(sd), given=given)]


UNSOLVED = {
    0: "The solution converged.",
    1: "The rate along the axis of the base is lost in the noise: both its signs are covered "
    "by the uncertainty.",
    2: "The solution did not settle.",
    3: "The readings do not determine the attitude.",
}
"""Status of a solution -> what it says."""


def _solved(j: Judged, finite: BoolArray) -> Test:
    status = j.fixes.status
    fine = ((status == 0) | (status == 1)) & finite

    def given(i: int) -> dict[str, Any]:
        return {"advice": UNSOLVED.get(int(status[i]), "A reading is not a finite number.")}

    return Test("converged", "solved", fine * 1.0, 1.0, given=given, fails=Level.UNUSABLE)


def _sees(ratio: FloatArray) -> Test:
    def given(i: int) -> dict[str, Any]:
        factor = SEES / max(float(ratio[i]), 1e-9)
        return {"ratio": plain(float(ratio[i]), 3), "factor": factor, "times": factor**2}

    name = "sees the Earth"
    return Test(name, name, ratio, SEES, given=given, fails=Level.UNUSABLE)


def _scatter(j: Judged, sensor: int) -> Test | None:
    dof, value = j.pairs.dof[:, sensor], j.pairs.chi_square[:, sensor]
    what = ("gyro", "accelerometer")[sensor]
    then = ": a disturbance, a drift, too few digits, or more noise than was said."
    high = by_number(dof, _most)
    return _noise(j, sensor, f"{what} over index angle", f"the {what}", value, dof, high, then)


def _scatter_of_all(j: Judged, sensor: int) -> Test | None:
    """Test all set-ups together, but those far out: a little too much noise in each."""
    dof, value = j.pairs.dof[:, sensor], j.pairs.chi_square[:, sensor]
    usual = (dof > 0) & (value <= FAR_OUT**2 * dof)
    total, n = float(value[usual].sum()), int(dof[usual].sum())
    name = ("gyro", "accelerometer")[sensor] + " over all set-ups"
    then = ": there is more noise than was said, or the bias wanders."
    each = np.broadcast_to(total, len(dof)), np.broadcast_to(n, len(dof))
    return None if n < 2 else _noise(j, sensor, name, f"the {name}", *each, _most(n), then)


def _most(dof: int) -> float:
    """Return the largest sum of squares that noise leaves, of so many redundant readings [1]."""
    return chi_square_limits(dof, tests=TESTS)[1] if dof else np.inf


def _noise(
    j: Judged, sensor: int, name: str, what: str, value: FloatArray, dof: IntArray,
    high: float | FloatArray, then: str,
) -> Test | None:  # fmt: skip
    some = dof >= 1
    if not some.any() or (sensor == 1 and not j.noise.accel.white):
        return None

    def given(i: int) -> dict[str, Any]:
        return {"what": what, "ratio": np.sqrt(value[i] / dof[i]), "dof": int(dof[i]),
                "then": then, "overstated": "the noise is"}  # fmt: skip

    return Test("noise", name, value, high=high, at=some, given=given)


def _norm(j: Judged) -> Test:
    value, high = j.fixes.square, chi_square_limits(1, tests=TESTS)[1]
    name = "rate and latitude"
    return Test(name, name, value, high=high, given=lambda i: {"sd": np.sqrt(value[i])})


def _level(value: FloatArray) -> Test:
    high = chi_square_limits(2, tests=TESTS)[1]
    return Test("level", "level", value, high=high,
                given=lambda i: {"what": "case", "ratio": np.sqrt(value[i] / 2)})  # fmt: skip


def _one_heading(j: Judged) -> Test:
    name, other = "one heading", j.fixes.other
    return Test(name, name, np.where(j.fixes.ambiguous, 0.0, 1.0), 1.0,
                given=lambda i: {"heading": np.degrees(other[i, 0]),
                                 "latitude": np.degrees(other[i, 3])})  # fmt: skip


def _upright(j: Judged) -> Test:
    _, pitch, roll, _ = j.fixes.angles.T
    tilt = np.arccos(np.clip(np.cos(pitch) * np.cos(roll), -1.0, 1.0))
    return Test("tilt", "tilt", np.asarray(np.degrees(tilt)), high=float(np.degrees(STEEP)))


def _accurate(sd: FloatArray, wanted: float) -> Test:
    return Test("accuracy", "accuracy", np.asarray(np.degrees(sd)), high=float(np.degrees(wanted)))


def findings(j: Judged, i: int) -> list[Finding]:
    """Return what was noticed of set-up `i` [1]."""
    name, f = j.dwells.names[i], j.fixes
    found = []
    if f.ambiguous[i]:
        other, latitude = np.degrees(f.other[i, [0, 3]])
        found.append(finding("north.ambiguous", name=name, other=f"{other:.3f}",
                             latitude=f"{latitude:.2f}"))  # fmt: skip
    if f.clamped[i] and j.known.latitude is None:
        size = np.linalg.norm(j.pairs.values[i, :2]) / EARTH_RATE
        found.append(finding("north.clamped", name=name, size=f"{size:.4f}"))
    if j.known.near is not None:
        near = np.broadcast_to(j.known.near, len(f))[i]
        away = abs(float(turned(f.angles[i, 0] - near)))
        if away > 3 * j.known.near_sd:
            found.append(finding("north.far", name=name, away=f"{np.degrees(away):.0f}"))
    if j.accuracy is not None and not f.sd[i, 0] <= j.accuracy:
        sd, wanted = (f"{np.degrees(v):.4g}" for v in (f.sd[i, 0], j.accuracy))
        cure = _longer(j, i)
        found.append(finding("north.dwell_short", name=name, sd=sd, wanted=wanted, cure=cure))
    return found + _outlier(j, i)


def _longer(j: Judged, i: int) -> str:
    """Say how long to dwell, where that helps."""
    assert j.accuracy is not None
    white = sum(v[i, 0] for k, v in j.fixes.sources.items() if k in ("gyro noise", "tilt: noise"))
    rest = float(j.fixes.cov[i, 0, 0] - white)
    room = j.accuracy**2 - rest
    if room <= 0:
        sources = {k: v[i, 0] for k, v in j.fixes.sources.items() if "noise" not in k}
        largest = max(sources, key=lambda k: float(sources[k]))
        return (
            f"Longer dwells do not help: {np.degrees(np.sqrt(rest)):.4g} deg come from other "
            f"sources, most of all '{largest}'."
        )
    dwell = float(np.median(j.dwells.of(i).time)) * float(white) / room
    return f"Dwell at least {dwell:.0f} s at each stop, with the same order."


@dataclass(frozen=True)
class Worst:
    """The reading that fits worst of every set-up."""

    row: IntArray  # (m,) of it [1]
    ratio: FloatArray  # (m,) its test over the limit [1]
    size: FloatArray  # (m,) of its residual [sd]
    told: BoolArray  # (m,) where something controls it


def _worst(j: Judged) -> Worst:
    """Return the reading of every set-up that fits worst.

    Noise measured by the residuals of the file is measured anew without it.
    """
    from scipy.special import fdtri

    square = j.most**2
    total = int(j.pairs.dof[:, 0].sum())
    first = j.dwells.first
    count = np.diff(first)
    if j.noise_source == "from the residuals":
        square = square * total / (total - 2.0)  # as it was before Student's factor
        square = square * (total - 1.0) / np.maximum(total - square, 1e-9)
        limits = np.full(len(count), float(fdtri(1.0, total - 1.0, 1 - 0.01 / len(j.dwells))))
    else:
        limits = by_number(count, lambda n: chi_square_limits(1, tests=n)[1])
    return Worst(first[:-1] + j.row, square / limits, np.sqrt(square), j.pairs.dof[:, 0] >= 1)


def _fitting(j: Judged) -> Test:
    found = j.worst
    return Test("worst", "every reading fits", found.ratio, high=1.0, at=found.told,
                given=lambda i: {"what": "reading", "size": found.size[i]})  # fmt: skip


def _outlier(j: Judged, i: int) -> list[Finding]:
    """Name the reading that stands out; with one redundant reading all look alike."""
    found = j.worst
    if not found.told[i] or found.ratio[i] <= 1 or j.pairs.dof[i, 0] < 2:
        return []
    stop = f"{np.degrees(j.dwells.index[found.row[i]]) % 360:.1f}"
    return [finding("north.reading_outlier", name=j.dwells.names[i], stop=stop,
                    size=f"{found.size[i]:.1f}")]  # fmt: skip


def drift_effect(pairs: Pairs, fixes: Fixes) -> FloatArray:
    """Return what a linear drift of 1 rad/s^2 that is not estimated does to a heading, (m,) [s^2].

    `pairs`: set-ups, with what a drift does to the four numbers [SI].
    """
    return np.asarray(np.sum(fixes.slope * pairs.drift_slope, axis=1))
