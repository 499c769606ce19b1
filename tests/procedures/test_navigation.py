"""A log is navigated with and without its calibration; what each coefficient is worth is right."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from foucault.coefficients import CoefficientVector
from foucault.errors import FoucaultError
from foucault.infer.gauss_newton import chi_square_limits
from foucault.logs.reference import Reference
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.rotation import matrix_of
from foucault.plans.manoeuvres import Rest, Rotate
from foucault.procedures.alignment import align_log
from foucault.procedures.navigation import navigate_log
from foucault.procedures.navigation.start import Settings
from foucault.result import Level, Result
from make_alignment import LN100_SITE, RING_SITE, ln100_log, ring_log
from make_navigation import (
    DRIVE,
    LONGITUDE,
    NOISE,
    SITE,
    START,
    calibration,
    errors,
    logged,
    reference_of,
)
from refusals import refuses
from sessions import codes

PLACE = {"site": SITE, "longitude": LONGITUDE}
TRUE, FOUND = errors()


@pytest.fixture(scope="module")
def parked():
    """Twenty-five minutes of rest, calibrated; five minutes of them aligned."""
    return navigate_log(logged([Rest(1500.0)], TRUE).log, calibration=calibration(FOUND),
                        noise=NOISE, instrument={"serial": "SN 4"}, **PLACE)  # fmt: skip


@pytest.mark.thorough
def test_without_errors_nothing_is_off() -> None:
    run = logged([Rest(900.0)], noise=None, rate=100.0)
    test = navigate_log(run.log, settings=Settings(method="two_vector"), **PLACE)
    assert test.runs[0].growth[-1].horizontal < 0.01
    assert test.runs[0].name == "as measured" and codes(test) == ["navigate.no_calibration"]
    # The best of runs is no certificate where nothing is known of the sensors.
    assert test.verdict.level is Level.DOUBTFUL
    assert "without a calibration nothing is known" in test.verdict.reasons[0]
    angles = [START.heading, START.pitch, START.roll]
    assert test.runs[0].trajectory.angles[0] == pytest.approx(angles, abs=1e-7)


def test_a_calibration_pays(parked) -> None:
    assert [run.name for run in parked.runs] == ["with calibration", "without calibration"]
    better, worse = (run.growth[-1].horizontal for run in parked.runs)
    assert better < worse and parked.verdict.level is Level.PASS
    assert parked.reference.still and parked.settings.vertical == "held"
    assert parked.opening.end - parked.opening.start == 300.0 and parked.opening.still
    assert [c.name for c in parked.checks] == [
        "heading at the start", "noise", "rest at the start", "position at the last epoch",
        "velocity at the last epoch",
    ]  # fmt: skip
    assert parked.noise_source == "declared" and parked.findings == ()
    assert [round(row.age) for row in parked.runs[0].growth] == [60, 120, 300, 600, 1200]
    start = parked.budget.start - parked.runs[0].start.phi_cov
    k = FOUND.layout.index("gyro.bias.x")
    turned = FOUND.sd[k] / (EARTH_RATE * np.cos(SITE.latitude))
    assert np.sqrt(start[2, 2]) == pytest.approx(turned, rel=0.1)  # as gyro biases make it
    assert parked.checks[0].value == pytest.approx(np.degrees(np.sqrt(parked.budget.start[2, 2])))


@pytest.mark.thorough
def test_a_covariance_too_small_is_told_by_the_rest_at_the_start() -> None:
    """Where nothing says where the drive went, too: gravity and the Earth's rate are known."""
    squares, doubted = [], 0
    for seed in range(12):
        true, found = errors(seed, known=1.0)
        log = logged([Rest(60.0)], true, seed=seed).log
        for cov in (found.cov, 1e-4 * found.cov):
            vector = CoefficientVector(found.layout, found.values, cov)
            test = navigate_log(log, calibration=calibration(vector), noise=NOISE,
                                settings=Settings(align=50.0), **PLACE)  # fmt: skip
            check = next(c for c in test.checks if c.name == "rest at the start")
            if cov is found.cov:
                squares.append(check.value)
                assert check.passed
            elif not check.passed:
                doubted += 1
                assert "less certain than the calibration says" in check.sentence
    assert chi_square_limits(12)[0] < sum(squares) < chi_square_limits(48)[1]
    assert doubted >= 9


