"""What can go wrong with a north seeker."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    # Its log
    ("north.accel_sign", "error",
     "An accelerometer whose sign nobody has stated",
     "{where}: {given}, so it is not known whether the accelerometer reads specific force (+1 g "
     "up at rest) or gravity (-1 g). The tilt would have the wrong sign.",
     'Write reads = "specific force" or reads = "gravity" in [log.accel]; for a file given alone, '
     "--accel-reads gravity, or the title `gravity (g)` or `specific force (g)`. At rest and nose "
     "up, an accelerometer that points forward reads a positive specific force."),
    ("north.accel_columns", "error",
     "An accelerometer without its column, or with the wrong number of them",
     "[log.accel] names {given}.",
     'Write column = "..." for one accelerometer that turns with the gyro, or columns = ["right", '
     '"forward"] for two that stay with the case.'),
    ("north.bare", "error",
     "Readings given alone, whose titles do not say what the columns are",
     "'{file}' has {have}; that does not say what they are: {reason}.",
     "Give the columns titles with their units: setup, time (s), index (deg), gyro (deg/h), "
     "specific force (g), dwell (s); or describe them in a campaign file, `foucault init "
     "north_seeking -o campaign.toml`."),
    ("north.titles", "note",
     "Readings given alone, described by their titles",
     "Nothing describes '{file}', so this was taken from the titles of its columns: {units}. "
     "Index angles count clockwise seen from above, from forward.",
     "Check that it is right; a campaign file declares it for good."),
    ("north.setup_name", "error",
     "A name of a set-up that cannot be written into a table",
     "The name of the set-up {name!r} has a comma, a quotation mark or a # in it.",
     "Choose another name, or write a .parquet file."),
    ("north.setup_again", "note",
     "A set-up whose name comes again",
     "Set-up '{name}' comes again at row {row} of the data (from 0), after another one: it was "
     "taken as a set-up of its own, '{new}'.",
     "Nothing to do if the instrument was set up anew; otherwise sort the rows by set-up."),
    ("north.heading_moves", "error",
     "A reference heading that changes within a set-up",
     "The reference heading changes by {change} deg within set-up '{setup}'.",
     "A set-up is one placement of the instrument: give each heading another value in the column "
     "of `setup`, or leave `setup` out."),
    ("north.place", "error",
     "A latitude of a set-up that cannot be",
     "Set-up '{setup}' has a {what} of {given} deg.",
     "Latitudes lie between -90 and 90 deg, positive north, and their sd between 0 and 90 deg: "
     "check the unit of the column."),
    ("north.place_moves", "error",
     "A latitude that changes within a set-up",
     "The {what} changes by {change} deg within set-up '{setup}'.",
     "A set-up is one placement of the instrument: give each place another value in the column of "
     "`setup`, or leave `setup` out."),
    ("north.place_missing", "error",
     "Set-ups whose latitude is not given",
     "The column of latitudes is empty for set-ups, {count} in all, the first of them '{name}', "
     "and no latitude is given for all.",
     'Fill it in, or give the latitude of the others: --latitude "47.3 deg" or [site].'),
    ("north.one_place", "error",
     "A calibration of a north seeker at several places",
     "The log of a calibration has a column of latitudes; the turntable stands at one place, that "
     "of [site].",
     "Take `latitude` and `latitude_sd` out of [log], or the columns out of the file."),
    ("north.index_unit", "warning",
     "Index angles in another unit than declared",
     "The index angles are declared as {unit}, but {seen}.",
     'Write unit = "{likely}" in [log.index].'),
    ("north.gyro_unit", "warning",
     "A gyro that does not see the Earth's rate",
     "Over the index angles the gyro changes by up to +-{size} deg/h ({unit} declared); the "
     "Earth's rate gives at most 15.04 deg/h.",
     "{cure}"),
    ("north.accel_unit", "warning",
     "More specific force than gravity",
     "The accelerometers say {size} g, with unit = \"{unit}\"; tilt gives 1 g at most.",
     "{cure}"),
    ("north.not_imu", "error",
     "A command for the log of an IMU, given that of a north seeker",
     "The campaign is one of {procedure}: its log has one gyro on an indexing base, not the three "
     "axes that this command looks at.",
     "Use `foucault calibrate` or `foucault north` for it."),
    ("north.not_applied", "error",
     "The calibration of a north seeker, to be applied to the log of an IMU",
     "The result is that of a north seeker: it belongs to a gyro on an indexing base, not to three "
     "axes.",
     "`foucault north READINGS --calibration RESULT` applies it."),
    # Its dwells
    ("north.no_dwell", "error",
     "A log without a dwell",
     "The base never stands still for {shortest} and does not turn for so long either; its longest "
     "stop lasts {longest} without the {settle} to settle, at {rate} rows per second.",
     'If every row is already a mean, say over how long: [log.averaged] with column = "dwell" and '
     'unit = "s", or a column titled dwell (s). Else stop longer, or lower `shortest`.'),
    ("north.rows_apart", "error",
     "Rows that look like means, without how long they last",
     "In set-up '{setup}' the index angle steps by {step} deg from row to row: rows like that are "
     "means over stops, and nothing says how long they last.",
     'Give a column titled dwell (s), or in a campaign file [log.averaged] with column = "dwell" '
     'and unit = "s".'),
    ("north.setup_without", "warning",
     "Set-ups without a dwell",
     "Set-ups without a dwell of {shortest} were left out, {count} in all: {names}.",
     "Nothing to do if they are moves between set-ups."),
    ("north.both_ways", "warning",
     "A base that turned in both senses within one set-up",
     "In set-up '{setup}' the base turned in both senses. A gyro that is not exactly square to the "
     "axis of the base feels the rotation, with another sign each way; one offset is fitted.",
     "Give each sense a set-up of its own in the column of `setup`."),
    # Its simulation
    ("north.no_latitude", "error",
     "A north seeker simulated without latitude",
     "The latitude is not given, so the Earth's rate at the site is not known.",
     'Write latitude = "48.8462 deg" in [site].'),
    ("north.means_of_rotation", "error",
     "Means of a base that turns all the time",
     "A base that turns all the time has no stops to write one mean of.",
     'Write rows = "samples".'),
)
# fmt: on
