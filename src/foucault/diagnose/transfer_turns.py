"""What the turning of slave and master says of mounting, heading and clocks."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from foucault.errors import Finding, finding
from foucault.estimate.delay import Delay, delay_of
from foucault.models.attitude import angles_of, matrix_of
from foucault.models.rotation import log as rotation_vector
from foucault.models.transfer import Messages
from foucault.navigate.increments import Increments

FloatArray = npt.NDArray[np.float64]

ALIKE = 0.9
"""Of what a slave turns on its master, the master turns at least so much too, as a variance [1]."""

ASTRAY = np.radians(3.0)
"""A mounting that is so far from the nominal one is told [rad]."""

SURELY = 5.0
"""If it is so many standard deviations [1]."""


def turning(
    increments: Increments, said: Messages, found: Delay | None, C_ms: FloatArray,
    bracket: tuple[float, float],
) -> list[Finding]:  # fmt: skip
    """Return what contradicts mounting and sense of the heading.

    Parameters
    ----------
    increments : Increments
        The slave.
    said : Messages
        The master.
    found : Delay or None
        What rate matching has found from the nominal mounting.
    C_ms : ndarray, shape (3, 3)
        Nominal mounting [1].
    bracket : (float, float)
        Where the delay was looked for [s].
    """
    if found is None or _agrees(found, C_ms):
        return []
    heading, pitch, roll = angles_of(said.C_nm).T
    mirrored = delay_of(increments, said.time, matrix_of(-heading, pitch, roll), C_ms=C_ms,
                        bracket=bracket)  # fmt: skip
    if mirrored is not None and _agrees(mirrored, C_ms):
        return [finding("transfer.sense", likeness=f"{100 * mirrored.likeness:.0f} %",
                        angle=f"{np.degrees(_off(found, C_ms)):.0f}")]  # fmt: skip
    found = delay_of(increments, said.time, said.C_nm, bracket=bracket)
    if found is None or found.likeness < ALIKE:
        return []
    angles = np.degrees(angles_of(found.C_ms))
    heading, pitch, roll = (angles + 180.0) % 360.0 - 180.0
    return [finding("transfer.mounting", heading=f"{heading:.1f}", pitch=f"{pitch:.1f}",
                    roll=f"{roll:.1f}", angle=f"{np.degrees(_off(found, C_ms)):.1f}")]  # fmt: skip


def _off(found: Delay, C_ms: FloatArray) -> float:
    return float(np.linalg.norm(rotation_vector(C_ms.T @ found.C_ms)))


def _agrees(found: Delay, C_ms: FloatArray) -> bool:
    """Tell whether both turn alike, in a mounting near the nominal one."""
    sd = float(np.sqrt(np.trace(found.mu_cov)))
    return found.likeness >= ALIKE and _off(found, C_ms) < max(ASTRAY, SURELY * sd)
