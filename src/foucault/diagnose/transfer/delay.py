"""What the turning of two instruments says of the offset found in it: is it seen, is it right?"""

from __future__ import annotations

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import Finding, finding
from foucault.estimate.delay.fit import SEEN, UNLIKE, Delay
from foucault.models.rotation import log as rotation_vector
from foucault.tables import AXES
from foucault.units import plain

NEAR = 1e-3
"""A delay below this is none [s]."""

SURELY = 3.0
"""So many standard deviations make a difference [1]."""

WANDERS = 1e-3
"""False-alarm rate of a delay that does not stay [1]."""

MATTERS = 1e-4
"""A change of the delay below this is not told [s]."""

ASTRAY = np.radians(10.0)
"""A mounting that is so far off is told [rad]."""

POORLY = np.radians(1.0)
"""A mounting that is known no better is told [rad]."""

OTHER_SIZE = 0.05
"""Turning that differs by more in size is told [1]."""

_AXES = (("right", "forward", "up"), ("left", "back", "down"))
_SWAPPED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Right, forward, up from forward, right, down."""


def checked(
    found: Delay, *, C_ms: FloatArray | None, messages: bool, elsewhere: Delay | None = None
) -> tuple[Finding, ...]:
    """Return what is doubtful about an offset.

    `C_ms` (3, 3) or None: mounting that was said [1]; `messages`: whether the second log holds
    messages of a master, which arrive late; `elsewhere` or None: a better one outside of the
    bracket.
    """
    told = [*_seen(found), *_place(found, elsewhere)]
    told += of_size(found)
    if not found.seen:
        return tuple(told)
    told += [*_clocks(found), *_mounting(found, C_ms)]
    if messages:
        told += _near_zero(found)
    return (*told, *of_wild(found))


def of_size(found: Delay, dt: float = np.nan) -> list[Finding]:
    """Tell where one turns more than the other: a unit.

    `dt`: usual time between the samples of the slave, where known [s].
    """
    off = abs(found.scale - 1.0)
    if found.likeness < UNLIKE or off < max(OTHER_SIZE, SURELY * found.scale_sd):
        return []
    hint = _unit(found.scale, dt)
    return [finding("delay.scale", ratio=plain(found.scale, 4), hint=hint)]


def of_wild(found: Delay) -> list[Finding]:
    """Tell of turns that no body makes."""
    if not found.wild.any():
        return []
    size = np.degrees(np.linalg.norm(found.turns.phi_m, axis=1))
    worst = int(np.argmax(np.where(found.wild, np.nan_to_num(size), 0.0)))
    return [finding("delay.wild", count=int(found.wild.sum()), size=plain(size[worst], 3),
                    time=plain(round(float(found.turns.end[worst]), 3), 13))]  # fmt: skip


def percent(part: float) -> str:
    """Write `part`, a part of one, shape () [1], in percent."""
    return f"{100 * part:.1f} %"


def _seen(found: Delay) -> list[Finding]:
    if found.likeness < UNLIKE:
        return [finding("delay.unlike", part=percent(found.likeness))]
    if found.match.converged and found.delay_sd <= SEEN:
        return []
    used, dt = found.match.used, float(np.mean(found.turns.dt[found.match.used]))
    change = np.diff(found.match.phi_s[used], axis=0) / dt
    noise = found.match.residual[used] / dt
    rate, left = (float(np.degrees(np.sqrt(np.mean(x**2)))) for x in (change, noise))
    sd = found.delay_sd if found.match.converged else np.inf
    return [finding("delay.not_seen", sd=plain(1e3 * sd, 2), rate=plain(rate, 2),
                    noise=plain(left, 2))]  # fmt: skip


def _place(found: Delay, elsewhere: Delay | None) -> list[Finding]:
    told = []
    if found.edge:
        more = ""
        apart = 0.0 if elsewhere is None else abs(elsewhere.delay - found.delay)
        if elsewhere is not None and elsewhere.likeness > found.likeness and apart > NEAR:
            more = f" Over all they overlap, {_ms(elsewhere.delay)} ms fits best."
        low, high = (plain(edge, 4) for edge in found.bracket)
        told.append(finding("delay.edge", delay=_ms(found.delay), low=low, high=high, more=more))
    if len(found.rivals) and found.seen:
        others = ", ".join(_ms(x) for x in found.rivals)
        told.append(finding("delay.rivals", others=others, delay=_ms(found.delay)))
    return told


def _near_zero(found: Delay) -> list[Finding]:
    words = {"delay": _ms(found.delay, found.delay_sd), "sd": plain(1e3 * found.delay_sd, 2)}
    if abs(found.delay) < max(NEAR, SURELY * found.delay_sd):
        return [finding("delay.validity", **words)]
    return [finding("delay.negative", **words)] if found.delay < 0 else []


def _clocks(found: Delay) -> list[Finding]:
    """Tell a delay that grows steadily, or does something else."""
    first, last = (found.delay + found.drift * (t - found.middle)
                   for t in (found.part_start[0], found.part_end[-1]))  # fmt: skip
    told = []
    if found.drift and abs(last - first) > MATTERS:
        told.append(finding(
            "delay.drift", rate=f"{1e6 * found.drift:.3g}", sd=f"{1e6 * found.drift_sd:.2g}",
            first=_ms(first, MATTERS), last=_ms(last, MATTERS), middle=plain(found.middle, 6),
        ))  # fmt: skip
    return [*told, *of_wandering(found)]


def of_wandering(found: Delay) -> list[Finding]:
    """Tell a delay that jumps or wanders, beside what a drift of the clocks makes of it."""
    from scipy.special import chdtrc

    sd = np.sqrt(np.diag(found.part_cov))
    seen = sd < SEEN  # the others say nothing
    centre = (found.part_start + found.part_end) / 2 - found.middle
    steady = found.delay + found.drift * centre
    off = (found.part_delay - steady)[seen]
    if np.sum(seen) > 2 and np.ptp(off) > MATTERS:
        size = float(off @ np.linalg.solve(found.part_cov[np.ix_(seen, seen)], off))
        if chdtrc(np.sum(seen) - 1 - bool(found.drift), size) < WANDERS:
            parts, sds = (
                ", ".join(x) for x in (map(_ms, found.part_delay), (plain(1e3 * x, 2) for x in sd))
            )
            return [finding("delay.wanders", parts=parts, sds=sds)]
    return []


def _mounting(found: Delay, C_ms: FloatArray | None) -> list[Finding]:
    size, axes = np.linalg.eigh(found.mu_cov)
    told = []
    sd = float(np.sqrt(size[-1]))
    angle = 0.0 if C_ms is None else float(np.linalg.norm(rotation_vector(C_ms.T @ found.C_ms)))
    if C_ms is not None and angle > max(ASTRAY, SURELY * sd):
        told.append(finding("delay.axes", angle=plain(np.degrees(angle), 3),
                            axes=_names(found.C_ms)))  # fmt: skip
    nearest = np.linalg.norm(rotation_vector(_SWAPPED.T @ found.C_ms))
    if C_ms is None and nearest < ASTRAY:
        told.append(finding("delay.north_east_down", axes=_names(found.C_ms)))
    if sd > POORLY:
        x, y, z = (axes[:, -1] * np.sign(axes[np.argmax(np.abs(axes[:, -1])), -1])).round(2) + 0.0
        told.append(finding("delay.mounting", axis=f"({x:.2f}, {y:.2f}, {z:.2f})",
                            sd=plain(np.degrees(sd), 2)))  # fmt: skip
    return told


def signed_axes(C: FloatArray) -> str:
    """Name along which axis each column of a rotation or reflection lies, more or less.

    `C` (3, 3): the matrix [1].
    """
    place = np.argmax(np.abs(C), axis=0)
    return ", ".join(("-" if C[k, i] < 0 else "") + AXES[k] for i, k in enumerate(place))


def _names(C_ms: FloatArray) -> str:
    """Return along which axes of the master those of the slave lie, more or less."""
    place = np.argmax(np.abs(C_ms), axis=0)
    return ", ".join(_AXES[int(C_ms[place[i], i] < 0)][place[i]] for i in range(3))


def _unit(scale: float, dt: float) -> str:
    either = "The slave's log looks as if it {held}, and was taken for {taken}{or_master}."
    reverse = ", or the master's the reverse"
    known = (
        (180 / np.pi, "were in deg", "rad", reverse),
        (np.pi / 180, "were in rad", "deg", reverse),
        (dt, "held increments of angle", "rates", ""),
        (1 / dt, "held rates", "increments of angle", ""),
    )  # fmt: skip
    for factor, held, taken, or_master in known:
        if scale > 0 and abs(np.log(scale / factor)) < OTHER_SIZE:
            return " " + either.format(held=held, taken=taken, or_master=or_master)
    return ""


def _ms(seconds: float, sd: float = MATTERS) -> str:
    """Write a delay in ms to the digits of its standard deviation."""
    digits = int(np.clip(1 - np.floor(np.log10(max(1e3 * sd, 1e-6))), 0, 4))
    return f"{1e3 * seconds:.{digits}f}"
