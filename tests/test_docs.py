"""What the documentation says is what happens: code, campaigns, generated pages, examples."""

from __future__ import annotations

import ast
import doctest
import functools
import importlib
import importlib.util
import inspect
import re
import runpy
import shlex
import shutil
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer.main
from typer.testing import CliRunner

import foucault
from foucault import campaign, report, run_folder
from foucault.campaign import north, tolerance
from foucault.campaign.tables import Said
from foucault.cli.app import app
from foucault.logs import read as read_log
from foucault.models.imu import LAYOUT as IMU
from foucault.models.parts import catalogue
from foucault.procedures import PROCEDURES
from foucault.symptoms import SYMPTOMS
from foucault.units import parse
from make_recordings import START, Bag, ulog

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", ROOT / "examples/README.md", *sorted(DOCS.rglob("*.md"))]
CONTRIBUTING = ROOT / "CONTRIBUTING.md"


def blocks(language: str) -> list[Any]:
    out = []
    for page in PAGES:
        found = re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), re.S)
        for i, block in enumerate(found):
            out.append(pytest.param(block, id=f"{page.relative_to(ROOT)}-{i}"))
    return out


def write_recordings(folder: Path) -> None:
    """Write drive.bag and flight.ulg."""
    rng = np.random.default_rng(1)
    w, f = rng.normal(0, 0.01, (50, 3)), rng.normal([0, 0, 9.81], 0.01, (50, 3))
    with Bag(folder / "drive.bag") as bag:
        bag.imu("/imu/data", START + np.arange(50) * 10**7, w, f)
    fields = "uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;"
    rows = [(10_000 * i, *w[i], *(f[i] * [1, 1, -1])) for i in range(50)]
    ulog(folder / "flight.ulg", {"sensor_combined": (fields, rows)})


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as a reader of the docs has it: campaign.toml, log.csv, session.csv, run/."""
    folder = tmp_path_factory.mktemp("reader")
    described = campaign.parse(campaign.template("hand_rotated"), folder / "campaign.toml")
    campaign.save_session(campaign.simulate(described), folder)
    shutil.copy(folder / "log.csv", folder / "session.csv")
    write_recordings(folder)
    loaded = campaign.load(folder / "campaign.toml")
    run_folder.save(campaign.calibrate(loaded), folder / "run", loaded.text)
    report.write(folder / "run")
    return folder


STUDIES = ("trust", "plans", "delay", "transfer_alignment")
"""Pages whose Python takes seconds."""


@pytest.mark.parametrize("code", [
    pytest.param(*p.values, id=p.id, marks=[pytest.mark.thorough] * (Path(p.id).stem in STUDIES))
    for p in blocks("python")
])  # fmt: skip
def test_python_in_the_docs_runs(
    code: str, session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(session, tmp_path / "here")
    monkeypatch.chdir(tmp_path / "here")
    exec(compile(code, "docs", "exec"), {"__name__": "__main__"})


def printing() -> list[Any]:
    """Return the Python of the pages of which they say what it prints."""
    said = re.compile(r"^```python\n([^`]*)^```\n\nprints `([^`]+)`", re.MULTILINE)
    return [
        pytest.param(*found.groups(), id=f"{page.stem}:{found.start()}")
        for page in sorted(DOCS.rglob("*.md"))
        for found in said.finditer(page.read_text())
    ]


@pytest.mark.thorough
@pytest.mark.parametrize(("code", "words"), printing())
def test_python_in_the_docs_prints_what_they_say(
    code: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "docs", "exec"), {"__name__": "__main__"})
    assert words in capsys.readouterr().out.splitlines()


def doctests() -> list[Any]:
    """Examples of the pages, and of the docstrings of what a user imports."""
    public = [(name, inspect.getdoc(getattr(foucault, name)) or "") for name in foucault.__all__]
    return blocks("pycon") + [pytest.param(doc, id=name) for name, doc in public if ">>>" in doc]


@pytest.mark.parametrize("text", doctests())
def test_doctests_say_what_is_printed(text: str) -> None:
    found = doctest.DocTestParser().get_doctest(text, {}, "docs", None, 0)
    assert found.examples
    said: list[str] = []
    assert doctest.DocTestRunner().run(found, out=said.append).failed == 0, "".join(said)


@pytest.mark.parametrize("text", blocks("toml"))
def test_campaigns_in_the_docs_load(text: str) -> None:
    # A fragment is completed: what it says must be a valid part of some campaign.
    for table, rest in REST.items():
        if f"[{table}]" not in text:
            text += rest
    if '"transfer_alignment"' in text and "[master" not in text:
        text += MASTER
    # A log of one axis is for `allan` and `inspect`, which want no procedure.
    one = re.search(r'gyro = { columns = ("|\["\w+"\])', text) is not None
    assert campaign.parse(text, "docs.toml", calibrates=not one).procedure


def test_readings_in_the_docs_give_the_headings_they_say(tmp_path: Path) -> None:
    page = (DOCS / "procedures/north_seeking.md").read_text(encoding="utf-8")
    (table,) = re.findall(r"```csv\n(.*?)```", page, re.S)
    first, second, sd = re.search(
        r"these give ([\d.]+) and ([\d.]+) deg, ([\d.]+) deg each", page
    ).groups()  # type: ignore[union-attr]
    file = tmp_path / "readings.csv"
    file.write_text(table, encoding="utf-8")
    said = Said(
        latitude=np.radians(47.3),
        gyro_noise=parse("0.003 deg/sqrt(h)", "angle random walk"),
        accel_noise=parse("30 ug/sqrt(Hz)", "velocity random walk"),
    )
    fixes = north.run(file, said).fixes
    assert [f"{a:.2f}" for a in np.degrees(fixes.angles[:, 0])] == [first, second]
    assert [f"{a:.2f}" for a in np.degrees(fixes.sd[:, 0])] == [sd, sd]


REST = {
    "site": '\n[site]\ngravity = "9.81 m/s^2"\n',
    "log": '\n[log]\nfile = "log.csv"\n',
    "procedure": '\n[procedure]\nname = "hand_rotated"\n',
}
MASTER = '\n[master]\nfile = "master.csv"\n'


@pytest.mark.thorough
@pytest.mark.parametrize("script", sorted((ROOT / "examples").glob("*.py")), ids=lambda p: p.name)
def test_examples_run(script: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if "rclpy" in script.read_text(encoding="utf-8"):
        pytest.importorskip("rclpy")  # its parts are tested with the messages of rosbags
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(script), run_name="__main__")


def test_every_procedure_has_an_example_and_the_guide_names_each() -> None:
    campaigns = sorted(p.stem for p in (ROOT / "examples").glob("*.toml"))
    assert campaigns == sorted(PROCEDURES)
    guide = (ROOT / "examples/README.md").read_text(encoding="utf-8")
    for file in [*(ROOT / "examples").glob("*.toml"), *(ROOT / "examples").glob("*.py")]:
        assert f"]({file.name})" in guide, file.name


LONG = ("transfer_alignment", "systematic", "platform_tumble", "imu_pose", "continuous_spin",
        "two_imus", "turntable")  # fmt: skip
"""Examples that take seconds."""


@pytest.mark.parametrize("file", [
    pytest.param(p, id=p.name, marks=pytest.mark.thorough if p.stem in LONG else ())
    for p in sorted((ROOT / "examples").glob("*.toml"))
])  # fmt: skip
def test_example_campaigns_calibrate(file: Path, tmp_path: Path) -> None:
    made = campaign.save_session(campaign.simulate(file), tmp_path)
    result = campaign.calibrate(made)
    assert result.verdict.level == "pass"
    assert "Calibration of" in report.html(result)


@functools.cache
def site() -> dict[str, str]:
    """Return all that Sphinx reads, kept or made: file below docs/ -> text."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(DOCS)
        made = importlib.import_module("generate").PAGES
    kept = {p.relative_to(DOCS).as_posix(): p.read_text("utf-8") for p in DOCS.rglob("*.md")}
    assert not set(made) & set(kept), "a made page lies beside the written ones"
    return kept | {name: make() for name, make in made.items()}


