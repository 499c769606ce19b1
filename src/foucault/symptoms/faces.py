"""What can go wrong with rests on faces and whole turns."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("faces.missing", "error",
     "A face of the six missing",
     "There is no rest with {missing}; found were {found}.{hint}",
     "Rest the instrument on all six faces (each axis up and down). If a rest was missed, set "
     "`threshold` or `shortest` in [procedure], or give `sections`: `foucault inspect` shows the "
     "rests."),
    ("faces.off", "error",
     "A rest that is on no face",
     "{where} is {tilt} deg off the nearest face ({face}); up to {limit} deg are allowed.",
     "Rest the instrument on its faces, or use name = \"hand_rotated\" or \"norm_observation\" in "
     "[procedure], which take any orientation."),
    ("faces.left_out", "warning",
     "A quiet time between the faces",
     "{where} is {tilt} deg off the nearest face ({face}) and was left out.",
     "Nothing to do if it was a pause between two faces."),
    ("faces.moves", "error",
     "Gyros whose axes, signs or unit contradict the moves from face to face",
     "Between the faces up turns by {declared} deg (rms) otherwise than the gyros say. {count} "
     "exchanges of axes, signs or units would explain it to {better} deg, such as: body axis = "
     "gyro column {causes}.",
     "Correct `columns`, `unit` or `kind` of [log.gyro], or `columns` of [log.accel]; a turn about "
     "each axis in between tells which (name = \"hand_rotated\" or \"ferraris\")."),
    ("faces.moving", "error",
     "A rest whose mean still moves",
     "The instrument moves in the rest with {face} at {start} s: its mean changes by {moved}.",
     "Wait until it is still and settled, or give `sections` that leave the movement out."),
    ("faces.outlier", "warning",
     "A rest on a face that does not fit the others",
     "The {what} of the rest with {face} at {time} s is {sds} standard deviations off.{also}",
     "Look at this part of the log: was the instrument disturbed, or not flat on the face? It was "
     "not left out."),
    ("faces.section_name", "error",
     "A section with a name that is not known",
     "There is no section '{name}'.{hint}",
     "Use the names {allowed}: the axis, then p or a for one and the other way up, rot for the "
     "turn about it."),
    ("faces.section_missing", "error",
     "Sections given, but not for all six faces",
     "The sections lack {missing}.",
     "Give all six rests, or leave `sections` out to have the rests found."),
    ("faces.section_range", "error",
     "A section outside of the log, or too short",
     "Section {name} is {given}, the log has {samples} samples.",
     "Give the first sample, counted from 0, and the sample after the last, at least {shortest} "
     "apart."),
    ("faces.section_means", "error",
     "Sections of a log whose rows are means",
     "The rows of the log are means, one per rest; sections do not apply.",
     "Leave `sections` out: each row is assigned to a face by its specific force."),
    ("faces.section_axis", "error",
     "A section with another axis vertical than its name says",
     "Section {name} has {face}.",
     "Correct the ranges in `sections`, or the order of `columns` in [log.accel]."),
    ("faces.section_sense", "note",
     "Sections whose p and a are the other way round",
     "In the sections {names} the axis is not up for p and down for a; what is up was taken from "
     "the data.",
     "If the accelerometers read -1 g along up, write reads = \"gravity\" in [log.accel]; if "
     "not, there is nothing to do."),
    ("turns.no_gyro", "error",
     "Turns to be calibrated without gyros",
     "The log has no gyro columns; turns calibrate gyros.",
     "Add [log.gyro] to the campaign, or use name = \"six_position\" in [procedure]."),
    ("turns.means", "error",
     "Turns in a log whose rows are means",
     "The rows of the log are means; turns need the samples.",
     "Give the log with its samples, or use name = \"six_position\" in [procedure]."),
    ("turns.missing", "error",
     "A turn about an axis missing",
     "There is no turn as declared about {missing}; turns were found about: {seen}.",
     "Turn the instrument once about each axis, with a rest on the same face before and after, or "
     "give the turns in `sections`."),
    ("turns.section_missing", "error",
     "Sections given, but not for all three turns",
     "The sections lack {missing}.",
     "Give x_rot, y_rot and z_rot too, or leave `sections` out to have rests and turns found."),
    ("turns.partial", "error",
     "A turn by another angle than declared",
     "In {where} the gyro measures {measured} deg about {axis}, {declared} deg are declared.",
     "Turn until the instrument stands as before; or set `angle` in [procedure] to the angle that "
     "was turned, a list of three where they differ from axis to axis, or check unit and scale of "
     "[log.gyro]."),
    ("turns.axis", "error",
     "A turn about another axis than it should be",
     "In {where} the gyros measure {measured} deg about x, y and z, which is no turn about {axis}.",
     "Turn about one axis of the case at a time, on the face; or correct the names in `sections` "
     "or the order of `columns` in [log.gyro]."),
    ("turns.reversed", "error",
     "All turns in the other sense than declared",
     "All turns go against the declared angle of {declared} deg.",
     "If they were made in the other sense, set angle = {other} in [procedure]; if not, "
     "the signs of all gyros are wrong: write \"-\" before each of `columns` in [log.gyro]."),
    ("turns.sense", "error",
     "Turns in both senses, or a gyro of the wrong sign",
     "The turns about {axes} go against the declared angle of {declared} deg, the others do not "
     "({where}).",
     "If the turn about {axes} was made in the other sense, make it again; if not, that gyro has "
     "the wrong sign: write \"-\" before its column in [log.gyro]."),
    ("ferraris.prior", "error",
     "A prior given to the published solution, which has no place for it",
     "The published solution cannot use [prior].",
     'Leave [prior] out, or set solution = "likelihood" in [procedure].'),
)
# fmt: on
