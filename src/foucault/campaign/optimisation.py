"""Search for a better plan of a campaign, in a folder that can be killed and continued.

The folder holds optimise.json (what was asked), parts/*.parquet (restarts as they were finished),
and in the end restarts.parquet, found.json (the plan beside the one to beat) and campaign.toml,
which does the plan. Restarts come in rounds: those of the first begin from random plans; in every
later round half of them begin from the best plans of the rounds before. What a restart finds
depends on the seed, its number and the rounds before it, never on time or workers: asking for
more restarts in the same folder continues the search.
"""

from __future__ import annotations

import hashlib
import json
import time as clock
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import islice
from math import inf
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault import monte_carlo, procedures
from foucault.campaign import parts
from foucault.campaign.found import Found
from foucault.campaign.preflight import beforehand
from foucault.campaign.reading import Campaign, improvable
from foucault.campaign.writing import changed, resolved
from foucault.errors import error, finding
from foucault.files import atomic
from foucault.plans.optimise import HOT, Space, descend

SCHEMA = "foucault.optimise/1"
ASKED_FILE, RESTARTS_FILE = "optimise.json", "restarts.parquet"
CAMPAIGN_FILE = "campaign.toml"

ROUND = 8
"""Restarts in one round [1]."""

EVALUATIONS = 4000
"""Plans that a restart judges, where its procedure does not say how many [1]."""

FINALISTS = 8
"""So many of the best plans are judged without the approximations of the search [1]."""

AGAIN = 0.2
"""How hot a descent begins that continues a plan of an earlier round, over `HOT` [1]."""


@dataclass(frozen=True)
class Restart:
    """A trial: one restart."""

    space: Space  # plans and how good they are
    evaluations: int  # plans that it judges [1]
    starts: Mapping[int, Any]  # restart -> plan, as JSON, from which it begins; the others draw [1]

    def __call__(self, index: int, seeds: np.random.SeedSequence) -> dict[str, Any]:
        """Run restart number `index`, shape () [1]."""
        begun = self.starts.get(index)
        start = None if begun is None else self.space.from_json(begun)
        hot = HOT if start is None else AGAIN * HOT
        best = descend(self.space, np.random.default_rng(seeds), self.evaluations, start, hot)
        return {
            "restart": index,
            "continued": start is not None,
            "cost": best.cost,
            "evaluations": best.evaluations,
            "plan": json.dumps(None if best.plan is None else self.space.as_json(best.plan)),
            "trace": json.dumps(best.trace),
        }


def run(
    campaign: Campaign,
    folder: str | Path,
    *,
    restarts: int = 32,
    evaluations: int | None = None,
    time_limit: float | None = None,
    seed: int = 0,
    map: monte_carlo.Map | None = None,
    workers: int = 2,
    size: int = ROUND,
    progress: parts.Progress = parts.silent,
) -> Found:
    """Search for a better plan, or go on with a search, in a folder.

    `campaign`: the procedure, the limits of the rig and what is wanted; `folder`: where the
    search is kept, one that was interrupted is continued; `restarts`: number of restarts [1];
    `evaluations`: plans that each of them judges, None takes what suits the procedure [1];
    `time_limit` or None: after which no further restart is begun, the first always is [s];
    `seed`: seed of the search [1]; `map`: where to compute, None takes threads; `workers`: number
    of threads [1]; `size`: restarts in one round, on a cluster, a multiple of its workers [1];
    `progress`: called with the number of restarts done and wanted. Returns the best plan beside
    the one to beat. Raises ``optimise.*``: nothing to search, limits that no plan keeps,
    coefficients that no allowed plan shows.
    """
    ends = inf if time_limit is None else clock.monotonic() + time_limit
    space = space_of(campaign)
    if evaluations is None:
        evaluations = procedures.load(campaign.procedure).evaluations or EVALUATIONS
    kept = _opened(campaign, folder, evaluations, seed, size)
    spread, rows = map or monte_carlo.threads(workers), dict[str, npt.NDArray[Any]]()
    for begin in range(0, restarts, size):
        n = min(begin + size, restarts)
        trial = Restart(space, evaluations, _starts(space, rows, begin, size))
        rows = kept.run(
            trial, n, seed, spread, lambda done, _: progress(done, restarts),
            lambda: clock.monotonic() > ends,
        )  # fmt: skip
        if clock.monotonic() > ends:
            break
    rows = kept.merge(max(restarts, kept.begun))  # an earlier search may have gone further
    return _concluded(campaign, space, rows, Path(folder), seed)


