"""What is too large, too deep or not there ends a command in words of its own."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from commands import run
from foucault import campaign, procedures
from foucault.errors import FoucaultError
from refusals import refuses

WITH_RATE = [
    name for name in procedures.PROCEDURES
    if "rate" in procedures.load(name).Session.model_fields and name != "north_seeking"
]  # fmt: skip


def planned(name: str, line: str) -> str:
    """Return a campaign whose [simulate] says `line` instead of what it said."""
    text = campaign.template(name)
    key = line.partition(" ")[0]
    head, mark, rest = text.rpartition("\n[simulate]\n")
    assert mark
    lines = [x for x in rest.splitlines() if not re.match(rf"{key}\b", x)]
    return head + mark + "\n".join([line, *lines]) + "\n"


@pytest.mark.parametrize("name", WITH_RATE)
@pytest.mark.parametrize("rate", ["1e10 Hz", "1e30 Hz", "1e300 Hz"])
def test_a_session_larger_than_any_memory(name: str, rate: str) -> None:
    with refuses("program.samples") as caught:
        campaign.simulate(campaign.parse(planned(name, f'rate = "{rate}"')))
    assert "at most 20000000 are simulated" in caught.value.message
    assert " GB" in caught.value.message


def test_a_north_seeker_that_reads_without_end() -> None:
    text = planned("north_seeking", 'rate = "1e10 Hz"')
    text = re.sub(r"(?m)^#? ?rows = .*$", 'rows = "samples"', text)
    with refuses("program.samples"):
        campaign.simulate(campaign.parse(text))


def test_a_session_longer_than_any(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(planned("hand_rotated", 'rest_time = "1e12 s"'))
    done = run("simulate", tmp_path / "a.toml", "-o", tmp_path / "new", code=1)
    assert "The session that is planned has " in done.stderr
    assert not (tmp_path / "new").exists()


def test_more_rests_than_any_session_has(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(planned("hand_rotated", "rests = 1000000000000"))
    done = run("simulate", tmp_path / "a.toml", "-o", tmp_path / "new", code=1)
    assert "simulate.rests = 1e+12 is more than any session has; at most 100000" in done.stderr


@pytest.mark.parametrize(
    "line",
    [
        "montecarlo six_position -n 1000000000000 -o new",
        "simulate norm_observation --instruments 1000000000 -o new",
        "optimise platform_tumble --restarts 1000000000000 -o new",
    ],
)
def test_numbers_that_nobody_means_are_wrong_usage(line: str) -> None:
    done = run(*line.split(), code=2)
    assert "Invalid value for '-" in done.stderr
    assert "000000" in done.stderr


def test_a_fleet_larger_than_any_memory(tmp_path: Path) -> None:
    done = run(
        "simulate", "norm_observation", "--instruments", 1_000_000, "-o", tmp_path / "new", code=1
    )
    assert "at most 20000000 are simulated" in done.stderr


PROBLEMS = {
    "program.memory": (
        MemoryError("Unable to allocate 7.28 TiB"), 1, "There is not enough memory for this: Unable"
    ),
    "program.nested": (
        RecursionError(), 1, "Something in a file that was given is nested too deeply to be read."
    ),
    "program.file": (
        OSError(36, "File name too long", "n" * 5000), 1, "cannot be used: File name too long"
    ),
    "program.fault": (ZeroDivisionError("x / 0"), 70, "foucault failed with ZeroDivisionError"),
}  # fmt: skip


@pytest.mark.parametrize(("problem", "code", "words"), PROBLEMS.values(), ids=PROBLEMS)
def test_what_the_system_cannot_do(
    problem: Exception, code: int, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: Any, **__: Any) -> None:
        raise problem

    monkeypatch.setattr("foucault.campaign.running.load", fails)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    done = run("inspect", tmp_path / "campaign.toml", code=code)
    assert words in done.stderr
    assert "Traceback" not in done.stderr
    assert len(done.stderr) < 1500
    kept = list(tmp_path.glob("foucault-*.txt"))
    if code == 70:
        assert "This is a fault in foucault, not in what was given." in done.stderr
        assert "ZeroDivisionError: x / 0" in kept[0].read_text()
    else:
        assert not kept


@pytest.mark.parametrize("name", ["n" * 5000, "a/b/../" * 2000])
def test_a_file_name_that_is_none(name: str, tmp_path: Path) -> None:
    new = ["-o", str(tmp_path / "new")]
    lines = (
        ["calibrate", name, *new], ["inspect", name], ["merge", name, name, *new],
        ["allan", f"{name}.csv"],
    )  # fmt: skip
    for words in lines:
        done = run(*words, code=1)
        assert done.stderr.startswith("error: ")
        assert len(done.stderr) < 2000
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("text", ["x = " + "[" * 5000 + "]" * 5000, "x = 1" + "0" * 5000])
def test_a_campaign_nested_without_end(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(text)
    done = run("calibrate", tmp_path / "a.toml", "-o", tmp_path / "new", code=1)
    assert "nested more than 64 deep" in done.stderr or "digits" in done.stderr


def test_one_run_to_a_folder(tmp_path: Path) -> None:
    from foucault.files import alone

    (tmp_path / "a.toml").write_text(campaign.template("hand_rotated"))
    with alone(tmp_path / "run"):
        done = run("calibrate", tmp_path / "a.toml", "-o", tmp_path / "run")
    assert done.exit_code == 1
    assert "Another run of foucault is writing into" in done.stderr


def test_a_folder_whose_result_is_not_what_its_procedure_writes(tmp_path: Path) -> None:
    import json

    from foucault import run_folder
    from make_result import make_result

    run_folder.save(make_result(), tmp_path)
    file = tmp_path / run_folder.RESULT_FILE
    doc = json.loads(file.read_text())
    doc["diagnostics"] = {"coverage": "x", "noise": "x", "detection": [1]}
    file.write_text(json.dumps(doc))
    done = run("report", tmp_path, code=1)
    assert "cannot be shown as a page: what is in it is not what its command writes" in done.stderr


@pytest.mark.parametrize("given", ["1e-320 deg", "1e-100 arcsec"])
def test_a_size_that_nothing_has(given: str, tmp_path: Path) -> None:
    words = ["north", "plan", "--latitude", "47 deg", "--gyro-noise", "navigation", "--time"]
    done = run(*words, "10 min", "--level-sd", given, code=1)
    assert "--level-sd" in done.stderr


@pytest.mark.parametrize("latitude", ["90 deg", "-90 deg", "89.9999 deg"])
@pytest.mark.parametrize("command", ["preflight", "optimise", "calibrate"])
def test_a_systematic_calibration_at_a_pole(command: str, latitude: str, tmp_path: Path) -> None:
    text = campaign.template("systematic")
    text = re.sub(r'(?m)^latitude = ".*"$', f'latitude = "{latitude}"', text)
    text = text.replace('rate = "50 Hz"', 'rate = "5 Hz"\nrest_time = "30 s"')
    (tmp_path / "a.toml").write_text(text)
    file = tmp_path / "a.toml"
    if command == "calibrate":
        assert run("simulate", file, "-o", tmp_path / "new").exit_code == 0
        file = tmp_path / "new" / "campaign.toml"
    words = [] if command == "preflight" else ["-o", tmp_path / "run"]
    done = run(command, file, *words, code=1)
    assert done.stderr.startswith(f"error: The latitude is {float(latitude[:-4]):.4f} deg; beyond")
    assert "shows no heading at the start" in done.stderr


@pytest.mark.parametrize("name", WITH_RATE)
def test_a_session_of_no_two_samples(name: str) -> None:
    with pytest.raises(FoucaultError) as caught:
        campaign.simulate(campaign.parse(planned(name, 'rate = "1e-30 Hz"')))
    planned_as = {"systematic": "manoeuvre.value", "transfer_alignment": "transfer_plan.value"}
    assert caught.value.code == planned_as.get(name, "program.few")
    if name not in planned_as:
        assert "shorter than the time between two samples" in caught.value.message


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("multi_position", 'plumb_sd = "1e300 deg"'),
        ("norm_observation", 'position_sd = "1e30 deg"'),
        ("north_seeking", 'dwell = "1e300 s"'),
        ("platform_tumble", 'interval = "1e-30 s"'),
        ("platform_tumble", 'command_interval = "1e30 s"'),
        ("platform_tumble", 'delay = "1e30 s"'),
    ],
)
def test_a_quantity_of_a_size_that_nothing_has(name: str, line: str, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(planned(name, line))
    for command in ("preflight", "simulate", "optimise"):
        words = [] if command == "preflight" else ["-o", tmp_path / "new"]
        done = run(command, tmp_path / "a.toml", *words, code=1)
        assert "is of a size that nothing has" in done.stderr


@pytest.mark.parametrize(
    ("name", "table", "line", "most"),
    [
        ("platform_tumble", "simulate", 'interval = "1e12 s"', "3600 s"),
        ("platform_tumble", "simulate", 'command_interval = "1e12 s"', "3600 s"),
        ("platform_tumble", "simulate", 'delay = "1e12 s"', "60 s"),
        ("platform_tumble", "simulate", 'edge = "1e12 s"', "60 s"),
        ("platform_tumble", "procedure", 'delay_sd = "1e12 s"', "60 s"),
        ("ferraris", "procedure", 'level_sd = "1e6 rad"', "180 deg"),
        ("norm_observation", "procedure", 'rate_sd = "1e12 percent"', "100 percent"),
        ("systematic", "procedure", 'velocity_sd = "1e12 m/s"', "100 m/s"),
        ("systematic", "procedure", 'position_sd = "1e12 m"', "10000 m"),
        ("norm_observation", "simulate", 'rate_jitter = "1e12 ratio"', "100 percent"),
    ],
)
def test_a_setting_beyond_its_range_is_named_with_the_range(
    name: str, table: str, line: str, most: str, tmp_path: Path
) -> None:
    key, _, given = line.partition(" = ")
    text = re.sub(rf"(?m)^#? ?{key} = .*\n", "", campaign.template(name))
    (tmp_path / "a.toml").write_text(text.replace(f"[{table}]\n", f"[{table}]\n{line}\n", 1))
    for command in ("preflight", "simulate", "calibrate"):
        words = [] if command == "preflight" else ["-o", tmp_path / "new"]
        done = run(command, tmp_path / "a.toml", *words, code=1)
        told = " ".join(done.stderr.split())
        assert f"{table}.{key}: '{given[1:-1]}' is not allowed" in told
        assert f"less than or equal to {most}." in told


def an_angle_or_a_ratio() -> list[tuple[str, type[Any], str]]:
    """Every standard deviation of an angle or a ratio that can be chosen."""
    from foucault.campaign.tables import kind_of

    return [
        (name, model, key)
        for name in procedures.PROCEDURES
        for model in (procedures.load(name).Settings, procedures.load(name).Session)
        for key, field in model.model_fields.items()
        if key.endswith("_sd") and kind_of(field) in ("angle", "scale factor error")
    ]


def test_no_standard_deviation_of_an_angle_or_a_ratio_is_without_end() -> None:
    from pydantic import ValidationError

    for name, model, key in an_angle_or_a_ratio():
        with pytest.raises(ValidationError) as caught:
            model(**{key: 1e6})
        assert [d["type"] for d in caught.value.errors()] == ["less_than_equal"], (name, key)


@pytest.mark.parametrize("line", ['interval = "1e-12 s"', 'interval = "1e-9 s"'])
def test_a_tumble_that_is_read_without_end(line: str) -> None:
    with refuses("program.samples"):
        campaign.simulate(campaign.parse(planned("platform_tumble", line)))


def test_a_torquing_plan_that_lasts_without_end(tmp_path: Path) -> None:
    text = campaign.template("platform_tumble")
    text = re.sub(r"(?m)^#? ?(plan|segment) = .*\n", "", text)
    plan = 'plan = "-x -z"\nsegment = "1e12 s"'
    (tmp_path / "a.toml").write_text(text.replace("[procedure]\n", f"[procedure]\n{plan}\n", 1))
    for command in ("preflight", "simulate"):
        words = [] if command == "preflight" else ["-o", tmp_path / "new"]
        done = run(command, tmp_path / "a.toml", *words, code=1)
        assert "at most 20000000 are simulated" in done.stderr
