"""Checks that every method makes: it was solved, its numbers can be, its priors fit.

What the checks say: the sentences of every test, in one table, `words.toml`.

A check is a number and its limits; its words are said where it is inside them, below and above.
``{value}``, ``{low}`` and ``{high}`` are the number and its limits, everything else is given with
it. A sentence that begins with ``...`` goes on from the one inside the limits: with a blank after
it, else in place of its full stop.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector, Layout, Prior
from foucault.errors import ADVICE, Status
from foucault.infer.drift import TOGETHER, Drift, LeftOut
from foucault.infer.gauss_newton import FALSE_ALARM, chi_square_limits
from foucault.models.earth import EARTH_RATE, Site
from foucault.result import CERTAIN, Check, Estimate, Level
from foucault.tables import AXES
from foucault.units import display_unit, factor, plain


class Words(NamedTuple):
    """The sentences of a check: inside its limits, below and above them; one does for both sides.

    Without either the first is said in any case; `unlikely` where it is inside, and no chance.
    """

    fine: str
    below: str = ""
    above: str = ""
    unlikely: str = ""


@cache
def sentences() -> Mapping[str, Words]:
    """Return the table `words.toml`: key of a check -> its sentences."""
    text = (Path(__file__).parent / "words.toml").read_text(encoding="utf-8")
    return {key: Words(**row) for key, row in tomllib.loads(text).items()}


def check(
    key: str,
    name: str,
    value: float,
    low: float | None = None,
    high: float | None = None,
    given: Mapping[str, Any] = MappingProxyType({}),
    *,
    fails: Level = Level.DOUBTFUL,
    excused: bool = False,
    passed: bool = True,
    p: float | None = None,
) -> Check:
    """Return a check with its sentence.

    `key`: of `sentences`; `value`, `low`, `high`: the number and its limits [unit of the sentence];
    `given`: what else the sentence says; `excused`: outside its limits, but accounted
    for in the uncertainties: it is said, and does not fail; `passed`: False where no number says
    that it fails; `p`: as of `Check` [1].
    """
    below = low is not None and value < low
    above = high is not None and value > high
    words, text = sentences()[key], ""
    if below or above:
        text = (words.below or words.above) if below else (words.above or words.below)
    elif p is not None and p < CERTAIN:
        text = words.unlikely
    if text.startswith("..."):
        text = words.fine.removesuffix("" if text[3] == " " else ".") + text[3:]
    numbers = {"value": value, "low": low, "high": high}
    told = {k: _Number(x) if isinstance(x, float) else x for k, x in numbers.items()}
    sentence = (text or words.fine).format(**told, **given)
    if excused:
        low, high = (None if below else low), (None if above else high)
    return Check(name, value, low, high, passed, sentence, fails, p)


class _Number(float):
    """A number that a sentence has without an exponent where it is large: 310, not 3.1e+02."""

    def __format__(self, spec: str) -> str:
        text = super().__format__(spec)
        return f"{float(text):.0f}" if "e+" in text else text


PLAUSIBLE = 30.0  # A larger scale factor error is that of a wrong unit [percent].
LARGEST_BIAS = 60.0  # No gyro has a larger bias [deg/s].
VISIBLE = 4.0  # The Earth's rate and its opposite are told apart when they lie this far apart [sd].
NEAR = 3.0  # A g-sensitivity within this of what a reversed sign makes may well be that [sd].
SEEN = 1e-6  # A prior whose variance nothing narrows by more than this share is not tested [1].

WRONG_PRIOR = (
    "the prior is wrong or too narrow, and it bends the other coefficients. Leave [prior] out to "
    "see what the log alone says"
)
"""What puts an estimate off its prior, where no other cause is known."""

HARDLY = 0.7
"""A coefficient whose uncertainty is more than this of what it was before is hardly seen [1]."""

REVERSED = (
    'the accelerometers read gravity instead of specific force (reads = "gravity"), both triads '
    "are mirrored alike, or the latitude has the wrong sign"
)
"""What turns the vertical Earth rate around."""


def status_check(status: Status, weakest: tuple[str, ...]) -> Check:
    """Return the check that the estimation converged and saw everything."""
    given = {"advice": ADVICE[status], "weakest": "; ".join(weakest)}
    key, value = "not seen" if weakest else "converged", float(status is Status.CONVERGED)
    return check(key, "converged", value, 1.0, None, given, fails=Level.UNUSABLE)


def plausible_scales(coefficients: CoefficientVector) -> list[Check]:
    """Return the checks of size: a scale factor error of a third is a wrong unit."""
    out = []
    for triad, sensor in (("accel", "accelerometer"), ("gyro", "gyro")):
        values = [coefficients.value(n) for n in coefficients.names if f"{triad}.scale." in n]
        if values:
            percent, given = 100 * max(values, key=abs), {"triad": triad, "sensor": sensor}
            out.append(check("scale factors", f"{triad} scale", percent, -PLAUSIBLE, PLAUSIBLE,
                             given, fails=Level.UNUSABLE))  # fmt: skip
    names = [n for n in coefficients.names if n.startswith("gyro.bias.")]
    worst = float(np.degrees(max((abs(coefficients.value(n)) for n in names), default=0.0)))
    if worst > LARGEST_BIAS:
        out.append(check("impossible bias", "gyro bias", worst, None, LARGEST_BIAS,
                         fails=Level.UNUSABLE))  # fmt: skip
    return out


def judge_prior(estimate: Estimate) -> list[Check]:
    """Return the check of what was known beforehand, where anything tests it."""
    c = estimate.coefficients
    known = int(np.isfinite(c.prior_sd).sum())
    narrowed = 1.0 - (c.sd / c.prior_sd)[np.isfinite(c.prior_sd)] ** 2 > SEEN
    if not known or (estimate.alone is None and not narrowed.any()):
        return []
    rows = estimate.residuals[-known:]  # the prior's rows come last
    return [prior_check(estimate.coefficients, rows, estimate.alone)]


def given_check(c: CoefficientVector, given: Prior) -> list[Check]:
    """Return the check of what was given beforehand, where an estimate knows more than was given.

    `c`: the estimate, with covariance, and the standard deviations of all that was known [SI];
    `given` (2,): mean and sd of coefficients or groups of them [SI].
    """
    mean, sd = np.zeros(len(c)), np.full(len(c), np.inf)
    for i, name in enumerate(c.names):
        for key, (value, spread) in given.items():
            if name == key or name.startswith(key + "."):
                mean[i], sd[i] = value, spread
    some = np.isfinite(sd)
    if not some.any():
        return []
    return [prior_check(replace(c, prior_sd=sd), (mean - c.values)[some] / sd[some])]


def prior_check(
    coefficients: CoefficientVector,
    residuals: FloatArray,
    alone: CoefficientVector | None = None,
    *,
    cause: str = "",
) -> Check:
    """Compare what was said to be known beforehand with what the observations alone say.

    `coefficients`: the estimate, priors included, with its covariance [SI]; `residuals` (k,):
    white residuals of the k priors, in order [1]; `alone` or None: the estimate without the
    priors, where it is known [SI]; `cause`: what else has put the estimate off, where that is
    known.

    A narrow prior draws the estimate to itself, so its residual ``r = (prior - estimate) / s``
    says little. It is compared with the estimate without it, ``d = (prior - alone) / s`` of
    covariance ``C = I + S^-1 P S^-1``, s the sd of the priors and P the covariance of `alone`.
    Where that is not known, the same follows from r, of covariance ``C = I - S^-1 P S^-1``, P that
    of the estimate [1]_: with a prior that is so narrow that nothing is left of C it is not tested.
    Each prior is tested by ``d_i^2 / C_ii``, and all together by ``d' C^-1 d``.

    The covariance must not know the prior otherwise: see `infer.gauss_newton.add_prior`.

    References
    ----------
    .. [1] W. Baarda, "A testing procedure for use in geodetic networks", 1968.
    """
    known = np.flatnonzero(np.isfinite(coefficients.prior_sd))
    sd, off = coefficients.prior_sd[known], np.asarray(residuals, float)
    C = np.eye(len(known))
    if alone is not None and alone.cov is not None:
        off = off + (coefficients.values - alone.values)[known] / sd
        C += alone.cov[np.ix_(known, known)] / np.outer(sd, sd)
    elif coefficients.cov is not None:
        C -= coefficients.cov[np.ix_(known, known)] / np.outer(sd, sd)
    own = np.diag(C)
    miss = np.abs(off) / np.sqrt(np.where(own > SEEN, own, 1.0))
    tests = len(known) + (len(known) > 1)  # each, and all together

    def highest(dof: float) -> float:
        """One-sided: agreement that is too good is none of a prior's faults."""
        return float(np.sqrt(chi_square_limits(dof, 2 * FALSE_ALARM, tests)[1]))

    limit = highest(1.0)
    worst = int(np.argmax(miss))
    key, value = "prior", float(miss[worst])
    if value <= limit and len(known) > 1:
        # In units of what is left of each, so that a narrow prior does not hide the others.
        unit = np.sqrt(np.where(own > SEEN, own, np.inf))
        size, axes = np.linalg.eigh(C / np.outer(unit, unit))
        seen = size > SEEN
        together = float(np.linalg.norm(axes[:, seen].T @ (off / unit) / np.sqrt(size[seen])))
        if seen.any() and together > highest(float(seen.sum())):
            key, value, limit = "priors together", together, highest(float(seen.sum()))
    name = coefficients.names[known[worst]]
    given = {"name": name, "count": len(known), "cause": cause or WRONG_PRIOR}
    return check(key, "prior", value, None, limit, given)