def test_contributions_add_up_to_the_difference(parked) -> None:
    """Propagated one by one, alignment included, they are what two navigations differ by."""
    total = parked.budget.worth[:, 6:8].sum(axis=2)
    size = np.hypot(*parked.difference[-1, :2])
    assert size > 30
    assert np.abs(total - parked.difference[:, :2]).max() < 0.01 * size


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["gyro.bias.x", "accel.bias.y", "gyro.misalignment.yz"])
def test_one_coefficient_is_worth_what_navigating_twice_says(name: str) -> None:
    """On a drive too; half a calibration is the other navigation."""
    log = logged(DRIVE, TRUE, noise=None).log
    whole = CoefficientVector(TRUE.layout, TRUE.values)
    lacking = whole.with_values({name: 0.0})
    how = {"noise": NOISE, "settings": Settings(vertical="held", still=True), **PLACE}
    full, less = (navigate_log(log, calibration=calibration(c), **how) for c in (whole, lacking))
    assert "navigate.no_cov" in codes(full)
    known = full.runs[0].errors.position[-1, :2] * -1 + less.runs[0].errors.position[-1, :2]
    k = full.budget.names.index(name)
    assert full.budget.worth[-1, 6:8, k] == pytest.approx(known, rel=0.01, abs=0.02)


@pytest.mark.thorough
def test_noise_declared_five_times_too_small_is_doubtful_and_that_of_the_rest_is_used() -> None:
    log = logged([Rest(300.0)], TRUE, rate=5.0).log
    small = ImuNoise(*(TriadNoise(white=t.white / 5) for t in (NOISE.accel, NOISE.gyro)))
    how = {"calibration": calibration(FOUND), **PLACE}
    test = navigate_log(log, noise=small, settings=Settings(align=200.0), **how)
    check = next(c for c in test.checks if c.name == "noise")
    assert not check.passed and test.verdict.level is Level.DOUBTFUL
    assert test.noise_source == "declared, raised to that of the rest"
    assert test.noise.gyro.white == pytest.approx(NOISE.gyro.white, rel=0.1)
    found = align_log(log, site=SITE, end=200.0, noise=small, calibration=how["calibration"])
    assert "alignment.declared_noise" in [f.code for f in found.findings]
    assert found.noise == test.noise
    fine = align_log(log, site=SITE, end=200.0, noise=NOISE, calibration=how["calibration"])
    assert "alignment.declared_noise" not in [f.code for f in fine.findings]


@pytest.mark.thorough
def test_the_predicted_error_is_right() -> None:
    """NEES of position and velocity of 30 runs; with the calibration's part left out it fails."""
    squares, without = 0.0, 0.0
    layout = TRUE.layout
    for seed in range(30):
        true, found = errors(seed, known=0.3)
        run = navigate_log(logged([Rest(500.0)], true, seed=seed, rate=5.0).log, noise=NOISE,
                           calibration=calibration(found), settings=Settings(align=200.0),
                           **PLACE)  # fmt: skip
        seen = run.runs[0].errors
        e = np.concatenate([seen.position[-1, :2], seen.velocity[-1, :2]])
        rows = np.ix_([6, 7, 3, 4], [6, 7, 3, 4])
        squares += e @ np.linalg.solve(run.budget.cov[-1][rows], e)
        less = run.budget.alignment[-1] + run.budget.noise[-1]
        without += e @ np.linalg.solve(less[rows], e)
    assert len(layout) == 21
    low, high = chi_square_limits(120)
    assert low < squares < high
    assert without > high


