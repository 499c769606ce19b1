"""Monte Carlo studies of a campaign: simulate and calibrate many instruments, keep every trial.

A study folder holds study.json (what was asked), parts/*.parquet (see `Parts`) and, at the end,
trials.parquet with all trials in order. A study that was killed is resumed by asking for it
again: finished parts are not computed twice, and the result is the same to the byte as that of an
undisturbed study, whatever the number and the kind of workers.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault import monte_carlo, procedures
from foucault.arrays import FloatArray, of_arrow
from foucault.campaign import earlier
from foucault.campaign.holding import in_words
from foucault.campaign.reading import Campaign
from foucault.campaign.running import simulate
from foucault.campaign.writing import resolved
from foucault.diagnose.study import Study, nees
from foucault.errors import FoucaultError, error
from foucault.files import atomic, make_folder, write_text
from foucault.result import Result
from foucault.run_folder import KINDS, about_of, parquet_writer

# -- A folder of many trials that can be killed at any time and continued ------------------------
# It holds a JSON file that says what was asked, parts/*.parquet (trials as they were finished, each
# part written whole or not at all) and whatever its owner makes of all trials in the end. Asking
# for the same again computes what is missing; asking for something else is refused.

Progress = Callable[[int, int], None]
Columns = dict[str, npt.NDArray[Any]]

FOLDER = "parts"


def silent(done: int, total: int) -> None:
    """Tell nobody of trials `done` and wanted in `total` [1]."""


@dataclass(frozen=True)
class Parts:
    """Trials of one folder."""

    folder: Path
    size: int  # trials in one part: what a kill can cost beside those that are being computed [1]

    def of(self, n: int) -> tuple[range, ...]:
        """Return the numbers of the trials in each part, `n` trials in all [1]."""
        return tuple(range(a, min(a + self.size, n)) for a in range(0, n, self.size))

    def missing(self, n: int) -> tuple[range, ...]:
        """Return the parts that are still to be computed, of `n` trials [1]."""
        there = {path.name for path in (self.folder / FOLDER).iterdir() if _whole(path)}
        return tuple(part for part in self.of(n) if _name(part) not in there)

    @property
    def begun(self) -> int:
        """Number of the last trial that is there, and one [1]."""
        numbers = [
            int(path.stem.split("-")[1]) for path in (self.folder / FOLDER).glob("*-*.parquet")
        ]
        return max(numbers, default=-1) + 1

    def write(self, part: range, rows: Sequence[Mapping[str, Any]]) -> None:
        """Write the rows of one part, whole or not at all."""
        write_table(self.folder / FOLDER / _name(part), rows)

    def merge(self, n: int) -> Columns:
        """Return the columns of the trials that are finished, of `n` [1], in order."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        missing = set(self.missing(n))
        there = [part for part in self.of(n) if part not in missing]
        if not there:
            return {}
        tables = [pq.read_table(self.folder / FOLDER / _name(part)) for part in there]
        whole = pa.concat_tables(tables)
        return {name: of_arrow(whole[name]) for name in whole.column_names}

    def run(
        self,
        trial: monte_carlo.Trial,
        n: int,
        seed: int,
        map: monte_carlo.Map,
        progress: Progress = silent,
        until: Callable[[], bool] = lambda: False,
    ) -> Columns:
        """Compute the trials that are missing and return the columns of all, in order.

        `trial`: ``(index, seed sequence) -> row``; `n`: number of trials [1]; `seed`: seed of all
        [1]; `map`: where to compute; `progress`: called with the number of trials done and
        wanted; `until`: asked after every part whether to stop early, then only the columns of
        what is finished are returned.
        """
        missing = self.missing(n)
        done = n - sum(len(part) for part in missing)
        progress(done, n)
        rows = monte_carlo.run(trial, [i for part in missing for i in part], seed, map)
        try:
            for part in missing:
                table = []
                for _ in part:
                    table.append(next(rows))
                    done += 1
                    progress(done, n)
                self.write(part, table)
                if until():
                    break
        finally:  # now, not when it is collected: it may hold threads or a cluster
            rows.close()
        return self.merge(n)

    def fill(
        self,
        block: Callable[[range], Columns],
        n: int,
        map: monte_carlo.Map,
        progress: Progress = silent,
    ) -> None:
        """Compute the parts that are missing, each at once.

        `block`: numbers of the trials of a part -> their columns; `n`: number of trials [1];
        `map`: where to compute; `progress`: called with the number of trials done and wanted.
        """
        missing = self.missing(n)
        done = n - sum(len(part) for part in missing)
        progress(done, n)
        found = map(block, missing)
        try:
            for part, columns in zip(missing, found, strict=True):
                write_table(self.folder / FOLDER / _name(part), columns)
                done += len(part)
                progress(done, n)
        finally:
            getattr(found, "close", lambda: None)()

    def join(self, path: Path, n: int) -> None:
        """Write all `n` trials [1] as one table, part by part: it is never held as a whole."""
        import pyarrow.parquet as pq

        parts = [self.folder / FOLDER / _name(part) for part in self.of(n)]
        with (
            atomic(path) as temporary,
            pq.ParquetWriter(temporary, pq.read_schema(parts[0]), compression="zstd") as writer,
        ):
            for part in parts:
                writer.write_table(pq.read_table(part))


