"""Lines of text that nobody has described: which of their cells are numbers, and what those are.

Most lines of an instrument look alike: the same first word, the same separator, as many cells. What
their numbers mean is asked of `recognise`, as of a log without titles, and written as a description
of frames, so that they are recorded as any others.
"""

from __future__ import annotations

import csv
import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from foucault.capture.frame import NUMBER, Checksum
from foucault.recognise import columns as tell
from foucault.recognise.opening import opened
from foucault.recognise.reading import Recognised, recognise

LEAST = 8
"""Lines alike of which it is told how they look [1]."""

READABLE = 0.9
"""Part of the bytes of a text that are letters, signs and ends of lines [1]."""

ALIKE = 0.9
"""Part of the lines of one kind that hold as many numbers [1]."""


@dataclass(frozen=True)
class Print:
    """How lines of one kind look."""

    prefix: str
    separator: str  # "" for spaces of any number
    checksum: bool
    titles: tuple[str, ...]  # of each cell, "" where it holds a number alone
    numbers: tuple[int, ...]  # cells that hold numbers [1]
    rows: tuple[tuple[str, ...], ...]  # the numbers of those cells, as they were written
    share: float  # of all lines [1]


def text_in(data: bytes) -> float:
    """Return which part of `data` is readable text, shape () [1]."""
    if not data:
        return 0.0
    return sum(32 <= byte < 127 or byte in (9, 10, 13) for byte in data) / len(data)


def print_of(data: bytes) -> Print | None:
    """Return how the lines in `data` look that hold the most numbers; None where they are none."""
    if text_in(data) < READABLE:
        return None
    whole = re.split(rb"[\r\n]+", data)[1:-1]
    lines = [line.decode("ascii").strip() for line in whole if line.strip() and line.isascii()]
    found = [one for sep in (",", ";", "\t", "|", "") if (one := _by(lines, sep)) is not None]
    return max(found, key=lambda one: (len(one.numbers), one.share), default=None)


def _by(lines: Sequence[str], separator: str) -> Print | None:
    kinds = Counter(_kind(line, separator) for line in lines)
    best: Print | None = None
    for (prefix, starred, cells), count in kinds.most_common(6):
        if count < LEAST or cells < 3:
            continue
        mine = [line for line in lines if _kind(line, separator) == (prefix, starred, cells)]
        right = starred and all(map(_checked, mine))
        if starred and not right and sum(map(_checked, mine)) > 0.5 * len(mine):
            mine, right = [line for line in mine if _checked(line)], True
        one = _one(mine, prefix, separator, right, count / len(lines))
        if one is not None and (best is None or len(one.numbers) > len(best.numbers)):
            best = one
    return best


def _cells(line: str, separator: str) -> list[str]:
    inner = line.rpartition("*")[0] if _STARRED.search(line) else line
    return [cell.strip() for cell in inner.split(separator or None)]


_STARRED = re.compile(r"\*[0-9A-Fa-f]{2}$")
_WORD = re.compile(r"[$#!@A-Za-z][A-Za-z0-9_$#]*[:>]?$")


def _kind(line: str, separator: str) -> tuple[str, bool, int]:
    """Return the first word of a line, "" for none, whether a checksum ends it, and its cells."""
    cells = _cells(line, separator)
    named = len(cells) > 3 and _WORD.match(cells[0]) is not None
    return cells[0] if named else "", _STARRED.search(line) is not None, len(cells)


def _checked(line: str) -> bool:
    inner, _, said = line.rpartition("*")
    return f"{Checksum(kind='xor8', last=0, at=0).of(inner[1:].encode()):02X}" == said.upper()


def _one(
    lines: Sequence[str], prefix: str, separator: str, checksum: bool, share: float
) -> Print | None:
    rows = [_cells(line, separator)[1 if prefix else 0 :] for line in lines]
    found = [[NUMBER.search(cell) for cell in row] for row in rows]
    columns = range(len(rows[0]))
    full = [c for c in columns if sum(f[c] is not None for f in found) > ALIKE * len(rows)]
    kept = [f for f in found if all(f[c] is not None for c in full)]
    titles = [{m.string[: m.start()] for f in kept if (m := f[c]) is not None} for c in columns]
    # What changes before its number is no title, and no number either.
    full = [c for c in full if len(titles[c]) == 1]
    if len(full) < 3 or len(kept) < LEAST:
        return None
    named = tuple(titles[c].pop().strip(" :=") if c in full else "" for c in columns)
    numbers = tuple(tuple(m.group() for c in full if (m := f[c]) is not None) for f in kept)
    return Print(prefix, separator, checksum, named, tuple(full), numbers, share)


