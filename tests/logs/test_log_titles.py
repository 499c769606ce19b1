"""A log that nobody described is read where the titles of its columns say enough."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from foucault.errors import FoucaultError
from foucault.logs import LogDescription, read, write
from foucault.logs.description import description_of
from refusals import refuses

G = 9.80665


def save(folder, head):
    rng = np.random.default_rng(4)
    table = rng.normal(0.0, 0.01, (50, len(head.split(","))))
    table[:, 0] = 10.0 * np.arange(50)
    table[:, -1] += 1.0
    np.savetxt(folder / "log.csv", table, delimiter=",", header=head, comments="", fmt="%.17g")
    return table


@pytest.mark.parametrize(
    "head",
    [
        "t (ms),gyro_x (deg/s),gyro_y (deg/s),gyro_z (deg/s),acc_x [g],acc_y [g],acc_z [g]",
        "time_ms,gyr_x_dps,gyr_y_dps,gyr_z_dps,acc_x_g,acc_y_g,acc_z_g",
        "Time [ms],gx (°/s),gy (°/s),gz (°/s),ax (g),ay (g),az (g)",
    ],
)
def test_units_in_titles_are_taken_and_told(tmp_path, head):
    table = save(tmp_path, head)
    description, (told,) = description_of(tmp_path / "log.csv")
    log = read(description, tmp_path)
    assert log.findings == ()
    assert log.time == pytest.approx(table[:, 0] / 1000, rel=1e-15)
    assert log.gyro == pytest.approx(np.radians(table[:, 1:4]), rel=1e-14)
    assert log.accel == pytest.approx(table[:, 4:] * G, rel=1e-15)
    assert told.code == "log.units_from_titles"
    assert told.severity == "note"
    assert "time in ms, gyro in " in told.message
    assert told.message.endswith("accel in g.")


@pytest.mark.parametrize(
    ("units", "factors"),
    [(("rad", "m/s"), (1.0, 1.0)), (("deg", "g*s"), (np.pi / 180, G)),
     (("0.1 arcsec", "m/s"), (np.pi / 6480000, 1.0))],
)  # fmt: skip
def test_units_of_increments_make_increments(tmp_path, units, factors):
    table = save(
        tmp_path, "t (ms),gx ({0}),gy ({0}),gz ({0}),ax ({1}),ay ({1}),az ({1})".format(*units)
    )
    description, (told,) = description_of(tmp_path / "log.csv")
    assert description.gyro.kind == description.accel.kind == "increment"
    log = read(description, tmp_path)
    assert log.sampled == "increment"
    assert log.gyro[1:] == pytest.approx(table[1:, 1:4] * factors[0] / 0.01, rel=1e-12)
    assert log.accel[1:] == pytest.approx(table[1:, 4:] * factors[1] / 0.01, rel=1e-12)
    assert f"gyro in {units[0]} (increments), accel in {units[1]} (increments)" in told.message


@pytest.mark.parametrize(
    ("head", "reason"),
    [
        (
            "t (s),gx,gy,gz,ax (g),ay (g),az (g)",
            "the titles of gyro do not give one unit: gx, gy, gz",
        ),
        ("t (s),gx (deg/s),gy (deg/s),gz (rad/s),ax (g),ay (g),az (g)", "do not give one unit"),
        (
            "t,gx (deg/s),gy (deg/s),gz (deg/s),ax (g),ay (g),az (g)",
            "the titles of time do not give one unit: t.",
        ),
        ("n,gx (deg/s),gy (deg/s),gz (deg/s),ax (g),ay (g),az (g)", "a usual name of time"),
        ("t (s),a1,a2,a3,a4,a5,a6", "no three columns have usual names"),
        ("t (s),gx (furlong),gy (furlong),gz (furlong),ax (g),ay (g),az (g)", "'furlong'"),
        ("t (s),gx (count),gy (count),gz (count),ax (g),ay (g),az (g)", "without a scale"),
        ("t (s),gx (rad),gy (rad),gz (rad),ax (g),ay (g),az (g)", "'rad' is a unit of increments"),
        ("t (s),gx (dps),gy (dps),gz (dps),ax (m/s),ay (m/s),az (m/s)", "is a unit of increments"),
    ],
)
def test_titles_that_say_too_little_lead_to_init(tmp_path, head, reason):
    save(tmp_path, head)
    with refuses("log.bare") as caught:
        description_of(tmp_path / "log.csv")
    assert reason in str(caught.value)
    assert f"'log.csv' has the columns {head.replace(',', ', ')}" in caught.value.message
    assert "foucault init hand_rotated -o campaign.toml" in caught.value.cure
    assert 'kind = "increment"' in caught.value.cure


def test_a_file_without_titles_leads_to_init(tmp_path):
    np.savetxt(tmp_path / "log.txt", np.ones((5, 7)))
    with pytest.raises(FoucaultError, match=r"'log.txt' has 7 columns; .* no titles.*init hand"):
        description_of(tmp_path / "log.txt")


def test_our_own_log_needs_no_titles(tmp_path, log):
    write(log, tmp_path / "log.csv")
    description, told = description_of(tmp_path / "log.csv")
    assert description == LogDescription(file="log.csv")
    assert told == ()


def test_a_column_is_found_without_its_unit(tmp_path):
    table = save(tmp_path, "t (s),gx (deg/s),gy (deg/s),gz (deg/s),ax (g),ay (g),az (g)")
    words = {"file": "log.csv", "time": {"column": "t", "unit": "ms"}}
    words["accel"] = {"columns": ["-ax", "ay", "az (g)"], "unit": "g"}
    log = read(LogDescription.model_validate(words), tmp_path)
    assert log.accel == pytest.approx(table[:, 4:] * [-G, G, G], rel=1e-15)


def test_a_name_that_two_columns_could_mean_is_not_guessed(tmp_path):
    save(tmp_path, "t (s),t (ms),gy,gz,ax,ay,az")
    words = {"file": "log.csv", "time": {"column": "t", "unit": "s"}, "accel": {"unit": "g"}}
    with refuses("log.unknown_column", match=r"has no column 't'. The columns are t \(s\)"):
        read(LogDescription.model_validate(words), tmp_path)


@pytest.mark.parametrize("wanted", ["{}", "{} ", " {}", "-{} "])
def test_spaces_around_a_title_do_not_hide_it(wanted, tmp_path):
    titles = ["time ", " gyro_x  ", "gyro  y ", "gyro_z", "ax (m/s^2) ", "accel_y", "accel_z\u00a0"]
    names = [" ".join(t.split()) for t in titles]
    rows = np.arange(28.0).reshape(4, 7)
    table = pa.table(dict(zip(titles, rows.T, strict=True)))
    pq.write_table(table, tmp_path / "log.parquet")
    (tmp_path / "log.csv").write_text(
        ",".join(f'"{t}"' for t in titles) + "\n" + "\n".join(",".join(map(str, r)) for r in rows)
    )
    some = [wanted.format(n) for n in names]
    for file in ("log.parquet", "log.csv"):
        described = LogDescription.model_validate({
            "file": file, "time": {"column": names[0] + " ", "unit": "s"},
            "gyro": {"columns": some[1:4], "unit": "rad/s"},
            "accel": {"columns": some[4:], "unit": "m/s^2"},
        })  # fmt: skip
        log = read(described, tmp_path)
        sign = -1.0 if wanted.startswith("-") else 1.0
        np.testing.assert_allclose(np.column_stack([log.gyro, log.accel]), sign * rows[:, 1:])
