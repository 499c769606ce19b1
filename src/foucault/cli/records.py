"""The commands of the records of a laboratory: `foucault records ...`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from foucault.cli import options
from foucault.cli.options import add as add_command
from foucault.cli.options import command
from foucault.cli.screen import EXIT_CODES, Screen, kept, written
from foucault.errors import FoucaultError, error
from foucault.files import keep_others, write_text

if TYPE_CHECKING:
    from foucault.records import Records
    from foucault.records.entries import Certified
    from foucault.records.history import Past

Where = Annotated[
    str | None,
    typer.Option(
        "--database",
        help="File of the records, or an address such as postgresql://host/name; else that of the "
        "variable FOUCAULT_DATABASE, else records.sqlite in this folder.",
    ),
]
Who = Annotated[str, typer.Option(help="Who says so; the user of this computer if left out.")]
InstrumentName = Annotated[str, typer.Argument(help="Name of an instrument, or its serial number.")]
OneRun = Annotated[
    str, typer.Argument(help="A run: its number, its folder, or the beginning of its hash.")
]
AsOf = Annotated[str, typer.Option(help="Judge as of this day; today if left out.")]
Words = Annotated[str, typer.Option(help="Anything else.")]


def add_to(app: typer.Typer) -> None:
    """Add the commands to the program."""
    group = typer.Typer(rich_markup_mode=None, no_args_is_help=True)
    for one in (add, list_, show, due, review, tolerance, interval, event, reference, moved, rerun,
                audit, rebuild, export):  # fmt: skip
        add_command(group, one)
    app.add_typer(group, name="records", help="Keep runs for years: history, limits, due dates.")


@contextmanager
def _open(where: str | None, who: str = "", *, make: bool = False) -> Iterator[Records]:
    from foucault.records import Records

    records = Records(where, make=make, who=who)
    try:
        yield records
    finally:
        records.close()


@command(
    "foucault records add run",
    'foucault records add 2025/run --date 2025-03-01 --reference "table 3"',
    "foucault records add --below archive",
    exits={0: "all are in", 3: "some could not be taken in"},
)
def add(
    screen: Screen,
    runs: Annotated[list[Path] | None, typer.Argument()] = None,
    below: Path | None = None,
    date: str = "",
    instrument: str = "",
    reference: list[str] | None = None,
    database: Where = None,
    who: Who = "",
) -> None:
    """Take runs in; those that are in already stay as they are.

    A run folder stays where it lies and is only read. Interrupted, the same command goes on.
    """
    from foucault.run_folder import RESULT_FILE

    folders = list(runs or [])
    if below is not None:
        folders += sorted(file.parent for file in below.rglob(RESULT_FILE))
    if not folders:
        raise error("records.nothing", where=below or "the command line")
    with _open(database, who, make=True) as records, screen.progress() as tell:
        taken, failed = records.add(
            folders, date=date, instrument=instrument, references=reference or (), progress=tell
        )
    for folder, problem in failed:
        screen.say(f"{folder}: {problem.message}", style="yellow")
        screen.say(f"  {problem.cure}")
    there = len(folders) - len(taken) - len(failed)
    screen.say(
        f"{len(taken)} taken in, {there} were in already"
        + (f", {len(failed)} could not be." if failed else ".")
    )
    screen.data({
        "added": [asdict(run) for run in taken],
        "failed": [{"folder": str(f), "code": p.code, "message": p.message} for f, p in failed],
    })  # fmt: skip
    raise typer.Exit(3 if failed else 0)


@command("foucault records list", 'foucault records list "IMU 7"')
def list_(
    screen: Screen,
    instrument: Annotated[str | None, typer.Argument()] = None,
    database: Where = None,
) -> None:
    """List instruments, or the runs of one."""
    with _open(database) as records:
        name = None if instrument is None else records.instrument(instrument)
        runs = records.runs(name or "")
    screen.table(
        name or "all instruments",
        ("no.", "instrument", "recorded", "procedure", "verdict", "review", "folder"),
        [(str(r.number), r.instrument, r.holds[:10] or "unknown", r.procedure, r.verdict,
          r.decision or "-", r.folder) for r in runs],
        right=(True, *[False] * 6),
    )  # fmt: skip
    screen.data({"runs": [asdict(r) for r in runs]})


@command(
    'foucault records show "IMU 7"', "foucault records show 0042 -o history",
    exits={3: "due, too near a limit, or the last run was doubtful",
           4: "out of its limits, out of service, or no run counts"},
)  # fmt: skip
def show(
    screen: Screen,
    instrument: InstrumentName,
    output: options.FolderIfWanted = None,
    at: AsOf = "",
    database: Where = None,
) -> None:
    """Show what an instrument was, is, and will be when it is due.

    With its drift, its repeatability, its limits and when it will reach them.
    """
    from foucault.campaign import comparison
    from foucault.records.history import compared, past

    with _open(database) as records, screen.work(output, "comparison"):
        found = past(records, instrument, comparison.moment(at) if at else None)
        issued = [c for run in found.runs for c in records.certificates(run)]
        if output is not None:
            read = compared(records, found)
            if read is None:
                raise error("records.one", name=found.instrument, count=len(found.counted))
            kept(comparison.record(read), output)
    _say(screen, found, issued)
    if output is not None:
        screen.say(f"Report: {output / 'report.html'}")
    screen.data(_plain(found) | {"certificates": [one.model_dump() for one in issued]})
    raise typer.Exit(EXIT_CODES[str(found.level)])


def _say(screen: Screen, found: Past, issued: Sequence[Certified]) -> None:
    """Print what there is to say of an instrument."""
    from foucault.records import shown

    screen.say(found.instrument, style="bold")
    counted = {r.number for r in found.counted}
    screen.table(
        "", ("no.", "recorded", "procedure", "verdict", "review", "counts"),
        [(str(r.number), r.holds[:10] or "unknown", r.procedure, r.verdict, r.decision or "-",
          "yes" if r.number in counted else "no") for r in found.runs],
        right=(True, *[False] * 5),
    )  # fmt: skip
    for event in found.events:
        screen.say(f"{event.on[:10]}: {event.what}{f', {event.words}' if event.words else ''}")
    for one in issued:
        also = f", replaces {one.replaces}" if one.replaces else ""
        screen.say(f"{one.issued[:10]}: certificate {one.certificate}{also}")
    if found.outlooks:
        limited = any(math.isfinite(o.limit) for o in found.outlooks)
        headings = shown.HEADINGS if limited else shown.HEADINGS[:-2]
        screen.table("", headings, [shown.row(o)[: len(headings)] for o in found.outlooks])
    due = "no interval is set" if math.isnan(found.due) else _day(found.due)
    late = not math.isnan(found.due) and found.due < found.now
    screen.say(f"Due: {due}{', which is past' if late else ''}")
    first = found.first_reached
    if first is not None:
        screen.say(f"{first.name} will reach its limit about {_day(first.reaches)}.")
    screen.say(f"verdict: {shown.WORDS[str(found.level)]}")


def _day(time: float) -> str:
    from foucault.records.shown import day

    return day(time)


def _plain(found: Past) -> dict[str, Any]:
    """Return an instrument as JSON has it [SI]."""
    first = found.first_reached
    return {
        "instrument": found.instrument,
        "level": str(found.level),
        "due": "" if math.isnan(found.due) else _day(found.due),
        "out_of_service": found.out_of_service,
        "reaches_first": None if first is None else first.name,
        "runs": [asdict(r) for r in found.runs],
        "counted": [r.number for r in found.counted],
        "events": [e.model_dump() for e in found.events],
        "coefficients": [asdict(o) for o in found.outlooks],
    }


@command("foucault records due", "foucault records due --within 90",
         exits={3: "something is due"})  # fmt: skip
def due(
    screen: Screen,
    within: Annotated[float, typer.Option(min=0)] = 30.0,
    at: AsOf = "",
    database: Where = None,
) -> None:
    """List what is due, and which limits are or will be reached.

    An instrument is due when its interval has passed since its last run that counts.
    """
    from foucault.campaign import comparison
    from foucault.records.history import pasts

    with _open(database) as records:
        found = pasts(records, comparison.moment(at) if at else None)
        references = records.references()
    now = found[0].now if found else comparison.moment(at) if at else math.nan
    end = now + within * 86400.0
    rows = [
        (p.instrument, "calibration", _day(p.due)) for p in found
        if p.due <= end and not p.out_of_service
    ]  # fmt: skip
    rows += [
        (p.instrument, f"{o.name} reaches its limit", _day(o.reaches))
        for p in found for o in p.outlooks
        if o.reaches <= end and o.decision != "fail" and not p.out_of_service
    ]  # fmt: skip
    rows += [
        (p.instrument, f"{o.name} is beyond its limit", _day(now)) for p in found
        for o in p.outlooks if o.decision == "fail" and not p.out_of_service
    ]  # fmt: skip
    rows += [
        (r.name, f"certificate of the {r.what}", r.due[:10])
        for r in references.values() if r.due and comparison.moment(r.due) <= end
    ]  # fmt: skip
    rows.sort(key=lambda row: row[2])
    if rows:
        screen.table("", ("what", "why", "when"), rows, right=(False, False, False))
    else:
        screen.say(f"Nothing is due within {within:.0f} days.")
    screen.data({"due": [dict(zip(("what", "why", "when"), row, strict=True)) for row in rows]})
    raise typer.Exit(3 if rows else 0)


@command('foucault records review 12 accepted --reason "the log of the chamber explains it"')
def review(
    screen: Screen,
    run: OneRun,
    decision: Literal["accepted", "rejected"],
    reason: Annotated[str, typer.Option()],
    database: Where = None,
    who: Who = "",
) -> None:
    """Accept a doubtful run, or reject one.

    What is rejected no longer counts for its instrument.
    """
    with _open(database, who) as records:
        _added(screen, records.review(run, decision, reason))


@command('foucault records tolerance "IMU 7" tolerance.toml')
def tolerance(
    screen: Screen,
    instrument: InstrumentName,
    file: Path,
    database: Where = None,
    who: Who = "",
) -> None:
    """Set the limits of an instrument; the file is kept whole."""
    with _open(database, who) as records:
        _added(screen, records.tolerate(instrument, file))


@command('foucault records interval "IMU 7" 12')
def interval(
    screen: Screen,
    instrument: InstrumentName,
    months: Annotated[float, typer.Argument(min=0.1, max=600)],
    database: Where = None,
    who: Who = "",
) -> None:
    """Set how long a calibration of an instrument holds."""
    with _open(database, who) as records:
        _added(screen, records.recalibrate_every(instrument, months))


@command('foucault records event "IMU 7" repaired --on 2026-04-01 --words "new z gyro"')
def event(
    screen: Screen,
    instrument: InstrumentName,
    what: Literal["repaired", "adjusted", "out of service", "in service", "note"],
    on: Annotated[str, typer.Option()],
    words: Words = "",
    database: Where = None,
    who: Who = "",
) -> None:
    """Say what was done to an instrument.

    After a repair or an adjustment earlier runs no longer count.
    """
    with _open(database, who) as records:
        _added(screen, records.event(instrument, what, on, words))


@command('foucault records reference "table 3" table --certificate "No. 12345" --renew 2027-01-31')
def reference(
    screen: Screen,
    name: str,
    what: Literal["gravity", "table", "clock", "thermometer", "other"],
    certificate: str = "",
    renew: str = "",
    words: Words = "",
    database: Where = None,
    who: Who = "",
) -> None:
    """Name what calibrations rest on, or renew its certificate."""
    with _open(database, who, make=True) as records:
        _added(screen, records.reference(name, what, certificate, renew, words))


@command("foucault records moved archive/2025/run")
def moved(
    screen: Screen,
    folder: Path,
    database: Where = None,
    who: Who = "",
) -> None:
    """Say that a run folder lies elsewhere now."""
    with _open(database, who) as records:
        run = records.moved(folder)
    screen.say(f"Run {run.number} of {run.instrument} lies in {run.folder}.")
    screen.data({"number": run.number, "folder": run.folder})


@command("foucault records rerun 12", "foucault records rerun --older",
         exits={3: "some could not be"})  # fmt: skip
def rerun(
    screen: Screen,
    run: Annotated[list[str] | None, typer.Argument()] = None,
    older: Annotated[bool, typer.Option("--older")] = False,
    database: Where = None,
    who: Who = "",
) -> None:
    """Calibrate runs again from their logs, beside the old results.

    What the program does otherwise is then not taken for a change of the instrument.
    """
    from foucault import __version__
    from foucault.records.again import rerun as again

    done, failed = [], []
    with _open(database, who) as records:
        every = records.runs()
        over = {r.again for r in every}
        chosen = [records.run(one) for one in run or ()]
        if older:
            chosen += [r for r in every if r.version != __version__ and r.sha256 not in over]
        if not chosen:
            screen.say("Nothing to make again: "
                       + (f"all that counts is of version {__version__}." if older
                          else "name a run, or all of other versions by --older."))  # fmt: skip
        for one in chosen:
            with screen.progress() as tell:
                try:
                    new = again(records, one, progress=tell,
                                page=lambda folder: written(folder, "result"))  # fmt: skip
                except FoucaultError as problem:
                    failed.append({"run": one.number, "code": problem.code,
                                   "message": problem.message})  # fmt: skip
                    screen.say(f"run {one.number}: {problem.message}", style="yellow")
                    screen.say(f"  {problem.cure}")
                    continue
            done.append({"run": one.number, "again": new.number, "folder": new.folder})
            screen.say(f"run {one.number} -> run {new.number}, {new.folder}: {new.verdict}")
    screen.data({"done": done, "failed": failed})
    raise typer.Exit(3 if failed else 0)


@command("foucault records audit", "foucault records audit --since 3f2a...",
         exits={4: "something is not as it was"})  # fmt: skip
def audit(
    screen: Screen,
    since: str = "",
    database: Where = None,
) -> None:
    """Look for what was changed: entries, run folders, the index."""
    with _open(database) as records, screen.progress() as tell:
        faults = records.audit(tell)
        number, head = records.head
        cut = bool(since) and not records.has(since)
    said = [{"where": f.where, "what": f.what} for f in faults]
    if cut:
        said.append({"where": f"entry with hash {since}", "what": "it is not there any more"})
    for row in said:
        screen.say(f"{row['where']}: {row['what']}", style="bold red")
    screen.say(f"{number} entries; the newest has the hash", head)
    if not said:
        screen.say("All is as it was written.")
    screen.data({"faults": said, "entries": number, "head": head})
    raise typer.Exit(4 if said else 0)


@command("foucault records rebuild", "foucault records rebuild --journal journal.jsonl")
def rebuild(
    screen: Screen,
    journal: Path | None = None,
    database: Where = None,
) -> None:
    """Make the index again, of the entries and the run folders."""
    with _open(database, make=journal is not None) as records:
        count = records.rebuild(journal)
    screen.say(f"The index holds {count} runs.")
    screen.data({"runs": count})


@command("foucault records export -o journal.jsonl")
def export(
    screen: Screen,
    output: Annotated[Path | None, typer.Option("-o", "--output")] = None,
    database: Where = None,
) -> None:
    """Write all entries, a line of JSON for each."""
    with _open(database) as records:
        text = records.export()
    if output is None:
        print(text, end="")
        return
    keep_others(output, [b'"hash"'])
    write_text(output, text)
    screen.say(f"Wrote {output}.")


def _added(screen: Screen, entry: Any) -> None:
    from foucault.records.entries import plain

    screen.say(f"Entry {entry.number}, by {entry.who}: {entry.hash[:12]}")
    screen.data(plain(entry))
