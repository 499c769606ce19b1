"""The kernels of north seeking, compiled and as plain Python, against their obvious twins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

import reference
from foucault.estimate.north import Known, solve
from foucault.estimate.north_reduction import Nuisance, reduce
from foucault.kernels import north_likelihood
from foucault.kernels import north_seeking as module
from foucault.models.earth import EARTH_RATE, Site, gravity
from foucault.models.imu import ImuModel
from foucault.models.left_out import GRAVITY, Term, changes, sizes_of
from foucault.models.north_seeker import attitude, earth_rate_b, up_b
from foucault.procedures.north_seeking.counted import added, moved, put
from foucault.procedures.north_seeking.field import Terms
from make_dwells import (
    DEG_H,
    FIELD,
    PALINDROME,
    SIX,
    attitudes,
    errors,
    four_numbers,
    make_dwells,
    turn,
)
from plain_kernels import kernel

FORMS = pytest.mark.parametrize("form", ["compiled", "python"])
NAN = float("nan")


def truth_of(angles, known):
    """Rate and specific force in the case at these angles."""
    return earth_rate_b(*angles.T), known.gravity * up_b(angles[:, 1], angles[:, 2])


# -- the closed form ---------------------------------------------------------------------------


def closed(form, rate, up, latitude, sign=1.0, rate_var=1e-14, tilt_var=1e-10, latitude_var=0.0):
    n = len(rate)
    angles, sd, status = np.empty((n, 4)), np.empty((n, 4)), np.empty(n, np.int8)
    kernel(form, module, "closed_form_batch")(
        rate.ravel(), up.ravel(), latitude, sign, EARTH_RATE, rate_var, tilt_var, latitude_var,
        angles.ravel(), sd.ravel(), status,
    )  # fmt: skip
    return angles, sd, status


def said(n=30, latitude=0.7, tilt=40.0, noise=1e-3, seed=2):
    """Rates and ups of set-ups, with so much noise that formulas and truth differ."""
    four = four_numbers(attitudes(n, tilt, seed), latitude)
    four = four / np.array([EARTH_RATE, EARTH_RATE, *2 * [gravity(latitude)]])
    four += noise * np.random.default_rng(seed).standard_normal(four.shape)
    return four[:, :2] * EARTH_RATE, four[:, 2:]


@FORMS
@pytest.mark.parametrize(("latitude", "sign"), [(0.7, 1.0), (-0.9, 1.0), (NAN, 1.0), (NAN, -1.0)])
def test_closed_form_is_the_printed_one(form, latitude, sign):
    rate, up = said(latitude=0.7 * sign if np.isnan(latitude) else latitude)
    angles, _, status = closed(form, rate, up, latitude, sign)
    assert not status.any()
    for k in range(len(rate)):
        want = reference.printed_fix(*rate[k] / EARTH_RATE, *up[k], latitude, sign)
        assert abs(turn(angles[k, 0], want[0])) < 1e-12
        np.testing.assert_allclose(angles[k, 1:], want[1:], atol=1e-12)


@FORMS
@pytest.mark.parametrize("latitude", [0.7, NAN])
def test_its_standard_deviations_are_those_of_its_slopes(form, latitude):
    """Slopes of the twin, by differences; the latitude's own uncertainty among them."""
    rate, up = said(12)
    rate_sd, up_sd, latitude_sd = 2e-3 * EARTH_RATE, 1e-4, 3e-3
    var = (rate_sd**2, up_sd**2, latitude_sd**2)
    _, sd, _ = closed(form, rate, up, latitude, 1.0, *var)
    h = 1e-6
    for k in range(len(rate)):
        x = np.array([*rate[k] / EARTH_RATE, *up[k], latitude])
        spread = np.array([rate_sd / EARTH_RATE] * 2 + [up_sd] * 2 + [latitude_sd])
        variance = np.zeros(4)
        for p in range(4 if np.isnan(latitude) else 5):
            step = h * np.eye(5)[p]
            ends = [reference.printed_fix(*(x + s * step), 1.0) for s in (1.0, -1.0)]
            variance += (turn(*ends) / (2 * h) * spread[p]) ** 2
        np.testing.assert_allclose(sd[k], np.sqrt(variance), rtol=1e-6)


