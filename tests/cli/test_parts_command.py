"""The command parts, and the noise of a data sheet in a campaign."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest

from commands import run
from foucault import campaign
from foucault.campaign.tables import NoiseTable
from foucault.errors import FoucaultError
from foucault.models.left_out import ByNoise, sizes_of
from foucault.models.parts import catalogue, noise_of
from foucault.procedures import PROCEDURES
from refusals import refuses


def test_all_parts_are_listed() -> None:
    result = run("parts", code=0)
    for name in catalogue():
        assert name in result.output
    said = json.loads(run("parts", "--json").output)
    assert [one["name"] for one in said["parts"]] == list(catalogue())


def test_one_part_with_its_sources() -> None:
    said = json.loads(run("--json", "parts", "stim300").output)
    assert said["name"] == "STIM300" and said["grade"] == "tactical MEMS"
    number = said["numbers"]["gyro.g_sensitivity"]
    assert number["text"] == "1 deg/h/g" and number["meant"] == "typical"
    assert not number["source"]["primary"] and number["unit"] == "rad/s/(m/s^2)"
    assert said["sizes"]["gyro.g_sensitivity"]["size"] == number["value"]
    text = " ".join(run("parts", "ICM-20948").output.split())
    for word in ("ICM-20948, InvenSense: consumer MEMS", "0.5 percent", "DS-000189",
                 "(not the data sheet itself)", "180 deg/h"):  # fmt: skip
        assert word in text
    assert run("parts", "MPU9255").exit_code == 1


def test_init_writes_the_noise_of_a_part(tmp_path: Path) -> None:
    file = tmp_path / "campaign.toml"
    assert run("init", "hand_rotated", "--part", "icm20948", "-o", file).exit_code == 0
    text = file.read_text()
    assert tomllib.loads(text)["noise"] == {"part": "ICM-20948"}
    assert "# accel: ICM-20948 data sheet DS-000189, revision 1.3, page 12" in text
    assert max(map(len, text.splitlines())) <= 100
    assert campaign.load(file).noise == noise_of("ICM-20948")


def test_init_writes_the_class_and_asks_for_it_once(tmp_path: Path, monkeypatch) -> None:
    file = tmp_path / "campaign.toml"
    assert run("init", "ferraris", "--grade", "tactical MEMS", "-o", file).exit_code == 0
    assert campaign.load(file).sizes == sizes_of("tactical MEMS")
    wrong = run("init", "ferraris", "--grade", "tacticle MEMS", "-o", tmp_path / "no.toml")
    assert wrong.exit_code == 1 and "tactical MEMS" in wrong.output
    asked = []

    def answer(question: str, **_: object) -> str:
        asked.append(question)
        return answers.pop(0)

    monkeypatch.setattr("typer.prompt", answer)
    assert run("init", "ferraris", "-o", tmp_path / "plain.toml").exit_code == 0
    assert not asked  # nobody is there to be asked
    monkeypatch.setattr(
        "foucault.cli.results.sys", SimpleNamespace(stdin=Person(), stdout=Person())
    )
    answers = ["", "tactical FOG", "stim300"]
    for name, part, sizes in (
        ("none", None, ByNoise()), ("class", None, sizes_of("tactical FOG")),
        ("part", "STIM300", None),
    ):  # fmt: skip
        file = tmp_path / f"{name}.toml"
        assert run("init", "ferraris", "-o", file).exit_code == 0
        made = campaign.load(file)
        assert tomllib.loads(file.read_text())["instrument"].get("part") == part
        assert sizes is None or made.sizes == sizes
    assert len(asked) == 3 and "Enter: by its noise" in asked[0]
    assert run("init", "ferraris", "--part", "STIM300", "-o", tmp_path / "b.toml").exit_code == 0
    assert len(asked) == 3


class Person:
    """A terminal."""

    @staticmethod
    def isatty() -> bool:
        return True


def test_init_says_where_a_sheet_has_no_noise(tmp_path: Path) -> None:
    text = campaign.template("hand_rotated", "ADIS16495-1")
    assert "noise" not in tomllib.loads(text)
    assert "It does not state the noise of both triads: it is measured in the rests." in text
    assert "# gyro: ADIS16495 data sheet, revision C, page 1: 0.09 deg/sqrt(h)" in text


@pytest.mark.parametrize("procedure", PROCEDURES)
def test_every_template_loads_with_a_part(procedure: str) -> None:
    assert campaign.parse(campaign.template(procedure, "STIM300")).noise == noise_of("STIM300")


def test_noise_of_a_part_is_replaced_by_what_is_given() -> None:
    table = NoiseTable.model_validate({"part": "STIM300", "gyro": {"bias_instability": 1e-6}})
    sheet = noise_of("STIM300")
    assert sheet is not None
    assert table.noise().accel == sheet.accel
    assert table.noise().gyro.white == sheet.gyro.white
    assert table.noise().gyro.bias_instability == 1e-6


def test_what_cannot_be_noise_is_told() -> None:
    with refuses("noise.part") as caught:
        NoiseTable(part="ADIS16495-1").noise()
    assert caught.value.message == (
        "noise.part: what is known of ADIS16495-1 does not state the noise of accel."
    )
    with pytest.raises(FoucaultError, match="give one of them"):
        NoiseTable(part="STIM300", grade="mems").noise()
    with pytest.raises(FoucaultError, match="There is no part 'BMX055'"):
        NoiseTable(part="BMX055").noise()
