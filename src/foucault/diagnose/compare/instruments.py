"""Several instruments side by side: can they be told apart, and is one unlike the others?

Instruments may differ; that is no fault. The chi-square of a coefficient about one common value
says whether the calibrations can tell the instruments apart at all. Which instrument stands out of
a population is decided as in a fleet, see `diagnose.fleet`, and takes as many instruments.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.diagnose import fleet
from foucault.diagnose.compare.changes import upper
from foucault.diagnose.compare.fit import Series, constant
from foucault.diagnose.fleet import Outlying
from foucault.estimate.chi_square import FALSE_ALARM


@dataclass(frozen=True)
class Spread:
    """One coefficient over the instruments."""

    name: str
    mean: float  # of the instruments, each weighted alike [SI]
    spread: float  # standard deviation of the instruments [SI]
    # lowest, highest: extreme values [SI]
    lowest: float
    highest: float
    sd: float  # root mean square of the standard deviations of the calibrations [SI]
    chi_square: float  # about one value for all [1]
    told_apart: bool  # whether that is more than chance, of all coefficients


@dataclass(frozen=True)
class Between:
    """Instruments compared, one result of each."""

    series: Series  # the results; n of them [SI]
    limit: float  # of the chi-square of a coefficient [1]
    spreads: tuple[Spread, ...]  # (p,) coefficient by coefficient
    # what stands out, the farthest first; nothing among few instruments
    outlying: tuple[Outlying, ...]


def between(series: Series) -> Between:
    """Compare instruments.

    `series`: a result of each instrument, two or more [SI].
    """
    n, p = series.values.shape
    limit = upper(n - 1, FALSE_ALARM, p)
    spreads = []
    for k, name in enumerate(series.names):
        x, sd = series.values[:, k], series.sd[:, k]
        chi_square = constant(series.only([k])).chi_square
        spreads.append(
            Spread(
                name, float(x.mean()), float(x.std(ddof=1)), float(x.min()), float(x.max()),
                float(np.sqrt(np.mean(sd**2))), chi_square, chi_square > limit,
            )
        )  # fmt: skip
    odd = fleet.outlying(series.names, series.values, series.sd)
    return Between(series, limit, tuple(spreads), tuple(odd))
