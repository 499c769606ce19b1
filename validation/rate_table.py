"""Gyros on a rate table: are the uncertainties right, and how far are the errors from the bound?

For each case: simulate, calibrate with the noise declared, compare the errors of all coefficients
with the covariance. The mean NEES must lie inside two-sided chi-square limits at 1 % for the cases
together; with a covariance that is 10 % too small it must lie outside.
"""

from __future__ import annotations

import numpy as np
from common import limits, word

from foucault.diagnose.study import nees
from foucault.models.earth import Site
from foucault.models.noise import grade
from foucault.procedures.rate_table import calibrate, names_of, simulate
from foucault.procedures.rate_table.model import Session, Settings
from foucault.simulate.hand_rotated import draw_errors

SITE = Site.at(np.radians(48.8462), 60.0)
NAMES = names_of(Settings())
SESSION = Session(rows="means")
PLAIN = {"repeatability": False}
CASES = {
    "MEMS": ("mems", PLAIN),
    "tactical": ("tactical", PLAIN),
    "tactical, 5 ppm of scatter from step to step, 20 ppm common error of the rates, a fixture "
    "out of square by 10 arcsec": (
        "tactical", PLAIN | {"rate_sd": 5e-6, "table_rate_sd": 2e-5, "fixture_sd": "10 arcsec"},
    ),
}  # fmt: skip
TOO_SMALL = 1.1


def one(name: str, settings: Settings, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return errors, covariance and bound of one session."""
    noise = grade(name).noise
    made = simulate(
        SESSION, settings=settings, model=draw_errors(name, seed), noise=noise, site=SITE, seed=seed
    )
    result = calibrate(made.log, site=SITE, noise=noise, settings=settings)
    errors = result.coefficients.values - made.model.coefficients(NAMES).values
    assert result.coefficients.cov is not None
    return errors, result.coefficients.cov, np.array(result.diagnostics["bound"])


def main(sessions: int = 500) -> tuple[bool, dict[str, object]]:
    n = len(NAMES)
    low, high = limits(n * sessions, tests=len(CASES))
    shown = []
    good = True
    for case, (name, chosen) in CASES.items():
        settings = Settings.model_validate(chosen)
        errors, covs, bounds = map(
            np.array, zip(*(one(name, settings, k) for k in range(sessions)), strict=True)
        )
        right = nees(errors, covs).mean() / n
        wrong = nees(errors, covs / TOO_SMALL).mean() / n
        ratio = np.sqrt(((errors / bounds) ** 2).mean(axis=0))
        inside, missed = low <= right <= high, low <= wrong <= high
        good &= inside and not missed
        shown.append(
            f"| {case} | {right:.3f} | {word(inside)} | {wrong:.3f} | {word(missed)} | "
            f"{np.median(ratio):.3f} | {ratio.max():.3f} |"
        )
    return good, {
        "sessions": sessions,
        "n": n,
        "low": low,
        "high": high,
        "cases": len(CASES),
        "shown": shown,
    }
