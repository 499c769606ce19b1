"""What north seeking does not estimate: columns as the simulator has it, and what cancels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.detect.dwells import find_dwells
from foucault.estimate.north import OnTurntable, Rig, names_of
from foucault.estimate.north_reduction import Nuisance, reduce
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.left_out import changes, sizes_of, terms
from foucault.models.north_seeker import SEEKER, Dwells
from foucault.procedures.north_seeking.counted import again
from sessions import QUIET, SITE, Case, instrument, made
from sessions import SEEKER as NOISE

SIZES = sizes_of("consumer MEMS")
TILTED = {"tilts": ["8 deg", "-8 deg", "0 deg"]}
CASES = {
    "tilted": Case("north_seeking", {}, TILTED, noise=NOISE),
    "on the case": Case("north_seeking", {}, TILTED | {"accelerometers": "case"}, noise=NOISE),
    "level": Case("north_seeking", {"z_coupling": "no"}, {}, noise=NOISE),
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
