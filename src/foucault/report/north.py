"""The page of a search for north: where it is, how sure, and what would make it surer."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from foucault.coefficients import format_value
from foucault.errors import listed
from foucault.models.imu import LAYOUT
from foucault.models.norths import North
from foucault.report import chart, page
from foucault.report.chart import (
    BAD,
    FAINT,
    FIRST,
    SECOND,
    SOFT,
    THIRD,
    WARNING,
    Panel,
    Trace,
    area,
    axis,
    bars,
    dots,
    draw,
    line,
    numbers,
    whiskers,
)
from foucault.report.evidence import RESIDUAL_LIMIT
from foucault.report.headings import from_each_north
from foucault.report.page import (
    STATES,
    WORDS,
    Document,
    Figure,
    Heading,
    Section,
    Table,
    Text,
    angle,
    angle_unit,
    facts,
    grouped,
    known_to,
    made_from,
    minus,
    quantity,
    said,
    section,
    table,
    told,
    unit_of,
)
from foucault.report.uncertainty import left_out_table
from foucault.result import Level
from foucault.units import plain

if TYPE_CHECKING:
    from foucault.run_folder import Record

NAMED = 6  # Set-ups that the verdict names.
LISTED = 500  # Set-ups in the table of the page; the others are in fixes.csv [1].
NEEDLES = 360  # Needles on the compass rose [1].
STACKED = 20  # Set-ups whose budgets are drawn side by side [1].
DETAILED = 3  # Set-ups shown in detail, where there are more [1].
SHORT_NAME = 20  # Letters that a name of a set-up may have to stay on one line [1].
MOST_ROWS = 40  # Dwells that are listed [1].
LARGEST = 5  # Sources that are drawn one by one beside others [1].
LEVELS = ("unusable", "doubtful", "pass")  # Verdicts, worst first.

ANGLES = ("heading", "pitch", "roll", "latitude")
SENSORS = {
    "gyro": ("angular rate", "gyro", "angle random walk"),
    "accel": ("specific force", "accelerometer", "velocity random walk"),
}
"""What each says, what it is called, and of what kind its white noise is."""

FOUND = 0.9
"""A latitude whose sd is larger than this over what it was before is that which was given [1]."""

UNRESOLVED = "sign of the vertical rate"
"""Source that covers both roots; no better instrument helps against it."""

NOTHING = 1e-3  # What a source gives, over the largest, for it to be left out of the budget [1].

MARKS = {"pass": (FIRST, "circle"), "doubtful": (WARNING, "diamond"), "unusable": (BAD, "x")}
"""Colour and symbol of a verdict."""

POINTS = ("N", "30°", "60°", "E", "120°", "150°", "S", "210°", "240°", "W", "300°", "330°")

WEDGE = 2.0
"""Half-width that the wedge of two standard deviations gets at least on the compass rose [deg]."""


# -- a set-up --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Setup:
    """One set-up of a record."""

    record: Record
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
    def dwells(self) -> dict[str, Any]:
        """Its readings, column by column."""
        mine = self.record.tables["dwells"]["setup"] == self.number
        return {name: column[mine] for name, column in self.record.tables["dwells"].items()}

    def degrees(self, angle: str, key: str = "value") -> float:
        """Return value, sd or bound of an angle [deg]."""
        return _degrees(self.said[angle][key])

    @property
    def sure(self) -> bool:
        """Whether its heading is known with an uncertainty."""
        return bool(np.isfinite(self.degrees("heading") + self.degrees("heading", "sd")))

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
        return page.unsigned(text)

    def text_sd(self, angle: str) -> str:
        """Write its uncertainty with as many decimals; nothing where it is given exactly."""
        sd = self.degrees(angle, "sd")
        return format_value(sd, sd) if np.isfinite(sd) and sd > 1e-6 else ""

    @property
    def latitude_found(self) -> bool:
        """Whether the readings say more of the latitude than what was known before."""
        known, sd = self.about["known"]["latitude_sd"], self.degrees("latitude", "sd")
        before = _degrees(known[self.number] if isinstance(known, list) else known)
        unknown = self.about["known"]["latitude"] is None
        return unknown or (sd > 1e-6 and not sd > FOUND * before)

    @property
    def reference(self) -> float | None:
        """Its heading by another reference [deg]."""
        value = self.said["reference_heading"]
        return None if value is None else _degrees(value)

    @property
    def other(self) -> float | None:
        """The heading of the next best solution, where it could be that [deg]."""
        value = self.said["other"]["heading"]
        return None if value is None or not self.said["ambiguous"] else _degrees(value)

    @property
    def minus_reference(self) -> str:
        """Write the heading minus its reference, between -180 and 180 degrees."""
        if self.reference is None or not np.isfinite(self.degrees("heading")):
            return ""
        off = (self.degrees("heading") - self.reference + 180) % 360 - 180
        return page.unsigned(format_value(off, self.degrees("heading", "sd")))

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


# -- the document ----------------------------------------------------------------------------


def document(record: Record) -> Document:
    """Return what there is to say of a search for north."""
    about = record.about
    setups = [Setup(record, i) for i in range(len(about["setups"]))]
    noticed = page.findings(grouped(about["findings"]), "readings")
    if len(setups) == 1:
        one = setups[0]
        parts = _parts(one)
        first = [where(one), _norths(setups)]
        head, made = _one_heading(one), [*first, *parts[:-1], noticed, parts[-1]]
    else:
        rank = {level: k for k, level in enumerate(LEVELS)}
        order = sorted(
            setups,
            key=lambda s: (
                rank[s.said["verdict"]],
                -np.nan_to_num(s.degrees("heading", "sd"), nan=np.inf),
            ),
        )
        made = [_table(setups, order), _norths(setups), _roses(setups), _budgets(order), noticed]
        head, made = _many_heading(record, setups), [*made, *map(_detail, order[:DETAILED])]
    files = {"input": "readings", "calibration": ""}
    made.append(_not_estimated(about))
    return Document.of(head, made, _known(about), _calibration(about), made_from(about, files))


def _parts(setup: Setup) -> list[Section | None]:
    """What is said of one set-up."""
    noticed = grouped(setup.said["findings"])
    return [
        fit(setup),
        residuals(setup),
        budget(setup),
        page.checks(setup.said["checks"]),
        page.findings(noticed, "readings", "Findings of the set-up"),
        measured(setup),
    ]


def _line(about: Mapping[str, Any]) -> list[str]:
    """Instrument, place and date in a few words."""
    several = isinstance(about["known"]["latitude"], list)
    return page.origin(about, "several latitudes" if several else None)


def _one_heading(setup: Setup) -> Heading:
    value, sd = setup.degrees("heading"), setup.degrees("heading", "sd")
    level, title, line_ = Level(setup.said["verdict"]), "No heading", [setup.name]
    if setup.sure:
        title = f"Heading {format_value(value, sd)}° ± {format_value(2 * sd, sd)}°"
        line_.append("±2 standard deviations")
    reasons = list(setup.said["reasons"])
    reasons = reasons or [f"All {len(setup.said['checks'])} checks passed."]
    return Heading(title, [*line_, *_line(setup.about)], STATES[level], WORDS[level], reasons)


def _many_heading(record: Record, setups: Sequence[Setup]) -> Heading:
    named = {v: [s.name for s in setups if s.said["verdict"] == v] for v in LEVELS}
    every = record.about.get("of")
    counts = every["verdicts"] if every else {v: len(names) for v, names in named.items()}
    count = every["setups"] if every else len(setups)
    worst = next((v for v in LEVELS if counts.get(v)), "pass")
    passed = counts.get("pass", 0)
    word = "All pass" if passed == count else f"{passed} of {count} pass"
    reasons = [f"{WORDS[Level(v)]}: {listed(named[v], NAMED)}." for v in LEVELS[:2] if named[v]]
    reasons += common(setups)
    sd = np.array([s.degrees("heading", "sd") for s in setups])
    sd = np.degrees(every["heading_sd"]) if every else sd
    if np.isfinite(sd).any():
        ends = dict.fromkeys((angle(np.nanmin(sd)), angle(np.nanmax(sd))))
        reasons.append(f"Standard deviation of the headings: {' to '.join(ends)}.")
    title = f"North at {count} set-ups"
    return Heading(title, _line(record.about), STATES[Level(worst)], word, reasons)


def where(setup: Setup) -> Section | None:
    """The compass rose, the rose magnified, and the angles."""
    drawn = []
    if setup.sure:
        drawn.append(rose([setup], setup.other, setup.reference))
        if setup.degrees("heading", "sd") < 30:
            drawn.append(_strip(setup))
    return section("north.where", drawn, angles(setup))


def _not_estimated(about: Mapping[str, Any]) -> Section | None:
    """Return what is left out, and what it makes of the headings; nothing of older folders."""
    some = about.get("not_estimated")
    if not some:
        return None
    columns = {name: np.array(column, object) for name, column in some.items()}
    columns["needed"] = np.array([math.inf if v is None else v for v in some["needed"]])
    return section("north.not_estimated", left_out_table(columns))


def _norths(setups: Sequence[Setup]) -> Section | None:
    """Return the heading of every set-up from every north that [site] names."""
    known = [North(**north) for north in setups[0].about.get("norths", ())]
    some = [s for s in setups if s.sure][:LISTED]
    each = [(s.name, s.said["heading"]["value"], s.said["heading"]["sd"]) for s in some]
    return from_each_north("set-up", each, known)


# -- many set-ups ----------------------------------------------------------------------------


def _table(setups: list[Setup], order: list[Setup]) -> Section | None:
    some, key, lead = setups, "north.headings", None
    if len(setups) > LISTED:
        some = order[:LISTED]
        every = setups[0].about.get("of", {}).get("setups")
        more = said(f"{key}.kept", kept=len(setups)) if every else ""
        file = "fixes.parquet" if every else "fixes.csv"
        lead = said(f"{key}.worst", listed=LISTED, count=every or len(setups), file=file) + more
    estimated = not isinstance(setups[0].about["known"]["latitude"], float) or any(
        s.latitude_found for s in setups
    )
    reference = any(s.reference is not None for s in setups)
    look = "short" if max(len(s.name) for s in some) <= SHORT_NAME else "text"
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = [
            np.float64(s.degrees("heading", "sd")) / s.degrees("heading", "bound") for s in some
        ]
    known = common(setups)
    return section(
        key,
        table(
            (": state", [STATES[Level(s.said["verdict"])] for s in some]),
            (f"set‑up: {look}", [s.name for s in some]),
            ("heading [°]: number", [s.text("heading") for s in some]),
            ("± sd [°]: number", [s.text_sd("heading") for s in some]),
            ("sd / bound: number aside", [f"{r:.2f}" if np.isfinite(r) else "" for r in ratio]),
            (
                "minus reference [°]: number",
                [s.minus_reference for s in some] if reference else None,
            ),
            ("pitch [°]: number aside", [s.text("pitch") for s in some]),
            ("roll [°]: number aside", [s.text("roll") for s in some]),
            (
                "latitude [°]: number aside",
                [s.text("latitude") for s in some] if estimated else None,
            ),
            (
                "± sd [°]: number aside",
                [s.text_sd("latitude") for s in some] if estimated else None,
            ),
            ("what to know: aside", [own(s, known) for s in some]),
        ),
        lead=lead,
    )


def _roses(setups: list[Setup]) -> Section | None:
    known = [s for s in setups if s.sure]
    return section("north.roses", [rose(known[:NEEDLES]), _against_bound(known)] if known else None)


def _budgets(order: list[Setup]) -> Section | None:
    some, key = [s for s in order if s.budget][:STACKED], "north.budgets"
    names = list(dict.fromkeys(name for s in some for name in s.budget))
    if len(names) < 2:
        one = said(f"{key}.one", source=names[0]) if names else ""
        return Section(told(f"{key}.title"), one, []) if names else None
    share = {n: np.array([100 * s.share(n) for s in some]) for n in names}
    sizes = sorted(share, key=lambda n: -float(np.nanmean(share[n])))
    drawn = {n: share[n] for n in sizes}
    if len(sizes) > LARGEST + 1:
        rest = np.sum([share[n] for n in sizes[LARGEST:]], axis=0)
        drawn = {n: share[n] for n in sizes[:LARGEST]} | {"others": rest}
    figure = chart.shares(
        [s.name for s in some], drawn, "Share of every source in the variance of every heading"
    )
    lead = None if len(some) == len(order) else said(f"{key}.some", count=len(some))
    return section(key, figure, lead=lead)


def _detail(setup: Setup) -> Section:
    """One set-up in one section."""
    blocks: list[Any] = [angles(setup)]
    for part in _parts(setup):
        if part is not None:
            blocks += [Text(part.lead)] * bool(part.lead) + list(part.blocks)
    return Section(f"Set-up {setup.name}", setup.said["warnings"], blocks)


# -- one set-up ------------------------------------------------------------------------------


def angles(setup: Setup) -> Table:
    """All angles with their uncertainty."""
    value, sd, bound = ([setup.degrees(a, k) for a in ANGLES] for k in ("value", "sd", "bound"))
    given = [a == "latitude" and not setup.latitude_found for a in ANGLES]
    off = ["heading minus reference"] if setup.reference is not None else []
    blank = [""] * len(off)
    other = setup.said["other"] if setup.said["ambiguous"] else None
    texts = [setup.text_sd(a) for a in ANGLES]
    limits = [
        angle(b) if np.isfinite(b) and b > 1e-6 and not g else ""
        for b, g in zip(bound, given, strict=True)
    ]
    places = [
        _sexagesimal(v, max(s, 1e-4)) if np.isfinite(v) else ""
        for v, s in zip(value, sd, strict=True)
    ]
    others = None
    if other is not None:
        others = ["" if other[a] is None else minus(f"{_degrees(other[a]):.4f}") for a in ANGLES]
        others += blank
    return table(
        ("angle: short", [a + " (given)" * g for a, g in zip(ANGLES, given, strict=True)] + off),
        ("value [°]: number", [*map(setup.text, ANGLES), *([setup.minus_reference] * len(off))]),
        ("± sd [°]: number", texts + blank),
        (
            "± U (k=2) [°]: number aside",
            [format_value(2 * s, s) if t else "" for s, t in zip(sd, texts, strict=True)] + blank,
        ),
        ("bound of sd: number aside", limits + blank),
        ("° ′ ″: number aside", places + blank),
        ("other solution [°]: number", others),
    )


def _sexagesimal(degrees: float, sd: float) -> str:
    """Write degrees, minutes and seconds as far as the uncertainty goes."""
    decimals = 0 if not 0 < sd < 1 / 3600 else min(3, 1 - math.floor(math.log10(3600 * sd)))
    size = 10**decimals
    units_ = round(abs(degrees) * 3600 * size)
    seconds, whole = units_ % (60 * size) / size, units_ // (60 * size)
    width = 2 if not decimals else 3 + decimals
    text = f"{whole // 60}° {whole % 60:02d}′ {seconds:0{width}.{decimals}f}″"
    return f"−{text}" if degrees < 0 else text


def fit(setup: Setup) -> Section | None:
    """Readings over the index angle on the cosine that is the Earth's rate, and gravity."""
    d, drawn = setup.dwells, []
    both = "accel_constant" in d
    for sensor, (kind, what, _) in SENSORS.items():
        if f"{sensor}_constant" not in d:
            continue
        pair = setup.said["rate" if sensor == "gyro" else "specific_force"]
        if pair["x"] is not None and pair["y"] is not None:
            drawn.append(_fit(d, sensor, kind, what, pair, 50 if both else 100))
    return section("north.fit", drawn, lead=told("north.fit.both") if both else None)


