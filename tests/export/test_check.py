"""`foucault check`: six kinds of wrong files are found beside a run, and nothing in right ones."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commands import run
from foucault.errors import FoucaultError
from foucault.export import write
from foucault.export.check import Checked, checked, recognised
from foucault.export.densities import Densities, of_allan_run
from foucault.export.request import number
from foucault.export.table import Row, found_in, numbers_of, receivers
from foucault.result import Result
from foucault.run_folder import save
from make_terms import LOUD, with_terms
from refusals import refuses

TABLE = receivers()
RATE = LOUD.rate or 0.0


def small(name: str) -> Result:
    """Errors as instruments have them, not those of a test of signs."""
    result = with_terms(*(TABLE[name].takes or ("accel.bias",)))
    return replace(result, coefficients=result.coefficients.with_values(
        dict(zip(result.coefficients.names, result.coefficients.values * 0.5, strict=True))
    ))  # fmt: skip


def louder(triad: str, **changes: Any) -> Densities:
    """Return the noise with a triad's numbers changed: by a factor, or as a power."""
    factor, power = changes.get("factor", 1.0), changes.get("power", 1.0)
    values = {
        name: (x * factor) ** power if triad in name else x for name, x in LOUD.values.items()
    }
    return replace(LOUD, values=values)


def seen(name: str, path: Path, noise: Densities = LOUD, result: Result | None = None) -> Checked:
    right = small(name)
    text = write(result or right, name, path, noise=noise).read_text("utf-8")
    return checked(text, name, right, noise=LOUD)


def noises(name: str, kind: str = "", unit: str = "") -> list[Row]:
    return [
        row for row in TABLE[name].rows
        if row.noise and row.kind.startswith(kind) and unit in row.unit
    ]  # fmt: skip


def said(got: Checked, rows: list[Row], words: str) -> None:
    """Every one of these keys says these words, and no other key says anything."""
    for line in got.lines:
        assert line.said == (words if line.key in [row.shown for row in rows] else ""), line
    assert len(got.findings) == len(rows)


@pytest.mark.parametrize("name", list(TABLE))
def test_nothing_is_said_of_a_right_file(name: str, tmp_path: Path) -> None:
    got = seen(name, tmp_path / "out")
    assert got.findings == ()
    assert {line.said for line in got.lines} == {""}
    for line in got.lines:
        assert line.value == line.run != ""
    text = (tmp_path / "out").read_text("utf-8")
    bare = checked(text, rate=RATE)
    assert bare.receiver.name in (name, "vins-fusion", "vins-mono")
    assert bare.findings == ()
    rounded = re.sub(r"(\d\.\d{3})\d+", r"\1", text)  # as people copy them
    assert not [f for f in checked(rounded, name, small(name), noise=LOUD).findings
                if f.code == "export.check_run"]  # fmt: skip


@pytest.mark.parametrize("name", [n for n in TABLE if noises(n, "sigma") + noises(n, "variance")])
def test_a_density_that_is_a_sample_value(name: str, tmp_path: Path) -> None:
    both = louder("accel", factor=RATE**0.5)
    both = replace(both, values=both.values | {
        k: x * RATE**0.5 for k, x in LOUD.values.items() if "gyro" in k})  # fmt: skip
    rows = noises(name, "sigma") + noises(name, "variance")
    got = seen(name, tmp_path / "out", both)
    for line in got.lines:
        if line.key in [row.shown for row in rows]:
            assert line.said == "is a sample value, not a density", line


@pytest.mark.parametrize("name", [n for n in TABLE if noises(n, "sample")])
def test_a_sample_value_that_is_a_density(name: str, tmp_path: Path) -> None:
    for triad in ("accel", "gyro"):
        rows = [row for row in noises(name, "sample") if row.of[0].startswith(triad)]
        for row in rows:
            factor = 1 / (row.times * RATE**0.5)
            wrong = {k: x * factor for k, x in LOUD.values.items() if k.endswith(row.of[0])}
            noise = replace(LOUD, values=LOUD.values | wrong)
            got = seen(name, tmp_path / "out", noise)
            said(got, [row], "is a density, not a value per sample")


