"""The command plans about sequences of systematic calibration."""

from __future__ import annotations

import csv
import json
from functools import partial

import numpy as np
import pytest

import commands
from foucault.cli.plans import sequence_of
from foucault.models.rotation import exp
from foucault.plans.manoeuvres import Rest
from foucault.plans.sequence import CalibrationSequence, built_in
from foucault.plans.sequence_file import HEADINGS, read_sequence, write_steps
from refusals import refuses

CAMPAIGN = """
[site]
latitude = "40 deg"
[log]
file = "log.csv"
[procedure]
name = "{name}"
"""


run = partial(commands.run, "plans", "--model", "systematic")


@pytest.mark.thorough
def test_the_list_says_what_each_needs_and_shows():
    result = run("--json", code=0)
    listed = {s["name"]: s for s in json.loads(result.stdout)["sequences"]}
    nineteen = listed["19 positions"]
    assert (nineteen["rests"], nineteen["turns"], nineteen["duration"]) == (19, 18, 3021.0)
    assert nineteen["errors"] == [24, 24] and nineteen["deflection"]["coupled6"] == [3, 6]
    assert listed["spins, simple 6"]["deflection"]["coupled6"] == [6, 6]
    assert listed["navigation test about east"]["errors"][0] < 24


def test_the_actions_of_one_as_csv_and_as_a_file_that_reads_again(tmp_path):
    file = tmp_path / "actions.csv"
    result = run("19 positions + spins, simple 6", "-o", file)
    assert result.exit_code == 0 and "25 rests and" in result.output
    headings, *rows = csv.reader(file.read_text(encoding="utf-8").splitlines())
    assert tuple(headings) == HEADINGS
    assert rows[1] == ["150.0", "turn", "y", "90", "10", "159.5", "-N", "E", "U", "to P2"]
    spin = next(row for row in rows if row[1] == "spin")
    assert spin[2:5] == ["north", "3600", "18"]
    again = tmp_path / "actions.toml"
    assert run("19 positions + spins, simple 6", "-o", again, "--no-angles").exit_code == 0
    first, second = built_in("19 positions").then(built_in("spins, simple 6")), read_sequence(again)
    np.testing.assert_allclose(second.attitudes, first.attitudes, atol=1e-9)
    np.testing.assert_allclose(second.times, first.times)
    assert "It starts with x, y, z to U, E, N." in run(again).output.splitlines()


def test_the_actions_of_a_campaign(tmp_path):
    file = tmp_path / "campaign.toml"
    file.write_text(CAMPAIGN.format(name="systematic") + '[simulate]\nrest_time = "30 s"\n')
    assert "19 rests and 18 turns in 12.3 min" in run(file).output
    file.write_text(CAMPAIGN.format(name="hand_rotated"))
    result = run(file)
    assert result.exit_code == 1 and "procedure hand_rotated" in result.stderr
    with refuses("sequence.campaign"):
        sequence_of(str(file))


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["20 positions"], "Did you mean '9 positions'?"),
        (["nothing.toml"], "No such file"),
        (["-o", "actions.csv"], "all plans are asked for"),
    ],
)
def test_mistakes_end_with_1_and_one_sentence(words, text):
    result = run(*words)
    assert result.exit_code == 1 and text in result.stderr


def test_a_slanting_start_goes_into_a_table_only(tmp_path):
    slanting = CalibrationSequence("aslant", exp(np.array([0.3, 0.0, 0.0])), (Rest(60.0),))
    write_steps(slanting, tmp_path / "actions.csv")
    with refuses("sequence.slanting"):
        write_steps(slanting, tmp_path / "actions.toml")
