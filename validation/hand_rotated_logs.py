"""Real hand-rotated logs beside other programs and the maker; writes a page of the docs.

Logs are looked for under $FOUCAULT_DATA (default ../shared/data). The reference figures are
those published with the logs.
"""

from __future__ import annotations

import numpy as np
from common import DATA

from foucault.campaign import Campaign, parse, read_log
from foucault.models.imu import Gauge
from foucault.procedures import load
from foucault.result import Result

XSENS = """
[site]
gravity = "9.81744 m/s^2"
[log]
format = "text"
header = "none"
time = {{ column = 0, unit = "s" }}
[log.accel]
file = "{folder}/xsens_acc.mat.gz"
columns = [1, 2, 3]
unit = "count"
scale = "415 count/(m/s^2)"
zero = 33000
[log.gyro]
file = "{folder}/xsens_gyro.mat.gz"
columns = [1, 2, 3]
unit = "count"
scale = "4778 count/(rad/s)"
zero = 32500
[procedure]
name = "{procedure}"
{settings}
"""

MPU = """
[site]
gravity = "9.81 m/s^2"
[log]
file = "{file}"
format = "text"
header = "none"
rate = "100 Hz"
accel = {{ columns = [0, 1, 2], unit = "m/s^2" }}
gyro = {{ columns = [3, 4, 5], unit = "rad/s" }}
[procedure]
name = "hand_rotated"
"""

# imu_tk, converged: rows of K, T and B in counts; X' = T K (X - B).
ACCEL_K = np.array([0.0024127846246, 0.0024271227666, 0.0024116802393])
ACCEL_T = np.array([[1, -0.0033592960, -0.0089064237], [0, 1, -0.0213341326], [0, 0, 1]])
ACCEL_B = np.array([33124.182598, 33275.179403, 32364.415649])
GYRO_K = np.array([0.00020929452485, 0.00020989854198, 0.00020948298376])
GYRO_T = np.array(
    [[1, 0.0059363, 0.0011110], [0.0080881, 1, -0.0535569], [0.0253067, -0.0025514, 1]]
)
GYRO_B = np.array([32777.13994, 32459.80288, 32511.84746])
COSTS = (0.12013119334852, 0.00150695538065)
MAKER = (np.array([415.0, 413.0, 415.0]), np.array([4778.0, 4758.0, 4766.0]))

# mpu9150: scale factor errors of the authors' program and of imu_tk (1/K - 1); gyro alike.
MPU_SCALE = {
    "imu0": (
        np.array([0.00359541, 0.00310805, 0.00658048]),
        1 / np.array([0.9960345, 0.9967543, 0.9936883]) - 1,
        np.array([0.00029091, 0.00450332, 0.00818529]),
        1 / np.array([1.0012936, 0.9952784, 0.9927456]) - 1,
    ),
    "imu1": (
        np.array([0.00466127, 0.00478023, 0.00948553]),
        1 / np.array([0.9952114, 0.9957249, 0.9904612]) - 1,
        np.array([-0.00016523, 0.00243389, -0.00190256]),
        1 / np.array([0.9995462, 0.9984410, 0.9969783]) - 1,
    ),
}


def calibrate(text: str) -> tuple[Campaign, Result]:
    campaign = parse(text, "validation.toml")
    result = load(campaign.procedure).calibrate(
        read_log(campaign), site=campaign.site, settings=campaign.settings
    )
    return campaign, result


def in_counts(result: Result) -> tuple[np.ndarray, ...]:
    """Return T, K, B of accelerometers and gyros as imu_tk writes them (z as reference)."""
    model, _ = result.model.in_gauge(Gauge.UPPER)
    accel = np.linalg.inv(model.accel_matrix) / 415.0
    gyro = np.linalg.inv(model.gyro_matrix) / 4778.0
    k_a, k_g = np.diag(accel), np.diag(gyro)
    return (
        accel / k_a, k_a, 33000 + 415 * model.accel_bias,
        gyro / k_g, k_g, 32500 + 4778 * model.gyro_bias,
    )  # fmt: skip


