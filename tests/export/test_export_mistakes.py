"""What cannot be exported is refused in a sentence that says what to do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from foucault.errors import FoucaultError, suggestion
from foucault.export import RECEIVERS, write
from foucault.export.table import receivers
from foucault.result import Result
from make_terms import LOUD, with_terms
from refusals import refuses


def refused(result: Result, receiver: str, path: Path, **options: object) -> FoucaultError:
    before = sorted(path.parent.iterdir())
    with pytest.raises(FoucaultError) as caught:
        write(result, receiver, path, **options)  # type: ignore[arg-type]
    assert sorted(path.parent.iterdir()) == before
    return caught.value


def test_terms_the_receiver_has_no_place_for_are_named(tmp_path: Path) -> None:
    result = with_terms("accel.bias", "gyro.bias", "gyro.scale", "accel.cross")
    problem = refused(result, "px4", tmp_path / "p")
    assert problem.code == "export.inexpressible"
    assert problem.message.startswith("px4 cannot express accel.cross.xyy, accel.cross.xzz, ")
    assert problem.message.endswith("gyro.scale.x, gyro.scale.y, gyro.scale.z.")
    assert "--drop accel.cross --drop gyro.scale. The loss is written" in problem.cure


def test_some_dropped_the_rest_still_refused(tmp_path: Path) -> None:
    result = with_terms("gyro.scale", "accel.scale")
    drop = ["gyro.scale.x", "gyro.scale.z"]
    problem = refused(result, "px4", tmp_path / "p", drop=drop)
    assert problem.message == "px4 cannot express gyro.scale.y."
    text = write(result, "px4", tmp_path / "p", drop=["gyro"]).read_text()
    assert "CAL_GYRO0_XOFF 0.0" not in text  # what PX4 holds stays


def test_a_term_of_zero_is_no_loss(tmp_path: Path) -> None:
    result = with_terms("gyro.scale", "gyro.bias")
    zero = result.coefficients.with_values({f"gyro.scale.{a}": 0.0 for a in "xyz"})
    text = write(replace(result, coefficients=zero), "px4", tmp_path / "p").read_text()
    assert "LOST" not in text


def test_a_misspelt_term_gets_a_suggestion(tmp_path: Path) -> None:
    problem = refused(with_terms("gyro.bias"), "px4", tmp_path / "p", drop=["gyro.bias.u"])
    assert "Did you mean 'gyro.bias." in str(problem)


def test_unknown_receiver_and_axes(tmp_path: Path) -> None:
    result = with_terms("gyro.bias")
    problem = refused(result, "px3", tmp_path / "p")
    assert problem.message == "There is no export to 'px3'. Did you mean 'px4'?"
    assert problem.cure.startswith(f"Receivers are: {', '.join(RECEIVERS)}")
    assert {"kalibr", "imucal", "px4", "ros2", "vins-mono", "gtsam"} < set(RECEIVERS)
    problem = refused(result, "c", tmp_path / "p", axes="forward-right-up")
    assert problem.code == "export.axes"
    assert "Did you mean 'forward-" in problem.message
    problem = refused(result, "csv", tmp_path / "p", axes="forward-left-up")
    assert "always in the axes right-forward-up, not 'forward-left-up'" in problem.message


def test_numbers_that_are_none_are_never_exported(tmp_path: Path) -> None:
    result = with_terms("gyro.bias")
    vector = result.coefficients.with_values({"gyro.bias.x": np.nan})
    for force in (False, True):
        problem = refused(replace(result, coefficients=vector), "c", tmp_path / "p", force=force)
        assert problem.code == "export.not_finite"


def test_a_target_that_cannot_be_written(tmp_path: Path) -> None:
    result = with_terms("gyro.bias")
    (tmp_path / "old.h").write_text("mine")
    with pytest.raises(FoucaultError, match="cannot be written: No such file or directory"):
        write(result, "c", tmp_path / "missing" / "x.h")
    with pytest.raises(FoucaultError, match="it is a folder"):
        write(result, "c", tmp_path)
    with refuses("output.other", "no earlier output of this command"):
        write(result, "c", tmp_path / "old.h")
    assert (tmp_path / "old.h").read_text() == "mine"
    write(result, "c", tmp_path / "old.h", force=True)
    for receiver in RECEIVERS:  # an earlier export of any kind
        own = receivers().get(receiver)
        drop = [] if own is None or own.before or "gyro.bias" in own.takes else ["gyro.bias"]
        write(result, receiver, tmp_path / "old.h", drop=drop, noise=LOUD)
    write(result, "c", tmp_path / "old.h")
    assert (tmp_path / "old.h").read_text().startswith("/*")


def test_ros_is_no_mistake(tmp_path: Path) -> None:
    result = with_terms("accel.bias")
    want = write(result, "ros2", tmp_path / "a").read_text()
    for other in ("ros", "ros1", "imu_calib"):
        assert write(result, other, tmp_path / "b").read_text() == want


@pytest.mark.parametrize(
    "family", ["gyro.asymmetry", "gyro.cubic", "accel.asymmetry", "gyro.deflection"]
)
@pytest.mark.parametrize("receiver", ["kalibr", "imucal", "px4", "ros2"])
def test_scale_factor_terms_are_refused_where_there_is_no_place(
    family: str, receiver: str, tmp_path: Path
) -> None:
    result = with_terms(family, "accel.scale")
    names = [n for n in result.coefficients.names if n.startswith(family)]
    first, last = names[0], names[-1]
    with refuses("export.inexpressible", match=f"cannot express {first}, {family}."):
        write(result, receiver, tmp_path / "out")
    text = write(result, receiver, tmp_path / "out", drop=[family], noise=LOUD).read_text()
    assert f"{last} = {result.coefficients.value(last)!r}" in text


def test_a_receiver_in_capitals_is_suggested_as_it_is_written():
    assert suggestion("ROS2", RECEIVERS) == " Did you mean 'ros2'?"
