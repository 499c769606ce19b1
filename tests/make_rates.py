"""Readings on a rate table, made from a model without any simulator."""

from __future__ import annotations

import numpy as np

from foucault.models.earth import EARTH_RATE
from foucault.models.imu import ImuModel
from foucault.models.noise import Readings
from foucault.models.rests_and_turns import Steps

LATITUDE = np.radians(48.0)
VERTICAL = EARTH_RATE * np.sin(LATITUDE)
SPEEDS = np.radians([10.0, -10.0, 40.0, -40.0, 100.0, -100.0])
ALL = ("x up", "x down", "y up", "y down", "z up", "z down")


def up_of(name: str) -> np.ndarray:
    return (1.0 if name.endswith("up") else -1.0) * np.eye(3)["xyz".index(name[0])]


def make_steps(model=None, axes=ALL, rates=SPEEDS, sd=1e-7, turns=5.0, vertical=VERTICAL, g=9.81):
    """What a perfect table shows, one entry per placement and rate."""
    model = model or ImuModel()
    up = np.repeat([up_of(a) for a in axes], len(rates), axis=0)
    rate = np.tile(rates, len(axes))
    with np.errstate(divide="ignore"):
        time = np.where(rate != 0, turns * 2 * np.pi / np.abs(rate), 60.0)
    gyro = model.measure(g * up, (rate + vertical)[:, None] * up)[1]
    cov = np.broadcast_to(sd**2 * np.eye(3), (len(rate), 3, 3)).copy()
    return Steps(up, np.repeat(np.arange(len(axes)), len(rates)), rate, time, gyro, cov, g * up)


def make_readings(steps: Steps, accel=True, rate=None) -> Readings:
    n = len(steps)
    return Readings(
        np.full((n, 3), np.nan), steps.rate if rate is None else rate, np.round(steps.turns),
        np.concatenate([[0.0], np.cumsum(steps.time + 5.0)[:-1]]), steps.time,
        steps.force.copy() if accel else None, steps.gyro.copy(), steps.cov, steps.cov,
        declared=True,
    )  # fmt: skip
