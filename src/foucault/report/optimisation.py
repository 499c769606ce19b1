"""The report of a search for a plan: what it gains, where, how it moves, and how sure that is."""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from foucault import units
from foucault.errors import listed
from foucault.plans.limit import Limit
from foucault.plans.limit import said as quantity
from foucault.report import chart, page
from foucault.report.tumble import changes, leg_numbers

if TYPE_CHECKING:
    from foucault.campaign.optimisation import Found

Motion = Sequence[tuple[float, float, tuple[float, float, float]]]

SPLIT = 20  # More coefficients than this are drawn in two figures side by side [1].
NAMED = 6  # So many coefficients are named in a sentence [1].
NEAR = 1.02  # A restart whose cost, as a ratio, is within this of the best one's ended as well [1].
SETTLED = 1.01  # Where the later half of the restarts gained less, more of them promise little [1].
AS_GOOD = 1.005  # Up to this ratio a coefficient is as good: bounds are not known much better [1].
MOST_LINES = 200  # Restarts whose course is drawn, those with the lowest cost [1].
NARROW = 4.0  # Up to this ratio of its ends an axis has evenly spaced marks [1].
WIDE = 0.04  # Part of the time from which a step has room for its number [1].

PLAN = "campaign.toml"

LOOKS = {
    "no worse in any case": (chart.FIRST, "circle", "good", ""),
    "worse in some case": (chart.WARNING, "diamond", "warning", "worse_somewhere"),
    "worse": (chart.BAD, "diamond", "bad", "worse"),
    "not counted": (chart.SOFT, "circle-open", "plain", "not_counted"),
}
"""Colour, symbol and state of a ratio, and the sentence that says what its sign means."""

SENSES = {
    False: ("random beginning", chart.FIRST, "circle"),
    True: ("continues an earlier plan", chart.SECOND, "diamond"),
}
"""Whether a restart continued an earlier plan -> what it is called, its colour and symbol."""


@dataclass(frozen=True)
class Ratio:
    """What became of one coefficient."""

    name: str
    # here, low, high: sd over sd of the plan to beat in the first case, and its range over all; NaN
    # where that plan does not show it [1]
    here: float
    low: float
    high: float
    counts: bool = True  # whether the search looked at it

    @property
    def look(self) -> str:
        """How it is drawn, a key of `LOOKS`."""
        if not self.counts:
            return "not counted"
        if self.here > AS_GOOD:
            return "worse"
        return "worse in some case" if self.high > AS_GOOD else "no worse in any case"


def _ratios(found: Found) -> list[Ratio]:
    ratio = np.array(found.ratio, float)
    return [
        Ratio(name, float(r[0]), float(np.fmin.reduce(r)), float(np.fmax.reduce(r)), weight > 0)
        for name, r, weight in zip(found.names, ratio.T, found.weights, strict=True)
    ]


def document(found: Found, folder: Path) -> page.Document:
    """Return what there is to say of a search, kept in `folder`."""
    return page.Document.of(
        _heading(found),
        _coefficients(found) if len(found.names) > 1 else None,
        _cases(found),
        plan(found),
        use(folder),
        search(found, folder),
        page.findings(found.findings, "search"),
        _about(found),
    )


# -- the verdict -----------------------------------------------------------------------------


def _heading(found: Found) -> page.Heading:
    kind = "shorter" if found.aim == "time" else "better"
    line_ = [f"{found.evaluations} plans", page.counted(len(found.restarts), "restart")]
    line_ += [f"seed {found.seed}"]
    worse = [r for r in _ratios(found) if r.counts and r.high > AS_GOOD]
    if not found.gained and found.possible_instead:
        state, word = "warning", "Less well seen, but the rig can do it"
    elif not found.gained:
        state, word = "warning", f"Nothing {kind} was found"
    elif found.aim == "time":
        state, word = "good", "Shorter, and as good as wanted"
    elif worse or found.unseen or max(found.geometric_mean) >= 1:
        state, word = "warning", "Better, with exceptions"
    else:
        state, word = "good", "Better"
    sentences = [_gain(found), *_possible(found), *_exceptions(found), _time(found)]
    return page.Heading(f"A {kind} plan for {found.procedure}?", line_, state, word, sentences)


