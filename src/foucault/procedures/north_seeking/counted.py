"""What a north seeker's calibration does not estimate and counts with; `field` is of its fix.

One gyro turns with the base: its terms belong to axes that turn too, k, y along the sensing axis, x
to the right of it, z up. At the index angle a they see ``w_k = C_kb(a) w_b``, so that over the
angles of a set-up a term is a constant, a cosine or something twice per turn::

    g-sensitivity    K_yx f_x + K_yy f_y: once per turn      K_yz f_z: constant
    bias             constant; its drift is one within the set-up too
    f_y^2, |f_y|     constant, and twice per turn            f_y f_z: once per turn

Opposite stops keep what goes once per turn. A constant is in the offset that every set-up finds
anew, and what goes twice per turn is in neither rate: these cost nothing, and a column of them is
nothing. Accelerometers on the case have terms in the axes of the case, which cancel nowhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.estimate.north import COMMON_HEADING, HEADINGS, LATITUDE, LEVEL, OnTurntable, Rig
from foucault.estimate.north_reduction import INDEXING, Pairs
from foucault.infer.left_out import Judgement
from foucault.models.imu import ImuModel
from foucault.models.imu_layout import coefficient_slot
from foucault.models.left_out import (
    Change,
    Motion,
    Sizes,
    Term,
    sizes_of,
    table,
    told,
)
from foucault.models.noise import ImuNoise
from foucault.models.north_seeker import Dwells
from foucault.procedures.left_out import Again, changed, wander_of
from foucault.procedures.north_seeking.settings import Session, Settings
from foucault.tables import AXES

ARCSEC = float(np.radians(1 / 3600))

JUDGED = "judgement"

RIG = {
    "index_sd": (INDEXING, 10 * ARCSEC),
    "heading_sd": (HEADINGS, 10 * ARCSEC),
    "heading_offset_sd": (COMMON_HEADING, 20 * ARCSEC),
}
"""Setting -> what it is the size of, and how large that is where nobody says [rad]."""

LEAN = 20 * ARCSEC
"""Sd of the tilt of a table's axis, about each of two, where nobody says it [rad]."""

LAG = 1e-3
"""Sd of the time between index angle and reading of a base that turns, judgement [s]."""

DRIFT = "gyro.bias drift"


def completed(settings: Settings, sizes: Sizes | None) -> tuple[Settings, dict[str, str]]:
    """Return settings with a size for all that is not said of base, headings and place.

    `sizes` or None: of what is not estimated, None: nothing is put to them [SI]. Returns also
    source -> basis of what was put to them.
    """
    if sizes is None:
        return settings, {}
    place = sizes.get(LATITUDE) or sizes_of(table().grades[0])[LATITUDE]
    usual = {key: (name, size, JUDGED) for key, (name, size) in RIG.items()}
    usual |= {"latitude_sd": (LATITUDE, *place), "index_lag_sd": (INDEXING, LAG, JUDGED)}
    more = {key: one for key, one in usual.items() if not getattr(settings, key)}
    if settings.unknown_latitude:
        del more["latitude_sd"]
    basis = {name: words for key, (name, _, words) in more.items() if key != "index_lag_sd"}
    return settings.model_copy(update={key: sd for key, (_, sd, _) in more.items()}), basis


def drawn(
    session: Session, settings: Settings, model: ImuModel, rng: np.random.Generator
) -> tuple[Session, Settings, ImuModel]:
    """Draw base, table and headings as far off as they are taken to be where nobody says it."""
    del rng  # of their own seed, as what is declared of them
    more = {key: size for key, (_, size) in RIG.items() if not getattr(settings, key)}
    if settings.level_sd is None and len(set(session.tilts)) > 1:
        more["level_sd"] = LEAN
    return session, settings.model_copy(update=more), model


def stood(rig: Rig, settings: Settings, sizes: Sizes | None) -> Rig:
    """Return a rig with how level its table stands, where nobody says it and no reading shows it.

    `sizes` or None: as of `completed` [SI].
    """
    if sizes is None or rig.tilt != "each" or settings.level_sd is not None:
        return rig
    return replace(rig, level_sd=LEAN, assumed={**rig.assumed, LEVEL: JUDGED})


def beside(sizes: Sizes | None, settings: Settings, noise: ImuNoise) -> Sizes | None:
    """Return the sizes of what is no setting, as `noise` tells them: what one says counts once."""
    sizes = None if sizes is None else told(sizes, *white_of(noise))
    if sizes is None:
        return None
    again = {LATITUDE} | ({DRIFT} if settings.drift_sd is not None else set())
    return {g: s for g, s in sizes.items() if g not in again}


def white_of(noise: ImuNoise) -> tuple[float, float]:
    """Return the white noise of both triads, NaN where there is none [SI]."""
    return noise.accel.white or np.nan, noise.gyro.white or np.nan


