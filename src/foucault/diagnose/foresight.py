"""What a planned motion will show of the coefficients, said before anything is measured."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault import units
from foucault.coefficients import CoefficientVector
from foucault.errors import Finding

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Leg:
    """A part of a plan with one rate, and what is seen once it is over.

    Attributes
    ----------
    start, end : float
        When it begins and ends [s].
    rate : tuple of float, shape (3,)
        Mean command about x, y and z [rad/s].
    rank : int
        Combinations of the states that are seen by then [1].
    alone : int
        States that are seen each by itself by then [1].
    """

    start: float
    end: float
    rate: tuple[float, float, float]
    rank: int
    alone: int


@dataclass(frozen=True)
class Foresight:
    """What a planned motion will show.

    Attributes
    ----------
    coefficients : CoefficientVector
        Where the model was linearised, with the covariance that the result will have and the sd
        of the prior, infinite where there is none [SI].
    linearised_at : str
        The same in words.
    plan : str
        What the plan is called.
    duration : float
        Time it takes [s].
    fastest : float
        Largest rate of the plan about an axis [rad/s].
    rate_limit : float or None
        What the rig allows [rad/s].
    states : int
        Number of unknowns, the attitude at the start among them [1].
    smallest : float
        Smallest singular value that counts over the largest, priors as units [1].
    legs : tuple of Leg
        The plan, leg by leg.
    hardly : tuple of str
        Coefficients that will be known hardly better than before.
    unseen : tuple of str
        Combinations that no leg shows.
    remaining : tuple of str
        Combinations that will remain most uncertain against the prior, worst first.
    weakest : tuple of str
        Combinations that are harder to see than each of their coefficients alone, worst first.
    correlated : tuple of (str, str, float)
        Pairs whose errors will be most correlated [1].
    singular : bool
        Whether the angles of the attitude at the end are no measure: see `findings`.
    findings : tuple of Finding
        What the user should know.
    """

    coefficients: CoefficientVector
    linearised_at: str
    plan: str
    duration: float
    fastest: float
    rate_limit: float | None
    states: int
    smallest: float
    legs: tuple[Leg, ...]
    hardly: tuple[str, ...]
    unseen: tuple[str, ...]
    remaining: tuple[str, ...]
    weakest: tuple[str, ...]
    correlated: tuple[tuple[str, str, float], ...]
    singular: bool = False
    findings: tuple[Finding, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Coefficients that will be estimated."""
        return self.coefficients.names

    @property
    def sd(self) -> FloatArray:
        """Standard deviation of each after the session, shape (n,) [SI]."""
        return self.coefficients.sd

    @property
    def prior_sd(self) -> FloatArray:
        """Standard deviation of each beforehand, shape (n,), infinite where there is none [SI]."""
        return self.coefficients.prior_sd

    @property
    def share(self) -> FloatArray:
        """Share of the prior that will be left, shape (n,), zero where there is no prior [1]."""
        return np.asarray(self.sd / self.prior_sd)

    @property
    def rank(self) -> int:
        """Combinations of the states that the whole plan shows."""
        return self.legs[-1].rank

    @property
    def complete(self) -> bool:
        """Whether all is seen, and every coefficient better than before."""
        return self.rank == self.states and not self.hardly

    def rows(self) -> list[dict[str, Any]]:
        """Return one dictionary per coefficient, in SI and in the unit that reports show."""
        out = []
        for row, share in zip(self.coefficients.rows(), self.share, strict=True):
            before, unit = row["prior_sd"], row["display_unit"]
            out.append(
                {key: row[key] for key in ("name", "unit", "sd", "prior_sd")}
                | {
                    "of_prior": None if before is None else float(share),
                    "display_unit": unit,
                    "display_sd": row["display_sd"],
                    "display_prior_sd": (
                        None if before is None else units.convert(before, row["kind"], unit)
                    ),
                }
            )
        return out

    def as_dict(self) -> dict[str, Any]:
        """Return all of it as JSON: SI, and the display units beside."""
        plain = ("linearised_at", "plan", "duration", "fastest", "rate_limit", "states", "rank")
        lists = ("hardly", "unseen", "remaining", "weakest")
        return (
            {key: getattr(self, key) for key in (*plain, "smallest", "complete", "singular")}
            | {"coefficients": self.rows(), "legs": [asdict(leg) for leg in self.legs]}
            | {key: list(getattr(self, key)) for key in lists}
            | {
                "correlated": [list(pair) for pair in self.correlated],
                "findings": [item.as_dict() for item in self.findings],
            }
        )
