"""Bare logs of known truth, as loggers write them: titles, units, order, dialects."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import permutations, product
from pathlib import Path

import numpy as np

from foucault import campaign, logs
from foucault.errors import FoucaultError
from foucault.recognise.reading import Recognised, recognise

G = 9.80665
DEGREE = np.pi / 180


@cache
def truth(seed: int = 1, rate: float = 100.0, rests: int = 16, procedure: str = "hand_rotated"):
    """Return a simulated log [SI]: hand-held rests and turns, of a MEMS instrument."""
    text = campaign.template(procedure)
    head, _, tail = text.partition("[simulate]")
    lines = {"rests": rests, "rest_time": '"3 s"', "rate": f'"{rate} Hz"'}
    kept = [
        line for line in tail.splitlines()
        if line.partition("=")[0].strip(" #") not in lines
    ]  # fmt: skip
    known = {k: v for k, v in lines.items() if f"\n{k} =" in tail or f"\n# {k} =" in tail}
    tail = "\n".join([*(f"{k} = {v}" for k, v in known.items()), *kept])
    made = campaign.simulate(campaign.parse(f"{head}[simulate]\n{tail}"), seed)
    return made.simulation.log


@dataclass(frozen=True)
class Columns:
    """What a file is made of: time [s], specific force [m/s^2], rate [rad/s]."""

    t: np.ndarray
    f: np.ndarray
    w: np.ndarray

    @classmethod
    def of(cls, log) -> Columns:
        return cls(log.time, log.accel, log.gyro)

    @property
    def mag(self) -> np.ndarray:
        """A magnetometer's readings that turn as gravity does, of another length [uT]."""
        return np.roll(self.f / np.linalg.norm(self.f, axis=1, keepdims=True), 1, axis=1) * 46.0

    @property
    def warm(self) -> np.ndarray:
        """A temperature that creeps [degC]."""
        return 25.0 + 3.0 * (1.0 - np.exp(-(self.t - self.t[0]) / 60.0))


def numbers(table: np.ndarray, form: Sequence[str], delimiter: str = ",") -> str:
    line = delimiter.join(form) + "\n"
    return "".join(line % tuple(row) for row in table.tolist())


def text(head: str, parts: Sequence[np.ndarray], form: Sequence[str], delimiter: str = ",") -> str:
    table = np.column_stack(parts)
    return head + ("\n" if head else "") + numbers(table, form, delimiter)


# -- loggers -------------------------------------------------------------------------------------
# Titles of those with a + were seen in public files; the others follow what their makers describe.


def phyphox(c: Columns) -> str:
    head = ",".join(
        ['"Time (s)"', *(f'"Acceleration {a} (m/s^2)"' for a in "xyz"),
         '"Absolute acceleration (m/s^2)"', *(f'"Gyroscope {a} (rad/s)"' for a in "xyz")]
    )  # fmt: skip
    size = np.linalg.norm(c.f, axis=1)
    return text(head, [c.t, c.f, size, c.w], ["%.9e"] * 8)


def sensor_logger(c: Columns) -> str:
    head = (
        "time,seconds_elapsed,accelerometer_z,accelerometer_y,accelerometer_x,gyroscope_z,"
        "gyroscope_y,gyroscope_x"
    )
    epoch = np.round(1.7e9 + c.t, 3) * 1e9
    return text(head, [epoch, c.t, c.f[:, ::-1], c.w[:, ::-1]], ["%.0f", "%.4f", *["%.7f"] * 6])


def physics_toolbox(c: Columns) -> str:
    return text("time,gFx,gFy,gFz,wx,wy,wz,", [c.t, c.f / G, c.w], ["%.4f", *["%.5f"] * 6]).replace(
        "\n", ",\n"
    ).replace(",,\n", ",\n")  # fmt: skip


