"""A session by hand: what is wrong with it, its checks, and the parts of its report.

Rests that the fit did not see are predicted by their norms. The vertical part of the Earth's
rotation must have the sign that the site says: gravity read instead of specific force, both triads
mirrored alike, or the latitude given with the wrong sign, none of them shows in norms or turns, but
all of them turn the vertical Earth rate around. With the attitudes known up to heading, the mean
rates at rest are linear in the gyro bias, the two horizontal components and the vertical one; the
last is estimated freely and compared with ``w_ie sin L``.

Where g-sensitivity is estimated it takes up what a reversed sign does, and it is looked for there:
see `diagnose.checks.reversed_earth_check`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.coefficients import CoefficientVector
from foucault.detect.coverage import Coverage
from foucault.diagnose import fit_checks, references
from foucault.diagnose.checks import REVERSED, VISIBLE, check, reversed_earth_check
from foucault.diagnose.fit_checks import Judged, Limit, folds
from foucault.errors import Finding, finding
from foucault.estimate import norm_observation
from foucault.estimate.hand_rotated import SCATTER, middle, session_of
from foucault.infer import gauss_newton
from foucault.infer.mixed import Covariance, Fit, HeldOut, causes, held_out
from foucault.models.imu import ImuModel
from foucault.models.noise import QUIETEST, SessionNoise
from foucault.models.rests_and_turns import Attitudes, Prediction, Session
from foucault.result import Check, Estimate, Level
from foucault.tables import AXES

UNDETERMINED = 1e3
"""A rest left out that is known so many times worse is not determined by the others [1]."""


def norm_columns(
    model: ImuModel, coefficients: CoefficientVector, session: Session
) -> dict[str, FloatArray]:
    """Return columns of "rests" in tables.toml: up and norms [SI], the noise that of each rest."""
    readings, mean = session.log.accel, session.accel_mean
    assert readings is not None
    spans = zip(session.first, session.last, strict=True)
    cov = np.array([np.diag(readings[a:b].var(axis=0, ddof=1)) / (b - a) for a, b in spans])
    norm, joint = references.norm_with_cov(model, coefficients, mean, cov)
    f_b, _ = model.compensate(mean, None)
    assert f_b is not None
    up_b = f_b / norm[:, None]
    return {f"up_{axis}": up_b[:, i] for i, axis in enumerate(AXES)} | {
        "norm_before": np.linalg.norm(mean, axis=1),
        "norm_after": norm,
        "norm_sd": np.sqrt(np.diag(joint)),
        "weight": np.ones(len(norm)),
    }


def norm_slope(fit: Fit) -> FloatArray:
    """Return what the norm of specific force at each rest is per reading, shape (n, 3) [1]."""
    model, up_b = fit.state.model, fit.state.C_nb[:, 2, :]
    f_b = session_of(fit).session.site.gravity * up_b
    by_force = model.slopes(f_b, np.zeros_like(f_b), ()).accel_by_force
    return np.asarray(np.linalg.solve(np.swapaxes(by_force, 1, 2), up_b[:, :, None])[:, :, 0])


def hold_out(fit: Fit, count: int) -> HeldOut | None:
    """Predict norms of rests, a part of `count` [1] left out each time; None from too few."""
    parts = folds(fit, "accel", count)
    if len(parts) < 2:
        return None
    slope = norm_slope(fit)
    onto = np.zeros((len(fit.at.residuals), 1, 3))
    onto[: len(slope), 0] = slope
    return held_out(fit, parts, onto, seen=UNDETERMINED**-2)


def rest_cov(fit: Fit) -> FloatArray:
    """Return the covariance of the mean specific force of each rest, shape (n, 3, 3) [SI^2]."""
    k, d = fit.at.residuals.shape
    cov = Covariance(fit.at.sources, fit.sds, (k, d), np.ones(k))
    n = np.arange(len(fit.state.C_nb))
    return np.asarray(cov.whole.reshape(k, d, k, d)[n, :, n, :])


def norm_noise(fit: Fit) -> FloatArray:
    """Return the sd of the norm of each rest by its own noise, shape (n,) [m/s^2]."""
    slope = norm_slope(fit)
    return np.asarray(np.sqrt(np.einsum("ni,nij,nj->n", slope, rest_cov(fit), slope)))


ENOUGH_RESTS = 12  # Fewer rests leave too little redundancy to notice that one is wrong [1].

CONDITION = (20.0, 400.0)
"""Condition number of the norm equations: doubtful and unusable beyond [1]. Even coverage has
1.6, a half-space 18 (uncertainties up to 8 times larger), rests within 45 degrees of one axis
470 (160 times)."""

EVEN = np.sqrt(np.repeat([1 / 5, 4 / 15, 4 / 3], 3))
"""Root mean square of each column of the norm equations over all directions [1]. Divided by their
own, a column that hardly any rest shows would look as full as the others."""

SHAKEN, SHAKEN_SHARE = 3.0, 0.2
"""A rest is shaken beyond this level [1]; more than this share of the rests is too much [1]."""

EXTRAPOLATED = 10.0
"""Rests left out that are known so many times worse than measured ones are extrapolated [1]. With
two rests a coefficient it is 1.7, with as many coefficients as rests without bound."""

DOMINATE = 0.85
"""Where a quarter of the residuals or fewer make more than this part of their sum, they are its
cause [1]; of residuals that are spread as chance spreads them a quarter makes some 0.7 at most."""

QUIETER = 5.0  # The threshold of rests to try where a hand shook them [1].

MOVED = "the instrument moved in its rests, or the log is damaged (lost samples, wrong sample rate)"

KINDS = {"accel": "specific force at rest", "gyro": "angular rate at rest", "turns": "turns"}
"""Kind of reading -> what people call it."""

LIMITS = {
    SCATTER["accel"]: Limit("The specific force at rest", 0.05, 1 / 9.80665e-3, "mg", MOVED),
    SCATTER["turns"]: Limit("The rotation of the turns", np.radians(1.0), 180 / np.pi, "deg",
                            MOVED),
}  # fmt: skip
"""Scatter that is no longer a calibration: 5 mg at rest [m/s^2], 1 deg in a turn [rad]."""


def judged(fit: Fit, declared: bool, rest_level: FloatArray, held_out: HeldOut | None) -> Judged:
    """Return what every fit is asked; `rest_level` (n,): how noisy rests are, 1 is quiet [1]."""
    model = session_of(fit)
    noise, gyros = model.noise, model.session.gyro_mean is not None
    psd = {"accel": noise.accel_psd, "gyro": noise.gyro_psd, "turns": noise.turn_psd}
    silent = {kind for kind, one in psd.items() if np.all(one <= QUIETEST**2)}
    size = ""
    if held_out is not None and np.isfinite(held_out.error).any():
        rms = np.sqrt(np.nanmean(held_out.error**2)) / 9.80665e-6
        size = f", their norms to {rms:.0f} ug"
    found = Judged(
        fit, KINDS, "declared" if declared else "measured", middle(model.session),
        {kind: (SCATTER[kind],) for kind in KINDS}, LIMITS,
        silent=frozenset() if declared else frozenset(silent),
        held_out=held_out, held_out_size=size, predicted="rests",
        readings="means and turns" if gyros else "rests",
        cure="Add rests.",
        told_apart=0.0,  # one wrong reading is left out first
        said={"unknown heading": ""},
    )  # fmt: skip
    return replace(found, cause=_causes(found, rest_level)) if declared else found


def checks(e: Judged, coverage: Coverage, rest_level: FloatArray) -> tuple[Check, ...]:
    """Return every test; `rest_level` (n,): how noisy each rest is, 1 is quiet [1]."""
    every, up_b = fit_checks.checks(e), e.fit.state.C_nb[:, 2, :]
    missing = ", ".join(words for _, words in coverage.missing)
    own = [
        rests(len(up_b)),
        check("half-space", "half-space", coverage.half_space, None, 0.0,
              {"missing": missing or "nothing"}),
        _condition(up_b, missing or "more directions"),
        _still(rest_level),
    ]  # fmt: skip
    return (*every, *own, *_known(e))


def rests(n: int) -> Check:
    """Judge whether there were rests enough; `n`: their number [1]."""
    return check("rests", "rests", n, ENOUGH_RESTS)


def _condition(up_b: FloatArray, missing: str) -> Check:
    value = float(np.linalg.cond(norm_observation.design(up_b, 1.0) / EVEN))
    doubtful, unusable = CONDITION
    level = Level.UNUSABLE if value > unusable else Level.DOUBTFUL
    given = {"missing": missing}
    return check("condition", "condition", value, None, doubtful, given, fails=level)


def _still(rest_level: FloatArray) -> Check:
    """Count the rests that were shaken: their mean may be right, their noise is not."""
    shaken = int(np.sum(rest_level > SHAKEN))
    given = {"shaken": shaken, "n": len(rest_level), "limit": SHAKEN, "quieter": QUIETER}
    share = shaken / len(rest_level)
    return check("shaken rests", "shaken rests", share, None, SHAKEN_SHARE, given)


def _causes(e: Judged, rest_level: FloatArray) -> dict[str, str]:
    """Say why residuals are larger than declared noise: few of them, a drift, or all of them."""
    estimate, out = e.fit.estimate, {}
    contradicted = [kind for kind, c in e.fit.before.items() if c.chi_square > c.high]
    changed = [one for one in fit_checks.changes(e) if one.significant] if contradicted else []
    # The scatter was estimated from all: in its unit, which of them make the sum?
    used = estimate.blocks >= 0
    squares = np.bincount(estimate.blocks[used], estimate.residuals[used] ** 2)
    for kind in contradicted:
        mine = np.flatnonzero(e.fit.model.kinds[kind].any(axis=1))
        square = squares[mine]
        order = np.argsort(-square)
        share = np.cumsum(square[order]) / max(float(np.sum(square)), 1e-300)
        few = order[: int(np.searchsorted(share, DOMINATE)) + 1]
        shaken = np.mean(rest_level > SHAKEN) > SHAKEN_SHARE and kind != "turns"
        if changed:
            what = "drift" if changed[0].when is None else "jump"
            out[kind] = (
                f"a {what} of {changed[0].name} during the session makes them, at least in part, "
                "not the declared noise"
            )
        elif len(few) <= max(1, len(mine) // 4):
            which = _when(session_of(e.fit).session, kind, few)
            out[kind] = f"{which} make most of it: look there, not at the declared noise"
        elif shaken:
            out[kind] = (
                "the instrument was shaken in its rests, for which the declared noise is too small"
            )
        else:
            out[kind] = (
                "it is spread over all of them, so the declared noise is too small or they scatter"
            )
    return out


def _when(s: Session, kind: str, few: IntArray) -> str:
    """Say which rests or turns: when they began, from the start of the log."""
    what = "turn" if kind == "turns" else "rest"
    at, time = s.last - 1 if kind == "turns" else s.first, s.log.time
    when = ", ".join(f"{time[at[k]] - time[0]:.1f} s" for k in sorted(few.tolist()))
    return f"the {what}{'s' if len(few) > 1 else ''} at {when}"


def _known(e: Judged) -> list[Check]:
    """Compare how well rests left out are known with how well one is that was measured.

    A fit with a coefficient for every rest knows nothing of those that it did not see.
    """
    if e.held_out is None:
        return []
    noise = norm_noise(e.fit)
    sd = e.held_out.sd[: len(noise), 0]
    ratio = np.minimum(sd / noise, UNDETERMINED)[~np.isnan(sd)]
    value = float(np.sqrt(np.mean(ratio**2)))
    return [check("prediction", "prediction against fit", value, None, EXTRAPOLATED)]


DEAD = 0.01
"""Gyros that show less than this part of the Earth's rate do not feel it: they tell no sign [1]."""


