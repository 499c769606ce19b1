"""A procedure with coefficients of its own: campaign, truth, study, tolerance, apply, export."""

from __future__ import annotations

import json

import numpy as np
import pytest

from commands import run
from foucault import campaign
from foucault.campaign import study, tolerance
from foucault.campaign.running import read_log
from foucault.campaign.tables import kind_of_group
from foucault.campaign.writing import resolved, template
from foucault.errors import FoucaultError
from foucault.export import calibrate_log, write
from foucault.export.receivers import RECEIVERS
from foucault.logs import read
from foucault.logs import write as write_log
from foucault.models import imu
from foucault.models.cluster import LAYOUT, ClusterModel
from foucault.procedures.platform_tumble.settings import NOISE
from foucault.report import save
from foucault.report import study as study_page
from foucault.report.calibration import how_to_apply
from foucault.tables import Log
from make_cluster import DEG_H, UG, G
from refusals import refuses

# Gravity is exact here; a model of it is 40 mGal off in a simulation, 40 ppm of all scales.
TEXT = template("platform_tumble").replace(
    '# gravity = "9.81234 m/s^2"', 'gravity = "9.8095 m/s^2"\ngravity_sd = "0 m/s^2"'
)
SHORT = TEXT.replace("steps = []", 'steps = []\nplan = "-x -z -y +z"\nsegment = "300 s"')


def with_lines(text, table, lines):
    head, found, rest = text.partition(f"[{table}]\n")
    assert found
    return head + found + lines + "\n" + rest


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    made = campaign.simulate(campaign.parse(TEXT))
    return made, campaign.save_session(made, tmp_path_factory.mktemp("session"))


@pytest.fixture(scope="module")
def result(session):
    return campaign.calibrate(session[1])


def test_the_log_comes_back_without_findings_about_the_command(session):
    made, file = session
    log = read_log(campaign.load(file))
    np.testing.assert_array_equal(log.accel, made.simulation.log.accel)
    np.testing.assert_array_equal(log.gyro, made.simulation.log.gyro)
    assert log.findings == ()


def test_an_accelerometer_that_stands_still_is_found(session):
    made, file = session
    stuck = made.simulation.log.accel.copy()
    stuck[1000:2000, 1] = stuck[1000, 1]
    log = made.simulation.log
    write_log(Log(log.time, log.gyro, stuck), file.parent / "stuck.csv")
    text = file.read_text().replace('"log.csv"', '"stuck.csv"')
    found = read_log(campaign.parse(text, file)).findings
    assert [f.code for f in found] == ["log.stuck"]
    assert found[0].message.startswith("accel y")


def test_the_truth_is_all_that_is_estimated(session):
    made, file = session
    assert made.truth.names == LAYOUT.names
    said = json.loads((file.parent / "truth.json").read_text())
    assert [row["name"] for row in said["coefficients"]] == list(LAYOUT.names)
    assert said["attitude_end"] == [row["value"] for row in said["coefficients"][42:]]


def test_the_template_says_the_noise_that_is_simulated_without_it():
    described = campaign.parse(TEXT)
    assert described.noise == NOISE
    bare = campaign.parse(TEXT[: TEXT.index("[noise.accel]")] + TEXT[TEXT.index("[simulate]") :])
    assert bare.noise is None
    one, other = (campaign.simulate(c).simulation.log.accel for c in (described, bare))
    np.testing.assert_array_equal(one, other)


def test_errors_are_given_by_their_own_names():
    given = 'errors = { "gyro.drift.x" = "2 deg/h", "accel.bias.y" = "50 ug" }'
    truth = campaign.simulate(campaign.parse(with_lines(SHORT, "simulate", given))).truth
    assert truth.value("gyro.drift.x") == pytest.approx(2 * DEG_H)
    assert truth.value("accel.bias.y") == pytest.approx(50 * UG)
    for wrong, code in (
        ('"gyro.bias.x" = "2 deg/h"', "coefficient.unknown"),
        ('"gyro.drift.x" = "2 deg"', "unit.kind"),
    ):
        text = with_lines(SHORT, "simulate", f"errors = {{ {wrong} }}")
        with refuses(code):
            campaign.simulate(campaign.parse(text))


def test_a_prior_is_given_by_names_of_the_procedure():
    prior = '[prior]\n"gyro.drift_input" = { mean = "0 deg/h/g", sd = "2 deg/h/g" }\n'
    got = campaign.parse(SHORT + prior).prior
    assert got == {"gyro.drift_input": (0.0, pytest.approx(2 * DEG_H / G))}
    with refuses("coefficient.unknown", match=r"'gyro\.bias' is not part of this model"):
        campaign.parse(SHORT + '[prior]\n"gyro.bias" = { mean = "0 deg/h", sd = "2 deg/h" }\n')
    hand = template("hand_rotated")
    with pytest.raises(FoucaultError, match="not part of this model"):
        campaign.parse(hand + '[prior]\n"gyro.drift" = { mean = "0 deg/h", sd = "2 deg/h" }\n')
    assert kind_of_group("gyro.bias", imu.LAYOUT) == "angular rate"
    assert kind_of_group("gyro.drift_output_spin", LAYOUT) == "g-squared sensitivity"


