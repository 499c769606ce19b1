"""Record the screens of the first minute from real runs: `python docs/record_screens.py`.

The files are simulated sessions as loggers write them (tests/make_bare.py), and real logs where
$FOUCAULT_DATA has them (default ../shared/data); without these their screens stay as they are.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
SCREENS = HERE / "screens"
DATA = Path(os.environ.get("FOUCAULT_DATA", HERE.parents[1] / "shared" / "data"))
sys.path.insert(0, str(HERE.parent / "tests"))

RECORDED = {
    "calibrate": "foucault calibrate invensense.csv -o run --latitude '48.85 deg'",
    "phyphox": "foucault init --log phyphox.csv -o campaign.toml",
    "sensorlog": "foucault init --log sensorlog_ios.csv -o campaign.toml",
    "px4": "foucault init --log px4.csv -o campaign.toml",
    "rostopic": "foucault init --log rostopic.csv -o campaign.toml",
    "german": "foucault inspect german.csv",
    "question": "foucault calibrate arduino_print.csv -o run",
    "xsens": "foucault init --log xsens_acc.mat.gz --log xsens_gyro.mat.gz -o campaign.toml",
    "table": "foucault init --log imusysclbt.bin -o campaign.toml",
    "rest": "foucault allan x_LN100_up.ins",
    "guided": "foucault calibrate campaign.toml --live guided.bin --frames sbg_imu_short -o run "
    "--hold '5 s' --want 'accel.scale = 100 ppm' --want 'gyro.scale = 150 ppm' --silence '5 s'",
}
"""Name of a screen -> what was typed."""

REAL = ("xsens_hand_rotated/xsens_acc.mat.gz", "xsens_hand_rotated/xsens_gyro.mat.gz",
        "systematic_19_positions/imusysclbt.bin", "ln100_static/x_LN100_up.ins")  # fmt: skip


def main() -> None:
    import make_bare
    import make_guided

    SCREENS.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for logger in make_bare.LOGGERS:
            make_bare.write(logger, folder, make_bare.truth(1, 50.0, 12))
        for file in REAL:
            if (DATA / file).exists():
                shutil.copy(DATA / file, folder)
        want = {"accel.scale": "100 ppm", "gyro.scale": "150 ppm"}
        make_guided.written(folder / "guided.bin", want)
        for screen, typed in RECORDED.items():
            given = [
                w for w in typed.split() if (folder / w).suffix in (".csv", ".gz", ".bin", ".ins")
            ]
            if all((folder / file).exists() for file in given):
                (SCREENS / f"{screen}.txt").write_text(recorded(typed, folder), encoding="utf-8")


def recorded(typed: str, folder: Path) -> str:
    """Return what a command prints, without the spaces at the ends of lines."""
    import make_guided

    (folder / "campaign.toml").unlink(missing_ok=True)
    if "campaign.toml --live" in typed:
        (folder / "campaign.toml").write_text(make_guided.CAMPAIGN)
    command = typed.replace("foucault", f"{sys.executable} -m foucault", 1)
    done = subprocess.run(command, shell=True, cwd=folder, text=True, check=False,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT)  # fmt: skip
    if "Traceback (most recent call last)" in done.stdout:
        raise RuntimeError(f"{typed}: a program that crashes makes no screen\n{done.stdout}")
    lines = [line.rstrip() for line in done.stdout.rstrip().splitlines()]
    return "\n".join([f"$ {typed}", *lines]) + "\n"


if __name__ == "__main__":
    main()
