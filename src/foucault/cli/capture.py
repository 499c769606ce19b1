"""The command capture: from the sensor's plug to a log."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foucault.cli import options
from foucault.cli.options import command
from foucault.cli.screen import Screen
from foucault.errors import error

if TYPE_CHECKING:
    from foucault.capture.recording import Recording

HEARD, NOTHING = 0, 3  # Exit codes.
OFTEN = 0.25  # What is heard is told so often [s].


@command(
    "foucault capture serial:/dev/ttyUSB0:921600 --frames sbg_imu_short -o session",
    'foucault capture udp:5005 --frames mine.toml -o session --for "10 min"',
    "foucault capture COM3 COM4 --frames sbg_imu_short --frames chamber.toml -o session",
    "foucault capture --again session",
    notes="It ends with Ctrl-C. Then: `foucault inspect session/campaign.toml`.",
    exits={0: "frames were heard", 3: "none was"},
)
def capture(
    screen: Screen,
    sources: Annotated[list[str] | None, typer.Argument(metavar="SOURCE...")] = None,
    output: options.FolderIfWanted = None,
    frames: Annotated[
        list[str] | None,
        typer.Option(
            metavar="<str>", help=options.FRAMES + " One for all sources, or one for each."
        ),
    ] = None,
    serial: Annotated[list[str] | None, typer.Option(metavar="<str>")] = None,
    baud: Annotated[int | None, typer.Option(min=300)] = None,
    for_: options.For = None,
    silence: options.Silence = None,
    again: Annotated[Path | None, typer.Option(metavar="SESSION")] = None,
    known: Annotated[bool, typer.Option("--list")] = False,
) -> None:
    """Record an instrument: from its port to a log."""
    from foucault.capture import frame, recording, several
    from foucault.capture.source import opened

    if known:
        rows = [*frame.shipped().items()]
        screen.table("frames that are known", ("name", "of"), rows, right=(False, False))
        screen.data({"frames": dict(rows)})
        return
    if again is not None:
        said, folder = several.again(again), again
    elif not sources or output is None or not frames:
        raise error("capture.incomplete")
    else:
        if len(frames) not in (1, len(sources)):
            raise error("capture.frames", frames=len(frames), sources=len(sources))
        if twice := next((name for name in sources if sources.count(name) > 1), None):
            raise error("capture.twice", name=twice)
        texts = [(name, frame.text_of(name)) for name in frames] * (len(sources) // len(frames))
        plugs = [
            (name, frame.parsed(text, of), text)
            for name, (of, text) in zip(sources, texts, strict=True)
        ]
        folder, told = output, [0.0]

        def now(heard: Sequence[tuple[Recording, float]]) -> None:
            if monotonic() - told[0] > OFTEN:
                told[0] = monotonic()
                tell(0.0, _now(heard))

        with screen.progress() as tell:
            said = several.record(
                [recording.Plug(opened(name, baud), made, text) for name, made, text in plugs],
                output, serial or (), seconds=for_, silent=silence,
                tell=now,
            )  # fmt: skip
    for k, one in enumerate(said.get("each", [said])):
        head = f"{k + 1}: {said['sources'][k]}: " if "each" in said else ""
        first, *rest = _lines(one)
        for line in (head + first, *rest):
            screen.say(line)
    for line in _together(said):
        screen.say(line)
    command = "fleet" if len(said.get("imus", ())) > 1 else "inspect"
    into = f" -o {folder / 'run'}" if command == "fleet" else ""
    screen.say(f"Next: foucault {command} {folder / recording.CAMPAIGN}{into}")
    screen.data(said)
    counts = said["imus"].values() if "imus" in said else [said["rows"]]
    raise typer.Exit(HEARD if sum(counts) else NOTHING)


def _now(now: Sequence[tuple[Recording, float]]) -> str:
    """Say what is heard of each source, and what is wrong."""
    from foucault.capture.several import twins
    from foucault.capture.trouble import troubles

    words, out = _words(), []
    for k, (one, silence) in enumerate(now):
        heard = one.heard
        line = f"{heard.frames} frames, {heard.broken} broken, {heard.lost} lost"
        wrong = [words.say(key, **values) for key, values in troubles(one, silence)]
        head = f"{k + 1}: " if len(now) > 1 else ""
        out.append(head + "; ".join([line, *wrong]))
    serial = twins([one for one, _ in now])
    out += [] if serial is None else [words.say("trouble.twins", serial=serial)]
    return "; ".join(out)


@cache
def _words() -> Any:
    from foucault.capture.said import Words

    return Words.of()


def _together(said: dict[str, Any]) -> list[str]:
    """Say what was made of several sources."""
    if "imus" not in said:
        return []
    out = [f"{name}: {count} rows on the clock of this computer." for name, count
           in said["imus"].items()]  # fmt: skip
    return out + [f"{name} is left out: {why}" for name, why in said["left_out"].items()]


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