def _fit(
    d: Mapping[str, Any], sensor: str, kind: str, what: str, pair: Mapping[str, float], share: int
) -> Figure:
    """Draw readings on the curve, and below what it leaves."""
    y = d[sensor] - d[f"{sensor}_constant"]
    unit, one = unit_of(kind, y)
    left = (y - pair["x"] * d["sine"] - pair["y"] * d["cosine"]) / one
    index = np.degrees(d["index"]) % 360
    order, few = np.argsort(index, kind="stable"), len(index) <= 40
    t = np.linspace(0, 2 * np.pi, 121)
    curve = (pair["x"] * np.sin(t) + pair["y"] * np.cos(t)) / one
    look: dict[str, Any] = {
        "size": 8 if few else 5,
        "hover": f"%{{x:.1f}}°: %{{y:.5g}} {unit}|",
        "error_y": whiskers(2 * (d[f"{sensor}_sd"] / one)[order], FIRST, 3 if few else 0),
    }
    name = f"{what} ±2 sd"
    panels = [
        Panel(
            f"{what} [{unit}]",
            [
                line("fit", np.degrees(t), curve, SECOND),
                dots(name, index[order], (y / one)[order], **look),
            ],
            lines=[0],
        ),
        Panel(
            f"reading − fit [{unit}]", [dots(name, index[order], left[order], **look)], lines=[0]
        ),
    ]
    circle = axis("index angle [°]", range=[-8, 368], tick0=0, dtick=90)
    alt = f"{what} against the index angle with the cosine fitted, and what it leaves"
    return chart.stacked("north.fit", panels, x=circle, share=share, alt=alt)