def sensorlog_ios(c: Columns) -> str:  # +
    head = "loggingTime(txt),loggingSample(N),accelerometerTimestamp_sinceReboot(s)," + ",".join(
        [*(f"accelerometerAcceleration{a}(G)" for a in "XYZ"),
         *(f"gyroRotation{a}(rad/s)" for a in "XYZ")]
    )  # fmt: skip
    rows = numbers(np.column_stack([c.t + 34567.0, -c.f / G, c.w]), ["%.6f"] * 7).splitlines()
    stamped = [f"2026-05-04T10:{s // 60:02.0f}:{s % 60:06.3f}+02:00,{i + 1},{row}"
               for i, (s, row) in enumerate(zip(c.t - c.t[0], rows, strict=True))]  # fmt: skip
    return "\n".join([head, *stamped]) + "\n"


def px4(c: Columns) -> str:  # +
    head = ",".join(
        ["timestamp", *(f"gyro_rad[{i}]" for i in range(3)), "gyro_integral_dt",
         "accelerometer_timestamp_relative", *(f"accelerometer_m_s2[{i}]" for i in range(3)),
         "accelerometer_integral_dt", "accelerometer_clipping"]
    )  # fmt: skip
    n = len(c.t)
    dt, zero = np.full(n, 1e6 * np.median(np.diff(c.t))), np.zeros(n)
    return text(head, [1e6 * c.t + 7e7, c.w, dt, zero, c.f, dt, zero],
                ["%.0f", *["%.8f"] * 3, "%.0f", "%.0f", *["%.6f"] * 3, "%.0f", "%.0f"])  # fmt: skip


def xsens(c: Columns) -> str:  # +
    head = "\n".join(
        ["// General information:", "//  MT Manager version: 2022.2.0",
         "//  Filter Profile: human(46.1)", "// Coordinate system: ENU",
         "PacketCounter\tSampleTimeFine\tYear\tMonth\tDay\tSecond\tAcc_X\tAcc_Y\tAcc_Z\tGyr_X"
         "\tGyr_Y\tGyr_Z\tMag_X\tMag_Y\tMag_Z\tRoll\tPitch\tYaw"]
    )  # fmt: skip
    n = len(c.t)
    nan = np.full((n, 4), np.nan)
    form = ["%.0f", "%.0f", *["%.0f"] * 4, *["%.6f"] * 12]
    tilt = np.degrees(np.arctan2(c.f, np.roll(c.f, 1, axis=1)))
    parts = [51400 + np.arange(n), 1e4 * c.t + 12345, nan, c.f, c.w, c.mag / 46, tilt]
    return text(head, parts, form, "\t").replace("nan", "NaN")


def vectornav(c: Columns) -> str:
    head = (
        "TimeStartup,UncompMagX,UncompMagY,UncompMagZ,UncompAccX,UncompAccY,UncompAccZ,"
        "UncompGyroX,UncompGyroY,UncompGyroZ,ImuTemp,ImuPres"
    )
    turned = np.array([1.0, -1.0, -1.0])  # forward-right-down from forward-left-up: a rotation
    parts = [1e9 * c.t, c.mag / 100, c.f * turned, c.w * turned, c.warm, 101.3 + 0 * c.t]
    return text(head, parts, ["%.0f", *["%.6f"] * 11])


def ngimu(c: Columns) -> str:
    head = (
        "Time (s),Gyroscope X (deg/s),Gyroscope Y (deg/s),Gyroscope Z (deg/s),"
        "Accelerometer X (g),Accelerometer Y (g),Accelerometer Z (g),Magnetometer X (uT),"
        "Magnetometer Y (uT),Magnetometer Z (uT),Barometer (hPa)"
    )
    parts = [c.t, c.w / DEGREE, c.f / G, c.mag, 1013.0 + 0.1 * np.sin(c.t)]
    return text(head, parts, ["%.6f"] * 11)


def x_io3(c: Columns) -> str:
    head = (
        "Timestamp (us),Gyroscope X (deg/s),Gyroscope Y (deg/s),Gyroscope Z (deg/s),"
        "Accelerometer X (g),Accelerometer Y (g),Accelerometer Z (g)"
    )
    return text(head, [1e6 * c.t, c.w / DEGREE, c.f / G], ["%.0f", *["%.4f"] * 6])