@FORMS
def test_closed_form_clamps_flags_and_goes_on(form):
    """More rate than the Earth's, a tilt of 90 deg, and readings that are no numbers."""
    rate, up = said(8, noise=0.0)
    rate[1] = EARTH_RATE * np.array([0.9, -0.6])
    up[2] = [0.8, 0.7]
    up[3] = [0.0, 1.0]
    rate[4, 0], up[5, 1], rate[6, 1] = np.nan, np.nan, np.inf
    angles, sd, status = closed(form, rate, up, NAN)
    want = [module.SOLVED, module.CLAMPED, module.SINGULAR, module.SINGULAR]
    assert list(status) == [*want, *3 * [module.NOT_FINITE], module.SOLVED]
    assert np.isnan(angles[2:7]).all() and np.isnan(sd[2:7]).all()
    twin = reference.printed_fix(0.9, -0.6, *up[1], NAN, 1.0)
    np.testing.assert_allclose(angles[1], twin, atol=1e-12)
    assert np.isinf(sd[1, [0, 3]]).all() and np.isfinite(sd[1, 1:3]).all()
    good = [0, 7]
    alone = closed(form, rate[good], up[good], NAN)
    for together, one in zip((angles, sd, status), alone, strict=True):
        np.testing.assert_array_equal(together[good], one)
    # With the latitude known, M and N beyond 1 are not clamped: nothing depends on their norm.
    assert closed(form, rate[1:2], up[1:2], 0.7)[2] == module.SOLVED


# -- maximum likelihood --------------------------------------------------------------------------


def problem(n=3, latitude=0.8, tilt=30.0, seed=4, instrument=None):
    """Four numbers with noise, a full covariance each, and starts some degrees off.

    Nowhere is the rate along z small: there the slopes are not those of a straight line.
    """
    rng = np.random.default_rng(seed)
    poses = attitudes(n, tilt, seed)
    instrument = instrument or errors(seed=seed)
    size = np.array([1e-3 * EARTH_RATE, 1e-3 * EARTH_RATE, 2e-3, 2e-3])
    mix = rng.standard_normal((n, 4, 6))
    cov = mix @ np.swapaxes(mix, 1, 2) * np.outer(size, size)
    noise = np.linalg.cholesky(cov) @ rng.standard_normal((n, 4, 1))
    y = four_numbers(poses, latitude, instrument) + noise[..., 0]
    truth = np.column_stack([poses, np.full(n, latitude)])
    model = instrument.model
    A = np.vstack([model.gyro_matrix[:2], model.accel_matrix[:2]])
    b = np.concatenate([model.gyro_bias[:2], model.accel_bias[:2]])
    start = truth + 0.02 * rng.standard_normal((n, 4))
    return y, cov, start, np.ascontiguousarray(A), b, np.full(n, gravity(latitude))


def likely(form, y, cov, start, A, b, g, latitude, sd, rounds=60):
    """Return angles, covariance, gain, sum of squares, status; the next best and its rank."""
    n, starts = len(y), start if start.ndim == 3 else start[None]
    angles, P, gain, square = (np.empty((n, *s)) for s in ((4,), (4, 4), (4, 5), ()))
    rank, other, other_rank, status = np.empty(n), np.empty((n, 4)), np.empty(n), np.empty(n, "i1")
    kernel(form, north_likelihood, "likelihood_batch")(
        y, cov, np.ascontiguousarray(starts), A, b, g, EARTH_RATE, np.full(n, latitude),
        np.full(n, sd), 1.0, np.full(n, NAN), 0.1, rounds,
        angles, P, gain, square, rank, other, other_rank, status,
    )  # fmt: skip
    return angles, P, gain, square, status, other, other_rank


def predicted(angles, A, b, g):
    """Return the four numbers that solutions predict."""
    each = (reference.north_prediction(x, EARTH_RATE, k) for x, k in zip(angles, g, strict=True))
    return np.array([np.concatenate([A[:2] @ w, A[2:] @ f]) + b for w, f in each])


