"""What a certificate says: every item of ISO/IEC 17025 or a refusal that names it."""

from __future__ import annotations

import dataclasses
import itertools
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel
from scipy.stats import norm

from foucault import run_folder
from foucault.certificate import said
from foucault.certificate.content import (
    K,
    Replaced,
    gathered,
    revision,
    rounded,
)
from foucault.certificate.labels import Labels
from foucault.certificate.said import Said
from foucault.errors import FoucaultError
from foucault.result import Level
from make_certificate import (
    DAY,
    REVIEW,
    make_certificate,
    make_conforming,
    make_laboratory,
    make_run,
)
from make_result import make_result
from refusals import refuses


def refused(home: Path, more: str, **about: Any) -> str:
    with pytest.raises(FoucaultError) as problem:
        make_certificate(home, more, **about)
    assert problem.value.code.startswith("certificate.")
    return str(problem.value)


def needed(model: type[BaseModel] = Said, before: str = "") -> Iterator[str]:
    """Yield every key that has to be said."""
    for name, field in model.model_fields.items():
        kind = field.annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            yield from needed(kind, f"{before}{name}.") if field.is_required() else ()
        elif field.is_required():
            yield before + name


FROM_RUN = {"item.model", "item.serial", "method.name", "conditions.temperature"}
ITEMS = sorted(set(needed()) - {"issued"})


@pytest.mark.parametrize("item", ITEMS)
def test_an_item_that_is_missing_refuses_the_certificate_by_its_name(
    item: str, tmp_path: Path
) -> None:
    run, *files = make_laboratory(tmp_path)
    if item in FROM_RUN:
        result = dataclasses.replace(make_result(), validity={}, instrument={})
        run = run_folder.save(result, tmp_path / "bare").parent
    raw = said.read(files)
    table: Any = raw
    *tables, key = item.split(".")
    for one in tables:
        table = table.get(one, {})
    table.pop(key, None)
    if item == "method.name":  # the run says it
        assert gathered_name(run, raw)
        return
    with pytest.raises(FoucaultError, match="The certificate lacks") as problem:
        gathered(run, raw, issued=DAY)
    assert item in problem.value.message


def gathered_name(run: Path, raw: Mapping[str, Any]) -> bool:
    raw = said.over(
        raw, {"item": {"model": "a", "serial": "b"}, "conditions": {"temperature": "c"}}
    )
    return "procedure hand-rotated" in gathered(run, raw, issued=DAY).method.name


def test_there_are_more_than_twenty_of_them() -> None:
    assert len(ITEMS) > 20 and {"customer.name", "item.condition", "number"} <= set(ITEMS)


def test_all_that_is_missing_is_named_at_once(tmp_path: Path) -> None:
    run, *_ = make_laboratory(tmp_path)
    with pytest.raises(FoucaultError) as problem:
        gathered(run, {}, issued=DAY)
    assert "number" in problem.value.message and "and 11 more" in problem.value.message


@pytest.mark.parametrize("what", ["gravity", "table", "clock", "thermometer"])
def test_each_reference_is_named_or_said_not_to_be_used(what: str, tmp_path: Path) -> None:
    run, *files = make_laboratory(tmp_path)
    raw = said.read(files)
    raw["unused"].pop(what, None)
    raw["used"] = [n for n in raw["used"] if raw["references"][n]["what"] != what]
    with pytest.raises(FoucaultError, match=rf"used or unused\.{what}"):
        gathered(run, raw, issued=DAY)
    raw["unused"][what] = "for a reason"
    assert gathered(run, raw, issued=DAY).unused[what] == "for a reason"


# -- what is wrong -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("[certificate]\nnumbr = '1'", "No certificate has numbr. Did you mean 'number'?"),
        ("[certificate]\nnumber = '../1'", "number cannot be '../1'"),
        ("[certificate]\nreceived = 2025-03-15", "performed (2025-03-14) is before received"),
        ("[certificate]\nissued = 2025-03-13", "issued (2025-03-13) is before"),
        ("[certificate]\nused = ['gravimeter']", "used or unused.clock"),
        ("[certificate]\nused = ['gravimeter point 3', 'frequency standard', 'thermometer 12', "
         "'thermometer 13']", "No reference is called 'thermometer 13'. Did you mean"),
        ("[certificate.references.'thermometer 12']\ndue = 2025-01-31",
         "The certificate of thermometer 12 counted until 2025-01-31"),
        ("[certificate.item]\nserial = '7'", "says serial number 7; the run is of 0180-2214"),
        ("[certificate.adjustment]\ndone = 'adjusted'", "lacks adjustment.words"),
        ("[certificate.place]\nkind = 'customer'", "lacks place.words"),
        ("[certificate.adjustment]\nbefore = 'nowhere'", "adjustment.before names"),
        ("[certificate.laboratory]\ncountry = 'France'", "laboratory.country cannot be 'France'"),
        ("[certificate]\nitem = 'x'", "item cannot be 'x'"),
        ("[certificate]\nused = 7", "used cannot be '7'"),
        ("[certificate]\nreferences = 7\nunused = 7\nlaboratory = []", "cannot be"),
        ("certificate = 7\n", "it should hold [certificate] and nothing else"),
        ("[other]\n", "it should hold [certificate] and nothing else"),
        ("[certificate\n", "more.toml cannot be used"),
    ],
    ids=itertools.count(),
)  # fmt: skip
def test_what_is_wrong_is_said(more: str, words: str, tmp_path: Path) -> None:
    assert words in refused(tmp_path, more)


