"""Named methods, one file or folder each: a procedure glues the stages and does nothing else.

The methods of campaign files are those in `PROCEDURES`. Each module has a `record.Procedure` that
says what is its own: `Settings` and `Session` (pydantic models of its part of a campaign), how a
log is solved and a session simulated, what a plan will show. What all do alike is in `record`, and
a campaign asks nothing else. `on_faces` and `on_table` are no methods: they hold what the methods
on the faces of a cube and on a table share. `alignment`, `delay`, `merged`, `navigation` and
`temperature` are behind commands of their own.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from foucault.errors import error, suggestion

if TYPE_CHECKING:
    from foucault.procedures.record import Procedure

Progress = Callable[[float, str], None]  # Called with the fraction done and what is being done.

PROCEDURES = {
    name: f"foucault.procedures.{name}" for name in (
        "hand_rotated", "hand_rotated_published", "six_position", "ferraris", "norm_observation",
        "multi_position", "turntable", "rate_table", "continuous_spin", "magnetometer",
        "north_seeking", "platform_tumble", "systematic", "transfer_alignment", "imu_pose",
        "two_imus",
    )
}  # fmt: skip
"""Name in a campaign file -> module."""


def silent(fraction: float, words: str) -> None:
    """Tell nobody.

    `fraction`: how much is done [1].
    """


@contextmanager
def solvable() -> Iterator[None]:
    """Name equations that cannot be solved, as what is wrong with a log, not as what NumPy says.

    Raises ``solution.singular``.
    """
    from numpy.linalg import LinAlgError

    try:
        yield
    except LinAlgError as problem:
        raise error("solution.singular", why=str(problem)) from problem


def load(name: str) -> Procedure[Any, Any]:
    """Return procedure `name`; only its own module is imported."""
    if name not in PROCEDURES:
        allowed = ", ".join(PROCEDURES)
        hint = suggestion(name, PROCEDURES)
        raise error("campaign.procedure", name=name, hint=hint, allowed=allowed)
    found: Procedure[Any, Any] = importlib.import_module(PROCEDURES[name]).PROCEDURE
    return found
