"""What the turning of slave and master says of mounting, axes, units and angles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.transfer import delay as delay_checks
from foucault.errors import Finding, finding
from foucault.estimate.delay.fit import Delay, delay_of
from foucault.models.attitude import angles_of, matrix_of
from foucault.models.rotation import log as rotation_vector
from foucault.models.transfer import Messages
from foucault.navigate.increments import Increments

ALIKE = 0.9
"""Of what a slave turns on its master, the master turns at least so much too, as a variance [1]."""

ASTRAY = np.radians(3.0)
"""A mounting that is so far from the nominal one is told [rad]."""

SURELY = 5.0
"""If it is so many standard deviations [1]."""

FAR = 60.0
"""A clock that was set otherwise is looked for so far away [s]."""

ANGLES = {
    "heading": 'Write sense = "counter-clockwise" (or "clockwise") in [master.attitude].',
    "pitch": 'Write "-pitch", or whatever its column is called, into [master.attitude].',
    "roll": 'Write "-roll", or whatever its column is called, into [master.attitude].',
}
"""Angle of the master that may count the other way -> what to do."""


def turning(
    increments: Increments, said: Messages, found: Delay | None, C_ms: FloatArray,
    bracket: tuple[float, float],
) -> list[Finding]:  # fmt: skip
    """Return what contradicts mounting, units, axes, and the sense of angles.

    `found` or None: what rate matching has found from the nominal mounting; `C_ms` (3, 3):
    nominal mounting [1]; `bracket`: where the delay was looked for [s].
    """
    if found is None:
        return []
    dt = float(np.median(increments.dt))
    if _agrees(found, C_ms):
        return [*delay_checks.of_size(found, dt), *delay_checks.of_wild(found)]
    far = delay_of(increments, said.time, said.C_nm, C_ms=C_ms, bracket=(-FAR, FAR))
    if far is not None and _agrees(far, C_ms) and not bracket[0] < far.delay < bracket[1]:
        return [finding("transfer.clock", delay=f"{far.delay:+.3f}",
                        sd=f"{max(far.delay_sd, 5e-4):.3f}", low=f"{bracket[0]:g}",
                        high=f"{bracket[1]:g}", cure=_set_right(far.delay))]  # fmt: skip
    for k, (name, cure) in enumerate(ANGLES.items()):
        angles = angles_of(said.C_nm)
        angles[:, k] *= -1.0
        mirrored = delay_of(increments, said.time, matrix_of(*angles.T), C_ms=C_ms,
                            bracket=bracket)  # fmt: skip
        if mirrored is not None and _agrees(mirrored, C_ms):
            return [finding("transfer.sense", angle=name, cure=cure,
                            likeness=f"{100 * mirrored.likeness:.0f} %")]  # fmt: skip
    return _mounted(increments, said, found, C_ms, bracket) or [
        *delay_checks.of_size(found, dt), *_mirrored(increments, said, C_ms, bracket)
    ]  # fmt: skip


def _set_right(delay: float) -> str:
    """Say what is to be done with stamps that are ahead by `delay` [s]."""
    size = f"{abs(delay):.3f} s"
    return f"take {size} from the master's stamps" if delay > 0 else (
        f"add {size} to the master's stamps")  # fmt: skip


def _mounted(
    increments: Increments, said: Messages, found: Delay, C_ms: FloatArray,
    bracket: tuple[float, float],
) -> list[Finding]:  # fmt: skip
    """Tell where both turn alike in another mounting."""
    other = delay_of(increments, said.time, said.C_nm, bracket=bracket)
    if other is None or other.likeness < ALIKE:
        return []
    angles = np.degrees(angles_of(other.C_ms))
    heading, pitch, roll = (angles + 180.0) % 360.0 - 180.0
    told = finding("transfer.mounting", heading=f"{heading:.1f}", pitch=f"{pitch:.1f}",
                   roll=f"{roll:.1f}", angle=f"{np.degrees(_off(other, C_ms)):.1f}")  # fmt: skip
    return [told, *delay_checks.of_size(other, float(np.median(increments.dt)))]


def _mirrored(
    increments: Increments, said: Messages, C_ms: FloatArray, bracket: tuple[float, float]
) -> list[Finding]:
    """Tell where the slave's gyros are a mirror image: a wrong sign, or two columns exchanged."""
    mirror = replace(increments, dtheta_b=-increments.dtheta_b)
    found = delay_of(mirror, said.time, said.C_nm, bracket=bracket)
    if found is None or found.likeness < ALIKE:
        return []
    C = -C_ms.T @ found.C_ms  # where the gyros point, in the axes of the nominal mounting
    return [finding("transfer.mirror", axes=delay_checks.signed_axes(C))]


def _off(found: Delay, C_ms: FloatArray) -> float:
    return float(np.linalg.norm(rotation_vector(C_ms.T @ found.C_ms)))


def _agrees(found: Delay, C_ms: FloatArray) -> bool:
    """Tell whether both turn alike, in a mounting near the nominal one."""
    sd = float(np.sqrt(np.trace(found.mu_cov)))
    return found.likeness >= ALIKE and _off(found, C_ms) < max(ASTRAY, SURELY * sd)
