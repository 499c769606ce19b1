"""What a session holds that its calibration does not know: are numbers right, words true?

Each violation is put into the samples, the times or the place of a simulated session by a formula
that shares nothing with what the estimator makes its columns of; the session is calibrated with
what is not estimated taken for nothing, and with its typical sizes. No cell may pass most of its
sessions with NEES over n beyond 2 where the size covers the violation; where the violation is far
beyond any size and no reading shows it, the report has to say that this could not be shown.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
from common import each, limits
from left_out import COUNT, put
from scipy.signal import lfilter
from scipy.special import bdtr

from foucault.diagnose.study import nees
from foucault.errors import FoucaultError
from foucault.models.earth import earth_rate_n
from foucault.models.imu import ImuModel
from foucault.models.left_out import sizes_of
from foucault.procedures.platform_tumble.settings import OTHERWISE
from foucault.result import Level
from foucault.tables import Clock, IndexedLog, Log
from sessions import LASER, SEEKER, SITE, SLAVE, Case, made, truth

G0 = 9.80665
DEGREE = np.radians(1.0)
ARCMIN = DEGREE / 60
ARCSEC = ARCMIN / 60
PLACED = {"placement_sd": 3 * ARCMIN, "level_sd": 3 * ARCMIN, "angle_sd": 12 * ARCMIN}
SHORT = {"rows": "samples", "rest_time": 10.0}

CASES = {
    "hand_rotated": Case("hand_rotated", grade="mems"),
    "six_position": Case(
        "six_position", {"placement_sd": 3 * ARCMIN}, {"placement_sd": 3 * ARCMIN}, grade="mems"
    ),
    "ferraris": Case("ferraris", PLACED, PLACED, grade="mems"),
    "rate_table": Case(
        "rate_table", {"table_rate_sd": 5e-6, "fixture_sd": ARCMIN}, {"step_time": 18.0},
        grade="mems",
    ),
    "norm_observation": Case("norm_observation", {}, SHORT),
    "multi_position": Case("multi_position", {}, SHORT),
    "turntable": Case("turntable", {}, SHORT),
    "north_seeking": Case(
        "north_seeking", {},
        {"tilts": ["8 deg", "-8 deg", "0 deg"], "rows": "samples", "rate": 2.0}, noise=SEEKER,
    ),
    "systematic": Case("systematic", {"sequence": ["9 positions"]},
                       {"rest_time": 30.0, "rate": 25.0}, grade="navigation", noise=LASER),
    "platform_tumble": Case("platform_tumble", {"plan": "-x -z -y +z", "rate": np.radians(5.0),
                                                "segment": 60.0}, grade="navigation"),
    "transfer_alignment": Case(
        "transfer_alignment", {}, {"rate": 100.0, "message_rate": 5.0, "with_outage": False},
        noise=SLAVE,
    ),
    "continuous_spin": Case(
        "continuous_spin", {}, {"rates": ["290 deg/s", "-460 deg/s"], "spin_time": 5.0}
    ),
    "magnetometer": Case(
        "magnetometer", {"intensity": 49e-6, "intensity_sd": 1e-8}, {"time": 30.0, "rate": 100.0}
    ),
    "imu_pose": Case("imu_pose", {}, {"time": 20.0}, grade="mems"),
    "two_imus": Case("two_imus", {}, {"time": 20.0}, grade="mems"),
}  # fmt: skip
"""Procedure -> its session."""

GRADE = dict.fromkeys(CASES, "consumer MEMS") | {
    **dict.fromkeys(("norm_observation", "multi_position", "turntable"), "tactical MEMS"),
    "north_seeking": "tactical FOG", "transfer_alignment": "tactical FOG",
    "systematic": "navigation RLG", "platform_tumble": "navigation RLG",
}  # fmt: skip
"""Procedure -> the grade whose sizes are taken."""


CLOCK = {
    "consumer MEMS": 100e-6, "tactical MEMS": 50e-6, "tactical FOG": 20e-6, "navigation RLG": 5e-6,
}  # fmt: skip
"""Grade -> relative sd of the rate of its log's clock [1]."""


