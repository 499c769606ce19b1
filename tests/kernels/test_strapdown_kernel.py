"""The strapdown kernel, compiled and as plain Python, against its twin of matrices."""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np
import pytest

import reference
from foucault.kernels import strapdown as module
from foucault.models import earth
from foucault.models.earth import east_north_up
from foucault.models.rotation import exp
from foucault.navigate.increments import bend_weights
from foucault.navigate.strapdown import matrix_of
from make_strapdown import packed
from plain_kernels import kernel

FORMS = pytest.mark.parametrize("form", ["compiled", "python"])
VERTICAL = {"free": module.FREE, "held": module.HELD, "aided": module.AIDED}
GAINS = np.array([0.03, 3.1e-4, 1e-6])
N = 48


def motion(seed=0, speed=40.0, latitude=0.8):
    """Increments of every size over irregular intervals with gaps, and a start."""
    rng = np.random.default_rng(seed)
    dt = rng.uniform(0.005, 0.015, N)
    dt[10], dt[30] = 0.2, 0.08
    dt[20:25] = 0.01
    size = rng.choice([0.0, 1e-12, 1e-4, 1e-2, np.sqrt(0.05), 0.7, 3.0], N)
    size[:7] = [0.0, 1e-12, 1e-4, np.sqrt(0.05) * (1 - 1e-9), np.sqrt(0.05) * (1 + 1e-9), 0.7, 3.0]
    way = rng.standard_normal((N, 3))
    dtheta = size[:, None] * way / np.linalg.norm(way, axis=1)[:, None]
    dvel = 0.1 * rng.standard_normal((N, 3))
    joined = rng.random(N) > 0.2
    joined[0] = False
    heights = np.where(rng.random(N) > 0.4, 120.0 + rng.standard_normal(N), np.nan)
    velocity = rng.standard_normal(3) * [speed, speed, 3.0]
    start = exp(rng.standard_normal(3)), velocity, east_north_up(latitude, -1.1), 100.0
    return dtheta, dvel, dt, joined, heights, start


def run(form, rows, made, vertical, offset):
    dtheta, dvel, dt, joined, heights, start = made
    aid = heights if vertical == "aided" else np.zeros(0)
    out = np.empty((abs(rows[1] - rows[0]) + 1, 12))
    kernel(form, module, "strapdown")(
        dtheta, dvel, dt, *bend_weights(dt, joined), *rows, packed(start), offset,
        VERTICAL[vertical], aid, GAINS, out,
    )  # fmt: skip
    return out


@cache
def slowly(latitude, rows, vertical):
    """The motion, and what the reference makes of it."""
    made = motion(speed=300.0, latitude=latitude)
    dtheta, dvel, dt, joined, heights, (C_lb, v, C_el, h) = made
    if vertical == "held":
        v = v * [1.0, 1.0, 0.0]
    return made, reference.strapdown_run(
        (C_lb, v, C_el, h), dtheta, dvel, dt, joined, *rows, offset=3e-4, vertical=vertical,
        heights=heights, gains=GAINS,
    )  # fmt: skip


WHOLE, PARTS = [(0, N - 1), (N - 1, 0)], [(7, 31), (31, 7), (5, 5)]


@FORMS
@pytest.mark.parametrize(
    ("latitude", "rows"),
    [*product([0.8, -1.2, np.pi / 2], WHOLE), *product([0.8], PARTS)],
)
@pytest.mark.parametrize("vertical", VERTICAL)
def test_twin(form, latitude, rows, vertical):
    made, want = slowly(latitude, rows, vertical)
    out = run(form, rows, made, vertical, 3e-4)
    assert len(out) == len(want) == abs(rows[1] - rows[0]) + 1
    for x, (C_lb, v, C_el, h) in zip(out, want, strict=True):
        np.testing.assert_allclose(matrix_of(x[:4]), C_lb, rtol=0, atol=1e-13)
        np.testing.assert_allclose(x[4:7], v, rtol=0, atol=3e-12)
        np.testing.assert_allclose(matrix_of(x[7:11]), C_el, rtol=0, atol=1e-13)
        assert abs(x[11] - h) < 1e-12


