"""A serial line bit by bit: what a receiver reads that samples it at another rate than was sent."""

from __future__ import annotations

import os
import select
import termios
import threading
import time
import tty

import numpy as np

USUAL = (4800, 9600, 19200, 38400, 57600, 115200, 230400, 460800, 500000, 921600, 1000000,
         2000000, 3000000)  # fmt: skip
RATES = {getattr(termios, f"B{n}"): n for n in USUAL if hasattr(termios, f"B{n}")}


def misheard(data: bytes, sent: int, heard: int) -> bytes:
    """Return what a receiver at `heard` baud reads of `data` sent at `sent` baud, without a pause.

    A byte is a low bit, eight bits from the least on, and a high bit.
    """
    if sent == heard:
        return data
    bits = np.unpackbits(np.frombuffer(data, np.uint8)[:, None], axis=1, bitorder="little")
    n = len(bits)
    line = np.hstack([np.zeros((n, 1), np.uint8), bits, np.ones((n, 1), np.uint8)]).ravel()
    line = np.append(line, np.ones(20, np.uint8))
    step, at, out = sent / heard, 0.0, bytearray()
    low, high = np.flatnonzero(line == 0), np.flatnonzero(line)
    while True:
        k = np.searchsorted(low, int(np.floor(at)))
        if k == len(low):
            break
        start = max(at, float(low[k]))
        samples = (start + step * (1.5 + np.arange(9))).astype(int)
        if samples[-1] >= len(line):
            break
        got = line[samples]
        out.append(int(np.packbits(got[:8], bitorder="little")[0]))
        at = start + step * 9.5
        if not got[8]:  # no stop bit: it waits until the line is high
            up = np.searchsorted(high, int(at))
            at = at if up == len(high) else max(at, float(high[up]))
    return bytes(out)


class Wire:
    """A pseudo-terminal at whose other end an instrument sends, as fast as its baud rate lets it.

    What is read at another rate is what its bits are at that rate.
    """

    def __init__(self, data: bytes, baud: int, rate: float = 12_000.0) -> None:
        """Send `data` again and again at `baud`, so many bytes a second: `rate` [1/s]."""
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        self.name, self.baud = os.ttyname(self.slave), baud
        part = data[:3000]  # of what is not understood
        self._heard = {n: misheard(part, baud, n) for n in RATES.values()} | {baud: data}
        self._rate, self._stop = rate, threading.Event()
        self._thread = threading.Thread(target=self._send, daemon=True)
        self._thread.start()

    def _send(self) -> None:
        k, last, before = 0, b"", time.monotonic()
        while not self._stop.is_set():
            heard = RATES.get(termios.tcgetattr(self.master)[5], 0)
            stream = self._heard.get(heard, b"")
            if stream is not last:  # from its start: where it begins again, its clock goes back
                k, last = 0, stream
            now = time.monotonic()  # its pace is that of the clock, whoever else wants the computer
            n = min(2000, max(1, round(self._rate * (now - before))))
            before = now
            part = stream[k : k + n]
            if select.select([], [self.master], [], 0.05)[1] and part:
                k += os.write(self.master, part)  # no more than there is room for
                k = k if k < len(stream) else 0
            time.sleep(0.01)

    def close(self) -> None:
        """Stop."""
        self._stop.set()
        self._thread.join()
        for end in (self.master, self.slave):
            os.close(end)
