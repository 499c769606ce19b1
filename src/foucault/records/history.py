"""What the runs of an instrument say of it over time, and of the day when it is due again.

A coefficient of run i, at the time t_i, is taken for

    x_i = a + b (t_i - t_n) + r_i + e_i,      e_i ~ N(0, sd_i^2),   r_i ~ N(0, s^2)

of n runs, with b = 0 of fewer than three dated ones, and with runs before a step or an event left
out. The slope counts whether or not it is more than chance, so that what is not known of a drift
stands in the uncertainty of a day to come; only one that is more than chance is told when it
reaches a limit.
s is the repeatability from one turn-on to the next apart from drift and noise: where the residuals
are larger than the sd of the calibrations, the s that makes their weighted sum of squares equal to
its degrees of freedom [1]_. What runs share, such as local gravity, is in the sd of each. Then

    x(t) = a + b (t - t_n),      var x(t) = d' C d + s^2,      d = (1, t - t_n)

where s counts with Student's factor for the few runs that tell it (`infer.gauss_newton.student`).

Conformity with a limit L follows ISO/IEC Guide 98-4 [2]_: with x(t) normally distributed the
probability of conformity is p = P(|x| <= L). By guarded acceptance with w = U = 2 sd an instrument
conforms where ``|x| + 2 sd <= L``, does not where ``|x| - 2 sd > L``, and is undecided in between.

References
----------
.. [1] R. C. Paule and J. Mandel, "Consensus values and weighting factors", *Journal of Research of
   the NBS* 87 (1982) 377-385.
.. [2] JCGM 106:2012 (ISO/IEC Guide 98-4), *The role of measurement uncertainty in conformity
   assessment*, sections 7 and 8.
"""

from __future__ import annotations

import calendar
import datetime
import math
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from foucault.arrays import FloatArray
from foucault.campaign import comparison, tolerance
from foucault.campaign.tolerance import DECISIONS, GUARD, conformity, decided
from foucault.diagnose.comparable import DAY
from foucault.diagnose.compare import YEAR
from foucault.infer.gauss_newton import student
from foucault.records.entries import Event, Interval
from foucault.records.store import Records, Run
from foucault.result import Level

BREAKS = ("repaired", "adjusted")
"""Events after which an instrument is another."""

FAR = 20.0
"""A limit that is reached later than in so many years is not worth a date [year]."""

MONTH = YEAR / 12


@dataclass(frozen=True)
class Outlook:
    """One coefficient: what it was, is and will be [SI]."""

    name: str
    kind: str  # what is measured, which fixes its unit
    runs: int  # that it is judged by, of those since the last step or event [1]
    how: str  # "one run", "steady", "drift", "step", ... as in `diagnose.compare`
    # value, sd: now, and its standard deviation [SI]
    value: float
    sd: float
    drift: float  # [SI per year]; 0 where it cannot be told
    drift_sd: float  # [SI per year]; NaN where it cannot be told
    # from one turn-on to the next apart from drift and noise; NaN where unknown [SI]
    repeatability: float
    # due_value, due_sd: on the day it is due; NaN where there is none [SI]
    due_value: float
    due_sd: float
    limit: float  # largest size; infinite where there is none [SI]
    conformity: float  # probability that it is within its limit now [1]; NaN without a limit
    due_conformity: float  # the same on the day it is due [1]
    decision: str  # of `DECISIONS` now, by guarded acceptance; empty without a limit
    due_decision: str
    reaches: float  # when |x| + 2 sd reaches the limit, since 1970; NaN: not within `FAR` [s]


