"""Simulated sessions on a table: geometry, kinematics, means, noise, truth."""

from __future__ import annotations

import json
import time as clock
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import LAYOUT, LINEAR_LOWER, Gauge, ImuModel
from foucault.models.noise import ImuNoise, TriadNoise, grade
from foucault.models.rotation import exp
from foucault.models.rotation import log as rotation_vector
from foucault.models.turntable import RIG, TableErrors, TablePlan, chain, mean_force
from foucault.plans.directions import table_plan
from foucault.procedures.on_table import session as turntable_session
from foucault.procedures.on_table.session import TableSession, TableSettings
from foucault.simulate.hand_rotated import draw_errors
from foucault.simulate.table import Fleet, Rig, simulate, simulate_means, simulate_readings
from refusals import refuses

SITE = Site.at(np.radians(48.8462), 60.0)
QUIET = ImuNoise()
RIG_ERRORS = Rig(
    common=np.array([2e-3, -3e-3, 1e-3, -2e-3, 4e-3, -1e-3]),
    mounting=np.array([0.02, -0.01, 0.03]),
    lever_arm=np.array([0.03, -0.05, 0.08]),
    heading=0.7,
)


def model_of(values: dict[str, float]) -> ImuModel:
    return ImuModel.from_coefficients(ImuModel().coefficients().with_values(values))


@cache
def short_plan(spin_rate: float = 2 * np.pi / 10) -> TablePlan:
    """Five positions of 2 s and spins of two turns, 10 s each, that fit 100 Hz exactly."""
    angles = np.radians(
        [[30, 0, -31.7], [170, 121.7, 10], [-60, 20, 90], [300, -40, 200], [0, 90, 5]]
    )
    return table_plan(angles, spin_rate=spin_rate, rest_time=2.0, turns=2, both_senses=True)


@cache
def quiet_with_errors(rate: float = 100.0, sampled: str = "rate", site: Site = SITE):
    """A session of a perfect instrument on a table with errors."""
    return simulate(
        short_plan(), model=ImuModel(), noise=QUIET, site=site, rig=RIG_ERRORS, rate=rate,
        sampled=sampled,
    )  # fmt: skip


def turned(axis: int, angle: float) -> np.ndarray:
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = np.eye(3)
    out[i, i] = out[j, j] = np.cos(angle)
    out[j, i] = np.sin(angle)
    out[i, j] = -out[j, i]
    return out


def whole_turns(simulation, k: int) -> slice:
    """Samples of position k: all of a rest, the first whole turns of a spin."""
    first, last = int(simulation.first[k]), int(simulation.last[k])
    if simulation.plan.rate[k] == 0:
        return slice(first, last)
    return slice(first, first + round(simulation.plan.time[k] * simulation.log.rate))


# -- raw logs ------------------------------------------------------------------------------


def attitudes(simulation) -> np.ndarray:
    """C_tb of every sample from the angles that the table says, all its errors but random ones."""
    at = chain(simulation.log.table.angles, TableErrors.of(simulation.rig.common))
    return at.C_tk @ simulation.rig.mounting_matrix.T


@pytest.mark.thorough
def test_rates_are_those_of_the_attitudes():
    simulation = quiet_with_errors(400.0)
    C_tb = attitudes(simulation)
    step = rotation_vector(np.swapaxes(C_tb[:-2], 1, 2) @ C_tb[2:]) * 200.0
    L, psi = SITE.latitude, RIG_ERRORS.heading
    w_t = EARTH_RATE * np.array([-np.cos(L) * np.sin(psi), np.cos(L) * np.cos(psi), np.sin(L)])
    want = step + np.swapaxes(C_tb[1:-1], 1, 2) @ w_t
    gyro = simulation.log.gyro[1:-1]
    size = np.abs(np.diff(simulation.log.gyro, 2, axis=0)).max()  # dt^2 x second derivative
    np.testing.assert_allclose(gyro, want, rtol=0, atol=size)
    assert size < 1e-4 and np.abs(gyro).max() > 0.5


