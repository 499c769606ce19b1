"""Readings of a north seeker without noise, by rotations one after the other."""

from __future__ import annotations

import numpy as np

from foucault.coefficients import CoefficientVector
from foucault.models.earth import Site, earth_rate_n
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.north_seeker import SEEKER, Compensation, Dwells
from foucault.simulate.north import Placement
from foucault.tables import IndexedLog

DEG_H = np.radians(1.0 / 3600.0)
FOUR = (0.0, 180.0, 90.0, 270.0)
SIX = (0.0, 60.0, 120.0, 180.0, 240.0, 300.0)
PALINDROME = (*FOUR, *FOUR[::-1])
QUIET = ImuNoise(TriadNoise(white=1e-7), TriadNoise(white=1e-10))
"""So little that what comes out is exact, to rounding."""
FIELD = ImuNoise(TriadNoise(white=3e-4), TriadNoise(white=0.003 / 60 * np.pi / 180))
"""30 ug/sqrt(Hz), 0.003 deg/sqrt(h)."""
SIZE = {"gyro.bias": 1e-7, "gyro.scale": 2e-3, "gyro.misalignment": 2e-3, "accel.bias": 1e-3,
        "accel.scale": 3e-4, "accel.misalignment": 3e-4}  # fmt: skip
"""Errors of an instrument [SI]."""


def size(name):
    return SIZE[name.rpartition(".")[0]]


def errors(names=SEEKER.names, seed=1, cov=False):
    """An instrument with errors; known as well as they are large, or exactly."""
    rng = np.random.default_rng(seed)
    sizes = np.array([size(n) for n in names])
    values = sizes * rng.standard_normal(len(names))
    spread = np.diag((0.1 * sizes) ** 2) if cov else None
    return Compensation(CoefficientVector(SEEKER.subset(names), values, spread))


def four_numbers(attitudes, latitude, instrument=None):
    """Rates and specific forces that the base resolves, shape (m, 4) [SI]."""
    g = Site.at(latitude).gravity
    C = np.array([Placement("", *a).attitude.T for a in np.atleast_2d(attitudes)])
    model = (instrument or Compensation()).model
    rate = (C @ earth_rate_n(latitude)) @ model.gyro_matrix.T + model.gyro_bias
    force = (C @ [0.0, 0.0, g]) @ model.accel_matrix.T + model.accel_bias
    return np.hstack([rate[:, :2], force[:, :2]])


def make_dwells(
    attitudes, latitude, *, stops=FOUR, dwell=60.0, move=5.0, instrument=None, accel="base",
    offset=0.0, drift=0.0, accel_offset=0.0, noise=None, seed=0, headings=None,
):  # fmt: skip
    """Set-ups with the same stops. `noise`: white noise to add, of the means."""
    four = four_numbers(attitudes, latitude, instrument)
    m, k = len(four), len(stops)
    index = np.tile(np.radians(stops), m)
    setup = np.repeat(np.arange(m), k)
    inside = np.tile(np.arange(k) * (dwell + move), m)
    start = inside + setup * (k * (dwell + move) + 30.0)
    s, c = np.sin(index), np.cos(index)
    gyro = four[setup, 1] * c + four[setup, 0] * s + offset + drift * (inside + dwell / 2)
    along = four[setup, 3] * c + four[setup, 2] * s + accel_offset
    force = {"base": along[:, None], "case": four[setup, 2:], None: None}[accel]
    if noise is not None:
        rng = np.random.default_rng(seed)
        gyro = gyro + noise.gyro.white / np.sqrt(dwell) * rng.standard_normal(m * k)
        if force is not None:
            force = force + noise.accel.white / np.sqrt(dwell) * rng.standard_normal(force.shape)
    known = np.full(m, np.nan) if headings is None else np.asarray(headings, float)
    names = tuple(f"S{i + 1}" for i in range(m))
    time = np.full(m * k, dwell)
    return Dwells(setup, names, start, time, index % (2 * np.pi), c, s, gyro, force, known)


def make_log(dwells):
    """The same as the log of means that a user would give."""
    heading = dwells.heading[dwells.setup]
    return IndexedLog(
        dwells.start, dwells.index, dwells.gyro, dwells.accel, dwells.setup, dwells.names,
        None if np.isnan(heading).all() else heading, averaged=dwells.time,
    )  # fmt: skip


def attitudes(m, tilt=10.0, seed=0):
    """Headings all around, tilted by up to `tilt` [deg] about both axes."""
    rng = np.random.default_rng(seed)
    heading = 2 * np.pi * (np.arange(m) + 0.3) / m
    return np.column_stack([heading, np.radians(tilt) * rng.uniform(-1, 1, (m, 2))])


def level(m=12):
    """Headings all around, level."""
    return np.column_stack([2 * np.pi * np.arange(m) / m, np.zeros((m, 2))])


def leaning(*pitches):
    """The same at each of these pitches [deg]."""
    heading = level()[:, 0]
    return np.vstack([
        np.column_stack([heading, np.full(12, np.radians(p)), np.zeros(12)]) for p in pitches
    ])  # fmt: skip


def turn(a, b):
    """Angle a minus angle b, between -pi and pi."""
    return (np.asarray(a) - b + np.pi) % (2 * np.pi) - np.pi
