"""Monte Carlo studies of a campaign: simulate and calibrate many instruments, keep every trial.

A study folder holds study.json (what was asked), parts/*.parquet (see `parts`) and, at the end,
trials.parquet with all trials in order. A study that was killed is resumed by asking for it
again: finished parts are not computed twice, and the result is the same to the byte as that of an
undisturbed study, whatever the number and the kind of workers.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault import monte_carlo, procedures
from foucault.campaign import earlier, parts
from foucault.campaign.reading import Campaign
from foucault.campaign.running import simulate
from foucault.campaign.writing import resolved
from foucault.diagnose.consistency import nees
from foucault.diagnose.study import Study
from foucault.errors import FoucaultError, error
from foucault.result import Result

SCHEMA = "foucault.study/1"
STUDY_FILE, TRIALS_FILE, PARTS = "study.json", "trials.parquet", parts.FOLDER
PART, LARGE, LARGE_PART = 20, 20_000, 500
"""Trials in one part; of a study larger than that, trials in one part [1]."""


def names_of(campaign: Campaign) -> tuple[str, ...]:
    """Return the coefficients that the procedure of a campaign estimates."""
    return procedures.load(campaign.procedure).names(campaign.settings, campaign.session)


@dataclass(frozen=True)
class Trial:
    """The trial of a campaign: draw an instrument, simulate it, calibrate, compare."""

    campaign: Campaign  # what is simulated and how it is calibrated

    def __call__(self, index: int, seeds: np.random.SeedSequence) -> dict[str, Any]:
        """Run trial number `index`, shape () [1]."""
        campaign, seed = self.campaign, int(seeds.generate_state(1)[0])
        procedure, names = procedures.load(campaign.procedure), names_of(campaign)
        session = simulate(campaign, seed)
        row: dict[str, Any] = {"trial": index, "seed": seed}
        try:
            result = procedure.trial(
                session.simulation.log, site=campaign.site, settings=campaign.settings,
                noise=campaign.noise, prior=campaign.prior,
            )  # fmt: skip
        except FoucaultError as problem:
            return row | _row(names, problem.code)
        truth = session.truth
        values = np.array([truth.value(name) for name in names])
        return row | _row(names, str(result.status), result, values)


def _row(
    names: Sequence[str],
    status: str,
    result: Result | None = None,
    truth: npt.NDArray[np.float64] | None = None,
) -> dict[str, Any]:
    n = len(names)
    columns = {key: np.full(n, np.nan) for key in ("error", "sd", "bound")}
    score = np.nan
    if result is not None and truth is not None and result.coefficients.cov is not None:
        found, cov = result.coefficients, result.coefficients.cov
        at = [found.layout.index(name) for name in names]  # others may follow from these
        columns["error"], columns["sd"] = found.values[at] - truth, found.sd[at]
        if "bound" in result.diagnostics:
            columns["bound"] = np.array(result.diagnostics["bound"])[at]
        score = float(nees(columns["error"][None], cov[np.ix_(at, at)])[0])
    verdict = str(result.verdict.level) if result is not None else "none"
    row: dict[str, Any] = {"status": status, "verdict": verdict, "nees": score}
    for key, values in columns.items():
        row |= zip(_keys(key, tuple(names)), values.tolist(), strict=True)
    return row


@cache
def _keys(key: str, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names of columns, the same objects each time: pickle then writes them once."""
    return tuple(f"{key}.{name}" for name in names)


def run(
    campaign: Campaign,
    n: int,
    folder: str | Path,
    *,
    seed: int = 0,
    map: monte_carlo.Map | None = None,
    workers: int = 2,
    progress: parts.Progress = parts.silent,
) -> Study:
    """Run a study, or the rest of one, in a folder.

    `campaign`: what is simulated and how it is calibrated; `n`: number of trials [1]; `folder`:
    the study folder, one that was interrupted is continued; `seed`: seed of the study [1]; `map`:
    where to compute, None takes threads; `workers`: number of threads [1]; `progress`: called
    with the number of trials done and wanted. Returns errors, predicted uncertainties and NEES of
    all trials [SI].
    """
    earlier.refuse(campaign, "a Monte Carlo study")
    folder, names = Path(folder), names_of(campaign)
    text = resolved(campaign, campaign.folder)
    asked = {
        "procedure": campaign.procedure,
        "campaign_sha256": hashlib.sha256(text.encode()).hexdigest(),
        "seed": seed,
        "names": names,
    }
    kept = parts.opened(
        folder, asked, file=STUDY_FILE, schema=SCHEMA, kind="study",
        size=PART if n <= LARGE else LARGE_PART, texts={"campaign.toml": text},
    )  # fmt: skip
    spread = map or monte_carlo.threads(workers)
    columns = kept.run(Trial(campaign), n, seed, spread, progress)
    parts.write_table(folder / TRIALS_FILE, columns)
    return Study.of(names, columns)


def load(folder: str | Path) -> tuple[Study, dict[str, Any]]:
    """Read a finished study and what was asked of it."""
    import pyarrow.parquet as pq

    folder = Path(folder)
    asked = parts.asked_of(folder, STUDY_FILE, SCHEMA)
    if asked is None or not (folder / TRIALS_FILE).exists():
        raise error("study.missing", folder=folder)
    table = pq.read_table(folder / TRIALS_FILE)
    columns = {name: table[name].to_numpy() for name in table.column_names}
    return Study.of(asked["names"], columns), asked | {"n": len(table)}
