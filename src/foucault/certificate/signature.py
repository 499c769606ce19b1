"""The laboratory's own key, and how it signs: the page by PAdES, the DCC by XAdES.

A key is a PKCS#12 file with its certificate. The time of a signature is that of the computer that
signs: without a time stamp of somebody else it is the word of who signs.
"""

from __future__ import annotations

import datetime
import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from foucault.certificate import dcc
from foucault.errors import error, library

ROOM = 16384
"""Bytes of the PDF that are kept for a signature with its certificates."""


@dataclass(frozen=True)
class Key:
    """A key with its certificate and those above it."""

    key: Any
    certificate: Any
    chain: tuple[Any, ...]

    @property
    def holder(self) -> str:
        """Whose it is."""
        return name_of(self.certificate)


def name_of(certificate: Any) -> str:
    """Return whose a certificate is: common name and organisation."""
    from cryptography.x509.oid import NameOID

    parts = [
        str(a.value)
        for oid in (NameOID.COMMON_NAME, NameOID.ORGANIZATION_NAME)
        for a in certificate.subject.get_attributes_for_oid(oid)
    ]
    return ", ".join(parts) or certificate.subject.rfc4514_string() or "nobody"


def load(path: str | Path, password: str, now: datetime.datetime | None = None) -> Key:
    """Read a PKCS#12 file; raises ``certificate.key_*``: none, other password, not valid now."""
    with library("certificate.library", name="cryptography"):
        from cryptography.hazmat.primitives.asymmetric import ec, rsa
        from cryptography.hazmat.primitives.serialization import pkcs12
    try:
        data = Path(path).read_bytes()
    except OSError as problem:
        raise error("certificate.key_file", path=path, reason=problem.strerror) from None
    try:
        key, certificate, above = pkcs12.load_key_and_certificates(data, password.encode() or None)
    except ValueError as problem:
        if "password" in str(problem).lower():
            raise error("certificate.key_password", path=path) from None
        raise error("certificate.key_file", path=path, reason="it is no PKCS#12 file") from None
    if certificate is None or not isinstance(key, rsa.RSAPrivateKey | ec.EllipticCurvePrivateKey):
        raise error("certificate.key_file", path=path,
                    reason="it lacks a certificate, or an RSA or EC key")  # fmt: skip
    at = now or datetime.datetime.now(datetime.UTC)
    first, last = certificate.not_valid_before_utc, certificate.not_valid_after_utc
    if not first <= at <= last:
        raise error("certificate.key_expired", holder=name_of(certificate), first=first.date(),
                    last=last.date())  # fmt: skip
    return Key(key, certificate, tuple(above))


def sign_dcc(data: bytes, key: Key) -> bytes:
    """Return a DCC with a signature at its end (XAdES, enveloped)."""
    with library("certificate.library", name="signxml"):
        from signxml import methods
        from signxml.xades import XAdESDataObjectFormat, XAdESSigner
    from cryptography.hazmat.primitives.asymmetric import ec
    from lxml import etree

    signer = XAdESSigner(
        method=methods.enveloped, digest_algorithm="sha256",
        signature_algorithm="ecdsa-sha256" if isinstance(key.key, ec.EllipticCurvePrivateKey)
        else "rsa-sha256",
        data_object_format=XAdESDataObjectFormat("Digital Calibration Certificate",
                                                 "application/xml"),
    )  # fmt: skip
    root = signer.sign(dcc.parsed(data, "the DCC"), key=key.key,
                       cert=[key.certificate, *key.chain], always_add_key_value=False)  # fmt: skip
    return bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8")) + b"\n"


def sign_page(data: bytes, key: Key, *, reason: str, place: str) -> bytes:
    """Return a PDF with a signature over all of it (PAdES), which leaves it PDF/A."""
    with library("certificate.library", name="pyHanko"):
        from pyhanko.pdf_utils.incremental_writer import IncrementalPdfFileWriter
        from pyhanko.sign import fields, signers
        from pyhanko_certvalidator.registry import SimpleCertificateStore
    from asn1crypto import keys, x509
    from cryptography.hazmat.primitives.serialization import (
        Encoding,
        NoEncryption,
        PrivateFormat,
    )

    class Writer(IncrementalPdfFileWriter):  # type: ignore[misc]
        """Leaves the metadata of PDF/A as they are; pyHanko would write them anew."""

        def _update_meta(self) -> None: ...

    def plain(certificate: Any) -> Any:
        return x509.Certificate.load(certificate.public_bytes(Encoding.DER))

    store = SimpleCertificateStore()
    for one in key.chain:
        store.register(plain(one))
    private = key.key.private_bytes(Encoding.DER, PrivateFormat.PKCS8, NoEncryption())
    signer = signers.SimpleSigner(
        signing_cert=plain(key.certificate), cert_registry=store,
        signing_key=keys.PrivateKeyInfo.load(private),
    )  # fmt: skip
    said = signers.PdfSignatureMetadata(
        field_name="Laboratory", md_algorithm="sha256", reason=reason, location=place,
        name=key.holder, subfilter=fields.SigSeedSubFilter.PADES, certify=True,
        docmdp_permissions=fields.MDPPerm.NO_CHANGES,
    )  # fmt: skip
    out = io.BytesIO()
    signers.PdfSigner(said, signer).sign_pdf(
        Writer(io.BytesIO(data)), output=out, bytes_reserved=ROOM
    )
    return out.getvalue()
