"""A campaign whose procedure has a log of its own: template, simulation, reading, schema."""

from __future__ import annotations

import re
import tomllib

import jsonschema
import numpy as np
import pytest

import commands
from foucault import campaign, procedures, run_folder
from foucault.campaign import north, study
from foucault.campaign.running import read_any
from foucault.campaign.writing import resolved
from foucault.errors import FoucaultError
from foucault.logs.indexed_own import IndexedDescription
from foucault.models.noise import noise_of
from refusals import refuses

NORTH = "north_seeking"


@pytest.fixture(autouse=True)
def registered(monkeypatch):
    monkeypatch.setitem(procedures.PROCEDURES, NORTH, f"foucault.procedures.{NORTH}")


def test_what_is_simulated_is_read_back(tmp_path):
    read = campaign.parse(campaign.template(NORTH), tmp_path / "c.toml")
    assert isinstance(read.log, IndexedDescription)
    session = campaign.simulate(read, 3)
    file = campaign.save_session(session, tmp_path / "session")
    log = campaign.read_log(campaign.load(file))
    for name in ("time", "index", "gyro", "accel", "heading", "averaged"):
        mine, theirs = getattr(log, name), getattr(session.simulation.log, name)
        np.testing.assert_array_equal(mine, theirs)
    assert log.findings == ()
    again = campaign.parse(resolved(campaign.load(file), file.parent), file.parent / "x.toml")
    assert again.log == campaign.load(file).log


def test_the_module_gives_the_defaults_of_its_simulation():
    text = campaign.template(NORTH)
    assert 'grade = "navigation"' in text
    head, _, _ = text.partition("[simulate]")
    assert campaign.parse(head).simulate.grade == "navigation"
    tactical = campaign.parse(head + '[simulate]\ngrade = "tactical"\n')
    assert tactical.simulate.grade == "tactical"
    assert campaign.parse(campaign.template("hand_rotated").partition("[simulate]")[0]
                          ).simulate.grade == "mems"  # fmt: skip


@pytest.mark.thorough
def test_the_schema_knows_both_kinds_of_log():
    schema = campaign.schema()
    for name in (NORTH, "hand_rotated"):
        jsonschema.validate(tomllib.loads(campaign.template(name)), schema)
    wrong = tomllib.loads(campaign.template(NORTH))
    wrong["log"]["gyro"] = tomllib.loads(campaign.template("hand_rotated"))["log"]["gyro"]
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(wrong, schema)


def test_mistakes_in_its_log_have_their_place():
    text = campaign.template(NORTH)
    with pytest.raises(FoucaultError, match=r"log\.indx is not a key.*Did you mean 'index'"):
        campaign.parse(text.replace("\nindex = {", "\nindx = {"))
    with pytest.raises(FoucaultError, match="`reads` is missing"):
        campaign.parse(text.replace(', reads = "specific force"', ""))


def test_commands_for_other_logs_refuse_it(tmp_path):
    read = campaign.parse(campaign.template(NORTH), tmp_path / "c.toml")
    file = campaign.save_session(campaign.simulate(read, 3), tmp_path / "session")
    for call in (lambda: read_any(file, lambda *_: None), lambda: campaign.load(file).imu_log):
        with refuses("north.not_imu") as caught:
            call()
        assert "one gyro on an indexing base" in caught.value.message


@pytest.mark.parametrize(("tilts", "names"), [(("0 deg",), 10), (("0 deg", "10 deg"), 8)])
def test_a_study_knows_what_a_session_shows(tilts: tuple[str, ...], names: int) -> None:
    text = campaign.template("north_seeking").replace('["0 deg"]', str(list(tilts)))
    described = campaign.parse(text.replace("'", '"'))
    assert len(study.names_of(described)) == names
    row = study.Trial(described)(0, np.random.SeedSequence(1))
    assert row["status"] == "converged" and np.isfinite(row["nees"])


def test_commands_for_an_imu_refuse_a_north_seeker(tmp_path, capsys):
    read = campaign.parse(campaign.template(NORTH), tmp_path / "c.toml")
    file = campaign.save_session(campaign.simulate(read, 3), tmp_path / "session")
    loaded = campaign.load(file)
    run = tmp_path / "run"
    run_folder.save(campaign.calibrate(loaded), run, loaded.text)
    log, out = tmp_path / "session" / "log.csv", str(tmp_path / "out")
    done = commands.run("apply", run, log, "-o", out + ".csv", code=1)
    assert "belongs to a gyro on an indexing base" in done.output
    assert "one gyro on an indexing base" in commands.run("fleet", file, "-o", out, code=1).output


def test_what_a_fix_needs_of_a_calibration_survives_its_file(tmp_path):
    text = campaign.template(NORTH).replace("# twice_per_turn_sd", "twice_per_turn_sd")
    text = text.replace('rows = "means"', 'rows = "samples"').replace('"10 Hz"', '"1 Hz"')
    text = re.sub(r'twice_per_turn_sd = "[^"]*"', 'twice_per_turn_sd = "1 deg/h"', text)
    file = campaign.save_session(campaign.simulate(campaign.parse(text)), tmp_path)
    loaded = campaign.load(file)
    made = campaign.calibrate(loaded)
    run_folder.save(made, tmp_path / "run", loaded.text)
    back = run_folder.load_result(tmp_path / "run")
    assert back.diagnostics["stop_offsets"] == made.diagnostics["stop_offsets"] != {}
    assert noise_of(back.diagnostics["noise"]) == noise_of(made.diagnostics["noise"])
    assert noise_of(back.diagnostics["noise"]).accel.white > 0
    with_them = north.run(file, calibration=tmp_path / "run").pairs.chi_square[:, 0].sum()
    without = north.run(file).pairs.chi_square[:, 0].sum()
    assert without > 20 * with_them


def test_a_prior_of_what_a_north_seeker_has_not_is_refused(tmp_path):
    text = (
        campaign.template(NORTH)
        + '\n[prior]\n"accel.quadratic" = { mean = "0 ug/g^2", sd = "1 ug/g^2" }\n'
    )
    file = campaign.save_session(campaign.simulate(campaign.parse(text)), tmp_path)
    for ask in (campaign.calibrate, north.run):
        with pytest.raises(FoucaultError, match=r"accel\.quadratic"):
            ask(file)
