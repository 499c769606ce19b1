"""Rows of the table about the H-infinity filter."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("h_infinity.gamma", "error",
     "A bound of the H-infinity filter that is not positive",
     "gamma is {given}; it must be above 0.",
     "Leave it out: the least one is then found, and a multiple of it taken."),
    ("h_infinity.wanted", "error",
     "What an H-infinity filter is asked for does not fit its states",
     "L has shape {shape}; it needs two dimensions and a column for each of the {states} states.",
     "Give one row for every combination of states that is wanted."),
    ("h_infinity.none", "error",
     "No bound at all for which the H-infinity filter exists",
     "Even with gamma {tried} the filter does not exist.",
     "Look at the covariances: one that is zero, or not finite, leaves nothing to be bounded."),
)
# fmt: on
