"""IMUs on one plate: the coefficients of what ties them to the first, and of their own errors.

`b` is the first IMU, the master, `c` another one: ``x_c = C_cb x_b``. The lever arm points from
the accelerometers of b to those of c, in axes of b; what c stamps t holds at ``t + tau + kappa (t -
t_mid)`` of the clock of b. Errors are those against b.
"""

from __future__ import annotations

from dataclasses import replace

from foucault.coefficients import Coefficient, Layout, coefficients_of
from foucault.models import imu, size_effect
from foucault.tables import AXES

ORDINALS = ("second", "third", "fourth")
"""What the slaves are called, in their order."""

GYRO = tuple(f"gyro.misalignment.{a}{b}" if a != b else f"gyro.scale.{a}"
             for a in AXES for b in AXES)  # fmt: skip
LOWER = ("accel.scale.x", "accel.misalignment.yx", "accel.scale.y", "accel.misalignment.zx",
         "accel.misalignment.zy", "accel.scale.z")  # fmt: skip
SENSORS = (
    *(f"gyro.bias.{a}" for a in AXES), *(f"accel.bias.{a}" for a in AXES), *GYRO, *LOWER,
    "accel.delay", *(f"gyro.g_sensitivity.{a}{b}" for a in AXES for b in AXES),
)  # fmt: skip
"""Errors of a slave, in the order of their columns."""


def _sensors(who: str) -> tuple[Coefficient, ...]:
    known = Layout((*imu.LAYOUT.coefficients, *size_effect.OFFSET.coefficients))
    own = known.subset(SENSORS).coefficients
    if who == ORDINALS[0]:
        return own
    return tuple(replace(c, name=f"{who}.{c.name}", meaning=f"{who} IMU: {c.meaning}")
                 for c in own)  # fmt: skip


def layout_of(slaves: int) -> Layout:
    """Return the coefficients of so many `slaves` [1], in the order of their columns."""
    return Layout(
        tuple(
            c
            for who in ORDINALS[:slaves]
            for c in (*coefficients_of("tie", who=who), *_sensors(who))
        )
    )


_OWN = frozenset(SENSORS)

LAYOUT = Layout((
    *(c for c in imu.LAYOUT.coefficients if c.name in _OWN), *size_effect.OFFSET.coefficients,
    *(c for c in layout_of(len(ORDINALS)).coefficients if c.name not in _OWN),
))  # fmt: skip
"""What a campaign may name: errors of the second IMU as of any, then what ties all, and errors of
the others."""
