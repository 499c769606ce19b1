"""Where a rest ends, what comes after it, and references with blank cells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.logs import reference as references
from foucault.plans.manoeuvres import Rest
from foucault.procedures.alignment import align_log
from foucault.procedures.navigation import navigate_log
from foucault.procedures.navigation.start import Settings
from make_navigation import DRIVE, LONGITUDE, SITE, errors, logged, reference_of
from refusals import refuses

TRUE, FOUND = errors()


@pytest.fixture(scope="module")
def driven():
    return logged(DRIVE[:4], TRUE)


def spun(sampled: str):
    """Return a log of 60 s of rest, then at once 30 deg/s."""
    log = logged([Rest(90.0)]).log
    gyro = log.gyro.copy()
    gyro[log.time >= log.time[0] + 60.0 - 1e-9] += np.radians([0.0, 0.0, 30.0])
    return replace(log, gyro=gyro, sampled=sampled)


@pytest.mark.parametrize("sampled", ["increment", "rate"])
def test_a_rest_that_is_said_does_not_take_the_first_sample_of_the_spin(sampled: str):
    log, turned = logged([Rest(90.0)]).log, spun(sampled)
    still = align_log(replace(log, sampled=sampled), site=SITE, end=60.0, methods=["two_vector"])
    found = align_log(turned, site=SITE, end=60.0, methods=["two_vector"])
    np.testing.assert_allclose(found.found[0].C_nb, still.found[0].C_nb, atol=1e-9)
    words = {"site": SITE, "longitude": LONGITUDE, "settings": Settings(align=60.0)}
    start = navigate_log(turned, **words).runs[0].start
    quiet = navigate_log(replace(log, sampled=sampled), **words).runs[0].start
    np.testing.assert_allclose(start.C_nb, quiet.C_nb, atol=1e-9)


def test_a_gap_after_the_window_is_none_of_an_alignment():
    log = logged([Rest(90.0)]).log
    torn = log[np.flatnonzero((log.time < 70.0) | (log.time > 75.0))]
    assert align_log(torn, site=SITE, end=60.0, methods=["two_vector"]).found
    with refuses("strapdown.gap"):
        align_log(torn, site=SITE, end=80.0, methods=["two_vector"])


def test_blank_cells_of_a_reference_are_no_measurement(driven, tmp_path):
    """Positions at 1 Hz beside rows at 20 Hz: the same as the positions alone."""
    log, t = driven.log, driven.truth
    sparse = reference_of(driven, 20, velocity_n=None, angles=None)
    path = tmp_path / "gnss.csv"
    cells = np.column_stack([t.time, *np.degrees([t.latitude, t.longitude]), t.height])
    lines = ["time (s),latitude (deg),longitude (deg),height (m)"]
    lines += [",".join(f"{x:.10f}" for x in row) if k % 20 == 0 else f"{row[0]:.10f},,,"
              for k, row in enumerate(cells)]  # fmt: skip
    path.write_text("\n".join(lines) + "\n", "utf-8")
    blank = references.read(path)
    found = navigate_log(log, reference=blank).runs[0].errors
    alone = navigate_log(log, reference=sparse).runs[0].errors
    np.testing.assert_allclose(found.time, alone.time, atol=1e-6)
    np.testing.assert_allclose(found.position, alone.position, atol=1e-3)
    assert np.isfinite(found.position).all()


def test_a_blank_velocity_is_not_zero(driven):
    whole = reference_of(driven, 20)
    v = whole.velocity_n.copy()
    at = int(np.searchsorted(whole.time, 150.0))
    v[at] = np.nan
    part = replace(whole, velocity_n=v)
    np.testing.assert_allclose(part.velocity(whole.time[at]),
                               whole.velocity(float(whole.time[at])), atol=2.0)  # fmt: skip
    assert np.linalg.norm(part.velocity(float(whole.time[at]))) > 5.0


@pytest.mark.parametrize("triad", ["gyro", "accel"])
def test_sensors_that_read_nothing_are_named(triad: str):
    log = logged([Rest(60.0)]).log
    dead = replace(log, **{triad: np.zeros_like(log.gyro)})
    for run in (lambda: align_log(dead, site=SITE),
                lambda: navigate_log(dead, site=SITE, longitude=LONGITUDE)):  # fmt: skip
        with refuses("strapdown.zero") as caught:
            run()
        assert f"All readings of the {triad} are zero." in str(caught.value)
