"""The instruments in the file of a vehicle: each calibrated, all compared, and how they lie.

The folder is that of a comparison, with a run folder for each instrument in it::

    IMU_0/ IMU_1/ ...   the runs, as `foucault calibrate` writes them
    compare.json        the comparison; "ties": how each lies in the axes of the first
    report.html
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from foucault import run_folder
from foucault.campaign import comparison
from foucault.campaign.reading import said_otherwise
from foucault.campaign.recognised import Found, found
from foucault.campaign.running import calibrate
from foucault.campaign.writing import resolved
from foucault.diagnose.mounted import tie
from foucault.errors import FoucaultError, error
from foucault.logs.raw import instruments
from foucault.procedures import Progress, silent
from foucault.result import Result
from foucault.run_folder import Record


def several(paths: Sequence[Path], said: Mapping[str, Any]) -> list[str]:
    """Return the topics of the instruments in a file, where there are several and none is said."""
    if len(paths) > 1 or said.keys() & {"topic", "file", "format", "record"}:
        return []
    names = instruments(paths[0])
    return names if len(names) > 1 else []


@dataclass
class Vehicle:
    """What was found of the instruments of a vehicle."""

    held: dict[str, Found] = field(default_factory=dict)  # what each log is, by topic
    results: dict[str, Result] = field(default_factory=dict)
    problems: dict[str, FoucaultError] = field(default_factory=dict)  # why one has no result
    record: Record | None = None  # of the comparison, where there are two results and more


def run(
    path: Path, topics: Sequence[str], folder: Path, said: Mapping[str, Any],
    site: Mapping[str, str], report: Callable[[Path], object], progress: Progress = silent,
    more: Mapping[str, Any] = MappingProxyType({}),
) -> Vehicle:  # fmt: skip
    """Calibrate each instrument of a file into a folder, and compare them.

    `topics`: the instruments; `said`, `site`: as for `recognised.found`; `report`: writes the page
    of a run folder; `more`: keys of [procedure].
    """
    started = time.monotonic()
    out = Vehicle()
    for k, topic in enumerate(topics):

        def tell(part: float, words: str, k: int = k, topic: str = topic) -> None:
            progress((k + part) / (len(topics) + 1), f"{topic}: {words}")

        try:
            held = replace(found([path], {**said, "topic": topic}, site, tell), name=topic)
            asked = said_otherwise(held.campaign, more)
            result = calibrate(asked, tell, held.log_of(asked))
        except FoucaultError as problem:
            out.problems[topic] = problem
            continue
        where = folder / folder_of(topic)
        run_folder.save(result, where, resolved(asked, where, held.head))
        report(where)
        out.held[topic], out.results[topic] = held, result
    if not out.results:
        first, why = next(iter(out.problems.items()))
        raise error("recognise.no_instrument", file=path.name, count=len(topics), first=first,
                    why=why.message) from why  # fmt: skip
    if len(out.results) > 1:
        progress(len(topics) / (len(topics) + 1), "comparing")
        compared = comparison.run([folder / folder_of(topic) for topic in out.results])
        order = [e.instrument for e in compared.entries]
        ties = [
            (0, k, tied)
            for k in range(1, len(order))
            if (tied := _tied(out, order[0], order[k])) is not None
        ]
        out.record = comparison.record(compared, time.monotonic() - started, ties)
    return out


def folder_of(topic: str) -> str:
    """Return the name of the folder of an instrument."""
    return re.sub(r"\W+", "_", topic).strip("_")


def _tied(all_: Vehicle, a: str, b: str) -> Any:
    return tie(all_.results[a], all_.held[a].log, all_.results[b], all_.held[b].log)
