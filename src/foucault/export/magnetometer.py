"""A magnetometer's calibration for receivers: what each holds, and what the rest costs a heading.

Receivers correct by ``P (mag - h)`` with P symmetric. Of ``A^-1 = R P = P' R`` the rotation R to
the axes of the IMU has a place where a receiver lets a sensor sit askew, which it seldom does.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import error, suggestion
from foucault.export.quantities import Known, MagKnown
from foucault.export.request import AXES, about, known_axes, usable
from foucault.export.table import Receiver
from foucault.models.imu import ImuModel
from foucault.models.magnetometer import Magnetometer, halves, heading_error
from foucault.result import Result

ROTATION = "mag.rotation"  # What ``--drop`` calls the rotation between magnetometer and IMU.
LITTLE = 1e-9  # What is lost below this is rounding [rad].

TURNING, WARMING = np.pi / 2, 10.0
"""Turning [rad/s] and warming [K] whose cost to a heading is said."""


def losses(mag: Magnetometer, receiver: Receiver, dip: float, level: float) -> dict[str, float]:
    """Return what a receiver has no place for, and what that costs a level heading, rms [rad].

    `dip`: of the field, positive where it points down [rad]; `level`: level part of it [T].
    """
    if receiver.before or receiver.name == "matlab":
        kept, out = np.eye(3), {}
    else:
        inner, outer, _ = halves(mag.matrix)
        kept = (inner if receiver.name == "px4" else outer) @ mag.matrix
        out = {ROTATION: heading_error(kept, dip)}
    if not receiver.before:
        warm = float(np.linalg.norm(mag.bias_temperature)) * WARMING / level
        out |= {"mag.delay": abs(mag.delay) * TURNING, "mag.bias_temperature": warm}
    return {name: size for name, size in out.items() if size > LITTLE}


CONDITIONS = {
    ROTATION: "",
    "mag.delay": f" while it turns at {np.degrees(TURNING):.0f} deg/s",
    "mag.bias_temperature": f" for every {WARMING:g} K",
}
"""What is lost -> when its cost is what it is."""


def knowledge(
    result: Result, receiver: Receiver, *, axes: str | None, drop: Iterable[str], force: bool
) -> tuple[Known, list[str]]:
    """Return what the file of a receiver is made of, and what it says of that.

    `axes` or None: those of the receiver's readings; `drop`: what may be lost; `force`: take a
    result that is not usable, and lose what has no place.
    """
    usable(result, force)
    axes = axes or receiver.axes
    known_axes(axes)
    mag = Magnetometer.from_coefficients(result.coefficients)
    said = result.diagnostics.get("field") or {}
    dip = said.get("dip") or (said.get("world") or {}).get("dip") or np.radians(60.0)
    size = float(said.get("intensity") or 48e-6)
    lost = losses(mag, receiver, dip, size * float(np.cos(dip)))
    words = {name: f"{name} ({np.degrees(x):.2g} deg{CONDITIONS[name]})"
             for name, x in lost.items()}  # fmt: skip
    groups = (*CONDITIONS, "noise")
    for name in drop:
        if name not in groups:
            hint = suggestion(name, groups)
            raise error("export.mag_drop", given=name, hint=hint, allowed=", ".join(CONDITIONS))
    kept = [name for name in lost if name not in (*drop,)]
    if kept and not force:
        raise error("export.mag_loses", receiver=receiver.name,
                    terms=", ".join(words[name] for name in kept),
                    options=" ".join(f"--drop {name}" for name in kept))  # fmt: skip
    C = AXES[axes]
    turned = Magnetometer(C @ mag.matrix @ C.T, C @ mag.bias, mag.delay, C @ mag.bias_temperature)
    noise = float(said.get("noise_of_a_reading") or 0.0)
    iron = [result.coefficients.names.index(f"mag.bias.{a}") for a in "xyz"]
    cov = result.coefficients.cov
    of_iron = np.zeros((3, 3)) if cov is None else cov[np.ix_(iron, iron)]
    A = np.linalg.inv(mag.matrix)
    whole = C @ A @ (of_iron + noise**2 * np.eye(3)) @ A.T @ C.T
    lines = about(result, f"Axes: {axes}", "Signs: hard iron is read minus true.")
    lines += [
        f"LOST, because it was dropped on request: {words[name]}, rms of a level heading."
        for name in lost
    ]
    if receiver.name == "px4" and ROTATION in lost:
        lines += _askew(halves(turned.matrix)[2])
    if receiver.before:
        lines += ["The calibration is not in this file: give the receiver readings that foucault",
                  "apply has corrected."]  # fmt: skip
    return Known(ImuModel(), mag=MagKnown(turned, size, whole)), lines


def _askew(R: FloatArray) -> list[str]:
    """Say how a sensor sits on its board, for the releases that have angles for that."""
    roll, pitch = np.arctan2(R[2, 1], R[2, 2]), -np.arcsin(np.clip(R[2, 0], -1.0, 1.0))
    yaw = np.arctan2(R[1, 0], R[0, 0])
    angles = ", ".join(f"{name} {np.degrees(x):.3f}" for name, x in
                       zip(("ROLL", "PITCH", "YAW"), (roll, pitch, yaw), strict=True))  # fmt: skip
    return [
        "An external magnetometer has a place for the rotation in newer releases: CAL_MAG0_ROT 100 "
        f"and, in degrees, {angles}; the rotation is not lost then."
    ]
