"""What a slave and its master contradict one another in: units, signs, axes, angles, mounting.

Turned into n by the master's attitude, the slave's specific force less gravity is the acceleration
of the vehicle, which the master's velocities show too::

    C_nm C_ms f_s = dv/dt + (0, 0, g)

and what the slave turns its master turns. Where it is not so, the mistakes that people make are
tried one by one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import Finding, finding
from foucault.estimate.delay import UNLIKE, Delay, delay_of
from foucault.guard.mistakes import Mistake, columns, exchanges, explain, factors, likely
from foucault.models.rotation import angles_of, matrix_of
from foucault.models.rotation import log as rotation_vector
from foucault.models.transfer import Messages
from foucault.navigate.increments import Increments
from foucault.tables import gaps
from foucault.units import STANDARD_GRAVITY, plain

OVER = 2.0
"""Accelerations are means over so long [s]."""

OTHER_UNIT = 1.2
"""Forces that differ in size by such a factor have another unit [1]."""

CLEARLY = 3.0
"""By so many times less must be left over for a mistake to be told [1]."""

AS_GOOD = 1.1
"""What leaves so little more over is as good [1]."""

EXPLAINED = 0.6
"""For a unit of velocities to be told, at most this part of how they change is left over [1]."""

FEWEST = 10
"""Means that it takes [1]."""

SURE_SD = 3.0
"""So many standard deviations make a difference [1]."""

OTHER_SIZE = 0.05
"""Turning that differs by more in size is told [1]."""

ALIKE = 0.9
"""Of what a slave turns on its master, the master turns at least so much too, as a variance [1]."""

ASTRAY = np.radians(3.0)
"""A mounting that is so far from the nominal one is told [rad]."""

SURELY = 5.0
"""If it is so many standard deviations [1]."""

FAR = 60.0
"""A clock that was set otherwise is looked for so far away [s]."""

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

SENSES = {"heading": [-1.0, 1.0, 1.0], "pitch": [1.0, -1.0, 1.0], "roll": [1.0, 1.0, -1.0]}
"""Angle of a master that may count the other way -> signs of all three."""

MISTAKES = (
    Mistake(exchange=-np.eye(3), of="accel", code="gravity"),
    *(Mistake(words, 1 / k, of="velocity", code="force_unit") for k, words in SPEEDS.items()),
    *(Mistake(words, exchange=A.T, of="velocity", code="force_velocity")
      for words, A in VELOCITIES.items()),
    *(Mistake(", ".join(columns(S)), exchange=S, of="accel", code="force_axes")
      for S in exchanges()[1:]),
    *(Mistake(f"a {angle} that counts the other way", exchange=np.diag(signs), of="attitude",
              code="force_velocity") for angle, signs in SENSES.items()),
)  # fmt: skip
"""The simplest first."""


# -- forces --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Felt:
    """What moves both, from message to message."""

    dvel_s: FloatArray  # (k, 3) integral of the slave's specific force, in its axes [m/s]
    C_nm: FloatArray  # (k, 3, 3) attitude by the master [1]
    C_ms: FloatArray  # (3, 3) nominal mounting [1]
    dt: FloatArray  # (k,) how long it took [s]
    dv_n: FloatArray  # (k, 3) how the master's velocity has changed [m/s]

    def left(self, mistake: Mistake) -> float:
        """Return what is left over without a mistake, root mean square [m/s^2]."""
        C_nm = self.C_nm
        if mistake.of == "attitude":
            C_nm = matrix_of(*mistake.right(angles_of(C_nm)).T)
        dv = (C_nm @ self.C_ms @ mistake.right(self.dvel_s, "accel")[:, :, None])[:, :, 0]
        dv[:, 2] -= STANDARD_GRAVITY * self.dt
        pull = mistake.right(self._means(self.dv_n), "velocity")
        left, size = (float(np.sqrt(np.mean(x**2))) for x in (self._means(dv) - pull, pull))
        # In another unit noise is smaller or larger too; then what both do has to show.
        shown = mistake.factor == 1.0 or left < EXPLAINED * size
        return left if shown else np.inf

    @property
    def size(self) -> float:
        """How many times as large the slave's force is as the master's [1]."""
        felt = self._means(self.dv_n) + np.array([0.0, 0.0, STANDARD_GRAVITY])
        return float(np.sqrt(np.mean(self._means(self.dvel_s) ** 2) / np.mean(felt**2)))

    def _means(self, x: FloatArray) -> FloatArray:
        """Return means over `OVER`."""
        each = max(1, round(OVER / float(np.median(self.dt))))
        first = np.arange(0, len(x) - each + 1, each)
        return np.asarray(np.add.reduceat(x, first) / np.add.reduceat(self.dt, first)[:, None])


def _felt(increments: Increments, said: Messages, delay: float, C_ms: FloatArray) -> _Felt | None:
    """Bring both to the times of the messages; None where there are too few."""
    valid, t = said.time - delay, increments.time
    inside = np.flatnonzero((valid > t[0]) & (valid < t[-1]))
    if len(inside) < 2 or valid[inside[-1]] - valid[inside[0]] < FEWEST * OVER:
        return None
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(increments.dvel_b[1:], axis=0)])
    at = np.stack([np.interp(valid[inside], t, column) for column in total.T], axis=1)
    dt = np.diff(valid[inside])
    usual = ~gaps(dt)  # not across a drop-out
    C_nm, dv_n = said.C_nm[inside], np.diff(said.velocity_n[inside], axis=0)
    middle = (C_nm[:-1] + C_nm[1:]) / 2
    return _Felt(np.diff(at, axis=0)[usual], middle[usual], C_ms, dt[usual], dv_n[usual])


def forces(
    increments: Increments, said: Messages, found: Delay | None, C_ms: FloatArray
) -> list[Finding]:
    """Return what contradicts units, signs, axes of accelerometers and velocities; `C_ms` [1]."""
    both = _felt(increments, said, found.delay if found is not None and found.seen else 0.0, C_ms)
    if both is None:
        return []
    # Some make no difference on this motion: the simplest of them is told.
    seen = explain(both.left, MISTAKES, wrong=0.0, better=1 / CLEARLY, alike=AS_GOOD)
    if seen.by:
        one = seen.by[0]
        return [finding(f"transfer.{one.code}", words=one.words, now=plain(seen.now, 2),
                        least=plain(both.left(one), 2))]  # fmt: skip
    if 1 / OTHER_UNIT < both.size < OTHER_UNIT:
        return []
    cause = likely(both.size, factors("accel", float(np.median(increments.dt))))
    hint = f" Probably {cause}." if cause else ""
    return [finding("transfer.force_size", ratio=plain(both.size, 3), hint=hint)]


# -- turning -------------------------------------------------------------------------------------


def turning(
    increments: Increments, said: Messages, found: Delay | None, C_ms: FloatArray,
    bracket: tuple[float, float],
) -> list[Finding]:  # fmt: skip
    """Return what contradicts units, axes, senses and `C_ms` (3, 3) [1] in `bracket` [s]."""
    if found is None:
        return []
    dt = float(np.median(increments.dt))

    def off(other: Delay) -> float:
        return float(np.linalg.norm(rotation_vector(C_ms.T @ other.C_ms)))

    def agrees(other: Delay | None) -> bool:
        """Tell whether both turn alike, in a mounting near the nominal one."""
        if other is None or not other.match.converged or other.likeness < ALIKE:
            return False  # of the few turns between gaps some are alike in any sense
        return off(other) < max(float(ASTRAY), SURELY * float(np.sqrt(np.trace(other.mu_cov))))

    if agrees(found):
        return [*of_size(found, dt), *of_wild(found)]
    far = delay_of(increments, said.time, said.C_nm, C_ms=C_ms, bracket=(-FAR, FAR))
    if far is not None and agrees(far) and not bracket[0] < far.delay < bracket[1]:
        size = f"{abs(far.delay):.3f} s"
        cure = f"take {size} from" if far.delay > 0 else f"add {size} to"
        return [finding("transfer.clock", delay=f"{far.delay:+.3f}",
                        sd=f"{max(far.delay_sd, 5e-4):.3f}", low=f"{bracket[0]:g}",
                        high=f"{bracket[1]:g}", cure=f"{cure} the master's stamps")]  # fmt: skip
    for angle, signs in SENSES.items():
        C_nm = matrix_of(*(angles_of(said.C_nm) * signs).T)
        mirrored = delay_of(increments, said.time, C_nm, C_ms=C_ms, bracket=bracket)
        if mirrored is not None and agrees(mirrored):
            cure = f'Write "-{angle}", or whatever its column is called, into [master.attitude].'
            if angle == "heading":
                cure = 'Write sense = "counter-clockwise" (or "clockwise") in [master.attitude].'
            return [finding("transfer.sense", angle=angle, cure=cure,
                            likeness=f"{100 * mirrored.likeness:.0f} %")]  # fmt: skip
    mirror = replace(increments, dtheta_b=-increments.dtheta_b)
    turned, mirrored = (delay_of(x, said.time, said.C_nm, bracket=bracket)
                        for x in (increments, mirror))  # fmt: skip
    # Of a motion that is nearly all about one axis most is alike even where two columns changed
    # places: what is not alike tells which it is.
    left, rest = (1.0 if x is None or not x.match.converged else 1.0 - x.likeness
                  for x in (turned, mirrored))  # fmt: skip
    if turned is not None and left <= min(rest, 1.0 - ALIKE):
        heading, pitch, roll = (np.degrees(angles_of(turned.C_ms)) + 180.0) % 360.0 - 180.0
        mounted = finding("transfer.mounting", heading=f"{heading:.1f}", pitch=f"{pitch:.1f}",
                       roll=f"{roll:.1f}", angle=f"{np.degrees(off(turned)):.1f}")  # fmt: skip
        return [mounted, *of_size(turned, dt)]
    told = of_size(found, dt)
    if mirrored is None or rest > 1.0 - ALIKE:
        return told
    # Where the gyros point, in the axes of the nominal mounting: a wrong sign, or two columns.
    axes = ", ".join(columns((-C_ms.T @ mirrored.C_ms).T))
    return [*told, finding("transfer.mirror", axes=axes)]


def of_size(found: Delay, dt: float = np.nan) -> list[Finding]:
    """Tell where one turns more than the other, a unit; `dt`: usual time between samples [s]."""
    off = abs(found.scale - 1.0)
    if found.likeness < UNLIKE or off < max(OTHER_SIZE, SURE_SD * found.scale_sd):
        return []
    hint = _unit(found.scale, dt)
    return [finding("delay.scale", ratio=plain(found.scale, 4), hint=hint)]


def of_wild(found: Delay) -> list[Finding]:
    """Tell of turns that no body makes."""
    if not found.wild.any():
        return []
    size = np.degrees(np.linalg.norm(found.turns.phi_m, axis=1))
    worst = int(np.argmax(np.where(found.wild, np.nan_to_num(size), 0.0)))
    return [finding("delay.wild", count=int(found.wild.sum()), size=plain(size[worst], 3),
                    time=plain(round(float(found.turns.end[worst]), 3), 13))]  # fmt: skip


def _unit(scale: float, dt: float) -> str:
    cause = likely(scale, factors("gyro", dt), 1.0 + OTHER_SIZE)
    of_both = ", or of the master the reverse" if cause and "unit" in cause else ""
    return f" Of the slave probably {cause}{of_both}." if cause else ""
