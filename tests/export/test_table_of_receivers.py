"""Receivers of the table: each, doing what it does with its file, gets what we mean."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from foucault.arrays import FloatArray
from foucault.errors import FoucaultError, finding
from foucault.export import write
from foucault.export.check import checked
from foucault.export.densities import allan_variance, densities
from foucault.export.quantities import OFF_DIAGONAL, Known
from foucault.export.receivers import knowledge
from foucault.export.request import AXES
from foucault.export.syntax import Found
from foucault.export.table import KINDS, Receiver, found_in, numbers_of, receivers
from foucault.models.imu import Gauge, ImuModel
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.result import Result
from make_terms import LOUD, Readings, Same, with_terms
from own_formulas import T, corrected, propagated
from refusals import refuses

TABLE = receivers()
RATE = LOUD.rate


def exported(name: str, path: Path, **options: Any) -> tuple[Receiver, Result, str]:
    own = TABLE[name]
    result = with_terms(*(own.takes or ("accel.bias", "gyro.scale")))
    return own, result, write(result, name, path, noise=LOUD, **options).read_text("utf-8")


# -- there and back ----------------------------------------------------------------------------


def model_in(receiver: Receiver, found: Found) -> ImuModel:
    """Return the calibration that a file has, in the axes and the gauge of the receiver [SI]."""
    parts: dict[str, FloatArray] = {}
    for row in receiver.rows:
        numbers = numbers_of(row, found) if row.key and not row.noise else None
        if numbers is not None:
            parts |= row.meant(numbers, Known(ImuModel()))
    return model_of(parts)


def model_of(found: Mapping[str, FloatArray]) -> ImuModel:
    """Return the model whose forms a file has; what it does not have is that of no error.

    `found`: values by name, as `FORMS` gives them [SI].
    """
    parts: dict[str, FloatArray] = {}
    for t in ("accel", "gyro"):
        own = {name.partition(".")[2]: x for name, x in found.items() if name.startswith(f"{t}.")}
        M = _matrix(own)
        b = M @ own["true_bias"] if "true_bias" in own else own.get("bias", np.zeros(3))
        parts |= {f"{t}_matrix": M, f"{t}_bias": b}
    G = found.get("gyro.g", np.zeros((3, 3)))
    if "gyro.g_rotated" in found:
        G = found["gyro.g_rotated"] @ found.get("gyro.rotation", np.eye(3))
    return replace(ImuModel(), **parts, g_sensitivity=G)


def _matrix(own: Mapping[str, FloatArray]) -> FloatArray:
    if "matrix" in own:
        return own["matrix"]
    if "inverse" in own:
        return np.asarray(np.linalg.inv(own["inverse"]))
    if "correction" in own:
        return np.asarray(np.linalg.inv(np.eye(3) + own["correction"]))
    if "diagonal_inverse" in own:
        return np.diag(1.0 / own["diagonal_inverse"])
    for factors in (
        ("lower", "rotation"),
        ("upper", "upper_rotation"),
        ("diagonal_matrix", "rest"),
    ):
        if factors[0] in own:
            return np.asarray(own[factors[0]] @ own.get(factors[1], np.eye(3)))
    M = np.diag(1.0 + own.get("scale", np.zeros(3)))
    M[OFF_DIAGONAL] = own.get("off_diagonal", np.zeros(6))
    return M


@pytest.mark.parametrize("name", list(TABLE))
def test_what_is_written_reads_back(name: str, tmp_path: Path) -> None:
    own, result, text = exported(name, tmp_path / "out")
    known, _ = knowledge(result, own, noise=LOUD)
    found = found_in(own, text)
    for row in own.rows:
        if not row.key or row.warm:
            continue
        want, got = row.told(known), numbers_of(row, found)
        assert want is not None and got is not None, row.key
        np.testing.assert_array_equal(got, want, err_msg=row.key)
        for of, meant in row.meant(got, known).items():
            if row.noise:
                want = known.noise[of if row.each else f"one:{of}"]
                np.testing.assert_allclose(meant.ravel(), np.ravel(want), rtol=1e-12)
    if not own.before:
        got_model = model_in(own, found)
        for part in ("accel_matrix", "accel_bias", "gyro_matrix", "gyro_bias", "g_sensitivity"):
            np.testing.assert_allclose(
                getattr(got_model, part), getattr(known.model, part), rtol=0, atol=1e-12
            )


@pytest.mark.parametrize("name", [n for n, r in TABLE.items() if r.single])
def test_single_precision_is_that_of_single_numbers(name: str, tmp_path: Path) -> None:
    own, result, text = exported(name, tmp_path / "out")
    assert "single precision" in text
    known, _ = knowledge(result, own, noise=LOUD)
    single = {key: float(np.float32(value)) for key, value in found_in(own, text).items()}
    for row in own.rows:
        if row.key and not row.warm:
            np.testing.assert_allclose(numbers_of(row, single), row.told(known), rtol=1.2e-7)


@pytest.mark.parametrize("name", [n for n, r in TABLE.items() if r.syntax == "yaml"])
def test_pyyaml_takes_every_number_for_one(name: str, tmp_path: Path) -> None:
    import yaml

    own, _, text = exported(name, tmp_path / "out")
    flat = dict(leaves(yaml.safe_load(text)))
    for key, value in found_in(own, text).items():
        np.testing.assert_array_equal(np.asarray(flat[key], float), value)


def leaves(value: Any, path: str = "") -> Any:
    for key, item in value.items():
        at = f"{path}.{key}" if path else key
        yield from leaves(item, at) if isinstance(item, dict) else [(at, item)]


@pytest.mark.parametrize("name", [n for n, r in TABLE.items() if r.syntax == "opencv"])
def test_opencv_reads_it(name: str, tmp_path: Path) -> None:
    import cv2

    own, _, text = exported(name, tmp_path / "out.yaml")
    assert text.startswith("%YAML:1.0\n")
    storage = cv2.FileStorage(str(tmp_path / "out.yaml"), cv2.FILE_STORAGE_READ)
    for key, value in found_in(own, text).items():
        node = storage.root()
        for part in key.split(".") if own.nested else [key]:
            node = node.getNode(part)
        np.testing.assert_array_equal(numbers_in(node), value, err_msg=key)
        assert node.isSeq() or node.isReal()  # 200 would be an integer, which ORB-SLAM3 refuses


def numbers_in(node: Any) -> Any:
    return [numbers_in(node.at(i)) for i in range(node.size())] if node.isSeq() else node.real()


def test_gtsam_takes_the_snippet(tmp_path: Path) -> None:
    pytest.importorskip("gtsam", reason="GTSAM has wheels for Linux on x86-64 only")
    _, _, text = exported("gtsam", tmp_path / "out.py")
    said: dict[str, Any] = {}
    exec(text, said)
    for name, noise in (("Accelerometer", "accel.white"), ("Gyroscope", "gyro.white"),
                        ("BiasAcc", "accel.walk"), ("BiasOmega", "gyro.walk")):  # fmt: skip
        got = getattr(said["params"], f"get{name}Covariance")()
        np.testing.assert_allclose(got, np.eye(3) * LOUD.values[f"one:{noise}"] ** 2, rtol=1e-12)


def test_pymavlink_takes_the_parameters(tmp_path: Path) -> None:
    from pymavlink import mavparm

    own, _, text = exported("ardupilot", tmp_path / "a.param")
    held = mavparm.MAVParmDict()
    assert held.load(str(tmp_path / "a.param"))
    assert dict(held) == found_in(own, text)


def test_launch_files_say_that_these_are_numbers(tmp_path: Path) -> None:
    """roslaunch makes text of 1e-05 without a type, and nh.param then takes its default."""
    own, _, text = exported("msckf-vio", tmp_path / "a.launch")
    params = ET.fromstring(text[text.index("<launch>") :]).findall("param")
    assert {p.get("name"): float(p.get("value", "")) for p in params} == found_in(own, text)
    assert {p.get("type") for p in params} == {"double"}


def test_readers_that_take_an_exponent_for_text_are_known(tmp_path: Path) -> None:
    own, _, text = exported("kalibr", tmp_path / "a.yaml")
    wrong = re.sub(r"(gyroscope_random_walk): \S+", r"\1: 2e-06", text)
    assert found_in(own, text)["gyroscope_random_walk"] == 2e-6
    assert found_in(own, wrong)["gyroscope_random_walk"] == "2e-06"
    import yaml

    assert yaml.safe_load(wrong)["gyroscope_random_walk"] == "2e-06"


# -- what each does with the calibration --------------------------------------------------------


@pytest.mark.parametrize("name", [n for n, r in TABLE.items() if not r.before])
def test_it_corrects_as_we_do(name: str, readings: Readings, tmp_path: Path, same: Same) -> None:
    own, result, text = exported(name, tmp_path / "out")
    x = {key: np.asarray(value) for key, value in found_in(own, text).items()}
    C_sb = AXES[own.axes or "right-forward-up"]
    accel, gyro = (r @ C_sb.T for r in readings)
    known, _ = knowledge(result, own, noise=LOUD)
    want = known.model.compensate(accel, gyro)  # in the gauge of the receiver
    got = corrected(name, x, accel, gyro)
    same(got[0], want[0])
    same(got[1], want[1])
    norms = [np.linalg.norm(f, axis=1) for f in (want[0], result.model.compensate(*readings)[0])]
    same(*norms)  # and that is a rotation of ours


def test_imucal_itself_applies_it(readings: Readings, tmp_path: Path, same: Same) -> None:
    import imucal

    _, result, text = exported("imucal", tmp_path / "imucal.json")
    info = imucal.CalibrationInfo.from_json(text)
    assert isinstance(info, imucal.FerrarisCalibrationInfo)
    f, w = info.calibrate(readings[0], np.degrees(readings[1]), "m/s^2", "deg/s")
    f_b, w_b = result.model.compensate(*readings)
    same(f, f_b)
    same(np.radians(w), w_b)
    assert "Instrument: name MTi-28, serial 0180-2214" in info.comment


def test_kalibr_in_another_gauge_turns_the_frame(tmp_path: Path, same: Same) -> None:
    takes = TABLE["kalibr"].takes
    lower = with_terms(*takes)
    model, _ = lower.model.in_gauge(Gauge.UPPER)
    names = [n for n in model.coefficients().names if n.rpartition(".")[0] in takes]
    upper = replace(with_terms(*takes, gauge=Gauge.UPPER.value),
                    coefficients=model.coefficients(names))  # fmt: skip
    text = write(upper, "kalibr", tmp_path / "imu.yaml", noise=LOUD).read_text()
    assert "body axes are turned by" in text
    same(found_in(TABLE["kalibr"], text)["accelerometers.M"], lower.model.accel_matrix)


@pytest.mark.parametrize("name", ["px4", "ardupilot"])
def test_flight_stacks_say_what_they_do_not_take(name: str, tmp_path: Path) -> None:
    _, _, text = exported(name, tmp_path / "out")
    words = {"px4": "keep the old one without a word", "ardupilot": "INS_GYR_CAL 0 keeps these"}
    assert words[name] in " ".join(text.replace("#", " ").split())


def test_a_scale_beyond_the_limits_of_the_receiver_is_refused(tmp_path: Path) -> None:
    result = with_terms("accel.scale")
    wild = result.coefficients.with_values({"accel.scale.y": 0.3})
    with pytest.raises(FoucaultError, match=r"ardupilot takes INS_ACCSCAL_. from 0\.8 to 1\.2"):
        write(replace(result, coefficients=wild), "ardupilot", tmp_path / "a.param")


@pytest.mark.parametrize(
    ("name", "slot", "keys"),
    [("px4", 2, ["CAL_ACC2_XOFF", "CAL_ACC2_ZSCALE", "CAL_GYRO2_YOFF"]),
     ("ardupilot", 0, ["INS_ACCOFFS_X", "INS_ACCSCAL_Z", "INS_GYROFFS_Y"]),
     ("ardupilot", 1, ["INS_ACC2OFFS_X", "INS_ACC2SCAL_Z", "INS_GYR2OFFS_Y"]),
     ("ardupilot", 4, ["INS5_ACCOFFS_X", "INS5_ACCSCAL_Z", "INS5_GYROFFS_Y"])],
)  # fmt: skip
def test_each_sensor_of_a_flight_stack_has_its_keys(
    name: str, slot: int, keys: list[str], tmp_path: Path
) -> None:
    _, result, first = exported(name, tmp_path / "first")
    topic = {"description": {"topic": f"IMU/{slot}"}}  # the log tells which sensor it is
    own = replace(result, provenance=result.provenance | {"input": topic})
    text = write(own, name, tmp_path / "out").read_text()
    other = found_in(TABLE[name].of_slot(slot), text)
    assert set(keys) <= other.keys()
    assert list(other.values()) == list(found_in(TABLE[name], first).values())
    assert write(own, name, tmp_path / "zero", slot=0).read_text() == first
    assert slot == 0 or not found_in(TABLE[name], text)
    seen = checked(text, None, own)
    assert (seen.receiver.slot, seen.findings) == (slot, ())
    with pytest.raises(FoucaultError, match="has sensors 0 to"):
        write(own, name, tmp_path / "none", slot=7)


@pytest.mark.parametrize("name", ["px4", "ardupilot"])
def test_what_its_own_calibration_leaves_is_not_put_in_its_place(name: str, tmp_path: Path) -> None:
    _, result, text = exported(name, tmp_path / "out")
    for code in (f"log.{name}_calibrated", "log.telemetry"):
        told = finding(code, file="a", topic="IMU/0", count=3, how="whole numbers")
        left = replace(result, findings=(told,))
        with pytest.raises(FoucaultError, match="in their place, what was found would undo them"):
            write(left, name, tmp_path / "other")
        assert write(left, name, tmp_path / "other", force=True).read_text() == text
        write(left, "pyins", tmp_path / "pyins", noise=LOUD)  # nobody else minds


def test_axes_are_those_of_the_log_where_the_receiver_has_none(tmp_path: Path) -> None:
    result = with_terms("accel.scale", "accel.bias")
    for columns, axes in (
        (["-acc.y", "acc.x", "acc.z"], "forward-left-up"),
        (["gyro_y (rad/s)", "gyro_x (rad/s)", "-gyro_z (rad/s)"], "forward-right-down"),
        ([1, 2, 3], "right-forward-up"),
    ):
        made = {"input": {"description": {"accel": {"columns": columns}}}}
        own = replace(result, provenance=result.provenance | made)
        for name, want in (("pyins", axes), ("px4", "forward-right-down"),
                           ("robot_localization", "forward-left-up")):  # fmt: skip
            text = write(own, name, tmp_path / "out", drop=["noise"]).read_text()
            assert f"Axes: {want}" in text
        said = write(own, "pyins", tmp_path / "out", axes="right-forward-up", drop=["noise"])
        assert "Axes: right-forward-up." in said.read_text()


# -- what each does with the noise -------------------------------------------------------------

WITH_NOISE = [n for n, r in TABLE.items() if any(row.noise for row in r.rows)]


@pytest.mark.parametrize("name", WITH_NOISE)
def test_its_own_formula_gives_the_noise_back(name: str, tmp_path: Path) -> None:
    own, result, text = exported(name, tmp_path / "out")
    known, _ = knowledge(result, own, noise=LOUD)
    for triad in ("accel", "gyro"):
        white, walk = propagated(name, found_in(own, text), triad, RATE)
        for got, what in ((white, "white"), (walk, "walk")):
            if got is None:
                continue
            one = "" if np.size(got) == 3 else "one:"
            want = known.noise[f"{one}{triad}.{what}"] ** 2 * T
            np.testing.assert_allclose(got, want, rtol=1e-12)


def test_vins_halves_what_it_takes_for_independent(tmp_path: Path) -> None:
    """The equation of the table beside a simulation of the receiver's own steps."""
    rng = np.random.default_rng(3)
    _, _, text = exported("vins-mono", tmp_path / "out")
    sd = found_in(TABLE["vins-mono"], text)["acc_n"]
    noise = rng.normal(size=(4000, 2, int(RATE))) * sd  # both samples of a step are its own
    velocity = (0.5 / RATE * noise.sum(axis=1)).sum(axis=1)
    got, want = velocity.var(), LOUD.values["one:accel.white"] ** 2 * 1.0
    assert abs(got / want - 1) < 2.6 * np.sqrt(2 / 4000)  # 1 %


