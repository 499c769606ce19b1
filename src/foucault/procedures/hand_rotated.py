"""Calibrate an IMU that was rested in many orientations and turned by hand in between.

Rest the instrument in a dozen or more orientations spread over all directions, turn it by hand
from one to the next, and log all the while. Gravity calibrates the accelerometers (its norm is
known) and the turns calibrate the gyros (gravity must turn in the body as they say). With the
latitude the Earth's rotation is modelled too, the unknown heading being a nuisance parameter.

The published method minimises two sums of squares one after the other. Here both are one
likelihood with the attitude of every rest as unknowns, so that the errors of the rest means and
of the gyro integration enter the covariance of every coefficient. The published costs are a
procedure of their own, `hand_rotated_published`.

References
----------
.. [1] D. Tedaldi, A. Pretto, E. Menegatti, "A robust and easy to implement method for IMU
   calibration without external equipments", ICRA 2014.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from pydantic import Field

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.detect.noise import measure_noise, without_spikes
from foucault.detect.readings import find_readings
from foucault.detect.stretches import (
    How,
    Rests,
    detection_table,
    find_rests,
    rest_levels,
    rest_table,
)
from foucault.diagnose import hand_rotated as judge
from foucault.diagnose import hand_rotated as session_report
from foucault.diagnose import table as table_report
from foucault.diagnose.checks import check, unseen_sizes
from foucault.diagnose.hand_rotated import coverage, coverage_json, hold_out, vertical_check
from foucault.diagnose.references import no_latitude
from foucault.errors import Finding, error
from foucault.estimate.hand_rotated import RestsAndTurns, first_guess, resting_bias
from foucault.guard.rest import check_session, enough_rests, first_rest, up_of_rests
from foucault.guard.table import enough_readings
from foucault.infer.gauss_newton import Component
from foucault.infer.mixed import NOISE_BASIS, SIGNIFICANT
from foucault.logs.checks import spared
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.left_out import Change, Motion
from foucault.models.noise import ImuNoise, Readings, SessionNoise
from foucault.models.rests_and_turns import Attitudes
from foucault.models.rests_and_turns import Session as SessionData
from foucault.plans.directions import RestPlan, hand_plan
from foucault.procedures import left_out, record
from foucault.procedures.left_out import Again
from foucault.procedures.on_table import NORM_NEEDS, Task, from_readings
from foucault.procedures.on_table.session import TableSettings
from foucault.procedures.record import Given, Procedure, result_of
from foucault.result import Check, Result, Verdict
from foucault.simulate.hand_rotated import simulate_drawn
from foucault.strict import Strict
from foucault.tables import AXES, SPIKES, Log, TableColumns, range_below_g
from foucault.units import Seconds

NEEDED = 9  # accelerometer coefficients without quadratic terms: one equation each


class Settings(record.Robust, record.EarthRate, record.Terms):
    """What can be chosen; the defaults suit most logs."""

    repeatability: record.Repeatability = True
    held_out: int = Field(default=5, ge=0)
    """Parts left out in turn to test the prediction; 0: none."""
    window: record.Window = 0.5
    shortest: record.Shortest = 1.0
    threshold: record.Threshold = None


class Session(Strict):
    """The session that `simulate` makes."""

    rests: int = Field(default=24, ge=2)
    """Number of rests."""
    rest_time: Seconds = Field(default=4.0, gt=0)
    """Typical length of a rest."""
    turn_time: Seconds = Field(default=2.0, gt=0)
    """Typical length of a turn."""
    first_rest_time: Seconds = Field(default=10.0, gt=0)
    """Length of the first rest."""
    rate: record.SampleRate = 100.0
    kind: record.Sampling = "rate"

    def plan(self, settings: Any, seed: int) -> RestPlan:
        """Return what a hand does; `seed`: seed of what is drawn of it [1]."""
        return hand_plan(self.rests, self.rest_time, self.turn_time, self.first_rest_time, seed)


def _solve(log: Log, given: Given[Settings]) -> Result:
    site, settings, progress = given.site, given.settings, given.progress
    if log.averaged is not None:
        task = Task("hand_rotated", _for_poses(settings), None)
        return solve_poses(log, task, given)
    progress(0.05, "finding the rests")
    log = without_spikes(log)
    rests = find_rests(log, How(settings.window, settings.shortest, settings.threshold))
    needed = NEEDED + (3 if settings.accel_quadratic else 0)
    enough_rests(log, rests, needed, settings.shortest)
    data = SessionData.reduce(log, rests.first, rests.last, site)
    still = [(log.time[rests.first], log.time[rests.last - 1] - log.time[rests.first])]
    findings = [*spared(log.findings, log, None, still), *rests.findings, *check_session(data)]
    if site.latitude is None and log.gyro is not None:
        findings.append(no_latitude())
    progress(0.3, "calibrating")
    result = _likelihood(data, rests, given)
    return complete(result, data, rests, findings)


def _for_poses(settings: Settings) -> TableSettings:
    shared = settings.model_dump(
        include={*TableSettings.model_fields} - {"shortest", "g_sensitivity"}
    )
    return TableSettings(**shared)


def complete(result: Result, data: SessionData, rests: Rests, findings: list[Finding]) -> Result:
    """Add to a result what does not depend on how the coefficients were estimated.

    `result`: with coefficients, checks and its own findings and tables; `data`: what was observed
    [SI].
    """
    site, log = data.site, data.log
    validity = range_below_g(log, site.gravity, SPIKES)
    return replace(
        result,
        findings=(*findings, *result.findings),
        site=site.as_dict(),
        validity=validity,
        diagnostics=result.diagnostics
        | {
            "gravity": site.gravity,
            "unseen": [
                *session_report.unseen(data, site.gravity_sd),
                *unseen_sizes(result.coefficients, site.gravity, validity.get("gyro")),
            ],
            "detection": {
                "threshold": rests.threshold,
                "window": rests.window * log.interval,
                "rests": len(rests),
                "rest_time": float(data.rest_time.sum()),
            },
        },
        tables=dict(result.tables) | {"detection": detection_table(log, rests)},
    )


def _noise(data: SessionData, rests: Rests, noise: ImuNoise | None) -> SessionNoise:
    log = data.log
    counts = log.sampled == "increment"
    if noise is not None:
        return SessionNoise.declared(noise, log.interval, counts)
    accel, gyro = (
        None if x is None else measure_noise(x, log.interval, rests, increments=counts)
        for x in (log.accel, log.gyro)
    )
    return SessionNoise.measured(accel, gyro)


def _likelihood(
    data: SessionData,
    rests: Rests,
    given: Given[Settings],
) -> Result:
    settings, declared = given.settings, given.noise
    start = first_guess(data)
    assert start is not None  # `guard.rest` has solved the same equations
    # Noise measured in rests is a lower limit of what differs between them: scatter beyond it is
    # always estimated, for a test would leave moderate scatter out of the covariance.
    price = SIGNIFICANT if declared is not None else 0.0
    model = RestsAndTurns(
        data, settings.estimated(gyro=data.gyro_mean is not None), start,
        _noise(data, rests, declared), NOISE_BASIS["measured" if declared is None else "declared"],
        price if settings.repeatability else None,
    )  # fmt: skip
    prior = CoefficientVector.prior(model.layout, given.prior)
    fit, beside = left_out.fit(
        model, prior, given.sizes, data.site, _again(model), robust=settings.robust
    )
    estimate, prediction = fit.estimate, model.predict(fit.state)
    given.progress(0.7, "predicting held-out rests")
    count = min(settings.held_out, len(data.accel_mean) - NEEDED)
    held_out = hold_out(fit, count) if count > 1 else None
    around, level = coverage(fit.state.C_nb[:, 2, :]), rest_levels(rests)
    judged = judge.judged(fit, declared is not None, level, held_out)
    vertical = vertical_check(data, estimate)
    checks = judge.checks(judged, around, level) + ((vertical,) if vertical else ())
    turned_round = vertical is not None and not vertical.passed
    return result_of(
        "hand_rotated",
        fit,
        checks,
        site=data.site,
        findings=tuple(session_report.hints(fit, prediction, turned_round)),
        diagnostics={
            "noise": session_report.noise_json(model.noise, declared is not None, fit.found),
            "coverage": coverage_json(around, len(data.accel_mean)),
            "heading_sd": session_report.heading_sd(estimate) if data.earth.any() else None,
        },
        tables=session_report.tables(fit, prediction, held_out, rest_table(data.log, rests)),
        judged=beside,
    )


def _again(model: RestsAndTurns) -> Again:
    """Return the session reduced again: means of the rests, and samples of the turns after them."""
    s, n = model.session, len(model.session.first)
    turns, first, last = s.turns
    # The same session without the samples of the rests, whose means are kept.
    short = replace(s, log=turns, first=np.append(0, last), last=np.append(first + 1, len(turns)))
    middle = (s.log.time[s.first] + s.log.time[s.last - 1]) / 2
    time = np.append(middle, turns.time)

    def together(mean: FloatArray | None, sample: FloatArray | None) -> FloatArray:
        if mean is None or sample is None:
            return np.zeros((len(time), 3))
        return np.concatenate([mean, sample])

    def motion(state: Attitudes) -> tuple[ImuModel, Motion]:
        read = together(s.accel_mean, turns.accel), together(s.gyro_mean, turns.gyro)
        f_b, w_b = state.model.compensate(*read)
        assert f_b is not None
        assert w_b is not None
        return state.model, Motion(time, f_b, w_b, *s.log.time[[0, -1]])

    def residuals(state: Attitudes, by: Change) -> FloatArray:
        accel, gyro = (np.zeros((len(time), 3)) if x is None else x for x in by[:2])
        other = replace(
            short,
            site=left_out.changed(s.site, by),
            accel_mean=s.accel_mean + accel[:n],
            gyro_mean=None if s.gyro_mean is None else s.gyro_mean + gyro[:n],
            log=replace(
                turns,
                accel=None if turns.accel is None else turns.accel + accel[n:],
                gyro=None if turns.gyro is None else turns.gyro + gyro[n:],
            ),
        )
        return replace(model, session=other).predict(state).residuals

    return Again(motion, residuals)


NO_TURNS = (
    "Gyro scale factors, misalignments and g-sensitivity: means of poses do not hold the turns, "
    "and what g-sensitivity makes of the rates is scatter of the bias."
)
"""What of the gyros a table of means cannot show."""


def solve_poses(log: Log, task: Task, given: Given[Any]) -> Result:
    """Calibrate the accelerometers, and the bias of the gyros, from means over poses.

    The specific force of every pose of an instrument that nothing held and nobody measured has
    the size of gravity, whatever the attitude: that calibrates the accelerometers, as norm
    observation does. The turns between the poses are not in the table, so that of the gyros the
    bias alone is seen: along up the Earth's rotation is known, across it the heading is not.

    `log`: means, one row per pose [SI]; `task`: which coefficients, and what to do with a wrong
    row; `given`: noise that is None is taken from the residuals. Raises too few poses, poses all
    in a plane, wrong units: see `foucault.symptoms`.
    """
    site, settings, n = given.site, task.settings, len(log)
    if log.accel is None:
        raise error("session.no_accel")
    still = TableColumns(np.full((n, 3), np.nan), np.zeros(n), None)
    given.progress(0.2, "reading the poses")
    readings = find_readings(replace(log, table=still), noise=given.noise)
    rows = np.arange(n)
    enough_readings(readings, NORM_NEEDS + 3 * settings.accel_quadratic, 0)
    up_b = up_of_rests(SessionData.reduce(log, rows, rows + 1, site))
    found = first_rest(log, up_b[0])
    given.progress(0.4, "calibrating")
    alone = from_readings(replace(readings, gyro=None), task, site=site, prior=given.prior)
    result = alone if log.gyro is None else _with_gyros(alone, readings, site)
    result.diagnostics["plan"] = ""
    return replace(
        result,
        findings=(*log.findings, *found, *result.findings),
        validity=table_report.validity(readings, log, site),
    )


def _with_gyros(alone: Result, readings: Readings, site: Site) -> Result:
    """Add the bias of the gyros to a result of the accelerometers."""
    table = alone.tables["readings"]
    up_b = np.column_stack([table[f"up_{axis}"] for axis in AXES])
    gyros = resting_bias(readings, up_b, site)
    names = tuple(f"gyro.bias.{axis}" for axis in AXES)
    c, m = alone.coefficients, len(alone.coefficients)
    assert readings.gyro is not None and c.cov is not None
    cov = np.zeros((m + 3, m + 3))
    cov[:m, :m], cov[m:, m:] = c.cov, gyros.cov
    vector = CoefficientVector(
        LAYOUT.subset((*c.names, *names)), np.append(c.values, gyros.bias), cov,
        prior_sd=np.append(c.prior_sd, np.full(3, np.inf)),
    )  # fmt: skip
    said = dict(alone.diagnostics)
    left = np.diag(gyros.cov - gyros.noise)
    said["budget"] = {k: [*v, 0.0, 0.0, 0.0] for k, v in said["budget"].items()} | {
        "gyro noise": [*np.zeros(m).tolist(), *np.diag(gyros.noise).tolist()],
        "scatter of the rates and unknown Earth rate": [*np.zeros(m).tolist(), *left.tolist()],
    }
    measured, unknown = NOISE_BASIS[readings.noise_from], ("A", "scatter of the rates at rest")
    said["sources"] = said["sources"] | {
        "gyro noise": [*measured], "scatter of the rates and unknown Earth rate": [*unknown],
    }  # fmt: skip
    if "bound" in said:
        said["bound"] = [*said["bound"], *np.sqrt(np.diag(gyros.noise)).tolist()]
    said["noise"] = said["noise"] | {"gyro_repeatability": gyros.scatter}
    said["unseen"] = [*said["unseen"], NO_TURNS]
    checks = (*alone.checks, *_explained(gyros.fit, readings.declared))
    found = [f for f in alone.findings if f.code != "session.no_gyro"]
    if site.latitude is None:
        found.append(no_latitude())
    tables = dict(alone.tables)
    tables["readings"] = dict(table) | {
        f"gyro_{axis}": readings.gyro[:, i] for i, axis in enumerate(AXES)
    }
    return replace(
        alone, coefficients=vector, checks=checks, verdict=Verdict.of(checks),
        findings=tuple(found), diagnostics=said, tables=tables,
    )  # fmt: skip


def _explained(fit: Component, declared: bool) -> list[Check]:
    """Hold the rates along up against the noise that was declared."""
    if not declared:
        return []
    given = {"ratio": np.sqrt(fit.ratio)}
    name = "noise of angular rate at rest"
    return [check("noise along up", name, fit.chi_square, fit.low, fit.high, given)]


PROCEDURE = Procedure(
    name="hand_rotated",
    doc=__doc__,
    Settings=Settings,
    Session=Session,
    solve=_solve,
    simulation=simulate_drawn,
    names=lambda settings, _: settings.estimated(),
    # Means over poses know no turns.
    clocked=lambda log: (log.averaged is None, log.sampled == "increment"),
)
calibrate, simulate = PROCEDURE.calibrate, PROCEDURE.simulate
