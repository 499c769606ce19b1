"""The command `north`: `north READINGS` finds north, `north plan` compares orders of stops."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from foucault.cli import options
from foucault.cli.options import Of, add, command
from foucault.cli.screen import EXIT_CODES, Screen, kept

if TYPE_CHECKING:
    from foucault.diagnose.north_stops import Prediction
    from foucault.errors import Finding
    from foucault.models.noise import ImuNoise
    from foucault.models.north_seeker import Compensation
    from foucault.plans.north_orders import Choice, Row
    from foucault.procedures.north_seeking.settings import Planning


MOST = 12
"""Set-ups whose warnings are written out on the screen."""

FIND = "find"
"""Name of the command that stands behind `north READINGS`."""

SETTINGS = "foucault.procedures.north_seeking.settings:Settings"

_SAID = Of(
    options.SAID,
    only=("latitude", "height", "gravity", "gyro_noise", "accel_noise", "accel_reads", "serial"),
)
_SETTINGS = Of(
    SETTINGS,
    only=("latitude_sd", "unknown_latitude", "hemisphere", "near", "level_sd", "index_sd", "drift",
          "accuracy"),
    above=("latitude_sd", "index_sd"),
    over=True,
)  # fmt: skip


class _North(TyperGroup):
    """`north READINGS` without a word between, `north plan` beside it."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put in the word that is left out."""
        if not args or args[0] not in self.commands:
            args = [FIND, *args]
        return super().parse_args(ctx, args)


class _Find(TyperCommand):
    """A command that goes by the name of its group."""

    def make_context(self, info_name: Any, args: Any, parent: Any = None, **more: Any) -> Any:
        """Leave the word that was put in out of the usage."""
        return super().make_context(parent.info_name, args, parent.parent, **more)


def add_to(app: typer.Typer) -> None:
    """Add the commands to the program."""
    group = typer.Typer(cls=_North, rich_markup_mode=None)
    add(group, find, _Find, hidden=True)
    add(group, plan)
    app.add_typer(
        group, name="north", help="Find north from readings of a north seeker, or plan it."
    )


@command(
    'foucault north readings.csv --latitude "47.3 deg" --calibration run',
    "foucault north campaign.toml --calibration run -o north",
    "foucault north plan --help",
    notes="Titles of a file given alone: setup, time (s), index (deg), gyro (deg/h), "
    "specific force (g), dwell (s). `north plan` says how long to measure. " + options.SITE,
    exits={0: "all set-ups passed", 3: "some did not", 4: "none is usable"},
)
def find(
    ctx: typer.Context,
    readings: Annotated[
        Path,
        typer.Argument(
            help="A campaign file, or a CSV or Parquet file whose titles give the units."
        ),
    ],
    calibration: options.Calibration = None,
    output: options.FolderIfWanted = None,
    said: Annotated[Any, _SAID] = None,
    settings: Annotated[Any, _SETTINGS] = None,
) -> None:
    """Find north: heading, pitch and roll of every set-up.

    With their covariance, what limits them, and the latitude if asked for.
    """
    from foucault.campaign import north
    from foucault.campaign.tables import Said
    from foucault.errors import error

    screen: Screen = ctx.obj
    given_both = [f"--{k.replace('_', '-')}" for k in ("latitude", "latitude_sd")
                  if k in said | settings]  # fmt: skip
    if "unknown_latitude" in settings and given_both:
        raise error("north.latitude_both", given=given_both[0])
    with screen.work(output, "north") as tell:
        survey = north.run(readings, Said(**said), settings, calibration=calibration, progress=tell)
        found = kept(north.record(survey), output)
    setups = found.held[0].about["setups"]
    levels = {setup["verdict"] for setup in setups}
    code = EXIT_CODES[levels.pop() if len(levels) == 1 else "doubtful"]
    raise found.tell(screen, found.held[0].about, *_of_many(setups), code=code)


