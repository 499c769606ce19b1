"""Early warnings: what looks wrong in a log while there is still time to mend it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.diagnose import axes
from foucault.diagnose.first_rest import first_rest_orientation
from foucault.diagnose.live.checklist import up_of
from foucault.diagnose.live.rests import LiveRests
from foucault.diagnose.rests import turning
from foucault.diagnose.spikes import told_of
from foucault.errors import Finding, FoucaultError, finding
from foucault.logs import axes as log_axes
from foucault.logs import checks
from foucault.logs.reading import implausible
from foucault.tables import Log

if TYPE_CHECKING:
    from foucault.logs.description import LogDescription, Triad

EVERY, SPAN = 2.0, 30.0
"""The newest `SPAN` of the log is looked at `EVERY` so often [s]."""

ENOUGH_FOR_TURNS = 6
"""Rests from which the turns between them show exchanged axes and a wrong gyro unit [1]."""

MOST_TURNS = 8
"""Turns that are compared with every exchange of axes [1]."""

UNQUIET = {"accel": 0.3, "gyro": float(np.radians(5.0))}
"""No instrument at rest shakes as much: nobody has held it still yet [m/s^2, rad/s]."""


class Watchman:
    """Looks at a growing log from time to time and remembers what he saw.

    Parameters
    ----------
    found : LiveRests
        The log and its rests.
    used : LogDescription
        The complete description of the log.
    """

    def __init__(self, found: LiveRests, used: LogDescription) -> None:
        self._found, self._used = found, used
        self._checked = 0
        self._once: dict[str, Finding] = {}  # what has happened, by what and where
        self._now: list[Finding] = []  # what is so now
        self._turns: list[Finding] = []
        self._turns_at = 0

    def findings(self) -> tuple[Finding, ...]:
        """Return what looks wrong so far."""
        found = self._found
        if found.samples and (len(found) - self._checked) * found.interval >= EVERY:
            self._look(found.log)
            self._checked = len(found)
        return (*self._once.values(), *told_of(found.spikes), *self._now)

    def _look(self, log: Log) -> None:
        found = self._found
        start = max(0, min(self._checked, len(log) - round(SPAN / found.interval)) - 1)
        part = log[start:]
        told = list(checks.timing(part.time, start))
        # At rest a coarse axis only seems stuck.
        if np.sum(found.level(start) >= found.limit) * found.interval > 2.0:
            for name, x in (("gyro", part.gyro), ("accel", part.accel)):
                block = getattr(self._used, name)
                if x is not None and block is not None:
                    told += log_axes.check(part.time, x, name, _limits(block))
        for item in told:
            what = item.message.partition(" is ")[0] if item.code == "log.saturated" else ""
            self._once.setdefault(item.code + what, item)
        self._now = [*implausible(part, self._used), *self._unquiet(), *self._of_rests(log)]

    def _unquiet(self) -> list[Finding]:
        quiet = self._found.quiet
        if all(quiet.get(name, 0.0) <= limit for name, limit in UNQUIET.items()):
            return []
        gyro = np.degrees(quiet.get("gyro", 0.0))
        return [finding("watch.not_quiet", accel=f"{quiet['accel']:.2g}", gyro=f"{gyro:.2g}")]

    def _of_rests(self, log: Log) -> list[Finding]:
        first, last, turns = self._found.rests()
        told = []
        if turns.any():
            _, rate = turning(self._found.means("gyro", first, last))
            time = log.time - log.time[0]
            told += [
                finding("rest.moving", start=f"{time[first[i]]:.1f}",
                        end=f"{time[last[i] - 1]:.1f}", rate=f"{np.degrees(rate[i]):.2f}")
                for i in np.flatnonzero(turns)
            ]  # fmt: skip
        first, last = first[~turns], last[~turns]
        if not len(first):
            return told
        up_b = up_of(self._found, first, last)
        try:
            first_rest_orientation(log, up_b[0])
        except FoucaultError as problem:
            told.append(_warning(problem))
        return told + self._of_turns(log, up_b, first, last)

    def _of_turns(
        self, log: Log, up_b: FloatArray, first: IntArray, last: IntArray
    ) -> list[Finding]:
        # To try every exchange of axes takes long: not again before there is half as much more.
        n = len(first)
        if log.gyro is None or n < max(ENOUGH_FOR_TURNS, 1.5 * self._turns_at):
            return self._turns
        self._turns_at = n
        some = slice(max(0, n - MOST_TURNS - 1), n)
        bias = self._found.means("gyro", first, last).mean(axis=0)
        ends, starts = last[some][:-1] - 1, first[some][1:]
        match = axes.explain_turns(log, up_b[some], bias, ends, starts)
        problem = axes.mistake(log, *match)
        self._turns = [] if problem is None else [_warning(problem)]
        return self._turns


def _warning(problem: FoucaultError) -> Finding:
    return Finding(problem.code, "warning", problem.message, problem.cure)


def _limits(block: Triad) -> FloatArray | None:
    """Return the range of each axis, shape (3, 2) [SI]; increments are means by now."""
    limits = block.limits()
    if limits is None or block.kind == "increment":
        return None
    zero, factor = block.conversion()
    return np.sort((limits[None, :] - zero[:, None]) * factor[:, None], axis=1)
