"""The tolerance file: what a coefficient may be, and whether an instrument keeps to it.

::

    "accel.bias" = "5 mg"                                       # of every coefficient of a group
    "gyro.scale.x" = { limit = "500 ppm", sd = "20 ppm" }       # how well it must be known too
    "gyro.bias" = { change = "2 deg/h", drift_per_year = "1 deg/h" }    # from result to result

A measured value near the limit proves nothing: with the guard band of the decision rule a
coefficient passes only where ``|value| + 2 sd <= limit``, fails only where
``|value| - 2 sd > limit``, and is undecided in between.

References
----------
.. [1] ISO 14253-1:2017, *Decision rules for verifying conformity or nonconformity with
   specifications*.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.campaign.mistakes import parse_at
from foucault.errors import error, suggestion
from foucault.files import parse_toml, read_text
from foucault.models.layouts import EVERY

PASS, UNDECIDED, FAIL = 0, 1, 2
DECISIONS = ("pass", "undecided", "fail")
"""What the number of a decision means; the larger one counts."""

GUARD = 2.0
"""Width of the guard band: a coverage factor of 95 % [standard deviations]."""

KEYS = ("limit", "sd", "change", "drift_per_year")


@dataclass(frozen=True)
class Entry:
    """One line of the file."""

    name: str
    # largest size of the value, infinite where any will do, as the others are [SI]
    limit: float = np.inf
    sd: float = np.inf  # largest standard deviation of the value [SI]
    change: float = np.inf  # largest difference of any two results of one instrument [SI]
    drift_per_year: float = np.inf  # largest size of the slope in time [SI per year]


@dataclass(frozen=True)
class Tolerance:
    """Limits of the coefficients of an instrument."""

    # lines of the file; the longer name decides where two hold for a coefficient
    entries: tuple[Entry, ...]
    file: str = ""  # where they are from

    def limits(self, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """Return the limits of values and of standard deviations, each shape (p,) [SI].

        Both are infinite where the file says nothing. `names` are the coefficients, shape (p,).
        """
        value, sd = np.full(len(names), np.inf), np.full(len(names), np.inf)
        for k, entry in self._matching(names):
            if np.isfinite(entry.limit):
                value[k], sd[k] = entry.limit, entry.sd
        return value, sd

    def changes(self, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """Return the limits of changes [SI] and of drifts [SI per year], each shape (p,).

        Both are infinite where the file says nothing. `names` are the coefficients, shape (p,).
        """
        change, drift = np.full(len(names), np.inf), np.full(len(names), np.inf)
        for k, entry in self._matching(names):
            change[k] = entry.change if np.isfinite(entry.change) else change[k]
            drift[k] = entry.drift_per_year if np.isfinite(entry.drift_per_year) else drift[k]
        return change, drift

    def _matching(self, names: Sequence[str]) -> Iterator[tuple[int, Entry]]:
        """Yield the number of each coefficient with every line for it, longer names later."""
        for entry in sorted(self.entries, key=lambda e: e.name.count(".")):
            for k, name in enumerate(names):
                if name == entry.name or name.startswith(entry.name + "."):
                    yield k, entry

    def refuse_unknown(self, names: Sequence[str], procedure: str) -> None:
        """Refuse limits of coefficients that a procedure does not estimate."""
        for entry in self.entries:
            if not any(n == entry.name or n.startswith(entry.name + ".") for n in names):
                raise error(
                    "tolerance.not_estimated", name=entry.name, procedure=procedure,
                    allowed=", ".join(names),
                )  # fmt: skip

    def decide(self, names: Sequence[str], values: FloatArray, sd: FloatArray) -> IntArray:
        """Decide on every coefficient of every instrument, shape (N, p): numbers of `DECISIONS`.

        `names` (p,): coefficients; `values` (N, p): their values [SI]; `sd` (N, p): their
        standard deviations, unknown ones (NaN) leave every decision open [SI].
        """
        limit, largest_sd = self.limits(names)
        return decided(values, sd, limit, largest_sd)

    def as_json(self) -> dict[str, Any]:
        """Return the limits as plain values [SI]."""
        rows = {
            e.name: {key: v for key in KEYS if np.isfinite(v := getattr(e, key))}
            for e in self.entries
        }
        return {"file": self.file, "limits": rows, "guard_band_sd": GUARD}

    @classmethod
    def from_json(cls, said: Mapping[str, Any]) -> Tolerance:
        """Return the tolerance that `as_json` said [SI]."""
        return cls(tuple(Entry(name, **row) for name, row in said["limits"].items()), said["file"])


def decided(
    values: FloatArray, sd: FloatArray, limit: FloatArray, largest_sd: FloatArray | float = np.inf
) -> IntArray:
    """Decide whether values keep to their limits: numbers of `DECISIONS`.

    `values` (..., p): values, changes or drifts [SI]; `sd` (..., p): their standard deviations,
    unknown ones (NaN) leave every decision open [SI]; `limit` (p,): largest size, infinite where
    any will do [SI]; `largest_sd` (p,): largest standard deviation with which a value passes
    [SI].
    """
    size, guard = np.abs(values), GUARD * sd
    with np.errstate(invalid="ignore"):
        good = (size + guard <= limit) & (sd <= largest_sd)
        out = np.where(good, PASS, np.where(size - guard > limit, FAIL, UNDECIDED))
    return np.where(np.isinf(limit), PASS, out)


def load(path: str | Path) -> Tolerance:
    """Read a tolerance file; the first mistake in it is raised with its name."""
    path = Path(path)
    try:
        text = read_text(path)
    except OSError as problem:
        if path.is_file():
            raise error("tolerance.syntax", path=path, reason=problem) from None
        near = [p.name for p in path.parent.glob("*.toml")] if path.parent.is_dir() else []
        raise error("tolerance.missing", path=path, hint=suggestion(path.name, near)) from None
    return parse(text, path)


def parse(text: str, path: str | Path = "tolerance.toml") -> Tolerance:
    """Read a tolerance from `text`; `path` is where it would lie."""
    try:
        raw = parse_toml(text)
    except tomllib.TOMLDecodeError as problem:
        raise error("tolerance.syntax", path=path, reason=problem) from None
    lines = _joined(raw)
    if not lines:
        raise error("tolerance.empty", path=path)
    return Tolerance(tuple(_entry(name, said) for name, said in lines.items()), Path(path).name)


def _joined(table: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Undo TOML's nesting of ``gyro.bias = ...`` written without quotes."""
    out: dict[str, Any] = {}
    for key, value in table.items():
        name = before + key
        # A table below the name of a coefficient or group is its limit, misspelt or not.
        deeper = isinstance(value, dict) and any(_known(f"{name}.{k}") for k in value)
        if deeper:
            below = {k: v for k, v in value.items() if _known(f"{name}.{k}")}
            out |= _joined(below, f"{name}.")
            if rest := {k: v for k, v in value.items() if k not in below}:
                out[name] = rest
        else:
            out[name] = value
    return out


