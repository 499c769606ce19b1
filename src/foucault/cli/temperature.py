"""The command for coefficients that change with temperature."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foucault.cli import words
from foucault.cli.options import parsed
from foucault.cli.screen import COLOURS, EXIT_CODES, Screen

if TYPE_CHECKING:
    from foucault.procedures.temperature import Ramp, Session
    from foucault.result import Result


def add_to(app: typer.Typer) -> None:
    """Add the command to the program."""
    app.command(
        "temperature",
        epilog=words.epilog(
            "foucault temperature cold room hot -o model",
            'foucault temperature cold room hot -o model --at "cold=-20 degC"',
            'foucault temperature cold room hot -o model --scatter "gyro.bias=5 deg/h"',
            "foucault temperature room --ramp warming.toml -o model",
            "foucault apply model log.csv -o compensated.csv",
            exits=words.VERDICT,
        ),
    )(temperature)


def temperature(
    ctx: typer.Context,
    results: words.ResultFiles,
    output: words.RunFolder,
    at: Annotated[
        list[str] | None,
        typer.Option(
            metavar="<str>",
            help="RESULT=TEMPERATURE, where its log does not say it; may be repeated.",
        ),
    ] = None,
    order: Annotated[
        list[str] | None,
        typer.Option(
            metavar="<str>",
            help="Highest power of temperature: 2, or FAMILY=2; may be repeated. The results "
            "tell it if left out.",
        ),
    ] = None,
    knots: Annotated[
        str | None,
        typer.Option(help='Straight lines between knots, such as "-20 degC, 20 degC, 60 degC".'),
    ] = None,
    scatter: Annotated[
        list[str] | None,
        typer.Option(
            metavar="<str>",
            help="FAMILY=SD from one switch-on to the next, or none; may be repeated. The "
            "results tell it if left out.",
        ),
    ] = None,
    ramp: Annotated[
        list[Path] | None,
        typer.Option(
            help="A log at rest in one position while the temperature changes, or a campaign that "
            "describes it; may be repeated."
        ),
    ] = None,
    reference: Annotated[
        str | None, typer.Option(help="Temperature that powers count from; the middle if left out.")
    ] = None,
    margin: Annotated[
        str, typer.Option(help="How far beyond the temperatures seen the functions are to hold.")
    ] = "0 K",
    in_order: Annotated[
        bool,
        typer.Option(
            "--in-order",
            help="The results are in the order they were made in: compare heating with cooling.",
        ),
    ] = False,
) -> None:
    """Fit coefficients as functions of temperature.

    To calibrations at several temperatures, to a slow ramp, or to both.
    """
    from foucault import report, run_folder
    from foucault.files import alone, beside
    from foucault.procedures import temperature as procedure

    screen: Screen = ctx.obj
    settings = procedure.Settings(
        orders=_orders(order or []),
        knots=_knots(knots),
        scatter=_scatters(scatter or []),
        visited=in_order,
        **parsed({"reference": reference, "margin": margin}),
    )
    with alone(output), screen.progress() as tell:
        tell(0.0, "reading the results")
        sessions = _sessions(results, at or [])
        ramps = [_ramp(path, tell) for path in ramp or []]
        tell(0.5, "fitting")
        result = procedure.calibrate(sessions, settings, ramps)
        tell(0.8, "writing the report")
        run_folder.save(result, output)
        with beside(output):
            page = report.write(output)
    _show(screen, result, sessions)
    screen.say(f"Report: {page}")
    screen.data({"folder": str(output), "report": str(page), "result": _document(output)})
    raise typer.Exit(EXIT_CODES[result.verdict.level])


def _sessions(results: Sequence[Path], at: Sequence[str]) -> list[Session]:
    """Read the results with their temperatures."""
    from foucault.campaign.mistakes import parse_at
    from foucault.errors import error
    from foucault.procedures.temperature import Session
    from foucault.run_folder import load_result

    names = [str(path) for path in results]
    declared: dict[str, float] = {}
    for text in at:
        name, equals, value = text.rpartition("=")
        # A name as it was given, or the last part of a path.
        found = [n for n in names if name.strip() in (n, Path(n).name)]
        if not equals or len(found) != 1:
            raise error("temperature.at", given=text, allowed=", ".join(names))
        if found[0] in declared:
            raise error("temperature.at_twice", name=found[0])
        declared[found[0]] = parse_at("--at", value.strip(), "temperature")
    return [
        Session.of(name, load_result(path, with_tables=False), declared.get(name))
        for name, path in zip(names, results, strict=True)
    ]


def _ramp(path: Path, tell: Any) -> Ramp:
    from foucault.cli.sessions import read_any
    from foucault.procedures.temperature import Ramp

    log = read_any(path, lambda done, words: tell(0.4 * done, words), whole=True)
    return Ramp.of(str(path), log)


def _orders(given: Sequence[str]) -> dict[str, int]:
    from foucault.errors import error

    out = {}
    for text in given:
        family, _, power = text.rpartition("=")
        if power.strip() not in tuple("0123456789"):
            example = "--order 2, or --order gyro.bias=2, with a power from 0 to 9"
            raise error("temperature.assignment", option="--order", given=text, example=example)
        out[family.strip()] = int(power)
    return out


def _knots(given: str | None) -> tuple[float, ...]:
    from foucault.campaign.mistakes import parse_at

    if given is None:
        return ()
    return tuple(parse_at("--knots", part.strip(), "temperature") for part in given.split(","))


def _scatters(given: Sequence[str]) -> dict[str, float]:
    from foucault.campaign.mistakes import parse_at
    from foucault.errors import error
    from foucault.models.layouts import EVERY

    out = {}
    for text in given:
        family, equals, value = (part.strip() for part in text.partition("="))
        if text.strip() == "none":
            out[""] = 0.0
            continue
        if not equals:
            raise error("temperature.assignment", option="--scatter", given=text,
                        example='--scatter "gyro.bias=5 deg/h", or --scatter none')  # fmt: skip
        kind = EVERY.coefficients[int(EVERY.group(family)[0])].kind
        out[family] = abs(parse_at("--scatter", value, kind))
    return out


def _show(screen: Screen, result: Result, sessions: Sequence[Session]) -> None:
    """Print what was found of every family."""
    from foucault import units
    from foucault.models.layouts import EVERY

    model = result.temperature
    assert model is not None
    rows = []
    for row in result.diagnostics["families"]:
        kind = EVERY.coefficients[int(EVERY.group(row["family"])[0])].kind
        sd = float(row["scatter"])
        unit = units.display_unit(kind, sd if sd == sd else 0.0)
        size = f"{units.plain(units.convert(sd, kind, unit), 2)} {unit}" if sd == sd else "unknown"
        how = "" if sd != sd or row["scatter_found"] else " (declared)"
        rows.append((row["family"], str(row["temperatures"]), row["function"], size + how))
    screen.table("", ("family", "temperatures", "function", "scatter"), rows)
    low, high = (units.convert(v, "temperature", "degC") for v in (model.low, model.high))
    at = units.convert(model.reference, "temperature", "degC")
    screen.say(f"Valid from {low:.2f} to {high:.2f} degC. At {at:.2f} degC:", result.coefficients)
    screen.findings(result.findings)
    level = result.verdict.level
    screen.say("", f"verdict: {level}", style=COLOURS[level])
    screen.say(*(f"  {reason}" for reason in result.verdict.reasons))


def _document(folder: Path) -> Any:
    import json

    from foucault.run_folder import RESULT_FILE

    return json.loads((folder / RESULT_FILE).read_text(encoding="utf-8"))