def vertical_earth_rate(session: Session, state: Attitudes) -> tuple[float, float] | None:
    """Estimate the vertical Earth rate from the rests, with its sd from their own scatter.

    Returns vertical Earth rate, up positive, and its standard deviation [rad/s]; None where there
    are no gyros or too few rests.
    """
    if session.gyro_mean is None or len(session.gyro_mean) < 4:
        return None
    model, n = state.model, len(session.gyro_mean)
    axes = model.gyro_matrix @ np.swapaxes(state.C_nb, 1, 2)  # columns: east, north, up
    rows = np.concatenate([np.broadcast_to(np.eye(3), (n, 3, 3)), axes], axis=2).reshape(-1, 6)
    f_b = session.site.gravity * state.C_nb[:, 2, :]
    known = (session.gyro_mean - f_b @ model.g_sensitivity.T).ravel()
    root = np.repeat(np.sqrt(session.rest_time), 3)
    rows, known = rows * root[:, None], known * root
    x, *_ = np.linalg.lstsq(rows, known, rcond=None)
    scatter = np.sum((known - rows @ x) ** 2) / (3 * n - 6)
    sd = np.sqrt(scatter * np.linalg.pinv(rows.T @ rows)[5, 5])
    return float(x[5]), float(sd)


def vertical_check(session: Session, estimate: Estimate, beside: float = 0.0) -> Check | None:
    """Test the sign of the vertical Earth rate, where the gyros can see it.

    `beside`: sd of what a g-sensitivity that is not estimated adds along up [rad/s].
    """
    if "gyro.g_sensitivity.xx" in estimate.coefficients.layout:
        return reversed_earth_check(estimate.coefficients, session.site)
    found = vertical_earth_rate(session, estimate.state)
    if found is None or session.site.latitude is None:
        return None
    want = float(session.earth[2])
    value, sd = found[0], float(np.hypot(found[1], beside))
    if abs(want) < VISIBLE * sd / 2 or abs(value) < DEAD * abs(want):
        return None
    unit = np.degrees(1.0) * 3600
    off, limit = (value * np.sign(want) - abs(want)) * unit, abs(want) * unit
    given = {"seen": value * unit, "sd": sd * unit, "want": want * unit, "cause": REVERSED}
    name = "vertical Earth rate"
    return check(name, name, off, -limit, limit, given, fails=Level.UNUSABLE)


