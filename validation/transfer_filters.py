"""Transfer alignment: do errors have the size that is promised, and how far is it to the bound?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from common import word
from transfer_setting import (
    ARCMIN,
    SITE,
    drawn_delay,
    each,
    found_in,
    missed,
    session_of,
    unit_of,
)

from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise
from foucault.models.rotation import log as rotation_vector
from foucault.navigate.increments import Increments, increments_of
from foucault.navigate.strapdown import navigate
from foucault.procedures.transfer_alignment import simulate
from foucault.procedures.transfer_alignment.problem import problem_of
from foucault.procedures.transfer_alignment.session import Session
from foucault.procedures.transfer_alignment.settings import NOISE, Settings

RUNS, DELAYS = 400, 60  # 200 runs would find a covariance 10 % too small in six of seven only
TOO_SMALL = 0.9


def one(seed: int) -> dict[str, tuple]:
    """Return what was missed by the default, and by filters that are told the delay."""
    delay = drawn_delay(seed)
    made = session_of(seed, Session(message_delay=delay, with_outage=False))
    told = {"delay": f"{1e3 * delay:.12g} ms"}
    kinds = {
        "default": {},
        "told": told,
        "sixteen": told | {"accel_bias_z": False, "vertical": False},
    }
    out = {}
    for name, chosen in kinds.items():
        solution = found_in(made, Settings(left_out=False, **chosen))
        run = solution.fit.run
        nis = run.innovation**2 / run.variance
        out[name] = missed(made, solution), float(np.nansum(nis)), int(np.sum(np.isfinite(nis)))
        if name == "default":
            first = solution.delay
            out["matched"] = first.delay - made.delay, first.delay_sd
    return out


def delays(seed: int) -> dict[str, tuple[float, float]]:
    """Return error and sd of the delay by each of three ways to begin [s]."""
    made = session_of(seed, Session(message_delay=drawn_delay(seed), with_outage=False))
    out = {}
    for method in ("rate matching", "likelihood", "state"):
        solution = found_in(made, Settings(left_out=False, delay_method=method))
        if method == "rate matching":
            out["matched"] = solution.delay.delay, solution.delay.delay_sd
        if method == "likelihood":
            out["likelihood"] = solution.likeliest.delay, solution.likeliest.sd
        v = solution.states["master.delay"]
        out[f"after {method}"] = float(v.values[0]), float(v.sd[0])
    return {name: (tau - made.delay, sd) for name, (tau, sd) in out.items()}


def bound() -> dict[str, float]:
    """Return the Cramer-Rao bound of each coefficient, without filter or error equations.

    One batch: differences of navigations by small errors, with the noise of gyros and
    accelerometers in steps of 1 s and 4 s as unknowns of their own, known to their spread.
    """
    settings = Settings(left_out=False)
    quiet = Session(rate=50.0, master_velocity_sd=0.0, master_attitude_sd=0.0,
                    installation_sd=0.0, with_outage=False)  # fmt: skip
    made = simulate(quiet, model=ImuModel(), noise=ImuNoise(), site=SITE, seed=0)
    p = problem_of(made.log, SITE, settings, NOISE, {})
    x = increments_of(made.made.log)
    first, count = 5, len(p.model.master)
    rows = first + np.round((1 + np.arange(count)) * 5).astype(int)
    rows = rows[rows < len(x) - 1]
    start = made.made.truth.state(first)

    def navigated(dtheta: np.ndarray, dvel: np.ndarray, state=start) -> np.ndarray:
        run = navigate(Increments.of(x.time, dtheta, dvel), state, first=first)
        v, C = run.velocity_n[rows - first], run.C_nb[rows - first]
        turned = rotation_vector(C @ np.swapaxes(made.made.truth.C_nb[rows], 1, 2))
        return np.concatenate([v / settings.velocity_sd, turned / settings.attitude_sd], 1)

    base = navigated(x.dtheta_b, x.dvel_b)
    columns, known = [], []

    def add(moved: np.ndarray, size: float, sd: float) -> None:
        columns.append(((moved - base) / size).ravel())
        known.append(sd)

    layout = p.prior.layout
    for name, sd in zip(p.prior.names, p.prior.prior_sd, strict=True):
        dtheta, dvel, a = x.dtheta_b.copy(), x.dvel_b.copy(), "xyz".find(name[-1])
        size = 0.01 * sd
        if name.startswith("gyro.bias"):
            dtheta[:, a] += size * x.dt
        elif name.startswith("gyro.scale"):
            dtheta[:, a] *= 1 + size
        elif name.startswith("accel.bias"):
            dvel[:, a] += size * x.dt
        if name.startswith("installation"):
            moved = base.copy()
            moved[:, 3:] += size * made.made.truth.C_nb[rows][:, :, a] / settings.attitude_sd
        elif name == "master.delay":  # of the true motion, by what is there a sample later
            t, later = made.made.truth, rows + 1
            dv = (t.velocity_n[later] - t.velocity_n[rows - 1]) / settings.velocity_sd
            turn = rotation_vector(t.C_nb[later] @ np.swapaxes(t.C_nb[rows - 1], 1, 2))
            rate = np.concatenate([dv, turn / settings.attitude_sd], 1) / 0.04
            moved = base + size * rate
        else:
            moved = navigated(dtheta, dvel)
        add(moved, size, sd)
    for k in range(6):
        e, sd = 1e-5 * np.eye(3)[k % 3], p.model.sd[k]
        if k < 3:
            turned = start.C_nb - np.cross(np.tile(e, (3, 1)), start.C_nb.T).T
            add(navigated(x.dtheta_b, x.dvel_b, replace(start, C_nb=turned)), 1e-5, sd)
        else:
            v = start.velocity_n + e
            add(navigated(x.dtheta_b, x.dvel_b, replace(start, velocity_n=v)), 1e-5, sd)
    for kind, seconds, white in (
        ("gyro", 1.0, NOISE.gyro.white),
        ("accel", 4.0, NOISE.accel.white),
    ):
        step = round(50 * seconds)
        for begin in range(first + 1, len(x), step):
            for a in range(3):
                dtheta, dvel = x.dtheta_b.copy(), x.dvel_b.copy()
                some = slice(begin, begin + step)
                (dtheta if kind == "gyro" else dvel)[some, a] += 1e-6 * x.dt[some]
                add(navigated(dtheta, dvel), 1e-6, white / np.sqrt(seconds))
    J = np.array(columns).T * known  # all known to one
    cov = np.linalg.inv(J.T @ J + np.eye(len(known)))
    return {n: float(known[i] * np.sqrt(cov[i, i])) for i, n in enumerate(layout.names)}


def main(runs: int = RUNS) -> tuple[bool, dict[str, object]]:
    least = bound()
    rows = list(each(one, range(runs)))
    names = rows[0]["default"][0].names
    tests = len(names) + 2
    limit = np.array(chi_square_limits(runs, 0.01 / tests)) / runs
    shown = []
    err = np.array([r["default"][0].err for r in rows])
    sd = np.array([r["default"][0].sd for r in rows])
    good, far = True, []
    for i, name in enumerate(names):
        square = float(np.mean((err[:, i] / sd[:, i]) ** 2))
        inside = limit[0] < square < limit[1]
        good &= inside
        size, unit = _unit(name)
        rms, said = np.sqrt(np.mean(err[:, i] ** 2)), np.sqrt(np.mean(sd[:, i] ** 2))
        cells = ["", "", ""]
        if name in least:
            far.append(said / least[name])
            cells = [f"{least[name] / size:.4g}", f"{far[-1]:.3f}", f"{rms / least[name]:.3f}"]
        shown.append(f"| {name} | {unit} | {rms / size:.4g} | {said / size:.4g} | {square:.3f} | "
                     f"{word(inside)} | {' | '.join(cells)} |")  # fmt: skip
    good &= bool(np.all(np.abs(np.array(far) - 1) < 0.05))
    table, right = together(rows, 0.01 / tests)
    return good and right, {
        "runs": runs,
        "tests": tests,
        "low": limit[0],
        "high": limit[1],
        "shown": shown,
        "table": table,
        "of_delay": of_delay(list(each(delays, range(min(runs, DELAYS)))), rows),
    }


def _unit(name: str) -> tuple[float, str]:
    if name.startswith("phi"):
        return ARCMIN, "arcmin"
    return (1e-3, "mm/s") if name.startswith("velocity") else unit_of(name)


def together(rows: list, alpha: float) -> tuple[list[str], bool]:
    """Return NEES and NIS of the filters beside their limits, and whether they are as due."""
    lines = []
    words = {
        "default": "default, delay estimated", "told": "delay known",
        "sixteen": "delay known, the source's 16 states (no bias of accelerometer z)",
    }  # fmt: skip
    inside = {}
    for name, what in words.items():
        found = [r[name] for r in rows]
        n = len(found[0][0].names)
        values = np.mean([m.nees() for m, _, _ in found]) / n
        nis = sum(s for _, s, _ in found) / sum(k for _, _, k in found)
        few = np.array(chi_square_limits(n * len(rows), alpha)) / (n * len(rows))
        many = sum(k for _, _, k in found)
        wide = np.array(chi_square_limits(many, alpha)) / many
        cases = [(what, values)] + ([(f"{what}, P times {TOO_SMALL}", values / TOO_SMALL)]
                                    if name == "default" else [])  # fmt: skip
        for k, (case, value) in enumerate(cases):
            ok, okay = few[0] < value < few[1], wide[0] < nis < wide[1]
            inside[name, k] = ok and (okay or k > 0)
            of_nis = ("", "", "") if k else (f"{nis:.4f}", f"{wide[0]:.4f} to {wide[1]:.4f}",
                                             word(okay))  # fmt: skip
            lines.append(f"| {case} | {n} | {value:.3f} | {few[0]:.3f} to {few[1]:.3f} | "
                         f"{word(ok)} | {' | '.join(of_nis)} |")  # fmt: skip
    right = inside["default", 0] and inside["told", 0]
    return lines, bool(right and not inside["default", 1] and not inside["sixteen", 0])


def of_delay(some: list, rows: list) -> list[str]:
    """Return how well the delay is found."""
    words = {
        "matched": "rate matching, no filter", "likelihood": "maximum likelihood, 0 to 200 ms",
        "after rate matching": "delay state, three passes, begun by rate matching",
        "after likelihood": "delay state, begun by maximum likelihood",
        "after state": "delay state, begun in the middle of the bracket",
    }  # fmt: skip
    lines = [
        f"Drawn from 0 to 200 ms, nothing known before; {len(some)} runs.",
        "",
        "| method | rms error [ms] | largest [ms] | rms of error / sd |",
        "|---|--:|--:|--:|",
    ]
    for name, what in words.items():
        lines.append(_delay_row(what, [r[name] for r in some]))
    lines.append(_delay_row(f"{words['matched']}, {len(rows)} runs", [r["matched"] for r in rows]))
    return lines


def _delay_row(what: str, found: list[tuple[float, float]]) -> str:
    e, sd = np.array(found).T
    rms, most, ratio = 1e3 * np.sqrt(np.mean(e**2)), 1e3 * np.abs(e).max(), np.mean((e / sd) ** 2)
    return f"| {what} | {rms:.3f} | {most:.3f} | {np.sqrt(ratio):.2f} |"
