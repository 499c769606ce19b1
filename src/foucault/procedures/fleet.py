"""Norm observation of many instruments on one plan: solved in one batch, a result for each.

The batch is the linear solution of `norm_observation`; what `calibrate` finds out beside it for a
single instrument (which reading is wrong, a likelihood of all readings) is not done. Instead the
fleet itself says how large the noise is: its typical residuals, and whose are larger than that.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from typing import Any

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IndexArray
from foucault.coefficients import CoefficientVector
from foucault.detect import match as position_match
from foucault.detect.coverage import coverage, coverage_json
from foucault.diagnose import table as batch
from foucault.diagnose.checks import LARGEST_BIAS, PLAUSIBLE, plausible_scales, status_check
from foucault.diagnose.table import UNKNOWN_NOISE
from foucault.errors import FoucaultError, Status, error, finding
from foucault.estimate import fleet
from foucault.estimate.fleet import FleetEstimate, FleetReadings
from foucault.estimate.table import ENOUGH, TableModel, free_start
from foucault.infer.gauss_newton import FALSE_ALARM, chi_square_limits
from foucault.models import turntable
from foucault.models.earth import Site
from foucault.models.imu import EQUATION, FRAME, LAYOUT, LINEAR_LOWER, Gauge
from foucault.models.layouts import gravity_error, rate_slope, with_references
from foucault.models.left_out import Sizes, changes, terms
from foucault.models.noise import Readings
from foucault.models.turntable import TablePlan, up_k
from foucault.plans.directions import table_plan
from foucault.plans.efficiency import refuse_singular
from foucault.procedures import left_out, on_table
from foucault.procedures.norm_observation import Settings, task_of
from foucault.result import Check, Result, Verdict

WHY = {
    "singular": "the readings do not determine all coefficients",
    "no ellipsoid": "the readings do not lie on an ellipsoid",
    "not finite": "a reading is not finite",
}
"""Status of the kernel in words."""


def suits(settings: Any, site: Site, prior: Mapping[str, Any] | None) -> bool:
    """Tell whether the batch solves what was asked, so that nothing asked for is left out.

    `settings`: those of the procedure, of another procedure than norm observation it never does;
    `prior` or None: what is known beforehand, the linear equations cannot take it.
    """
    return (
        isinstance(settings, Settings)
        and settings.solution == "linear"
        and settings.unification == "parallel vectors"
        and settings.earth_rate
        and site.latitude is not None
        and not (settings.accel_quadratic or settings.g_sensitivity or settings.rate_sd or prior)
        and enough(plan_of(settings))
    )


def plan_of(settings: Settings) -> TablePlan:
    """Return the plan of the campaign; times are only nominal."""
    return table_plan(
        settings.chosen, spin_rate=settings.spin_rate, rest_time=max(settings.shortest, 1e-3),
        turns=1, both_senses=settings.both_senses, four_positions=settings.four_positions,
    )  # fmt: skip


def enough(plan: TablePlan) -> bool:
    """Tell whether a plan has rests and spins enough for the linear equations."""
    spins = int(np.sum(plan.rate != 0))
    return min(spins, len(plan) - spins) >= fleet.NEEDED


def arranged(readings: Readings, plan: TablePlan) -> Readings:
    """Return readings in the order of the plan, one for each of its positions.

    Raises ``fleet.positions``: some are missing, repeated or elsewhere.
    """
    if readings.accel is None or readings.gyro is None:
        missing = "accelerometers" if readings.accel is None else "gyros"
        raise error("fleet.positions", plan=plan.name, what=f"there are no {missing}")
    row = position_match.with_plan(readings, plan, True).row
    counts = np.bincount(row[row >= 0], minlength=len(plan))
    said = []
    for words, numbers in (
        ("missing", np.flatnonzero(counts == 0)), ("repeated", np.flatnonzero(counts > 1))
    ):  # fmt: skip
        if len(numbers):
            said.append(f"{words} {_numbers(numbers)} of {len(plan)}")
    if (row < 0).any():
        said.append(f"{int(np.sum(row < 0))} elsewhere")
    if said:
        raise error("fleet.positions", plan=plan.name, what="; ".join(said))
    return readings[np.argsort(row)]


def _numbers(numbers: IndexArray, most: int = 6) -> str:
    more = " and others" if len(numbers) > most else ""
    return "number " + ", ".join(str(k + 1) for k in numbers[:most]) + more


@dataclass(frozen=True)
class Batch:
    """Many instruments solved together."""

    readings: Sequence[Readings]  # of each instrument, in the order of the plan [SI]
    settings: Settings
    site: Site
    estimate: FleetEstimate  # coefficients with the covariance that the noise as it was found gives
    # (N, 2) sums of squared norm residuals over the variances that the noise of the fleet gives [1]
    chi_square: FloatArray
    common: FloatArray  # (2,) factor of the variances that the fleet shows [1]
    # (N, 2) another factor for an instrument whose residuals are larger than those of the fleet [1]
    own: FloatArray
    # (p, p) covariance that what is not estimated adds; None where it is taken for nothing [SI]
    beside: FloatArray | None = None

    @cached_property
    def high(self) -> tuple[float, ...]:
        """Largest chi-square of an instrument that chance explains."""
        return limits(self.estimate.redundancy, int(self.estimate.solved.sum()))

    @cached_property
    def _shared(self) -> dict[str, Any]:
        """What is the same for all instruments."""
        first = self.readings[0]
        up = up_k(first.angles)
        covered = coverage(up[~first.spin])
        task = task_of(self.settings)
        return {
            "coverage": coverage_json(covered, int(np.sum(~first.spin))),
            "unseen": batch.unseen(
                first, self.site, task.settings.table_rate_sd, None, quadratic=False
            ),
        }

    def problem(self, i: int) -> FoucaultError | None:
        """Return why instrument `i`, shape () [1], has no result, None where it has one."""
        word = fleet.STATUS[self.estimate.status[i]]
        return None if word == "solved" else error("fleet.unsolved", why=WHY[word])

    def __len__(self) -> int:
        return len(self.readings)

    @cached_property
    def sd(self) -> FloatArray:
        """Standard deviations as `result` has them, shape (N, p) [SI]; NaN where not solved."""
        variance = self.estimate.packed[:, fleet.DIAGONAL]
        # What gravity and the rate of the table do to a coefficient is linear in it.
        nil, one = (
            CoefficientVector(LAYOUT.subset(LINEAR_LOWER), np.full(len(LINEAR_LOWER), x))
            for x in (0.0, 1.0)
        )
        rate_sd = self.settings.table_rate_sd
        for at0, at1 in (
            (gravity_error(nil, self.site), gravity_error(one, self.site)),
            (rate_slope(nil) * rate_sd, rate_slope(one) * rate_sd),
        ):
            variance = variance + (at0 + self.estimate.values * (at1 - at0)) ** 2
        if self.beside is not None:
            variance = variance + np.diag(self.beside)
        return np.asarray(np.sqrt(variance))

    @cached_property
    def sure(self) -> BoolArray:
        """Which instruments pass all checks of `checks`, shape (N,), as far as all say it at once.

        Where the fleet is too small to say it, none: `checks` tells each.
        """
        e, out = self.estimate, self.estimate.solved
        known = ENOUGH if self._unknown(0) else 0.0
        if (e.redundancy < 0.5).any() or (e.redundancy * int(out.sum()) < known).any():
            return np.zeros(len(self), bool)
        scales = [k for k, name in enumerate(LINEAR_LOWER) if ".scale." in name]
        biases = [k for k, name in enumerate(LINEAR_LOWER) if name.startswith("gyro.bias.")]
        limits = np.array([batch.LARGE[kind] for kind in batch.TRIADS])
        with np.errstate(invalid="ignore"):
            out = out & (np.abs(e.values[:, scales]).max(axis=1) < PLAUSIBLE / 100)
            out &= np.abs(e.values[:, biases]).max(axis=1) < np.radians(LARGEST_BIAS)
            out &= (self.chi_square <= self.high).all(axis=1) & (e.noise < limits).all(axis=1)
        return np.asarray(out)

    def checks(self, i: int, coefficients: CoefficientVector) -> tuple[Check, ...]:
        """Return the checks of instrument `i`, shape () [1], with its `coefficients` [SI]."""
        return (
            status_check(Status.CONVERGED, ()),
            *plausible_scales(coefficients),
            *self._noise_checks(i),
        )

    def result(self, i: int) -> Result:
        """Return the result of instrument `i`, shape () [1], which must have been solved."""
        readings, rate_sd = self._with_noise(i), self.settings.table_rate_sd
        coefficients = with_references(self.estimate.coefficients(i), self.site, rate_sd)
        told = tuple(f for f in readings.findings if f.code != UNKNOWN_NOISE)
        if self.beside is not None:
            assert coefficients.cov is not None
            coefficients = replace(coefficients, cov=coefficients.cov + self.beside)
            told = (*told, finding("left_out.untested"))
        checks = self.checks(i, coefficients)
        site = self.site
        return Result(
            procedure="norm_observation",
            coefficients=coefficients,
            equation=EQUATION,
            frame=FRAME,
            gauge=Gauge.LOWER.value,
            verdict=Verdict.of(checks),
            checks=checks,
            findings=told,
            status=Status.CONVERGED,
            site=site.as_dict(),
            diagnostics=self._diagnostics(i),
            tables={
                "readings": batch.readings_of_many(
                    readings, coefficients, self.estimate.lever_arm[i], site
                ),
                "rig": batch.rig_of_many(*self._arm(i)),
            },
        )

    def _with_noise(self, i: int) -> Readings:
        r, factor = self.readings[i], self.common * self.own[i]
        return replace(r, accel_cov=r.accel_cov * factor[0], gyro_cov=r.gyro_cov * factor[1])

    def _noise_checks(self, i: int) -> list[Check]:
        e, n = self.estimate, int(self.estimate.solved.sum())
        out = [
            batch.explained(
                t, float(self.chi_square[i, t]), self.high[t], float(d),
                shared=float(d * n) if self._unknown(i) else None,
            )
            for t, d in enumerate(e.redundancy)
        ]  # fmt: skip
        tested = [t for t, d in enumerate(e.redundancy) if d >= 0.5]
        return out + [batch.scatter(t, float(e.noise[i, t])) for t in tested]

    def _unknown(self, i: int) -> bool:
        return any(f.code == UNKNOWN_NOISE for f in self.readings[i].findings)

    def _diagnostics(self, i: int) -> dict[str, Any]:
        kinds = ("accel at rest", "gyro in spins")
        settings = self.settings
        return {
            "gravity": self.site.gravity,
            "plan": settings.plan if settings.positions is None else "own positions",
            "noise": {"source": self._source(i), "sd": self.estimate.noise[i].tolist()},
            "chi_square": {
                kind: [float(self.chi_square[i, t]), 0.0, self.high[t], float(d)]
                for t, (kind, d) in enumerate(zip(kinds, self.estimate.redundancy, strict=True))
                if d >= 0.5
            },
            "batch": len(self),
            **self._shared,
        }

    def _arm(self, i: int) -> tuple[FloatArray, FloatArray]:
        """Return the lever arm and its covariance; nothing where it was held at zero."""
        e, wanted = self.estimate, slice(None) if self.settings.lever_arm else slice(0)
        return e.lever_arm[i][wanted], e.lever_arm_cov[i][wanted, wanted]

    def _source(self, i: int) -> str:
        if self._unknown(i):
            return "the residuals of the fleet"
        return "declared" if self.readings[i].declared else "measured in the readings"


def solve(
    readings: Sequence[Readings], settings: Settings, site: Site, sizes: Sizes | None = None
) -> Batch:
    """Solve all instruments.

    `readings`: of each instrument, all in the order of the plan (`arranged`) [SI]. Raises
    ``plan.singular``: no instrument could be solved with this plan.
    """
    plan = plan_of(settings)
    refuse_singular(plan.name, up_k(plan.angles[plan.rate == 0.0]), "accel")
    rates = np.stack([turntable.mean_rate(r.rate, site.latitude or 0.0) for r in readings])
    _, which = np.unique(np.round(rates, 12), axis=0, return_inverse=True)
    groups = [np.flatnonzero(np.ravel(which) == k) for k in range(int(which.max()) + 1)]
    stacks = [_stacked([readings[int(i)] for i in g], rates[g[0]], site) for g in groups]
    first = [fleet.calibrate(s, lever_arm=settings.lever_arm) for s in stacks]
    found = _joined(first, groups)
    unknown = any(f.code == UNKNOWN_NOISE for f in readings[0].findings)
    scaled = settings.repeatability or unknown
    common = _common(found, unknown, readings[0].declared) if scaled else np.ones(2)
    chi_square = found.chi_square / common
    own = _own(chi_square, found)
    again = [
        fleet.calibrate(
            s.with_variance_times(*_factors(common * own[g])), lever_arm=settings.lever_arm
        )
        for s, g in zip(stacks, groups, strict=True)
    ]
    estimate = _joined(again, groups)
    beside = _beside(readings[0], stacks[0], settings, site, sizes)
    return Batch(readings, settings, site, estimate, chi_square, common, own, beside)


def _beside(
    first: Readings, stack: FleetReadings, settings: Settings, site: Site, sizes: Sizes | None
) -> FloatArray | None:
    """Return the covariance that what is not estimated adds to each of the coefficients, (p, p).

    One size of each term is put into the readings of an instrument of its own, the `first` but for
    that: what it does to the linear solution is hardly another for others. Gravity counts
    elsewhere, and an angle of latitude does nothing to the rate of a spin.
    """
    task = task_of(settings)
    start = free_start(first, site, settings.lever_arm)
    if sizes is None or start is None:
        return None
    again = on_table.reduced_again(
        TableModel(first, site, start, on_table.options_of(first, task, None))
    )
    whole = left_out.whole(sizes, site, again.white, again.wander)
    if whole is None:
        return None
    model, motion = again.motion(start)
    groups = groupby(terms(LINEAR_LOWER, site, whole), lambda term: term.group)
    put = [by for _, some in groups for by in changes([*some], model, motion)]
    none = np.zeros((len(first), 3))
    f, w = (
        np.stack([none, *(none if x is None else x for x in xs)]) + base
        for xs, base in (([b.accel for b in put], first.accel), ([b.gyro for b in put], first.gyro))
    )
    spin = first.spin
    at_rest, accel, gyro = (v[:1] for v in stack.variances)
    made = FleetReadings(
        f[:, ~spin], f[:, spin], w[:, spin], at_rest, accel, gyro, stack.rate, stack.gravity
    )
    values = fleet.calibrate(made, lever_arm=settings.lever_arm).values
    B = values[1:] - values[0]
    return np.asarray(B.T @ B)


def _factors(factor: FloatArray) -> tuple[FloatArray, FloatArray]:
    if (factor == factor[0]).all():
        factor = factor[:1]
    return factor[:, 0], factor[:, 1]


def _stacked(readings: Sequence[Readings], rate: FloatArray, site: Site) -> FleetReadings:
    spin = readings[0].spin
    accel = np.stack([r.accel for r in readings if r.accel is not None])
    gyro = np.stack([r.gyro for r in readings if r.gyro is not None])
    variance = [
        np.stack([np.trace(c, axis1=1, axis2=2) / 3 for c in covs])
        for covs in ([r.accel_cov for r in readings], [r.gyro_cov for r in readings])
    ]
    variance = [v[:1] if (v == v[0]).all() else v for v in variance]
    return FleetReadings(
        accel[:, ~spin], accel[:, spin], gyro[:, spin], variance[0][:, ~spin],
        variance[0][:, spin], variance[1][:, spin], rate[spin], site.gravity,
    )  # fmt: skip


def _joined(parts: Sequence[FleetEstimate], groups: Sequence[IndexArray]) -> FleetEstimate:
    if len(parts) == 1:
        return parts[0]
    back = np.argsort(np.concatenate(groups))

    def both(name: str) -> Any:
        return np.concatenate([getattr(p, name) for p in parts])[back]

    return FleetEstimate(
        both("values"), both("packed"), both("lever_arm"), both("lever_arm_cov"), both("status"),
        both("chi_square"), parts[0].redundancy, both("noise"),
    )  # fmt: skip


def _common(found: FleetEstimate, unknown: bool, declared: bool) -> FloatArray:
    """Return what the variances of all must be multiplied with, from the median chi-square."""
    from scipy.special import chdtri

    out = np.ones(2)
    for t, d in enumerate(found.redundancy):
        x = found.chi_square[found.solved, t]
        if d < 0.5 or not len(x):
            continue
        ratio = float(np.median(x) / chdtri(d, 0.5))
        # Standard deviation of the median ratio of n chi-squares, where the noise is right.
        chance = 1.2533 * np.sqrt(2 / d / len(x))
        if unknown or ratio > 1 + 2.6 * chance or (not declared and ratio > 1):
            out[t] = max(ratio, 1e-12)
    return out


def _own(chi_square: FloatArray, found: FleetEstimate) -> FloatArray:
    out = np.ones_like(chi_square)
    high = limits(found.redundancy, int(found.solved.sum()))
    for t, d in enumerate(found.redundancy):
        with np.errstate(invalid="ignore"):
            larger = chi_square[:, t] > high[t]
        out[larger, t] = chi_square[larger, t] / max(d, 1e-3)
    return out


def limits(redundancy: FloatArray, instruments: int) -> tuple[float, ...]:
    """Return the largest chi-square of both triads that chance explains in a fleet [1].

    `redundancy` (2,): redundancy of both triads [1]; `instruments`: instruments that are tested
    [1].
    """
    tests = 2 * max(instruments, 1)
    return tuple(
        chi_square_limits(float(d), FALSE_ALARM, tests)[1] if d >= 0.5 else float("inf")
        for d in redundancy
    )
