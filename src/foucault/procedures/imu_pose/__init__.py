"""Calibrate an IMU by poses of its body: motion capture, tags, a prism, another navigation system.

The IMU and what is tracked are fixed to one rigid body that a hand turns and moves for half a
minute. It gives how the tracked body is turned against the IMU, the lever arm to the tracked point,
the offset and the rate of the two clocks, the level of the pose's world, and the errors of the IMU
itself: biases, scale factors, misalignments, and how much later accelerometers read than gyros.
Positions alone (a prism, an antenna) give all but the rotation; two antennas give the base between
them besides, and steady the attitude.

Tables of the result
--------------------
``poses``: time [s]; of every pose that is used ``attitude_x`` .. ``attitude_z`` [rad] and
``position_x`` .. ``position_z`` [m], measured less found, NaN where it was left out.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from foucault import logs
from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector, Layout
from foucault.detect.noise import KNOCKS, without_spikes
from foucault.diagnose.checks import check
from foucault.diagnose.comparable import of_site
from foucault.errors import Finding, error, finding
from foucault.estimate import imu_pose as engine
from foucault.estimate import two_bodies as bodies
from foucault.estimate.antennas import antennas, not_exchanged
from foucault.estimate.imu_pose import LAYOUT, NAMES, OF_ANTENNAS, Point, Readings, Solution
from foucault.estimate.two_bodies import even
from foucault.guard.mistakes import exchange_words, exchanges, rate_hint
from foucault.infer.filtered import component
from foucault.infer.gauss_newton import FALSE_ALARM
from foucault.infer.mixed import NOISE_BASIS
from foucault.logs import pose as poses
from foucault.logs.checks import on_a_shared_clock
from foucault.logs.pose import PoseDescription
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import Gauge, ImuModel
from foucault.models.left_out import Sizes
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.pose import BASE as OF_BASE
from foucault.models.pose import LAYOUT as OF_POSE
from foucault.models.pose import PoseTable
from foucault.models.rotation import log as vector_of
from foucault.models.size_effect import SizeEffect
from foucault.plans.directions import Free
from foucault.procedures.by_hand import Found, HandSession, foreseen, result_of
from foucault.procedures.counted import FORCES, GYROS, Again, Counted, Stages, Term, Unit, counted
from foucault.procedures.imu_pose.start import Start, start_of, start_of_places
from foucault.procedures.left_out import told_beside
from foucault.procedures.record import Given, Procedure, Robust
from foucault.result import Check, Result
from foucault.simulate.hand_motion import HandMotion, Tracker, simulate_hand
from foucault.tables import AXES, Log, evened
from foucault.units import AngleSd, Quantity, Seconds, parse, plain

FRAME = "body axes, right-forward-up, as the accelerometers define them (see gauge)"
MIRRORED, LEFT_OUT = 1.5, 10.0
"""By so many times less must be left over for axes of positions, whose second derivatives are
noisy [1]; limit of poses that are left out [%]."""

CHANGES = {
    "pose.rotation": "how the tracked body is turned against the IMU",
    "pose.lever": "the lever arm to the tracked point",
    "pose.base": "the base between the antennas",
    "pose.delay": "the offset of the clocks (stamps jumped)",
    "pose.clock": "the rate of the clocks",
    "pose.level": "the level of the poses' world",
    "motion": "the world of the poses (or the IMU's readings for a moment: a spike, lost samples)",
}
"""What may change for good half-way, in words."""

APART = 0.3  # Stamps of positions and attitudes are tried so far apart [s].
SCALED = 3.5  # Positions have another scale by so many sds of what it is found as [1].
QUIET = 0.05  # Part of the stretches of half a second that are the stillest [1].

Length = Annotated[float, Quantity("length")]
ScaleSd = Annotated[float, Quantity("scale factor error")]


class Settings(Robust):
    """What can be chosen; the defaults suit motion capture and a body moved by hand."""

    position_sd: Length | None = Field(default=None, gt=0, examples=["0.5 mm"])
    """Noise of the positions, each component; left out, it is found."""
    attitude_sd: AngleSd | None = Field(default=None, gt=0, examples=["0.1 deg"])
    """Noise of the attitudes, each component; left out, it is found."""
    second_sd: Length | None = Field(default=None, gt=0, examples=["2 mm"])
    """Noise of a second antenna, or of the base as it is measured, each component; left out, it is
    found. Of heading and pitch: times the length of the base."""
    base_length: Length | None = Field(default=None, gt=0, examples=["1.2 m"])
    """Distance of the two antennas, where it was measured on the body."""
    base_length_sd: Length = Field(default=2e-3, gt=0, examples=["1 mm"])
    """How well it was."""
    scale_sd: ScaleSd = Field(default=1e-3, ge=0, le=0.1)
    """How well the scale of the positions is known, by a wand or a scale bar: it is no result, and
    counts beside the terms of the IMU that are none."""
    accel_delay: bool = True
    """Estimate how much later accelerometers read than gyros."""
    clock: bool = True
    """Estimate the rate of the two clocks."""
    longest_offset: Seconds = Field(default=1.0, gt=0)
    """Where the offset is looked for by positions alone; with attitudes it is found anywhere."""
    passes: int = Field(default=30, ge=6, le=40)
    """At most so many passes; fewer where nothing moves any more."""

    def held(self, attitude: bool) -> list[int]:
        """Return the numbers of the parameters that are not estimated; `attitude`: is there one."""
        out = [] if attitude else [0, 1, 2]
        return out + [7] * (not self.clock) + [31] * (not self.accel_delay)


class Session(HandSession):
    """The session that `simulate` makes."""

    pose_rate: Annotated[float, Quantity("frequency")] = Field(default=100.0, gt=0)
    """Poses in a second."""
    with_attitude: bool = True
    """Whether there are attitudes; false: positions alone."""
    base: tuple[str, str, str] | None = Field(default=None, examples=[["0 m", "80 cm", "0 m"]])
    """From the first antenna to a second: right, forward, up of the IMU; then no attitudes."""
    position_noise: Length = Field(default=5e-4, ge=0)
    """Noise of the positions, each component."""
    attitude_noise: AngleSd = Field(default=float(np.radians(0.1)), ge=0)
    """Noise of the attitudes, each component."""
    lever_arm: tuple[str, str, str] = ("8 cm", "-12 cm", "5 cm")
    """From the accelerometers to the tracked point: right, forward, up of the IMU."""
    offset: Seconds = Field(default=0.2, gt=-10, lt=10)
    """What is to be added to the stamps of poses."""
    clock_drift: float = Field(default=2e-5, gt=-1e-2, lt=1e-2)
    """Part by which the clock of the IMU is faster."""
    tilt: AngleSd = Field(default=float(np.radians(1.0)), ge=0)
    """Sd of the tilt of the pose's world about each of its level axes."""
    accelerometers_late: Seconds = Field(default=0.0, gt=-0.05, lt=0.05)
    """How much later accelerometers read than gyros."""
    outliers: float = Field(default=0.0, ge=0, lt=0.5)
    """Part of the poses that are 5 cm and 6 deg off."""
    lost: float = Field(default=0.0, ge=0, lt=0.9)
    """Part of the seconds in which the body is lost."""


