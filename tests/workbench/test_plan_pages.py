"""Before a session: what can be chosen, what it will show, and the list to go by."""

from __future__ import annotations

import re
from collections.abc import Callable
from html import unescape
from pathlib import Path
from typing import Any

import pytest

from foucault import campaign
from foucault.procedures import PROCEDURES, load
from foucault.report import operator
from foucault.workbench.store import Store
from make_workbench import client, make_bench, post, work_off

Opened = Callable[..., Any]

DONE = 120_000  # a busy machine takes its time [ms]

POINTS = "all => all.map(e => e.getAttribute('points') || e.textContent)"


@pytest.fixture(scope="module")
def planned(laboratory: Any) -> int:
    """A plan of twelve rests that was asked for; returns the number of its job."""
    asked = {"command": "preflight", "name": "hand_rotated",
             "options": {"set": ["simulate.rests = 12"]}}  # fmt: skip
    number = laboratory.served.api("POST", "/jobs", json=asked)["number"]
    assert laboratory.served.ended(number)["state"] == "done"
    return int(number)


def test_every_procedure_can_be_planned_by_a_form(tmp_path: Path) -> None:
    browser = client(make_bench(tmp_path))
    listed = browser.get("/plan").text
    for name in PROCEDURES:
        assert f"/plan/{name}" in listed
        page = browser.get(f"/plan/{name}")
        assert page.status_code == 200 and f"foucault preflight {name} --steps" in page.text
        assert 'name="simulate.' in page.text
    assert "procedure.index_limit" in browser.get("/plan/north_seeking").text
    assert browser.get("/plan/nothing").status_code == 404


def test_what_is_chosen_is_in_the_line_to_copy(tmp_path: Path) -> None:
    bench = make_bench(tmp_path)
    browser = client(bench)
    said = {"simulate.rests": "12", "simulate.turn_time": "3 s", "simulate.rate": ""}
    page = post(browser, "/plan/hand_rotated", said)
    assert '--set "simulate.rests = 12" --set "simulate.turn_time = 3 s"' in unescape(page.text)
    job = Store(tmp_path).job(1)
    assert job.words[:2] == ("preflight", "hand_rotated")
    assert job.words[-3:] == ("-o", "runs/1/expected.csv", "--steps=runs/1/operator.html")


def test_a_plan_reaches_no_file(tmp_path: Path) -> None:
    """Only tables that name no file can be set, and no value leads out."""
    bench = make_bench(tmp_path)
    browser = client(bench)
    for key, value in (("log.file", "workbench.sqlite"), ("noise.file", "x"),
                       ("procedure.plan", "/etc/passwd"), ("simulate.x", "../../x")):  # fmt: skip
        assert post(browser, "/plan/hand_rotated", {key: value}).status_code == 400, key
    assert not [job for job in bench.store.jobs() if "passwd" in str(job.words)]
    assert browser.get("/jobs/1/list").status_code in (404, 409)


@pytest.mark.thorough
def test_a_broken_limit_is_told_and_has_a_list_too(tmp_path: Path) -> None:
    bench = make_bench(tmp_path)
    browser = client(bench)
    post(browser, "/plan/north_seeking", {"procedure.index_limit": "95 deg"})
    (job,) = work_off(bench)
    assert job.verdict == "doubtful"
    page = browser.get("/jobs/1").text
    assert "Look at it before you begin" in page and "index angle 180° of 95°" in page
    assert "expected.csv" in page and "/jobs/1/list" in page
    got = browser.get("/jobs/1/list")
    assert "sandbox allow-scripts" in got.headers["content-security-policy"]
    assert "set-up 0, index" in got.text


@pytest.mark.thorough
def test_a_plan_is_chosen_and_shown(laboratory: Any, opened: Opened) -> None:
    """The whole way in a browser: procedure, rests, what it shows, the list in its frame."""
    page = opened(f"{laboratory.address}/plan")
    page.click("a:has-text('six_position')")
    page.fill("[name='simulate.rest_time']", "20 s")
    page.select_option("[name='simulate.grade']", "tactical")
    page.click("text=What will it show?")
    page.wait_for_selector("text=What to do", timeout=DONE)
    frame = page.frame_locator("iframe[title='What to do']")
    assert frame.locator("ol > li").count() == 6
    assert "rest 20\xa0s" in frame.locator("ol > li").first.inner_text()
    frame.locator("button:has-text('Next')").click()
    assert frame.locator("#told").inner_text().startswith("2 of 6: z down")


