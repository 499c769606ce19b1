"""The workbench in a real Chromium: what somebody does who has a log and a browser."""

from __future__ import annotations

import json
import shutil
import sqlite3
import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
import uvicorn

from foucault.workbench import people
from foucault.workbench.web import application
from make_workbench import PASSWORD, log_text, make_bench

Opened = Callable[..., Any]

FILE = {"name": "walk 3.csv", "mimeType": "text/csv"}

DONE = 120_000  # a busy machine takes its time [ms]


def choose(page: Any, seed: int = 3) -> None:
    """Choose a log, which the keyboard alone does by a window of the system."""
    page.set_input_files("#file", files=[{**FILE, "buffer": log_text(seed)}])


def pages(lab: Any) -> dict[str, str]:
    """Return pages of each kind by their addresses."""
    return {
        "start": "/", "log": f"/logs/{lab.log}", "run": f"/jobs/{lab.run}", "jobs": "/jobs",
        "logs": "/logs", "instruments": "/instruments", "instrument": "/instrument?name=IMU%207",
        "due": "/due", "plan": "/plan", "journal": "/journal", "accounts": "/accounts",
        "login": "/login", "form": f"/do/calibrate?log={lab.log}", "compare": "/do/compare",
        "export": f"/do/export?run={lab.run}", "nowhere": "/nowhere",
    }  # fmt: skip


NAMES = ["start", "log", "run", "jobs", "logs", "instruments", "instrument", "due", "plan",
         "journal", "accounts", "login", "form", "compare", "export"]  # fmt: skip


# -- from the drop to what is kept -------------------------------------------------------------


def test_a_chosen_log_is_calibrated_and_kept(laboratory: Any, opened: Opened) -> None:
    """The whole way: choose, look, calibrate with progress, verdict, keep, its instrument."""
    page = opened(laboratory.address)
    choose(page)
    page.click("text=Look at it")
    page.wait_for_selector("text=What it was taken for", timeout=DONE)
    assert page.inner_text("h1") == "walk_3.csv" and "/logs/" in page.url
    assert "hand_rotated" in page.inner_text("main")
    page.fill("[name='--latitude']", "47.3 deg")
    page.click("button.main")
    page.wait_for_selector("progress", state="attached")
    page.wait_for_selector("text=Keep in the records", timeout=DONE)
    assert page.inner_text(".verdict .big") == "Pass"
    page.fill("[name=instrument]", "<b>IMU</b> 8")
    page.fill("[name=date]", "2026-04-01")
    page.click("text=Keep in the records")
    page.wait_for_selector("h1:has-text('<b>IMU</b> 8')")
    assert "2026-04-01" in page.inner_text("main") and not page.query_selector("h1 b")


def test_a_log_is_dropped_anywhere(laboratory: Any, opened: Opened) -> None:
    page = opened(laboratory.address)
    held = page.evaluate_handle("""text => {
        const held = new DataTransfer();
        held.items.add(new File([text], 'dropped.csv', {type: 'text/csv'}));
        return held;
    }""", log_text(3).decode())  # fmt: skip
    page.dispatch_event("body", "dragover", {"dataTransfer": held})
    assert "over" in page.get_attribute("form.drop", "class")
    page.dispatch_event("footer", "drop", {"dataTransfer": held})
    page.wait_for_selector("text=What it was taken for", timeout=DONE)
    assert page.inner_text("h1") == "dropped.csv"


def test_what_is_dropped_and_no_file_stays(laboratory: Any, opened: Opened) -> None:
    page = opened(laboratory.address)
    held = page.evaluate_handle("() => { const d = new DataTransfer(); d.setData('text/plain', "
                                "'x'); return d; }")  # fmt: skip
    page.dispatch_event("main", "drop", {"dataTransfer": held})
    assert page.url.rstrip("/") == laboratory.address and page.is_visible("form.drop")
    assert "over" not in page.get_attribute("form.drop", "class")


def test_without_a_file_nothing_is_sent(laboratory: Any, opened: Opened) -> None:
    page = opened(laboratory.address)
    page.click("text=Look at it")
    assert page.evaluate("!document.querySelector('#file').checkValidity()")
    assert page.url.rstrip("/") == laboratory.address


