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

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from pydantic import Field

from foucault.coefficients import CoefficientVector
from foucault.diagnose import information
from foucault.diagnose.checks import unseen_sizes
from foucault.diagnose.coverage import coverage, coverage_json
from foucault.diagnose.earth_rate import no_latitude
from foucault.diagnose.fit_checks import budget_json, chi_square_json
from foucault.diagnose.hand_rotated import checks as judge
from foucault.diagnose.hand_rotated import report as session_report
from foucault.diagnose.hand_rotated.earth import vertical_check
from foucault.diagnose.hand_rotated.held_out import hold_out
from foucault.diagnose.hand_rotated.input import check_input, enough_rests
from foucault.diagnose.rests import (
    Rests,
    detection_table,
    find_rests,
    measure_noise,
    rest_levels,
    rest_table,
)
from foucault.diagnose.spikes import without_spikes
from foucault.errors import Finding
from foucault.estimate.hand_rotated.likelihood import RestsAndTurns
from foucault.estimate.hand_rotated.start import first_guess
from foucault.infer import mixed
from foucault.infer.mixed import NOISE_BASIS, SIGNIFICANT
from foucault.logs.axes import spared
from foucault.models.earth import Site
from foucault.models.imu import EQUATION, FRAME, Gauge, ImuModel
from foucault.models.noise import ImuNoise
from foucault.models.references import gravity_error, with_references
from foucault.models.rests_and_turns import Session as SessionData
from foucault.models.session_noise import SessionNoise
from foucault.plans.hand_rotated import hand_plan
from foucault.procedures import Progress, fields
from foucault.procedures.on_table import Task
from foucault.procedures.on_table.poses import solve_poses
from foucault.procedures.on_table.session import TableSettings
from foucault.procedures.record import Given, Procedure
from foucault.result import Result, Verdict
from foucault.simulate.hand_rotated import Simulation
from foucault.simulate.hand_rotated import simulate as simulate_plan
from foucault.strict import Strict
from foucault.tables import Log
from foucault.units import Seconds

NEEDED = 9  # accelerometer coefficients without quadratic terms: one equation each


class Settings(fields.Robust, fields.EarthRate, fields.Terms):
    """What can be chosen; the defaults suit most logs."""

    repeatability: fields.Repeatability = True
    held_out: int = Field(default=5, ge=0)
    """Parts left out in turn to test the prediction; 0: none."""
    window: fields.Window = 0.5
    shortest: fields.Shortest = 1.0
    threshold: fields.Threshold = None


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
    rate: fields.SampleRate = 100.0
    kind: fields.Sampling = "rate"


def _simulated(
    session: Session, settings: Settings, model: ImuModel, noise: ImuNoise, site: Site, seed: int
) -> Simulation:
    plan_seed, noise_seed = np.random.SeedSequence(seed).generate_state(2)
    plan = hand_plan(
        session.rests, session.rest_time, session.turn_time, session.first_rest_time,
        int(plan_seed),
    )  # fmt: skip
    return simulate_plan(
        plan, model=model, noise=noise, site=site, rate=session.rate, sampled=session.kind,
        seed=int(noise_seed),
    )  # fmt: skip


