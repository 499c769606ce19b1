"""What would explain a transfer alignment that does not fit: a lever arm, or a prior.

A lever arm that is wrong by d makes the velocities differ by ``C_nm (w x d)``, which the free run's
equations take as three states more. A prior that is too narrow is found by doing without it: what
the messages alone say then lies beyond it, and the innovations fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from foucault import units
from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.transfer.checks import EACH, Evidence, fits, spreads, whiteness
from foucault.errors import Finding, finding
from foucault.estimate.chi_square import FALSE_ALARM, chi_square_limits
from foucault.estimate.transfer.likeliest import likeliest_flexure
from foucault.infer import filtered
from foucault.infer.filtered import Component
from foucault.infer.linear_filter import extended, kalman
from foucault.models.rotation import cross_matrix, exp
from foucault.units import plain

FAR = 10.0
"""A lever arm of which nothing is said is known so well [m]."""

UNSETTLED = 1.0
"""The velocity at the start may be wrong by this where the lever arm is [m/s]."""

LONG, SEEN = 0.05, 0.5
"""A shorter lever arm is none; a component that is known worse is not seen [m]."""

LEFT = 0.3
"""An arm leaves at most this part of what is too large about the innovations [1]."""

NEARLY = 1.2
"""With the arm that is found innovations may be so many times as large as allowed [1]."""

SURELY = 1e-4
"""False-alarm rate of a lever arm [1]."""

OUTLIER, FEW, MOST = 8.0, 0.01, 5
"""An innovation of so many standard deviations is none of this noise; if at most this part of the
messages has such; so many are named [1]."""

BENDS = 10.0
"""A bending that makes the innovations likelier by less is none, as a log-likelihood [1]."""

VISIBLE = 1e-6
"""A direction of which the messages say less, in units of its prior, is not tested [1]."""

WIDER = np.logspace(0.0, 4.0, 81)
"""So many times as wide a prior is tried [1]."""

ALIKE = 6.0
"""Explanations whose log-likelihoods differ by less than half of it are not told apart [1]."""

LOOSE = 100.0
"""Without priors means with priors so many times as wide [1]."""


@dataclass(frozen=True)
class LeverArm:
    """What the velocities say of the lever arm."""

    arm: FloatArray  # (3,) from the master to the slave, in the master's axes [m]
    cov: FloatArray  # (3, 3) its covariance, by how the innovations scatter [m^2]
    gain: float  # by how much the log-likelihood is higher than with the one that was given [1]
    # ratio, high: root mean square of the velocities' innovations, standardised, and its limit [1]
    ratio: float
    high: float

    @property
    def sd(self) -> FloatArray:
        """Standard deviation of each component, shape (3,) [m]."""
        return np.asarray(np.sqrt(np.diag(self.cov)))

    def off(self, other: FloatArray) -> float:
        """Return how far another arm is, squared, in standard deviations [1].

        `other` (3,): the other arm [m].
        """
        d = self.arm - other
        return float(d @ np.linalg.solve(self.cov, d))


def lever_arm(e: Evidence) -> LeverArm | None:
    """Find the lever arm beside all that was estimated; None where velocities are not used."""
    if not np.isfinite(e.model.matching.velocity_sd):
        return None
    system = extended(e.fit.system, leverage(e), FAR)
    system.P0[range(3, 6), range(3, 6)] += UNSETTLED**2
    run = kalman(system)
    d, cov = run.states[-1, -3:], run.cov[-3:, -3:]
    if not (np.isfinite(d).all() and np.isfinite(cov).all()):
        return None
    gain = 0.5 * float(d @ np.linalg.solve(cov, d))
    scatter = Component.of(run.white[:, e.model.kinds["velocity"]], EACH)
    if scatter is None:
        return None
    cov = cov * max(1.0, scatter.ratio**2 * scatter.count / scatter.independent)
    return LeverArm(e.model.mount.lever_m + d, cov, gain, scatter.ratio, scatter.high)


def leverage(e: Evidence) -> FloatArray:
    """Return ``C_nm [w x]`` at the messages, which a lever arm is multiplied by in velocities.

    Returns (m, 6, 3): velocity per length [1/s].
    """
    system, C_ms = e.fit.system, e.model.mount.C_ms @ exp(e.fit.point.installation)
    turning = e.model.master.C_nm[system.used] @ cross_matrix(system.w_ib_b @ C_ms.T)
    return np.concatenate([turning, np.zeros_like(turning)], axis=1)


def of_lever(e: Evidence) -> list[Finding]:
    """Say so where the velocities show another lever arm than was given."""
    found, given = lever_arm(e), e.model.mount.lever_m
    if found is None or found.off(given) < chi_square_limits(3, 2 * SURELY)[1]:
        return []
    now = spreads(e)["velocity"]
    little = now.ratio > now.high and found.ratio**2 - 1.0 > LEFT * (now.ratio**2 - 1.0)
    if little or found.ratio > NEARLY * found.high:
        return []  # something else is wrong, of which an arm takes a part
    seen = found.sd < SEEN
    if not np.linalg.norm((found.arm - given)[seen]) > LONG:
        return []
    arm = np.where(seen, found.arm, given)
    said = "none was given"
    if np.linalg.norm(given) > 0:
        said = f"what was given is {_metres(given)} m{_named(found, given)}"
    written = ", ".join(f'"{x:.3f} m"' for x in arm)
    return [finding("transfer.lever", found=_metres(found.arm), sd=_metres(found.sd), said=said,
                    gain=f"{found.gain:.0f}", written=written)]  # fmt: skip


def _metres(x: FloatArray) -> str:
    return "(" + ", ".join(f"{v:.3f}" for v in x) + ")"


def _named(found: LeverArm, given: FloatArray) -> str:
    """Say which mistake would have made the given arm of the one that is found."""
    others = {
        "the opposite of it": -given,
        "it with x reversed": given * [-1.0, 1.0, 1.0],
        "it with y reversed": given * [1.0, -1.0, 1.0],
        "it with z reversed": given * [1.0, 1.0, -1.0],
        "it with x and y exchanged": given[[1, 0, 2]],
        "it with forward, right, down taken for right, forward, up": given[[1, 0, 2]] * [1, 1, -1],
        "none at all": 0.0 * given,
    }
    # Arms are measured with a tape: some centimetres are no other arm.
    near = replace(found, cov=found.cov + LONG**2 * np.eye(3))
    off = {words: near.off(arm) for words, arm in others.items()}
    best = min(off, key=lambda words: off[words])
    clear = off[best] < min(chi_square_limits(3)[1], near.off(given))
    return f": what shows is {best}" if clear else ""


def narrow(e: Evidence) -> list[tuple[str, CoefficientVector]]:
    """Return the priors that what is found contradicts, where the innovations fit without them.

    Returns group, and what the messages alone say of its coefficients; none where all is as it
    was said to be, or where innovations are too large without priors too [SI].
    """
    suspects = contradicted(e)
    if not suspects and fits(e):
        return []
    # What priors hide of each other cannot be told: each that would do is named.
    named = [one for group in suspects for one in _freed(e, [group])]
    return named or _freed(e, _groups(e))


def _groups(e: Evidence) -> list[str]:
    return list(dict.fromkeys(n.rpartition(".")[0] for n in e.states.names if n != "master.delay"))


def contradicted(e: Evidence) -> list[str]:
    """Return the groups whose prior the messages contradict, those that explain it best.

    With u the estimate less its prior mean in units of its sd, and ``V = I - P`` with P its
    covariance in these units, ``u' V^+ u`` is chi-square where the prior is right [1]_: a prior
    that is narrow draws the estimate to itself, and makes u and V small alike.

    References
    ----------
    .. [1] C. R. Rao, "Large sample tests of statistical hypotheses", 1948 (the score test).
    """
    c, groups = e.states, _groups(e)
    assert c.cov is not None
    if not e.fit.nominal or not np.isfinite(c.cov).all():
        return []
    gains: dict[str, float] = {}
    for group in groups:
        at = c.layout.group(group)
        sd = c.prior_sd[at]
        u = (c.values - e.prior.values)[at] / sd
        size, axes = np.linalg.eigh(np.eye(len(at)) - c.cov[np.ix_(at, at)] / np.outer(sd, sd))
        seen = size > VISIBLE
        w, own = (axes.T @ u)[seen], size[seen]
        if not seen.any() or float(np.sum(w**2 / own)) < chi_square_limits(
            int(seen.sum()), 2 * FALSE_ALARM, len(groups)
        )[1]:  # fmt: skip
            continue
        # Twice the gain in log-likelihood by a prior that is k times as wide, the best k.
        more = (WIDER[:, None] ** 2 - 1.0) * own
        gain = np.sum(more / (1.0 + more) * w**2 / own - np.log1p(more), axis=1)
        gains[group] = float(gain.max())
    best = max(gains.values(), default=0.0)
    return [g for g in sorted(gains, key=lambda g: -gains[g]) if gains[g] > max(best - ALIKE, 0.0)]


def _freed(e: Evidence, groups: Sequence[str]) -> list[tuple[str, CoefficientVector]]:
    """Return what the messages say of groups whose priors are wide, those that were wrong."""
    loose = [i for group in groups for i in e.model.layout.group(group)]
    if "installation" in groups:
        loose += [0, 1, 2]  # the start is turned as the mounting is
    wide = e.model.sd.copy()
    wide[loose] *= LOOSE
    found = filtered.fit(replace(e.model, sd=wide), passes=4, settled=1.0)
    freed = replace(e, fit=found)
    if not np.isfinite(found.run.white).any() or not fits(freed):
        return []
    alone, mean = freed.states, e.prior.values
    limit = np.sqrt(chi_square_limits(1, FALSE_ALARM, len(alone))[1])
    off = np.abs(alone.values - mean) / np.hypot(alone.sd, alone.prior_sd)
    wrong = {n.rpartition(".")[0] for n, x in zip(alone.names, off, strict=True) if x > limit}
    return [(group, alone[group]) for group in groups if group in wrong]


def of_priors(e: Evidence, priors: Sequence[tuple[str, CoefficientVector]]) -> list[Finding]:
    """Name the priors without which the innovations would fit."""
    out = []
    for group, alone in priors:
        mean = e.prior.values[[e.prior.layout.index(name) for name in alone.names]]
        away = alone.values - mean
        k = int(np.argmax(np.abs(away) / alone.prior_sd))
        kind = alone.layout.coefficients[k].kind
        unit = units.display_unit(kind, float(np.abs(away).max()))

        def said(value: float, kind: str = kind, unit: str = unit) -> str:
            return f"{plain(units.convert(float(value), kind, unit), 2)} {unit}"

        out.append(finding(
            "transfer.prior", group=group, name=alone.names[k], found=said(alone.values[k]),
            mean=said(mean[k]), prior=said(alone.prior_sd[k]),
            wide=said(2.0 * float(np.abs(away).max())),
        ))  # fmt: skip
    return out


def of_flexure(e: Evidence) -> list[Finding]:
    """Offer the bending of the mount that makes the innovations likeliest, where one is seen."""
    if not e.fit.nominal or not np.isfinite(e.model.matching.attitude_sd):
        return []
    fit = likeliest_flexure(e.model, e.fit.point, e.fit.run.log_likelihood)
    if fit.gain < BENDS:
        return []
    worst, limit = whiteness(fit.run)
    good = worst <= limit and fits(replace(e, fit=replace(e.fit, run=fit.run)))
    left = "innovations are then as they should be" if good else "something else is left"
    arcmin = np.radians(1 / 60)
    return [finding(
        "transfer.flexure", sd=plain(fit.sd / arcmin, 3), time=plain(fit.time, 2),
        noise=plain(fit.attitude_sd / arcmin, 3), gain=f"{fit.gain:.0f}", left=left,
    )]  # fmt: skip


def of_outliers(e: Evidence) -> list[Finding]:
    """Name the few messages that are off, where the others fit."""
    u, system = e.fit.run.white, e.fit.system
    with np.errstate(invalid="ignore"):
        off = np.asarray((np.abs(u) > OUTLIER).any(axis=1))
    if not 0 < np.sum(off) <= FEW * len(u):
        return []
    without = replace(system, R=np.where(off[:, None], np.inf, system.R))
    if not fits(replace(e, fit=replace(e.fit, run=kalman(without)))):
        return []
    times = system.time[off] + e.fit.point.delay
    shown = ", ".join(plain(round(float(t), 2), 13) for t in times[:MOST])
    more = f" and {len(times) - MOST} more" if len(times) > MOST else ""
    return [finding("transfer.outliers", count=len(times), limit=f"{OUTLIER:g}",
                    worst=plain(float(np.nanmax(np.abs(u))), 2), times=shown + more)]  # fmt: skip