def opened(
    folder: str | Path, asked: Mapping[str, Any], kind: str, size: int, texts: Mapping[str, str]
) -> Parts:
    """Begin a folder, or make sure that it is that of the same question.

    `asked`: what the numbers in it depend on, as JSON values, each must agree with what is there.
    The version of this package is added; `kind`: of folder, a key of `run_folder.KINDS`; `size`:
    trials in one part, a folder that is there keeps its own [1]; `texts`: name -> content of other
    files to begin the folder with.
    """
    folder, known = Path(folder), KINDS[kind]
    make_folder(folder / FOLDER)
    made = {"part": size, "version": importlib.metadata.version("foucault")}
    asked = json.loads(json.dumps({"schema": known.schema, **asked, **made}))
    there = asked_of(folder, kind)
    if there is not None:
        different = [k for k, value in asked.items() if k != "part" and there.get(k) != value]
        if different:
            raise error("study.other", folder=folder, kind=kind, what=", ".join(different))
        return Parts(folder, int(there["part"]))
    if any((folder / FOLDER).iterdir()):
        raise error("study.damaged", folder=folder, kind=kind, file=known.file)
    for name, text in (*texts.items(), (known.file, json.dumps(asked, indent=1) + "\n")):
        write_text(folder / name, text)
    return Parts(folder, size)


def asked_of(folder: str | Path, kind: str) -> dict[str, Any] | None:
    """Return what was asked in a folder, None where it is not there or of another schema."""
    try:
        return about_of(folder, kind)
    except FoucaultError:
        return None


def write_table(path: Path, rows: Sequence[Mapping[str, Any]] | Mapping[str, Any]) -> None:
    """Write rows, or columns, as Parquet, whole or not at all."""
    import pyarrow as pa

    table = pa.table(dict(rows)) if isinstance(rows, Mapping) else pa.Table.from_pylist(list(rows))
    with atomic(path) as temporary, parquet_writer(table.schema, temporary) as writer:
        writer.write_table(table)


