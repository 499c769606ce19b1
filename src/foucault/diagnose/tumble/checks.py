"""Judge a tumble: do noise, model and motion explain its readings?

The white residuals r of the filter are independent and of unit variance where noise, model and
motion are what was said. What the fit absorbs of them is known, so that the sum of any of their
squares is chi-square with ``sum(1 - leverage)`` degrees of freedom: over the whole log, axis by
axis, and stretch by stretch, which shows where a slip or a knock happened. Sums of residuals over
longer parts show what is too slow to be seen in neighbours: noise of the gyros, above all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.checks import hardly, status_check
from foucault.diagnose.earth_rate import earth_findings, known_checks
from foucault.diagnose.words import check
from foucault.errors import Finding, Status, finding
from foucault.estimate.chi_square import FALSE_ALARM, chi_square_limits
from foucault.estimate.earth_seen import EarthSeen
from foucault.estimate.tumble.fit import STATES, Fit, Prior, Tumble
from foucault.models.cluster import CONSTANTS, angles_of
from foucault.models.rotation import log
from foucault.result import Check
from foucault.tables import AXES

STRETCHES = 12
"""The log is tested in so many stretches [1]."""

PARTS = 60
"""Slow errors are sought in the sums over so many parts of the log [1]."""

EACH = FALSE_ALARM / 10
"""False-alarm rate of each of ten tests, so that all together keep 1 % [1]."""

ALIKE = {
    "gyro.torquer_scale": "a wrong clock, or unit of the command,",
    "accel.scale": "a wrong gravity or unit",
}
"""What puts the scale factors of a triad off alike."""

LOOSE = np.radians(0.5)
"""An azimuth less certain than this bends what depends on it beyond the linear [rad]."""


@dataclass(frozen=True)
class Evidence:
    """Everything the checks look at."""

    tumble: Tumble
    prior: Prior  # what was known beforehand
    fit: Fit  # the solution, with its white rows
    coefficients: CoefficientVector  # the same, named [SI]
    # (3,) outer, middle and inner angle where the start was believed to be [rad]
    believed: FloatArray
    # whether noise that is not white was declared: residuals may then be larger and related
    slow: bool = False
    advice: str = ""  # how a published filter ended, in its own words
    earth: EarthSeen | None = None  # what the session says of the Earth's rate

    @property
    def residuals(self) -> FloatArray:
        """White residuals at the solution, shape (blocks, 3) [1]."""
        return self.fit.rows[..., -1]

    @property
    def delay(self) -> float:
        """Delay of the readings: estimated, or what the test of a held one found [s]."""
        found = self.fit.start.delay if self.prior.sd[-1] > 0 else self.fit.late[0]
        return found - self.prior.mean.delay  # whole intervals were put back

    @cached_property
    def leverage(self) -> FloatArray:
        """Share of each residual that the fit absorbs, shape (blocks, 3) [1]."""
        return np.asarray(np.sum((self._slopes @ self._half) ** 2, axis=-1))

    @property
    def _slopes(self) -> FloatArray:
        return self.fit.rows[..., :STATES]

    @cached_property
    def _half(self) -> FloatArray:
        """A square root of the covariance at the start, in units of the prior, (46, k)."""
        unit = self.prior.unit
        values, vectors = np.linalg.eigh(self.fit.start_cov / np.outer(unit, unit))
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))

    def sums(self, parts: int) -> tuple[FloatArray, FloatArray]:
        """Return sums of the residuals over parts of the log, and their covariance.

        `parts`: into so many the log is cut [1]. Returns `sums` (3 k,): over the square root of
        the number of terms [1]; `cov` (3 k, 3 k): what it is where noise and model are right [1].
        """
        pieces = [p for p in np.array_split(np.arange(len(self.residuals)), parts) if len(p)]
        total = [np.sum(self.residuals[p], axis=0) / np.sqrt(len(p)) for p in pieces]
        slopes = [np.sum(self._slopes[p], axis=0) / np.sqrt(len(p)) for p in pieces]
        absorbed = np.concatenate(slopes) @ self._half
        return np.concatenate(total), np.eye(len(absorbed)) - absorbed @ absorbed.T


def checks(e: Evidence) -> tuple[Check, ...]:
    """Return every test of the result; a failed one carries its reason."""
    ended = status_check(e.fit.status, ())
    if e.advice:
        ended = replace(ended, sentence=e.advice)
    if e.fit.status is not Status.CONVERGED:
        return (ended,)  # there is nothing to be judged
    out = [ended, *_scatter(e), _stretches(e)]
    known = CoefficientVector(CONSTANTS, e.fit.start.constants, e.fit.start_cov[3:45, 3:45],
                              prior_sd=e.prior.sd[3:45])  # fmt: skip
    out += known_checks(e.earth, known, e.prior.mean.constants, ALIKE, EACH)
    out += [_start(e), _seen(e)]
    if not e.slow:  # slow noise looks like all of these
        out += [_neighbours(e), _slow(e), _delay(e)]
    return tuple(out)


def _square(e: Evidence, part: FloatArray, leverage: FloatArray, tests: int) -> list[float]:
    """Return the sum of squares of some residuals, its limits and degrees of freedom."""
    dof = max(float(np.sum(1 - leverage)), 1.0)
    low, high = chi_square_limits(dof, EACH, tests)
    return [float(np.sum(part**2)), low, float("inf") if e.slow else high, dof]


def whole_square(e: Evidence) -> list[float]:
    """Return the chi-square of all residuals, its limits, and its degrees of freedom."""
    return _square(e, e.residuals, e.leverage, 1)


def _scatter(e: Evidence) -> list[Check]:
    """Test the residuals as a whole, and axis by axis."""
    found = [whole_square(e)]
    found += [_square(e, e.residuals[:, k], e.leverage[:, k], 3) for k in range(3)]
    out = []
    for axis, (value, low, high, dof) in zip(("", *AXES), found, strict=True):
        given = {"axis": axis, "ratio": np.sqrt(value / dof)}
        key, name = "tumble readings", "residuals"
        if axis:
            key, name = "tumble axis", f"accelerometer {axis}"
        out.append(check(key, name, value, low, high if np.isfinite(high) else None, given))
    return out


def _stretches(e: Evidence) -> Check:
    """Test the log stretch by stretch; the sentence names the worst one."""
    parts = [p for p in np.array_split(np.arange(len(e.residuals)), STRETCHES) if len(p)]
    found = [_square(e, e.residuals[p], e.leverage[p], len(parts)) for p in parts]
    outside = float(sum(not low <= value <= high for value, low, high, _ in found))
    ratio = [np.sqrt(value / max(dof, 1e-9)) for value, _, _, dof in found]
    worst = int(np.argmax(np.abs(np.log(np.maximum(ratio, 1e-9)))))
    begin, end = (float(e.fit.time[parts[worst][k]]) for k in (0, -1))
    given = {"parts": len(parts), "begin": begin, "end": end, "ratio": ratio[worst]}
    return check("stretches", "stretches", outside, None, 0.0, given)


def _neighbours(e: Evidence) -> Check:
    """Test whether neighbouring residuals are related: a motion that the model lacks."""
    from scipy.special import ndtri

    white = e.residuals / np.sqrt(np.mean(e.residuals**2, axis=0))
    n = max(len(white) - 1, 1)
    related = float(np.sum(white[1:] * white[:-1]) / np.sqrt(3.0 * n))
    limit = float(ndtri(1 - EACH / 2))
    given = {"correlation": related / np.sqrt(3.0 * n)}
    return check("neighbours", "neighbours", related, -limit, limit, given)


def _slow(e: Evidence) -> Check:
    """Test sums over parts of the log: noise of the gyros, slow errors."""
    sums, cov = e.sums(min(PARTS, len(e.residuals) // 4 + 1))
    value, dof = float(sums @ sums), max(float(np.trace(cov)), 1.0)
    low, high = chi_square_limits(dof, EACH)
    return check("slow errors", "slow errors", value, low, high, {"ratio": np.sqrt(value / dof)})


def _start(e: Evidence) -> Check:
    miss, _ = e.prior.rows(e.fit.start)
    value = float(np.sum(miss[:3] ** 2))
    limit = chi_square_limits(3, 2 * EACH)[1]  # one-sided
    away = float(np.degrees(np.linalg.norm(log(e.fit.start.C_np @ e.prior.mean.C_np.T))))
    return check("start", "start", value, None, limit, {"away": away})


def _seen(e: Evidence) -> Check:
    """Count the coefficients that the motion shows: a result of priors is none."""
    unseen, count = len(hardly(e.coefficients.chosen(CONSTANTS.names))), len(CONSTANTS)
    given = {"shown": count - unseen, "count": count}
    return check("seen by the motion", "seen", float(unseen), None, float(count // 2), given)


def _delay(e: Evidence) -> Check:
    """Test the delay that was held; one that is estimated has no test."""
    from scipy.special import ndtri

    late, sd = e.fit.late
    z, limit = (late / sd if sd > 0 else 0.0), float(ndtri(1 - EACH / 2))
    key = "delay" if 0 < sd < np.inf else "delay estimated" if sd == 0 else "delay not seen"
    given = {"ms": 1e3 * (late + e.prior.mean.delay), "sds": abs(z)}
    return check(key, "delay", z, -limit, limit, given)


def findings(e: Evidence) -> list[Finding]:
    """Return what the user should know: delay, start, a singular attitude, poor condition."""
    out, (late, sd) = earth_findings(e.earth, 2 * EACH), e.fit.late
    if e.fit.status is Status.CONVERGED and not e.slow and not _delay(e).passed:
        out.append(
            finding(
                "tumble.delay", given=f"{1e3 * (late + e.prior.mean.delay):.3g}",
                sd=f"{1e3 * sd:.2g}", believed=f"{1e3 * e.prior.mean.delay:.3g}",
            )
        )  # fmt: skip
    phi = log(e.fit.start.C_np @ e.prior.mean.C_np.T)
    sds = float(np.linalg.norm(phi / e.prior.sd[:3]))
    if sds > 4:
        outer, middle, inner = np.degrees(angles_of(e.fit.start.C_np.T))
        out.append(
            finding(
                "tumble.start", angle=f"{np.degrees(np.linalg.norm(phi)):.3g}", sds=f"{sds:.1f}",
                outer=f"{outer:.2f}", middle=f"{middle:.2f}", inner=f"{inner:.2f}",
            )
        )  # fmt: skip
    middle = float(angles_of(e.fit.C_np.T)[1])
    if abs(np.cos(middle)) < 0.02:
        out.append(finding("tumble.singular", given=f"{np.degrees(middle):.2f}"))
    if e.fit.orthogonal:
        out.append(finding("tumble.condition"))
    return out + _hardly_seen(e)


def _hardly_seen(e: Evidence) -> list[Finding]:
    out, names = [], hardly(e.coefficients.chosen(CONSTANTS.names))
    if names:
        more = f" and {len(names) - 8} more" if len(names) > 8 else ""
        out.append(finding("tumble.unseen", count=len(names), names=", ".join(names[:8]) + more))
    C_np = e.fit.C_np
    azimuth = float(np.sqrt((C_np @ e.fit.cov[:3, :3] @ C_np.T)[2, 2]))
    if azimuth > LOOSE:
        out.append(finding("tumble.azimuth", given=f"{np.degrees(azimuth):.2f}"))
    return out
