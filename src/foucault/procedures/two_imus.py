"""Calibrate an IMU against another one on the same plate, moved by hand; also three or four.

The plate is turned and moved for half a minute. It gives how each IMU is turned against the first,
the lever arm from the accelerometers of the first to its own, the offset and the rate of the
clocks, and the errors of the IMU against the first: biases, scale factors, misalignments, the
g-sensitivity of its gyros, and how much later its accelerometers read than its gyros. No camera, no
table, no attitude: gravity and the rotation of the Earth are the same for both.

Tables of the result
--------------------
``left``: time by the clock of the first IMU [s]; of the calibrated IMU ``gyro_x`` .. ``gyro_z``
[rad/s] and ``accel_x`` .. ``accel_z`` [m/s^2], readings less what was found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from foucault import logs
from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.detect.noise import KNOCKS, without_spikes
from foucault.diagnose.checks import check
from foucault.errors import Finding, error, finding
from foucault.estimate import two_bodies as bodies
from foucault.estimate import two_imus as engine
from foucault.estimate.norm_observation import wahba
from foucault.estimate.two_bodies import SMOOTH, Clocks, clocks, even, one_axis, smooth
from foucault.estimate.two_imus import Readings, Slave, Solution
from foucault.guard.mistakes import exchange_words, exchanges, rate_hint
from foucault.infer.gauss_newton import chi_square_limits
from foucault.infer.mixed import NOISE_BASIS
from foucault.infer.shown import shares
from foucault.logs.checks import on_a_shared_clock
from foucault.logs.description import OWN_LOG, LogDescription, log_head
from foucault.models.imu import Gauge, ImuModel
from foucault.models.left_out import ByNoise
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.models.rotation import cross_matrix, exp
from foucault.models.two_imus import LAYOUT, ORDINALS, SENSORS, layout_of
from foucault.plans.directions import Free
from foucault.procedures.by_hand import Found, HandSession, foreseen, result_of
from foucault.procedures.chosen import Chosen
from foucault.procedures.counted import Again, Counted, Stages, Unit, counted
from foucault.procedures.left_out import told_beside
from foucault.procedures.record import Given, Procedure
from foucault.result import Check, Result
from foucault.simulate.hand_motion import HandMotion
from foucault.simulate.noise import sampled_log
from foucault.tables import AXES, Log, whole_samples
from foucault.units import Seconds, parse, plain

FRAME = "body axes of the IMU that is calibrated, as its accelerometers define them (see gauge)"


class Settings(Chosen):
    """What can be chosen; the defaults suit a plate moved by hand."""

    clock: bool = True
    """Estimate the rate of the two clocks."""
    accel_delay: bool = True
    """Estimate how much later accelerometers read than gyros, against the first IMU's."""
    g_sensitivity: bool = True
    """Estimate the gyros' g-sensitivity too."""
    knot: Seconds = Field(default=0.02, gt=1e-3, le=0.2)
    """Between two knots of the motion: wider where noise is large and motion slow."""
    passes: int = Field(default=12, ge=4, le=40)
    """At most so many passes; fewer where nothing moves any more."""

    @property
    def held(self) -> tuple[str, ...]:
        """Return endings and groups of names that are not estimated."""
        return ((".clock",) * (not self.clock) + ("accel.delay",) * (not self.accel_delay)
                + ("gyro.g_sensitivity",) * (not self.g_sensitivity))  # fmt: skip

    def names(self, slaves: int) -> tuple[str, ...]:
        """Return the names that are estimated of so many `slaves` [1], in their order."""
        return tuple(n for n in layout_of(slaves).names
                     if not any(n.endswith(k) or f"{k}." in n for k in self.held))  # fmt: skip


class Session(HandSession):
    """The session that `simulate` makes."""

    imus: int = Field(default=2, ge=2, le=4)
    """How many there are, the first among them."""
    better: float = Field(default=4.0, ge=0.1, le=1000)
    """By how much the first IMU's noise is less."""
    lever_arm: tuple[str, str, str] = ("8 cm", "-12 cm", "5 cm")
    """From the accelerometers of the first IMU to those of the second; the others are as far."""
    offset: Seconds = Field(default=0.2, gt=-10, lt=10)
    """What is to be added to the stamps of the others."""
    clock_drift: float = Field(default=2e-5, gt=-1e-2, lt=1e-2)
    """Part by which the clock of the first is faster."""
    accelerometers_late: Seconds = Field(default=0.0, gt=-0.05, lt=0.05)
    """How much later accelerometers read than gyros, of the others."""