@pytest.mark.parametrize("name", [n for n in TABLE if noises(n, unit="rad")])
def test_degrees_for_radians(name: str, tmp_path: Path) -> None:
    got = seen(name, tmp_path / "out", louder("gyro", factor=180 / np.pi))
    said(got, noises(name, unit="rad"), "is in degrees, not in radians")


@pytest.mark.parametrize("name", [n for n in TABLE if noises(n, unit="m/s^2") and n != "psins"])
def test_g_for_metres_per_second_squared(name: str, tmp_path: Path) -> None:
    got = seen(name, tmp_path / "out", louder("accel", factor=1 / 9.80665))
    rows = [row for row in TABLE[name].rows if row.noise and row.of[0].startswith("accel")]
    said(got, rows, "is in g, not in m/s^2")


@pytest.mark.parametrize("name", [n for n in TABLE if noises(n, "sigma", "/sqrt(Hz)")])
def test_a_variance_for_a_sigma(name: str, tmp_path: Path) -> None:
    for triad in ("accel", "gyro"):
        rows = [r for r in noises(name, "sigma") if r.of[0].startswith(triad)]
        got = seen(name, tmp_path / "out", louder(triad, power=2.0))
        for line in got.lines:
            if line.key in [row.shown for row in rows]:
                assert line.said == "is a variance, not a sigma", line


@pytest.mark.parametrize("name", [n for n in TABLE if noises(n, "variance")])
def test_a_sigma_for_a_variance(name: str, tmp_path: Path) -> None:
    got = seen(name, tmp_path / "out", louder("gyro", power=0.5))
    rows = [row for row in noises(name, "variance") if row.of[0].startswith("gyro")]
    said(got, rows, "is a sigma, not a variance")


# openvins-rpng is left out: its frame turns with the gyros, so that this is no inverse there.
@pytest.mark.parametrize(
    "name", [n for n, r in TABLE.items() if not r.before and r.gauge != "gyro"]
)
def test_a_correction_in_the_inverse_direction(name: str, tmp_path: Path) -> None:
    right = small(name)
    m = right.model
    inv_a, inv_g = np.linalg.inv(m.accel_matrix), np.linalg.inv(m.gyro_matrix)
    other = replace(
        m, accel_matrix=inv_a, gyro_matrix=inv_g, accel_bias=-inv_a @ m.accel_bias,
        gyro_bias=-inv_g @ m.gyro_bias, g_sensitivity=-inv_g @ m.g_sensitivity @ inv_a,
    )  # fmt: skip
    names = right.coefficients.names
    values = dict(zip(names, other.coefficients(names).values, strict=True))
    wrong = replace(right, coefficients=right.coefficients.with_values(values))
    got = seen(name, tmp_path / "out", result=wrong)
    words = {line.said for line in got.lines if line.said}
    assert words == {"is the correction in the inverse direction"}
    direct = [row for row in TABLE[name].rows if row.key and row.of[0].endswith(
        (".bias", ".matrix", ".inverse", ".diagonal_inverse", ".scale"))]  # fmt: skip
    assert {row.shown for row in direct} <= {line.key for line in got.lines if line.said}


@pytest.mark.parametrize("name", ["kalibr", "openvins", "openvins-rpng"])
def test_a_matrix_and_its_inverse_in_one_key(name: str, tmp_path: Path) -> None:
    """Also where the frame turns with what is in it."""
    right = small(name)
    text = write(right, name, tmp_path / "out", noise=LOUD).read_text("utf-8")
    tried = 0
    for row in TABLE[name].rows:
        form = row.of[0].partition(".")[2] if row.of else ""
        if form not in ("matrix", "lower", "rotation", "upper", "upper_rotation"):
            continue
        x = np.array(found_in(TABLE[name], text)[row.key])
        if np.array_equal(x, np.eye(3)):
            continue
        lines = [f"- [{', '.join(map(number, line))}]" for line in (*x, *np.linalg.inv(x))]
        other = text
        for was, is_ in zip(lines[:3], lines[3:], strict=True):
            assert was in other
            at = other.index(was, other.index(f"{row.key.rpartition('.')[2]}:"))
            other = other[:at] + is_ + other[at + len(was) :]
        got = checked(other, name, right, noise=LOUD)
        said = {line.key: line.said for line in got.lines if line.said}
        assert said == {row.key: "is the correction in the inverse direction"}
        tried += 1
    assert tried >= 3


