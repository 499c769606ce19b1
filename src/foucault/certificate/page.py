"""A certificate as a PDF/A-3b: what it says laid out in blocks, which one template prints.

The template prints texts and never runs them. Its fonts are those that Typst brings, its date is
the day of issue, so that the same content makes the same bytes.
"""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from foucault.certificate.content import Certificate
from foucault.certificate.labels import Labels
from foucault.certificate.said import WHATS, Party
from foucault.coefficients import format_value
from foucault.errors import error, library
from foucault.report.page import shown

DCC_FILE = "dcc.xml"
"""Name of the Digital Calibration Certificate within the PDF."""

LOGOS = (".png", ".jpg", ".jpeg", ".svg")

Block = dict[str, Any]


def made(of: Certificate, dcc: bytes, *, signed: bool) -> bytes:
    """Return the PDF, with the DCC in it; `signed`: whether it will be."""
    with library("certificate.library", name="Typst"):
        import typst
    labels = Labels(of.languages, of.labels)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        logo = _logo(of.laboratory.logo, folder)
        content = {
            "lang": labels.languages[0], "colour": of.laboratory.colour, "logo": logo,
            "title": labels.said("title"), "number": of.number, "called": labels.said("number"),
            "page": labels.first("page"), "of": labels.first("of"), "end": labels.said("end"),
            "issued": [of.issued.year, of.issued.month, of.issued.day],
            "laboratory": _address(of.laboratory), "footer": of.laboratory.footer,
            "accreditation": of.laboratory.accreditation, "dcc": DCC_FILE,
            "replaces": [] if of.replaces is None
            else labels.said("text.replaces", number=of.replaces.number),
            "blocks": blocks(of, labels, dcc, signed=signed),
        }  # fmt: skip
        (folder / "content.json").write_text(json.dumps(content), encoding="utf-8")
        (folder / DCC_FILE).write_bytes(dcc)
        template = Path(__file__).with_name("page.typ")
        (folder / "page.typ").write_text(template.read_text(encoding="utf-8"), encoding="utf-8")
        try:
            return _compiled(
                input=str(folder / "page.typ"), root=str(folder), format="pdf",
                ignore_system_fonts=True, pdf_standards=["a-3b"], timestamp=of.dated,
            )  # fmt: skip
        except (typst.TypstError, subprocess.CalledProcessError) as problem:
            if not logo:
                raise
            reason = getattr(problem, "message", "it cannot be read")
            raise error("certificate.logo", path=of.laboratory.logo, reason=reason,
                        allowed=", ".join(LOGOS)) from None  # fmt: skip


_threads_in: list[int] = []
"""The process in which Typst has its threads."""


def _compiled(**how: Any) -> bytes:
    """Return what Typst makes; where it ran before this fork, whose threads it lacks, by another.

    Without them it would wait for ever.
    """
    import typst

    if _threads_in and os.getpid() not in _threads_in:
        code = "import pickle, sys, typst; k = pickle.load(sys.stdin.buffer); "
        code += "sys.stdout.buffer.write(typst.compile(**k))"
        return subprocess.run(
            [sys.executable, "-c", code],
            input=pickle.dumps(how),
            stdout=subprocess.PIPE,
            check=True,
        ).stdout
    _threads_in.append(os.getpid())
    return bytes(typst.compile(**how))


def _logo(path: str, folder: Path) -> str:
    """Copy the picture of the laboratory beside the template; empty without one."""
    if not path:
        return ""
    file = Path(path)
    if file.suffix.lower() not in LOGOS or not file.is_file():
        raise error("certificate.logo", path=path, allowed=", ".join(LOGOS),
                    reason="it is not there, or of another kind")  # fmt: skip
    name = f"logo{file.suffix.lower()}"
    (folder / name).write_bytes(file.read_bytes())
    return name


def _address(party: Party) -> list[str]:
    return [party.name, party.street, f"{party.country}-{party.postcode} {party.city}",
            *filter(None, (party.email, party.phone))]  # fmt: skip