# -- noise that is not known, and where it is from ---------------------------------------------


def test_kalibr_is_never_left_without_a_random_walk(tmp_path: Path) -> None:
    """It stops on a key that is missing, zero or a comment."""
    result = with_terms("accel.scale", validity={"rate": 100.0})
    markov = TriadNoise(white=1e-3, bias_instability=4e-4, correlation_time=100.0)
    noise = ImuNoise(markov, TriadNoise(white=3e-4, random_walk=2e-6))
    text = write(result, "kalibr", tmp_path / "imu.yaml", noise=noise).read_text()
    x = found_in(TABLE["kalibr"], text)
    assert x["gyroscope_noise_density"] == 3e-4
    assert x["gyroscope_random_walk"] == 2e-6
    assert x["accelerometer_random_walk"] > 0
    assert "bound the Allan curve from" in text
    with refuses("export.noise") as caught:
        write(result, "kalibr", tmp_path / "b.yaml", noise=ImuNoise(TriadNoise(white=1e-3)))
    assert "gyroscope_noise_density, gyroscope_random_walk" in caught.value.message
    bare = write(result, "kalibr", tmp_path / "b.yaml", drop=["noise"]).read_text()
    assert "# accelerometer_noise_density: not known" in bare
    assert x["update_rate"] == found_in(TABLE["kalibr"], bare)["update_rate"] == 100.0


