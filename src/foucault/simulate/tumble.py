"""Simulate the tumble of a torqued cluster: open-loop commands, gravity seen by accelerometers.

The command is known, the gyros hold the cluster to it but for their errors and noise, and so the
attitude drifts away from the plan as the accelerometers then show. The motion is integrated by one
rotation vector per sample, or by the published rule, the angles in steps of 2 ms with noise of the
gyros of their own; both have the same truth otherwise. The accelerometers are read on the motion
that was integrated, at the time of a sample or as the mean over the interval before it.

References
----------
.. [1] Ding, Cai, Yang, Lian, "Continuous self-calibration and self-alignment method for floated
   inertial platform", J. NUDT 37(3), 2015, section 4 (2 ms steps of the angles).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.errors import error
from foucault.models.cluster import LAYOUT, ClusterModel, angles_of, attitude_of
from foucault.models.earth import Site, earth_rate_n
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.plans.tumble import TorquingPlan, nominal
from foucault.simulate.noise import draw_noise, quantise
from foucault.tables import Log, whole_samples

Sampled = Literal["rate", "increment"]
Holds = Literal["from its time", "until its time"]
Integrator = Literal["exponential", "published"]

STEP = 2e-3
"""Step of the published integrator [s]."""

BLOCK = 2000
"""Rows whose noise the published integrator draws at once [1]."""

# Two-point Gauss-Legendre rule on [0, 1]: exact to rounding for a mean over one interval.
_NODES = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)


@dataclass(frozen=True)
class Acquisition:
    """How the cluster is driven and read."""

    interval: float = 0.2  # time between samples [s]
    command_interval: float = 1.0  # time between commands, a multiple of it [s]
    # accelerometers at the time of a row, or their mean over the interval that ends there
    sampled: Sampled = "rate"
    holds: Holds = "from its time"  # whether the command of a row begins or ends at its time
    delay: float = 0.0  # the accelerometers of a row were read so much before its time [s]
    # time in which the cluster follows a step of the command: readings taken then feel the angular
    # acceleration; 0 for none [s]
    edge: float = 0.0
    # (3, 3) position of the x, y and z accelerometer in its rows, frame p [m]
    arms: FloatArray | None = None

    @property
    def each(self) -> int:
        """Samples per command [1]."""
        number = round(self.command_interval / self.interval)
        if number < 1 or abs(number * self.interval / self.command_interval - 1) > 1e-9:
            raise error("torquing.interval", command=self.command_interval, given=self.interval)
        return number


@dataclass(frozen=True)
class TumbleSimulation:
    """A simulated tumble."""

    log: Log  # command in the gyro columns, and readings of the accelerometers [SI]
    model: ClusterModel  # the errors the cluster had
    plan: TorquingPlan  # what it was told to do
    site: Site
    acquisition: Acquisition  # how it was driven and read
    # (2, 3, 3) true attitude at the time of the first and of the last row: maps n to p [1]
    C_pn: FloatArray

    @property
    def truth(self) -> CoefficientVector:
        """All 45: the errors, and the angles of the attitude at the end [SI]."""
        angles = angles_of(self.C_pn[1])
        return CoefficientVector(LAYOUT, np.concatenate([self.model.coefficients().values, angles]))

    def truth_json(self) -> dict[str, Any]:
        """Return the truth beside the coefficients."""
        arms = self.acquisition.arms
        return {
            "gravity": self.site.gravity,
            "latitude": self.site.latitude,
            "plan": {
                "name": self.plan.name,
                "start": np.asarray(self.plan.start).tolist(),
                "ramp": self.plan.ramp,
                "steps": [
                    {"rate": np.asarray(s.rate).tolist(), "time": s.time} for s in self.plan.steps
                ],
            },
            "attitude_start": angles_of(self.C_pn[0]).tolist(),
            "attitude_end": angles_of(self.C_pn[1]).tolist(),
            "C_pn_start": self.C_pn[0].tolist(),
            "C_pn_end": self.C_pn[1].tolist(),
            "delay": self.acquisition.delay,
            "arms": None if arms is None else np.asarray(arms).tolist(),
        }


@dataclass(frozen=True)
class _Motion:
    """The intervals of the simulation: some before row 0, some after the last row."""

    before: int
    command: FloatArray
    C_pn: FloatArray


def simulate_tumble(
    plan: TorquingPlan,
    *,
    model: ClusterModel,
    noise: ImuNoise,
    site: Site,
    start: FloatArray | None = None,
    acquisition: Acquisition | None = None,
    integrator: Integrator = "exponential",
    seed: int = 0,
) -> TumbleSimulation:
    """Simulate a session: N intervals and N + 1 rows, the command of the last one unused.

    `noise`: noise of its accelerometers, and of the drift of its gyros, a quantisation of the
    gyros is the step of the command [SI]; `start` (3,): true outer, middle and inner angle at the
    first row, None for those of the plan [rad]; `acquisition`: how it is driven and read, None
    takes the defaults; `integrator`: one rotation vector per sample, or the three angles in steps
    of 2 ms; `seed`: seed of the noise [1].

    Before the first row the command of that row held already, after the last row the last one
    still holds: readings that are delayed, or means, reach there.
    """
    if site.latitude is None:
        raise error("torquing.no_latitude")
    how = acquisition or Acquisition()
    longest = max(plan.duration, how.command_interval) + abs(how.delay)
    whole_samples(longest / how.interval)  # before memory is taken
    told = nominal(plan, site.latitude, how.command_interval)
    command = quantise(np.repeat(told.command, how.each, axis=0), noise.gyro.quantisation)
    first = attitude_of(np.asarray(plan.start if start is None else start, float))
    theta, w_n = model.packed(site.gravity), earth_rate_n(site.latitude)
    lead, phase = _reach(how)
    spread = (max(-lead, 0) + (how.sampled == "increment"), max(lead + 1, 1))
    motion = _integrate(
        theta, first, np.pad(command, (spread, (0, 0)), mode="edge"), spread[0], w_n, how.interval,
        noise.gyro, integrator, np.random.default_rng([seed, 1]),
    )  # fmt: skip
    n = len(command) + 1
    accel = site.gravity * _read(theta, motion, how, lead, phase, n, site.gravity)
    time = how.interval * np.arange(n, dtype=float)
    if noise.accel != TriadNoise():
        accel += draw_noise(noise.accel, time, np.random.default_rng([seed, 2]))
        accel = quantise(accel, noise.accel.quantisation, carried=how.sampled == "increment")
    ends = (0, 1) if how.holds == "from its time" else (1, 0)
    log = Log(time, np.pad(command, (ends, (0, 0)), mode="edge"), accel, how.sampled)
    C_pn = motion.C_pn[[motion.before, motion.before + n - 1]]
    return TumbleSimulation(log, model, plan, site, how, C_pn)


def _reach(how: Acquisition) -> tuple[int, float]:
    """Return how many intervals a row's reading lies ahead of it, and where in its interval."""
    ahead = -how.delay / how.interval
    lead = int(np.floor(ahead))
    return lead, ahead - lead


