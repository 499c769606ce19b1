"""One navigation of a log: compensated, aligned, navigated, compared."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.navigation.errors import NavigationError, error_of
from foucault.errors import Finding, FoucaultError, error, finding
from foucault.logs.reference import Reference
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise
from foucault.navigate.increments import Increments, increments_of
from foucault.navigate.state import State
from foucault.navigate.strapdown import Trajectory, navigate
from foucault.procedures.navigation.settings import Settings
from foucault.procedures.navigation.start import Opening, Start, judged, shows_north, start_of
from foucault.result import Result
from foucault.tables import Log
from foucault.units import plain

Place = tuple[float, float, float]

SLOW = 1.0
"""A slower start of what seems to rest is at rest [m/s]."""

WITH, WITHOUT, AS_MEASURED = "with calibration", "without calibration", "as measured"
"""Names of the runs."""


@dataclass(frozen=True)
class Task:
    """What all runs have in common."""

    log: Log  # the part that is used, as measured [SI]
    site: Site
    place: Place  # latitude, longitude [rad] and height [m] there
    settings: Settings
    seen: Opening  # the rest at the start
    noise: ImuNoise  # noise of the sensors [SI]
    reference: Reference | None  # what the runs are compared with

    @property
    def held(self) -> bool:
        return self.settings.vertical != "free"

    def state(self, start: Start) -> State:
        """Return the state at which a run starts."""
        return State(*self.place, self._velocity(start.time), start.C_nb)

    def _velocity(self, time: float) -> FloatArray:
        """Return what is given, zero after a rest, else what the reference says."""
        if self.settings.velocity is not None:
            return np.array(self.settings.velocity)
        if self.seen.end > self.seen.start or self.reference is None:
            return np.zeros(3)
        known = self.reference.velocity(time)
        # A steady drive reads as a rest does; positions of one that stands scatter.
        if known is None or (self.seen.found and np.linalg.norm(known) < SLOW):
            return np.zeros(3)
        return known


@dataclass(frozen=True)
class Made:
    """A run with everything it was made of."""

    name: str  # `WITH`, `WITHOUT` or `AS_MEASURED`
    log: Log  # compensated or not [SI]
    increments: Increments
    start: Start  # the attitude it starts with
    first: int  # row at whose end it starts [1]
    state: State
    trajectory: Trajectory  # every state from there on
    errors: NavigationError | None
    told: tuple[Finding, ...] = ()

    @classmethod
    def of(cls, task: Task, calibration: Result | None) -> Made:
        """Align, judge the alignment, and navigate."""
        log = task.log if calibration is None else calibration.apply(task.log)
        start = start_of(log, task.site, task.seen, task.settings, task.noise)
        bias_sd = bias_sds(None if calibration is None else calibration.coefficients)
        rests = task.reference is None or task.reference.still
        start = judged(start, log, task.site, task.seen, task.noise, bias_sd, rests)
        made = cls.navigated(task, AS_MEASURED if calibration is None else WITH, log, start)
        told = start.findings
        known = task.reference
        given = task.settings.velocity is not None or (
            known is not None and known.velocity(start.time) is not None
        )
        if task.seen.start == task.seen.end and not (task.seen.found or given):
            told += (finding("navigate.speed_at_start"),)
        return replace(made, told=told)

    @classmethod
    def navigated(cls, task: Task, name: str, log: Log, start: Start) -> Made:
        """Navigate from a start to the end."""
        increments = increments_of(log, gaps=task.settings.gaps)
        first = increments.row_at(start.time)
        if len(increments) - first < 3:
            raise error("navigate.too_short", end=plain(start.time, 9),
                        last=plain(float(increments.time[-1]), 9))  # fmt: skip
        state = task.state(start)
        trajectory = navigate(
            increments, state, first=first, gravity_offset=task.site.anomaly,
            vertical=task.settings.vertical or "free",
            heights=_heights(task, increments.time),
        )  # fmt: skip
        errors = None if task.reference is None else error_of(trajectory, task.reference)
        return cls(name, log, increments, start, first, state, trajectory, errors,
                   increments.findings)  # fmt: skip


def without(task: Task, main: Made) -> tuple[Made | None, list[Finding]]:
    """Navigate as measured; where that cannot be aligned, from the attitude of the other run."""
    told: list[Finding] = []
    try:
        start = start_of(task.log, task.site, task.seen, task.settings, task.noise)
        if start.method not in ("given", "level and given heading"):
            shows_north(task.log, task.site, task.seen, start)
    except FoucaultError as problem:
        told.append(finding("navigate.raw_start", reason=problem.message.rstrip(".")))
        start = main.start
    try:
        return Made.navigated(task, WITHOUT, task.log, start), told
    except FoucaultError as problem:
        return None, [*told, finding("navigate.raw_fails", reason=problem.message)]


def _heights(task: Task, time: FloatArray) -> FloatArray | None:
    known = task.reference
    if task.settings.vertical != "aided" or known is None or known.position is None:
        return None
    height = known.position[:, 2]
    said = np.isfinite(height)
    if not said.any():
        return None
    return np.interp(time, known.time[said], height[said], left=np.nan, right=np.nan)


def bias_sds(vector: CoefficientVector | None) -> tuple[float, float]:
    """Return how well gyro biases [rad/s] and accelerometer biases [m/s^2] are known."""
    out = []
    for triad in ("gyro", "accel"):
        names = [] if vector is None else [n for n in vector.names if n.startswith(f"{triad}.bias")]
        sd = np.array([]) if vector is None else vector.sd[[vector.layout.index(n) for n in names]]
        out.append(float(np.sqrt(np.mean(np.nan_to_num(sd) ** 2))) if len(sd) else 0.0)
    return out[0], out[1]