@pytest.mark.thorough
def test_specific_force_is_gravity_and_the_path_of_the_lever_arm():
    # Without the Earth's rotation: a tenth of a ug here, and not in ground axes.
    simulation = quiet_with_errors(400.0, site=Site(SITE.gravity))
    C_tb = attitudes(simulation)
    p_t = C_tb @ RIG_ERRORS.lever_arm
    a_t = (p_t[2:] - 2 * p_t[1:-1] + p_t[:-2]) * 400.0**2
    a_t[:, 2] += SITE.gravity
    want = np.einsum("nji,nj->ni", C_tb[1:-1], a_t)
    centre = SITE.gravity * np.einsum("nji,j->ni", C_tb[1:-1], [0, 0, 1])
    arm = simulation.log.accel[1:-1] - centre
    moving = np.abs(arm).max()
    assert moving > 0.02
    np.testing.assert_allclose(arm, want - centre, rtol=0, atol=2e-3 * moving)


def test_specific_force_on_the_turning_earth():
    """In a spin, steady enough to see a tenth of a ug: the path of the arm in inertial axes."""
    simulation = quiet_with_errors(400.0)
    L, psi = SITE.latitude, RIG_ERRORS.heading
    w_t = EARTH_RATE * np.array([-np.cos(L) * np.sin(psi), np.cos(L) * np.cos(psi), np.sin(L)])
    rows = slice(int(simulation.first[7]), int(simulation.last[7]))
    C_tb = attitudes(simulation)[rows]
    C_ib = exp(w_t * simulation.log.time[rows, None]) @ C_tb
    p_i = C_ib @ RIG_ERRORS.lever_arm
    a_i = (p_i[2:] - 2 * p_i[1:-1] + p_i[:-2]) * 400.0**2
    want = np.einsum("nji,nj->ni", C_ib[1:-1], a_i) + SITE.gravity * C_tb[1:-1, 2]
    got = simulation.log.accel[rows][1:-1]
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-7)
    still = quiet_with_errors(400.0, site=Site(SITE.gravity)).log.accel[rows][1:-1]
    assert np.abs(got - still).max() > 2e-6


def test_the_table_moves_smoothly_and_no_faster_than_it_may():
    plan = short_plan()
    simulation = simulate(plan, model=ImuModel(), noise=QUIET, site=SITE, rate=200.0, move_rate=0.3)
    angles, rate = simulation.log.table.angles, simulation.log.table.rate
    moving = np.diff(angles[:, 1:], axis=0) * 200.0
    assert 0.29 < np.abs(moving).max() <= 0.3
    assert np.abs(np.diff(simulation.log.gyro, axis=0)).max() < 1.0 / 200.0
    np.testing.assert_allclose(
        rate[1:-1], (angles[2:, 0] - angles[:-2, 0]) * 100.0, rtol=0, atol=1e-3
    )
    assert np.abs(rate).max() == pytest.approx(plan.rate.max())


@pytest.mark.parametrize("sampled", ["rate", "increment"])
def test_positions_stand_still_or_spin_steadily(sampled):
    simulation = quiet_with_errors(100.0, sampled)
    plan, log = simulation.plan, simulation.log
    assert (simulation.first[1:] > simulation.last[:-1]).all()
    for k in range(len(plan)):
        rows = slice(simulation.first[k], simulation.last[k])
        assert log.table.position[rows].tolist() == [k] * (rows.stop - rows.start)
        still = log.table.angles[rows, 1:] - plan.angles[k, 1:]
        np.testing.assert_allclose(still, 0.0, rtol=0, atol=1e-12)
        np.testing.assert_allclose(log.table.rate[rows], plan.rate[k], rtol=0, atol=1e-12)
        np.testing.assert_allclose(
            np.ptp(np.linalg.norm(log.gyro[rows], axis=1)), 0, rtol=0, atol=2e-6
        )
        if plan.rate[k]:
            turned_by = np.abs(np.diff(log.table.angles[[rows.start, rows.stop - 1], 0]))
            assert 2.0 < turned_by / (2 * np.pi) < 2.3
        else:
            off = (log.table.angles[rows, 0] - plan.angles[k, 0]) / (2 * np.pi)
            np.testing.assert_allclose(off, np.round(off[0]), rtol=0, atol=1e-12)
            length = log.time[rows.stop - 1] - log.time[rows.start]
            assert length == pytest.approx(plan.time[k], abs=0.03)
    assert (log.table.position == -1).any()


