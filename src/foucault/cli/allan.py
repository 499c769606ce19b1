"""The command about noise: allan."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foucault.cli import words
from foucault.cli.options import span
from foucault.cli.screen import Screen
from foucault.cli.sessions import from_start, read_any

if TYPE_CHECKING:
    from foucault.diagnose.allan.log import LogAllan

REPORT_FILE, NOISE_FILE, TABLE_FILE = "report.html", "noise.toml", "allan.csv"


def add_to(app: typer.Typer) -> None:
    """Add the command of this module to the program."""
    app.command(
        "allan",
        epilog=words.epilog(
            "foucault allan static.csv -o noise",
            'foucault allan campaign.toml --axis gyro.z --rest "0 s to 50 s"',
            "foucault allan static.parquet --axis gyro --kind hadamard",
        ),
    )(allan)


def allan(
    ctx: typer.Context,
    log: words.LogFile,
    axis: Annotated[
        list[str] | None,
        typer.Option(
            metavar="<str>",
            help="Axis, such as gyro.x, gyro or x; may be repeated. All if left out.",
        ),
    ] = None,
    kind: Annotated[
        str, typer.Option(help="Deviation: overlapping, modified or hadamard.")
    ] = "overlapping",
    rest: Annotated[
        str | None,
        typer.Option(
            help='Part at rest, such as "0 s to 50 s". The whole log if left out, or the longest '
            "rest of one that moves."
        ),
    ] = None,
    output: words.FolderIfWanted = None,
) -> None:
    """Find the noise of an instrument at rest.

    Random walks, bias instability and ramp by Allan deviations, with a [noise] table to use.
    """
    from foucault.diagnose.allan.log import measure_log

    screen: Screen = ctx.obj
    still = None if rest is None else span("--rest", rest)
    with screen.progress() as tell:
        table, _ = from_start(read_any(log, tell))
        tell(0.7, "computing variances")
        seen = measure_log(table, axes=tuple(axis or ()), kind=_kind(kind), rest=still)
        if output is not None:
            tell(0.9, "writing")
            _write(seen, str(table.source.get("file", log.name)), output)
    screen.say(f"At rest, {seen.start:.2f} s to {seen.end:.2f} s.")
    screen.table("", ("axis", "noise", "value", "sd", "95 % interval"), _rows(seen))
    screen.findings((*table.findings, *seen.findings))
    if output is not None:
        screen.say(f"Plot: {output / REPORT_FILE}")
    screen.data(_document(log, seen, [f.as_dict() for f in (*table.findings, *seen.findings)]))


def _kind(given: str) -> Any:
    from foucault.diagnose.allan.deviation import check_kind

    return check_kind(given)


def _rows(seen: LogAllan) -> list[tuple[str, ...]]:
    from foucault.diagnose.allan.deviation import WORDS
    from foucault.diagnose.allan.log import described

    rows: list[tuple[str, ...]] = []
    for name, channel in seen.channels.items():
        triad = name.split(".")[0]
        for i, noise in enumerate(channel.noises):
            words = described(noise, triad, channel.longest)
            rows.append((name if i == 0 else "", WORDS[triad][i], *words))
    return rows


def _write(seen: LogAllan, name: str, folder: Path) -> None:
    """Write the plot, the table of deviations and, where there is one, the noise block."""
    from foucault.diagnose.allan.log import deviation_table, noise_block
    from foucault.errors import FoucaultError
    from foucault.escape import commented
    from foucault.files import atomic, unwritable
    from foucault.report import allan as report

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise unwritable(folder, problem) from None
    try:
        block = noise_block(seen)
    except FoucaultError as nothing_seen:
        block = commented([nothing_seen], "#") + "\n"
    texts = {NOISE_FILE: block, TABLE_FILE: deviation_table(seen)}
    for file, text in texts.items():
        with atomic(folder / file) as temporary:
            temporary.write_text(text, encoding="utf-8")
    report.write(seen, name, block, folder / REPORT_FILE)


def _document(path: Path, seen: LogAllan, findings: list[dict[str, str]]) -> dict[str, Any]:
    """What `allan` found, in SI."""
    import math

    def finite(value: float) -> float | None:
        return value if math.isfinite(value) else None

    channels = {
        name: {
            "kind": channel.kind,
            "samples": channel.samples,
            "interval": channel.interval,
            "longest_useful_tau": channel.longest,
            "excess": channel.excess,
            **{
                key: getattr(channel, key).tolist()
                for key in ("tau", "deviation", "low", "high", "dof", "curve")
            },
            "noises": {
                noise.name: {
                    "value": noise.value,
                    "sd": finite(noise.sd),
                    "seen": noise.seen,
                    "low": noise.low,
                    "high": finite(noise.high),
                }
                for noise in channel.noises
            },
        }
        for name, channel in seen.channels.items()
    }
    return {
        "log": str(path),
        "start": seen.start,
        "end": seen.end,
        "channels": channels,
        "findings": findings,
    }
