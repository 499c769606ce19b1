"""How many examples property-based tests try, and a look at every text that a test makes.

``FOUCAULT_FUZZ=thorough pytest tests/fuzz`` draws new examples, many times as many; otherwise they
are few and always the same. Every error and finding that comes up in a test has to read well with
the values it was filled with.
"""

from __future__ import annotations

import gc
import os
import re
from collections.abc import Iterator
from datetime import timedelta
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

import make_long
from foucault import errors
from make_browser import WITHOUT, chromium

_SLOW = [HealthCheck.too_slow, HealthCheck.function_scoped_fixture, HealthCheck.data_too_large]
_HANG = timedelta(seconds=30)  # a busy machine takes its time; what hangs takes longer

settings.register_profile(
    "quick", max_examples=60, derandomize=True, database=None, deadline=_HANG,
    suppress_health_check=_SLOW,
)  # fmt: skip
settings.register_profile(
    "thorough", max_examples=1000, deadline=_HANG, suppress_health_check=_SLOW
)
settings.load_profile(os.environ.get("FOUCAULT_FUZZ", "quick"))

_ODD = re.compile(r"[{}]|\bnp\.\w+\(|\barray\(|(?<!')  (?!')|\(SI\)|(?<![\w.'\"])\d[\d.]*e\+0\d")
"""A field left open, what Python prints, doubled spaces, no unit, or an exponent."""

_odd: list[str] = []
_fill = errors._filled


def _filled(code: str, values: Any) -> tuple[str, str]:
    message, cure = _fill(code, values)
    if found := _ODD.search(f"{message} {cure}"):
        _odd.append(f"{code}, '{found[0]}': {message} {cure}")
    return message, cure


errors._filled = _filled


@pytest.fixture(autouse=True)
def every_text_reads_well(request: pytest.FixtureRequest) -> Iterator[None]:
    """Refuse a text with something odd in it; fuzzed files have any words."""
    _odd.clear()
    yield
    if request.node.path.parent.name not in ("fuzz", "contracts"):
        assert not _odd


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what `long.toml` names: it took long when it was measured."""
    rows = make_long.table()
    for item in items:
        path = item.path.relative_to(make_long.HERE).as_posix()
        if {item.name, item.name.partition("[")[0]} & set(rows.get(path, ())):
            item.add_marker("long")


def pytest_collection_finish(session: pytest.Session) -> None:
    """Keep what was collected, a million objects, out of every later search for garbage."""
    gc.collect()
    gc.freeze()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say in the last lines what could not be tried here."""
    if chromium() is None:
        terminalreporter.write_line(WITHOUT, yellow=True)
