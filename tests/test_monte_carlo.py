"""Studies: the same bits for any split, killed and resumed, failures counted."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from foucault import campaign, monte_carlo
from foucault.campaign import study
from foucault.diagnose.study import Study
from foucault.errors import FoucaultError

SHORT = """
[site]
latitude = "48 deg"
gravity_sd = "0 m/s^2"
[log]
file = "log.csv"
[procedure]
name = "hand_rotated"
held_out = 0
[simulate]
rests = 13
rest_time = "2.2 s"
turn_time = "1.2 s"
first_rest_time = "2 s"
rate = "50 Hz"
"""


def short() -> campaign.Campaign:
    return campaign.parse(SHORT, "short.toml")


def draw(index: int, seeds: np.random.SeedSequence) -> dict[str, float]:
    return {"i": index, "x": float(np.random.default_rng(seeds).standard_normal())}


def test_any_split_gives_the_same_rows() -> None:
    whole = list(monte_carlo.run(draw, range(40), 7))
    parts = [
        row for a in range(0, 40, 7) for row in monte_carlo.run(draw, range(a, min(a + 7, 40)), 7)
    ]
    threaded = list(monte_carlo.run(draw, range(40), 7, monte_carlo.threads(4)))
    assert whole == parts == threaded
    assert len({row["x"] for row in whole}) == 40
    assert list(monte_carlo.run(draw, range(40), 8)) != whole


@pytest.mark.thorough
def test_one_worker_and_four_give_identical_bytes(tmp_path: Path) -> None:
    for workers in (1, 4):
        study.run(short(), 10, tmp_path / str(workers), seed=3, workers=workers)
    one, four = ((tmp_path / w / study.TRIALS_FILE).read_bytes() for w in ("1", "4"))
    assert one == four


KILLED = """
import sys
from pathlib import Path
from foucault import campaign
from foucault.campaign import study
text, folder = Path(sys.argv[1]).read_text(), sys.argv[2]
study.PART = 6
study.run(campaign.parse(text, "short.toml"), 20, folder, seed=5, workers=2)
"""


@pytest.mark.thorough
def test_a_study_that_is_killed_and_resumed_equals_an_undisturbed_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(study, "PART", 6)
    (tmp_path / "short.toml").write_text(SHORT)
    disturbed = tmp_path / "disturbed"
    command = [sys.executable, "-c", KILLED, str(tmp_path / "short.toml"), str(disturbed)]
    process = subprocess.Popen(command, env=os.environ | {"OPENBLAS_NUM_THREADS": "1"})
    parts = disturbed / study.FOLDER
    deadline = time.monotonic() + 60
    while not (parts.is_dir() and any(parts.glob("0*.parquet"))):
        assert time.monotonic() < deadline
        assert process.poll() is None, "it was too quick to be killed"
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (disturbed / study.TRIALS_FILE).exists()
    kept = {file.name: file.stat().st_mtime_ns for file in parts.glob("0*.parquet")}
    study.run(short(), 20, disturbed, seed=5, workers=2)
    for name, written in kept.items():  # what was finished is not computed again
        assert (parts / name).stat().st_mtime_ns == written
    study.run(short(), 20, tmp_path / "undisturbed", seed=5, workers=1)
    one, two = (
        (tmp_path / name / study.TRIALS_FILE).read_bytes() for name in ("disturbed", "undisturbed")
    )
    assert one == two


def test_a_folder_of_another_campaign_or_seed_is_refused(tmp_path: Path) -> None:
    study.run(short(), 2, tmp_path, seed=1)
    with pytest.raises(FoucaultError, match="holds another study: seed is not") as problem:
        study.run(short(), 2, tmp_path, seed=2)
    assert "another folder with -o" in problem.value.cure
    other = campaign.parse(SHORT.replace("13", "14"), "short.toml")
    with pytest.raises(FoucaultError, match="campaign_sha256 is not"):
        study.run(other, 2, tmp_path, seed=1)
    with pytest.raises(FoucaultError, match="holds no finished study"):
        study.load(tmp_path / "elsewhere")


@pytest.mark.thorough
def test_a_finished_study_is_read_back_and_can_be_extended(tmp_path: Path) -> None:
    first = study.run(short(), 8, tmp_path, seed=1)
    again, asked = study.load(tmp_path)
    assert asked["seed"] == 1
    np.testing.assert_array_equal(first.error, again.error)
    longer = study.run(short(), 16, tmp_path, seed=1)
    np.testing.assert_array_equal(longer.error[:8], first.error)


def test_failed_trials_are_counted_and_do_not_end_the_study(tmp_path: Path) -> None:
    few = campaign.parse(SHORT.replace("rests = 13", "rests = 5"), "short.toml")
    result = study.run(few, 3, tmp_path)
    assert result.status == {"rests.too_few": 3}
    assert result.rows() == []
    (check,) = result.checks()
    assert not check.passed


def fake(factor: float, trials: int = 400, n: int = 5) -> Study:
    """Errors whose true covariance is `factor` squared times the predicted one."""
    rng = np.random.default_rng(11)
    error = factor * rng.standard_normal((trials, n))
    one = np.ones((trials, n))
    return Study(tuple("abcde"), error, one, one, np.sum(error**2, axis=1), {"converged": trials})


def test_a_right_covariance_passes_every_check() -> None:
    assert [c.name for c in fake(1.0).checks() if not c.passed] == []


@pytest.mark.parametrize(("factor", "word"), [(2**0.5, "too small"), (0.5**0.5, "too large")])
def test_a_wrong_covariance_fails(factor: float, word: str) -> None:
    failed = {c.name: c.sentence for c in fake(factor).checks() if not c.passed}
    assert {"NEES", "spread", "coverage of 68 %", "coverage of 95 %"} <= set(failed)
    assert word in failed["NEES"]


def test_intervals_are_students_where_a_variance_was_found() -> None:
    """From 6 degrees of freedom: taken for normal, 71.6 % are inside those of 68 %."""
    good = fake(1.0, trials=2000)
    found = np.random.default_rng(2).chisquare(6, good.error.shape) / 6
    stated = replace(good, sd=np.sqrt(1.5 * found))
    failed = [
        [c.name for c in told.checks() if c.name.startswith("coverage") and not c.passed]
        for told in (stated, replace(stated, dof=np.full(good.error.shape, 6.0)))
    ]
    assert failed[0] == ["coverage of 68 %"] and not failed[1]
    rows = [told.rows()[0]["coverage_68"] for told in (stated, replace(stated, dof=6.0))]
    assert rows[0] - 0.02 > rows[1]


def test_trials_keep_the_degrees_of_freedom(tmp_path: Path) -> None:
    """Of placements that the residuals tell; none where all is declared."""
    text = campaign.template("ferraris")
    for told, few in (
        (text, True),
        (text.replace("[simulate]", "placement_sd = '5 arcmin'\n[simulate]", 1), False),
    ):
        kept = study.run(campaign.parse(told, "campaign.toml"), 2, tmp_path / str(few), workers=1)
        dof = np.broadcast_to(kept.dof, kept.error.shape)
        at = kept.names.index("accel.misalignment.yx")
        assert (dof[:, at] < 20).all() == few and (dof[:, at] >= 4).all()


def test_a_biased_estimate_fails() -> None:
    good = fake(1.0)
    biased = replace(good, error=good.error + np.array([0.3, 0, 0, 0, 0]))
    failed = [c.sentence for c in biased.checks() if c.name == "bias"]
    assert failed == ["The mean error of a does not fit zero."]


@pytest.mark.parametrize(("name", "count"), [
    ("six_position", 100), ("ferraris", 100),
    pytest.param("magnetometer", 60, marks=pytest.mark.thorough),
    pytest.param("norm_observation", 150, marks=pytest.mark.thorough),
    pytest.param("turntable", 150, marks=pytest.mark.thorough),
    pytest.param("multi_position", 150, marks=pytest.mark.thorough),
])  # fmt: skip
def test_a_template_is_simulated_as_crooked_as_it_is_calibrated(name, count, tmp_path) -> None:
    """Placements, gains or biases without errors, where a calibration counts with them."""
    told = campaign.parse(campaign.template(name), "campaign.toml")
    judged = study.run(told, count, tmp_path, workers=1).checks()
    assert all(c.passed for c in judged if c.name in ("NEES", "bias", "spread"))


def test_readings_on_a_table_scatter_where_a_calibration_looks_for_it() -> None:
    """As white noise in 100 s, but for what is said; not where [noise] or [procedure] says none."""
    text = campaign.template("turntable")
    quiet = "[noise]\naccel.white = '120 ug/sqrt(Hz)'\ngyro.white = '0.3 deg/sqrt(h)'\n[procedure]"
    own = text.replace("[simulate]", "[simulate]\ngyro_scatter = '0 deg/h'", 1)
    cases = {
        text: (12e-6 * 9.80665, np.radians(0.3) / 600),
        own: (12e-6 * 9.80665, 0.0),
        text.replace("[procedure]", quiet, 1): (0.0, 0.0),
        text.replace("repeatability = true", "repeatability = false", 1): (0.0, 0.0),
    }
    for told, size in cases.items():
        rig = campaign.simulate(campaign.parse(told, "campaign.toml")).simulation.rig
        assert (rig.accel_scatter, rig.gyro_scatter) == pytest.approx(size)