# -- motion ----------------------------------------------------------------------------------


def _integrate(
    theta: FloatArray, first: FloatArray, command: FloatArray, before: int, w_n: FloatArray,
    dt: float, noise: TriadNoise, integrator: str, rng: np.random.Generator,
) -> _Motion:  # fmt: skip
    """Integrate all intervals; `first` is the attitude after `before` of them."""
    from foucault.kernels.cluster_motion import integrate_exponential

    n = len(command)
    C_pn = np.empty((n + 1, 3, 3))
    back = np.empty((before + 1, 3, 3))
    back[0] = first
    still = np.zeros((n, 3))
    integrate_exponential(theta, back, command[:before], still, w_n, -dt)
    C_pn[0] = back[before]
    if integrator == "exponential":
        drawn = still
        if noise != TriadNoise():
            drawn = draw_noise(noise, dt * np.arange(n, dtype=float), rng)
            drawn[:before] = 0.0  # the attitude is given at the first row
        integrate_exponential(theta, C_pn, command, drawn, w_n, dt)
    else:
        _integrate_angles(theta, C_pn, command, before, w_n, dt, noise, rng)
    return _Motion(before, command, C_pn)


def _integrate_angles(
    theta: FloatArray, C_pn: FloatArray, command: FloatArray, before: int, w_n: FloatArray,
    dt: float, noise: TriadNoise, rng: np.random.Generator,
) -> None:  # fmt: skip
    """Integrate the angles, block by block, white noise in every step."""
    from foucault.kernels.cluster_motion import integrate_angles

    n, steps = len(command), max(1, round(dt / STEP))
    slow = np.zeros((n, 3))
    if noise != TriadNoise():
        slow = draw_noise(replace(noise, white=0.0), dt * np.arange(n, dtype=float), rng)
    slow[:before] = 0.0
    angles = angles_of(C_pn[0])
    for a in range(0, n, BLOCK):
        b = min(a + BLOCK, n)
        fast = noise.white / np.sqrt(dt / steps) * rng.standard_normal((b - a, steps, 3))
        fast[: max(before - a, 0)] = 0.0
        fast += slow[a:b, None]
        lost = integrate_angles(theta, angles, command[a:b], fast, w_n, dt, C_pn[a : b + 1])
        if lost >= 0:
            middle = abs(angles_of(C_pn[a + lost])[1])
            raise error(
                "torquing.singular", time=f"{(a + lost - before) * dt:.6g}",
                given=f"{np.degrees(middle):.4g}",
            )  # fmt: skip


