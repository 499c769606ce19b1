"""What turns and spins show of the deflection: closed form, ranks, sets of poses.

The tilt after whole turns by `models.deflection` beside an integration that is written out here
from the printed equations; how many combinations each model shows by whole turns, and in the 19
positions with six spins; and the quality of the sets of poses.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from common import word
from systematic_setting import (
    ARCSEC,
    BEND,
    DEG,
    PHI_SD,
    PLAIN,
    RATE,
    SITE,
    Session,
    both_steps,
    groups,
    spread_of,
)

from deflected_turns import tilt_rank, whole_turns
from foucault.estimate.systematic import AtRest, Start
from foucault.models.deflection import MODELS, deflection_model
from foucault.models.imu import ImuModel
from foucault.models.rotation import exp
from foucault.models.rotation import log as rotation_vector
from foucault.navigate.increments import increments_of
from foucault.navigate.ins_filter import start_cov
from foucault.navigate.strapdown import State, navigate
from foucault.plans.manoeuvres import Rest
from foucault.plans.sequence import NAMES, CalibrationSequence, poses, quality, spin, spin_axis
from foucault.simulate.systematic import simulate_systematic

Page = tuple[list[str], bool]
G = 9.80665
TURNS = 10
KNOWN = {"simple 6": (7.05, 2.18), "face diagonals 6": (5.46, 1.70), "icosahedral 6": (5.31, 1.66)}
"""Condition number and noise factor A that were known of the sets."""
RANKS = {"coupled6": 6, "direct6": 3, "direct6+transverse3": 6, "lateral3+axial6": 0, "direct12": 3,
         "general18": 6, "symmetric6": 5}  # fmt: skip
"""Combinations that whole turns show, as promised."""


# -- written out: nothing of models.deflection or models.rotation ---------------------------------


def bent(T: np.ndarray, f: np.ndarray, sign: float) -> np.ndarray:
    """M(f) of eqs. (9) and (10); T = xyy, xzz, yzz, yxx, zxx, zyy; the sign is that of spokes."""
    xyy, xzz, yzz, yxx, zxx, zyy = T
    x, y, z = f
    return np.array([
        [0, xyy * y + sign * xzz * z, xzz * z - sign * xyy * y],
        [yxx * x - sign * yzz * z, 0, yzz * z + sign * yxx * x],
        [zxx * x + sign * zyy * y, zyy * y - sign * zxx * x, 0],
    ])  # fmt: skip


def plus(T: np.ndarray, f: np.ndarray) -> np.ndarray:
    """M(f) with plus signs throughout."""
    xyy, xzz, yzz, yxx, zxx, zyy = T
    x, y, z = f
    a, b, c = xyy * y + xzz * z, yzz * z + yxx * x, zxx * x + zyy * y
    return np.array([[0, a, a], [b, 0, b], [c, c, 0]])


def turn(axis: int, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = np.eye(3)
    R[i, i], R[i, j], R[j, i], R[j, j] = c, -s, s, c
    return R


def pose(a: float, b: float) -> np.ndarray:
    """C_nb of eq. (20): a about z of the body, then b about East."""
    return turn(0, b) @ turn(2, a)


def spun(M, C_nb: np.ndarray, axis: int, turns: int, steps: int = 720) -> np.ndarray:
    """Integrate ``phi' = -C M(f) w`` through whole turns by the midpoint rule."""
    phi, h = np.zeros(3), 2 * np.pi / steps
    w = C_nb[axis]
    for k in range(turns * steps):
        C = turn(axis, (k + 0.5) * h) @ C_nb
        phi -= C @ M(G * C[2]) @ w * h
    return phi


# -- tables --------------------------------------------------------------------------------------


def closed_form() -> Page:
    rng = np.random.default_rng(9)
    lines = [
        "| spokes | axis | pose a, b (deg) | integrated phi E, N, U (arcsec) | "
        "closed form less integration (arcsec) |", "|---|---|---|---|--:|",
    ]  # fmt: skip
    worst, still = 0.0, 0.0
    for sign, axis in ((-1, 1), (1, 1), (0, 1), (-1, 0), (1, 0), (0, 0)):
        about = "north" if axis else "east"
        model = deflection_model("coupled6", sign) if sign else deflection_model("symmetric6")
        for _ in range(3):
            a, b = rng.uniform(-180, 180, 2) * DEG
            T = 3 * BEND * rng.standard_normal(6)
            C = pose(a, b)
            M = (lambda f, T=T, s=sign: bent(T, f, s)) if sign else (lambda f, T=T: plus(T, f))
            phi = spun(M, C, axis, TURNS)
            closed = whole_turns(model.tensor(T), C[axis], 2 * np.pi * TURNS, G, about=about)
            off = np.abs(closed - phi).max()
            worst = max(worst, off / np.abs(phi).max())
            still = max(still, abs(phi[axis]) / np.abs(phi).max())
            words = ", ".join(f"{x / ARCSEC:z.7f}" for x in phi)
            name = {-1: "-1", 1: "1", 0: "all plus"}[sign]
            lines.append(f"| {name} | {about} | {a / DEG:.1f}, {b / DEG:.1f} | {words} | "
                         f"{off / ARCSEC:.0e} |")  # fmt: skip
    good = worst < 5e-10 and still < 5e-10
    lines += [
        "", f"Largest difference {worst:.0e} of the largest component (nine digits are 5e-10): "
        f"{word(good)}. About the axis of the spin itself the attitude turns by at most "
        f"{still:.0e} of it: phi_N = 0 in spins about North.",
    ]  # fmt: skip
    return lines, good