@dataclass(frozen=True)
class PoseLog(Log):
    """The log of an IMU, and the poses of its body: what the tracking system said.

    `time`, `gyro`, `accel`, `temperature`, `averaged`, `begins`, `mag`, `rests`: of the IMU [SI].
    """

    poses: PoseTable | None = None

    @classmethod
    def of(cls, log: Log, table: PoseTable) -> PoseLog:
        """Return the log of an IMU beside poses; `log`: its readings [SI]."""
        told = (*on_a_shared_clock(log.findings), *table.findings)
        source = log.source | ({"master": table.source} if table.source else {})
        return cls(
            **{f.name: getattr(log, f.name) for f in fields(Log)}
            | {"findings": told, "source": source, "poses": table}
        )


def _with_poses(log: Log, description: PoseDescription, folder: str | Path) -> PoseLog:
    return PoseLog.of(log, poses.read(description, folder))


def _write(log: PoseLog, path: str | Path) -> None:
    logs.write(log, path)
    assert log.poses is not None
    poses.write(log.poses, Path(path).with_name("poses.csv"))


def _log_table(log: Log | None = None) -> str:
    from foucault.logs.description import OWN_LOG, log_head

    more = '\n[master]\nfile = "poses.csv"'
    if log is not None:
        return (
            f"{OWN_LOG}{more}                       # the titles of its columns say what they are\n"
        )
    return log_head("the IMU; ") + f"{more}\n" + _MASTER


