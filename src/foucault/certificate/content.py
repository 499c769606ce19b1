"""What a certificate says: all of it as one model, gathered from a run, from people and records.

An expanded uncertainty is U = k u with k = 2, u from the covariance in seconds (that of the log's
clock is part of it). It is rounded up to two digits and the value to the same place. A value
conforms to a limit L by guarded acceptance where ``|x| + U <= L``, by simple acceptance where
``|x| <= L`` (ISO/IEC Guide 98-4, 8.2 and 8.3.2); the probability that an accepted one is beyond its
limit all the same is its specific risk, ``1 - P(|X| <= L)`` with X normally distributed.
"""

from __future__ import annotations

import datetime
import math
import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import ValidationError

from foucault.arrays import FloatArray
from foucault.campaign import tolerance
from foucault.campaign.comparison import Named, named_entry
from foucault.certificate.said import WHATS, Reference, Said, over
from foucault.errors import FoucaultError, error, listed, suggestion
from foucault.files import parse_json, sha256
from foucault.report.page import unit_of
from foucault.result import Level, Result
from foucault.run_folder import CAMPAIGN_FILE, load_result, result_file
from foucault.strict import Strict
from foucault.units import ZERO_CELSIUS

K = 2.0
"""Coverage factor [1]."""

COVERAGE = 0.9545
"""Probability that k = 2 covers of a normal distribution [1]."""

FORMS = {
    "number": "letters, digits, points and dashes are allowed, 64 at most",
    "country": "it should be two capital letters, such as DE",
    "colour": "it should be # and six hexadecimal digits, such as #1f3a5f",
}
"""Key -> how what it says has to look."""

Decision = Literal["pass", "undecided", "fail"]


class Row(Strict):
    """One coefficient that was calibrated."""

    name: str
    symbol: str
    meaning: str
    kind: str
    value: float  # [SI]
    sd: float  # its standard uncertainty [SI]
    # as people read them: the unit, the value, U, the value before adjustment with its U
    unit: str
    shown: str
    expanded: str
    before: float | None = None  # [SI]
    before_sd: float | None = None  # [SI]
    shown_before: str = ""
    limit: float | None = None  # largest size [SI]
    shown_limit: str = ""
    decision: Decision | None = None
    probability: float | None = None  # that it is within its limit [1]


class LeftOut(Strict):
    """A term that was not estimated, as a contribution of type B."""

    what: str
    size: str
    basis: str
    share: float  # the largest of a variance [1]


class Used(Reference):
    """A reference with its name."""

    name: str


class Review(Strict):
    """Who has accepted a run that did not pass, and why."""

    reviewer: str
    reason: str


class Replaced(Strict):
    """The certificate that this one replaces."""

    number: str
    sha256: str  # of its DCC
    change: str


class Run(Strict):
    """What the results were computed from and with."""

    procedure: str
    equation: str
    frame: str
    gauge: str
    software: str
    sha256: str  # of result.json
    logs: tuple[tuple[str, str], ...]  # name and SHA-256 of each
    verdict: Level
    reasons: tuple[str, ...]
    gravity: float | None = None  # [m/s^2]
    gravity_sd: float | None = None  # [m/s^2]
    temperature: tuple[float, float] | None = None  # lowest and highest [K]
    clock_sd: float | None = None  # relative, as part of the uncertainty [1]; None where unknown
    entry: str = ""  # hash of the newest entry of the records when this was made


class Certificate(Said):
    """Everything that stands on a certificate."""

    run: Run
    rows: tuple[Row, ...]
    covariance: tuple[tuple[float, ...], ...]  # of the rows [SI]
    held: tuple[str, ...]  # coefficients that were not calibrated
    left_out: tuple[LeftOut, ...] | None  # None where such terms were taken for nothing
    traced: tuple[Used, ...]
    review: Review | None = None
    replaces: Replaced | None = None

    @property
    def dated(self) -> datetime.datetime:
        """The time that stands in the files: the day of issue."""
        return datetime.datetime.combine(self.issued, datetime.time(), datetime.UTC)

    @property
    def decision(self) -> Decision | None:
        """Whether all of it conforms; None without a statement of conformity."""
        found = [r.decision for r in self.rows if r.decision is not None]
        worst: list[Decision] = ["fail", "undecided", "pass"]
        return next((d for d in worst if d in found), None)

    @property
    def risk(self) -> float:
        """The largest probability that an accepted value is beyond its limit all the same [1]."""
        accepted = [r for r in self.rows if r.decision == "pass" and r.probability is not None]
        return max((1.0 - (r.probability or 0.0) for r in accepted), default=0.0)


