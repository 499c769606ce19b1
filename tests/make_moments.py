"""A guided session in a workbench, fed bit by bit: what its page shows at each moment."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import make_guided
from make_workbench import Served

WANT = {"accel.bias": "0.3 mg", "accel.scale": "300 ppm"}

HOLD = 4.0
"""Time to rest [s]."""

FRAME = 43
"""Length of a frame of the simulated instrument [bytes]."""


class Fed:
    """A workbench whose page guides a session that somebody else obeys, a part at a time."""

    def __init__(self, folder: Path) -> None:
        """Write all that will be sent, and begin to serve."""
        whole = folder / "whole.bin"
        self.rests = make_guided.written(whole, WANT, HOLD)
        self.data, self.sent = whole.read_bytes(), 0
        self.port = folder / "port.bin"
        self.port.touch()
        self.served = Served(folder / "bench", "--workers", "1")
        file = {"file": ("campaign.toml", make_guided.CAMPAIGN.encode())}
        more = {"file": ("log.csv", b"t,ax,ay,az\n0,0,0,9.8\n0.01,0,0,9.8\n0.02,0,0,9.8\n")}
        self.log = self.served.api("POST", "/logs", files=[*file.items(), *more.items()])["log"]

    def send(self, seconds: float | None = None) -> None:
        """Let so much of it come, None: all the rest [s]; ends when the page shows what it made."""
        end = len(self.data) if seconds is None else self.sent + FRAME * round(100 * seconds)
        with self.port.open("ab") as file:
            file.write(self.data[self.sent : end])
        self.sent = min(end, len(self.data))
        self.page.wait_for_function(
            "rows => { const g = document.getElementById('guide');"
            " return Number(g.dataset.rows) >= rows || g.className === 'done'; }",
            arg=self.sent // FRAME, timeout=120_000,
        )  # fmt: skip

    def until(self, there: Callable[[], Any], step: float) -> None:
        """Send steps [s] until something is on the page."""
        while not there() and self.sent < len(self.data):
            self.send(step)

    def begin(self, page: Any) -> None:
        """Fill in the form as somebody would."""
        self.page = page
        page.goto(f"{self.served.address}/live")
        page.fill("[name=source]", str(self.port))
        page.select_option("[name=frames]", "sbg_imu_short")
        page.select_option("[name=how]", f"logs/{self.log}")
        page.fill("[name=hold]", f"{HOLD} s")
        page.fill("[name=want]", "\n".join(f"{k} = {v}" for k, v in WANT.items()))
        page.click("text=Begin")
        page.wait_for_selector("#guide")
        self.number = int(page.url.rpartition("/")[2])

    def state(self) -> dict[str, Any]:
        """Return what the guide keeps."""
        file = self.served.folder / "runs" / str(self.number) / "guide.json"
        return json.loads(file.read_text())

    def end(self) -> None:
        self.served.end()


@contextmanager
def fed(folder: Path) -> Iterator[Fed]:
    """Yield a session that is fed."""
    made = Fed(folder)
    try:
        yield made
    finally:
        made.end()


def moments(made: Fed, page: Any) -> Iterator[str]:
    """Go through a session; yield the name of each of five moments while the page shows it."""
    made.begin(page)
    page.click("#sound")

    def phase() -> str:
        return str(page.get_attribute("#guide", "class"))

    made.send(1.0)
    made.until(lambda: phase() == "rest" and made.state()["ring"] > 0.5, 0.5)
    yield "rest"
    made.until(lambda: phase() == "move", 0.3)
    yield "move"
    made.until(page.locator("#wrong li:has-text('another side')").count, 1.0)
    yield "mistake"
    made.until(lambda: made.state()["rests"] >= made.rests - 2, 2.0)
    made.until(lambda: phase() == "next", 0.4)
    yield "next"
    made.send()
    page.wait_for_selector("#guide.done", timeout=120_000)
    page.wait_for_selector("#result:visible", timeout=120_000)
    yield "verdict"
