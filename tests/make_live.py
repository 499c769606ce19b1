"""A simulated instrument at a pseudo-terminal: frames of an SBG, as an operator moves it."""

from __future__ import annotations

import os
import struct
import threading
import time
import tty
from collections.abc import Iterator

import numpy as np

from foucault.tables import Log
from make_frames import kermit


def frames(log: Log) -> Iterator[bytes]:
    """Write the rows of a log as frames of an SBG."""
    assert log.accel is not None
    assert log.gyro is not None
    for t, f, w in zip(log.time, log.accel, log.gyro, strict=True):
        body = struct.pack("<BBHIH3i3ih", 44, 0, 32, round(1e6 * float(t)), 0,
                           *np.round(f * 1048576).astype(int).tolist(),
                           *np.round(w * 67108864).astype(int).tolist(), 6400)  # fmt: skip
        yield b"\xff\x5a" + body + kermit(body) + b"\x33"


class Port:
    """A pseudo-terminal: `name` is the port, `send` writes to it from the other end."""

    def __init__(self) -> None:
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        self.name = os.ttyname(self.slave)

    def send(self, data: bytes) -> None:
        """Write all of it."""
        view = memoryview(data)
        while view:
            view = view[os.write(self.master, view[:2048]) :]

    def later(self, parts: Iterator[bytes], wait: float) -> threading.Thread:
        """Send parts in a thread, so long apart [s]."""

        def work() -> None:
            for part in parts:
                self.send(part)
                time.sleep(wait)

        thread = threading.Thread(target=work, daemon=True)
        thread.start()
        return thread

    def close(self) -> None:
        """Pull the cable."""
        for end in (self.master, self.slave):
            os.close(end)
