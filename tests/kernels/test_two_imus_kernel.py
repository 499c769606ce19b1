"""The kernels of IMUs on one plate: compiled and as plain Python, on readings of a session."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import make_two
from foucault.kernels import banded
from foucault.kernels import two_imus as kernels
from foucault.models.earth import Site
from foucault.models.left_out import ByNoise
from foucault.procedures import two_imus
from foucault.procedures.two_imus import ImuLogs, Settings
from foucault.tables import Log
from plain_kernels import kernel

KEPT = 60
"""Samples of one call: plain Python takes its time [1]."""


@pytest.fixture(scope="module")
def calls() -> dict[str, list[list[Any]]]:
    """Return the arguments of calls of each kernel, before they are written to."""
    found: dict[str, list[list[Any]]] = {"normal": [], "pulled": []}
    with pytest.MonkeyPatch.context() as patch:
        for name, seen in found.items():
            compiled = getattr(kernels, name)

            def called(*a: Any, _seen: list[Any] = seen, _compiled: Any = compiled) -> Any:
                if len(_seen) < 8:
                    _seen.append([np.copy(v) if isinstance(v, np.ndarray) else v for v in a])
                return _compiled(*a)

            patch.setattr(kernels, name, called)
        made, _ = make_two.session(4, duration=20.0)
        master, slave = (Log(*one) for one in made)
        two_imus.trial(ImuLogs.of(slave, master, []), site=Site.at(0.8), settings=Settings(),
                       sizes=ByNoise())  # fmt: skip
    return found


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["normal", "pulled"])
def test_both_forms_say_the_same(name: str, calls: dict[str, list[list[Any]]]) -> None:
    assert len(calls[name]) >= 2  # of the master and of a slave
    for given in calls[name]:
        n = len(given[0])
        given = [v[:KEPT] if isinstance(v, np.ndarray) and len(v) == n else v for v in given]
        out = []
        for form in ("compiled", "python"):
            args = [np.copy(v) if isinstance(v, np.ndarray) else v for v in given]
            kernel(form, kernels, name)(*args)
            out.append(args)
        changed = 0
        for before, one, other in zip(given, *out, strict=True):
            if isinstance(one, np.ndarray):
                changed += not np.array_equal(before, one, equal_nan=True)
                size = np.nanmax(np.abs(one), initial=0.0)
                np.testing.assert_allclose(other, one, rtol=1e-9, atol=1e-12 * size)
        assert changed >= 1


@pytest.mark.parametrize("form", ["compiled", "python"])
def test_a_banded_triangle_is_solved_both_ways(form: str) -> None:
    rng = np.random.default_rng(2)
    L = rng.standard_normal((9, 4))
    L[:, 0] = 2.0 + np.abs(L[:, 0])
    full = sum(np.diag(L[: 9 - k, k], -k) for k in range(4))
    wanted = rng.standard_normal((9, 3))
    for name, A in (("forward", full), ("backward", np.transpose(full))):
        found = np.ascontiguousarray(A @ wanted)
        kernel(form, banded, name)(L, found)
        np.testing.assert_allclose(found, wanted, rtol=1e-12)
