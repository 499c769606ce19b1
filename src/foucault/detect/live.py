"""Find rests while they happen.

The segmentation is that of `find_rests`, fed piece by piece: the standard deviation of a window
is known half a window after its middle, and what is rest or motion is decided again for the whole
log whenever it has grown by a few percent, because the quiet level and the threshold are learned
from all of it. In between only the newest windows are decided, so that the work per second of
data stays small, and at the end the rests are those of `find_rests`.
"""

from __future__ import annotations

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.detect.noise import AROUND, Spike, spikes_of
from foucault.detect.stretches import (
    FEW,
    HAND,
    LOWEST,
    How,
    level_of,
    limit_of,
    moments_of,
    quiet_sd,
    runs,
    spun,
    swung,
    trimmed,
    turning,
)
from foucault.logs import checks
from foucault.tables import Log, usual_step

LEARN = (0.5, 0.02)
"""The whole log is decided again when it has grown by so much [s] and by this part [1]."""

LOOK = (2.0, 30.0)  # Spikes are looked for after so long, among so much of the newest [s].

THINNED = 1 << 14
"""Windows the threshold is learned from while data come; neighbours are much alike [1]."""


class Rows:
    """Rows of some columns that are added at the end, in one array that doubles when it is full."""

    def __init__(self, columns: int) -> None:
        self._data = np.empty((4096, columns))
        self._n = 0

    def __len__(self) -> int:
        return self._n

    def add(self, rows: FloatArray) -> None:
        """Add `rows`, shape (k, columns)."""
        end = self._n + len(rows)
        if end > len(self._data):
            grown = np.empty((max(end, 2 * len(self._data)), self._data.shape[1]))
            grown[: self._n] = self._data[: self._n]
            self._data = grown
        self._data[self._n : end] = rows
        self._n = end

    def clear(self, since: int = 0) -> None:
        """Forget the rows from `since` [1] on."""
        self._n = min(self._n, since)

    @property
    def all(self) -> FloatArray:
        """The rows so far, shape (n, columns); a view that the next `add` may leave behind."""
        return self._data[: self._n]