def hardly(c: CoefficientVector) -> list[str]:
    """Return the names of `c` [SI] that are hardly better known than by their prior."""
    return [n for n, s, p in zip(c.names, c.sd, c.prior_sd, strict=True) if s > HARDLY * p]


def unseen_sizes(
    coefficients: CoefficientVector, gravity: float, gyro_range: Sequence[float] | None
) -> list[str]:
    """Say how large the errors that no residual shows may be before they matter, for result.json.

    `coefficients`: the estimate, with covariance [SI]; `gravity`: local gravity [m/s^2];
    `gyro_range` (2,): lowest and highest rate of the session, None without gyros [rad/s].

    An error matters that moves a coefficient by its standard deviation, the smallest of its kind.
    """
    c, g, out = coefficients, gravity, []
    rate = max((abs(v) for v in gyro_range or ()), default=0.0)

    def least(family: str) -> float:
        pairs = zip(c.names, c.sd.tolist(), strict=True)
        return min((sd for n, sd in pairs if n.startswith(f"{family}.") and sd > 0), default=0.0)

    accel, gyro, bias = least("accel.scale"), least("gyro.scale"), least("accel.bias")
    if bias and "accel.quadratic.x" not in c.layout:
        size = plain(bias / g**2 / (1e-6 / 9.80665), 2)
        out.append(
            "Quadratic terms of the accelerometers, where few rests show them: they are not "
            f"estimated, and one of {size} ug/g^2 moves a bias by its standard deviation."
        )
    if accel:
        out.append(
            f"Of a wrong local gravity {plain(accel * g * 1e5, 2)} mGal move a scale factor by its "
            "standard deviation."
        )
    if gyro:
        out.append(
            "A wrong time base (sample rate or stamps): it is the same part of every gyro scale "
            f"factor, and {plain(gyro * 1e6, 2)} ppm of it are a standard deviation."
        )
    if gyro and rate and "gyro.cubic.x" not in c.layout:
        out.append(
            "A gyro scale factor that changes with the rate: it is not estimated, and "
            f"{plain(gyro * 1e6, 2)} ppm at {plain(float(np.degrees(rate)), 3)} deg/s are a "
            "standard deviation. A rate table shows it."
        )
    out.append(
        "A change within the session that no residual follows, such as of a scale factor that only "
        "one observation shows: see the check of drift for what it would have seen."
    )
    return out


