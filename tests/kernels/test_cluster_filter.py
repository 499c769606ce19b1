"""The published filter of a tumble, compiled and as plain Python, against its dense twin."""

from __future__ import annotations

import numpy as np
import pytest

import reference
from foucault.kernels import cluster_filter as module
from foucault.kernels import cluster_transition as parts
from foucault.models.cluster import angle_rates, angles_of, attitude_of
from foucault.models.earth import earth_rate_n
from make_cluster import G, make_cluster
from plain_kernels import kernel

FORMS = pytest.mark.parametrize("form", ["compiled", "python"])
W_N = earth_rate_n(0.7)
Q = 1.2e-16
ARMS = np.array([[0.05, 0.01, 0.0], [0.0, 0.05, -0.02], [0.03, 0.0, 0.05]])
START = np.array([0.3, -0.2, 1.1])
SIZE = np.abs(make_cluster(5).packed(G)) + 1e-7


def recorded(n, seed=1, noise=1e-6, dt=0.2):
    """A cluster that turns faster than it would, so that everything shows in a short log."""
    rng = np.random.default_rng(seed)
    command = 0.02 * rng.standard_normal((n // 10 + 1, 3)).repeat(10, axis=0)[:n]
    model = make_cluster(seed)
    C_pn = reference.cluster_exponential(
        model, G, attitude_of(START), command, np.zeros((n, 3)), W_N, dt
    )  # fmt: skip
    z = reference.cluster_readings(model, G, C_pn, command, np.zeros((n, 3)), ARMS, 1.0) / G
    return model.packed(G), command, z + noise * rng.standard_normal((n, 3)), C_pn[-1]


def filtered(form, command, z, x, P, kind=parts.FREE_ANGLES, full=True, iterations=1, **more):
    n, m = len(z), more.get("moments", len(z))
    R = more.get("R", np.full((n, 3), 1e-10))
    used, mean = more.get("used", np.ones(n, bool)), more.get("mean", False)
    after = np.linspace(n / m, n, m).astype(np.int64)
    estimate, sd, nis = np.zeros((m, 45)), np.zeros((m, 45)), np.zeros(m)
    count = np.zeros(m, np.int64)
    out = kernel(form, module, "run")(
        more.get("dt", np.full(n, 0.2)), command, z, used, R, mean, x, P, W_N, np.full(3, Q), ARMS,
        G, kind, full, iterations, after, estimate, sd, nis, count,
    )  # fmt: skip
    return out, estimate, sd, nis, count


def believed(angle=0.02, scale=1.0):
    """A start that is wrong, and how wrong it may be."""
    x = np.concatenate([np.zeros(42), START + angle * np.array([1.0, -0.7, 0.5])])
    return x, np.diag(scale**2 * np.concatenate([SIZE**2, np.full(3, angle**2)]))


def twin_log(command, z, r=1e-10, dt=0.2):
    return [(dt, c, row, np.full(3, r)) for c, row in zip(command, z, strict=True)]


@pytest.mark.thorough
@FORMS
@pytest.mark.parametrize("full", [True, False])
def test_it_is_the_dense_filter(form, full):
    """With noise that leaves digits to both: a covariance loses as many as R is below P."""
    n = 12 if form == "python" else 24
    _, command, z, _ = recorded(n, noise=1e-4)
    x, P = believed()
    R = np.full((n, 3), 1e-8)
    out, estimate, sd, nis, count = filtered(form, command, z, x, P, full=full, iterations=5, R=R)
    states, covs, squares = reference.published_filter(
        twin_log(command, z, 1e-8), x, P, W_N, Q, ARMS, G, full, 5
    )
    assert out[:3] == (parts.RUNNING, n, n) and (count == 3).all()
    spread = np.sqrt(np.einsum("kii->ki", covs))
    np.testing.assert_allclose(sd, spread, rtol=1e-9)
    assert np.max(np.abs(estimate - states) / spread) < 1e-6
    np.testing.assert_allclose(nis, squares, rtol=1e-6, atol=1e-9)
    got = out[6][:, :45]
    np.testing.assert_array_equal(got, got.T)
    assert np.max(np.abs(got - covs[-1]) / np.outer(spread[-1], spread[-1])) < 1e-9


@pytest.mark.thorough
@FORMS
@pytest.mark.parametrize("kind", [parts.PLANNED, parts.INTEGRATED])
def test_a_misalignment_is_not_fed_back(form, kind):
    n = 20 if form == "compiled" else 8
    _, command, z, _ = recorded(n)
    x, P = believed(0.001)
    out, estimate, sd, nis, _ = filtered(form, command, z, x, P, kind)
    theta, C_pn, cov, squares = reference.misalignment_filter(
        twin_log(command, z), x, P, W_N, Q, ARMS, G, kind == parts.INTEGRATED
    )
    spread = np.sqrt(np.diag(cov))
    assert out[0] == parts.RUNNING
    assert np.max(np.abs(out[4][:42] + out[5][:42] - theta) / spread[:42]) < 1e-6
    assert np.max(np.abs(out[6][:, :45] - cov) / np.outer(spread, spread)) < 1e-9
    np.testing.assert_allclose(nis, squares, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(estimate[-1, :42], theta, atol=1e-6 * spread.max())
    np.testing.assert_allclose(estimate[-1, 42:], angles_of(C_pn), atol=1e-9)
    T = angle_rates(angles_of(C_pn))
    np.testing.assert_allclose(sd[-1, :42], spread[:42], rtol=1e-9)
    np.testing.assert_allclose(sd[-1, 42:], np.sqrt(np.diag(T @ cov[42:, 42:] @ T.T)), rtol=1e-7)


def _stepped(x, command, full):
    """Angles after one interval and the readings then, without arms, with the kernel's slopes."""
    wide, m = np.zeros(parts.ROWS * parts.WIDTH), np.zeros((parts.PAGES, 3, 3))
    P, offset, said = np.zeros(45 * 48), np.zeros(3), np.zeros(3)
    wide[:45] = x
    parts.attitude(*x[42:], m)
    for page in (parts.EARTH, parts.T, parts.L):
        parts.unit(m, page)
    w = parts.predict(P, wide, m, command, 0.2, np.full(3, Q), full, parts.FREE_ANGLES, offset)
    f = m[parts.C, 2]
    parts.inverse_chart(m, np.cos(wide[43]))
    module.look(wide, m, *f, w[1:], 0 * ARMS, G, said)
    rows = wide.reshape(-1, 48)[:, :45]
    at = [row // parts.WIDTH for row in (parts.F, parts.H)]
    return wide[42:45].copy(), said, rows[at[0] : at[0] + 3].copy(), rows[at[1] : at[1] + 3].copy()


@pytest.mark.thorough
@pytest.mark.parametrize("full", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_its_slopes_are_those_of_what_it_does(seed, full):
    """Of one step of the angles, and of the readings, at errors thirty times their usual size."""
    rng = np.random.default_rng(seed)
    theta = make_cluster(seed, 30.0).packed(G)
    x = np.concatenate([theta, rng.uniform(-1, 1, 3)])
    command = 0.05 * rng.standard_normal(3)
    _, _, F, H = _stepped(x, command, full)
    unit = np.where(np.arange(45) < 24, 1e-5, 1e-4)
    by_angles, by_readings = np.empty((3, 45)), np.empty((3, 45))
    for j in range(45):
        step = unit[j] * np.eye(45)[j]
        up, down = (_stepped(x + s * step, command, full) for s in (1.0, -1.0))
        by_angles[:, j] = (up[0] - down[0]) / (2 * unit[j])
        moved = np.zeros(45)
        moved[42:] = (up[0] - down[0]) / (2 * unit[j])
        by_readings[:, j] = (up[1] - down[1]) / (2 * unit[j])
        if j < 42:  # H has the readings by the constants at a given attitude
            by_readings[:, j] -= H @ moved
    # Phi is right to the second order of the angle that is turned in one interval, 0.01 rad.
    size = np.abs(by_angles).max(axis=0)
    assert (np.abs(F - by_angles) <= 3e-4 * size + 1e-9).all()
    np.testing.assert_allclose(H[:, :42], by_readings[:, :42], atol=2e-7)
    np.testing.assert_allclose(H[:, 42:] @ F[:, 42:], by_readings[:, 42:], rtol=3e-4, atol=3e-4)


@pytest.mark.thorough
def test_readings_that_do_not_count_change_nothing():
    _, command, z, _ = recorded(60)
    x, P = believed()
    used = np.arange(60) % 3 == 0
    bad = np.where(used[:, None], z, np.nan)
    out, estimate, _, _, count = filtered("compiled", command, bad, x, P, used=used)
    want = filtered("compiled", command, np.where(used[:, None], z, 7.0), x, P, used=used)
    assert out[0] == parts.RUNNING and count.sum() == 60
    np.testing.assert_array_equal(estimate, want[1])
    # Where none counts it is the prediction that is left.
    blind = filtered("compiled", command, z, x, P, used=np.zeros(60, bool))
    model = make_cluster(1, 0.0)
    free = reference.cluster_exponential(
        model, G, attitude_of(x[42:]), command, np.zeros((60, 3)), W_N, 0.2
    )
    np.testing.assert_allclose(blind[1][-1, 42:], angles_of(free[-1]), atol=1e-9)


@pytest.mark.thorough
def test_means_over_the_interval():
    """Readings that are means, predicted as means: no difference from those at the end."""
    n, x_n = 60, 8
    theta, command, _, _ = recorded(n, noise=0.0)
    model = make_cluster(1)
    fine = command.repeat(x_n, axis=0)
    C = reference.cluster_exponential(
        model, G, attitude_of(START), fine, np.zeros((n * x_n, 3)), W_N, 0.2 / x_n
    )
    first, middle, last = (
        reference.cluster_readings(model, G, C, fine, 0 * fine, ARMS, p) for p in (0.0, 0.5, 1.0)
    )
    z = ((first + 4 * middle + last) / 6).reshape(n, x_n, 3).mean(axis=1) / G
    x = np.concatenate([theta, START])
    P = np.diag(np.concatenate([SIZE**2, np.full(3, 1e-6)]) * 1e-2)
    R = np.full((n, 3), 1e-12)
    _, _, _, nis, _ = filtered("compiled", command, z, x, P, R=R, mean=True)
    _, _, _, wrong, _ = filtered("compiled", command, z, x, P, R=R, mean=False)
    assert nis.max() < 0.1 and wrong.max() > 100


@FORMS
def test_it_stops_where_numbers_end(form):
    _, command, z, _ = recorded(20)
    x, P = believed()
    for bad in (np.nan, np.inf):
        given = z.copy()
        given[12, 1] = bad
        out, estimate, sd, nis, _ = filtered(form, command, given, x, P)
        assert out[:3] == (parts.NOT_FINITE, 12, 12)
        for array in (*out[3:], estimate, sd, nis):
            assert np.isfinite(array).all()
        assert not estimate[12:].any()
    wild = command.copy()
    wild[7] = np.nan
    out = filtered(form, wild, z, x, P)[0]
    assert out[:2] == (parts.NOT_FINITE, 7)


@FORMS
def test_it_stops_at_the_singular_attitude(form):
    _, _, z, _ = recorded(12)
    x, P = believed()
    x[42:] = [0.1, np.pi / 2 - 1e-9, 0.2]
    still = np.tile(attitude_of(x[42:]) @ W_N, (12, 1))
    out = filtered(form, still, z, x, P, used=np.zeros(12, bool))[0]
    assert out[0] == parts.SINGULAR and all(np.isfinite(a).all() for a in out[3:])


def test_it_sees_that_the_covariance_loses_its_sign():
    """A prior beyond the digits there are: stopped, and what is left has variances."""
    _, command, z, _ = recorded(300)
    x, P = believed(0.1, 1e5)
    out = filtered("compiled", command, z, x, P, R=np.full((300, 3), 1e-14))[0]
    assert out[0] == parts.INDEFINITE
    assert (np.diag(out[6][:, :45]) >= 0).all() and np.isfinite(out[6]).all()
