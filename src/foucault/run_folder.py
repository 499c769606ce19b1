"""The folder that a command leaves: one document, its tables, and both whole or not at all.

Its kind is told by the document in it (`KINDS`), and what holds of one holds of all: the document
is replaced last, and knows the hashes of the tables. That of a calibration::

    campaign.toml               the campaign with every default filled in
    result.json                 the result; written last, so that its presence means complete
    tables/rests.5c1f02aa.parquet ...   one per table of the result, named in result.json
    report.html                 for people, made from the rest of the folder

Replacing the document is the one step that turns a run into what the folder holds. The name of a
table of a result carries the beginning of its hash, so a new run never overwrites a table that
the result in place still needs: interrupted anywhere, the folder holds the old result or the new
one.
"""

from __future__ import annotations

import hashlib
import io
import json
import re
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from os import PathLike
from pathlib import Path
from threading import Event, Lock
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from foucault.arrays import Made, Names, of_arrow, to_arrow
from foucault.errors import FoucaultError, error, require
from foucault.files import (
    HEAD,
    atomic,
    keep_others,
    parse_json,
    plain_json,
    read_text,
    unwritable,
)
from foucault.result import Result, TableData
from foucault.tables import declared

if TYPE_CHECKING:
    from pydantic import ValidationError

    from foucault.result_document import ResultDocument

Columns = Mapping[str, tuple[Any, str]]  # Name of a column -> its values and their SI unit.

File = bytes | Callable[[Path], None]
"""What stands in a file, or what writes it."""

RESULT_FILE = "result.json"
CAMPAIGN_FILE = "campaign.toml"
REPORT_FILE = "report.html"
TABLE_FOLDER = "tables"
SESSION_FOLDER, STATE_FILE, ENOUGH_FILE = "session", "guide.json", "enough"
"""Of a guided session: what was recorded, what it shows by now, and a file that ends it."""

RESOLVED = b"# The campaign with every default filled in"  # So begins the campaign of a run.

_TABLE_NAME = re.compile(r"\w+\.[0-9a-f]{8}\.parquet")


@dataclass(frozen=True)
class Kind:
    """A kind of folder, which is told by its document."""

    file: str  # name of the document
    schema: str  # name and version of what stands in it


KINDS = {
    "north": Kind("north.json", "foucault.north/1"),
    "navigation": Kind("navigation.json", "foucault.navigation/1"),
    "search": Kind("optimise.json", "foucault.optimise/1"),
    "comparison": Kind("compare.json", "foucault.compare/1"),
    "fleet": Kind("fleet.json", "foucault.fleet/1"),
    "study": Kind("study.json", "foucault.study/1"),
    "result": Kind(RESULT_FILE, "foucault.result/1"),
}


class Later(Mapping[str, Any]):
    """A document that is made when it is first read: tables are written meanwhile."""

    def __init__(self, make: Callable[[], Mapping[str, Any]]) -> None:
        self._make, self._lock = make, Lock()
        self._made: Mapping[str, Any] | None = None

    @property
    def whole(self) -> Mapping[str, Any]:
        """All of it; whichever thread asks first makes it, and the others wait."""
        with self._lock:
            if self._made is None:
                self._made = self._make()
            return self._made

    def __getitem__(self, key: str) -> Any:
        return self.whole[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self.whole)

    def __len__(self) -> int:
        return len(self.whole)


