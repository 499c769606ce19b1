"""What can go wrong when a plan is asked what it can see."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("observability.prior", "error",
     "A prior that cannot be used",
     "Every state needs a standard deviation before the data that is positive, and finite where it "
     "is the unit; {names}: {given}.",
     "Give the size that is likely, such as the limit in the data sheet; the order is enough."),
    ("observability.noise", "error",
     "Readings without noise",
     "The standard deviation of the noise must be positive and finite; given: {given}.",
     "Give the noise of one reading of each output [SI]."),
    ("observability.segment", "error",
     "A segment that does not fit the states",
     "Segment {segment}: {what}.",
     "F has one row and one column per state, H one column per state and one row per output; all "
     "numbers are finite, and the duration is positive."),
)
# fmt: on
