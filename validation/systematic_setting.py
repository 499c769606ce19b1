"""The setting of the published simulation, shared by the scripts of systematic calibration.

The 19 positions with rests of 150 s, six spins of ten turns at 18 deg/s with rests of 200 s, 92
minutes; angle random walk 0.0007 deg/sqrt(h), velocity random walk 5 ug/sqrt(Hz); latitude
39.8 deg. `SPREAD` is what instruments are drawn from and what filters are told.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from foucault.coefficients import CoefficientVector
from foucault.estimate.systematic import AtRest, Start, SystematicModel, attitude_at_start
from foucault.models.deflection import DeflectionModel, deflection_model
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.ins_errors import Sensors
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.navigate.increments import Increments, increments_of
from foucault.navigate.ins_filter import FilterRun, start_cov
from foucault.plans.sequence import (
    CalibrationSequence,
    action_sequences,
    nineteen_positions,
)
from foucault.procedures.systematic.settings import NAMES as INSTRUMENT
from foucault.simulate.systematic import SystematicSimulation

FloatArray = npt.NDArray[np.float64]

RATE = 50.0
DEG, G = np.pi / 180, 9.80665
ARCSEC, UG = DEG / 3600, 1e-6 * G
BEND = ARCSEC / G
SITE = Site.at(39.8 * DEG)
NOISE = ImuNoise(TriadNoise(white=5 * UG), TriadNoise(white=0.0007 * DEG / 60))
PHI_SD = np.array([60, 60, 600]) * ARCSEC
SPREAD = {
    "gyro.bias": 0.02 * ARCSEC, "gyro.scale": 1e-4, "gyro.misalignment": 100 * ARCSEC,
    "deflection": 3 * BEND, "accel.bias": 200 * UG, "accel.scale": 2e-4,
    "accel.asymmetry": 1e-4, "accel.misalignment": 100 * ARCSEC,
    "accel.quadratic": 50 * UG / G**2, "accel.lever": 0.05,
}  # fmt: skip
MODEL = deflection_model("coupled6")
PLAIN = Sensors.of(INSTRUMENT)
FULL = PLAIN.with_deflection(MODEL)
UNITS = {
    "gyro.bias": (ARCSEC, "deg/h"), "gyro.scale": (1e-6, "ppm"),
    "gyro.misalignment": (ARCSEC, "arcsec"), "deflection": (BEND, "arcsec/g"),
    "accel.bias": (UG, "ug"), "accel.scale": (1e-6, "ppm"), "accel.asymmetry": (1e-6, "ppm"),
    "accel.misalignment": (ARCSEC, "arcsec"), "accel.quadratic": (UG / G**2, "ug/g^2"),
    "accel.lever": (1e-3, "mm"), "accel.delay": (1e-3, "ms"),
}  # fmt: skip
"""Group of coefficients -> its unit."""


def group_of(name: str) -> str:
    """Return the group of `UNITS` that a coefficient belongs to."""
    return next(group for group in UNITS if name.startswith(group))


def groups(sensors: Sensors) -> dict[str, npt.NDArray[np.int64]]:
    """Return the coefficients of each group that is there."""
    names = sensors.layout.names
    out = {g: np.flatnonzero([n.startswith(g) for n in names]) for g in UNITS}
    return {g: at for g, at in out.items() if len(at)}


def spread_of(sensors: Sensors) -> FloatArray:
    """Return the sds of all coefficients."""
    return np.array([SPREAD[group_of(name)] for name in sensors.layout.names])


def instrument(
    sensors: Sensors, truth: FloatArray, deflection: DeflectionModel = MODEL
) -> ImuModel:
    """Return the instrument with these coefficients; lever arms are the simulator's."""
    names = sensors.layout.names
    known = [i for i, name in enumerate(names) if name in LAYOUT.names]
    bent = [i for i, name in enumerate(names) if name.startswith("deflection")]
    layout = LAYOUT.subset([names[i] for i in known])
    values = dict(zip([names[i] for i in known], truth[known], strict=True))
    model = ImuModel.from_coefficients(
        CoefficientVector(layout, np.array([values[name] for name in layout.names]))
    )
    return replace(model, deflection=deflection.tensor(truth[bent])) if bent else model


def both_steps(
    angles: str | FloatArray = "simple 6", *, positions_rest: float = 150.0, **spins: float
) -> tuple[CalibrationSequence, int]:
    """Return the 19 positions and the spins, and how many rests the first part has."""
    first = nineteen_positions(rest=positions_rest)
    return first.then(action_sequences(angles, **spins)), len(first.positions)


@dataclass(frozen=True)
class Session:
    """A simulated session as the filters take it."""

    made: SystematicSimulation

    @cached_property
    def increments(self) -> Increments:
        return increments_of(self.made.log)

    @cached_property
    def rests(self) -> list[tuple[int, int]]:
        rate = round(1 / self.made.log.interval)
        done = self.made.sequence.positions
        return [(round(p.start * rate), round(p.end * rate)) for p in done]

    @property
    def start(self) -> FloatArray:
        """True C_nb at the start."""
        return self.made.attitude(np.zeros(1))[0]

    def solve(
        self,
        sensors: Sensors,
        *,
        C_nb: FloatArray | None = None,
        at_rest: AtRest | None = None,
        rests: Sequence[tuple[int, int]] | None = None,
        passes: int = 1,
        noise: ImuNoise = NOISE,
    ) -> FilterRun:
        """Run the joint filter with the priors of the setting, each pass from what one has found.

        A later pass keeps them: the same prior, about another point of linearisation.
        """
        sd = spread_of(sensors)
        C, values = self.start if C_nb is None else C_nb, np.zeros(len(sd))
        cov = start_cov(np.diag(PHI_SD**2), 0.01, 0.01, sd)[:9, :9]
        model = self.model(sensors, at_rest=at_rest, rests=rests, noise=noise)
        for k in range(passes):
            found = model.filtered([Start(0, C, cov)], values, sd, keep=k + 1 < passes)
            values = found.estimate.values
            C = attitude_at_start(found, C) if k + 1 < passes else C
        return found

    def model(
        self,
        sensors: Sensors,
        *,
        at_rest: AtRest | None = None,
        rests: Sequence[tuple[int, int]] | None = None,
        noise: ImuNoise = NOISE,
    ) -> SystematicModel:
        """Return what a pass takes."""
        rests = self.rests if rests is None else rests
        return SystematicModel(self.increments, SITE, sensors, rests, noise, at_rest or AtRest())
