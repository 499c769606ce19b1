"""Means of many instruments on one table, as one file of a test bench holds them."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.models.imu import LINEAR_LOWER, Gauge
from foucault.simulate.table.readings import SimulatedReadings

PAUSE = 8.0
"""Time from the end of a mean to the beginning of the next [s]."""


def serial_numbers(instruments: int) -> list[str]:
    """Return serial numbers SN001 and so on of `instruments`, shape () [1]."""
    digits = max(3, len(str(instruments)))
    return [f"SN{k + 1:0{digits}d}" for k in range(instruments)]


def table_of_means(made: SimulatedReadings) -> dict[str, npt.NDArray[Any]]:
    """Return the means as columns with a row per instrument and position [SI].

    `made`: means of N instruments in n positions [SI].
    """
    plan, N, n = made.plan, len(made), len(made.plan)
    start = np.concatenate([[0.0], np.cumsum(plan.time + PAUSE)[:-1]])
    out: dict[str, npt.NDArray[Any]] = {
        "serial": np.repeat(np.array(serial_numbers(N)), n),
        "time": np.tile(start, N),
        "averaged": np.tile(plan.time, N),
    }
    for name, block in (("gyro", made.gyro), ("accel", made.accel)):
        out |= {f"{name}_{a}": block[:, :, i].ravel() for i, a in enumerate("xyz")}
    out |= {a: np.tile(plan.angles[:, i], N) for i, a in enumerate(("outer", "middle", "inner"))}
    return out | {
        "table_rate": np.tile(plan.rate, N),
        "position": np.tile(np.arange(n), N),
    }


def truth_of(made: SimulatedReadings) -> dict[str, npt.NDArray[Any]]:
    """Return the true coefficients of each instrument as columns [SI]."""
    fleet = made.fleet
    models = [fleet.model(i).in_gauge(Gauge.LOWER)[0] for i in range(len(fleet))]
    vectors = [m.coefficients(LINEAR_LOWER) for m in models]
    values = np.array([v.values for v in vectors]).reshape(len(models), len(LINEAR_LOWER))
    out: dict[str, npt.NDArray[Any]] = {"serial": np.array(serial_numbers(len(models)))}
    return out | {name: values[:, k] for k, name in enumerate(LINEAR_LOWER)}