def test_an_underrated_calibration_is_doubtful() -> None:
    true, found = errors(2)
    proud = CoefficientVector(found.layout, 0 * found.values, found.cov * 1e-4)
    test = navigate_log(logged([Rest(900.0)], true).log, noise=NOISE,
                        calibration=calibration(proud), **PLACE)  # fmt: skip
    assert test.verdict.level is Level.DOUBTFUL
    assert any("more than noise and calibration explain" in r for r in test.verdict.reasons)


def test_a_drive_is_compared_with_its_reference() -> None:
    run = logged(DRIVE, TRUE)
    test = navigate_log(run.log, calibration=calibration(FOUND), noise=NOISE,
                        reference=reference_of(run))  # fmt: skip
    assert test.settings.vertical == "aided" and test.stationary == "the instrument moved"
    assert test.site.latitude == pytest.approx(START.latitude, abs=1e-9)
    assert test.runs[0].schuler is None
    assert test.runs[0].growth[-1].horizontal < test.runs[1].growth[-1].horizontal
    assert np.abs(test.budget.worth[-1, 6:8].sum(axis=1) - test.difference[-1, :2]).max() < 0.5
    assert test.checks[-1].name == "heading at the last epoch" and test.verdict.level is Level.PASS
    assert np.abs(test.runs[0].errors.position[:, 2]).max() < 0.5
    alone = navigate_log(run.log, **PLACE)
    assert "navigate.no_reference" in codes(alone) and alone.runs[0].errors is None
    assert alone.verdict.level is Level.DOUBTFUL and "Not judged" in alone.verdict.reasons[0]
    assert alone.settings.vertical == "free" and alone.budget.noise[-1, 8, 8] > 0


def test_a_start_on_the_move_takes_velocity_and_place_from_the_reference() -> None:
    run = logged(DRIVE, TRUE)
    degrees = np.degrees(run.truth.angles[np.searchsorted(run.truth.time, 135.0)])
    given = dict(zip(("heading", "pitch", "roll"), np.radians(degrees), strict=True))
    settings = Settings(start=135.0, end=160.0, **given)
    test = navigate_log(run.log, calibration=calibration(FOUND), noise=NOISE, settings=settings,
                        reference=reference_of(run))  # fmt: skip
    assert test.runs[0].start.method == "given"
    assert np.hypot(*test.runs[0].trajectory.velocity_n[0, :2]) > 10
    assert test.runs[0].growth[-1].horizontal < 3
    blind = navigate_log(run.log, noise=NOISE, settings=settings, **PLACE)
    assert "navigate.speed_at_start" in codes(blind)


def test_turned_at_its_site_it_is_still() -> None:
    plan = [Rest(150.0), Rotate("up", np.radians(90), 20.0), Rest(100.0)]
    run = logged(plan, TRUE)
    test = navigate_log(run.log, noise=NOISE, settings=Settings(still=True), **PLACE)
    assert test.reference.still and "the instrument turned, by up to 9" in test.stationary
    assert test.opening.end < 150 and test.opening.found
    with refuses(
        "navigate.two_references", "Leave one", match="--still says that the instrument never"
    ):
        navigate_log(run.log, settings=Settings(still=True), reference=reference_of(run), **PLACE)


def test_schuler_terms_name_what_was_wrong() -> None:
    """A given heading that is 0.1 deg off looks like an east gyro drift, and the fit says so."""
    off = np.radians(0.1)
    run = logged([Rest(3600.0)], rate=10.0)
    settings = Settings(heading=START.heading + off, align=300.0)
    fit = navigate_log(run.log, noise=NOISE, settings=settings, **PLACE).runs[0].schuler
    row = fit.rows()[4]
    assert row["name"] == "drift about east" and "a heading error of" in row["same_as"]
    w_n = fit.place.earth_rate[0]
    assert abs(row["value"] - off * w_n) < 3 * row["sd"] and row["value"] > 3 * row["sd"]