@dataclass(frozen=True)
class Record:
    """What a folder holds, or is to hold."""

    about: Mapping[str, Any]  # what the document says [SI]
    tables: Mapping[str, TableData]  # name of the table -> column -> values [SI]
    kind: str = ""  # a key of `KINDS`
    units: Mapping[str, Mapping[str, str]] = field(default_factory=dict)  # of the tables
    # other files: name -> what makes their content
    texts: Mapping[str, Callable[[], str]] = field(default_factory=dict)

    def save(self, folder: str | Path) -> Record:
        """Write it, without its page, whole or not at all; what was of that kind is replaced.

        The hashes of all other files are put to the document under "files". The page of what was
        there before is removed. Raises ``output.kind``.
        """
        files: dict[str, File] = {
            f"{name}.parquet": partial(_parquet, columns, {c: {"unit": u} for c, u in said.items()})
            for (name, columns), said in zip(self.tables.items(), self.units.values(), strict=True)
        }
        files |= {name: partial(_text, made) for name, made in self.texts.items()}
        document = _written(Path(folder), self.kind, self.about, files, listed=bool(files))
        return replace(self, about=document)


def kind_of(folder: str | Path) -> str:
    """Return the kind of a folder, a key of `KINDS`; one that tells nothing is to hold a result."""
    return next((k for k, kind in KINDS.items() if (Path(folder) / kind.file).is_file()), "result")


def refuse_others(folder: str | Path, kind: str) -> None:
    """Refuse a folder that holds another kind of run; raises ``output.kind``."""
    for name, other in KINDS.items():
        if name != kind and (Path(folder) / other.file).exists():
            raise error("output.kind", folder=folder, what=other.file)


def record(
    kind: str, about: Mapping[str, Any], tables: Mapping[str, Columns] | None = None,
    **texts: Callable[[], str],
) -> Record:  # fmt: skip
    """Return what a folder is to hold: its schema is put to `about`, plain values [SI].

    `texts`: other files, name -> what makes their content.
    """

    def whole() -> dict[str, Any]:
        return {"schema": KINDS[kind].schema} | {key: plain_json(about[key]) for key in about}

    given = (tables or {}).items()
    return Record(
        Later(whole) if isinstance(about, Later) else whole(),
        {name: {c: _column(v) for c, (v, _) in columns.items()} for name, columns in given},
        kind,
        {name: {c: unit for c, (_, unit) in columns.items()} for name, columns in given},
        texts,
    )


def _column(values: Any) -> Any:
    return values if isinstance(values, (Names, Made)) else np.asarray(values)


def read(folder: str | Path, kind: str) -> Record:
    """Read a folder back, its tables checked against their hashes."""
    file = Path(folder) / KINDS[kind].file
    about = about_of(folder, kind)
    named = {n: digest for n, digest in about.get("files", {}).items() if n.endswith(".parquet")}
    tables = {Path(n).stem: read_table(file, n, digest) for n, digest in named.items()}
    return Record(about, tables, kind)


def about_of(folder: str | Path, kind: str) -> dict[str, Any]:
    """Return what the document of a folder says; refuse what is none, or of another schema."""
    file = Path(folder) / KINDS[kind].file
    return _of_schema(file, _read_json(file), KINDS[kind].schema)


def result_file(path: str | Path) -> Path:
    """Return the result.json of a run folder, or the file that is named itself."""
    return Path(path) / RESULT_FILE if Path(path).is_dir() else Path(path)


# -- the result of a calibration -----------------------------------------------------------