def _solve(log: Log, given: Given[Settings]) -> Result:
    site, settings, progress = given.site, given.settings, given.progress
    if log.averaged is not None:
        task = Task("hand_rotated", _for_poses(settings), None)
        return solve_poses(log, task, given)
    progress(0.05, "finding the rests")
    log = without_spikes(log)
    rests = find_rests(
        log, window=settings.window, threshold=settings.threshold, shortest=settings.shortest
    )
    needed = NEEDED + (3 if settings.accel_quadratic else 0)
    enough_rests(log, rests, needed, settings.shortest)
    data = SessionData.reduce(log, rests.first, rests.last, site)
    still = [(log.time[rests.first], log.time[rests.last - 1] - log.time[rests.first])]
    findings = [*spared(log.findings, log, None, still), *rests.findings, *check_input(data)]
    if site.latitude is None and log.gyro is not None:
        findings.append(no_latitude())
    progress(0.3, "calibrating")
    result = _likelihood(data, rests, settings, given.noise, given.prior, progress)
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
    validity = session_report.validity(data)
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
    assert log.accel is not None
    accel = measure_noise(log.accel, log.interval, rests, increments=counts)
    if log.gyro is None:
        zero = np.zeros(3)
        return SessionNoise(
            accel.psd_of_mean,
            zero,
            zero,
            ImuNoise(),
            accel_rounding=accel.rounding,
            accel_carried=accel.carried,
        )
    gyro = measure_noise(log.gyro, log.interval, rests, increments=counts)
    return SessionNoise(
        accel.psd_of_mean, gyro.psd_of_mean, gyro.psd, ImuNoise(),
        accel_rounding=accel.rounding, gyro_rounding=gyro.rounding,
        accel_carried=accel.carried, gyro_carried=gyro.carried,
    )  # fmt: skip


def _likelihood(
    data: SessionData,
    rests: Rests,
    settings: Settings,
    declared: ImuNoise | None,
    given: Mapping[str, tuple[float, float]],
    progress: Progress,
) -> Result:
    start = first_guess(data)
    assert start is not None  # check_input has solved the same equations
    # Noise measured in rests is a lower limit of what differs between them: scatter beyond it is
    # always estimated, for a test would leave moderate scatter out of the covariance.
    price = SIGNIFICANT if declared is not None else 0.0
    model = RestsAndTurns(
        data, settings.estimated(gyro=data.gyro_mean is not None), start,
        _noise(data, rests, declared), NOISE_BASIS["measured" if declared is None else "declared"],
        price if settings.repeatability else None,
    )  # fmt: skip
    prior = CoefficientVector.prior(model.layout, given)
    fit = mixed.fit(model, prior, robust=settings.robust)
    estimate, prediction = fit.estimate, model.predict(fit.state)
    progress(0.7, "predicting held-out rests")
    count = min(settings.held_out, len(data.accel_mean) - NEEDED)
    held_out = hold_out(fit, count) if count > 1 else None
    around, level = coverage(fit.state.C_nb[:, 2, :]), rest_levels(rests)
    judged = judge.judged(fit, declared is not None, level, held_out)
    vertical = vertical_check(data, estimate)
    checks = judge.checks(judged, around, level) + ((vertical,) if vertical else ())
    turned_round = vertical is not None and not vertical.passed
    gravity = gravity_error(estimate.coefficients, data.site) ** 2
    return Result(
        procedure="hand_rotated",
        coefficients=with_references(estimate.coefficients, data.site),
        equation=EQUATION,
        frame=FRAME,
        gauge=Gauge.LOWER.value,
        verdict=Verdict.of(checks),
        checks=checks,
        findings=tuple(session_report.hints(fit, prediction, turned_round)),
        status=estimate.status,
        diagnostics={
            "iterations": estimate.iterations,
            "noise": session_report.noise_json(model.noise, declared is not None, fit.found),
            "chi_square": chi_square_json(fit.after),
            "chi_square_of_noise_alone": chi_square_json(fit.before),
            "coverage": coverage_json(around, len(data.accel_mean)),
            "heading_sd": session_report.heading_sd(estimate) if data.earth.any() else None,
            **information.bound(mixed.noise_alone(fit), fit.state),
            **budget_json(
                fit, {"local gravity": (gravity, "B", "standard uncertainty of local gravity")}
            ),
        },
        tables=session_report.tables(fit, prediction, held_out, rest_table(data.log, rests)),
    )


PROCEDURE = Procedure(
    name="hand_rotated",
    doc=__doc__,
    Settings=Settings,
    Session=Session,
    solve=_solve,
    simulation=_simulated,
    names=lambda settings, _: settings.estimated(),
    # Means over poses know no turns.
    clocked=lambda log: (log.averaged is None, log.sampled == "increment"),
)
calibrate, simulate = PROCEDURE.calibrate, PROCEDURE.simulate
