"""Whether the gyros bend, and by which model: all models side by side."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from foucault.report.page import Column, Section, Table, Text
from foucault.result import Result

ARCSEC_PER_G = float(np.radians(1.0 / 3600.0) / 9.80665)

COLUMNS = (
    Column("", "state"),
    Column("model"),
    Column("seen", "number"),
    Column("log-likelihood", "number", aside=True),
    Column("by chance", "number", aside=True),
    Column("log odds", "number"),
    Column("none above [″/g]", "number", aside=True),
    Column("verdict"),
)


def deflection(result: Result) -> Section | None:
    """Every model of deflection, how well it explains the session, and what is used."""
    choice = result.diagnostics.get("choice")
    if not choice:
        return None
    used = next(m for m in choice["models"] if m["used"])
    rows = [_row(m, used, choice) for m in choice["models"]]
    notes = Text(
        "Seen: combinations of the parameters that the session tells better than 3 ″/g. "
        "Log-likelihood: the gain by the best values of these over no deflection; by chance: "
        "probability of so much where nothing bends. Log odds: logarithm of how many times "
        "likelier the readings are with the model than with the one used, averaged over its "
        f"parameters; above {choice['limit']:.1f} the other is to be believed."
    )
    return Section("Do the gyros bend", choice["verdict"], [Table(COLUMNS, rows), notes])


def _row(m: Mapping[str, Any], used: Mapping[str, Any], choice: Mapping[str, Any]) -> list[str]:
    odds = m["log_odds"] - used["log_odds"]
    seen = f"{m['rank']} of {m['parameters']}" if m["parameters"] else ""
    bound = "" if m["bound"] is None else f"{m['bound'] / ARCSEC_PER_G:.2g}"
    chance = m["chance"]
    return [
        "good" if m["used"] else "plain", m["label"], seen, f"{m['log_likelihood']:.1f}",
        "" if chance is None else "< 1e-99" if chance < 1e-99 else f"{chance:.2g}",
        f"{odds:+.1f}".replace("-", "−"), bound, _words(m, odds, choice),
    ]  # fmt: skip


def _words(m: Mapping[str, Any], odds: float, choice: Mapping[str, Any]) -> str:
    if m["used"]:
        return "used"
    bends = choice["chance"] < choice["false_alarm"]
    if m["model"] == "none":
        return "ruled out" if bends else "as good"
    if not bends:
        return "not needed"
    words = "better" if odds > choice["limit"] else "ruled out"
    if abs(odds) <= choice["limit"]:
        words = "not ruled out"
    return words if m["usable"] else f"{words}; not seen whole"
