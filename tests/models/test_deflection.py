"""Models of deflection: their tensors, what whole turns leave, and the way to the 18."""

from __future__ import annotations

import numpy as np
import pytest

from deflected_turns import tilt_design, tilt_rank, whole_turns
from foucault.coefficients import CoefficientVector
from foucault.models.deflection import (
    GENERAL,
    MODELS,
    DeflectionModel,
    bending,
    deflection_model,
    felt,
    readout,
    sensed,
)
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.ins_errors import Sensors
from foucault.models.rotation import exp
from foucault.plans.sequence import COEFFICIENTS, NAMES, design, poses, spin_axis
from foucault.units import STANDARD_GRAVITY as G
from foucault.units import parse
from refusals import refuses

ARCSEC = np.pi / 648000
RNG = np.random.default_rng(9)
RANKS = {"coupled6": 6, "direct6": 3, "direct6+transverse3": 6, "lateral3+axial6": 0,
         "direct12": 3, "general18": 6, "symmetric6": 5}  # fmt: skip
SIZES = {"coupled6": 6, "direct6": 6, "direct6+transverse3": 9, "lateral3+axial6": 9,
         "direct12": 12, "general18": 18, "symmetric6": 6}  # fmt: skip


def one(name: str, **values: float) -> np.ndarray:
    """D(f) of a model with some parameters, at f = (2, 3, 5)."""
    model = deflection_model(name)
    theta = np.zeros(len(model))
    for label, value in values.items():
        theta[model.layout.index("deflection." + label.replace("_", "."))] = value
    return bending(model.tensor(theta), np.array([2.0, 3.0, 5.0]))


def test_the_printed_equations_of_the_source() -> None:
    """Eqs. (9) and (10): th_xy = Txyy f_y - Txzz f_z and so on, at T = 1, 10, ..., 1e5."""
    x, y, z = 2.0, 3.0, 5.0
    D = one("coupled6", xyy=1, xzz=1e1, yzz=1e2, yxx=1e3, zxx=1e4, zyy=1e5)
    want = [
        [0, y - 1e1 * z, 1e1 * z + y],
        [1e3 * x + 1e2 * z, 0, 1e2 * z - 1e3 * x],
        [1e4 * x - 1e5 * y, 1e5 * y + 1e4 * x, 0],
    ]
    np.testing.assert_allclose(D, want, rtol=1e-15)


def test_the_other_models_as_written() -> None:
    x, y, z = 2.0, 3.0, 5.0
    np.testing.assert_allclose(one("direct6", yxx=7.0)[1], [7 * x, 0, 0])
    np.testing.assert_allclose(one("direct6+transverse3", transverse_z=7.0)[2], [-7 * y, 7 * x, 0])
    np.testing.assert_allclose(one("lateral3+axial6", lateral_y=7.0)[1], [7 * x, 0, 7 * z])
    np.testing.assert_allclose(one("lateral3+axial6", yzy=7.0)[1], [0, 0, 7 * y])
    np.testing.assert_allclose(one("direct12", xzx=7.0)[0], [0, 0, 7 * x])
    np.testing.assert_allclose(one("general18", xyz=7.0)[0], [0, 7 * z, 0])
    np.testing.assert_allclose(one("symmetric6", xzz=7.0)[0], [0, 7 * z, 7 * z])


