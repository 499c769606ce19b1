"""The command calibrate with a live source: a session that is recorded and guided."""

from __future__ import annotations

import json
from io import StringIO
from pathlib import Path

import pytest

from commands import run
from foucault.cli.guide import BAR, bar
from foucault.errors import error
from make_guided import CAMPAIGN, written

WANT = {"accel.scale": "150 ppm", "gyro.scale": "200 ppm"}
WANTED = [w for name, limit in WANT.items() for w in ("--want", f"{name} = {limit}")]


@pytest.fixture(scope="module")
def heard(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("guided")
    assert 9 < written(folder / "heard.bin", WANT) < 22
    (folder / "campaign.toml").write_text(CAMPAIGN)
    return folder


def test_a_session_is_guided_to_its_report(heard: Path, tmp_path: Path):
    made = run("calibrate", heard / "campaign.toml", "--live", heard / "heard.bin", "--frames",
               "sbg_imu_short", "-o", tmp_path / "run", "--hold", "5 s", *WANTED,
               "--silence", "5 s", code=0)  # fmt: skip
    text = made.output
    assert "Rest it on its bottom" in text and "halves the uncertainty of" in text
    assert "another side" in text and "taken up after" in text and "Enough" in text
    for name in ("report.html", "result.json", "session/raw.bin", "session/campaign.toml"):
        assert (tmp_path / "run" / name).is_file(), name


@pytest.mark.thorough
def test_as_json_in_another_language(heard: Path, tmp_path: Path):
    made = run("calibrate", heard / "campaign.toml", "--live", heard / "heard.bin", "--frames",
               "sbg_imu_short", "-o", tmp_path / "run", "--hold", "5 s", *WANTED,
               "--silence", "5 s", "--words", "de", "--json", code=0)  # fmt: skip
    states = [json.loads(line) for line in made.output.splitlines() if '"phase":' in line]
    assert states[-1]["stopped"] == "enough" and states[-1]["verdict"] == "pass"
    assert any("auf diese Kante legen" in s["task"] for s in states)
    assert [s["rests"] for s in states] == sorted(s["rests"] for s in states)
    worst = [max(b["ratio"] or 0 for b in s["bars"]) for s in states]
    assert worst[-1] <= 1 < worst[1]


def test_what_cannot_be_guided(heard: Path, tmp_path: Path):
    live = ("calibrate", "--live", heard / "heard.bin", "-o", tmp_path / "run")
    named = (*live, "--frames", "sbg_imu_short", "--silence", "0.3 s")
    assert error("guide.frames").message in run(*live, code=1).output
    assert "--want" in run(*named, "--want", "accel.scale", code=1).output
    assert "one campaign" in run(*named, heard / "a.toml", heard / "b.toml", code=1).output
    nothing = run("calibrate", "-o", tmp_path / "run", code=1)
    assert error("guide.no_log").message in nothing.output
    beside = run("calibrate", "-o", tmp_path / "run", "--want", "a = 1 g", "--hold", "1 s", code=1)
    assert error("guide.alone", options="--hold, --want").message in beside.output
    assert "en" in run(*named, "--words", "klingon", code=1).output
    (heard / "short.bin").write_bytes((heard / "heard.bin").read_bytes()[:400])
    short = ("calibrate", "--live", heard / "short.bin", "--frames", "sbg_imu_short")
    told = run(*short, "-o", tmp_path / "other", "--silence", "0.3 s", code=1)
    assert "never lay still" in told.output


def test_bars():
    assert bar(float("inf")) == "█" * BAR
    assert bar(1.0).index("|") == BAR // 2 and bar(1.0).count("█") == BAR // 2
    assert bar(10.0).count("█") == BAR and bar(0.1).count("█") == 1


@pytest.mark.thorough
def test_pictures_of_every_moment(heard: Path, tmp_path: Path):
    """What a terminal is drawn, from silence to the end."""
    from rich.console import Console

    from foucault import campaign
    from foucault.capture.frame import parsed, text_of
    from foucault.capture.live import Live
    from foucault.capture.recording import Recording
    from foucault.capture.said import Words
    from foucault.capture.ways import Asked
    from foucault.cli.guide import picture

    told = campaign.load(heard / "campaign.toml")
    live = Live(Recording(tmp_path / "s", parsed(text_of("sbg_imu_short"), "sbg")),
                Asked(told, 5.0, WANT))  # fmt: skip
    words, seen = Words.of(), {}

    def drawn() -> str:
        console = Console(width=100, record=True, file=StringIO())
        console.print(picture(live, words))
        return console.export_text()

    live.silence = 5.0
    assert "is the cable in?" in drawn()
    live.silence = 0.0
    data = (heard / "heard.bin").read_bytes()
    for k in range(0, len(data), 43 * 25):
        live.take(data[k : k + 43 * 25], k / 4300)
        phase = "learn" if live.guide is None else live.guide.phase
        if phase not in seen:
            seen[phase] = drawn()
    live.recorder.close()
    assert {"move", "rest", "next", "done"} <= set(seen)
    assert "s more" in seen["rest"] and "wanted" in seen["next"] and "Enough" in seen["done"]


def test_frames_of_a_log_are_those_of_the_instrument(heard: Path):
    from foucault.capture.frame import Decoder, parsed, text_of

    decoder = Decoder(parsed(text_of("sbg_imu_short"), "sbg"))
    rows = decoder.feed((heard / "heard.bin").read_bytes())
    assert decoder.heard.broken == decoder.heard.junk == 0 and len(rows) > 5000
