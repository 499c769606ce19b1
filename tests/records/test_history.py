"""What records say of an instrument: drift, repeatability, conformity, and the day it is due."""

from __future__ import annotations

import dataclasses
import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom, chi2, norm

from foucault import run_folder
from foucault.campaign import tolerance
from foucault.campaign.comparison import moment
from foucault.diagnose.compare import YEAR
from foucault.errors import FoucaultError
from foucault.records import Records
from foucault.records import history as h
from foucault.result import Level
from make_compare import make_results
from make_records import edit, make_records, make_runs

NOW = moment("2027-03-14")
LIMITS = '"accel.bias" = "{bias}"\n'


def simple(time: np.ndarray, x: np.ndarray, sd: np.ndarray, how: str = "drift") -> h._Line:
    return h._line(time, x, sd, how, 0)


def test_a_line_is_extended_with_the_uncertainty_of_its_slope() -> None:
    """Three equal sd: the formulas of a regression line, written out."""
    time, sd = np.array([0.0, 1.0, 2.0]) * YEAR, np.full(3, 0.1)
    line = simple(time, np.array([1.0, 1.2, 1.4]), sd)
    value, spread = line.at(4 * YEAR)
    assert value == pytest.approx(1.8)
    assert spread == pytest.approx(0.1 * math.sqrt(1 / 3 + 3.0**2 / 2))
    assert line.repeatability == 0.0


def test_what_noise_does_not_explain_is_repeatability() -> None:
    rng = np.random.default_rng(4)
    found = []
    for _ in range(300):
        x = 5.0 + rng.normal(size=9) * math.hypot(0.1, 0.4)
        found.append(simple(np.arange(9) * YEAR, x, np.full(9, 0.1)).repeatability)
    # the square, plus the noise, is a chi-square of 7 degrees of freedom over 7, less where cut off
    mean = float(np.mean(np.square(found)))
    assert abs(mean - 0.16) < 3 * 0.17 * math.sqrt(2 / 7) / math.sqrt(300)


@pytest.mark.parametrize("runs", [6, 8])
@pytest.mark.thorough
def test_the_next_run_is_within_two_sd_as_often_as_it_should(runs: int) -> None:
    """Few runs tell how much they scatter: without Student's factor 7 to 8 % are outside."""
    rng, time, n = np.random.default_rng(5), np.arange(runs) * YEAR, 3000
    outside = 0
    for _ in range(n):
        x = 2.0 + rng.normal(size=runs) * math.hypot(0.3, 0.05)
        line = h._line(time, x, np.full(runs, 0.05), "steady", 0)
        value, spread = line.at(float(time[-1]))
        outside += abs(value - 2.0 - rng.normal() * 0.3) > 2 * spread
        assert line.wide >= line.repeatability
    low, high = binom.ppf([0.005, 0.995], n, 2 * norm.sf(2))
    assert low < outside < high


def test_a_prediction_is_as_far_off_as_it_says() -> None:
    """Of instruments that drift and whose runs scatter, two-sided at 1 %."""
    rng, miss = np.random.default_rng(8), []
    time = np.arange(8) * YEAR / 2
    for _ in range(400):
        slope, sd = rng.normal() * 0.2, np.full(8, 0.3)
        x = 2.0 + slope * time / YEAR + rng.normal(size=8) * 0.3
        line = h._line(time, x, sd, "steady", 0)
        there = 2.0 + slope * 5.0
        value, spread = line.at(5 * YEAR)
        own = line.wide
        miss.append((value + own * rng.normal() - there) / spread)
    low, high = chi2.ppf([0.005, 0.995], 400)
    assert low < np.sum(np.square(miss)) < high


@pytest.mark.parametrize(("value", "sd"), [(0.9, 0.2), (-1.3, 0.5), (0.0, 2.0)])
def test_conformity_is_the_probability_between_the_limits(value: float, sd: float) -> None:
    wanted = norm.cdf((1 - value) / sd) - norm.cdf((-1 - value) / sd)
    assert tolerance.conformity(value, sd, 1.0) == pytest.approx(wanted)
    assert math.isnan(tolerance.conformity(value, sd, math.inf))


