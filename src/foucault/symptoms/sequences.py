"""What can go wrong with the sequence of a systematic calibration, and with a log of one."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("sequence.empty", "error",
     "A sequence without a rest",
     "The sequence '{name}' has no rest; velocity errors are seen at rest alone.",
     "Put a rest of a minute or more before and after every turn."),
    ("sequence.start", "error",
     "A start attitude that is no rotation",
     "The start of the sequence '{name}' is {given}, which is not a right-handed rotation matrix.",
     "Make it with `orientation`, such as orientation((\"up\", \"east\", \"north\"))."),
    ("sequence.directions", "error",
     "Start directions that no body can have",
     "x, y and z cannot point to {given}.",
     "Name three perpendicular directions that are right-handed, each one of {allowed}: for "
     "example [\"up\", \"east\", \"north\"]."),
    ("sequence.gimbal", "error",
     "Gimbal positions that are not pairs of angles",
     "The gimbal positions of '{name}' have {given}; each has to be a finite outer and inner "
     "angle.",
     "Give an array of shape (n, 2) in radians: outer, inner."),
    ("sequence.turns", "error",
     "A spin of the gimbals' table by part of a turn",
     "The spins make {given} turns; they have to be whole ones, or the outer axis of the gimbals "
     "would not be where the next pose needs it.",
     "Spin by 1 or more whole turns; ten are usual."),
    ("sequence.unknown", "error",
     "A sequence that is not built in",
     "There is no sequence '{name}'.{hint}",
     "Choose one of {allowed}, or write your own as a file."),
    ("sequence.slanting", "error",
     "A sequence that starts slanting, to be written as actions",
     "The sequence '{name}' does not start with x, y and z along east, north and up; a file or a "
     "campaign cannot say that.",
     "Put turns from such a start before it; or write it as CSV."),
    ("sequence.campaign", "error",
     "A campaign without a sequence of systematic calibration",
     "{path} is a campaign of the procedure {procedure}, which has no such sequence.",
     'Name a campaign with name = "systematic", or the file of a sequence.'),
    ("sequence.file", "error",
     "A file of a sequence that cannot be read",
     "The sequence {path} cannot be read: {why}.",
     "Write it as TOML: a `start` and one [[action]] table for each rest, turn or spin."),
    ("sequence.entry", "error",
     "A wrong entry in the file of a sequence",
     "`{place}` of {path}: {why}.",
     "Correct it: an action is rest = \"150 s\", or turn = \"90 deg\" with about = \"y\", or "
     "spin = 10 with about = \"north\"."),
    ("systematic.site", "error",
     "A systematic calibration at an unknown place",
     "The latitude of the site is unknown; {what} needs the Earth's rate.",
     "Give `latitude` in [site]; a few arc minutes are accurate enough."),
    ("systematic.pole", "error",
     "A systematic calibration at a pole of the Earth",
     "The latitude is {given} deg; beyond +-89 deg the horizontal part of the Earth's rate is less "
     "than 2 % of the whole and shows no heading at the start, which {what} needs.",
     "Correct `latitude` in [site]."),
    ("systematic.value", "error",
     "A number of a simulated systematic calibration that cannot be",
     "`{key}` of the simulation is {given}; it has to be {allowed}.",
     "Correct it. Angles are in radians, lengths in metres, times in seconds."),
    ("systematic.triads", "error",
     "A log for systematic calibration without gyros or accelerometers",
     "The log has no {missing}; a systematic calibration navigates with both.",
     "Describe both triads in [log]."),
    ("systematic.no_rests", "error",
     "A log for systematic calibration with fewer than two rests",
     "The log has {given} rests of {shortest} s or more.",
     "Rest a minute or more before and after every turn; look at the log with `foucault inspect`."),
    ("systematic.start", "error",
     "The instrument did not start as the sequence says",
     "The sequence '{name}' starts with x, y, z to {declared}, so that {up} of the body is up; the "
     "first rest of the log has {measured} up, {angle} deg away.",
     "Start as declared, or correct `start`; look for swapped columns, and for accelerometers that "
     "read gravity instead of specific force (reads = \"gravity\" in [log.accel]), too."),
    ("systematic.heading", "warning",
     "The instrument started at another heading than the sequence says",
     "The Earth's rate in the rests says that the heading at the start was {angle} deg more than "
     "declared (clockwise), with an uncertainty of {sd} deg.",
     "Correct `start` if the sequence turns about east or north: those axes are then elsewhere. "
     "Turns about axes of the body alone are not affected."),
    ("systematic.turn_contradicts", "error",
     "A turn in which gyros and accelerometers contradict one another",
     "From {start} to {end} s the gyros say that up turned otherwise than the accelerometers, by "
     "{angle} deg; {count} of {turns} times it is so. No exchange of axes and no usual mistake of "
     "unit explains it.",
     "Look at the rates there with `foucault inspect`: a turn beyond the range of the gyros, or "
     "samples that are missing. Leave that part of the log out."),
    ("systematic.one_value", "error",
     "A sensor that reads one value throughout",
     "{sensors} read one value from the first row to the last.",
     "Check `columns` in [log] and the wiring: a column that is not filled, or a sensor that is "
     "stuck. Without it the instrument cannot be navigated."),
    ("systematic.rest_rate", "error",
     "Rests in which the gyros turn many times as fast as the Earth",
     "In its rests the instrument turns at {rate} deg/s, {ratio} times as fast as the Earth, and "
     "about an axis that goes round with its attitude as the Earth's does: {cause}.",
     "Correct `unit` (or `scale`) in [log.gyro]."),
    ("systematic.latitude", "warning",
     "A latitude that the Earth's rate in the rests contradicts",
     "Gravity and the Earth's rate in all rests show a latitude of {seen} deg (sd {sd}); "
     "{declared} deg was given.",
     "Correct `latitude` in [site]: the result is wrong by what the Earth turns otherwise."),
    ("systematic.heading_start", "error",
     "Turns about level axes of the table that started at another heading",
     "The turns of the log are not those of '{name}', but they are if the heading at the start was "
     "{angle} deg more than declared (clockwise); so says the Earth's rate in the rests, with an "
     "uncertainty of {sd} deg.",
     "Correct `start`: where x, y and z pointed at first."),
    ("systematic.gap", "error",
     "A log of a systematic calibration with samples missing",
     "Samples are missing at {where} ({count} in all, the longest {longest}; the usual interval is "
     "{usual}). The instrument is navigated from the first rest to the last, and what it did "
     "meanwhile is not known.",
     "Keep the rows before the gap or those after it, whichever hold more rests, or repeat the "
     "session."),
    ("systematic.count", "error",
     "A log with more or fewer turns than the sequence",
     "The sequence '{name}' has {declared} turns, the log {given}. {first}",
     "Check that log and sequence belong together and that the log holds the whole session; leave "
     "the sequence out to use the rests as found."),
    ("systematic.move", "error",
     "A turn that is not the one of the sequence",
     "Turn {number} of '{name}' ({action}), at {time} s, was to be {declared} of the body; it was "
     "{measured}.",
     "Correct axis, sense or angle of that action, or leave the sequence out to use the rests as "
     "found."),
    ("systematic.axes", "error",
     "Axes of the table exchanged or of the wrong sense",
     "The turns of the log are not those of '{name}' as labelled, but they are if the table turned "
     "about {words}.",
     "Correct the axes of the sequence; if the gyro columns may be exchanged, check those of the "
     "log first."),
    ("systematic.rest_missing", "warning",
     "A rest of the sequence in which the log is not at rest",
     "The rest '{label}' of '{name}', after {moves} turns, was not found in the log.",
     "Rest longer, and leave the table alone while it lasts; its velocity errors are not used."),
    ("systematic.rest_moves", "warning",
     "A rest during which the table creeps or settles",
     "The rest from {start} to {end} s moves: {what}.",
     "It is not used as a rest. Clamp the table, and wait until it has settled."),
    ("systematic.bump", "warning",
     "A rest that is interrupted by a small movement",
     "Between the rests that end at {end} s and begin at {start} s the table moved by {angle}: too "
     "little for a turn.",
     "Both parts are rests of their own, and the gyros have measured what lies between. Keep "
     "people and doors away from the table."),
    ("systematic.upright", "error",
     "All turns about the vertical: they change nothing but the heading",
     "In all {given} rests the same direction of the body is up, within {angle} deg; such turns "
     "say something of the gyros about the vertical and nothing of scale factors and "
     "misalignments of the accelerometers.",
     "Turn about level axes too, so that each axis of the body is up and down at least once, as "
     "the 19 positions do."),
)
# fmt: on
