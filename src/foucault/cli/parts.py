"""The command about data sheets of common instruments: parts."""

from __future__ import annotations

from typing import Annotated

import typer

from foucault.cli.options import command
from foucault.cli.screen import Screen


@command("foucault parts", "foucault parts ICM-20948")
def parts(
    screen: Screen,
    name: Annotated[str | None, typer.Argument()] = None,
) -> None:
    """List instruments known by data sheet, or what one sheet says."""
    if name is None:
        _all(screen)
    else:
        _one(screen, name)


def _all(screen: Screen) -> None:
    from foucault.models.parts import as_dict, catalogue, noise_of, sizes_of

    screen.table(
        "instruments by their data sheets",
        ("part", "maker", "grade", "numbers", "noise", "sizes of what is left out"),
        [
            (name, p.maker, p.grade, str(len(p.numbers)),
             "-" if noise_of(name) is None else "stated", ", ".join(sizes_of(name)) or "-")
            for name, p in catalogue().items()
        ],
        right=(False, False, False, True, False, False),
    )  # fmt: skip
    screen.say(
        "The numbers of one, with source, page and wording: foucault parts NAME",
        'In a campaign: [noise] part = "NAME"; foucault init PROCEDURE --part NAME writes it.',
    )
    screen.data({"parts": [as_dict(name) for name in catalogue()]})


def _one(screen: Screen, name: str) -> None:
    from foucault.models.parts import QUANTITIES, as_dict, noise_basis, part, size_text, sizes_of

    known = part(name)
    screen.say(f"{known.name}, {known.maker}: {known.grade}")
    screen.table(
        "what the data sheet says",
        ("number", "value", "meant as", "page", "wording"),
        [
            (key, s.text + (f" of {s.over}" if s.over else ""), s.meant, s.page, s.quote)
            for key, s in known.numbers.items()
        ],
        right=(False, True, False, False, False),
    )
    unknown = ", ".join(key for key in QUANTITIES if key not in known.numbers)
    screen.say(f"Not stated, or on a page that was not at hand: {unknown}.")
    for source in dict.fromkeys(known.sources.values()):
        second = "" if source.primary else " (not the data sheet itself)"
        screen.say(f"Source{second}: {source.title}; {source.address}")
    for triad, basis in noise_basis(known.name).items():
        screen.say(f"Noise of {triad}: {basis}")
    if sizes := sizes_of(known.name):
        screen.table(
            "sizes of terms that a calibration leaves out, one standard deviation",
            ("group", "size", "from"),
            [(group, size_text(group, size), basis) for group, (size, basis) in sizes.items()],
            right=(False, True, False),
        )
    screen.data(as_dict(known.name))
