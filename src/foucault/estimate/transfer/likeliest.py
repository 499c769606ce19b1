"""What makes the messages likeliest: their delay, and how far and how slowly a mount bends.

A bending that comes and goes makes innovations that depend on those before them: their likelihood
has its maximum where sd and correlation time of the process are the true ones, and where what is
left, which is faster than the messages, is the noise of the attitudes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.estimate.transfer.model import TransferModel, bending
from foucault.estimate.transfer.slave import Linearisation
from foucault.infer.linear_filter import LinearRun, LinearSystem, kalman
from foucault.models.transfer import LIVELY

EVALUATIONS = 80
"""Runs of the filter at most [1]."""

STARTS = (1.0, 10.0)
"""Correlation times that are tried first [s]."""

MOST = np.log(1e3)
"""Logarithm of how far the search goes from where it starts [1]."""


@dataclass(frozen=True)
class DelayFit:
    """The delay for which the messages are likeliest."""

    # delay, sd: delay and its standard deviation, from the curvature of the likelihood [s]
    delay: float
    sd: float
    # tried, log_likelihood: (k,) what was tried [s], and how likely [1]
    tried: FloatArray
    log_likelihood: FloatArray
    at_edge: bool  # whether it lies at an end of the bracket: it may be outside


def likeliest_delay(model: TransferModel, bracket: tuple[float, float]) -> DelayFit:
    """Return the delay of maximum likelihood, the rest being estimated for each that is tried.

    `model`: without the delay as a state, that of its start is not used; `bracket`: where it may
    lie [s].

    Messages that hold before the start of the run with the largest delay are left out for all, so
    that every delay is judged by the same ones.
    """
    from scipy.optimize import minimize_scalar

    increments, master = model.slave.increments, model.master
    start = float(increments.time[model.slave.first]) + 2 * float(np.median(increments.dt))
    same = replace(model, master=master[master.time - bracket[1] > start])
    tried: list[tuple[float, float]] = []

    def against(tau: float) -> float:
        system = same.about(replace(model.start, delay=tau))
        tried.append((tau, kalman(system).log_likelihood))
        return -tried[-1][1]

    found = minimize_scalar(against, bounds=bracket, method="bounded",
                            options={"xatol": 1e-5, "maxiter": 40})  # fmt: skip
    tau = float(found.x)
    width = max(2e-4, 0.01 * (bracket[1] - bracket[0]))
    sides = [against(tau + d) - found.fun for d in (-width, width)]
    curvature = float(np.sum(sides)) / width**2
    each, likely = np.array(sorted(tried)).T
    edge = min(tau - bracket[0], bracket[1] - tau) < width
    return DelayFit(tau, curvature**-0.5 if curvature > 0 else np.inf, each, likely, edge)


@dataclass(frozen=True)
class FlexureFit:
    """The likeliest bending."""

    sd: float  # standard deviation [rad]
    time: float  # correlation time [s]
    attitude_sd: float  # sd of what is left of the difference of attitudes [rad]
    # by how much the log-likelihood is higher than it was, and than that of a rigid mount whose
    # attitudes have another noise [1]
    gain: float
    run: LinearRun  # the filter that knows it


def likeliest_flexure(model: TransferModel, at: Linearisation, likelihood: float) -> FlexureFit:
    """Return the bending of maximum likelihood, all else being estimated for each that is tried.

    `model`: its bending is not used, attitudes are, their sd is where the search starts;
    `likelihood`: log-likelihood so far [1].
    """
    from scipy.optimize import minimize, minimize_scalar

    mount, attitude_sd = model.mount, model.matching.attitude_sd
    known = dict(zip(model.names, model.sd, strict=True))
    some = replace(model, mount=replace(mount, flexure_sd=attitude_sd, flexure_time=STARTS[0]))
    free = replace(some, sd=np.array([known.get(name, 0.0) for name in some.names])).about(at)
    layout, steps = some.layout, some.steps(free.rows)

    def system(x: FloatArray) -> LinearSystem:
        size, slow, noise = np.exp(x).tolist()
        m = replace(mount, flexure_sd=size, flexure_time=slow)
        bending(free.Phi, free.half, layout, steps, m)
        for name, value in (("flexure", size), ("flexure_rate", size * LIVELY / slow)):
            i = layout.group(name)
            free.P0[i, i] = value**2
        R = free.R.copy()
        R[:, 3:] = noise**2
        return replace(free, R=R)

    def against(x: FloatArray) -> float:
        if np.any(np.abs(x - start) > MOST):
            return np.inf
        return -kalman(system(x)).log_likelihood

    tried = []
    for first in STARTS:
        start = np.log([attitude_sd, first, attitude_sd])
        tried.append((against(start), first))
    start = np.log([attitude_sd, min(tried)[1], attitude_sd])
    corners = start + np.vstack([np.zeros(3), np.diag([-1.0, 1.0, -0.5])])
    best = minimize(against, start, method="Nelder-Mead",
                    options={"maxfev": EVALUATIONS, "xatol": 0.03, "fatol": 0.2,
                             "initial_simplex": corners})  # fmt: skip
    size, slow, noise = np.exp(best.x).tolist()
    # Attitudes that are noisier or quieter than was said are no mount that bends.
    rigid = minimize_scalar(
        lambda x: against(np.array([start[0] - MOST, start[1], x])),
        bounds=(start[2] - MOST, start[2] + MOST), method="bounded", options={"xatol": 0.03},
    )  # fmt: skip
    so_far = max(likelihood, -float(rigid.fun))
    return FlexureFit(size, slow, noise, -float(best.fun) - so_far, kalman(system(best.x)))