@FORMS
@pytest.mark.parametrize("sd", [1e-9, 2e-3, np.inf])
def test_likelihood_is_the_minimum_with_its_covariance(form, sd):
    y, cov, start, A, b, g = problem()
    latitude = 0.8005
    if sd < 1e-6:
        start[:, 3] = latitude  # the twin's general method takes no step along so steep a valley
    angles, P, _, square, status, _, _ = likely(form, y, cov, start, A, b, g, latitude, sd)
    assert not status.any()
    for k in range(len(y)):
        x, want, least = reference.north_likelihood(
            y[k], cov[k], start[k], A, b, g[k], EARTH_RATE, latitude, sd
        )
        scale = np.sqrt(np.diag(want))
        assert np.abs(turn(angles[k], x) / scale).max() < 2e-5
        # The twin's last slope is a difference divided by a very small sd.
        np.testing.assert_allclose(P[k] / np.outer(scale, scale), want / np.outer(scale, scale),
                                   atol=1e-6)  # fmt: skip
        assert square[k] == pytest.approx(least, abs=1e-6)


@FORMS
@pytest.mark.parametrize("sd", [2e-3, np.inf])
def test_its_gain_is_the_slope_of_the_solution(form, sd):
    """Exact only where the misfit is small: moved data are readings that fit."""
    y, cov, start, A, b, g = problem(3)
    latitude = 0.8
    angles, P, gain, *_ = likely(form, y, cov, start, A, b, g, latitude, sd)
    fit = predicted(angles, A, b, g)
    place = angles[:, 3].copy()
    base = [likely(form, fit[k : k + 1], cov[k : k + 1], angles[k : k + 1], A, b, g[:1], place[k],
                   sd)[0][0] for k in range(3)]  # fmt: skip
    np.testing.assert_allclose(turn(np.array(base), angles), 0.0, atol=1e-9)
    assert np.isfinite(sd) or not gain[..., 4].any()
    for p in range(5 if np.isfinite(sd) else 4):
        for k in range(3):
            h = 0.01 * np.sqrt(cov[k, p, p]) if p < 4 else 1e-5
            ends = []
            for sign in (1.0, -1.0):
                moved, where = fit[k : k + 1].copy(), place[k]
                if p < 4:
                    moved[0, p] += sign * h
                else:
                    where += sign * h
                ends.append(likely(form, moved, cov[k : k + 1], angles[k : k + 1], A, b, g[:1],
                                   where, sd)[0][0])  # fmt: skip
            numeric = turn(*ends) / (2 * h)
            scale = np.sqrt(np.diag(P[k])) / (np.sqrt(cov[k, p, p]) if p < 4 else sd)
            np.testing.assert_allclose(numeric / scale, gain[k, :, p] / scale, atol=2e-4)


@FORMS
def test_likelihood_returns_bad_rows_as_status(form):
    y, cov, start, A, b, g = problem(7)
    y[1, 2] = np.nan
    start[2, 0] = np.inf
    cov[3] = 0.0
    cov[4, 0, 0] = np.nan
    A = np.eye(3)[[0, 1, 0, 1]]
    # Only gravity counts: nothing shows the heading, to rounding.
    cov[5] = np.diag([1e30, 1e30, 1e-6, 1e-6])
    found = likely(form, y, cov, start, A, b, g, 0.8, np.inf)
    angles, P, gain, square, status, _, _ = found
    assert list(status[1:5]) == 4 * [module.NOT_FINITE]
    for out in (angles, P, gain, square):
        assert np.isnan(out[1:5]).all() and np.isfinite(out[[0, 6]]).all()
    assert status[0] == status[6] == module.SOLVED
    alone = likely(form, y[6:], cov[6:], start[6:], A, b, g[6:], 0.8, np.inf)
    for together, one in zip(found, alone, strict=True):
        np.testing.assert_array_equal(together[6:], one)


@FORMS
def test_likelihood_says_what_is_singular_and_what_did_not_converge(form):
    y, cov, start, A, b, g = problem(2)
    blind = np.zeros((4, 3))  # nothing is measured: no slope at all
    assert list(likely(form, y, cov, start, blind, b, g, 0.8, np.inf)[4]) == 2 * [module.SINGULAR]
    start[:, 0] += 1.0
    assert list(likely(form, y, cov, start, A, b, g, 0.8, 1e-3, rounds=1)[4]) == (
        2 * [module.NOT_CONVERGED]
    )
    assert not likely(form, y, cov, start, A, b, g, 0.8, 1e-3)[4].any()