def residuals(setup: Setup) -> Section | None:
    """Residuals over their sd in the order of time."""
    d = setup.dwells
    middle = d["start"] + d["time"] / 2 - setup.said["start"]
    drawn = [
        chart.residuals(middle, d[column], np.ones(len(middle)), SENSORS[sensor][1], RESIDUAL_LIMIT)
        for column, sensor in (("residual", "gyro"), ("accel_residual", "accel"))
        if column in d and np.isfinite(d[column]).any()
    ]
    return section("north.residuals", drawn, limit=RESIDUAL_LIMIT)


def budget(setup: Setup) -> Section | None:
    """Where the uncertainty of the heading comes from."""
    if not setup.budget:
        return None
    unit, one = angle_unit(setup.degrees("heading", "sd"))
    names = list(setup.budget)
    sd = np.array(list(setup.budget.values())) / one
    share = [setup.share(name) for name in names]
    rows = table(
        ("source", names),
        (f"sd [{unit}]: number", [minus(plain(v, 2)) for v in sd]),
        ("share: number", [minus(f"{100 * v:.1f} %") for v in share]),
        ("what it is: aside", [_of_source(setup, name) for name in names]),
    )
    label = [f"{100 * v:.0f} %" if abs(v) >= 0.01 else "< 1 %" for v in share]
    data = bars(
        "",
        sd,
        names,
        [FIRST if v >= 0 else SECOND for v in sd],
        f"%{{y}}: %{{x:.3g}} {unit}, %{{text}}|",
        orientation="h",
        text=label,
        textposition="outside",
        cliponaxis=False,
    )
    top = float(np.max(np.abs(sd), initial=0.0)) or 1.0
    low = min(0.0, 1.25 * float(np.min(sd, initial=0.0)))
    figure = draw(
        "north.budget",
        [data],
        height=76 + 27 * len(names),
        x=axis(f"sd of the heading from it alone [{unit}]", range=[low, 1.16 * top]),
    )
    return section("north.budget", figure, rows, twice(setup))


