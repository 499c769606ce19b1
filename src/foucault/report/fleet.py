"""The page of a fleet: who passes, how the coefficients are distributed, who stands out."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import format_value
from foucault.diagnose.fleet import FEWEST
from foucault.files import atomic
from foucault.models.imu import LAYOUT
from foucault.report import ends, render
from foucault.report.ends import STATES, Heading
from foucault.report.fleet_figures import families, ratios
from foucault.report.page import Column, Items, Link, Section, Table, Text
from foucault.report.uncertainty import shown
from foucault.result import Level
from foucault.units import display_unit, factor, plain

if TYPE_CHECKING:
    from foucault.campaign.fleet.table import FleetTable
    from foucault.diagnose.fleet import Outlying

LISTED = 500
"""Instruments in the table of the page; the others are in fleet.parquet [1]."""

FEW = 40
"""Instruments in the table of those that did not pass [1]."""

NAMED = 60
"""Lines in a list of what stands out [1]."""

LOOKS = {
    "pass": "good", "fail": "bad", "undecided": "warning", "doubtful": "warning",
    "unusable": "bad", "broken": "bad",
}  # fmt: skip
ORDER = ("broken", "fail", "unusable", "undecided", "doubtful", "pass")
"""Outcomes, worst first."""


def write(table: FleetTable, about: Mapping[str, Any], path: str | Path) -> Path:
    """Write one self-contained HTML file.

    `table`: the instruments [SI].
    """
    path = Path(path)
    with atomic(path) as temporary:
        temporary.write_text(html(table, about), encoding="utf-8")
    return path


def html(table: FleetTable, about: Mapping[str, Any]) -> str:
    """Return the page as HTML."""
    odd = table.outlying()
    order = _worst_first(table, odd)
    made = [
        _outcomes(table),
        _attention(table, odd, order),
        _outlying(table, odd),
        *families(table),
        _summary(table),
        ratios(table),
        _tolerance(table),
        _instruments(table, odd, order),
        _about(about),
    ]
    return render(_heading(table, about), [section for section in made if section is not None])


def _heading(table: FleetTable, about: Mapping[str, Any]) -> Heading:
    counts = table.counts()
    bad = sum(counts.get(k, 0) for k in ("fail", "unusable", "broken"))
    open_ = sum(counts.get(k, 0) for k in ("undecided", "doubtful"))
    level = Level.UNUSABLE if bad else (Level.DOUBTFUL if open_ else Level.PASS)
    said = ", ".join(f"{n} {word}" for word, n in counts.items() if n)
    reasons = [f"{said[:1].upper()}{said[1:]}."]
    odd = {o.index for o in table.outlying()}
    if odd:
        some = "one instrument differs" if len(odd) == 1 else f"{len(odd)} instruments differ"
        reasons.append(f"{some[:1].upper()}{some[1:]} from the fleet.")
    line = [f"{len(table)} instruments", str(about.get("procedure", ""))]
    batch = about.get("solved_in_batch")
    line += [f"{batch} solved in one batch"] if batch else []
    created = str((about.get("provenance") or {}).get("created", ""))
    line += [created[:10]] if created else []
    word = "All pass" if level is Level.PASS else f"{counts['pass']} of {len(table)} pass"
    return Heading("Calibration of a fleet", line, STATES[level], word, reasons)


def _outcomes(table: FleetTable) -> Section:
    meaning = {
        "pass": "every coefficient with twice its standard deviation is inside its limit",
        "fail": "a coefficient is outside its limit by more than twice its standard deviation",
        "undecided": "a coefficient is too near to its limit, or not known well enough, to tell",
        "broken": "there is no result; the reason is below",
    }
    if table.decisions is None:
        meaning |= {
            "pass": "all checks of the calibration passed",
            "doubtful": "a check failed: read why before use",
            "unusable": "not to be used",
        }
    counts, total = table.counts(), max(len(table), 1)
    rows = [
        [LOOKS[word], word, f"{n}", f"{100 * n / total:.1f} %", meaning[word]]
        for word, n in counts.items()
    ]
    columns = [
        Column("", "state"), Column("outcome"), Column("instruments", "number"),
        Column("share", "number", aside=True), Column("what it means"),
    ]  # fmt: skip
    lead = (
        "Measured against the tolerance, with a guard band of two standard deviations."
        if table.decisions is not None
        else "No tolerance was given: what the checks of each calibration say."
    )
    return Section("Outcome", lead, [Table(columns, rows)])


def _outlying(table: FleetTable, odd: list[Outlying]) -> Section:
    if not odd:
        few = int(table.good.sum()) < FEWEST
        words = "No instrument differs from the others by more than chance."
        if few:
            words = f"With fewer than {FEWEST} instruments none can stand out."
        return Section("Unlike the fleet", words, [])
    lead = (
        "z is the distance from the median in robust standard deviations of the fleet; what is "
        "listed would be there by chance in one fleet of a hundred."
    )
    spread = {d.name: d for d in table.distributions()}
    items = []
    for o in odd[:NAMED]:
        serial = table.rows[o.index].serial
        if o.name not in spread:
            items.append(("warning", f"{serial}: {o.name}, {o.value:.1f} times that of the fleet."))
            continue
        d = spread[o.name]
        unit, size = _unit(o.name, o.value)
        text = (
            f"{serial}: {o.name} is {plain(o.value / size, 4)} {shown(unit)}, z = {o.z:+.1f}; the "
            f"fleet has {plain(d.median / size, 3)} ± {plain(d.spread / size, 2)} {shown(unit)}."
        )
        items.append(("warning", text.replace(" -", " −")))
    blocks: list[Any] = [Items(items)]
    if len(odd) > NAMED:
        blocks.append(Text(f"{len(odd) - NAMED} more are in fleet.json."))
    return Section("Unlike the fleet", lead, blocks)


def _unit(name: str, value: float) -> tuple[str, float]:
    kind = LAYOUT.coefficients[LAYOUT.index(name)].kind
    unit = display_unit(kind, value)
    return unit, factor(unit, kind)


def _use(table: FleetTable) -> FloatArray:
    """Return the largest share of its limit that a coefficient of each instrument takes, (N,)."""
    if table.tolerance is None or not table.names:
        return np.full(len(table), np.nan)
    limit = table.tolerance.limits(table.names)[0]
    share = np.where(np.isfinite(table.values), np.abs(table.values), 0.0) / limit
    return np.asarray(np.where(table.good, share.max(axis=1), np.nan))


def _worst_first(table: FleetTable, odd: list[Outlying]) -> list[int]:
    """Return the numbers of the instruments, those that need a look first."""
    use, ratio, outcomes = _use(table), table.ratio, table.outcomes
    worst_z: dict[int, float] = {}
    for o in odd:
        worst_z[o.index] = max(worst_z.get(o.index, 0.0), abs(o.z))

    def rank(i: int) -> tuple[int, float, float, float]:
        share = float(np.nan_to_num(use[i]))
        noise = float(np.nanmax([*ratio[i], 0.0]))
        return ORDER.index(outcomes[i]), -worst_z.get(i, 0.0), -share, -noise

    return sorted(range(len(table)), key=rank)


def _attention(table: FleetTable, odd: list[Outlying], order: list[int]) -> Section | None:
    """List those that did not pass, so that nobody has to look for them."""
    outcomes = table.outcomes
    bad = [i for i in order if outcomes[i] != "pass"]
    if not bad:
        return None
    lead = "The worst first."
    if len(bad) > FEW:
        lead += f" {FEW} of {len(bad)}; the others are in the table of all instruments."
    return Section("Did not pass", lead, [_listed(table, odd, bad[:FEW], why=True)])


def _instruments(table: FleetTable, odd: list[Outlying], order: list[int]) -> Section:
    lead = "The worst first."
    if table.decisions is not None:
        lead += " Of limit: the largest coefficient over its limit."
    if np.isfinite(table.ratio).any():
        lead += " Residual: size of what the model leaves over what the noise explains."
    if len(table) > LISTED:
        lead += f" {LISTED} of {len(table)} are listed; all are in `fleet.parquet`."
    shown_ones = order[:LISTED]
    # A folder without reports has nothing to link to.
    return Section("Instruments", lead, [_listed(table, odd, shown_ones, why=False)])


def _listed(table: FleetTable, odd: list[Outlying], some: list[int], why: bool) -> Table:
    use, ratio, outcomes = _use(table), table.ratio, table.outcomes
    tolerance, tested = table.decisions is not None, bool(np.isfinite(ratio).any())
    rows = []
    for i in some:
        row = table.rows[i]
        cells = [LOOKS[outcomes[i]], Link.to(row.report, row.serial), outcomes[i]]
        cells += [_percent(use[i])] * tolerance
        cells += [_plain(ratio[i, 0]), _plain(ratio[i, 1])] * tested
        worst = _worst(table, i) if not why else _why(table, i, odd)
        rows.append([*cells, worst])
    columns = [Column("", "state"), Column("instrument", "link"), Column("outcome", "short")]
    columns += [Column("of limit", "number")] * tolerance
    if tested:
        columns += [Column(f"{t} residual", "number", aside=True) for t in ("accel", "gyro")]
    columns.append(Column("why") if why else Column("nearest to its limit", aside=True))
    if not why and not tolerance:
        columns, rows = columns[:-1], [row[:-1] for row in rows]
    return Table(columns, rows)


def _worst(table: FleetTable, i: int) -> str:
    """Return the coefficient that takes the largest share of its limit."""
    if table.tolerance is None or not table.good[i] or not table.names:
        return ""
    share = np.abs(table.values[i]) / table.tolerance.limits(table.names)[0]
    return table.names[int(np.nanargmax(np.nan_to_num(share)))]


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if np.isfinite(share) else ""


def _plain(value: float) -> str:
    return f"{value:.2f}" if np.isfinite(value) else ""


def _why(table: FleetTable, i: int, odd: list[Outlying], most: int = 3) -> str:
    row = table.rows[i]
    if row.problem is not None:
        return f"{row.problem.message} ({row.problem.code})"
    said = [f"{name} {word}" for name, word in table.misses(i)]
    words = [", ".join(said[:most]) + (f" and {len(said) - most} more" if said[most:] else "")]
    unlike = [o.name for o in odd if o.index == i]
    if unlike:
        more = f" and {len(unlike) - most} more" if unlike[most:] else ""
        words.append(f"unlike the fleet: {', '.join(unlike[:most])}{more}")
    words += [reason.partition(";")[0] for reason in row.reasons[:2]]
    return "; ".join(w.rstrip(".") for w in words if w)


def _summary(table: FleetTable) -> Section | None:
    found = table.distributions()
    if not found:
        return None
    rows = []
    widest: dict[str, float] = {}  # one unit for each family, so that it can be read down
    for d in found:
        family = d.name.rpartition(".")[0]
        widest[family] = max(widest.get(family, 0.0), d.spread)
    for d in found:
        unit, size = _unit(d.name, widest[d.name.rpartition(".")[0]])
        numbers = [d.median, d.spread, d.lowest, d.highest]
        cells = [format_value(v / size, d.spread / size / 10) for v in numbers]
        sd = plain(d.sd / size, 2) if np.isfinite(d.sd) else ""
        rows.append([d.name, *(c.replace("-", "−") for c in cells), sd, shown(unit)])
    columns = [
        Column("coefficient", "name"), Column("median", "number"), Column("spread", "number"),
        Column("lowest", "number", aside=True), Column("highest", "number", aside=True),
        Column("measured with sd", "number"), Column("unit", "short"),
    ]  # fmt: skip
    lead = (
        "Spread is that of the instruments (1.48 times the median distance from the median); the "
        "last number is the median uncertainty of one calibration. A spread that is not larger "
        "says that the instruments cannot be told apart."
    )
    return Section("Distributions in numbers", lead, [Table(columns, rows)])


def _tolerance(table: FleetTable) -> Section | None:
    if table.tolerance is None:
        return None
    rows = []
    limit, largest = table.tolerance.limits(table.names)
    for k, name in enumerate(table.names):
        if not np.isfinite(limit[k]) or table.decisions is None:
            continue
        unit, size = _unit(name, limit[k])
        decided = table.decisions[table.good, k]
        n = [int(np.sum(decided == d)) for d in (0, 2, 1)]
        sd = plain(largest[k] / size, 3) if np.isfinite(largest[k]) else ""
        state = "bad" if n[1] else ("warning" if n[2] else "good")
        rows.append([state, name, plain(limit[k] / size, 4), sd, shown(unit), *(str(x) for x in n)])
    columns = [
        Column("", "state"), Column("coefficient", "name"), Column("limit ±", "number"),
        Column("largest sd", "number", aside=True), Column("unit", "short"),
        Column("pass", "number"), Column("fail", "number"), Column("undecided", "number"),
    ]  # fmt: skip
    lead = (
        "Pass: |value| + 2 sd is not larger than the limit. Fail: |value| − 2 sd is. Between the "
        "two the measurement cannot tell (decision rule of ISO 14253-1)."
    )
    return Section("Tolerance", lead, [Table(columns, rows)])


def _about(about: Mapping[str, Any]) -> Section:
    made = about.get("provenance") or {}
    pairs = [
        ("procedure", str(about.get("procedure", ""))),
        ("solved in one batch", str(about.get("solved_in_batch", 0))),
        ("tolerance", str((about.get("tolerance") or {}).get("file", "none"))),
        ("created", str(made.get("created", ""))),
        ("seconds", str(made.get("seconds", ""))),
        ("SHA-256 of the campaign", str((about.get("campaign") or {}).get("sha256", ""))),
        ("versions", ends.words(made.get("versions") or {})),
    ]
    return ends.provenance(pairs)
