"""The usual mistakes, each as a change of the readings, and the function that asks which it was.

Declared readings x are the right ones changed, ``x = M x_right``. Another unit, or sums over the
interval for rates, is a factor; exchanged and reversed columns are a signed permutation. A guard
says of readings how far they are from what they should be, by something that is quick to compute;
`explain` asks it of the readings without each mistake, ``M^-1 x``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import permutations, product

import numpy as np

from foucault.arrays import FloatArray
from foucault.tables import AXES
from foucault.units import STANDARD_GRAVITY

DEGREE = float(np.radians(1.0))
UNITS = {
    "gyro": {"rad/s": 1.0, "deg/s": DEGREE, "deg/h or arcsec/s": DEGREE / 3600.0},
    "accel": {"m/s^2": 1.0, "g": STANDARD_GRAVITY, "mg": STANDARD_GRAVITY / 1e3,
              "ug": STANDARD_GRAVITY / 1e6},
}  # fmt: skip
"""Units that readings are taken for one another in [SI]."""

SUMS = "increments were declared as rates"

NEAR = 1.1
"""A factor is a usual one within this factor [1]."""


@dataclass(frozen=True)
class Mistake:
    """What was done wrong, and how readings are without it: ``M^-1 = factor * exchange``."""

    words: str = ""  # what was done
    factor: float = 1.0  # what declared readings are multiplied by to be right [1]
    # (k, k) signed permutation that takes declared columns to axes [1]
    exchange: FloatArray = field(default_factory=lambda: np.eye(3))
    of: str = "gyro"  # the block of readings that it changed
    code: str = ""  # of `symptoms`, where a guard knows several

    def right(self, x: FloatArray, of: str | None = None) -> FloatArray:
        """Return `x` (..., k) [SI] of the block `of` without the mistake; NaN stays alone."""
        if of not in (None, self.of):
            return x
        place = np.argmax(np.abs(self.exchange), axis=1)
        signs = self.exchange[np.arange(len(place)), place]
        return np.asarray(x[..., place] * (self.factor * signs))

    @property
    def weight(self) -> float:
        """How unlikely it is: of several that explain as much, the lightest is named [1]."""
        # A factor that leaves next to nothing explains whatever did not move.
        unit = 10.0 if self.factor != 1.0 else 0.0
        moved, signs = np.trace(np.abs(self.exchange)), np.sum(self.exchange < 0)
        return float(unit + 3.0 - moved + 0.6 * signs)

    @property
    def one_axis(self) -> float:
        """What the readings of one axis alone are multiplied by, 0 where it is not one [1]."""
        size = np.diag(self.exchange)
        odd = size[np.abs(size) != 1.0]
        return float(odd[0]) if len(odd) == 1 and odd[0] != 0.0 else 0.0

    @property
    def left_handed(self) -> bool:
        """Whether no rotation does the same."""
        return bool(np.linalg.det(self.exchange) < 0)


NONE = Mistake()
"""Readings as they were declared."""


@dataclass(frozen=True)
class Explained:
    """What mistakes have to say of readings that are off."""

    now: float  # how far they are off as declared [as the guard's misfit]
    least: float  # and without the mistake that explains them best [as the guard's misfit]
    by: tuple[Mistake, ...] = ()  # mistakes that explain them as well, the simplest first


def explain(
    miss: Callable[[Mistake], float],
    tried: Iterable[Mistake],
    *,
    wrong: float,
    fits: float = np.inf,
    better: float = 1.0,
    alike: float = 1.001,
    within: float = 0.0,
    now: float | None = None,
) -> Explained:
    """Ask which mistakes explain readings that are off.

    `miss`: how far readings are off without a mistake [of the guard]; `tried`: the mistakes, the
    simplest first; `wrong`: what is off by less is not wrong [as `miss`]; `fits`: the best explains
    it if it leaves at most that [as `miss`]; `better`: and at most this part of what there was [1];
    `alike`: with it those that leave so many times as much [1]; `within`: or no more than that
    [as `miss`]; `now` or None: how far the readings are off, where not `miss` of none [as `miss`].
    """
    now = miss(NONE) if now is None else now
    if not now >= wrong:  # nor is what is no number
        return Explained(now, now)
    found = [(miss(one), one) for one in tried]
    least = min((x for x, _ in found if np.isfinite(x)), default=np.inf)
    if not (least <= fits and least <= better * now):
        return Explained(now, least)
    return Explained(now, least, tuple(one for x, one in found if x <= max(alike * least, within)))


# -- exchanged and reversed columns --------------------------------------------------------------


@cache
def exchanges() -> tuple[FloatArray, ...]:
    """Return the 48 signed permutations of three axes, each (3, 3), the simplest first.

    One swap of columns or one sign is likelier than both, and what keeps an axis than what does
    not.
    """
    every = (
        np.eye(3)[list(order)] * np.array(signs)[:, None]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    )
    return tuple(sorted(every, key=lambda x: Mistake(exchange=x).weight))


def columns(exchange: FloatArray, names: Sequence[str] = tuple(AXES)) -> list[str]:
    """Name the column of each axis, "-" before a reversed one, in `exchange` (k, k) [1]."""
    place = np.argmax(np.abs(exchange), axis=1)
    return [("-" if row[k] < 0 else "") + names[k] for row, k in zip(exchange, place, strict=True)]


def exchange_words(exchange: FloatArray) -> str:
    """Write `exchange` (3, 3) [1] as body axis = declared column: "x = +y, y = -x"."""
    named = zip(AXES, columns(exchange), strict=True)
    return ", ".join(f"{a} = {c if c[0] == '-' else '+' + c}" for a, c in named)


def plainly(exchange: FloatArray) -> str:
    """Say what `exchange` (3, 3) [1] does to gyros: "gyro x and y are exchanged"."""
    order = np.argmax(np.abs(exchange), axis=1)
    moved = [AXES[i] for i in np.flatnonzero(order != np.arange(3))]
    turned = [AXES[k] for i, k in enumerate(order) if exchange[i, k] < 0]
    words = []
    if len(moved) == 2:
        words.append(f"gyro {moved[0]} and {moved[1]} are exchanged")
    elif moved:
        words.append("the gyro axes are exchanged in a circle")
    if turned:
        verb = "are" if len(turned) > 1 else "is"
        words.append(f"gyro {' and '.join(turned)} {verb} reversed")
    return ", ".join(words)


# -- units, and increments for rates -------------------------------------------------------------


def factors(triad: str, interval: float) -> dict[float, str]:
    """Return what makes readings too large [1] -> what was done; `interval`: NaN for none [s]."""
    out = {interval: SUMS, 1.0 / interval: "rates were declared as increments"}
    out = out if interval > 0 else {}
    for (true, one), (said, other) in permutations(UNITS[triad].items(), 2):
        words = f"the unit is {true} and was declared as {said}"
        out.setdefault(float(f"{other / one:.6g}"), words)
    return out


def one_unit(triad: str, sizes: Iterable[float]) -> list[Mistake]:
    """Return the mistakes of one column in another unit, of right factors `sizes` [1]."""
    return [
        Mistake(AXES[k], exchange=np.diag([size if i == k else 1.0 for i in range(3)]), of=triad)
        for size in sizes
        for k in range(3)
    ]


def likely(ratio: float, known: dict[float, str], near: float = NEAR) -> str | None:
    """Say what makes readings too large, None where no usual mistake does.

    `ratio`: so many times [1]; `known`: as of `factors` [1]; `near`: a factor is a usual one within
    this factor [1].
    """
    best = min(known, key=lambda factor: abs(np.log(max(ratio, 1e-300) / factor)))
    return known[best] if 1 / near < ratio / best < near else None


def rate_hint(ratio: float) -> str:
    """Return the sentence on degrees and radians that a `ratio` of rates [1] asks for, or none."""
    if 0.9 < ratio * np.degrees(1) < 1.1:
        return " That is rad/s read as deg/s."
    return " That is deg/s." if 0.9 < ratio / np.degrees(1) < 1.1 else ""
