"""Poses of every format that people have: read to the same numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from foucault.logs import pose
from foucault.logs.pose import PoseDescription
from foucault.models.pose import PoseTable
from refusals import refuses

RNG = np.random.default_rng(1)
TIME = np.arange(60) / 50.0
PLACE = RNG.normal(0, 1, (60, 3))
Q = RNG.normal(0, 1, (60, 4))
Q /= np.linalg.norm(Q, axis=1)[:, None]
XYZW = Q[:, [1, 2, 3, 0]]


def rows(*blocks: np.ndarray, mark: str = ",") -> str:
    return "\n".join(mark.join(f"{x:.9f}" for x in row) for row in np.column_stack(blocks))


def read(folder: Path, name: str, text: str, **said: object) -> PoseTable:
    (folder / name).write_text(text)
    return pose.read(PoseDescription.model_validate({"file": name, **said}), folder)


def is_right(found: PoseTable, *, rate: float = 50.0) -> None:
    np.testing.assert_allclose(found.time - found.time[0], np.arange(60) / rate, atol=1e-8)
    np.testing.assert_allclose(found.position, PLACE, atol=1e-8)
    C = found.attitude(found.reading or "w x y z, body to world")
    true = PoseTable(TIME, PLACE, Q).attitude("w x y z, body to world")
    np.testing.assert_allclose(C, true, atol=1e-7)


def test_tum(tmp_path: Path) -> None:
    text = "# timestamp tx ty tz qx qy qz qw\n" + rows(TIME, PLACE, XYZW, mark=" ")
    is_right(read(tmp_path, "groundtruth.txt", text))


def test_euroc(tmp_path: Path) -> None:
    title = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y []"
    text = f"{title},q_RS_z []\n" + rows(1e9 * TIME, PLACE, Q)
    is_right(read(tmp_path, "data.csv", text))


@pytest.mark.parametrize(
    ("place", "turn"),
    [("x,y,z", "q1,q2,q3,q4"), ("pos_x,pos_y,pos_z", "quat_w,quat_x,quat_y,quat_z"),
     ("translation.x,translation.y,translation.z", "rotation.w,rotation.x,rotation.y,rotation.z")],
)  # fmt: skip
def test_titles_that_people_give(tmp_path: Path, place: str, turn: str) -> None:
    is_right(read(tmp_path, "poses.csv", f"t,{place},{turn}\n" + rows(TIME, PLACE, Q)))
    if turn == "q1,q2,q3,q4":  # which of its ends is the scalar is left open
        text = f"t,{place},{turn}\n" + rows(TIME, PLACE, XYZW)
        found = read(tmp_path, "poses.csv", text)
        assert found.reading is None
        true = PoseTable(TIME, PLACE, Q).attitude("w x y z, body to world")
        np.testing.assert_allclose(found.attitude("x y z w, body to world"), true, atol=1e-7)


def test_motive(tmp_path: Path) -> None:
    head = [
        "Format Version,1.23,Take Name,one,Rotation Type,Quaternion,Length Units,Millimeters",
        "", ",Type,Rigid Body" + ",Rigid Body" * 6, ",Name" + ",head" * 7, ",ID" + ",1" * 7,
        ",,Rotation,Rotation,Rotation,Rotation,Position,Position,Position",
        "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z",
    ]  # fmt: skip
    text = "\n".join([*head, rows(np.arange(60.0), TIME, XYZW, 1e3 * PLACE)])
    is_right(read(tmp_path, "take.csv", text))
    with refuses("pose.euler"):
        read(tmp_path, "take.csv", text.replace("Quaternion", "XYZ"))
    lost = text.splitlines()
    lost[20] = "13,0.26,,,,,,,"
    found = read(tmp_path, "take.csv", "\n".join(lost))
    assert len(found) == 59
    assert found.findings[0].code == "pose.lost"


@pytest.mark.parametrize("quaternion", [True, False])
def test_nexus(tmp_path: Path, quaternion: bool) -> None:
    from scipy.spatial.transform import Rotation

    turn = XYZW if quaternion else np.degrees(Rotation.from_quat(XYZW).as_rotvec())
    names = "RX,RY,RZ,RW" if quaternion else "RX,RY,RZ"
    units = ",,,," if quaternion else "deg,deg,deg,"
    head = f"Segments\n50\n,,head:head\nFrame,Sub Frame,{names},TX,TY,TZ\n,,{units}mm,mm,mm\n"
    text = head + rows(1.0 + np.arange(60), np.zeros(60), turn, 1e3 * PLACE)
    is_right(read(tmp_path, "trial.csv", text))


def test_columns_by_name_and_unit(tmp_path: Path) -> None:
    text = "stamp,a,b,c,q0,q1,q2,q3\n" + rows(1e3 * TIME, 1e3 * PLACE, Q)
    said = {"time": {"column": "stamp", "unit": "ms"},
            "position": {"columns": ["a", "b", "c"], "unit": "mm"}}  # fmt: skip
    is_right(read(tmp_path, "poses.csv", text, **said))
    alone = read(tmp_path, "poses.csv", text, **said, position_only=True)
    assert alone.quaternion is None
    with refuses("pose.columns"):
        read(tmp_path, "poses.csv", text)


def test_what_is_written_is_read(tmp_path: Path) -> None:
    pose.write(PoseTable(TIME, PLACE, Q), tmp_path / "poses.csv")
    is_right(pose.read(PoseDescription.model_validate({"file": "poses.csv"}), tmp_path))


def test_what_is_held_or_no_rotation_is_left_out(tmp_path: Path) -> None:
    place, q = PLACE.copy(), Q.copy()
    place[10], q[10] = place[9], q[9]
    q[20] = 0.0
    text = "t,x,y,z,qw,qx,qy,qz\n" + rows(TIME, place, q)
    found = read(tmp_path, "poses.csv", text)
    assert len(found) == 58
    with refuses("pose.few"):
        read(tmp_path, "poses.csv", "\n".join(text.splitlines()[:30]))
