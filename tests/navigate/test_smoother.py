"""The smoother: against dense conditioning on all measurements, and against the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.coefficients import CoefficientVector
from foucault.diagnose.study import nees
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import displaced, displacement
from foucault.models.imu import ImuModel
from foucault.models.ins_errors import Sensors
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.navigate.ins_filter import FilterRun, Updates, run, smooth
from foucault.navigate.strapdown import states_of
from foucault.plans.manoeuvres import Start
from make_ins import FLIGHT, SITE, errors, increments, made, off, tumble

SENSORS = Sensors.of(("gyro.bias", "accel.bias"))
NOISE = ImuNoise(accel=TriadNoise(white=2e-4), gyro=TriadNoise(white=3e-6))
SD = np.repeat([2e-4, 2e-2, 0.5, 1e-6, 2e-3], 3)
MEASURED = np.repeat([2e-3, 0.05], 3)
DECAY = {"accel.bias": 20.0}
WALK = {"accel.bias": 2e-3 * np.sqrt(2 / 20.0), "gyro.bias": 1e-8}


def session(seed, scale=1.0, plan=None, start=None, every=50, walk=False):
    """A run whose errors, noise and measurements are what the filter is told, times `scale`."""
    rng = np.random.default_rng(seed)
    start = start or Start(*SITE, heading=0.4, pitch=0.03, roll=-0.05)
    motion, time, state = made(plan or tumble(4.0, turns=4), start, rate=50)
    truth = motion.trajectory(time)
    e = scale * SD * rng.standard_normal(15)
    model = ImuModel.from_coefficients(CoefficientVector(SENSORS.layout, e[9:]))
    noise = ImuNoise(*(TriadNoise(white=scale * t.white) for t in (NOISE.accel, NOISE.gyro)))
    log = increments(motion, time, model, noise, rng)
    rows = np.arange(every, len(time), every)
    updates = Updates.none(rows)
    updates.velocity_n[:] = truth.velocity_n[rows]
    updates.velocity_n[:] += scale * MEASURED[:3] * rng.standard_normal((len(rows), 3))
    place = truth.latitude[rows], truth.longitude[rows], truth.height[rows]
    d = scale * MEASURED[3:] * rng.standard_normal((len(rows), 3))
    updates.position[:] = np.stack(displaced(*place, d), axis=-1)
    updates.sd[:] = scale * MEASURED
    updates.sd[1::2, :3] = updates.sd[::3, 3:] = np.inf
    how = {"correlation_time": DECAY, "wander": {k: scale * v for k, v in WALK.items()}}
    arguments = (log, off(state, e[:9]), SENSORS, updates, np.diag((scale * SD) ** 2), noise)
    found = run(*arguments, keep=True, **(how if walk else {}))
    return found, arguments, how if walk else {}, navigate_true(motion, time, state, rows), e[9:]


def navigate_true(motion, time, state, rows):
    from foucault.navigate.strapdown import navigate

    return navigate(increments(motion, time), state).history[rows]


def conditioned(arguments, how):
    """Errors of a free run at all epochs, given all that was measured: mean and covariance.

    The joint covariance of all epochs, conditioned at once: nothing recursive in it.
    """
    log, state, sensors, updates, P0, noise = arguments
    free = run(log, state, sensors, Updates.none(updates.rows), 0 * P0, noise, keep=True)
    n, m = len(P0), len(updates)
    T = np.diff(np.append(log.time[0], log.time[updates.rows]))
    q = np.zeros(n)
    q[:3], q[3:6] = noise.gyro.white**2, noise.accel.white**2
    decay = np.zeros(n)
    for name, value in how.get("wander", {}).items():
        q[9 + sensors.layout.group(name)] = value**2
    for name, value in how.get("correlation_time", {}).items():
        decay[9 + sensors.layout.group(name)] = 1 / value
    blocks = [P0]  # independent pieces: the start, then the noise of each epoch
    paths = [[np.eye(n)]]
    joint = np.zeros((m * n, m * n))
    through = []
    for k in range(m):
        F = np.diag(np.exp(-decay * T[k]))
        F[:9] = free.transitions[k]
        paths = [[*path, F @ path[-1]] for path in paths]
        half = np.diag(q) * T[k] / 2
        blocks.append(F @ half @ F.T + half)
        paths.append([np.eye(n)])
        through.append(F)
    for block, path in zip(blocks, paths, strict=True):
        steps = path[1:] if len(path) == m + 1 and block is P0 else path
        lift = np.zeros((m * n, n))
        lift[-len(steps) * n :] = np.concatenate(steps)
        joint += lift @ block @ lift.T
    z, H, R = [], [], []
    for k, x in enumerate(free.trajectory.history):
        at = states_of(x[None])
        back = at["C_nl"][0].T
        v = back @ (at["velocity_n"][0] - updates.velocity_n[k])
        place = (float(at[name][0]) for name in ("latitude", "longitude", "height"))
        d = -back @ displacement(*place, *updates.position[k])
        seen = np.flatnonzero(np.isfinite(updates.sd[k]))
        z.append(np.append(v, d)[seen])
        H.extend(k * n + 3 + seen)
        R.append(updates.sd[k, seen] ** 2)
    z, R = np.concatenate(z), np.concatenate(R)
    S = joint[np.ix_(H, H)] + np.diag(R)
    gain = np.linalg.solve(S, joint[H]).T
    cov = joint - gain @ joint[H]
    covs = np.array([cov[k * n : (k + 1) * n, k * n : (k + 1) * n] for k in range(m)])
    return free, (gain @ z).reshape(m, n), covs


@pytest.mark.parametrize("walk", [False, True])
@pytest.mark.parametrize("flying", [False, True])
def test_it_is_least_squares_over_all_epochs(walk, flying):
    """Errors a thousandth of the usual, so that all is linear."""
    start = Start(*SITE, heading=0.4, speed=100.0) if flying else None
    found, arguments, how, _, _ = session(1, 1e-3, FLIGHT[:3] if flying else None, start, walk=walk)
    free, mean, cov = conditioned(arguments, how)
    smoothed = smooth(found)
    sd = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
    scale = sd[:, :, None] * sd[:, None, :]
    assert np.max(np.abs(smoothed.cov - cov) / scale) < 1e-4
    np.testing.assert_allclose(smoothed.sd, sd, rtol=1e-4)
    got = errors(free.trajectory.history, smoothed.trajectory.history)
    # A velocity is measured in axes of the computed place, which v dr / R of it is left out of.
    allowed = 0.05 if flying else 2e-3
    assert np.max(np.abs(got - mean[:, :9]) / sd[:, :9]) < allowed
    assert np.max(np.abs(smoothed.coefficients - mean[:, 9:]) / sd[:, 9:]) < allowed
    assert np.max(np.abs(mean) / sd) > 10  # there was something to find


@pytest.mark.parametrize("walk", [False, True])
def test_the_adjoint_leads_from_the_filter_to_the_smoother(walk):
    found, *_ = session(2, walk=walk)
    smoothed, (lam, adj), P = smooth(found), found.adjoint, found.before
    sd = found.sd[0]
    cov = P - P @ adj @ P
    assert np.max(np.abs(cov - smoothed.cov) / np.outer(sd, sd)) < 1e-6
    back = found.coefficients - found.corrections[:, 9:] - np.einsum("kij,kj->ki", P, lam)[:, 9:]
    assert np.max(np.abs(back - smoothed.coefficients) / sd[9:]) < 1e-3


def test_nothing_is_known_worse_than_by_the_filter():
    found, *_ = session(2, walk=True)
    smoothed = smooth(found)
    for after, cov in zip(found.after, smoothed.cov, strict=True):
        sd = np.sqrt(np.diag(after))
        gain = (after - cov) / np.outer(sd, sd)
        assert np.linalg.eigvalsh((gain + gain.T) / 2)[0] > -1e-9
    np.testing.assert_array_equal(smoothed.cov[-1], found.after[-1])
    np.testing.assert_allclose(
        smoothed.trajectory.history[-1], found.trajectory.history[-1], rtol=0, atol=1e-14
    )
    assert np.all(smoothed.sd[0, 12:15] < 0.6 * found.sd[0, 12:15])


def test_a_constant_was_always_what_it_is_at_the_end():
    found, *_ = session(2)
    smoothed, last = smooth(found), found.after[-1][9:, 9:]
    sd = np.sqrt(np.diag(last))
    assert np.all(found.sd[0, 12:] > 1.1 * sd[3:])
    np.testing.assert_allclose(
        smoothed.cov[:, 9:, 9:] / np.outer(sd, sd), [last / np.outer(sd, sd)] * len(found.time),
        rtol=0, atol=1e-9,
    )  # fmt: skip
    away = (smoothed.coefficients - found.coefficients[-1]) / sd
    assert np.abs(away).max() < 1e-6


@pytest.mark.thorough
def test_smoothed_states_are_nearer_to_the_truth():
    """Many runs: the NEES of every fourth epoch, and the mean square beside the filter's."""
    runs, at = 40, slice(0, None, 4)
    before, after, all_nees = 0.0, 0.0, []
    for seed in range(runs):
        found, _, _, truth, coefficients = session(seed + 10)
        smoothed = smooth(found)
        pairs = []
        for one in (found, smoothed):
            e = np.concatenate([
                errors(one.trajectory.history, truth), coefficients - one.coefficients
            ], axis=1)  # fmt: skip
            pairs.append(e)
        early = slice(0, len(truth) // 2)
        before = before + np.mean(pairs[0][early] ** 2, axis=0)
        after = after + np.mean(pairs[1][early] ** 2, axis=0)
        all_nees.append(nees(pairs[1][at], smoothed.cov[at]))
    all_nees = np.array(all_nees)
    for column in all_nees.T:  # epochs of one run hang together, runs do not
        low, high = chi_square_limits(15 * runs, tests=all_nees.shape[1])
        assert low < column.sum() < high
    assert np.all(after[:9] < before[:9])
    assert np.mean(after[:9] / before[:9]) < 0.7


def test_a_restart_cuts_what_went_before():
    """A jump of velocity and position, as of an arm that is not modelled: states stay right."""
    found, arguments, _, truth, _ = session(3)
    log, state, sensors, updates, P0, noise = arguments
    k = len(updates) // 2
    cut = replace(updates, restart=updates.restart.copy(), sd=updates.sd.copy())
    cut.restart[k], cut.sd[k] = True, MEASURED
    jumped = replace(log, dvel_b=log.dvel_b.copy())
    jumped.dvel_b[cut.rows[k] - 10] += [0.5, -0.3, 0.2]
    again = run(jumped, state, sensors, cut, P0, noise, keep=True)
    smoothed = smooth(again)
    e = errors(smoothed.trajectory.history, truth) / smoothed.sd[:, :9]
    assert np.abs(e).max() < 5.0
    spoilt = smooth(run(jumped, state, sensors, updates, P0, noise, keep=True))
    assert np.abs(errors(spoilt.trajectory.history, truth) / spoilt.sd[:, :9]).max() > 20.0
    # Before the restart nothing is known of velocity and position that came after it.
    assert np.all(smoothed.sd[k - 1, 3:9] > 0.99 * smooth(found).sd[k - 1, 3:9])


def test_a_run_that_kept_nothing_is_refused():
    _, (log, state, sensors, updates, P0, noise), *_ = session(4)
    found = run(log, state, sensors, updates, P0, noise)
    assert isinstance(found, FilterRun)
    with pytest.raises(ValueError, match="keep=True"):
        smooth(found)


def test_what_is_known_exactly_stays_as_it_is():
    """No position error at the start, and a coefficient of no variance."""
    _, (log, state, sensors, updates, P0, noise), *_ = session(5)
    P0[6:9, 6:9] = 0.0
    P0[9] = P0[:, 9] = 0.0
    smoothed = smooth(run(log, state, sensors, updates, P0, noise, keep=True))
    assert np.isfinite(smoothed.sd).all()
    np.testing.assert_array_equal(smoothed.coefficients[:, 0], 0.0)


def test_what_is_known_to_rounding_only():
    """Without noise a covariance is nearly singular; every state leads to that at the end."""
    _, (log, state, sensors, updates, P0, _), *_ = session(4)
    P0[10:, 10:] = np.outer(v := np.sqrt(np.diag(P0))[10:], v)  # one unknown for five
    found = run(log, state, sensors, updates, P0, ImuNoise(), keep=True)
    smoothed, sd, on = smooth(found), found.sd[-1], np.eye(15)
    for k in range(len(found.time) - 1, -1, -1):
        away = on @ smoothed.cov[k] @ on.T - found.cov
        assert np.max(np.abs(away) / np.outer(sd, sd)) < 1e-6
        on = on @ found.passed[k]
