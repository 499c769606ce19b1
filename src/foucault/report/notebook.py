"""Results, logs, coefficients and checks as they show in a notebook: HTML without a script."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

import numpy as np

from foucault import tables
from foucault.coefficients import CoefficientVector
from foucault.errors import error, suggestion
from foucault.report import calibration, of_result
from foucault.report.page import WORDS, Figure, checks, counted, known_to, minus, shown, size
from foucault.report.still import svg
from foucault.result import Check, Result, Verdict
from foucault.tables import AXES, Log
from foucault.units import convert

_LIGHT = (
    "--paper:#fff;--card:#fff;--ink:#16191d;--soft:#5a626c;--faint:#8b939d;--line:#e2e5e9;"
    "--first:#2a6fc9;--second:#b5631c;--third:#3f8f5b;--fourth:#8a56b8;--fifth:#a37f10;"
    "--sixth:#7b8794;--band:rgba(42,111,201,.16);--second-band:rgba(181,99,28,.14);"
    "--rest:rgba(42,111,201,.13);--good:#1a7838;--warning:#935b00;--bad:#c22b2b;--low:#2a6fc9;"
    "--zero:#f4f5f6;--high:#c22b2b;--sphere:#c9d0d8"
)
_DARK = (
    "--ink:#eceff2;--soft:#a9b2bc;--faint:#78828d;--line:#2c323a;--first:#6aa9f7;--second:#e6a066;"
    "--third:#7fcf9b;--fourth:#c39bea;--fifth:#e3c358;--sixth:#97a3b0;--card:#191d22;"
    "--good:#5cc980;--warning:#f0b648;--bad:#f47c7c;--low:#6aa9f7;--zero:#22272e;--high:#f47c7c"
)
_STYLE = (
    f"<style>.foucault{{{_LIGHT};color:var(--ink)}}"
    f"[data-jp-theme-light=false] .foucault{{{_DARK}}}"
    f"@media(prefers-color-scheme:dark){{body:not([data-jp-theme-light]) .foucault{{{_DARK}}}}}"
    ".foucault th,.foucault td{text-align:left}.foucault .number{text-align:right}"
    ".foucault svg{width:100%}</style>"
)

LONG = 12  # Rows of a table that a result shows before it is folded [1].


def html(thing: Any) -> str:
    """Return a thing as HTML."""
    if isinstance(thing, Result):
        body = _result(thing)
    elif isinstance(thing, CoefficientVector):
        body = _coefficients(thing)
    elif isinstance(thing, Log):
        body = _log(thing)
    elif isinstance(thing, Verdict):
        body = _verdict(thing)
    elif isinstance(thing, Check):
        body = _checks([thing])
    else:
        body = svg(thing)
        if thing.caption:
            body += f"<p>{escape(thing.caption)}</p>"
    return f'{_STYLE}<div class="foucault">{body}</div>'


def figures(result: Result) -> dict[str, Figure]:
    """Return the flat figures of a result by name: their section, and a number from the second."""
    out: dict[str, Figure] = {}
    for one in of_result(result).sections:
        drawn = [b for b in one.blocks if isinstance(b, Figure) and "scene" not in b.layout]
        for k, figure in enumerate(drawn, 1):
            out[one.key.rpartition(".")[2] + (f"_{k}" if k > 1 else "")] = figure
    return out


def plot(result: Result, name: str) -> Figure:
    """Return the figure of a result that is called `name`."""
    known = figures(result)
    if name not in known:
        hint = suggestion(name, known)
        allowed = ", ".join(known) or "none: this result has no figure"
        raise error("result.no_figure", given=name, hint=hint, allowed=allowed)
    return known[name]


def dataframe(result: Result, name: str) -> Any:
    """Return a table of a result, or its coefficients, as a DataFrame with units in `attrs`."""
    import pandas as pd

    if name == "coefficients":
        rows = pd.DataFrame(result.coefficients.rows()).set_index("name")
        rows.attrs["units"] = dict(rows["unit"])
        return rows
    if name not in result.tables:
        allowed = ", ".join(["coefficients", *result.tables])
        hint = suggestion(name, result.tables)
        raise error("result.no_table", given=name, hint=hint, allowed=allowed)
    declared = tables.declared(name)
    made = pd.DataFrame({k: np.asarray(v) for k, v in result.tables[name].items()})
    made.attrs["units"] = {c.name: c.unit for c in declared if c.name in made}
    return made


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]], right: Sequence[int] = ()) -> str:
    def cells(tag: str, row: Sequence[str]) -> str:
        return "".join(
            f"<{tag}{' class=number' if i in right else ''}>{escape(cell)}</{tag}>"
            for i, cell in enumerate(row)
        )

    body = "".join(f"<tr>{cells('td', row)}</tr>" for row in rows)
    return f"<table><thead><tr>{cells('th', heads)}</tr></thead><tbody>{body}</tbody></table>"


def _folded(title: str, inside: str, opened: bool = False) -> str:
    tag = "details open" if opened else "details"
    return f"<{tag}><summary>{escape(title)}</summary>{inside}</details>"


def _coefficients(vector: CoefficientVector) -> str:
    rows = []
    for row in vector.rows():
        value = known_to(row["display_value"], row["display_sd"])
        unit = shown(row["display_unit"])
        rows.append([row["name"], value, size(row["display_sd"]), unit, row["meaning"]])
    return _table(("coefficient", "value", "± sd", "unit", "meaning"), rows, right=(1, 2))


def _verdict(verdict: Verdict) -> str:
    state = {"pass": "good", "doubtful": "warning", "unusable": "bad"}[verdict.level]
    word = f'<b style="color:var(--{state})">{WORDS[verdict.level]}</b>'
    return word + "".join(f"<br>{escape(reason)}" for reason in verdict.reasons)


def _checks(some: Sequence[Check]) -> str:
    told = checks(some)
    if told is None:
        return ""
    words = {"good": "ok", "warning": "!", "bad": "!!"}
    rows = [[words[row[0]], *row[1:]] for row in told.blocks[0].rows]  # type: ignore[union-attr]
    return _table(("", "check", "value", "limits", "what it says"), rows, right=(2, 3))


def _result(result: Result) -> str:
    head = calibration.heading(result)
    title = f"<b>{escape(head.title)}</b><br>{escape(' · '.join(head.line))}<br>"
    found = "".join(f"<li>{escape(f.message)} {escape(f.cure)}</li>" for f in result.findings)
    known = len(result.coefficients)
    parts = [
        title + _verdict(result.verdict),
        _folded(counted(known, "coefficient"), _coefficients(result.coefficients), known <= LONG),
        _folded(counted(len(result.checks), "check"), _checks(result.checks)),
        _folded(counted(len(result.findings), "finding"), f"<ul>{found}</ul>") if found else "",
    ]
    return "".join(parts)


def _log(log: Log) -> str:
    rows = []
    for triad, kind, unit in (("accel", "gravity", "m/s^2"), ("gyro", "angular rate", "deg/s")):
        x = getattr(log, triad)
        for i in () if x is None else log.logged(triad):
            numbers = (np.nanmean(x[:, i]), np.nanstd(x[:, i]), np.nanmin(x[:, i]),
                       np.nanmax(x[:, i]))  # fmt: skip
            cells = [minus(f"{convert(float(v), kind, unit):.4g}") for v in numbers]
            rows.append([f"{triad} {AXES[i]}", *cells, shown(unit)])
    every = "means" if log.averaged is not None else f"samples, {log.rate:.6g} Hz"
    head = f"<b>Log</b> {len(log)} {every}, {log.duration:.6g} s<br>"
    return head + _table(("axis", "mean", "sd", "min", "max", "unit"), rows, right=(1, 2, 3, 4))
