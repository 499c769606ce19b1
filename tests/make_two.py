"""IMUs on one plate moved by hand: by splines, with no code of the model."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

import make_pose

STEP = 1e-4


def session(seed, duration=60.0, vigour=1.0, slaves=1, noise=(1.6e-4, 2e-3), master=(5e-5, 5e-4),
            rate=200.0, late=0.0, kappa=2e-5, motion=None, errors=1.0,
            summed=False):  # fmt: skip
    """Return time, gyro, accel of each, the master first; and what is true of every slave.

    `summed`: what slaves read are means over the interval that ends at each row.
    """
    rng = np.random.default_rng([seed, 2])
    attitude, turn, _, pull = motion or make_pose.motion(rng, duration + 2, vigour)
    up = np.array([0.0, 0.0, 9.80665])

    def moved(t):
        alpha = (turn(t + STEP) - turn(t - STEP)) / (2 * STEP)
        return turn(t), alpha, np.einsum("kji,kj->ki", attitude(t), pull(t) + up)

    def white(sd, n):
        return sd * np.sqrt(rate) * rng.standard_normal((n, 3))

    t = np.arange(0.5, duration + 0.5, 1 / rate)
    w, _, f = moved(t)
    made = [(t, w + white(master[0], len(t)), f + white(master[1], len(t)))]
    truths = []
    for k in range(slaves):
        truth = {
            "C_cb": Rotation.random(random_state=100 * seed + k).as_matrix(),
            "lever": rng.normal(0, 0.1, 3), "tau": rng.uniform(-0.5, 0.5), "kappa": kappa,
            "b_g": errors * rng.normal(0, 0.01, 3), "b_a": errors * rng.normal(0, 0.1, 3),
            "M_g": errors * 0.01 * rng.standard_normal((3, 3)),
            "M_a": np.tril(errors * 0.01 * rng.standard_normal((3, 3))), "late": late,
            "G": errors * 2e-4 * rng.standard_normal((3, 3)),
        }  # fmt: skip
        own = np.arange(0.6, duration + 0.4, 1 / rate)
        stamp = own - truth["tau"]
        stamp = stamp - kappa * (stamp - (stamp[0] + stamp[-1]) / 2)

        def read(at, truth=truth):
            w, a, f = moved(at)
            r = np.broadcast_to(truth["lever"], w.shape)
            y = f + np.cross(a, r) + np.cross(w, np.cross(w, r))
            return w @ truth["C_cb"].T, y @ truth["C_cb"].T

        middle = (stamp[0] + stamp[-1]) / 2
        true = stamp + truth["tau"] + kappa * (stamp - middle)
        n, gyro, accel = len(stamp), 0.0, 0.0
        before, part = np.polynomial.legendre.leggauss(4) if summed else (np.ones(1), [2.0])
        for x, weight in zip(before, part, strict=True):
            then = true - (1 - x) / (2 * rate)
            w_c, f_c = read(then)
            late_f = read(then - late)[1]
            gyro = gyro + weight / 2 * (w_c @ (np.eye(3) + truth["M_g"]).T + f_c @ truth["G"].T)
            accel = accel + weight / 2 * (late_f @ (np.eye(3) + truth["M_a"]).T)
        made.append((stamp, gyro + truth["b_g"] + white(noise[0], n),
                     accel + truth["b_a"] + white(noise[1], n)))  # fmt: skip
        truths.append(truth)
    return made, truths


def values(truth):
    """Return the truth in the order of the parameters."""
    return np.concatenate([
        Rotation.from_matrix(truth["C_cb"]).as_rotvec(), truth["lever"],
        [truth["tau"], truth["kappa"]], truth["b_g"], truth["b_a"], truth["M_g"].ravel(),
        truth["M_a"][np.tril_indices(3)], [truth["late"]], truth["G"].ravel(),
    ])  # fmt: skip
