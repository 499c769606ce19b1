"""What moves slave and master: units, signs and axes of accelerometers and of velocities.

Turned into n by the master's attitude, the slave's specific force less gravity is the acceleration
of the vehicle, which the master's velocities show too::

    C_nm C_ms f_s = dv/dt + (0, 0, g)

Where it is not, the mistakes that people make are tried one by one: another unit, axes exchanged or
reversed, north for east.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import permutations, product
from math import inf

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import Finding, finding
from foucault.estimate.delay.fit import Delay
from foucault.models.attitude import angles_of, matrix_of
from foucault.models.transfer import Messages
from foucault.navigate.increments import Increments
from foucault.tables import AXES
from foucault.units import STANDARD_GRAVITY, plain

OVER = 2.0
"""Accelerations are means over so long [s]."""

OTHER_UNIT = 1.2
"""Forces that differ in size by such a factor have another unit [1]."""

NAMED = 0.1
"""A known factor is named within this [1]."""

CLEARLY = 3.0
"""By so many times less must be left over for a mistake to be told [1]."""

ALIKE = 1.1
"""What leaves so little more over is as good [1]."""

EXPLAINED = 0.6
"""For a unit of velocities to be told, at most this part of how they change is left over [1]."""

FEWEST = 10
"""Means that it takes [1]."""

GAP = 1.5
"""Messages that are so many times the usual apart are not compared [1]."""

_SWAPPED = np.array([[0, 1.0, 0], [1.0, 0, 0], [0, 0, 1.0]])
VELOCITIES = {
    "north for east and east for north": _SWAPPED,
    "north, east, down for east, north, up": np.diag([1.0, 1.0, -1.0]) @ _SWAPPED,
    "down for up": np.diag([1.0, 1.0, -1.0]),
    "west for east": np.diag([-1.0, 1.0, 1.0]),
    "south for north": np.diag([1.0, -1.0, 1.0]),
    "a heading that is off by 180 deg": np.diag([-1.0, -1.0, 1.0]),
    "a heading that is off by 90 deg": np.array([[0, 1.0, 0], [-1.0, 0, 0], [0, 0, 1.0]]),
    "a heading that is off by -90 deg": np.array([[0, -1.0, 0], [1.0, 0, 0], [0, 0, 1.0]]),
}
"""What velocities were taken for -> what they are of the right ones."""

SPEEDS = {3.6: "km/h", 1 / 0.514444: "knots", 1 / 0.3048: "ft/s", 100.0: "cm/s"}
"""Factor -> unit of velocities that were taken for m/s."""


@dataclass(frozen=True)
class Felt:
    """What moves both, from message to message."""

    dvel_s: FloatArray  # (k, 3) integral of the slave's specific force, in its axes [m/s]
    C_ns: FloatArray  # (k, 3, 3) attitude by the master and the nominal mounting [1]
    dt: FloatArray  # (k,) how long it took [s]
    dv_n: FloatArray  # (k, 3) how the master's velocity has changed [m/s]

    def left(self, axes: FloatArray, velocities: FloatArray) -> float:
        """Return what is left over, root mean square [m/s^2].

        `axes` (3, 3): from what the slave says to what it feels [1]; `velocities` (3, 3): from
        what velocities are to what the master says [1].
        """
        dv = (self.C_ns @ (self.dvel_s @ axes.T)[:, :, None])[:, :, 0]
        dv[:, 2] -= STANDARD_GRAVITY * self.dt
        pull = self._means(self.dv_n)
        left = float(np.sqrt(np.mean((self._means(dv) @ velocities.T - pull) ** 2)))
        size = float(np.abs(np.linalg.det(velocities))) ** (1 / 3)
        # In another unit noise is smaller or larger too; then what both do has to show.
        explained = size == 1.0 or left < EXPLAINED * float(np.sqrt(np.mean(pull**2)))
        return left / size if explained else inf

    @property
    def size(self) -> float:
        """How many times as large the slave's force is as the master's [1]."""
        felt = self._means(self.dv_n) + np.array([0.0, 0.0, STANDARD_GRAVITY])
        return float(np.sqrt(np.mean(self._means(self.dvel_s) ** 2) / np.mean(felt**2)))

    def mirrored(self, C_ms: FloatArray) -> Iterator[tuple[str, Felt]]:
        """Yield what it were if an angle of the master counted the other way, and that in words.

        `C_ms` (3, 3): nominal mounting [1].
        """
        for k, name in enumerate(("heading", "pitch", "roll")):
            angles = angles_of(self.C_ns @ C_ms.T)
            angles[:, k] *= -1.0
            turned = replace(self, C_ns=matrix_of(*angles.T) @ C_ms)
            yield f"a {name} that counts the other way", turned

    def _means(self, x: FloatArray) -> FloatArray:
        """Return means over `OVER`."""
        each = max(1, round(OVER / float(np.median(self.dt))))
        first = np.arange(0, len(x) - each + 1, each)
        return np.asarray(np.add.reduceat(x, first) / np.add.reduceat(self.dt, first)[:, None])


def felt(increments: Increments, said: Messages, delay: float, C_ms: FloatArray) -> Felt | None:
    """Bring both to the times of the messages; None where there are too few.

    `delay`: how late its messages are [s]; `C_ms` (3, 3): nominal mounting [1].
    """
    valid, t = said.time - delay, increments.time
    inside = np.flatnonzero((valid > t[0]) & (valid < t[-1]))
    if len(inside) < 2 or valid[inside[-1]] - valid[inside[0]] < FEWEST * OVER:
        return None
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(increments.dvel_b[1:], axis=0)])
    at = np.stack([np.interp(valid[inside], t, column) for column in total.T], axis=1)
    dt = np.diff(valid[inside])
    usual = dt < GAP * np.median(dt)  # not across a drop-out
    C_nm = said.C_nm[inside]
    C_ns = (C_nm[:-1] + C_nm[1:]) / 2 @ C_ms
    dv_n = np.diff(said.velocity_n[inside], axis=0)
    return Felt(np.diff(at, axis=0)[usual], C_ns[usual], dt[usual], dv_n[usual])


def forces(
    increments: Increments, said: Messages, found: Delay | None, C_ms: FloatArray
) -> list[Finding]:
    """Return what contradicts units, signs and axes of accelerometers and velocities.

    `found` or None: what rate matching has found; `C_ms` (3, 3): nominal mounting [1].
    """
    both = felt(increments, said, found.delay if found is not None and found.seen else 0.0, C_ms)
    if both is None:
        return []
    one = np.eye(3)
    now = both.left(one, one)
    tried = [(f"transfer.{code}", words, both.left(S, A)) for code, words, S, A in _mistakes()]
    tried += [
        ("transfer.force_velocity", words, x.left(one, one)) for words, x in both.mirrored(C_ms)
    ]
    least = min(left for _, _, left in tried)
    if least < now / CLEARLY:
        # Some make no difference on this motion: the simplest of them is told.
        code, words, left = next(row for row in tried if row[2] < ALIKE * least)
        return [finding(code, words=words, now=plain(now, 2), least=plain(left, 2))]
    if 1 / OTHER_UNIT < both.size < OTHER_UNIT:
        return []
    hint = _unit(both.size, float(np.median(increments.dt)))
    return [finding("transfer.force_size", ratio=plain(both.size, 3), hint=hint)]


def _mistakes() -> list[tuple[str, str, FloatArray, FloatArray]]:
    """Return code, words, and what each makes of forces and of velocities, the simplest first."""
    one = np.eye(3)
    of_axes = sorted(_signed(), key=lambda S: float(np.sum(np.abs(S - one))))
    return [
        ("gravity", "", -one, one),
        *(("force_unit", words, one, ratio * one) for ratio, words in SPEEDS.items()),
        *(("force_velocity", words, one, A) for words, A in VELOCITIES.items()),
        *(("force_axes", _axes(S), S, one) for S in of_axes[1:]),
    ]


def _signed() -> list[FloatArray]:
    """Return the ways in which axes can be exchanged and reversed."""
    signs = np.array(list(product((1.0, -1.0), repeat=3)))
    return [np.eye(3)[list(order)] * s[:, None] for order in permutations(range(3)) for s in signs]


def _axes(S: FloatArray) -> str:
    """Name which columns stand for x, y and z."""
    place = np.argmax(np.abs(S), axis=1)
    return ", ".join(("-" if S[i, k] < 0 else "") + AXES[k] for i, k in enumerate(place))


def _unit(ratio: float, dt: float) -> str:
    known = {
        1 / STANDARD_GRAVITY: "g, taken for m/s^2",
        STANDARD_GRAVITY: "m/s^2, taken for g",
        dt: "increments of velocity, taken for forces",
        1 / dt: "forces, taken for increments of velocity",
        1e-3: "m/s^2 that were divided by a thousand, or mg, taken for g",
        1e3 / STANDARD_GRAVITY: "mg, taken for m/s^2",
    }  # fmt: skip
    for factor, words in known.items():
        if abs(np.log(ratio / factor)) < NAMED:
            return f" They look like {words}."
    return ""