@dataclass(frozen=True)
class Past:
    """An instrument: its runs, what was done to it, and what is to come."""

    instrument: str
    now: float  # since 1970 [s]
    runs: tuple[Run, ...]  # all of them, in order
    counted: tuple[Run, ...]  # those that say something of it as it is now
    events: tuple[Event, ...]
    due: float  # since 1970; NaN where no interval is set or nothing is dated [s]
    outlooks: tuple[Outlook, ...]

    @property
    def level(self) -> Level:
        """Unusable where a limit is broken or no run counts, doubtful where it is open or due."""
        now = {o.decision for o in self.outlooks} | ({"fail"} if not self.counted else set())
        if "fail" in now or self.out_of_service:
            return Level.UNUSABLE
        late = self.due < self.now
        doubted = any(r.verdict != Level.PASS and r.decision != "accepted"
                      for r in self.counted[-1:])  # fmt: skip
        return Level.DOUBTFUL if late or doubted or "undecided" in now else Level.PASS

    @property
    def out_of_service(self) -> bool:
        """Whether the last word on it is that it is not to be used."""
        said = [e.what for e in self.events if e.what in ("out of service", "in service")]
        return bool(said) and said[-1] == "out of service"

    @property
    def first_reached(self) -> Outlook | None:
        """The coefficient that reaches its limit first, None where none does."""
        reached = [o for o in self.outlooks if math.isfinite(o.reaches)]
        return min(reached, key=lambda o: o.reaches, default=None)


def past(records: Records, instrument: str, now: float | None = None) -> Past:
    """Return what the records say of an instrument; `now`: since 1970, None for today [s].

    Raises ``records.edited``: a run that counts is not as it was.
    """
    name = records.instrument(instrument)
    at = datetime.datetime.now(datetime.UTC).timestamp() if now is None else now
    runs = records.runs(name)
    events = [b for _, b in records.said(Event) if b.instrument == name]
    events.sort(key=lambda e: comparison.moment(e.on))
    broke = [comparison.moment(e.on) for e in events if e.what in BREAKS]
    logs = records.logs(name)
    counted = _counted(runs, max((b for b in broke if b <= at), default=-math.inf), logs)
    for run in counted:
        records.refuse_edited(run)
    months = [b.months for _, b in records.said(Interval) if b.instrument == name]
    due = _due(counted, months)
    with _ONE:
        lines = _lines(_Asked(name, tuple(counted), records.limits_text(name), records))
    outlooks = tuple(line.outlook(*said, due, at) for said, line in lines)
    return Past(name, at, tuple(runs), tuple(counted), tuple(events), due, outlooks)


def compared(records: Records, found: Past) -> comparison.Comparison | None:
    """Return the runs that count compared with one another; None of fewer than two."""
    read = records.compared(found.instrument, found.counted)
    return comparison.of(read, records.limits(found.instrument)) if len(read) > 1 else None


def _due(counted: Sequence[Run], months: Sequence[float]) -> float:
    """Return when an instrument is due; NaN where no interval is set or nothing is dated [s]."""
    dates = [r.holds for r in counted if r.holds]  # all in UTC
    return _later(comparison.moment(max(dates)), months[-1]) if months and dates else math.nan


def _later(time: float, months: float) -> float:
    """Return the same day so many months later, or the last one of a shorter month [s]."""
    date = datetime.datetime.fromtimestamp(time, datetime.UTC)
    years, month = divmod(date.month - 1 + int(months), 12)
    year = date.year + years
    day = min(date.day, calendar.monthrange(year, month + 1)[1])
    return date.replace(year=year, month=month + 1, day=day).timestamp() + months % 1 * MONTH


def fleet(records: Records) -> list[tuple[str, list[Run], list[Run], float]]:
    """Return every instrument with its runs, those that count, and when it is due [s].

    No run folder is read, however many there are.
    """
    runs: dict[str, list[Run]] = {}
    for run in records.runs():
        runs.setdefault(run.instrument, []).append(run)
    months: dict[str, list[float]] = {}
    for _, body in records.said(Interval):
        months.setdefault(body.instrument, []).append(body.months)
    broke: dict[str, float] = {}
    now = datetime.datetime.now(datetime.UTC).timestamp()
    for _, event in records.said(Event):
        at = comparison.moment(event.on)
        if event.what in BREAKS and at <= now:
            broke[event.instrument] = max(at, broke.get(event.instrument, -math.inf))
    out, logs = [], records.logs()
    for name, own in sorted(runs.items()):
        counted = _counted(own, broke.get(name, -math.inf), logs)
        out.append((name, own, counted, _due(counted, months.get(name, []))))
    return out


