"""Transfer alignment: the H-infinity filter against the Kalman filter, paired."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import t as student
from transfer_setting import (
    ARCMIN,
    after,
    found_in,
    outages,
    session_of,
    wanted,
)

from foucault.infer.linear_filter import h_infinity, least_gamma
from foucault.models.noise import ImuNoise
from foucault.procedures.transfer_alignment.session import Session
from foucault.procedures.transfer_alignment.settings import NOISE, PRIOR, Settings

RUNS = 14
FACTORS = (1.05, 1.2, 1.5)
WANTED = ("prior", "navigation")
TEN = float(np.sqrt(10.0))
USED = ("gyro.bias", "gyro.scale", "accel.bias", "installation")
TIGHT = {group: (0.0, PRIOR[group][1] / 5) for group in USED}
MODERATE, LARGE = 1.0 * ARCMIN, 5.0 * ARCMIN


def _noise(times: float) -> ImuNoise:
    """Return the slave's noise with sds that are so many times what they are."""
    return ImuNoise(*(replace(triad, white=times * triad.white)
                      for triad in (NOISE.accel, NOISE.gyro)))  # fmt: skip


def _measured(times: float) -> dict[str, float]:
    usual = Settings(left_out=False)
    return {"velocity_sd": times * usual.velocity_sd, "attitude_sd": times * usual.attitude_sd}


# What truly is, what the filter is told, and the noise of the slave that it is told.
CASES = {
    "near-ideal: all as the filter is told": ({}, {}, {}),
    "flexure of 1 arcmin, not told": ({"flexure": MODERATE}, {}, {}),
    "flexure of 5 arcmin, not told": ({"flexure": LARGE}, {}, {}),
    "flexure of 5 arcmin, told as R": (
        {"flexure": LARGE}, {"attitude_sd": float(np.hypot(LARGE, ARCMIN))}, {},
    ),
    "flexure of 5 arcmin, with flexure states": (
        {"flexure": LARGE}, {"flexure_sd": LARGE, "flexure_time": 5.0}, {},
    ),
    "prior five times too tight": ({}, {}, {"given": TIGHT}),
    "R ten times too large": ({}, _measured(TEN), {}),
    "R ten times too small": ({}, _measured(1 / TEN), {}),
    "Q of the slave ten times too large": ({}, {}, {"noise": _noise(TEN)}),
    "Q of the slave ten times too small": ({}, {}, {"noise": _noise(1 / TEN)}),
}  # fmt: skip


def one(job: tuple[str, int]) -> dict[str, float]:
    """Return the position error after 600 s of the filters [m], and the least gammas."""
    name, seed = job
    truth, told, more = CASES[name]
    made = session_of(seed, Session(rate=100.0, **truth))
    solution = found_in(made, Settings(left_out=False, **told), **more)
    system = solution.fit.system
    out = {"Kalman": after(made, solution)}
    for what in WANTED:
        L = wanted(solution, what)
        least = least_gamma(system, L)
        out[f"least {what}"] = least
        for factor in FACTORS:
            out[f"{what} {factor}"] = after(made, solution, h_infinity(system, L, factor * least))
    return out


def apart(a: np.ndarray, b: np.ndarray) -> tuple[str, float, float]:
    """Return the mean of a less b with its two-sided 95 % interval."""
    d = a - b
    half = student.ppf(0.975, len(d) - 1) * d.std(ddof=1) / np.sqrt(len(d))
    low, high = float(d.mean() - half), float(d.mean() + half)
    mark = "**" if low > 0 or high < 0 else ""
    return f"{mark}{d.mean():+.0f} ({low:+.0f} to {high:+.0f}){mark}", low, high


def main(runs: int = RUNS) -> tuple[bool, dict[str, object]]:
    jobs = [(name, seed) for name in CASES for seed in range(runs)]
    found = outages(one, jobs)
    found = {k: dict(zip(CASES, v.reshape(len(CASES), runs), strict=True))
             for k, v in found.items()}  # fmt: skip
    columns = [f"{what} {factor}" for what in WANTED for factor in FACTORS]
    heads = " | ".join(f"L = {what}, {factor}" for what in WANTED for factor in FACTORS)
    shown = ["|---|--:|--:|" + "--:|" * len(columns)]  # fmt: skip
    better, worse = [], []
    for name in CASES:
        kalman = found["Kalman"][name]
        gammas = " / ".join(f"{np.median(found[f'least {what}'][name]):.3g}" for what in WANTED)
        cells = []
        for column in columns:
            text, low, high = apart(found[column][name], kalman)
            cells.append(text)
            words = f"{name} (L = {column.replace(' ', ', ')})"
            part = (low + high) / 2 / kalman.mean()
            (better if high < 0 else worse if low > 0 else []).append((words, part))
        shown.append(f"| {name} | {kalman.mean():.0f} | {gammas} | {' | '.join(cells)} |")
    ideal = found["Kalman"]["near-ideal: all as the filter is told"].mean()
    told = found["Kalman"]["flexure of 5 arcmin, with flexure states"].mean()
    return ideal < told < found["Kalman"]["flexure of 5 arcmin, not told"].mean(), {
        "runs": runs,
        "shown": shown,
        "heads": heads,
        "finding": finding(better, worse, len(CASES) * len(columns)),
    }


def finding(better: list, worse: list, tests: int) -> list[str]:
    """Return what was found, whichever way it went."""
    lines = [
        f"Of {tests} comparisons at 95 %, {tests * 0.025:.1f} on either side are due to "
        f"chance where there is no difference. H-infinity was better in {len(better)} and "
        f"worse in {len(worse)}."
    ]
    for title, some in (("Better", better), ("Worse", worse)):
        if some:
            lines += ["", f"{title}:", "",
                      *(f"* {words}: {100 * part:+.1f} % of the Kalman filter's error"
                        for words, part in some)]  # fmt: skip
    return lines
