"""The coefficients as a table: one row each, the covariance in further columns of the row.

Receiver's convention: ours. Values in SI units as the column ``unit`` says, in the axes of the
result whatever axes are asked for elsewhere.
"""

from __future__ import annotations

import csv
import io

from foucault.errors import error
from foucault.escape import commented, csv_cell
from foucault.export.request import FAMILIES, OWN_AXES, Request

CAN = FAMILIES


def text(wanted: Request) -> str:
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
