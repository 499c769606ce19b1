"""Ten minutes without the master: position errors after calibrations of several kinds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import t as student
from transfer_setting import (
    ARCMIN,
    DEG,
    after,
    at_best,
    found_in,
    one_copy,
    outages,
    session_of,
    wanted,
)

from foucault.infer.linear_filter import h_infinity, least_gamma
from foucault.plans.manoeuvres import Accelerate, Climb, Straight, STurn, Turn
from foucault.plans.transfer import transfer_profile
from foucault.procedures.transfer_alignment.session import Session, draw_errors, simulate_motion
from foucault.procedures.transfer_alignment.settings import NOISE, Settings

RUNS, FIRST, FEW, FACTOR = 28, 7, 14, 1.2
NONE, WHOLE, GUESS = {"delay": "none"}, {"delay": "100 ms", "shift": "sample"}, {"delay": "80 ms"}
TRUE = {"accel_bias_z": False, "vertical": False}
SOURCE = TRUE | {"velocity_sd": 0.5, "attitude_sd": 30 * ARCMIN, "passes": 1}
CASES = {
    "M1, H-infinity": (1.0, {**NONE, **SOURCE}),
    "M1, Kalman": (1.0, {**NONE, **SOURCE}),
    "M2, H-infinity": (1.0, {**WHOLE, **SOURCE}),
    "M2, Kalman": (1.0, {**WHOLE, **SOURCE}),
    "M1, true R": (10.0, {**NONE, **TRUE}),
    "M2, true R": (10.0, {**WHOLE, **TRUE}),
    "guessed": (10.0, GUESS),
    "sixteen": (10.0, TRUE),
    "ours, H-infinity": (10.0, {}),
    "ours": (10.0, {}),
}
WORDS = {
    "uncalibrated": "uncalibrated, one copy of the master's state",
    "M1, H-infinity": "no delay, 16 states, 1 Hz, R of (0.5 m/s, 30 arcmin), H-infinity (M1)",
    "M1, Kalman": "the same, Kalman",
    "M2, H-infinity": "known delay, the sample before, same R, H-infinity (M2)",
    "M2, Kalman": "the same, Kalman",
    "M1, true R": "no delay, 16 states, 10 Hz, R as the noise is, Kalman",
    "M2, true R": "known delay, the sample before, 10 Hz, R as the noise is, Kalman",
    "guessed": "delay of 80 ms guessed, interpolated, accelerometer z, 10 Hz, Kalman",
    "sixteen": "delay estimated, interpolated, 16 states, 10 Hz, Kalman",
    "ours, H-infinity": "delay estimated, interpolated, accelerometer z, 10 Hz, H-infinity",
    "ours": "the same, Kalman: the default",
    "floor": "errors and state known exactly: the noise of the slave alone",
}
PUBLISHED = {"uncalibrated": (5913.4, 9000.9), "M1": (1716.1, 2145.3), "M2": (1029.6, 1343.9)}


FLIGHT = transfer_profile("flight")
PATHS = {
    "flight": FLIGHT.calibration,
    "the same turns by half": (
        Straight(4.0), Accelerate(46.0, 12.0), STurn(30 * DEG, 26.0), Climb(14.0, height=50.0),
        Turn(45 * DEG, 12.0), Accelerate(52.0, 8.0), Turn(-60 * DEG, 16.0), Accelerate(48.0, 8.0),
        Straight(140.0),
    ),
    "one S-turn of 60 deg": (
        Straight(20.0), Accelerate(46.0, 12.0), Straight(10.0), STurn(60 * DEG, 26.0),
        Accelerate(52.0, 12.0), Straight(160.0),
    ),
    "one turn of 90 deg": (
        Straight(20.0), Accelerate(46.0, 12.0), Straight(10.0), Turn(90 * DEG, 12.0),
        Accelerate(52.0, 12.0), Straight(174.0),
    ),
}  # fmt: skip


def along_paths(seed: int) -> dict[str, float]:
    """Return the position error after 600 s, by path and calibration [m]."""
    out = {}
    for path, calibration in PATHS.items():
        motion = replace(FLIGHT, name=path, calibration=calibration)
        made = simulate_motion(motion, Session(message_rate=1.0), Settings(),
                               draw_errors("tactical", seed), NOISE, seed)  # fmt: skip
        out[f"{path}, uncalibrated"] = one_copy(made)
        for name in ("M1, Kalman", "M2, Kalman"):
            perfect = Settings(left_out=False, **CASES[name][1])
            out[f"{path}, {name}"] = after(made, found_in(made, perfect))
    return out


def one(seed: int) -> dict[str, float]:
    """Return the position error after 600 s of each case [m]."""
    made = {rate: session_of(seed, Session(message_rate=rate)) for rate in (1.0, 10.0)}
    out = {"uncalibrated": one_copy(made[10.0])}
    for name, (rate, chosen) in CASES.items():
        solution = found_in(made[rate], Settings(left_out=False, **chosen))
        run = None
        if name.endswith("H-infinity"):
            system, L = solution.fit.system, wanted(solution)
            run = h_infinity(system, L, FACTOR * least_gamma(system, L))
        out[name] = after(made[rate], solution, run)
    return out | {"floor": at_best(made[10.0])}


def difference(a: np.ndarray, b: np.ndarray) -> tuple[str, float, float]:
    """Return the mean of a less b with its two-sided 99 % interval."""
    d = a - b
    half = student.ppf(0.995, len(d) - 1) * d.std(ddof=1) / np.sqrt(len(d))
    low, high = float(d.mean() - half), float(d.mean() + half)
    return f"{d.mean():+.0f} ({low:+.0f} to {high:+.0f})", low, high


def main(runs: int = RUNS) -> tuple[bool, dict[str, object]]:
    found = outages(one, range(runs))
    bare, ours = found["uncalibrated"], found["ours"]
    shown = []
    for name, words in WORDS.items():
        few = found[name][:FIRST]
        apart = "" if name == "ours" else difference(found[name], ours)[0]
        shown.append(
            f"| {words} | {few.mean():.0f} | {few.max():.0f} | "
            f"{few.mean() / bare[:FIRST].mean():.3f} | {few[0]:.0f} | {found[name].mean():.0f} | "
            f"{apart} |"
        )
    mean, _ = PUBLISHED["uncalibrated"]
    return not (difference(bare, ours)[1] < 0 or difference(found["guessed"], ours)[1] < 0), {
        "runs": runs,
        "shown": shown,
        "first": FIRST,
        "published": [
            f"| {name} | {a:g} | {b:g} | {a / mean:.3f} | {first:g} |"
            for (name, (a, b)), first in zip(
                PUBLISHED.items(), (4140.5, 1647.5, 985.4), strict=True
            )
        ],
        "remarks": remarks(found),
        "paths": paths(outages(along_paths, range(FEW))),
    }


def remarks(found: dict[str, np.ndarray]) -> list[str]:
    """Return what is to be said of the figures."""
    gain = [found[f"M1, {f}"].mean() / found[f"M2, {f}"].mean() for f in ("H-infinity", "true R")]
    pairs = {
        "M1 with R as the noise is, less uncalibrated": ("M1, true R", "uncalibrated"),
        "H-infinity less Kalman, M1": ("M1, H-infinity", "M1, Kalman"),
        "H-infinity less Kalman, M2": ("M2, H-infinity", "M2, Kalman"),
        "sample before less interpolated, delay known or not": ("M2, true R", "sixteen"),
    }
    return [
        "Paired differences, 99 % interval [m]:",
        "",
        *(f"* {words}: {difference(found[a], found[b])[0]}" for words, (a, b) in pairs.items()),
        "",
        f"M1 over M2 is {gain[0]:.2f} with the large R and {gain[1]:.2f} with R as the noise is; "
        f"published {1716.1 / 1029.6:.2f}. A filter that does not know of the delay takes what the "
        "delay does in a turn, -tau w^2 V, for a bias of the forward accelerometer: a large R "
        "tells it to believe less of that, and how much of it there is depends on the path, see "
        "below. The publication gives neither the path nor R, Q, L, gamma and the noise of the "
        "sensors: its metres cannot be compared with these, and neither can its ratio of M1 to "
        "uncalibrated. What it says of M2 against M1 holds wherever there is more than one turn.",
    ]


def paths(found: dict[str, np.ndarray]) -> list[str]:
    """Return what the path does to M1 and M2."""
    lines = [
        f"{FEW} slaves, 1 Hz, R of (0.5 m/s, 30 arcmin), 16 states, Kalman; the same outage.",
        "",
        "| calibrated on | uncalibrated [m] | M1 [m] | M2 [m] | M1 / uncalibrated | M1 less M2, "
        "99 % interval [m] |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    for path in PATHS:
        bare, one, two = (found[f"{path}, {k}"] for k in ("uncalibrated", "M1, Kalman",
                                                           "M2, Kalman"))  # fmt: skip
        lines.append(f"| {path} | {bare.mean():.0f} | {one.mean():.0f} | {two.mean():.0f} | "
                     f"{one.mean() / bare.mean():.2f} | {difference(one, two)[0]} |")  # fmt: skip
    return lines