@FORMS
def test_a_latitude_over_the_pole_comes_back(form):
    """The same rate in the case, with the heading turned by 180 deg."""
    y, cov, start, A, b, g = problem(4, latitude=1.5)
    beyond = start.copy()
    beyond[:, 3] = np.pi - start[:, 3]
    beyond[:, 0] += np.pi
    want = likely(form, y, cov, start, A, b, g, 1.5, np.inf)
    found = likely(form, y, cov, beyond, A, b, g, 1.5, np.inf)
    assert (np.abs(found[0][:, 3]) <= np.pi / 2).all()
    np.testing.assert_allclose(turn(found[0], want[0]), 0.0, atol=1e-7)


@FORMS
def test_of_several_starts_the_best_counts_and_the_next_best_is_another(form):
    """From the two signs of the rate along z, in any order; twice the same is no other one."""
    y, cov, start, A, b, g = problem(6)
    mirrored = start.copy()
    mirrored[:, 3] = -start[:, 3]
    one, two = (likely(form, y, cov, x, A, b, g, 0.8, 0.5) for x in (start, mirrored))
    for starts in (np.stack([start, mirrored]), np.stack([mirrored, start])):
        found = likely(form, y, cov, starts, A, b, g, 0.8, 0.5)
        better = one[3] <= two[3]
        want = np.where(better[:, None], one[0], two[0])
        np.testing.assert_allclose(turn(found[0], want), 0.0, atol=1e-7)
        apart = np.abs(one[0] - two[0])[:, [0, 3]].max(axis=1) > 1e-5
        assert apart.any()
        less = np.where(better[:, None], two[0], one[0])[apart]
        np.testing.assert_allclose(turn(found[5][apart], less), 0.0, atol=1e-7)
        np.testing.assert_allclose(found[6][apart], np.maximum(one[3], two[3])[apart], rtol=1e-6)
    same = likely(form, y, cov, np.stack([start, start]), A, b, g, 0.8, 0.5)
    assert np.isnan(same[5]).all() and np.isinf(same[6]).all()


def test_compiled_and_plain_agree():
    y, cov, start, A, b, g = problem(20)
    for sd in (1e-3, np.inf):
        a, p = (likely(form, y, cov, start, A, b, g, 0.8, sd) for form in ("compiled", "python"))
        np.testing.assert_allclose(turn(a[0], p[0]), 0.0, atol=1e-9)
        np.testing.assert_allclose(a[1], p[1], rtol=1e-6, atol=1e-14)
        np.testing.assert_array_equal(a[4], p[4])


# -- what is not estimated ----------------------------------------------------------------------


def slopes(angles, A, g):
    """Slopes of the four numbers against East, North, Up and the latitude, by differences."""
    h = 1e-6

    def at(turned, latitude):
        C = attitude(*angles[:3]) @ expm(reference.cross(turned))
        w = EARTH_RATE * (np.cos(latitude) * C[:, 1] + np.sin(latitude) * C[:, 2])
        return np.concatenate([A[:2] @ w, A[2:] @ (g * C[:, 2])])

    moved = [at(s * h * np.eye(4)[p][:3], angles[3] + s * h * (p == 3)) for p in range(4)
             for s in (1.0, -1.0)]  # fmt: skip
    return np.stack([(moved[2 * p] - moved[2 * p + 1]) / (2 * h) for p in range(4)], 1)