@pytest.mark.parametrize(
    ("name", "factor", "words"),
    [("px4", 180 / np.pi, "is in degrees, not in radians"),
     ("ardupilot", 180 / np.pi, "is in degrees, not in radians"),
     ("pyins", 180 / np.pi, "is in degrees, not in radians"),
     ("psins", np.pi / 180, "is in radians, not in degrees")],
)  # fmt: skip
def test_a_bias_in_another_unit(name: str, factor: float, words: str, tmp_path: Path) -> None:
    right = small(name)
    gyro = {f"gyro.bias.{a}": right.coefficients.value(f"gyro.bias.{a}") * factor for a in "xyz"}
    accel = {
        f"accel.bias.{a}": right.coefficients.value(f"accel.bias.{a}") / 9.80665 for a in "xyz"
    }
    wrong = replace(right, coefficients=right.coefficients.with_values(gyro | accel))
    got = seen(name, tmp_path / "out", result=wrong)
    told = {line.said for line in got.lines if line.said}
    assert told == {words, "is in g, not in m/s^2"}


def test_two_mistakes_at_once_and_a_forgotten_factor(tmp_path: Path) -> None:
    got = seen("kalibr", tmp_path / "a", louder("gyro", factor=180 / np.pi * RATE**0.5))
    words = [line.said for line in got.lines if line.said]
    assert words == ["is a sample value, not a density, and is in degrees, not in radians"] * 2
    got = seen("vins-mono", tmp_path / "b", louder("accel.white", factor=0.5**0.5))
    assert [line.said for line in got.lines if line.said] == ["lacks the factor 1.414"]


def test_inflated_noise_is_told_and_is_no_mistake(tmp_path: Path) -> None:
    got = seen("lio-sam", tmp_path / "a", louder("gyro", factor=3.0))
    words = [line.said for line in got.lines if line.said]
    assert words == ["differs from the run: 3 times"] * 2
    assert got.findings == ()


# -- without a run -----------------------------------------------------------------------------


def test_only_what_no_sensor_has_is_told_without_a_run(tmp_path: Path) -> None:
    text = write(small("kalibr"), "kalibr", tmp_path / "a", noise=LOUD).read_text()
    wild = re.sub(r"(gyroscope_noise_density): \S+", r"\1: 2.0", text)
    got = checked(wild)
    assert [f.code for f in got.findings] == ["export.check_possible"]
    assert "no sensor has that" in got.findings[0].message
    doubtful = re.sub(r"(gyroscope_noise_density): \S+", r"\1: 0.003", text)
    assert checked(doubtful).findings == ()  # perhaps a sample sigma, perhaps a bad sensor
    none = re.sub(r"(gyroscope_random_walk): \S+", r"\1: 0.0", text)
    assert "is zero or negative" in checked(none).findings[0].message


def test_keys_that_are_missing_or_no_numbers(tmp_path: Path) -> None:
    text = write(small("kalibr"), "kalibr", tmp_path / "a", noise=LOUD).read_text()
    wrong = re.sub(r"(gyroscope_random_walk): \S+", r"\1: 2e-06", text)
    got = checked(wrong.replace("accelerometer_random_walk", "accelerometer_walk"))
    codes = {f.code: f.message for f in got.findings}
    assert codes.keys() == {"export.check_missing", "export.check_text"}
    assert "accelerometer_random_walk is missing" in codes["export.check_missing"]
    assert "'2e-06', which the reader of kalibr takes for no number" in codes["export.check_text"]
    orb = write(small("orb-slam3"), "orb-slam3", tmp_path / "b", noise=LOUD).read_text()
    got = checked(orb.replace("IMU.Frequency: 200.0", "IMU.Frequency: 200"))
    assert [f.code for f in got.findings] == ["export.check_text"]  # some versions stop on it


