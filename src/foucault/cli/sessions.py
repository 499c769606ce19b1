"""Commands about logs: `inspect`, `simulate`, `allan`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foucault.cli import options
from foucault.cli.options import Amount, command
from foucault.cli.screen import Screen
from foucault.errors import FoucaultError, error
from foucault.escape import commented
from foucault.files import make_folder, plain_json, write_text

if TYPE_CHECKING:
    from foucault.campaign import Campaign
    from foucault.campaign.recognised import Found as Bare
    from foucault.diagnose.allan import LogAllan
    from foucault.diagnose.live import Inspection


def load_or_template(name: str, said: Sequence[str] = ()) -> Campaign:
    """Return the campaign of a file or the template of a procedure, with what --set is given."""
    from foucault import campaign, procedures

    if name in procedures.PROCEDURES:
        found = campaign.parse(campaign.template(name), f"{name}.toml")
    else:
        found = campaign.load(name)
    if said:
        from foucault.campaign.recognised import with_keys

        found = with_keys(found, said)
    return found


@command(
    "foucault simulate hand_rotated -o session",
    "foucault simulate campaign.toml -o session --seed 7",
    "foucault simulate norm_observation -o bench --instruments 60",
)
def simulate(
    screen: Screen,
    what: options.CampaignOrName,
    output: options.Folder,
    seed: Annotated[int | None, typer.Option(min=0)] = None,
    instruments: Annotated[int | None, typer.Option(min=1, max=1000000)] = None,
) -> None:
    """Simulate a session: the log, and the truth beside it."""
    from foucault import campaign

    if instruments is not None:
        _simulate_fleet(screen, load_or_template(what), output, seed, instruments)
        return
    with screen.progress() as tell:
        tell(0.1, "simulating")
        session = campaign.simulate(load_or_template(what), seed)
        tell(0.6, "writing")
        file = campaign.save_session(session, output)
    log = session.simulation.log
    screen.say(
        f"Wrote {len(log)} samples ({log.duration:.0f} s at {log.rate:g} Hz) to {output}, "
        f"with the truth in {output / 'truth.json'}.",
        f"Next: foucault calibrate {file} -o {output / 'run'}",
    )
    if (output / "outage.csv").is_file():
        screen.say("For foucault navigate: outage.csv, what came after; reference.csv, the truth.")
    screen.data({"folder": str(output), "campaign": str(file), "samples": len(log)})


def _simulate_fleet(
    screen: Screen, described: Campaign, output: Path, seed: int | None, instruments: int
) -> None:
    from foucault.campaign import fleet

    with screen.progress() as tell:
        tell(0.1, "simulating")
        made = fleet.simulated(described, instruments, seed)
        tell(0.6, "writing")
        file = fleet.save_simulated(described, made, output, seed)
    screen.say(
        f"Wrote means of {instruments} instruments in {len(made.plan)} positions to {output}, "
        f"with the truth in {output / fleet.TRUTH_FILE}.",
        f"Next: foucault fleet {file} -o {output / 'fleet'}",
    )
    screen.data({"folder": str(output), "campaign": str(file), "instruments": instruments})


@command("foucault inspect campaign.toml --plots quick.html", "foucault inspect session/log.csv")
def inspect(
    screen: Screen,
    log: options.LogFiles,
    plots: Path | None = None,
    everything: Annotated[bool, typer.Option("--all")] = False,
    taken: options.Taken = None,
) -> None:
    """Look at a log: axes, when it was at rest, what looks wrong.

    On one screen; with --all every rest and every finding.
    """
    from foucault.campaign.running import read_any
    from foucault.diagnose import live
    from foucault.report import noise, save

    held = _taken(screen, log, known := options.known(log, taken))
    with screen.progress() as tell:
        table = read_any(log, tell, said=known)[0] if held is None else held.log
        table, start = table.from_start()
        screen.log, screen.everything = str(table.source.get("sha256", "")), everything
        tell(0.7, "finding rests")
        seen = live.inspect(table)
        said = noise.inspected(seen, start)
        if plots is not None:
            tell(0.9, "drawing")
            save(said, plots)
        shown = said if everything else noise.glance(seen, start)
    where = [] if plots is None else [f"Plots are in {plots}."]
    more = [] if everything else ["--all prints every rest and every finding."]
    said_of = {} if held is None else {"recognised": [line.as_dict() for line in held.lines]}
    raise screen.tell(shown, _document(log[0], seen, start) | said_of, *where, *more)


def _taken(screen: Screen, log: Sequence[Path], known: dict[str, Any]) -> Bare | None:
    """Say what a bare log was taken for; nothing of one that says itself what it holds."""
    from foucault.campaign.recognised import found
    from foucault.cli.results import say_taken

    if not options.bare(log):
        return None
    try:
        held = found(log, known)
    except FoucaultError:  # whoever reads it says what is wrong
        return None
    if held.recognised.described:
        return None
    say_taken(screen, held)
    return None if held.recognised.questions else held


def _document(path: Path, seen: Inspection, start: float) -> dict[str, Any]:
    """What `inspect` found, in SI; times count from `start`."""
    log = seen.log
    samples = log.averaged is None
    keep = ("mean", "sd", "lowest", "highest", *(["noise"] if samples else []))
    triads = {
        name: {key: getattr(axes, key) for key in keep}
        for name, axes in (("accel", seen.accel), ("gyro", seen.gyro))
        if axes is not None
    }
    return {
        "log": str(path),
        "samples": len(log),
        "start": start,
        "duration": log.duration,
        **({"rate": log.rate} if log.averaged is None else {"averaged": log.averaged}),
        **({"interval": [seen.shortest, seen.longest], "gaps": seen.gaps} if samples else {}),
        "sampled": log.sampled,
        **triads,
        **({"threshold": seen.rests.threshold} if samples else {}),
        "rests": seen.rest_rows | {"turning": seen.turning},
        "findings": [item.as_dict() for item in seen.findings],
    }


# -- The command about noise: allan --------------------------------------------------------------

REPORT_FILE, NOISE_FILE, TABLE_FILE, DATA_FILE = (
    "report.html", "noise.toml", "allan.csv", "allan.json")  # fmt: skip
OF_CHANNEL = (
    "kind", "samples", "interval", "excess", "tau", "deviation", "low", "high", "dof", "curve",
)  # fmt: skip


@command(
    "foucault allan static.csv -o noise",
    'foucault allan campaign.toml --axis gyro.z --rest "0 s to 50 s"',
    "foucault allan static.parquet --axis gyro --kind hadamard",
)
def allan(
    screen: Screen,
    log: options.LogFiles,
    axis: Annotated[list[str] | None, typer.Option(metavar="<str>")] = None,
    kind: str = "overlapping",
    rest: Annotated[
        Amount | None,
        options.REST.option(
            'Part at rest, such as "0 s to 50 s". The whole log if left out, or the longest '
            "rest of one that moves."
        ),
    ] = None,
    column: Annotated[list[str] | None, typer.Option(metavar="<str>")] = None,
    unit: Annotated[str, typer.Option(metavar="<str>")] = "",
    rate: Annotated[str, typer.Option(metavar="<str>")] = "",
    moving: Annotated[bool, typer.Option("--moving")] = False,
    taken: options.Taken = None,
    output: options.FolderIfWanted = None,
) -> None:
    """Find the noise of an instrument at rest.

    Random walks, bias instability and ramp by Allan deviations, with a [noise] table to use. Any
    columns: --column gx --column gy --unit "deg/s" --rate "100 Hz".
    """
    from foucault import logs
    from foucault.campaign.running import read_any
    from foucault.diagnose import vibration
    from foucault.diagnose.allan import check_kind, deviation_table, measure_log
    from foucault.logs.columns import columns_alone
    from foucault.report import noise as report
    from foucault.report import save

    for option, given in (("--unit", unit), ("--rate", rate)):
        if given and not column:
            raise error("allan.alone", option=option)
    with screen.progress() as tell:
        if column:
            read = logs.read(columns_alone(log[0], column, unit, rate), log[0].parent)
        else:
            read = read_any(log, tell, said=options.known(log, taken))[0]
        table, _ = read.from_start()
        screen.log = str(table.source.get("sha256", ""))
        tell(0.7, "computing variances")
        seen = measure_log(table, axes=tuple(axis or ()), kind=check_kind(kind), rest=rest)
        block = _block(seen)
        told = (*table.findings, *seen.findings)
        shaken = vibration.vibration(table, seen.start, seen.end) if moving else ()
        told += vibration.findings(shaken) if moving else ()
        said = report.document(seen, str(table.source.get("file", log[0].name)), block, told)
        data = _channels_said(log[0], seen, [f.as_dict() for f in told])
        data |= {"vibration": [vars(v) for v in shaken]} if moving else {}
        if output is not None:
            tell(0.9, "writing")
            make_folder(output)
            write_text(output / NOISE_FILE, block)
            write_text(output / TABLE_FILE, deviation_table(seen))
            write_text(output / DATA_FILE, json.dumps(plain_json(data)) + "\n")
            save(said, output / REPORT_FILE)
    where = [] if output is None else [f"Plot: {output / REPORT_FILE}"]
    raise screen.tell(said, data, *where, keys=("noise.axes", "findings"))


def _block(seen: LogAllan) -> str:
    """Return the noise block of a campaign, or why there is none as a remark."""
    from foucault.diagnose.allan import noise_block

    try:
        return noise_block(seen)
    except FoucaultError as nothing_seen:
        return commented([nothing_seen], "#") + "\n"


def _channels_said(path: Path, seen: LogAllan, findings: list[dict[str, str]]) -> dict[str, Any]:
    """What `allan` found, in SI."""
    from foucault.diagnose.bounding_pair import pairs

    channels = {
        name: {
            **{key: getattr(channel, key) for key in OF_CHANNEL},
            "longest_useful_tau": channel.longest,
            "noises": {
                noise.name: {
                    key: getattr(noise, key) for key in ("value", "sd", "seen", "low", "high")
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
        "pairs": {k: None if p is None else asdict(p) for k, p in pairs(seen).items()},
        "findings": findings,
    }
