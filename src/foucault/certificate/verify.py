"""What a certificate that somebody has got is worth: whole or changed, by whom, when, what for.

Anybody can change a file and sign it anew with a key of his own in another's name. That a signature
is sound says that nothing was changed since; whose it is says only a certificate that one has got
on another way, which is given as trusted.
"""

from __future__ import annotations

import datetime
import hashlib
import io
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from foucault.certificate import dcc
from foucault.certificate.page import DCC_FILE
from foucault.certificate.signature import name_of
from foucault.errors import FoucaultError, error, library
from foucault.result import Level

LARGEST = 64 << 20
"""A larger file is no certificate [byte]."""


@dataclass(frozen=True)
class Seal:
    """One signature."""

    what: str  # "page" or "DCC"
    signer: str
    issuer: str
    fingerprint: str  # SHA-256 of the certificate of the key
    at: datetime.datetime | None  # when, as the signer says
    valid_until: datetime.datetime
    expired_then: bool  # the key was not valid at that time
    trusted: bool | None  # None where nothing was said to be trusted

    def expired_now(self, now: datetime.datetime) -> bool:
        """Whether the key has expired since."""
        return now > self.valid_until


@dataclass(frozen=True)
class Found:
    """What there is to say of a file."""

    number: str
    issued: str
    replaces: str
    sha256: str
    seals: tuple[Seal, ...]
    faults: tuple[str, ...]  # each makes it invalid
    doubts: tuple[str, ...] = field(default=())

    @property
    def level(self) -> Level:
        """Unusable where anything is wrong, doubtful where it is not known whose it is."""
        if self.faults:
            return Level.UNUSABLE
        return Level.DOUBTFUL if self.doubts else Level.PASS


def verify(
    path: str | Path, trusted: str | Path | None = None, now: datetime.datetime | None = None
) -> Found:
    """Look at a PDF or a DCC.

    `trusted`: file with the certificate (PEM or DER) of the laboratory's key, or of who vouches for
    it; `now`: the time, that of the computer if left. Raises ``certificate.*``: it is neither.
    """
    roots = None if trusted is None else _roots(trusted)
    data = _read(path)
    at = now or datetime.datetime.now(datetime.UTC)
    seals: list[Seal] = []
    faults: list[str] = []
    if data.lstrip()[:5] == b"%PDF-":
        inner, own, wrong = _page(data, roots)
        seals += own
        faults += wrong
    elif data.lstrip()[:1] == b"<":
        inner = data
    else:
        raise error("certificate.neither", path=path, reason="it begins like neither")
    said = {"number": "", "issued": "", "replaces": ""}
    if inner is not None:
        try:
            root = dcc.parsed(inner, path)
            said = dict(dcc.identity(root))
            wrong = dcc.faults(inner)
            faults += [f"the DCC does not keep to its schema: {wrong[0]}"] if wrong else []
            own, bad = _dcc(root, roots)
            seals, faults = seals + own, faults + bad
        except FoucaultError as problem:
            if not seals and not faults:
                raise
            faults.append(f"the DCC in it cannot be read: {problem.message}")
    if not seals and not faults:
        faults.append("it is not signed")
    if len({s.fingerprint for s in seals}) > 1:
        faults.append("page and DCC are signed with different keys")
    doubts = tuple(dict.fromkeys(_doubts(seals, at)))
    return Found(**said, sha256=hashlib.sha256(data).hexdigest(), seals=tuple(seals),
                 faults=tuple(faults), doubts=doubts)  # fmt: skip


def _read(path: str | Path) -> bytes:
    try:
        if Path(path).stat().st_size > LARGEST:
            raise error("certificate.neither", path=path, reason="it is larger than any")
        return Path(path).read_bytes()
    except OSError as problem:
        raise error("certificate.neither", path=path, reason=problem.strerror) from None


def _doubts(seals: list[Seal], now: datetime.datetime) -> list[str]:
    out = []
    for one in seals:
        if one.trusted is None:
            out.append(f"nothing vouches that the key is that of {one.signer}")
        if one.trusted is False:
            out.append("the key is not the trusted one, nor does that vouch for it")
        if one.expired_then:
            out.append("the key had expired, or was not yet valid, when it signed")
        elif one.expired_now(now):
            out.append(f"the key has expired on {one.valid_until:%Y-%m-%d}; that it signed before "
                       "is the word of its holder")  # fmt: skip
    return out