def _gain(found: Found) -> str:
    means, here = found.geometric_mean, found.cases[0]
    if len(found.names) == 1:
        words = f"The standard deviation of the {found.names[0]} is {means[0]:.3f} times that of "
        words += f"`{found.reference}` ({here})"
    else:
        n = sum(w > 0 for w in found.weights)
        words = f"The standard deviations of the {n} coefficients that count are {means[0]:.3f} "
        words += f"times those of `{found.reference}` (geometric mean, {here})"
    low, high = (f"{v:.3f}" for v in (min(means), max(means)))
    if low != high:
        words += f", and {low} to {high} times in all {len(means)} cases"
    elif len(means) > 1:
        words += f", and so in all {len(means)} cases"
    return f"{words}."


def _possible(found: Found) -> list[str]:
    """Say which limits of the rig the plan to beat breaks."""
    if not found.reference_broken:
        return []
    words = f"The rig cannot do `{found.reference}`: {listed(found.reference_broken, NAMED)}"
    kept = "; the plan found keeps all limits" if found.possible_instead else ""
    return [page.signs(f"{words}{kept}.")]


def _exceptions(found: Found) -> list[str]:
    """Say what is worse, or what gains least; what is shown anew, and what not at all."""
    out = []
    rows = [r for r in _ratios(found) if r.counts and not math.isnan(r.high)]
    worse = sorted((r for r in rows if r.high > AS_GOOD), key=lambda r: -r.high)
    if len(found.names) > 1 and worse:
        times = [f"{r.high:.2f}" if math.isfinite(r.high) else "not seen" for r in worse]
        names = listed([f"`{r.name}` ({t})" for r, t in zip(worse, times, strict=True)], NAMED)
        out.append(f"Worse in at least one case, by at most so many times: {names}.")
    elif len(found.names) > 1 and rows:
        least = max(rows, key=lambda r: r.high)
        column = np.array(found.ratio, float)[:, found.names.index(least.name)]
        out.append(
            f"None is worse in any case; least is gained for `{least.name}`: {least.high:.3f} at "
            f"most ({found.cases[int(np.nanargmax(column))]})."
        )
    anew = ~np.isfinite(found.reference_sd[0]) & np.isfinite(found.sd[0])
    if new := [n for n, p in zip(found.names, anew, strict=True) if p]:
        out.append(f"`{found.reference}` does not show at all, this plan does: {_code(new)}.")
    if found.unseen:
        out.append(f"No allowed plan shows: {_code(found.unseen)}.")
    return out


def _time(found: Found) -> str:
    now, before = units.span(found.duration), units.span(found.reference_duration)
    if now == before:
        return f"It takes {now}, as long as `{found.reference}`."
    return f"It takes {now}; `{found.reference}` takes {before}."


def _code(names: Sequence[str]) -> str:
    return listed([f"`{n}`" for n in names], NAMED)


# -- coefficients and cases ------------------------------------------------------------------


