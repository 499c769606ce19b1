"""What people say of a certificate: tables [certificate] of files of the laboratory and of a job.

Files are laid over one another, the later one counts; paths in a file are seen from where it lies.
Every key that ISO/IEC 17025:2017 asks for has no default, and its clause stands beside it.
"""

from __future__ import annotations

import datetime
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, StringConstraints

from foucault.errors import error
from foucault.files import said_in
from foucault.strict import Strict

Text = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=2000)]
Words = Annotated[str, StringConstraints(strip_whitespace=True, max_length=2000)]
Number = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$")]
Country = Annotated[str, StringConstraints(pattern=r"^[A-Z]{2}$")]
Language = Annotated[str, StringConstraints(pattern=r"^[a-z]{2}$")]
Colour = Annotated[str, StringConstraints(pattern=r"^#[0-9a-fA-F]{6}$")]
What = Literal["gravity", "table", "clock", "thermometer"]

WHATS: tuple[What, ...] = ("gravity", "table", "clock", "thermometer")
"""What a calibration may rest on, each of which is named or said not to be used."""

PATHS = (("laboratory", "logo"), ("labels",), ("conformity", "tolerance"),
         ("adjustment", "before"))  # fmt: skip
"""Keys that name a file or folder."""


class Party(Strict):
    """A laboratory or a customer, 7.8.2.1 b and e."""

    name: Text
    street: Text
    postcode: Text
    city: Text
    country: Country
    """Two letters of ISO 3166, such as "DE"."""
    email: Words = ""
    phone: Words = ""


class Laboratory(Party):
    """Who calibrates, and how its certificates look."""

    accreditation: Words = ""
    """Accreditation and its number, as it may be claimed."""
    logo: Words = ""
    """File of a PNG, JPEG or SVG."""
    colour: Colour = "#1f3a5f"
    """Of lines and titles."""
    footer: Words = ""
    """A line at the end of each page."""


class Item(Strict):
    """What was calibrated, 7.8.2.1 g."""

    description: Text
    model: Text
    serial: Text
    manufacturer: Words = ""
    customer_id: Words = ""
    """What the customer calls it."""
    condition: Text
    """How it was when it came, such as "undamaged, sealed"."""


class Method(Strict):
    """How it was calibrated, 7.8.2.1 f and n."""

    name: Text
    document: Words = ""
    """Of the laboratory, such as "CP-17, issue 4"."""
    deviations: Text
    """From the method, additions and exclusions; or "none"."""


class Place(Strict):
    """Where it was calibrated, 7.8.2.1 c; at the address of the laboratory if left out."""

    kind: Literal["laboratory", "customer", "other"] = "laboratory"
    words: Words = ""
    """Room or address."""


class Conditions(Strict):
    """Conditions that have an influence, 7.8.4.1 b."""

    temperature: Text
    """Such as "(23 ± 1) °C"; from the run where its log has one."""
    humidity: Words = ""
    pressure: Words = ""
    more: Words = ""


class Reference(Strict):
    """What the results are traced to, 7.8.4.1 c."""

    what: What | Literal["other"]
    certificate: Text
    """Its number, or what else makes it known."""
    issuer: Words = ""
    """Who has issued that."""
    due: datetime.date | None = None
    """Last day on which it counts."""


class Adjustment(Strict):
    """What was done to the item during calibration, 7.8.4.1 d."""

    done: Literal["none", "adjusted", "repaired"]
    words: Words = ""
    before: Words = ""
    """Run folder of the results before it."""


class Conformity(Strict):
    """A statement of conformity, 7.8.6."""

    specification: Text
    """Which one, such as "data sheet, issue 3"."""
    tolerance: Text
    """File with the limits."""
    rule: Literal["guarded", "simple"] = "guarded"


class Person(Strict):
    """Who authorises the certificate, 7.8.2.1 o."""

    name: Text
    role: Text


class Said(Strict):
    """All that people say of a certificate."""

    number: Number
    """Letters, digits, points, dashes: what this certificate is called, 7.8.2.1 d."""
    languages: Annotated[tuple[Language, ...], Field(min_length=1, max_length=3)] = ("en",)
    """Of the words; the first one leads."""
    labels: Words = ""
    """File with words of one's own, or of another language."""
    laboratory: Laboratory
    customer: Party
    item: Item
    received: datetime.date
    """7.8.2.1 h."""
    performed: datetime.date
    """First day, 7.8.2.1 i; from the log where its times are dates."""
    performed_until: datetime.date | None = None
    """Last day, if that is another."""
    issued: datetime.date
    """7.8.2.1 j; the day on which it is made if left out."""
    place: Place = Place()
    method: Method
    conditions: Conditions
    references: dict[str, Reference] = Field(default_factory=dict)
    """Name -> what the laboratory has."""
    used: tuple[str, ...] = ()
    """Names of those that this calibration rests on."""
    unused: dict[What, Text] = Field(default_factory=dict)
    """What it does not rest on, and why."""
    adjustment: Adjustment
    conformity: Conformity | None = None
    opinions: Words = ""
    """Opinions and interpretations, 7.8.7."""
    from_customer: Words = ""
    """What the customer has supplied and can affect the results, 7.8.2.2."""
    external: Words = ""
    """Results of others, 7.8.2.1 p."""
    next_due: Words = ""
    """Only where the customer has agreed to an interval, 7.8.4.3."""
    authorised_by: Person


def read(files: Iterable[str | Path]) -> dict[str, Any]:
    """Return what files say, the later over the earlier, with whole paths."""
    out: dict[str, Any] = {}
    for file in map(Path, files):
        raw = said_in(file, "certificate.file", path=file)
        if set(raw) != {"certificate"} or not isinstance(raw["certificate"], dict):
            raise error("certificate.file", path=file,
                        reason="it should hold [certificate] and nothing else")  # fmt: skip
        one = raw["certificate"]
        for *tables, key in PATHS:
            at: Any = one
            for table in tables:
                at = at.get(table) if isinstance(at, dict) else None
            if isinstance(at, dict) and isinstance(at.get(key), str) and at[key]:
                at[key] = str(file.absolute().parent / at[key])
        out = over(out, one)
    return out


def over(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table with another laid over it; empty texts say nothing."""
    out = dict(below)
    for key, value in above.items():
        there = out.get(key)
        if isinstance(value, Mapping) and isinstance(there, Mapping):
            out[key] = over(there, value)
        elif value != "":
            out[key] = value
    return out
