"""How many examples property-based tests try: few and always the same, or many by request.

``FOUCAULT_FUZZ=thorough pytest tests/fuzz`` draws new ones, a hundred times as many.
"""

from __future__ import annotations

import os
from datetime import timedelta

from hypothesis import HealthCheck, settings

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
