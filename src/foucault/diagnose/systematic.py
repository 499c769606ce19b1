"""Rests, turns and spins of a systematic calibration: found, judged and reported.

What a calibration does to the velocity of every rest: navigated there with it and without.

From the end of each rest the instrument is navigated through the turns that follow to the end of
the next, from the attitude that the smoothed filter has: with the calibration and without it. With
it the velocity is zero but for noise and for what is still uncertain; the standard deviation
promised is that of a run whose noise is not known. As the same readings made the calibration the
errors are a little smaller than that.

Where the filter starts every rest anew, so do these runs: what turns do to the velocity is not what
the calibration is to explain, and the velocity at the end of a rest is what it has gained there.

Judge a systematic calibration: do noise, model and sequence explain what was seen at rest?

Innovations of a filter are independent, with the variance it says. Where the instrument stands
stiller than `velocity_sd` and `position_sd` allow they are smaller, and that is no fault: only
their upper limit is tested. The same holds of the velocity at the end of every rest. What a session
tells of some coefficients by itself, whatever was known of them, is the difference of information
after it and before it, ``P^-1 - P_0^-1`` of their part of the covariances.

The tables of a systematic calibration, and what it cannot see in principle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.checks import HARDLY, check, hardly, status_check
from foucault.diagnose.noise_at_rest import NoiseAtRest
from foucault.diagnose.references import (
    BEYOND_THE_SESSION,
    earth_findings,
    known_checks,
    likelier,
    steps_unnoticed,
    wrong_gravity,
)
from foucault.errors import Finding, Status, error, finding
from foucault.estimate.systematic import SystematicModel
from foucault.infer.gauss_newton import FALSE_ALARM, chi_square_limits
from foucault.infer.information import largest_shares, terms
from foucault.infer.linear_filter import Shock, stepped
from foucault.models.deflection import DeflectionModel
from foucault.models.earth import Site
from foucault.navigate.increments import Increments
from foucault.navigate.ins_filter import EarthSeen, FilterRun, Updates, run, smooth
from foucault.navigate.strapdown import State, navigate
from foucault.result import Check
from foucault.tables import AXES

EPOCH = 10.0  # Noise is taken in so often [s].


def followed(heading_sd: float, most: float) -> Check:
    """Say whether error equations hold with a heading that is uncertain by `heading_sd` [rad].

    `most`: sd up to which they do, shape () [rad].
    """
    name = "heading of the start"
    return check(name, name, float(np.degrees(heading_sd)), None, float(np.degrees(most)))


@dataclass(frozen=True)
class Legs:
    """Navigation from rest to rest."""

    # (m,) number among the rests used of the one that each leg ends with [1]
    rest: IntArray
    # start, end: (m,) when it begins and ends [s]
    start: FloatArray
    end: FloatArray
    # before, after: (m, 3) velocity at its end without and with the calibration: east, north, up
    # [m/s]
    before: FloatArray
    after: FloatArray
    sd: FloatArray  # (m, 3) what is promised of `after` [m/s]
    # (k,) numbers among the rests used of those that the filter went through [1]
    seen: IntArray
    C_nb: FloatArray  # (k, 3, 3) attitudes at their ends [1]
    anew: bool  # whether velocities are those gained since the rest began


def legs_of(model: SystematicModel, found: FilterRun) -> Legs:
    """Navigate from each rest to the next; `found` is the last pass, made with ``keep=True``."""
    increments, rests, site, at_rest = model.increments, model.rests, model.site, model.at_rest
    assert site.latitude is not None
    seen, offset = smooth(found), site.anomaly
    ends = np.array([b for _, b in rests])
    # The last epoch of the filter in each rest; a filter may have begun after the first ones.
    epoch = np.searchsorted(found.time, increments.time[ends] + 1e-9, side="right") - 1
    there = np.flatnonzero(epoch >= 0)
    C_nb = seen.trajectory.C_nb[epoch[there]]
    rows = [increments.row_at(float(t)) for t in found.time[epoch[there]]]
    each = max(1, round(EPOCH / float(np.median(increments.dt))))
    before, after, sd = [], [], []
    recording = np.searchsorted(found.begins, epoch[there], side="right")
    legs = [k for k in range(len(rows) - 1) if recording[k] == recording[k + 1]]
    for k in legs:
        a, b = rows[k], rows[k + 1]
        state = State.at_rest(C_nb[k], site.latitude, 0.0, site.height)
        raw = navigate(increments, state, first=a, last=b, gravity_offset=offset).velocity_n
        start = max(rests[there[k + 1]][0], a) + 1
        before.append(raw[-1] - raw[start - a] if at_rest.decorrelate else raw[-1])
        P = seen.cov[epoch[there[k]]].copy()
        P[3:9], P[:, 3:9] = 0.0, 0.0  # at rest, and in its place
        epochs = np.unique([*range(a, b, each), start, b])
        updates = Updates.none(epochs)
        if at_rest.decorrelate:
            anew = np.searchsorted(epochs, start)
            updates.restart[anew] = True
            updates.position[anew] = site.latitude, 0.0, site.height
            updates.sd[anew] = np.repeat([at_rest.velocity_sd, at_rest.position_sd], 3)
        free = run(
            increments, state, found.sensors.during(int(recording[k])), updates, P, model.noise,
            first=a, estimate=seen.coefficients[epoch[there[k]]], gravity_offset=offset,
        )  # fmt: skip
        after.append(free.trajectory.velocity_n[-1])
        sd.append(free.sd[-1, 3:6])
    time = increments.time[rows]
    before_n, after_n, sd_n = (np.reshape(v, (-1, 3)) for v in (before, after, sd))
    last = np.array(legs, np.int64) + 1
    return Legs(there[last], time[last - 1], time[last], before_n, after_n, sd_n, there, C_nb,
                at_rest.decorrelate)  # fmt: skip


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

    @cached_property
    def shifts(self) -> dict[str, Shock]:
        """What biases, attitude or velocity at once would explain best; nothing if not settled."""
        if self.status is not Status.CONVERGED:
            return {}
        names = self.run.layout.names
        ways = {g: [k for k, n in enumerate(names) if n.startswith(f"{g}.")] for g in SHIFTS}
        ways |= {"attitude": [0, 1, 2], "velocity": [3, 4, 5]}
        some = {g: np.array(at) for g, at in ways.items() if at}
        times = 2 * len(self.rests)  # of what stays, a rest tells little more than once
        return stepped(*self.run.adjoint, some, times=times, false_alarm=EACH)


def checks(e: Evidence) -> tuple[Check, ...]:
    """Return every test of the result; a failed one carries its reason."""
    earth, shifts = likelier(e.earth, _shifts(e), 2 * EACH)
    return (
        status_check(e.status, ()), e.noise.check, _innovations(e), _rests(e), _velocities(e),
        *shifts, *known_checks(earth, e.coefficients, e.mean, ALIKE, EACH), _seen(e),
    )  # fmt: skip


def _innovations(e: Evidence) -> Check:
    total, dof = float(e.run.nis.sum()), int(e.run.measured.sum())
    limit = chi_square_limits(dof, 2 * EACH)[1]
    key = "innovations, still" if total < dof / 2 else "innovations"
    given = {"ratio": np.sqrt(total / dof)}
    return check(key, "innovations", total / dof, None, limit / dof, given)


SHIFTS = {
    "gyro.bias": "the biases of the gyros changed",
    "accel.bias": "the biases of the accelerometers changed",
    "attitude": "the attitude changed otherwise than the gyros say",
    "velocity": "the accelerometers read for a moment what was no motion",
}
"""What may change at once, in words."""

ALIKE_SHIFTS = 9.0  # What gains as much but for this is not told apart [1].


def _shifts(e: Evidence) -> list[Check]:
    """Ask when biases changed for good, or attitude or velocity at once, if that explains all."""
    if not e.shifts:
        return []
    order = sorted(e.shifts, key=lambda g: e.shifts[g].limit - e.shifts[g].square)
    one, total, dof = e.shifts[order[0]], float(e.run.nis.sum()), int(e.run.measured.sum())
    if one.square > one.limit and total - one.square > chi_square_limits(dof, 2 * EACH)[1]:
        return []  # something else
    alike = [g for g in order if e.shifts[g].square > one.square - ALIKE_SHIFTS]
    each = [f"{SHIFTS[g]} at {e.run.time[e.shifts[g].epoch]:.0f} s" for g in alike]
    given = {"what": " or ".join(each)}
    return [check("shifts", "shifts", one.square, None, one.limit, given)]


def unnoticed(e: Evidence) -> list[str]:
    """Say which steps of the biases need not show."""
    least = [e.shifts[g].least for g in ("gyro.bias", "accel.bias") if g in e.shifts]
    return [steps_unnoticed(*least)] if len(least) == 2 else []


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
        """Sort what is hardly seen; `usual` (p,): sd where the user says nothing [SI]."""
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
    earth, _ = likelier(e.earth, _shifts(e), 2 * EACH)
    return earth_findings(earth, 2 * EACH) + unseen_of(e.coefficients, e.usual)


def unseen_of(coefficients: CoefficientVector, usual: FloatArray) -> list[Finding]:
    """Say what is hardly better known, `usual` (p,) where nothing was said, and the cure [SI]."""
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
    """Refuse a model of deflection that is not seen; where the user `known` it, say so."""
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


WAYS = ("east", "north", "up")


def tables(e: Evidence, numbers: IntArray) -> dict[str, dict[str, npt.NDArray[Any]]]:
    """Return the tables of the report; `numbers` (m,) of the rests used, from 0 [1]."""
    time, legs = e.increments.time, e.legs
    total, count = squares(e)
    attitudes = {"rest": legs.seen} | {
        f"{axis}.{way}": legs.C_nb[:, i, k]
        for k, axis in enumerate(AXES)
        for i, way in enumerate(WAYS)
    }
    velocities: dict[str, npt.NDArray[Any]] = {
        "rest": legs.rest, "start": legs.start, "end": legs.end,
    }  # fmt: skip
    for name, values in (("before", legs.before), ("after", legs.after), ("sd", legs.sd)):
        velocities |= {f"{name}_{way}": values[:, i] for i, way in enumerate(WAYS)}
    return {
        "innovations": {
            "rest": np.arange(len(e.rests)), "in_log": numbers,
            "start": time[[a for a, _ in e.rests]], "end": time[[b for _, b in e.rests]],
            "square": total, "count": count,
        },
        "velocities": velocities,
        "attitudes": attitudes,
    }  # fmt: skip


def unseen(site: Site, decorrelated: bool) -> list[str]:
    """Say what cannot be seen in principle; `decorrelated`: whether each rest started anew."""
    out = [
        wrong_gravity(site.gravity_sd),
        "A wrong latitude: 0.01 deg is an error of the Earth's rate of 0.003 deg/h.",
        "How the body axes lie in the case: they are those of the accelerometers (see gauge).",
        BEYOND_THE_SESSION[0],
        "Other temperatures than that of the session, and biases from one switch-on to the next.",
    ]
    if not decorrelated:
        out.append("Lever arms of the accelerometers, unless they are estimated.")
    return out