@dataclass
class Session:
    """A simulated session, what its calibration is told, and what happens to it."""

    case: Case
    simulation: Any
    log: Any
    rng: np.random.Generator
    site: Any = SITE
    prior: dict[str, tuple[float, float]] = field(default_factory=dict)
    amounts: Mapping[str, np.ndarray] = field(default_factory=dict)

    @property
    def ramp(self) -> np.ndarray:
        t = self.log.time
        return ((t - t[0]) / (t[-1] - t[0]) - 0.5)[:, None]

    @property
    def rate(self) -> float:
        """Samples in a second."""
        return float(1 / np.median(np.diff(self.log.time)))


Violation = Callable[[Session], None]

FIELD = 50e-6
"""Field at which the terms of a magnetometer are stated [T]."""

MAG = {"mag.quadratic": 2, "mag.cubic": 3, "mag.bias drift": None}
"""Terms of a magnetometer -> power of the field, None: of the time."""


def motion(s: Session) -> tuple[np.ndarray, np.ndarray]:
    """Return specific force and rate (n, 3) that terms multiply.

    Of a north seeker they are along axes that turn with its base: the gyro's is the second.
    """
    if not isinstance(s.log, IndexedLog):
        return s.log.accel, s.log.gyro
    f_n, w_n = np.array([0.0, 0.0, SITE.gravity]), earth_rate_n(SITE.latitude)
    return turned(s, f_n), turned(s, w_n)


def turned(s: Session, v_n: np.ndarray) -> np.ndarray:
    """Return a vector along the axes of a base (n, 3)."""
    v = (v_n @ np.array([p.attitude for p in s.simulation.plan.setups]))[s.log.setup]
    c, d = np.cos(s.log.index), np.sin(s.log.index)
    return np.stack([c * v[:, 0] - d * v[:, 1], d * v[:, 0] + c * v[:, 1], v[:, 2]], axis=1)


def sensed(s: Session, x: Any) -> Any:
    """Return what a log has of something along the axes of the case, or base (n, 3)."""
    return x[:, 1:2] if isinstance(s.log, IndexedLog) else x


def amounts(s: Session, x: dict[str, np.ndarray]) -> None:
    """Put terms of the instrument into its readings [SI]."""
    if not isinstance(s.log, IndexedLog):
        model = getattr(s.simulation, "model", None)
        own = {group: x.pop(group) for group in MAG if group in x}
        s.log = put(s.log, model if isinstance(model, ImuModel) else ImuModel(), x)
        for group, size in own.items():
            power = MAG[group]
            bent = s.ramp if power is None else FIELD * (s.log.mag / FIELD) ** power
            s.log = replace(s.log, mag=s.log.mag + size * bent)
        return
    f, w = motion(s)
    more = put(Log(time=s.log.time, accel=f, gyro=w), ImuModel(), x)
    added(s, sensed(s, more.accel - f), sensed(s, more.gyro - w))


def askew(s: Session) -> None:
    """A base, a table and its headings that are off by what nobody says of them."""
    log, m = s.log, len(s.log.names)
    stops = np.unique(np.column_stack([log.setup, np.rint(np.degrees(log.index))]), axis=0,
                      return_inverse=True)[1].ravel()  # fmt: skip
    own = 10 * ARCSEC * s.rng.standard_normal((2, len(stops)))
    common, lean = 20 * ARCSEC * s.rng.standard_normal(), 20 * ARCSEC * s.rng.standard_normal(2)
    f_n, w_n = np.array([0.0, 0.0, SITE.gravity]), earth_rate_n(SITE.latitude)
    back = np.array([*-lean, 0.0])
    added(s, *(sensed(s, turned(s, np.cross(back, v))) for v in (f_n, w_n)))
    s.log = replace(s.log, index=log.index + own[0][stops],
                    heading=log.heading + common + own[1][:m][log.setup])  # fmt: skip


def added(s: Session, accel: Any, gyro: Any) -> None:
    """Add to the readings of a triad, or of the one axis that there is [SI]."""
    new: dict[str, np.ndarray] = {}
    for name, more in (("accel", accel), ("gyro", gyro)):
        old = getattr(s.log, name)
        if old is not None:
            more = np.broadcast_to(more, (len(s.log.time), 3))
            if name == "gyro" and getattr(s.log, "sampled", "") == "increment":
                more = more / s.rate
            new[name] = old + (more[:, : old.shape[1]] if old.ndim == 2 else more[:, 0])
    s.log = replace(s.log, **new)


