"""Are the uncertainties of the zero-velocity filter right? NEES of simulated table sessions.

A table turns the instrument through 19 positions; the filter navigates all the time, takes in zero
velocity and the known position once a second while it rests, and estimates 24 errors of the
sensors beside the nine of navigation. Start errors, sensor errors, noise of the sensors and of
what is measured are drawn from what the filter is told. The readings come from two programs that
share nothing: one in this file, exact rotations and quadrature, and `simulate.motion`. The mean
NEES must lie inside two-sided chi-square limits at 1 % for all tests together, for all states and
for each group, and outside of them where the filter is told something wrong.

The second part compares the covariance of a run without any measurement with many such runs.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from common import limits, word

from foucault import units
from foucault.coefficients import CoefficientVector
from foucault.diagnose.study import nees
from foucault.models.earth import EARTH_RATE, displaced, displacement, east_north_up, gravity
from foucault.models.imu import ImuModel, products
from foucault.models.ins_errors import Sensors
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.rotation import exp, log, matrix_of
from foucault.navigate import ins_filter
from foucault.navigate.increments import Increments
from foucault.navigate.ins_filter import FilterRun, Updates, spread, start_cov
from foucault.navigate.strapdown import State, navigate
from foucault.plans.manoeuvres import Plan, Rest, Rotate, Start
from foucault.simulate.motion import motion_of

DEG = np.pi / 180
ARCSEC = DEG / 3600
LATITUDE, HEIGHT = 39.8 * DEG, 60.0
RATE = 100
MOVE, RAMP = 9.5, 0.5
TOP = 90 * DEG / (MOVE - RAMP)  # 10 deg/s
NOISE = ImuNoise(
    accel=TriadNoise(white=units.parse("5 ug/sqrt(Hz)", "velocity random walk")),
    gyro=TriadNoise(white=units.parse("0.0007 deg/sqrt(h)", "angle random walk")),
)
ATTITUDE_SD = np.array([60.0, 60.0, 600.0]) * ARCSEC
VELOCITY_SD, POSITION_SD = 0.01, 0.01
MEASURED_SD = (1e-3, 1e-2)
UG = units.parse("1 ug", "specific force")
PRIOR = {
    "gyro.bias": 0.02 * DEG / 3600, "gyro.scale": 100e-6, "gyro.misalignment": 100 * ARCSEC,
    "accel.bias": 200 * UG, "accel.scale": 200e-6, "accel.misalignment": 100 * ARCSEC,
    "accel.quadratic": 20 * UG / 9.80665**2,
}  # fmt: skip
NAMES = (
    "gyro.bias", "gyro.scale", "gyro.misalignment", "accel.bias", "accel.scale",
    "accel.misalignment.yx", "accel.misalignment.zx", "accel.misalignment.zy", "accel.quadratic",
)  # fmt: skip
SENSORS = Sensors.of(NAMES)
STATES = SENSORS.states
GROUPS = {
    "all 33": np.arange(33),
    "navigation": np.arange(9),
    **{name: STATES.group(name) for name in PRIOR},
}

# Axis and sense of the 18 turns by 90 deg; x up, y east, z north at the start.
TURNS = (
    *(("y", 1),) * 3, *(("y", -1),) * 3, ("z", 1), *(("x", 1),) * 3, *(("x", -1),) * 3,
    *(("z", 1),) * 2, *(("z", -1),) * 3,
)  # fmt: skip
FIRST = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])


@dataclass(frozen=True)
class Session:
    """True increments (n, 3), those of q(f) (n, 6), and truth at the end; resting: (n,)."""

    time: np.ndarray
    dtheta: np.ndarray
    dvel: np.ndarray
    dproducts: np.ndarray
    resting: np.ndarray
    C_nb: np.ndarray

    def log(self, model: ImuModel, noise: ImuNoise, rng: np.random.Generator) -> Increments:
        """What an instrument says."""
        dt, root, n = 1 / RATE, np.sqrt(1 / RATE), len(self.time)
        white = rng.standard_normal((2, n, 3)) * root
        dtheta = self.dtheta @ model.gyro_matrix.T + model.gyro_bias * dt
        dvel = self.dvel @ model.accel_matrix.T + model.accel_bias * dt
        dvel += self.dproducts @ model.accel_quadratic.T
        return Increments.of(
            self.time, dtheta + noise.gyro.white * white[0], dvel + noise.accel.white * white[1]
        )


def own(rest: float) -> Session:
    """Simulate the table by itself: exact rotations, increments by quadrature."""
    x, weight = np.polynomial.legendre.leggauss(4)
    x, weight = (x + 1) / 2, weight / 2
    w_n = EARTH_RATE * np.array([0.0, np.cos(LATITUDE), np.sin(LATITUDE)])
    g_n = np.array([0.0, 0.0, gravity(LATITUDE, HEIGHT)])
    C = FIRST.copy()
    parts, resting = [], []

    def integrate(C0: np.ndarray, axis: np.ndarray, steps: int, angle, rate) -> None:
        t = (np.arange(steps)[:, None] + x) / RATE
        C_nb = C0 @ exp(angle(t)[..., None] * axis)
        w = np.einsum("skij,i->skj", C_nb, w_n) + rate(t)[..., None] * axis
        f = np.einsum("skij,i->skj", C_nb, g_n)
        both = np.concatenate([w, f, products(f)], axis=-1)
        parts.append(np.einsum("k,skj->sj", weight, both) / RATE)

    def stay() -> None:
        steps = round(rest * RATE)
        integrate(C, np.array([0.0, 0.0, 1.0]), steps, np.zeros_like, np.zeros_like)
        resting.append(np.ones(steps, bool))

    stay()
    for letter, sense in TURNS:
        axis = sense * np.eye(3)["xyz".index(letter)]
        knots = np.array([0.0, RAMP, MOVE - RAMP, MOVE])

        def rate(t: np.ndarray, knots=knots) -> np.ndarray:
            return TOP * np.interp(t, knots, [0.0, 1.0, 1.0, 0.0])

        def angle(t: np.ndarray) -> np.ndarray:
            late = np.maximum(t - (MOVE - RAMP), 0.0)
            early = np.minimum(t, RAMP)
            return TOP * (early**2 / (2 * RAMP) + np.maximum(t - RAMP, 0.0) - late**2 / (2 * RAMP))

        steps = round(MOVE * RATE)
        integrate(C, axis, steps, angle, rate)
        resting.append(np.zeros(steps, bool))
        C = C @ exp(90 * DEG * axis)
        stay()
    total = np.concatenate([parts[0][:1], *parts])
    flags = np.concatenate([[True], *resting])
    time = np.arange(len(total)) / RATE
    return Session(time, total[:, :3], total[:, 3:6], total[:, 6:], flags, C)


def from_motion(rest: float) -> Session:
    """Simulate the same with `simulate.motion`."""
    plan: Plan = [Rest(rest)]
    for letter, sense in TURNS:
        plan = [*plan, Rotate(letter, sense * 90 * DEG, TOP, ramp=RAMP), Rest(rest)]
    # x up, y east, z north: heading east, and a roll of a quarter turn to the left.
    start = Start(LATITUDE, 0.0, HEIGHT, heading=90 * DEG, roll=-90 * DEG)
    assert np.allclose(matrix_of(start.heading, start.pitch, start.roll), FIRST)
    motion, labels = motion_of(plan, start, lead=1 / RATE)
    edges = np.arange(-1, round(motion.end * RATE) + 1) / RATE
    dtheta, dvel = motion.increments(edges)
    # Three of the products in place of f at a time: their integrals.
    halves = [
        motion.increments(edges, lambda f, w, part=part: (products(f)[:, part], w))[1]
        for part in (slice(0, 3), slice(3, 6))
    ]
    time = edges[1:]
    resting = np.zeros(len(time), bool)
    for label, begin, end in labels:
        if label == "Rest":
            resting |= (time > begin + 1e-9) & (time < end + 1e-9)
    resting[0] = True
    C = motion.trajectory(time[-1:]).C_nb[0]
    return Session(time, dtheta, dvel, np.concatenate(halves, axis=1), resting, C)


def epochs(session: Session) -> np.ndarray:
    """Rows once a second at which the table rests."""
    rows = np.arange(RATE, len(session.time), RATE)
    return rows[session.resting[rows]]


def prior() -> np.ndarray:
    sd = np.empty(len(SENSORS))
    for name, value in PRIOR.items():
        sd[SENSORS.layout.group(name)] = value
    return start_cov(np.diag(ATTITUDE_SD**2), VELOCITY_SD, POSITION_SD, sd)


def draw(P0: np.ndarray, rng: np.random.Generator) -> tuple[State, ImuModel, np.ndarray]:
    """Return a wrong start at the true place, the sensors' errors as model and as values."""
    e = np.linalg.cholesky(P0) @ rng.standard_normal(len(P0))
    model = ImuModel.from_coefficients(CoefficientVector(SENSORS.layout, e[9:]))
    return wrong_start(e, FIRST), model, e[9:]


