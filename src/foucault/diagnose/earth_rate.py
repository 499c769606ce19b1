"""Hold what a session found against the Earth's rate, and against what was known before."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.checks import SEEN, prior_check
from foucault.diagnose.words import check
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
    given = _said(earth, limit)
    return [check("Earth's rate", "Earth's rate", earth.square, None, limit, given)]


def _said(earth: EarthSeen, limit: float) -> dict[str, str]:
    faster, sd, _ = earth.faster
    return {"rate": f"{1 + faster:.5f}", "sd": f"{sd:.1g}", "causes": _causes(earth, limit)}


def known_checks(
    earth: EarthSeen | None, c: CoefficientVector, mean: FloatArray, alike: Mapping[str, str],
    false_alarm: float,
) -> list[Check]:  # fmt: skip
    """Return the checks of the Earth's rate and of what was known before.

    No instrument is off alike in the three coefficients of a group. An estimate x lies between what
    the data say and the mean m of the prior, and the surer the prior, the nearer to m, however far
    off the data are: the difference x - m has the variance ``sd_prior^2 - sd^2``, whatever the
    share of the prior is.

    `earth` or None: what the session says of the Earth's rate; `c`: the estimate, with covariance,
    and the standard deviations of its prior [SI]; `mean` (k,): mean of the prior [SI]; `alike`:
    group of three coefficients -> what puts all of them off alike; `false_alarm`: probability that
    each test of a group fails by chance [1].
    """
    from scipy.special import ndtri

    out, cause = earth_checks(earth, 2 * false_alarm), ""
    if not all(one.passed for one in out):
        cause = "the times or the latitude put it off, see the check of the Earth's rate"
    out.append(prior_check(c, (mean - c.values) / c.prior_sd, cause=cause))
    share = np.maximum(1.0 - (c.sd / c.prior_sd) ** 2, SEEN)
    miss, limit = (c.values - mean) / (c.prior_sd * np.sqrt(share)), -float(ndtri(false_alarm / 2))
    for group, why in alike.items():
        at = c.layout.group(group)
        z = float(miss[at].sum() / np.sqrt(len(at)))
        given = {"group": group, "ppm": 1e6 * c.values[at].mean(), "off": abs(z), "cause": why}
        out.append(check("off alike", f"{group} alike", z, -limit, limit, given))
    return out


def earth_findings(earth: EarthSeen | None, false_alarm: float) -> list[Finding]:
    """Say what explains another rate of the Earth than there is.

    `earth` or None: what the session says of it; `false_alarm`: probability that it is said by
    chance [1].
    """
    if earth is None or all(one.passed for one in earth_checks(earth, false_alarm)):
        return []
    limit = chi_square_limits(2, 2 * false_alarm)[1]
    return [finding("session.earth_rate", **_said(earth, limit))]


def _causes(earth: EarthSeen, limit: float) -> str:
    """Say what explains it, the likelier first: what leaves a square of no more than `limit`."""
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
