"""What `foucault apply --stream` takes of a core for readings that come over a terminal line.

    python benchmarks/stream.py            # 2 kHz for ten minutes
    python benchmarks/stream.py 500 60     # rate [Hz] and seconds

A pseudo terminal stands for the line of a sensor; lines come in bundles of 10 ms, as a driver hands
them on. Printed are the processor time of the whole command, start and compilation included, as
part of the time that went by, how many samples came out, and how late the last of each bundle was.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import threading
import time
import tty
from pathlib import Path

import numpy as np

import foucault
from foucault import campaign

TOML = """
[site]
gravity = "9.81 m/s^2"
[log]
file = "line.csv"
time = { column = "t", unit = "s" }
gyro = { columns = ["gx", "gy", "gz"], unit = "rad/s" }
accel = { columns = ["ax", "ay", "az"], unit = "m/s^2" }
[procedure]
name = "hand_rotated"
"""
BUNDLE = 0.01


def main(rate: float, seconds: float) -> None:
    """Send readings, read them back, and print what it took."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        described = campaign.parse(campaign.template("hand_rotated"), folder / "campaign.toml")
        campaign.save_session(campaign.simulate(described), folder)
        loaded = campaign.load(folder / "campaign.toml")
        foucault.save_result(campaign.calibrate(loaded), folder / "run")
        (folder / "line.toml").write_text(TOML)
        ours, theirs = os.openpty()
        tty.setraw(theirs)
        words = [sys.executable, "-m", "foucault", "apply", folder / "run", folder / "line.toml",
                 "--stream", "--force"]  # fmt: skip
        process = subprocess.Popen(words, stdin=theirs, stdout=subprocess.PIPE)
        late: list[float] = []
        rows = threading.Thread(target=receive, args=(process, late))
        rows.start()
        begun = send(ours, rate, seconds)
        time.sleep(1.0)
        os.close(theirs)
        os.close(ours)  # a terminal that hangs up ends the stream
        rows.join(30)
        process.kill()
        _, _, used = os.wait4(process.pid, 0)
        cpu, wall = used.ru_utime + used.ru_stime, time.monotonic() - begun
        out, settled = len(late), 1e3 * np.array(late[int(5 * rate) :])
        print(f"{rate:g} Hz for {seconds:g} s: {out} of {int(rate * seconds)} samples came out")
        print(f"processor time {cpu:.1f} s of {wall:.1f} s: {100 * cpu / wall:.1f} % of a core")
        print(f"late by {np.median(settled):.0f} ms (median), {settled.max():.0f} ms at most")


def send(line: int, rate: float, seconds: float) -> float:
    """Write the readings as time passes; return when it began."""
    rng = np.random.default_rng(1)
    noise = rng.normal([0, 0, 0, 0, 0, 9.8], 0.01, (1000, 6))
    os.write(line, b"t,gx,gy,gz,ax,ay,az\n")
    begun, sent = time.monotonic(), 0
    while (now := time.monotonic() - begun) < seconds or sent < rate * seconds:
        until = int(min(now, seconds) * rate)
        lines = [
            ",".join(f"{x:.6f}" for x in (begun + k / rate, *noise[k % 1000]))
            for k in range(sent, until)
        ]
        text = "".join(f"{words}\n" for words in lines).encode()
        while text:
            text = text[os.write(line, text) :]
        sent = until
        time.sleep(BUNDLE)
    return begun


def receive(process: subprocess.Popen[bytes], late: list[float]) -> None:
    """Note how late each sample is when it comes out."""
    assert process.stdout is not None
    late.extend(
        time.monotonic() - float(words.partition(b",")[0])
        for words in process.stdout
        if words[:1].isdigit()
    )


if __name__ == "__main__":
    main(*map(float, sys.argv[1:] or ("2000", "600")))