def test_a_drift_is_told_with_the_day_it_reaches_its_limit() -> None:
    time, sd = np.arange(6) * YEAR, np.full(6, 1e-6)
    line = h._line(time, 0.1 * np.arange(6), sd, "drift", 0)
    outlook = line.outlook("accel.bias.x", "specific force", 1.0, 7 * YEAR, 5 * YEAR)
    assert outlook.reaches == pytest.approx(10 * YEAR, abs=0.02 * YEAR)
    assert outlook.due_value == pytest.approx(0.7)
    assert (outlook.decision, outlook.due_decision) == ("pass", "pass")
    assert math.isnan(line.outlook("x", "specific force", math.inf, math.nan, 5 * YEAR).reaches)


def test_after_a_step_only_later_runs_count() -> None:
    time, sd = np.arange(5) * YEAR, np.full(5, 0.01)
    x = np.array([1.0, 1.0, 3.0, 3.0, 3.0])
    line = h._line(time, x, sd, "step", 1)
    assert line.runs == 3 and line.at(float(time[-1]))[0] == pytest.approx(3.0)


# -- of whole records ----------------------------------------------------------------------


@pytest.fixture
def records(tmp_path: Path) -> Records:
    made = make_records(tmp_path, 4)
    yield made
    made.close()


def limits(records: Records, tmp_path: Path, bias: str) -> None:
    (tmp_path / "t.toml").write_text(LIMITS.format(bias=bias))
    records.tolerate("0042", tmp_path / "t.toml")


def test_an_instrument_that_does_not_change_is_fit_for_use(
    records: Records, tmp_path: Path
) -> None:
    records.recalibrate_every("0042", 12)
    limits(records, tmp_path, "1 g")
    past = h.past(records, "0042", moment("2027-06-01"))
    assert past.level is Level.PASS and len(past.counted) == 4 and past.first_reached is None
    assert past.due == moment("2028-03-14T09:00")
    bias = past.outlooks[0]
    assert bias.name == "accel.bias.x" and bias.conformity == pytest.approx(1.0)
    assert bias.due_sd > bias.sd  # nobody has seen the next year yet


@pytest.mark.parametrize(
    ("taken", "months", "due"),
    [("2026-11-30T22:53:00+00:00", 12, "2027-11-30T22:53"), ("2024-02-29", 12, "2025-02-28"),
     ("2027-01-31", 1, "2027-02-28"), ("2026-12-15", 600, "2076-12-15"),
     ("2026-03-01", 1.5, "2026-04-16T05:15")],
)  # fmt: skip
def test_it_is_due_on_the_same_day_of_a_later_month(taken: str, months: float, due: str) -> None:
    assert abs(h._later(moment(taken), months) - moment(due)) < 60


def test_a_broken_limit_is_not_to_be_used_and_an_old_one_is_doubtful(
    records: Records, tmp_path: Path
) -> None:
    records.recalibrate_every("0042", 6)
    assert h.past(records, "0042", moment("2028-06-01")).level is Level.DOUBTFUL
    limits(records, tmp_path, "1 ug")
    past = h.past(records, "0042", moment("2027-06-01"))
    assert past.level is Level.UNUSABLE
    assert {o.decision for o in past.outlooks if math.isfinite(o.limit)} == {"fail"}


def test_after_a_repair_earlier_runs_do_not_count(records: Records) -> None:
    records.event("0042", "repaired", "2025-12-01", "new gyro")
    past = h.past(records, "0042", NOW)
    assert [r.holds[:4] for r in past.counted] == ["2026", "2027"]
    records.event("0042", "out of service", "2027-01-01")
    assert h.past(records, "0042", NOW).level is Level.UNUSABLE


def test_a_rejected_run_and_one_that_was_made_again_do_not_count(
    records: Records, tmp_path: Path
) -> None:
    runs = records.runs()
    records.review(str(runs[0].number), "rejected", "dropped on the floor")
    again = run_folder.load_result(records.folder_of(runs[1]))
    again = dataclasses.replace(again, verdict=dataclasses.replace(again.verdict))
    newer = again.provenance | {"seconds": 9.0}
    run_folder.save(dataclasses.replace(again, provenance=newer), tmp_path / "again")
    records.add([tmp_path / "again"], again=runs[1].sha256)
    counted = [r.folder for r in h.past(records, "0042", NOW).counted]
    assert counted == ["again", runs[2].folder, runs[3].folder]


