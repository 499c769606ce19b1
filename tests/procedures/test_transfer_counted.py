"""What a transfer alignment counts with: its columns, what is named, and its uncertainties."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from foucault.infer.linear_filter import kalman
from foucault.models.earth import Site
from foucault.models.left_out import sizes_of
from foucault.procedures import transfer_alignment
from foucault.procedures.transfer_alignment.counted import Counted
from foucault.procedures.transfer_alignment.problem import problem_of
from foucault.procedures.transfer_alignment.session import draw_errors
from foucault.procedures.transfer_alignment.settings import heard, usable
from foucault.result import Level
from make_left_out import ramp
from make_transfer_campaign import described

SIZES = sizes_of("tactical MEMS")
G = 9.80665


@cache
def flown(seed=0):
    """Return a flight and its truth."""
    c, model = described(), draw_errors("tactical", seed)
    made = transfer_alignment.simulate(c.session, settings=c.settings, model=model, noise=c.noise,
                                       site=c.site, seed=seed)  # fmt: skip
    return made.log, model.coefficients().with_others(made.beside)


def trial(c, log, sizes=SIZES, **more):
    known = {"site": c.site, "settings": c.settings, "noise": c.noise, "prior": c.prior} | more
    return transfer_alignment.trial(log, sizes=sizes, **known)


def problem(c, log, **settings):
    log = usable(log)
    settings, _ = heard(
        log.messages, c.settings.model_copy(update=settings | {"delay_method": "state"})
    )
    return problem_of(log, c.site, settings, c.noise, {}, sizes=SIZES, match=False)


CHANGES = {
    "drift.gyro.bias.z": (2e-5, lambda c, log, x: (c, replace(
        log, gyro=log.gyro + x * ramp(log) * [0, 0, 1]))),
    "drift.accel.scale.x": (2e-4, lambda c, log, x: (c, replace(
        log, accel=log.accel + x * ramp(log) * log.accel * [1, 0, 0]))),
    "accel.cross.zxx": (1e-5, lambda c, log, x: (c, replace(
        log, accel=log.accel + x * log.accel[:, :1] ** 2 * [0, 0, 1]))),
    "site.gravity": (-1e-3, lambda c, log, x: (
        replace(c, site=replace(c.site, gravity=c.site.gravity + x)), log)),
    "messages.rate": (1e-4, lambda c, log, x: (c, replace(log, master=replace(
        log.master, time=log.master.time + x * (log.master.time - log.master.time.mean()))))),
}  # fmt: skip


@pytest.mark.parametrize("name", CHANGES)
def test_a_state_does_what_the_term_does_to_the_free_run(name):
    """Put into the log or the place, the term changes the estimates as the state says it does."""
    size, change = CHANGES[name]
    c = described()
    log, _ = flown()
    model = problem(c, log).model
    system = model.about(model.start)
    changed, other = change(c, log, size)
    again = problem(changed, other).model
    moved = replace(again, slave=replace(again.slave, first=model.slave.first), start=model.start)
    z = moved.about(model.start).z - system.z
    j, x = model.names.index(name), np.zeros(len(model.names))
    foretold, x[j] = np.zeros_like(z), size
    for k in range(len(z)):
        x[: system.Phi.shape[1]] = system.Phi[k] @ x
        foretold[k] = system.H[k] @ x
    used = np.isfinite(system.R)
    off = np.abs(z - foretold)[used].max() / np.abs(foretold[used]).max()
    same = np.abs(z + foretold)[used].max() / np.abs(foretold[used]).max()
    assert min(off, same) < 0.05  # of what is only counted with the sign is free


def test_a_lever_arm_that_is_off_moves_velocities_as_its_state_does():
    c = described()
    log, _ = flown()
    x, y, z = (float(text.split()[0]) for text in c.settings.lever_arm)
    model = problem(c, log).model
    other = problem(c, log, lever_arm=(f"{x + 0.1} m", f"{y} m", f"{z} m")).model
    system = model.about(model.start)
    moved = replace(other, start=model.start).about(model.start)
    foretold = system.H[:, :, model.names.index("lever_arm.x")] * 0.1
    np.testing.assert_allclose(system.z - moved.z, foretold, atol=0.01 * np.abs(foretold).max())


def test_a_latitude_that_is_off_turns_as_its_state_does():
    """The Earth's rate of a place further north, against that of this one, over a short step."""
    c = described()
    site = Site.at(c.site.latitude, c.site.height)
    counted = Counted.of(c.settings, SIZES, site, placed=False)
    assert "site.latitude" in counted.names
    log, _ = flown()
    p = problem(c, log)
    model = replace(p.model, counted=(*p.model.counted, "site.latitude"),
                    sd=np.append(p.model.sd, 1e-4))  # fmt: skip
    names = model.names
    system = model.about(model.start)
    turn = system.Phi[0, :3, names.index("site.latitude")]
    L, step = c.site.latitude, model.steps(system.rows)[0]
    assert np.linalg.norm(turn) == pytest.approx(7.292115e-5 * step, rel=1e-3)
    assert turn[2] == pytest.approx(7.292115e-5 * step * np.cos(L), rel=1e-2)


