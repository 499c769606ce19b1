"""The page of a calibration: its sections in order, how to apply it, certificate, provenance.

A procedure gets a section by filling its table; a new kind of section is a row of `SECTIONS`.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.references import WORDS as CLOCKS
from foucault.errors import ADVICE, Status
from foucault.models import cluster, magnetometer
from foucault.models.imu import INVERSES, ImuModel
from foucault.models.layouts import of_one_sample
from foucault.models.north_seeker import EQUATION as NORTH_EQUATION
from foucault.report import page
from foucault.result import Result
from foucault.units import ZERO_CELSIUS, factor, plain

SECTIONS = {
    "tumble.alignment": "attitude platform_tumble",
    "uncertainty.functions": "temperature_curves",
    "uncertainty.left_out": "temperature_points",
    "uncertainty.coefficients": "",
    "calibration.merged": "merged",
    "systematic.deflection": "choice",
    "systematic.velocities": "velocities",
    "systematic.navigation": "table:navigation navigation",
    "systematic.sequence": "attitudes innovations sequence",
    "transfer.mounting": "transfer_alignment mounting",
    "transfer.done": "transfer_alignment filter",
    "transfer.delay": "transfer_alignment filter",
    "transfer.ignored": "transfer_alignment estimates undelayed",
    "transfer.estimates": "transfer_alignment estimates",
    "transfer.motion": "transfer_alignment estimates stretches",
    "transfer.innovations": "transfer_alignment innovations",
    "transfer.bound": "transfer_alignment gamma",
    "transfer.attitude": "transfer_alignment smoothed",
    "transfer.handed": "transfer_alignment hand_over",
    "evidence.norms": "rests",
    "evidence.norms_of_readings": "readings",
    "evidence.rate_steps": "rate_steps",
    "evidence.field": "magnetometer field cells heading",
    "evidence.spins": "spins mountings",
    "evidence.headings": "headings",
    "evidence.residuals": "rests",
    "evidence.residuals_of_readings": "readings",
    "evidence.orientations": "",
    "evidence.control": "readings",
    "evidence.rig": "rig",
    "tumble.motion": "path:outer path:x.east",
    "tumble.observability": "observability",
    "tumble.course": "course:attitude.x",
    "tumble.residuals": "residuals:x",
    "tumble.sensitivity": "sensitivity:x.gyro.drift.x",
    "uncertainty.unseen": "",
    "uncertainty.budget": "budget",
    "uncertainty.not_estimated": "table:left_out",
    "uncertainty.correlation": "",
    "evidence.held_out": "rests",
    "evidence.detection": "detection",
    "calibration.findings": "",
    "calibration.checks": "",
    "calibration.how_to_apply": "",
    "calibration.certificate": "",
    "calibration.provenance": "",
}
"""The sections of the report in order: function, and what it needs: the procedure, tables, their
columns, diagnostics. What a result does not have is not loaded."""


def document(result: Result) -> page.Document:
    """Return what there is to say of a calibration."""
    return page.Document.of(heading(result), sections(result))


def heading(result: Result) -> page.Heading:
    """Return the top of the page."""
    names = [str(result.instrument[k]) for k in ("name", "serial") if result.instrument.get(k)]
    reasons = list(result.verdict.reasons)
    if not reasons and result.checks:
        reasons = [f"All {len(result.checks)} checks passed."]
    if result.status is not Status.CONVERGED and ADVICE[result.status] not in reasons:
        reasons.append(ADVICE[result.status])
    level = result.verdict.level
    title = f"Calibration of {' '.join(names)}" if names else "Calibration"
    title += " over temperature" if result.temperature is not None else ""
    some = result.tables.get("merged")
    count = 0 if some is None else len(set(some["result"].tolist())) - 1
    created = result.provenance.get("created")
    line = [
        result.procedure,
        f"{count} results merged" if count else "",
        page.place(result.site),
        page.date(str(created)) if created else "",
    ]
    return page.Heading(
        title, [part for part in line if part], page.STATES[level], page.WORDS[level], reasons
    )


def sections(result: Result) -> list[page.Section]:
    """Return the sections that `result` has something to show in."""
    has = {"", result.procedure, *result.tables, *(f"table:{t}" for t in result.tables)}
    has |= {k for k, v in result.diagnostics.items() if v}
    has |= {f"{name}:{c}" for name, some in result.tables.items() for c in some if len(some[c])}
    out = []
    for place_, needs in SECTIONS.items():
        if has.issuperset(needs.split()):
            module, _, name = place_.partition(".")
            function = getattr(import_module(f"foucault.report.{module}"), name)
            out.append(function(result))
    return [section for section in out if section is not None]


# -- the certificate -------------------------------------------------------------------------

SLOW = np.radians(0.1)  # Slower rates are those of a north seeker, in degrees per hour [rad/s].

KNOWN = ("name", "serial", "operator", "due", "note")
"""Keys of the instrument that the certificate shows."""


def certificate(result: Result) -> page.Section | None:
    """Who and what; lines to fill in by hand where the campaign does not say."""
    made = result.provenance
    if not (result.instrument or made or result.site):
        return None
    of = {key: str(result.instrument.get(key) or "").strip() for key in KNOWN}
    version = made.get("versions", {}).get("foucault")
    log: dict[str, Any] = made.get("input") or next(iter(made.get("inputs") or []), {})
    digest = f", SHA-256 {log['sha256'][:12]}…" if log.get("sha256") else ""
    wanted = [
        ("instrument", of["name"]),
        ("serial number", of["serial"]),
        ("operator", of["operator"]),
        ("date", page.date(str(made["created"])) if made.get("created") else ""),
        ("temperature", _temperature(result.validity)),
        ("next calibration due", of["due"]),
    ]
    known = [
        ("place", page.place(result.site)),
        ("local gravity", page.gravity(result.site)),
        ("time base", _clock(result)),
        *_covered(result),
        ("procedure", result.procedure),
        *_positions(result),
        ("software", f"Foucault {version}" if version else "Foucault"),
        ("log", f"{log['file']}{digest}" if log.get("file") else ""),
        ("note", of["note"]),
    ]
    pairs = [*wanted, *(pair for pair in known if pair[1]), ("signature", "")]
    return page.section("calibration.certificate", page.Facts(pairs), *_type_b(result))


def _type_b(result: Result) -> list[Any]:
    """What is not estimated, as contributions of type B; in words where it is taken for nothing."""
    some, key = result.tables.get("left_out"), "calibration.certificate"
    if some is None:
        return [page.said(f"{key}.nothing")] if result.coefficients.free.any() else []
    order = np.argsort(-np.asarray(some["share"], float), kind="stable")
    what, sizes, basis = ([str(some[k][i]) for i in order] for k in ("what", "size", "basis"))
    share, times = ([float(some[k][i]) for i in order] for k in ("share", "times"))
    return [
        page.said(f"{key}.left_out"),
        page.table(
            ("not estimated", what),
            ("size (1 sd): number", sizes),
            ("type: short", ["B"] * len(what)),
            ("evaluated from: aside", basis),
            ("largest share of a variance: number", [f"{100 * v:.1f} %" for v in share]),
            ("readings", [f"{t:.3g} times its size" if t > 1 else "agree" for t in times]),
        ),
    ]


def _clock(result: Result) -> str:
    """Whose clock counted the time, and how well its rate is known."""
    base = result.clock
    if base is None or base.source == "several":
        return ""
    known = "declared" if base.declared else "usual for it"
    return f"{CLOCKS[base.source]} ± {base.sd * 1e6:.3g} ppm ({known})"


def _temperature(validity: dict[str, Any]) -> str:
    """Return the range in °C, empty where the log has no temperature."""
    span = validity.get("temperature")
    if not span or any(v is None for v in span):
        return ""
    low, high = (v - ZERO_CELSIUS for v in span)
    mean = validity.get("temperature_mean")
    also = "" if mean is None else f", mean {mean - ZERO_CELSIUS:.1f} °C"
    return page.minus(f"{low:.1f} to {high:.1f} °C{also}")


def _covered(result: Result) -> list[tuple[str, str]]:
    """The ranges outside which the result is extrapolated; of a triad that was calibrated."""
    rows = []
    triads = {name.partition(".")[0] for name in result.coefficients.names}
    for key, what, size, unit in (
        ("accel", "specific force covered", 1.0, "m/s²"),
        ("gyro", "rates covered", np.pi / 180, "°/s"),
    ):
        span = result.validity.get(key) if key in triads else None
        if span and None not in span:
            if key == "gyro" and max(map(abs, span)) < SLOW:
                size, unit = size / 3600, "°/h"
            low, high = (page.minus(f"{v / size:.3g}") for v in span)
            rows.append((what, f"{low} to {high} {unit}"))
    return rows


def _positions(result: Result) -> list[tuple[str, str]]:
    """Plan, rests and spins of a session on a table."""
    some = result.tables.get("readings")
    if some is None or "outer" not in some:
        return []
    rate, turns = np.asarray(some["rate"], float), np.asarray(some["turns"], float)
    spin = rate != 0.0
    said = [page.counted(int(np.sum(~spin)), "rest")] if not spin.all() else []
    if spin.any():
        each = " to ".join(f"{v:.0f}" for v in np.unique([turns[spin].min(), turns[spin].max()]))
        sizes = np.unique(np.round(np.degrees(rate[spin]), 3)).tolist()
        rates = page.minus(", ".join(f"{v:.4g}" for v in sizes))
        whole = f"{each} turn{'' if each == '1' else 's'}"
        said.append(f"{page.counted(int(spin.sum()), 'spin')} of {whole} at {rates} °/s")
    plan = str(result.diagnostics.get("plan") or "")
    return [("positions", plan), ("readings", ", ".join(said))]


# -- results merged --------------------------------------------------------------------------


def merged(result: Result) -> page.Section | None:
    """One row per coefficient, one column per result, the merged one last."""
    some = result.tables["merged"]
    keys = ("coefficient", "result", "value", "sd")
    found = {(c, r): (v, sd) for c, r, v, sd in zip(*(some[k].tolist() for k in keys), strict=True)}
    rows = list(result.coefficients.rows())

    def cell(row: dict[str, Any], name: str) -> str:
        if (row["name"], name) not in found:
            return ""
        value, sd = (v / factor(row["display_unit"], row["kind"]) for v in found[row["name"], name])
        return f"{page.known_to(value, sd)} ± {plain(sd, 2)}"

    names = dict.fromkeys(some["result"].tolist())
    return page.section(
        "calibration.merged",
        page.table(
            ("coefficient: name", [row["name"] for row in rows]),
            *((f"{name}: number", [cell(row, name) for row in rows]) for name in names),
            ("unit: short", [page.shown(row["display_unit"]) for row in rows]),
        ),
    )


# -- findings, checks, provenance ------------------------------------------------------------


def findings(result: Result) -> page.Section | None:
    """What was noticed in the data."""
    return page.findings(result.findings)


def checks(result: Result) -> page.Section | None:
    """Every test that the verdict rests on."""
    return page.checks(result.checks)


def provenance(result: Result) -> page.Section | None:
    """What the result was made from and with; what the certificate says is not said again."""
    made = result.provenance
    inputs = [*made.get("inputs", []), *([made["input"]] if made.get("input") else [])]
    rest = {k: v for k, v in made.items() if k not in ("inputs", "input", "versions", "created")}
    return page.provenance(
        [
            *[(k, page.words(v)) for k, v in result.instrument.items() if k not in KNOWN],
            *[(f"input {k}", page.words(v)) for one in inputs for k, v in one.items()],
            *[(k, page.words(v)) for k, v in rest.items()],
            ("versions", page.words(made.get("versions") or {})),
            ("status", result.status.value),
        ]
    )


# -- how to apply it -------------------------------------------------------------------------


def how_to_apply(result: Result) -> page.Section | None:
    """Equation, command, a few lines of Python, and the matrices."""
    key = "calibration.how_to_apply"

    def code(what: str) -> page.Code:
        return page.Code(page.told(f"{key}.{what}").lstrip("\n"))

    equations, meant = _split(result.equation)
    blocks: list[Any] = [page.Equation(equations) if equations else None]
    blocks += [f"Here {line}." for line in meant]
    if result.equation == NORTH_EQUATION:
        return page.section(
            key, blocks, "In the field, from the run folder:", code("commands_north")
        )
    inverse, kind, lead = INVERSES.get(result.equation), "", None
    imu = inverse is not None
    if result.size_effect:
        kind = "_log"
    if result.temperature is not None:
        kind, imu = "_temperature", False
    if result.equation == cluster.EQUATION:
        inverse, kind, lead = cluster.INVERSE, "_cluster", page.told(f"{key}.cluster")
    if result.equation == magnetometer.EQUATION:
        inverse, kind = magnetometer.INVERSE, "_mag"
    finite = bool(np.isfinite(result.coefficients.values).all())
    if finite and inverse is not None:
        blocks += ["Solved for what is true:", page.Equation(_split(inverse)[0])]
    commands = "commands_temperature" if kind == "_temperature" else "commands"
    blocks += ["On the command line, from the run folder:", code(commands)]
    blocks += ["In Python:", code(f"python{kind}")]
    if finite and imu:
        blocks += ["The numbers alone, in SI units:", page.Code(numbers(result))]
    return page.section(key, blocks, lead=lead)


def _split(equation: str) -> tuple[list[str], list[str]]:
    """Part the equations from the words that explain them."""
    parts = [part.strip() for part in equation.split(";") if part.strip()]
    return [part for part in parts if "=" in part], [part for part in parts if "=" not in part]


def numbers(result: Result) -> str:
    """Return the matrices of an IMU result as lines of Python that compensate readings."""
    model = ImuModel.from_coefficients(of_one_sample(result.coefficients))
    triads = {name.partition(".")[0] for name in result.coefficients.names}
    lines = ["import numpy as np", ""]
    if "accel" in triads:
        lines += [_array("A", model.accel_matrix, "I + S_a + M_a [1]")]
        lines += [_array("b_a", model.accel_bias, "[m/s^2]")]
    if "gyro" in triads:
        lines += [_array("W", model.gyro_matrix, "I + S_g + M_g [1]")]
        lines += [_array("b_g", model.gyro_bias, "[rad/s]")]
        if model.g_sensitivity.any():
            lines += [_array("G", model.g_sensitivity, "[rad/s/(m/s^2)]")]
    if size := result.size_effect:
        lines += [_array("r", size.arms, "rows: accelerometers x, y, z [m]")]
        lines += [f"tau = {size.delay:.12g}  # [s]"]
    if size or not (model.straight and model.accel_linear) or model.deflection.any():
        call = "apply" if size else "model.compensate"
        lines += [*_terms(model), f"# With these terms use foucault.load_result(...).{call}."]
        return "\n".join(lines)
    g = " - f_b @ G.T" if model.g_sensitivity.any() else ""
    lines.append("")
    if "accel" in triads:
        lines.append("f_b = (accel - b_a) @ np.linalg.inv(A).T  # accel: shape (n, 3) [m/s^2]")
    if "gyro" in triads:
        lines.append(f"w_ib_b = (gyro - b_g{g}) @ np.linalg.inv(W).T  # gyro: shape (n, 3) [rad/s]")
    return "\n".join(lines)


def _terms(model: ImuModel) -> list[str]:
    """What has no closed inverse, or one for every sample."""
    terms = {
        "a_a": (model.accel_asymmetry, "diagonal of A_a [1]"),
        "K_a": (model.accel_quadratic, "[1/(m/s^2)], columns q(f)"),
        "a_g": (model.gyro_asymmetry, "diagonal of A_g [1]"),
        "c_g": (model.gyro_cubic, "diagonal of C_g [1/(rad/s)^2]"),
        "T": (model.deflection, "rows T_xxk, T_xyk, ... [rad/(m/s^2)]"),
    }
    return [_array(name, values, unit) for name, (values, unit) in terms.items() if values.any()]


def _array(name: str, values: FloatArray, unit: str) -> str:
    """Write an array as Python, to 12 digits."""

    def row(some: FloatArray) -> str:
        return "[" + ", ".join(f"{v:.12g}" for v in some.tolist()) + "]"

    if values.ndim == 1:
        return f"{name} = np.array({row(values)})  # {unit}"
    rows = "\n".join(f"    {row(one)}," for one in values.reshape(-1, values.shape[-1]))
    shape = f".reshape{values.shape}" if values.ndim > 2 else ""
    return f"{name} = np.array([  # {unit}\n{rows}\n]){shape}"
