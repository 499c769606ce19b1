"""The run folder: exact round trip, nothing half-written, one clear error per mishap."""

from __future__ import annotations

import dataclasses
import io
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from foucault import run_folder
from foucault.arrays import Names
from foucault.coefficients import CoefficientVector
from foucault.errors import FoucaultError
from foucault.result import Check
from foucault.result_document import result_schema
from foucault.run_folder import load_result, parquet_writer, save
from make_result import make_result
from refusals import refuses

CAMPAIGN = 'procedure = "hand-rotated"\n'


def edit(folder: Path, change) -> None:
    file = folder / "result.json"
    doc = json.loads(file.read_text())
    change(doc)
    file.write_text(json.dumps(doc))


def files_of(folder: Path) -> dict[str, bytes]:
    return {str(f.relative_to(folder)): f.read_bytes() for f in folder.rglob("*") if f.is_file()}


def assert_same(one, other) -> None:
    for field in dataclasses.fields(one):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if field.name == "tables":
            assert a.keys() == b.keys()
            for name in a:
                assert list(a[name]) == list(b[name])
                for column in a[name]:
                    assert a[name][column].dtype == b[name][column].dtype
                    np.testing.assert_array_equal(a[name][column], b[name][column])
        elif field.name == "coefficients":
            assert a.layout == b.layout
            for part in ("values", "cov", "free", "prior_sd"):
                assert getattr(a, part).tobytes() == getattr(b, part).tobytes()
        else:
            assert a == b, field.name


def test_a_result_comes_back_bit_for_bit(tmp_path):
    result = make_result()
    path = save(result, tmp_path / "run", CAMPAIGN)
    assert path == tmp_path / "run" / "result.json"
    assert_same(load_result(path), result)
    assert_same(load_result(tmp_path / "run"), result)
    assert (tmp_path / "run" / "campaign.toml").read_text() == CAMPAIGN


def test_awkward_numbers_survive_and_nan_is_null(tmp_path):
    base = make_result()
    values = base.coefficients.values.copy()
    values[:4] = [0.1 + 0.2, 5e-324, -0.0, 1.7976931348623157e308]
    cov = base.coefficients.cov.copy()
    cov[3, :] = cov[:, 3] = np.nan  # a coefficient that could not be told
    free = np.ones(len(values), bool)
    free[0] = False
    vector = CoefficientVector(base.coefficients.layout, values, cov, free)
    checks = (*base.checks, Check("no number", float("nan"), None, 1.0, False, "It is unknown."))
    diagnostics = {"ratio": np.float64(np.inf), "counts": np.arange(3), "pair": (1, 2.5)}
    save(
        dataclasses.replace(base, coefficients=vector, checks=checks, diagnostics=diagnostics),
        tmp_path,
    )
    text = (tmp_path / "result.json").read_text()
    assert not re.search(r"NaN|Infinity", text)
    back = load_result(tmp_path)
    assert back.coefficients.values.tobytes() == values.tobytes()
    np.testing.assert_array_equal(back.coefficients.cov, cov)
    assert np.array_equal(back.coefficients.free, free)
    assert np.isnan(back.checks[-1].value)
    assert back.diagnostics == {"ratio": None, "counts": [0, 1, 2], "pair": [1, 2.5]}


def test_without_covariance_it_is_null(tmp_path):
    base = make_result()
    bare = CoefficientVector(base.coefficients.layout, base.coefficients.values)
    save(dataclasses.replace(base, coefficients=bare), tmp_path)
    assert json.loads((tmp_path / "result.json").read_text())["covariance"] is None
    assert load_result(tmp_path).coefficients.cov is None


def test_result_json_alone_is_enough_to_apply(tmp_path):
    save(make_result(), tmp_path / "run")
    copy = tmp_path / "copy.json"
    copy.write_bytes((tmp_path / "run" / "result.json").read_bytes())
    back = load_result(copy, with_tables=False)
    assert back.tables == {}
    accel = np.array([[0.1, -0.2, 9.8]])
    np.testing.assert_array_equal(
        back.model.compensate(accel, None)[0], make_result().model.compensate(accel, None)[0]
    )