@FORMS
@pytest.mark.parametrize("vertical", ["free", "held"])
def test_a_step_back_undoes_a_step_forward(form, vertical):
    made = motion(3)
    there = run(form, (0, N - 1), made, vertical, 0.0)
    back = np.empty((N, 12))
    kernel(form, module, "strapdown")(
        *made[:3], *bend_weights(*made[2:4]), N - 1, 0, there[-1], 0.0, VERTICAL[vertical],
        np.zeros(0), GAINS, back,
    )  # fmt: skip
    sign = np.sign(np.sum(back[:, :4] * there[::-1, :4], axis=1))[:, None]
    np.testing.assert_allclose(sign * back[:, :4], there[::-1, :4], rtol=0, atol=1e-13)
    np.testing.assert_allclose(back[:, 4:7], there[::-1, 4:7], rtol=0, atol=1e-12)
    np.testing.assert_allclose(back[:, 7:11], there[::-1, 7:11], rtol=0, atol=1e-14)
    np.testing.assert_allclose(back[:, 11], there[::-1, 11], rtol=0, atol=1e-11)


def test_the_row_before_counts_where_it_is_joined():
    made = motion(1)
    dtheta, joined = made[0], made[3]
    joined[:] = True
    on = run("compiled", (3, 4), made, "free", 0.0)
    joined[:] = False
    off = run("compiled", (3, 4), made, "free", 0.0)
    assert np.abs(on[-1, :7] - off[-1, :7]).max() > 1e-6
    dtheta[[3, 5]] += 1e30  # never looked at where it is not joined
    np.testing.assert_array_equal(run("compiled", (3, 4), made, "free", 0.0), off)


@FORMS
@pytest.mark.parametrize("rows", [(0, N - 1), (N - 1, 0)])
def test_what_is_not_a_number_stays_so(form, rows):
    made = motion(2)
    made[0][20, 1] = np.nan
    out = run(form, rows, made, "free", 0.0)
    good = np.isfinite(out).all(axis=1)
    first = 20 if rows[0] == 0 else N - 20
    # The intervals beside the bad one suffer too, where they are joined to it.
    first -= int(made[3][20 if rows[0] == 0 else 21])
    assert good[:first].all() and not good[first:].any()


def test_quaternions_stay_of_length_one():
    n = 200_000
    rng, dt = np.random.default_rng(4), np.full(n, 0.01)
    out = np.empty((n, 12))
    module.strapdown(
        0.1 * rng.standard_normal((n, 3)), 0.1 * rng.standard_normal((n, 3)), dt,
        *bend_weights(dt, np.ones(n, bool)), 0, n - 1, packed(motion()[5]), 0.0, module.HELD,
        np.zeros(0), GAINS, out,
    )  # fmt: skip
    for part in (slice(0, 4), slice(7, 11)):
        np.testing.assert_allclose(np.linalg.norm(out[:, part], axis=1), 1.0, rtol=0, atol=1e-12)


def test_the_figures_of_the_earth_are_those_of_the_model():
    polar = earth.SEMI_MAJOR_AXIS * (1 - earth.FLATTENING)
    m = (earth.EARTH_RATE * earth.SEMI_MAJOR_AXIS) ** 2 * polar / earth.GRAVITATIONAL_CONSTANT
    found = (module.A, module.E2, module.W_IE, module.G_EQUATOR, module.SOMIGLIANA,
             module.FLATTENING, module.CENTRIFUGAL)  # fmt: skip
    wanted = (earth.SEMI_MAJOR_AXIS, earth.ECCENTRICITY_SQUARED, earth.EARTH_RATE,
              earth.EQUATORIAL_GRAVITY, earth._SOMIGLIANA, earth.FLATTENING, m)  # fmt: skip
    np.testing.assert_allclose(found, wanted, rtol=1e-12)


@FORMS
@pytest.mark.parametrize("latitude", [0.0, 0.6, -1.3, np.pi / 2])
@pytest.mark.parametrize("height", [-300.0, 0.0, 2e4])
def test_curvature_and_gravity(form, latitude, height):
    c0, c1, g = kernel(form, module, "curvature")(np.sin(latitude), height)
    RM, RN = earth.radii(latitude)
    north = c0 + c1 * np.cos(latitude) ** 2
    np.testing.assert_allclose([1 / c0, 1 / north], [RN + height, RM + height], rtol=1e-14)
    np.testing.assert_allclose(g, earth.gravity(latitude, height), rtol=1e-13)


@FORMS
@pytest.mark.parametrize("angle", [0.0, 1e-200, 1e-9, 0.1, 0.2236, 0.2237, 2.0, 6.0])
def test_half_rotation(form, angle):
    c, s = kernel(form, module, "half_rotation")(angle * angle)
    np.testing.assert_allclose(c, np.cos(angle / 2), rtol=1e-14)
    np.testing.assert_allclose(s, np.sinc(angle / 2 / np.pi) / 2, rtol=1e-14)