def change_checks(seen: Sequence[Drift], layout: Layout) -> list[Check]:
    """Judge drift and jump that `fit_checks.changes` found."""
    out = []
    for one in seen:
        some = next(iter(TOGETHER.get(one.name, {one.name: 1.0})))
        kind = layout.coefficients[layout.index(some)].kind
        given = {"name": one.name, "size": _with_sd(one.size, one.sd, kind)}
        what = "drift" if one.when is None else "jump"
        given |= {} if one.when is None else {"time": plain(one.when, 6)}
        out.append(check(what, what, one.ratio, None, one.limit, given))
    return out


def _with_sd(size: float, sd: float, kind: str) -> str:
    unit = display_unit(kind, abs(size))
    scale = factor(unit, kind)
    return f"{plain(size / scale, 2)} +- {plain(sd / scale, 2)} {unit}"


def left_out_check(found: LeftOut | None, layout: Layout, what: str, cure: str) -> list[Check]:
    """Judge terms that were left out; nothing to judge where none would show.

    `found` or None: the terms, see `infer.drift.find_left_out`; `layout`: coefficients that
    these are of, for their units; `what`, `cure`: what the terms are called, and what to do about
    them.
    """
    if found is None:
        return []
    rows = [
        f"{name} {_with_sd(size, sd, layout.coefficients[layout.index(name)].kind)}"
        for name, size, sd in zip(found.names, found.size.tolist(), found.sd.tolist(), strict=True)
    ]
    given = {"what": what, "terms": ", ".join(rows), "cure": cure}
    return [check("terms left out", what, found.ratio, None, found.limit, given)]