def wrong_start(e: np.ndarray, C_nb: np.ndarray) -> State:
    """Return a state at the site that is wrong by psi, dv, dr."""
    latitude, longitude, height = displaced(LATITUDE, 0.0, HEIGHT, e[6:9])
    # psi is an error against space: the frame of the computed position turns with that.
    C_ln = east_north_up(latitude, longitude).T @ east_north_up(LATITUDE, 0.0)
    return State(
        float(latitude), float(longitude), float(height), C_ln @ e[3:6], exp(-e[:3]) @ C_ln @ C_nb
    )


def measured(rows: np.ndarray, rng: np.random.Generator, position: bool) -> Updates:
    """Zero velocity and the position, as disturbed as the filter is told."""
    at = (LATITUDE, 0.0, HEIGHT) if position else None
    updates = Updates.at_rest(
        rows, velocity_sd=MEASURED_SD[0], position=at, position_sd=MEASURED_SD[1]
    )
    updates.velocity_n[:] = MEASURED_SD[0] * rng.standard_normal((len(rows), 3))
    if position:
        d = MEASURED_SD[1] * rng.standard_normal((len(rows), 3))
        updates.position[:] = np.stack(displaced(LATITUDE, 0.0, HEIGHT, d), axis=-1)
    return updates


def navigation_error(found: FilterRun, C_nb: np.ndarray) -> np.ndarray:
    """Errors psi, dv, dr at the end, shape (9,), for a true place that has not moved."""
    end = found.trajectory.state(-1)
    truth = (LATITUDE, 0.0, HEIGHT)
    C_en, C_el = east_north_up(*truth[:2]), east_north_up(end.latitude, end.longitude)
    psi = -log(end.C_nb @ (C_el.T @ C_en @ C_nb).T)
    d = -displacement(end.latitude, end.longitude, end.height, *truth)
    return np.concatenate([psi, end.velocity_n, d])