def test_gyros_that_cannot_see_north_need_a_heading() -> None:
    poor = ImuNoise(TriadNoise(white=1e-3), TriadNoise(white=1e-4))
    biased = TRUE.with_values({"gyro.bias.x": 0.005})
    log = logged([Rest(200.0)], biased, noise=poor).log
    with pytest.raises(FoucaultError) as caught:
        navigate_log(log, **PLACE)
    assert caught.value.code == "navigate.heading" and "show no north" in caught.value.message
    assert '--heading "90.6 deg"' in caught.value.cure
    # Of a large bias it is not said that the log is no rest: gravity does not turn.
    worse = logged([Rest(60.0)], TRUE.with_values({"gyro.bias.y": np.radians(3.0)}), noise=poor)
    with pytest.raises(FoucaultError) as caught:
        navigate_log(worse.log, **PLACE)
    assert "stands still, so that this is their bias, 3 deg/s or more" in caught.value.message
    assert "It was no rest" not in caught.value.message
    noisy = logged([Rest(200.0)], noise=replace(poor, gyro=TriadNoise(white=1e-4))).log
    with pytest.raises(FoucaultError, match="the rest shows the heading to"):
        navigate_log(noisy, **PLACE)
    settings = Settings(heading=START.heading, heading_sd=np.radians(1.0))
    test = navigate_log(log, settings=settings, calibration=calibration(biased), **PLACE)
    assert [r.start.method for r in test.runs] == ["level and given heading"] * 2
    assert test.runs[0].trajectory.angles[0, 1] == pytest.approx(START.pitch, abs=2e-4)
    assert test.checks[0].value == pytest.approx(1.0)


def test_what_cannot_be_aligned_raw_starts_with_the_calibrated_attitude() -> None:
    biased = TRUE.with_values({"gyro.bias.x": 0.005})
    exact = CoefficientVector(biased.layout, biased.values, 1e-12 * np.eye(len(biased)))
    log = logged([Rest(400.0)], biased).log
    test = navigate_log(log, calibration=calibration(exact), **PLACE)
    assert "navigate.raw_start" in codes(test)
    said = next(f for f in test.findings if f.code == "navigate.raw_start")
    assert "the gyros read" in said.message and "after the alignment" in said.cure
    first, second = (run.trajectory.angles[0] for run in test.runs)
    assert first.tolist() == second.tolist()


def test_a_raw_run_that_fails_is_left_out() -> None:
    """A scale factor of zero size leaves nothing to navigate by."""
    void = CoefficientVector(FOUND.layout, TRUE.values, FOUND.cov)
    log = logged([Rest(300.0)], TRUE).log
    broken = replace(log, accel=log.accel * np.where(log.time > 150, 1e99, 1.0)[:, None])

    class Mended(Result):
        """A calibration that also mends the log."""

        def apply(self, _log):
            return calibration(void).apply(log)

    mended = Mended(**{f.name: getattr(calibration(void), f.name) for f in fields(Result)})
    test = navigate_log(broken, calibration=mended, settings=Settings(align=100.0), **PLACE)
    assert "navigate.raw_fails" in codes(test) and len(test.runs) == 1
    said = next(f for f in test.findings if f.code == "navigate.raw_fails")
    assert "the navigation failed: The state is not finite" in said.message


def _from(known: Reference, time: float) -> Reference:
    rows = known.time >= time
    cut = {k: getattr(known, k)[rows] for k in ("time", "position", "velocity_n", "angles")}
    return replace(known, **cut)


def test_a_reference_that_begins_later_does_not_say_where_it_starts() -> None:
    """The place that was given counts; nearest in time is not near."""
    run = logged(DRIVE, TRUE)
    whole = reference_of(run)
    how = {"calibration": calibration(FOUND), "noise": NOISE, **PLACE}
    late = navigate_log(run.log, reference=_from(whole, 150.0), **how).runs[0].growth[-1]
    full = navigate_log(run.log, reference=whole, **how).runs[0].growth[-1]
    assert late.horizontal == pytest.approx(full.horizontal, abs=0.05)


