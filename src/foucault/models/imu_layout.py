"""The coefficients of the IMU error model `models.imu`: names, symbols, kinds and meanings."""

from __future__ import annotations

from functools import lru_cache
from itertools import accumulate
from math import prod
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.coefficients import Layout, coefficients_of
from foucault.tables import AXES

PRODUCTS = (("x", "x"), ("y", "y"), ("z", "z"), ("x", "y"), ("x", "z"), ("y", "z"))
"""The second-order inputs q(f), in the order of the columns of K_a."""

BENDINGS = tuple((o, i, k) for o in AXES for i in AXES if i != o for k in AXES)
"""Gyro, direction that its input axis bends to, axis of the specific force: the 18 of T."""


LAYOUT = Layout(coefficients_of("imu"))
"""Every coefficient the model knows. A procedure estimates a subset; the rest is zero."""

LINEAR_LOWER = tuple(
    n
    for n in LAYOUT.names
    if n.split(".")[1] in ("bias", "scale", "misalignment")
    and not (n.startswith("accel.misalignment.") and n[-2] < n[-1])
)
"""Names of the 21 linear coefficients in the gauge `Gauge.LOWER`."""


_TRIAD_BLOCKS: dict[str, dict[str, str]] = {
    "accel": {"bias": "accel_bias", "scale": "accel_matrix", "misalignment": "accel_matrix"},
    "gyro": {"bias": "gyro_bias", "scale": "gyro_matrix", "misalignment": "gyro_matrix"},
}


def _slots() -> dict[str, tuple[str, Any]]:
    """Where each coefficient of `LAYOUT` lives: attribute of `models.imu.ImuModel`, index."""
    out: dict[str, tuple[str, Any]] = {}
    at = {a: i for i, a in enumerate(AXES)}
    for triad, blocks in _TRIAD_BLOCKS.items():
        for a in AXES:
            out[f"{triad}.bias.{a}"] = (blocks["bias"], at[a])
            out[f"{triad}.scale.{a}"] = (blocks["scale"], (at[a], at[a]))
            for i in AXES:
                if i != a:
                    out[f"{triad}.misalignment.{a}{i}"] = (blocks["scale"], (at[a], at[i]))
    for o in AXES:
        out[f"accel.quadratic.{o}"] = ("accel_quadratic", (at[o], at[o]))
        for column, (i, j) in enumerate(PRODUCTS):
            if not o == i == j:
                out[f"accel.cross.{o}{i}{j}"] = ("accel_quadratic", (at[o], column))
        for i in AXES:
            out[f"gyro.g_sensitivity.{o}{i}"] = ("g_sensitivity", (at[o], at[i]))
        out[f"accel.asymmetry.{o}"] = ("accel_asymmetry", at[o])
        out[f"gyro.asymmetry.{o}"] = ("gyro_asymmetry", at[o])
        out[f"gyro.cubic.{o}"] = ("gyro_cubic", at[o])
    for o, i, k in BENDINGS:
        out[f"gyro.deflection.{o}{i}{k}"] = ("deflection", (at[o], at[i], at[k]))
    return out


_SLOTS = _slots()


def coefficient_slot(name: str) -> tuple[str, Any]:
    """Return the attribute of `models.imu.ImuModel` and the index where coefficient `name` is."""
    LAYOUT.index(name)  # raises with a suggestion
    return _SLOTS[name]


SHAPES = {
    "accel_matrix": (3, 3), "accel_bias": (3,), "accel_quadratic": (3, 6), "gyro_matrix": (3, 3),
    "gyro_bias": (3,), "g_sensitivity": (3, 3), "gyro_asymmetry": (3,), "gyro_cubic": (3,),
    "accel_asymmetry": (3,), "deflection": (3, 3, 3),
}  # fmt: skip
_ENDS = dict(zip(SHAPES, accumulate(prod(shape) for shape in SHAPES.values()), strict=True))


def flat(model: Any) -> FloatArray:
    """Return all entries of the matrices of a `models.imu.ImuModel`, shape (87,) [SI]."""
    return np.concatenate([getattr(model, block).ravel() for block in SHAPES])


def blocks_of(entries: FloatArray) -> dict[str, FloatArray]:
    """Return the matrices whose entries `flat` put side by side, by attribute.

    `entries` (87,): all entries [SI].
    """
    return {
        block: entries[_ENDS[block] - prod(shape) : _ENDS[block]].reshape(shape)
        for block, shape in SHAPES.items()
    }


@lru_cache(maxsize=256)
def places(names: tuple[str, ...]) -> npt.NDArray[np.intp]:
    """Return where in `flat` the coefficients `names` are, shape (n,)."""
    out = np.empty(len(names), np.intp)
    for i, name in enumerate(names):
        block, where = coefficient_slot(name)
        shape = SHAPES[block]
        at = where if isinstance(where, tuple) else (where,)
        out[i] = _ENDS[block] - prod(shape) + np.ravel_multi_index(at, shape)
    out.setflags(write=False)  # the same for everybody who asks
    return out


@lru_cache(maxsize=256)
def subset(names: tuple[str, ...]) -> Layout:
    """Return the layout of the coefficients `names`, in the order given."""
    return LAYOUT.subset(names)


@lru_cache(maxsize=256)
def by_block(names: tuple[str, ...]) -> dict[str, tuple[npt.NDArray[np.intp], ...]]:
    """Return the coefficients `names` by the attribute of `models.imu.ImuModel` they are in.

    Of each: its number in `names`, its output axis, and which of the inputs it multiplies (two
    indices for deflection; the axis itself where it has no other), shape (q,) each.
    """
    rows: dict[str, list[tuple[int, ...]]] = {}
    for k, name in enumerate(names):
        block, where = coefficient_slot(name)
        at = where if isinstance(where, tuple) else (where, where)
        rows.setdefault(block, []).append((k, *at))
    return {block: tuple(np.array(at, np.intp).T) for block, at in rows.items()}
