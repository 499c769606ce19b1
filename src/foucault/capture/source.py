"""Where bytes come from: a serial port, a socket, standard input, a file that grows.

A source hands out what has arrived and never waits longer than it is asked to. One that ends (a
cable that was pulled, a peer that went away) is opened again until its reader gives up.
"""

from __future__ import annotations

import os
import select
import socket
import sys
import time
from collections.abc import Generator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Event, Thread
from typing import Any, Protocol

from foucault.errors import error, library

MOST = 1 << 16
"""Bytes taken at once [bytes]."""

WAIT = 0.1
"""Time to wait for bytes before something else is done [s]."""

GATHER, MUCH = 0.015, 2000
"""What arrives within this after something is handed on together [s]; sooner where it was so much
[bytes], that no buffer of a port runs over."""

PAUSE = 0.08
"""What arrives within this after something is looked at together [s]."""

AGAIN = 0.5
"""Time between two tries to open a source again [s]."""

USUAL = 115200
"""Rate of a serial port where nothing is said [Hz]."""

FORMS = "serial:PORT[:BAUD], udp:PORT, tcp:HOST:PORT, - for standard input, or a file that grows"
"""How a source is named."""


class Source(Protocol):
    """Bytes as they arrive."""

    name: str
    ended: bool  # whether nothing more can come

    def read(self, wait: float) -> bytes:
        """Return what has arrived; wait for it `wait` [s] at most."""
        ...

    def close(self) -> None:
        """Let go of it."""
        ...


def opened(name: str, baud: int | None = None) -> Source:
    """Open a source.

    `name`: one of `FORMS`; `baud` or None: of a serial port, where its name has none [Hz].
    """
    kind, _, rest = name.partition(":")
    if name == "-":
        return Pipe("standard input", sys.stdin.fileno())
    if kind == "serial" and rest:
        port, _, rate = (
            rest.rpartition(":") if rest.rpartition(":")[2].isdigit() else (rest, "", "")
        )
        return Serial(port, int(rate) if rate else baud)
    if Path(name).is_char_device():
        return Serial(name, baud)
    if kind == "udp" and rest.isdigit():
        return Udp(int(rest))
    if kind == "tcp" and ":" in rest:
        host, _, port = rest.rpartition(":")
        if port.isdigit():
            return Tcp(host, int(port))
    if Path(name).exists() or (kind == name and Path(name).parent.is_dir() and Path(name).suffix):
        return Growing(Path(name))
    raise error("capture.source", given=name, allowed=FORMS)


def together(sources: Sequence[Source]) -> Generator[list[tuple[int, bytes, float]], None, None]:
    """Yield what arrives at sources: number of the source, bytes and when; [] where all is silent.

    Each is read in a thread of its own: whoever sends does not wait until a disk has written what
    came before, or somebody has thought about it. All are stamped by one clock.
    """
    heard, stop = SimpleQueue[tuple[int, bytes, float] | BaseException | None](), Event()

    def work(number: int, source: Source) -> None:
        try:
            while not (stop.is_set() or source.ended):
                if data := source.read(WAIT):
                    heard.put((number, data, time.monotonic()))
                    time.sleep(GATHER if len(data) < MUCH else GATHER / 8)
            heard.put(None)
        except BaseException as problem:  # whoever listens is told
            heard.put(problem)

    threads = [Thread(target=work, args=one, name="source", daemon=True)
               for one in enumerate(sources)]  # fmt: skip
    for thread in threads:
        thread.start()
    left = len(threads)
    try:
        while left:
            try:
                some = [heard.get(timeout=WAIT)]
            except Empty:
                yield []
                continue
            time.sleep(PAUSE)
            while not heard.empty():
                some.append(heard.get())
            if came := [one for one in some if isinstance(one, tuple)]:
                yield came
            for one in some:
                if isinstance(one, BaseException):
                    raise one
                left -= one is None
    finally:
        stop.set()
        for thread in threads:
            thread.join(2.0)


def arrivals(source: Source) -> Generator[tuple[bytes, float], None, None]:
    """Yield what arrives at a source, and when; nothing, b"", where it is silent."""
    with closing(together([source])) as coming:
        for parts in coming:
            yield from ((data, now) for _, data, now in parts)
            if not parts:
                yield b"", time.monotonic()