def test_a_doubtful_last_run_is_doubtful_until_it_is_accepted(tmp_path: Path) -> None:
    result = make_results(1, level=Level.DOUBTFUL)[0]
    run_folder.save(result, tmp_path / "run")
    records = Records(tmp_path / "records.sqlite", make=True)
    records.add([tmp_path / "run"])
    name = records.instruments()[0]
    assert h.past(records, name, NOW).level is Level.DOUBTFUL
    records.review("1", "accepted", "the log of the chamber explains it")
    assert h.past(records, name, NOW).level is Level.PASS
    records.close()


def test_the_instrument_that_is_due_first_comes_first(records: Records, tmp_path: Path) -> None:
    records.add(make_runs(tmp_path, 1, "7", seed=50))
    records.recalibrate_every("0042", 24)
    records.recalibrate_every("7", 12)
    assert [p.instrument for p in h.pasts(records, NOW)] == ["IMU 7", "IMU 0042"]


def test_of_one_log_the_run_that_was_taken_in_last_counts(tmp_path: Path) -> None:
    """Calibrated once more with other rests, kept too: its page is no error, nor two sessions."""
    records = make_records(tmp_path, 3)
    name = records.instruments()[0]
    whole = json.loads((tmp_path / "0042-2025" / "result.json").read_text())
    whole["provenance"] |= {"inputs": [{"file": "x.csv", "sha256": "1" * 64}]}
    taken = []
    for k in ("first", "again"):
        shutil.copytree(tmp_path / "0042-2025", tmp_path / k)
        whole["coefficients"][0]["value"] *= 1.001
        (tmp_path / k / "result.json").write_text(json.dumps(whole))
        added, failed = records.add([tmp_path / k], date="2025-06-01")
        assert not failed
        taken += added
    found = h.past(records, name)
    assert len(found.runs) == 5 and len(found.counted) == 4
    counted = {r.number for r in found.counted}
    assert taken[1].number in counted and taken[0].number not in counted
    ((_, runs, own, _),) = h.fleet(records)
    assert {r.number for r in own} == counted and len(runs) == 5
    records.review(str(taken[1].number), "rejected", "moved wrongly")
    assert taken[0].number in {r.number for r in h.past(records, name).counted}
    records.close()


def test_what_was_worked_out_is_never_old(records: Records, tmp_path: Path) -> None:
    """Asked again it is the same, and another as soon as a run, a limit or a byte is another."""
    first = h.past(records, "0042", NOW)
    worked = h._lines.cache_info().misses
    assert h.past(records, "0042", NOW).outlooks == first.outlooks
    assert h._lines.cache_info().misses == worked
    limits(records, tmp_path, "1 ug")
    assert h.past(records, "0042", NOW).level is Level.UNUSABLE
    records.add(make_runs(tmp_path, 1, seed=51, folder="newest"), date="2027-03-01")
    added = h.past(records, "0042", NOW)
    assert len(added.counted) == 5 and added.outlooks[0].value != first.outlooks[0].value
    edit(records.folder_of(added.counted[0]))
    with pytest.raises(FoucaultError, match="not the one that was taken in"):
        h.past(records, "0042", NOW)


def test_records_in_the_place_of_others_are_others(tmp_path: Path) -> None:
    """They are held open by all who ask, but a file that takes their place is another."""
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
    first = make_records(tmp_path / "one", 2)
    second = make_records(tmp_path / "two", 3)
    second.close()
    (tmp_path / "two" / "records.sqlite").replace(tmp_path / "one" / "records.sqlite")
    for end in ("-wal", "-shm"):
        (tmp_path / "one" / f"records.sqlite{end}").unlink(missing_ok=True)
    again = Records(tmp_path / "one" / "records.sqlite")
    assert again.database.engine is not first.database.engine and len(again.runs()) == 3
    third = Records(tmp_path / "one" / "records.sqlite")
    assert third.database.engine is again.database.engine
    for one in (first, again, third):
        one.close()
