"""The commands that take a log without a campaign."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import make_bare as make
from foucault.cli.app import app


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return make.write("german", tmp_path_factory.mktemp("bare"), make.truth(1, 50.0, 12))


def run(*words: object, code: int = 0) -> str:
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == code, done.output
    return done.output


def test_a_bare_log_is_calibrated_and_its_campaign_gives_the_same_again(file, tmp_path):
    said = run(
        "calibrate", file, "-o", tmp_path / "run", "--latitude", "48 deg", "--height", "400 m",
        "--gravity", "9.81 m/s^2", "--set", "accel.reads = specific force", "--json",
    )  # fmt: skip
    seen = json.loads(said)
    assert {line["what"] for line in seen["recognised"]} >= {"time", "accelerometers", "gyros"}
    text = (tmp_path / "run" / "campaign.toml").read_text(encoding="utf-8")
    assert "# What german.csv was taken for" in text
    run("calibrate", tmp_path / "run" / "campaign.toml", "-o", tmp_path / "again")
    values = [
        [row["value"] for row in json.loads((tmp_path / name / "result.json").read_text())[
            "coefficients"]]
        for name in ("run", "again")
    ]  # fmt: skip
    np.testing.assert_array_equal(*values)


def test_init_writes_the_campaign_of_a_log(file, tmp_path):
    shown = run("init", "--log", file, "--height", "400 m", "--gravity", "9.81 m/s^2")
    assert shown.startswith("# What german.csv was taken for")
    made = tmp_path / "campaign.toml"
    said = run("init", "--log", file, "-o", made, "--set", "accel.first_rest = z up")
    assert "was taken for" in said
    assert 'name = "hand_rotated"' in made.read_text(encoding="utf-8")
    assert "given neither a procedure nor a log" in run("init", code=1)
    told = run("init", "hand_rotated", "--latitude", "48 deg", code=1)
    assert "--latitude is for a log without a campaign" in told
    assert "the rate is taken" not in told


def test_inspect_and_allan_say_what_a_bare_log_was_taken_for(file, tmp_path):
    said = run("inspect", file)
    assert "german.csv was taken for:" in said
    assert "12 rests in" in said
    bare = make.write("untitled", tmp_path, make.truth(1, 50.0, 12))
    assert "'untitled.csv' was read as: time column 0 [s]" in " ".join(run("allan", bare).split())
    two = make.write("arduino_print", tmp_path, make.truth(1, 50.0, 12))
    assert "can be read in two ways" in run("inspect", two, code=1)


def test_inspect_and_allan_take_files_of_one_log_and_read_them_as_calibrate_does(tmp_path):
    c = make.Columns.of(make.truth(1, 50.0, 12))
    one, two = tmp_path / "acc.csv", tmp_path / "gyr.csv"
    one.write_text(make.text("t (s),ax (g),ay (g),az (g)", [c.t, c.f / make.G], ["%.6f"] * 4))
    wrong = "t (s),gx (rad/s),gy (rad/s),gz (rad/s)"
    two.write_text(make.text(wrong, [c.t, c.w / make.DEGREE], ["%.6f"] * 4))
    said = run("inspect", one, two)
    assert "acc.csv, gyr.csv were taken for:" in said
    assert said.count("taken for") == 1
    assert "not rad/s as its title says" in said
    seen = json.loads(run("inspect", one, two, "--json"))
    np.testing.assert_allclose(seen["gyro"]["sd"], c.w.std(axis=0), rtol=1e-3)
    assert "gx (rad/s), gy (rad/s), gz (rad/s) [deg/s]" in " ".join(run("allan", one, two).split())


def test_init_of_a_log_that_calibrates_nothing_says_what_is_missing(tmp_path):
    c = make.Columns.of(make.truth(1, 50.0, 12))
    file = tmp_path / "rest.csv"
    rest = slice(0, 400)
    head = "t,ax,ay,az,gx,gy,gz"
    file.write_text(make.text(head, [c.t[rest], c.f[rest], c.w[rest]], ["%.6f"] * 7))
    said = " ".join(run("init", "--log", file, "-o", tmp_path / "campaign.toml").split())
    assert "calibrates nothing yet. A rest tells noise" in said
    assert "then run" not in said


def test_inspect_and_allan_take_the_answer_to_a_question(tmp_path):
    two = make.write("arduino_print", tmp_path, make.truth(1, 50.0, 12))
    assert "can be read in two ways" in run("allan", two, code=1)
    assert "50 Hz" in run("inspect", two, "--set", "rate = 50 Hz")
    assert "50 Hz" in run("allan", two, "--set", "rate = 50 Hz")
    campaign = tmp_path / "campaign.toml"
    campaign.write_text("[log]\n")
    said = run("inspect", campaign, "--set", "rate = 50 Hz", code=1)
    assert "--set is for a log without a campaign" in said


def test_every_command_that_takes_a_bare_log_takes_the_answer(tmp_path):
    two = make.write("arduino_print", tmp_path, make.truth(1, 50.0, 12))
    assert "can be read in two ways" in run("delay", two, two, code=1)
    rate, site = "rate = 50 Hz", ("--latitude", "48 deg")
    assert "rest of 10 s or more" in run("navigate", two, *site, "--set", rate, code=1)
    assert "rest of 10 s or more" in run("align", two, *site, "--set", rate, code=1)
    assert "is given twice" in run("delay", two, two, "--set", rate, code=1)
    assert "following" in run("watch", two, "--timeout", "0.1 s", "--set", rate)


def test_the_second_log_of_a_delay_needs_no_titles_either(tmp_path):
    both = make.truth(1, 50.0, 12)
    for name, part in (("one.csv", both[:-100]), ("two.csv", both[100:])):
        c = make.Columns.of(part)
        (tmp_path / name).write_text(make.text("", [c.t, c.f, c.w], ["%.6f"] * 7).lstrip("\n"))
    assert "Delay:" in run("delay", tmp_path / "one.csv", tmp_path / "two.csv")


@pytest.mark.parametrize("beside", [(), ("--latitude", "48 deg"), ("--set", "rate = 50 Hz")])
def test_a_log_that_is_not_there_is_named(file, beside):
    missing = file.with_name("germn.csv")
    said = " ".join(run("calibrate", missing, "-o", file.parent / "run", *beside, code=1).split())
    assert "does not exist. The folder has german.csv" in said
    assert "is a folder, not a file" in run("calibrate", file.parent, "-o", "run", code=1)