def test_references_that_contradict_the_log_are_told() -> None:
    run = logged(DRIVE, TRUE)
    whole = reference_of(run)
    how = {"calibration": calibration(FOUND), "noise": NOISE, "log": run.log}
    swapped = replace(whole, position=whole.position[:, [1, 0, 2]])
    refused("navigate.elsewhere", "but the reference starts at latitude 8.5 deg",
            "order of latitude and longitude", reference=swapped, **how, **PLACE)  # fmt: skip
    told = navigate_log(reference=swapped, **how)
    said = next(f for f in told.findings if f.code == "navigate.latitude")
    assert "latitude 8.5 deg, longitude 47.3 deg" in said.message and "exchanged" in said.cure
    early = replace(whole, time=whole.time - 20.0)
    refused("navigate.moving", "but the reference moves by", "--align", reference=early, **how)
    fast = replace(_from(early, 90.0), position=None)
    refused(
        "navigate.moving",
        "rest from 0",
        "clocks of log",
        reference=replace(fast, velocity_n=fast.velocity_n + 1.0),
        settings=Settings(align=100.0),
        **how,
        **PLACE,
    )
    assert navigate_log(reference=replace(whole, position=None), **how, **PLACE).runs[0].errors


def test_still_is_doubted_where_it_was_driven() -> None:
    run = logged(DRIVE, TRUE)
    how = {"calibration": calibration(FOUND), "noise": NOISE, **PLACE}
    test = navigate_log(run.log, settings=Settings(still=True), **how)
    said = next(f for f in test.findings if f.code == "navigate.not_still")
    assert "m/s within 10 s" in said.message and "Leave --still out" in said.cure
    turned = logged([Rest(150.0), Rotate("up", np.radians(90), 20.0), Rest(100.0)], TRUE)
    assert "navigate.not_still" not in codes(
        navigate_log(turned.log, settings=Settings(still=True), **how)
    )


def test_units_are_told_before_a_heading_is_asked_for() -> None:
    log = logged([Rest(200.0)]).log
    scaled = replace(log, gyro=log.gyro * 180 / np.pi)
    with pytest.raises(FoucaultError, match="the unit is deg/s and was declared as rad/s"):
        navigate_log(scaled, **PLACE)
    # Of a window that holds a start too the motion is told.
    with refuses("navigate.heading", match=r"It was no rest: .* moved"):
        navigate_log(logged(DRIVE).log, settings=Settings(align=128.0), noise=NOISE, **PLACE)


def test_a_given_heading_hides_no_unit_and_no_motion() -> None:
    log = logged([Rest(300.0)]).log
    angles = {"heading": START.heading, "pitch": START.pitch, "roll": START.roll}
    for given in ({"heading": START.heading}, angles):
        how = {"settings": Settings(**given), "noise": NOISE, **PLACE}
        for wrong, said in (
            (replace(log, gyro=log.gyro * 180 / np.pi), "deg/s and was declared as rad/s"),
            (replace(log, accel=-log.accel), "the sign is reversed"),
            (replace(log, accel=log.accel / 9.80665), "the unit is g"),
        ):
            with pytest.raises(FoucaultError, match=said):
                navigate_log(wrong, **how)
        assert codes(navigate_log(log, **how)) == ["navigate.no_calibration"]
    settings = Settings(heading=START.heading, align=150.0)
    moved = navigate_log(logged(DRIVE, TRUE).log, settings=settings, noise=NOISE, **PLACE)
    assert {"alignment.turned", "alignment.left_place"} & set(codes(moved))


def test_positions_alone_give_the_speed_of_a_start_on_the_move() -> None:
    run = logged(DRIVE, TRUE)
    row = int(np.searchsorted(run.truth.time, 135.4))
    given = dict(zip(("heading", "pitch", "roll"), run.truth.angles[row], strict=True))
    settings = Settings(start=float(run.truth.time[row]), end=160.0, **given)
    ends = []
    for known in (reference_of(run), reference_of(run, velocity_n=None)):
        test = navigate_log(run.log, calibration=calibration(FOUND), noise=NOISE,
                            settings=settings, reference=known)  # fmt: skip
        assert "navigate.speed_at_start" not in codes(test)
        ends.append(test.runs[0].growth[-1].horizontal)
    assert ends[0] < 3 and ends[1] < 15


