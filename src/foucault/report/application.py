"""How a result is applied: its equation, commands, Python, and the numbers as matrices."""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.models import cluster
from foucault.models.imu import INVERSES, ImuModel
from foucault.models.layouts import of_one_sample
from foucault.models.north_seeker import EQUATION as NORTH_EQUATION
from foucault.report.page import Block, Code, Equation, Section, Text
from foucault.result import Result

_COMMANDS = """\
foucault apply result.json LOG -o compensated.parquet
foucault export result.json --to c -o calibration.h"""

_PYTHON = """\
import foucault

result = foucault.load_result("result.json")
print(result.verdict.level, result.coefficients, sep="\\n")
# accel [m/s^2] and gyro [rad/s]: readings, each with shape (n, 3)
f_b, w_ib_b = result.model.compensate(accel, gyro)"""


_LOG_PYTHON = """\
import foucault

result = foucault.load_result("result.json")
print(result.verdict.level, result.coefficients, sep="\\n")
# log: a foucault.Log of both triads; lever arms and delay need samples side by side
compensated = result.apply(log)"""


_TEMPERATURE_COMMANDS = (
    _COMMANDS
    + """
foucault export result.json --to px4 --at "25 degC" -o px4.params"""
)

_TEMPERATURE_PYTHON = """\
import foucault

result = foucault.load_result("result.json")
print(result.verdict.level, result.coefficients, sep="\\n")
# log: a foucault.Log with temperature [K]; every sample gets the coefficients of its own
compensated = result.apply(log)
at_20_degC = result.at(293.15)  # a result like any other"""

_CLUSTER_PYTHON = """\
import foucault

result = foucault.load_result("result.json")
print(result.verdict.level, result.coefficients, sep="\\n")
# accel [m/s^2]: readings, command [rad/s]: commanded rates, each with shape (n, 3)
f_p, w_ip_p = result.model.compensate(accel, command)"""

_NORTH = """\
foucault north READINGS --calibration result.json -o fix
foucault export result.json --to c -o calibration.h"""


def how_to_apply(result: Result) -> Section | None:
    """Equation, command, a few lines of Python, and the matrices."""
    said, meant = _split(result.equation)
    blocks: list[Block] = [Equation(said)] if said else []
    blocks += [Text(f"Here {line}.") for line in meant]
    if result.equation == NORTH_EQUATION:
        blocks += [Text("In the field, from the run folder:"), Code(_NORTH)]
        return Section("How to apply it", "The instrument says, for what is true:", blocks)
    commands, python = _COMMANDS, _LOG_PYTHON if result.size_effect else _PYTHON
    inverse = INVERSES.get(result.equation)
    imu = inverse is not None
    lead = "The instrument says, for what is true:"
    if result.temperature is not None:
        commands, python, imu = _TEMPERATURE_COMMANDS, _TEMPERATURE_PYTHON, False
    if result.equation == cluster.EQUATION:
        inverse, commands, python = cluster.INVERSE, _COMMANDS, _CLUSTER_PYTHON
        lead = "How the cluster turns, and what its accelerometers say:"
    finite = bool(np.isfinite(result.coefficients.values).all())
    if finite and inverse is not None:
        blocks += [Text("Solved for what is true:"), Equation(_split(inverse)[0])]
    blocks += [Text("On the command line, from the run folder:"), Code(commands)]
    blocks += [Text("In Python:"), Code(python)]
    if finite and imu:
        blocks += [Text("The numbers alone, in SI units:"), Code(numbers(result))]
    return Section("How to apply it", lead, blocks)


def _split(equation: str) -> tuple[list[str], list[str]]:
    """Part the equations from the words that explain them."""
    parts = [part.strip() for part in equation.split(";") if part.strip()]
    said = [part for part in parts if "=" in part]
    meant = [part for part in parts if "=" not in part]
    return said, meant


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
    size = result.size_effect
    if size:
        lines += [
            _array("r", size.arms, "rows: accelerometers x, y, z [m]"),
            f"tau = {size.delay:.12g}  # [s]",
            *_terms(model),
            "# With these terms use foucault.load_result(...).apply.",
        ]
        return "\n".join(lines)
    return "\n".join([*lines, *_use(model, triads)])


def _use(model: ImuModel, triads: set[str]) -> list[str]:
    """Lines that use the matrices, where a line does it."""
    if not (model.straight and model.accel_linear) or model.deflection.any():
        return [
            *_terms(model),
            "# With these terms use foucault.load_result(...).model.compensate.",
        ]
    g = " - f_b @ G.T" if model.g_sensitivity.any() else ""
    out = [""]
    if "accel" in triads:
        out.append("f_b = (accel - b_a) @ np.linalg.inv(A).T  # accel: shape (n, 3) [m/s^2]")
    if "gyro" in triads:
        out.append(f"w_ib_b = (gyro - b_g{g}) @ np.linalg.inv(W).T  # gyro: shape (n, 3) [rad/s]")
    return out


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
    if values.ndim == 1:
        return f"{name} = np.array({_row(values)})  # {unit}"
    rows = "\n".join(f"    {_row(row)}," for row in values.reshape(-1, values.shape[-1]))
    shape = f".reshape{values.shape}" if values.ndim > 2 else ""
    return f"{name} = np.array([  # {unit}\n{rows}\n]){shape}"


def _row(values: FloatArray) -> str:
    return "[" + ", ".join(f"{v:.12g}" for v in values.tolist()) + "]"