def test_what_was_taken_is_corrected(laboratory: Any, opened: Opened) -> None:
    """A unit that is said otherwise is looked at again, and is in the line to copy."""
    page = opened(f"{laboratory.address}/logs/{laboratory.log}")
    if page.is_visible("text=Look at it"):
        page.click("text=Look at it")
    page.wait_for_selector("text=Say it otherwise", timeout=DONE)
    assert page.input_value("[name='key:gyro.unit']") == "rad/s"
    page.fill("[name='key:gyro.unit']", "deg/s")
    page.click("text=Look again")
    page.wait_for_selector("[name='key:gyro.unit'][value='deg/s']", timeout=DONE)
    assert '--set "gyro.unit = deg/s"' in page.text_content(".same code")
    assert page.eval_on_selector_all(
        "input[type=hidden][name='--set']", "all => all.map(e => e.value)"
    ) == ["gyro.unit = deg/s"]
    page.fill("[name='key:gyro.unit']", "rad/s")
    page.click("text=Look again")
    page.wait_for_selector("[name='key:gyro.unit'][value='rad/s']", timeout=DONE)


def test_a_run_is_shown_with_its_verdict_and_coefficients(laboratory: Any, opened: Opened) -> None:
    page = opened(f"{laboratory.address}/jobs/{laboratory.run}")
    assert page.inner_text(".verdict .big") == "Pass"
    rows = page.eval_on_selector_all("[aria-label=Coefficients] tbody tr", "all => all.length")
    result = laboratory.folder / "runs" / str(laboratory.run) / "result.json"
    assert rows == len(json.loads(result.read_text())["coefficients"])
    assert "Kept as run 1 of IMU 7" in page.inner_text("main")


def test_a_run_stands_beside_the_last_one(laboratory: Any, opened: Opened) -> None:
    """The second run has no name of its own: once it is kept, its page compares it."""
    page = opened(f"{laboratory.address}/jobs/{laboratory.second}")
    if page.is_visible("text=Keep in the records"):
        page.fill("[name=instrument]", "IMU 7")
        page.fill("[name=date]", "2026-05-01")
        page.click("text=Keep in the records")
        page.wait_for_selector("h1:has-text('IMU 7')")
        page.goto(f"{laboratory.address}/jobs/{laboratory.second}")
    assert "Beside those of 2026-03-01" in page.inner_text("main")
    assert page.inner_text("[aria-label=Coefficients] thead").split()[-2:] == ["Last", "Change"]


def test_a_report_runs_in_a_frame_that_reaches_nothing(laboratory: Any, opened: Opened) -> None:
    page = opened(f"{laboratory.address}/jobs/{laboratory.run}", complains=True)
    frame = page.frame_locator("iframe[title=Report]")
    frame.locator("svg").first.wait_for(state="attached")
    inner = next(f for f in page.frames if f.url.endswith("/report"))
    assert inner.evaluate("self.origin") == "null"
    for reach in ("parent.document.title", "document.cookie", "localStorage.length"):
        with pytest.raises(Exception, match="SecurityError"):
            inner.evaluate(reach)
    reached = inner.evaluate("fetch('/jobs').then(() => 'yes', () => 'no')")
    assert reached == "no"


def test_what_a_run_leaves_is_downloaded(laboratory: Any, opened: Opened) -> None:
    page = opened(f"{laboratory.address}/jobs/{laboratory.run}")
    for name in ("result.json", "report.html"):
        with page.expect_download() as held:
            page.click(f"a[download]:has-text('{name}')")
        assert held.value.suggested_filename == name
        there = laboratory.folder / "runs" / str(laboratory.run) / name
        assert Path(held.value.path()).read_bytes() == there.read_bytes()
    assert page.url.endswith(f"/jobs/{laboratory.run}")


def test_two_runs_are_compared(laboratory: Any, opened: Opened) -> None:
    second = laboratory.second  # made before the page is: it lists what there is
    page = opened(f"{laboratory.address}/jobs/{laboratory.run}")
    page.click("text=Compare …")
    assert page.is_checked(f"[value='runs/{laboratory.run}']")
    page.check(f"[value='runs/{second}']")
    page.click("button.main")
    page.wait_for_selector("h2:has-text('Report')", timeout=DONE)
    line = [w for w in page.text_content("main > .same code").split() if w.startswith("runs/")]
    assert set(line[:2]) == {f"runs/{laboratory.run}", f"runs/{second}"}