def _coefficients(found: Found) -> page.Section | None:
    rows, key = _ratios(found), "optimisation.coefficients"
    looks = {r.look for r in rows}
    keys = [
        f"{key}.{LOOKS[k][3]}" for k in ("worse", "worse in some case", "not counted") if k in looks
    ]
    lead = page.said(
        f"{key}.lead", *keys, reference=found.reference, here=found.cases[0], count=len(found.cases)
    )
    parts = _halves(rows)
    drawn = [_ratio_figure(part, rows, 100 // len(parts)) for part in parts]
    weights = [f"{w:g}" for w in found.weights]
    listed = page.table(
        (": state", [LOOKS[r.look][2] for r in rows]),
        ("coefficient: name", [r.name for r in rows]),
        ("ratio: number", [_ratio(r.here) for r in rows]),
        ("over the cases: number aside", [_range(r.low, r.high) for r in rows]),
        (f"{found.reference}: number", map(_size, found.reference_sd[0])),
        ("found: number", map(_size, found.sd[0])),
        ("unit: short", map(page.shown, found.units)),
        ("weight: number aside", weights if len({w for w in found.weights if w > 0}) > 1 else None),
    )
    return page.section(key, drawn, listed, lead=lead)


def _halves(rows: list[Ratio]) -> list[list[Ratio]]:
    """Cut a long list in two where a group ends, as near to the middle as that is."""
    group = [r.name.rpartition(".")[0] for r in rows]
    starts = [k for k in range(1, len(rows)) if group[k] != group[k - 1]]
    if len(rows) <= SPLIT or not starts:
        return [rows]
    cut = min(starts, key=lambda k: abs(2 * k - len(rows)))
    return [rows[:cut], rows[cut:]]


def _cases(found: Found) -> page.Section | None:
    key = "optimisation.cases"
    if len(found.names) == 1:
        return page.section(
            key,
            page.table(
                ("case", found.cases),
                (f"{found.reference}: number", [_size(sd[0]) for sd in found.reference_sd]),
                ("found: number", [_size(sd[0]) for sd in found.sd]),
                ("unit: short", [page.shown(found.units[0])] * len(found.cases)),
                ("ratio: number", [_ratio(ratio[0]) for ratio in found.ratio]),
            ),
            title=page.said(f"{key}.title_one", name=found.names[0]),
        )
    counts = np.array(found.weights) > 0
    ratio = np.where(counts, np.array(found.ratio, float), np.nan)
    worse = np.sum(ratio > AS_GOOD, axis=1).tolist()
    names = [found.names[int(np.nanargmax(r))] if np.isfinite(r).any() else "" for r in ratio]
    fine = [m < 1 and not w for m, w in zip(found.geometric_mean, worse, strict=True)]
    return page.section(
        key,
        page.table(
            (": state", ["good" if f else "warning" for f in fine]),
            ("case", found.cases),
            ("geometric mean: number", [f"{v:.3f}" for v in found.geometric_mean]),
            ("worst: number", [f"{v:.3f}" for v in found.worst]),
            ("of: name", names),
            ("worse than before: number aside", [f"{w} of {int(counts.sum())}" for w in worse]),
        ),
        lead=page.said(f"{key}.lead", f"{key}.ratios"),
    )


def _size(sd: float) -> str:
    return units.plain(sd, 3) if math.isfinite(sd) else "not seen"


def _ratio(value: float) -> str:
    if math.isnan(value):
        return "new"
    return f"{value:.3f}" if math.isfinite(value) else "lost"


def _range(low: float, high: float) -> str:
    if not (math.isfinite(low) and math.isfinite(high)):
        return ""
    return f"{low:.3f} to {high:.3f}"


def _about(found: Found) -> page.Section:
    weights = [f"{n} {w:g}" for n, w in zip(found.names, found.weights, strict=True) if w != 1]
    return page.provenance(
        [
            ("procedure", found.procedure),
            ("plan to beat", found.reference),
            ("allowed", found.allowed),
            ("seed", str(found.seed)),
            ("restarts", str(len(found.restarts))),
            ("plans judged", str(found.evaluations)),
            ("weights other than 1", listed(weights, NAMED) or "none"),
            ("versions", f"foucault {found.version}"),
        ]
    )


# -- the plan --------------------------------------------------------------------------------


def plan(found: Found) -> page.Section | None:
    """Both plans: what they need of the rig, how they move, and their steps."""
    drawn: list[Any] = []
    if found.motion and found.reference_motion:
        both = (*found.motion, *found.reference_motion)
        fastest = max(abs(v) for _, _, rate in both for v in rate)
        longest = max(end for _, end, _ in both)
        plans = ((found.reference, found.reference_motion), ("found", found.motion))
        drawn = [_motion(name, steps, fastest, longest) for name, steps in plans]
        drawn.append(page.told("optimisation.plan.scale"))
    return page.section(
        "optimisation.plan", _demands(found), drawn, _steps(found), allowed=found.allowed
    )


def _demands(found: Found) -> page.Table:
    rows = [
        ["duration", units.span(found.reference_duration), units.span(found.duration), ""],
        ["steps", str(len(found.reference_steps) - 1), str(len(found.steps) - 1), ""],
    ]
    if found.motion and found.reference_motion:
        pairs = (found.reference_motion, found.motion)
        shortest = [units.span(min(end - start for start, end, _ in m)) for m in pairs]
        rows.append(["shortest step", *shortest, ""])
        for k, name in enumerate("xyz"):
            turned = [sum(abs(rate[k]) * (end - start) for start, end, rate in m) for m in pairs]
            words = [page.signs(quantity(v, "angle")) for v in turned]
            rows.append([f"turned about {name} in all", *words, ""])
    for b, n in zip(found.reference_needs, found.needs, strict=True):
        allowed = "not said" if n.allowed is None else page.signs(n.said_allowed)
        rows.append([n.name, _needed(b), _needed(n), allowed])
    heads = page.columns(f" | {found.reference}: number | found: number | allowed: number")
    return page.Table([page.Column(""), *heads[-3:]], rows)


def _needed(need: Limit) -> str:
    return page.signs(need.said_needed) + ("" if need.kept else ", BROKEN")


def _steps(found: Found) -> page.Table:
    """Both plans as one table, steps counted where the plans do not count them themselves."""
    headings = [page.shown(re.sub(r"\((.*)\)", r"[\1]", text)) for text in found.steps[0]]
    counts = [row[0] for row in found.steps[1:]] != [str(k) for k in range(1, len(found.steps))]
    headings = ["step", *headings] if counts else headings
    rows: list[list[str]] = []
    for name, steps in (("found", found.steps), (found.reference, found.reference_steps)):
        rows.append([name])
        for k, row in enumerate(steps[1:], 1):
            rows.append([*([str(k)] if counts else []), *map(page.minus, row)])
    return page.Table(
        [page.Column(t, "number" if k else "short") for k, t in enumerate(headings)], rows
    )


def _motion(title: str, steps: Motion, fastest: float, longest: float) -> page.Figure:
    """Draw the rates about the three axes against time, on scales that both plans share.

    `steps`: beginning, end [s] and rates [rad/s] of each step; `fastest`: largest rate of both
    plans [rad/s]; `longest`: time of the longer plan [s].
    """
    start, end = (np.array([s[k] for s in steps], float) for k in (0, 1))
    rates = np.degrees([s[2] for s in steps])
    top = float(np.degrees(fastest))
    look = {
        "range": [-1.3 * top, 1.3 * top],
        "tickvals": chart.numbers([-top, 0, top]),
        "zeroline": True,
        "zerolinecolor": chart.FAINT,
    }
    panels = []
    for (name, colour), rate in zip(chart.OF_AXES.items(), rates.T, strict=True):
        on = rate != 0
        ends = [chart.numbers(p) for p in zip(start[on], end[on], strict=True)]
        hover = f"about {name}: %{{y:.4g}} °/s, %{{customdata[0]}} s to %{{customdata[1]}} s|"
        data = chart.bars(
            "",
            (start + end)[on] / 2,
            rate[on],
            colour,
            hover,
            customdata=ends,
            width=chart.numbers((end - start)[on]),
            marker={"line": {"width": 0}},
        )
        panels.append(chart.Panel(f"{name} [°/s]", [data], look))
    legs = [{"start": a, "end": b} for a, b in zip(start.tolist(), end.tolist(), strict=True)]
    wide = zip(leg_numbers(legs), legs, strict=False)
    room = [n for n, leg in wide if leg["end"] - leg["start"] >= WIDE * longest]
    return chart.stacked(
        "optimisation.motion",
        panels,
        x=chart.axis("time [s]", range=[0, longest], showgrid=False),
        shapes=changes(legs),
        notes=[chart.titled(f"<b>{title}</b>", 20), *room],
        alt=f"Rates about x, y and z against time: {title}",
    )


def use(folder: Path) -> page.Section | None:
    """Commands that go on from the plan in `folder`."""
    files = {"plan": PLAN, "trial": "session", "study": "study", "run": "run"}
    quoted = {k: shlex.quote(str(folder / name)) for k, name in files.items()}
    return page.section(
        "optimisation.use", page.Code(page.said("optimisation.use.commands", **quoted).strip())
    )


# -- the search ------------------------------------------------------------------------------


def search(found: Found, folder: Path) -> page.Section | None:
    """How the restarts went, and how far that can be trusted."""
    done = [r for r in found.restarts if math.isfinite(r["cost"])]
    if not done:
        return None
    drawn = [_courses(done), _endings(done) if len(done) > 1 else None]
    return page.section("optimisation.search", drawn, page.Items(_sure(found, done, folder)))


def _sure(found: Found, done: Sequence[Mapping[str, Any]], folder: Path) -> list[tuple[str, str]]:
    costs, key = np.array([r["cost"] for r in done]), "optimisation.search"
    fresh = np.array([not r["continued"] for r in done])
    best = float(costs.min())
    near = int(np.sum(costs[fresh] <= best + math.log(NEAR)))
    words = page.said(
        f"{key}.near",
        near=near,
        fresh=page.counted(int(fresh.sum()), "restart"),
        percent=100 * (NEAR - 1),
        best=math.exp(best),
    )
    out = [("good" if near > 1 else "plain", words)]
    if len(done) > 1:
        half = len(done) // 2
        first = math.exp(float(costs[:half].min()))
        gain = first / math.exp(best)
        words = page.said(
            f"{key}.half", half=half, first=first, other=len(done) - half, gain=100 * (1 - 1 / gain)
        )
        out.append(("good" if gain < SETTLED else "warning", words))
    if lost := len(found.restarts) - len(done):
        out.append(("warning", page.said(f"{key}.lost", lost=page.counted(lost, "restart"))))
    where = shlex.quote(str(folder))
    return [*out, ("plain", page.said(f"{key}.open", more=2 * len(found.restarts), where=where))]


def ratio_axis(values: Iterable[float], title: str, edge: float = 1.1) -> dict[str, Any]:
    """Return a logarithmic axis that holds `values`, shape (any,), and room of `edge` times [1]."""
    finite = [v for v in values if math.isfinite(v) and v > 0]
    return _log_axis(min(finite) / edge, max(finite) * edge, title)


def _log_axis(low: float, high: float, title: str) -> dict[str, Any]:
    """Return a logarithmic axis from `low` to `high`, with a handful of round numbers [any]."""
    marks = _marks(low, high)
    words = {"tickvals": marks, "ticktext": [f"{v:.6g}" for v in marks]}
    return chart.axis(title, type="log", range=[math.log10(low), math.log10(high)], **words)


def _marks(low: float, high: float) -> list[float]:
    """Return round numbers between two, a handful."""
    if high / low > NARROW:
        decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)))
        some = (1, 2, 5) if len(decades) < 4 else (1,)
        return [m * 10.0**p for p in decades for m in some if low <= m * 10.0**p <= high]
    size = 10.0 ** math.floor(math.log10((high - low) / 3))
    step = next(m * size for m in (5, 2, 1) if (high - low) / (m * size) >= 3)
    return [step * k for k in range(math.ceil(low / step), math.floor(high / step) + 1)]


