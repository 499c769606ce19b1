"""What records say of a coefficient, as people read it: on a screen and on a page."""

from __future__ import annotations

import datetime
import math

from foucault.coefficients import format_value
from foucault.records.history import Outlook
from foucault.report.page import unit_of

HEADINGS = ("coefficient", "now", "sd", "unit", "course", "per year", "repeats to", "when due",
            "limit", "within")  # fmt: skip
"""Of `row`; the last two only where there are limits."""

WORDS = {"pass": "fit for use", "doubtful": "look at it", "unusable": "not to be used"}
"""Level of an instrument -> in words."""


def row(o: Outlook) -> tuple[str, ...]:
    """Return the cells of a coefficient, in the unit that people read."""
    unit, one = unit_of(o.kind, o.value, o.sd)

    def shown(value: float, sd: float) -> str:
        return "-" if math.isnan(value) else format_value(value / one, sd / one)

    def pair(value: float, sd: float) -> str:
        return f"{shown(value, sd)} ± {shown(sd, sd)}"

    drift = "-" if math.isnan(o.drift_sd) else pair(o.drift, o.drift_sd)
    due = "-" if math.isnan(o.due_value) else pair(o.due_value, o.due_sd)
    within = "" if math.isnan(o.conformity) else f"{o.decision}, {100 * o.conformity:.4g} %"
    return (
        o.name, shown(o.value, o.sd), shown(o.sd, o.sd), unit, o.how, drift,
        shown(o.repeatability, o.sd), due,
        "-" if math.isinf(o.limit) else f"±{o.limit / one:.4g}", within,
    )  # fmt: skip


def day(time: float) -> str:
    """Return the day of a `time`: since 1970 [s]."""
    return f"{datetime.datetime.fromtimestamp(time, datetime.UTC):%Y-%m-%d}"