def blocks(of: Certificate, labels: Labels, dcc: bytes, *, signed: bool) -> list[Block]:
    """Return what is printed, from top to bottom."""

    def facts(section: str, *pairs: tuple[str, str | list[str]],
              lead: Sequence[list[str]] = (), **more: Any) -> Block:  # fmt: skip
        rows = [
            {"label": labels.said(f"label.{key}"), "text": [t] if isinstance(t, str) else t}
            for key, t in pairs if t
        ]  # fmt: skip
        return {"kind": "facts", "title": labels.said(f"section.{section}"), "rows": rows,
                "lead": list(lead), **more}  # fmt: skip

    def word(key: str, **values: Any) -> list[str]:
        return labels.said(f"word.{key}", **values)

    run, item, until = of.run, of.item, of.performed_until
    performed = of.performed.isoformat()
    days = [performed] if until in (None, of.performed) else word(
        "until", first=performed, last=until)  # fmt: skip
    log = [f"{name}, SHA-256 {digest}" if digest else name for name, digest in run.logs]
    out = [
        {"kind": "pair", "blocks": [
            {"kind": "lines", "title": labels.said("section.customer"),
             "lines": _address(of.customer)},
            facts("item", *((k, getattr(item, k)) for k in (
                "description", "manufacturer", "model", "serial", "customer_id", "condition"))),
        ]},
        facts("dates", ("received", of.received.isoformat()), ("performed", days),
              ("issued", of.issued.isoformat()), ("next_due", of.next_due)),
        facts("method", ("method", of.method.name), ("document", of.method.document),
              ("deviations", of.method.deviations), ("equation", run.equation.replace(";  ", "\n")),
              ("frame", run.frame), ("gauge", run.gauge), ("software", run.software),
              *(("log", one) for one in log), ("result", f"result.json, SHA-256 {run.sha256}"),
              ("entry", run.entry)),
        facts("conditions", ("place", _place(of, labels)),
              *((k, getattr(of.conditions, k))
                for k in ("temperature", "humidity", "pressure", "more")),
              ("gravity", _gravity(of, labels)), ("clock", _clock(of, labels))),
        _traceability(of, labels),
        _results(of, labels),
        _left_out(of, labels),
        facts("adjustment", ("done", word(of.adjustment.done)), ("words", of.adjustment.words),
              ("before", [] if of.adjustment.done == "none" or of.adjustment.before
               else word("not_available"))),
        _conformity(of, labels, facts),
    ]  # fmt: skip
    if of.review is not None:
        out.append(facts(
            "review", ("verdict", word(str(run.verdict))), ("checks", " ".join(run.reasons)),
            ("reviewer", of.review.reviewer), ("reason", of.review.reason),
            lead=[labels.said("text.review")], framed=True,
        ))  # fmt: skip
    digest = hashlib.sha256(dcc).hexdigest()
    replaced = [] if of.replaces is None else [("change", of.replaces.change)]
    out.append(facts(
        "statements", *replaced, ("opinions", of.opinions), ("from_customer", of.from_customer),
        ("external", of.external),
        lead=[labels.said("text.only"), labels.said("text.whole"),
              labels.said("text.digital", sha256=digest),
              *([labels.said("text.signed")] if signed else [])],
    ))  # fmt: skip
    out.append({
        "kind": "signature", "title": labels.said("section.authorised"),
        "name": of.authorised_by.name, "role": of.authorised_by.role,
        "signature": [] if signed else labels.said("label.signature"),
        "issued": of.issued.isoformat(),
    })  # fmt: skip
    return out


def _place(of: Certificate, labels: Labels) -> list[str]:
    where = [] if of.place.kind == "other" else labels.said(f"word.{of.place.kind}")
    return [*where, *([of.place.words] if of.place.words else [])]


def _gravity(of: Certificate, labels: Labels) -> str:
    if of.run.gravity is None:
        return ""
    g, sd = of.run.gravity, of.run.gravity_sd
    texts = [format_value(x, sd) for x in (g, sd)] if sd else [f"{g:.5f}"]
    return labels.number(" ± ".join(texts)) + " m/s²"


