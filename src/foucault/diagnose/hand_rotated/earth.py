"""Does the vertical part of the Earth's rotation have the sign that the site says?

Gravity read instead of specific force, both triads mirrored alike, or the latitude given with
the wrong sign: none of them shows in norms or turns, but all of them turn the vertical Earth
rate around. With the attitudes known up to heading, the mean rates at rest are linear in the
gyro bias, the two horizontal components and the vertical one; the last is estimated freely and
compared with ``w_ie sin L``.

A g-sensitivity that is alike about all axes adds ``k f``, which is upward too: where it is
estimated it takes up what a reversed sign does, ``k g = -2 w_ie sin L``, and the rate seen is the
one assumed. Then it is this size that is looked for.
"""

from __future__ import annotations

import numpy as np

from foucault.coefficients import CoefficientVector
from foucault.models.rests_and_turns import Attitudes, Session
from foucault.result import Check, Estimate, Level
from foucault.tables import AXES

VISIBLE = 4.0
"""The two signs are told apart when they lie this many standard deviations apart [1]."""

NEAR = 3.0
"""A g-sensitivity within this of what a reversed sign makes may well be that [sd]."""


def vertical_earth_rate(session: Session, state: Attitudes) -> tuple[float, float] | None:
    """Estimate the vertical Earth rate from the rests, with its sd from their own scatter.

    Parameters
    ----------
    session : Session
        What was observed [SI].
    state : Attitudes
        Model and attitudes of the solution.

    Returns
    -------
    (float, float) or None
        Vertical Earth rate, up positive, and its standard deviation [rad/s]; None where there
        are no gyros or too few rests.
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
    x, *_ = np.linalg.lstsq(rows, known)
    scatter = np.sum((known - rows @ x) ** 2) / (3 * n - 6)
    sd = np.sqrt(scatter * np.linalg.pinv(rows.T @ rows)[5, 5])
    return float(x[5]), float(sd)


def vertical_check(session: Session, estimate: Estimate) -> Check | None:
    """Test the sign of the vertical Earth rate, where the gyros can see it.

    Parameters
    ----------
    session : Session
        What was observed [SI].
    estimate : Estimate
        The solution.
    """
    want = float(session.earth[2])
    if session.gyro_mean is None or session.site.latitude is None:
        return None
    if "gyro.g_sensitivity.xx" in estimate.coefficients.layout:
        return _alike(estimate.coefficients, session.site.gravity, want)
    found = vertical_earth_rate(session, estimate.state)
    if found is None:
        return None
    value, sd = found
    if abs(want) < VISIBLE * sd / 2:
        return None
    fine = abs(value - want) <= abs(value + want)
    words = f"The vertical Earth rate is seen as {value * _UNIT:+.1f} +- {sd * _UNIT:.1f} deg/h"
    words += f", expected {want * _UNIT:+.1f}" + (
        "." if fine else f". Its sign is reversed: {_REVERSED}."
    )
    off, limit = (value - want) * _UNIT, abs(want) * _UNIT
    return Check("vertical Earth rate", off, -limit, limit, fine, words, Level.UNUSABLE)


_UNIT = np.degrees(1.0) * 3600

_REVERSED = (
    'the accelerometers read gravity instead of specific force (reads = "gravity"), both triads '
    "are mirrored alike, or the latitude has the wrong sign"
)


def _alike(found: CoefficientVector, gravity: float, want: float) -> Check | None:
    """Doubt a g-sensitivity that is what a reversed sign of the Earth's rate would make."""
    at = [found.layout.index(f"gyro.g_sensitivity.{a}{a}") for a in AXES]
    assert found.cov is not None
    value = gravity * float(found.values[at].mean())
    sd = gravity * float(np.sqrt(found.cov[np.ix_(at, at)].mean()))
    if not abs(want) >= VISIBLE * sd / 2:
        return None
    away = abs(value + 2 * want) / sd
    fine = away > NEAR
    words = (
        f"The g-sensitivity is {value * _UNIT:+.1f} +- {sd * _UNIT:.1f} deg/h per g alike about "
    )
    words += f"all axes; a reversed sign of the Earth's rate would make it {-2 * want * _UNIT:+.1f}"
    words += (
        "." if fine else f". It may well be that: {_REVERSED}. Set g_sensitivity = false to see."
    )
    return Check("vertical Earth rate", away, NEAR, None, fine, words)
