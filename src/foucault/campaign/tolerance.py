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

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from foucault import units
from foucault.arrays import FloatArray, IntArray
from foucault.campaign.reading import text_of
from foucault.campaign.tables import kind_of_group, parse_at
from foucault.coefficients import format_value
from foucault.diagnose.comparable import Comparable
from foucault.diagnose.comparable import Entry as Compared
from foucault.diagnose.compare import FEWEST, Between, Course, History
from foucault.errors import Finding, error, suggestion
from foucault.files import said_in
from foucault.models.layouts import EVERY

PASS, UNDECIDED, FAIL = 0, 1, 2
DECISIONS = ("pass", "undecided", "fail")
"""What the number of a decision means; the larger one counts."""

GUARD = 2.0  # Width of the guard band: a coverage factor of 95 % [standard deviations].

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
        value, sd = np.full((2, len(names)), np.inf)
        for k, entry in self._matching(names):
            if np.isfinite(entry.limit):
                value[k], sd[k] = entry.limit, entry.sd
        return value, sd

    def changes(self, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """Return the limits of changes [SI] and of drifts [SI per year], each shape (p,).

        Both are infinite where the file says nothing. `names` are the coefficients, shape (p,).
        """
        change, drift = np.full((2, len(names)), np.inf)
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


def conformity(value: float, sd: float, limit: float) -> float:
    """Return the probability that a normal number is no larger than a limit, NaN if unknown [1].

    `value`, `sd`, `limit`: the number, its standard deviation and its largest size [SI].
    """
    if not (math.isfinite(limit) and math.isfinite(value) and sd > 0):
        return math.nan
    root = sd * math.sqrt(2)
    return 0.5 * (math.erf((limit - value) / root) - math.erf((-limit - value) / root))


def load(path: str | Path) -> Tolerance:
    """Read a tolerance file; the first mistake in it is raised with its name."""
    return parse(text_of(Path(path), "tolerance.missing", "tolerance.syntax"), path)


def parse(text: str, path: str | Path = "tolerance.toml") -> Tolerance:
    """Read a tolerance from `text`; `path` is where it would lie."""
    lines = _joined(said_in(text, "tolerance.syntax", path=path))
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
    kind = kind_of_group(name, EVERY, "tolerance.kind")
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


# -- What a comparison amounts to: limits kept or not, and a verdict in words --------------------

LEVELS = ("pass", "doubtful", "fail")  # Outcomes of a comparison, the worse the later.
MOST = 6  # Coefficients that are named in the verdict [1].


@dataclass(frozen=True)
class Judged:
    """An instrument with its results."""

    name: str
    entries: tuple[Compared, ...]  # its results in time [SI]
    comparable: Comparable | None  # what they have in common; None of a single result
    history: History | None  # how they compare; None of a single result

    def kind(self, name: str) -> str:
        """Return what coefficient `name` measures."""
        layout = self.entries[-1].result.coefficients.layout
        if self.comparable is not None and name in self.comparable.layout:
            layout = self.comparable.layout  # results that were turned have other angles
        return layout.coefficients[layout.index(name)].kind


@dataclass(frozen=True)
class Decision:
    """Whether one number keeps to its limit."""

    # instrument, name: of which instrument, and which coefficient
    instrument: str
    name: str
    what: str  # "value", "change" or "drift"
    # value, sd: the number and its standard deviation [SI; of a drift per year]
    value: float
    sd: float
    limit: float  # its largest size [SI; of a drift per year]
    decision: str
    kind: str  # what the coefficient measures, which fixes its units
    # first, second: results that a change is between; the result of a value is `second`
    first: str = ""
    second: str = ""

    def words(self) -> str:
        """Say what was found and what is allowed."""
        per = " per year" if self.what == "drift" else ""
        number = said(self.value, self.sd, self.kind, self.limit)
        at = f" from {self.first} to {self.second}" if self.what == "change" else ""
        unit, size = _unit(self.kind, self.limit)
        limit = f"{units.plain(self.limit / size)} {unit}{per}"
        return f"{self.what} of {self.name}{at} {number}{per}, limit {limit}"


@dataclass(frozen=True)
class Verdict:
    """The outcome, one of `LEVELS`, and why in plain sentences."""

    level: str
    reasons: tuple[str, ...]


# -- limits ----------------------------------------------------------------------------------


def decisions_on(
    instruments: Sequence[Judged], tolerance: Tolerance | None
) -> tuple[Decision, ...]:
    """Decide on the latest value, every change and the drift of all that has a limit.

    `tolerance` or None: the limits.
    """
    if tolerance is None:
        return ()
    out: list[Decision] = []
    for one in instruments:
        last = one.entries[-1]
        vector = last.result.coefficients
        limit, largest = tolerance.limits(vector.names)
        sd = np.where(vector.free, vector.sd, np.nan)  # what was held was not measured
        latest = [(vector.values, sd, "", last.label)]
        out += _decided(one, "value", vector.names, latest, limit, largest)
        if (past := one.history) is not None:
            names, of = past.series.names, [e.label for e in one.entries]
            of_change, of_drift = tolerance.changes(names)
            changes = [(p.change, p.sd, of[p.first], of[p.second]) for p in past.pairs]
            drift, drift_sd = np.array([(c.drift, c.drift_sd) for c in past.courses]).T
            out += _decided(one, "change", names, changes, of_change)
            out += _decided(one, "drift", names, [(drift, drift_sd, "", "")], of_drift)
    return tuple(out)


def _decided(
    one: Judged, what: str, names: Sequence[str],
    rows: Sequence[tuple[FloatArray, FloatArray, str, str]], limit: FloatArray,
    largest_sd: FloatArray | float = np.inf,
) -> Iterator[Decision]:  # fmt: skip
    """Decide on the worst of each coefficient in `rows`: values, sd, and results it is between."""
    found = [decided(value, sd, limit, largest_sd) for value, sd, *_ in rows]
    for k in np.flatnonzero(np.isfinite(limit)).tolist():
        worst = max(range(len(rows)), key=lambda i: (found[i][k], abs(rows[i][0][k])))
        value, sd, first, second = rows[worst]
        yield Decision(
            one.name, names[k], what, float(value[k]), float(sd[k]), float(limit[k]),
            DECISIONS[found[worst][k]], one.kind(names[k]), first, second,
        )  # fmt: skip


# -- the verdict -----------------------------------------------------------------------------


def verdict_of(
    instruments: Sequence[Judged], between: Between | None, limits: Sequence[Decision],
    findings: Sequence[Finding],
) -> Verdict:  # fmt: skip
    """Combine what was found: the worst counts.

    `between` or None: the instruments side by side.
    """
    told = _of_limits(limits)
    told += [
        _of_history(one, one.history, limits) for one in instruments if one.history is not None
    ]
    if between is not None:
        told.append(_of_instruments(instruments, between))
    told += [(UNDECIDED, f.message) for f in findings if f.code == "compare.unusable"]
    told.sort(key=lambda pair: -pair[0])
    return Verdict(LEVELS[max((level for level, _ in told), default=PASS)],
                   tuple(words for _, words in told))  # fmt: skip


def _of_limits(limits: Sequence[Decision]) -> list[tuple[int, str]]:
    if not limits:
        return []
    several = len({d.instrument for d in limits}) > 1
    out = []
    for level, word in ((FAIL, "Out of tolerance"), (UNDECIDED, "Limit within the uncertainty")):
        mine = [d for d in limits if d.decision == DECISIONS[level]]
        if mine:
            each = [(f"{d.instrument}: " if several else "") + d.words() for d in mine]
            out.append((level, f"{word}: {_listed(each, '; ')}."))
    if not out:
        out.append((PASS, f"All {len(limits)} limits are kept."))
    return out


def _of_history(one: Judged, past: History, limits: Sequence[Decision]) -> tuple[int, str]:
    joint = (
        f"chi-square {units.plain(past.chi_square, 3)} of {past.dof} degrees of freedom, limit "
        f"{units.plain(past.high, 3)}"
    )
    if not past.changed:
        return PASS, f"{_start(one)} has not changed by more than chance explains ({joint})."
    names = [past.courses[k].name for k in past.standing_out]
    level = PASS if _allowed(one, names or past.series.names, limits) else UNDECIDED
    within = ", within the tolerance" if level == PASS else ""
    if names:
        courses = [past.courses[k] for k in past.standing_out]
        loose = [c.name for c in courses if c.how == "scatter"]
        words = [how(c, one.entries, one.kind(c.name)) for c in courses if c.how != "scatter"]
        words += [_scattering(loose)] if loose else []
        return level, f"{_start(one)} has changed{within}: {_listed(words, '; ')}."
    likely = past.courses[past.likeliest].name
    why = "would explain it" if past.alone else "explains most of it, but not all"
    return level, (
        f"{_start(one)} has changed{within} ({joint}), though no coefficient alone by more than "
        f"chance; a change of {likely} {why}."
    )


def _allowed(one: Judged, names: Sequence[str], limits: Sequence[Decision]) -> bool:
    """Whether coefficients have limits of change or drift, and keep to them."""
    mine = [d for d in limits if d.instrument == one.name and d.what != "value"]
    kept = all(d.decision == DECISIONS[PASS] for d in mine if d.name in names)
    return kept and {d.name for d in mine}.issuperset(names)


def _start(one: Judged) -> str:
    return one.name[:1].upper() + one.name[1:]


def _of_instruments(instruments: Sequence[Judged], between: Between) -> tuple[int, str]:
    n, apart = len(between.series), [s.name for s in between.spreads if s.told_apart]
    if between.outlying:
        odd = [f"{instruments[o.index].name}: {o.name} (z = {o.z:+.1f})" for o in between.outlying]
        return UNDECIDED, f"Unlike the other instruments: {_listed(odd, '; ')}."
    if not apart:
        return PASS, f"The {n} instruments cannot be told apart by these calibrations."
    none = "none stands out" if n >= FEWEST else f"among fewer than {FEWEST} none can stand out"
    return PASS, (
        f"The {n} instruments differ in {len(apart)} of {len(between.spreads)} coefficients by "
        f"more than the uncertainty of their calibration; {none}."
    )


def how(course: Course, entries: Sequence[Compared], kind: str) -> str:
    """Say what a coefficient did in time.

    `course`: the coefficient [SI].
    """
    name = course.name
    # Both in one sentence are in one unit.
    both = max(abs(course.drift), abs(course.step)) if course.how == "drift or step" else None
    drift = f"{said(course.drift, course.drift_sd, kind, both)} per year"
    i = course.step_after
    stepped = (
        f"by {said(course.step, course.step_sd, kind, both)} between {entries[i].label} and "
        f"{entries[i + 1].label}"
    )
    return {
        "steady": f"{name} is steady",
        "change": f"{name} {stepped}",
        "step": f"{name} {stepped}, in one step",
        "drift": f"{name} drifts by {drift}",
        "drift or step": f"{name} drifts by {drift}, or changed {stepped}",
        "scatter": _scattering([name]),
    }[course.how]


def _scattering(names: Sequence[str]) -> str:
    if len(names) == 1:
        return f"{names[0]} scatters by more than its uncertainty, in no line and no single step"
    return (
        f"{_listed(names, ', ')} scatter by more than their uncertainties, in no line and no "
        "single step"
    )


def said(value: float, sd: float, kind: str, beside: float | None = None) -> str:
    """Write a number for people.

    `value`, `sd`: the number and its standard deviation [SI]; `beside` or None: a number of the
    same coefficient in whose unit it is written [SI].
    """
    if not np.isfinite(sd):
        return "not known" if not np.isfinite(value) else "known without a standard deviation"
    unit, size = _unit(kind, max(abs(value), sd) if beside is None else beside)
    return f"{format_value(value / size, sd / size)} {unit} (sd {units.plain(sd / size, 2)})"


def _unit(kind: str, value: float) -> tuple[str, float]:
    unit = units.display_unit(kind, value)
    return unit, units.factor(unit, kind)


def _listed(words: Sequence[str], between: str) -> str:
    more = f"{between}and {len(words) - MOST} more" if len(words) > MOST else ""
    return between.join(words[:MOST]) + more
