"""What can go wrong with a platform tumble."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("tumble.no_command", "error",
     "A tumble whose log has no command",
     "The log has no commanded rates, or they are not numbers: {what}.",
     "Describe the columns of the commanded rates in [log.gyro]; they say how the cluster was "
     "turned, nothing else does."),
    ("tumble.no_accel", "error",
     "A tumble without accelerometers",
     "The log has no readings of accelerometers.",
     "Describe them in [log.accel]."),
    ("tumble.still", "error",
     "A command that never turns the cluster",
     "The largest commanded rate is {given} deg/h; the Earth alone turns at 15 deg/h.",
     "Log the rates that were commanded, in the unit that [log.gyro] says; a cluster that does "
     "not turn does not show its coefficients."),
    ("tumble.too_short", "error",
     "Fewer readings than there are unknowns",
     "{given} readings of three accelerometers are left; {wanted} unknowns want more of them.",
     "Log the whole tumble; check `mask_edges`, gaps and saturated readings."),
    ("tumble.no_latitude", "error",
     "A tumble without latitude",
     "Without latitude the Earth's rate is unknown, which turns a cluster by degrees in an hour.",
     "Give the latitude in [site]."),
    ("tumble.gravity", "error",
     "Readings that have not the size of gravity",
     "The specific force is {given} m/s^2 on the average, and gravity {gravity} m/s^2.",
     "Correct the unit in [log.accel] ({likely}), or gravity in [site]."),
    ("tumble.sign", "error",
     "Accelerometers that say gravity instead of specific force, or a start upside down",
     "The first readings point {angle} deg away from where `start` puts up.",
     'Specific force at rest points up: give reads = "gravity" in [log.accel] where the '
     "accelerometers point down, or correct `start`, or the signs of the columns."),
    ("tumble.rate_limit", "error",
     "A command that is faster than the rig may turn",
     "At {time} s the commanded rate about {axis} is {given} deg/s; `rate_limit` is {limit} deg/s.",
     "Correct the unit of [log.gyro], or `rate_limit`."),
    ("tumble.part", "error",
     "A part of a tumble that was not turned as its command says",
     "From {start} to {end} s the cluster turned {factor} times as its command says, elsewhere as "
     "it says.",
     "Look at the command there: a segment whose sign was reversed (-1), or that was not carried "
     "out (0). Correct it in the file, or leave out that part of the log and what follows."),
    ("tumble.outliers", "note",
     "Readings of a tumble that jump",
     "{count} readings ({share} %) lie farther from what their neighbours predict than any would "
     "by chance, the first at {time} s; they are left out.",
     "Look at the readings there: a transmission error, an electrical disturbance, a knock."),
    ("tumble.unit", "error",
     "Commands in a wrong unit",
     "The cluster turns {factor} times as fast as the command says.",
     "Correct the unit in [log.gyro]: {likely}."),
    ("tumble.axes", "error",
     "Axes of command and accelerometers that are swapped or reversed",
     "The accelerometers turn as if the command were {seen}{more}; that explains {share} % of "
     "their motion, the command as it stands {own} %.",
     'Correct the order or the signs of the columns in [log.gyro], such as "-gy", or those of '
     "[log.accel]. Rates are positive where the cluster turns right-handed about its axis."),
    ("tumble.motion", "warning",
     "A motion that the command explains badly",
     "The command explains only {own} % of how the accelerometers' readings move.",
     "Look for slipping axes, a command in a wrong unit, or command and readings of different "
     "times."),
    ("tumble.plan_time", "warning",
     "A log that is longer or shorter than the plan",
     "The log takes {given} s and the plan '{name}' {wanted} s.",
     "The command in the log was used, not the plan. Was it cut off? Correct the plan if not."),
    ("tumble.plan_other", "warning",
     "A command that is not that of the plan",
     "The command differs from the plan '{name}' by {given} deg/h rms, most at {time} s.{more}",
     "The command in the log was used. Correct `plan`, `rate`, `segment` or `steps`, or leave them "
     "out."),
    ("tumble.delay", "warning",
     "Readings that are late against the command, or early",
     "The readings are {given} ms older than their time says, give or take {sd} ms; the "
     "calibration believed {believed} ms.",
     "Set delay_sd, such as \"0.1 s\", so that the delay is estimated; or correct "
     "`command_holds`, or the times of the log."),
    ("tumble.start", "warning",
     "A start that is far from where it was believed",
     "The cluster began {angle} deg away from `start`, {sds} times what `start_sd` and "
     "`azimuth_sd` allow: at outer {outer}, middle {middle}, inner {inner} deg.",
     "Where that is true, correct `start`, or give a larger start_sd and azimuth_sd: what was "
     "said of the start pulls the result."),
    ("tumble.average", "note",
     "Shorter averages than were asked for",
     "Over {asked} s {why}; residuals are averaged over {given} s.",
     "Nothing to do; set `average` to {given} s to say so."),
    ("tumble.noise", "warning",
     "Noise of the gyros that was not declared",
     "[noise] does not say the white noise of the gyros, which the log cannot show; {given} "
     "deg/sqrt(h) was taken.",
     "Give it in [noise.gyro]: it decides how far the attitude wanders, and with it the "
     "uncertainties."),
    ("tumble.measured", "note",
     "Noise of the accelerometers that was measured",
     "The white noise of the accelerometers, {given} ug/sqrt(Hz), was measured in the log itself.",
     "Give it in [noise.accel] if it is known."),
    ("tumble.slow_noise", "note",
     "Noise that is not white, which a tumble counts but does not weigh",
     "[noise] declares a bias instability or a random walk. The estimate weighs readings by their "
     "white noise; what the rest adds to the uncertainty was computed and is in the budget. Slow "
     "errors and the delay, which it looks like, were not tested.",
     "Nothing to do. Slow noise that is not declared cannot be seen in the residuals: much of it "
     "looks like coefficients."),
    ("tumble.white", "note",
     "Noise that was declared, or measured, as white alone",
     "No slow noise is known: biases of accelerometers and drifts of gyros were taken to stand "
     "still for {minutes} minutes.",
     "Give bias_instability or random_walk in [noise.accel] and [noise.gyro], as `foucault allan` "
     "finds them; the uncertainties then count the part of it that looks like coefficients."),
    ("tumble.unseen", "warning",
     "Coefficients that the motion hardly shows",
     "{count} coefficients are known hardly better than before: {names}.",
     "Turn the cluster through more orientations, about more axes, or longer; see what the motion "
     "shows in the report."),
    ("tumble.azimuth", "warning",
     "An azimuth so uncertain that uncertainties are rough",
     "The azimuth at the end is known to {given} deg only; the attitude and combinations of "
     "coefficients depend on it beyond the linear.",
     "Tell the start better (`start`, `azimuth_sd`), or turn longer. Each coefficient by itself is "
     "hardly affected."),
    ("tumble.gap_command", "error",
     "A gap in which the command changed",
     "Between {time} s and {after} s rows are missing, and the command changed meanwhile.",
     "Log every row, those without readings too: a row that says nan keeps its command. Or "
     "calibrate the parts of the log by themselves."),
    ("tumble.relative", "warning",
     "A command that leaves out the Earth's rate",
     "The readings fit {times} times better if the command is taken relative to the ground.",
     "Log the rate relative to inertial space that the gyros were torqued with, the Earth's rate "
     "included."),
    ("tumble.masked", "note",
     "Readings that are missing",
     "{count} readings of the accelerometers are missing, the first at {time} s. Their rows were "
     "kept for the command.",
     "Nothing to do if they are few."),
    ("tumble.singular", "note",
     "A final attitude whose angles are no measure",
     "At the end the middle angle is {given} deg: outer and inner angle turn about nearly the same "
     "axis there.",
     "Take attitude matrix and covariance from `diagnostics` of result.json; the coefficients are "
     "not affected."),
    ("tumble.condition", "note",
     "Information that had to be triangularised",
     "Priors are so wide against the noise that the sum of squares would lose digits.",
     "Nothing to do: it was computed without squares, which takes longer."),
    ("tumble.filter", "note",
     "One pass of a published filter",
     "The result is that of the {filter} filter. {advice}",
     "Its covariance cannot be trusted, nor that it found the truth where the start is a few "
     'degrees off; filter = "gauss-newton" comes to the bound, and says how sure it is.'),
    ("tumble.filter_delay", "error",
     "A delay that a published filter cannot estimate",
     "delay_sd is above 0, and the delay is not among the states of the {filter} filter.",
     'Take filter = "gauss-newton", or delay_sd = "0 s".'),
    ("tumble.gap", "warning",
     "A gap in which the command is not known",
     "{count} intervals are longer than {limit} s; the longest, {longest} s, begins at {time} s. "
     "The command before it was taken to hold.",
     "Where it did not, attitude is lost there: calibrate the parts of the log by themselves."),
)
# fmt: on