def hints(fit: Fit, prediction: Prediction, turned_round: bool = False) -> list[Finding]:
    """Return findings about the session: scatter, outliers, a wrong g, a missing term.

    `prediction`: residuals at the solution [SI]; `turned_round`: whether the Earth's rate has the
    wrong sign: g-sensitivity would only hide it.
    """
    model = session_of(fit)
    coarse = _resolution(model.session, model.noise)
    gravity, codes = model.session.site.gravity, {"accel": "session.common_scale"}
    common = references.common_scale(fit.estimate.coefficients, gravity, codes)
    found = [*coarse, *_scatter(fit), *_outliers(fit), *common]
    return found if turned_round or coarse else found + _g_sensitivity(fit, prediction)


COARSE = 3.0
"""A constant rounding error this many times the noise of a rest's mean is worth saying [1]."""


def _resolution(session: Session, noise: SessionNoise) -> list[Finding]:
    """Name a triad whose steps are so coarse that its mean does not average the rounding."""
    rest = float(np.median(session.rest_time))
    rows = (
        ("accelerometers", noise.accel_rounding, noise.accel_psd, 1 / 9.80665e-3, "mg"),
        ("gyros", noise.gyro_rounding, noise.gyro_psd, 180 / np.pi * 3600, "deg/h"),
    )
    return [
        finding("session.resolution", what=what, sd=f"{rounding.max() * scale:.2g} {unit}")
        for what, rounding, psd, scale, unit in rows
        if np.any(rounding > COARSE * np.sqrt(psd / rest))
    ]


