"""What is refused: the error of a code, with these words in its text."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from foucault.errors import FoucaultError


@contextmanager
def refuses(
    code: str, *said: str, match: str | None = None
) -> Iterator[pytest.ExceptionInfo[FoucaultError]]:
    """Want the error of a code, whose message and cure say all of these words."""
    with pytest.raises(FoucaultError, match=match) as caught:
        yield caught
    assert caught.value.code == code, str(caught.value)
    for words in said:
        assert words in str(caught.value)


def refused(call: Callable[..., Any], *words: Any, **more: Any) -> FoucaultError:
    """Return the error that a call ends with."""
    with pytest.raises(FoucaultError) as caught:
        call(*words, **more)
    return caught.value