def _known(name: str) -> bool:
    return any(n == name or n.startswith(name + ".") for n in EVERY.names)


def _entry(name: str, said: Any) -> Entry:
    if not _known(name):
        groups = {n.rpartition(".")[0] for n in EVERY.names}
        allowed = sorted({*EVERY.names, *groups})
        hint = suggestion(name, allowed)
        raise error("tolerance.name", name=name, hint=hint, groups=", ".join(sorted(groups)))
    kind = _kind(name)
    parts = said if isinstance(said, dict) else {"limit": said}
    for key in parts:
        if key not in KEYS:
            raise error("tolerance.key", name=name, key=key, hint=suggestion(key, KEYS))
    if not parts or ("sd" in parts and "limit" not in parts):
        raise error("tolerance.no_limit", name=name)
    numbers = {key: parse_at(f'"{name}".{key}', text, kind) for key, text in parts.items()}
    for key, value in numbers.items():
        if not (value > 0 and np.isfinite(value)):
            raise error("tolerance.positive", name=name, key=key, given=repr(parts[key]))
    return Entry(name, **numbers)


def _kind(name: str) -> str:
    """Return the kind of a coefficient or of all coefficients of a group."""
    members = [EVERY.coefficients[i] for i in EVERY.group(name)]
    kinds: list[str] = list(dict.fromkeys(c.kind for c in members))
    if len(kinds) > 1:
        groups = list(dict.fromkeys(f'"{c.name.rpartition(".")[0]}"' for c in members))
        example = " and ".join(groups[:3])
        raise error("tolerance.kind", name=name, kinds=", ".join(kinds), example=example)
    return kinds[0]
