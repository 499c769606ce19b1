"""The page: PDF/A-3b with the DCC in it, the same bytes each time, in words of the laboratory."""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pdf_oxide
import pytest
from pyhanko.pdf_utils.reader import PdfFileReader

from foucault.certificate import dcc, issue, page, signature
from foucault.certificate.content import Certificate
from foucault.certificate.labels import Labels
from foucault.certificate.verify import attached
from foucault.errors import FoucaultError
from make_certificate import (
    DAY,
    PASSWORD,
    REVIEW,
    make_certificate,
    make_conforming,
    make_full,
    make_key,
)

XMP = re.compile(rb"<pdfaid:part>3</pdfaid:part><pdfaid:conformance>B</pdfaid:conformance>")


def words(made: Certificate, *, signed: bool = False) -> str:
    """Return all that the page prints."""
    labels = Labels(made.languages, made.labels)
    return json.dumps(page.blocks(made, labels, b"", signed=signed), ensure_ascii=False)


def everything(reader: PdfFileReader) -> list[Any]:
    """Return every object of a PDF."""
    return [reader.get_object(ref) for ref in reader.xrefs.explicit_refs_in_revision(0)]


def structure(data: bytes, xml: bytes) -> None:
    """Check what PDF/A-3b asks of a file that needs no look at its drawing (ISO 19005-3, 6)."""
    reader = PdfFileReader(io.BytesIO(data))
    root, trailer = reader.root, reader.trailer
    assert data[:8] == b"%PDF-1.7" and min(data[10:14]) > 127, "6.1.2: a mark of bytes"
    assert len(trailer["/ID"]) == 2 and "/Encrypt" not in trailer, "6.1.3"
    assert XMP.search(root["/Metadata"].data), "6.6.4"
    assert len(root["/OutputIntents"]) == len(root["/AF"]) == 1
    intent = root["/OutputIntents"][0]
    assert intent["/S"] == "/GTS_PDFA1" and intent["/DestOutputProfile"].data[36:40] == b"acsp"
    assert not {"/AA", "/OpenAction", "/Perms"} & set(root) - {"/Perms"}, "6.5.2"
    form = root["/AcroForm"] if "/AcroForm" in root else {}  # noqa: SIM401  behind a reference
    assert "/JavaScript" not in root["/Names"] and not {"/XFA", "/NeedAppearances"} & set(form)
    file = root["/AF"][0]
    assert file["/AFRelationship"] == "/Data" and file["/UF"] == file["/F"] == page.DCC_FILE
    held = file["/EF"]["/F"]
    assert held["/Subtype"] == "/application/xml" and held["/Params"]["/ModDate"]
    assert held.data == attached(reader) == xml, "6.8"
    fonts = [o for o in everything(reader) if isinstance(o, dict) and o.get("/Type") == "/Font"]
    assert fonts
    for font in fonts:
        below = font["/DescendantFonts"][0] if "/DescendantFonts" in font else font
        assert {"/FontFile", "/FontFile2", "/FontFile3"} & set(below["/FontDescriptor"]), "6.2.11.4"
        assert "/ToUnicode" in font or "/DescendantFonts" not in font
    for one in everything(reader):
        if isinstance(one, dict):
            assert one.get("/S") not in ("/JavaScript", "/Launch", "/Movie", "/Sound"), "6.5.1"
            if "/LZWDecode" in str(one.get("/Filter")):
                raise AssertionError("6.1.7.2")
            if one.get("/Type") == "/Annot" and one.get("/Subtype") != "/Link":
                flags = int(one.get("/F", 0))
                assert flags & 4 and not flags & 0b100011, "6.3.2: printed, not hidden"


def test_it_is_built_as_an_archive_asks_signed_and_unsigned(tmp_path: Path) -> None:
    made = make_full(tmp_path)
    xml, pdf = issue.made(made)
    structure(pdf, xml)
    key = signature.load(make_key(tmp_path)[0], PASSWORD)
    xml, pdf = issue.made(made, key)
    structure(pdf, xml)
    assert PdfFileReader(io.BytesIO(pdf)).embedded_signatures[0].field_name == "Laboratory"