def test_a_file_of_nobody() -> None:
    for text in ("a: 1\n", "{}", '{"a": [1, 2]', ""):
        with refuses("export.unknown_file"):
            recognised(text)
    with pytest.raises(FoucaultError, match="Did you mean 'kalibr'"):
        checked("a: 1", "kalibre")


NESTED = {
    "lio-sam": "/**:\n  ros__parameters:\n    imuAccNoise: 4.0e-03\n    imuGyrNoise: 1.6e-03\n"
    "    imuAccBiasN: 6.4e-05\n    imuGyrBiasN: 3.6e-05\n    imuGravity: 9.805\n",
    "fast-lio2": "/**:\n  ros__parameters:\n    mapping:\n      acc_cov: 0.1\n      gyr_cov: 0.1\n"
    "      b_acc_cov: 0.0001\n      b_gyr_cov: 0.0001\n      extrinsic_R: [1, 0,\n        0, 1]\n",
    "maplab": "sensors:\n  - id: 7\n    sensor_type: IMU\n    sigmas:\n"
    "      acc_noise_density: 4e-3\n      acc_bias_random_walk_noise_density: 4e-3\n"
    "      gyro_noise_density: 1e-4\n      gyro_bias_random_walk_noise_density: 1e-4\n"
    "    gravity_magnitude_mps2: 9.81\n  - id: 8\n    sensor_type: CAMERA\n",
    "kalibr": "imu0:\n  accelerometer_noise_density: 0.002\n  accelerometer_random_walk: 0.0003\n"
    "  accelerometers:\n    M:\n    - [1.001, 0.0, 0.0]\n    - [0.001, 0.998, 0.0]\n"
    "    - [0.0, 0.0, 1.0]\n  gyroscope_noise_density: 0.0002\n  gyroscope_random_walk: 2.0e-05\n"
    "  model: scale-misalignment\n  update_rate: 200.0\n",
    "ros2": "SM:\n  - 0.98\n  - 0.0\n  - 0\n  - 0\n  - 1.01\n  - 0.0\n  - 0\n  - 0\n  - 0.99\n"
    "bias:\n  - 0.1\n  - -0.2\n  - 3e-1\n",
    "ardupilot": "# Copter\nINS_ACCOFFS_X   0.1\nINS_ACCOFFS_Y\t0.1\nINS_ACCOFFS_Z 0.1\n"
    "INS_ACCSCAL_X 1.001\nINS_ACCSCAL_Y 1.001\nINS_ACCSCAL_Z 1.001\n"
    "INS_GYROFFS_X 0.001\nINS_GYROFFS_Y 0.001\nINS_GYROFFS_Z 0.001\n",
    "px4": "# Vehicle-Id Component-Id Name Value Type\n" + "".join(
        f"1\t1\tCAL_{key}\t{value}\t9\n" for axis in "XYZ" for key, value in (
            (f"ACC0_{axis}OFF", 0.04), (f"ACC0_{axis}SCALE", 1.002), (f"GYRO0_{axis}OFF", 0.003))),
}  # fmt: skip
"""Files as others write them: nodes of ROS 2, lists of sensors, ground stations, yaml-cpp."""


@pytest.mark.parametrize("name", list(NESTED))
def test_keys_are_found_where_others_put_them(name: str) -> None:
    got = checked(NESTED[name])
    assert got.receiver.name == name
    assert got.findings == ()
    wanted = [row.shown for row in TABLE[name].rows if row.key and row.must]
    assert {line.key for line in got.lines} >= {*wanted}
    assert all(line.value for line in got.lines)