def test_a_file_that_is_not_there_is_named() -> None:
    with pytest.raises(
        FoucaultError,
        match=r"nowhere\.toml cannot be used: No such file.*a table \[certificate\]; the doc",
    ):
        said.read(["nowhere.toml"])


def test_a_run_that_did_not_pass_needs_somebody_who_releases_it(tmp_path: Path) -> None:
    run, *files = make_laboratory(tmp_path, level=Level.DOUBTFUL)
    raw = said.read(files)
    with pytest.raises(FoucaultError, match="The run is doubtful: ") as problem:
        gathered(run, raw, issued=DAY)
    assert "--reviewer NAME --reason TEXT" in problem.value.cure
    assert gathered(run, raw, issued=DAY, review=REVIEW).review == REVIEW
    run = make_run(tmp_path / "good")
    assert gathered(run, raw, issued=DAY, review=REVIEW).review is None


def test_results_without_a_number_are_refused(tmp_path: Path) -> None:
    run, *files = make_laboratory(tmp_path)
    doc = json.loads((run / "result.json").read_text())
    doc["coefficients"][2]["value"] = None
    (run / "result.json").write_text(json.dumps(doc))
    with pytest.raises(FoucaultError, match=r"uncertainty of accel\.bias\.z"):
        gathered(run, said.read(files), issued=DAY)


def test_a_folder_that_was_edited_is_refused(tmp_path: Path) -> None:
    _, *files = make_laboratory(tmp_path)
    run = tmp_path / "kept"
    run_folder.save(make_result(), run, "# resolved campaign of a run\nx = 1\n")
    gathered(run, said.read(files), issued=DAY)
    (run / "campaign.toml").write_text("# resolved campaign of a run\nx = 2\n")
    with pytest.raises(FoucaultError, match="is not the file that its result names"):
        gathered(run, said.read(files), issued=DAY)
    table = next((run / "tables").glob("rests*.parquet"))
    table.write_bytes(table.read_bytes()[:-1] + b"\0")
    with refuses("result.table_changed"):
        gathered(run, said.read(files), issued=DAY)


# -- numbers -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "expanded", "words"),
    [
        (54.1934, 0.1312, ("54.19", "0.14")),  # up, not to the nearest
        (-6099.0, 104.0, ("-6100", "110")),
        (0.03, 0.995, ("0.0", "1.0")),
        (-0.001, 0.13, ("0.00", "0.13")),
        (1.0, 2.5e-7, ("1.00000000", "0.00000025")),
        (123456.0, 4000.0, ("123500", "4000")),
    ],
)
def test_an_uncertainty_is_rounded_up_to_two_digits(
    value: float, expanded: float, words: tuple[str, str]
) -> None:
    assert rounded(value, expanded) == words


def test_a_rounded_uncertainty_is_never_smaller_and_hardly_larger() -> None:
    rng = np.random.default_rng(1)
    for u in np.exp(rng.uniform(-20, 20, 2000)):
        shown = float(rounded(0.0, u)[1])
        assert u * (1 - 1e-6) <= shown <= u * 1.1 + 1e-12


def test_results_are_in_seconds_and_those_that_were_held_are_none(tmp_path: Path) -> None:
    made = make_certificate(tmp_path)
    result = run_folder.load_result(tmp_path / "run")
    rows = {r.name: r for r in made.rows}
    own = dict(zip(result.coefficients.names, result.coefficients.sd, strict=True))
    assert rows["gyro.scale.x"].sd == pytest.approx(np.hypot(own["gyro.scale.x"], 2e-5))
    assert rows["accel.bias.x"].sd == own["accel.bias.x"]
    np.testing.assert_allclose(np.diag(made.covariance), [r.sd**2 for r in made.rows])
    free = result.coefficients.free.copy()
    free[0] = False
    vector = dataclasses.replace(result.coefficients, free=free)
    run_folder.save(dataclasses.replace(result, coefficients=vector), tmp_path / "run")
    raw = said.read([tmp_path / "laboratory.toml", tmp_path / "job.toml"])
    less = gathered(tmp_path / "run", raw, issued=DAY)
    assert less.held == ("accel.bias.x",) and len(less.rows) == len(made.rows) - 1
    assert len(less.covariance) == len(less.rows)


