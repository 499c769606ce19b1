"""A folder of many trials that can be killed at any time and continued.

It holds a JSON file that says what was asked, parts/*.parquet (trials as they were finished, each
part written whole or not at all) and whatever its owner makes of all trials in the end. Asking
for the same again computes what is missing; asking for something else is refused.
"""

from __future__ import annotations

import importlib.metadata
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy.typing as npt

from foucault import monte_carlo
from foucault.errors import error
from foucault.files import atomic, parse_json, unwritable

Progress = Callable[[int, int], None]
Columns = dict[str, npt.NDArray[Any]]

FOLDER = "parts"


def silent(done: int, total: int) -> None:
    """Tell nobody.

    `done`, `total`: trials done and wanted [1].
    """


@dataclass(frozen=True)
class Parts:
    """Trials of one folder."""

    folder: Path
    size: int  # trials in one part: what a kill can cost beside those that are being computed [1]

    def of(self, n: int) -> tuple[range, ...]:
        """Return the numbers of the trials in each part.

        `n`: number of trials [1].
        """
        return tuple(range(a, min(a + self.size, n)) for a in range(0, n, self.size))

    def missing(self, n: int) -> tuple[range, ...]:
        """Return the parts that are still to be computed.

        `n`: number of trials [1].
        """
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
        """Return the columns of the trials that are finished, in order.

        `n`: number of trials [1].
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        missing = set(self.missing(n))
        there = [part for part in self.of(n) if part not in missing]
        if not there:
            return {}
        tables = [pq.read_table(self.folder / FOLDER / _name(part)) for part in there]
        whole = pa.concat_tables(tables)
        return {name: whole[name].to_numpy() for name in whole.column_names}

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


def opened(
    folder: str | Path,
    asked: Mapping[str, Any],
    *,
    file: str,
    schema: str,
    kind: str,
    size: int,
    texts: Mapping[str, str] | None = None,
) -> Parts:
    """Begin a folder, or make sure that it is that of the same question.

    `asked`: what the numbers in it depend on, as JSON values, each must agree with what is there.
    The version of this package is added; `kind`: what to call it in a message: ``study``; `size`:
    trials in one part, a folder that is there keeps its own [1]; `texts` or None: name -> content
    of other files to begin the folder with.
    """
    folder = Path(folder)
    try:
        (folder / FOLDER).mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise unwritable(folder, problem) from None
    version = importlib.metadata.version("foucault")
    asked = json.loads(json.dumps({"schema": schema, **asked, "part": size, "version": version}))
    there = asked_of(folder, file, schema)
    if there is not None:
        different = [k for k, value in asked.items() if k != "part" and there.get(k) != value]
        if different:
            raise error("study.other", folder=folder, kind=kind, what=", ".join(different))
        return Parts(folder, int(there["part"]))
    if any((folder / FOLDER).iterdir()):
        raise error("study.damaged", folder=folder, kind=kind, file=file)
    for name, text in (*(texts or {}).items(), (file, json.dumps(asked, indent=1) + "\n")):
        with atomic(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8")
    return Parts(folder, size)


def asked_of(folder: str | Path, file: str, schema: str) -> dict[str, Any] | None:
    """Return what was asked in a folder, or None where `file` is not there or of another schema."""
    try:
        asked: dict[str, Any] = parse_json((Path(folder) / file).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return asked if isinstance(asked, dict) and asked.get("schema") == schema else None


def write_table(path: Path, rows: Sequence[Mapping[str, Any]] | Mapping[str, Any]) -> None:
    """Write rows, or columns, as Parquet, whole or not at all."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table(dict(rows)) if isinstance(rows, Mapping) else pa.Table.from_pylist(list(rows))
    buffer = io.BytesIO()
    pq.write_table(table, buffer)
    with atomic(path) as temporary:
        temporary.write_bytes(buffer.getvalue())


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
