"""The command that finds north: north READINGS, beside its own plans."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from typer.core import TyperCommand, TyperGroup

from foucault.cli import north_plan, words
from foucault.cli.options import parsed
from foucault.cli.screen import COLOURS, EXIT_CODES, Screen

if TYPE_CHECKING:
    from foucault.campaign.north.folder import NorthRecord
    from foucault.report.north_detail import Setup

MOST = 12
"""Set-ups whose warnings are written out on the screen."""

FIND = "find"
"""Name of the command that stands behind `north READINGS`."""

_EPILOG = words.epilog(
    'foucault north readings.csv --latitude "47.3 deg" --calibration run',
    "foucault north campaign.toml --calibration run -o north",
    "foucault north plan --help",
    notes="Titles of a file given alone: setup, time (s), index (deg), gyro (deg/h), "
    "specific force (g), dwell (s). `north plan` says how long to measure. " + words.SITE,
    exits={0: "all set-ups passed", 3: "some did not", 4: "none is usable"},
)


class _North(TyperGroup):
    """`north READINGS` without a word between, `north plan` beside it."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put in the word that is left out."""
        if not args or args[0] not in self.commands:
            args = [FIND, *args]
        return super().parse_args(ctx, args)


class _Find(TyperCommand):
    """A command that goes by the name of its group."""

    def make_context(self, info_name: Any, args: Any, parent: Any = None, **more: Any) -> Any:
        """Leave the word that was put in out of the usage."""
        return super().make_context(parent.info_name, args, parent.parent, **more)


def add_to(app: typer.Typer) -> None:
    """Add the command to the program."""
    group = typer.Typer(cls=_North, rich_markup_mode=None)
    group.command(FIND, cls=_Find, hidden=True, epilog=_EPILOG)(find)
    group.command("plan", epilog=north_plan.EPILOG)(north_plan.plan)
    app.add_typer(
        group, name="north", help="Find north from readings of a north seeker, or plan it."
    )


def find(
    ctx: typer.Context,
    readings: Annotated[
        Path,
        typer.Argument(
            help="A campaign file, or a CSV or Parquet file whose titles give the units."
        ),
    ],
    calibration: words.Calibration = None,
    output: words.FolderIfWanted = None,
    latitude: words.Latitude = None,
    latitude_sd: words.LatitudeSd = None,
    unknown_latitude: words.UnknownLatitude = False,
    hemisphere: Annotated[
        Literal["north", "south"] | None,
        typer.Option(help="Hemisphere, where the latitude is unknown."),
    ] = None,
    near: Annotated[
        str | None, typer.Option(help='Heading as far as it is known, such as "120 deg".')
    ] = None,
    height: words.Height = None,
    gravity: words.Gravity = None,
    gyro_noise: words.GyroNoise = None,
    accel_noise: words.AccelNoise = None,
    accel_reads: Annotated[
        Literal["gravity", "specific force"] | None,
        typer.Option(help="Sign of the accelerometers: specific force is +1 g upwards."),
    ] = None,
    level_sd: words.SeekerLevelSd = None,
    index_sd: words.IndexSd = None,
    drift: Annotated[
        Literal["auto", "none", "linear"] | None,
        typer.Option(help="Whether to estimate a linear drift of the gyro."),
    ] = None,
    accuracy: words.Accuracy = None,
    serial: words.Serial = "",
) -> None:
    """Find north: heading, pitch and roll of every set-up.

    With their covariance, what limits them, and the latitude if asked for.
    """
    from foucault.campaign import north
    from foucault.campaign.north import Said

    screen: Screen = ctx.obj
    site = parsed({"latitude": latitude, "height": height, "gravity": gravity})
    settings = parsed(
        {"latitude_sd": latitude_sd, "near": near, "level_sd": level_sd, "index_sd": index_sd,
         "accuracy": accuracy}
    )  # fmt: skip
    white = parsed({"gyro_noise": gyro_noise, "accel_noise": accel_noise})
    settings |= {"hemisphere": hemisphere} if hemisphere else {}
    settings |= {"drift": drift} if drift else {}
    settings |= {"unknown_latitude": True} if unknown_latitude else {}
    _refuse_both(unknown_latitude, [latitude and "--latitude", latitude_sd and "--latitude-sd"])
    said = Said(site, settings, white.get("gyro_noise"), white.get("accel_noise"), accel_reads,
                serial)  # fmt: skip
    with screen.progress() as tell:
        survey = north.run(readings, said, calibration=calibration, progress=tell)
        record = _kept(survey, output)
    _show(screen, record)
    _conclude(screen, record, output)


def _refuse_both(unknown: bool, given: list[str | None]) -> None:
    from foucault.errors import error

    named = [option for option in given if option]
    if unknown and named:
        raise error("north.latitude_both", given=named[0])


