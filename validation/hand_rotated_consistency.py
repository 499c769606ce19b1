"""Are the uncertainties of the hand-rotated procedure right? NEES of many simulated sessions.

For each grade: simulate, calibrate with the noise declared (and once more with the noise
measured in the rests), compare the errors of all 21 coefficients with the covariance. The mean
NEES must lie inside two-sided chi-square limits at 1 % for all tests together, with enough
sessions that a covariance wrong by 5 % is seen; and it must fall outside when the covariance is
wrong by 5 % or the declared noise by 10 %.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from common import limits, word
from scipy.stats import chi2

from foucault.diagnose.study import nees
from foucault.models.earth import Site
from foucault.models.imu import LINEAR_LOWER, ImuModel
from foucault.models.noise import GRADES, ImuNoise, TriadNoise, grade
from foucault.procedures import hand_rotated
from foucault.simulate.hand_rotated import draw_errors

SITE = replace(Site.at(np.radians(48.8462), 60.0), gravity_sd=0.0)  # as it is simulated
N = len(LINEAR_LOWER)


def scaled(noise: ImuNoise, factor: float) -> ImuNoise:
    return ImuNoise(
        TriadNoise(white=noise.accel.white * factor), TriadNoise(white=noise.gyro.white * factor)
    )


def one(grade_name: str, seed: int, declared: ImuNoise | None) -> tuple[np.ndarray, np.ndarray]:
    model: ImuModel = draw_errors(grade_name, seed)
    simulation = hand_rotated.simulate(
        hand_rotated.Session(), model=model, noise=grade(grade_name).noise, site=SITE, seed=seed
    )
    result = hand_rotated.calibrate(
        simulation.log, site=SITE, settings=hand_rotated.Settings(held_out=0), noise=declared
    )
    error = result.coefficients.values - model.coefficients(LINEAR_LOWER).values
    assert result.coefficients.cov is not None
    return error, result.coefficients.cov


def study(grade_name: str, declared: ImuNoise | None, sessions: int) -> tuple[np.ndarray, ...]:
    with ThreadPoolExecutor() as pool:
        rows = list(pool.map(lambda i: one(grade_name, i, declared), range(sessions)))
    return np.array([r[0] for r in rows]), np.array([r[1] for r in rows])


def main(sessions: int = 800) -> tuple[bool, dict[str, object]]:
    tests = len(GRADES)
    low, high = limits(N * sessions, tests=tests)
    # Power: probability that a covariance 5 % too small is seen.
    power = 1 - chi2.cdf(high * N * sessions / 1.05, N * sessions)
    shown = []
    z_limit = float(np.sqrt(chi2.ppf((1 - 0.01) ** (1 / (tests * N)), 1)))
    good = True
    for name in GRADES:
        noise = grade(name).noise
        error, cov = study(name, noise, sessions)
        mean = nees(error, cov).mean() / N
        sd = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
        z = np.abs((error / sd).mean(axis=0) * np.sqrt(sessions)).max()
        inside, unbiased = low <= mean <= high, z <= z_limit
        shown.append(
            f"| {name} | declared, right | {mean:.4f} | {word(inside)} | {z:.2f} "
            f"(limit {z_limit:.2f}) | {word(unbiased)} |"
        )
        too_small = nees(error, cov / 1.05).mean() / N
        caught = not low <= too_small <= high
        shown.append(
            f"| {name} | covariance 5 % too small | {too_small:.4f} | {word(not caught)} | | |"
        )
        wrong, wrong_cov = study(name, scaled(noise, 1 / 1.1), sessions)
        off = nees(wrong, wrong_cov).mean() / N
        seen = not low <= off <= high
        shown.append(f"| {name} | declared 10 % too small | {off:.4f} | {word(not seen)} | | |")
        measured, measured_cov = study(name, None, sessions)
        m = nees(measured, measured_cov).mean() / N
        shown.append(f"| {name} | measured at rest | {m:.4f} | {word(low <= m <= high)} | | |")
        good &= inside and unbiased and caught and seen
    return good, {
        "sessions": sessions,
        "low": low,
        "high": high,
        "tests": tests,
        "power": power,
        "shown": shown,
    }
