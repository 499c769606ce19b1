"""Strapdown navigation against the true equations of motion and the formulas of the books.

The truth is integrated in the Earth-fixed frame by a Runge-Kutta method of order 8 that shares
nothing with the navigation but the model of the Earth; increments are integrals by Gauss and
Legendre, exact to rounding. Then errors of a standing instrument over hours and days, coning and
sculling, the vertical channel, and runs there and back.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from common import word
from scipy.linalg import expm

import make_motion
import make_strapdown as made
from foucault.models.earth import EARTH_RATE, gravity, radii
from foucault.models.rotation import log as rotation_vector
from foucault.navigate.increments import increments_of
from foucault.navigate.strapdown import HEIGHT_LOOP, navigate
from foucault.simulate.motion import simulate_motion
from reference import strapdown_step

DEG = np.pi / 180
HOUR = 3600.0
Page = tuple[list[str], bool]


def order() -> Page:
    """Errors at the end of 40 s by the interval, and the order between neighbours."""
    steps = (0.08, 0.04, 0.02, 0.01, 0.005)
    lines = [
        "| motion | interval (ms) | attitude (urad) | velocity (mm/s) | position (mm) "
        "| order of attitude | of velocity |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    good = True
    for name in made.VEHICLES:
        missed = made.order_run(name, steps, 40.0)
        orders = np.log2(missed[:-1] / missed[1:])
        good &= bool(np.all(np.abs(orders[-2:, 0] - 4) < 0.1) and np.all(orders[-2:, 1] > 2.9))
        for i, dt in enumerate(steps):
            a, v, r = missed[i] * [1e6, 1e3, 1e3]
            of = [f"{o:.2f}" if i else "" for o in orders[i - 1, :2]]
            lines.append(
                f"| {'' if i else name} | {1e3 * dt:g} | {a:.3g} | {v:.3g} | {r:.3g} | "
                f"{of[0]} | {of[1]} |"
            )
        print(lines[-1], flush=True)
    return lines, good


def trapezium() -> Page:
    """Position where only the trapezium of the velocities is wrong: dt^2 / 12 by formula."""
    state, w, f = made.vehicle(0.5, 0.3, 100.0, np.array([3.0, 4.0, 0.0]), angle=0.0)
    true = made.true_state(w, f, state, 0.0, 20.0)
    pushed = float(np.linalg.norm(np.diff(f(np.array([0.0, 20.0])), axis=0)))
    lines = ["| interval (ms) | position error (mm) | dt^2 / 12 times the change of force (mm) |",
             "|--:|--:|--:|"]  # fmt: skip
    good = True
    for dt in (0.1, 0.05, 0.02, 0.01):
        time = np.arange(round(20.0 / dt) + 1) * dt
        run = navigate(made.gathered(w, f, time), state)
        away, formula = made.errors(run.state(-1), true)[2], dt**2 / 12 * pushed
        good &= abs(away / formula - 1) < 0.05
        lines.append(f"| {1e3 * dt:g} | {1e3 * away:.4f} | {1e3 * formula:.4f} |")
    return lines, bool(good)


def at_rest() -> Page:
    lines = [
        "| latitude (deg) | interval (s) | attitude (nrad) | velocity (um/s) | position (mm) |",
        "|--:|--:|--:|--:|--:|",
    ]
    good = True
    for latitude in (0.0, 45.0, -60.0, 90.0):
        for dt in (1.0, 0.1, 0.02):
            increments, state = made.standing(latitude * DEG, 6 * HOUR, dt)
            missed = made.errors(navigate(increments, state, vertical="held").state(-1), state)
            a, v, r = missed * [1e9, 1e6, 1e3]
            good &= r < 5.0 or dt > 0.02
            lines.append(f"| {latitude:g} | {dt:g} | {a:.3g} | {v:.3g} | {r:.3g} |")
    return lines, bool(good)


def textbook() -> Page:
    """Northward errors after half a Schuler period, and a day beside the linear equations."""
    latitude = 45 * DEG
    half = round(np.pi / made.schuler_rate(latitude))
    names = made.textbook(latitude, np.zeros(1))
    lines = [
        "| error | north error after half a Schuler period (m) | formula (m) | off by "
        "| a day beside the linear equations |",
        "|---|--:|--:|--:|--:|",
    ]
    good = True
    quiet, state = made.standing_run(latitude, 24 * HOUR, 1.0)
    rows = 900
    base = made.error_history(quiet.every(rows), state)
    for name in names:
        t = np.arange(half + 1.0)
        more, want = made.textbook(latitude, t)[name]
        run, _ = made.standing_run(latitude, 24 * HOUR, 1.0, **more)
        north = (run.latitude[half] - quiet.latitude[half]) * radii(latitude)[0]
        found = made.error_history(run.every(rows), state) - base
        off = linear(latitude, more, found, float(rows))
        # A velocity error is nothing by its formula just there.
        part = (north - want[-1]) / np.abs(want).max()
        good &= abs(part) < 0.02 and off < 3e-3
        lines.append(
            f"| {name} | {north:.3f} | {want[-1]:.3f} | {100 * part:.2f} % | {100 * off:.3f} % |"
        )
    return lines, bool(good)


def linear(latitude: float, more: dict, found: np.ndarray, step: float) -> float:
    """Largest difference to the linear error equations, over the largest of each quantity."""
    A, y = np.zeros((8, 8)), np.zeros(8)
    A[:7, :7] = made.static_error_matrix(latitude)
    A[:3, 7] = -np.array(more.get("gyro_n", (0, 0, 0)))
    A[3:5, 7] = more.get("accel_n", (0, 0, 0))[:2]
    y[:3], y[3:5] = more.get("tilt", (0, 0, 0)), more.get("velocity", (0, 0, 0))[:2]
    y[7] = 1.0
    Phi, want = expm(A * step), [y]
    for _ in range(len(found) - 1):
        want.append(Phi @ want[-1])
    wanted = np.array(want)[:, :7]
    return float((np.abs(found - wanted) / np.abs(wanted).max(axis=0)).max())


def periods() -> Page:
    """Schuler, Foucault and the day."""
    run, _ = made.standing_run(0.0, 6 * HOUR, 1.0, velocity=(0.0, 0.01, 0.0))
    v = run.velocity_n[:, 1]
    k = np.flatnonzero(np.diff(np.sign(v)))
    schuler = 2 * float(np.mean(np.diff(run.time[k] - v[k] / (v[k + 1] - v[k])))) / 60
    formula = 2 * np.pi / made.schuler_rate(0.0) / 60
    lines = ["| what | latitude (deg) | found | formula | off by |", "|---|--:|--:|--:|--:|",
             f"| Schuler period along the meridian (min) | 0 | {schuler:.3f} | {formula:.3f} | "
             f"{100 * (schuler / formula - 1):.2f} % |"]  # fmt: skip
    good = abs(schuler / formula - 1) < 5e-3
    for latitude in (50.0, 30.0, -35.0):
        L = latitude * DEG
        run, _ = made.standing_run(L, 48 * HOUR, 1.0, velocity=(0.0, 0.1, 0.0))
        time, direction = made.swing_direction(run, 2 * np.pi / made.schuler_rate(L))
        turn = float(np.polyfit(time, direction, 1)[0]) / DEG * HOUR
        want = -EARTH_RATE * np.sin(L) / DEG * HOUR
        good &= abs(turn / want - 1) < 5e-3
        lines.append(
            f"| turn of the plane of the Schuler oscillation over 48 h (deg/h) | {latitude:g} | "
            f"{turn:.4f} | {want:.4f} | {100 * (turn / want - 1):.2f} % |"
        )
    latitude = 40 * DEG
    run, state = made.standing_run(latitude, 24 * HOUR, 1.0, tilt=(0.0, 0.0, 1e-5))
    quiet, _ = made.standing_run(latitude, 24 * HOUR, 1.0)
    e = made.error_history(run.every(600), state) - made.error_history(quiet.every(600), state)
    psi = e[:, :3] - np.column_stack([
        -e[:, 5], e[:, 6] * np.cos(latitude), e[:, 6] * np.sin(latitude)
    ])  # fmt: skip
    across = psi[:, 0], psi[:, 2] * np.cos(latitude) - psi[:, 1] * np.sin(latitude)
    angle = np.unwrap(np.arctan2(*across))
    day = 2 * np.pi / abs(np.polyfit(run.every(600).time, angle, 1)[0])
    sidereal = 2 * np.pi / EARTH_RATE
    good &= abs(day / sidereal - 1) < 1e-4
    lines.append(
        f"| circle of an azimuth error, psi (s) | 40 | {day:.1f} | {sidereal:.1f} | "
        f"{100 * (day / sidereal - 1):.4f} % |"
    )
    return lines, bool(good)


def vertical() -> Page:
    """The free channel and the aided one."""
    increments, state = made.standing(90 * DEG, 0.5 * HOUR, 0.1)
    run = navigate(increments, replace(state, height=1.0))
    rate = np.sqrt(2 * gravity(90 * DEG) / radii(90 * DEG)[0])
    lines = ["| free, after (min) | a metre has become (m) | cosh(t sqrt(2 g / R)) (m) |",
             "|--:|--:|--:|"]  # fmt: skip
    good = True
    for minutes in (5, 10, 20, 30):
        h, want = run.height[600 * minutes], np.cosh(rate * 60 * minutes)
        good &= abs(h / want - 1) < 0.02
        lines.append(f"| {minutes} | {h:.4f} | {want:.4f} |")
    increments, state = made.standing(45 * DEG, 15 * HEIGHT_LOOP, 0.01, accel_n=(0.0, 0.0, 0.01))
    lines += [
        "",
        "A start 50 m too high and a vertical accelerometer that is 1 mg off: height (m).",
        "",
        "| heights every (s) | after 1 time constant | 3 | 6 | 10 | 15 |",
        "|--:|--:|--:|--:|--:|--:|",
    ]
    for every in (1, 100, 3000):
        heights = np.full(len(increments), np.nan)
        heights[::every] = 0.0
        aided = navigate(increments, replace(state, height=50.0), vertical="aided", heights=heights)
        at = [aided.height[round(n * HEIGHT_LOOP / 0.01)] for n in (1, 3, 6, 10, 15)]
        good &= abs(at[-1]) < 0.05
        lines.append(f"| {0.01 * every:g} | {' | '.join(f'{h:.3f}' for h in at)} |")
    return lines, bool(good)


def vibration() -> Page:
    """Coning and sculling, with and without what the samples on either side say."""
    dt, good = 0.01, True
    time = np.arange(201) * dt
    lines = [
        "| frequency (Hz) | compensated | coning drift (deg/h) | formula (deg/h) "
        "| sculling drift (ug) | formula (ug) |",
        "|--:|---|--:|--:|--:|--:|",
    ]
    for frequency in (1.0, 2.0, 5.0, 10.0, 20.0):
        for compensated in (False, True):
            x = 2 * np.pi * frequency * dt
            missed = made.residual(x, compensated)
            increments, state, C_nb = made.coning(0.5 * DEG, frequency, time)
            increments = replace(increments, joined=increments.joined & compensated)
            run = navigate(increments, state, vertical="held")
            cone = rotation_vector(run.C_nb[-1] @ C_nb.T)[0] / time[-1]
            cone_formula = -(np.sin(0.5 * DEG) ** 2) * missed / dt
            angle, push = 0.01 * DEG, 10.0
            increments, state, (w, f) = made.sculling(angle, push, frequency, time)
            increments = replace(increments, joined=increments.joined & compensated)
            true = made.true_state(w, f, state, 0.0, time[-1])
            run = navigate(increments, state)
            scull = (run.velocity_n[-1] - true.velocity_n)[2] / time[-1]
            scull_formula = -angle * push * missed / x
            good &= abs(cone / cone_formula - 1) < 1e-3
            # To 1e-6 ug: what is left there is of other terms.
            good &= abs(scull - scull_formula) < 2e-3 * abs(scull_formula) + 1e-11
            lines.append(
                f"| {frequency:g} | {word(compensated)} | {cone / DEG * HOUR:.4g} | "
                f"{cone_formula / DEG * HOUR:.4g} | {scull / 9.80665e-6:.4g} | "
                f"{scull_formula / 9.80665e-6:.4g} |"
            )
        print(lines[-1], flush=True)
    return lines, bool(good)


def third_order() -> Page:
    lines = ["| rate (deg/s) | rate of samples (Hz) | left out: (ug) | (1/6) angle^2 (ug) |",
             "|--:|--:|--:|--:|"]  # fmt: skip
    good = True
    for rate, samples in ((18, 50), (18, 200), (100, 50), (100, 200), (300, 200)):
        dt, g = 1 / samples, 9.80665
        theta, dv = np.array([rate * DEG * dt, 0.0, 0.0]), np.array([0.0, 0.0, g * dt])
        start = np.eye(3), np.zeros(3), np.eye(3), 0.0
        ends = [strapdown_step(start, theta, dv, dt=dt, third=third)[1] for third in (True, False)]
        found, formula = (ends[1] - ends[0])[2] / dt / g, theta[0] ** 2 / 6
        good &= abs(found / formula - 1) < 0.01
        lines.append(f"| {rate} | {samples} | {1e6 * found:.3g} | {1e6 * formula:.3g} |")
    return lines, bool(good)


def closure() -> Page:
    """Simulated motions forward against their truth, and back to where they began."""
    lines = ["| motion | samples | forward: attitude (nrad) | velocity (um/s) | position (mm) "
             "| back: attitude (prad) | velocity (nm/s) | position (um) |",
             "|---|--:|--:|--:|--:|--:|--:|--:|"]  # fmt: skip
    good = True
    plans = {"drive, 16 min": make_motion.drive(), "flight, 16 min": make_motion.flight()}
    for name, plan in plans.items():
        simulated = simulate_motion(plan, make_motion.START, rate=200.0)
        increments, truth = increments_of(simulated.log), simulated.truth
        run = navigate(increments, truth.state(0))
        last = len(increments) - 1
        home = navigate(increments, run.state(-1), first=last, last=0)
        ahead = made.errors(run.state(-1), truth.state(-1))
        back = made.errors(home.state(-1), truth.state(0))
        good &= ahead[2] < 1e-3 and back[2] < 1e-4
        name = name.replace("16", f"{increments.time[-1] / 60:.0f}")
        cells = [*(ahead * [1e9, 1e6, 1e3]), *(back * [1e12, 1e9, 1e6])]
        lines.append(f"| {name} | {last + 1} | " + " | ".join(f"{c:.3g}" for c in cells) + " |")
    for name, (state, w, f) in made.VEHICLES.items():
        increments = made.gathered(w, f, np.arange(12001) * 0.01)
        run = navigate(increments, state)
        home = navigate(increments, run.state(-1), first=12000, last=0)
        back = made.errors(home.state(-1), state)
        good &= back[2] < 1e-4
        cells = [f"{c:.3g}" for c in back * [1e12, 1e9, 1e6]]
        lines.append(f"| {name}, 2 min | 12001 | | | | {' | '.join(cells)} |")
    return lines, bool(good)


PARTS = (
    ("Order of convergence", order,
     "40 s of rocking by 17 deg and more, with pushes of 3 m/s^2 on every axis; heights are "
     "free. Attitude converges with the fourth order of the interval, velocity with the third."),
    ("Position", trapezium,
     "Velocities are added up by the trapezium rule. Without rotation that is all that is wrong, "
     "and it depends on the beginning and the end only."),
    ("At rest for six hours", at_rest,
     "Held height, exact increments. What is left falls with the square of the interval, down to "
     "rounding at the pole."),
    ("Errors of one that stands still", textbook,
     "Latitude 45 deg, level, held height, 1 s. The formulas of the books leave the Earth's "
     "rotation out. The linear equations (attitude, velocity, position: seven states, by the "
     "matrix exponential) do not; the last column is the largest difference to them over a day, "
     "of any of the seven, over the largest that it gets."),
    ("Schuler, Foucault and the day", periods, ""),
    ("Vertical channel", vertical,
     "At the pole, where the Earth's rotation does nothing to it."),
    ("Coning and sculling", vibration,
     "100 Hz. Coning: a cone of 0.5 deg half angle. Sculling: rocking by 0.01 deg with 10 m/s^2 in "
     "phase. With x = 2 pi frequency dt, uncompensated drift has the factor (x - sin x) / 2, and "
     "(x - sin x) / 2 - sin(x) sin(x / 2)^2 / 3 = x^5 / 60 + ... is left by a sample with its "
     "neighbours, of which either says the same of a cone."),
    ("The term of the third order", third_order,
     "Constant rate across a constant force of 1 g. The navigation has the rotation of the force "
     "during an interval in closed form; half of theta x dv alone would leave out:"),
    ("Forward, and back", closure,
     "Simulated motions at 200 Hz with exact increments against their truth; then every run "
     "backward against where it began."),
)  # fmt: skip


def main() -> tuple[bool, dict[str, object]]:
    good, shown = True, []
    for title, part, words in PARTS:
        lines, right = part()
        good &= right
        shown += ["", f"## {title}", "", *([words, ""] if words else []), *lines]
        if not right:
            shown += ["", "**Not as it should be.**"]
            print(title, "is not as it should be", flush=True)
    return good, {"shown": shown}
