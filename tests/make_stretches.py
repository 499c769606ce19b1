"""Where the rests, turns, steps and dwells of many logs begin and end, kept so that none moves.

    python tests/make_stretches.py               # writes tests/data/stretches.json again
    python tests/make_stretches.py ferraris real # those whose names begin so

A line is a log: first sample and the sample after the last of every rest and of every turn between
rests, with a 0 for one that moves; beginning, end and rate of every reading of a table, and of
every dwell of a north seeker [s, rad/s]; or what was said instead. Logs are those of the examples,
of real instruments (which are read, and not kept), and some of the first that something damaged.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from foucault import campaign
from foucault.detect.dwells import find_dwells
from foucault.detect.faces import find_faces, find_turns
from foucault.detect.live import LiveRests
from foucault.detect.noise import without_spikes
from foucault.detect.readings import find_readings
from foucault.detect.sequence import find_sequence
from foucault.detect.stretches import find_rests
from foucault.errors import FoucaultError
from foucault.logs import LogDescription, read
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.simulate.north import NorthPlan, Placement, Rotation, Stops, simulate_north
from foucault.tables import IndexedLog, Log
from make_alignment import LN100, REAL, RING
from make_sequence import THIRD_PARTY

FILE = Path(__file__).parent / "data" / "stretches.json"
EXAMPLES = Path(__file__).parent.parent / "examples"
SEEDS = (1, 2, 3)
GRAVITY = 9.81
MPU = {"rate": "100 Hz", "accel": {"columns": [0, 1, 2], "unit": "m/s^2"},
       "gyro": {"columns": [3, 4, 5], "unit": "rad/s"}}  # fmt: skip
XSENS = {"time": {"column": 0, "unit": "s"}} | {
    triad: {"file": f"xsens_{file}.mat.gz", "columns": [1, 2, 3], "unit": "count", "scale": scale,
            "zero": zero}
    for triad, file, scale, zero in (("accel", "acc", "415 count/(m/s^2)", 33000),
                                     ("gyro", "gyro", "4778 count/(rad/s)", 32500))
}  # fmt: skip
IMUCAL = {"file": "example_ferraris_session.csv", "rate": "102.4 Hz",
          "accel": {"columns": ["acc_x", "acc_y", "acc_z"], "unit": "m/s^2"},
          "gyro": {"columns": ["gyr_x", "gyr_y", "gyr_z"], "unit": "deg/s"}}  # fmt: skip
BROAD = {"time": {"column": "t_s", "unit": "s"}} | {
    triad: {"columns": [f"{triad}_{a}_{end}" for a in "xyz"], "unit": unit}
    for triad, end, unit in (("accel", "m_s2", "m/s^2"), ("gyro", "rad_s", "rad/s"))
}
REAL_LOGS: dict[str, tuple[str, dict[str, Any]]] = {
    "xsens": ("xsens_hand_rotated", XSENS),
    "mpu9150-0": ("mpu9150_hand_rotated", MPU | {"file": "imu0.log"}),
    "mpu9150-1": ("mpu9150_hand_rotated", MPU | {"file": "imu1.log"}),
    "ferraris": ("ferraris_session", IMUCAL),
    "ring_laser": ("ring_laser_in_vehicle", RING),
    "ln100": ("ln100_static", LN100),
    "19_positions": ("systematic_19_positions", THIRD_PARTY),
    **{f"broad-{n}": ("broad_hand_motion", BROAD | {"file": f"{n}_imu.parquet"})
       for n in ("03", "05", "09", "21")},
}  # fmt: skip


# -- detectors -------------------------------------------------------------------------------------

Found = dict[str, Any]


def rests(log: Log) -> list[list[int]]:
    found = find_rests(log)
    return [[int(a), int(b)] for a, b in zip(found.first, found.last, strict=True)]


def live(log: Log) -> list[list[int]]:
    """Say the same of a log that came in pieces."""
    growing = LiveRests()
    step = 37 + len(log) // 300
    for start in range(0, len(log), step):
        growing.add(log[start : start + step])
    growing.finish()
    first, last, turns = growing.rests()
    return [[int(a), int(b)] for a, b, t in zip(first, last, turns, strict=True) if not t]


def faces(log: Log) -> list[list[int]]:
    found = find_faces(log, GRAVITY)
    return np.column_stack([found.first, found.last]).tolist()


def turns(log: Log) -> list[list[int]]:
    found = find_turns(log, find_faces(log, GRAVITY), -2 * np.pi)[1]
    return np.column_stack([found.first, found.last]).tolist()


def sequence(log: Log, shortest: float = 5.0) -> Found:
    found = find_sequence(log, shortest=shortest)
    still = zip(found.rests.first, found.rests.last, found.still, strict=True)
    return {"rests": [[int(a), int(b)] + [0] * (not s) for a, b, s in still],
            "moves": [[m.first, m.last] for m in found.moves]}  # fmt: skip


def readings(log: Log) -> list[list[float]]:
    found = find_readings(log)
    start = found.start - log.time[0]
    rows = zip(start, start + found.time, found.rate, strict=True)
    return [[round(a, 6), round(b, 6)] + [float(f"{r:.6g}")] * bool(r) for a, b, r in rows]


def dwells(log: IndexedLog) -> list[list[float]]:
    found = find_dwells(log)
    rows = zip(found.setup, found.start, found.start + found.time, strict=True)
    return [[int(k), round(float(a), 6), round(float(b), 6)] for k, a, b in rows]


def said(find: Callable[..., Any], log: Log | IndexedLog) -> Any:
    """Return what a detector finds, or the code of what it says instead."""
    try:
        return find(log)
    except FoucaultError as problem:
        return problem.code


def of_rests(log: Log) -> Found:
    return {"rests": said(rests, log)}


def of_hand(log: Log) -> Found:
    return {"rests": said(rests, log), "live": said(live, log)}


def of_faces(log: Log) -> Found:
    return of_hand(log) | {"faces": said(faces, log), "turns": said(turns, log)}


def of_sequence(log: Log) -> Found:
    return {"sequence": said(sequence, log)}


def of_table(log: Log) -> Found:
    return {"readings": said(readings, log), "rests": said(rests, log)}


def of_north(log: IndexedLog) -> Found:
    return {"dwells": said(dwells, log)}


# -- logs ------------------------------------------------------------------------------------------


@cache
def example(name: str, seed: int) -> Any:
    made = campaign.simulate(EXAMPLES / f"{name}.toml", seed).simulation.log
    return made if isinstance(made, (Log, IndexedLog)) else made.log


def without_table(name: str, seed: int) -> Log:
    """Return a log that does not say what the table did."""
    return replace(example(name, seed), table=None)


def real(name: str) -> Log:
    folder, words = REAL_LOGS[name]
    return read(LogDescription.model_validate(words), REAL / folder)


def north(seed: int, turning: bool) -> IndexedLog:
    """Samples of a seeker whose base stops, or turns."""
    stops = Stops(np.radians([0.0, 180.0, 90.0, 270.0]), np.array([60.0, 60.0, 45.0, 30.0]), 6.0)
    motion = Rotation(2.0, np.radians(6.0)) if turning else stops
    places = (Placement("A", 0.3, 0.05, -0.1), Placement("B", 6.2, 0.1, 0.02))
    noise = ImuNoise(TriadNoise(white=2e-4), TriadNoise(white=3e-7))
    return simulate_north(NorthPlan(places, motion), model=ImuModel(), noise=noise,
                          site=Site.at(0.6), rows="samples", rate=10.0, seed=seed).log  # fmt: skip


def damaged(of: str, seed: int, how: str) -> Log:
    """Damage a log; where, follows from the rests that were kept of the good one."""
    log, rng = example(of, seed), np.random.default_rng(seed)
    good = kept()[f"{of}/{seed}"]["rests"]
    a, b = good[len(good) // 2]
    gyro, accel = log.gyro.copy(), log.accel.copy()
    rows = rng.integers(100, len(log) - 100, 25)
    if how == "spikes":
        accel[rows, rng.integers(0, 3, 25)] += rng.choice([-30.0, 5.0, 60.0], 25)
        gyro[rows[:9]] = accel[rows[:9]] = 0.0
    elif how == "stuck":
        gyro[a - 200 :, 1] = gyro[a - 200, 1]
    elif how == "rounded":
        for x, step in ((gyro, np.radians(0.5)), (accel, 0.02)):
            x[:] = np.round(x / step) * step
    elif how == "shaken":
        for x in (gyro, accel):
            sd = x[a:b].std(axis=0)
            x[a:b] += 4 * sd * rng.normal(size=(b - a, 3))
    elif how == "shaken twice":  # for a second in the middle of every third rest
        for a, b in good[::3]:
            m = (a + b) // 2
            accel[m : m + round(log.rate)] += 0.3 * rng.normal(size=(round(log.rate), 3))
    elif how == "creeping":
        gyro[a:b] += np.radians([0.0, 1.5, 2.0])
    elif how == "short":
        keep = np.ones(len(log), bool)
        for a, b in good[1::2]:
            keep[a + round(0.9 * log.rate) : b] = False
        return _some(log, keep)
    elif how == "gaps":
        keep = np.ones(len(log), bool)
        keep[(a + b) // 2 : (a + b) // 2 + round(1.2 * log.rate)] = False
        keep[b : b + round(0.7 * log.rate)] = False
        return _some(log, keep, close=False)
    return replace(log, gyro=gyro, accel=accel)


def _some(log: Log, keep: np.ndarray, close: bool = True) -> Log:
    table = log.table
    if table is not None:
        table = replace(
            table, angles=table.angles[keep],
            rate=None if table.rate is None else table.rate[keep],
            position=None if table.position is None else table.position[keep],
        )  # fmt: skip
    time = log.time[: keep.sum()] if close else log.time[keep]
    return replace(log, time=time, gyro=log.gyro[keep], accel=log.accel[keep], temperature=None,
                   table=table)  # fmt: skip


Case = tuple[Callable[[], Any], Callable[[Any], Found]]
DAMAGES = ("spikes", "stuck", "rounded", "shaken", "shaken twice", "creeping", "short", "gaps")
HARD = {"hand_rotated": of_hand, "ferraris": of_faces, "turntable": of_table}

CASES: dict[str, Case] = {
    f"{name}/{seed}": (partial(example, name, seed), how)
    for name, how in {
        "ferraris": of_faces, "six_position": of_faces, "hand_rotated": of_hand,
        "hand_rotated_published": of_rests, "multi_position": of_table, "rate_table": of_table,
        "norm_observation": of_table, "turntable": of_table, "systematic": of_sequence,
    }.items()
    for seed in SEEDS
}  # fmt: skip
CASES |= {
    f"{name}/{seed}/no table": (partial(without_table, name, seed), of_table)
    for name in ("multi_position", "rate_table", "turntable") for seed in SEEDS[:2]
}  # fmt: skip
CASES |= {
    f"north/{seed}/{'turns' if turning else 'stops'}": (partial(north, seed, turning), of_north)
    for seed in SEEDS[:2] for turning in (False, True)
}  # fmt: skip
CASES |= {
    f"{name}/{seed}/{how}": (partial(damaged, name, seed, how), find)
    for name, find in HARD.items() for seed in SEEDS[:2] for how in DAMAGES
}  # fmt: skip
CASES |= {
    f"real/{name}": (
        partial(real, name), {"ferraris": of_faces, "19_positions": of_sequence}.get(name, of_hand)
    )
    for name in REAL_LOGS
}  # fmt: skip


def made(case: str) -> Found:
    """Return where the stretches of a log are."""
    log, find = CASES[case]
    return find(without_spikes(log()))


def kept() -> dict[str, Found]:
    """Return what was kept of every log."""
    return json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}


def main() -> None:
    """Write the cases whose names begin as said, or all of them."""
    for case in CASES:
        if not sys.argv[1:] or case.startswith(tuple(sys.argv[1:])):
            started = time.perf_counter()
            out = kept() | {case: made(case)}
            text = ",\n".join(
                f"{json.dumps(k)}: {json.dumps(out[k], separators=(',', ':'))}"
                for k in CASES if k in out
            )  # fmt: skip
            FILE.write_text(f"{{\n{text}\n}}\n", encoding="utf-8")
            print(f"{case}: {time.perf_counter() - started:.2f} s", flush=True)


if __name__ == "__main__":
    main()
