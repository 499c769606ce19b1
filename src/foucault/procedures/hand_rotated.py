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
from foucault.detect.coverage import coverage, coverage_json
from foucault.detect.noise import measure_noise, without_spikes
from foucault.detect.stretches import (
    How,
    Rests,
    detection_table,
    find_rests,
    rest_levels,
    rest_table,
)
from foucault.diagnose import hand_rotated as judge
from foucault.diagnose.checks import unseen_sizes
from foucault.diagnose.hand_rotated import hold_out, vertical_check
from foucault.diagnose.left_out import common_g_sensitivity
from foucault.diagnose.references import no_latitude
from foucault.errors import Finding
from foucault.estimate.hand_rotated import RestsAndTurns, first_guess, slips
from foucault.guard.rest import check_session, enough_rests
from foucault.infer.left_out import Judgement
from foucault.infer.mixed import NOISE_BASIS, SIGNIFICANT, Fit
from foucault.logs.axes import spared
from foucault.logs.follow import OnDisk
from foucault.models.imu import ImuModel
from foucault.models.left_out import Change, Motion
from foucault.models.noise import ImuNoise, SessionNoise
from foucault.models.rests_and_turns import Attitudes, misfit
from foucault.models.rests_and_turns import Session as SessionData
from foucault.plans.directions import RestPlan, hand_plan
from foucault.procedures import left_out, record
from foucault.procedures.left_out import Again
from foucault.procedures.record import Given, Procedure, result_of
from foucault.result import Result
from foucault.simulate.hand_rotated import simulate_drawn
from foucault.strict import Strict
from foucault.tables import SPIKES, Log, range_below_g
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

    @property
    def meant(self) -> RestPlan:
        """What it is asked for: rests and turns of one length."""
        rests = np.full(self.rests, self.rest_time)
        rests[0] = self.first_rest_time
        turns = np.full(self.rests - 1, self.turn_time)
        return replace(self.plan(None, 0), rest_time=rests, turn_time=turns)


def _solve(log: Log | OnDisk, given: Given[Settings]) -> Result:
    if not isinstance(log, Log):
        from foucault.detect import worn  # few logs are of days

        log = worn.rests(log, lambda done: given.progress(0.1 + 0.6 * done, "finding the rests"))
    if log.averaged is not None:
        from foucault.procedures.poses import solve_poses  # few logs are means

        return solve_poses(log, given)
    given.progress(0.05, "finding the rests")
    log = without_spikes(log)
    data, rests = _reduced(log, given)
    still = [(log.time[rests.first], log.time[rests.last - 1] - log.time[rests.first])]
    findings = [*spared(log.findings, log, None, still), *rests.findings, *check_session(data)]
    if given.site.latitude is None and log.gyro is not None:
        findings.append(no_latitude())
    given.progress(0.3, "calibrating")
    return complete(_likelihood(data, rests, given), data, rests, findings)


def _reduced(log: Log, given: Given[Settings]) -> tuple[SessionData, Rests]:
    settings = given.settings
    rests = find_rests(log, How(settings.window, settings.shortest, settings.threshold))
    needed = NEEDED + (3 if settings.accel_quadratic else 0)
    enough_rests(log, rests, needed, settings.shortest)
    return SessionData.reduce(log, rests.first, rests.last, given.site), rests


def model_of(
    data: SessionData, rests: Rests, given: Given[Settings], start: Attitudes | None = None
) -> RestsAndTurns:
    """State the model of a session.

    `start` or None: where to start, else what its rests say.
    """
    settings, declared = given.settings, given.noise is not None
    start = first_guess(data) if start is None else start
    assert start is not None  # `guard.rest` has solved the same equations
    # Noise measured in rests is a lower limit of what differs between them: scatter beyond it is
    # always estimated, for a test would leave moderate scatter out of the covariance.
    price = SIGNIFICANT if declared else 0.0
    return RestsAndTurns(
        data, settings.estimated(gyro=data.gyro_mean is not None), start,
        _noise(data, rests, given.noise), NOISE_BASIS["declared" if declared else "measured"],
        price if settings.repeatability else None,
    )  # fmt: skip


