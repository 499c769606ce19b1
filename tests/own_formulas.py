"""What each receiver does with the numbers of its file, from its own source.

Equations by the sources that `export/receivers.toml` names for each: how it corrects readings, and
how far its noise lets an integral and a bias wander.
"""

from __future__ import annotations

from typing import Any

import numpy as np


def corrected(name: str, x: dict[str, Any], accel: Any, gyro: Any) -> tuple[Any, Any]:
    """Return specific force and rate as a receiver computes them from readings."""
    inv = np.linalg.inv
    if name == "kalibr":
        M_g, C, A = x["gyroscopes.M"], x["gyroscopes.C_gyro_i"], x["gyroscopes.A"]
        f = accel @ inv(x["accelerometers.M"]).T
        return f, (gyro - f @ (A @ C).T) @ inv(M_g @ C).T
    if name.startswith("openvins"):
        D_a, D_w = inv(x["imu0.Ta"]), inv(x["imu0.Tw"])
        keep = np.tril if name == "openvins" else np.triu  # what it keeps of its own inverse
        np.testing.assert_allclose(D_a, keep(D_a), atol=1e-15)
        np.testing.assert_allclose(D_w, keep(D_w), atol=1e-15)
        f = accel @ (x["imu0.R_IMUtoACC"].T @ D_a).T
        return f, (gyro - f @ x["imu0.Tg"].T) @ (x["imu0.R_IMUtoGYRO"].T @ D_w).T
    if name == "basalt":
        a, g = x["value0.calib_accel_bias"], x["value0.calib_gyro_bias"]
        S = np.array([[a[3], 0, 0], [a[4], a[6], 0], [a[5], a[7], a[8]]])
        S_g = np.array([g[3:6], g[6:9], g[9:12]]).T
        return accel @ (np.eye(3) + S).T - a[:3], gyro @ (np.eye(3) + S_g).T - g[:3]
    if name == "imucal":
        f = (accel - x["b_a"]) @ (inv(x["R_a"]) @ inv(x["K_a"])).T
        w = np.degrees(gyro) - f @ x["K_ga"].T - x["b_g"]
        return f, np.radians(w @ (inv(x["R_g"]) @ inv(x["K_g"])).T)
    if name == "matlab":
        M_a, M_g = (x[f"{t}.AxesMisalignment"] / 100 for t in ("accel", "gyro"))
        f = (accel - x["accel.ConstantBias"]) @ inv(M_a).T
        return f, (gyro - x["gyro.ConstantBias"]) @ inv(M_g).T
    if name == "psins":
        ug, hour = 9.7803267715e-6, np.radians(1) / 3600
        return tuple(
            (raw - b) @ inv(psins_matrix(x[f"dK{t}ii"], x[f"dK{t}ij"])).T
            for raw, b, t in ((accel, x["db"] * ug, "A"), (gyro, x["eb"] * hour, "G"))
        )  # type: ignore[return-value]
    if name == "pyins":
        return ((accel - x["accel_bias"]) @ inv(x["accel_transform"]).T,
                (gyro - x["gyro_bias"]) @ inv(x["gyro_transform"]).T)  # fmt: skip
    if name == "kf-gins":
        f = (accel - x["initaccbias"] * 1e-5) / (1 + x["initaccscale"] * 1e-6)
        w = gyro - np.radians(x["initgyrbias"]) / 3600
        return f, w / (1 + x["initgyrscale"] * 1e-6)
    if name == "gnss-ins-sim":
        return accel - x["accel_b"], gyro - np.radians(x["gyro_b"]) / 3600
    if name == "ros2":
        return accel @ x["SM"].reshape(3, 3).T - x["bias"], gyro
    keys = {"px4": ("CAL_ACC0_{}OFF", "CAL_ACC0_{}SCALE", "CAL_GYRO0_{}OFF"),
            "ardupilot": ("INS_ACCOFFS_{}", "INS_ACCSCAL_{}", "INS_GYROFFS_{}")}[name]  # fmt: skip
    off, scale, gyro_off = ([x[key.format(axis)] for axis in "XYZ"] for key in keys)
    return (accel - off) * np.array(scale), gyro - gyro_off


def psins_matrix(ii: Any, ij: Any) -> Any:
    K = np.eye(3) + np.diag(ii) * 1e-6
    for (i, j), value in zip([(1, 0), (2, 0), (2, 1), (0, 1), (0, 2), (1, 2)], ij, strict=True):
        K[i, j] = np.radians(value / 3600)
    return K


T = 10.0
"""How long a receiver propagates [s]."""


