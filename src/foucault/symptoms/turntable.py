"""What can go wrong with a session on a table."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("plan.unknown", "error",
     "The name of a plan for a table is not known",
     "There is no plan '{name}' for a table.{hint}",
     "Use one of: {allowed}, fibonacci N (any N); or list `positions` of your own."),
    ("plan.positions", "error",
     "Positions of a table that are not angles or directions",
     "The list of positions holds {what}.",
     'Write every position as outer, middle and inner angle: ["30 deg", "0 deg", "-31.7 deg"].'),
    ("plan.spin", "error",
     "A spin without rate or without a whole turn",
     "The outer axis is to spin at {rate} deg/s for {turns} turns.",
     'Give a spin rate that is not zero, such as "10 deg/s", and 1 turn or more.'),
    ("plan.rest_time", "error",
     "Rests without length in a plan for a table",
     "Each rest is to last {given} s.",
     'Give a length above zero, such as "60 s".'),
    ("plan.model", "error",
     "A plan is to be judged for a model that is not known",
     "There is no model '{name}' to judge a plan for.{hint}",
     "Use one of: {allowed}."),
    ("plan.too_few", "error",
     "Fewer positions than coefficients",
     "The {n} positions of '{plan}' give {equations} equations for {needed} coefficients: "
     "{reason}.",
     "Use a plan with more positions, such as 'icosahedron 12' or 'dodecahedron 20': "
     "`foucault plans` lists them."),
    ("plan.singular", "error",
     "Positions that cannot separate the coefficients, however many readings are taken",
     "The {n} positions of '{plan}' do not determine all coefficients: {reason}.",
     "Use another plan, such as 'icosahedron 12' or 'dodecahedron 20' (`foucault plans` lists "
     "them), or give the coefficients named a prior."),
    ("table.range", "error",
     "A range of a table without an angle that it can stand at",
     "Between {low} and {high} deg the {name} axis has no angle that is a multiple of {step} deg.",
     "Widen {name}_range in [procedure], or take a smaller angle_step."),
    ("table.cable", "error",
     "Spins that turn the outer axis further than its cable allows",
     "Spins of {turns} turns, {how}, take the outer axis to {needed} turns from zero; the cable "
     "allows {allowed}.",
     "Unwind after each spin (both_senses = true in [procedure]), give fewer `turns` in "
     "[simulate], or a larger cable_limit."),
    ("table.too_few", "error",
     "Too few positions for what is to be estimated",
     "No {count} positions determine all coefficients that count; allowed are {limits}.",
     "Allow more `positions` in [optimise] (12 or more, 20 is good), or wider limits of the table, "
     "or give what need not be known the weight 0."),
    ("table.unseen", "warning",
     "Positions of a table that do not show everything",
     "The positions of '{plan}' do not show {names}.",
     "Take another plan: `foucault plans` lists them, and `foucault optimise` finds one for your "
     "table."),
    ("poses.unknown", "error",
     "The name of a set of poses is not known",
     "There is no set of poses '{name}'.{hint}",
     "Use one of: {allowed}."),
    ("poses.singular", "error",
     "Poses that cannot tell six coefficients of deflection",
     "No {count} poses with angles of {z} deg about z and {east} deg about East tell all six "
     "coefficients.",
     "Take six poses or more, and let both axes of the gimbals turn by 90 deg or more."),
    ("plan.which", "error",
     "A file for the angles of a plan, but no plan",
     "'{path}' is to take the angles of one plan, but all plans are asked for.",
     "Name the plan: foucault plans 'icosahedron 12' -o {path}"),
    ("plan.file", "error",
     "A file of positions that cannot be read",
     "'{path}' is not a list of positions: {why}.",
     "Write a first line `outer,middle,inner` and one line per position with three angles in deg."),
    ("positions.none", "error",
     "A log without a rest and without a spin",
     "The log has no rest of at least {shortest} s, and no spin of at least one turn.{lost}",
     "Leave the instrument still in every position; if it was, look at the log with `foucault "
     "inspect`, or log the number of the position and name its column in [log.table]."),
    ("position.moving", "warning",
     "A position of the log in which the instrument still moves",
     "{position} ({start}-{end} s from the start) moves for part of the time: {used} was used.",
     "Wait until the table has settled before the number of the position is logged."),
    ("position.not_still", "warning",
     "A rest on a table that is not quite still",
     "{position} ({start}-{end} s from the start) {how} more than the other rests.",
     "Wait longer after the table has moved, and look for loose cables or an open brake; leave "
     "the position out if its residual is large too."),
    ("spin.short", "error",
     "A spin of less than a whole turn",
     "{position} ({start}-{end} s from the start) turns by only {turns} of a turn at a constant "
     "rate.",
     "Spin for one whole turn or more: only then does the horizontal Earth rate average out."),
    ("spin.cut", "note",
     "Spins of more than whole turns, cut to whole turns",
     "The parts of {which} spins beyond whole turns, up to {most} of a turn, were left out.",
     "Nothing to do."),
    ("spin.not_whole", "warning",
     "Means over spins of not quite whole turns",
     "These spins are not whole turns: {rows}. The horizontal Earth rate that is "
     "left in them is up to {left} deg/h.",
     "Average over whole turns, or give the log itself instead of means."),
    ("spin.both_senses", "error",
     "Turns in both senses inside one spin",
     "{position} ({start}-{end} s from the start) turns in both senses; the sense changes at "
     "{at} s.",
     "Give each sense a position of its own: what the Earth adds has another sign in each."),
    ("spin.rate", "error",
     "Spins at another rate than the plan says",
     "The plan says {told} deg/s, but the gyros measure {measured} deg/s in the spins.",
     "Correct the spin rate in [procedure], or unit and scale of [log.gyro]."),
    ("spin.rate_plan", "warning",
     "The table did not turn at the rate of the plan",
     "The plan says {told} deg/s, but the table says {measured} deg/s; the table is believed.",
     "Correct the spin rate in [procedure]."),
    ("spin.rate_clock", "warning",
     "The outer angle over the time of the log is not the rate of the spins as declared",
     "The spins were declared with {told} deg/s, but the outer angle over the time of the log says "
     "{measured} deg/s: {ppm} ppm, and the table's rate is good to {sd} ppm (sd). If the time of "
     "the log is wrong by so much, all gyro scale factors are.",
     "Find out whether the table or the clock of the log is wrong. The clock: give [log] the true "
     "`rate`. The table: correct `spin_rate` in [procedure], or declare its `table_rate_sd`."),
    ("spin.sense", "error",
     "All spins have the other sense than the gyros say",
     "In all {count} spins the gyros turn {measured} seen from above, the other way than {said} "
     "says.{also}",
     "{cure}"),
    ("spin.sense_some", "warning",
     "Some spins have the other sense than the plan says",
     "{count} of {spins} spins have the other sense than {said} says: {which}. The sense that the "
     "gyros measure was used.",
     "Nothing to do if the table turned both ways; correct the plan."),
    ("spin.axes", "error",
     "Gyro axes exchanged or of the wrong sign on a table",
     "Probably {what}: the rates of the spins are {declared} deg off the vertical, which the "
     "accelerometers show, as the gyro columns are declared; with {exchange} (body axis = declared "
     "column) they are off by {better} deg.",
     "Reorder `columns` of [log.gyro] like that, or those of [log.accel] the other way."),
    ("spin.left_handed", "error",
     "A left-handed triad on a table: two axes swapped, or one sign wrong",
     "Probably {what}: the rates of the spins are {declared} deg off the vertical, which the "
     "accelerometers show, as the gyro columns are declared; with {exchange} (body axis = declared "
     "column) they are off by {better} deg: one of the two triads is left-handed.",
     "Correct order and signs of `columns` in [log.gyro] or in [log.accel]; check which one "
     "against the instrument's drawing of its axes."),
    ("table.rate_unit", "error",
     "Table angles or rates in deg read as rad, or the reverse",
     "The table turns at {told} deg/s by its columns, the gyros measure {measured} deg/s: the unit "
     "of the table is {likely}, not {given}.",
     'Write unit = "{likely}" (or rate_unit = "{likely}/s") in [log.table].'),
    ("table.rate_differs", "error",
     "The table turns at another rate than the gyros measure",
     "The table turns at {told} deg/s by its columns, the gyros measure {measured} deg/s.",
     "Check the outer column, the units of [log.table], and unit and scale of [log.gyro]."),
    ("table.unit", "error",
     "Table angles in deg read as rad, or the reverse",
     "The directions of gravity miss those of the table angles by {given} deg; with the angles "
     "multiplied by {factor} they miss by {better} deg.",
     'Write unit = "{likely}" for the angles (in [log.table], or in the positions of the plan).'),
    ("table.order", "error",
     "Table angles in the wrong order or with the wrong sign",
     "The directions of gravity miss those of the table angles by {given} deg; with {exchange} as "
     "outer, middle and inner angle they miss by {better} deg.",
     "{cure}{hint}"),
    ("table.mounting", "error",
     "The instrument is mounted turned on the table",
     "The directions of gravity fit the table angles only if the instrument is turned by {angle} "
     "deg: its x, y, z axes lie along {axes} of the table at zero.",
     "Reorder `columns` of [log.accel] and [log.gyro] alike so that x lies along the middle, y "
     "along the inner and z along the outer axis, or change the angles of the plan."),
    ("table.directions", "error",
     "Directions of gravity that do not fit the table angles",
     "The directions of gravity miss those of the table angles by {given} deg; no other order, "
     "sign, unit or mounting explains them.",
     "Check that the log belongs to this plan, that the middle axis is x, the inner axis y and "
     "the outer axis z at zero, and the columns of [log.accel]."),
    ("table.gravity", "error",
     "Accelerometers that read gravity instead of specific force, on a table",
     "All directions are upside down against the table angles.",
     'Write reads = "gravity" in [log.accel].'),
    ("positions.missing", "warning",
     "Positions of the plan without a reading",
     "The log has no reading in {count} of the {planned} positions of the plan: {which}.",
     "Measure them too if the uncertainties are too large; rests shorter than {shortest} s do not "
     "count."),
    ("positions.repeated", "warning",
     "Positions of the plan that were measured more than once",
     "Readings that repeat a position of the plan: {which}. All readings are used.",
     "Nothing to do if they were repeated on purpose."),
    ("positions.extra", "warning",
     "Readings in no position of the plan",
     "Readings that belong to no position of the plan: {which}.",
     "Nothing to do if they were added on purpose."),
    ("positions.left_out", "warning",
     "Readings in no position of the plan, of which no table angles are known",
     "The log has no table angles, and these readings belong to no position of the plan: {which}. "
     "They were left out.",
     "Nothing to do if they were not meant to be used; else log the table angles, or add the "
     "positions to the plan."),
    ("positions.other", "warning",
     "Readings that are not those of the plan",
     "The readings are not in the positions of the plan. {used}",
     "Check `plan` (or `positions`) in [procedure]; nothing to do if other positions were meant."),
    ("table.angle", "warning",
     "An angle of the table that is far off in one position",
     "The angles of {reading} do not fit what the instrument reads there: the {how}. They were not "
     "used.",
     "Look at this angle in the log, or in `positions` of [procedure]; if it is right, the "
     "instrument slipped on the table."),
    ("table.unused", "warning",
     "Directions of gravity that do not fit table angles which nobody needs",
     "The directions of gravity miss those of the logged table angles by {given} deg. The "
     "procedure needs no angles and goes on without.",
     "Check `columns` of [log.table] and of [log.accel]; leave [log.table] out if its angles say "
     "something else."),
    ("spin.rate_unit", "error",
     "Gyros in deg/s read as rad/s, or the reverse",
     "The plan says {told} deg/s, but the gyros measure {measured} deg/s in the spins: a factor of "
     "57.3.",
     "Write unit = \"{likely}\" in [log.gyro], not \"{given}\"; or correct the unit of `spin_rate` "
     "in [procedure]."),
    ("spin.unused", "warning",
     "A steady turn of the gyros that was not used as a spin",
     "The gyros turn steadily by {turns} turns at {start}-{end} s from the start, but this was not "
     "used as a spin: {why}.",
     "A spin is about the vertical. If this one was, look for vibration or loose mounting, or log "
     "the number of the position or the outer angle and name the column in [log.table]."),
    ("positions.unlogged", "note",
     "Moves from one position of a table to the next that are not in the log",
     "The log has {count} gaps, all between one position and the next: the moves were not logged.",
     "Nothing to do."),
    ("positions.order", "warning",
     "Positions taken in another order than planned",
     "The positions were not taken in the order of the plan; each reading was matched by the "
     "direction of gravity.",
     "Positions that differ by the outer angle only cannot be told apart like this: log the table "
     "angles if they matter."),
    ("readings.too_few", "error",
     "Fewer positions measured than coefficients",
     "The log has {given} {what}; {needed} or more are needed for the coefficients.{hint}",
     "Measure more positions, such as the plan 'icosahedron 12'."),
    ("readings.noise_unknown", "note",
     "Means without a declared noise",
     "The log holds means, which do not tell their own noise; all readings weigh alike, and the "
     "uncertainties follow from the residuals.",
     "Declare the noise in [noise] if it is known."),
    ("readings.no_spins", "note",
     "Gyros in a log in which the outer axis never spins",
     "There are no spins, so that nothing calibrates the gyros; only the accelerometers were "
     "calibrated.",
     "Spin the outer axis by whole turns in every position, or remove [log.gyro]."),
    ("readings.no_latitude", "error",
     "Gyros to be calibrated on a table without a latitude",
     "The latitude is unknown, and the vertical part of the Earth's rotation (up to 15 deg/h) is "
     "part of the rate of every spin.",
     "Give `latitude` in [site]."),
    ("readings.no_angles", "error",
     "A procedure that uses the angles of the table, without angles",
     "'{procedure}' needs the {what} of every position, and some are unknown.",
     "Describe them in [log.table], or give the plan whose positions were measured, or use "
     "norm_observation, which needs none."),
    ("readings.gyro_constant", "error",
     "Gyros that read the same all the time on a table",
     "All gyros read the same in every rest and every spin, to the last digit.",
     "Look at `columns` of [log.gyro], and whether the gyros were switched on; remove [log.gyro] "
     "to calibrate the accelerometers alone."),
    ("readings.no_solution", "error",
     "Readings whose norms fit no instrument",
     "No instrument gives readings like these: their norms do not lie on an ellipsoid.",
     "Look at the readings: wrong units of one axis, a column taken twice, or positions of another "
     "instrument."),
    ("readings.outlier", "warning",
     "One reading that fits much worse than the others",
     "The {what} is {size} standard deviations off and was left out.",
     "Was the table still moving, or did the instrument slip? Measure this position again."),
    ("unification.four_positions", "error",
     "The published unification of the frames without its positions",
     "There is no {what} with inner angle 0.",
     "Set four_positions = true in [procedure] and measure these positions, or use unification = "
     '"parallel vectors", which needs none of them.'),
    ("readings.common_rate", "warning",
     "All gyro scale factors off by the same amount (a wrong rate of the table)",
     "All three gyro scale factor errors are close to {ppm} ppm. A wrong rate of the table looks "
     "exactly like this.",
     "Check `spin_rate` in [procedure], or log the outer angle of the table."),
    ("readings.g_sensitivity", "warning",
     "Gyro readings at rest that depend on orientation more than the Earth's rotation explains",
     "The rates at rest change with orientation by up to {size} deg/h per g. Not estimated, this "
     "shifts gyro scale factors by up to {shift} ppm.",
     "Check the sign of the latitude. Then set g_sensitivity = true in [procedure], or spin both "
     "ways (both_senses = true)."),
    ("readings.quadratic", "warning",
     "Residuals that quadratic terms of the accelerometers explain",
     "Quadratic terms would explain {share} % of the squared residuals of the accelerometers.",
     "Set accel_quadratic = true in [procedure] and calibrate again; it needs 14 positions or "
     "more, 20 are good."),
    ("solution.linear", "error",
     "A prior or more terms for a solution by linear equations",
     "The {solution} solution has no place for {what}.",
     'Leave {what} out, or use solution = "likelihood" in [procedure].'),
)
# fmt: on