# -- readings --------------------------------------------------------------------------------


def _read(
    theta: FloatArray, motion: _Motion, how: Acquisition, lead: int, phase: float, n: int,
    gravity: float,
) -> FloatArray:  # fmt: skip
    """Return what the accelerometers say in n rows, without noise [local g]."""
    at = motion.before + lead
    if how.sampled == "rate":
        return _part(theta, motion, how, at, n, (phase, phase), gravity)
    mean = (1 - phase) * _part(theta, motion, how, at - 1, n, (phase, 1.0), gravity)
    if phase > 0:
        mean += phase * _part(theta, motion, how, at, n, (0.0, phase), gravity)
    return np.asarray(mean)


def _part(
    theta: FloatArray, motion: _Motion, how: Acquisition, first: int, n: int,
    part: tuple[float, float], gravity: float,
) -> FloatArray:  # fmt: skip
    """Return the mean over a part of n intervals, or what is read there if it has no length."""
    from foucault.kernels.cluster_motion import readings_at

    rows = slice(first, first + n)
    arms = np.zeros((3, 3)) if how.arms is None else np.ascontiguousarray(how.arms, float)
    turn = _acceleration(motion.command, how, part)[rows]
    C_pn, command = motion.C_pn[first : first + n + 1], motion.command[rows]
    a, b = part
    phases = [a] if a == b else [float(a + (b - a) * node) for node in _NODES]
    said = [readings_at(theta, C_pn, command, turn, arms, gravity, p) for p in phases]
    return np.asarray(sum(said) / len(said))


def _acceleration(command: FloatArray, how: Acquisition, part: tuple[float, float]) -> FloatArray:
    """Return the mean angular acceleration over a part of every interval, shape (n, 3)."""
    out = np.zeros_like(command)
    if how.edge == 0:
        return out
    change = np.diff(command, axis=0, prepend=command[:1]) / how.edge
    for later in range(min(int(np.ceil(how.edge / how.interval)), len(out))):
        a, b = ((later + p) * how.interval for p in part)
        share = float(a < how.edge) if a == b else max(min(b, how.edge) - a, 0.0) / (b - a)
        out[later:] += share * change[: len(out) - later]
    return out