def gathered(
    folder: str | Path, raw: Mapping[str, Any], *, issued: datetime.date,
    known: Mapping[str, Mapping[str, Any]] | None = None, used: Sequence[str] = (),
    performed: str = "", entry: str = "", review: Review | None = None,
    replaces: Replaced | None = None,
) -> Certificate:  # fmt: skip
    """Gather what a certificate of a run says.

    `raw`: what `said.read` has read; `issued`: the day, where that says none; `known`, `used`,
    `performed`: references, those used and the day as the records have them; `entry`: hash of their
    newest one. Raises ``certificate.*``: something is missing, or may not be certified.
    """
    result = load_result(folder)
    _refuse_changed(folder)
    if result.verdict.level is not Level.PASS and review is None:
        why = result.verdict.reasons[0] if result.verdict.reasons else "no reason is given"
        raise error("certificate.doubtful", verdict=result.verdict.level, reason=why)
    said = _known(over({"references": known or {}, "used": list(used)}, raw), folder, result,
                  performed)  # fmt: skip
    if replaces is not None:
        said["number"] = revision(str(said.get("number", "")), replaces.number)
    said.setdefault("issued", issued)
    words = _validated(said)
    _refuse_out_of_order(words)
    serial = str(result.instrument.get("serial") or "").strip()
    if serial and words.item.serial != serial:
        raise error("certificate.other_item", said=words.item.serial, run=serial)
    rows, cov = _rows(result, words)
    some = result.tables.get("left_out")
    left = None if some is None else tuple(
        LeftOut(what=str(some["what"][i]), size=str(some["size"][i]), basis=str(some["basis"][i]),
                share=float(some["share"][i]))
        for i in np.argsort(-np.asarray(some["share"], float), kind="stable")
    )  # fmt: skip
    vector = result.coefficients
    return Certificate.model_validate({
        **words.model_dump(exclude_unset=True),
        "run": _run(folder, result, entry), "rows": rows, "covariance": cov.tolist(),
        "held": tuple(n for n, f in zip(vector.names, vector.free, strict=True) if not f),
        "left_out": left, "traced": _traced(words),
        "review": None if result.verdict.level is Level.PASS else review, "replaces": replaces,
    })  # fmt: skip


def lacking(
    folder: str | Path, raw: Mapping[str, Any], *,
    known: Mapping[str, Mapping[str, Any]] | None = None, used: Sequence[str] = (),
    performed: str = "",
) -> tuple[list[str], dict[str, Any], Result]:  # fmt: skip
    """Return what a certificate of a run still lacks, all that is said of it, and the run.

    Arguments as of `gathered`; what is said wrongly is not looked at.
    """
    result = load_result(folder)
    said = _known(over({"references": known or {}, "used": list(used)}, raw), folder, result,
                  performed)  # fmt: skip
    try:
        Said.model_validate({"issued": "2000-01-01"} | said)  # the day on which it is made
    except ValidationError as problem:
        found = problem.errors()
    else:
        found = []
    missing = [".".join(map(str, e["loc"])) for e in found if e["type"] == "missing"]
    return missing + _unnamed(said), said, result


def revision(number: str, before: str) -> str:
    """Return the number of the certificate that replaces the one called `before`."""
    base = number.partition("-r")[0] if re.search(r"-r\d+$", number) else number
    found = re.fullmatch(re.escape(base) + r"(?:-r(\d+))?", before)
    if not number or found is None:
        raise error("certificate.other_number", before=before, number=number or "nothing")
    return f"{base}-r{int(found[1] or 0) + 1}"


# -- from the run --------------------------------------------------------------------------


def _refuse_changed(folder: str | Path) -> None:
    """Refuse a run whose campaign is not the one that its result names."""
    file = result_file(folder)
    named = (parse_json(file.read_bytes()).get("campaign") or {}).get("sha256")
    beside = file.parent / CAMPAIGN_FILE
    if named and beside.is_file() and sha256(beside) != named:
        raise error("certificate.edited", path=beside)