def test_a_decision_keeps_its_guard_band_and_tells_its_risk(tmp_path: Path) -> None:
    made = make_conforming(tmp_path, "guarded")
    limited = [r for r in made.rows if r.limit is not None]
    assert {r.name.rpartition(".")[0] for r in limited} == {"accel.bias", "accel.scale"}
    for r in limited:
        size, U = abs(r.value), K * r.sd
        want = "pass" if size + U <= r.limit else "fail" if size - U > r.limit else "undecided"
        assert r.decision == want
        inside = norm(r.value, r.sd).cdf([-r.limit, r.limit])
        assert r.probability == pytest.approx(np.diff(inside)[0], abs=1e-12)
    # accel.scale.x is -6100 ppm, 2 sd from its limit
    assert made.decision == "undecided" and made.risk <= norm.sf(2.0)
    alone = make_conforming(tmp_path, "guarded", '"accel.bias" = "60 mg"\n')
    assert alone.decision == "pass"


def test_simple_acceptance_has_no_guard_band(tmp_path: Path) -> None:
    made = make_conforming(tmp_path, "simple")
    for r in (r for r in made.rows if r.limit is not None):
        assert r.decision == ("pass" if abs(r.value) <= r.limit else "fail")
    assert made.decision == "fail"
    near = next(r for r in made.rows if r.name == "accel.bias.x")
    edge = abs(near.value) * (1 + 1e-9) / 9.80665 * 1e3
    risky = make_conforming(tmp_path, "simple", f'"accel.bias.x" = "{edge:.9f} mg"\n')
    assert risky.decision == "pass" and risky.risk == pytest.approx(0.5, abs=1e-3)


def test_results_before_an_adjustment_stand_beside_those_after(tmp_path: Path) -> None:
    make_run(tmp_path / "before", seed=8)
    more = "[certificate.adjustment]\ndone = 'adjusted'\nwords = 'trimmed'\nbefore = 'before'\n"
    made = make_certificate(tmp_path, more)
    was = run_folder.load_result(tmp_path / "before").in_seconds
    for r in made.rows:
        assert r.before == was.value(r.name) != r.value and "±" in r.shown_before


def test_no_interval_is_recommended_unless_it_was_agreed(tmp_path: Path) -> None:
    assert make_certificate(tmp_path).next_due == ""
    assert make_certificate(tmp_path, "[certificate]\nnext_due = '2026-03'\n").next_due == "2026-03"


@pytest.mark.parametrize(
    ("number", "before", "want"),
    [
        ("7", "7", "7-r1"),
        ("7", "7-r1", "7-r2"),
        ("7-r1", "7-r9", "7-r10"),
        ("a-r", "a-r", "a-r-r1"),
    ],
)
def test_a_revision_counts_on(number: str, before: str, want: str) -> None:
    assert revision(number, before) == want


def test_a_revision_is_one_of_the_same_certificate(tmp_path: Path) -> None:
    other = Replaced(number="2025-0041", sha256="0" * 64, change="x")
    assert "The certificate to replace is 2025-0041" in refused(tmp_path, "", replaces=other)
    mine = Replaced(number="2025-0042", sha256="0" * 64, change="x")
    assert make_certificate(tmp_path, replaces=mine).number == "2025-0042-r1"


def test_a_certificate_is_made_of_the_files_that_the_documentation_shows(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "certificate.md").read_text()
    for name, text in re.findall(r":caption: (\w+\.toml)\n\n(.*?)```", page, re.S):
        (tmp_path / name).write_text(text)
    files = [tmp_path / "laboratory.toml", tmp_path / "job.toml"]
    made = gathered(make_run(tmp_path / "run"), said.read(files), issued=DAY)
    assert made.number == "2025-0042" and len(made.traced) == 3
    own = Labels(made.languages, str(tmp_path / "labels.toml"))
    assert own.first("label.condition") == "State on arrival"
    text = " ".join(re.findall(r"`([a-z_.]+)`", page))
    assert {"performed_until", "place.kind", "from_customer", "next_due"} <= set(text.split())
    every = {k.rpartition(".")[2] for k in Said.model_fields}
    shown = set(re.findall(r"[a-z_]+", page))
    assert every <= shown, "every key has its place on the page"