def _counted(
    runs: Sequence[Run], since: float, logs: Mapping[int, tuple[str, ...]]
) -> list[Run]:  # fmt: skip
    """Return the runs that count since a time [s]; of one log the newest that somebody made.

    `logs`: number of a run -> hashes of what it was made from.
    """
    again = {r.again for r in runs if r.again}
    kept = [
        r for r in runs
        if r.counts and r.sha256 not in again
        and (since == -math.inf or not r.holds or comparison.moment(r.holds) >= since)
    ]  # fmt: skip
    # Calibrated once more, as with rests that were moved, a log says nothing new.
    seen: set[str] = set()
    newest: set[int] = set()
    for run in sorted(kept, key=lambda r: -r.number):
        if seen.isdisjoint(own := logs.get(run.number, ())):
            seen.update(own)
            newest.add(run.number)
    return [r for r in kept if r.number in newest]


@dataclass(frozen=True)
class _Asked:
    """All that the lines of an instrument rest on: runs by their hashes, and its limits."""

    instrument: str
    runs: tuple[Run, ...]
    limits: str  # a tolerance file; empty: none
    records: Records = field(compare=False)


_ONE = threading.Lock()
"""Who asks for the same at the same time waits for it, and does not work it out again."""


@lru_cache(maxsize=1024)
def _lines(asked: _Asked) -> tuple[tuple[tuple[str, str, float], _Line], ...]:
    """Return name, kind and limit [SI] of every coefficient of the newest run, with its line.

    Those that runs share go by all of them. Where nothing was added since, it is what it was: what
    is asked with names every run by its hash.
    """
    read = asked.records.compared(asked.instrument, asked.runs)
    if not read:
        return ()
    limits = tolerance.parse(asked.limits) if asked.limits else None
    found = comparison.of(read, limits) if len(read) > 1 else None
    last = read[-1].result.coefficients
    history = found.instruments[0].history if found is not None else None
    names = last.names
    limit = np.full(len(names), np.inf) if limits is None else limits.limits(names)[0]
    out = []
    for i, (c, free) in enumerate(zip(last.layout.coefficients, last.free, strict=True)):
        sd = float(last.sd[i])
        if not free or not (math.isfinite(sd) and math.isfinite(last.values[i])):
            continue
        series = None if history is None or c.name not in history.series.names else history.series
        if series is None or history is None:
            one = _Line(1, "one run", np.array([last.values[i], 0.0]), np.diag([sd**2, 0.0]),
                        math.nan, 0.0, 0.0)  # fmt: skip
        else:
            k = series.names.index(c.name)
            one = _line(series.time, series.values[:, k], series.sd[:, k], history.courses[k].how,
                        history.courses[k].step_after)  # fmt: skip
        out.append(((c.name, c.kind, float(limit[i])), one))
    return tuple(out)