_MASTER = """\
# TUM and EuRoC trajectories, exports of Motive (OptiTrack) and Nexus (Vicon) need no more, nor do
# bags of ROS (topic = "/tf" and child = "marker" where there are several). Columns:
# time = { column = "t", unit = "s" }
# position = { columns = ["x", "y", "z"], unit = "mm" }
# attitude = { columns = ["q0", "q1", "q2", "q3"] }    # order and direction are told by the data
# position_only = true                    # a prism or an antenna: no attitude
# second = { columns = ["x2", "y2", "z2"], unit = "m" }    # two antennas: position of the second,
# base = { columns = ["e", "n", "u"], unit = "m" }         # or the base from the first to it, or
# heading = { columns = ["heading", "pitch"], unit = "deg" }   # its heading from north, its pitch
# fixed = { column = "Q", values = [1] }  # positions of another quality are left out
"""


# -- calibrating -----------------------------------------------------------------------------------


def quiet_noise(log: Log) -> tuple[float, float]:
    """Return the white noise of gyros and accelerometers where a log is stillest [SI].

    By second differences, which no slow motion makes: of a log without any rest too much is taken.
    """
    out = []
    width = max(8, round(0.5 / log.interval))
    for x in (log.gyro, log.accel):
        assert x is not None
        bend = x[2:] - 2 * x[1:-1] + x[:-2]
        n = len(bend) // width
        square = (bend[: n * width] ** 2).reshape(n, width * 3).mean(axis=1) / 6
        floor = 1e-9
        out.append(float(np.sqrt(np.quantile(square, QUIET) * log.interval + floor**2)))
    return out[0], out[1]


def _readings(log: Log, given: Given[Settings]) -> tuple[Readings, PoseTable]:
    """Return what is compared, and the poses that lie within the log, by any offset."""
    table = getattr(log, "poses", None)
    if table is None:
        raise error("pose.no_table")
    if log.gyro is None or log.accel is None:
        raise error("pose.no_triad", triad="gyros" if log.gyro is None else "accelerometers")
    if len(table) < poses.FEWEST:
        raise error("pose.few", file="The table", count=len(table), least=poses.FEWEST)
    span = float(min(table.time[-1] - table.time[0], log.duration))
    if span < bodies.SHORTEST:
        raise error("pose.short", span=plain(span, 2), least=plain(bodies.SHORTEST, 2))
    noise = given.noise
    white = quiet_noise(log) if noise is None else (noise.gyro.white, noise.accel.white)
    length = given.settings.base_length
    known = None if length is None else (length, given.settings.base_length_sd)
    second = None if table.second is None else antennas(table, known)
    C = None if table.quaternion is None else table.attitude(table.reading or _ANY)
    gravity = given.site.gravity, given.site.gravity_sd
    r = Readings.of(log, table.time, table.position, C, white, gravity)
    jumped = poses.jumps_of(replace(table, position=r.place))
    return replace(r, second=second, length=known, jumped=jumped), table


_ANY = "w x y z, body to world"


def _solved(log: Log, given: Given[Settings]) -> tuple[Solution, Start]:
    settings = given.settings
    log = replace(log, time=evened(log.time))
    r, table = _readings(log, given)
    given.progress(0.1, "matching what both did")
    if table.quaternion is None:
        start, point = start_of_places(log, r, settings.longest_offset)
        _contradicted_places(start, given.site.gravity)
        not_exchanged(point, given.prior)
    else:
        start = start_of(log, r, table)
        point = start.point
        _contradicted(start, given.site.gravity)
        r = replace(r, C_vm=table.attitude(start.reading or _ANY))
    t = r.at(point.tau, point.kappa)
    inside = (t > log.time[0] + 4 * log.interval) & (t < log.time[-1] - 4 * log.interval)
    if inside.sum() < poses.FEWEST:
        raise error("pose.few", file="The time of the log", count=int(inside.sum()),
                    least=poses.FEWEST)  # fmt: skip
    if not inside.all():
        r = r[inside]
        point = replace(point, node=point.node[inside], C=point.C[inside], v=point.v[inside],
                        p=point.p[inside])  # fmt: skip
    given.progress(0.3, "smoothing the motion")
    return _smoothed(r, point, given), start