CHANCE = 0.005  # False alarms of the test of the Earth's sign at rest, one-sided [1].


def reversed_earth_at_rest(
    rates: FloatArray,
    up: FloatArray,
    matrix: FloatArray,
    site: Site,
    sd: float = 0.0,
    beside: float = 0.0,
) -> Check | None:
    """Doubt rates at rest that are nearer to those of a reversed Earth rate than to none.

    A reversed sign of the vertical part leaves ``-2 w_ie sin(L) up`` in every rest. One number is
    looked for, not nine of a g-sensitivity, so that gyros tell it whose noise hides each of those.

    `rates` (n, 3): mean rates at rest, without the Earth's rate as the latitude says it [rad/s];
    `up` (n, 3): directions of up, body axes [1]; `matrix` (3, 3): scale factors and misalignments
    of the gyros [1]; `sd`: least scatter of these rates that their noise makes, per axis [rad/s];
    `beside`: sd of what a g-sensitivity that is not estimated adds along up [rad/s]. Returns None
    where the latitude is unknown, the directions are too few or too much alike, or where such a
    g-sensitivity hides what the sign makes.
    """
    from scipy.special import stdtr, stdtrit

    n = len(rates)
    if site.latitude is None or n < 3:
        return None
    made = float(-2 * EARTH_RATE * np.sin(site.latitude))
    x, y = up @ matrix.T, rates
    x, y = x - x.mean(axis=0), y - y.mean(axis=0)
    size, dof = float(np.sum(x**2)), 3 * n - 4
    if size < 0.1 * n or made == 0.0:
        return None
    k = float(np.sum(x * y)) / size
    scatter = max(float(np.sqrt(np.sum((y - k * x) ** 2) / dof)), sd)
    slope_sd = float(np.hypot(scatter / np.sqrt(size), beside))
    limit = float(stdtrit(dof, 1 - CHANCE))
    if slope_sd <= 0.0 or (beside and abs(made) < limit * slope_sd):
        return None
    away = k / slope_sd * float(np.sign(made))
    nearer = abs(k - made) < abs(k)
    hour = np.degrees(1.0) * 3600
    given = {"rate": hour * k, "sd": hour * slope_sd, "made": hour * made, "cause": REVERSED}
    return check("Earth reversed at rest", "vertical Earth rate", away, None,
                 limit if nearer else None, given, p=float(2 * stdtr(dof, -abs(away))))  # fmt: skip


