"""The report of a Monte Carlo study: are the errors as large as the uncertainties say?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from foucault.coefficients import format_value
from foucault.diagnose.study import Study
from foucault.infer.gauss_newton import chi_square_density
from foucault.models.layouts import kind_of
from foucault.report import chart, page
from foucault.result import Check, Level, Verdict

Rows = Sequence[Mapping[str, Any]]

BARS = 300  # Bars of a histogram at most: a page does not grow with the study [1].


def document(study: Study, about: Mapping[str, Any]) -> page.Document:
    """Return what there is to say of a study.

    `about`: what was asked: procedure, seed, version and n, the number of trials.
    """
    checks = study.checks()
    rows = study.rows() if len(study.nees) > 1 else []
    each = [_coefficients(rows), _spread(rows, len(study.nees))] if rows else []
    return page.Document.of(
        _heading(about, checks),
        page.checks(checks, page.told("study.checks.lead")),
        each,
        _nees(study),
        _coverage(rows) if rows else None,
        _endings(study.status),
        _about(about),
    )


def _heading(about: Mapping[str, Any], checks: tuple[Check, ...]) -> page.Heading:
    verdict = Verdict.of(checks)
    fine = f"All {len(checks)} checks passed: the errors are as large as the uncertainties say."
    line_ = [f"{about['n']} trials"] if "n" in about else []
    line_ += [f"seed {about['seed']}"] if "seed" in about else []
    level = verdict.level if any(c.name != "trials" for c in checks) else Level.UNUSABLE
    title = f"Monte Carlo study of {about.get('procedure', 'a procedure')}"
    return page.Heading(
        title, line_, page.STATES[level], page.WORDS[level], list(verdict.reasons) or [fine]
    )


def _coefficients(rows: Rows) -> page.Section | None:
    bound, key = any(np.isfinite(row["rms_over_bound"]) for row in rows), "study.coefficients"
    unit = [page.unit_of(kind_of(row["name"]), row["rms"]) for row in rows]

    def of(name: str) -> list[str]:
        pairs = zip(rows, unit, strict=True)
        return [page.minus(format_value(r[name] / one, r["rms"] / one)) for r, (_, one) in pairs]

    fine = [row["unbiased"] and row["consistent"] for row in rows]
    listed = page.table(
        (": state", ["good" if f else "warning" for f in fine]),
        ("coefficient: name", [row["name"] for row in rows]),
        ("mean error: number", of("mean")),
        ("RMS error: number", of("rms")),
        ("predicted sd: number", of("sd")),
        ("unit: short", [name for name, _ in unit]),
        ("RMS / sd: number", [f"{row['ratio']:.3f}" for row in rows]),
        (
            "RMS / bound: number",
            [f"{row['rms_over_bound']:.3f}" for row in rows] if bound else None,
        ),
        *(
            (f"in {p} %: number", [f"{100 * row[f'coverage_{p}']:.0f} %" for row in rows])
            for p in (68, 95)
        ),
    )
    low, high = rows[0]["ratio_low"], rows[0]["ratio_high"]
    return page.section(
        key,
        listed,
        lead=page.said(f"{key}.lead", f"{key}.bound" if bound else "", low=low, high=high),
    )


def _spread(rows: Rows, n: int) -> page.Section | None:
    first = rows[0]
    ratio = _against(
        rows, "ratio", (first["ratio_low"], first["ratio_high"]), 1.0, "RMS error / predicted sd"
    )
    limit = first["mean_z_limit"]
    mean = _against(rows, "mean_z", (-limit, limit), 0.0, "mean error / its sd")
    return page.section("study.spread", ratio, mean, count=n)


def _against(
    rows: Rows, key: str, limits: tuple[float, float], ideal: float, what: str
) -> page.Figure:
    """Draw one dot per coefficient with the limits it should keep."""
    names, values = [row["name"] for row in rows], np.array([row[key] for row in rows])
    inside = (values >= limits[0]) & (values <= limits[1])
    some = (inside, "inside", chart.FIRST, "circle"), (~inside, "outside", chart.BAD, "diamond")
    data = chart.parted(names, values, some, "%{y}: %{x:.3f}|")
    reach = 1.15 * max(abs(v - ideal) for v in (*values, *limits))
    return chart.draw(
        "study.against",
        data,
        height=80 + 22 * len(names),
        x=chart.axis(what, range=[ideal - reach, ideal + reach]),
        y=chart.names_axis(names),
        shapes=[*chart.shaded([limits]), chart.upright(ideal, "solid")],
        alt=f"{what} of every coefficient with limits",
    )


def _nees(study: Study) -> page.Section | None:
    """Histogram of NEES on the density it has where the covariance is right."""
    n, dof = len(study.nees), len(study.names)
    if n < 2:
        return None
    x = np.linspace(0.0, max(float(study.nees.max()), dof + 5 * np.sqrt(2 * dof)), 200)
    width = max(2.5 * np.sqrt(2 * dof) / n ** (1 / 3), float(x[-1]) / BARS)
    counts, edges = np.histogram(study.nees, np.arange(0.0, x[-1] + width, width), density=True)
    bars = {
        "type": "bar",
        "name": f"{n} trials",
        "x": chart.numbers((edges[:-1] + edges[1:]) / 2),
        "y": chart.numbers(counts),
        "width": float(f"{width:.3g}"),
        "marker": {"color": chart.FIRST, "opacity": 0.55},
        "hovertemplate": "NEES %{x}: %{y:.3g}<extra></extra>",
    }
    density = chart.line(
        f"chi-square, {dof} degrees of freedom",
        x,
        chi_square_density(x, dof),
        chart.SECOND,
        width=2.2,
    )
    return page.section("study.nees", chart.draw("study.nees", [bars, density]))


def _coverage(rows: Rows) -> page.Section | None:
    names = [row["name"] for row in rows]
    data = [
        chart.dots(
            f"{percent} % interval",
            np.array([100 * row[f"coverage_{percent}"] for row in rows]),
            names,
            colour,
            "%{y}: %{x:.1f} %|",
            size=9,
            symbol=symbol,
            cliponaxis=False,
        )  # 100 % is at the very edge
        for percent, colour, symbol in ((68, chart.FIRST, "circle"), (95, chart.SECOND, "diamond"))
    ]
    figure = chart.draw(
        "study.coverage",
        data,
        height=100 + 22 * len(names),
        y=chart.names_axis(names),
        shapes=[chart.upright(68.0, "solid"), chart.upright(95.0, "solid")],
    )
    return page.section("study.coverage", figure)


def _endings(status: Mapping[str, int]) -> page.Section | None:
    total = max(sum(status.values()), 1)
    order = dict(sorted(status.items(), key=lambda item: -item[1]))
    return page.section(
        "study.endings",
        page.table(
            (": state", ["good" if kind == "converged" else "warning" for kind in order]),
            ("status", order),
            ("trials: number", [f"{n}" for n in order.values()]),
            ("share: number", [f"{100 * n / total:.1f} %" for n in order.values()]),
        ),
    )


def _about(about: Mapping[str, Any]) -> page.Section:
    names = {
        "procedure": "procedure",
        "n": "trials",
        "seed": "seed",
        "left_out": "held beside the model",
        "version": "foucault",
        "campaign_sha256": "SHA-256 of the campaign",
    }
    known = [(what, str(about[k])) for k, what in names.items() if about.get(k) is not None]
    return page.provenance(known)
