"""What a calibration does not estimate: typical sizes, and what one size of it does to readings.

A term that is not estimated is not zero. Each has a group ("accel.quadratic"), whose size (1 sd)
is declared, of a data sheet, or that of the grade of the instrument (`left_out.toml`). What one
size of it does to samples is computed at the true specific force and rate of each.

The rate of the log's clock is not among them: a result is in the log's own time, and what the clock
adds in seconds stands beside it (`diagnose.references.with_clock`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic import Field

from foucault import units
from foucault.arrays import FloatArray
from foucault.errors import error, suggestion
from foucault.files import parse_toml
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.imu_layout import PRODUCTS, coefficient_slot
from foucault.strict import Strict
from foucault.tables import AXES

Sizes = Mapping[str, tuple[float, str]]
"""Group -> size [SI] and what it rests on."""

GRAVITY, LATITUDE = "local gravity", "latitude"

FIELD = 50e-6
"""Field at which terms of a magnetometer that bends are of their size, as a part of it [T]."""

BENT = {"quadratic": 2, "cubic": 3}
"""Powers of the reading that such a term adds [1]."""


class Group(Strict):
    """Terms of one kind, which have one size."""

    what: str
    """In words."""
    kind: str
    """Kind of quantity, as in `units`."""
    unit: str
    """Unit of `sizes`, and in which people read it."""
    sizes: tuple[float, ...]
    """Typical size for each grade."""
    basis: tuple[str, ...]
    """What each rests on."""
    shown_by: str
    """What in a plan shows it, or what else tells how large it is."""


class Table(Strict):
    """What `left_out.toml` says."""

    grades: tuple[str, ...]
    """Grades of instruments."""
    noise: dict[str, tuple[str, ...]]
    """Triad -> noise above which it is of each grade but the last."""
    groups: dict[str, Group] = Field(min_length=1)
    """Group -> its sizes."""


@cache
def table() -> Table:
    """Return the table of typical sizes."""
    text = (Path(__file__).parent / "left_out.toml").read_text(encoding="utf-8")
    return Table.model_validate(parse_toml(text))


def sizes_of(grade: str) -> dict[str, tuple[float, str]]:
    """Return the typical sizes of a grade, such as "consumer MEMS", as `Sizes` [SI]."""
    said = table()
    if grade not in said.grades:
        raise error("left_out.grade", given=grade, hint=suggestion(grade, said.grades),
                    allowed=", ".join(said.grades))  # fmt: skip
    k = said.grades.index(grade)
    return {
        name: (g.sizes[k] * units.factor(g.unit, g.kind), f"{grade}, {g.basis[k]}")
        for name, g in said.groups.items()
        if g.sizes
    }


class ByNoise(dict[str, tuple[float, str]]):
    """Sizes that are declared, beside those of the grade that the noise of a log tells."""


def told(sizes: Sizes, accel: float, gyro: float) -> Sizes | None:
    """Return what `sizes` come to beside noise, None where nothing tells any.

    Each triad has the grade of its own noise; one whose noise nobody knows has that of the other.

    `accel`, `gyro`: white noise, NaN where unknown [SI].
    """
    if not isinstance(sizes, ByNoise):
        return sizes
    found = {k: g for k, w in (("accel", accel), ("gyro", gyro)) if (g := grade_of(k, w))}
    out = dict[str, tuple[float, str]]()
    for name in table().groups if found else ():
        grade = found.get(name.partition(".")[0]) or next(iter(found.values()))
        usual = sizes_of(grade).get(name)
        if usual is not None:
            out[name] = (usual[0], f"grade told by noise (judgement): {usual[1]}")
    return out | sizes or None


def of_imu(sizes: Sizes) -> Sizes:
    """Return those of `sizes` that are not of a magnetometer."""
    return {group: size for group, size in sizes.items() if not group.startswith("mag.")}


def grade_of(triad: str, white: float) -> str | None:
    """Return the grade that the `white` noise of a triad tells, shape () [SI]; None where NaN."""
    kind = {"accel": "velocity random walk", "gyro": "angle random walk"}[triad]
    if not np.isfinite(white):
        return None
    least = [units.parse(text, kind) for text in table().noise[triad]]
    return table().grades[sum(white <= one for one in least)]


def in_words(group: str, size: float) -> str:
    """Write the `size`, shape () [SI], of a group in the unit that people read it in."""
    g = table().groups[group]
    return f"{units.plain(size / units.factor(g.unit, g.kind), 3)} {g.unit}"


class Motion(NamedTuple):
    """The true motion at the samples, or readings, that a calibration was made of."""

    time: FloatArray  # (n,) [s]
    f_b: FloatArray  # (n, 3) true specific force, frame b [m/s^2]
    w_ib_b: FloatArray  # (n, 3) true rate, frame b [rad/s]
    begin: float  # of the session, from which a drift counts [s]
    end: float  # of the session [s]
    mag: FloatArray | None = None  # (n, 3) readings of a magnetometer [T]


class Change(NamedTuple):
    """What one size of a term does to samples and to the place."""

    accel: FloatArray | None = None  # (n, 3) added to the specific force read [m/s^2]
    gyro: FloatArray | None = None  # (n, 3) added to the rate read [rad/s]
    gravity: float = 0.0  # local gravity is so much larger [m/s^2]
    latitude: float = 0.0  # the latitude is so much further north [rad]
    mag: FloatArray | None = None  # (n, 3) added to the readings of a magnetometer [T]


NONE = Change()


class Term(NamedTuple):
    """One number that is not estimated."""

    name: str
    group: str
    size: float  # 1 sd [SI]


def changes(some: Sequence[Term], model: ImuModel, at: Motion) -> Iterator[Change]:
    """Yield what one size of each term of one group does to the samples of an instrument.

    A reading is linear in each of these terms, whatever the others: its slope is no approximation.
    """
    triad, _, kind = some[0].group.partition(".")
    if kind and "drift" not in kind and triad != "mag":
        slopes = model.slopes(at.f_b, at.w_ib_b, [t.name for t in some])
        columns = slopes.accel if triad == "accel" else slopes.gyro
    ramp = (at.time - at.begin) / max(at.end - at.begin, 1e-300) - 0.5
    for k, term in enumerate(some):
        if term.group == GRAVITY:
            yield Change(gravity=term.size)
        elif term.group == LATITUDE:
            yield Change(latitude=term.size)
        else:
            if "drift" in kind or triad == "mag":
                axis = AXES.index(term.name[-1])
                added = np.zeros_like(at.w_ib_b)
                true = {"accel": at.f_b, "gyro": at.w_ib_b, "mag": at.mag}[triad]
                assert true is not None
                if kind in BENT:
                    added[:, axis] = FIELD * (true[:, axis] / FIELD) ** BENT[kind]
                else:
                    added[:, axis] = ramp * (true[:, axis] if kind == "scale drift" else 1.0)
            else:
                added = columns[..., k]
            added = term.size * added
            if triad == "mag":
                yield Change(mag=added)
            else:
                yield Change(accel=added) if triad == "accel" else Change(gyro=added)


class Monomial(NamedTuple):
    """What one unit of a term adds to one axis of a sensor without errors: a product of inputs."""

    axis: int  # that it adds to: 0, 1, 2
    # numbers among ``1, f_x, f_y, f_z, w_x, w_y, w_z, |f_x| ... |w_z|, ramp`` of a drift
    inputs: tuple[int, int, int]


def monomial(term: Term) -> Monomial:
    """Return what a term is at true specific force and rate, as `changes` has it."""
    one, f, w, size_f, size_w, ramp = 0, 1, 4, 7, 10, 13
    triad, _, kind = term.group.partition(".")
    if "drift" in kind:
        axis = AXES.index(term.name[-1])
        true = (f if triad == "accel" else w) + axis if kind == "scale drift" else one
        return Monomial(axis, (true, ramp, one))
    block, at = coefficient_slot(term.name)
    axis, *inner = at if isinstance(at, tuple) else (at,)
    first, last = (inner or [axis])[0], inner[-1:]
    two = [AXES.index(a) for a in PRODUCTS[first]] if block == "accel_quadratic" else [0, 0]
    inputs = {
        "accel_bias": (one, one, one), "gyro_bias": (one, one, one),
        "accel_matrix": (f + first, one, one), "gyro_matrix": (w + first, one, one),
        "g_sensitivity": (f + first, one, one), "accel_quadratic": (f + two[0], f + two[1], one),
        "accel_asymmetry": (size_f + axis, one, one), "gyro_asymmetry": (size_w + axis, one, one),
        "gyro_cubic": (w + axis, w + axis, w + axis), "deflection": (w + first, f + sum(last), one),
    }  # fmt: skip
    return Monomial(axis, inputs[block])


def terms(names: Sequence[str], site: Site, sizes: Sizes) -> list[Term]:
    """Return what is not estimated, of the groups that have a size.

    `names`: of the coefficients that are estimated; `site`: whose gravity has an uncertainty, and
    which has a latitude or none.
    """
    out, field = [], any(n.startswith("mag.") for n in names)
    for group, (size, _) in sizes.items():
        if group == LATITUDE:
            members = [LATITUDE] if site.latitude is not None else []
        elif group == GRAVITY:
            members = [GRAVITY]
        elif group.startswith("mag.") and not field:
            members = []
        elif group.endswith(" drift"):
            members = [f"{group} {axis}" for axis in AXES]
        elif group.startswith("mag."):
            members = [f"{group}.{axis}" for axis in AXES]
        else:
            members = [LAYOUT.names[i] for i in LAYOUT.group(group)]
        out += [Term(n, group, size) for n in members if n not in names and size > 0]
    return out