def _smoothed(r: Readings, point: Point, given: Given[Settings]) -> Solution:
    settings = given.settings
    hold = np.array(settings.held(bool(r.measured[:, 1].any())), int)
    sd = settings.attitude_sd if r.second is None else settings.second_sd, settings.position_sd
    return engine.solve(
        r, point, given.prior, sd, robust=settings.robust, most=settings.passes, hold=hold,
    )  # fmt: skip


EARTH = "earth rate"
"""The Earth's rotation, of which nobody says where it points in the world of the poses."""

EARTH_SIZE = (EARTH_RATE / np.sqrt(3.0), "the Earth's rate, in any direction")


SCALE = "pose scale"
"""That of the positions: where they are too large, so are accelerations by them, and lever arms."""


def _rates(r: Readings) -> FloatArray:
    return np.hstack([r.dtheta, r.dvel]) / r.dt[:, None]


def _moving(s: Solution, site: Site) -> FloatArray:
    """Return what accelerometers read of the motion, without bias and gravity, (n, 3) [m/s^2]."""
    r, at = s.readings, s.point
    up_b = even(r.time[at.node], at.up_v @ at.C, r.time - r.dt / 2 - at.late)
    down = site.gravity * up_b @ (np.eye(3) + at.accel[1]).T
    return np.asarray(r.dvel / r.dt[:, None] - at.accel[0] - down)


def _arms(s: Solution) -> FloatArray:
    """Return the parameters that are lengths in the world of the poses, others zero (32,) [m]."""
    lengths = [n.startswith(("pose.lever", "pose.base")) for n in s.readings.names]
    return np.where(lengths, s.point.values, 0.0)


def _scaled(s: Solution, c: CoefficientVector, site: Site) -> list[Finding]:
    """Say that positions have another scale, where nothing that is left out is counted with."""
    found = engine.answers(s, np.pad(-_moving(s, site), ((0, 0), (3, 0)))[:, :, None])
    found.A[:, 0] += _arms(s)
    sd = float(found.gram[0, 0] ** -0.5)
    scale = float(found.pull[0]) * sd**2
    moved = np.abs(found.A[[s.readings.names.index(n) for n in c.names], 0] * scale) / c.sd
    if abs(scale) < SCALED * sd * max(s.spread, 1.0) or moved.max() < bodies.HARM:
        return []
    return [finding("pose.scale", scale=plain(1e6 * scale, 3), sd=plain(1e6 * sd, 2))]


def _unit(s: Solution, c: CoefficientVector, given: Given[Settings], sizes: Sizes) -> Unit:
    """Return the IMU, and all that is not estimated, at the motion that was found [SI]."""
    r, at, scale = s.readings, s.point, given.settings.scale_sd
    along = (EARTH_SIZE[0] * even(r.time[at.node], at.C[:, k], r.time) for k in range(3))
    more = [Term(f"{EARTH} {a}", EARTH, GYROS, x) for a, x in zip(AXES, along, strict=True)]
    if scale:
        more.append(Term(SCALE, SCALE, FORCES, -scale * _moving(s, given.site)))
    return Unit(c, r.time, given.site, sizes, late=at.late * r.rise / r.dt[:, None],
                more=tuple(more))  # fmt: skip


