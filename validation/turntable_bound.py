"""Calibration on a table against its Cramer-Rao bound, and the joint estimate against the norm.

For each plan and grade thousands of sets of readings: root mean square error over the bound for
every coefficient, and NEES, two-sided at a family-wise false-alarm rate of 1 %. Then the joint
estimate of instrument and table beside norm observation on the same readings, for errors of the
table from nothing to a degree, and whether the table's own errors are found within their sd. Last,
one reading that is off by 1 mg.
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np
from common import limits, must

from foucault.estimate import table as turntable_likelihood
from foucault.estimate.table import Options, TableModel
from foucault.infer import gauss_newton, mixed
from foucault.infer.gauss_newton import chi_square_limits
from foucault.infer.information import information
from foucault.kernels.norm_observation import calibrate_batch
from foucault.models import turntable
from foucault.models.earth import Site
from foucault.models.imu import LINEAR_LOWER, ImuModel
from foucault.models.noise import ImuNoise, Readings, TriadNoise, grade
from foucault.models.turntable import State, Trust
from foucault.plans.directions import table_plan
from foucault.procedures import on_table
from foucault.procedures.norm_observation import Settings as NormSettings
from foucault.procedures.norm_observation import task_of
from foucault.simulate.hand_rotated import draw_errors
from foucault.simulate.table import Rig, simulate_readings

SITE = Site.at(np.radians(45.0))
PLANS = ("icosahedron 12", "dodecahedron 20", "26")
GRADES = ("navigation", "tactical", "mems")
ARCSEC = np.pi / 648000
ACCEL = 9


def solve(readings: Readings, start: State, level: bool) -> gauss_newton.Estimate:
    options = Options(LINEAR_LOWER, lever_arm=True, level=level, repeatability=False)
    return mixed.solve(TableModel(readings, SITE, start, options)).estimate


def bound(readings: Readings, model: ImuModel, *, linear: bool) -> np.ndarray:
    """The bound at the truth: of all readings, or of what the linear solution looks at."""
    options = Options(LINEAR_LOWER, lever_arm=True, level=True, repeatability=False)
    if linear:
        # Accelerometers from the rests alone; the gyros' own frame from the spins alone.
        readings = readings[~readings.spin]
        options = replace(options, names=LINEAR_LOWER[:ACCEL], lever_arm=False, level=False)
    start = turntable_likelihood.free_start(readings, SITE, not linear)
    start = State(model, start.geometry, start.lever_arm)
    stated = TableModel(readings, SITE, start, options)
    return information(mixed.foreseen(stated), stated.layout).sd


def likelihood_part(arguments: tuple) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors, sds and NEES of a part of the draws of one case."""
    plan, grade_name, seed, draws = arguments
    made, model = simulated(plan, grade_name, seed, draws)
    truth = model.coefficients(LINEAR_LOWER).values
    errors, sds, nees = [], [], []
    for i in range(draws):
        readings = made.readings(i)
        start = turntable_likelihood.free_start(readings, SITE, True)
        estimate = solve(readings, start, True)
        e = estimate.coefficients.values - truth
        errors.append(e)
        sds.append(estimate.coefficients.sd)
        nees.append(e @ np.linalg.solve(estimate.coefficients.cov, e))
    return np.array(errors), np.array(sds), np.array(nees)


def simulated(plan: str, grade_name: str, seed: int, draws: int):
    model = draw_errors(grade_name, 5)
    p = table_plan(plan, spin_rate=np.radians(10.0), rest_time=60.0, turns=5)
    rig = Rig(lever_arm=np.array([0.03, -0.02, 0.05]), mounting=np.array([2e-3, -1e-3, 3e-3]))
    made = simulate_readings(
        p, models=model, noise=grade(grade_name).noise, site=SITE, rig=rig, draws=draws, seed=seed
    )
    return made, model


