"""Rows of the table about watching a log while it is recorded."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("watch.nothing", "error",
     "Nothing to watch",
     "Neither a log or campaign file nor --stdin was given.",
     "Name the campaign file, or pipe the logger into `foucault watch campaign.toml --stdin`."),
    ("watch.format", "error",
     "A growing log of a format that only a whole file can have",
     "'{file}' cannot be followed while it grows: it is {format}.",
     "Let the logger write delimited text, or pipe its lines into --stdin."),
    ("watch.several_files", "error",
     "A growing log in several files",
     "[log] reads from {count} files ({files}); one growing file can be followed.",
     "Let the logger write one file with all columns, or record first and use "
     "`foucault inspect`."),
    ("watch.no_accel", "error",
     "A growing log without accelerometers",
     "'{file}' has no accelerometer columns; they tell which side is up.",
     "Add [log.accel] to the campaign."),
    ("watch.timeout", "error",
     "A log that does not appear",
     "No sample came from '{file}' within {timeout} s: {what}.",
     "Start the logger, correct `file` in [log], or wait longer with --timeout."),
    ("watch.lines", "warning",
     "Lines of a growing log that cannot be used",
     "Lines or rows left out so far: {count}. The first: {reason}",
     "`foucault calibrate` reads only what is whole: mend the connection of the logger, or delete "
     "these lines before calibrating; for missing values write missing = \"drop\" in [log]."),
    ("watch.restarted", "note",
     "A growing log that was emptied or replaced",
     "'{file}' was written anew.",
     "What was seen before no longer counts."),
    ("watch.not_quiet", "warning",
     "No quiet time to compare with",
     "The quietest time so far still shakes by {accel} m/s^2 and {gyro} deg/s.",
     "Put the instrument down, or hold it still, for a few seconds."),
)
# fmt: on
