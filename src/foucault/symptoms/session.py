"""Rows of the table about sessions of rests and turns."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("session.earth_rate", "warning",
     "Gyros by which the Earth turns at another rate",
     "From attitude to attitude the gyros see the Earth turn at {rate} +- {sd} times its "
     "rate by the times and at the latitude that were given, whatever their biases: {causes}. "
     "Biases are wrong by as much of the Earth's rate; of gyros that give rates the scale factors "
     "are wrong by what the times are, of accelerometers that give increments theirs.",
     "Compare the times of the log with a clock (`rate` is N / T of a long log), give times of a "
     "better source, and check `latitude`."),
    ("rest.outliers", "note",
     "Samples at rest that lie far from all others",
     "{count} of {samples} samples of the {triad} at rest ({share} %) lie farther from the others "
     "than any would by chance; the farthest is {axis} at {time} s, {size} standard deviations "
     "off. They make {part} % of the power of the noise.",
     "Look at {axis} there: a transmission error, an electrical disturbance, a knock. In rests "
     "they are counted, in turns nobody sees them, so the noise that is used includes what they "
     "make; a log without them gives smaller uncertainties."),
    ("rest.moving", "warning",
     "A rest that turns slowly and steadily",
     "The quiet time {start}-{end} s turns at {rate} deg/s more than the others and is not "
     "used as a rest.",
     "Put the instrument down, or hold it still, for every rest."),
    ("rests.too_few", "error",
     "Fewer rests than coefficients",
     "The log has {given} rests of at least {shortest} s; {names} coefficients need at "
     "least {needed}.{hint}",
     "Rest the instrument in at least {needed} orientations (24 are good), each for "
     "{shortest} s or longer, or set `threshold` in [procedure] if rests were missed: "
     "`foucault inspect` shows them."),
    ("rests.plane", "error",
     "All rests in a plane, or too much alike",
     "The {given} rests do not determine the accelerometer coefficients: {why}.",
     "Add rests with {missing}."),
    ("accel.scale_impossible", "error",
     "Specific force that is not gravity by far (a wrong unit)",
     "The mean specific force at rest is {given} m/s^2, {ratio} times local gravity.",
     "Correct `unit`, `kind`, `scale` or `zero` of [log.accel]. A log in g declared as m/s^2 gives "
     "0.102, one in m/s^2 declared as g 9.81; counts that do not rest at 0 want a `zero`."),
    ("accel.one_axis", "error",
     "One accelerometer in another unit than the others",
     "The rests read gravity only if the readings of accelerometer {axis} are divided by {factor}: "
     "its column is in another unit than the others.",
     "Give all columns of [log.accel] in one unit, or make the file anew."),
    ("accel.orientation", "error",
     "First rest not as declared: gravity read instead of specific force, or swapped axes",
     "The first rest was declared '{declared}', but the accelerometers say {measured}.",
     "{advice}"),
    ("accel.sign_unknown", "note",
     "The orientation of the first rest is not declared",
     "Norms and turns cannot tell specific force from gravity (all three signs), nor axes "
     "exchanged alike in both triads.",
     'Declare the first rest once, for example first_rest = "z up" in [log.accel], and it '
     "will be checked."),
    ("gyro.axes", "error",
     "Gyro axes exchanged or of the wrong sign against the accelerometers",
     "The turns miss the change of gravity by {declared} deg as the gyro columns are "
     "declared; with {exchange} (body axis = declared column) they miss by {better} deg.",
     "Reorder `columns` of [log.gyro] like that, or those of [log.accel] the other way. Turns do "
     "not show whether all three accelerometer signs are reversed besides: with that, signs that "
     "look odd here may be two columns exchanged there."),
    ("gyro.reversed", "error",
     "All gyro signs reversed, or both triads mirrored alike",
     "The turns miss the change of gravity by {declared} deg as declared; with all three gyro "
     "signs reversed they miss by {better} deg.",
     "Either all gyro signs are reversed (write \"-\" before each of `columns` in [log.gyro]), or "
     "both triads are left-handed alike (two columns swapped, or one sign wrong, in both): check "
     "the columns against the instrument's drawing of its axes."),
    ("gyro.left_handed", "error",
     "A left-handed triad: two axes swapped, or one sign wrong, in one of the triads",
     "The turns miss the change of gravity by {declared} deg as declared; with gyro "
     "{exchange} (body axis = declared column) they miss by {better} deg, which is a "
     "left-handed exchange: one of the two triads is left-handed.",
     "Correct order and signs of `columns` in [log.gyro] or in [log.accel]; check which "
     "one against the instrument's drawing of its axes."),
    ("gyro.unit", "error",
     "Gyro in deg/s read as rad/s or the reverse, increments as rates or the reverse",
     "The turns miss the change of gravity by {declared} deg; with all rates multiplied by "
     "{factor} they miss by {better} deg: probably {cause}.",
     "Correct `unit` and `kind` in [log.gyro]."),
    ("gyro.stuck", "error",
     "All gyros stuck at one value",
     "All three gyros read one value throughout the log, {values} rad/s, while the accelerometers "
     "do not.",
     "Look at the gyro columns of the file: not connected, switched off, or not the columns that "
     "`columns` in [log.gyro] names. Without [log.gyro] the accelerometers are calibrated alone."),
    ("gyro.saturated", "error",
     "Turns faster than the range of the gyros",
     "The turns miss the change of gravity by {declared} deg, and the gyros are saturated, so that "
     "they say too little of them. {where}",
     "Turn more slowly or choose a wider range. Whether axes, signs or unit are wrong as well can "
     "be told when nothing is saturated."),
    ("session.means", "error",
     "Means of poses, where the turns between them are needed",
     "The rows of the log are means, one per pose; the turns between the poses, which calibrate "
     "the gyros, are not in it.",
     "Write name = \"hand_rotated\" in [procedure]: from means it calibrates the accelerometers, "
     "in any orientations, and finds the gyro bias. For the other gyro coefficients give the log "
     "with its samples."),
    ("session.no_gyro", "note",
     "A log without gyros",
     "The log has no gyro columns; only the accelerometers were calibrated.",
     "Add [log.gyro] to the campaign if the file has them."),
    ("session.no_latitude", "warning",
     "The Earth's rotation is not modelled",
     "The latitude is unknown, so the Earth's rotation (15 deg/h) stays in the gyro bias "
     "as an uncertainty of up to {sd} deg/h.",
     "Give `latitude` in [site]."),
    ("session.scatter", "note",
     "Residuals larger than the noise explains",
     "Beyond the noise {what} scatter by {sd} from one to the next; this is part of every "
     "uncertainty given.",
     "Hold or set the instrument down more firmly. If it was on a stable table, the noise "
     "settings or the error model are incomplete."),
    ("session.resolution", "warning",
     "Steps of the output so coarse that the noise does not average them out",
     "The {what} are read in steps much coarser than their noise: a mean at rest keeps an error "
     "of {sd} (sd) from rounding, which is part of the uncertainties.",
     "Log with more digits or a smaller range, or switch the instrument's low-pass filter off."),
    ("session.outlier", "warning",
     "One rest or turn that fits much worse than the others",
     "The {what} at {time} s is {norm} standard deviations off and was left out.",
     "Look at this part of the log in the report: was the instrument disturbed?"),
    ("session.common_scale", "warning",
     "All accelerometer scale factors off by the same amount (a wrong g)",
     "All three accelerometer scale factor errors are close to {ppm} ppm. A wrong value of "
     "local gravity looks exactly like this.",
     "Check `gravity` or `latitude` and `height` in [site]; gravity used: {gravity} m/s^2."),
    ("session.g_sensitivity", "warning",
     "Gyro readings at rest that depend on orientation",
     "Specific force explains {share} % of the scatter of the gyro readings at rest, up to "
     "{size} deg/h per g.",
     "Set g_sensitivity = true in [procedure] and calibrate again."),
    ("session.no_accel", "error",
     "A log without accelerometers for a procedure that needs them",
     "The log has no accelerometer columns; gravity is what this procedure calibrates by.",
     "Add [log.accel] to the campaign."),
    ("session.not_finite", "error",
     "A log made in a program that holds NaN or infinite numbers",
     "Sample {index} of {what} is not a finite number.",
     "Leave such samples out, or read the log with `foucault.read_log`, which says what it found."),
    ("solution.singular", "error",
     "A log whose equations have no solution",
     "The equations that follow from this log cannot be solved ({why}).",
     "Look at the log with `foucault inspect`: an axis that reads nothing, a column taken twice, "
     "or one axis in another unit."),
    ("published.unweighted", "error",
     "Noise or a prior given to the published recipe, which has no place for them",
     "The published recipe weighs all residuals alike; it cannot use {what}.",
     'Leave {what} out, or use name = "hand_rotated" in [procedure].'),
)
# fmt: on
