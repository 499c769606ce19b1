"""Is the first rest of a session as its log's description says?"""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.coverage import direction_words
from foucault.errors import Finding, error, finding
from foucault.logs.description import LogDescription
from foucault.models.readings import Readings
from foucault.tables import AXES, Log


def first_rest_orientation(log: Log, up_b: FloatArray) -> list[Finding]:
    """Compare the first rest with its declared orientation.

    `log`: the log, its source keeps the description it was read with; `up_b` (3,): direction of
    up at the first rest, frame b [1]. Raises it is another than declared.
    """
    description = log.source.get("description") or {}
    declared = (description.get("accel") or {}).get("first_rest")
    if declared is None:
        return [finding("accel.sign_unknown")]
    as_declared(declared, up_b)
    return []


def as_declared(declared: str, up_b: FloatArray) -> None:
    """Refuse a first rest whose orientation is another than declared.

    `declared`: as in a description, such as "z up"; `up_b` (3,): direction of up at the first
    rest, frame b [1]. Raises ``accel.orientation``.
    """
    axis, sense = str(declared).split()
    want = np.zeros(3)
    want[AXES.index(axis)] = 1.0 if sense == "up" else -1.0
    cosine = float(want @ up_b)
    if cosine > np.cos(np.radians(45)):
        return
    advice = (
        'All signs are turned: set reads = "gravity" in [log.accel], or correct first_rest.'
        if cosine < -np.cos(np.radians(45))
        else "Correct the order of `columns` in [log.accel] and [log.gyro], or first_rest."
    )
    raise error(
        "accel.orientation", declared=declared, measured=direction_words(up_b), advice=advice
    )


def first_as_declared(readings: Readings, described: Log | LogDescription) -> None:
    """Refuse readings on a table of which the first is in another orientation than declared.

    `readings`: one mean per rest and spin [SI]. Raises ``accel.orientation``.
    """
    if isinstance(described, Log):
        said = (described.source.get("description") or {}).get("accel") or {}
        declared = said.get("first_rest")
    else:
        declared = described.accel and described.accel.first_rest
    if declared and readings.accel is not None:
        as_declared(declared, readings.accel[0] / np.linalg.norm(readings.accel[0]))