def batch(plan: str, grade_name: str, draws: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors, sds and NEES of the linear solution, all draws at once."""
    made, model = simulated(plan, grade_name, 99, draws)
    spin = made.plan.rate != 0
    h = turntable.mean_rate(made.plan.rate, SITE.latitude)[spin]
    Ma, ba, Mg, bg, _, packed, *_ = calibrate_batch(
        np.ascontiguousarray(made.accel[:, ~spin]), made.accel_variance[~spin],
        np.ascontiguousarray(made.accel[:, spin]), made.accel_variance[spin],
        np.ascontiguousarray(made.gyro[:, spin]), made.gyro_variance[spin], h, SITE.gravity, True,
    )  # fmt: skip
    i = np.arange(3)
    off = [(a, b) for a in range(3) for b in range(3) if a != b]
    values = np.concatenate(
        [
            ba, Ma[:, i, i], np.stack([Ma[:, 1, 0], Ma[:, 2, 0], Ma[:, 2, 1]], 1),
            bg, Mg[:, i, i], np.stack([Mg[:, a, b] for a, b in off], 1),
        ],
        axis=1,
    )  # fmt: skip
    rows, columns = np.tril_indices(21)
    cov = np.zeros((draws, 21, 21))
    cov[:, rows, columns] = cov[:, columns, rows] = packed
    # The kernel's identity is part of the matrices.
    errors = values - in_kernel_order(model)
    sds = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
    nees = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(cov), errors)
    return errors, sds, nees


def in_kernel_order(model: ImuModel) -> np.ndarray:
    M, W = model.accel_matrix, model.gyro_matrix
    off = [W[a, b] for a in range(3) for b in range(3) if a != b]
    return np.array(
        [*model.accel_bias, *np.diag(M), M[1, 0], M[2, 0], M[2, 1], *model.gyro_bias, *np.diag(W),
         *off]
    )  # fmt: skip


def bounds_table(draws: int, pool: ProcessPoolExecutor) -> tuple[list[str], bool]:
    low, high = chi_square_limits(21 * draws, tests=2 * len(PLANS) * len(GRADES))
    lines = [
        f"NEES over 21 must lie in {low / (21 * draws):.4f} to {high / (21 * draws):.4f}; RMS over "
        f"bound of each coefficient in {{ratio}} ({draws} draws each, two-sided, 1 % for the whole "
        "table).",
        "",
        "| plan | grade | solution | NEES/21 | RMS over bound, smallest | largest | inside |",
        "|---|---|---|--:|--:|--:|---|",
    ]
    tests = len(PLANS) * len(GRADES) * (21 + ACCEL + 3)
    ratio = [np.sqrt(v) for v in limits(draws, tests=tests)]
    lines[0] = lines[0].format(ratio=f"{ratio[0]:.4f} to {ratio[1]:.4f}")
    good = True
    for plan in PLANS:
        for grade_name in GRADES:
            made, model = simulated(plan, grade_name, 1, 1)
            readings = made.readings(0)
            whole = bound(readings, model, linear=False)
            rests = bound(readings, model, linear=True)
            parts = [(plan, grade_name, 1000 + k, draws // 20) for k in range(20)]
            done = list(pool.map(likelihood_part, parts))
            cases = {
                "likelihood": (*(np.concatenate(x) for x in zip(*done, strict=True)), whole),
                "linear": (*batch(plan, grade_name, draws), rests),
            }
            for name, (errors, _, nees, smallest) in cases.items():
                rms = np.sqrt((errors**2).mean(axis=0))[: len(smallest)] / smallest
                score = nees.mean() / 21
                inside = bool(
                    low <= nees.sum() <= high and ratio[0] <= rms.min() and rms.max() <= ratio[1]
                )
                good &= inside
                lines.append(
                    f"| {plan} | {grade_name} | {name} | {score:.4f} | {rms.min():.4f} | "
                    f"{rms.max():.4f} | {must(inside)} |"
                )
                print(lines[-1], flush=True)
    lines += [
        "",
        "The bound of the linear solution is that of what it looks at: the accelerometers at rest. "
        "The likelihood uses the spins' specific forces too, and is better by that.",
    ]
    return lines, good


def joint_part(arguments: tuple) -> np.ndarray:
    size, seed, draws = arguments
    rng = np.random.default_rng(seed)
    p = table_plan("icosahedron 12", spin_rate=np.radians(10.0), rest_time=60.0, turns=5)
    common = size * rng.standard_normal((draws, 6))
    rig = Rig(common=common, position_sd=size, mounting=2e-3 * rng.standard_normal((draws, 3)),
              heading=0.4)  # fmt: skip
    noise = ImuNoise(TriadNoise(white=1e-5 * 9.80665 * np.sqrt(60)),
                     TriadNoise(white=np.radians(0.01 / 3600) * np.sqrt(60)))  # fmt: skip
    model = draw_errors("navigation", 5)
    made = simulate_readings(p, models=model, noise=noise, site=SITE, rig=rig, draws=draws,
                             seed=seed)  # fmt: skip
    truth = model.coefficients(LINEAR_LOWER).values
    trust = Trust(np.full(6, size), size, SITE.latitude)
    perfect = Trust(np.zeros(6), 0.0, SITE.latitude)
    rows = []
    for i in range(draws):
        r = made.readings(i)
        free = solve(r, turntable_likelihood.free_start(r, SITE, True), True)
        start = turntable_likelihood.angle_start(r, SITE, perfect if size == 0 else trust)
        joint = solve(r, start, False)
        table = np.zeros(6)
        if size > 0:
            at = len(LINEAR_LOWER) + 6
            sd = np.sqrt(np.diag(joint.state_cov))[at : at + 6]
            table = (joint.state.geometry.common - common[i]) / sd
        e = joint.coefficients.values - truth
        nees = e @ np.linalg.solve(joint.coefficients.cov, e)
        rows.append(np.concatenate([free.coefficients.values - truth, e, table, [nees]]))
    return np.array(rows)


def joint_table(draws: int, pool: ProcessPoolExecutor) -> tuple[list[str], bool]:
    lines = [
        "| error of the table (sd) | joint over norm: largest | accel. bias | accel. scale | "
        "accel. misalignment | gyro bias | gyro rest | NEES/21 | table's errors, RMS over sd |",
        "|---|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    good = True
    groups = {"accel.bias": 0, "accel.scale": 3, "accel.misalignment": 6, "gyro.bias": 9}
    for label, size in (("none", 0.0), ("1 arcsec", 1.0), ("5 arcsec", 5.0), ("1 arcmin", 60.0),
                        ("5 arcmin", 300.0), ("10 arcmin", 600.0), ("1 deg", 3600.0)):  # fmt: skip
        parts = [(size * ARCSEC, 50 + k, draws // 4) for k in range(4)]
        x = np.concatenate(list(pool.map(joint_part, parts)))
        norm, joint = (np.sqrt((x[:, s] ** 2).mean(axis=0)) for s in (slice(0, 21), slice(21, 42)))
        ratio = joint / norm
        table = np.sqrt((x[:, 42:48] ** 2).mean())
        nees = x[:, 48].mean() / 21
        # Paired draws: their ratio scatters far less than either.
        good &= bool(ratio.max() < 1.03)
        cells = [f"{ratio[k : k + 3].mean():.3f}" for k in groups.values()]
        cells.append(f"{ratio[12:].mean():.3f}")
        lines.append(
            f"| {label} | {ratio.max():.3f} | {' | '.join(cells)} | {nees:.3f} | "
            f"{'' if size == 0 else f'{table:.3f}'} |"
        )
        print(lines[-1], flush=True)
    within = [np.sqrt(v) for v in limits(6 * draws, tests=6)]
    lines += ["", f"RMS over sd of the table's six common errors must lie in {within[0]:.3f} to "
              f"{within[1]:.3f} ({draws} draws each)."]  # fmt: skip
    return lines, good


def outliers(draws: int) -> list[str]:
    lines = ["| plan | detected | named | wrongly named | what the report says |",
             "|---|--:|--:|--:|---|"]  # fmt: skip
    for plan in PLANS:
        p = table_plan(plan, spin_rate=1.0, rest_time=60.0, turns=1, spins=False)
        noise = ImuNoise(TriadNoise(white=1e-5 * 9.80665 * np.sqrt(60)))
        made = simulate_readings(p, models=draw_errors("navigation", 5), noise=noise, site=SITE,
                                 draws=draws, seed=3)  # fmt: skip
        rng = np.random.default_rng(4)
        detected = named = wrong = 0
        words = ""
        for i in range(draws):
            r = made.readings(i)
            j = int(rng.integers(len(r)))
            accel = r.accel.copy()
            direction = accel[j] / np.linalg.norm(accel[j])
            accel[j] += 1e-3 * 9.80665 * direction
            r = Readings(r.angles, r.rate, r.turns, r.start, r.time, accel, None, r.accel_cov,
                         r.gyro_cov, declared=True)  # fmt: skip
            task = task_of(NormSettings(plan=plan))
            result = on_table.from_readings(r, task, site=SITE)
            weights = result.tables["readings"]["weight"]
            out = np.flatnonzero(weights < 0.5)
            check = next(c for c in result.checks if c.name == "outliers")
            detected += len(out) > 0 or not check.passed
            named += out.tolist() == [j]
            wrong += len(out) > 0 and out.tolist() != [j]
            words = next(c for c in result.checks if c.name == "control of the rests").sentence
        counts = " | ".join(f"{k}/{draws}" for k in (detected, named, wrong))
        lines.append(f"| {plan} | {counts} | {words} |")
        print(lines[-1], flush=True)
    return lines


def main(draws: int = 5000) -> tuple[bool, dict[str, object]]:
    with ProcessPoolExecutor(2) as pool:
        table, fine = bounds_table(draws, pool)
        joint, never_worse = joint_table(max(draws // 5, 4), pool)
    return fine and never_worse, {
        "table": table,
        "joint": joint,
        "outliers": outliers(max(draws // 25, 4)),
    }
