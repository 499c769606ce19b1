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
    ("plan.which", "error",
     "A file for the angles of a plan, but no plan",
     "'{path}' is to take the angles of one plan, but all plans are asked for.",
     "Name the plan: foucault plans 'icosahedron 12' -o {path}"),
    ("plan.file", "error",
     "A file of positions that cannot be read",
     "'{path}' is not a list of positions: {why}.",
     "Write a first line `outer,middle,inner` and one line per position with three angles in deg."),
    # From a log to readings
    ("positions.none", "error",
     "A log without a rest and without a spin",
     "The log has no rest of at least {shortest} s, and no spin of at least one turn.",
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
     "The parts beyond whole turns were left out in position {positions}.",
     "Nothing to do."),
    ("spin.not_whole", "warning",
     "Means over spins of not quite whole turns",
     "The spins of some rows are not whole turns: row {rows}. The horizontal Earth rate that is "
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
    ("spin.sense", "error",
     "All spins have the other sense than the gyros say",
     "In all {count} spins the gyros turn {measured} seen from above, the other way than {said} "
     "says.",
     "Either the rate is counted the wrong way round: write \"-\" before the outer column (and "
     "rate) of [log.table], or change the sign of the spin rate in [procedure]. Or the gyros are "
     "reversed: write \"-\" before each of `columns` in [log.gyro]."),
    ("spin.sense_some", "warning",
     "Some spins have the other sense than the plan says",
     "{count} spins have the other sense than {said} says: {which}. The sense that the gyros "
     "measure was used.",
     "Nothing to do if the table turned both ways; correct the plan."),
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
     "Correct `columns` of [log.table] like that (\"-\" before a name flips it), or the order of "
     "the angles in the plan: outer, middle, inner.{hint}"),
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
     "Some positions of the plan were measured more than once: {which}. All readings are used.",
     "Nothing to do if they were repeated on purpose."),
    ("positions.extra", "warning",
     "Readings in no position of the plan",
     "Some readings belong to no position of the plan: {which}.",
     "Nothing to do if they were added on purpose; their table angles are unknown unless they "
     "were logged."),
    ("positions.order", "warning",
     "Positions taken in another order than planned",
     "The positions were not taken in the order of the plan; each reading was matched by the "
     "direction of gravity.",
     "Positions that differ by the outer angle only cannot be told apart like this: log the table "
     "angles if they matter."),
    ("readings.too_few", "error",
     "Fewer positions measured than coefficients",
     "The log has {given} {what}; {needed} or more are needed for the coefficients.{hint}",
     "Measure more positions, such as the plan 'icosahedron 12', or give priors."),
    ("readings.noise_unknown", "note",
     "Means without a declared noise",
     "The log holds means, which do not tell their own noise; all readings weigh alike, and the "
     "uncertainties follow from the residuals.",
     "Declare the noise in [noise] if it is known."),
    ("rate_table.no_gyro", "error",
     "A rate table without gyros",
     "The log has no gyro readings.",
     "Describe the gyros in [log.gyro]; a rate table says nothing of accelerometers."),
    ("rate_table.no_rates", "error",
     "Rates of the table that nobody knows",
     "The log carries no rate of the table, and [procedure] no `rates`: gyros cannot give their "
     "own scale factor.",
     'Describe the rate or the outer angle in [log.table], or list the commanded rates in '
     '[procedure], such as rates = ["1 deg/s", "-1 deg/s", "10 deg/s", "-10 deg/s"].'),
    ("rate_table.no_up", "error",
     "Which axis was up, nobody knows",
     "The log has no accelerometers, and neither it nor [procedure] tells which axis was along the "
     "vertical in which sense.",
     'List the placements in [procedure], such as axes = ["x up", "x down", "y up"].'),
    ("rate_table.between_axes", "error",
     "An axis of the instrument that is not along the vertical",
     "In step {step}, at {start} s, the axis nearest to the vertical is {axis}, {lean} deg from "
     "it.",
     "On a rate table one axis at a time must be along the spin axis; use norm_observation for "
     "other directions. Or the columns of [log.accel] are wrong."),
    ("rate_table.axes", "error",
     "Other placements than declared",
     "The accelerometers say that these axes were along the vertical, in order: {seen}. "
     "[procedure] says: {declared}.",
     "Correct `axes`, or the order and signs of the columns in [log.accel]."),
    ("rate_table.count", "error",
     "Steps that do not fit the declared placements",
     "{given} steps were found; {placements} placements with {rates} rates each were declared. "
     "Without accelerometers steps are told apart by their number only.",
     "Correct `axes` and `rates` in [procedure], or measure the steps that are missing."),
    ("rate_table.sense", "error",
     "A table that turns the other way than it says",
     "{steps} turn against the gyros: in step {step}, with {placement}, the table says {told} "
     "deg/s and the gyros {seen} deg/s about up.",
     "Rates are positive counter-clockwise seen from above. Change the sign of the rate in "
     "[log.table] or of `rates`, or correct the signs of the columns in [log.gyro]."),
    ("rate_table.unit", "error",
     "Commanded rates in a wrong unit",
     "The fastest commanded rate is {told} deg/s, the fastest that the gyros say {seen} deg/s: a "
     "factor of 57.3.",
     "Write `rates` in {likely}, not in {given}; or correct unit or scale of [log.gyro]."),
    ("rate_table.other_rate", "error",
     "A step at a rate that was not commanded",
     "In step {step}, with {placement}, the gyros say {seen} deg/s; the nearest of the commanded "
     "rates is {nearest} deg/s.",
     "Correct `rates` in [procedure], or unit and scale of [log.gyro]."),
    ("rate_table.missing", "warning",
     "Steps that were commanded and not found",
     "Not found: {steps}.",
     "The others were used. A step counts when its rate is constant for a turn or more."),
    ("rate_table.undetermined", "error",
     "Steps that do not determine all coefficients",
     "{steps} steps do not determine {names}{reason}.",
     "Turn about every axis, in both senses, at two rates or more; leave out `asymmetry` or "
     "`cubic`, or give the coefficients named a prior."),
    ("rate_table.g_sensitivity", "error",
     "Placements that do not show the g-sensitivity",
     "With these placements ({placements}) the g-sensitivity is not told from bias: {names}.",
     "Place every axis up and down, or leave out g_sensitivity."),
    ("rate_table.outlier", "warning",
     "A step that does not fit the others",
     "Step {step} ({rate} deg/s, {placement}) is {norm} standard deviations from what the others "
     "say and was weighted down.",
     "Repeat it, or look for a disturbance in it."),
    ("rate_table.scatter", "warning",
     "Steps that scatter more than the noise",
     "The steps scatter by {ppm} ppm of their rate more than the noise explains; it was added to "
     "the uncertainties.",
     "Declare the table's `rate_jitter` if it is known. A pattern against the rate is a "
     "non-linearity of higher order instead: see the residuals."),
    ("rate_table.no_latitude", "note",
     "A rate table without latitude",
     "Without latitude the Earth's rotation along up is unknown; {sd} deg/h of it is part of the "
     "uncertainty of the biases that it is not told from.",
     "Give the latitude in [site]."),
    # From readings to a result
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
     "'{procedure}' needs middle and inner angle of every position, and some are unknown.",
     "Describe them in [log.table], or give the plan, or use norm_observation, which needs none."),
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
)
# fmt: on