@dataclass(frozen=True)
class Case:
    """How the filter is run: what it is told, and whether that is right."""

    name: str
    position: bool = True
    noise: float = 1.0
    quadratic: bool = True
    shrink: float = 1.0


def one(session: Session, case: Case, seed: int) -> tuple[np.ndarray, np.ndarray, float, int]:
    """Errors (33,), covariance, and NIS with its degrees of freedom of one run."""
    rng = np.random.default_rng([seed, 8])
    P0 = prior()
    state, model, values = draw(P0, rng)
    if not case.quadratic:
        keep = np.ones(33)
        keep[GROUPS["accel.quadratic"]] = 1e-6
        P0 = P0 * np.outer(keep, keep)
    told = ImuNoise(
        TriadNoise(white=NOISE.accel.white * case.noise),
        TriadNoise(white=NOISE.gyro.white * case.noise),
    )
    log_ = session.log(model, NOISE, rng)
    updates = measured(epochs(session), rng, case.position)
    found = ins_filter.run(log_, state, SENSORS, updates, P0, told)
    e = np.concatenate([navigation_error(found, session.C_nb), values - found.coefficients[-1]])
    return e, found.cov, float(found.nis.sum()), int(found.measured.sum())


def study(session: Session, case: Case, seeds: range) -> tuple[np.ndarray, ...]:
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        rows = list(pool.map(lambda seed: one(session, case, seed), seeds))
    return tuple(np.array(column) for column in zip(*rows, strict=True))


