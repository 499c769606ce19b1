"""What of a slave's log and of its master's table can be used, and is at the same time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from foucault.diagnose.spikes import KNOCKS, without_spikes
from foucault.errors import Finding, error, finding
from foucault.models.earth import SEMI_MAJOR_AXIS, Site
from foucault.models.master import MasterTable
from foucault.navigate.increments import Increments, increments_of
from foucault.procedures.transfer_alignment.log import SlaveLog
from foucault.procedures.transfer_alignment.settings import Settings
from foucault.units import plain, span

LEAST = 20
"""Messages that it takes at least [1]."""

BEYOND = 0.3
"""A delay is looked for so far outside its bracket too, to be told [s]."""

ELSEWHERE = np.radians(0.1)
"""A master whose latitude differs by so much from that of the site is not there [rad]."""

NORMAL = "normal gravity"
"""`Site.gravity_source` where gravity is that of the place."""

SPARE = 1.0
"""The slave's log is used from so much before the first message to so much after the last [s]."""

LONGEST_GAP = 0.25
"""A longer gap of the slave's log is not bridged: nothing says what it did meanwhile [s]."""


def heard(table: MasterTable, settings: Settings) -> tuple[Settings, list[Finding]]:
    """Return the settings for what a master says: some say no vertical velocity, and write zero.

    `table`: messages of the master [SI].
    """
    used = settings.matched.vertical and settings.matching != "attitude"
    if not used or table.velocity_n[:, 2].any():
        return settings, []
    return settings.model_copy(update={"vertical": False}), [finding("transfer.no_vertical")]


def usable(log: SlaveLog) -> SlaveLog:
    """Return the log without spikes, each message once; refuse it backwards or not finite.

    `log`: readings of the slave beside what its master said [SI].

    Logs read from files are whole already.
    """
    columns = [x for x in (log.gyro, log.accel) if x is not None]
    lost = ~np.isfinite(np.column_stack([log.time, *columns])).all(axis=1)
    if lost.any():
        raise error("transfer.not_finite", count=int(lost.sum()),
                    time=stamp(float(log.time[np.argmax(lost)])))  # fmt: skip
    for triad in ("gyro", "accel"):
        column = getattr(log, triad)
        if column is not None and len(column) and not np.ptp(column, axis=0).any():
            raise error("transfer.dead", triad=triad)
    back = np.flatnonzero(np.diff(log.time) <= 0)
    if len(back):
        raise error("transfer.backwards", count=len(back),
                    time=stamp(float(log.time[back[0] + 1])))  # fmt: skip
    said = log.messages.cleaned("error")
    log = without_spikes(log, most=KNOCKS)
    known = {f.code for f in log.findings}
    told = [f for f in said.findings if f.code not in known]
    return replace(log, master=said, findings=(*log.findings, *told))


def stamp(time: float) -> str:
    """Write `time`, shape () [s], to the millisecond, whether it counts from switch-on or 1970."""
    return plain(round(time, 3), 13)


def placed(table: MasterTable, site: Site) -> MasterTable:
    """Return the table with positions: those of a master that has none begin at the site.

    `table`: messages [SI].
    """
    if table.has_place:
        return table if table.height is not None else table.from_place(0.0, site.height)
    if site.latitude is None:
        raise error("transfer.place")
    return table.from_place(site.latitude, site.height)


def there(site: Site, table: MasterTable) -> tuple[Site, list[Finding]]:
    """Return the site where the run begins: a master that says its position knows it better.

    `table`: messages [SI].
    """
    if table.latitude is None or table.longitude is None:
        return site, []
    latitude = float(table.latitude[0])
    height = site.height if table.height is None else float(table.height[0])
    if site.latitude is None:
        return replace(site, latitude=latitude, height=height), []
    off = abs(latitude - site.latitude)
    if off < ELSEWHERE:
        return site, []
    moved = replace(site, latitude=latitude)
    if site.gravity_source == NORMAL:
        moved = replace(Site.at(latitude, height), gravity_sd=site.gravity_sd)
    told = finding("transfer.site", site=f"{np.degrees(site.latitude):.4f}",
                   master=f"{np.degrees(latitude):.4f}",
                   away=f"{off * SEMI_MAJOR_AXIS / 1e3:.0f} km")  # fmt: skip
    return moved, [told]


def even(table: MasterTable) -> MasterTable:
    """Return the table with times of arrival that do not jitter.

    The master's own stamps are even: the straight line of arrival over stamp is one clock against
    the other, and the mean of what the messages are late, which is part of the delay.

    `table`: messages [SI].
    """
    if table.arrival is None:
        return table
    age = table.time - table.time[0]
    slope, offset = np.polyfit(age, table.arrival, 1)
    return replace(table, arrival=offset + slope * age)


def common(
    log: SlaveLog, table: MasterTable, settings: Settings
) -> tuple[float, MasterTable, Increments]:
    """Return when the slave is handed over, the messages until then, and the slave beside them.

    `log`: readings of the slave [SI]; `table`: messages, with positions [SI].
    """
    time = table.messages.time
    first, last = float(log.time[0]), float(log.time[-1])
    inside = (time > first) & (time <= last)
    end = settings.hand_over
    if end is not None and not (np.sum(inside) and time[inside][0] < end <= last):
        begin = float(time[inside][0]) if inside.any() else np.nan
        raise error("transfer.hand_over", given=stamp(end), begin=stamp(begin),
                    last=stamp(last))  # fmt: skip
    if end is not None:
        inside &= time <= end
    if np.sum(inside) < LEAST:
        raise error("transfer.overlap", first=stamp(first), last=stamp(last),
                    begin=stamp(float(time[0])), end=stamp(float(time[-1])),
                    used=int(np.sum(inside)), least=LEAST)  # fmt: skip
    used = table[inside]
    end = float(time[inside][-1]) if end is None else end
    near = SPARE + settings.longest_delay + BEYOND
    rows = np.searchsorted(log.time, [float(time[inside][0]) - near, end + SPARE])
    some = log[slice(int(rows[0]), int(rows[1]))]
    step, allowed = np.diff(some.time), max(LONGEST_GAP, 2.0 * some.interval)
    if step.max() > allowed:
        at = float(some.time[np.argmax(step)])
        raise error("transfer.gap", count=int(np.sum(step > allowed)), time=stamp(at),
                    longest=span(float(step.max())), allowed=span(allowed))  # fmt: skip
    return end, used, increments_of(some, gaps="bridge")