def propagated(name: str, x: dict[str, Any], triad: str, rate: float) -> tuple[Any, Any]:
    """Return the variance of the integral of the readings after T, and that of the bias [SI]."""
    t = {"accel": 0, "gyro": 1}[triad]
    dt, n = 1 / rate, int(T * rate)

    def of(*keys: str) -> Any:
        return np.asarray(x[keys[t]], float)

    if name in ("vins-mono", "vins-fusion"):  # 0.5 dt (n0 + n1) in each step; dt n of the bias
        return n * 0.5 * dt**2 * of("acc_n", "gyr_n") ** 2, n * (dt * of("acc_w", "gyr_w")) ** 2
    if name == "orb-slam3":  # B = dt I; the walk is added once a sample
        F = np.asarray(x["IMU.Frequency"])
        white = (of("IMU.NoiseAcc", "IMU.NoiseGyro") * np.sqrt(F)) ** 2
        return n * dt**2 * white, n * (of("IMU.AccWalk", "IMU.GyroWalk") / np.sqrt(F)) ** 2
    if name == "fast-lio2":  # (dt F_w) Q (dt F_w)^T
        white = of("mapping.acc_cov", "mapping.gyr_cov")
        return n * dt**2 * white, n * dt**2 * of("mapping.b_acc_cov", "mapping.b_gyr_cov")
    if name.startswith("gtsam"):  # B (cov / dt) B^T; dt times that of the bias
        white = of("setAccelerometerCovariance", "setGyroscopeCovariance")
        walk = of("setBiasAccCovariance", "setBiasOmegaCovariance")
        return n * dt**2 * white / dt, n * dt * walk
    if name == "rovio":
        axes = [x[f"Prediction.PredictionNoise.{k}_{i}"] for i in range(3) for k in of_rovio(triad)]
        return T * np.array(axes[::2]), T * np.array(axes[1::2])
    if name == "robot_localization":  # a measurement: the variance of one sample
        key = ("linear_acceleration_covariance", "angular_velocity_covariance")[t]
        return n * dt**2 * np.reshape(x[key], (3, 3)).diagonal(), None
    if name == "kf-gins":
        tau = float(x["imunoise.corrtime"]) * 3600
        white = of("imunoise.vrw", "imunoise.arw") * (1 / 60, np.radians(1) / 60)[t]
        sd = of("imunoise.abstd", "imunoise.gbstd") * (1e-5, np.radians(1) / 3600)[t]
        return T * white**2, T * 2 * sd**2 / tau
    if name == "gnss-ins-sim":
        white = of("accel_vrw", "gyro_arw") * (1 / 60, np.radians(1) / 60)[t]
        sd = of("accel_b_stability", "gyro_b_stability") * (1, np.radians(1) / 3600)[t]
        return T * white**2, T * 2 * sd**2 / of("accel_b_corr", "gyro_b_corr")
    if name == "psins":
        ug = 9.7803267715e-6
        white = of("wdb", "web") * (ug, np.radians(1) / 60)[t]
        sd = of("sqrtR0A", "sqrtR0G") * (ug, np.radians(1) / 3600)[t]
        return T * white**2, T * 2 * sd**2 / of("TauA", "TauG")
    keys = {  # squared by the receiver as a density
        "kalibr": ("accelerometer_noise_density", "accelerometer_random_walk",
                   "gyroscope_noise_density", "gyroscope_random_walk"),
        "basalt": ("value0.accel_noise_std", "value0.accel_bias_std", "value0.gyro_noise_std",
                   "value0.gyro_bias_std"),
        "msckf-vio": ("noise/acc", "noise/acc_bias", "noise/gyro", "noise/gyro_bias"),
        "maplab": ("sigmas.acc_noise_density", "sigmas.acc_bias_random_walk_noise_density",
                   "sigmas.gyro_noise_density", "sigmas.gyro_bias_random_walk_noise_density"),
        "lio-sam": ("lio_sam.imuAccNoise", "lio_sam.imuAccBiasN", "lio_sam.imuGyrNoise",
                    "lio_sam.imuGyrBiasN"),
        "pyins": ("accel_noise", "accel_bias_walk", "gyro_noise", "gyro_bias_walk"),
    }  # fmt: skip
    keys["openvins"] = keys["openvins-rpng"] = tuple(f"imu0.{k}" for k in keys["kalibr"])
    white, walk = (np.asarray(x[k], float) for k in keys[name][2 * t : 2 * t + 2])
    return T * white**2, T * walk**2


def of_rovio(triad: str) -> tuple[str, str]:
    return ("vel", "acb") if triad == "accel" else ("att", "gyb")