def _of_many(setups: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return what was noticed at several set-ups, with its cure, and why some did not pass."""
    from foucault.report.page import grouped

    if len(setups) == 1:
        return []
    noticed = grouped([finding for setup in setups for finding in setup["findings"]])
    out = [f"{f['severity']}: {f['message']}\n  {f['cure']}" for f in noticed]
    shared = set.intersection(*(set(setup["reasons"]) for setup in setups))
    left = {s["name"]: [r for r in s["reasons"] if r not in shared] for s in setups}
    bad = [s for s in setups if s["verdict"] != "pass" and left[s["name"]]]
    out += [f"{s['name']} is {s['verdict']}: {' '.join(left[s['name']])}" for s in bad[:MOST]]
    more = f"and {len(bad) - MOST} set-ups more, see --json or -o"
    return out + [more] * (len(bad) > MOST)


# -- The command that plans north seeking: north plan --------------------------------------------

_PLANNED = Of(
    "foucault.procedures.north_seeking.settings:Planning",
    called={"drift_estimated": "drift-estimated/--drift-ignored"},
)
_CHOSEN = Of(
    SETTINGS,
    only=("accuracy", "level_sd", "index_sd", "latitude_sd", "unknown_latitude"),
    over=True,
)

ACCEL = "5 ug/sqrt(Hz)"
"""Noise of the accelerometers where it is not given."""

DRIFT = "0.1 deg/h/h"
"""Drift to show the effect of where it is not given."""

TILTED = "10 deg"
"""Tilt to show the effect of where none is given."""


@command(
    'foucault north plan --latitude "47 deg" --gyro-noise "0.003 deg/sqrt(h)" --accuracy "0.1 deg"',
    'foucault north plan --latitude "-33 deg" --gyro-noise navigation --time "10 min" -o stops.csv',
)
def plan(
    ctx: typer.Context,
    gyro_noise: Annotated[
        str | None,
        typer.Option(
            help='Angle random walk of the gyros, such as "0.003 deg/sqrt(h)", or a grade\'s name.'
        ),
    ] = None,
    noise: Annotated[
        Path | None,
        typer.Option(help="Campaign file whose [noise] is taken, instead of --gyro-noise."),
    ] = None,
    planned: Annotated[Any, _PLANNED] = None,
    chosen: Annotated[Any, _CHOSEN] = None,
    calibration: options.Calibration = None,
    order: Annotated[
        list[str] | None,
        typer.Option(
            metavar="<str>",
            help='Compare only this order, such as palindrome or "8 positions"; may be repeated.',
        ),
    ] = None,
    cycles: Annotated[
        int, typer.Option(help="How often each order of stops is repeated.", min=1, max=100_000)
    ] = 1,
    output: options.TableIfWanted = None,
) -> None:
    """Say how long north seeking takes, and in which order to stop."""
    from foucault import units
    from foucault.diagnose.north_stops import Conditions
    from foucault.errors import error
    from foucault.plans.north_orders import NAMES, Task, compare, write_stops
    from foucault.procedures.north_seeking.fix import require_latitude
    from foucault.procedures.north_seeking.settings import Planning

    screen: Screen = ctx.obj
    asked = Planning(**planned)
    accuracy, level_sd = chosen.get("accuracy"), chosen.get("level_sd")
    if accuracy is None and asked.time is None:
        raise error("north_plan.wanted")
    require_latitude(asked.latitude)
    conditions = Conditions(
        asked.latitude,
        _noise(gyro_noise, noise, asked),
        latitude_sd=chosen.get("latitude_sd", 0.0),
        latitude_known="unknown_latitude" not in chosen,
        tilt=asked.tilt,
        drift=asked.drift or 0.0,
        drift_estimated=asked.drift_estimated,
        index_sd=chosen.get("index_sd", 0.0),
        level_sd=level_sd,
        compensation=_compensation(calibration),
    )
    for option, fine, with_what in (
        ("--drift-ignored", asked.drift_estimated or asked.drift is not None, "given with --drift"),
        ("--latitude-sd", conditions.latitude_known or not conditions.latitude_sd,
         "left out with --unknown-latitude"),
        ("--tilt", level_sd is None or not asked.tilt, "left out with --level-sd"),
        ("--accel-noise", level_sd is None or asked.accel_noise is None,
         "left out with --level-sd"),
        ("--tilt", asked.tilt < math.radians(89.0), "below 89 deg"),
    ):  # fmt: skip
        _refuse(option, fine, with_what)
    task = Task(conditions, accuracy, asked.time, asked.move, asked.rough)
    choice = compare(task, order or NAMES, cycles)
    if output is not None:
        write_stops(choice.best.order, choice.best.time, task.move, output)
    _show_plans(screen, choice, asked.drift or units.parse(DRIFT, "rate ramp"), output)


def _refuse(option: str, fine: bool, allowed: str) -> None:
    from foucault.errors import error

    if not fine:
        raise error("north_plan.range", option=option, given="given", allowed=allowed)


def _noise(gyro: str | None, file: Path | None, asked: Planning) -> ImuNoise:
    """Return the noise of a grade, of a campaign, or of what was given of it."""
    from dataclasses import replace

    from foucault import campaign, units
    from foucault.errors import error
    from foucault.models.noise import GRADES, ImuNoise, TriadNoise, grade

    if (gyro is None) == (file is None):
        given = "Nothing says" if gyro is None else "Both --gyro-noise and --noise say"
        raise error("north_plan.gyro", given=given, grades=", ".join(GRADES))
    slow = ("bias_instability", "correlation_time", "random_walk")
    more = asked.model_dump(
        include={f"gyro_{key}" for key in slow} | {"accel_noise"}, exclude_none=True
    )
    if file is not None:
        for key in more:
            raise error("north_plan.noise_option", option=f"--{key.replace('_', '-')}")
        found = campaign.load(file).noise
        if found is None:
            raise error(
                "north_plan.gyro", given=f"Nothing in '{file}' says", grades=", ".join(GRADES)
            )
    elif gyro in GRADES:
        found = grade(str(gyro)).noise
    else:
        white = units.parse(gyro, "angle random walk", "--gyro-noise")
        forces = units.parse(ACCEL, "velocity random walk")
        found = ImuNoise(TriadNoise(white=forces), TriadNoise(white=white))
    accel = {"white": more.pop("accel_noise")} if "accel_noise" in more else {}
    found = ImuNoise(
        replace(found.accel, **accel),
        replace(found.gyro, **{key.removeprefix("gyro_"): value for key, value in more.items()}),
    )
    _refuse(
        "--gyro-correlation-time",
        asked.gyro_correlation_time is None or found.gyro.bias_instability > 0,
        "given with --gyro-bias-instability",
    )
    if not found.gyro.white > 0:
        raise error("north_plan.no_noise", given=gyro or "zero")
    return found


def _compensation(path: Path | None) -> Compensation:
    from foucault.errors import error
    from foucault.models.north_seeker import Compensation
    from foucault.run_folder import load_result

    if path is None:
        return Compensation()
    result = load_result(path, with_tables=False).numbers()
    if result.procedure != "north_seeking":
        raise error("north.other_result", file=path, given=result.procedure)
    return Compensation(result.coefficients, str(result.instrument.get("serial") or ""))


# -- what is shown -------------------------------------------------------------------------


def _show_plans(screen: Screen, choice: Choice, drift: float, output: Path | None) -> None:
    from foucault import units

    task, best = choice.task, choice.best
    tilted = _tilted(choice)
    findings = _findings(choice)
    wanted = () if task.accuracy is None else (f"minutes for {_angle(task.accuracy)}",)
    time = () if task.total is None else (f"sd in {_minutes(task.total)} min",)
    ramp = f"{units.convert(drift, 'rate ramp', 'deg/h/h'):.4g} deg/h/h"
    screen.table(
        "",
        ("order", *wanted, *time, f"error by {ramp} of drift", "needs"),
        [_cells(row, choice, drift) for row in choice.rows],
    )
    screen.say(*_advice(choice), "")
    if best.at is not None:
        screen.table("what the sd is made of, of the recommended order", ("source", "sd", "share"),
                     _budget(best.at))  # fmt: skip
    if tilted is not None:
        screen.say(f"Tilted by up to {TILTED}, with the tilt measured: {_angle(tilted)}.")
    screen.findings(findings)
    if output is not None:
        screen.say(f"Stops: {output}")
    screen.data(_document(choice, drift, tilted, findings, output))


def _tilted(choice: Choice) -> float | None:
    """Return the sd of the recommended order with a tilt, where none was given [rad]."""
    from dataclasses import replace

    from foucault import units
    from foucault.plans.north_orders import at_time

    c, best = choice.task.conditions, choice.best
    if c.tilt or c.level_sd is not None or best.at is None:
        return None
    other = replace(choice.task, conditions=replace(c, tilt=units.parse(TILTED, "angle")))
    return at_time(best.order, best.time, other, drift=False).sd


def _cells(row: Row, choice: Choice, drift: float) -> list[str]:
    cells = [row.order.name]
    if choice.task.accuracy is not None:
        cells.append(_minutes(row.needed) if math.isfinite(row.needed) else _floor(row))
    if choice.task.total is not None:
        cells.append(row.why if row.at is None else _angle(row.sd))
    cells.append("" if row.at is None else _angle(row.drift_error * drift))
    return [*cells, row.order.needs]


def _floor(row: Row) -> str:
    if row.floor is None:
        return row.why
    return f"not reachable: floor {_angle(row.floor.sd)} from {row.limit}"


def _advice(choice: Choice) -> list[str]:
    """Which order to use, and why."""
    task, best = choice.task, choice.best
    how = f"Use {best.order.name}: {choice.reason}."
    what = f"{_minutes(best.time)} minutes give {_angle(best.sd)} (1 sd)"
    per = _per_stop(best, task.move)
    out = [how, f"{what}{', ' + per if per else ''}."]
    if task.accuracy is not None and not math.isfinite(best.needed):
        out.append(f"{_angle(task.accuracy)} is {_floor(best)}.")
    if choice.beyond is not None:
        better = choice.beyond
        gain = f"{_angle(better.sd)} in {_minutes(better.time)} minutes"
        out.append(f"With {better.order.needs}, {better.order.name} gives {gain}.")
    if choice.repeats is not None:
        times, sd = choice.repeats
        out.append(
            f"Gone through {times} times in the same time (--cycles {times}) it gives "
            f"{_angle(sd)}: slow noise of the gyro does less to shorter stops."
        )
    return out


def _per_stop(row: Row, move: float) -> str:
    from foucault.plans.north_orders import StopOrder

    if not isinstance(row.order, StopOrder):
        return ""
    lengths = row.order.stops(row.time, move)
    return f"{_range(float(lengths.min()), float(lengths.max()))} per stop"


def _range(least: float, most: float) -> str:
    return f"{least:.0f} s" if most - least < 0.5 else f"{least:.0f} to {most:.0f} s"


def _budget(at: Prediction) -> list[tuple[str, ...]]:
    whole = sum(at.sources.values())
    rows = sorted(at.sources.items(), key=lambda item: -item[1])
    return [(n, _angle(math.sqrt(v)), f"{v / whole:.1%}") for n, v in rows if v > 1e-6 * whole]


def _findings(choice: Choice) -> list[Finding]:
    from foucault.errors import finding
    from foucault.plans.north_orders import SEEN, SHORTEST

    task, best = choice.task, choice.best
    out = []
    minutes = _minutes(best.time)
    if choice.signal < SEEN:
        factor = SEEN / choice.signal
        out.append(finding(
            "north_plan.gyro_noisy", minutes=minutes, ratio=f"{1 / choice.signal:.2g}",
            factor=f"{factor:.2g}", longer=f"{factor**2:.2g}",
        ))  # fmt: skip
    if task.accuracy is not None and task.total is not None and best.sd > task.accuracy:
        cure = f"The accuracy is {_floor(best)}."
        if math.isfinite(best.needed):
            from dataclasses import replace

            longer = replace(best, time=max(best.needed, best.order.shortest(task.move, SHORTEST)))
            use = _per_stop(longer, task.move).replace(" per", " for each")
            cure = f"Use at least {use or 'that long'}: {_minutes(longer.time)} minutes in all."
        out.append(finding(
            "north_plan.dwell_short", minutes=minutes, stop=_per_stop(best, task.move) or "turning",
            sd=_angle(best.sd), accuracy=_angle(task.accuracy), cure=cure,
        ))  # fmt: skip
    return out


def _angle(value: float) -> str:
    """Write an angle in degrees."""
    from foucault import units

    degrees = math.degrees(value)
    if not degrees < 90.0:
        return "more than 90 deg"
    return "0 deg" if degrees < 1e-9 else f"{units.plain(degrees, 3)} deg"


def _minutes(seconds: float) -> str:
    return f"{math.ceil(seconds / 6 - 1e-6) / 10:g}"  # upwards, in tenths


def _document(
    choice: Choice, drift: float, tilted: float | None, findings: list[Finding],
    output: Path | None,
) -> dict[str, Any]:  # fmt: skip
    """All of it as JSON: angles in rad, times in s."""
    return {
        "orders": [row.as_dict(choice.task.move, drift) for row in choice.rows],
        "recommended": choice.best.order.name,
        "reason": choice.reason,
        "advice": _advice(choice),
        "tilted_sd": tilted,
        "findings": [f.as_dict() for f in findings],
        "file": None if output is None else str(output),
    }