@dataclass(frozen=True)
class ImuLogs(Log):
    """The log of the IMU that is calibrated, of the `master` against which it is, and of `others`.

    `time`, `gyro`, `accel`, `temperature`, `averaged`, `begins`, `mag`, `rests`: of the first [SI].
    """

    master: Log | None = None
    others: tuple[Log, ...] = ()

    @classmethod
    def of(cls, log: Log, master: Log, others: Sequence[Log] = ()) -> ImuLogs:
        """Return logs of one plate; `log`: that is calibrated, `master`, `others` [SI]."""
        told = (*on_a_shared_clock(log.findings), *on_a_shared_clock(master.findings))
        source = log.source | ({"master": master.source} if master.source else {})
        own = {f.name: getattr(log, f.name) for f in fields(Log)}
        more = {"master": master, "others": tuple(others)}
        return cls(**own | {"findings": told, "source": source} | more)

    @property
    def all(self) -> tuple[Log, ...]:
        """The logs, the master's first."""
        assert self.master is not None
        return (self.master, self, *self.others)


class MasterDescription(LogDescription):
    """Where the log of the first IMU is, and those of further ones."""

    others: tuple[str, ...] = Field(
        (), max_length=2, examples=[["third.csv"]],
        description="files of further IMUs on the plate, with columns as in [master]",
    )  # fmt: skip


def _with_master(log: Log, said: MasterDescription, folder: str | Path) -> ImuLogs:
    bare = said.model_copy(update={"others": ()})
    others = [logs.read(bare.model_copy(update={"file": f}), folder) for f in said.others]
    return ImuLogs.of(log, logs.read(bare, folder), others)


def _write(log: ImuLogs, path: str | Path) -> None:
    master, _, *others = log.all
    logs.write(log, path)
    for one, name in zip((master, *others), FILES, strict=False):
        logs.write(one, Path(path).with_name(name))


FILES = ("first.csv", "third.csv", "fourth.csv")


def _log_table(log: ImuLogs | None = None) -> str:
    more = '\n[master]\nfile = "first.csv"'
    if log is None:
        return log_head("the IMU to be calibrated; ") + more + _MASTER
    named = ", ".join(f'"{name}"' for name in FILES[1 : 1 + len(log.others)])
    return f"{OWN_LOG}{more}\n" + (f"others = [{named}]\n" if log.others else "")


_MASTER = """                      # the IMU against which it is
time = { column = "time", unit = "s" }
gyro = { columns = ["gyro_x", "gyro_y", "gyro_z"], unit = "rad/s" }
accel = { columns = ["accel_x", "accel_y", "accel_z"], unit = "m/s^2" }
# others = ["third.csv"]                # further IMUs on the plate
"""


# -- where to start --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Start:
    """What closed forms say of a slave, and how well."""

    slave: Slave
    clocks: Clocks
    jumps: float  # of the stamps against a line, in samples (rms) [1]


FORCES = 800  # Samples by which lever arm and forces are judged, evenly chosen [1].


