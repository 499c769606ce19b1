"""The navigation test of the source with instruments that were calibrated, not with the truth.

Instruments are drawn and calibrated in a simulated session; then ten turns at 18 deg/s about East
or North and 500 s of rest are navigated with all of the calibration, and with all but the
deflection.

Run from the repository root: python validation/systematic_navigation.py
"""

from __future__ import annotations

import multiprocessing
import os
import sys
from dataclasses import replace

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from systematic_setting import (
    ARCSEC,
    BEND,
    DEG,
    FULL,
    MODEL,
    NOISE,
    RATE,
    SITE,
    both_steps,
    groups,
    instrument,
    rms,
    spread_of,
    word,
    write,
)

from foucault.models.imu import ImuModel
from foucault.models.rotation import log as rotation_vector
from foucault.navigate.align import align
from foucault.navigate.increments import increments_of
from foucault.navigate.state import State
from foucault.navigate.strapdown import navigate
from foucault.plans.systematic.built_in import navigation_test
from foucault.plans.systematic.sequence import CalibrationSequence
from foucault.procedures import systematic
from foucault.procedures.systematic.settings import Settings
from foucault.simulate.systematic import SystematicSimulation, simulate_systematic

DRAWS = 24
BEFORE = 300.0
SD = spread_of(FULL)
BENT = groups(FULL)["deflection"]
T = np.array([0.42, 0.4194, 0.5, 0.3857, 0.44, 0.3]) * BEND
"""xyy, xzz, yzz, yxx, zxx, zyy: -27.00 arcsec about East and 25.31 about North."""
FAST = {"spin_rate": 90.0 * DEG, "turns": 30, "before": 20.0, "rest": 40.0}
SESSIONS = {
    "of the source, 10 turns at 18 deg/s": ("simple 6", {}),
    "30 turns at 90 deg/s, rests of 60 s": ("icosahedral 6", {"positions_rest": 60.0, **FAST}),
    "30 turns at 90 deg/s, rests of 150 s": ("icosahedral 6", FAST),
}
AXES = {"east": 1, "north": 0}
"""Axis of the spin, and the component of the tilt; the velocity is along the other one."""
PRINTED = {
    "east": ("-27.00", "-5.40", "-0.12", "-0.02", "-0.64", "-0.10"),
    "north": ("25.56", "-0.72", "0.17", "0.05", "0.73", "0.06"),
}
"""Table 3 of the source: shift [arcsec], velocity after the spin and at the end [m/s], each before
and after."""


def navigated(made: SystematicSimulation, by: ImuModel) -> np.ndarray:
    """Align, navigate; return shift by the spin, velocity after it, at the end: (3, 2)."""
    increments = increments_of(by.apply(made.log))
    begin = align(increments, SITE, end=BEFORE)
    state = State.at_rest(begin.C_nb, SITE.latitude, 0.0, SITE.height)
    run = navigate(increments, state, first=increments.row_at(BEFORE), vertical="held")
    spun = int(np.searchsorted(run.time, made.sequence.times[2] - 1e-6))
    rows = np.array([0, spun, -1])
    phi = -rotation_vector(run.C_nb[rows] @ np.swapaxes(made.attitude(run.time[rows]), 1, 2))
    return np.stack([(phi[1] - phi[0])[:2], run.velocity_n[spun, :2], run.velocity_n[-1, :2]])


def tested(model: ImuModel, known: dict[str, ImuModel]) -> dict[tuple[str, str], np.ndarray]:
    """Return shift and velocities about each axis, compensated in each way: (3,)."""
    out = {}
    for about, tilt in AXES.items():
        made = simulate_systematic(navigation_test(about, before=BEFORE), site=SITE, model=model,
                                   rate=RATE)  # fmt: skip
        for way, by in known.items():
            shift, *velocity = navigated(made, by)
            out[about, way] = np.array([shift[tilt], *(v[1 - tilt] for v in velocity)])
    return out


def drawn(seed: int) -> ImuModel:
    truth = SD * np.random.default_rng([seed, 5]).standard_normal(len(SD))
    truth[BENT] = T
    return instrument(FULL, truth)


def without(model: ImuModel) -> ImuModel:
    return replace(model, deflection=np.zeros_like(model.deflection))


def plan_of(name: str) -> CalibrationSequence:
    poses, times = SESSIONS[name]
    return both_steps(poses, **times)[0]


def one(job: tuple[str, int]) -> tuple[dict, np.ndarray, np.ndarray]:
    """Calibrate an instrument and test it; return errors and sds of the deflections too."""
    name, seed = job
    model = drawn(seed)
    plan = plan_of(name)
    made = simulate_systematic(plan, site=SITE, model=model, noise=NOISE, rate=RATE, seed=seed)
    settings = Settings(sequence=(), deflection=MODEL.name)
    found = systematic.trial(made.log, site=SITE, settings=settings, noise=NOISE).coefficients
    known = ImuModel.from_coefficients(found)
    ways = {
        "all": known, "all but deflection": without(known),
        "deflection": replace(model, deflection=known.deflection),
    }  # fmt: skip
    names = MODEL.names
    truth = dict(zip(names, MODEL.slope @ T, strict=True))
    err = np.array([found.value(n) - truth[n] for n in names])
    return tested(model, ways), err, np.array([found[n].sd[0] for n in names])


