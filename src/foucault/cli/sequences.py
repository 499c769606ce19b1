"""What the command plans says of the sequences of systematic calibration."""

from __future__ import annotations

from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any

from foucault.cli.screen import Screen

if TYPE_CHECKING:
    from foucault.plans.systematic.sequence import CalibrationSequence
    from foucault.procedures.systematic.quick import Stills

MODEL = "systematic"
"""What the command calls them."""

LATITUDE = 45.0
"""Where it is said what a sequence shows [deg]."""

CLASS = "navigation"
"""With the noise of which class."""


def sequences(screen: Screen, name: str | None, steps: bool, output: Path | None) -> None:
    """List the built-in sequences and what they show, or print one for the one who turns the table.

    Parameters
    ----------
    screen : Screen
        Where to print.
    name : str or None
        A built-in sequence, several joined by " + ", a file of a sequence, or a campaign.
    steps : bool
        Whether the actions of one are printed.
    output : Path or None
        CSV file for the actions, or TOML.
    """
    from foucault.errors import error

    if name is not None:
        _one(screen, sequence_of(name), steps, output)
    elif output is not None:
        raise error("plan.which", path=output)
    else:
        _all(screen)


def sequence_of(name: str) -> CalibrationSequence:
    """Return the sequence that `name` stands for."""
    from foucault import campaign
    from foucault.errors import error
    from foucault.plans.systematic.built_in import built_in
    from foucault.plans.systematic.file import read_sequence
    from foucault.plans.systematic.sequence import CalibrationSequence
    from foucault.procedures.systematic.settings import planned

    path = Path(name)
    if path.suffix.lower() != ".toml":
        return reduce(
            CalibrationSequence.then, [built_in(part.strip()) for part in name.split("+")]
        )
    if not _is_campaign(path):
        return read_sequence(path)
    asked = campaign.load(path)
    if asked.procedure != MODEL:
        raise error("sequence.campaign", path=path, procedure=asked.procedure)
    return planned(asked.settings, asked.session)


def _is_campaign(path: Path) -> bool:
    from foucault.files import parse_toml, read_text

    try:
        return "procedure" in parse_toml(read_text(path))
    except (OSError, ValueError):
        return False  # the reader of sequences says why


def _all(screen: Screen) -> None:
    from math import radians

    from foucault.models.deflection import MODELS
    from foucault.models.earth import Site
    from foucault.models.noise import grade
    from foucault.plans.systematic.built_in import BUILT_IN
    from foucault.procedures.systematic.foresight import shown

    site, noise = Site.at(radians(LATITUDE)), grade(CLASS).noise
    rows, ranks, documents = [], [], []
    kept: Stills = {}
    for name, make in BUILT_IN.items():
        whole = f"19 positions + {name}" if name.startswith("spins") else name
        s = sequence_of(whole)
        (seen, count), models = shown(s, site, noise, kept)
        demands = _demands(make())
        rows.append((name, *demands, f"{seen} of {count}"))
        ranks.append((whole, *(f"{told}/{n}" for told, n in models.values())))
        documents.append(_document(make()) | {
            "judged": whole, "errors": [seen, count], "deflection": models,
        })  # fmt: skip
    screen.table(
        "sequences of systematic calibration",
        ("sequence", "rests", "turns", "time (min)", "fastest (deg/s)", "errors shown"),
        rows,
    )
    screen.table(
        "combinations of the deflection of dithered gyros that are told better than 3 arcsec/g",
        ("sequence", *MODELS), ranks,
    )  # fmt: skip
    screen.say(
        f"At {LATITUDE:.0f} deg of latitude, with the noise of a {CLASS} grade instrument. Spins "
        "are judged after the 19 positions: they begin without a rest.",
        "Actions: foucault plans --model systematic NAME. Better ones: foucault optimise.",
    )
    screen.data({"model": MODEL, "sequences": documents})


def _demands(s: CalibrationSequence) -> tuple[str, str, str, str]:
    from math import degrees

    fastest = max((getattr(a, "rate", 0.0) for a in s.actions), default=0.0)
    return (
        str(len(s.positions)), str(len(s.moves)), f"{s.duration / 60:.1f}",
        f"{degrees(fastest):.4g}",
    )  # fmt: skip


def _document(s: CalibrationSequence) -> dict[str, Any]:
    return {
        "name": s.name, "rests": len(s.positions), "turns": len(s.moves), "duration": s.duration,
        "fastest": max((getattr(a, "rate", 0.0) for a in s.actions), default=0.0),
    }  # fmt: skip


def _one(screen: Screen, s: CalibrationSequence, steps: bool, output: Path | None) -> None:
    from foucault.plans.systematic.sequence import pointing
    from foucault.plans.systematic.steps import rows, write_steps

    if output is not None:
        write_steps(s, output)
    rests, turns, minutes, fastest = _demands(s)
    screen.say(
        f"{s.name}: {rests} rests and {turns} turns in {minutes} min, at most {fastest} deg/s.",
        f"It starts with x, y, z to {', '.join(pointing(s.start))}.",
    )
    headings, *lines = rows(s)
    if steps:
        screen.table("", headings, lines)
    if output is not None:
        screen.say(f"Actions: {output}")
    screen.data(_document(s) | {"headings": headings, "actions": lines})