def save(result: Result, folder: str | Path, campaign_text: str | None = None) -> Path:
    """Write `result` into a run folder, complete or not at all.

    Parameters
    ----------
    result : Result
        What to save.
    folder : str or Path
        The run folder; made where it does not exist. A result in it is replaced.
    campaign_text : str or None
        The resolved campaign file.

    Returns
    -------
    Path
        The result.json written.
    """
    from foucault.result_document import document

    require("result", result, Result)
    folder = Path(folder)
    doc = document(result)
    keep_a_campaign(folder, campaign_text)
    files: dict[str, File] = {}
    for name, table in result.tables.items():
        notes = {c.name: {"unit": c.unit, "meaning": c.meaning} for c in declared(name)}
        buffer = io.BytesIO()
        _parquet({k: np.asarray(v) for k, v in table.items()}, notes, buffer)
        data = buffer.getvalue()
        digest = _sha256(data)
        file = f"{TABLE_FOLDER}/{name}.{digest[:8]}.parquet"
        rows = len(next(iter(table.values()))) if table else 0
        doc["tables"][name] = {"file": file, "rows": rows, "sha256": digest}
        files[file] = data
    if campaign_text is not None:
        files[CAMPAIGN_FILE] = data = campaign_text.encode()
        doc["campaign"] = {"file": CAMPAIGN_FILE, "sha256": _sha256(data)}
    _written(folder, "result", doc, files)
    with suppress(OSError):  # the result is whole; what cannot be removed is only in the way
        for old in (folder / TABLE_FOLDER).glob("*.parquet"):
            if _TABLE_NAME.fullmatch(old.name) and f"{TABLE_FOLDER}/{old.name}" not in files:
                old.unlink()
        if campaign_text is None:
            (folder / CAMPAIGN_FILE).unlink(missing_ok=True)
    return folder / RESULT_FILE


def keep_a_campaign(folder: Path, campaign_text: str | None) -> None:
    """Refuse to replace a campaign or a result.json that no run has written.

    `campaign_text` or None: the campaign that will lie beside it, or the one that is read. Raises
    ``output.other``.
    """
    keep_others(folder / RESULT_FILE, [b'"foucault.result/'])
    file = folder / CAMPAIGN_FILE
    if not file.is_file():
        return
    there = file.read_bytes()
    same = campaign_text is not None and read_text(file) == campaign_text
    if not (same or RESOLVED in there[:HEAD] or _sha256(there) == _said(folder)):
        raise error("output.other", path=file)


def _said(folder: Path) -> str:
    """Return the fingerprint of the campaign that the result in a folder names, if any."""
    try:
        doc = parse_json((folder / RESULT_FILE).read_bytes())
        return str(doc["campaign"]["sha256"])
    except (OSError, ValueError, KeyError, TypeError):
        return ""


def clear(folder: str | Path) -> None:
    """Remove what `save` and `report.write` have written into a folder, and the folder if empty."""
    folder = Path(folder)
    if not (folder / RESULT_FILE).is_file():
        return
    (folder / RESULT_FILE).unlink()  # first, so that nobody takes the rest for complete
    for name in (REPORT_FILE, CAMPAIGN_FILE):
        (folder / name).unlink(missing_ok=True)
    for file in (folder / TABLE_FOLDER).glob("*.parquet"):
        if _TABLE_NAME.fullmatch(file.name):
            file.unlink()
    for left in (folder / TABLE_FOLDER, folder):
        with suppress(OSError):  # something of the user's is in it
            left.rmdir()


def load_result(path: str | Path, *, with_tables: bool = True) -> Result:
    """Read a result back, with exactly the numbers that were saved.

    Parameters
    ----------
    path : str or Path
        A run folder or its result.json.
    with_tables : bool
        False leaves the tables unread: enough to apply a result.json copied alone.

    Returns
    -------
    Result
        The result [SI].
    """
    from foucault.coefficients import covariance_problem
    from foucault.result_document import result_of

    require("path", path, PathLike, str)
    file = _result_file(Path(path))
    doc = _validated(file, _read_json(file))
    listed = doc.tables if with_tables else {}
    result = result_of(doc, {n: read_table(file, r.file, r.sha256, n) for n, r in listed.items()})
    vector, warm = result.coefficients, result.temperature
    problem = covariance_problem(vector.cov, vector.names)
    if warm is not None and not problem:
        terms = [f"{n}, term {k}" for n in vector.names for k in range(warm.weights.shape[1])]
        problem = covariance_problem(warm.cov, terms)
    if problem:
        raise error("result.covariance", file=file, problem=problem)
    return result


@lru_cache(maxsize=64)
def result_of_hash(folder: Path, digest: str) -> Result:
    """Return the result, without tables [SI], of a folder whose result.json has this hash.

    It is the same each time.
    """
    del digest
    return load_result(folder, with_tables=False)