def test_a_declared_bias_instability_is_bounded() -> None:
    markov = TriadNoise(white=1e-3, bias_instability=4e-4, correlation_time=100.0)
    got = densities(ImuNoise(accel=markov))
    N, K = (float(got.values[f"one:accel.{w}"]) for w in ("white", "walk"))
    tau = np.geomspace(1.0, 500.0, 40)
    ratio = np.sqrt((N**2 / tau + K**2 * tau / 3) / allan_variance(markov, tau))
    assert ratio.min() >= 0.95 and ratio.max() <= 3.0
    assert 1e-3 <= N <= 4e-3 / 3


def test_what_holds_at_one_rate_only_wants_the_rate(tmp_path: Path) -> None:
    result = with_terms("accel.bias")
    silent = replace(LOUD, rate=None)
    with refuses("export.rate"):
        write(result, "vins-mono", tmp_path / "a", noise=silent)
    slow = write(result, "vins-mono", tmp_path / "a", noise=silent, rate=50.0).read_text()
    assert "Rate of the readings: 50 Hz." in slow
    fast = write(result, "vins-mono", tmp_path / "b", noise=silent, rate=200.0).read_text()
    own = TABLE["vins-mono"]
    assert found_in(own, fast)["acc_n"] == pytest.approx(2 * found_in(own, slow)["acc_n"])


