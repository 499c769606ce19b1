"""What procedures on the six faces have in common: the solution and the result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from foucault.coefficients import CoefficientVector
from foucault.diagnose import fit_checks, information
from foucault.diagnose.checks import unseen_sizes
from foucault.diagnose.faces import checks as face_checks
from foucault.diagnose.faces import report as face_report
from foucault.diagnose.faces.checks import FaceEvidence
from foucault.diagnose.faces.rests import Faces, find_faces
from foucault.diagnose.first_rest import first_rest_orientation
from foucault.diagnose.hand_rotated import report as session_report
from foucault.diagnose.rests import Rests, detection_table, measure_noise
from foucault.errors import Finding
from foucault.estimate.faces.likelihood import (
    FaceNoise,
    Scene,
    closed_form,
    on_faces,
    unbiased,
)
from foucault.estimate.snooping import snoop
from foucault.infer import mixed
from foucault.logs.axes import spared
from foucault.models.earth import Site
from foucault.models.faces import TurnReadings, face_name
from foucault.models.imu import EQUATION, FRAME, Gauge
from foucault.models.noise import ImuNoise
from foucault.models.references import gravity_error, with_references
from foucault.models.session_noise import SessionNoise
from foucault.procedures.on_faces.settings import FaceSettings
from foucault.result import Result, Verdict
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
        return FaceNoise.sampled(noise, faces.readings, turns, "declared")
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
    return FaceNoise.sampled(noise, faces.readings, turns, "measured")


def solve(
    log: Log,
    faces: Faces,
    turns: TurnReadings | None,
    site: Site,
    names: tuple[str, ...],
    noise: ImuNoise | None,
    given: tuple[float | None, float | None, float | None],
    prior: Mapping[str, tuple[float, float]],
) -> FaceEvidence:
    """Solve the model of rests and turns.

    `log`: readings [SI]; `turns` or None: the turns; `noise` or None: declared noise [SI];
    `given`: placement, level and angle as declared, or None [rad]; `prior`: mean and standard
    deviation of coefficients or groups [SI].
    """
    scene, start = closed_form(faces.readings, turns, site, names, log)
    had = noise_of(log, faces, turns, noise)
    model = on_faces(scene, start, names, had, given)
    fit = mixed.fit(model, CoefficientVector.prior(model.layout, prior) if prior else None)
    tested = snoop(fit.white, fit.estimate.state_cov)
    fit = replace(fit, estimate=unbiased(fit.estimate))
    return FaceEvidence(fit, model, faces, tested, given[0] is not None, given[2] is not None)


def result_of(procedure: str, log: Log, e: FaceEvidence) -> Result:
    """Make the result of what was solved.

    `log`: readings [SI].
    """
    estimate, site, faces = e.fit.estimate, e.scene.site, e.faces
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
        diagnostics=_diagnostics(log, e),
        tables=tables,
    )


def _noticed(log: Log, e: FaceEvidence) -> tuple[Finding, ...]:
    used = [(r.start, r.time) for r in (e.scene.rests, e.scene.turns) if r is not None]
    return spared(log.findings, log, used, used)


def _diagnostics(log: Log, e: FaceEvidence) -> dict[str, Any]:
    estimate, r = e.fit.estimate, e.scene.rests
    gravity = gravity_error(estimate.coefficients, e.scene.site) ** 2
    out: dict[str, Any] = {
        "iterations": estimate.iterations,
        "noise": session_report.noise_json(
            e.model.noise.session, e.model.noise.source == "declared"
        ),
        "chi_square": fit_checks.chi_square_json(e.fit.after),
        "gravity": e.scene.site.gravity,
        "unseen": [
            *face_checks.unseen(e),
            *unseen_sizes(
                estimate.coefficients, e.scene.site.gravity, _validity(log, e.scene).get("gyro")
            ),
        ],
        "placement_sd": e.tilt(0),
        "placement_declared": e.placement_given,
        "faces": [face_name(int(a), s) for a, s in zip(r.axis, r.sign, strict=True)],
        "mounting": estimate.state.C_bk.tolist(),
        **fit_checks.budget_json(
            e.fit,
            {"local gravity": (gravity, "B", "standard uncertainty of local gravity")},
            e.gain,
        ),
        **information.bound(mixed.noise_alone(e.fit), estimate.state),
    }
    if not e.model.noise.known:
        out["noise"] = {"source": "unknown: from the residuals"}
    if e.scene.turns is not None:
        out |= {
            "turns": face_checks.turns_in_words(e.scene),
            "level_sd": e.tilt(1),
            "angle_sd": e.tilt(2),
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


def _validity(log: Log, scene: Scene) -> dict[str, Any]:
    """Return the ranges that the session covered: outside them the result is extrapolated."""
    g = scene.site.gravity
    out: dict[str, Any] = {"accel": [-g, g], "sampled": log.sampled}
    if log.averaged is None:
        out["rate"] = log.rate
    if log.gyro is not None:
        out["gyro"] = [float(v) for v in np.quantile(log.gyro, (0.001, 0.999))]
    return out | temperature_range(log)
