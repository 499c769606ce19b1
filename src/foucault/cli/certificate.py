"""The commands `foucault certify` and `foucault verify`."""

from __future__ import annotations

import os
import sys
from contextlib import closing, nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foucault.cli import options
from foucault.cli.options import command
from foucault.cli.screen import EXIT_CODES, Screen

if TYPE_CHECKING:
    from foucault.certificate.issue import Issued
    from foucault.certificate.signature import Key
    from foucault.certificate.verify import Found
    from foucault.records import Records

PASSWORD = "FOUCAULT_KEY_PASSWORD"  # Environment variable with the password of a key.

Kept = Annotated[
    str | None,
    typer.Option(
        "--records",
        help="Records that know the run and its references and keep what was issued: a file or an "
        "address; none if left out.",
    ),
]


@command(
    "foucault certify run laboratory.toml job.toml -o certificates --key laboratory.p12",
    "foucault certify run laboratory.toml job.toml -o certificates --records records.sqlite",
    'foucault certify run laboratory.toml job.toml -o certificates --reviewer "A. Noether" '
    '--reason "one rest was bumped, and left out"',
    "foucault certify run laboratory.toml job.toml -o certificates "
    '--replaces certificates/2026-7.pdf --change "name of the customer"',
    notes="The password of the key is asked for, or taken from FOUCAULT_KEY_PASSWORD.",
)
def certify(
    screen: Screen,
    result: options.ResultFile,
    files: list[Path],
    output: Annotated[Path, typer.Option("-o", "--output")],
    key: Path | None = None,
    issued: str = "",
    reviewer: str = "",
    reason: str = "",
    replaces: Path | None = None,
    change: str = "",
    records: Kept = None,
    who: str = "",
) -> None:
    """Write the certificate of a run: a page and a DCC, signed.

    By ISO/IEC 17025; one that lacks an item is refused.
    """
    from foucault.certificate import issue

    for given, other, both in (
        ("--reviewer", "--reason", (reviewer, reason)),
        ("--replaces", "--change", (replaces, change)),
    ):
        if bool(both[0]) != bool(both[1]):
            from foucault.errors import error

            names = (given, other) if both[0] else (other, given)
            raise error("certificate.together", given=names[0], other=names[1])
    signer = None if key is None else _key(key)
    with _opened(records, who) as kept, screen.progress() as tell:
        tell(0.1, "gathering what it says")
        done = issue.issue(
            result, files, output, key=signer, issued=issued, reviewer=reviewer, reason=reason,
            replaces=replaces, change=change, records=kept,
        )  # fmt: skip
    _told(screen, done)


def _opened(where: str | None, who: str) -> Any:
    """Return the records, closed at the end of a block; None without any."""
    if where is None:
        return nullcontext()

    from foucault.records import Records

    records: Records = Records(where, who=who)
    return closing(records)


def _key(path: Path) -> Key:
    from foucault.certificate import signature

    password = os.environ.get(PASSWORD)
    if password is None and sys.stdin.isatty():
        password = typer.prompt(f"Password of {path}", hide_input=True, default="", err=True,
                                show_default=False)  # fmt: skip
    return signature.load(path, password or "")


def _told(screen: Screen, done: Issued) -> None:
    screen.say(f"Certificate {done.number}: {done.page} and {done.dcc}")
    if done.replaces:
        screen.say(f"It replaces {done.replaces}.")
    screen.say(f"Signed by {done.signer}." if done.signer else "Not signed: give a key with --key.")
    if done.entry:
        screen.say(f"Kept in the records as entry {done.entry}.")
    screen.data(asdict(done))


@command(
    "foucault verify 2026-7.pdf --trust laboratory.pem",
    "foucault verify 2026-7.xml --trust laboratory.pem --records records.sqlite",
    exits={
        0: "as it was signed, by a key that is trusted and valid",
        3: "as it was signed; by whom is open, or the key has expired",
        4: "changed, not signed, or replaced",
    },
)
def verify(
    screen: Screen,
    file: Path,
    trust: Path | None = None,
    records: Kept = None,
) -> None:  # fmt: skip
    """Check that a certificate is as it was signed, and by whom."""
    from foucault.certificate.verify import verify as look

    with _opened(records, "") as kept:
        found = look(file, trust)
        known, wrong = ("", []) if kept is None else _kept(kept, found)
    faults = [*found.faults, *wrong]
    level = "unusable" if faults else str(found.level)
    word = {"pass": "valid", "doubtful": "valid, but look at it", "unusable": "not valid"}[level]
    issued = f", issued on {found.issued}" if found.issued else ""
    screen.say(f"Certificate {found.number or 'without a number'}{issued}", style="bold")
    for seal in found.seals:
        at = "at an unknown time" if seal.at is None else f"on {seal.at:%Y-%m-%d %H:%M:%S %Z}"
        screen.say(f"{seal.what}: signed by {seal.signer} {at}; key {seal.fingerprint[:16]}")
    for line in (*faults, *found.doubts, *filter(None, (known,))):
        screen.say(f"  {line}")
    screen.say(f"verdict: {word}")
    screen.data(asdict(found) | {"level": level, "faults": faults, "records": known})
    raise typer.Exit(EXIT_CODES[level])


def _kept(records: Records, found: Found) -> tuple[str, list[str]]:
    """Return what the records say of a certificate, and what is wrong by them."""
    every = records.certificates()
    mine = next((c for c in every if c.certificate == found.number), None)
    if mine is None:
        return "", [f"the records know no certificate {found.number}"]
    if found.sha256 not in (mine.page, mine.dcc):
        return "", ["it is not the file that was issued, byte for byte"]
    later = next((c for c in every if c.replaces == mine.certificate), None)
    if later is not None:
        return "", [f"it was replaced by {later.certificate} on {later.issued}"]
    return "the records know it, and nothing has replaced it", []
