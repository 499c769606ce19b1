"""The report of a search for a plan: what it gains, where, how it moves, and how sure that is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from foucault import units
from foucault.arrays import FloatArray
from foucault.files import atomic
from foucault.report import ends, figures_plan, optimisation_detail, render
from foucault.report.ends import Heading
from foucault.report.figures_plan import AS_GOOD, Ratio
from foucault.report.optimisation_detail import counted
from foucault.report.page import Column, Section, Table
from foucault.report.uncertainty import shown

if TYPE_CHECKING:
    from foucault.campaign.found import Found

SPLIT = 20
"""More coefficients than this are drawn in two figures side by side [1]."""

NAMED = 6
"""So many coefficients are named in a sentence [1]."""


def write(found: Found, path: str | Path) -> Path:
    """Write one self-contained HTML file.

    `path`: the file, in the folder of the search.
    """
    path = Path(path)
    with atomic(path) as temporary:
        temporary.write_text(html(found, path.parent), encoding="utf-8")
    return path


def html(found: Found, folder: Path) -> str:
    """Return the report of a search, kept in `folder`, as HTML."""
    made = [
        _coefficients(found) if len(found.names) > 1 else None,
        _cases(found),
        optimisation_detail.plan(found),
        optimisation_detail.use(folder),
        optimisation_detail.search(found, folder),
        ends.findings(found.findings, "search"),
        _about(found),
    ]
    return render(_heading(found), [section for section in made if section is not None])


# -- the verdict ---------------------------------------------------------------------------------


def _heading(found: Found) -> Heading:
    kind = "shorter" if found.aim == "time" else "better"
    title = f"A {kind} plan for {found.procedure}?"
    line = [f"{found.evaluations} plans", f"{counted(len(found.restarts), 'restart')}"]
    line += [f"seed {found.seed}"]
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
    sentences = [*_gain(found), *_possible(found), *_exceptions(found), _time(found)]
    return Heading(title, line, state, word, sentences)


def _gain(found: Found) -> list[str]:
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
    return [f"{words}."]


def _possible(found: Found) -> list[str]:
    """Say which limits of the rig the plan to beat breaks."""
    if not found.reference_broken:
        return []
    words = f"The rig cannot do `{found.reference}`: {_listed(found.reference_broken)}"
    kept = "; the plan found keeps all limits" if found.possible_instead else ""
    return [f"{shown(words)}{kept}.".replace(" °", "°")]


def _exceptions(found: Found) -> list[str]:
    """Say what is worse, or what gains least; what is shown anew, and what not at all."""
    out = []
    rows = [r for r in _ratios(found) if r.counts and not math.isnan(r.high)]
    worse = sorted((r for r in rows if r.high > AS_GOOD), key=lambda r: -r.high)
    if len(found.names) > 1 and worse:
        names = _listed([f"`{r.name}` ({_times(r.high)})" for r in worse])
        out.append(f"Worse in at least one case, by at most so many times: {names}.")
    elif len(found.names) > 1 and rows:
        least = max(rows, key=lambda r: r.high)
        case = found.cases[int(np.nanargmax(_column(found, least.name)))]
        out.append(
            f"None is worse in any case; least is gained for `{least.name}`: {least.high:.3f} at "
            f"most ({case})."
        )
    new = _unknown(found.reference_sd, found.sd, found.names)
    if new:
        out.append(f"`{found.reference}` does not show at all, this plan does: {_code(new)}.")
    if found.unseen:
        out.append(f"No allowed plan shows: {_code(found.unseen)}.")
    return out


def _times(ratio: float) -> str:
    return f"{ratio:.2f}" if math.isfinite(ratio) else "not seen"


def _time(found: Found) -> str:
    now, before = units.span(found.duration), units.span(found.reference_duration)
    if now == before:
        return f"It takes {now}, as long as `{found.reference}`."
    return f"It takes {now}; `{found.reference}` takes {before}."


def _unknown(
    none: Sequence[Sequence[float]], some: Sequence[Sequence[float]], names: Sequence[str]
) -> list[str]:
    """Return the names that the first bounds do not show, and the second do."""
    pick = ~np.isfinite(none[0]) & np.isfinite(some[0])
    return [n for n, p in zip(names, pick, strict=True) if p]


def _ratios(found: Found) -> list[Ratio]:
    ratio = np.array(found.ratio, float)
    return [
        Ratio(name, float(r[0]), float(np.fmin.reduce(r)), float(np.fmax.reduce(r)), weight > 0)
        for name, r, weight in zip(found.names, ratio.T, found.weights, strict=True)
    ]


def _column(found: Found, name: str) -> FloatArray:
    return np.array(found.ratio, float)[:, found.names.index(name)]


def _code(names: Sequence[str]) -> str:
    return _listed([f"`{n}`" for n in names])


def _listed(words: Sequence[str]) -> str:
    rest = len(words) - NAMED
    return ", ".join(words[:NAMED]) + (f" and {rest} more" if rest > 0 else "")


# -- coefficients and cases ----------------------------------------------------------------------


def _coefficients(found: Found) -> Section:
    rows, here = _ratios(found), found.cases[0]
    lead = (
        f"Standard deviation with the plan found over that with `{found.reference}`: smaller is "
        f"better, 1 is as good. Both are what a calibration would state. Dot: {here}. Line: from "
        f"the smallest to the largest of all {len(found.cases)} cases, where it is longer than the "
        "dot."
    )
    looks = {r.look for r in rows}
    lead += "".join(f" {words}" for look, words in KEYS.items() if look in looks)
    parts = _halves(rows)
    figures = [figures_plan.ratios(part, rows, 100 // len(parts)) for part in parts]
    return Section("Every coefficient", lead, [*figures, _coefficient_table(found)])


KEYS = {
    "worse": "Red diamond: worse.",
    "worse in some case": "Ochre diamond: worse in some case.",
    "not counted": "Ring: of weight 0.",
}
"""What the signs in the figures mean, beside the usual dot."""


def _halves(rows: list[Ratio]) -> list[list[Ratio]]:
    """Cut a long list in two where a group ends, as near to the middle as that is."""
    starts = [k for k in range(1, len(rows)) if _group(rows[k].name) != _group(rows[k - 1].name)]
    if len(rows) <= SPLIT or not starts:
        return [rows]
    cut = min(starts, key=lambda k: abs(2 * k - len(rows)))
    return [rows[:cut], rows[cut:]]


def _group(name: str) -> str:
    return name.rpartition(".")[0]


def _coefficient_table(found: Found) -> Table:
    weighed = len({w for w in found.weights if w > 0}) > 1
    columns = [
        Column("", "state"),
        Column("coefficient", "name"),
        Column("ratio", "number"),
        Column("over the cases", "number", aside=True),
        Column(found.reference, "number"),
        Column("found", "number"),
        Column("unit", "short"),
        *([Column("weight", "number", aside=True)] if weighed else []),
    ]
    rows = [
        [
            STATES[r.look], r.name, _ratio(r.here), _range(r.low, r.high), _size(before),
            _size(after), shown(unit), *([f"{weight:g}"] if weighed else []),
        ]
        for r, before, after, unit, weight in zip(
            _ratios(found), found.reference_sd[0], found.sd[0], found.units, found.weights,
            strict=True,
        )
    ]  # fmt: skip
    return Table(columns, rows)


STATES = {
    "no worse in any case": "good",
    "worse in some case": "warning",
    "worse": "bad",
    "not counted": "plain",
}
"""Sign of every look of a ratio."""


def _cases(found: Found) -> Section:
    single = len(found.names) == 1
    lead = (
        "Other circumstances, and instruments with other true errors. The search looked at the "
        "first case only; the others were judged afterwards, without its approximations."
    )
    if single:
        columns = [
            Column("case"),
            Column(found.reference, "number"),
            Column("found", "number"),
            Column("unit", "short"),
            Column("ratio", "number"),
        ]
        rows = [
            [case, _size(before[0]), _size(after[0]), shown(found.units[0]), _ratio(ratio[0])]
            for case, before, after, ratio in zip(
                found.cases, found.reference_sd, found.sd, found.ratio, strict=True
            )
        ]
        title = f"Standard deviation of the {found.names[0]}"
        return Section(title, lead, [Table(columns, rows)])
    columns = [
        Column("", "state"),
        Column("case"),
        Column("geometric mean", "number"),
        Column("worst", "number"),
        Column("of", "name"),
        Column("worse than before", "number", aside=True),
    ]
    return Section(
        "Case by case", f"{lead} Ratios of what counts.", [Table(columns, _case_rows(found))],
    )  # fmt: skip


def _case_rows(found: Found) -> list[list[str]]:
    counts = np.array(found.weights) > 0
    rows = []
    for case, mean, worst, ratios in zip(
        found.cases, found.geometric_mean, found.worst, found.ratio, strict=True
    ):
        ratio = np.where(counts, np.array(ratios, float), np.nan)
        name = found.names[int(np.nanargmax(ratio))] if np.isfinite(ratio).any() else ""
        worse = int(np.sum(ratio > AS_GOOD))
        state = "good" if mean < 1 and not worse else "warning"
        of = f"{worse} of {int(counts.sum())}"
        rows.append([state, case, f"{mean:.3f}", f"{worst:.3f}", name, of])
    return rows


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


def _about(found: Found) -> Section:
    weights = {n: w for n, w in zip(found.names, found.weights, strict=True) if w != 1}
    pairs = [
        ("procedure", found.procedure),
        ("plan to beat", found.reference),
        ("allowed", found.allowed),
        ("seed", str(found.seed)),
        ("restarts", str(len(found.restarts))),
        ("plans judged", str(found.evaluations)),
        ("weights other than 1", _listed([f"{n} {w:g}" for n, w in weights.items()]) or "none"),
        ("versions", f"foucault {found.version}"),
    ]
    return ends.provenance(pairs)
