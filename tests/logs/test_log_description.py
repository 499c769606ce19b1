"""The ``[log]`` block: what it accepts, refuses, and means."""

import json
import tomllib

import jsonschema
import numpy as np
import pytest
from pydantic import ValidationError

from foucault.errors import FoucaultError
from foucault.logs import LogDescription, read
from refusals import refuses

TOML = """
file = "session.csv"
[time]
column = "t"
unit = "ms"
[gyro]
columns = ["gx", "-gy", "gz"]
unit = "count"
scale = ["16 count/(deg/s)", "16 count/(deg/s)", "-16 count/(deg/s)"]
zero = [1, 2, 3]
saturation = [-32768, 32767]
[accel]
columns = [4, 5, "-6"]
unit = "mg"
reads = "gravity"
first_rest = "z up"
[temperature]
column = "temp"
unit = "degC"
"""
CSV = """t,gx,gy,gz,ax,ay,az,temp
0,17,18,19,10,20,1000,20
10,33,34,35,10,20,1000,21.5
20,17,18,19,11,21,1001,22
"""


def test_units_signs_scales_and_zeros(tmp_path):
    (tmp_path / "session.csv").write_text(CSV)
    log = read(LogDescription.model_validate(tomllib.loads(TOML)), tmp_path)
    assert log.time == pytest.approx([0.0, 0.01, 0.02], abs=1e-15)
    one = np.pi / 180
    assert log.gyro[:2] == pytest.approx(np.array([[1, -1, -1], [2, -2, -2]]) * one, rel=1e-14)
    g = 9.80665e-3
    assert log.accel[0] == pytest.approx([-10 * g, -20 * g, 1000 * g], rel=1e-14)
    assert log.temperature == pytest.approx([293.15, 294.65, 295.15], abs=1e-12)


def test_increments_become_means_over_their_interval(tmp_path):
    rng = np.random.default_rng(4)
    time = np.cumsum(rng.uniform(0.0099, 0.0101, 50))
    time[30:] += 0.5
    dtheta, dvel = rng.normal(0, 40, (2, 50, 3))
    dvel[:, 2] += 1000
    np.save(tmp_path / "a.npy", np.column_stack([time, dtheta, dvel]))
    words = {
        "file": "a.npy",
        "time": {"column": 0, "unit": "s"},
        "gyro": {"columns": [1, 2, 3], "unit": "0.1 arcsec", "kind": "increment"},
        "accel": {"columns": [4, 5, 6], "unit": "10 ug*s", "kind": "increment"},
    }
    log = read(LogDescription.model_validate(words), tmp_path)
    assert log.sampled == "increment"
    dt = np.diff(time, prepend=np.nan)
    # Nothing before the first; a gap is no interval.
    dt[[0, 30]] = np.delete(np.diff(time), 29).mean()
    arcsec = np.pi / 648000
    assert log.gyro * dt[:, None] == pytest.approx(0.1 * arcsec * dtheta, rel=1e-12)
    assert log.accel * dt[:, None] == pytest.approx(1e-5 * 9.80665 * dvel, rel=1e-12)
    assert [f.code for f in log.findings] == ["log.gap"]


def test_gravity_block_alone(tmp_path):
    (tmp_path / "session.csv").write_text(CSV)
    words = {"file": "session.csv", "rate": "50 Hz", "accel": {"unit": "mg"}}
    log = read(LogDescription.model_validate(words), tmp_path)
    assert log.gyro is None
    assert log.rate == pytest.approx(50.0)


