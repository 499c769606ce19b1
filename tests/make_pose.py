"""A body moved by hand, its IMU and a tracking system: by splines, with no code of the model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import make_interp_spline

from foucault.models.left_out import sizes_of


def motion(rng, duration, vigour=1.0, knots=0.31):
    """Return functions of time: C (n, 3, 3), rate (n, 3), position and acceleration."""
    k = np.arange(-2.0, duration + 2.0, knots)
    angles = make_interp_spline(k, rng.standard_normal((len(k), 3)) * [0.8, 0.35, 0.8], k=5)
    place = make_interp_spline(k, 0.055 * rng.standard_normal((len(k), 3)), k=5)
    angles.c *= vigour
    place.c *= vigour

    def attitude(t):
        a = angles(t)
        z, y, x = (_about(i, a[:, j]) for i, j in ((2, 0), (1, 1), (0, 2)))
        return z @ y @ x

    def rate(t):
        (_, b, c), (da, db, dc) = angles(t).T, angles(t, 1).T
        return np.column_stack(
            [
                dc - da * np.sin(b),
                db * np.cos(c) + da * np.cos(b) * np.sin(c),
                -db * np.sin(c) + da * np.cos(b) * np.cos(c),
            ]
        )

    return attitude, rate, place, lambda t: place(t, 2)


def _about(axis, angle):
    c, s = np.cos(angle), np.sin(angle)
    out = np.zeros((len(angle), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out[:, axis, axis] = 1.0
    out[:, i, i] = out[:, j, j] = c
    out[:, i, j], out[:, j, i] = -s, s
    return out


def quaternion(C):
    """Return quaternions, scalar first, of rotation matrices."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(C).as_quat()[:, [3, 0, 1, 2]]


def session(seed, duration=60.0, vigour=1.0, pose_rate=120.0, sd=(1.745e-3, 5e-4),
            noise=(1.6e-4, 2e-3), rate=200.0, late=0.0, clean=False, base=None):  # fmt: skip
    """Return time, gyro, accel; stamps, positions, attitudes; truth.

    With a base the positions of a second antenna, and the base by itself, are in the truth.
    """
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(seed)
    attitude, turn, place, pull = motion(rng, duration, vigour)
    truth = {
        "C_bm": Rotation.random(random_state=seed).as_matrix(),
        "lever": rng.normal(0, 0.1, 3), "tau": rng.uniform(-0.5, 0.5), "kappa": 2e-5,
        "level": np.radians(2.0) * rng.standard_normal(2) / 1.4,
        "b_g": rng.normal(0, 0.01, 3), "b_a": rng.normal(0, 0.1, 3),
        "M_g": 0.01 * rng.standard_normal((3, 3)),
        "M_a": np.tril(0.01 * rng.standard_normal((3, 3))), "late": late,
    }  # fmt: skip
    q = 0.0 if clean else 1.0
    t = np.arange(0.5, duration + 0.5, 1 / rate)
    C_vl = Rotation.from_rotvec([*truth["level"], 0.0]).as_matrix()
    g_v = C_vl @ [0.0, 0.0, -9.80665]

    def force(at):
        return np.einsum("kji,kj->ki", attitude(at), pull(at) - g_v)

    w = turn(t) @ (np.eye(3) + truth["M_g"]).T + truth["b_g"]
    f = force(t - late) @ (np.eye(3) + truth["M_a"]).T + truth["b_a"]
    w += q * noise[0] * np.sqrt(rate) * rng.standard_normal(w.shape)
    f += q * noise[1] * np.sqrt(rate) * rng.standard_normal(f.shape)
    own = np.arange(0.0, duration, 1 / pose_rate) + 0.5 - truth["tau"]
    middle = (own[0] + own[-1]) / 2
    when = own + truth["tau"] + truth["kappa"] * (own - middle)
    inside = (when > t[2]) & (when < t[-3])
    own, when = own[inside], when[inside]
    truth["tau"] += truth["kappa"] * ((own[0] + own[-1]) / 2 - middle)
    C = attitude(when)
    error = Rotation.from_rotvec(q * sd[0] * rng.standard_normal((len(own), 3))).as_matrix()
    p = place(when) + C @ truth["lever"] + q * sd[1] * rng.standard_normal((len(own), 3))
    if base is not None:
        truth["base"] = np.asarray(base, float)
        two = place(when) + C @ (truth["lever"] + truth["base"])
        noise_2, noise_b = q * sd[1] * rng.standard_normal((2, len(own), 3))
        truth["second"], truth["measured"] = two + noise_2, C @ truth["base"] + noise_b
    return (t, w, f), (own, p, C @ truth["C_bm"] @ error), truth


def values(truth):
    """Return the truth in the order of the parameters."""
    from scipy.spatial.transform import Rotation

    return np.concatenate([
        truth.get("base", Rotation.from_matrix(truth["C_bm"]).as_rotvec()), truth["lever"],
        [truth["tau"], truth["kappa"]], truth["level"], truth["b_g"], truth["b_a"],
        truth["M_g"].ravel(), truth["M_a"][np.tril_indices(3)], [truth["late"]],
    ])  # fmt: skip


def with_terms(log, truth, seed):
    """Put what a MEMS IMU has beside its coefficients into a log, each at its size [SI].

    Terms are of true rates and forces; where the truth has a g-sensitivity G, it is a coefficient.
    """
    f = np.linalg.solve(np.eye(3) + truth["M_a"], (log.accel - truth["b_a"]).T).T
    w = log.gyro - truth["b_g"] - f @ truth.get("G", np.zeros((3, 3))).T
    w = np.linalg.solve(np.eye(3) + truth["M_g"], w.T).T
    draw, usual = np.random.default_rng([seed, 77]).standard_normal, sizes_of("consumer MEMS")
    size = {group: value for group, (value, _) in usual.items()}
    part = (log.time - log.time[0])[:, None] / log.duration - 0.5
    gyro = 0.0 if "G" in truth else f @ draw((3, 3)).T * size["gyro.g_sensitivity"]
    gyro = gyro + draw(3) * w**3 * size["gyro.cubic"] + draw(3) * part * size["gyro.bias drift"]
    gyro += draw(3) * np.abs(w) * size["gyro.asymmetry"]
    accel = draw(3) * f**2 * size["accel.quadratic"]
    accel += draw(3) * part * size["accel.bias drift"]
    return replace(log, gyro=log.gyro + gyro, accel=log.accel + accel)
