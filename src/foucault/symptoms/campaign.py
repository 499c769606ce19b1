"""Rows of the table about units, campaign files and coefficient names."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("unit.missing", "error",
     "A number without its unit, or text that is not a number and a unit",
     "{key}: {given} has no unit; {kind} wants a number and a unit.",
     'Write it with its unit in quotes, for example "{example}".'),
    ("unit.size", "error",
     "A unit of a column that is nothing, or beyond all that is measured",
     "'{unit}' is no size of one {kind}: every reading would be {reading}.",
     'Write the unit, such as "{example}", or the size of one count with its unit.'),
    ("unit.range", "error",
     "A quantity of a size that nothing has",
     "{key}: {given} is of a size that nothing has.",
     "Check number and unit."),
    ("unit.angle", "error",
     "An angle in degrees, minutes and seconds that is none",
     "{key}: {given} is not an angle in degrees, minutes and seconds: {reason}.",
     'Write one number and one unit, "48.8462 deg", or "48d50m46s" with a sign in front or N, S, E '
     "or W behind."),
    ("site.height", "error",
     "A height where nobody calibrates",
     "site.height: {given:.6g} m is outside -500 m to 20 km.",
     "Give the height above the ellipsoid, in m or km; it sets local gravity."),
    ("unit.kind", "error",
     "A unit of the wrong kind (an angle where a rate is wanted, ppm where an angle is)",
     "'{unit}' does not measure {kind}.",
     'Use a unit of {kind}, for example "{example}".'),
    ("unit.unknown", "error",
     "A unit that is not in the vocabulary",
     "Unit '{unit}' is not known.{hint}",
     "Known are m, s, min, h, Hz, rad, deg, arcmin, arcsec, g, mg, ug, ppm, percent, "
     "count, K and their products, quotients, powers and sqrt()."),
    ("campaign.template", "warning",
     "The example values of the template beside a real log",
     "Still as in the template, which is only an example: {what}.",
     "Write your instrument into [instrument] and your place into [site]: its latitude and height "
     "give g and the Earth's rotation, and a wrong g is a wrong scale that no residual shows."),
    ("campaign.missing", "error",
     "The campaign file is not there",
     "Campaign file '{path}' does not exist.{hint}",
     "Give the path of a campaign file; `foucault init hand_rotated -o campaign.toml` "
     "writes one to start from."),
    ("campaign.syntax", "error",
     "The campaign file is not valid TOML",
     "'{path}' is not valid TOML: {reason}.",
     'Write one `key = value` per line, text in quotes ("0.01 deg/h"), a path with \\ in single '
     "quotes, tables in [brackets]; `foucault init hand_rotated` prints a correct example."),
    ("campaign.other_file", "error",
     "A log, or another file, where a campaign file is wanted",
     "'{path}' is not a campaign file: a TOML file, which names the log and says what it holds.",
     "`foucault init hand_rotated -o campaign.toml` writes one to start from; write "
     'file = "{name}" in its [log].'),
    ("campaign.empty", "error",
     "A file with nothing in it",
     "'{path}' has nothing in it, or only remarks: neither a campaign nor a log.",
     "Perhaps writing or copying it was cut off: copy it again; `foucault init hand_rotated -o "
     "campaign.toml` writes a campaign file to start from."),
    ("campaign.key", "error",
     "A misspelt or misplaced key in the campaign file",
     "{key} is not a key of a campaign file.{hint}{more}",
     "Allowed in {table} are: {allowed}."),
    ("campaign.required", "error",
     "A key that must be there is not",
     "{key} is missing.{more}",
     "Add it ({example}); `foucault init` with the name of the procedure prints a complete "
     "example."),
    ("campaign.value", "error",
     "A value of the wrong type or outside its range",
     "{key}: {given} is not allowed; {reason}.{hint}{more}",
     "Correct it; `foucault schema` prints what every key takes."),
    ("campaign.procedure", "error",
     "A procedure that does not exist",
     "Procedure '{name}' is not known.{hint}",
     "Known procedures are: {allowed}."),
    ("campaign.no_master", "error",
     "A master for a procedure that has none",
     "[master] is there, and procedure '{procedure}' calibrates an instrument by itself.",
     "Remove [master]; or write name = \"transfer_alignment\" in [procedure], which calibrates a "
     "slave against the navigation of a master."),
    ("site.latitude", "error",
     "A latitude beyond a pole",
     "site.latitude: {given:.6g} deg is outside -90 to 90 deg.",
     "Give the geodetic latitude, positive north; perhaps latitude and longitude are "
     "exchanged."),
    ("site.gravity", "error",
     "A gravity that does not exist on the surface of the Earth",
     "site.gravity: {given:.6g} m/s^2 is outside 9.7 to 9.9 m/s^2.",
     "Give local gravity, or leave it out and give latitude and height: normal gravity is "
     "then used."),
    ("site.unknown", "error",
     "Neither gravity nor latitude is given",
     "site: neither gravity nor latitude is given, so the scale of the accelerometers has "
     "no reference.",
     'Add latitude = "48.8462 deg" and height = "60 m", or gravity = "9.80943 m/s^2", to '
     "[site]."),
    ("site.gravity_differs", "warning",
     "Gravity as given is far from normal gravity at the latitude and height given",
     "site.gravity {given:.5f} m/s^2 differs from normal gravity at this latitude and "
     "height, {normal:.5f} m/s^2, by {ppm:.0f} ppm; real anomalies stay below 500 ppm.",
     "Check gravity, latitude and height: every accelerometer scale factor takes over this "
     "error in full."),
    ("prior.kind", "error",
     "A prior on a group whose coefficients are of several kinds",
     'prior."{name}" holds coefficients of several kinds: {kinds}.',
     "Give a prior for each group, for example {example}."),
    ("prior.sd", "error",
     "A prior whose standard deviation is not positive",
     'prior."{name}": sd = {given} is not positive, or too small to calculate with.',
     "Give the standard deviation of what is known of the coefficient; leave the prior out "
     "if nothing is."),
    ("prior.sure", "error",
     "A prior whose standard deviation is as good as nothing, or as everything",
     'prior."{name}": sd = {given} is beyond every instrument.',
     "Give what is really known of the coefficient; to hold it, an sd of a thousandth of what the "
     "session shows is enough."),
    ("noise.empty", "error",
     "A [noise] table that says nothing",
     "noise: neither a grade nor a noise of accel or gyro is given.",
     'Write grade = "mems" (or {allowed}), or [noise.accel] and [noise.gyro] with white = '
     "..., or leave [noise] out: it is then estimated from the rests."),
    ("coefficient.unknown", "error",
     "A coefficient name that the model does not have",
     "Coefficient '{name}' is not part of this model.{hint}",
     "The names of this model are: {allowed}."),
)
# fmt: on
