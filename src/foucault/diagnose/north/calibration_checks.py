"""Judge the calibration of a north seeker: gross mistakes, checks, headings that stand out."""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.checks import SEEN, judge_prior, status_check
from foucault.errors import Finding, Status, error, finding
from foucault.estimate.chi_square import chi_square_limits
from foucault.estimate.north.calibration import Rig
from foucault.estimate.north.reduction import Pairs
from foucault.estimate.snooping import snoop
from foucault.models.dwells import Dwells
from foucault.models.north_seeker import Compensation
from foucault.result import Check, Estimate, Problem
from foucault.units import STANDARD_GRAVITY

SIGNIFICANT = 0.01
"""The coupling of the third rate is there where chance gives it less often than this [1]."""

ENOUGH = 6
"""Redundant readings that a bad heading needs to be noticed [1]."""

TURNED = np.radians(20.0)
"""An index zero further off than this is a mistake, no misalignment [rad]."""

FAR = 0.01
"""Scale factors, or a turn about the axis of the base, that are larger than this may well be a
mistake; instruments have a few tenths of it [1]."""

SUSPECT = 1e-2
"""Accelerometer biases that may rather be a case that stands askew on the table [m/s^2]."""

VAGUE = 0.1
"""Standard deviation of a scale factor or coupling that is as good as unknown [1]."""

NOTHING = 1e-6
"""Part of the Earth's rate that is read by a gyro that reads nothing: no unit is so wrong [1]."""

LEAN, BIASED = 2e-3, 2e-2
"""A table leaned on purpose where its set-ups depart from one axis by the first, or where the
accelerometers would have biases of the second [g]."""


def leans(pairs: Pairs, rig: Rig) -> bool:
    """Tell whether the accelerometers say that the table was tilted on purpose.

    On one axis the horizontal specific force is a constant, the bias, and a vector that turns with
    the heading.

    `pairs`: set-ups [SI].
    """
    s, c = np.sin(rig.heading), np.cos(rig.heading)
    m, zero, one = len(pairs), np.zeros(len(pairs)), np.ones(len(pairs))
    right = np.stack([one, zero, c, -s], 1)  # x_b of a vector (E, N)
    forward = np.stack([zero, one, s, c], 1)
    force = pairs.values[:, 2:].T.ravel() / rig.site.gravity
    design = np.concatenate([right, forward])
    found = np.linalg.lstsq(design, force, rcond=None)[0]
    left = np.abs(force - design @ found).max()
    return bool(left > LEAN or (np.abs(found[:2]).max() > BIASED and m > 1))


def z_significance(estimate: Estimate) -> tuple[float, float]:
    """Test whether the coupling of the rate along z_b is there.

    Returns chi-square with two degrees of freedom, and how often chance gives so much [1].
    """
    from scipy.special import chdtrc

    c = estimate.coefficients
    keep = [c.layout.index(f"gyro.misalignment.{o}z") for o in "xy"]
    assert c.cov is not None
    value = c.values[keep] @ np.linalg.solve(c.cov[np.ix_(keep, keep)], c.values[keep])
    return float(value), float(chdtrc(2.0, value))


def z_findings(test: tuple[float, float], chosen: str) -> list[Finding]:
    """Say what a tilted session showed of that coupling, where it matters.

    `test`: of `z_significance` [1].
    """
    if chosen == "no" and test[1] < SIGNIFICANT:
        return [finding("north.z_left_out", p=f"{test[1]:.2g}")]
    if chosen == "free" and test[1] > SIGNIFICANT:
        return [finding("north.z_not_seen", p=f"{test[1]:.2g}")]
    return []


def require_sound(estimate: Estimate) -> None:
    """Raise where headings do not span, or a sense, zero or unit is plainly wrong."""
    if estimate.status is Status.UNOBSERVABLE:
        weakest = "; ".join(estimate.weakest) or "the coefficients, with the tilt of the table"
        raise error("north.undetermined", names=weakest)
    c = estimate.coefficients
    vague = [n for n, sd in zip(c.names, c.sd, strict=True) if "bias" not in n and sd > VAGUE]
    if vague:  # seen only by what a table that is not quite level turns into them
        raise error("north.undetermined", names=", ".join(vague))
    model = Compensation(estimate.coefficients).model
    M = model.gyro_matrix[:2, :2]
    det = float(np.linalg.det(M))
    size = np.sqrt(abs(det))
    if det < 0 and size > NOTHING:
        raise error("north.sense")
    if not 0.5 < size < 2:
        raise error("north.gyro_scale", factor=f"{size:.4g}" if size > NOTHING else "0")
    angle = _turn(M)
    if abs(angle) > TURNED:
        raise error("north.index_zero", angle=f"{np.degrees(angle):.1f}")


