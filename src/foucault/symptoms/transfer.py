"""What can go wrong where a slave is calibrated against a master in motion."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("transfer.no_master", "error",
     "A slave without a master",
     "There is a log of the slave and nothing that its master said.",
     "Describe the master's navigation in [master]; from Python join the two with "
     "`SlaveLog.of(log, table)`."),
    ("transfer.place", "error",
     "A master that does not say where it is",
     "The master's table has no latitude, and neither has [site].",
     "Describe the master's position, or write the latitude into [site]: the rotation of the Earth "
     "is part of what the gyros read."),
    ("transfer.overlap", "error",
     "A slave and a master that have hardly anything in common",
     "The slave's log goes from {first} to {last} s, the master's messages from {begin} to {end} "
     "s; {used} messages can be used, and it takes {least}.",
     "Bring both to one clock: an offset of whole seconds or more is found by `foucault delay`, "
     "one of hours is a time zone or another epoch."),
    ("transfer.delay", "error",
     "A delay that is none",
     "delay = \"{given}\" is before the message was made.",
     'Write "estimate", "none" or a time of zero or more, such as "80 ms".'),
    ("transfer.no_attitude", "error",
     "A mount that gives way, and no attitudes to see it by",
     "load and flexure_sd are seen in attitudes only, and matching = \"velocity\".",
     'Write matching = "velocity+attitude", or leave load and flexure_sd out.'),
    ("transfer.no_delay", "error",
     "A delay that cannot be found",
     "The slave's gyros and the master's attitudes have too few turns in common to find the delay "
     "by.",
     'Write delay = "80 ms" or whatever it is known to be; or delay_method = "likelihood".'),
    ("transfer.sample_delay", "error",
     "A delay that is to be found by whole samples",
     'shift = "sample" takes the slave at whole samples: a delay that is estimated jumps from one '
     "to the next.",
     'Write shift = "interpolated", or the delay, such as delay = "80 ms".'),
    ("transfer.hand_over", "error",
     "A hand-over outside the log",
     "hand_over is {given} s; messages hold from {begin} s on, and the slave's log ends at {last} "
     "s.",
     "Give a time between them, or leave it out: the last message is then taken."),
    ("transfer.gamma", "error",
     "A bound of the H-infinity filter below the least",
     "With gamma = {given} the filter ceases to exist at {time} s; the least gamma of this run is "
     "{least}.",
     "Leave gamma out, or give more than the least: 1.05 to 1.5 times it is usual."),
    ("transfer.noise", "note",
     "Noise of the slave that nobody stated",
     "The noise of the slave is not stated; that of a tactical instrument was taken, {gyro} "
     "deg/sqrt(h) and {accel} ug/sqrt(Hz).",
     "Write [noise] from its data sheet or from `foucault allan`: every uncertainty rests on it."),
    ("transfer.at_validity", "warning",
     "Messages that are stamped when they hold, not when they arrive",
     "The delay is {delay} ± {sd} ms: as far as can be told, messages are stamped with the time "
     "at which they hold.",
     'Where that is so, write delay = "none" and save a state. Where a delay of tens of '
     "milliseconds is expected, the log was put in order by the master's stamps."),
    ("transfer.outside", "warning",
     "A delay outside its bracket",
     "The delay is {delay} ms, and was looked for from 0 to {longest} ms; what was found is used.",
     "Raise longest_delay if messages can be that late. A negative delay means clocks that differ: "
     "messages do not come before they were made."),
    ("transfer.edge", "warning",
     "A delay at the edge of its bracket",
     "The likeliest delay, {delay} ms, lies at an end of the bracket from 0 to {longest} ms: it "
     "may be outside.",
     'Raise longest_delay, or take delay_method = "rate matching", which looks further.'),
    ("transfer.clock", "warning",
     "A master's clock that is seconds off",
     "What the master says is of {delay} ± {sd} s before its stamps by the slave's clock; the "
     "delay was looked for from {low} to {high} s.",
     "The two clocks are set otherwise: {cure}, or stamp both by "
     "one clock. No message is so late by its transport."),
    ("transfer.site", "warning",
     "A site that is not where the master is",
     "[site] has latitude {site} deg; by its positions the master begins at {master} deg, {away} "
     "away. The master's positions decide, and gravity is that of its place.",
     "Correct latitude in [site], or leave it out: the master says where it is."),
    ("transfer.delays", "warning",
     "Two delays that contradict each other",
     "By what both turned messages are {matched} ± {matched_sd} ms late, by the filter, velocities "
     "included, {found} ± {sd} ms.",
     "They are one delay where velocities and attitudes of the master are of one instant. "
     "Velocities that come later than the attitudes differ so, and so do a lever arm along the "
     "course, a mount that bends with the motion, and turns too slow to show a delay."),
    ("transfer.drift", "warning",
     "Clocks that drift apart",
     "The clock of the stamps gains {rate} ± {sd} ppm on the slave's, {total} ms over the log; "
     "this was taken out.",
     "Log the time of arrival by the slave's clock beside each message, or lock the clocks."),
    ("transfer.delay_differs", "warning",
     "A delay that is not the one that was given",
     "The delay was given as {given} ms; by what both turned it is {found} ± {sd} ms. In a turn "
     "a wrong delay looks like biases of the accelerometers.",
     'Write delay = "estimate".'),
    ("transfer.mounting", "warning",
     "A slave that is mounted otherwise than was said",
     "By what both turned the slave is mounted at heading {heading}, pitch {pitch}, roll {roll} "
     "deg, {angle} deg from the nominal mounting.",
     "Correct mounting_heading, mounting_pitch and mounting_roll, or the order and the signs of "
     "the columns."),
    ("transfer.sense", "warning",
     "A master of which an angle counts the other way",
     "The slave turns as the master would if its {angle} counted the other way: {likeness} of its "
     "turning is explained so, and as it is not, in the mounting that was said.",
     "{cure}"),
    ("transfer.mirror", "warning",
     "Gyros that are a mirror image",
     "The slave turns as the master does if its gyros x, y, z point along {axes}: no mounting "
     "makes that, but a wrong sign or two columns exchanged.",
     "Correct the order and the signs of the columns in [log.gyro]; \"-gy\" flips a sign."),
    ("transfer.gravity", "warning",
     "Accelerometers that read gravity",
     "The slave's specific force and the master's velocities fit if every accelerometer has the "
     "other sign ({least} m/s^2 are left over, {now} as it is).",
     'Write reads = "gravity" in [log.accel]: at rest specific force is +1 g up.'),
    ("transfer.force_axes", "warning",
     "Accelerometers in other axes than the gyros",
     "The slave's specific force and the master's velocities fit if the accelerometers are taken "
     "as {words} ({least} m/s^2 are left over, {now} as they are).",
     "Correct the order and the signs of the columns in [log.accel]."),
    ("transfer.force_velocity", "warning",
     "Velocities or headings of a master that do not fit the slave's forces",
     "The master's velocities change as the slave feels it if they are, or come with, {words} "
     "({least} m/s^2 are left over, {now} as they are).",
     'Correct order, signs and frame ("NED") of the columns in [master.velocity], or the zero of '
     "the heading."),
    ("transfer.force_unit", "warning",
     "Velocities of a master in another unit",
     "The master's velocities change as the slave feels it if they are {words} ({least} m/s^2 are "
     "left over, {now} as they are).",
     "Correct the unit in [master.velocity]."),
    ("transfer.force_size", "warning",
     "Accelerometers in another unit",
     "The slave feels {ratio} times the force that moves its master.{hint}",
     'Check the unit in [log.accel], and whether it holds rates or increments (kind = '
     '"increment").'),
    ("transfer.gap", "error",
     "A gap in the log of a slave",
     "The slave's log has gaps, {count} in all, the longest of {longest} at {time} s; up to "
     "{allowed} are bridged.",
     "Use what lies before it (hand_over), or a log that begins after it."),
    ("transfer.not_finite", "error",
     "Readings of a slave that are no numbers",
     "{count} readings of the slave are not finite, the first at {time} s.",
     "Leave them out: a gap of a few samples is bridged."),
    ("transfer.dead", "error",
     "Sensors of a slave that read one number",
     "All readings of the {triad} are the same on every axis: nothing of a vehicle that moves.",
     "Check the columns of [log.{triad}], and whether the sensor was on."),
    ("transfer.backwards", "error",
     "A slave's time that does not run forward",
     "{count} stamps of the slave are not after the one before, the first at {time} s.",
     "Sort the log by time; where its stamps start anew it holds two runs: use one of them."),
    ("transfer.lever", "warning",
     "A lever arm that the velocities contradict",
     "The velocities show a lever arm of {found} ± {sd} m, and {said} (log-likelihood {gain} "
     "higher).",
     "The lever arm goes from the master to the slave, right, forward and up of the master: check "
     "its sign and its axes; what shows is lever_arm = [{written}]. Velocities that come later "
     "than the attitudes look like an arm along the course."),
    ("transfer.prior", "warning",
     "A prior that the messages contradict",
     "{name} was said to be {mean} give or take {prior}; the messages alone say {found}, and "
     "explain themselves once the priors are wide enough.",
     'Write "{group}" with sd = "{wide}" or so into [prior] (mean = "{mean}"), and look at '
     "velocity_sd and attitude_sd afterwards."),
    ("transfer.outliers", "warning",
     "A few messages that are off",
     "{count} messages differ from the slave by more than {limit} standard deviations, {worst} at "
     "most; they are stamped {times} s.",
     "Look at the master there: a new satellite solution, a switch of its mode, a damaged row. "
     "Leave these rows out of its table."),
    ("transfer.no_vertical", "note",
     "A master that says nothing of the vertical",
     "The vertical velocity of all messages is zero: it was not used.",
     "Nothing, if the master does not say it; vertical = false says so beforehand. The bias of the "
     "accelerometer that points up then rests on turns alone."),
    ("transfer.unsettled", "warning",
     "Passes that have not settled",
     "From pass {before} to pass {after} {name} moves by {moved} of its standard deviations; "
     "{passes} asked for.",
     "Write passes = {more}. Where more passes do not settle either, look at units, axes and "
     "priors."),
    ("transfer.unseen", "warning",
     "Coefficients that the motion does not show",
     "The motion shows hardly anything of {names}.",
     "Add {wanted}; or leave out what is not wanted."),
    ("transfer.flexure", "warning",
     "A mount that bends",
     "Innovations depend on those before them as where the mount bends by {sd} arcmin (one sd) "
     "with a correlation time of {time} s, and attitudes scatter by {noise} arcmin "
     "(log-likelihood {gain} higher; {left}).",
     'Write flexure_sd = "{sd} arcmin", flexure_time = "{time} s" and attitude_sd = "{noise} '
     'arcmin", or estimate_flexure = true. The master\'s own filter, which smooths what it says, '
     "looks like a mount that bends."),
    ("transfer.hidden", "note",
     "Coefficients that left-out errors hide",
     "The motion shows {names}, but what is not in the result hides them again: misalignments, "
     "scale factors of the accelerometers and g-sensitivity, as large as [prior] says.",
     'Write into [prior] how large they are for your instrument, such as "gyro.misalignment" with '
     'sd = "0.1 mrad"; left_out = false where they are calibrated and taken away.'),
    ("transfer.straight", "warning",
     "No manoeuvre",
     "The vehicle turned by {turn} deg and changed its speed by {speed} m/s: without a manoeuvre "
     "hardly more than the difference of installation and tilt can be seen.",
     "Fly S-turns and changes of speed while the master is heard; `foucault preflight` says "
     "beforehand what each is worth."),
    ("transfer.narrow", "warning",
     "Messages that differ from the slave less than was stated",
     "Innovations of {what} are {ratio} times what is expected: {key} is declared too large, or "
     "the noise of the slave.",
     "{key} = \"{value}\" would explain them. What is stated too large makes uncertainties that "
     "are too large, and hides other errors."),
    ("transfer.spread", "warning",
     "Messages that differ from the slave otherwise than was stated",
     "Innovations of {what} are {ratio} times what is expected.",
     "{key} = \"{value}\" would explain them. Look for causes first: a mount that bends (load, "
     "flexure_sd), a slave whose axes are not at right angles (misalignments), and stamps that "
     "jitter (log the time of arrival beside the master's own)."),
)
# fmt: on
