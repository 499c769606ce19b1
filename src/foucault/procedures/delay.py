"""Find the time offset of two logs of one body: of a slave IMU and a master, or of two IMUs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose import transfer_motion as delay_checks
from foucault.errors import Finding, error, finding
from foucault.estimate.delay import BRACKET, FEWEST, Delay, delay_of
from foucault.estimate.delay_matching import SlaveAttitude
from foucault.guard.mistakes import columns
from foucault.models.earth import earth_rate_n, transport_rate
from foucault.models.rotation import log as rotation_vector
from foucault.models.rotation import matrix_of
from foucault.models.transfer import MasterTable
from foucault.navigate.increments import Increments, increments_of
from foucault.result import Level, Verdict
from foucault.tables import Log, gaps
from foucault.units import plain

MOST = 12000  # Rows of a second log that are compared; more are joined to longer intervals [1].
CLEARLY = 4.0  # By so many times less must be left over for another sense to be told [1].
ASTRAY = np.radians(45.0)  # A mounting that is so far off what was said may be a wrong sign [rad].

EXPLAINED = {"delay.axes", "delay.scale", "delay.north_east_down"}
"""What a reversed angle or axis brings about [1]."""

ALIKE = 0.99  # Above this part in common nothing is tried the other way round [1].


@dataclass(frozen=True)
class Epochs:
    """When and how the second instrument was turned."""

    time: FloatArray  # (k,) its stamps [s]
    C_nb: FloatArray  # (k, 3, 3) its attitude; NaN where its log has a gap [1]
    # (k, 3, 3) the same with an angle or an axis the other way [1]
    reversed_: dict[str, FloatArray]
    w_in_n: FloatArray | None = None  # (k, 3) rate of frame n [rad/s]


@dataclass(frozen=True)
class FoundDelay:
    """The time offset of two logs."""

    delay: Delay  # the offset, mounting and bias [SI]
    messages: bool  # whether the second log holds messages of a master
    # (k,) how long after it held each message arrived, where the log says that [s]
    transport: FloatArray | None
    verdict: Verdict  # how far it can be relied on
    findings: tuple[Finding, ...]
    start: float  # when the first log begins, by its clock [s]


def find_delay(
    slave: Log,
    master: MasterTable | Log,
    *,
    C_ms: FloatArray | None = None,
    bracket: tuple[float, float] | None = BRACKET,
    names: tuple[str, str] = ("The slave", "the master"),
) -> FoundDelay:
    """Find the offset of two logs: what the master stamps t was true at t - delay for the slave.

    `slave`: its gyros; `master`: messages, or a log of gyros on the same body [SI]; `C_ms` (3, 3)
    or None: how the slave is mounted on the master, to within some 10 deg, where that is known [1];
    `bracket` or None: where the offset lies, else as far as the logs overlap [s]; `names`: what
    texts call the two. Raises ``delay.apart``: too little in common; ``delay.no_gyro``.
    """
    increments = _increments(slave, names[0])
    messages = isinstance(master, MasterTable)
    other = _of_table(master) if isinstance(master, MasterTable) else _of_log(master, names[1])
    found = delay_of(increments, other.time, other.C_nb, w_in_n=other.w_in_n, C_ms=C_ms,
                     bracket=bracket)  # fmt: skip
    if found is None:
        where = "of any size" if bracket is None else "from {} s to {} s".format(*bracket)
        first, last, start, end = (plain(float(t), 9) for t in (
            slave.time[0], slave.time[-1], other.time[0], other.time[-1]))  # fmt: skip
        raise error("delay.apart", slave=names[0], master=names[1], first=first, last=last,
                    start=start, end=end, bracket=where, least=FEWEST)  # fmt: skip
    elsewhere = None
    if found.edge and bracket is not None:
        elsewhere = delay_of(increments, other.time, other.C_nb, w_in_n=other.w_in_n, C_ms=C_ms,
                             bracket=None)  # fmt: skip
    told = list(increments.findings)
    other_way = _reversed(increments, other, found, C_ms, messages)
    checked = delay_checks.checked(found, C_ms=C_ms, messages=messages, elsewhere=elsewhere)
    # What is reversed looks like another mounting, and like turning of another size.
    told += [*other_way, *(f for f in checked if not other_way or f.code not in EXPLAINED)]
    if messages and other.w_in_n is None:
        told.append(finding("delay.earth"))
    transport = None
    if isinstance(master, MasterTable) and master.arrival is not None:
        held = master.time - found.delay - found.drift * (master.time - found.middle)
        transport = master.arrival - held
    # The log of a slave beside its master holds the findings of both.
    findings = tuple(dict.fromkeys((*slave.findings, *master.findings, *told)))
    begun = float(slave.time[0])
    return FoundDelay(found, messages, transport, _verdict(found, findings), findings, begun)


def _increments(log: Log, name: str) -> Increments:
    if log.gyro is None:
        raise error("delay.no_gyro", file=name)
    if log.accel is None:
        log = replace(log, accel=np.zeros_like(log.gyro))
    return increments_of(log, gaps="bridge")


def _of_table(table: MasterTable) -> Epochs:
    H, P, R = table.angles.T
    rate = None
    if table.latitude is not None:
        height = 0.0 if table.height is None else table.height
        rate = earth_rate_n(table.latitude) + transport_rate(
            table.latitude, height, table.velocity_n
        )
    others = {
        "heading": matrix_of(-H, P, R), "pitch": matrix_of(H, -P, R), "roll": matrix_of(H, P, -R)
    }  # fmt: skip
    return Epochs(table.time, table.C_nb, others, rate)


def _of_log(log: Log, name: str) -> Epochs:
    """Return the attitude of a second log relative to its start."""
    x = _increments(log, name)
    step = max(1, len(x) // MOST)
    rows = np.arange(0, len(x), step)
    C = SlaveAttitude(x).history[rows]
    others = {
        axis: SlaveAttitude(replace(x, dtheta_b=x.dtheta_b * sign)).history[rows]
        for axis, sign in zip("xyz", 1.0 - 2.0 * np.eye(3), strict=True)
    }
    # The turn from one epoch to the next is unknown where the log has a gap between.
    gap = gaps(np.diff(x.time))
    broken = np.add.reduceat(gap, rows[:-1]) > 0 if len(rows) > 1 else np.zeros(0, bool)
    C[1:][broken] = np.nan
    return Epochs(x.time[rows], C, others)


def _reversed(
    increments: Increments, other: Epochs, found: Delay, C_ms: FloatArray | None, messages: bool
) -> list[Finding]:
    """Tell where the two turn alike once the sense of one angle or axis is reversed.

    Where nobody knows the mounting one reversed angle is as good as another.
    """
    if found.likeness > ALIKE and (C_ms is None or _turned(found, C_ms) < ASTRAY):
        return []
    best, name = found, ""
    for each, C in other.reversed_.items():
        mirrored = delay_of(increments, other.time, C, C_ms=C_ms, bracket=found.bracket)
        near = mirrored is not None and (C_ms is None or _turned(mirrored, C_ms) < ASTRAY)
        if mirrored is not None and near and mirrored.likeness > best.likeness - 1e-3:
            best, name = mirrored, name or each
            name = each if C_ms is not None else name
    same = C_ms is not None and found.likeness > ALIKE
    if not name or not (same or 1 - best.likeness < (1 - found.likeness) / CLEARLY):
        return _mirrored(increments, other, found, C_ms) if messages else []
    return [finding("delay.sense" if messages else "delay.mirror", what=name,
                    reversed=delay_checks.percent(best.likeness),
                    part=delay_checks.percent(found.likeness))]  # fmt: skip


def _mirrored(
    increments: Increments, other: Epochs, found: Delay, C_ms: FloatArray | None
) -> list[Finding]:
    """Tell where the slave's gyros are a mirror image, which no mounting makes."""
    mirror = replace(increments, dtheta_b=-increments.dtheta_b)
    best = delay_of(mirror, other.time, other.C_nb, w_in_n=other.w_in_n, bracket=found.bracket)
    if best is None or 1 - best.likeness > (1 - found.likeness) / CLEARLY:
        return []
    C = -best.C_ms if C_ms is None else -C_ms.T @ best.C_ms
    return [finding("transfer.mirror", axes=", ".join(columns(C.T)))]


def _turned(found: Delay, C_ms: FloatArray) -> float:
    return float(np.linalg.norm(rotation_vector(C_ms.T @ found.C_ms)))


def _verdict(found: Delay, findings: tuple[Finding, ...]) -> Verdict:
    reasons = tuple(f.message for f in findings if f.severity == "warning")
    if not found.seen or found.edge:
        return Verdict(Level.UNUSABLE, reasons)
    return Verdict(Level.DOUBTFUL if reasons else Level.PASS, reasons)
