"""What can go wrong with a plan of manoeuvres."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("manoeuvre.empty", "error",
     "A plan of manoeuvres without a segment",
     "The plan has no segments.",
     "Give at least one, such as Rest(time=300)."),
    ("manoeuvre.value", "error",
     "A number in a plan of manoeuvres that cannot be",
     "`{key}` of {what} is {given}; it has to be {allowed}.",
     "Correct it. Inside a plan times are in seconds, lengths in metres and angles in radians."),
    ("manoeuvre.axis", "error",
     "A rotation on a table about an axis that is not known",
     "{what} turns about '{given}'.{hint}",
     "Write one of {allowed}: axes of the body, and level axes."),
    ("manoeuvre.climb_twice", "error",
     "A climb with both an angle and a height, or neither",
     "{what} is given {given}.",
     "Give `angle` to go on climbing at that angle, or `height` to climb so far and be level "
     "again."),
    ("manoeuvre.moving", "error",
     "A rest or a rotation on a table while the vehicle moves",
     "{what} needs a vehicle at rest; at {time:.6g} s it still goes at {speed:.6g} m/s.",
     "Put Accelerate(speed=0, time=...) before it."),
    ("manoeuvre.still", "error",
     "A manoeuvre that needs speed, at rest",
     "{what} needs a vehicle that moves; at {time:.6g} s it is at rest.",
     "Put Accelerate before it. A turn on the spot is Turn with banked=False."),
    ("manoeuvre.not_level", "error",
     "A climb by a height that does not begin level",
     "{what} begins level and ends level; at {time:.6g} s the vehicle climbs at {given:.4g} deg.",
     "Put Climb(angle=0, time=...) before it."),
    ("manoeuvre.steep", "error",
     "A climb or a bank that is too steep",
     "{what} needs {quantity} of {given:.4g} deg; the limit is {limit:.4g} deg.",
     "Give it more time, or go slower; ask for less of a climb or turn, or turn with "
     "banked=False."),
    ("manoeuvre.pole", "error",
     "Headings from north too close to a pole",
     "The plan comes to latitude {given:.6f} deg, where north turns with every step; headings "
     "from north are possible up to {limit} deg.",
     'Write headings="start": headings are then from a direction that is carried along and does '
     "not turn with the meridians."),
)
# fmt: on
