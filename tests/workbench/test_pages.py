"""Pages without a script: from a log to its verdict, and what is kept of it."""

from __future__ import annotations

import io
import json
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from foucault.workbench.asked import shown
from foucault.workbench.bench import Bench
from make_records import make_records
from make_workbench import by_itself, client, log_text, make_bench, post, work_off


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """A workbench with a log that was looked at and calibrated."""
    made = make_bench(tmp_path_factory.mktemp("bench"))
    with client(made) as browser:
        sent = post(browser, "/logs", files={"file": ("drive 7.csv", log_text())})
        assert sent.url.path.startswith("/logs/")
        log = sent.url.path.split("/")[-1]
        work_off(made)
        post(browser, "/do/calibrate", {"log": log, "--latitude": "47.3 deg"})
        work_off(made)
    return made


@pytest.fixture
def browser(bench: Bench) -> Iterator[Any]:
    with client(bench) as made:
        yield made


def log_of(bench: Bench) -> str:
    return bench.store.job(1).log


def test_a_log_is_shown_as_what_it_was_taken_for(bench: Bench, browser: Any) -> None:
    said = browser.get(f"/logs/{log_of(bench)}").text
    for words in ("drive_7.csv", "What it was taken for", "Acceleration x", "sure", "assumed",
                  "hand_rotated", "Readings and rests"):  # fmt: skip
        assert words in said
    report = browser.get("/jobs/1/report")
    assert report.headers["content-security-policy"].startswith("sandbox")
    assert "<svg" in report.text


def test_a_job_finds_what_the_command_line_finds(bench: Bench, browser: Any) -> None:
    """The line of the page, run by itself: the same result but for when and how long."""
    job = bench.store.job(2)
    assert (job.state, job.verdict) == ("done", "pass")
    line = shown(job.words)
    assert line.startswith("foucault calibrate logs/") and '--latitude "47.3 deg"' in line
    words = shlex.split(line)[1:]
    words[words.index("runs/2")] = "runs/by_hand"
    by_itself(words, bench.folder)
    texts = [(bench.folder / "runs" / k / "result.json").read_text() for k in ("2", "by_hand")]
    plain = []
    for text in texts:
        for key in ("created", "seconds"):
            value = json.loads(text)["provenance"][key]
            assert text.count(json.dumps(value)) >= 1
            text = text.replace(f'"{key}": {json.dumps(value)}', f'"{key}": 0')
        plain.append(text)
    assert plain[0] == plain[1]
    page = browser.get("/jobs/2").text
    assert "--latitude" in page and "Pass" in page and "accel.bias.x" in page


def test_what_is_corrected_is_what_set_says(bench: Bench, browser: Any) -> None:
    log = log_of(bench)
    said = {"key:gyro.unit": "deg/s", "was:gyro.unit": "rad/s", "key:rate": "", "was:rate": "",
            "set": "accel.reads = gravity"}  # fmt: skip
    post(browser, f"/logs/{log}/look", said)
    asked = bench.store.jobs(1)[0]
    assert {"--set=accel.reads = gravity", "--set=gyro.unit = deg/s"} <= set(asked.words)
    work_off(bench)
    page = browser.get(f"/logs/{log}").text
    assert "gyro.unit = deg/s" in page
    post(browser, f"/logs/{log}/look", {})  # as it was taken
    work_off(bench)


def test_a_job_that_fails_says_why(bench: Bench, browser: Any) -> None:
    post(browser, "/do/calibrate", {"log": log_of(bench), "--latitude": "147 deg"})
    job = work_off(bench)[-1]
    assert (job.state, job.code) == ("failed", 1)
    assert "latitude" in browser.get(f"/jobs/{job.number}").text


