"""What a hand does with an IMU on a table: rest, turn, rest in another orientation, ...

A plan is a list of attitudes with the time spent in each and the time of the turn to the next.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray
from foucault.models.rotation import aligning, exp


@dataclass(frozen=True)
class HandPlan:
    """Attitudes to rest in, and how long everything takes."""

    C_nb: FloatArray  # (n, 3, 3) attitude of each rest, body to East-North-Up [1]
    rest_time: FloatArray  # (n,) length of each rest [s]
    turn_time: FloatArray  # (n - 1,) length of each turn [s]
    # (n - 1, 3) rotation vector added in mid-turn and taken back, because a hand never turns about
    # one fixed axis [rad]
    wobble: FloatArray
    sway: FloatArray  # (n - 1, 3) displacement in mid-turn, there and back, frame n [m]

    @property
    def duration(self) -> float:
        """Length of the whole plan [s]."""
        return float(self.rest_time.sum() + self.turn_time.sum())


def spread_directions(n: int) -> FloatArray:
    """Return n directions spread evenly over the sphere (Fibonacci spiral), shape (n, 3) [1].

    `n`: number of directions [1].
    """
    k = np.arange(n) + 0.5
    z = 1 - 2 * k / n
    azimuth = np.pi * (1 + np.sqrt(5)) * k
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], axis=1)


def hand_plan(
    rests: int = 24,
    rest_time: float = 4.0,
    turn_time: float = 2.0,
    first_rest_time: float = 10.0,
    seed: int = 0,
) -> HandPlan:
    """Plan a session: z up first, then rests spread over the sphere, in a random order.

    `rests`: number of rests, the first included [1]; `rest_time`, `turn_time`: typical lengths,
    each varies by a fifth from one to the next [s]; `first_rest_time`: length of the first rest,
    from which gyro bias and noise are seen best [s]; `seed`: seed of the order, headings and
    wobbles [1].
    """
    rng = np.random.default_rng(seed)
    up_b = spread_directions(rests)
    first = int(np.argmax(up_b[:, 2]))
    others = rng.permutation(np.delete(np.arange(rests), first))
    up_b = up_b[np.concatenate([[first], others])]
    up_b[0] = (0.0, 0.0, 1.0)
    heading = np.concatenate([[0.3], rng.uniform(-np.pi, np.pi, rests - 1)])
    z = np.array([0.0, 0.0, 1.0])
    C_nb = np.stack([exp(h * z) @ aligning(u, z) for h, u in zip(heading, up_b, strict=True)])
    vary = rng.uniform(0.8, 1.2, (2, rests))
    times = rest_time * vary[0]
    times[0] = first_rest_time
    return HandPlan(
        C_nb,
        times,
        turn_time * vary[1, 1:],
        rng.normal(0, 0.25, (rests - 1, 3)),
        rng.normal(0, 0.05, (rests - 1, 3)),
    )
