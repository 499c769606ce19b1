"""The guide: it asks for what shows most, says what is wrong, and stops when it is enough."""

from __future__ import annotations

import json
import threading
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from foucault import campaign
from foucault.capture import said, ways
from foucault.capture.frame import parsed, text_of
from foucault.capture.guide import Guide
from foucault.capture.live import guided
from foucault.capture.said import Words, sides_below
from foucault.capture.source import opened
from foucault.capture.step import Step
from foucault.errors import FoucaultError
from foucault.files import flat
from foucault.logs.description import LogDescription
from foucault.models.noise import grade
from foucault.models.rotation import aligning, exp
from foucault.simulate.hand_rotated import draw_errors
from make_guided import UP, Operator, session
from make_live import Port, frames
from refusals import refuses

NOISE = grade("mems").noise
USED = LogDescription.model_validate({
    "file": "live", "time": {"column": 0, "unit": "s"},
    "gyro": {"columns": [1, 2, 3], "unit": "rad/s", "saturation": 7.0},
    "accel": {"columns": [4, 5, 6], "unit": "m/s^2"},
})  # fmt: skip
LOOSE = {"accel.scale": "150 ppm", "gyro.scale": "200 ppm"}


def asked(name: str = "hand_rotated", sizes: bool = False, **more) -> ways.Asked:
    told = campaign.parse(campaign.template(name), f"{name}.toml")
    told = replace(told, noise=NOISE, sizes=told.sizes if sizes else None)
    return ways.Asked(told, **({"hold": 5.0} | more))


def operator(told: ways.Asked, seed: int = 1, **how) -> Operator:
    site = told.campaign.site
    return Operator(draw_errors("mems", seed), NOISE, site, np.random.default_rng(seed), **how)


def test_somebody_who_obeys_is_soon_done():
    told = asked(want=LOOSE)
    guide, hands = ways.guide_of(told, USED), operator(told)
    rests = session(guide, hands, 25)
    assert guide.stopped == "enough" and 9 < rests < 18 and guide.rests == rests
    assert guide.result is not None and str(guide.result.verdict.level) == "pass"
    found = guide.result.coefficients
    limit = guide.way.wanted.sd
    assert (found.sd <= limit * 1.02).all() and np.isfinite(limit).sum() == 6
    error = found.values - hands.model.coefficients(found.names).values
    assert (np.abs(error) < 5 * found.sd).all()
    assert {m.key for m in guide.mistakes} <= {"refused"} and guide.phase == "done"
    assert "Enough" in Words.of().task(guide)


def test_why_it_was_not_enough_is_shown_until_the_next_rest(monkeypatch):
    told = asked()
    guide, hands = ways.guide_of(told, USED), operator(told)
    look = guide._look

    def refuse(again: bool = False) -> None:
        look(again)
        if guide.rests == 1:
            guide._mistake("moved", 0, held=1.0, wanted=5.0)
            guide._mistake("refused", 0, reason="only 1 rest")

    monkeypatch.setattr(guide, "_look", refuse)
    guide.add(hands.rest(guide.step.seconds + 1))
    assert [m.key for m in guide.recent(3)] == ["moved", "refused"]
    guide.add(hands.obey(guide.step, None))
    assert guide.rests == 2 and "refused" in {m.key for m in guide.mistakes}
    assert "refused" not in {m.key for m in guide.recent(9)}
    assert "moved" in {m.key for m in guide.recent(9)}


def test_what_is_expected_of_a_step_is_what_it_then_gives():
    told = asked()
    guide, hands = ways.guide_of(told, USED), operator(told, 2, sloppy=0.01)
    guide.add(hands.rest(guide.step.seconds + 1))
    off = []
    for k in range(13):
        expected, before = guide.expected, guide.reached.sd
        guide.add(hands.obey(guide.step, None))
        if k > 8:  # solved
            off.append(np.abs(np.log(guide.reached.sd / expected)).max())
            assert (guide.reached.sd <= before * 1.01).all()
    assert max(off) < 0.1, off


def test_the_step_is_the_best_of_all_that_are_tried():
    told = asked()
    guide, hands = ways.guide_of(told, USED), operator(told)
    guide.add(hands.rest(guide.step.seconds + 1))
    for _ in range(3):
        guide.add(hands.obey(guide.step, None))
    steps = guide.way.candidates(guide.reached)
    after, gain = guide._gain(guide.reached, steps)
    assert len(steps) > 90 and (after <= guide.reached.sd * 1.0001).all()
    assert guide._gain(guide.reached, [guide.step])[1][0] >= gain.max() * (1 - 1e-4)


