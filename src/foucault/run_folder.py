"""The run folder: what one calibration leaves behind, whole or not at all.

::

    campaign.toml               the campaign with every default filled in
    result.json                 the result; written last, so that its presence means complete
    tables/rests.5c1f02aa.parquet ...   one per table of the result, named in result.json
    report.html                 for people, made from the rest of the folder

Replacing result.json is the one step that turns a run into the folder's result. The name of a
table carries the beginning of its hash, so a new run never overwrites a table that the result
in place still needs: interrupted anywhere, the folder holds the old result or the new one.
"""

from __future__ import annotations

import hashlib
import io
import json
import re
from collections.abc import Iterable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from foucault import tables
from foucault.errors import FoucaultError, error
from foucault.files import HEAD, atomic, keep_others, parse_json, read_text, unwritable
from foucault.result import Result, TableData

if TYPE_CHECKING:
    from pydantic import ValidationError

    from foucault.result_document import ResultDocument

RESULT_FILE = "result.json"
CAMPAIGN_FILE = "campaign.toml"
REPORT_FILE = "report.html"
TABLE_FOLDER = "tables"

RESOLVED = b"# The campaign with every default filled in"
"""So begins the campaign of a run."""

_TABLE_NAME = re.compile(r"\w+\.[0-9a-f]{8}\.parquet")


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

    folder = Path(folder)
    doc = document(result)
    keep_a_campaign(folder, campaign_text)
    made: list[Path] = []
    try:
        (folder / TABLE_FOLDER).mkdir(parents=True, exist_ok=True)
        for name, table in result.tables.items():
            doc["tables"][name] = _save_table(folder, name, table, made)
        _commit(folder, doc, campaign_text)
    except BaseException as problem:
        for file in made:  # the result in place has no use for them
            with suppress(OSError):
                file.unlink()
        if isinstance(problem, OSError):
            raise unwritable(folder, problem) from problem
        raise
    with suppress(OSError):  # the result is whole; what cannot be removed is only in the way
        _remove_stale(folder, doc)
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
        doc = parse_json((folder / RESULT_FILE).read_text(encoding="utf-8"))
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

    file = _result_file(Path(path))
    doc = _validated(file, _read_json(file))
    listed = doc.tables if with_tables else {}
    result = result_of(doc, {n: _load_table(file, n, r.model_dump()) for n, r in listed.items()})
    vector, warm = result.coefficients, result.temperature
    problem = covariance_problem(vector.cov, vector.names)
    if warm is not None and not problem:
        terms = [f"{n}, term {k}" for n in vector.names for k in range(warm.weights.shape[1])]
        problem = covariance_problem(warm.cov, terms)
    if problem:
        raise error("result.covariance", file=file, problem=problem)
    return result


def result_schema() -> dict[str, Any]:
    """Return the JSON schema of result.json."""
    from foucault.result_document import result_schema as schema

    return schema()


# -- writing -------------------------------------------------------------------------------


def _commit(folder: Path, doc: dict[str, Any], campaign_text: str | None) -> None:
    """Write campaign.toml and result.json; result.json is replaced last."""
    campaign = None if campaign_text is None else campaign_text.encode()
    if campaign is not None:
        doc["campaign"] = {"file": CAMPAIGN_FILE, "sha256": _sha256(campaign)}
    text = json.dumps(doc, indent=1, allow_nan=False, ensure_ascii=False)
    with ExitStack() as stack:  # closed in reverse order, once everything is on the disk
        result_file = stack.enter_context(atomic(folder / RESULT_FILE))
        if campaign is not None:
            stack.enter_context(atomic(folder / CAMPAIGN_FILE)).write_bytes(campaign)
        result_file.write_text(text + "\n", encoding="utf-8")


def _save_table(folder: Path, name: str, table: TableData, made: list[Path]) -> dict[str, Any]:
    data = _parquet(name, table)
    digest = _sha256(data)
    file = f"{TABLE_FOLDER}/{name}.{digest[:8]}.parquet"
    if not ((folder / file).is_file() and _sha256((folder / file).read_bytes()) == digest):
        with atomic(folder / file) as temporary:
            temporary.write_bytes(data)
        made.append(folder / file)
    rows = len(next(iter(table.values()))) if table else 0
    return {"file": file, "rows": rows, "sha256": digest}


def _parquet(name: str, table: TableData) -> bytes:
    """Return `table` as Parquet, with unit and meaning of every column that `tables` declares."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    declared: Iterable[tables.Column] = getattr(tables, name.upper(), ())
    known = {c.name: {"unit": c.unit, "meaning": c.meaning} for c in declared}
    columns = {key: pa.array(np.asarray(values)) for key, values in table.items()}
    schema = pa.schema([pa.field(k, v.type, metadata=known.get(k)) for k, v in columns.items()])
    buffer = io.BytesIO()
    pq.write_table(pa.Table.from_arrays(list(columns.values()), schema=schema), buffer)
    return buffer.getvalue()


def _remove_stale(folder: Path, doc: dict[str, Any]) -> None:
    """Remove what belongs to an earlier result: its tables, its report, its campaign."""
    wanted = {row["file"].rpartition("/")[2] for row in doc["tables"].values()}
    for file in (folder / TABLE_FOLDER).iterdir():
        if _TABLE_NAME.fullmatch(file.name) and file.name not in wanted:
            file.unlink()
    (folder / REPORT_FILE).unlink(missing_ok=True)
    if doc["campaign"] is None:
        (folder / CAMPAIGN_FILE).unlink(missing_ok=True)


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


# -- reading -------------------------------------------------------------------------------


def _result_file(path: Path) -> Path:
    if not path.exists():
        raise error("result.missing", path=path)
    file = path / RESULT_FILE if path.is_dir() else path
    if not file.is_file():
        raise error("result.incomplete", folder=path)
    return file


def _read_json(file: Path) -> dict[str, Any]:
    def refuse(constant: str) -> NoReturn:
        raise ValueError(f"{constant} is not JSON")

    try:
        doc = parse_json(file.read_text(encoding="utf-8"), parse_constant=refuse)
    except (OSError, ValueError) as problem:
        raise error("result.not_json", file=file, problem=problem) from problem
    if not isinstance(doc, dict):
        raise error("result.not_json", file=file, problem="it holds no object")
    return doc


def _validated(file: Path, doc: dict[str, Any]) -> ResultDocument:
    from pydantic import ValidationError

    from foucault.result_document import SCHEMA, ResultDocument, migrated

    doc = migrated(doc)
    if doc.get("schema") != SCHEMA:
        given = f"has schema {doc['schema']!r}" if "schema" in doc else "names no schema"
        raise error("result.schema", file=file, given=given, allowed=SCHEMA)
    try:
        return ResultDocument.model_validate(doc)
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


def _load_table(result_file: Path, name: str, row: dict[str, Any]) -> TableData:
    import pyarrow.parquet as pq

    file = result_file.parent / row["file"]
    try:
        data = file.read_bytes()
    except FileNotFoundError:
        raise error(
            "result.table_missing", file=result_file, table=name, path=row["file"]
        ) from None
    if _sha256(data) != row["sha256"]:
        raise error("result.table_changed", file=result_file, table=name, path=row["file"])
    table = pq.read_table(io.BytesIO(data))
    return {c: table.column(c).to_numpy() for c in table.column_names}
