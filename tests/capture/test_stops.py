"""A north seeker's stops, guided: the list gone through, one turned too far, and the verdict."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commands import run
from foucault import campaign
from foucault.capture import ways
from foucault.capture.guide import Guide
from foucault.capture.said import Words
from foucault.logs.description import LogDescription
from foucault.models.noise import grade
from foucault.procedures.north_seeking.settings import draw_errors, planned, simulated
from foucault.tables import Log
from refusals import refuses

RATE, MOVE = 20.0, 4.0
"""Of the samples [Hz], and how long a move takes [s]."""

PLAN = 'headings = 12\norder = "published"\ndwell = "20 s"\nrate = "20 Hz"\nrows = "samples"'

USED = LogDescription.model_validate({
    "file": "live", "time": {"column": 0, "unit": "s"},
    "accel": {"columns": [1, 2, 3], "unit": "m/s^2"},
    "gyro": {"columns": [4, 5, 6], "unit": "rad/s"},
})  # fmt: skip


FRAMES = """
words = "text of a north seeker"
source = "this test"
line = { prefix = "$IMU", separator = ",", checksum = false }
kind = "rate"
fields = [
  { name = "time", at = 0, unit = "s" },
  { name = "accel", at = 1, count = 3, unit = "m/s^2" },
  { name = "gyro", at = 4, count = 3, unit = "rad/s" },
]
"""


def text_of(simulate: str = PLAN) -> str:
    head, _, _rest = campaign.template("north_seeking").partition("[simulate]")
    head = head.replace("# left_out = false", "left_out = false", 1)
    return f"{head}[simulate]\n{simulate}\n"


def told(simulate: str = PLAN) -> campaign.Campaign:
    return campaign.parse(text_of(simulate), "north.toml")


class Rig:
    """Somebody with a table and a base, who does what is asked, and the readings."""

    def __init__(self, said: campaign.Campaign) -> None:
        self.plan = planned(said.settings, said.session)
        noise = grade("navigation").noise
        made = simulated(said.session, said.settings, draw_errors("", 3), noise, said.site, 3)
        self.made, self.rng, self.time, self.azimuth = made.log, np.random.default_rng(1), 0.0, 0.0

    def stop(self, k: int, wrong: float = 0.0) -> Log:
        """Go to a stop of the list, too far by `wrong` [rad], and stay there; return readings."""
        motion = self.plan.motion
        setup, one = divmod(k, len(motion.index))
        azimuth = self.plan.setups[setup].heading + motion.index[one] + wrong
        turn, self.azimuth = azimuth - self.azimuth, azimuth
        n = round(RATE * MOVE) if self.time else 0
        start = motion.start[one]
        mine = self.made.setup == setup
        t = self.made.time[mine] - self.made.time[mine][0]
        here = (t >= start) & (t < start + motion.dwell[one])
        gyro, accel = self.made.gyro[mine][here], self.made.accel[mine][here]
        m = len(gyro)
        w, f = np.zeros((n + m, 3)), np.zeros((n + m, 3))
        w[:n, 2] = -turn / MOVE
        w[n:, 1], f[n:, 1], f[:, 2] = gyro, accel[:, 0], 9.81
        f[:n] += self.rng.normal(0, 0.4, (n, 3))
        w[:n, :2] += self.rng.normal(0, 0.02, (n, 2))
        f[n:] += self.rng.normal(0, 1e-4, (m, 3))
        w[n:, ::2] += self.rng.normal(0, 1e-6, (m, 2))
        time = self.time + (1 + np.arange(n + m)) / RATE
        self.time = float(time[-1])
        return Log(time, w, f, "rate")


def fed(guide: Guide, log: Log) -> None:
    for k in range(0, len(log), 10):
        guide.add(log[k : k + 10])


def guide_of(said: campaign.Campaign, **more: Any) -> Guide:
    return ways.guide_of(ways.Asked(said, hold=16.0, **more), USED)


@pytest.mark.thorough
def test_the_list_is_gone_through_and_what_was_turned_too_far_is_said():
    said = told()
    guide, rig, words = guide_of(said), Rig(said), Words.of()
    assert guide.done == (0, 4 * 12)
    assert words.task(guide).startswith("Turn the base to 0 deg, table at 0 deg, 16 s")
    for k in range(3):
        fed(guide, rig.stop(k))
    assert guide.done[0] == 3 and not guide.mistakes
    fed(guide, rig.stop(3, wrong=np.radians(40.0)))
    assert guide.done[0] == 3 and [m.key for m in guide.mistakes] == ["unlisted"]
    fed(guide, rig.stop(3))
    assert guide.done[0] == 4


@pytest.mark.thorough
def test_all_of_it_is_a_calibration(tmp_path: Path):
    said = told()
    guide, rig = guide_of(said), Rig(said)
    for k in range(guide.done[1]):
        assert not guide.stopped
        fed(guide, rig.stop(k))
    assert guide.done == (48, 48) and guide.stopped in ("enough", "list")
    assert guide.result is not None
    truth = dict(zip(*_truth(said), strict=True))
    c = guide.result.coefficients
    off = np.array([(v - truth[n]) / s for n, v, s in zip(c.names, c.values, c.sd, strict=True)])
    assert np.abs(off).max() < 4.5, off
    path = guide.way.leave(tmp_path)
    again = campaign.calibrate(campaign.load(path))
    np.testing.assert_allclose(again.coefficients.values, c.values, rtol=1e-9, atol=1e-15)


@pytest.mark.thorough
def test_by_the_command(tmp_path: Path):
    said = told()
    rig, log = Rig(said), tmp_path / "heard.txt"
    stops = [rig.stop(k) for k in range(guide_of(said).done[1])]
    rows = np.concatenate([np.column_stack([s.time, s.accel, s.gyro]) for s in stops])
    log.write_text("".join("$IMU," + ",".join(f"{v:.12g}" for v in row) + "\n" for row in rows))
    (tmp_path / "north.toml").write_text(text_of())
    (tmp_path / "frames.toml").write_text(FRAMES)
    made = run("calibrate", tmp_path / "north.toml", "--live", log, "--frames",
               tmp_path / "frames.toml", "-o", tmp_path / "run", "--hold", "16 s",
               "--silence", "2 s", code=0)  # fmt: skip
    assert "48. Turn the base to 270 deg, table at 330 deg, 16 s: 47 of 48 done" in made.output
    assert "verdict: pass" in made.output and (tmp_path / "run" / "report.html").is_file()


def _truth(said: campaign.Campaign) -> tuple[list[str], list[float]]:
    model = draw_errors("", 3)
    every = model.coefficients()
    return list(every.names), every.values.tolist()


def test_frames_without_a_gyro():
    said = told()
    with refuses("guide.no_gyro"):
        ways.guide_of(ways.Asked(said), USED.model_copy(update={"gyro": None}))
