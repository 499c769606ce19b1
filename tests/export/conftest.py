"""Results to export: one with every term, one with the linear terms only."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from foucault.result import Result
from make_terms import SIZES, Readings, Same, with_terms


@pytest.fixture
def full() -> Result:
    return with_terms(*(f for f in SIZES if f not in ("accel.lever", "accel.delay")))


@pytest.fixture
def apart() -> Result:
    """Every term, and accelerometers that are apart and late."""
    return with_terms(*SIZES)


@pytest.fixture
def linear() -> Result:
    return with_terms(*(f for f in SIZES if f.endswith(("bias", "scale", "misalignment"))))


@pytest.fixture
def readings() -> Readings:
    """Readings of up to 4 g and 6 rad/s, shape (50, 3) each [SI]."""
    rng = np.random.default_rng(8)
    return rng.uniform(-40, 40, (50, 3)), rng.uniform(-6, 6, (50, 3))


@pytest.fixture
def same() -> Same:
    """Agreement to 1e-12 of the full range of the readings."""

    def check(got: Any, want: Any) -> None:
        got, want = np.asarray(got), np.asarray(want)
        assert np.abs(got - want).max() <= 1e-12 * np.abs(want).max()

    return check
