"""Commands before a run: `preflight`, `optimise`, `montecarlo`."""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from typing import Annotated

import typer

from foucault.cli import cluster, options
from foucault.cli.options import Amount, command, quantity
from foucault.cli.screen import Screen, written
from foucault.cli.sessions import load_or_template
from foucault.errors import error

INCOMPLETE = 3  # Exit code where something is hardly seen, that of a doubtful result.


@command(
    "foucault preflight campaign.toml -o expected.csv",
    'foucault preflight platform_tumble --plan "-x -z -y +z" --rate "0.2 deg/s"',
    'foucault preflight norm_observation --plan "dodecahedron 20" --steps operator.html',
    'foucault preflight north_seeking --set "procedure.index_limit = 95 deg" --steps operator.html',
    notes="What is not tried is as in the campaign file, sampling and noise too.",
    exits={0: "all is seen", 3: "something is hardly seen, or a limit is broken"},
)
def preflight(
    screen: Screen,
    what: options.CampaignOrName,
    plan: str | None = None,
    rate: str | None = None,
    segment: str | None = None,
    terms: options.TermsChosen = None,
    said: options.SaidOfCampaign = None,
    output: options.TableIfWanted = None,
    listed: options.ListIfWanted = None,
) -> None:
    """Say before a session what it will show, and how well.

    Standard deviation of every coefficient, what cannot be told apart, whether the rig can do it.
    """
    from foucault import procedures
    from foucault.campaign import optimisation
    from foucault.report import operator, planned

    given = {"plan": plan, "rate": rate, "segment": segment, "terms": terms}
    with screen.progress() as tell:
        campaign = load_or_template(what, said or ())
        tell(0.2, "simulating the plan")
        changes = {key: text for key, text in given.items() if text is not None}
        found = optimisation.foresee(campaign, changes)
        if listed is not None:
            tell(0.9, "writing the list")
            line = [procedures.load(campaign.procedure).summary, found.plan]
            stages = optimisation.stages(campaign, changes)
            operator.save(operator.page(campaign.procedure, line, stages), listed)
    if output is not None:
        optimisation.write(found, output)
    files = {"file": output, "list": listed}
    words = {"file": "Table", "list": "List for the operator"}
    where = [f"{words[key]}: {file}" for key, file in files.items() if file is not None]
    told = {key: None if file is None else str(file) for key, file in files.items()}
    data = {"procedure": campaign.procedure} | found.as_dict() | told
    raise screen.tell(planned.preflight(found, campaign.findings), data, *where)


# -- The command that searches for a better plan: optimise ---------------------------------------


@command(
    "foucault optimise campaign.toml -o search",
    'foucault optimise platform_tumble -o search --time-limit "60 s"',
    'foucault optimise platform_tumble -o search --set "procedure.tilt_limit = 120 deg"',
    notes="What may be changed of the plan stands in the table [optimise] of the campaign. "
    "The same command again continues a search; with more --restarts it goes further.",
    exits={
        0: "a better plan was found, or one that the rig can do",
        3: "none was, or something cannot be seen",
    },
)
def optimise(
    screen: Screen,
    what: options.SearchedOrName,
    output: options.ContinuedFolder,
    restarts: Annotated[int, typer.Option(min=1, max=1000000)] = 32,
    evaluations: Annotated[int | None, typer.Option(min=1, max=1000000000)] = None,
    time_limit: Annotated[Amount | None, quantity('time', '', least='0 or more')] = None,
    seed: options.Seed = 0,
    said: options.SaidOfCampaign = None,
    size: Annotated[int, typer.Option('--round', min=2, max=100000)] = 8,
    workers: cluster.Workers = None,
    scheduler: cluster.Scheduler = None,
    local_cluster: cluster.LocalCluster = None,
) -> None:  # fmt: skip
    """Search for a plan that sees more, within limits of the rig."""
    from foucault.campaign import optimisation
    from foucault.run_folder import CAMPAIGN_FILE

    campaign = load_or_template(what, said or ())
    there = optimisation.finished(output)
    with (
        cluster.spread(screen, workers, scheduler, local_cluster) as map_,
        screen.work(output, "search") as tell,
    ):
        found = optimisation.run(
            campaign, output, restarts=restarts, evaluations=evaluations, time_limit=time_limit,
            seed=seed, size=size, map=map_,
            progress=lambda done, total: tell(done / total, f"restart {done} of {total}"),
        )  # fmt: skip
    went_on = f"Went on from {there} of these restarts, which were in the folder."
    unseen = f"No allowed plan shows: {', '.join(found.unseen)}."
    raise written(output, "search", found).tell(
        screen,
        asdict(found) | {"complete": found.complete},
        *[unseen] * bool(found.unseen),
        *[went_on] * bool(there),
        f"Plan: {output / CAMPAIGN_FILE}",
        code=0 if found.complete else INCOMPLETE,
    )


# -- The command for Monte Carlo studies ---------------------------------------------------------


@command(
    "foucault montecarlo campaign.toml -n 500 -o study",
    "foucault montecarlo hand_rotated -n 100 -o study --local-cluster 8",
    "foucault montecarlo six_position -n 1000000 -o study --batched",
    "foucault montecarlo six_position -n 1000000 -o study --batched --gpu",
    notes="The same command again continues an interrupted study.",
    exits={0: "every check passed", 3: "one did not"},
)
def montecarlo(
    screen: Screen,
    what: options.CampaignOrName,
    output: options.ContinuedFolder,
    trials: Annotated[int, typer.Option("-n", "--trials", min=2, max=1000000)] = 500,
    seed: options.Seed = 0,
    workers: cluster.Workers = None,
    scheduler: cluster.Scheduler = None,
    local_cluster: cluster.LocalCluster = None,
    batched: Annotated[bool, typer.Option("--batched")] = False,
    gpu: Annotated[bool, typer.Option("--gpu")] = False,
) -> None:
    """Calibrate many simulated instruments to test the uncertainties.

    Errors against their standard deviations and against the bound.
    """
    from foucault.campaign import many, study

    if gpu and not (batched and scheduler is None and local_cluster is None):
        raise error("study.gpu_options")
    described = load_or_template(what)
    run = partial(many.run, gpu=gpu) if batched else study.run
    with (
        cluster.spread(screen, workers, scheduler, local_cluster) as map_,
        screen.work(output, "study") as tell,
    ):
        result = run(
            described,
            trials,
            output,
            seed=seed,
            map=map_,
            progress=lambda done, total: tell(done / total, f"trial {done} of {total}"),
        )
    about = study.about(output)
    checks = result.checks()
    keys = ("name", "value", "low", "high", "passed", "sentence")
    said = {
        "status": dict(result.status),
        "coefficients": result.rows(),
        "checks": [{key: getattr(check, key) for key in keys} for check in checks],
    }
    code = 0 if all(c.passed for c in checks) else 3
    raise written(output, "study", result, about).tell(screen, said, code=code)
