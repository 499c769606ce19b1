"""How two bodies are tied, as others have it: against the truth of a session."""

from __future__ import annotations

import re

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

import make_pose
import make_two
from foucault import export
from foucault.models.earth import Site
from foucault.models.pose import PoseTable
from foucault.procedures import imu_pose, two_imus
from foucault.procedures.two_imus import ImuLogs
from foucault.result import Level
from foucault.tables import Log
from refusals import refuses

SITE = Site.at(np.radians(48.0))


@pytest.fixture(scope="module")
def plate():
    made, truths = make_two.session(2, duration=15.0, slaves=2)
    master, *slaves = (Log(*one) for one in made)
    return two_imus.trial(ImuLogs.of(slaves[0], master, slaves[1:]), site=SITE), truths


@pytest.fixture(scope="module")
def tracked():
    imu, (t, p, C), truth = make_pose.session(2, duration=15.0, vigour=0.4)
    table = PoseTable(t, p, make_pose.quaternion(C))
    log = imu_pose.PoseLog.of(Log(*imu), table)
    return imu_pose.calibrate(log, site=SITE), truth


def read(result, form, folder):
    path = folder / form
    export.write(result, form, path)
    return path.read_text()


@pytest.mark.thorough
def test_the_chain_of_kalibr_has_every_imu(plate, tmp_path):
    result, truths = plate
    chain = yaml.safe_load(read(result, "kalibr-chain", tmp_path))
    assert np.array_equal(chain["imu0"]["T_i_b"], np.eye(4))
    for k, truth in enumerate(truths, 1):
        T = np.array(chain[f"imu{k}"]["T_i_b"])
        # Where the IMU sits is its own origin.
        seen = T @ np.append(truth["lever"], 1.0)
        assert np.abs(seen[:3]).max() < 1e-3
        turned = Rotation.from_matrix(T[:3, :3] @ truth["C_cb"].T).magnitude()
        assert turned < 0.03  # its axes are those of its accelerometers, misalignment and all
        assert chain[f"imu{k}"]["time_offset"] == pytest.approx(truth["tau"], abs=1e-4)


def test_both_directions_undo_each_other_and_say_which_they_are(plate, tmp_path):
    result, truths = plate
    said = read(result, "hand-eye", tmp_path)
    T = yaml.safe_load(said)
    assert np.allclose(np.array(T["T_imu1_imu0"]) @ T["T_imu0_imu1"], np.eye(4), atol=1e-12)
    assert np.abs(np.array(T["T_imu0_imu1"])[:3, 3] - truths[0]["lever"]).max() < 1e-3
    assert "where imu1 sits in imu0" in said


@pytest.mark.thorough
def test_a_transform_of_ros_places_the_tracked_body_in_the_imu(tracked, tmp_path):
    result, truth = tracked
    said = read(result, "ros2-tf", tmp_path)
    value = {k: float(v) for k, v in re.findall(r"--(\w+) (-?[\d.e-]+)", said) if k != "frame"}
    assert [value[k] for k in "xyz"] == pytest.approx(truth["lever"], abs=2e-3)
    C_bm = Rotation.from_quat([value[f"q{k}"] for k in "xyzw"]).as_matrix()
    assert Rotation.from_matrix(C_bm @ truth["C_bm"].T).magnitude() < 0.03


def test_what_has_no_ties_is_refused(plate, tracked, tmp_path):
    result, _ = tracked
    with refuses("export.no_ties"):
        read(result, "kalibr-chain", tmp_path)
    c = result.coefficients
    alone = [n for n in c.names if not n.startswith("pose.rotation")]
    from dataclasses import replace

    with refuses("export.no_rotation"):
        read(replace(result, coefficients=c.chosen(alone)), "ros2-tf", tmp_path)
    assert result.verdict.level is not Level.UNUSABLE
