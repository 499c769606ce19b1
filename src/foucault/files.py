"""Files written whole or not at all, and their fingerprints."""

from __future__ import annotations

import codecs
import errno
import hashlib
import json
import math
import os
import secrets
import stat
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from foucault.errors import FoucaultError, error

HEAD = 4096  # So much of the beginning of a file tells what it is [byte].

LONGEST_TEXT = 16 << 20
"""Longest text that a person writes, such as a campaign with a list of positions [byte]."""

DEEPEST = 64  # So many tables and lists inside one another say more than anybody can mean [1].

TOO_DEEP = f"tables or lists are nested more than {DEEPEST} deep"


@contextmanager
def atomic(path: str | Path) -> Iterator[Path]:
    """Write a file whole or not at all.

    Yields a temporary path in the same folder with the same suffixes. When the block ends
    well the file takes its real name in one step; when it fails in any way the temporary file
    is removed and what was there before is untouched.

    `path`: the file to write, its folder must exist. Raises ``output.unwritable``: disk full,
    read-only, no permission, no such folder.
    """
    target = Path(path)
    # A name that nobody can guess, so that nobody can wait for it with a link of theirs.
    temporary = target.with_name(f".partial-{secrets.token_hex(8)}-{target.name[-100:]}")
    made = False
    try:
        mode = _mode(target)
        # An unwritable folder shows before hours of work, not after.
        flags = os.O_CREAT | os.O_EXCL | os.O_WRONLY
        os.close(os.open(temporary, flags, 0o666 if mode is None else 0o600))
        made = True
        yield temporary
        if mode is not None:
            temporary.chmod(mode)
        temporary.replace(target)
        made = False
    except OSError as problem:
        named = problem.filename
        if named is not None and Path(str(named)).absolute().parent != target.absolute().parent:
            raise  # some other file failed inside the block; not ours to explain
        raise unwritable(target, problem) from problem
    except UnicodeEncodeError:
        raise unwritable(target, OSError("a name in it is not Unicode")) from None
    finally:
        if made:
            with suppress(OSError):  # where the folder itself is out of reach by now
                temporary.unlink(missing_ok=True)


def _mode(target: Path) -> int | None:
    """Return who may do what with the file that is there; None where there is none."""
    try:
        there = target.stat()
    except FileNotFoundError:
        return None
    if stat.S_ISDIR(there.st_mode):
        raise IsADirectoryError(None, "it is a folder", str(target))
    if not stat.S_ISREG(there.st_mode):  # a device, a pipe: it must not become a file
        raise OSError(None, "it is no ordinary file", str(target))
    return stat.S_IMODE(there.st_mode)