def _counted(
    s: Solution, c: CoefficientVector, given: Given[Settings], *, planned: bool = False
) -> Counted[Solution] | None:
    """Return what a solution comes to beside what is not estimated, None where nothing has a size.

    `c`: what is reported of it [SI]; `planned`: it is of a session that was not made.
    """
    r = s.readings
    white = given.noise or ImuNoise(*(TriadNoise(white=x) for x in reversed(r.white)))
    sizes = told_beside(given.sizes, white, r.log.duration)
    if sizes is None:
        return None

    def stages(
        at: Solution, c: CoefficientVector, out: FloatArray
    ) -> tuple[Stages, Again[Solution]]:
        unit, read, scale = _unit(at, c, given, sizes), _rates(at.readings), given.settings.scale_sd
        some = unit.terms(read)
        of_imu = np.array([one.group != SCALE for one in some])
        columns, follows = unit.added(read, out * of_imu)
        spread = at.spread if at.spread > bodies.COLOURED else 1.0
        kept = [r.names.index(n) for n in c.names]
        found = engine.answers(at, columns)
        found.A[:, : len(some)] += np.outer(scale * _arms(at), ~of_imu)
        more = {EARTH: EARTH_SIZE, SCALE: (scale, "declared, or 0.1 %: judgement")}
        both = Stages.of(c, some, {**sizes, **more}, found.of(spread, kept, follows), out)

        def again(
            times: FloatArray, foretold: CoefficientVector
        ) -> tuple[Solution, CoefficientVector]:
            left = replace(unit, c=foretold).without(_rates(r), times * of_imu) * r.dt[:, None]
            dtheta, dvel = np.hsplit(left, 2)
            true = r.scaled(1 / (1 + scale * float(times @ ~of_imu)))
            found = _smoothed(replace(true, dtheta=dtheta, dvel=dvel), at.point, given)
            return found, _estimate(found)

        return both, again

    return counted(s, c, stages, planned=planned)


def _by_clock(s: Solution, c: CoefficientVector, site: Site) -> FloatArray:
    """Return how what is reported changes with the rate of a clock of all stamps, (p,) [SI].

    Where it is fast by e, a body seems to turn slower by e and to be accelerated less by 2 e, and
    increments are read too small by e. Delays are longer.
    """
    r, at, read = s.readings, s.point, _rates(s.readings)
    added = np.hstack([read[:, :3] - at.gyro[0], 2 * _moving(s, site)])
    if r.log.sampled == "increment":
        added -= read
    found = engine.answers(s, added[:, :, None])
    delays = [n in ("pose.delay", "accel.delay") for n in r.names]
    return (found.A[:, 0] + np.where(delays, at.values, 0.0))[[r.names.index(n) for n in c.names]]


def _contradicted(s: Start, gravity: float) -> None:
    """Refuse what makes IMU and poses contradict each other, by its cause."""
    ratio = float(np.median(s.singular))
    c = s.clocks
    if c.peak < bodies.LEAST_PEAK:
        raise error("pose.apart", peak=plain(c.peak, 2))
    if c.second > c.peak - bodies.SECOND:
        raise error("pose.periodic", peak=plain(c.peak, 3), second=plain(c.second, 3))
    turning = s.singular > 0.1 * s.singular[0]
    if not bodies.of_a_unit(ratio) and turning.all() and s.free_misfit < bodies.MISFIT:
        raise error("pose.gyro_unit", ratio=plain(ratio, 3), hint=rate_hint(ratio))
    if s.sign < 0 and s.misfit > bodies.MISFIT and turning.all():
        raise error("pose.mirror", det=plain(s.sign, 1), misfit=plain(s.misfit, 2))
    if s.misfit > bodies.MISFIT and turning.all():
        raise error("pose.rates", misfit=plain(s.misfit, 2), allowed=plain(bodies.MISFIT, 2))
    some = s.forces.some(1500)
    now = some.fit()[1]
    apart, best = _apart(s)
    if best < now / bodies.CLEARLY:
        raise error("pose.two_times", apart=plain(1e3 * apart, 3), best=plain(best, 2),
                    now=plain(now, 2))  # fmt: skip
    axes = [x for x in exchanges() if np.trace(x) > -3]  # all reversed is a matter of sign, below
    for moved, less, code in ((False, bodies.CLEARLY, "pose.force_axes"),
                              (True, MIRRORED, "pose.position_axes")):  # fmt: skip
        tried = some.exchanged(axes, moved=moved)
        best = float(tried.min())
        if best < now / less:
            raise error(code, words=exchange_words(axes[int(tried.argmin())]), best=plain(best, 2),
                        now=plain(now, 2))  # fmt: skip
    scale, sd, g, scaled = some.scaled()
    # Where nothing is moved, second derivatives of positions are noise, and best left out; noise
    # turns no sign.
    told = scaled * bodies.OTHER_UNIT < min(now, some.unmoved()) or scale < -bodies.SURE * 2 * sd
    told &= not bodies.of_a_unit(scale)
    if told and bodies.of_a_unit(g / gravity / scale):
        raise error("pose.accel_unit", found=plain(g, 3), site=plain(gravity, 4))
    if told:
        raise error("pose.position_unit", ratio=plain(scale, 3), best=plain(scaled, 2),
                    now=plain(now, 2))  # fmt: skip
    if not bodies.of_a_unit(s.gravity / gravity):
        raise error("pose.accel_unit", found=plain(s.gravity, 3), site=plain(gravity, 4))


