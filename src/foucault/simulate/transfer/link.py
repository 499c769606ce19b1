"""What a logger gets of a master INS: messages with noise, late, some lost, some twice.

The master's clock reads ``c = (1 + drift) t + offset`` where that of the slave reads t. A message
is made at every tick of it, says what is true then but for noise, and arrives `delay` and a little
more or less later::

    stamped at arrival     time = t + delay + jitter
    stamped at validity    time = c
    both                   time = c, arrival = t + delay + jitter
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error
from foucault.models.attitude import angles_of, matrix_of
from foucault.models.geodesy import displaced
from foucault.models.master import MasterTable
from foucault.models.noise import TriadNoise
from foucault.simulate.motion import Motion
from foucault.simulate.noise import draw_noise
from foucault.tables import whole_samples

Three = tuple[float, float, float]

_ARCMIN = np.pi / 10800


@dataclass(frozen=True)
class MasterNoise:
    """Errors of what a master says: a new one in each message, and one that wanders slowly.

    Attributes
    ----------
    velocity, velocity_wander : float
        Standard deviation of each component of the velocity [m/s].
    attitude, attitude_wander : tuple of float, length 3
        Standard deviation of heading, pitch and roll [rad].
    position : float
        Standard deviation of each component of the position [m].
    wander_time : float
        Correlation time of what wanders [s].
    """

    velocity: float = 0.05
    attitude: Three = (_ARCMIN, _ARCMIN, _ARCMIN)
    position: float = 1.0
    velocity_wander: float = 0.0
    attitude_wander: Three = (0.0, 0.0, 0.0)
    wander_time: float = 300.0


@dataclass(frozen=True)
class Link:
    """How the messages come.

    Attributes
    ----------
    rate : float
        Messages in a second of the master's clock [Hz].
    delay : float
        From validity to arrival [s].
    jitter : float
        Standard deviation of it; up to three times as much comes [s].
    lost : float
        Part of the messages that never arrive [1].
    silent : tuple of (float, float)
        Beginning and end of stretches without messages [s].
    repeated : float
        Part of the messages that the logger writes a second time, a third of an interval later [1].
    stamped : {"arrival", "validity", "both"}
        See the text of the module.
    drift : float
        By how much the master's clock is fast; 20e-6 are 20 ppm [1].
    offset : float
        What the master's clock reads at time 0 of the slave's [s].
    """

    rate: float = 10.0
    delay: float = 0.1
    jitter: float = 0.0
    lost: float = 0.0
    silent: tuple[tuple[float, float], ...] = ()
    repeated: float = 0.0
    stamped: Literal["arrival", "validity", "both"] = "arrival"
    drift: float = 0.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        period = 1.0 / self.rate if self.rate > 0 else np.nan
        for key, good, allowed in (
            ("rate", 0 < self.rate < np.inf, "above zero"),
            ("delay", 0 <= self.delay < np.inf, "zero or more"),
            ("jitter", 0 <= self.jitter <= period / 10,
             f"from 0 to {period / 10:g} s, a tenth of the interval between messages"),
            ("lost", 0 <= self.lost < 1, "from 0 to below 1"),
            ("repeated", 0 <= self.repeated <= 1, "from 0 to 1"),
            ("stamped", self.stamped in ("arrival", "validity", "both"),
             '"arrival", "validity" or "both"'),
            ("drift", abs(self.drift) < 0.1, "a small part of 1"),
        ):  # fmt: skip
            if not good:
                given = getattr(self, key)
                raise error("transfer_plan.value", key=f"link {key}", given=given, allowed=allowed)


@dataclass(frozen=True)
class Received:
    """Messages of a simulated master."""

    table: MasterTable  # as the logger has them, repeated ones twice
    valid: FloatArray  # (k,) when each was true, on the slave's clock [s]
    # lost, repeated: how many were lost, and how many came twice [1]
    lost: int
    repeated: int


def messages(
    motion: Motion, link: Link, noise: MasterNoise, end: float, seeds: list[np.random.SeedSequence]
) -> Received:
    """Draw the messages that arrive until `end`.

    `end`: arrivals after this are not logged [s].
    """
    rng = np.random.default_rng(seeds[1])
    period = 1.0 / link.rate
    # Ticks are not aligned with the samples of the slave.
    first = np.ceil(link.offset / period) + rng.random()
    count = whole_samples(np.floor(((1 + link.drift) * end + link.offset) / period - first)) + 1
    clock = period * (first + np.arange(count))
    valid = (clock - link.offset) / (1 + link.drift)
    late = link.delay + link.jitter * np.clip(rng.standard_normal(count), -3.0, 3.0)
    arrival = valid + np.maximum(late, 0.0)
    lost = rng.random(count) < link.lost
    for begin, stop in link.silent:
        lost |= (valid >= begin) & (valid <= stop)
    twice = rng.random(count) < link.repeated
    said = _said(motion, valid, noise, np.random.default_rng(seeds[0]))
    rows = np.repeat(np.arange(count), 1 + twice)
    again = np.append(False, rows[1:] == rows[:-1])
    came = arrival[rows] + np.where(again, period / 3, 0.0)
    stamp, beside = {"arrival": (came, None), "validity": (clock[rows], None),
                     "both": (clock[rows], came)}[link.stamped]  # fmt: skip
    keep = (came <= end) & ~lost[rows]
    logged = replace(said[rows], time=stamp, arrival=beside)[keep]
    return Received(logged, valid[rows][keep], int(np.sum(lost & (arrival <= end))),
                    int(np.sum(again & keep)))  # fmt: skip


def _said(
    motion: Motion, valid: FloatArray, noise: MasterNoise, rng: np.random.Generator
) -> MasterTable:
    truth = motion.trajectory(valid)

    def drawn(white: float, wander: float) -> FloatArray:
        dt = float(np.mean(np.diff(valid)))
        law = TriadNoise(white * np.sqrt(dt), wander, noise.wander_time)
        return draw_noise(law, valid, rng)

    velocity = truth.velocity_n + drawn(noise.velocity, noise.velocity_wander)
    white, wander = drawn(1.0, 0.0), drawn(0.0, 1.0)
    angles = angles_of(truth.C_nb) + white * noise.attitude + wander * noise.attitude_wander
    away = drawn(noise.position, 0.0)
    place = displaced(truth.latitude, truth.longitude, truth.height, away)
    return MasterTable(valid, velocity, matrix_of(*angles.T), None, *place)
