"""What a platform tumble found beside its coefficients: alignment, motion, and what it showed."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from foucault import units
from foucault.coefficients import format_value
from foucault.models.cluster import CONSTANTS
from foucault.report import figures_motion, figures_tumble
from foucault.report.evidence import chi_square_words
from foucault.report.figures import lowered
from foucault.report.figures_tumble import GUIDE, Family
from foucault.report.page import Block, Column, Equation, Facts, Items, Section, Table, Text
from foucault.report.uncertainty import shown
from foucault.result import Result
from foucault.tables import AXES

ATTITUDE = "C_np = C_1(outer) C_2(middle) C_3(inner)"

ANGLES = (
    ("outer", "about North"),
    ("middle", "about Up while outer is 0: azimuth"),
    ("inner", "about z of the cluster"),
)

DRIFTS = ("drift", "drift_input", "drift_output", "drift_spin", "drift_input_output",
          "drift_input_spin", "drift_output_spin")  # fmt: skip

MOST_LEGS = 24
"""Legs of the motion that are listed [1]."""

OF_RESIDUALS = {"stretches", "neighbours", "slow errors"}
"""Checks that stand with the residuals, beside those of each accelerometer."""

MOST_UNSEEN = 12
"""Combinations that cannot be seen and are named [1]."""

START = {"start.east": "ψ_E", "start.north": "ψ_N", "start.up": "ψ_U"}

_NAME = re.compile(r"\b(?:gyro|accel|start|attitude)\.[\w.]*\w")


def alignment(result: Result) -> Section | None:
    """Attitude at the end and at the start, and the delay."""
    found = result.diagnostics.get("attitude")
    if not found or "attitude.outer" not in result.coefficients.layout:
        return None
    lead = (
        "How the cluster stood at the last reading, and where it began. All angles are zero where "
        "x, y and z of the cluster point north, up and east; otherwise, with coordinate rotations "
        "about North, Up and East:"
    )
    blocks: list[Block] = [Equation([ATTITUDE]), _angles(result, found), _axes(found)]
    facts = [("attitude at the start known to", _sizes(found["start_sd"], "East, North and Up"))]
    facts += [("attitude at the end known to", _sizes(found["sd"], "x, y and z of the cluster"))]
    delay = result.diagnostics.get("delay")
    if delay:
        facts.append(("delay of the readings", _delay(delay)))
    return Section("Alignment", lead, [*blocks, Facts(facts)])


def _angles(result: Result, found: Mapping[str, Any]) -> Table:
    columns = [
        Column("angle", "short"),
        Column("at the end", "number"),
        Column("± sd", "number"),
        Column("at the start", "number"),
        Column("as believed", "number", aside=True),
        Column("difference", "number", aside=True),
        Column("turns the axes", aside=True),
    ]
    rows = []
    for k, (word, meaning) in enumerate(ANGLES):
        at = result.coefficients.layout.index(f"attitude.{word}")
        value, sd = result.coefficients.values[at], result.coefficients.sd[at]
        start, believed = found["start"][k], found["believed"][k]
        apart = (start - believed + np.pi) % (2 * np.pi) - np.pi
        end = _signed(format_value(np.degrees(value), np.degrees(sd))) + "°"
        cells = [word, end, _size(sd), _degrees(start), _degrees(believed)]
        rows.append([*cells, _degrees(apart), meaning])
    return Table(columns, rows)


def _axes(found: Mapping[str, Any]) -> Table:
    """Where each axis points: as azimuth and elevation, and in components."""
    columns = [
        Column("axis at the end", "short"),
        Column("azimuth", "number"),
        Column("elevation", "number"),
        *[Column(word, "number", aside=True) for word in ("east", "north", "up")],
    ]
    rows = []
    for axis, (east, north, up) in zip(AXES, found["C_pn"], strict=True):
        azimuth = np.arctan2(east, north) % (2 * np.pi)
        elevation = np.arctan2(up, np.hypot(east, north))
        parts = [_signed(f"{v:.6f}") for v in (east, north, up)]
        rows.append([axis, _degrees(azimuth), _degrees(elevation), *parts])
    return Table(columns, rows)


def _degrees(angle: float) -> str:
    return _signed(f"{np.degrees(angle):.4f}") + "°"


def _size(sd: float) -> str:
    """Write the standard deviation of an angle to its second digit."""
    unit = units.display_unit("angle", sd)
    return f"{units.plain(units.convert(sd, 'angle', unit), 2)} {shown(unit)}"


def _sizes(sd: Sequence[float], about: str) -> str:
    return ", ".join(_size(v) for v in sd) + f" about {about}"


def _delay(delay: Mapping[str, Any]) -> str:
    if not (delay["sd"] or 0) > 0:  # none where the motion shows no delay
        return "not tested"
    value, sd = (1e3 * delay[key] for key in ("value", "sd"))
    words = f"{_signed(format_value(value, sd))} ± {format_value(sd, sd)} ms"
    if delay["estimated"]:
        return f"{words}, estimated with the rest"
    none = "none seen" if abs(value) < GUIDE * sd else "NOT taken off"
    return f"{words}, tested: {none}"


# -- the motion ------------------------------------------------------------------------------


def motion(result: Result) -> Section | None:
    """The way of the cluster axes, and the legs of the motion."""
    table = result.tables.get("path")
    if table is None or "x.east" not in table or "outer" not in table:
        return None
    legs = _legs(result)
    blocks: list[Block] = [figures_motion.path(table), figures_motion.path_map(table)]
    blocks.append(figures_motion.angles(table, legs))
    if 0 < len(legs) <= MOST_LEGS:
        blocks.append(_leg_table(legs, _seen(result)))
    lead = "Where the three axes of the cluster pointed in the course of the tumble."
    return Section("Motion", lead, blocks)


def _seen(result: Result) -> Mapping[str, Any]:
    found: Mapping[str, Any] = result.diagnostics.get("observability") or {}
    return found


def _legs(result: Result) -> list[dict[str, Any]]:
    return list(_seen(result).get("legs") or [])


def _leg_table(legs: Sequence[Mapping[str, Any]], seen: Mapping[str, Any]) -> Table:
    columns = [
        Column("leg", "short"),
        Column("from [s]", "number"),
        Column("to [s]", "number"),
        *[Column(f"rate {a} [°/s]", "number") for a in AXES],
        Column("rank by then", "number"),
        Column("seen alone by then", "number", aside=True),
    ]
    until = np.asarray(seen["growth"]["until"])
    rows = []
    for k, leg in enumerate(legs, 1):
        last = max(0, int(np.searchsorted(until, leg["end"] + 1e-6)) - 1)
        rates = [_signed(f"{v:.3f}") for v in np.degrees(leg["rate"])]
        counts = [str(seen["growth"][key][last]) for key in ("rank", "alone")]
        rows.append([str(k), f"{leg['start']:.0f}", f"{leg['end']:.0f}", *rates, *counts])
    return Table(columns, rows)


def observability(result: Result) -> Section | None:
    """What the motion shows, step by step, and what remains."""
    seen = _seen(result)
    if "growth" not in seen:
        return None
    rank, whole = seen["rank"], seen["states"]
    growth = seen["growth"]
    curves = {"combinations seen (rank)": growth["rank"], "seen each alone": growth["alone"]}
    blocks: list[Block] = [
        Text(_rank_words(seen)),
        figures_motion.growth(growth["until"], curves, whole, _legs(result)),
        Text(
            "Standard deviation after the tumble over that before, by readings and prior alone: "
            "farther left, better known. What gravity, latitude and slow noise add stands in the "
            "uncertainty budget."
        ),
        *_left(seen["of_prior"]),
    ]
    unseen = [w.removesuffix(": not seen at all") for w in seen["unseen"]]
    items = [("warning", f"Not seen: {_named(w)}.") for w in unseen[:MOST_UNSEEN]]
    if len(unseen) > MOST_UNSEEN:
        items.append(("warning", f"Not seen: {len(unseen) - MOST_UNSEEN} more combinations."))
    if not unseen:
        items += [("plain", f"Remains least known: {_named(w)}.") for w in seen["remaining"][:3]]
    items += [("plain", f"Hard to tell apart: {_named(w)}.") for w in seen["weakest"][:3]]
    pairs = [f"`{a}` and `{b}` ({value:+.2f})" for a, b, value in seen["correlated"][:6]]
    if pairs:
        words = f"Errors most correlated: {', '.join(pairs)}.".replace("-", "−")
        items.append(("plain", words))
    lead = (
        "Piecewise-constant observability of the motion as it was: how many independent "
        "combinations of the unknowns the readings have shown by then, each leg cut into short "
        "turns. Combinations are in units of the priors."
    )
    title = "What the motion shows" if rank == whole else "What the motion shows, and what not"
    return Section(title, lead, [*blocks, Items(items)])


def _rank_words(seen: Mapping[str, Any]) -> str:
    rank, whole, growth = seen["rank"], seen["states"], seen["growth"]
    until = growth["until"][int(np.argmax(np.asarray(growth["rank"]) == rank))]
    if rank < whole:
        left = whole - rank
        return (
            f"Rank {rank} of {whole}, reached after {until:.0f} s: {left} combination"
            f"{'s' * (left != 1)} of coefficients cannot be seen in this motion, however often it "
            "is repeated. Only the prior says anything of what is not seen."
        )
    return (
        f"Rank {rank} of {whole}, reached after {until:.0f} s: everything can be seen. In units "
        f"of the priors the weakest combination shows {_rounded(1 / seen['smallest'])} times less "
        "than the strongest."
    )


def _signed(text: str) -> str:
    """Write a minus sign as such, and a rounded zero without one."""
    return text.lstrip("-") if float(text) == 0 else text.replace("-", "−")


def _rounded(value: float) -> str:
    return f"{float(f'{value:.2g}'):,.0f}".replace(",", "\N{NO-BREAK SPACE}")


def _named(words: str) -> str:
    """Mark names as code, and write signs as people do."""
    words = words.replace("-", "−").replace(" ...", " and smaller parts")
    return _NAME.sub(lambda m: f"`{m.group()}`", words)


def _left(share: Mapping[str, float]) -> list[Block]:
    """Two pictures side by side: drifts, and everything else."""
    symbols = {c.name: c.symbol for c in CONSTANTS.coefficients} | START
    drift = [n for n in share if n.startswith("gyro.drift")]
    rest = [n for n in share if n not in drift]
    rest.sort(key=lambda n: n in START)
    out: list[Block] = []
    parts = (
        ("Drift of the gyros", drift, ""),
        ("All others", rest, "ψ: start.east, .north, .up: attitude at the start, about these."),
    )
    for title, names, caption in parts:
        labels = [lowered(symbols.get(n, n)) for n in names]
        least = min(share.values())
        out.append(
            figures_motion.left_of_prior(title, labels, [share[n] for n in names], least, caption)
        )
    return out


# -- estimates and residuals -----------------------------------------------------------------


def course(result: Result) -> Section | None:
    """How each estimate came about in the course of time."""
    table = result.tables.get("course")
    if table is None or not len(table["time"]) or "attitude.x" not in table:
        return None
    legs, time = _legs(result), np.asarray(table["time"], float)
    blocks: list[Block] = []
    for family in (*families(3), _attitude()):
        values = np.column_stack([table[m] for m in family.members]).astype(float)
        sd = np.column_stack([table[f"{m}.sd"] for m in family.members]).astype(float)
        if family.name != "attitude":
            values = values - values[-1]
        blocks.append(figures_tumble.course(time, family, values, sd, legs))
    lead = (
        "Each estimate as it would have been at that time [s], minus the final one. Shaded: ±3 sd "
        "as it was then. The scale is logarithmic on both sides of zero, and linear within the "
        "final sd. Dotted: the command changes. A band narrows where the motion shows the "
        "coefficient."
    )
    return Section("Estimates in the course of time", lead, blocks)


def families(most: int = 6) -> list[Family]:
    """Return the coefficients in groups of one kind, at most `most` in each."""
    groups: dict[str, list[int]] = {}
    for k, name in enumerate(CONSTANTS.names):
        groups.setdefault(name.rpartition(".")[0], []).append(k)
    return [
        _family(group, [CONSTANTS.names[k] for k in members[a : a + most]])
        for group, members in groups.items()
        for a in range(0, len(members), most)
    ]


def _family(name: str, members: Sequence[str], labels: Iterable[str] = ()) -> Family:
    kind = CONSTANTS.coefficients[CONSTANTS.index(members[0])].kind
    unit = units.KINDS[kind].display[0]
    own = tuple(labels) or tuple(m.rpartition(".")[2] for m in members)
    return Family(name, tuple(members), own, shown(unit), units.factor(unit, kind))


def _attitude() -> Family:
    members = tuple(f"attitude.{a}" for a in AXES)
    labels = tuple(f"about {a}" for a in AXES)
    return Family("attitude", members, labels, "arcsec", units.factor("arcsec", "angle"))


def residuals(result: Result) -> Section | None:
    """White residuals against time."""
    table = result.tables.get("residuals")
    if table is None or "x" not in table or not len(table["x"]):
        return None
    time = np.asarray(table["time"], float)
    white = {a: np.asarray(table[a], float) for a in AXES}
    every = np.concatenate(list(white.values()))
    beyond, expected = int(np.sum(np.abs(every) > GUIDE)), 0.0027 * len(every)
    averaged = result.diagnostics.get("averaged")
    lead = (
        "What the model leaves unexplained, over the standard deviation it should have; white "
        f"where model and noise are right. Dashed: {GUIDE:.0f} sd; of {len(every)} residuals "
        f"{beyond} lie outside, where {expected:.0f} would by chance. "
        + (f"Each is a mean over {averaged:.3g} s. " if averaged else "")
        + "Drawn: those outside and an even choice of the others."
    )
    blocks: list[Block] = [figures_tumble.residuals(time, white, _legs(result))]
    chi = (result.diagnostics.get("chi_square") or {}).get("accel")
    if chi:
        items = [chi_square_words("Readings of the accelerometers", chi)]
        names = {f"accelerometer {a}" for a in AXES} | OF_RESIDUALS
        items += [("good" if c.passed else "warning", c.sentence)
                  for c in result.checks if c.name in names]  # fmt: skip
        blocks.append(Items(items))
    return Section("Residuals", lead, blocks)


# -- sensitivity -----------------------------------------------------------------------------


def sensitivity(result: Result) -> Section | None:
    """How the readings change with each coefficient along the motion."""
    table = result.tables.get("sensitivity")
    if table is None or "x.gyro.drift.x" not in table:
        return None
    legs = _legs(result)
    blocks: list[Block] = [
        figures_tumble.sensitivity(title, table, some, legs) for title, some in _four()
    ]
    start = tuple(START)
    arcsec = units.factor("arcsec", "angle")
    attitude = Family("attitude at the start", start, ("east", "north", "up"), "arcsec", arcsec)
    blocks.append(figures_tumble.explorer(table, [*families(), attitude], legs))
    lead = (
        "How much the readings of the accelerometers x, y and z, one panel each, change with one "
        "unit of a coefficient, along this motion; those that answer. Curves of a different shape "
        "can be told apart; a coefficient whose curve is flat at zero is not seen. Below them any "
        "family of your choice."
    )
    return Section("Sensitivity", lead, blocks)


def _four() -> list[tuple[str, list[Family]]]:
    """The four pictures that say most: gyro drift, one gyro, its axes, one accelerometer."""
    first = [f"gyro.{word}.x" for word in DRIFTS[1:4]]
    axes = ["gyro.misalignment.xy", "gyro.misalignment.xz"]
    y = [f"accel.{w}.y" for w in ("bias", "scale", "quadratic")]
    own = [(n, n.split(".")[1]) for n in y] + [("accel.misalignment.yx", "yx")]
    return [
        ("Drift of the gyros [µg per °/h]", [_family("drift", [f"gyro.drift.{a}" for a in AXES])]),
        (
            "X gyro, drift per g [µg per °/h/g]",
            [_family("first", first, ("input", "output", "spin"))],
        ),
        ("X gyro, misalignments [µg per arcsec]", [_family("axes", axes)]),
        (
            "Y accelerometer [µg per µg, ppm, µg/g², arcsec]",
            [_family(label, [name], [label]) for name, label in own],
        ),
    ]
