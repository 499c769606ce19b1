"""One workbench and one browser for the tests that drive it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import pytest

from foucault.workbench import people
from make_browser import WITHOUT, chromium, driven, watched
from make_workbench import Served, log_text


class Laboratory:
    """A workbench that is served, with a log and its run, which is kept."""

    def __init__(self, folder: Path) -> None:
        self.served = Served(folder, "--workers", "1")
        self.address, self.folder = self.served.address, folder
        self.log, self.run = self.calibrated(1)
        kept = {"instrument": "IMU 7", "date": "2026-03-01"}
        self.served.api("POST", f"/jobs/{self.run}/keep", json=kept)

    def calibrated(self, seed: int) -> tuple[str, int]:
        """Send a log in and calibrate it; returns its name and the number of the job."""
        file = {"file": (f"drive {seed}.csv", log_text(seed))}
        log = self.served.api("POST", "/logs", files=file)["log"]
        asked = {"command": "calibrate", "log": log, "options": {"latitude": "47.3 deg"}}
        number = self.served.api("POST", "/jobs", json=asked)["number"]
        assert self.served.ended(number)["verdict"] == "pass"
        return log, number

    @cached_property
    def second(self) -> int:
        """The job of a second run."""
        return self.calibrated(2)[1]


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hash passwords at once."""
    from argon2 import PasswordHasher

    hasher = PasswordHasher(time_cost=1, memory_cost=64, parallelism=1)
    monkeypatch.setattr(people, "_hasher", lambda: hasher)


@pytest.fixture(scope="session")
def laboratory(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Laboratory]:
    """The workbench of all browser tests."""
    if chromium() is None:
        pytest.skip(WITHOUT)
    made = Laboratory(tmp_path_factory.mktemp("laboratory"))
    yield made
    made.served.end()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A Chromium; of a module, since its driver holds an event loop."""
    if chromium() is None:
        pytest.skip(WITHOUT)
    with driven() as made:
        yield made


@pytest.fixture
def opened(browser: Any) -> Iterator[Callable[..., Any]]:
    """Open pages in windows of their own; none of them may complain."""
    said: list[list[str]] = []
    windows = []

    def open_(address: str, complains: bool = False, **how: Any) -> Any:
        how = {"viewport": {"width": 1280, "height": 900}, "service_workers": "block"} | how
        windows.append(browser.new_context(**how))
        page = windows[-1].new_page()
        page.set_default_timeout(60_000)
        if not complains:
            said.append(watched(page))
        page.goto(address)
        return page

    yield open_
    for one in windows:
        one.close()
    assert not [line for lines in said for line in lines]
