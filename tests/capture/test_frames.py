"""Every shipped description decodes frames that are spelled out, and refuses damaged ones."""

from __future__ import annotations

import numpy as np
import pytest

from foucault import campaign
from foucault.capture.frame import (
    Checksum,
    Decoder,
    Heard,
    crc,
    decoder_of,
    parsed,
    shipped,
    text_of,
)
from foucault.capture.recording import campaign_of
from make_frames import MADE, SENTENCES, adis, crc_bitwise, novatel, sbg, xsens
from refusals import refuses

CHECK = b"123456789"


@pytest.mark.parametrize(
    ("bits", "poly", "init", "reflected", "final", "check"),
    [
        (16, 0x1021, 0, True, 0, 0x2189),  # KERMIT, of sbgECom
        (16, 0x1021, 0, False, 0, 0x31C3),  # XMODEM
        (16, 0x1021, 0xFFFF, False, 0, 0x29B1),
        (32, 0x04C11DB7, 0xFFFFFFFF, True, 0xFFFFFFFF, 0xCBF43926),
    ],
)
def test_checks_of_the_catalogue(bits, poly, init, reflected, final, check):
    assert crc(CHECK, bits, poly, init, reflected) ^ final == check
    rng = np.random.default_rng(bits)
    for _ in range(20):
        data = rng.bytes(int(rng.integers(1, 60)))
        start = int(rng.integers(1 << bits))
        turned = int(f"{start:0{bits}b}"[::-1], 2) if reflected else start
        assert crc(data, bits, poly, turned, reflected) == crc_bitwise(
            data, poly, start, bits, reflected
        )


def test_other_checksums():
    assert Checksum(kind="fletcher16", last=-2, at=-2).of(b"abcde") == 0xC8F0
    assert Checksum(kind="xor8", last=-1, at=-1).of(b"\x01\x02\x04") == 7
    assert Checksum(kind="sum8", last=-1, at=-1, negated=True).of(b"\xff\x02") == 0xFF
    told = Checksum(kind="crc32", last=-4, at=-4, poly=0x04C11DB7, reflected=True)
    assert told.of(CHECK) == crc_bitwise(CHECK, 0x04C11DB7, 0, 32, True)


def decoder(name: str) -> Decoder:
    return Decoder(parsed(text_of(name), name))


def test_there_are_frames_for_every_description():
    assert MADE.keys() | SENTENCES.keys() == set(shipped())


@pytest.mark.parametrize("name", MADE)
def test_a_frame_is_read_and_a_damaged_one_refused(name):
    raw, row = MADE[name](3)
    heard = decoder(name)
    after = MADE[name](4)[0] if not heard.frame.sync else b""  # one alone may fit by chance
    assert heard.feed(raw + after)[0] == pytest.approx(row, rel=1e-12)
    assert len(heard.frame.columns) == len(row)
    for at in range(len(raw)):
        for bit in (0, 5):
            damaged = bytearray(raw)
            damaged[at] ^= 1 << bit
            fresh = decoder(name)
            good = [MADE[name](k) for k in (4, 5, 6)]
            rows = fresh.feed(bytes(damaged) + b"".join(g[0] for g in good) + b"\xa7" * 300)
            unchecked = name == "sbg_imu_short" and at == len(raw) - 1  # its last byte
            assert len(rows) == 3 + unchecked
            assert rows[-3:] == [pytest.approx(g[1], rel=1e-12) for g in good], (at, bit)


@pytest.mark.parametrize("name", MADE)
def test_torn_anywhere_with_junk_between_none_is_lost(name):
    rng = np.random.default_rng(2)
    made = [MADE[name](k) for k in range(60)]
    stream = b""
    for raw, _ in made:
        stream += raw
        if name != "adis16470_burst" and rng.random() < 0.4:
            stream += rng.bytes(int(rng.integers(1, 9)))
    heard, rows, at = decoder(name), [], 0
    while at < len(stream):
        step = int(rng.integers(1, 70))
        rows += heard.feed(stream[at : at + step])
        at += step
    rows += heard.feed(b"\xa7" * 5000)  # what an unlucky length waited for
    assert rows == [pytest.approx(row, rel=1e-12) for _, row in made]
    whole = decoder(name)
    assert whole.feed(stream + b"\xa7" * 5000) == rows


