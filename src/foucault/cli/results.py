"""Commands that make results, and about campaign files: calibrate, merge, temperature, init, ..."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foucault.cli import options
from foucault.cli.options import Amount, command, quantity
from foucault.cli.screen import Found, Screen, found_in, kept, written
from foucault.errors import error
from foucault.files import write_text
from foucault.symptoms import SYMPTOMS, markdown

if TYPE_CHECKING:
    from foucault.campaign import Campaign
    from foucault.campaign.recognised import Found as Bare
    from foucault.campaign.running import Session
    from foucault.procedures.temperature import Ramp
    from foucault.procedures.temperature import Session as AtTemperature
    from foucault.result import Result
    from foucault.tables import Log


@command(
    "foucault calibrate campaign.toml -o run",
    'foucault calibrate session.csv -o run --latitude "48.85 deg"',
    "foucault calibrate accel.csv gyro.csv -o run",
    "foucault calibrate --live serial:/dev/ttyUSB0:921600 --frames sbg_imu_short -o run",
    exits=options.VERDICT,
)
def calibrate(
    screen: Screen,
    output: options.RunFolder,
    place: options.Place,
    campaign: options.CampaignOrLogs = None,
    taken: options.Taken = None,
    terms: options.TermsChosen = None,
    live: Annotated[str | None, typer.Option(metavar="SOURCE")] = None,
    frames: Annotated[str | None, typer.Option(help=options.FRAMES)] = None,
    hold: Annotated[Amount | None, quantity("time", "", least="greater than 0")] = None,
    want: Annotated[list[str] | None, typer.Option(metavar="<str>")] = None,
    words: str | None = None,
    silence: options.Silence = None,
) -> None:
    """Calibrate an instrument from its log, and write the report.

    Given a log without a campaign, it says what each column was taken for and writes the campaign.
    Given the log of a vehicle with several IMUs, it calibrates each, compares them and says how
    they are mounted.
    """
    from foucault.kernels import ahead

    if campaign and live is None and not options.bare(campaign):
        ahead.begin(campaign[0])
    from foucault import campaign as campaigns
    from foucault.diagnose.references import in_words

    more: dict[str, Any] = {} if terms is None else {"terms": terms}
    if live is not None:
        from foucault.cli import guide

        if len(campaign or ()) > 1:
            raise error("guide.campaigns", given=", ".join(map(str, campaign or ())))
        base = campaign[0] if campaign else None
        recorded = guide.guided(screen, base, live, output, frames, hold, want, words, silence)
        if recorded is None:
            raise error("guide.nothing", source=live)
        campaign = [recorded.path]
    guiding = {"frames": frames, "hold": hold, "want": want, "words": words, "silence": silence}
    if live is None and (lone := [f"--{name}" for name, given in guiding.items() if given]):
        raise error("guide.alone", options=", ".join(lone))
    if not campaign:
        raise error("guide.no_log")
    if not options.bare(campaign):
        options.refuse_beside(place, taken)
        asked = campaigns.said_otherwise(campaigns.load(campaign[0]), more)
        result, page = _run(screen, asked, output)
        raise page.tell(screen, _saved(output), *filter(None, [in_words(result)]))
    from foucault.campaign import recognised as bare  # a campaign needs none of it
    from foucault.campaign import vehicle

    given = bare.said_of(taken or ())
    if topics := vehicle.several(campaign, given):
        raise _vehicle(screen, campaign[0], topics, output, given, bare.site_of(place), more)
    held = recognised(screen, campaign, place, taken)
    asked = campaigns.said_otherwise(held.campaign, more)
    result, page = _run(screen, asked, output, held.head, held.log_of(asked))
    told = [f"Campaign, to run again or to change: {output / 'campaign.toml'}"]
    said = [line.as_dict() for line in held.lines]
    raise page.tell(screen, _saved(output, recognised=said), *filter(None, [in_words(result)]),
                    *told)  # fmt: skip


def _vehicle(
    screen: Screen, file: Path, topics: Sequence[str], output: Path, said: dict[str, Any],
    site: dict[str, str], more: dict[str, str],
) -> typer.Exit:  # fmt: skip
    """Calibrate every IMU of a vehicle, and return how the program ends."""
    from foucault.campaign import vehicle
    from foucault.report import write

    with screen.work(output, "comparison") as tell:
        found = vehicle.run(file, topics, output, said, site, write, tell, more)
        record = found.record
        page = None if record is None else kept(record, output)
    broken = [f"{topic}: {p.message}\n  {p.cure}" for topic, p in found.problems.items()]
    runs = {topic: str(output / vehicle.folder_of(topic)) for topic in found.results}
    verdicts = {topic: str(result.verdict.level) for topic, result in found.results.items()}
    worst = (
        4
        if broken
        else max(code for code, level in options.VERDICT.items() if level in verdicts.values())
    )
    data = {"runs": runs, "verdicts": verdicts,
            "problems": {topic: str(p) for topic, p in found.problems.items()}}  # fmt: skip
    told = (*broken, *(f"{topic}, {verdicts[topic]}: {where}" for topic, where in runs.items()))
    if page is None or record is None:
        screen.say(*told)
        screen.data(data)
        return typer.Exit(worst)
    return page.tell(screen, data | dict(record.about), *told, code=worst)


def recognised(
    screen: Screen, files: Sequence[Path], place: dict[str, Any], taken: Sequence[str] | None
) -> Bare:
    """Tell what a bare log holds, and say it."""
    from foucault.campaign import recognised as bare

    with screen.progress() as tell:
        held = bare.found(files, bare.said_of(taken or ()), bare.site_of(place), tell)
    say_taken(screen, held)
    return held


def say_taken(screen: Screen, held: Bare) -> None:
    """Print what a bare log was taken for, why, and how sure."""
    names = [path.name for path in held.recognised.files]
    screen.say(f"{', '.join(names)} {'was' if len(names) == 1 else 'were'} taken for:")
    width = max((len(line.what) for line in held.lines), default=0)
    for line in held.lines:
        screen.say(f"  {line.what:<{width}}  {line.took}  ({line.sure}: {line.why})")


def _run(
    screen: Screen, campaign: Campaign, folder: Path, head: str = "", log: Log | None = None
) -> tuple[Result, Found]:
    """Calibrate and write the run folder; what was there stays until the new result is whole.

    `head`: remarks that its campaign begins with; `log`: its log, where that is read already.
    """
    from foucault import campaign as campaigns
    from foucault import run_folder

    with screen.work(folder) as tell:
        run_folder.keep_a_campaign(folder, campaign.text)
        result = campaigns.calibrate(campaign, tell, log)
        tell(0.9, "writing the report")
        # Asked to write beside the campaign, leave that file as its author wrote it.
        kept = folder / run_folder.CAMPAIGN_FILE
        there = kept.exists() and Path(campaign.path).exists()
        own = there and kept.samefile(campaign.path)
        text = campaign.text if own else campaigns.resolved(campaign, folder, head)
        run_folder.save(result, folder, text)
        screen.log = str(result.provenance.get("input", {}).get("sha256", ""))
        return result, written(folder, "result")


def _saved(folder: Path, **more: Any) -> dict[str, Any]:
    """Return what result.json in a folder holds."""
    from foucault.run_folder import RESULT_FILE

    return {**more, "result": json.loads((folder / RESULT_FILE).read_text(encoding="utf-8"))}


@command("foucault report run")
def report(
    screen: Screen,
    folder: Path,
) -> None:
    """Write the report again from what the folder holds."""
    try:
        found = found_in(folder)
        file = found.page()
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as problem:
        # What lies there has the keys of a result, but not what its procedure writes.
        reason = f"{type(problem).__name__} {problem}"
        raise error("result.no_page", folder=folder, reason=reason) from problem
    screen.say(f"Wrote {file}.")
    screen.data({"report": str(file)} | found.document.as_dict())


@command("foucault demo", "foucault demo -o demo", exits=options.VERDICT)
def demo(
    screen: Screen,
    output: options.Folder = Path("demo"),
    seed: options.Seed = 1,
) -> None:
    """Simulate an instrument, calibrate it, compare with the truth.

    It holds what the calibration does not estimate too, each term drawn at its typical size.
    """
    from foucault import campaign as campaigns

    with screen.progress() as tell:
        tell(0.1, "simulating")
        described = campaigns.parse(campaigns.template("hand_rotated", grade="consumer MEMS"))
        session = campaigns.simulate(described, seed)
        file = campaigns.save_session(session, output / "session")
    result, page = _run(screen, campaigns.load(file), output / "run")
    rows = _beside_truth(session, result)
    screen.table(
        "the result beside the truth",
        ("coefficient", "truth", "estimate", "error", "sd", "unit", "error/sd"),
        [tuple(row.values()) for row in rows],
    )
    where = f"Simulated log, campaign and truth: {file.parent}"
    raise page.tell(screen, _saved(output / "run", truth=rows), where)


def _beside_truth(session: Session, result: Result) -> list[dict[str, Any]]:
    from foucault.coefficients import format_value
    from foucault.units import convert

    rows = []
    for row in result.coefficients.rows():
        true = convert(session.truth.value(row["name"]), row["kind"], row["display_unit"])
        value, sd = row["display_value"], row["display_sd"]
        rows.append(
            {
                "coefficient": row["name"],
                "truth": format_value(true, sd),
                "estimate": format_value(value, sd),
                "error": format_value(value - true, sd),
                "sd": "" if sd is None else format_value(sd, sd),
                "unit": row["display_unit"],
                "error_over_sd": "" if not sd else f"{(value - true) / sd:+.2f}",
            }
        )
    return rows


@command("foucault merge monday tuesday -o merged", exits=options.VERDICT)
def merge(
    screen: Screen,
    results: options.ResultFiles,
    output: options.RunFolder,
) -> None:
    """Merge results of one instrument from different logs into one.

    Weighted by their whole covariance; whether they agree is checked.
    """
    from foucault import run_folder
    from foucault.campaign import earlier

    with screen.work(output):
        result = earlier.merge(results)
        run_folder.save(result, output)
        page = written(output, "result")
    said = {
        "verdict": result.verdict.level,
        "checks": [{"name": c.name, "value": None if c.value != c.value else c.value,
                    "passed": c.passed} for c in result.checks],
        "coefficients": result.coefficients.rows(),
    }  # fmt: skip
    raise page.tell(screen, said, *(f"  {check.sentence}" for check in result.checks))


# -- Commands about campaign files and what the program knows: init, schema, messages ------------


@command(
    "foucault init hand_rotated -o campaign.toml",
    "foucault init hand_rotated --part ICM-20948 -o campaign.toml",
    'foucault init ferraris --grade "tactical MEMS" -o campaign.toml',
    "foucault init --log session.csv -o campaign.toml",
)
def init(
    screen: Screen,
    place: options.Place,
    procedure: Annotated[str | None, typer.Argument()] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output")] = None,
    part: str | None = None,
    grade: str | None = None,
    log: list[Path] | None = None,
    taken: options.Taken = None,
) -> None:
    """Write a campaign file to start from, or the campaign of a log."""
    from foucault import campaign

    if (procedure is None) == (log is None) or (log and (part or grade)):
        raise error("recognise.init")
    if output is not None and output.exists():
        raise error("output.exists", path=output)
    run = f"foucault calibrate {output} -o run"
    if procedure is not None:
        options.refuse_beside(place, taken)
        asks = part is None and grade is None and output is not None and not screen.json
        if asks and sys.stdin.isatty() and sys.stdout.isatty():
            part, grade = _asked()
        text, next_ = campaign.template(procedure, part, grade), f"Fill it in, then run: {run}"
    else:
        told = screen if output is not None else Screen(quiet=True)  # its campaign says it too
        held = recognised(told, log or (), place, taken)
        text, next_ = held.beside(output), f"Look through it, then run: {run}"
        if held.session.procedure is None:
            todo = held.session.todo.format(file=held.recognised.files[0].name)
            next_ = f"The log calibrates nothing yet. {todo}"
    if output is None:
        print(text, end="")
        return
    write_text(output, text)
    screen.say(f"Wrote {output}. {next_}")
    screen.data({"campaign": str(output)})


def _asked() -> tuple[str | None, str | None]:
    """Ask once what the instrument is: a part whose data sheet is known, or its class."""
    from foucault.models import left_out, parts

    classes = left_out.table().grades
    question = f"Part (see `foucault parts`) or class ({', '.join(classes)}); Enter: by its noise"
    given = typer.prompt(question, default="", show_default=False).strip()
    if not given:
        return None, None
    return (None, given) if given in classes else (parts.part(given).name, None)


@command("foucault schema > campaign.schema.json", "foucault schema --result > result.schema.json")
def schema(
    result: Annotated[bool, typer.Option("--result")] = False,
) -> None:
    """Print the JSON schema of campaign files, or of result.json."""
    from foucault import campaign, result_document

    print(json.dumps(result_document.result_schema() if result else campaign.schema(), indent=1))


@command("foucault messages > messages.md")
def messages(screen: Screen) -> None:
    """Print every error and warning with its cure, as Markdown."""
    if screen.json:
        screen.data([asdict(row) for row in SYMPTOMS.values()])
    else:
        print(markdown())


# -- The command for coefficients that change with temperature -----------------------------------


@command(
    "foucault temperature cold room hot -o model",
    'foucault temperature cold room hot -o model --at "cold=-20 degC"',
    'foucault temperature cold room hot -o model --scatter "gyro.bias=5 deg/h"',
    "foucault temperature room --ramp warming.toml -o model",
    "foucault apply model log.csv -o compensated.csv",
    exits=options.VERDICT,
)
def temperature(
    screen: Screen,
    results: options.ResultFiles,
    output: options.RunFolder,
    at: Annotated[list[str] | None, typer.Option(metavar="<str>")] = None,
    order: Annotated[list[str] | None, typer.Option(metavar="<str>")] = None,
    knots: str | None = None,
    scatter: Annotated[list[str] | None, typer.Option(metavar="<str>")] = None,
    ramp: list[Path] | None = None,
    reference: Annotated[Amount | None, quantity("temperature", "")] = None,
    margin: Annotated[Amount, quantity("temperature difference", "", least="0 or more")] = "0 K",
    in_order: Annotated[bool, typer.Option("--in-order")] = False,
) -> None:
    """Fit coefficients as functions of temperature.

    To calibrations at several temperatures, to a slow ramp, or to both.
    """
    from foucault import run_folder
    from foucault.procedures import temperature as procedure

    settings = procedure.Settings(
        orders=_orders(order or []),
        knots=_knots(knots),
        scatter=_scatters(scatter or []),
        visited=in_order,
        reference=reference,
        margin=margin,
    )
    with screen.work(output) as tell:
        tell(0.0, "reading the results")
        sessions = _sessions(results, at or [])
        ramps = [_ramp(path, tell) for path in ramp or []]
        tell(0.5, "fitting")
        result = procedure.calibrate(sessions, settings, ramps)
        tell(0.8, "writing the report")
        run_folder.save(result, output)
        raise written(output, "result").tell(screen, _saved(output))


def _sessions(results: Sequence[Path], at: Sequence[str]) -> list[AtTemperature]:
    """Read the results with their temperatures."""
    from foucault.campaign.tables import parse_at
    from foucault.procedures.temperature import Session
    from foucault.run_folder import load_result

    names = [str(path) for path in results]
    declared: dict[str, float] = {}
    for text in at:
        name, equals, value = text.rpartition("=")
        # A name as it was given, or the last part of a path.
        found = [n for n in names if name.strip() in (n, Path(n).name)]
        if not equals or len(found) != 1:
            raise error("temperature.at", given=text, allowed=", ".join(names))
        if found[0] in declared:
            raise error("temperature.at_twice", name=found[0])
        declared[found[0]] = parse_at("--at", value.strip(), "temperature")
    return [
        Session.of(name, load_result(path, with_tables=False), declared.get(name))
        for name, path in zip(names, results, strict=True)
    ]


def _ramp(path: Path, tell: Any) -> Ramp:
    from foucault.campaign.running import read_any
    from foucault.procedures.temperature import Ramp

    log, _ = read_any(path, lambda done, words: tell(0.4 * done, words), whole=True)
    return Ramp.of(str(path), log)


def _orders(given: Sequence[str]) -> dict[str, int]:
    out = {}
    for text in given:
        family, _, power = text.rpartition("=")
        if power.strip() not in tuple("0123456789"):
            example = "--order 2, or --order gyro.bias=2, with a power from 0 to 9"
            raise error("temperature.assignment", option="--order", given=text, example=example)
        out[family.strip()] = int(power)
    return out


def _knots(given: str | None) -> tuple[float, ...]:
    from foucault.campaign.tables import parse_at

    if given is None:
        return ()
    return tuple(parse_at("--knots", part.strip(), "temperature") for part in given.split(","))


def _scatters(given: Sequence[str]) -> dict[str, float]:
    from foucault.campaign.tables import parse_at
    from foucault.models.layouts import EVERY

    out = {}
    for text in given:
        family, equals, value = (part.strip() for part in text.partition("="))
        if text.strip() == "none":
            out[""] = 0.0
            continue
        if not equals:
            raise error("temperature.assignment", option="--scatter", given=text,
                        example='--scatter "gyro.bias=5 deg/h", or --scatter none')  # fmt: skip
        kind = EVERY.coefficients[int(EVERY.group(family)[0])].kind
        out[family] = abs(parse_at("--scatter", value, kind))
    return out
