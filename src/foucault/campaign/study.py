"""Monte Carlo studies of a campaign: simulate and calibrate many instruments, keep every trial.

A study folder holds study.json (what was asked), parts/*.parquet (trials as they were finished,
each written whole or not at all) and, at the end, trials.parquet with all trials in order. A
study that was killed is resumed by asking for it again: finished parts are not computed twice,
and the result is the same to the byte as that of an undisturbed study, whatever the number of
workers.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import io
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault import monte_carlo, procedures
from foucault.campaign.reading import Campaign
from foucault.campaign.running import simulate
from foucault.campaign.writing import resolved
from foucault.diagnose.consistency import nees
from foucault.diagnose.study import Study
from foucault.errors import FoucaultError, error
from foucault.files import atomic, unwritable
from foucault.result import Result

Progress = Callable[[int, int], None]

SCHEMA = "foucault.study/1"
STUDY_FILE, TRIALS_FILE, PARTS = "study.json", "trials.parquet", "parts"
PART = 20
"""Trials in one part: what a kill can cost at most, per worker [1]."""


def _silent(done: int, total: int) -> None:
    """Tell nobody."""


def names_of(campaign: Campaign) -> tuple[str, ...]:
    """Return the coefficients that the procedure of a campaign estimates."""
    module = procedures.load(campaign.procedure)
    if hasattr(module, "names_in"):  # they depend on what is done in the session
        return tuple(module.names_in(campaign.settings, campaign.session))
    return tuple(module.names_of(campaign.settings))


def trial(campaign: Campaign) -> monte_carlo.Trial:
    """Return the trial of a campaign: draw an instrument, simulate it, calibrate, compare.

    Parameters
    ----------
    campaign : Campaign
        What is simulated and how it is calibrated.
    """
    module, names = procedures.load(campaign.procedure), names_of(campaign)
    calibrate = getattr(module, "trial", module.calibrate)  # some do less where none looks at it

    def one(index: int, seeds: np.random.SeedSequence) -> dict[str, Any]:
        seed = int(seeds.generate_state(1)[0])
        session = simulate(campaign, seed)
        row: dict[str, Any] = {"trial": index, "seed": seed}
        try:
            result = calibrate(
                session.simulation.log, site=campaign.site, settings=campaign.settings,
                noise=campaign.noise, prior=campaign.prior,
            )  # fmt: skip
        except FoucaultError as problem:
            return row | _row(names, problem.code)
        truth = np.array([session.truth.value(name) for name in names])
        return row | _row(names, str(result.status), result, truth)

    return one


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
        error_ = result.coefficients.values - truth
        columns["error"], columns["sd"] = error_, result.coefficients.sd
        columns["bound"] = np.array(result.diagnostics.get("bound", np.full(n, np.nan)))
        score = float(nees(error_[None], result.coefficients.cov)[0])
    verdict = str(result.verdict.level) if result is not None else "none"
    row: dict[str, Any] = {"status": status, "verdict": verdict, "nees": score}
    for key, values in columns.items():
        row |= {f"{key}.{name}": float(v) for name, v in zip(names, values, strict=True)}
    return row


def run(
    campaign: Campaign,
    n: int,
    folder: str | Path,
    *,
    seed: int = 0,
    map: monte_carlo.Map | None = None,
    workers: int = 2,
    progress: Progress = _silent,
) -> Study:
    """Run a study, or the rest of one, in a folder.

    Parameters
    ----------
    campaign : Campaign
        What is simulated and how it is calibrated.
    n : int, shape ()
        Number of trials [1].
    folder : str or Path
        The study folder; one that was interrupted is continued.
    seed : int, shape ()
        Seed of the study [1].
    map : callable or None
        Where to compute; None takes threads.
    workers : int, shape ()
        Number of threads [1].
    progress : callable
        Called with the number of trials done and wanted.

    Returns
    -------
    Study
        Errors, predicted uncertainties and NEES of all trials [SI].
    """
    folder = Path(folder)
    _open(folder, campaign, seed)
    names, spread = names_of(campaign), map or monte_carlo.threads(workers)
    parts = [range(a, min(a + PART, n)) for a in range(0, n, PART)]
    missing = [part for part in parts if not _file(folder, part).exists()]
    done = n - sum(len(part) for part in missing)
    progress(done, n)
    wanted = [i for part in missing for i in part]
    rows = monte_carlo.run(trial(campaign), wanted, seed, spread)
    for part in missing:
        table = []
        for _ in part:
            table.append(next(rows))
            done += 1
            progress(done, n)
        _write(_file(folder, part), table)
    columns = _merge(folder, parts)
    _write(folder / TRIALS_FILE, columns)
    return Study.of(names, columns)


def load(folder: str | Path) -> tuple[Study, dict[str, Any]]:
    """Read a finished study and what was asked of it.

    Parameters
    ----------
    folder : str or Path
        The study folder.
    """
    import pyarrow.parquet as pq

    folder = Path(folder)
    asked = _asked(folder)
    if asked is None or not (folder / TRIALS_FILE).exists():
        raise error("study.missing", folder=folder)
    table = pq.read_table(folder / TRIALS_FILE)
    columns = {name: table[name].to_numpy() for name in table.column_names}
    return Study.of(asked["names"], columns), asked


def _asked(folder: Path) -> dict[str, Any] | None:
    try:
        asked: dict[str, Any] = json.loads((folder / STUDY_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return asked if asked.get("schema") == SCHEMA else None


def _open(folder: Path, campaign: Campaign, seed: int) -> None:
    """Begin a study folder, or make sure that it is this study's."""
    try:
        (folder / PARTS).mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise unwritable(folder, problem) from None
    text = resolved(campaign, campaign.folder)
    asked = {
        "schema": SCHEMA,
        "procedure": campaign.procedure,
        "campaign_sha256": hashlib.sha256(text.encode()).hexdigest(),
        "seed": seed,
        "part": PART,
        "names": list(names_of(campaign)),
        "version": importlib.metadata.version("foucault"),
    }
    there = _asked(folder)
    if there is not None:
        different = [key for key, value in asked.items() if there.get(key) != value]
        if different:
            raise error("study.other", folder=folder, what=", ".join(different))
        return
    if any((folder / PARTS).iterdir()):
        raise error("study.other", folder=folder, what="study.json missing")
    with atomic(folder / "campaign.toml") as temporary:
        temporary.write_text(text, encoding="utf-8")
    with atomic(folder / STUDY_FILE) as temporary:
        temporary.write_text(json.dumps(asked, indent=1) + "\n", encoding="utf-8")


def _file(folder: Path, part: range) -> Path:
    return folder / PARTS / f"{part.start:07d}-{part.stop - 1:07d}.parquet"


def _write(path: Path, rows: Sequence[Mapping[str, Any]] | Mapping[str, Any]) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table(dict(rows)) if isinstance(rows, Mapping) else pa.Table.from_pylist(list(rows))
    buffer = io.BytesIO()
    pq.write_table(table, buffer)
    with atomic(path) as temporary:
        temporary.write_bytes(buffer.getvalue())


def _merge(folder: Path, parts: Sequence[range]) -> dict[str, npt.NDArray[Any]]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.concat_tables([pq.read_table(_file(folder, part)) for part in parts])
    return {name: table[name].to_numpy() for name in table.column_names}