def test_a_run_is_exported_and_fetched(laboratory: Any, opened: Opened) -> None:
    page = opened(f"{laboratory.address}/do/export?run={laboratory.run}")
    page.fill("[name='--to']", "c")
    page.fill("[name=name]", "cal.h")
    page.click("button.main")
    page.wait_for_selector("a[download]:has-text('cal.h')", timeout=DONE)
    with page.expect_download() as held:
        page.click("a[download]:has-text('cal.h')")
    assert "foucault" in Path(held.value.path()).read_text(encoding="utf-8").lower()


def test_a_session_is_planned(laboratory: Any, opened: Opened) -> None:
    page = opened(f"{laboratory.address}/plan")
    page.click("a:has-text('hand_rotated')")
    page.click("button.main")
    page.wait_for_selector("text=What it said", timeout=DONE)
    assert "accel.bias.x" in page.inner_text("main")


def test_a_mistake_is_said_and_the_way_back_is_shown(laboratory: Any, opened: Opened) -> None:
    page = opened(f"{laboratory.address}/do/calibrate?log={laboratory.log}")
    page.fill("[name='--latitude']", "147 deg")
    page.click("button.main")
    page.wait_for_selector(".verdict.unusable", timeout=DONE)
    assert "latitude" in page.inner_text(".verdict") and page.is_visible("text=its log")


def test_an_instrument_is_found_and_its_limits_are_set(laboratory: Any, opened: Opened) -> None:
    page = opened(f"{laboratory.address}/instruments")
    page.fill("#find", "imu 7")
    page.press("#find", "Enter")
    page.click("th a:has-text('IMU 7')")
    for title, fill in (("How long", {"[name=months]": "12"}),
                        ("Its limits", {"[name=text]": '"accel.bias" = "1 g"'})):  # fmt: skip
        page.click(f"summary:has-text('{title}')")
        for field, value in fill.items():
            page.fill(field, value)
        page.click("details[open] form button")
        page.wait_for_selector("h1:has-text('IMU 7')")
    assert "due 2027-0" in page.inner_text("main") and "within" in page.inner_text("thead").lower()
    page.goto(f"{laboratory.address}/due")
    assert "IMU 7" in page.inner_text("main")


def test_a_job_goes_on_when_its_page_is_closed(laboratory: Any, opened: Opened) -> None:
    page = opened(f"{laboratory.address}/do/calibrate?log={laboratory.log}")
    page.click("button.main")
    page.wait_for_url("**/jobs/*")
    number = int(page.url.rpartition("/")[2])
    page.close()
    assert laboratory.served.ended(number)["state"] == "done"


def test_a_job_is_stopped(laboratory: Any, opened: Opened) -> None:
    """The first is at work, so that the second waits: both are stopped from their pages."""
    page = opened(f"{laboratory.address}/do/calibrate?log={laboratory.log}")
    numbers = []
    for _ in range(2):
        page.goto(f"{laboratory.address}/do/calibrate?log={laboratory.log}")
        page.click("button.main")
        page.wait_for_url("**/jobs/*")
        numbers.append(page.url.rpartition("/")[2])
    page.click("text=Stop")
    page.wait_for_selector(".big:has-text('Stopped')")
    assert laboratory.served.ended(int(numbers[0]))["state"] == "done"


def test_a_page_that_is_not_there_says_so(laboratory: Any, browser: Any) -> None:
    page = browser.new_page()
    assert page.goto(f"{laboratory.address}/nowhere").status == 404
    assert "There is no such page" in page.inner_text("[role=alert]")
    page.click("text=To the start")
    assert page.is_visible("form.drop")
    page.close()


