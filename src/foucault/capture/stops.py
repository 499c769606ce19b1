"""Stops of a north seeker on its turntable, one after the other: which of them are done.

Of one list, headings of the table and at each of them index angles of the base, every rest is the
next. Where the instrument has a gyro along the vertical, the angle that it turned by from one stop
to the next is compared with the list: both, table and base, turn it about the vertical. What is
calibrated are the means of the stops, with the angles of the list.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.campaign import running
from foucault.capture.step import UP, Reached, Step, Wanted, Way
from foucault.coefficients import CoefficientVector
from foucault.detect.stretches import means_of
from foucault.errors import FoucaultError
from foucault.files import write_text
from foucault.logs import indexed_own
from foucault.models.rotation import aligning, turned
from foucault.result import Result
from foucault.simulate.north import NorthPlan, Stops
from foucault.tables import IndexedLog, Log

NEAR = np.radians(15.0)
"""A turn is that of the list within this [rad]."""

LONG = 0.9
"""A rest of so much of its time counts [1]."""

FILE, CAMPAIGN = "stops.csv", "stops.toml"
"""What is written of the stops."""

OWN = """\
[log]
file = "{file}"
setup = "setup"
time = {{ column = "time", unit = "s" }}
index = {{ column = "index", unit = "rad" }}
gyro = {{ column = "gyro", unit = "rad/s" }}
{accel}heading = {{ column = "heading", unit = "rad" }}
averaged = {{ column = "dwell", unit = "s" }}
"""

ACCEL = {
    "base": 'accel = { column = "specific force", unit = "m/s^2", reads = "specific force" }\n',
    "case": 'accel = { columns = ["specific force x", "specific force y"], '
    'unit = "m/s^2", reads = "specific force" }\n',
    "none": "",
}
"""[log] of the accelerometers, by where they are."""


@dataclass
class AtStops(Way):
    """What stops have shown, and which of the list is next."""

    plan: NorthPlan
    stops: Stops
    wanted: Wanted
    accelerometers: str  # "base", "case" or "none"
    calibrated: Callable[[IndexedLog], Result]
    text: str  # of the campaign
    hold: float | None = None  # time at a stop, None: of the plan [s]
    gyro: bool = True
    # first sample of each stop that is done, and the sample after its last [1]
    at: list[tuple[int, int]] = field(default_factory=list)
    _log: IndexedLog | None = None
    _sd: FloatArray | None = None  # (p,) after the last whole set-up [SI]

    def __post_init__(self) -> None:
        """Put the list together."""
        one = self.stops
        self._list = [
            (name, place.heading, float(angle), float(dwell))
            for name, place in enumerate(self.plan.setups)
            for angle, dwell in zip(one.index, one.dwell, strict=True)
        ]

    @property
    def done(self) -> tuple[int, int]:
        return len(self.at), len(self._list)

    def step(self, k: int) -> Step:
        """Return what is to be done for one of the list; `k`: its number [1]."""
        setup, heading, index, dwell = self._list[k]
        pitch = self.plan.setups[setup].pitch
        name = f"{np.degrees(index):.4g} deg, table at {np.degrees(heading):.4g} deg"
        name += f", tilted by {np.degrees(pitch):.4g} deg" if pitch else ""
        return Step("stop", UP, dwell if self.hold is None else self.hold, name=name, angle=index)

    def first_step(self) -> Step:
        return self.step(0)

    def reached(self, log: Log, first: IntArray, last: IntArray) -> Reached:
        assert log.accel is not None
        self.at, self.unlisted, before = [], False, -1
        for k, (a, b) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
            if len(self.at) == len(self._list):
                break
            seconds = float(log.time[b - 1] - log.time[a]) + log.interval
            if seconds < LONG * self.step(len(self.at)).seconds:
                continue
            off = 0.0 if before < 0 else self._off(log, first, last, before, k)
            self.unlisted = abs(off) > NEAR
            if not self.unlisted:
                self.at.append((a, b))
                before = k
        self._log = self._means(log) if self.at else None
        return self._known(log, first, last)

    def _off(self, log: Log, first: IntArray, last: IntArray, i: int, j: int) -> float:
        """Return by how much the turn between two rests is not that of the list [rad]."""
        if log.gyro is None or not np.isfinite(log.gyro[:, 2]).all() or \
                self.accelerometers == "case":  # fmt: skip
            return 0.0
        rest, turning = slice(first[i], last[i]), slice(last[i] - 1, first[j] + 1)
        w = log.gyro[turning, 2] - log.gyro[rest, 2].mean()
        t = log.time[turning]
        clockwise = -float(np.sum(0.5 * (w[1:] + w[:-1]) * np.diff(t)))
        (_, h0, i0, _), (_, h1, i1, _) = (self._list[len(self.at) - 1 + k] for k in (0, 1))
        return float(turned(np.array([clockwise - (h1 + i1 - h0 - i0)]))[0])

    def _means(self, log: Log) -> IndexedLog:
        """Return the means of the stops that are done, with the angles of the list [SI]."""
        some = self._list[: len(self.at)]
        setup = np.array([s for s, *_ in some])
        spans = np.array(self.at)
        columns = {"base": [1], "case": [0, 1], "none": []}[self.accelerometers]
        assert log.accel is not None
        assert log.gyro is not None
        return IndexedLog(
            time=log.time[spans[:, 0]], index=np.array([i for _, _, i, _ in some]),
            gyro=means_of(log.gyro, self.at)[:, 1],
            accel=means_of(log.accel, self.at)[:, columns] if columns else None,
            setup=setup, names=tuple(p.name for p in self.plan.setups[: int(setup[-1]) + 1]),
            heading=np.array([h for _, h, _, _ in some]),
            averaged=log.time[spans[:, 1] - 1] - log.time[spans[:, 0]] + log.interval,
        )  # fmt: skip

    def result(self) -> Result:
        """Calibrate what is done."""
        assert self._log is not None
        return self.calibrated(self._log)

    def _known(self, log: Log, first: IntArray, last: IntArray) -> Reached:
        assert log.accel is not None
        up = np.stack([log.accel[a:b].mean(axis=0) for a, b in zip(first, last, strict=True)])
        C_nb = np.stack([aligning(u / np.linalg.norm(u), UP) for u in up])
        if self.at and len(self.at) % len(self.stops.index) == 0:
            try:
                found = self.result().coefficients
                sd = dict(zip(found.names, found.sd.tolist(), strict=True))
                self._sd = np.array([sd.get(n, np.inf) for n in self.wanted.names])
            except FoucaultError:  # too little as yet
                pass
        none: Any = None
        p = len(self.wanted.layout)
        sd_now = np.full(p, np.inf) if self._sd is None else self._sd
        prior = CoefficientVector.prior(self.wanted.layout, {})
        return Reached(sd_now, none, none, {}, prior, C_nb, none, solved=False)

    def candidates(self, reached: Reached) -> list[Step]:
        k = len(self.at)
        return [self.step(k)] if k < len(self._list) else []

    def after(self, reached: Reached, steps: list[Step]) -> FloatArray:
        """Return the sd after the next stop, shape (k, p) [SI]: what counts is a whole set-up."""
        return np.tile(reached.sd, (len(steps), 1))

    def everything(self, log: Log, first: IntArray, last: IntArray, reached: Reached) -> Reached:
        return reached

    def leave(self, folder: Path) -> Path | None:
        """Write the means of the stops, and return the campaign that calibrates them."""
        if self._log is None:
            return None
        indexed_own.write(self._log, folder / FILE)
        own = OWN.format(file=FILE, accel=ACCEL[self.accelerometers])
        write_text(folder / CAMPAIGN, running.with_own_log(self.text, own))
        return folder / CAMPAIGN