def _of_source(setup: Setup, name: str) -> str:
    """Say what a source is; of terms that are not estimated their size, and what it rests on."""
    left = setup.about.get("not_estimated") or {"what": []}
    if name in left["what"]:
        k = left["what"].index(name)
        return f"not estimated, {left['size'][k]}: {left['basis'][k]}"
    return told(f"north.source.{name}")


def twice(setup: Setup) -> str:
    """Say what must change for half the standard deviation."""
    source, sd = next(iter(setup.budget.items()))
    if source == UNRESOLVED:
        return told("north.budget.unresolved")
    share = setup.share(source)
    if share > 0.75:  # the others may stay as they are
        less = sd * math.sqrt(1 - 0.75 / share)
        fewer = angle(less) if less > 0.02 * sd else "next to nothing"
        how = ""
        if source.endswith("noise") and less > 0.1 * sd:
            how = said("north.budget.longer", times=(sd / less) ** 2)
        return said("north.budget.one", source=source, sd=angle(sd), fewer=fewer, how=how)
    rest = list(setup.budget)[1:3]
    also = f" together with `{'` and `'.join(rest)}`" if rest else ""
    return said("north.budget.several", source=source, share=100 * share, also=also)


# -- the compass -----------------------------------------------------------------------------


def magnified(sd: float) -> int:
    """Return how many times wider a wedge of two `sd` [deg] is drawn, a power of ten."""
    return int(10 ** max(0, math.ceil(math.log10(WEDGE / (2 * sd))))) if sd > 0 else 1


