"""The guide as a page: who may record what, and a session from the first rest to the verdict."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from foucault.run_folder import ENOUGH_FILE, STATE_FILE
from foucault.workbench import live
from foucault.workbench.people import Person
from make_moments import fed, moments
from make_workbench import PASSWORD, client, make_bench, mark, post

GIVEN = {"source": "udp:5005", "frames": "sbg_imu_short", "how": "six_position", "hold": "5 s",
         "want": "accel.bias = 1 mg\naccel.scale = 1 percent", "words": "de"}  # fmt: skip

OWN = """\
words = "mine"
source = "mine"
line = { separator = "," }
fields = [{ name = "accel", at = 0, count = 3, unit = "g" }]
"""


def test_a_form_becomes_a_line_of_the_program(tmp_path: Path) -> None:
    bench = make_bench(tmp_path)
    browser = client(bench)
    assert "six_position" in browser.get("/live").text
    made = post(browser, "/live", GIVEN, follow_redirects=False)
    assert made.headers["location"] == "/live/1"
    words = bench.store.job(1).words
    assert words == (
        "calibrate", "guides/six_position.toml", "--live=udp:5005", "--frames=sbg_imu_short",
        "--words=de", "--want=accel.bias = 1 mg", "--want=accel.scale = 1 percent", "--hold=5 s",
        "-o", "runs/1",
    )  # fmt: skip
    assert (tmp_path / "guides" / "six_position.toml").is_file()
    page = browser.get("/live/1").text
    assert "Oberseite" in page and "udp:5005" in page
    assert 'href="/live/1"' in browser.get("/live").text
    assert 'href="/live/1"' in browser.get("/jobs/1").text


def test_frames_of_ones_own_are_described_in_the_form(tmp_path: Path) -> None:
    bench = make_bench(tmp_path)
    browser = client(bench)
    post(browser, "/live", {**GIVEN, "frames": "own", "own": OWN}, follow_redirects=False)
    named = next(w for w in bench.store.job(1).words if w.startswith("--frames="))
    assert (tmp_path / named.partition("=")[2]).read_text() == OWN
    wrong = post(browser, "/live", {**GIVEN, "frames": "own", "own": "words = 1"})
    assert wrong.status_code == 400 and "cannot be used" in wrong.text


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"source": "-"}, "may not be recorded"),
        ({"source": ""}, "may not be recorded"),
        ({"source": "--quiet"}, "may not be recorded"),
        ({"frames": "../../etc/passwd"}, "no description of frames"),
        ({"how": "ferraris"}, "no guide for"),
        ({"how": "logs/0123456789ab"}, "no log"),
        ({"words": "../en"}, "no words"),
        ({"want": "a lot"}, "not of the form"),
        ({"hold": "5\x01 s"}, "--hold"),
    ],
)
def test_what_cannot_be_asked_for(more: dict[str, str], words: str, tmp_path: Path) -> None:
    bench = make_bench(tmp_path)
    answer = post(client(bench), "/live", {**GIVEN, **more})
    assert answer.status_code >= 400 and words in answer.text.replace("&#39;", "'"), answer.text
    assert not bench.store.jobs()


def test_an_operator_takes_the_ports_of_this_computer(monkeypatch: Any) -> None:
    """No file, server or device that the workbench could read and an operator could not."""
    monkeypatch.setattr(live, "ports", lambda: [("/dev/ttyUSB0", "an adapter")])
    operator, administrator = Person("ann", "operator"), Person("bob", "administrator")
    may = ["udp:5005", "serial:/dev/ttyUSB0", "serial:/dev/ttyUSB0:921600"]
    may_not = ["udp:80", "tcp:10.0.0.1:4000", "/etc/shadow", "serial:/dev/sda", "/dev/ttyUSB1",
               "serial:/dev/ttyUSB1:9600", "serial:", "udp:"]  # fmt: skip
    for given in may:
        assert live.source_of(operator, given) == given
    for given in may_not:
        with pytest.raises(Exception, match="may not be recorded"):
            live.source_of(operator, given)
        assert live.source_of(administrator, given) == given


def test_whoever_is_not_known_sees_nothing(tmp_path: Path) -> None:
    bench = make_bench(tmp_path)
    bench.people.add("ann", "administrator", PASSWORD, lambda _: None)
    browser = client(bench)
    for where in ("/live", "/live/1", "/live/1/state"):
        assert browser.get(where, follow_redirects=False).status_code == 303
    assert browser.post("/live", data={"mark": mark(browser), **GIVEN},
                        follow_redirects=False).status_code in (303, 403)  # fmt: skip
    assert not bench.store.jobs()


def test_the_state_is_what_the_guide_keeps(tmp_path: Path) -> None:
    bench = make_bench(tmp_path)
    browser = client(bench)
    post(browser, "/live", GIVEN, follow_redirects=False)
    assert browser.get("/live/1/state").json() == {"job": "waiting", "result": "", "phase": "wait"}
    folder = tmp_path / "runs" / "1"
    folder.mkdir(parents=True)
    (folder / STATE_FILE).write_text(json.dumps({"phase": "rest", "ring": 0.5}))
    said = browser.get("/live/1/state").json()
    assert said["phase"] == "rest" and said["ring"] == 0.5 and said["age"] < 60
    (folder / STATE_FILE).write_text('{"phase": "re')  # half of it
    assert browser.get("/live/1/state").json()["phase"] == "wait"
    post(browser, "/live/1/enough")
    assert (folder / ENOUGH_FILE).exists()
    bench.store.ask("ann", "allan", ["allan", "x"])
    for where in ("/live/2", "/live/2/state"):
        answer = browser.get(where)
        assert answer.status_code == 404 and "Job 2 is no guided session." in answer.text
    bench.store.stop(1)
    assert "Under way" not in browser.get("/live").text


@pytest.mark.thorough
def test_a_session_in_a_browser(tmp_path: Path, opened: Callable[..., Any]) -> None:
    """Five moments, fed by a simulated sensor that obeys: what the page shows at each of them."""
    with fed(tmp_path) as made:
        page, seen = opened("about:blank"), []
        for name in moments(made, page):
            seen.append(name)
            ring = float(page.get_attribute("#ring", "stroke-dasharray").split()[0])
            turned = page.evaluate("document.getElementById('held').style.transform")
            assert "matrix3d" in turned
            if name == "rest":
                assert "Rest it on its bottom" in page.inner_text("#task") and 30 < ring < 99
                assert "more" in page.inner_text("#now")
            if name == "move":
                first = turned
                beeps = int(page.get_attribute("#guide", "data-beeps"))
                assert 2 <= beeps <= made.state()["sounds"] + 1  # one to hear whether it can
            if name == "mistake":
                assert turned != first
                assert page.locator("#rows tr").count() >= 4
            if name == "next":
                assert "of 4 s" in page.inner_text("#wrong") or page.locator("#wrong li").count()
                assert page.locator("#rows rect.enough").count()
        assert seen == ["rest", "move", "mistake", "next", "verdict"]
        assert page.inner_text("#word") in ("Pass", "Doubtful")
        assert "Enough" in page.inner_text("#task")
        assert int(page.get_attribute("#guide", "data-beeps")) == made.state()["sounds"] + 1
        page.click("#result")
        page.wait_for_selector("h2:has-text('Coefficients')")
        assert "Keep in the records" in page.inner_text("main")


@pytest.mark.thorough
def test_enough_calibrates_what_was_recorded(tmp_path: Path, opened: Callable[..., Any]) -> None:
    with fed(tmp_path) as made:
        page = opened("about:blank")
        made.begin(page)
        made.send(90.0)
        assert made.state()["rests"] >= 6
        page.click("text=Enough: calibrate")
        ended = made.served.ended(made.number)
        assert ended["state"] == "done" and ended["verdict"] in ("pass", "doubtful"), ended
        assert made.state()["rests"] >= 6
        page.goto("about:blank")  # it asks for the state for as long as it is open
