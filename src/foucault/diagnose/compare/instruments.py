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
    """One coefficient over the instruments.

    Attributes
    ----------
    name : str
        The coefficient.
    mean : float
        Of the instruments, each weighted alike [SI].
    spread : float
        Standard deviation of the instruments [SI].
    lowest, highest : float
        Extreme values [SI].
    sd : float
        Root mean square of the standard deviations of the calibrations [SI].
    chi_square : float
        About one value for all [1].
    told_apart : bool
        Whether that is more than chance, of all coefficients.
    """

    name: str
    mean: float
    spread: float
    lowest: float
    highest: float
    sd: float
    chi_square: float
    told_apart: bool


@dataclass(frozen=True)
class Between:
    """Instruments compared, one result of each.

    Attributes
    ----------
    series : Series
        The results; n of them [SI].
    limit : float
        Of the chi-square of a coefficient [1].
    spreads : tuple of Spread, shape (p,)
        Coefficient by coefficient.
    outlying : tuple of Outlying
        What stands out, the farthest first; nothing among few instruments.
    """

    series: Series
    limit: float
    spreads: tuple[Spread, ...]
    outlying: tuple[Outlying, ...]


def between(series: Series) -> Between:
    """Compare instruments.

    Parameters
    ----------
    series : Series
        A result of each instrument, two or more [SI].
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
