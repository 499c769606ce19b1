"""Bare logs with a trap: nothing is read wrong without a word."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

import make_bare as make
from foucault import logs
from foucault.campaign.recognised import found
from foucault.errors import FoucaultError
from foucault.logs import LogDescription
from foucault.models.rotation import exp
from foucault.recognise.columns import unwrapped
from foucault.recognise.reading import recognise
from foucault.recognise.titles import meaning
from refusals import refuses

REAL = Path(os.environ.get("FOUCAULT_DATA", Path(__file__).parents[3] / "shared" / "data"))
HEAD, FORM = "t,ax,ay,az,gx,gy,gz", ["%.6f"] * 7


@pytest.fixture(scope="module")
def log():
    return make.truth(1, 50.0, 12)


@pytest.fixture
def c(log):
    return make.Columns.of(log)


def taken(seen, what: str) -> list[str]:
    return [f"{line.took} ({line.why})" for line in seen.lines if line.what == what]


def right(seen, log, folder: Path) -> None:
    assert not seen.questions
    force, rate, clock, axes = make.off(seen, log, folder)
    assert max(force, rate) < 2e-3
    assert clock < 1e-6
    np.testing.assert_array_equal(axes, np.eye(3))


# -- clocks ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("unit", "bits"), [(1e3, 16), (1e6, 32)])
def test_a_counter_that_begins_again_is_a_rate(log, c, tmp_path, unit, bits):
    ticks = np.mod(np.round(unit * c.t) + 2**bits - unit * 20, 2**bits)
    file = tmp_path / "wraps.csv"
    file.write_text(make.text(HEAD, [ticks, c.f, c.w], ["%.0f", *FORM[1:]]))
    seen = recognise([file])
    assert "begins again" in taken(seen, "rate")[0]
    right(seen, log, tmp_path)


def test_only_a_counter_is_unwrapped():
    t = np.arange(0.0, 3000.0, 20.0)
    wrapped = np.mod(t + 65000.0, 65536.0)
    np.testing.assert_array_equal(unwrapped(wrapped) - 65000.0, t)
    restarted = np.concatenate([t, t])
    assert unwrapped(restarted) is restarted
    halves = wrapped + 0.5
    assert unwrapped(halves) is halves


def test_a_clock_that_wraps_and_jitters_is_refused(c, tmp_path):
    t = np.cumsum(np.random.default_rng(3).integers(15, 26, len(c.t)))
    file = tmp_path / "jitters.csv"
    file.write_text(make.text(HEAD, [np.mod(t + 60000, 65536), c.f, c.w], ["%.0f", *FORM[1:]]))
    with pytest.raises(FoucaultError, match="runs backward"):
        found([file])


def test_a_date_that_cannot_be_read_is_named(c, tmp_path):
    rows = make.numbers(np.column_stack([c.f, c.w]), FORM[1:], ";").splitlines()
    file = tmp_path / "dates.csv"
    stamps = [f"4 May 10h 0m {s:06.3f}s" for s in c.t]
    lines = ["Datum;ax;ay;az;gx;gy;gz", *map(";".join, zip(stamps, rows, strict=True))]
    file.write_text("\n".join(lines))
    assert "'Datum' cannot be read" in taken(recognise([file]), "rate")[0]


# -- titles ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("title", "role", "axis"), [
    ("x", "", 0), ("Z (m/s^2)", "", 2), ("q_w", "other", None), ("p_x_m", "other", 0),
    ("t", "time", None), ("Prędkość kątowa Y [rad/s]", "gyro", 1), ("Blorp Y", "", 1),
])  # fmt: skip
def test_an_axis_is_read_where_the_sensor_is_not(title, role, axis):
    said = meaning(title)
    assert (said.role, said.axis) == (role, axis)


def test_files_named_after_a_sensor_say_what_their_axes_are(log, c, tmp_path):
    head = "time,seconds_elapsed,z,y,x"
    files = [tmp_path / "Accelerometer.csv", tmp_path / "Gyroscope.csv"]
    for file, x in zip(files, (c.f, c.w), strict=True):
        file.write_text(make.text(head, [1.7e9 + c.t, c.t, x[:, ::-1]], ["%.3f", *FORM[1:5]]))
    right(recognise(files), log, tmp_path)
    assert recognise(files[:1]).log["accel"]["columns"] == ["x", "y", "z"]


def test_axes_in_words_that_no_one_knows_keep_their_order(log, c, tmp_path):
    head = "t,Fu Z,Fu Y,Fu X,Ba Z,Ba Y,Ba X"
    file = tmp_path / "words.csv"
    file.write_text(make.text(head, [c.t, c.f[:, ::-1], c.w[:, ::-1]], FORM))
    seen = recognise([file])
    assert seen.log["accel"]["columns"] == ["Fu X", "Fu Y", "Fu Z"]
    right(seen, log, tmp_path)


# -- triads ------------------------------------------------------------------------------------


def test_columns_are_no_gyros_without_accelerometers(c, tmp_path):
    file = tmp_path / "pose.csv"
    move = np.cumsum(c.w, axis=0) * 0.02
    for head, parts in (
        ("t,p_x,p_y,p_z,q_w", [c.t, move, c.f[:, :1] / 9.8]),
        ("", [c.w]),
        ("", [c.t, c.w]),
    ):
        file.write_text(make.text(head, parts, FORM[: np.column_stack(parts).shape[1]]))
        with refuses("recognise.no_triad"):
            recognise([file])


@pytest.mark.parametrize("name", ["w1", "g", "Gyroscope", "imu"])
@pytest.mark.parametrize("titles", ["x,y,z", "a,b,c"])
def test_a_name_does_not_make_gyros_of_what_feels_gravity(c, tmp_path, name, titles):
    file = tmp_path / f"{name}.csv"
    file.write_text(make.text(f"time,{titles}", [c.t, c.f], ["%.6f"] * 4))
    seen = recognise([file])
    assert seen.description().accel.columns == tuple(titles.split(","))
    assert seen.description().gyro is None
    file.write_text(make.text("time,x,y,z", [c.t, c.w], ["%.6f"] * 4))
    if name == "Gyroscope":  # and gyros stay gyros
        assert recognise([file]).description().accel is None


def test_a_magnetometer_alone_is_told_so(c, tmp_path):
    file = tmp_path / "Magnetometer.csv"
    file.write_text(make.text("time,x,y,z", [c.t, c.f], ["%.6f"] * 4))
    with refuses("recognise.mag_alone", match="a magnetometer alone"):
        recognise([file])
    said = {"accel": {"columns": [1, 2, 3]}}
    assert recognise([file], said).description().accel.columns == ("x", "y", "z")


def test_a_dead_axis_is_refused_and_dead_gyros_are_left_out(c, tmp_path):
    file = tmp_path / "dead.csv"
    for triad, f, w in (("accel", c.f * [1, 1, 0], c.w), ("gyro", c.f, c.w * [0, 1, 1])):
        file.write_text(make.text(HEAD, [c.t, f, w], FORM))
        told = f"never changes, though the instrument was turned.*--set .{triad}.columns"
        with pytest.raises(FoucaultError, match=told):
            recognise([file])
    file.write_text(make.text(HEAD, [c.t, c.f, 0 * c.w], FORM))
    seen = recognise([file])
    assert "gyro" not in seen.log
    assert taken(seen, "gyros") == ["none (gx, gy, gz never change)"]


@pytest.mark.parametrize("how", ["newest first", "in no order"])
def test_rows_that_are_not_in_the_order_of_time_are_refused(c, tmp_path, how):
    """Turned round, gyros seem reversed: a mirrored calibration passed, with wrong signs."""
    order = np.arange(len(c.t))[::-1]
    if how == "in no order":
        order = np.random.default_rng(1).permutation(order)
    file = tmp_path / "turned.csv"
    file.write_text(make.text(HEAD, [c.t[order], c.f[order], c.w[order]], FORM))
    share = "100 %" if how == "newest first" else "50 %"
    with refuses("recognise.order", match=f"runs backward in {share} of its rows"):
        recognise([file])
    assert recognise([file], {"rate": "100 Hz"}).log["rate"] == "100 Hz"
    file.write_text(make.text(HEAD, [c.t % 1.0, c.f, c.w], FORM))  # begins again each second
    assert taken(recognise([file]), "rate")


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_gyros_that_stop_half_way_are_named(c, tmp_path, axis):
    w = c.w.copy()
    w[len(w) // 2 :, : axis + 1] = w[len(w) // 2, : axis + 1]
    file = tmp_path / "half.csv"
    file.write_text(make.text(HEAD, [c.t, c.f, w], FORM))
    try:
        log = recognise([file]).log
    except FoucaultError as problem:
        assert problem.code == "recognise.lost", problem.message
        assert "gx repeats one reading from" in problem.message
        return
    found = logs.read(LogDescription.model_validate(log | {"file": "half.csv"}), tmp_path).findings
    assert [f.message.split()[1] for f in found if f.code == "log.stuck"] == list("xyz"[: axis + 1])


# Alone, the first leaves the rate open, and the second looks as if gravity had been taken off.
@pytest.mark.parametrize(
    ("triad", "share", "axis"), [("accel", 0.1, 0), ("accel", 0.6, 1), ("accel", 0.5, 2)]
)
def test_an_axis_that_stops_on_the_way_is_named(c, tmp_path, triad, share, axis):
    x = {"accel": c.f.copy(), "gyro": c.w.copy()}
    k = int(share * len(c.w))
    x[triad][k:, axis] = x[triad][k, axis]
    file = tmp_path / "half.csv"
    file.write_text(make.text(HEAD, [c.t, x["accel"], x["gyro"]], FORM))
    try:
        log = recognise([file])
    except FoucaultError as problem:
        assert problem.code == "recognise.lost", problem.message
        assert f"{triad[0]}{'xyz'[axis]} repeats one reading from" in problem.message
        return
    assert not log.questions
    found = logs.read(LogDescription.model_validate(log.log), tmp_path).findings
    assert [f.message.split()[1] for f in found if f.code == "log.stuck"] == ["xyz"[axis]]


def test_gyros_of_another_instrument_are_told(c, tmp_path):
    file = tmp_path / "other.csv"
    other = np.roll(c.w, len(c.w) // 3, axis=0)
    file.write_text(make.text(HEAD, [c.t, c.f, other], FORM))
    with pytest.raises(FoucaultError, match="do not turn gravity as its accelerometers say"):
        recognise([file])
    units = "t,ax (m/s^2),ay (m/s^2),az (m/s^2),gx (rad/s),gy (rad/s),gz (rad/s)"
    file.write_text(make.text(units, [c.t, c.f, other], FORM))
    assert "turns do not fit" in taken(recognise([file]), "axes")[0]


def test_gravity_taken_off_is_said_where_gyros_are_left(c, tmp_path):
    file = tmp_path / "linear.csv"
    rng = np.random.default_rng(1)
    head = "t,linear_acc_x,linear_acc_y,linear_acc_z,gx,gy,gz"
    file.write_text(make.text(head, [c.t, rng.normal(0, 0.1, c.f.shape), c.w], FORM))
    seen = recognise([file])
    assert "gravity was taken off" in taken(seen, "accelerometers")[0]


def test_numbers_alone_are_not_sure_without_turns(c, tmp_path):
    file = tmp_path / "three.csv"
    file.write_text(make.text("", [c.f], FORM[:3]))
    line = next(line for line in recognise([file]).lines if line.what == "accelerometers")
    assert line.sure == "likely"


@pytest.mark.skipif(not REAL.is_dir(), reason="real logs are not here: set FOUCAULT_DATA")
def test_real_files_that_are_cut_together_or_hold_poses_are_told():
    for file, code in (("ferraris_session/annotated_session.csv", "recognise.no_turns"),
                       ("broad_hand_motion/03_pose.parquet", "recognise.no_triad"),
                       ("broad_hand_motion/36_pose.parquet", "recognise.no_triad")):  # fmt: skip
        with refuses(code):
            recognise([REAL / file])


# -- as strangers write them ---------------------------------------------------------------------


def of_day(t: float, form: str) -> str:
    return form.format(h=int(t // 3600), m=int(t % 3600 // 60), s=t % 60, half=int(t // 3600) % 12)


@pytest.mark.parametrize("form", [
    "{h:02d}:{m:02d}:{s:06.3f}", "2026/05/04 {h:02d}:{m:02d}:{s:06.3f}",
    "5/4/2026 {half}:{m:02d}:{s:06.3f} PM", "04.05.2026 {h}:{m:02d}:{s:06.3f}",
])  # fmt: skip
def test_times_of_day_give_the_rate(log, c, tmp_path, form):
    file = tmp_path / "clock.csv"
    rows = make.numbers(np.column_stack([c.f, c.w]), FORM[1:]).splitlines()
    start = 13 * 3600.0 if "PM" in form else 86400.0 - 20.0  # it is midnight on the way
    cells = [of_day((start + t) % 86400.0, form) for t in c.t]
    file.write_text("\n".join([HEAD, *map(",".join, zip(cells, rows, strict=True))]) + "\n")
    seen = recognise([file])
    assert "whose times of day are even" in taken(seen, "rate")[0]
    assert float(seen.log["rate"].split()[0]) == pytest.approx(50.0, rel=2e-5)
    cells[1000:] = [of_day((start + 9.0 + t) % 86400.0, form) for t in c.t[1000:]]  # a gap
    file.write_text("\n".join([HEAD, *map(",".join, zip(cells, rows, strict=True))]) + "\n")
    assert "'t' cannot be read" in taken(recognise([file]), "rate")[0]


def test_quotes_groups_of_titles_and_days_are_read(log, c, tmp_path):
    file = tmp_path / "odd.csv"
    body = make.text("", [c.t, c.f, c.w], FORM)
    quoted = [",".join(f'"{x.replace(".", ",")}"' for x in row.split(",")) for row in
              body.splitlines()]  # fmt: skip
    groups = ",Accelerometer,,,Gyroscope,,\nTime,X,Y,Z,X,Y,Z\ns,m/s^2,m/s^2,m/s^2,rad/s,rad/s,rad/s"
    days = make.text(HEAD, [46146.25 + c.t / 86400, c.f, c.w], ["%.12f", *FORM[1:]])
    for text in ("\n".join([HEAD, *quoted]), f"{groups}\n{body}", days):
        file.write_text(text)
        seen = recognise([file])
        assert not seen.questions
        force, rate, clock, axes = make.off(seen, log, tmp_path)
        assert max(force, rate) < 2e-3
        assert clock < 1e-4
        np.testing.assert_array_equal(axes, np.eye(3))
    assert seen.log["time"]["unit"] == "day"


def test_counts_about_the_middle_of_a_converter_are_read(log, c, tmp_path):
    file = tmp_path / "middle.csv"
    counts = [np.round(c.f / make.G * 8192) + 32768, np.round(c.w / make.DEGREE * 65.5) + 32768]
    file.write_text(make.text(HEAD, [np.round(1e3 * c.t), *counts], ["%.0f"] * 7))
    seen = recognise([file])
    assert max(make.off(seen, log, tmp_path)[:2]) < 2e-3  # rounding: the zero is the middle
    for line in seen.lines:
        said = "zero: 32768, the middle of its counts" in line.why
        assert said == (line.what in ("accelerometers", "gyros"))
    moved = [x + at for x, at in zip(counts, (5000.0, -4000.0), strict=True)]  # of its own
    file.write_text(make.text(HEAD, [np.round(1e3 * c.t), *moved], ["%.0f"] * 7))
    seen = recognise([file])
    assert max(make.off(seen, log, tmp_path)[:2]) < 0.05  # the zero is told by a dozen rests
    assert not any("middle of its counts" in line.why for line in seen.lines)
    file.write_text(
        make.text(
            HEAD, [np.round(1e3 * c.t), *(np.mod(x - 32768, 65536) for x in counts)], ["%.0f"] * 7
        )
    )
    with pytest.raises(FoucaultError, match="signed 16-bit counts, written without a sign"):
        recognise([file])


def test_a_temperature_in_fahrenheit_is_one(log, c, tmp_path):
    file = tmp_path / "warm.csv"
    degrees = 32.0 + 1.8 * c.warm
    file.write_text(make.text(f"{HEAD},temp (°F)", [c.t, c.f, c.w, degrees], [*FORM, "%.4f"]))
    read = found([file]).log.temperature
    np.testing.assert_allclose(read, c.warm + 273.15, atol=1e-4)
    file.write_text(make.text(f"{HEAD},temp", [c.t, c.f, c.w, c.warm], [*FORM, "%.4f"]))
    line = next(line for line in recognise([file]).lines if line.what == "temperature")
    assert line.sure == "likely"


def test_a_triad_that_cannot_be_taken_as_it_is_written_is_named(c, tmp_path):
    file = tmp_path / "broken.csv"
    rows = make.text("", [c.t, c.f, c.w], FORM).splitlines()

    def refused(lines: list[str], head: str = HEAD) -> str:
        file.write_text("\n".join([head, *lines]))
        with pytest.raises(FoucaultError) as problem:
            recognise([file])
        return problem.value.message

    cells = [row.split(",") for row in rows]
    assert "'broken.csv' has no readings in az." in refused(
        [",".join([*r[:3], "nan", *r[4:]]) for r in cells]
    )
    words = [",".join([r[0], "ERR", *r[2:]]) if i == 7 else ",".join(r)
             for i, r in enumerate(cells)]  # fmt: skip
    assert "line 9, column 'ax': 'ERR' is not a number" in refused(words)
    units = "t,ax (g),ay (m/s^2),az (mg),gx,gy,gz"
    assert "several units: ax (g), ay (m/s^2), az (mg)" in refused(rows, units)
    file.write_text("\n".join([HEAD, *(",".join([*r[:4], "", "", ""]) for r in cells)]))
    assert "gx, gy, gz are empty" in taken(recognise([file]), "gyros")[0]


def test_a_clock_that_does_not_run_on_is_named(log, c, tmp_path):
    file = tmp_path / "back.csv"
    file.write_text(make.text(HEAD, [0 * c.t, c.f, c.w], FORM))
    assert "t stands still or runs backward" in taken(recognise([file]), "rate")[0]


def test_accelerometers_of_two_ranges_are_asked_about(c, tmp_path):
    file = tmp_path / "ranges.csv"
    head = "t,ax_low,ay_low,az_low,ax_high,ay_high,az_high,gx,gy,gz"
    other = 1.02 * c.f + 0.1 * np.sin(c.t)[:, None]
    file.write_text(make.text(head, [c.t, c.f, other, c.w], ["%.5f"] * 10))
    seen = recognise([file])
    assert seen.log["accel"]["columns"] == ["ax_low", "ay_low", "az_low"]
    assert seen.questions[0].other == "accel.columns = [ax_high, ay_high, az_high]"


def test_hexadecimal_numbers_are_named(c, tmp_path):
    file = tmp_path / "hex.csv"
    rows = np.column_stack([c.t * 1e3, c.f / make.G * 8192, c.w / make.DEGREE * 65.5]).astype(int)
    file.write_text("\n".join([HEAD, *(",".join(f"0x{v & 0xffff:04X}" for v in r) for r in
                                       rows.tolist())]))  # fmt: skip
    with pytest.raises(FoucaultError, match="its numbers are hexadecimal"):
        recognise([file])


@pytest.mark.parametrize(
    "head",
    [
        "cts,day,Accelerometer (m/s^2),1,2,Gyroscope (rad/s),1,2",
        "cts,day,Accelerometer (m/s^2),,,Gyroscope (rad/s),,",
        "cts,day,acc (m/s^2),Unnamed: 3,Unnamed: 4,gyr (rad/s),Unnamed: 6,Unnamed: 7",
    ],
)
def test_one_title_over_three_columns_names_them_all(log, c, tmp_path, head):
    rows = make.numbers(np.column_stack([1e3 * c.t, c.f, c.w]), ["%.3f,mon", *["%.6f"] * 6])
    (tmp_path / "a.csv").write_text(f"{head}\n{rows}")
    seen = recognise([tmp_path / "a.csv"])
    right(seen, log, tmp_path)
    if "1,2" not in head:  # a line with numbers names no columns: these are found by what they read
        assert taken(seen, "accelerometers")[0].endswith("(titles; unit: title)")
        assert taken(seen, "gyros")[0].endswith("(titles; unit: title)")


def test_a_title_over_three_is_none_where_the_next_has_its_own(log, c, tmp_path):
    head = "t (s),acc,2,ay (m/s^2),gx (rad/s),gy (rad/s),gz (rad/s)"
    (tmp_path / "a.csv").write_text(make.text(head, [c.t, c.f, c.w], FORM))
    right(recognise([tmp_path / "a.csv"]), log, tmp_path)


def test_matlab_structures_and_matrices_of_increments_are_read(log, c, tmp_path):
    interval = np.median(np.diff(c.t))
    sums = np.column_stack([c.w * interval, c.f * interval, c.t])
    spread = {"f": {axis: c.f[:, k] for k, axis in enumerate("xyz")}, "w": c.w / make.DEGREE}
    made = {
        "matrix": {"imu": sums, "ts": interval, "avp0": np.zeros((9, 1))},
        "structure": {"imu": {"accel": c.f / make.G, "gyro": c.w / make.DEGREE, "time": c.t}},
        "nested": {"data": {"Accelerometer": spread["f"], "Gyroscope": spread["w"], "Fs": 50.0}},
    }
    for name, content in made.items():
        savemat(tmp_path / f"{name}.mat", content)
        seen = recognise([tmp_path / f"{name}.mat"], {"rate": "50 Hz"} if name == "nested" else {})
        right(seen, log, tmp_path)
    assert recognise([tmp_path / "matrix.mat"]).log["gyro"]["kind"] == "increment"
    one = LogDescription.model_validate({"file": "structure.mat", "variable": "imu", "time": {
        "column": "time", "unit": "s"}, "gyro": {"columns": ["gyro.0", "gyro.1", "gyro.2"],
        "unit": "deg/s"}})  # fmt: skip
    np.testing.assert_allclose(logs.read(one, tmp_path).gyro, c.w, atol=1e-12)


@pytest.mark.parametrize(
    ("row", "why"),
    [
        ("[2024-05-01 12:00:00.123] %.3f,%.3f,%.3f,%.3f,%.3f,%.3f", "a time in brackets"),
        ("%.3fD+00 %.3fD+00 %.3fD+00 %.3fD+00 %.3fD+00 %.3fD+00", "exponents are written with a D"),
    ],
)
def test_stamps_in_brackets_and_exponents_with_d_are_named(c, tmp_path, row, why):
    lines = [row % tuple(x) for x in np.column_stack([c.f, c.w]).tolist()]
    (tmp_path / "a.log").write_text("\n".join(lines) + "\n")
    with refuses("recognise.no_table", match=why):
        recognise([tmp_path / "a.log"])


def test_forty_columns_do_not_fill_the_screen(c, tmp_path):
    head = ",".join(["t (s)", *(f"speed {k} (m/s)" for k in range(40))])
    noise = np.random.default_rng(3).normal(size=(len(c.t), 40))
    (tmp_path / "a.csv").write_text(make.text(head, [c.t, noise], ["%.6f"] * 41))
    with refuses("recognise.no_triad", match="speed 3 .m/s. and 36 more. No three") as caught:
        recognise([tmp_path / "a.csv"])
    assert len(f"{caught.value.message} {caught.value.cure}".split()) <= 60


def turned(moves: list[tuple[int, float, float, float]], seed: int, rate: float = 100.0):
    """Return time, force and rate of turns about single axes of the body, a rest after each.

    `moves`: axis, angle [rad], how long the turn and the rest after it take [s].
    """
    rng, C, force, rates = np.random.default_rng(seed), np.eye(3), [], []
    for axis, angle, time, rest in [(0, 0.0, 0.0, moves[0][3]), *moves]:
        n, u = round(time * rate), np.eye(3)[axis]
        x = (np.arange(n) + 1) / max(n, 1)
        passed, speed = x**2 * (3 - 2 * x), 6 * x * (1 - x)
        if time > 4:  # at one rate, but for its ends
            ramp = 0.5 / time
            speed = np.clip(np.minimum(x, 1 - x) / ramp, 0.0, 1.0)
            speed /= speed.mean()
            passed = np.cumsum(speed) / n
        force += [C[2] @ exp(u * angle * p) for p in passed]
        rates += [*np.outer(speed * angle / max(time, 1.0 / rate), u)]
        C = C @ exp(u * angle)
        force += [C[2]] * round(rest * rate)
        rates += [np.zeros(3)] * round(rest * rate)
    n = len(force)
    f = make.G * np.array(force) * (1 + rng.normal(0, 0.01, 3)) + rng.normal(0, 0.2, 3)
    w = np.array(rates) * (1 + rng.normal(0, 0.01, 3)) + rng.normal(0, 0.01, 3)
    return (np.arange(n) / rate, f + 0.015 * rng.standard_normal((n, 3)),
            w + 1e-3 * rng.standard_normal((n, 3)))  # fmt: skip


FLIPS = [(0, np.pi), (0, np.pi / 2), (0, np.pi), (2, np.pi / 2), (2, np.pi)]


@pytest.mark.parametrize("seed", range(4))
def test_few_turns_between_long_rests_tell_unit_and_axes(seed, tmp_path):
    """A cube turned by 90 and 180 deg: thrice the rate, turned the other way, ends there too."""
    file = tmp_path / "faces.csv"
    faces = [(axis, angle, 2.0, 12.0) for axis, angle in FLIPS]
    file.write_text(make.text(HEAD, turned(faces, seed), FORM))
    seen = recognise([file])
    assert not seen.questions
    assert seen.log["gyro"]["unit"] == "rad/s" and "scale" not in seen.log["gyro"]
    assert taken(seen, "axes")[0].startswith("gyros and accelerometers in the same axes")
    assert found([file]).session.procedure == "six_position"


@pytest.mark.parametrize("seed", range(4))
def test_whole_turns_at_one_rate_on_each_face_are_those_of_ferraris(seed, tmp_path):
    file = tmp_path / "ferraris.csv"
    spins = {0: [2], 2: [1], 4: [0]}  # which axis is vertical after a flip
    moves = [(2, 2 * np.pi, 8.0, 10.0)]
    for k, (axis, angle) in enumerate(FLIPS):
        moves.append((axis, angle, 2.0, 10.0))
        moves += [(a, 2 * np.pi, 8.0, 10.0) for a in spins.get(k + 1, [])]
    file.write_text(make.text(HEAD, turned(moves, seed), FORM))
    seen = recognise([file])
    assert not seen.questions and seen.log["gyro"]["unit"] == "rad/s"
    held = found([file])
    assert held.session.procedure == "ferraris" and held.session.settings == {"angle": "360 deg"}


@pytest.mark.parametrize("number", [2, 3])
def test_rows_of_several_instruments_that_take_turns_are_refused(c, tmp_path, number):
    """Two that were calibrated as one passed, with the mean of their biases."""
    which = np.arange(number)[:, None, None]
    f, w = (np.moveaxis(x + 0.05 * which, 0, 1).reshape(-1, 3) for x in (c.f, c.w))
    t = np.repeat(c.t, number)
    file = tmp_path / "mixed.csv"
    for stamps in (t, t + np.tile(np.arange(number), len(c.t)) * 1e-3):
        file.write_text(make.text(HEAD, [stamps, f, w], FORM))
        with refuses("recognise.in_turns", match=f"Rows of {number} instruments take turns"):
            recognise([file])
    half = np.floor(c.t * 25) / 25  # one of coarse time, each stamp twice
    file.write_text(make.text(HEAD, [half, c.f, c.w], FORM))
    assert recognise([file], {"rate": "50 Hz"}).log["rate"] == "50 Hz"
