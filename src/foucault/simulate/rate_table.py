"""Simulate an instrument on a rate table: several constant rates about each of its axes.

In each placement one axis is along the vertical spin axis; between placements the instrument is
taken off and mounted anew, a little out of square. What happens in one placement is what
`simulate.table` simulates on a table whose other two axes stand still.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise, TriadNoise, mean_variance, wander
from foucault.models.turntable import TablePlan
from foucault.simulate.noise import draw_noise, quantise
from foucault.simulate.table import Rig, simulate, simulate_readings
from foucault.tables import Log, TableColumns

_QUARTER = np.pi / 2

PAUSE = 10.0
"""Between one mean and the next [s]."""

ANGLES = {
    "x up": (0.0, -_QUARTER),
    "x down": (0.0, _QUARTER),
    "y up": (_QUARTER, 0.0),
    "y down": (-_QUARTER, 0.0),
    "z up": (0.0, 0.0),
    "z down": (0.0, np.pi),
}
"""Middle and inner angle that stand for each placement [rad]."""


@dataclass(frozen=True)
class RatePlan:
    """What is done on the table."""

    axes: tuple[str, ...]  # placements in order, keys of `ANGLES`
    # (k,) rates in each placement, counter-clockwise seen from above; 0 for a rest [rad/s]
    rates: FloatArray
    least: float  # each step takes whole turns that last at least so long [s]
    rest: float | None = None  # length of the rests; None: as long as `least` [s]

    def with_rests(self, time: float) -> RatePlan:
        """Return the plan with a rest of `time` [s] before each rate and after the last."""
        rates = np.zeros(2 * len(self.rates) + 1)
        rates[1::2] = self.rates
        return replace(self, rates=rates, rest=time)

    @property
    def time(self) -> FloatArray:
        """How long each rate is held, shape (k,) [s]."""
        speed = np.abs(self.rates)
        rest = self.least if self.rest is None else self.rest
        turn = 2 * np.pi / np.where(speed > 0, speed, np.inf)
        turns = np.maximum(np.ceil(self.least * speed / (2 * np.pi) - 1e-9), 1.0)
        return np.where(speed > 0, turns * np.where(speed > 0, turn, 0.0), rest)

    def placement(self, name: str) -> TablePlan:
        """Return what the table does with the instrument placed as `name` says."""
        angles = np.tile([0.0, *ANGLES[name]], (len(self.rates), 1))
        return TablePlan(name, angles, self.rates, self.time)


@dataclass(frozen=True)
class TableErrors:
    """What is wrong with table and fixture."""

    rate_error: float = 0.0  # relative error of all rates, true over said minus 1 [1]
    rate_jitter: float = 0.0  # sd of another relative error of each step [1]
    # sd of the rotation of the instrument in each placement, about each axis [rad]
    fixture_sd: float = 0.0


@dataclass(frozen=True)
class RateTableSimulation:
    """A simulated session on a rate table."""

    log: Log  # what the instrument and the table said [SI]
    model: ImuModel  # the errors the instrument had: the truth
    plan: RatePlan
    errors: TableErrors  # what was wrong with the table
    mounting: FloatArray  # (p, 3) rotation of the instrument in each placement [rad]

    def truth_json(self) -> dict[str, Any]:
        """Return the truth beside the coefficients."""
        return {
            "placements": list(self.plan.axes),
            "rates": self.plan.rates.tolist(),
            "time": self.plan.time.tolist(),
            "mounting": self.mounting.tolist(),
            "rate_error": self.errors.rate_error,
        }


def simulate_rate_table(
    plan: RatePlan,
    *,
    model: ImuModel,
    noise: ImuNoise,
    site: Site,
    errors: TableErrors | None = None,
    rate: float = 20.0,
    means: bool = False,
    seed: int = 0,
) -> RateTableSimulation:
    """Simulate a session.

    `noise`: its noise [SI]; `site`: gravity, and latitude if the Earth's rotation is to be felt;
    `errors` or None: what is wrong with table and fixture; `rate`: sample rate [Hz]; `means`:
    whether the log holds one mean per step instead of samples; `seed`: seed of noise, mounting
    and jitter [1].
    """
    errors = errors or TableErrors()
    rng = np.random.default_rng(seed)
    mounting = errors.fixture_sd * rng.standard_normal((len(plan.axes), 3))
    parts = []
    for name, turned in zip(plan.axes, mounting, strict=True):
        rig = Rig(rate_error=errors.rate_error, rate_jitter=errors.rate_jitter, mounting=turned)
        one, number = plan.placement(name), int(rng.integers(2**31))
        if means:
            parts.append(_means(one, model, _steady(noise), site, rig, rate, number))
        else:
            part = simulate(
                one, model=model, noise=_steady(noise), site=site, rig=rig, rate=rate, seed=number
            ).log
            parts.append(part)
    log = _wandering(_joined(parts), noise, rng)
    return RateTableSimulation(log, model, plan, errors, mounting)


def _means(
    plan: TablePlan, model: ImuModel, noise: ImuNoise, site: Site, rig: Rig, rate: float, seed: int
) -> Log:
    """Return one mean per step: the truth, then the instrument and its noise."""
    rng = np.random.default_rng([seed, 1])
    true = simulate_readings(
        plan, models=ImuModel(), noise=ImuNoise(), site=site, rig=rig, seed=seed
    )
    accel, gyro = model.measure(true.accel[0], true.gyro[0])
    accel = accel + _noise(noise.accel, plan.time, rate, rng)
    gyro = gyro + _noise(noise.gyro, plan.time, rate, rng)
    table = TableColumns(plan.angles, plan.rate)
    start = np.cumsum(plan.time + PAUSE) - plan.time
    return Log(start, gyro, accel, table=table, averaged=plan.time)


def _noise(
    noise: TriadNoise, time: FloatArray, rate: float, rng: np.random.Generator
) -> FloatArray:
    drawn = rng.standard_normal((len(time), 3))
    if noise == TriadNoise():
        return np.zeros_like(drawn)
    return np.asarray(np.sqrt(mean_variance(noise, time, 1.0 / rate))[:, None] * drawn)


def _steady(noise: ImuNoise) -> ImuNoise:
    """Leave out the wander of the bias, which goes on from one placement to the next."""
    return ImuNoise(*(
        replace(one, bias_instability=0.0, random_walk=0.0) for one in (noise.accel, noise.gyro)
    ))  # fmt: skip


def _wandering(log: Log, noise: ImuNoise, rng: np.random.Generator) -> Log:
    """Add the wander of the bias over the whole session."""

    def moved(x: FloatArray | None, one: TriadNoise) -> FloatArray | None:
        if x is None or not (one.bias_instability or one.random_walk):
            return x
        if log.averaged is None:
            slow = replace(one, white=0.0, quantisation=0.0)
            return quantise(x + draw_noise(slow, log.time, rng), one.quantisation)
        tied = wander(one, log.time + log.averaged / 2, log.averaged)
        least = 1e-12 * np.trace(tied) * np.eye(len(tied))
        return np.asarray(x + np.linalg.cholesky(tied + least) @ rng.standard_normal(x.shape))

    return replace(log, accel=moved(log.accel, noise.accel), gyro=moved(log.gyro, noise.gyro))


def _joined(parts: Sequence[Log]) -> Log:
    """Join the logs of the placements, as if the logger had been paused in between.

    A table of one axis tells that axis only.
    """
    start, time, outer = 0.0, [], []
    for part in parts:
        assert part.table is not None
        time.append(part.time + start)
        outer.append(part.table.angles[:, 0])
        step = part.interval if part.averaged is None else float(part.averaged[-1])
        start = float(time[-1][-1]) + step
    first = parts[0]
    angle = np.concatenate(outer)
    angles = np.column_stack([angle, np.full((len(angle), 2), np.nan)])
    return replace(
        first,
        time=np.concatenate(time),
        gyro=np.concatenate([p.gyro for p in parts if p.gyro is not None]),
        accel=np.concatenate([p.accel for p in parts if p.accel is not None]),
        averaged=None
        if first.averaged is None
        else np.concatenate([p.averaged for p in parts if p.averaged is not None]),
        table=TableColumns(
            angles,
            np.concatenate([
                p.table.rate for p in parts if p.table is not None and p.table.rate is not None
            ]),
        ),
    )  # fmt: skip
