"""Time what counting with what is not estimated costs a log of 50,000 rows; write LEFT_OUT.md.

A session of every procedure that counts is calibrated without sizes and with them, everything
compiled, the best of three each; the difference is all that counting costs: columns, tests, and
the fits that enlarge nothing. Of what is fitted by rows the columns themselves are timed too: a
session reduced again with each term, as often as the rule asks for them.

Run: python benchmarks/left_out.py [PROCEDURE ...]
"""

from __future__ import annotations

import os
import platform
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent / "tests"), str(HERE.parent / "validation")]
from violations import CASES, DECLARED, GRADE  # noqa: E402

from foucault.models.left_out import sizes_of  # noqa: E402
from foucault.procedures import left_out  # noqa: E402
from sessions import SITE, made  # noqa: E402

LIMIT = 0.3
"""CPU that the columns of a log of 50,000 rows may take [s]."""

ROWS = {
    "hand_rotated": {"rate": 337.0}, "six_position": {"rate": 715.0}, "ferraris": {"rate": 435.0},
    "rate_table": {"rate": 25.8}, "norm_observation": {"rate": 24.0},
    "multi_position": {"rate": 24.0}, "turntable": {"rate": 24.0}, "north_seeking": {"rate": 2.8},
    "systematic": {"rate": 128.0}, "platform_tumble": {"interval": 0.005},
    "transfer_alignment": {"rate": 210.0},
}  # fmt: skip
"""Procedure -> what makes its session one of 50,000 rows [Hz, s]."""


def measured(which: str) -> tuple[int, float, float, float | None, int]:
    """Return rows, CPU without sizes and with them, that of the columns [s], and calls of these."""
    case = CASES[which]
    case = replace(case, session={**case.session, **ROWS[which]})
    log = made(case, 3).log
    noise = case.sensors if which in DECLARED else None
    spent, best = list[float](), []

    def timed(*args: Any) -> Any:
        at = columns(*args)

        def again(state: Any) -> Any:
            start = time.process_time()
            out = at(state)
            spent.append(time.process_time() - start)
            return out

        return again

    columns, left_out.columns = left_out.columns, timed
    try:
        for sizes in (None, sizes_of(GRADE[which])):
            times = []
            for _ in range(4):  # the first compiles
                spent.clear()
                start = time.process_time()
                case.record.trial(log, site=replace(SITE, gravity_sd=4e-4), settings=case.stated,
                                  sizes=sizes, noise=noise)  # fmt: skip
                times.append((time.process_time() - start, sum(spent), len(spent)))
            best.append(min(times[1:]))
    finally:
        left_out.columns = columns
    (without, _, _), (whole, own, calls) = best
    return len(log.time), without, whole, own if calls else None, calls


def main(only: list[str]) -> None:
    """Print the table; write the page where it is whole."""
    head = (
        f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}; load "
        f"{os.getloadavg()[0]:.0f} at the start"
    )
    lines = []
    for which in only or CASES:
        rows, without, whole, own, calls = measured(which)
        columns = whole - without if own is None else own
        shown = "" if own is None else f"{own:.3f} ({calls})"
        word = "yes" if columns <= LIMIT else "**no**"
        lines.append(f"| {which} | {rows} | {without:.2f} | {whole:.2f} | {whole - without:.2f} | "
                     f"{shown} | {word} |")  # fmt: skip
        print(lines[-1], flush=True)
    if not only:
        text = (HERE / "LEFT_OUT.md").read_text() if (HERE / "LEFT_OUT.md").exists() else PAGE
        begin = text.split("<!-- measured -->")[0]
        table = "\n".join([HEADINGS, *lines])
        page = f"{begin}<!-- measured -->\n\n{head} and {os.getloadavg()[0]:.0f} at the end.\n\n"
        (HERE / "LEFT_OUT.md").write_text(page + table + "\n")


HEADINGS = """\
| procedure | rows | without [s] | with [s] | all that counting costs | columns (calls) | met |
|---|---|---|---|---|---|---|"""

PAGE = f"""\
# The time of what is not estimated

CPU of a calibration of 50,000 rows without the sizes of what is not estimated and with them,
compiled, the best of three. The columns may take {LIMIT:g} s; where a filter has terms for
states, all that counting costs is held against it. Written by `python benchmarks/left_out.py`.

"""

if __name__ == "__main__":
    main(sys.argv[1:])