@FORMS
@pytest.mark.parametrize("case", [False, True])
def test_what_terms_do_is_what_they_do_to_every_reading(form, case):
    dwells = make_dwells(attitudes(3, 20.0, 2), 0.7, stops=PALINDROME, noise=FIELD, seed=4)
    if case:
        dwells = replace(dwells, accel=np.tile(dwells.accel, (1, 2)))
    pairs = reduce(dwells, FIELD, Nuisance())
    angles = solve(pairs, Known(9.8, 0.7)).angles
    own = Terms.of((), Site(gravity=9.8, gravity_sd=1e-3), sizes_of("tactical MEMS"), case)
    w, f = truth_of(angles, Known(9.8, 0.7))
    begin, end = float(dwells.start.min()), float((dwells.start + dwells.time).max())
    ramp = (dwells.start + dwells.time / 2 - begin) / (end - begin) - 0.5
    instrument = errors(seed=3).model
    B = np.empty((3, 4, len(own.size)))
    kernel(form, module, "left_batch")(
        angles, np.full(3, 9.8), EARTH_RATE, instrument.accel_matrix[:2],
        np.searchsorted(dwells.setup, np.arange(4)), dwells.cosine, dwells.sine, ramp,
        pairs.gyro_weights, pairs.accel_weights, case, own.sensor, own.factors, own.size, B,
    )  # fmt: skip
    force, felt = own.sensor > 0, []
    more = np.empty((*dwells.accel.shape, int(force.sum())))
    kernel(form, module, "felt_batch")(
        f, dwells.setup, dwells.cosine, dwells.sine, ramp, case, own.sensor[force],
        own.factors[force], own.size[force], more,
    )  # fmt: skip
    motion, seen = moved(dwells, f, w), 0
    for group, at in own.columns.items():
        if group == GRAVITY:
            heavier = f * own.size[at] / 9.8 @ instrument.accel_matrix[:2].T
            np.testing.assert_allclose(B[:, 2:, at.start], heavier, rtol=1e-12)
            assert not B[:, :2, at].any()
            continue
        some = [Term(own.names[group][k], group, size)
                for k, size in zip(own.felt[group], own.size[at], strict=True)]  # fmt: skip
        here = motion
        if group.startswith("gyro"):
            n = len(dwells)
            here = motion._replace(time=motion.time[:n], f_b=motion.f_b[:n],
                                   w_ib_b=motion.w_ib_b[:n])  # fmt: skip
        read = [*changes(some, ImuModel(), here)]
        want = added(pairs, dwells, read)
        most = max(np.abs(x).max() for one in read for x in one[:2] if x is not None)
        np.testing.assert_allclose(B[:, :, at], want, rtol=1e-9, atol=1e-13 * most)
        seen += bool(want.any())
        felt += [put(dwells, one)[1] for one in read if one.accel is not None]
    assert seen > 6
    np.testing.assert_allclose(more, np.stack(felt, 2), rtol=1e-12, atol=1e-18)


@FORMS
@pytest.mark.parametrize("latitude_sd", [0.0, 2e-3])
def test_the_number_across_is_what_no_attitude_explains(form, latitude_sd):
    y, cov, _, A, b, g = problem(3)
    angles = np.column_stack([attitudes(3, 30.0, 4), np.full(3, 0.8)])
    rng = np.random.default_rng(1)
    B, T = rng.standard_normal((3, 4, 5)), rng.standard_normal((3, 4, 4))
    out, without = np.empty((3, 7)), np.empty((3, 6))
    for room in (out, without):
        kernel(form, module, "across_batch")(
            y, cov, angles, A, b, g, EARTH_RATE, np.full(3, latitude_sd), T, B[:, :, :2].copy(),
            B[:, :, 2:].copy(), 3.0, room,
        )  # fmt: skip
    assert out[:, :6].tobytes() == without.tobytes()
    out = np.column_stack([out[:, 0], out[:, 6] / 3.0, out[:, 1:6]])
    for k in range(3):
        w, f = reference.north_prediction(angles[k], EARTH_RATE, g[k])
        J = slopes(angles[k], A, g[k])
        want = reference.north_across(y[k], cov[k], w, f, J, A, b, latitude_sd, T[k], B[k])
        sign = np.sign(want[1] * out[k, 1])
        np.testing.assert_allclose(out[k], sign * want, rtol=1e-6, atol=1e-9)


