"""Short flights with a master and a slave, and a table of the master's messages."""

from __future__ import annotations

import numpy as np

from foucault.models.earth import displaced
from foucault.models.rotation import matrix_of
from foucault.models.transfer import MasterTable
from foucault.plans.manoeuvres import Accelerate, Climb, Start, Straight, STurn, Turn
from foucault.plans.transfer import TransferProfile
from foucault.simulate.transfer import MasterNoise

DEG = np.pi / 180
ARCMIN = DEG / 60
START = Start(45 * DEG, 9 * DEG, 800.0, heading=20 * DEG, speed=45.0)

SHORT = TransferProfile(
    "short",
    START,
    (Accelerate(50.0, 6.0), STurn(50 * DEG, 20.0), Climb(8.0, height=20.0), Straight(6.0)),
    (Turn(-80 * DEG, 12.0), Straight(8.0)),
)
"""A flight of 60 s whose master falls silent after 40 s."""

QUIET = MasterNoise(velocity=0.0, attitude=(0.0, 0.0, 0.0), position=0.0)
"""A master without errors."""


def circling(n: int = 600, rate: float = 10.0, speed: float = 50.0) -> MasterTable:
    """Return messages of a level turn at 6 deg/s, flat Earth between neighbours."""
    t = np.arange(n) / rate
    turn = 6 * DEG
    H = 30 * DEG + turn * t
    v = speed * np.column_stack([np.sin(H), np.cos(H), 0 * t])
    radius = speed / turn
    away = radius * np.column_stack([np.cos(H[0]) - np.cos(H), np.sin(H) - np.sin(H[0]), 0 * t])
    place = displaced(START.latitude, START.longitude, START.height, away)
    return MasterTable(t, v, matrix_of(H, 0.02 + 0 * t, 0.4 + 0 * t), None, *place)
