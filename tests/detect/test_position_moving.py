"""Rests that were not quite rests, of an instrument that is partly dead."""

from __future__ import annotations

import warnings
from types import SimpleNamespace

import numpy as np

from foucault.detect.readings import moving
from foucault.models.noise import Readings


def test_dead_accelerometers_move_nowhere_and_warn_of_nothing():
    n = 6
    gyro = 1e-5 * np.random.default_rng(1).normal(size=(n, 3))
    gyro[4, 2] += 1e-3
    cov = np.broadcast_to(1e-10 * np.eye(3), (n, 3, 3))
    readings = Readings(
        np.full((n, 3), np.nan), np.zeros(n), np.zeros(n), 20.0 * np.arange(n), np.full(n, 15.0),
        np.zeros((n, 3)), gyro, cov, cov,
    )  # fmt: skip
    cells = SimpleNamespace(
        first=np.zeros(n),
        start=readings.start,
        label=np.arange(n),
        last=readings.start + 15.0,
        accel_var=np.zeros((n, 3)),
    )
    change = {"accel": np.zeros((n, 3)), "gyro": np.zeros((n, 3))}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        data = SimpleNamespace(cells=cells, steps=lambda name: np.zeros(3))
        told = moving(readings, change, data)
    assert [f.code for f in told] == ["position.not_still"]
    assert "turns at" in told[0].message