def rose(
    setups: Sequence[Setup], other: float | None = None, reference: float | None = None
) -> Figure:
    """Draw headings [deg] on a compass; of one alone its wedge, other solution and reference."""
    data: list[Trace] = []
    alone = len(setups) == 1
    caption = told("north.roses.needles")
    if alone:
        heading, sd = setups[0].degrees("heading"), setups[0].degrees("heading", "sd")
        wider = magnified(sd)
        scale = f", drawn {f'{wider:,}'.replace(',', ' ')} times wider" if wider > 1 else ""
        caption = f"True north is up. Shaded: ±2 sd{scale}."
        half = min(2 * sd * wider, 180.0)
        arc = np.linspace(heading - half, heading + half, 41)
        data.append(
            _polar(area("±2 sd", [0, *np.ones(41).tolist(), 0], numbers([arc[0], *arc, arc[-1]])))
        )
        hover = "%{theta:.4f}°|"
        for name, place, colour, thick, dash in (
            ("reference", reference, THIRD, 2.5, "dot"),
            ("other solution", other, SOFT, 2.0, "dash"),
        ):
            if place is not None:
                data.append(
                    _polar(
                        line(
                            name,
                            [0.0, 1.0],
                            numbers([place, place]),
                            colour,
                            f"{hover}{name}",
                            width=thick,
                            dash=dash,
                        )
                    )
                )
    width = 4.0 if alone else 1.8
    for verdict, (colour, _) in MARKS.items():
        mine = [s for s in setups if s.said["verdict"] == verdict]
        if not mine:
            continue
        at = [s.degrees("heading") for s in mine]
        words = [
            f"{s.name}: {h:.4f}° ± {s.degrees('heading', 'sd'):.2g}°"
            for s, h in zip(mine, at, strict=True)
        ]
        marker: Trace = {
            "color": FIRST if alone else colour,
            "symbol": "arrow",
            "angleref": "previous",
            "size": 5 + 3 * width,
            "opacity": 1,
            "standoff": 0,
        }
        needles = line(
            "heading" if alone else verdict,
            [0.0, 1.0, None] * len(mine),
            [v for h in at for v in (*numbers([h, h]), None)],
            marker["color"],
            "%{customdata}|",
            width=width,
            mode="lines+markers",
            marker=marker,
            customdata=[v for word in words for v in (word, word, None)],
        )
        data.append(_polar(needles))
    ring = {
        "linecolor": FAINT,
        "gridcolor": "var(--line)",
        "direction": "clockwise",
        "rotation": 90,
        "tickvals": list(range(0, 360, 30)),
        "ticktext": list(POINTS),
        "tickfont": {"size": 14},
        "ticks": "outside",
        "tickcolor": FAINT,
    }
    polar = {
        "bgcolor": "rgba(0,0,0,0)",
        "radialaxis": {"visible": False, "range": [0, 1.04]},
        "angularaxis": ring,
    }
    said_ = ", ".join(f"{s.degrees('heading'):.2f}°" for s in setups[:6])
    return draw(
        "north.rose",
        data,
        polar=polar,
        showlegend=len(data) > 2 if alone else True,
        caption=caption,
        share=44 if alone else 50,
        alt=f"Compass rose, north on top; heading {said_}",
    )


