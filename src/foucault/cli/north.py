"""The command `north`: `north READINGS` finds north, `north plan` compares orders of stops."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from foucault.cli import options
from foucault.cli.options import Of, add, command
from foucault.cli.screen import EXIT_CODES, Screen, kept
from foucault.errors import error

if TYPE_CHECKING:
    from foucault.errors import Finding
    from foucault.models.noise import ImuNoise
    from foucault.models.north_seeker import Compensation
    from foucault.plans.north_orders import Choice
    from foucault.procedures.north_seeking.settings import Planning


MOST = 12  # Set-ups whose warnings are written out on the screen.
FIND = "find"  # Name of the command that stands behind `north READINGS`.

SETTINGS = "foucault.procedures.north_seeking.settings:Settings"

_SAID = Of(
    options.SAID,
    only=("latitude", "longitude", "height", "gravity", "gyro_noise", "accel_noise", "accel_reads",
          "date", "grid", "serial"),
)  # fmt: skip
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
    screen: Screen,
    readings: Path,
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
    from foucault.models.norths import refuse_unknown

    given_both = [f"--{k.replace('_', '-')}" for k in ("latitude", "latitude_sd")
                  if k in said | settings]  # fmt: skip
    refuse_unknown(said.get("date"), said.get("grid"))
    if "unknown_latitude" in settings and given_both:
        raise error("north.latitude_both", given=given_both[0])
    with screen.work(output, "north") as tell:
        survey = north.run(readings, Said(**said), settings, calibration=calibration, progress=tell)
        found = kept(north.record(survey), output)
    about = found.held[0].about
    setups = about["setups"]
    levels = {*about.get("of", {}).get("verdicts", ()), *(setup["verdict"] for setup in setups)}
    code = EXIT_CODES[levels.pop() if len(levels) == 1 else "doubtful"]
    raise found.tell(screen, about, *_of_many(about), code=code)


def _of_many(about: Mapping[str, Any]) -> list[str]:
    """Return what was noticed at several set-ups, with its cure, and why some did not pass."""
    from foucault.report.page import grouped

    setups = about["setups"]
    of_kept = f" of the {len(setups)} worst of {about['of']['setups']}" if "of" in about else ""
    if len(setups) == 1:
        return []
    noticed = grouped([finding for setup in setups for finding in setup["findings"]])
    out = [f"{f['severity']}: {f['message']}\n  {f['cure']}" for f in noticed]
    shared = set.intersection(*(set(setup["reasons"]) for setup in setups))
    left = {s["name"]: [r for r in s["reasons"] if r not in shared] for s in setups}
    bad = [s for s in setups if s["verdict"] != "pass" and left[s["name"]]]
    out += [f"{s['name']} is {s['verdict']}: {' '.join(left[s['name']])}" for s in bad[:MOST]]
    more = f"and {len(bad) - MOST} set-ups more{of_kept}, see --json or -o"
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

ACCEL = "5 ug/sqrt(Hz)"  # Noise of the accelerometers where it is not given.
DRIFT = "0.1 deg/h/h"  # Drift to show the effect of where it is not given.


@command(
    'foucault north plan --latitude "47 deg" --gyro-noise "0.003 deg/sqrt(h)" --accuracy "0.1 deg"',
    'foucault north plan --latitude "-33 deg" --gyro-noise navigation --time "10 min" -o stops.csv',
)
def plan(
    screen: Screen,
    gyro_noise: str | None = None,
    noise: Path | None = None,
    planned: Annotated[Any, _PLANNED] = None,
    chosen: Annotated[Any, _CHOSEN] = None,
    calibration: options.Calibration = None,
    order: Annotated[list[str] | None, typer.Option(metavar="<str>")] = None,
    cycles: Annotated[int, typer.Option(min=1, max=100000)] = 1,
    output: options.TableIfWanted = None,
) -> None:
    """Say how long north seeking takes, and in which order to stop."""
    from foucault import units
    from foucault.plans.north_orders import NAMES, Task, compare, write_stops
    from foucault.plans.north_stops import Conditions
    from foucault.procedures.north_seeking.fix import require_latitude
    from foucault.procedures.north_seeking.settings import Planning
    from foucault.report import planned as report

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
    drift = asked.drift or units.parse(DRIFT, "rate ramp")
    tilted, noticed = report.tilted(choice), report.noticed(choice)
    where = [] if output is None else [f"Stops: {output}"]
    data = _document(choice, drift, tilted, noticed, output)
    raise screen.tell(report.north(choice, drift, tilted, noticed), data, *where)


def _refuse(option: str, fine: bool, allowed: str) -> None:
    if not fine:
        raise error("north_plan.range", option=option, given="given", allowed=allowed)


def _noise(gyro: str | None, file: Path | None, asked: Planning) -> ImuNoise:
    """Return the noise of a grade, of a campaign, or of what was given of it."""
    from foucault import campaign, units
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
    from foucault.models.north_seeker import Compensation
    from foucault.run_folder import load_result

    if path is None:
        return Compensation()
    result = load_result(path, with_tables=False).numbers()
    if result.procedure != "north_seeking":
        raise error("north.other_result", file=path, given=result.procedure)
    return Compensation(result.coefficients, str(result.instrument.get("serial") or ""))


def _document(
    choice: Choice, drift: float, tilted: float | None, findings: list[Finding],
    output: Path | None,
) -> dict[str, Any]:  # fmt: skip
    """All of it as JSON: angles in rad, times in s."""
    from foucault.report import planned as report

    return {
        "orders": [row.as_dict(choice.task.move, drift) for row in choice.rows],
        "recommended": choice.best.order.name,
        "reason": choice.reason,
        "advice": report.advice(choice),
        "tilted_sd": tilted,
        "findings": [f.as_dict() for f in findings],
        "file": None if output is None else str(output),
    }