def start_of(master: Log, log: Log, who: str) -> Start:
    """Find offset, clock rate, rotation and lever arm in closed form; name what contradicts them.

    `who`: what the slave is called.
    """
    (t_b, w_b, f_b), (t_c, w_c, f_c) = (_smoothed(x) for x in (master, log))
    c = clocks((t_b, w_b), (t_c, w_c), float(log.time[0] + log.time[-1]) / 2)
    if c.peak < bodies.LEAST_PEAK:
        raise error("imus.apart", who=who, peak=plain(c.peak, 2))
    if c.second > c.peak - bodies.SECOND:
        raise error("imus.periodic", peak=plain(c.peak, 3), second=plain(c.second, 3))
    t = t_c + c.tau + c.kappa * (t_c - float(log.time[0] + log.time[-1]) / 2)
    inside = (t > t_b[0] + SMOOTH) & (t < t_b[-1] - SMOOTH)
    inside &= ~bodies.gaps(t_b, t, max(bodies.LOST * master.interval, SMOOTH))
    t, w_c, f_c = t[inside], w_c[inside], f_c[inside]
    alpha = even(t_b, np.gradient(w_b, t_b, axis=0), t)
    w_b, f_b = even(t_b, w_b, t), even(t_b, f_b, t)
    x, y = w_c - w_c.mean(axis=0), w_b - w_b.mean(axis=0)
    C_cb, free = wahba(x, y), np.linalg.lstsq(y, x, rcond=None)[0].T
    size, some = np.linalg.svd(free)[1], slice(None, None, max(1, len(t) // FORCES))
    f_c, f_b, w_b, alpha = f_c[some], f_b[some], w_b[some], alpha[some]
    if (axis := one_axis(y)) is not None:
        # The angle about a single axis is left to the forces.
        angles = np.arange(-18, 18) * np.pi / 18
        tried = [C_cb @ exp(a * axis) for a in angles]
        C_cb = min(tried, key=lambda C: float(_arm(f_c, f_b, w_b, alpha, C)[1]))
    else:
        _rates(who, size, free, *(float(np.sqrt(np.sum((x - y @ C.T) ** 2) / np.sum(x**2)))
                                  for C in (C_cb, free)))  # fmt: skip
    _forces(who, f_c, f_b, w_b, alpha, C_cb)
    slave = Slave.started(C_cb, _arm(f_c, f_b, w_b, alpha, C_cb)[0][:3], c.tau, c.kappa)
    return Start(slave, c, c.jumps / log.interval)


def _smoothed(log: Log) -> tuple[FloatArray, FloatArray, FloatArray]:
    r = Readings.of(log)
    return r.time, smooth(r.read[:, :3], log.interval), smooth(r.read[:, 3:], log.interval)


def _arm(
    f_c: FloatArray, f_b: FloatArray, w: FloatArray, alpha: FloatArray, C_cb: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return lever arm and bias, (6,) or (6, b) [SI], and what they leave (rms), () or (b,).

    `f_c` (n, 3) or (b, n, 3); `f_b`, `w`, `alpha` (n, 3) [SI].
    """
    Om = cross_matrix(alpha) + cross_matrix(w) @ cross_matrix(w)
    A = np.concatenate([C_cb @ Om, np.broadcast_to(np.eye(3), Om.shape)], axis=2).reshape(-1, 6)
    y = f_c - f_b @ C_cb.T
    y = y.reshape(*y.shape[:-2], -1).T
    x = np.linalg.lstsq(A, y, rcond=None)[0]
    return x, np.sqrt(np.mean((y - A @ x) ** 2, axis=0))


def _rates(who: str, size: FloatArray, free: FloatArray, misfit: float, loose: float) -> None:
    ratio = float(np.median(size))
    turning = bool((size > 0.1 * size[0]).all())
    if not bodies.of_a_unit(ratio) and turning and loose < bodies.MISFIT:
        hint = rate_hint(ratio)
        raise error("imus.gyro_unit", who=who, ratio=plain(ratio, 3), hint=hint)
    det = float(np.sign(np.linalg.det(free)))
    if det < 0 and misfit > bodies.MISFIT:
        raise error("imus.mirror", who=who, det=plain(det, 1), misfit=plain(misfit, 2))
    if misfit > bodies.MISFIT:
        raise error("imus.rates", who=who, misfit=plain(misfit, 2), allowed=plain(bodies.MISFIT, 2))


def _forces(
    who: str, f_c: FloatArray, f_b: FloatArray, w: FloatArray, alpha: FloatArray, C_cb: FloatArray
) -> None:
    # A scale beside lever arm and bias: fast turns at the end of a lever arm are no other unit.
    Om = cross_matrix(alpha) + cross_matrix(w) @ cross_matrix(w)
    f = (f_b @ C_cb.T)[:, :, None]
    A = np.concatenate([C_cb @ Om, np.broadcast_to(np.eye(3), Om.shape), f], axis=2)
    ratio = float(np.linalg.lstsq(A.reshape(-1, 7), f_c.ravel(), rcond=None)[0][6])
    now, scaled = (k * float(_arm(f_c / k, f_b, w, alpha, C_cb)[1])
                   for k in (1.0, max(ratio, 1e-6)))  # fmt: skip
    if not bodies.of_a_unit(ratio) and ratio > 0 and scaled < now / bodies.CLEARLY:
        raise error("imus.accel_unit", who=who, ratio=plain(ratio, 3))
    tried = _arm(f_c @ np.swapaxes(exchanges(), 1, 2), f_b, w, alpha, C_cb)[1]
    best, k = float(tried.min()), int(tried.argmin())
    if best < now / bodies.CLEARLY:
        raise error("imus.force_axes", who=who, words=exchange_words(exchanges()[k]),
                    best=plain(best, 2), now=plain(now, 2))  # fmt: skip


# -- calibrating -----------------------------------------------------------------------------------


def _solved(log: Log, given: Given[Settings]) -> tuple[Solution, list[Start]]:
    if getattr(log, "master", None) is None:
        raise error("imus.no_master")
    assert isinstance(log, ImuLogs)
    every, settings = log.all, given.settings
    for who, one in zip(("first", *ORDINALS), every, strict=False):
        missing = "gyros" if one.gyro is None else "accelerometers" if one.accel is None else ""
        if missing:
            raise error("imus.no_triad", who=who, triad=missing)
        if one.duration < bodies.SHORTEST:
            raise error("imus.short", who=who, span=plain(one.duration, 2),
                        least=plain(bodies.SHORTEST, 2))  # fmt: skip
    given.progress(0.1, "matching what all did")
    starts = [start_of(every[0], one, who) for one, who in zip(every[1:], ORDINALS, strict=False)]
    noise, sd = given.noise, None
    if noise is not None:
        sd = tuple(x.white / np.sqrt(log.interval) for x in (noise.gyro, noise.accel))
    given.progress(0.3, "finding the motion")
    begun = [s.slave for s in starts]
    problem = engine.problem_of(
        [Readings.of(one) for one in every], begun, given.prior,
        [None, sd, *(None for _ in log.others)], settings.knot, settings.held,
    )  # fmt: skip
    return engine.solve(problem, begun, settings.passes), starts


def _estimate(s: Solution) -> tuple[CoefficientVector, list[int]]:
    layout = layout_of(len(s.slaves))
    kept = [layout.index(n) for n in LAYOUT.names
            if n in layout.names and layout.index(n) not in s.problem.hold]  # fmt: skip
    return CoefficientVector(
        layout.subset(layout.names[i] for i in kept), s.values[kept], s.cov[np.ix_(kept, kept)],
        prior_sd=s.problem.prior_sd[kept],
    ), kept  # fmt: skip


def _counted(
    s: Solution, c: CoefficientVector, log: Log, given: Given[Settings], *, planned: bool = False
) -> Counted[Solution] | None:
    """Return what a solution comes to beside what is not estimated, None where nothing has a size.

    `c`: what is reported of it [SI]; `planned`: it is of a session that was not made.
    """

    def noise(k: int) -> ImuNoise:
        gyro, accel = (TriadNoise(white=float(x)) for x in np.sqrt(s.var[k] * log.interval))
        return ImuNoise(accel, gyro)

    sizes = told_beside(given.sizes, given.noise or noise(1), log.duration)
    if sizes is None:
        return None
    # What is declared is of the IMU; the first, whose errors all others are relative to, has terms
    # of the class that its own noise tells.
    usual = told_beside(ByNoise(), noise(0), log.duration) or {}
    firsts = {group: usual[group] for group in sizes if group in usual}

    def stages(
        at: Solution, c: CoefficientVector, out: FloatArray
    ) -> tuple[Stages, Again[Solution]]:
        def units(c: CoefficientVector) -> list[Unit]:
            first, *others = at.problem.readings
            slaves = [Unit(c, r.time, given.site, sizes, own=f"{who}." if k else "") for k, (who, r)
                      in enumerate(zip(ORDINALS, others, strict=False))]  # fmt: skip
            relative = tuple(slaves[0].names)
            return [Unit(c, first.time, given.site, firsts, "first.", relative=relative), *slaves]

        def split(times: FloatArray) -> list[FloatArray]:
            return np.split(times, np.cumsum(counts)[:-1])

        # Terms are of the motion: with the noise of a reading in them they would follow it.
        noises = [np.nan_to_num(x) for x in at.left]
        read = [r.read - n for r, n in zip(at.problem.readings, noises, strict=True)]
        each = [unit.terms(y) for unit, y in zip(units(c), read, strict=True)]
        counts, some = [len(x) for x in each], [x for own in each for x in own]
        own = split(np.broadcast_to(out, len(some)))
        made = [unit.added(y, x) for unit, y, x in zip(units(c), read, own, strict=True)]
        found = engine.answers(at, [columns for columns, _ in made])
        spread = at.spread if at.spread > bodies.COLOURED else 1.0
        follows = np.concatenate([x for _, x in made])
        both = Stages.of(c, some, sizes, found.of(spread, _estimate(at)[1], follows), out)

        def again(
            times: FloatArray, foretold: CoefficientVector
        ) -> tuple[Solution, CoefficientVector]:
            left = tuple(
                replace(r, read=unit.without(r.read - n, x) + n)
                for unit, r, n, x in zip(
                    units(foretold), s.problem.readings, noises, split(times), strict=True
                )
            )
            problem = replace(s.problem, readings=left)
            found = engine.solve(problem, at.slaves, given.settings.passes)
            return found, _estimate(found)[0]

        return both, again

    return counted(s, c, stages, planned=planned)


def _by_clock(s: Solution, c: CoefficientVector, log: Log) -> FloatArray:
    """Return how what is reported changes with the rate of a clock of all logs, (p,) [SI].

    Where it is fast by e, increments are read too small by e, and rates seem to change more slowly:
    forces along a lever arm, ``alpha x l``, are not what they were. Delays are longer.
    """
    assert isinstance(log, ImuLogs)
    made = [-(one.sampled == "increment") * r.read for one, r in
            zip(log.all, s.problem.readings, strict=True)]  # fmt: skip
    for at, r, added in zip(s.slaves, s.problem.readings[1:], made[1:], strict=True):
        w = (r.read[:, :3] - at.gyro[0]) @ np.linalg.inv(at.gyro[1]).T
        alpha = smooth(w, float(np.median(np.diff(r.time))), 1)
        added[:, 3:] += np.cross(alpha, at.C_cb @ at.lever_b)
    layout = layout_of(len(s.slaves))
    delays = [name.endswith(".delay") for name in layout.names]
    moved = engine.answers(s, [x[:, :, None] for x in made]).A.sum(axis=1) + np.where(
        delays, s.values, 0.0
    )
    return np.asarray(moved[[layout.index(n) for n in c.names]])


def _checks(s: Solution) -> list[Check]:
    out = [check("imus halves", "halves of the log", s.halves, None, bodies.HALVES)]
    if s.problem.given[1] is not None:
        dof = 3.0 * len(s.problem.readings[1].time)
        low, high = np.sqrt(np.array(chi_square_limits(dof, tests=2)) / dof)
        for name, square in zip(("gyros", "accelerometers"), s.ratio[1], strict=True):
            out.append(check("imus noise", f"noise of the {name}", float(np.sqrt(square)),
                             float(low), float(high), {"name": name}))  # fmt: skip
    return out


CHANGES = {
    f"{who}.{what}": words.format(who=who)
    for who in ORDINALS
    for what, words in (
        ("rotation", "how the {who} IMU is turned against the first"),
        ("lever", "the lever arm to the {who} IMU"),
        ("delay", "the offset of the clock of the {who} IMU (stamps jumped)"),
        ("clock", "the rate of the clock of the {who} IMU"),
        *((own, words + " of the {who} IMU, or the first") for own, words in bodies.OF_IMU.items()),
    )
}
"""What may change for good half-way, in words."""


def _changed(s: Solution, c: CoefficientVector) -> list[Finding]:
    names = layout_of(len(s.slaves)).names
    kept = [names.index(n) for n in c.names]
    found = {n if n.startswith(ORDINALS) else f"second.{n}": x
             for n, x in engine.changes(s).items()}  # fmt: skip
    return bodies.changed(found, s, c, kept, "imus.changed", CHANGES)


def _told(s: Solution, starts: Sequence[Start], clock_sd: float) -> list[Finding]:
    told = []
    for k, (who, one) in enumerate(zip(ORDINALS, starts, strict=False)):
        row = (8 + len(SENSORS)) * k + 7
        kappa, sd = s.slaves[k].kappa, float(np.sqrt(s.cov[row, row]))
        if one.jumps > bodies.JUMPS:
            told.append(finding("imus.stamps", who=who, jumps=plain(one.jumps, 2)))
        if abs(kappa) > bodies.SURE * max(np.sqrt(2) * clock_sd, sd):
            told.append(finding("imus.clock", who=who, kappa=plain(1e6 * kappa, 3),
                                sd=plain(1e6 * sd, 2), usual=plain(1e6 * clock_sd, 2)))  # fmt: skip
    if s.halves > bodies.MOVED:
        told.append(finding("imus.moved", factor=plain(s.halves, 2)))
    if s.spread > bodies.COLOURED:
        gyro, accel = (plain(float(x), 2) for x in s.lag_one[1])
        told.append(finding("imus.coloured", gyro=gyro, accel=accel, factor=plain(s.spread, 2)))
    return told


def _budget(s: Solution, kept: list[int]) -> dict[str, FloatArray]:
    """Return the variance of what is reported by source, (p,) each [SI]; they add up to `cov`."""
    formal = np.diag(s.formal)
    parts = {}
    for k, name in enumerate(_noises(s)):
        var = s.var.copy()
        var.flat[k] *= 1 + STEP
        parts[name] = np.maximum(np.diag(engine.formal(s, var)) - formal, 0.0) / STEP
    known = shares(parts, formal, np.diag(s.cov), COLOUR)
    return {name: v[kept] for name, v in known.items()}


COLOUR = "colour of what is left"  # Source of what is related from reading to reading.


def _noises(s: Solution) -> dict[str, tuple[str, str]]:
    """Return the noise of each triad, and where its size is from: type and basis."""
    whose = zip(("first", *ORDINALS), s.problem.given, strict=False)
    return {
        f"{sensor} of the {who} IMU": NOISE_BASIS["unknown" if said is None else "declared"]
        for who, said in whose for sensor in ("gyros", "accelerometers")
    }  # fmt: skip


STEP = 0.02  # Part of a variance by which it is changed to see what hangs on it [1].


def _found(
    log: Log, given: Given[Settings], *, planned: bool = False
) -> tuple[Found[Solution], tuple[list[Start], Solution]]:
    """Return what logs tell, and their starts and solution as if nothing were left out.

    `planned`: they are of a session that was not made.
    """
    bare, starts = _solved(log, given)
    s, (c, kept) = bare, _estimate(bare)
    beside = _counted(s, c, log, given, planned=planned)
    if beside is not None:
        s, c = beside.solution, beside.coefficients
    names = zip(layout_of(len(s.slaves)).names, s.unseen, strict=True)
    bound, unseen = np.sqrt(np.diag(s.formal))[kept], [n for n, lost in names if lost]
    bases, by_clock = _noises(s) | {COLOUR: bodies.COLOUR_BASIS}, partial(_by_clock, s, c, log)
    return Found(s, c, bound, unseen, lambda: _budget(s, kept), bases, by_clock, beside), (
        starts,
        bare,
    )


def _clean(log: Log) -> Log:
    """Return logs without spikes, which are told."""
    log = without_spikes(log, most=KNOCKS)
    if not isinstance(log, ImuLogs) or log.master is None:
        return log
    every = (log.master, *log.others)
    clean = [without_spikes(one, most=KNOCKS) for one in every]
    told = [f for a, b in zip(every, clean, strict=True) for f in b.findings[len(a.findings) :]]
    return replace(log, master=clean[0], others=tuple(clean[1:]),
                   findings=(*log.findings, *told))  # fmt: skip


def _solve(log: Log, given: Given[Settings]) -> Result:
    log = _clean(log)
    at, (starts, bare) = _found(log, given)
    s = at.solution
    changed = _changed(s, at.coefficients)
    if at.beside is not None and at.beside.judged.named:
        # What is left out has then taken what changed for itself.
        changed = changed or _changed(bare, _estimate(bare)[0])
    noise = np.sqrt(s.var[1] * log.interval).tolist()
    diagnostics: dict[str, Any] = {
        "imus": {
            "colour": s.spread, "halves": s.halves, "lag_one": s.lag_one.tolist(),
            "noise": np.sqrt(s.var).tolist(), "peak": [x.clocks.peak for x in starts],
            "jumps": [x.jumps for x in starts],
            "middle": [r.middle for r in s.problem.readings[1:]],
            "C_cb": [x.C_cb.tolist() for x in s.slaves],
            "lever_b": [x.lever_b.tolist() for x in s.slaves],
            "tau": [x.tau for x in s.slaves],
        },
        "noise": dict(zip(("gyro", "accel"), noise, strict=True)),
    }  # fmt: skip
    columns = [f"{what}_{a}" for what in ("gyro", "accel") for a in AXES]
    left = {"time": s.slaves[0].at(s.problem.readings[1]),
            **{n: s.left[1][:, k] for k, n in enumerate(columns)}}  # fmt: skip
    return result_of(
        "two_imus", FRAME, log, given, at, checks=_checks(s),
        findings=[*changed, *_told(s, starts, log.clock.sd)], diagnostics=diagnostics,
        tables={"left": left},
    )  # fmt: skip


# -- sessions --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ImuSession:
    """A simulated session."""

    log: ImuLogs  # [SI]
    model: ImuModel  # errors of the IMU that is calibrated
    ties: tuple[Slave, ...]  # how all are fixed; errors of the sensors are in `model`

    @property
    def beside(self) -> CoefficientVector:
        """How they are fixed, and their clocks: true values [SI]."""
        first = self.ties[0]
        C_cb = self.model.in_gauge(Gauge.LOWER)[1] @ first.C_cb
        own = (*range(8), SENSORS.index("accel.delay") + 8)
        every = [replace(first, C_cb=C_cb).values[list(own)], *(t.values for t in self.ties[1:])]
        names = layout_of(len(self.ties)).names
        some = [names[k] for k in (*own, *range(len(SENSORS) + 8, len(names)))]
        return CoefficientVector(LAYOUT.subset(some), np.concatenate(every))

    def truth_json(self) -> dict[str, Any]:
        """Return what was true beside the errors of the sensors, for truth.json."""
        return {"C_cb": [s.C_cb.tolist() for s in self.ties]}


def _better(noise: ImuNoise, times: float) -> ImuNoise:
    """Return less noise; `times`: by how much [1]."""
    a, g = (replace(x, white=x.white / times) for x in (noise.accel, noise.gyro))
    return ImuNoise(a, g)


TINY = 1e-4  # Half of a difference that tells an angular acceleration [s].


def _simulated(
    session: Session, settings: Settings, model: ImuModel, noise: ImuNoise, site: Any, seed: int
) -> ImuSession:
    rng = np.random.default_rng([seed, 37])
    motion = HandMotion.drawn(session.motion, session.vigour, rng)
    count = whole_samples(session.time * session.rate + 0.5)
    made: list[Log] = []
    ties = []
    for k in range(session.imus):
        lever = np.array([parse(text, "length") for text in session.lever_arm])
        turned = exp(0.5 * rng.standard_normal(3))
        lever = lever if k == 1 else turned @ lever
        tie = replace(Slave.started(turned, lever, session.offset, session.clock_drift),
                      late=session.accelerometers_late)  # fmt: skip
        if k == 0:
            tie = Slave.started(np.eye(3), np.zeros(3), 0.0, 0.0)
        else:
            ties.append(tie)

        def truth(time: FloatArray, tie: Slave = tie) -> tuple[FloatArray, FloatArray]:
            middle = (time[0] + time[-1]) / 2
            t = time + tie.tau + tie.kappa * (time - middle)
            at, w = t - tie.late, motion.rates
            alpha = (w(at + TINY) - w(at - TINY)) / (2 * TINY)
            Om = cross_matrix(alpha) + cross_matrix(w(at)) @ cross_matrix(w(at))
            f = motion.force(at, site.gravity) + Om @ tie.lever_b
            return f @ tie.C_cb.T, w(t) @ tie.C_cb.T

        own = ImuModel() if k != 1 else model
        less = _better(noise, session.better) if k == 0 else noise
        made.append(sampled_log(truth, samples=count, rate=session.rate, sampled="rate", model=own,
                                noise=less, rng=rng))  # fmt: skip
    return ImuSession(ImuLogs.of(made[1], made[0], made[2:]), model, tuple(ties))


PROCEDURE = Procedure(
    name="two_imus",
    doc=__doc__,
    Settings=Settings,
    Session=Session,
    solve=_solve,
    plan=lambda _settings, session, _site: Free(
        f"move all together: {session.motion}", session.time
    ),
    simulation=_simulated,
    names=lambda settings, session: tuple(
        n for n in LAYOUT.names if n in settings.names(session.imus - 1)
    ),
    layout=LAYOUT,
    foresee=lambda b: foreseen(b, _simulated, _found),
    assumes_noise=True,
    counts=True,
    counts_by_noise=True,
    Master=MasterDescription,
    with_master=_with_master,
    write=_write,
    log_table=_log_table,
)
calibrate, simulate, trial = PROCEDURE.calibrate, PROCEDURE.simulate, PROCEDURE.trial