def _scatter(fit: Fit) -> list[Finding]:
    """Name scatter that is significant; a little is estimated in every session."""
    degrees = 180 / np.pi
    rows = (
        ("accel", "the specific forces at rest", 1 / 9.80665e-3, "mg"),
        ("gyro", "the rates at rest", degrees * 3600, "deg/h"),
        ("turns", "the turns", degrees, "deg"),
    )
    return [
        finding("session.scatter", what=what, sd=f"{fit.found[SCATTER[kind]] * scale:.2g} {unit}")
        for kind, what, scale, unit in rows
        if fit.found.get(SCATTER[kind]) and fit.before[kind].chi_square > fit.before[kind].high
    ]


def _outliers(fit: Fit) -> list[Finding]:
    names = {"accel": "specific force of the rest", "gyro": "rate of the rest", "turns": "turn"}
    estimate, s, out = fit.estimate, session_of(fit).session, []
    norms = gauss_newton.block_norms(estimate.residuals, estimate.blocks, estimate.weights)
    for kind, rows in fit.model.kinds.items():
        first = int(np.argmax(rows.any(axis=1)))
        at = s.last - 1 if kind == "turns" else s.first
        for k in fit.outliers[rows[fit.outliers].any(axis=1)].tolist():
            time = s.log.time[at[k - first]] - s.log.time[0]
            words = {"what": names[kind], "time": f"{time:.1f}", "norm": f"{norms[k]:.0f}"}
            out.append(finding("session.outlier", **words))
    return out


