"""Judge a transfer alignment: does what was said of mount and messages explain what was seen?

How innovations are judged is `infer.filtered.components`.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np

from foucault.coefficients import CoefficientVector
from foucault.diagnose.checks import prior_check, status_check
from foucault.errors import Status
from foucault.estimate.chi_square import FALSE_ALARM
from foucault.estimate.delay.fit import Delay
from foucault.estimate.transfer.likeliest import DelayFit
from foucault.estimate.transfer.model import TransferFit, TransferModel
from foucault.infer.filtered import Component, components, dependence
from foucault.infer.linear_filter import LinearRun, conditional
from foucault.result import Check

EACH = FALSE_ALARM / 4
"""False-alarm rate of each of four tests, so that all together keep 1 % [1]."""

HARDLY = 0.7
"""A coefficient whose uncertainty is more than this of what it was before is hardly seen [1]."""

NEAR = 2e-3
"""A delay below this is none [s]."""


@dataclass(frozen=True)
class Evidence:
    """Everything the checks look at."""

    model: TransferModel
    fit: TransferFit  # the model solved by the filter that was chosen
    # what was known of the coefficients and of what is found besides [SI]
    prior: CoefficientVector
    status: Status  # how the passes ended
    delay: Delay | None  # what rate matching has found
    longest: float  # end of the bracket of the delay [s]
    likeliest: DelayFit | None  # the likeliest delay, where it was looked for
    aside: tuple[str, ...]  # groups of coefficients that the motion need not show

    @cached_property
    def states(self) -> CoefficientVector:
        """What was found of `prior`, with covariance [SI]."""
        return self.model.estimate(self.fit, self.prior)


def spreads(e: Evidence) -> dict[str, Component]:
    """Return the innovations of velocities and of attitudes against what is expected of them."""
    return components(e.fit, EACH)


def innovations(e: Evidence) -> dict[str, Any]:
    """Return the innovations of velocities and attitudes in numbers, for result.json."""
    u = e.fit.run.white
    axes = np.sqrt(np.nansum(u**2, axis=0) / np.maximum(np.isfinite(u).sum(axis=0), 1))
    return {
        name: asdict(s) | {"axes": axes[e.model.kinds[name]].tolist()}
        for name, s in spreads(e).items()
    }


def fits(e: Evidence) -> bool:
    """Tell whether no innovations are larger than they may be."""
    return all(s.ratio <= s.high for s in spreads(e).values())


def checks(e: Evidence) -> tuple[Check, ...]:
    """Return every test of the result; a failed one carries its reason."""
    miss = (e.states.values - e.prior.values) / e.prior.prior_sd
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


def _innovations(e: Evidence, name: str, s: Component) -> Check:
    low = s.low if e.fit.nominal else None
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


def whiteness(run: LinearRun) -> tuple[float, float]:
    """Return how much innovations depend on those before them, and what is allowed [1]."""
    return dependence(run, EACH)


def _white(e: Evidence) -> Check:
    worst, limit = whiteness(e.fit.run)
    fine = worst <= limit
    words = "Innovations are independent of one another."
    if not fine:
        words = (
            "Innovations depend on those before them: the mount bends (load, flexure_sd), the "
            "slave is noisier than stated, or the master's own filter smooths what it says."
        )
    return Check("whiteness", worst, None, limit, fine, words)


def hardly(e: Evidence) -> tuple[str, ...]:
    """Return the coefficients that the motion shows hardly anything of.

    What the motion shows, and what is only counted with hides again, is `hidden`.
    """
    return unknown(e.states, e.aside, motion=True)


def hidden(e: Evidence) -> list[str]:
    """Return the coefficients that the motion shows, were it not for what is counted with."""
    unseen = hardly(e)
    return [n for n in unknown(e.states, e.aside, motion=False) if n not in unseen]


def unknown(c: CoefficientVector, aside: tuple[str, ...], *, motion: bool) -> tuple[str, ...]:
    """Return the coefficients that are hardly better known than before.

    `c`: with covariance and prior [SI]; `aside`: groups that are only counted with; `motion`: as
    if these were known.
    """
    assert c.cov is not None
    others = [i for i, n in enumerate(c.names) if n.startswith(aside)]
    sd = np.sqrt(np.maximum(np.diag(conditional(c.cov, others) if motion else c.cov), 0.0))
    return tuple(n for n, s, p in zip(c.names, sd, c.prior_sd, strict=True)
                 if s > HARDLY * p and not n.startswith(aside))  # fmt: skip


def _seen(e: Evidence) -> Check:
    names = hardly(e)
    words = "The motion tells something of every coefficient."
    if names:
        words = (
            f"The motion tells hardly anything of {', '.join(names)}: what is said of them is "
            "what was known before."
        )
    return Check("seen", float(len(names)), None, 0.0, not names, words)
