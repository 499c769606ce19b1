"""The Cramer-Rao bound of the hand-rotated procedure against brute force.

One study of simulated sessions through the same code as `foucault montecarlo`: root mean square
error over the bound for every coefficient, coverage, and the same checks with the covariance
halved, which must fail. The study's wall time is printed beside its target.

Run: python validation/hand_rotated_bound.py [sessions]
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from foucault.campaign import parse, study
from foucault.estimate.chi_square import chi_square_limits

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


def main(sessions: int = 2000) -> int:
    campaign = parse(CAMPAIGN, "bound.toml")
    with tempfile.TemporaryDirectory() as folder:
        study.run(campaign, 2, Path(folder) / "warm")
        start = time.perf_counter()
        result = study.run(campaign, sessions, Path(folder) / "study", workers=2)
        seconds = time.perf_counter() - start
    rows = result.rows()
    n = len(result.nees)
    low, high = (np.sqrt(v / n) for v in chi_square_limits(n, tests=len(rows)))
    lines = [
        "# Hand-rotated calibration: the bound against brute force",
        "",
        "Written by `python validation/hand_rotated_bound.py`.",
        "",
        f"{sessions} simulated MEMS sessions (24 rests of 4 s, 100 Hz), noise declared. RMS over "
        f"bound must lie in {low:.3f} to {high:.3f} (two-sided, 1 % for all coefficients "
        f"together). The study took {seconds:.1f} s on two threads, {500 * seconds / n:.0f} s "
        f"for each 500 sessions (target 60 s).",
        "",
        "| coefficient | RMS error [SI] | bound [SI] | RMS / bound | inside | in 68 % | in 95 % |",
        "|---|---|---|---|---|---|---|",
    ]
    good = True
    for row in rows:
        inside = low <= row["rms_over_bound"] <= high
        good &= inside
        lines.append(
            f"| {row['name']} | {row['rms']:.3g} | {row['bound']:.3g} | "
            f"{row['rms_over_bound']:.3f} | {'yes' if inside else 'no'} | "
            f"{100 * row['coverage_68']:.1f} % | {100 * row['coverage_95']:.1f} % |"
        )
    halved = replace(result, sd=result.sd / np.sqrt(2), nees=result.nees * 2)
    for title, checks in (
        ("The checks of the study", result.checks()),
        ("The same with the covariance halved (must fail)", halved.checks()),
    ):
        lines += ["", f"## {title}", ""]
        lines += [f"- {'pass' if c.passed else 'FAIL'}: {c.sentence}" for c in checks]
    good &= all(c.passed for c in result.checks())
    good &= not all(c.passed for c in halved.checks())
    text = "\n".join(lines) + "\n"
    target = Path(__file__).parents[1] / "docs/validation/hand_rotated_bound.md"
    target.write_text(text)
    print(text)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main(*(int(a) for a in sys.argv[1:])))
