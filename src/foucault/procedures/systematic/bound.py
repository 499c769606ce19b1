"""How well a systematic calibration can be done: by the session as planned, and at best.

A covariance depends on motion, noise and prior, not on readings. What a planned session will show
is what the procedure states of a simulated one without noise, of an instrument that is as [prior]
expects. What could be shown at best is what the noise of the sensors alone leaves: velocity at
rest known for sure, turns counted in full, and nothing known beforehand.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.information import Information
from foucault.diagnose.systematic.recordings import lasting
from foucault.models import imu
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise
from foucault.navigate.increments import increments_of
from foucault.plans.manoeuvres import Rotate
from foucault.plans.systematic.file import ActionTable
from foucault.plans.systematic.sequence import CalibrationSequence
from foucault.plans.systematic.steps import plain_action, plain_start
from foucault.procedures.systematic.problem import (
    SystematicProblem,
    prior_of,
    problem_of,
    require_place,
    steady,
)
from foucault.procedures.systematic.settings import Settings
from foucault.procedures.systematic.solution import Solution, public, solved
from foucault.simulate.systematic import simulate_systematic

Prior = Mapping[str, tuple[float, float]]

SURE = 1e-2
"""At best the velocity at rest is as sure as this part of what the noise adds to it from one update
to the next [1]."""

BLIND = 1e3
"""A coefficient that is left less certain than so many times its prior is not seen [1]."""

WIDER, FIRM = 10.0, 1.1
"""Nor is one whose bound grows by more than `FIRM` where the prior is `WIDER` times less certain:
it hangs on what the session does not show. Rounding adds far less, what is shared far more [1]."""


@dataclass(frozen=True)
class Foreseen:
    """A planned session, calibrated beforehand."""

    problem: SystematicProblem  # what will be solved
    # what will be found, with covariance: of an instrument as expected, without noise
    solution: Solution

    @property
    def states(self) -> CoefficientVector:
        """The states that are coefficients, with covariance and prior [SI]."""
        return self.solution.states


def foreseen(
    sequence: CalibrationSequence, settings: Settings, *, rate: float, site: Site,
    noise: ImuNoise, prior: Prior, instrument: ImuModel | None = None,
) -> Foreseen:  # fmt: skip
    """Simulate a sequence, find its rests, and calibrate it without noise.

    `rate`: sample rate [Hz]; `noise`: noise to reckon with [SI]; `prior`: mean and standard
    deviation of coefficients or groups of coefficients [SI]; `instrument`: the instrument, None
    takes the means of `prior`.
    """
    require_place(site, "the plan of a systematic calibration")
    expected = instrument_of(settings, prior)
    known_as: dict[str, Any] = {
        "site": site, "rate": rate, "model": instrument or expected,
    }  # fmt: skip
    quiet = simulate_systematic(sequence, **known_as)
    noisy = simulate_systematic(sequence, noise=noise, **known_as)  # where rests are found in
    known = dict(prior)
    if instrument is not None:  # the covariance about it, not the way to it
        vector = instrument.coefficients()
        kept = prior_of(settings.sensors, prior)
        known |= {
            n: (vector.value(n), float(sd))
            for n, sd in zip(kept.names, kept.prior_sd, strict=True) if n in vector.layout
        }  # fmt: skip
    once = settings.model_copy(update={"passes": 1} | _unlike(settings.plan, sequence))
    problem = problem_of(noisy.log, site, once, noise, known)
    start = replace(problem.start, C_nb=_begun(problem, sequence))
    begun = replace(problem, start=start, increments=increments_of(quiet.log))
    return Foreseen(begun, solved(begun, once))


def _unlike(plan: CalibrationSequence | None, done: CalibrationSequence) -> dict[str, Any]:
    """Return settings that name what is done, where it is not what is planned."""
    turns = [
        [a for a in one.actions if isinstance(a, Rotate)] for one in (plan, done) if one is not None
    ]
    if turns[0] == turns[-1]:
        return {}
    actions = tuple(ActionTable.model_validate(plain_action(a)) for a in done.actions)
    return {"sequence": (), "start": plain_start(done), "actions": actions}


def _begun(problem: SystematicProblem, sequence: CalibrationSequence) -> FloatArray:
    return np.asarray(sequence.at(problem.increments.time[[problem.first]])[0][0])


def instrument_of(settings: Settings, prior: Prior) -> ImuModel:
    """Return the instrument that a prior expects: without errors but for the means in it.

    `prior`: mean and standard deviation of coefficients or groups of coefficients [SI].
    """
    given = CoefficientVector.prior(settings.sensors.layout, dict(prior))
    if settings.model is not None:
        given = settings.model.general(given)
    return ImuModel.from_coefficients(given.chosen(n for n in given.names if n in imu.LAYOUT))


# -- at best -------------------------------------------------------------------------------------


def bound(problem: SystematicProblem, solution: Solution, settings: Settings) -> dict[str, Any]:
    """Return the Cramer-Rao bound of the sensor noise alone [SI], for result.json.

    It is None where nothing is seen. Without noise it would be zero, and the filter that finds it
    singular: there is none.

    `solution`: what was found: the bound is that about it.
    """
    p = steady(problem)
    if not (p.noise.accel.white > 0 and p.noise.gyro.white > 0):
        return {}
    known = SURE * p.noise.accel.white * np.sqrt(p.at_rest.interval)
    sure = replace(p.at_rest, velocity_sd=known, decorrelate=False)
    begun = [(run.trajectory.C_nb[0], p.phi_sd) for run in solution.run.recordings()]
    if settings.steps == "published":
        begun[0] = p.begun[0]
    found = replace(p.model, at_rest=sure).filtered(
        p.starts(begun), solution.states.values, p.prior.prior_sd
    )
    told = lasting(replace(found.estimate, prior_sd=p.prior.prior_sd))
    near, far = (
        public(replace(solution, states=_hardly_known(told, wide)), settings)
        for wide in (BLIND, WIDER * BLIND)
    )
    seen = (far.sd < FIRM * near.sd) & (near.sd < BLIND * near.prior_sd)
    return {"bound": [float(v) if s else None for v, s in zip(far.sd, seen, strict=True)]}


def _hardly_known(states: CoefficientVector, wide: float) -> CoefficientVector:
    """Return what a session tells where the prior is `wide` times less certain."""
    values, vectors, unit = _told(states)
    half = vectors / np.sqrt(values + wide**-2.0) * unit[:, None]
    return replace(states, cov=half @ half.T)


def without_prior(states: CoefficientVector) -> Information:
    """Return what a session alone tells of its states, whatever was known of them.

    `states`: with covariance, and prior standard deviations that were not correlated [SI].
    """
    values, vectors, unit = _told(states)
    return Information(states.layout, (vectors * np.sqrt(values)).T / unit)


def _told(states: CoefficientVector) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the information of a session alone, its directions, and the unit of both: the prior.

    From the covariance itself: where nothing is told that is the prior's, exactly, whereas the
    rounding of its inverse is that of what is known best.
    """
    unit = states.prior_sd
    assert states.cov is not None
    left, vectors = np.linalg.eigh(states.cov / np.outer(unit, unit))
    left = np.clip(left, np.finfo(float).eps * left[-1], 1.0)
    return (1.0 - left) / left, vectors, unit
