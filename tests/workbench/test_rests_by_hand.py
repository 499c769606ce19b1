"""Rests that are moved on a page: what is calibrated then, and by which command line."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from typing import Any

import pytest

from foucault.workbench.asked import shown
from foucault.workbench.bench import Bench
from make_workbench import by_itself, client, log_text, make_bench, post, work_off


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    return make_bench(tmp_path_factory.mktemp("rests"))


def rows(text: str) -> list[tuple[str, str]]:
    """Return the rests of a page, first and last sample."""
    fields = [re.findall(rf'name="{k}"[^>]*value="([^"]*)"', text) for k in ("first", "last")]
    return [r for r in zip(*fields, strict=True) if all(r)]


def result(bench: Bench, name: Any) -> dict[str, Any]:
    return json.loads((bench.folder / "runs" / str(name) / "result.json").read_text())


def by_hand(bench: Bench, job: Any) -> dict[str, Any]:
    """Return what the line that the page shows finds by itself."""
    words = shlex.split(shown(job.words))[1:]
    words[words.index("-o") + 1] = f"runs/hand{job.number}"
    by_itself(words, bench.folder)
    return result(bench, f"hand{job.number}")


def test_moved_added_and_removed(bench: Bench) -> None:
    with client(bench) as browser:
        page = post(browser, "/logs", files={"file": ("drive.csv", log_text())}).url.path
        work_off(bench)
        found = rows(browser.get(page).text)
        assert len(found) == 16 and "<polyline" in browser.get(page).text
        first = [a for a, _ in found]
        last = [b for _, b in found]
        first[1] = f"{float(first[1]) + 0.4:g}"
        answer = post(browser, f"{page}/rests", {"first": [*first, ""], "last": [*last, ""],
                                                 "out": ["15"]})  # fmt: skip
        assert answer.url.path == page
        work_off(bench)
        now = rows(browser.get(page).text)
        assert len(now) == 15 and float(now[1][0]) == pytest.approx(float(first[1]), abs=0.006)
        post(browser, f"{page}/rests", {"first": [*first, "bad"], "last": [*last, "2"]})
        form = re.search(r'name="--set" value="(rests[^"]*)"', browser.get(page).text)[1]
        said = {"log": page.split("/")[-1], "--set": form.replace("&#34;", '"')}
        post(browser, "/do/calibrate", said)
        job = work_off(bench)[-1]
        assert job.state == "done", bench.said(job)
        mine = result(bench, job.number)
        assert mine["diagnostics"]["detection"]["rests"] == 15
        assert mine["coefficients"] == by_hand(bench, job)["coefficients"]
        post(browser, f"{page}/rests", {"again": "yes"})
        work_off(bench)
        assert rows(browser.get(page).text) == found


@pytest.mark.thorough
def test_a_campaign_is_written_anew_with_them(bench: Bench) -> None:
    """The file that is sent back holds the rests, and the command line takes it as it is."""
    campaign = b'[log]\nfile = "drive.csv"\n' \
        b'time = { column = "Time (s)", unit = "s" }\n' \
        b'gyro = { columns = ["Gyroscope x (rad/s)", "Gyroscope y (rad/s)", ' \
        b'"Gyroscope z (rad/s)"], unit = "rad/s" }\n' \
        b'accel = { columns = ["Acceleration x (m/s^2)", "Acceleration y (m/s^2)", ' \
        b'"Acceleration z (m/s^2)"], unit = "m/s^2" }\n[site]\nlatitude = "47.3 deg"\n' \
        b'height = "430 m"\n[procedure]\nname = "hand_rotated"\n'  # fmt: skip
    sent = [("file", ("c.toml", campaign)), ("file", ("drive.csv", log_text(4)))]
    with client(bench) as browser:
        page = post(browser, "/logs", files=sent).url.path
        work_off(bench)
        found = rows(browser.get(page).text)
        assert found, browser.get(page).text
        moved = {"first": [a for a, _ in found], "last": [b for _, b in found], "out": ["0"]}
        other = post(browser, f"{page}/rests", moved).url.path
        assert other != page
        work_off(bench)
        assert len(rows(browser.get(other).text)) == len(found) - 1
        kept = (bench.folder / other[1:] / "c.toml").read_text()
        assert kept.startswith('[log]\nrests = ["') and kept.count("rests =") == 1
        post(browser, "/do/calibrate", {"log": other.split("/")[-1]})
        job = work_off(bench)[-1]
        assert job.state == "done", bench.said(job)
        assert result(bench, job.number)["coefficients"] == by_hand(bench, job)["coefficients"]
        back = post(browser, f"{other}/rests", {"again": "yes"}).url.path
        assert back == page


@pytest.mark.parametrize(("first", "last", "words"), [
    ("x", "2", "in seconds from the start"), ("5", "2", "holds"), ("nan", "2", "holds"),
    ("-3", "2", "holds"),
])  # fmt: skip
def test_what_is_no_rest_is_refused(bench: Bench, first: str, last: str, words: str) -> None:
    with client(bench) as browser:
        page = post(browser, "/logs", files={"file": ("y.csv", b"t,a\n0,1\n")}).url.path
        said = post(browser, f"{page}/rests", {"first": first, "last": last})
        assert said.status_code == 400 and words in said.text


def test_the_folder_is_named_by_nobody(bench: Bench, tmp_path: Path) -> None:
    with client(bench) as browser:
        said = post(browser, "/logs/..%2F..%2Fx/rests", {"first": "0", "last": "1"})
        assert said.status_code in (400, 404)
