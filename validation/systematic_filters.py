"""Systematic calibration over the 19 positions and six spins: four filters of the same sessions.

Each filter's errors against what it promises, by group and coefficient; innovations; and how far
the joint filter is from the Cramer-Rao bound, which a batch solution without a filter gives.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from common import each, limits, rms, word
from systematic_setting import (
    BEND,
    DEG,
    FULL,
    NOISE,
    PHI_SD,
    PLAIN,
    RATE,
    SITE,
    UG,
    UNITS,
    Session,
    both_steps,
    group_of,
    groups,
    instrument,
    spread_of,
)

from foucault.coefficients import CoefficientVector
from foucault.diagnose.study import nees
from foucault.estimate.systematic import AtRest, second_step
from foucault.models.earth import displaced
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.rotation import exp
from foucault.navigate.ins_filter import FilterRun, Updates, run, start_cov
from foucault.navigate.strapdown import State
from foucault.simulate.systematic import simulate_systematic

RUNS = 200
SD = spread_of(FULL)
NAMES = FULL.layout.names
KEPT = np.array([NAMES.index(n) for n in PLAIN.layout.names])
GROUPS = groups(FULL)
SHORT = {g: g.replace("accel.", "accelerometer ").replace("gyro.", "gyro ") for g in GROUPS}
FILTERS = {
    "joint": "joint, 39 states over both steps",
    "published": "33 states, covariance set anew, 39 states",
    "carried": "33 states, covariance carried over, 39 states",
    "plain": "33 states over both steps, no deflection",
}
MEASURED = 1e-3, 1e-2
"""What the filter is told: sd of velocity [m/s] and position [m] at rest, once a second."""


@dataclass(frozen=True)
class Scattered(AtRest):
    """Velocities and positions at rest that scatter as much as the filter is told."""

    unit: np.ndarray | None = None  # (seconds, 6)

    def updates(self, increments, rests, site, first) -> Updates:
        out = super().updates(increments, rests, site, first)
        unit = self.unit[_second(increments.time[out.rows])]
        out.velocity_n[:] = self.velocity_sd * unit[:, :3]
        scatter = np.where(out.restart[:, None], 0.0, self.position_sd) * unit[:, 3:]
        place = displaced(site.latitude, 0.0, site.height, scatter)
        out.position[:] = np.stack(place, axis=-1)
        return out


def _second(time: np.ndarray) -> np.ndarray:
    """Return a number of its own for each measurement: rests begin on half seconds too."""
    return np.floor(time + 1e-6).astype(int)


def draw(seed: int):
    """Return truth, session, start attitude, scatter, and how many rests the first step has."""
    rng = np.random.default_rng(seed)
    truth = SD * rng.standard_normal(len(SD))
    plan, part = both_steps()
    made = simulate_systematic(
        plan, site=SITE, model=instrument(FULL, truth), noise=NOISE, rate=RATE, seed=seed + 10**6
    )
    session = Session(made)
    C_nb = exp(-PHI_SD * rng.standard_normal(3)) @ session.start
    unit = rng.standard_normal((round(made.sequence.duration) + 2, 6))
    return truth, session, C_nb, Scattered(*MEASURED, unit=unit), part


def padded(estimate: CoefficientVector) -> tuple[np.ndarray, np.ndarray]:
    """Return values and covariance as of all 39 states: the deflection is zero, and sure."""
    values, cov = np.zeros(len(SD)), np.zeros((len(SD), len(SD)))
    values[KEPT], cov[np.ix_(KEPT, KEPT)] = estimate.values, estimate.cov
    return values, cov


def one(seed: int) -> dict[str, tuple]:
    """Return error and covariance by each filter, and NIS with its degrees of freedom."""
    truth, session, C_nb, scattered, part = draw(seed)
    all_rests = session.rests
    joint = session.solve(FULL, C_nb=C_nb, at_rest=scattered)
    still = session.solve(FULL, C_nb=C_nb)
    plain = session.solve(PLAIN, C_nb=C_nb, at_rest=scattered)
    first = session.solve(PLAIN, C_nb=C_nb, at_rest=scattered, rests=all_rests[:part])
    prior = CoefficientVector(FULL.layout, np.zeros(len(SD)), prior_sd=SD)
    whole = session.model(FULL, at_rest=scattered, rests=all_rests)
    published, _ = second_step(whole, first, first.estimate, prior)
    P = np.diag(np.concatenate([np.zeros(9), SD**2]))
    rows = np.concatenate([np.arange(9), 9 + KEPT])
    P[np.ix_(rows, rows)] = first.cov
    last = session.increments.row_at(float(first.time[-1]))
    carried = run(
        session.increments, first.trajectory.state(-1), FULL,
        scattered.updates(session.increments, all_rests, SITE, last), P, NOISE, first=last,
        estimate=padded(first.estimate)[0],
    )  # fmt: skip
    out = {
        name: (found.values - truth, found.cov)
        for name, found in (("joint", joint.estimate), ("still", still.estimate),
                            ("published", published.estimate), ("carried", carried.estimate))
    }  # fmt: skip
    values, cov = padded(plain.estimate)
    out["plain"] = (values - truth, cov)
    for name, found in (("joint", joint), ("still", still)):
        out[f"nis {name}"] = (by_kind(found), found.measured.sum())
    return out


def by_kind(found: FilterRun) -> np.ndarray:
    """Return the sums of squares of the innovations of velocity and of position, normalised."""
    square = found.innovation**2 / found.variance
    return np.array([np.nansum(square[:, :3]), np.nansum(square[:, 3:])])


# -- the bound -------------------------------------------------------------------------------

BATCH = 5
"""Seconds between measurements of the batch solution; each as good as those it stands for."""


def bound() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the covariance of the best estimate, what it is if nothing scatters, and a filter's.

    All measurements of a session and their covariance at once: ``z = A (x_0, c) + n``, where n is
    what white noise has done, from epoch to epoch through the transitions along the true motion
    with the true coefficients, and the scatter of the measurements. No recursion of a filter.
    """
    truth, session, _, _, _ = draw(0)
    made = simulate_systematic(
        session.made.told, site=SITE, model=instrument(FULL, truth), rate=RATE
    )
    increments = Session(made).increments
    sd = [m / np.sqrt(BATCH) for m in MEASURED]
    updates = AtRest().updates(increments, session.rests, SITE, 0)
    seconds = _second(increments.time[updates.rows])
    wanted = np.isfinite(updates.sd).all(axis=1) & (seconds % BATCH == 0)
    updates.sd[:] = np.inf
    state = State.at_rest(session.start, SITE.latitude, 0.0, SITE.height)
    P0 = start_cov(np.diag(PHI_SD**2), 0.01, 0.01, SD)
    args = increments, state, FULL, updates, P0, NOISE
    walked = run(*args, estimate=truth, keep=True)
    updates.sd[wanted] = np.repeat(sd, 3)
    filtered = run(*args, estimate=truth).cov
    cov, still = _batch(*_responses(walked, wanted), sd, P0, np.sqrt(np.diag(filtered)))
    return cov[9:, 9:], still[9:, 9:], filtered[9:, 9:]


