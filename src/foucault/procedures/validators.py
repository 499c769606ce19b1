"""What validators of settings share: errors that name the key of a campaign file."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from pydantic import ValidationInfo

from foucault.errors import FoucaultError

Checked = TypeVar("Checked")


LARGEST = 2e7
"""Samples that a simulated session may have: some 1 GB of readings and what makes them [1]."""


def fits(samples: float) -> None:
    """Refuse a session to simulate that is larger than memory.

    Parameters
    ----------
    samples : float
        Number of samples that it would have [1].
    """
    if samples > LARGEST:
        raise ValueError(
            f"the session would have {samples:.2g} samples, and {LARGEST:.0e} are the most: take "
            "fewer rests, shorter times or a lower rate"
        )


def located(info: ValidationInfo, check: Callable[[], Checked]) -> Checked:
    """Return what `check` does; where a file is read (`info` says so) its error names the key."""
    try:
        return check()
    except FoucaultError as problem:
        if "locate" in (info.context or ()):
            raise ValueError(problem) from None
        raise
