"""What a planned motion will show of the coefficients, said before anything is measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from foucault import units
from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.errors import Finding
from foucault.plans.limit import Limit
from foucault.result import TableData


@dataclass(frozen=True)
class Leg:
    """A part of a plan with one rate, and what is seen once it is over."""

    # start, end: when it begins and ends [s]
    start: float
    end: float
    rate: tuple[float, float, float]  # (3,) mean command about x, y and z [rad/s]
    rank: int  # combinations of the states that are seen by then [1]
    alone: int  # states that are seen each by itself by then [1]


@dataclass(frozen=True)
class Extra:
    """What a little more of a plan would buy."""

    what: str  # the addition, in words
    time: float  # how much longer it all takes [s]
    ratio: float  # geometric mean of sd with it over sd without [1]
    # coefficients that gain most, and sd with it over sd without [1]
    best: tuple[tuple[str, float], ...] = ()

    @classmethod
    def of(cls, what: str, time: float, names: tuple[str, ...], ratio: FloatArray) -> Extra:
        """Return it from `time` more [s] and the `ratio` (n,) of sd with it to sd without [1]."""
        order = np.argsort(ratio)[:GAINING]
        best = tuple((names[i], float(ratio[i])) for i in order)
        return cls(what, time, float(np.exp(np.log(ratio).mean())), best)

    @property
    def gains(self) -> bool:
        """Whether some coefficient gains by it."""
        return any(ratio < NO_GAIN for _, ratio in self.best)


GAINING = 3  # So many of the coefficients that gain most are named [1].
NO_GAIN = 0.98  # A ratio of sd above it is no gain [1].


@dataclass(frozen=True)
class Foresight:
    """What a planned motion will show."""

    # where the model was linearised, with the covariance that the result will have and the sd of
    # the prior, infinite where there is none [SI]
    coefficients: CoefficientVector
    linearised_at: str  # the same in words
    plan: str  # what the plan is called
    duration: float  # time it takes, moves included [s]
    states: int  # number of unknowns, what is not reported among them [1]
    rank: int  # combinations of them that the whole plan shows [1]
    # smallest singular value that counts over the largest, priors as units [1]
    smallest: float | None = None
    fastest: float | None = None  # largest rate of the plan about an axis [rad/s]
    rate_limit: float | None = None  # what the rig allows [rad/s]
    legs: tuple[Leg, ...] = ()  # the plan of a torqued cluster, leg by leg
    hardly: tuple[str, ...] = ()  # coefficients that will be known hardly better than before
    unseen: tuple[str, ...] = ()  # combinations that nothing in the plan shows
    # combinations that will remain most uncertain against the prior, worst first
    remaining: tuple[str, ...] = ()
    # combinations that are harder to see than each of their coefficients alone, worst first
    weakest: tuple[str, ...] = ()
    # pairs whose errors will be most correlated [1]
    correlated: tuple[tuple[str, str, float], ...] = ()
    limits: tuple[Limit, ...] = ()  # what the plan needs of the rig
    more: tuple[Extra, ...] = ()  # what a little more would buy
    # whether the angles of the attitude at the end are no measure: see `findings`
    singular: bool = False
    # (n,) the least that any estimate from these readings could have, the sensors' noise alone [SI]
    bound: FloatArray | None = None
    budget: Mapping[str, FloatArray] = field(default_factory=dict)  # source -> variances (n,) [SI]
    left_out: TableData | None = None  # what is not estimated: see `diagnose.left_out.foretold`
    findings: tuple[Finding, ...] = ()  # what the user should know

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
        with np.errstate(invalid="ignore"):  # neither known before nor seen
            return np.asarray(self.sd / self.prior_sd)

    @property
    def complete(self) -> bool:
        """Whether all is seen, every coefficient better than before, and the rig can do it."""
        seen = self.rank == self.states and not self.hardly
        return seen and all(limit.kept for limit in self.limits)

    def rows(self) -> list[dict[str, Any]]:
        """Return one dictionary per coefficient, in SI and in the unit that reports show."""
        out, rows = [], self.coefficients.rows()
        shown = units.display_units([row["kind"] for row in rows], self.sd)
        for row, unit, share in zip(rows, shown, self.share, strict=True):
            sd, before = row["sd"], row["prior_sd"]
            out.append(
                {key: row[key] for key in ("name", "unit", "sd", "prior_sd")}
                | {
                    "of_prior": None if before is None else float(share),
                    **self._made_of(row["name"]),
                    "display_unit": unit,
                    "display_sd": None if sd is None else units.convert(sd, row["kind"], unit),
                    "display_prior_sd": (
                        None if before is None else units.convert(before, row["kind"], unit)
                    ),
                }
            )
        return out

    def _left_out(self) -> list[dict[str, Any]]:
        """Return one dictionary per group of what is not estimated; None for what never shows."""
        assert self.left_out is not None
        columns = {k: v.tolist() for k, v in self.left_out.items()}
        rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
        return [r | {"needed": r["needed"] if np.isfinite(r["needed"]) else None} for r in rows]

    def _made_of(self, name: str) -> dict[str, Any]:
        """Return bound and largest source of a coefficient, where they are known."""
        k, out = self.names.index(name), dict[str, Any]()
        if self.bound is not None:
            out["bound"] = float(self.bound[k]) if np.isfinite(self.bound[k]) else None
        if self.budget and np.isfinite(self.sd[k]):
            most = max(self.budget, key=lambda source: float(self.budget[source][k]))
            share = float(self.budget[most][k]) / self.sd[k] ** 2
            out |= {"mostly": most, "mostly_share": share}
        return out

    def as_dict(self) -> dict[str, Any]:
        """Return all of it as JSON: SI, and the display units beside."""
        plain = ("linearised_at", "plan", "duration", "fastest", "rate_limit", "states", "rank")
        lists = ("hardly", "unseen", "remaining", "weakest")
        return (
            {key: getattr(self, key) for key in (*plain, "smallest", "complete", "singular")}
            | {"coefficients": self.rows(), "legs": [asdict(leg) for leg in self.legs]}
            | {"budget": {source: part.tolist() for source, part in self.budget.items()}}
            | {"limits": [asdict(item) | {"kept": item.kept} for item in self.limits]}
            | {"more": [asdict(item) for item in self.more]}
            | ({} if self.left_out is None else {"left_out": self._left_out()})
            | {key: list(getattr(self, key)) for key in lists}
            | {
                "correlated": [list(pair) for pair in self.correlated],
                "findings": [item.as_dict() for item in self.findings],
            }
        )
