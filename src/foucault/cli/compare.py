"""Several instruments: `compare` results, `fleet` from one bench."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Annotated

import typer

from foucault.cli import options
from foucault.cli.cluster import Workers
from foucault.cli.options import command
from foucault.cli.screen import Screen, kept, written


@command(
    "foucault compare 2024/run 2025/run 2026/run -o compared --tolerance tolerance.toml",
    "foucault compare results.toml",
    exits={
        0: "not changed, or within tolerance",
        3: "changed, or too near a limit to tell",
        4: "out of tolerance",
    },
)
def compare(
    screen: Screen,
    results: list[Path],
    output: options.FolderIfWanted = None,
    tolerance: options.Tolerance = None,
    dates: str = "",
    same: Annotated[bool, typer.Option("--same")] = False,
) -> None:
    """Compare results over time, or of several instruments.

    Has an instrument changed, in which coefficient, by drift or step, and is it within tolerance?
    """
    from foucault.campaign import comparison
    from foucault.campaign import tolerance as tolerances

    started = time.monotonic()
    limits = None if tolerance is None else tolerances.load(tolerance)
    with screen.work(output, "comparison"):
        compared = comparison.run(results, dates=dates, same=same, tolerance=limits)
        record = comparison.record(compared, time.monotonic() - started)
        found = kept(record, output)
    raise found.tell(screen, record.about)


# -- The command for many instruments at once ----------------------------------------------------

MOST = 12  # Broken instruments that are named on the screen, with what to do.


@command(
    "foucault fleet campaign.toml -o fleet --tolerance tolerance.toml",
    "foucault simulate campaign.toml --instruments 60 -o bench",
    "foucault fleet bench/campaign.toml -o fleet",
    notes="In [log], file is a pattern (logs/*.csv: the name is the serial number) or a "
    "file with a column serial.",
    exits={0: "all passed", 3: "some did not", 4: "none has a usable result"},
)
def fleet(
    screen: Screen,
    campaign: options.CampaignFile,
    output: options.RunFolder,
    tolerance: options.Tolerance = None,
    reports: Annotated[bool, typer.Option("--reports")] = False,
    table_only: Annotated[bool, typer.Option("--table-only")] = False,
    workers: Workers = None,
) -> None:
    """Calibrate many instruments by the same campaign.

    One page for all, a result for each.
    """
    from foucault import campaign as campaigns
    from foucault import run_folder
    from foucault.campaign import fleet as fleets
    from foucault.campaign import tolerance as tolerances
    from foucault.report import write

    limits = None if tolerance is None else tolerances.load(tolerance)
    with screen.work(output, "fleet") as tell:
        table = fleets.run(
            campaigns.load(campaign), output, tolerance=limits,
            report=write if reports else None, table_only=table_only,
            workers=workers or os.cpu_count() or 1, progress=tell,
        )  # fmt: skip
        tell(0.97, "writing the page")
        about = run_folder.about_of(output, "fleet")
        found = written(output, "fleet", table, about)
    batch = about["solved_in_batch"]
    how = f"{batch} solved in one batch" if batch else "calibrated one by one"
    outcomes = set(table.outcomes)
    broken = [f"{k}: {p.message}\n  {p.cure}" for k, p in table.problems.items()]
    rest = [f"  and {len(broken) - MOST} more"] * (len(broken) > MOST)
    raise found.tell(
        screen, about, *broken[:MOST], *rest,
        f"{int(table.good.sum())} of {len(table)} instruments have a result, {how}.",
        f"Table: {output / fleets.TABLE_FILE}",
        code=0 if outcomes <= {"pass"} else 4 if outcomes <= {"unusable", "broken"} else 3,
    )  # fmt: skip
