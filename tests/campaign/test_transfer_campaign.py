"""A campaign of transfer alignment from its file to its report, its study and its outage."""

from __future__ import annotations

import json

import numpy as np
import pytest

from foucault import campaign, run_folder
from foucault.campaign import navigation, optimisation, study
from foucault.campaign.holding import held
from foucault.campaign.tables import Said
from foucault.errors import FoucaultError
from foucault.export import request
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.layouts import kind_of
from foucault.procedures.navigation.start import Settings as Navigation
from foucault.procedures.transfer_alignment.settings import LEFT_OUT, PRIOR
from foucault.report import html
from foucault.result import Level
from make_transfer_campaign import described, faultless, made, missed, written
from refusals import refuses


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """Simulate a session with its outage, and write it."""
    folder = tmp_path_factory.mktemp("transfer")
    made = campaign.simulate(described(with_outage="true", rate='"50 Hz"'), 5)
    return folder, made, campaign.save_session(made, folder)


@pytest.fixture(scope="module")
def run(session):
    folder, _, file = session
    heard = []
    described = campaign.load(file)
    result = campaign.calibrate(described, lambda done, what: heard.append((done, what)))
    assert heard[-1] == (1.0, "done")
    text = campaign.resolved(described, folder / "run")
    run_folder.save(result, folder / "run", text)
    return result


@pytest.mark.thorough
def test_from_the_file_to_the_report(session, run):
    folder, made, file = session
    assert run.verdict.level is Level.PASS, run.verdict.reasons
    assert not run.findings
    assert np.abs(missed(run, made)[0]).max() < 4.5
    assert run.provenance["input"]["master"]["file"] == "master.csv"
    back = run_folder.load_result(folder / "run")
    np.testing.assert_array_equal(back.coefficients.cov, run.coefficients.cov)
    assert "Calibration" in html(back)
    # The copy in the run folder gives the same result from there.
    again = campaign.calibrate(folder / "run" / "campaign.toml")
    np.testing.assert_array_equal(again.coefficients.values, run.coefficients.values)
    truth = json.loads((folder / "truth.json").read_text())
    named = {row["name"]: row["value"] for row in truth["coefficients"]}
    assert named["master.delay"] == pytest.approx(0.1, abs=1e-6)
    assert named["installation.x"] == made.simulation.made.slave.mu[0]
    assert file.read_text().count("[master]") == 1


@pytest.mark.thorough
def test_a_mounting_is_no_error_of_readings(session, run):
    """Applied to readings and exported are the errors of the sensors alone."""
    _, made, _ = session
    log = run.apply(made.simulation.log)
    model, true = run.model, made.simulation.model
    off = np.abs(model.gyro_bias - true.gyro_bias)
    assert (off < 4 * run.coefficients["gyro.bias"].sd).all()
    assert len(log) == len(made.simulation.log)
    made_for = request.request(run, "ros2", ("gyro.bias", "gyro.scale", "accel.bias"))
    assert made_for.model.gyro_bias == pytest.approx(model.gyro_bias)
    assert kind_of("installation.x") == "angle"


def test_the_outage_is_navigated_with_what_was_found(tmp_path):
    """Without errors that no result has: those of some slaves outweigh its own."""
    made, folder = campaign.simulate(faultless(with_outage="true", rate='"50 Hz"'), 5), tmp_path
    described = campaign.load(campaign.save_session(made, folder))
    run = campaign.calibrate(described)
    run_folder.save(run, folder / "run", campaign.resolved(described, folder / "run"))
    handed = run.diagnostics["hand_over"]
    start = handed["time"] - made.simulation.outage.time[0]
    angles = {name: handed[name] for name in ("heading", "pitch", "roll")}
    chosen = Navigation(vertical="aided", start=start, level_sd=5e-5, heading_sd=5e-5, **angles)
    found = navigation.run(
        folder / "outage.csv", Said(gyro_noise=1.7e-5, accel_noise=3e-4), chosen,
        calibration=folder / "run", reference=folder / "reference.csv",
    )  # fmt: skip
    with_, without = (np.hypot(*run.errors.position[-1, :2]) for run in found.runs)
    assert with_ < 0.5 * without
    assert with_ < 3000


@pytest.mark.thorough
def test_a_study(tmp_path):
    c = described(rate='"50 Hz"', message_rate='"2 Hz"')
    found = study.run(c, 4, tmp_path, workers=1)
    assert found.names == c.settings.reported
    assert found.status == {"converged": 4}
    again = study.run(c, 4, tmp_path / "again", workers=2)
    assert [row["ratio"] for row in again.rows()] == [row["ratio"] for row in found.rows()]


@pytest.mark.thorough
def test_errors_are_as_large_as_the_uncertainties_of_the_template(tmp_path):
    """A slave that held nothing of what is counted had NEES/n of .6."""
    c = described(rate='"50 Hz"', message_rate='"2 Hz"')
    found = study.run(c, 16, tmp_path, workers=1)
    low, high = chi_square_limits(16 * len(found.names), 0.01)
    assert low <= found.nees.sum() <= high
    assert "always (gyro.misalignment," in study.load(tmp_path)[1]["left_out"]


def test_a_slave_holds_what_is_counted_though_no_size_is_declared():
    """Of the size that [prior] says, or else the usual one; nothing where it is taken for none."""
    own = '[prior]\n"gyro.misalignment" = { mean = "5 mrad", sd = "1 arcsec" }'
    known = campaign.parse(written().replace("# [prior]", own, 1))
    usual, told = (held(c, 3).values for c in (described(), known))
    groups = dict.fromkeys(name.rpartition(".")[0] for name in usual)
    assert list(groups) == [*LEFT_OUT]
    for name, x in usual.items():
        assert 0 < abs(x) < 4 * PRIOR[name.rpartition(".")[0]][1]
        near = abs(told[name] - 5e-3) < 2e-5 if "gyro.mis" in name else told[name] == x
        assert near
    model = made(described(rate='"20 Hz"', message_rate='"1 Hz"'), 3).simulation.model
    assert model.coefficients().value("gyro.g_sensitivity.xz") == usual["gyro.g_sensitivity.xz"]
    assert not held(faultless(), 3).values


@pytest.mark.thorough
def test_preflight():
    seen = optimisation.foresee(described(profile='"straight"'))
    assert not seen.complete
    assert seen.rank < seen.states
    assert "master.delay" in seen.hardly
    codes = [f.code for f in seen.findings]
    assert codes == ["transfer.unseen"]
    best = min(seen.more, key=lambda extra: extra.ratio)
    assert best.what == "an S-turn of 40 deg"


def test_masters_where_they_do_not_belong():
    text = written()
    with refuses("campaign.no_master") as caught:
        campaign.parse(text.replace('name = "transfer_alignment"', 'name = "systematic"'))
    assert "procedure 'systematic' calibrates an instrument by itself" in caught.value.message
    head, rest = text.split("[master]")
    with refuses("campaign.required") as caught:
        campaign.parse(head + rest[rest.index("[procedure]") :])
    assert "master is missing" in caught.value.message
    with pytest.raises(FoucaultError) as caught:
        campaign.parse(text.replace('file = "master.csv"', 'fil = "master.csv"'))
    assert "master.fil is not a key" in caught.value.message


def test_the_schema_knows_the_master():
    jsonschema = pytest.importorskip("jsonschema")
    import tomllib

    check = jsonschema.Draft202012Validator(campaign.schema())
    good = tomllib.loads(written())
    assert list(check.iter_errors(good)) == []
    assert list(check.iter_errors(good | {"master": {"fil": "x"}}))
