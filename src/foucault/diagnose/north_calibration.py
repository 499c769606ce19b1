"""Judge the calibration of a north seeker: checks, budget, bound, tables, and gross mistakes."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.coefficients import CoefficientVector
from foucault.diagnose.information import information
from foucault.errors import ADVICE, Finding, Status, error, finding
from foucault.estimate.chi_square import chi_square_limits
from foucault.estimate.north_calibration import Rig, covariance_parts, tilts
from foucault.estimate.north_reduction import Pairs
from foucault.estimate.north_seeking import Known, solve, turned
from foucault.estimate.snooping import snoop
from foucault.models.dwells import Dwells
from foucault.models.noise import ImuNoise
from foucault.models.north_seeker import Compensation
from foucault.result import Check, Estimate, Level, Problem

FloatArray = npt.NDArray[np.float64]

SIGNIFICANT = 0.01
"""The coupling of the third rate is there where chance gives it less often than this [1]."""

ENOUGH = 6
"""Redundant readings that a bad heading needs to be noticed [1]."""

TURNED = np.radians(20.0)
"""An index zero further off than this is a mistake, no misalignment [rad]."""

LEAN, BIASED = 2e-3, 2e-2
"""A table leaned on purpose where its set-ups depart from one axis by the first, or where the
accelerometers would have biases of the second [g]."""


def leans(pairs: Pairs, rig: Rig) -> bool:
    """Tell whether the accelerometers say that the table was tilted on purpose.

    On one axis the horizontal specific force is a constant, the bias, and a vector that turns with
    the heading.

    Parameters
    ----------
    pairs : Pairs
        Set-ups [SI].
    rig : Rig
        The turntable.
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

    Parameters
    ----------
    estimate : Estimate
        The calibration with it.

    Returns
    -------
    tuple of float
        Chi-square with two degrees of freedom, and how often chance gives so much [1].
    """
    from scipy.special import chdtrc

    c = estimate.coefficients
    keep = [c.layout.index(f"gyro.misalignment.{o}z") for o in "xy"]
    assert c.cov is not None
    value = c.values[keep] @ np.linalg.solve(c.cov[np.ix_(keep, keep)], c.values[keep])
    return float(value), float(chdtrc(2.0, value))


def z_findings(test: tuple[float, float], chosen: str) -> list[Finding]:
    """Say what a tilted session showed of that coupling, where it matters.

    Parameters
    ----------
    test : tuple of float
        Of `z_significance` [1].
    chosen : str
        "auto", "free" or "no".
    """
    if chosen == "no" and test[1] < SIGNIFICANT:
        return [finding("north.z_left_out", p=f"{test[1]:.2g}")]
    if chosen == "free" and test[1] > SIGNIFICANT:
        return [finding("north.z_not_seen", p=f"{test[1]:.2g}")]
    return []


def require_sound(estimate: Estimate) -> None:
    """Raise where headings do not span, or a sense, zero or unit is plainly wrong.

    Parameters
    ----------
    estimate : Estimate
        The calibration.
    """
    if estimate.status is Status.UNOBSERVABLE:
        raise error("north.undetermined", names="; ".join(estimate.weakest))
    model = Compensation(estimate.coefficients).model
    M = model.gyro_matrix[:2, :2]
    det = float(np.linalg.det(M))
    if det < 0:
        raise error("north.sense")
    size = np.sqrt(det)
    if not 0.5 < size < 2:
        raise error("north.gyro_scale", factor=f"{size:.4g}")
    angle = float(np.arctan2(M[1, 0] - M[0, 1], M[0, 0] + M[1, 1]))
    if abs(angle) > TURNED:
        raise error("north.index_zero", angle=f"{np.degrees(angle):.1f}")


def _rows(estimate: Estimate, pairs: Pairs) -> tuple[FloatArray, FloatArray]:
    """Return residuals and redundancies of the observations, shape (m, k)."""
    used = estimate.blocks >= 0
    shape = (len(pairs), -1)
    share = np.clip(1.0 - estimate.leverage[used], 0.0, 1.0)
    return estimate.residuals[used].reshape(shape), share.reshape(shape)


def squares(estimate: Estimate, pairs: Pairs) -> tuple[FloatArray, FloatArray]:
    """Return sum of squares and degrees of freedom of gyro and accelerometers, shape (2,) each.

    Parameters
    ----------
    estimate : Estimate
        The calibration.
    pairs : Pairs
        Set-ups [SI].
    """
    r, share = _rows(estimate, pairs)
    parts = (slice(0, 2), slice(2, 4))
    return (
        np.array([np.sum(r[:, p] ** 2) for p in parts]),
        np.array([np.sum(share[:, p]) for p in parts]),
    )


def chi_square(estimate: Estimate, pairs: Pairs) -> dict[str, list[float]]:
    """Return sums of squares with their limits and degrees of freedom, for result.json.

    Parameters
    ----------
    estimate : Estimate
        The calibration.
    pairs : Pairs
        Set-ups [SI].
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


