"""How a campaign describes the log of a systematic calibration."""

from __future__ import annotations

from pathlib import Path

from foucault.tables import Log

LOG_TABLE = Path(__file__).with_name("log.toml").read_text(encoding="utf-8")
"""[log] of the template."""

INCREMENTS_TABLE = """\
[log]
file = "log.csv"                        # relative to this file; it says itself what it holds
"""
"""[log] of a simulated log: means over the intervals."""


def log_table(log: Log | None = None) -> str:
    """Write the table [log] of the template, or for a simulated `log` [SI]."""
    return LOG_TABLE if log is None else INCREMENTS_TABLE