def test_noise_measured_by_a_procedure_is_that_of_the_worst_axis(tmp_path: Path) -> None:
    noise = {"accel_white": [1e-3, 1e-3, 2e-3], "gyro_white": [3e-4, 4e-4, 0.0]}
    result = with_terms("accel.scale", validity={"rate": 100.0}, diagnostics={"noise": noise})
    text = write(result, "kalibr", tmp_path / "imu.yaml", drop=["noise"]).read_text()
    x = found_in(TABLE["kalibr"], text)
    assert (x["accelerometer_noise_density"], x["gyroscope_noise_density"]) == (2e-3, 4e-4)


@pytest.mark.parametrize("name", WITH_NOISE)
@pytest.mark.parametrize("wrong", [0.0, np.nan, np.inf, -1e-3])
def test_a_noise_that_is_none_is_not_written(name: str, wrong: float, tmp_path: Path) -> None:
    dead = {k: x * np.array([1.0, 1.0, 0.0]) if np.ndim(x) else x for k, x in LOUD.values.items()}
    for values in (LOUD.values | {k: x * 0 + wrong for k, x in LOUD.values.items()}, dead):
        each = any(row.each or row.layout == "diagonal" for row in TABLE[name].rows if row.noise)
        if values is dead and not each:
            continue
        noise = replace(LOUD, values=values)
        with pytest.raises(FoucaultError, match="nobody measured"):
            write(with_terms(), name, tmp_path / "out", noise=noise)
        text = write(with_terms(), name, tmp_path / "out", noise=noise, drop=["noise"]).read_text()
        found = found_in(TABLE[name], text)
        assert not [r.key for r in TABLE[name].rows if r.noise and r.names()[0] in found]