def found_by(case: Case) -> set[str]:
    """Return the groups that a procedure estimates, those of a cluster by their names of an IMU."""
    own = {name.rpartition(".")[0] for name in case.names}
    return own | set(OTHERWISE if case.procedure == "platform_tumble" else ())


def triads_of(case: Case) -> set[str]:
    """Return the triads whose readings a procedure uses."""
    triads = {name.partition(".")[0] for name in case.names}
    return triads | {"accel", "gyro"} if "mag" in triads else triads


def terms(**sizes: float) -> Violation:
    """Terms of the instrument: group -> amount of each, with random signs [SI]."""

    def violate(s: Session) -> None:
        estimated = found_by(s.case)
        for key, size in sizes.items():
            group = key.replace("__", " ").replace("_", ".", 1)
            if group not in estimated:
                amounts(s, {group: size * s.rng.choice([-1.0, 1.0], COUNT.get(group, 3))})

    return violate


def drift(accel_bias: float = 0.0, gyro_bias: float = 0.0, scale: float = 0.0) -> Violation:
    """End minus start of the session, of every axis, with random signs [SI]."""

    def violate(s: Session) -> None:
        a, g = s.rng.choice([-1.0, 1.0], (2, 1, 3)) * s.ramp
        accel, gyro = (
            None if x is None else x.reshape(len(x), -1) for x in (s.log.accel, s.log.gyro)
        )
        added(
            s,
            a * (accel_bias + scale * (0.0 if accel is None or scale == 0 else accel)),
            g * (gyro_bias + scale * (0.0 if gyro is None or scale == 0 else gyro)),
        )

    return violate


def outliers(s: Session) -> None:
    """One sample in a hundred is off by thirty times the noise."""
    noise = s.case.sensors
    for name, triad in (("accel", noise.accel), ("gyro", noise.gyro)):
        x = getattr(s.log, name)
        sd = 30 * float(np.max(triad.white)) * np.sqrt(s.rate)
        hit = s.rng.random(len(s.log.time)) < 0.01
        off = np.zeros((len(hit), 3))
        off[hit] = sd * s.rng.standard_normal((hit.sum(), 3))
        if x is not None:
            added(s, *((off, 0.0) if name == "accel" else (0.0, off)))


def colour(length: float) -> Violation:
    """Noise of a correlation time [s] with three times the density of the white one below it."""

    def violate(s: Session) -> None:
        n, keep = len(s.log.time), np.exp(-1 / (s.rate * length))
        out = []
        for triad in (s.case.sensors.accel, s.case.sensors.gyro):
            sd = 3 * float(np.max(triad.white)) / np.sqrt(2 * length)
            e = s.rng.standard_normal((n, 3)) * np.sqrt(1 - keep**2)
            e[0] /= np.sqrt(1 - keep**2)
            out.append(sd * lfilter([1.0], [1.0, -keep], e, axis=0))
        added(s, *out)

    return violate


def shaken(s: Session) -> None:
    """A support that trembles: 0.2 m/s^2 and 0.5 deg/s about 13 Hz, which comes and goes."""
    t = s.log.time[:, None]
    phase = s.rng.uniform(0, 2 * np.pi, (4, 3))
    wave = np.sin(2 * np.pi * 13.1 * t + phase[0]) * (1 + np.sin(0.3 * t + phase[1])) / 2
    turn = np.sin(2 * np.pi * 12.3 * t + phase[2]) * (1 + np.sin(0.2 * t + phase[3])) / 2
    added(s, 0.2 * wave, 0.5 * DEGREE * turn)


def creeping(s: Session) -> None:
    """A mount that gives way: 0.003 deg/s, to and fro in half a minute."""
    t = s.log.time
    axis = s.rng.standard_normal(3)
    axis /= np.linalg.norm(axis)
    rate = 0.003 * DEGREE * np.sign(np.sin(2 * np.pi * t / 31.0))
    angle = np.cumsum(rate) / s.rate
    f, w = motion(s)
    back = -angle[:, None]
    added(
        s, sensed(s, back * np.cross(axis, f)),
        sensed(s, rate[:, None] * axis + back * np.cross(axis, w)),
    )  # fmt: skip