def _contradicted_places(s: Start, gravity: float) -> None:
    """Refuse positions alone that contradict the IMU, where it is moved in all directions."""
    if s.singular[2] < 0.5 * s.singular[0]:
        return
    if not bodies.of_a_unit(s.gravity / gravity):
        raise error("pose.accel_unit", found=plain(s.gravity, 3), site=plain(gravity, 4))
    scale = float(np.median(s.singular))
    if not bodies.of_a_unit(scale):
        raise error("pose.position_unit", ratio=plain(scale, 3), best=plain(s.force, 2),
                    now=plain(s.forces.fit()[1], 2))  # fmt: skip
    if s.sign < 0:
        raise error("pose.world_mirrored", factor=plain(s.forces.fit()[1] / s.force, 2))


def _apart(s: Start) -> tuple[float, float]:
    """Return how much later positions are stamped than attitudes [s], and what that leaves [m/s^2].

    As far as the least squares of forces tells it.
    """
    step, some = s.step, s.forces.some(700)
    tried = np.arange(-round(APART / step), round(APART / step) + 1, max(1, round(0.02 / step)))
    later = [replace(s.forces, pull=np.roll(s.forces.pull, -k, axis=0)).some(700).pull
             for k in tried]  # fmt: skip
    left = some.fits(some.accel, np.array(later))[1]
    return float(tried[left.argmin()] * step), float(left.min())


def _estimate(s: Solution) -> CoefficientVector:
    """Return what was found, without what was held; the whole of an IMU before its ties."""
    kept = [i for i in _order(s.readings.names) if i not in s.hold]
    layout = LAYOUT.subset(s.readings.names[i] for i in kept)
    return CoefficientVector(layout, s.point.values[kept], s.cov[np.ix_(kept, kept)],
                             prior_sd=s.prior_sd[kept])  # fmt: skip


def _order(names: tuple[str, ...]) -> list[int]:
    return sorted(range(len(names)), key=lambda i: LAYOUT.index(names[i]))


def _checks(s: Solution, settings: Settings) -> list[Check]:
    told = s.readings.measured[:, [1, 4]]
    left = 100 * float(np.mean(s.noise.weights[told] < 0.5))
    out = [
        check("pose halves", "halves of the log", s.halves, None, bodies.HALVES),
        check("pose outliers", "outliers", left, None, LEFT_OUT),
    ]
    declared = {"attitude": settings.attitude_sd, "position": settings.position_sd}
    if s.readings.second is not None:
        declared = {"second antenna": settings.second_sd, "position": settings.position_sd}
    for k, (name, sd) in enumerate(declared.items()):
        if sd is None or not told[:, k].any():
            continue
        own = s.rows[:, 3 * k : 3 * k + 3]
        found = component(own, FALSE_ALARM, 2)
        if found is not None:
            rms, low, high = found.rms
            out.append(check("pose noise", f"noise of the {name}", rms, low, high, {"name": name}))
    return out


def _changed(s: Solution, c: CoefficientVector) -> list[Finding]:
    kept = [s.readings.names.index(n) for n in c.names]
    return bodies.changed(engine.changes(s), s, c, kept, "pose.changed", CHANGES)


