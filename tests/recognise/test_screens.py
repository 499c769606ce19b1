"""The screens of the docs are what the program prints."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

import make_bare as make

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.thorough
@pytest.mark.parametrize(
    "screen", ["phyphox", "sensorlog", "px4", "rostopic", "german", "question"]
)
def test_a_screen_is_recorded_to_the_letter(screen, tmp_path):
    spec = importlib.util.spec_from_file_location("record_screens", DOCS / "record_screens.py")
    assert spec is not None and spec.loader is not None
    record = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(record)
    typed = record.RECORDED[screen]
    log = make.truth(1, 50.0, 12)
    for name in make.LOGGERS:
        if f"{name}.csv" in typed:
            make.write(name, tmp_path, log)
    kept = (DOCS / "screens" / f"{screen}.txt").read_text(encoding="utf-8")
    assert record.recorded(typed, tmp_path) == kept