def test_the_table_is_whole() -> None:
    for own in TABLE.values():
        assert own.source and own.title and own.file
        for row in own.rows:
            assert row.kind in KINDS
            assert row.key or row.line
            assert row.one > 0


# -- what was not calibrated ---------------------------------------------------------------------


@pytest.mark.parametrize("name", [n for n, r in TABLE.items() if r.apart])
def test_what_was_not_calibrated_stays_as_the_stack_has_it(name: str, tmp_path: Path) -> None:
    """An offset of zero would take the place of one that is right."""
    own, result = TABLE[name], with_terms("accel.bias", "accel.scale")
    whole = write(result, name, tmp_path / "a").read_text()
    assert "NOT CALIBRATED, left out, the receiver keeps what it has: gyro.bias." in whole
    assert not [key for key in found_in(own, whole) if "GYR" in key]
    c = result.coefficients  # y of the body is x forward-right-down
    two = replace(result, coefficients=c.chosen([n for n in c.names if not n.endswith(".y")]))
    text = write(two, name, tmp_path / "b").read_text()
    assert "has: accel.bias.y, accel.scale.y, gyro.bias." in text
    held = found_in(own, whole)
    left = {key: x for key, x in held.items() if not re.search(r"_XOFF|_XSCALE|OFFS_X|SCAL_X", key)}
    assert found_in(own, text) == left
    for other in (result, two):  # and a file that leaves something out is right
        for run in (other, None):
            got = checked(text if other is two else whole, None, run)
            assert (got.receiver.name, got.findings) == (name, ())
            assert {line.said for line in got.lines} == {""}
    gyro = write(with_terms("gyro.bias"), name, tmp_path / "c").read_text()
    assert checked(gyro).receiver.name == name
    with refuses("export.nothing", "gyro.bias, and none of it is calibrated"):
        write(with_terms("gyro.scale"), name, tmp_path / "d", drop=["gyro.scale"])


