"""Studies on a GPU beside all cores of the machine: python benchmarks/gpu.py [TRIALS] [THREADS]

Prints wall and processor time of the same study of `six_position`, six faces, on threads of the
processor and on a device of CUDA fed by as many, and how far their tables are apart. Where there is
no device it says so and measures the processor alone. A tumble is not solved on a device:
docs/scale.md says why.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before NumPy: as the command line has it
os.environ["MKL_NUM_THREADS"] = "1"

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from foucault import campaign
from foucault.campaign import many, study
from foucault.errors import FoucaultError

FOUND = campaign.template("six_position")
DECLARED = FOUND.replace('# placement_sd = "5 arcmin"', 'placement_sd = "1 arcmin"')
CASES = {"placement declared": DECLARED, "placement found": FOUND}


def table(folder: Path) -> dict[str, np.ndarray]:
    read = pq.read_table(folder / study.TRIALS_FILE)
    return {name: read[name].to_numpy() for name in read.column_names}


def apart(ours: dict[str, np.ndarray], theirs: dict[str, np.ndarray]) -> float:
    """Return the largest difference of two errors of a trial, over its standard deviation [1]."""
    names = [name.removeprefix("sd.") for name in ours if name.startswith("sd.")]
    return max(
        float(np.nanmax(np.abs(ours[f"error.{n}"] - theirs[f"error.{n}"]) / ours[f"sd.{n}"]))
        for n in names
    )


def main(trials: int = 100_000, threads: int = os.cpu_count() or 1) -> None:
    try:
        many.solver(gpu=True)
        places = {"processor": False, "GPU": True}
    except FoucaultError as problem:
        print(f"no device: {problem.message}")
        places = {"processor": False}
    for case, text in CASES.items():
        described, tables = campaign.parse(text, "campaign.toml"), []
        for place, gpu in places.items():
            with tempfile.TemporaryDirectory() as folder:
                many.block_of(described, 1, gpu)(range(8))  # compiles
                wall, cpu = time.perf_counter(), time.process_time()
                many.run(described, trials, folder, workers=threads, gpu=gpu)
                wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
                tables.append(table(Path(folder)))
            print(
                f"six_position, {case}, {trials} trials, {threads} threads, {place}: "
                f"{wall:.2f} s wall, {1e6 * wall / trials:.1f} us each; {cpu:.2f} s CPU"
            )
        if len(tables) == 2:
            print(f"errors apart by at most {apart(*tables):.1e} of their standard deviation")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
