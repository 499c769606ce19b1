"""Allan variance: other programs, theory, recovery of known noise, and bad input."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from foucault import campaign
from foucault.diagnose import allan, allan_fit
from foucault.errors import FoucaultError
from foucault.tables import Log
from make_noise import draw
from refusals import refuses

FALSE_ALARM = 0.01
N = 4096
RUNS = 120  # intervals too narrow by half are caught with 96 %
SEVERAL = (1, 0.3, 0.1, 1e-4, 1e-7)
CASES = {
    "white": (0, 1, 0, 0, 0),
    "flicker": (0, 1, 1, 0, 0),
    "random walk": (0, 1, 0, 1e-2, 0),
    "ramp": (0, 1, 0, 0, 1e-6),
}


def _static(n=4096, dt=0.01, seed=1, **more):
    rng = np.random.default_rng(seed)
    accel = 0.01 * rng.normal(size=(n, 3)) + [0.0, 0.0, 9.81]
    return Log(np.arange(n) * dt, 1e-3 * rng.normal(size=(n, 3)), accel, **more)


# -- against others ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "theirs"), [("overlapping", "oadev"), ("modified", "mdev"), ("hadamard", "ohdev")]
)
def test_deviations_are_those_of_allantools(kind, theirs):
    allantools = pytest.importorskip("allantools", reason="allantools is not installed")
    y = 1e-5 * draw(20_000, (1, 1, 1, 1e-3, 1e-9), np.random.default_rng(1)) + 0.3
    tau, deviation = allan.deviations(y, 0.01, kind=kind)
    want = getattr(allantools, theirs)(y, rate=100.0, data_type="freq", taus=tau)
    np.testing.assert_allclose(tau[: len(want[0])], want[0], rtol=1e-12)
    np.testing.assert_allclose(deviation[: len(want[1])], want[1], rtol=1e-10)
    assert len(want[0]) >= len(tau) - 1  # it leaves out the longest where few terms are left


def test_slopes_are_those_of_the_standard():
    m = np.array([1.0, 2, 8, 64, 4096])
    got = allan_fit.expected("overlapping", m)
    want = [3 / m**2, 1 / m, 2 * np.log(2) / np.pi + 0 * m, m / 3, m**2 / 2]
    np.testing.assert_allclose(got, np.array(want).T, rtol=1e-9)


def test_slopes_of_the_other_kinds():
    # NIST SP 1065 and Walter (1994): white (m^2 + 1)/(2 m^3); Hadamard of white 1/m, walk m/6.
    m = np.array([1.0, 2, 8, 64])
    modified = allan_fit.expected("modified", m)
    np.testing.assert_allclose(modified[:, 1], (m**2 + 1) / (2 * m**3), rtol=1e-9)
    np.testing.assert_allclose(modified[:, 0], 3 / m**3, rtol=1e-9)
    np.testing.assert_allclose(modified[:, 4], m**2 / 2, rtol=1e-9)
    hadamard = allan_fit.expected("hadamard", m)
    np.testing.assert_allclose(hadamard[:, [0, 1, 3]],
                               np.array([10 / 3 / m**2, 1 / m, m / 6]).T, rtol=1e-9)  # fmt: skip
    assert not hadamard[:, 4].any()


def test_degrees_of_freedom_are_those_of_greenhall_and_riley():
    # White: m = 1 exactly, sum of (1, -1/2) squared; long tau: their table for tau = T/2..T/4.
    n = 1000
    dof = allan_fit.degrees_of_freedom("overlapping", n, [1], np.eye(5)[1])
    M = n - 1
    assert dof[0] == pytest.approx(M**2 / (M + 2 * (M - 1) / 4), rel=1e-12)


@pytest.mark.parametrize("kind", allan.KINDS)
@pytest.mark.parametrize("noise", [0, 1, 3])
def test_covariance_is_that_of_the_matrix_of_the_quadratic_form(kind, noise):
    """Brute force: cov(y'Ay, y'By) = 2 tr(A S B S) with the covariance of the samples."""
    n, m = 96, (1, 3, 12)
    step = np.tril(np.ones((n, n)))
    step_mean = np.tril(np.ones((n, n)), -1) + np.eye(n) / 2
    phase = np.vstack([np.zeros(n), step])  # samples to phase
    S = {
        0: 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1),
        1: np.eye(n),
        3: step_mean @ step_mean.T + np.eye(n) / 12,
    }[noise]
    forms = []
    for each in m:
        rows = np.zeros((n + 1 - allan_fit.SPAN[kind] * each + (kind == "modified"), n + 1))
        stencil = {"hadamard": (-1, 3, -3, 1)}.get(kind, (1, -2, 1))
        for i in range(len(rows)):
            for k, w in enumerate(stencil):
                for h in range(each if kind == "modified" else 1):
                    rows[i, i + k * each + h] += w / (each if kind == "modified" else 1)
        D = rows @ phase
        forms.append(D.T @ D / len(D) * allan_fit.norm(kind, each))
    mean = [np.trace(A @ S) for A in forms]
    p = np.eye(5)[noise]
    np.testing.assert_allclose(allan_fit.expected(kind, m) @ p, mean, rtol=1e-9)
    want = np.array([[2 * np.trace(A @ S @ B @ S) for B in forms] for A in forms])
    dof = allan_fit.degrees_of_freedom(kind, n, m, p)
    # The sum over lags is an integral where kinks are far apart: 1e-3.
    np.testing.assert_allclose(dof, 2 * np.square(mean) / np.diag(want), rtol=1e-3)
    if kind != "modified":
        T = allan_fit.covariance(kind, n, m)[noise, noise]
        np.testing.assert_allclose(T, want, rtol=2e-3, atol=1e-4 * want.min())


# -- recovery ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def studies():
    out = {}
    for i, (name, p) in enumerate(CASES.items()):
        rng = np.random.default_rng([2, i])
        out[name] = [allan.measure(draw(N, p, rng), 1.0) for _ in range(RUNS)]
    return out


@pytest.mark.thorough
def test_noise_is_recovered_inside_its_interval(studies):
    """Two-sided where the noise is there; where it is not, limits may only hold too often."""
    there = sum(np.count_nonzero(p) for p in CASES.values())
    absent = 5 * len(CASES) - there
    edge = FALSE_ALARM / (2 * there + absent)
    low, high = binom.ppf([edge, 1 - edge], RUNS, 0.95)
    for name, p in CASES.items():
        for i, truth in enumerate(np.sqrt(p)):
            noises = [channel.noises[i] for channel in studies[name]]
            inside = sum(noise.low <= truth <= noise.high for noise in noises)
            assert inside >= low, (name, allan.NOISES[i], inside)
            if all(noise.seen for noise in noises):
                assert inside <= high, (name, allan.NOISES[i], inside)


@pytest.mark.thorough
def test_intervals_that_are_too_narrow_are_caught(studies):
    there = sum(np.count_nonzero(p) for p in CASES.values())
    low = binom.ppf(FALSE_ALARM / (5 * len(CASES) + there), RUNS, 0.95)
    noises = [channel.noise("white") for channel in studies["white"]]
    assert sum(abs(noise.value - 1) < 1.96 / 1.5 * noise.sd for noise in noises) < low


@pytest.mark.thorough
def test_what_is_there_is_seen_and_what_is_not_is_not(studies):
    for name, key in [("flicker", "bias_instability"), ("random walk", "random_walk")]:
        # Another slow noise can stand in for it in a record; in one of twenty at most.
        assert sum(channel.noise(key).seen for channel in studies[name]) >= 0.95 * RUNS
    quantised = allan.measure(draw(N, (1, 0.01, 0, 0, 0), np.random.default_rng(7)), 1.0)
    assert quantised.noise("quantisation").seen
    false = [noise.seen for channel in studies["white"] for noise in channel.noises if
             noise.name != "white"]  # fmt: skip
    assert sum(false) <= binom.ppf(1 - FALSE_ALARM, len(false), 0.01)


@pytest.mark.thorough
def test_curves_of_pure_noise_have_no_excess(studies):
    for name, channels in studies.items():
        found = sum(channel.excess > 0 for channel in channels)
        assert found <= binom.ppf(1 - FALSE_ALARM / len(CASES), RUNS, 0.005), name


def test_units_of_time_scale_every_noise():
    y = draw(N, SEVERAL, np.random.default_rng(3))
    slow, fast = allan.measure(y, 1.0), allan.measure(y, 0.01)
    for i, (a, b) in enumerate(zip(slow.noises, fast.noises, strict=True)):
        scale = 0.01 ** (1, 0.5, 0, -0.5, -1)[i]
        for key in ("value", "low", "high"):
            assert getattr(b, key) == pytest.approx(scale * getattr(a, key), rel=1e-9)
    np.testing.assert_allclose(fast.tau, 0.01 * slow.tau)
    assert fast.longest == pytest.approx(0.01 * slow.longest)


def test_a_tone_shows_as_excess():
    y = np.random.default_rng(4).normal(size=N) + 2 * np.sin(0.3 * np.arange(N))
    assert allan.measure(y, 1.0).excess > 0.1


def test_a_ramp_without_noise():
    found = allan.measure(np.arange(1024) * 1e-3, 1.0)
    assert found.noise("ramp").value == pytest.approx(1e-3, rel=1e-6)
    assert found.noise("ramp").seen
    blind = allan.measure(np.arange(1024) * 1e-3, 1.0, "hadamard")
    assert np.isfinite(blind.low).all() and np.isfinite(blind.high).all()


# -- logs ----------------------------------------------------------------------------------


def test_noise_block_loads_and_means_what_was_measured():
    rng = np.random.default_rng(5)
    n, dt = 20_000, 0.01
    noise = np.stack([draw(n, (0, 1, 0.05, 0, 0), rng) for _ in range(6)], 1)
    log = Log(np.arange(n) * dt, 1e-4 * noise[:, :3], 1e-2 * noise[:, 3:])
    measured = allan.measure_log(log)
    block = allan.noise_block(measured)
    got = campaign.parse(campaign.template("hand_rotated") + "\n" + block).noise
    for triad, size in (("gyro", 1e-4), ("accel", 1e-2)):
        found = getattr(got, triad)
        values = [measured.channels[f"{triad}.{a}"].noise("white").value for a in "xyz"]
        assert found.white == pytest.approx(np.sqrt(np.mean(np.square(values))), rel=1e-3)
        assert found.white == pytest.approx(size * np.sqrt(dt), rel=0.05)
        values = [c.noise("bias_instability") for k, c in measured.channels.items() if triad in k]
        B = np.sqrt(np.mean([v.value**2 for v in values if v.seen]))
        assert found.bias_instability * 0.6174 == pytest.approx(0.6643 * B, rel=1e-3)
        flat = [c.tau[np.argmax(c.parts[2] / c.curve)] for k, c in measured.channels.items()
                if triad in k]  # fmt: skip
        mean = np.exp(np.mean(np.log(flat)))
        assert found.correlation_time * 1.8926 == pytest.approx(mean, rel=5e-3)  # three digits


def test_peak_of_markov_noise():
    u = np.linspace(1.5, 2.5, 100_001)  # tau over correlation time
    a = 2 / u * (1 - (3 - 4 * np.exp(-u) + np.exp(-2 * u)) / (2 * u))
    peak = (np.sqrt(a.max()), u[a.argmax()])
    np.testing.assert_allclose(allan.MARKOV_PEAK, peak, atol=1e-4)


def test_a_static_log_is_used_whole():
    measured = allan.measure_log(_static(), axes=("gyro.x", "accel"))
    assert list(measured.channels) == ["gyro.x", "accel.x", "accel.y", "accel.z"]
    assert (measured.start, measured.end) == (0.0, pytest.approx(40.95))
    assert {f.code for f in measured.findings} == {"allan.hidden"}


def _moving():
    log = _static(6000)
    log.gyro[:1000] += np.sin(np.arange(1000) / 5)[:, None]
    log.gyro[4500:] += np.sin(np.arange(1500) / 5)[:, None]
    return log


def test_the_longest_rest_of_a_log_that_moves():
    measured = allan.measure_log(_moving(), axes=("gyro.x",))
    assert 9.9 <= measured.start <= 11.0 and 44.0 <= measured.end <= 45.1
    assert measured.findings[0].code == "allan.longest_rest"
    assert measured.findings[0].message.startswith("The log moves; its longest rest, 10.")
    (told, *_) = allan.measure_log(_moving(), axes=("gyro.x",), rest=(0, 40)).findings
    assert told.code == "allan.moves" and "between 0 s and 40 s" in told.message


def test_a_slow_log_at_rest_does_not_seem_to_move():
    measured = allan.measure_log(_static(20_000, dt=1.0), axes=("gyro.x",))
    assert measured.end == 19_999.0


# -- bad input -----------------------------------------------------------------------------


def _fails(code, text, **words):
    log = words.pop("log")
    with refuses(code) as caught:
        allan.measure_log(log, **words)
    assert text in str(caught.value)


def test_too_short():
    _fails("allan.too_short", "There are 200 samples (1.99 s) at rest", log=_static(200))
    with pytest.raises(FoucaultError, match="needs 256 or more"):
        allan.measure(np.arange(10.0), 1.0)


def test_a_record_too_short_for_a_noise_says_so():
    measured = allan.measure_log(_static(), axes=("gyro.x",))
    (told,) = measured.findings
    assert told.message.startswith(
        "gyro.x: bias instability, rate random walk, rate ramp not seen. The record is too short"
    )
    noise = measured.channels["gyro.x"].noise("bias_instability")
    words = allan.described(noise, "gyro", measured.channels["gyro.x"].longest)
    assert words[0] == "not seen" and words[2].startswith("below ") and "tau up to" in words[2]


def test_constant():
    log = _static()
    log.gyro[:, 1] = 0.25
    measured = allan.measure_log(log, axes=("gyro",))
    assert list(measured.channels) == ["gyro.x", "gyro.z"]
    assert measured.findings[0].message.startswith("gyro.y reads one value throughout and was left")
    _fails("allan.constant", "gyro.y reads one value throughout: it is", log=log, axes=("gyro.y",))


def test_quantised():
    log = _static()
    log.gyro[:] = np.round(log.gyro / 0.005) * 0.005
    told = allan.measure_log(log, axes=("gyro.x",)).findings
    assert told[0].code == "allan.quantised"
    assert told[0].message.startswith("gyro.x repeats its last value in 97.6 % of the samples")
    assert told[0].message.endswith("below the step of its output (1030 deg/h).")


def test_missing_values():
    log = _static()
    log.accel[77, 2] = np.nan
    with pytest.raises(FoucaultError) as caught:
        allan.measure(log.accel[:, 2], 0.01, axis="accel.z")
    assert "accel.z has 1 missing or infinite values, the first at sample 77" in str(caught.value)


def test_uneven():
    log = _static()
    log.time[1::2] += 0.003
    _fails("allan.uneven", "needs evenly spaced samples", log=log)


def test_a_gap():
    log = _static()
    log.time[1000:] += 0.5
    measured = allan.measure_log(log, axes=("gyro.x",))
    assert measured.findings[0].message.startswith("The record has gaps, 1 in all; only its")
    assert measured.start == pytest.approx(10.5)


def test_no_rest():
    log = _static()
    busy = np.arange(len(log)) % 300 > 100
    log.gyro[busy] += np.sin(np.arange(busy.sum()) / 3)[:, None]
    _fails("allan.no_rest", "its longest rest has", log=log)


def test_words_that_are_not_known():
    _fails("allan.axis", "no axis 'gyro.w'. Did you mean 'gyro.", log=_static(), axes=("gyro.w",))
    _fails("allan.span", "between 100 s and 200 s", log=_static(), rest=(100, 200))
    with pytest.raises(FoucaultError, match="Did you mean 'hadamard'"):
        allan.check_kind("hadamar")
    with pytest.raises(FoucaultError, match="It must be from 1 to 50"):
        allan.deviations(np.arange(100.0), 1.0, np.array([51]))


def test_nothing_to_write():
    channel = allan.measure(np.diff(np.random.default_rng(6).normal(size=1025)), 1.0)
    with pytest.raises(FoucaultError, match="No noise was seen"):
        allan.noise_block(allan.LogAllan({"gyro.x": channel}, 0.0, 1.0, ()))
