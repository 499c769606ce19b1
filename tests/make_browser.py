"""A real Chromium for the tests, where there is one."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")

WITHOUT = (
    "No Chromium was found (CHROMIUM, or on the path one of " + ", ".join(NAMES) + "): "
    "the browser tests were left out."
)


def chromium() -> str | None:
    """Return where a Chromium is: the variable CHROMIUM, or a usual name on the path."""
    named = os.environ.get("CHROMIUM")
    if named:
        return shutil.which(named)
    return next(filter(None, map(shutil.which, NAMES)), None)


@contextmanager
def driven() -> Iterator[Any]:
    """Yield a Chromium that is driven; it reaches nothing but this computer."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(
            executable_path=chromium(), env={**os.environ, "NO_PROXY": "*"},
            args=["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
                  "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1"],
        )  # fmt: skip
        try:
            yield browser
        finally:
            browser.close()


def watched(page: Any) -> list[str]:
    """Return a list that fills with what a page complains of: scripts, policy, what is lacking."""
    said: list[str] = []
    page.on("console", lambda m: said.append(m.text) if m.type == "error" else None)
    page.on("pageerror", lambda problem: said.append(str(problem)))
    page.on("request", lambda r: None if r.url.startswith(("http://127.0.0.1:", "blob:", "data:"))
            else said.append(f"asks for {r.url}"))  # fmt: skip
    return said
