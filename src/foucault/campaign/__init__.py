"""The campaign file: one TOML file that says what was measured, where, with what, and how.

``[instrument] [site] [log] [procedure] [noise] [prior] [simulate]``. The common tables are here;
the settings of a procedure live with the procedure, the description of a log with the readers.
Text with a unit becomes an SI float while the file is read; nothing after it knows units.
"""

from __future__ import annotations

from foucault.campaign.reading import Campaign, load, parse, said_otherwise, schema
from foucault.campaign.running import calibrate, read_log, save_session, simulate
from foucault.campaign.writing import resolved, template

__all__ = [
    "Campaign",
    "calibrate",
    "load",
    "parse",
    "read_log",
    "resolved",
    "said_otherwise",
    "save_session",
    "schema",
    "simulate",
    "template",
]
