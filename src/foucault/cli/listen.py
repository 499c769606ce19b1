"""The command listen: what is heard at ports."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foucault.cli import options
from foucault.cli.options import command
from foucault.cli.screen import Screen
from foucault.errors import error

if TYPE_CHECKING:
    from foucault.capture.listen import Fit, Listened

KNOWN, UNKNOWN = 0, 3  # Exit codes.


@command(
    "foucault listen",
    'foucault listen /dev/ttyUSB0 udp:5005 --for "20 s"',
    "foucault listen serial:/dev/ttyUSB0:115200 --frames mine.toml -o session",
    notes="Rest the instrument, and turn it by hand a few times while it is listened to: gravity "
    "and turns tell units and axes. Without --for it listens 5 s; --frames, which may be repeated, "
    "tries a description beside those that are known.",
    exits={0: "all that was heard is known", 3: "something is not"},
)
def listen(
    screen: Screen,
    port: Annotated[list[str] | None, typer.Argument()] = None,
    output: options.FolderIfWanted = None,
    frames: Annotated[list[str] | None, typer.Option(help=options.FRAMES)] = None,
    for_: options.For = None,
    taken: options.Taken = None,
) -> None:
    """Listen at ports: baud rate, frames or text, units and axes."""
    from foucault.campaign.recognised import said_of
    from foucault.capture import listen as ears

    ports = port or ears.ports()
    if not ports:
        raise error("capture.no_port")
    if output is not None and len(ports) > 1:
        raise error("capture.one_port", given=", ".join(ports))
    said, all_known, data = said_of(taken or ()), True, list[dict[str, Any]]()
    for name in ports:
        with screen.progress() as tell:
            found, raw, when = ears.listen(
                name, ears.LONG if for_ is None else for_, frames or (), said,
                partial(tell, 0.0),
            )  # fmt: skip
        best = found.best
        if best is not None and output is not None:
            ears.kept(best, raw, when, output)
        _say(screen, found, output)
        data.append(_data(found))
        all_known &= best is not None
    screen.data({"ports": data})
    raise typer.Exit(KNOWN if all_known else UNKNOWN)


def _say(screen: Screen, found: Listened, output: Path | None) -> None:
    screen.say("", found.name, style="bold")
    if not found.size:
        screen.say("Silence. Is it on, and has it to be told to send?")
        return
    kind = "text" if found.text > 0.9 else "binary"
    pace = f", {found.size / found.seconds:.0f} bytes a second" if found.seconds > 0 else ""
    screen.say(f"{kind}, {found.size} bytes{pace}")
    for fit in found.fits:
        _fit(screen, fit)
    if found.best is None:
        _unknown(screen, found)
        return
    name = found.best.name or "frames.toml"
    if output is not None:
        screen.say(f"Kept in {output}; [log] is in {output / 'campaign.toml'}, the frames in "
                   f"{output / 'frame.toml'}.")  # fmt: skip
        name = found.best.name or str(output / "frame.toml")
    elif not found.best.name:
        screen.say("", "frames.toml, to be kept with -o or by hand:", "", found.best.text)
    screen.say(f"Next: foucault capture {found.name} --frames {name} -o session")


def _fit(screen: Screen, fit: Fit) -> None:
    heard, pace = fit.heard, "" if fit.rate is None else f" at {fit.rate:.4g} Hz"
    counted = {"of other messages": heard.others, "broken": heard.broken, "lost": heard.lost}
    odd = ", ".join(f"{n} {words}" for words, n in counted.items() if n)
    screen.say(f"{fit.name or 'lines'}: {fit.frame.words}",
               f"{heard.frames} of them{pace}" + (f"; {odd}" if odd else "")
               + (f"; {heard.junk} bytes of none" if heard.junk else ""))  # fmt: skip
    if fit.lines:
        rows = [(line.what, line.took, line.why, line.sure) for line in fit.lines]
        screen.table("", ("what", "taken as", "why", "how sure"), rows, [False] * 4)
    screen.say(*(f"note: {note}" for note in fit.notes))
    screen.say(*(f"against it: {doubt}" for doubt in fit.doubts), style="yellow")


def _unknown(screen: Screen, found: Listened) -> None:
    if found.fits:
        screen.say('What fits best cannot be believed as it is: say more with --set, such as '
                   '--set "gyro.unit = deg/s", or listen longer while it is turned.')  # fmt: skip
        return
    screen.say("Nothing that is known.")
    for name, count in found.others.items():
        screen.say(f"{count} whole messages in the frames of {name}, but none of the one that is "
                   "read: have the instrument send it.")  # fmt: skip
    if found.lost:
        screen.say(f"Lines of numbers, but: {found.lost}")
    if found.tried:
        rows = [(str(b), str(n), f"{100 * t:.0f} %") for b, n, t in found.tried]
        screen.table("rates that were tried", ("baud", "bytes", "readable"), rows)
    if found.period is not None:
        pair, period = found.period
        screen.say(f"{pair.hex(' ').upper()} comes again every {period} bytes: frames, perhaps. "
                   "See the manual, and describe them in a file for --frames.")  # fmt: skip
    screen.say(f"The last bytes: {found.sample[-24:].hex(' ').upper()}")


def _data(found: Listened) -> dict[str, Any]:
    fits = [
        {"frames": fit.name or None, "words": fit.frame.words, "rate": fit.rate,
         "counted": vars(fit.heard), "against": list(fit.doubts), "notes": list(fit.notes),
         "recognised": [line.as_dict() for line in fit.lines],
         "description": None if fit.name else fit.text}
        for fit in found.fits
    ]  # fmt: skip
    period = None if found.period is None else [found.period[0].hex(), found.period[1]]
    return {
        "source": found.name, "known": found.best is not None, "bytes": found.size,
        "seconds": found.seconds, "readable": found.text, "fits": fits, "others": found.others,
        "tried": [list(one) for one in found.tried], "repeated": period, "lines": found.lost,
        "last": found.sample[-24:].hex(),
    }  # fmt: skip
