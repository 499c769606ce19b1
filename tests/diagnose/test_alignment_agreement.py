"""Methods that contradict one another, and filters that contradict their readings."""

import re
from dataclasses import replace

import numpy as np
import pytest

from foucault.diagnose.alignment import disagreement, innovations
from foucault.errors import FoucaultError
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.rotation import exp
from foucault.navigate.align import align
from foucault.plans.manoeuvres import Rest, Rotate, Start, Straight, Sway
from foucault.procedures.alignment import align_log
from foucault.simulate.motion import simulate_motion
from foucault.tables import Log
from make_alignment import resting
from sessions import codes

SITE = Site.at(np.radians(47.0), 100.0)
NOISE = ImuNoise(TriadNoise(white=2e-4), TriadNoise(white=6e-7))


def _log(plan, *, seed=1, **start) -> Log:
    place = Start(SITE.latitude, 0.1, SITE.height, **start)
    return simulate_motion(plan, place, rate=20.0, noise=NOISE, seed=seed).log


def _creeping(log: Log, distance: float) -> Log:
    """Add a smooth creep along the body's first axis, level, during the whole log [m]."""
    assert log.accel is not None
    accel, pace = log.accel.copy(), np.pi / log.duration
    accel[:, 0] += distance / 2 * pace**2 * np.cos(pace * (log.time - log.time[0]))
    return replace(log, accel=accel)


@pytest.mark.parametrize("seed", range(3))
def test_a_rest_agrees(seed):
    log = _log([Rest(300.0)], seed=seed, heading=1.0)
    assert codes(align_log(log, site=SITE)) == []


@pytest.mark.parametrize(
    ("triad", "size", "grows", "words"),
    [
        ("gyro", np.radians(0.05) / 3600, False, "the bias of a gyro changed"),
        ("gyro", np.radians(0.05) / 3600, True, "the bias of a gyro changed"),
        ("accel", 4e-4, False, "the bias of an accelerometer changed"),
        ("accel", 4e-4, True, "that of an accelerometer began to drift"),
    ],
)
def test_a_bias_that_changes_in_the_rest_is_told(triad, size, grows, words):
    """Headings were 4 to 10 of their standard deviations off, and nothing but sway was noted."""
    log = simulate_motion(
        [Rest(300.0)], Start(SITE.latitude, 0.1, SITE.height, heading=1.0), rate=20.0,
        noise=ImuNoise(TriadNoise(white=5e-5), TriadNoise(white=2e-7)), seed=2,
    ).log  # fmt: skip
    age = log.time - log.time[0]
    course = 2 * age / 300.0 if grows else 1.0 * (age > 140.0)
    x = getattr(log, triad) + size * course[:, None] * [1.0, 0.0, 0.0]
    found = align_log(replace(log, **{triad: x}), site=SITE, end=log.duration)
    (told,) = (f for f in found.findings if f.code == "alignment.step")
    assert words in told.message
    if not grows:
        time = float(re.search(r"at (\d+) s", told.message)[1])
        assert time == pytest.approx(140.0, abs=40.0)


def test_a_steady_drive_is_told():
    """100 m/s all along: nothing moves, as far as the specific force says."""
    log = _log([Straight(300.0)], heading=1.5, speed=100.0)
    found = align_log(log, site=SITE, end=log.duration)
    assert {"alignment.disagree", "alignment.innovations"} <= set(codes(found))
    told = {f.code: f for f in found.findings}
    assert {told[c].severity for c in ("alignment.disagree", "alignment.innovations")} == {
        "warning"
    }
    assert "constant horizontal velocity" in told["alignment.disagree"].cure
    assert "differ by 0." in told["alignment.disagree"].message
    assert "most 1.2" in told["alignment.innovations"].message


@pytest.mark.parametrize("heading", [0.0, 1.5])
def test_a_creep_is_told(heading):
    """To the east, and to the south, where it looks like an error of azimuth."""
    log = _creeping(_log([Rest(300.0)], heading=heading), 30.0)
    assert "alignment.disagree" in codes(align_log(log, site=SITE, end=log.duration))


@pytest.mark.parametrize("declared", [True, False])
def test_sway_is_no_contradiction_and_its_noise_is_found(declared):
    sway = {"angles": (0.001, 0.002, 0.001), "shift": (0.01, 0.01, 0.01), "tones": 3}
    log = _log([Sway(300.0, 4.0, seed=3, **sway)], heading=1.0)
    found = align_log(log, site=SITE, end=log.duration, noise=NOISE if declared else None)
    assert codes(found) == ["alignment.noise"] * (not declared) + ["alignment.sway"]
    assert found.noise.gyro.white == pytest.approx(6e-7, rel=0.1)
    assert found.noise.accel.white == pytest.approx(2e-4, rel=0.1)
    if not declared:
        (told, _) = found.findings
        assert "gyros 0.002 deg/sqrt(h)" in told.message and told.severity == "note"
        assert "--gyro-noise" in told.cure


def _mirrored(log: Log) -> Log:
    assert log.gyro is not None and log.accel is not None
    return replace(log, gyro=log.gyro * [1, -1, 1], accel=log.accel * [1, -1, 1])


def _turned(angle: float, axis: str = "up") -> tuple[Log, tuple[tuple[float, float], ...]]:
    plan = [Rest(120.0), Rotate(axis, angle, 0.2), Rest(120.0)]
    log = _log(plan, heading=0.6, pitch=0.05, roll=-0.1)
    return log, ((0.0, 119.0), (log.duration - 119.0, log.duration))


def test_triads_mirrored_alike():
    """One rest and half a turn about up cannot show it; a quarter does, and a tilt."""
    words = {"site": SITE, "gyro_bias_sd": 1e-7}
    log, rests = _turned(np.pi / 2)
    assert codes(align_log(log, rests=rests, **words)) == []
    assert codes(align_log(_mirrored(log), rests=rests[:1], **words)) == []
    said = codes(align_log(_mirrored(log), rests=rests, **words))
    assert {"alignment.disagree", "alignment.innovations"} & set(said)
    log, rests = _turned(0.7, "x")
    with pytest.raises(FoucaultError) as caught:
        align_log(_mirrored(log), rests=rests, **words)
    assert caught.value.code in ("gyro.axes", "gyro.left_handed")


def test_exact_data_agree():
    """Without noise every covariance is nothing, and rounding is not a contradiction."""
    made, _ = resting(SITE, 120.0, 0.05, 0.7, 0.1, 0.2)
    found = [align(made, SITE, method=m) for m in ("inertial_frame", "kalman", "two_vector")]
    assert disagreement(found) == ()
    off = replace(found[2], C_nb=exp(np.array([0.0, 0.0, 1e-3])) @ found[2].C_nb)
    (told,) = disagreement([*found[:2], off])
    assert "two vectors differ by 0.0573 deg about up" in told.message
    assert disagreement([*found[:2], off], swayed=True) == ()
    assert innovations(found) == ()