def finished(folder: str | Path) -> int:
    """Return the number of restarts that a folder holds, of whatever search [1]."""
    if not (Path(folder) / parts.FOLDER).is_dir():
        return 0
    kept = parts.Parts(Path(folder), 1)
    return kept.begun - len(kept.missing(kept.begun))


def space_of(campaign: Campaign) -> Space:
    """Return the plans that a campaign allows.

    `campaign`: the procedure, the limits of the rig and what is wanted.
    """
    searched = procedures.load(campaign.procedure).space
    if searched is None:
        able = ", ".join(improvable())
        raise error("optimise.procedure", procedure=campaign.procedure, able=able)
    space: Space = searched(beforehand(campaign)[0])
    space.unseen  # noqa: B018  # refuses what cannot be before any work is done
    return space


def _opened(
    campaign: Campaign, folder: str | Path, evaluations: int, seed: int, size: int
) -> parts.Parts:
    text = resolved(campaign, campaign.folder)
    wanted = campaign.wanted.model_dump_json()
    asked = {
        "procedure": campaign.procedure,
        "campaign_sha256": hashlib.sha256((text + wanted).encode()).hexdigest(),
        "seed": seed,
        "evaluations": evaluations,
        "round": size,
    }
    return parts.opened(
        folder, asked, file=ASKED_FILE, schema=SCHEMA, kind="search", size=1,
        texts={"asked.toml": campaign.text},
    )  # fmt: skip


def _starts(
    space: Space, rows: Mapping[str, npt.NDArray[Any]], begin: int, size: int
) -> dict[int, Any]:
    """Return the plans from which half of a round goes on: the best ones, each once.

    The first restart of all goes on from the plan to beat, where that is one of the space.
    """
    if not rows:
        first = getattr(space, "begin", None)
        return {} if first is None or space.cost(first) == inf else {0: space.as_json(first)}
    again = range(begin + size // 2, begin + size)
    return dict(zip(again, _best(rows, begin), strict=False))


def _best(rows: Mapping[str, npt.NDArray[Any]], n: int) -> list[Any]:
    """Return the plans of the first n restarts, each once, best first."""
    order = np.argsort(rows["cost"][:n], kind="stable")
    plans = dict.fromkeys(rows["plan"][order].tolist())
    return [json.loads(plan) for plan in plans if plan != "null"]


def _concluded(
    campaign: Campaign, space: Space, rows: Mapping[str, npt.NDArray[Any]], folder: Path,
    seed: int,
) -> Found:  # fmt: skip
    """Compare the best plan with the one to beat; write what was found."""
    cost = getattr(space, "exact_cost", space.cost)
    plans = map(space.from_json, _best(rows, len(rows["cost"])))
    possible = ((price, plan) for plan in plans if (price := cost(plan)) < inf)
    best = min(islice(possible, FINALISTS), key=itemgetter(0), default=None)
    if best is None:
        raise error("optimise.limits", tried=int(rows["evaluations"].sum()), limits=space.limits)
    plan = best[1]
    told = [*beforehand(campaign)[1], *getattr(space, "findings", ())]
    hardly = space.hardly(plan) if hasattr(space, "hardly") else ()
    if hardly:
        told.append(finding("optimise.hardly", count=len(hardly), names=", ".join(hardly)))
    found = Found.of(campaign.procedure, space, plan, rows, seed, tuple(told))
    text = changed(
        campaign, space.changes(plan),
        f"A plan found by foucault optimise: {found.geometric_mean[0]:.3f} times the sd of "
        f"{space.reference_name}, geometric mean.",
    )  # fmt: skip
    parts.write_table(folder / RESTARTS_FILE, rows)
    with atomic(folder / CAMPAIGN_FILE) as temporary:
        temporary.write_text(text, encoding="utf-8")
    found.save(folder)
    return found
