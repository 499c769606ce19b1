"""What the error-state filter refuses, and says why."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.models.ins_errors import Sensors
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.navigate.ins_filter import Updates, run
from make_ins import at_rest, still
from refusals import refuses

NOISE = ImuNoise(accel=TriadNoise(white=5e-5), gyro=TriadNoise(white=1e-6))
NONE = Sensors.of(())


def _falling(u):
    return replace(u, rows=u.rows[::-1].copy())


def _nan(u):
    v = u.velocity_n.copy()
    v[2, 1] = np.nan
    return replace(u, velocity_n=v)


def _sd_nan(u):
    sd = u.sd.copy()
    sd[1, 4] = np.nan
    return replace(u, sd=sd)


BAD = {
    "rows do not rise": _falling,
    "does not fit them": lambda u: replace(u, sd=u.sd[:-1]),
    "there are 0 rows": lambda u: Updates.none(u.rows[:0]),
    "is not a number": _nan,
    "standard deviation, is not a number": _sd_nan,
}


@pytest.mark.parametrize("what", BAD)
def test_measurements_that_cannot_be_are_refused(what):
    log, state = at_rest(10)
    updates = BAD[what](still(np.arange(20, 200, 20), 1e-3, 0.01))
    with refuses("strapdown.measurements", match=what):
        run(log, state, NONE, updates, np.eye(9), NOISE)


def test_a_start_that_cannot_be_is_refused():
    log, state = at_rest(10)
    updates = still(np.arange(20, 200, 20), 1e-3, 0.01)
    for P0, what in (
        (np.eye(10), "has shape"), (np.diag([np.inf] * 9), "not finite"), (-np.eye(9), "negative")
    ):  # fmt: skip
        with pytest.raises(FoucaultError, match=what):
            run(log, state, NONE, updates, P0, NOISE)
    with pytest.raises(FoucaultError, match="do not rise from row 30"):
        run(log, state, NONE, updates, np.eye(9), NOISE, first=30)
    beyond = Updates.none(np.array([10, len(log)]))
    with refuses("strapdown.rows", match=f"Row {len(log)}"):
        run(log, state, NONE, beyond, np.eye(9), NOISE)
    with pytest.raises(FoucaultError, match=r"correlation time of gyro\.bias is 0"):
        run(log, state, Sensors.of(("gyro.bias",)), updates, np.eye(12), NOISE,
            correlation_time={"gyro.bias": 0.0})  # fmt: skip
    with pytest.raises(FoucaultError, match=r"gyro\.bias"):
        Sensors.of(("gyro.bais",))
    with pytest.raises(FoucaultError, match=r"accel\.bias"):
        run(log, state, Sensors.of(("gyro.bias",)), updates, np.eye(12), NOISE,
            wander={"accel.bias": 1e-6})  # fmt: skip
    log.dvel_b[50] = np.nan
    with refuses("strapdown.not_finite"):
        run(log, state, NONE, updates, np.eye(9), NOISE)
