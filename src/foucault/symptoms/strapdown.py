"""Rows of the table about navigating from increments."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("strapdown.zero", "error",
     "Sensors that read nothing",
     "All readings of the {triad} are zero.",
     "Check the columns of [log.{triad}], their unit and scale, and whether the sensor was on."),
    ("strapdown.no_triad", "error",
     "A log that lacks one of the two triads",
     "The log has no {missing}; navigation needs accelerometers and gyros.",
     "Add [log.{missing}] to the description of the log, or its columns, titled with their units, "
     "to a log that is given alone."),
    ("strapdown.averaged", "error",
     "A log of means where every sample is needed",
     "Every row of the log is the mean over a position; navigation needs the samples.",
     "Give the log as it was recorded."),
    ("strapdown.slow", "error",
     "Rows too far apart to be navigated (a wrong unit of time)",
     "The rows are {interval} apart ({rate} Hz); navigation needs one a second at least.",
     "Correct `unit` in [log.time] (ms given as s look like this), or give the log as it was "
     "recorded."),
    ("strapdown.gap", "error",
     "A gap in the log",
     "Samples are missing at {where} ({count} in all, the longest {longest}; the usual interval is "
     "{usual}). What the instrument did meanwhile is not known.",
     "End the run before the gap, start it after, or bridge gaps (--gaps bridge): the readings "
     "before and after are then taken to hold half of it each."),
    ("strapdown.bridged", "warning",
     "A gap in the log that was bridged",
     "Gaps were bridged, {count} in all, the longest {longest} at {where}: the readings before and "
     "after were taken to hold half of it each.",
     "Do not trust what follows a gap in which the instrument may have turned or been moved."),
    ("strapdown.rows", "error",
     "A run that begins or ends outside the log",
     "Row {row} was asked for; the log has rows 0 to {last}.",
     "Give rows within the log; the start state holds at the end of its row."),
    ("strapdown.state", "error",
     "A start state that cannot be",
     "The {what} of the start is {given}; it must be {allowed}.",
     "Angles are in radians inside the library: a latitude of 47 deg is numpy.radians(47)."),
    ("strapdown.heights", "error",
     "A vertical channel that is to be aided without heights",
     "vertical = 'aided' was asked for, and {given}.",
     "Give one height for every row, not-a-number where it is unknown, or hold the height "
     "(vertical = 'held')."),
    ("strapdown.vertical", "error",
     "An unknown word for the vertical channel",
     "vertical = '{given}' is not known.{hint}",
     "Use one of: {allowed}."),
    ("strapdown.measurements", "error",
     "Measurements, or a start, that a filter cannot take in",
     "The filter cannot run: {what}.",
     "Give rows that rise, one velocity, position and standard deviation for each (infinite where "
     "nothing is measured), finite variances for all states and positive times."),
    ("strapdown.not_finite", "error",
     "Navigation that runs into numbers that are not finite",
     "The state is not finite from row {row} on, {time} s.",
     "Look for missing or saturated samples with `foucault inspect`. A log without noise, such as "
     "one that was simulated, wants [noise] in its campaign: it cannot be measured there."),
)
# fmt: on
