"""Rests and turns of a systematic calibration, found in its log and held against the sequence."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from foucault.detect.sequence import find_sequence, net_rotation
from foucault.diagnose.systematic_sequence import match_sequence, recognised
from foucault.errors import FoucaultError
from foucault.models.earth import earth_rate_n
from foucault.models.imu import ImuModel
from foucault.models.rotation import exp, log
from foucault.plans.manoeuvres import Rest, Rotate
from foucault.plans.sequence import (
    CalibrationSequence,
    action_sequences,
    nine_positions,
    nineteen_positions,
    orientation,
    quarter_turns,
    spin,
)
from foucault.simulate.systematic import TableErrors
from make_sequence import ARCSEC, DEG, DPH, SITE, simulated, third_party
from refusals import refuses

BOTH = nineteen_positions(rest=40.0).then(action_sequences(rest=40.0, turns=2))


def codes(findings) -> list[str]:
    return [f.code for f in findings]


def relabelled(sequence: CalibrationSequence, names: dict[str, str]) -> CalibrationSequence:
    actions = tuple(
        replace(a, axis=names.get(a.axis, a.axis)) if isinstance(a, Rotate) else a
        for a in sequence.actions
    )
    return replace(sequence, actions=actions)


@pytest.mark.parametrize("noisy", [True, False])
def test_rests_and_turns_are_found_without_a_sequence(noisy: bool) -> None:
    more = {} if noisy else {"noise": None}
    session = simulated(BOTH, table=TableErrors(300 * ARCSEC), **more)
    found = find_sequence(session.log)
    assert found.findings == ()
    assert found.still.all()
    assert len(found.rests) == len(BOTH.positions)
    rests = zip(found.rests.first, found.rests.last, session.told.positions, strict=True)
    for a, b, p in rests:
        start, end = session.log.time[[a, b - 1]]
        assert p.start - 1e-9 <= start <= p.start + 1.0
        assert p.end - 1.0 <= end <= p.end + 1e-9
    matched = match_sequence(found, BOTH)
    assert matched.findings == ()
    assert matched.rests.tolist() == list(range(25))
    done = [a.angle for a in session.sequence.actions if isinstance(a, Rotate)]
    told = [a.angle for a in BOTH.actions if isinstance(a, Rotate)]
    assert matched.angle_err == pytest.approx(np.abs(done) - np.abs(told), abs=0.15 * DEG)
    C = np.array([p.C_nb for p in session.sequence.positions])
    miss = log(np.swapaxes(found.C_0k, 1, 2) @ C[0].T @ C)
    assert np.linalg.norm(miss, axis=1).max() < 0.02 * DEG
    assert recognised(find_sequence(session.log[: 940 * 50])) == "19 positions"
    assert recognised(found) is None


def test_the_earth_and_a_bias_are_told_apart() -> None:
    model = ImuModel(gyro_bias=np.array([3.0, -2.0, 1.0]) * DPH)
    session = simulated(nine_positions(rest=60.0), model=model)
    found = find_sequence(session.log)
    truth = session.sequence.start.T @ earth_rate_n(SITE.latitude)
    assert found.earth_b == pytest.approx(truth, abs=0.1 * DPH)


def test_net_rotation_is_the_product() -> None:
    d = 0.1 * np.random.default_rng(0).standard_normal((13, 3))
    C = np.eye(3)
    for row in d:
        C = C @ exp(row)
    assert net_rotation(d) == pytest.approx(C, abs=1e-14)
    assert net_rotation(d[:0]) == pytest.approx(np.eye(3))


# -- rests that move ---------------------------------------------------------------------------


def creeping(axis: str, rate: float) -> CalibrationSequence:
    """Return nineteen positions of 60 s, the ninth of which creeps."""
    actions = list(nineteen_positions(rest=60.0).actions)
    actions[16] = Rotate(axis, rate * 59.5, rate, 0.5, "creep")
    return CalibrationSequence("creeping", orientation("UEN"), tuple(actions))


@pytest.mark.parametrize(
    ("axis", "rate", "words"),
    [
        ("up", 10 * DPH, r"it turns at 10(\.\d)? deg/h"),  # invisible to accelerometers
        ("east", 10 * DPH, "it tilts by 4.. arcsec"),
        ("north", 0.02 * DEG, "it tilts by .* and it turns at 7. deg/h"),
    ],
)
def test_a_rest_that_creeps_is_named_and_left_out(axis: str, rate: float, words: str) -> None:
    sequence = creeping(axis, rate)
    session = simulated(sequence)
    found = find_sequence(session.log)
    assert codes(found.findings) == ["systematic.rest_moves"]
    assert np.flatnonzero(~found.still).tolist() == [8]
    assert re.search(words, found.findings[0].message), found.findings[0].message
    start, _ = session.told.times[16:18]
    assert f"from {start:.0f}." in found.findings[0].message


def test_a_slow_rest_at_the_edge_of_noise_is_no_finding() -> None:
    for seed in range(3):
        found = find_sequence(simulated(creeping("up", 0.2 * DPH), seed=seed).log)
        assert found.findings == ()


def test_a_bump_in_a_rest_is_named() -> None:
    told = quarter_turns("told", "UEN", "+x +y -z +x", rest=40.0)
    bump = (Rest(15.0), Rotate("x", 0.5 * DEG, 2 * DEG, 0.2), Rest(24.0))
    done = replace(told, actions=(*told.actions[:4], *bump, *told.actions[5:]))
    session = simulated(done)
    found = find_sequence(session.log)
    (said,) = found.findings
    assert said.code == "systematic.bump"
    angle = float(said.message.split("moved by ")[1].split(" arcsec")[0])
    assert angle == pytest.approx(1800, abs=20)
    matched = match_sequence(found, told)
    a, b = found.rests.first[matched.rests[2]], found.rests.last[matched.rests[2]]
    assert session.log.time[b] - session.log.time[a] == pytest.approx(24.0, abs=1.0)


# -- mistakes ----------------------------------------------------------------------------------


def test_a_wrong_start_is_refused() -> None:
    done = quarter_turns("done", "ENU", "+x +y +z", rest=20.0)
    told = quarter_turns("told", "UEN", "+x +y +z", rest=20.0)
    found = find_sequence(simulated(done).log)
    with refuses(
        "systematic.start",
        match=r"x, y, z to U, E, N, so that x of the body is up; .* has z up, 90 deg",
    ):
        match_sequence(found, told)


@pytest.mark.parametrize("angle", [-60.0, 20.0, 170.0])
def test_a_wrong_heading_is_measured(angle: float) -> None:
    done = replace(BOTH, start=exp(np.array([0, 0, -angle * DEG])) @ BOTH.start)
    done = replace(done, actions=nineteen_positions(rest=40.0).actions)
    found = find_sequence(simulated(done).log)
    (said,) = match_sequence(found, nineteen_positions(rest=40.0)).findings
    assert said.code == "systematic.heading"
    measured = float(said.message.split(" was ")[1].split(" deg")[0])
    assert measured == pytest.approx(angle, abs=1.5)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ({"z": "east", "east": "z"}, "east where it says z, z where it says east"),
        ({"north": "east"}, "east where it says north"),
        ({"east": "north", "north": "east"}, "where it says north"),
    ],
)
def test_gimbals_mislabelled_are_named(names: dict[str, str], words: str) -> None:
    told = CalibrationSequence(
        "gimbals", np.eye(3), (
            Rest(20.0), Rotate("z", 60 * DEG, 0.2), Rotate("east", -40 * DEG, 0.2),
            spin("north", 1, 0.3), Rest(20.0), Rotate("z", -100 * DEG, 0.2), Rest(20.0),
        ),
    )  # fmt: skip
    found = find_sequence(simulated(relabelled(told, names)).log)
    with refuses("systematic.axes", match=words):
        match_sequence(found, told)


def test_a_table_that_turns_the_other_way_is_named() -> None:
    told = nineteen_positions(rest=20.0)
    other = tuple(
        replace(a, angle=-a.angle) if isinstance(a, Rotate) and a.axis == "x" else a
        for a in told.actions
    )
    found = find_sequence(simulated(replace(told, actions=other)).log)
    with refuses("systematic.axes", "table turned about minus x where it says x"):
        match_sequence(found, told)


def test_one_wrong_turn_is_named() -> None:
    told = quarter_turns("told", "UEN", "+x +y -z +x +y", rest=20.0)
    done = quarter_turns("done", "UEN", "+x +y +2z +x +y", rest=20.0)
    found = find_sequence(simulated(done).log)
    with refuses(
        "systematic.move",
        match=r"Turn 3 of 'told' \(action 6, -90 deg about z\), at .* to be 90.0 deg about minus z "
        r"of the body; it was 180.0 deg about z",
    ):
        match_sequence(found, told)


def test_more_or_fewer_turns_are_counted() -> None:
    told = quarter_turns("told", "UEN", "+x +y -z +x", rest=20.0)
    found = find_sequence(simulated(quarter_turns("a", "UEN", "+x +y -z", rest=20.0)).log)
    with refuses("systematic.count", match=r"4 turns, the log 3. Up to the end .* agree"):
        match_sequence(found, told)
    found = find_sequence(simulated(quarter_turns("a", "UEN", "+x +z +y -z +x", rest=20.0)).log)
    with pytest.raises(
        FoucaultError, match=r"first that differs is turn 2, at .* 90.0 deg about z"
    ):
        match_sequence(found, told)


def test_a_rest_that_is_missing_is_named() -> None:
    told = quarter_turns("told", "UEN", "+x +y -z +x", rest=20.0)
    actions = list(told.actions)
    actions[4] = Rest(1.0, "P3")
    found = find_sequence(simulated(replace(told, actions=tuple(actions))).log)
    matched = match_sequence(found, told)
    (said,) = matched.findings
    assert said.code == "systematic.rest_missing"
    assert "'P3' of 'told', after 2 turns" in said.message
    assert [p.label for p in matched.positions] == ["P1", "P2", "P4", "P5"]


def test_turns_about_the_vertical_alone_are_refused() -> None:
    told = quarter_turns("told", "ENU", "+z +z +z +z", rest=20.0)
    with refuses("systematic.upright", "In all 5 rests the same direction"):
        find_sequence(simulated(told).log)


def test_logs_that_cannot_be_used() -> None:
    log = simulated(quarter_turns("a", "UEN", "+x", rest=20.0)).log
    for more, words in (({"gyro": None}, "no gyro"), ({"accel": None}, "no accel")):
        with refuses("systematic.triads", match=words):
            find_sequence(replace(log, **more))
    dead = "accel x, accel y, accel z read one value from the first row to the last"
    with refuses("systematic.one_value", match=dead):
        find_sequence(replace(log, accel=np.zeros_like(log.accel)))
    with refuses("systematic.no_rests", "has 1 rests of 5 s"):
        find_sequence(log[: 15 * 50])


# -- another program's nineteen positions ------------------------------------------------------


def test_another_programs_log_is_the_nineteen_positions() -> None:
    found = find_sequence(third_party())
    assert found.findings == ()
    assert recognised(found) == "19 positions"
    matched = match_sequence(found, nineteen_positions())
    assert matched.findings == ()
    assert matched.rests.tolist() == list(range(19))
    # Its gyros read 10, 20 and 30 ppm too little: so far the angles miss 90 deg, by 1 arcsec.
    axis = [int(np.abs(m.axis_b).argmax()) for m in found.moves]
    scale = -np.array([10e-6, 20e-6, 30e-6])[axis] * 90 * DEG
    assert matched.angle_err == pytest.approx(scale, abs=1 * ARCSEC)
    assert matched.axis_err.max() < 0.03 * DEG
    assert [m.peak / DEG for m in found.moves] == pytest.approx([10.0] * 18, abs=1e-3)
    # Every rest is tilted a degree from the cardinal direction, about two axes.
    up = found.accel / np.linalg.norm(found.accel, axis=1)[:, None]
    declared = np.array([p.C_nb[2] for p in matched.positions])
    tilt = np.arccos(np.sum(up * declared, axis=1)) / DEG
    assert tilt == pytest.approx(np.full(19, np.sqrt(2.0)), abs=0.05)
    # Rests last about 40 s but for the first, the second and the last.
    length = (found.rests.last - found.rests.first)[found.still] / 100
    assert np.all((length[2:-1] > 30) & (length[2:-1] < 40))
    assert length[[0, 1, -1]] == pytest.approx([67, 84, 17], abs=1)