@FORMS
def test_what_a_calibration_leaves_is_its_slopes_times_its_root(form, monkeypatch):
    monkeypatch.setattr(module, "calibration_batch", kernel(form, module, "calibration_batch"))
    instrument, known = errors(seed=2), Known(9.8, 0.7)
    angles = np.column_stack([attitudes(4, 30.0, 4), np.full(4, 0.7)])
    rng = np.random.default_rng(1)
    root = rng.standard_normal((len(instrument.coefficients), 3))
    T = rng.standard_normal((4, 4, 4))
    found, part = (instrument.spread(angles, 9.8, root, share) for share in (None, T))
    want = instrument.slopes(*truth_of(angles, known)) @ root
    np.testing.assert_allclose(found, want, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(part, T @ want, rtol=1e-11, atol=1e-14)


@FORMS
def test_shares_are_those_of_every_covariance_and_their_sum_that_of_all(form):
    rng = np.random.default_rng(3)
    S = rng.standard_normal((2, 3, 4, 4))
    S = S @ np.swapaxes(S, 2, 3)
    B, gain = rng.standard_normal((3, 4, 5)), rng.standard_normal((3, 4, 5))
    cov, out = np.empty((3, 4, 4)), np.empty((4, 3, 4))
    kernel(form, module, "together_batch")(S, B, cov)
    kernel(form, module, "shares_batch")(gain, S, B, np.array([0, 2, 5]), out)
    np.testing.assert_allclose(cov, S.sum(axis=0) + B @ np.swapaxes(B, 1, 2), rtol=1e-12)
    for k in range(3):
        want = reference.north_shares(gain[k], S[:, k], [B[k, :, :2], B[k, :, 2:]])
        np.testing.assert_allclose(out[:, k], want, rtol=1e-12)
        total = gain[k, :, :4] @ cov[k] @ gain[k, :, :4].T
        np.testing.assert_allclose(out[:, k].sum(axis=0), np.diag(total), rtol=1e-12)


# -- all readings, not the four numbers ----------------------------------------------------------


@pytest.mark.parametrize("mode", ["known", "rough", "unknown"])
@pytest.mark.parametrize("drift_sd", [0.0, np.inf])
def test_four_numbers_say_all_that_the_readings_say(mode, drift_sd):
    """Least squares over every reading, with offset, drift and accelerometer offset unknown."""
    latitude = 0.7
    stops = PALINDROME if drift_sd else SIX
    ours = errors(seed=8)
    dwells = make_dwells(
        attitudes(2, 40.0, 6), latitude, stops=stops, instrument=ours, offset=3e-6,
        drift=1e-9 if drift_sd else 0.0, accel_offset=0.02, noise=FIELD, seed=7,
    )  # fmt: skip
    sd = {"known": 0.0, "rough": 5e-4, "unknown": np.inf}[mode]
    place = None if mode == "unknown" else latitude + 3e-4
    g = gravity(latitude)
    pairs = reduce(dwells, FIELD, Nuisance(drift_sd=drift_sd))
    fixes = solve(pairs, Known(g, place, 0.0 if mode == "unknown" else sd), ours)
    model = ours.model
    for k in range(2):
        d = dwells.of(k)
        e = np.column_stack([d.sine, d.cosine])
        t = d.start + d.time / 2
        t = t - t.mean()
        white = [n.white / np.sqrt(d.time) for n in (FIELD.gyro, FIELD.accel)]

        def left(u, d=d, e=e, t=t, white=white):
            angles = u[:4] if mode != "known" else np.append(u[:3], place)
            w, f = reference.north_prediction(angles, EARTH_RATE, g)
            more = u[4:] if mode != "known" else u[3:]
            rate = e @ (model.gyro_matrix @ w + model.gyro_bias)[:2] + 1e-6 * more[0]
            if drift_sd:
                rate = rate + 1e-9 * more[2] * t
            force = e @ (model.accel_matrix @ f + model.accel_bias)[:2] + more[1]
            out = np.concatenate([(d.gyro - rate) / white[0], (d.accel[:, 0] - force) / white[1]])
            return np.append(out, (place - u[3]) / sd) if mode == "rough" else out

        free = 3 if mode == "known" else 4
        start = np.concatenate([fixes.angles[k, :free] + 1e-3, np.zeros(2 + bool(drift_sd))])
        x, cov, least = reference.north_minimum(left, start)
        scale = np.sqrt(np.diag(cov))[:free]
        assert np.abs(turn(fixes.angles[k, :free], x[:free]) / scale).max() < 1e-4
        np.testing.assert_allclose(
            fixes.cov[k, :free, :free] / np.outer(scale, scale),
            cov[:free, :free] / np.outer(scale, scale), atol=1e-5,
        )  # fmt: skip
        total = fixes.square[k] + pairs.chi_square[k].sum()
        assert total == pytest.approx(least, rel=1e-5)
        # Seen in the set-up itself: c, s and offset are the best for gyro readings alone, so the
        # offset of the whole fit is near, not equal.
        near = DEG_H if mode != "known" else 2 * DEG_H
        assert abs(pairs.offset[k] - 1e-6 * x[free]) < near
