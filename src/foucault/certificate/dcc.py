r"""The Digital Calibration Certificate: what a certificate says as XML, and what checks it.

The version is that of the schemas beside this file, `VERSION` and `SI_VERSION`; a later one is a
file more and these two names. Units are written by D-SI from the dimensions of our own kinds: a
ratio and a count are ``\one``, an angle is ``\radian``.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from foucault.certificate.content import COVERAGE, Certificate, K, Row
from foucault.certificate.labels import Labels
from foucault.certificate.said import Party
from foucault.errors import error, library
from foucault.units import KINDS, powers

VERSION = "3.2.1"
SI_VERSION = "2.1.0"
DCC = "https://ptb.de/dcc"
SI = "https://ptb.de/si"
DSIG = "http://www.w3.org/2000/09/xmldsig#"
SCHEMAS = Path(__file__).with_name("schemas")

UNITS = {
    "[length]": r"\metre", "[time]": r"\second", "[angle]": r"\radian",
    "[temperature]": r"\kelvin", "[magnetic_field]": r"\tesla",
    "[ratio]": r"\one", "[count]": r"\one",
}  # fmt: skip
"""Dimension of our units -> its SI unit as D-SI writes it."""


def conformity(row: Row) -> str:
    """Return a decision in the words of the DCC, which tell on which side an open one lies."""
    if row.decision != "undecided":
        return str(row.decision)
    inside = abs(row.value) <= (row.limit or 0.0)
    return "conditionalPass" if inside else "conditionalFail"


UNPRINTABLE = dict.fromkeys(
    (*range(9), 11, *range(12, 32), *range(0xD800, 0xE000), 0xFFFE, 0xFFFF),
    "\N{REPLACEMENT CHARACTER}",
)
"""What XML cannot hold."""

WORST = ("fail", "conditionalFail", "conditionalPass", "pass")


def unit(*kinds: str) -> str:
    r"""Return the SI unit of a product of quantities as D-SI writes it, such as ``\radian``.

    `kinds`: what each factor measures, keys of `units.KINDS`.
    """
    sums: dict[str, float] = {}
    for kind in kinds:
        for dimension, power in powers(KINDS[kind].si).items():
            name = UNITS[dimension]
            sums[name] = sums.get(name, 0.0) + power
    parts = [
        name if power == 1 else f"{name}\\tothe{{{power:g}}}"
        for name, power in sums.items() if power and name != r"\one"
    ]  # fmt: skip
    return "".join(parts) or r"\one"


def made(of: Certificate) -> bytes:
    """Return the DCC of a certificate, unsigned; raises ``certificate.library``."""
    with library("certificate.library", name="lxml"):
        from lxml import etree
    root = _Writer(of).root()
    etree.indent(root, space=" ")
    return bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8")) + b"\n"


class _Writer:
    """Writes the elements of one certificate."""

    def __init__(self, of: Certificate) -> None:
        self.of, self.labels = of, Labels(of.languages, of.labels)

    def e(self, name: str, *inside: Any, **attributes: str) -> Any:
        """Return an element, of D-SI where its name begins with "si:"; None in it is nothing."""
        from lxml import etree

        space, _, local = name.rpartition(":")
        out = etree.Element(
            f"{{{SI if space else DCC}}}{local}", nsmap={"dcc": DCC, "si": SI}, **attributes
        )
        for one in inside:
            if isinstance(one, str):
                out.text = one.translate(UNPRINTABLE)
            elif one is not None:
                out.append(one)
        return out

    def some(self, name: str, text: str) -> Any:
        """Return an element with a text, None of an empty one."""
        return self.e(name, text) if text else None

    def text(self, name: str, text: str) -> Any:
        """Return what people have written, in whatever language."""
        return self.e(name, self.e("content", text))

    def said(self, name: str, key: str, **values: Any) -> Any:
        """Return words of the labels in all languages."""
        both = zip(self.labels.languages, self.labels.words, strict=True)
        return self.e(name, *(
            self.e("content", words[key].format(**values), lang=lang) for lang, words in both
        ))  # fmt: skip

    def root(self) -> Any:
        root = self.e("digitalCalibrationCertificate", self.administrative(), self.e(
            "measurementResults", *self.measurements()), schemaVersion=VERSION)  # fmt: skip
        root.set("{http://www.w3.org/2001/XMLSchema-instance}schemaLocation",
                 f"{DCC} https://ptb.de/dcc/v{VERSION}/dcc.xsd")  # fmt: skip
        return root

    # -- who, what, when ------------------------------------------------------------------

    def administrative(self) -> Any:
        of, e = self.of, self.e
        program, _, version = of.run.software.partition(" ")
        return e(
            "administrativeData",
            e("dccSoftware", e("software", self.text("name", program),
                               e("release", version or "unknown"), e("type", "application"))),
            e("coreData",
              e("countryCodeISO3166_1", of.laboratory.country),
              *(e("usedLangCodeISO639_1", one) for one in of.languages),
              e("mandatoryLangCodeISO639_1", of.languages[0]),
              e("uniqueIdentifier", of.number),
              e("receiptDate", of.received.isoformat()),
              e("beginPerformanceDate", of.performed.isoformat()),
              e("endPerformanceDate", (of.performed_until or of.performed).isoformat()),
              e("performanceLocation", of.place.kind),
              e("issueDate", of.issued.isoformat()),
              *self.replaced()),
            self.item(),
            e("calibrationLaboratory",
              self.some("calibrationLaboratoryCode", of.laboratory.accreditation),
              self.contact("contact", of.laboratory)),
            e("respPersons", e("respPerson",
                               e("person", self.text("name", of.authorised_by.name)),
                               e("role", of.authorised_by.role), e("mainSigner", "true"))),
            self.contact("customer", of.customer),
            e("statements", *self.statements()),
        )  # fmt: skip

    def replaced(self) -> Iterable[Any]:
        before, e = self.of.replaces, self.e
        if before is not None:
            yield e("reportAmendedSubstituted", e("typeOfChange", "substituted"),
                    e("replacedUniqueIdentifier", before.number))  # fmt: skip
            yield e("previousReport", self.text("referral", before.number),
                    e("referralID", before.number), e("procedure", "SHA-256"),
                    e("value", before.sha256), self.text("description", before.change))  # fmt: skip

    def contact(self, name: str, party: Party) -> Any:
        e = self.e
        where = e("location", e("city", party.city), e("countryCode", party.country),
                  e("postCode", party.postcode), e("street", party.street))  # fmt: skip
        return e(name, self.text("name", party.name), self.some("eMail", party.email),
                 self.some("phone", party.phone), where)  # fmt: skip

    def item(self) -> Any:
        e, item = self.e, self.of.item
        named = (("manufacturer", item.serial, "serial"),
                 ("customer", item.customer_id, "customer_id"))  # fmt: skip
        return e("items", e(
            "item", self.text("name", item.description), self.text("description", item.condition),
            e("manufacturer", self.text("name", item.manufacturer)) if item.manufacturer else None,
            e("model", item.model),
            e("identifications", *(
                e("identification", e("issuer", issuer), e("value", value),
                  self.said("name", f"label.{key}"))
                for issuer, value, key in named if value)),
        ))  # fmt: skip

    def statements(self) -> Iterable[Any]:
        of, e = self.of, self.e
        for key in ("text.only", "text.whole"):
            yield e("statement", self.said("declaration", key))
        if of.conformity is not None and of.decision is not None:
            each = {conformity(r) for r in of.rows if r.decision is not None}
            yield e(
                "statement", self.text("name", of.conformity.specification),
                e("norm", "ISO/IEC Guide 98-4"),
                self.said("declaration", f"text.{of.conformity.rule}", risk=f"{of.risk:.3g}"),
                e("conformity", next(w for w in WORST if w in each)),
            )  # fmt: skip
        else:
            yield e("statement", self.said("declaration", "text.no_conformity"))
        words = {
            "opinions": of.opinions, "from_customer": of.from_customer, "external": of.external,
            "next_due": of.next_due, "deviations": of.method.deviations, "place": of.place.words,
            "words": of.adjustment.words, "log": "; ".join(" ".join(one) for one in of.run.logs),
            "result": f"SHA-256 {of.run.sha256}", "entry": of.run.entry,
        }  # fmt: skip
        if of.review is not None:
            words |= {"reviewer": of.review.reviewer, "reason": of.review.reason,
                      "checks": " ".join(of.run.reasons)}  # fmt: skip
        for key, text in words.items():
            if text.strip():
                yield e("statement", self.said("name", f"label.{key}"),
                        self.text("declaration", text))  # fmt: skip
        for what, why in of.unused.items():
            yield e("statement", self.said("name", f"word.{what}"),
                    self.said("declaration", "word.not_used", why=why))  # fmt: skip

    # -- results --------------------------------------------------------------------------

    def measurements(self) -> Iterable[Any]:
        """Yield the results, those before an adjustment first."""
        rows, done = self.of.rows, self.of.adjustment.done
        what = {"adjusted": "Adjustment", "repaired": "Repair", "none": ""}[done]
        earlier = [r for r in rows if r.before is not None]
        if earlier and what:
            values = [(r.before or 0.0, r.before_sd or 0.0) for r in earlier]
            yield self.measurement(f"before{what}", self.quantity(earlier, values))
        now = self.quantity(rows, [(r.value, r.sd) for r in rows], self.of.covariance)
        yield self.measurement(f"after{what}" if what else "", now, self.left_out())

    def measurement(self, status: str, quantity: Any, *more: Any) -> Any:
        of, e = self.of, self.e
        run = of.run
        told = "; ".join(filter(None, (run.equation, run.frame, run.gauge)))
        method = e("usedMethod", self.text("name", of.method.name), self.text("description", told),
                   self.some("reference", of.method.document))  # fmt: skip
        tools = [
            e("measuringEquipment", self.text("name", one.name),
              self.said("description", f"word.{one.what}"),
              e("identifications", e(
                  "identification", e("issuer", "other"), e("value", one.certificate),
                  self.text("name", f"{one.issuer} {one.due or ''}".strip() or "certificate"))))
            for one in of.traced
        ]  # fmt: skip
        return e(
            "measurementResult", self.said("name", "section.results"),
            e("usedMethods", method), e("measuringEquipments", *tools) if tools else None,
            e("influenceConditions", *self.conditions(status)),
            e("results", e("result", self.said("name", "section.results"),
                           self.said("description", "text.results"), e("data", quantity)), *more),
        )  # fmt: skip

    def left_out(self) -> Any:
        if not self.of.left_out:
            return None
        lines = [f"{t.what}: {t.size} (1 sd), type B; {t.basis}; share {t.share:.3g}"
                 for t in self.of.left_out]  # fmt: skip
        return self.e("result", self.said("name", "section.left_out"),
                      self.e("data", *(self.text("text", line) for line in lines)))  # fmt: skip

    def conditions(self, status: str) -> Iterable[Any]:
        of, e = self.of, self.e

        def one(key: str, data: Any) -> Any:
            state = self.some("status", status) if key == "temperature" else None
            return e("influenceCondition", self.said("name", f"label.{key}"), state,
                     e("data", data))  # fmt: skip

        for key in ("temperature", "humidity", "pressure", "more"):
            if words := getattr(of.conditions, key):
                yield one(key, self.text("text", words))
        if of.run.temperature is not None:
            span = e("si:realListXMLList", e("si:valueXMLList", _numbers(of.run.temperature)),
                     e("si:unitXMLList", r"\kelvin"))  # fmt: skip
            yield one("temperature_log", e("quantity", span))
        for key, kind, value, sd in (
            ("gravity", "gravity", of.run.gravity, of.run.gravity_sd),
            ("clock", "scale factor error", 0.0, of.run.clock_sd),
        ):
            if value is not None and sd is not None:
                yield one(key, e("quantity", e(
                    "si:real", e("si:value", _numbers([value])), e("si:unit", unit(kind)),
                    self.expanded("", [sd]))))  # fmt: skip

    def expanded(self, plural: str, sd: Sequence[float]) -> Any:
        """Return expanded uncertainties of `sd` [SI]; `plural`: "XMLList" of several."""
        n = len(sd)
        said = {
            "uncertainty": _numbers([K * u for u in sd]), "coverageFactor": _numbers([K] * n),
            "coverageProbability": _numbers([COVERAGE] * n),
            "distribution": " ".join(["normal"] * n),
        }  # fmt: skip
        return self.e(f"si:expandedUnc{plural}",
                      *(self.e(f"si:{k}{plural}", v) for k, v in said.items()))  # fmt: skip

    def quantity(
        self, rows: Sequence[Row], values: Sequence[tuple[float, float]],
        cov: Sequence[Sequence[float]] = (),
    ) -> Any:  # fmt: skip
        """Return values with their sd [SI], and their covariance where that is known."""
        e, n = self.e, len(rows)
        region = metadata = None
        if len(cov):
            columns = (
                e("si:column", *(
                    e("si:covariance", e("si:value", _numbers([cov[i][j]])),
                      e("si:unit", unit(rows[i].kind, rows[j].kind)))
                    for i in range(n)
                ))
                for j in range(n)
            )  # fmt: skip
            region = e(
                "si:ellipsoidalRegionXMLList", e("si:covarianceMatrix", *columns),
                e("si:coverageFactor", f"{_joint(n):.4f}"),
                e("si:coverageProbability", f"{COVERAGE}"), e("si:distribution", "normal"),
            )  # fmt: skip
            limited = [r for r in rows if r.limit is not None]
            metadata = e("measurementMetaData", *(
                e("metaData", self.text("name", r.name),
                  self.text("description", f"|x| <= {r.limit!r} {unit(r.kind)}"),
                  e("conformity", conformity(r)))
                for r in limited)) if limited else None  # fmt: skip
        return e("quantity", self.said("name", "column.coefficient"), e(
            "si:realListXMLList",
            e("si:labelXMLList", " ".join(r.name for r in rows)),
            e("si:valueXMLList", _numbers([x for x, _ in values])),
            e("si:unitXMLList", " ".join(unit(r.kind) for r in rows)),
            self.expanded("XMLList", [u for _, u in values]), region,
        ), metadata)  # fmt: skip


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(v)) for v in values)


def _joint(n: int) -> float:
    """Return the factor by which an ellipsoid of `n` coefficients covers as k = 2 does of one."""
    from scipy.stats import chi2

    return math.sqrt(chi2.ppf(COVERAGE, n))


# -- reading -------------------------------------------------------------------------------


@cache
def schema() -> Any:
    """Return the schema, read without a network."""
    with library("certificate.library", name="xmlschema"):
        import xmlschema
    signature = Path(xmlschema.__file__).parent / "schemas" / "DSIG" / "xmldsig-core-schema.xsd"
    return xmlschema.XMLSchema(
        str(SCHEMAS / f"dcc-{VERSION}.xsd"), allow="local",
        locations={SI: str(SCHEMAS / f"SI_Format-{SI_VERSION}.xsd"), DSIG: str(signature)},
    )  # fmt: skip


def faults(data: bytes) -> list[str]:
    """Return what of a DCC does not keep to the schema, each in words."""
    found = (f"{f.path}: {f.reason}" for f in schema().iter_errors(io.BytesIO(data)))
    return [re.sub(r"\{https?://[^}]*\}", "", one) for one in found]


def parsed(data: bytes, path: str | Path) -> Any:
    """Return the root of a DCC; raises ``certificate.xml``: it is none. Nothing is looked up."""
    from lxml import etree

    parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=False)
    try:
        root = etree.fromstring(data, parser)
    except (etree.XMLSyntaxError, ValueError) as problem:
        raise error("certificate.xml", path=path, reason=problem) from None
    if root.getroottree().docinfo.doctype:
        raise error("certificate.xml", path=path, reason="it declares entities (DOCTYPE)")
    if root.tag != f"{{{DCC}}}digitalCalibrationCertificate":
        raise error("certificate.xml", path=path, reason=f"it begins with {root.tag}")
    return root


def identity(root: Any) -> Mapping[str, str]:
    """Return what a DCC is called, what it replaces and when it was issued."""
    core = f"{{{DCC}}}administrativeData/{{{DCC}}}coreData/"
    return {
        "number": root.findtext(f"{core}{{{DCC}}}uniqueIdentifier") or "",
        "issued": root.findtext(f"{core}{{{DCC}}}issueDate") or "",
        "replaces": root.findtext(
            f"{core}{{{DCC}}}reportAmendedSubstituted/{{{DCC}}}replacedUniqueIdentifier"
        ) or "",
    }  # fmt: skip