def again(model: OnTurntable, dwells: Dwells, noise: ImuNoise) -> Again:
    """Return the calibration with something put into it, its readings weighed as they were.

    `dwells`: readings that `model` was made of [SI]; `noise`: as they were weighed [SI].
    """

    def motion(state: FloatArray) -> tuple[ImuModel, Motion]:
        w, f, _, _ = model.truth(state)
        return ImuModel(), moved(dwells, f, w)

    def residuals(state: FloatArray, by: Change) -> FloatArray:
        pairs = model.pairs
        pairs = replace(pairs, values=pairs.values + added(pairs, dwells, [by])[:, :, 0])
        rig = replace(model.rig, site=changed(model.rig.site, by))
        return replace(model, pairs=pairs, rig=rig).residuals(state)

    span = float((dwells.start + dwells.time).max() - dwells.start.min())
    return Again(motion, residuals, white_of(noise), wander_of(noise, span))


def added(pairs: Pairs, dwells: Dwells, by: Sequence[Change]) -> FloatArray:
    """Return what changes of readings do to the four numbers of set-ups, (m, 4, c) [SI]."""
    out = np.zeros((len(pairs), 4, len(by)))
    first = np.searchsorted(dwells.setup, np.arange(len(pairs)))
    read = [put(dwells, one) for one in by]
    gyro = [k for k, (more, _) in enumerate(read) if more is not None]
    if gyro:
        more = np.stack([read[k][0] for k in gyro], 1)  # type: ignore[misc]
        out[:, :2, gyro] = np.add.reduceat(pairs.gyro_weights[:, :, None] * more[:, None], first)
    accel = [k for k, (_, more) in enumerate(read) if more is not None]
    if accel:
        more = np.stack([read[k][1] for k in accel], 2)  # type: ignore[misc]
        each = np.swapaxes(pairs.accel_weights, 1, 2) @ more
        out[:, 2:, accel] = np.add.reduceat(each, first)
    return out


def felt(term: Term, case: bool) -> bool:
    """Whether a term is of an axis that is read: y, and x of accelerometers on the case.

    `case`: whether they are there.
    """
    axis = term.name[-1]
    if "drift" not in term.group:
        at = coefficient_slot(term.name)[1]
        axis = AXES[at[0] if isinstance(at, tuple) else at]
    return axis == "y" or (axis == "x" and term.group.startswith("accel") and case)


def moved(dwells: Dwells, f_b: FloatArray, w_b: FloatArray) -> Motion:
    """Return what the sensors feel at every row, in axes that turn with the base.

    `dwells`: n rows of m set-ups [SI]; `f_b`, `w_b` (m, 3): true specific force [m/s^2] and rate
    [rad/s] in the case. Accelerometers on the case follow, n rows more, in its axes.
    """
    c, s = dwells.cosine, dwells.sine
    f, w = f_b[dwells.setup], w_b[dwells.setup]
    f_k, w_k = (
        np.stack([c * x - s * y, s * x + c * y, z], 1) for x, y, z in (f.T, w.T)
    )  # fmt: skip
    time = dwells.start + dwells.time / 2
    ends = float(dwells.start.min()), float((dwells.start + dwells.time).max())
    if not on_case(dwells):
        return Motion(time, f_k, w_k, *ends)
    return Motion(np.tile(time, 2), np.append(f_k, f, 0), np.append(w_k, w, 0), *ends)


def on_case(dwells: Dwells) -> bool:
    """Whether two accelerometers stay with the case of these readings [SI]."""
    return dwells.accel is not None and dwells.accel.shape[1] == 2


def put(dwells: Dwells, by: Change) -> tuple[FloatArray | None, FloatArray | None]:
    """Return what a term adds to the gyro (n,) and to the accelerometers (n, q) of readings [SI].

    None where that is nothing.
    """
    n = len(dwells)
    gyro = None if by.gyro is None else by.gyro[:n, 1]
    accel = None
    if by.accel is not None and dwells.accel is not None:
        accel = by.accel[n:, :2] if on_case(dwells) else by.accel[:, 1:2]
    return gyro, accel


def with_rig(judged: Judgement, rig: Rig, index_sd: float) -> Judgement:
    """Return a judgement that says what is known of base, table and place too.

    `index_sd`: of every index angle [rad].
    """
    known = {
        INDEXING: (index_sd, "index_sd"), HEADINGS: (rig.heading_sd, "heading_sd"),
        COMMON_HEADING: (rig.heading_offset_sd, "heading_offset_sd"),
        LEVEL: (rig.level_sd, "level_sd"), LATITUDE: (rig.latitude_sd, "latitude_sd"),
    }  # fmt: skip
    said = {
        name: (sd, rig.basis(name, key)) for name, (sd, key) in known.items()
        if sd and name in judged.seen
    }  # fmt: skip
    groups = (*judged.groups, *(n for n in said if n not in judged.groups))
    return replace(judged, groups=groups, sizes={**judged.sizes, **said})
