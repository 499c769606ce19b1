"""The command that searches for a better plan: optimise."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from foucault.cli import cluster, words
from foucault.cli.screen import Screen

if TYPE_CHECKING:
    from foucault.campaign.found import Found

INCOMPLETE = 3
"""Exit code where the plan found is of no use or something cannot be seen."""


def add_to(app: typer.Typer) -> None:
    """Add the command of this module to the program."""
    app.command(
        "optimise",
        epilog=words.epilog(
            "foucault optimise campaign.toml -o search",
            'foucault optimise platform_tumble -o search --time-limit "60 s"',
            notes="What may be changed of the plan stands in the table [optimise] of the campaign. "
            "The same command again continues a search; with more --restarts it goes further.",
            exits={
                0: "a better plan was found, or one that the rig can do",
                3: "none was, or something cannot be seen",
            },
        ),
    )(optimise)


def optimise(
    ctx: typer.Context,
    what: words.SearchedOrName,
    output: words.ContinuedFolder,
    restarts: Annotated[int, typer.Option(help="Number of restarts.", min=1, max=1_000_000)] = 32,
    evaluations: Annotated[
        int | None,
        typer.Option(
            help="Plans that each restart judges; left out, 4000, or fewer where each takes long.",
            min=1, max=1_000_000_000,
        ),
    ] = None,
    time_limit: Annotated[
        str | None,
        typer.Option(
            help='Begin no further restart after this time, such as "60 s"; no limit if left out.'
        ),
    ] = None,
    seed: words.Seed = 0,
    size: Annotated[
        int,
        typer.Option(
            "--round", min=2, max=100_000,
            help="Restarts in a round, of which later ones continue the best plans; on a cluster, "
            "a multiple of its workers.",
        ),
    ] = 8,
    workers: cluster.Workers = None,
    scheduler: cluster.Scheduler = None,
    local_cluster: cluster.LocalCluster = None,
) -> None:  # fmt: skip
    """Search for a plan that sees more, within limits of the rig."""
    from foucault import units
    from foucault.campaign import optimisation
    from foucault.cli.sessions import load_or_template
    from foucault.errors import error
    from foucault.files import alone, beside
    from foucault.report import optimisation as report

    screen: Screen = ctx.obj
    limit = None if time_limit is None else units.parse(time_limit, "time", "--time-limit")
    if limit is not None and limit < 0:
        raise error("optimise.time_limit", given=time_limit)
    campaign = load_or_template(what)
    there = optimisation.finished(output)
    with (
        alone(output),
        cluster.spread(screen, workers, scheduler, local_cluster) as map_,
        screen.progress() as tell,
    ):
        found = optimisation.run(
            campaign, output, restarts=restarts, evaluations=evaluations, time_limit=limit,
            seed=seed, size=size, map=map_,
            progress=lambda done, total: tell(done / total, f"restart {done} of {total}"),
        )  # fmt: skip
    with beside(output):
        page = report.write(found, output / "report.html")
    _tell(screen, found)
    if there:
        screen.say(f"Went on from {there} of these restarts, which were in the folder.")
    screen.say(f"Plan: {output / optimisation.CAMPAIGN_FILE}", f"Report: {page}")
    screen.data(found_json(found) | {"folder": str(output), "report": str(page)})
    raise typer.Exit(0 if found.complete else INCOMPLETE)


def _tell(screen: Screen, found: Found) -> None:
    from foucault.units import plain

    screen.table(
        f"{found.cases[0]}: the plan found beside {found.reference}",
        ("coefficient", "before", "found", "unit", "ratio"),
        [
            (name, plain(before, 3), plain(after, 3), unit, f"{ratio:.3f}")
            for name, before, after, unit, ratio in zip(
                found.names, found.reference_sd[0], found.sd[0], found.units, found.ratio[0],
                strict=True,
            )
        ],
    )  # fmt: skip
    screen.table(
        "sd over sd, of what counts",
        ("case", "geometric mean", "worst"),
        [
            (case, f"{mean:.3f}", f"{worst:.3f}")
            for case, mean, worst in zip(
                found.cases, found.geometric_mean, found.worst, strict=True
            )
        ],
    )
    headings, *rows = found.steps
    screen.table("the plan", headings, rows)
    if found.needs:
        screen.table("limits of the rig", ("", "before", "found", "allowed"), _needs(found))
    if found.unseen:
        screen.say(f"No allowed plan shows: {', '.join(found.unseen)}.")
    screen.findings(found.findings)
    screen.say(f"{found.evaluations} plans in {len(found.restarts)} restarts, seed {found.seed}.")


def _needs(found: Found) -> list[tuple[str, ...]]:
    from foucault.diagnose.foresight import Limit

    def needed(limit: Limit) -> str:
        return limit.said_needed + ("" if limit.kept else " BROKEN")

    return [
        (n.name, needed(b), needed(n), n.said_allowed)
        for b, n in zip(found.reference_needs, found.needs, strict=True)
    ]


def found_json(found: Found) -> dict[str, object]:
    """Return what was found as JSON."""
    from dataclasses import asdict

    from foucault.files import plain_json

    document: dict[str, object] = plain_json(asdict(found) | {"complete": found.complete})
    return document
