"""Whether alignments of one rest agree with one another, and a filter with its own readings.

A steady horizontal velocity adds to the specific force what a tilt adds, and to the rate of the
level what a gyro bias adds: no reading at rest shows it as motion. Methods that take the velocity
for zero are misled by it differently, and so they are by a vehicle that creeps, by a bias beyond
what was declared, and in two positions by triads that are both mirrored. So methods that differ
by more than their covariances allow, or innovations larger than predicted, tell that something is
wrong, not what.

Methods share their readings; the covariance of their difference is at most about the sum of both,
which is taken. Innovations that are too small are no fault: white noise counts twice in the
velocity of a quiet rest, as what is measured of the disturbance holds it too.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from foucault.diagnose.alignment.input import FALSE_ALARM
from foucault.errors import Finding, finding
from foucault.estimate.chi_square import chi_square_limits
from foucault.models import rotation
from foucault.navigate.align import Alignment
from foucault.units import plain

ALIKE = 1e-5
"""Methods that differ by less agree: rounding, and terms of second order [rad]."""

WORDS = {
    "inertial_frame": "inertial frame",
    "kalman": "Kalman",
    "two_vector": "two vectors",
    "two_position": "two positions",
}


def disagreement(found: Sequence[Alignment], *, swayed: bool = False) -> tuple[Finding, ...]:
    """Tell which two methods differ by most, if by more than their covariances allow.

    `found`: of one window, or of rests that end together; `swayed`: whether the body swayed or
    turned, the mean of two vectors is then not that of the end.
    """
    used = [a for a in found if not (swayed and a.method == "two_vector")]
    worst, words = chi_square_limits(3, 2 * FALSE_ALARM)[1], None
    for one, other in combinations(used, 2):
        phi = rotation.log(other.C_nb @ one.C_nb.T)
        cov = one.cov + other.cov + ALIKE**2 * np.eye(3)
        size = float(phi @ np.linalg.solve(cov, phi))
        if size > worst:
            worst = size
            sds = np.abs(phi) / np.sqrt(np.diag(cov))
            about = int(np.argmax(sds))
            words = {
                "one": WORDS[one.method], "other": WORDS[other.method],
                "angle": plain(float(np.degrees(abs(phi[about]))), 3),
                "axis": ("east", "north", "up")[about],
                "sd": plain(float(np.degrees(np.sqrt(cov[about, about]))), 2),
            }  # fmt: skip
    return () if words is None else (finding("alignment.disagree", **words),)


def innovations(found: Sequence[Alignment]) -> tuple[Finding, ...]:
    """Tell which filters met velocities that they had not predicted.

    `found`: of any methods, those without innovations are passed over.
    """
    told = []
    for one in found:
        if one.nis is None or one.dof is None or not one.dof.sum():
            continue
        dof = int(one.dof.sum())
        ratio, most = float(one.nis.sum()) / dof, chi_square_limits(dof, 2 * FALSE_ALARM)[1] / dof
        if ratio > most:
            told.append(
                finding("alignment.innovations", method=WORDS[one.method], given=plain(ratio, 3),
                        most=plain(most, 3))
            )  # fmt: skip
    return tuple(told)
