"""The table of receivers, and the one writer and the one reader over it.

`receivers.toml` has a table for each receiver and a row for each of its keys: what it means, in
which unit, as which kind of noise. A value of ours, x [SI], is in the file::

    y = times x / unit                     of a part of the calibration
    y = (times N r)^p / unit               of a noise, p = 1 for a sigma, 2 for a variance

with r = 1 for a density, sqrt(rate) for a sample, sqrt(T/2) for the stationary sigma of a Markov
process of correlation time T that is a random walk K over times short against T.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.errors import error
from foucault.escape import commented, hash_comment
from foucault.export import syntax
from foucault.export.quantities import COMPLETE, Known, value_of
from foucault.export.syntax import SYNTAXES, Found
from foucault.models.imu import ImuModel
from foucault.units import CELSIUS, size

KINDS = {
    "sigma density": (1, ""),
    "variance density": (2, ""),
    "sample sigma": (1, "rate"),
    "sample variance": (2, "rate"),
    "markov sigma": (1, "correlation"),
}
"""How a noise is expressed: power of the sigma, and what makes it of the density."""


@dataclass(frozen=True)
class Row:
    """One key of one receiver."""

    key: str = ""
    of: tuple[str, ...] = ()  # names in `quantities`; several stand one after the other
    kind: str = "sigma density"  # key of `KINDS`, of a noise
    times: float = 1.0  # factor of its own [1]
    unit: str = ""
    si: float = 0.0  # value of the unit, where it is the receiver's own [SI]
    each: bool = False  # a number for each axis of a noise
    layout: str = "rows"
    line: str = ""
    group: str = ""
    limits: tuple[float, float] | None = None  # least and most that it takes [as in the file]
    floor: float = 0.0  # what is less is raised to it [as in the file]
    felt: float = 0.0  # what differs by no more from no error may be ignored [as in the file]
    says: str = ""
    must: bool = True
    warm: bool = False
    triad: str = ""  # written only where biases of this triad are calibrated

    @property
    def noise(self) -> bool:
        """Whether it is a density, and not a part of the calibration."""
        return bool(self.of) and self.of[0].endswith((".white", ".walk"))

    @property
    def one(self) -> float:
        """The SI value of its unit."""
        return self.si or (size(self.unit) if self.unit not in ("", CELSIUS[0]) else 1.0)

    @property
    def shown(self) -> str:
        """Its key for people; a star stands for each axis."""
        return self.key.replace("{X}", "*").replace("{0}", "*")

    def lost(self, known: Known, receiver: str) -> str:
        """Say what the receiver makes of numbers that are too small for it; "" where none are."""
        x = self.told(known) if self.floor or self.felt else None
        if x is None:
            return ""
        if ((x > 0) & (x < self.floor)).any():
            return (
                f"{self.shown}: {receiver} raises what is below {self.floor:g} to {self.floor:g}."
            )
        none = self.told(Known(ImuModel())) if self.felt else None
        off = np.inf if none is None else float(np.linalg.norm(x - none))
        if off > self.felt or not self.calibrated(known).any():
            return ""
        return (
            f"{self.shown}: differs from no error by {off:.2g}, which is {self.felt:g} or less: "
            "versions that ignore so little keep what they hold."
        )

    def calibrated(self, known: Known) -> BoolArray:
        """Return of which axes what it says is calibrated, (3,)."""
        triad, _, what = self.of[0].partition(".")
        return known.have(triad, "scale" if what == "diagonal_inverse" else "bias")

    def names(self) -> list[str]:
        """Return the keys of its numbers: three where each axis has its own."""
        for pattern, axes in (("{X}", "XYZ"), ("{0}", "012")):
            if pattern in self.key:
                return [self.key.replace(pattern, axis) for axis in axes]
        return [self.key]

    @property
    def count(self) -> int:
        """How many numbers it has."""
        told = self.told(COMPLETE)
        assert told is not None
        return len(told)

    def noise_factor(self, rate: float | None, correlation: float | None) -> float | None:
        """Return times r of the equation above, None where it needs what is not known.

        `rate`: of the samples [Hz]; `correlation`: T of a Markov process [s].
        """
        needs = KINDS[self.kind][1]
        if needs == "rate":
            return None if rate is None else self.times * rate**0.5
        if needs == "correlation":
            return None if correlation is None else self.times * (correlation / 2) ** 0.5
        return self.times

    def told(self, known: Known) -> FloatArray | None:
        """Return the numbers of the file, flat; None where they are not known."""
        asked = [value_of(name, known, each=self.each) for name in self.of]
        parts = [np.asarray(part) for part in asked if part is not None]
        if len(parts) < len(self.of):
            return None
        if self.noise:
            factor = self.noise_factor(known.rate, known.correlation)
            if factor is None:
                return None
            power = KINDS[self.kind][0]
            return laid_out((factor * parts[0]) ** power / self.one, self.layout)
        flat = [laid_out(part, self.layout) for part in parts]
        return self.times * np.concatenate(flat) / self.one

    def meant(self, numbers: FloatArray, known: Known) -> dict[str, FloatArray]:
        """Return what numbers of a file mean, by name [SI]: the inverse of `told`.

        `numbers` (n,): as in the file; `known`: for the rate of samples [SI].
        """
        if self.noise:
            if self.layout == "diagonal":
                numbers = np.reshape(numbers, (3, 3)).diagonal()
            factor = self.noise_factor(known.rate, known.correlation)
            if factor is None:
                return {}
            return {self.of[0]: (numbers * self.one) ** (1 / KINDS[self.kind][0]) / factor}
        out = {}
        numbers = numbers * self.one / self.times
        for i, name in enumerate(self.of):
            last = i + 1 == len(self.of)
            part, numbers = (numbers, numbers[:0]) if last else (numbers[:3], numbers[3:])
            out[name] = put_back(part, self.layout)
        return out


def laid_out(x: FloatArray, layout: str) -> FloatArray:
    """Return the numbers of a vector or matrix in the order of a layout, shape (n,).

    `x`: vector or matrix [SI].
    """
    if x.ndim == 1 and layout == "diagonal":
        return np.diag(x).ravel()
    if x.ndim < 2:
        return np.atleast_1d(x)
    if layout == "columns":
        return x.T.ravel()
    if layout == "lower columns":
        return x.T[np.triu_indices(3)]
    return x.ravel()


def put_back(numbers: FloatArray, layout: str) -> FloatArray:
    """Return the vector or matrix of numbers in the order of a layout.

    `numbers` (n,): flat [SI].
    """
    if layout == "lower columns" and len(numbers) == 6:
        x = np.zeros((3, 3))
        x[np.triu_indices(3)] = numbers
        return x.T
    if len(numbers) != 9:
        return numbers
    return numbers.reshape(3, 3).T if layout == "columns" else numbers.reshape(3, 3)


@dataclass(frozen=True, eq=False)
class Receiver:
    """Who reads a file, and what it has there."""

    name: str
    title: str
    file: str
    syntax: str
    rows: tuple[Row, ...]
    source: str
    takes: tuple[str, ...] = ()
    calibration: str = ""
    axes: str = ""
    gauge: str = ""
    reader: str = ""
    single: bool = False
    nested: bool = True
    apart: bool = False  # a key that is left out stays as the receiver has it
    notes: tuple[str, ...] = ()
    warm_notes: tuple[str, ...] = ()
    reference: float | None = None  # temperature that its powers count from [degC]
    head: tuple[str, ...] = ()
    tail: tuple[str, ...] = ()
    remark: str = "foucault"
    texts: Mapping[str, str] = field(default_factory=dict)
    residual: tuple[str, ...] = ()  # findings of logs that it had calibrated itself
    # for each of its sensors after the first: words of the keys -> what stands there instead
    slots: tuple[Mapping[str, str], ...] = ()
    slot: int = 0  # number of the sensor [1]

    def of_slot(self, slot: int) -> Receiver:
        """Return it as it names its sensor number `slot`, from 0 [1]."""
        if not 0 <= slot <= len(self.slots):
            raise error("export.slot", receiver=self.name, given=slot, last=len(self.slots))
        if slot == self.slot:
            return self
        words = self.slots[slot - 1]
        every = re.compile("|".join(map(re.escape, words)))

        def named(text: str) -> str:
            return every.sub(lambda found: words[found[0]], text)

        rows = tuple(replace(r, key=named(r.key), line=named(r.line)) for r in self.rows)
        notes, warm = (tuple(map(named, some)) for some in (self.notes, self.warm_notes))
        return replace(self, rows=rows, notes=notes, warm_notes=warm, slot=slot)

    @property
    def warms(self) -> bool:
        """Whether it has a place for biases that change with temperature."""
        return any(row.warm for row in self.rows)

    @property
    def of_magnetometer(self) -> bool:
        """Whether it takes the calibration of a magnetometer, and not of an IMU."""
        return any(of.startswith("mag.") for row in self.rows for of in row.of)

    @property
    def before(self) -> bool:
        """Whether readings have to be corrected before this receiver gets them."""
        return self.calibration == "before"

    @property
    def wants_rate(self) -> bool:
        """Whether its numbers hold at one rate only."""
        return any("rate" in (KINDS[r.kind][1], *r.of) for r in self.rows)


TABLES = ("receivers", "magnetometers")  # Tables: of an IMU's calibration, of a magnetometer's.


@cache
def receivers(table: str = "receivers") -> Mapping[str, Receiver]:
    """Return a table by name: `receivers` of IMUs, or `magnetometers`."""
    text = (Path(__file__).parent / f"{table}.toml").read_text(encoding="utf-8")
    every = tomllib.loads(text)
    return {name: _receiver(name, every[said.get("like", name)] | said)
            for name, said in every.items()}  # fmt: skip


def _receiver(name: str, said: dict[str, Any]) -> Receiver:
    rows = []
    for row in said["rows"]:
        of = row.get("of", ())
        row = row | {"of": (of,) if isinstance(of, str) else tuple(of)}
        row["kind"] = row.pop("as", "sigma density")
        row["must"] = row.get("must", not row.get("warm", False))
        if "limits" in row:
            row["limits"] = tuple(row["limits"])
        rows.append(Row(**row))
    names = ("takes", "notes", "warm_notes", "head", "tail", "slots", "residual")
    lists = {k: tuple(said[k]) for k in names if k in said}
    said = {key: value for key, value in said.items() if key != "like"} | lists
    return Receiver(**said | {"name": name, "rows": tuple(rows)})


# -- The writer ----------------------------------------------------------------------------------


def text_for(receiver: Receiver, known: Known, about: list[str]) -> str:
    """Return the file of a receiver; what is not known stays a comment.

    `about`: what the file says of itself, line by line.
    """
    form = SYNTAXES[receiver.syntax]
    about = [*about, f"For {receiver.title}.", *receiver.notes, *_precision(receiver)]
    about += receiver.warm_notes if known.warm else []
    about += [f"Meaning of each key from the source of the receiver: {receiver.source}."]
    if receiver.syntax in ("json", "px4", "ardupilot"):  # nothing may stand behind a value there
        about += [f"{row.shown}: {_words(row)}" for row in receiver.rows
                  if _words(row) and (known.warm or not row.warm)]  # fmt: skip
    if receiver.syntax == "json":
        values = [(key, value) for _, key, value in _written(receiver, known) if value is not None]
        return syntax.json_of(values, receiver.remark, [*map(hash_comment, about)], receiver.texts)
    return "\n".join([
        *([form.first] if form.first else []),
        commented(about, form.mark),
        *receiver.head,
        *_body(receiver, known),
        *receiver.tail,
        "",
    ])  # fmt: skip


def _body(receiver: Receiver, known: Known) -> Iterator[str]:
    """Yield the lines of the rows."""
    form, braces = SYNTAXES[receiver.syntax], receiver.syntax == "info"
    nests = receiver.nested and receiver.syntax in ("yaml", "opencv", "info")
    at: list[str] = []
    for row, key, value in _written(receiver, known):
        path = key or f"{row.group}.".removeprefix(".")
        *groups, last = path.split(".") if nests else [path]
        yield from syntax.moved(at, groups, braces)
        at, pad = groups, "  " * len(groups)
        if not key:
            yield from (pad + line for line in row.line.splitlines())
        elif value is None and not row.must and receiver.syntax == "python":
            yield from _with_words([row.line.replace("{}", "None")], row, receiver.syntax)
        elif value is None:
            yield pad + commented([f"{last}: not known; {_words(row)}"], form.mark)
        elif row.line:
            line = row.line.replace("{}", syntax.text_of(value, form))
            yield from _with_words([line], row, receiver.syntax)
        else:
            yield from _with_words(syntax.entry(last, value, form, pad), row, receiver.syntax)
    yield from syntax.moved(at, [], braces)


def _written(receiver: Receiver, known: Known) -> Iterator[tuple[Row, str, Any]]:
    """Yield each row, its key and what stands there: a number, lists of them, None if unknown."""
    for row in receiver.rows:
        if row.warm and not known.warm:
            continue
        if row.triad and not known.have(row.triad, "bias").any():
            continue
        if not row.key:
            yield row, "", None
            continue
        flat, keys = row.told(known), row.names()
        if flat is None:
            yield row, row.shown, None
        elif len(keys) == len(flat) == 3:
            seen = row.calibrated(known) | (not receiver.apart)
            for key, x, there in zip(keys, flat.tolist(), seen, strict=True):
                yield row, key, x if there else None
        elif len(flat) == 9 and row.layout == "rows":
            yield row, row.key, flat.reshape(3, 3).tolist()
        else:
            yield row, row.key, flat.tolist() if len(flat) > 1 else float(flat[0])


def _words(row: Row) -> str:
    return f"{row.says} [{row.unit}]".strip() if row.unit else row.says


def _with_words(lines: list[str], row: Row, name: str) -> list[str]:
    """Put what a row means behind its line, where a reader lets it stand there."""
    words = _words(row)
    if not words or len(lines) > 1 or name in ("px4", "ardupilot") or lines[0].endswith("..."):
        return lines
    return [f"{lines[0]}  {commented([words], SYNTAXES[name].mark)}"]


def _precision(receiver: Receiver) -> list[str]:
    if not receiver.single:
        return []
    return [
        "It keeps single precision: numbers are rounded by 6e-8 of themselves when they are read."
    ]


# -- The reader ----------------------------------------------------------------------------------


def found_in(receiver: Receiver, text: str) -> Found:
    """Return what a file has under the keys of a receiver: numbers, lists of them, or a text.

    Keys may stand deeper than in a file of their own: under a node of ROS 2, in a list of sensors.
    Raises ``export.unreadable``.
    """
    try:
        if receiver.syntax in ("python", "c++", "matlab"):
            lines = [(row.key, row.line) for row in receiver.rows if row.key]
            return syntax.assigned(lines, receiver.syntax, text, receiver.reader)
        have = syntax.read(receiver.syntax, text, receiver.reader)
    except (ValueError, RecursionError) as problem:  # no JSON, or brackets without end
        raise error("export.unreadable", receiver=receiver.name, reason=problem) from None
    keys = [key for row in receiver.rows if row.key for key in row.names()]
    return {key: have[path] for key in keys if (path := _path_of(key, have)) is not None}


def _path_of(key: str, have: Found) -> str | None:
    """Return where a file has a key, None where it has it nowhere or in several places."""
    if key in have:
        return key
    ends = f".{key}", f".ros__parameters.{key.partition('.')[2] or key}"
    deeper = [path for path in have if path.endswith(ends)]
    return deeper[0] if len(deeper) == 1 else None


def numbers_of(row: Row, found: Found) -> FloatArray | None:
    """Return the numbers of a row, flat; None where they are missing or no numbers."""
    flat = [x for key in row.names() for x in _flat(found.get(key))]
    return np.array(flat) if flat and all(isinstance(x, float) for x in flat) else None


def _flat(value: Any) -> Iterator[Any]:
    if isinstance(value, list):
        for item in value:
            yield from _flat(item)
    else:
        yield value
