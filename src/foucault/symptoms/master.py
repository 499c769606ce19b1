"""What can go wrong with the messages of a master INS, and where they are simulated."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("master.empty", "error",
     "A master's table without messages",
     "{file} has {rows} messages that can be used; two are the least.",
     "Check that the file is the right one and that its columns are numbers."),
    ("log.master_frame", "warning",
     "A bag whose odometry may not be east-north-up",
     "'{file}': {topic} is given in the frame '{frame}', which need not have its x axis east.",
     "Take the topic whose frame is 'map' and aligned to north; a heading from an arbitrary start "
     "makes the mounting of the slave wrong by as much."),
    ("master.missing", "error",
     "Messages of a master that lack a number",
     "{file}: {count} of {rows} messages lack a number, the first of them is number {row}.",
     'Write missing = "drop" in its description to leave them out.'),
    ("master.dropped", "note",
     "Messages of a master that were left out",
     "{file}: {count} of {rows} messages lack a number and were left out, the first of them is "
     "number {row}.",
     "Nothing, if the master was switched on late or lost its fix."),
    ("master.time", "error",
     "A master's time that does not run forward",
     "{file}: {count} messages have a stamp that is not after the one before, the first at "
     "{time} s.",
     "Sort the table by time; two messages that differ cannot have one stamp. Where the stamps "
     "start anew the log holds two runs: use one of them."),
    ("master.repeated", "note",
     "Messages of a master that came twice",
     "{file}: {count} messages repeat the one before to the last digit and were left out.",
     "Nothing. A logger that asks more often than the master answers writes such rows."),
    ("master.gaps", "note",
     "Messages of a master that are missing",
     "{file}: gaps, {count} in all, in which about {lost} messages are missing; the longest is "
     "{longest}, usual are {usual}.",
     "Nothing, if gaps are short: what the slave does in them is its own navigation."),
    ("master.angles", "error",
     "Angles of a master that cannot be",
     "{file} has a {angle} of {given} deg with the unit that was given.",
     "Check the unit ({unit}) and the order of the columns: heading, pitch, roll."),
    ("master.columns", "error",
     "A master's table of which a part is not described",
     "{file}: {what}.",
     "Describe time, velocity (east, north, up; or north, east, down with frame = \"NED\") and "
     "attitude (heading, pitch, roll) with their units; position may be left out. Or title the "
     "columns with their units: time (s), velocity east (m/s), velocity north (m/s), velocity up "
     "(m/s), heading (deg), pitch (deg), roll (deg)."),
    ("master.frame", "error",
     "Velocities of a master in another frame than it is told",
     "{file}: with frame {given} the velocities miss the positions by {miss} m in {time} s, with "
     "{other} by {better} m.",
     'Write frame = "{other}" in [master.velocity], or correct the order of its columns.'),
    ("master.place_swapped", "error",
     "Latitude and longitude of a master that are exchanged",
     "{file}: the velocities miss the positions by {miss} m in {time} s, and by {better} m with "
     "latitude and longitude exchanged.",
     "Correct the order of the columns in [master.position]: latitude, longitude, height."),
    ("master.heading_sense", "warning",
     "A heading that counts the other way",
     "{file}: the heading goes against the course of the velocity, as if it counted {other}.",
     'Write sense = "{other}" in [master.attitude].'),
    ("master.heading_course", "warning",
     "A heading that does not go with the course",
     "{file}: the heading differs from the course of the velocity by {offset} deg on average, and "
     "by {spread} deg more or less.",
     "Check unit and zero of the heading (it is 0 to the north), and the frame of the velocities. "
     "Vehicles that hover, drift or back look like this too."),
    ("transfer_plan.profile", "error",
     "A motion for transfer alignment that is not built in",
     "There is no motion '{given}'.{hint}",
     "Write one of {allowed}, or make a TransferProfile."),
    ("transfer_plan.speed", "error",
     "A search for a motion whose speeds leave out that of the start",
     "A motion that begins at {given} m/s cannot keep to {slowest} to {fastest} m/s.",
     "Give [optimise] a `slowest` and `fastest` around the speed at the start, or [simulate] "
     "another `speed`."),
    ("transfer_plan.short", "error",
     "A search for a motion with less time than its manoeuvres need",
     "{total} s are too short for {most} manoeuvres of {shortest} s and a straight run.",
     "Give [optimise] a longer `total`, a smaller `most` or a smaller `shortest`."),
    ("transfer_plan.value", "error",
     "A number of a simulated transfer alignment that cannot be",
     "`{key}` is {given}; it has to be {allowed}.",
     "Correct it. Times are in seconds, angles in radians."),
)
# fmt: on