def published() -> list[str]:
    text = XSENS.format(
        folder=DATA / "xsens_hand_rotated", procedure="hand_rotated_published", settings=""
    )
    _, result = calibrate(text)
    T_a, k_a, b_a, T_g, k_g, b_g = in_counts(result)
    costs = result.diagnostics["costs"]
    rows = [
        ("accelerometer cost", f"{costs[0]:.14f}", f"{COSTS[0]:.14f}", costs[0] / COSTS[0] - 1),
        ("gyro cost", f"{costs[1]:.14f}", f"{COSTS[1]:.14f}", costs[1] / COSTS[1] - 1),
    ]
    for name, ours, theirs in (
        ("accelerometer K", k_a, ACCEL_K), ("accelerometer B", b_a, ACCEL_B),
        ("gyro K", k_g, GYRO_K), ("gyro B", b_g, GYRO_B),
    ):  # fmt: skip
        worst = float(np.abs(ours / theirs - 1).max())
        rows.append((f"{name}, worst of 3, relative", _list(ours), _list(theirs), worst))
    for name, ours, theirs in (("accelerometer", T_a, ACCEL_T), ("gyro", T_g, GYRO_T)):
        worst = float(np.abs(ours - theirs).max())
        rows.append((f"{name} misalignment, worst [rad]", "", "", worst))
    out = ["| quantity | ours | imu_tk | difference |", "|---|---|---|---|"]
    return out + [f"| {n} | {a} | {b} | {d:.1e} |" for n, a, b, d in rows]


def _list(x: np.ndarray) -> str:
    return ", ".join(f"{v:.10g}" for v in x)


def likelihood() -> list[str]:
    out = []
    folder = DATA / "xsens_hand_rotated"
    extra = []
    for settings, label in (("", ""), ("g_sensitivity = true", ", with g-sensitivity")):
        text = XSENS.format(folder=folder, procedure="hand_rotated", settings=settings)
        _, result = calibrate(text)
        _, k_a, _, _, k_g, _ = in_counts(result)
        for triad, ours, theirs, maker in (
            ("accel", 1 / k_a, 1 / ACCEL_K, MAKER[0]), ("gyro", 1 / k_g, 1 / GYRO_K, MAKER[1]),
        ):  # fmt: skip
            sd = result.coefficients[f"{triad}.scale"].sd * maker
            for i, axis in enumerate("xyz"):
                z = (ours[i] - theirs[i]) / sd[i]
                off = 100 * (ours[i] / maker[i] - 1)
                out.append(
                    f"| {triad} {axis}{label} | {ours[i]:.3f} | {sd[i]:.3f} | {theirs[i]:.3f} | "
                    f"{z:+.1f} | {maker[i]:.0f} | {off:+.2f} % |"
                )
        noise = result.diagnostics["noise"]
        g = ""
        if settings:
            c = result.coefficients["gyro.g_sensitivity"]
            k = int(np.argmax(np.abs(c.values)))
            unit = np.degrees(9.80665) * 3600
            g = (
                f" The largest g-sensitivity is {c.names[k]} = {c.values[k] * unit:.0f} "
                f"+- {c.sd[k] * unit:.0f} deg/h/g."
            )
        extra.append(
            f"- Likelihood{label}: verdict {result.verdict.level}; scatter of the rates at rest "
            f"{np.degrees(noise['gyro_repeatability']) * 3600:.0f} deg/h, of the turns "
            f"{np.degrees(noise['turn_repeatability']):.2f} deg.{g}"
        )
        extra += [f"    - {f.message}" for f in result.findings if f.severity == "warning"]
    return [*out, "", *extra]


def mpu() -> list[str]:
    out = []
    notes = []
    for name, (a1, a2, g1, g2) in MPU_SCALE.items():
        _, result = calibrate(MPU.format(file=DATA / "mpu9150_hand_rotated" / f"{name}.log"))
        model, _ = result.model.in_gauge(Gauge.UPPER)
        for triad, matrix, one, two in (
            ("accel", model.accel_matrix, a1, a2), ("gyro", model.gyro_matrix, g1, g2),
        ):  # fmt: skip
            sd = result.coefficients[f"{triad}.scale"].sd
            for i, axis in enumerate("xyz"):
                out.append(
                    f"| {name} {triad}.scale.{axis} | {matrix[i, i] - 1:+.5f} | {sd[i]:.5f} | "
                    f"{one[i]:+.5f} | {two[i]:+.5f} |"
                )
        notes.append(f"- {name}: verdict {result.verdict.level}.")
        notes += [f"    - {reason}" for reason in result.verdict.reasons]
    return [*out, "", *notes]


def main() -> tuple[bool, dict[str, object]]:
    return True, {"published": published(), "likelihood": likelihood(), "mpu": mpu()}