def shown(x: np.ndarray) -> list[str]:
    return [f"{x[0] / ARCSEC:z.2f}", f"{x[1]:z.4f}", f"{x[2]:z.4f}"]


def formula() -> tuple[list[str], bool]:
    """Compensate with the truth, beside the printed figures."""
    model = drawn(0)
    ways = {"all but deflection": without(model), "all": model}
    found = tested(model, ways)
    lines = [
        "| about | | shift (arcsec) | velocity after the spin (m/s) | after 500 s of rest (m/s) |",
        "|---|---|--:|--:|--:|",
    ]
    good = True
    for about in AXES:
        before, after = (found[about, way] for way in ways)
        good &= bool((np.abs(after / before) < 0.02).all())
        lines += [
            f"| {about} | deflection left out | {' | '.join(shown(before))} |",
            f"| | all compensated | {' | '.join(shown(after))} |",
            f"| | source, before | {' | '.join(PRINTED[about][::2])} |",
            f"| | source, after | {' | '.join(PRINTED[about][1::2])} |",
        ]
    return lines, good


def reductions(name: str, rows: list) -> tuple[list[str], bool]:
    """Return the rows of one session, and whether half of its instruments keep 98 % throughout."""
    lines, good = [], True
    minutes = plan_of(name).duration / 60
    for about in AXES:
        before, after, alone = (
            np.array([row[0][about, way] for row in rows])[:, [0, 2]]
            for way in ("all but deflection", "all", "deflection")
        )
        kept = 100 * (1 - np.abs(np.hstack([after, alone[:, 1:]]) / before[:, [0, 1, 1]]))
        median, worst = np.median(kept, axis=0), kept.min(axis=0)
        good &= bool((median > 98).all())
        cells = " | ".join(f"{m:.1f} / {w:.1f} %" for m, w in zip(median, worst, strict=True))
        lines.append(
            f"| {name}, {minutes:.0f} min | {about} | {before[:, 0].mean() / ARCSEC:.2f} -> "
            f"{rms(after[:, 0]) / ARCSEC:.2f} arcsec | {before[:, 1].mean():.3f} -> "
            f"{rms(after[:, 1]):.4f} m/s | "
            f"{cells} |"
        )
        print(lines[-1], flush=True)
    return lines, good


def main() -> int:
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else DRAWS
    exact, good = formula()
    lines = [
        "| session | about | shift | velocity after 500 s | shift less by, median / worst | "
        "velocity | velocity, only the deflection from the session |",
        "|---|---|--:|--:|--:|--:|--:|",
    ]
    told, kept = [], {}
    for name in SESSIONS:
        with multiprocessing.Pool() as pool:
            rows = pool.map(one, [(name, k) for k in range(draws)], chunksize=1)
        more, kept[name] = reductions(name, rows)
        lines += more
        err, sd = (np.array([row[k] for row in rows]) / BEND for k in (1, 2))
        told.append(f"| {name} | {rms(err):.4f} | {rms(sd):.4f} | "
                    f"{word(kept[name])} |")  # fmt: skip
    write("systematic_navigation", [
        "# Systematic calibration: the navigation test", "",
        "Written by `python validation/systematic_navigation.py`.", "",
        "x up, y east, z north. Alignment over 300 s, ten turns at 18 deg/s about East or North, "
        "500 "
        "s of rest. The shift is the change of the attitude error by the spin, about North in "
        "spins about East and about East in spins about North; the velocity is along East and "
        "along "
        f"North. {RATE:g} Hz, without noise: the angle random walk of the setting, "
        "0.0007 deg/sqrt(h), would add 0.6 arcsec to every single test.", "",
        "## With the truth, beside Table 3 of the source", "",
        "The deflections are such that the closed form gives -27.00 and 25.31 arcsec; the other "
        "errors are drawn, and compensated in all rows.", "", *exact, "",
        "The navigator shows 1 % less than the closed form, for the level frame of its wrong place "
        "has tilted too. What the source has left over is its instrument and its calibration, not "
        "the method. The signs of its velocities are its own.", "",
        "## With calibrations", "",
        f"{draws} instruments, each calibrated from a simulated session of its own by the "
        "procedure, "
        "with the reference noise, and then compensated in the test by what was found, all 30 "
        "coefficients. Before: the same without the deflection. In the last column only the "
        "deflection is from the session, the rest is the truth. Rms after; reductions of the "
        "median and of the worst instrument.", "",
        *lines, "",
        "| session | deflection, rms error (arcsec/g) | sd | half of the instruments above 98 % |",
        "|---|--:|--:|---|", *told, "",
        "Half of the instruments are better than 98 % throughout, after every session. The worst "
        f"of {draws} is not: after the session of the source the noise of its six spins leaves 0.6 "
        "to 0.8 arcsec of the shift, up to 3 %, and no filter does much better: its sd is within "
        "15 % of the Cramer-Rao bound (see [filters](systematic_filters.md); the default starts "
        "every rest anew, which costs these 15 %). Faster and longer spins leave a third. Most of "
        "the velocity that is then left is by the other coefficients of the session: it is less "
        "where the deflection alone is from the session.",
    ])  # fmt: skip
    return 0 if good and all(kept.values()) else 1


if __name__ == "__main__":
    raise SystemExit(main())