GYRO = {"columns": ["gx", "gy", "gz"], "unit": "deg/s"}
ACCEL = {"columns": ["ax", "ay", "az"], "unit": "g"}


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        ({"gyro": {**GYRO, "columns": ["gx", "gy"]}}, "log.three_columns", "is not a list of"),
        ({"gyro": {**GYRO, "unit": "deg"}}, "log.kind", 'Write kind = "increment"'),
        ({"accel": {**ACCEL, "unit": "m/s"}}, "log.kind", "'m/s' is a unit of increments"),
        ({"gyro": {**GYRO, "unit": "g"}}, "unit.kind", "'g' does not measure angular rate"),
        ({"gyro": {**GYRO, "unit": "degg/s"}}, "unit.unknown", "Did you mean deg"),
        ({"gyro": {**GYRO, "unit": "count"}}, "log.count_scale", '4778 count/(rad/s)"'),
        (
            {"gyro": {**GYRO, "unit": "count", "kind": "increment", "scale": "1 count/(rad/s)"}},
            "log.count_scale",
            'unit = "0.1 arcsec"',
        ),
        (
            {"gyro": {**GYRO, "unit": "count", "scale": "415 count/(m/s^2)"}},
            "unit.kind",
            "does not measure gyro count scale",
        ),
        ({"gyro": {**GYRO, "unit": "count", "scale": "0 count/dps"}}, "log.scale_zero", "zero"),
        ({"gyro": {**GYRO, "zero": 3}}, "log.scale_without_count", "its unit is 'deg/s'"),
        ({"accel": {**ACCEL, "scale": "3 count/g"}}, "log.scale_without_count", "'g'"),
        ({"rate": "100 Hz", "time": {"unit": "s"}}, "log.time_and_rate", "Keep [log.time]"),
        ({"rate": "100"}, "unit.missing", '"100 Hz"'),
        ({"rate": "-1 Hz"}, "log.rate", "rate = -1 Hz is not the rate of a log"),
        ({"rate": "1e30 Hz"}, "log.rate", "rate = 1e+30 Hz is not the rate of a log"),
        ({"clock_sd": "2"}, "unit.missing", "200 ppm"),
        ({"gyro": {**GYRO, "unit": "0 rad/s"}}, "unit.size", "every reading would be zero"),
        ({"accel": {**ACCEL, "unit": "1e300 g"}}, "unit.size", "every reading would be too large"),
        ({"time": {"unit": "0 s"}}, "unit.size", "'0 s' is no size of one time"),
        ({"time": {"unit": "m"}}, "unit.kind", "'m' does not measure time"),
        ({"temperature": {"unit": "deg"}}, "unit.kind", "does not measure temperature"),
        ({"record": {"type": "float32"}}, "log.record_columns", "how many numbers"),
        ({"file": None}, "log.no_file", 'file = "session.csv"'),
        (
            {"gyro": {**GYRO, "unit": "deg", "kind": "increment"}, "accel": ACCEL},
            "log.kinds_differ",
            'kind = "increment" but [log.accel] has kind = "rate"',
        ),
    ],
)
def test_mistakes(words, code, text):
    with refuses(code) as caught:
        LogDescription.model_validate({"file": "a.csv", **words})
    assert text in str(caught.value)


def test_unknown_keys_and_words_are_refused():
    for words in ({"fiel": "a"}, {"gyro": {**GYRO, "axis": 1}}, {"accel": {**ACCEL, "reads": "f"}}):
        with pytest.raises(ValidationError):
            LogDescription.model_validate({"file": "a.csv", **words})


def test_json_schema_accepts_the_example():
    schema = LogDescription.model_json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(tomllib.loads(TOML), schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({"file": "a.csv", "rate": 100}, schema)


def test_the_description_survives_in_the_source(tmp_path):
    (tmp_path / "session.csv").write_text(CSV)
    description = LogDescription.model_validate(tomllib.loads(TOML))
    source = read(description, tmp_path).source
    again = LogDescription.model_validate(json.loads(json.dumps(source["description"])))
    assert again == description


INCREMENTS = {
    "gyro": {"columns": [1, 2, 3], "unit": ["1 arcsec", "2 arcsec", "4 arcsec"],
             "kind": "increment"},
    "accel": {"columns": [4, 5, 6], "unit": "0.01 m/s", "kind": "increment"},
}  # fmt: skip


def pulses(tmp_path, **words):
    rows = [[0.1 * k, 8 + k, 4, 2, 0, 0, 98] for k in range(10) if k != 6]
    lines = "\n".join(",".join(f"{v:g}" for v in row) for row in rows)
    (tmp_path / "pulses.csv").write_text(lines + "\n")
    said = {"file": "pulses.csv", "time": {"column": 0, "unit": "s"}, **INCREMENTS, **words}
    return read(LogDescription.model_validate(said), tmp_path)


def test_every_axis_may_have_its_own_weight_of_a_pulse(tmp_path):
    log = pulses(tmp_path)
    arcsec = np.pi / 648000
    assert log.gyro[0] == pytest.approx([80 * arcsec] * 2 + [80 * arcsec])
    with pytest.raises(FoucaultError, match="'deg/s' is a unit of rates"):
        wrong = {**INCREMENTS["gyro"], "unit": ["1 arcsec", "deg/s", "1 arcsec"]}
        LogDescription.model_validate({"file": "a.csv", "gyro": wrong})
    with pytest.raises(FoucaultError, match="scale or a zero"):
        wrong = {**INCREMENTS["gyro"], "zero": 3}
        LogDescription.model_validate({"file": "a.csv", "gyro": wrong})


def test_increments_stamped_at_the_start_belong_to_the_end_of_their_interval(tmp_path):
    end, start = pulses(tmp_path), pulses(tmp_path, stamped="start")
    assert len(start) == len(end) - 1
    # The row of 0.5 s, before the gap, ends at 0.6 s; the others where the next begins.
    assert start.time == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 0.9])
    assert start.gyro[:, 0] == pytest.approx(end.gyro[:-1, 0])
    assert end.time[0] == 0.0
