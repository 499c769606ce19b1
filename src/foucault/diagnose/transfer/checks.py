"""Judge a transfer alignment: does what was said of mount and messages explain what was seen?

Innovations of a Kalman filter that was told the truth are independent, with the variance it says.
What bends between master and slave and is not modelled makes them depend on one another; the sum of
their squares then scatters as that of fewer, ``n / (1 + 2 sum rho_k^2)`` with rho_k their
autocorrelation, and so it is judged.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.checks import prior_check, status_check
from foucault.errors import Status
from foucault.estimate.chi_square import FALSE_ALARM, chi_square_limits
from foucault.estimate.delay.fit import Delay
from foucault.estimate.linear_filter import given
from foucault.estimate.transfer.fit import DelayFit, Transfer
from foucault.estimate.transfer.measured import Known, Slave
from foucault.models.transfer import Matching, Messages, Mount
from foucault.result import Check

EACH = FALSE_ALARM / 4
"""False-alarm rate of each of four tests, so that all together keep 1 % [1]."""

LAGS, FEW = 50, 5
"""Autocorrelations that count for how many innovations there are in effect, and for whether they
are independent at all [1]."""

HARDLY = 0.7
"""A coefficient whose uncertainty is more than this of what it was before is hardly seen [1]."""

NEAR = 2e-3
"""A delay below this is none [s]."""

BLOCKS = {"velocity": slice(0, 3), "attitude": slice(3, 6)}
"""Kind of innovation -> its columns."""


@dataclass(frozen=True)
class Evidence:
    """Everything the checks look at."""

    slave: Slave
    master: Messages  # what the master said
    mount: Mount  # how they are fixed together
    matching: Matching  # what of the messages is used
    found: Transfer
    # coefficients and what is found besides, with covariance and prior [SI]
    states: CoefficientVector
    prior: Known  # what was known beforehand
    mean: FloatArray  # (p,) mean of the prior of `states` [SI]
    sd: FloatArray  # (n,) how well all states were known [SI]
    status: Status  # how the passes ended
    nominal: bool  # whether the covariance is meant to be that of the error: of a Kalman filter
    delay: Delay | None  # what rate matching has found
    longest: float  # end of the bracket of the delay [s]
    fit: DelayFit | None
    aside: tuple[str, ...] = ()  # groups of coefficients that the motion need not show


def standardised(e: Evidence) -> FloatArray:
    """Return the innovations over their standard deviations, shape (m, 6); NaN where none [1]."""
    run = e.found.run
    with np.errstate(invalid="ignore"):
        return np.asarray(run.innovation / np.sqrt(run.variance))


def autocorrelation(u: FloatArray, lags: int) -> FloatArray:
    """Return the autocorrelation of a sequence at lags 1 to `lags`, shape (lags,) [1].

    `u` (m,): values about zero [unit]; `lags`: number of lags [1].
    """
    total = float(u @ u)
    return np.array([u[k:] @ u[:-k] / total for k in range(1, lags + 1)])


def effective(u: FloatArray) -> float:
    """Return as how many independent values the squares of a sequence scatter [1].

    `u` (m,): values about zero [unit].
    """
    m = len(u)
    rho = autocorrelation(u, min(LAGS, m // 4))
    # A sequence of independent values has squared correlations of 1 / m on average.
    return m / (1.0 + 2.0 * max(0.0, float(np.sum(rho**2 - 1.0 / m))))


@dataclass(frozen=True)
class Spread:
    """Innovations of one kind against what is expected of them."""

    # ratio, low, high: root mean square of what is standardised, and its limits [1]
    ratio: float
    low: float
    high: float
    count: int  # number of innovations [1]
    independent: float  # as how many independent ones their squares scatter [1]

    @classmethod
    def of(cls, u: FloatArray, tests: int) -> Spread | None:
        """Judge standardised innovations.

        `u` (m, q): innovations over their standard deviations, NaN where there is none [1];
        `tests`: how many kinds are judged [1].
        """
        columns = [c[np.isfinite(c)] for c in u.T if np.isfinite(c).sum() > LAGS]
        if not columns:
            return None
        count = sum(len(c) for c in columns)
        independent = sum(effective(c) for c in columns)
        low, high = (v / independent for v in chi_square_limits(independent, EACH, tests))
        square = float(sum(c @ c for c in columns)) / count
        return cls(float(np.sqrt(square)), float(np.sqrt(low)), float(np.sqrt(high)), count,
                   independent)  # fmt: skip


def spreads(e: Evidence) -> dict[str, Spread]:
    """Return the innovations of velocities and of attitudes against what is expected of them."""
    u = standardised(e)
    made = {name: Spread.of(u[:, block], len(BLOCKS)) for name, block in BLOCKS.items()}
    return {name: one for name, one in made.items() if one is not None}


def spread(e: Evidence) -> dict[str, Any]:
    """Return the innovations of velocities and attitudes in numbers, for result.json."""
    u = standardised(e)
    axes = np.sqrt(np.nansum(u**2, axis=0) / np.maximum(np.isfinite(u).sum(axis=0), 1))
    return {
        name: {"ratio": s.ratio, "low": s.low, "high": s.high, "count": s.count,
               "independent": s.independent, "axes": axes[BLOCKS[name]].tolist()}
        for name, s in spreads(e).items()
    }  # fmt: skip


def checks(e: Evidence) -> tuple[Check, ...]:
    """Return every test of the result; a failed one carries its reason."""
    miss = (e.states.values - e.mean) / e.states.prior_sd
    return (
        status_check(e.status, ()), *(_innovations(e, *item) for item in spreads(e).items()),
        _white(e), prior_check(e.states, miss), _seen(e), *_bracket(e),
    )  # fmt: skip


def bracket(e: Evidence) -> tuple[float, float] | None:
    """Return between what the delay is expected, as well as it is known; None where it is given.

    Returns limits [s].
    """
    if "master.delay" not in e.states.layout:
        return None
    margin = 3.0 * float(e.states["master.delay"].sd[0])
    return -margin - NEAR, e.longest + margin


def _bracket(e: Evidence) -> tuple[Check, ...]:
    limits = bracket(e)
    if limits is None:
        return ()
    tau, (low, high) = e.states.value("master.delay"), limits
    fine = low <= tau <= high
    words = f"The delay of {1e3 * tau:.1f} ms is one that messages can have."
    if not fine:
        words = (
            f"The delay of {1e3 * tau:.1f} ms lies outside of 0 to {1e3 * e.longest:.1f} ms: the "
            "clocks differ, or longest_delay is too small."
        )
    return (Check("delay", 1e3 * tau, 1e3 * low, 1e3 * high, fine, words),)


def _innovations(e: Evidence, name: str, s: Spread) -> Check:
    low = s.low if e.nominal else None
    fine = s.ratio <= s.high and (low is None or s.ratio >= low)
    words = f"The {name} of the messages scatters {s.ratio:.3f} times as much as allowed for"
    if s.ratio > s.high:
        words += (
            f", more than {s.high:.3f}: {name}_sd is too small, or there is something between "
            "master and slave that is not modelled, and the uncertainties are too small"
        )
    elif not fine:
        words += f", less than {s.low:.3f}: {name}_sd, and with it the uncertainties, is too large"
    return Check(f"{name} innovations", s.ratio, low, s.high, fine, words + ".")


def whiteness(e: Evidence) -> tuple[float, float]:
    """Return how much innovations depend on those before them, and what is allowed [1]."""
    u = standardised(e)
    columns = [c[np.isfinite(c)] for c in u.T if np.isfinite(c).sum() > LAGS]
    sums = np.array([len(c) * np.sum(autocorrelation(c, FEW) ** 2) for c in columns])
    limit = chi_square_limits(FEW, 2 * EACH, max(len(columns), 1))[1]
    return float(sums.max(initial=0.0)), float(limit)


def _white(e: Evidence) -> Check:
    worst, limit = whiteness(e)
    fine = worst <= limit
    words = "Innovations are independent of one another."
    if not fine:
        words = (
            "Innovations depend on those before them: the mount bends (load, flexure_sd), the "
            "slave is noisier than stated, or the master's own filter smooths what it says."
        )
    return Check("whiteness", worst, None, limit, fine, words)


def hardly(e: Evidence) -> list[str]:
    """Return the coefficients that the motion shows hardly anything of.

    What the motion shows, and what is only counted with hides again, is `hidden`.
    """
    return _unknown(e, motion=True)


def hidden(e: Evidence) -> list[str]:
    """Return the coefficients that the motion shows, were it not for what is counted with."""
    unseen = hardly(e)
    return [n for n in _unknown(e, motion=False) if n not in unseen]


def _unknown(e: Evidence, *, motion: bool) -> list[str]:
    c, names = e.states, e.states.names
    assert c.cov is not None
    aside = [i for i, n in enumerate(names) if n.startswith(e.aside)]
    variance = np.diag(given(c.cov, aside) if motion else c.cov)
    return [n for n, s, p in zip(names, np.sqrt(np.maximum(variance, 0.0)), c.prior_sd, strict=True)
            if s > HARDLY * p and not n.startswith(e.aside)]  # fmt: skip


def _seen(e: Evidence) -> Check:
    names = hardly(e)
    words = "The motion tells something of every coefficient."
    if names:
        words = (
            f"The motion tells hardly anything of {', '.join(names)}: what is said of them is "
            "what was known before."
        )
    return Check("seen", float(len(names)), None, 0.0, not names, words)
