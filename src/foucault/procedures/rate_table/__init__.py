"""Calibrate gyros on a rate table: several rates about each axis, both ways.

Put each axis of the instrument in turn along the vertical spin axis of the table, up or down, and
turn it at a list of rates in both senses, each held for whole turns. Beside bias, scale factor and
misalignment this shows how the scale factor changes with the rate: its asymmetry, and its
non-linearity. Placements with each axis up and down show the g-sensitivity too.

The axes of the result are those of the fixture: the table cannot tell how they lie to the
accelerometers. How far the rate of the table and the squareness of the fixture can be trusted is
part of the uncertainties.

References
----------
.. [1] IEEE Std 647-2006 (laser gyros) and IEEE Std 952-1997 (fibre-optic gyros), rate table tests.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from foucault.coefficients import CoefficientVector
from foucault.diagnose.checks import unseen_sizes
from foucault.diagnose.first_rest import first_as_declared
from foucault.diagnose.positions.readings import find_readings
from foucault.diagnose.rate_table import checks as rate_checks
from foucault.diagnose.rate_table import report as rate_report
from foucault.diagnose.rate_table.checks import RateEvidence
from foucault.diagnose.rate_table.steps import Commanded, rate_steps, require_determined
from foucault.diagnose.time_base import times_the_table
from foucault.errors import Finding, error
from foucault.estimate import gauss_newton
from foucault.estimate.rate_table.likelihood import Trust, build, fit
from foucault.estimate.rate_table.scatter import fit_scatter, scaled_noise
from foucault.logs.axes import spared
from foucault.models.earth import Site
from foucault.models.imu import EQUATION, LAYOUT, SCALE_EQUATION
from foucault.models.rate_steps import Steps
from foucault.models.readings import Readings
from foucault.procedures.rate_table.session import LOG_LINES, Session, Settings, in_si, simulated
from foucault.procedures.record import Given, Procedure
from foucault.result import Result, Verdict
from foucault.tables import AXES, Log, temperature_range

FRAME = "axes of the fixture, right-forward-up as it holds the instrument"
UNKNOWN = "readings.noise_unknown"
GAUGE = "each axis is the spin axis of its placements"


def names_of(settings: Settings, gyro: bool = True) -> tuple[str, ...]:
    """Return the coefficients that are estimated."""
    families = ["gyro.bias", "gyro.scale", "gyro.misalignment"]
    families += ["gyro.g_sensitivity"] if settings.g_sensitivity else []
    families += ["gyro.asymmetry"] if settings.asymmetry else []
    families += ["gyro.cubic"] if settings.cubic else []
    # The last letter is the axis that the rate, or specific force, is about: no other is seen.
    seen = ("gyro.bias.", *settings.placed)
    return tuple(
        n
        for n in LAYOUT.names
        if n.rpartition(".")[0] in families and (n.startswith(seen[0]) or n.endswith(seen[1:]))
    )


def _solve(log: Log, given: Given[Settings]) -> Result:
    settings = given.settings
    if log.gyro is None:
        raise error("rate_table.no_gyro")
    given.progress(0.05, "finding the steps")
    readings = find_readings(log, noise=given.noise, shortest=settings.shortest)
    first_as_declared(readings, log)
    told = log.table is not None and (
        log.table.rate is not None or bool(np.isfinite(log.table.angles[:, 0]).all())
    )
    given.progress(0.5, "calibrating")
    result = from_readings(readings, settings, told=told, site=given.site, prior=given.prior)
    validity = dict(result.validity)
    if log.averaged is None:
        validity |= {"rate": log.rate, "sampled": log.sampled}
    validity |= temperature_range(log)
    used = [(readings.start, readings.time)]
    findings = (*spared(log.findings, log, used, ()), *result.findings)
    return replace(result, findings=findings, validity=validity)


def from_readings(
    readings: Readings,
    settings: Settings,
    *,
    told: bool,
    site: Site,
    prior: Mapping[str, tuple[float, float]] | None = None,
) -> Result:
    """Calibrate from readings that were made before.

    `readings`: one mean per constant rate [SI]; `told`: whether their rates are those of the
    table, else `rates` of the settings are matched; `prior` or None: mean and standard deviation
    of coefficients or groups of coefficients [SI].
    """
    site = settings.where(site)
    commanded = Commanded(in_si(settings.rates), settings.axes)
    steps, found = rate_steps(readings, commanded, told=told, site=site)
    evidence = _evidence(readings, steps, settings, site, prior or {})
    return _result(readings, settings, site, evidence, found)


def _evidence(
    readings: Readings,
    steps: Steps,
    settings: Settings,
    site: Site,
    given: Mapping[str, tuple[float, float]],
) -> RateEvidence:
    names = names_of(settings)
    prior = CoefficientVector.prior(LAYOUT.subset(names), given) if given else None
    trust = Trust(settings.table_rate_sd, settings.rate_sd, settings.fixture_sd, site.latitude)
    require_determined(steps, names, build(steps, names, trust, prior))
    loss = gauss_newton.huber if settings.robust else gauss_newton.least_squares
    unknown = any(f.code == UNKNOWN for f in _told(readings))
    # Noise, scatter and outliers are those of the steps alone: a prior that they contradict would
    # be taken for scatter.
    if unknown:
        steps = scaled_noise(steps, names, trust)
    problem, estimate = fit(steps, names, trust, None, loss)
    before, added = rate_checks.limits(estimate), 0.0
    if settings.repeatability and not unknown:
        wider = fit_scatter(steps, names, trust, None, loss)
        if wider != trust:
            added = float(np.sqrt(wider.rate_jitter**2 - trust.rate_jitter**2))
            trust = wider
            problem, estimate = fit(steps, names, trust, None, loss)
    if prior is not None:
        problem = replace(problem, prior=prior)
        estimate = gauss_newton.add_prior(problem, estimate)
    return RateEvidence(
        steps, names, trust, problem, estimate, site, readings.declared, unknown, before, added
    )


def _result(
    readings: Readings, settings: Settings, site: Site, e: RateEvidence, found: list[Finding]
) -> Result:
    checks = rate_checks.checks(e)
    estimate = e.estimate
    bent = settings.asymmetry or settings.cubic
    return Result(
        procedure="rate_table",
        coefficients=estimate.coefficients,
        equation=SCALE_EQUATION if bent else EQUATION,
        frame=FRAME,
        gauge=GAUGE,
        verdict=Verdict.of(checks),
        checks=checks,
        findings=(*_told(readings), *found, *rate_checks.hints(e)),
        status=estimate.status,
        site=site.as_dict(),
        validity={"gyro": [float(e.steps.gyro.min()), float(e.steps.gyro.max())]},
        diagnostics={
            "iterations": estimate.iterations,
            "noise": {"source": _source(e), "gyro_white": _white(e.steps)},
            "chi_square": {"steps": [*rate_checks.limits(estimate), estimate.dof]},
            "chi_square_of_noise_alone": {"steps": [*e.before, estimate.dof]},
            "rate_table": rate_report.standard_figures(e),
            "rate_scatter": e.added,
            "bias_drift": rate_report.drift_figures(e),
            "budget": rate_report.budget(e),
            "unseen": [
                *unseen(settings),
                *unseen_sizes(
                    estimate.coefficients, site.gravity, (e.steps.gyro.min(), e.steps.gyro.max())
                ),
            ],
            **rate_report.bound(e),
        },
        tables={"rate_steps": rate_report.step_table(e, readings.start)},
    )


def _told(readings: Readings) -> list[Finding]:
    """Return what was noticed in the readings; a declared noise is known, of means too."""
    return [f for f in readings.findings if not (readings.declared and f.code == UNKNOWN)]


def _source(e: RateEvidence) -> str:
    if e.unknown:
        return "measured by the residuals"
    return "declared" if e.declared else "measured in the steps"


def _white(steps: Steps) -> list[float]:
    variance = np.diagonal(steps.cov, axis1=1, axis2=2) * steps.time[:, None]
    return [float(v) for v in np.sqrt(np.median(variance, axis=0))]


def unseen(settings: Settings) -> list[str]:
    """Say what a rate table cannot show in principle, for result.json."""

    def known(sd: float, size: float, unit: str) -> str:
        if not sd:
            return "it was taken as exact"
        return f"its standard uncertainty, {sd / size:.3g} {unit}, is part of every uncertainty"

    rate = known(settings.table_rate_sd, 1e-6, "ppm")
    square = known(settings.fixture_sd, float(np.radians(1 / 3600)), "arcsec")
    out = [
        f"A wrong rate of the table: 1 ppm is 1 ppm in all gyro scale factors; {rate}.",
        f"A fixture out of square: what it is goes into the misalignments; {square}.",
        "How the axes lie to the accelerometers: they are those of the fixture.",
        "Rates beyond the fastest step: there the result is extrapolated.",
        "Other temperatures than that of the session.",
    ]
    if left := [a for a in AXES if a not in settings.placed]:
        out.append(
            f"Rates about {' and '.join(left)}, along which the spin axis never was: neither the "
            "scale factors there nor what the other gyros read of such rates."
        )
    if not settings.g_sensitivity:
        out.append("The g-sensitivity of the gyros: with one axis up only it looks like bias.")
    return out


PROCEDURE = Procedure(
    name="rate_table",
    doc=__doc__,
    Settings=Settings,
    Session=Session,
    solve=_solve,
    simulation=simulated,
    names=lambda settings, _: names_of(settings),
    # Nothing is needed of what is between two steps.
    more="stretches",
    clocked=lambda log: (times_the_table(log), log.sampled == "increment"),
    log_lines=LOG_LINES,
)
calibrate, simulate = PROCEDURE.calibrate, PROCEDURE.simulate