@pytest.mark.thorough
def test_another_program_takes_it_for_an_archive_and_sees_what_is_broken(tmp_path: Path) -> None:
    """A validator that is not ours; it looks at fonts, metadata and attachments, not at all."""
    made = make_full(tmp_path)
    key = signature.load(make_key(tmp_path)[0], PASSWORD)
    for pdf in (issue.made(made)[1], issue.made(made, key)[1]):
        assert validated(tmp_path, pdf) == []
        for part, word in ((b"/Metadata", "XMP"), (b"/FontFile", "FONT"),
                           (b"/AFRelationship", "FILE")):  # fmt: skip
            found = validated(tmp_path, pdf.replace(part, part[:-1] + b"z"))
            assert found and all(f"[{word}-" in line for line in found)


def validated(folder: Path, data: bytes) -> list[str]:
    """Return what pdf_oxide finds wrong with a PDF/A-3b."""
    (folder / "looked_at.pdf").write_bytes(data)
    found = pdf_oxide.PdfDocument(str(folder / "looked_at.pdf")).validate_pdf_a("3b")
    assert found["valid"] == (not found["errors"])
    return list(found["errors"])


@pytest.mark.thorough
def test_the_same_content_makes_the_same_bytes(tmp_path: Path) -> None:
    made = make_certificate(tmp_path)
    first = issue.made(made)
    assert issue.made(Certificate.model_validate(made.model_dump())) == first
    code = (
        "import sys, hashlib; from foucault.certificate import issue, said\n"
        "from foucault.certificate.content import gathered\nimport datetime\n"
        f"c = gathered('run', said.read(['laboratory.toml', 'job.toml']), issued={DAY!r})\n"
        "print(*(hashlib.sha256(d).hexdigest() for d in issue.made(c)))"
    )
    other = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "PYTHONHASHSEED": "7",
                          "TZ": "Asia/Tokyo", "LANG": "C"},
    )  # fmt: skip
    assert other.stdout.split() == [hashlib.sha256(d).hexdigest() for d in first]


def test_it_prints_every_item_that_is_asked_for(tmp_path: Path) -> None:
    made = make_full(tmp_path)
    text = words(made, signed=True)
    item = made.item
    for said in (
        made.customer.name, made.customer.street, item.description, item.serial, item.condition,
        item.customer_id, "2025-03-10", "2025-03-14", "2025-03-15", "2025-03-20",
        made.method.name, made.method.document, "hangar 4", "1013 hPa", "(45 ± 5) %",
        "9.817440 ± 0.000020 m/s²", "20 ppm relative", "G-2024-118", "2027-06-30",
        "not used: turned by hand", "k = 2", "approximately 95 %", "g-sensitivity of the gyros",
        "10 °/h/g", "31.0 %", "trimmed", "guard band w = U", "data sheet", "A. Noether",
        "the bump is left out", "relate only to the item", "except in full", "L. Foucault",
        "Head of laboratory", "steady", "rates of the table", "temperature of the hall",
        "2026-03, as agreed", made.run.sha256, "1" * 64, "the customer's name",
        "Signed electronically",
    ):  # fmt: skip
        assert said in text, said
    for row in made.rows:
        assert row.name in text and row.expanded in text
    assert words(make_certificate(tmp_path)).count("No statement of conformity is made.") == 1


@pytest.mark.skipif(shutil.which("pdftotext") is None, reason="pdftotext is not installed")
def test_each_page_has_number_page_and_count_and_the_last_one_ends_it(tmp_path: Path) -> None:
    made = make_full(tmp_path)
    term = made.left_out[0].model_copy(update={
        "what": "drift of the accelerometers' scale factors, end minus start of the session",
        "basis": "consumer MEMS, judgement; another part allows 128 (0.2 % of 250 deg/s)",
    })  # fmt: skip
    pdf = issue.made(made.model_copy(update={"left_out": (term,)}))[1]
    text = subprocess.run(["pdftotext", "-layout", "-", "-"], input=pdf, capture_output=True,
                          check=True).stdout.decode()  # fmt: skip
    pages = text.split("\f")[:-1]
    for i, one in enumerate(pages, 1):
        assert "2025-0042-r2" in one and f"Page {i} of {len(pages)}" in one
    assert "End of the certificate" in pages[-1] and "This certificate replaces" in pages[0]
    assert "End of" not in "".join(pages[:-1])
    assert "drift of the accelerometers’ scale" in text.replace("'", "’"), "columns have room"


def test_a_term_that_nobody_counted_is_said_to_be_missing(tmp_path: Path) -> None:
    made = make_certificate(tmp_path).model_copy(update={"left_out": None})
    assert "is not part of U" in words(made)


