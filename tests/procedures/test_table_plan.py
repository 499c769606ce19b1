"""What is said of a session on a table beforehand comes true when it is calibrated."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest

from foucault.models.earth import Site
from foucault.models.noise import ImuNoise, grade
from foucault.procedures import multi_position, norm_observation, turntable
from foucault.procedures.on_table import plan
from foucault.procedures.on_table.session import TableSettings
from foucault.procedures.record import Beforehand
from foucault.simulate.hand_rotated import draw_errors
from refusals import refuses

SITE = Site(9.81, np.radians(45.0), gravity_sd=2e-4)
NOISE = grade("tactical").noise

PERFECT = dict.fromkeys(("position_sd", "plumb_sd", "orthogonality_sd", "zero_sd"), 0.0)
SHORT = {"rest_time": 20.0, "turns": 2}


def foreseen(module, noise=NOISE, prior=None, session=(), extras=False, **settings):
    """Foresee a session; what more would buy takes most of the time, and is left out."""
    with nullcontext() if extras else patch.object(plan, "_more", return_value=()):
        return module.PROCEDURE.foresee(Beforehand(
            module.Settings(**settings), session=module.Session(**SHORT, **dict(session)),
            site=SITE, noise=noise, prior=prior or {}, typical=NOISE,
        ))  # fmt: skip


def came(module, seed, noise=NOISE, prior=None, session=(), simulated=NOISE, **settings):
    chosen = module.Settings(**settings)
    made = module.simulate(
        module.Session(**SHORT, **dict(session)), settings=chosen, noise=simulated, site=SITE,
        model=draw_errors("tactical", seed), seed=seed,
    )  # fmt: skip
    return module.calibrate(made.log, site=SITE, settings=chosen, noise=noise, prior=prior)


@pytest.mark.thorough
def test_noise_that_will_be_measured_costs_a_little():
    """Beside its noise the bias at rest is free: the calibration will not know the noise either."""
    found = foreseen(turntable, noise=None, plan="dodecahedron 20")
    known = foreseen(turntable, plan="dodecahedron 20")
    assert (found.sd >= known.sd * (1 - 1e-9)).all() and (found.sd > 1.01 * known.sd).any()
    ratio = [came(turntable, s, None, plan="dodecahedron 20").coefficients.sd / found.sd
             for s in (1, 2, 3)]  # fmt: skip
    # Scatter of 60 readings tells the noise to a tenth.
    assert np.abs(np.log(np.mean(ratio, axis=0))).max() < 0.3


@pytest.mark.thorough
def test_errors_of_the_table_are_in_what_is_foretold():
    """Errors of 20 arcsec in every position of a table that is believed: the scatter is 100 ug."""
    session = {"position_sd": 20 * multi_position.ARCSEC}
    found = foreseen(multi_position, plan="dodecahedron 20", session=session)
    calm = foreseen(multi_position, plan="dodecahedron 20", session=PERFECT)
    assert found.sd[0] / calm.sd[0] > 3
    sds = [came(multi_position, s, session=session, plan="dodecahedron 20").coefficients.sd
           for s in range(1, 7)]  # fmt: skip
    ratio = np.mean(sds, axis=0) / found.sd
    assert np.abs(np.log(ratio)).max() < 0.2


def test_a_prior_holds_what_the_session_does_not_show():
    prior = {"accel.misalignment": (1e-4, 2e-5), "gyro.misalignment": (0.0, 3e-5)}
    found = foreseen(norm_observation, prior=prior, plan="6 faces")
    assert found.complete and "means in [prior]" in found.linearised_at
    assert found.coefficients.value("accel.misalignment.yx") == 1e-4
    free = foreseen(norm_observation, plan="6 faces", extras=True)
    assert not free.complete and free.rank == 18 and not free.more
    assert len(free.unseen) == 3 and "not seen at all" in free.unseen[0]
    (told,) = free.findings
    assert told.code == "table.unseen"
    assert "'6 faces' do not show accel.misalignment.yx" in told.message


def test_accelerometers_alone_where_the_latitude_is_not_known():
    said = {"session": norm_observation.Session(**SHORT), "noise": NOISE, "prior": {}}
    found = norm_observation.PROCEDURE.foresee(
        Beforehand(
            norm_observation.Settings(plan="dodecahedron 20"),
            site=replace(SITE, latitude=None),
            **said,
        )
    )
    assert len(found.names) == 9 and found.duration < 20 * 30


def test_more_is_worth_what_it_turns_out_to_be():
    """The two extras against sessions planned with them."""
    found = foreseen(norm_observation, plan="dodecahedron 20", extras=True)
    position, longer = found.more
    assert "one more position" in position.what and longer.what == "rests of 35 s"
    assert longer.time == pytest.approx(300.0)
    other = norm_observation.PROCEDURE.foresee(Beforehand(
        norm_observation.Settings(plan="dodecahedron 20"),
        session=norm_observation.Session(rest_time=35.0, turns=2), site=SITE, noise=NOISE, prior={},
    ))  # fmt: skip
    assert longer.ratio == pytest.approx(np.exp(np.log(other.sd / found.sd).mean()))
    assert longer.ratio < position.ratio < 1
    # Any one more of twenty is worth about a fortieth; the best place a little more.
    assert 0.95 < position.ratio < 1 - 1 / 60
    assert position.best[0][1] == min(r for _, r in position.best) < position.ratio


def test_time_is_that_of_the_simulated_session():
    made = norm_observation.simulate(
        norm_observation.Session(**SHORT), settings=norm_observation.Settings(),
        model=draw_errors("tactical", 1), noise=ImuNoise(), site=SITE, seed=1,
    )  # fmt: skip
    assert foreseen(norm_observation).duration == pytest.approx(made.log.time[-1], abs=0.06)


def test_limits_of_the_table():
    found = foreseen(
        norm_observation, cable_limit=4 * np.pi, middle_range=(-0.5, 4.2),
        inner_range=(-np.pi, np.pi), angle_step=np.radians(10),
    )  # fmt: skip
    kept = {limit.name: limit.kept for limit in found.limits}
    assert kept == {
        "outer angle, turns counted": False,
        "largest middle angle": True,
        "smallest middle angle, negative": False,
        "largest inner angle": True,
        "smallest inner angle, negative": True,
        "angles off the steps": False,
    }
    assert found.limits[2].needed == pytest.approx(np.radians(58.2825), abs=1e-5)
    assert not found.complete
    made = norm_observation.simulate(
        norm_observation.Session(**SHORT), settings=norm_observation.Settings(),
        model=draw_errors("tactical", 1), noise=ImuNoise(), site=SITE, seed=1,
    )  # fmt: skip
    assert found.limits[0].needed == pytest.approx(
        np.abs(made.log.table.angles[:, 0]).max(), abs=0.01
    )


def test_a_range_that_runs_backwards_is_refused():
    with pytest.raises(ValueError, match="its first angle should not be larger"):
        TableSettings(middle_range=("95 deg", "-95 deg"))
    assert TableSettings(middle_range=("-95 deg", "95 deg")).middle_range[0] < 0
    with refuses("table.range"):
        foreseen(norm_observation, inner_range=(0.1, 0.2), angle_step=1.0)
