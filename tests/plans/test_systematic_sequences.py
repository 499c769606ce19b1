"""Sequences of systematic calibration: where every position points, times, attitudes, joins."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.models.rotation import cross_matrix, exp, log
from foucault.plans.manoeuvres import Rest, Rotate
from foucault.plans.sequence import (
    BUILT_IN,
    CalibrationSequence,
    action_sequences,
    built_in,
    gimbal_sequence,
    navigation_test,
    nine_positions,
    nineteen_positions,
    orientation,
    pointing,
    poses,
    quarter_turns,
    spin,
    spin_axis,
    turns_to,
)
from refusals import refuses

DEG = np.pi / 180

# Where x, y and z point in the nineteen positions, as published.
PUBLISHED = [
    ("U", "E", "N"), ("-N", "E", "U"), ("-U", "E", "-N"), ("N", "E", "-U"), ("-U", "E", "-N"),
    ("-N", "E", "U"), ("U", "E", "N"), ("E", "-U", "N"), ("E", "N", "U"), ("E", "U", "-N"),
    ("E", "-N", "-U"), ("E", "U", "-N"), ("E", "N", "U"), ("E", "-U", "N"), ("-U", "-E", "N"),
    ("-E", "U", "N"), ("-U", "-E", "N"), ("E", "-U", "N"), ("U", "E", "N"),
]  # fmt: skip


def test_the_nineteen_positions_point_where_they_were_published_to() -> None:
    sequence = nineteen_positions()
    assert [pointing(p.C_nb) for p in sequence.positions] == PUBLISHED
    assert sequence.duration == 3021.0
    assert sequence.turned == pytest.approx({"y": 540 * DEG, "z": 540 * DEG, "x": 540 * DEG})
    starts = [p.start for p in sequence.positions]
    assert starts == pytest.approx(np.arange(19) * 159.5, abs=1e-9)
    assert [p.end - p.start for p in sequence.positions] == pytest.approx(np.full(19, 150.0))
    assert [p.label for p in sequence.positions] == [f"P{k}" for k in range(1, 20)]
    assert [p.moves for p in sequence.positions] == list(range(19))
    peak = np.abs(sequence.at(np.arange(0.0, 3021.0, 0.01))[1]).max()
    assert peak == pytest.approx(10 * DEG, rel=1e-12)


@pytest.mark.parametrize("name", BUILT_IN)
def test_attitude_is_the_integral_of_the_rate(name: str) -> None:
    sequence = built_in(name)
    time = np.linspace(0.0, sequence.duration, 60_001)
    half = (time[1:] + time[:-1]) / 2
    C, w = sequence.at(time)[0], sequence.at(half)[1]
    step = np.swapaxes(C[:-1], 1, 2) @ C[1:]
    dt = time[1]
    # One rate in the middle: what is missing is a curved rate, in ramps.
    assert np.abs(log(step) - w * dt).max() < 0.03 * np.abs(w).max() * dt
    assert C[0] == pytest.approx(sequence.start, abs=1e-12)
    assert C[-1] == pytest.approx(sequence.attitudes[-1], abs=1e-9)
    assert np.abs(C @ np.swapaxes(C, 1, 2) - np.eye(3)).max() < 1e-12
    for p in sequence.positions:
        inside = (time > p.start) & (time < p.end)
        assert np.abs(C[inside] - p.C_nb).max() < 1e-12


@pytest.mark.parametrize("name", ["simple 6", "icosahedral 6"])
def test_a_spin_is_about_the_axis_of_its_pose(name: str) -> None:
    sequence = action_sequences(name, before=20.0)
    spins = [
        k for k, a in enumerate(sequence.actions) if isinstance(a, Rotate) and a.label[0] == "S"
    ]
    assert sequence.axis_b[spins] == pytest.approx(spin_axis(poses(name)), abs=1e-12)
    for k in spins:
        assert sequence.attitudes[k] == pytest.approx(sequence.attitudes[k + 1], abs=1e-12)
        assert sequence.actions[k].time == pytest.approx(200.5)  # ten turns at 18 deg/s and a ramp
        assert isinstance(sequence.actions[k - 1], Rest)
        assert sequence.actions[k + 1].time == 200.0


def test_gimbals_turn_the_inner_axis_in_the_outer_one() -> None:
    angles = np.array([[10, 20], [50, -70], [50, 100], [-90, 100]]) * DEG
    start = orientation("UEN")
    sequence = gimbal_sequence(angles, start=start, rest=30.0)
    for p, (outer, inner) in zip(sequence.positions, angles, strict=True):
        C = exp(np.array([outer, 0, 0])) @ start @ exp(np.array([0, 0, inner]))
        assert p.C_nb == pytest.approx(C, abs=1e-12)
    assert [p.moves for p in sequence.positions] == [0, 2, 3, 4]


@pytest.mark.parametrize("seed", range(4))
def test_turns_lead_from_one_attitude_to_another(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = exp(rng.standard_normal((2, 3)))
    C = a
    for turn in turns_to(a, b):
        C = C @ exp(np.eye(3)["xyz".index(turn.axis)] * turn.angle)
    assert np.abs(C - b).max() < 1e-12
    assert turns_to(a, a) == ()


def test_sequences_are_joined_by_the_turns_between_them() -> None:
    first, second = nineteen_positions(), action_sequences()
    both = first.then(second)
    k = len(both) - len(second)
    assert both.attitudes[k] == pytest.approx(second.start, abs=1e-12)
    assert both.attitudes[-1] == pytest.approx(second.attitudes[-1], abs=1e-9)
    between = both.actions[len(first) : k]
    assert [abs(a.angle) for a in between] == pytest.approx([90 * DEG] * 2)
    assert both.duration == pytest.approx(first.duration + 19.0 + second.duration)
    assert first.then(first).actions == first.actions * 2


@pytest.mark.parametrize("rate", [7.0, 50.0, 200.0])
def test_actions_begin_on_samples(rate: float) -> None:
    told = nineteen_positions(rest=20.123).then(action_sequences("icosahedral 6"))
    small = CalibrationSequence("small", told.start, (*told.actions, Rotate("x", 0.01, 0.2)))
    sequence = small.on_samples(rate)
    assert sequence.times * rate == pytest.approx(np.round(sequence.times * rate), abs=1e-6)
    assert sequence.attitudes == pytest.approx(small.attitudes, abs=1e-12)
    longer = np.diff(sequence.times) - np.diff(small.times)
    assert longer.min() > -1e-8
    assert longer.max() < 1 / rate
    again = sequence.on_samples(rate)
    assert again.times == pytest.approx(sequence.times, abs=1e-8)


def test_names_of_directions() -> None:
    assert orientation(["up", "East", "-s"]) == pytest.approx(orientation("UEN"))
    assert pointing(orientation("wsu")) == ("-E", "-N", "U")
    assert pointing(exp(np.array([0.0, 0.0, -30 * DEG])))[:2] == ("120.0/+0.0 deg", "30.0/+0.0 deg")


def test_navigation_test_starts_and_turns_as_published() -> None:
    sequence = navigation_test("north")
    assert pointing(sequence.start) == ("U", "E", "N")
    assert sequence.axis_b[1] == pytest.approx([0, 0, 1])
    assert sequence.actions[1].angle == pytest.approx(3600 * DEG)
    assert sequence.positions[-1].end - sequence.positions[-1].start == 500.0


@pytest.mark.parametrize(
    ("make", "code", "words"),
    [
        (lambda: CalibrationSequence("a", np.eye(3), (spin("north", 1, 1.0),)), "sequence.empty",
         "'a' has no rest"),
        (lambda: CalibrationSequence("a", -np.eye(3), (Rest(1.0),)), "sequence.start",
         "not a right-handed rotation"),
        (lambda: CalibrationSequence("a", np.eye(2), (Rest(1.0),)), "sequence.start", "'a' is"),
        (lambda: orientation(["up", "north", "east"]), "sequence.directions",
         "cannot point to up, north, east"),
        (lambda: orientation(["up", "upp", "east"]), "sequence.directions", "upp"),
        (lambda: gimbal_sequence(np.zeros((2, 3))), "sequence.gimbal", r"shape \(2, 3\)"),
        (lambda: action_sequences(turns=1.5), "sequence.turns", "1.5 turns"),
        (lambda: built_in("19 position"), "sequence.unknown", "Did you mean '19 positions'"),
        (lambda: quarter_turns("a", "UEN", "+q"), "manoeuvre.axis", "'q'"),
    ],
)  # fmt: skip
def test_what_is_refused(make, code: str, words: str) -> None:
    with refuses(code, match=words):
        make()


# -- the nine positions see all ----------------------------------------------------------------

G = 9.8
EARTH = 7.292e-5 * np.array([0.0, np.cos(0.6), np.sin(0.6)])
# Before: three tilts, then bias, scale and misalignment of the gyros, the same of accelerometers.
BEFORE = np.concatenate(
    [[3e-4, 3e-4, 3e-3], np.full(3, 1e-7), np.full(9, 5e-4), np.full(3, 2e-3), np.full(6, 2e-4),
     np.full(3, 5e-4)]
)  # fmt: skip


def remaining(sequence: CalibrationSequence) -> np.ndarray:
    """Return the sd of the 24 errors after a sequence: rests read f in n, turns add up errors."""
    P = np.diag(BEFORE**2)
    steps = [
        (sequence.times[k] + action.time * i / n, action.time / n, n > 1)
        for k, action in enumerate(sequence.actions)
        for n in (6 if isinstance(action, Rest) else 1,)
        for i in range(n)
    ]
    for start, length, still in steps:
        C, w = sequence.at(start + length * (np.arange(80) + 0.5) / 80)
        w = w + np.swapaxes(C, 1, 2) @ EARTH
        F = np.eye(27)
        F[:3, :3] -= cross_matrix(EARTH) * length
        F[:3, 3:6] = -C.mean(axis=0) * length
        F[:3, 6:15] = -np.einsum("nij,nk->nijk", C, w).mean(axis=0).reshape(3, 9) * length
        P = F @ P @ F.T
        P[:3, :3] += np.eye(3) * (2e-7) ** 2 * length
        if not still:
            continue
        f = C[0].T @ [0.0, 0.0, G]
        H = np.zeros((3, 27))
        H[:, :3], H[:, 15:18] = cross_matrix(np.array([0.0, 0.0, G])), C[0]
        for i in range(3):
            H[:, (18 if f[i] > 0 else 21) + i] = C[0][:, i] * f[i]
        for q, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
            H[:, 24 + q] = C[0][:, i] * f[j]
        S = H @ P @ H.T + np.eye(3) * (5e-5) ** 2 / length
        P = P - P @ H.T @ np.linalg.solve(S, H @ P)
    return np.sqrt(np.diag(P))[3:]


def test_the_nine_positions_see_all_that_the_nineteen_see() -> None:
    nine, nineteen = nine_positions(), nineteen_positions()
    assert len(nine.positions) == 9
    assert nine.duration < 0.5 * nineteen.duration
    ratio = remaining(nine) / remaining(nineteen)
    assert ratio.max() < 2.5
    quarter = quarter_turns("z only", "ENU", "+z +z +z +z +z +z +z +z")
    assert (remaining(quarter) / remaining(nineteen)).max() > 100
