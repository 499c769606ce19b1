"""What the calibration of a north seeker costs and shows: noise, consistency, z couplings."""

from __future__ import annotations

import numpy as np
from common import limits, must
from north_seeking_bound import pairs_of
from north_seeking_tables import (
    ACCEL_SD,
    DPH,
    HEADINGS,
    LATITUDE,
    TILTS,
    G,
    attitudes,
)

from foucault.coefficients import CoefficientVector
from foucault.estimate.north import Known, calibrate_batch, solve
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.north_seeker import RATE_TILTED, SEEKER, Compensation, earth_rate_b, up_b
from foucault.models.rotation import turned
from foucault.procedures import north_seeking
from foucault.procedures.north_seeking import fix as north_solution


def inflation(draws: int) -> tuple[list[str], bool]:
    """Heading errors with a calibration of the same dwell over those without one."""
    rng = np.random.default_rng(5)
    n, sd = 50 * draws, 0.01 * DPH
    tests = 2
    within = [np.sqrt(v) for v in limits(n, tests=tests)]
    lines = ["| dwell of the calibration | RMS with / without | sqrt(1 + 1/(4 k)) | method | RMS "
             "over that | inside |", "|--:|--:|--:|--:|--:|---|"]  # fmt: skip
    good = True
    heading = HEADINGS[rng.integers(0, 12, n)]
    exact = earth_rate_b(heading, 0 * heading, 0 * heading, np.full(n, LATITUDE))[:, :2]
    white = sd / np.sqrt(2) * rng.standard_normal((n, 2))
    level = earth_rate_b(HEADINGS, 0 * HEADINGS, 0 * HEADINGS, np.full(12, LATITUDE))
    true_stops = np.stack([level[:, 1], -level[:, 1], level[:, 0], -level[:, 0]], -1)
    single = sd / np.sqrt(2) / (EARTH_RATE * np.cos(LATITUDE))
    for k, printed in ((1, "1.13"), (4, "")):
        stops = true_stops + sd / np.sqrt(k) * rng.standard_normal((n, 12, 4))
        values = calibrate_batch(stops, HEADINGS, LATITUDE, sd)[0]
        matrix = np.eye(2) + np.stack([values[:, [2, 4]], values[:, [5, 3]]], axis=1)
        errors = []
        for bias, A in ((np.zeros((n, 2)), np.tile(np.eye(2), (n, 1, 1))),
                        (values[:, :2], matrix)):  # fmt: skip
            rate = np.linalg.solve(A, (exact + white - bias)[..., None])[..., 0]
            errors.append(turned(np.arctan2(-rate[:, 0], rate[:, 1]) - heading))
        rms = [np.sqrt(np.mean(e**2)) for e in errors]
        theory = np.sqrt(1 + 3 / (12 * k))
        over = rms[1] / (single * theory)
        inside = within[0] <= over <= within[1]
        good &= bool(inside)
        lines.append(f"| {k} | {rms[1] / rms[0]:.4f} | {theory:.4f} | {printed} | {over:.4f} | "
                     f"{must(inside)} |")  # fmt: skip
    return lines, good


def seeker(names: tuple[str, ...], rng, z: bool):
    """An instrument drawn from the settings' own prior of the z couplings."""
    sd = {"bias": 0.02 * DPH, "scale": 2e-3, "misalignment": 1e-3}
    each = np.array([sd[name.split(".")[1]] for name in names])
    coupled = np.array([name in north_solution.Z_COUPLING for name in names])
    each[coupled] = north_seeking.Settings().z_coupling_sd if z else 0.0
    return CoefficientVector(SEEKER.subset(names), each * rng.standard_normal(len(names)))


def with_accelerometers(
    truth: CoefficientVector, settings: north_seeking.Settings, rng: np.random.Generator
) -> CoefficientVector:
    """Draw the errors of the accelerometers that give the tilt, by their sd in the settings."""
    names = tuple(n for n in SEEKER.names if n.startswith("accel."))
    sd = {"bias": settings.accel_bias_sd, "scale": settings.accel_scale_sd,
          "misalignment": settings.accel_misalignment_sd}  # fmt: skip
    own = np.array([sd[n.split(".")[1]] for n in names]) * rng.standard_normal(len(names))
    both = np.concatenate([truth.values, own])
    return CoefficientVector(SEEKER.subset((*truth.names, *names)), both)


