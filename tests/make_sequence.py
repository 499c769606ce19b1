"""Simulated sessions of systematic calibration, and the third-party one as it is described."""

from __future__ import annotations

import numpy as np

from foucault.models.earth import Site
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.plans.sequence import CalibrationSequence
from foucault.simulate.systematic import SystematicSimulation, simulate_systematic
from foucault.tables import Log
from foucault.units import parse
from make_alignment import real

DEG = np.pi / 180
ARCSEC = DEG / 3600
DPH = DEG / 3600
SITE = Site.at(34 * DEG, 380.0)

NOISE = ImuNoise(
    TriadNoise(white=parse("5 ug/sqrt(Hz)", "velocity random walk")),
    TriadNoise(white=parse("0.0007 deg/sqrt(h)", "angle random walk")),
)
"""Navigation grade, as in the published simulations."""

THIRD_PARTY = {
    "file": "imusysclbt.bin",
    "record": {"type": "float32", "columns": 7},
    "rate": "100 Hz",  # the seventh column is time, in steps that float32 rounds
    "gyro": {"columns": [0, 1, 2], "unit": "rad", "kind": "increment"},
    "accel": {"columns": [3, 4, 5], "unit": "m/s", "kind": "increment"},
}
"""How to read the nineteen positions that another program simulated."""


def third_party() -> Log:
    """Read the nineteen positions of another program; skip where they are missing."""
    return real("systematic_19_positions", THIRD_PARTY)


def simulated(sequence: CalibrationSequence, rate: float = 50.0, **more) -> SystematicSimulation:
    """Simulate `sequence` at 50 Hz with the noise of a navigation-grade instrument."""
    return simulate_systematic(sequence, **{"site": SITE, "noise": NOISE, "rate": rate} | more)
