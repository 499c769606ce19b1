"""The section of a merged result: what each session said beside what they say together."""

from __future__ import annotations

from foucault.coefficients import format_value
from foucault.report.page import Column, Section, Table
from foucault.report.uncertainty import shown
from foucault.result import Result
from foucault.units import factor, plain


def merged(result: Result) -> Section | None:
    """Return one row per coefficient, one column per result, the merged one last."""
    table = result.tables.get("merged")
    if table is None:
        return None
    names = list(dict.fromkeys(table["result"].tolist()))
    said = {
        (c, r): (value, sd)
        for c, r, value, sd in zip(*(table[k].tolist() for k in ("coefficient", "result", "value",
                                                                "sd")), strict=True)
    }  # fmt: skip
    rows = []
    for row in result.coefficients.rows():
        unit = factor(row["display_unit"], row["kind"])
        cells = []
        for name in names:
            value, sd = said.get((row["name"], name), (None, 0.0))
            if value is None:
                cells.append("")
            else:
                text = format_value(value / unit, sd / unit).replace("-", "−")
                cells.append(f"{text} ± {plain(sd / unit, 2)}")
        rows.append([row["name"], *cells, shown(row["display_unit"])])
    columns = [
        Column("coefficient", "name"),
        *(Column(n, "number") for n in names),
        Column("unit", "short"),
    ]
    return Section(
        "Sessions merged", "What each result says, with its standard deviation, and all together.",
        [Table(columns, rows)],
    )  # fmt: skip
