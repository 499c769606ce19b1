"""What sessions have in common in which a body is turned and moved by hand."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, Literal, TypeVar

import numpy as np
from pydantic import Field

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose import left_out
from foucault.diagnose.checks import check, given_check, plausible_scales, status_check
from foucault.diagnose.foresight import Foresight
from foucault.diagnose.references import BY_CLOCK
from foucault.errors import Finding, Status, finding
from foucault.estimate.two_bodies import UNSURE_DELAY
from foucault.models.imu import SIZE_EQUATION, Gauge, ImuModel
from foucault.models.left_out import in_words
from foucault.procedures.counted import Counted
from foucault.procedures.record import Beforehand, Given, SampleRate
from foucault.result import Check, Result, TableData, Verdict
from foucault.strict import Strict
from foucault.tables import Log, ranges
from foucault.units import Seconds


class HandSession(Strict):
    """The motion of a session that is simulated."""

    motion: Literal["all axes", "rotation only", "one axis", "planar", "translation only",
                    "constant rate"] = "all axes"  # fmt: skip
    """What the hand does."""
    time: Seconds = Field(default=60.0, ge=10)
    """For how long."""
    vigour: float = Field(default=1.0, gt=0, le=4)
    """How fast, against 1.9 rad/s."""
    rate: SampleRate = 200.0


MOTION = {
    "lever": "turn about at least two axes, with starts and stops",
    "rotation": "turn about at least two axes, with starts and stops",
    "delay": "start and stop often, and do not swing regularly",
    "gyro.": "turn about all three axes",
    "accel.": "hold it in many attitudes, upside down among them",
    "level": "turn it about level axes too",
}
"""What shows a parameter."""

S = TypeVar("S", bound=Strict)
T = TypeVar("T", bound=HandSession)
R = TypeVar("R")


@dataclass(frozen=True)
class Found(Generic[R]):
    """What a session tells, beside what is not estimated where that has a size."""

    solution: R
    coefficients: CoefficientVector  # with all of their covariance [SI]
    bound: FloatArray  # (p,) their sd by noise alone [SI]
    unseen: list[str]  # names of what the motion does not show
    parts: Callable[[], dict[str, FloatArray]]  # source -> variance, terms apart (p,) [SI]
    bases: Mapping[str, tuple[str, str]]  # source -> type, and what its size was evaluated from
    by_clock: Callable[[], FloatArray]  # derivative by the log of the rate of all clocks (p,) [SI]
    beside: Counted[R] | None

    @property
    def budget(self) -> dict[str, FloatArray]:
        """Source -> variance of what is reported (p,) [SI]."""
        known = self.parts()
        return known if self.beside is None else self.beside.beside(known, self.coefficients)

    @property
    def sources(self) -> dict[str, tuple[str, str]]:
        """Source -> type, and what its size was evaluated from, of those that are its own."""
        sizes = {} if self.beside is None else self.beside.judged.sizes
        left = {g: ("B", f"left out, {in_words(g, x)}: {basis}") for g, (x, basis) in sizes.items()}
        return {**self.bases, **left}


GIVES_WAY = (
    "A mount that gives way slowly: both bodies are taken for one that is rigid, and what turns "
    "between them in the length of the session looks like a bias."
)


def result_of(
    procedure: str, frame: str, log: Log, given: Given[Any], at: Found[Any],
    *, checks: Sequence[Check], findings: Sequence[Finding], diagnostics: Mapping[str, Any],
    tables: Mapping[str, TableData],
) -> Result:  # fmt: skip
    """Make the result of a session; `checks`, `diagnostics`, `tables`: those that are its own."""
    s, c, beside, names = at.solution, at.coefficients, at.beside, ", ".join(at.unseen)
    status = Status.CONVERGED if s.converged else Status.NOT_CONVERGED
    every = (
        status_check(status, ()), *plausible_scales(c),
        check("seen in the motion", "seen", float(len(at.unseen)), None, 0.5, {"names": names}),
        *checks, *given_check(c, given.prior), *(() if beside is None else beside.checks),
    )  # fmt: skip
    said = {
        "gravity": given.site.gravity, "bound": at.bound.tolist(),
        "unseen": [*at.unseen, GIVES_WAY], "iterations": s.passes, **diagnostics,
    }  # fmt: skip
    shown = dict[str, TableData]()
    if beside is not None:
        said |= left_out.judgement_json(beside.judged)
        shown["left_out"] = left_out.table(beside.judged)
    if given.shown:
        given.progress(0.8, "looking at what it rests on")
        said["budget"] = {n: v.tolist() for n, v in at.budget.items()}
        said["sources"] = {n: [*at.sources[n]] for n in said["budget"] if n in at.sources}
        said[BY_CLOCK] = at.by_clock().tolist()
        shown |= tables
    return Result(
        procedure, c, SIZE_EQUATION, frame, Gauge.LOWER.value, Verdict.of(every), every,
        (*log.findings, *findings), status, site=given.site.as_dict(), validity=ranges(log),
        diagnostics=said, tables=shown,
    )  # fmt: skip


def foreseen(
    b: Beforehand[S, T], simulated: Callable[..., Any], found: Callable[..., tuple[Found[Any], Any]]
) -> Foresight:
    """Foresee a session by one that is simulated without errors, and what is `found` in its log."""
    noise = b.noise or b.typical
    assert noise is not None
    made = simulated(b.session, b.settings, ImuModel(), noise, b.site, b.seed)
    given = Given(b.site, b.settings, noise, b.prior, sizes=b.sizes)
    at, _ = found(made.log, given, planned=True)
    c, lost = at.coefficients, at.unseen
    words = dict.fromkeys(w for n in lost for k, w in MOTION.items() if k in n)
    delays = [n for n in c.names if n.endswith(".delay") and n != "accel.delay"]
    unsure = [n for n in delays if c.chosen([n]).sd[0] > UNSURE_DELAY]
    told = []
    if lost or unsure:
        reason = "; " + "; ".join(words or {MOTION["delay"]: None})
        told.append(finding("preflight.not_shown", names=", ".join(lost or unsure), reason=reason))
    return Foresight(
        coefficients=replace(c, values=np.zeros(len(c))), linearised_at="no errors",
        plan=b.session.motion, duration=b.session.time, states=len(c), rank=len(c) - len(lost),
        hardly=tuple(lost), bound=at.bound, budget=at.budget, findings=tuple(told),
        left_out=None if at.beside is None else left_out.foretold(at.beside.judged),
    )  # fmt: skip
