"""The command capture: from the sensor's plug to a log."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foucault.cli import options
from foucault.cli.options import Amount, command, quantity
from foucault.cli.screen import Screen

if TYPE_CHECKING:
    from foucault.capture.recording import Recording

HEARD, NOTHING = 0, 3
"""Exit codes."""


@command(
    "foucault capture serial:/dev/ttyUSB0:921600 --frames sbg_imu_short -o session",
    'foucault capture udp:5005 --frames mine.toml -o session --for "10 min"',
    "foucault capture --again session",
    notes="It ends with Ctrl-C. Then: `foucault inspect session/campaign.toml`.",
    exits={0: "frames were heard", 3: "none was"},
)
def capture(
    ctx: typer.Context,
    source: Annotated[
        str | None,
        typer.Argument(
            help="One of serial:PORT[:BAUD], udp:PORT, tcp:HOST:PORT, - or a growing file."
        ),
    ] = None,
    output: options.FolderIfWanted = None,
    frames: Annotated[str | None, typer.Option(help=options.FRAMES)] = None,
    baud: Annotated[int | None, typer.Option(help="Of a serial port.", min=300)] = None,
    for_: Annotated[
        Amount | None, quantity("time", 'How long, such as "10 min".', "--for", least="above 0")
    ] = None,
    silence: Annotated[
        Amount | None,
        quantity("time", options.SILENCE, least="above 0"),
    ] = None,
    again: Annotated[
        Path | None,
        typer.Option(help="Make the log of a session once more from its bytes.", metavar="SESSION"),
    ] = None,
    known: Annotated[bool, typer.Option("--list", help="List the frames that are known.")] = False,
) -> None:
    """Record an instrument: from its port to a log."""
    from foucault.capture import frame, recording
    from foucault.capture.source import opened
    from foucault.errors import error

    screen: Screen = ctx.obj
    if known:
        rows = [*frame.shipped().items()]
        screen.table("frames that are known", ("name", "of"), rows)
        screen.data({"frames": dict(rows)})
        return
    if again is not None:
        said, folder = recording.again(again), again
    elif source is None or output is None or frames is None:
        raise error("capture.incomplete")
    else:
        text, folder = frame.text_of(frames), output
        described = frame.parsed(text, frames)
        with screen.progress() as tell:
            said = recording.record(
                opened(source, baud), described, text, output,
                seconds=for_, silent=silence, tell=lambda *now: tell(0.0, _now(*now)),
            )  # fmt: skip
    for line in _lines(said):
        screen.say(line)
    screen.say(f"Next: foucault inspect {folder / recording.CAMPAIGN}")
    screen.data(said)
    raise typer.Exit(HEARD if said["rows"] else NOTHING)


def _now(recording: Recording, silence: float) -> str:
    """Say what is heard; `silence`: since something came [s]."""
    from foucault.capture.said import Words
    from foucault.capture.trouble import troubles

    heard = recording.heard
    line = f"{heard.frames} frames, {heard.broken} broken, {heard.lost} lost"
    wrong = [Words.of().say(key, **values) for key, values in troubles(recording, silence)]
    return "; ".join([line, *wrong])


def _lines(said: dict[str, Any]) -> list[str]:
    out = [f"{said['rows']} rows" + (f" at {said['rate']:.1f} Hz." if "rate" in said else ".")]
    counted = {
        "lost": "frames lost by their counter", "broken": "with a wrong checksum",
        "junk": "bytes of no frame", "others": "frames of other messages",
        "reopened": "times that the source was lost and opened again",
    }  # fmt: skip
    odd = [f"{said[key]} {words}" for key, words in counted.items() if said[key]]
    out += ["Besides: " + ", ".join(odd) + "."] if odd else []
    if (clock := said.get("clock")) is not None:
        rate, sd = 1e6 * clock["rate"], 1e6 * clock["rate_sd"]
        out.append(
            f"Its clock runs {rate:+.1f} +- {sd:.1f} ppm fast by this computer's; "
            f"95 % of the rows came within {1e3 * clock['jitter']:.1f} ms."
        )
    return out