def test_sway_is_not_taken_for_noise() -> None:
    log = logged([Rest(400.0)]).log
    sway = 2e-3 * np.sin(2 * np.pi * 0.3 * log.time)
    moved = replace(log, gyro=log.gyro + np.gradient(sway, log.time)[:, None] * [1.0, 0.6, 0.2])
    test = navigate_log(moved, settings=Settings(align=300.0), **PLACE)
    assert test.noise.gyro.white == pytest.approx(NOISE.gyro.white, rel=0.3)
    assert "alignment.noise" in codes(test)
    assert "alignment.noise" not in codes(
        navigate_log(moved, settings=Settings(align=300.0), noise=NOISE, **PLACE)
    )


@pytest.mark.thorough
@pytest.mark.parametrize("size", [1e-6, 1.0, 30.0])
def test_what_a_coefficient_does_is_the_same_however_well_it_is_known(size: float) -> None:
    """The step by which an alignment is repeated must not follow the declared sd."""
    log = logged([Rest(400.0)], TRUE).log
    found = CoefficientVector(FOUND.layout, FOUND.values, size**2 * FOUND.cov)
    usual, other = (
        navigate_log(log, calibration=calibration(c), noise=NOISE, **PLACE).budget
        for c in (FOUND, found)
    )
    assert other.response[-1] == pytest.approx(usual.response[-1], rel=1e-12)
    # The heading that an east gyro bias makes is known in closed form.
    columns = [usual.names.index(f"gyro.bias.{a}") for a in "xyz"]
    bias = matrix_of(START.heading, START.pitch, START.roll)[0]
    east = usual.response[-1, 2, columns] @ bias
    assert abs(east) == pytest.approx(1 / (EARTH_RATE * np.cos(SITE.latitude)), rel=1e-2)


def test_noise_is_measured_in_the_rest_or_said_to_be_missing() -> None:
    log = logged([Rest(600.0)]).log
    test = navigate_log(log, **PLACE)
    assert test.noise_source == "measured in the rest"
    assert test.noise.gyro.white == pytest.approx(NOISE.gyro.white, rel=0.3)
    assert test.noise.accel.white == pytest.approx(NOISE.accel.white, rel=0.3)
    half = navigate_log(log, noise=ImuNoise(TriadNoise(), TriadNoise(white=1e-5)), **PLACE)
    assert half.noise.gyro.white == 1e-5 and half.noise.accel == test.noise.accel
    given = {"heading": START.heading, "pitch": START.pitch, "roll": START.roll}
    run = logged(DRIVE, TRUE)
    blind = navigate_log(run.log, settings=Settings(start=125.0, end=132.0, **given), **PLACE)
    assert blind.noise_source == "none" and "navigate.no_noise" in codes(blind)


def test_a_gap_stops_or_is_bridged_by_choice() -> None:
    log = logged([Rest(600.0)], TRUE).log
    keep = (log.time < 400) | (log.time > 401)
    holed = replace(log, time=log.time[keep], gyro=log.gyro[keep], accel=log.accel[keep])
    with refuses("strapdown.gap", "--gaps bridge"):
        navigate_log(holed, **PLACE)
    bridged = navigate_log(holed, settings=Settings(gaps="bridge"), **PLACE)
    whole = navigate_log(log, **PLACE)
    assert "strapdown.bridged" in codes(bridged)
    ends = [test.runs[0].growth[-1].horizontal for test in (bridged, whole)]
    assert ends[0] == pytest.approx(ends[1], abs=2.0)
    before = navigate_log(holed, settings=Settings(end=390.0), **PLACE)
    assert before.runs[0].trajectory.time[-1] == pytest.approx(390.0, abs=0.1)