def _batch(A, W, sd, P0, unit) -> tuple[np.ndarray, np.ndarray]:
    """Return the covariance of the best estimate, and what it is if only W scatters.

    In units of the measurements' sd and of about the result, so that nothing cancels.
    """
    scale = np.tile(np.repeat(sd, 3), len(A) // 6)
    A, W = A * unit / scale[:, None], W / np.outer(scale, scale)
    L = np.linalg.cholesky(W + np.eye(len(W)))
    B = np.linalg.solve(L, A)
    D = np.linalg.inv(P0 / np.outer(unit, unit))
    P = np.linalg.inv(B.T @ B + D)
    K = np.linalg.solve(L.T, B) @ P  # the estimate is K' z
    outer = np.outer(unit, unit)
    return P * outer, (K.T @ W @ K + P @ D @ P) * outer


def _responses(walked: FilterRun, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return what start and coefficients do to all measurements, and the covariance by noise."""
    q = np.diag(np.repeat([NOISE.gyro.white**2, NOISE.accel.white**2, 0.0], 3))
    T = np.diff(np.concatenate([[0.0], walked.time]))
    H = np.eye(9)[3:]
    m, n = int(wanted.sum()), walked.transitions.shape[2]
    total, X = np.eye(9, n), np.zeros((9, 9))
    A, W = np.empty((m, 6, n)), np.zeros((m, m, 6, 6))
    links, hop, k = np.empty((m, 9, 9)), np.eye(9), 0
    states = np.empty((m, 9, 9))
    for i, Phi in enumerate(walked.transitions):
        total = Phi[:, :9] @ total
        total[:, 9:] += Phi[:, 9:]
        half = 0.5 * T[i] * q
        X = Phi[:, :9] @ (X + half) @ Phi[:, :9].T + half
        hop = Phi[:, :9] @ hop
        if wanted[i]:
            A[k], links[k], states[k] = H @ total, hop, X
            hop, k = np.eye(9), k + 1
    for k in range(m):
        Y = states[k]
        for j in range(k, m):
            Y = Y if j == k else links[j] @ Y
            W[j, k], W[k, j] = H @ Y @ H.T, (H @ Y @ H.T).T
    return A.reshape(6 * m, n), W.transpose(0, 2, 1, 3).reshape(6 * m, 6 * m)


def quiet_sd() -> float:
    """Return the sd of the deflections where the noise is far smaller than in the setting."""
    noise = ImuNoise(TriadNoise(white=1 * UG), TriadNoise(white=0.0002 * DEG / 60))
    found = Session(draw(0)[1].made).solve(FULL, noise=noise).estimate
    return rms(found.sd[GROUPS["deflection"]])


# -- tables ----------------------------------------------------------------------------------


def mean_nees(err: np.ndarray, cov: np.ndarray, at: np.ndarray) -> float:
    return float(nees(err[:, at], cov[:, at[:, None], at]).mean() / len(at))


def filter_table(found: dict, runs: int) -> tuple[list[str], bool]:
    """Compare the four filters."""
    low, high = limits(runs * len(SD), tests=len(FILTERS))
    lines = []
    inside = {}
    for name, words in FILTERS.items():
        err, cov = found[name]
        sd = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
        at = np.arange(len(SD)) if name != "plain" else KEPT
        value = mean_nees(err, cov, at)
        inside[name] = low < value < high
        cells = [words]
        for g in ("deflection", "gyro.bias", "gyro.misalignment", "accel.bias"):
            none = name == "plain" and g == "deflection"
            unit, k = UNITS[g][0], GROUPS[g]
            pair = f"{rms(err[:, k]) / unit:.4f} / {rms(sd[:, k]) / unit:.4f}"
            cells.append("-" if none else pair)
        lines.append(f"| {' | '.join(cells)} | {value:.3f} | {word(inside[name])} |")
    lines += ["", f"Rms error / predicted sd. NEES over n must lie in {low:.3f} to {high:.3f}."]
    return lines, inside["joint"] and not inside["carried"] and not inside["plain"]


def group_table(found: dict, runs: int, bounds: tuple) -> tuple[list[str], bool]:
    """Test groups and innovations of the joint filter; told scatter, and at perfect rest."""
    tests = len(GROUPS) + 1 + 2
    lines = []
    rows = [("all coefficients", np.arange(len(SD)))]
    rows += [(SHORT[g], at) for g, at in GROUPS.items()]
    good = True
    for label, at in rows:
        low, high = limits(runs * len(at), tests=tests)
        told, still = (mean_nees(*found[name], at) for name in ("joint", "still"))
        good &= low < told < high and still < high
        best, at_rest = (c[np.ix_(at, at)] for c in bounds[:2])
        expected = np.trace(np.linalg.solve(best, at_rest)) / len(at)
        lines.append(
            f"| {label} | {low:.3f} to {high:.3f} | {told:.3f} | {word(low < told < high)} | "
            f"{still:.3f} | {word(still < high)} | {expected:.3f} |"
        )
    (told, dof), (still, _) = (found[f"nis {name}"] for name in ("joint", "still"))
    half = int(dof.sum()) // 2
    low, high = limits(half, tests=tests)
    for k, label in enumerate(("innovations of velocity", "innovations of position")):
        a, b = (float(x[:, k].sum()) / half for x in (told, still))
        good &= low < a < high and b < high
        lines.append(f"| {label} | {low:.4f} to {high:.4f} | {a:.4f} | {word(low < a < high)} | "
                     f"{b:.4f} | {word(b < high)} | |")  # fmt: skip
    return lines, bool(good)


def coefficient_table(found: dict, runs: int, bounds: tuple) -> tuple[list[str], bool]:
    """Every coefficient: sd and rms against the bound, and the chi-square of its errors."""
    best, still, filtered = (np.sqrt(np.diag(c)) for c in bounds)
    err, cov = found["joint"]
    sd = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
    low, high = limits(runs, tests=len(SD))
    lines = []
    good = True
    for i, name in enumerate(NAMES):
        unit, label = UNITS[group_of(name)]
        z = float(np.mean((err[:, i] / sd[:, i]) ** 2))
        good &= low < z < high
        lines.append(
            f"| {name} | {best[i] / unit:.3g} {label} | {rms(sd[:, i]) / best[i]:.4f} | "
            f"{rms(err[:, i]) / best[i]:.3f} | {z:.3f} | {word(low < z < high)} |"
        )
    ratio = np.sqrt(np.mean(sd**2, axis=0)) / best
    # The bound takes the scatter of positions for white; the filter is told a place once a rest.
    good &= bool(ratio.max() < 1.06 and abs(filtered / best - 1).max() < 1e-3)
    lines += [
        "", f"(error / sd)^2 must lie in {low:.3f} to {high:.3f}. A filter with the measurements "
        f"of the batch solution has its covariance to {abs(filtered / best - 1).max():.0e}; the "
        "sd of "
        f"the sessions is {ratio.min():.4f} to {ratio.max():.4f} of the bound: the filter takes "
        "where a rest is for one measurement, which it is on a real table, the batch solution for "
        "150. At perfect rest, "
        "still told that readings scatter, errors are smaller than promised: by the batch "
        f"solution {(still / best).min():.3f} (rms {rms(still / best):.3f}) to "
        f"{(still / best).max():.3f} of "
        "the promised sd.",
    ]  # fmt: skip
    return lines, good


def main(runs: int = RUNS) -> tuple[bool, dict[str, object]]:
    rows = list(each(one, range(runs)))
    found = {
        key: tuple(np.array([row[key][k] for row in rows]) for k in range(2)) for key in rows[0]
    }
    filters, first = filter_table(found, runs)
    bounds = bound()
    parts, second = group_table(found, runs, bounds)
    coefficients, third = coefficient_table(found, runs, bounds)
    return first and second and third, {
        "runs": runs,
        "rate": RATE,
        "latitude": SITE.latitude / DEG,
        "filters": filters,
        "parts": parts,
        "batch": BATCH,
        "coefficients": coefficients,
        "best": rms(np.sqrt(np.diag(bounds[0]))[GROUPS["deflection"]]) / BEND,
        "quiet": quiet_sd() / BEND,
    }