@dataclass
class Pipe:
    """A pipe that another program writes to."""

    name: str
    descriptor: int  # of the open file [1]
    ended: bool = False

    def read(self, wait: float) -> bytes:
        """Return what has arrived; wait for it `wait` [s] at most."""
        if self.ended or not select.select([self.descriptor], [], [], wait)[0]:
            return b""
        data = os.read(self.descriptor, MOST)
        self.ended = not data
        return data

    def close(self) -> None:
        """Leave it to the program."""


@dataclass
class Growing:
    """A file that another program appends to."""

    path: Path
    _at: int = 0  # what of it was handed out [bytes]
    ended: bool = False

    def __post_init__(self) -> None:
        """Name it."""
        self.name = str(self.path)

    def read(self, wait: float) -> bytes:
        """Return what was appended; wait for it `wait` [s] at most."""
        until = time.monotonic() + wait
        while True:
            with suppress(FileNotFoundError), self.path.open("rb") as file:
                if file.seek(0, os.SEEK_END) < self._at:
                    self._at = 0  # it was written anew
                file.seek(self._at)
                if data := file.read(MOST):
                    self._at += len(data)
                    return data
            if time.monotonic() >= until:
                return b""
            time.sleep(min(0.02, wait))

    def close(self) -> None:
        """Nothing is held."""


class _Reopened:
    """A source that is opened again when it is lost."""

    ended = False
    lost = 0  # times that it was lost [1]

    def __init__(self, name: str, port: str = "") -> None:
        self.name = name
        try:
            self._held: Any = self._open()
        except OSError as problem:
            raise error("capture.port", port=port or name, reason=str(problem)) from None

    def _open(self) -> Any:
        raise NotImplementedError

    def _take(self, wait: float) -> bytes:
        raise NotImplementedError

    def read(self, wait: float) -> bytes:
        """Return what has arrived; wait for it `wait` [s] at most."""
        if self._held is None:
            time.sleep(min(wait, AGAIN))
            with suppress(OSError):
                self._held = self._open()
            return b""
        try:
            return self._take(wait)
        except OSError:  # the cable was pulled, or the peer went away
            self.close()
            self.lost += 1
            return b""

    def close(self) -> None:
        """Let go of it."""
        if self._held is not None:
            with suppress(OSError):
                self._held.close()
        self._held = None


class Serial(_Reopened):
    """A serial port."""

    def __init__(self, port: str, baud: int | None) -> None:
        """Open `port` at `baud` [Hz], None where nobody says at which."""
        self.chosen = baud is None  # whether this program chose the rate
        self.port, self.baud = port, baud or USUAL
        super().__init__(f"{port} at {self.baud} baud", port)

    def _open(self) -> Any:
        with library("capture.no_serial"):
            import serial
        return serial.Serial(self.port, self.baud, timeout=WAIT, exclusive=True)

    def _take(self, wait: float) -> bytes:
        # To set another time to wait would set up the port anew.
        first = self._held.read(1)
        return bytes(first + self._held.read(self._held.in_waiting)) if first else b""


class Udp(_Reopened):
    """Datagrams that are sent to a port of this computer."""

    def __init__(self, port: int) -> None:
        """Listen at `port`."""
        self.port = port
        super().__init__(f"UDP port {port}")

    def _open(self) -> socket.socket:
        held = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        held.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        held.bind(("", self.port))
        return held

    def _take(self, wait: float) -> bytes:
        if not select.select([self._held], [], [], wait)[0]:
            return b""
        data = bytes(self._held.recv(MOST))
        while len(data) < MOST and select.select([self._held], [], [], 0.0)[0]:
            data += self._held.recv(MOST)  # each is short: take all that are there
        return data


class Tcp(_Reopened):
    """A server that sends to whoever connects."""

    def __init__(self, host: str, port: int) -> None:
        """Connect to `port` of `host`."""
        self.host, self.port = host, port
        super().__init__(f"{host}:{port}")

    def _open(self) -> socket.socket:
        return socket.create_connection((self.host, self.port), timeout=5)

    def _take(self, wait: float) -> bytes:
        if not select.select([self._held], [], [], wait)[0]:
            return b""
        data = bytes(self._held.recv(MOST))
        if not data:
            raise ConnectionError("the other side closed the connection")
        return data
