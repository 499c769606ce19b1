"""States of the strapdown kernel in East-North-Up: the kernel against NumPy, and at the poles."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.kernels import local_level as module
from foucault.models.earth import east_north_up
from foucault.models.rotation import exp
from foucault.navigate.strapdown import MANY, State, quaternion_of, states_of
from plain_kernels import kernel

FORMS = pytest.mark.parametrize("form", ["compiled", "python"])


def states(latitudes, m: int = 60) -> np.ndarray:
    rng = np.random.default_rng(8)
    out = np.empty((m, 12))
    for k, row in enumerate(out):
        C_el = east_north_up(latitudes[k % len(latitudes)], rng.uniform(-3, 3))
        C_el = C_el @ exp(np.array([0.0, 0.0, rng.uniform(-3, 3)]))
        row[:4], row[7:11] = quaternion_of(exp(2 * rng.standard_normal(3))), quaternion_of(C_el)
        row[4:7], row[11] = 100 * rng.standard_normal(3), 1e3 * rng.standard_normal()
    return out


def turned(form, x, frames: bool = True) -> dict[str, np.ndarray]:
    m = len(x)
    shapes = {"position": (2,), "velocity_n": (3,), "C_nb": (3, 3), "C_nl": (3, 3), "angles": (3,)}
    rows = {"C_nb": m * frames, "C_nl": m * frames}
    out = {name: np.empty((rows.get(name, m), *shape)) for name, shape in shapes.items()}
    kernel(form, module, "local_level")(x, *out.values())
    out["latitude"], out["longitude"] = out.pop("position").T
    return out


@FORMS
def test_the_kernel_is_numpy(form) -> None:
    x = states([-1.5, -0.4, 0.0, 0.8, 1.57])
    found, wanted = turned(form, x), states_of(x)
    for name, values in found.items():
        np.testing.assert_allclose(values, wanted[name], rtol=3e-13, atol=3e-13, err_msg=name)


@FORMS
def test_at_a_pole_and_upright_the_rotation_is_still_one(form) -> None:
    x = states([np.pi / 2, -np.pi / 2])
    x[:, 7:11] = [1.0, 0.0, 0.0, 0.0]  # exactly: up is the Earth's axis
    x[0, :4] = quaternion_of(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]))  # nose straight up
    found, wanted = turned(form, x), states_of(x)
    for name, values in found.items():
        np.testing.assert_allclose(values, wanted[name], rtol=3e-13, atol=3e-13, err_msg=name)
    eye = found["C_nb"] @ np.swapaxes(found["C_nb"], 1, 2)
    np.testing.assert_allclose(eye, np.broadcast_to(np.eye(3), eye.shape), atol=1e-14)


@FORMS
def test_what_is_not_wanted_changes_nothing_else(form) -> None:
    x = states([-1.5, 0.8])
    few, all_of_it = turned(form, x, frames=False), turned(form, x)
    assert not few.pop("C_nb").size + few.pop("C_nl").size
    for name, values in few.items():
        np.testing.assert_array_equal(values, all_of_it[name], err_msg=name)


def test_many_rows_go_through_the_kernel_and_few_do_not(monkeypatch) -> None:
    from foucault.navigate import strapdown

    calls = []
    monkeypatch.setattr(strapdown, "local_level", lambda *a: calls.append(len(a[0])))
    x = np.tile(State.at_rest(np.eye(3), 0.5).packed(), (MANY, 1))
    states_of(x[:-1])
    assert calls == []
    states_of(x)
    assert calls == [MANY]
