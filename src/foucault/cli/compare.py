"""The command that compares results with one another."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foucault.cli import words
from foucault.cli.screen import Screen

if TYPE_CHECKING:
    from foucault.campaign.comparison import Comparison
    from foucault.campaign.comparison.verdict import Judged

EXIT_CODES = {"pass": 0, "doubtful": 3, "fail": 4}
COLOURS = {"pass": "bold green", "doubtful": "bold yellow", "fail": "bold red"}


def add_to(app: typer.Typer) -> None:
    """Add the command to the program."""
    app.command(
        "compare",
        epilog=words.epilog(
            "foucault compare 2024/run 2025/run 2026/run -o compared --tolerance tolerance.toml",
            "foucault compare results.toml",
            exits={
                0: "not changed, or within tolerance",
                3: "changed, or too near a limit to tell",
                4: "out of tolerance",
            },
        ),
    )(compare)


def compare(
    ctx: typer.Context,
    results: Annotated[
        list[Path],
        typer.Argument(
            help="Run folders or their result.json, or TOML files with [[result]] tables."
        ),
    ],
    output: words.FolderIfWanted = None,
    tolerance: words.Tolerance = None,
    dates: Annotated[
        str, typer.Option(help="When each log was recorded, separated by commas: 2025-03-01,...")
    ] = "",
    same: Annotated[
        bool, typer.Option("--same", help="All are of one instrument, whatever they say.")
    ] = False,
) -> None:
    """Compare results over time, or of several instruments.

    Has an instrument changed, in which coefficient, by drift or step, and is it within tolerance?
    """
    import time

    from foucault.campaign import comparison
    from foucault.campaign import tolerance as tolerances
    from foucault.campaign.comparison import folder as comparison_folder
    from foucault.files import alone, beside
    from foucault.report import compare as page
    from foucault.run_folder import REPORT_FILE

    screen: Screen = ctx.obj
    started = time.monotonic()
    limits = None if tolerance is None else tolerances.load(tolerance)
    found = comparison.run(results, dates=dates, same=same, tolerance=limits)
    about = comparison_folder.document(found, time.monotonic() - started)
    written: dict[str, str] = {}
    if output is not None:
        with alone(output):
            comparison_folder.save(about, output)
            with beside(output):
                file = page.write(about, output / REPORT_FILE)
        written = {"folder": str(output), "report": str(file)}
    _show(screen, found)
    if written:
        screen.say(f"Report: {written['report']}")
    screen.data(written | about)
    raise typer.Exit(EXIT_CODES[found.verdict.level])


def _show(screen: Screen, found: Comparison) -> None:
    for one in found.instruments:
        if one.history is not None:
            title, headings, rows = _changes(one)
            screen.table(title, headings, rows)
    if found.between is not None:
        names = [one.name for one in found.instruments]
        apart = [s.name for s in found.between.spreads if s.told_apart]
        screen.say(f"Instruments, by their latest result: {', '.join(names)}.")
        screen.say(f"They can be told apart by: {', '.join(apart) or 'nothing'}.")
    screen.findings(found.findings)
    level = found.verdict.level
    screen.say("", f"verdict: {level}", style=COLOURS[level])
    screen.say(*(f"  {reason}" for reason in found.verdict.reasons))


def _changes(one: Judged) -> tuple[str, tuple[str, ...], list[tuple[Any, ...]]]:
    """Return the table of changes from the first result to the last."""
    from foucault.campaign.comparison.verdict import said

    past = one.history
    assert past is not None
    last = len(one.entries) - 1
    ends = next(p for p in past.pairs if (p.first, p.second) == (0, last))
    title = f"{one.name}, from {one.entries[0].label} to {one.entries[last].label}"
    rows = []
    for k, course in enumerate(past.courses):
        kind = one.kind(course.name)
        drift = f"{said(course.drift, course.drift_sd, kind)} per year" if last > 1 else ""
        row = (course.name, said(ends.change[k], ends.sd[k], kind), f"{ends.z[k]:+.1f}")
        rows.append((*row, drift, course.how) if past.series.dated and last > 1
                    else (*row, course.how))  # fmt: skip
    drifting = ("drift",) if past.series.dated and last > 1 else ()
    return title, ("coefficient", "change", "in sd", *drifting, "course"), rows
