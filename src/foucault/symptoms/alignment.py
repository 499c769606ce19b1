"""Rows of the table about alignment."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("alignment.method", "error",
     "An alignment by an unknown method",
     "'{given}' is no method of alignment.{hint}",
     "Choose one of: {allowed}."),
    ("alignment.no_latitude", "error",
     "An alignment without a latitude",
     "The latitude of the site is unknown; how the Earth turns is what shows north.",
     'Give --latitude "47.3 deg", or `latitude` in [site].'),
    ("alignment.window", "error",
     "A window of alignment outside the log",
     "The alignment was to last from {start} s to {end} s; the log has {first} s to {last} s.",
     "Give a start and an end within the log, the start first."),
    ("alignment.too_short", "error",
     "A window too short for an alignment",
     "The window of alignment is {given} s long; at least {least} s are needed.",
     "Align for longer: minutes for gyros that are to show north. Where nothing is said, the first "
     "rest that is found is the window; --from and --until, or `start` and `end`, say another."),
    ("alignment.parallel", "error",
     "A mean rate along up, or none at all",
     "A mean rate of {rate:.3g} rad/s and a mean specific force of {force:.3g} m/s^2 are parallel "
     "or zero: they show no north.",
     "Check that gyros and accelerometers are read; at a pole of the Earth there is no heading."),
    ("alignment.sd", "error",
     "A negative standard deviation of a bias",
     "{what} is {given}; a standard deviation is zero or more.",
     "Give how well the biases are known, such as 0.01 deg/h; zero says that they are known "
     "exactly."),
    ("alignment.two_rests", "error",
     "A two-position alignment without two rests apart in heading",
     "{what}.",
     "Give two rests of the log, one after the other, with a turn about up of {least} deg or more "
     "between them; 180 deg is best."),
    ("alignment.force", "error",
     "Increments read as rates or the reverse, seen at alignment",
     "The mean specific force is {given} m/s^2, {ratio} times local gravity: {cause}.",
     "Correct `kind`, `unit` or `scale` in [log.accel], and `kind` in [log.gyro] with it."),
    ("alignment.gravity", "warning",
     "A rest whose specific force is not local gravity",
     "The mean specific force at rest is {seen} m/s^2 where gravity is {given} m/s^2, {off} % off.",
     "Check `gravity` and `height` of the site, or calibrate the scale factors and biases of the "
     "accelerometers."),
    ("alignment.gyro_unit", "error",
     "Gyros at rest that read the Earth's rate times a factor",
     "The gyros at rest read {given} deg/h instead of the Earth's {earth} deg/h; multiplied by "
     "{factor} it is {then} deg/h: {cause}.",
     "Correct `unit` and `kind` in [log.gyro]."),
    ("alignment.vertical_sign", "error",
     "Latitude of the wrong sign, or gravity read instead of specific force",
     "Along up the gyros read {given} deg/h where {wanted} deg/h were expected (sd {sd}): the sign "
     "is reversed.",
     "One of these is so: `latitude` has the wrong sign; the accelerometers read gravity instead "
     'of specific force (reads = "gravity" in [log.accel]); all gyros are reversed.'),
    ("alignment.axes", "error",
     "Gyro axes not in the order or sense of the accelerometer axes, seen at rest",
     "Along up the gyros read {given} deg/h where {wanted} deg/h were expected (sd {sd}). With "
     "{exchange} (body axis = declared gyro column) they would read that{more}.",
     "Correct `columns` of [log.gyro] or of [log.accel]. A rest shows only what lies along up: "
     "two rests with a turn between them that tilts the instrument decide among several exchanges "
     "(`foucault inspect`). If the axes are right, the latitude is not: the data say {latitude} "
     "deg north or south."),
    ("alignment.latitude", "warning",
     "A latitude that the Earth's rate contradicts",
     "Gravity and the Earth's rate show a latitude of {seen} deg (sd {sd}); {declared} deg was "
     "given.",
     "Check the latitude, the declared bias of the gyros, and the order of their axes: level axes "
     "that are swapped show little in one rest, and none that are swapped in both triads."),
    ("alignment.earth_rate", "warning",
     "Gyros at rest that read neither the Earth's rate nor a simple multiple of it",
     "The gyros at rest read {given} deg/h, {vertical} deg/h of it along up; the Earth turns at "
     "{earth} deg/h, {wanted} deg/h along up (sd {sd}).",
     "The bias of the gyros is larger than declared, or the instrument turned: declare the bias, "
     "calibrate it, or align while nothing moves."),
    ("alignment.turned", "warning",
     "An instrument that turned during a declared rest",
     "Between start and end of the window the instrument turned by {angle} deg, of which "
     "{about_up} deg about up; noise and bias explain {limit} deg.",
     "Align while the instrument is not turned; alignment in inertial space and by velocity "
     "withstand a turn, the mean of two vectors does not. If nothing turned it, that is a bias "
     "of the gyros: calibrate it, or declare its size (--gyro-bias-sd)."),
    ("alignment.left_place", "warning",
     "A vehicle that left its place during a declared rest",
     "Within the window the instrument moved by about {distance} m, at up to {speed} m/s; noise "
     "explains {limit} m/s.",
     "Choose a window in which the vehicle stands, or give its velocity."),
    ("alignment.sway", "note",
     "Sway during an alignment",
     "The instrument swayed: its velocity by {speed} mm/s (sd), its attitude by {peak} arcsec on "
     "the way and its level by {angle} arcsec between start and end, which is {azimuth} deg of "
     "azimuth to the mean of two vectors.",
     "Alignment in inertial space and the Kalman filter withstand it. two_vector finds the mean "
     "attitude and not that of the end; its standard deviations hold the sway. Choose a calmer "
     "window for it."),
    ("alignment.noise", "note",
     "Sensor noise measured in a rest that was not quiet",
     "The white noise was measured in the rest, and motion or rounding lies beside it: gyros "
     "{gyro} deg/sqrt(h), accelerometers {accel} ug/sqrt(Hz).",
     "Give the noise of the sensors, from the data sheet or from a quiet log (`foucault allan`): "
     "--gyro-noise and --accel-noise, or [noise] of a campaign. Standard deviations are too large "
     "otherwise if motion passed for noise, and too small if the sensors filter their output."),
    ("alignment.declared_noise", "warning",
     "More noise in a rest than was declared",
     "{what}",
     "Correct the noise that was declared (--gyro-noise and --accel-noise, or [noise] of a "
     "campaign; `foucault allan` measures it), or find what shakes the instrument."),
    ("alignment.disagree", "warning",
     "Methods of alignment that contradict one another",
     "The attitudes by {one} and by {other} differ by {angle} deg about {axis}; their standard "
     "deviations together allow {sd} deg (sd).",
     "One of these is so: the vehicle moved steadily, crept or settled (a constant horizontal "
     "velocity does not show in the specific force as motion); biases or noise are larger than was "
     "declared or measured (--gyro-bias-sd, --accel-bias-sd, --gyro-noise); with two positions, "
     "both triads are mirrored (two columns swapped or one sign wrong, in both)."),
    ("alignment.innovations", "warning",
     "A fine alignment that contradicts its own readings",
     "The velocities that {method} met are {given} times as large, squared, as it predicted; at "
     "most {most} is chance.",
     "The vehicle moved, or biases or noise are larger than was declared: choose a rest, or give "
     "--gyro-bias-sd, --accel-bias-sd, --gyro-noise and --accel-noise."),
    ("alignment.azimuth", "warning",
     "Gyros too poor to find north",
     "The azimuth is known to {sd} deg (sd); bias of the gyros alone makes {bias} deg.",
     "Give a heading from elsewhere (two antennas, a survey, a magnetic compass), rest in two "
     "positions, or calibrate the gyro bias before."),
    ("alignment.near_pole", "warning",
     "An alignment near a pole of the Earth",
     "At latitude {latitude} deg only {share} % of the Earth's rate is level: every gyro error "
     "counts {times} times as much in azimuth as at the equator.",
     "Give a heading from elsewhere, or align for longer with better gyros."),
)
# fmt: on