def test_made_pages_hold_every_message_name_command_and_coefficient(program: Any) -> None:
    made = site()
    messages = "".join(text for name, text in made.items() if name.startswith("messages/"))
    assert all(f"\n({code})=\n" in messages and f"(#{code})" in made["messages.md"]
               for code in SYMPTOMS)  # fmt: skip
    assert set(re.findall(r"^   (\w+)$", made["api.md"], re.M)) == set(foucault.__all__)
    assert all(f"\n## {name}\n" in made["commands.md"] for name in program.commands)
    assert all(f"| `{name}` |" in made["coefficients.md"] for name in IMU.names)
    assert all(f"\n## {name}\n" in made["parts.md"] for name in catalogue())
    linked = set(re.findall(r"\]\(#(\w+\.\w+)\)", "".join(made.values())))
    assert linked <= set(SYMPTOMS)


def commands() -> list[Any]:
    out = []
    for page in [*PAGES, CONTRIBUTING]:
        text = page.read_text(encoding="utf-8")
        # Begin and end are matched: the end of a block in another language begins none.
        for kind, block in re.findall(r"^```([^\n]*)\n(.*?)^```$", text, re.S | re.M):
            if kind not in ("sh", "console", "powershell", ""):
                continue
            lines = re.sub(r"^docker .*", "", block.replace("\\\n", " "), flags=re.M).splitlines()
            words = [shlex.split(line, comments=True) for line in lines if "foucault " in line]
            starts = [w[w.index("foucault") + 1 :] for w in words if "foucault" in w]
            out += [pytest.param(w, id=f"{page.relative_to(ROOT)}-{' '.join(w)}") for w in starts]
    return out


