"""Does the vertical part of the Earth's rotation have the sign that the site says?

Gravity read instead of specific force, both triads mirrored alike, or the latitude given with
the wrong sign: none of them shows in norms or turns, but all of them turn the vertical Earth
rate around. With the attitudes known up to heading, the mean rates at rest are linear in the
gyro bias, the two horizontal components and the vertical one; the last is estimated freely and
compared with ``w_ie sin L``.

Where g-sensitivity is estimated it takes up what a reversed sign does, and it is looked for there:
see `diagnose.checks.reversed_earth_check`.
"""

from __future__ import annotations

import numpy as np

from foucault.diagnose.checks import REVERSED, VISIBLE, reversed_earth_check
from foucault.diagnose.words import check
from foucault.models.rests_and_turns import Attitudes, Session
from foucault.result import Check, Estimate, Level


def vertical_earth_rate(session: Session, state: Attitudes) -> tuple[float, float] | None:
    """Estimate the vertical Earth rate from the rests, with its sd from their own scatter.

    `session`: what was observed [SI]. Returns vertical Earth rate, up positive, and its standard
    deviation [rad/s]; None where there are no gyros or too few rests.
    """
    if session.gyro_mean is None or len(session.gyro_mean) < 4:
        return None
    model, n = state.model, len(session.gyro_mean)
    axes = model.gyro_matrix @ np.swapaxes(state.C_nb, 1, 2)  # columns: east, north, up
    rows = np.concatenate([np.broadcast_to(np.eye(3), (n, 3, 3)), axes], axis=2).reshape(-1, 6)
    f_b = session.site.gravity * state.C_nb[:, 2, :]
    known = (session.gyro_mean - f_b @ model.g_sensitivity.T).ravel()
    root = np.repeat(np.sqrt(session.rest_time), 3)
    rows, known = rows * root[:, None], known * root
    x, *_ = np.linalg.lstsq(rows, known, rcond=None)
    scatter = np.sum((known - rows @ x) ** 2) / (3 * n - 6)
    sd = np.sqrt(scatter * np.linalg.pinv(rows.T @ rows)[5, 5])
    return float(x[5]), float(sd)


def vertical_check(session: Session, estimate: Estimate) -> Check | None:
    """Test the sign of the vertical Earth rate, where the gyros can see it.

    `session`: what was observed [SI].
    """
    if "gyro.g_sensitivity.xx" in estimate.coefficients.layout:
        return reversed_earth_check(estimate.coefficients, session.site)
    found = vertical_earth_rate(session, estimate.state)
    if found is None or session.site.latitude is None:
        return None
    want = float(session.earth[2])
    value, sd = found
    if abs(want) < VISIBLE * sd / 2:
        return None
    unit = np.degrees(1.0) * 3600
    off, limit = (value * np.sign(want) - abs(want)) * unit, abs(want) * unit
    given = {"seen": value * unit, "sd": sd * unit, "want": want * unit, "cause": REVERSED}
    name = "vertical Earth rate"
    return check(name, name, off, -limit, limit, given, fails=Level.UNUSABLE)
