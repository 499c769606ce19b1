"""The sequences of systematic calibration that are built in, and how to make others.

References
----------
.. [1] B. Xie, "Systematic calibration of strapdown inertial measurement units", 2011: nineteen
   positions, reached by quarter turns about body axes.
.. [2] Wu, Chen, Yan, Yuan, Guan, "Calibration and compensation of gyro sensitive-axis deflection
   under continuous rotation", Navigation and Control 2023(5): six action sequences of a spin
   about North, and the navigation test.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from math import pi

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error, suggestion
from foucault.models.rotation import exp
from foucault.plans.manoeuvres import Rest, Rotate
from foucault.plans.systematic.sequence import (
    RAMP,
    RATE,
    REST,
    Action,
    CalibrationSequence,
    orientation,
    spin,
)
from foucault.plans.systematic.spin_poses import poses

SPIN_RATE = 18.0 * pi / 180.0
"""Rate of the published spins: ten turns in 200 s [rad/s]."""

_NINETEEN = "+y +y +y -y -y -y +z +x +x +x -x -x -x +z +z -z -z -z"
_NINE = "-2x +2z -y +2y +z -2x -y -2z"


def quarter_turns(
    name: str,
    start: Iterable[str],
    turns: str,
    *,
    rest: float = REST,
    rate: float = RATE,
    ramp: float = RAMP,
) -> CalibrationSequence:
    """Return rests with quarter turns about body axes between them.

    `start`: where x, y and z point at first, such as "UEN"; `turns`: axis and sense of each turn,
    such as "+y -x", a half turn is "+2y"; `rest`: length of each rest [s]; `rate`: rate of the
    turns [rad/s]; `ramp`: growth of the rate, and its fading [s].
    """
    actions: list[Action] = [Rest(rest, "P1")]
    for k, word in enumerate(turns.split(), 2):
        quarters = int(word[1:-1] or 1) * (-1 if word[0] == "-" else 1)
        turn = Rotate(word[-1], quarters * pi / 2, rate, ramp, f"to P{k}")
        actions += [turn, Rest(rest, f"P{k}")]
    return CalibrationSequence(name, orientation(start), tuple(actions))


def nineteen_positions(
    *, rest: float = REST, rate: float = RATE, ramp: float = RAMP
) -> CalibrationSequence:
    """Return the nineteen positions of ref. [1]: 3021 s with the defaults.

    `rest`: length of each rest [s]; `rate`: rate of the turns [rad/s]; `ramp`: growth of the
    rate, and its fading [s].
    """
    name = "19 positions"
    return quarter_turns(name, "UEN", _NINETEEN, rest=rest, rate=rate, ramp=ramp)


def nine_positions(
    *, rest: float = REST, rate: float = RATE, ramp: float = RAMP
) -> CalibrationSequence:
    """Return nine positions: our own, the best found among chains of eight quarter or half turns.

    `rest`: length of each rest [s]; `rate`: rate of the turns [rad/s]; `ramp`: growth of the
    rate, and its fading [s].

    Sought was the least of the largest ratio of a coefficient's sd to that of the nineteen
    positions, rests as long, over the 24 errors of the instrument: 2.0, in half of the time.
    """
    return quarter_turns("9 positions", "ENU", _NINE, rest=rest, rate=rate, ramp=ramp)


def gimbal_moves(
    before: FloatArray, after: FloatArray, *, rate: float = RATE, ramp: float = RAMP
) -> list[Action]:
    """Return the moves of a gimbal from one pair of angles to another: inner, then outer.

    The inner axis is z of the body, the outer one East; both senses are counter-clockwise.

    `before`, `after` (2,): outer and inner angle [rad]; `rate`: rate of the moves [rad/s];
    `ramp`: growth of the rate, and its fading [s].
    """
    (outer, inner) = np.asarray(after, float) - np.asarray(before, float)
    moves = (("z", inner, "inner"), ("east", outer, "outer"))
    return [Rotate(axis, float(a), rate, ramp, label) for axis, a, label in moves if abs(a) > 1e-9]


def gimbal_sequence(
    angles: FloatArray,
    *,
    name: str = "gimbal positions",
    start: FloatArray | None = None,
    rest: float = REST,
    rate: float = RATE,
    ramp: float = RAMP,
) -> CalibrationSequence:
    """Return rests at pairs of angles of a two-axis gimbal.

    ``C_nb = R_E(outer) C_nb(0, 0) R_z(inner)``: the outer axis points East, the inner one is z of
    the body.

    `angles` (n, 2): outer and inner angle of each position [rad]; `start` (3, 3): C_nb where both
    angles are zero, None for x east, y north, z up [1]; `rest`: length of each rest [s]; `rate`:
    rate of the moves [rad/s]; `ramp`: growth of the rate, and its fading [s].
    """
    angles = np.atleast_2d(np.asarray(angles, float))
    if angles.ndim != 2 or angles.shape[1] != 2 or not np.isfinite(angles).all():
        raise error("sequence.gimbal", name=name, given=f"shape {angles.shape}")
    actions: list[Action] = [Rest(rest, "P1")]
    for k in range(1, len(angles)):
        actions += gimbal_moves(angles[k - 1], angles[k], rate=rate, ramp=ramp)
        actions.append(Rest(rest, f"P{k + 1}"))
    return CalibrationSequence(name, _gimbal(angles[0], start), tuple(actions))


def _gimbal(angles: FloatArray, start: FloatArray | None) -> FloatArray:
    outer, inner = angles
    zero = np.eye(3) if start is None else np.asarray(start, float)
    return exp(np.array([outer, 0.0, 0.0])) @ zero @ exp(np.array([0.0, 0.0, inner]))


def action_sequences(
    angles: str | FloatArray = "simple 6",
    *,
    about: str = "north",
    turns: int = 10,
    spin_rate: float = SPIN_RATE,
    before: float = 0.0,
    rest: float = 200.0,
    rate: float = RATE,
    ramp: float = RAMP,
) -> CalibrationSequence:
    """Return the action sequences of ref. [2]: to each pose with the gimbals, a spin, a rest.

    `angles` (n, 2): name of a set of poses, see `plans.systematic.spin_poses`, or angle a about z
    and b about East of each [rad]; `turns`: turns of each spin: whole ones, or the gimbals' outer
    axis would not be East after it [1]; `spin_rate`: rate of the spins [rad/s]; `before`, `rest`:
    length of the rest before each spin (0: none) and after it [s]; `rate`: rate of the gimbals
    [rad/s]; `ramp`: growth of each rate, and its fading [s].
    """
    if turns < 1 or turns != int(turns):
        raise error("sequence.turns", given=turns)
    name = f"spins, {angles}" if isinstance(angles, str) else f"spins, {len(angles)} poses"
    pairs = poses(angles) if isinstance(angles, str) else np.atleast_2d(angles)
    pairs, now = np.asarray(pairs)[:, ::-1], np.zeros(2)
    actions: list[Action] = []
    for k, pair in enumerate(pairs, 1):
        actions += gimbal_moves(now, pair, rate=rate, ramp=ramp)
        if before > 0:
            actions.append(Rest(before, f"before S{k}"))
        actions += [spin(about, turns, spin_rate, ramp=ramp, label=f"S{k}"), Rest(rest, f"S{k}")]
        now = pair
    return CalibrationSequence(name, np.eye(3), tuple(actions))


def navigation_test(
    about: str = "east",
    *,
    before: float = 300.0,
    turns: int = 10,
    spin_rate: float = SPIN_RATE,
    rest: float = 500.0,
) -> CalibrationSequence:
    """Return the navigation test of ref. [2]: x up, y east, z north; a spin, then a long rest.

    `before`: length of the rest before it, for alignment [s]; `turns`: turns of the spin [1];
    `spin_rate`: its rate [rad/s]; `rest`: length of the rest after it [s].
    """
    actions = (
        Rest(before, "alignment"), spin(about, turns, spin_rate, label="spin"), Rest(rest, "rest")
    )  # fmt: skip
    return CalibrationSequence(f"navigation test about {about}", orientation("UEN"), actions)


BUILT_IN: dict[str, Callable[[], CalibrationSequence]] = {
    "19 positions": nineteen_positions,
    "9 positions": nine_positions,
    "spins, simple 6": lambda: action_sequences("simple 6"),
    "spins, face diagonals 6": lambda: action_sequences("face diagonals 6"),
    "spins, icosahedral 6": lambda: action_sequences("icosahedral 6"),
    "navigation test about east": lambda: navigation_test("east"),
    "navigation test about north": lambda: navigation_test("north"),
}
"""The sequences by name, with their usual times."""


def built_in(name: str) -> CalibrationSequence:
    """Return the sequence called `name`, one of `BUILT_IN`."""
    if name not in BUILT_IN:
        raise error(
            "sequence.unknown", name=name, hint=suggestion(name, BUILT_IN),
            allowed=", ".join(BUILT_IN),
        )  # fmt: skip
    return BUILT_IN[name]()
