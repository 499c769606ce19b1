"""What the page of a search for north says of one set-up."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from foucault import units
from foucault.coefficients import format_value
from foucault.report import ends, figures, figures_north
from foucault.report.ends import check_table
from foucault.report.evidence import RESIDUAL_LIMIT
from foucault.report.figures_north import Needle
from foucault.report.page import Block, Column, Section, Table, Text
from foucault.report.uncertainty import shown
from foucault.result import Check, Level
from foucault.units import plain

if TYPE_CHECKING:
    from foucault.campaign.north.folder import NorthRecord

ANGLES = ("heading", "pitch", "roll", "latitude")
SENSORS = {"gyro": ("angular rate", "gyro"), "accel": ("specific force", "accelerometer")}
UNRESOLVED = "sign of the vertical rate"
"""Source that covers both roots; no better instrument helps against it."""

NOTHING = 1e-3
"""What a source gives, over the largest, for it to be left out of the budget [1]."""

ALIKE = 3
"""Findings of one kind that are written out [1]."""

SOURCES = {
    "gyro noise": "white noise of the gyro over the dwells",
    "gyro drift": "slow noise of the gyro, and what is not known of its linear drift",
    "gyro offset": "what is not known of the constant offset of the gyro",
    "tilt: noise": "white noise of the accelerometers",
    "tilt: drift": "slow noise of the accelerometers",
    "tilt: calibration": "coefficients of the accelerometers",
    "tilt: level": "how well the case was levelled",
    "indexing": "index angles of the base",
    "calibration: bias": "bias of the gyro that turns with the base",
    "scale factor": "scale factors of the gyro",
    "coupling": "cross-coupling of the gyro",
    "calibration: correlation": "coefficients that the calibration tells apart badly",
    "latitude": "latitude as given",
    UNRESOLVED: "neither sign of the rate along the axis of the base can be excluded",
}
"""What each source of the budget is."""


@dataclass(frozen=True)
class Unit:
    """A unit of angle for uncertainties, and its size [deg]."""

    name: str
    size: float

    def words(self, degrees: float) -> str:
        """Write an angle [deg] to two digits."""
        return f"{plain(degrees / self.size, 2)} {shown(self.name)}".replace(" °", "°")


def angle_unit(degrees: float) -> Unit:
    """Return the unit people would read an uncertainty of so many degrees in."""
    unit = units.display_unit("angle", math.radians(degrees) if math.isfinite(degrees) else 0.0)
    return Unit(unit, math.degrees(units.factor(unit, "angle")))


def listed(names: Sequence[str], most: int = 6) -> str:
    """Write names, the first few of many."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def signed(text: str) -> str:
    """Write a minus sign as such."""
    return text.replace("-", "−")


def common(setups: Sequence[Setup]) -> list[str]:
    """Return why none of several set-ups passed, where it is the same for all: it is said once."""
    if len(setups) < 2:
        return []
    return [r for r in setups[0].said["reasons"] if all(r in s.said["reasons"] for s in setups)]


def own(setup: Setup, common: Sequence[str]) -> str:
    """Return what is to know of a set-up beside what is common to all."""
    text = str(setup.said["warnings"])
    for reason in common:
        text = text.replace(reason, "")
    return " ".join(text.split())


@dataclass(frozen=True)
class Setup:
    """One set-up of a record."""

    record: NorthRecord
    number: int

    @property
    def about(self) -> Mapping[str, Any]:
        """What is known of the whole file."""
        return self.record.about

    @property
    def said(self) -> Mapping[str, Any]:
        """What north.json says of it."""
        row: Mapping[str, Any] = self.about["setups"][self.number]
        return row

    @property
    def name(self) -> str:
        """Of the set-up."""
        return str(self.said["name"])

    @cached_property
    def dwells(self) -> dict[str, npt.NDArray[Any]]:
        """Its readings, column by column."""
        mine = self.record.dwells["setup"] == self.number
        return {name: column[mine] for name, column in self.record.dwells.items()}

    def degrees(self, angle: str, key: str = "value") -> float:
        """Return value, sd or bound of an angle [deg]."""
        return _degrees(self.said[angle][key])

    def text(self, angle: str) -> str:
        """Write an angle in degrees to the second digit of its uncertainty."""
        value, sd = self.degrees(angle), self.degrees(angle, "sd")
        if not np.isfinite(value):
            return "unknown"
        # A latitude that is given exactly has an sd of rounding only.
        sd = sd if sd > 1e-6 else 1e-3
        text = format_value(value, sd)
        if angle == "heading" and float(text) >= 360.0:  # rounded up to north
            text = format_value(0.0, sd)
        return signed(text if float(text) else text.lstrip("-"))

    def text_sd(self, angle: str) -> str:
        """Write its uncertainty with as many decimals; nothing where it is given exactly."""
        sd = self.degrees(angle, "sd")
        return format_value(sd, sd) if np.isfinite(sd) and sd > 1e-6 else ""

    @property
    def reference(self) -> float | None:
        """Its heading by another reference [deg]."""
        value = self.said["reference_heading"]
        return None if value is None else _degrees(value)

    @property
    def other(self) -> float | None:
        """The heading of the next best solution [deg]."""
        value = self.said["other"]["heading"]
        return None if value is None else _degrees(value)

    @property
    def minus_reference(self) -> str:
        """Write the heading minus its reference, between -180 and 180 degrees."""
        if self.reference is None or not np.isfinite(self.degrees("heading")):
            return ""
        off = (self.degrees("heading") - self.reference + 180) % 360 - 180
        text = format_value(off, self.degrees("heading", "sd"))
        return signed(text if float(text) else text.lstrip("-"))

    @property
    def needle(self) -> Needle:
        """Itself on the compass rose."""
        sd = self.degrees("heading", "sd")
        return Needle(self.name, self.degrees("heading"), sd, str(self.said["verdict"]))

    @cached_property
    def budget(self) -> dict[str, float]:
        """Standard deviation of the heading by source, the largest first [deg]."""
        found = {k: _degrees(v["heading"]) for k, v in self.said["budget"].items()}
        top = max((abs(v) for v in found.values() if np.isfinite(v)), default=0.0)
        kept = {k: v for k, v in found.items() if abs(v) > NOTHING * top}
        return dict(sorted(kept.items(), key=lambda item: -abs(item[1])))

    def share(self, source: str) -> float:
        """Return the share of a source in the variance of the heading."""
        sd = self.budget.get(source, 0.0)
        total = sum(v * abs(v) for v in self.budget.values())
        return sd * abs(sd) / total if total > 0 else 0.0