def _known(
    said: dict[str, Any], folder: str | Path, result: Result, performed: str
) -> dict[str, Any]:
    """Lay what people say over what the run knows."""
    of = {k: str(result.instrument.get(k) or "").strip() for k in ("name", "serial")}
    out: dict[str, Any] = {
        "laboratory": {}, "customer": {}, "adjustment": {}, "authorised_by": {},
        "item": {k: v for k, v in (("model", of["name"]), ("serial", of["serial"])) if v},
        "method": {"name": f"Foucault, procedure {result.procedure}"}, "conditions": {},
    }  # fmt: skip
    span = _span(result)
    if span:
        low, high = (f"{t - ZERO_CELSIUS:.1f}" for t in span)
        out["conditions"]["temperature"] = f"{low} °C to {high} °C"
    entry = named_entry(Named(Path(folder)), "")
    if performed:
        out["performed"] = performed
    elif entry.dated == "log":
        day = datetime.datetime.fromtimestamp(entry.time, datetime.UTC).date()
        out["performed"] = day.isoformat()
    return over(out, said)


def _span(result: Result) -> tuple[float, float] | None:
    span = result.validity.get("temperature")
    return None if not span or None in span else (float(span[0]), float(span[1]))


def _run(folder: str | Path, result: Result, entry: str) -> Run:
    made, site = result.provenance, result.site
    inputs = [*(made.get("inputs") or []), *([made["input"]] if made.get("input") else [])]
    version = (made.get("versions") or {}).get("foucault", "")
    return Run(
        procedure=result.procedure, equation=result.equation, frame=result.frame,
        gauge=result.gauge, software=f"Foucault {version}".strip(),
        sha256=sha256(result_file(folder)),
        logs=tuple((str(i.get("file") or ""), str(i.get("sha256") or "")) for i in inputs),
        verdict=result.verdict.level, reasons=result.verdict.reasons, gravity=site.get("gravity"),
        gravity_sd=site.get("gravity_sd"), temperature=_span(result),
        clock_sd=None if result.clock is None else result.clock.sd, entry=entry,
    )  # fmt: skip


# -- what people have said -----------------------------------------------------------------


def _validated(said: Mapping[str, Any]) -> Said:
    """Return what is said; what is missing is named, all of it at once."""
    try:
        words = Said.model_validate(said)
    except ValidationError as problem:
        found = problem.errors()
        missing = [".".join(map(str, e["loc"])) for e in found if e["type"] == "missing"]
        other = next((e for e in found if e["type"] != "missing"), None)
        if other is None:
            raise error("certificate.missing", names=listed(missing + _unnamed(said), 12)) from None
        key = ".".join(map(str, other["loc"]))
        if other["type"] == "extra_forbidden":
            hint = suggestion(str(other["loc"][-1]), _keys())
            raise error("certificate.key", key=key, hint=hint) from None
        reason = other["msg"].removeprefix("Value error, ")
        if other["type"] == "string_pattern_mismatch":
            reason = FORMS.get(str(other["loc"][-1]), "it has another form")
        raise error("certificate.value", key=key, given=str(other["input"])[:80],
                    reason=reason) from None  # fmt: skip
    if unnamed := _unnamed(said):
        raise error("certificate.missing", names=listed(unnamed, 12))
    return words


def _unnamed(said: Mapping[str, Any]) -> list[str]:
    """Return what the calibration may rest on and nobody speaks of."""
    known = said.get("references") or {}
    have = {str(known[n].get("what")) for n in said.get("used") or () if n in known}
    unused = said.get("unused") or {}
    return [f"used or unused.{what}" for what in WHATS if what not in have and what not in unused]


def _keys() -> set[str]:
    from foucault.certificate import said

    models = [m for m in vars(said).values() if isinstance(m, type) and issubclass(m, Strict)]
    return {field for model in models for field in model.model_fields}


def _traced(words: Said) -> tuple[Used, ...]:
    out = []
    for name in words.used:
        if name not in words.references:
            raise error("certificate.reference", given=name,
                        hint=suggestion(name, words.references))  # fmt: skip
        one = words.references[name]
        if one.due is not None and one.due < (words.performed_until or words.performed):
            raise error("certificate.reference_due", name=name, due=one.due,
                        performed=words.performed_until or words.performed)  # fmt: skip
        out.append(Used(name=name, **one.model_dump()))
    return tuple(out)


