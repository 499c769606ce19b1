"""What a planned session of a north seeker will show, against what sessions did show."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from foucault.campaign import optimisation, reading
from foucault.errors import FoucaultError
from foucault.models.earth import Site
from foucault.models.noise import TriadNoise
from foucault.procedures import north_seeking
from foucault.procedures.north_seeking import Session, Settings
from foucault.procedures.north_seeking.fix import find_north
from foucault.procedures.record import Beforehand
from make_dwells import FIELD

SITE = Site.at(0.8)
ARCMIN = np.radians(1 / 60)
TILTS = ("8 deg", "-8 deg", "0 deg")

SESSIONS = {
    "level": (Session(), Settings()),
    "two on the case": (Session(accelerometers="case", order="palindrome"), Settings()),
    "none": (Session(accelerometers="none"), Settings(level_sd=ARCMIN)),
    "tilted": (
        Session(tilts=TILTS, gyro_drift=1e-10),
        Settings(heading_sd=ARCMIN, heading_offset_sd=3 * ARCMIN, index_sd=ARCMIN, drift_sd=1e-10),
    ),
    "samples": (Session(dwell=30.0, rows="samples", rate=2.0), Settings()),
    "stops of its own": (
        Session.model_validate(
            {"order": [{"index": f"{a} deg", "dwell": "70 s"} for a in (-90, 90, 0, 180, -90)]}
        ),
        Settings(index_limit=np.pi),
    ),
}  # fmt: skip


def foreseen(session, settings, prior=None, noise=FIELD):
    return north_seeking.foresee(Beforehand(settings, session=session, site=SITE, noise=noise,
                                 prior=prior or {}))  # fmt: skip


@cache
def known(case):
    return foreseen(*SESSIONS[case])


def made(session, settings, seed, noise=FIELD):
    model = north_seeking.draw_errors("", seed)
    return north_seeking.simulate(session, settings=settings, model=model, noise=noise, site=SITE,
                                  seed=seed).log  # fmt: skip


def test_a_level_session_does_not_show_all():
    f = known("level")
    assert (f.rank, f.states) == (8, 10) and not f.complete
    assert f.hardly == ("gyro.misalignment.xz", "gyro.misalignment.yz")
    assert any("gyro.misalignment.yz" in words and "not seen" in words for words in f.unseen)
    codes = [item.code for item in f.findings]
    assert codes == ["preflight.level", "preflight.heading"]
    assert "which a calibration" not in f.findings[0].message
    # 12 times 4 stops of 120 s and 3 moves of 5 s, a minute between headings.
    assert f.duration == 12 * 495 + 11 * 60
    tilted = known("tilted")
    assert tilted.complete and tilted.rank == tilted.states == 8
    small = foreseen(Session(), Settings(z_coupling="no"), {"gyro.scale": (0.0, 1e-6)})
    assert "preflight.unseen" in [item.code for item in small.findings]


def test_the_heading_in_the_field_is_told():
    session, settings = SESSIONS["level"]
    told = known("level").findings[-1].message
    log = made(session, settings, 3)
    result = north_seeking.calibrate(log, site=SITE, settings=settings, noise=FIELD)
    survey = find_north(log, site=SITE, settings=settings, noise=FIELD, calibration=result)
    sd = np.degrees(np.sqrt(survey.fixes.cov[:, 0, 0].mean()))
    said = float(told.split("heading to ")[1].split()[0])
    assert said == pytest.approx(sd, rel=0.02)
    assert "With this calibration 495 s of the same stops give" in told


def test_what_a_little_more_would_buy():
    f = known("level")
    more = {item.what: item for item in f.more}
    five = more["five more minutes, spread over all stops"]
    assert five.time == pytest.approx(300.0) and 0.9 < five.ratio < 1.0
    assert five.best[0][1] == pytest.approx(np.sqrt(5760 / 6060), rel=1e-3)
    one = more["one more heading, evenly spread"]
    assert one.time == 555.0 and one.best[0][1] == pytest.approx(np.sqrt(12 / 13), rel=1e-3)
    tilted = more["the same headings tilted by 10 deg"]
    assert tilted.ratio < 0.9 and tilted.time == 6660.0
    stop = more["the first stop once more in every set-up"]
    assert stop.time == 12 * 125
    already = known("tilted")
    assert not [item for item in already.more if "tilted" in item.what]


def test_limits_of_the_base():
    bent = foreseen(Session(), Settings(index_limit=np.radians(100.0), index_step=np.radians(60.0)))
    angle, detent = bent.limits
    assert not angle.kept and angle.needed == pytest.approx(np.pi)
    assert not detent.kept and detent.needed == pytest.approx(np.radians(30.0))
    fine = foreseen(Session(), Settings(index_limit=np.pi, index_step=np.radians(45.0)))
    assert all(limit.kept for limit in fine.limits)
    assert foreseen(Session(), Settings()).limits[0].kept  # nothing was said


def test_fewer_headings_than_a_calibration_needs_are_a_fix():
    session, settings = Session(headings=1), Settings()
    f = foreseen(session, settings)
    assert f.names == ("heading", "pitch", "roll") and f.complete
    survey = find_north(made(session, settings, 1), site=SITE, noise=FIELD, settings=settings)
    np.testing.assert_allclose(f.sd, survey.fixes.sd[0, :3], rtol=0.02)
    five = f.more[0]
    assert dict(five.best)["heading"] == pytest.approx(np.sqrt(480 / 780), rel=0.01)


def test_noise_that_is_not_declared_is_told():
    f = foreseen(*SESSIONS["level"], noise=None)
    assert f.findings[0].code == "preflight.gyro_noise"
    assert "0.002 deg/sqrt(h) and 5 ug/sqrt(Hz) were taken" in f.findings[0].message


def test_accelerometers_without_noise_are_told_where_they_are_read():
    gyro_only = replace(FIELD, accel=TriadNoise())
    for case, told in (("level", True), ("two on the case", True), ("none", False)):
        codes = [f.code for f in foreseen(*SESSIONS[case], noise=gyro_only).findings]
        assert ("preflight.accel_noise" in codes) == told
    assert "preflight.accel_noise" not in [f.code for f in known("level").findings]


@pytest.mark.thorough
def test_from_a_campaign():
    text = """
[site]
latitude = "45 deg"
[log]
file = "not_there.csv"
setup = "setup"
time = { column = "time", unit = "s" }
index = { column = "index", unit = "deg" }
gyro = { column = "gyro", unit = "deg/h" }
heading = { column = "heading", unit = "deg" }
[procedure]
name = "north_seeking"
[simulate]
order = [{ index = "0 deg", dwell = "30 s" }, { index = "180 deg", dwell = "30 s" }]
"""
    campaign = reading.parse(text)
    with pytest.raises(FoucaultError, match="that does not show the Earth's rate along two"):
        optimisation.foresee(campaign)
    more = text.replace('"30 s" }]', '"30 s" }, { index = "90 deg" }, { index = "270 deg" }]')
    found = optimisation.foresee(reading.parse(more))
    assert found.plan == "12 set-ups of the stops of the campaign, 4 stops each"
    for wrong, said in (
        ('"palindrom"', "it should be 'published', 'sequential' or 'palindrome'"),
        ('[{ index = "0 deg", dwel = "3 s" }]', "simulate.order.0.dwel is not a key"),
        ('[{ index = "0 deg", dwell = "3" }]', "simulate.order.0.dwell: '3' has no unit"),
        ("[]", "at least 1 item"),
    ):
        head = text[: text.index("order = ")]
        with pytest.raises(FoucaultError, match=said):
            reading.parse(f"{head}order = {wrong}\n")