def _degrees(value: float | None) -> float:
    return math.nan if value is None else math.degrees(value)


def _sexagesimal(degrees: float, sd: float) -> str:
    """Write degrees, minutes and seconds as far as the uncertainty goes."""
    decimals = 0 if not 0 < sd < 1 / 3600 else min(3, 1 - math.floor(math.log10(3600 * sd)))
    size = 10**decimals
    units_ = round(abs(degrees) * 3600 * size)
    seconds, whole = units_ % (60 * size) / size, units_ // (60 * size)
    width = 2 if not decimals else 3 + decimals
    text = f"{whole // 60}° {whole % 60:02d}′ {seconds:0{width}.{decimals}f}″"
    return f"−{text}" if degrees < 0 else text


# -- one set-up ----------------------------------------------------------------------------


def angles(setup: Setup) -> Table:
    """All angles with their uncertainty."""
    rows = []
    other = setup.said["other"] if setup.said["ambiguous"] else None
    for angle in ANGLES:
        value, sd = setup.degrees(angle), setup.degrees(angle, "sd")
        bound = setup.degrees(angle, "bound")
        given = angle == "latitude" and not sd > 1e-6
        unit = angle_unit(bound if not np.isfinite(sd) else sd)
        cells = [angle + " (given)" * given, setup.text(angle), setup.text_sd(angle)]
        cells.append("" if not cells[2] else format_value(2 * sd, sd))
        known = np.isfinite(bound) and bound > 1e-6 and not given
        cells.append(unit.words(bound) if known else "")
        cells.append(_sexagesimal(value, max(sd, 1e-4)) if np.isfinite(value) else "")
        if other is not None:
            cells.append("" if other[angle] is None else signed(f"{_degrees(other[angle]):.4f}"))
        rows.append(cells)
    if setup.reference is not None:
        off = setup.minus_reference
        blank = [""] * (len(rows[0]) - 2)
        rows.append(["heading minus reference", off, *blank])
    columns = [
        Column("angle", "short"), Column("value [°]", "number"), Column("± sd [°]", "number"),
        Column("± U (k=2) [°]", "number", aside=True), Column("bound of sd", "number", aside=True),
        Column("° ′ ″", "number", aside=True),
    ]  # fmt: skip
    columns += [Column("other solution [°]", "number")] * (other is not None)
    return Table(columns, rows)


def fit(setup: Setup) -> Section | None:
    """Readings over the index angle on the cosine that is the Earth's rate, and gravity."""
    d = setup.dwells
    blocks: list[Block] = []
    both = "accel_constant" in d
    for sensor, (kind, what) in SENSORS.items():
        if f"{sensor}_constant" not in d:
            continue
        pair = setup.said["rate" if sensor == "gyro" else "specific_force"]
        if pair["x"] is None or pair["y"] is None:
            continue
        y = d[sensor] - d[f"{sensor}_constant"]
        fitted = pair["x"] * d["sine"] + pair["y"] * d["cosine"]
        unit = units.display_unit(kind, float(np.max(np.abs(y), initial=0.0)))
        size = units.factor(unit, kind)
        angle = np.linspace(0, 2 * np.pi, 121)
        curve = pair["x"] * np.sin(angle) + pair["y"] * np.cos(angle)
        blocks.append(
            figures_north.fit(
                np.degrees(d["index"]) % 360, y / size, fitted / size, d[f"{sensor}_sd"] / size,
                (np.degrees(angle), curve / size), what, shown(unit), share=50 if both else 100,
            )
        )  # fmt: skip
    if not blocks:
        return None
    lead = (
        "Readings without the constant offset and drift of the sensor, against the index angle. "
        "The horizontal part of the Earth's rate turns with the base as a cosine: where it peaks "
        "is north"
    )
    lead += "; of specific force, where it peaks is uphill." if both else "."
    return Section("Fit over the index angle", lead + " Below: what the fit leaves.", blocks)