def test_the_model_of_openvins_is_told_from_the_file(tmp_path: Path) -> None:
    for name in ("openvins", "openvins-rpng"):
        text = write(small(name), name, tmp_path / "a", noise=LOUD).read_text()
        own = re.sub(r"(?m)^#.*\n", "", text).replace('"', "")
        assert checked(own).receiver.name == name


def test_roslaunch_takes_a_number_without_a_point_for_text(tmp_path: Path) -> None:
    text = write(small("msckf-vio"), "msckf-vio", tmp_path / "a", noise=LOUD).read_text()
    bare = text.replace(' type="double"', "")
    assert checked(bare).findings == ()
    got = checked(bare.replace("2.0e-06", "2e-06"))
    assert [f.code for f in got.findings] == ["export.check_text"]
    assert checked(text.replace("2.0e-06", "2e-06")).findings == ()


@pytest.mark.parametrize(
    ("name", "pattern", "key", "given"),
    [("kalibr", r", 0\.0(\]\n)", "accelerometers.M", 8),
     ("basalt", r",\s+[^\s,]+(\s+\])", "value0.calib_accel_bias", 8),
     ("pyins", r", [^\s,]+(\]\])", "gyro_transform", 8),
     ("matlab", r" [^\s,]+(\], \.)", "accel.ConstantBias", 2),
     ("kf-gins", r", [^\s,]+(\]  # \[deg/h)", "initgyrbias", 2)],
)  # fmt: skip
def test_too_few_numbers(name: str, pattern: str, key: str, given: int, tmp_path: Path) -> None:
    right = small(name)
    text = write(right, name, tmp_path / "out", noise=LOUD).read_text("utf-8")
    short = re.sub(pattern, r"\1", text, count=1)
    for run_ in (None, right):
        (told,) = checked(short, name, run_, noise=LOUD, rate=RATE).findings
        assert f"{key} has {given} numbers, and {name} reads" in told.message


@pytest.mark.parametrize("name", [n for n in TABLE if noises(n)])
@pytest.mark.parametrize("wrong", [0.0, -1.0])
def test_noise_that_is_none_is_no_difference(name: str, wrong: float, tmp_path: Path) -> None:
    right, own = small(name), TABLE[name]
    text = write(right, name, tmp_path / "out", noise=LOUD).read_text("utf-8")
    for row in noises(name):
        numbers = numbers_of(row, found_in(own, text))
        assert numbers is not None
        bad = put(text, numbers, np.where(numbers == 0, 0.0, wrong))
        for run_ in (None, right):
            told = checked(bad, name, run_, noise=LOUD, rate=RATE).findings
            assert [f.message for f in told] == [f"{row.shown} is zero or negative."]


