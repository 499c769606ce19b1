"""Receivers of a magnetometer's calibration: each, doing what it does, reads the true field."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from export.test_embedded import load, run_c
from foucault.export import write
from foucault.export.check import checked
from foucault.export.request import AXES
from foucault.models.magnetometer import LAYOUT, LINEAR, Magnetometer, halves, heading_error
from foucault.result import Result
from make_result import make_result
from refusals import refuses

MAG = Magnetometer(
    Rotation.from_rotvec([0.02, -0.03, 0.05]).as_matrix()
    @ np.array([[1.03, 0.02, -0.01], [0.01, 0.97, 0.03], [0.0, -0.02, 1.02]]),
    np.array([12e-6, -31e-6, 7e-6]), 0.004, np.array([0.0, 2e-8, -1e-8]),
)  # fmt: skip
DIP = np.radians(63.0)
ALL = ("mag.rotation", "mag.delay", "mag.bias_temperature")
UNIT = {"px4": 1e4, "ardupilot": 1e7, "matlab": 1e6}


def made(mag: Magnetometer = MAG, names: tuple[str, ...] = LAYOUT.names) -> Result:
    field = {"intensity": 49e-6, "dip": DIP, "noise_of_a_reading": 3e-7}
    return make_result(
        coefficients=mag.coefficients(names), procedure="magnetometer",
        diagnostics={"field": field}, findings=(), tables={},
    )  # fmt: skip


def fields() -> np.ndarray:
    return 49e-6 * Rotation.random(20, random_state=3).apply([0.0, 0.4, -0.9])


def parameters(text: str) -> dict[str, np.ndarray]:
    """Numbers of each group of keys, X, Y and Z."""
    out: dict[str, list[float]] = {}
    for key, value in re.findall(r"^(?:param set )?(\w+)[ ,]([-\d.e]+)$", text, re.MULTILINE):
        group = re.sub(r"_?[XYZ](?=OFF|SCALE|ODIAG|$)", "", key)
        out.setdefault(group, []).append(float(value))
    return {key: np.array(x) for key, x in out.items()}


def symmetric(diagonal: np.ndarray, beside: np.ndarray) -> np.ndarray:
    P = np.diag(diagonal)
    P[[0, 0, 1], [1, 2, 2]] = P[[1, 2, 2], [0, 0, 1]] = beside
    return P


def px4(raw: np.ndarray, p: dict[str, np.ndarray]) -> np.ndarray:
    P = symmetric(p["CAL_MAG0SCALE"], p["CAL_MAG0ODIAG"])
    return (raw - p["CAL_MAG0OFF"]) @ P


def ardupilot(raw: np.ndarray, p: dict[str, np.ndarray]) -> np.ndarray:
    return (raw + p["COMPASS_OFS"]) @ symmetric(p["COMPASS_DIA"], p["COMPASS_ODI"])


def exported(result: Result, name: str, path: Path, drop: tuple[str, ...] = ALL) -> str:
    return write(result, name, path, drop=drop).read_text("utf-8")


@pytest.mark.parametrize(("name", "corrects"), [("px4", px4), ("ardupilot", ardupilot)])
def test_an_autopilot_reads_the_field_but_for_the_rotation(
    name: str, corrects: Any, tmp_path: Path
) -> None:
    _, _, R = halves(MAG.matrix)
    told = parameters(exported(made(), name, tmp_path / "p"))
    C = AXES["forward-right-down"]
    raw = MAG.measure(fields()) @ C.T * UNIT[name]
    seen = corrects(raw, told) @ C / UNIT[name]
    want = fields() @ R if name == "px4" else (fields() @ MAG.matrix.T) @ halves(MAG.matrix)[1].T
    np.testing.assert_allclose(seen, want, atol=1e-12)
    # A magnetometer that is not turned against the IMU loses nothing.
    P = MAG.matrix @ R  # symmetric
    straight = Magnetometer(P, MAG.bias)
    told = parameters(exported(made(straight, LINEAR), name, tmp_path / "q", ()))
    raw = straight.measure(fields()) @ C.T * UNIT[name]
    np.testing.assert_allclose(corrects(raw, told) @ C / UNIT[name], fields(), atol=1e-12)


def test_magcal_of_matlab_reads_the_field(tmp_path: Path) -> None:
    text = exported(made(), "matlab", tmp_path / "m", ALL[1:])
    A, b = (np.array([row.split() for row in re.search(rf"^{k} = \[(.*?)\]", text, re.M)[1]
                      .split(";")], float) for k in "Ab")  # fmt: skip
    np.testing.assert_allclose((MAG.measure(fields()) * 1e6 - b) @ A, fields() * 1e6, atol=1e-9)
    assert float(re.search(r"expmfs = (\S+);", text)[1]) == pytest.approx(49.0)


def test_a_message_of_ros_has_the_covariance_of_a_corrected_reading(tmp_path: Path) -> None:
    text = exported(made(), "ros2", tmp_path / "r", ())
    cov = np.array(re.search(r"covariance: \[(.*?)\]", text)[1].split(","), float).reshape(3, 3)
    A, C = np.linalg.inv(MAG.matrix), AXES["forward-left-up"]
    np.testing.assert_allclose(cov, C @ A @ A.T @ C.T * 9e-14, rtol=1e-9)


MAIN = r"""
#include <stdio.h>
#include "calibration.h"
int main(void)
{
    double m[3], w[3], t, f[3];
    while (scanf("%lf %lf %lf %lf %lf %lf %lf", m, m + 1, m + 2, w, w + 1, w + 2, &t) == 7) {
        foucault_field(m, w, t, f);
        printf("%.17g %.17g %.17g\n", f[0], f[1], f[2]);
    }
    return 0;
}
"""


def test_code_in_c_and_python_gives_what_apply_gives(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    w, warm = rng.uniform(-2, 2, (20, 3)), rng.uniform(270, 330, 20)
    raw = MAG.measure(fields(), warm)
    want = MAG.compensate(raw, w, warm)
    exported(made(), "c", tmp_path / "calibration.h", ())
    exported(made(), "python", tmp_path / "calibration.py", ())
    code = load(tmp_path / "calibration.py")
    near = 49e-6 * (2 * np.sqrt(3) * MAG.delay) ** 2 / 2  # the second order of the turn
    other = [code.field(m, g, t) for m, g, t in zip(raw, w, warm, strict=True)]
    np.testing.assert_allclose(other, want, atol=near)
    np.testing.assert_allclose([code.field(m) for m in MAG.measure(fields())], fields(), atol=1e-18)
    by_c = run_c(tmp_path, MAIN, np.column_stack([raw, w, warm]))
    np.testing.assert_allclose(by_c, other, rtol=1e-12)


def test_what_is_lost_is_said_in_degrees_of_heading(tmp_path: Path) -> None:
    lost = float(np.degrees(heading_error(halves(MAG.matrix)[2].T, DIP)))
    assert 3 < lost < 4
    with refuses("export.mag_loses", f"mag.rotation ({lost:.2g} deg)", "mag.delay (0.36 deg",
                 "--drop mag.delay"):  # fmt: skip
        write(made(), "px4", tmp_path / "p")
    text = exported(made(), "px4", tmp_path / "p")
    assert f"mag.rotation ({lost:.2g} deg), rms of a level heading." in text
    R = halves(AXES["forward-right-down"] @ MAG.matrix @ AXES["forward-right-down"].T)[2]
    angles = [float(re.search(rf"{n} (-?[\d.]+)", text)[1]) for n in ("ROLL", "PITCH", "YAW")]
    turned = Rotation.from_euler("ZYX", angles[::-1], degrees=True).as_matrix()
    np.testing.assert_allclose(turned, R, atol=2e-5)  # as PX4 turns: Dcm of Euler angles
    with refuses("export.mag_drop", "mag.delay"):
        write(made(), "px4", tmp_path / "p", drop=["mag.delya"])
    with refuses("export.cluster", "magnetometer", "px4, ardupilot, ros2, matlab"):
        write(made(), "kalibr", tmp_path / "k")


def test_a_turn_about_up_is_that_error_of_heading_and_no_gain_is_any() -> None:
    up = Rotation.from_rotvec([0.0, 0.0, 0.02]).as_matrix()
    assert heading_error(1.7 * up, DIP) == pytest.approx(0.02)
    tilt = Rotation.from_rotvec([0.001, 0.0, 0.0]).as_matrix()
    assert heading_error(tilt, DIP) == pytest.approx(1e-3 * np.tan(DIP) / np.sqrt(2), rel=1e-3)


@pytest.mark.parametrize("name", ["px4", "ardupilot", "matlab", "ros2"])
def test_a_file_is_read_back_and_found_by_its_keys(name: str, tmp_path: Path) -> None:
    result = made()
    text = exported(result, name, tmp_path / "f")
    for receiver in (None, name):
        seen = checked(text, receiver, result)
        assert seen.receiver.name == name
        assert seen.receiver.of_magnetometer
        assert all(line.value == line.run != "" and not line.said for line in seen.lines)
    assert not checked(text).findings


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("px4", lambda k, x: x * 100 if k == "OFF" else x, "is in uT, not in G"),
        ("px4", lambda k, x: x * 1000 if k == "OFF" else x, "is in mG, not in G"),
        ("ardupilot", lambda k, x: -x if k == "OFS" else x, "inverse direction"),
    ],
)
def test_the_usual_mistakes_are_named(name: str, change: Any, said: str, tmp_path: Path) -> None:
    text = exported(made(), name, tmp_path / "f")

    def other(found: re.Match[str]) -> str:
        key = "OFF" if found[1].endswith("OFF") else "OFS" if "OFS" in found[1] else ""
        return f"{found[1]}{found[2]}{change(key, float(found[3]))!r}"

    wrong = re.sub(r"^((?:param set )?(?:CAL_MAG|COMPASS_)\w+)([ ,])(\S+)$", other, text,
                   flags=re.MULTILINE)  # fmt: skip
    seen = checked(wrong, name, made())
    assert said in " ".join(f.message for f in seen.findings)
    assert [f.code for f in seen.findings] == ["export.check_run"]


def test_the_second_magnetometer_has_keys_of_its_own(tmp_path: Path) -> None:
    for name, key in (("px4", "CAL_MAG1_XOFF"), ("ardupilot", "COMPASS_OFS2_X")):
        text = write(made(), name, tmp_path / name, drop=ALL, slot=1).read_text()
        assert key in text
        assert "COMPASS_SCALE2,0" in text or name == "px4"


def test_the_run_of_an_imu_is_not_held_against_a_magnetometer(tmp_path: Path) -> None:
    text = exported(made(), "px4", tmp_path / "f")
    with refuses("export.check_other", "CAL_MAG*"):
        checked(text, "px4", make_result())