class LiveRests:
    """The rests of a log that grows."""

    def __init__(self, how: How = HAND) -> None:
        self.how = how
        self._time = Rows(1)
        self._triads: dict[str, Rows] = {}
        self._moments: dict[str, Rows] = {}
        self._log: Log | None = None
        self.interval = float("nan")
        self.samples = 0
        self.quiet: dict[str, float] = {}
        self.limit = LOWEST
        self.spikes: list[Spike] = []
        self._looked = 0  # how much has been searched for spikes
        self._next = 0  # decide the whole log again at this length
        self._runs: list[tuple[int, int]] = []  # quiet runs that have ended
        self._open = self._decided = 0
        self._means: dict[tuple[str, int, int], FloatArray] = {}

    def __len__(self) -> int:
        return len(self._time)

    @property
    def log(self) -> Log:
        """All samples so far, without spikes [SI]."""
        assert self._log is not None
        data = {name: rows.all for name, rows in self._triads.items()}
        return Log(self._time.all[:, 0], data.get("gyro"), data.get("accel"), self._log.sampled,
                   source=self._log.source)  # fmt: skip

    def add(self, log: Log) -> None:
        """Add the next samples and decide what they are.

        `log`: the samples, with the same triads as those before [SI]. Raises time repeats or runs
        backward.
        """
        if self._log is None:
            self._log = log
            for name in ("accel", "gyro"):
                if getattr(log, name) is not None:
                    self._triads[name], self._moments[name] = Rows(3), Rows(4)
        known = len(self)
        self._time.add(log.time[:, None])
        newest = self._time.all[max(0, known - 2) :, 0]
        if (np.diff(newest) <= 0).any():
            checks.timing(newest, max(0, known - 2))
        for name, rows in self._triads.items():
            rows.add(getattr(log, name))
        if self.samples and (len(self) - self._looked) * self.interval >= LOOK[0]:
            self._set_apart(len(self) - AROUND)  # of the newest, what comes after tells
        if len(self) >= max(self._next, 10):
            self._learn()
        elif self.samples:
            self._extend()
            self._decide()

    def finish(self) -> None:
        """Decide the whole log once more, from every window."""
        if len(self) >= 10:
            self._set_apart(len(self))
            self._learn(exact=True)

    def _set_apart(self, end: int) -> None:
        """Replace spikes before sample `end` by what is around them."""
        span = round(LOOK[1] / self.interval) if self.samples else end
        start = max(0, min(self._looked - 2 * AROUND, end - span))
        log, self._looked = self.log[start:], end
        new, seen = spikes_of(log)
        first, last = log.time[AROUND if start else 0], log.time[end - 1 - start]
        seen = [each for each in seen if first <= each[0] <= last]
        if not seen:
            return
        row = start + int(np.searchsorted(log.time, min(each[0] for each in seen)))
        for name, x in new.items():
            self._triads[name].all[row:end] = x[row - start : end - start]
        half = self.samples // 2
        for rows in self._moments.values():
            rows.clear(row - half if row > 2 * half else 0)
        self._means.clear()
        self.spikes += seen
        self._next = 0

    def _learn(self, exact: bool = False) -> None:
        stride = 1 if exact else max(1, len(self) // THINNED)
        step = np.diff(self._time.all[:, 0])[::stride]
        self.interval = usual_step(step)
        rate = 1.0 / self.interval
        samples = self.how.samples(rate)
        if abs(samples - self.samples) > (0.0 if exact else 0.1 * self.samples):
            self.samples = samples
            for rows in self._moments.values():
                rows.clear()
        self._extend()
        sd = {name: rows.all[::stride, 0] for name, rows in self._moments.items()}
        self.quiet = {name: quiet_sd(values) for name, values in sd.items()}
        self.limit = limit_of(self._levels(sd), self.how, LOWEST)
        self._runs, self._open, self._decided = [], 0, 0
        self._decide()
        self._next = len(self) + round(max(LEARN[0] * rate, LEARN[1] * len(self)))

    def _extend(self) -> None:
        """Add standard deviation and mean of the windows that are complete now."""
        half, n = self.samples // 2, len(self)
        if n < self.samples:
            return
        for name, rows in self._moments.items():
            if not len(rows):
                rows.add(np.full((half, 4), np.nan))
            known = len(rows)
            x = self._triads[name].all[known - half : n]
            mean, sd = moments_of(x, self.samples)
            rows.add(np.column_stack([sd, mean])[half : len(x) - half])

    def level(self, since: int) -> FloatArray:
        """Return the level of every window from sample `since` on, shape (n,) [1]."""
        return self._levels({name: rows.all[since:, 0] for name, rows in self._moments.items()})

    def _levels(self, sd: dict[str, FloatArray]) -> FloatArray:
        levels = [level_of(values, self.quiet[name]) for name, values in sd.items()]
        return np.asarray(np.fmax.reduce(levels))

    def _decide(self) -> None:
        """Continue the runs of quiet windows from the start of the last open one."""
        since = self._open
        quiet = self.level(since) < self.limit
        found = [(int(a) + since, int(b) + since) for a, b in zip(*runs(quiet), strict=True)]
        self._decided = since + len(quiet)
        self._open = self._decided
        if found and found[-1][1] == self._decided:
            self._open = found.pop()[0]
        self._runs += found

    @property
    def still_since(self) -> int | None:
        """First sample of the quiet run that still lasts, shape (); None while moving."""
        return self._open if self._open < self._decided else None

    @property
    def run(self) -> float:
        """Length of the quiet run that still lasts, as it counts for a rest [s]."""
        return (self._decided - self._open) * self.interval

    def rests(self) -> tuple[IntArray, IntArray, BoolArray]:
        """Return first and one-past-last sample of each rest, and which of them turn, (n,)."""
        found = self._runs
        if self.still_since is not None:
            found = [*found, (self._open, self._decided)]
        fewest = self.how.fewest(1.0 / self.interval) if self.samples else 0
        kept = [(a, b) for a, b in found if b - a >= fewest]
        first, last = (np.array([run[i] for run in kept], np.int64) for i in (0, 1))
        if kept and self.how.threshold is None:
            means = self._moments["gyro"].all[:, 1:] if "gyro" in self._moments else None
            first, last = trimmed(self.level(0), first, last, fewest, means)
        turns = np.zeros(len(kept), bool)
        if "accel" in self._triads:
            spans = list(zip(first.tolist(), last.tolist(), strict=True))
            turns = swung(self._triads["accel"].all, spans, self.samples)
        some = np.flatnonzero(~turns)
        if "gyro" in self._triads and len(some) >= FEW:
            mean = self.means("gyro", first[some], last[some])
            turns[some], _ = turning(mean)
            if "accel" in self._triads:
                force = self.means("accel", first[some], last[some])
                lasting = np.asarray((last - first)[some] * self.interval, float)
                turns[some] |= spun(mean, force, lasting)
        return first, last, turns

    def means(self, triad: str, first: IntArray, last: IntArray) -> FloatArray:
        """Return means of rests, samples `first` to before `last` (n,), shape (n, 3) [SI]."""
        x, out = self._triads[triad].all, np.empty((len(first), 3))
        for i, (a, b) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
            known = self._means.get((triad, a, b))
            if known is None:
                known = x[a:b].mean(axis=0)
                if len(self._means) > 4096:
                    self._means.clear()
                self._means[triad, a, b] = known
            out[i] = known
        return out
