"""Commands that make and use results: calibrate, report, apply, demo."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foucault.cli.screen import COLOURS, EXIT_CODES, Screen

if TYPE_CHECKING:
    from foucault.campaign import Campaign
    from foucault.campaign.running import Session
    from foucault.result import Result
    from foucault.tables import Log


def add_to(app: typer.Typer) -> None:
    """Add the commands of this module to the program."""
    app.command("calibrate", epilog="Example: foucault calibrate campaign.toml -o run")(calibrate)
    app.command("report", epilog="Example: foucault report run")(report)
    app.command(
        "apply",
        epilog="Examples: foucault apply run flight.csv -o flight_calibrated.parquet; "
        "foucault apply run/result.json other_campaign.toml -o out.csv",
    )(apply)
    app.command("demo", epilog="Example: foucault demo -o demo")(demo)


def calibrate(
    ctx: typer.Context,
    campaign: Annotated[Path, typer.Argument(help="The campaign file.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Run folder; a result in it is replaced.")
    ],
) -> None:
    """Calibrate: read the log of a campaign, estimate every coefficient, write the report."""
    from foucault import campaign as campaigns

    screen: Screen = ctx.obj
    result = _run(screen, campaigns.load(campaign), output)
    screen.say("", result.coefficients)
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
    folder: Annotated[Path, typer.Argument(help="A run folder.")],
) -> None:
    """Write the report again from what the run folder holds."""
    from foucault import report as reports

    screen: Screen = ctx.obj
    file = reports.write(folder)
    screen.say(f"Wrote {file}.")
    screen.data({"report": str(file)})


def apply(
    ctx: typer.Context,
    result: Annotated[Path, typer.Argument(help="A run folder or its result.json.")],
    log: Annotated[
        Path,
        typer.Argument(
            help="A log in the format of the calibrated one, a log that foucault has written, "
            "or a campaign file that describes its log."
        ),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Log to write: .csv, .csv.gz, .parquet, .npz.")
    ],
) -> None:
    """Remove the calibrated errors from a log of the same instrument."""
    from foucault import logs
    from foucault.run_folder import load_result

    screen: Screen = ctx.obj
    with screen.progress() as tell:
        calibrated = load_result(result, with_tables=False)
        readings = _read_alike(result, log, tell)
        tell(0.5, "applying")
        corrected = calibrated.apply(readings)
        tell(0.7, "writing")
        logs.write(corrected, output)
    screen.findings(readings.findings)
    screen.say(f"Wrote {len(corrected)} compensated samples in SI units to {output}.")
    if calibrated.verdict.level != "pass":
        screen.say(f"The result applied is {calibrated.verdict.level}.", style="yellow")
    screen.data(
        {
            "output": str(output),
            "samples": len(corrected),
            "verdict": calibrated.verdict.level,
            "findings": [item.as_dict() for item in readings.findings],
        }
    )


def _read_alike(result: Path, log: Path, tell: Any) -> Log:
    """Read a log as its campaign says, or as the log was read that the result came from."""
    from foucault import campaign, logs
    from foucault.logs.description import LogDescription
    from foucault.run_folder import CAMPAIGN_FILE

    if log.suffix == ".toml":
        return campaign.read_log(campaign.load(log), tell)
    description = LogDescription.model_validate({"file": log.name})
    kept = (result if result.is_dir() else result.parent) / CAMPAIGN_FILE
    if kept.is_file() and log.is_file():
        as_before = campaign.load(kept).log
        if len(as_before.files()) == 1:
            description = as_before.model_copy(update={"file": log.name})
    return logs.read(description, log.parent, lambda done: tell(done, "reading the log"))


def demo(
    ctx: typer.Context,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write.")] = Path("demo"),
    seed: Annotated[int, typer.Option(help="Seed of the simulation.", min=0)] = 1,
) -> None:
    """Simulate an instrument, calibrate it, and print the result beside the truth."""
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
                "sd": "" if sd is None else f"{sd:.2g}",
                "unit": row["display_unit"],
                "error_over_sd": "" if not sd else f"{(value - true) / sd:+.2f}",
            }
        )
    return rows
