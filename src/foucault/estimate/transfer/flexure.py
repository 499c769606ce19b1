"""How far and how slowly a mount bends: what makes the messages likeliest.

A bending that comes and goes makes innovations that depend on those before them: their likelihood
has its maximum where sd and correlation time of the process are the true ones, and where what is
left, which is faster than the messages, is the noise of the attitudes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import Layout
from foucault.estimate.linear_filter import LinearRun, LinearSystem, kalman
from foucault.estimate.transfer.measured import Known, Slave
from foucault.estimate.transfer.system import bending, free_run
from foucault.models.transfer import LIVELY, Matching, Messages, Mount, states_of_transfer

EVALUATIONS = 80
"""Runs of the filter at most [1]."""

STARTS = (1.0, 10.0)
"""Correlation times that are tried first [s]."""

MOST = np.log(1e3)
"""Logarithm of how far the search goes from where it starts [1]."""


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


def likeliest_flexure(
    slave: Slave, master: Messages, mount: Mount, matching: Matching, at: Known, prior: Known,
    sd: FloatArray, layout: Layout, likelihood: float,
) -> FlexureFit:  # fmt: skip
    """Return the bending of maximum likelihood, all else being estimated for each that is tried.

    `mount`: how they are fixed together, its bending is not used; `matching`: what of the
    messages is used, attitudes among it, their sd is where the search starts; `sd` (n,): how
    well, for every state of `layout` [SI]; `likelihood`: log-likelihood so far [1].
    """
    from scipy.optimize import minimize, minimize_scalar

    stiff = dict(zip(layout.names, sd, strict=True))
    some = replace(mount, flexure_sd=matching.attitude_sd, flexure_time=STARTS[0])
    bent = states_of_transfer(slave.sensors, some, matching, slave.noise)
    every = np.array([stiff.get(name, 0.0) for name in bent.names])
    free = free_run(slave, master, some, matching, at, prior, every)
    time = slave.increments.time
    steps = np.diff(time[free.rows], prepend=time[slave.first])

    def system(x: FloatArray) -> LinearSystem:
        size, slow, noise = np.exp(x).tolist()
        s, m = free.system, replace(mount, flexure_sd=size, flexure_time=slow)
        bending(s.Phi, s.half, free.layout, steps, m)
        for name, value in (("flexure", size), ("flexure_rate", size * LIVELY / slow)):
            i = free.layout.group(name)
            s.P0[i, i] = value**2
        R = s.R.copy()
        R[:, 3:] = noise**2
        return replace(s, R=R)

    def against(x: FloatArray) -> float:
        if np.any(np.abs(x - start) > MOST):
            return np.inf
        return -kalman(system(x)).log_likelihood

    tried = []
    for first in STARTS:
        start = np.log([matching.attitude_sd, first, matching.attitude_sd])
        tried.append((against(start), first))
    start = np.log([matching.attitude_sd, min(tried)[1], matching.attitude_sd])
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
