"""What people get wrong with a tumble, and what they are told."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import foucault
from foucault.campaign import read_log, save_session
from foucault.diagnose import tumble as tumble_input
from foucault.errors import Status
from foucault.guard import command
from foucault.models.cluster import CONSTANTS
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.plans.tumble import PUBLISHED as PUBLISHED_PLAN
from foucault.plans.tumble import nominal
from foucault.procedures.platform_tumble.settings import PRIOR
from foucault.result import Level
from foucault.symptoms import SYMPTOMS
from make_cluster import G
from make_tumble import FAST, PUBLISHED, SLOW, calibrate, campaign_of, tumble
from refusals import refuses
from sessions import codes

DEG = np.radians(1.0)
BARE = 'average = "5 s"'
COARSE = 'interval = "0.5 s"'
PLANNED = 'plan = "published"\naverage = "5 s"'
UNPLANNED_FAST = tumble(FAST)[1].simulation.log
UNPLANNED_SLOW = tumble(SLOW, COARSE)[1].simulation.log
PUBLISHED_LOG = tumble()[1].simulation.log
LOGS = {"0.1 deg/s": PUBLISHED_LOG, "5 deg/s": UNPLANNED_FAST, "0.02 deg/s": UNPLANNED_SLOW}


def refused(code, text, log, made=None, **words):
    with refuses(code) as caught:
        calibrate(made or tumble()[0], log, **words)
    assert text in str(caught.value)
    return str(caught.value)


def told(result, code):
    some = [f for f in result.findings if f.code == code]
    assert some, [f.code for f in result.findings]
    return f"{some[0].message} {some[0].cure}"


def rows(log, keep):
    temperature = None if log.temperature is None else log.temperature[keep]
    return replace(log, time=log.time[keep], gyro=log.gyro[keep], accel=log.accel[keep],
                   temperature=temperature)  # fmt: skip


def finite(value):
    """Whether everything in nested numbers is one."""
    if isinstance(value, dict):
        return all(finite(v) for v in value.values())
    if isinstance(value, (list, tuple)):
        return all(finite(v) for v in value)
    return not isinstance(value, float) or np.isfinite(value)


def saved(result, folder):
    """Save a result whatever came out, and see that no number is none."""
    foucault.save_result(result, folder)
    again = foucault.load_result(folder)
    assert finite(again.diagnostics)
    for table in again.tables.values():
        assert all(np.isfinite(column).all() for column in table.values())
    assert np.isfinite(again.coefficients.values).all()
    assert np.isfinite(again.coefficients.cov).all()
    return again


def test_every_row_of_the_table_is_asserted_here():
    source = Path(__file__).read_text(encoding="utf-8")
    for name in ("test_platform_tumble.py", "test_tumble_spoiled.py"):
        source += (Path(__file__).parents[1] / "procedures" / name).read_text(encoding="utf-8")
    assert [c for c in SYMPTOMS if c.startswith("tumble.") and f'"{c}"' not in source] == []


# -- what is missing -------------------------------------------------------------------------------


def test_no_command_and_no_readings():
    log = PUBLISHED_LOG
    said = refused("tumble.no_command", "[log.gyro] is missing", replace(log, gyro=None))
    assert "Describe the columns of the commanded rates" in said
    gyro = log.gyro.copy()
    gyro[[100, 300], 1] = np.nan
    refused("tumble.no_command", "2 rows, the first at 20 s", replace(log, gyro=gyro))
    said = refused("tumble.no_accel", "no readings of accelerometers", replace(log, accel=None))
    assert "[log.accel]" in said


def test_a_command_of_nothing():
    still = replace(PUBLISHED_LOG, gyro=0 * PUBLISHED_LOG.gyro)
    said = refused("tumble.still", "commanded rate is 0 deg/h", still)
    assert "the Earth alone turns at 15 deg/h" in said and "in the unit that [log.gyro]" in said


def test_no_latitude():
    said = refused("tumble.no_latitude", "Without latitude", PUBLISHED_LOG, site=Site(G, None))
    assert "Give the latitude in [site]" in said


@pytest.mark.parametrize(
    ("old", "new", "code", "text"),
    [
        ("gyro = ", "# gyro = ", "tumble.no_command", "[log.gyro] is missing"),
        ("accel = ", "# accel = ", "tumble.no_accel", "no readings"),
        ('unit = "rad/s"', 'unit = "deg/s"', "tumble.still", "is 6.28 deg/h"),
        ('"gyro_y"', '"-gyro_y"', "tumble.axes", "as if the command were (x, -y, z);"),
        ('["accel_x", "accel_y"', '["accel_y", "accel_x"', "tumble.axes", "or (y, x, z);"),
        ('unit = "m/s^2"', 'unit = "g"', "tumble.gravity",
         "the unit is m/s^2 and was declared as g"),
        ('unit = "m/s^2" }', 'unit = "m/s^2", reads = "gravity" }', "tumble.sign",
         '`start` puts up. Specific force at rest points up: give reads = "gravity"'),
        ("[simulate]", '[prior]\n"gyro.drift" = { mean = "0 deg/h", sd = "0 deg/h" }\n[simulate]',
         "prior.sd", "sd = '0 deg/h' is not positive"),
        ("[simulate]", '[prior]\n"accel.bias.x" = { mean = "0 ug", sd = "-1 ug" }\n[simulate]',
         "prior.sd", "sd = '-1 ug' is not positive"),
    ],
)  # fmt: skip
def test_mistakes_in_the_campaign_file(tmp_path, old, new, code, text):
    _, session = tumble(BARE, 'interval = "5 s"\ncommand_interval = "5 s"')
    file = save_session(session, tmp_path)
    wrong = file.read_text()
    assert old in wrong
    file.write_text(wrong.replace(old, new, 1))
    with refuses(code) as caught:
        foucault.calibrate(foucault.load_campaign(file))
    assert text in str(caught.value)


# -- units and axes --------------------------------------------------------------------------------


@pytest.mark.parametrize("speed", LOGS)
@pytest.mark.parametrize(
    ("factor", "likely"),
    [
        (1 / DEG, "the unit is deg/s and was declared as rad/s"),
        (DEG, "the unit is rad/s and was declared as deg/s"),
        (3600.0, "the unit is deg/h or arcsec/s and was declared as deg/s"),
        (3600 / DEG, "the unit is deg/h or arcsec/s and was declared as rad/s"),
        (1 / 3600, "the unit is deg/s and was declared as deg/h or arcsec/s"),
        (DEG / 3600, "the unit is rad/s and was declared as deg/h or arcsec/s"),
        ("dt", "increments were declared as rates"),
        (0.4, "unit or scale"),
    ],
)
def test_commands_in_a_wrong_unit(speed, factor, likely):
    log = LOGS[speed]
    factor = log.interval if factor == "dt" else factor
    wrong = replace(log, gyro=factor * log.gyro)
    if np.abs(wrong.gyro).max() < 45 * DEG / 3600:
        refused("tumble.still", "Log the rates that were commanded", wrong)
        return
    said = refused("tumble.unit", f"Correct `unit` or `kind` in [log.gyro]: {likely}.", wrong)
    seen = float(said.split("turns ")[1].split(" times")[0])
    assert seen == pytest.approx(1 / factor, rel=0.1)


@pytest.mark.parametrize(
    ("factor", "likely"),
    [
        (1 / 9.80665, "the unit is g and was declared as m/s^2"),
        (9.80665, "the unit is m/s^2 and was declared as g"),
        (1000 / 9.80665, "the unit is mg and was declared as m/s^2"),
        (1e6 / 9.80665, "the unit is ug and was declared as m/s^2"),
        (1e-3, "the unit is g and was declared as mg"),
        (1e3, "the unit is mg and was declared as g"),
        (0.2, "increments were declared as rates"),
        (1.2, "the unit or the count scale"),
    ],
)
def test_readings_in_a_wrong_unit(factor, likely):
    wrong = replace(PUBLISHED_LOG, accel=factor * PUBLISHED_LOG.accel)
    said = refused("tumble.gravity", f"({likely}), or gravity in [site]", wrong)
    given = float(said.split("specific force is ")[1].split(" m/s")[0])
    assert given == pytest.approx(9.81 * factor, rel=2e-3)


def test_readings_of_gravity_instead_of_specific_force():
    wrong = replace(PUBLISHED_LOG, accel=-PUBLISHED_LOG.accel)
    said = refused("tumble.sign", "point 175 deg away from where `start` puts up", wrong)
    assert 'give reads = "gravity" in [log.accel]' in said


def exchanged(order, signs):
    matrix = np.zeros((3, 3))
    matrix[np.arange(3), order] = signs
    return matrix


def words(matrix):
    return ", ".join(
        ("-" if row.sum() < 0 else "") + "xyz"[int(np.flatnonzero(row)[0])] for row in matrix
    )


EXCHANGED = [
    exchanged(order, signs)
    for order, signs in (
        ((1, 0, 2), (1, 1, 1)), ((0, 2, 1), (1, 1, 1)), ((2, 1, 0), (1, 1, 1)),
        ((1, 2, 0), (1, 1, 1)), ((2, 0, 1), (1, -1, 1)), ((0, 1, 2), (-1, 1, 1)),
        ((0, 1, 2), (1, -1, 1)), ((0, 1, 2), (1, 1, -1)), ((0, 1, 2), (-1, -1, -1)),
    )
]  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("speed", LOGS)
@pytest.mark.parametrize("matrix", EXCHANGED, ids=words)
def test_axes_that_are_swapped_or_reversed(speed, matrix):
    log = LOGS[speed]
    noise = np.random.default_rng(5).normal(0.0, 2e-3, log.accel.shape)  # 0.2 mg
    wrong = replace(log, gyro=log.gyro @ matrix.T, accel=log.accel + noise)
    said = refused("tumble.axes", f"as if the command were ({words(matrix.T)})", wrong)
    assert 'Correct the order or the signs of the columns in [log.gyro], such as "-gy"' in said
    assert float(said.split("explains ")[1].split(" %")[0]) > 95
    # A mirrored command can be no fault of the readings; another one can, in two ways.
    mirrored = np.linalg.det(matrix) < 0
    assert (f", or the readings were ({words(matrix)})" in said) != mirrored
    assert (f"or ({words(-matrix)});" in said) != mirrored


@pytest.mark.parametrize("matrix", EXCHANGED[:4], ids=words)
def test_axes_of_the_readings_that_are_swapped(matrix):
    """The list of what would look the same has the columns that are right."""
    log = LOGS["5 deg/s"]
    wrong = replace(log, accel=log.accel @ matrix.T)
    said = refused("tumble.axes", ", or the readings were ", wrong)
    listed = said.split("were ")[2].split(";")[0].split(" or ")
    assert f"({words(matrix.T)})" in listed


@pytest.mark.thorough
def test_a_motion_that_no_command_explains(tmp_path):
    """Readings that do not move, and readings that are noise: no numbers that are none."""
    made, session = tumble()
    log = session.simulation.log
    stuck = calibrate(made, replace(log, accel=np.tile(log.accel[:1], (len(log), 1))))
    said = told(stuck, "tumble.motion")
    assert said.startswith("The command explains only 0 % of how the accelerometers' readings move")
    assert "Look for slipping axes, a command in a wrong unit" in said
    assert stuck.verdict.level is not Level.PASS
    saved(stuck, tmp_path / "stuck")
    noise = np.random.default_rng(1).normal(size=log.accel.shape)
    noise *= made.site.gravity / np.median(np.linalg.norm(noise, axis=1))
    wild = calibrate(made, replace(log, accel=noise))
    told(wild, "tumble.motion")
    assert wild.verdict.level is Level.UNUSABLE
    assert wild.status in (Status.NOT_CONVERGED, Status.NOT_FINITE)
    saved(wild, tmp_path / "wild")


def test_a_cluster_that_turns_about_up_is_no_mistake():
    """Readings stand still, as they should."""
    plan = 'plan = "+y"\nrate = "1 deg/s"\nsegment = "900 s"'
    for tilt in ("0 deg", "1.5 deg", "10 deg"):
        attitude = f'attitude = ["{tilt}", "0 deg", "{tilt}"]'
        _, session = tumble(plan, f'{attitude}\nattitude_sd = "0 deg"\n{COARSE}')
        assert command.motion_findings(session.simulation.log, True) == []


# -- plan ------------------------------------------------------------------------------------------


def test_a_log_that_is_shorter_or_longer_than_its_plan():
    made, session = tumble(PLANNED)
    log = session.simulation.log
    short = calibrate(made, rows(log, slice(0, 20000)), trial=True)
    assert told(short, "tumble.plan_time") == (
        "The log takes 3999.8 s and the plan 'published' 5400 s. The command in the log was used, "
        "not the plan. Was it cut off? Correct the plan if not."
    )
    assert "tumble.plan_other" not in codes(short)
    longer = campaign_of(PLANNED + '\nrate = "0.11 deg/s"')
    findings = tumble_input.plan_findings(log, longer.settings.torquing, *_nominal(longer), True)
    assert {f.code for f in findings} == {"tumble.plan_time", "tumble.plan_other"}
    assert "and the plan 'published' 4909.09 s" in findings[0].message


def _nominal(made):
    from foucault.plans.tumble import nominal

    return (nominal(made.settings.torquing, made.site.latitude),)


def test_another_plan_and_one_that_is_shifted():
    made, _ = tumble(PLANNED)
    other = tumble('plan = "-x -z -y -z"\nsegment = "1350 s"\naverage = "5 s"')[1].simulation.log
    said = told(calibrate(made, other, trial=True), "tumble.plan_other")
    assert said.startswith("The command differs from the plan 'published' by ")
    assert "Correct `plan`, `rate`, `segment` or `steps`, or leave them out." in said
    assert "shifted" not in said
    log = PUBLISHED_LOG
    late = replace(log, gyro=np.roll(log.gyro, 150, axis=0))
    findings = tumble_input.plan_findings(late, made.settings.torquing, *_nominal(made), True)
    assert "It fits when shifted by 30 s." in findings[0].message
    early = replace(log, gyro=np.roll(log.gyro, -150, axis=0))
    findings = tumble_input.plan_findings(early, made.settings.torquing, *_nominal(made), True)
    assert "It fits when shifted by -30 s." in findings[0].message


def test_a_command_faster_than_the_rig():
    made = campaign_of('rate_limit = "0.05 deg/s"')
    said = refused("tumble.rate_limit", "`rate_limit` is 0.05 deg/s", PUBLISHED_LOG, made)
    assert said.startswith("At ") and "the commanded rate about" in said
    assert "Correct the unit of [log.gyro], or `rate_limit`" in said


# -- times -----------------------------------------------------------------------------------------


def late_of(result):
    said = told(result, "tumble.delay")
    assert 'Set delay_sd, such as "0.1 s", so that the delay is estimated; or correct' in said
    value, sd = (float(said.split(f" {word} ")[1].split(" ms")[0]) for word in ("are", "take"))
    return value / 1e3, sd / 1e3


@pytest.mark.thorough
@pytest.mark.parametrize("delay", [0.005, -0.005, 0.1, 0.2, -0.2])
def test_readings_that_are_a_little_late_or_early(delay):
    made, session = tumble(simulate=f'delay = "{delay} s"')
    result = calibrate(made, session.simulation.log, trial=True)
    value, sd = late_of(result)
    assert value == pytest.approx(delay, rel=0.03)
    assert sd < 1e-3
    assert result.verdict.level is not Level.PASS
    freed = campaign_of(PUBLISHED + '\ndelay_sd = "0.1 s"')
    found = calibrate(freed, session.simulation.log, trial=True)
    assert "tumble.delay" not in codes(found)
    assert found.status is Status.CONVERGED
    assert abs(found.diagnostics["delay"]["value"] - delay) < 5 * found.diagnostics["delay"]["sd"]


@pytest.mark.thorough
@pytest.mark.parametrize("speed", ["0.1 deg/s", "5 deg/s", "0.02 deg/s", "means"])
@pytest.mark.parametrize("delay", [10.0, -10.0, 2.0, -30.0])
def test_readings_that_are_seconds_late_or_early(speed, delay):
    words = {
        "0.1 deg/s": (PUBLISHED, ""), "5 deg/s": (FAST, ""), "0.02 deg/s": (SLOW, COARSE + "\n"),
        "means": (FAST, 'kind = "increment"\n'),
    }[speed]  # fmt: skip
    made, session = tumble(words[0], f'{words[1]}delay = "{delay} s"')
    log = session.simulation.log
    begins = made.settings.held(log.sampled) == "from its time"
    (finding,) = command.motion_findings(log, begins)
    assert finding.code == "tumble.delay"
    value, sd = (
        float(finding.message.split(f" {word} ")[1].split(" ms")[0]) for word in ("are", "take")
    )
    assert value / 1e3 == pytest.approx(delay, abs=0.06)
    assert command.motion_findings(log, begins, delay_sd=abs(delay)) == []
    assert sd < 0.15 * abs(1e3 * delay)  # 15 deg/h of the Earth over a jump of 102 deg/h, at most


@pytest.mark.thorough
def test_readings_ten_seconds_late_are_no_result(tmp_path):
    made, session = tumble(simulate='delay = "10 s"')
    result = calibrate(made, session.simulation.log)
    value, _ = late_of(result)
    assert value == pytest.approx(10.0, abs=0.05)
    assert result.verdict.level is Level.UNUSABLE
    saved(result, tmp_path)


def test_a_command_that_holds_the_other_way():
    result = calibrate(
        campaign_of(PUBLISHED + '\ncommand_holds = "until its time"'), PUBLISHED_LOG, trial=True
    )
    value, _ = late_of(result)
    assert value == pytest.approx(0.2, rel=0.2)
    assert result.verdict.level is not Level.PASS


def repeated(log, rows):
    """Write the command anew in every so many rows only."""
    return replace(log, gyro=log.gyro[np.arange(len(log)) // rows * rows])


@pytest.mark.parametrize(("plan", "own", "rows", "told"), [
    (BARE, "1 s", 2, True),
    (BARE, "1 s", 3, True),
    (PLANNED, "0.2 s", 2, True),
    (PLANNED, "0.2 s", 7, True),
    (SLOW, "0.2 s", 2, True),
    (PLANNED, "0.4 s", 2, False),
    (PLANNED, "0.4 s", 4, True),
    (PLANNED, "1 s", 5, False),
])  # fmt: skip
def test_a_command_that_is_logged_less_often_than_it_is_given(plan, own, rows, told):
    """What the rig holds for as long loses nothing."""
    made, session = tumble(plan, f'command_interval = "{own}"')
    log, plan = session.simulation.log, made.settings.torquing
    each = plan and nominal(plan, made.site.latitude, log.interval)
    assert tumble_input.held_findings(log, each, True) == []
    found = tumble_input.held_findings(repeated(log, rows), each, True)
    words = f"The log writes each command {rows} times, for {rows / 5:g} s"
    assert [f.message[: len(words)] for f in found if f.code == "tumble.held"] == [words] * told


@pytest.mark.parametrize("step", [1e-5, 1e-6, 1e-8])
def test_a_command_in_coarse_steps_is_not_one_that_is_repeated(step):
    """It changes when it comes to the next count."""
    for own in ("0.2 s", "0.6 s", "1 s"):
        made, session = tumble(PLANNED, f'command_interval = "{own}"')
        log = session.simulation.log
        coarse = replace(log, gyro=np.round(log.gyro / (step * DEG)) * (step * DEG))
        each = nominal(made.settings.torquing, made.site.latitude, log.interval)
        assert tumble_input.held_findings(coarse, each, True) == []


def test_steps_of_any_rate_that_last_whole_seconds_are_not_repeated():
    log, rng = PUBLISHED_LOG, np.random.default_rng(1)
    ends = np.cumsum(50 * rng.integers(2, 7, 200))
    rates = rng.uniform(-0.1, 0.1, (201, 3)) * DEG
    gyro = rates[np.searchsorted(ends, np.arange(len(log)), side="right")]
    assert tumble_input.held_findings(replace(log, gyro=gyro), None, True) == []


def test_a_command_for_the_beginning_of_its_interval_is_not_repeated():
    made, session = tumble(PLANNED, 'command_interval = "1 s"')
    log = session.simulation.log
    each = nominal(made.settings.torquing, made.site.latitude, log.interval)
    instant = nominal(made.settings.torquing, made.site.latitude, 1e-2).command[::100]
    gyro = np.repeat(instant, 5, axis=0)
    gyro = np.concatenate([gyro, gyro[-1:]])[: len(log)]
    assert tumble_input.held_findings(replace(log, gyro=gyro), each, True) == []


def test_a_repeated_command_is_no_pass():
    """Without it the drifts were wrong by ten standard deviations, and passed."""
    made, session = tumble()
    log = repeated(session.simulation.log, 2)
    result = calibrate(made, log)
    assert told(result, "tumble.held").endswith("drifts take that up without a residual.")
    assert result.verdict.level == Level.DOUBTFUL


def test_gaps():
    log = PUBLISHED_LOG
    keep = np.ones(len(log), bool)
    keep[5001:5016] = keep[12001:12101] = False
    result = calibrate(tumble()[0], rows(log, keep), trial=True)
    assert told(result, "tumble.gap") == (
        "2 intervals are longer than 0.3 s; the longest, 20.2 s, begins at 2400 s. The command "
        "before it was taken to hold. Where it did not, attitude is lost there: calibrate the "
        "parts of the log by themselves."
    )
    assert "tumble.gap" not in codes(calibrate(tumble()[0], log, trial=True))


def test_a_gap_in_which_the_command_changed():
    keep = np.ones(len(PUBLISHED_LOG), bool)
    keep[8990:9010] = False
    said = refused("tumble.gap_command", "Between 1797.8 s and 1802 s rows are missing, and the "
                   "command changed meanwhile.", rows(PUBLISHED_LOG, keep))  # fmt: skip
    assert "calibrate the parts of the log by themselves" in said


def test_readings_that_are_missing():
    accel = PUBLISHED_LOG.accel.copy()
    accel[4000:4007] = np.nan
    result = calibrate(tumble()[0], replace(PUBLISHED_LOG, accel=accel), trial=True)
    said = told(result, "tumble.masked")
    assert said.startswith("7 readings of the accelerometers are missing, the first at 800 s.")
    assert result.verdict.level is Level.PASS
    miss = (result.coefficients.values - tumble()[1].truth.values)[:42]
    assert np.abs(miss / result.coefficients.sd[:42]).max() < 5


def test_too_few_readings(tmp_path):
    made, _ = tumble()
    said = refused("tumble.too_short", "45 readings of three accelerometers are left; 45 unknowns "
                   "want more of them.", rows(PUBLISHED_LOG, slice(0, 46)))  # fmt: skip
    assert "Log the whole tumble; check `mask_edges`, gaps and saturated readings." in said
    lost = PUBLISHED_LOG.accel.copy()
    lost[20:] = np.nan
    refused("tumble.too_short", "19 readings", replace(PUBLISHED_LOG, accel=lost))
    masked = campaign_of(PUBLISHED + '\nmask_edges = "2000 s"')
    refused("tumble.too_short", "0 readings", PUBLISHED_LOG, masked)
    # Enough to go on, not enough to tell much: the prior stays, and nothing is none.
    result = calibrate(made, rows(PUBLISHED_LOG, slice(0, 60)))
    saved(result, tmp_path)
    known, before = result.coefficients.sd[:42], result.coefficients.prior_sd[:42].copy()
    gravity = made.site.gravity_sd / made.site.gravity
    before[CONSTANTS.group("accel.scale")] = np.hypot(
        before[CONSTANTS.group("accel.scale")], gravity
    )
    assert np.all(known <= before * (1 + 1e-3))


# -- start -----------------------------------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("start", "angle"),
    [
        (("0 deg", "180 deg", "0 deg"), 177), (("0 deg", "90 deg", "0 deg"), 87.1),
        (("0 deg", "-90 deg", "0 deg"), 93.1), (("30 deg", "0 deg", "0 deg"), 28.6),
        (("0 deg", "-20 deg", "-15 deg"), 30.7),
    ],
)  # fmt: skip
def test_a_start_that_is_far_off(start, angle):
    listed = ", ".join(f'"{a}"' for a in start)
    made = campaign_of(PUBLISHED + f"\nstart = [{listed}]")
    truth = tumble()[1].truth
    result = calibrate(made, PUBLISHED_LOG, trial=True)
    said = told(result, "tumble.start")
    assert float(said.split("began ")[1].split(" deg")[0]) == pytest.approx(angle, abs=0.3)
    assert "at outer 2.01, middle 2.99, inner 5.02 deg" in said
    assert "correct `start`, or give a larger start_sd and azimuth_sd" in said
    assert result.status is Status.CONVERGED
    assert [c.name for c in result.checks if not c.passed and c.name == "start"] == ["start"]
    # It is found all the same; what was said of it pulls the azimuth only.
    miss = (result.coefficients.values - truth.values)[:42] / result.coefficients.sd[:42]
    assert np.abs(miss).max() < 6


def test_a_start_that_is_upside_down():
    made = campaign_of(PUBLISHED + '\nstart = ["180 deg", "0 deg", "0 deg"]')
    said = refused("tumble.sign", "deg away from where `start` puts up", PUBLISHED_LOG, made)
    assert "or correct `start`, or the signs of the columns" in said


# -- noise and numbers -----------------------------------------------------------------------------


def test_noise_that_was_not_declared():
    made, _ = tumble()
    result = calibrate(made, PUBLISHED_LOG, trial=True, noise=None)
    said = told(result, "tumble.measured")
    assert said.endswith("was measured in the log itself. Give it in [noise.accel] if it is known.")
    white = float(said.split("accelerometers, ")[1].split(" ug")[0])
    assert white == pytest.approx(0.4472, rel=0.03)
    assert told(result, "tumble.noise").startswith(
        "[noise] does not say the white noise of the gyros, which the log cannot show; 3.73e-05 "
        "deg/sqrt(h) was taken. Give it in [noise.gyro]"
    )
    assert result.verdict.level is Level.PASS


def test_slow_noise_is_counted_and_not_weighed():
    made, _ = tumble()
    drifting = TriadNoise(white=made.noise.gyro.white, random_walk=1e-10)
    result = calibrate(made, PUBLISHED_LOG, trial=True, noise=ImuNoise(made.noise.accel, drifting))
    said = told(result, "tumble.slow_noise")
    assert said.startswith("[noise] declares a bias instability or a random walk. The estimate")
    assert "Slow noise that is not declared cannot be seen in the residuals" in said
    plain = calibrate(made, PUBLISHED_LOG, trial=True)
    assert "tumble.slow_noise" not in codes(plain)
    assert "tumble.white" not in codes(result)
    assert told(plain, "tumble.white").startswith(
        "No slow noise is known: biases of accelerometers and drifts of gyros were taken to stand "
        "still for 90 minutes. Give bias_instability or random_walk in [noise.accel]"
    )
    assert (result.coefficients.sd >= plain.coefficients.sd).all()
    assert result.coefficients.sd[0] > 1.1 * plain.coefficients.sd[0]


def test_averages_in_which_the_cluster_turns_too_far():
    made, session = tumble(FAST + '\naverage = "4 s"')
    result = calibrate(made, session.simulation.log, trial=True)
    assert told(result, "tumble.average") == (
        "Over 4 s the cluster turns by 20 deg; residuals are averaged over 0.8 s. Nothing to do; "
        "set `average` to 0.8 s to say so."
    )


def test_a_motion_that_shows_little():
    made, session = tumble('plan = "-x"\nsegment = "300 s"')
    said = told(calibrate(made, session.simulation.log, trial=True), "tumble.unseen")
    count = int(said.split(" ")[0])
    assert 10 < count < 42
    assert said.split(": ")[1].split(" and ")[0].count(", ") == 7
    assert f" and {count - 8} more. Turn the cluster through more orientations" in said
    assert "tumble.unseen" not in codes(calibrate(tumble()[0], PUBLISHED_LOG, trial=True))


def test_an_azimuth_that_is_hardly_known():
    made, session = tumble('plan = "-x"\nsegment = "300 s"\nazimuth_sd = "40 deg"')
    said = told(calibrate(made, session.simulation.log, trial=True), "tumble.azimuth")
    assert said.startswith("The azimuth at the end is known to ")
    assert float(said.split("known to ")[1].split(" deg")[0]) > 0.5
    assert "Tell the start better (`start`, `azimuth_sd`), or turn longer" in said
    assert "tumble.azimuth" not in codes(calibrate(tumble()[0], PUBLISHED_LOG, trial=True))


def test_a_final_attitude_that_is_singular():
    plan = 'plan = "-x +y"\nrate = "1 deg/s"\nsegment = "90 s"'
    start = 'start = ["90 deg", "0 deg", "0 deg"]'
    made, session = tumble(f"{plan}\n{start}", 'attitude = ["0 deg", "0 deg", "0 deg"]')
    result = calibrate(made, session.simulation.log, trial=True)
    said = told(result, "tumble.singular")
    middle = float(said.split("angle is ")[1].split(" deg")[0])
    assert abs(middle) == pytest.approx(90, abs=1.2)
    assert "Take attitude matrix and covariance from `diagnostics` of result.json" in said
    C_pn = np.array(result.diagnostics["attitude"]["C_pn"])
    np.testing.assert_allclose(C_pn, session.simulation.C_pn[1], atol=2e-3)


def test_priors_so_wide_that_squares_lose_digits():
    made, session = tumble('plan = "-x"\nsegment = "300 s"')
    wide = {name: (mean, 1e5 * sd) for name, (mean, sd) in PRIOR.items()}
    result = calibrate(made, session.simulation.log, trial=True, prior=wide)
    assert told(result, "tumble.condition").endswith("without squares, which takes longer.")
    usual = calibrate(made, session.simulation.log, trial=True)
    assert "tumble.condition" not in codes(usual)


@pytest.mark.thorough  # compiles a filter that nothing else needs
def test_published_filters_say_what_they_are():
    made = campaign_of(PUBLISHED + '\nfilter = "published"')
    said = told(calibrate(made, PUBLISHED_LOG, trial=True), "tumble.filter")
    assert said.startswith("The result is that of the published filter. ")
    assert 'filter = "gauss-newton" comes to the bound' in said


def test_a_published_filter_knows_no_delay():
    free = campaign_of(PUBLISHED + '\nfilter = "published"\ndelay_sd = "0.1 s"')
    refused("tumble.filter_delay", "delay_sd is above 0, and the delay is not among the states of "
            'the published filter. Take filter = "gauss-newton"', PUBLISHED_LOG, free)  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("passes", [1, 2])
def test_a_run_that_was_stopped_early(passes, tmp_path):
    made = campaign_of(PUBLISHED + f"\npasses = {passes}")
    result = calibrate(made, PUBLISHED_LOG)
    assert result.status is Status.NOT_CONVERGED
    assert result.verdict.level is Level.UNUSABLE
    assert "did not settle" in next(c for c in result.checks if c.name == "converged").sentence
    saved(result, tmp_path)


@pytest.mark.thorough
@pytest.mark.parametrize("spoilt", ["too fast", "shifted", "rolled"])
def test_a_run_that_leads_nowhere_says_so(spoilt, tmp_path):
    """Status and advice, and no number that is none."""
    made, log = tumble()[0], PUBLISHED_LOG
    wrong = {
        "too fast": replace(log, gyro=1.1 * log.gyro),
        "shifted": replace(log, gyro=np.roll(log.gyro, 150, axis=0)),
        "rolled": replace(log, accel=np.roll(log.accel, 9000, axis=0)),
    }[spoilt]
    result = calibrate(made, wrong)
    assert result.verdict.level is not Level.PASS
    assert result.verdict.reasons
    saved(result, tmp_path)


# -- no alarm where nothing is wrong ---------------------------------------------------------------

GOOD = [
    (plan, how, place)
    for (plan, how), place in zip(
        product(
            (
                'plan = "published"\naverage = "5 s"',
                'plan = "-x -z -y +z"\nrate = "2 deg/s"\nsegment = "60 s"\npasses = 20', SLOW,
                'plan = "+x +y +z -x -y -z"\nrate = "1 deg/s"\nsegment = "90 s"\npasses = 20',
                'plan = "+y -y"\nrate = "2 deg/s"\nsegment = "90 s"\npasses = 20',
                'plan = "-x +z +y"\nrate = "0.5 deg/s"\nsegment = "200 s"\nramp = "10 s"\n'
                "passes = 20",
            ),
            (
                'interval = "0.2 s"', 'interval = "1 s"\nkind = "increment"',
                'interval = "2 s"\ncommand_interval = "2 s"', 'interval = "0.25 s"',
                'interval = "0.5 s"\nkind = "increment"\ncommand_interval = "2 s"',
            ),
        ),
        ("-78 deg", "0 deg", "48 deg", "65 deg", "-33 deg", "20 deg") * 5,
        strict=True,
    )
]  # fmt: skip


@pytest.fixture(scope="module")
def good():
    """30 sessions in which nothing is wrong, the command held both ways."""
    out = []
    for k, (plan, how, latitude) in enumerate(GOOD):
        holds = ("from its time", "until its time")[k % 2]
        words = f'{plan}\ncommand_holds = "{holds}"'
        made, session = tumble(words, how, seed=k, latitude=f'"{latitude}"')
        out.append((calibrate(made, session.simulation.log, trial=True), session))
    return out


def test_good_sessions_raise_no_alarm(good):
    """Input checks know no chance but the noise; those of the fit have one in ten thousand."""
    about = {f"tumble.{word}" for word in ("motion", "delay", "start", "plan_time", "plan_other",
                                           "gap", "held")}  # fmt: skip
    alarms = [(k, f.message) for k, (r, _) in enumerate(good) for f in r.findings
              if f.code in about]  # fmt: skip
    assert alarms == []


def test_good_sessions_pass(good):
    """Of 30 results at a false-alarm rate of 1 % for each kind of check."""
    statuses = [result.status for result, _ in good]
    assert statuses == [Status.CONVERGED] * len(good)
    # Some of the plans are short: they do not show everything, and say so.
    doubtful = [[c.name for c in r.checks if not c.passed and c.name != "seen"] for r, _ in good]
    failed = sum(bool(names) for names in doubtful)
    assert failed <= stats.binom.ppf(0.99, len(good), 0.02), doubtful
    score = [
        z @ z for r, s in good
        for z in [np.linalg.solve(np.linalg.cholesky(r.coefficients.cov[:42, :42]),
                                  (r.coefficients.values - s.truth.values)[:42])]
    ]  # fmt: skip
    low, high = stats.chi2.ppf([0.005, 0.995], 42 * len(good))
    assert low < sum(score) < high


def test_a_command_relative_to_the_ground():
    """Open-loop commands hold the Earth's rate; a log without it is named."""
    made, session = tumble()
    log = session.simulation.log
    relative = np.repeat(nominal(PUBLISHED_PLAN, made.site.latitude).rate, 5, axis=0)
    wrong = replace(log, gyro=np.concatenate([relative, relative[-1:]]))
    result = calibrate(made, wrong, trial=True)
    said = told(result, "tumble.relative")
    assert "if the command is taken relative to the ground" in said
    assert "Log the rate relative to inertial space" in said
    assert result.verdict.level is not Level.PASS


def test_readings_at_the_declared_limit_are_missing_ones(tmp_path):
    session = tumble()[1]
    file = save_session(session, tmp_path)
    text = file.read_text().replace('unit = "m/s^2" }', 'unit = "m/s^2", saturation = 9.79 }')
    assert "saturation" in text
    file.write_text(text)
    described = foucault.load_campaign(file)
    log = read_log(described)
    clipped = (np.abs(session.simulation.log.accel) > 9.79).any(axis=1)
    assert 100 < clipped.sum() < len(clipped)
    np.testing.assert_array_equal(np.isnan(log.accel).any(axis=1), clipped)


def test_few_coefficients_seen_is_no_pass():
    made, session = tumble('plan = "-x"\nsegment = "60 s"')
    result = calibrate(made, session.simulation.log, trial=True)
    (check,) = [c for c in result.checks if c.name == "seen"]
    assert not check.passed
    assert "the others are known hardly better than before" in check.sentence