def checks(pairs: Pairs, estimate: Estimate, source: str) -> tuple[Check, ...]:
    """Return every test of the calibration.

    Parameters
    ----------
    pairs : Pairs
        Set-ups [SI].
    estimate : Estimate
        The calibration.
    source : str
        Where the noise came from.
    """
    out = [_converged(estimate), _redundancy(pairs, estimate)]
    if source != "from the residuals":
        tests = chi_square(estimate, pairs)
        out += [_explained(name, row[0], row[3], len(tests)) for name, row in tests.items()]
    return tuple(out)


def _converged(estimate: Estimate) -> Check:
    fine = estimate.status is Status.CONVERGED
    words = ADVICE[estimate.status]
    return Check("converged", float(fine), 1.0, None, fine, words, Level.UNUSABLE)


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


def findings(problem: Problem, estimate: Estimate, dwells: Dwells) -> list[Finding]:
    """Name the headings that do not fit the others.

    Parameters
    ----------
    problem : Problem
        What was solved.
    estimate : Estimate
        Its solution.
    dwells : Dwells
        For the names of the set-ups.
    """
    at = problem.linearise(estimate.state, np.ones(problem.n_blocks))
    rows = int(np.sum(at.blocks == 0))
    test = snoop(at, estimate.state_cov, rows)
    limits = [chi_square_limits(d, tests=len(test.test))[1] if d else np.inf for d in test.dof]
    beyond = np.flatnonzero(test.test > limits)
    if not len(beyond):
        return []
    worst = int(beyond[np.argmax(test.test[beyond])])
    size = float(np.sqrt(test.test[worst] / test.dof[worst]))
    return [finding("north.heading_outlier", name=dwells.names[worst], size=f"{size:.1f}")]


def noise_json(noise: ImuNoise, source: str) -> dict[str, Any]:
    """Return the noise for result.json.

    Parameters
    ----------
    noise : ImuNoise
        Noise [SI].
    source : str
        Where it came from.
    """
    return {
        "source": source,
        "gyro_white": [noise.gyro.white],
        "accel_white": [noise.accel.white],
        "gyro_bias_instability": noise.gyro.bias_instability,
        "gyro_correlation_time": noise.gyro.correlation_time,
        "gyro_random_walk": noise.gyro.random_walk,
        "gyro_quantisation": noise.gyro.quantisation,
    }


def _gain(problem: Problem, estimate: Estimate, scene_root: FloatArray) -> FloatArray:
    """How the coefficients answer to each number, shape (n, m, k)."""
    n = len(problem.layout)
    at = problem.linearise(estimate.state, np.ones(problem.n_blocks))
    used = at.blocks >= 0
    m, k = scene_root.shape[:2]
    J = at.jacobian[used].reshape(m, k, -1)
    back = np.linalg.solve(np.swapaxes(scene_root, 1, 2), J)
    return np.asarray(np.einsum("nj,mkj->nmk", estimate.state_cov[:n], back))


def budget(problem: Problem, estimate: Estimate, pairs: Pairs, rig: Rig) -> dict[str, list[float]]:
    """Split the variance of every coefficient by source.

    Parameters
    ----------
    problem : Problem
        What was solved.
    estimate : Estimate
        Its solution.
    pairs : Pairs
        Set-ups, their covariance by source [SI].
    rig : Rig
        The turntable.
    """
    parts = covariance_parts(pairs, rig)
    gain = _gain(problem, estimate, np.linalg.cholesky(np.asarray(sum(parts.values()))))
    out = {name: np.einsum("nmi,mij,nmj->n", gain, S, gain) for name, S in parts.items()}
    left = np.diag(estimate.state_cov)[: len(problem.layout)] - np.sum(list(out.values()), axis=0)
    out["table, latitude and what was known before"] = np.maximum(left, 0.0)
    total = np.sum(list(out.values()), axis=0)
    return {k: v.tolist() for k, v in out.items() if np.any(v > 1e-9 * total)}


def bound(problem: Problem, estimate: Estimate) -> dict[str, Any]:
    """Return the bound and the weakest combinations, for result.json.

    Parameters
    ----------
    problem : Problem
        With the noise alone.
    estimate : Estimate
        The calibration.
    """
    at = problem.linearise(estimate.state, np.ones(problem.n_blocks))
    info = information(at, problem.layout)
    return {
        "bound": [float(v) for v in info.sd],
        "weakest": [c.words for c in info.weakest()],
    }


def table_json(estimate: Estimate, rig: Rig) -> dict[str, Any]:
    """Return what was found of the turntable, for result.json.

    Parameters
    ----------
    estimate : Estimate
        The calibration.
    rig : Rig
        The turntable.
    """
    east, north, heading, _ = estimate.state.table
    return {
        "used": rig.tilt,
        "tilt_about_east": float(east),
        "tilt_about_north": float(north),
        "common_heading": float(heading),
        "heading_sd": rig.heading_sd,
        "heading_offset_sd": rig.heading_offset_sd,
    }


