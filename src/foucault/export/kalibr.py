"""The imu.yaml of Kalibr: noise, and the blocks of its model ``scale-misalignment``.

Receiver's convention, from its source (``IccScaledMisalignedImu``)::

    accel = M_a f_i + b_a
    gyro  = M_g C_gyro_i w_i + A C_gyro_i f_i + b_g

with M_a and M_g lower triangular, C_gyro_i a rotation, and frame i defined by the accelerometers
as in our gauge of that name. It estimates the biases anew in every session and keeps none.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.escape import commented
from foucault.export.numbers import number, row
from foucault.export.request import Request
from foucault.models.imu import Gauge

CAN = (
    "accel.scale",
    "accel.misalignment",
    "gyro.scale",
    "gyro.misalignment",
    "gyro.g_sensitivity",
)


def text(wanted: Request) -> str:
    """Write the file."""
    model, C_ib = wanted.model.in_gauge(Gauge.LOWER)
    M_g, C_gyro_i = lower_times_rotation(model.gyro_matrix)
    A = model.g_sensitivity @ C_gyro_i.T
    turn = np.degrees(np.linalg.norm(C_ib - np.eye(3)) / np.sqrt(2))
    lines = [
        commented(wanted.statement(), "#"),
        "#",
        "# For Kalibr, model scale-misalignment, frame i as its accelerometers define it:",
        "#   accel = M f_i + bias,  gyro = M C_gyro_i w_i + A C_gyro_i f_i + bias",
        "# Kalibr writes these blocks into its results and estimates them anew; as input it reads",
        "# the noise, the rate and the topic. Biases have no place in the file.",
    ]
    if turn > 1e-9:
        lines += [f"# Frame i is turned by {turn:.3g} deg against the axes of the result."]
    lines += [
        "rostopic: /imu0",
        *_rate(wanted.result.validity),
        *_noise(wanted),
        "model: scale-misalignment",
        "accelerometers:",
        *_matrix("M", model.accel_matrix),
        "gyroscopes:",
        *_matrix("M", M_g),
        *_matrix("A", A),
        *_matrix("C_gyro_i", C_gyro_i),
    ]
    return "\n".join([*lines, ""])


def lower_times_rotation(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Split `matrix`, shape (3, 3) [1], into a lower triangular matrix times a rotation."""
    Q, R = np.linalg.qr(matrix.T)
    signs = np.sign(np.diag(R))
    return np.tril((R * signs[:, None]).T), (Q * signs).T


def _matrix(name: str, matrix: FloatArray) -> list[str]:
    return [f"  {name}:", *(f"  - [{row(line)}]" for line in matrix)]


def _rate(validity: Mapping[str, Any]) -> list[str]:
    rate = validity.get("rate")
    if rate is None:
        return ["# update_rate: not known to the result; write it here [Hz]"]
    return [f"update_rate: {float(rate):.9g}"]


def _noise(wanted: Request) -> list[str]:
    """Write the noise; what is not known stays a comment, which Kalibr will ask for."""
    measured = wanted.result.diagnostics.get("noise") or {}
    out = []
    for name, key, unit in (
        ("accel", "accelerometer", "m/s^2"),
        ("gyro", "gyroscope", "rad/s"),
    ):
        triad = None if wanted.noise is None else getattr(wanted.noise, name)
        axes = measured.get(f"{name}_white")
        white = triad.white if triad and triad.white else _rms(axes)
        walk = triad.random_walk if triad and triad.random_walk else None
        for what, value, root in (
            ("noise_density", white, "sqrt(Hz)"),
            ("random_walk", walk, "sqrt(s)"),
        ):
            if value:
                out.append(f"{key}_{what}: {number(value)}  # {unit}/{root}")
            else:
                words = "not known to the result; measure it with foucault allan"
                out.append(f"# {key}_{what}: {words} [{unit}/{root}]")
    return out


def _rms(values: Any) -> float | None:
    """Kalibr has one number for three axes: their root mean square."""
    if values is None or None in values:
        return None
    return float(np.sqrt(np.mean(np.square(values))))
