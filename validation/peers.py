"""Other programs on the same input: a magnetometer beside an IMU, and the rotation of a hand-eye.

What is installed is tried. magyc asks for NumPy 1, so that no extra brings it, and works beside a
newer one (`pip install --no-deps magyc navlib jax jaxlib ml_dtypes opt_einsum`). Hand-eye
calibration is in OpenCV 4, no longer in the wheels of OpenCV 5 that the extra `readers` pins.
Sessions are those of the simulators of the tests.
"""

from __future__ import annotations

import importlib
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from common import rms
from scipy.spatial.transform import Rotation

import make_magnetometer
import make_pose
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.pose import PoseTable
from foucault.procedures import imu_pose, magnetometer
from foucault.procedures.imu_pose import PoseLog
from foucault.tables import Log

DEG, G, B = make_magnetometer.DEG, make_magnetometer.G, 49e-6
QUIET = ImuNoise(TriadNoise(white=1e-3), TriadNoise(white=0.007 * DEG))
SETTINGS = magnetometer.Settings(
    gyro_bias_sd=10 * DEG / 3600, gyro_scale_sd=1e-3, gyro_misalignment_sd=0.5e-3,
    accel_bias_sd=1e-3 * G, intensity=B, intensity_sd=5e-9, noise_sd=0.3e-6, wander=False,
)  # fmt: skip
POSED = ImuNoise(TriadNoise(white=2e-3), TriadNoise(white=1.6e-4))
NODES = 60
"""Poses that are handed to a hand-eye calibration, two a second [1]."""


def _ours(log: Log) -> tuple[np.ndarray, np.ndarray]:
    found = magnetometer.calibrate(log, site=Site(G), settings=SETTINGS, noise=QUIET)
    assert found.model is not None
    return found.model.matrix, found.model.bias


def _ellipsoid(log: Log) -> tuple[np.ndarray, np.ndarray]:
    assert log.mag is not None
    A, h = magnetometer.ellipsoid(log.mag)
    return A / B, h


def _magyc(method: str) -> Callable[[Log], tuple[np.ndarray, np.ndarray]]:
    def solved(log: Log) -> tuple[np.ndarray, np.ndarray]:
        assert log.mag is not None and log.gyro is not None
        magyc = importlib.import_module("magyc")
        given: list[Any] = [1e6 * log.mag]
        if method.startswith("magyc"):
            given += [log.gyro, log.time]
        hard, *rest = getattr(magyc, method)(*given)
        h = np.asarray(hard, float).ravel()
        soft = np.asarray(rest[0], float) if np.shape(rest[0]) == (3, 3) else np.eye(3)
        # Whether the matrix is to be inverted is told by the norm of what it leaves.
        tried = [(np.linalg.norm((given[0] - h) @ W.T, axis=1), W)
                 for W in (soft, np.linalg.inv(soft))]  # fmt: skip
        size, W = min(tried, key=lambda one: np.std(one[0]) / np.mean(one[0]))
        return np.linalg.inv(W) * np.mean(size) / (1e6 * B), 1e-6 * h

    return solved


PEERS: dict[str, Callable[[Log], tuple[np.ndarray, np.ndarray]]] = {
    "this program": _ours, "ellipsoid by linear equations": _ellipsoid,
    **{f"magyc {name}": _magyc(name)
       for name in ("ellipsoid_fit", "sphere_fit", "magyc_ls", "magyc_nls")},
}  # fmt: skip


def _magnetometers(sessions: int) -> list[str]:
    shown = []
    for name, solved in PEERS.items():
        hard, headings, spent = [], [], 0.0
        try:
            for seed in range(sessions):
                rng = np.random.default_rng([11, seed])
                truth = make_magnetometer.draw(rng)
                log = make_magnetometer.session(make_magnetometer.free(rng), truth, rng)
                start = time.process_time()
                A, h = solved(log)
                spent += time.process_time() - start
                hard.append(h - truth.h)
                headings.append(make_magnetometer.level_headings(A, h, truth))
        except ImportError as missing:
            shown.append(f"| {name} | not installed here: {missing.name} | - | - |")
            continue
        shown.append(f"| {name} | {1e9 * rms(hard):.3g} | {rms(headings) / DEG:.3g} | "
                     f"{spent / sessions:.2f} |")  # fmt: skip
    return shown


def _hand_eyes(sessions: int) -> list[str]:
    """Rotations of the tracked body, by the rates that a hand-eye calibration cannot use."""
    try:
        cv2 = importlib.import_module("cv2")
    except ImportError:
        return ["| OpenCV | not installed here | - |"]
    if not hasattr(cv2, "calibrateHandEye"):
        return [f"| OpenCV {cv2.__version__} | without hand-eye calibration | - |"]
    kinds = {"Tsai": cv2.CALIB_HAND_EYE_TSAI, "Park": cv2.CALIB_HAND_EYE_PARK,
             "Horaud": cv2.CALIB_HAND_EYE_HORAUD}  # fmt: skip
    site = replace(Site.at(np.radians(48.0)), gravity=G, gravity_sd=0.0)
    errors: dict[str, list[float]] = {"this program": [], **{f"OpenCV, {k}": [] for k in kinds}}
    for seed in range(sessions):
        imu, (t, p, C), truth = make_pose.session(300 + seed, duration=30.0)
        table = PoseTable(t, p, make_pose.quaternion(C))
        found = imu_pose.calibrate(PoseLog.of(Log(*imu), table), site=site, noise=POSED)
        ours = Rotation.from_rotvec(found.coefficients["pose.rotation"].values)
        true = Rotation.from_matrix(truth["C_bm"])
        errors["this program"].append((ours.inv() * true).magnitude())
        # What it takes is a pose of both: the IMU's is integrated, with the true offset of clocks.
        at, gyro = imu[0], imu[1]
        turn = Rotation.from_rotvec(gyro[:-1] * np.diff(at)[:, None])
        own = [Rotation.identity()]
        for one in turn:
            own.append(own[-1] * one)
        when = t + truth["tau"]
        rows = np.searchsorted(t, t[0] + np.arange(NODES) / 2.0)
        rows = rows[rows < len(t)]
        body = [own[k].as_matrix() for k in np.searchsorted(at, when[rows])]
        none = [np.zeros((3, 1))] * len(rows)
        world = [C[k].T for k in rows]
        for name, kind in kinds.items():
            X, _ = cv2.calibrateHandEye(body, none, world, none, method=kind)
            errors[f"OpenCV, {name}"].append((Rotation.from_matrix(X).inv() * true).magnitude())
    return [f"| {name} | {60 * np.degrees(rms(e)):.3g} | {'yes' if k == 0 else 'no'} |"
            for k, (name, e) in enumerate(errors.items())]  # fmt: skip


def main(sessions: int = 10) -> tuple[bool, dict[str, object]]:
    warnings.simplefilter("ignore")
    mags, eyes = _magnetometers(sessions), _hand_eyes(sessions)
    first = float(mags[0].split("|")[3])
    others = [float(row.split("|")[3]) for row in mags[1:] if "not installed" not in row]
    return all(first < x for x in others), {"sessions": sessions, "mags": mags, "eyes": eyes}
