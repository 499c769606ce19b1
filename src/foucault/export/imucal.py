"""The JSON file of imucal (``CalibrationInfo.from_json_file``).

Receiver's convention, from its source (``FerrarisCalibrationInfo``, format version 2.0.0)::

    acc_out = R_a^-1 K_a^-1 (acc - b_a)
    gyr_out = R_g^-1 K_g^-1 (gyr - K_ga acc_out - b_g)

in m/s^2 and deg/s. With K the diagonal of our matrix and R the rest, K R is our matrix.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.export.request import LINEAR, Request

CAN = (*LINEAR, "gyro.g_sensitivity")


def text(wanted: Request) -> str:
    """Write the document."""
    model = wanted.model
    K_a, R_a = _split(model.accel_matrix)
    K_g, R_g = _split(model.gyro_matrix)
    out: dict[str, Any] = {
        "acc_unit": "m/s^2",
        "gyr_unit": "deg/s",
        "from_acc_unit": "m/s^2",
        "from_gyr_unit": "deg/s",
        "comment": "\n".join(wanted.statement()),
        "K_a": K_a.tolist(),
        "R_a": R_a.tolist(),
        "b_a": model.accel_bias.tolist(),
        "K_g": K_g.tolist(),
        "R_g": R_g.tolist(),
        "K_ga": np.rad2deg(model.g_sensitivity).tolist(),
        "b_g": np.rad2deg(model.gyro_bias).tolist(),
        "cal_type": "Ferraris",
        "_format_version": "2.0.0",
    }
    return json.dumps(out, indent=4, allow_nan=False) + "\n"


def _split(matrix: npt.NDArray[np.float64]) -> tuple[Any, Any]:
    diagonal = np.diag(matrix)
    return np.diag(diagonal), matrix / diagonal[:, None]
