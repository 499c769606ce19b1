"""What is said of instruments and runs, once and for good: entries in a chain of hashes.

An entry is never changed. Its hash is that of its number, time, author, kind and text together with
the hash of the entry before, so that an edited byte, a removed or an inserted entry shows::

    hash = SHA-256("number|made|who|kind|body|hash before")

What chops entries off the end shows only beside a hash that was kept elsewhere, which is why
certificates and `foucault records audit` print the newest one.
"""

from __future__ import annotations

import datetime
import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

FIRST = "0" * 64
"""The hash before the first entry."""

Name = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=200)]
Words = Annotated[str, StringConstraints(strip_whitespace=True, max_length=2000)]
Reason = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=2000)]
Sha256 = Annotated[str, StringConstraints(pattern="^[0-9a-f]{64}$")]


class Body(BaseModel):
    """What an entry says; its fields are the columns of people and of exports."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    kind: ClassVar[str]

    def as_json(self) -> str:
        """Return it as JSON, always the same for the same content."""
        return json.dumps(
            self.model_dump(mode="json"), sort_keys=True, ensure_ascii=False,
            separators=(",", ":"), allow_nan=False,
        )  # fmt: skip


class RunAdded(Body):
    """A run folder was taken in."""

    kind = "run"
    folder: Annotated[str, Field(description="as seen from the folder of the database, if below")]
    sha256: Annotated[Sha256, Field(description="of its result.json")]
    instrument: Annotated[Name, Field(description="which instrument it is of")]
    holds: Annotated[str, Field(description="when the log was recorded, ISO 8601; empty: unknown")]
    dated: Annotated[str, Field(description="where that is from: given, log or computed")]
    references: Annotated[tuple[Name, ...], Field(description="names of references used")] = ()
    again: Annotated[str, Field(description="SHA-256 of the run that it repeats; empty: none")] = ""


class RunMoved(Body):
    """A run folder lies elsewhere now."""

    kind = "moved"
    sha256: Sha256
    folder: str


class Reviewed(Body):
    """Somebody judged a run."""

    kind = "review"
    sha256: Sha256
    decision: Literal["accepted", "rejected"]
    reason: Reason


class Limits(Body):
    """Limits of an instrument's coefficients, as a tolerance file has them."""

    kind = "tolerance"
    instrument: Name
    text: Annotated[str, Field(description="the tolerance file", max_length=1 << 20)]


class Interval(Body):
    """How long a calibration of an instrument holds."""

    kind = "interval"
    instrument: Name
    months: Annotated[float, Field(gt=0, le=600)]


class Event(Body):
    """Something was done to an instrument, after which it may be another."""

    kind = "event"
    instrument: Name
    what: Literal["repaired", "adjusted", "out of service", "in service", "note"]
    on: Annotated[str, Field(description="date, ISO 8601")]
    words: Words = ""


class Reference(Body):
    """Something that calibrations rest on: gravity, a table, a clock, a thermometer."""

    kind = "reference"
    name: Name
    what: Literal["gravity", "table", "clock", "thermometer", "other"]
    certificate: Words = ""
    due: Annotated[str, Field(description="date, ISO 8601; empty: none")] = ""
    words: Words = ""


class Certified(Body):
    """A certificate was issued; one that replaces another says which."""

    kind = "certificate"
    sha256: Annotated[Sha256, Field(description="of the run's result.json")]
    certificate: Annotated[Name, Field(description="its number")]
    issued: Annotated[str, Field(description="date, ISO 8601")]
    page: Annotated[Sha256, Field(description="of the PDF")]
    dcc: Annotated[Sha256, Field(description="of the XML")]
    signer: Words = ""
    replaces: Words = ""
    words: Annotated[Words, Field(description="what changed, or why it was released")] = ""


class Account(Body):
    """Somebody may do something else in a workbench from now on."""

    kind = "account"
    name: Annotated[Name, Field(description="whose account or token")]
    change: Literal["made", "changed", "closed", "token made", "token ended", "locked out"]
    role: Annotated[Words, Field(description="from now on; empty: as before")] = ""
    words: Annotated[Words, Field(description="label of a token, or from where")] = ""


KINDS: dict[str, type[Body]] = {
    one.kind: one
    for one in (RunAdded, RunMoved, Reviewed, Limits, Interval, Event, Reference, Certified,
                Account)
}  # fmt: skip
"""Kind of an entry -> what it says."""


@dataclass(frozen=True)
class Entry:
    """One entry, as it is kept."""

    number: int  # its place in the chain, from 1 [1]
    made: str  # date and time, ISO 8601 with offset
    who: str
    kind: str
    body: str  # JSON
    hash: str
    version: str  # of the program that wrote it

    @classmethod
    def after(cls, last: Entry | None, body: Body, who: str, version: str) -> Entry:
        """Return the entry that follows `last`, None for the first."""
        now = datetime.datetime.now(datetime.UTC).isoformat(timespec="milliseconds")
        number, before = (1, FIRST) if last is None else (last.number + 1, last.hash)
        # A clock that was set back does not turn the order of what was done.
        made = now if last is None else max(now, last.made)
        bare = cls(number, made, who, body.kind, body.as_json(), "", version)
        return cls(**{**vars(bare), "hash": bare.hashed(before)})

    def hashed(self, before: str) -> str:
        """Return the hash that it must have after one with the hash `before`."""
        said = [self.number, self.made, self.who, self.kind, self.body, self.version, before]
        text = json.dumps(said, ensure_ascii=False, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    def says(self) -> Body:
        """Return what it says; `ValueError` where that is nothing that is known."""
        return KINDS[self.kind].model_validate_json(self.body)


def broken(entries: Iterable[Entry]) -> int | None:
    """Return the number of the first entry that does not follow the one before, None for none."""
    before = FIRST
    for number, entry in enumerate(entries, 1):
        if entry.number != number or entry.hash != entry.hashed(before):
            return number
        before = entry.hash
    return None


def plain(entry: Entry) -> dict[str, Any]:
    """Return an entry for an export: its body as an object, too."""
    return {**vars(entry), "body": json.loads(entry.body)}
