"""From a run to its certificate on the disk: gathered, written, signed, kept; whole or not at all.

A file that is there is never overwritten. With records the entry of a certificate and its files
come about together, and its number is given once.
"""

from __future__ import annotations

import datetime
import hashlib
import os
import secrets
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from foucault.certificate import dcc, page, said, signature
from foucault.certificate.content import Certificate, Replaced, Review, gathered
from foucault.certificate.signature import Key
from foucault.certificate.verify import dcc_of
from foucault.errors import error
from foucault.files import make_folder, sha256, unwritable

if TYPE_CHECKING:
    from foucault.records import Records


@dataclass(frozen=True)
class Issued:
    """A certificate as it lies on the disk."""

    number: str
    page: Path
    dcc: Path
    page_sha256: str
    dcc_sha256: str
    signer: str  # empty: not signed
    replaces: str
    decision: str  # on conformity; empty without a statement
    entry: int | None  # its number in the records [1]


def issue(
    run: str | Path, files: Iterable[str | Path], folder: str | Path, *, key: Key | None = None,
    issued: str = "", reviewer: str = "", reason: str = "", replaces: str | Path | None = None,
    change: str = "", records: Records | None = None,
) -> Issued:  # fmt: skip
    """Write the certificate of a run into a folder.

    `files`: with [certificate]; `issued`: day, ISO 8601, empty for what they say or today;
    `reviewer`, `reason`: of a run that did not pass; `replaces`, `change`: an earlier certificate
    and what is changed. Raises ``certificate.*``, ``records.*``; nothing is written then.
    """
    raw = said.read(files)
    if issued:
        raw["issued"] = issued
    more: dict[str, Any] = {} if records is None else from_records(records, run)
    if reviewer:
        more["review"] = Review(reviewer=reviewer, reason=reason)
    if replaces is not None:
        more["replaces"] = _replaced(replaces, change, records)
    of = gathered(run, raw, issued=datetime.datetime.now(datetime.UTC).date(), **more)
    xml, pdf = made(of, key)
    out = make_folder(folder)
    on_paper, as_data = out / f"{of.number}.pdf", out / f"{of.number}.xml"
    where = {on_paper: pdf, as_data: xml}
    digests = {k: hashlib.sha256(v).hexdigest() for k, v in (("page", pdf), ("dcc", xml))}
    entry = None
    if records is None:
        _written(where)
    else:
        from foucault.records.entries import Certified

        words = " ".join(filter(None, (change, reason)))
        body = Certified(
            sha256=of.run.sha256, certificate=of.number, issued=of.issued.isoformat(),
            **digests,
            signer="" if key is None else key.holder, words=words,
            replaces="" if of.replaces is None else of.replaces.number,
        )  # fmt: skip
        entry = records.certify(body, lambda: _written(where)).number
    return Issued(
        of.number, on_paper, as_data, digests["page"], digests["dcc"],
        "" if key is None else key.holder, "" if of.replaces is None else of.replaces.number,
        of.decision or "", entry,
    )  # fmt: skip


def made(of: Certificate, key: Key | None = None) -> tuple[bytes, bytes]:
    """Return the DCC and the PDF of a certificate; without a key always the same bytes."""
    xml = dcc.made(of)
    wrong = dcc.faults(xml)
    if wrong:
        raise error("certificate.schema", reason=wrong[0])
    if key is None:
        return xml, page.made(of, xml, signed=False)
    xml = signature.sign_dcc(xml, key)
    pdf = page.made(of, xml, signed=True)
    return xml, signature.sign_page(pdf, key, reason=f"Certificate {of.number}",
                                    place=of.laboratory.city)  # fmt: skip


def _replaced(path: str | Path, change: str, records: Records | None) -> Replaced:
    """Return what is replaced; with records it has to be the file that was issued."""
    data = dcc_of(path)
    number = dcc.identity(dcc.parsed(data, path))["number"]
    if records is not None:
        mine = next((c for c in records.certificates() if c.certificate == number), None)
        if mine is None:
            raise error("certificate.not_replaced", what=f"The records know no {number}")
        if sha256(path) not in (mine.page, mine.dcc):
            raise error("certificate.not_replaced", what=f"{path} is not {number} as issued")
    return Replaced(number=number, sha256=hashlib.sha256(data).hexdigest(), change=change)


def from_records(records: Records, run: str | Path) -> dict[str, Any]:
    """Return what the records know of a run; one that was rejected or edited is refused."""
    from foucault.records.entries import Reviewed

    row = records.run(str(run))
    records.checked(row)
    reviews = [(e, b) for e, b in records.said(Reviewed) if b.sha256 == row.sha256]
    out: dict[str, Any] = {"entry": records.head[1], "used": records.used_by(row)}
    if reviews:
        entry, last = reviews[-1]
        if last.decision == "rejected":
            raise error("certificate.rejected", number=row.number, reason=last.reason)
        out["review"] = Review(reviewer=entry.who, reason=last.reason)
    out["known"] = {
        name: {"what": one.what, "certificate": one.certificate}
        | ({"due": one.due[:10]} if one.due else {})
        for name, one in records.references().items()
    }
    if row.dated in ("given", "log"):
        out["performed"] = row.holds[:10]
    return out


def _written(files: dict[Path, bytes]) -> None:
    """Write files, all or none; one that is there stays as it is."""
    made: list[Path] = []
    try:
        for path, data in files.items():
            # Linked, not renamed: of two who write at once the second one is refused.
            partial = path.with_name(f".partial-{secrets.token_hex(8)}")
            partial.write_bytes(data)
            try:
                os.link(partial, path)
                made.append(path)
            finally:
                partial.unlink()
    except BaseException as problem:
        for path in made:
            with suppress(OSError):
                path.unlink()
        if isinstance(problem, FileExistsError):
            raise error("certificate.exists", path=problem.filename2 or problem.filename) from None
        if isinstance(problem, OSError):
            raise unwritable(next(iter(files)).parent, problem) from problem
        raise
