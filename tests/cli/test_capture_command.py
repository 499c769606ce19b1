"""The command capture."""

from __future__ import annotations

from pathlib import Path

from commands import run
from make_frames import sbg


def growing(folder: Path, n: int = 300) -> Path:
    path = folder / "heard.bin"
    path.write_bytes(b"".join(sbg(k)[0] for k in range(n)))
    return path


def test_a_file_becomes_a_session_that_can_be_inspected(tmp_path: Path):
    made = run("capture", growing(tmp_path), "--frames", "sbg_imu_short", "-o", tmp_path / "s",
               "--silence", "0.3 s", "--for", "20 s", "--baud", 9600)  # fmt: skip
    assert made.exit_code == 0, made.output
    assert "300 rows" in made.output and "foucault inspect" in made.output
    seen = run("inspect", tmp_path / "s" / "campaign.toml")
    assert seen.exit_code in (0, 3), seen.output
    before = (tmp_path / "s" / "log.bin").read_bytes()
    again = run("capture", "--again", tmp_path / "s", "--json")
    assert again.exit_code == 0 and (tmp_path / "s" / "log.bin").read_bytes() == before


def test_without_a_frame_it_says_so(tmp_path: Path):
    path = tmp_path / "noise.bin"
    path.write_bytes(bytes(range(256)) * 20)
    words = ("--frames", "xsens_mtdata2", "-o", tmp_path / "s", "--silence", "0.2 s")
    made = run("capture", path, *words, code=3)
    assert "0 rows" in made.output and "bytes of no frame" in made.output


def test_what_is_missing_and_what_there_is(tmp_path: Path):
    listed = run("capture", "--list")
    assert "sbg_imu_short" in listed.output and "xsens_mtdata2" in listed.output
    assert "--frames" in run("capture", "udp:5005", code=1).output
    wrong = run("capture", "udp:5005", "--frames", "vectornav", "-o", tmp_path / "s", code=1)
    assert "novatel_corrimudata" in wrong.output and not (tmp_path / "s").exists()