def _polar(trace: Trace) -> Trace:
    """Return a trace on the compass, where x is the radius and y the heading [deg]."""
    return {"r": trace.pop("x"), "theta": trace.pop("y")} | trace | {"type": "scatterpolar"}


def _strip(setup: Setup) -> Figure:
    """Draw how sure a heading is: the rose magnified."""
    heading, sd = setup.degrees("heading"), setup.degrees("heading", "sd")
    bound, reference = setup.degrees("heading", "bound"), setup.reference
    unit, one = angle_unit(sd)
    x = np.linspace(-4, 4, 161)
    density, at, inside = np.exp(-(x**2) / 2), x * sd / one, np.abs(x) <= 2
    data = [
        area(
            "±2 sd",
            numbers([-2 * sd / one, *at[inside], 2 * sd / one]),
            numbers([0, *density[inside], 0]),
        ),
        line("heading", at, density, FIRST, width=2.5),
    ]
    if np.isfinite(bound) and bound:
        y = np.exp(-((at * one / bound) ** 2) / 2)
        data.append(line("bound of the noise alone", at, y, SECOND, width=1.6, dash="dash"))
    reach = 4 * sd / one
    if reference is not None:
        off = (reference - heading) / one
        reach = max(reach, 1.15 * abs(off))
        data.append(line("reference", [off, off], [0, 1.08], THIRD, width=2.5, dash="dot"))
    return draw(
        "north.strip",
        data,
        x=axis(f"from the heading [{unit}]", range=[-reach, reach], showgrid=True),
    )


