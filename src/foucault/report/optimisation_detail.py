"""What the report of a search says of the plan itself, of its use, and of how the search went."""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from foucault import units
from foucault.diagnose.foresight import Limit, said
from foucault.report import figures_plan
from foucault.report.page import Block, Code, Column, Items, Section, Table, Text
from foucault.report.uncertainty import shown

if TYPE_CHECKING:
    from foucault.campaign.found import Found

NEAR = 1.02
"""A restart whose cost, as a ratio, is within this of the best one's ended as well [1]."""

SETTLED = 1.01
"""Where the later half of the restarts gained less, more of them promise little [1]."""

PLAN = "campaign.toml"


def plan(found: Found) -> Section:
    """Both plans: what they need of the rig, how they move, and their steps."""
    lead = f"Allowed: {found.allowed}."
    blocks: list[Block] = [_demands(found)]
    if found.motion and found.reference_motion:
        both = (*found.motion, *found.reference_motion)
        fastest = max(abs(v) for _, _, rate in both for v in rate)
        longest = max(end for _, end, _ in both)
        blocks += [
            figures_plan.motion(found.reference, found.reference_motion, fastest, longest),
            figures_plan.motion("found", found.motion, fastest, longest),
            Text("Rates about the axes of the cluster, relative to the ground, both on one scale."),
        ]
    blocks.append(_steps(found))
    return Section("The plan, and what it needs of the rig", lead, blocks)


def _demands(found: Found) -> Table:
    columns = [
        Column(""),
        Column(found.reference, "number"),
        Column("found", "number"),
        Column("allowed", "number"),
    ]
    rows = [
        ["duration", units.span(found.reference_duration), units.span(found.duration), ""],
        ["steps", str(len(found.reference_steps) - 1), str(len(found.steps) - 1), ""],
    ]
    if found.motion and found.reference_motion:
        pairs = (found.reference_motion, found.motion)
        shortest = [units.span(min(end - start for start, end, _ in m)) for m in pairs]
        rows.append(["shortest step", *shortest, ""])
        for k, name in enumerate("xyz"):
            turned = [sum(abs(rate[k]) * (end - start) for start, end, rate in m) for m in pairs]
            rows.append([f"turned about {name} in all", *(_said(v, "angle") for v in turned), ""])
    rows += [
        [n.name, _needed(b), _needed(n), _limit(n)]
        for b, n in zip(found.reference_needs, found.needs, strict=True)
    ]
    return Table(columns, rows)


def _needed(need: Limit) -> str:
    return _signed(need.said_needed) + ("" if need.kept else ", BROKEN")


def _limit(need: Limit) -> str:
    return "not said" if need.allowed is None else _signed(need.said_allowed)


def _said(value: float, kind: str) -> str:
    return _signed(said(value, kind))


def _signed(words: str) -> str:
    return shown(words).replace(" °", "°")


def _steps(found: Found) -> Table:
    """Both plans as one table, steps counted where the plans do not count them themselves."""
    headings = [shown(re.sub(r"\((.*)\)", r"[\1]", text)) for text in found.steps[0]]
    counts = [row[0] for row in found.steps[1:]] != [str(k) for k in range(1, len(found.steps))]
    if counts:
        headings.insert(0, "step")
    rows: list[list[str]] = []
    for name, steps in (("found", found.steps), (found.reference, found.reference_steps)):
        rows.append([name])
        for k, row in enumerate(steps[1:], 1):
            cells = [cell.replace("-", "−") for cell in row]
            rows.append([str(k), *cells] if counts else cells)
    columns = [Column(text, "number" if k else "short") for k, text in enumerate(headings)]
    return Table(columns, rows)


def use(folder: Path) -> Section:
    """Commands that go on from the plan in `folder`."""
    plan = shlex.quote(str(folder / PLAN))
    lead = (
        f"`{PLAN}` in the folder of the search is the campaign with this plan; its other settings "
        "are those of the campaign that was given."
    )
    trial, study, run = (shlex.quote(str(folder / n)) for n in ("session", "study", "run"))
    lines = (
        "# what it will show, and what a little more time would buy\n"
        f"foucault preflight {plan}\n"
        "# a session as it would be, with its truth\n"
        f"foucault simulate {plan} -o {trial}\n"
        "# are errors as small as they are said to be? many simulated instruments\n"
        f"foucault montecarlo {plan} -n 100 -o {study}\n"
        "# after the session, with its log where the campaign says\n"
        f"foucault calibrate {plan} -o {run}"
    )
    return Section("How to use it", lead, [Code(lines)])


def search(found: Found, folder: Path) -> Section | None:
    """How the restarts went, and how far that can be trusted."""
    done = [r for r in found.restarts if math.isfinite(r["cost"])]
    if not done:
        return None
    lead = (
        "Each restart begins from a random plan, or goes on from the best of earlier ones, and "
        "takes many small changes. The cost as a ratio is the weighted geometric mean by the quick "
        "bound that the search uses, and what the procedure adds for what it does not want."
    )
    figures: list[Block] = [figures_plan.courses(done)]
    if len(done) > 1:
        figures.append(figures_plan.endings(done))
    return Section("How sure the search is", lead, [*figures, Items(_sure(found, done, folder))])


def _sure(found: Found, done: Sequence[Mapping[str, Any]], folder: Path) -> list[tuple[str, str]]:
    costs = np.array([r["cost"] for r in done])
    fresh = np.array([not r["continued"] for r in done])
    best = float(costs.min())
    near = int(np.sum(costs[fresh] <= best + math.log(NEAR)))
    out = [
        (
            "good" if near > 1 else "plain",
            f"{near} of {counted(int(fresh.sum()), 'restart')} from random plans ended within "
            f"{100 * (NEAR - 1):.0f} % of the best ({math.exp(best):.4f}).",
        )
    ]
    if len(done) > 1:
        half = len(done) // 2
        gain = math.exp(float(costs[:half].min()) - best)
        words = (
            f"The first {half} restarts had come to {math.exp(costs[:half].min()):.4f}; the other "
            f"{len(done) - half} gained {100 * (1 - 1 / gain):.1f} % on that."
        )
        out.append(("good" if gain < SETTLED else "warning", words))
    lost = len(found.restarts) - len(done)
    if lost:
        out.append(("warning", f"{counted(lost, 'restart')} met no plan that is allowed."))
    more = 2 * len(found.restarts)
    where = shlex.quote(str(folder))
    out.append(
        (
            "plain",
            "That no better plan exists is not shown. The same command with `--restarts "
            f"{more} -o {where}` goes on from here.",
        )
    )
    return out


def counted(n: int, what: str) -> str:
    """Write a number of things, n, shape () [1]."""
    return f"{n} {what}" if n == 1 else f"{n} {what}s"