def test_a_wheel_without_a_preferred_direction_bends_alike_when_it_is_turned() -> None:
    """coupled6 and the transverse part, of either chirality: theta = [[a, -b], [b, a]] f."""
    C = exp(np.array([0.7, 0.0, 0.0]))  # about the axis of gyro x
    f = RNG.normal(size=3)
    given = {
        "coupled6": {"xyy": 2.0, "xzz": 2.0},
        "direct6+transverse3": {"xyy": 3.0, "xzz": 3.0, "transverse.x": 2.0},
    }
    for chirality in (-1, 1):
        for name, theta in given.items():
            model = deflection_model(name, chirality)
            values = np.zeros(len(model))
            for label, value in theta.items():
                values[model.layout.index(f"deflection.{label}")] = value
            T = model.tensor(values)
            np.testing.assert_allclose(bending(T, C @ f)[0], C @ bending(T, f)[0], atol=1e-14)
            # Chirality turns the sense of what goes across, and nothing else.
            across = bending(T, np.array([0.0, 1.0, 0.0]))[0, 2]
            assert across == -chirality * 2.0


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("chirality", [-1, 1])
def test_basis(name: str, chirality: int) -> None:
    model = deflection_model(name, chirality)
    assert len(model) == SIZES[name] == len(set(model.layout.names))
    assert {c.kind for c in model.layout.coefficients} == {"deflection"}
    assert np.linalg.matrix_rank(model.basis.reshape(len(model), -1)) == len(model)
    assert not np.einsum("piik->pik", model.basis).any()  # no scale factors
    assert tilt_rank(model) == RANKS[name]


def test_names_are_looked_up() -> None:
    with refuses("deflection.model", match=r"'coupled'.*Did you mean 'coupled6'\?"):
        deflection_model("coupled")
    with refuses("deflection.chirality", "is 0; it must be -1 or 1"):
        deflection_model("coupled6", 0)
    assert set(GENERAL) == {n for n in LAYOUT.names if n.startswith("gyro.deflection.")}


def test_who_contains_whom() -> None:
    """A rank cannot be less than that of a part: direct6 is in direct12, and so on."""

    def contains(whole: str, part: str) -> bool:
        B = deflection_model(whole).basis.reshape(-1, 27)
        both = np.concatenate([B, deflection_model(part).basis.reshape(-1, 27)])
        return bool(np.linalg.matrix_rank(both) == len(B))

    assert contains("direct12", "direct6")
    assert contains("direct12", "lateral3+axial6")
    assert contains("direct6+transverse3", "direct6")
    assert not contains("direct6+transverse3", "coupled6")  # but for a wheel alike all round
    assert all(contains("general18", name) for name in MODELS)


# -- whole turns ------------------------------------------------------------------------------


def turned(T: np.ndarray, C0: np.ndarray, about: str, turns: int) -> np.ndarray:
    """Integrate phi' = -C D(f) w through whole turns; the sum over a period is exact."""
    n = 64  # the integrand has three harmonics
    theta = 2 * np.pi * np.arange(n) / n
    axis = np.array([0.0, 1.0, 0.0]) if about == "north" else np.array([1.0, 0.0, 0.0])
    C = exp(theta[:, None] * axis) @ C0
    f = np.swapaxes(C, 1, 2) @ np.array([0.0, 0.0, G])
    w = C0.T @ axis * np.ones((n, 1))
    return -np.einsum("nij,nj->i", C, felt(T, f, w)) * 2 * np.pi * turns / n


