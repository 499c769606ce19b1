"""Rows of the table about applying a result to a log and exporting it."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    # Applying
    ("apply.instrument", "error",
     "A log of another instrument than the result",
     "The result is for {what} '{result}', the log says {what} '{log}'.",
     "Use the result of this instrument; --force applies the other one all the same."),
    ("apply.scale", "error",
     "A log read with another count scale than the calibrated one",
     "The calibrated log was read with [log.{triad}] scale = '{result}', this one with '{log}'. "
     "Coefficients belong to the scale they were found with.",
     "Use the scale of the calibration; --force applies the result all the same."),
    ("apply.unusable", "error",
     "An unusable result is applied",
     "The result is unusable: {reasons}",
     "Calibrate again as the report advises; --force applies it all the same."),
    ("apply.again", "error",
     "A log that has been calibrated already",
     "'{file}' is calibrated already: applying a result again would take the errors off twice.",
     "Give the log as it was recorded; --force applies the result all the same."),
    ("apply.onto_itself", "error",
     "A calibrated log would replace the recorded one",
     "'{path}' is the log itself.",
     "Choose another name with -o; the recorded log is worth keeping."),
    ("apply.needs_accel", "error",
     "Gyros with g-sensitivity or deflection, or a cluster's, without accelerometers",
     "{file} has no accelerometer columns, but the result corrects the gyros for specific "
     "force.",
     "Describe the accelerometers in [log.accel]; an IMU can also be calibrated without "
     "g_sensitivity."),
    ("apply.needs_gyro", "error",
     "Accelerometers with lever arms or a delay, without gyros",
     "{file} has no gyro columns, but the result corrects the accelerometers for where they are "
     "and when they read, which turns show.",
     "Describe the gyros in [log.gyro]; or calibrate with lever_arms = false and delay = false."),
    ("apply.outside", "warning",
     "A log outside the range that the calibration covered",
     "{words}: more than the calibration covered.",
     "There the result is extrapolated. Trust it less, or calibrate over the wider range."),
    ("apply.untouched", "warning",
     "A log with a triad that was not calibrated",
     "The result has no {triad} coefficients: the {triad} columns are written as they were read.",
     "Calibrate with a log that has {triad} columns if they are to be corrected."),
    # Exporting
    ("export.receiver", "error",
     "An unknown receiver",
     "There is no export to '{given}'.{hint}",
     "Receivers are: {allowed}."),
    ("export.cluster", "error",
     "The result of a torqued cluster or a north seeker, for a receiver of an IMU's readings",
     "The result of {procedure} is not of three gyros and three accelerometers that are read; "
     "{receiver} takes those of an IMU.",
     "Export it to one of {allowed}."),
    ("export.whole", "error",
     "Part of the result of a torqued cluster or a north seeker, or other axes",
     "The result of {procedure} is exported whole and in its own axes: {option} has no place.",
     "Leave {option} out."),
    ("export.axes", "error",
     "Unknown axes of a receiver",
     "Axes '{given}' are not known.{hint}",
     "Axes are: {allowed}."),
    ("export.axes_fixed", "error",
     "Axes asked for that the receiver does not have",
     "The export to {receiver} is always in the axes {axes}, not '{given}'.",
     "Leave out --axes, or export to json for matrices in other axes."),
    ("export.inexpressible", "error",
     "The receiver has no place for some coefficients",
     "{receiver} cannot express {terms}.",
     "Choose another receiver, or accept the loss by name: {options}. The loss is written into "
     "the file."),
    ("export.unusable", "error",
     "An unusable result is exported",
     "The result is unusable: {reasons}",
     "Calibrate again as the report advises; --force exports it all the same."),
    ("export.not_finite", "error",
     "A result with unknown coefficients is exported",
     "The result of {procedure} has coefficients that are not numbers.",
     "Calibrate again as the report advises."),
)
# fmt: on
