"""The report of a Monte Carlo study: are the errors as large as the uncertainties say?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from foucault.coefficients import format_value
from foucault.diagnose.study import Study
from foucault.estimate.chi_square import chi_square_density
from foucault.files import atomic
from foucault.models.layouts import kind_of
from foucault.report import ends, figures, render
from foucault.report.ends import STATES, WORDS, Heading, check_table
from foucault.report.page import Column, Figure, Section, Table
from foucault.report.uncertainty import shown
from foucault.result import Check, Level, Verdict
from foucault.units import display_unit, factor

Rows = Sequence[Mapping[str, Any]]


def write(study: Study, about: Mapping[str, Any], path: str | Path) -> Path:
    """Write one self-contained HTML file.

    `study`: the trials [SI]; `about`: what was asked: procedure, seed, version and n, the number
    of trials.
    """
    path = Path(path)
    with atomic(path) as temporary:
        temporary.write_text(html(study, about), encoding="utf-8")
    return path


def html(study: Study, about: Mapping[str, Any]) -> str:
    """Return the report of `study` as HTML."""
    checks = study.checks()
    rows = study.rows() if len(study.nees) > 1 else []
    made = [
        _checks(checks),
        _coefficients(rows),
        _spread(rows, len(study.nees)),
        _nees(study),
        _coverage(rows),
        _endings(study.status),
        _about(about),
    ]
    return render(_heading(about, checks), [section for section in made if section is not None])


def _heading(about: Mapping[str, Any], checks: tuple[Check, ...]) -> Heading:
    verdict = Verdict.of(checks)
    reasons = list(verdict.reasons) or [
        f"All {len(checks)} checks passed: the errors are as large as the uncertainties say."
    ]
    line = [f"{about['n']} trials"] if "n" in about else []
    line += [f"{key} {about[key]}" for key in ("seed",) if key in about]
    level = verdict.level if any(c.name != "trials" for c in checks) else Level.UNUSABLE
    title = f"Monte Carlo study of {about.get('procedure', 'a procedure')}"
    return Heading(title, line, STATES[level], WORDS[level], reasons)


def _checks(checks: tuple[Check, ...]) -> Section:
    lead = "Limits are two-sided; a study that is right fails each of them once in a hundred."
    return Section("Checks", lead, [check_table(checks)])


def _coefficients(rows: Rows) -> Section | None:
    if not rows:
        return None
    bound = any(np.isfinite(row["rms_over_bound"]) for row in rows)
    columns = [
        Column("", "state"),
        Column("coefficient", "name"),
        Column("mean error", "number"),
        Column("RMS error", "number"),
        Column("predicted sd", "number"),
        Column("unit", "short"),
        Column("RMS / sd", "number"),
        *([Column("RMS / bound", "number")] if bound else []),
        Column("in 68 %", "number"),
        Column("in 95 %", "number"),
    ]
    cells = [_row(row, bound) for row in rows]
    low, high = rows[0]["ratio_low"], rows[0]["ratio_high"]
    lead = (
        "Errors (estimate minus truth) of all trials. RMS / sd is 1 where the predicted standard "
        f"deviation is right; its limits here are {low:.3f} to {high:.3f}."
    )
    if bound:
        lead += " RMS / bound compares with the Cramér-Rao bound of the sensor noise alone; "
        lead += "what else is uncertain, such as gravity, brings it above 1."
    return Section("Error of every coefficient", lead, [Table(columns, cells)])


def _row(row: Mapping[str, Any], bound: bool) -> list[str]:
    kind = kind_of(row["name"])
    unit = display_unit(kind, row["rms"])
    size = factor(unit, kind)
    rms, sd = row["rms"] / size, row["sd"] / size
    fine = row["unbiased"] and row["consistent"]
    mean = format_value(row["mean"] / size, rms).replace("-", "−")
    return [
        "good" if fine else "warning",
        row["name"],
        mean,
        format_value(rms, rms),
        format_value(sd, rms),
        shown(unit),
        f"{row['ratio']:.3f}",
        *([f"{row['rms_over_bound']:.3f}"] if bound else []),
        f"{100 * row['coverage_68']:.0f} %",
        f"{100 * row['coverage_95']:.0f} %",
    ]


def _spread(rows: Rows, n: int) -> Section | None:
    if not rows:
        return None
    lead = (
        f"First: root mean square error of {n} trials over the predicted standard deviation, which "
        "should be 1. Second: mean error over its own standard deviation, which should be 0. "
        "Shaded: limits for all coefficients together at 1 % false alarm."
    )
    names = [row["name"] for row in rows]
    limit = rows[0]["mean_z_limit"]
    ratio = _against(
        names, [r["ratio"] for r in rows], (rows[0]["ratio_low"], rows[0]["ratio_high"]), 1.0,
        "RMS error / predicted sd",
    )  # fmt: skip
    mean = _against(
        names, [r["mean_z"] for r in rows], (-limit, limit), 0.0, "mean error / its sd",
    )  # fmt: skip
    return Section("Errors against predicted uncertainty", lead, [ratio, mean])


def _against(
    names: Sequence[str],
    values: Sequence[float],
    limits: tuple[float, float],
    ideal: float,
    what: str,
) -> Figure:
    """Draw one dot per coefficient with the limits it should keep."""
    low, high = limits
    inside = np.array([low <= v <= high for v in values])
    data = [
        {
            "type": "scatter",
            "mode": "markers",
            "name": name,
            "y": [n for n, p in zip(names, pick, strict=True) if p],
            "x": figures.numbers(np.asarray(values)[pick]),
            "marker": {"color": colour, "symbol": symbol, "size": 9},
            "hovertemplate": "%{y}: %{x:.3f}<extra></extra>",
        }
        for pick, colour, symbol, name in (
            (inside, figures.FIRST, "circle", "inside"),
            (~inside, figures.BAD, "diamond", "outside"),
        )
        if pick.any()
    ]
    reach = 1.15 * max(abs(v - ideal) for v in (*values, *limits))
    look = figures.layout(
        80 + 22 * len(names),
        xaxis=figures.axis(what, range=[ideal - reach, ideal + reach]),
        yaxis=_name_axis(names),
        shapes=[_band(low, high), _upright(ideal)],
        showlegend=False,
    )
    look["margin"] = look["margin"] | {"t": 10}
    return Figure(data, look, share=50, alt=f"{what} of every coefficient with limits")


def _name_axis(names: Sequence[str]) -> dict[str, Any]:
    """An axis of coefficients, the first on top."""
    return {
        "type": "category", "categoryorder": "array", "categoryarray": list(reversed(names)),
        "tickmode": "linear", "ticks": "", "tickfont": {"size": 11.5},
    }  # fmt: skip


def _band(low: float, high: float) -> figures.Trace:
    return {
        "type": "rect", "layer": "below", "yref": "paper", "y0": 0, "y1": 1, "x0": low, "x1": high,
        "fillcolor": "var(--band)", "line": {"width": 0},
    }  # fmt: skip


def _upright(x: float) -> figures.Trace:
    line = {"color": figures.SOFT, "width": 1.3}
    return {
        "type": "line", "yref": "paper", "y0": 0, "y1": 1, "x0": x, "x1": x, "line": line,
    }  # fmt: skip


def _nees(study: Study) -> Section | None:
    """Histogram of NEES on the density it has where the covariance is right."""
    n, dof = len(study.nees), len(study.names)
    if n < 2:
        return None
    x = np.linspace(0.0, max(float(study.nees.max()), dof + 5 * np.sqrt(2 * dof)), 200)
    width = 2.5 * np.sqrt(2 * dof) / n ** (1 / 3)
    data = [
        {
            "type": "histogram",
            "name": f"{n} trials",
            "x": figures.numbers(study.nees),
            "histnorm": "probability density",
            "xbins": {"start": 0, "size": float(f"{width:.3g}"), "end": float(x[-1] + width)},
            "marker": {"color": figures.FIRST, "opacity": 0.55},
            "hovertemplate": "NEES %{x}: %{y:.3g}<extra></extra>",
        },
        {
            "type": "scatter",
            "mode": "lines",
            "name": f"chi-square, {dof} degrees of freedom",
            "x": figures.numbers(x),
            "y": figures.numbers(chi_square_density(x, dof)),
            "line": {"color": figures.SECOND, "width": 2.2},
            "hoverinfo": "skip",
        },
    ]
    look = figures.layout(
        340, xaxis=figures.axis("NEES"), yaxis=figures.axis("density"), bargap=0.04,
        showlegend=True,
    )  # fmt: skip
    alt = "Histogram of NEES over the trials with the chi-square density"
    lead = (
        "Normalised estimation error squared of every trial: all errors together, weighed with "
        "the covariance that was predicted. Too far right: the uncertainties are too small."
    )
    return Section("NEES", lead, [Figure(data, look, alt=alt)])


def _coverage(rows: Rows) -> Section | None:
    if not rows:
        return None
    names = [row["name"] for row in rows]
    data = [
        {
            "type": "scatter",
            "mode": "markers",
            "name": f"{percent} % interval",
            "y": names,
            "x": figures.numbers([100 * row[f"coverage_{percent}"] for row in rows]),
            "marker": {"color": colour, "symbol": symbol, "size": 9},
            "cliponaxis": False,  # 100 % is at the very edge
            "hovertemplate": "%{y}: %{x:.1f} %<extra></extra>",
        }
        for percent, colour, symbol in (
            (68, figures.FIRST, "circle"),
            (95, figures.SECOND, "diamond"),
        )
    ]
    look = figures.layout(
        100 + 22 * len(names),
        xaxis=figures.axis("truths inside [%]", range=[40, 101.5]),
        yaxis=_name_axis(names),
        shapes=[_upright(68.0), _upright(95.0)],
        showlegend=True,
    )
    lead = "How often the truth lay inside the interval. Lines: 68 % and 95 %."
    alt = "Share of trials whose interval holds the truth, for every coefficient"
    return Section("Coverage", lead, [Figure(data, look, alt=alt)])


def _endings(status: Mapping[str, int]) -> Section:
    total = max(sum(status.values()), 1)
    order = sorted(status.items(), key=lambda item: -item[1])
    rows = [
        ["good" if kind == "converged" else "warning", kind, f"{n}", f"{100 * n / total:.1f} %"]
        for kind, n in order
    ]
    columns = [
        Column("", "state"),
        Column("status"),
        Column("trials", "number"),
        Column("share", "number"),
    ]
    return Section("How the trials ended", "", [Table(columns, rows)])


def _about(about: Mapping[str, Any]) -> Section:
    words = {
        "procedure": "procedure",
        "n": "trials",
        "seed": "seed",
        "version": "foucault",
        "campaign_sha256": "SHA-256 of the campaign",
    }
    pairs = [(what, str(about[key])) for key, what in words.items() if about.get(key) is not None]
    return ends.provenance(pairs)
