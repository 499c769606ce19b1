"""Rank, growth and unseen directions of plans, against answers that are known."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.linalg import expm

from foucault.coefficients import Coefficient, CoefficientVector, Layout
from foucault.diagnose.observability import LinearSegment, observability
from foucault.errors import FoucaultError
from foucault.infer.information import Information
from foucault.models import cluster
from foucault.models.earth import earth_rate_n
from foucault.models.rotation import cross_matrix, exp
from refusals import refuses


def layout(*names: str) -> Layout:
    return Layout(tuple(Coefficient(n, n, "angle", n) for n in names))


# -- small systems ---------------------------------------------------------------------------

MOTION = layout("position", "velocity", "acceleration")
F_MOTION = np.diag([1.0, 1.0], 1)
POSITION = np.eye(3)[:1]


@pytest.mark.parametrize(("powers", "rank"), [(0, 1), (1, 2), (2, 3), (None, 3)])
def test_each_derivative_of_a_position_takes_one_power(powers: int | None, rank: int) -> None:
    segment = LinearSegment(F_MOTION, POSITION, 5.0)
    o = observability([segment], MOTION, np.ones(3), 0.1, powers=powers)
    assert o.rank == rank
    assert o.complete == (rank == 3)
    assert o.gains[0].alone == MOTION.names[:rank]
    assert [list(c.shares) for c in o.unseen] == [[name] for name in MOTION.names[rank:]]
    # Nothing oscillates, so the duration is the unit of time: T^k over the noise.
    assert o.time_scale == 5.0
    expected = sorted([10.0, 50.0, 250.0][:rank], reverse=True)
    np.testing.assert_allclose(o.singular_values[:rank], expected, rtol=1e-12)
    assert o.smallest == pytest.approx(expected[-1] / expected[0])


def test_default_powers_are_the_states_that_move() -> None:
    o = observability([LinearSegment(F_MOTION, POSITION, 5.0)], MOTION, np.ones(3), 0.1)
    assert o.powers == 2
    still = observability([LinearSegment(0 * F_MOTION, POSITION, 5.0)], MOTION, np.ones(3), 0.1)
    assert (still.powers, still.rank) == (0, 1)
    assert np.isnan(still.time_scale)


@pytest.mark.parametrize("n_moving", [1, 2, 4])
def test_more_powers_than_states_that_move_add_no_rank(n_moving: int) -> None:
    rng = np.random.default_rng(n_moving)
    n, F = 7, np.zeros((7, 7))
    F[:n_moving] = rng.normal(size=(n_moving, n))
    H = np.zeros((1, n))
    H[0, 0] = 1.0
    names, sd = layout(*"abcdefg"), np.full(n, 2.0)
    ranks = [
        observability([LinearSegment(F, H, 1.0)], names, sd, 1.0, powers=p).rank
        for p in (n_moving - 1, n_moving, n - 1)
    ]
    assert ranks == [n_moving, n_moving + 1, n_moving + 1]


def test_singular_values_know_no_units() -> None:
    """The same system in kilometres and hours, and with readings in other units."""
    rng = np.random.default_rng(3)
    F, H, sd = rng.normal(size=(3, 3)), rng.normal(size=(2, 3)), np.array([2.0, 0.1, 5.0])
    one = observability([LinearSegment(F, H, 10.0)], MOTION, sd, np.array([0.1, 0.2]))
    unit, reading, hour = np.array([1e3, 1e-6, 7.0]), np.array([50.0, 1e-4]), 3600.0
    other = observability(
        [LinearSegment(F * unit[:, None] / unit * hour, H * reading[:, None] / unit, 10 / hour)],
        MOTION, sd * unit, np.array([0.1, 0.2]) * reading,
    )  # fmt: skip
    np.testing.assert_allclose(one.singular_values, other.singular_values, rtol=1e-9)
    assert one.time_scale == pytest.approx(other.time_scale * hour)
    fastest = np.abs(np.linalg.eigvals(F)).max()
    assert one.time_scale == pytest.approx(1 / fastest)


def test_bias_and_scale_are_told_apart_once_the_accelerometer_is_turned() -> None:
    """Up alone the output is bias + g scale; in units of the priors 1e-2 and 1e-2 / g alike."""
    names, g = layout("accel.bias.x", "accel.scale.x"), 9.8
    up, down = (
        LinearSegment(np.zeros((2, 2)), np.array([[1.0, s * g]]), 60.0, label)
        for s, label in ((1, "up"), (-1, "down"))
    )
    sd = np.array([1e-2, 1e-2 / g])
    alone = observability([up, up], names, sd, 1e-3)
    assert [(x.rank, x.added) for x in alone.gains] == [(1, 1), (1, 0)]
    assert alone.words == (
        "up: 1 more, 1 in all; now seen: +0.71 accel.bias.x +0.71 accel.scale.x",
        "up: 0 more, 1 in all",
        "+0.71 accel.bias.x -0.71 accel.scale.x: not seen at all",
    )
    turned = observability([up, down], names, sd, 1e-3)
    assert turned.complete
    assert turned.unseen == ()
    assert turned.words[1] == "down: 1 more, 2 in all; now seen: accel.bias.x; accel.scale.x"
    np.testing.assert_allclose(turned.singular_values, 10 * np.sqrt(2), rtol=1e-12)
    assert [(g.label, g.rank, g.added) for g in turned.gains] == [("up", 1, 1), ("down", 2, 1)]


def test_a_segment_names_the_combination_it_adds_of_states_not_seen_alone() -> None:
    names = layout("a", "b", "c", "d")
    rows = ([[1, 1, 0, 0]], [[0, 0, 1, -1]], [[1, 0, 0, 0]])
    segments = [LinearSegment(np.zeros((4, 4)), np.array(r, float), 1.0) for r in rows]
    o = observability(segments, names, np.ones(4), 1.0)
    assert [g.alone for g in o.gains] == [(), (), ("a", "b")]
    found = [[sorted(shares) for shares in g.together] for g in o.gains]
    assert found == [[["a", "b"]], [["c", "d"]], []]
    assert [c.words for c in o.unseen] == ["+0.71 c +0.71 d: not seen at all"]


def test_shares_too_small_to_name_are_marked() -> None:
    names = layout("a", "b")
    segment = LinearSegment(np.zeros((2, 2)), np.array([[1.0, 0.1]]), 1.0)
    o = observability([segment], names, np.ones(2), 1.0)
    assert [c.words for c in o.unseen] == ["+1.00 b ...: not seen at all"]


def test_outputs_that_know_nothing_of_the_states() -> None:
    o = observability([LinearSegment(F_MOTION, 0 * POSITION, 5.0)], MOTION, np.ones(3), 0.1)
    assert (o.rank, o.smallest, len(o.unseen)) == (0, 0.0, 3)
    assert o.words[0] == "1: 0 more, 0 in all"


def test_it_says_where_the_transitions_matter() -> None:
    """An unread segment in which something moves; the total matrix would carry it along."""
    unread = LinearSegment(F_MOTION, 0 * POSITION, 5.0)
    still = LinearSegment(0 * F_MOTION, 0 * POSITION, 5.0)
    read = LinearSegment(F_MOTION, POSITION, 5.0)
    exact = [
        observability(plan, MOTION, np.ones(3), 0.1).exact
        for plan in ([read], [still, read], [unread, read])
    ]
    assert exact == [True, True, False]


# -- bad input -------------------------------------------------------------------------------


@pytest.mark.parametrize("sd", [[1.0, 0.0, 1.0], [1.0, -2.0, 1.0], [1.0, np.inf, 1.0]])
def test_a_prior_that_is_no_unit_is_refused_by_name(sd: list[float]) -> None:
    with refuses("observability.prior", "is the unit; velocity"):
        observability([LinearSegment(F_MOTION, POSITION, 1.0)], MOTION, np.array(sd), 1.0)
    with pytest.raises(FoucaultError, match="velocity"):
        Information(MOTION, np.eye(3)).remaining(np.array(sd))


def test_a_prior_for_other_states_is_refused() -> None:
    with pytest.raises(FoucaultError, match="3 states: 2 given"):
        Information(MOTION, np.eye(3)).remaining(np.ones(2))


@pytest.mark.parametrize("noise", [0.0, -1.0, np.nan])
def test_readings_without_noise_are_refused(noise: float) -> None:
    with refuses("observability.noise", "must be positive and finite"):
        observability([LinearSegment(F_MOTION, POSITION, 1.0)], MOTION, np.ones(3), noise)


@pytest.mark.parametrize(
    ("segment", "what"),
    [
        (LinearSegment(np.eye(2), POSITION, 1.0), "there are 3 states"),
        (LinearSegment(F_MOTION, np.eye(2), 1.0), "there are 3 states"),
        (LinearSegment(F_MOTION, np.eye(3)[:2], 1.0), "2 outputs, and 1 standard deviations"),
        (LinearSegment(F_MOTION * np.nan, POSITION, 1.0), "not finite"),
        (LinearSegment(F_MOTION, POSITION, 0.0), "lasts 0 s"),
    ],
)
def test_a_segment_that_does_not_fit_is_refused(segment: LinearSegment, what: str) -> None:
    good = LinearSegment(F_MOTION, POSITION, 1.0)
    with refuses("observability.segment", "Segment 2", match=what):
        observability([good, segment], MOTION, np.ones(3), np.array([1.0]))


def test_a_plan_without_segments_is_refused() -> None:
    with pytest.raises(FoucaultError, match="missing"):
        observability([], MOTION, np.ones(3), 1.0)


# -- the torqued cluster ---------------------------------------------------------------------

G = 9.80665
DEG_H = np.radians(1.0) / 3600
STEPS = (  # duration [s], rate relative to n [deg/s]: the published plan
    (1800, (-0.1, 0, 0)), (900, (0, 0, -0.1)), (1800, (0, -0.1, 0)), (900, (0, 0, 0.1)),
)  # fmt: skip
TABLE_MEANS = {
    "gyro.drift": DEG_H, "gyro.torquer_scale": 400e-6, "gyro.misalignment": 120 * DEG_H,
    **{f"gyro.drift_{w}": 0.5 * DEG_H / G for w in ("input", "output", "spin")},
    **{
        f"gyro.drift_{w}": 0.01 * DEG_H / G**2
        for w in ("input_output", "input_spin", "output_spin")
    },
    "accel.bias": 100e-6 * G, "accel.scale": 100e-6, "accel.misalignment": 120 * DEG_H,
    "accel.quadratic": 100e-6 / G,
}  # fmt: skip
STATES = Layout(
    (
        *(Coefficient(f"attitude.{a}", a, "angle", f"about {a} of the cluster") for a in "xyz"),
        *cluster.CONSTANTS.coefficients,
    )
)
MEANS = CoefficientVector.prior(
    cluster.CONSTANTS, {name: (value, value) for name, value in TABLE_MEANS.items()}
).values
PRIOR = np.concatenate([np.full(3, np.radians(5.0)), MEANS])
ACCEL_SD = 1e-6 * G


def middles(pieces: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nominal specific force and command in the middle of each piece, and their durations."""
    w_in_n, C = earth_rate_n(np.radians(40.0)), cluster.attitude_of(np.zeros(3))
    force, command, duration = [], [], []
    for (time, rate), count in zip(STEPS, pieces, strict=True):
        w = np.radians(rate)
        for k in range(count):
            C_pn = exp(-w * (k + 0.5) * time / count) @ C
            force.append(C_pn @ [0, 0, G])
            command.append(w + C_pn @ w_in_n)
            duration.append(time / count)
        C = exp(-w * time) @ C
    return np.array(force), np.array(command), np.array(duration)


