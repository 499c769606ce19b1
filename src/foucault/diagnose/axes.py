"""Do gyros and accelerometers speak of the same axes, and of the same unit of angle?

Between two rests the direction of gravity in the body turns as the gyros say. Where it does
not, every signed exchange of gyro axes and every usual mistake of unit is tried; if one of them
explains the turns, it is named.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.errors import FoucaultError, error
from foucault.kernels.rotation import integrate_turns
from foucault.tables import AXES, Log

ARCSEC = 3600.0
"""Seconds of arc in a degree [1]."""

SUSPICIOUS = np.radians(10.0)
"""A miss of the direction of gravity that no calibration error explains, rms [rad]."""

BETTER, WELL = 0.35, 0.1
"""An exchange is blamed when it reduces the miss to the first part, even where gyros are saturated
when it is to the second [1]."""


@dataclass(frozen=True)
class Match:
    """How well an exchange of axes and a change of unit explain the turns."""

    miss: float  # root mean square angle between predicted and observed up [rad]
    exchange: FloatArray  # (3, 3) signed permutation that takes the gyro columns to body axes [1]
    scale: float  # factor that takes the declared rate to the true one [1]


def exchanges() -> list[FloatArray]:
    """Return the 48 signed permutations of three axes, the identity first, each shape (3, 3)."""
    out = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            exchange = np.zeros((3, 3))
            exchange[np.arange(3), order] = signs
            out.append(exchange)
    return out


def exchange_words(exchange: FloatArray) -> str:
    """Return an exchange of axes as text, body axis = declared column.

    `exchange` (3, 3): signed permutation that takes the declared columns to body axes [1].
    """
    return ", ".join(
        f"{AXES[i]} = {'-' if row[k] < 0 else '+'}{AXES[k]}"
        for i, row in enumerate(exchange)
        for k in np.flatnonzero(row)
    )


def _miss(
    log: Log, rate: FloatArray, up_b: FloatArray, first: IntArray, last: IntArray
) -> tuple[float, FloatArray]:
    zero = np.zeros((3, 3))
    C_se, *_ = integrate_turns(log.time, rate, rate, zero, first, last, log.sampled == "increment")
    predicted = np.einsum("nji,nj->ni", C_se, up_b[:-1])
    angle = np.arccos(np.clip(np.sum(predicted * up_b[1:], axis=1), -1, 1))
    return float(np.sqrt(np.mean(angle**2))), angle


def explain_turns(
    log: Log, up_b: FloatArray, bias: FloatArray, first: IntArray, last: IntArray
) -> tuple[Match, Match]:
    """Compare the turns as the gyros tell them with the change of gravity.

    `log`: readings [SI]; `up_b` (n, 3): direction of up at each rest, from the accelerometers,
    frame b [1]; `bias` (3,): mean rate at rest [rad/s]; `first`, `last` (n - 1,): first and last
    sample of each turn. Returns `best`: the exchange and unit that explain the turns best (the
    same object where nothing is suspicious).
    """
    assert log.gyro is not None
    rate = log.gyro - bias
    miss, _ = _miss(log, rate, up_b, first, last)
    declared = Match(miss, np.eye(3), 1.0)
    if miss < SUSPICIOUS:
        return declared, declared
    best = declared
    for tried in _tried(log, rate, up_b, first, last):
        if tried.miss < best.miss * 0.999:
            best = tried
    return declared, best


def as_good(
    log: Log, up_b: FloatArray, bias: FloatArray, first: IntArray, last: IntArray, best: Match
) -> list[Match]:
    """Return every exchange and unit that explains the turns as well as `best`, itself included.

    `log`: readings [SI]; `up_b` (n, 3): direction of up at each rest, frame b [1]; `bias` (3,):
    mean rate at rest [rad/s]; `first`, `last` (n - 1,): first and last sample of each turn.
    """
    assert log.gyro is not None
    every = _tried(log, log.gyro - bias, up_b, first, last)
    return [tried for tried in every if tried.miss < best.miss + SUSPICIOUS]


def _tried(
    log: Log, rate: FloatArray, up_b: FloatArray, first: IntArray, last: IntArray
) -> Iterator[Match]:
    for scale in (1.0, 180 / np.pi, np.pi / 180, ARCSEC, 1 / ARCSEC, log.rate, log.interval):
        for exchange in exchanges():
            miss, _ = _miss(log, scale * rate @ exchange.T, up_b, first, last)
            yield Match(miss, exchange, scale)


def mistake(log: Log, declared: Match, best: Match) -> FoucaultError | None:
    """Put the better explanation of the turns in words, or return None where there is none.

    `log`: readings [SI].
    """
    clipped = [f.message for f in log.findings if f.code == "log.saturated" and "gyro" in f.message]
    if clipped and declared.miss >= SUSPICIOUS and not best.miss <= WELL * declared.miss:
        return error("gyro.saturated", declared=f"{np.degrees(declared.miss):.0f}",
                     where=" ".join(clipped))  # fmt: skip
    # Written so that a miss that is not a number is no explanation.
    if not (declared.miss >= SUSPICIOUS and best.miss <= BETTER * declared.miss):
        return None
    numbers = {
        "declared": f"{np.degrees(declared.miss):.0f}",
        "better": f"{np.degrees(best.miss):.1f}",
    }
    if not np.array_equal(best.exchange, np.eye(3)):
        words = exchange_words(best.exchange)
        left_handed = np.linalg.det(best.exchange) < 0
        code = "gyro.left_handed" if left_handed else "gyro.axes"
        if np.array_equal(best.exchange, -np.eye(3)):
            code = "gyro.reversed"
        return error(code, exchange=words, **numbers)
    causes = {
        180 / np.pi: ("rad/s", "deg/s", "the gyro unit is rad/s and was declared as deg/s"),
        np.pi / 180: ("deg/s", "rad/s", "the gyro unit is deg/s and was declared as rad/s"),
        1 / ARCSEC: ("", "", "the gyro unit is arcsec/s and was declared as deg/s"),
        ARCSEC: ("", "", "the gyro unit is deg/s and was declared as arcsec/s"),
        log.rate: ("", "", "the gyro columns are increments and were declared as rates"),
        log.interval: ("", "", "the gyro columns are rates and were declared as increments"),
    }
    return error("gyro.unit", factor=f"{best.scale:.4g}", cause=causes[best.scale][2], **numbers)
