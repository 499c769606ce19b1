"""One exception type, one table of symptoms, and the status of a computation.

Bad input raises `FoucaultError`: what was given, what is allowed, what to do. Something the
user should know but that does not stop the work is a `Finding`. Both take their words from
`SYMPTOMS`, the one table that the documentation prints. Mathematics that fails is neither:
it is a `Status` inside the result, and its text is advice.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from enum import StrEnum

from foucault.log_symptoms import ROWS as LOG_ROWS


@dataclass(frozen=True)
class Symptom:
    """One row of the table: what the user sees and what helps."""

    code: str
    severity: str  # "error" stops the work; "warning" and "note" are reported
    symptom: str
    message: str  # str.format template
    cure: str  # str.format template


class FoucaultError(Exception):
    """Bad input: says what was given, what is allowed and what to do.

    Attributes
    ----------
    code : str
        Key of `SYMPTOMS`, shape ().
    message : str
        What was given and what is allowed, shape ().
    cure : str
        What to do, shape ().
    """

    def __init__(self, code: str, message: str, cure: str) -> None:
        super().__init__(f"{message} {cure}".strip())
        self.code = code
        self.message = message
        self.cure = cure

    def __reduce__(self) -> tuple[type[FoucaultError], tuple[str, str, str]]:
        return type(self), (self.code, self.message, self.cure)


@dataclass(frozen=True)
class Finding:
    """Something the user should know about the data; the work goes on."""

    code: str
    severity: str
    message: str
    cure: str

    def as_dict(self) -> dict[str, str]:
        """Return the finding as plain strings for result.json."""
        return asdict(self)


class Status(StrEnum):
    """How a computation ended. Anything but `CONVERGED` carries advice, not an exception."""

    CONVERGED = "converged"
    NOT_CONVERGED = "not converged"
    UNOBSERVABLE = "unobservable"
    NOT_FINITE = "not finite"


ADVICE: dict[Status, str] = {
    Status.CONVERGED: "The solution converged.",
    Status.NOT_CONVERGED: (
        "The iteration did not settle. The usual reasons are a wrong unit, swapped axes or a "
        "moving rest: run `foucault inspect` on the log and read its findings."
    ),
    Status.UNOBSERVABLE: (
        "The motion cannot tell all coefficients apart. Add rests in the directions named "
        "below, or fix the named coefficients with a prior."
    ),
    Status.NOT_FINITE: (
        "The computation met a number that is not finite. Look for saturated or missing "
        "samples with `foucault inspect`."
    ),
}


def error(code: str, **values: object) -> FoucaultError:
    """Build the exception for symptom `code` with its words filled in from `values`."""
    row = SYMPTOMS[code]
    return FoucaultError(code, row.message.format(**values), row.cure.format(**values))


def finding(code: str, **values: object) -> Finding:
    """Build the finding for symptom `code` with its words filled in from `values`."""
    row = SYMPTOMS[code]
    return Finding(code, row.severity, row.message.format(**values), row.cure.format(**values))


def suggestion(word: str, allowed: Iterable[str]) -> str:
    """Return ``" Did you mean 'x'?"`` for a near miss, else an empty string."""
    near = difflib.get_close_matches(word, list(allowed), n=1, cutoff=0.6)
    return f" Did you mean '{near[0]}'?" if near else ""


def _table(rows: Iterable[tuple[str, str, str, str, str]]) -> dict[str, Symptom]:
    table = {row[0]: Symptom(*row) for row in rows}
    return dict(sorted(table.items()))


# (code, severity, symptom, message, cure). Later procedures add their rows here, nowhere else.
SYMPTOMS: dict[str, Symptom] = _table(
    [
        *LOG_ROWS,
        (
            "unit.missing",
            "error",
            "A number without its unit, or text that is not a number and a unit",
            "{key}: {given} has no unit; {kind} wants a number and a unit.",
            'Write it with its unit in quotes, for example "{example}".',
        ),
        (
            "unit.kind",
            "error",
            "A unit of the wrong kind (an angle where a rate is wanted, ppm where an angle is)",
            "'{unit}' does not measure {kind}.",
            'Use a unit of {kind}, for example "{example}".',
        ),
        (
            "unit.unknown",
            "error",
            "A unit that is not in the vocabulary",
            "Unit '{unit}' is not known.{hint}",
            "Known are m, s, min, h, Hz, rad, deg, arcmin, arcsec, g, mg, ug, ppm, percent, "
            "count, K and their products, quotients, powers and sqrt().",
        ),
        (
            "campaign.missing",
            "error",
            "The campaign file is not there",
            "Campaign file '{path}' does not exist.{hint}",
            "Give the path of a campaign file; `foucault init hand_rotated -o campaign.toml` "
            "writes one to start from.",
        ),
        (
            "campaign.syntax",
            "error",
            "The campaign file is not valid TOML",
            "'{path}' is not valid TOML: {reason}.",
            'Write one `key = value` per line, text in quotes ("0.01 deg/h"), tables in '
            "[brackets]; `foucault init hand_rotated` prints a correct example.",
        ),
        (
            "campaign.key",
            "error",
            "A misspelt or misplaced key in the campaign file",
            "{key} is not a key of a campaign file.{hint}{more}",
            "Allowed in {table} are: {allowed}.",
        ),
        (
            "campaign.required",
            "error",
            "A key that must be there is not",
            "{key} is missing.{more}",
            "Add it ({example}); `foucault init hand_rotated` prints a complete example.",
        ),
        (
            "campaign.value",
            "error",
            "A value of the wrong type or outside its range",
            "{key}: {given} is not allowed; {reason}.{hint}{more}",
            "Correct it; `foucault schema` prints what every key takes.",
        ),
        (
            "campaign.procedure",
            "error",
            "A procedure that does not exist",
            "Procedure '{name}' is not known.{hint}",
            "Known procedures are: {allowed}.",
        ),
        (
            "site.latitude",
            "error",
            "A latitude beyond a pole",
            "site.latitude: {given:.6g} deg is outside -90 to 90 deg.",
            "Give the geodetic latitude, positive north; perhaps latitude and longitude are "
            "exchanged.",
        ),
        (
            "site.gravity",
            "error",
            "A gravity that does not exist on the surface of the Earth",
            "site.gravity: {given:.6g} m/s^2 is outside 9.7 to 9.9 m/s^2.",
            "Give local gravity, or leave it out and give latitude and height: normal gravity "
            "is then used.",
        ),
        (
            "site.unknown",
            "error",
            "Neither gravity nor latitude is given",
            "site: neither gravity nor latitude is given, so the scale of the accelerometers "
            "has no reference.",
            'Add latitude = "48.8462 deg" and height = "60 m", or gravity = "9.80943 m/s^2", to '
            "[site].",
        ),
        (
            "site.gravity_differs",
            "warning",
            "Gravity as given is far from normal gravity at the latitude and height given",
            "site.gravity {given:.5f} m/s^2 differs from normal gravity at this latitude and "
            "height, {normal:.5f} m/s^2, by {ppm:.0f} ppm; real anomalies stay below 500 ppm.",
            "Check gravity, latitude and height: every accelerometer scale factor takes over "
            "this error in full.",
        ),
        (
            "prior.kind",
            "error",
            "A prior on a group whose coefficients are of several kinds",
            'prior."{name}" holds coefficients of several kinds: {kinds}.',
            "Give a prior for each group, for example {example}.",
        ),
        (
            "prior.sd",
            "error",
            "A prior whose standard deviation is not positive",
            'prior."{name}": sd = {given} is not positive.',
            "Give the standard deviation of what is known of the coefficient; leave the prior "
            "out if nothing is.",
        ),
        (
            "noise.empty",
            "error",
            "A [noise] table that says nothing",
            "noise: neither a grade nor a noise of accel or gyro is given.",
            'Write grade = "mems" (or {allowed}), or [noise.accel] and [noise.gyro] with white = '
            "..., or leave [noise] out: it is then estimated from the rests.",
        ),
        (
            "output.exists",
            "error",
            "A file to be written is there already",
            "'{path}' exists already and may hold your work.",
            "Choose another name with -o, or remove the file first.",
        ),
        (
            "coefficient.unknown",
            "error",
            "A coefficient name that the model does not have",
            "Coefficient '{name}' is not part of this model.{hint}",
            "The names of this model are: {allowed}.",
        ),
        (
            "result.missing",
            "error",
            "The result or run folder does not exist",
            "There is no '{path}'.",
            "Give a run folder or the result.json in it.",
        ),
        (
            "result.incomplete",
            "error",
            "A run folder without result.json",
            "'{folder}' holds no result.json: it is no run folder, or its run did not end.",
            "Give another folder, or run `foucault calibrate` again.",
        ),
        (
            "result.not_json",
            "error",
            "A result file that is not JSON",
            "'{file}' is not a result: {problem}.",
            "Give a result.json written by foucault; if it was edited, mend or restore it.",
        ),
        (
            "result.schema",
            "error",
            "A result written by another version of the format",
            "'{file}' {given}; this version of foucault reads '{allowed}'.",
            "Use the version of foucault that wrote it (see provenance.versions), or calibrate "
            "again.",
        ),
        (
            "result.invalid",
            "error",
            "A result with missing or wrong keys",
            "'{file}' is not a complete result: {problems}.",
            "Restore the file as it was written; docs/result.md lists the keys.",
        ),
        (
            "result.covariance",
            "error",
            "A result whose covariance is not symmetric or has a negative variance",
            "The covariance in '{file}' is not valid: {problem}.",
            "Restore the file as it was written, or calibrate again.",
        ),
        (
            "result.table_missing",
            "error",
            "A table of the run folder is missing",
            "Table '{table}' of '{file}' is missing: there is no '{path}'.",
            "Copy the whole run folder, not result.json alone, or calibrate again.",
        ),
        (
            "result.table_changed",
            "error",
            "A table of the run folder was changed after the run",
            "Table '{table}' of '{file}' is not the one that was saved: the hash of '{path}' "
            "differs.",
            "Restore the run folder as it was written, or calibrate again.",
        ),
        (
            "rest.moving",
            "warning",
            "A rest that turns slowly and steadily",
            "The quiet time {start}-{end} s turns at {rate} deg/s more than the others and is "
            "not used as a rest.",
            "Put the instrument down, or hold it still, for every rest.",
        ),
        (
            "rests.too_few",
            "error",
            "Fewer rests than coefficients",
            "The log has {given} rests of at least {shortest} s; {names} coefficients need at "
            "least {needed}.{hint}",
            "Rest the instrument in at least {needed} orientations (24 are good), each for "
            "{shortest} s or longer, or set `threshold` in [procedure] if rests were missed: "
            "`foucault inspect` shows them.",
        ),
        (
            "rests.plane",
            "error",
            "All rests in a plane, or too much alike",
            "The {given} rests do not determine the accelerometer coefficients: {why}.",
            "Add rests with {missing}.",
        ),
        (
            "accel.scale_impossible",
            "error",
            "Specific force that is not gravity by far (a wrong unit)",
            "The mean specific force at rest is {given} m/s^2, {ratio} times local gravity.",
            "Correct `unit`, `kind` or `scale` of [log.accel]: {ratio} is what a wrong unit does "
            "(0.102: m/s^2 declared as g; 9.81: g declared as m/s^2).",
        ),
        (
            "accel.orientation",
            "error",
            "First rest not as declared: gravity read instead of specific force, or swapped axes",
            "The first rest was declared '{declared}', but the accelerometers say {measured}.",
            "{advice}",
        ),
        (
            "accel.sign_unknown",
            "note",
            "The orientation of the first rest is not declared",
            "Norms and turns cannot tell specific force from gravity (all three signs), nor "
            "axes exchanged alike in both triads.",
            'Declare the first rest once, for example first_rest = "z up" in [log.accel], and it '
            "will be checked.",
        ),
        (
            "gyro.axes",
            "error",
            "Gyro axes exchanged or of the wrong sign against the accelerometers",
            "The turns miss the change of gravity by {declared} deg as the gyro columns are "
            "declared; with {exchange} (body axis = declared column) they miss by {better} deg.",
            "Reorder `columns` of [log.gyro] like that, or those of [log.accel] the other way.",
        ),
        (
            "gyro.left_handed",
            "error",
            "A left-handed triad: two axes swapped, or one sign wrong, in one of the triads",
            "The turns miss the change of gravity by {declared} deg as declared; with gyro "
            "{exchange} (body axis = declared column) they miss by {better} deg, which is a "
            "left-handed exchange: one of the two triads is left-handed.",
            "Correct order and signs of `columns` in [log.gyro] or in [log.accel]; check which "
            "one against the instrument's drawing of its axes.",
        ),
        (
            "gyro.unit",
            "error",
            "Gyro in deg/s read as rad/s or the reverse, increments as rates or the reverse",
            "The turns miss the change of gravity by {declared} deg; with all rates multiplied "
            "by {factor} they miss by {better} deg: probably {cause}.",
            "Correct `unit` and `kind` in [log.gyro].",
        ),
        (
            "session.no_gyro",
            "note",
            "A log without gyros",
            "The log has no gyro columns; only the accelerometers were calibrated.",
            "Add [log.gyro] to the campaign if the file has them.",
        ),
        (
            "session.no_latitude",
            "warning",
            "The Earth's rotation is not modelled",
            "The latitude is unknown, so the Earth's rotation (15 deg/h) stays in the gyro bias "
            "as an uncertainty of up to {sd} deg/h.",
            "Give `latitude` in [site].",
        ),
        (
            "session.scatter",
            "note",
            "Residuals larger than the noise explains",
            "Beyond the noise {what} scatter by {sd} from one to the next; this is part of "
            "every uncertainty given.",
            "Hold or set the instrument down more firmly. If it was on a stable table, the "
            "noise settings or the error model are incomplete.",
        ),
        (
            "session.outlier",
            "warning",
            "One rest or turn that fits much worse than the others",
            "The {what} at {time} s fits {norm} times worse than its uncertainty and counts "
            "with weight {weight}.",
            "Look at this part of the log in the report; leave it out if it was disturbed.",
        ),
        (
            "session.common_scale",
            "warning",
            "All accelerometer scale factors off by the same amount (a wrong g)",
            "All three accelerometer scale factor errors are close to {ppm} ppm. A wrong value "
            "of local gravity looks exactly like this.",
            "Check `gravity` or `latitude` and `height` in [site]; gravity used: {gravity} m/s^2.",
        ),
        (
            "session.g_sensitivity",
            "warning",
            "Gyro readings at rest that depend on orientation",
            "Specific force explains {share} % of the scatter of the gyro readings at rest, up "
            "to {size} deg/h per g.",
            "Set g_sensitivity = true in [procedure] and calibrate again.",
        ),
        (
            "session.no_accel",
            "error",
            "A log without accelerometers for a procedure that needs them",
            "The log has no accelerometer columns; gravity is what this procedure calibrates by.",
            "Add [log.accel] to the campaign.",
        ),
        (
            "published.unweighted",
            "error",
            "Noise or a prior given to the published recipe, which has no place for them",
            "The published recipe weighs all residuals alike; it cannot use {what}.",
            'Leave {what} out, or use name = "hand_rotated" in [procedure].',
        ),
    ]
)