def test_a_signature_line_is_there_where_nothing_is_signed(tmp_path: Path) -> None:
    made = make_certificate(tmp_path)
    assert '"signature": ["Signature"' in words(made) and '"signature": []' in words(
        made, signed=True)  # fmt: skip


# -- the laboratory's own look -------------------------------------------------------------


def test_languages_stand_beside_one_another_and_the_first_leads(tmp_path: Path) -> None:
    both = words(make_certificate(tmp_path))
    assert '["Serial number", "Seriennummer"]' in both and "-54.19" not in both
    german = words(make_certificate(tmp_path, "[certificate]\nlanguages = ['de']\n"))
    assert "Serial number" not in german and "−54,19" in german and "Drehtisch" in german


def test_a_laboratory_has_words_and_a_language_of_its_own(tmp_path: Path) -> None:
    english = Path(dcc.__file__).parent / "labels" / "en.toml"
    text = english.read_text(encoding="utf-8").replace('"Serial number"', '"Numéro de série"')
    tables = re.sub(r"(?m)^\[(\w+)\]", r"[fr.\1]", text)
    (tmp_path / "own.toml").write_text(
        f"[fr]\n{tables}\n[en.label]\ncondition = 'State on arrival'\n"
    )
    more = "[certificate]\nlanguages = ['fr', 'en']\nlabels = 'own.toml'\n"
    said = words(make_certificate(tmp_path, more))
    assert '["Numéro de série", "Serial number"]' in said and "State on arrival" in said
    (tmp_path / "own.toml").write_text('[fr]\ntitle = "Certificat"\n')
    with pytest.raises(FoucaultError, match="The labels lack in 'fr': decimal, number"):
        words(make_certificate(tmp_path, more))
    (tmp_path / "own.toml").write_text("[en]\n")
    with pytest.raises(FoucaultError, match="no words in 'fr'; there are de, en"):
        words(make_certificate(tmp_path, more))
    (tmp_path / "own.toml").write_text("[en")
    with pytest.raises(FoucaultError, match=r"own\.toml cannot be used"):
        words(make_certificate(tmp_path, more))


SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 2 1"><path d="M0 0H2V1Z"/></svg>'


def test_a_logo_is_printed_and_a_bad_one_refused(tmp_path: Path) -> None:
    more = "[certificate.laboratory]\nlogo = 'logo.svg'\n"
    made = make_certificate(tmp_path, more)
    with pytest.raises(FoucaultError, match="it is not there, or of another kind"):
        issue.made(made)
    (tmp_path / "logo.svg").write_text(SVG)
    structure(*reversed(issue.made(made)))
    (tmp_path / "logo.svg").write_text("<svg")
    with pytest.raises(FoucaultError, match="cannot be printed"):
        issue.made(made)


def test_what_people_write_is_printed_and_never_run(tmp_path: Path) -> None:
    nasty = '#panic("x") $1/0$ *a* `b` \\u{0} <img src=x> @c #read("/etc/passwd")'
    made = make_certificate(tmp_path, f"[certificate.customer]\nname = '''{nasty}'''\n")
    structure(*reversed(issue.made(made)))
    assert json.dumps(nasty)[1:-1] in words(made)


def test_a_run_that_was_released_says_so(tmp_path: Path) -> None:
    made = make_certificate(tmp_path)
    run = made.run.model_copy(update={"verdict": "doubtful", "reasons": ("A rest moved.",)})
    said = words(made.model_copy(update={"run": run, "review": REVIEW}))
    assert "A rest moved." in said and "did not all pass" in said and "zweifelhaft" in said


def test_a_risk_is_never_nothing(tmp_path: Path) -> None:
    made = make_conforming(tmp_path, "guarded", '"accel.bias" = "90 mg"\n')
    assert made.risk < 1e-10 and "here it is at most 0.01 %" in words(made)
    assert "> 99.9 %" in words(made)


def test_a_fork_of_a_process_that_has_made_one_makes_one(tmp_path: Path) -> None:
    """Threads are not forked: whoever waits for those of Typst in a fork waits for ever."""
    made = make_certificate(tmp_path)
    here, file = issue.made(made)[1], tmp_path / "there.pdf"
    child = os.fork()
    if child == 0:
        try:
            file.write_bytes(issue.made(made)[1])
        finally:
            os._exit(0)
    until = time.monotonic() + 60.0
    while (ended := os.waitpid(child, os.WNOHANG)[0]) == 0 and time.monotonic() < until:
        time.sleep(0.05)
    if not ended:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    assert ended and file.read_bytes() == here
