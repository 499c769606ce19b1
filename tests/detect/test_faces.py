"""Faces and turns found in a log, and every way in which they can be wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.detect.faces import find_faces, find_turns
from foucault.models.imu import ImuModel
from foucault.models.rests_and_turns import face_name, turn_name
from foucault.tables import Log
from make_faces import MEMS, SITE, TURN, moved, short_log, short_plan
from refusals import refused

G = SITE.gravity


@pytest.fixture(scope="module")
def log():
    return short_log(rate=50.0)[0]


@pytest.fixture(scope="module")
def edges():
    """First sample of each rest and the sample after its last: z, z, -z, x, x, -x, y, y, -y."""
    starts, ends = short_plan().edges
    return (np.ceil(starts * 50).astype(int) + 2).tolist(), np.floor(ends * 50).astype(int).tolist()


@pytest.fixture(scope="module")
def sections(edges):
    first, last = edges
    names = {"z_p": 0, "z_a": 2, "x_p": 3, "x_a": 5, "y_p": 6, "y_a": 8}
    out = {name: (first[j], last[j]) for name, j in names.items()}
    turns = {"z_rot": 0, "x_rot": 3, "y_rot": 6}
    return out | {name: (last[j] - 10, first[j + 1] + 10) for name, j in turns.items()}


def turns_of(log, angle=TURN, sections=None):
    return find_turns(log, find_faces(log, G, sections=sections), angle, sections)


def test_faces_and_turns_are_found_in_order(log):
    faces, turns = turns_of(log)
    r = faces.readings
    names = [face_name(a, s) for a, s in zip(r.axis, r.sign, strict=True)]
    assert names == ["z up", "z up", "z down", "x up", "x up", "x down", "y up", "y up", "y down"]
    assert r.group.tolist() == [0, 0, 2, 3, 3, 5, 6, 6, 8]
    assert turns.axis.tolist() == [2, 0, 1]
    assert turns.group.tolist() == [0, 3, 6]
    np.testing.assert_array_equal(turns.angle, TURN)
    np.testing.assert_array_equal(turns.about_up, 1.0)
    net = turns.gyro[[0, 1, 2], [2, 0, 1]]
    np.testing.assert_allclose(np.degrees(net), -360, atol=20)  # bias and scale of a MEMS gyro


def test_sections_are_taken_as_they_are(log, sections):
    faces, turns = turns_of(log, sections=sections)
    assert len(faces.readings) == 6
    assert turns.first.tolist() == [sections[f"{a}_rot"][0] for a in "xyz"]
    assert len(set(faces.readings.group) | set(turns.group)) == 9
    a, b = sections["y_rot"]
    np.testing.assert_allclose(turns.gyro[1], log.gyro[a:b].sum(axis=0) * log.interval)
    assert turns.time[1] == pytest.approx((b - a) / 50)


def test_two_turns_at_once_are_twice_the_angle(log):
    twice = replace(log, gyro=log.gyro * [1.0, 2.0, 1.0])
    assert (turns_of(twice)[1].angle / TURN).tolist() == [1.0, 1.0, 2.0]


def test_turns_in_words():
    assert turn_name(0, TURN, 1) == "about x, x up, clockwise seen from above"
    assert turn_name(1, TURN, -1) == "about y, y down, counter-clockwise seen from above"
    assert turn_name(2, -TURN, 0) == "about z, z level, positive sense"


def test_a_turn_about_a_level_axis(log, sections):
    """Rolled on its side: the face is the same before and after, the axis is another."""
    a, b = sections["x_rot"]
    rolled = log.gyro.copy()
    rolled[a:b] = rolled[a:b][:, [1, 0, 2]]
    a, b = sections["y_rot"]
    rolled[a:b] = rolled[a:b][:, [1, 0, 2]]
    _, turns = turns_of(replace(log, gyro=rolled))
    assert turns.axis.tolist() == [2, 1, 0]
    assert turns.about_up.tolist() == [1.0, 0.0, 0.0]


# -- faces ---------------------------------------------------------------------------------


def test_a_missing_face_is_named(log, edges):
    problem = refused(find_faces, log[: edges[1][7]], G)
    assert problem.code == "faces.missing"
    assert "no rest with y down" in problem.message


def test_a_rest_on_no_face(log, sections):
    a, b = sections["z_a"]
    tilted = moved(log, a, b, accel=np.array([0.5 * G, 0.0, 0.0]))
    problem = refused(find_faces, tilted, G, sections=sections)
    assert problem.code == "faces.off"
    assert "section z_a is 2" in problem.message and "z down" in problem.message
    problem = refused(find_faces, tilted, G)
    assert problem.code == "faces.missing"
    assert "deg off z down" in problem.message


def test_a_pause_between_two_faces_is_left_out(log, edges):
    a, b = edges[0][1], edges[1][1]
    paused = moved(log, a, b, accel=np.array([-0.2 * G, 0.6 * G, 0.0]))
    faces = find_faces(paused, G)
    assert [f.code for f in faces.findings] == ["faces.left_out"]
    assert len(faces.readings) == 8


def test_a_rest_that_moves(log, sections):
    a, b = sections["y_a"]
    ramp = np.linspace(0, 0.1, b - a)[:, None] * [1.0, 0.0, 0.0]
    problem = refused(find_faces, moved(log, a, b, accel=ramp), G, sections=sections)
    assert problem.code == "faces.moving"
    assert "y down" in problem.message and "mg" in problem.message
    spun = moved(log, a, b, gyro=np.radians([0.0, 3.0, 0.0]))
    problem = refused(find_faces, spun, G, sections=sections)
    assert problem.code == "faces.moving"
    assert "deg/s" in problem.message


def test_a_wrong_unit(log):
    assert refused(find_faces, replace(log, accel=log.accel / G), G).code == (
        "accel.scale_impossible"
    )


def test_increments_are_named(log):
    summed = replace(log, accel=log.accel * log.interval)
    assert refused(find_faces, summed, G).code == "accel.increments"


def test_no_accelerometers_or_no_numbers(log):
    assert refused(find_faces, replace(log, accel=None), G).code == "session.no_accel"
    bad = log.gyro.copy()
    bad[7, 1] = np.nan
    problem = refused(find_faces, replace(log, gyro=bad), G)
    assert problem.code == "session.not_finite" and "7" in problem.message


# -- sections ------------------------------------------------------------------------------


def test_sections_that_cannot_be(log, sections):
    def code(changed):
        return refused(find_faces, log, G, sections=changed)

    misspelt = {("x_up" if k == "x_p" else k): v for k, v in sections.items()}
    assert code(misspelt).code == "faces.section_name"
    short = {k: v for k, v in sections.items() if k != "y_a"}
    problem = code(short)
    assert problem.code == "faces.section_missing" and "y_a" in problem.message
    problem = code(sections | {"z_p": (100, 10**6)})
    assert problem.code == "faces.section_range" and "z_p" in problem.message
    problem = code(sections | {"x_p": sections["y_p"], "y_p": sections["x_p"]})
    assert problem.code == "faces.section_axis"
    assert "x_p has y up" in problem.message
    means = replace(log, averaged=np.ones(len(log)))
    problem = code(sections | {"z_p": [100]})
    assert problem.code == "faces.section_range" and "[100]" in problem.message
    assert refused(find_faces, means, G, sections=sections).code == "faces.section_means"


def test_p_and_a_the_other_way_round_are_taken_from_the_data(log, sections):
    swapped = sections | {"x_p": sections["x_a"], "x_a": sections["x_p"]}
    faces = find_faces(log, G, sections=swapped)
    assert [f.code for f in faces.findings] == ["faces.section_sense"]
    assert "x_p, x_a" in faces.findings[0].message
    assert sorted(faces.readings.sign.tolist()) == [-1, -1, -1, 1, 1, 1]


def test_sections_without_turns(log, sections):
    rests = {k: v for k, v in sections.items() if not k.endswith("rot")}
    problem = refused(turns_of, log, sections=rests)
    assert problem.code == "turns.section_missing" and "x_rot" in problem.message


# -- turns ---------------------------------------------------------------------------------


def test_all_turns_in_the_other_sense_name_both_cures(log):
    problem = refused(turns_of, log, -TURN)
    assert problem.code == "turns.reversed"
    assert 'angle = "-360 deg"' in problem.cure and "signs of all gyros" in problem.cure


@pytest.mark.parametrize("axis", "xyz")
def test_one_turn_in_the_other_sense_is_named(log, axis):
    sign = np.where(np.array(list("xyz")) == axis, -1.0, 1.0)
    problem = refused(turns_of, replace(log, gyro=log.gyro * sign))
    assert problem.code == "turns.sense"
    assert f"The first turn about {axis} goes against" in problem.message
    assert "that gyro has the wrong sign" in problem.cure


def test_a_turn_that_is_not_whole(sections):
    angle = TURN * 0.75
    log, _ = short_log(rate=50.0, angle=angle)
    for words in ({}, {"sections": sections}):
        problem = refused(turns_of, log, **words)
        assert problem.code == "turns.partial"
        assert "360 deg are declared" in problem.message
        measured = float(problem.message.split("measures ")[1].split()[0])
        assert measured == pytest.approx(270, abs=12)


def test_turns_of_gyros_in_another_unit_or_summed(log, sections):
    for factor, likely in ((np.degrees(1.0), "deg/s"), (np.radians(1.0), "rad/s")):
        for words in ({}, {"sections": sections}):
            problem = refused(turns_of, replace(log, gyro=log.gyro * factor), **words)
            assert problem.code == "turns.unit" and f'unit = "{likely}"' in problem.cure
    problem = refused(turns_of, replace(log, gyro=log.gyro * log.interval))
    assert problem.code == "turns.increments" and "increment" in problem.cure


def test_a_turn_about_another_axis(log, sections):
    swapped = sections | {"x_rot": sections["y_rot"], "y_rot": sections["x_rot"]}
    problem = refused(turns_of, log, sections=swapped)
    assert problem.code == "turns.axis" and "section x_rot" in problem.message
    a, b = sections["z_rot"]
    skew = log.gyro.copy()
    skew[a:b, 0] = skew[a:b, 2] * 0.6
    problem = refused(turns_of, replace(log, gyro=skew))
    assert problem.code == "turns.axis" and "no turn about z" in problem.message


def test_a_missing_turn(log, sections):
    a, b = sections["z_rot"]
    still = log.gyro.copy()
    still[a:b] = still[a - 20 : a].mean(axis=0)
    problem = refused(turns_of, replace(log, gyro=still))
    assert problem.code == "turns.missing"
    assert "about z" in problem.message and "x, y" in problem.message


def test_turns_need_gyros_and_samples(log):
    assert refused(turns_of, replace(log, gyro=None)).code == "turns.no_gyro"
    up = np.repeat(np.eye(3), 2, axis=0) * np.tile([[1.0], [-1.0]], (3, 1))
    means = Log(np.arange(6.0), np.zeros((6, 3)), G * up, averaged=np.full(6, 10.0))
    assert refused(turns_of, means).code == "turns.means"


def test_rows_that_are_means_are_one_rest_each():
    up = np.repeat(np.eye(3), 2, axis=0) * np.tile([[1.0], [-1.0]], (3, 1))
    log = Log(np.arange(6.0), None, G * up + [0.3, -0.2, 0.1], averaged=np.full(6, 30.0))
    faces = find_faces(log, G)
    np.testing.assert_array_equal(faces.readings.up_k, up)
    np.testing.assert_array_equal(faces.readings.time, 30.0)
    tilted = moved(log, 3, 4, accel=np.array([0.6 * G, 0.0, 0.0]))
    assert refused(find_faces, tilted, G).code == "faces.off"


def test_a_noisy_model_changes_nothing():
    """30 mg of bias and a misalignment of 30 arcmin leave every face what it is."""
    plain, _ = short_log(model=ImuModel(), noise=MEMS, rate=50.0)
    rough, _ = short_log(seed=9, rate=50.0)
    one, other = (find_faces(x, G).readings.up_k for x in (plain, rough))
    np.testing.assert_array_equal(one, other)