def test_a_run_is_kept_with_the_name_of_who_kept_it(bench: Bench, browser: Any) -> None:
    page = post(browser, "/jobs/2/keep", {"instrument": "IMU <7>", "date": "2026-03-01"})
    assert page.url.path == "/instrument" and page.url.params["name"] == "IMU <7>"
    assert "IMU &lt;7&gt;" in page.text and "IMU <7>" not in page.text
    with bench.records() as records:
        entry = next(iter(records.entries()))
        assert entry.who and not records.audit()
    said = post(browser, "/records/interval", {"instrument": "IMU <7>", "months": "12"})
    assert "due 2027-0" in said.text
    post(browser, "/records/event", {"instrument": "IMU <7>", "what": "note", "on": "2026-04-01",
                                     "words": "<script>alert(1)</script>"})  # fmt: skip
    text = browser.get("/instrument?name=IMU%20%3C7%3E").text
    assert "&lt;script&gt;" in text and "<script>alert" not in text
    limits = post(browser, "/records/tolerance", {"instrument": "IMU <7>",
                                                  "text": '"accel.bias" = "1 g"'})  # fmt: skip
    assert "within" in limits.text
    assert "Kept as run 1" in browser.get("/jobs/2").text
    judgement = {"run": "1", "decision": "rejected", "reason": "dropped"}
    judged = post(browser, "/records/review", {**judgement, "instrument": "IMU <7>"})
    assert "Not to be used" in judged.text
    assert "2027-0" in browser.get("/due").text or "interval" in browser.get("/due").text
    named = post(browser, "/records/reference", {"name": "table 3", "what": "table",
                                                 "due": "2020-01-01"})  # fmt: skip
    assert "table 3" in named.text
    assert browser.get("/journal").text.count("<tr>") >= 7


def test_what_a_run_leaves_is_downloaded_and_never_opened(bench: Bench, browser: Any) -> None:
    got = browser.get("/jobs/2/files/result.json")
    assert got.headers["content-disposition"].startswith("attachment")
    assert got.headers["x-content-type-options"] == "nosniff"
    assert got.headers["content-type"] == "application/octet-stream"
    assert json.loads(got.text)["procedure"] == "hand_rotated"
    for name in ("look.json", "..%2F2.txt", "%2e%2e", "nothing.html"):
        assert browser.get(f"/jobs/2/files/{name}").status_code == 404
    assert "has left no file" in browser.get("/jobs/2/files/look.json").text


@pytest.mark.thorough
def test_a_result_is_exported_applied_and_compared(bench: Bench, browser: Any) -> None:
    log = log_of(bench)
    sent = post(browser, "/logs", files={"file": ("later.csv", log_text(2))})
    other = sent.url.path.split("/")[-1]
    post(browser, "/do/calibrate", {"log": other, "--latitude": "47.3 deg"})
    second = work_off(bench)[-1].number
    for command, said in (
        ("export", {"run": "runs/2", "--to": "c", "name": "../cal.h"}),
        ("apply", {"run": "runs/2", "log": log}),
        ("compare", {"run": ["runs/2", f"runs/{second}"]}),
    ):
        post(browser, f"/do/{command}", said)
        job = work_off(bench)[-1]
        assert job.state == "done", bench.said(job)
        assert "Files" in browser.get(f"/jobs/{job.number}").text
    assert (bench.folder / "runs" / f"{second + 1}" / "cal.h").is_file()


def test_a_session_is_looked_at_before_it_is_made(bench: Bench, browser: Any) -> None:
    assert "norm_observation" in browser.get("/plan").text
    form = browser.get("/do/preflight?name=hand_rotated").text
    assert "--plan" in form and "<option selected>hand_rotated" in form
    post(browser, "/do/preflight", {"name": "hand_rotated"})
    job = work_off(bench)[-1]
    page = browser.get(f"/jobs/{job.number}").text
    assert job.state == "done" and "accel.bias.x" in page and "expected.csv" in page
    assert browser.get(f"/jobs/{job.number}/files/expected.csv").status_code == 200


@pytest.mark.parametrize("command", ["calibrate", "align", "north", "navigate", "allan"])
def test_a_form_has_the_options_of_its_command(bench: Bench, browser: Any, command: str) -> None:
    text = browser.get(f"/do/{command}?log={log_of(bench)}").text
    assert 'name="mark"' in text and "drive_7.csv" in text and "--output" not in text
    if command == "align":
        assert 'name="--gyro-bias-sd"' in text and "How well the gyro biases" in text


def test_instruments_are_found_by_a_part_of_their_name(tmp_path: Path) -> None:
    made = make_bench(tmp_path)
    make_records(tmp_path, 2).close()
    with client(made) as browser:
        assert "0042" in browser.get("/instruments").text
        assert "No instrument is called so" in browser.get("/instruments?find=77").text
        page = browser.get("/instrument?name=0042")
        assert page.status_code == 404 or "Coefficients" in page.text
        with made.records() as records:
            name = records.instruments()[0]
        assert "Over time" in browser.get(f"/instrument?name={name}").text
        framed = browser.get(f"/history?name={name}")
        assert framed.headers["content-security-policy"].startswith("sandbox")