def invensense(c: Columns) -> str:
    head = "ms,ax,ay,az,gx,gy,gz,temp"
    raw = [np.round(c.f / G * 4096), np.round(c.w / DEGREE * 16.4)]
    return text(head, [np.round(1e3 * c.t), *raw, np.round(340 * (c.warm - 36.53))], ["%.0f"] * 8)


def arduino_print(c: Columns) -> str:
    raw = [np.round(c.f / G * 8192), np.round(c.w / DEGREE * 32.8)]
    rows = numbers(np.column_stack(raw), ["%.0f"] * 6, "\t").splitlines()
    return "\n".join(f"a/g:\t{row}" for row in rows) + "\n"


def matlab(c: Columns) -> str:
    head = "time,a_b_x,a_b_y,a_b_z,w_b_p,w_b_q,w_b_r"
    return text(head, [c.t, c.f, c.w], ["%.15g"] * 7)


def rostopic(c: Columns) -> str:  # +
    nine = lambda name: [f"field.{name}_covariance{i}" for i in range(9)]  # noqa: E731
    head = ",".join(
        ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id",
         *(f"field.orientation.{a}" for a in "xyzw"), *nine("orientation"),
         *(f"field.angular_velocity.{a}" for a in "xyz"), *nine("angular_velocity"),
         *(f"field.linear_acceleration.{a}" for a in "xyz"), *nine("linear_acceleration")]
    )  # fmt: skip
    n = len(c.t)
    stamp = np.round(1e9 * (1.7e9 + c.t))
    q, cov = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)), np.zeros((n, 9))
    rows = numbers(np.column_stack([q, cov, c.w, cov, c.f, cov]), ["%.9g"] * 37).splitlines()
    lines = [f"{s:.0f},{i},{s:.0f},imu_link,{row}"
             for i, (s, row) in enumerate(zip(stamp, rows, strict=True))]  # fmt: skip
    return "\n".join([head, *lines]) + "\n"


def bagpy(c: Columns) -> str:
    head = ",".join(
        ["Time", "header.seq", "header.stamp.secs", "header.stamp.nsecs", "header.frame_id",
         *(f"orientation.{a}" for a in "xyzw"), *(f"angular_velocity.{a}" for a in "xyz"),
         *(f"linear_acceleration.{a}" for a in "xyz")]
    )  # fmt: skip
    rows = numbers(np.column_stack([np.tile([0.0, 0, 0, 1], (len(c.t), 1)), c.w, c.f]),
                   ["%.9g"] * 10).splitlines()  # fmt: skip
    lines = [f"{1.7e9 + s:.6f},{i},{1.7e9 + s // 1:.0f},{1e9 * (s % 1):.0f},imu,{row}"
             for i, (s, row) in enumerate(zip(c.t, rows, strict=True))]  # fmt: skip
    return "\n".join([head, *lines]) + "\n"


def bosch(c: Columns) -> str:
    head = "Time[us]\tACC_X[mg]\tACC_Y[mg]\tACC_Z[mg]\tGYRO_X[dps]\tGYRO_Y[dps]\tGYRO_Z[dps]"
    return text(head, [1e6 * c.t, 1e3 * c.f / G, c.w / DEGREE], ["%.0f", *["%.3f"] * 6], "\t")


def german(c: Columns) -> str:
    head = (
        "Zeit (ms);Beschleunigung X (m/s²);Beschleunigung Y (m/s²);Beschleunigung Z (m/s²);"
        "Drehrate X (°/s);Drehrate Y (°/s);Drehrate Z (°/s);Temperatur (°C)"
    )
    body = text("", [1e3 * c.t, c.f, c.w / DEGREE, c.warm], ["%.1f", *["%.5f"] * 7], ";")
    return head + "\n" + body.replace(".", ",")


def chinese(c: Columns) -> str:
    head = (
        "时间(s),加速度X(g),加速度Y(g),加速度Z(g),"
        "角速度X(°/s),角速度Y(°/s),角速度Z(°/s),角度X(°),温度(°C)"
    )
    parts = [c.t, c.f / G, c.w / DEGREE, np.degrees(np.arctan2(c.f[:, 1], c.f[:, 2])), c.warm]
    return text(head, parts, ["%.3f", *["%.4f"] * 8])


