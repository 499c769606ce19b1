"""Commands about one log: `navigate` it, `align` the instrument, find the `delay` of a master."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foucault.cli import options
from foucault.cli.options import Amount, Of, Several, command
from foucault.cli.screen import Screen, kept

if TYPE_CHECKING:
    from foucault.models.norths import North
    from foucault.navigate.align import Alignment
    from foucault.procedures.alignment import Comparison
    from foucault.procedures.delay import FoundDelay


_SITE = ("latitude", "height", "gravity", "gyro_noise", "accel_noise")
_SAID = Of(options.SAID, only=("longitude", *_SITE, "serial"))
_STILL = Of(options.SAID, only=("longitude", *_SITE, "date", "grid"))
_VELOCITY = Several("velocity", "east, north and up", "12.1 m/s, -3.4 m/s, 0 m/s")
_SETTINGS = Of(
    "foucault.procedures.navigation.start:Settings",
    only=("align", "method", "heading", "heading_sd", "pitch", "roll", "level_sd", "velocity_sd",
          "position_sd", "still", "vertical", "gaps", "start", "end", "rate"),
    called={"start": "from", "end": "until"},
)  # fmt: skip


@command(
    'foucault navigate log.csv --latitude "47.3 deg" --calibration run --align "300 s"',
    "foucault navigate drive.csv --reference gnss.csv --calibration run -o navigation",
    "foucault navigate campaign.toml --calibration run",
    notes="The log begins with a rest. Without --reference a log that rests all along is compared "
    "with the known site. Titles of a reference: time (s), latitude (deg), longitude (deg), "
    "height (m), velocity east (m/s), velocity north (m/s), velocity up (m/s), heading (deg), "
    "pitch (deg), roll (deg). " + options.SITE,
    exits={
        0: "passed",
        3: "the error is larger than predicted, or could not be judged",
        4: "the start heading is not known",
    },
)
def navigate(
    screen: Screen,
    log: options.LogFile,
    calibration: options.Calibration = None,
    output: options.FolderIfWanted = None,
    said: Annotated[Any, _SAID] = None,
    settings: Annotated[Any, _SETTINGS] = None,
    velocity: Annotated[
        Amount | None,
        _VELOCITY.option(
            'Velocity at a start in motion: east, north, up, such as "12.1 m/s, -3.4 m/s, 0 m/s".'
        ),
    ] = None,
    reference: Path | None = None,
    taken: options.Taken = None,
) -> None:
    """Navigate with and without a calibration: its worth in metres.

    What every coefficient costs, and whether the error is as large as predicted.
    """
    from foucault.campaign import navigation
    from foucault.campaign.tables import Said
    from foucault.procedures.navigation.start import Settings

    chosen = Settings(velocity=velocity, **settings)
    with screen.work(output, "navigation") as tell:
        test = navigation.run(
            log, Said(**said, log=options.known([log], taken)), chosen, calibration=calibration,
            reference=reference, progress=tell,
        )  # fmt: skip
        tell(0.95, "writing")
        found = kept(navigation.record(test), output)
    raise found.tell(screen, found.held[0].about)


# -- Commands about one log: `align` an instrument, `delay` of a master --------------------------

_WINDOW = Of(
    "foucault.campaign.navigation:Window",
    only=("start", "end", "gyro_bias_sd", "accel_bias_sd", "gaps"),
    called={"start": "from", "end": "until"},
)


@command(
    'foucault align static.csv --latitude "47.3 deg" --gyro-bias-sd "0.01 deg/h"',
    'foucault align campaign.toml --rest "0 s to 300 s" --rest "360 s to 660 s"',
    notes=options.SITE + " Noise that nobody says is measured in the rest. Without --from, "
    "--until and --rest the first rest that is found is used; without bias sds those of "
    "the calibration, or none.",
    exits={0: "north is seen", 3: "something is doubtful"},
)
def align(
    screen: Screen,
    log: options.LogFile,
    calibration: options.Calibration = None,
    said: Annotated[Any, _STILL] = None,
    window: Annotated[Any, _WINDOW] = None,
    rest: Annotated[
        list[Amount] | None,
        options.REST.option(
            'A rest, such as "0 s to 300 s"; may be repeated: two rests or more at different '
            "headings take the gyro bias out."
        ),
    ] = None,
    method: Annotated[list[str] | None, typer.Option(metavar="<str>")] = None,
    taken: options.Taken = None,
) -> None:
    """Find heading, pitch and roll of a log at rest.

    By several methods side by side, each with what limits it.
    """
    from foucault.campaign import navigation
    from foucault.campaign.navigation import Window
    from foucault.campaign.tables import Said
    from foucault.models.norths import norths
    from foucault.report import alignment as report

    chosen = Window(
        methods=tuple(method or ()), rests=tuple(rest or ()), **window
    )  # fmt: skip
    told = Said(**said, log=options.known([log], taken))
    with screen.progress() as tell:
        found = navigation.align(log, told, chosen, calibration=calibration, progress=tell)
    asked = norths(found.site)
    raise screen.tell(report.document(found, log.name, asked), _document(log, found, asked))


def _document(path: Path, found: Comparison, asked: Sequence[North]) -> dict[str, Any]:
    """What `align` found, in SI."""
    return {
        "log": str(path),
        "site": found.site.as_dict(),
        "gyro_bias_sd": found.gyro_bias_sd,
        "accel_bias_sd": found.accel_bias_sd,
        "rate_seen": found.rate_seen,
        "latitude_seen": found.latitude_seen,
        "alignments": [
            {
                "method": one.method,
                "start": one.start,
                "end": one.end,
                **dict(zip(("heading", "pitch", "roll"), one.angles, strict=True)),
                **dict(zip(("heading_sd", "pitch_sd", "roll_sd"), one.angles_sd, strict=True)),
                "C_nb": one.C_nb,
                "phi_cov": one.cov,
                "azimuth_bias_sd": one.azimuth_bias_sd,
                **_headings(one, asked),
            }
            for one in found.found
        ],
        "findings": [item.as_dict() for item in found.findings],
    }


# -- The command that finds the time offset of two logs: delay -----------------------------------


def _headings(one: Alignment, asked: Sequence[North]) -> dict[str, Any]:
    """Return heading and sd from each north, where another than true north is asked for [rad]."""
    heading, sd = float(one.angles[0]), float(one.angles_sd[0])
    return {"headings": {n.name: n.heading(heading, sd) for n in asked}} if asked[1:] else {}


_MOUNTING = Several("angle", "heading, pitch and roll", "90 deg, 0 deg, 0 deg")
_BRACKET = Several("time", "between which offsets to look, or any", "-0.5 s to 0.5 s")


@command(
    "foucault delay imu.csv navigation.csv",
    "foucault delay campaign.toml",
    "foucault delay imu.csv other_imu.csv --bracket any",
    'foucault delay imu.csv navigation.csv --mounting "90 deg, 0 deg, 0 deg"',
    notes="What the master stamps t was true at t - delay by the clock of the slave: messages that "
    "come late have a positive delay. Titles of a master: time (s), heading (deg), pitch (deg), "
    "roll (deg), velocity east (m/s), velocity north (m/s), velocity up (m/s).",
    exits={0: "passed", 3: "something is doubtful", 4: "no offset is seen"},
)
def delay(
    screen: Screen,
    slave: options.LogFile,
    master: Annotated[Path | None, typer.Argument()] = None,
    mounting: Annotated[
        Amount | None,
        _MOUNTING.option(
            "Heading, pitch, roll of the slave in the master's axes, such as \"90 deg, 0 deg, "
            '0 deg", to within 10 deg. The mounting is found without it; with it a wrong sign is '
            "named."
        ),
    ] = None,
    bracket: str = "-1 s to 1 s",
    taken: options.Taken = None,
) -> None:
    """Find the time offset of two logs of one body.

    By what both turned; with its standard deviation, drift of the clocks and mounting.
    """
    from foucault.campaign import delay as campaign
    from foucault.campaign.tables import Said
    from foucault.report import alignment as report

    where = _bracket(bracket)
    with screen.progress() as tell:
        found = campaign.run(
            slave, master, said=Said(log=options.known([slave], taken)), mounting=mounting,
            bracket=where, progress=tell,
        )  # fmt: skip
    raise screen.tell(report.offset(found), document(slave, master, found))


def _bracket(text: str) -> tuple[float, float] | None:
    if text.strip() == "any":
        return None
    low, high = _BRACKET.read("--bracket", text)
    if not low < high:
        raise _BRACKET.refused("--bracket", text)
    return low, high


def document(slave: Path, master: Path | None, found: FoundDelay) -> dict[str, Any]:
    """Return what was found, in SI."""
    one, transport = found.delay, found.transport
    parts = zip(
        one.part_start, one.part_end, one.part_delay, one.part_cov.diagonal() ** 0.5, strict=True
    )
    return {
        "slave": str(slave),
        "master": None if master is None else str(master),
        "messages": found.messages,
        "delay": one.delay,
        "delay_sd": one.delay_sd,
        "seen": one.seen,
        "time": one.middle,
        "drift": one.drift,
        "drift_sd": one.drift_sd,
        "parts": [
            {"start": a, "end": b, "delay": x, "delay_sd": sd} for a, b, x, sd in parts
        ],
        "bracket": one.bracket,
        "rivals": one.rivals,
        "likeness": one.likeness,
        "scale": one.scale,
        "scale_sd": one.scale_sd,
        "C_ms": one.C_ms,
        "mounting_cov": one.mu_cov,
        "gyro_bias": one.bias,
        "gyro_bias_cov": one.bias_cov,
        "intervals": one.match.used.sum(),
        "transport": None if transport is None else {
            "mean": transport.mean(), "sd": transport.std(),
            "min": transport.min(), "max": transport.max(),
        },
        "verdict": str(found.verdict.level),
        "reasons": found.verdict.reasons,
        "findings": [item.as_dict() for item in found.findings],
    }  # fmt: skip