@cache
def tumble(pieces: tuple[int, ...], means: bool = False) -> list[LinearSegment]:
    """The 45 states, d(dphi)/dt = -w x dphi + d(rate), differentiated numerically."""
    force, command, duration = middles(pieces)
    constants = MEANS if means else np.zeros(42)

    def outputs(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        vector = CoefficientVector(cluster.CONSTANTS, constants + x[3:])
        model = cluster.ClusterModel.from_coefficients(vector)
        f_p = force + np.cross(force, x[:3])  # the true one: C_true = (I - [dphi x]) C_est
        return model.rate(command, f_p), model.read(f_p)

    F, H = np.zeros((len(force), 45, 45)), np.zeros((len(force), 3, 45))
    F[:, :3, :3] = -cross_matrix(outputs(np.zeros(45))[0])
    for i, step in enumerate(1e-3 * PRIOR):
        dx = np.zeros(45)
        dx[i] = step
        (w1, a1), (w0, a0) = outputs(dx), outputs(-dx)
        F[:, :3, i] += (w1 - w0) / (2 * step)
        H[:, :, i] = (a1 - a0) / (2 * step)
    return [LinearSegment(*part) for part in zip(F, H, duration.tolist(), strict=True)]


@pytest.mark.parametrize("means", [False, True])
@pytest.mark.parametrize(
    ("pieces", "rank"),
    [
        ((1, 1, 1, 1), 24),
        ((2, 2, 2, 2), 39),
        ((8, 4, 8, 4), 45),
        ((6, 6, 6, 6), 45),
        ((16, 8, 16, 8), 45),
    ],
)
def test_rank_of_the_tumble(pieces: tuple[int, ...], rank: int, means: bool) -> None:
    """Published for 4, 8, and 24 or more segments; coefficients zero, or the table's means."""
    o = observability(tumble(pieces, means), STATES, PRIOR, ACCEL_SD)
    assert o.powers == 3
    # The time of one radian at 0.1 deg/s, give or take the rotation of the Earth.
    fastest, earth = np.radians(0.1), np.linalg.norm(earth_rate_n(0.7))
    assert 1 / (fastest + earth) < o.time_scale < 1 / (fastest - earth)
    assert o.rank == rank
    assert o.exact
    assert sum(g.added for g in o.gains) == rank
    assert len(o.unseen) == 45 - rank
    # A gap of eight decades: no tolerance in between would give another rank.
    assert o.smallest > 1e-5
    if rank < 45:
        assert o.singular_values[rank] < 1e-13 * o.singular_values[0]
    else:
        # Published: about 2e-5, whatever the subdivision.
        assert f"{o.smallest:.0e}" == "2e-05"


def test_one_segment_of_a_tumble_adds_at_most_six() -> None:
    """Three outputs, and three powers under which only the attitude moves."""
    o = observability(tumble((1, 1, 1, 1)), STATES, PRIOR, ACCEL_SD)
    assert [g.rank for g in o.gains] == [6, 12, 18, 24]
    # In the four middles the force is along z, or between x and y with f_x = -f_y: gyros x and y,
    # whose input and output axes these are, tell the difference of the two terms only.
    force = middles((1, 1, 1, 1))[0]
    np.testing.assert_allclose(force[:, 0], -force[:, 1], atol=1e-9)
    for a, (one, other) in {"x": ("input", "output"), "z": ("output", "spin")}.items():
        words = f"+0.71 gyro.drift_{one}.{a} +0.71 gyro.drift_{other}.{a}: not seen at all"
        assert words in o.words


def test_all_powers_give_the_rank_of_the_first_three() -> None:
    segments = tumble((8, 4, 8, 4))
    few = observability(segments, STATES, PRIOR, ACCEL_SD)
    all_of_them = observability(segments, STATES, PRIOR, ACCEL_SD, powers=44)
    assert [g.rank for g in few.gains] == [g.rank for g in all_of_them.gains]


def test_what_a_tumble_leaves_uncertain() -> None:
    """A dense covariance filter in steps of 30 s; published directions and correlations."""
    # In units of the prior: in SI the covariance spans 30 orders, and rounding shows.
    P, unit = np.eye(45), np.outer(1 / PRIOR, PRIOR)
    for s in tumble((60, 30, 60, 30), means=True):
        half = 0.5 * s.duration
        Phi, H = expm(s.F * half) * unit, s.H * PRIOR
        Q = np.zeros((45, 45))
        Q[:3, :3] = 1.175e-16 * half * np.diag(PRIOR[:3] ** -2.0)
        P = Phi @ P @ Phi.T + Q
        R = np.eye(3) * ACCEL_SD**2 * 0.2 / s.duration  # 1 ug per 0.2 s
        K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
        rest = np.eye(45) - K @ H
        P = Phi @ (rest @ P @ rest.T + K @ R @ K.T) @ Phi.T + Q
        P = 0.5 * (P + P.T)
    data = np.linalg.cholesky(np.linalg.inv(P[3:, 3:]) - np.eye(42)).T / PRIOR[3:]
    info = Information(cluster.CONSTANTS, data)
    first, second = info.remaining(PRIOR[3:], most=2)
    assert set(first.shares) == {"gyro.drift_input_spin.x", "gyro.drift_input_spin.y"}
    assert min(first.shares.values()) > 0
    assert first.words.endswith(": known to 0.13 of the prior")
    assert set(second.shares) == {"gyro.drift_input_output.x", "gyro.drift_input_output.y"}
    assert min(second.shares.values()) < 0
    assert second.words.endswith(": known to 0.12 of the prior")
    strong = {
        pair: f"{rho:.2f}" for *pair, rho in info.with_prior(PRIOR[3:]).correlated(0.96)
        for pair in [tuple(pair)]
    }  # fmt: skip
    assert strong["accel.bias.x", "accel.quadratic.x"] == "-0.98"
    assert strong["accel.bias.y", "accel.quadratic.y"] == "-0.98"
    assert strong["gyro.drift_input.x", "gyro.drift_input.y"] in ("0.96", "0.97")


# -- a procedure that exists -----------------------------------------------------------------


# -- after the data --------------------------------------------------------------------------


def test_prior_adds_its_information() -> None:
    rng = np.random.default_rng(7)
    sd = np.array([1.0, 1e-6, np.inf])
    info = Information(MOTION, rng.normal(size=(3, 3)) * [1.0, 1e5, 1e3])
    both = info.with_prior(sd)
    np.testing.assert_allclose(both.matrix, info.matrix + np.diag(1 / sd**2), rtol=1e-9)
    with pytest.raises(FoucaultError, match="velocity: 0"):
        info.with_prior(np.array([1.0, 0.0, np.inf]))
    blind = Information(MOTION, np.zeros((3, 3))).with_prior(sd)
    np.testing.assert_allclose(blind.sd, sd)


def test_remaining_directions_are_those_of_the_posterior_covariance() -> None:
    rng = np.random.default_rng(8)
    sd = np.array([3.0, 1e-3, 50.0])
    info = Information(MOTION, rng.normal(size=(3, 3)) / sd)
    cov = np.linalg.inv(info.matrix + np.diag(1 / sd**2)) / np.outer(sd, sd)
    value, direction = np.linalg.eigh(cov)
    found = info.remaining(sd)
    np.testing.assert_allclose([r.ratio for r in found], np.sqrt(value[::-1]), rtol=1e-9)
    for r, d in zip(found, direction.T[::-1], strict=True):
        for name, share in r.shares.items():
            assert abs(share) == pytest.approx(abs(d[MOTION.index(name)]))
    assert len(info.remaining(sd, most=2)) == 2
    assert len(info.remaining(sd, most=9)) == 3
    none = Information(MOTION, np.zeros((3, 3))).remaining(sd, most=1)
    assert none[0].ratio == 1.0


def test_correlated_pairs_are_listed_strongest_first() -> None:
    rho = np.array([[1.0, -0.95, 0.3], [-0.95, 1.0, 0.0], [0.3, 0.0, 1.0]])
    sd = np.array([1.0, 1e-3, 1e3])
    root = np.linalg.cholesky(np.linalg.inv(rho * np.outer(sd, sd))).T
    info = Information(MOTION, root)
    (pair,) = info.correlated(0.9)
    assert pair[:2] == ("position", "velocity")
    assert pair[2] == pytest.approx(-0.95)
    assert [p[2] for p in info.correlated(0.2)] == pytest.approx([-0.95, 0.3])
