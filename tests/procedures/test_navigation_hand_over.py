"""A start in motion that another system hands over: attitude, velocity and position."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import commands
from foucault import run_folder
from foucault.errors import FoucaultError
from foucault.infer.gauss_newton import chi_square_limits
from foucault.logs import write as write_log
from foucault.models.earth import Site, displaced
from foucault.plans.manoeuvres import Accelerate, Rest, Turn
from foucault.procedures.navigation import navigate_log
from foucault.procedures.navigation.start import Settings
from foucault.result import Level
from make_navigation import NOISE, calibration, errors, logged, reference_of
from refusals import refuses
from sessions import codes

PLAN = [Rest(5.0), Accelerate(15.0, 10.0), Turn(np.radians(80), 20.0, banked=False),
        Accelerate(15.0, 60.0)]  # fmt: skip
FROM = 20.0
"""When it is handed over, within the turn [s]."""

SDS = {"level_sd": np.radians(1 / 60), "heading_sd": np.radians(3 / 60), "velocity_sd": 0.05,
       "position_sd": 4.0}  # fmt: skip


def handed(run, seed: int | None = None):
    """Return settings and place as handed over: the truth, or off by errors of `SDS`."""
    t = run.truth
    i = int(np.searchsorted(t.time, t.time[0] + FROM - 1e-9))
    rng = np.random.default_rng(seed)
    off = np.zeros(9) if seed is None else rng.normal(size=9)
    angles = t.angles[i] + off[:3] * [SDS["heading_sd"], SDS["level_sd"], SDS["level_sd"]]
    velocity = t.velocity_n[i] + SDS["velocity_sd"] * off[3:6]
    place = displaced(t.latitude[i], t.longitude[i], t.height[i], SDS["position_sd"] * off[6:])
    latitude, longitude, height = (float(x) for x in place)
    site = Site.at(latitude, height)
    given = dict(zip(("heading", "pitch", "roll"), map(float, angles), strict=True))
    settings = Settings(start=FROM, velocity=tuple(velocity), vertical="free", **given, **SDS)
    return settings, {"site": site, "longitude": longitude}


@pytest.fixture(scope="module")
def perfect():
    return logged(PLAN, noise=None)


def test_a_start_in_motion_goes_on_from_the_velocity_and_place_that_are_given(perfect) -> None:
    settings, there = handed(perfect)
    known = reference_of(perfect)
    right = navigate_log(perfect.log, settings=settings, noise=NOISE, reference=known, **there)
    assert right.runs[0].errors.position[-1] == pytest.approx(np.zeros(3), abs=0.05)
    assert "navigate.speed_at_start" not in codes(right)
    # Velocity as given, not that of the reference or zero: 0.2 m/s more are 15 m in 75 s.
    fast = settings.model_copy(
        update={"velocity": tuple(np.add(settings.velocity, [0.2, 0.0, 0.0]))}
    )
    off = navigate_log(perfect.log, settings=fast, noise=NOISE, reference=known, **there)
    e = off.runs[0].errors
    assert e.position[-1, 0] == pytest.approx(0.2 * e.age[-1], rel=0.02)
    # And the place that is given, where its sd is; else that of the reference.
    site = replace(there["site"], latitude=there["site"].latitude + 10.0 / 6.37e6)
    north = {"site": site, "longitude": there["longitude"]}
    seen = navigate_log(perfect.log, settings=settings, noise=NOISE, reference=known, **north)
    assert seen.runs[0].errors.position[-1, 1] == pytest.approx(10.0, abs=0.2)
    loose = settings.model_copy(update={"position_sd": None})
    seen = navigate_log(perfect.log, settings=loose, noise=NOISE, reference=known, **north)
    assert seen.runs[0].errors.position[-1, 1] == pytest.approx(0.0, abs=0.2)


def test_the_predicted_error_holds_that_of_the_start(perfect) -> None:
    settings, there = handed(perfect)
    test = navigate_log(perfect.log, settings=settings, noise=NOISE, **there)
    exact = settings.model_copy(update={"velocity_sd": 1e-9, "position_sd": None})
    less = navigate_log(perfect.log, settings=exact, noise=NOISE, **there)
    age = test.budget.time[-1] - test.runs[0].start.time
    more = np.diag(test.budget.cov[-1] - less.budget.cov[-1])
    expected = SDS["position_sd"] ** 2 + (SDS["velocity_sd"] * age) ** 2
    assert more[6:8] == pytest.approx(expected, rel=0.02)
    assert more[3:5] == pytest.approx(SDS["velocity_sd"] ** 2, rel=0.02)


@pytest.mark.thorough
def test_runs_from_a_hand_over_are_as_far_off_as_predicted() -> None:
    """NEES of position and velocity of 30 runs; taken as exact, the start is far too sure."""
    squares, without, passed = 0.0, 0.0, 0
    rows = [6, 7, 8, 3, 4, 5]
    for seed in range(30):
        true, found = errors(seed)
        run = logged(PLAN, true, seed=seed, rate=10.0)
        settings, there = handed(run, seed)
        test = navigate_log(run.log, settings=settings, noise=NOISE, reference=reference_of(run),
                            calibration=calibration(found), **there)  # fmt: skip
        e = test.runs[0].errors
        x = np.concatenate([e.position[-1], e.velocity[-1]])
        squares += x @ np.linalg.solve(test.budget.cov[-1][np.ix_(rows, rows)], x)
        exact = settings.model_copy(update={"velocity_sd": 1e-9, "position_sd": 1e-9})
        less = navigate_log(run.log, settings=exact, noise=NOISE, reference=reference_of(run),
                            calibration=calibration(found), **there)  # fmt: skip
        without += x @ np.linalg.solve(less.budget.cov[-1][np.ix_(rows, rows)], x)
        passed += test.verdict.level is Level.PASS
    low, high = chi_square_limits(180)
    assert low < squares < high, (squares, low, high)
    assert without > 3 * high and passed >= 28


def test_what_is_given_in_part_is_refused() -> None:
    with refuses("navigate.velocity") as caught:
        Settings(velocity=(1.0, 0.0, 0.0), heading=0.1)
    assert "--velocity was given without the whole attitude" in caught.value.message
    assert "Give --heading, --pitch and --roll of the same moment" in caught.value.cure
    with pytest.raises(FoucaultError, match="--velocity-sd was given without the whole attitude"):
        Settings(velocity_sd=0.1)


@pytest.mark.thorough
def test_the_command_takes_a_hand_over(perfect, tmp_path) -> None:
    true, found = errors()
    drive = logged(PLAN, true, rate=10.0)
    write_log(drive.log, tmp_path / "log.csv")
    run_folder.save(calibration(found), tmp_path / "run")
    settings, there = handed(drive)

    def run(*words: object):
        given = [*words, "--calibration", tmp_path / "run", "--from", "20 s",
                 *(x for k in ("heading", "pitch", "roll")
                   for x in (f"--{k}", f"{np.degrees(getattr(settings, k))} deg")),
                 "--latitude", f"{np.degrees(there['site'].latitude)} deg"]  # fmt: skip
        return commands.run(*given, "--json")

    log = tmp_path / "log.csv"
    v = ", ".join(f"{x} m/s" for x in settings.velocity)
    place = ["--longitude", "8.5 deg", "--height", "430 m"]
    said = json.loads(run("navigate", log, "--velocity", v, "--velocity-sd", "0.05 m/s",
                          "--position-sd", "4 m", *place).stdout)  # fmt: skip
    start = said["runs"][0]["start"]
    assert start["velocity"] == pytest.approx(settings.velocity, abs=1e-9)
    assert (start["velocity_sd"], start["position_sd"]) == (0.05, 4.0)
    assert said["settings"]["velocity"] == pytest.approx(settings.velocity)
    usual = json.loads(run("navigate", log, "--velocity", v, *place).stdout)["runs"][0]["start"]
    assert (usual["velocity_sd"], usual["position_sd"]) == (0.1, 0.0)
    two = run("navigate", log, "--velocity", "1 m/s, 2 m/s", *place)
    assert two.exit_code == 1 and json.loads(two.stdout)["error"]["code"] == "program.parts"
    assert "--velocity '1 m/s, 2 m/s' does not say east, north and up." in two.stderr
    assert 'Write --velocity "12.1 m/s, -3.4 m/s, 0 m/s".' in two.stderr
    part = run("navigate", log, "--velocity", v, "--position-sd", "4 m")
    assert part.exit_code == 1
    assert "--position-sd was given without --longitude and --height" in part.stderr
    assert "Give --latitude, --longitude and --height of the start" in " ".join(part.stderr.split())
