"""Sessions recorded as they come: every source, clocks, kills, the same bits again."""

from __future__ import annotations

import json
import os
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from foucault import campaign
from foucault.capture import recording
from foucault.capture.clock import compared
from foucault.capture.frame import Heard, parsed, text_of
from foucault.capture.source import Growing, arrivals, opened
from foucault.errors import FoucaultError
from make_frames import MADE, SENTENCES, sbg
from make_live import Port
from refusals import refuses

TEXT = text_of("sbg_imu_short")
FRAME = parsed(TEXT, "sbg_imu_short")
MANY = 400


def stream(n: int = MANY) -> bytes:
    return b"".join(sbg(k)[0] for k in range(n))


class Chunks:
    """Bytes in pieces, as if they came."""

    name, ended = "chunks", False

    def __init__(self, data: bytes, size: int = 97) -> None:
        self.data, self.size = data, size

    def read(self, wait: float) -> bytes:
        part, self.data = self.data[: self.size], self.data[self.size :]
        self.ended = not self.data
        return part

    def close(self) -> None:
        pass


def test_a_session_is_a_log_that_can_be_read(tmp_path: Path):
    said = recording.record([recording.Plug(Chunks(stream()), FRAME, TEXT)], [tmp_path / "s"])[0]
    assert said["rows"] == MANY and said["broken"] == said["junk"] == 0
    rows = recording.rows_of(tmp_path / "s", FRAME)
    np.testing.assert_allclose(rows[:, :-1], [sbg(k)[1] for k in range(MANY)], rtol=1e-12)
    log = campaign.read_log(campaign.load(tmp_path / "s" / recording.CAMPAIGN))
    np.testing.assert_allclose(log.accel, rows[:, 2:5])
    np.testing.assert_allclose(log.gyro, rows[:, 5:8])
    assert log.time[1] - log.time[0] == pytest.approx(0.005)
    assert json.loads((tmp_path / "s" / recording.SAID).read_text()) == said


def test_read_again_it_gives_the_same_bits(tmp_path: Path):
    junk = stream(50) + b"\xff\x5a\x00" + stream(60)[50:] + b"\xff"
    recording.record([recording.Plug(Chunks(junk, 31), FRAME, TEXT)], [tmp_path / "s"])[0]
    log = (tmp_path / "s" / recording.LOG).read_bytes()
    (tmp_path / "s" / recording.LOG).write_bytes(log[:100])
    recording.again(tmp_path / "s")
    assert (tmp_path / "s" / recording.LOG).read_bytes() == log


@pytest.mark.parametrize("name", ["sbg_imu_short", "adis16470_burst", "vectornav_vnymr"])
def test_when_a_row_was_heard_does_not_hang_on_how_much_is_read_at_once(name: str):
    """Torn and broken frames, junk and counters with gaps, in pieces, one by one or together."""
    frame = parsed(text_of(name), name)
    if frame.line is None:
        data = [MADE[name](k)[0] for k in (*range(40), *range(43, 60))]
        data[20] = data[20][:-3] + bytes([data[20][-3] ^ 1]) + data[20][-2:]
        data[30] += b"\xff\x5a\x08"
    else:
        data = [SENTENCES[name][0][0].encode() + b"\r\n"] * 57
        data[20] = data[20].replace(b",", b";")
    stream, sizes = b"".join(data), np.random.default_rng(3).integers(1, 90, 400)
    at = [0, *np.cumsum(sizes).tolist()]
    pieces = [(stream[a:b], 0.01 * k) for k, (a, b) in enumerate(pairwise(at)) if stream[a:b]]
    single, heard = recording.Reader(frame, one := Heard()), Heard()
    rows = np.concatenate([single.take([piece]) for piece in pieces])
    np.testing.assert_array_equal(recording.Reader(frame, heard).take(pieces), rows)
    assert len(rows) > 50 and one == heard and len(np.unique(rows[:, -1])) > 20


def test_nothing_is_recorded_over(tmp_path: Path):
    recording.record([recording.Plug(Chunks(stream(5)), FRAME, TEXT)], [tmp_path])[0]
    with pytest.raises(FoucaultError) as problem:
        recording.record([recording.Plug(Chunks(stream(5)), FRAME, TEXT)], [tmp_path])[0]
    assert problem.value.code == "capture.there"
    with refuses("capture.none"):
        recording.again(tmp_path / "none")


