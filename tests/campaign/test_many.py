"""Studies of planned sessions: many trials at once say what trials one by one say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import ks_2samp, kstest

from foucault import campaign, monte_carlo, procedures
from foucault.campaign import many, study
from foucault.errors import FoucaultError
from foucault.infer import mixed
from foucault.infer.batched import Spectrum
from refusals import refuses

SIX = campaign.template("six_position").replace(
    '# placement_sd = "5 arcmin"', 'placement_sd = "1 arcmin"'
)

MANY = ("ferraris", "hand_rotated", "norm_observation", "turntable", "multi_position",
        "rate_table", "magnetometer")  # fmt: skip


def described(text: str) -> campaign.Campaign:
    return campaign.parse(text, "campaign.toml")


def solved(c: campaign.Campaign, n: int, seed: int = 0) -> dict[str, np.ndarray]:
    block = many.block_of(c, seed)
    size = block.plan.size
    parts = [block(range(a, min(a + size, n))) for a in range(0, n, size)]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def alike(batched: study.Study, single: study.Study, family: float = 0.01) -> list[str]:
    """Return coefficients whose errors, or errors over their sd, have another distribution."""
    tests = 2 * len(batched.names) + 1
    out = []
    for k, name in enumerate(batched.names):
        pairs = ((batched.error, single.error), (batched.error / batched.sd,
                                                  single.error / single.sd))  # fmt: skip
        if any(ks_2samp(a[:, k], b[:, k]).pvalue < family / tests for a, b in pairs):
            out.append(name)
    if ks_2samp(batched.nees, single.nees).pvalue < family / tests:
        out.append("NEES")
    return out


def test_a_trial_has_the_errors_of_its_own_least_squares():
    """Readings without errors give the instrument back; the prediction is that of the model."""
    c = described(SIX)
    known, _ = campaign.optimisation.beforehand(c)
    procedure = procedures.load(c.procedure)
    planned = procedure.planned(replace(known, sizes=None), measured=True)
    block = many.block_of(c, 3)
    truth = many.instruments(c, block.plan.names, 6, np.random.default_rng(5))
    found = block.plan.solve(truth, np.zeros((6, len(block.plan.errors))))
    assert found.converged.all()
    sd = np.sqrt(np.diagonal(found.cov, axis1=1, axis2=2))
    assert (np.abs(found.error) < 1e-6 * sd).all()  # no errors of readings, none of the estimate
    # The prediction followed to second order is that of the model, to third order of the errors.
    model, state = planned.fit.model, planned.fit.state
    step = np.zeros(len(block.plan.unit))
    step[: len(block.plan.names)] = truth[0] - block.plan.here
    step[len(block.plan.names) :] = 0.01  # mounted 10 mrad off about each axis
    n, d, _ = planned.fit.at.jacobian.shape
    known_ = [s for s in planned.fit.at.sources if s.sd is not None]
    covariance = mixed.Covariance(known_, {}, (n, d), np.ones(n))
    moved = planned.fit.at.residuals - model.linearise(model.retract(state, step)).residuals
    exact = covariance.whiten(moved[:, :, None])[:, 0]
    none = np.zeros((1, len(block.plan.errors)))
    followed = block.plan.jet.readings((step / block.plan.unit)[None], none)
    linear = block.plan.jet.readings(1e-6 * (step / block.plan.unit)[None], none)[0] / 1e-6
    assert np.abs(followed[0, : n * d] - exact).max() < 1e-2 * np.abs(linear[: n * d] - exact).max()


def test_the_instruments_are_those_of_their_class():
    c = described(SIX)
    names = procedures.load("six_position").names(c.settings, c.session)
    drawn = many.instruments(c, names, 4000, np.random.default_rng(1))
    sd = [spread_of(name) for name in names]
    p = [kstest(drawn[:, k] / sd[k], "norm").pvalue for k in range(len(names))]
    assert min(p) > 0.01 / len(names)
    errors = '[simulate.errors]\n"accel.bias.x" = "0.02 m/s^2"\n'
    one = described(SIX.replace("[simulate.errors]", errors) if "[simulate.errors]" in SIX
                    else SIX + "\n" + errors)  # fmt: skip
    set_ = many.instruments(one, names, 5, np.random.default_rng(1))
    assert (set_[:, names.index("accel.bias.x")] == 0.02).all()


def spread_of(name: str) -> float:
    from foucault.models.noise import grade

    return grade("mems").spread[name.rpartition(".")[0]]


@pytest.mark.thorough
def test_the_same_bytes_for_any_number_of_workers_and_after_an_interruption(tmp_path: Path):
    c = described(SIX)
    for workers in (1, 2, 4):
        many.run(c, 9000, tmp_path / str(workers), seed=4, workers=workers)
    first = (tmp_path / "1" / study.TRIALS_FILE).read_bytes()
    assert (tmp_path / "2" / study.TRIALS_FILE).read_bytes() == first
    assert (tmp_path / "4" / study.TRIALS_FILE).read_bytes() == first
    (tmp_path / "2" / study.TRIALS_FILE).unlink()
    part = sorted((tmp_path / "2" / study.FOLDER).iterdir())[1]
    part.unlink()
    many.run(c, 9000, tmp_path / "2", seed=4)
    assert (tmp_path / "2" / study.TRIALS_FILE).read_bytes() == first
    with refuses("study.other"):
        study.run(c, 20, tmp_path / "1", seed=4)


def test_its_errors_are_as_large_as_its_uncertainties():
    found = study.Study.of(
        procedures.load("six_position").names(*settings_of(SIX)), solved(described(SIX), 4000)
    )
    ratio = np.sqrt(np.mean((found.error / found.sd) ** 2, axis=0))
    assert (np.abs(ratio - 1) < 0.1).all()
    assert found.status == {"converged": 4000}


def settings_of(text: str):
    c = described(text)
    return c.settings, c.session


def test_sizes_found_fast_are_those_found_in_full():
    """Random contrasts of two sources: one as large as nothing, as the noise, and far larger."""
    rng = np.random.default_rng(8)
    A, B = rng.standard_normal((14, 5)), rng.standard_normal((14, 9))
    V = {"a": A @ A.T, "b": B @ B.T}
    spectra = {name: Spectrum(v, *np.linalg.eigh(v)) for name, v in V.items()}
    for size in (0.0, 0.3, 10.0):
        z = rng.standard_normal((60, 14)) + size * rng.standard_normal((60, 5)) @ A.T
        for i, row in enumerate(z):
            found, unlikely = mixed._most_likely(row, {"a": V["a"]})
            alone = found["a"]
            var, _ = spectra["a"].best(z[i : i + 1])
            gain = spectra["a"].gain(z[i : i + 1])[0]
            if gain > 1e-3:
                assert var[0] == pytest.approx(alone, rel=5e-3, abs=1e-6)
            else:
                assert alone < 1e-2
            # What another gains beside it is never taken for less than a third of what it is.
            _, best = mixed._most_likely(row, V)
            more = unlikely - best
            told = spectra["a"].more(z[i : i + 1], np.array([alone]), V["b"])[0]
            assert told >= more / 3 - 0.2


def test_what_cannot_be_drawn_so_is_refused():
    tumble = described(campaign.template("platform_tumble"))
    with pytest.raises(FoucaultError) as problem:
        many.block_of(tumble, 0)
    assert problem.value.code == "study.not_batched"
    errors = '[simulate.errors]\n"gyro.g_sensitivity.xx" = "0.1 deg/h/g"\n'
    text = SIX.replace("[simulate.errors]", errors) if "[simulate.errors]" in SIX else SIX + errors
    with refuses("study.other_errors", "gyro.g_sensitivity.xx"):
        many.block_of(described(text), 0)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["six_position", "norm_observation", "ferraris"])
def test_many_at_once_say_what_trials_one_by_one_say(name: str, tmp_path: Path):
    """A standard deviation that is wrong by a factor of 1.3 is found out: that is tried too."""
    c = described(SIX if name == "six_position" else campaign.template(name))
    n = {"six_position": 200, "norm_observation": 60, "ferraris": 120}[name]
    single = study.run(c, n, tmp_path / "single", map=monte_carlo.threads(2))
    batched = study.Study.of(single.names, solved(c, 1000))
    assert alike(batched, single) == []
    wrong = replace(batched, error=1.3 * batched.error, nees=1.69 * batched.nees)
    assert alike(wrong, single)  # the test has the power to tell


@pytest.mark.thorough
@pytest.mark.parametrize("name", MANY)
def test_every_procedure_of_means_can_be_studied_so(name: str):
    found = solved(described(campaign.template(name)), 60)
    names = [key.partition(".")[2] for key in found if key.startswith("sd.")]
    z = np.array([found[f"error.{n}"] / found[f"sd.{n}"] for n in names])
    assert np.mean(found["status"] == "converged") > 0.95
    assert 0.6 < np.sqrt(np.nanmean(z**2)) < 1.2
