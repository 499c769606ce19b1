"""Sessions on faces for the tests: short, and readings straight from a model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import ImuModel
from foucault.models.noise import grade
from foucault.models.rests_and_turns import SIX, FaceReadings, TurnReadings
from foucault.models.rotation import exp
from foucault.plans.directions import face_plan
from foucault.procedures import ferraris
from foucault.simulate.hand_rotated import draw_errors, simulate
from foucault.tables import Log

SITE = replace(Site.at(np.radians(48.8462), 60.0), gravity_sd=0.0)
POLE = Site.at(np.pi / 2)  # the Earth's rotation is vertical: nothing of it is unknown
TURN = -2 * np.pi
MEMS = grade("mems").noise

# imucal 2.6.0: sensitivity matrix K R and the rest, in deg/s and m/s^2, g = 9.81, turns -360 deg.
IMUCAL = {
    "K_a": [0.9967458650887003, 1.0024376185894108, 1.0233953475452096],
    "R_a": [[0.9998620291746435, -0.014830571004926794, -0.007481763056406514],
            [0.008576740442555632, 0.9999615197419686, 0.0018435180263559792],
            [0.01333118773067902, 0.002003617949970859, 0.9999091283455711]],
    "b_a": [0.5371174244458201, -0.6162029930860964, 0.3988673423902682],
    "K_g": [1.0279243264288036, 0.9824277738468916, 0.9983104874451514],
    "R_g": [[0.999979342528037, -0.00045421361799804057, -0.006411568231274507],
            [-0.00022220540636464124, 0.9999961009525417, -0.002783649487862618],
            [0.009714004498496572, 0.0076410932929403316, 0.9999236229882218]],
    "b_g": [-0.5996686296674446, -0.36984313466306884, 0.0587739354671091],
    "K_ga": [[0.00038961109153281214, -0.00045815544407725904, -2.9844819440802578e-05],
             [0.0004320123104123373, 0.0004871099695542217, 0.0006178601683550832],
             [9.966554956457076e-05, -9.110691206112818e-05, 0.0002356473632041452]],
}  # fmt: skip


def short_plan(**changes):
    """Rests of 2 s and turns of 2 s."""
    words = {"rest_time": 2.0, "move_time": 1.0, "turn_time": 2.0, "angle": TURN}
    return face_plan(**words | changes)


def short_log(seed=3, model=None, site=SITE, noise=MEMS, rate=100.0, **changes):
    """A session of a MEMS instrument, and the instrument."""
    model = draw_errors("mems", seed) if model is None else model
    plan = short_plan(seed=1000 + seed, **changes)
    log = simulate(plan, model=model, noise=noise, site=site, rate=rate, seed=2000 + seed).log
    return log, model


def calibrate(log, site=SITE, noise=MEMS, **settings):
    return ferraris.calibrate(log, site=site, noise=noise, settings=ferraris.Settings(**settings))


def rough_model(seed=1, quadratic=False, mounting=0.05):
    """Errors in case axes: 10 % of scale, 5 deg of misalignment, 10 % of g, 1 deg/s."""
    rng = np.random.default_rng(seed)
    K = np.zeros((3, 6))
    if quadratic:
        K[:, :3] = np.diag(rng.normal(0, 1e-3, 3))
    body = ImuModel(
        np.eye(3) + np.tril(rng.uniform(-0.1, 0.1, (3, 3))), rng.normal(0, 1, 3), K,
        np.eye(3) + rng.uniform(-0.1, 0.1, (3, 3)), np.radians(rng.normal(0, 1, 3)),
        np.radians(rng.normal(0, 0.01, (3, 3))),
    )  # fmt: skip
    return body, exp(rng.normal(0, mounting, 3))


def perfect(model, C_bk, site, down=()):
    """Readings of six rests and three turns at constant rate, no noise, exact placements."""
    vertical = 0.0 if site.latitude is None else EARTH_RATE * np.sin(site.latitude)
    up = np.array([sign * np.eye(3)[axis] for axis, sign in SIX])
    accel, gyro = model.measure(site.gravity * up @ C_bk.T, vertical * up @ C_bk.T)
    start = 10.0 * np.arange(6)
    rests = FaceReadings(up, accel, gyro, start, np.full(6, 8.0), np.arange(6))
    logs, rows = [], []
    dt, n = 0.01, 400
    for axis in range(3):
        u = np.eye(3)[axis] * (-1 if axis in down else 1)
        rate = TURN / (n * dt) * np.eye(3)[axis] + vertical * u
        f, w = model.measure(site.gravity * u @ C_bk.T, rate @ C_bk.T)
        rows.append((u, w * n * dt, f * n * dt))
        logs.append((np.tile(f, (n, 1)), np.tile(w, (n, 1))))
    log = Log(
        dt * np.arange(3 * n), np.concatenate([w for _, w in logs]),
        np.concatenate([f for f, _ in logs]),
    )  # fmt: skip
    first = n * np.arange(3)
    turns = TurnReadings(
        np.eye(3), np.full(3, TURN), np.array([u for u, _, _ in rows]),
        np.array([w for _, w, _ in rows]), np.array([f for _, _, f in rows]), np.zeros(3),
        log.time[first], np.full(3, n * dt), np.arange(6, 9), first, first + n,
    )  # fmt: skip
    return rests, turns, log


def moved(log, first, last, **columns):
    """The same log with something added to a stretch of it."""
    out = {}
    for name, value in columns.items():
        x = getattr(log, name).copy()
        x[first:last] += value
        out[name] = x
    return replace(log, **out)
