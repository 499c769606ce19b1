"""Runs kept for years: what was calibrated when, by whom, with what, and what became of it.

A run folder stays the truth of a calibration. What no folder holds - who judged a run, limits,
references and their due dates, repairs - is a list of entries that is only ever added to, each
with the hash of the one before (`entries`). Everything else in the database is an index of both
and can be made again from them (`Records.rebuild`) to the same content.
"""

from foucault.records.store import Records

__all__ = ["Records"]
