"""Judge the calibration of a session: what is its own beside what every fit shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.diagnose import fit_checks
from foucault.diagnose.coverage import Coverage
from foucault.diagnose.fit_checks import Judged, Limit
from foucault.diagnose.hand_rotated.held_out import UNDETERMINED, norm_noise
from foucault.diagnose.words import check
from foucault.estimate import norm_observation
from foucault.estimate.hand_rotated.likelihood import SCATTER, middle, session_of
from foucault.infer.mixed import Fit, HeldOut
from foucault.models.rests_and_turns import Session
from foucault.models.session_noise import QUIETEST
from foucault.result import Check, Level

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

EXTRAPOLATED = 10.0
"""Rests left out that are known so many times worse than measured ones are extrapolated [1]. With
two rests a coefficient it is 1.7, with as many coefficients as rests without bound."""

DOMINATE = 0.85
"""Where a quarter of the residuals or fewer make more than this part of their sum, they are its
cause [1]; of residuals that are spread as chance spreads them a quarter makes some 0.7 at most."""

QUIETER = 5.0
"""The threshold of rests to try where a hand shook them [1]."""

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
    """Return what every fit is asked, of a session.

    `rest_level` (n,): how noisy each rest is, 1 is quiet [1].
    """
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
    )  # fmt: skip
    return replace(found, cause=_causes(found, rest_level)) if declared else found


def checks(e: Judged, coverage: Coverage, rest_level: FloatArray) -> tuple[Check, ...]:
    """Return every test of the result; a failed one carries its reason.

    `rest_level` (n,): how noisy each rest is, 1 is quiet [1].
    """
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
    drift = fit_checks.clearest_drift(e) if contradicted else None
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
        if drift is not None and drift.significant:
            out[kind] = (
                f"a drift of {drift.name} during the session makes them, at least in part, not the "
                "declared noise"
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