def test_the_document_follows_its_schema(tmp_path):
    import jsonschema

    schema = result_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    save(make_result(), tmp_path, CAMPAIGN)
    doc = json.loads((tmp_path / "result.json").read_text())
    jsonschema.validate(doc, schema)
    del doc["frame"]
    with pytest.raises(jsonschema.ValidationError, match="frame"):
        jsonschema.validate(doc, schema)


def test_docs_name_every_key():
    text = (Path(__file__).parents[1] / "docs" / "result.md").read_text(encoding="utf-8")
    schema = result_schema()
    keys = set(schema["properties"])
    for part in schema["$defs"].values():
        keys |= set(part.get("properties", {}))
    assert sorted(k for k in keys if f"`{k}`" not in text) == []


def test_tables_carry_their_units(tmp_path):
    import pyarrow.parquet as pq

    save(make_result(), tmp_path)
    doc = json.loads((tmp_path / "result.json").read_text())
    assert doc["tables"]["rests"]["rows"] == 24
    schema = pq.read_schema(tmp_path / doc["tables"]["rests"]["file"])
    assert schema.field("norm_after").metadata[b"unit"] == b"m/s^2"
    schema = pq.read_schema(tmp_path / doc["tables"]["turns"]["file"])
    assert schema.field("angle").metadata[b"unit"] == b"rad"
    schema = pq.read_schema(tmp_path / doc["tables"]["detection"]["file"])
    assert schema.field("time").metadata[b"unit"] == b"s"


def test_saving_twice_gives_the_same_files(tmp_path):
    save(make_result(), tmp_path, CAMPAIGN)
    first = files_of(tmp_path)
    save(make_result(), tmp_path, CAMPAIGN)
    assert files_of(tmp_path) == first


def test_a_new_result_leaves_nothing_of_the_old(tmp_path):
    save(make_result(seed=1), tmp_path, CAMPAIGN)
    (tmp_path / "report.html").write_text("old")
    (tmp_path / "tables" / "mine.parquet").write_text("a file of the user")
    save(make_result(seed=2), tmp_path)
    assert_same(load_result(tmp_path), make_result(seed=2))
    names = sorted(re.sub(r"\.[0-9a-f]{8}\.", ".", n) for n in files_of(tmp_path))
    tables = ["detection.parquet", "mine.parquet", "rests.parquet", "turns.parquet"]
    assert names == ["result.json", *(f"tables/{t}" for t in tables)]


class Interrupted(BaseException):
    """Stands for Ctrl-C, which can come between any two steps."""


@pytest.mark.parametrize("kind", [OSError(28, "No space left on device"), Interrupted()])
def test_interrupted_anywhere_the_folder_holds_one_whole_result(tmp_path, monkeypatch, kind):
    old, new = make_result(seed=1), make_result(seed=2)
    outcomes = set()
    for step in range(100):
        folder = tmp_path / f"{step}"
        save(old, folder, "old")
        done = _interrupt_at(monkeypatch, step, kind)
        try:
            save(new, folder, "new")
        except (FoucaultError, Interrupted):
            pass
        finally:
            monkeypatch.undo()
        back = load_result(folder)
        outcomes.add(back.provenance["seed"])
        assert_same(back, new if back.provenance["seed"] == 2 else old)
        if not done():
            break
    assert not done()  # the loop went past the last step
    assert step >= 10 and outcomes == {1, 2}


def _interrupt_at(monkeypatch, step, kind):
    """Fail at the given writing, renaming or removing step."""
    count = iter(range(10**6))
    hit = []

    def guard(original):
        def act(*args, **kwargs):
            if next(count) == step:
                hit.append(True)
                raise kind
            return original(*args, **kwargs)

        return act

    for name in ("write_bytes", "write_text", "replace", "unlink"):
        monkeypatch.setattr(Path, name, guard(getattr(Path, name)))
    return lambda: bool(hit)