def write_text(path: str | Path, text: str) -> None:
    """Write a text whole or not at all; raises as `atomic`."""
    with atomic(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def make_folder(folder: str | Path) -> Path:
    """Make a folder where there is none; raises ``output.unwritable``."""
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise unwritable(folder, problem) from None
    return Path(folder)


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


LOCK = ".foucault.lock"
"""File in a folder that a command is writing; the system lets go of it when the command ends."""


@contextmanager
def alone(folder: str | Path) -> Iterator[None]:
    """Hold a folder, so that no other run writes into it at the same time.

    The folder is made where it does not exist; one that stays empty is removed again. What a
    killed run has left holds nobody up: the system, not the file, knows who holds it.

    Raises ``output.busy``: another run writes into it; ``output.unwritable``.
    """
    folder = Path(folder)
    try:
        made = [p for p in (folder, *folder.parents) if not p.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        stream = _held(folder)
    except OSError as problem:
        raise unwritable(folder, problem) from problem
    try:
        yield
    finally:
        with suppress(OSError):
            (folder / LOCK).unlink(missing_ok=True)
        stream.close()
        with suppress(OSError):  # something was written
            for path in made:
                path.rmdir()


def _held(folder: Path) -> IO[bytes]:
    """Return the open lock file, which nobody else holds."""
    while True:
        stream = (folder / LOCK).open("ab")
        try:
            _lock(stream)
        except (BlockingIOError, PermissionError):
            stream.close()
            raise error("output.busy", folder=folder) from None
        except OSError:  # a file system without locks
            return stream
        try:
            if os.path.samestat(os.fstat(stream.fileno()), (folder / LOCK).stat()):
                return stream
        except FileNotFoundError:  # whoever held it has just removed it
            pass
        stream.close()


def _lock(stream: IO[bytes]) -> None:
    try:
        import fcntl
    except ImportError:  # Windows
        import msvcrt

        msvcrt.locking(stream.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
        return
    fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextmanager
def beside(folder: str | Path) -> Iterator[None]:
    """Say, where the block cannot write its page, that the result in `folder` is whole."""
    try:
        yield
    except FoucaultError as problem:
        if problem.code != "output.unwritable":
            raise
        raise error("output.no_report", folder=folder, problem=problem.message) from problem


def keep_others(
    path: str | Path, signs: Iterable[bytes], inputs: Iterable[str | Path] = ()
) -> None:
    """Refuse to replace a file that is an input, or no earlier output of the same kind.

    `signs`: what the beginning of an output of this kind has in it, one of them at least. Raises
    ``output.input``, ``output.other``.
    """
    path = Path(path)
    try:
        if not path.is_file():
            return  # nothing, or what cannot be written at all
        for one in inputs:
            if Path(one).exists() and path.samefile(one):
                raise error("output.input", path=path)
        with path.open("rb") as stream:
            head = stream.read(HEAD)
    except OSError as problem:
        raise unwritable(path, problem) from problem
    if head and not any(sign in head for sign in signs):
        raise error("output.other", path=path)


def decoded(content: bytes) -> str:
    """Return text as its bytes have it: UTF-8, UTF-16 by its mark, else Windows-1252.

    `content`: the text, or a line of it, a byte that none of them knows becomes a replacement
    character.
    """
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16", errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:  # in which spreadsheets write a degree sign
        return content.decode("cp1252", errors="replace")


def read_text(path: str | Path) -> str:
    """Read a text that a person wrote, in any encoding that `decoded` knows.

    Raises it cannot be read, or is longer than any text of a person: a log, a device.
    """
    with Path(path).open("rb") as stream:
        content = stream.read(LONGEST_TEXT + 1)
    if len(content) > LONGEST_TEXT:
        reason = f"it is longer than {LONGEST_TEXT >> 20} MB, so no text of a person"
        raise OSError(errno.EFBIG, reason, str(path))
    return decoded(content).replace("\r\n", "\n").replace("\r", "\n")


def parse_toml(text: str) -> dict[str, Any]:
    """Return what a TOML text says; `tomllib.TOMLDecodeError` for whatever cannot be read."""
    try:
        said = tomllib.loads(text)
        _not_too_deep(said)
    except RecursionError:
        raise tomllib.TOMLDecodeError(TOO_DEEP) from None
    except ValueError as problem:  # a whole number of thousands of digits
        raise tomllib.TOMLDecodeError(str(problem)) from None
    return said


def said_in(text: str | Path, code: str, **about: object) -> dict[str, Any]:
    """Return what a TOML text says, or a file; raises `code` for whatever cannot be read."""
    try:
        return parse_toml(text if isinstance(text, str) else read_text(text))
    except (OSError, tomllib.TOMLDecodeError) as problem:
        raise error(code, **about, reason=problem) from None


def parse_json(content: bytes, **options: Any) -> Any:
    """Return what a JSON text says; `ValueError`, in plain words, where it cannot be read."""
    try:
        said = json.loads(content.decode("utf-8"), **options)
        _not_too_deep(said)
    except UnicodeDecodeError:
        raise ValueError("it is no text") from None
    except json.JSONDecodeError as problem:
        if not problem.doc[problem.pos :].strip() or problem.msg.startswith("Unterminated"):
            raise ValueError("it is empty, or ends before it is complete") from None
        where = f"line {problem.lineno}, column {problem.colno}"
        raise ValueError(f"from {where} on it is no JSON") from None
    except RecursionError:
        raise ValueError(TOO_DEEP) from None
    return said


def _not_too_deep(value: Any) -> None:
    level = [value]
    for _ in range(DEEPEST):
        tables = (x for x in level if isinstance(x, dict | list))
        level = [inner for x in tables for inner in (x.values() if isinstance(x, dict) else x)]
        if not level:
            return
    raise RecursionError(TOO_DEEP)


def flat(table: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Return the values of a table and of those in it, by their dotted keys."""
    out: dict[str, Any] = {}
    for key, value in table.items():
        whole = before + key
        out |= flat(value, f"{whole}.") if isinstance(value, Mapping) else {whole: value}
    return out


_PLAIN = frozenset((str, int, bool, type(None)))


def plain_json(value: Any) -> Any:
    """Return what JSON can hold of a value; None for what is not finite."""
    kind = type(value)  # millions of these: to ask each of them what it is a kind of takes longer
    if kind is float:
        return value if math.isfinite(value) else None
    if kind in _PLAIN:
        return value
    if kind is dict or isinstance(value, Mapping):
        return {str(k): v if type(v) in _PLAIN else plain_json(v) for k, v in value.items()}
    if hasattr(value, "tolist"):  # an array, or one number of one
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [v if type(v) in _PLAIN else plain_json(v) for v in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, (bool, int)) else str(value)
