"""The command for many instruments at once."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foucault.cli import words
from foucault.cli.cluster import Workers
from foucault.cli.screen import Screen

if TYPE_CHECKING:
    from foucault.campaign.fleet.table import FleetTable

DOUBTFUL, UNUSABLE = 3, 4
MOST = 12
"""Instruments that are named on the screen."""


def add_to(app: typer.Typer) -> None:
    """Add the command to the program."""
    app.command(
        "fleet",
        epilog=words.epilog(
            "foucault fleet campaign.toml -o fleet --tolerance tolerance.toml",
            "foucault simulate campaign.toml --instruments 60 -o bench",
            "foucault fleet bench/campaign.toml -o fleet",
            notes="In [log], file is a pattern (logs/*.csv: the name is the serial number) or a "
            "file with a column serial.",
            exits={0: "all passed", 3: "some did not", 4: "none has a usable result"},
        ),
    )(fleet)


def fleet(
    ctx: typer.Context,
    campaign: words.CampaignFile,
    output: words.RunFolder,
    tolerance: words.Tolerance = None,
    reports: Annotated[
        bool, typer.Option("--reports", help="Write a report of each instrument too.")
    ] = False,
    workers: Workers = None,
) -> None:
    """Calibrate many instruments by the same campaign.

    One page for all, a result for each.
    """
    from foucault import campaign as campaigns
    from foucault.campaign import fleet as fleets
    from foucault.campaign import tolerance as tolerances
    from foucault.campaign.fleet import folder as fleet_folder
    from foucault.files import alone, beside
    from foucault.report import fleet as page
    from foucault.report import write
    from foucault.run_folder import REPORT_FILE

    screen: Screen = ctx.obj
    limits = None if tolerance is None else tolerances.load(tolerance)
    with alone(output), screen.progress() as tell:
        table = fleets.run(
            campaigns.load(campaign), output, tolerance=limits,
            report=write if reports else None,
            workers=workers or os.cpu_count() or 1, progress=tell,
        )  # fmt: skip
        tell(0.97, "writing the page")
        about = fleet_folder.about(output)
        with beside(output):
            written = page.write(table, about, output / REPORT_FILE)
    _show(screen, table, about)
    screen.say(f"Report: {written}", f"Table: {output / fleet_folder.TABLE_FILE}")
    screen.data({"folder": str(output), "report": str(written)} | about)
    raise typer.Exit(_code(table))


def _show(screen: Screen, table: FleetTable, about: dict[str, Any]) -> None:
    counts = table.counts()
    screen.table("", ("instruments", f"{len(table)}"), [(w, f"{n}") for w, n in counts.items()])
    batch = about["solved_in_batch"]
    how = f"{batch} solved in one batch" if batch else "calibrated one by one"
    screen.say(f"{int(table.good.sum())} of {len(table)} instruments have a result, {how}.")
    odd = table.outlying()
    if odd:
        screen.table(
            "unlike the fleet",
            ("instrument", "what", "z"),
            [(table.rows[o.index].serial, o.name, f"{o.z:+.1f}") for o in odd[:MOST]],
        )
        _more(screen, len(odd))
    for serial, problem in list(table.problems.items())[:MOST]:
        screen.say(f"{serial}: {problem.message}", style="red")
        screen.say(f"  {problem.cure}")
    _more(screen, len(table.problems))


def _more(screen: Screen, count: int) -> None:
    if count > MOST:
        screen.say(f"  and {count - MOST} more")


def _code(table: FleetTable) -> int:
    outcomes = set(table.outcomes)
    if outcomes <= {"pass"}:
        return 0
    return UNUSABLE if outcomes <= {"unusable", "broken"} else DOUBTFUL
