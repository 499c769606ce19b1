"""The search for positions on a table: found plans against the known ones, and its limits."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.models.earth import Site
from foucault.models.noise import grade
from foucault.models.turntable import up_k
from foucault.plans.directions import named_angles
from foucault.plans.efficiency import efficiency
from foucault.plans.optimise import compare, descend
from foucault.plans.table import NEARLY, Periodic, Wanted
from foucault.procedures import multi_position, norm_observation, turntable
from foucault.procedures.norm_observation import Session, Settings
from foucault.procedures.on_table.plan import TOGETHER
from foucault.procedures.on_table.session import plan_of
from foucault.procedures.record import Beforehand
from refusals import refuses

SITE = Site(9.81, np.radians(45.0), gravity_sd=0.0)
NOISE = grade("tactical").noise


MADE = {}  # nothing changes a space: one for all tests that ask for the same
TABLES = {}


@pytest.fixture(autouse=True)
def one_table(monkeypatch):
    """Table a kind of session once, whatever is then searched for."""
    of = Periodic.of

    def kept(function, degrees):
        asked = f"{getattr(function, '__self__', function)} {degrees}"
        if asked not in TABLES:
            TABLES[asked] = of(function, degrees)
        return TABLES[asked]

    monkeypatch.setattr(Periodic, "of", kept)


def space_of(plan="icosahedron 12", module=norm_observation, wanted=None, **settings):
    asked = f"{plan} {module.__name__} {wanted} {settings}"
    if asked not in MADE:
        MADE[asked] = module.PROCEDURE.space(Beforehand(
            module.Settings(plan=plan, **settings), wanted=Wanted(**(wanted or {})),
            session=module.Session(rest_time=60.0, turns=4), site=SITE, noise=NOISE, prior={},
        ))  # fmt: skip
    return MADE[asked]


def found(space, evaluations=500, seed=0):
    return descend(space, np.random.default_rng(seed), evaluations).plan


def judged(plan, model="accel"):
    return efficiency(up_k(np.array(plan)), model)


# -- what one position tells -----------------------------------------------------------------------


MODULES = {"free": norm_observation, "exact": multi_position, "with errors": turntable}
MORE = {"accel_quadratic": True, "g_sensitivity": True, "both_senses": True, "four_positions": True}


@pytest.mark.thorough
@pytest.mark.parametrize("trust", MODULES)
@pytest.mark.parametrize("more", [{}, MORE], ids=["", "everything"])
def test_a_session_is_the_sum_of_its_positions(trust, more):
    """The fast cost is that of the exact bound, whatever is believed of the table."""
    space = space_of("icosahedron 12", MODULES[trust], **more)
    rng = np.random.default_rng(1)
    for plan in (space.reference, space.draw(rng), space.draw(rng)):
        exact = np.log(space.sd(plan, "no errors")) - np.log(space.sd(space.reference, "no errors"))
        assert space.cost(plan) == pytest.approx(exact.mean(), abs=1e-7)


@pytest.mark.thorough
@pytest.mark.parametrize("trust", MODULES)
@pytest.mark.parametrize("criterion", ["sd", "det"])
def test_slopes_are_those_of_the_cost(trust, criterion):
    space = space_of("icosahedron 12", MODULES[trust], {"criterion": criterion})
    plan = space.draw(np.random.default_rng(2))
    _, M = space.judged(plan)
    slope = -space.parts.slope(plan[3], M)
    for axis in range(3):
        moved = []
        for step in (1e-5, -1e-5):
            angles = np.array(plan)
            angles[3, axis] += step
            moved.append(space.cost(tuple(map(tuple, angles.tolist()))))
        assert slope[axis] == pytest.approx((moved[0] - moved[1]) / 2e-5, abs=1e-6)


def test_a_tabled_function_is_exact_up_to_its_harmonics():
    def function(at):
        o, m, i = np.transpose(at)
        rows = [[np.cos(2 * o) * np.sin(m), np.cos(m) ** 2], [np.cos(m) ** 2, np.sin(3 * i)]]
        return np.moveaxis(np.array(rows), (0, 1), (-2, -1))

    table = Periodic.of(function, (2, 2, 3))
    for at in np.random.default_rng(1).uniform(-9, 9, (10, 3)):
        np.testing.assert_allclose(table(tuple(at)), function(at), atol=1e-13)
    np.testing.assert_allclose(table.mean, [[0, 0.5], [0.5, 0]], atol=1e-13)
    assert np.abs(Periodic.of(function, (2, 2, 2))((0, 0, 0.4)) - function((0, 0, 0.4))).max() > 0.1


@pytest.mark.parametrize("trust", MODULES)
@pytest.mark.parametrize("more", [{}, MORE], ids=["", "everything"])
def test_positions_together_tell_what_each_tells(trust, more):
    bench = space_of("icosahedron 12", MODULES[trust], **more).stated.args[0]
    positions = np.random.default_rng(3).uniform(-3, 3, (TOGETHER + 3, 3))
    for part, position in zip(bench.parts(positions), positions, strict=True):
        alone = bench.part(tuple(position))
        np.testing.assert_allclose(part, alone, atol=1e-9 * np.abs(alone).max())


# -- found plans -----------------------------------------------------------------------------------


@pytest.mark.thorough
@pytest.mark.parametrize(
    "name",
    [
        "12 edges",
        "icosahedron 12",
        "14 faces and corners",
        "dodecahedron 20",
        "24 on great circles",
    ],
)
def test_found_plans_are_at_least_as_good_as_the_known_of_as_many_positions(name):
    """D-efficiency 1.000 for any number from 12 on, as the icosahedron and the dodecahedron."""
    space = space_of(name, wanted={"criterion": "det"})
    plan = found(space)
    assert len(plan) == len(named_angles(name))
    assert space.cost(plan) <= 1e-6
    assert judged(plan).d_efficiency > max(judged(space.reference).d_efficiency, 1.0) - 1e-4


def test_geometric_means_are_a_little_better_than_of_the_icosahedron():
    space = space_of()
    comparison = compare(space, found(space))
    assert (comparison.geometric_mean < 0.9995).all()
    assert (comparison.worst < 1.1).all()
    assert len(space.cases) == 4


@pytest.mark.thorough
def test_weights_decide():
    """Positions for scale factors alone are other ones, and show less of the rest."""
    only = {"accel": 0.0, "gyro": 0.0, "accel.scale": 1.0}
    space = space_of("dodecahedron 20", wanted={"weights": only})
    comparison = compare(space, found(space))
    assert comparison.geometric_mean[0] < 0.95
    assert np.nanmax(comparison.ratio[0]) > 1.05


@pytest.mark.thorough
def test_integrity_names_every_bad_rest():
    assert not judged(named_angles("icosahedron 12")).named
    space = space_of(wanted={"integrity": True})
    plan = found(space, 1000)
    assert judged(plan).named
    assert space.cost(space.reference) == np.inf
    assert "residuals that name a bad rest" in space.limits
    assert compare(space, plan).geometric_mean[0] < 1.05


def test_another_number_of_positions():
    """As the root of their number, but for what spins share: the level and the lever arm."""
    space = space_of(wanted={"positions": 20})
    assert np.exp(space.cost(found(space))) == pytest.approx(np.sqrt(12 / 20), rel=0.035)


def test_the_plan_to_beat_is_where_to_begin_only_where_it_has_as_many():
    assert space_of().begin == space_of().reference
    assert space_of(wanted={"positions": 20}).begin is None


def test_the_ellipsoid_knows_no_weights():
    for weights in ({"accel.bias": 2.0}, {"accel.bias": 0.5, "gyro": 0.0}):
        with refuses("optimise.det", "unequal weights"):
            space_of(wanted={"criterion": "det", "weights": weights})
    space_of(wanted={"criterion": "det", "weights": {"gyro": 0.0}})


# -- limits of the table ---------------------------------------------------------------------------


@pytest.mark.thorough
def test_a_tilting_table():
    space = space_of("dodecahedron 20", middle_range=(-0.6, 1.66))
    assert "as near as the table allows" in space.reference_name
    plan = found(space)
    middle = np.array(plan)[:, 1]
    assert middle.min() >= -0.6 - NEARLY and middle.max() <= 1.66 + NEARLY
    assert space.cost(plan) < -0.015
    assert all(limit.kept for limit in space.needs(plan))


@pytest.mark.thorough
def test_a_dividing_head():
    space = space_of("dodecahedron 20", angle_step=np.radians(45))
    plan = found(space, 600)
    steps = np.degrees(np.array(space.ordered(plan))) / 45
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert space.cost(plan) < -0.02
    assert "steps of 45 deg" in space.limits
    assert all(limit.kept for limit in space.needs(plan))


def test_a_table_that_cannot_show_everything_says_what():
    level = {"middle_range": (0.0, 0.0)}
    with refuses("optimise.unseen") as caught:
        space_of("dodecahedron 20", **level)
    assert "accel.scale.y, accel.misalignment.yx" in caught.value.message
    assert "middle angle 0 to 0 deg" in caught.value.message
    only = {"accel": 0.0, "gyro": 0.0, "accel.bias.x": 1.0, "accel.bias.z": 1.0}
    space = space_of("dodecahedron 20", wanted={"weights": only}, **level)
    assert "accel.scale.y" in space.unseen and "accel.bias.x" not in space.unseen
    assert space.cost(found(space)) < 0


def test_too_few_positions():
    with refuses("table.too_few") as caught:
        space_of(wanted={"positions": 5})
    assert "No 5 positions determine all coefficients" in caught.value.message


def test_a_cable_wants_spins_there_and_back():
    with refuses("table.cable", "the cable allows 3.00", "both_senses = true"):
        space_of(cable_limit=6 * np.pi)
    space = space_of(cable_limit=10 * np.pi, both_senses=True)
    plan = found(space, 60)
    cable = space.needs(plan)[0]
    assert cable.kept and cable.needed > 8 * np.pi


# -- a plan that a campaign can do -----------------------------------------------------------------


def test_a_found_plan_runs():
    space = space_of()
    plan = found(space, 60)
    changed = space.changes(plan)["procedure"]
    assert changed["plan"] is None
    settings = Settings(positions=changed["positions"])
    said = plan_of(settings, Session()).angles[:12]
    np.testing.assert_allclose(said, np.array(space.ordered(plan)), atol=1e-8)
    sorted_up = [np.sort(up_k(np.array(p)).round(6), axis=0) for p in (plan, space.ordered(plan))]
    np.testing.assert_array_equal(*sorted_up)
    outer = np.degrees(said[:, 0])
    np.testing.assert_allclose(np.diff(outer)[:5], 30.0)


def test_the_order_saves_time():
    space = space_of()
    plan = found(space, 60)
    shuffled = tuple(plan[k] for k in np.random.default_rng(1).permutation(12))
    assert space.duration(plan) < space.time(np.array(shuffled))
    assert space.duration(plan) <= space.duration(space.reference)
    headings, *rows = space.steps(plan)
    assert len(rows) == 12 and len(headings) == len(rows[0]) == 4
    listed = space.changes(plan)["procedure"]["positions"]
    cells = [c for row in rows for c in row[1:]]
    for text in (*cells, *(c.removesuffix(" deg") for row in listed for c in row)):
        assert not ("." in text and text.endswith("0")) and text not in ("-0", "")
    ordered = np.degrees(np.array(space.ordered(plan)))
    np.testing.assert_allclose(np.array(cells, float).reshape(12, 3), ordered, atol=5.1e-5)