def send(name: str, data: bytes, folder: Path) -> tuple[str, threading.Thread]:
    """Begin to send in a thread; return how the source is named."""
    if name == "file":
        path = folder / "growing.bin"
        path.touch()

        def grow() -> None:
            with path.open("ab", buffering=0) as file:
                for at in range(0, len(data), 400):
                    file.write(data[at : at + 400])
                    time.sleep(0.002)

        return str(path), threading.Thread(target=grow)
    if name == "tcp":
        server = socket.create_server(("127.0.0.1", 0))

        def serve() -> None:
            peer, _ = server.accept()
            with peer, server:
                peer.sendall(data)
                time.sleep(0.3)

        return f"tcp:127.0.0.1:{server.getsockname()[1]}", threading.Thread(target=serve)
    if name == "udp":
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("", 0))
            port = free.getsockname()[1]

        def throw() -> None:
            time.sleep(0.2)
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
                for at in range(0, len(data), 430):
                    sender.sendto(data[at : at + 430], ("127.0.0.1", port))
                    time.sleep(0.001)

        return f"udp:{port}", threading.Thread(target=throw)
    import pty
    import tty

    master, slave = pty.openpty()
    tty.setraw(slave)

    def write() -> None:
        time.sleep(0.2)
        for at in range(0, len(data), 200):
            os.write(master, data[at : at + 200])
            time.sleep(0.001)

    return f"serial:{os.ttyname(slave)}:921600", threading.Thread(target=write)


@pytest.mark.parametrize("name", ["file", "tcp", "udp", "serial"])
def test_every_source_hands_out_all_that_comes(name: str, tmp_path: Path):
    source, sender = send(name, stream(), tmp_path)
    held = opened(source)
    sender.start()
    said = recording.record([recording.Plug(held, FRAME, TEXT)], [tmp_path / "s"], silent=0.6)[0]
    sender.join()
    assert said["rows"] == MANY and said["broken"] == 0


