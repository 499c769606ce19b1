"""Coefficients: names, symbols, units, values and covariance of what a calibration estimates.

A name is a dotted word generated from the model, ``gyro.misalignment.yx`` (output axis, then
input axis). Names are looked up, never parsed for meaning.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault import units
from foucault.arrays import FloatArray
from foucault.display import Shown
from foucault.errors import error, suggestion

NARROWEST = 1e-30  # Squares of smaller standard deviations are no numbers to calculate with [SI].

COVARIANCE_TOLERANCE = 1e-6
"""How far a stored correlation matrix may be from symmetric and positive, as rounding [1]."""

Prior = Mapping[str, tuple[float, float]]
"""Mean and standard deviation of coefficients or groups of coefficients [SI]."""


@dataclass(frozen=True)
class Coefficient:
    """One coefficient of a model."""

    name: str  # dotted words
    symbol: str  # in the equations
    kind: str  # key of `units.KINDS`, which fixes the SI unit
    meaning: str  # one sentence for people

    @property
    def unit(self) -> str:
        """SI unit text."""
        return units.KINDS[self.kind].si


@cache
def _declared() -> dict[str, list[list[str]]]:
    return tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))


_EACH = {"o": "xyz", "i": "xyz", "p": ("xx", "yy", "zz", "xy", "xz", "yz"), "a": "xyz", "k": "xyz"}
"""What the letters in braces stand for, the first changes least."""


def coefficients_of(group: str, **said: str) -> tuple[Coefficient, ...]:
    """Return the coefficients that coefficients.toml has of a group; `said`: other words in it."""
    out = []
    for row in _declared()[group]:
        letters = [letter for letter in _EACH if f"{{{letter}}}" in row[0]]
        for values in product(*(_EACH[letter] for letter in letters)):
            of = dict(zip(letters, values, strict=True))
            own = of.get("o", "")
            if not own or (of.get("i") != own and of.get("p") != 2 * own):
                out.append(Coefficient(*(text.format(**of, **said) for text in row)))
    return tuple(out)


@dataclass(frozen=True)
class Layout:
    """An ordered list of coefficients: what the entries of a vector mean."""

    coefficients: tuple[Coefficient, ...]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Dotted names in order."""
        return tuple(c.name for c in self.coefficients)

    @cached_property
    def _index(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.names)}

    def __len__(self) -> int:
        return len(self.coefficients)

    def __contains__(self, name: str) -> bool:
        return name in self._index

    def index(self, name: str) -> int:
        """Return the position of coefficient `name`; unknown names raise with a suggestion."""
        try:
            return self._index[name]
        except KeyError:
            raise error(
                "coefficient.unknown",
                name=name,
                hint=suggestion(name, self.names),
                allowed=", ".join(self.names),
            ) from None

    def group(self, prefix: str) -> npt.NDArray[np.intp]:
        """Return the positions of `prefix` itself or of all names below ``prefix.``."""
        found = [i for i, n in enumerate(self.names) if n == prefix or n.startswith(prefix + ".")]
        if not found:
            self.index(prefix)  # raises with a suggestion
        return np.array(found, dtype=np.intp)

    def subset(self, names: Iterable[str]) -> Layout:
        """Return the layout of `names`, in the order given."""
        return Layout(tuple(self.coefficients[self.index(n)] for n in names))


