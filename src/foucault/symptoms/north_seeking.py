"""What can go wrong when north is sought, and when a north seeker is calibrated."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("north.latitude", "error",
     "A latitude too near to a pole",
     "The latitude is {given} deg; beyond +-89 deg the horizontal part of the Earth's rate is less "
     "than 2 % of the whole.",
     "Check the unit of the latitude (deg or rad). Near a pole take the heading from GNSS or the "
     "stars."),
    ("north.fix_latitude", "error",
     "North sought without a latitude",
     "The latitude is not given.",
     'Give it, --latitude "47.3 deg" or [site]; or let it be found, --unknown-latitude or '
     "unknown_latitude = true in [procedure]."),
    ("north.calibration_latitude", "error",
     "A calibration without latitude",
     "The latitude is not given, so that the Earth's rate at the turntable is not known.",
     'Write latitude = "48.8462 deg" in [site].'),
    ("north.contradiction", "error",
     "Settings that contradict one another",
     "Given are {first} and {second}.",
     "Leave one of them out."),
    ("north.offset_alone", "error",
     "An offset of the gyro without its uncertainty",
     "[procedure] gives gyro_offset without gyro_offset_sd.",
     'Say how well it is known, gyro_offset_sd = "0.5 deg/h"; or leave it out, and it is found.'),
    ("north.no_heading", "error",
     "A calibration without reference headings",
     "The log has no reference headings: errors of the instrument and its heading cannot be told "
     "apart.",
     'Describe the heading of the table, clockwise from north, in [log]: heading.column = '
     '"heading" and heading.unit = "deg".'),
    ("north.heading_missing", "error",
     "A reference heading that is missing",
     "The set-ups {names} have no reference heading.",
     "Give every row its heading, or take the rows out."),
    ("north.level_sd", "error",
     "No accelerometers, and nothing said of the level",
     "There are no readings of an accelerometer, and `level_sd` does not say how level the "
     "instrument stood: a tilt of 1 arcmin about the north axis turns the heading by 1 arcmin "
     "times the tangent of the latitude.",
     'Say how level it stood, --level-sd "1 arcmin" or level_sd in [procedure]; or give the '
     "accelerometer, as a column titled specific force (g) or in [log.accel]."),
    ("north.tilt_unknown", "error",
     "A tilted table and no accelerometers",
     "tilt = \"each\" needs accelerometers, which the log has not.",
     "Describe them in [log.accel], or calibrate level with tilt = \"one axis\"."),
    ("north.tilt_plan", "error",
     "A table that cannot be tilted so far",
     "The tilts of the plan are {given}.",
     "Choose tilts between -89 and 89 deg."),
    ("north.stuck", "error",
     "A gyro or an accelerometer that reads one value only",
     "The {sensor} reads {value} in {rows} of {of} rows, one after the other.",
     "It is stuck, or another column is meant: check [log.{triad}]. Accelerometers that do not "
     "work are left out of [log]; `level_sd` in [procedure] says how level the instrument stood."),
    ("north.undetermined", "error",
     "Headings that do not determine the calibration",
     "These headings do not show: {names}.",
     "Use at least three headings, better twelve, spread over the whole circle; every heading "
     "needs stops on both sides, 0 and 180 deg, 90 and 270 deg."),
    ("north.sense", "error",
     "Index angles or headings that run the other way",
     "The gyro follows the headings as in a mirror.",
     "Headings and index angles count clockwise seen from above. Correct sense in [log.index] "
     '("clockwise" or "counter-clockwise"), the sign of the headings ("-heading"), or their unit.'),
    ("north.index_zero", "error",
     "An index zero that is not forward",
     "The sensing axis at index angle 0 is {angle} deg from where the reference headings say.",
     'Give the index angle that is forward: zero = "... deg" in [log.index]; or correct the '
     "reference headings, which are those of forward."),
    ("north.not_a_number", "error",
     "A reading that is missing",
     "Set-up '{name}' has a reading that is not a number.",
     "Measure it again, or take the set-up out."),
    ("north.scale_common", "warning",
     "Scale factors that are far off together",
     "Both scale factors of the gyro are off by {size} %, as if the latitude were {latitude} deg.",
     "Check latitude and its sign in [site], unit and scale of [log.gyro], and, of a tilted table, "
     "`reads` in [log.accel]."),
    ("north.turned", "warning",
     "Reference headings or an index zero that may be off",
     "The sensing axis at index angle 0 is {angle} deg from where the reference headings say; it "
     "was taken as an error of the instrument, and every later heading depends on it.",
     'Check where the table reads zero and what is forward: zero = "... deg" in [log.index].'),
    ("north.stop_offsets", "note",
     "Stops with biases of their own",
     "At the same stops the gyro reads the same amounts too much in every set-up, {size} deg/h at "
     "{stop} deg, beyond what looks like a rate. That cancels over these stops, and is taken off "
     "the readings here and in later fixes.",
     "Nothing to do; with other stops than these it would not cancel."),
    ("north.stop_gains", "note",
     "Gains that differ from stop to stop",
     "The gains or cross terms of the gyro differ from one sense of the base to the other by up to "
     "{size} ppm (the probability of so much by chance is {p}). That cancels over these stops, and "
     "is taken off the readings here and in later fixes.",
     "Nothing to do; with other stops than these it would not cancel."),
    ("north.wedge", "note",
     "A bias of the accelerometers that may be a tilt",
     "The accelerometers read {bias} mg that turn with the case. It was taken as their bias; if "
     "the case stood askew on the table by {lean} arcmin, later tilts are off by that.",
     "Check how the case was seated. Headings are right either way: they refer to the axis of the "
     "table."),
    ("north.gyro_scale", "error",
     "A gyro in a wrong unit",
     "The gyro says {factor} times the Earth's rate.",
     "Check unit and scale of [log.gyro]: deg/s for deg/h is a factor of 3600, rad/s for deg/s "
     "57.3; and the latitude. A factor of 0 is a gyro that reads nothing."),
    ("north.noise_unknown", "error",
     "Noise that nobody knows",
     "The noise of the gyro is not declared, and there are too few readings to measure it.",
     "Declare it: {what}. `foucault allan` finds it in a log of the gyro at rest."),
    ("north.z_left_out", "warning",
     "A coupling that is there and was left out",
     "The tilted session shows a coupling of the rate along the axis of the base (chance gives as "
     "much with probability {p}), which z_coupling = \"no\" leaves out.",
     'Write z_coupling = "auto".'),
    ("north.z_not_seen", "note",
     "Couplings that a tilted calibration hardly showed",
     "The coupling of the rate along the axis of the base is not significant (chance gives as much "
     "with probability {p}); free, it makes the other parameters less certain.",
     'Tilt further or dwell longer, or write z_coupling = "auto": what is known of it beforehand, '
     "`z_coupling_sd`, then counts too."),
    ("north.heading_outlier", "warning",
     "A heading that does not fit the others",
     "Set-up '{name}' is {size} standard deviations from what the others say.",
     "Repeat it, or check its heading and its readings."),
    ("north.other_result", "error",
     "A calibration of something else",
     "'{file}' is a result of {given}, not of the calibration of a north seeker.",
     "Calibrate the instrument with procedure = \"north_seeking\"."),
    ("north.other_serial", "error",
     "A calibration of another instrument",
     "The readings are of instrument {given}, the calibration is of {other}.",
     "Take the calibration of this instrument, or correct the serial number."),
    ("north.calibration_doubtful", "warning",
     "A calibration that did not pass",
     "The calibration is {level}: {reason}",
     "Look at its report before trusting the headings."),
    ("north.stops", "error",
     "Stops that do not show the attitude",
     "Set-up '{name}' stops at {stops} deg: that does not show the Earth's rate along two "
     "directions.",
     'Stop at three index angles or more, such as 0, 180, 90, 270 deg; or give a rough heading, '
     '--near "120 deg" or near in [procedure], and for two stops that are not opposite the '
     "gyro's offset, gyro_offset_sd. The rows of a set-up must follow one another."),
    ("north.stops_tilt", "error",
     "Stops that do not show the tilt",
     "Set-up '{name}' stops at {stops} deg: an accelerometer on the base sees the tilt in one "
     "direction only.",
     'Say how level the case stands about the other, --level-sd "1 arcmin" or level_sd in '
     "[procedure]; or stop at three index angles or more."),
    ("north.opposite_missing", "warning",
     "A stop without its opposite",
     "In set-up '{name}' the stop at {stop} deg has no opposite one: what bias and scale do at "
     "that index angle does not cancel.",
     "Add the stop at {missing} deg."),
    ("north.stop_repeated", "note",
     "A stop that comes twice",
     "In set-up '{name}' the base stopped twice running at {stop} deg; the other stops were "
     "{other} deg.",
     "Nothing to do if it was meant; otherwise a stop was forgotten or an index angle mistyped."),
    ("north.overlap", "warning",
     "Means that overlap",
     "In set-up '{name}' a mean over {dwell} s is followed by the next after {step} s.",
     "Check the units of time and dwell in [log], and that time is the beginning of each mean."),
    ("north.stops_differ", "warning",
     "Set-ups with other stops",
     "Set-up '{name}' has {given} stops ({angles} deg); most have {most}.",
     "A reading is missing or was entered twice, unless it was measured so."),
    ("north.ambiguous", "warning",
     "Two headings that fit",
     "Set-up '{name}': heading {other} deg (latitude {latitude} deg) fits as well.",
     'Give the latitude, if only roughly, with --latitude-sd "1 deg" or latitude_sd; or a rough '
     'heading, --near "120 deg" or near.'),
    ("north.other_stops", "warning",
     "Stops that were not calibrated",
     "The calibration was made with stops at {calibrated} deg; here the base {given}.",
     "What repeats with the index angle may be another there: use the same stops, or calibrate "
     "with these."),
    ("north.other_temperature", "warning",
     "Another temperature than that of the calibration",
     "Here it is {given} degC; the calibration was made at {calibrated} degC.",
     "Calibrate at this temperature, or let the instrument come to that of the calibration."),
    ("north.reference", "warning",
     "A heading that contradicts its reference",
     "In set-up '{name}' the heading is {away} deg from the reference heading in the file, {size} "
     "standard deviations.",
     "One of them is wrong: check the calibration, the index zero, and what the reference refers "
     "to (true, grid or magnetic north)."),
    ("north.index_lag", "warning",
     "A turning base whose index angles may be late",
     "The base turns at {rate} deg/s: if the index angle is read {lag} before or after the middle "
     "of the gyro's reading, half a sample, every heading is off by {effect} deg.",
     'Say how well the two belong together, index_lag_sd = "1 ms"; it is then part of the '
     "uncertainty. Turning both ways, in a set-up each, shows it."),
    ("north.far", "warning",
     "A heading far from the rough one",
     "In set-up '{name}' the heading is {away} deg from the rough one that was given.",
     "Check --near, which is the heading of the forward axis, and the sense of the index angles."),
    ("north.clamped", "warning",
     "More horizontal rate than the Earth has",
     "In set-up '{name}' the rates along x and y together are {size} of the Earth's rate; the rate "
     "along z was taken as zero.",
     "By noise it happens near the equator or at large tilts: dwell longer. Far above 1, unit or "
     "scale of the gyro are wrong."),
    ("north.too_fast", "error",
     "More than the Earth's rate",
     "In set-up '{name}' the gyro sees {size} times the Earth's rate.",
     "Check unit and scale of the gyro (deg/s for deg/h is a factor of 3600), look for a mistyped "
     "reading, and make sure that the instrument stood still."),
    ("north.tilt", "error",
     "A tilt that is none",
     "In set-up '{name}' the accelerometers see {size} g along x and y together; up to 90 deg of "
     "tilt it is less than 1.",
     "Check unit and scale of the accelerometer. At a tilt of 90 deg heading is not defined: turn "
     "the instrument in its mount."),
    ("north.no_calibration", "note",
     "North sought without a calibration",
     "No calibration was given: errors of the gyro that repeat with the index angle count as zero, "
     "and the uncertainty knows nothing of them.",
     "Give --calibration RESULT, or say how large they can be, such as \"gyro.bias\" in [prior]."),
    ("north.misfit", "warning",
     "An Earth's rate that does not fit the latitude",
     "Rate, gravity and latitude contradict one another by {size} standard deviations; they agree "
     "if {causes}.",
     "Check that first: headings change by up to {change} deg."),
    ("north.hemisphere", "note",
     "A hemisphere that was assumed",
     "Without latitude the hemisphere was taken as {hemisphere}.",
     'If it is not, say so: --hemisphere {other}, or hemisphere = "{other}" in [procedure]. It '
     "decides between two roots."),
    ("north.dwell_short", "warning",
     "Dwells too short for the wanted accuracy",
     "In set-up '{name}' the heading has a standard deviation of {sd} deg; {wanted} deg was "
     "wanted.",
     "{cure}"),
    ("north.reading_outlier", "warning",
     "A reading that does not fit the others",
     "In set-up '{name}' the reading at index angle {stop} deg is {size} standard deviations from "
     "what the others say.",
     "Repeat it, or look for a disturbance in it."),
)
# fmt: on
