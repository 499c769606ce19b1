"""The Digital Calibration Certificate: valid, and saying what the result says."""

from __future__ import annotations

import itertools
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from foucault import run_folder
from foucault.certificate import dcc, issue
from foucault.certificate.content import Certificate
from foucault.certificate.verify import verify
from foucault.errors import FoucaultError
from foucault.units import KINDS, _by_pint
from make_certificate import (
    make_certificate,
    make_conforming,
    make_full,
    make_run,
)
from refusals import refuses

SPACES = {"dcc": dcc.DCC, "si": dcc.SI}
UNIT = re.compile(r"(\\(metre|second|radian|kelvin|tesla)(\\tothe\{-?\d+(\.5)?\})?)+|\\one")


def root_of(made: Certificate) -> Any:
    data = dcc.made(made)
    assert dcc.faults(data) == []
    return dcc.parsed(data, "x")


def texts(root: Any, path: str) -> list[str]:
    return [" ".join(e.itertext()).strip() for e in root.iterfind(path, SPACES)]


def test_numbers_units_and_covariance_are_those_of_the_result(tmp_path: Path) -> None:
    root = root_of(make_certificate(tmp_path))
    vector = run_folder.load_result(tmp_path / "run").in_seconds
    (known,) = root.iterfind(".//dcc:result//si:realListXMLList", SPACES)

    def several(name: str) -> list[str]:
        return str(known.findtext(f".//si:{name}XMLList", namespaces=SPACES)).split()

    assert several("label") == list(vector.names)
    assert [float(v) for v in several("value")] == vector.values.tolist()
    assert [float(v) for v in several("uncertainty")] == (2 * vector.sd).tolist()
    assert set(several("coverageFactor")) == {"2.0"}
    assert several("unit")[0] == r"\metre\second\tothe{-2}"
    columns = known.iterfind(".//si:column", SPACES)
    cov = [[float(v.text) for v in c.iterfind(".//si:value", SPACES)] for c in columns]
    assert np.array_equal(cov, vector.cov)
    unit = known.findtext(".//si:column[10]/si:covariance[1]/si:unit", namespaces=SPACES)
    assert vector.names[9] == "gyro.bias.x" and unit == r"\metre\second\tothe{-3}\radian"
    factor = known.findtext(".//si:ellipsoidalRegionXMLList/si:coverageFactor", namespaces=SPACES)
    assert float(factor) == pytest.approx(np.sqrt(chi2(len(vector)).ppf(0.9545)), abs=1e-3)


def test_units_are_those_of_d_si_for_all_that_is_measured() -> None:
    for kind in KINDS:
        assert UNIT.fullmatch(dcc.unit(kind)), kind
    for first, second in itertools.product(KINDS, KINDS):
        assert UNIT.fullmatch(dcc.unit(first, second))
    assert dcc.unit("angular rate") == r"\radian\second\tothe{-1}"
    assert dcc.unit("velocity random walk") == r"\metre\second\tothe{-1.5}"
    assert dcc.unit("scale factor error", "scale factor error") == r"\one"
    assert dcc.unit("specific force", "quadratic") == r"\one"


def test_a_unit_of_d_si_measures_what_ours_does() -> None:
    ours = {"metre": "m", "second": "s", "radian": "rad", "kelvin": "K", "tesla": "T"}
    for kind in KINDS.values():
        if "count" in kind.si or kind.si == "ratio":
            continue
        parts = re.findall(r"\\(\w+?)(?:\\tothe\{(.*?)\})?(?=\\|$)", dcc.unit(kind.name))
        written = " * ".join(f"{ours[name]}^{power or 1}" for name, power in parts)
        assert _by_pint(written) == (1.0, _by_pint(kind.si)[1]), kind.name


def test_all_that_a_certificate_can_say_keeps_to_the_schema(tmp_path: Path) -> None:
    made = make_full(tmp_path)
    root = root_of(made)
    core = "dcc:administrativeData/dcc:coreData/"
    assert texts(root, f"{core}dcc:uniqueIdentifier") == ["2025-0042-r2"]
    assert texts(root, f"{core}*/dcc:replacedUniqueIdentifier") == ["2025-0042-r1"]
    assert texts(root, f"{core}dcc:endPerformanceDate") == ["2025-03-15"]
    assert texts(root, ".//dcc:influenceCondition/dcc:status") == [
        "beforeAdjustment", "afterAdjustment"]  # fmt: skip
    said = " ".join(texts(root, ".//dcc:statement"))
    for words in ("relate only", "A. Noether", "the bump is left out", "steady", "2026-03",
                  "guard band w = U", "rates of the table", "turned by hand", "hangar 4",
                  "9f2c" * 16, made.run.sha256, "1" * 64):  # fmt: skip
        assert words in said, words
    each = texts(root, ".//dcc:metaData/dcc:conformity")
    assert len(each) == 6 and set(each) == {"pass", "conditionalFail"}
    assert texts(root, ".//dcc:statement/dcc:conformity") == ["conditionalFail"]
    assert texts(root, ".//dcc:measuringEquipment/dcc:name")[:3] == list(made.used)