def _refuse_out_of_order(words: Said) -> None:
    """Refuse dates that do not follow one another."""
    days = [("received", words.received), ("performed", words.performed),
            ("performed_until", words.performed_until or words.performed),
            ("issued", words.issued)]  # fmt: skip
    for (first, day), (then, later) in pairwise(days):
        if later < day:
            raise error("certificate.order", first=first, day=day, then=then, later=later)
    if words.adjustment.done != "none" and not words.adjustment.words:
        raise error("certificate.missing", names="adjustment.words")
    if words.place.kind != "laboratory" and not words.place.words:
        raise error("certificate.missing", names="place.words")


# -- results -------------------------------------------------------------------------------


def rounded(value: float, expanded: float) -> tuple[str, str]:
    """Write a value and its expanded uncertainty, which is rounded up to two digits.

    `value`, `expanded`: both in one unit [any].
    """
    place = math.floor(math.log10(expanded)) - 1
    up = math.ceil(expanded / 10.0**place - 1e-6)
    if up == 100:
        place, up = place + 1, 10
    decimals = max(0, -place)
    text = f"{round(value, -place):.{decimals}f}"
    return (text if float(text) else text.lstrip("-")), f"{up * 10.0**place:.{decimals}f}"


def _rows(result: Result, words: Said) -> tuple[list[Row], FloatArray]:
    """Return the coefficients that were calibrated, and their covariance [SI]."""
    vector = result.in_seconds
    free = np.flatnonzero(vector.free)
    sd = vector.sd
    good = np.isfinite(vector.values[free]) & np.isfinite(sd[free]) & (sd[free] > 0)
    if vector.cov is None or not len(free) or not good.all():
        lost = [vector.names[i] for i, g in zip(free, good, strict=True) if not g]
        raise error("certificate.unknown", names=listed(lost or ["every coefficient"]))
    earlier = _before(words)
    limit, largest = np.full(len(sd), np.inf), np.full(len(sd), np.inf)
    if words.conformity is not None:
        limits = tolerance.load(words.conformity.tolerance)
        limits.refuse_unknown([vector.names[i] for i in free], result.procedure)
        limit, largest = limits.limits(vector.names)
    groups: dict[str, list[float]] = {}
    for i in free:
        group = vector.names[i].rpartition(".")[0]
        groups.setdefault(group, []).append(max(abs(float(vector.values[i])), float(sd[i])))
    rows = []
    for i in free:
        c = vector.layout.coefficients[i]
        unit, one = unit_of(c.kind, groups[c.name.rpartition(".")[0]])
        x, u = float(vector.values[i]), float(sd[i])
        text, expanded = rounded(x / one, K * u / one)
        row: dict[str, Any] = {
            "name": c.name, "symbol": c.symbol, "meaning": c.meaning, "kind": c.kind, "value": x,
            "sd": u, "unit": unit, "shown": text, "expanded": expanded,
        }  # fmt: skip
        if c.name in earlier:
            y, v = earlier[c.name]
            row |= {"before": y, "before_sd": v,
                    "shown_before": " ± ".join(rounded(y / one, K * v / one))}  # fmt: skip
        if words.conformity is not None and math.isfinite(limit[i]):
            row |= _conformity(words.conformity.rule, x, u, float(limit[i]), float(largest[i]))
            row["shown_limit"] = f"{limit[i] / one:.6g}"
        rows.append(Row.model_validate(row))
    return rows, vector.cov[np.ix_(free, free)]


def _conformity(rule: str, x: float, u: float, limit: float, largest: float) -> dict[str, Any]:
    if rule == "guarded":
        number = int(tolerance.decided(np.array(x), np.array(u), np.array(limit), largest))
    else:
        number = tolerance.PASS if abs(x) <= limit and u <= largest else tolerance.FAIL
    return {"limit": limit, "decision": tolerance.DECISIONS[number],
            "probability": tolerance.conformity(x, u, limit)}  # fmt: skip


def _before(words: Said) -> dict[str, tuple[float, float]]:
    """Return the coefficients before adjustment with their standard uncertainties [SI]."""
    if not words.adjustment.before:
        return {}
    try:
        vector = load_result(words.adjustment.before).in_seconds
    except FoucaultError as problem:
        raise error("certificate.before", path=words.adjustment.before,
                    reason=problem.message.rstrip(".")) from None  # fmt: skip
    return {
        n: (float(x), float(s))
        for n, x, s, free in zip(vector.names, vector.values, vector.sd, vector.free, strict=True)
        if free and math.isfinite(x) and s > 0
    }
