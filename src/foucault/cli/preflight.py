"""The command that says beforehand what a planned session will show: preflight."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated

import typer

from foucault.cli import words
from foucault.cli.screen import Screen

if TYPE_CHECKING:
    from foucault.diagnose.foresight import Foresight

SHOWN = 4
"""Combinations and pairs that are printed; all of them are in the JSON."""

INCOMPLETE = 3
"""Exit code where something is hardly seen, that of a doubtful result."""


def add_to(app: typer.Typer) -> None:
    """Add the command of this module to the program."""
    app.command(
        "preflight",
        epilog=words.epilog(
            "foucault preflight campaign.toml -o expected.csv",
            'foucault preflight platform_tumble --plan "-x -z -y +z" --rate "0.2 deg/s"',
            'foucault preflight norm_observation --plan "dodecahedron 20"',
            notes="What is not tried is as in the campaign file, sampling and noise too.",
            exits={0: "all is seen", 3: "something is hardly seen, or a limit is broken"},
        ),
    )(preflight)


def preflight(
    ctx: typer.Context,
    what: words.CampaignOrName,
    plan: Annotated[
        str | None,
        typer.Option(
            help='Try this plan, such as "-x -z -y +z", "dodecahedron 20" or, where a vehicle '
            'moves, "ship", instead of that of the file, where the procedure has plans.'
        ),
    ] = None,
    rate: Annotated[str | None, typer.Option(help='Try this rate, such as "0.2 deg/s".')] = None,
    segment: Annotated[
        str | None,
        typer.Option(help='Try this time for each segment of the plan, such as "900 s".'),
    ] = None,
    output: words.TableIfWanted = None,
) -> None:
    """Say before a session what it will show, and how well.

    Standard deviation of every coefficient, what cannot be told apart, whether the rig can do it.
    """
    from foucault.campaign import preflight as preflights
    from foucault.cli.sessions import load_or_template

    screen: Screen = ctx.obj
    given = {"plan": plan, "rate": rate, "segment": segment}
    with screen.progress() as tell:
        campaign = load_or_template(what)
        tell(0.2, "simulating the plan")
        changes = {key: text for key, text in given.items() if text is not None}
        found = preflights.foresee(campaign, changes)
    if output is not None:
        preflights.write(found, output)
    screen.table(
        "",
        ("coefficient", "sd", "unit", "of the prior"),
        [(r["name"], *_cells(r["display_sd"], r["display_unit"], r["of_prior"]))
         for r in found.rows()],
    )  # fmt: skip
    if found.legs:
        screen.table(
            "the plan",
            ("leg", "until (s)", "rate about x, y, z (deg/s)", "rank", "seen alone"),
            _legs(found),
        )
    if found.limits:
        screen.table("limits of the rig", ("", "needed", "allowed", ""), _limits(found))
    if found.more:
        screen.table(
            "what more would buy",
            ("", "longer (s)", "sd, of that without", "largest gain"),
            _extras(found),
        )
    screen.say(*_summary(found))
    screen.findings((*campaign.findings, *found.findings))
    if output is not None:
        screen.say(f"Table: {output}")
    screen.data(
        {"procedure": campaign.procedure}
        | found.as_dict()
        | {"file": None if output is None else str(output)}
    )
    raise typer.Exit(0 if found.complete else INCOMPLETE)


def _cells(sd: float | None, unit: str, share: float | None) -> tuple[str, str, str]:
    from foucault.units import plain

    return (
        "" if sd is None else plain(sd, 2),
        unit,
        "" if share is None else plain(share, 2),
    )


def _legs(found: Foresight) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for k, leg in enumerate(found.legs, 1):
        rate = ", ".join(f"{math.degrees(w):z.4f}" for w in leg.rate)
        rows.append((str(k), f"{leg.end:.0f}", rate, str(leg.rank), str(leg.alone)))
    return rows


def _limits(found: Foresight) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for limit in found.limits:
        state = "" if limit.kept else "BROKEN"
        rows.append((limit.name, limit.said_needed, limit.said_allowed, state))
    return rows


def _extras(found: Foresight) -> list[tuple[str, ...]]:
    return [
        (
            more.what,
            f"{more.time:.0f}",
            f"{more.ratio:.3f}",
            ", ".join(f"{name} {ratio:.2f}" for name, ratio in more.best[:1]),
        )
        for more in found.more
    ]


def _summary(found: Foresight) -> list[str]:
    limit = found.rate_limit
    allowed = "" if limit is None else f", of {math.degrees(limit):.4g} deg/s that the rig allows"
    fastest = ""
    if found.fastest is not None:
        fastest = f", at most {math.degrees(found.fastest):.4g} deg/s about an axis{allowed}"
    smallest = ""
    if found.smallest is not None:
        smallest = f"; smallest relative singular value {found.smallest:.2g}, the priors as units"
    out = [
        f"Plan: {found.plan}, {found.duration:.0f} s{fastest}.",
        f"Rank {found.rank} of {found.states}{smallest}.",
        f"Linearised at {found.linearised_at}.",
    ]
    out += _listed("Remains least known", found.remaining)
    out += _listed("Hard to tell apart", found.weakest)
    out += _listed("Seen by no leg" if found.legs else "Not seen", found.unseen)
    pairs = [f"{a} and {b} ({value:+.2f})" for a, b, value in found.correlated[:SHOWN]]
    return out + ([f"Errors most correlated: {', '.join(pairs)}."] if pairs else [])


def _listed(title: str, words: tuple[str, ...]) -> list[str]:
    more = len(words) - SHOWN
    rest = [f"  and {more} more (--json names all)"] if more > 0 else []
    return [f"{title}:", *(f"  {w}" for w in words[:SHOWN]), *rest] if words else []
