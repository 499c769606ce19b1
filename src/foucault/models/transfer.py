"""A slave on its master: what is said, how it is fixed, and what is unknown of that."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.coefficients import Coefficient, Layout
from foucault.models.ins_errors import Sensors
from foucault.models.noise import ImuNoise
from foucault.tables import AXES


def _triad(group: str, symbol: str, kind: str, what: str) -> tuple[Coefficient, ...]:
    return tuple(
        Coefficient(f"{group}.{a}", f"{symbol}_{a}", kind, f"{what}, {a} axis of the slave")
        for a in AXES
    )


INSTALLATION = Layout(_triad("installation", "mu", "angle", "rotation from the nominal mounting"))
"""The constant part of how the slave is turned against its nominal mounting."""

DELAY = Layout((Coefficient("master.delay", "tau", "time", "how late messages arrive"),))
"""Between what a message says and its arrival."""

LOAD = Layout(_triad("load", "k", "angle", "rotation of the mount per g of load"))
"""Compliance of the mount."""

FLEXURE = Layout(
    (*_triad("flexure", "th", "angle", "rotation of the mount that comes and goes"),
     *_triad("flexure_rate", "thdot", "angular rate", "its rate"))
)  # fmt: skip
"""The part of the rotation that wanders."""

WANDER = Layout(
    tuple(Coefficient(f"{triad}_wander.{a}", f"w_{triad[0]}{a}", kind,
                      f"what the bias of the {triad} wanders, {a} axis")
          for triad, kind in (("gyro", "angular rate"), ("accel", "specific force"))
          for a in AXES)
)  # fmt: skip
"""What a bias is away from its mean: a first-order Markov process, the bias instability."""

LIVELY = 2.146
"""Bandwidth of the second-order Markov process times its correlation time [1]."""


@dataclass(frozen=True)
class Messages:
    """What the master says."""

    time: FloatArray  # (k,) when each message arrives, by the slave's clock, rising [s]
    velocity_n: FloatArray  # (k, 3) velocity of the master [m/s]
    C_nm: FloatArray  # (k, 3, 3) its attitude [1]

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, rows: slice | npt.NDArray[Any]) -> Messages:
        """Return some of the messages."""
        return Messages(self.time[rows], self.velocity_n[rows], self.C_nm[rows])


@dataclass(frozen=True)
class Mount:
    """How the slave is fixed to the master, as far as it is known."""

    C_ms: FloatArray  # (3, 3) nominal mounting, slave to master [1]
    lever_m: FloatArray  # (3,) from the master to the slave, in the master's axes [m]
    load: bool = False  # whether it gives way under load
    flexure_sd: float = 0.0  # standard deviation of what wanders; 0: the mount is rigid [rad]
    flexure_time: float = 5.0  # its correlation time [s]
    wander: float = 0.0  # random walk of the installation [rad/sqrt(s)]


@dataclass(frozen=True)
class Matching:
    """What of the messages is used, and how good it is."""

    # of each component of the difference of velocities; infinite: not used [m/s]
    velocity_sd: float
    attitude_sd: float  # of each component of the difference of attitudes; infinite: not used [rad]
    # difference of attitudes as a rotation vector, or of heading, pitch and roll, which fail with
    # the nose up or down
    attitude: Literal["vector", "angles"] = "vector"
    vertical: bool = False  # whether vertical velocity counts too; a free run drifts in it
    delay: bool = False  # whether the delay is a state
    # whether the slave is looked at between its samples, or at the sample before, as the source
    # does
    shift: Literal["interpolated", "sample"] = "interpolated"


def states_of_transfer(
    sensors: Sensors, mount: Mount, matching: Matching, noise: ImuNoise | None = None
) -> Layout:
    """Return the states: nine of navigation, coefficients, installation, delay, load, flexure.

    What biases wander follows, where they do.

    `noise` or None: noise of the slave, bias instability among it [SI].
    """
    wanders = () if noise is None else [
        c for c in WANDER.coefficients
        if getattr(noise, c.name.partition("_")[0]).bias_instability > 0
        and bias_of(c.name) in sensors.layout
    ]  # fmt: skip
    return Layout((
        *sensors.states.coefficients, *INSTALLATION.coefficients,
        *(DELAY.coefficients if matching.delay else ()),
        *(LOAD.coefficients if mount.load else ()),
        *(FLEXURE.coefficients if mount.flexure_sd > 0 else ()), *wanders,
    ))  # fmt: skip


def bias_of(wander: str) -> str:
    """Return the name of the bias that a state of `WANDER` belongs to."""
    return wander.replace("_wander.", ".bias.")
