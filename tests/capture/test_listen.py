"""What is heard at a port: every shipped description, lines of text, a wrong rate, and nothing."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from commands import run
from foucault import campaign
from foucault.capture import listen, prints
from foucault.capture.frame import parsed, shipped, text_of
from foucault.models.noise import grade
from foucault.models.rotation import aligning
from foucault.simulate.hand_rotated import draw_errors
from foucault.tables import Log
from make_guided import Operator
from make_heard import PRINTED, SENT
from make_uart import Wire, misheard

KNOWN = {name: (text_of(name), parsed(text_of(name), name)) for name in shipped()}


@lru_cache(2)
def turned(rests: int = 6) -> Log:
    """A rest, and turns to others."""
    site = campaign.parse(campaign.template("hand_rotated"), "a.toml").site
    hands = Operator(draw_errors("mems", 3), grade("mems").noise, site, np.random.default_rng(3))
    parts, e = [hands.rest(3.0)], np.eye(3)
    ups = [e[0], -e[1], -e[2], e[1], -e[0], e[2]][:rests]
    parts += [hands.move(aligning(up, e[2]), 2.0) for up in ups]
    rows = {n: np.concatenate([getattr(p, n) for p in parts]) for n in ("time", "accel", "gyro")}
    return replace(parts[0], **rows)


def judged(data: bytes, seconds: float, known=KNOWN, **said) -> listen.Listened:
    out = listen.Listened("there", len(data), seconds, prints.text_in(data))
    listen._judge(out, data, known, said)
    return out


def test_every_shipped_description_is_tried():
    assert set(SENT) == set(shipped())


@pytest.mark.parametrize("name", SENT)
def test_frames_of_every_instrument_are_told(name):
    log = turned()
    best = judged(SENT[name](log), log.duration).best
    assert best is not None and best.name == name and not best.notes
    assert best.rate == pytest.approx(100, rel=1e-3)
    said = {line.what: line for line in best.lines}
    assert said["axes"].sure == "sure" and "same axes" in said["axes"].took
    assert {"accelerometers", "gyros"} <= said.keys()


@pytest.mark.parametrize("name", SENT)
def test_at_a_wrong_rate_or_shuffled_nothing_is_told(name):
    """A wrong answer is worse than none."""
    log = turned()
    data = SENT[name](log[:150])
    rng = np.random.default_rng(1)
    shuffled = bytes(rng.permutation(np.frombuffer(data, np.uint8)))
    for heard in (9600, 57600, 230400):
        out = judged(misheard(data, 115200, heard), 1.0)
        assert out.best is None and not out.fits and not out.others, heard
    for noise in (shuffled, bytes(2000), b"\xff" * 2000):
        out = judged(noise, 1.0)
        assert out.best is None and not out.fits and not out.others


@pytest.mark.thorough
def test_noise_is_never_frames():
    rng = np.random.default_rng(2)
    for _ in range(40):
        assert not judged(rng.bytes(50_000), 1.0).fits


@pytest.mark.parametrize("name", PRINTED)
def test_lines_that_nobody_described_are_described(name, tmp_path):
    log = turned()
    out = judged(PRINTED[name](log), log.duration)
    best = out.best
    assert best is not None and best.name == "" and len(best.rows) > len(log) - 3
    told = best.frame
    accel, gyro = told.field_of("accel"), told.field_of("gyro")
    columns = {n: [told.columns.index(f"{n}_{a}") for a in "xyz"] for n in ("accel", "gyro")}
    if name != "counts":
        assert accel.unit == {"arduino": "m/s^2", "sentences": "g"}[name]
        assert gyro.unit == {"arduino": "deg/s", "sentences": "rad/s"}[name]
        assert told.field_of("time") is not None
        assert told.line.checksum == (name == "sentences")
    else:
        assert (accel.divide, accel.unit) == (8192, "g")
        assert (gyro.divide, gyro.unit) == (65.5, "deg/s")
    size = {"m/s^2": 1.0, "g": 9.80665}[accel.unit]
    rate = {"deg/s": np.pi / 180, "rad/s": 1.0}[gyro.unit]
    n = len(best.rows)
    off = min(np.abs(best.rows[:, columns["accel"]] * size - log.accel[k : k + n]).max()
              for k in range(len(log) - n + 1))  # fmt: skip
    turn = min(np.abs(best.rows[:, columns["gyro"]] * rate - log.gyro[k : k + n]).max()
               for k in range(len(log) - n + 1))  # fmt: skip
    assert off < 2e-3 and turn < 2e-4


@pytest.mark.parametrize("name", PRINTED)
def test_at_rest_no_one_tells_the_unit_of_gyros_and_so_it_asks(name):
    log = turned(0)
    data = PRINTED[name](log)
    out = judged(data, log.duration)
    # Whole numbers are counts, of a size that nothing tells.
    asked = "gyro.scale = 131 count/(deg/s)" if name == "counts" else "gyro.unit = deg/s"
    assert out.best is None and asked in " ".join(out.fits[0].doubts)
    unit = {"arduino": "deg/s", "sentences": "rad/s", "counts": "0.0152672 deg/s"}[name]
    best = judged(data, log.duration, gyro={"unit": unit}).best
    assert best is not None and best.frame.field_of("gyro").unit == unit


def test_axes_of_lines_that_are_not_those_of_the_body():
    """Gyros print y, -x, z: the description says so, and its log is that of the body."""
    log = turned()
    mixed = replace(log, gyro=np.stack([log.gyro[:, 1], -log.gyro[:, 0], log.gyro[:, 2]], axis=1))
    best = judged(PRINTED["sentences"](mixed), log.duration).best
    assert best is not None
    axes = {n: best.frame.field_of(n).axes or ("x", "y", "z") for n in ("accel", "gyro")}

    def body(x: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
        return np.stack([(-1 if a[0] == "-" else 1) * x[:, "xyz".index(a[-1])] for a in names], 1)

    accel, gyro = body(log.accel, axes["accel"]), body(mixed.gyro, axes["gyro"])
    # One rotation leads from the body to both.
    R = np.linalg.lstsq(log.accel, accel, rcond=None)[0]
    assert np.linalg.det(R) == pytest.approx(1.0) and np.allclose(log.gyro @ R, gyro, atol=1e-12)


def test_what_contradicts_a_description_is_said_of_it():
    """Frames of another scale, frames with exchanged axes: their checksums are right."""
    log = turned()
    coarse = replace(log, accel=log.accel * 0.4)
    out = judged(SENT["adis16470_burst"](coarse), log.duration)
    assert out.best is None and "not in g" in out.fits[0].doubts[0]
    mixed = replace(log, gyro=log.gyro[:, [1, 0, 2]])
    out = judged(SENT["sbg_imu_short"](mixed), log.duration)
    assert out.best is None and "axes" in " ".join(out.fits[0].doubts)


def test_other_messages_of_a_known_protocol_are_not_nothing():
    from make_frames import kermit

    body = b"".join(bytes([k % 256]) for k in range(24))
    frame = bytes([6, 0]) + len(body).to_bytes(2, "little") + body
    out = judged((b"\xff\x5a" + frame + kermit(frame) + b"\x33") * 100, 1.0)
    assert out.best is None and out.others == {"sbg_imu_short": 100}


def test_frames_of_nobody_are_hinted_at():
    rng = np.random.default_rng(5)
    data = b"".join(b"\xa5\x5c" + rng.bytes(26) for _ in range(400))
    out = judged(data, 1.0)
    assert out.best is None and out.period == (b"\xa5\x5c", 28)
    assert judged(rng.bytes(11_000), 1.0).period is None


def test_an_own_description_is_tried_beside_those_of_the_program():
    text = text_of("sbg_imu_short").replace("2C 00", "2D 00")
    log = turned()
    data = SENT["sbg_imu_short"](log)
    other = KNOWN | {"mine.toml": (text, parsed(text, "mine.toml"))}
    assert judged(data, log.duration, other).best.name == "sbg_imu_short"


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "baud"), [("sbg_imu_short", 921600), ("xsens_mtdata2", 57600),
                         ("adis16470_burst", 115200), ("mavlink2_highres_imu", 460800),
                         ("novatel_corrimudata", 230400), ("arduino", 9600)])  # fmt: skip
def test_the_baud_rate_of_a_port_is_found(name, baud, tmp_path):
    """A line that is sampled at another rate gives what its bits are at that rate."""
    data = (SENT | PRINTED)[name](turned())
    for out in (tmp_path / f"session {k}" for k in range(3)):
        wire = Wire(data, baud, len(data) / turned().duration)
        try:
            made = run("listen", wire.name, "--for", "3 s", "-o", out, "--json")
        finally:
            wire.close()
        told = json.loads(made.output)["ports"][0]
        # The line is played in real time: a machine that is busy may stop it for some frames.
        if told["source"] == f"serial:{wire.name}:{baud}":
            break
    assert told["source"] == f"serial:{wire.name}:{baud}"
    if name in SENT:
        assert made.exit_code == 0 and told["fits"][0]["frames"] == name
        assert (out / "frame.toml").read_text() == text_of(name)
        log = campaign.read_log(campaign.load(out / "campaign.toml"))
        assert 9.0 < np.median(np.linalg.norm(log.accel, axis=1)) < 11.0


@pytest.mark.thorough
def test_a_slow_instrument_is_heard_out(monkeypatch, tmp_path):
    """Five messages a second: of those that a short look hears none can be sure."""
    monkeypatch.setattr(listen, "BAUDS", (115200, 57600, 9600))
    data = SENT["xsens_mtdata2"](turned())
    size = len(data) / len(turned())
    wire = Wire(data, 57600, 5 * size)
    try:
        made = run("listen", wire.name, "--for", "3 s", "-o", tmp_path / "s", "--json")
    finally:
        wire.close()
    assert json.loads(made.output)["ports"][0]["source"] == f"serial:{wire.name}:57600"


def test_a_port_of_no_one_and_a_silent_one(monkeypatch):
    monkeypatch.setattr(listen, "SILENT", 0.3)
    monkeypatch.setattr(listen, "EACH", 0.12)
    monkeypatch.setattr(listen, "AGAIN", 0.13)
    wire = Wire(np.random.default_rng(3).bytes(20_000), 115200)
    try:
        made = run("listen", wire.name, code=3)
    finally:
        wire.close()
    assert "Nothing that is known." in made.output and "921600" in made.output
    import os
    import tty

    master, slave = os.openpty()
    tty.setraw(slave)
    try:
        assert "Silence" in run("listen", os.ttyname(slave), code=3).output
    finally:
        os.close(master)
        os.close(slave)


@pytest.mark.thorough
def test_a_file_and_what_is_made_of_it(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(listen, "END", 0.1)
    log = turned()
    path = tmp_path / "heard.txt"
    path.write_bytes(PRINTED["arduino"](log))
    made = run("listen", path, "-o", tmp_path / "s", code=0)
    assert "deg/s" in made.output and "foucault capture" in made.output
    read = campaign.read_log(campaign.load(tmp_path / "s" / "campaign.toml"))
    np.testing.assert_allclose(read.gyro, log.gyro[: len(read)], atol=1e-4)
    shown = run("listen", path, code=0).output
    assert "frames.toml" in shown and 'unit = "deg/s"' in shown
    asked = tmp_path / "still.txt"
    asked.write_bytes(PRINTED["arduino"](turned(0)))
    assert "--set" in run("listen", asked, code=3).output
    told = run("listen", asked, "--set", "gyro.unit = deg/s", "--frames",
               _described(tmp_path), code=0)  # fmt: skip
    assert 'unit = "deg/s"' in told.output


def _described(folder: Path) -> Path:
    path = folder / "mine.toml"
    path.write_text(text_of("xsens_mtdata2"))
    return path


def test_where_it_cannot_listen(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(listen, "ports", list)
    assert "no serial port" in run("listen", code=1).output
    assert "one source" in run("listen", "udp:1", "udp:2", "-o", tmp_path / "s", code=1).output
    assert "nonsense" in run("listen", "nonsense", code=1).output