# -- keys ----------------------------------------------------------------------------------


def _roots(path: str | Path) -> list[Any]:
    """Return the certificates in a file."""
    with library("certificate.library", name="cryptography"):
        from cryptography import x509
    try:
        data = Path(path).read_bytes()
        if b"-----BEGIN" in data:
            return list(x509.load_pem_x509_certificates(data))
        return [x509.load_der_x509_certificate(data)]
    except OSError as problem:
        raise error("certificate.trust", path=path, reason=problem.strerror) from None
    except ValueError:
        raise error("certificate.trust", path=path, reason="it holds no certificate") from None


def _seal(
    what: str, certificate: Any, others: list[Any], at: datetime.datetime | None,
    roots: list[Any] | None,
) -> Seal:  # fmt: skip
    from cryptography.hazmat.primitives.hashes import SHA256

    first, last = certificate.not_valid_before_utc, certificate.not_valid_after_utc
    return Seal(
        what, name_of(certificate), certificate.issuer.rfc4514_string(),
        certificate.fingerprint(SHA256()).hex(), at, last,
        at is not None and not first <= at <= last,
        None if roots is None else _vouched(certificate, others, roots, at),
    )  # fmt: skip


def _vouched(
    certificate: Any, others: list[Any], roots: list[Any], at: datetime.datetime | None
) -> bool:
    """Whether a certificate is a trusted one, or a chain of others leads from it to one."""
    if certificate in roots:
        return True
    import asyncio

    from asn1crypto import x509
    from cryptography.hazmat.primitives.serialization import Encoding
    from pyhanko_certvalidator import CertificateValidator, ValidationContext
    from pyhanko_certvalidator.errors import PathBuildingError, PathValidationError

    def plain(one: Any) -> Any:
        return x509.Certificate.load(one.public_bytes(Encoding.DER))

    context = ValidationContext(
        trust_roots=[plain(r) for r in roots], other_certs=[plain(o) for o in others],
        allow_fetching=False, moment=at, revocation_mode="soft-fail",
    )  # fmt: skip
    validator = CertificateValidator(plain(certificate), validation_context=context)
    try:
        asyncio.run(validator.async_validate_usage(set()))
    except (PathBuildingError, PathValidationError):
        return False
    return True


# -- the DCC -------------------------------------------------------------------------------


def _dcc(root: Any, roots: list[Any] | None) -> tuple[list[Seal], list[str]]:
    """Return the signature of a DCC, and what is wrong with it."""
    with library("certificate.library", name="signxml"):
        from signxml import SignatureConfiguration
        from signxml.xades import XAdESVerifier
    import base64

    from cryptography import x509
    from lxml import etree

    found = root.findall(f"{{{dcc.DSIG}}}Signature")
    if not found:
        return [], []
    beside = root.getprevious() is not None or root.getnext() is not None
    if beside or next(root.iter(etree.Comment, etree.PI), None) is not None:
        return [], ["the DCC holds a remark, which no signature covers"]
    if len(found) > 1:
        return [], ["the DCC has more than one signature"]
    texts = found[0].iterfind(f"{{{dcc.DSIG}}}KeyInfo/{{{dcc.DSIG}}}X509Data/"
                              f"{{{dcc.DSIG}}}X509Certificate")  # fmt: skip
    at = _moment(found[0].findtext(".//{*}SigningTime"))
    try:
        chain = [x509.load_der_x509_certificate(base64.b64decode(t.text or "")) for t in texts]
        seal = _seal("DCC", chain[0], chain[1:], at, roots)
    except (ValueError, IndexError):
        return [], ["the signature of the DCC was changed: it names no key"]
    # Whether the key had expired is told apart from whether anything was changed.
    config = SignatureConfiguration(
        location="./", expect_references=3, verification_time=chain[0].not_valid_before_utc
    )
    try:
        with _quiet("signxml"):
            signed = XAdESVerifier().verify(
                etree.tostring(root), x509_cert=chain[0], expect_config=config
            )
    except Exception as problem:  # a damaged file breaks a reader in any way
        said = str(problem).splitlines()[0] if str(problem) else type(problem).__name__
        return [seal], [f"the DCC was changed since it was signed ({said})"]
    target = found[0].find(".//{*}QualifyingProperties")
    if target is None or target.get("Target") != f"#{found[0].get('Id')}":
        return [seal], ["the signature of the DCC was changed: it names another"]
    if not any(s.signed_xml is not None and s.signed_xml.tag == root.tag for s in signed):
        return [seal], ["the signature does not cover the whole DCC"]
    return [seal], []