def test_an_edge_of_a_rest_is_dragged_and_taken(laboratory: Any, opened: Opened) -> None:
    """With the mouse on the traces; what is taken is in the line to copy."""
    page = opened(f"{laboratory.address}/logs/{laboratory.log}")
    if page.is_visible("text=Look at it"):
        page.click("text=Look at it")
    page.wait_for_selector("svg.trace rect.edge", timeout=DONE, state="attached")
    page.wait_for_load_state()  # until then a page that was loaded anew is scrolled to where it was
    before = float(page.input_value("[name=first] >> nth=1"))
    page.locator("svg.trace").scroll_into_view_if_needed()
    box = page.locator("svg.trace rect.edge").nth(2).bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 40)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] / 2 + 4, box["y"] + 40, steps=2)
    page.evaluate("scrollBy(0, -60)")  # a page that moves, and a mouse that leaves it, lose nothing
    page.mouse.move(box["x"] + box["width"] / 2 + 8, box["y"] + 400, steps=2)
    page.mouse.up()
    page.mouse.move(box["x"] + box["width"] / 2 + 90, box["y"] + 40)  # it has ended
    after = float(page.input_value("[name=first] >> nth=1"))
    assert before < after < before + 3
    rects = page.locator("svg.trace rect.edge").count()
    wide = page.locator("svg.trace").bounding_box()
    page.mouse.dblclick(wide["x"] + wide["width"] * 0.995, wide["y"] + 20)
    assert page.locator("svg.trace rect.edge").count() == rects + 2
    page.click("summary:has-text('First and last')")
    page.check("[aria-label='take out rest 1']")
    assert page.locator("svg.trace rect.edge").count() == rects
    page.uncheck("[aria-label='take out rest 1']")
    page.check("[aria-label='take out rest 17']")
    page.click("text=Take these rests")
    page.wait_for_selector("text=16 rests, shaded", timeout=DONE)
    assert abs(float(page.input_value("[name=first] >> nth=1")) - after) < 0.011
    assert "--set 'rests = [" in page.text_content("main .same code")
    page.click("text=Find them again")
    page.wait_for_selector(f"[name=first][value='{before:.10g}']", timeout=DONE, state="attached")


def test_a_certificate_is_asked_for_issued_and_fetched(laboratory: Any, opened: Opened) -> None:
    from test_certify import SAID

    from make_certificate import LABORATORY

    home = laboratory.folder / "certificates"
    home.mkdir(exist_ok=True)
    (home / "laboratory.toml").write_text(LABORATORY)
    page = opened(f"{laboratory.address}/jobs/{laboratory.run}", complains=True)
    page.click("text=Certify …")
    page.wait_for_selector("text=It lacks")
    assert page.is_visible("code:has-text('customer.name')")
    said = {**SAID, "item.model": "MTi", "item.serial": "7", "conditions.temperature": "23 °C"}
    del said["issued"]  # today
    dates = {"received": "2026-03-01", "performed": "2026-03-01"}
    for key, value in (said | dates).items():
        if key == "used":
            for name in value:
                page.check(f"[name=used][value='{name}']")
        elif key == "adjustment.done":
            page.select_option(f"[name='{key}']", value)
        elif key != "item.condition":
            page.fill(f"[name='{key}']", value)
    page.click("text=Issue the certificate")
    page.wait_for_selector("[role=alert]")
    assert "item.condition" in page.inner_text("[role=alert]")
    assert page.input_value("[name='customer.city']") == "Toulouse"
    page.fill("[name='item.condition']", "sealed")
    page.click("text=Issue the certificate")
    page.wait_for_selector("a[download]:has-text('2026-0042.pdf')", timeout=DONE)
    for name, begins in (("2026-0042.pdf", b"%PDF-"), ("2026-0042.xml", b"<?xml")):
        with page.expect_download() as held:
            page.click(f"a[download]:has-text('{name}')")
        assert Path(held.value.path()).read_bytes().startswith(begins)
        got = held.value.path()
    page.goto(f"{laboratory.address}/verify")
    page.set_input_files("#file", str(got))
    page.click("button:has-text('Look at it')")
    page.wait_for_selector(".big:has-text('Not valid')", timeout=DONE)
    assert "it is not signed" in page.inner_text("main")


# -- every page --------------------------------------------------------------------------------

