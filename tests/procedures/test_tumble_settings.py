"""Settings of a platform tumble: plans, what is drawn, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from foucault.coefficients import CoefficientVector
from foucault.errors import FoucaultError
from foucault.models.cluster import CONSTANTS, SOURCE_SYMBOLS, angles_of
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise
from foucault.plans.tumble import PUBLISHED, RATE
from foucault.procedures.platform_tumble import simulate
from foucault.procedures.platform_tumble.settings import (
    NOISE,
    PRIOR,
    Session,
    Settings,
    draw_errors,
    draw_printed,
)
from make_cluster import ARCSEC, DEG_H, UG, G, make_cluster
from refusals import refuses

SITE = Site(G, np.radians(40.0))


def test_a_plan_by_name_sequence_or_list():
    assert Settings().torquing is None
    np.testing.assert_array_equal(Settings(plan="published").torquing.rates, PUBLISHED.rates)
    fast = Settings(plan="published", rate=2 * RATE).torquing
    assert fast.duration == pytest.approx(2700)
    plan = Settings(plan="-x -z", segment=100.0, start=("1 deg", "0 deg", "90 deg"), ramp=2.0)
    assert plan.torquing.duration == 202
    np.testing.assert_allclose(np.degrees(plan.torquing.start), [1, 0, 90])
    np.testing.assert_allclose(plan.torquing.rates, -RATE * np.eye(3)[[0, 2]])
    listed = Settings.model_validate(
        {"steps": [{"rate": ["0.1 deg/s", "0 deg/s", "-0.2 deg/s"], "time": "30 s"}]}
    ).torquing
    np.testing.assert_allclose(listed.rates, np.radians([[0.1, 0, -0.2]]))
    assert listed.duration == 30


def test_arms_are_lengths():
    arms = Settings(
        arms=(("5 cm", "0 m", "0 m"), ("0 m", "50 mm", "0 m"), ("0 m", "0 m", "0.05 m"))
    )
    np.testing.assert_allclose(arms.lever_arms, 0.05 * np.eye(3))


@pytest.mark.parametrize(
    ("code", "match", "given"),
    [
        ("torquing.contradiction", "`plan` and `steps`",
         {"plan": "x", "steps": [{"rate": ["0 deg/s"] * 3, "time": "1 s"}]}),
        ("torquing.unused", "`segment` has no place where no plan is given", {"segment": 10.0}),
        ("torquing.unused", "`rate` has no place where the plan is a list of steps",
         {"rate": 0.01, "steps": [{"rate": ["0 deg/s"] * 3, "time": "1 s"}]}),
        ("torquing.unused", "`segment` has no place where the plan is 'published'",
         {"plan": "published", "segment": 10.0}),
        ("torquing.sequence", "'-q' is neither", {"plan": "-q"}),
        ("torquing.limit", "Step 1 .* 0.1 deg/s about x; the limit is 0.0572958",
         {"plan": "x", "rate": RATE, "rate_limit": 0.001}),
        ("unit.kind", "does not measure angle", {"start": ["1 m", "0 deg", "0 deg"]}),
        ("unit.missing", "arms: '3' has no unit", {"arms": [["3", "0 m", "0 m"]] * 3}),
        ("unit.kind", "does not measure angular rate",
         {"steps": [{"rate": ["1 deg", "0 deg/s", "0 deg/s"], "time": "1 s"}]}),
    ],
)  # fmt: skip
def test_settings_that_cannot_be(code, match, given):
    with refuses(code, match=match):
        Settings.model_validate(given)


@pytest.mark.parametrize("key", ["start_sd", "azimuth_sd", "rate", "segment", "rate_limit"])
@pytest.mark.parametrize("value", [0.0, -1.0])
def test_a_spread_of_nothing_is_refused(key, value):
    with pytest.raises(ValueError, match="greater than 0"):
        Settings.model_validate({"plan": "x", key: value})


def test_errors_are_drawn_about_the_means_of_the_source():
    """In the symbols of the source every mean is positive; here some names turn the sign."""
    drawn = np.array([draw_printed(seed).coefficients().values for seed in range(300)])
    by_symbol = {
        SOURCE_SYMBOLS[name][0]: SOURCE_SYMBOLS[name][1] * column
        for name, column in zip(CONSTANTS.names, drawn.T, strict=True)
    }
    table = {
        "kg0": (1, 0.2, DEG_H), "kg11": (0.5, 0.1, DEG_H / G), "kg12": (0.5, 0.1, DEG_H / G),
        "kg13": (0.5, 0.1, DEG_H / G), "kg31": (0.01, 0.005, DEG_H / G**2),
        "kg32": (0.01, 0.005, DEG_H / G**2), "kg33": (0.01, 0.005, DEG_H / G**2),
        "dK": (400, 50, 1e-6), "ka0": (100, 10, UG), "ka1": (100, 10, 1e-6),
        "ka2": (100, 10, 1e-6 / G), "D": (120, 20, ARCSEC), "th_": (120, 20, ARCSEC),
    }  # fmt: skip
    score = []
    for symbol, values in by_symbol.items():
        mean, sd, unit = next(row for key, row in table.items() if symbol.startswith(key))
        score.append((values / unit - mean) / sd)
    score = np.array(score)
    assert score.shape == (42, 300)
    low, high = stats.chi2.ppf([0.0025, 0.9975], score.size)
    assert low < np.sum(score**2) < high
    assert np.abs(score.mean(axis=1) * np.sqrt(300)).max() < stats.norm.ppf(1 - 0.005 / 42)
    misalignment = draw_printed(1).gyro_misalignment
    assert misalignment[0, 2] < 0 < misalignment[0, 1]


def test_errors_are_drawn_as_the_prior_believes():
    sd = CoefficientVector.prior(CONSTANTS, PRIOR).prior_sd
    score = np.array([draw_errors("navigation", k).coefficients().values for k in range(300)]) / sd
    low, high = stats.chi2.ppf([0.0025, 0.9975], score.size)
    assert low < np.sum(score**2) < high
    assert np.abs(score.mean(axis=0) * np.sqrt(300)).max() < stats.norm.ppf(1 - 0.005 / 42)


def test_a_grade_that_clusters_do_not_have():
    with pytest.raises(FoucaultError, match=r'grade = "mems".*drawn as "navigation" alone'):
        draw_errors("mems", 1)


def test_the_prior_is_the_usual_size_of_every_error():
    prior = CoefficientVector.prior(CONSTANTS, PRIOR)
    assert np.isfinite(prior.prior_sd).all()
    assert not prior.values.any()
    assert prior["gyro.drift"].prior_sd == pytest.approx(3 * [DEG_H])
    assert prior["accel.quadratic"].prior_sd == pytest.approx(3 * [100 * UG / G**2])
    own = CoefficientVector.prior(CONSTANTS, PRIOR | {"gyro.drift.y": (0.0, 9.0)})
    assert own["gyro.drift"].prior_sd == pytest.approx([DEG_H, 9.0, DEG_H])


def test_the_noise_is_that_of_the_source():
    assert NOISE.accel.white / np.sqrt(0.2) == pytest.approx(UG, rel=1e-7)
    assert NOISE.gyro.white**2 == pytest.approx(1.175e-16, rel=1e-3)
    assert NOISE.gyro.white == pytest.approx(0.05 * DEG_H * np.sqrt(2e-3), rel=1e-6)


def simulated(session=None, seed=1, **settings):
    return simulate(
        session or Session(), settings=Settings(**settings), model=make_cluster(),
        noise=ImuNoise(), site=SITE, seed=seed,
    )  # fmt: skip


def test_a_session_does_the_plan_of_the_settings():
    made = simulated(plan="-x +z", segment=30.0)
    assert len(made.log) == 301
    np.testing.assert_allclose(made.log.gyro[0, 0], -RATE, atol=8e-5)
    assert simulated().plan.name == "published"
    assert len(simulated(Session(interval=1.0)).log) == 5401
    with refuses("torquing.limit", match=r"the limit is 0\.0572958"):
        simulated(rate_limit=0.001, plan="published", rate=RATE)
    assert simulated(rate_limit=0.001).plan.duration == pytest.approx(1.5 * 2 * np.pi / 0.001)


def test_attitude_and_delay_are_drawn():
    start = ("10 deg", "-20 deg", "30 deg")
    short = {"plan": "x", "segment": 10.0}
    drawn = [simulated(seed=k, start=start, delay_sd=0.05, **short) for k in range(100)]
    off = np.degrees([angles_of(made.C_pn[0]) for made in drawn]) - [12, -17, 35]
    low, high = stats.chi2.ppf([0.0025, 0.9975], 300)
    assert low < np.sum((off / 0.1) ** 2) < high
    low, high = stats.chi2.ppf([0.0025, 0.9975], 100)
    assert low < np.sum([(m.acquisition.delay / 0.05) ** 2 for m in drawn]) < high
    exact = simulated(Session(attitude_sd=0.0, attitude=("0 deg",) * 3, delay=0.03), **short)
    np.testing.assert_allclose(angles_of(exact.C_pn[0]), 0, atol=1e-9)
    assert exact.acquisition.delay == 0.03


def test_how_it_is_driven_reaches_the_simulation():
    session = Session(kind="increment", command_interval=2.0, interval=0.5, edge=0.1)
    made = simulated(session, plan="x", segment=10.0, command_holds="until its time",
                     arms=(("1 m", "0 m", "0 m"),) * 3)  # fmt: skip
    how = made.acquisition
    assert (how.sampled, how.interval, how.command_interval) == ("increment", 0.5, 2.0)
    assert (how.holds, how.edge) == ("until its time", 0.1)
    np.testing.assert_array_equal(how.arms[:, 0], 1.0)
    published = simulated(Session(integrator="published"), plan="x", segment=10.0).log
    exponential = simulated(plan="x", segment=10.0).log
    np.testing.assert_allclose(published.accel, exponential.accel, atol=1e-4 * UG)
    assert (published.accel != exponential.accel).any()
