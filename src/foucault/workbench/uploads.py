"""Logs that are sent in: into a folder by the hash of what they hold, whole or not at all."""

from __future__ import annotations

import gzip
import hashlib
import shutil
import tempfile
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any, Protocol

from foucault.errors import error
from foucault.workbench.asked import check_campaign, safe_name

LARGEST = 2 << 30
"""Of what is sent in at once [byte]."""

SPARE = 256 << 20
"""Left free on the disk [byte]."""

MANY = 12
"""Files at once [1]."""

DENSE, HARMLESS = 200, 64 << 20
"""What is packed closer than so many times is no log, where it unpacks to more than so much [1],
[byte]; logs of text are packed closer by 3 to 20."""

_PIECE = 1 << 20


class Sent(Protocol):
    """A file as a form brings it."""

    file: Any

    @property
    def filename(self) -> str | None:
        """What its sender calls it."""
        ...


def take_in(folder: Path, sent: Sequence[Sent], into: str = "logs") -> str:
    """Keep files that were recorded together; returns the name of their log.

    `into`: folder for them, below `folder`. The same files a second time are the same log. Raises
    ``workbench.no_file``, ``workbench.space``, ``workbench.outside``, ``workbench.bomb``.
    """
    files = [one for one in sent if one.filename]
    if not files or len(files) > MANY:
        raise error("workbench.no_file", given=len(files), most=MANY)
    logs = folder / into
    logs.mkdir(exist_ok=True, parents=True)
    held = Path(tempfile.mkdtemp(prefix=".", dir=logs))
    try:
        whole = hashlib.sha256()
        named: set[str] = set()
        for one in files:
            name = _alone(safe_name(str(one.filename)), named)
            whole.update(f"{name} {_copied(one.file, held / name)}\n".encode())
            if name.lower().endswith(".toml"):
                check_campaign(held / name)
            refuse_bomb(held / name)
        log = whole.hexdigest()[:12]
        held.chmod(0o755)
        try:
            held.rename(logs / log)
        except OSError:
            if not (logs / log).is_dir():
                raise
        return log
    finally:
        shutil.rmtree(held, ignore_errors=True)


def refuse_bomb(file: Path) -> None:
    """Refuse a packed file that holds far more than any log; raises ``workbench.bomb``."""
    size = file.stat().st_size
    with file.open("rb") as stream:
        begins = stream.read(4)
    held = 0
    try:
        if begins[:2] == b"PK" and zipfile.is_zipfile(file):
            with zipfile.ZipFile(file) as packed:
                held = sum(one.file_size for one in packed.infolist())
        elif begins[:2] == b"\x1f\x8b":
            with gzip.open(file) as stream:
                while held <= max(HARMLESS, DENSE * size) and (piece := stream.read(_PIECE)):
                    held += len(piece)
    except (OSError, EOFError, zlib.error, zipfile.BadZipFile):
        return  # a damaged one is for its reader
    if held > max(HARMLESS, DENSE * size):
        raise error("workbench.bomb", name=file.name, times=DENSE)


def _alone(name: str, named: set[str]) -> str:
    """Return a name that no other file of the log has."""
    out, k = name, 2
    while out.lower() in named:
        out, k = f"{k}-{name}", k + 1
    named.add(out.lower())
    return out


def _copied(source: IO[bytes], target: Path) -> str:
    """Copy a file piece by piece; returns the hash of its content."""
    digest = hashlib.sha256()
    size = 0
    with target.open("xb") as out:
        while piece := source.read(_PIECE):
            if shutil.disk_usage(target.parent).free < SPARE + len(piece):
                raise error("workbench.space", path=target.parent.parent)
            digest.update(piece)
            out.write(piece)
            size += len(piece)
    if not size:
        raise error("workbench.empty", name=target.name)
    return digest.hexdigest()