def _told(s: Solution, start: Start, log: Log) -> list[Finding]:
    told, clock_sd = [], log.clock.sd
    jumps = start.clocks.jumps / log.interval
    if jumps > bodies.JUMPS:
        told.append(finding("pose.stamps", jumps=plain(jumps, 2)))
    tilt = np.degrees(np.arccos(np.abs(s.point.up_v).max()))
    axis = int(np.argmax(np.abs(s.point.up_v)))
    if axis != 2 or s.point.up_v[2] < 0:
        named = "-" * bool(s.point.up_v[axis] < 0) + AXES[axis]
        told.append(finding("pose.upright", axis=named, tilt=plain(tilt, 2)))
    kappa, sd = s.point.kappa, float(np.sqrt(s.cov[7, 7]))
    if abs(kappa) > bodies.SURE * max(clock_sd, sd):
        told.append(finding("pose.clock", kappa=plain(1e6 * kappa, 3), sd=plain(1e6 * sd, 2),
                            usual=plain(1e6 * clock_sd, 2)))  # fmt: skip
    if (count := int(s.readings.jumped[-1] - s.readings.jumped[0])) > 0:
        told.append(finding("pose.jumped", count=count))
    if s.halves > bodies.MOVED:
        told.append(finding("pose.moved", factor=plain(s.halves, 2)))
    if s.spread > bodies.COLOURED:
        first, position = (plain(x, 2) for x in s.lag_one)
        what = "attitudes" if s.readings.second is None else "the second antenna"
        told.append(finding("pose.coloured", first=first, what=what, position=position,
                            factor=plain(s.spread, 2)))  # fmt: skip
    return told


def _found(
    log: Log, given: Given[Settings], *, planned: bool = False
) -> tuple[Found[Solution], tuple[Start, Solution]]:
    """Return what a log tells, and its start and solution as if nothing were left out.

    `planned`: it is of a session that was not made.
    """
    bare, start = _solved(log, given)
    s, c = bare, _estimate(bare)
    beside = _counted(s, c, given, planned=planned)
    if beside is not None:
        s, c = beside.solution, beside.coefficients
    names = s.readings.names
    kept = [names.index(n) for n in c.names]
    bound = np.sqrt(np.diag(s.formal) + s.of_gravity**2)[kept]
    unseen = [n for i, n in enumerate(names) if s.unseen[i] and i not in s.hold]

    def parts() -> dict[str, FloatArray]:
        return {name: v[kept] for name, v in engine.budget(s).items()}

    by_clock = partial(_by_clock, s, c, given.site)
    return Found(s, c, bound, unseen, parts, _bases(given), by_clock, beside), (start, bare)


def _bases(given: Given[Settings]) -> dict[str, tuple[str, str]]:
    """Return where the size of each noise is from: type and basis."""
    settings = given.settings
    of_imu = NOISE_BASIS["measured" if given.noise is None else "declared"]
    told = {
        "position of the poses": settings.position_sd,
        "attitude of the poses": settings.attitude_sd, "second antenna": settings.second_sd,
    }  # fmt: skip
    found = {n: NOISE_BASIS["unknown" if sd is None else "declared"] for n, sd in told.items()}
    return {"gyros": of_imu, "accelerometers": of_imu, engine.COLOUR: bodies.COLOUR_BASIS, **found}


def _solve(log: Log, given: Given[Settings]) -> Result:
    log = without_spikes(log, most=KNOCKS)
    at, (start, bare) = _found(log, given)
    s, c = at.solution, at.coefficients
    changed = _changed(s, c)
    if at.beside is None:
        changed += _scaled(s, c, given.site)
    if at.beside is not None and at.beside.judged.named:
        # What is left out has then taken what changed for itself.
        changed = changed or _changed(bare, _estimate(bare))
    second, ok = s.readings.second, s.readings.measured
    gravity = s.of_gravity[[s.readings.names.index(n) for n in c.names]]
    diagnostics: dict[str, Any] = {
        "pose": {
            "used": int((s.noise.weights[ok[:, 4], 1] > 0.5).sum()), "read": len(ok),
            "attitude_sd": None if s.readings.C_vm is None else s.noise.attitude,
            "position_sd": s.noise.position, "reading": start.reading,
            "colour": s.spread, "halves": s.halves, "lag_one": list(s.lag_one),
            "peak": None if np.isnan(start.clocks.peak) else start.clocks.peak,
            "jumps": start.clocks.jumps,
            "middle": s.readings.middle, "up": s.point.up_v.tolist(),
            "C_bm": s.point.C_bm.tolist() if s.readings.C_vm is not None else None,
        } | ({"second_sd": s.noise.attitude, "second": second.told} if second else {}),
        "noise": {"gyro": s.readings.white[0], "accel": s.readings.white[1]},
    } | of_site(given.site.as_dict(), c.names, gravity)  # fmt: skip
    z = np.where((np.repeat(s.noise.weights, 3, axis=1) > 0.5) & ok, s.residuals, np.nan)
    first = "second" if second else "attitude"
    names = [f"{what}_{a}" for what in (first, "position") for a in "xyz"]
    some = np.flatnonzero(ok.any(axis=0))
    poses = {"time": s.readings.at(s.point.tau, s.point.kappa), **{names[k]: z[:, k] for k in some}}
    return result_of(
        "imu_pose", FRAME, log, given, at, checks=_checks(s, given.settings),
        findings=[*changed, *_told(s, start, log)], diagnostics=diagnostics,
        tables={"poses": poses},
    )  # fmt: skip