def test_nothing_is_named_in_a_clean_flight_and_no_sd_is_smaller():
    c = described()
    log, _ = flown(1)
    result, sure = trial(c, log), trial(c, log, None)
    assert result.verdict.level is Level.PASS
    assert result.diagnostics["named"] == []
    assert (result.coefficients.sd > 0.999 * sure.coefficients.sd).all()
    rows = result.diagnostics["left_out"]
    assert {"accel.cross", "gyro.misalignment", "lever arm", "local gravity",
            "rate of the messages' clock", "mount under load", "gyro.bias drift",
            "prior of gyro.scale"} <= set(rows)  # fmt: skip
    table = result.tables["left_out"]
    assert set(table["group"]) == {n for n, r in rows.items() if r["kind"] == "left out"}
    assert all(table["basis"])


@pytest.mark.thorough
def test_a_term_of_seven_sizes_is_named_and_counts_as_much():
    c = described()
    log, _ = flown()
    drift = 7 * SIZES["accel.bias drift"][0]
    off = replace(log, accel=log.accel + drift * ramp(log) * [1, -1, 1])
    result = trial(c, off)
    assert result.verdict.level is Level.DOUBTFUL
    (named,) = result.diagnostics["named"]
    assert next(iter(named)) == "accel.bias drift"
    assert named["accel.bias drift"] == pytest.approx(7.0, rel=0.25)
    # As if it had been declared so large.
    declared = trial(c, off, dict(SIZES) | {"accel.bias drift": (
        named["accel.bias drift"] * SIZES["accel.bias drift"][0], "as given")})  # fmt: skip
    assert declared.diagnostics["named"] == []
    np.testing.assert_allclose(result.coefficients.sd, declared.coefficients.sd, rtol=1e-3)


@pytest.mark.thorough
def test_a_prior_that_is_wrong_is_named_and_not_the_terms():
    c = described()
    log, truth = flown()
    wrong = {"gyro.scale": (float(truth.value("gyro.scale.x")) + 2e-3, 5e-5)}
    result = trial(c, log, prior=dict(c.prior) | wrong)
    assert "prior of gyro.scale" in result.diagnostics["named"][0]
    assert result.verdict.level is Level.DOUBTFUL


@pytest.mark.thorough
def test_sizes_that_are_declared_stand_in_the_table():
    c = described()
    log, _ = flown()
    settings = c.settings.model_copy(update={"lever_arm_sd": 0.0, "clock_sd": 1e-6})
    known = dict(c.prior) | {"gyro.misalignment": (0.0, 1e-4)}
    rows = trial(c, log, settings=settings, prior=known).diagnostics["left_out"]
    assert "lever arm" not in rows
    assert rows["rate of the messages' clock"]["basis"] == "clock_sd"
    assert rows["mount under load"]["basis"] == "load_sd, judgement"
    assert rows["gyro.misalignment"]["basis"] == "[prior]"
    assert rows["gyro.misalignment"]["size"] == pytest.approx(1e-4)


def test_gravity_counts_once():
    c = described()
    log, _ = flown()
    p = problem(c, log)
    system = p.model.about(p.model.start)
    sd = p.prior.prior_sd[p.prior.names.index("site.gravity")]
    assert sd == c.site.gravity_sd
    known = replace(system, P0=system.P0.copy())
    j = p.model.names.index("site.gravity")
    known.P0[j, j] = 0.0
    z = p.model.names.index("accel.bias.z")
    with_it, without = kalman(system).cov[z, z], kalman(known).cov[z, z]
    result = trial(c, log).coefficients
    assert result.sd[result.names.index("accel.bias.z")] == pytest.approx(
        np.sqrt(with_it), rel=0.05
    )
    assert with_it > without