ACCESS = """() => {
    const out = [];
    if (document.querySelectorAll('h1').length > 1) out.push('two titles');
    if (!document.documentElement.lang) out.push('no language');
    for (const one of document.querySelectorAll('input:not([type=hidden]), select, textarea'))
        if (!one.labels.length && !one.ariaLabel) out.push('no label: ' + one.outerHTML);
    for (const one of document.querySelectorAll('a, button'))
        if (!one.textContent.trim()) out.push('no words: ' + one.outerHTML);
    for (const one of document.querySelectorAll('iframe')) if (!one.title) out.push('no title');
    const ids = [...document.querySelectorAll('[id]')].map(e => e.id);
    if (new Set(ids).size < ids.length) out.push('one id twice');
    return out;
}"""

CONTRAST = """() => {
    // WCAG 2.1, 1.4.3: 4.5, and 3 of large letters.
    const parts = t => (t.match(/[\\d.]+/g) || []).map(Number);
    const bright = c => c.slice(0, 3).map(v => v / 255)
        .map(v => v <= .04045 ? v / 12.92 : ((v + .055) / 1.055) ** 2.4)
        .reduce((s, v, i) => s + v * [.2126, .7152, .0722][i], 0);
    const over = (a, b) => { const k = a.length > 3 ? a[3] : 1;
        return [0, 1, 2].map(i => k * a[i] + (1 - k) * b[i]); };
    const behind = one => { if (!one) return [255, 255, 255];
        const c = parts(getComputedStyle(one).backgroundColor);
        return c.length > 3 && c[3] === 0 ? behind(one.parentElement)
            : over(c, behind(one.parentElement)); };
    const out = [], walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    for (let n = walk.nextNode(); n; n = walk.nextNode()) {
        const one = n.parentElement, style = getComputedStyle(one), box = one.getClientRects()[0];
        if (!n.textContent.trim() || !box || !box.width || ['SCRIPT', 'STYLE', 'NOSCRIPT', 'OPTION']
            .includes(one.tagName)) continue;
        const paper = behind(one), ink = over(parts(style.color), paper);
        const [low, high] = [bright(paper), bright(ink)].sort((a, b) => a - b);
        const size = parseFloat(style.fontSize), large = size >= 24 || size >= 18.6 &&
            style.fontWeight >= 700;
        const ratio = (high + .05) / (low + .05);
        if (ratio < (large ? 3 : 4.5)) out.push(ratio.toFixed(2) + ' ' + n.textContent.trim());
    }
    return out;
}"""


@pytest.mark.parametrize("name", NAMES)
def test_a_page_is_read_narrow_dark_and_by_a_reader(
    laboratory: Any, opened: Opened, name: str
) -> None:
    """At 420 px nothing sticks out; light and dark its words stand off; its fields have labels."""
    page = opened(laboratory.address + pages(laboratory)[name],
                  viewport={"width": 420, "height": 800}, color_scheme="dark")  # fmt: skip
    assert page.evaluate("document.documentElement.scrollWidth") <= 420
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(17, 20, 24)"
    assert page.evaluate(ACCESS) == []
    page.evaluate("document.querySelectorAll('details').forEach(e => { e.open = true; })")
    assert page.evaluate("document.documentElement.scrollWidth") <= 420
    assert page.evaluate(CONTRAST) == []
    page.emulate_media(color_scheme="light")
    assert page.evaluate(CONTRAST) == []


@pytest.mark.parametrize("name", ["run", "instrument", "log"])
def test_a_page_is_printed_without_what_is_clicked(
    laboratory: Any, opened: Opened, name: str
) -> None:
    page = opened(laboratory.address + pages(laboratory)[name])
    page.emulate_media(media="print")
    assert not page.is_visible("nav") and page.is_visible("h1")
    assert not any(b.is_visible() for b in page.query_selector_all("button"))


# -- without a mouse ---------------------------------------------------------------------------


def tab_to(page: Any, selector: str, most: int = 60) -> None:
    """Press Tab until something has the focus."""
    for _ in range(most):
        page.keyboard.press("Tab")
        if page.evaluate("s => document.activeElement.matches(s)", selector):
            return
    raise AssertionError(f"{selector} is not reached by Tab")


def test_the_first_tab_leads_past_the_bar(laboratory: Any, opened: Opened) -> None:
    page = opened(laboratory.address)
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"
    assert page.evaluate("document.activeElement.getBoundingClientRect().left") >= 0
    page.keyboard.press("Enter")
    assert page.url.endswith("#main")
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.closest('main') !== null")