def test_a_file_that_is_torn_is_no_fault_of_ours(tmp_path: Path) -> None:
    for name in ("basalt", "imucal"):
        text = write(small(name), name, tmp_path / "a", noise=LOUD).read_text()
        with refuses("export.unreadable"):
            checked(text[: len(text) // 2], name)


def test_of_several_sensors_that_of_the_run_is_looked_at(tmp_path: Path) -> None:
    result = small("ardupilot")
    texts = []
    for slot in range(3):
        bias = {f"accel.bias.{a}": 0.1 * (slot + 1) for a in "xyz"}
        other = replace(result, coefficients=result.coefficients.with_values(bias))
        texts.append(write(other, "ardupilot", tmp_path / "a", slot=slot).read_text())
    told = {"input": {"description": {"topic": "IMU/1"}}}
    second = replace(other, provenance=result.provenance | told,
                     coefficients=result.coefficients.with_values(
                         {f"accel.bias.{a}": 0.2 for a in "xyz"}))  # fmt: skip
    got = checked("".join(texts), None, second)
    assert (got.receiver.slot, got.findings, len(got.lines)) == (1, (), 3)
    assert {line.said for line in got.lines} == {""}
    alone = checked("".join(texts))
    assert len(alone.lines) == 9 and alone.findings == ()


# -- the command -------------------------------------------------------------------------------


def test_the_command(tmp_path: Path) -> None:
    result = replace(small("kalibr"), validity={"rate": 100.0})
    rng = np.random.default_rng(0)
    from foucault.logs import write as write_log
    from foucault.tables import Log

    log = Log(np.arange(4000) / 100, *rng.normal(0, (1e-3, 1e-2), (3, 4000, 2)).transpose(2, 1, 0))
    write_log(log, tmp_path / "static.csv")
    assert run("allan", tmp_path / "static.csv", "-o", tmp_path / "noise").exit_code == 0
    save(result, tmp_path / "run")
    file = tmp_path / "imu.yaml"
    run("export", tmp_path / "run", "--to", "kalibr", "-o", file,
               "--noise", tmp_path / "noise", "--rate", "100 Hz", code=0)  # fmt: skip
    words = ["--run", tmp_path / "run", "--noise", tmp_path / "noise", "--rate", "100 Hz",
             "--to", "kalibr", "--axes", "right-forward-up"]  # fmt: skip
    done = run("check", file, *words, code=0)
    assert "It says what the run says." in done.stdout
    assert "Nothing in it is implausible." in run("check", file).stdout
    text = file.read_text()
    value = float(re.search(r"gyroscope_noise_density: (\S+)", text)[1])  # type: ignore[index]
    assert value == pytest.approx(1e-4, rel=0.4)
    file.write_text(text.replace(repr(value), repr(value * 10)))
    done = run("check", file, *words, "--json", code=3)
    (told,) = json.loads(done.stdout)["findings"]
    assert "gyroscope_noise_density is a sample value, not a density." in told["message"]
    # Noise alone, from the folder of allan in the place of a run.
    other = tmp_path / "orb.yaml"
    run("export", tmp_path / "noise", "--to", "orb-slam3", "-o", other, code=0)
    assert "IMU.Frequency: 100.0" in other.read_text()
    assert "from the Allan run noise" in other.read_text()
    done = run("check", other, "--run", tmp_path / "noise")
    assert "It says what the run says." in done.stdout, done.stdout


def test_a_file_says_what_the_allan_run_knows_besides(tmp_path: Path) -> None:
    """Quantisation that N and K do not have, and what it warned of."""
    from foucault.logs import write as write_log
    from foucault.tables import Log

    rng, n, dt, step = np.random.default_rng(0), 40_000, 0.01, 2e-5
    angle = np.round(np.cumsum(rng.normal(0, 1e-4 * dt**0.5, (n, 3)), axis=0) / step) * step
    log = Log(np.arange(n) * dt, np.diff(angle, axis=0, prepend=0) / dt,
              rng.normal([0, 0, 9.8], 2e-2, (n, 3)))  # fmt: skip
    write_log(log, tmp_path / "static.csv")
    run("allan", tmp_path / "static.csv", "-o", tmp_path / "noise", code=0)
    held = json.loads((tmp_path / "noise/allan.json").read_text())
    held["findings"].append({"code": "allan.shaken", "severity": "warning", "cure": "Stop it.",
                             "message": "The instrument is shaken in 9 % of the log."})  # fmt: skip
    (tmp_path / "noise/allan.json").write_text(json.dumps(held))
    run("export", tmp_path / "noise", "--to", "kalibr", "-o", tmp_path / "k", code=0)
    text = " ".join((tmp_path / "k").read_text().replace("\n#", "").split())
    said = re.search(r"Quantisation Q of x, y, z: (\S+), (\S+), (\S+) rad, which", text)
    assert said is not None
    for q in said.groups():  # of a rounded angle
        assert float(q) == pytest.approx(step / 12**0.5, rel=0.05)
    assert "The Allan run warned: The instrument is shaken in 9 % of the log." in text
    for damage in (lambda d: d["findings"].append(3), lambda d: d["pairs"]["gyro"].pop("walk"),
                   lambda d: d["pairs"]["accel"].update(white="much"),
                   lambda d: d["channels"]["gyro.x"].update(interval=0)):  # fmt: skip
        other = json.loads((tmp_path / "noise/allan.json").read_text())
        damage(other)
        (tmp_path / "allan.json").write_text(json.dumps(other))
        with refuses("export.allan_run"):
            of_allan_run(tmp_path / "allan.json")


def test_the_command_names_any_sensor(tmp_path: Path) -> None:
    save(small("px4"), tmp_path / "run")
    file = tmp_path / "px4.params"
    done = run("export", tmp_path / "run", "--to", "px4", "-o", file, "--slot", 3)
    assert done.exit_code == 0, done.stderr
    assert "param set CAL_ACC3_XOFF" in file.read_text()
    assert "It says what the run says." in run("check", file, "--run", tmp_path / "run").stdout
    done = run("export", tmp_path / "run", "--to", "px4", "-o", file, "--slot", 4)
    assert done.exit_code == 1
    assert "px4 has sensors 0 to 3; 4 is none of them." in done.stderr


def test_a_folder_that_is_no_allan_run(tmp_path: Path) -> None:
    save(small("kalibr"), tmp_path / "run")
    done = run("export", tmp_path / "run", "--to", "kalibr", "-o", tmp_path / "a",
               "--noise", tmp_path, code=1)  # fmt: skip
    assert "is no run of foucault allan that tells the noise" in done.stderr


# -- every key of every receiver with every mistake, made in the file itself --------------------

STRANGE = {"accel": 9.80665, "gyro": np.pi / 180}
"""What one unit of people is in SI: g, deg/s."""


def mistaken(row: Row, x: Any) -> Any:
    """Yield the words of a mistake and what a key would then hold; `x`: what is right in it."""
    power = 2 if "variance" in row.kind else 1
    one = row.of[0].partition(".")[0]
    strange = {"accel": "is in g, not in m/s^2", "gyro": "is in degrees, not in radians"}[one]
    factor = STRANGE[one] ** -power
    if "deg" in row.unit:
        strange, factor = "is in radians, not in degrees", STRANGE[one] ** power
    yield strange, x * factor
    if not row.noise:
        return
    if "density" in row.kind:
        yield "is a sample value, not a density", x * RATE ** (power / 2)
    elif "sample" in row.kind:
        gone = row.times * RATE**0.5
        yield "is a density, not a value per sample", x / gone**power
    if power == 1:
        yield "is a variance, not a sigma", x**2
        yield "is a variance, not a sigma", (x * row.one) ** 2 / row.one
    else:
        yield "is a sigma, not a variance", x**0.5


def put(text: str, numbers: Any, changed: Any) -> str:
    """Write other numbers in the place of a key's."""
    for was, is_ in zip(numbers, changed, strict=True):
        forms = "|".join(re.escape(form) for form in (number(was), repr(float(was))))
        text = re.sub(rf"(?<![\d.])(?:{forms})(?![\d.])", number(is_), text)
    return text


@pytest.mark.parametrize("name", list(TABLE))
def test_every_mistake_in_every_key_is_found(name: str, tmp_path: Path) -> None:
    right, own = small(name), TABLE[name]
    text = write(right, name, tmp_path / "out", noise=LOUD).read_text("utf-8")
    tried = set()
    for row in own.rows:
        bias = bool(row.of) and row.of[0] in ("accel.bias", "gyro.bias") and len(row.of) == 1
        if not row.key or row.warm or not (row.noise or bias):
            continue
        numbers = numbers_of(row, found_in(own, text))
        assert numbers is not None
        for words, changed in mistaken(row, numbers):
            if row.layout == "diagonal":
                changed = np.where(numbers == 0, 0.0, changed)
            got = checked(put(text, numbers, changed), name, right, noise=LOUD)
            said = {line.key: line.said for line in got.lines if line.said}
            assert said == {row.shown: words}, (row.key, words)
            assert [f.code for f in got.findings] == ["export.check_run"]
            tried.add(words)
    if any(row.noise for row in own.rows):
        assert len(tried) >= 3
