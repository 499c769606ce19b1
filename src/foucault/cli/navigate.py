"""Commands about one log: `navigate` it, `align` the instrument, find the `delay` of a master."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foucault.cli import options
from foucault.cli.options import Amount, Of, Several, command
from foucault.cli.screen import EXIT_CODES, Screen, kept

if TYPE_CHECKING:
    from foucault.procedures.alignment import Comparison
    from foucault.procedures.delay import FoundDelay


_SITE = ("latitude", "height", "gravity", "gyro_noise", "accel_noise")
_SAID = Of(options.SAID, only=("longitude", *_SITE, "serial"))
_STILL = Of(options.SAID, only=_SITE)
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
    ctx: typer.Context,
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
    reference: Annotated[
        Path | None,
        typer.Option(
            help="File of positions, velocities or angles to compare with; none if left out."
        ),
    ] = None,
) -> None:
    """Navigate with and without a calibration: its worth in metres.

    What every coefficient costs, and whether the error is as large as predicted.
    """
    from foucault.campaign import navigation
    from foucault.campaign.tables import Said
    from foucault.procedures.navigation.start import Settings

    screen: Screen = ctx.obj
    chosen = Settings(velocity=velocity, **settings)
    with screen.work(output, "navigation") as tell:
        test = navigation.run(
            log, Said(**said), chosen, calibration=calibration, reference=reference, progress=tell
        )
        tell(0.95, "writing")
        found = kept(navigation.record(test), output)
    raise found.tell(screen, found.held[0].about)


# -- Commands about one log: `align` an instrument, `delay` of a master --------------------------

_WINDOW = Of(
    "foucault.campaign.navigation:Window",
    only=("start", "end", "gyro_bias_sd", "accel_bias_sd", "gaps"),
    called={"start": "from", "end": "until"},
)
_WORDS = {
    "inertial_frame": "inertial frame",
    "kalman": "Kalman, zero velocity",
    "two_vector": "two vectors",
    "two_position": "two positions",
}


@command(
    'foucault align static.csv --latitude "47.3 deg" --gyro-bias-sd "0.01 deg/h"',
    'foucault align campaign.toml --rest "0 s to 300 s" --rest "360 s to 660 s"',
    notes=options.SITE + " Noise that nobody says is measured in the rest. Without --from, "
    "--until and --rest the first rest that is found is used; without bias sds those of "
    "the calibration, or none.",
    exits={0: "north is seen", 3: "something is doubtful"},
)
def align(
    ctx: typer.Context,
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
    method: Annotated[
        list[str] | None,
        typer.Option(
            metavar="<str>",
            help="inertial_frame, kalman, two_vector or two_position; may be repeated. All "
            "that fit if left out.",
        ),
    ] = None,
) -> None:
    """Find heading, pitch and roll of a log at rest, and their sd.

    By several methods side by side, each with what limits it.
    """
    from foucault.campaign import navigation
    from foucault.campaign.navigation import Window
    from foucault.campaign.tables import Said

    screen: Screen = ctx.obj
    chosen = Window(
        methods=tuple(method or ()), rests=tuple(rest or ()), **window
    )  # fmt: skip
    with screen.progress() as tell:
        found = navigation.align(log, Said(**said), chosen, calibration=calibration, progress=tell)
    angles = ("heading (deg)", "sd", "pitch (deg)", "sd", "roll (deg)", "sd")
    screen.table("", ("method", *angles, "window (s)"), _rows(found))
    screen.say(*_words(found))
    screen.findings(found.findings)
    screen.data(_document(log, found))
    if any(item.severity == "warning" for item in found.findings):
        raise typer.Exit(3)


def _rows(found: Comparison) -> list[tuple[str, ...]]:
    import numpy as np

    from foucault.coefficients import format_value

    rows = []
    for one in found.found:
        both = zip(np.degrees(one.angles), np.degrees(one.angles_sd), strict=True)
        cells = [text for x, sd in both for text in (format_value(x, sd), f"{sd:.2g}")]
        rows.append((_WORDS[one.method], *cells, f"{one.start:.1f} to {one.end:.1f}"))
    return rows


def _words(found: Comparison) -> list[str]:
    import numpy as np

    from foucault.units import convert, plain

    first = found.found[0]
    seen, size = convert(found.rate_seen, "angular rate", "deg/h"), np.degrees(found.latitude_seen)
    lines = [
        f"Rate seen: {seen:.4g} deg/h (the Earth: 15.04). Latitude seen: {size:.4f} deg (given: "
        f"{np.degrees(found.site.latitude or 0.0):.4f})."
    ]
    if found.gyro_bias_sd > 0:
        bias = convert(found.gyro_bias_sd, "angular rate", "deg/h")
        limit = np.degrees(first.azimuth_bias_sd)
        lines.append(
            f"A gyro bias of {plain(bias, 2)} deg/h limits the heading to {plain(limit, 2)} deg in "
            "one position; two positions take it out."
        )
    lines += _undeclared(found)
    if first.disturbance_sd is not None:
        sway = convert(float(np.mean(first.disturbance_sd)), "velocity", "m/s")
        lines.append(f"Sway and vibration: {plain(1000 * sway, 2)} mm/s.")
    return lines


def _undeclared(found: Comparison) -> list[str]:
    """Say what the biases would add that were not declared: the sds hold nothing of them."""
    import numpy as np

    from foucault.models.ins_errors import azimuth_from_gyro_bias
    from foucault.units import parse, plain

    gyro, accel = parse("0.01 deg/h", "angular rate"), parse("50 ug", "specific force")
    azimuth = np.degrees(azimuth_from_gyro_bias(gyro, found.site.latitude or 0.0))
    level = np.degrees(accel / found.site.gravity)
    missing, adds = [], []
    if not found.gyro_bias_sd > 0:
        missing.append("--gyro-bias-sd")
        adds.append(f"0.01 deg/h would add {plain(float(azimuth), 2)} deg of heading")
    if not found.accel_bias_sd > 0:
        missing.append("--accel-bias-sd")
        adds.append(f"50 ug would add {plain(float(level), 2)} deg of pitch and roll")
    if not missing:
        return []
    which = "No bias" if len(missing) == 2 else "No accelerometer bias"
    if missing == ["--gyro-bias-sd"]:
        which = "No gyro bias"
    return [
        f"{which} is declared ({', '.join(missing)}, or a calibration): the sds hold nothing of "
        f"it. {'; '.join(adds)}."
    ]


def _document(path: Path, found: Comparison) -> dict[str, Any]:
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
                **dict(zip(("heading", "pitch", "roll"), one.angles.tolist(), strict=True)),
                **dict(
                    zip(("heading_sd", "pitch_sd", "roll_sd"), one.angles_sd.tolist(), strict=True)
                ),
                "C_nb": one.C_nb.tolist(),
                "phi_cov": one.cov.tolist(),
                "azimuth_bias_sd": one.azimuth_bias_sd,
            }
            for one in found.found
        ],
        "findings": [item.as_dict() for item in found.findings],
    }


# -- The command that finds the time offset of two logs: delay -----------------------------------

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
    ctx: typer.Context,
    slave: options.LogFile,
    master: Annotated[
        Path | None,
        typer.Argument(
            help="What a master said (time, heading, pitch, roll, velocities), a second IMU's log, "
            "or a TOML file with [master] or [log]; left out where the first file describes both."
        ),
    ] = None,
    mounting: Annotated[
        Amount | None,
        _MOUNTING.option(
            "Heading, pitch, roll of the slave in the master's axes, such as \"90 deg, 0 deg, "
            '0 deg", to within 10 deg. The mounting is found without it; with it a wrong sign is '
            "named."
        ),
    ] = None,
    bracket: Annotated[
        str, typer.Option(help='Where the offset lies, such as "-0.2 s to 0.5 s", or any.')
    ] = "-1 s to 1 s",
) -> None:
    """Find the time offset of two logs of one body.

    By what both turned; with its standard deviation, drift of the clocks and mounting.
    """
    from foucault.campaign import delay as campaign

    screen: Screen = ctx.obj
    where = _bracket(bracket)
    with screen.progress() as tell:
        found = campaign.run(slave, master, mounting=mounting, bracket=where, progress=tell)
    _show(screen, found)
    level = found.verdict.level
    screen.verdict(level, found.verdict.reasons)
    screen.data(document(slave, master, found))
    raise typer.Exit(EXIT_CODES[level])


def _bracket(text: str) -> tuple[float, float] | None:
    if text.strip() == "any":
        return None
    low, high = _BRACKET.read("--bracket", text)
    if not low < high:
        raise _BRACKET.refused("--bracket", text)
    return low, high


def _show(screen: Screen, found: FoundDelay) -> None:
    import numpy as np

    from foucault.coefficients import format_value
    from foucault.models.rotation import angles_of, turned
    from foucault.units import convert, plain

    one = found.delay
    about = "" if not one.drift else f" at {one.middle - found.start:.1f} s"
    text = f"{format_value(1e3 * one.delay, 1e3 * one.delay_sd)} ± {1e3 * one.delay_sd:.2g} ms"
    screen.say(f"Delay: {text}{about}; {_share(one.likeness)} of the turning is in both.")
    if one.delay_sd > 0 and not one.seen:
        screen.findings(found.findings)
        return
    if found.start:
        screen.say(f"Times count from {plain(found.start, 13)} s, the start of the first log.")
    rows = [
        (f"{a:.1f} to {b:.1f}", format_value(1e3 * x, 1e3 * sd), f"{1e3 * sd:.2g}")
        for a, b, x, sd in zip(one.part_start - found.start, one.part_end - found.start,
                               one.part_delay, np.sqrt(np.diag(one.part_cov)), strict=True)
    ]  # fmt: skip
    screen.table("", ("part (s)", "delay (ms)", "sd"), rows)
    heading, pitch, roll = np.degrees(turned(angles_of(one.C_ms)))
    sd = np.degrees(np.sqrt(np.diag(one.mu_cov)))
    screen.say(
        f"Mounting of the slave in the axes of the other: heading {heading:.3f}, pitch "
        f"{pitch:.3f}, roll {roll:.3f} deg (about the slave's axes ± {sd[0]:.2g}, {sd[1]:.2g}, "
        f"{sd[2]:.2g} deg)."
    )
    bias = [convert(float(x), "angular rate", "deg/h") for x in one.bias]
    size = [convert(float(x), "angular rate", "deg/h") for x in np.sqrt(np.diag(one.bias_cov))]
    text = ", ".join(f"{format_value(x, s)} ± {s:.2g}" for x, s in zip(bias, size, strict=True))
    screen.say(f"Gyro bias of the slave against the other: {text} deg/h.")
    if found.transport is not None:
        late = 1e3 * np.asarray(found.transport)
        screen.say(f"Messages arrive {late.mean():.2f} ms after they hold, from {late.min():.2f} "
                   f"to {late.max():.2f} ms.")  # fmt: skip
    screen.findings(found.findings)


def _share(part: float) -> str:
    return f"{100 * part:.3g} %"


def document(slave: Path, master: Path | None, found: FoundDelay) -> dict[str, Any]:
    """Return what was found, in SI."""
    import numpy as np

    one = found.delay

    def number(x: float) -> float | None:
        return float(x) if np.isfinite(x) else None

    return {
        "slave": str(slave),
        "master": None if master is None else str(master),
        "messages": found.messages,
        "delay": number(one.delay),
        "delay_sd": number(one.delay_sd),
        "seen": one.seen,
        "time": one.middle,
        "drift": one.drift,
        "drift_sd": number(one.drift_sd),
        "parts": [
            {"start": a, "end": b, "delay": number(x), "delay_sd": number(v**0.5)}
            for a, b, x, v in zip(one.part_start.tolist(), one.part_end.tolist(),
                                  one.part_delay.tolist(), np.diag(one.part_cov).tolist(),
                                  strict=True)
        ],
        "bracket": list(one.bracket),
        "rivals": one.rivals.tolist(),
        "likeness": one.likeness,
        "scale": one.scale,
        "scale_sd": number(one.scale_sd),
        "C_ms": one.C_ms.tolist(),
        "mounting_cov": [[number(x) for x in row] for row in one.mu_cov.tolist()],
        "gyro_bias": one.bias.tolist(),
        "gyro_bias_cov": [[number(x) for x in row] for row in one.bias_cov.tolist()],
        "intervals": int(np.sum(one.match.used)),
        "transport": None if found.transport is None else {
            "mean": float(np.mean(found.transport)), "sd": float(np.std(found.transport)),
            "min": float(np.min(found.transport)), "max": float(np.max(found.transport)),
        },
        "verdict": str(found.verdict.level),
        "reasons": list(found.verdict.reasons),
        "findings": [item.as_dict() for item in found.findings],
    }  # fmt: skip
