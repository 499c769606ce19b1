"""Logs of a north seeker: described, titled, written, and refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.logs.indexed import _swings, read
from foucault.logs.indexed_own import IndexedDescription, description_of, log_table, write
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise
from foucault.simulate.north import (
    NorthPlan,
    Placement,
    Rotation,
    Stops,
    simulate_north,
)
from foucault.tables import IndexedLog
from refusals import refused
from sessions import codes

HOUR = np.pi / 648000  # deg/h
COUNTS = """\
station;t;base;u;ax;ay;table
A;0;10,0;1000,5;0,1;0,02;350,0
A;60;100,0;-200,5;0,1;0,02;350,0
;120;55,0;0;0;0;
B;180;190,0;300,0;0,2;0,03;
"""
BLOCK = {
    "file": "log.csv", "decimal": ",", "delimiter": ";", "setup": "station",
    "time": {"column": "t", "unit": "s"},
    "index": {"column": "base", "unit": "deg", "zero": "10 deg", "sense": "counter-clockwise"},
    "gyro": {"column": "-u", "unit": "count", "scale": "1e6 count/(deg/s)", "zero": 0.5},
    "accel": {"columns": ["ax", "ay"], "unit": "g", "reads": "gravity"},
    "heading": {"column": "table", "unit": "deg"},
}  # fmt: skip
MEANS = {
    "file": "log.csv", "setup": "setup", "index": {"column": "index", "unit": "deg"},
    "gyro": {"column": "gyro", "unit": "deg/h"}, "averaged": {"column": "dwell", "unit": "s"},
}  # fmt: skip


def read_text(folder: Path, text: str, **words):
    (folder / "log.csv").write_text(text)
    return read(IndexedDescription.model_validate({**MEANS, **words}), folder)


def rows(index, gyro, *, setup="A", dwell=60.0, more=()):
    out = ["setup,index,gyro,dwell" + "".join(f",{name}" for name, _ in more)]
    for k, (a, u) in enumerate(zip(index, gyro, strict=True)):
        extra = "".join(f",{values[k]}" for _, values in more)
        out.append(f"{setup if isinstance(setup, str) else setup[k]},{a},{u},{dwell}{extra}")
    return "\n".join(out) + "\n"


FOUR = (0, 180, 90, 270)
RATES = (10.0, -9.0, 5.0, -4.0)


def test_a_described_file_in_si(tmp_path):
    (tmp_path / "log.csv").write_text(COUNTS)
    log = read(IndexedDescription.model_validate(BLOCK), tmp_path)
    np.testing.assert_allclose(log.index, -np.radians([0, 90, 180]), atol=1e-15)
    np.testing.assert_allclose(log.gyro, -np.radians([1000e-6, -201e-6, 299.5e-6]), rtol=1e-12)
    np.testing.assert_allclose(
        log.accel, -9.80665 * np.array([[0.1, 0.02], [0.1, 0.02], [0.2, 0.03]])
    )
    np.testing.assert_array_equal(log.setup, [0, 0, 1])
    assert log.names == ("A", "B")
    np.testing.assert_allclose(np.degrees(log.heading), [350, 350, np.nan])
    assert log.averaged is None and log.source["rows"] == 3 and len(log) == 3
    assert log.interval == 60.0


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
@pytest.mark.parametrize("accel", ["base", "case", None])
@pytest.mark.parametrize("kind", ["means", "samples"])
def test_what_is_written_is_read_to_the_bit(tmp_path, suffix, accel, kind):
    setups = tuple(Placement(f"mark {k}", 0.3 * k, 0.02, -0.01) for k in range(3))
    plan = NorthPlan(setups, Stops(np.radians(FOUR), np.full(4, 20.0)))
    log = simulate_north(plan, model=ImuModel(), noise=ImuNoise(), site=Site.at(0.5), accel=accel,
                         rows=kind, rate=1.0, reference=kind == "means").log  # fmt: skip
    file = tmp_path / f"log.{suffix}"
    write(log, file)
    described, (note,) = description_of(file)
    import tomllib

    text = log_table(log).replace("log.csv", file.name)
    stated = IndexedDescription.model_validate(tomllib.loads(text)["log"])
    for description in (described, stated):
        back = read(description, tmp_path)
        for name in ("time", "index", "gyro", "accel", "setup", "heading", "averaged"):
            np.testing.assert_array_equal(getattr(back, name), getattr(log, name), name)
        assert back.names == log.names and back.findings == ()
        assert back.duration == log.duration
    assert note.code == "north.titles" and "gyro in rad/s" in note.message
    assert "Index angles count clockwise seen from above" in note.message


def test_the_table_of_the_template_is_valid():
    import tomllib

    IndexedDescription.model_validate(tomllib.loads(log_table())["log"])


@pytest.mark.parametrize(
    ("titles", "reads", "sign"),
    [
        ("index (deg),gyro (deg/h),specific force (g),dwell (s)", None, 1.0),
        ("Index [deg],Gyro_dph,gravity (g),dwell_s", None, -1.0),
        ("index_deg,gyro (deg/h),accel_g,dwell (s)", "gravity", -1.0),
        ("angle (deg),rate (deg/h),accel (g),averaged (s)", "specific force", 1.0),
    ],
)
def test_titles_describe_a_file(tmp_path, titles, reads, sign):
    (tmp_path / "r.csv").write_text(titles + "\n90,15.0,0.1,60\n270,-15,-0.1,60\n")
    described, _ = description_of(tmp_path / "r.csv", reads)
    log = read(described, tmp_path)
    np.testing.assert_allclose(log.gyro, [15 * HOUR, -15 * HOUR])
    np.testing.assert_allclose(log.accel[:, 0], sign * 0.980665 * np.array([1, -1]))
    np.testing.assert_allclose(log.index, np.radians([90, 270]))
    np.testing.assert_allclose(log.time, [0, 60])


@pytest.mark.parametrize(
    ("titles", "reads", "code", "words"),
    [
        ("index (deg),gyro (deg/h),accel (g),dwell (s)", None, "north.accel_sign",
         "the title accel \\(g\\) does not say it, so it is not known.*--accel-reads gravity"),
        ("index (deg),gyro (deg/h),gravity (g),dwell (s)", "specific force", "north.accel_sign",
         "contradict one another"),
        ("index (deg),gyro (deg/h),accel (g),dwell (s)", "up", "north.accel_sign", "is neither"),
        ("index (deg),u,accel (g),dwell (s)", None, "north.bare", "no column .* title of gyro"),
        ("index,gyro (deg/h),accel (g),dwell (s)", None, "north.bare", "title index gives no unit"),
        ("index (deg),gyro (furlong),a (g),dwell (s)", None, "north.bare", "furlong"),
        ("index (deg),gyro (deg/h),accel (g),x", None, "north.bare", "title of time or dwell"),
        ("index (deg),gyro (deg/h),accel_x (g),dwell (s)", None, "north.bare", "two acc.* only"),
        ("index (deg),gyro (deg/h),accel_x (g),accel (g),dwell (s)", None, "north.bare", "more th"),
    ],
)  # fmt: skip
def test_titles_that_do_not(tmp_path, titles, reads, code, words):
    (tmp_path / "r.csv").write_text(titles + "\n" + ",".join("1" * len(titles.split(","))) + "\n")
    problem = refused(description_of, tmp_path / "r.csv", reads)
    assert problem.code == code
    with pytest.raises(FoucaultError, match=words):
        raise problem
    (tmp_path / "bare.csv").write_text("1,2,3\n4,5,6\n")
    assert "the file has no titles" in refused(description_of, tmp_path / "bare.csv").message


def test_signs_and_columns_of_the_description():
    def described(**accel):
        return IndexedDescription.model_validate(MEANS | {"accel": accel})

    problem = refused(described, column="a", unit="g")
    assert problem.code == "north.accel_sign"
    assert 'Write reads = "specific force" or reads = "gravity"' in problem.cure
    signed = {"unit": "g", "reads": "gravity"}
    assert refused(described, **signed).code == "north.accel_columns"
    assert "column and columns" in refused(described, column=1, columns=[1, 2], **signed).message
    assert "two scales" in refused(described, column=1, zero=(1.0, 2.0), **signed).message
    counts = signed | {"column": 1, "unit": "count"}
    assert refused(described, **counts).code == "log.count_scale"
    bad = {"index": {"column": 0, "unit": "deg/h"}}
    assert refused(IndexedDescription.model_validate, MEANS | bad).code == "unit.kind"
    alone = {k: v for k, v in MEANS.items() if k != "averaged"}
    assert refused(IndexedDescription.model_validate, alone).code == "log.no_time"
    nowhere = {k: v for k, v in MEANS.items() if k != "file"}
    assert refused(IndexedDescription.model_validate, nowhere).code == "log.no_file"


def test_setups_are_runs_of_names_or_headings(tmp_path):
    log = read_text(tmp_path, rows(FOUR, RATES, setup=list("ABBA")))
    np.testing.assert_array_equal(log.setup, [0, 1, 1, 2])
    assert log.names == ("A", "B", "A (2)")
    assert codes(log) == ["north.setup_again"]
    assert "'A' comes again at row 3" in log.findings[0].message
    turned = rows(FOUR, RATES, more=[("table", (359.99, 0.01, 30, 30.02))])
    heading = {"column": "table", "unit": "deg"}
    log = read_text(tmp_path, turned, setup=None, heading=heading)
    np.testing.assert_array_equal(log.setup, [0, 0, 1, 1])
    assert log.names == ("359.99 deg", "30 deg")
    problem = refused(read_text, tmp_path, turned, heading=heading)
    assert problem.code == "north.heading_moves"
    assert "changes by 30 deg within set-up 'A'" in problem.message
    assert read_text(tmp_path, rows(FOUR, RATES), setup=None).names == ("1",)


def test_samples_that_cannot_be(tmp_path):
    holes = rows(FOUR, (1.0, "", 2.0, 3.0))
    assert refused(read_text, tmp_path, holes).code == "log.missing_value"
    log = read_text(tmp_path, holes, missing="drop")
    assert len(log) == 3 and codes(log) == ["log.dropped"]
    assert refused(read_text, tmp_path, rows(FOUR, RATES, dwell=0)).code == "log.averaged"
    time = {"column": "t", "unit": "s"}
    back = rows(FOUR, RATES, more=[("t", (0, 70, 60, 120))])
    assert refused(read_text, tmp_path, back, time=time).code == "log.time_backward"
    samples = {"time": time, "averaged": None}
    assert refused(read_text, tmp_path, back, **samples).code == "log.time_backward"
    again = rows(FOUR, RATES, setup=list("AABB"), more=[("t", (0, 1, 0, 1))])
    assert codes(read_text(tmp_path, again, **samples)) == []  # the clock starts anew
    n = 40
    gap = rows([0] * n, [1.0] * n, more=[("t", [*range(20), *range(30, 50)])])
    assert codes(read_text(tmp_path, gap, **samples)) == ["log.gap"]
    twice = rows([0, 0, 0], [1.0] * 3, more=[("t", (0, 0, 1))])
    assert codes(read_text(tmp_path, twice, **samples)) == ["log.rows_doubled"]
    date = rows(FOUR, RATES, more=[("t", [f"2026-05-04T10:00:0{k}" for k in range(4)])])
    assert refused(read_text, tmp_path, date, **samples).code == "log.time_iso"


RADIANS = tuple(np.round(np.radians(FOUR), 4))


@pytest.mark.parametrize(
    ("index", "gyro", "words", "code", "said"),
    [
        (RADIANS, RATES, {}, "north.index_unit", 'unit = "rad" in [log.index]'),
        (FOUR, RATES, {"index": {"column": "index", "unit": "rad"}}, "north.index_unit",
         'unit = "deg" in [log.index]'),
        (FOUR, np.array(RATES) / 3600, {}, "north.gyro_unit", 'unit = "deg/s" in [log.gyro]'),
        (FOUR, np.array(RATES) * HOUR, {}, "north.gyro_unit", 'unit = "rad/s" in [log.gyro]'),
        (FOUR, RATES, {"gyro": {"column": "gyro", "unit": "deg/s"}}, "north.gyro_unit",
         'unit = "deg/h" in [log.gyro]'),
        (FOUR, np.array(RATES) * 17.0, {}, "north.gyro_unit", "Check unit, scale and column"),
    ],
)  # fmt: skip
def test_units_that_do_not_fit(tmp_path, index, gyro, words, code, said):
    log = read_text(tmp_path, rows(index, gyro), **words)
    assert codes(log) == [code]
    assert said in log.findings[0].cure


def test_units_that_fit_say_nothing(tmp_path):
    """Large biases, noisy samples, poles, a turning base: nothing of it is a wrong unit."""
    biased = np.array(RATES) + 500.0
    assert codes(read_text(tmp_path, rows(FOUR, biased))) == []
    assert codes(read_text(tmp_path, rows((0, 180), (12.0, -12.0)))) == []
    radians = {"index": {"column": "index", "unit": "rad"}}
    assert codes(read_text(tmp_path, rows(np.radians(FOUR), RATES), **radians)) == []
    rng = np.random.default_rng(1)
    n = 400
    noisy = 300 * rng.standard_normal(n)
    time = ("t", np.arange(n))
    samples = {"time": {"column": "t", "unit": "s"}, "averaged": None}
    assert codes(read_text(tmp_path, rows([90] * n, noisy, more=[time]), **samples)) == []
    plan = NorthPlan((Placement("A", 1.0, 0.1, 0.1),), Rotation(7.0, 0.1))
    for latitude in (-1.55, 0.0, 1.55):
        log = simulate_north(plan, model=ImuModel(), noise=ImuNoise(), site=Site.at(latitude),
                             rows="samples").log  # fmt: skip
        write(log, tmp_path / "log.csv")
        described, _ = description_of(tmp_path / "log.csv")
        assert codes(read(described, tmp_path)) == []


@pytest.mark.parametrize(
    ("values", "unit", "said"),
    [
        ((4.0, -4.0, 1.0, -1.0), "g", 'unit = "m/s^2" in [log.accel]'),
        ((300.0, -300.0, 1.0, -1.0), "g", 'unit = "mg" in [log.accel]'),
        ((1e9, -1e9, 1.0, -1.0), "g", "Check unit, scale, zero and columns"),
    ],
)
def test_more_than_gravity(tmp_path, values, unit, said):
    accel = {"column": "a", "unit": unit, "reads": "specific force"}
    text = rows(FOUR, RATES, more=[("a", values)])
    log = read_text(tmp_path, text, accel=accel)
    assert codes(log) == ["north.accel_unit"]
    assert said in log.findings[0].cure
    pair = {"columns": ["a", "a"], "unit": unit, "reads": "specific force"}
    assert codes(read_text(tmp_path, text, accel=pair)) == ["north.accel_unit"]


def test_names_that_no_table_can_hold(tmp_path):
    plan = NorthPlan((Placement("pit, level 3", 0.0),), Stops(np.zeros(1), np.ones(1)))
    log = simulate_north(plan, model=ImuModel(), noise=ImuNoise(), site=Site.at(0.5)).log
    problem = refused(write, log, tmp_path / "log.csv")
    assert problem.code == "north.setup_name" and "'pit, level 3'" in problem.message
    write(log, tmp_path / "log.parquet")
    described, _ = description_of(tmp_path / "log.parquet")
    assert read(described, tmp_path).names == ("pit, level 3",)
    assert refused(write, log, tmp_path / "log.xlsx").code == "log.cannot_write"


def test_the_largest_swing_is_that_of_fits_one_by_one():
    """Whatever stops a set-up has: four, two opposite ones, one alone, a bias over all."""
    rng = np.random.default_rng(4)
    stops = [[0, 90, 180, 270], [0, 180], [90], [0, 120, 240], [0, 90, 180, 270]]
    setup = np.repeat(np.arange(5), [len(s) for s in stops])
    index = np.radians(np.concatenate(stops))
    size = np.array([1.0, 0.3, 50.0, 0.8, 1.2])[setup]
    gyro = 40.0 + size * np.cos(index - setup) + 0.01 * rng.standard_normal(len(setup))
    log = IndexedLog(np.arange(15.0)[: len(setup)], index, gyro, None, setup, tuple("abcde"))
    found, sd = _swings(log, [gyro])[0]
    A = np.column_stack([np.ones(4), np.cos(index[-4:]), np.sin(index[-4:])])
    fit, left, _, _ = np.linalg.lstsq(A, gyro[-4:] - 40.0)
    assert found == pytest.approx(np.hypot(*fit[1:]), rel=1e-12)
    assert sd == pytest.approx(np.sqrt(left[0] / 1 * 2 / 4), rel=1e-9)
    alone = IndexedLog(np.zeros(1), index[6:7], gyro[6:7], None, np.zeros(1, int), ("c",))
    assert _swings(alone, [gyro[6:7]]) == [(0.0, np.inf)]


def test_names_are_read_whatever_their_bytes(tmp_path):
    """UTF-8, Windows-1252, a mark of the byte order amid a file; rows without one are left out."""
    file = tmp_path / "log.csv"
    title = b"setup,index (deg),gyro (deg/h),dwell (s)\n"
    for name, want in ((b"Ost", "Ost"), ("S\u00fcd".encode(), "S\u00fcd"), (b"S\xfcd", "S\u00fcd"),
                       ("\ufeffOst".encode(), "Ost")):  # fmt: skip
        rows = [b"West", b"West", b"", name, name + b" ", b"West"]
        lines = (b"%s,%d,1.0,60\n" % (row, 90 * k) for k, row in enumerate(rows))
        file.write_bytes(title + b"".join(lines))
        log = read(description_of(file, None)[0], tmp_path)
        assert log.names == ("West", want, "West (2)")
        assert log.setup.tolist() == [0, 0, 1, 1, 2]