def test_from_a_log_to_its_verdict_by_the_keyboard(laboratory: Any, opened: Opened) -> None:
    page = opened(laboratory.address)
    choose(page)
    tab_to(page, "form.drop button")
    page.keyboard.press("Enter")
    page.wait_for_selector("text=What it was taken for", timeout=DONE)
    tab_to(page, "[name='--latitude']")
    page.keyboard.type("47.3 deg")
    page.keyboard.press("Enter")
    page.wait_for_selector(".verdict.pass", timeout=DONE)
    tab_to(page, "[name=instrument]")
    page.keyboard.type("IMU 9")
    tab_to(page, "[name=date]")
    page.keyboard.type("2026-04-01")
    page.keyboard.press("Enter")
    page.wait_for_selector("h1:has-text('IMU 9')")


def test_whatever_has_the_focus_shows_it(laboratory: Any, opened: Opened) -> None:
    page = opened(f"{laboratory.address}/do/calibrate?log={laboratory.log}")
    for _ in range(12):
        page.keyboard.press("Tab")
        seen = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
        assert seen != "none", page.evaluate("document.activeElement.outerHTML")


def test_what_is_folded_opens_by_the_keyboard(laboratory: Any, opened: Opened) -> None:
    page = opened(f"{laboratory.address}/instrument?name=IMU%207")
    tab_to(page, "summary")
    page.keyboard.press("Enter")
    assert page.is_visible("[name=months]")


# -- without a script --------------------------------------------------------------------------


def test_all_of_it_goes_without_a_script(laboratory: Any, opened: Opened) -> None:
    page = opened(laboratory.address, java_script_enabled=False)
    choose(page)
    page.click("text=Look at it")
    page.wait_for_selector("text=What it was taken for", timeout=DONE)  # it loads itself anew
    page.fill("[name='--latitude']", "47.3 deg")
    page.click("button.main")
    page.wait_for_selector("text=Keep in the records", timeout=DONE)
    with page.expect_download() as held:
        page.click("a[download]:has-text('result.json')")
    assert held.value.suggested_filename == "result.json"


@pytest.mark.parametrize("name", ["start", "instrument", "form", "plan"])
def test_a_page_says_the_same_without_a_script(laboratory: Any, opened: Opened, name: str) -> None:
    address = laboratory.address + pages(laboratory)[name]
    texts = [opened(address, java_script_enabled=on).inner_text("main") for on in (True, False)]
    assert texts[0] == texts[1]


