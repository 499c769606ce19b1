"""North seekers at several places in one file: every fix uses the latitude of its own set-up."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from foucault.cli import app
from foucault.diagnose.study import nees
from foucault.errors import FoucaultError
from foucault.infer.gauss_newton import chi_square_limits
from foucault.logs import indexed, indexed_own
from foucault.models.earth import Site, gravity
from foucault.models.imu import ImuModel
from foucault.procedures import north_seeking
from foucault.procedures.north_seeking import Settings
from foucault.procedures.north_seeking.fix import find_north
from foucault.simulate.north import NorthPlan, Placement, SeekerErrors, Stops, simulate_north
from make_dwells import FIELD, FOUR

PLACES = np.radians([47.3, 60.2, -33.9])
POSE = np.radians([[10.0, 4.0, -3.0], [130.0, -5.0, 2.0], [250.0, 6.0, 5.0]])
PLAIN = {"accel_bias_sd": 0.0, "accel_scale_sd": 0.0, "accel_misalignment_sd": 0.0}
STOPS = Stops(np.radians(FOUR), np.full(4, 120.0), 5.0)


def surveyed(places=PLACES, poses=POSE, seed=0, noise=FIELD):
    """Return one log of set-ups at several places."""
    parts = [
        simulate_north(
            NorthPlan((Placement(f"M{k + 1}", *pose),), STOPS), model=ImuModel(), noise=noise,
            site=Site.at(float(place)), errors=SeekerErrors(gyro_offset=3e-6), accel="base",
            reference=False, rows="means", rate=2.0, seed=100 * seed + k,
        ).log
        for k, (place, pose) in enumerate(zip(places, poses, strict=True))
    ]  # fmt: skip
    whole = {n: np.concatenate([getattr(p, n) for p in parts])
             for n in ("time", "index", "gyro", "accel", "averaged")}  # fmt: skip
    counts = [len(p) for p in parts]
    return replace(
        parts[0], **whole, setup=np.repeat(np.arange(len(parts)), counts),
        names=tuple(p.names[0] for p in parts), latitude=np.repeat(places, counts), heading=None,
        source={},
    )  # fmt: skip


def codes_of(caught) -> str:
    return caught.value.code


def test_every_fix_uses_the_latitude_of_its_set_up() -> None:
    survey = find_north(surveyed(), site=Site.at(float(PLACES[0])), noise=FIELD,
                        settings=Settings(**PLAIN))  # fmt: skip
    assert survey.fixes.angles[:, 3] == pytest.approx(PLACES, abs=1e-6)
    apart = (survey.fixes.angles[:, :3] - POSE + np.pi) % (2 * np.pi) - np.pi
    assert np.all(np.abs(apart) < 4 * survey.fixes.sd[:, :3])
    assert all(v.level == "pass" for v in survey.verdicts)
    assert survey.known.gravity == pytest.approx(gravity(PLACES, 0.0))
    one = find_north(replace(surveyed(), latitude=None), site=Site.at(float(PLACES[0])),
                     noise=FIELD, settings=Settings(**PLAIN))  # fmt: skip
    assert [str(v.level) for v in one.verdicts][1:] == ["doubtful", "doubtful"]


def test_each_alone_says_the_same_as_all_together() -> None:
    log = surveyed()
    settings = Settings(latitude_sd=np.radians(0.05), level_sd=np.radians(5.0), **PLAIN)
    survey = find_north(log, site=Site.at(0.1), noise=FIELD, settings=settings)
    for k, place in enumerate(PLACES):
        alone = log.rows(np.flatnonzero(log.setup == k))
        alone = replace(alone, latitude=None, setup=0 * alone.setup, names=(log.names[k],))
        one = find_north(alone, site=Site.at(float(place)), noise=FIELD, settings=settings)
        assert survey.fixes.angles[k] == pytest.approx(one.fixes.angles[0], abs=1e-9)
        assert survey.fixes.cov[k] == pytest.approx(one.fixes.cov[0], rel=1e-6, abs=1e-16)
        assert survey.bound[k] == pytest.approx(one.bound[0], rel=1e-6)
        assert survey.verdicts[k].level == one.verdicts[0].level


def test_measured_gravity_counts_everywhere_and_blanks_take_the_site() -> None:
    log = surveyed(places=PLACES[[0, 0, 1]])
    given = Site(9.8, float(PLACES[0]))
    blank = replace(log, latitude=np.where(log.setup == 1, np.nan, log.latitude),
                    latitude_sd=np.where(log.setup == 2, 1e-3, np.nan))  # fmt: skip
    settings = Settings(latitude_sd=1e-4, **PLAIN)
    known = find_north(blank, site=given, noise=FIELD, settings=settings).known
    assert known.latitude == pytest.approx(PLACES[[0, 0, 1]])
    assert known.latitude_sd == pytest.approx([1e-4, 1e-4, 1e-3])
    assert known.gravity == pytest.approx(9.8)
    with pytest.raises(FoucaultError) as caught:
        find_north(blank, site=Site(9.8), noise=FIELD, settings=settings)
    assert codes_of(caught) == "north.place_missing"
    assert "1 in all, the first of them 'M2'" in caught.value.message
    assert '--latitude "47.3 deg"' in caught.value.cure


@pytest.mark.thorough
def test_headings_from_several_places_are_as_uncertain_as_said() -> None:
    rng = np.random.default_rng(5)
    square = 0.0
    for seed in range(20):
        places = np.radians(rng.uniform(-65.0, 65.0, 3))
        poses = np.column_stack([rng.uniform(0, 6.28, 3), rng.uniform(-0.15, 0.15, (3, 2))])
        survey = find_north(surveyed(places, poses, seed), site=Site.at(0.5), noise=FIELD,
                            settings=Settings(**PLAIN))  # fmt: skip
        off = (survey.fixes.angles[:, :3] - poses + np.pi) % (2 * np.pi) - np.pi
        square += sum(nees(e, P[:3, :3]) for e, P in zip(off, survey.fixes.cov, strict=True))
    low, high = chi_square_limits(180)
    assert low < square < high


@pytest.mark.thorough
def test_the_column_is_read_from_titles_and_by_the_command(tmp_path) -> None:
    log = surveyed()
    bare = tmp_path / "readings.csv"
    indexed_own.write(log, bare)
    found = indexed.read(indexed_own.description_of(bare, "specific force")[0], tmp_path)
    assert found.latitude == pytest.approx(log.latitude) and found.latitude_sd is None
    words = ["--gyro-noise", "0.003 deg/sqrt(h)", "--accel-noise", "30 ug/sqrt(Hz)"]
    done = CliRunner().invoke(app, ["north", str(bare), *words, "-o", str(tmp_path / "o")])
    assert done.exit_code in (0, 3), done.output
    assert "latitude [°]" in done.stdout and "60.2" in done.stdout and "-33.9" in done.stdout
    about = json.loads((tmp_path / "o" / "north.json").read_text())
    assert about["known"]["latitude"] == pytest.approx(PLACES)
    page = (tmp_path / "o" / "report.html").read_text()
    assert "several latitudes" in page and "normal gravity at the latitude of each" in page
    both = CliRunner().invoke(app, ["north", str(bare), *words, "--unknown-latitude", "--gravity",
                                    "9.8 m/s^2"])  # fmt: skip
    assert both.exit_code == 1 and "A column of latitudes and --unknown-latitude" in both.stderr


def test_columns_that_cannot_be_are_refused(tmp_path) -> None:
    log = surveyed()

    def read(**changes):
        file = tmp_path / "readings.csv"
        indexed_own.write(replace(log, **changes), file)
        return indexed.read(indexed_own.description_of(file, "specific force")[0], tmp_path)

    with pytest.raises(FoucaultError, match="Set-up 'M1' has a latitude of 2710") as caught:
        read(latitude=np.degrees(log.latitude))
    assert codes_of(caught) == "north.place" and "check the unit" in caught.value.cure
    moves = log.latitude.copy()
    moves[1] += 1e-3
    with pytest.raises(FoucaultError, match="latitude changes by") as caught:
        read(latitude=moves)
    assert codes_of(caught) == "north.place_moves"
    assert "give each place another value in the column of `setup`" in caught.value.cure
    alone = replace(log, heading=np.zeros(len(log)))
    with pytest.raises(FoucaultError, match="a column of latitudes; the turntable") as caught:
        north_seeking.calibrate(alone, site=Site.at(0.8), noise=FIELD)
    assert codes_of(caught) == "north.one_place"
    assert "Take `latitude` and `latitude_sd` out of [log]" in caught.value.cure
