"""What fuzzing has found, each once: it was a crash, a hang, or memory without bound."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest
from make_damage import GOOD, bounded
from test_damaged_logs import described

from foucault import campaign, logs, units
from foucault.campaign.writing import changed
from foucault.errors import FoucaultError
from foucault.navigate.increments import increments_of
from foucault.tables import Log
from make_guard import MISTAKES, session
from refusals import refuses


def refused(folder: Path, file: str, content: bytes, **more: object) -> FoucaultError:
    (folder / file).write_bytes(content)
    with bounded(file), pytest.raises(FoucaultError) as caught:
        logs.read(described(file, **more), folder)
    return caught.value


def test_a_matlab_file_that_claims_two_gigabytes(tmp_path: Path) -> None:
    good = GOOD["log.mat"]
    at = good.index(b"\x09\x00\x00\x00", 130)  # the numbers of the matrix: type double, length
    bad = good[: at + 4] + (0x70000000).to_bytes(4, "little") + good[at + 8 :]
    assert refused(tmp_path, "log.mat", bad).code == "log.unreadable"


def test_an_array_that_claims_more_than_its_file_holds(tmp_path: Path) -> None:
    with zipfile.ZipFile(io.BytesIO(GOOD["log.npz"])) as z:
        parts = {i.filename: z.read(i) for i in z.infolist()}
    head = io.BytesIO()
    claim = {"descr": "<f8", "fortran_order": False, "shape": (10**9,)}
    np.lib.format.write_array_header_1_0(head, claim)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as z:
        for name, part in parts.items():
            z.writestr(name, head.getvalue() + part[128:] if name == "time.npy" else part)
    problem = refused(tmp_path, "log.npz", out.getvalue())
    assert problem.code == "log.unreadable" and "more numbers than it holds" in str(problem)


@pytest.mark.parametrize("file", ["log.csv.gz", "log.npz", "log.mat", "log.parquet"])
def test_a_file_that_ends_in_its_head(file: str, tmp_path: Path) -> None:
    assert refused(tmp_path, file, GOOD[file][:11]).code in ("log.unreadable", "log.empty")


def test_a_header_longer_than_any_file(tmp_path: Path) -> None:
    more = {"record": {"type": "float64", "columns": 7, "skip": 10**12}}
    assert refused(tmp_path, "log.bin", GOOD["log.bin"], **more).code == "log.empty"
    with pytest.raises(ValueError, match="10000"):
        described("log.bin", record={"type": "float64", "columns": 10**9})


def test_a_number_that_is_none_of_the_usual_ones(tmp_path: Path) -> None:
    signalling = np.frombuffer(b"\x01\x00\x00\x00\x00\x00\xf0\x7f", "<f8")
    rows = np.load(io.BytesIO(GOOD["log.npy"]))
    rows[3, 5] = signalling[0]
    np.save(tmp_path / "log.npy", rows)
    with refuses("log.missing_value"):
        logs.read(described("log.npy"), tmp_path)


@pytest.mark.parametrize(
    ("text", "code"),
    [("1 9^9^9^9 m", "unit.unknown"), ("1 (mm/km)^200 m", "unit.unknown"),
     ("1 m/0", "unit.unknown"), ("1e999 m", "unit.missing"), ("1e308 km", "unit.missing")],
)  # fmt: skip
def test_a_unit_without_bound(text: str, code: str) -> None:
    with refuses(code):
        units.parse(text, "length")


@pytest.mark.parametrize(
    ("procedure", "old", "new", "code", "key"),
    [("hand_rotated", 'name = "hand_rotated"', "name = []", "campaign.procedure", "[]"),
     ("turntable", "[simulate]", '[optimise]\nweights = "x"\n[simulate]', "campaign.value",
      "optimise.weights"),
     ("hand_rotated", "[simulate]", '[prior.""]\n[simulate]', "campaign.required", 'prior."".mean'),
     ("hand_rotated", "held_out = 5", "held_out = nan", "campaign.value", "procedure.held_out")],
)  # fmt: skip
def test_a_campaign(procedure: str, old: str, new: str, code: str, key: str) -> None:
    text = campaign.template(procedure)
    assert old in text
    with refuses(code, key):
        campaign.parse(text.replace(old, new, 1))


def test_keys_that_need_quotes_are_written_with_them() -> None:
    text = campaign.template("ferraris")
    read = campaign.parse(text)
    odd = {"x p": [1, 2], 'a"b': [3, 4], "": [], "é": [5, 6]}
    again = campaign.parse(changed(read, {"procedure": {"sections": odd}}, "the same"))
    assert set(again.settings.sections) == set(odd)


def test_rows_too_far_apart_to_navigate() -> None:
    x = np.zeros((5, 3))
    with pytest.raises(FoucaultError, match=r"20 s apart \(0\.05 Hz\).*ms given as s"):
        increments_of(Log(20.0 * np.arange(5), x, x))


@pytest.mark.parametrize(
    ("mistake", "words"),
    [("gyro deg", "x = [+]x, y = [+]y, z = [+]z, times 0.01745"),
     ("gyro swapped", "x = [+]y, y = [+]x, z = [+]z")],
)  # fmt: skip
def test_moves_from_face_to_face(mistake: str, words: str, tmp_path: Path) -> None:
    spoilt = MISTAKES[mistake](session("six_position"))
    with refuses("faces.moves", match=words):
        campaign.calibrate(spoilt.write(tmp_path))


@pytest.mark.parametrize("delimiter", ["00", "0", "\x80", '"', "\n", "", "-", "é"])
def test_a_delimiter_that_is_none(delimiter: str) -> None:
    with pytest.raises(ValueError, match=r"one character|at least 1 character"):
        described("log.csv", delimiter=delimiter)


def test_a_line_that_breaks_a_column_of_serial_numbers(tmp_path: Path) -> None:
    lines = GOOD["log.csv"].splitlines()
    bad = b"\n".join([*lines[:5], lines[5] + b",1", *lines[6:], b""])
    problem = refused(tmp_path, "log.csv", bad, serial="time")
    assert problem.code == "log.ragged" and "line 6" in str(problem)


@pytest.mark.parametrize("at", [0, 100])
def test_a_word_that_no_screen_holds(at: int, tmp_path: Path) -> None:
    good = GOOD["log.csv"]
    problem = refused(tmp_path, "log.csv", good[:at] + b"x" * 100_000 + good[at:])
    assert len(str(problem)) < 3000 and "xxx ... xxx" in str(problem)


def test_numbers_that_pass_for_a_matlab_file_of_a_gigabyte(tmp_path: Path) -> None:
    problem = refused(tmp_path, "log.bin", GOOD["log.bin"], format="mat")
    assert problem.code in ("log.empty", "log.unreadable")
