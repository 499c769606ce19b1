"""Made-up sessions, and the folder of real logs."""

import os
from pathlib import Path

import numpy as np
import pytest

from foucault.logs import LogDescription, read
from foucault.tables import Log

REAL = Path(os.environ.get("FOUCAULT_DATA", Path(__file__).parents[3] / "shared" / "data"))


@pytest.fixture
def real():
    """Return the folder of a real log, or skip."""

    def folder(name):
        if not (REAL / name).is_dir():
            pytest.skip(f"real logs are not here: set FOUCAULT_DATA ({REAL / name})")
        return REAL / name

    return folder


@pytest.fixture
def log():
    """A noisy log of 500 samples at 100 Hz, z up, with temperature."""
    rng = np.random.default_rng(7)
    n = 500
    accel = rng.normal(0.0, 0.02, (n, 3)) + np.array([0.0, 0.0, 9.81])
    gyro = rng.normal(0.0, 0.002, (n, 3))
    time = 1.7e9 + np.arange(n) / 100.0
    return Log(time, gyro, accel, "rate", 293.15 + rng.normal(0.0, 0.01, n))


@pytest.fixture
def read_text(tmp_path):
    """Write a text file and read it; keywords go into the description."""

    def run(text, name="log.csv", **words):
        (tmp_path / name).write_text(text)
        return read(LogDescription.model_validate({"file": name, **words}), tmp_path)

    return run