def stamps(rate: float) -> Violation:
    """Every clock is wrong by the same part of its rate [1]; increments are what they were."""

    def violate(s: Session) -> None:
        start, fast = s.log.time[0], 1 + rate

        def by_clock(x: Any) -> Any:
            x = replace(x, time=start + (x.time - start) * fast)
            if getattr(x, "sampled", "") == "increment":  # rates are these over their interval
                x = replace(x, gyro=x.gyro / fast, accel=x.accel / fast)
            return x

        s.log = by_clock(s.log)
        if hasattr(s.log, "poses"):
            s.log = replace(s.log, poses=by_clock(s.log.poses))
        if hasattr(s.log, "others"):
            s.log = replace(s.log, master=by_clock(s.log.master))

    return violate


def place(gravity: float = 0.0, latitude: float = 0.0) -> Violation:
    """The place is declared wrong by so much [m/s^2, rad]."""

    def violate(s: Session) -> None:
        at = s.site.latitude + latitude if latitude else s.site.latitude
        s.site = replace(s.site, gravity=s.site.gravity + gravity, latitude=at)

    return violate


def table_angle(s: Session) -> None:
    """The zero of the table's middle axis is off by a degree."""
    angles = s.log.table.angles + np.array([0.0, DEGREE, 0.0])
    s.log = replace(s.log, table=replace(s.log.table, angles=angles))


def master_clock(s: Session) -> None:
    """The master's stamps run fast by 100 ppm."""
    m = s.log.master
    s.log = replace(s.log, master=replace(m, time=m.time[0] + (m.time - m.time[0]) * (1 + 1e-4)))


def slave_turned(s: Session) -> None:
    """The axes of the slave's gyros are misaligned by 1 mrad."""
    o, i = np.nonzero(~np.eye(3, dtype=bool))
    M = np.zeros((3, 3))
    M[o, i] = 1e-3 * s.rng.choice([-1.0, 1.0], 6)
    added(s, 0.0, s.log.gyro * (s.rate if s.log.sampled == "increment" else 1.0) @ M.T)


def wrong_prior(s: Session) -> None:
    """The biases of the gyros are said to be elsewhere, 10 sd from where they are."""
    names = [n for n in s.case.names if n.startswith("gyro.bias.")]
    for name, value in zip(names, truth(s.simulation, tuple(names)), strict=True):
        sd = 0.003 * DEGREE
        s.prior[name] = (float(value) + 10 * sd, sd)


def timed(s: Session) -> bool:
    """Whether times of the log are all that tells the time of a session."""
    return isinstance(s.log, Log) and s.case.procedure != "transfer_alignment"


def everything(s: Session) -> None:
    """Every term that counts, drawn at its size."""
    sizes = sizes_of(GRADE[s.case.procedure])
    known, triads = found_by(s.case), triads_of(s.case)
    x = {
        group: sizes[group][0] * s.rng.standard_normal(n)
        for group, n in (COUNT | dict.fromkeys(MAG, 3)).items()
        if group not in known and group.partition(".")[0] in triads
    }
    amounts(s, x)
    if isinstance(s.log, IndexedLog):
        askew(s)
    # Some settings say themselves how well the latitude is known.
    north = getattr(s.case.stated, "latitude_sd", None) or sizes["latitude"][0]
    place(s.rng.standard_normal() * 4e-4, s.rng.standard_normal() * north)(s)
    if timed(s):
        sd = CLOCK[GRADE[s.case.procedure]]
        s.log = replace(s.log, clock=Clock.of("host", sd))
        stamps(s.rng.standard_normal() * sd)(s)


ALL = "everything at its size"

