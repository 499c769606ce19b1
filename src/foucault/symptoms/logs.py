"""Rows of the table about files and logs.

(code, severity, symptom, message, cure), as there; kept apart only for length.
"""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("output.unwritable", "error", "Disk full, read-only or missing folder, no permission",
     "'{path}' cannot be written: {reason}. A file of this name that was there before is intact.",
     "Free some space, or choose a folder that exists and that you may write to."),
    ("log.cannot_write", "error", "A log file name with a suffix that is not written",
     "'{path}': logs are written as {allowed}.",
     "Give the file one of these suffixes."),
    ("log.span", "error", "A stretch of a log without start and end",
     "{option} '{given}' does not say when it starts and when it ends.",
     "Write {option} \"0 s to 300 s\"; times count from the start of the log."),
    # Finding the file and its columns
    ("log.no_file", "error", "A log description without a file",
     "The log description names no file.",
     'Write file = "session.csv" in [log].'),
    ("log.missing_file", "error", "A log that is not there",
     "The log '{path}' {what}.{hint}",
     "Correct file in [log]; a relative path starts from the folder of the campaign file."),
    ("log.format_unknown", "error", "A log whose format cannot be told from its name or content",
     "The format of '{file}' cannot be told from its suffix, and it is not text.",
     'Write format = "csv", "text", "parquet", "npy", "npz", "mat", "binary", "ros", "ulog", '
     '"novatel" or "vectornav" in [log]; a spreadsheet is saved as CSV first.'),
    ("log.unreadable", "error", "A damaged file, or one of another format than it claims",
     "'{file}' cannot be read as {format}: {reason}.",
     "Copy the file again from the logger, or correct format in [log]."),
    ("log.matlab_73", "error", "A MATLAB 7.3 (HDF5) file",
     "'{file}' is a MATLAB 7.3 file, which is not read.",
     "Save it in MATLAB with save(..., '-v7'), or as CSV."),
    ("log.zero_bytes", "error", "A text with zero bytes after what was written",
     "'{file}' holds zero bytes from line {line} on, which no text does: the logger made the file "
     "longer than what it wrote, or lost its power.",
     "Copy it again from the logger, or keep what comes before: "
     "`head -n {before} {file} > cut.csv`."),
    ("log.too_large", "error", "A log larger than memory",
     "'{file}' needs about {need} GB of memory, and {free} GB are free.",
     "Read a part of it, or every n-th sample's mean, written by the logger's own tool; or use a "
     "machine with more memory."),
    ("log.empty", "error", "A log without samples",
     "'{file}' has no samples.",
     "Check that the logger was recording, and that header and delimiter in [log] fit the "
     "file."),
    ("log.header_count", "error", "A title line with another count of columns than the data",
     "'{file}': the title line names {names} columns, but line {line}, the first of the data, "
     "has {cells}.",
     "Correct the file or delimiter in [log], or write header = {header} and give columns by "
     "number from 0."),
    ("log.preamble", "error", "Lines before the data that are neither titles nor remarks",
     "'{file}' line {line} is neither a title nor a sample: '{text}'.",
     "Write header = {header} in [log]: so many lines stand before the first sample."),
    ("log.header_numbers", "warning", "A line of the header that looks like a sample",
     "'{file}' line {line} is one of the {header} lines of the header, but it holds as many "
     "numbers as a sample: '{text}'.",
     "Correct header in [log] if this line is a sample; lines count as an editor counts them, "
     "blank lines and remarks included."),
    ("log.encoding", "error", "Text with zero bytes in it, such as UTF-16 without its mark",
     "'{file}' has zero bytes in its first lines: it is not text, or UTF-16 without its mark.",
     'Save it as UTF-8: in a spreadsheet choose "CSV UTF-8", in an editor "Save with encoding".'),
    ("log.undescribed", "error", "A log that was not described",
     "'{file}' has {have}, but [log] says neither which of them are gyro or accelerometer nor "
     "their units.",
     'Add [log.gyro] with columns = ["gx", "gy", "gz"] and unit = "deg/s", and [log.accel] '
     "likewise; `foucault init hand_rotated -o campaign.toml` writes a file to put them in."),
    ("log.bare", "error", "A log given alone, whose titles do not say what its columns are",
     "'{file}' has {have}; that does not say what they are: {reason}.",
     "Describe it in a campaign file: `foucault init hand_rotated -o campaign.toml`, then fill in "
     "[log]; or give the columns titles with their units, such as time (s), gyro_x (deg/s), "
     "accel_x (m/s^2), or of increments of both triads (kind = \"increment\" in [log]): gyro_x "
     "(rad), accel_x (m/s)."),
    ("log.units_from_titles", "note", "A log given alone, its units taken from its titles",
     "Nothing describes '{file}', so its units were taken from the titles of its columns: {units}.",
     "Check that they are right; a campaign file declares them for good."),
    # Formats that say what they hold
    ("log.declared", "note", "A format that declares its own units and axes",
     "'{file}' was read as {what}, whose format declares {units}, in axes {axes}; in right-forward-"
     "up: {turned}.",
     "If the driver keeps to other units or axes, give columns and unit in [log.gyro] and "
     "[log.accel]; they take the place of these."),
    ("log.library", "error", "A format whose library is not installed",
     "'{file}' is read by the library {name}, which is not installed.",
     "Run `pip install \"foucault[{extra}]\"`."),
    ("log.no_topic", "error", "A bag or log without the messages wanted",
     "'{file}' has {what}; it has {have}.",
     "Correct topic in [log], or record inertial readings: sensor_msgs/Imu, or sensor_combined, "
     "vehicle_imu or sensor_gyro and sensor_accel of PX4, RAWIMUSXA of NovAtel, $VNIMU."),
    ("log.several_topics", "error", "A bag or log with several instruments",
     "'{file}' has readings of several instruments: {have}.",
     'Choose one in [log], for example topic = "{example}".'),
    ("log.open_unit", "error", "A format that leaves its unit open",
     "'{file}': its format does not say what one count of the {block} is; that depends on the "
     "instrument.",
     'Write unit in [log.{block}], the size of one count from its manual such as "1e-9 rad" or '
     '"2e-8 m/s", with kind = "{kind}".'),
    ("log.sentence", "error", "A damaged sentence of a receiver",
     "'{file}' line {line} is damaged: {reason}.",
     'Copy the file again, or write missing = "drop" in [log] to leave such lines out.'),
    ("log.unpaired", "error", "A gyro and an accelerometer that are not sampled together",
     "'{file}': only {share} % of the samples of {topic} have one of the accelerometer less than "
     "half an interval apart.",
     'Use topic = "vehicle_imu" or "sensor_combined", which are sampled together.'),
    ("log.px4_calibrated", "warning", "Readings that PX4 has calibrated already",
     "'{file}': {topic} is less the autopilot's own offsets and scale factors, {count} of which "
     "are not zero or one.",
     "What is found is what they leave; calibrate sensor_gyro and sensor_accel to replace them."),
    ("log.cannot_guess", "error", "Columns that were left out and cannot be guessed",
     "'{file}' has {have}; none has a usual name of {block}.",
     "Write {example} in [log.{block}], by name or by number from 0."),
    ("log.unknown_column", "error", "A column that the file does not have",
     "'{file}' has no column '{name}'.{hint}",
     "{allowed} Correct it in [{table}.{block}]."),
    ("log.three_columns", "error", "A triad with more or fewer than three columns",
     "[log.{block}] columns = {given} is not a list of three.",
     'Name the columns of x, y and z, for example columns = ["gx", "gy", "gz"]; for `foucault '
     'allan` or `foucault inspect` of one axis its column alone, columns = "gx".'),
    ("log.one_axis", "error", "A triad with an axis not logged, where all three are needed",
     "[log.{block}] names a column for {axes} alone; this needs x, y and z.",
     'Name three columns, for example columns = ["gx", "gy", "gz"]. A single axis is taken by '
     "`foucault allan` and `foucault inspect`; no procedure calibrates it, rate_table with axes = "
     '["x up"] neither: it reads three gyros and turns about one.'),
    ("log.variable", "error", "A variable that the .mat or .npz file does not have",
     "'{file}' has no variable '{name}'.{hint}",
     "Its variables are: {allowed}. Correct variable in [log]."),
    ("log.record_missing", "error", "A binary file whose records were not described",
     "'{file}' is binary, but [log] does not say what its records are.",
     'Add [log.record] with type = "float64" and columns = 7 (and byte_order, skip).'),
    ("log.record_columns", "error", "Binary records without their count of columns",
     "[log.record] does not say how many numbers a record has, or says it twice differently.",
     'Write type = "float32" and columns = 7, or one type per column: type = ["uint32", "int16", '
     '"int16", "int16"].'),
    # What the columns mean
    ("log.time_and_rate", "error", "Both a time column and a sample rate",
     "[log] gives both a time column and a rate.",
     "Keep [log.time], or keep rate where the time column is too coarse to be used."),
    ("log.no_time", "error", "Neither a time column nor a sample rate",
     "[log] says neither which column of '{file}' is time nor the sample rate.",
     'Write rate = "100 Hz" in [log], or add [log.time] with column = "t" and unit = "s".'),
    ("log.rate", "error", "A sample rate that no log has",
     "[log] rate = {rate} Hz is not the rate of a log: those lie between 0.0001 Hz and 100 MHz.",
     'Write the sample rate, for example rate = "100 Hz".'),
    ("log.kind", "error", "A unit of increments for rates, or of rates for increments",
     "[log.{block}]: '{unit}' is a unit of {other}s, but kind is \"{kind}\".",
     'Write kind = "{other}", or the unit of a {kind}.'),
    ("log.kinds_differ", "error", "Rates of one triad beside increments of the other",
     "[log.gyro] has kind = \"{gyro}\" but [log.accel] has kind = \"{accel}\".",
     "Both must be rates or both increments; read them from two campaigns if they differ."),
    ("log.count_scale", "error", "Counts without a count scale",
     "[log.{block}] has unit = \"count\" without a scale, or with increments.",
     'Add scale = "{example}"; for increments write the size of one count as the unit, for '
     'example unit = "{tick}".'),
    ("log.scale_without_count", "error", "A count scale or zero for data that are not counts",
     "[log.{block}] has a scale or a zero, but its unit is '{unit}'.",
     'Write unit = "count", or leave scale and zero out.'),
    ("log.scale_zero", "error", "A count scale of zero",
     "[log.{block}] scale has a zero, or as good as one.",
     "Write the counts per unit from the maker's sheet; a negative scale turns the sign."),
    ("log.join_length", "error", "Two files of one log with different numbers of samples",
     "'{first}' has {n_first} samples but '{second}' has {n_second}.",
     "Cut both to the samples they share, so that each row of one belongs to the same row of "
     "the other."),
    ("log.join_time", "error", "Two files of one log whose times differ",
     "Row {row}: '{first}' is at {t_first} s but '{second}' at {t_second} s, more than half an "
     "interval ({half} s) apart.",
     "Both files must be sampled together: cut or resample them to common times."),
    ("log.more_alone", "error", "Further files beside blocks that are files of their own",
     "[log] has `more` files, and also no `file`, blocks with a `file` of their own, or `serial`.",
     "Name the first file in `file`, the others in `more`, each with all columns; a file with the "
     "rows of several instruments is calibrated by `foucault fleet`."),
    ("log.more_differs", "error", "Files of one log that do not hold the same",
     "'{first}' has {one}, but '{second}' has {other}.",
     "Files that are read one after the other need the same columns and sample rate."),
    ("log.more_moving", "error", "Further files where a motion is followed from sample to sample",
     "[log] has `more` files ({files}), and {what} needs one motion without interruption.",
     "Give one file. Rests and spins in files of their own are for {allowed}; whole recordings, "
     "with the instrument switched off between them, for {recordings}."),
    ("log.table_columns", "error", "Not three columns for the angles of a table",
     "[log.table] columns = {given!r} are not three columns.",
     'Write the outer, middle and inner angle, columns = ["outer", "middle", "inner"]; "" for one '
     "that is not logged."),
    ("log.table_empty", "error", "A [log.table] block without any column",
     "[log.table] names no column.",
     "Name columns (three angles), rate or position, or leave the block out."),
    ("log.table_unit", "error", "Table angles or rates without a unit",
     "[log.table] has {name}, but no {key}.",
     'Write {key} = "{example}" in [log.table].'),
    ("log.position_number", "error", "Positions that are not whole numbers",
     "'{file}', the column of the position: {value} is not a whole number.",
     "Number the positions 0, 1, 2 ... and leave the cell empty, or -1, in between."),
    ("log.averaged", "error", "Means over no time",
     "'{file}' row {row} (from 0) is a mean over {value} s.",
     "Give how long each mean lasts, more than 0; its column and unit are in [log.averaged]."),
    ("log.several_serials", "error", "Several instruments in one log",
     "'{file}' has rows of several instruments: {serials}.",
     "Calibrate them as a fleet, or keep the rows of one."),
    ("log.no_serial", "error", "A file of several instruments without a column of serial numbers",
     "'{file}' is to be read as the logs of several instruments, but no column is named.",
     'Write serial = "..." in [log]: the column that says which instrument a row belongs to.'),
    ("log.serial_files", "error", "Serial numbers in a log of several files",
     "The rows of several instruments must be in one file; the log has {count}: {files}.",
     "Join the files, or calibrate each instrument from files of its own."),
    # The samples
    ("log.ragged", "error", "A line with another count of columns than the rest",
     "'{file}' line {line} has {have} columns instead of {want}.",
     "Correct or delete the line; if the columns are separated otherwise, write delimiter in "
     "[log]."),
    ("log.truncated", "error", "A last line that was cut off",
     "'{file}' ends in the middle of line {line}, with {have} of {want} columns.",
     "Delete the last line; if more is missing, copy the file again from the logger."),
    ("log.record_cut", "error", "A binary file that ends in the middle of a record",
     "'{file}' ends with {left} bytes of a record of {record} bytes.",
     "Correct type, columns or skip in [log.record]; if they are right, the file was cut: remove "
     "these bytes."),
    ("log.not_numeric", "error", "A cell that is not a number",
     "'{file}' {line}, column '{column}': '{cell}' is not a number.{hint}",
     "Correct the cell, or choose another column in [log]; leave a missing value empty."),
    ("log.not_a_date", "error", "A cell in a column of dates that is not a date like the first",
     "'{file}' line {line}, column '{column}': '{cell}' is not a date and time of day written as "
     "in the first line of the data.",
     "Correct the cell; the year comes first, 2026-05-04T10:00:00.010Z, and either all lines "
     "name a time zone or none."),
    ("log.missing_value", "error", "Missing values (NaN or empty cells)",
     "'{file}': missing values in {columns}, {count} in all: {rows} of the data (from 0).",
     'Write missing = "drop" in [log] to leave these rows out.'),
    ("log.infinite", "error", "Infinite values",
     "'{file}': infinite or missing values in {columns}, {count} in all: {rows} of the data (from "
     "0).",
     'Write missing = "drop" in [log] to leave these rows out.'),
    ("log.dropped", "warning", "Missing or infinite values that were left out",
     "Missing or infinite values in {columns} were left out, {count} in all: {rows} of the data "
     "(from 0).",
     "Nothing to do if they are few; a turn across a gap is less certain."),
    ("log.time_backward", "error", "Time that runs backward",
     "Time runs backward at row {row} of the data (from 0): {time} s after {before} s, counted "
     "from the start; {count} such rows in all.",
     "The logger was restarted, or two logs were put together: keep one part of the file."),
    ("log.time_repeated", "error", "The same time twice",
     "Row {row} of the data (from 0) has the same time as the row before, {time} s from the start, "
     "but other readings; {count} such rows in all.",
     "{advice}. If rows of two logs are mixed, keep those of one."),
    ("log.rows_doubled", "warning", "Rows written twice",
     "{count} rows repeat the row before them in every column, time included, and were left out.",
     "Nothing to do; the logger or the program that wrote the file stored them twice."),
    ("log.time_unit", "warning", "A wrong unit of time (ms given as s)",
     "The median rate is {rate} Hz (a sample every {interval}) with unit = \"{unit}\" of time; "
     "inertial instruments are sampled at 1 Hz to 100 kHz.",
     'The unit is probably wrong; write unit = "{likely}" in [log.time], which gives {then} Hz.'),
    ("log.time_iso", "error", "Dates in a time column with another unit",
     "'{file}', column '{column}' holds dates such as 2026-05-04T10:00:00Z, but its unit is given "
     "as \"{unit}\".",
     'Write unit = "iso" in [log.time].'),
    ("log.time_not_iso", "error", "A time column without dates whose unit is \"iso\"",
     "'{file}', column '{column}' does not begin with a date such as 2026-05-04T10:00:00Z, but its "
     "unit is given as \"{unit}\".",
     'Write its unit in [log.time], for example unit = "s" or "ms"; a date and a time of day in '
     "two columns must be joined by a T."),
    ("log.gap", "warning", "Gaps: samples are missing",
     "Time has gaps, {count} in all; about {lost} samples are missing. The longest is {longest}, "
     "{start} s from the start, where {nominal} is usual.",
     "The logger lost data: a rest or turn across a gap is less certain, so repeat it if you "
     "can."),
    ("log.irregular", "warning", "An irregular sample rate",
     "The rate is irregular: {share} % of the intervals are more than 10 % off the usual "
     "{nominal} (1st to 99th percentile {low} to {high}).",
     "Use the instrument's own clock as time. {advice}."),
    ("log.saturated", "warning", "A saturated axis",
     "{triad} {axis} is saturated; samples at the limit: {count}, the first {start} s from the "
     "start.",
     "Turn more slowly or choose a wider range; leave the saturated turns out."),
    ("log.spikes", "warning", "Single readings that are far from those before and after",
     "Spikes, readings that stand alone far from those before and after: {count} ({axes}), the "
     "first at {time} s ({axis}, {size} times its noise). They were set apart: what is around them "
     "stands for them.",
     "Look for the cause in the logger, the link or the supply. What they were is lost; a few do "
     "no harm to a rest."),
    ("log.stuck", "warning", "An axis that does not move",
     "{triad} {axis} repeats one reading from {start} s to {end} s, counted from the start.",
     "The axis is stuck or its resolution is too coarse: check the column in [log.{triad}] and "
     "the instrument."),
    ("log.accel_unit", "warning", "g given as m/s^2, or rates as increments, or the reverse",
     "The median specific force is {norm} m/s^2, {ratio} times gravity, with unit = \"{unit}\" and "
     "kind = \"{kind}\".",
     "The unit is probably wrong; in [log.accel] write {lines}."),
    ("log.accel_norm", "warning", "A specific force that is not gravity, for no known reason",
     "The median specific force is {norm} m/s^2, {ratio} times gravity, with unit = \"{unit}\" and "
     "kind = \"{kind}\".",
     "Check unit, scale, zero and columns in [log.accel]."),
    ("log.temperature_unit", "warning", "A temperature no instrument has (kelvin read as degC)",
     "The median temperature is {given} degC.",
     "Check the unit in [log.temperature]: kelvin said to be degC, and degrees Celsius said to be "
     "K, look like this."),
    ("log.gyro_earth", "warning", "Rests that turn 3600 times as fast as the Earth (arcsec as deg)",
     "Where it moves least the gyro turns at {rate} deg/s, {ratio} times the Earth's rate, with "
     "unit = \"{unit}\".",
     "The unit is probably {likely}: correct it in [log.gyro]. It is right if the instrument "
     "turned at that rate all the time."),
    ("log.alike", "warning", "Increments over a wrong interval: all accelerometers off alike",
     "All three accelerometer scale factors are {percent} %, alike: so look increments divided by "
     "an interval {clock} % wrong, or an increment's size that is.",
     "Check the rate or the time column of [log] against another clock, and the size of one "
     "increment; local gravity does not differ so much."),
    ("log.per_g", "note", "A count scale per g: which g",
     "The count scale '{scale}' is per 1 g = 9.80665 m/s^2, the standard one, wherever the log is "
     "from.",
     "If it was found by taking local gravity for 1 g, write it per m/s^2: it is up to 0.3 % off, "
     "alike in all three accelerometer scale factors."),
    ("log.gyro_unit", "warning", "Angular rates no gyro can measure (deg/s read as rad/s)",
     "The gyro reaches {peak} rad/s ({degrees} deg/s), with unit = \"{unit}\" and kind = "
     "\"{kind}\"; no gyro measures that.",
     "The unit is probably wrong; in [log.gyro] write {lines}."),
)
# fmt: on
