"""A master's table from files of many kinds, and what is refused or told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.logs import master, reference
from foucault.logs.master import MasterDescription
from foucault.models.rotation import log
from foucault.simulate.transfer import Link, simulate_transfer
from make_transfer_flight import DEG, SHORT, circling
from refusals import refuses

TABLE = circling()
NAMES = ["t", "lat", "lon", "h", "v1", "v2", "v3", "yaw", "pitch", "roll"]


def said(tmp_path, columns, **about) -> MasterDescription:
    """Write columns as CSV without units and describe them."""
    path = tmp_path / "nav.csv"
    np.savetxt(path, np.column_stack(columns), "%.12g", ",", header=",".join(NAMES), comments="")
    blocks = {
        "file": "nav.csv",
        "time": {"column": "t", "unit": "s"},
        "position": {"columns": ["lat", "lon", "h"], "unit": "rad"},
        "velocity": {"columns": ["v1", "v2", "v3"], "unit": "m/s"},
        "attitude": {"columns": ["yaw", "pitch", "roll"], "unit": "rad"},
    }
    for key, value in about.items():
        blocks[key] = blocks.get(key, {}) | value if isinstance(value, dict) else value
    return MasterDescription.model_validate(blocks)


def columns_of(table=TABLE, *, velocity=None, angles=None, time=None):
    return [
        table.time if time is None else time, table.latitude, table.longitude, table.height,
        *(table.velocity_n if velocity is None else velocity).T,
        *(table.angles if angles is None else angles).T,
    ]  # fmt: skip


def same(one, two, digits: float = 1e-9) -> None:
    np.testing.assert_allclose(one.time, two.time, rtol=0, atol=1e-6)
    np.testing.assert_allclose(one.velocity_n, two.velocity_n, rtol=0, atol=1e-6)
    np.testing.assert_allclose(one.C_nb, two.C_nb, rtol=0, atol=digits)
    np.testing.assert_allclose(one.latitude, two.latitude, rtol=0, atol=1e-11)
    np.testing.assert_allclose(one.height, two.height, rtol=0, atol=1e-4)


def refused(code: str, make) -> str:
    with refuses(code) as caught:
        make()
    return str(caught.value)


@pytest.mark.parametrize("wrap", [180, 360])
def test_what_is_written_is_read_back(tmp_path, wrap) -> None:
    link = Link(stamped="both", delay=0.06, repeated=0.1, lost=0.05)
    run = simulate_transfer(SHORT, rate=50.0, link=link, seed=2)
    master.write(run.received.table, tmp_path / "nav.csv", wrap=wrap)
    heading = np.loadtxt(tmp_path / "nav.csv", delimiter=",", skiprows=1)[:, 2]
    assert (heading.min() < 0) == (wrap == 180) and np.abs(heading).max() <= wrap
    found = master.read(MasterDescription(file="nav.csv"), tmp_path)
    same(found, run.master, 1e-8)
    np.testing.assert_allclose(found.arrival, run.master.arrival, rtol=0, atol=1e-6)
    assert [f.code for f in found.findings] == ["master.repeated", "master.gaps"]
    master.write(run.master, tmp_path / "clean.csv", wrap=wrap)
    truth = reference.read(tmp_path / "clean.csv")  # `navigate --reference` reads it too
    np.testing.assert_allclose(truth.velocity_n, run.master.velocity_n, rtol=0, atol=1e-6)


def test_north_east_down_counter_clockwise_and_degrees(tmp_path) -> None:
    east, north, up = TABLE.velocity_n.T
    ned = np.column_stack([north, east, -up])
    turned = TABLE.angles * [-1, 1, 1]
    used = said(tmp_path, columns_of(velocity=ned, angles=turned), velocity={"frame": "NED"},
                attitude={"sense": "counter-clockwise"})  # fmt: skip
    found = master.read(used, tmp_path)
    same(found, TABLE)
    assert found.findings == ()
    used = said(tmp_path, columns_of(angles=np.degrees(TABLE.angles) * [1, 1, -1]),
                attitude={"unit": "deg", "columns": ["yaw", "pitch", "-roll"]})  # fmt: skip
    same(master.read(used, tmp_path), TABLE)


def test_latitude_and_longitude_that_are_exchanged_are_refused(tmp_path) -> None:
    swapped = replace(TABLE, latitude=TABLE.longitude, longitude=TABLE.latitude)
    used = said(tmp_path, columns_of(swapped))
    text = refused("master.place_swapped", lambda: master.read(used, tmp_path))
    assert "with latitude and longitude exchanged" in text
    assert "order of the columns in [master.position]: latitude, longitude, height" in text


def test_velocities_in_another_frame_are_refused(tmp_path) -> None:
    east, north, up = TABLE.velocity_n.T
    ned = np.column_stack([north, east, -up])
    used = said(tmp_path, columns_of(velocity=ned))
    text = refused("master.frame", lambda: master.read(used, tmp_path))
    assert "with frame ENU" in text and 'Write frame = "NED" in [master.velocity]' in text
    used = said(tmp_path, columns_of(), velocity={"frame": "NED"})
    assert 'Write frame = "ENU"' in refused("master.frame", lambda: master.read(used, tmp_path))


def test_a_heading_that_counts_the_other_way_is_told(tmp_path) -> None:
    used = said(tmp_path, columns_of(), attitude={"sense": "counter-clockwise"})
    (told,) = master.read(used, tmp_path).findings
    assert told.code == "master.heading_sense"
    assert 'Write sense = "clockwise" in [master.attitude]' in told.cure
    used = said(tmp_path, columns_of(angles=TABLE.angles * [-1, 1, 1]))
    (told,) = master.read(used, tmp_path).findings
    assert 'Write sense = "counter-clockwise"' in told.cure
    off = np.column_stack([(TABLE.angles[:, 0] - 90 * DEG) % (2 * np.pi), *TABLE.angles.T[1:]])
    (told,) = master.read(said(tmp_path, columns_of(angles=off)), tmp_path).findings
    assert told.code == "master.heading_course"
    assert "by 90 deg on average, and by 0 deg" in told.message


def test_angles_that_cannot_be_are_refused(tmp_path) -> None:
    used = said(tmp_path, columns_of(angles=np.degrees(TABLE.angles)))
    text = refused("master.angles", lambda: master.read(used, tmp_path))
    assert "heading of" in text and "Check the unit (rad)" in text
    swapped = TABLE.angles[:, [1, 0, 2]]
    used = said(tmp_path, columns_of(angles=swapped))
    text = refused("master.angles", lambda: master.read(used, tmp_path))
    assert "a pitch of 3" in text
    columns = columns_of()
    columns[1] = np.degrees(columns[1])
    used = said(tmp_path, columns)
    assert "latitude" in refused("reference.latitude", lambda: master.read(used, tmp_path))


def test_messages_that_lack_a_number_are_refused_or_left_out(tmp_path) -> None:
    columns = np.array(columns_of())
    columns[5, 7] = columns[8, 30] = np.nan
    used = said(tmp_path, columns)
    text = refused("master.missing", lambda: master.read(used, tmp_path))
    assert "2 of 600 messages lack a number, the first of them is number 7" in text
    found = master.read(said(tmp_path, columns, missing="drop"), tmp_path)
    assert len(found) == 598
    assert [f.code for f in found.findings] == ["master.dropped", "master.gaps"]
    assert "gaps, 2 in all, in which about 2 messages are missing" in found.findings[1].message
    columns[4] = np.nan
    used = said(tmp_path, columns, missing="drop")
    assert "0 messages" in refused("master.empty", lambda: master.read(used, tmp_path))


def test_time_has_to_run_forward(tmp_path) -> None:
    back = TABLE.time.copy()
    back[300:] -= 25.0
    used = said(tmp_path, columns_of(time=back))
    text = refused("master.time", lambda: master.read(used, tmp_path))
    assert "1 messages have a stamp that is not after the one before, the first at 5 s" in text


def test_a_vehicle_at_rest_may_say_the_same_again() -> None:
    rest = replace(TABLE, velocity_n=0 * TABLE.velocity_n, C_nb=np.tile(np.eye(3), (600, 1, 1)),
                   latitude=None, longitude=None, height=None)  # fmt: skip
    assert len(rest.cleaned()) == 600
    twice = rest[np.repeat(np.arange(600), 2)]
    assert len(twice.cleaned()) == 600  # one stamp, one message


@pytest.mark.parametrize(
    ("about", "words"),
    [
        ({"velocity": {"columns": ["v1", "v2", "v3"]}}, "velocity has no `unit`"),
        ({"attitude": {"unit": "deg"}}, "attitude has no `columns`"),
        ({"velocity": {"frame": "NED"}}, "titles say what is north"),
    ],
)
def test_half_a_description_is_refused(about, words: str) -> None:
    text = refused(
        "master.columns", lambda: MasterDescription.model_validate({"file": "a"} | about)
    )
    assert words in text


def test_a_file_without_attitude_is_refused(tmp_path) -> None:
    path = tmp_path / "nav.csv"
    titles = "time (s),velocity east (m/s),velocity north (m/s),velocity up (m/s),heading (deg)"
    np.savetxt(path, np.zeros((3, 5)), "%g", ",", header=titles, comments="")
    text = refused(
        "master.columns", lambda: master.read(MasterDescription(file="nav.csv"), tmp_path)
    )
    assert "it has no pitch, roll" in text
    np.savetxt(path, np.zeros((3, 5)), "%g", ",", header="a,b,c,d,e", comments="")
    refused("reference.titles", lambda: master.read(MasterDescription(file="nav.csv"), tmp_path))
    about = {"file": "nav.csv", "arrival": {"unit": "s"}}
    used = MasterDescription.model_validate(about)
    assert "arrival has no `column`" in refused(
        "master.columns", lambda: master.read(used, tmp_path)
    )


def test_a_column_that_is_not_there_is_asked_for_in_the_master(tmp_path) -> None:
    about = said(tmp_path, columns_of(), time={"column": "tt"})
    text = refused("log.unknown_column", lambda: master.read(about, tmp_path))
    assert "Correct it in [master.time]." in text


def test_a_real_master_counts_counter_clockwise(real) -> None:
    path = real("fog_mems_transfer") / "transfer_align_fog_mems.mat"
    about = {
        "file": path.name, "variable": "fogavp", "time": {"column": 9, "unit": "s"},
        "position": {"columns": [6, 7, 8], "unit": "rad"},
        "velocity": {"columns": [3, 4, 5], "unit": "m/s"},
        "attitude": {"columns": [2, 0, 1], "unit": "rad", "sense": "counter-clockwise"},
    }  # fmt: skip
    found = master.read(MasterDescription.model_validate(about), path.parent)
    assert len(found) == 1000 and found.findings == ()
    # Its attitude turns as its velocity does: no rate beyond a car's, no jump at north.
    turning = log(found.C_nb[:-1].swapaxes(1, 2) @ found.C_nb[1:])
    assert np.abs(turning).max() < 10 * DEG and found.interval == pytest.approx(0.1)
    about["attitude"] |= {"sense": "clockwise"}
    told = master.read(MasterDescription.model_validate(about), path.parent).findings
    assert [f.code for f in told] == ["master.heading_sense"]
    about["velocity"] |= {"frame": "NED"}
    used = MasterDescription.model_validate(about)
    assert "ENU" in refused("master.frame", lambda: master.read(used, path.parent))