def complete(result: Result, data: SessionData, rests: Rests, findings: list[Finding]) -> Result:
    """Add to a result what does not depend on how the coefficients were estimated.

    `result`: with coefficients, checks and its own findings and tables.
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
                *judge.unseen(data, site.gravity_sd),
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


def _likelihood(data: SessionData, rests: Rests, given: Given[Settings]) -> Result:
    settings, declared = given.settings, given.noise is not None
    model = model_of(data, rests, given)
    prior = CoefficientVector.prior(model.layout, given.prior)

    def fitted(model: RestsAndTurns) -> tuple[Fit, Judgement | None]:
        return left_out.fit(
            model, prior, given.sizes, data.site, again_of(model), robust=settings.robust
        )

    fit, beside = fitted(model)
    if (slipped := slips(fit)) is not None:  # what is beside such a rest is off, too
        model = replace(model, slipped=slipped)
        fit, beside = fitted(model)
    estimate, prediction = fit.estimate, model.predict(fit.state)
    given.progress(0.7, "predicting held-out rests")
    count = min(settings.held_out, len(data.accel_mean) - NEEDED)
    held_out = hold_out(fit, count) if count > 1 else None
    around, level = coverage(fit.state.C_nb[:, 2, :]), rest_levels(rests)
    judged = judge.judged(fit, declared, level, held_out)
    common = common_g_sensitivity(beside, data.site.gravity)
    vertical = vertical_check(data, estimate, common)
    checks = judge.checks(judged, around, level) + ((vertical,) if vertical else ())
    turned_round = vertical is not None and not vertical.passed
    return result_of(
        "hand_rotated",
        fit,
        checks,
        site=data.site,
        findings=tuple(judge.hints(fit, prediction, turned_round)),
        diagnostics={
            "noise": judge.noise_json(model.noise, declared, fit.found),
            "coverage": coverage_json(around, len(data.accel_mean)),
            "heading_sd": judge.heading_sd(estimate) if data.earth.any() else None,
        },
        tables=judge.tables(fit, prediction, held_out, rest_table(data.log, rests)),
        judged=beside,
    )


def _additions(settings: Settings, session: Session) -> list[tuple[str, Settings, Session]]:
    """Return plans that show more."""
    rests = session.rests + max(session.rests // 2, 1)
    faster = session.turn_time / 2
    return [
        (f"{rests} rests", settings, session.model_copy(update={"rests": rests})),
        ("turns twice as fast", settings, session.model_copy(update={"turn_time": faster})),
    ]


def again_of(model: RestsAndTurns) -> Again:
    """Return the session reduced again: means of the rests, and samples of the turns after them."""
    s, n = model.session, len(model.session.first)
    turns, first, last = s.turns
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
            s,
            site=left_out.changed(s.site, by),
            accel_mean=s.accel_mean + accel[:n],
            gyro_mean=None if s.gyro_mean is None else s.gyro_mean + gyro[:n],
        )
        moved = replace(
            turns,
            accel=None if turns.accel is None else turns.accel + accel[n:],
            gyro=None if turns.gyro is None else turns.gyro + gyro[n:],
        )
        return misfit(other, state, (moved, first, last))

    slow = left_out.wander_of(model.noise.slow, float(np.ptp(s.log.time)))
    return Again(motion, residuals, left_out.white_of(model.noise), slow)


PROCEDURE = Procedure(
    name="hand_rotated",
    doc=__doc__,
    by_rests=True,
    Settings=Settings,
    Session=Session,
    solve=_solve,
    plan=lambda _settings, session, _site: session.meant,
    simulation=simulate_drawn,
    observe=lambda log, given: model_of(*_reduced(log, given), given),
    by_hand=True,
    again=lambda model, *_: again_of(model),
    additions=_additions,
    names=lambda settings, _: settings.estimated(),
    # Means over poses know no turns.
    clocked=lambda log: (
        (log.averaged is None, log.sampled == "increment") if isinstance(log, Log) else (False,) * 2
    ),
    # Rests that somebody has said are taken from a log that is held.
    streams=lambda said: said.gyro is None and said.accel is not None and said.rests is None,
)
calibrate, simulate = PROCEDURE.calibrate, PROCEDURE.simulate
