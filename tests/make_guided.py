"""Somebody who is guided: does what the guide says, or not, with a simulated instrument."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from foucault import campaign
from foucault.arrays import FloatArray
from foucault.capture import ways
from foucault.capture.guide import Guide
from foucault.capture.step import Step, turn_time
from foucault.logs.description import LogDescription
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise, grade
from foucault.models.rotation import aligning, exp, log
from foucault.plans.directions import RestPlan
from foucault.simulate.hand_rotated import draw_errors, simulate
from foucault.tables import Log
from make_live import frames

UP = np.array([0.0, 0.0, 1.0])


@dataclass
class Operator:
    """Hands, and the instrument in them."""

    model: ImuModel
    noise: ImuNoise
    site: Site
    rng: np.random.Generator
    rate: float = 100.0
    disobeys: float = 0.0  # how often something else is done than was asked [1]
    hasty: float = 0.0  # how often it is taken up too early [1]
    sloppy: float = np.radians(4.0)  # how far an orientation is off [rad]
    C_nb: FloatArray = field(default_factory=lambda: np.eye(3))
    time: float = 0.0

    def rest(self, seconds: float) -> Log:
        """Let it lie."""
        return self._moved(self.C_nb, None, seconds, 0.0)

    def move(self, C: FloatArray, seconds: float, rotation: FloatArray | None = None) -> Log:
        """Turn it to an attitude and let it lie there."""
        shortest = log((self.C_nb.T @ C)[None])[0]
        turn = shortest if rotation is None else rotation
        return self._moved(C, turn, seconds, float(turn_time(turn)) * self.rng.uniform(0.8, 1.3))

    def _moved(self, C: FloatArray, turn: Any, seconds: float, takes: float) -> Log:
        if turn is None:
            plan = RestPlan(self.C_nb[None], np.array([seconds]), np.zeros(0))
        else:
            wobble, sway = self.rng.normal(0, 0.25, (1, 3)), self.rng.normal(0, 0.05, (1, 3))
            plan = RestPlan(
                np.array([self.C_nb, self.C_nb @ exp(turn)]), np.array([0.05, seconds]),
                np.array([takes]), np.array([turn]), wobble, sway,
            )  # fmt: skip
        seed = int(self.rng.integers(1 << 31))
        made = simulate(plan, model=self.model, noise=self.noise, site=self.site, rate=self.rate,
                        seed=seed).log  # fmt: skip
        out = replace(made, time=made.time + self.time)
        self.time = float(out.time[-1] + 1 / self.rate)
        self.C_nb = plan.C_nb[-1]
        return out

    def obey(self, step: Step, reached: FloatArray | None) -> Log:
        """Do a step, or something else; `reached`: attitude as the guide has it."""
        rng = self.rng
        seconds = step.seconds + 0.8
        if rng.uniform() < self.hasty:
            seconds = rng.uniform(1.2, 0.8 * step.seconds)
        if step.kind == "turn" and step.rotation is not None:
            return self.move(self.C_nb, seconds, step.rotation)
        up = step.up
        if rng.uniform() < self.disobeys:
            up = rng.standard_normal(3)
            up /= np.linalg.norm(up)
            C = exp(rng.uniform(-np.pi, np.pi) * UP) @ aligning(up, UP)
        elif step.rotation is not None:
            C = self.C_nb @ exp(step.rotation)
        else:
            C = aligning(up, UP)
        return self.move(C @ exp(rng.normal(0, self.sloppy / np.sqrt(2), 3)), seconds)


def session(guide: Guide, operator: Operator, most: int = 60, begin: float = 1.0) -> int:
    """Let an operator be guided until the guide stops; return how many rests it took."""
    guide.add(operator.rest(guide.step.seconds + begin))
    moves = 1
    while guide.step is not None and moves < most:
        guide.add(operator.obey(guide.step, None))
        moves += 1
    return moves


CAMPAIGN = """\
[instrument]
name = "bench IMU"
left_out = false
[site]
latitude = "48.85 deg"
height = "60 m"
[log]
file = "log.csv"
time = { column = "t", unit = "s" }
accel = { columns = ["ax", "ay", "az"], unit = "m/s^2" }
[procedure]
name = "hand_rotated"
[noise]
accel = { white = "120 ug/sqrt(Hz)" }
gyro = { white = "0.3 deg/sqrt(h)" }
"""
"""A campaign of a MEMS whose noise is known."""


def written(path: Path, want: dict[str, str], hold: float = 5.0, seed: int = 6) -> int:
    """Write the bytes of a session that was guided, and return how many rests it had.

    Whoever reads them from the start asks for the same, and so is obeyed; one rest is of another
    side, and one is ended too early.
    """
    told = campaign.parse(CAMPAIGN, path.parent / "campaign.toml")
    asked = ways.Asked(told, hold, want)
    used = LogDescription.model_validate({
        "file": "live", "time": {"column": 0, "unit": "us"},
        "accel": {"columns": [2, 3, 4], "unit": "m/s^2"},
        "gyro": {"columns": [5, 6, 7], "unit": "rad/s"},
    })  # fmt: skip
    guide = ways.guide_of(asked, used)
    hands = Operator(draw_errors("mems", seed), grade("mems").noise, told.site,
                     np.random.default_rng(seed))  # fmt: skip
    parts = [hands.rest(2 * hold + 2)]
    guide.add(parts[0])
    while guide.step is not None and len(parts) < 30:
        step = guide.step
        if len(parts) == 4:
            parts.append(hands.move(aligning(-step.up, UP), step.seconds + 1.5))
        elif len(parts) == 6:
            parts.append(hands.move(hands.C_nb @ exp(step.rotation), 0.55 * step.seconds))
            guide.add(parts[-1])
            parts.append(hands.move(np.eye(3), step.seconds + 1.5))
        else:
            parts.append(hands.obey(step, None))
        for k in range(0, len(parts[-1]), 25):
            guide.add(parts[-1][k : k + 25])
    path.write_bytes(b"".join(b"".join(frames(part)) for part in parts))
    return guide.rests
