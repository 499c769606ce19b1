"""Rows of the table about the Allan variance.

(code, severity, symptom, message, cure), as there; kept apart only for length.
"""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("allan.kind", "error", "An Allan variance of an unknown kind",
     "'{given}' is no kind of Allan variance.{hint}",
     "Choose one of: {allowed}."),
    ("allan.axis", "error", "An axis that the log does not have",
     "The log has no axis '{given}'.{hint}",
     "Its axes are: {allowed}; 'gyro', 'accel' and 'x' choose several."),
    ("allan.factor", "error", "An averaging time the record is too short for, or not positive",
     "An averaging factor of {given} samples was asked of {samples} samples.",
     "It must be from 1 to {largest}."),
    ("allan.span", "error", "A time span without samples",
     "No sample lies between {start} s and {end} s.",
     "The log runs from {first} s to {last} s; give start and end within."),
    ("allan.too_short", "error", "A record too short for an Allan variance",
     "There are {samples} samples ({duration} s) at rest; an Allan variance needs {least} or more.",
     "Record the instrument at rest for longer: nine times the longest averaging time you want to "
     "see, and hours for a bias instability."),
    ("allan.constant", "error", "An axis that reads one value only",
     "{axis} reads one value throughout: it is stuck, or its noise is below the step of its "
     "output.",
     "Check the column in the log description; log with a finer step, or leave the axis out."),
    ("allan.stuck", "warning", "One axis of several that reads one value only",
     "{axis} reads one value throughout and was left out: it is stuck, or its noise is below "
     "the step of its output.",
     "Check the column in the log description, or log with a finer step."),
    ("allan.quantised", "warning", "A step of the output that hides the noise",
     "{axis} repeats its last value in {share} % of the samples: its noise is below the step of "
     "its output ({step}).",
     "At short averaging times this shows the converter, not the sensor. Log with a finer step."),
    ("allan.not_finite", "error", "Missing or infinite values in the record",
     "{axis} has {count} missing or infinite values, the first at sample {row} (from 0).",
     'Write missing = "drop" in [log], or choose a part of the log without them.'),
    ("allan.uneven", "error", "A record that is not evenly sampled",
     "{share} % of the intervals are more than 10 % off the usual {nominal} s; an Allan variance "
     "needs evenly spaced samples.",
     "{advice}. Else resample the log."),
    ("allan.gap", "warning", "A gap in the record",
     "The record has gaps, {count} in all; only its longest part without one is used, {start} s to "
     "{end} s.",
     "Use a logger that does not lose samples, or choose another part with --rest."),
    ("allan.moves", "warning", "A record that moves, with the part at rest chosen by the user",
     "The instrument moves between {start} s and {end} s; what is measured is motion as well as "
     "noise.",
     "Choose a part at rest; `foucault inspect` lists them."),
    ("allan.longest_rest", "note", "A log that moves: its longest rest was used",
     "The log moves; its longest rest, {start} s to {end} s, is used.",
     "Choose another part with --rest, or record the instrument at rest."),
    ("allan.small_part", "warning", "A log that moves: its longest rest is a small part of it",
     "The log moves; its longest rest, {start} s to {end} s, is used: {share} % of the log.",
     "Choose another part with --rest, or record the instrument at rest; `foucault inspect` lists "
     "the rests."),
    ("allan.shaken", "warning", "A log that is shaken now and then, but stays where it is",
     "The instrument is shaken in {share} % of the log, but stays where it is; all of the log is "
     "used, and the shaking counts as noise.",
     "Choose a quiet part with --rest, or record it where nothing shakes it."),
    ("allan.no_rest", "error", "A log that moves and has no rest long enough",
     "The instrument moves, and its longest rest has {samples} samples; an Allan variance needs at "
     "least {least}.",
     "Record the instrument at rest."),
    ("allan.hidden", "note", "A noise that the record is too short to show",
     "{axis}: {terms} not seen. The record is too short to show less than the limits given: its "
     "longest useful averaging time is {longest} s.",
     "Record the instrument at rest for longer to lower the limits."),
    ("allan.misfit", "warning", "A curve that the five noises do not describe",
     "The curve departs from the sum of the five noises by more than chance (standard deviation of "
     "the variance): {axes}.",
     "Vibration, dither, a filter or warming up shows as bumps in the plot. The uncertainties "
     "include it."),
    ("allan.nothing_seen", "error", "No noise to write into a campaign",
     "No noise was seen on any axis that a campaign file has a key for.",
     "Record the instrument at rest for longer."),
)
# fmt: on
