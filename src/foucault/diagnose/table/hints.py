"""Findings about a session on a table: outliers, a wrong reference, terms that the model lacks."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from foucault.diagnose.table.checks import QUADRATIC, name_of, reading_name, rest_slope
from foucault.errors import Finding, finding
from foucault.estimate.table.fit import TableFit
from foucault.estimate.table.likelihood import FORCES
from foucault.infer import mixed
from foucault.result import Check
from foucault.tables import AXES
from foucault.units import plain


def hints(e: TableFit, checks: Iterable[Check]) -> list[Finding]:
    """Return findings about the session: outliers, scatter, a wrong g.

    `checks`: of the same fit.
    """
    left_out = any(c.name == QUADRATIC and not c.passed for c in checks)
    out = []
    for row in e.fit.outliers:
        what = name_of(e.model.readings, int(e.model.rows[row]))
        size = np.sqrt(e.snooping.test[row] / max(e.estimate.weights[row], 1e-12))
        out.append(finding("readings.outlier", what=what, size=f"{size:.0f}"))
    out += _wrong_angles(e)
    c = e.estimate.coefficients
    for code, triad in (("session.common_scale", "accel"), ("readings.common_rate", "gyro")):
        if f"{triad}.scale.x" not in c.layout:
            continue
        values = c[f"{triad}.scale"].values
        mean = float(values.mean())
        if abs(mean) > COMMON and float(np.ptp(values)) < abs(mean) / 3:
            words = {"ppm": f"{mean * 1e6:.0f}", "gravity": f"{e.model.site.gravity:.5f}"}
            out.append(finding(code, **words))
    return out + _g_sensitivity(e) + (_quadratic(e) if left_out else [])


def _wrong_angles(e: TableFit) -> list[Finding]:
    """Name the angles of the table that are far off, as the readings tell them."""
    g, out = e.estimate.state.geometry, []
    for j in e.wrong_angles:
        off = np.degrees(g.position[j])  # true angle minus the one that is said
        large = [k for k in (0, 1) if abs(off[k]) > 0.2 * np.abs(off).max()]
        words = " and ".join(
            f"{('middle', 'inner')[k]} angle is about {plain(abs(float(off[k])), 2)} deg off "
            f"(said {plain(float(np.degrees(g.readings_angles[j, k + 1])), 4)}, found "
            f"{plain(float(np.degrees(g.readings_angles[j, k + 1]) + off[k]), 4)} deg)"
            for k in large
        )
        out.append(finding("table.angle", reading=reading_name(e.model.readings, j), how=words))
    return out


COMMON = 1500e-6
"""All three scale factor errors alike and larger than this look like a wrong reference [1]."""


def _g_sensitivity(e: TableFit) -> list[Finding]:
    """Tell of rates at rest that depend on orientation."""
    found = rest_slope(e)
    if found is None or not found.significant:
        return []
    size, shift = f"{np.degrees(found.slope) * 3600:.0f}", f"{found.shift * 1e6:.0f}"
    return [finding("readings.g_sensitivity", size=size, shift=shift)]


def _quadratic(e: TableFit) -> list[Finding]:
    """Try whether quadratic terms explain what the noise does not."""
    o, names = e.model.options, tuple(f"accel.quadratic.{a}" for a in AXES)
    before = [c for k, c in e.fit.before.items() if k.startswith("accel")]
    square = sum(c.chi_square for c in before)
    left = sum(c.redundancy for c in before) - len(names)
    if FORCES not in e.scatter or names[0] in o.names or left < 5 or o.prior is not None:
        return []
    more = replace(e.model, options=replace(o, names=(*o.names, *names)))
    after = mixed.solve(more, near=e.estimate.state).after
    remains = sum(c.chi_square for k, c in after.items() if k.startswith("accel"))
    if remains / left > 0.2 * square / (left + len(names)):
        return []
    return [finding("readings.quadratic", share=f"{100 * (1 - remains / square):.0f}")]