def known(
    told: Print, folder: Path, rate: float | None, said: Mapping[str, Any]
) -> tuple[Recognised, dict[str, Any]]:
    """Tell what the numbers of lines are; `rate`: of the lines, where none of them is a time [Hz].

    `folder`: for a table of the numbers; `said`: keys of [log] that are known. Returns what was
    recognised, and its [log] with numbers of cells.
    """
    path = folder / "prints.csv"
    names = [told.titles[c] or f"c{c}" for c in told.numbers]
    titled = any(told.titles[c] for c in told.numbers) and len(set(names)) == len(names)
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        if titled:
            writer.writerow(names)
        writer.writerows(told.rows)
    said = dict(said)
    if rate is not None and "rate" not in said and not tell.clocks(tell.Data.of([opened(path)])):
        said["rate"] = f"{rate:.6g} Hz"
    found = recognise([path], said)
    cells = dict(zip(names, told.numbers, strict=True))
    return found, {key: _placed(value, cells, told.numbers) for key, value in found.log.items()}


def _placed(value: Any, cells: Mapping[str, int], numbers: Sequence[int]) -> Any:
    """Return a block of [log] with numbers of cells instead of names of columns."""
    if not isinstance(value, Mapping):
        return value
    out = dict(value)

    def cell(name: Any) -> str | int:
        sign = "-" if str(name).startswith("-") else ""
        bare = str(name).removeprefix("-")
        at = cells[bare] if bare in cells else numbers[int(bare)]
        return f"-{at}" if sign else at

    if "columns" in out:
        out["columns"] = [cell(name) for name in out["columns"]]
    if "column" in out:
        out["column"] = cell(out["column"])
    return out


def description(told: Print, log: Mapping[str, Any], words: str) -> tuple[str, tuple[str, ...]]:
    """Write the frames of lines as `log` has them; returns also what of it cannot be said so."""
    lines, lost = list[str](), list[str]()
    integer = [all(_WHOLE.match(row[k]) for row in told.rows) for k in range(len(told.numbers))]
    whole = dict(zip(told.numbers, integer, strict=True))
    if (time := log.get("time")) is not None:
        at = int(time["column"])
        kind = ', type = "u32"' if whole[at] and time["unit"] in ("ms", "us") else ""
        lines.append(f'  {{ name = "time", at = {at}{kind}, unit = "{time["unit"]}" }},')
    for name in ("accel", "gyro"):
        block = log.get(name)
        if block is None:
            continue
        places = [str(c) for c in block["columns"]]
        cells = [int(p.removeprefix("-")) for p in places]
        first = min(cells)
        if sorted(cells) != [first, first + 1, first + 2]:
            lost.append(f"the cells of {name}, {', '.join(places)}, do not lie side by side")
            continue
        if "zero" in block:
            lost.append(f"{name}.zero = {json.dumps(block['zero'])}")
        divide, unit = _scaled(block)
        axes = [("-" if p.startswith("-") else "") + "xyz"[int(p.removeprefix("-")) - first]
                for p in places]  # fmt: skip
        more = "" if axes == ["x", "y", "z"] else f", axes = {json.dumps(axes)}"
        more += f", divide = {divide}" if divide else ""
        lines.append(f'  {{ name = "{name}", at = {first}, count = 3{more}, unit = "{unit}" }},')
    if (warm := log.get("temperature")) is not None:
        at, unit = warm["column"], warm["unit"]
        lines.append(f'  {{ name = "temperature", at = {at}, unit = "{unit}" }},')
    kinds = {log[n]["kind"] for n in ("accel", "gyro") if "kind" in log.get(n, {})}
    head = [
        f"words = {json.dumps(words)}", 'source = "what was heard of it"',
        f"line = {{ prefix = {json.dumps(told.prefix)}, separator = {json.dumps(told.separator)}, "
        f"checksum = {json.dumps(told.checksum)} }}",
        f'kind = "{"increment" if "increment" in kinds else "rate"}"', "fields = [",
    ]  # fmt: skip
    if any(log.get(n, {}).get("reads") == "gravity" for n in ("accel",)):
        lost.append('accel.reads = "gravity"')
    return "\n".join([*head, *lines, "]", ""]), tuple(lost)


_WHOLE = re.compile(r"[-+]?\d+$")
_SCALE = re.compile(r"([\d.eE+-]+) count/\(?([^()]+)\)?$")


def _scaled(block: Mapping[str, Any]) -> tuple[str, str]:
    """Return by what the numbers of a triad are divided, "" for nothing, and their unit."""
    if block["unit"] == "count" and (scale := _SCALE.match(str(block.get("scale", "")))):
        return scale[1], scale[2]
    return "", str(block["unit"])