def group_nees(errors: np.ndarray, covs: np.ndarray) -> dict[str, float]:
    """Mean NEES over the number of states, for each group."""
    return {
        name: float(nees(errors[:, g], covs[:, g[:, None], g]).mean() / len(g))
        for name, g in GROUPS.items()
    }


# -- a run without measurements ------------------------------------------------------------

FREE_RUN = 1800.0
FREE_RATE = 10
FREE_SD = np.array([2e-8] * 3 + [2e-4] * 3)
FREE_NOISE = ImuNoise(accel=TriadNoise(white=3e-4), gyro=TriadNoise(white=1e-6))
BIASES = Sensors.of(("gyro.bias", "accel.bias"))


def free_runs(runs: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors (runs, 9) after half an hour at rest, and the covariance of `spread`."""
    n = round(FREE_RUN * FREE_RATE) + 1
    time = np.arange(n) / FREE_RATE
    dt = 1 / FREE_RATE
    w = EARTH_RATE * np.array([0.0, np.cos(LATITUDE), np.sin(LATITUDE)])
    f = np.array([0.0, 0.0, gravity(LATITUDE, HEIGHT)])
    truth = State.at_rest(np.eye(3), LATITUDE, 0.0, HEIGHT)
    P0 = start_cov(np.diag([5e-5, 5e-5, 5e-4]) ** 2, 1e-2, 1.0, FREE_SD)
    quiet = Increments.of(time, np.tile(w * dt, (n, 1)), np.tile(f * dt, (n, 1)))
    cov = spread(quiet, truth, BIASES, np.array([n - 1]), P0, FREE_NOISE)[0]
    root = np.linalg.cholesky(P0)

    def run(seed: int) -> np.ndarray:
        rng = np.random.default_rng([seed, 9])
        e = root @ rng.standard_normal(15)
        white = np.sqrt(dt) * rng.standard_normal((2, n, 3))
        dtheta = (w + e[9:12]) * dt + FREE_NOISE.gyro.white * white[0]
        dvel = (f + e[12:]) * dt + FREE_NOISE.accel.white * white[1]
        end = navigate(Increments.of(time, dtheta, dvel), wrong_start(e, np.eye(3))).state(-1)
        d = -displacement(end.latitude, end.longitude, end.height, LATITUDE, 0.0, HEIGHT)
        # The meridian of the computed place points elsewhere; that is not an error of the attitude.
        phi = -log(end.C_nb) - np.array([0.0, 0.0, end.longitude * np.sin(LATITUDE)])
        return np.concatenate([phi, end.velocity_n, d])

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return np.array(list(pool.map(run, range(runs)))), cov


# -- tables --------------------------------------------------------------------------------


CASES = (
    Case("told the truth"),
    Case("velocity alone", position=False),
    Case("noise 10 % too small", noise=1 / 1.1),
    Case("covariance 10 % too small", shrink=1.1),
    Case("quadratic terms left out", quadratic=False),
)
RIGHT = 2


def nees_table(runs: int, sessions: dict[str, Session]) -> tuple[list[str], bool, list]:
    """Mean NEES of each group and case, and rms errors beside sds of the first."""
    lines = [
        f"| readings | filter | NIS | {' | '.join(GROUPS)} | inside |",
        f"|---|---|--:|{'--:|' * len(GROUPS)}---|",
    ]
    good, details = True, []
    tests = RIGHT * 2 * (1 + len(GROUPS))
    for first, (source, session) in zip((0, runs), sessions.items(), strict=True):
        for i, case in enumerate(CASES):
            start = perf_counter()
            errors, covs, nis, dof = study(session, case, range(first, first + runs))
            spent = perf_counter() - start
            found = group_nees(errors, covs / case.shrink)
            ratio = float(nis.sum() / dof.sum())
            low, high = limits(int(dof.sum()), tests=tests)
            inside = low <= ratio <= high
            for name, group in GROUPS.items():
                low, high = limits(runs * len(group), tests=tests)
                inside &= low <= found[name] <= high
            shown = " | ".join(f"{v:.3f}" if v < 100 else "> 100" for v in found.values())
            lines.append(f"| {source} | {case.name} | {ratio:.4f} | {shown} | {word(inside)} |")
            print(lines[-1], f"{spent:.1f} s", flush=True)
            good &= inside == (i < RIGHT)
            if i == 0:
                details.append((errors, covs))
    return lines, good, details


def sd_table(details: list[tuple[np.ndarray, np.ndarray]]) -> tuple[list[str], bool]:
    """Rms error and predicted sd of every state."""
    runs = len(details[0][0])
    low, high = (np.sqrt(v) for v in limits(runs, tests=len(details) * 33))
    lines = [
        f"rms error over predicted sd of {runs} runs must lie in {low:.3f} to {high:.3f}.", "",
        "| state | predicted sd | rms / sd, own | rms / sd, simulate.motion |", "|---|--:|--:|--:|",
    ]  # fmt: skip
    ratios = []
    for errors, covs in details:
        sd = np.sqrt(np.diagonal(covs, axis1=1, axis2=2))
        ratios.append(np.sqrt(np.mean((errors / sd) ** 2, axis=0)))
    sds = np.sqrt(np.mean(np.diagonal(details[0][1], axis1=1, axis2=2), axis=0))
    for i, c in enumerate(STATES.coefficients):
        size, unit = IN_UNITS[c.kind]
        lines.append(
            f"| {c.name} | {sds[i] / size:.3g} {unit} | "
            + " | ".join(f"{ratio[i]:.3f}" for ratio in ratios) + " |"
        )  # fmt: skip
    return lines, bool(all(np.all((low <= r) & (r <= high)) for r in ratios))


IN_UNITS = {
    "angle": (ARCSEC, "arcsec"), "velocity": (1e-3, "mm/s"), "length": (1.0, "m"),
    "angular rate": (DEG / 3600, "deg/h"), "specific force": (UG, "ug"),
    "scale factor error": (1e-6, "ppm"), "misalignment": (ARCSEC, "arcsec"),
    "quadratic": (UG / 9.80665**2, "ug/g^2"),
}  # fmt: skip


def free_table(runs: int) -> tuple[list[str], bool]:
    errors, cov = free_runs(runs)
    parts = {
        "all": range(9),
        "attitude": range(3),
        "velocity": range(3, 6),
        "position": range(6, 9),
    }
    lines = []
    good = True
    for name, part in parts.items():
        g = np.array(part)
        one = np.broadcast_to(cov[np.ix_(g, g)], (runs, len(g), len(g)))
        mean = float(nees(errors[:, g], one).mean() / len(g))
        low, high = limits(runs * len(g), tests=len(parts))
        inside, small = low <= mean <= high, low <= mean * 1.1 <= high
        good &= inside
        lines.append(
            f"| {name} | {mean:.4f} | {low:.4f} to {high:.4f} | {word(inside)} | "
            f"{1.1 * mean:.4f}, inside: {word(small)} |"
        )
    sd, rms = np.sqrt(np.diag(cov)), np.sqrt(np.mean(errors**2, axis=0))
    lines += ["", "| | predicted sd | rms |", "|---|--:|--:|"]
    for i, c in enumerate(STATES.coefficients[:9]):
        size, unit = IN_UNITS[c.kind]
        lines.append(f"| {c.name} | {sd[i] / size:.4g} {unit} | {rms[i] / size:.4g} {unit} |")
    return lines, good


def main(runs: int = 200, rest: float = 60.0) -> tuple[bool, dict[str, object]]:
    one, other = own(rest), from_motion(rest)
    still = one.resting & other.resting
    apart = max(
        np.abs(getattr(one, key) - getattr(other, key))[still].max()
        / np.abs(getattr(one, key)).max()
        for key in ("dtheta", "dvel", "dproducts")
    )
    groups, right, details = nees_table(runs, {"own": one, "simulate.motion": other})
    states, close = sd_table(details)
    free, spread_right = free_table(10 * runs)
    low, high = limits(33 * runs, tests=RIGHT * 2 * (1 + len(GROUPS)))
    return right and close and spread_right, {
        "runs": runs,
        "rest": rest,
        "move": MOVE,
        "rate": RATE,
        "latitude": LATITUDE / DEG,
        "low": low,
        "high": high,
        "apart": apart,
        "groups": groups,
        "states": states,
        "many": 10 * runs,
        "minutes": FREE_RUN / 60,
        "free_rate": FREE_RATE,
        "free": free,
    }