def witmotion(c: Columns) -> str:
    head = "Time(s)\tax(g)\tay(g)\taz(g)\twx(deg/s)\twy(deg/s)\twz(deg/s)\tAngleX(deg)\tT(°)"
    parts = [c.t, c.f / G, c.w / DEGREE, np.degrees(np.arctan2(c.f[:, 1], c.f[:, 2])), c.warm]
    return text(head, parts, ["%.3f", *["%.4f"] * 8], "\t")


def ardupilot(c: Columns) -> str:
    head = "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"
    zero = 0 * c.t
    parts = [1e6 * c.t + 3e7, zero, c.w, c.f, zero, zero, c.warm, zero + 1, zero + 1, zero + 1000,
             zero + 1000]  # fmt: skip
    return text(head, parts, ["%.0f", "%.0f", *["%.7f"] * 6, *["%.4f"] * 7])


def shimmer(c: Columns) -> str:
    name = "Shimmer_6749"
    titles = [f"{name}_Timestamp_Unix_CAL", *(f"{name}_Accel_LN_{a}_CAL" for a in "XYZ"),
              *(f"{name}_Gyro_{a}_CAL" for a in "XYZ")]  # fmt: skip
    units = ["ms", *["m/(s^2)"] * 3, *["deg/s"] * 3]
    head = "sep=,\n" + ",".join(titles) + "\n" + ",".join(units)
    return text(head, [1e3 * (1.7e9 + c.t), c.f, c.w / DEGREE], ["%.3f", *["%.6f"] * 6])


def quadrotor(c: Columns) -> str:  # +
    head = (
        "unix_timestamp Accel._X Accel._Y Accel._Z Battery Gyro_Phi Gyro_Theta Gyro_Psi "
        "Mag._X Mag._Y Mag._Z"
    )
    parts = [1e3 * (1.7e9 + c.t), np.round(1e3 * c.f / G), 0 * c.t + 98,
             np.round(1e3 * c.w, 1), np.round(c.mag * 10)]  # fmt: skip
    return text(head, parts, ["%.0f", *["%.0f"] * 4, *["%.1f"] * 3, *["%.0f"] * 3], " ")


def gyroflow(c: Columns) -> str:  # +
    head = (
        "GYROFLOW IMU LOG\nversion,1.3\nid,logger\norientation,YxZ\nnote,test\ntimestamp,"
        "1644159993\nvendor,none\ntscale,0.001\ngscale,0.00122173047\nascale,"
        "0.00048828125\nt,gx,gy,gz,ax,ay,az"
    )
    parts = [np.round(1e3 * c.t), np.round(c.w / 0.00122173047), np.round(c.f / G / 0.00048828125)]
    return text(head, parts, ["%.0f"] * 7)


def untitled(c: Columns) -> str:
    return text("", [c.t, c.w / DEGREE, c.f / G], ["%.4f", *["%.6f"] * 6], " ")


def doubled(c: Columns) -> str:
    return text("t,x,y,z,x,y,z", [c.t, c.f, c.w], ["%.4f", *["%.6f"] * 6])


def increments(c: Columns) -> str:
    dt = float(np.median(np.diff(c.t)))
    head = "time_s,delta_angle_x,delta_angle_y,delta_angle_z,delta_vel_x,delta_vel_y,delta_vel_z"
    return text(head, [c.t, c.w * dt, c.f * dt], ["%.4f", *["%.12f"] * 6])


def dated(c: Columns) -> str:
    head = "timestamp,gyro_x_dps,gyro_y_dps,gyro_z_dps,acc_x_mg,acc_y_mg,acc_z_mg"
    rows = numbers(np.column_stack([c.w / DEGREE, 1e3 * c.f / G]), ["%.4f"] * 6).splitlines()
    start = np.datetime64("2026-05-04T10:00:00")
    stamps = start + np.round(1e6 * (c.t - c.t[0])).astype("timedelta64[us]")
    return "\n".join([head, *(f"{s},{r}" for s, r in zip(stamps, rows, strict=True))]) + "\n"


