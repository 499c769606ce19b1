"""Commands that take a result away: apply and export."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foucault.cli import options
from foucault.cli.options import Amount, command, quantity
from foucault.cli.screen import COLOURS, Screen
from foucault.errors import error
from foucault.files import keep_others, read_text, sha256

if TYPE_CHECKING:
    from foucault.export.densities import Densities
    from foucault.logs.description import LogDescription
    from foucault.models.noise import ImuNoise
    from foucault.result import Result


_NOISE = "Folder of `foucault allan` whose noise goes into the file; else the campaign's."
_AXES = (
    "Axes of the receiver's readings: right-forward-up, forward-right-down or forward-left-up; "
    "those of the receiver if left out, else those of the log."
)
_RATE = quantity(
    "frequency", 'Rate of the readings for the receiver, such as "200 Hz"; that of the log if '
    "left out.", least="greater than 0",
)  # fmt: skip

BAGS = (".bag", ".mcap", ".db3")  # How the name of a bag ends, where it is no folder.


@command(
    "foucault apply run flight.csv -o flight_calibrated.parquet",
    "foucault apply run/result.json other_campaign.toml -o out.csv",
    "foucault apply run drive.bag -o drive_calibrated.bag",
    "foucault apply run --stream",
)
def apply(
    screen: Screen,
    result: options.ResultFile,
    log: Annotated[Path | None, typer.Argument()] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output")] = None,
    stream: Annotated[bool, typer.Option("--stream")] = False,
    topic: str | None = None,
    force: Annotated[bool, typer.Option("--force")] = False,
    outside: str = "error",
    at: Annotated[Amount | None, quantity("temperature", "")] = None,
) -> None:
    """Remove the calibrated errors from a log.

    Logs of any size are corrected in parts. The log must be of the instrument that was calibrated.
    """
    from foucault.export import calibrate_log
    from foucault.export.stream import calibrate_bag
    from foucault.run_folder import result_file

    if outside not in ("error", "hold"):
        raise error("temperature.outside_choice", given=outside)
    if stream:
        _stream(result, log, output, topic, force, at)
        return
    if log is None or output is None:
        raise error("apply.no_log")
    with screen.progress() as tell:
        tell(0.0, "reading the result")
        _not_an_input(output, result, log)
        calibrated = _to_apply(result, at)
        if log.is_dir() or log.suffix in BAGS:
            count = calibrate_bag(calibrated, log, output, topic=topic, force=force,
                                  progress=lambda part: tell(part, "applying"))  # fmt: skip
            screen.say(f"Wrote {output} with {count} corrected messages, all others as they were.")
            screen.data({"output": str(output), "samples": count})
            return
        if topic is not None:
            raise error("apply.topic", topic=topic, log=log)
        description, folder, instrument = _described(calibrated, result, log)
        done = calibrate_log(
            calibrated, description, folder, output,
            instrument=instrument,
            sha256=sha256(result_file(result)),
            force=force,
            hold=outside == "hold",
            progress=lambda part: tell(part, "applying"),
        )  # fmt: skip
    screen.findings(done.findings)
    screen.say(f"Wrote {done.samples} compensated samples in SI units to {output}.")
    _doubts(screen, calibrated)
    screen.data(
        {
            "output": str(output),
            "samples": done.samples,
            "verdict": calibrated.verdict.level,
            "findings": [item.as_dict() for item in done.findings],
        }
    )


@command(
    "foucault export run --to c -o calibration.h",
    "foucault export run --to px4 -o px4.params --drop accel.misalignment --drop gyro",
    'foucault export run --to vins-mono -o vins.yaml --noise static --rate "200 Hz"',
    "foucault export static --to kalibr -o imu.yaml",
)
def export(
    screen: Screen,
    result: options.ResultFile,
    to: Annotated[str, typer.Option("--to")],
    output: Annotated[Path, typer.Option("-o", "--output")],
    drop: Annotated[list[str] | None, typer.Option(metavar="<str>")] = None,
    axes: Annotated[str | None, typer.Option(help=_AXES)] = None,
    noise: Annotated[Path | None, typer.Option(help=_NOISE)] = None,
    rate: Annotated[Amount | None, _RATE] = None,
    slot: Annotated[int | None, typer.Option(min=0)] = None,
    force: Annotated[bool, typer.Option("--force")] = False,
    at: Annotated[Amount | None, quantity("temperature", "")] = None,
) -> None:
    """Write a result in the form of another program or language.

    For receivers that take noise, a folder of `foucault allan` may stand in the place of a run.
    """
    from foucault.export import write

    _not_an_input(output, result)
    calibrated, known, log = _to_export(result, noise)
    if at is not None:
        calibrated = calibrated.at(at)
    write(calibrated, to, output, axes=axes, drop=drop or [], noise=known, rate=rate, slot=slot,
          log=log, force=force)  # fmt: skip
    screen.say(f"Wrote {output} for {to}; what it holds and how to use it stands in the file.")
    _doubts(screen, calibrated)
    screen.data({"output": str(output), "to": to, "verdict": calibrated.verdict.level})


def _stream(
    result: Path, log: Path | None, output: Path | None, topic: str | None, force: bool,
    at: float | None,
) -> None:  # fmt: skip
    """Correct standard input to standard output; what was noticed goes beside."""
    import sys

    from foucault.export.stream import calibrate_stream
    from foucault.run_folder import result_file

    for option, given in (("-o", output), ("--topic", topic)):
        if given is not None:
            raise error("apply.stream", option=option)
    calibrated = _to_apply(result, at)
    description, _, _ = _described(calibrated, result, log or Path("standard input"))
    samples, noticed = calibrate_stream(
        calibrated, description, sys.stdin.buffer, sys.stdout.buffer,
        sha256=sha256(result_file(result)), force=force,
    )  # fmt: skip
    for one in noticed:
        print(f"{one.severity}: {one.message} {one.cure}", file=sys.stderr)
    print(f"{samples} samples corrected.", file=sys.stderr)


def _not_an_input(output: Path, result: Path, log: Path | None = None) -> None:
    """Refuse to write over what is read, even where anything else may be replaced."""
    from foucault.run_folder import CAMPAIGN_FILE, RESULT_FILE

    folder = result if result.is_dir() else result.parent
    inputs = [result, folder / RESULT_FILE, folder / CAMPAIGN_FILE, *([log] if log else [])]
    keep_others(output, [b""], inputs)


def _doubts(screen: Screen, result: Result) -> None:
    level = result.verdict.level
    if level != "pass":
        screen.say(f"The result is {level}.", style=COLOURS[level])


def _described(
    calibrated: Result, result: Path, log: Path
) -> tuple[LogDescription, Path, dict[str, Any]]:
    """Return how to read a log, from which folder, and which instrument made it.

    A campaign file says it all; one of our own logs describes itself; any other log is read as
    the one that the result came from.
    """
    from foucault import campaign
    from foucault.logs.description import LogDescription, describes_itself

    if log.suffix == ".toml":
        other = campaign.load(log, calibrates=False)
        if isinstance(other.log, LogDescription):
            other.log.whole()
        return other.log, other.folder, other.instrument
    description = LogDescription.model_validate({"file": log.name})
    before = _log_description(calibrated, result)
    if before is not None and len(before.files()) == 1 and not describes_itself(log):
        blocks = {
            key: block.model_copy(update={"file": None})
            for key in ("gyro", "accel", "temperature")
            if (block := getattr(before, key)) is not None
        }
        description = before.model_copy(update={"file": log.name, **blocks})
    return description, log.parent, {}


def _log_description(calibrated: Result, result: Path) -> LogDescription | None:
    """Return how the calibrated log was read, from the campaign or the result itself."""
    from foucault import campaign
    from foucault.logs.description import LogDescription
    from foucault.run_folder import CAMPAIGN_FILE

    kept = (result if result.is_dir() else result.parent) / CAMPAIGN_FILE
    if kept.is_file():
        log = campaign.load(kept).log
        return log if isinstance(log, LogDescription) else None
    said = (calibrated.provenance.get("input") or {}).get("description")
    if not isinstance(said, dict) or "index" in said:  # that of a north seeker
        return None
    if isinstance(said.get("rate"), float):  # a description gives it with its unit
        said = said | {"rate": f"{said['rate']!r} Hz"}
    return LogDescription.model_validate(said)


def _to_export(
    result: Path, noise: Path | None
) -> tuple[Result, ImuNoise | Densities | None, LogDescription | None]:
    """Return a result, its noise (of an Allan run, or declared), and how its log was read."""
    from foucault import campaign
    from foucault.export.densities import is_allan_run, no_calibration, of_allan_run
    from foucault.run_folder import CAMPAIGN_FILE, load_result

    if is_allan_run(result):
        return no_calibration(), of_allan_run(noise or result), None
    calibrated = load_result(result, with_tables=False)
    log = _log_description(calibrated, result)
    if noise is not None:
        return calibrated, of_allan_run(noise), log
    kept = (result if result.is_dir() else result.parent) / CAMPAIGN_FILE
    return calibrated, campaign.load(kept).noise if kept.is_file() else None, log


def _to_apply(file: Path, at: float | None) -> Result:
    """Return the result of a file, at one temperature where that is given [K]."""
    from foucault.run_folder import load_result

    result = load_result(file, with_tables=False)
    if result.procedure == "north_seeking":
        raise error("north.not_applied")
    return result if at is None else result.at(at)


@command(
    "foucault check kalibr_imu.yaml",
    'foucault check fast_lio_imu.yaml --run run --noise static --rate "200 Hz"',
)
def check(
    screen: Screen,
    file: Path,
    run: Path | None = None,
    to: Annotated[str | None, typer.Option("--to")] = None,
    noise: Annotated[Path | None, typer.Option(help=_NOISE)] = None,
    rate: Annotated[Amount | None, _RATE] = None,
    axes: Annotated[str | None, typer.Option(help=_AXES)] = None,
) -> None:
    """Read a receiver's file back, and say what in it looks wrong.

    With the run it came from (--run), the usual mistakes are told for certain; without one, only
    values that no sensor can have.
    """
    from foucault.export.check import checked, mistakes
    from foucault.export.densities import of_allan_run

    result: Result | None = None
    known: ImuNoise | Densities | None = None if noise is None else of_allan_run(noise)
    if run is not None:
        result, known, _ = _to_export(run, noise)
    seen = checked(read_text(file), to, result, noise=known, rate=rate, axes=axes)
    screen.table(
        f"{file.name}, for {seen.receiver.title}",
        ("key", "value", "run", "like", "noticed"),
        [(x.key, x.value, x.run, x.typical, x.said) for x in seen.lines],
        right=(False, False, False, False, False),
    )
    screen.findings(seen.findings)
    if not seen.findings and not any(line.said for line in seen.lines):
        screen.say("Nothing in it is implausible." if run is None else "It says what the run says.")
    screen.data(
        {
            "file": str(file),
            "receiver": seen.receiver.name,
            "lines": [vars(x) for x in seen.lines],
            "findings": [x.as_dict() for x in seen.findings],
        }
    )
    raise typer.Exit(3 if mistakes(seen.findings) else 0)
