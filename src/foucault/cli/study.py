"""The command for Monte Carlo studies."""

from __future__ import annotations

import math
from typing import Annotated

import typer

from foucault.cli import cluster, words
from foucault.cli.screen import Screen
from foucault.cli.sessions import load_or_template


def add_to(app: typer.Typer) -> None:
    """Add the command to the program."""
    app.command(
        "montecarlo",
        epilog=words.epilog(
            "foucault montecarlo campaign.toml -n 500 -o study",
            "foucault montecarlo hand_rotated -n 100 -o study --local-cluster 8",
            notes="The same command again continues an interrupted study.",
            exits={0: "every check passed", 3: "one did not"},
        ),
    )(montecarlo)


def montecarlo(
    ctx: typer.Context,
    what: words.CampaignOrName,
    output: words.ContinuedFolder,
    trials: Annotated[
        int, typer.Option("-n", "--trials", help="Number of trials.", min=2, max=1_000_000)
    ] = 500,
    seed: words.Seed = 0,
    workers: cluster.Workers = None,
    scheduler: cluster.Scheduler = None,
    local_cluster: cluster.LocalCluster = None,
) -> None:
    """Calibrate many simulated instruments: are the sd right?

    Errors against their standard deviations and against the bound.
    """
    from foucault.campaign import study
    from foucault.files import alone, beside
    from foucault.report import study as study_report

    screen: Screen = ctx.obj
    described = load_or_template(what)
    with (
        alone(output),
        cluster.spread(screen, workers, scheduler, local_cluster) as map_,
        screen.progress() as tell,
    ):
        result = study.run(
            described,
            trials,
            output,
            seed=seed,
            map=map_,
            progress=lambda done, total: tell(done / total, f"trial {done} of {total}"),
        )
    about = study.load(output)[1]
    with beside(output):
        report = study_report.write(result, about, output / "report.html")
    rows = result.rows()
    bound = any(math.isfinite(row["rms_over_bound"]) for row in rows)
    screen.table(
        "errors against predicted standard deviations",
        ("coefficient", "RMS / sd", *(["RMS / bound"] if bound else []), "mean z", "in 68 %",
         "in 95 %"),
        [
            (
                row["name"],
                f"{row['ratio']:.3f}",
                *([f"{row['rms_over_bound']:.3f}"] if bound else []),
                f"{row['mean_z']:+.2f}",
                f"{100 * row['coverage_68']:.0f} %",
                f"{100 * row['coverage_95']:.0f} %",
            )
            for row in rows
        ],
    )  # fmt: skip
    checks = result.checks()
    for check in checks:
        screen.say(f"{'ok  ' if check.passed else 'FAIL'} {check.sentence}")
    screen.say(f"Report: {report}")
    screen.data(
        {
            "folder": str(output),
            "report": str(report),
            "status": dict(result.status),
            "coefficients": rows,
            "checks": [
                {"name": c.name, "value": c.value, "low": c.low, "high": c.high,
                 "passed": c.passed, "sentence": c.sentence}
                for c in checks
            ],
        }
    )  # fmt: skip
    raise typer.Exit(0 if all(c.passed for c in checks) else 3)