def _against_bound(setups: Sequence[Setup]) -> Figure:
    """Draw the sd of every heading beside its bound."""
    sd, bound = (np.array([s.degrees("heading", k) for s in setups]) for k in ("sd", "bound"))
    unit, one = angle_unit(float(np.median(sd)))
    sd, bound = sd / one, bound / one
    n, names = np.arange(1, len(sd) + 1), [s.name for s in setups]
    hover = f"%{{customdata}}: %{{y:.3g}} {unit}|"
    data: list[Trace] = []
    for verdict, (colour, symbol) in MARKS.items():
        pick = np.array([s.said["verdict"] == verdict for s in setups])
        if pick.any():
            some = [name for name, p in zip(names, pick, strict=True) if p]
            data.append(
                dots(
                    f"sd, {verdict}",
                    n[pick],
                    sd[pick],
                    colour,
                    hover,
                    symbol=symbol,
                    customdata=some,
                )
            )
    data.append(
        dots(
            "bound of the noise alone",
            n,
            bound,
            SECOND,
            hover.replace(": ", ": bound ", 1),
            size=10,
            symbol="line-ew",
            marker={"line": {"color": SECOND, "width": 2}},
            customdata=names,
        )
    )
    every = np.concatenate([sd, bound])
    every = every[np.isfinite(every) & (every > 0)]
    wide = len(every) > 0 and every.max() > 20 * every.min()
    scale: dict[str, Any] = {"type": "log"} if wide else {"rangemode": "tozero"}
    count = axis("set-up", tick0=1, dtick=max(1, round(len(n) / 8)), range=[0.4, len(n) + 0.6])
    return draw(
        "north.against_bound", data, x=count, y=axis(f"sd of the heading [{unit}]", **scale)
    )


# -- how it was measured, and with what ------------------------------------------------------


def measured(setup: Setup) -> Section | None:
    """Stops, their order and how long they took."""
    d, told_ = setup.dwells, setup.said
    order = [f"{v:.4g}" for v in np.degrees(d["index"]) % 360]
    ends = dict.fromkeys((float(d["time"].min()), float(d["time"].max())))
    each = " to ".join(f"{plain(v, 4)}" for v in ends)
    few = len(order) <= MOST_ROWS
    fixed = "two, fixed to the case" if "accel_x" in d else "none"
    offset, moved = told_["gyro_offset"], told_["drift_effect"]
    effect = ""
    if moved is not None:
        degrees = abs(math.degrees(moved))
        effect = f"would move the heading by {angle(degrees) if degrees > 1e-7 else 'nothing'}"
    known = facts(
        ("dwells", f"{told_['dwells']} of {each} s"),
        (
            "measured",
            f"{plain(told_['measured'] / 60, 3)} min of {plain(told_['duration'] / 60, 3)}",
        ),
        ("order of the index angles", f"{', '.join(order)}°" if few else f"{order[0]}° and on"),
        ("accelerometers", "one, turning with the gyro" if "accel" in d else fixed),
        (
            "offset of the gyro",
            "" if offset is None else minus(f"{3600 * math.degrees(offset):.4g} °/h"),
        ),
        ("drift of the gyro", _drift(setup)),
        ("1 °/h/h of drift, if not estimated", effect),
    )
    return section("north.measured", known, _dwell_table(d) if few else None)