@pytest.mark.parametrize("path", ["/jobs/99", "/logs/0123456789ab", "/nowhere", "/do/serve",
                                  "/instrument?name=none", "/jobs/x"])  # fmt: skip
def test_what_is_not_there_is_said_on_a_page(browser: Any, path: str) -> None:
    page = browser.get(path)
    assert page.status_code in (400, 404) and "Not possible" in page.text


def still() -> bytes:
    """Return a log of an instrument of navigation grade at rest, with its heading 30 deg."""
    rng = np.random.default_rng(4)
    earth, latitude, heading = 7.292115e-5, np.radians(47.3), np.radians(30.0)
    north = earth * np.cos(latitude)
    rate = [-north * np.sin(heading), north * np.cos(heading), earth * np.sin(latitude)]
    n = 6000
    table = np.column_stack([
        np.arange(n) * 0.05, rng.normal(rate, 2e-6, (n, 3)),
        rng.normal([0.0, 0.0, 9.8082], 1e-3, (n, 3)),
    ])  # fmt: skip
    head = "time (s)," + ",".join(
        f"{what}_{axis} ({unit})" for what, unit in (("gyro", "rad/s"), ("accel", "m/s^2"))
        for axis in "xyz"
    )  # fmt: skip
    text = io.StringIO()
    np.savetxt(text, table, fmt="%.9e", delimiter=",", header=head, comments="")
    return text.getvalue().encode()


@pytest.mark.parametrize(("command", "options", "words"), [
    ("align", {"--latitude": "47.3 deg", "--gyro-bias-sd": "0.01 deg/h"},
     ("north is seen", "heading (deg)")),
    pytest.param("navigate", {"--latitude": "47.3 deg", "--longitude": "8.5 deg",
                              "--still": "yes"}, ("Report", "report.html"),
                 marks=pytest.mark.thorough),
])  # fmt: skip
def test_a_heading_and_a_path_come_from_the_same_drop(
    tmp_path: Path, command: str, options: dict[str, str], words: tuple[str, ...]
) -> None:
    """Dropped, looked at, asked for by its button, its verdict seen: no other way than a run's."""
    bench = make_bench(tmp_path)
    with client(bench) as browser:
        page = post(browser, "/logs", files={"file": ("still.csv", still())})
        work_off(bench)
        seen = browser.get(page.url.path).text
        assert f"/do/{command}?log=" in seen and "one rest" in seen
        log = page.url.path.split("/")[-1]
        form = browser.get(f"/do/{command}?log={log}").text
        action = re.search(r'<form method="post" action="(/do/[^"]*)"', form)[1]
        assert action == f"/do/{command}" and all(f'name="{k}"' in form for k in options)
        post(browser, action, {"log": log, **options})
        job = work_off(bench)[-1]
        assert job.state == "done", bench.said(job)
        text = browser.get(f"/jobs/{job.number}").text
        assert all(w in text for w in words), text
        assert 'class="verdict' in text and f"foucault {command} logs/" in text


@pytest.mark.thorough
def test_north_is_found_from_a_drop(tmp_path: Path) -> None:
    """A campaign with the readings of a north seeker: its headings and its verdict."""
    where = tmp_path / "north"
    for words in (["init", "north_seeking", "-o", str(tmp_path / "c.toml")],
                  ["simulate", str(tmp_path / "c.toml"), "-o", str(where)]):  # fmt: skip
        by_itself(["-q", *words], tmp_path)
    sent = [("file", (f.name, f.read_bytes())) for f in sorted(where.iterdir())
            if f.name in ("campaign.toml", "log.csv")]  # fmt: skip
    bench = make_bench(tmp_path / "bench")
    with client(bench) as browser:
        page = post(browser, "/logs", files=sent)
        work_off(bench)
        log = page.url.path.split("/")[-1]
        assert f"/do/north?log={log}" in browser.get(page.url.path).text
        post(browser, "/do/north", {"log": log})
        job = work_off(bench)[-1]
        assert job.state == "done", bench.said(job)
        text = browser.get(f"/jobs/{job.number}").text
        assert "heading" in text.lower() and "report.html" in text
