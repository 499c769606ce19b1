"""Find rests and turns in the log of a systematic calibration, without being told the sequence.

Rests are found as everywhere (`stretches`). What lies between two of them is cut into single
turns where the rate falls to almost nothing: a gimbal turns about its inner and then about its
outer axis without a rest in between. A turn about one axis has an angle that is the integral of
the magnitude of the rate; its axis is that of the integral of the rate.

The attitudes of the rests relative to the first then follow from the turns, and the mean rates at
rest are ``w_k = C_k0 e_0 + b``: the Earth's rate e_0 in the first rest's axes and the bias of the
gyros, by least squares. A rest that does not fit, or that tilts while it lasts, moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.detect.stretches import SEQUENCE, Rests, find_rests, means_of, runs
from foucault.errors import Finding, error, finding
from foucault.models.rotation import exp
from foucault.models.rotation import log as rotation_vector
from foucault.tables import AXES, Log
from foucault.units import plain

PAUSE = 0.03  # Between two turns the rate falls below this part of its peak [1].
LEAST_TURN = np.radians(2.0)  # A smaller rotation between two rests is no turn [rad].

CREEP = np.radians(2.0) / 3600.0
"""A rest moves if its rate is off by more than this, and by `MANY` usual residuals [rad/s]."""

TILT = 1e-4  # A rest moves if it tilts by more than this, and by `MANY` sd of the noise [rad].
MANY = 8.0  # Times the usual [1].
ALIKE = np.radians(5.0)  # Ups nearer than this are one [rad].


@dataclass(frozen=True)
class Move:
    """One turn about one axis."""

    # first, last: its first sample and the sample after its last [1]
    first: int
    last: int
    # start, end: when it begins and ends [s]
    start: float
    end: float
    after: int  # number of the rest before it [1]
    axis_b: FloatArray  # (3,) axis, body axes, such that the turn is counter-clockwise [1]
    angle: float  # angle turned; whole turns count [rad]
    peak: float  # largest rate [rad/s]
    # magnitude of the integral of the rate over the integral of the magnitude: 1 about one fixed
    # axis [1]
    straight: float


@dataclass(frozen=True)
class FoundSequence:
    """Rests and turns of a log."""

    rests: Rests  # all rests, moving ones included
    still: BoolArray  # (n,) which of them do not move
    # accel, gyro: (n, 3) their mean readings [m/s^2], [rad/s]
    accel: FloatArray
    gyro: FloatArray
    # (n, 3, 3) attitude of each rest relative to the first: maps its body axes to those [1]
    C_0k: FloatArray
    moves: tuple[Move, ...]  # the turns in order
    # (3,) the Earth's rate in body axes of the first rest; None where the rests cannot tell [rad/s]
    earth_b: FloatArray | None = None
    earth_cov: FloatArray | None = None  # (3, 3) its covariance [(rad/s)^2]
    findings: tuple[Finding, ...] = ()

    @classmethod
    def joined(cls, parts: Sequence[tuple[int, FoundSequence]]) -> FoundSequence:
        """Return the rests and turns of recordings that began anew as those of one log.

        Attitudes, and the Earth's rate, stay those relative to the first rest of each recording.

        `parts`: first row of each recording [1], and what was found in it.
        """
        if len(parts) == 1:
            return parts[0][1]
        some = [found for _, found in parts]
        before = np.cumsum([0, *(len(found.rests) for found in some[:-1])]).tolist()
        rests = replace(
            some[0].rests,
            first=np.concatenate([row + found.rests.first for row, found in parts]),
            last=np.concatenate([row + found.rests.last for row, found in parts]),
            level=np.concatenate([found.rests.level for found in some]),
            accel_level=np.concatenate([found.rests.accel_level for found in some]),
            gyro_level=np.concatenate([found.rests.gyro_level for found in some]),
        )
        moves = tuple(
            replace(m, first=m.first + row, last=m.last + row, after=m.after + shift)
            for (row, found), shift in zip(parts, before, strict=True) for m in found.moves
        )  # fmt: skip
        return cls(
            rests,
            np.concatenate([found.still for found in some]),
            np.concatenate([found.accel for found in some]),
            np.concatenate([found.gyro for found in some]),
            np.concatenate([found.C_0k for found in some]),
            moves, some[0].earth_b, some[0].earth_cov,
            tuple(f for found in some for f in found.findings),
        )  # fmt: skip


def require_triads(log: Log) -> None:
    """Refuse a log without gyros or without accelerometers."""
    missing = [name for name in ("gyro", "accel") if getattr(log, name) is None]
    if missing:
        raise error("systematic.triads", missing=" and no ".join(missing))


def find_sequence(
    log: Log, *, shortest: float = SEQUENCE.shortest, fewest: int = 2
) -> FoundSequence:
    """Find the rests and the turns of a session.

    `log`: readings of both triads [SI]; `shortest`: shortest rest [s]; `fewest`: fewest rests
    that do [1]. Raises A triad is missing, there are fewer rests, or all turns are about the
    vertical.
    """
    require_triads(log)
    assert log.gyro is not None
    assert log.accel is not None
    rests = find_rests(log, replace(SEQUENCE, shortest=shortest))
    # What is quiet and turns steadily is a turn here, and expected.
    rests = replace(rests, findings=tuple(f for f in rests.findings if f.code == "rest.said"))
    if len(rests) < fewest:
        raise error("systematic.no_rests", given=len(rests), shortest=f"{shortest:g}")
    accel, gyro = (means_of(x, rests.spans) for x in (log.accel, log.gyro))
    if not np.linalg.norm(accel, axis=1).all():  # before anything is divided by it
        raise error("systematic.one_value", sensors=", ".join(f"accel {axis}" for axis in AXES))
    between = list(zip(rests.last[:-1].tolist(), rests.first[1:].tolist(), strict=True))
    # The bias, and roughly the Earth's rate, as the rests before and after have them.
    rate = [log.gyro[a:b] - (gyro[k] + gyro[k + 1]) / 2 for k, (a, b) in enumerate(between)]
    moves = [m for k, (a, _) in enumerate(between) for m in _turns(log, rate[k], a, k)]
    found = FoundSequence(
        rests, np.ones(len(rests), bool), accel, gyro, _chained(rate, log.interval), tuple(moves)
    )
    tilt, limit = _tilts(log, found)
    x = _rates(found, tilt <= limit)[2]
    if x is not None:  # now both are known, and the Earth turns on while the body does
        rate = [log.gyro[a:b] - x[3:] for a, b in between]
        found = replace(found, C_0k=_chained(rate, log.interval, x[:3]))
    return _judged(log, found)


def _chained(
    rate: list[FloatArray], interval: float, earth_b: FloatArray | None = None
) -> FloatArray:
    """Return the attitudes ``C_0k+1 = Exp(-e_0 T) C_0k R`` of the rests, (n, 3, 3)."""
    out = [np.eye(3)]
    for w in rate:
        C = out[-1] @ net_rotation(w * interval)
        out.append(C if earth_b is None else exp(-earth_b * (len(w) * interval)) @ C)
    return np.array(out)


def _turns(log: Log, w: FloatArray, a: int, rest: int) -> list[Move]:
    """Cut what lies between two rests into single turns."""
    rate = np.linalg.norm(w, axis=1)
    if rate.sum() * log.interval < LEAST_TURN:
        return []
    begin, end = runs(rate > PAUSE * rate.max())
    large = np.array([rate[i:j].sum() for i, j in zip(begin, end, strict=True)])
    keep = large * log.interval >= LEAST_TURN
    begin, end = begin[keep], end[keep]
    # A turn reaches to the middle of the pause before and after it.
    cuts = np.concatenate([[0], (end[:-1] + begin[1:]) // 2, [len(w)]])
    out = []
    for i, j in zip(cuts[:-1].tolist(), cuts[1:].tolist(), strict=True):
        total, path = w[i:j].sum(axis=0) * log.interval, float(rate[i:j].sum() * log.interval)
        size = float(np.linalg.norm(total))
        out.append(
            Move(
                a + i, a + j, float(log.time[a + i]), float(log.time[min(a + j, len(log) - 1)]),
                rest, total / max(size, 1e-300), size, float(rate[i:j].max()), size / path,
            )
        )  # fmt: skip
    return out


def net_rotation(dtheta_b: FloatArray) -> FloatArray:
    """Return ``Exp(d_1) Exp(d_2) ... Exp(d_n)`` of `dtheta_b` (n, 3) [rad], shape (3, 3)."""
    C = exp(dtheta_b) if len(dtheta_b) else np.eye(3)[None]
    while len(C) > 1:  # neighbours together, half as many in each round
        if len(C) % 2:
            C = np.concatenate([C, np.eye(3)[None]])
        C = C[0::2] @ C[1::2]
    return np.asarray(C[0])


def _judged(log: Log, found: FoundSequence) -> FoundSequence:
    tilt, tilt_limit = _tilts(log, found)
    moving = tilt > tilt_limit
    rate, rate_limit, x, cov = _rates(found, ~moving)
    moving |= rate > rate_limit
    notes = []
    for k in np.flatnonzero(moving).tolist():
        a, b = int(found.rests.first[k]), int(found.rests.last[k]) - 1
        what = []
        if tilt[k] > tilt_limit[k]:
            what.append(f"it tilts by {plain(np.degrees(tilt[k]) * 3600, 3)} arcsec")
        if rate[k] > rate_limit:
            what.append(f"it turns at {plain(np.degrees(rate[k]) * 3600, 3)} deg/h")
        notes.append(
            finding(
                "systematic.rest_moves", start=f"{log.time[a]:.1f}", end=f"{log.time[b]:.1f}",
                what=" and ".join(what),
            )
        )  # fmt: skip
    notes += _bumps(log, found)
    still = ~moving
    up = found.accel / np.linalg.norm(found.accel, axis=1)[:, None]
    apart = np.arccos(np.clip(up @ up[0], -1.0, 1.0)).max()
    if found.moves and apart < ALIKE:
        raise error("systematic.upright", given=len(up), angle=f"{np.degrees(apart):.2g}")
    return replace(
        found,
        still=still,
        earth_b=None if x is None else x[:3],
        earth_cov=cov,
        findings=(*found.findings, *notes),
    )


def _bumps(log: Log, found: FoundSequence) -> list[Finding]:
    """Name what interrupts a rest."""
    turned = {move.after for move in found.moves}
    out = []
    for k in range(len(found.rests) - 1):
        if k not in turned:
            net = rotation_vector(found.C_0k[k].T @ found.C_0k[k + 1])
            out.append(
                finding(
                    "systematic.bump", end=f"{log.time[found.rests.last[k] - 1]:.1f}",
                    start=f"{log.time[found.rests.first[k + 1]]:.1f}",
                    angle=f"{plain(np.degrees(np.linalg.norm(net)) * 3600, 3)} arcsec",
                )
            )  # fmt: skip
    return out


def _tilts(log: Log, found: FoundSequence) -> tuple[FloatArray, FloatArray]:
    """Return how far each rest tilts from its first to its last quarter, and the limit, (n,)."""
    assert log.accel is not None
    tilt, limit = np.zeros((2, len(found.rests)))
    for k, (a, b) in enumerate(found.rests.spans):
        quarter = max(1, (b - a) // 4)
        g = np.linalg.norm(found.accel[k])
        change = log.accel[b - quarter : b].mean(axis=0) - log.accel[a : a + quarter].mean(axis=0)
        tilt[k] = np.linalg.norm(np.cross(change, found.accel[k])) / g**2
        steps = np.diff(log.accel[a:b], axis=0)  # blind to slow motion
        noise = np.sqrt((steps**2).sum() / max(1, len(steps)) / 2 * 2 / quarter) / g
        limit[k] = max(TILT, MANY * noise)
    return tilt, limit


def _rates(
    found: FoundSequence, use: BoolArray
) -> tuple[FloatArray, float, FloatArray | None, FloatArray | None]:
    """Fit the Earth's rate and the bias.

    Returns what each rest misses by and the limit [rad/s], both rates, and the covariance of the
    first.
    """
    design = np.concatenate(
        [np.swapaxes(found.C_0k, 1, 2), np.tile(np.eye(3), (len(found.rests), 1, 1))], axis=2
    )
    use = use.copy()
    for _ in range(len(use)):
        A = design[use].reshape(-1, 6)
        if use.sum() < 4 or np.linalg.cond(A) > 1e3:
            return np.zeros(len(use)), np.inf, None, None
        x = np.linalg.lstsq(A, found.gyro[use].ravel(), rcond=None)[0]
        miss = np.linalg.norm(found.gyro - design @ x, axis=1)
        limit = max(CREEP, MANY * float(np.median(miss[use])))
        worst = int(np.argmax(np.where(use, miss, 0.0)))
        if miss[worst] <= limit:
            break
        use[worst] = False
    sd = np.sqrt((miss[use] ** 2).sum() / max(3 * int(use.sum()) - 6, 1))
    cov = sd**2 * np.linalg.inv(A.T @ A)[:3, :3]
    return miss, limit, x, cov