LOGGERS: dict[str, Callable[[Columns], str]] = {
    f.__name__: f for f in (
        phyphox, sensor_logger, physics_toolbox, sensorlog_ios, px4, xsens, vectornav, ngimu, x_io3,
        invensense, arduino_print, matlab, rostopic, bagpy, bosch, german, chinese, witmotion,
        ardupilot, shimmer, quadrotor, gyroflow, untitled, doubled, increments, dated,
    )
}  # fmt: skip


def write(name: str, folder: Path, log=None) -> Path:
    """Write a simulated session as a logger does."""
    made = LOGGERS[name](Columns.of(truth() if log is None else log))
    file = folder / f"{name}.csv"
    file.write_text(made, encoding="cp1252" if name == "german" else "utf-8")
    return file


# -- files of any order, titles, units and signs --------------------------------------------------

WORDS = {
    "f": ("acc_{a}", "Accel {A}", "a{a}", "accel_{a}", "{a}_acc", "ACC{A}", "Beschleunigung {A}",
          "aceleracion_{a}", "Accelerazione {A}", "accélération {a}", "加速度{A}", "imu.acc.{a}",
          "Ускорение {A}", "SpecificForce{A}", "xl_{a}", "ACCEL_{A}OUT"),
    "w": ("gyr_{a}", "Gyro {A}", "g{a}", "gyro_{a}", "{a}_gyro", "GYR{A}", "Drehrate {A}",
          "giroscopio_{a}", "Velocità angolare {A}", "vitesse angulaire {a}", "角速度{A}",
          "imu.gyro.{a}", "Угловая скорость {A}", "w{a}", "omega_{a}", "GYRO_{A}OUT"),
    "t": ("time", "Time", "t", "timestamp", "time", "TIME", "Zeit", "tiempo", "Tempo", "temps",
          "时间", "imu.time", "Время", "t", "time", "TIME"),
}  # fmt: skip
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
FORCES = {"m/s^2": 1.0, "g": G, "mg": 1e-3 * G}
RATES = {"rad/s": 1.0, "deg/s": DEGREE, "mdps": 1e-3 * DEGREE}


@dataclass(frozen=True)
class Shuffled:
    """A file of random order, titles, units and signs, and what may be said of it."""

    text: str
    told: str  # how it was made
    plain: bool  # whether its titles name the axes and no column is turned round
    open: bool  # whether no one can tell its rate


