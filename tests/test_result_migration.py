"""Results of earlier versions of the package, and of earlier schemas, stay readable."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from foucault import result_document
from foucault.errors import FoucaultError
from foucault.run_folder import load_result, save
from make_result import make_result
from refusals import refuses

OLD = Path(__file__).parent / "data" / "result_v1.json"
"""Saved before instrument and validity had declared keys."""


def test_a_first_version_file_loads_bit_for_bit(tmp_path: Path) -> None:
    doc = json.loads(OLD.read_text())
    assert "rate" not in doc["validity"]
    result = load_result(OLD)
    assert result.coefficients.values.tolist() == [c["value"] for c in doc["coefficients"]]
    assert result.coefficients.cov is not None
    assert result.coefficients.cov.tolist() == doc["covariance"]["matrix"]
    assert result.instrument == doc["instrument"]
    assert result.validity == doc["validity"]
    assert result.gauge == doc["gauge"]
    save(result, tmp_path)
    again = json.loads((tmp_path / "result.json").read_text())
    again["campaign"] = doc["campaign"]
    assert again == doc


def test_new_validity_fields_survive_a_round_trip(tmp_path: Path) -> None:
    validity = {
        "accel": [-9.8, 9.8], "gyro": [-2.0, 3.0], "temperature": [295.0, 299.5],
        "temperature_mean": 297.1, "rate": 100.0, "sampled": "rate", "own": {"x": [1, None]},
    }  # fmt: skip
    save(make_result(validity=validity), tmp_path)
    assert load_result(tmp_path).validity == validity


def test_a_range_has_two_ends(tmp_path: Path) -> None:
    save(make_result(), tmp_path)
    doc = json.loads((tmp_path / "result.json").read_text())
    doc["validity"]["accel"] = [1.0]
    (tmp_path / "result.json").write_text(json.dumps(doc))
    with refuses("result.invalid", match=r"validity\.accel"):
        load_result(tmp_path)


def test_steps_lead_from_an_older_schema_to_this_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A synthetic version -1 called `bounds` what 0 calls `limits` and 1 calls `validity`."""
    doc = json.loads(OLD.read_text())
    new = load_result(OLD)
    doc["schema"] = "foucault.result/-1"
    doc["bounds"] = doc.pop("validity")
    old = tmp_path / "result.json"
    old.write_text(json.dumps(doc))
    before = old.read_bytes()

    with pytest.raises(FoucaultError, match=r"has schema 'foucault.result/-1'"):
        load_result(old)

    def step(name: str, to: str, key: str, renamed: str) -> None:
        def change(given: dict) -> dict:
            return {**given, "schema": to, renamed: given.pop(key)}

        monkeypatch.setitem(result_document.MIGRATIONS, name, change)

    step("foucault.result/-1", "foucault.result/0", "bounds", "limits")
    with pytest.raises(FoucaultError, match=r"has schema 'foucault.result/0'"):
        load_result(old)  # the chain breaks off: refused with where it stopped
    step("foucault.result/0", result_document.SCHEMA, "limits", "validity")
    result = load_result(old)
    assert result.validity == new.validity
    np.testing.assert_array_equal(result.coefficients.values, new.coefficients.values)
    np.testing.assert_array_equal(result.coefficients.cov, new.coefficients.cov)
    assert old.read_bytes() == before
