"""What goes wrong between an instrument and a session is named while it happens."""

from __future__ import annotations

from pathlib import Path

import pytest
from test_listen import turned

from commands import run
from foucault.capture import recording
from foucault.capture.frame import parsed, text_of
from foucault.capture.said import Words
from foucault.capture.trouble import troubles
from foucault.cli.capture import _now
from make_frames import adis, kermit, sbg, xsens
from make_heard import PRINTED
from make_uart import misheard

TEXT = text_of("sbg_imu_short")
STREAM = b"".join(sbg(k)[0] for k in range(200))


def heard(folder: Path, data: bytes, text: str = TEXT, silence: float = 0.0) -> str:
    session = recording.Recording(folder / "s", parsed(text, "mine.toml"))
    for k in range(0, len(data), 500):
        session.take(data[k : k + 500], k * 1e-4)
    session.flush()
    found = troubles(session, silence)
    session.close()
    for language in ("en", "de"):
        for key, values in found:
            assert Words.of(language).say(key, **values)
    return " ".join(Words.of().say(key, **values) for key, values in found)


def other_message() -> bytes:
    body = bytes([6, 0, 30, 0]) + bytes(range(30))
    return (b"\xff\x5a" + body + kermit(body) + b"\x33") * 100


FIXED = """
words = "mine"
source = "mine"
sync = "FF 5A"
length = 43
order = "ORDER"
kind = "rate"
fields = [{ name = "accel", at = 12, type = "i32", count = 3, divide = 1048576, unit = "m/s^2" }]
"""


@pytest.mark.parametrize(("data", "text", "words"), [
    (STREAM, TEXT, ""),
    (misheard(STREAM, 115200, 57600), TEXT, "another baud rate"),
    (misheard(STREAM, 115200, 230400), TEXT, "another baud rate"),
    (b"".join(xsens(k)[0] for k in range(200)), TEXT, "other frames"),
    (STREAM, TEXT.replace("0x1021", "0x8005"), "another checksum"),
    (STREAM.replace(b"\x33\xff", b"\x32\xff"), TEXT, ""),
    (other_message(), TEXT, "have the instrument send it"),
    (PRINTED["arduino"](turned(0)), TEXT, "What comes is text"),
    (STREAM, FIXED.replace("ORDER", "big"), "another byte order"),
    (STREAM, FIXED.replace("ORDER", "little"), ""),
    (STREAM, FIXED.replace("ORDER", "little").replace("1048576", "1"), "hardly so"),
])  # fmt: skip
def test_what_is_wrong_is_named(data, text, words, tmp_path):
    said = heard(tmp_path, data, text)
    assert words in said and bool(words) == bool(said)


def test_a_cable_that_was_pulled(tmp_path):
    assert "is the cable in?" in heard(tmp_path, STREAM, silence=5.0)


def test_a_computer_that_slept_is_told_from_an_instrument_that_did(tmp_path):
    """The instrument's clock goes on by 60 s: with that of the computer, or without it."""
    for name, gap, slept in (("awake", 60.0, 0.0), ("asleep", 0.0, 60.0)):
        session = recording.Recording(tmp_path / name, parsed(TEXT, "sbg"))
        now = 0.0
        for k in range(400):
            session.take(sbg(k + (12_000 if k >= 200 else 0))[0], now)
            now += 0.005 + (gap if k == 199 else 0.0)
            if k % 50 == 0:
                session.flush()
        session.flush()
        assert session.slept == pytest.approx(slept, abs=0.1)
        found = {t.key: t.values for t in troubles(session, 0.0)}
        assert ("trouble.slept" in found) == bool(slept)
        assert ("slept" in session.close()) == bool(slept)


def test_the_guide_says_it_in_words(tmp_path):
    path = tmp_path / "heard.bin"
    path.write_bytes(misheard(STREAM, 115200, 57600))
    for more in ((), ("--words", "de")):
        made = run("calibrate", "--live", path, "--frames", "sbg_imu_short", "--silence", "0.3 s",
                   "-o", tmp_path / f"run{len(more)}", *more, code=1)  # fmt: skip
        assert ("Baudrate" if more else "baud rate") in made.output


def test_frames_that_are_lost_by_their_counter(tmp_path):
    data = b"".join(adis(k)[0] for k in range(0, 65536 * 2, 400))  # it wraps, and goes on
    assert "lost beside" in heard(tmp_path, data, text_of("adis16470_burst"))
    whole = b"".join(adis(k)[0] for k in range(65400, 65700))
    assert heard(tmp_path / "whole", whole, text_of("adis16470_burst")) == ""


def test_a_cable_that_is_put_back_is_told_while_it_happens(tmp_path):
    """A port that goes away and comes again: said in the lines of `capture` as it goes on."""

    class Pulled:
        name, ended, lost = "a port", False, 0

        def __init__(self) -> None:
            self.parts = [STREAM[:2000], b"", STREAM[2000:4000]]

        def read(self, wait: float) -> bytes:
            if len(self.parts) < 3 and not told:
                return b""  # what came first is told before the cable is pulled
            part = self.parts.pop(0)
            self.lost += not part
            self.ended = not self.parts
            return part

        def close(self) -> None:
            pass

    told: list[str] = []
    plug = recording.Plug(Pulled(), parsed(TEXT, "sbg"), TEXT)
    recording.record([plug], [tmp_path / "s"], tell=lambda now: told.append(_now(now)))
    assert "opened again" not in told[0] and "opened again, 1 times" in told[-1]
