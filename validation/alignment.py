"""Alignment: real logs by every method beside other programs, and what two positions are worth.

The white noise of the ring laser unit is measured in its own log, 300 s to 600 s, where nothing
else is judged: the values that make the innovations of the fine alignment likeliest. Windows of
the same log before and after are then aligned with them. A simulation compares one rest with two
rests of the same total length, gyro biases drawn anew in each.

Logs are looked for under $FOUCAULT_DATA (default ../shared/data).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from common import limits, must

from foucault.diagnose.alignment import checked
from foucault.infer.gauss_newton import chi_square_limits
from foucault.logs import LogDescription, read
from foucault.models.earth import Site
from foucault.models.ins_errors import azimuth_from_gyro_bias
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.navigate.align import Alignment, align, latitude_seen, sensor_errors, window
from foucault.navigate.fine_alignment import SETTLING, by_velocity, two_position
from foucault.navigate.increments import Increments, increments_of
from foucault.navigate.inertial_frame import SensorErrors
from foucault.plans.manoeuvres import Rest, Rotate
from make_alignment import (
    DPH,
    LN100,
    LN100_SITE,
    REAL,
    RING,
    RING_SITE,
    attitude_error,
    drawn_biases,
    moving,
    with_errors,
)

UG = 9.80665e-6
ARW = np.radians(1.0) / 60  # deg/sqrt(h)
BIAS_SD = {"gyro_bias_sd": 0.01 * DPH, "accel_bias_sd": 50 * UG}
"""Of units of this class: what nothing in 300 s of rest can tell."""
TRIED = {
    "gyro": [0.0, *np.geomspace(1e-4, 1e-2, 17)],  # deg/sqrt(h)
    "accel": [0.0, *np.geomspace(0.3, 30.0, 17)],  # ug/sqrt(Hz)
}
PROFILE = 1.92
"""A log likelihood lower by this bounds the 95 % interval of one parameter [1]."""
WINDOWS = ((0.0, 300.0), (300.0, 600.0), (600.0, 899.9))
OTHERS = {
    (0.0, "two_vector"): "83.2456",
    (0.0, "inertial_frame"): "90.6251",
    (0.0, "kalman"): "90.6597, 90.5824",
    (600.0, "two_vector"): "90.7453",
    (600.0, "inertial_frame"): "90.6057",
    (600.0, "kalman"): "90.6340, 90.5793",
}
"""Headings of PSINS [deg], by start of the window and method."""
LN100_OTHERS = {"two_vector": "7.33", "inertial_frame": "7.29", "kalman": "7.29"}
GOAL, GOAL_BAND = 90.61, 0.05
METHODS = ("two_vector", "inertial_frame", "kalman")


def noise_of(gyro: float, accel: float) -> ImuNoise:
    """Noise from deg/sqrt(h) and ug/sqrt(Hz)."""
    return ImuNoise(TriadNoise(white=accel * UG), TriadNoise(white=gyro * ARW))


def log_likelihood(part: Increments, gyro: float, accel: float) -> float:
    """Of the innovations of a fine alignment."""
    sensors = sensor_errors(part, noise_of(gyro, accel), **BIAS_SD)
    run = by_velocity(part, RING_SITE, sensors).run
    late = slice(SETTLING, None)
    r2, v = run.innovation[late, :3] ** 2, run.variance[late, :3]
    return float(-0.5 * np.sum(r2 / v + np.log(v)))


def noise_rows(part: Increments) -> tuple[list[str], ImuNoise]:
    """Find the white noise that is likeliest, with the 95 % interval of each triad's."""
    L = np.array([[log_likelihood(part, g, a) for a in TRIED["accel"]] for g in TRIED["gyro"]])
    best = np.unravel_index(np.argmax(L), L.shape)
    lines = ["| noise | likeliest | 95 % interval |", "|---|--:|--:|"]
    for axis, (name, unit) in enumerate((("gyro", "deg/sqrt(h)"), ("accel", "ug/sqrt(Hz)"))):
        profile = L.max(axis=1 - axis)
        inside = np.array(TRIED[name])[profile > L.max() - PROFILE]
        lines.append(
            f"| {name}, white [{unit}] | {TRIED[name][best[axis]]:.2g} "
            f"| {inside[0]:.2g} to {inside[-1]:.2g} |"
        )
    return lines, noise_of(TRIED["gyro"][best[0]], TRIED["accel"][best[1]])