VIOLATIONS: dict[str, Violation] = {
    "nothing": lambda s: None,
    "1 % outliers": outliers,
    "noise of 2 s": colour(2.0),
    "noise of 30 s": colour(30.0),
    "scale drift 300 ppm": drift(scale=3e-4),
    "scale drift 1000 ppm": drift(scale=1e-3),
    "bias drift 1 mg": drift(accel_bias=1e-3 * G0),
    "bias drift 0.03 deg/s": drift(gyro_bias=0.03 * DEGREE),
    "shaken rests": shaken,
    "creeping rests": creeping,
    "latitude 1 deg": place(latitude=DEGREE),
    "gravity 1 mm/s^2": place(gravity=1e-3),
    "stamps 0.1 %": stamps(1e-3),
    "stamps 1 %": stamps(1e-2),
    "quadratic 100 ug/g^2": terms(accel_quadratic=1e-4 / G0),
    "products 100 ug/g^2": terms(accel_cross=1e-4 / G0),
    "cubic 0.1 % at 150 deg/s": terms(gyro_cubic=1e-3 / (150 * DEGREE) ** 2),
    "g-sensitivity 20 deg/h/g": terms(gyro_g_sensitivity=20 * DEGREE / 3600 / G0),
    "mag. quadratic 1000 ppm": terms(mag_quadratic=1e-3),
    "mag. drift 1 uT": terms(mag_bias__drift=1e-6),
    "deflection 3 arcsec/g": terms(gyro_deflection=3 * DEGREE / 3600 / G0),
    "table angle 1 deg": table_angle,
    "master's clock 100 ppm": master_clock,
    "slave misalignment 1 mrad": slave_turned,
    "prior 10 sd off": wrong_prior,
    ALL: everything,
}
"""What is put into a session."""


def can(which: str, what: str) -> bool:
    """Whether a violation is one of a procedure's sessions."""
    case = CASES[which]
    triads = triads_of(case)
    on_table = which in ("norm_observation", "multi_position", "turntable")
    groups = {"quadratic": "accel", "products": "accel", "cubic": "gyro", "g-sensitivity": "gyro",
              "deflection": "gyro", "prior": "gyro", "mag.": "mag"}  # fmt: skip
    return {
        "g-sensitivity 20 deg/h/g": "gyro" in triads and which != "platform_tumble",
        "table angle 1 deg": on_table,
        "master's clock 100 ppm": which == "transfer_alignment",
        "slave misalignment 1 mrad": which == "transfer_alignment",
        "bias drift 1 mg": "accel" in triads,
        "bias drift 0.03 deg/s": "gyro" in triads,
    }.get(what, groups.get(what.split()[0], "") in triads | {""})


@dataclass(frozen=True)
class Run:
    """What came of one calibration."""

    nees: float = np.nan  # over n, in seconds where the log has a clock [1]
    count: int = 0
    passed: bool = False
    said: tuple[str, ...] = ()  # who is named, or what failed, or how it was refused
    unseen: str = ""  # what it says could not be shown
    seconds: float = 0.0  # that calibrations and simulation took [s]


@lru_cache(maxsize=10)
def simulated(which: str, seed: int) -> Any:
    """Simulate a session: that of every violation of a procedure and seed."""
    return made(CASES[which], 20_000 + seed)


def one(job: tuple[str, str, int, bool]) -> list[Run]:
    """Calibrate one session with sizes, and before, where the job says so, without them."""
    which, what, seed, bare = job
    began, case, out = time.process_time(), CASES[which], []
    simulation = simulated(which, seed)
    for sizes in (*[{}] * bare, sizes_of(GRADE[which])):
        s = Session(case, simulation, simulation.log, np.random.default_rng([seed, 78]))
        VIOLATIONS[what](s)
        timed = what.startswith("stamps") or what == ALL  # what the clock does is asked
        try:
            r = (case.record.calibrate if timed else case.record.trial)(
                s.log, site=replace(s.site, gravity_sd=4e-4), settings=case.stated,
                sizes=sizes or None, prior=s.prior,
                noise=case.sensors if which in DECLARED else None,
            )  # fmt: skip
        except FoucaultError as problem:  # no number was given
            out.append(Run(said=(f"refused: {problem.code}",)))
            continue
        c = r.coefficients
        e, cov = c.values - truth(simulation, c.names), c.cov
        assert cov is not None
        if r.clock is not None and timed:
            of_clock = np.array([r.clock.error.get(name, 0.0) for name in c.names])
            cov = cov + np.outer(of_clock, of_clock)
        named = tuple(" = ".join(causes) for causes in r.diagnostics.get("named", []))
        failed = tuple(check.name for check in r.checks if not check.passed)
        shown = [c.sentence for c in r.checks if c.name == "terms not shown"]
        codes = tuple(f.code for f in r.findings) if r.verdict.reasons and not failed else ()
        out.append(Run(
            float(nees(e[None], cov[None])[0]) / len(e), len(e), r.verdict.level is Level.PASS,
            named or failed or codes,
            " ".join([*(r.diagnostics.get("unseen") or ()), *shown]),
        ))  # fmt: skip
    return [replace(run, seconds=time.process_time() - began) for run in out]