def test_what_was_lost_and_opened_again_is_counted(tmp_path: Path):
    """A cable that is pulled in mid-frame and put back: nothing of what was sent whole is lost."""
    server = socket.create_server(("127.0.0.1", 0))
    data = stream(60)

    def serve() -> None:
        for part in (data[:1000], data[1000 // 41 * 41 :]):
            peer, _ = server.accept()
            peer.sendall(part)
            peer.close()
            time.sleep(0.2)
        server.close()

    thread = threading.Thread(target=serve)
    thread.start()
    source = opened(f"tcp:127.0.0.1:{server.getsockname()[1]}")
    said = recording.record([recording.Plug(source, FRAME, TEXT)], [tmp_path / "s"], silent=3.0)[0]
    thread.join()
    assert said["reopened"] >= 1 and said["rows"] == 60
    assert json.loads((tmp_path / "s" / recording.SAID).read_text())["reopened"] >= 1


def test_another_program_on_the_port_and_a_full_disk_are_named(tmp_path: Path):
    import pty

    master, slave = pty.openpty()
    held = opened(f"serial:{os.ttyname(slave)}:9600")
    with pytest.raises(FoucaultError) as problem:
        opened(f"serial:{os.ttyname(slave)}:9600")
    assert problem.value.code == "capture.port" and "holds it" in problem.value.cure
    held.close()
    os.close(master)
    os.close(slave)
    session = recording.Recording(tmp_path / "s", FRAME)
    session._files[recording.RAW].close()
    with Path("/dev/full").open("wb", buffering=0) as full:
        session._files[recording.RAW] = full
        with pytest.raises(FoucaultError) as problem:
            session.take(stream(1), 0.0)
    assert problem.value.code == "output.unwritable" and "No space left" in problem.value.message
    for file in session._files.values():
        file.close()


def test_sources_that_cannot_be(tmp_path: Path):
    for given, code in (("nonsense", "capture.source"), ("udp:x", "capture.source"),
                        ("serial:/dev/nothing", "capture.port"),
                        ("tcp:127.0.0.1:1", "capture.port")):  # fmt: skip
        with refuses(code):
            opened(given)


def test_a_serial_port_without_its_library(monkeypatch):
    monkeypatch.setitem(sys.modules, "serial", None)
    with refuses("capture.no_serial"):
        opened("serial:/dev/ttyS0")


def test_a_file_written_anew_is_read_from_its_start(tmp_path: Path):
    path = tmp_path / "log.bin"
    path.write_bytes(b"abcdef")
    source = Growing(path)
    assert source.read(0.0) == b"abcdef" and source.read(0.0) == b""
    path.write_bytes(b"xy")
    assert source.read(0.0) == b"xy"


def test_a_clock_is_compared_through_delays():
    """A counter 80 ppm fast, heard late, in bursts of 20 ms, once very late."""
    rng = np.random.default_rng(4)
    off = []
    for _ in range(60):
        true = np.arange(20_000) * 5e-3
        late = rng.exponential(2e-3, len(true))
        late[5000:5600] += 0.3  # the computer slept
        host = np.maximum.accumulate(np.ceil((true + late) / 0.02) * 0.02)
        found = compared(host, true * (1 + 80e-6))
        assert found is not None
        off.append((found.rate - 80e-6) / found.rate_sd)
        assert abs(found.rate - 80e-6) < 40e-6
    assert np.sqrt(np.mean(np.square(off))) < 2.0
    assert compared(np.arange(9.0), np.arange(9.0)) is None


CHILD = """
import os, sys, time
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from make_frames import sbg
from make_live import Port
from foucault.capture import recording
from foucault.capture.frame import parsed, text_of
text = text_of("sbg_imu_short")
class Endless:
    name, ended = "endless", False
    def __init__(self): self.begun, self.sent = None, 0
    def read(self, wait):
        self.begun = self.begun or time.monotonic()
        time.sleep(0.005)
        n = int((time.monotonic() - self.begun) * 500)
        data = b"".join(sbg(k)[0] for k in range(self.sent, n))
        self.sent = n
        Path(sys.argv[1] + ".now").write_text(str(n))
        os.replace(sys.argv[1] + ".now", sys.argv[1] + ".sent")
        return data
    def close(self): pass
recording.record([recording.Plug(Endless(), parsed(text, "sbg"), text)], [Path(sys.argv[1])])[0]
"""


def killed(folder: Path, after: float) -> tuple[int, int]:
    """Kill a recording, and return how many frames were sent, and how many its log holds."""
    words = [sys.executable, "-c", CHILD, str(folder), str(Path(__file__).parents[1])]
    process = subprocess.Popen(words)
    until = time.monotonic() + 30
    while not (folder / recording.CAMPAIGN).exists() and time.monotonic() < until:
        time.sleep(0.01)
    time.sleep(after)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    told = Path(f"{folder}.sent")
    sent = int(told.read_text()) if told.is_file() else 0
    whole = len(recording.rows_of(folder, FRAME))
    raw = (folder / recording.RAW).read_bytes()
    assert recording.again(folder)["rows"] == len(raw) // len(sbg(0)[0])
    campaign.load(folder / recording.CAMPAIGN)
    return sent, whole


@pytest.mark.thorough
def test_killed_at_any_moment_a_second_is_lost_at_most(tmp_path: Path):
    rng = np.random.default_rng(1)
    for k in range(12):
        sent, held = killed(tmp_path / str(k), float(rng.uniform(0.3, 1.5)))
        assert sent - held <= 500, k  # frames of a second


def test_a_slow_disk_lets_nobody_wait(tmp_path: Path, monkeypatch):
    """Frames at 2 kHz over a pseudo-terminal, whose buffer holds 50 ms of them."""
    port, blocked = Port(), list[float]()
    real = os.fsync

    def slow(number: int) -> None:
        time.sleep(0.4)
        real(number)

    monkeypatch.setattr(os, "fsync", slow)
    monkeypatch.setattr(recording, "SAFE", 0.1)
    data = stream(3000)

    def work() -> None:
        time.sleep(0.2)
        for at in range(0, len(data), 820):
            begun = time.monotonic()
            port.send(data[at : at + 820])
            blocked.append(time.monotonic() - begun)
            time.sleep(0.01)

    source = opened(f"serial:{port.name}:921600")
    thread = threading.Thread(target=work)
    thread.start()
    try:
        said = recording.record(
            [recording.Plug(source, FRAME, TEXT)], [tmp_path / "s"], silent=1.0
        )[0]
    finally:
        thread.join()
        port.close()
    assert said["rows"] == 3000 and said["broken"] == 0
    assert max(blocked) < 0.8, max(blocked)  # 1.2 s where it is read between writing


def test_what_breaks_a_source_is_told_where_it_is_listened_to():
    class Breaks:
        name, ended = "breaks", False

        def read(self, wait: float) -> bytes:
            raise KeyboardInterrupt

        def close(self) -> None:
            pass

    with pytest.raises(KeyboardInterrupt):
        next(arrivals(Breaks()))


def test_a_temperature_that_is_not_sent_is_not_in_the_log(tmp_path: Path):
    """Frames whose items may be left out: the session can be read all the same."""
    text = text_of("xsens_mtdata2")
    data = b"".join(_xsens(k) for k in range(50))
    said = recording.record(
        [recording.Plug(Chunks(data), parsed(text, "xsens_mtdata2"), text)], [tmp_path / "s"]
    )[0]
    log = campaign.read_log(campaign.load(tmp_path / "s" / recording.CAMPAIGN))
    assert said["rows"] == len(log) == 50 and log.accel[0].tolist() == [0.0, 0.0, 9.75]


def _xsens(k: int) -> bytes:
    items = struct.pack(">HBI", 0x1060, 4, 100 * k)
    items += struct.pack(">HB3f", 0x4020, 12, 0.0, 0.0, 9.75)
    items += struct.pack(">HB3f", 0x8020, 12, 0.0, 0.0, 1e-3)
    body = struct.pack(">BBB", 0xFF, 0x36, len(items)) + items
    return b"\xfa" + body + bytes([-sum(body) & 0xFF])