def row(found: Alignment, name: str, others: str) -> tuple[str, bool]:
    """One line of the table of real logs, and whether the NIS lies within its limits."""
    heading, pitch, roll = np.degrees(found.angles)
    nis, good = "", True
    if found.nis is not None and found.dof is not None:
        dof = int(found.dof.sum())
        low, high = chi_square_limits(dof)
        good = bool(low < found.nis.sum() < high)
        nis = f"{found.nis.sum() / dof:.3f} ({low / dof:.3f} to {high / dof:.3f})"
    codes = ", ".join(f"`{f.code}`" for f in found.findings)
    return (
        f"| {name} | {found.method} | {heading:.4f} | {np.degrees(found.heading_sd):.4f} "
        f"| {pitch:.4f} | {roll:.4f} | {nis} | {others} | {codes} |",
        good,
    )


HEAD = [
    "| window | method | heading [deg] | sd | pitch | roll | NIS per measurement (limits) "
    "| others | findings |",
    "|---|---|--:|--:|--:|--:|--:|--:|---|",
]


def aligned(log: Increments, site: Site, noise: ImuNoise, method: str, **span: float) -> Alignment:
    """Align and look for what is wrong with the data."""
    part = log[window(log, **span)]
    found = align(log, site, method=method, noise=noise, **BIAS_SD, **span)
    return checked(part, site, found, sensor_errors(part, noise, **BIAS_SD))


def ring_rows(log: Increments, noise: ImuNoise) -> tuple[list[str], bool]:
    """Three windows of the log of the standing vehicle."""
    lines, good = list(HEAD), True
    for start, end in WINDOWS:
        for method in METHODS:
            found = aligned(log, RING_SITE, noise, method, start=start, end=end)
            text, consistent = row(found, f"{start:.0f}-{end:.0f} s",
                                   OTHERS.get((start, method), ""))  # fmt: skip
            lines.append(text)
            off = abs(float(np.degrees(found.angles[0])) - GOAL)
            if method != "two_vector" and start != 300.0:
                good &= off < GOAL_BAND
            if start == 600.0:
                good &= consistent
    return lines, good


def ln100_rows(log: Increments, noise: ImuNoise) -> tuple[list[str], bool]:
    """The LN-100, x axis up: the heading of y."""
    lines, good = list(HEAD), True
    for method in METHODS:
        found = aligned(log, LN100_SITE, noise, method)
        lines.append(row(found, "300 s", LN100_OTHERS[method])[0])
        good &= 7.285 < float(np.degrees(found.angles[0])) < 7.335
    length = log.dt.sum()
    f, w = log.dvel_b.sum(axis=0) / length, log.dtheta_b.sum(axis=0) / length
    lines += [
        "",
        f"Rate seen {np.linalg.norm(w) / DPH:.3f} deg/h (others 14.755), latitude from gravity and "
        f"rate {np.degrees(latitude_seen(f, w)):.4f} deg (others 51.0826).",
    ]
    return lines, good


SITE = Site.at(np.radians(45.0), 50.0)
BIASES = (0.003, 0.01, 0.03, 0.1, 0.3)  # deg/h
SENSORS = SensorErrors(np.full(3, (0.001 * ARW) ** 2), np.full(3, (5 * UG) ** 2), 0.0, 50 * UG)
LENGTH, TURN = 150.0, np.pi
DISTURBANCE = 1e-3


