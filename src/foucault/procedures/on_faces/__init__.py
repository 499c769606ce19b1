"""What procedures on the six faces have in common: the solution and the result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose import information
from foucault.diagnose.checks import unseen_sizes
from foucault.diagnose.faces import checks as face_checks
from foucault.diagnose.faces import report as face_report
from foucault.diagnose.faces.checks import FaceEvidence
from foucault.diagnose.faces.rests import Faces, find_faces
from foucault.diagnose.first_rest import first_rest_orientation
from foucault.diagnose.hand_rotated import report as session_report
from foucault.diagnose.rests import Rests, detection_table, measure_noise
from foucault.errors import Finding
from foucault.estimate import gauss_newton
from foucault.estimate.chi_square import chi_square_limits
from foucault.estimate.faces.covariance import FaceNoise, covariance_parts, noise_parts
from foucault.estimate.faces.likelihood import (
    Scene,
    State,
    build,
    clearest_drift,
    closed_form,
    unbiased,
)
from foucault.estimate.faces.scatter import believe
from foucault.estimate.snooping import snoop
from foucault.logs.axes import spared
from foucault.models.earth import Site
from foucault.models.faces import TurnReadings, face_name
from foucault.models.imu import EQUATION, FRAME, LAYOUT, Gauge
from foucault.models.noise import ImuNoise
from foucault.models.references import gravity_error, with_references
from foucault.models.session_noise import SessionNoise
from foucault.procedures.on_faces.settings import FaceSettings
from foucault.result import Problem, Result, Verdict
from foucault.tables import Log, temperature_range


def found_faces(log: Log, site: Site, settings: FaceSettings) -> Faces:
    """Find the rests on faces, and compare the first with its declaration.

    `log`: readings [SI].
    """
    faces = find_faces(
        log, site.gravity, sections=settings.sections, window=settings.window,
        threshold=settings.threshold, shortest=settings.shortest,
    )  # fmt: skip
    told = first_rest_orientation(log, faces.readings.up_k[0])
    return replace(faces, findings=(*faces.findings, *told))


def noise_of(
    log: Log, faces: Faces, turns: TurnReadings | None, declared: ImuNoise | None
) -> FaceNoise:
    """Return the noise of the readings: as declared, else as measured in the rests.

    `log`: readings [SI]; `turns` or None: the turns; `declared` or None: noise of the instrument
    [SI].
    """
    if log.averaged is not None:
        return FaceNoise.of_means(declared, faces.readings)
    counts = log.sampled == "increment"
    if declared is not None:
        noise = SessionNoise.declared(declared, log.interval, counts)
        return FaceNoise.sampled(noise, faces.readings, turns)
    assert log.accel is not None
    level = np.zeros(0)
    rests = Rests(faces.first, faces.last, level, level, level, float("nan"), 1)
    accel, gyro = (
        measure_noise(x, log.interval, rests, increments=counts)
        for x in (log.accel, log.accel if log.gyro is None else log.gyro)
    )
    noise = SessionNoise(
        accel.psd_of_mean, gyro.psd_of_mean, gyro.psd, ImuNoise(),
        accel_rounding=accel.rounding, gyro_rounding=gyro.rounding,
        accel_carried=accel.carried, gyro_carried=gyro.carried,
    )  # fmt: skip
    return FaceNoise.sampled(noise, faces.readings, turns)


@dataclass(frozen=True)
class Solution:
    """The likelihood solved, with everything that the result needs."""

    evidence: FaceEvidence  # what the checks look at
    problem: Problem  # the problem that was solved
    parts: dict[str, FloatArray]  # (3 k, 3 k) covariance of the readings by source [SI]

    @property
    def names(self) -> tuple[str, ...]:
        """The coefficients."""
        return self.problem.layout.names


def solve(
    log: Log,
    faces: Faces,
    turns: TurnReadings | None,
    site: Site,
    names: tuple[str, ...],
    noise: FaceNoise,
    declared: bool,
    given: tuple[float | None, float | None, float | None],
    prior: Mapping[str, tuple[float, float]],
) -> Solution:
    """Solve the likelihood of rests and turns.

    `log`: readings [SI]; `turns` or None: the turns; `noise`: noise of the readings [SI]; `given`
    or None: placement, level and angle as declared [rad]; `prior`: mean and standard deviation of
    coefficients or groups [SI].
    """
    scene, start = closed_form(faces.readings, turns, site, names, log)
    belief, found = believe(scene, names, start, noise, given)
    scene = scene.tilted(belief.placement, belief.level)
    parts = covariance_parts(scene, start, noise, belief, given[0] is None)
    cov = np.asarray(sum(parts.values()))
    problem = build(scene, names, start, cov)
    estimate = gauss_newton.solve(problem)
    if prior:
        known = CoefficientVector.prior(LAYOUT.subset(names), prior)
        problem = replace(problem, prior=known)
        estimate = gauss_newton.add_prior(problem, estimate)
    at = problem.linearise(estimate.state, np.ones(problem.n_blocks))
    evidence = FaceEvidence(
        scene, faces, unbiased(estimate), noise, declared, belief, given[0] is not None, found, cov,
        snoop(at, estimate.state_cov), given[2] is not None,
        clearest_drift(scene, problem, estimate, cov),
    )  # fmt: skip
    return Solution(evidence, problem, parts)


def result_of(procedure: str, log: Log, solution: Solution) -> Result:
    """Make the result of a solution.

    `log`: readings [SI].
    """
    e = solution.evidence
    estimate, site, faces = e.estimate, e.scene.site, e.faces
    checks = face_checks.checks(e)
    tables: dict[str, Any] = {"readings": face_report.readings_table(e)}
    if faces.rests is not None:
        tables["detection"] = detection_table(log, faces.rests)
    return Result(
        procedure=procedure,
        coefficients=with_references(estimate.coefficients, site),
        equation=EQUATION,
        frame=FRAME,
        gauge=Gauge.LOWER.value,
        verdict=Verdict.of(checks),
        checks=checks,
        findings=(*_noticed(log, e), *faces.findings, *face_checks.findings(e)),
        status=estimate.status,
        site=site.as_dict(),
        validity=_validity(log, e.scene),
        diagnostics=_diagnostics(log, solution),
        tables=tables,
    )


def _noticed(log: Log, e: FaceEvidence) -> tuple[Finding, ...]:
    used = [(r.start, r.time) for r in (e.scene.rests, e.scene.turns) if r is not None]
    return spared(log.findings, log, used, used)


def _diagnostics(log: Log, solution: Solution) -> dict[str, Any]:
    e = solution.evidence
    estimate, r = e.estimate, e.scene.rests
    out: dict[str, Any] = {
        "iterations": estimate.iterations,
        "noise": session_report.noise_json(e.noise.session, e.declared),
        "chi_square": _chi_square(e),
        "gravity": e.scene.site.gravity,
        "unseen": [
            *face_checks.unseen(e),
            *unseen_sizes(
                estimate.coefficients, e.scene.site.gravity, _validity(log, e.scene).get("gyro")
            ),
        ],
        "placement_sd": e.belief.placement,
        "placement_declared": e.placement_given,
        "faces": [face_name(int(a), s) for a, s in zip(r.axis, r.sign, strict=True)],
        "mounting": estimate.state.C_bk.tolist(),
        "budget": _budget(solution),
        **_bound(solution),
    }
    if not e.noise.known:
        out["noise"] = {"source": "unknown: from the residuals"}
    if e.scene.turns is not None:
        out |= {
            "turns": face_checks.turns_in_words(e.scene),
            "level_sd": e.belief.level,
            "angle_sd": e.belief.angle,
        }
    if e.faces.rests is not None:
        rests = e.faces.rests
        out["detection"] = {
            "threshold": rests.threshold,
            "window": rests.window * log.interval,
            "rests": len(r),
            "rest_time": float(r.time.sum()),
        }
    return out


def _chi_square(e: FaceEvidence) -> dict[str, list[float]]:
    """Sum of squares with limits and degrees of freedom, where anything is left over."""
    out = {}
    for kind, size in zip(("accel", "gyro", "turns"), e.scene.sizes, strict=True):
        value, dof = e.component(kind)
        if size and dof >= 0.5:
            out[kind] = [value, *chi_square_limits(dof), dof]
    return out


def _bound(solution: Solution) -> dict[str, Any]:
    """Cramer-Rao bound of the noise alone, and what is seen worst."""
    e = solution.evidence
    every = noise_parts(e.scene, e.estimate.state, e.noise)
    alone = np.asarray(sum(part for name, part in every.items() if name.endswith(" noise")))
    at_state: State = e.estimate.state
    return information.bound(build(e.scene, solution.names, at_state, alone), at_state)


def _budget(solution: Solution) -> dict[str, list[float]]:
    """Variance of every coefficient by source: the gain applied to each part of the covariance."""
    from scipy.linalg import cho_factor, cho_solve

    e, n = solution.evidence, len(solution.names)
    estimate = e.estimate
    at = solution.problem.linearise(estimate.state, np.ones(solution.problem.n_blocks))
    root = np.linalg.cholesky(e.cov)
    slope = root @ at.jacobian
    gain = estimate.state_cov @ cho_solve(cho_factor(e.cov), slope).T
    out = {
        name: np.einsum("ij,jk,ik->i", gain[:n], part, gain[:n])
        for name, part in solution.parts.items()
    }
    left = np.diag(estimate.state_cov)[:n] - np.sum(list(out.values()), axis=0)
    if np.isfinite(estimate.coefficients.prior_sd).any():
        out["prior"] = np.maximum(left, 0.0)
    out["local gravity"] = gravity_error(estimate.coefficients, e.scene.site) ** 2
    return {name: variance.tolist() for name, variance in out.items() if variance.any()}


def _validity(log: Log, scene: Scene) -> dict[str, Any]:
    """Return the ranges that the session covered: outside them the result is extrapolated."""
    g = scene.site.gravity
    out: dict[str, Any] = {"accel": [-g, g], "sampled": log.sampled}
    if log.averaged is None:
        out["rate"] = log.rate
    if log.gyro is not None:
        out["gyro"] = [float(v) for v in np.quantile(log.gyro, (0.001, 0.999))]
    return out | temperature_range(log)
