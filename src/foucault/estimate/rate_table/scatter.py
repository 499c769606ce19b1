"""How much steps on a rate table scatter beyond their noise: of the rate, and of the bias.

A table that does not hold its rate scatters in proportion to the rate; a bias that moves during
the session scatters fast and slow steps alike. Both are found at once by restricted maximum
likelihood [1], each only where the readings clearly ask for it, so that neither takes the part of
the other. The bias moves from step to step at random, or as a Gauss-Markov process whose
correlation time is chosen from a few, or along a straight line.

References
----------
.. [1] H. D. Patterson, R. Thompson, "Recovery of inter-block information when block sizes are
   unequal", Biometrika 58(3), 1971.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.estimate import gauss_newton
from foucault.estimate.chi_square import student
from foucault.estimate.rate_table.likelihood import (
    Trust,
    build,
    covariance,
    drift_root,
    fit,
    wanders,
    whitening,
)
from foucault.models.rate_steps import Steps
from foucault.result import Estimate

FEWEST = 6
"""With fewer readings beyond the unknowns no scatter is looked for [1]."""

PRICE = {"bias": 8.0, "rate": 6.0}
"""Twice the log-likelihood that each kind of scatter must gain [1]."""

TIMES = (np.inf, 1.0, 0.5, 0.25, 0.12, 0.06)
"""Correlation times that are tried, as parts of the session; infinite: a straight line [1]."""

LARGEST = 0.1
"""Largest scatter of the rate that is looked for [1]."""

FEW = 0.1
"""A larger part of the steps being outliers, they are scatter [1]."""

OUT = 1e-8
"""Weight of a step that does not count [1]."""


def fit_scatter(
    steps: Steps,
    names: tuple[str, ...],
    trust: Trust,
    prior: CoefficientVector | None = None,
    loss: gauss_newton.Loss = gauss_newton.huber,
) -> Trust:
    """Return `trust` with the scatter that makes the residuals as large as they should be.

    `steps`: what was measured [SI]; `trust`: what is believed of table, fixture and place;
    `prior` or None: Gaussian prior on the coefficients; `loss`: ``norms -> weights``, see
    `gauss_newton.solve`.
    """
    _, found = fit(steps, names, trust, prior, gauss_newton.least_squares)
    if found.dof < FEWEST:
        return trust
    # Scatter that is another in every step first: a bias that moves slowly would follow outliers.
    _, robust = fit(steps, names, trust, prior, loss)
    weights = np.where(robust.weights < 0.5, OUT, 1.0)
    if np.mean(weights < 1) > FEW:
        weights[:] = 1.0
    for _ in range(4):
        contrasts = _contrasts(steps, names, trust, prior, found, weights)
        _, found = fit(steps, names, _best(contrasts, trust, ()), prior, loss)
        kept = np.where(found.weights < 0.5, OUT, 1.0)
        if (kept == weights).all():
            break
        weights = kept
    contrasts = _contrasts(steps, names, trust, prior, found, weights)
    span = float(np.ptp(steps.middle))
    return _best(contrasts, trust, tuple(span * part for part in TIMES))


@dataclass(frozen=True)
class _Contrasts:
    """What of the readings no coefficient can explain, in units of the noise."""

    values: FloatArray  # (k,) the contrasts [1]
    by_reading: FloatArray  # (k, n, 3) how they follow the readings [1/(rad/s)]
    steps: Steps  # the steps [SI]
    noise: float  # noise of a typical step [rad/s]

    def of_bias(self, time: float) -> FloatArray:
        """Return their covariance by a bias that moves by 1 rad/s in `time` [s], shape (k, k)."""
        k = len(self.values)
        moved = self.by_reading
        if time > 0:
            root = drift_root(self.steps, Trust(bias_sd=1.0, bias_time=time))
            moved = np.einsum("knj,nm->kmj", moved, root)
        rows = moved.reshape(k, -1)
        return np.asarray(rows @ rows.T)

    def of_rate(self) -> FloatArray:
        """Return their covariance by a scatter of the rate as large as the rate, shape (k, k)."""
        rows = np.einsum("knj,nj->kn", self.by_reading, self.steps.gyro)
        rows = rows * (self.steps.rate != 0.0)
        return np.asarray(rows @ rows.T)


def _contrasts(
    steps: Steps,
    names: tuple[str, ...],
    trust: Trust,
    prior: CoefficientVector | None,
    found: Estimate,
    weights: FloatArray,
) -> _Contrasts:
    drift = np.zeros((len(steps), 3)) if wanders(steps, trust) else None
    problem = build(steps, names, trust, prior, start=replace(found.state, drift=drift))
    at = gauss_newton.with_prior(problem, problem.start, problem.linearise(problem.start, weights))
    scale = np.linalg.norm(at.jacobian, axis=0)
    unit = at.jacobian / np.where(scale > 0, scale, 1.0)
    left = np.linalg.qr(unit, mode="complete")[0][:, unit.shape[1] :].T
    root = whitening(list(covariance(steps, trust).values()))
    k, n = len(left), len(steps)
    readings = left[:, : 3 * n].reshape(k, n, 3) * np.sqrt(weights)[:, None]
    by_reading = np.einsum("knj,nji->kni", readings, root)
    noise = float(np.median(np.sqrt(3.0 / np.sum(root**2, axis=(1, 2)))))
    return _Contrasts(left @ at.residuals, by_reading, steps, noise)


def _best(c: _Contrasts, trust: Trust, times: tuple[float, ...]) -> Trust:
    """Return the scatter that is the most likely, each kind of it at its price."""
    from scipy.optimize import minimize, minimize_scalar

    eye, by_rate = np.eye(len(c.values)), c.of_rate()
    largest = max(1.0, float(np.sqrt(np.mean(c.values**2))))
    bias_ends = np.log(c.noise * np.array([0.05, 30.0 * largest]))
    rate_ends = np.log([1e-9, LARGEST])

    def unlikely(bias: float, rate: float, by_bias: FloatArray) -> float:
        total = eye + np.exp(2 * bias) * by_bias + np.exp(2 * rate) * by_rate
        # Without any noise what is added is all there is, and it may have no inverse.
        root = np.linalg.cholesky(total + 1e-12 * np.trace(total) * eye)
        white = np.linalg.solve(root, c.values)
        return float(white @ white + 2 * np.sum(np.log(np.diag(root))))

    none = np.zeros_like(eye)
    trials = [(unlikely(-np.inf, -np.inf, none), -np.inf, -np.inf, 0.0)]
    found = minimize_scalar(lambda x: unlikely(-np.inf, x, none), bounds=rate_ends)
    trials.append((found.fun + PRICE["rate"], -np.inf, float(found.x), 0.0))
    for time in (0.0, *times):
        by_bias = c.of_bias(time)
        one = minimize_scalar(lambda x, b=by_bias: unlikely(x, -np.inf, b), bounds=bias_ends)
        trials.append((one.fun + PRICE["bias"], float(one.x), -np.inf, time))
        both = minimize(
            lambda x, b=by_bias: unlikely(x[0], x[1], b), [one.x, found.x], method="Nelder-Mead",
            bounds=[bias_ends, rate_ends], options={"xatol": 0.01, "fatol": 0.01, "maxfev": 120},
        )  # fmt: skip
        trials.append((both.fun + sum(PRICE.values()), *map(float, both.x), time))
    _, bias, rate, time = min(trials)
    jitter = float(np.hypot(trust.rate_jitter, np.exp(rate)))
    return replace(trust, rate_jitter=jitter, bias_sd=float(np.exp(bias)), bias_time=time)


def scaled_noise(
    steps: Steps, names: tuple[str, ...], trust: Trust, prior: CoefficientVector | None = None
) -> Steps:
    """Return the steps with noise as large as the residuals say, where nobody knows it.

    `steps`: what was measured, the noise of its means is right but for a common factor [SI];
    `trust`: what is believed of table, fixture and place; `prior` or None: Gaussian prior on the
    coefficients.
    """
    for loss in (gauss_newton.least_squares, gauss_newton.huber):
        _, found = fit(steps, names, trust, prior, loss)
        if found.dof < 1:
            return steps
        steps = replace(steps, cov=steps.cov * max(found.chi_square / found.dof, 1e-12))
    return replace(steps, cov=steps.cov * student(found.dof) ** 2)