def shaken(exact: Increments, sensors: SensorErrors, biases: np.ndarray, seed: int) -> Increments:
    """Noise, biases, and a velocity disturbance that is white from sample to sample."""
    rng = np.random.default_rng(seed)
    made = with_errors(exact, sensors, rng, biases)
    v = DISTURBANCE * rng.normal(size=(len(exact) + 1, 3))
    return Increments.of(made.time, made.dtheta_b, made.dvel_b + np.diff(v, axis=0))


def position_rows(draws: int) -> tuple[list[str], bool]:
    """One rest beside two with half a turn between them, the same biases and noise in both."""
    turn = Rotate("up", TURN, np.radians(10.0))
    two, two_truth = moving([Rest(LENGTH), turn, Rest(LENGTH)], SITE, 10.0, heading=0.5)
    one, one_truth = moving([Rest(2 * LENGTH + turn.time)], SITE, 10.0, heading=0.5)
    end = float(two.time[-1])
    rests = ((-0.1, LENGTH), (end - LENGTH, end))
    tests = 2 * len(BIASES)
    lines = [
        "| gyro bias sd [deg/h] | limit of one position [deg] | one: rms azimuth error | one: sd "
        "| one: NEES | two: rms azimuth error | two: sd | two: NEES | limits |",
        "|--:|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    good = True
    low, high = limits(3 * draws, tests=tests)
    for k, bias in enumerate(BIASES):
        sensors = replace(SENSORS, gyro_bias_sd=bias * DPH)
        limit = azimuth_from_gyro_bias(sensors.gyro_bias_sd, SITE.latitude)
        rows: dict[str, list[tuple[float, float, float]]] = {"one": [], "two": []}
        for draw in range(draws):
            seed = 1000 * k + draw
            biases = drawn_biases(sensors, np.random.default_rng(seed + 500_000))
            fits = {
                "one": (by_velocity(shaken(one, sensors, biases, seed), SITE, sensors), one_truth),
                "two": (
                    two_position(shaken(two, sensors, biases, seed), SITE, sensors, rests),
                    two_truth,
                ),
            }
            for name, (fit, truth) in fits.items():
                phi = attitude_error(fit.C_nb, truth.C_nb[-1])
                nees = float(phi @ np.linalg.solve(fit.cov, phi))
                rows[name].append((phi[2] ** 2, fit.cov[2, 2], nees / 3))
        cells = []
        for name in ("one", "two"):
            rms, sd, nees = np.mean(rows[name], axis=0)
            good &= bool(low < nees < high)
            cells.append(
                f"{np.degrees(np.sqrt(rms)):.4f} | {np.degrees(np.sqrt(sd)):.4f} | {nees:.3f}"
            )
        lines.append(
            f"| {bias:g} | {np.degrees(limit):.4f} | {cells[0]} | {cells[1]} "
            f"| {low:.3f} to {high:.3f} |"
        )
    return lines, good


def main(draws: int = 60) -> tuple[bool, dict[str, object]] | None:
    """Return whether all lies within its limits; nothing where a log is missing."""
    for folder in ("ring_laser_in_vehicle", "ln100_static"):
        if not (REAL / folder).is_dir():
            print(f"skipped: {REAL / folder} is missing; set FOUCAULT_DATA")
            return None
    ring, ln100 = (
        increments_of(read(LogDescription.model_validate(description), REAL / folder))
        for folder, description in (("ring_laser_in_vehicle", RING), ("ln100_static", LN100))
    )
    noise_lines, noise = noise_rows(ring[window(ring, 300.0, 600.0)])
    ring_lines, ring_good = ring_rows(ring, noise)
    ln100_lines, ln100_good = ln100_rows(ln100, noise)
    position_lines, position_good = position_rows(draws)
    return ring_good and ln100_good and position_good, {
        "noise_lines": noise_lines,
        "goal": GOAL,
        "goal_band": GOAL_BAND,
        "ring_lines": ring_lines,
        "ring_good": must(ring_good),
        "ln100_lines": ln100_lines,
        "ln100_good": must(ln100_good),
        "draws": draws,
        "disturbance": 1000.0 * DISTURBANCE,
        "length": LENGTH,
        "position_lines": position_lines,
        "position_good": must(position_good),
    }
