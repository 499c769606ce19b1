"""Two bare files of one motion: an IMU beside poses of its body, or beside another IMU."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from commands import run
from foucault import logs
from foucault.campaign import calibrate
from foucault.campaign.recognised import found, said_of
from foucault.errors import FoucaultError

PLACE = {"latitude": "48.8462 deg", "height": "60 m"}
SI = "time [s],gx [rad/s],gy [rad/s],gz [rad/s],ax [m/s^2],ay [m/s^2],az [m/s^2]"
BARE = "time,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z"


def session(procedure: str, folder: Path) -> Path:
    campaign, out = folder / f"{procedure}.toml", folder / procedure
    run("init", procedure, "-o", campaign, code=0)
    run("simulate", campaign, "-o", out, code=0)
    return out


@pytest.fixture(scope="module")
def beside_poses(tmp_path_factory):
    folder = session("imu_pose", tmp_path_factory.mktemp("poses"))
    x = np.genfromtxt(folder / "poses.csv", delimiter=",", skip_header=1)
    np.savetxt(folder / "poses.tum", x[:, [0, 1, 2, 3, 5, 6, 7, 4]], fmt="%.9f")
    return folder


@pytest.fixture(scope="module")
def beside_another(tmp_path_factory):
    return session("two_imus", tmp_path_factory.mktemp("imus"))


def bare(file: Path, head: str, name: str, force: float = 1.0) -> Path:
    x = np.genfromtxt(file, delimiter=",", skip_header=2)
    x[:, 4:7] *= force
    out = file.with_name(name)
    np.savetxt(out, x, fmt="%.17g", delimiter=",", header=head, comments="")
    return out


@pytest.mark.thorough
@pytest.mark.parametrize("first", [True, False])
def test_an_imu_and_poses_are_calibrated_as_they_are(beside_poses, first):
    files = [bare(beside_poses / "log.csv", SI, "imu.csv"), beside_poses / "poses.tum"]
    files = files if first else files[::-1]
    seen = found(files, site=PLACE)
    assert seen.session.procedure == "imu_pose"
    assert seen.campaign.master.file == "poses.tum"
    (beside_poses / "bare.toml").write_text(seen.text)
    result = calibrate(beside_poses / "bare.toml")
    text = (beside_poses / "campaign.toml").read_text()
    assert "left_out = false" in text
    (beside_poses / "counted.toml").write_text(text.replace("left_out = false", ""))
    want = calibrate(beside_poses / "counted.toml")
    # In m/s^2 and rad/s as the program's own file has them: the same readings.
    assert list(result.coefficients.names) == list(want.coefficients.names)
    apart = result.coefficients.values - want.coefficients.values
    assert np.abs(apart / want.coefficients.sd).max() < 0.01


@pytest.mark.thorough
def test_without_a_place_gravity_counts_as_what_nobody_said(beside_poses):
    """Errors are as large as is stated, and accelerometers less well known than with a place."""
    files = [bare(beside_poses / "log.csv", SI, "imu.csv"), beside_poses / "poses.tum"]
    (beside_poses / "nowhere.toml").write_text(found(files).text)
    got = calibrate(beside_poses / "nowhere.toml").coefficients
    want = calibrate(beside_poses / "campaign.toml").coefficients
    scales = [n for n in got.names if n.startswith("accel.scale.")]
    got, want = got.chosen(scales), want.chosen(scales)
    assert (np.abs(got.values - want.values) < 3 * got.sd).all()
    assert (got.sd > want.sd).all() and (got.sd / want.sd).max() > 5


@pytest.mark.thorough
def test_two_imus_are_calibrated_one_against_the_other(beside_another):
    files = [bare(beside_another / f"{n}.csv", SI, f"imu_{n}.csv") for n in ("log", "first")]
    seen = found(files)
    assert seen.session.procedure == "two_imus"
    assert not seen.recognised.questions
    read = logs.read(seen.campaign.log, beside_another)
    own = logs.read(logs.LogDescription(file="log.csv"), beside_another)
    np.testing.assert_allclose(read.accel, own.accel)
    assert seen.campaign.master.file == "imu_first.csv"


@pytest.mark.thorough
def test_accelerometers_without_a_unit_are_asked_for(beside_another):
    """A body that is moved hard: what it reads is no gravity in a unit that people use."""
    log = bare(beside_another / "log.csv", BARE, "none.csv", force=1.1)
    files = [log, beside_another / "first.csv"]
    with pytest.raises(FoucaultError, match="no unit of its accelerometers"):
        _ = found(files).campaign
    seen = found(files, said_of(["accel.unit = m/s^2"]))
    assert seen.campaign.procedure == "two_imus"