def _ratio_figure(rows: Sequence[Ratio], every: Sequence[Ratio], share: int) -> page.Figure:
    """Draw the ratio of some coefficients on the scale of all, with its range over the cases."""
    x = [v for r in rows for v in (*chart.numbers([r.low, r.high]), None)]
    data = [
        chart.line("", x, [v for r in rows for v in (r.name, r.name, None)], chart.FAINT, width=3)
    ]
    for kind in dict.fromkeys(r.look for r in rows):
        some = [r for r in rows if r.look == kind]
        colour, symbol, _, _ = LOOKS[kind]
        data.append(
            chart.dots(
                kind,
                chart.numbers([r.here for r in some]),
                [r.name for r in some],
                colour,
                "%{y}: %{x:.3f} (%{customdata[0]:.3f} to %{customdata[1]:.3f})|",
                symbol=symbol,
                customdata=[chart.numbers([r.low, r.high]) for r in some],
                marker={"line": {"width": 1.5, "color": colour}},
            )
        )
    span = [1.0, *(v for r in every for v in (r.here, r.low, r.high))]
    return chart.draw(
        "optimisation.ratio_figure",
        data,
        height=72 + 19 * len(rows),
        x=ratio_axis(span, "sd / sd before"),
        y=chart.names_axis([r.name for r in rows], room=0.6),
        shapes=[chart.upright(1.0)],
        share=share,
        alt=f"Standard deviation over that of the plan to beat, {rows[0].name} to {rows[-1].name}",
    )