@pytest.mark.parametrize("name", SENTENCES)
def test_sentences_that_instruments_have_sent_are_read_and_damaged_ones_refused(name):
    for text, row in SENTENCES[name]:
        told, line = parsed(text_of(name), name), text.encode() + b"\r\n"
        heard = decoder_of(told, Heard())
        assert heard.feed(line) == [pytest.approx(row, rel=1e-12)]
        assert len(told.columns) == len(row)
        for at in range(len(text)):
            for bit in range(8):
                damaged = bytearray(line)
                damaged[at] ^= 1 << bit
                if damaged.upper() == line.upper():  # 4a and 4A are the same number
                    continue
                fresh = decoder_of(told, Heard())
                fresh.feed(line)
                assert fresh.feed(bytes(damaged) + b"\n") == [], (at, bit)


def test_the_attitude_in_a_sentence_predicts_its_accelerations():
    """Forward, right, down, and +1 g up: so are the axes of these instruments."""
    for text, row in SENTENCES["vectornav_vnymr"]:
        _, pitch, roll = np.radians([float(x) for x in text.split(",")[1:4]])
        f = 9.81 * np.array([np.sin(pitch), -np.cos(pitch) * np.sin(roll),
                             -np.cos(pitch) * np.cos(roll)])  # fmt: skip
        assert np.abs(f - row[:3]).max() < 0.25


def test_another_scale_another_precision_another_message():
    raw, row = sbg(2, high=True)
    assert decoder("sbg_imu_short").feed(raw) == [pytest.approx(row, rel=1e-12)]
    raw, row = xsens(2, double=True)
    assert decoder("xsens_mtdata2").feed(raw) == [pytest.approx(row, rel=1e-12)]
    raw, row = novatel(2, 1362)
    assert decoder("novatel_corrimudata").feed(raw) == [pytest.approx(row, rel=1e-12)]
    heard = decoder("novatel_corrimudata")
    assert heard.feed(novatel(2, 42)[0]) == [] and heard.heard.others == 1


def test_counters_that_wrap_go_on_and_tell_what_is_lost():
    heard = decoder("adis16470_burst")
    rows = heard.feed(b"".join(adis(k)[0] for k in (65533, 65534, 65535, 65536, 65540)))
    # Frames without a time of their own are counted by their rows: those lost are rows of nothing.
    assert [row[-1] for row in rows if row[-1] == row[-1]] == [65533, 65534, 65535, 65536, 65540]
    assert len(rows) == 8
    assert heard.heard.lost == 3


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        ("words =", "capture.description", "Invalid value"),
        ('words = "a"\nsource = "b"\nsync = "XY"\nlength = 8\nfields = []', "capture.description",
         "hexadecimal"),
        ('words = "a"\nsource = "b"\nsync = "AA"\nlength = 8\nfields = []', "capture.description",
         "neither accel nor gyro"),
        ('words = "a"\nsource = "b"\nlength = 8\nfields = []', "capture.description", "checksum"),
    ],
)  # fmt: skip
def test_descriptions_that_cannot_be_meant(text, code, words):
    with refuses(code, words):
        parsed(text, "mine.toml")


def test_unknown_names_say_what_there_is():
    with refuses("capture.unknown", "sbg_imu_short"):
        text_of("nonsense")


def test_frames_of_pymavlink_are_read_in_the_axes_of_results(tmp_path):
    """What another program writes; forward-right-down becomes right-forward-up."""
    mavlink2 = pytest.importorskip("pymavlink.dialects.v20.common")
    writer = mavlink2.MAVLink(None)
    told = decoder("mavlink2_highres_imu")
    data = b""
    for k in range(40):
        sent = mavlink2.MAVLink_highres_imu_message(
            10_000 * k, 0.5, -0.25, -9.75, 0.125, 0.5, -2.0, 0, 0, 0, 0, 0, 0, 20.0, 63
        )
        data += sent.pack(writer) + mavlink2.MAVLink_heartbeat_message(1, 2, 3, 4, 5, 3).pack(
            writer
        )
    rows = told.feed(data + b"\xfd")
    assert rows[-1] == (390_000.0, 0.5, -0.25, -9.75, 0.125, 0.5, -2.0) and len(rows) == 40
    assert told.heard.others == 40 and told.heard.junk == told.heard.broken == 0
    (tmp_path / "log.bin").write_bytes(np.array([(*row, 0.0) for row in rows]).tobytes())
    text = campaign_of(told.frame, "session")
    log = campaign.read_log(campaign.parse(text, tmp_path / "campaign.toml"))
    assert log.accel[0].tolist() == [-0.25, 0.5, 9.75] and log.gyro[0].tolist() == [0.5, 0.125, 2.0]