DECLARED = ("north_seeking", "systematic", "platform_tumble", "transfer_alignment")
"""Procedures whose noise is declared; the others measure theirs."""


WORDS = {
    "stamps": "time base", "gravity": "gravity", "latitude": "latitude", "cubic": "cubic",
    "scale": "drift", "bias": "drift", "quadratic": "quadratic", "products": "products",
    "mag.": "magnetometer", "creeping": "mount", "deflection": "deflection",
    "g-sensitivity": "g-sensitivity", "table": "table",
}  # fmt: skip
"""First word of a violation -> what a report calls it that could not show it."""


def row(which: str, what: str, runs: list[list[Run]]) -> tuple[str, bool]:
    """Return the line of a cell, and whether it is as it must be."""
    cells, good = [], True
    for found in ([run[0] for run in runs if len(run) > 1], [run[-1] for run in runs]):
        worth = [f.nees for f in found if np.isfinite(f.nees)]
        ratio = np.mean(worth) if worth else np.nan
        passed = np.mean([f.passed for f in found]) if found else np.nan
        cells += [f"{ratio:.3g}", f"{100 * passed:.0f} %"]
        said = Counter(name for f in found for name in set(f.said))
    passing = [f for f in found if f.passed]
    if what == ALL:
        low, high = limits(max(f.count for f in found) * len(runs))
        good = bool(low <= ratio <= high and often(len(passing), len(runs), 0.9))
    elif len(passing) > 0.1 * len(runs) and np.mean([f.nees for f in passing]) > 2.0:
        word = WORDS.get(what.split()[0], what)
        good = all(word in f.unseen.lower() for f in passing)
    words = ", ".join(f"{name} {count}" for name, count in said.most_common(2)) or "nothing"
    right = "yes" if good else "**no**"
    return f"| {which} | {what} | {' | '.join(cells)} | {words} | {right} |", good


FEW = 20
"""Fewer sessions than this are judged by what chance makes of a rate."""


def often(passed: int, sessions: int, rate: float) -> bool:
    """Whether sessions pass at a rate; few may be so few by chance once in a hundred times."""
    if sessions >= FEW:
        return passed >= rate * sessions
    return float(bdtr(passed, sessions, rate)) >= 0.01


SLOW = ("transfer_alignment",)
"""Procedures whose session takes more than a second: a fifth of the sessions."""


def main(
    sessions: int = 20, *only: str, bare: int | None = None, workers: int | None = None
) -> tuple[bool, dict[str, object]]:
    """Return whether every cell is as it must be, and the table.

    `bare`: so many sessions of a cell are calibrated without sizes too, all where None: they are
    shown, only those with sizes are judged.
    """
    count = {which: max(sessions // 5, 1) if which in SLOW else sessions for which in CASES}
    cells = [
        (which, what) for which in CASES for what in VIOLATIONS
        if can(which, what)
        and all(not set(every) & set(only) or name in only
                for name, every in ((which, CASES), (what, VIOLATIONS)))
    ]  # fmt: skip
    jobs = [
        (which, what, seed, bare is None or seed < bare)
        for which, what in cells for seed in range(count[which])
    ]  # fmt: skip
    runs = {job[:3]: done for job, done in zip(jobs, each(one, jobs, workers), strict=True)}
    shown, good = [], True
    for which, what in cells:
        line, fine = row(which, what, [runs[which, what, k] for k in range(count[which])])
        shown.append(line)
        good &= fine
    hours = sum(run[0].seconds for run in runs.values()) / 3600
    ran = ", ".join(f"{w} ({count[w]})" for w in dict.fromkeys(which for which, _ in cells))
    return good, {"sessions": sessions, "shown": shown, "hours": f"{hours:.2g}", "ran": ran}


if __name__ == "__main__":
    print("\n".join(main(int(sys.argv[1]), *sys.argv[2:])[1]["shown"]))