@pytest.mark.thorough
def test_killed_while_writing_the_old_result_stays(tmp_path):
    save(make_result(seed=1), tmp_path, "old")
    code = (
        "import os, pathlib, signal\n"
        "from make_result import make_result\n"
        "from foucault.run_folder import save\n"
        "replace = pathlib.Path.replace\n"
        "def stop(self, target):\n"
        "    if str(target).endswith('campaign.toml'): os.kill(os.getpid(), signal.SIGKILL)\n"
        "    return replace(self, target)\n"
        "pathlib.Path.replace = stop\n"
        f"save(make_result(seed=2), {str(tmp_path)!r}, 'new')\n"
    )
    env = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
    ended = subprocess.run([sys.executable, "-c", code], env=env)
    assert ended.returncode == -signal.SIGKILL
    assert_same(load_result(tmp_path), make_result(seed=1))
    assert (tmp_path / "campaign.toml").read_text() == "old"


def test_full_disk_says_so(tmp_path, monkeypatch):
    def full(*args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with refuses("output.unwritable", "No space left on device"):
        save(make_result(), tmp_path / "run")
    assert not (tmp_path / "run" / "result.json").exists()


def test_the_output_folder_is_a_file(tmp_path):
    (tmp_path / "run").write_text("")
    with refuses("output.unwritable", "run"):
        save(make_result(), tmp_path / "run")


# -- reading what is not a result ----------------------------------------------------------


@pytest.fixture
def folder(tmp_path):
    save(make_result(), tmp_path, CAMPAIGN)
    return tmp_path


def refused(folder: Path) -> FoucaultError:
    with pytest.raises(FoucaultError) as caught:
        load_result(folder)
    return caught.value


def test_missing(tmp_path):
    problem = refused(tmp_path / "nowhere")
    assert problem.code == "result.missing"
    assert str(problem) == (
        f"There is no '{tmp_path / 'nowhere'}'. Give a run folder or the result.json in it."
    )


def test_folder_without_result(tmp_path):
    problem = refused(tmp_path)
    assert problem.code == "result.incomplete"
    assert "holds no result.json: it is no run folder, or its run did not end." in str(problem)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "is empty, or ends before it is complete."),
        ('{"schema": "foucau', "ends before it is complete"),
        ("", "is empty, or"),
        ("time,gyro_x\n0,1\n", "from line 1, column 1 on it is no JSON"),
        ('{"schema": NaN}', "NaN is not JSON"),
        ("[1]", "it holds no object"),
    ],
)
def test_not_json(folder, text, words):
    (folder / "result.json").write_text(text)
    problem = refused(folder)
    assert problem.code == "result.not_json"
    assert words in problem.message
    assert "mend or restore it" in problem.cure


def test_binary_is_not_json(folder):
    (folder / "result.json").write_bytes(b"\xff\xfe\x00")
    problem = refused(folder)
    assert problem.code == "result.not_json" and "it is no text" in problem.message


