"""What is said before a session: what a planned one will show, and how to seek north."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

from foucault import units
from foucault.diagnose.foresight import Foresight
from foucault.errors import Finding, finding
from foucault.plans.north_orders import SEEN, SHORTEST, Choice, Row, StopOrder, at_time
from foucault.report import page
from foucault.report.page import Document, Heading, Items, Section, Table, columns, section
from foucault.report.uncertainty import left_out_table
from foucault.units import plain

SHOWN = 4  # Combinations and pairs that are named; all of them are in the JSON.


def preflight(found: Foresight, noticed: Iterable[Finding] = ()) -> Document:
    """Return what a planned session will show; `noticed`: in its campaign."""
    state, word = ("good", "All is seen") if found.complete else ("warning", "Not all is seen")
    broken = [limit.words for limit in found.limits if not limit.kept]
    if broken and found.rank == found.states and not found.hardly:
        word = "The rig cannot do it"
    head = Heading(f"Plan: {found.plan}, {found.duration:.0f} s", _line(found), state, word, broken)
    unseen = "preflight.no_leg" if found.legs else "preflight.unseen"
    pairs = [f"{a} and {b} ({value:+.2f})" for a, b, value in found.correlated]
    return Document.of(
        head,
        _expected(found),
        _legs(found),
        _limits(found),
        _left_out(found),
        _extras(found),
        _listed("preflight.remaining", found.remaining),
        _listed("preflight.weakest", found.weakest),
        _listed(unseen, found.unseen),
        _listed("preflight.correlated", pairs),
        page.findings((*noticed, *found.findings), "campaign"),
    )


def _line(found: Foresight) -> list[str]:
    limit = found.rate_limit
    allowed = "" if limit is None else f", of {math.degrees(limit):.4g} deg/s that the rig allows"
    out = []
    if found.fastest is not None:
        out.append(f"at most {math.degrees(found.fastest):.4g} deg/s about an axis{allowed}")
    out.append(f"Rank {found.rank} of {found.states}")
    if found.smallest is not None:
        out.append(f"smallest relative singular value {found.smallest:.2g}, the priors as units")
    return [*out, f"linearised at {found.linearised_at}"]


def _expected(found: Foresight) -> Section | None:
    rows = []
    for row in found.rows():
        numbers = (row["display_sd"], row["of_prior"])
        sd, share = ("" if value is None else plain(value, 2) for value in numbers)
        mostly = f"{row['mostly']} {100 * row['mostly_share']:.0f} %" if "mostly" in row else ""
        rows.append(
            [row["name"], sd, row["display_unit"], share, mostly][: 5 if found.budget else 4]
        )
    heads = columns(
        "coefficient: name | sd: number | unit | of the prior: number",
        "mostly from" if found.budget else "",
    )
    return section("preflight.coefficients", Table(heads, rows))


def _legs(found: Foresight) -> Section | None:
    rows = []
    for k, leg in enumerate(found.legs, 1):
        rate = ", ".join(f"{math.degrees(w):z.4f}" for w in leg.rate)
        rows.append([str(k), f"{leg.end:.0f}", rate, str(leg.rank), str(leg.alone)])
    heads = columns("leg | until (s): number | rate about x, y, z (deg/s): number",
                    "rank: number | seen alone: number")  # fmt: skip
    return section("preflight.plan", Table(heads, rows))


def _limits(found: Foresight) -> Section | None:
    rows = [
        ["good" if limit.kept else "bad", limit.name, limit.said_needed, limit.said_allowed]
        for limit in found.limits
    ]
    heads = columns(": state | limit | needed: number | allowed: number")
    return section("preflight.limits", Table(heads, rows))


def _extras(found: Foresight) -> Section | None:
    rows = [
        [
            more.what, f"{more.time:.0f}", f"{more.ratio:.3f}",
            ", ".join(f"{name} {ratio:.2f}" for name, ratio in more.best[:1]),
        ]
        for more in found.more
    ]  # fmt: skip
    heads = columns("what | longer (s): number | sd, of that without: number | largest gain")
    return section("preflight.more", Table(heads, rows))


def _left_out(found: Foresight) -> Section | None:
    if found.left_out is None:
        return None
    return section("preflight.left_out", left_out_table(found.left_out))


def _listed(key: str, words: Iterable[str]) -> Section | None:
    every = list(words)
    more = len(every) - SHOWN
    rest = [("plain", f"and {more} more (--json names all)")] if more > 0 else []
    items = [("plain", word) for word in every[:SHOWN]] + rest
    return section(key, Items(items))


# -- how to seek north -----------------------------------------------------------------------

TILTED = "10 deg"  # Tilt to show the effect of where none is given.


def north(choice: Choice, drift: float, tilt: float | None, noticed: Iterable[Finding]) -> Document:
    """Return in which order to stop, for how long, and what every order gives.

    `drift`: linear drift of the gyro to show the effect of [rad/s^2]; `tilt` or None: sd of the
    recommended order in a case that is tilted [rad].
    """
    first, *rest = advice(choice)
    if tilt is not None:
        rest.append(f"Tilted by up to {TILTED}, with the tilt measured: {_angle(tilt)}.")
    head = Heading("A plan to find north", [], "plain", first.rstrip("."), rest)
    return Document.of(
        head, _orders(choice, drift), _budget(choice), page.findings(noticed, "plan")
    )


def _orders(choice: Choice, drift: float) -> Section | None:
    task = choice.task
    heads = ["order"]
    if task.accuracy is not None:
        heads.append(f"minutes for {_angle(task.accuracy)}: number")
    if task.total is not None:
        heads.append(f"sd in {_minutes(task.total)} min: number")
    ramp = f"{units.convert(drift, 'rate ramp', 'deg/h/h'):.4g} deg/h/h"
    heads += [f"error by {ramp} of drift: number", "needs"]
    rows = [_cells(row, choice, drift) for row in choice.rows]
    return section("north_plan.orders", Table(columns(*heads), rows))


def _budget(choice: Choice) -> Section | None:
    at = choice.best.at
    if at is None:
        return None
    whole = sum(at.sources.values())
    rows = [
        [name, _angle(math.sqrt(v)), f"{v / whole:.1%}"]
        for name, v in sorted(at.sources.items(), key=lambda item: -item[1])
        if v > 1e-6 * whole
    ]
    return section("north_plan.budget", Table(columns("source | sd: number | share: number"), rows))


def tilted(choice: Choice) -> float | None:
    """Return the sd of the recommended order with a tilt, where none was given [rad]."""
    c, best = choice.task.conditions, choice.best
    if c.tilt or c.level_sd is not None or best.at is None:
        return None
    other = replace(choice.task, conditions=replace(c, tilt=units.parse(TILTED, "angle")))
    return at_time(best.order, best.time, other, drift=False).sd


def _cells(row: Row, choice: Choice, drift: float) -> list[str]:
    cells = [row.order.name]
    if choice.task.accuracy is not None:
        cells.append(_minutes(row.needed) if math.isfinite(row.needed) else _floor(row))
    if choice.task.total is not None:
        cells.append(row.why if row.at is None else _angle(row.sd))
    cells.append("" if row.at is None else _angle(row.drift_error * drift))
    return [*cells, row.order.needs]


def _floor(row: Row) -> str:
    if row.floor is None:
        return row.why
    return f"not reachable: floor {_angle(row.floor.sd)} from {row.limit}"


def advice(choice: Choice) -> list[str]:
    """Return which order to use, and why."""
    task, best = choice.task, choice.best
    how = f"Use {best.order.name}: {choice.reason}."
    what = f"{_minutes(best.time)} minutes give {_angle(best.sd)} (1 sd)"
    per = _per_stop(best, task.move)
    out = [how, f"{what}{', ' + per if per else ''}."]
    if task.accuracy is not None and not math.isfinite(best.needed):
        out.append(f"{_angle(task.accuracy)} is {_floor(best)}.")
    if choice.beyond is not None:
        better = choice.beyond
        gain = f"{_angle(better.sd)} in {_minutes(better.time)} minutes"
        out.append(f"With {better.order.needs}, {better.order.name} gives {gain}.")
    if choice.repeats is not None:
        times, sd = choice.repeats
        out.append(
            f"Gone through {times} times in the same time (--cycles {times}) it gives "
            f"{_angle(sd)}: slow noise of the gyro does less to shorter stops."
        )
    return out


def _per_stop(row: Row, move: float) -> str:
    if not isinstance(row.order, StopOrder):
        return ""
    lengths = row.order.stops(row.time, move)
    return f"{_range(float(lengths.min()), float(lengths.max()))} per stop"


def _range(least: float, most: float) -> str:
    return f"{least:.0f} s" if most - least < 0.5 else f"{least:.0f} to {most:.0f} s"


def noticed(choice: Choice) -> list[Finding]:
    """Return what is doubtful of a plan."""
    task, best = choice.task, choice.best
    out = []
    minutes = _minutes(best.time)
    if choice.signal < SEEN:
        factor = SEEN / choice.signal
        out.append(finding(
            "north_plan.gyro_noisy", minutes=minutes, ratio=f"{1 / choice.signal:.2g}",
            factor=f"{factor:.2g}", longer=f"{factor**2:.2g}",
        ))  # fmt: skip
    if task.accuracy is not None and task.total is not None and best.sd > task.accuracy:
        cure = f"The accuracy is {_floor(best)}."
        if math.isfinite(best.needed):
            longer = replace(best, time=max(best.needed, best.order.shortest(task.move, SHORTEST)))
            use = _per_stop(longer, task.move).replace(" per", " for each")
            cure = f"Use at least {use or 'that long'}: {_minutes(longer.time)} minutes in all."
        out.append(finding(
            "north_plan.dwell_short", minutes=minutes, stop=_per_stop(best, task.move) or "turning",
            sd=_angle(best.sd), accuracy=_angle(task.accuracy), cure=cure,
        ))  # fmt: skip
    return out


def _angle(value: float) -> str:
    """Write an angle in degrees."""
    degrees = math.degrees(value)
    if not degrees < 90.0:
        return "more than 90 deg"
    return "0 deg" if degrees < 1e-9 else f"{units.plain(degrees, 3)} deg"


def _minutes(seconds: float) -> str:
    return f"{math.ceil(seconds / 6 - 1e-6) / 10:g}"  # upwards, in tenths
