"""Commands that make results: calibrate, report, demo."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foucault.cli import words
from foucault.cli.screen import COLOURS, EXIT_CODES, Screen

if TYPE_CHECKING:
    from foucault.campaign import Campaign
    from foucault.campaign.running import Session
    from foucault.result import Result


def add_to(app: typer.Typer) -> None:
    """Add the commands of this module to the program."""
    app.command(
        "calibrate",
        epilog=words.epilog("foucault calibrate campaign.toml -o run", exits=words.VERDICT),
    )(calibrate)
    app.command("report", epilog=words.epilog("foucault report run"))(report)
    app.command(
        "demo", epilog=words.epilog("foucault demo", "foucault demo -o demo", exits=words.VERDICT)
    )(demo)


def calibrate(
    ctx: typer.Context,
    campaign: words.CampaignFile,
    output: words.RunFolder,
) -> None:
    """Calibrate an instrument from its log, and write the report."""
    from foucault import campaign as campaigns
    from foucault.diagnose.time_base import in_words

    screen: Screen = ctx.obj
    result = _run(screen, campaigns.load(campaign), output)
    screen.say("", result.coefficients)
    if said := in_words(result):
        screen.say(said)
    _conclude(screen, result, output)


def _run(screen: Screen, campaign: Campaign, folder: Path) -> Result:
    """Calibrate and write the run folder; what was there stays until the new result is whole."""
    from foucault import campaign as campaigns
    from foucault import report, run_folder

    with screen.progress() as tell:
        result = campaigns.calibrate(campaign, tell)
        tell(0.9, "writing the report")
        # Asked to write beside the campaign, leave that file as its author wrote it.
        kept = folder / run_folder.CAMPAIGN_FILE
        own = kept.exists() and kept.samefile(campaign.path)
        text = campaign.text if own else campaigns.resolved(campaign, folder)
        run_folder.save(result, folder, text)
        report.write(folder)
    return result


def _conclude(screen: Screen, result: Result, folder: Path, **more: Any) -> None:
    """Print findings, the verdict and where things are; end with the code of the verdict."""
    import json

    from foucault.run_folder import REPORT_FILE, RESULT_FILE

    level = result.verdict.level
    screen.findings(result.findings)
    screen.say("", f"verdict: {level}", style=COLOURS[level])
    screen.say(*(f"  {reason}" for reason in result.verdict.reasons))
    screen.say(f"Report: {folder / REPORT_FILE}")
    if screen.json:
        document = json.loads((folder / RESULT_FILE).read_text(encoding="utf-8"))
        screen.data(
            {"folder": str(folder), "report": str(folder / REPORT_FILE), **more, "result": document}
        )
    raise typer.Exit(EXIT_CODES[level])


def report(
    ctx: typer.Context,
    folder: Annotated[
        Path,
        typer.Argument(
            help="A run folder, or one of `fleet`, `north`, `navigate`, `optimise`, `compare` or "
            "`montecarlo`."
        ),
    ],
) -> None:
    """Write the report again from what the folder holds."""
    from foucault import report as reports
    from foucault.campaign import found, optimisation, study
    from foucault.campaign.comparison import folder as comparison_folder
    from foucault.campaign.fleet import folder as fleet_folder
    from foucault.campaign.navigation import folder as navigation_folder
    from foucault.campaign.north import folder as north_folder
    from foucault.report import compare, fleet, navigation, north
    from foucault.report import optimisation as search
    from foucault.report import study as study_page
    from foucault.run_folder import REPORT_FILE

    screen: Screen = ctx.obj
    if (folder / north_folder.NORTH_FILE).is_file():
        file = north.write(north_folder.load(folder), folder / REPORT_FILE)
    elif (folder / navigation_folder.NAVIGATION_FILE).is_file():
        file = navigation.write(navigation_folder.load(folder), folder / REPORT_FILE)
    elif (folder / optimisation.ASKED_FILE).is_file():
        file = search.write(found.load(folder), folder / REPORT_FILE)
    elif (folder / comparison_folder.COMPARE_FILE).is_file():
        file = compare.write(comparison_folder.load(folder), folder / REPORT_FILE)
    elif (folder / fleet_folder.FLEET_FILE).is_file():
        file = fleet.write(*fleet_folder.load(folder), folder / REPORT_FILE)
    elif (folder / study.STUDY_FILE).is_file():
        file = study_page.write(*study.load(folder), folder / REPORT_FILE)
    else:
        file = reports.write(folder)
    screen.say(f"Wrote {file}.")
    screen.data({"report": str(file)})


def demo(
    ctx: typer.Context,
    output: words.Folder = Path("demo"),
    seed: words.Seed = 1,
) -> None:
    """Simulate an instrument, calibrate it, compare with the truth."""
    from foucault import campaign as campaigns

    screen: Screen = ctx.obj
    with screen.progress() as tell:
        tell(0.1, "simulating")
        described = campaigns.parse(campaigns.template("hand_rotated"))
        session = campaigns.simulate(described, seed)
        file = campaigns.save_session(session, output / "session")
    result = _run(screen, campaigns.load(file), output / "run")
    rows = _beside_truth(session, result)
    screen.table(
        "the result beside the truth",
        ("coefficient", "truth", "estimate", "error", "sd", "unit", "error/sd"),
        [tuple(row.values()) for row in rows],
    )
    screen.say(f"Simulated log, campaign and truth: {file.parent}")
    _conclude(screen, result, output / "run", truth=rows)


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
