"""What is not estimated by a filter: true as foretold, and drawn."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from foucault import campaign, procedures
from foucault.campaign import optimisation
from foucault.diagnose.study import nees
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.left_out import ByNoise
from foucault.result import Level

PLANS = {
    "transfer_alignment": ("tactical MEMS", {}, {"rate": 100.0, "with_outage": False}),
    "systematic": (
        "navigation RLG", {"sequence": ("9 positions",)}, {"rest_time": 40.0, "rate": 20.0},
    ),
    "platform_tumble": (
        "navigation RLG",
        {"plan": "-x -z -y +z", "rate": float(np.radians(0.4)), "segment": 400.0}, {},
    ),
}  # fmt: skip
OWN = {"transfer_alignment": "lever arm", "systematic": "accel.lever",
       "platform_tumble": "accel.delay"}  # fmt: skip


@cache
def planned(name: str, *, declared: bool) -> campaign.Campaign:
    """The template's campaign with a short session; its grade declared or told by noise."""
    grade, settings, session = PLANS[name]
    text = campaign.template(name)
    if declared:
        text = text.replace('# grade = "consumer MEMS"', f'grade = "{grade}"')
    c = campaign.parse(text)
    return replace(
        c, settings=c.settings.model_copy(update=settings),
        session=c.session.model_copy(update=session),
    )  # fmt: skip


@cache
def session(name: str, seed: int, *, declared: bool) -> campaign.Session:
    return campaign.simulate(planned(name, declared=declared), seed)


def solved(name: str, made: campaign.Session, sizes):
    c, record = made.campaign, procedures.load(name)
    return record.trial(
        made.simulation.log, site=c.site, settings=c.settings, noise=c.noise or record.noise,
        prior=c.prior, sizes=sizes,
    )  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("name", PLANS)
def test_a_calibration_has_the_uncertainties_that_were_foretold(name):
    made = session(name, 5, declared=False)
    assert made.sizes is None  # nothing is declared: the instrument holds nothing else
    told = optimisation.foresee(planned(name, declared=False))
    came = solved(name, made, ByNoise())
    names = [n for n in told.names if not n.startswith("attitude.")]
    ratio = told.coefficients.chosen(names).sd / came.coefficients.chosen(names).sd
    np.testing.assert_allclose(ratio, 1.0, rtol=0.1)
    share, basis = (
        dict(zip(told.left_out["group"], told.left_out[key], strict=True))
        for key in ("share", "basis")
    )
    there = dict(zip(*(came.tables["left_out"][k] for k in ("group", "share")), strict=True))
    assert set(share) <= set(there)
    assert all(v < 0.01 for g, v in there.items() if g not in share)
    assert all(share[g] == pytest.approx(there[g], abs=0.1) for g in share)
    assert "told by noise" in basis["accel.cross"]
    bought = [m for m in told.more if m.time == 0.0]
    assert bought and all(" known to " in m.what and m.ratio < 1 for m in bought)
    plain = solved(name, made, None).coefficients.chosen(names)
    assert np.median(came.coefficients.chosen(names).sd / plain.sd) > 1.2


@pytest.mark.thorough
@pytest.mark.parametrize("name", PLANS)
def test_a_declared_instrument_holds_what_is_not_estimated(name):
    """Its own is drawn too: lever arms, delays, clocks; four sessions together are as stated."""
    off, n = 0.0, 0
    for seed in range(4):
        made = session(name, seed, declared=True)
        assert made.sizes == planned(name, declared=True).sizes
        result = solved(name, made, made.sizes)
        c = result.coefficients
        e = c.values - made.truth.chosen(c.names).values
        off, n = off + float(nees(e[None], c.cov[None])[0]), n + len(e)
        assert result.verdict.level is Level.PASS, result.verdict.reasons
        assert OWN[name] in {*result.tables["left_out"]["group"], "accel.lever"}
    low, high = chi_square_limits(n, 0.01 / len(PLANS))
    assert low <= off <= high
    bare = session(name, 3, declared=False).simulation
    assert {"transfer_alignment": lambda s: s.made.slave.lever_m,
            "systematic": lambda s: s.arms[0], "platform_tumble": lambda s: s.acquisition.arms[0],
            }[name](made.simulation) != pytest.approx(0.0, abs=1e-9)  # fmt: skip
    ends = [s.log.accel[[0, -1]] for s in (made.simulation, bare)]
    assert np.abs(ends[0] - ends[1]).max() > 0


def test_what_a_motion_shows_is_a_matter_of_the_motion():
    told = optimisation.foresee(planned("transfer_alignment", declared=False))
    assert told.complete and not told.hardly and told.rank == told.states
    # The g-sensitivity hides the biases all the same: their sd says so.
    assert told.share[told.names.index("gyro.bias.x")] > 0.8


@pytest.mark.thorough
def test_one_setting_takes_a_slave_back_to_the_published_states():
    c = planned("transfer_alignment", declared=False)
    source = replace(c, settings=c.settings.model_copy(update={"left_out": False}))
    told = optimisation.foresee(source)
    assert told.left_out is None
    assert (told.sd < optimisation.foresee(c).sd).all()