def test_six_faces_and_who_puts_it_where_it_likes():
    told = asked("six_position")
    guide = ways.guide_of(told, USED)
    hands = operator(told, 3, sloppy=2e-3)
    session(guide, hands, 30)
    assert guide.stopped == "enough" and guide.rests < 20
    assert len({tuple(np.round(u) + 0.0) for u in ups(guide)}) == 6
    guide = ways.guide_of(asked("six_position", want={"accel.scale": "200 ppm"}), USED)
    hands = operator(told, 4, sloppy=2e-3, disobeys=0.3)
    session(guide, hands, 30)
    assert guide.stopped == "enough"
    assert "other" in {m.key for m in guide.mistakes}


def ups(guide: Guide) -> np.ndarray:
    first, last = guide.still()
    means = np.array(
        [guide.found.log.accel[a:b].mean(axis=0) for a, b in zip(first, last, strict=True)]
    )
    return means / np.linalg.norm(means, axis=1)[:, None]


def test_what_is_left_out_sets_a_floor():
    told = asked("six_position", sizes=True, want={"accel.bias": "0.02 mg"})
    sizes = {"accel.quadratic": (5e-5, "test"), "accel.bias drift": (0.0, "test")}
    told = replace(told, campaign=replace(told.campaign, sizes=sizes))
    guide = ways.guide_of(told, USED)
    session(guide, operator(told, 5, sloppy=1e-3), 30)
    assert guide.stopped == "floor" and guide.rests < 20
    assert set(guide.floored.values()) == {"accel.quadratic"}
    told = Words.of().end(guide)
    assert "accel.quadratic" in told and "accel.bias.x" in told


def began(told: ways.Asked, hands: Operator) -> Guide:
    guide = ways.guide_of(told, USED)
    guide.add(hands.rest(guide.step.seconds + 1))
    guide.add(hands.obey(guide.step, None))
    return guide


def test_taken_up_too_early():
    told = asked()
    hands = operator(told)
    guide = began(told, hands)
    for part in (hands.move(aligning(np.eye(3)[0], UP), 2.6), hands.move(np.eye(3), 1.5)):
        for k in range(0, len(part), 20):
            guide.add(part[k : k + 20])
    (mistake,) = [m for m in guide.mistakes if m.key == "moved"]
    assert "taken up" in Words.of().wrong(mistake) and 1.5 < mistake.values["held"] < 3.0


def test_another_side():
    told = asked()
    hands = operator(told)
    guide = began(told, hands)
    guide.add(hands.move(aligning(-guide.step.up, UP), guide.step.seconds + 1))
    assert [m.key for m in guide.mistakes] == ["other"] and guide.rests == 3


def test_a_cable_that_pulls():
    told = asked()
    hands = operator(told)
    guide = began(told, hands)
    part = hands.move(hands.C_nb @ exp(guide.step.rotation), guide.step.seconds + 1)
    t = part.time - part.time[0]
    creep = np.radians(0.4) * np.clip((t - t[-1] + guide.step.seconds) / guide.step.seconds, 0, 1)
    tilt = exp(np.outer(creep, [1.0, 0.3, 0.0]))
    guide.add(replace(part, accel=np.einsum("nij,nj->ni", tilt, part.accel)))
    (mistake,) = [m for m in guide.mistakes if m.key == "pulled"]
    assert 0.1 < mistake.values["angle"] < 0.4


def test_too_fast_for_the_rate():
    told = asked()
    hands = operator(told, rate=25.0)
    guide = began(told, hands)
    part = hands._moved(hands.C_nb, np.array([0.0, 0.0, 2.8]), guide.step.seconds + 1, 0.35)
    guide.add(part)
    (mistake,) = [m for m in guide.mistakes if m.key == "fast"]
    assert mistake.values["hz"] == pytest.approx(25) and mistake.values["rate"] > 300
    slow = operator(told, rate=100.0)
    assert not [m for m in began(told, slow).mistakes if m.key == "fast"]


