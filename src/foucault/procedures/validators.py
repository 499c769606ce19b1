"""What validators of settings share: errors that name the key of a campaign file."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from pydantic import ValidationInfo

from foucault.errors import FoucaultError

Checked = TypeVar("Checked")


def located(info: ValidationInfo, check: Callable[[], Checked]) -> Checked:
    """Return what `check` does; where a file is read (`info` says so) its error names the key."""
    try:
        return check()
    except FoucaultError as problem:
        if "locate" in (info.context or ()):
            raise ValueError(problem) from None
        raise
