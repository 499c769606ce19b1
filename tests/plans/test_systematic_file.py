"""A user's sequence as TOML: what it means, and what is said of mistakes."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.errors import FoucaultError
from foucault.plans.sequence import pointing
from foucault.plans.sequence_file import ActionTable, parse_sequence, read_sequence
from refusals import refuses

DEG = np.pi / 180

TEXT = """
name = "short"
start = ["up", "east", "north"]
[[action]]
rest = "2 min"
label = "first"
[[action]]
turn = "-90 deg"
about = "y"
rate = "20 deg/s"
ramp = "1 s"
[[action]]
rest = "90 s"
[[action]]
spin = 10
about = "north"
rate = "18 deg/s"
[[action]]
rest = "200 s"
"""


def test_a_file_is_read(tmp_path) -> None:
    path = tmp_path / "short.toml"
    path.write_text(TEXT)
    sequence = read_sequence(path)
    assert sequence.name == "short"
    assert pointing(sequence.start) == ("U", "E", "N")
    assert sequence.duration == pytest.approx(120 + 5.5 + 90 + 200.5 + 200)
    assert pointing(sequence.positions[1].C_nb) == ("N", "E", "-U")
    assert sequence.positions[0].label == "first"
    assert sequence.turned == pytest.approx({"y": 90 * DEG, "north": 3600 * DEG})
    assert sequence.actions[1].rate == pytest.approx(20 * DEG)


GIMBAL = """
start = ["up", "east", "north"]
[gimbal]
angles = [["0 deg", "0 deg"], ["90 deg", "0 deg"], ["90 deg", "180 deg"]]
rest = "60 s"
"""


def test_gimbal_angles_are_read() -> None:
    sequence = parse_sequence(GIMBAL)
    assert [pointing(p.C_nb) for p in sequence.positions] == [
        ("U", "E", "N"), ("-N", "E", "U"), ("N", "-E", "U"),
    ]  # fmt: skip
    assert sequence.duration == pytest.approx(3 * 60 + 9.5 + 18.5)
    for old, new, words in (
        ('"180 deg"]', '"180 s"]', r"`gimbal.angles\[3\]\[2\]`"),
        ("rest =", "rests =", "`gimbal.rests`.*Did you mean 'rest'"),
        ("[gimbal]", "[[action]]\nrest = '1 s'\n[gimbal]", "either"),
    ):
        with refuses("sequence.entry", match=words):
            parse_sequence(GIMBAL.replace(old, new))


@pytest.mark.parametrize(
    ("old", "new", "code", "words"),
    [
        ('rest = "2 min"', 'rest = 120', "sequence.entry", r"`action\[1\]\.rest` of .*120"),
        ('rest = "2 min"', 'rest = "2 deg"', "sequence.entry", r"action\[1\]\.rest"),
        ('rest = "2 min"', 'rest = "-2 min"', "sequence.entry", "greater than 0"),
        ('rest = "2 min"', 'rest = "2 min"\nturn = "90 deg"', "sequence.entry",
         r"action\[1\]` .*has rest and turn"),
        ('rest = "2 min"', '', "sequence.entry", "has none of them"),
        ('rest = "2 min"', 'rest = "2 min"\nrate = "1 deg/s"', "sequence.entry",
         "a rest has a time and a label, not rate"),
        ('about = "y"', '', "sequence.entry", r"action\[2\]` .*a turn needs `about`"),
        ('about = "y"', 'about = "nort"', "sequence.entry", "Did you mean 'north'"),
        ('about = "north"', 'about = "x"', "sequence.entry",
         r"action\[4\]` .*a spin needs `about`, one of east, north, up"),
        ('ramp = "1 s"', 'ramps = "1 s"', "sequence.entry", "no such key Did you mean 'ramp'"),
        ('name = "short"', 'nam = "short"', "sequence.entry", "`nam` .*Did you mean 'name'"),
        ('"east", "north"]', '"north", "east"]', "sequence.directions", "up, north, east"),
        ('"east", "north"]', '"east"]', "sequence.entry", "`start"),
        ('[[action]]', '[action]', "sequence.file", "cannot be read"),
    ],
)  # fmt: skip
def test_mistakes_are_named(old: str, new: str, code: str, words: str) -> None:
    with refuses(code, match=words):
        parse_sequence(TEXT.replace(old, new, 1))


def test_files_that_cannot_be_read(tmp_path) -> None:
    with refuses("sequence.file", "No such file"):
        read_sequence(tmp_path / "none.toml")
    with refuses("sequence.entry", match=r"the file.*either"):
        parse_sequence('name = "a"')
    with pytest.raises(FoucaultError, match="has no rest"):
        parse_sequence('[[action]]\nspin = 1\nabout = "up"')


def test_a_table_with_its_defaults_written_out_is_read_again():
    """As a run keeps its campaign."""
    for table in ({"rest": "60 s"}, {"turn": "90 deg", "about": "y", "rate": "30 deg/s"}):
        read = ActionTable.model_validate(table)
        again = ActionTable.model_validate(
            {k: v for k, v in read.model_dump().items() if v is not None}
        )
        assert again == read and again.action() == read.action()