@pytest.mark.parametrize("method", ["inertial_frame", "two_vector", "kalman"])
def test_every_method_of_alignment_starts_it(method: str) -> None:
    log = logged([Rest(600.0)]).log
    test = navigate_log(log, settings=Settings(method=method), noise=NOISE, **PLACE)
    start = test.runs[0].start
    off = test.runs[0].trajectory.angles[0] - [START.heading, START.pitch, START.roll]
    assert start.method == method and abs(off[0]) < 4 * np.sqrt(start.phi_cov[2, 2])
    assert test.verdict.level is Level.DOUBTFUL and len(test.verdict.reasons) == 1


def refused(code: str, said: str, cure: str, log=None, **words) -> None:
    log = logged([Rest(100.0)]).log if log is None else log
    with refuses(code) as caught:
        navigate_log(log, **words)
    assert said in caught.value.message and cure in caught.value.cure


def test_mistakes_are_named() -> None:
    refused("navigate.place", "The latitude is not known", "--latitude")
    refused("navigate.too_short", "The alignment ends at 99.95 s", "Align for less",
            settings=Settings(align=100.0), **PLACE)  # fmt: skip
    refused("navigate.span", "from 200 s to 100 s was to be used; the log lasts 100 s",
            "count from the start", settings=Settings(start=200.0), **PLACE)  # fmt: skip
    refused("navigate.aided", "needs heights; there is no reference", "--vertical held or free",
            log=logged(DRIVE).log, settings=Settings(vertical="aided"), **PLACE)  # fmt: skip
    run = logged(DRIVE)
    flat = reference_of(run, has_height=False)
    refused("navigate.aided", "the reference has none", "--vertical held", log=run.log,
            settings=Settings(vertical="aided"), reference=flat)  # fmt: skip
    refused("navigate.no_rest", "No rest of 10 s or more was found in the log", "--align",
            log=logged(DRIVE[1:], start=START).log[:300], **PLACE)  # fmt: skip
    refused("navigate.place_later", "starts at 119", "begins with the log", log=run.log,
            reference=_from(reference_of(run), 130.0))  # fmt: skip
    late = Reference.site(np.arange(1e5, 1e5 + 9), SITE.latitude, LONGITUDE, 0.0)
    refused("navigate.apart", "the reference from 100000 s", "same clock", reference=late, **PLACE)


def test_a_start_attitude_given_in_part() -> None:
    with refuses("navigate.attitude") as caught:
        Settings(heading=1.0, pitch=0.1)
    assert "--heading, --pitch was given without --roll" in caught.value.message
    assert "Give --heading alone" in caught.value.cure
    with pytest.raises(FoucaultError, match="--roll was given without --heading, --pitch"):
        Settings(roll=0.1)


def test_the_calibration_of_something_else() -> None:
    from foucault.models.cluster import LAYOUT as CLUSTER

    other = calibration(CoefficientVector.zeros(CLUSTER), provenance={"file": "tumble.json"})
    refused("navigate.not_imu", "tumble.json is a result of turntable", "accelerometers and gyros",
            calibration=other, **PLACE)  # fmt: skip
    refused("navigate.other_serial", "of instrument SN 5, the calibration is of SN 4",
            "correct the serial number", calibration=calibration(FOUND),
            instrument={"serial": "SN 5"}, **PLACE)  # fmt: skip
    old = calibration(FOUND, Level.DOUBTFUL)
    test = navigate_log(logged([Rest(100.0)], TRUE).log, calibration=old, **PLACE)
    assert {"navigate.whose", "navigate.calibration_doubtful"} <= set(codes(test))
    said = {f.code: f for f in test.findings}
    assert "is doubtful: It is old." in said["navigate.calibration_doubtful"].message
    assert "of instrument SN 4; the log names none" in said["navigate.whose"].message
    bare = navigate_log(logged([Rest(100.0)], TRUE).log,
                        calibration=calibration(replace(FOUND, cov=None)), **PLACE)  # fmt: skip
    said = next(f for f in bare.findings if f.code == "navigate.no_cov")
    assert "does not say how sure its coefficients are" in said.message


