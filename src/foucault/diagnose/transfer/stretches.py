"""What the vehicle did while its master was heard, stretch by stretch, and what each has shown."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray
from foucault.models.rotation import log as rotation_vector
from foucault.models.transfer import Messages

KINDS = ("straight", "accelerated", "turning")
"""What a stretch is called."""

OVER = 2.0
"""Rates are means over so long [s]."""

TURNING, ACCELERATED = np.radians(1.0), 0.2
"""More is a turn [rad/s], a change of speed [m/s^2]."""

SHORTEST = 4.0
"""What lasts shorter belongs to the stretch before it [s]."""


def kinds_of(said: Messages) -> IntArray:
    """Return what the vehicle does at each message, as a number of `KINDS`, shape (k,)."""
    t = said.time
    a = np.searchsorted(t, t - OVER / 2)
    b = np.minimum(np.searchsorted(t, t + OVER / 2), len(t) - 1)
    dt = np.maximum(t[b] - t[a], 1e-9)
    C, speed = said.C_nm, np.linalg.norm(said.velocity_n, axis=1)
    rate = np.linalg.norm(rotation_vector(np.swapaxes(C[a], 1, 2) @ C[b]), axis=1) / dt
    out = np.where(np.abs(speed[b] - speed[a]) / dt > ACCELERATED, 1, 0)
    return np.where(rate > TURNING, 2, out).astype(np.int64)


def stretches(said: Messages) -> list[tuple[int, int, int]]:
    """Return first message, the one after the last, and kind of each stretch."""
    kind, t = kinds_of(said), said.time
    edges = np.flatnonzero(np.diff(kind, prepend=-1, append=-1))
    out: list[tuple[int, int, int]] = []
    for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        short = t[b - 1] - t[a] < SHORTEST
        if out and (short or out[-1][2] == kind[a]):
            out[-1] = (out[-1][0], b, out[-1][2])
        else:
            out.append((a, b, int(kind[a])))
    return out


def table(said: Messages, sd: Mapping[str, FloatArray]) -> dict[str, npt.NDArray[Any]]:
    """Return one row per stretch: begin, end, kind, turn, change of speed, and sds at its end.

    `sd` (k,): standard deviation of each coefficient after each message [SI].
    """
    found = stretches(said)
    first = np.array([a for a, _, _ in found])
    last = np.array([b for _, b, _ in found]) - 1
    C, speed = said.C_nm, np.linalg.norm(said.velocity_n, axis=1)
    turned = rotation_vector(np.swapaxes(C[first], 1, 2) @ C[last])
    return {
        "start": said.time[first],
        "end": said.time[last],
        "kind": np.array([KINDS[kind] for _, _, kind in found]),
        "turn": np.linalg.norm(turned, axis=1),
        "speed": speed[last] - speed[first],
        **{f"{name}_sd": x[last] for name, x in sd.items()},
    }
