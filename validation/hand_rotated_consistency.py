"""Are the uncertainties of the hand-rotated procedure right? NEES of many simulated sessions.

For each grade: simulate, calibrate with the noise declared (and once more with the noise
measured in the rests), compare the errors of all 21 coefficients with the covariance. The mean
NEES must lie inside two-sided chi-square limits at 1 % for all tests together, with enough
sessions that a covariance wrong by 5 % is seen; and it must fall outside when the covariance is
wrong by 5 % or the declared noise by 10 %.

Run: python validation/hand_rotated_consistency.py [sessions]
"""

from __future__ import annotations

import os
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.stats import chi2

from foucault.diagnose.consistency import nees
from foucault.estimate.chi_square import chi_square_limits
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


def main(sessions: int = 800) -> int:
    tests = len(GRADES)
    low, high = (v / (N * sessions) for v in chi_square_limits(N * sessions, tests=tests))
    # Power: probability that a covariance 5 % too small is seen.
    power = 1 - chi2.cdf(high * N * sessions / 1.05, N * sessions)
    lines = [
        "# Hand-rotated calibration: are the uncertainties right?",
        "",
        "Written by `python validation/hand_rotated_consistency.py`.",
        "",
        f"{sessions} simulated sessions per grade (24 rests, latitude 48.85 deg, Earth rate "
        f"modelled), 21 coefficients. Mean NEES divided by 21 must lie in {low:.4f} to "
        f"{high:.4f} (two-sided, 1 % for the {tests} grades together). A covariance that is 5 % "
        f"too small would be seen with probability {power:.3f}.",
        "",
        "| grade | noise | mean NEES / 21 | inside | largest z of a mean error | inside |",
        "|---|---|---|---|---|---|",
    ]
    z_limit = float(np.sqrt(chi2.ppf((1 - 0.01) ** (1 / (tests * N)), 1)))
    good = True
    for name in GRADES:
        noise = grade(name).noise
        error, cov = study(name, noise, sessions)
        mean = nees(error, cov).mean() / N
        sd = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
        z = np.abs((error / sd).mean(axis=0) * np.sqrt(sessions)).max()
        inside, unbiased = low <= mean <= high, z <= z_limit
        lines.append(
            f"| {name} | declared, right | {mean:.4f} | {_word(inside)} | {z:.2f} "
            f"(limit {z_limit:.2f}) | {_word(unbiased)} |"
        )
        too_small = nees(error, cov / 1.05).mean() / N
        caught = not low <= too_small <= high
        lines.append(
            f"| {name} | covariance 5 % too small | {too_small:.4f} | {_word(not caught)} | | |"
        )
        wrong, wrong_cov = study(name, scaled(noise, 1 / 1.1), sessions)
        off = nees(wrong, wrong_cov).mean() / N
        seen = not low <= off <= high
        lines.append(f"| {name} | declared 10 % too small | {off:.4f} | {_word(not seen)} | | |")
        measured, measured_cov = study(name, None, sessions)
        m = nees(measured, measured_cov).mean() / N
        lines.append(f"| {name} | measured at rest | {m:.4f} | {_word(low <= m <= high)} | | |")
        good &= inside and unbiased and caught and seen
    lines += [
        "",
        "The second and third row of each grade must be outside: the check can fail. Noise "
        "measured at rest is a lower limit of what differs between rests, so scatter is always "
        "estimated with it; these sessions have none, and the uncertainties come out a few per "
        "cent too large, on the careful side.",
    ]
    text = "\n".join(lines) + "\n"
    target = Path(__file__).parents[1] / "docs/validation/hand_rotated_consistency.md"
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(text)
    print(text)
    return 0 if good else 1


def _word(inside: bool) -> str:
    return "yes" if inside else "no"


if __name__ == "__main__":
    sys.exit(main(*(int(a) for a in sys.argv[1:])))