def _turn(M: FloatArray) -> float:
    """Return by how much a 2 x 2 matrix turns, clockwise [rad]."""
    return float(np.arctan2(M[1, 0] - M[0, 1], M[0, 0] + M[1, 1]))


def suspicious(estimate: Estimate, latitude: float) -> list[Finding]:
    """Name what fits, but is larger than what instruments have.

    `latitude`: positive north [rad].
    """
    M = Compensation(estimate.coefficients).model.gyro_matrix[:2, :2]
    found = []
    size = float(np.sqrt(np.linalg.det(M)))
    if abs(size - 1) > FAR:
        like = np.degrees(np.arccos(min(np.cos(latitude) * size, 1.0)))
        found.append(finding("north.scale_common", size=f"{100 * (size - 1):+.2g}",
                             latitude=f"{np.copysign(like, latitude):.1f}"))  # fmt: skip
    c = estimate.coefficients
    bias = float(np.hypot(c.get("accel.bias.x"), c.get("accel.bias.y")))
    if bias > SUSPECT:
        lean = f"{np.degrees(bias / STANDARD_GRAVITY) * 60:.0f}"
        mg = f"{bias / STANDARD_GRAVITY * 1e3:.2g}"
        found.append(finding("north.wedge", bias=mg, lean=lean))
    angle = _turn(M)
    if abs(angle) > FAR:
        found.append(finding("north.turned", angle=f"{np.degrees(angle):.2f}"))
    return found


def leftovers(estimate: Estimate, pairs: Pairs) -> tuple[FloatArray, FloatArray]:
    """Return residuals and redundancies of the observations, shape (m, k) each [1].

    `pairs`: set-ups [SI].
    """
    used = estimate.blocks >= 0
    shape = (len(pairs), -1)
    share = np.clip(1.0 - estimate.leverage[used], 0.0, 1.0)
    return estimate.residuals[used].reshape(shape), share.reshape(shape)


def squares(estimate: Estimate, pairs: Pairs) -> tuple[FloatArray, FloatArray]:
    """Return sum of squares and degrees of freedom of gyro and accelerometers, shape (2,) each.

    `pairs`: set-ups [SI].
    """
    r, share = leftovers(estimate, pairs)
    parts = (slice(0, 2), slice(2, 4))
    return (
        np.array([np.sum(r[:, p] ** 2) for p in parts]),
        np.array([np.sum(share[:, p]) for p in parts]),
    )


def chi_square(estimate: Estimate, pairs: Pairs) -> dict[str, list[float]]:
    """Return sums of squares with their limits and degrees of freedom, for result.json.

    `pairs`: set-ups [SI].
    """
    value, dof = squares(estimate, pairs)
    rows = {"gyro over headings": (value[0], dof[0]), "accel over headings": (value[1], dof[1])}
    within, own = pairs.chi_square.sum(axis=0), pairs.dof.sum(axis=0)
    rows |= {"gyro over index angles": (within[0], own[0]),
             "accel over index angles": (within[1], own[1])}  # fmt: skip
    return {
        name: [float(v), *chi_square_limits(float(d)), float(d)]
        for name, (v, d) in rows.items()
        if d >= 0.5
    }


def checks(
    pairs: Pairs, rig: Rig, problem: Problem, estimate: Estimate, source: str
) -> tuple[Check, ...]:
    """Return every test of the calibration.

    `pairs`: set-ups [SI].
    """
    out = [status_check(estimate.status, estimate.weakest), _redundancy(pairs, estimate)]
    out += [*_fitting(problem, estimate, source), *_level(estimate, rig)]
    if source != "from the residuals":
        tests = chi_square(estimate, pairs)
        out += [_explained(name, row[0], row[3], len(tests)) for name, row in tests.items()]
    share = (estimate.coefficients.sd / estimate.coefficients.prior_sd) ** 2
    if (1.0 - share[np.isfinite(estimate.coefficients.prior_sd)] > SEEN).any():
        out += judge_prior(estimate)
    return tuple(out)