def test_after_a_repair_the_results_are_those_after_it(tmp_path: Path) -> None:
    make_run(tmp_path / "before", seed=8)
    more = "[certificate.adjustment]\ndone = 'repaired'\nwords = 'new gyro'\nbefore = 'before'\n"
    root = root_of(make_certificate(tmp_path, more))
    states = texts(root, ".//dcc:influenceCondition/dcc:status")
    assert states == ["beforeRepair", "afterRepair"]
    before, after = root.iterfind(".//dcc:measurementResult", SPACES)
    was = run_folder.load_result(tmp_path / "before").in_seconds
    lists = [e.text for e in before.iterfind(".//dcc:result//si:valueXMLList", SPACES)]
    assert [float(v) for v in lists[0].split()] == was.values.tolist()
    assert before.find(".//si:covarianceMatrix", SPACES) is None
    assert after.find(".//si:covarianceMatrix", SPACES) is not None


def test_an_open_decision_says_on_which_side_it_lies(tmp_path: Path) -> None:
    made = make_conforming(tmp_path, "guarded")
    row = next(r for r in made.rows if r.name == "accel.scale.x")
    assert row.decision == "undecided" and dcc.conformity(row) == "conditionalFail"
    inside = row.model_copy(update={"limit": abs(row.value) * 1.001})
    assert dcc.conformity(inside) == "conditionalPass"


def test_signs_that_no_file_holds_become_a_mark(tmp_path: Path) -> None:
    made = make_certificate(tmp_path)
    run = made.run.model_copy(update={"equation": "a\x00b & <c> \ud800"})
    root = root_of(made.model_copy(update={"run": run}))
    assert "a\ufffdb & <c> \ufffd" in " ".join(texts(root, ".//dcc:usedMethod"))


def test_an_invalid_one_is_refused_with_the_place(tmp_path: Path) -> None:
    data = dcc.made(make_certificate(tmp_path)).replace(b">FR<", b">France<", 1)
    (fault, *_) = dcc.faults(data)
    assert "countryCodeISO3166_1" in fault and "pattern" in fault
    made = make_certificate(tmp_path)
    with pytest.raises(FoucaultError, match=r"does not keep to its schema: .*uniqueIdentifier"):
        issue.made(made.model_copy(update={"number": " 7"}))


@pytest.mark.parametrize(
    "data",
    [b"", b"<a", b"<a/>", b"\x00" * 9, b"<!DOCTYPE a [<!ENTITY b SYSTEM 'file:///etc/passwd'>]>"
     b"<a>&b;</a>"],
)  # fmt: skip
def test_what_is_no_dcc_is_said(data: bytes) -> None:
    with pytest.raises(FoucaultError, match="is no Digital Calibration Certificate"):
        dcc.parsed(data, "x.xml")


def test_the_licence_of_the_schemas_lies_beside_them() -> None:
    assert "Version 3, 29 June 2007" in (dcc.SCHEMAS / "COPYING.LESSER").read_text()
    assert "GNU GENERAL PUBLIC LICENSE" in (dcc.SCHEMAS / "COPYING").read_text()
    for file in dcc.SCHEMAS.glob("*.xsd"):
        assert "Physikalisch-Technische Bundesanstalt" in file.read_text(encoding="utf-8")


@pytest.mark.parametrize("declared", ['<!ENTITY x SYSTEM "file:///etc/passwd">', ""])
def test_a_certificate_that_declares_anything_is_none(tmp_path: Path, declared: str) -> None:
    file, used = tmp_path / "c.xml", "&x;" if declared else ""
    file.write_text(
        f'<?xml version="1.0"?><!DOCTYPE d [{declared}]><dcc:digitalCalibrationCertificate '
        f'xmlns:dcc="https://ptb.de/dcc">{used}</dcc:digitalCalibrationCertificate>'
    )
    with refuses("certificate.xml", match="it declares entities"):
        verify(file)
