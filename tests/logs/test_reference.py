"""References: what their titles say, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.logs import reference
from foucault.models.earth import displaced
from refusals import refuses

HEAD = "time (s),latitude (deg),longitude (deg),height (m)"


def write(path: Path, titles: str, rows: list[str]) -> Path:
    path.write_text("\n".join([titles, *rows]) + "\n")
    return path


def test_titles_give_columns_and_units_in_any_order(tmp_path: Path) -> None:
    titles = "Heading [deg],height (km),t_ms,LAT_deg,lon (rad),ve_mps,velocity north (m/s)"
    file = write(tmp_path / "r.csv", titles, ["10,0.4,0,45,0.5,1,2", "350,0.5,1000,46,0.6,3,4"])
    seen = reference.read(file)
    assert seen.time.tolist() == [0.0, 1.0] and seen.has_height and not seen.still
    assert seen.position[1] == pytest.approx([np.radians(46), 0.6, 500.0])
    assert seen.velocity_n[:, :2].tolist() == [[1, 2], [3, 4]]
    assert np.isnan(seen.velocity_n[:, 2]).all() and np.isnan(seen.angles[:, 1:]).all()
    assert seen.angles[:, 0] == pytest.approx(np.radians([10, 350]))
    assert seen.source["rows"] == 2 and len(seen.source["sha256"]) == 64


def test_a_reference_may_have_no_height_or_no_position(tmp_path: Path) -> None:
    flat = write(tmp_path / "f.csv", HEAD.rpartition(",")[0], ["0,45,8", "1,45,8"])
    assert not reference.read(flat).has_height and reference.read(flat).velocity_n is None
    fast = write(tmp_path / "v.csv", "time (s),ve (m/s),vn (m/s)", ["0,1,2", "1,1,2"])
    assert reference.read(fast).position is None


@pytest.mark.parametrize(
    ("titles", "said"),
    [
        ("time (s),latitude,longitude (deg)", "the title latitude gives no unit"),
        ("time (s),latitude (m),longitude (deg)", "'m' does not measure angle"),
        ("latitude (deg),longitude (deg)", "no column has a usual title of time"),
        ("time (s),height (m)", "neither latitude and longitude nor velocities"),
        (
            "time (s),lat (deg),latitude (deg),lon (deg)",
            "more than one column is titled as lat",
        ),
        ("0,1,2", "the file has no titles"),
    ],
)
def test_titles_that_do_not_say_it(tmp_path: Path, titles: str, said: str) -> None:
    row = ",".join(["1"] * len(titles.split(",")))
    file = write(tmp_path / "r.csv", titles, [row, row])
    with refuses(
        "reference.titles", said, "Title the columns with their units: time (s), latitude (deg)"
    ):
        reference.read(file)


def test_time_must_run_forward(tmp_path: Path) -> None:
    file = write(tmp_path / "r.csv", HEAD, ["1,45,8,0", "1,45,8,0"])
    with pytest.raises(FoucaultError, match="time does not rise from each to the next") as caught:
        reference.read(file)
    assert "two rows are the least" in caught.value.cure


def test_a_latitude_beyond_the_poles(tmp_path: Path) -> None:
    file = write(tmp_path / "r.csv", HEAD, ["0,45,8,0", "1,108,8,0"])
    with pytest.raises(FoucaultError, match="has a latitude of 108 deg") as caught:
        reference.read(file)
    assert "the order of latitude and longitude" in caught.value.cure


def test_a_known_site() -> None:
    site = reference.Reference.site(np.arange(3.0), 0.8, 0.1, 430.0)
    assert site.still and site.position.tolist() == [[0.8, 0.1, 430.0]] * 3
    assert not site.velocity_n.any()


def test_a_velocity_down_is_turned_up(tmp_path: Path) -> None:
    titles = "time (s),ve (m/s),vn (m/s),velocity down (m/s)"
    seen = reference.read(write(tmp_path / "d.csv", titles, ["0,1,2,-3", "1,1,2,4"]))
    assert seen.velocity_n[:, 2].tolist() == [3, -4]


def test_a_place_is_that_of_the_rest_or_between_epochs() -> None:
    time = np.array([0.0, 1.0, 2.0, 100.0])
    position = np.column_stack([0.8 + 1e-5 * time, np.full(4, np.pi), 10 * time])
    seen = reference.Reference(time, position)
    assert seen.place(0.5, 50.0).tolist() == position[2].tolist()  # it has not moved since
    assert seen.place(1.25, 1.25) == pytest.approx([0.8 + 1.25e-5, np.pi, 12.5])
    assert seen.place(-0.5, -0.5) == pytest.approx([0.8 - 0.5e-5, np.pi, -5.0])
    assert seen.place(50.0, 50.0) is None and seen.place(-9.0, -5.0) is None
    assert reference.Reference(time).place(0.0, 1.0) is None
    crossing = position.copy()
    crossing[1, 1] = -np.pi + 1e-3
    there = reference.Reference(time, crossing).place(0.5, 0.5)
    assert there[1] == pytest.approx(np.pi + 0.5e-3)


def driven(
    path: Path, swapped: bool, *, place=(48.8, 2.3), velocity=(3.0, 11.0), noise=2.0
) -> Path:
    """Write a reference at 1 Hz for 200 s, its positions scattered."""
    rng = np.random.default_rng(3)
    time = np.arange(200.0)
    way = time[:, None] * [*velocity, 0.0] + noise * rng.normal(size=(200, 3))
    latitude, longitude, height = displaced(*np.radians(place), 60.0, way)
    both = np.degrees([longitude, latitude] if swapped else [latitude, longitude])
    v = np.array(velocity) + 0.05 * rng.normal(size=(200, 2))
    rows = [",".join(f"{x:.10f}" for x in row) for row in np.column_stack([time, *both, height, v])]
    rows[7] = "7,,,,1,1"  # cells may be blank
    return write(path, HEAD + ",ve (m/s),vn (m/s)", rows)


def test_latitude_and_longitude_that_are_exchanged_are_refused(tmp_path: Path) -> None:
    with refuses("reference.place_swapped") as caught:
        reference.read(driven(tmp_path / "r.csv", True))
    assert "with latitude and longitude exchanged" in caught.value.message
    assert "Exchange the titles of its columns latitude and longitude" in caught.value.cure


@pytest.mark.parametrize("velocity", [(3.0, 11.0), (11.0, 3.0), (0.0, 0.0), (8.0, 8.0)])
@pytest.mark.parametrize("place", [(48.8, 2.3), (2.3, 48.8), (45.0, 45.0), (0.1, -0.1), (60, 150)])
def test_a_sound_reference_is_not_called_exchanged(tmp_path: Path, place, velocity) -> None:
    file = driven(tmp_path / "r.csv", False, place=place, velocity=velocity)
    assert len(reference.read(file).time) == 200
