"""Transfer alignment on the command line: init, preflight, simulate, calibrate."""

from __future__ import annotations

import json

import pytest

from commands import run
from make_transfer_campaign import written


def ran(*words, code=0):
    return json.loads(run("--json", *words, code=code).stdout)


@pytest.mark.thorough
def test_from_a_plan_to_a_result(tmp_path):
    file = tmp_path / "plan.toml"
    ran("init", "transfer_alignment", "-o", file)
    assert "[master]" in file.read_text()
    file.write_text(written(profile='"straight"', rate='"50 Hz"'))
    seen = ran("preflight", file, code=3)
    assert seen["rank"] < seen["states"]
    assert seen["findings"][0]["code"] == "transfer.unseen"
    file.write_text(written(rate='"50 Hz"', message_rate='"2 Hz"'))
    assert ran("preflight", file)["complete"]
    made = ran("simulate", file, "-o", tmp_path / "session", "--seed", "3")
    assert {p.name for p in (tmp_path / "session").iterdir()} == {
        "campaign.toml", "log.csv", "master.csv", "truth.csv", "truth.json",
    }  # fmt: skip
    ran("calibrate", made["campaign"], "-o", tmp_path / "run")
    found = json.loads((tmp_path / "run" / "result.json").read_text())
    truth = json.loads((tmp_path / "session" / "truth.json").read_text())
    named = {row["name"]: row["value"] for row in truth["coefficients"]}
    delay = next(row for row in found["coefficients"] if row["name"] == "master.delay")
    assert abs(delay["value"] - named["master.delay"]) < 4 * delay["sd"] < 2e-3


def test_a_log_without_its_master(tmp_path):
    file = tmp_path / "campaign.toml"
    text = written()
    head, rest = text.split("[master]")
    file.write_text(head + rest[rest.index("[procedure]") :])
    result = run("calibrate", file, "-o", tmp_path / "run", code=1)
    assert "master is missing" in result.output + str(result.stderr)


@pytest.mark.thorough
def test_another_motion_is_tried_by_its_name(tmp_path):
    file = tmp_path / "plan.toml"
    own = '[{ s_turn = "40 deg", time = "40 s" }]'  # another plan takes its place
    file.write_text(written(rate='"50 Hz"', message_rate='"2 Hz"', manoeuvres=own))
    straight = ran("preflight", file, "--plan", "straight", code=3)
    assert straight["plan"] == "straight"
    assert straight["rank"] < straight["states"]
    result = run("preflight", file, "--plan", "strait", code=1)
    assert "Did you mean 'straight'?" in result.output + str(result.stderr)


@pytest.mark.thorough
def test_a_look_at_a_log_in_motion(tmp_path):
    file = tmp_path / "plan.toml"
    file.write_text(written(rate='"50 Hz"', message_rate='"2 Hz"', with_outage="true"))
    said = run("simulate", file, "-o", tmp_path / "session").output
    assert "outage.csv" in said
    result = run("inspect", tmp_path / "session" / "campaign.toml", code=0)
    assert "messages" in result.output and "horizontal speed" in result.output
    said = result.output.replace("--all prints every rest", "").replace("rest of", "")
    assert "rest" not in said
