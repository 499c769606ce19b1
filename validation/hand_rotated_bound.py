"""The Cramer-Rao bound of the hand-rotated procedure against brute force.

One study of simulated sessions through the same code as `foucault montecarlo`: root mean square
error over the bound for every coefficient, coverage, and the same checks with the covariance
halved, which must fail. The study's wall time is printed beside its target.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from common import limits, word

from foucault.campaign import parse, study

CAMPAIGN = """
[site]
latitude = "48.8462 deg"
gravity_sd = "0 m/s^2"
[log]
file = "log.csv"
[procedure]
name = "hand_rotated"
[noise]
grade = "mems"
[simulate]
grade = "mems"
"""


def main(sessions: int = 2000) -> tuple[bool, dict[str, object]]:
    campaign = parse(CAMPAIGN, "bound.toml")
    with tempfile.TemporaryDirectory() as folder:
        study.run(campaign, 2, Path(folder) / "warm")
        start = time.perf_counter()
        result = study.run(campaign, sessions, Path(folder) / "study", workers=2)
        seconds = time.perf_counter() - start
    rows = result.rows()
    n = len(result.nees)
    low, high = (np.sqrt(v) for v in limits(n, tests=len(rows)))
    shown = []
    good = True
    for row in rows:
        inside = low <= row["rms_over_bound"] <= high
        good &= inside
        shown.append(
            f"| {row['name']} | {row['rms']:.3g} | {row['bound']:.3g} | "
            f"{row['rms_over_bound']:.3f} | {word(inside)} | "
            f"{100 * row['coverage_68']:.1f} % | {100 * row['coverage_95']:.1f} % |"
        )
    halved = replace(result, sd=result.sd / np.sqrt(2), nees=result.nees * 2)
    for title, checks in (
        ("The checks of the study", result.checks()),
        ("The same with the covariance halved (must fail)", halved.checks()),
    ):
        shown += ["", f"## {title}", ""]
        shown += [f"- {'pass' if c.passed else 'FAIL'}: {c.sentence}" for c in checks]
    good &= all(c.passed for c in result.checks())
    good &= not all(c.passed for c in halved.checks())
    return good, {
        "sessions": sessions,
        "low": low,
        "high": high,
        "seconds": seconds,
        "of_500": 500 * seconds / n,
        "shown": shown,
    }
