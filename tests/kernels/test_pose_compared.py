"""Poses beside a point: by a plain formula, and slopes by differences; compiled and as Python."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from foucault.kernels import pose as kernels

FORMS = pytest.mark.parametrize("form", ["compiled", "python"])
KINDS = pytest.mark.parametrize("kind", [0, 1, 2, 3])
RNG = np.random.default_rng(4)
N, M = 12, 3


@dataclass(frozen=True)
class Case:
    """Some samples, and poses in between."""

    kind: int
    share: float = 1.0
    force: float = 1.0  # part of the forces [1]
    later: np.ndarray = field(default_factory=lambda: RNG.uniform(0.0, 0.01, M))
    lever: np.ndarray = field(default_factory=lambda: RNG.normal(0, 0.1, 3))
    base: np.ndarray = field(default_factory=lambda: RNG.normal(0, 0.5, 3))
    C_bm: np.ndarray = field(default_factory=lambda: Rotation.random(rng=1).as_matrix())
    C: np.ndarray = field(default_factory=lambda: Rotation.random(M, rng=2).as_matrix())
    v: np.ndarray = field(default_factory=lambda: RNG.normal(0, 1, (M, 3)))
    p: np.ndarray = field(default_factory=lambda: RNG.normal(0, 1, (M, 3)))
    turned: np.ndarray = field(default_factory=lambda: np.zeros(3))  # beside what gyros say
    position: np.ndarray = field(default_factory=lambda: np.zeros((M, 3)))
    other: np.ndarray = field(default_factory=lambda: np.zeros((M, 3)))
    C_vm: np.ndarray = field(default_factory=lambda: np.repeat(np.eye(3)[None], M, axis=0))


NODE, SINCE, DT = np.array([2, 5, 8]), np.array([-0.4, 0.1, 0.5]), RNG.uniform(0.009, 0.011, N)
THETA, FORCE = 0.03 * RNG.standard_normal((N, 3)), 0.1 * RNG.standard_normal((N, 3))
RAW, K_G, G = THETA + 1e-3, np.eye(3) + 0.01 * RNG.standard_normal((3, 3)), np.array([0.1, 0, -9.8])


def of(case, form, columns=32):
    """Return what the kernel says."""
    z, H, D = np.zeros((M, 6)), np.zeros((M, 6, 9)), np.zeros((M, 6, columns))
    arm = case.base + case.share * case.lever if case.kind > 1 else np.zeros(3)
    run = kernels.compared if form == "compiled" else kernels.compared.py_func
    run(NODE, case.later, SINCE, DT, THETA, case.force * FORCE, RAW, K_G, case.C, case.v,
        case.p, G, case.C_bm,
        case.lever, arm, case.share, case.kind, case.position, case.other, case.C_vm,
        z, H, D)  # fmt: skip
    return z, H, D


def expected(case):
    """Return position, second antenna and attitude of the tracked body, by the plain formula."""
    place, second, C_vm = np.zeros((M, 3)), np.zeros((M, 3)), np.zeros((M, 3, 3))
    for k, (n, d) in enumerate(zip(NODE, case.later, strict=True)):
        h = DT[n + 1]
        m0, m1, m2 = (THETA[n + j] / DT[n + j] for j in range(3))
        bend = (m2 - 2 * m1 + m0) / (2 * h**2)
        w, dw = (m0 + m1) / 2 - bend * h**2 / 3, (m1 - m0) / h
        E = Rotation.from_rotvec(d * w + d**2 * dw / 2 + d**3 * bend / 3).as_matrix()
        CE = case.C[k] @ E @ Rotation.from_rotvec(case.turned).as_matrix()
        a = case.force * case.C[k] @ (FORCE[n] / DT[n] + FORCE[n + 1] / h) / 2 + G
        p = case.p[k] + case.v[k] * d + a * d**2 / 2
        place[k] = p + CE @ case.lever
        second[k] = case.share * place[k] + CE @ case.base
        C_vm[k] = CE @ case.C_bm
    return place, second, C_vm


def axes(base):
    """Return rows along a base, level across it, and across both."""
    e = base / np.linalg.norm(base)
    level = np.cross(e, [0.0, 0.0, 1.0])
    level /= np.linalg.norm(level)
    return np.array([e, level, np.cross(level, e)])


def apart(case, other):
    """Return the numbers of the poses of another case less those of a case, (M, 6)."""
    (p, s, C), (q, t, D) = expected(case), expected(other)
    out = np.zeros((M, 6))
    out[:, 3:] = q - p
    for k in range(M):
        if case.kind == 1:
            out[k, :3] = Rotation.from_matrix(C[k].T @ D[k]).as_rotvec()
        if case.kind > 1:
            out[k, :3] = t[k] - s[k]
        if case.kind == 3:
            out[k, :3] = axes(s[k]) @ out[k, :3]
    return out


def measured(case, of_):
    """Return a case whose poses are those of another."""
    p, s, C = expected(of_)
    return replace(case, position=p, other=s, C_vm=C)


def made(kind):
    return Case(kind, share=float(kind == 2))


@FORMS
@KINDS
def test_poses_less_those_of_a_point(form, kind):
    case = made(kind)
    other = replace(case, lever=case.lever + 0.01, turned=np.array([0.02, -0.01, 2.5]))
    z = of(measured(case, other), form, 0)[0]
    np.testing.assert_allclose(z, apart(case, other), atol=1e-12)


@FORMS
@KINDS
def test_slopes_are_differences(form, kind):
    case = replace(made(kind), force=0.0)  # what their turning does in half an interval is left out
    _, H, D = of(measured(case, case), form)
    step = 1e-6

    def slope(**change):
        up, down = (replace(case, **{k: f(s) for k, f in change.items()}) for s in (step, -step))
        return (apart(case, up) - apart(case, down)) / (2 * step)

    for i in range(3):
        e = np.eye(3)[i]
        turn = {"C": lambda s, e=e: case.C @ Rotation.from_rotvec(s * e).as_matrix()}
        np.testing.assert_allclose(H[:, :, i], slope(**turn), atol=1e-8)
        np.testing.assert_allclose(
            H[:, :, 3 + i], slope(v=lambda s, e=e: case.v + s * e), atol=1e-8
        )
        np.testing.assert_allclose(
            H[:, :, 6 + i], slope(p=lambda s, e=e: case.p + s * e), atol=1e-8
        )
        lever = slope(lever=lambda s, e=e: case.lever + s * e)
        np.testing.assert_allclose(D[:, :, 3 + i], lever, atol=1e-8)
        own = {"base": lambda s, e=e: case.base + s * e}
        if kind == 1:
            own = {"C_bm": lambda s, e=e: case.C_bm @ Rotation.from_rotvec(s * e).as_matrix()}
        if kind:
            np.testing.assert_allclose(D[:, :, i], slope(**own), atol=1e-8)
        by = np.stack([slope(turned=lambda s, j=j: s * np.eye(3)[j]) for j in range(3)], axis=2)
        np.testing.assert_allclose(
            D[:, :, 10 + i], -(by @ K_G)[:, :, i] * case.later[:, None], atol=1e-8
        )
        raw = RAW[NODE + 1] / DT[NODE + 1, None] * case.later[:, None]
        of_row = -(by @ K_G)[:, :, i, None] * raw[:, None]
        np.testing.assert_allclose(D[:, :, 16 + 3 * i : 19 + 3 * i], of_row, atol=1e-8)
    # A rate that turns itself: to the order of an interval.
    late = slope(later=lambda s: case.later + s)
    np.testing.assert_allclose(D[:, :, 6], late, atol=0.02)
    np.testing.assert_allclose(D[:, :, 7], late * SINCE[:, None], atol=0.01)
    assert not D[:, :, 25:].any() and not D[:, :, 8:10].any()
