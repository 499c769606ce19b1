"""What north seeking does not estimate: columns as the simulator has it, and what cancels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.detect.dwells import find_dwells
from foucault.diagnose.study import nees
from foucault.estimate.north import OnTurntable, Rig, names_of
from foucault.estimate.north_reduction import Nuisance, reduce
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.left_out import changes, sizes_of, terms
from foucault.models.north_seeker import SEEKER, Dwells
from foucault.procedures.north_seeking import PROCEDURE
from foucault.procedures.north_seeking.counted import again
from foucault.result import Level
from sessions import QUIET, SITE, Case, instrument, made, truth
from sessions import SEEKER as NOISE

SIZES = sizes_of("consumer MEMS")
TILTED = {"tilts": ["8 deg", "-8 deg", "0 deg"]}
CASES = {
    "tilted": Case("north_seeking", {}, TILTED, noise=NOISE),
    "on the case": Case("north_seeking", {}, TILTED | {"accelerometers": "case"}, noise=NOISE),
    "level": Case("north_seeking", {}, {}, noise=NOISE),
}
OF_INSTRUMENT = [g for g in SIZES if g in {n.rpartition(".")[0] for n in LAYOUT.names}]


def model_of(case: Case, log) -> tuple[OnTurntable, Dwells]:
    """A session without noise, of an instrument without errors, as it is solved."""
    dwells = find_dwells(log)
    tilt = "one axis" if case.planned.tilts == ("0 deg",) else "each"
    rig = Rig(dwells.heading, SITE, tilt, True, level_sd=np.inf if tilt == "one axis" else 0.0)
    names = names_of(tilt, True, tilt == "each")
    pairs = reduce(dwells, NOISE, Nuisance())
    return OnTurntable(pairs, rig, SEEKER.subset(names)), dwells


def columns(case: Case, group: str) -> dict[str, np.ndarray]:
    """What one size of each term of a group does to the residuals."""
    model, dwells = model_of(case, made(case, 1, ImuModel(), QUIET).log)
    of, zero = again(model, dwells, NOISE), model.residuals(model.start)
    _, motion = of.motion(model.start)
    some = terms(model.layout.names, SITE, {group: SIZES[group]})
    return {
        term.name: of.residuals(model.start, by) - zero
        for term, by in zip(some, changes(some, ImuModel(), motion), strict=True)
    }


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("group", OF_INSTRUMENT)
def test_a_column_is_what_the_simulator_does_with_the_term(name: str, group: str) -> None:
    case, some = CASES[name], columns(CASES[name], group)
    zero = model_of(case, made(case, 1, ImuModel(), QUIET).log)[0]
    for term, column in some.items():
        log = made(case, 1, instrument(case, {term: SIZES[group][0]}), QUIET).log
        other = model_of(case, log)[0]
        moved = other.residuals(zero.start) - zero.residuals(zero.start)
        scale = max(np.abs(moved).max(), 1e-13)
        np.testing.assert_allclose(column, moved, atol=1e-3 * scale, err_msg=term)


def test_a_drift_is_a_ramp_over_the_session_along_the_sensing_axis_alone() -> None:
    case, group = CASES["tilted"], "gyro.bias drift"
    some, simulation = columns(case, group), made(case, 1, ImuModel(), QUIET)
    log, size = simulation.log, SIZES[group][0]
    middle = log.time + log.averaged / 2
    span = (log.time + log.averaged)[-1] - log.time[0]
    drifting = replace(log, gyro=log.gyro + size * (middle - middle.mean()) / span)
    a, b = model_of(case, log)[0], model_of(case, drifting)[0]
    moved = b.residuals(b.start) - a.residuals(a.start)
    np.testing.assert_allclose(some[f"{group} y"], moved, atol=1e-6 * np.abs(moved).max())
    assert not some[f"{group} x"].any() and not some[f"{group} z"].any()


def test_what_opposite_stops_cancel_costs_nothing() -> None:
    """Constants and what goes twice per turn; what goes once per turn stays."""
    for group, gone, stays in (
        ("gyro.g_sensitivity", ["yz"], ["yx", "yy"]), ("gyro.asymmetry", ["y"], []),
        ("accel.quadratic", ["y"], []), ("accel.asymmetry", ["y"], []),
        ("accel.cross", ["yxx", "yxy", "yzz"], ["yxz", "yyz"]),
        ("gyro.deflection", ["yxx", "yzz"], ["yxz", "yzx"]),
    ):  # fmt: skip
        found = {n.rpartition(".")[2]: c for n, c in columns(CASES["tilted"], group).items()}
        # what the least significant digits of such readings leave
        small = 1e-9 if group.startswith("gyro") else 1e-6
        largest = max(np.abs(c).max() for c in found.values())
        for axes in gone:
            assert np.abs(found[axes]).max() <= max(small * largest, 1e-15), (group, axes)
        for axes in stays:
            assert np.abs(found[axes]).max() > 1e-11, (group, axes)


FIBRE = sizes_of("tactical FOG")


def calibrated(case: Case, log, **settings: float):
    site, chosen = replace(SITE, gravity_sd=4e-4), case.stated.model_copy(update=settings)
    return case.record.trial(log, site=site, settings=chosen, noise=NOISE, sizes=FIBRE)


def session(case: Case, seed: int):
    """A session that holds every term at its size, base, table, headings and place among them."""
    rng = np.random.default_rng([seed, 3])
    errors = made(case, seed).model
    own = [t for t in terms(SEEKER.names, SITE, FIBRE) if t.name in LAYOUT]
    held = {t.name: t.size * float(rng.standard_normal()) for t in own}
    errors = ImuModel.from_coefficients(errors.coefficients(LAYOUT.names).with_values(held))
    planned, settings, errors = PROCEDURE.drawn(case.planned, case.done, errors, rng)
    off = FIBRE["latitude"][0] * rng.standard_normal()
    return PROCEDURE.simulate(
        planned, settings=settings, model=errors, noise=NOISE, seed=seed,
        site=replace(SITE, latitude=SITE.latitude + off),
    )  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("name", CASES)
def test_with_every_term_at_its_size_uncertainties_are_right_and_sessions_pass(name: str) -> None:
    case, scores, passed, n = CASES[name], [], 0, 12
    for seed in range(n):
        simulation = session(case, seed)
        result = calibrated(case, simulation.log)
        c = result.coefficients
        e = c.values - truth(simulation, c.names)
        scores.append(float(nees(e[None], c.cov[None])[0]))
        passed += result.verdict.level is Level.PASS
    low, high = chi_square_limits(n * len(e), tests=len(CASES))
    assert low < sum(scores) < high, np.round(np.array(scores) / len(e), 2)
    assert passed >= n - 2


def test_what_is_said_of_base_table_and_place_counts_once_and_as_it_was_said() -> None:
    case = CASES["tilted"]
    log = made(case, 1).log
    angle = np.radians(1 / 60)
    usual = calibrated(case, log)
    told = calibrated(case, log, latitude_sd=angle, heading_offset_sd=angle, index_sd=angle)
    for result, words in ((usual, "judgement"), (told, "_sd as given")):
        left, sources = result.tables["left_out"], result.diagnostics["sources"]
        rows = dict(zip(left["group"], left["basis"], strict=True))
        assert list(left["group"]).count("latitude") == 1
        for name in ("latitude", "common error of the headings", "indexing"):
            assert words in rows[name] and words in sources[name][1], name
    weighed = calibrated(case, log, drift_sd=np.radians(0.05 / 3600) / 3600)
    assert "gyro.bias drift" in usual.tables["left_out"]["group"]
    assert "gyro.bias drift" not in weighed.tables["left_out"]["group"]
    assert "common error of the headings" in usual.checks[-1].sentence or any(
        "all reference headings share" in c.sentence for c in usual.checks
    )


def test_a_g_sensitivity_beyond_its_size_is_named_and_covered() -> None:
    case = CASES["tilted"]
    errors = made(case, 1).model.coefficients(LAYOUT.names)
    errors = errors.with_values({"gyro.g_sensitivity.yy": 20 * FIBRE["gyro.g_sensitivity"][0]})
    simulation = made(case, 1, ImuModel.from_coefficients(errors))
    result = calibrated(case, simulation.log)
    assert result.verdict.level is Level.DOUBTFUL
    # A rate along up as large as the force: a latitude far off would look the same.
    assert set(result.diagnostics["named"][0]) == {"gyro.g_sensitivity", "latitude"}
    c = result.coefficients
    assert (np.abs(c.values - truth(simulation, c.names)) < 4 * c.sd).all()


def test_accelerometers_that_bend_do_not_look_noisy() -> None:
    """|f_y| goes twice per turn: four stops differ by it, far beyond such little noise."""
    case = replace(CASES["tilted"], noise=replace(NOISE, accel=replace(NOISE.accel, white=3e-5)))
    errors = made(case, 1).model.coefficients(LAYOUT.names)
    errors = errors.with_values({"accel.asymmetry.y": FIBRE["accel.asymmetry"][0]})
    log = made(case, 1, ImuModel.from_coefficients(errors)).log
    site = replace(SITE, gravity_sd=4e-4)
    with_sizes, without = (
        case.record.calibrate(log, site=site, settings=case.stated, noise=case.noise, sizes=sizes)
        for sizes in (FIBRE, None)
    )
    assert with_sizes.verdict.level is Level.PASS, with_sizes.verdict.reasons
    assert without.verdict.level is Level.DOUBTFUL
