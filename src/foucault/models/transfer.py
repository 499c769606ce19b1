"""A slave on its master: what is said, how it is fixed, and what is unknown of that.

What a master INS said: velocity and attitude of the vehicle, message by message.

A message is made when what it says is true, the time of its validity, and reaches the logger of
the slave some time later. Which of the two its stamp is depends on who stamps it. The *delay* tau
of a table belongs to its stamps: what is stamped t was true at t - tau on the slave's clock.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from foucault.arrays import BoolArray, FloatArray
from foucault.coefficients import Layout, coefficients_of
from foucault.errors import Finding, error, finding
from foucault.models.earth import transport_rate
from foucault.models.imu import LAYOUT
from foucault.models.ins_errors import Sensors
from foucault.models.noise import ImuNoise
from foucault.models.rotation import angles_of
from foucault.tables import gaps, usual_step
from foucault.units import plain, span

INSTALLATION = Layout(coefficients_of("installation"))
"""The constant part of how the slave is turned against its nominal mounting."""

DELAY = Layout(coefficients_of("master_delay"))
"""Between what a message says and its arrival."""

LOAD = Layout(coefficients_of("load"))
"""Compliance of the mount."""

FLEXURE = Layout(coefficients_of("flexure"))
"""The part of the rotation that wanders."""

WANDER = Layout(coefficients_of("wander"))
"""What a bias is away from its mean: a first-order Markov process, the bias instability."""

DRIFTING = ("gyro.bias", "accel.bias", "gyro.scale", "accel.scale")
"""Groups of coefficients that drift over a session."""

COUNTED = Layout(
    (*(replace(LAYOUT.coefficients[i], name=f"drift.{LAYOUT.names[i]}", symbol="d",
               meaning=f"{LAYOUT.coefficients[i].meaning}, end minus start of the run")
       for group in DRIFTING for i in LAYOUT.group(group)),
     *coefficients_of("transfer_counted"))
)  # fmt: skip
"""What is not estimated, and counted with as states, beside coefficients of the instrument."""

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
    sensors: Sensors,
    mount: Mount,
    matching: Matching,
    noise: ImuNoise | None = None,
    counted: tuple[str, ...] = (),
) -> Layout:
    """Return the states: nine of navigation, coefficients, installation, delay, load, flexure.

    What biases wander follows, where they do, then what is counted with.

    `noise` or None: noise of the slave, bias instability among it [SI]; `counted`: names of those
    of `COUNTED`.
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
        *COUNTED.subset(counted).coefficients,
    ))  # fmt: skip


def bias_of(wander: str) -> str:
    """Return the name of the bias that a state of `WANDER` belongs to."""
    return wander.replace("_wander.", ".bias.")


MOVES = 0.1
"""Above this speed no two messages are alike to the last digit, unless one came twice [m/s]."""

_OPTIONAL = ("arrival", "latitude", "longitude", "height")


