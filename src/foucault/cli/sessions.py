"""Commands about logs: `inspect`, `simulate`, `allan`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foucault.cli import options
from foucault.cli.options import Amount, command
from foucault.cli.screen import Screen

if TYPE_CHECKING:
    from foucault.campaign import Campaign
    from foucault.diagnose.allan import LogAllan
    from foucault.diagnose.live import Inspection
    from foucault.models.transfer import MasterTable
    from foucault.tables import Log


def load_or_template(name: str) -> Campaign:
    """Return the campaign of a file, or the template of a procedure."""
    from foucault import campaign, procedures

    if name in procedures.PROCEDURES:
        return campaign.parse(campaign.template(name), f"{name}.toml")
    return campaign.load(name)


@command(
    "foucault simulate hand_rotated -o session",
    "foucault simulate campaign.toml -o session --seed 7",
    "foucault simulate norm_observation -o bench --instruments 60",
)
def simulate(
    ctx: typer.Context,
    what: options.CampaignOrName,
    output: options.Folder,
    seed: Annotated[
        int | None,
        typer.Option(help="Seed of the random numbers; that of the campaign if left out.", min=0),
    ] = None,
    instruments: Annotated[
        int | None,
        typer.Option(
            help="Simulate so many instruments, as means in one file; one if left out.",
            min=1,
            max=1_000_000,
        ),
    ] = None,
) -> None:
    """Simulate a session: the log, and the truth beside it."""
    from foucault import campaign

    screen: Screen = ctx.obj
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
    ctx: typer.Context,
    log: options.LogFile,
    plots: Annotated[
        Path | None, typer.Option(help="HTML file to write quick plots to; none if left out.")
    ] = None,
) -> None:
    """Look at a log: rates, gaps, units, and the rests found.

    Mean, noise and limits of every axis, and what looks wrong with its cure.
    """
    from foucault.campaign.running import read_any
    from foucault.diagnose import live as inspection

    screen: Screen = ctx.obj
    with screen.progress() as tell:
        table, start = from_start(read_any(log, tell)[0])
        tell(0.7, "finding rests")
        seen = inspection.inspect(table)
        if plots is not None:
            from foucault.report import noise, save

            tell(0.9, "drawing")
            save(noise.inspected(seen), plots)
    titles = ("axis", "mean", "sd", "min", "max", "noise at rest")
    means, master = seen.log.averaged is not None, getattr(table, "master", None)
    overview, axes = _overview(seen, start), _axes(seen)
    if master is not None:  # it is calibrated as it moves: rests are nothing to look for
        screen.table("", ("log", str(log)), [r for r in overview if "rest" not in r[0]])
        screen.table("readings", titles[:-1], [r[: len(titles) - 1] for r in axes])
        screen.table("", ("master", ""), _messages(master, start))
        screen.findings(seen.log.findings)
    else:
        screen.table("", ("log", str(log)), overview)
        screen.table("readings", titles[:-1] if means else titles, axes)
        kind = "mean" if means else "rest"
        screen.table(f"{kind}s", (kind, *_TITLES, *_table_columns(seen)), _rests(seen))
        screen.findings(seen.findings)
    if plots is not None:
        screen.say(f"Plots are in {plots}.")
    screen.data(_document(log, seen, start))


def from_start(log: Log) -> tuple[Log, float]:
    """Return the log with time counted from its start, and that start [s]."""
    start = float(log.time[0])
    return replace(log, time=log.time - start), start


_TITLES = ("start", "end", "up", "|f| (m/s^2)", "|w| (deg/s)", "state")


def _overview(seen: Inspection, start: float) -> list[tuple[str, str]]:
    import numpy as np

    from foucault.units import plain, span

    log = seen.log
    if log.averaged is not None:
        took = f"{span(float(log.averaged.min()))} to {span(float(log.averaged.max()))}"
        return [("means", f"{len(log)}, each over {took}")]
    kind = {"rate": "instantaneous", "increment": "means over each interval"}[log.sampled]
    still = int(np.count_nonzero(~seen.turning))
    rows = [
        ("samples", f"{len(log)}"),
        ("duration", f"{log.duration:.2f} s"),
        ("rate", f"{plain(log.rate, 6)} Hz"),
        ("interval", f"{span(seen.shortest)} to {span(seen.longest)}"),
        ("gaps", f"{seen.gaps}"),
        ("readings", kind),
        ("rests found", f"{still} (level below {seen.rests.threshold:.3g} x the quiet)"),
    ]
    if seen.turning.any():
        rows.append(("steady turns", f"{int(seen.turning.sum())}, listed among the rests"))
    if start:
        rows.insert(1, ("starts at", f"{plain(start, 13)} s; times below count from there"))
    f = _means(seen, "accel")
    if f is not None and len(f) and np.isfinite(f).all():
        size = np.linalg.norm(f if seen.turning.all() else f[~seen.turning], axis=1)
        rows.append(("|f| at rest", f"{size.min():.4f} to {size.max():.4f} m/s^2 (1 g = 9.80665)"))
    return rows


def _messages(master: MasterTable, start: float) -> list[tuple[str, str]]:
    """What there is to see of the messages of a master, by the clock that they are used by."""
    import numpy as np

    from foucault.units import span

    time, speed = master.messages.time - start, np.linalg.norm(master.velocity_n[:, :2], axis=1)
    pitch, roll = np.degrees(master.angles[:, 1:]).T
    said = "said" if master.has_place else "not said: it begins at [site]"
    return [
        ("messages", f"{len(time)}"),
        ("first to last", f"{time[0]:.2f} s to {time[-1]:.2f} s of the log above"),
        ("interval", f"{span(float(np.median(np.diff(time))))} as a rule"),
        ("horizontal speed", f"{speed.min():.2f} to {speed.max():.2f} m/s"),
        ("pitch", f"{pitch.min():.1f} to {pitch.max():.1f} deg"),
        ("roll", f"{roll.min():.1f} to {roll.max():.1f} deg"),
        ("position", said),
    ]


def _axes(seen: Inspection) -> list[tuple[str, ...]]:
    from foucault.tables import AXES
    from foucault.units import convert

    rows = []
    for name, axes, kind, unit, noise_kind, noise_unit in (
        ("accel", seen.accel, "gravity", "m/s^2", "velocity random walk", "ug/sqrt(Hz)"),
        ("gyro", seen.gyro, "angular rate", "deg/s", "angle random walk", "deg/sqrt(h)"),
    ):
        if axes is None:
            continue
        for i in seen.log.logged(name):
            axis = AXES[i]
            columns = (axes.mean, axes.sd, axes.lowest, axes.highest)
            numbers = [f"{convert(float(c[i]), kind, unit):.4g}" for c in columns]
            noise = convert(float(axes.noise[i]), noise_kind, noise_unit)
            last = () if seen.log.averaged is not None else (f"{noise:.3g} {noise_unit}",)
            rows.append((f"{name} {axis} ({unit})", *numbers, *last))
    return rows


def _rests(seen: Inspection) -> list[tuple[str, ...]]:
    import numpy as np

    from foucault.tables import AXES

    f, w = _means(seen, "accel"), _means(seen, "gyro")
    rows: list[tuple[str, ...]] = []
    for k in range(len(seen.rests)):
        up = size = turning = ""
        if f is not None and np.isfinite(f[k]).all():
            largest = int(np.argmax(np.abs(f[k])))
            tilt = np.degrees(np.arccos(abs(f[k, largest]) / np.linalg.norm(f[k])))
            up = f"{'+' if f[k, largest] > 0 else '-'}{AXES[largest]} ({tilt:.0f} deg off)"
            size = f"{np.linalg.norm(f[k]):.4f}"
        if w is not None:
            turning = f"{np.degrees(np.linalg.norm(w[k][list(seen.log.logged('gyro'))])):.3f}"
        start, end = (f"{seen.rest_rows[c][k]:.2f} s" for c in ("start", "end"))
        if seen.log.averaged is not None:
            end = f"{seen.rest_rows['start'][k] + seen.log.averaged[k]:.2f} s"
        state = "turning" if seen.turning[k] else "rest"
        columns = (f"{x[k]:.3f}" for x in _table_columns(seen).values())
        rows.append((str(k + 1), start, end, up, size, turning, state, *columns))
    return rows


def _table_columns(seen: Inspection) -> dict[str, Any]:
    """Return angles and rate of the table in degrees, of logs that are means."""
    import numpy as np

    table = seen.log.table
    if table is None or seen.log.averaged is None:
        return {}
    names = ("outer (deg)", "middle (deg)", "inner (deg)")
    columns = dict(zip(names, np.degrees(table.angles.T), strict=True))
    if table.rate is not None:
        columns["table (deg/s)"] = np.degrees(table.rate)
    return {name: x for name, x in columns.items() if np.isfinite(x).any()}


def _means(seen: Inspection, triad: str) -> Any:
    import numpy as np

    from foucault.tables import AXES

    names = [f"{triad}_{axis}" for axis in AXES]
    if names[0] not in seen.rest_rows:
        return None
    return np.stack([seen.rest_rows[name] for name in names], axis=1)


def _document(path: Path, seen: Inspection, start: float) -> dict[str, Any]:
    """What `inspect` found, in SI; times count from `start`."""
    log = seen.log
    samples = log.averaged is None
    keep = ("mean", "sd", "lowest", "highest", *(["noise"] if samples else []))
    triads = {
        name: {key: _numbers(getattr(axes, key)) for key in keep}
        for name, axes in (("accel", seen.accel), ("gyro", seen.gyro))
        if axes is not None
    }
    return {
        "log": str(path),
        "samples": len(log),
        "start": start,
        "duration": log.duration,
        **({"rate": log.rate} if log.averaged is None else {"averaged": log.averaged.tolist()}),
        **({"interval": [seen.shortest, seen.longest], "gaps": seen.gaps} if samples else {}),
        "sampled": log.sampled,
        **triads,
        **({"threshold": seen.rests.threshold} if samples else {}),
        "rests": {name: _numbers(column) for name, column in seen.rest_rows.items()}
        | {"turning": seen.turning.tolist()},
        "findings": [item.as_dict() for item in seen.findings],
    }


def _numbers(column: Any) -> list[Any]:
    """Return a column as JSON has it: null where there is no number, as of an axis not logged."""
    return [None if x != x else x for x in column.tolist()]


# -- The command about noise: allan --------------------------------------------------------------

REPORT_FILE, NOISE_FILE, TABLE_FILE = "report.html", "noise.toml", "allan.csv"


@command(
    "foucault allan static.csv -o noise",
    'foucault allan campaign.toml --axis gyro.z --rest "0 s to 50 s"',
    "foucault allan static.parquet --axis gyro --kind hadamard",
)
def allan(
    ctx: typer.Context,
    log: options.LogFile,
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
        Amount | None,
        options.REST.option(
            'Part at rest, such as "0 s to 50 s". The whole log if left out, or the longest '
            "rest of one that moves."
        ),
    ] = None,
    output: options.FolderIfWanted = None,
) -> None:
    """Find the noise of an instrument at rest.

    Random walks, bias instability and ramp by Allan deviations, with a [noise] table to use.
    """
    from foucault.campaign.running import read_any
    from foucault.diagnose.allan import measure_log

    screen: Screen = ctx.obj
    with screen.progress() as tell:
        table, _ = from_start(read_any(log, tell)[0])
        tell(0.7, "computing variances")
        seen = measure_log(table, axes=tuple(axis or ()), kind=_kind(kind), rest=rest)
        if output is not None:
            tell(0.9, "writing")
            _write(seen, str(table.source.get("file", log.name)), output)
    screen.say(f"At rest, {seen.start:.2f} s to {seen.end:.2f} s.")
    screen.table("", ("axis", "noise", "value", "sd", "95 % interval"), _rows(seen))
    screen.findings((*table.findings, *seen.findings))
    if output is not None:
        screen.say(f"Plot: {output / REPORT_FILE}")
    screen.data(_channels_said(log, seen, [f.as_dict() for f in (*table.findings, *seen.findings)]))


def _kind(given: str) -> Any:
    from foucault.diagnose.allan import check_kind

    return check_kind(given)


def _rows(seen: LogAllan) -> list[tuple[str, ...]]:
    from foucault.diagnose.allan import WORDS, described

    rows: list[tuple[str, ...]] = []
    for name, channel in seen.channels.items():
        triad = name.split(".")[0]
        for i, noise in enumerate(channel.noises):
            words = described(noise, triad, channel.longest)
            rows.append((name if i == 0 else "", WORDS[triad][i], *words))
    return rows


def _write(seen: LogAllan, name: str, folder: Path) -> None:
    """Write the plot, the table of deviations and, where there is one, the noise block."""
    from foucault.diagnose.allan import deviation_table, noise_block
    from foucault.errors import FoucaultError
    from foucault.escape import commented
    from foucault.files import make_folder, write_text
    from foucault.report import noise as report
    from foucault.report import save

    make_folder(folder)
    try:
        block = noise_block(seen)
    except FoucaultError as nothing_seen:
        block = commented([nothing_seen], "#") + "\n"
    texts = {NOISE_FILE: block, TABLE_FILE: deviation_table(seen)}
    for file, text in texts.items():
        write_text(folder / file, text)
    save(report.document(seen, name, block), folder / REPORT_FILE)


def _channels_said(path: Path, seen: LogAllan, findings: list[dict[str, str]]) -> dict[str, Any]:
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