def residuals(setup: Setup) -> Section | None:
    """Residuals over their sd in the order of time."""
    d = setup.dwells
    blocks: list[Block] = []
    middle = d["start"] + d["time"] / 2 - setup.said["start"]
    for column, sensor in (("residual", "gyro"), ("accel_residual", "accel")):
        if column in d and np.isfinite(d[column]).any():
            ones = np.ones(len(middle))
            what = SENSORS[sensor][1]
            figure = figures.residuals(middle, d[column], ones, what, RESIDUAL_LIMIT)
            blocks.append(figure)
    if not blocks:
        return None
    lead = (
        "What the fit leaves over the standard deviation it should have, in the order of time; "
        f"dashed: {RESIDUAL_LIMIT:.0f} sd. A slope or a curve is drift."
    )
    return Section("Residuals", lead, blocks)


def budget(setup: Setup) -> Section | None:
    """Where the uncertainty of the heading comes from."""
    if not setup.budget:
        return None
    unit = angle_unit(setup.degrees("heading", "sd"))
    sd = np.array(list(setup.budget.values())) / unit.size
    share = np.array([setup.share(name) for name in setup.budget])
    names = list(setup.budget)
    rows = [
        [name, signed(plain(value, 2)), f"{100 * part:.1f} %", SOURCES.get(name, "")]
        for name, value, part in zip(names, sd, share, strict=True)
    ]
    columns = [
        Column("source"), Column(f"sd [{shown(unit.name)}]", "number"),
        Column("share", "number"), Column("what it is", aside=True),
    ]  # fmt: skip
    blocks: list[Block] = [figures_north.budget(names, sd, share, shown(unit.name))]
    blocks += [Table(columns, [[r[0], r[1], signed(r[2]), r[3]] for r in rows])]
    blocks.append(Text(twice(setup)))
    lead = "Standard deviation of the heading that each source alone would give."
    return Section("Uncertainty budget", lead, blocks)


def twice(setup: Setup) -> str:
    """Say what must change for half the standard deviation."""
    source, sd = next(iter(setup.budget.items()))
    if source == UNRESOLVED:
        return "To be surer, give the latitude, even roughly: it tells the two headings apart."
    share = setup.share(source)
    unit = angle_unit(sd)
    if share > 0.75:  # the others may stay as they are
        less = sd * math.sqrt(1 - 0.75 / share)
        fewer = angle_unit(less).words(less) if less > 0.02 * sd else "next to nothing"
        text = f"To be twice as good, `{source}` must come down from {unit.words(sd)} to {fewer}"
        if source.endswith("noise") and less > 0.1 * sd:
            times = (sd / less) ** 2
            text += f": measure {times:.2g} times as long, or take a sensor with less noise"
        return text + "."
    rest = list(setup.budget)[1:3]
    also = f" together with `{'` and `'.join(rest)}`" if rest else ""
    return (
        f"To be twice as good it is not enough to lessen one source: `{source}`, the largest, has "
        f"{100 * share:.0f} % of the variance and must come down{also}."
    )


def checks(setup: Setup) -> Section | None:
    """Every test that the verdict rests on."""
    rows = [check_of(c) for c in setup.said["checks"]]
    if not rows:
        return None
    return Section("Checks", "Every test that the verdict rests on.", [check_table(tuple(rows))])


def check_of(said: Mapping[str, Any]) -> Check:
    """Return a check of a document."""
    value = math.nan if said["value"] is None else float(said["value"])
    return Check(**(dict(said) | {"value": value, "fails": Level(said["fails"])}))


def grouped(findings: Sequence[Mapping[str, str]]) -> list[Mapping[str, str]]:
    """Return findings, of many of one kind the first few and how many there are."""
    out: list[Mapping[str, str]] = []
    for code in dict.fromkeys(f["code"] for f in findings):
        mine = [f for f in findings if f["code"] == code]
        out += mine[:ALIKE]
        if len(mine) > ALIKE:
            more = f"The same in {len(mine) - ALIKE} more set-ups."
            out[-1] = dict(out[-1]) | {"cure": f"{out[-1]['cure']} {more}"}
    return out


def findings(setup: Setup) -> Section | None:
    """What was noticed of the set-up."""
    return ends.findings(grouped(setup.said["findings"]), "readings", "Findings of the set-up")