def test_the_outer_angle_accumulates_or_starts_anew():
    grown = quiet_with_errors(100.0)
    wrapped = simulate(
        short_plan(), model=ImuModel(), noise=QUIET, site=SITE, rig=RIG_ERRORS, rate=100.0,
        accumulate=False,
    )  # fmt: skip
    outer = grown.log.table.angles[:, 0]
    assert np.ptp(outer) > 4 * np.pi and np.abs(np.diff(outer)).max() < 0.1
    again = wrapped.log.table.angles[:, 0]
    assert again.min() >= 0 and again.max() < 2 * np.pi
    np.testing.assert_allclose(np.sin((outer - again) / 2), 0, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(grown.log.gyro, wrapped.log.gyro)


# -- means ---------------------------------------------------------------------------------


def test_means_are_those_of_the_raw_log():
    simulation = quiet_with_errors(100.0)
    means = simulate_readings(
        short_plan(), models=ImuModel(), noise=QUIET, site=SITE, rig=RIG_ERRORS
    )
    for k in range(len(simulation.plan)):
        rows = whole_turns(simulation, k)
        np.testing.assert_allclose(
            simulation.log.accel[rows].mean(axis=0), means.accel[0, k], rtol=0, atol=2e-9
        )
        np.testing.assert_allclose(
            simulation.log.gyro[rows].mean(axis=0), means.gyro[0, k], rtol=0, atol=1e-13
        )
    np.testing.assert_allclose(means.direction[0], simulation.direction, rtol=0, atol=1e-15)


def test_means_by_the_equations():
    """Every factor of the table written out; the heading, plumb and lever arm by hand."""
    plan, rig = short_plan(), RIG_ERRORS
    px, py, p_mo, p_im, z_m, z_i = rig.common
    model = draw_errors("mems", 3)
    means = simulate_readings(plan, models=model, noise=QUIET, site=SITE, rig=rig)
    L, psi = SITE.latitude, rig.heading
    w_t = EARTH_RATE * np.array([-np.cos(L) * np.sin(psi), np.cos(L) * np.cos(psi), np.sin(L)])
    plumb = turned(0, px) @ turned(1, py)
    for k, (outer, middle, inner) in enumerate(plan.angles):
        carried = (
            turned(1, p_mo) @ turned(0, middle + z_m) @ turned(2, p_im) @ turned(1, inner + z_i)
        )
        C_tb = plumb @ turned(2, outer) @ carried @ rig.mounting_matrix.T
        if plan.rate[k] == 0:
            f, w = C_tb.T @ [0, 0, SITE.gravity], C_tb.T @ w_t
        else:
            o = C_tb.T @ plumb[:, 2]
            h = plan.rate[k] + plumb[:, 2] @ w_t
            tilted = SITE.gravity * plumb[2, 2]
            f = mean_force(o[None], np.array([h]), tilted, rig.lever_arm)[0]
            w = h * o
        want = model.measure(f, w)
        np.testing.assert_allclose(means.accel[0, k], want[0], rtol=0, atol=1e-12)
        np.testing.assert_allclose(means.gyro[0, k], want[1], rtol=0, atol=1e-15)


def test_a_fleet_is_its_instruments():
    model = model_of({"accel.quadratic.x": 1e-4, "gyro.g_sensitivity.yz": 1e-5,
                      "accel.cross.zxy": 1e-4, "gyro.asymmetry.y": 1e-3,
                      "accel.asymmetry.z": 1e-3, "gyro.deflection.yzx": 1e-5,
                      "accel.misalignment.xy": 0.01})  # fmt: skip
    models = [draw_errors("mems", 1), model, ImuModel()]
    plan = short_plan()
    rng = np.random.default_rng(0)
    rig = replace(
        RIG_ERRORS, common=1e-3 * rng.normal(size=(3, 6)), mounting=0.01 * rng.normal(size=(3, 3)),
        lever_arm=0.1 * rng.normal(size=(3, 3)), rate_error=np.array([1e-4, -2e-4, 0.0]),
    )  # fmt: skip
    fleet = simulate_readings(plan, models=models, noise=QUIET, site=SITE, rig=rig)
    assert len(fleet) == 3
    for i in range(3):
        own = replace(
            rig, common=rig.common[i], mounting=rig.mounting[i], lever_arm=rig.lever_arm[i],
            rate_error=float(rig.rate_error[i]),
        )  # fmt: skip
        one = simulate_readings(plan, models=models[i], noise=QUIET, site=SITE, rig=own)
        np.testing.assert_allclose(fleet.accel[i], one.accel[0], rtol=0, atol=1e-13)
        np.testing.assert_allclose(fleet.gyro[i], one.gyro[0], rtol=0, atol=1e-15)
        np.testing.assert_allclose(fleet.rate[i], plan.rate * (1 + rig.rate_error[i]))
        again = fleet.fleet.model(i).coefficients().values
        np.testing.assert_array_equal(again, models[i].coefficients().values)
    values = Fleet.of(models).values(LAYOUT.names)
    np.testing.assert_allclose(
        values, [m.coefficients().values for m in models], rtol=0, atol=1e-16
    )
    built = Fleet.from_values(LAYOUT.names, values)
    np.testing.assert_allclose(
        built.models.accel_matrix, fleet.fleet.models.accel_matrix, rtol=0, atol=1e-16
    )
    np.testing.assert_allclose(
        built.models.accel_quadratic, fleet.fleet.models.accel_quadratic, rtol=0, atol=1e-16
    )


def test_readings_of_one_instrument():
    noise = grade("tactical").noise
    made = simulate_readings(short_plan(), models=ImuModel(), noise=noise, site=SITE, draws=4)
    one = made.readings(2)
    np.testing.assert_array_equal(one.accel, made.accel[2])
    np.testing.assert_array_equal(one.turns, [0] * 5 + [2] * 10)
    assert one.declared and one.spin.sum() == 10
    np.testing.assert_allclose(one.gyro_cov[7], noise.gyro.white**2 / 20.0 * np.eye(3))
    np.testing.assert_allclose(one.accel_cov, one.with_noise(noise).accel_cov)


# -- random numbers ------------------------------------------------------------------------


def test_noise_of_means_has_its_variance():
    noise = ImuNoise(TriadNoise(white=1e-3), TriadNoise(white=1e-5, bias_instability=2e-6))
    plan = short_plan()
    loud = simulate_readings(plan, models=ImuModel(), noise=noise, site=SITE, draws=500, seed=4)
    still = simulate_readings(plan, models=ImuModel(), noise=QUIET, site=SITE)
    for name in ("accel", "gyro"):
        error = getattr(loud, name) - getattr(still, name)
        z = error / np.sqrt(getattr(loud, f"{name}_variance"))[:, None]
        low, high = chi_square_limits(z.size, tests=2)
        assert low < np.sum(z**2) < high
    np.testing.assert_allclose(loud.accel_variance[:5], 1e-6 / 2.0)


def test_position_errors_and_rate_jitter_have_their_sd():
    rig = Rig(position_sd=1e-3, rate_jitter=2e-5, rate_error=3e-5)
    plan = short_plan()
    made = simulate_readings(
        plan, models=ImuModel(), noise=QUIET, site=Site(9.8), rig=rig, draws=300, seed=2
    )
    low, high = chi_square_limits(made.position.size, tests=3)
    assert low < np.sum((made.position / 1e-3) ** 2) < high
    spins = plan.rate != 0
    jitter = (made.rate[:, spins] / plan.rate[spins] - 1 - 3e-5) / 2e-5
    low, high = chi_square_limits(jitter.size, tests=3)
    assert low < np.sum(jitter**2) < high
    np.testing.assert_allclose(
        np.linalg.norm(made.gyro, axis=2), np.abs(made.rate), rtol=0, atol=1e-15
    )
    # The middle axis is off by what was drawn: sin(middle) is up along case y.
    y = np.arcsin(made.direction[:, 0, 1]) - plan.angles[0, 1]
    np.testing.assert_allclose(y, made.position[:, 0, 0], rtol=0, atol=1e-9)


def test_the_raw_log_has_position_errors_and_a_rate_of_its_own():
    rig = Rig(position_sd=1e-3, rate_jitter=1e-3, rate_error=2e-3)
    simulation = simulate(
        short_plan(), model=ImuModel(), noise=QUIET, site=Site(9.8), rig=rig, rate=50.0, seed=9
    )
    plan, log = simulation.plan, simulation.log
    assert np.abs(simulation.position).max() > 1e-4
    for k in range(len(plan)):
        rows = slice(simulation.first[k], simulation.last[k])
        at = chain(plan.angles[[k]], None, simulation.position[[k]])
        still = log.table.angles[rows, 1:] - plan.angles[k, 1:]
        np.testing.assert_allclose(still, 0.0, rtol=0, atol=1e-12)
        np.testing.assert_allclose(log.table.rate[rows], plan.rate[k], rtol=0, atol=1e-12)
        if plan.rate[k]:
            want = np.broadcast_to(simulation.rate[k] * at.outer_k, log.gyro[rows].shape)
            np.testing.assert_allclose(log.gyro[rows], want, rtol=0, atol=1e-12)
            assert simulation.rate[k] != plan.rate[k]
        else:
            want = np.broadcast_to(9.8 * at.up_k, log.accel[rows].shape)
            np.testing.assert_allclose(log.accel[rows], want, rtol=0, atol=1e-12)


def test_seeds_make_sessions():
    def made(seed):
        rig = Rig(position_sd=1e-3, rate_jitter=1e-5)
        noise = grade("mems").noise
        means = simulate_readings(
            short_plan(), models=ImuModel(), noise=noise, site=SITE, rig=rig, draws=3, seed=seed
        )
        raw = simulate(
            short_plan(), model=ImuModel(), noise=noise, site=SITE, rig=rig, rate=10.0, seed=seed
        )
        return means, raw.log

    (one, log), (again, same), (other, third) = made(1), made(1), made(2)
    assert np.array_equal(one.accel, again.accel) and np.array_equal(one.gyro, again.gyro)
    assert np.array_equal(log.gyro, same.gyro) and np.array_equal(log.accel, same.accel)
    assert not np.array_equal(one.gyro, other.gyro) and not np.array_equal(log.gyro, third.gyro)
    assert not np.array_equal(one.gyro[0], one.gyro[1])


def test_drawn_fleets_have_the_spread_of_their_grade():
    spread = grade("tactical").spread
    sd = np.array([spread[n.rpartition(".")[0]] for n in LINEAR_LOWER])
    z = Fleet.draw("tactical", 400, 3).values(LINEAR_LOWER) / sd
    low, high = chi_square_limits(400, tests=len(LINEAR_LOWER))
    assert ((low < np.sum(z**2, axis=0)) & (np.sum(z**2, axis=0) < high)).all()
    unnamed = [n for n in LAYOUT.names if n not in LINEAR_LOWER]
    assert not Fleet.draw("tactical", 3, 3).values(unnamed).any()


def test_ten_thousand_instruments_in_one_call():
    plan = table_plan("ico12", spin_rate=0.17, rest_time=60.0, turns=5)
    fleet = Fleet.draw("tactical", 10_000, 1)
    started = clock.perf_counter()
    made = simulate_readings(
        plan, models=fleet, noise=grade("tactical").noise, site=SITE,
        rig=replace(RIG_ERRORS, position_sd=1e-4), seed=1,
    )  # fmt: skip
    assert made.accel.shape == (10_000, 24, 3)
    assert clock.perf_counter() - started < 5.0  # 0.6 s on a quiet core


# -- sessions of the procedures ------------------------------------------------------------


def session(**values):
    return turntable_session.simulate(
        TableSession(**values), model=draw_errors("tactical", 1),
        noise=grade("tactical").noise, site=SITE, seed=5,
    )  # fmt: skip


def test_the_default_session():
    started = clock.perf_counter()
    made = session()
    assert clock.perf_counter() - started < 4.0  # 0.3 s on a quiet core
    assert made.plan.name == "icosahedron 12" and len(made.plan) == 24
    assert 40 * 60 < made.log.duration < 45 * 60 and made.log.rate == pytest.approx(20.0)
    assert np.array_equal(made.log.accel, session().log.accel)
    settings = TableSettings(plan="dodeca", four_positions=True, both_senses=True, spin_rate=-0.2)
    plan = turntable_session.plan_of(settings, TableSession(turns=1))
    assert len(plan) == 24 + 2 * 22 and plan.rate.min() == -0.2 and plan.rate.max() == 0.2


def test_a_session_of_means():
    made = session(rows="means")
    log, plan = made.log, made.plan
    assert len(log) == len(plan) and np.array_equal(log.averaged, plan.time)
    np.testing.assert_array_equal(log.table.angles, plan.angles)
    np.testing.assert_array_equal(log.table.rate, plan.rate)
    np.testing.assert_array_equal(log.table.position, range(24))
    assert (np.diff(log.time) > 0).all() and (np.diff(log.time) > plan.time[1:]).all()
    np.testing.assert_allclose(np.linalg.norm(log.accel, axis=1), SITE.gravity, rtol=0.02)
    raw = session()
    np.testing.assert_array_equal(raw.rig.common, made.rig.common)  # the same table either way
    np.testing.assert_allclose(raw.direction, made.direction, rtol=0, atol=1e-15)


def test_means_of_a_session_are_means_of_its_log():
    rig = replace(RIG_ERRORS, position_sd=1e-3, rate_jitter=1e-4)
    means = simulate_means(short_plan(), model=ImuModel(), noise=QUIET, site=SITE, rig=rig, seed=3)
    raw = simulate(short_plan(), model=ImuModel(), noise=QUIET, site=SITE, rig=rig, rate=50.0,
                   seed=3)  # fmt: skip
    np.testing.assert_array_equal(means.position, raw.position)
    np.testing.assert_array_equal(means.rate, raw.rate)
    rows = whole_turns(raw, 8)
    # Whole turns by the table are not quite whole in truth: 1e-4 of the Earth's rate.
    np.testing.assert_allclose(
        raw.log.gyro[rows].mean(axis=0), means.log.gyro[8], rtol=0, atol=1e-8
    )


@pytest.mark.parametrize("sampled", ["rate", "increment"])
def test_every_position_has_a_bias_of_its_own(sampled):
    """As large as was asked, constant over a rest or spin, and the same in means."""
    plain, told = Rig(position_sd=1e-3), {"accel_scatter": 2e-4, "gyro_scatter": 3e-6}
    words = {"model": ImuModel(), "noise": QUIET, "site": SITE, "seed": 3}
    off = {}
    for rig in (plain, replace(plain, **told)):
        raw = simulate(short_plan(), rig=rig, rate=50.0, sampled=sampled, **words)
        means = simulate_means(short_plan(), rig=rig, **words)
        off[rig.accel_scatter] = raw, means
    (still, bare), (raw, means) = off.values()
    np.testing.assert_array_equal(raw.position, still.position)  # nothing else is drawn anew
    for name, sd in (("accel", 2e-4), ("gyro", 3e-6)):
        more = getattr(raw.log, name) - getattr(still.log, name)
        each = getattr(means.log, name) - getattr(bare.log, name)
        for k in range(len(raw.plan)):
            rows = slice(raw.first[k], raw.last[k])
            np.testing.assert_allclose(more[rows] - each[k], 0.0, atol=1e-9 * sd)
        low, high = chi_square_limits(each.size, tests=4)
        assert low < np.sum((each / sd) ** 2) < high


def test_the_rig_of_a_session_is_drawn_from_its_sds():
    values = {"plumb_sd": 1e-4, "orthogonality_sd": 2e-4, "zero_sd": 3e-4, "mounting_sd": 4e-3,
              "lever_arm_sd": 0.05, "rate_error_sd": 1e-5}  # fmt: skip
    sd = np.array([1e-4] * 2 + [2e-4] * 2 + [3e-4] * 2 + [1e-5] + [4e-3] * 3 + [0.05] * 3)
    rigs = [turntable_session.draw_rig(TableSession(**values), seed) for seed in range(200)]
    drawn = np.array(
        [np.concatenate([r.common, [r.rate_error], r.mounting, r.lever_arm]) for r in rigs]
    )
    square = np.sum((drawn / sd) ** 2, axis=0)
    low, high = chi_square_limits(200, tests=len(sd))
    assert ((low < square) & (square < high)).all()
    assert rigs[0].heading == pytest.approx(np.radians(30)) and rigs[0].position_sd > 0


def test_the_truth_is_in_the_axes_of_results():
    model = model_of({"accel.misalignment.xy": 0.01, "accel.misalignment.yz": -0.02,
                      "gyro.scale.x": 0.003})  # fmt: skip
    made = simulate(short_plan(), model=model, noise=QUIET, site=SITE, rig=RIG_ERRORS, rate=20.0)
    truth = json.loads(json.dumps(made.truth_json()))
    lower = model.in_gauge(Gauge.LOWER)[0]
    assert lower.accel_matrix[0, 1] == pytest.approx(0.0, abs=1e-15)
    said, rig = truth["positions"], truth["rig"]
    assert list(rig) == list(RIG.names)
    up = np.array(said["direction"][:5])
    for k in range(5):
        want = lower.measure(SITE.gravity * up[k], np.zeros(3))[0]
        got = made.log.accel[said["first"][k] : said["last"][k]].mean(axis=0)
        np.testing.assert_allclose(got, want, rtol=0, atol=1e-12)
    mounting = np.array([rig[f"mounting.{a}"] for a in "xyz"])
    lever_arm = np.array([rig[f"lever_arm.{a}"] for a in "xyz"])
    named = Rig(common=RIG_ERRORS.common, mounting=mounting, lever_arm=lever_arm, heading=0.7)
    again = simulate_readings(short_plan(), models=lower, noise=QUIET, site=SITE, rig=named)
    same = simulate_readings(short_plan(), models=model, noise=QUIET, site=SITE, rig=RIG_ERRORS)
    np.testing.assert_allclose(again.accel, same.accel, rtol=0, atol=1e-12)
    np.testing.assert_allclose(again.gyro, same.gyro, rtol=0, atol=1e-14)
    assert rig["table.plumb.x"] == 2e-3 and rig["table.heading"] == 0.7
    np.testing.assert_allclose(said["true_rate"], short_plan().rate)
    assert said["angles"] == short_plan().angles.tolist()


@pytest.mark.parametrize(
    ("values", "judged", "code"),
    [
        ({"plan": "8 corners"}, "accel", "plan.too_few"),
        ({"plan": "12 edges", "accel_quadratic": True}, "accel", "plan.singular"),
        ({"plan": "8 corners"}, "accel table", None),
        ({"plan": "8 corners"}, None, None),
        ({"plan": "12 edges"}, "accel", None),
    ],
)
def test_sessions_that_cannot_determine_the_coefficients_are_refused(values, judged, code):
    def plan():
        return turntable_session.plan_of(TableSettings(**values), TableSession(), judged=judged)

    if code is None:
        assert len(plan()) > 0
        return
    with refuses(code):
        plan()


@pytest.mark.parametrize(
    ("key", "value", "code", "text"),
    [
        ("plan", "icosahedrom", "plan.unknown", "Did you mean 'icosahedron 12'?"),
        ("positions", [["1 deg", "2 deg"]], "plan.positions", "position 1 with 2 angles"),
        ("positions", [["1 deg", "2 deg", "3"]], "unit.missing", "'3' has no unit"),
        ("spin_rate", "0 deg/s", "campaign.value", "not be zero"),
        ("spin_rate", "10 deg", "unit.kind", "angular rate"),
    ],
)
def test_mistakes_in_settings_are_reported_with_their_place(key, value, code, text):
    from foucault.campaign.tables import validate

    with refuses(code) as caught:
        validate(TableSettings, {key: value}, ("procedure",))
    assert f"procedure.{key}" in caught.value.message and text in caught.value.message
