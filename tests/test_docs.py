"""What the documentation says is what happens: code, campaigns, generated pages, examples."""

from __future__ import annotations

import importlib.util
import re
import runpy
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from foucault import campaign, report, run_folder
from foucault.campaign import north
from foucault.units import parse

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def blocks(language: str) -> list[Any]:
    out = []
    for page in PAGES:
        found = re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), re.S)
        for i, block in enumerate(found):
            out.append(pytest.param(block, id=f"{page.relative_to(ROOT)}-{i}"))
    return out


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as a reader of the docs has it: campaign.toml, log.csv, session.csv, run/."""
    folder = tmp_path_factory.mktemp("reader")
    described = campaign.parse(campaign.template("hand_rotated"), folder / "campaign.toml")
    campaign.save_session(campaign.simulate(described), folder)
    shutil.copy(folder / "log.csv", folder / "session.csv")
    loaded = campaign.load(folder / "campaign.toml")
    run_folder.save(campaign.calibrate(loaded), folder / "run", loaded.text)
    report.write(folder / "run")
    return folder


@pytest.mark.parametrize("code", blocks("python"))
def test_python_in_the_docs_runs(
    code: str, session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(session, tmp_path / "here")
    monkeypatch.chdir(tmp_path / "here")
    exec(compile(code, "docs", "exec"), {"__name__": "__main__"})


@pytest.mark.parametrize("text", blocks("toml"))
def test_campaigns_in_the_docs_load(text: str) -> None:
    # A fragment is completed: what it says must be a valid part of some campaign.
    for table, rest in REST.items():
        if f"[{table}]" not in text:
            text += rest
    if '"transfer_alignment"' in text and "[master]" not in text:
        text += '\n[master]\nfile = "master.csv"\n'
    assert campaign.parse(text, "docs.toml").procedure


def test_readings_in_the_docs_give_the_headings_they_say(tmp_path: Path) -> None:
    page = (ROOT / "docs/procedures/north_seeking.md").read_text(encoding="utf-8")
    (table,) = re.findall(r"```csv\n(.*?)```", page, re.S)
    first, second, sd = re.search(
        r"these give ([\d.]+) and ([\d.]+) deg, ([\d.]+) deg each", page
    ).groups()  # type: ignore[union-attr]
    file = tmp_path / "readings.csv"
    file.write_text(table, encoding="utf-8")
    said = north.Said(
        {"latitude": np.radians(47.3)}, {},
        parse("0.003 deg/sqrt(h)", "angle random walk"),
        parse("30 ug/sqrt(Hz)", "velocity random walk"),
    )  # fmt: skip
    fixes = north.run(file, said).fixes
    assert [f"{a:.2f}" for a in np.degrees(fixes.angles[:, 0])] == [first, second]
    assert [f"{a:.2f}" for a in np.degrees(fixes.sd[:, 0])] == [sd, sd]


REST = {
    "site": '\n[site]\ngravity = "9.81 m/s^2"\n',
    "log": '\n[log]\nfile = "log.csv"\n',
    "procedure": '\n[procedure]\nname = "hand_rotated"\n',
}


@pytest.mark.parametrize("script", sorted((ROOT / "examples").glob("*.py")), ids=lambda p: p.name)
def test_examples_run(script: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(script), run_name="__main__")


@pytest.mark.parametrize("file", sorted((ROOT / "examples").glob("*.toml")), ids=lambda p: p.name)
def test_example_campaigns_calibrate(file: Path, tmp_path: Path) -> None:
    made = campaign.save_session(campaign.simulate(file), tmp_path)
    assert campaign.calibrate(made).verdict.level == "pass"


def test_generated_pages_are_current() -> None:
    spec = importlib.util.spec_from_file_location("generate", ROOT / "docs" / "generate.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    for name, make in module.PAGES.items():
        assert (ROOT / "docs" / name).read_text(encoding="utf-8") == make(), (
            f"docs/{name} is out of date: run `python docs/generate.py`"
        )


def test_links_between_pages_exist() -> None:
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            if "://" not in target:
                assert (page.parent / target).exists(), f"{page.name} links to {target}"
