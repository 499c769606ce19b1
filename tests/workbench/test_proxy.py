"""Behind a proxy that takes TLS and a prefix off, and the files that start a server."""

from __future__ import annotations

import re
import shutil
import subprocess
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import httpx2 as httpx
import pytest

from commands import run
from make_workbench import PASSWORD, Served, log_text

DOCS = (Path(__file__).parents[2] / "docs" / "workbench.md").read_text(encoding="utf-8")

PREFIX = "/bench"


def proxy(to: str) -> type[BaseHTTPRequestHandler]:
    """Return what passes requests below the prefix on, as the lines for nginx have it."""

    class Proxy(BaseHTTPRequestHandler):
        def do(self) -> None:
            if not self.path.startswith(f"{PREFIX}/"):
                self.send_error(404)
                return
            size = int(self.headers.get("content-length") or 0)
            headers = {k: v for k, v in self.headers.items() if k.lower() != "connection"}
            headers |= {"X-Forwarded-For": "203.0.113.7", "X-Forwarded-Proto": "https"}
            answer = httpx.request(
                self.command, to + self.path[len(PREFIX):], content=self.rfile.read(size),
                headers=headers, timeout=60,
            )  # fmt: skip
            self.send_response(answer.status_code)
            for key, value in answer.headers.multi_items():
                if key not in ("transfer-encoding", "content-length", "connection"):
                    self.send_header(key, value)
            self.send_header("content-length", str(len(answer.content)))
            self.end_headers()
            self.wfile.write(answer.content)

        do_GET = do_POST = do  # noqa: N815

        def log_message(self, *_: Any) -> None:
            pass

    return Proxy


@pytest.fixture(scope="module")
def below(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Served, str]]:
    """A workbench with an account behind a proxy, and the address of that."""
    from foucault.workbench.serving import add_account, made

    folder = tmp_path_factory.mktemp("below")
    add_account(made(folder), "ann", "administrator", PASSWORD, None)
    served = Served(folder, "--workers", "1", "--prefix", PREFIX)
    front = ThreadingHTTPServer(("127.0.0.1", 0), proxy(served.address))
    thread = threading.Thread(target=front.serve_forever)
    thread.start()
    yield served, f"http://127.0.0.1:{front.server_port}"
    front.shutdown()
    thread.join()
    front.server_close()
    served.end()


def send(browser: Any, to: str, data: dict[str, str], **more: Any) -> Any:
    """Send a form with the cookie that a browser would send by TLS."""
    page = browser.get(f"{PREFIX}/login" if to.endswith("login") else f"{PREFIX}/")
    browser.headers["cookie"] = page.headers.get("set-cookie", browser.headers.get("cookie", ""))
    mark = re.search(r'name="mark" value="(\w+)"', page.text)[1]
    return browser.post(to, data={"mark": mark, **data}, **more)


def test_pages_lie_below_the_prefix(below: tuple[Served, str]) -> None:
    _, address = below
    with httpx.Client(base_url=address, timeout=60) as browser:
        asked = browser.get(f"{PREFIX}/jobs")
        assert asked.status_code == 303
        assert asked.headers["location"] == f"{PREFIX}/login?to=/jobs"
        first = browser.get(f"{PREFIX}/login").headers["set-cookie"]
        assert "Secure" in first and f"Path={PREFIX}" in first
        answer = send(browser, f"{PREFIX}/login",
                      {"name": "ann", "password": PASSWORD, "to": "/jobs"})  # fmt: skip
        assert answer.status_code == 303 and answer.headers["location"] == f"{PREFIX}/jobs"
        browser.headers["cookie"] = answer.headers["set-cookie"]
        sent = send(browser, f"{PREFIX}/logs", {}, files={"file": ("x.csv", log_text())})
        assert sent.status_code == 303, sent.text
        assert sent.headers["location"].startswith(f"{PREFIX}/logs/")
        seen = 0
        for path in ("/", "/jobs", "/instruments", "/due", "/plan", "/accounts", "/journal",
                     "/verify", "/do/calibrate"):  # fmt: skip
            text = browser.get(PREFIX + path).text
            links = re.findall(r'(?:href|action|src|hx-get)="([^"#][^"]*)"', text)
            outside = [k for k in links if not k.startswith((f"{PREFIX}/", "data:"))]
            assert links and not outside, (path, outside)
            seen += len(links)
        assert seen > 80
        assert browser.get(f"{PREFIX}/static/style.css").status_code == 200


def test_a_form_of_another_site_is_refused_behind_a_proxy_too(below: tuple[Served, str]) -> None:
    _, address = below
    with httpx.Client(base_url=address, timeout=60) as browser:
        for headers in ({"origin": "https://evil.example"}, {"sec-fetch-site": "cross-site"}):
            said = browser.post(f"{PREFIX}/login", data={"mark": "0"}, headers=headers)
            assert said.status_code == 403


def test_a_prefix_that_is_none_is_refused(tmp_path: Path) -> None:
    for given in ("/a b", "//evil.example/<x>", "/..", "/a/../b"):
        said = run("serve", tmp_path, "--prefix", given, code=1)
        assert "cannot be the beginning of a path" in said.stderr


# -- files that start one ------------------------------------------------------------------------


def block(begins: str) -> str:
    """Return the block of the page that begins so."""
    return next(b for b in re.findall(r"```\w*\n(.*?)```", DOCS, re.S) if b.startswith(begins))


def test_the_unit_is_one(tmp_path: Path) -> None:
    """By systemd itself where it is there; the program of the unit is another one here."""
    text = block("[Unit]")
    assert "foucault serve" in text and "NoNewPrivileges=yes" in text
    tool = shutil.which("systemd-analyze")
    if tool is None:
        pytest.skip("systemd-analyze is not here")
    unit = tmp_path / "foucault.service"
    unit.write_text(re.sub(r"/opt/\S+/foucault", "/bin/true", text))
    said = subprocess.run([tool, "verify", str(unit)], capture_output=True, text=True)
    own = [line for line in said.stderr.splitlines() if "foucault.service" in line]
    assert not own, own


def test_the_container_file_names_what_there_is() -> None:
    """It is read, not built: words, the extras it installs, the options it gives."""
    text = block("FROM")
    lines = re.sub(r"\\\n\s*", " ", text).strip().splitlines()
    words = {"FROM", "RUN", "USER", "WORKDIR", "VOLUME", "EXPOSE", "ENTRYPOINT"}
    assert {line.split()[0] for line in lines} <= words and lines[0].startswith("FROM ")
    extras = re.search(r"foucault\[([\w,]+)\]", text)[1].split(",")
    project = (Path(__file__).parents[2] / "pyproject.toml").read_text()
    assert all(f"\n{extra} = [" in project for extra in extras)
    assert "USER foucault" in text and '"--host", "0.0.0.0"' in text
