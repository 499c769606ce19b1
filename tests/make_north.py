"""Readings of a simulated north seeker, as a file that `foucault north` takes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from foucault.logs import indexed_own
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.simulate.north import (
    NorthPlan,
    Placement,
    SeekerErrors,
    Stops,
    simulate_north,
)
from foucault.units import parse

LATITUDE = np.radians(47.3)
GYRO_WHITE = parse("0.003 deg/sqrt(h)", "angle random walk")
ACCEL_WHITE = parse("30 ug/sqrt(Hz)", "velocity random walk")
NOISE = ImuNoise(TriadNoise(white=ACCEL_WHITE), TriadNoise(white=GYRO_WHITE))
PALINDROME = (0.0, 180.0, 90.0, 270.0, 270.0, 90.0, 180.0, 0.0)
ARGUMENTS = (
    "--latitude", "47.3 deg", "--gyro-noise", "0.003 deg/sqrt(h)",
    "--accel-noise", "30 ug/sqrt(Hz)",
)  # fmt: skip

ONE = (Placement("Mark 7", np.radians(123.456), np.radians(2.0), np.radians(-1.0)),)


def many(count=12, tilt=3.0):
    """Set-ups all around, tilted by up to `tilt` [deg]."""
    rng = np.random.default_rng(5)
    return tuple(
        Placement(f"M{i + 1}", 2 * np.pi * i / count, *np.radians(tilt * rng.uniform(-1, 1, 2)))
        for i in range(count)
    )


def write_readings(
    path: Path, setups=ONE, stops=PALINDROME, dwell=90.0, seed=3, latitude=LATITUDE, **words
):
    """Simulate `setups` and write their readings; returns the simulation."""
    motion = Stops(np.radians(stops), np.full(len(stops), dwell), 5.0)
    words = {
        "model": ImuModel(), "noise": NOISE, "reference": False,
        "errors": SeekerErrors(gyro_offset=2e-6),
    } | words  # fmt: skip
    made = simulate_north(
        NorthPlan(tuple(setups), motion), site=Site.at(latitude), seed=seed, **words
    )
    indexed_own.write(made.log, path)
    return made