def test_other_schema(folder):
    edit(folder, lambda doc: doc.update(schema="foucault.result/2"))
    problem = refused(folder)
    assert problem.code == "result.schema"
    assert "has schema 'foucault.result/2'" in problem.message
    assert "reads 'foucault.result/1'" in problem.message
    edit(folder, lambda doc: doc.pop("schema"))
    assert "names no schema" in refused(folder).message


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d.pop("frame"), "'frame' is missing"),
        (lambda d: d["coefficients"][2].pop("value"), "'coefficients.2.value' is missing"),
        (lambda d: d["coefficients"][0].update(value="big"), "coefficients.0.value: "),
        (lambda d: d["verdict"].update(level="fine"), "'pass', 'doubtful' or 'unusable'"),
        (
            lambda d: d["coefficients"][0].update(unit="mg"),
            "unit of accel.bias.x must be 'm/s^2'",
        ),
        (
            lambda d: d["coefficients"][0].update(kind="colour"),
            "kind 'colour' of accel.bias.x is not known",
        ),
        (lambda d: d["coefficients"].append(d["coefficients"][0]), "a coefficient appears twice"),
        (lambda d: d["covariance"]["names"].reverse(), "covariance.names differ"),
        (lambda d: d["covariance"]["matrix"].pop(), "must have 21 x 21 numbers"),
    ],
)
def test_keys_missing_or_wrong(folder, change, words):
    edit(folder, change)
    problem = refused(folder)
    assert problem.code == "result.invalid"
    assert words in problem.message


def test_many_wrong_keys_are_counted(folder):
    edit(folder, lambda d: [d.pop(k) for k in ("frame", "gauge", "equation", "site", "checks")])
    assert refused(folder).message.endswith("and 2 more.")


def test_a_key_of_a_later_writer_is_ignored(folder):
    edit(folder, lambda d: d.update(mood="good"))
    assert_same(load_result(folder), make_result())


def test_covariance_not_symmetric(folder):
    def change(doc):
        doc["covariance"]["matrix"][0][1] *= 1.01

    edit(folder, change)
    problem = refused(folder)
    assert problem.code == "result.covariance"
    assert "it is not symmetric between accel.bias.x and accel.bias.y" in problem.message


def test_covariance_negative(folder):
    def one_variance(doc):
        doc["covariance"]["matrix"][4][4] *= -1

    def one_combination(doc):
        matrix = doc["covariance"]["matrix"]
        matrix[0][1] = matrix[1][0] = 1.001 * (matrix[0][0] * matrix[1][1]) ** 0.5

    whole = (folder / "result.json").read_text()
    edit(folder, one_variance)
    assert "the variance of accel.scale.y is negative" in refused(folder).message
    (folder / "result.json").write_text(whole)
    edit(folder, one_combination)
    assert "a combination of coefficients has a negative variance" in refused(folder).message


def test_covariance_with_a_hole(folder):
    def change(doc):
        doc["covariance"]["matrix"][0][1] = doc["covariance"]["matrix"][1][0] = None

    edit(folder, change)
    assert "two coefficients of known variance is null" in refused(folder).message


def test_table_missing(folder):
    file = next((folder / "tables").glob("turns.*"))
    file.unlink()
    problem = refused(folder)
    assert problem.code == "result.table_missing"
    assert f"Table 'turns' of '{folder / 'result.json'}' is missing" in problem.message
    assert f"there is no 'tables/{file.name}'" in problem.message
    assert "Copy the whole run folder" in problem.cure


def test_table_changed(folder):
    file = next((folder / "tables").glob("rests.*"))
    data = bytearray(file.read_bytes())
    data[100] ^= 1
    file.write_bytes(data)
    problem = refused(folder)
    assert problem.code == "result.table_changed"
    assert "Table 'rests'" in problem.message and "is not the one that was saved" in problem.message


def first(**changed):
    return lambda doc: doc["coefficients"][0].update(**changed)


def variance(value):
    def change(doc):
        doc["covariance"]["matrix"][0][0] = value

    return change


DAMAGED = {
    "a text for a number": (first(value="0.25"), "coefficients.0.value: "),
    "yes for a flag": (first(free="yes"), "coefficients.0.free: "),
    "true for a number": (first(value=True), "coefficients.0.value: "),
    "a negative sd": (first(sd=-1e-4), "coefficients.0.sd: "),
    "a negative prior": (first(prior_sd=-1.0), "coefficients.0.prior_sd: "),
    "another sd": (first(sd=1.0), "sd of accel.bias.x is not the root of its variance"),
    "a text in the covariance": (variance("1e-8"), "covariance.matrix.0.0: "),
    "a negative variance": (variance(-1e-8), "the variance of accel.bias.x is negative"),
    "no variance": (variance(None), None),
    "a text for gravity": (lambda d: d["site"].update(gravity="9.8"), "site.gravity: "),
}


