"""What any program reads: a table of coefficients, and JSON. Those of one receiver: `table`."""

from __future__ import annotations

import csv
import io
import json
from typing import Any

from foucault.errors import error
from foucault.escape import commented, csv_cell
from foucault.export.request import (
    FAMILIES,
    OWN_AXES,
    Request,
    TemperatureTerms,
    inverse,
)
from foucault.models.size_effect import SizeEffect

# -- The coefficients as a table: one row each, the covariance in further columns of the row -------
# Receiver's convention: ours. Values in SI units as the column ``unit`` says, in the axes of the
# result whatever axes are asked for elsewhere.


def csv_text(wanted: Request) -> str:
    """Write the table; lines that begin with # are comments."""
    if wanted.axes != OWN_AXES:
        raise error("export.axes_fixed", receiver="csv", given=wanted.axes, axes=OWN_AXES)
    vector = wanted.result.coefficients
    gone = set(wanted.dropped.names)
    keep = [i for i, name in enumerate(vector.names) if name not in gone]
    out = io.StringIO()
    print(commented(wanted.statement(), "#", table=True), file=out)
    print("# Columns cov:NAME hold the covariance with coefficient NAME, in the product of the"
          " two units; empty where unknown.", file=out)  # fmt: skip
    names = [vector.names[i] for i in keep]
    lines = csv.writer(out, lineterminator="\n")
    covariance = [] if vector.cov is None else [csv_cell(f"cov:{name}") for name in names]
    lines.writerow(["name", "symbol", "value", "sd", "unit", "free", "meaning", *covariance])
    for i in keep:
        c = vector.layout.coefficients[i]
        cov = [] if vector.cov is None else [_number(vector.cov[i, j]) for j in keep]
        sd = _number(vector.sd[i])
        value, free = repr(float(vector.values[i])), int(vector.free[i])
        words = [csv_cell(word) for word in (c.name, c.symbol, c.unit, c.meaning)]
        lines.writerow([*words[:2], value, sd, words[2], free, words[3], *cov])
    return out.getvalue()


def _number(value: float) -> str:
    return repr(float(value)) if value == value else ""


# -- Matrices and biases as plain JSON, forward and inverse, with the equations ------------------
# Receiver's convention: ours, whatever reads it.


FORMAT = "foucault.export/1"  # Name and version of the document.
MATRICES = ("accel_matrix", "accel_bias", "accel_quadratic", "gyro_matrix", "gyro_bias",
            "g_sensitivity", "gyro_asymmetry", "gyro_cubic", "accel_asymmetry",
            "deflection")  # fmt: skip


def json_text(wanted: Request) -> str:
    """Write the document."""
    model = wanted.model
    out = {
        "format": FORMAT,
        "about": wanted.statement(),
        "instrument": wanted.result.instrument,
        "axes": wanted.axes,
        "units": {"accel": "m/s^2", "gyro": "rad/s"},
        "forward": {
            "equation": "accel = p + accel_asymmetry |p| + accel_bias + accel_quadratic q(f), "
            "axis by axis; p = accel_matrix f; "
            "gyro = r + gyro_asymmetry |r| + gyro_cubic r^3 + gyro_bias + g_sensitivity f, axis "
            "by axis; r = (gyro_matrix + D) w; D_ij = sum over k of deflection_ijk f_k; "
            "q(f) = (fx^2, fy^2, fz^2, fx fy, fx fz, fy fz)",
            **{name: getattr(model, name).tolist() for name in MATRICES},
        },
        "inverse": {
            "equation": "f = accel_inverse p; p = (accel - accel_bias - accel_quadratic q(f)) / "
            "(1 + accel_asymmetry sign(p)), axis by axis, repeated until f stands still where "
            "accel_quadratic is not zero; w = gyro_inverse (r - D w), repeated until w stands "
            "still where deflection is not zero; "
            "r = (gyro - gyro_bias - g_sensitivity f - gyro_cubic r^3) / "
            "(1 + gyro_asymmetry sign(r)), axis by axis, repeated until r stands still where "
            "gyro_cubic is not zero",
            "accel_inverse": inverse(model.accel_matrix).tolist(),
            "gyro_inverse": inverse(model.gyro_matrix).tolist(),
        },
        **_size_effect(wanted.size),
        "dropped": dict(zip(wanted.dropped.names, wanted.dropped.values.tolist(), strict=True)),
    }
    if wanted.temperature is not None:
        out = _with_temperature(out, wanted.temperature)
    return json.dumps(out, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _with_temperature(out: dict[str, Any], terms: TemperatureTerms) -> dict[str, Any]:
    """Put terms in the place of constants, which would hold at one temperature only."""
    forward = {name: terms.block(name).tolist() for name in out["forward"] if name != "equation"}
    for part in ("forward", "inverse"):
        out[part] = {"equation": out[part]["equation"]}
    f = terms.functions
    out["temperature"] = {
        "equation": "every array of forward is the sum over k of terms[k] phi_k(T); phi_k is "
        + ("1 at knot k, 0 at every other, and straight between" if f.knots.size
           else "(T - reference)^k")
        + "; accel_inverse and gyro_inverse are the inverses of accel_matrix and gyro_matrix",
        "unit": "K",
        "low": f.low,
        "high": f.high,
        "reference": f.reference,
        "knots": f.knots.tolist(),
        "terms": forward,
    }  # fmt: skip
    return out


def _size_effect(size: SizeEffect) -> dict[str, Any]:
    """Return what several samples tell, where there is any."""
    if not size:
        return {}
    return {
        "size_effect": {
            "equation": "taken from accel before `inverse`: accel_i - (w x (w x r_i) + dw x r_i)_i "
            "+ accel_delay daccel_i, axis by axis; r_i row i of accel_places, w of `inverse` with "
            "accel as read, dw and daccel derivatives of gyro and accel as read",
            "accel_places": size.arms.tolist(),
            "accel_delay": size.delay,
        }
    }


WRITERS = {
    "csv": (FAMILIES, csv_text),
    "json": (FAMILIES, json_text),
}
"""Receiver -> the families it can express, and what writes its file."""
AT_TEMPERATURES = {"json": json_text}
"""The same of receivers that take coefficients which change with temperature."""
