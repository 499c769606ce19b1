"""Lines of text: prints of an Arduino, sentences with a checksum, torn and damaged ones."""

from __future__ import annotations

from functools import reduce
from pathlib import Path

import pytest

from foucault import campaign
from foucault.capture import recording
from foucault.capture.frame import Heard, decoder_of, parsed
from refusals import refuses

PRINTS = """
words = "prints"
source = "a sketch"
line = { separator = "" }
fields = [
  { name = "time", at = 0, type = "u16", unit = "ms" },
  { name = "accel", at = 1, count = 3, unit = "m/s^2" },
  { name = "gyro", at = 4, count = 3, divide = 2, unit = "deg/s" },
]
"""
SENTENCES = PRINTS.replace('{ separator = "" }', '{ prefix = "$IMU", checksum = true }')


def printed(k: int) -> bytes:
    return f"t={40 * k % 65536}  ax:{0.5 * k} {-1.25} 9.81e0 {k} -2 .5\r\n".encode()


def row(k: int) -> tuple[float, ...]:
    return (40.0 * k, 0.5 * k, -1.25, 9.81, k / 2, -1.0, 0.25)


def sentence(k: int) -> bytes:
    body = f"IMU,{40 * k % 65536},{0.5 * k},-1.25,9.81,{k},-2,0.5"
    return f"${body}*{reduce(int.__xor__, body.encode()):02X}\r\n".encode()


@pytest.mark.parametrize(("text", "made"), [(PRINTS, printed), (SENTENCES, sentence)])
@pytest.mark.parametrize("size", [1, 7, 4096])
def test_lines_are_read_however_they_are_torn(text: str, made, size: int):
    decoder = decoder_of(parsed(text, "mine"), Heard())
    data = made(0)[5:] + b"".join(made(k) for k in range(1, 1700))  # its clock wraps once
    rows = [r for at in range(0, len(data), size) for r in decoder.feed(data[at : at + size])]
    assert rows == [pytest.approx(row(k)) for k in range(1, 1700)]
    assert decoder.heard.broken == decoder.heard.others == 0 < decoder.heard.junk


def test_a_sentence_with_any_bit_changed_is_refused():
    good = sentence(7)
    for k in range(len(good) - 2):
        for bit in range(8):
            decoder = decoder_of(parsed(SENTENCES, "mine"), Heard())
            decoder.feed(sentence(1))
            bad = bytearray(good)
            bad[k] ^= 1 << bit
            if bad.upper() != good.upper():  # 4a and 4A are the same number
                assert decoder.feed(bytes(bad) + b"\n") == [], (k, bit)


def test_other_lines_and_wrong_numbers_are_counted():
    decoder = decoder_of(parsed(SENTENCES, "mine"), Heard())
    other = b"$GPGGA,1,2*00\n"
    assert len(decoder.feed(sentence(1) + other + b"\xff\xfe\n" + sentence(2))) == 2
    assert decoder.heard.others == 1 and decoder.heard.junk == 2
    decoder = decoder_of(parsed(PRINTS, "mine"), Heard())
    decoder.feed(printed(1) + b"t=1 nan 2 3 4 5 6\n" + b"t=1 2 3\n")
    assert decoder.heard.frames == 1 and decoder.heard.broken == 2


def test_a_session_of_lines_is_a_log_and_is_made_again(tmp_path: Path):
    class Once:
        name, ended = "once", False

        def read(self, wait: float) -> bytes:
            self.ended = True
            return b"".join(printed(k) for k in range(300))

        def close(self) -> None:
            pass

    said = recording.record(
        [recording.Plug(Once(), parsed(PRINTS, "mine"), PRINTS)], [tmp_path / "s"]
    )[0]
    assert said["rows"] == 300
    log = campaign.read_log(campaign.load(tmp_path / "s" / "campaign.toml"))
    assert log.accel[10].tolist() == [5.0, -1.25, 9.81]
    assert log.time[1] - log.time[0] == pytest.approx(0.04)
    before = (tmp_path / "s" / "log.bin").read_bytes()
    recording.again(tmp_path / "s")
    assert (tmp_path / "s" / "log.bin").read_bytes() == before


def test_a_description_is_of_bytes_or_of_lines():
    for wrong in (PRINTS.replace('line = { separator = "" }', ""), PRINTS + "length = 5\n"):
        with refuses("capture.description"):
            parsed(wrong, "mine")
