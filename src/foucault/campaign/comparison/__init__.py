"""Results compared: one instrument over time, or several instruments, and whether they keep limits.

Results of one instrument are compared with one another; of several instruments the latest result of
each. See `diagnose.compare.changes` for the tests and `campaign.tolerance` for the limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np

from foucault.campaign.comparison import verdict as verdicts
from foucault.campaign.comparison.entries import ONE, entries
from foucault.campaign.comparison.verdict import Decision, Judged, Verdict
from foucault.campaign.tolerance import Tolerance
from foucault.diagnose.compare.changes import History, history
from foucault.diagnose.compare.comparable import (
    Comparable,
    Entry,
    comparable,
    listed,
    refuse_dependent,
)
from foucault.diagnose.compare.instruments import Between, between
from foucault.diagnose.compare.temperature import at_one_temperature
from foucault.errors import Finding, finding
from foucault.models.layouts import EVERY
from foucault.units import plain


@dataclass(frozen=True)
class Comparison:
    """Results and what comparing them has shown."""

    entries: tuple[Entry, ...]  # the results, by instrument and in time [SI]
    instruments: tuple[Judged, ...]  # each instrument with its results
    between: Between | None  # the instruments compared with one another, where there are several
    shared: Comparable | None  # what all of them have in common, where there are several
    decisions: tuple[Decision, ...]  # what the tolerance says; empty without one
    tolerance: Tolerance | None
    verdict: Verdict  # pass, doubtful or fail, and why
    findings: tuple[Finding, ...]  # what the user should know


def run(
    paths: Sequence[str | Path], *, dates: str = "", same: bool = False,
    tolerance: Tolerance | None = None,
) -> Comparison:  # fmt: skip
    """Compare results.

    `paths`: run folders, result.json files, or TOML files that list them, two results or more;
    `dates`: dates of the results, separated by commas, an empty one keeps what is known; `same`:
    whether all are of one instrument, whatever they say; `tolerance`: limits of values, changes
    and drifts, None decides on changes by chance alone. Returns what was found [SI].
    """
    return of(entries(paths, dates, same=same), tolerance)


def of(read: Sequence[Entry], tolerance: Tolerance | None = None) -> Comparison:
    """Compare results that were read, in the order of `comparison_entries.entries`.

    `read`: two results or more [SI]; `tolerance` or None: limits of values, changes and drifts.
    """
    refuse_dependent(read)
    read, taken = at_one_temperature(read)
    groups = [(name, list(mine)) for name, mine in groupby(read, lambda e: e.instrument)]
    if tolerance is not None:
        every = {name for e in read for name in e.result.coefficients.names}
        tolerance.refuse_unknown([n for n in EVERY.names if n in every], "the results")
    instruments, found = [], taken
    found += _dates([e for _, mine in groups if len(mine) > 1 for e in mine])
    for name, mine in groups:
        together = comparable(mine) if len(mine) > 1 else None
        past = None if together is None else history(together.series)
        found += [] if together is None else together.findings
        found += [] if past is None else _too_alike(name, past)
        instruments.append(Judged(name, tuple(mine), together, past))
    shared = comparable([mine[-1] for _, mine in groups]) if len(groups) > 1 else None
    side = None if shared is None else between(shared.series)
    found += [] if shared is None else shared.findings
    decisions = verdicts.decisions(instruments, tolerance)
    told = tuple(dict.fromkeys(found))
    verdict = verdicts.of(instruments, side, decisions, told)
    return Comparison(
        tuple(read), tuple(instruments), side, shared, decisions, tolerance, verdict, told
    )


def _dates(read: Sequence[Entry]) -> list[Finding]:
    found = []
    if any(e.instrument == ONE for e in read):
        found.append(finding("compare.unnamed"))
    unknown = [e.label for e in read if not np.isfinite(e.time)]
    if unknown:
        found.append(finding("compare.undated", names=listed(unknown)))
    computed = [e.label for e in read if e.dated == "computed"]
    if computed:
        found.append(finding("compare.computed", names=listed(computed)))
    return found


def _too_alike(name: str, past: History) -> list[Finding]:
    if past.chi_square >= past.low:
        return []
    given = plain(past.chi_square, 3)
    return [finding("compare.too_alike", name=name, given=given, dof=past.dof)]
