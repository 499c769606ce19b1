"""Files written whole or not at all, and their fingerprints."""

from __future__ import annotations

import codecs
import hashlib
import json
import math
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from foucault.errors import FoucaultError, error


@contextmanager
def atomic(path: str | Path) -> Iterator[Path]:
    """Write a file whole or not at all.

    Yields a temporary path in the same folder with the same suffixes. When the block ends
    well the file takes its real name in one step; when it fails in any way the temporary file
    is removed and what was there before is untouched.

    Parameters
    ----------
    path : str or Path
        The file to write; its folder must exist.

    Yields
    ------
    Path
        Where to write.

    Raises
    ------
    FoucaultError
        ``output.unwritable``: disk full, read-only, no permission, no such folder.
    """
    target = Path(path)
    # The process number keeps two runs that write the same file out of each other's way.
    temporary = target.with_name(f".partial-{os.getpid()}-{target.name}")
    try:
        if target.is_dir():
            raise IsADirectoryError(None, "it is a folder", str(target))
        temporary.touch()  # an unwritable folder shows before hours of work, not after
        yield temporary
        temporary.replace(target)
    except OSError as problem:
        _remove(temporary)
        if problem.filename is not None and _elsewhere(str(problem.filename), target):
            raise  # some other file failed inside the block; not ours to explain
        raise unwritable(target, problem) from problem
    except BaseException:
        _remove(temporary)
        raise


def unwritable(path: str | Path, problem: OSError) -> FoucaultError:
    """Build the error for output that cannot be written, from what the system said."""
    reason = problem.strerror or str(problem) or type(problem).__name__
    return error("output.unwritable", path=path, reason=reason)


def free_memory() -> float:
    """Return the memory that this process may still take, inf where the system says nothing [B].

    What the machine has free, or the control group (a container), or what the limit of the process
    leaves of its address space.
    """
    free = math.inf
    with suppress(OSError, ValueError, StopIteration):
        lines = Path("/proc/meminfo").read_text().splitlines()
        free = 1024.0 * next(int(x.split()[1]) for x in lines if x.startswith("MemAvailable"))
    with suppress(OSError, ValueError):
        group = Path("/sys/fs/cgroup")
        most, used = (int((group / f"memory.{n}").read_text()) for n in ("max", "current"))
        parts = dict(x.split() for x in (group / "memory.stat").read_text().splitlines())
        cached = int(parts.get("file", 0)) - int(parts.get("shmem", 0))  # given up when wanted
        free = min(free, float(most - used + cached))
    with suppress(ImportError, OSError, ValueError):
        import resource

        most_of_all, _ = resource.getrlimit(resource.RLIMIT_AS)
        if most_of_all != resource.RLIM_INFINITY:
            pages = int(Path("/proc/self/statm").read_text().split()[0])
            free = min(free, float(most_of_all - pages * resource.getpagesize()))
    return max(free, 0.0)


def sha256(path: str | Path) -> str:
    """Compute the SHA-256 of a file, in hexadecimal, without holding it in memory.

    That of a folder is of the names and fingerprints of the files in it, in order.
    """
    if Path(path).is_dir():
        files = sorted(p for p in Path(path).rglob("*") if p.is_file())
        lines = (f"{p.relative_to(path).as_posix()} {sha256(p)}\n" for p in files)
        return hashlib.sha256("".join(lines).encode()).hexdigest()
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _elsewhere(name: str, target: Path) -> bool:
    return Path(name).absolute().parent != target.absolute().parent


def _remove(temporary: Path) -> None:
    # Where the folder itself is out of reach there is nothing of ours in it.
    with suppress(OSError):
        temporary.unlink(missing_ok=True)


def decoded(content: bytes) -> str:
    """Return text as its bytes have it: UTF-8, UTF-16 by its mark, else Windows-1252.

    Parameters
    ----------
    content : bytes
        The text, or a line of it; a byte that none of them knows becomes a replacement character.
    """
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16", errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:  # in which spreadsheets write a degree sign
        return content.decode("cp1252", errors="replace")


def read_text(path: str | Path) -> str:
    """Read a text that a person wrote, in any encoding that `decoded` knows."""
    return decoded(Path(path).read_bytes()).replace("\r\n", "\n").replace("\r", "\n")


def read_document(file: Path, schema: str) -> dict[str, Any]:
    """Read a JSON document of ours; refuse what is none, or of another schema."""
    try:
        about = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as problem:
        raise error("result.not_json", file=file, problem=problem) from None
    if not isinstance(about, dict) or about.get("schema") != schema:
        given = about.get("schema") if isinstance(about, dict) else None
        raise error("result.schema", file=file, given=f"has schema {given!r}", allowed=schema)
    return about


def plain_json(value: Any) -> Any:
    """Return what JSON can hold of a value; None for what is not finite."""
    if isinstance(value, Mapping):
        return {str(k): plain_json(v) for k, v in value.items()}
    if hasattr(value, "tolist"):  # an array, or one number of one
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain_json(v) for v in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, (bool, int)) else str(value)