def nees(draws: int) -> tuple[list[str], bool]:
    names = tuple(n for n in SEEKER.names if n in RATE_TILTED)
    white = np.sqrt(120.0)
    noise = ImuNoise(TriadNoise(white=ACCEL_SD * G * white), TriadNoise(white=0.01 * DPH * white))
    site = Site(G, LATITUDE)
    lines = [
        "| calibration | coefficients | NEES / dof | must lie in | inside | with sd 5 % less |",
        "|---|--:|--:|---|---|---|",
    ]
    good = True
    for k, (label, tilts, z, settings) in enumerate((
        ("level, no z coupling", ("0 deg",), False, {"z_coupling": "no"}),
        ("level, z coupling with its prior", ("0 deg",), True, {}),
        ("tilted by 15 deg both ways, prior", ("-15 deg", "15 deg"), True, {}),
    )):  # fmt: skip
        rng = np.random.default_rng([7, k])
        session, chosen = north_seeking.Session(tilts=tilts), north_seeking.Settings(**settings)
        total, dof = 0.0, 0
        for i in range(2 * draws):
            truth = seeker(names, rng, z)
            if len(tilts) > 1:  # accelerometers as uncertain as the settings say
                truth = with_accelerometers(truth, chosen, rng)
            model = ImuModel.from_coefficients(truth)
            made = north_seeking.simulate(session, model=model, noise=noise, site=site, seed=i)
            c = north_seeking.calibrate(
                made.log, site=site, settings=chosen, noise=noise
            ).coefficients
            e = c.values - model.coefficients(list(c.names)).values
            total += float(e @ np.linalg.solve(c.cov, e))
            dof += len(c)
        low, high = chi_square_limits(dof, tests=3)
        inside, caught = low <= total <= high, not low <= total * 1.05**2 <= high
        good &= inside and caught
        lines.append(
            f"| {label} | {len(c)} | {total / dof:.4f} | {low / dof:.4f} to {high / dof:.4f} | "
            f"{must(inside)} | {'rejected' if caught else '**passes**'} |"
        )
    return lines, good


def z_coupling() -> tuple[list[str], bool]:
    """A differential z coupling, without noise: what a level and a tilted calibration leave."""
    layout = SEEKER.subset(north_solution.Z_COUPLING)
    model = ImuModel.from_coefficients(CoefficientVector(layout, np.array([-0.7e-3, 1e-3])))
    noise = ImuNoise(TriadNoise(white=1e-9), TriadNoise(white=1e-12))
    lines = ["| calibration | latitude [deg] | RMS heading error [deg] | largest | method |",
             "|---|--:|--:|--:|--:|"]  # fmt: skip
    left: dict[bool, float] = {}
    for degrees in (29.5, 45.0, 60.0):
        site = Site(G, np.radians(degrees))
        for tilted, words in ((False, {"z_coupling": "no"}), (True, {"z_coupling": "free"})):
            tilts = ("-15 deg", "15 deg") if tilted else ("0 deg",)
            made = north_seeking.simulate(
                north_seeking.Session(tilts=tilts), model=model, noise=ImuNoise(), site=site, seed=1
            )
            settings = north_seeking.Settings(drift="none", **words)
            result = north_seeking.calibrate(made.log, site=site, settings=settings, noise=noise)
            e = np.degrees(field_errors(model, result.coefficients, site))
            left[tilted] = float(np.sqrt(np.mean(e**2)))
            label = "tilted by 15 deg, 8 parameters" if tilted else "level, 6 parameters"
            lines.append(f"| {label} | {degrees} | {left[tilted]:.2g} | {np.abs(e).max():.2g} | "
                         f"{'removed' if tilted else '0.015'} |")  # fmt: skip
    return lines, left[True] < 1e-3 * left[False]


def field_errors(model: ImuModel, found: CoefficientVector, site: Site) -> np.ndarray:
    """Heading errors at 10 deg of pitch and roll, four quadrants, twelve headings [rad]."""
    where = attitudes()[TILTS.index(10)].reshape(-1, 3)
    x = np.column_stack([where, np.full(len(where), site.latitude)])
    values = Compensation(model.coefficients(SEEKER.names)).predict(
        earth_rate_b(*x.T), G * up_b(x[:, 1], x[:, 2])
    )
    alone = Compensation(CoefficientVector(found.layout, found.values))
    angles = solve(pairs_of(values), Known(G, site.latitude), alone).angles
    return turned(angles[:, 0] - x[:, 0])


def main(draws: int = 400) -> tuple[bool, dict[str, object]]:
    (inflated, a), (consistent, b), (coupling, c) = inflation(draws), nees(draws), z_coupling()
    return a and b and c, {
        "latitude": np.degrees(LATITUDE),
        "draws": 50 * draws,
        "inflated": inflated,
        "calibrations": 2 * draws,
        "consistent": consistent,
        "coupling": coupling,
    }