def test_saturation_and_a_wrong_unit_are_said_at_once():
    told = asked()
    hands = operator(told)
    guide = began(told, hands)
    part = hands._moved(hands.C_nb, np.array([0.0, 0.0, 3.0]), 6.0, 0.5)
    guide.add(replace(part, gyro=np.clip(part.gyro, -7.0, 7.0)))
    assert "log.saturated" in {f.code for f in guide.findings()}
    wrong = ways.guide_of(told, USED)
    rest = operator(told).rest(12.0)
    wrong.add(replace(rest, accel=rest.accel / 9.80665))
    assert [f for f in wrong.findings() if "unit" in f.message + f.cure]


def test_words_of_steps_and_of_every_language():
    words = Words.of()
    assert words.step(Step("rest", np.array([1.0, 0, 0]), 4)) == "Rest it on its left side, 4 s"
    edge = words.step(Step("rest", np.array([0.7, 0, 0.7]), 4, np.eye(3)), np.eye(3))
    assert edge == "Rest it on the edge of left side and bottom, 4 s, its back towards you"
    assert sides_below(np.array([-1.0, 1, 1])) == ["+x", "-y", "-z"]
    assert set(said.shipped()) == {"de", "en"}
    for name in said.shipped():
        assert flat(Words.of(name).table).keys() == flat(words.table).keys()
    turn = Step("turn", UP, 5.0, np.eye(3), 2 * np.pi * UP)
    assert "to the left" in words.step(turn) and "links" in Words.of("de").step(turn)


def test_words_that_cannot_be_used(tmp_path: Path):
    (tmp_path / "bad.toml").write_text("language = 'x'\n")
    (tmp_path / "worse.toml").write_text("= x")
    for name, code in (("xx", "guide.words"), (str(tmp_path / "bad.toml"), "guide.language"),
                       (str(tmp_path / "worse.toml"), "guide.language")):  # fmt: skip
        with refuses(code):
            Words.of(name)


def test_what_is_wanted_must_be_estimated():
    for want, code in (({"mag.bias": "1 uT"}, "guide.wanted"), ({"gyro.scale": "5"}, None)):
        with pytest.raises(FoucaultError) as problem:
            ways.guide_of(asked(want=want), USED)
        assert code is None or problem.value.code == code
    with pytest.raises(FoucaultError) as problem:
        ways.wants(["accel.scale 50 ppm"])
    assert problem.value.code == "guide.want"
    assert ways.wants(["accel.scale = 50 ppm"]) == {"accel.scale": "50 ppm"}
    with refuses("guide.procedure"):
        ways.guide_of(asked("systematic"), USED)


@pytest.mark.thorough
def test_over_a_pseudo_terminal(tmp_path: Path):
    """What is recorded while it is guided calibrates to what the guide has said."""
    told = asked(want=LOOSE)
    port, hands, steps = Port(), operator(told, 6), []
    lives, over = [], threading.Event()

    def obey() -> None:
        port.send(b"".join(frames(hands.rest(told.hold * 2 + 3))))
        seen = 0
        while not over.is_set():
            guide = lives[-1].guide if lives else None
            if guide is None or guide.rests == seen or guide.step is None:
                time.sleep(0.01)
                continue
            seen = guide.rests
            steps.append(guide.step)
            with suppress(OSError):  # nobody listens any more
                port.send(b"".join(frames(hands.obey(guide.step, None))))

    thread = threading.Thread(target=obey, daemon=True)
    thread.start()
    text = text_of("sbg_imu_short")
    live, recorded = guided(
        opened(f"serial:{port.name}"), parsed(text, "sbg"), text, tmp_path / "s", told,
        tell=lambda live, _: lives.append(live), silent=60.0,
    )  # fmt: skip
    over.set()
    thread.join(1.0)  # it may wait for somebody to read
    port.close()
    assert live.guide.stopped == "enough" and live.recorder.heard.broken == 0
    assert recorded.procedure == "hand_rotated" and (tmp_path / "s" / "raw.bin").is_file()
    again = replace(recorded, noise=NOISE, sizes=None)
    log, seen = campaign.read_log(again), live.guide.found.log
    np.testing.assert_array_equal(log.accel[: len(seen)], seen.accel)
    np.testing.assert_allclose(log.time[: len(seen)], seen.time)
    found, said = (r.coefficients for r in (campaign.calibrate(again), live.guide.result))
    assert (np.abs(found.values - said.values) < said.sd).all()  # it went on for a moment
    assert json.loads((tmp_path / "s" / "capture.json").read_text())["rows"] == len(log)