@dataclass(frozen=True)
class CoefficientVector(Shown):
    """Values of the coefficients of a layout, with what is known of their errors.

    Attributes
    ----------
    layout : Layout
        What the entries mean.
    values : ndarray, shape (n,)
        Values [SI unit of each coefficient].
    cov : ndarray, shape (n, n), or None
        Covariance of the errors [product of the SI units]; None where unknown.
    free : ndarray of bool, shape (n,)
        True where the coefficient is estimated, False where it is held at its value.
    prior_sd : ndarray, shape (n,)
        Standard deviation of the prior, infinite where there is none [SI unit].
    """

    layout: Layout
    values: FloatArray
    cov: FloatArray | None = None
    free: npt.NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool))
    prior_sd: FloatArray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        n = len(self.layout)
        object.__setattr__(self, "values", np.asarray(self.values, float).reshape(n))
        if self.free.size == 0:
            object.__setattr__(self, "free", np.ones(n, bool))
        if self.prior_sd.size == 0:
            object.__setattr__(self, "prior_sd", np.full(n, np.inf))

    @classmethod
    def prior(cls, layout: Layout, given: Prior) -> CoefficientVector:
        """Return what is known of the coefficients of `layout` beforehand.

        Parameters
        ----------
        layout : Layout
            The coefficients; unknown names in `given` raise with a suggestion.
        given : mapping of str to (float, float)
            Mean and standard deviation of coefficients or of groups of them [SI].
        """
        mean, sd = np.zeros(len(layout)), np.full(len(layout), np.inf)
        for name, (value, spread) in given.items():
            if not spread >= NARROWEST:
                raise error("prior.sd", name=name, given=f"{spread:.3g}")
            for i in layout.group(name):
                mean[i], sd[i] = value, spread
        return cls(layout, mean, prior_sd=sd)

    @classmethod
    def zeros(cls, layout: Layout) -> CoefficientVector:
        """Return a vector of zeros without covariance."""
        return cls(layout, np.zeros(len(layout)))

    @property
    def names(self) -> tuple[str, ...]:
        """Dotted names in order."""
        return self.layout.names

    @property
    def sd(self) -> FloatArray:
        """Standard deviations, shape (n,), NaN where unknown [SI unit]."""
        if self.cov is None:
            return np.full(len(self.layout), np.nan)
        return np.sqrt(np.maximum(np.diag(self.cov), 0.0))

    def __len__(self) -> int:
        return len(self.layout)

    def __getitem__(self, prefix: str) -> CoefficientVector:
        """Return the coefficients named `prefix` or below ``prefix.``."""
        keep = self.layout.group(prefix)
        return self._take(keep)

    def chosen(self, names: Iterable[str]) -> CoefficientVector:
        """Return the coefficients `names`, in the order given."""
        return self._take(np.array([self.layout.index(name) for name in names], np.intp))

    def with_others(self, others: CoefficientVector) -> CoefficientVector:
        """Return the values of these coefficients and of `others` after them."""
        layout = Layout((*self.layout.coefficients, *others.layout.coefficients))
        return CoefficientVector(layout, np.concatenate([self.values, others.values]))

    def _take(self, keep: npt.NDArray[np.intp]) -> CoefficientVector:
        return CoefficientVector(
            Layout(tuple(self.layout.coefficients[i] for i in keep)),
            self.values[keep],
            None if self.cov is None else self.cov[np.ix_(keep, keep)],
            self.free[keep],
            self.prior_sd[keep],
        )

    def value(self, name: str) -> float:
        """Return the value of coefficient `name` [SI unit]."""
        return float(self.values[self.layout.index(name)])

    def get(self, name: str, default: float = 0.0) -> float:
        """Return the value of `name` [SI unit], or `default` where the layout lacks it."""
        return self.value(name) if name in self.layout else default

    def with_values(self, values: dict[str, float]) -> CoefficientVector:
        """Return a copy with the named `values` [SI unit] replaced."""
        changed = self.values.copy()
        for name, value in values.items():
            changed[self.layout.index(name)] = value
        return replace(self, values=changed)

    def rows(self) -> list[dict[str, Any]]:
        """Return one dictionary per coefficient, as in result.json."""
        group_unit = self._display_units()
        out = []
        for i, c in enumerate(self.layout.coefficients):
            unit = group_unit[i]
            scale = units.factor(unit, c.kind)
            sd = float(self.sd[i])
            out.append(
                {
                    "name": c.name,
                    "symbol": c.symbol,
                    "meaning": c.meaning,
                    "kind": c.kind,
                    "unit": c.unit,
                    "value": float(self.values[i]),
                    "sd": sd if np.isfinite(sd) else None,
                    "free": bool(self.free[i]),
                    "prior_sd": (
                        float(self.prior_sd[i]) if np.isfinite(self.prior_sd[i]) else None
                    ),
                    "display_unit": unit,
                    "display_value": float(self.values[i]) / scale,
                    "display_sd": sd / scale if np.isfinite(sd) else None,
                }
            )
        return out

    def _display_units(self) -> list[str]:
        """One unit per family (``gyro.bias``), so that a column can be compared by eye."""
        family = [n.rpartition(".")[0] or n for n in self.names]
        largest: dict[str, float] = {}
        for name, value in zip(family, self.values, strict=True):
            largest[name] = max(largest.get(name, 0.0), abs(float(value)))
        return [
            units.display_unit(c.kind, largest[f])
            for c, f in zip(self.layout.coefficients, family, strict=True)
        ]

    def __str__(self) -> str:
        """Print as a table: name, symbol, value, sd, unit."""
        lines = [("coefficient", "symbol", "value", "sd", "unit")]
        for row in self.rows():
            size = row["display_sd"]
            sd = "" if size is None else format_value(size, size)
            value = format_value(row["display_value"], size)
            lines.append((row["name"], row["symbol"], value, sd, row["display_unit"]))
        return _columns(lines, right=(2, 3))


def format_value(value: float, sd: float | None) -> str:
    """Write `value` [display unit] to the second significant digit of `sd` [the same unit]."""
    if sd is None or not np.isfinite(sd) or sd <= 0:
        return f"{value:z.6g}"
    decimals = max(0, 1 - int(np.floor(np.log10(sd))))
    return f"{value:z.{min(decimals, 9)}f}"


def _columns(lines: Sequence[tuple[str, ...]], right: tuple[int, ...]) -> str:
    width = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    return "\n".join(
        "  ".join(
            cell.rjust(width[k]) if k in right else cell.ljust(width[k])
            for k, cell in enumerate(line)
        ).rstrip()
        for line in lines
    )


def covariance_problem(cov: FloatArray | None, names: Sequence[str]) -> str | None:
    """Say why `cov`, shape (n, n), of coefficients `names` is no covariance; None where it is.

    Coefficients whose variance is unknown (NaN) or zero (held) are left out.
    """
    if cov is None:
        return None
    sd2 = np.diag(cov)
    if (sd2 < 0).any():
        return f"the variance of {names[int(np.nanargmin(sd2))]} is negative"
    keep = np.flatnonzero(np.isfinite(sd2) & (sd2 > 0))
    sd = np.sqrt(sd2[keep])
    correlation = cov[np.ix_(keep, keep)] / np.outer(sd, sd)
    if not np.isfinite(correlation).all():
        return "a covariance between two coefficients of known variance is null"
    skew = np.abs(correlation - correlation.T)
    if skew.max(initial=0.0) > COVARIANCE_TOLERANCE:
        i, j = np.unravel_index(int(np.argmax(skew)), skew.shape)
        pair = f"{names[keep[i]]} and {names[keep[j]]}"
        return f"it is not symmetric between {pair}"
    if keep.size and np.linalg.eigvalsh(correlation)[0] < -COVARIANCE_TOLERANCE:
        return "a combination of coefficients has a negative variance"
    return None
