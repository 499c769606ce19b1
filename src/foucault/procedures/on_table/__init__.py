"""What the procedures on a table have in common: from a log to a result.

They differ in what they believe of the table: nothing (`norm_observation`), everything
(`multi_position`), or its angles with errors of known size (`turntable`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector, Prior
from foucault.detect.coverage import coverage, coverage_json
from foucault.detect.readings import find_readings, stream_readings
from foucault.diagnose import table as judge
from foucault.diagnose.foresight import Foresight
from foucault.diagnose.references import no_latitude, times_the_table
from foucault.errors import Finding, error, finding
from foucault.estimate import table as table_likelihood
from foucault.estimate.table import AT_REST, FORCES, IN_SPINS, Options, TableFit, TableModel, fit
from foucault.guard.rest import first_rest, same_unit
from foucault.guard.table import check_gyro_axes, check_readings, enough_readings, rate_columns
from foucault.logs.axes import spared
from foucault.logs.follow import OnDisk
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.left_out import Change, Motion, Sizes
from foucault.models.noise import ImuNoise, Readings
from foucault.models.turntable import Angles, Free, Geometry, State, Trust, predict, up_k
from foucault.plans.directions import table_plan
from foucault.plans.efficiency import refuse_singular
from foucault.plans.table import PositionSpace, Wanted
from foucault.procedures import left_out
from foucault.procedures.left_out import Again
from foucault.procedures.on_table.session import (
    LOG_LINES,
    TableSession,
    TableSettings,
    plan_of,
    simulate,
)
from foucault.procedures.record import Beforehand, Given, Procedure, result_of
from foucault.result import Result
from foucault.tables import Log
from foucault.units import STANDARD_GRAVITY

S = TypeVar("S", bound=TableSettings)
N = TypeVar("N", bound=TableSession)
Variant = Callable[[Readings, Site, TableFit], tuple[CoefficientVector, State, FloatArray]]
"""Coefficients with covariance, the state, and what one unit of each reading does to them."""


@dataclass(frozen=True)
class Task:
    """What a procedure on a table is, and what it was given."""

    procedure: str  # its name, shape ()
    settings: TableSettings
    trust: Trust | None  # what is believed of the table; None for nothing
    # another way to the coefficients than the likelihood, which then only judges them
    variant: Variant | None = None
    poses: bool = False  # whether a hand held it, and never turned it: of gyros the bias is seen
    # what is believed of the table where what is not estimated counts; None: the same
    counted: Trust | None = None
    counts: bool = False  # whether what is not estimated counts

    def where(self, sizes: Sizes | None) -> Task:
        """Return the task where `sizes` or None are those of what is not estimated [SI]."""
        if sizes is None:
            return self
        return replace(self, counts=True, trust=self.counted or self.trust)


def solve(log: Log | OnDisk, task: Task, given: Given[Any]) -> Result:
    """Calibrate an IMU from a log taken on a table.

    `log`: samples, or means over positions; one on disk is never held as a whole [SI].
    """
    given.progress(0.05, "finding rests and spins")

    def averaging(done: float) -> None:
        given.progress(0.4 * done, "averaging")

    readings = read_positions(log, task, given.noise, averaging)
    given.progress(0.4, "calibrating")
    result = from_readings(readings, task, site=given.site, prior=given.prior, sizes=given.sizes)
    return replace(
        result,
        findings=_without_gaps((*_noticed(log, readings, task.settings), *result.findings)),
        validity=judge.validity(readings, log if isinstance(log, Log) else None, given.site),
    )


def clocked(log: Log | OnDisk) -> tuple[bool, bool]:
    """Tell whether spin rates are timed by the clock of the log, and whether it is increments."""
    if isinstance(log, Log):
        return times_the_table(log), log.sampled == "increment"
    table, accel = log.description.table, log.description.accel
    outer = table is not None and table.columns is not None and table.columns[0] is not None
    timed = outer and log.description.averaged is None
    return timed, accel is not None and accel.kind == "increment"


def _noticed(log: Log | OnDisk, readings: Readings, s: TableSettings) -> tuple[Finding, ...]:
    if not isinstance(log, Log):
        return log.findings
    used = [(readings.start, readings.time)]
    told = any(f.code == "spin.rate_clock" for f in readings.findings)
    twice = [] if told else rate_columns(log, readings, s.table_rate_sd)
    return *spared(log.findings, log, used, used), *twice


def _without_gaps(findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """Moves that nobody logged are no lost data."""
    if "positions.unlogged" not in [f.code for f in findings]:
        return findings
    return tuple(f for f in findings if f.code != "log.gap")


def read_positions(
    log: Log | OnDisk,
    task: Task,
    noise: ImuNoise | None,
    progress: Callable[[float], None] | None = None,
) -> Readings:
    """Find the rests and spins of a log, and check that they can be right.

    `log`: samples, or means over positions [SI]; `noise`: noise of the instrument [SI], None
    measures it; `progress` or None: called with the fraction done, for a log on disk.
    """
    s = task.settings
    described = log if isinstance(log, Log) else log.description
    if described.accel is None:
        raise error("session.no_accel")
    plans = [
        table_plan(
            s.chosen, spin_rate=s.spin_rate, rest_time=max(s.shortest, 1e-3), turns=1, spins=spins,
            both_senses=s.both_senses, four_positions=s.four_positions,
        )
        for spins in (False, True)
    ]  # fmt: skip
    if isinstance(log, Log):
        found = find_readings(log, plan=plans[True], noise=noise, shortest=s.shortest)
    else:
        found = stream_readings(
            log.description, log.folder, plan=plans[True], noise=noise, shortest=s.shortest,
            progress=progress,
        )  # fmt: skip
    if found.gyro is not None and len(found) > 1 and _the_same(found.gyro):
        raise error("readings.gyro_constant")
    if found.accel is not None:
        same_unit(found.accel[~found.spin], STANDARD_GRAVITY)
    # Accelerometers alone need no spins, and none are missing then.
    plan = plans[described.gyro is not None or bool(found.spin.any())]
    checked = check_readings(
        found, plan, described,
        angles_matter=task.trust is not None, shortest=s.shortest,
        table_rate_sd=s.table_rate_sd if "spin_rate" in s.model_fields_set else None,
    )  # fmt: skip
    check_gyro_axes(found)  # `checked` has the senses of spins from the gyros
    if found.accel is not None and found.accel[0].any():  # dead ones point nowhere
        first_rest(described, found.accel[0] / np.linalg.norm(found.accel[0]))
    return checked


def _the_same(means: FloatArray) -> bool:
    """Tell whether all readings are the same to the last digits: no noise is so small."""
    return bool(np.all(np.ptp(means, axis=0) <= 1e-12 * np.abs(means).max()))


def from_readings(
    readings: Readings,
    task: Task,
    *,
    site: Site,
    prior: Prior | None = None,
    sizes: Sizes | None = None,
) -> Result:
    """Calibrate from readings that were made before."""
    model, found = stated(readings, task, site, prior)
    readings, options, start, again = (
        model.readings,
        model.options,
        model.start,
        reduced_again(model),
    )
    whole = left_out.whole(sizes, site, again.white, again.wander)
    if whole is None:
        solution = fit(readings, site, start, options)
    else:
        columns = left_out.columns(options.names, site, whole, again)
        solution = fit(readings, site, start, options, lambda _: columns)
        assert solution.left_out is not None
        judged = left_out.told_of(solution.left_out, options.names, site, whole)
        solution = replace(solution, left_out=judged)
    likelihood = None
    if task.variant is not None:
        likelihood = solution.estimate.coefficients
        coefficients, state, gain = task.variant(readings, site, solution)
        estimate = replace(solution.estimate, coefficients=coefficients, state=state)
        solution = replace(solution, fit=replace(solution.fit, estimate=estimate), gain=gain)
    return _result(readings, task, site, solution, found, likelihood)


def stated(
    readings: Readings, task: Task, site: Site, prior: Prior | None
) -> tuple[TableModel, list[Finding]]:
    """State the model of readings, and what is to be said of them."""
    readings, found = _usable(readings, task, site)
    options = options_of(readings, task, prior)
    return TableModel(readings, site, _start(readings, task, site, options), options), found


def reduced_again(model: TableModel) -> Again:
    """Return the readings with something put into them; their motion is what they are fitted to."""
    r = model.readings

    def motion(state: State) -> tuple[ImuModel, Motion]:
        at = predict(state, r, model.site, model.options.unknowns)
        f_b, w_b = state.model.compensate(at.accel, at.gyro)
        assert f_b is not None
        assert w_b is not None
        ends = float(r.start.min()), float((r.start + r.time).max())
        return state.model, Motion(r.start + r.time / 2, f_b, w_b, *ends)

    def residuals(state: State, by: Change) -> FloatArray:
        site = left_out.changed(model.site, by)
        if by.latitude and site.latitude is not None:
            state = replace(state, geometry=_moved_north(state.geometry, site.latitude))
        at = predict(state, r, site, model.options.unknowns)
        miss = [
            read - said if more is None else read + more - said
            for read, more, said in ((r.accel, by.accel, at.accel), (r.gyro, by.gyro, at.gyro))
            if read is not None
        ]
        first = len(r) if r.accel is None else 0
        # Along the axes of the session: those of changed readings may jump from one pair of
        # tangents to another, and the difference would be no slope.
        rows = np.concatenate(miss)[model.rows - first]
        return np.asarray(np.einsum("kij,kj->ki", model.axes, rows))

    white = [
        float(np.sqrt(np.median(np.diagonal(cov, axis1=1, axis2=2) * r.time[:, None])))
        for cov in (r.accel_cov, r.gyro_cov)
    ]
    known = r.noise_from != "unknown"
    slow = left_out.wander_of(r.slow, float(np.ptp(r.start)))
    return Again(motion, residuals, (white[0], white[1]) if known else (np.nan, np.nan), slow)


def _moved_north(geometry: Geometry, latitude: float) -> Geometry:
    """Return what is believed of a table at another `latitude`, shape () [rad]."""
    if isinstance(geometry, Free):
        return replace(geometry, vertical=float(EARTH_RATE * np.sin(latitude)))
    if not isinstance(geometry, Angles) or geometry.trust.latitude is None:
        return geometry
    return replace(geometry, trust=replace(geometry.trust, latitude=latitude))


def options_of(readings: Readings, task: Task, prior: Prior | None) -> Options:
    """Return how readings are fitted, by what they hold and what is believed of the table."""
    names = task.settings.estimated(gyro=readings.gyro is not None, turns=not task.poses)
    spins = bool(readings.spin.any())
    rests = int(np.sum(~readings.spin))
    free = task.trust is None
    # Spins in one sense show no g-sensitivity, however large: where it counts, rates at rest do.
    asked = task.settings.g_sensitivity or not free or task.poses or (task.counts and spins)
    at_rest = readings.gyro is not None and asked
    return Options(
        names,
        # With free directions and no gyros, a lever arm only turns the axis of each spin.
        lever_arm=task.settings.lever_arm and spins and (readings.gyro is not None or not free),
        level=free and spins and rests >= NORM_NEEDS,
        # Rests and spins are minutes apart: with noise that is only measured, the bias may have
        # moved by more than it says.
        offset=spins and rests > 0 and at_rest and not readings.declared,
        prior=CoefficientVector.prior(LAYOUT.subset(names), prior) if prior else None,
        rate_sd=task.settings.rate_sd,
        robust=task.settings.robust,
        repeatability=task.settings.repeatability,
        gyro_at_rest=at_rest,
    )


NORM_NEEDS = 9  # Directions that the norm of one triad needs [1].


def _usable(readings: Readings, task: Task, site: Site) -> tuple[Readings, list[Finding]]:
    """Leave out gyros that nothing calibrates; refuse what cannot work."""
    found: list[Finding] = []
    if readings.gyro is None:
        found.append(finding("session.no_gyro"))
    elif task.poses:
        found += [] if site.latitude is not None else [no_latitude()]
    elif not readings.spin.any():
        found.append(finding("readings.no_spins"))
        readings = replace(readings, gyro=None)
    elif site.latitude is None:
        raise error("readings.no_latitude")
    if task.trust is not None and not np.isfinite(readings.angles).all():
        names = [
            name
            for name, angle in zip(("outer", "middle", "inner"), readings.angles.T, strict=True)
            if not np.isfinite(angle).all()
        ]
        what = f"{' and '.join(names)} angle"
        raise error("readings.no_angles", procedure=task.procedure, what=what)
    needed = NORM_NEEDS + 3 * task.settings.accel_quadratic if task.trust is None else 4
    turned = readings.gyro is not None and not task.poses
    spins = (NORM_NEEDS if task.trust is None else 4) if turned else 0
    enough_readings(readings, needed, spins)
    return readings, found


def _start(readings: Readings, task: Task, site: Site, options: Options) -> State:
    if task.trust is None:
        start = table_likelihood.free_start(readings, site, options.lever_arm)
    else:
        start = table_likelihood.angle_start(readings, site, task.trust)
    if start is None:
        up = _rough_up(readings)
        model = "accel table" if task.trust is not None else "accel"
        name = task.settings.plan
        if task.settings.accel_quadratic and task.trust is None:
            model = "accel quadratic"
        refuse_singular(name, up[~readings.spin] if (~readings.spin).any() else up, model)
        refuse_singular(name, up, model)
        raise error("readings.no_solution")
    return start


def _rough_up(readings: Readings) -> FloatArray:
    """Directions of up, from the angles of the table, else from the specific forces."""
    if np.isfinite(readings.angles[:, 1:]).all():
        return up_k(readings.angles)
    assert readings.accel is not None
    size = np.linalg.norm(readings.accel, axis=1, keepdims=True)
    return np.asarray(readings.accel / np.maximum(size, 1e-300))


def _result(
    readings: Readings,
    task: Task,
    site: Site,
    solution: TableFit,
    found: list[Finding],
    likelihood: CoefficientVector | None,
) -> Result:
    estimate, settings = solution.estimate, task.settings
    up = estimate.state.geometry.directions()[~readings.spin]
    covered = coverage(up if len(up) else estimate.state.geometry.directions())
    checks = judge.checks(solution)
    if likelihood is not None:
        checks += (judge.agreement(estimate.coefficients, likelihood),)
    # Made-up weights of accelerometers against gyros bound nothing.
    known = readings.noise_from != "unknown"
    return result_of(
        task.procedure,
        solution.fit,
        checks,
        site=site,
        findings=(*readings.findings, *found, *judge.hints(solution, checks)),
        diagnostics={
            "gravity": site.gravity,
            "plan": settings.plan if settings.positions is None else "own positions",
            "noise": {
                "source": judge.NOISE[readings.noise_from], "scatter": solution.scatter,
            },
            "coverage": coverage_json(covered, int(np.sum(~readings.spin))),
            "unseen": judge.unseen(
                readings, site, settings.table_rate_sd, task.trust, settings.accel_quadratic
            ),
        },
        tables={
            "readings": judge.readings_table(solution),
            "rig": judge.rig_table(solution),
        },
        table_rate_sd=common_rate_sd(readings, task, site),
        gain=solution.gain,
        bounded=known,
        judged=solution.left_out,
    )  # fmt: skip


def common_rate_sd(readings: Readings, task: Task, site: Site) -> float:
    """Relative sd of an error that all spin rates share.

    On a table whose tilt is not modelled, a tilt t of the outer axis towards North changes the
    Earth's rate along it by ``w_ie cos(L) t``.
    """
    sd = task.settings.table_rate_sd
    modelled = task.trust is not None and bool(np.any(task.trust.common_sd[:2] > 0))
    if modelled or site.latitude is None or not readings.spin.any():
        return sd
    earth = EARTH_RATE * np.cos(site.latitude) * task.settings.plumb_sd
    return float(np.hypot(sd, earth / np.abs(readings.rate[readings.spin]).min()))


def table_procedure(
    name: str,
    doc: str,
    Settings: type[S],
    Session: type[N],
    task_of: Callable[[S, Site], Task],
) -> Procedure[S, N]:
    """Return the record of a procedure on a table: they differ in the task that settings make."""

    def foresee(b: Beforehand[S, N]) -> Foresight:
        from foucault.procedures.on_table import plan

        return plan.foresee(task_of(b.settings, b.site).where(b.sizes), b)

    def observe(log: Log, given: Given[S]) -> TableModel:
        task = task_of(given.settings, given.site).where(given.sizes)
        return stated(read_positions(log, task, given.noise), task, given.site, given.prior)[0]

    def space(b: Beforehand[S, N]) -> PositionSpace:
        from foucault.procedures.on_table import plan

        return plan.space(task_of(b.settings, b.site).where(b.sizes), b)

    return Procedure(
        name=name,
        doc=doc,
        Settings=Settings,
        Session=Session,
        solve=lambda log, given: solve(
            log, task_of(given.settings, given.site).where(given.sizes), given
        ),
        plan=lambda settings, session, site: plan_of(
            settings, session, spins=site.latitude is not None, judged=None
        ),
        simulation=simulate,
        names=lambda settings, _: settings.estimated(),
        observe=observe,
        again=lambda model, log, _: reduced_again(model),
        foresee=foresee,
        counts=True,
        counts_by_noise=True,
        space=space,
        Wanted=Wanted,
        assumes_noise=True,
        sizes=lambda session, _: {
            name: (session.accel_scatter if name == FORCES else session.gyro_scatter) or 0.0
            for name in (FORCES, AT_REST, IN_SPINS)
        },
        scattered=lambda session, settings, noise: session.scattered(settings, noise),
        streams=lambda _: True,
        # Nothing is needed of what is between two rests or spins.
        more="stretches",
        clocked=clocked,
        log_lines=LOG_LINES,
    )