def test_the_resolved_campaign_is_the_same(tmp_path):
    steps = 'steps = [{ rate = ["-0.1 deg/s", "0 deg/s", "0 deg/s"], time = "100 s" }]'
    one = campaign.parse(TEXT.replace("steps = []", steps))
    again = campaign.parse(resolved(one, tmp_path))
    assert again.settings == one.settings
    assert again.session == one.session
    assert again.noise == one.noise


def test_a_mistake_in_a_list_names_its_key():
    for wrong, said in (
        ('["1 m", "0 deg", "0 deg"]', r"^procedure\.start: 'm' does not measure angle"),
        ('["1 deg"]', r"^procedure\.start\.\d|procedure\.start"),
    ):
        text = TEXT.replace('start = ["0 deg", "0 deg", "0 deg"]', f"start = {wrong}")
        with pytest.raises(FoucaultError, match=said):
            campaign.parse(text)


def test_a_log_of_means_says_so_itself(tmp_path):
    text = SHORT.replace('\nkind = "rate"', '\nkind = "increment"')
    made = campaign.simulate(campaign.parse(text))
    file = campaign.save_session(made, tmp_path)
    log = read_log(campaign.load(file))
    assert log.sampled == "increment"
    np.testing.assert_array_equal(log.accel, made.simulation.log.accel)


def test_the_result_is_a_cluster(session, result):
    made, _ = session
    assert isinstance(result.model, ClusterModel)
    truth = made.simulation.model
    log = made.simulation.log
    f_p, w_p = truth.compensate(log.accel, log.gyro)
    out = result.apply(log)
    np.testing.assert_allclose(out.accel, f_p, atol=5 * UG)
    np.testing.assert_allclose(out.gyro, w_p, atol=0.02 * DEG_H)


def test_a_calibrated_log_is_written(session, result, tmp_path):
    made, file = session
    done = calibrate_log(result, campaign.load(file).log, file.parent, tmp_path / "out.csv")
    assert done.samples == len(made.simulation.log)
    assert done.findings == ()  # a command may stand still
    want = result.apply(made.simulation.log)
    got = read(campaign.load(file).log.model_copy(update={"file": "out.csv"}), tmp_path)
    np.testing.assert_allclose(got.accel, want.accel, rtol=1e-12)
    np.testing.assert_allclose(got.gyro, want.gyro, rtol=1e-12)
    bare = campaign.load(file).log.model_copy(update={"accel": None})
    with refuses("apply.needs_accel", "no accelerometer columns"):
        calibrate_log(result, bare, file.parent, tmp_path / "bare.csv")


@pytest.mark.parametrize("receiver", sorted({*RECEIVERS} - {"c", "python", "json"}))
def test_receivers_of_imu_readings_refuse_it(receiver, result, tmp_path):
    said = ("c, python, json", "not of three gyros and three accel")
    with refuses("export.cluster", *said, match=f"{receiver} takes those of an IMU"):
        write(result, receiver, tmp_path / "out")
    assert not list(tmp_path.iterdir())


def test_the_report_says_how_to_apply_it(result):
    section = how_to_apply(result)
    words = str(section.blocks)
    for what in ("compensate(accel, command)", "foucault apply", "--to c"):
        assert what in words
    assert "w = T^-1 ((I + K) w_c + e(f))" in words
    assert "foucault export" in words


def test_a_study_of_a_cluster(tmp_path):
    described = campaign.parse(SHORT)
    done = study.run(described, 2, tmp_path / "study", workers=1)
    assert done.names == LAYOUT.names
    again, asked = study.load(tmp_path / "study")
    assert asked["names"] == list(LAYOUT.names)
    np.testing.assert_array_equal(again.error, done.error)
    page = save(study_page.document(again, asked), tmp_path / "report.html").read_text()
    assert "gyro.drift_input_output.x" in page
    assert "2 trials" in page
    run("report", tmp_path / "study", code=0)
    assert (tmp_path / "study" / "report.html").read_text() == page


def test_a_tolerance_of_a_cluster():
    limits = tolerance.parse(
        '"gyro.drift" = "5 deg/h"\n"gyro.torquer_scale.z" = { limit = "600 ppm", sd = "5 ppm" }\n'
        'attitude = "1 deg"\n"accel.bias" = "1 mg"\n'
    )
    value, sd = limits.limits(LAYOUT.names)
    assert value[LAYOUT.group("gyro.drift")] == pytest.approx(3 * [5 * DEG_H])
    assert sd[LAYOUT.index("gyro.torquer_scale.z")] == pytest.approx(5e-6)
    assert value[LAYOUT.group("attitude")] == pytest.approx(3 * [np.radians(1)])
    assert np.isinf(value[LAYOUT.group("gyro.drift_input")]).all()