@pytest.mark.thorough
def test_positions_turn_by_keys_and_stand_as_they_are_listed(
    laboratory: Any, opened: Opened, planned: int
) -> None:
    """The script draws a position as it is drawn on its card, to the last digit."""
    page = opened(f"{laboratory.address}/jobs/{planned}/list")
    assert page.locator("ol > li").count() == 12
    page.focus(".turner")
    drawn: list[Any] = []
    for k in (2, 3, 4, 5):
        page.keyboard.press("ArrowRight")
        page.wait_for_selector(f"#told:has-text('{k} of')")
        card = page.eval_on_selector_all(f"ol > li:nth-child({k}) svg *", POINTS)
        for _ in range(100):  # it slides there
            if page.eval_on_selector_all(".turner svg *", POINTS) == card:
                break
            page.wait_for_timeout(50)
        assert page.eval_on_selector_all(".turner svg *", POINTS) == card
        drawn.append(card)
        assert page.get_attribute(f"ol > li:nth-child({k})", "aria-current") is not None
    assert drawn[0] != drawn[1]
    page.keyboard.press("ArrowLeft")
    page.wait_for_selector("#told:has-text('4 of')")


@pytest.mark.thorough
def test_nothing_moves_before_it_is_asked_for(
    laboratory: Any, opened: Opened, planned: int
) -> None:
    page = opened(f"{laboratory.address}/jobs/{planned}/list")
    before = page.inner_html(".turner svg")
    page.wait_for_timeout(600)
    assert page.inner_html(".turner svg") == before
    page.focus(".turner")
    page.keyboard.press("Space")
    assert page.inner_text("[data-play]") == "Stop"
    page.wait_for_selector("#told:has-text('2 of')")
    page.click("[data-play]")
    assert page.inner_text("[data-play]") == "Play"


@pytest.mark.thorough
def test_who_wants_less_motion_sees_steps(laboratory: Any, opened: Opened, planned: int) -> None:
    page = opened(f"{laboratory.address}/jobs/{planned}/list", reduced_motion="reduce")
    same = page.evaluate("""async () => {
        document.querySelector("[data-step='1']").click();
        await Promise.resolve();
        const at = () => document.querySelector(".turner svg").innerHTML;
        const first = at();
        await new Promise((done) => setTimeout(done, 300));
        return first === at();
    }""")
    assert same and page.inner_text("#told").startswith("2 of 12")
    card = page.eval_on_selector_all("ol > li:nth-child(2) svg *", POINTS)
    assert page.eval_on_selector_all(".turner svg *", POINTS) == card


@pytest.mark.thorough
def test_without_a_script_all_positions_are_read(
    laboratory: Any, opened: Opened, planned: int
) -> None:
    page = opened(f"{laboratory.address}/jobs/{planned}/list", java_script_enabled=False)
    assert page.is_hidden(".turner")
    assert page.locator("ol > li svg polygon").count() >= 4 * 12
    assert "z\xa0up" in page.inner_text("ol > li:first-child")


@pytest.mark.thorough
def test_a_list_is_printed_on_one_page(laboratory: Any, opened: Opened, planned: int) -> None:
    page = opened(f"{laboratory.address}/jobs/{planned}/list")
    made = page.pdf(prefer_css_page_size=True, print_background=True)
    assert re.findall(rb"/Count (\d+)", made) == [b"1"]
    page.emulate_media(media="print")
    assert page.is_hidden(".turner") and page.is_visible("ol > li:last-child input")
    page.emulate_media(media="screen")
    page.set_viewport_size({"width": 420, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


@pytest.mark.thorough
def test_lists_of_up_to_two_dozen_positions_fit_on_a_page(browser: Any) -> None:
    page = browser.new_page()
    for name in PROCEDURES:
        c = campaign.parse(campaign.template(name), f"{name}.toml")
        found = load(name).stages(c.settings, c.session, c.site)
        page.set_content(operator.page(name, [load(name).summary], found))
        made = page.pdf(prefer_css_page_size=True, print_background=True)
        if len(found) <= operator.SOME:
            assert re.findall(rb"/Count (\d+)", made) == [b"1"], name
    page.close()


@pytest.mark.thorough
def test_a_better_plan_is_searched_for_and_its_list_made(tmp_path: Path) -> None:
    """The line of the job is that of the command line; what was found is planned as any other."""
    bench = make_bench(tmp_path)
    browser = client(bench)
    assert "Search for a better plan" not in browser.get("/plan/hand_rotated").text
    assert "Search for a better plan" in browser.get("/plan/norm_observation").text
    said = {"restarts": "1", "time-limit": "1 s", "search": "yes"}
    post(browser, "/plan/norm_observation", said)
    job = bench.store.job(1)
    assert job.words[:3] == ("optimise", "norm_observation", "--restarts=1")
    assert job.words[3:] == ("--time-limit=1 s", "-o", "runs/1")
    assert work_off(bench)[0].state == "done"
    page = browser.get("/jobs/1").text
    assert "found" in page and "/jobs/1/foresee" in page and "/jobs/1/report" in page
    post(browser, "/jobs/1/foresee", {})
    assert bench.store.job(2).words[:2] == ("preflight", "runs/1/campaign.toml")
    assert work_off(bench)[0].state == "done"
    assert "List to print" in browser.get("/jobs/2").text
    assert post(browser, "/jobs/9/foresee", {}).status_code == 400
