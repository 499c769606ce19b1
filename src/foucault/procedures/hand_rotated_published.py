"""Calibrate a hand-rotated IMU by the published sums of squares, to compare with other programs.

The recipe of reference [1] to the letter: rests by a multiple of the initial variance, the norm
of the first samples of each rest, then the directions of gravity between rests with the gyro
bias held at the mean of the initial rest. `hand_rotated` is the better estimator.

References
----------
.. [1] D. Tedaldi, A. Pretto, E. Menegatti, "A robust and easy to implement method for IMU
   calibration without external equipments", ICRA 2014.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from pydantic import Field

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.detect.stretches import rest_table
from foucault.diagnose import hand_rotated as judge
from foucault.diagnose.checks import status_check
from foucault.diagnose.comparable import of_site
from foucault.diagnose.hand_rotated import norm_columns
from foucault.errors import Status, error
from foucault.estimate import hand_rotated as published_hand_rotated
from foucault.estimate import norm_observation
from foucault.estimate.hand_rotated import find_published_rests
from foucault.guard.rest import check_session, enough_rests
from foucault.logs.axes import spared
from foucault.models.earth import EARTH_RATE
from foucault.models.imu import EQUATION, FRAME, LAYOUT, LINEAR_LOWER, Gauge, ImuModel
from foucault.models.layouts import gravity_error, with_references
from foucault.models.rests_and_turns import Session as SessionData
from foucault.procedures import hand_rotated
from foucault.procedures.hand_rotated import NEEDED, complete
from foucault.procedures.record import Given, Procedure
from foucault.result import Result, Verdict
from foucault.strict import Strict
from foucault.tables import AXES, Log
from foucault.units import Seconds


class Settings(Strict):
    """The numbers of the recipe."""

    initial_rest: Seconds = Field(default=50.0, gt=0)
    """Rest at the start of the log, for bias and variance."""
    window: Seconds = Field(default=1.0, gt=0)
    """Window of the rest detector."""
    variance_factor: float = Field(default=6.0, gt=0)
    """Threshold of the detector over the initial variance."""
    samples_per_rest: int = Field(default=100, gt=0)
    """Samples used of each rest; shorter rests are left out."""


class Session(hand_rotated.Session):
    """The session that `simulate` makes: its first rest is as long as the recipe wants."""

    first_rest_time: Seconds = Field(default=60.0, gt=0)
    """Length of the first rest."""


def _solve(log: Log, given: Given[Settings]) -> Result:
    site, settings, progress = given.site, given.settings, given.progress
    if given.noise is not None or given.prior:
        # The recipe has no place for them.
        what = "[noise]" if given.noise is not None else "[prior]"
        raise error("published.unweighted", what=what)
    if log.accel is None:
        raise error("session.no_accel")
    if log.averaged is not None:
        raise error("session.means")
    progress(0.05, "finding the rests")
    rests = find_published_rests(
        log,
        initial_rest=settings.initial_rest,
        factor=settings.variance_factor,
        window=2 * round(settings.window * log.rate / 2) + 1,
        shortest=settings.samples_per_rest,
    )
    enough_rests(log, rests, NEEDED, settings.samples_per_rest * log.interval)
    data = SessionData.reduce(log, rests.first, rests.last, replace(site, latitude=None))
    still = [(log.time[rests.first], log.time[rests.last - 1] - log.time[rests.first])]
    findings = [*spared(log.findings, log, None, still), *check_session(data)]
    progress(0.5, "calibrating")
    result = _published(data, settings)
    model = ImuModel.from_coefficients(result.coefficients)
    seen = rest_table(log, rests) | norm_columns(model, result.coefficients, data)
    result = replace(result, tables={"rests": seen})
    return complete(result, data, rests, findings)


def _published(data: SessionData, settings: Settings) -> Result:
    log, gravity = data.log, data.site.gravity
    assert log.accel is not None
    solved = norm_observation.solve(data.accel_mean, gravity)
    assert solved is not None  # `guard.rest` has solved the same equations
    readings = np.concatenate([log.accel[a : a + settings.samples_per_rest] for a in data.first])
    start = ImuModel(accel_matrix=solved[0], accel_bias=solved[1])
    accel = published_hand_rotated.fit_norms(readings, gravity, start)
    vectors, status, costs = [accel.coefficients], accel.status, [accel.chi_square / 2]
    if log.gyro is not None:
        f_b, _ = accel.state.compensate(data.accel_mean, None)
        up_b = f_b / np.linalg.norm(f_b, axis=1)[:, None]
        end = int(np.searchsorted(log.time, log.time[0] + settings.initial_rest)) + 1
        model = replace(accel.state, gyro_bias=log.gyro[:end].mean(axis=0))
        gyro = published_hand_rotated.fit_directions(
            log, up_b, data.last[:-1] - 1, data.first[1:] - 1, model, runge_kutta=True
        )
        bias = _held_bias(log.gyro[:end])
        vectors += [bias, gyro.coefficients]
        costs.append(gyro.chi_square / 2)
        status = gyro.status if status is Status.CONVERGED else status
    checks = (status_check(status, ()), judge.rests(len(data.accel_mean)))
    found = _joined(vectors)
    error_of_g = gravity_error(found, data.site)
    return Result(
        procedure="hand_rotated_published",
        coefficients=with_references(found, data.site),
        equation=EQUATION,
        frame=FRAME,
        gauge=Gauge.LOWER.value,
        verdict=Verdict.of(checks),
        checks=checks,
        findings=(),
        status=status,
        diagnostics={"costs": costs} | of_site(data.site.as_dict(), found.names, error_of_g),
    )


def _held_bias(gyro: FloatArray) -> CoefficientVector:
    """Return what gyros (n, 3) read in the first rest [rad/s], as the recipe takes it.

    The Earth's rate is in it, from any direction: a third of its square for each axis.
    """
    layout = LAYOUT.subset(f"gyro.bias.{a}" for a in AXES)
    cov = np.diag(gyro.var(axis=0, ddof=1) / len(gyro) + EARTH_RATE**2 / 3)
    return CoefficientVector(layout, gyro.mean(axis=0), cov, free=np.zeros(3, bool))


def _joined(vectors: list[CoefficientVector]) -> CoefficientVector:
    """Put vectors with independent errors together, in the order of the model."""
    names = [n for v in vectors for n in v.names]
    values = np.concatenate([v.values for v in vectors])
    free = np.concatenate([v.free for v in vectors])
    cov = np.zeros((len(names), len(names)))
    at = 0
    for v in vectors:
        cov[at : at + len(v), at : at + len(v)] = v.cov
        at += len(v)
    order = np.array([names.index(n) for n in LAYOUT.names if n in names])
    layout = LAYOUT.subset(names[i] for i in order)
    return CoefficientVector(layout, values[order], cov[np.ix_(order, order)], free[order])


PROCEDURE = Procedure(
    name="hand_rotated_published",
    doc=__doc__,
    Settings=Settings,
    Session=Session,
    solve=_solve,
    plan=lambda _settings, session, _site: session.meant,
    simulation=hand_rotated.PROCEDURE.simulation,
    names=lambda *_: LINEAR_LOWER,
)
calibrate, simulate = PROCEDURE.calibrate, PROCEDURE.simulate
