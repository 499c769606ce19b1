"""What can go wrong on a rate table."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
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
     "Turn about every axis, in both senses, at two rates or more; name in `axes` the placements "
     "that were meant, where they are not all; leave out `asymmetry` or `cubic`, or give the "
     "coefficients named a prior."),
    ("rate_table.g_sensitivity", "error",
     "Placements that do not show the g-sensitivity",
     "With these placements ({placements}) the g-sensitivity is not told from bias: {names}.",
     "Place every axis up and down, or leave out g_sensitivity."),
    ("rate_table.outlier", "warning",
     "A step that does not fit the others",
     "Step {step} ({rate} deg/s, {placement}) is {norm} standard deviations from what the others "
     "say and was left out.",
     "Repeat it, or look for a disturbance in it."),
    ("rate_table.scatter", "warning",
     "Steps that scatter more than the noise",
     "The steps scatter by {ppm} ppm of their rate more than the noise explains; it was added to "
     "the uncertainties.",
     "Declare the table's `rate_sd` if it is known. A pattern against the rate is a "
     "non-linearity of higher order instead: see the residuals."),
    ("rate_table.bias_moved", "warning",
     "A bias that moved during the session",
     "The gyro bias moved by {moved}, more than the noise explains; it was added to the "
     "uncertainties.",
     "Let the gyros warm up before the session, and hold the steps shorter. Where it is the "
     "temperature, keep it."),
    ("rate_table.no_latitude", "note",
     "A rate table without latitude",
     "Without latitude the Earth's rotation along up is unknown; {sd} deg/h of it is part of the "
     "uncertainty of the biases that it is not told from.",
     "Give the latitude in [site]."),
)
# fmt: on