@dataclass(frozen=True)
class MasterTable:
    """Messages of a master INS. Its body axes m are right, forward, up of the vehicle."""

    time: FloatArray  # (k,) stamp of each message [s]
    velocity_n: FloatArray  # (k, 3) velocity of the master: east, north, up [m/s]
    C_nb: FloatArray  # (k, 3, 3) attitude of the master, ``x_n = C_nb @ x_m`` [1]
    # (k,) when it arrived, on the slave's clock, where the log holds that beside its stamp [s]
    arrival: FloatArray | None = None
    # latitude, longitude: (k,) geodetic latitude and longitude [rad]
    latitude: FloatArray | None = None
    longitude: FloatArray | None = None
    height: FloatArray | None = None  # (k,) height above the ellipsoid [m]
    findings: tuple[Finding, ...] = ()  # what was noticed and repaired or left as it was

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, rows: slice | BoolArray | npt.NDArray[np.int64]) -> MasterTable:
        """Return some of the messages."""
        some = {name: getattr(self, name)[rows] for name in ("time", "velocity_n", "C_nb")}
        for name in _OPTIONAL:
            column = getattr(self, name)
            some[name] = None if column is None else column[rows]
        return replace(self, **some)

    @cached_property
    def interval(self) -> float:
        """Usual time from one message to the next [s]."""
        return usual_step(np.diff(self.time))

    @cached_property
    def angles(self) -> FloatArray:
        """Heading, pitch and roll, shape (k, 3) [rad]."""
        return angles_of(self.C_nb)

    @property
    def has_place(self) -> bool:
        """Whether it says latitude and longitude."""
        return self.latitude is not None and self.longitude is not None

    def from_place(self, latitude: float, height: float) -> MasterTable:
        """Return the table with the positions that its velocities lead to, where it says none.

        `latitude`: of the first message, its longitude is taken as 0 [rad]; `height`: of the
        first message [m].
        """
        time, v = self.time, self.velocity_n
        up = self.height if self.height is not None else _along(time, v[:, 2], height)
        if self.has_place:
            return replace(self, height=up)
        north = -transport_rate(latitude, up, v)[:, 0]
        there = _along(time, north, latitude)
        east = transport_rate(there, up, v)[:, 1] / np.cos(there)
        return replace(self, latitude=there, longitude=_along(time, east, 0.0), height=up)

    @property
    def messages(self) -> Messages:
        """What the filters take: by arrival, where that is logged beside the stamp."""
        time = self.time if self.arrival is None else self.arrival
        return Messages(time, self.velocity_n, self.C_nb)

    def cleaned(self, missing: str = "drop", name: str = "The master's table") -> MasterTable:
        """Return the messages in order, each once, and say what was left out.

        `missing`: what is done with messages that lack a number. Raises ``master.empty``,
        ``master.missing``, ``master.time``.

        A message has come twice if all it says is what the one before has said, and it has the same
        stamp or the vehicle moves.
        """
        table, found = self._complete(missing, name)
        table, twice = table._once(name)
        if len(table) < 2:
            raise error("master.empty", file=name, rows=len(table))
        for time in (table.time, table.arrival):
            if time is None:
                continue
            back = np.flatnonzero(np.diff(time) <= 0)
            if len(back):
                row = int(back[0]) + 1
                raise error("master.time", file=name, count=len(back),
                            time=plain(float(time[row]), 9))  # fmt: skip
        return replace(table, findings=(*self.findings, *found, *twice, *table._gaps(name)))

    def _complete(self, missing: str, name: str) -> tuple[MasterTable, tuple[Finding, ...]]:
        whole: BoolArray = np.asarray(np.isfinite(self._said()).all(axis=1))
        if whole.all():
            return self, ()
        words = {"file": name, "count": int(np.sum(~whole)), "rows": len(whole),
                 "row": int(np.argmin(whole))}  # fmt: skip
        if missing == "error":
            raise error("master.missing", **words)
        return self[whole], (finding("master.dropped", **words),)

    def _once(self, name: str) -> tuple[MasterTable, tuple[Finding, ...]]:
        said = self._said(stamps=False)
        again = np.zeros(len(self), bool)
        moves = np.linalg.norm(self.velocity_n[1:], axis=1) > MOVES
        again[1:] = (said[1:] == said[:-1]).all(axis=1) & (moves | (np.diff(self.time) == 0))
        if not again.any():
            return self, ()
        return self[~again], (finding("master.repeated", file=name, count=int(again.sum())),)

    def _gaps(self, name: str) -> tuple[Finding, ...]:
        step = np.diff(self.time)
        wide = gaps(step)
        if not wide.any():
            return ()
        lost = int(np.sum(np.round(step[wide] / self.interval) - 1))
        return (finding("master.gaps", file=name, count=int(wide.sum()), lost=lost,
                        longest=span(float(step.max())), usual=span(self.interval)),)  # fmt: skip

    def _said(self, stamps: bool = True) -> FloatArray:
        """Return all that the messages say as columns, with or without their stamps."""
        parts = [self.velocity_n, self.C_nb.reshape(-1, 9)]
        parts += [self.time[:, None]] if stamps else []
        names = _OPTIONAL if stamps else _OPTIONAL[1:]
        columns = [getattr(self, name) for name in names]
        return np.concatenate([*parts, *(c[:, None] for c in columns if c is not None)], axis=1)


def _along(time: FloatArray, rate: FloatArray, begin: float) -> FloatArray:
    """Return where a rate leads to."""
    steps = np.diff(time) * (rate[1:] + rate[:-1]) / 2
    return begin + np.concatenate([[0.0], np.cumsum(steps)])