def _courses(restarts: Sequence[dict[str, Any]]) -> page.Figure:
    """Draw the cost of every restart, as a ratio, against the plans that it had judged."""
    drawn = sorted(restarts, key=lambda r: r["cost"])[:MOST_LINES]
    best, data = drawn[0], []
    groups = [
        ([r for r in drawn if r["continued"] == continued and r is not best], name, colour, 1.0)
        for continued, (name, colour, _) in SENSES.items()
    ]
    for some, name, colour, width in [
        *groups,
        ([best], f"best: restart {best['restart']}", chart.INK, 2.6),
    ]:
        if not some:
            continue
        x, y = [], []
        for r in some:
            x += [*(float(max(at, 1)) for at, _ in r["trace"]), None]
            y += [*chart.numbers([math.exp(cost) for _, cost in r["trace"]]), None]
        data.append(
            chart.line(
                name,
                x,
                y,
                colour,
                "after %{x} plans: %{y:.4f}|",
                width=width,
                shape="hv",
                opacity=1.0 if width > 2 else 0.5,
            )
        )
    every = [math.exp(c) for r in drawn for _, c in r["trace"] if math.isfinite(c)]
    first = min(max(r["trace"][0][0], 1) for r in drawn)
    most = 1.05 * max(*(r["evaluations"] for r in drawn), first + 1)
    return chart.draw(
        "optimisation.courses",
        data,
        x=_log_axis(first, most, "plans judged"),
        y=ratio_axis(every, "cost as a ratio"),
    )


def _endings(restarts: Sequence[dict[str, Any]]) -> page.Figure:
    """Draw where each restart ended, and the best of all so far."""
    n, costs = [r["restart"] for r in restarts], np.exp([r["cost"] for r in restarts])
    continued = np.array([r["continued"] for r in restarts], bool)
    data: list[chart.Trace] = [
        chart.dots(
            name,
            np.array(n)[continued == sense],
            costs[continued == sense],
            colour,
            "restart %{x}: %{y:.4f}|",
            symbol=symbol,
        )
        for sense, (name, colour, symbol) in SENSES.items()
        if (continued == sense).any()
    ]
    data.append(chart.line("best so far", n, np.minimum.accumulate(costs), chart.INK, shape="hv"))
    return chart.draw(
        "optimisation.endings",
        data,
        x=chart.axis("restart", range=[-0.5, n[-1] + 0.5], dtick=max(1, round(n[-1] / 8))),
        y=ratio_axis(costs.tolist(), "cost at the end, as a ratio", edge=1.02),
    )
