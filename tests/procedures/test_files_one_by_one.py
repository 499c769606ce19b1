"""Rests in one file and spins in another: the same calibration as from one log."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault import campaign, logs
from foucault.logs import LogDescription, follow, read
from foucault.result import Level
from foucault.tables import Log
from refusals import refuses


def picked(log: Log, wanted: np.ndarray) -> Log:
    """Some rows of a log, its time beginning at zero, without what the table said."""
    time = log.time[wanted] - log.time[wanted][0]
    return replace(log, time=time, gyro=log.gyro[wanted], accel=log.accel[wanted], table=None)


def campaign_of(name, log, folder):
    """The template's campaign of a log in rests.csv and spins.csv."""
    folder.mkdir(exist_ok=True)
    position, rate = log.table.position, log.table.rate
    logs.write(picked(log, (position >= 0) & (rate == 0)), folder / "rests.csv")
    logs.write(picked(log, (position >= 0) & (rate != 0)), folder / "spins.csv")
    text = campaign.template(name).replace("\n[instrument]\n", "\n[instrument]\nleft_out = false\n")
    own = '[log]\nfile = "rests.csv"\nmore = ["spins.csv"]\n'
    text = text[: text.index("\n[log]\n") + 1] + own + text[text.index("\n[procedure]\n") + 1 :]
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    return folder / "campaign.toml"


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["norm_observation", "turntable"])
def test_rests_and_spins_in_two_files_without_moves(name, tmp_path):
    described = campaign.parse(campaign.template(name), tmp_path / "campaign.toml")
    made = campaign.simulate(described, 3)
    campaign.save_session(made, tmp_path / "one")
    one = campaign.calibrate(tmp_path / "one" / "campaign.toml")
    two = campaign.calibrate(campaign_of(name, made.simulation.log, tmp_path / "two"))
    assert two.verdict.level is Level.PASS
    told = {f.code for f in one.findings}  # a reading that is left out is so in both
    assert {f.code for f in two.findings} == told | {"campaign.template", "positions.unlogged"}
    gap = (two.coefficients.values - one.coefficients.values) / one.coefficients.sd
    assert np.abs(gap).max() < 0.3
    np.testing.assert_allclose(two.coefficients.sd, one.coefficients.sd, rtol=0.05)
    assert two.provenance["input"]["file"] == "rests.csv + spins.csv"


WORDS = {
    "time": {"column": "t", "unit": "s"},
    "accel": {"columns": ["x", "y", "z"], "unit": "m/s^2"},
}


def text_of(start, rows, step=0.1, extra=""):
    rng = np.random.default_rng(7)
    lines = ["t,x,y,z" + (",u" if extra else "")]
    for k in range(rows):
        f = rng.normal([0.0, 0.0, 9.8], 0.01)
        lines.append(f"{start + k * step:.3f},{f[0]:.6f},{f[1]:.6f},{f[2]:.6f}{extra}")
    return "\n".join(lines) + "\n"


def described(folder, first, second, **words):
    (folder / "a.csv").write_text(first)
    (folder / "b.csv").write_text(second)
    return LogDescription.model_validate({"file": "a.csv", "more": ["b.csv"], **WORDS, **words})


@pytest.mark.parametrize(("begins", "want"), [(0.0, 14.9), (3.0, 14.9), (100.0, 100.0)])
def test_times_that_overlap_follow_and_times_that_go_on_stay(tmp_path, begins, want):
    about = described(tmp_path, text_of(0.0, 50), text_of(begins, 30))
    log = read(about, tmp_path)
    assert len(log) == 80
    assert log.time[50] == pytest.approx(want)
    np.testing.assert_allclose(np.diff(log.time)[50:], 0.1)
    assert log.interval == pytest.approx(0.1)
    assert log.source["file"] == "a.csv + b.csv"
    assert not log.findings
    (block,) = follow.blocks(about, tmp_path)
    np.testing.assert_array_equal(block.accel, log.accel)


def test_means_in_two_files(tmp_path):
    words = {"averaged": {"column": "u", "unit": "s"}}
    about = described(tmp_path, text_of(0.0, 3, extra=",5"), text_of(0.0, 2, extra=",5"), **words)
    log = read(about.model_copy(update={"time": None}), tmp_path)
    np.testing.assert_allclose(log.time, [0, 5, 10, 25, 30])
    np.testing.assert_allclose(log.averaged, 5.0)


def test_files_that_do_not_hold_the_same_are_refused(tmp_path):
    about = described(tmp_path, text_of(0.0, 50), text_of(0.0, 50, step=0.05))
    with refuses("log.more_differs", match=r"'a.csv' has 10 Hz, but 'b.csv' has 20 Hz"):
        read(about, tmp_path)
    for words in ({"serial": "s"}, {"accel": {**WORDS["accel"], "file": "c.csv"}}):
        with refuses("log.more_alone"):
            described(tmp_path, "", "", **words)


def test_one_motion_is_not_put_together_from_files(tmp_path):
    text = campaign.template("hand_rotated")
    (tmp_path / "campaign.toml").write_text(
        text.replace('file = "log.csv"', 'file = "log.csv"\nmore = ["b.csv"]')
    )
    with refuses("log.more_moving", r"'hand_rotated' needs one motion") as caught:
        campaign.calibrate(tmp_path / "campaign.toml")
    assert "norm_observation, multi_position, turntable, rate_table" in caught.value.cure