# -- writing -------------------------------------------------------------------------------


def _written(
    folder: Path, kind: str, doc: Mapping[str, Any], files: Mapping[str, File], listed: bool = False
) -> Mapping[str, Any]:
    """Write a document and the files that belong to it; the page of what was there goes.

    `listed`: whether the hashes of the files are put to the document. Returns it as it was written.
    """
    refuse_others(folder, kind)
    name, text, digests = KINDS[kind].file, "", dict[str, str]()
    new = [folder / file for file in files if not (folder / file).exists()]
    try:
        for parent in {(folder / file).parent for file in (name, *files)}:
            parent.mkdir(parents=True, exist_ok=True)
        with ExitStack() as stack:  # closed in reverse order, once everything is on the disk
            document = stack.enter_context(atomic(folder / name))
            pool = stack.enter_context(ThreadPoolExecutor(2))
            words = pool.submit(_json, doc)  # as long as the tables need the disk
            for file, data in files.items():
                there, ended = stack.enter_context(atomic(folder / file)), Event()
                digest = pool.submit(_followed, there, ended) if listed else None
                try:
                    if isinstance(data, bytes):
                        there.write_bytes(data)
                    else:
                        data(there)
                finally:
                    ended.set()
                if digest is not None:
                    digests[file] = digest.result()
            text = words.result()
            if listed:
                text = f"{text[:-2]},{_json({'files': digests})[1:]}"
                doc = {**doc, "files": digests}
            text += "\n"
            document.write_text(text, encoding="utf-8")
    except BaseException as problem:
        with suppress(OSError):
            there = folder / name
            if not (there.is_file() and there.read_text(encoding="utf-8") == text):
                for made in new:  # what was there before has no use for them
                    made.unlink(missing_ok=True)
        if isinstance(problem, OSError):
            raise unwritable(folder, problem) from problem
        raise
    with suppress(OSError):
        (folder / REPORT_FILE).unlink(missing_ok=True)
    return doc


def _followed(path: Path, ended: Event) -> str:
    """Return the SHA-256 of a file that grows until its writing has `ended`."""
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while True:
            last = ended.is_set()
            for block in iter(partial(stream.read, 1 << 20), b""):
                digest.update(block)
            if last:
                return digest.hexdigest()
            ended.wait(0.01)


def _text(made: Callable[[], str], where: Path) -> None:
    where.write_bytes(made().encode())


def _json(doc: Mapping[str, Any]) -> str:
    """Return a document as text: line by line, but for long lists, of which each item has one."""
    plain = partial(json.dumps, allow_nan=False, ensure_ascii=False)
    lines = []
    for key, x in doc.items():
        if isinstance(x, list) and len(x) > LONG:  # several times as fast
            text = "[\n  " + ",\n  ".join(map(plain, x)) + "\n ]"
        else:
            text = plain(x, indent=1).replace("\n", "\n ")
        lines.append(f" {plain(str(key))}: {text}")
    return "{\n" + ",\n".join(lines) + "\n}"


LONG = 100
"""A list of more items [1] has one on each line."""


GROUP = 1 << 15
"""Rows of a Parquet file that are written at once: memory holds no more of them twice [1]."""

PIECE = 1 << 14
"""Rows that are put together at once: the cache holds what their columns are parts of [1]."""


