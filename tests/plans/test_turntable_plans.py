"""Sets of positions on a table, what they are worth, and plans made of them."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.estimate import norm_observation
from foucault.models.imu import ImuModel
from foucault.models.turntable import up_k
from foucault.plans.directions import (
    DIRECTIONS,
    FOUR_POSITIONS,
    angles_of,
    canonical,
    directions,
    named_angles,
    positions,
    table_plan,
)
from foucault.plans.efficiency import (
    MODELS,
    NOTICED,
    efficiency,
    model_named,
    refuse_singular,
)
from refusals import refuses

SPIN = {"spin_rate": np.radians(10.0), "rest_time": 60.0, "turns": 5}

# D-efficiency against the uniform sphere, as the method's comparison of plans gives them.
D_EFFICIENCY = {
    "12 edges": 0.970,
    "icosahedron 12": 1.000,
    "14 faces and corners": 0.999,
    "18 faces and edges": 0.989,
    "dodecahedron 20": 1.000,
    "24 on great circles": 0.944,
    "26 faces, edges and corners": 0.997,
}


def code_of(call) -> str:
    with pytest.raises(FoucaultError) as caught:
        call()
    return caught.value.code


def numeric_rows(u: np.ndarray, model: str) -> np.ndarray:
    """The equations of a plan, by differences of the error model itself, g = 1."""
    out = []
    for name in MODELS[model]:
        vector = ImuModel().coefficients()
        seen = [
            ImuModel.from_coefficients(vector.with_values({name: s * 1e-6})).measure(u, u)[0]
            for s in (1, -1)
        ]
        if model != "accel table":
            seen = [np.linalg.norm(n, axis=1) for n in seen]
        out.append(np.ravel(seen[0] - seen[1]) / 2e-6)
    return np.stack(out, axis=1)


# -- directions ----------------------------------------------------------------------------


@pytest.mark.parametrize("name", DIRECTIONS)
def test_a_set_has_its_number_of_directions_and_no_weight_to_one_side(name):
    u = directions(name)
    assert len(u) == int("".join(c for c in name if c.isdigit()))
    np.testing.assert_allclose(np.linalg.norm(u, axis=1), 1.0, rtol=0, atol=1e-15)
    np.testing.assert_allclose(u.sum(axis=0), 0.0, rtol=0, atol=1e-14)
    outer = np.sort(named_angles(name)[:, 0])
    np.testing.assert_allclose(np.diff(outer), 2 * np.pi / len(u), rtol=0, atol=1e-14)


def test_regular_bodies_have_their_angles_between_directions():
    ico, dodeca = directions("icosahedron 12"), directions("dodecahedron 20")
    root = 1 / np.sqrt(5)
    nearest = np.array([-1, -root, root, 1])
    assert np.abs((ico @ ico.T)[..., None] - nearest).min(axis=2).max() < 1e-14
    assert np.allclose(
        np.sort(ico @ ico[0]), [-1] + [-root] * 5 + [root] * 5 + [1], rtol=0, atol=1e-14
    )
    near = np.array([-1, -np.sqrt(5) / 3, -1 / 3, 1 / 3, np.sqrt(5) / 3, 1])
    assert np.abs((dodeca @ dodeca.T)[..., None] - near).min(axis=2).max() < 1e-14


def test_the_icosahedron_has_the_published_angles():
    degrees = np.degrees(named_angles("icosahedron 12"))
    np.testing.assert_allclose(degrees[:, 0], [*range(30, 360, 30), 0], rtol=0, atol=1e-12)
    a = 31.717474
    inner, middle = [-a, 180 + a, 180 - a, a], [58.282526, 121.717474, -58.282526, 238.282526]
    np.testing.assert_allclose(
        degrees[:, 2], [*inner, 0, 0, 0, 0, 90, 90, 90, 90], rtol=0, atol=1e-6
    )
    want = [0, 0, 0, 0, *middle, 180 - a, 180 + a, a, -a]
    np.testing.assert_allclose(degrees[:, 1], want, rtol=0, atol=1e-6)


def test_angles_realise_directions():
    rng = np.random.default_rng(1)
    u = rng.normal(size=(50, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    u[:2] = [0, 1, 0], [0, -1, 0]
    angles = angles_of(3.0 * u)
    np.testing.assert_allclose(up_k(angles), u, rtol=0, atol=1e-15)
    assert (np.abs(angles[:, 1]) <= np.pi / 2).all() and (angles[:2, 2] == 0).all()


@pytest.mark.parametrize(
    ("said", "meant"),
    [
        ("ico12", "icosahedron 12"), ("Icosahedron", "icosahedron 12"), ("12 Edges", "12 edges"),
        ("6+8", "14 faces and corners"), ("14", "14 faces and corners"), ("faces", "6 faces"),
        ("dodeca", "dodecahedron 20"), ("three great circles", "24 on great circles"),
        ("8 vertices", "8 corners"), ("26", "26 faces, edges and corners"),
        ("fib 30", "fibonacci 30"), ("Fibonacci-N 17", None), ("edges 14", None), ("12", None),
        ("fibonacci", None), ("fibonacci 0", None), ("", None),
    ],
)  # fmt: skip
def test_names_are_forgiving(said, meant):
    if meant is None:
        assert code_of(lambda: canonical(said)) == "plan.unknown"
    else:
        assert canonical(said) == meant


@pytest.mark.parametrize(
    ("said", "hint"),
    [
        ("icosahedrom 12", "Did you mean 'icosahedron 12'?"),
        ("12", "Did you mean '12 edges' or 'icosahedron 12'?"),
        ("17", "Did you mean 'fibonacci 17'?"),
        ("fib", "Say how many, for example 'fibonacci 24'."),
    ],
)
def test_an_unknown_name_gets_a_hint(said, hint):
    with pytest.raises(FoucaultError, match="There is no plan") as caught:
        canonical(said)
    assert hint in caught.value.message and "dodecahedron 20" in caught.value.cure


def test_positions_of_ones_own():
    name, angles = positions([["30 deg", "0 deg", "-90 deg"], ["0.5 rad", "60 arcmin", "0 deg"]])
    assert name == "own positions"
    np.testing.assert_allclose(
        angles, [[np.pi / 6, 0, -np.pi / 2], [0.5, np.pi / 180, 0]], rtol=0, atol=1e-15
    )
    np.testing.assert_array_equal(positions(angles)[1], angles)


@pytest.mark.parametrize(
    "given", [[], [["1 deg", "2 deg"]], np.ones((2, 2)), np.full((1, 3), np.nan)]
)
def test_positions_that_are_none(given):
    assert code_of(lambda: positions(given)) == "plan.positions"


def test_angles_without_unit_are_refused():
    with pytest.raises(FoucaultError, match=r"positions\[2\]: '2' has no unit"):
        positions([["1 deg", "2 deg", "3 deg"], ["1 deg", "2", "3 deg"]])


@pytest.mark.parametrize("given", [np.zeros((2, 3)), np.ones((2, 2)), np.full((1, 3), np.inf)])
def test_directions_that_are_none(given):
    assert code_of(lambda: angles_of(given)) == "plan.positions"


# -- efficiency ----------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "want"), D_EFFICIENCY.items())
def test_d_efficiency_of_the_plans(name, want):
    assert efficiency(directions(name)).d_efficiency == pytest.approx(want, abs=5e-4)


def test_determinant_of_the_icosahedron():
    found = efficiency(directions("icosahedron 12"))
    assert found.log10_det == pytest.approx(-7.187, abs=5e-4)
    # Moments of the sphere: <u^2> = 1/3, <u^4> = 1/5, <ux^2 uy^2> = 1/15.
    det = (1 / 3) ** 3 * (1 / 3) * (2 / 15) ** 2 * (1 / 15) ** 3
    assert found.log10_det == pytest.approx(np.log10(det), abs=1e-12)
    assert found.d_efficiency == pytest.approx(1.0, abs=1e-12)
    assert found.a_efficiency == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("model", MODELS)
def test_many_directions_are_the_uniform_sphere(model):
    found = efficiency(directions("fibonacci 5000"), model)
    assert found.d_efficiency == pytest.approx(1.0, abs=1e-4)
    assert found.a_efficiency == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("model", MODELS)
def test_sds_are_those_of_the_error_model(model):
    u = directions("fibonacci 15")
    found = efficiency(u, model)
    J = numeric_rows(u, model)
    want = np.sqrt(np.diag(np.linalg.inv(J.T @ J)))
    np.testing.assert_allclose(found.sd, want, rtol=1e-6)
    det = np.linalg.slogdet(J.T @ J / len(u))[1] / np.log(10)
    assert found.log10_det == pytest.approx(det, abs=1e-6)
    assert found.equations == len(J) and found.redundant == len(J) - J.shape[1]


def test_quadratic_terms_cost_a_threefold_bias_on_the_icosahedron():
    u = directions("icosahedron 12")
    plain, quadratic = efficiency(u), efficiency(u, "accel quadratic")
    assert quadratic.sd[0] / plain.sd[0] == pytest.approx(3.16, abs=0.01)
    assert quadratic.redundant == 0 and not quadratic.noticed and not quadratic.named
    assert quadratic.hidden_shift == np.inf
    assert quadratic.verdict == "exactly determined: a bad position cannot be noticed"


@pytest.mark.parametrize(
    ("name", "model", "code", "reason"),
    [
        ("6 faces", "accel", "plan.too_few",
         "no position shows accel.misalignment.yx, accel.misalignment.zx and "
         "accel.misalignment.zy"),
        ("8 corners", "accel", "plan.too_few",
         "accel.scale.x, accel.scale.y and accel.scale.z cannot be told apart"),
        ("12 edges", "accel quadratic", "plan.singular",
         "accel.bias.x and accel.quadratic.x cannot be told apart; accel.bias.y and "
         "accel.quadratic.y cannot be told apart"),
    ],
)  # fmt: skip
def test_singular_plans_are_refused_with_the_reason(name, model, code, reason):
    found = efficiency(directions(name), model)
    assert found.singular and found.d_efficiency == 0.0 and found.log10_det == -np.inf
    assert found.a_efficiency == 0.0 and not found.named
    assert found.verdict == f"refused: {found.reason}" and reason in found.reason
    with refuses(code) as caught:
        refuse_singular(name, directions(name), model)
    assert reason in caught.value.message and repr(name) in caught.value.message


def test_a_singular_plan_of_many_positions():
    circle = np.arange(24) * np.pi / 12
    u = np.stack([np.cos(circle), np.sin(circle), np.zeros(24)], axis=1)
    with refuses("plan.singular", "The 24 positions of 'circle'") as caught:
        refuse_singular("circle", u)
    assert "no position shows accel.bias.z, accel.scale.z" in caught.value.message


def test_six_faces_will_do_where_angles_are_known():
    found = refuse_singular("6 faces", directions("6 faces"), "accel table")
    assert found.redundant == 6 and found.reason == ""


@pytest.mark.parametrize("said", ["accel-table", "Accel_Table", "accel  table"])
def test_models_are_named_freely(said):
    assert model_named(said) == "accel table"


def test_an_unknown_model():
    with refuses("plan.model", "Did you mean 'accel quadratic'"):
        efficiency(directions("ico12"), "accel quadratics")


# -- bad positions -------------------------------------------------------------------------


def test_a_bad_position_of_the_icosahedron_through_the_real_solution():
    """1 mg on one position: up to 560 ppm of a coefficient, and a residual of 250 ug."""
    u = directions("icosahedron 12")
    found = efficiency(u)
    shift, residual = 0.0, []
    for k in range(12):
        readings = u.copy()
        readings[k] *= 1.001
        L, b = norm_observation.solve(readings, 1.0)
        shift = max(shift, np.abs(L - np.eye(3)).max(), np.abs(b).max())
        residual.append(np.linalg.norm((readings - b) @ np.linalg.inv(L).T, axis=1)[k] - 1)
    assert shift == pytest.approx(560e-6, rel=5e-3)
    assert np.abs(found.influence).max() * 1e-3 == pytest.approx(shift, rel=5e-3)
    np.testing.assert_allclose(residual, 250e-6, rtol=5e-3)
    np.testing.assert_allclose(found.share, 0.25, rtol=1e-12)


def test_antipodes_of_the_icosahedron_cannot_be_told_apart():
    u = directions("icosahedron 12")
    found = efficiency(u)
    assert found.redundant == 3 and found.noticed and not found.named
    assert found.likeness == pytest.approx(1.0, abs=1e-12)
    J = numeric_rows(u, "accel")
    other = int(np.argmin(u @ u[0]))
    patterns = [
        np.eye(12)[k] - J @ np.linalg.lstsq(J, np.eye(12)[k], rcond=None)[0] for k in (0, other)
    ]
    np.testing.assert_allclose(patterns[0], -patterns[1], rtol=0, atol=1e-6)


@pytest.mark.parametrize("name", ["dodecahedron 20", "26 faces, edges and corners"])
def test_larger_plans_name_a_bad_position(name):
    u = directions(name)
    found = efficiency(u)
    assert found.named and found.verdict == "a bad position is noticed and named"
    J = numeric_rows(u, "accel")
    R = np.eye(len(u)) - J @ np.linalg.pinv(J)
    alike = np.abs(R / np.sqrt(np.outer(np.diag(R), np.diag(R))))
    assert found.likeness == pytest.approx(np.sort(np.unique(alike.round(9)))[-2], abs=1e-6)
    assert found.likeness < 0.5


def test_what_an_unnoticed_error_does():
    u = directions("dodecahedron 20")
    found = efficiency(u)
    J = numeric_rows(u, "accel")
    sd = np.sqrt(np.diag(np.linalg.inv(J.T @ J)))
    size = NOTICED / np.sqrt(found.share)  # the test value of position k has sd sqrt(share)
    np.testing.assert_allclose(found.detectable, size)
    moved = [np.linalg.lstsq(J, size[k] * np.eye(20)[k], rcond=None)[0] / sd for k in range(len(u))]
    assert found.hidden_shift == pytest.approx(np.abs(moved).max(), rel=1e-6)


# -- plans ---------------------------------------------------------------------------------


def test_a_plan_rests_everywhere_then_spins_everywhere():
    plan = table_plan("ico12", **SPIN)
    assert plan.name == "icosahedron 12" and len(plan) == 24
    np.testing.assert_array_equal(plan.angles[:12], named_angles("icosahedron 12"))
    np.testing.assert_array_equal(plan.angles[12:], plan.angles[:12])
    np.testing.assert_array_equal(plan.rate[:12], 0.0)
    np.testing.assert_allclose(np.degrees(plan.rate[12:]), 10.0)
    np.testing.assert_allclose(plan.time, [60.0] * 12 + [5 * 36.0] * 12)
    np.testing.assert_allclose(np.degrees(plan.angles[0]), [30.0, 0.0, -31.717474], atol=1e-6)


def test_spins_in_both_senses_and_none():
    both = table_plan("14", both_senses=True, **SPIN | {"spin_rate": -0.1, "turns": 2})
    np.testing.assert_allclose(both.rate[14:], np.tile([-0.1, 0.1], 14))
    np.testing.assert_array_equal(both.angles[14::2], both.angles[15::2])
    np.testing.assert_allclose(both.time[14:], 2 * 2 * np.pi / 0.1)
    none = table_plan("14", spins=False, **SPIN | {"spin_rate": 0.0})
    assert len(none) == 14 and not none.rate.any()


def test_the_four_positions_are_added_where_missing():
    plan = table_plan("ico12", four_positions=True, **SPIN)
    assert len(plan) == 12 + 4 + 12 + 2
    np.testing.assert_array_equal(plan.angles[12:16], FOUR_POSITIONS)
    # published order (middle, outer): (0, 0), (90, 0), (0, 180), (90, 180)
    np.testing.assert_allclose(
        np.degrees(FOUR_POSITIONS[:, [1, 0]]), [[0, 0], [90, 0], [0, 180], [90, 180]]
    )
    np.testing.assert_allclose(np.degrees(plan.angles[-2:]), [[0, 0, 0], [0, 90, 0]])
    own = np.radians([[360.0, 0, 0], [45, 90, 0], [10, 20, 30]])
    plan = table_plan(own, four_positions=True, **SPIN)
    assert len(plan) == (3 + 3) + 3  # one rest is there, and both spins: the outer angle is free
    plan = table_plan(own, four_positions=True, spins=False, **SPIN)
    assert len(plan) == 6


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"spin_rate": 0.0}, "plan.spin"), ({"turns": 0}, "plan.spin"),
        ({"rest_time": 0.0}, "plan.rest_time"), ({"rest_time": np.nan}, "plan.rest_time"),
    ],
)  # fmt: skip
def test_plans_that_do_nothing(change, code):
    assert code_of(lambda: table_plan("ico12", **SPIN | change)) == code
