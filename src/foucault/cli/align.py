"""The command that aligns a log at rest: align."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foucault.cli import words
from foucault.cli.options import parsed, span
from foucault.cli.screen import Screen

if TYPE_CHECKING:
    from foucault.procedures.alignment import Comparison

_WORDS = {
    "inertial_frame": "inertial frame",
    "kalman": "Kalman, zero velocity",
    "two_vector": "two vectors",
    "two_position": "two positions",
}


def add_to(app: typer.Typer) -> None:
    """Add the command of this module to the program."""
    app.command(
        "align",
        epilog=words.epilog(
            'foucault align static.csv --latitude "47.3 deg" --gyro-bias-sd "0.01 deg/h"',
            'foucault align campaign.toml --rest "0 s to 300 s" --rest "360 s to 660 s"',
            notes=words.SITE + " Noise that nobody says is measured in the rest. Without --from, "
            "--until and --rest the first rest that is found is used; without bias sds those of "
            "the calibration, or none.",
            exits={0: "north is seen", 3: "something is doubtful"},
        ),
    )(align)


def align(
    ctx: typer.Context,
    log: words.LogFile,
    calibration: words.Calibration = None,
    latitude: words.Latitude = None,
    height: words.Height = None,
    gravity: words.Gravity = None,
    start: words.From = None,
    until: words.Until = None,
    rest: Annotated[
        list[str] | None,
        typer.Option(
            metavar="<str>",
            help='A rest, such as "0 s to 300 s"; may be repeated: two rests or more at different '
            "headings take the gyro bias out.",
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
    gyro_bias_sd: Annotated[
        str | None, typer.Option(help='How well the gyro biases are known, such as "0.01 deg/h".')
    ] = None,
    accel_bias_sd: Annotated[
        str | None,
        typer.Option(help='How well the accelerometer biases are known, such as "50 ug".'),
    ] = None,
    gyro_noise: words.GyroNoise = None,
    accel_noise: words.AccelNoise = None,
    gaps: words.Gaps = "stop",
) -> None:
    """Find heading, pitch and roll of a log at rest, and their sd.

    By several methods side by side, each with what limits it.
    """
    from foucault.campaign import alignment
    from foucault.campaign.alignment import Window
    from foucault.campaign.navigation import Said

    screen: Screen = ctx.obj
    site = parsed({"latitude": latitude, "height": height, "gravity": gravity})
    given = parsed({"from": start, "until": until})
    window = Window(
        methods=tuple(method or ()),  # type: ignore[arg-type]  # an unknown one is refused there
        start=given.get("from"),
        end=given.get("until"),
        rests=[span("--rest", text) for text in rest or ()],
        gaps=gaps,
        **parsed({"gyro_bias_sd": gyro_bias_sd, "accel_bias_sd": accel_bias_sd}),
    )
    white = parsed({"gyro_noise": gyro_noise, "accel_noise": accel_noise})
    said = Said(site, gyro_white=white.get("gyro_noise"), accel_white=white.get("accel_noise"))
    with screen.progress() as tell:
        found = alignment.run(log, said, window, calibration=calibration, progress=tell)
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
    options, adds = [], []
    if not found.gyro_bias_sd > 0:
        options.append("--gyro-bias-sd")
        adds.append(f"0.01 deg/h would add {plain(float(azimuth), 2)} deg of heading")
    if not found.accel_bias_sd > 0:
        options.append("--accel-bias-sd")
        adds.append(f"50 ug would add {plain(float(level), 2)} deg of pitch and roll")
    if not options:
        return []
    which = "No bias" if len(options) == 2 else "No accelerometer bias"
    if options == ["--gyro-bias-sd"]:
        which = "No gyro bias"
    return [
        f"{which} is declared ({', '.join(options)}, or a calibration): the sds hold nothing of "
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