MANY = 10.0  # An uncertainty so many times what noise and plan allow is no success of the plan [1].


IDLE = 1e-8
"""A scale factor or an angle that is known to this is better than any use of it [1], [rad]."""


def foreseen_check(coefficients: CoefficientVector, bound: npt.ArrayLike) -> Check:
    """Compare the uncertainties with those that noise and plan allow.

    Scatter that is estimated makes a result honest, not good: where one reading spoils all, the
    uncertainties grow until everything fits.

    `coefficients`: the estimate, with covariance [SI]; `bound` (n,): Cramer-Rao bound of the same
    coefficients by the noise alone, as sd, NaN or infinite where nothing tells them [SI].
    """
    least = np.asarray(bound, float)
    kinds = [c.kind for c in coefficients.layout.coefficients]
    idle = np.array([IDLE if k in ("scale factor error", "misalignment") else 0.0 for k in kinds])
    with np.errstate(divide="ignore", invalid="ignore"):
        told = np.isfinite(least) & (least > 0)
        ratio = np.where(told, coefficients.sd / np.maximum(least, idle), 0.0)
    worst = int(np.argmax(ratio.round(6)))  # of those that are alike but for rounding the first
    given = {"name": coefficients.names[worst]}
    return check("plan", "uncertainty against the plan", float(ratio[worst]), None, MANY, given)


def reversed_earth_check(coefficients: CoefficientVector, site: Site) -> Check | None:
    """Doubt a g-sensitivity that is what a reversed sign of the Earth's rate would make.

    One that is alike about all axes adds ``k f`` to the rates, which at rest is upward as the
    vertical Earth rate is: estimated, it takes up a reversed sign as ``k g = -2 w_ie sin L``, and
    leaves nothing in the residuals.

    `coefficients`: the estimate, with covariance [SI]. Returns None where g-sensitivity or
    latitude is not known, or too little to tell.
    """
    names = [f"gyro.g_sensitivity.{a}{a}" for a in AXES]
    if site.latitude is None or not set(names) <= set(coefficients.names):
        return None
    at = [coefficients.layout.index(name) for name in names]
    if coefficients.cov is None or not coefficients.free[at].all():
        return None
    unit = np.degrees(1.0) * 3600 * site.gravity
    each, cov = unit * coefficients.values[at], unit**2 * coefficients.cov[np.ix_(at, at)]
    value, sd = float(each.mean()), float(np.sqrt(cov.mean()))
    made = float(-2 * np.degrees(EARTH_RATE) * 3600 * np.sin(site.latitude))
    # One that may be as large as that by what was known of it says nothing of the sign.
    known = unit * float(np.sqrt(np.mean(coefficients.prior_sd[at] ** 2) / len(at)))
    if not 0 < VISIBLE * sd <= abs(made) or (VISIBLE * known > abs(made) and np.isfinite(known)):
        return None
    away = abs(value - made) / sd
    alike = np.ptp(each) < abs(made) + VISIBLE * float(np.sqrt(np.diag(cov).max()))
    given = {"mean": value, "sd": sd, "made": made, "cause": REVERSED}
    return check("Earth reversed in g-sensitivity", "vertical Earth rate", away,
                 NEAR if alike else None, None, given)  # fmt: skip
