"""The command that finds the time offset of two logs: delay."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foucault.cli import words
from foucault.cli.screen import COLOURS, EXIT_CODES, Screen

if TYPE_CHECKING:
    from foucault.procedures.delay import FoundDelay

_EPILOG = words.epilog(
    "foucault delay imu.csv navigation.csv",
    "foucault delay campaign.toml",
    "foucault delay imu.csv other_imu.csv --bracket any",
    'foucault delay imu.csv navigation.csv --mounting "90 deg, 0 deg, 0 deg"',
    notes="What the master stamps t was true at t - delay by the clock of the slave: messages that "
    "come late have a positive delay. Titles of a master: time (s), heading (deg), pitch (deg), "
    "roll (deg), velocity east (m/s), velocity north (m/s), velocity up (m/s).",
    exits={0: "passed", 3: "something is doubtful", 4: "no offset is seen"},
)


def add_to(app: typer.Typer) -> None:
    """Add the command of this module to the program."""
    app.command("delay", epilog=_EPILOG)(delay)


def delay(
    ctx: typer.Context,
    slave: words.LogFile,
    master: Annotated[
        Path | None,
        typer.Argument(
            help="What a master said (time, heading, pitch, roll, velocities), a second IMU's log, "
            "or a TOML file with [master] or [log]; left out where the first file describes both."
        ),
    ] = None,
    mounting: Annotated[
        str | None,
        typer.Option(
            help="Heading, pitch, roll of the slave in the master's axes, such as \"90 deg, 0 deg, "
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
    where, turned = _bracket(bracket), _mounting(mounting)
    with screen.progress() as tell:
        found = campaign.run(slave, master, mounting=turned, bracket=where, progress=tell)
    _show(screen, found)
    level = found.verdict.level
    screen.say("", f"verdict: {level}", style=COLOURS[level])
    screen.say(*(f"  {reason}" for reason in found.verdict.reasons))
    screen.data(document(slave, master, found))
    raise typer.Exit(EXIT_CODES[level])


def _bracket(text: str) -> tuple[float, float] | None:
    from foucault.errors import error
    from foucault.units import parse

    if text.strip() == "any":
        return None
    ends = text.split(" to ")
    if len(ends) != 2:
        raise error("delay.bracket", given=text)
    low, high = (parse(one.strip(), "time", "--bracket") for one in ends)
    if not low < high:
        raise error("delay.bracket", given=text)
    return low, high


def _mounting(text: str | None) -> tuple[float, float, float] | None:
    from foucault.errors import error
    from foucault.units import parse

    if text is None:
        return None
    angles = [parse(one.strip(), "angle", "--mounting") for one in text.split(",")]
    if len(angles) != 3:
        raise error("delay.mounting_given", given=text)
    return angles[0], angles[1], angles[2]


def _show(screen: Screen, found: FoundDelay) -> None:
    import numpy as np

    from foucault.coefficients import format_value
    from foucault.models.attitude import angles_of
    from foucault.models.rotation import turned
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