# -- two users ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def shared(laboratory: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Any]]:
    """The same workbench with accounts, on a copy of its folder."""
    from argon2 import PasswordHasher

    folder = tmp_path_factory.mktemp("shared") / "bench"
    # Its databases are in use: the logs beside them come and go, a backup is whole at any time.
    left = shutil.ignore_patterns("workers", "*.sqlite*")
    shutil.copytree(laboratory.folder, folder, ignore=left)
    for one in laboratory.folder.glob("*.sqlite"):
        with closing(sqlite3.connect(one)) as of, closing(sqlite3.connect(folder / one.name)) as to:
            of.backup(to)
    bench = make_bench(folder)
    quick = PasswordHasher(time_cost=1, memory_cost=64, parallelism=1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(people, "_hasher", lambda: quick)
        for name, role in (("ann", "administrator"), ("rob", "reviewer"), ("olga", "operator")):
            bench.people.add(name, role, PASSWORD)
        server = uvicorn.Server(uvicorn.Config(application(bench), port=0, log_level="error"))
        thread = threading.Thread(target=server.run)
        thread.start()
        while not server.started:
            threading.Event().wait(0.02)
        port = server.servers[0].sockets[0].getsockname()[1]
        yield f"http://127.0.0.1:{port}", bench
        server.should_exit = True
        thread.join()


def log_in(page: Any, name: str, password: str = PASSWORD) -> None:
    page.fill("[name=name]", name)
    page.fill("[name=password]", password)
    page.click("button.main")


def test_who_is_not_known_is_asked_and_led_back(shared: Any, opened: Opened) -> None:
    page = opened(f"{shared[0]}/instruments")
    assert "/login" in page.url
    log_in(page, "olga")
    page.wait_for_url("**/instruments")
    assert page.inner_text(".who").split()[0] == "olga"
    cookies = page.context.cookies()
    assert cookies[0]["httpOnly"] and cookies[0]["sameSite"] == "Lax"
    assert page.evaluate("document.cookie") == ""
    page.click("text=Log out")
    page.wait_for_url("**/login")
    page.goto(f"{shared[0]}/jobs")
    assert "/login" in page.url


def test_a_wrong_password_is_said(shared: Any, browser: Any) -> None:
    page = browser.new_page()
    page.goto(shared[0])
    log_in(page, "olga", "not this one at all")
    assert "do not belong together" in page.inner_text("[role=alert]")
    page.close()


def test_one_sees_what_the_other_does_and_may_do_what_she_may(
    shared: Any, opened: Opened, laboratory: Any
) -> None:
    """Olga asks for a job, Rob sees it with her name and judges her run; she cannot."""
    address = shared[0]
    olga, rob = opened(address), opened(address)
    log_in(olga, "olga")
    log_in(rob, "rob")
    olga.goto(f"{address}/do/calibrate?log={laboratory.log}")
    olga.click("button.main")
    olga.wait_for_url("**/jobs/*")
    number = olga.url.rpartition("/")[2]
    rob.goto(f"{address}/jobs")
    row = rob.inner_text("tbody tr:first-child")
    assert row.split()[0] == number and "olga" in row and "waiting" in row
    rob.goto(f"{address}/jobs/{number}")
    rob.click("text=Stop")  # that of another is a reviewer's to stop
    olga.wait_for_selector(".big:has-text('Stopped')")
    run = f"{address}/jobs/{laboratory.run}"
    olga.goto(run)
    rob.goto(run)
    assert not olga.is_visible("text=Judge it") and not olga.is_visible("text=Journal")
    rob.click("text=Judge it")
    rob.select_option("[name=decision]", "rejected")
    rob.fill("[name=reason]", "the stand was bumped")
    rob.click("button:has-text('Judge')")
    rob.wait_for_selector("h1:has-text('IMU 7')")
    olga.reload()
    assert "rejected" in olga.inner_text("main")
    rob.goto(f"{address}/journal")
    assert "rob" in rob.inner_text("tbody tr:first-child")
    assert "the stand was bumped" in rob.inner_text("tbody tr:first-child")


def test_an_account_is_closed_under_who_uses_it(shared: Any, opened: Opened) -> None:
    address = shared[0]
    ann, eve = opened(address), opened(address)
    log_in(ann, "ann")
    ann.goto(f"{address}/accounts")
    ann.fill("form.fields [name=name]", "eve")
    ann.fill("[name=password]", PASSWORD)
    ann.click("text=Make or change")
    ann.wait_for_selector("th:has-text('eve')")
    log_in(eve, "eve")
    eve.wait_for_selector("form.drop")
    ann.click("tr:has-text('eve') button")
    ann.wait_for_selector("tr:has-text('eve') >> text=closed")
    eve.goto(f"{address}/jobs")
    assert "/login" in eve.url


def test_a_page_of_another_site_cannot_act(shared: Any, browser: Any) -> None:
    """Logged in here, she opens a page of somebody else that sends a form to us."""
    address, bench = shared
    before = len(bench.store.jobs(300))
    window = browser.new_context()
    page = window.new_page()
    page.goto(address)
    log_in(page, "ann")
    page.wait_for_selector("form.drop")
    evil = window.new_page()
    fields = {"name": "mallory", "role": "administrator", "password": PASSWORD}
    inputs = "".join(f'<input name="{k}" value="{v}">' for k, v in fields.items())
    evil.set_content(f'<form method="post" action="{address}/accounts">{inputs}'
                     "<button>Win a prize</button></form>")  # fmt: skip
    with evil.expect_navigation() as answer:
        evil.click("button")
    assert answer.value.status == 403
    assert "mallory" not in {a["name"] for a in bench.people.all()}
    assert len(bench.store.jobs(300)) == before
    framed = window.new_page()
    framed.set_content(f'<iframe src="{address}/accounts"></iframe>')
    framed.wait_for_timeout(300)
    assert all("Make or change" not in f.content() for f in framed.frames[1:])
    window.close()
