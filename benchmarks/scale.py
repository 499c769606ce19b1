"""What a trial of a study costs, and what a million would cost: python benchmarks/scale.py

Prints the tables of docs/scale.md; with --write it puts them there. Wants an idle machine: the
numbers are of one process and of two, and whatever else runs is counted too.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before NumPy: as the command line and workers have it
os.environ["MKL_NUM_THREADS"] = "1"

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil

from foucault import campaign
from foucault.campaign import study
from foucault.campaign import study as parts
from foucault.cli import cluster
from foucault.cli.screen import Screen

PAGE = Path(__file__).parents[1] / "docs" / "scale.md"
BEGIN, END = "<!-- measured by benchmarks/scale.py -->", "<!-- end of what was measured -->"
PROCEDURES = {"six_position": 400, "platform_tumble": 160}
"""Procedure -> trials in each timing."""

MILLION, CORES = 10**6, (8, 100, 1000)
ROUNDS = 3
EMPTY = 1000
"""Batches, or parts, that are timed without work [1]."""


@dataclass(frozen=True)
class Cost:
    """What a trial of one procedure costs.

    Attributes
    ----------
    alone : float
        Seconds in a process without Dask [s].
    one, two : float
        Seconds of a study per trial, on one and on two processes of Dask [s].
    both : float
        Seconds per trial of two processes without Dask side by side: what the machine allows [s].
    part_bytes, whole_bytes : float
        Of the part files and of trials.parquet, per trial [1].
    written, merged : float
        Seconds that this machine needs to write a trial's share of a part, and of the whole [s].
    """

    alone: float
    one: float
    two: float
    both: float
    part_bytes: float
    whole_bytes: float
    written: float
    merged: float

    @property
    def efficiency(self) -> float:
        return self.one / (2 * self.two)

    @property
    def ceiling(self) -> float:
        return self.alone / (2 * self.both)


def seconds(function: Callable[[], Any], rounds: int = 1) -> float:
    best = float("inf")
    for _ in range(rounds):
        start = time.perf_counter()
        function()
        best = min(best, time.perf_counter() - start)
    return best


@contextmanager
def processes(n: int) -> Iterator[Any]:
    """A local cluster as --local-cluster makes it, without a word on the screen."""
    with cluster.spread(Screen(quiet=True), None, None, n) as map_:
        yield map_


# -- per trial ---------------------------------------------------------------------------------

ALONE = """
import sys, time
import numpy as np
from foucault import campaign, monte_carlo
from foucault.campaign import study
name, n, first = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
trial = study.Trial(campaign.parse(campaign.template(name), name + ".toml"))
list(monte_carlo.run(trial, range(3), 99))
print("ready", flush=True)
sys.stdin.readline()
start = time.perf_counter()
list(monte_carlo.run(trial, range(first, first + n), 1))
print(time.perf_counter() - start)
"""


def side_by_side(name: str, n: int, how_many: int) -> float:
    """Return the time of `how_many` processes, each running n trials by itself [s]."""
    made = [
        subprocess.Popen(
            [sys.executable, "-c", ALONE, name, str(n), str(i * n)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )
        for i in range(how_many)
    ]  # fmt: skip
    for process in made:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    for process in made:
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()
    return max(float(process.communicate()[0]) for process in made)


def cost(name: str, n: int, one: Any, two: Any, folder: Path) -> Cost:
    described = campaign.parse(campaign.template(name), f"{name}.toml")
    alone = min(side_by_side(name, n, 1) for _ in range(ROUNDS)) / n
    both = min(side_by_side(name, n // 2, 2) for _ in range(ROUNDS)) / n
    taken: dict[int, float] = {}
    for processes_, map_ in ((1, one), (2, two)):
        study.run(described, 20, folder / f"warm{processes_}", map=map_, seed=9)
        where = iter(range(ROUNDS))
        taken[processes_] = seconds(
            lambda m=map_, p=processes_, w=where: study.run(
                described, n, folder / f"{p}-{next(w)}", map=m, seed=1
            ),
            ROUNDS,
        )
    done = folder / "2-0"
    rows = _rows(done)
    kept = parts.Parts(folder / "large", study.LARGE_PART)
    (folder / "large" / parts.FOLDER).mkdir(parents=True)
    many = [rows[i % len(rows)] for i in range(study.LARGE_PART)]
    written = seconds(lambda: kept.write(range(study.LARGE_PART), many), ROUNDS)
    large = (folder / "large" / parts.FOLDER).iterdir()
    size = sum(f.stat().st_size for f in large)
    merged = seconds(lambda: kept.merge(study.LARGE_PART), ROUNDS)
    return Cost(
        alone, taken[1] / n, taken[2] / n, both, size / study.LARGE_PART,
        (done / study.TRIALS_FILE).stat().st_size / n,
        written / study.LARGE_PART, merged / study.LARGE_PART,
    )  # fmt: skip


def _rows(folder: Path) -> list[dict[str, Any]]:
    import pyarrow.parquet as pq

    rows: list[dict[str, Any]] = pq.read_table(folder / study.TRIALS_FILE).to_pylist()
    return rows


# -- of Dask itself ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Row:
    """Returns a row as a trial does, without computing it."""

    names: tuple[str, ...]

    def __call__(self, index: int) -> dict[str, Any]:
        return study._row(self.names, str(index))


def overheads(one: Any) -> tuple[float, float]:
    """Return the cost of an empty batch, and that of carrying a row from a worker to us [s]."""
    most, cluster.MOST = cluster.MOST, 1
    try:
        batch = seconds(lambda: list(one(abs, range(EMPTY))), ROUNDS) / EMPTY
    finally:
        cluster.MOST = most
    described = campaign.parse(campaign.template("platform_tumble"))
    row, rows = Row(study.names_of(described)), 20 * EMPTY
    made = seconds(lambda: [row(i) for i in range(rows)])
    carried = seconds(lambda: list(one(row, range(rows))), ROUNDS)
    return batch, max(carried - made, 0.0) / rows


def memory(map_: Any) -> int:
    return max(map_.client.run(_resident).values())


def _resident() -> int:
    import psutil

    return int(psutil.Process().memory_info().rss)


# -- the tables --------------------------------------------------------------------------------


def measured(costs: dict[str, Cost], batch: float, row: float, resident: int) -> str:
    names = list(costs)
    lines = [
        "| measured | " + " | ".join(f"`{name}`" for name in names) + " |",
        "|---|" + "---:|" * len(names),
    ]

    def line(what: str, value: Callable[[Cost], str]) -> None:
        lines.append(f"| {what} | " + " | ".join(value(costs[name]) for name in names) + " |")

    line("a trial in a process of its own", lambda c: f"{1e3 * c.alone:.1f} ms")
    line("a trial of a study on one process of Dask", lambda c: f"{1e3 * c.one:.1f} ms")
    line("overhead of Dask and of the files per trial",
         lambda c: f"{1e3 * (c.one - c.alone):.1f} ms")  # fmt: skip
    line("efficiency from one process to two", lambda c: f"{100 * c.efficiency:.0f} %")
    line("the same without Dask: what the processor allows",
         lambda c: f"{100 * c.ceiling:.0f} %")  # fmt: skip
    line("bytes per trial, parts and trials.parquet",
         lambda c: f"{c.part_bytes + c.whole_bytes:.0f}")  # fmt: skip
    line("the client writes and merges, per trial",
         lambda c: f"{1e6 * (c.written + c.merged):.0f} us")  # fmt: skip
    return "\n".join([
        *lines, "",
        f"An empty batch costs {1e3 * batch:.1f} ms, a row of 140 numbers from a worker to the "
        f"client {1e6 * row:.0f} us; a worker holds {resident / 2**20:.0f} MiB.",
    ])  # fmt: skip


def extrapolated(costs: dict[str, Cost], batch: float, row: float) -> str:
    lines = [
        "| a million instruments | " + " | ".join(f"`{name}`" for name in costs) + " |",
        "|---|" + "---:|" * len(costs),
    ]

    def line(what: str, value: Callable[[Cost], str]) -> None:
        lines.append(f"| {what} | " + " | ".join(map(value, costs.values())) + " |")

    def wall(c: Cost, cores: int) -> float:
        efficiency = min(c.efficiency / c.ceiling, 1.0)  # what Dask costs, not this processor
        return max(MILLION * c.one / efficiency / cores, MILLION * client(c))

    def client(c: Cost) -> float:
        return row + c.written + c.merged

    line("core hours", lambda c: f"{MILLION * c.one / 3600:.0f}")
    for cores in CORES:
        line(f"wall time on {cores} cores", lambda c, n=cores: _span(wall(c, n)))
    line("disk", lambda c: f"{MILLION * (c.part_bytes + c.whole_bytes) / 1e9:.1f} GB")
    for cores in CORES[1:]:
        aim = max(cluster.BATCH, cluster.PER_WORKER * cores)
        line(f"batches per second on {cores} cores (one scheduler bears about {1 / batch:.0f})",
             lambda c, n=cores, a=aim: f"{n / a:.0f}")  # fmt: skip
    line("cores at which the client is the limit", lambda c: f"{c.one / client(c):.0f}")
    return "\n".join(lines)


def _span(value: float) -> str:
    return f"{value / 3600:.1f} h" if value >= 3600 else f"{value / 60:.0f} min"


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--write", action="store_true", help="put the tables into docs/scale.md")
    write = asked.parse_args().write
    with processes(1) as one, processes(2) as two, tempfile.TemporaryDirectory() as folder:
        costs = {
            name: cost(name, n, one, two, Path(folder) / name) for name, n in PROCEDURES.items()
        }
        batch, row = overheads(one)
        resident = memory(one)
    load = psutil.getloadavg()[2]
    about = f"{psutil.cpu_count()} cores, load over 15 min {load:.1f}"
    tables = "\n\n".join(
        (measured(costs, batch, row, resident), extrapolated(costs, batch, row))
    )  # fmt: skip
    print(f"{tables}\n\n({about})")
    if write:
        text = PAGE.read_text(encoding="utf-8")
        head, _, rest = text.partition(BEGIN)
        tail = rest.partition(END)[2]
        PAGE.write_text(f"{head}{BEGIN}\n{tables}\n{END}{tail}", encoding="utf-8")


if __name__ == "__main__":
    main()