def _whole(path: Path) -> bool:
    """Whether a part can be read: a full disk or a power cut may have left it cut short."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        pq.read_metadata(path)
    except (OSError, pa.ArrowInvalid):
        return False
    return True


def _name(part: range) -> str:
    return f"{part.start:07d}-{part.stop - 1:07d}.parquet"


# -- studies -------------------------------------------------------------------------------------

TRIALS_FILE = "trials.parquet"
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
                noise=campaign.noise, prior=campaign.prior, sizes=session.sizes,
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
    truth: FloatArray | None = None,
) -> dict[str, Any]:
    n = len(names)
    columns = {key: np.full(n, np.nan) for key in ("error", "sd", "bound", "dof")}
    score = np.nan
    if result is not None and truth is not None and result.coefficients.cov is not None:
        found, cov = result.coefficients, result.coefficients.cov
        at = [found.layout.index(name) for name in names]  # others may follow from these
        columns["error"], columns["sd"] = found.values[at] - truth, found.sd[at]
        if "bound" in result.diagnostics:
            columns["bound"] = np.array(result.diagnostics["bound"])[at]
        dof = result.diagnostics.get("dof", [None] * len(found))
        columns["dof"] = np.array([np.inf if dof[k] is None else dof[k] for k in at])
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
    progress: Progress = silent,
) -> Study:
    """Run a study, or the rest of one, in a folder.

    `campaign`: what is simulated and how it is calibrated; `n`: number of trials [1]; `folder`:
    the study folder, one that was interrupted is continued; `seed`: seed of the study [1]; `map`:
    where to compute, None takes threads; `workers`: number of threads [1]; `progress`: called
    with the number of trials done and wanted. Returns errors, predicted uncertainties and NEES of
    all trials [SI].
    """
    earlier.refuse(campaign, "a Monte Carlo study")
    names = names_of(campaign)
    kept = begun(campaign, folder, seed, PART if n <= LARGE else LARGE_PART, batched=False)
    spread = map or monte_carlo.threads(workers)
    columns = kept.run(Trial(campaign), n, seed, spread, progress)
    write_table(Path(folder) / TRIALS_FILE, columns)
    return Study.of(names, columns)


def begun(
    campaign: Campaign, folder: str | Path, seed: int, size: int, *, batched: bool | str
) -> Parts:
    """Begin the folder of a study, or make sure that it is that of the same.

    `seed`: of the study [1]; `size`: trials in one part [1]; `batched`: whether means are
    drawn, "gpu" where a device solves them, whose last digits are its own.
    """
    text = resolved(campaign, campaign.folder)
    asked = {
        "procedure": campaign.procedure,
        "campaign_sha256": hashlib.sha256(text.encode()).hexdigest(),
        "seed": seed,
        "names": names_of(campaign),
        "batched": batched,
    }
    if (drawn := in_words(campaign)) is not None:
        asked["left_out"] = drawn
    return opened(folder, asked, "study", size, {"campaign.toml": text})


def load(folder: str | Path) -> tuple[Study, dict[str, Any]]:
    """Read a finished study and what was asked of it."""
    import pyarrow.parquet as pq

    asked = about(folder)
    with pq.ParquetFile(Path(folder) / TRIALS_FILE) as file:
        return Study.of(asked["names"], _Columns(file)), asked


class _Columns(Mapping[str, Any]):
    """The columns of a table, each read when it is asked for: a large study is not held twice."""

    def __init__(self, file: Any) -> None:
        self._file = file

    def __getitem__(self, name: str) -> Any:
        column = self._file.read([name])[name]
        if name not in ("status", "verdict"):
            return of_arrow(column)
        words = column.dictionary_encode().combine_chunks()
        return np.array(words.dictionary.to_pylist())[of_arrow(words.indices)]

    def __iter__(self) -> Iterator[str]:
        return iter(self._file.schema_arrow.names)

    def __len__(self) -> int:
        return len(self._file.schema_arrow.names)


def about(folder: str | Path) -> dict[str, Any]:
    """Return what was asked of a finished study, and the number of its trials."""
    import pyarrow.parquet as pq

    asked, file = asked_of(folder, "study"), Path(folder) / TRIALS_FILE
    if asked is None or not file.exists():
        raise error("study.missing", folder=folder)
    return asked | {"n": pq.read_metadata(file).num_rows}
