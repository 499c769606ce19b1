"""How a tumble is solved, and what it says of the coefficients."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.errors import Finding, Status, error, finding
from foucault.estimate.earth_seen import EarthSeen
from foucault.estimate.tumble import fit as estimation
from foucault.estimate.tumble import published
from foucault.estimate.tumble.budget import sources
from foucault.estimate.tumble.earth import earth_in
from foucault.estimate.tumble.fit import Fit, Prior, Tumble
from foucault.models import cluster
from foucault.models.cluster import LAYOUT, angle_rates, angles_of
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise
from foucault.models.rotation import exp, turned
from foucault.procedures.platform_tumble.problem import is_slow, shifted
from foucault.procedures.platform_tumble.settings import Settings

SHIFTS = 4
"""So often a delay is put back by whole intervals [1]."""

SEARCHED = 4
"""Azimuths tried where the first start leads nowhere [1]."""

BETTER = 3.0
"""A command relative to the ground must fit so many times better to be spoken of [1]."""


@dataclass(frozen=True)
class Solution:
    """A tumble solved, with what led to it."""

    tumble: Tumble  # the log as it was solved
    prior: Prior  # what was known beforehand, as it was solved
    fit: Fit
    least: FloatArray  # (46, 46) the bound of its covariance, in the order of `Fit.cov`
    # (46, 46) covariance by what the filter does not weigh, source by source
    owed: dict[str, FloatArray]
    settings: Settings
    site: Site
    noise: ImuNoise  # noise that was weighed [SI]
    advice: str = ""  # how a published filter ended, in words
    findings: tuple[Finding, ...] = ()

    @property
    def slow(self) -> bool:
        """Whether noise that is not white was declared."""
        return is_slow(self.noise.accel) or is_slow(self.noise.gyro)

    @property
    def earth(self) -> EarthSeen | None:
        """What the session says of the Earth's rate."""
        assert self.site.latitude is not None
        return earth_in(self.tumble, self.prior, self.fit, self.site.latitude,
                        self.settings.latitude_sd)  # fmt: skip


def solved(
    tumble: Tumble, prior: Prior, settings: Settings, site: Site, noise: ImuNoise, *,
    measured: bool = False, moments: int = 0,
) -> Solution:  # fmt: skip
    """Solve a tumble by the filter that was chosen.

    `noise`: noise [SI]; `measured`: the noise of the accelerometers was measured: what the fit
    leaves says it better; `moments`: in how many moments the estimate is kept for its course in
    time [1].
    """
    told, advice = [], ""
    if settings.filter == "gauss-newton":
        fit, tumble, prior = _solve(tumble, prior, settings)
        if measured and fit.status is Status.CONVERGED:
            scale = fit.chi_square / max(fit.residuals - len(LAYOUT), 1)
            tumble = replace(tumble, accel_variance=tumble.accel_variance * scale)
            fit = estimation.linearised(tumble, prior, fit)
        elif not _explains(fit):
            told += _relative(tumble, prior, fit, settings)
        if moments and len(fit.time):
            fit = estimation.linearised(tumble, prior, fit, moments=moments)
        least = fit.cov
    else:
        fit, least, advice = _filter(tumble, prior, settings.filter, moments)
        told.append(finding("tumble.filter", filter=settings.filter, advice=advice))
    owed = owed_by(tumble, prior, fit, settings, site, noise)
    return Solution(tumble, prior, fit, least, owed, settings, site, noise, advice, tuple(told))


def _relative(tumble: Tumble, prior: Prior, fit: Fit, settings: Settings) -> list[Finding]:
    """Try whether the command is one relative to the ground."""
    C_pn, rows = prior.mean.C_np.T, []
    for turn in exp(-tumble.command * tumble.dt[:, None]):
        rows.append(C_pn @ tumble.w_ie_n)
        C_pn = turn @ C_pn
    other = estimation.solve(
        replace(tumble, command=tumble.command + np.array(rows)), prior, passes=settings.passes
    )
    if other.status is not Status.CONVERGED:
        return []
    times = np.sqrt(fit.chi_square / max(other.chi_square, 1e-300))
    if fit.status is Status.CONVERGED and times < BETTER:
        return []
    if other.chi_square > BETTER**2 * other.residuals:
        return []
    return [finding("tumble.relative", times=f"{times:.3g}")]


def _solve(tumble: Tumble, prior: Prior, settings: Settings) -> tuple[Fit, Tumble, Prior]:
    """Solve, from other azimuths too where the first start does not explain the readings.

    A delay of more than half an interval is put back by whole ones, so that what is left of it is
    small enough to be linear; log and prior are returned as they were solved.
    """
    fit = estimation.solve(tumble, prior, passes=settings.passes)
    if not _explains(fit):
        other = _elsewhere(tumble, prior, settings)
        worse = fit.status is not Status.CONVERGED
        if other is not None and (worse or other.chi_square < 0.5 * fit.chi_square):
            fit = other
    for _ in range(SHIFTS if settings.delay_sd else 0):
        # What is left must be no less than zero: before it, another command may have held.
        rows = int(np.floor(fit.start.delay / float(np.median(tumble.dt)) + 0.01))
        if rows == 0:
            break
        tumble, prior = shifted(tumble, prior, rows)
        fit = estimation.solve(tumble, prior, passes=settings.passes)
    return fit, tumble, prior


