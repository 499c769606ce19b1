"""Make sessions for the tests: one short plan, seen by instruments with any errors."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from foucault.coefficients import CoefficientVector
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.noise import ImuNoise
from foucault.models.rests_and_turns import Attitudes, Session
from foucault.plans.directions import RestPlan, hand_plan
from foucault.simulate.hand_rotated import Simulation, simulate
from foucault.tables import Log

SITE = Site.at(np.radians(48.8462), 60.0)
BLIND = Site(SITE.gravity)
QUIET = ImuNoise()


def model_of(values: dict[str, float]) -> ImuModel:
    """An instrument with the named errors [SI]."""
    return ImuModel.from_coefficients(CoefficientVector.zeros(LAYOUT).with_values(values))


def short_plan(rests: int = 14, seed: int = 5) -> RestPlan:
    """Rests of 2 s and turns of 1.5 s, all starting and ending on a multiple of 50 ms."""
    plan = hand_plan(rests, 2.0, 1.5, 3.0, seed)
    return replace(
        plan,
        rest_time=np.round(plan.rest_time * 20) / 20,
        turn_time=np.round(plan.turn_time * 20) / 20,
    )


def plan_with(up_b: np.ndarray, seed: int = 5) -> RestPlan:
    """Rests with the given directions of up, shape (n, 3)."""
    from foucault.models.rotation import aligning, exp

    plan = short_plan(len(up_b), seed)
    z = np.array([0.0, 0.0, 1.0])
    heading = np.random.default_rng(seed).uniform(-3, 3, len(up_b))
    C_nb = [exp(h * z) @ aligning(u, z) for h, u in zip(heading, up_b, strict=True)]
    return replace(plan, C_nb=np.array(C_nb))


@cache
def quiet_session(
    rate: float = 400.0, sampled: str = "rate", site: Site = SITE, rests: int = 14
) -> Simulation:
    """A session of a perfect instrument: its log is the truth."""
    return simulate(
        short_plan(rests), model=ImuModel(), noise=QUIET, site=site, rate=rate, sampled=sampled
    )


def seen_by(model: ImuModel, simulation: Simulation) -> Log:
    """The log of a perfect instrument as `model` would have written it."""
    accel, gyro = model.measure(simulation.log.accel, simulation.log.gyro)
    return replace(simulation.log, accel=accel, gyro=gyro)


def reduced(simulation: Simulation, log: Log, site: Site) -> tuple[Session, Attitudes]:
    """The session with its true rests, and the true state."""
    return (
        Session.reduce(log, simulation.first, simulation.last, site),
        Attitudes(simulation.model, simulation.C_nb),
    )
