"""Judge a systematic calibration: do noise, model and sequence explain what was seen at rest?

Innovations of a filter are independent, with the variance it says. Where the instrument stands
stiller than `velocity_sd` and `position_sd` allow they are smaller, and that is no fault: only
their upper limit is tested. The same holds of the velocity at the end of every rest. What a session
tells of some coefficients by itself, whatever was known of them, is the difference of information
after it and before it, ``P^-1 - P_0^-1`` of their part of the covariances.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.checks import HARDLY, hardly, status_check
from foucault.diagnose.earth_rate import earth_findings, known_checks
from foucault.diagnose.information import largest_shares, terms
from foucault.diagnose.noise_at_rest import NoiseAtRest
from foucault.diagnose.systematic.legs import Legs
from foucault.diagnose.words import check
from foucault.errors import Finding, Status, error, finding
from foucault.estimate.chi_square import FALSE_ALARM, chi_square_limits
from foucault.estimate.earth_seen import EarthSeen
from foucault.estimate.ins_filter import FilterRun
from foucault.models.deflection import DeflectionModel
from foucault.navigate.increments import Increments
from foucault.result import Check
from foucault.tables import AXES

EACH = FALSE_ALARM / 8
"""False-alarm rate of each of eight tests, so that all together keep 1 % [1]."""

ALIKE = {
    "gyro.scale": "a wrong clock or unit",
    "accel.scale": "a wrong clock (of increments), unit or gravity",
}
"""What puts the scale factors of a triad off alike."""

LIKE = ("accel.asymmetry", "accel.quadratic")
"""What looks the same where every axis is up, down or level: ``g |f|`` and ``f^2`` are equal."""

WORTH = np.radians(3.0 / 3600.0) / 9.80665
"""A combination of deflections counts as seen if the session alone tells it better than this, the
usual size of one [rad/(m/s^2)]."""

WANTED = {
    "gyro.bias": "rests of two minutes or more with each axis of the body up, level east and north",
    "gyro.scale": "quarter turns about each axis of the body, both ways, with rests between them",
    "gyro.misalignment": "quarter turns about each axis of the body, with either of the others up",
    "gyro.asymmetry": "turns about each axis of the body both ways, unlike in number",
    "accel.bias": "rests with each axis of the body up and down",
    "accel.scale": "rests with each axis of the body up and down",
    "accel.misalignment": "rests with each axis of the body up and down",
    "accel.asymmetry": "rests with each axis of the body up, down and level",
    "accel.quadratic": "rests with each axis of the body up, down and slanting, such as at 45 deg",
    "accel.lever": "turns about each axis of the body at 10 deg/s or more",
    "accel.delay": "turns about level axes at 10 deg/s or more",
    "deflection": "spins of ten turns about a level axis in six poses, three of them slanting",
}
"""Group of coefficients -> what shows them."""


@dataclass(frozen=True)
class Evidence:
    """Everything the checks look at."""

    increments: Increments  # the session as measured
    rests: tuple[tuple[int, int], ...]  # first and last row of each rest that was used [1]
    run: FilterRun  # the last pass of the filter
    # the states that are coefficients, with covariance and prior [SI]
    coefficients: CoefficientVector
    mean: FloatArray  # (p,) mean of their prior [SI]
    usual: FloatArray  # (p,) standard deviation of each where the user says nothing [SI]
    legs: Legs  # velocities at the end of every rest
    status: Status  # how the passes ended
    noise: NoiseAtRest  # what the readings at rest show of the noise
    earth: EarthSeen | None = None  # what the session says of the Earth's rate


def checks(e: Evidence) -> tuple[Check, ...]:
    """Return every test of the result; a failed one carries its reason."""
    return (
        status_check(e.status, ()), e.noise.check, _innovations(e), _rests(e), _velocities(e),
        *known_checks(e.earth, e.coefficients, e.mean, ALIKE, EACH), _seen(e),
    )  # fmt: skip


def _innovations(e: Evidence) -> Check:
    total, dof = float(e.run.nis.sum()), int(e.run.measured.sum())
    limit = chi_square_limits(dof, 2 * EACH)[1]
    key = "innovations, still" if total < dof / 2 else "innovations"
    given = {"ratio": np.sqrt(total / dof)}
    return check(key, "innovations", total / dof, None, limit / dof, given)


def squares(e: Evidence) -> tuple[FloatArray, FloatArray]:
    """Return the sum of squared normalised innovations of each rest, and their number."""
    time = e.increments.time
    total, count = np.zeros((2, len(e.rests)))
    for k, (a, b) in enumerate(e.rests):
        rows = (e.run.time >= time[a] - 1e-9) & (e.run.time <= time[b] + 1e-9)
        total[k], count[k] = e.run.nis[rows].sum(), e.run.measured[rows].sum()
    return total, count


def _rests(e: Evidence) -> Check:
    total, count = squares(e)
    used = np.flatnonzero(count)
    limit = np.array([chi_square_limits(count[k], 2 * EACH, len(used))[1] for k in used])
    share = total[used] / limit
    worst = int(used[np.argmax(share)])
    begin, end = (float(e.increments.time[row]) for row in e.rests[worst])
    given = {
        "out": np.count_nonzero(share > 1.0), "count": len(used), "rest": worst + 1,
        "begin": begin, "end": end,
    }  # fmt: skip
    return check("scatter of rests", "rests", float(share.max()), None, 1.0, given)


def _velocities(e: Evidence) -> Check:
    from scipy.special import ndtri

    z = np.abs(e.legs.after) / e.legs.sd
    limit = float(ndtri((1 - EACH) ** (1 / z.size) / 2 + 0.5))
    worst, axis = (int(k) for k in np.unravel_index(np.argmax(z), z.shape))
    given = {
        "run": "through each rest" if e.legs.anew else "from rest to rest",
        "axis": ("east", "north", "up")[axis], "rest": int(e.legs.rest[worst]) + 1,
        "time": e.legs.end[worst],
    }  # fmt: skip
    return check("velocities", "velocities", float(z.max()), None, limit, given)


def only_sums(coefficients: CoefficientVector) -> list[str]:
    """Return the axes of which asymmetry and quadratic term are seen as a sum alone.

    `coefficients`: with covariance, and prior standard deviations that were not correlated [SI].
    """
    assert coefficients.cov is not None
    out = []
    for axis in AXES:
        names = [f"{group}.{axis}" for group in LIKE]
        if all(name in coefficients.layout for name in names):
            at = [coefficients.layout.index(name) for name in names]
            unit = coefficients.prior_sd[at]
            some, none = np.linalg.eigvalsh(coefficients.cov[np.ix_(at, at)] / np.outer(unit, unit))
            if some < HARDLY**2 < none:
                out.append(axis)
    return out


@dataclass(frozen=True)
class Unseen:
    """What the session does not show."""

    names: list[str]  # coefficients that are hardly better known than is usual
    sums: list[str]  # axes of which asymmetry and quadratic term are seen as a sum alone
    # coefficients hardly better known than before, which the user knows better than is usual
    known: list[str]

    @classmethod
    def of(cls, c: CoefficientVector, usual: FloatArray) -> Unseen:
        """Sort what is hardly seen.

        `c`: with covariance and prior [SI]; `usual` (p,): standard deviation of each where the
        user says nothing [SI].
        """
        told = c.prior_sd < usual * (1.0 - 1e-9)
        better = {name for name, yes in zip(c.names, told, strict=True) if yes}
        names = hardly(c)
        pairs = {axis: [f"{group}.{axis}" for group in LIKE] for axis in only_sums(c)}
        # What is known of the one tells the other.
        sums = [a for a, pair in pairs.items() if not better & {*pair} and {*names} & {*pair}]
        summed = {name for axis in sums for name in pairs[axis]}
        return cls(
            [n for n in names if n not in better | summed], sums, [n for n in names if n in better]
        )


def _seen(e: Evidence) -> Check:
    unseen = Unseen.of(e.coefficients, e.usual)
    key, sums = "seen by the session", _summed(unseen.sums) if unseen.sums else ""
    if unseen.names and sums:
        sums = f" {sums}"
    elif sums:
        key = "seen as sums"
    given = {"names": ", ".join(unseen.names), "sums": sums}
    count = float(len(unseen.names) + len(unseen.sums))
    return check(key, "seen", count, None, 0.0, given)


def _summed(axes: Sequence[str]) -> str:
    return (
        f"Of asymmetry and quadratic term of the accelerometers {', '.join(axes)} the session "
        "tells only the sum, accel.asymmetry + g accel.quadratic: in its rests the two look alike."
    )


def findings(e: Evidence) -> list[Finding]:
    """Return what the user should know: another Earth, and what the sequence does not show."""
    return earth_findings(e.earth, 2 * EACH) + unseen_of(e.coefficients, e.usual)


def unseen_of(coefficients: CoefficientVector, usual: FloatArray) -> list[Finding]:
    """Say which coefficients are hardly better known than before, and what would show them.

    `coefficients`: with covariance and prior [SI]; `usual` (p,): standard deviation of each where
    the user says nothing [SI].
    """
    unseen, out = Unseen.of(coefficients, usual), []
    if unseen.names:
        groups = [g for g in WANTED if any(n == g or n.startswith(f"{g}.") for n in unseen.names)]
        wanted = "; ".join(dict.fromkeys(WANTED[g] for g in groups))
        out.append(finding("systematic.unseen", names=", ".join(unseen.names), wanted=wanted))
    if unseen.sums:
        out.append(finding("systematic.only_sum", sentence=_summed(unseen.sums),
                           wanted=WANTED["accel.quadratic"]))  # fmt: skip
    if unseen.known:
        out.append(finding("systematic.only_prior", names=", ".join(unseen.known)))
    return out


def told_of(coefficients: CoefficientVector, names: Sequence[str]) -> tuple[int, list[str]]:
    """Return how many combinations of deflections a session tells, and the others in words.

    `coefficients`: with covariance, and prior standard deviations that were not correlated [SI].
    """
    part = [coefficients.layout.index(name) for name in names]
    assert coefficients.cov is not None
    unit = coefficients.prior_sd[part]
    after = coefficients.cov[np.ix_(part, part)] / np.outer(unit, unit)
    # Of the session alone, in units of WORTH.
    information = (np.linalg.inv(after) - np.eye(len(part))) * WORTH**2 / np.outer(unit, unit)
    values, vectors = np.linalg.eigh((information + information.T) / 2)
    layout = coefficients.layout.subset(names)
    blind = [terms(largest_shares(layout, v), dots=True) for v in vectors[:, values < 1.0].T]
    return int(np.count_nonzero(values >= 1.0)), blind


def require_deflection(
    coefficients: CoefficientVector, model: DeflectionModel, *, known: bool
) -> list[Finding]:
    """Refuse a model of deflection that the session cannot see.

    `coefficients`: the result [SI]; `known`: whether the user has said what is known of its
    parameters beforehand: then it is only said.
    """
    rank, blind = told_of(coefficients, model.layout.names)
    if not blind:
        return []
    words = {
        "model": model.name, "rank": rank, "count": len(model),
        "blind": "; ".join(blind[:6]) + ("; ..." if len(blind) > 6 else ""),
        "wanted": WANTED["deflection"],
    }  # fmt: skip
    if not known:
        raise error("systematic.deflection_unseen", **words)
    return [finding("systematic.deflection_prior", **words)]
