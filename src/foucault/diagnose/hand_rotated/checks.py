"""Judge the calibration of a session: every check, with its limits and its sentence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.checks import drift_check, judge_prior, plausible_scales, status_check
from foucault.diagnose.coverage import Coverage
from foucault.errors import Status
from foucault.estimate import norm_observation
from foucault.estimate.chi_square import FALSE_ALARM, chi_square_limits
from foucault.estimate.drift import Drift
from foucault.estimate.hand_rotated.likelihood import Component
from foucault.models.rests_and_turns import Session
from foucault.models.session_noise import QUIETEST, SessionNoise
from foucault.result import Check, Estimate, Level

ENOUGH_RESTS = 12
"""Fewer rests leave too little redundancy to notice that one is wrong [1]."""

CONDITION = (20.0, 400.0)
"""Condition number of the norm equations: doubtful and unusable beyond [1]. Even coverage has
1.6, a half-space 18 (uncertainties up to 8 times larger), rests within 45 degrees of one axis
470 (160 times)."""

EVEN = np.sqrt(np.repeat([1 / 5, 4 / 15, 4 / 3], 3))
"""Root mean square of each column of the norm equations over all directions [1]. Divided by their
own, a column that hardly any rest shows would look as full as the others."""

SHAKEN, SHAKEN_SHARE = 3.0, 0.2
"""A rest is shaken beyond this level [1]; more than this share of the rests is too much [1]."""

TOO_MUCH = 5.0
"""Residuals this many times the noise in the rests are no scatter: something is missing [1]."""

EXTRAPOLATED = 10.0
"""Rests left out that are predicted so many times worse than they are fitted are extrapolated [1].
With two rests a coefficient it is 1.7, with as many coefficients as rests without bound."""

DOMINATE = 0.85
"""Where a quarter of the residuals or fewer make more than this part of their sum, they are its
cause [1]; of residuals that are spread as chance spreads them a quarter makes some 0.7 at most."""

QUIETER = 5.0
"""The threshold of rests to try where a hand shook them [1]."""

UNSTILL = {"accel": 0.05, "turn": np.radians(1.0)}
"""Scatter that is no longer a calibration: 5 mg at rest [m/s^2], 1 deg in a turn [rad]."""


@dataclass(frozen=True)
class Evidence:
    """Everything the checks look at."""

    session: Session  # what was observed [SI]
    estimate: Estimate
    noise: SessionNoise  # its noise, with the scatter that was added [SI]
    declared: bool  # whether the noise was declared, not measured
    # before, after: fit of each kind of observation by the noise alone, and with the scatter
    before: Mapping[str, Component]
    after: Mapping[str, Component]
    coverage: Coverage
    up_b: FloatArray  # (n, 3) direction of up at each rest, frame b [1]
    # (n,) error and predicted sd of the norm at rests left out [m/s^2], and white errors [1]
    held_out: tuple[FloatArray, FloatArray, FloatArray]
    rest_level: FloatArray  # (n,) how noisy each rest is; 1 is quiet [1]
    drift: Drift | None = None  # the drift of a coefficient that the residuals show most clearly


def checks(e: Evidence) -> tuple[Check, ...]:
    """Return every test of the result; a failed one carries its reason."""
    ended = status_checks(e.estimate.status, len(e.up_b), e.estimate.weakest)
    out = [*ended, *judge_prior(e.estimate)]
    out += [_half_space(e), _condition(e), *plausible_scales(e.estimate.coefficients)]
    out += drift_check(e.drift, e.estimate.coefficients.layout)
    out += [_explained(e, name, what) for name, what in _KINDS.items() if name in e.before]
    out += _unstill(e)
    out += _even(e)
    out.append(_still(e))
    if np.isfinite(e.held_out[0]).any():
        out += [_held_out(e), *_known(e)]
    return tuple(out)


_KINDS = {
    "accel_repeatability": "specific force at rest",
    "gyro_repeatability": "angular rate at rest",
    "turn_repeatability": "turns",
}


def status_checks(status: Status, rests: int, weakest: tuple[str, ...] = ()) -> tuple[Check, ...]:
    """Return the checks that every cost has: it converged, and there were rests enough.

    `rests`: number of rests [1].
    """
    return status_check(status, weakest), _rests(rests)


def _rests(n: int) -> Check:
    fine = n >= ENOUGH_RESTS
    words = (
        f"{n} rests were used."
        if fine
        else f"Only {n} rests: at least {ENOUGH_RESTS} are needed to notice a bad one."
    )
    return Check("rests", n, ENOUGH_RESTS, None, fine, words)


def _half_space(e: Evidence) -> Check:
    value = e.coverage.half_space
    fine = value < 0.0
    missing = ", ".join(words for _, words in e.coverage.missing) or "nothing"
    words = (
        "The orientations lie on all sides."
        if fine
        else f"All rests lie in one half-space: bias and scale are hard to tell apart. "
        f"Add rests with {missing}."
    )
    return Check("half-space", value, None, 0.0, fine, words)


def _condition(e: Evidence) -> Check:
    rows = norm_observation.design(e.up_b, 1.0)
    value = float(np.linalg.cond(rows / EVEN))
    doubtful, unusable = CONDITION
    fine = value <= doubtful
    level = Level.UNUSABLE if value > unusable else Level.DOUBTFUL
    missing = ", ".join(words for _, words in e.coverage.missing) or "more directions"
    words = (
        f"The orientations determine the accelerometer coefficients well (condition {value:.0f})."
        if fine
        else f"The orientations determine the accelerometer coefficients poorly (condition "
        f"{value:.0f}, even coverage has 2). Add rests with {missing}."
    )
    return Check("condition", value, None, doubtful, fine, words, level)


def _explained(e: Evidence, name: str, what: str) -> Check:
    added = getattr(e.noise, name) > 0
    others = any(getattr(e.noise, other) > 0 for other in e.before)
    # Scatter of one kind shows in the others too until it is known.
    c = e.after[name] if others and not added else e.before[name]
    inside = c.low <= c.chi_square <= c.high
    ratio = np.sqrt(c.ratio)
    # The noise of a log without any says nothing of what is too much.
    psd = getattr(e.noise, name.replace("repeatability", "psd"))
    silent = not e.declared and bool(np.all(psd <= QUIETEST**2))
    if inside:
        words = f"The residuals of {what} are as large as the noise says ({ratio:.2f} times)."
    elif c.chi_square < c.low:
        words = (
            f"The residuals of {what} are only {ratio:.2f} times what the noise says: the noise "
            f"is overstated and so are the uncertainties."
        )
    elif added:
        words = f"The residuals of {what} are {ratio:.1f} times what the noise explains"
        if e.declared:
            words += f": {_cause(e, name)}. The uncertainties include the scatter."
        elif ratio > TOO_MUCH and not silent:
            words += (
                f", more than {TOO_MUCH:g} times: something is wrong that is no scatter, such as "
                "lost samples, a wrong sample rate, or a term that is not estimated. The scatter "
                "is part of the uncertainties, but such errors do not average out."
            )
        else:
            words += "; the scatter was estimated and is part of the uncertainties."
    else:
        words = (
            f"The residuals of {what} are {ratio:.1f} times what the noise explains, and the "
            f"uncertainties do not know it."
        )
    if e.declared:
        return Check(f"noise of {what}", c.chi_square, c.low, c.high, inside, words)
    # Noise measured in the rests is a lower limit of what differs between them, and moderate
    # scatter beyond it is accounted for. Measured too large (hands shake) it only makes the
    # uncertainties careful.
    high = max(c.high, TOO_MUCH**2 * c.redundancy) if added else c.high
    fine = c.chi_square <= high or (added and silent)
    return Check(f"noise of {what}", c.chi_square, None, None if silent else high, fine, words)


def _cause(e: Evidence, kind: str) -> str:
    """Say why residuals are larger than declared noise: few of them, a drift, or all of them."""
    n = len(e.up_b)
    first, many = {"accel_repeatability": (0, n), "gyro_repeatability": (n, n)}.get(
        kind, (2 * n, n - 1)
    )
    if e.drift is not None and e.drift.significant:
        return (
            f"a drift of {e.drift.name} during the session makes them, at least in part, not the "
            "declared noise"
        )
    # The scatter was estimated from all: in its unit, which of them make the sum?
    used = e.estimate.blocks >= 0
    square = np.bincount(
        e.estimate.blocks[used], e.estimate.residuals[used] ** 2, minlength=first + many
    )[first : first + many]
    order = np.argsort(-square)
    share = np.cumsum(square[order]) / max(float(np.sum(square)), 1e-300)
    few = order[: int(np.searchsorted(share, DOMINATE)) + 1]
    if len(few) <= max(1, many // 4):
        at = e.session.last - 1 if first == 2 * n else e.session.first
        time = e.session.log.time
        when = ", ".join(f"{time[at[k]] - time[0]:.1f} s" for k in sorted(few.tolist()))
        what = "turn" if first == 2 * n else "rest"
        what += "s" if len(few) > 1 else ""
        return f"the {what} at {when} make most of it: look there, not at the declared noise"
    shaken = np.flatnonzero(e.rest_level > SHAKEN)
    if len(shaken) > SHAKEN_SHARE * n and first < 2 * n:
        return "the instrument was shaken in its rests, for which the declared noise is too small"
    return "it is spread over all of them, so the declared noise is too small or they scatter"


def _unstill(e: Evidence) -> list[Check]:
    rows = (
        ("accel", e.noise.accel_repeatability, 1 / 9.80665e-3, "mg", "The rests"),
        ("turn", e.noise.turn_repeatability, 180 / np.pi, "deg", "The turns"),
    )
    out = []
    for key, value, scale, unit, what in rows:
        size, limit = value * scale, UNSTILL[key] * scale
        fine = size <= limit
        words = f"{what} scatter by {size:.2g} {unit} beyond the noise" + (
            "."
            if fine
            else f", more than {limit:.2g} {unit}: the instrument moved in its rests, or "
            f"the log is damaged (lost samples, wrong sample rate)."
        )
        out.append(Check(f"scatter of {what[4:]}", size, None, limit, fine, words))
    return out


def _still(e: Evidence) -> Check:
    """Count the rests that were shaken: their mean may be right, their noise is not."""
    shaken = int(np.sum(e.rest_level > SHAKEN))
    share = shaken / len(e.rest_level)
    fine = share <= SHAKEN_SHARE
    words = (
        f"{shaken} of {len(e.rest_level)} rests are more than {SHAKEN:g} times as noisy as the "
        f"quietest part of the log"
    ) + (
        "."
        if fine
        else ": the instrument was held or shaken there, and the noise measured in the rests, "
        "with every uncertainty that follows from it, is that of the hand. Put it down for each "
        f"rest; for this log set threshold = {QUIETER:g} in [procedure], so that only what is "
        "quieter than that counts as rest."
    )
    return Check("shaken rests", share, None, SHAKEN_SHARE, fine, words)


def _even(e: Evidence) -> list[Check]:
    """Compare the residuals of the first and the second half of the session."""
    from scipy.special import fdtri

    n = len(e.up_b)
    kinds = {"rests": np.arange(n)}
    if e.session.gyro_mean is not None:
        kinds["turns"] = np.arange(2 * n, 3 * n - 1)
    out = []
    # An outlier counts up to the limit of the robust loss: it has a finding of its own.
    clipped = e.estimate.residuals**2 * e.estimate.weights[e.estimate.blocks]
    for what, mine in kinds.items():
        halves = [np.isin(e.estimate.blocks, part) for part in np.array_split(mine, 2)]
        square = [float(np.sum(clipped[h])) for h in halves]
        dof = [max(float(np.sum(1 - e.estimate.leverage[h])), 1.0) for h in halves]
        ratio = (square[0] / dof[0]) / max(square[1] / dof[1], 1e-300)
        alpha = FALSE_ALARM / len(kinds)
        low = 1 / float(fdtri(dof[1], dof[0], 1 - alpha / 2))
        high = float(fdtri(dof[0], dof[1], 1 - alpha / 2))
        fine = low <= ratio <= high
        worse = "first" if ratio > 1 else "second"
        times = np.sqrt(max(ratio, 1 / ratio))
        words = (
            f"Both halves of the session fit alike ({what})."
            if fine
            else f"The {what} of the {worse} half of the session fit {times:.1f} times worse than "
            f"the others: it was disturbed, warming up, or lost samples, and no single "
            f"uncertainty describes all of it."
        )
        out.append(Check(f"evenness of {what}", ratio, low, high, fine, words))
    return out


def _held_out(e: Evidence) -> Check:
    error, _, white = e.held_out
    used = np.isfinite(white)
    score = float(np.sum(white[used] ** 2))
    dof = int(used.sum())
    # One-sided: a prediction that is better than promised is no fault of the result.
    high = chi_square_limits(dof, 2 * FALSE_ALARM)[1]
    inside = score <= high
    ratio = np.sqrt(score / dof)
    rms = np.sqrt(np.mean(error[used] ** 2)) / 9.80665e-6
    words = (
        f"Rests that the fit did not see are predicted to {rms:.0f} ug, {ratio:.2f} times their "
        f"predicted uncertainty."
    )
    return Check("held-out rests", score, None, high, inside, words)


def _known(e: Evidence) -> list[Check]:
    """Compare what rests left out are predicted to with what the fit leaves of them.

    A fit with a coefficient for every rest leaves nothing of them and predicts none.
    """
    error, _, white = e.held_out
    used = np.isfinite(white)
    if used.sum() < 2:
        return []
    model = e.estimate.state.model
    f_b, _ = model.compensate(e.session.accel_mean, None)
    left = np.linalg.norm(f_b, axis=1) - e.session.site.gravity
    noise = np.sqrt(e.noise.accel_psd.mean() / e.session.rest_time)
    # What is left is at least the noise: a fit can be better than that by chance only.
    size = float(np.sqrt(np.mean(np.maximum(left[used] ** 2, noise[used] ** 2))))
    value = float(np.sqrt(np.mean(error[used] ** 2))) / size
    fine = value <= EXTRAPOLATED
    words = (
        f"Rests that the fit did not see are predicted {value:.1f} times as badly as it fits those "
        "that it saw"
    ) + (
        "."
        if fine
        else f", more than {EXTRAPOLATED:g} times: without any few of the rests the others hardly "
        "determine the accelerometers. Add rests in other orientations."
    )
    return [Check("prediction against fit", value, None, EXTRAPOLATED, fine, words)]
