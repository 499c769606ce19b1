"""Nineteen positions in one log and more in others: one calibration, biases of each its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault import campaign, logs
from foucault.errors import FoucaultError
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.ins_errors import Sensors
from foucault.plans.manoeuvres import Rest
from foucault.plans.sequence import CalibrationSequence, orientation
from foucault.procedures import systematic
from foucault.procedures.systematic.settings import Session, Settings
from foucault.result import Level
from foucault.simulate.systematic import simulate_systematic
from foucault.tables import AXES, Log
from make_sequence import DPH, NOISE
from make_sequence import SITE as PLACE

SITE = replace(PLACE, gravity_sd=0.0)  # one gravity, not one of each recording

UG = 9.80665e-6
REPEATS = {"gyro": 0.01 * DPH, "accel": 50 * UG}
BOTH = ("19 positions", "9 positions")
SETTINGS = Settings(sequence=BOTH)


def joined(parts: list[Log]) -> Log:
    """Recordings one after the other, with times that go on."""
    times = [parts[0].time]
    for part in parts[1:]:
        times.append(part.time - part.time[0] + times[-1][-1] + 10.0)
    return replace(
        parts[0], time=np.concatenate(times), gyro=np.concatenate([p.gyro for p in parts]),
        accel=np.concatenate([p.accel for p in parts]),
        begins=tuple(np.cumsum([len(p) for p in parts[:-1]]).tolist()),
    )  # fmt: skip


def switched_on(model, seed):
    """The instrument after another switch-on."""
    rng = np.random.default_rng([seed, 99])
    gyro, accel = (sd * rng.standard_normal(3) for sd in REPEATS.values())
    return replace(model, gyro_bias=model.gyro_bias + gyro, accel_bias=model.accel_bias + accel)


def recorded(seed, names=BOTH):
    """The instrument, as it is each time, and its recordings of built-in sequences."""
    model = systematic.draw_errors("navigation", seed)
    each = [switched_on(model, 10 * seed + k) for k in range(len(names))]
    made = [
        systematic.simulate(
            Session(rest_time=60.0), settings=Settings(sequence=(name,)), model=one, noise=NOISE,
            site=SITE, seed=100 * seed + k,
        ).log
        for k, (name, one) in enumerate(zip(names, each, strict=True))
    ]  # fmt: skip
    return model, each, made


def missed(found, model):
    """Squared normalised error of all coefficients."""
    d = found.values - [model.coefficients().value(name) for name in found.names]
    return float(d @ np.linalg.solve(found.cov, d))


@pytest.fixture(scope="module")
def session():
    model, each, made = recorded(7)
    return model, each, made, systematic.calibrate(
        joined(made), site=SITE, settings=SETTINGS, noise=NOISE
    )  # fmt: skip


@pytest.mark.thorough
def test_two_logs_with_biases_of_their_own(session):
    model, each, _, result = session
    assert result.verdict.level is Level.PASS, result.verdict.reasons
    low, high = chi_square_limits(len(result.coefficients), 0.01)
    assert low < missed(result.coefficients, model) < high
    told = result.diagnostics["recordings"]
    for triad, repeats in REPEATS.items():
        sd = result.coefficients[f"{triad}.bias"].sd
        assert np.all(sd > 0.99 * repeats / np.sqrt(2)) and np.all(sd < 1.1 * repeats / np.sqrt(2))
        for row, one in zip(told["each"], each, strict=True):
            said, truth = row[triad], getattr(one, f"{triad}_bias")
            off = (np.array(said["bias"]) - truth) / said["sd"]
            assert np.abs(off).max() < 4.5
            assert np.max(said["sd"]) < 0.5 * repeats
    (note,) = (f for f in result.findings if f.code == "systematic.recordings")
    assert "0.01 deg/h and 50 ug" in note.message


@pytest.mark.thorough
def test_as_calibrated_one_by_one_and_put_together(session):
    """Each log alone, with biases free, and the two results as means with covariance."""
    _, _, made, both = session
    free = {"gyro.bias": (0.0, 1.0 * DPH), "accel.bias": (0.0, 5e3 * UG)}
    some = [
        systematic.trial(log, site=SITE, settings=Settings(sequence=(name,)), noise=NOISE,
                         prior=free).coefficients
        for log, name in zip(made, BOTH, strict=True)
    ]  # fmt: skip
    names = both.coefficients.names
    bias = [names.index(f"{t}.bias.{a}") for t in REPEATS for a in AXES]
    n, sizes = len(names), both.coefficients.prior_sd
    r = np.repeat([*REPEATS.values()], 3)
    unit = np.concatenate([sizes, r, r])
    information = np.diag(np.concatenate([sizes**-2.0, r**-2.0, r**-2.0]))
    score = np.zeros(len(unit))
    for k, one in enumerate(some):
        assert one.names == names
        H = np.zeros((n, len(unit)))
        H[:, :n] = np.eye(n)
        H[bias, n + 6 * k + np.arange(6)] = 1.0
        told = np.linalg.inv(one.cov)
        information += H.T @ (told - np.diag(one.prior_sd**-2.0)) @ H
        score += H.T @ told @ one.values
    cov = np.linalg.inv(information * np.outer(unit, unit)) * np.outer(unit, unit)
    values, sd = (cov @ score)[:n], np.sqrt(np.diag(cov))[:n]
    np.testing.assert_allclose(both.coefficients.sd, sd, rtol=0.02)
    assert np.abs((both.coefficients.values - values) / sd).max() < 0.1


@pytest.mark.thorough
def test_a_repeatability_that_is_too_small_does_not_pass(session):
    _, _, made, _ = session
    tight = SETTINGS.model_copy(update={
        f"{triad}_bias_repeatability": sd / 20 for triad, sd in REPEATS.items()
    })  # fmt: skip
    result = systematic.trial(joined(made), site=SITE, settings=tight, noise=NOISE)
    assert result.verdict.level is not Level.PASS
    (check,) = (c for c in result.checks if c.name == "switch-on")
    assert not check.passed
    assert "accel_bias_repeatability is 2.5 ug" in check.sentence


@pytest.mark.thorough
def test_static_poses_in_files_of_their_own():
    model, _, made = recorded(3, BOTH[:1])
    for k, pose in enumerate([("up", "east", "north"), ("north", "up", "east")]):
        sequence = CalibrationSequence("pose", orientation(pose), (Rest(120.0, "pose"),))
        made.append(simulate_systematic(sequence, site=SITE, noise=NOISE, rate=50.0, seed=k,
                                        model=switched_on(model, 70 + k)).log)  # fmt: skip
    settings = Settings(sequence=())
    result = systematic.trial(joined(made), site=SITE, settings=settings, noise=NOISE)
    assert result.verdict.level is Level.PASS, result.verdict.reasons
    low, high = chi_square_limits(len(result.coefficients), 0.01)
    assert low < missed(result.coefficients, model) < high
    seen = REPEATS["accel"] / np.sqrt([2.0, 2.0, 1.0])  # a pose shows the axis that is up
    np.testing.assert_allclose(result.coefficients["accel.bias"].sd, seen, rtol=0.05)


def written(folder, made, text):
    """A campaign of recordings in files of their own, each from time zero."""
    files = [f"{k}.npz" for k in range(len(made))]
    for file, log in zip(files, made, strict=True):
        logs.write(log, folder / file)
    template = campaign.template("systematic").replace(
        "[instrument]", "[instrument]\nleft_out = false"
    )
    about = f'[log]\nfile = "{files[0]}"\nmore = {files[1:]}\n'.replace("'", '"')
    (folder / "campaign.toml").write_text(
        template[: template.index("[log]")] + about + f'[procedure]\nname = "systematic"\n{text}\n'
        '[noise.accel]\nwhite = "5 ug/sqrt(Hz)"\n[noise.gyro]\nwhite = "0.0007 deg/sqrt(h)"\n'
    )
    return folder / "campaign.toml"


@pytest.mark.thorough
def test_the_campaign_reads_both_files(session, tmp_path):
    _, _, made, result = session
    file = written(tmp_path, made, 'sequence = ["19 positions", "9 positions"]')
    text = file.read_text().split("[site]")[1].split("[log]")[0]
    site = f'\nlatitude = "{np.degrees(SITE.latitude)} deg"\nheight = "{SITE.height} m"\n'
    file.write_text(file.read_text().replace(text, site))
    found = campaign.calibrate(file)
    assert found.provenance["input"]["file"] == "0.npz + 1.npz"
    np.testing.assert_allclose(found.coefficients.values, result.coefficients.values, rtol=1e-6,
                               atol=1e-12)  # fmt: skip


def refused(file):
    with pytest.raises(FoucaultError) as caught:
        campaign.calibrate(file)
    return caught.value


@pytest.mark.thorough
def test_what_does_not_fit_is_named(tmp_path):
    _, _, made = recorded(1, ("9 positions", "9 positions"))
    problem = refused(written(tmp_path, made, 'sequence = ["9 positions"]'))
    assert problem.code == "systematic.recordings_sequence"
    assert "2 recordings, and there is 1 in `sequence`" in problem.message
    published = 'sequence = ["9 positions", "9 positions"]\nsteps = "published"\n'
    published += 'deflection = "coupled6"'
    assert refused(written(tmp_path, made, published)).code == "systematic.recordings_published"
    wrong = refused(written(tmp_path, made, 'sequence = ["9 positions", "19 positions"]'))
    assert wrong.code == "systematic.start"
    assert wrong.message.startswith("Recording 2, from 671 s on: ")
    slow = replace(made[1], time=2 * made[1].time)
    assert refused(written(tmp_path, [made[0], slow], "sequence = []")).code == "log.more_differs"
    file = written(tmp_path, made, "sequence = []")
    (tmp_path / "1.npz").unlink()
    assert "1.npz" in refused(file).message


def test_a_part_of_a_log_keeps_what_begins_in_it():
    log = Log(np.arange(10.0), None, None, begins=(4, 7))
    assert log[5:].begins == (2,)
    assert log[:7].begins == (4,)
    assert log[4:8].begins == (3,)
    assert [(row, len(part)) for row, part in log.recordings()] == [(0, 4), (4, 3), (7, 3)]


def test_each_recording_has_its_own_biases_alone():
    sensors = Sensors.of(("gyro.bias", "accel.bias")).with_turn_on(2)
    for k in (0, 1):
        rows = sensors.during(k).readings(np.zeros(3), np.zeros(3))
        there = {n for n, x in zip(sensors.layout.names, rows.T, strict=True) if x.any()}
        assert {n.split(".")[1] for n in there} == {"bias", f"turn_on_{k + 1}"}
