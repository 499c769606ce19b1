"""Judge a calibration on a rate table: can it be made, and is it right."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.checks import reversed_earth_check
from foucault.diagnose.fit_checks import Judged, folds
from foucault.diagnose.fit_checks import checks as fit_checks
from foucault.diagnose.rate_table.steps import lacking, name_of
from foucault.diagnose.words import check
from foucault.errors import Finding, error, finding
from foucault.infer import mixed
from foucault.infer.mixed import Covariance, Fit
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import ImuModel
from foucault.models.rate_steps import Steps
from foucault.procedures.rate_table.model import PRICE, RateTable
from foucault.result import Check
from foucault.units import plain

LARGE_DRIFT = 3.0
"""A bias that moves by more than this many times the noise of a step is no constant [1]."""

LARGE_TERM = 0.05
"""A scale factor that changes by more over its range is a wrong reading, not a gyro [1]."""

BLURRED = 1000.0
"""Coefficients this many times less certain together than each alone are not separated [1]."""

FOLDS = 5
"""Parts of the steps that are predicted from the others [1]."""


@dataclass(frozen=True)
class Solution:
    """A session on a rate table and what was made of it."""

    table: RateTable  # with the correlation time that was found
    fit: Fit
    site: Site  # gravity and latitude; None for a latitude that does not count

    @property
    def steps(self) -> Steps:
        """What was measured [SI]."""
        return self.table.steps

    @property
    def model(self) -> ImuModel:
        """The error model found."""
        model: ImuModel = self.fit.state
        return model

    @property
    def scatter(self) -> float:
        """Relative scatter of the rates that was found [1]."""
        return self.fit.found.get("rate scatter", 0.0)

    @property
    def bias_sd(self) -> float:
        """How far the bias was found to move [rad/s]."""
        return self.fit.found.get("bias drift", 0.0)

    @cached_property
    def speed(self) -> FloatArray:
        """True rate along each axis in its steps, with sign, shape (n,) [rad/s]."""
        e, v = (
            float(mixed.causes(self.fit, name).sum())
            for name in ("rate of the table", "unknown Earth rate")
        )
        return (self.steps.rate * (1.0 + e) + self.table.vertical + v) * self.steps.sense


def require_determined(table: RateTable, prior: CoefficientVector | None) -> None:
    """Refuse steps that cannot separate the coefficients.

    `prior` or None: what is known of the coefficients [SI].
    """
    steps, names = table.steps, table.names
    at = table.linearise(table.start)
    # What is unknown of table and place is known so far that it can hide no coefficient.
    noise = [s for s in at.sources if s.name == "gyro noise"]
    every = np.ones(len(steps))
    columns = Covariance(noise, {"gyro noise": 1.0}, (len(steps), 3), every).whiten(at.jacobian)
    if prior is not None:
        columns = np.concatenate([columns, np.diag(1.0 / prior.prior_sd)])
    size = np.linalg.norm(columns, axis=0)
    unit = columns / np.where(size > 0, size, 1.0)
    squares, directions = np.linalg.eigh(unit.T @ unit)
    weak = directions.T[squares < squares[-1] / BLURRED**2]
    if not len(weak):
        return
    seen_in = np.linalg.norm(weak, axis=0)
    blind = [n for n, share in zip(names, seen_in, strict=True) if share > 0.2]
    listed = ", ".join(blind)
    tied = all(n.startswith(("gyro.g_sensitivity.", "gyro.bias.")) for n in blind)
    if tied and any(n.startswith("gyro.g_sensitivity.") for n in blind):
        seen = dict.fromkeys(name_of(u) for u in steps.up)
        raise error("rate_table.g_sensitivity", placements=", ".join(seen), names=listed)
    reason = "; ".join(lacking(steps))
    raise error(
        "rate_table.undetermined", steps=len(steps), names=listed,
        reason=f": {reason}" if reason else "",
    )  # fmt: skip


def checks(e: Solution) -> tuple[Check, ...]:
    """Return every test of the result; a failed one carries its reason."""
    noise = e.table.noise
    judged = Judged(
        e.fit, {"steps": "steps"}, noise, e.steps.middle,
        found_in={"steps": ("gyro noise",) if noise == "unknown" else tuple(PRICE)},
        readings="steps", cure="Add rates.", more="add rates",
        cause={"steps": f"the rates scatter by {_ppm(e.scatter)} ppm"} if e.scatter else {},
        held_out=mixed.held_out(e.fit, folds(e.fit, "steps", FOLDS)),
    )  # fmt: skip
    sign = reversed_earth_check(e.fit.estimate.coefficients, e.site)
    return (*fit_checks(judged), *_bent(e), *_drift(e), *([] if sign is None else [sign]))


def _bent(e: Solution) -> list[Check]:
    """Judge how much the scale factors change with the rate, where that is estimated."""
    if e.model.straight:
        return []
    top = float(np.abs(e.steps.rate).max())
    change = np.maximum(np.abs(e.model.gyro_asymmetry), np.abs(e.model.gyro_cubic) * top**2)
    ppm = 1e6 * float(change.max())
    return [check("scale factor terms", "scale factor terms", ppm, None, 1e6 * LARGE_TERM)]


def _drift(e: Solution) -> list[Check]:
    """Judge a bias that moves: within the noise it is any gyro's, beyond it a constant is wrong."""
    if not e.bias_sd:
        return []
    noise = np.sqrt(np.trace(e.steps.cov, axis1=1, axis2=2) / 3)
    value = float(e.bias_sd / np.median(noise))
    return [check("bias drift", "bias drift", value, None, LARGE_DRIFT, {"moved": moved(e)})]


def moved(e: Solution) -> str:
    """Say how far the bias moved, and how fast."""
    size, time = plain(float(np.degrees(e.bias_sd)) * 3600, 2), e.table.bias_time
    if time == 0.0:
        return f"{size} deg/h (sd) from step to step"
    if np.isinf(time):
        return f"{size} deg/h (sd) along a straight line, and is that of the middle of the session"
    return f"{size} deg/h (sd) over {plain(time / 60, 2)} min"


def _ppm(share: float) -> str:
    return f"{1e6 * share:.3g}"


def hints(e: Solution) -> list[Finding]:
    """Return findings about the session: outliers, scatter, an unknown latitude."""
    out = []
    norms = mixed.norms(e.fit.at, e.fit.covariance)
    for k in e.fit.outliers.tolist():
        rate = plain(float(np.degrees(e.steps.rate[k])), 4)
        words = {"step": k + 1, "rate": rate, "placement": name_of(e.steps.up[k])}
        out.append(finding("rate_table.outlier", norm=f"{norms[k]:.0f}", **words))
    if e.scatter:
        out.append(finding("rate_table.scatter", ppm=_ppm(e.scatter)))
    if e.bias_sd:
        out.append(finding("rate_table.bias_moved", moved=moved(e)))
    if e.table.latitude is None:
        sd = np.degrees(EARTH_RATE / np.sqrt(3)) * 3600
        out.append(finding("rate_table.no_latitude", sd=f"{sd:.1f}"))
    return out
