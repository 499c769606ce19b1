"""What can go wrong where a log is navigated and compared with what is known."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("reference.titles", "error",
     "A reference file whose titles do not say what it holds",
     "The reference '{file}' has {have}: {reason}.",
     "Title the columns with their units: time (s), latitude (deg), longitude (deg), height (m), "
     "velocity east (m/s), velocity north (m/s), velocity up (m/s), heading (deg), pitch (deg), "
     "roll (deg); time and positions or velocities are needed."),
    ("reference.time", "error",
     "A reference whose time does not run forward",
     "The reference '{file}' has {rows} rows, and its time does not rise from each to the next.",
     "Leave out repeated rows and sort it by time; two rows are the least."),
    ("reference.latitude", "error",
     "A reference with an impossible latitude",
     "The reference '{file}' has a latitude of {given} deg.",
     "Latitudes lie between -90 and 90 deg: check the unit in its title, and the order of latitude "
     "and longitude."),
    ("reference.place_swapped", "error",
     "Latitude and longitude of a reference that are exchanged",
     "The reference '{file}': its velocities miss its positions by {miss} m in {time} s, and by "
     "{better} m with latitude and longitude exchanged.",
     "Exchange the titles of its columns latitude and longitude."),
    ("navigate.apart", "error",
     "A reference and a navigation without common time",
     "The navigation lasts from {first} s to {last} s, the reference from {start} s to {end} s: "
     "fewer than two epochs are common.",
     "Both must have the same clock; shift the time of the reference."),
    ("navigate.place", "error",
     "Navigation without a latitude",
     "The latitude is not known; without it neither gravity nor the Earth's rate is.",
     'Give --latitude "47.3 deg" (and --longitude, --height), latitude in [site] of a campaign '
     "file, or a reference with positions."),
    ("navigate.place_later", "error",
     "A reference that does not say where a navigation starts",
     "The navigation starts at {start} s; the reference lasts from {first} s to {last} s and has "
     "no position of that time.",
     "Give --latitude, --longitude and --height of the start, or a reference that begins with the "
     "log."),
    ("navigate.elsewhere", "error",
     "A reference of another place",
     "The place given is {given}, but the reference starts at latitude {latitude} deg, longitude "
     "{longitude} deg.",
     "Check the order of latitude and longitude in the reference, their unit, and --latitude and "
     "--longitude."),
    ("navigate.moving", "error",
     "A rest during which the reference moves",
     "The instrument seemed to rest from {start} s to {end} s, but the reference moves by {way} m "
     "meanwhile.",
     'Say where it rests with --from and --align "60 s", or give the start attitude with '
     "--heading, --pitch and --roll; or the clocks of log and reference differ."),
    ("navigate.not_still", "warning",
     "A log that moves, and --still",
     "--still says that the instrument never left its site, but its velocity changes by {change} "
     "m/s within {time} s.",
     "Leave --still out and give --reference FILE."),
    ("navigate.latitude", "warning",
     "A latitude of a reference that the Earth's rate contradicts",
     "The start was taken from the reference: latitude {latitude} deg, longitude {longitude} deg.",
     "Check that its columns of latitude and longitude are not exchanged and that their unit is "
     "the one in the titles, or give --latitude."),
    ("navigate.course", "warning",
     "A navigation that sets out in another direction than its reference",
     "The path that was computed sets out at {seen} deg where the reference goes at {wanted} deg, "
     "{off} deg apart.",
     "The heading at the start is wrong: by the bias of the gyros, by axes (two columns swapped or "
     "one sign wrong in both triads does not show at rest), or by a reference of another drive."),
    ("navigate.clock", "warning",
     "A reference whose clock may be off",
     "The error goes with the velocity, as if the clock of the reference were about {offset} s "
     "{way}; that makes {distance} m.",
     "Compare the clocks: the times of the reference should be {offset} s {change}. A reference "
     "point {distance} m {place} the instrument looks alike at a steady speed."),
    ("navigate.no_rest", "error",
     "No rest to align in",
     "No rest of {least} s or more was found {where}.",
     'Say where the instrument rests: `foucault navigate` takes --align "300 s" (the start is a '
     "rest for so long), or the start attitude with --heading, --pitch and --roll; `foucault "
     'align` takes --from "0 s" --until "300 s".'),
    ("navigate.heading", "error",
     "Gyros that do not show north, and no start heading",
     "The start attitude is missing: {why}.",
     'Give the heading with --heading "90.6 deg" and --heading-sd "0.1 deg", a calibration that '
     "knows the gyro bias, or a longer rest; where the rest was disturbed, also the noise of the "
     "sensors (--gyro-noise, --accel-noise), which is measured in it otherwise."),
    ("navigate.attitude", "error",
     "A start attitude given in part",
     "{given} was given without {missing}.",
     "Give --heading alone (pitch and roll then come from the accelerometers at rest), or "
     "--heading, --pitch and --roll."),
    ("navigate.velocity", "error",
     "A start velocity beside a rest",
     "{given} was given without the whole attitude; a start that is aligned at rest has no "
     "velocity.",
     "Give --heading, --pitch and --roll of the same moment too, as a hand-over has them; or leave "
     "{given} out."),
    ("navigate.three", "error",
     "A velocity that is not three components",
     "--velocity is '{given}'.",
     'Write velocities east, north and up: --velocity "12.1 m/s, -3.4 m/s, 0 m/s".'),
    ("navigate.position", "error",
     "A start position given in part",
     "--position-sd was given without {missing}.",
     "Give --latitude, --longitude and --height of the start, whose standard deviation it is; or "
     "leave --position-sd out."),
    ("navigate.speed_at_start", "warning",
     "A navigation that may not start at rest",
     "The attitude is given and the log has no rest at the start; the velocity there was taken as "
     "zero.",
     "Give the velocity (--velocity, --velocity-sd), start at a rest, or give a reference with "
     "velocities."),
    ("navigate.too_short", "error",
     "Nothing to navigate",
     "The alignment ends at {end} s, the part of the log to be used at {last} s.",
     "Align for less, or use more of the log (--until)."),
    ("navigate.span", "error",
     "A part that the log does not have",
     "The part from {start} s to {end} s was to be used; the log lasts {duration} s.",
     "--from and --until count from the start of the log."),
    ("navigate.not_imu", "error",
     "A calibration that is not of an IMU",
     "{file} is a result of {given}; it does not correct the readings of an IMU.",
     "Give the result of a calibration of accelerometers and gyros."),
    ("navigate.other_serial", "error",
     "A calibration of another instrument",
     "The log is of instrument {given}, the calibration is of {other}.",
     "Give the calibration of the instrument that made the log, or correct the serial number."),
    ("navigate.whose", "note",
     "A log that does not say of which instrument it is",
     "The calibration is of instrument {serial}; the log names none.",
     "Give --serial, or serial in [instrument] of the campaign, so that mistakes are noticed."),
    ("navigate.calibration_doubtful", "warning",
     "A calibration that did not pass",
     "The calibration is {level}: {reason}",
     "Its uncertainty may be too small, and so the predicted error here."),
    ("navigate.no_cov", "warning",
     "A calibration without uncertainty",
     "The calibration does not say how sure its coefficients are; the predicted error holds sensor "
     "noise and alignment only.",
     "Calibrate with a procedure that gives a covariance."),
    ("navigate.no_calibration", "note",
     "No calibration",
     "No calibration was given: the readings were navigated as measured, and the predicted error "
     "holds sensor noise and alignment only.",
     "Give --calibration RESULT to see what it is worth."),
    ("navigate.raw_start", "note",
     "Readings that cannot be aligned without their calibration",
     "Without the calibration the log could not be aligned ({reason}); that run starts with the "
     "attitude found with it.",
     "Nothing: the comparison then shows what the calibration is worth after the alignment."),
    ("navigate.raw_fails", "note",
     "Readings that cannot be navigated without their calibration",
     "Without the calibration the navigation failed: {reason}",
     "Nothing, if the instrument has no compensation of its own."),
    ("navigate.no_reference", "note",
     "A log that moves, without a reference",
     "The instrument moved and no reference was given; the trajectory cannot be judged.",
     "Give --reference FILE, or --still where it was turned without leaving the site."),
    ("navigate.two_references", "error",
     "A reference and a known site at once",
     "--still says that the instrument never left the site, --reference gives where it was.",
     "Leave one of them out."),
    ("navigate.aided", "error",
     "A vertical channel aided by heights that are not known",
     "--vertical aided needs heights; {what}.",
     "Give --reference with a column of heights, or --vertical held or free."),
    ("navigate.no_noise", "note",
     "Sensor noise that is not known",
     "The noise of the sensors is neither declared nor measured in a rest; the predicted error "
     "does not hold it.",
     'Give --gyro-noise "0.003 deg/sqrt(h)" and --accel-noise "30 ug/sqrt(Hz)".'),
    ("navigate.folder", "error",
     "A folder that holds a calibration",
     "'{folder}' holds the result of a calibration; its report would be overwritten.",
     "Give another folder."),
)
# fmt: on
