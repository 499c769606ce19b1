"""What people get wrong when they seek north, and what they are told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault import campaign
from foucault.diagnose.north import alive
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.north_seeker import RATE_LEVEL, RATE_TILTED, Compensation
from foucault.procedures.north_seeking import Session, Settings, calibrate, simulate
from foucault.procedures.north_seeking.fix import find_north
from foucault.result import Level
from foucault.simulate.north import NorthPlan, Placement, Rotation, simulate_north
from foucault.tables import IndexedLog
from make_dwells import (
    DEG_H,
    FIELD,
    FOUR,
    PALINDROME,
    attitudes,
    errors,
    leaning,
    level,
    make_dwells,
    make_log,
    size,
    turn,
)
from refusals import refuses

LATITUDE = np.radians(47.3)
SITE = Site.at(LATITUDE)
POSES = attitudes(12, 10.0)
TILTED = leaning(8.0, -8.0, 0.0)
DEG = np.radians(1.0)
NOISY = {"noise": FIELD, "dwell": 90.0, "offset": 2e-6}
EXACT = Settings(accel_bias_sd=0.0, accel_scale_sd=0.0, accel_misalignment_sd=0.0)


def readings(poses=POSES, **words):
    return make_dwells(poses, LATITUDE, **(NOISY | words))


def fix(dwells, settings=EXACT, noise=FIELD, site=SITE, **words):
    survey = find_north(make_log(dwells), site=site, settings=settings, noise=noise, **words)
    assert [list(Level)[k] for k in survey.levels] == [v.level for v in survey.verdicts]
    return survey


def table(poses=None, instrument=None, **words):
    poses = level(12) if poses is None else poses
    return readings(poses, instrument=instrument, headings=poses[:, 0], **words)


def calibration(dwells, settings=None, noise=FIELD, site=SITE, **words):
    return calibrate(make_log(dwells), site=site, settings=settings, noise=noise, **words)


def turned(dwells, angle):
    """The same with other index angles said."""
    angle = np.asarray(angle)
    return replace(dwells, index=angle % (2 * np.pi), cosine=np.cos(angle), sine=np.sin(angle))


def without(dwells, *rows):
    return dwells.rows(np.delete(np.arange(len(dwells)), rows))


def refused(code, text, function, *args, **words):
    with refuses(code) as caught:
        function(*args, **words)
    assert text in str(caught.value)
    return str(caught.value)


def told(findings, code):
    some = [f for f in findings if f.code == code]
    assert some, [f.code for f in findings]
    return f"{some[0].message} {some[0].cure}"


# -- the place ------------------------------------------------------------------------------------


@pytest.mark.parametrize("latitude", [89.01, -89.5, 90.0])
def test_a_latitude_too_near_to_a_pole(latitude):
    site = replace(SITE, latitude=latitude * DEG)
    for function, dwells in ((fix, readings()), (calibration, table())):
        said = refused("north.latitude", f"The latitude is {latitude:.4f} deg", function, dwells,
                       site=site)  # fmt: skip
        assert "beyond +-89 deg" in said and "GNSS" in said
    fix(readings(), site=replace(SITE, latitude=88.99 * DEG))


def test_no_latitude():
    site = replace(SITE, latitude=None)
    said = refused("north.fix_latitude", "The latitude is not given.", fix, readings(), site=site)
    assert "unknown_latitude = true" in said
    said = refused("north.calibration_latitude", "rate at the turntable is not known", calibration,
                   table(), site=site)  # fmt: skip
    assert "[site]" in said


def test_the_hemisphere_is_assumed():
    found = fix(readings(), replace_settings(unknown_latitude=True)).findings
    assert told(found, "north.hemisphere").startswith(
        "Without latitude the hemisphere was taken as north. If it is not, say so: --hemisphere "
        'south, or hemisphere = "south"'
    )
    south = fix(readings(), replace_settings(unknown_latitude=True, hemisphere="south"))
    assert not [f for f in south.findings if f.code == "north.hemisphere"]


def replace_settings(**words):
    return EXACT.model_copy(update=words)


# -- the stops ------------------------------------------------------------------------------------


@pytest.mark.parametrize("stops", [(0.0, 180.0), (90.0, 270.0), (40.0,), (0.0, 90.0), (0.0, 1.0)])
def test_index_angles_that_do_not_span(stops):
    words = ", ".join(f"{s:.0f}" for s in stops)
    said = refused("north.stops", f"stops at {words} deg", fix, readings(stops=stops))
    assert "'S1 and 11 more'" in said and "--near" in said
    refused("north.stops", f"stops at {words} deg", calibration, table(stops=stops))


def test_two_stops_leave_the_tilt_to_one_accelerometer_unseen():
    dwells = readings(POSES[:1], stops=(90.0, 270.0))
    said = refused("north.stops_tilt", "sees the tilt in one direction only", fix, dwells,
                   replace_settings(near=0.2))  # fmt: skip
    assert "stops at 90, 270 deg" in said and "level_sd" in said
    fix(dwells, replace_settings(near=0.2, level_sd=0.01))


def test_a_stop_is_missing():
    found = fix(without(readings(), 7)).findings
    said = told(found, "north.opposite_missing")
    assert said.startswith("In set-up 'S2' the stop at 90 deg has no opposite one")
    assert said.endswith("Add the stop at 270 deg.")
    said = told(found, "north.stops_differ")
    assert "'S2' has 3 stops (0, 180, 90 deg); most have 4" in said
    found = calibration(without(table(), 7)).findings
    told(found, "north.opposite_missing")
    told(found, "north.stops_differ")


def test_three_even_stops_are_named_once():
    found = fix(readings(stops=(0.0, 120.0, 240.0))).findings
    assert [f.code for f in found].count("north.opposite_missing") == 1
    assert "'S1 and 11 more'" in told(found, "north.opposite_missing")


def test_a_stop_is_repeated():
    dwells = readings()
    index = dwells.index.copy()
    index[5] = index[4]
    survey = fix(turned(dwells, index))
    said = told(survey.findings, "north.stop_repeated")
    assert "In set-up 'S2' the base stopped twice running at 0 deg" in said
    assert "the other stops were 90, 270 deg" in said
    assert survey.verdicts[1].level is not Level.PASS
    assert survey.verdicts[0].level is Level.PASS


def test_means_that_overlap():
    """Hours taken for seconds; the set-ups are solved, a drift would be wrong."""
    dwells = readings()
    found = fix(replace(dwells, start=dwells.start / 3600)).findings
    said = told(found, "north.overlap")
    assert "'S1' a mean over 90 s is followed by the next after 0.02639 s" in said
    assert "units of time and dwell" in said
    assert "north.overlap" in [f.code for f in calibration(
        replace(table(), start=dwells.start / 3600)).findings]  # fmt: skip


def test_a_palindrome_is_no_repetition():
    found = fix(readings(stops=PALINDROME)).findings
    assert {f.code for f in found} == {"north.no_calibration"}
    assert "the uncertainty knows nothing of them" in told(found, "north.no_calibration")


# -- the readings ----------------------------------------------------------------------------------


@pytest.mark.parametrize("factor", [3600.0, 57.3])
def test_a_gyro_in_a_unit_that_is_too_large(factor):
    dwells = readings()
    said = refused("north.too_fast", "times the Earth's rate", fix,
                   replace(dwells, gyro=factor * dwells.gyro))  # fmt: skip
    assert "deg/s for deg/h is a factor of 3600" in said
    on_table = table()
    said = refused("north.gyro_scale", f"The gyro says {factor:.4g}"[:20], calibration,
                   replace(on_table, gyro=factor * on_table.gyro))  # fmt: skip
    assert "deg/s for deg/h is a factor of 3600" in said


def test_a_gyro_in_a_unit_that_is_too_small():
    on_table = table()
    refused("north.gyro_scale", "The gyro says 0.0002778 times", calibration,
            replace(on_table, gyro=on_table.gyro / 3600))  # fmt: skip


def test_more_than_gravity():
    dwells = readings()
    said = refused("north.tilt", "up to 90 deg of tilt it is less than 1", fix,
                   replace(dwells, accel=9.80665 * dwells.accel))  # fmt: skip
    assert "unit and scale of the accelerometer" in said
    # At 90 deg exactly it is a check, not an error: heading is not defined.
    survey = fix(readings(np.array([[1.0, np.pi / 2, 0.0], [1.0, 0.0, 0.0]])))
    check = next(c for c in survey.checks[0] if c.name == "tilt")
    assert not check.passed and "heading is hardly defined there" in check.sentence
    assert survey.verdicts[0].level is not Level.PASS
    assert survey.fixes.sd[0, 0] > 20 * survey.fixes.sd[1, 0]


def test_no_accelerometers():
    for function, dwells in ((fix, readings(level(), accel=None)),
                             (calibration, table(accel=None))):  # fmt: skip
        said = refused(
            "north.level_sd", "a tilt of 1 arcmin about the north axis", function, dwells
        )
        assert '--level-sd "1 arcmin"' in said
    refused("north.tilt_unknown", "needs accelerometers, which the log has not", calibration,
            table(accel=None), Settings(tilt="each"))  # fmt: skip


@pytest.mark.parametrize("sensor", ["gyro", "accel"])
def test_a_reading_that_is_no_number(sensor):
    dwells = table()
    value = getattr(dwells, sensor).copy()
    value[21] = np.nan
    said = refused("north.not_a_number", "'S6' has a reading that is not a number", calibration,
                   replace(dwells, **{sensor: value}))  # fmt: skip
    assert "take the set-up out" in said
    # In the field the others are solved.
    survey = fix(replace(dwells, heading=np.full(12, np.nan), **{sensor: value}))
    levels = [v.level for v in survey.verdicts]
    assert levels[5] is Level.UNUSABLE and levels.count(Level.PASS) == 11
    (check,) = survey.checks[5]
    assert (check.name, check.sentence) == ("solved", "A reading is not a finite number.")


@pytest.mark.parametrize("mistake", ["typed twice", "typed wrong", "exchanged"])
@pytest.mark.parametrize("stops", [FOUR, PALINDROME])
def test_one_reading_that_is_wrong_does_not_pass(mistake, stops):
    dwells = readings(stops=stops, dwell=120.0)
    gyro = dwells.gyro.copy()
    k = len(stops)
    a, b = k, k + 1
    gyro[b] = {"typed twice": gyro[a], "typed wrong": gyro[b] + 0.5 * DEG_H, "exchanged": gyro[a]}[
        mistake
    ]
    if mistake == "exchanged":
        gyro[a] = dwells.gyro[b]
    survey = fix(replace(dwells, gyro=gyro))
    assert survey.verdicts[1].level is not Level.PASS
    assert [v.level for v in survey.verdicts].count(Level.PASS) >= 10


def test_the_reading_that_stands_out_is_named():
    dwells = readings(stops=PALINDROME)
    gyro = dwells.gyro.copy()
    gyro[10] += 0.8 * DEG_H
    survey = fix(replace(dwells, gyro=gyro))
    said = told(survey.setup_findings[1], "north.reading_outlier")
    assert "'S2' the reading at index angle 90.0 deg is" in said and "disturbance" in said
    assert not survey.setup_findings[0]


def test_noise_that_nobody_knows():
    few = readings(POSES[:1])
    said = refused("north.noise_unknown", "too few readings to measure it", fix, few, noise=None)
    assert "--gyro-noise" in said and "--accel-noise" in said and "foucault allan" in said
    heads = level(3)
    three = table(heads, stops=(0.0, 120.0, 240.0))
    said = refused("north.noise_unknown", "[noise] in the campaign file", calibration, three,
                   noise=None)  # fmt: skip


def test_more_rate_than_the_earths_is_clamped_and_flagged():
    dwells = make_dwells(level(4), 0.02, noise=FIELD)
    survey = fix(replace(dwells, gyro=1.01 * dwells.gyro), replace_settings(unknown_latitude=True))
    said = told(survey.setup_findings[0], "north.clamped")
    assert "are 1.0" in said and "the rate along z was taken as zero" in said
    assert "dwell longer" in said


def test_two_headings_that_fit():
    dwells = make_dwells([[1.0, 0.2, 0.1]], 0.05, noise=FIELD, dwell=600.0)
    survey = fix(dwells, replace_settings(unknown_latitude=True))
    said = told(survey.setup_findings[0], "north.ambiguous")
    assert "Set-up 'S1': heading " in said and "fits as well" in said
    other = float(said.split("heading ")[1].split(" deg")[0]) * DEG
    assert [c.name for c in survey.checks[0] if not c.passed] == ["one heading"]
    both = [abs(turn(x, 1.0)) for x in (other, survey.fixes.angles[0, 0])]
    assert min(both) < 5e-3


# -- too short, too noisy --------------------------------------------------------------------------


def test_dwells_too_short_say_how_long():
    """Dwelling as long as is said does it; a tenth less does not."""
    wanted = 0.05 * DEG
    settings = replace_settings(accuracy=wanted)
    short = fix(readings(POSES[:1]), settings)
    said = told(short.setup_findings[0], "north.dwell_short")
    assert "0.05 deg was wanted" in said
    needed = float(said.split("Dwell at least ")[1].split(" s")[0])
    assert needed > 90.0
    for share, enough in ((1.02, True), (0.9, False)):
        survey = fix(readings(POSES[:1], dwell=share * needed), settings)
        assert (survey.fixes.sd[0, 0] <= wanted) == enough
        assert (
            bool([f for f in survey.setup_findings[0] if f.code == "north.dwell_short"]) != enough
        )


def test_longer_dwells_do_not_help_against_other_sources():
    settings = replace_settings(accuracy=0.05 * DEG, index_sd=0.2 * DEG)
    said = told(fix(readings(POSES[:1]), settings).setup_findings[0], "north.dwell_short")
    assert "Longer dwells do not help" in said and "most of all 'indexing'" in said


# -- the calibration in the field ------------------------------------------------------------------


def test_the_calibration_of_another_instrument():
    good = calibration(table(), instrument={"serial": "12"})
    said = refused("north.other_serial", "readings are of instrument 13, the calibration is of 12",
                   fix, readings(), calibration=good, instrument={"serial": "13"})  # fmt: skip
    assert "correct the serial number" in said
    for mine in ({"serial": "12"}, {"serial": ""}, None):
        fix(readings(), calibration=good, instrument=mine)
    other = replace(good, procedure="six_position", provenance={"file": "result.json"})
    refused("north.other_result", "'result.json' is a result of six_position", fix, readings(),
            calibration=other)  # fmt: skip


def test_a_calibration_that_did_not_pass():
    dwells = table()
    heading = dwells.heading.copy()
    heading[3] += 2 * DEG
    bad = calibration(replace(dwells, heading=heading))
    assert bad.verdict.level is Level.DOUBTFUL
    said = told(bad.findings, "north.heading_outlier")
    assert said.startswith("Set-up 'S4' is") and "check its heading" in said
    survey = fix(readings(), calibration=bad)
    assert told(survey.findings, "north.calibration_doubtful").startswith(
        f"The calibration is doubtful: {bad.verdict.reasons[0]}"
    )


def test_stops_that_were_not_calibrated():
    good = calibration(table())
    survey = fix(readings(stops=(0.0, 120.0, 240.0)), calibration=good)
    said = told(survey.findings, "north.other_stops")
    assert "with stops at 0, 90, 180, 270 deg; here the base stops at 120, 240 deg" in said
    assert "north.other_stops" not in [f.code for f in fix(readings(), calibration=good).findings]


def test_another_temperature_than_that_of_the_calibration():
    warm, cold = (replace(make_log(d), temperature=np.full(48, 273.15 + c))
                  for d, c in ((table(), 21.0), (readings(), -7.0)))  # fmt: skip
    good = calibrate(warm, site=SITE, noise=FIELD)
    survey = find_north(cold, site=SITE, noise=FIELD, calibration=good)
    said = told(survey.findings, "north.other_temperature")
    assert said.startswith("Here it is -7 degC; the calibration was made at 21 degC")
    same = replace(cold, temperature=warm.temperature)
    codes = [f.code for f in find_north(same, site=SITE, noise=FIELD, calibration=good).findings]
    assert "north.other_temperature" not in codes


def test_a_heading_that_contradicts_its_reference():
    heading = POSES[:, 0].copy()
    heading[3] += 1.5 * DEG
    survey = fix(readings(headings=heading))
    said = told(survey.setup_findings[3], "north.reference")
    away = float(said.split("the heading is ")[1].split(" deg")[0])
    assert said.startswith("In set-up 'S4'") and away == pytest.approx(-1.5, abs=0.3)
    assert not any(survey.setup_findings[k] for k in range(12) if k != 3)


# -- the table -------------------------------------------------------------------------------------


def test_no_reference_headings():
    said = refused("north.no_heading", "no reference headings", calibration, readings(level()))
    assert "clockwise from north" in said


def test_a_reference_heading_is_missing():
    dwells = table()
    heading = dwells.heading.copy()
    heading[[2, 7]] = np.nan
    said = refused("north.heading_missing", "The set-ups 'S3', 'S8' have no reference heading",
                   calibration, replace(dwells, heading=heading))  # fmt: skip
    assert "take the rows out" in said


@pytest.mark.parametrize("mirrored", ["headings", "index"])
def test_headings_or_index_angles_the_other_way_round(mirrored):
    dwells = table()
    wrong = replace(dwells, heading=-dwells.heading) if mirrored == "headings" else turned(
        dwells, -dwells.index)  # fmt: skip
    said = refused("north.sense", "as in a mirror", calibration, wrong)
    assert "Correct sense in [log.index]" in said and "or their unit" in said


@pytest.mark.parametrize("angle", [90.0, -30.0, 180.0])
def test_an_index_zero_that_is_not_forward(angle):
    dwells = table()
    said = refused("north.index_zero", f"is {angle:.1f} deg" if angle < 180 else "180.0 deg",
                   calibration, turned(dwells, dwells.index - angle * DEG))  # fmt: skip
    assert "zero =" in said
    # All headings off by as much looks alike, and is a mistake of 5 deg too, but a smaller one.
    few = calibration(replace(dwells, heading=dwells.heading - 5 * DEG))
    assert "is 4.99 deg" in told(few.findings, "north.turned")
    assert not [f for f in calibration(dwells).findings if f.code == "north.turned"]


def test_a_latitude_that_makes_scale_factors_of_percents_is_no_pass():
    wrong = calibration(table(), site=Site.at(LATITUDE + 1.5 * DEG))
    said = told(wrong.findings, "north.scale_common")
    assert "as if the latitude were 47.3 deg" in said and "+3 %" in said
    assert wrong.verdict.level is Level.DOUBTFUL, "no residual shows it, but its size does"
    assert any(said in reason for reason in wrong.verdict.reasons)


def test_a_bias_that_may_be_a_tilt():
    askew = table(level() + np.array([0.0, 0.3 * DEG, 0.0]))
    said = told(calibration(askew, Settings(tilt="one axis")).findings, "north.wedge")
    assert (
        "read 5.2 mg that turn with the case" in said and "askew on the table by 18 arcmin" in said
    )
    assert "north.wedge" not in [f.code for f in calibration(table()).findings]


def test_headings_that_do_not_determine_it():
    said = refused("north.undetermined", "These headings do not show: ", calibration,
                   table(level(12)[:1]))  # fmt: skip
    assert "at least three headings" in said
    assert "show: ." not in said


def test_a_latitude_of_the_wrong_sign_is_named_by_tilts():
    text = campaign.template("north_seeking").partition("# [optimise]")[0]
    told = campaign.parse(text.replace('tilts = ["0 deg"]', 'tilts = ["0 deg", "10 deg"]'))
    log = campaign.simulate(told, 1).simulation.log
    there = replace(told.site, latitude=-told.site.latitude)
    with refuses("north.tilts_contradict", "sign of latitude", "senses acceleration"):
        calibrate(log, site=there, settings=told.settings, noise=told.noise, sizes=told.sizes)


def test_tilts_that_are_none():
    session = Session(tilts=("95 deg",))
    with refuses("north.tilt_plan", "The tilts of the plan are 95 deg"):
        simulate(session, model=Compensation().model, noise=FIELD, site=SITE, seed=1)


def test_the_coupling_of_the_third_rate():
    strong = errors(RATE_TILTED, seed=3)
    values = strong.coefficients.values.copy()
    values[strong.coefficients.names.index("gyro.misalignment.xz")] = 10 * size(
        "gyro.misalignment.xz"
    )
    strong = Compensation(replace(strong.coefficients, values=values))
    dwells = table(TILTED, strong, dwell=400.0)
    said = told(calibration(dwells, Settings(z_coupling="no")).findings, "north.z_left_out")
    assert 'Write z_coupling = "auto"' in said
    none = table(TILTED, errors(RATE_LEVEL, seed=3), dwell=400.0)
    said = told(calibration(none, Settings(z_coupling="free")).findings, "north.z_not_seen")
    assert "is not significant" in said
    for choice in ("auto", "free"):
        codes = [f.code for f in calibration(dwells, Settings(z_coupling=choice)).findings]
        assert not {"north.z_left_out", "north.z_not_seen"} & set(codes)


# -- settings --------------------------------------------------------------------------------------


def test_a_turning_base_says_what_a_late_index_angle_does():
    plan = NorthPlan((Placement("1", 0.3),), Rotation(3, np.radians(6.0)))
    log = simulate_north(plan, model=ImuModel(), noise=ImuNoise(), site=SITE, reference=False,
                         rows="samples", rate=1.0).log  # fmt: skip
    noise = ImuNoise(TriadNoise(1e-4), TriadNoise(1e-6))
    late = find_north(log, site=SITE, noise=noise)
    said = told(late.findings, "north.index_lag")
    assert "turns at 6 deg/s" in said and "off by 3 deg" in said
    known = find_north(log, site=SITE, noise=noise, settings=Settings(index_lag_sd=0.1))
    assert "north.index_lag" not in {f.code for f in known.findings}
    lag = np.sqrt(known.fixes.sources["indexing"][0, 0])
    np.testing.assert_allclose(lag, np.radians(0.6), rtol=0.02)


def test_settings_that_contradict_one_another():
    said = refused("north.contradiction", "", Settings, drift="none", drift_sd=1e-9)
    assert said == 'Given are drift = "none" and drift_sd. Leave one of them out.'
    said = refused("north.offset_alone", "gyro_offset_sd", Settings,
                   gyro_offset=1e-6)  # fmt: skip
    assert "or leave it out" in said


def test_a_heading_far_from_the_rough_one():
    far, near = (
        fix(readings(POSES[:1]), replace_settings(near=POSES[0, 0] + off)) for off in (2.0, 0.3)
    )
    said = told(far.setup_findings[0], "north.far")
    assert "In set-up 'S1' the heading is 115 deg from the rough one" in said
    assert not near.setup_findings[0]


# -- what does not fit the latitude ----------------------------------------------------------------


def exchanged(dwells):
    return replace(dwells, accel=dwells.accel[:, ::-1])


MISTAKES = {
    "gravity": (lambda d: replace(d, accel=-d.accel), "base", "have the other sign, `reads`"),
    "sign": (lambda d: replace(d, gyro=-d.gyro), "case", "the gyro has the other sign"),
    "exchanged": (exchanged, "case", "the two accelerometers are exchanged"),
    "sense": (lambda d: turned(d, -d.index), "case", 'sense = "counter-clockwise"'),
    "zero 90": (lambda d: turned(d, d.index + np.pi / 2), "case", 'zero = "90 deg"'),
    "zero 180": (lambda d: turned(d, d.index + np.pi), "case", 'zero = "180 deg"'),
    "zero 270": (lambda d: turned(d, d.index - np.pi / 2), "case", 'zero = "270 deg"'),
    "g": (lambda d: replace(d, accel=d.accel / 9.80665), "base", "in g where m/s^2 is said"),
    "deg/s": (lambda d: replace(d, gyro=d.gyro / 3600), "base", "in deg/s where deg/h is said"),
    "rad/s": (lambda d: replace(d, gyro=d.gyro * DEG), "base", "in rad/s where deg/s is said"),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_that_the_latitude_shows_is_named(mistake):
    change, accel, words = MISTAKES[mistake]
    right = readings(accel=accel)
    wrong = change(right)
    survey = fix(wrong)
    said = told(survey.findings, "north.misfit")
    assert words in said and "Rate, gravity and latitude contradict one another" in said
    assert all(v.level is not Level.PASS for v in survey.verdicts)
    # Headings change by as much as is said where it is the only explanation.
    if said.count("; or ") == 0:
        change = np.abs(turn(survey.fixes.angles[:, 0], POSES[:, 0])).max()
        assert float(said.split("by up to ")[1].split(" deg")[0]) == pytest.approx(
            np.degrees(change), rel=0.1
        )
    assert not [f for f in fix(right).findings if f.code == "north.misfit"]


def test_a_sign_is_noticed_in_every_set_up_that_is_tilted():
    """10 deg of tilt and a usual gyro: the sign of the accelerometer does not pass once."""
    dwells = readings()
    survey = fix(replace(dwells, accel=-dwells.accel))
    for checks in survey.checks:
        assert not next(c for c in checks if c.name == "rate and latitude").passed
    # Level, gravity and specific force are alike: nothing shows it, and nothing depends on it.
    flat = readings(level() + 1e-4)
    wrong = fix(replace(flat, accel=-flat.accel))
    assert not [f for f in wrong.findings if f.code == "north.misfit"]
    assert (np.abs(turn(wrong.fixes.angles[:, 0], level()[:, 0])) < 5 * wrong.fixes.sd[:, 0]).all()


def test_another_latitude_is_named_with_its_value():
    survey = fix(readings(dwell=600.0), site=Site.at(LATITUDE - 2 * DEG))
    said = told(survey.findings, "north.misfit")
    assert "the latitude is 47.299 deg, or the gyro says 0.9642 times the rate" in said
    assert np.cos(LATITUDE) / np.cos(LATITUDE - 2 * DEG) == pytest.approx(0.9642, abs=1e-4)
    south = told(fix(readings(), site=Site.at(-LATITUDE)).findings, "north.misfit")
    assert "the latitude has the other sign" in south


def test_one_wrong_reading_is_not_taken_for_a_mistake_of_all():
    dwells = readings()
    gyro = dwells.gyro.copy()
    gyro[5] = -gyro[5]
    survey = fix(replace(dwells, gyro=gyro))
    assert not [f for f in survey.findings if f.code == "north.misfit"]
    assert survey.verdicts[1].level is Level.DOUBTFUL


def test_what_no_reading_can_show():
    """With the accelerometer on the base, an index that counts or begins otherwise turns gravity
    and rate alike: the heading is another one, and everything fits. The calibration shows it."""
    dwells = readings()
    for index in (-dwells.index, dwells.index + np.pi / 2):
        survey = fix(turned(dwells, index))
        assert all(v.level is Level.PASS for v in survey.verdicts)


# -- sensors that read nothing ---------------------------------------------------------------------


def sampled(accel=2, seed=1):
    """Samples of a north seeker, noise alone."""
    rng = np.random.default_rng(seed)
    return IndexedLog(
        np.arange(600) / 10, np.zeros(600), 1e-6 * rng.standard_normal(600),
        1e-3 * rng.standard_normal((600, accel)), np.zeros(600, np.int64), ("one",),
    )  # fmt: skip


@pytest.mark.parametrize("value", [0.0, 0.02])
def test_a_sensor_that_reads_one_value_is_refused(value):
    for log, sensor, columns in (
        (sampled(), "right accelerometer", (slice(None), 0)),
        (sampled(), "forward accelerometer", (slice(None), 1)),
        (sampled(1), "accelerometer", (slice(None), 0)),
    ):
        log.accel[columns] = value
        said = refused(
            "north.stuck", f"The {sensor} reads {value:g} m/s^2 in 600 of 600", alive, log
        )
        assert "check [log.accel]" in said
    log = sampled()
    log.gyro[:] = value * DEG / 3600
    said = refused("north.stuck", f"The gyro reads {value:g} deg/h in 600 of 600 rows", alive, log)
    assert "check [log.gyro]" in said


def test_a_sensor_that_stops_is_named_and_a_gyro_refused():
    log = sampled()
    assert alive(log) == ()
    log.accel[300:, 1] = log.accel[300, 1]
    (found,) = alive(log)
    assert found.message.startswith("accel forward repeats one reading from 30 s to 59.9 s")
    log.gyro[300:] = log.gyro[300]
    refused("north.stuck", "in 300 of 600 rows, one after the other", alive, log)


@pytest.mark.parametrize("sensor", ["gyro", "accel"])
def test_a_sensor_that_stops_for_some_of_many_means_is_named(sensor):
    log = sampled()
    means = IndexedLog(
        log.time[:48], log.index[:48], log.gyro[:48].copy(), log.accel[:48].copy(), log.setup[:48],
        log.names, averaged=np.full(48, 60.0),
    )  # fmt: skip
    assert alive(means) == ()
    if sensor == "gyro":
        means.gyro[19:28] = means.gyro[19]
        refused("north.stuck", "in 9 of 48 rows, one after the other", alive, means)
    else:
        means.accel[19:28, 0] = means.accel[19, 0]
        assert [item.code for item in alive(means)] == ["log.stuck"]


def test_few_means_may_well_read_the_same():
    log = sampled()
    few = IndexedLog(
        log.time[:4], log.index[:4], log.gyro[:4], np.zeros((4, 2)), log.setup[:4], log.names,
        averaged=np.full(4, 60.0),
    )  # fmt: skip
    assert alive(few) == ()