def _moment(text: str | None) -> datetime.datetime | None:
    try:
        at = datetime.datetime.fromisoformat(text or "")
    except ValueError:
        return None
    return at if at.tzinfo else at.replace(tzinfo=datetime.UTC)


@contextmanager
def _quiet(name: str) -> Iterator[None]:
    """Keep a library from speaking on its own."""
    logger = logging.getLogger(name)
    before = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(before)


# -- the page ------------------------------------------------------------------------------


def _page(data: bytes, roots: list[Any] | None) -> tuple[bytes | None, list[Seal], list[str]]:
    """Return the DCC in a PDF, the signature of the page, and what is wrong with it."""
    with library("certificate.library", name="pyHanko"):
        from pyhanko.pdf_utils.reader import PdfFileReader
    from cryptography import x509

    faults: list[str] = []
    seals: list[Seal] = []
    with _quiet("pyhanko"), _quiet("pyhanko_certvalidator"):
        try:
            reader = PdfFileReader(io.BytesIO(data), strict=True)
            inner = attached(reader)
            signatures = reader.embedded_signatures
            if len(signatures) > 1:
                faults.append("the page has more than one signature")
            for one in signatures[:1]:
                certificate = x509.load_der_x509_certificate(one.signer_cert.dump())
                above = one.other_embedded_certs
                others = [x509.load_der_x509_certificate(c.dump()) for c in above]
                seals.append(_seal("page", certificate, others, one.self_reported_timestamp, roots))
                faults += _changes(one, data)
        except Exception as problem:  # a damaged file breaks a reader in any way
            return None, seals, [f"the page was changed: it cannot be read ({problem})"]
    if inner is None:
        faults.append(f"there is no {DCC_FILE} in it")
    if not seals:
        faults.append("the page is not signed")
    return inner, seals, faults


def _changes(one: Any, data: bytes) -> list[str]:
    """Return how a signed PDF differs from what was signed."""
    import asyncio

    from asn1crypto.cms import ContentInfo
    from pyhanko.sign.validation import async_validate_pdf_signature
    from pyhanko_certvalidator import ValidationContext

    context = ValidationContext(
        trust_roots=[one.signer_cert], allow_fetching=False, revocation_mode="soft-fail"
    )
    status = asyncio.run(async_validate_pdf_signature(one, context))
    out = []
    if not status.intact or not status.valid:
        out.append("the page was changed since it was signed")
    start, first, then, rest = (int(v) for v in one.byte_range)
    gap = data[first:then]
    held = ContentInfo.load(one.pkcs7_content).dump().hex()  # without what fills it up
    written = [f"<{text.ljust(len(gap) - 2, '0')}>".encode() for text in (held, held.upper())]
    if start or then + rest != len(data):
        out.append("something was added to the page since it was signed")
    elif gap not in written:
        out.append("the page was changed since it was signed, beside what the signature covers")
    return out


def attached(reader: Any) -> bytes | None:
    """Return the DCC that a PDF has in it, None without one."""
    at = reader.root
    for key in ("/Names", "/EmbeddedFiles", "/Names"):
        if key not in at:
            return None
        at = at[key]
    for i in range(1, len(at), 2):
        entry = at[i]
        if "/UF" in entry and entry["/UF"] == DCC_FILE:
            return bytes(entry["/EF"]["/F"].data)
    return None


def dcc_of(path: str | Path) -> bytes:
    """Return the DCC of a certificate, which is one or has it in it; raises `certificate.*`."""
    data = _read(path)
    inner, _, faults = _page(data, None) if data[:5] == b"%PDF-" else (data, [], [])
    if inner is None:
        raise error("certificate.neither", path=path, reason=faults[0])
    return inner
