"""From a real log to the file of every receiver, by the commands that a user types."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from commands import run
from foucault.export.table import receivers
from make_alignment import REAL

LOGS = [REAL / "xsens_hand_rotated" / f"xsens_{name}.mat.gz" for name in ("acc", "gyro")]


@pytest.mark.thorough
def test_a_log_in_counts_becomes_the_file_of_every_receiver(tmp_path: Path) -> None:
    if not LOGS[0].is_file():
        pytest.skip("the real logs are not here: set FOUCAULT_DATA")
    made, noise = tmp_path / "run", tmp_path / "noise"
    done = run("calibrate", *LOGS, "-o", made, "--gravity", "9.81744 m/s^2")
    assert done.exit_code in (0, 3), done.output
    done = run("allan", made / "campaign.toml", "-o", noise, "--rest", "0 s to 50 s")
    assert done.exit_code == 0, done.output
    for name in receivers():
        words = ["export", made, "--to", name, "--noise", noise, "-o", tmp_path / name]
        done = run(*words)
        if done.exit_code:  # it says itself what is lost, and how to accept that
            lost = re.findall(r"(--drop) (\S+?)\.?(?=\s)", done.stderr)
            assert lost, done.stderr
            done = run(*words, *(word for pair in lost for word in pair))
        assert done.exit_code == 0, (name, done.stderr)
        told = run("check", tmp_path / name, "--run", made, "--noise", noise, "--to", name)
        assert told.exit_code == 0 and "It says what the run says." in told.stdout, name
        assert "Nothing in it is implausible." in run("check", tmp_path / name).stdout, name