def size() -> Page:
    """Ten turns at T = 1 arcsec/g: by the formula, integrated, and navigated."""
    T = np.full(6, BEND)
    lines = ["| | phi E | N | U |", "|---|--:|--:|--:|"]
    rows = {
        "closed form": whole_turns(deflection_model("coupled6").tensor(T), np.eye(3)[1],
                                   2 * np.pi * TURNS, G),
        "integrated": spun(lambda f: bent(T, f, -1), np.eye(3), 1, TURNS),
        "integrated, all plus": spun(lambda f: plus(T, f), np.eye(3), 1, TURNS),
        "navigated, 50 Hz, the Earth turning": navigated(T, 1.0),
        "navigated, the same without deflection": navigated(T, 0.0),
    }  # fmt: skip
    for name, phi in rows.items():
        east, north, up = phi / ARCSEC
        lines.append(f"| {name} | {east:z.4f} | {north:z.4f} | {up:z.4f} |")
    east = [phi[0] / ARCSEC for phi in rows.values()]
    good = all(abs(e - 20 * np.pi) < 1e-6 for e in east[:2]) and abs(east[2]) < 1e-6
    swing = np.sqrt(SITE.gravity / 6.37e6) * (spin("north", TURNS, 18 * DEG).time + 1.0)
    expected = 20 * np.pi * np.sin(swing) / swing
    lines += [
        "", "A navigator that tilts runs away, and the level frame of its place with it: of a tilt "
        "that grows steadily for a time t it feels the part sin(w t) / (w t), w Schuler's "
        f"frequency. That is {expected:.2f} arcsec; the Earth turns some of it to north.",
    ]  # fmt: skip
    return lines, good and abs(east[3] - east[4] - expected) < 0.1


def navigated(T: np.ndarray, factor: float) -> np.ndarray:
    """Simulate a spin of ten turns about North in the first pose; navigate; return phi after it."""
    actions = (Rest(1.0), spin("north", TURNS, 18 * DEG), Rest(1.0))
    model = ImuModel(deflection=factor * deflection_model("coupled6").tensor(T))
    made = simulate_systematic(CalibrationSequence("spin", np.eye(3), actions), site=SITE,
                               model=model, rate=RATE)  # fmt: skip
    state = State.at_rest(np.eye(3), SITE.latitude, 0.0, SITE.height)
    run = navigate(increments_of(made.log), state, vertical="held")
    return -rotation_vector(run.C_nb[-1] @ made.attitude(run.time[-1:])[0].T)


def leg_rank(basis: np.ndarray) -> int:
    """How many combinations the tilts between turns show, on an Earth at rest, free of noise.

    Unknown besides: attitude at the start, gyro bias, scale and misalignments, accelerometer
    bias, scale, asymmetry and misalignments. Seen: the false specific force in every rest.
    """
    plan, _ = both_steps()
    x, weight = np.polynomial.legendre.leggauss(24)
    gyro, rows = np.zeros((3, 15 + len(basis))), []
    gyro[:, :3] = np.eye(3)
    for k, action in enumerate(plan.actions):
        C, a = plan.attitudes[k], plan.axis_b[k]
        if isinstance(action, Rest):
            f = C.T @ [0.0, 0.0, G]
            accel = np.zeros((3, 12))
            accel[:, :9] = np.hstack([np.eye(3), np.diag(f), np.diag(np.abs(f))])
            accel[1, 9], accel[2, 10], accel[2, 11] = f[0], f[0], f[1]
            for time in (0.0, action.time):
                gyro[:, 12:15] -= C * time
                rows.append(np.hstack([np.cross([0.0, 0.0, G], gyro.T).T, C @ accel]))
            continue
        edges = np.linspace(0.0, action.angle, int(np.ceil(abs(action.angle) / (np.pi / 2))) + 1)
        for low, high in pairwise(edges):
            d = weight * (high - low) / 2
            Cs = C @ exp(a * ((low + high) / 2 + (high - low) / 2 * x)[:, None])
            f = G * Cs[:, 2]
            gyro[:, 3:12] -= np.einsum("n,nai,j->aij", d, Cs, a).reshape(3, 9)
            gyro[:, 12:15] -= np.einsum("n,nai->ai", d, Cs) * action.time / action.angle
            gyro[:, 15:] -= np.einsum("n,nai,pijk,nk,j->ap", d, Cs, basis, f, a)
    A = np.concatenate(rows)
    A /= np.maximum(np.linalg.norm(A, axis=0), 1e-9)
    mine = np.arange(15, 15 + len(basis))
    U, s, _ = np.linalg.svd(np.delete(A, mine, axis=1), full_matrices=False)
    Q = U[:, s > 1e-9 * s[0]]
    left = np.linalg.svd(A[:, mine] - Q @ (Q.T @ A[:, mine]), compute_uv=False)
    return int(np.count_nonzero(left > 1e-9))


