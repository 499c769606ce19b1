r"""The Digital Calibration Certificate: what a certificate says as XML, and what checks it.

The version is that of the schemas beside this file, `VERSION` and `SI_VERSION`; a later one is a
file more and these two names. Units are written by D-SI from the dimensions of our own kinds: a
ratio and a count are ``\one``, an angle is ``\radian``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from foucault.certificate.content import COVERAGE, Certificate, K, Row
from foucault.certificate.labels import Labels
from foucault.certificate.said import WHATS, Party
from foucault.errors import error
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
    try:
        from lxml import etree
    except ImportError:
        raise error("certificate.library", name="lxml") from None
    root = _Writer(of).root()
    etree.indent(root, space=" ")
    return bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8")) + b"\n"


class _Writer:
    """Writes the elements of one certificate."""

    def __init__(self, of: Certificate) -> None:
        self.of, self.labels = of, Labels(of.languages, of.labels)

    def e(self, name: str, *inside: Any, **attributes: str) -> Any:
        """Return an element `name`, of D-SI where that begins with "si:", with what is in it."""
        from lxml import etree

        space, _, local = name.rpartition(":")
        out = etree.Element(
            f"{{{SI if space else DCC}}}{local}", nsmap={"dcc": DCC, "si": SI}, **attributes
        )
        for one in inside:
            if isinstance(one, str):
                out.text = one.translate(UNPRINTABLE)
            else:
                out.append(one)
        return out

    def text(self, name: str, texts: str | Sequence[str]) -> Any:
        """Return a text; one for all languages stands there without a language."""
        if isinstance(texts, str):
            return self.e(name, self.e("content", texts))
        named = zip(self.labels.languages, texts, strict=False)
        alone = len(texts) == 1
        return self.e(name, *(
            self.e("content", t, **({} if alone else {"lang": lang})) for lang, t in named
        ))  # fmt: skip

    def said(self, name: str, key: str, **values: Any) -> Any:
        """Return words of the labels in all languages."""
        texts = [w[key].format(**values) for w in self.labels.words]
        return self.e(name, *(
            self.e("content", t, lang=lang)
            for lang, t in zip(self.labels.languages, texts, strict=True)
        ))  # fmt: skip

    def root(self) -> Any:
        root = self.e("digitalCalibrationCertificate", self.administrative(), self.e(
            "measurementResults", *self.measurements()), schemaVersion=VERSION)  # fmt: skip
        root.set(
            "{http://www.w3.org/2001/XMLSchema-instance}schemaLocation",
            f"{DCC} https://ptb.de/dcc/v{VERSION}/dcc.xsd",
        )
        return root

    # -- who, what, when ------------------------------------------------------------------

    def administrative(self) -> Any:
        of, e = self.of, self.e
        until = of.performed_until or of.performed
        places = {"laboratory": "laboratory", "customer": "customer", "other": "other"}
        core = e(
            "coreData",
            e("countryCodeISO3166_1", of.laboratory.country),
            *(e("usedLangCodeISO639_1", one) for one in of.languages),
            e("mandatoryLangCodeISO639_1", of.languages[0]),
            e("uniqueIdentifier", of.number),
            e("receiptDate", of.received.isoformat()),
            e("beginPerformanceDate", of.performed.isoformat()),
            e("endPerformanceDate", until.isoformat()),
            e("performanceLocation", places[of.place.kind]),
            e("issueDate", of.issued.isoformat()),
            *self.replaced(),
        )
        program, _, version = of.run.software.partition(" ")
        software = e("software", self.text("name", program), e("release", version or "unknown"),
                     e("type", "application"))  # fmt: skip
        person = e(
            "respPerson", e("person", self.text("name", of.authorised_by.name)),
            e("role", of.authorised_by.role), e("mainSigner", "true"),
        )  # fmt: skip
        return e(
            "administrativeData", e("dccSoftware", software), core, self.items(),
            e("calibrationLaboratory",
              *([e("calibrationLaboratoryCode", of.laboratory.accreditation)]
                if of.laboratory.accreditation else []),
              self.contact("contact", of.laboratory)),
            e("respPersons", person), self.contact("customer", of.customer),
            e("statements", *self.statements()),
        )  # fmt: skip

    def replaced(self) -> list[Any]:
        before, e = self.of.replaces, self.e
        if before is None:
            return []
        return [
            e("reportAmendedSubstituted", e("typeOfChange", "substituted"),
              e("replacedUniqueIdentifier", before.number)),
            e("previousReport", self.text("referral", before.number),
              e("referralID", before.number), e("procedure", "SHA-256"),
              e("value", before.sha256), self.text("description", before.change)),
        ]  # fmt: skip

    def contact(self, name: str, party: Party) -> Any:
        e = self.e
        more = [e(tag, text) for tag, text in (("eMail", party.email), ("phone", party.phone))
                if text]  # fmt: skip
        where = e("location", e("city", party.city), e("countryCode", party.country),
                  e("postCode", party.postcode), e("street", party.street))  # fmt: skip
        return e(name, self.text("name", party.name), *more, where)

    def items(self) -> Any:
        e, item = self.e, self.of.item
        named = [e("identification", e("issuer", "manufacturer"), e("value", item.serial),
                   self.said("name", "label.serial"))]  # fmt: skip
        if item.customer_id:
            named.append(e("identification", e("issuer", "customer"),
                           e("value", item.customer_id)))  # fmt: skip
        maker = [e("manufacturer", self.text("name", item.manufacturer))] if item.manufacturer \
            else []  # fmt: skip
        return e("items", e("item", self.text("name", item.description),
                            self.text("description", item.condition), *maker,
                            e("model", item.model), e("identifications", *named)))  # fmt: skip

    def statements(self) -> Iterable[Any]:
        of = self.of
        for key in ("text.only", "text.whole"):
            yield self.e("statement", self.said("declaration", key))
        if of.conformity is not None and of.decision is not None:
            each = {conformity(r) for r in of.rows if r.decision is not None}
            yield self.e(
                "statement", self.text("name", of.conformity.specification),
                self.e("norm", "ISO/IEC Guide 98-4"),
                self.said("declaration", f"text.{of.conformity.rule}", risk=f"{of.risk:.3g}"),
                self.e("conformity", next(w for w in WORST if w in each)),
            )  # fmt: skip
        else:
            yield self.e("statement", self.said("declaration", "text.no_conformity"))
        words = [("opinions", of.opinions), ("from_customer", of.from_customer),
                 ("external", of.external), ("next_due", of.next_due),
                 ("deviations", of.method.deviations), ("words", of.adjustment.words)]  # fmt: skip
        if of.review is not None:
            words += [("reviewer", of.review.reviewer), ("reason", of.review.reason),
                      ("checks", " ".join(of.run.reasons))]  # fmt: skip
        for key, text in words:
            if text:
                yield self.e("statement", self.said("name", f"label.{key}"),
                             self.text("declaration", text))  # fmt: skip
        for what in WHATS:
            if what in of.unused:
                yield self.e("statement", self.said("name", f"word.{what}"), self.said(
                    "declaration", "word.not_used", why=of.unused[what]))  # fmt: skip

    # -- results --------------------------------------------------------------------------

    def measurements(self) -> Iterable[Any]:
        rows = self.of.rows
        if any(r.before is not None for r in rows):
            yield self.measurement(
                [r for r in rows if r.before is not None], "beforeAdjustment", None
            )
        status = {"none": "", "adjusted": "afterAdjustment", "repaired": "afterRepair"}
        yield self.measurement(rows, status[self.of.adjustment.done], self.of.covariance)

    def measurement(
        self, rows: Sequence[Row], status: str, cov: Sequence[Sequence[float]] | None
    ) -> Any:
        of, e = self.of, self.e
        document = [e("reference", of.method.document)] if of.method.document else []
        method = e("usedMethod", self.text("name", of.method.name),
                   self.text("description", of.run.equation), *document)  # fmt: skip
        before = cov is None
        values = [(r.before or 0.0, r.before_sd or 0.0) if before else (r.value, r.sd)
                  for r in rows]  # fmt: skip
        results = [e("result", self.said("name", "section.results"),
                     self.said("description", "text.results"),
                     e("data", self.quantity(rows, values, cov)))]  # fmt: skip
        if not before and of.left_out:
            lines = [f"{t.what}: {t.size} (1 sd), type B; {t.basis}; share {t.share:.3g}"
                     for t in of.left_out]  # fmt: skip
            results.append(e("result", self.said("name", "section.left_out"), e(
                "data", *(self.text("text", line) for line in lines))))  # fmt: skip
        equipment = [
            e("measuringEquipment", self.text("name", one.name),
              self.said("description", f"word.{one.what}"),
              e("identifications", e(
                  "identification", e("issuer", "other"), e("value", one.certificate),
                  self.text("name", " ".join(filter(None, (
                      one.issuer, one.due.isoformat() if one.due else "")))
                      or "certificate"))))
            for one in of.traced
        ]  # fmt: skip
        tools = [e("measuringEquipments", *equipment)] if equipment else []
        return e(
            "measurementResult", self.said("name", "section.results"),
            e("usedMethods", method), *tools,
            e("influenceConditions", *self.conditions(status)), e("results", *results),
        )  # fmt: skip

    def conditions(self, status: str) -> Iterable[Any]:
        of, e = self.of, self.e

        def one(key: str, *data: Any) -> Any:
            state = [e("status", status)] if status and key == "temperature" else []
            return e("influenceCondition", self.said("name", f"label.{key}"), *state,
                     e("data", *data))  # fmt: skip

        for key in ("temperature", "humidity", "pressure", "more"):
            words = getattr(of.conditions, key)
            if words:
                yield one(key, self.text("text", words))
        if of.run.temperature is not None:
            yield one("temperature_log", e("quantity", e(
                "si:realListXMLList", e("si:valueXMLList", _numbers(of.run.temperature)),
                e("si:unitXMLList", r"\kelvin"))))  # fmt: skip
        if of.run.gravity is not None:
            yield one("gravity", e("quantity", self.real(
                of.run.gravity, "gravity", of.run.gravity_sd)))  # fmt: skip
        if of.run.clock_sd is not None:
            yield one("clock", e("quantity", self.real(
                0.0, "scale factor error", of.run.clock_sd)))  # fmt: skip

    def real(self, value: float, kind: str, sd: float | None) -> Any:
        e = self.e
        known = [] if sd is None else [self.expanded("", K * sd, K, COVERAGE)]
        return e("si:real", e("si:value", _number(value)), e("si:unit", unit(kind)), *known)

    def expanded(self, plural: str, u: Any, k: Any, p: Any) -> Any:
        """Return expanded uncertainties; `plural`: "XMLList" of several."""
        e = self.e
        texts = [_numbers(v if isinstance(v, Sequence) else [v]) for v in (u, k, p)]
        names = ("uncertainty", "coverageFactor", "coverageProbability")
        kind = "normal" if not plural else " ".join(["normal"] * len(u))
        return e(f"si:expandedUnc{plural}",
                 *(e(f"si:{n}{plural}", t) for n, t in zip(names, texts, strict=True)),
                 e(f"si:distribution{plural}", kind))  # fmt: skip

    def quantity(
        self, rows: Sequence[Row], values: Sequence[tuple[float, float]],
        cov: Sequence[Sequence[float]] | None,
    ) -> Any:  # fmt: skip
        e, n = self.e, len(rows)
        inside = [
            e("si:labelXMLList", " ".join(r.name for r in rows)),
            e("si:valueXMLList", _numbers([x for x, _ in values])),
            e("si:unitXMLList", " ".join(unit(r.kind) for r in rows)),
            self.expanded("XMLList", [K * u for _, u in values], [K] * n, [COVERAGE] * n),
        ]
        if cov is not None:
            columns = [
                e("si:column", *(
                    e("si:covariance", e("si:value", _number(cov[i][j])),
                      e("si:unit", unit(rows[i].kind, rows[j].kind)))
                    for i in range(n)
                ))
                for j in range(n)
            ]  # fmt: skip
            inside.append(e(
                "si:ellipsoidalRegionXMLList", e("si:covarianceMatrix", *columns),
                e("si:coverageFactor", f"{_joint(n):.4f}"),
                e("si:coverageProbability", f"{COVERAGE}"), e("si:distribution", "normal"),
            ))  # fmt: skip
        known = e("si:realListXMLList", *inside)
        more = []
        limited = [r for r in rows if r.decision is not None]
        if limited and cov is not None:
            more = [e("measurementMetaData", *(
                e("metaData", self.text("name", r.name),
                  self.text("description", f"|x| <= {_number(r.limit or 0.0)} {unit(r.kind)}"),
                  e("conformity", conformity(r)))
                for r in limited))]  # fmt: skip
        return e("quantity", self.said("name", "column.coefficient"), known, *more)


def _number(value: float) -> str:
    return repr(float(value))


def _numbers(values: Iterable[float]) -> str:
    return " ".join(map(_number, values))


def _joint(n: int) -> float:
    """Return the factor by which an ellipsoid of `n` coefficients covers as k = 2 does of one."""
    from scipy.stats import chi2

    return math.sqrt(chi2.ppf(COVERAGE, n))


# -- reading -------------------------------------------------------------------------------


@cache
def schema() -> Any:
    """Return the schema, read without a network."""
    try:
        import xmlschema
    except ImportError:
        raise error("certificate.library", name="xmlschema") from None
    signature = Path(xmlschema.__file__).parent / "schemas" / "DSIG" / "xmldsig-core-schema.xsd"
    return xmlschema.XMLSchema(
        str(SCHEMAS / f"dcc-{VERSION}.xsd"), allow="local",
        locations={SI: str(SCHEMAS / f"SI_Format-{SI_VERSION}.xsd"), DSIG: str(signature)},
    )  # fmt: skip


def faults(data: bytes) -> list[str]:
    """Return what of a DCC does not keep to the schema, each in words."""
    import io

    return [f"{f.path}: {f.reason}" for f in schema().iter_errors(io.BytesIO(data))]


def parsed(data: bytes, path: str | Path) -> Any:
    """Return the root of a DCC; raises ``certificate.xml``: it is none. Nothing is looked up."""
    from lxml import etree

    parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=False)
    try:
        root = etree.fromstring(data, parser)
    except (etree.XMLSyntaxError, ValueError) as problem:
        raise error("certificate.xml", path=path, reason=problem) from None
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