def _kept(survey: Any, folder: Path | None) -> NorthRecord:
    """Write the folder, if one is wanted."""
    from foucault.campaign.north import folder as north_folder
    from foucault.files import alone, beside
    from foucault.report import north as page
    from foucault.run_folder import REPORT_FILE

    if folder is None:
        return north_folder.record(survey)
    with alone(folder):
        record = north_folder.save(survey, folder)
        with beside(folder):
            page.write(record, folder / REPORT_FILE)
    return record


def _show(screen: Screen, record: NorthRecord) -> None:
    from foucault.report.north_detail import Setup

    setups = [Setup(record, i) for i in range(len(record.about["setups"]))]
    several = isinstance(record.about["known"]["latitude"], list)
    estimated = several or any(s.text_sd("latitude") for s in setups)
    reference = any(s.reference is not None for s in setups)
    headings = ["set-up", "heading (deg)"]
    headings += ["minus reference (deg)"] * reference + ["pitch (deg)", "roll (deg)"]
    headings += ["latitude (deg)"] * estimated + ["verdict"]
    rows = []
    for s in setups:
        row = [s.name, _with_sd(s, "heading")] + [_plain(s.minus_reference)] * reference
        row += [_plain(s.text("pitch")), _plain(s.text("roll"))]
        row += [_with_sd(s, "latitude")] * estimated
        rows.append((*row, s.said["verdict"]))
    screen.table("", headings, rows)
    about = record.about
    screen.say("± is one standard deviation.", f"Noise: {about['noise']['source']}.")
    calibration = about["calibration"]
    if calibration:
        screen.say(f"Calibration: {calibration['verdict']}, of {calibration['created']}.")
    else:
        screen.say("Calibration: none; errors of the instrument count as zero.")
    for s in setups[:1] if len(setups) == 1 else []:
        for line in _of_one(s):
            screen.say(line)
    _warn(screen, record, setups)


def _of_one(setup: Setup) -> list[str]:
    """Say what the uncertainty of one heading is made of."""
    from foucault.report.north_detail import angle_unit, twice

    if not setup.budget:
        return []
    parts = [f"{name} {angle_unit(abs(sd)).words(abs(sd))}" for name, sd in setup.budget.items()
             if setup.share(name) > 0.005]  # fmt: skip
    bound = setup.degrees("heading", "bound")
    words = f"Heading sd by source: {', '.join(parts)}."
    if bound > 0:
        words += f" The noise alone would allow {angle_unit(bound).words(bound)}."
    return [words, twice(setup).replace("`", "")]


def _with_sd(setup: Setup, angle: str) -> str:
    sd = setup.text_sd(angle)
    return _plain(setup.text(angle)) + (f" ± {sd}" if sd else "")


def _plain(text: str) -> str:
    return text.replace("−", "-")


def _warn(screen: Screen, record: NorthRecord, setups: list[Setup]) -> None:
    """Write what was noticed, of the file and of the set-ups, each with its cure."""
    from foucault.errors import Finding
    from foucault.report.north_detail import common, grouped

    own = [f for s in setups for f in s.said["findings"]]
    screen.findings(Finding(**f) for f in grouped([*record.about["findings"], *own]))
    shared = common(setups)
    if shared:
        screen.say(f"None passes: {' '.join(shared)}")
    left = {s.name: [r for r in s.said["reasons"] if r not in shared] for s in setups}
    bad = [s for s in setups if s.said["verdict"] != "pass" and left[s.name]]
    for s in bad[:MOST]:
        screen.say(f"{s.name} is {s.said['verdict']}: {' '.join(left[s.name])}")
    if len(bad) > MOST:
        screen.say(f"and {len(bad) - MOST} set-ups more, see --json or -o")


def _conclude(screen: Screen, record: NorthRecord, folder: Path | None) -> None:
    """Print the verdict and where things are; end with the code of the verdict."""
    from foucault.result import Level
    from foucault.run_folder import REPORT_FILE

    levels = [Level(s["verdict"]) for s in record.about["setups"]]
    passed = sum(level is Level.PASS for level in levels)
    level = levels[0] if len(set(levels)) == 1 else Level.DOUBTFUL
    words = f"{passed} of {len(levels)} set-ups passed" if len(levels) > 1 else str(level)
    screen.say("", f"verdict: {words}", style=COLOURS[level])
    where = {}
    if folder is not None:
        where = {"folder": str(folder), "report": str(folder / REPORT_FILE)}
        screen.say(f"Report: {where['report']}")
    screen.data(where | dict(record.about))
    raise typer.Exit(EXIT_CODES[level])