def silenced(command: Any) -> Any:
    """Return a command that reads what it is given, as ever, and then does nothing."""
    inner = getattr(command, "commands", {})
    for one in inner.values():
        silenced(one)
    if inner:
        command.callback = lambda *_, **__: None
    else:
        command.invoke = lambda *_: None
    return command


@pytest.fixture(scope="module")
def program() -> Any:
    return silenced(typer.main.get_command(app))


@pytest.mark.parametrize("words", commands())
def test_commands_in_the_docs_are_understood(words: list[str], program: Any) -> None:
    program.main(words, prog_name="foucault", standalone_mode=False)


def test_options_in_the_text_of_the_docs_exist(program: Any) -> None:
    known = program.commands
    for page in PAGES:
        text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.S)
        for words in re.findall(r"`foucault ([a-z][^`]*)`", text):
            name = words.split()[0]
            assert name in known, f"{page.name}: foucault {words}"
            inner = [known[name], *getattr(known[name], "commands", {}).values()]
            options = {o for c in [program, *inner] for p in c.params for o in p.opts} | {"--help"}
            said = set(re.findall(r"(?<=\s)--?[a-z][\w-]*", words))
            assert said <= options, f"{page.name}: foucault {words}"


@pytest.mark.thorough
def test_the_first_page_does_what_it_says(
    tmp_path: Path, session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The log, the campaign and the commands of "Five minutes with your own log", one by one."""
    page = (DOCS / "five_minutes.md").read_text(encoding="utf-8")
    log = load_result_log(session)
    (titles,) = re.findall(r"```csv\n(.*)\n", page)
    rows = np.column_stack(
        [np.rint((log.time - log.time[0]) * 1000), np.degrees(log.gyro), log.accel / 9.80665]
    )
    np.savetxt(tmp_path / "imu.csv", rows, "%.6g", ",", header=titles, comments="")
    (described,) = re.findall(r"```toml\n(.*?)```", page, re.S)
    (tmp_path / "campaign.toml").write_text(described, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    lines = "".join(re.findall(r"```sh\n(.*?)```", page, re.S)).splitlines()
    assert len(lines) == 4
    for line in lines:
        done = CliRunner().invoke(app, shlex.split(line)[1:])
        assert done.exit_code == 0, (line, done.output)
    assert (tmp_path / "run/report.html").exists()
    assert (tmp_path / "calibrated.csv").exists()


def load_result_log(folder: Path) -> Any:
    described = campaign.load(folder / "campaign.toml")
    return read_log(described.log, folder)


@pytest.mark.parametrize("text", blocks("{code-block} toml\n:caption: tolerance.toml"))
def test_tolerances_in_the_docs_load(text: str) -> None:
    assert tolerance.parse(text)


@pytest.mark.parametrize("text", blocks("{code-block} toml\n:caption: results.toml"))
def test_lists_of_results_in_the_docs_load(text: str) -> None:
    assert tomllib.loads(text)["result"]


def test_targets_and_extras_in_the_docs_exist() -> None:
    targets = re.search(r"\.PHONY: (.*)", (ROOT / "Makefile").read_text(encoding="utf-8"))
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert targets is not None
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        assert set(re.findall(r"^ *(?:`|)make (\w+)", text, re.M)) <= set(targets[1].split())
        said = re.findall(r"(?:foucault|\.)\[([a-z,0-9]+)\]['\"]", text)
        for extra in ",".join(said).split(",") if said else []:
            assert extra in extras["project"]["optional-dependencies"], page


def test_every_page_is_in_the_navigation() -> None:
    pages = {name for name in site() if name.endswith(".md")}
    listed = ["index.md"]
    for text in site().values():
        for block in re.findall(r"```\{toctree\}\n(.*?)```", text, re.S):
            entries = [line for line in block.splitlines() if line and not line.startswith(":")]
            listed += [re.sub(r".*<(.*)>", r"\1", entry) + ".md" for entry in entries]
    assert sorted(listed) == sorted([*pages, "gallery/index.md"])  # that one is made by Sphinx


def anchors(text: str) -> set[str]:
    """Return what a link into a page may name: its headings, and labels."""
    text = re.sub(r"```.*?```", "", text, flags=re.S)
    headings = re.findall(r"^#+ (.*)$", text, re.M)
    plain = [re.sub(r"[^\w\- ]", "", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", h)) for h in headings]
    return {h.strip().lower().replace(" ", "-") for h in plain} | set(
        re.findall(r"^(?:\(|:name: )([\w.-]+)(?:\)=)?$", text, re.M))  # fmt: skip


def test_links_between_pages_exist() -> None:
    texts = {DOCS / name: text for name, text in site().items()}
    outside = [page for page in PAGES if page not in texts]
    texts |= {page: page.read_text(encoding="utf-8") for page in [*outside, CONTRIBUTING]}
    named = {page: anchors(text) for page, text in texts.items()}
    labels = {name for names in named.values() for name in names if "." in name}
    for page, text in texts.items():
        for target, anchor in re.findall(r"\]\(([^)#\s]*)(?:#([^)\s]*))?\)", text):
            if "://" in target:
                continue
            there = (page.parent / target).resolve() if target else page
            within = there in texts and page.is_relative_to(DOCS)
            assert within or there.exists(), f"{page.name} links to {target}"
            if anchor and there in named:
                known = named[there] | (set() if target else labels)
                assert anchor in known, f"{page.name} links to {target}#{anchor}"


def test_files_that_pages_include_are_there_and_get_to_the_site(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.syspath_prepend(DOCS)
    generate = importlib.import_module("generate")
    made = {(DOCS / name).resolve() for name in generate.PAGES}
    included = {
        (page.parent / name).resolve()
        for page in DOCS.rglob("*.md")
        for name in re.findall(r"^`+\{(?:literal)?include\} (\S+)", page.read_text(), re.M)
    }
    assert len(included) > 10
    assert all(file.exists() and file.suffix in generate.KEPT for file in included - made)


def test_the_gallery_uses_what_there_is() -> None:
    """Its scripts run when the site is built; what they import is looked for here."""
    scripts = sorted((ROOT / "examples" / "gallery").glob("*/*.py"))
    assert len(scripts) == 24
    for script in scripts:
        for node in ast.walk(ast.parse(script.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and str(node.module).startswith("foucault"):
                module = importlib.import_module(str(node.module))
                for name in node.names:
                    there = hasattr(module, name.name)
                    there = there or importlib.util.find_spec(f"{node.module}.{name.name}")
                    assert there, f"{script.name}: {node.module}.{name.name}"


SECTIONS = [
    "When to use it", "What you need", "How to record", "The campaign", "Read the report",
    "What it cannot see", "Equations", "Source and our corrections", "Accuracy",
]  # fmt: skip


@pytest.mark.parametrize("page", sorted((DOCS / "procedures").glob("*.md")), ids=lambda p: p.name)
def test_pages_of_procedures_have_the_same_sections(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.S)
    assert re.findall(r"^## (.*)", text, re.M) == SECTIONS
    assert re.search(r"## Accuracy\n\n\|", text), "a table first"


@pytest.mark.parametrize("page", sorted((DOCS / "procedures").glob("*.md")), ids=lambda p: p.name)
def test_pages_of_procedures_are_read_to_their_end(page: Path) -> None:
    """At most 1,200 words in sight; what fewer want to know is folded."""
    text = page.read_text(encoding="utf-8")
    assert len(re.findall(r"^::::\{dropdown\} .+$", text, re.M)) == len(
        re.findall("^::::$", text, re.M)
    )
    text = re.sub(r"^::::\{dropdown\}.*?^::::$", "", text, flags=re.S | re.M)
    assert len(re.sub(r"^```.*?^```$", "", text, flags=re.S | re.M).split()) <= 1200


def takes_a_foreign_log(command: Any) -> bool:
    inner = [command, *getattr(command, "commands", {}).values()]
    arguments = {p.name for c in inner for p in c.params if p.param_type_name == "argument"}
    return bool(arguments & {"log", "slave", "readings", "campaign"})


def test_the_guide_names_every_procedure_and_every_command_that_takes_a_log(program: Any) -> None:
    guide = (DOCS / "choose.md").read_text(encoding="utf-8")
    assert {name for name in PROCEDURES if f"`{name}`" not in guide} == set()
    wanted = {name for name, command in program.commands.items() if takes_a_foreign_log(command)}
    assert {"calibrate", "inspect", "north", "delay", "watch"} <= wanted
    assert {name for name in wanted if f"`foucault {name}`" not in guide} == set()


def test_the_features_are_shown_by_commands_and_every_command_shows_one(program: Any) -> None:
    text = (DOCS / "features.md").read_text(encoding="utf-8")
    assert set(program.commands) - set(re.findall(r"`foucault (\w+)", text)) <= {"init"}
    rows = [line.split("|") for line in text.splitlines() if line.startswith("| ")][2:]
    assert all("`" in row[2] for row in rows if not row[1].startswith(" **"))


@pytest.mark.thorough
def test_arrows_between_packages_go_downwards() -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(DOCS)
        packages = importlib.import_module("generators.packages")
    groups = packages.grouped(packages.graph())
    line = {one: i for i, some in enumerate(packages.rows(groups)) for one in some}
    assert all(line[one] < line[other] for one, to in groups.items() for other in to)
    # Those that import one another share a box: no more of them than there are.
    assert {one for one in groups if len(one) > 1} <= {
        ("diagnose", "guard", "plans"), ("estimate", "navigate"),
    }  # fmt: skip


def test_every_validation_page_has_a_row_among_the_verified() -> None:
    said = tomllib.loads((DOCS / "verified.toml").read_text(encoding="utf-8"))
    rows = {row["page"] for rows in said.values() for row in rows}
    assert rows == {page.stem for page in (DOCS / "validation").glob("*.md")}


def test_pages_of_validations_have_the_words_of_their_scripts() -> None:
    """Numbers change with a run; words are changed in validation/pages, and then here too."""
    for words in sorted((ROOT / "validation" / "pages").glob("*.md")):
        parts = re.split(r"(?<!\{)\{\w+(?::[^{}]*)?\}", words.read_text(encoding="utf-8").rstrip())
        parts = [re.escape(part.replace("{{", "{").replace("}}", "}")) for part in parts]
        page = (DOCS / "validation" / words.name).read_text(encoding="utf-8")
        assert re.fullmatch(".*?".join(parts) + r"\s*", page, re.S), words.name
        assert (ROOT / "validation" / f"{words.stem}.py").exists()


def test_the_model_that_contributors_read_is_that_of_the_program():
    text = CONTRIBUTING.read_text(encoding="utf-8")
    listing = re.search(r"```python\n(.*?)```", text, re.S)[1]
    model = (ROOT / "src/foucault/procedures/rate_table/model.py").read_text(encoding="utf-8")
    assert all(part.strip("\n") in model for part in listing.split("    ...\n"))