@pytest.mark.parametrize("about", ["north", "east"])
@pytest.mark.parametrize("seed", range(3))
def test_whole_turns_against_brute_force(about: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    C0 = exp(rng.normal(size=3))
    T = deflection_model("general18").tensor(1e-6 * rng.normal(size=18))
    u = C0[1] if about == "north" else C0[0]
    got = whole_turns(T, u, 20 * np.pi, G, about=about)
    want = turned(T, C0, about, 10)
    np.testing.assert_allclose(got, want, rtol=0, atol=1e-9 * np.abs(want).max())
    assert got[1 if about == "north" else 0] == 0.0
    back = whole_turns(T, u, -20 * np.pi, G, about=about)
    np.testing.assert_allclose(back, -got)


def test_ten_turns_with_one_arcsecond_per_g() -> None:
    T = deflection_model("coupled6").tensor(np.full(6, parse("1 arcsec/g", "deflection")))
    phi = whole_turns(T, np.array([0.0, 1.0, 0.0]), 20 * np.pi, G) / ARCSEC
    assert phi[0] == pytest.approx(62.83, abs=0.005)
    assert phi[1] == 0.0
    plus = deflection_model("symmetric6").tensor(np.full(6, parse("1 arcsec/g", "deflection")))
    assert np.abs(whole_turns(plus, np.eye(3), 20 * np.pi, G)[:, 0]).max() < 1e-20


def test_the_tilt_of_a_turn_is_integrated_by_the_error_model_too() -> None:
    """What the gyros say too much, turned into the attitude by their own readings."""
    T = deflection_model("coupled6").tensor(np.full(6, parse("1 arcsec/g", "deflection")))
    n = 20_000
    theta = 2 * np.pi * (np.arange(n) + 0.5) / n
    axis = np.array([0.0, 1.0, 0.0])
    f = np.swapaxes(exp(theta[:, None] * axis), 1, 2) @ np.array([0.0, 0.0, G])
    gyro = ImuModel(deflection=T).measure(f, np.tile(axis, (n, 1)))[1]
    C = np.eye(3)
    for step in exp(gyro * 2 * np.pi / n):
        C = C @ step
    # C_est = (I - phi x) C, and C is the identity again.
    phi = -np.array([C[2, 1] - C[1, 2], C[0, 2] - C[2, 0], C[1, 0] - C[0, 1]]) / 2
    want = whole_turns(T, axis, 2 * np.pi, G)
    np.testing.assert_allclose(phi[[0, 2]], want[[0, 2]], rtol=0, atol=1e-3 * want[0])


@pytest.mark.parametrize("name", NAMES)
def test_design_is_that_of_the_poses(name: str) -> None:
    model = deflection_model("coupled6")
    assert model.layout.names == tuple(f"deflection.{c}" for c in COEFFICIENTS)
    u = spin_axis(poses(name))
    np.testing.assert_allclose(tilt_design(model, u), design(u), atol=1e-15)


@pytest.mark.parametrize("name", MODELS)
def test_no_poses_see_more_than_the_rank(name: str) -> None:
    model = deflection_model(name)
    u = RNG.normal(size=(40, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    rows = tilt_design(model, u)
    assert np.linalg.matrix_rank(rows, tol=1e-9) == RANKS[name]
    theta = RNG.normal(size=len(model))
    np.testing.assert_allclose(
        rows @ theta, 2 * whole_turns(model.tensor(theta), u, 1.0, 1.0)[:, 0], atol=1e-14
    )


# -- parameters as states, and back -----------------------------------------------------------


def with_others(model: DeflectionModel) -> CoefficientVector:
    sensors = Sensors.of(("gyro.bias", "accel.bias")).with_deflection(model)
    n = len(sensors)
    root = RNG.normal(size=(n, n))
    return CoefficientVector(
        sensors.layout, RNG.normal(size=n), root @ root.T, RNG.random(n) > 0.3,
        np.where(RNG.random(n) > 0.5, RNG.uniform(1, 2, n), np.inf),
    )  # fmt: skip


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("chirality", [-1, 1])
def test_general_coefficients_are_the_same_tensor(name: str, chirality: int) -> None:
    model = deflection_model(name, chirality)
    vector = with_others(model)
    general = model.general(vector)
    assert all(n in LAYOUT for n in general.names)
    theta = [vector.value(n) for n in model.layout.names]
    made = ImuModel.from_coefficients(general)
    np.testing.assert_allclose(made.deflection, model.tensor(np.array(theta)), atol=1e-15)
    for n in ("gyro.bias.y", "accel.bias.z"):
        assert general.value(n) == vector.value(n)
    assert general.names[:3] == vector.names[:3]
    assert general.names[-3:] == vector.names[-3:]


def test_covariance_and_priors_follow() -> None:
    model = deflection_model("coupled6")
    vector = with_others(model)
    general = model.general(vector)
    draws = RNG.multivariate_normal(np.zeros(len(vector)), vector.cov, 5)
    # The map is linear: differences of mapped vectors are the mapped differences.
    zero = CoefficientVector.zeros(vector.layout)
    J = np.stack([
        model.general(CoefficientVector(vector.layout, e)).values for e in np.eye(len(vector))
    ], axis=1)  # fmt: skip
    assert not model.general(zero).values.any()
    assert model.general(zero).cov is None
    np.testing.assert_allclose(J @ draws.T, [[*r] for r in (draws @ J.T).T])
    np.testing.assert_allclose(general.cov, J @ vector.cov @ J.T, atol=1e-12)
    for pair in (("xyy", "xzy"), ("xzz", "xyz")):
        a, b = (general.layout.index(f"gyro.deflection.{p}") for p in pair)
        source = vector.layout.index(f"deflection.{pair[0]}")
        assert general.sd[a] == general.sd[b] == pytest.approx(vector.sd[source])
        assert general.free[a] == general.free[b] == vector.free[source]
        assert general.prior_sd[a] == general.prior_sd[b] == vector.prior_sd[source]


@pytest.mark.parametrize("name", MODELS)
def test_states_say_what_the_tensor_says(name: str) -> None:
    model = deflection_model(name)
    others = ("gyro.bias", "gyro.scale", "gyro.misalignment", "gyro.g_sensitivity", "accel")
    sensors = Sensors.of(others).with_deflection(model)
    assert sensors.gyros == len([n for n in sensors.layout.names if "accel" not in n])
    f, w = RNG.normal(size=3), RNG.normal(size=3)
    said = sensors.readings(w, f)
    at = [sensors.layout.index(n) for n in model.layout.names]
    want = [felt(B, f, w) for B in model.basis]
    np.testing.assert_allclose(said[:3, at], np.transpose(want), atol=1e-15)
    assert not said[3:, at].any()
    plain = Sensors.of(others)
    left = [i for i in range(len(sensors)) if i not in at]
    np.testing.assert_array_equal(said[:, left], plain.readings(w, f))


def test_a_model_beside_what_it_is_made_of_is_refused() -> None:
    model = deflection_model("coupled6")
    for sensors in (Sensors.of(("gyro",)), Sensors.of(("gyro.bias",)).with_deflection(model)):
        with refuses("deflection.twice", match=r"The states hold .*deflection.xy") as caught:
            sensors.with_deflection(model)
        assert 'A group such as "gyro" holds them all' in caught.value.cure


# -- scale factors that are no constants -----------------------------------------------------------


def test_cubic_term_grows_with_the_third_power_and_keeps_the_sense() -> None:
    r = np.array([[1.0, 2.0, -2.0]])
    np.testing.assert_allclose(
        readout(r, np.zeros(3), np.full(3, 1e-3)) - r, [[1e-3, 8e-3, -8e-3]], atol=1e-17
    )


def test_inverse_is_exact_also_for_large_terms() -> None:
    rates = np.random.default_rng(4).uniform(-6.0, 6.0, (60, 3))
    a, c = np.array([0.2, -0.3, 0.01]), np.array([2e-3, -1e-3, 0.0])
    np.testing.assert_allclose(sensed(readout(rates, a, c), a, c), rates, rtol=0, atol=2e-14)
    assert sensed(np.zeros((1, 3)), a, c) == pytest.approx(0.0)


def test_inverse_up_to_near_where_the_readout_turns_back() -> None:
    c = np.full(3, -1e-2)
    turn = np.sqrt(1 / 0.03)
    r = np.linspace(-0.99, 0.99, 31)[:, None] * turn * np.ones(3)
    # Near the turn the slope is 0.02: rounding grows by 50.
    np.testing.assert_allclose(sensed(readout(r, 0 * c, c), 0 * c, c), r, atol=1e-13)


def test_straight_says_whether_there_are_such_terms() -> None:
    assert ImuModel().straight
    assert not ImuModel(gyro_asymmetry=np.array([0.0, 1e-6, 0.0])).straight
    assert not ImuModel(gyro_cubic=np.array([0.0, 1e-6, 0.0])).straight
