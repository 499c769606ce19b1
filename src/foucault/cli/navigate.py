"""The command that navigates a log and says what its calibration is worth: navigate."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from foucault.cli import words
from foucault.cli.options import parsed
from foucault.cli.screen import COLOURS, EXIT_CODES, Screen

if TYPE_CHECKING:
    from foucault.campaign.navigation.folder import NavigationRecord

MOST = 8
"""Coefficients that are listed on the screen."""

_EPILOG = words.epilog(
    'foucault navigate log.csv --latitude "47.3 deg" --calibration run --align "300 s"',
    "foucault navigate drive.csv --reference gnss.csv --calibration run -o navigation",
    "foucault navigate campaign.toml --calibration run",
    notes="The log begins with a rest. Without --reference a log that rests all along is compared "
    "with the known site. Titles of a reference: time (s), latitude (deg), longitude (deg), "
    "height (m), velocity east (m/s), velocity north (m/s), velocity up (m/s), heading (deg), "
    "pitch (deg), roll (deg). " + words.SITE,
    exits={
        0: "passed",
        3: "the error is larger than predicted, or could not be judged",
        4: "the start heading is not known",
    },
)


def add_to(app: typer.Typer) -> None:
    """Add the command of this module to the program."""
    app.command("navigate", epilog=_EPILOG)(navigate)


def navigate(
    ctx: typer.Context,
    log: words.LogFile,
    calibration: words.Calibration = None,
    output: words.FolderIfWanted = None,
    align: Annotated[
        str | None,
        typer.Option(
            help='How long it rests at the start, such as "300 s"; the first rest if left out.'
        ),
    ] = None,
    method: Annotated[
        Literal["inertial_frame", "two_vector", "kalman"],
        typer.Option(help="Method that aligns it at the start."),
    ] = "inertial_frame",
    latitude: words.Latitude = None,
    longitude: Annotated[
        str | None, typer.Option(help='Longitude of the site, such as "8.5 deg".')
    ] = None,
    height: words.Height = None,
    gravity: words.Gravity = None,
    heading: Annotated[
        str | None,
        typer.Option(
            help='Heading at the start, such as "90.6 deg", where gyros cannot see it; found in '
            "the rest if left out."
        ),
    ] = None,
    heading_sd: Annotated[
        str | None, typer.Option(help='Standard deviation of --heading, such as "0.1 deg".')
    ] = None,
    pitch: Annotated[
        str | None,
        typer.Option(help='Pitch at the start, such as "1.2 deg"; found in the rest if left out.'),
    ] = None,
    roll: Annotated[
        str | None,
        typer.Option(help='Roll at the start, such as "-0.4 deg"; found in the rest if left out.'),
    ] = None,
    level_sd: Annotated[
        str | None,
        typer.Option(help='Standard deviation of --pitch and --roll, such as "1 arcmin".'),
    ] = None,
    velocity: Annotated[
        str | None,
        typer.Option(
            help='Velocity at a start in motion: east, north, up, such as "12.1 m/s, -3.4 m/s, '
            '0 m/s".'
        ),
    ] = None,
    velocity_sd: Annotated[
        str | None,
        typer.Option(help='Standard deviation of each component, "0.1 m/s" if left out.'),
    ] = None,
    position_sd: Annotated[
        str | None,
        typer.Option(
            help='Standard deviation of --latitude, --longitude and --height, such as "3 m": the '
            "start is there, not where the reference is."
        ),
    ] = None,
    reference: Annotated[
        Path | None,
        typer.Option(
            help="File of positions, velocities or angles to compare with; none if left out."
        ),
    ] = None,
    still: Annotated[
        bool,
        typer.Option("--still", help="The log never left the site, though it may have turned."),
    ] = False,
    vertical: Annotated[
        Literal["free", "held", "aided"] | None,
        typer.Option(help="Vertical channel: free, held at the start, aided by reference heights."),
    ] = None,
    gaps: words.Gaps = "stop",
    from_: words.From = None,
    until: words.Until = None,
    gyro_noise: words.GyroNoise = None,
    accel_noise: words.AccelNoise = None,
    rate: Annotated[
        str | None,
        typer.Option(help='Rate of the written trajectory; "10 Hz" if left out.'),
    ] = None,
    serial: words.Serial = "",
) -> None:
    """Navigate with and without a calibration: its worth in metres.

    What every coefficient costs, and whether the error is as large as predicted.
    """
    from foucault.campaign import navigation
    from foucault.campaign.navigation import Said
    from foucault.procedures.navigation.settings import Settings

    screen: Screen = ctx.obj
    site = parsed({"latitude": latitude, "longitude": longitude, "height": height,
                    "gravity": gravity})  # fmt: skip
    given = parsed({"align": align, "heading": heading, "heading_sd": heading_sd, "pitch": pitch,
                    "roll": roll, "level_sd": level_sd, "velocity_sd": velocity_sd,
                    "position_sd": position_sd, "from": from_, "until": until,
                    "rate": rate})  # fmt: skip
    given |= {new: given.pop(old) for old, new in (("from", "start"), ("until", "end"))
              if old in given}  # fmt: skip
    settings = Settings(method=method, vertical=vertical, gaps=gaps, still=still,
                        velocity=_three(velocity), **given)  # fmt: skip
    white = parsed({"gyro_noise": gyro_noise, "accel_noise": accel_noise})
    said = Said(site, settings, white.get("gyro_noise"), white.get("accel_noise"), serial)
    with screen.progress() as tell:
        found = navigation.run(log, said, calibration=calibration, reference=reference,
                               progress=tell)  # fmt: skip
        tell(0.95, "writing")
        record = _kept(found, output)
    _show(screen, record)
    _conclude(screen, record, output)


def _three(text: str | None) -> tuple[float, float, float] | None:
    """Return a velocity east, north, up [m/s]."""
    from foucault.campaign.mistakes import parse_at
    from foucault.errors import error

    if text is None:
        return None
    parts = [parse_at("--velocity", one.strip(), "velocity") for one in text.split(",")]
    if len(parts) != 3:
        raise error("navigate.three", given=text)
    return parts[0], parts[1], parts[2]


def _kept(found: Any, folder: Path | None) -> NavigationRecord:
    """Write the folder, if one is wanted."""
    from foucault.campaign.navigation import folder as navigation_folder
    from foucault.files import alone, beside
    from foucault.report import navigation as page
    from foucault.run_folder import REPORT_FILE

    if folder is None:
        return navigation_folder.record(found)
    with alone(folder):
        record = navigation_folder.save(found, folder)
        with beside(folder):
            page.write(record, folder / REPORT_FILE)
    return record


def _show(screen: Screen, record: NavigationRecord) -> None:
    from foucault.errors import Finding
    from foucault.report.navigation_detail import METHODS, Seen, minutes

    seen, about = Seen(record), record.about
    start = about["runs"][0]["start"]
    sd = [float(start["covariance"][k][k]) ** 0.5 for k in range(3)]
    alone = "" if seen.calibrated else ", errors of the sensors left out"
    screen.say(
        f"Start: heading {_degrees(start['heading'], sd[2])} ± {_degrees(sd[2])} deg, pitch "
        f"{_degrees(start['pitch'], max(sd[:2]))} and roll {_degrees(start['roll'], max(sd[:2]))} "
        f"± {_degrees(max(sd[:2]))} deg{alone} ({METHODS[start['method']]}); navigated for "
        f"{minutes(about['duration'])}."
    )
    _growth(screen, seen)
    _contributions(screen, seen)
    _terms(screen, about)
    screen.findings(Finding(**f) for f in about["findings"])


def _growth(screen: Screen, seen: Any) -> None:
    """List the error at some ages; columns that are empty are left out."""
    from foucault.report.navigation_detail import half_at, minutes, number

    rows = seen.growth(0)
    if not rows:
        return
    others = {row["age"]: row["horizontal"] for row in seen.growth(1)}
    columns = {
        "after": [minutes(row["age"]) for row in rows],
        "horizontal (m)": [number(row["horizontal"]) for row in rows],
        "without calibration (m)": [number(others.get(row["age"])) for row in rows],
        f"{seen.predicted} (m)": [number(half_at(seen, row["age"])) for row in rows],
        "velocity (m/s)": [number(row["velocity"]) for row in rows],
        "heading (deg)": [
            "" if row["heading"] is None else _degrees(row["heading"]) for row in rows
        ],
    }
    shown = {title: cells for title, cells in columns.items() if any(cells)}
    lines = [[_plain(cell) for cell in row] for row in zip(*shown.values(), strict=True)]
    screen.table("", list(shown), lines)
    screen.say(f"{seen.predicted.capitalize()}: half of all such runs stay within it."
               + ("" if seen.calibrated else " Errors of the sensors are not in it."))  # fmt: skip


def _contributions(screen: Screen, seen: Any) -> None:
    """List the coefficients that were worth most."""
    from foucault.report.navigation_detail import number

    rows = seen.about["contributions"]
    if not rows:
        return

    def line(name: str, east: float, north: float, left: float) -> list[str]:
        return [name, *(_plain(number(x)) for x in (east, north, left))]

    lines = [
        line(r["name"], r["worth"]["east"], r["worth"]["north"], r["left"]["horizontal"])
        for r in rows[:MOST]
    ]
    total = [sum(r["worth"][axis] for r in rows) for axis in ("east", "north")]
    left = seen.about["predicted"]["coefficients"]
    sd = float(left["east_sd"] ** 2 + left["north_sd"] ** 2) ** 0.5
    lines.append(line(f"all {len(rows)}", total[0], total[1], sd))
    titles = ("coefficient", "worth, east (m)", "north (m)", "left, sd (m)")
    screen.table("at the end, by coefficient", titles, lines)
    words = "Worth: the error (estimate minus truth) that it made before it was corrected."
    difference = seen.about["difference"]
    if difference is not None:
        east, north = (_plain(number(x)) for x in difference)
        words += f" The two runs differ by {east} m east, {north} m north."
    screen.say(words)
    if len(rows) > MOST:
        screen.say("The others: see --json or -o.")


def _terms(screen: Screen, about: Mapping[str, Any]) -> None:
    """List the terms of free inertial drift that stand out."""
    from foucault.coefficients import format_value
    from foucault.report.navigation_parts import UNIT
    from foucault.units import convert

    terms = about["runs"][0].get("terms")
    if terms is None:
        return
    lines = []
    for row in terms["rows"]:
        unit = UNIT[row["kind"]]
        value, sd = (convert(row[k], row["kind"], unit) for k in ("value", "sd"))
        alike = row["same_as"] if abs(value) > 2 * sd else ""
        text = f"{format_value(value, sd)} ± {format_value(sd, sd)} {unit}"
        lines.append((row["name"], text, alike))
    screen.table("terms of the error", ("term", "value", "looks like"), lines)


def _degrees(value: float, sd: float | None = None) -> str:
    """Write an angle in degrees, to the digits of its standard deviation where that is given."""
    import math

    from foucault.coefficients import format_value
    from foucault.units import plain

    degrees = math.degrees(value)
    if sd is not None:
        text = format_value(degrees, math.degrees(sd))
        return text.removeprefix("-") if float(text) == 0 else text
    return plain(degrees, 2) if abs(degrees) < 0.01 else f"{degrees:.3f}"


def _plain(text: str) -> str:
    return text.replace("−", "-")


def _conclude(screen: Screen, record: NavigationRecord, folder: Path | None) -> None:
    """Print the verdict and where things are; end with the code of the verdict."""
    from foucault.result import Level
    from foucault.run_folder import REPORT_FILE

    about = record.about
    level = Level(about["verdict"])
    screen.say("", f"verdict: {level}", style=COLOURS[level])
    screen.say(*(f"  {reason}" for reason in about["reasons"]))
    where = {}
    if folder is not None:
        where = {"folder": str(folder), "report": str(folder / REPORT_FILE)}
        screen.say(f"Report: {where['report']}")
    screen.data(where | dict(about))
    raise typer.Exit(EXIT_CODES[level])