def _drift(setup: Setup) -> str:
    sd, value = setup.about["drift_sd"], setup.said["gyro_drift"]
    if sd == 0:
        return "not estimated"
    text = "" if value is None else minus(f"{3600**2 * math.degrees(value):.3g} °/h/h")
    return text if sd == "free" else f"{text}, weighed"


def _dwell_table(d: Mapping[str, Any]) -> Table:
    rate = zip(3600 * np.degrees(d["gyro"]), 3600 * np.degrees(d["gyro_sd"]), strict=True)

    def left(column: str) -> list[str]:
        return [minus(f"{v:+.2f}") if np.isfinite(v) else "not tested" for v in d[column]]

    return table(
        ("index [°]: number", [f"{v:.2f}" for v in np.degrees(d["index"]) % 360]),
        ("start [s]: number", [f"{v:.1f}" for v in d["start"]]),
        ("length [s]: number aside", [f"{v:.4g}" for v in d["time"]]),
        ("gyro [°/h]: number", [known_to(v, sd) for v, sd in rate]),
        ("residual / sd: number", left("residual")),
        (
            "accelerometer residual / sd: number aside",
            left("accel_residual") if "accel_residual" in d else None,
        ),
    )


def _known(about: Mapping[str, Any]) -> Section | None:
    noise, known = about["noise"], about["known"]
    pairs = [("noise", str(noise["source"]))]
    for sensor, (_, what, kind) in SENSORS.items():
        pairs.append((f"white noise, {what}", quantity(noise[sensor]["white"], kind)))
        if noise[sensor]["bias_instability"] or noise[sensor]["random_walk"]:
            pairs.append((f"slow noise, {what}", "declared"))
    latitude = known["latitude"]
    if latitude is None:
        where_ = f"unknown, {known['hemisphere']}ern hemisphere"
    elif isinstance(latitude, list):
        ends = [minus(f"{math.degrees(v):.5g}") for v in (min(latitude), max(latitude))]
        where_ = f"of each set‑up, {ends[0]}° to {ends[1]}°"
    else:
        sd = math.degrees(known["latitude_sd"] or 0.0)
        where_ = minus(f"{math.degrees(latitude):.5g}") + "°"
        where_ += f" ± {angle(sd)}" if sd > 1e-6 else ""
    several = len({*np.atleast_1d(known["gravity"])}) > 1
    near, level = known["near"], known["level_sd"]
    pairs += [
        ("latitude", where_),
        (
            "local gravity",
            "normal gravity at the latitude of each set‑up"
            if several
            else page.gravity(about["site"]),
        ),
        ("rough heading given", "" if near is None else f"{math.degrees(near):.4g}°"),
        ("levelled to", "" if level is None else angle(math.degrees(level))),
    ]
    return section("north.known", facts(*pairs))


def _calibration(about: Mapping[str, Any]) -> Section | None:
    coefficients, used, key = about["coefficients"], about["calibration"], "north.calibration"
    lead = "" if used else told(f"{key}.none")
    if not used and not coefficients:
        return Section(told(f"{key}.title"), f"{lead}.", [])
    lead += "" if used else " but what was known before:"
    kinds = [LAYOUT.coefficients[LAYOUT.index(name)].kind for name in coefficients]
    rows = [
        (row, unit_of(kind, row["value"]))
        for row, kind in zip(coefficients.values(), kinds, strict=True)
    ]
    sds = [None if row["sd"] is None else row["sd"] / one for row, (_, one) in rows]
    listed_ = table(
        ("coefficient: name", coefficients),
        (
            "value: number",
            [
                known_to(row["value"] / one, sd)
                for (row, (_, one)), sd in zip(rows, sds, strict=True)
            ],
        ),
        ("± sd: number", [plain(sd, 2) if sd else "" for sd in sds]),
        ("unit: short", [unit for _, (unit, _) in rows]),
    )
    known = facts(
        ("instrument", page.instrument(used.get("instrument") or {})),
        ("date", page.date(str(used.get("created") or ""))),
        ("place", page.place(used.get("site") or {})),
        ("verdict", str(used.get("verdict") or "")),
    )
    return section(key, known, listed_, lead=lead)
