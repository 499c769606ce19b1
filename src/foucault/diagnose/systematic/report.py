"""The tables of a systematic calibration, and what it cannot see in principle."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.diagnose.systematic.checks import Evidence, squares
from foucault.models.earth import Site
from foucault.tables import AXES

WAYS = ("east", "north", "up")


def tables(e: Evidence, numbers: npt.NDArray[np.int64]) -> dict[str, dict[str, npt.NDArray[Any]]]:
    """Return the tables of the report.

    `numbers` (m,): which rests of the log were used, from 0 [1].
    """
    time, legs = e.increments.time, e.legs
    total, count = squares(e)
    attitudes = {"rest": legs.seen} | {
        f"{axis}.{way}": legs.C_nb[:, i, k]
        for k, axis in enumerate(AXES)
        for i, way in enumerate(WAYS)
    }
    velocities: dict[str, npt.NDArray[Any]] = {
        "rest": legs.rest, "start": legs.start, "end": legs.end,
    }  # fmt: skip
    for name, values in (("before", legs.before), ("after", legs.after), ("sd", legs.sd)):
        velocities |= {f"{name}_{way}": values[:, i] for i, way in enumerate(WAYS)}
    return {
        "innovations": {
            "rest": np.arange(len(e.rests)), "in_log": numbers,
            "start": time[[a for a, _ in e.rests]], "end": time[[b for _, b in e.rests]],
            "square": total, "count": count,
        },
        "velocities": velocities,
        "attitudes": attitudes,
    }  # fmt: skip


def unseen(site: Site, decorrelated: bool) -> list[str]:
    """Say what this procedure cannot see in principle, for result.json.

    `decorrelated`: whether every rest started anew with velocity and position.
    """
    sd = site.gravity_sd
    known = (
        f"its standard uncertainty, {sd / 1e-5:.3g} mGal, is part of every uncertainty"
        if sd else "it was taken as exact"
    )  # fmt: skip
    out = [
        f"A wrong local gravity: 1 ppm of g is 1 ppm in all accelerometer scale factors; {known}.",
        "A wrong latitude: 0.01 deg is an error of the Earth's rate of 0.003 deg/h.",
        "How the body axes lie in the case: they are those of the accelerometers (see gauge).",
        "Specific force beyond 1 g: there the result is extrapolated.",
        "Other temperatures than that of the session, and biases from one switch-on to the next.",
    ]
    if not decorrelated:
        out.append("Lever arms of the accelerometers, unless they are estimated.")
    return out
