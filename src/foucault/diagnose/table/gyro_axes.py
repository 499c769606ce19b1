"""Do gyros and accelerometers on a table speak of the same axes?

The mean rate over whole turns of a spin lies along up, as the mean specific force does, in the
sense in which the table turned. Where it does not, every signed exchange of gyro axes is tried; if
one of them explains the spins, and no other does, it is named. Only directions count: scale factor
errors and misalignments turn them by a degree, an exchange by many.
"""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.axes import Match, exchange_words, exchanges
from foucault.errors import error
from foucault.models.readings import Readings
from foucault.tables import AXES

SUSPICIOUS = np.radians(20.0)
"""A miss of up that no calibration error explains, rms [rad]."""

FITS = np.radians(5.0)
"""A miss of up that calibration errors explain, rms [rad]."""

MOST = 0.85
"""So many of the spins have to agree; the sense of some may be unknown [1]."""

SLOW = 20.0
"""Spins slower than this multiple of the rates at rest tell no directions [1]."""


def explain_spins(f: FloatArray, w: FloatArray, h: FloatArray) -> list[Match]:
    """Compare the directions of rates and specific forces under all exchanges of gyro axes.

    `f` (n, 3): mean specific force of each spin [m/s^2]; `w` (n, 3): mean rate of each spin,
    without bias [rad/s]; `h` (n,): rate of the table, positive counter-clockwise seen from above
    [rad/s]. Returns the gyro axes as declared first, then the 48 exchanges, the best first [1].
    """
    up = np.sign(h)[:, None] * _unit(f)
    axis = _unit(w)
    keep = max(1, round(MOST * len(h)))

    def match(exchange: FloatArray, most: int) -> Match:
        cosine = np.clip(np.sum((axis @ exchange.T) * up, axis=1), -1.0, 1.0)
        angle = np.sort(np.arccos(cosine))[:most]
        return Match(float(np.sqrt(np.mean(angle**2))), exchange, 1.0)

    tried = sorted((match(exchange, keep) for exchange in exchanges()), key=lambda m: m.miss)
    return [match(np.eye(3), len(h)), *tried]


def _unit(x: FloatArray) -> FloatArray:
    return np.asarray(x / np.maximum(np.linalg.norm(x, axis=1), 1e-300)[:, None])


def check_gyro_axes(readings: Readings) -> None:
    """Refuse readings whose gyro axes are exchanged or of the wrong sign.

    All three gyros reversed look like a table that turns the other way and are left to the check
    of its sense.

    `readings`: one mean per rest and spin, the rates with the sense that the table or the plan
    says [SI]. Raises an exchange of gyro axes explains the spins, and the declared axes do not.
    """
    spin = readings.spin
    if readings.gyro is None or readings.accel is None or not spin.any():
        return
    rest = readings.gyro[~spin]
    bias = np.median(rest, axis=0) if len(rest) else np.zeros(3)
    w = readings.gyro[spin] - bias
    still = float(np.median(np.linalg.norm(rest - bias, axis=1))) if len(rest) else 0.0
    if np.median(np.linalg.norm(w, axis=1)) < SLOW * still:
        return
    declared, best, second = explain_spins(readings.accel[spin], w, readings.rate[spin])[:3]
    # Written so that a miss that is not a number is no explanation.
    if not (declared.miss >= SUSPICIOUS and best.miss <= FITS and second.miss >= SUSPICIOUS):
        return
    exchange = best.exchange
    if np.array_equal(np.abs(exchange), np.eye(3)) and abs(np.trace(exchange)) == 3:
        return  # as declared but for some spins, or all reversed
    left_handed = np.linalg.det(exchange) < 0
    raise error(
        "spin.left_handed" if left_handed else "spin.axes",
        what=plainly(exchange),
        exchange=exchange_words(exchange),
        declared=f"{np.degrees(declared.miss):.0f}",
        better=f"{np.degrees(best.miss):.1f}",
    )


def plainly(exchange: FloatArray) -> str:
    """Say in words what an exchange of gyro axes does.

    `exchange` (3, 3): signed permutation that takes the gyro columns to body axes [1].
    """
    order = np.argmax(np.abs(exchange), axis=1)
    moved = [AXES[i] for i in np.flatnonzero(order != np.arange(3))]
    reversed_ = [AXES[k] for i, k in enumerate(order) if exchange[i, k] < 0]
    words = []
    if len(moved) == 2:
        words.append(f"gyro {moved[0]} and {moved[1]} are exchanged")
    elif moved:
        words.append("the gyro axes are exchanged in a circle")
    if reversed_:
        verb = "are" if len(reversed_) > 1 else "is"
        words.append(f"gyro {' and '.join(reversed_)} {verb} reversed")
    return ", ".join(words)
