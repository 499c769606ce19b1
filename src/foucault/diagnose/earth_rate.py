"""Hold the Earth's rate that a session saw against the one that was assumed."""

from __future__ import annotations

import numpy as np

from foucault.errors import Finding, finding
from foucault.estimate.chi_square import chi_square_limits
from foucault.estimate.earth_seen import EarthSeen
from foucault.models.earth import EARTH_RATE
from foucault.result import Check


def no_latitude() -> Finding:
    """Say what the Earth's rotation adds to the gyro bias where the latitude is unknown."""
    sd = np.degrees(EARTH_RATE / np.sqrt(3)) * 3600
    return finding("session.no_latitude", sd=f"{sd:.0f}")


def earth_checks(earth: EarthSeen | None, false_alarm: float) -> list[Check]:
    """Return the check of the Earth's rate by the times and at the latitude of a log.

    `earth`: what the session says of it, None makes no check; `false_alarm`: probability that it
    fails by chance [1].
    """
    if earth is None:
        return []
    limit = chi_square_limits(2, 2 * false_alarm)[1]
    fine = earth.square <= limit
    faster, sd, _ = earth.faster
    words = f"By the times of the log the Earth turns {1 + faster:.5f} +- {sd:.1g} times its rate"
    if not fine:
        words += f": {causes(earth, limit)}"
    return [Check("Earth's rate", earth.square, None, limit, fine, words + ".")]


def put_off(checks: list[Check]) -> str:
    """Say what puts coefficients off where the check of the Earth's rate failed, else nothing."""
    if all(check.passed for check in checks):
        return ""
    return "the times or the latitude put it off, see the check of the Earth's rate"


def earth_findings(earth: EarthSeen | None, false_alarm: float) -> list[Finding]:
    """Say what explains another rate of the Earth than there is.

    `earth` or None: what the session says of it; `false_alarm`: probability that it is said by
    chance [1].
    """
    if earth is None or all(check.passed for check in earth_checks(earth, false_alarm)):
        return []
    faster, sd, _ = earth.faster
    words = causes(earth, chi_square_limits(2, 2 * false_alarm)[1])
    return [finding("session.earth_rate", rate=f"{1 + faster:.5f}", sd=f"{sd:.1g}",
                    causes=words)]  # fmt: skip


def causes(earth: EarthSeen, limit: float) -> str:
    """Say what explains another rate of the Earth, the likelier first.

    `limit`: a cause explains it that leaves no more than this squared normalised difference [1].
    """
    (faster, sd, left), (north, north_sd, remains) = earth.faster, earth.farther_north
    mirrored = earth.left_by(np.array([0.0, -2.0 * np.sin(earth.latitude)]))
    some = [
        (left, f"the times of the log run {100 * abs(faster):.2g} % (+- {100 * sd:.1g}) "
               f"{'slow' if faster > 0 else 'fast'}"),
        (remains, f"the latitude is {np.degrees(north):+.2g} deg (+- {np.degrees(north_sd):.1g}) "
                  "off"),
    ]  # fmt: skip
    if mirrored <= limit:  # far off, and yet without anything that was fitted
        return "the latitude has the wrong sign"
    named = [words for rest, words in sorted(some) if rest <= limit]
    return "; or ".join(named) or (
        "neither times nor latitude explain it alone: the gyros may sense gravity"
    )