def unseen(rig: Rig, names: tuple[str, ...]) -> list[str]:
    """Say what the session cannot show in principle.

    Parameters
    ----------
    rig : Rig
        The turntable.
    names : tuple of str
        The coefficients found.
    """
    common = "it was taken as exact"
    if rig.heading_offset_sd:
        sd = np.degrees(rig.heading_offset_sd) * 60
        common = f"its standard uncertainty, {sd:.3g} arcmin, is part of every coupling"
    out = [
        f"An error that all reference headings share goes straight into every later heading; "
        f"{common}.",
        "A wrong latitude: 1 arcmin is "
        f"{np.tan(abs(rig.site.latitude or 0.0)) * np.radians(1 / 60) * 1e6:.0f} ppm in both "
        "scale factors.",
        "The gyro's constant offset, which every fix finds anew.",
        "Other index angles than those used, and other temperatures.",
    ]
    if "gyro.misalignment.xz" not in names:
        out.append(
            "Coupling of the rate along the axis of the base: 0.001 of it moves the heading by "
            "about 0.06 deg times the tangent of latitude, different at other tilts."
        )
    if rig.tilt == "one axis":
        out.append("Scale factor of the accelerometers: 200 ppm are 7 arcsec of tilt at 10 deg.")
    return out


def circle_accuracy(errors: FloatArray) -> dict[str, float]:
    """Return the usual figures of heading errors around the circle, for result.json.

    Parameters
    ----------
    errors : ndarray, shape (m,)
        Heading as found minus reference [rad].

    Returns
    -------
    dict of str to float
        "std" about the mean, "max" departure from the mean, "peak_to_peak", and "rms" and
        "max_absolute" with the mean in [rad].
    """
    off = errors - errors.mean()
    return {
        "std": float(np.std(errors, ddof=1)) if len(errors) > 1 else 0.0,
        "max": float(np.abs(off).max()),
        "peak_to_peak": float(np.ptp(errors)),
        "mean": float(errors.mean()),
        "rms": float(np.sqrt(np.mean(errors**2))),
        "max_absolute": float(np.abs(errors).max()),
    }


def heading_errors(
    pairs: Pairs, rig: Rig, coefficients: CoefficientVector | None
) -> tuple[FloatArray, FloatArray]:
    """Return heading minus reference and its sd, as a fix in each set-up would have them.

    Parameters
    ----------
    pairs : Pairs
        Set-ups [SI].
    rig : Rig
        The turntable.
    coefficients : CoefficientVector or None
        The calibration; None for the instrument as it is.

    Returns
    -------
    errors, sd : ndarray, shape (m,)
        [rad].
    """
    level = None if rig.accelerometers else max(rig.level_sd, 1e-9)
    known = Known(rig.site.gravity, rig.site.latitude, rig.latitude_sd, level_sd=level)
    found = solve(pairs, known, Compensation() if coefficients is None else Compensation(
        coefficients))  # fmt: skip
    return turned(found.angles[:, 0] - rig.heading), found.sd[:, 0]


def heading_table(
    estimate: Estimate, pairs: Pairs, rig: Rig, dwells: Dwells
) -> dict[str, npt.NDArray[Any]]:
    """Return a row per set-up: readings, what is left of them, and tilt.

    Parameters
    ----------
    estimate : Estimate
        The calibration.
    pairs : Pairs
        Set-ups [SI].
    rig : Rig
        The turntable.
    dwells : Dwells
        For the names of the set-ups.
    """
    left, share = _rows(estimate, pairs)
    standard = np.where(share > 1e-6, left / np.sqrt(np.maximum(share, 1e-6)), np.nan)
    root = np.linalg.cholesky(np.asarray(sum(covariance_parts(pairs, rig).values())))
    raw = np.einsum("mij,mj->mi", root, left)
    lean = tilts(pairs, rig.site.gravity, Compensation()) if rig.accelerometers else None
    nothing = np.full(len(pairs), np.nan)
    before, _ = heading_errors(pairs, rig, None)
    after, sd = heading_errors(pairs, rig, estimate.coefficients)
    return {
        "setup": np.array(dwells.names),
        "heading": rig.heading,
        "gyro_x": pairs.values[:, 0],
        "gyro_y": pairs.values[:, 1],
        "left_x": raw[:, 0],
        "left_y": raw[:, 1],
        "residual_x": standard[:, 0],
        "residual_y": standard[:, 1],
        "offset": pairs.offset,
        "heading_before": before,
        "heading_after": after,
        "heading_sd": sd,
        "pitch": nothing if lean is None else lean[:, 0],
        "roll": nothing if lean is None else lean[:, 1],
    }
