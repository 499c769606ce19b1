"""Bare files of known truth: the dialects of loggers, and files of random order, titles and units.

A reading is right where force, rate and interval are those of the simulated session, up to axes
turned or mirrored in common. One that asks is a question; any other is wrong, and none may be.
"""

from __future__ import annotations

import os
import tempfile
from collections import Counter
from pathlib import Path

from common import DATA, each, must

import make_bare as make
from foucault.campaign.recognised import found
from foucault.errors import FoucaultError
from foucault.recognise.reading import recognise

ASKED = 0.05
"""Of the shuffled files may end in a question at most [1]."""

SESSIONS = ((1, 100.0, 16), (2, 50.0, 16), (3, 200.0, 14), (4, 104.0, 16))
"""Seed, rate [Hz] and rests [1] of the sessions that are written in random ways."""

RANDOM_SCALE = ("quadrotor",)
"""Dialects in counts of no scale that anyone uses: known as well as the instrument knows itself."""

REAL = (
    "xsens_hand_rotated/xsens_acc.mat.gz+xsens_hand_rotated/xsens_gyro.mat.gz",
    "mpu9150_hand_rotated/imu0.log", "mpu9150_hand_rotated/imu1.log",
    "ferraris_session/example_ferraris_session.csv", "ferraris_session/annotated_session.csv",
    "systematic_19_positions/imusysclbt.bin", "fog_mems_transfer/transfer_align_fog_mems.mat",
    "ln100_static/x_LN100_up.ins", "ring_laser_in_vehicle/lasergyro_0-900s.imu.gz",
    "broad_hand_motion/03_imu.parquet", "broad_hand_motion/03_pose.parquet",
)  # fmt: skip


def dialect(name: str) -> tuple[str, str, bool]:
    """Return what the file of one logger was taken for, and whether that is so."""
    log = make.truth(1, 50.0, 12)
    with tempfile.TemporaryDirectory() as folder:
        seen = recognise([make.write(name, Path(folder), log)])
        if seen.questions:
            return "asks for the rate", seen.questions[0].what, "rate" in seen.questions[0].one
        force, rate, clock, _ = make.off(seen, log, Path(folder))
    good = force < (0.05 if name in RANDOM_SCALE else 2e-3) and rate < 5e-3 and clock < 1e-6
    return ("right" if good else "wrong"), f"{force:.1e}, {rate:.1e}, {clock:.1e}", good


def shuffled(seed: int) -> str:
    log = make.truth(*SESSIONS[seed % len(SESSIONS)])
    with tempfile.TemporaryDirectory() as folder:
        return make.judged(seed, Path(folder), log)[0]


def real(files: str) -> str:
    """Return what real files were taken for, or the answer."""
    paths = [DATA / name for name in files.split("+")]
    if not all(path.exists() for path in paths):
        return "not here"
    try:
        held = found(paths)
        held.campaign  # noqa: B018
    except FoucaultError as problem:
        return problem.message
    return f"{held.session.what}: {held.session.procedure}"


def main(files: int = 500) -> tuple[bool, dict[str, object]]:
    workers = os.cpu_count() or 1
    dialects = list(each(dialect, list(make.LOGGERS), workers))
    count = Counter(each(shuffled, range(files), workers))
    answers = list(each(real, REAL, workers))
    wrong, asked = count["wrong"], count["question"]
    good = wrong == 0 and asked <= ASKED * files and all(ok for *_, ok in dialects)
    return good, {
        "dialects": [
            f"| {name} | {what} | {off} | {must(ok)} |"
            for name, (what, off, ok) in zip(make.LOGGERS, dialects, strict=True)
        ],
        "files": files, "right": count["right"], "asked": asked, "wrong": wrong,
        "percent": f"{100 * asked / files:.1f}", "most": f"{100 * ASKED:.0f}",
        "good": must(wrong == 0 and asked <= ASKED * files),
        "real": [f"| {name.replace('+', ', ')} | {a} |"
                 for name, a in zip(REAL, answers, strict=True)],
    }  # fmt: skip
