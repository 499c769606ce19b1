"""Rows of the table about the deflection of dithered gyros."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("deflection.model", "error",
     "An unknown model of deflection",
     "There is no model of deflection '{name}'.{hint}",
     "Models are: {allowed}."),
    ("deflection.chirality", "error",
     "A sense of the dither wheel that is none",
     "The chirality of a dither wheel is {given}; it must be -1 or 1.",
     "Leave it at -1, and try 1 where the likelihood of the log is to decide."),
)
# fmt: on