def _clock(of: Certificate, labels: Labels) -> list[str]:
    if of.run.clock_sd is None:
        return labels.said("word.clock_unknown")
    return labels.said("word.ppm", sd=labels.number(f"{of.run.clock_sd * 1e6:.3g}"))


def _table(labels: Labels, section: str, columns: str, rows: list[list[Any]], **more: Any) -> Block:
    """Return a table; a column is "key" or "key:look", of which a wide one takes what is left."""
    heads = [
        {"label": labels.said(f"column.{key}"), "look": look}
        for key, _, look in (c.partition(":") for c in columns.split())
    ]
    return {"kind": "table", "title": labels.said(f"section.{section}"), "columns": heads,
            "rows": rows, "lead": [], "after": [], **more}  # fmt: skip


def _traceability(of: Certificate, labels: Labels) -> Block:
    rows = [
        [labels.said(f"word.{one.what}"), one.name, one.certificate, one.issuer,
         "" if one.due is None else one.due.isoformat()]
        for one in of.traced
    ]  # fmt: skip
    rows += [
        [labels.said(f"word.{what}"), labels.first("word.not_used", why=of.unused[what]),
         "", "", ""]
        for what in WHATS if what in of.unused
    ]  # fmt: skip
    columns = "what reference:wide certificate:wide issuer:wide due"
    return _table(labels, "traceability", columns, rows)


def _results(of: Certificate, labels: Labels) -> Block:
    before = any(r.shown_before for r in of.rows)
    limited = any(r.decision is not None for r in of.rows)
    columns = ["coefficient:wide", "symbol:symbol"]
    columns += ["before:number"] if before else []
    columns += ["value:number", "expanded:number", "unit"]
    columns += ["limit:number", "decision", "probability:number"] if limited else []
    rows = []
    for r in of.rows:
        cells: list[Any] = [{"name": r.name, "text": labels.meaning(r.name, r.meaning)}, r.symbol]
        cells += [labels.number(r.shown_before)] if before else []
        cells += [labels.number(r.shown), labels.number(r.expanded), r.unit]
        if limited:
            sure = "" if r.probability is None else labels.number(_percent(r.probability, 1))
            cells += [labels.number(f"±{r.shown_limit}") if r.shown_limit else "",
                      labels.said(f"word.{r.decision}") if r.decision else "", sure]  # fmt: skip
        rows.append(cells)
    held = [labels.said("text.held", names=", ".join(of.held))] if of.held else []
    keys = ["results"] if of.adjustment.done == "none" else ["results", "after"]
    lead = [labels.said(f"text.{key}") for key in keys]
    return _table(labels, "results", " ".join(columns), rows, lead=lead, after=held)


def _percent(part: float, digits: int) -> str:
    """Write a probability in percent; nothing is certain."""
    least, percent = 10.0**-digits, 100.0 * part
    if percent < least:
        return f"< {least:.{digits}f} %"
    if percent > 100.0 - least:
        return f"> {100.0 - least:.{digits}f} %"
    return f"{percent:.{digits}f} %"


def _left_out(of: Certificate, labels: Labels) -> Block:
    if of.left_out is None:
        return {"kind": "facts", "title": labels.said("section.left_out"), "rows": [],
                "lead": [labels.said("text.left_out_none")]}  # fmt: skip
    rows = [[one.what, labels.number(shown(one.size)), one.basis,
             labels.number(f"{100 * one.share:.1f} %")] for one in of.left_out]  # fmt: skip
    return _table(labels, "left_out", "term:wide size:number basis:wide share:number", rows,
                  lead=[labels.said("text.left_out")])  # fmt: skip


def _conformity(of: Certificate, labels: Labels, facts: Callable[..., Block]) -> Block:
    if of.conformity is None or of.decision is None:
        return facts("conformity", lead=[labels.said("text.no_conformity")])
    key = {"pass": "conforms", "fail": "conforms_not", "undecided": "conforms_undecided"}
    risk = labels.number(_percent(of.risk, 2).lstrip("< "))
    return facts(
        "conformity", ("specification", of.conformity.specification),
        lead=[labels.said(f"text.{key[of.decision]}"),
              labels.said(f"text.{of.conformity.rule}", risk=risk)],
    )  # fmt: skip