@pytest.mark.parametrize(("change", "words"), DAMAGED.values(), ids=DAMAGED)
def test_a_result_that_was_tampered_with(folder, change, words):
    edit(folder, change)
    if words is None:  # unknown, as where a direction was not seen
        assert np.isnan(load_result(folder).coefficients.sd[0])
        return
    problem = refused(folder)
    assert problem.code in ("result.invalid", "result.covariance")
    assert words in problem.message


def test_numbers_larger_than_any(folder):
    text = (folder / "result.json").read_text()
    (folder / "result.json").write_text(
        re.sub(r'"value": [^,]*,', '"value": 1e999,', text, count=1)
    )
    assert "coefficients.0.value: " in refused(folder).message


def test_what_is_not_known_is_not_applied(folder):
    edit(folder, first(value=None, display_value=None))
    result = load_result(folder)
    with refuses("result.unknown") as caught:
        _ = result.model
    assert caught.value.message == ("The result of hand-rotated has no number for accel.bias.x.")


def test_axes_in_a_plane_are_not_applied(folder):
    def change(doc):
        for row in doc["coefficients"]:
            if row["name"] == "gyro.scale.x":
                row.update(value=-1.0)
            elif row["name"].startswith("gyro.misalignment"):
                row.update(value=0.0)

    edit(folder, change)
    with refuses("result.singular", "the three gyro axes lie in a plane"):
        _ = load_result(folder).model


def test_numbers_have_no_dictionary_and_words_have_one():
    """One of numbers that are all different takes ten times as long as the numbers."""
    table = pa.table({"angle": np.arange(100.0), "verdict": ["pass"] * 100})
    buffer = io.BytesIO()
    with parquet_writer(table.schema, buffer) as writer:
        writer.write_table(table)
    group = parquet.ParquetFile(buffer).metadata.row_group(0)
    coded = ["RLE_DICTIONARY" in group.column(k).encodings for k in range(2)]
    assert coded == [False, True]


def test_a_long_list_has_a_line_for_each_item(tmp_path):
    items = [{"name": f"s{k}", "angles": [k, 0.5], "text": 'é "\n"'} for k in range(101)]
    run_folder.record("north", {"site": {"a": [1]}, "setups": items}).save(tmp_path)
    lines = (tmp_path / "north.json").read_text(encoding="utf-8").splitlines()
    assert json.loads("".join(lines)) == {"schema": "foucault.north/1", "site": {"a": [1]},
                                          "setups": items}  # fmt: skip
    assert lines[2:6] == [' "site": {', '  "a": [', "   1", "  ]"]  # as anything else
    assert [line for line in lines if '"name"' in line] == lines[8:109]


def test_a_long_table_is_written_by_groups_of_rows(tmp_path, monkeypatch):
    monkeypatch.setattr(run_folder, "GROUP", 3)
    x, words = np.arange(8.0), ["", "a", "b", "", "c", "d", "e", "f"]
    none = [None] * 7 + [1.5]
    table = {"x": (x, "m"), "words": (Names(pa.array(words)), ""), "late": (none, "")}
    run_folder.record("north", {"a": 1}, {"fixes": table}).save(tmp_path)
    file = parquet.ParquetFile(tmp_path / "fixes.parquet")
    assert file.metadata.num_row_groups == 3
    back = run_folder.read(tmp_path, "north")
    assert back.tables["fixes"]["x"].tolist() == x.tolist()
    assert file.read().column("words").to_pylist() == words
    assert file.read().column("late").to_pylist() == none
    assert file.schema_arrow.field("x").metadata[b"unit"] == b"m"
