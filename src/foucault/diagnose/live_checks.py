"""Early warnings: what looks wrong in a log while there is still time to mend it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from foucault.diagnose import axes
from foucault.diagnose.live import LiveRests, up_of
from foucault.diagnose.session_input import first_rest_orientation
from foucault.errors import Finding, FoucaultError, finding
from foucault.logs import axes as log_axes
from foucault.logs import checks
from foucault.logs.reading import implausible
from foucault.tables import AXES, Log

if TYPE_CHECKING:
    from foucault.logs.description import LogDescription

EVERY, SPAN = 2.0, 30.0
"""The newest `SPAN` of the log is looked at `EVERY` so often [s]."""

ENOUGH_FOR_TURNS = 6
"""Rests from which the turns between them show exchanged axes and a wrong gyro unit [1]."""

MOST_TURNS = 8
"""Turns compared with every exchange of axes [1]."""

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
        self._next = EVERY
        self._checked = 0
        self._once: dict[str, Finding] = {}  # what has happened, by what and where
        self._now: tuple[Finding, ...] = ()  # what is so now
        self._turns: FoucaultError | None = None
        self._turns_at = 0

    def findings(self) -> tuple[Finding, ...]:
        """Return what looks wrong so far."""
        found = self._found
        if found.samples and (len(found) - self._checked) * found.interval >= self._next:
            self._look(found.log)
        return (*self._once.values(), *self._now)

    def _look(self, log: Log) -> None:
        start = max(0, min(self._checked - 1, len(log) - round(SPAN / self._found.interval)))
        part = log[start:]
        told = list(checks.timing(part.time, start))
        moving = self._found.level(start) >= self._found.limit
        if np.sum(moving) * self._found.interval > 2.0:  # at rest a coarse axis seems stuck
            for name, x in (("gyro", part.gyro), ("accel", part.accel)):
                block = getattr(self._used, name)
                if x is not None and block is not None:
                    told += log_axes.check(part.time, x, name, block.limits_si())
        for item in told:
            self._once.setdefault(_key(item), item)
        now = [*implausible(part, self._used), *self._unquiet()]
        first, last, turns = self._found.rests()
        now += [
            _moving(log, self._found, a, b) for a, b in zip(first[turns], last[turns], strict=True)
        ]
        first, last = first[~turns], last[~turns]
        if len(first):
            now += self._orientation(log, first, last)
            now += self._explained(log, first, last)
        self._now = tuple(now)
        self._checked = len(log)