def _fitting(problem: Problem, estimate: Estimate, source: str) -> list[Check]:
    found = outlier(problem, estimate, source == "from the residuals")
    if found is None:
        return []
    _, beyond, size = found
    words = f"The set-up that fits worst is {size:.1f} standard deviations from the others"
    words += "." if beyond <= 1 else ": more than chance gives."
    return [Check("every heading fits", beyond, None, 1.0, beyond <= 1, words)]


def _level(estimate: Estimate, rig: Rig) -> list[Check]:
    """Whether the table stands as level as was said, where the accelerometers can tell."""
    said = np.isfinite(rig.level_sd) and rig.level_sd > 0
    if not (said and rig.accelerometers and rig.tilt == "one axis"):
        return []
    value = float(np.sum(estimate.state.table[:2] ** 2)) / rig.level_sd**2
    _, high = chi_square_limits(2)
    words = f"The axis of the table is {np.sqrt(value / 2):.2f} times level_sd from the vertical"
    words += "." if value <= high else ": it is less level than was said."
    return [Check("level", value, None, high, value <= high, words)]


def _redundancy(pairs: Pairs, estimate: Estimate) -> Check:
    n, fine = estimate.dof, estimate.dof >= ENOUGH
    words = f"{len(pairs)} headings give {n} numbers more than the unknowns need" + (
        "." if fine else f": at least {ENOUGH} are needed to notice a bad heading. Add headings."
    )
    return Check("redundancy", n, ENOUGH, None, fine, words)


def _explained(name: str, value: float, dof: float, tests: int) -> Check:
    low, high = chi_square_limits(dof, tests=tests)
    inside = low <= value <= high
    words = f"{name}: residuals are {np.sqrt(value / dof):.2f} times what the noise predicts"
    if value > high:
        words += ": the noise is larger than said, or a heading, index angle or reading is wrong."
    elif value < low:
        words += ": the noise is smaller than said, and so are the uncertainties."
    else:
        words += "."
    return Check(name, value, low, high, inside, words[0].upper() + words[1:])


def outlier(
    problem: Problem, estimate: Estimate, measured: bool
) -> tuple[int, float, float] | None:
    """Find the set-up that fits the others worst.

    Where the noise was measured by these very residuals it is measured anew without the set-up in
    question, for an outlier hides behind the noise that it makes.

    `measured`: whether the noise is that of the residuals. Returns its number, its test over the
    limit (above 1: it does not fit), and its residual over the sd [1]; None where nothing
    controls a set-up.
    """
    from scipy.special import fdtri

    at = problem.linearise(estimate.state, np.ones(problem.n_blocks))
    rows = int(np.sum(at.blocks == 0))
    test = snoop(at, estimate.state_cov, rows)
    own = np.maximum(test.dof, 1.0)
    ratio = test.test / own
    n = len(ratio)
    limits = np.array([chi_square_limits(d, tests=n)[1] for d in own]) / own
    rest = estimate.dof - own
    if measured:
        controlled = (test.dof > 0) & (rest >= 1)
        left = np.maximum(estimate.chi_square - test.test, 1e-12) / np.maximum(rest, 1.0)
        ratio = ratio / left
        limits = fdtri(own, np.maximum(rest, 1.0), 1 - 0.01 / n)
    else:
        controlled = test.dof > 0
    beyond = np.where(controlled, ratio / limits, 0.0)
    if not controlled.any():
        return None
    worst = int(np.argmax(beyond))
    return worst, float(beyond[worst]), float(np.sqrt(ratio[worst]))


def findings(problem: Problem, estimate: Estimate, dwells: Dwells, source: str) -> list[Finding]:
    """Name the heading that does not fit the others."""
    found = outlier(problem, estimate, source == "from the residuals")
    if found is None or found[1] <= 1:
        return []
    name = dwells.names[found[0]]
    return [finding("north.heading_outlier", name=name, size=f"{found[2]:.1f}")]