# -- sessions --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PoseSession:
    """A simulated session."""

    log: PoseLog  # [SI]
    model: ImuModel  # errors of the IMU
    tracker: Tracker
    late: float  # of the accelerometers [s]

    @property
    def size_effect(self) -> SizeEffect:
        """Delay of the accelerometers."""
        return SizeEffect(delay=self.late)

    @property
    def beside(self) -> CoefficientVector:
        """How the tracked body was fixed, and its clock: true values [SI]."""
        t, C_cb = self.tracker, self.model.in_gauge(Gauge.LOWER)[1]
        values = [*vector_of(C_cb @ t.C_bm), *(C_cb @ t.lever_b), t.delay, t.drift, *t.tilt]
        if t.base_b is None:
            return CoefficientVector(OF_POSE, np.array(values))
        layout = Layout((*OF_POSE.coefficients, *OF_BASE.coefficients))
        return CoefficientVector(layout, np.array([*values, *(C_cb @ t.base_b)]))

    def truth_json(self) -> dict[str, Any]:
        """Return what was true beside the errors of the sensors, for truth.json."""
        return {"C_bm": self.tracker.C_bm.tolist(), "outliers": self.tracker.outliers}


def _simulated(
    session: Session, settings: Settings, model: ImuModel, noise: ImuNoise, site: Any, seed: int
) -> PoseSession:
    rng = np.random.default_rng([seed, 31])
    motion = HandMotion.drawn(session.motion, session.vigour, rng)
    turned = rng.standard_normal(3)
    from foucault.models.rotation import exp

    east, north = session.tilt * rng.standard_normal(2)
    tracker = Tracker(
        session.pose_rate, session.position_noise,
        session.attitude_noise if session.with_attitude and not session.base else None,
        exp(0.5 * turned),
        np.array([parse(text, "length") for text in session.lever_arm]), session.offset,
        session.clock_drift, (float(east), float(north)), session.outliers, lost=session.lost,
        base_b=session.base and np.array([parse(text, "length") for text in session.base]),
    )  # fmt: skip
    log, table = simulate_hand(
        motion, tracker, duration=session.time, rate=session.rate, model=model, noise=noise,
        late=session.accelerometers_late, gravity=site.gravity, rng=rng,
    )  # fmt: skip
    return PoseSession(PoseLog.of(log, table), model, tracker, session.accelerometers_late)


def _names(settings: Settings, session: Session) -> tuple[str, ...]:
    names = OF_ANTENNAS if session.base else NAMES
    held = settings.held(session.with_attitude or session.base is not None)
    return tuple(names[i] for i in _order(names) if i not in held)


PROCEDURE = Procedure(
    name="imu_pose",
    doc=__doc__,
    Settings=Settings,
    Session=Session,
    solve=_solve,
    plan=lambda _settings, session, _site: Free(f"move it: {session.motion}", session.time),
    simulation=_simulated,
    names=_names,
    layout=LAYOUT,
    foresee=lambda b: foreseen(b, _simulated, _found),
    assumes_noise=True,
    counts=True,
    counts_by_noise=True,
    Master=PoseDescription,
    with_master=_with_poses,
    write=_write,
    log_table=_log_table,
)
calibrate, simulate, trial = PROCEDURE.calibrate, PROCEDURE.simulate, PROCEDURE.trial