def _parquet(
    columns: Mapping[str, Any], notes: Mapping[str, Mapping[str, str]], where: Path | io.BytesIO
) -> None:
    """Write columns as Parquet, with `notes` of each, group by group."""
    import pyarrow as pa

    def given(x: Any) -> bool:
        return isinstance(x, Made) or (isinstance(x, np.ndarray) and x.dtype.kind in "fib")

    whole = {name: x if given(x) else to_arrow(x) for name, x in columns.items()}
    size = max((len(x) for x in whole.values()), default=0)

    def rows(start: int, end: int) -> list[Any]:
        some = (x[start:end] for x in whole.values())
        return [to_arrow(x) if isinstance(x, np.ndarray) else x for x in some]

    schema = pa.schema(pa.field(name, a.type, metadata=notes.get(name))
                       for name, a in zip(whole, rows(0, 0), strict=True))  # fmt: skip

    def group(start: int) -> Any:
        ends = range(start, max(min(start + GROUP, size), start + 1), PIECE)
        pieces = [rows(k, min(k + PIECE, start + GROUP)) for k in ends]
        return pa.Table.from_batches([pa.RecordBatch.from_arrays(x, schema=schema) for x in pieces])

    with ThreadPoolExecutor(1) as pool, parquet_writer(schema, where) as writer:
        coming = pool.submit(group, 0)
        for start in range(0, max(size, 1), GROUP):
            table, coming = coming.result(), pool.submit(group, start + GROUP)
            writer.write_table(table)


def parquet_writer(schema: Any, where: Path | io.BytesIO) -> Any:
    """Return a writer of tables of pyarrow with this schema."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    # A dictionary of numbers that are all different takes ten times as long as the numbers.
    coded = [f.name for f in schema if not pa.types.is_floating(f.type)]
    return pq.ParquetWriter(where, schema, use_dictionary=coded)


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


# -- reading -------------------------------------------------------------------------------


def _result_file(path: Path) -> Path:
    if not path.exists():
        raise error("result.missing", path=path)
    file = result_file(path)
    if not file.is_file():
        raise error("result.incomplete", folder=path)
    return file


def _read_json(file: Path) -> dict[str, Any]:
    def refuse(constant: str) -> NoReturn:
        raise ValueError(f"{constant} is not JSON")

    try:
        doc = parse_json(file.read_bytes(), parse_constant=refuse)
    except (OSError, ValueError) as problem:
        raise error("result.not_json", file=file, problem=problem) from problem
    if not isinstance(doc, dict):
        raise error("result.not_json", file=file, problem="it holds no object")
    return doc


def _of_schema(file: Path, doc: dict[str, Any], schema: str) -> dict[str, Any]:
    if doc.get("schema") != schema:
        given = f"has schema {doc['schema']!r}" if "schema" in doc else "names no schema"
        raise error("result.schema", file=file, given=given, allowed=schema)
    return doc


def _validated(file: Path, doc: dict[str, Any]) -> ResultDocument:
    from pydantic import ValidationError

    from foucault.result_document import SCHEMA, ResultDocument, migrated

    try:
        return ResultDocument.model_validate(_of_schema(file, migrated(doc), SCHEMA))
    except ValidationError as problem:
        raise _invalid(file, problem) from None


def _invalid(file: Path, problem: ValidationError) -> FoucaultError:
    """Turn pydantic's list into one sentence that names the first three places."""
    found = problem.errors()
    words = []
    for item in found[:3]:
        place = ".".join(str(part) for part in item["loc"])
        what = item["msg"].removeprefix("Value error, ")
        words.append(f"'{place}' is missing" if item["type"] == "missing" else f"{place}: {what}")
    more = f" and {len(found) - 3} more" if len(found) > 3 else ""
    text = "; ".join(word.removeprefix(": ") for word in words)
    return error("result.invalid", file=file, problems=text + more)


def read_table(document: Path, name: str, digest: str, called: str = "") -> TableData:
    """Return the columns of a table beside a document, whose hash that knows."""
    import pyarrow.parquet as pq

    where = {"file": document, "table": called or Path(name).stem, "path": name}
    try:
        data = (document.parent / name).read_bytes()
    except FileNotFoundError:
        raise error("result.table_missing", **where) from None
    if _sha256(data) != digest:
        raise error("result.table_changed", **where)
    table = pq.ParquetFile(io.BytesIO(data)).read()
    return {c: of_arrow(table.column(c)) for c in table.column_names}
