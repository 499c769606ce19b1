"""Signatures: made with the laboratory's key, verified here and by other programs."""

from __future__ import annotations

import base64
import datetime
import functools
import io
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import pkcs12
from cryptography.x509.oid import NameOID
from lxml import etree
from pyhanko.pdf_utils.incremental_writer import IncrementalPdfFileWriter
from pyhanko.pdf_utils.reader import PdfFileReader

from foucault.certificate import dcc, issue, page, signature
from foucault.certificate.verify import Found, verify
from foucault.errors import FoucaultError
from foucault.result import Level
from make_certificate import PASSWORD, make_certificate, make_key

NOW = datetime.datetime.now(datetime.UTC)
DAY = datetime.timedelta(days=1)


@pytest.fixture(scope="module")
def signed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a signed certificate, the key and its certificate."""
    home = tmp_path_factory.mktemp("signed")
    key = signature.load(make_key(home)[0], PASSWORD)
    xml, pdf = issue.made(make_certificate(home), key)
    (home / "c.xml").write_bytes(xml)
    (home / "c.pdf").write_bytes(pdf)
    return home


def changed(data: bytes, tmp_path: Path, kind: str, **more: Any) -> Found:
    """Verify data as a file of its own."""
    file = tmp_path / f"changed.{kind}"
    file.write_bytes(data)
    return verify(file, **more)


@pytest.mark.parametrize("name", ["c.pdf", "c.xml"])
def test_what_was_signed_is_valid_by_whom_is_known_only_by_trust(name: str, signed: Path) -> None:
    found = verify(signed / name, signed / "laboratory.pem")
    assert found.level is Level.PASS and not found.faults and not found.doubts
    assert found.number == "2025-0042" and found.issued == "2025-03-20"
    assert [s.what for s in found.seals] == (["page", "DCC"] if name == "c.pdf" else ["DCC"])
    for seal in found.seals:
        assert seal.signer == "Pendulum Calibration Laboratory" and seal.trusted
        assert abs(seal.at - NOW) < DAY and not seal.expired_then
    alone = verify(signed / name)
    assert alone.level is Level.DOUBTFUL
    assert alone.doubts == (
        "nothing vouches that the key is that of Pendulum Calibration Laboratory",)  # fmt: skip


@pytest.mark.parametrize("name", ["c.pdf", "c.xml"])
def test_a_key_of_the_same_name_is_not_the_trusted_one(
    name: str, signed: Path, tmp_path: Path
) -> None:
    other = make_key(tmp_path, kind="ec")[1]
    found = verify(signed / name, other)
    assert found.level is Level.DOUBTFUL and "not the trusted one" in found.doubts[0]


@pytest.mark.parametrize("name", [pytest.param("c.pdf", marks=pytest.mark.thorough), "c.xml"])
def test_no_edited_byte_goes_unseen(name: str, signed: Path, tmp_path: Path) -> None:
    """Bytes all over the file; in a tag of the DCC white space says nothing."""
    data = (signed / name).read_bytes()
    rng = np.random.default_rng(5)
    places = [int(i) for i in rng.choice(len(data), 60, replace=False)]
    if name == "c.xml":
        places = [i for i in places if data[i : i + 1].isalnum()]
    for i in places:
        new = bytearray(data)
        new[i] ^= 1
        try:
            found = changed(bytes(new), tmp_path, name[2:], trusted=signed / "laboratory.pem")
        except FoucaultError as problem:
            assert problem.code in ("certificate.xml", "certificate.neither"), i
        else:
            assert found.level is Level.UNUSABLE and found.faults, (i, data[i - 20 : i + 20])


def test_a_number_that_was_edited_is_told_in_words(signed: Path, tmp_path: Path) -> None:
    data = (signed / "c.xml").read_bytes()
    found = changed(data.replace(b">2025-0042<", b">2025-0043<", 1), tmp_path, "xml")
    assert found.number == "2025-0043"
    assert found.faults[0].startswith("the DCC was changed since it was signed")
    pdf = (signed / "c.pdf").read_bytes()
    i = pdf.index(b"/Length", 20000)
    edited = pdf[:i] + pdf[i:].replace(b"endobj", b"endobk", 1)
    assert "was changed" in changed(edited, tmp_path, "pdf").faults[0]


def test_what_is_added_to_a_page_is_seen(signed: Path, tmp_path: Path) -> None:
    data = (signed / "c.pdf").read_bytes()
    out = io.BytesIO()
    writer = IncrementalPdfFileWriter(io.BytesIO(data))
    writer.root["/Lang"] = writer.root["/Lang"].__class__("fr")
    writer.update_root()
    writer.write(out)
    for more in (out.getvalue(), data + b"\n% more"):
        found = changed(more, tmp_path, "pdf", trusted=signed / "laboratory.pem")
        assert found.level is Level.UNUSABLE
        assert any("was added to the page" in f for f in found.faults)


def test_what_no_signature_covers_is_refused(signed: Path, tmp_path: Path) -> None:
    data = (signed / "c.xml").read_bytes()
    remark = data.replace(b">2025-0042<", b">2025-<!-- x -->0042<", 1)
    assert "holds a remark" in changed(remark, tmp_path, "xml").faults[0]
    root = etree.fromstring(data)
    mark = root.find(f"{{{dcc.DSIG}}}Signature")
    root.append(etree.fromstring(etree.tostring(mark)))
    assert any("more than one signature" in f
               for f in changed(etree.tostring(root), tmp_path, "xml").faults)  # fmt: skip
    inner = etree.fromstring(data)
    inner.find(f".//{{{dcc.DSIG}}}X509Certificate").text = "AAAA"
    assert any("it names no key" in f
               for f in changed(etree.tostring(inner), tmp_path, "xml").faults)  # fmt: skip


def test_a_signature_over_a_part_is_none_over_the_whole(tmp_path: Path) -> None:
    """A DCC whose signature covers another element than the root."""
    made = make_certificate(tmp_path)
    key = signature.load(make_key(tmp_path)[0], PASSWORD)
    whole = dcc.parsed(signature.sign_dcc(dcc.made(made), key), "x")
    other = dcc.parsed(dcc.made(made), "x")
    other.find(f".//{{{dcc.DCC}}}uniqueIdentifier").text = "2025-9999"
    mark = whole.find(f"{{{dcc.DSIG}}}Signature")
    reference = mark.find(f".//{{{dcc.DSIG}}}Reference")
    reference.set("URI", "#elsewhere")
    other.append(mark)
    assert changed(etree.tostring(other), tmp_path, "xml").level is Level.UNUSABLE


def test_unsigned_and_half_signed_ones_are_not_valid(tmp_path: Path) -> None:
    made = make_certificate(tmp_path)
    xml, pdf = issue.made(made)
    assert changed(xml, tmp_path, "xml").faults == ("it is not signed",)
    assert changed(pdf, tmp_path, "pdf").faults == ("the page is not signed",)
    key = signature.load(make_key(tmp_path)[0], PASSWORD)
    other = signature.load(make_key(tmp_path, kind="ec")[0], PASSWORD)
    inner = page.made(made, signature.sign_dcc(xml, key), signed=True)
    both = signature.sign_page(inner, other, reason="x", place="y")
    assert "page and DCC are signed with different keys" in changed(both, tmp_path, "pdf").faults


def test_a_dcc_that_does_not_keep_to_its_schema_is_told(tmp_path: Path) -> None:
    key = signature.load(make_key(tmp_path)[0], PASSWORD)
    bad = dcc.made(make_certificate(tmp_path)).replace(b">FR<", b">France<", 1)
    found = changed(signature.sign_dcc(bad, key), tmp_path, "xml")
    assert "does not keep to its schema" in found.faults[0] and len(found.faults) == 1


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "it begins like neither"),
        (b"\x00\xff" * 50, "it begins like neither"),
        (b"<a/>", "is no Digital Calibration Certificate"),
        (b"<!DOCTYPE a [<!ENTITY b 'bbbbbbbbbb'><!ENTITY c '&b;&b;&b;'>]><a>&c;</a>",
         "is no Digital Calibration Certificate"),
    ],
    ids=["empty", "junk", "other", "entities"],
)  # fmt: skip
def test_files_that_are_none_are_said(data: bytes, words: str, tmp_path: Path) -> None:
    with pytest.raises(FoucaultError, match=words):
        changed(data, tmp_path, "x")


def test_a_page_of_others_without_a_dcc_is_told(tmp_path: Path) -> None:
    found = changed(b"%PDF-1.7\n1 0 obj\n", tmp_path, "pdf")
    assert found.level is Level.UNUSABLE and "it cannot be read" in found.faults[0]
    with pytest.raises(FoucaultError, match="No such file"):
        verify(tmp_path / "nowhere.pdf")
    with pytest.raises(FoucaultError, match="names nobody to trust: it holds no certificate"):
        verify(tmp_path / "changed.pdf", tmp_path / "changed.pdf")
    with pytest.raises(FoucaultError, match="names nobody to trust: No such file"):
        verify(tmp_path / "changed.pdf", tmp_path / "nowhere.pem")


# -- keys ----------------------------------------------------------------------------------


def test_a_key_that_cannot_sign_is_refused_in_words(tmp_path: Path) -> None:
    p12, pem = make_key(tmp_path)
    with pytest.raises(FoucaultError, match="The password does not open"):
        signature.load(p12, "wrong")
    with pytest.raises(FoucaultError, match="it is no PKCS#12 file"):
        signature.load(pem, PASSWORD)
    with pytest.raises(FoucaultError, match="gives no key: No such file"):
        signature.load(tmp_path / "nowhere.p12", PASSWORD)
    certificate = x509.load_pem_x509_certificate(pem.read_bytes())
    bare = pkcs12.serialize_key_and_certificates(
        None, None, certificate, None, serialization.NoEncryption()
    )
    p12.write_bytes(bare)
    with pytest.raises(FoucaultError, match="it lacks a certificate, or an RSA or EC key"):
        signature.load(p12, "")
    old, _ = make_key(tmp_path, first=-400, last=-30)
    with pytest.raises(FoucaultError, match="so it cannot sign today"):
        signature.load(old, PASSWORD)


def test_a_key_that_had_expired_or_has_since_is_told(signed: Path, tmp_path: Path) -> None:
    p12, pem = make_key(tmp_path, first=-400, last=-30)
    old = signature.load(p12, PASSWORD, NOW - 100 * DAY)  # on a computer whose clock was set back
    xml, pdf = issue.made(make_certificate(tmp_path), old)
    for data, kind in ((xml, "xml"), (pdf, "pdf")):
        found = changed(data, tmp_path, kind, trusted=pem)
        assert found.level is Level.DOUBTFUL and not found.faults
        assert "the key had expired, or was not yet valid, when it signed" in found.doubts
    later = verify(signed / "c.pdf", signed / "laboratory.pem", NOW + 1000 * DAY)
    assert later.level is Level.DOUBTFUL and "the key has expired on" in later.doubts[0]


def test_an_ec_key_and_one_under_an_authority_serve_as_well(tmp_path: Path) -> None:
    root, leaf = (ec.generate_private_key(ec.SECP256R1()) for _ in range(2))

    def name(text: str) -> x509.Name:
        return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])

    def made(subject: str, key: Any, ca: bool) -> x509.Certificate:
        usage = x509.KeyUsage(not ca, not ca, False, False, False, ca, ca, False, False)
        return (
            x509.CertificateBuilder().subject_name(name(subject)).issuer_name(name("Authority"))
            .public_key(key.public_key()).serial_number(x509.random_serial_number())
            .not_valid_before(NOW - DAY).not_valid_after(NOW + 30 * DAY)
            .add_extension(x509.BasicConstraints(ca, None), critical=True)
            .add_extension(usage, critical=True)
            .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), False)
            .add_extension(
                x509.AuthorityKeyIdentifier.from_issuer_public_key(root.public_key()), False)
            .sign(root, hashes.SHA256())
        )  # fmt: skip

    authority, own = made("Authority", root, True), made("Lab", leaf, False)
    (tmp_path / "ca.pem").write_bytes(authority.public_bytes(serialization.Encoding.PEM))
    (tmp_path / "lab.p12").write_bytes(pkcs12.serialize_key_and_certificates(
        b"lab", leaf, own, [authority], serialization.NoEncryption()))  # fmt: skip
    key = signature.load(tmp_path / "lab.p12", "")
    xml, pdf = issue.made(make_certificate(tmp_path), key)
    for data, kind in ((xml, "xml"), (pdf, "pdf")):
        found = changed(data, tmp_path, kind, trusted=tmp_path / "ca.pem")
        assert found.level is Level.PASS, (found.faults, found.doubts)
        assert {s.issuer for s in found.seals} == {"CN=Authority"}
        other = changed(data, tmp_path, kind, trusted=make_key(tmp_path)[1])
        assert other.level is Level.DOUBTFUL and "nor does that vouch for it" in other.doubts[0]


# -- other programs ------------------------------------------------------------------------


def needs(program: str) -> Any:
    missing = shutil.which(program) is None
    return pytest.mark.skipif(missing, reason=f"{program} is not installed")


run = functools.partial(subprocess.run, capture_output=True, text=True, check=False)


@needs("openssl")
def test_openssl_verifies_the_page(signed: Path, tmp_path: Path) -> None:
    data = (signed / "c.pdf").read_bytes()
    mark = PdfFileReader(io.BytesIO(data)).embedded_signatures[0]
    _, first, then, rest = (int(v) for v in mark.byte_range)
    (tmp_path / "mark.der").write_bytes(mark.pkcs7_content.rstrip(b"\0"))
    words = ["openssl", "cms", "-verify", "-binary", "-inform", "DER", "-in", "mark.der",
             "-content", "said", "-CAfile", str(signed / "laboratory.pem"), "-purpose", "any",
             "-out", "out"]  # fmt: skip
    for at, code in ((None, 0), (1000, 4)):
        said = bytearray(data[:first] + data[then : then + rest])
        if at is not None:
            said[at] ^= 1
        (tmp_path / "said").write_bytes(said)
        done = run(words, cwd=tmp_path)
        assert done.returncode == code, done.stderr


@needs("openssl")
def test_openssl_verifies_the_dcc(signed: Path, tmp_path: Path) -> None:
    root = etree.fromstring((signed / "c.xml").read_bytes())
    mark = root.find(f"{{{dcc.DSIG}}}Signature")
    info = mark.find(f"{{{dcc.DSIG}}}SignedInfo")
    # inclusive canonical XML, written by lxml and not by the signing library
    (tmp_path / "info").write_bytes(etree.tostring(info, method="c14n"))
    value = base64.b64decode(mark.findtext(f"{{{dcc.DSIG}}}SignatureValue"))
    (tmp_path / "value").write_bytes(value)
    public = ["openssl", "x509", "-in", str(signed / "laboratory.pem"), "-pubkey", "-noout"]
    (tmp_path / "public.pem").write_text(run(public).stdout)
    done = run(["openssl", "dgst", "-sha256", "-verify", "public.pem", "-signature", "value",
                "info"], cwd=tmp_path)  # fmt: skip
    assert done.stdout.strip() == "Verified OK", done
    root.remove(mark)
    (tmp_path / "rest").write_bytes(etree.tostring(root, method="c14n"))
    digest = run(["openssl", "dgst", "-sha256", "-binary", "rest"], cwd=tmp_path, text=False)
    whole = next(r for r in info.iter(f"{{{dcc.DSIG}}}Reference") if r.get("URI") == "")
    said = base64.b64decode(whole.findtext(f"{{{dcc.DSIG}}}DigestValue"))
    assert digest.stdout == said


@needs("pdfsig")
def test_poppler_verifies_the_page(signed: Path) -> None:
    said = run(["pdfsig", str(signed / "c.pdf")]).stdout
    assert "Signature is Valid." in said and "Total document signed" in said
    assert "ETSI.CAdES.detached" in said


@needs("xmlsec1")
def test_xmlsec_verifies_the_dcc(signed: Path, tmp_path: Path) -> None:
    words = ["xmlsec1", "--verify", "--trusted-pem", str(signed / "laboratory.pem"),
             "--enabled-key-data", "x509", "--id-attr:Id", "SignedProperties", "--id-attr:Id",
             "KeyInfo"]  # fmt: skip
    done = run([*words, str(signed / "c.xml")])
    assert done.returncode == 0 and "3/3" in done.stdout + done.stderr
    data = (signed / "c.xml").read_bytes().replace(b">2025-0042<", b">2025-0043<", 1)
    (tmp_path / "c.xml").write_bytes(data)
    assert run([*words, str(tmp_path / "c.xml")]).returncode != 0


@needs("qpdf")
def test_qpdf_finds_nothing_wrong(signed: Path) -> None:
    assert run(["qpdf", "--check", str(signed / "c.pdf")]).returncode == 0