def spin_rank(basis: np.ndarray) -> int:
    """How many combinations show in tilts after whole turns about North in 40 random poses."""
    rng = np.random.default_rng(1)
    h = 2 * np.pi / 64
    rows = []
    for a, b in rng.uniform(-np.pi, np.pi, (40, 2)):
        C = np.array([turn(1, k * h) @ pose(a, b) for k in range(64)])
        rows.append(-np.einsum("nai,pijk,nk,j->ap", C, basis, C[:, 2], C[0, 1])[0] * h)
    values = np.linalg.svd(np.array(rows), compute_uv=False)
    return int(np.count_nonzero(values > 1e-9))


def worst_sd(session: Session, name: str, at_rest: AtRest) -> np.ndarray:
    """Return the sds of all combinations of a model, nothing being known beforehand."""
    sensors = PLAIN.with_deflection(deflection_model(name))
    mine = groups(sensors)["deflection"]
    sd = spread_of(sensors)
    sd[mine] = 1000 * BEND
    start = Start(0, session.start, start_cov(np.diag(PHI_SD**2), 0.01, 0.01, sd)[:9, :9])
    model = session.model(sensors, at_rest=at_rest)
    found = model.filtered([start], np.zeros(len(sd)), sd)
    return np.sqrt(np.linalg.eigvalsh(found.estimate.cov[np.ix_(mine, mine)])) / BEND


def ranks() -> Page:
    lines = [
        "| model | parameters | whole turns | promised | turns and spins, free of noise | "
        "best seen | worst | worst, decorrelated |", "|---|--:|--:|--:|--:|--:|--:|--:|",
    ]  # fmt: skip
    session = Session(simulate_systematic(both_steps()[0], site=SITE, rate=RATE))
    good = True
    for name in MODELS:
        model = deflection_model(name)
        rank = spin_rank(model.basis)
        good &= rank == tilt_rank(model) == RANKS[name]
        sd, anew = (worst_sd(session, name, AtRest(decorrelate=d)) for d in (False, True))
        lines.append(
            f"| {name} | {len(model)} | {rank} | {RANKS[name]} | {leg_rank(model.basis)} | "
            f"{sd[0]:.3f} | {sd[-1]:.2f} | {anew[-1]:.2f} |"
        )
    return lines, good


def pose_sets() -> Page:
    lines = [
        "| poses | rank | condition | known | A | known |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    good = True
    for name in NAMES:
        angles = poses(name)
        u = spin_axis(angles)
        rows = np.array([
            [spun(lambda f, T=T: bent(T, f, -1), pose(a, b), 1, 1, 64)[0] for T in np.eye(6)]
            for a, b in angles
        ]) / (np.pi * G)  # fmt: skip
        assert np.allclose(u, [pose(a, b)[1] for a, b in angles])
        condition, A = np.linalg.cond(rows), np.sqrt(np.trace(np.linalg.inv(rows.T @ rows)) / 6)
        of = quality(angles)
        good &= bool(np.allclose([condition, A], [of.condition, of.spread], rtol=1e-9))
        cells = ["", ""]
        if name in KNOWN:
            want = KNOWN[name]
            good &= bool(np.all(np.abs(np.array([condition, A]) - want) < 0.006))
            cells = [f"{want[0]:.2f}", f"{want[1]:.2f}"]
        lines.append(f"| {name} | {np.linalg.matrix_rank(rows)} | {condition:.3f} | {cells[0]} | "
                     f"{A:.3f} | {cells[1]} |")  # fmt: skip
    few = np.array([spun(lambda f, T=T: bent(T, f, -1), C, 1, 1, 64)[0] for T in np.eye(6)
                    for C in (pose(0, 0), pose(np.pi / 2, 0), pose(0, -np.pi / 2))])  # fmt: skip
    rank = np.linalg.matrix_rank(few.reshape(6, 3), tol=1e-9)
    lines += ["", f"Three poses with an axis of the body along North have rank {rank}."]
    return lines, good and rank == 3


def main() -> tuple[bool, dict[str, object]]:
    pages = [closed_form(), size(), ranks(), pose_sets()]
    formula, tilt, seen, sets = (lines for lines, _ in pages)
    return all((good for _, good in pages)), {
        "turns": TURNS,
        "formula": formula,
        "tilt": tilt,
        "seen": seen,
        "sets": sets,
    }