def _explains(fit: Fit) -> bool:
    return fit.status is Status.CONVERGED and fit.chi_square < 2 * fit.residuals


def _elsewhere(tumble: Tumble, prior: Prior, settings: Settings) -> Fit | None:
    """Search the azimuth that was said to be known: it may be wrong by any angle."""
    wide = replace(prior, sd=np.concatenate([[np.pi] * 3, prior.sd[3:]]))
    level = estimation.levelled(tumble, prior)
    found = []
    for k in range(1, SEARCHED + 1):
        about = exp(np.array([0.0, 0.0, 2 * np.pi * k / SEARCHED]))
        start = replace(level, C_np=about @ level.C_np)
        found.append(estimation.solve(tumble, wide, start, passes=settings.passes))
    good = [fit for fit in found if _explains(fit)]
    if not good:
        return None
    best = min(good, key=lambda fit: fit.chi_square)
    return estimation.solve(tumble, prior, best.start, passes=settings.passes)


def _filter(tumble: Tumble, prior: Prior, name: str, moments: int) -> tuple[Fit, FloatArray, str]:
    """Run a published filter; return it as a solution, the bound, and what to say of it."""
    if prior.sd[-1] > 0:
        raise error("tumble.filter_delay", filter=name)
    options = published.LITERAL if name == "published literal" else published.ANNEALED
    found = published.filter_angles(tumble, prior, options, moments=max(moments, 2))
    start = estimation.beginning(tumble, prior, found.constants, found.C_np)
    at = estimation.bound(tumble, prior, start, rows=True)
    cov = np.zeros_like(at.cov)
    cov[:45, :45] = found.cov
    history = published.history(tumble, found, start) if moments else None
    fit = replace(
        at,
        C_np=found.C_np,
        cov=cov,
        status=found.status,
        passes=1,
        late=(0.0, 0.0),
        history=history,
    )
    return fit, at.cov, found.advice


def owed_by(
    tumble: Tumble, prior: Prior, fit: Fit, settings: Settings, site: Site, noise: ImuNoise
) -> dict[str, FloatArray]:
    """Return the covariance by what the filter does not weigh: slow noise, latitude, gravity.

    `noise`: noise [SI].
    """
    if fit.status is not Status.CONVERGED:
        return {}  # there is no solution to be moved
    assert site.latitude is not None
    slow = noise.accel.bias_instability / site.gravity, noise.accel.random_walk / site.gravity
    accel = replace(noise.accel, bias_instability=slow[0], random_walk=slow[1])
    return sources(
        tumble, prior, fit.start, accel=accel, gyro=noise.gyro, latitude=site.latitude,
        latitude_sd=settings.latitude_sd, gravity_sd=site.gravity_sd / site.gravity,
    )  # fmt: skip


def coefficients(s: Solution) -> CoefficientVector:
    """Name what was found."""
    factor = 1 / cluster.normalised(s.site.gravity)
    angles = angles_of(s.fit.C_np.T)
    values = np.concatenate([s.fit.start.constants * factor, angles])
    sd = np.concatenate([s.prior.sd[3:45] * factor, np.full(3, np.inf)])
    cov = np.sum(list(parts(s).values()), axis=0)
    return CoefficientVector(LAYOUT, values, cov, prior_sd=sd)


def parts(s: Solution) -> dict[str, FloatArray]:
    """Split the covariance of the coefficients by source, each shape (45, 45)."""
    out = {"noise and prior": public(s, s.fit.cov)}
    return out | {name: public(s, cov) for name, cov in s.owed.items()}


def public(s: Solution, cov: FloatArray) -> FloatArray:
    """Return the covariance of the 45 coefficients, shape (45, 45) [SI].

    `cov` (46, 46): in the order and units of `Fit.cov`.
    """
    to_public = np.zeros((len(LAYOUT), estimation.STATES))
    to_public[:42, 3:45] = np.diag(1 / cluster.normalised(s.site.gravity))
    # d angles = T dphi, dphi in p: truth ahead.
    to_public[42:, :3] = angle_rates(angles_of(s.fit.C_np.T))
    out = np.asarray(to_public @ cov @ to_public.T)
    out[42:, 42:] += _bent(s.fit.C_np, cov[:3, :3])
    return out


def _bent(C_np: FloatArray, cov: FloatArray) -> FloatArray:
    """Return what the bend of the angles adds to their covariance, shape (3, 3).

    An azimuth known to a few degrees bends outer and inner angle beyond the linear. Along each
    principal axis of the covariance the second difference d of the angles is what z^2 / 2 of a
    normal z multiplies, with the second moment 3/4 d d'.
    """
    out = np.zeros((3, 3))
    for variance, axis in zip(*(part.T for part in np.linalg.eigh(cov)), strict=True):
        step = np.sqrt(max(variance, 0.0)) * axis
        ends = np.array([angles_of((C_np @ exp(sign * step)).T) for sign in (-1.0, 0.0, 1.0)])
        second = turned(ends[2] - ends[1]) - turned(ends[1] - ends[0])
        out += 0.75 * np.outer(second, second)
    return out