def test_an_sd_that_is_not_known_is_not_zero(tmp_path: Path) -> None:
    """Zero would say that the bias is known exactly (KF-GINS), or has no state (pyins)."""
    result = with_terms("accel.bias", "accel.scale")
    text = write(result, "kf-gins", tmp_path / "a", noise=LOUD).read_text()
    found = found_in(TABLE["kf-gins"], text)
    assert "initbastd" in found and "initbgstd" not in found
    assert "# initbgstd: not known" in text and "# gsstd: not known" in text
    assert "NOT CALIBRATED, written as no error: gyro.bias, gyro.scale." in text
    code = write(result, "pyins", tmp_path / "b", noise=LOUD).read_text()
    assert "\ngyro_bias_sd = None" in code and "\naccel_bias_sd = [" in code
    compile(code, "pyins", "exec")


# -- what is too small for a receiver ------------------------------------------------------------


def test_px4_says_which_numbers_it_may_ignore(tmp_path: Path) -> None:
    """Scale factors of most accelerometers are within the hundredth that it does not feel."""
    result = with_terms("accel.bias", "accel.scale", "gyro.bias")
    c = result.coefficients
    small = replace(result, coefficients=c.with_values({f"accel.scale.{a}": 0.004 for a in "xyz"}))
    text = " ".join(write(small, "px4", tmp_path / "a").read_text().split())
    assert re.findall(r"(\S+): differs from no error by (\S+), which is 0.01 or less", text) == [
        ("CAL_ACC0_*SCALE", "0.0069")
    ]
    assert "differs from no error" not in write(result, "px4", tmp_path / "b").read_text()


def test_robot_localization_says_what_it_raises(tmp_path: Path) -> None:
    quiet = {k: x * 0.01 if "gyro.white" in k else x for k, x in LOUD.values.items()}
    for noise, said in ((LOUD, False), (replace(LOUD, values=quiet), True)):
        text = write(with_terms("accel.bias"), "robot_localization", tmp_path / "a", noise=noise)
        words = "angular_velocity_covariance: robot_localization raises what is below 1e-09"
        assert (words in text.read_text()) is said


def test_two_rates_are_told(tmp_path: Path) -> None:
    result = with_terms("accel.bias", validity={"rate": 100.0})
    text = write(result, "vins-mono", tmp_path / "a", noise=LOUD).read_text()
    assert "Rate of the readings: 100 Hz." in text and "noise was measured at 200 Hz" in text
    same = write(result, "vins-mono", tmp_path / "b", noise=LOUD, rate=200.0).read_text()
    assert "noise was measured" not in same