@dataclass(frozen=True)
class _Line:
    """A coefficient as a line in time about the newest run, with what it scatters by."""

    runs: int
    how: str
    x: FloatArray  # (2,) value then and slope [SI, SI/s]
    cov: FloatArray  # (2, 2)
    repeatability: float  # [SI]
    wide: float  # the same with Student's factor for the runs that tell it [SI]
    about: float  # the time of that run; 0 where there is no slope [s]

    def at(self, time: float) -> tuple[float, float]:
        """Return the value and its sd at a time [SI]."""
        d = np.array([1.0, time - self.about])
        return float(d @ self.x), math.sqrt(float(d @ self.cov @ d) + self.wide**2)

    def outlook(self, name: str, kind: str, limit: float, due: float, now: float) -> Outlook:
        """Judge it against a limit [SI], at the times `now` and `due` [s]."""
        value, sd = self.at(now)
        later, later_sd = self.at(due) if math.isfinite(due) else (math.nan, math.nan)
        slope_sd = math.sqrt(self.cov[1, 1]) * YEAR
        return Outlook(
            name, kind, self.runs, self.how, value, sd, float(self.x[1]) * YEAR,
            slope_sd if slope_sd > 0 else math.nan, self.repeatability, later, later_sd, limit,
            conformity(value, sd, limit), conformity(later, later_sd, limit),
            _decided(value, sd, limit), _decided(later, later_sd, limit), self._reaches(limit, now),
        )  # fmt: skip

    def _reaches(self, limit: float, now: float) -> float:
        """Return when the guard band reaches the limit; NaN where not within `FAR` years [s]."""
        if not math.isfinite(limit) or "drift" not in self.how:
            return math.nan
        times = now + np.linspace(0.0, FAR * YEAR, 2001)
        near = [abs(v) + GUARD * s >= limit for v, s in map(self.at, times)]
        return float(times[near.index(True)]) if True in near else math.nan


def _line(time: FloatArray, x: FloatArray, sd: FloatArray, how: str, after: int) -> _Line:
    """Fit `x` (n,) with `sd` (n,) [SI] at `time` (n,) [s], as `how` says that it goes."""
    if how == "step":
        time, x, sd = time[after + 1 :], x[after + 1 :], sd[after + 1 :]
    sloped = len(x) > 2 and np.isfinite(time).all() and np.ptp(time) >= DAY
    about = float(time[-1]) if sloped else 0.0
    design = np.ones((len(x), 1))
    if sloped:
        design = np.stack([np.ones(len(x)), time - about], axis=1)
    own = _repeatability(design, x, sd)
    wide = 0.0 if math.isnan(own) else own * student(len(x) - design.shape[1])
    beta, cov = _solved(design, x, sd, wide)
    whole, whole_cov = np.zeros(2), np.zeros((2, 2))
    n = design.shape[1]
    whole[:n], whole_cov[:n, :n] = beta, cov
    return _Line(len(x), how, whole, whole_cov, own, wide, about)


def _solved(
    design: FloatArray, x: FloatArray, sd: FloatArray, own: float
) -> tuple[FloatArray, FloatArray]:
    """Solve by weighted least squares, columns scaled, for what years in seconds do to digits."""
    weight = 1 / np.sqrt(sd**2 + own**2)
    scale = np.abs(design).max(axis=0)
    A = design / scale * weight[:, None]
    inverse = np.linalg.pinv(A)
    return inverse @ (x * weight) / scale, inverse @ inverse.T / np.outer(scale, scale)


def _repeatability(design: FloatArray, x: FloatArray, sd: FloatArray) -> float:
    """Return the scatter of `x` (n,) beyond `sd` (n,) about a model [1]_; NaN if unknown [SI]."""
    dof = len(x) - design.shape[1]
    if dof < 1:
        return math.nan

    def excess(own: float) -> float:
        beta, _ = _solved(design, x, sd, own)
        return float(np.sum((x - design @ beta) ** 2 / (sd**2 + own**2)) - dof)

    if excess(0.0) <= 0:
        return 0.0
    from scipy.optimize import brentq

    high = float(np.ptp(x)) + float(sd.max())
    while excess(high) > 0:
        high *= 2
    return float(brentq(excess, 0.0, high))


def _decided(value: float, sd: float, limit: float) -> str:
    if not (math.isfinite(limit) and math.isfinite(value)):
        return ""
    return DECISIONS[int(decided(np.array(value), np.array(sd), np.array(limit)))]


def pasts(records: Records, now: float | None = None) -> list[Past]:
    """Return all instruments, the one due first first; `now`: since 1970, None for today [s]."""
    each = [past(records, name, now) for name in records.instruments()]
    return sorted(each, key=lambda p: (math.isnan(p.due), p.due, p.instrument))
