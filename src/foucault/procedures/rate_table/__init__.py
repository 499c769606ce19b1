"""Calibrate gyros on a rate table: several rates about each axis, both ways.

Put each axis of the instrument in turn along the vertical spin axis of the table, up or down, and
turn it at a list of rates in both senses, each held for whole turns. Beside bias, scale factor and
misalignment this shows how the scale factor changes with the rate: its asymmetry, and its
non-linearity. Placements with each axis up and down show the g-sensitivity too.

The axes of the result are those of the fixture: the table cannot tell how they lie to the
accelerometers. How far the rate of the table and the squareness of the fixture can be trusted is
part of the uncertainties.

References
----------
.. [1] IEEE Std 647-2006 (laser gyros) and IEEE Std 952-1997 (fibre-optic gyros), rate table tests.
.. [2] V. V. Fedorov, *Theory of Optimal Experiments*, Academic Press, 1972, chapter 2.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, inf, log
from typing import Any

import numpy as np
from pydantic import Field

from foucault import units
from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector, Prior
from foucault.detect.readings import find_readings
from foucault.diagnose.checks import unseen_sizes
from foucault.diagnose.rate_table import Commanded, lacking, rate_steps
from foucault.diagnose.references import BEYOND_THE_SESSION, believed, times_the_table
from foucault.errors import Finding, error
from foucault.guard.rest import first_rest
from foucault.guard.table import rate_columns
from foucault.infer import mixed
from foucault.infer.left_out import With
from foucault.infer.mixed import Model
from foucault.logs.axes import spared
from foucault.models.earth import Site
from foucault.models.imu import EQUATION, LAYOUT, SCALE_EQUATION, ImuModel
from foucault.models.left_out import Change, Motion, Sizes
from foucault.models.noise import Readings
from foucault.plans.limit import Limit
from foucault.plans.optimise import StatedSpace
from foucault.procedures import left_out, record
from foucault.procedures.left_out import Again
from foucault.procedures.rate_table import model as rate_checks
from foucault.procedures.rate_table.model import (
    LOG_LINES,
    TIMES,
    RateTable,
    Session,
    Settings,
    Solution,
    in_si,
    planned,
    require_determined,
    simulated,
)
from foucault.procedures.record import Beforehand, Given, Procedure, result_of
from foucault.result import Result
from foucault.simulate.rate_table import RatePlan
from foucault.tables import AXES, Log, temperature_range
from foucault.units import Rate, Seconds

FRAME = "axes of the fixture, right-forward-up as it holds the instrument"
GAUGE = "each axis is the spin axis of its placements"
SOURCES = {
    "declared": "declared",
    "measured": "measured in the steps",
    "unknown": "measured by the residuals",
}

FEW = 0.1  # A larger part of the steps being outliers, they are scatter [1].


def names_of(settings: Settings) -> tuple[str, ...]:
    """Return the coefficients that are estimated."""
    families = ["gyro.bias", "gyro.scale", "gyro.misalignment"]
    families += ["gyro.g_sensitivity"] if settings.g_sensitivity else []
    families += ["gyro.asymmetry"] if settings.asymmetry else []
    families += ["gyro.cubic"] if settings.cubic else []
    # The last letter is the axis that the rate, or specific force, is about: no other is seen.
    seen = ("gyro.bias.", *settings.placed)
    return tuple(
        n
        for n in LAYOUT.names
        if n.rpartition(".")[0] in families and (n.startswith(seen[0]) or n.endswith(seen[1:]))
    )


def _read(log: Log, given: Given[Settings]) -> tuple[Readings, bool]:
    """Return the readings, and whether their rates are those of the table."""
    if log.gyro is None:
        raise error("rate_table.no_gyro")
    readings = find_readings(log, noise=given.noise, shortest=given.settings.shortest)
    if readings.accel is not None:
        first_rest(log, readings.accel[0] / np.linalg.norm(readings.accel[0]))
    return readings, log.table is not None and (
        log.table.rate is not None or bool(np.isfinite(log.table.angles[:, 0]).all())
    )


def _stated(log: Log, given: Given[Settings]) -> RateTable:
    readings, told = _read(log, given)
    return _table(readings, given.settings, told, given.site)[0]


def _solve(log: Log, given: Given[Settings]) -> Result:
    settings = given.settings
    given.progress(0.05, "finding the steps")
    readings, told = _read(log, given)
    given.progress(0.5, "calibrating")
    result = from_readings(
        readings,
        settings,
        told=told,
        site=given.site,
        prior=given.prior,
        sizes=given.sizes,
    )
    validity = dict(result.validity)
    if log.averaged is None:
        validity |= {"rate": log.rate, "sampled": log.sampled}
    validity |= temperature_range(log)
    used = [(readings.start, readings.time)]
    twice = rate_columns(log, readings, settings.table_rate_sd)
    findings = (*spared(log.findings, log, used, ()), *twice, *result.findings)
    return replace(result, findings=findings, validity=validity)


def from_readings(
    readings: Readings,
    settings: Settings,
    *,
    told: bool,
    site: Site,
    prior: Prior | None = None,
    sizes: Sizes | None = None,
) -> Result:
    """Calibrate from readings that were made before.

    `told`: whether their rates are those of the table, else `rates` of the settings are matched.
    """
    site = settings.where(site)
    table, found = _table(readings, settings, told, site)
    e = solved(table, site, prior, sizes)
    checks = rate_checks.checks(e)
    bent = settings.asymmetry or settings.cubic
    rates = [float(e.steps.gyro.min()), float(e.steps.gyro.max())]
    return result_of(
        "rate_table",
        e.fit,
        checks,
        site=site,
        described=(SCALE_EQUATION if bent else EQUATION, FRAME, GAUGE),
        findings=(*_told(readings), *found, *rate_checks.hints(e)),
        validity={"gyro": rates},
        diagnostics={
            "noise": {"source": SOURCES[e.table.noise], "gyro_white": _white(e)},
            "rate_table": rate_checks.standard_figures(e),
            "rate_scatter": e.scatter,
            "bias_drift": rate_checks.drift_figures(e),
            "unseen": [
                *unseen(settings),
                *unseen_sizes(e.fit.estimate.coefficients, site.gravity, rates),
            ],
        },
        tables={"rate_steps": rate_checks.step_table(e, readings.start)},
        table_rate_sd=None,
        judged=e.left_out,
    )


def _table(
    readings: Readings, settings: Settings, told: bool, site: Site
) -> tuple[RateTable, list[Finding]]:
    """State the model of readings [SI], and what was noticed in them."""
    commanded = Commanded(in_si(settings.rates), settings.axes)
    steps, found = rate_steps(readings, commanded, told=told, site=site)
    return RateTable(
        steps, names_of(settings), settings, site.latitude,
        "declared" if readings.declared else "unknown" if readings.noise_unknown else "measured",
    ), found  # fmt: skip


def solved(
    table: RateTable,
    site: Site,
    given: Prior | None,
    sizes: Sizes | None = None,
) -> Solution:
    """Estimate the coefficients, and what scatters or moves beyond the noise.

    `site`: gravity and latitude.
    """
    prior = CoefficientVector.prior(table.layout, given) if given else None
    require_determined(table, prior)
    how: dict[str, Any] = {"robust": table.settings.robust, "few": FEW}
    fit, judged = left_out.fit(table, prior, sizes, site, _again(table, site), **how)
    if table.looks_for_scatter:
        # Another bias in every step first: one that moves slowly would follow outliers.
        span = float(np.ptp(table.steps.middle))
        tried = [table, *(replace(table, bias_time=span * part) for part in TIMES)]
        whole: list[Model] = [*tried]
        if isinstance(fit.model, With):  # with what is left out, and what was enlarged
            whole = [replace(fit.model, model=one) for one in tried]
            prior = fit.problem.prior
        best = mixed.likeliest(whole, fit.state, fit.estimate.weights)
        if best is not whole[0]:
            fit = mixed.fit(best, prior, **how)
        table = next(t for t, one in zip(tried, whole, strict=True) if one is best)
    return Solution(table, fit, site, judged)


def _again(table: RateTable, site: Site) -> Again:
    """Return the steps with something put into them; their motion is that of the table."""
    s = table.steps
    w_b = (s.rate + table.vertical)[:, None] * s.up
    begin, end = float((s.middle - s.time / 2).min()), float((s.middle + s.time / 2).max())
    motion = Motion(s.middle, s.force, w_b, begin, end)

    def residuals(state: ImuModel, by: Change) -> FloatArray:
        other = replace(
            s, gyro=s.gyro if by.gyro is None else s.gyro + by.gyro,
            force=s.force * (1 + by.gravity / site.gravity),
        )  # fmt: skip
        north = left_out.changed(replace(site, latitude=table.latitude), by).latitude
        return replace(table, steps=other, latitude=north).linearise(state).residuals

    white = np.nan if table.noise == "unknown" else float(np.sqrt(np.mean(_psd(table))))
    return Again(lambda state: (state, motion), residuals, (np.nan, white))


def _told(readings: Readings) -> list[Finding]:
    """Return what was noticed in the readings; a declared noise is known, of means too."""
    known = "readings.noise_unknown" if readings.declared else ""
    return [f for f in readings.findings if f.code != known]


def _white(e: Solution) -> list[float]:
    size = e.fit.sds.get("gyro noise", 1.0)
    return [float(v) for v in size * np.sqrt(_psd(e.table))]


def _psd(table: RateTable) -> FloatArray:
    """Return the power of the white noise of each gyro, shape (3,) [rad^2/s]."""
    variance = np.sum(table.noise_root**2, axis=2) * table.steps.time[:, None]
    return np.asarray(np.median(variance, axis=0))


def unseen(settings: Settings) -> list[str]:
    """Say what a rate table cannot show in principle, for result.json."""
    rate = believed(settings.table_rate_sd, 1e-6, "ppm")
    square = believed(settings.fixture_sd, float(np.radians(1 / 3600)), "arcsec")
    out = [
        f"A wrong rate of the table: 1 ppm is 1 ppm in all gyro scale factors; {rate}.",
        f"A fixture out of square: what it is goes into the misalignments; {square}.",
        "How the axes lie to the accelerometers: they are those of the fixture.",
        "Rates beyond the fastest step: there the result is extrapolated.",
        BEYOND_THE_SESSION[1],
    ]
    if left := [a for a in AXES if a not in settings.placed]:
        out.append(
            f"Rates about {' and '.join(left)}, along which the spin axis never was: neither the "
            "scale factors there nor what the other gyros read of such rates."
        )
    if not settings.g_sensitivity:
        out.append("The g-sensitivity of the gyros: with one axis up only it looks like bias.")
    return out


# -- which rates are best --------------------------------------------------------------------------

# A plan turns at some speeds, each in both senses and for the same least time, that which fills the
# time of the session: a longer step never shows less. Every plan is judged by what a calibration
# would state of the same session with means. With white noise of the gyros alone that is an optimal
# design for w -> 1, w, |w|, w^3 [2]: few speeds, the fastest among them.

Plan = tuple[float, tuple[float, ...]]
"""Least time of a step [s], and the rates in each placement [deg/s]."""

EVALUATIONS = 200  # Plans that a restart judges: each is a session of means [1].
APART = 0.1  # Speeds are whole multiples of it [deg/s].


QUARTER = 1.25  # Speeds are well apart where one is so many times the other [1].


class Wanted(record.Wanted):
    """What may be changed of the rates of a session, and what is wanted."""

    time: Seconds | None = Field(default=None, gt=0, examples=["30 min"])
    """Time of all steps together; left out, that of the session in [simulate]."""
    fastest: Rate | None = Field(default=None, gt=0, examples=["100 deg/s"])
    """Fastest rate of the table; left out, that of the session."""
    slowest: Rate | None = Field(default=None, gt=0, examples=["5 deg/s"])
    """Slowest rate; left out, that of the session."""
    speeds: int = Field(default=6, ge=1, le=40)
    """Most speeds, each in both senses."""
    fewest: int = Field(default=4, ge=1, le=40)
    """Fewest speeds that are a quarter or more apart: four show whether a cubic term is all that
    there is."""


@dataclass(frozen=True)
class Table:
    """What a table can do in a session."""

    known: Beforehand[Settings, Session]
    time: float  # of all steps together [s]
    # slowest, fastest: rates, in units of `APART` [1]
    slowest: int
    fastest: int
    most: int  # speeds [1]
    fewest: int  # speeds that are `QUARTER` apart [1]

    @property
    def words(self) -> str:
        """What is allowed."""
        slow, fast = (f"{k * APART:.10g}" for k in (self.slowest, self.fastest))
        count = f"up to {self.most} speeds, {self.fewest} of them well apart,"
        return f"{count} of {slow} to {fast} deg/s in {units.span(self.time)}"

    def draw(self, rng: np.random.Generator) -> Plan | None:
        """Return a random plan; None where its steps take too long."""
        ends = log(self.slowest), log(self.fastest)
        return self.filled(np.exp(rng.uniform(*ends, size=int(rng.integers(1, self.most + 1)))))

    def moved(self, plan: Plan, rng: np.random.Generator, heat: float) -> Plan | None:
        """Return a neighbour of `plan`; `heat` falls from 1 to 0 [1]."""
        speeds = [w / APART for w in plan[1] if w > 0]
        k, way = int(rng.integers(len(speeds))), rng.random()
        if way < 0.2 and len(speeds) > 1:
            del speeds[k]
        elif way < 0.4 and len(speeds) < self.most:
            speeds.append(
                speeds[k] if way < 0.3 else float(rng.uniform(self.slowest, self.fastest))
            )
        else:
            speeds[k] *= exp((0.02 + 0.5 * heat) * float(rng.standard_normal()))
        return self.filled(np.array(speeds))

    def fits(self, plan: Plan) -> bool:
        """Whether enough of the speeds of `plan` are well apart."""
        count, last = 0, 0.0
        for speed in sorted(w for w in plan[1] if w > 0):
            if speed >= QUARTER * last:
                count, last = count + 1, speed
        return count >= self.fewest

    def filled(self, speeds: FloatArray) -> Plan | None:
        """Return the plan of `speeds` (k,) [APART] that takes all of the time, in whole seconds."""
        kept = np.sort(np.clip(np.rint(speeds), self.slowest, self.fastest)).tolist()
        rates = tuple(round(sign * k * APART, 9) for k in kept for sign in (1, -1))
        longest = int(self.time / (len(rates) * len(self._axes)))
        least = int(np.ceil(self.known.settings.shortest))
        holds = range(longest, least - 1, -1)
        fitting = (
            float(hold) for hold in holds if self.duration((float(hold), rates)) <= self.time
        )
        hold = next(fitting, None)
        return None if hold is None else (hold, rates)

    @property
    def _axes(self) -> tuple[str, ...]:
        return self.known.settings.axes or self.known.session.axes

    def steps(self, plan: Plan) -> RatePlan:
        """Return what is done in each placement."""
        hold, rates = plan
        each = RatePlan(self._axes, np.radians(rates), hold)
        rest = self.known.session.rest_time
        return each.with_rests(rest) if rest else each

    def duration(self, plan: Plan) -> float:
        """Return the time of all steps in all placements [s]."""
        return len(self._axes) * float(self.steps(plan).time.sum())


def additions(settings: Settings, session: Session) -> list[tuple[str, Settings, Session]]:
    """Return plans that show more: the other sense, a second speed, the first placement again."""
    listed = settings.rates or session.rates
    rates = in_si(listed)
    speed, axes = np.abs(rates[rates != 0]), settings.axes or session.axes
    plans = []
    if (rates > 0).any() != (rates < 0).any():
        other = tuple(f"{-np.degrees(w):.10g} deg/s" for w in rates)
        plans.append(("each rate in the other sense too", {"rates": listed + other}))
    if len(speed) and speed.max() < 2 * speed.min():
        slower = tuple(f"{np.degrees(w) / 3:.10g} deg/s" for w in rates)
        plans.append(("each rate at a third of it too", {"rates": listed + slower}))
    plans.append(("the first placement again at the end", {"axes": axes + axes[:1]}))
    return [
        (words, settings.model_copy(update=told if settings.rates or settings.axes else {}),
         session.model_copy(update=told))
        for words, told in plans
    ]  # fmt: skip


def _does(known: Beforehand[Settings, Session], plan: Plan) -> dict[str, Any]:
    """Return settings and session that do a plan."""
    rates = {"rates": tuple(f"{w!r} deg/s" for w in plan[1])}
    held = {"step_time": plan[0], "rows": "means"}
    settings = known.settings
    settings = settings.model_copy(update=rates) if settings.rates else settings
    return {"settings": settings, "session": known.session.model_copy(update=held | rates)}


@dataclass(frozen=True, kw_only=True)
class RateSpace(StatedSpace):
    """The rates that a table allows, for the coefficients of the gyros."""

    allowed: Table
    blind: tuple[str, ...] = ()  # what no allowed plan shows

    @property
    def unseen(self) -> tuple[str, ...]:
        """Those that no allowed plan shows."""
        return self.blind

    def fits(self, plan: Plan) -> bool:
        """Whether enough of its speeds are well apart."""
        return self.allowed.fits(plan)

    def changes(self, plan: Plan) -> dict[str, dict[str, Any]]:
        """Return what makes a campaign do this plan: keys of its tables, as in the file."""
        hold, rates = plan
        said = [f"{w:.10g} deg/s" for w in rates]
        where = "procedure" if self.allowed.known.settings.rates else "simulate"
        timed: dict[str, dict[str, Any]] = {"simulate": {"step_time": f"{hold:.10g} s"}}
        return timed | {where: timed.get(where, {}) | {"rates": said}}

    def steps(self, plan: Plan) -> tuple[tuple[str, ...], ...]:
        """Return the plan as a table for people: the headings, then one row per step."""
        done = self.allowed.steps(plan)
        turns = np.abs(done.rates) * done.time / (2 * np.pi)
        rows = (
            tuple(f"{round(v, 4):.10g}" for v in row)
            for row in zip(np.degrees(done.rates), done.time, turns, strict=True)
        )
        return (("rate (deg/s)", "time (s)", "turns"), *rows)

    def needs(self, plan: Plan) -> tuple[Limit, ...]:
        """Return what a plan needs of the table."""
        rates, time = np.abs(np.radians(plan[1])), self.allowed.duration(plan)
        most = float(np.radians(self.allowed.fastest * APART))
        return (
            Limit("rate", "angular rate", float(rates.max()), most, "deg/s"),
            Limit("time of all steps", "time", time, self.allowed.time, "s"),
        )

    def duration(self, plan: Plan) -> float:
        """Return the time of all steps [s]."""
        return self.allowed.duration(plan)


def space(b: Beforehand[Settings, Session]) -> RateSpace:
    """Return the rates among which the best are sought; those of the session are to beat."""
    wanted = b.wanted
    rates = np.degrees(in_si(b.settings.rates or b.session.rates))
    reference, speed = (b.session.step_time, tuple(rates.tolist())), np.abs(rates[rates != 0])
    slow, fast = record.ends(b, speed)
    limits = max(round(slow / APART), 1), round(fast / APART)
    counts = max(wanted.speeds, wanted.fewest), wanted.fewest
    table = Table(b, inf, *limits, *counts)
    time = table.duration(reference) if wanted.time is None else wanted.time
    table = Table(b, time, min(limits), max(limits), *counts)
    widest = table.filled(np.linspace(min(limits), max(limits), max(counts[1], 4)))
    made, blind = record.space_of(RateSpace, "rate_table", b, _does, table, reference, widest)
    return replace(made, blind=blind)


PROCEDURE = Procedure(
    name="rate_table",
    doc=__doc__,
    Settings=Settings,
    Session=Session,
    solve=_solve,
    plan=lambda settings, session, _: planned(settings, session),
    simulation=simulated,
    observe=_stated,
    again=lambda table, _, given: _again(table, given.site),
    additions=additions,
    table_rate_sd=None,  # it is among the sources
    lacking=lambda table: lacking(table.steps),
    space=space,
    Wanted=Wanted,
    evaluations=EVALUATIONS,
    names=lambda settings, _: names_of(settings),
    # Nothing is needed of what is between two steps.
    more="stretches",
    clocked=lambda log: (times_the_table(log), log.sampled == "increment"),
    log_lines=LOG_LINES,
)
calibrate, simulate = PROCEDURE.calibrate, PROCEDURE.simulate