def shuffled(seed: int, log=None) -> Shuffled:
    """Make file number `seed`: nothing but the seed decides."""
    rng = np.random.default_rng([seed, 27])
    c = Columns.of(log)
    titled = rng.random() < 0.65
    with_units = titled and rng.random() < 0.5
    counts = rng.random(2) < 0.3
    clock = str(rng.choice(["s", "s", "s", "ms", "ms", "us", "ns", "none"]))
    signs = np.ones(6) if rng.random() < 0.5 else rng.choice([1.0, -1.0], 6)
    columns: list[tuple[str, np.ndarray, str]] = []
    told = [f"titles {titled}, units {with_units}, time {clock}"]
    word = int(rng.integers(len(WORDS["t"])))
    if clock != "none":
        start = 0.0 if rng.random() < 0.6 else float(rng.integers(10**5))
        ticks = (c.t - c.t[0] + start) / TIMES[clock]
        name = WORDS["t"][word] + (f" ({clock})" if with_units else "")
        columns.append((name, ticks, "%.0f" if clock in ("us", "ns") else "%.5f"))
    for key, x, known, per in (("f", c.f, FORCES, (G / 16384, G / 8192, G / 4096, G / 2048)),
                               ("w", c.w, RATES, (DEGREE / 131, DEGREE / 65.5, DEGREE / 32.8,
                                                  DEGREE / 16.4))):  # fmt: skip
        raw = counts[0 if key == "f" else 1]
        unit = str(rng.choice(list(known)))
        si, form = known[unit], "%.6f"
        if raw:
            unit, form = "LSB", "%.0f"
            si = float(rng.choice(per)) if rng.random() < 0.6 else float(
                np.exp(rng.uniform(np.log(per[0]), np.log(per[-1]))))  # fmt: skip
        told.append(f"{key} in {unit} of {si:.6g}")
        for i, a in enumerate("xyz"):
            sign = signs[i + 3 * (key == "w")]
            y = sign * x[:, i] / si
            name = WORDS[key][word].format(a=a, A=a.upper())
            name += f" ({unit})" if with_units else ""
            columns.append((name, np.round(y) if raw else y, form))
    more = {"temp": c.warm, "mag_x": c.mag[:, 0], "mag_y": c.mag[:, 1], "mag_z": c.mag[:, 2],
            "status": np.zeros(len(c.t)), "counter": np.arange(len(c.t)) * 1.0}  # fmt: skip
    kept = [k for k in more if rng.random() < 0.25] if rng.random() < 0.6 else []
    columns += [(k, more[k], "%.0f" if k in ("status", "counter") else "%.3f") for k in kept]
    order = rng.permutation(len(columns)) if rng.random() < 0.5 else np.arange(len(columns))
    if not titled and rng.random() < 0.7:  # of three a triad, whole or in another order
        order = np.arange(len(columns))
    columns = [columns[k] for k in order]
    delimiter = str(rng.choice([",", ",", ";", "\t"]))
    comma = delimiter != "," and rng.random() < 0.4
    head = delimiter.join(name for name, _, _ in columns) if titled else ""
    body = text("", [y for _, y, _ in columns], [form for _, _, form in columns], delimiter)
    body = body.replace(".", ",") if comma else body
    told.append(f"signs {signs.astype(int).tolist()}, {kept}, order {order.tolist()}")
    plain = titled and bool((signs > 0).all())
    return Shuffled((head + "\n" if head else "") + body, "; ".join(told), plain,
                    clock == "none" and bool(counts[1]))  # fmt: skip


def judged(seed: int, folder: Path, log) -> tuple[str, str]:
    """Return whether file number `seed` was read "right" or "wrong", or was a "question"."""
    made = shuffled(seed, log)
    file = folder / f"{seed}.csv"
    file.write_text(made.text, encoding="utf-8")
    try:
        found = recognise([file])
        if found.questions:
            return "question", f"{found.questions[0]}"
    except FoucaultError as problem:
        return "question", str(problem)
    force, rate, clock, axes = off(found, log, folder)
    # Counts of an unknown scale are known by the instrument itself, to some percent.
    # A rate that the gyros tell is said to be known to some percent, as they are themselves.
    right = force < 0.08 and rate < 0.08 and clock < (0.06 if "clock_sd" in found.log else 0.001)
    right = right and (not made.plain or bool(np.array_equal(axes, np.eye(3))))
    return ("right" if right else "wrong"), f"{force:.3f} {rate:.3f} {clock:.3f} {axes.tolist()}"


# -- whether a file was read right -----------------------------------------------------------------

EVERY = [np.eye(3)[list(p)] * np.array(s)[:, None]
         for p in permutations(range(3)) for s in product((1.0, -1.0), repeat=3)]  # fmt: skip


def off(found: Recognised, true, folder: Path) -> tuple[float, float, float, np.ndarray]:
    """Return how far a reading is from the truth: force, rate and interval, parts of them [1].

    Right up to axes that are turned, or mirrored, in common; which is returned too.
    """
    log = logs.read(found.description(), folder)
    n = min(len(log), len(true))
    f, w, f0, w0 = log.accel[:n], log.gyro[:n], true.accel[:n], true.gyro[:n]

    def apart(R: np.ndarray) -> tuple[float, float]:
        turned = np.linalg.det(R) * R
        return (float(np.linalg.norm(f - f0 @ R.T) / np.linalg.norm(f0)),
                float(np.linalg.norm(w - w0 @ turned.T) / np.linalg.norm(w0)))  # fmt: skip

    best = min(EVERY, key=lambda R: sum(apart(R)))
    clock = abs(np.median(np.diff(log.time)) / np.median(np.diff(true.time)) - 1.0)
    return (*apart(best), float(clock), best)