def test_measured_gravity_counts() -> None:
    """Gravity 100 mGal more than normal: the height of a free channel falls without being told."""
    there = Site(SITE.gravity + 1e-3, SITE.latitude, SITE.height)
    run = logged([Rest(300.0)], noise=None)
    free = Settings(vertical="free")
    told = navigate_log(run.log, site=there, longitude=LONGITUDE, settings=free)
    plain = navigate_log(run.log, settings=free, **PLACE)
    age = plain.runs[0].errors.age[-1]
    fall = told.runs[0].errors.position[-1, 2] - plain.runs[0].errors.position[-1, 2]
    assert fall == pytest.approx(-0.5e-3 * age**2, rel=0.05)


def test_real_ring_laser_with_people_moving() -> None:
    """Ten minutes after five of alignment; the heading is the one other programs find."""
    test = navigate_log(ring_log(), site=RING_SITE, settings=Settings(align=300.0, still=True))
    assert np.degrees(test.runs[0].trajectory.angles[0, 0]) == pytest.approx(90.61, abs=0.05)
    assert test.runs[0].growth[-1].horizontal < 100
    assert test.runs[0].schuler is not None


def test_real_ln100() -> None:
    test = navigate_log(ln100_log(), site=LN100_SITE, settings=Settings(align=150.0))
    assert np.degrees(test.runs[0].trajectory.angles[0, 0]) == pytest.approx(7.31, abs=0.05)
    assert test.runs[0].growth[-1].horizontal < 20


@pytest.mark.thorough
def test_a_row_of_zeros_on_the_way_costs_no_velocity() -> None:
    run = logged(DRIVE, TRUE)
    log, words = run.log, {"calibration": calibration(FOUND), "noise": NOISE, **PLACE}
    gyro, accel = log.gyro.copy(), log.accel.copy()
    k = len(log) // 2 + 7
    gyro[k] = accel[k] = 0.0  # 0.5 m/s of up are lost
    spoiled = replace(log, gyro=gyro, accel=accel)
    clean, got = (navigate_log(x, reference=reference_of(run), **words) for x in (log, spoiled))
    assert got.runs[0].growth[-1].vertical == pytest.approx(
        clean.runs[0].growth[-1].vertical, abs=0.05
    )
    assert got.runs[0].growth[-1].horizontal == pytest.approx(
        clean.runs[0].growth[-1].horizontal, abs=0.5
    )
    assert "log.spikes" in codes(got)
    assert "log.spikes" not in codes(clean)


@pytest.mark.thorough
@pytest.mark.parametrize("triad", ["gyro", "accel"])
def test_one_reading_20_sd_off_on_the_way_moves_the_end_by_less_than_a_sd(triad: str) -> None:
    run = logged(DRIVE, TRUE)
    log, words = run.log, {"calibration": calibration(FOUND), "noise": NOISE, **PLACE}
    x = getattr(log, triad).copy()
    x[len(log) // 2 + 7, 0] += 20 * getattr(NOISE, triad).white / np.sqrt(log.interval)
    clean, got = (
        navigate_log(each, reference=reference_of(run), **words).checks
        for each in (log, replace(log, **{triad: x}))
    )
    for name in ("position at the last epoch", "velocity at the last epoch"):
        one, other = (next(c for c in checks if c.name == name) for checks in (clean, got))
        assert other.passed
        assert other.value == pytest.approx(one.value, abs=1.0)


def test_reversed_gyros_show_by_their_sign_with_a_calibration_too():
    """It takes their biases off the wrong way, so that the sign is turned but for twice a bias."""
    true, known = errors(1)
    log = logged([Rest(200.0)], true).log
    assert log.gyro is not None
    reversed_ = replace(log, gyro=-log.gyro)
    with refuses("alignment.vertical_sign"):
        navigate_log(reversed_, site=SITE, calibration=calibration(known))
