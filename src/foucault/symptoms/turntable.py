"""What can go wrong with a session on a table."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
)
# fmt: on
