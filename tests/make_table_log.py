"""A made-up session on a three-axis table, from kinematics written down here once more.

Angles run through accelerated moves, rests and spins with ramps; rates follow from the chain of
the three axes, forces from gravity alone. Nothing of the package but its tables is used.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from foucault.models.turntable import TablePlan
from foucault.tables import Log, TableColumns

DEG = np.pi / 180
EARTH = 7.292115e-5
GRAVITY = 9.81

FACES = np.array([[0, 0, 0], [0, 90, 0], [0, 180, 0], [0, -90, 0], [0, 0, 90], [0, 0, -90]]) * DEG

# Twelve directions of an icosahedron: outer, middle, inner.
ICO = np.array([[30 * k, a, b] for k, (a, b) in enumerate(
    [(0, -31.72), (0, 211.72), (0, 148.28), (0, 31.72), (58.28, 0), (121.72, 0), (-58.28, 0),
     (238.28, 0), (148.28, 90), (211.72, 90), (31.72, 90), (-31.72, 90)])]) * DEG  # fmt: skip


def plan_of(angles, rates, time=10.0, turns=1, name="made up"):
    """Return a plan: rests of `time` [s] where the rate is 0, else spins of whole turns."""
    rate = np.broadcast_to(np.asarray(rates, float), len(angles)).copy()
    size = np.where(rate == 0, 1, np.abs(rate))
    return TablePlan(
        name, np.asarray(angles, float), rate, np.where(rate == 0, time, 2 * np.pi * turns / size)
    )


@dataclass
class Session:
    """What is done on the table, and how badly the instrument measures it."""

    plan: TablePlan
    rate: float = 100.0
    latitude: float = 45 * DEG
    heading: float = 0.3
    gyro_bias: tuple = (0.0, 0.0, 0.0)
    accel_bias: tuple = (0.0, 0.0, 0.0)
    gyro_noise: float = 0.0
    accel_noise: float = 0.0
    plumb: float = 0.0
    increments: bool = False
    move_rate: float = 30 * DEG
    acceleration: float = 30 * DEG
    ramp: float = 10 * DEG
    settle: float = 1.0
    seed: int = 1
    marks: list = field(default_factory=list)  # start and end of each position [s]

    def profile(self):
        """Return knots (time, angles, rates): between knots each angle is a parabola."""
        t, now = 0.0, self.plan.angles[0].copy()
        knots = [(t, now.copy(), np.zeros(3))]

        def go(seconds, change, end_rate):
            nonlocal t, now
            t, now = t + seconds, now + change
            knots.append((t, now.copy(), np.asarray(end_rate, float)))

        self.marks.clear()
        for target, rate, time in zip(
            self.plan.angles, self.plan.rate, self.plan.time, strict=True
        ):
            for k in (1, 2, 0):  # one axis after the other
                way = (
                    (target[k] - now[k])
                    if k
                    else (target[k] - now[k] + np.pi) % (2 * np.pi) - np.pi
                )
                if abs(way) > 1e-12:
                    top = min(self.move_rate, np.sqrt(self.acceleration * abs(way)))
                    up = top / self.acceleration
                    one, sense = np.eye(3)[k], np.sign(way)
                    go(up, one * sense * top * up / 2, one * sense * top)
                    flat = abs(way) / top - up
                    if flat > 1e-9:
                        go(flat, one * sense * top * flat, one * sense * top)
                    go(up, one * sense * top * up / 2, 0 * one)
            go(self.settle, np.zeros(3), np.zeros(3))
            if rate:
                up, e = abs(rate) / self.ramp, np.array([1.0, 0, 0])
                go(up, e * rate * up / 2, e * rate)
                self.marks.append((t, t + time))
                go(time, e * rate * time, e * rate)
                go(up, e * rate * up / 2, 0 * e)
            else:
                self.marks.append((t, t + time))
                go(time, np.zeros(3), np.zeros(3))
        return knots

    def kinematics(self, knots, time):
        """Return angles and their rates at some times."""
        at = np.array([k[0] for k in knots])
        angle, rate = np.array([k[1] for k in knots]), np.array([k[2] for k in knots])
        i = np.clip(np.searchsorted(at, time, side="right") - 1, 0, len(at) - 2)
        s, h = (time - at[i])[:, None], (at[i + 1] - at[i])[:, None]
        slope = (rate[i + 1] - rate[i]) / h
        return angle[i] + rate[i] * s + slope * s**2 / 2, rate[i] + slope * s

    def sensed(self, knots, time):
        """Return true rate and specific force in case axes."""
        angles, rates = self.kinematics(knots, time)
        g, a, b = angles.T
        dg, da, db = rates.T
        one = np.ones_like(g)
        north = EARTH * np.cos(self.latitude)
        # Table axes: Earth rate and, on a table that leans, gravity.
        earth = np.outer(
            one,
            [
                north * np.sin(self.heading),
                north * np.cos(self.heading),
                EARTH * np.sin(self.latitude),
            ],
        )
        up = np.outer(one, [np.sin(self.plumb), 0, np.cos(self.plumb)])

        def to_case(x):
            x = np.stack(
                [
                    np.cos(g) * x[:, 0] + np.sin(g) * x[:, 1],
                    -np.sin(g) * x[:, 0] + np.cos(g) * x[:, 1],
                    x[:, 2],
                ],
                1,
            )
            x = np.stack(
                [
                    x[:, 0],
                    np.cos(a) * x[:, 1] + np.sin(a) * x[:, 2],
                    -np.sin(a) * x[:, 1] + np.cos(a) * x[:, 2],
                ],
                1,
            )
            return np.stack(
                [
                    np.cos(b) * x[:, 0] - np.sin(b) * x[:, 2],
                    x[:, 1],
                    np.sin(b) * x[:, 0] + np.cos(b) * x[:, 2],
                ],
                1,
            )

        spin = np.stack(
            [
                -np.cos(a) * np.sin(b) * dg + np.cos(b) * da,
                np.sin(a) * dg + db,
                np.cos(a) * np.cos(b) * dg + np.sin(b) * da,
            ],
            1,
        )
        return to_case(earth) + spin, GRAVITY * to_case(up)

    def log(self, table=("angles",), averaged=False):
        """Return the log; `table` says what it tells of the table: angles, rate, position."""
        rng = np.random.default_rng(self.seed)
        knots = self.profile()
        time = np.arange(int(knots[-1][0] * self.rate) + 1) / self.rate
        time = time[1:] if self.increments else time
        if self.increments:
            sub = 8
            fine = (time[:, None] - (np.arange(sub) + 0.5) / (sub * self.rate)).ravel()
            w, f = (x.reshape(-1, sub, 3).mean(1) for x in self.sensed(knots, fine))
        else:
            w, f = self.sensed(knots, time)
        w = w + self.gyro_bias + self.gyro_noise * rng.normal(size=w.shape)
        f = f + self.accel_bias + self.accel_noise * rng.normal(size=f.shape)
        angles, rates = self.kinematics(knots, time)
        position = np.full(len(time), -1)
        for k, (start, end) in enumerate(self.marks):
            position[(time >= start - 1e-9) & (time < end - 1e-9)] = k
        columns = TableColumns(
            angles if "angles" in table else np.full_like(angles, np.nan),
            rates[:, 0] if "rate" in table else None,
            position if "position" in table else None,
        )
        sampled = "increment" if self.increments else "rate"
        log = Log(time, w, f, sampled, table=columns if table else None)
        return self.averages(log) if averaged else log

    def averages(self, log):
        """Return the log with one row per position."""
        rows = [(log.time >= a) & (log.time < b - 1e-9) for a, b in self.marks]
        mean = {
            k: np.array([getattr(log, k)[r].mean(axis=0) for r in rows]) for k in ("gyro", "accel")
        }
        table = TableColumns(self.plan.angles, self.plan.rate)
        return replace(
            log,
            time=np.array([a for a, _ in self.marks]),
            **mean,
            table=table,
            averaged=self.plan.time,
        )


def plain_up(angles):
    """Return up in case axes."""
    _, a, b = np.asarray(angles).T
    return np.stack([-np.cos(a) * np.sin(b), np.sin(a), np.cos(a) * np.cos(b)], 1)