def _g_sensitivity(fit: Fit, prediction: Prediction) -> list[Finding]:
    """Regress the gyro residuals at rest on specific force, where they are unexplained."""
    found = fit.found.get(SCATTER["gyro"])
    known = "gyro.g_sensitivity.xx" in fit.estimate.coefficients.layout
    known |= any(s.name == "gyro.g_sensitivity" for s in fit.at.sources)  # tested by itself
    if not found or known:
        return []
    up_b = fit.state.C_nb[:, 2, :]
    n = len(up_b)
    residual = prediction.residuals[n : 2 * n]
    if session_of(fit).session.site.latitude is None:  # what is the Earth's is no g-sensitivity
        residual = residual - prediction.earth[:n] @ causes(fit, "unknown Earth rate")
    rows = np.column_stack([up_b, np.ones(n)])
    solved, *_ = np.linalg.lstsq(rows, residual, rcond=None)
    share = 1 - np.sum((residual - rows @ solved) ** 2) / np.sum(residual**2)
    # Three columns explain 3/n of pure scatter; ask for far more before speaking.
    if n < 12 or share < 0.5:
        return []
    size = np.degrees(np.abs(solved[:3]).max()) * 3600
    return [finding("session.g_sensitivity", share=f"{100 * share:.0f}", size=f"{size:.0f}")]


def tables(
    fit: Fit, prediction: Prediction, held_out: HeldOut | None, base: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the tables "rests" and "turns" of the report, with norms of rests left out."""
    s, estimate, up_b = session_of(fit).session, fit.estimate, fit.state.C_nb[:, 2, :]
    n = len(up_b)
    norm, joint = references.norm_with_cov(
        fit.state.model, estimate.coefficients, s.accel_mean, rest_cov(fit)
    )
    worst, none = references.worst_residuals(estimate), np.full((n, 1), np.nan)
    sd = none if held_out is None else held_out.sd[:n]
    rests = dict(base) | {f"up_{a}": up_b[:, i] for i, a in enumerate(AXES)}
    rests |= {
        "norm_before": np.linalg.norm(s.accel_mean, axis=1),
        "norm_after": norm,
        "norm_sd": np.sqrt(np.diag(joint)),
        "held_out": (none if held_out is None else held_out.error[:n])[:, 0],
        "held_out_sd": np.where(np.isfinite(sd), sd, np.nan)[:, 0],
        "residual": worst[:n],
        "weight": estimate.weights[:n],
    }
    if s.gyro_mean is None:
        return {"rests": rests}
    rho = prediction.residuals[2 * n :]
    C_se = prediction.C_se
    # The rotation error, moved to the end of the turn, as it shows in the direction of up.
    error = np.cross(np.einsum("nji,nj->ni", C_se, rho), up_b[1:])
    cosine = np.clip((np.trace(C_se, axis1=1, axis2=2) - 1) / 2, -1, 1)
    turns = {
        "start": s.log.time[s.last[:-1] - 1],
        "end": s.log.time[s.first[1:]],
        "angle": np.arccos(cosine),
        "path": prediction.turn_path,
        **{f"error_{a}": error[:, i] for i, a in enumerate(AXES)},
        "residual": worst[2 * n :],
        "weight": estimate.weights[2 * n :],
    }
    return {"rests": rests, "turns": turns}


def unseen(data: Session, gravity_sd: float) -> list[str]:
    """Say what cannot be seen in principle, gravity known to `gravity_sd` [m/s^2]."""
    out = [
        references.wrong_gravity(gravity_sd),
        "How the body axes lie in the case: they are those of the accelerometers (see gauge).",
        *references.BEYOND_THE_SESSION,
    ]
    if data.log.gyro is not None and data.site.latitude is None:
        out.append(references.EARTH_ROTATION)
    first_rest = ((data.log.source.get("description") or {}).get("accel") or {}).get("first_rest")
    if not first_rest:
        out.append(
            "All three signs at once, and axes exchanged alike in both triads: the orientation "
            "of the first rest is not declared."
        )
    return out


def heading_sd(estimate: Estimate) -> float:
    """Return the standard deviation of the heading of the first rest, about up [rad]."""
    up, n = estimate.state.C_nb[0, 2, :], len(estimate.coefficients)
    return float(np.sqrt(up @ estimate.state_cov[n : n + 3, n : n + 3] @ up))


def noise_json(
    noise: SessionNoise, declared: bool, found: Mapping[str, float] = MappingProxyType({})
) -> dict[str, Any]:
    """Return noise, and scatter `found` beyond it [SI], as plain values for result.json."""
    return {
        "source": "declared" if declared else "measured in the rests",
        "accel_white": [float(v) for v in np.sqrt(noise.accel_psd)],
        "gyro_white": [float(v) for v in np.sqrt(noise.turn_psd)],
        "accel_repeatability": found.get(SCATTER["accel"], 0.0),
        "gyro_repeatability": found.get(SCATTER["gyro"], 0.0),
        "turn_repeatability": found.get(SCATTER["turns"], 0.0),
    }
