"""The page of a fleet: who passes, how the coefficients are distributed, who stands out.

Histograms stand side by side, drawn from counts, so that they stay small.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import format_value
from foucault.diagnose.compare import FEWEST, middle_and_spread
from foucault.errors import listed
from foucault.models.imu import LAYOUT
from foucault.report import chart, page
from foucault.result import Level
from foucault.units import plain

if TYPE_CHECKING:
    from foucault.campaign.fleet import FleetTable
    from foucault.diagnose.compare import Outlying

LISTED = 500  # Instruments in the table of the page; the others are in fleet.parquet [1].
FEW = 40  # Instruments in the table of those that did not pass [1].
NAMED = 60  # Lines in a list of what stands out [1].
PER_ROW = 3  # Histograms side by side [1].
REACH = 8.0  # Values farther from the median than this are counted in the margin [robust sd].
MANY = 30  # So many redundant readings leave the size of the residuals little scatter [1].

LOOKS = {
    "broken": "bad",
    "fail": "bad",
    "unusable": "bad",
    "undecided": "warning",
    "doubtful": "warning",
    "pass": "good",
}
"""Look of every outcome, worst first."""

TITLES = {"bias": "Biases", "scale": "Scale factor errors", "misalignment": "Misalignments"}
TRIADS = {"accel": "accelerometers", "gyro": "gyros"}


def document(some: FleetTable, about: Mapping[str, Any]) -> page.Document:
    """Return what there is to say of a fleet."""
    odd = some.outlying()
    order = _worst_first(some, odd)
    return page.Document.of(
        _heading(some, odd, about),
        _outcomes(some),
        _attention(some, odd, order),
        _outlying(some, odd),
        _families(some),
        _summary(some),
        ratios(some),
        _tolerance(some),
        _instruments(some, odd, order),
        _about(about),
    )


def _heading(some: FleetTable, odd: list[Outlying], about: Mapping[str, Any]) -> page.Heading:
    counts = some.counts()
    bad, open_ = (
        sum(n for word, n in counts.items() if LOOKS[word] == look) for look in ("bad", "warning")
    )
    level = Level.UNUSABLE if bad else (Level.DOUBTFUL if open_ else Level.PASS)
    found = ", ".join(f"{n} {word}" for word, n in counts.items() if n)
    reasons = [f"{found[:1].upper()}{found[1:]}."]
    if n := len({o.index for o in odd}):
        reasons.append(
            f"{f'{n} instruments differ' if n > 1 else 'One instrument differs'} from the fleet."
        )
    batch = about.get("solved_in_batch")
    line = [f"{len(some)} instruments", str(about.get("procedure", ""))]
    line += [f"{batch} solved in one batch"] if batch else []
    created = str((about.get("provenance") or {}).get("created", ""))
    line += [created[:10]] if created else []
    word = "All pass" if level is Level.PASS else f"{counts['pass']} of {len(some)} pass"
    return page.Heading("Calibration of a fleet", line, page.STATES[level], word, reasons)


def _outcomes(some: FleetTable) -> page.Section | None:
    counts, total, key = some.counts(), max(len(some), 1), "fleet.outcomes"
    bare = some.decisions is None
    return page.section(
        key,
        page.table(
            (": state", [LOOKS[word] for word in counts]),
            ("outcome", counts),
            ("instruments: number", [f"{n}" for n in counts.values()]),
            ("share: number aside", [f"{100 * n / total:.1f} %" for n in counts.values()]),
            (
                "what it means",
                [
                    page.told(f"{key}.{word}{'_bare' * (bare and word == 'pass')}")
                    for word in counts
                ],
            ),
        ),
        lead=page.told(f"{key}.bare") if bare else None,
    )


def _outlying(some: FleetTable, odd: list[Outlying]) -> page.Section | None:
    key = "fleet.outlying"
    if not odd:
        few = int(some.good.sum()) < FEWEST
        lead = page.said(f"{key}.few" if few else f"{key}.none", fewest=FEWEST)
        return page.Section(page.told(f"{key}.title"), lead, [])
    spread = {d.name: d for d in some.distributions()}
    items = []
    for o in odd[:NAMED]:
        serial = some.rows[o.index].serial
        if o.name not in spread:
            items.append(("warning", f"{serial}: {o.name}, {o.value:.1f} times that of the fleet."))
            continue
        d, (unit, one) = spread[o.name], _unit(o.name, o.value)
        text = (
            f"{serial}: {o.name} is {plain(o.value / one, 4)} {unit}, z = {o.z:+.1f}; the "
            f"fleet has {plain(d.median / one, 3)} ± {plain(d.spread / one, 2)} {unit}."
        )
        items.append(("warning", text.replace(" -", " −")))
    more = page.said(f"{key}.more", count=len(odd) - NAMED) if len(odd) > NAMED else ""
    return page.section(key, page.Items(items), more)


def _unit(name: str, *values: Any) -> tuple[str, float]:
    return page.unit_of(LAYOUT.coefficients[LAYOUT.index(name)].kind, *values)


# -- the instruments -------------------------------------------------------------------------


def _use(some: FleetTable) -> FloatArray:
    """Return the share of its limit that each coefficient of each instrument takes, (N, names)."""
    if some.tolerance is None or not some.names:
        return np.full((len(some), 1), np.nan)
    limit = some.tolerance.limits(some.names)[0]
    share = np.where(np.isfinite(some.values), np.abs(some.values), 0.0) / limit
    return np.asarray(np.where(some.good[:, None], share, np.nan))


def _worst_first(some: FleetTable, odd: list[Outlying]) -> list[int]:
    """Return the numbers of the instruments, those that need a look first."""
    share = np.nan_to_num(_use(some).max(axis=1)).tolist()
    noise = np.fmax(np.fmax(*some.ratio.T), 0.0).tolist()
    outcomes, order = some.outcomes, list(LOOKS)
    worst_z: dict[int, float] = {}
    for o in odd:
        worst_z[o.index] = max(worst_z.get(o.index, 0.0), abs(o.z))

    def rank(i: int) -> tuple[int, float, float, float]:
        return order.index(outcomes[i]), -worst_z.get(i, 0.0), -share[i], -noise[i]

    return sorted(range(len(some)), key=rank)


def _attention(some: FleetTable, odd: list[Outlying], order: list[int]) -> page.Section | None:
    """List those that did not pass, so that nobody has to look for them."""
    bad, key = [i for i in order if some.outcomes[i] != "pass"], "fleet.attention"
    if not bad:
        return None
    more = f"{key}.some" if len(bad) > FEW else ""
    lead = page.said(f"{key}.lead", more, few=FEW, count=len(bad))
    return page.section(key, _listed(some, bad[:FEW], odd), lead=lead)


def _instruments(some: FleetTable, odd: list[Outlying], order: list[int]) -> page.Section | None:
    key = "fleet.instruments"
    lead = page.said(
        f"{key}.lead",
        f"{key}.limit" if some.decisions is not None else "",
        f"{key}.residual" if np.isfinite(some.ratio).any() else "",
        f"{key}.some" if len(some) > LISTED else "",
        listed=LISTED,
        count=len(some),
    )
    return page.section(key, _listed(some, order[:LISTED], None), lead=lead)


def _listed(some: FleetTable, rows: list[int], odd: list[Outlying] | None) -> page.Table:
    """Return some instruments, with `odd` why they did not pass; else what is nearest to its limit.

    A folder without reports has nothing to link to.
    """
    use, ratio, limited = _use(some), some.ratio, some.decisions is not None
    tested = bool(np.isfinite(ratio).any())

    def nearest(i: int) -> str:
        """Return the coefficient that takes the largest share of its limit."""
        if some.tolerance is None or not some.good[i] or not some.names:
            return ""
        return some.names[int(np.argmax(np.nan_to_num(use[i])))]

    def sized(values: FloatArray, text: str) -> list[str]:
        return [text.format(float(values[i])) if np.isfinite(values[i]) else "" for i in rows]

    return page.table(
        (": state", [LOOKS[some.outcomes[i]] for i in rows]),
        (
            "instrument: link",
            [page.Link.to(some.rows[i].report, some.rows[i].serial) for i in rows],
        ),
        ("outcome: short", [some.outcomes[i] for i in rows]),
        ("of limit: number", sized(100 * use.max(axis=1), "{:.0f} %") if limited else None),
        *(
            (f"{triad} residual: number aside", sized(ratio[:, k], "{:.2f}") if tested else None)
            for k, triad in enumerate(("accel", "gyro"))
        ),
        ("why", None if odd is None else [_why(some, i, odd) for i in rows]),
        (
            "nearest to its limit: aside",
            [nearest(i) for i in rows] if odd is None and limited else None,
        ),
    )


def _why(some: FleetTable, i: int, odd: list[Outlying], most: int = 3) -> str:
    row = some.rows[i]
    if row.problem is not None:
        return f"{row.problem.message} ({row.problem.code})"

    parts = [listed([f"{name} {word}" for name, word in some.misses(i)], most)]
    if unlike := [o.name for o in odd if o.index == i]:
        parts.append(f"unlike the fleet: {listed(unlike, most)}")
    parts += [reason.partition(";")[0] for reason in row.reasons[:2]]
    return "; ".join(part.rstrip(".") for part in parts if part)


# -- the coefficients ------------------------------------------------------------------------


def _summary(some: FleetTable) -> page.Section | None:
    found = some.distributions()
    if not found:
        return None
    spreads: dict[str, list[float]] = {}  # one unit for each family, so that it can be read down
    for d in found:
        spreads.setdefault(d.name.rpartition(".")[0], []).append(d.spread)
    unit = [_unit(d.name, spreads[d.name.rpartition(".")[0]]) for d in found]

    def of(key: str) -> list[str]:
        pairs = zip(found, unit, strict=True)
        return [
            page.minus(format_value(getattr(d, key) / one, d.spread / one / 10))
            for d, (_, one) in pairs
        ]

    sd = [d.sd / one for d, (_, one) in zip(found, unit, strict=True)]
    return page.section(
        "fleet.summary",
        page.table(
            ("coefficient: name", [d.name for d in found]),
            ("median: number", of("median")),
            ("spread: number", of("spread")),
            ("lowest: number aside", of("lowest")),
            ("highest: number aside", of("highest")),
            ("measured with sd: number", [plain(v, 2) if np.isfinite(v) else "" for v in sd]),
            ("unit: short", [name for name, _ in unit]),
        ),
    )


def _tolerance(some: FleetTable) -> page.Section | None:
    if some.tolerance is None:
        return None
    limit, largest = some.tolerance.limits(some.names)
    known = some.decisions is not None
    kept = [k for k in range(len(some.names)) if np.isfinite(limit[k]) and known]
    unit = {k: _unit(some.names[k], limit[k]) for k in kept}
    counts = {
        k: [int(np.sum(some.decisions[some.good, k] == d)) for d in (0, 2, 1)]
        for k in kept
        if some.decisions is not None
    }
    sd = {k: largest[k] / unit[k][1] for k in kept}
    return page.section(
        "fleet.tolerance",
        page.table(
            (
                ": state",
                ["bad" if n[1] else "warning" if n[2] else "good" for n in counts.values()],
            ),
            ("coefficient: name", [some.names[k] for k in kept]),
            ("limit ±: number", [plain(limit[k] / unit[k][1], 4) for k in kept]),
            (
                "largest sd: number aside",
                [plain(v, 3) if np.isfinite(v) else "" for v in sd.values()],
            ),
            ("unit: short", [unit[k][0] for k in kept]),
            *(
                (f"{word}: number", [str(n[i]) for n in counts.values()])
                for i, word in enumerate(("pass", "fail", "undecided"))
            ),
        ),
    )


def _about(about: Mapping[str, Any]) -> page.Section:
    made = about.get("provenance") or {}
    return page.provenance(
        [
            ("procedure", str(about.get("procedure", ""))),
            ("solved in one batch", str(about.get("solved_in_batch", 0))),
            ("tolerance", str((about.get("tolerance") or {}).get("file", "none"))),
            ("created", str(made.get("created", ""))),
            ("seconds", str(made.get("seconds", ""))),
            ("SHA-256 of the campaign", str((about.get("campaign") or {}).get("sha256", ""))),
            ("versions", page.words(made.get("versions") or {})),
        ]
    )


# -- histograms ------------------------------------------------------------------------------


def _families(some: FleetTable) -> list[page.Section]:
    """Return one section per family of coefficients: a histogram for each of them."""
    groups: dict[str, list[int]] = {}
    for k, name in enumerate(some.names):
        groups.setdefault(name.rpartition(".")[0], []).append(k)
    out = []
    for family, members in groups.items():
        rows = [members[i : i + PER_ROW] for i in range(0, len(members), PER_ROW)]
        drawn = [f for f in (_row(some, row) for row in rows) if f is not None]
        if not drawn:
            continue
        triad, _, what = family.partition(".")
        title = f"{TITLES.get(what, what.replace('_', ' '))} of the {TRIADS.get(triad, triad)}"
        lead = "Solid: median of the fleet."
        if some.tolerance is not None:
            limit = some.tolerance.limits([some.names[k] for k in members])[0]
            lead += " Dashed: tolerance." if np.isfinite(limit).any() else " No tolerance."
        out.append(page.Section(title, lead, drawn))
    return out


def _row(some: FleetTable, members: list[int]) -> page.Figure | None:
    """Draw the histograms of up to three coefficients."""
    block, names = some.values[:, members], [some.names[k] for k in members]
    known = block[np.isfinite(block)]
    if not len(known):
        return None
    unit, one = _unit(names[0], float(np.quantile(np.abs(known), 0.9)))
    limits = np.full(len(names), np.inf)
    if some.tolerance is not None:
        limits = np.asarray(some.tolerance.limits(names)[0]) / one
    rows = [
        (name, f"{name.rpartition('.')[2]} [{unit}]", x[np.isfinite(x)] / one, float(limit))
        for name, x, limit in zip(names, block.T, limits, strict=True)
    ]
    alt = f"Histograms over the instruments of {', '.join(names)}"
    return _histograms(rows, [[k * 0.345, k * 0.345 + 0.31] for k in range(PER_ROW)], 230, alt)


def _histograms(
    rows: Sequence[tuple[str, str, FloatArray, float]],
    places: Sequence[list[float]],
    height: float,
    alt: str,
    about: float | None = None,
    least: float = 0.0,
) -> page.Figure | None:
    """Draw values side by side; a row is a name, the title of its axis, values and their limit.

    `about` is the value that a solid line marks; the median where there is none.
    """
    data: list[chart.Trace] = []
    axes: dict[str, Any] = {}
    shapes, notes = [], []
    for k, (name, title, x, limit) in enumerate(rows):
        if not len(x):
            continue
        drawn, low, high, outside = _bars(name, x, limit, least)
        if about is not None:
            low, high = min(low, 0.9 * about), max(high, 1.1 * about)
        place = places[len(data) if about is not None else k]
        on = {letter: chart.ref(letter, k) for letter in "xy"} if data else {"x": "x", "y": "y"}
        data.append(drawn | {"xaxis": on["x"], "yaxis": on["y"]})
        middle = middle_and_spread(x)[0] if about is None else about
        along = {"xref": on["x"], "yref": f"{on['y']} domain"}
        shapes.append(chart.upright(middle, "solid", chart.INK, **along))
        shapes += [
            chart.upright(s * limit, "dash", chart.BAD, **along)
            for s in (-1, 1)
            if low < s * limit < high
        ]
        axes[on["x"].replace("x", "xaxis")] = chart.axis(
            title, domain=place, range=[low, high], anchor=on["y"], nticks=5, showgrid=False
        )
        axes[on["y"].replace("y", "yaxis")] = chart.axis(
            "" if len(data) > 1 else "instruments", anchor=on["x"], nticks=4
        )
        if outside:
            font = {"font": {"color": chart.WARNING, "size": 12}}
            notes.append(chart.noted(f"{outside} beyond", place[1], "right", **font))
    # One height of all, so that the numbers of the first do for all where there is little room.
    most = 1.05 * max((max(trace["y"]) for trace in data), default=1.0)
    upward = [k for k in axes if k[:5] == "yaxis"]
    axes |= {k: axes[k] | {"range": [0.0, most]} for k in upward}
    small = {"nticks": 3, "tickangle": 0, "tickfont": {"size": 10}}
    narrow = {k: small for k in axes if k[:5] == "xaxis"}
    narrow |= {k: {"showticklabels": False} for k in upward[1:]}
    return (
        chart.draw(
            "fleet.histograms",
            data,
            height=height,
            shapes=shapes,
            notes=notes,
            alt=alt,
            meta={"narrow": narrow},
            **axes,
        )
        if data
        else None
    )


def _bars(
    name: str, x: FloatArray, limit: float, least: float
) -> tuple[chart.Trace, float, float, int]:
    """Count values in bins; return bars, the range of the axis, and how many lie outside it.

    Values that lie closer together than `least` are one bar, wide enough to be seen.
    """
    middle, spread = middle_and_spread(x)
    spread = spread or float(np.ptp(x)) or abs(middle) or 1.0
    near = x[np.abs(x - middle) <= REACH * spread]
    low, high, n = float(near.min()), float(near.max()), len(near)
    wanted = 2.0 * spread / max(n, 1) ** (1 / 3)  # a little finer than the usual rule
    bins = int(np.clip(np.ceil((high - low) / wanted), 5, 60))
    if high - low <= least:
        half = least / 2 or 2 * spread
        low, high, bins = middle - half, middle + half, 5
    counts, edges = np.histogram(x, bins=bins, range=(low, high))
    width = float(f"{edges[1] - edges[0]:.6g}")
    drawn = chart.bars(
        name,
        (edges[:-1] + edges[1:]) / 2,
        counts.tolist(),
        chart.FIRST,
        "%{x:.4g}: %{y}|",
        width=width,
        marker={"opacity": 0.75},
    )
    reach = 0.06 * (high - low)
    left, right = low - reach, high + reach
    # The limits are shown unless that would squeeze the histogram into a corner.
    if np.isfinite(limit) and 2 * limit < 6 * (high - low):
        left, right = min(left, -1.08 * limit), max(right, 1.08 * limit)
    return drawn, left, right, len(x) - n


def ratios(some: FleetTable) -> page.Section | None:
    """Return the section on residuals: their size over what the noise says."""
    ratio, key = some.ratio, "fleet.residuals"
    rows = [
        (name, name, ratio[np.isfinite(ratio[:, t]), t], np.inf)
        for t, name in enumerate(("accelerometers", "gyros"))
    ]
    alt = "Histograms over the instruments of the size of the residuals over the noise"
    figure = _histograms(rows, [[0.0, 0.46], [0.54, 1.0]], 250, alt, about=1.0, least=0.1)
    d = some.redundancy[np.isfinite(some.redundancy).all(axis=1)]
    few = len(d) and float(np.median(d)) < MANY
    accel, gyro = np.median(d, axis=0) if few else (0.0, 0.0)
    lead = page.said(f"{key}.lead", f"{key}.few" if few else "", accel=accel, gyro=gyro)
    return page.section(key, figure, lead=lead)
