"""Maximum likelihood of a session of rests and turns, with unexplained scatter estimated.

The problem: residuals of `models.rests_and_turns` made white by `models.session_noise`, the
coefficients first, then three attitude angles per rest. The heading of the first rest has a
prior as wide as the circle; the Earth's rotation, where it is modelled and visible, narrows it.

Where the residuals of one kind of observation are larger than the noise explains, a variance
(one per kind: specific force at rest, rate at rest, turns) is added until they fit, weighing
each observation by the redundancy it really has. This is the honest uncertainty of a hand-held
rest, and zero on a stable table (design/README.md).

References
----------
.. [1] W. Förstner, "Ein Verfahren zur Schätzung von Varianz- und Kovarianzkomponenten",
   Allgemeine Vermessungs-Nachrichten 86, 1979 (local redundancies).
.. [2] R. C. Paule, J. Mandel, "Consensus values and weighting factors", J. Res. NBS 87(5),
   1982 (an added variance that makes chi-square equal to its expectation).
.. [3] P. J. Huber, *Robust Statistics*, Wiley, 1981, section 6.4 (Proposal 2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.estimate import gauss_newton
from foucault.estimate.chi_square import chi_square_limits
from foucault.estimate.drift import Drift, by_time, find_drift
from foucault.models.imu import LAYOUT
from foucault.models.rests_and_turns import Attitudes, Prediction, Session, predict
from foucault.models.rotation import exp
from foucault.models.session_noise import SessionNoise, blocks, correlated, whiten
from foucault.result import Estimate, Linearised, Problem

HEADING_SD = np.pi / np.sqrt(3.0)
"""Standard deviation of a heading of which nothing is known [rad]."""

FEW = 0.25
"""Outliers up to this share are single mishaps; more of them are scatter [1]."""

KINDS = ("accel_repeatability", "gyro_repeatability", "turn_repeatability")
"""The three kinds of observation, in the order of the residuals."""


@dataclass(frozen=True)
class Component:
    """How one kind of observation fits.

    Attributes
    ----------
    ratio : float
        Sum of squares over redundancy; 1 where the noise explains the residuals [1].
    redundancy : float
        Degrees of freedom of this kind of observation [1].
    low, high : float
        Two-sided limits of the sum of squares at 1 % for all kinds together [1].
    chi_square : float
        Sum of squares of the white residuals [1].
    """

    chi_square: float
    redundancy: float
    low: float
    high: float

    @property
    def ratio(self) -> float:
        """Sum of squares over redundancy [1]."""
        return self.chi_square / max(self.redundancy, 1e-9)


class Memory:
    """The last prediction: while only the noise changes, the turns need no new integration."""

    def __init__(self) -> None:
        self._state: Attitudes | None = None
        self._psd: FloatArray = np.zeros(0)
        self._at: Prediction | None = None

    def predict(
        self, session: Session, names: Sequence[str], state: Attitudes, psd: FloatArray
    ) -> Prediction:
        """Return `predict` of a state, from memory where it is the state of the last call.

        `session`: what was observed [SI]; `psd` (3,): white noise power of the gyro outputs
        [rad^2/s].
        """
        if self._at is None or self._state is not state or not np.array_equal(self._psd, psd):
            self._at = predict(session, names, state, psd)
            self._state, self._psd = state, psd
        return self._at


def build(
    session: Session,
    names: Sequence[str],
    start: Attitudes,
    noise: SessionNoise,
    prior: CoefficientVector | None = None,
    memory: Memory | None = None,
) -> Problem:
    """Build the least-squares problem of a session.

    `prior` or None: prior of the coefficients, in the order of `names`; `memory` or None: shared
    by problems of the same session that follow one another.
    """
    memory = memory or Memory()
    layout = LAYOUT.subset(names)
    p, n = len(names), len(session.accel_mean)
    kinds = 1 if session.gyro_mean is None else 3
    n_blocks = n if kinds == 1 else 3 * n - 1

    def linearise(state: Attitudes, weights: FloatArray) -> Linearised:
        at = memory.predict(session, names, state, noise.turn_psd)
        share = np.sqrt(weights)[:, None]
        r, J = whiten(
            at.residuals * share,
            at.jacobian * share[:, :, None],
            blocks(session, noise, at),
            correlated(session, noise, at),
        )
        # Without gyros nothing ties the headings together, and each rest needs the prior.
        # Heading turns about up, which is the third row of C_nb.
        free = n if kinds == 1 else 1
        heading = np.zeros((free, p + 3 * n))
        for j in range(free):
            heading[j, p + 3 * j : p + 3 * j + 3] = state.C_nb[j, 2, :] / HEADING_SD
        D = state.C_nb[:free] @ np.swapaxes(start.C_nb[:free], 1, 2)
        turned = np.arctan2(D[:, 1, 0] - D[:, 0, 1], D[:, 0, 0] + D[:, 1, 1])
        return Linearised(
            np.append(r, -turned / HEADING_SD),
            np.concatenate([J, heading]),
            np.append(np.repeat(np.arange(n_blocks), 3), np.full(free, -1)),
        )

    def retract(state: Attitudes, step: FloatArray) -> Attitudes:
        return Attitudes(
            state.model.moved(names, step[:p]), state.C_nb @ exp(step[p:].reshape(n, 3))
        )

    def values_of(state: Attitudes) -> FloatArray:
        return state.model.coefficients(names).values

    return Problem(layout, start, linearise, retract, values_of, n_blocks, prior)


def clearest_drift(
    problem: Problem, estimate: Estimate, session: Session, noise: SessionNoise, at: Prediction
) -> Drift | None:
    """Return the drift of a coefficient that the residuals show most clearly."""
    names, time, n = problem.layout.names, middle(session), len(session.accel_mean)
    white = gauss_newton.with_prior(
        problem, estimate.state, problem.linearise(estimate.state, estimate.weights)
    )
    share = np.sqrt(estimate.weights)[:, None, None] * by_time(time)[:, None, None]
    rows = np.zeros((len(white.residuals), len(names)))
    tied = correlated(session, noise, at)
    rows[: 3 * len(time)] = whiten(
        at.residuals, at.jacobian[:, :, : len(names)] * share, blocks(session, noise, at), tied
    )[1]
    kinds = np.minimum(np.arange(len(time)) // n, 2)
    return find_drift(white, names, time, kinds=kinds, candidates=rows)


def middle(session: Session) -> FloatArray:
    """Return the middle of each observation: rests, rests again (their rates), turns [s]."""
    t = session.log.time
    rests = (t[session.first] + t[session.last - 1]) / 2
    if session.gyro_mean is None:
        return np.asarray(rests)
    turns = (t[session.last[:-1] - 1] + t[session.first[1:]]) / 2
    return np.concatenate([rests, rests, turns])


def components(
    estimate: Estimate, session: Session, *, clipped: bool = False
) -> dict[str, Component]:
    """Split the sum of squares by kind of observation.

    `clipped`: count residuals only up to the limit of the robust loss (Huber's Proposal 2), and
    leave out observations far beyond it where they are few: one bad rest is not scatter of all.
    """
    n = len(session.accel_mean)
    used = estimate.blocks >= 0
    kind = np.minimum(estimate.blocks // n, 2)
    out = {}
    kinds = KINDS[:1] if session.gyro_mean is None else KINDS
    weights = np.where(used, estimate.weights[estimate.blocks], 1.0)
    # Clipped: the residuals hold the root of the weight already.
    square = estimate.residuals**2 * (weights if clipped else 1.0)
    for i, name in enumerate(kinds):
        mine = used & (kind == i)
        if clipped and np.mean(weights[mine] < 0.5) <= FEW:
            mine &= weights >= 0.5
        redundancy = float(np.sum(1 - estimate.leverage[mine]))
        low, high = chi_square_limits(max(redundancy, 1e-3), tests=len(kinds))
        out[name] = Component(float(np.sum(square[mine])), redundancy, low, high)
    return out


def fit(
    session: Session,
    names: Sequence[str],
    start: Attitudes,
    noise: SessionNoise,
    *,
    prior: CoefficientVector | None = None,
    loss: gauss_newton.Loss = gauss_newton.least_squares,
    repeatability: bool = True,
    pretest: bool = False,
) -> tuple[Estimate, SessionNoise, dict[str, Component]]:
    """Estimate the coefficients, and the scatter that the noise leaves unexplained.

    `prior` or None: prior of the coefficients; `loss`: robust loss, see `estimate.gauss_newton`;
    `repeatability`: add variance where the residuals are larger than the noise explains;
    `pretest`: add it only where they are significantly larger. Right for noise that is known,
    noise measured within rests is a lower limit of what differs between them, and a test would
    leave moderate scatter out of the covariance. Returns `noise`: the noise with the scatter that
    was added; `before`: how well the noise alone explained the residuals.
    """
    if prior is not None and np.isfinite(prior.prior_sd).any():
        return _with_prior(session, names, start, noise, prior, loss, repeatability, pretest)
    robust = loss is not gauss_newton.least_squares
    state, outliers, memory = start, np.zeros(0), Memory()
    before: dict[str, Component] = {}
    for attempt in range(4):
        # At first only significant scatter, lest an outlier be taken for scatter of all.
        careful = pretest or (robust and attempt == 0)
        estimate, noise, fits = _with_scatter(
            build(session, names, state, noise, None, memory), session, names, noise, loss,
            repeatability, careful, memory,
        )  # fmt: skip
        before = fits if attempt == 0 else before
        state, found = estimate.state, _outlier_weights(estimate, session)
        if not robust or np.array_equal(found, outliers):
            break
        # Huber's loss keeps the pull of an outlier, clipped, on the estimate, but its covariance
        # does not count that pull. Once the outliers are known they are left out altogether.
        outliers, loss = found, partial(_held, found)
    return estimate, noise, before


def _with_prior(
    session: Session,
    names: Sequence[str],
    start: Attitudes,
    noise: SessionNoise,
    prior: CoefficientVector,
    loss: gauss_newton.Loss,
    repeatability: bool,
    pretest: bool,
) -> tuple[Estimate, SessionNoise, dict[str, Component]]:
    """Settle scatter and outliers without the prior, then add it.

    A prior that the observations contradict would make residuals of them, which scatter takes up:
    the more wrong the prior, the more surely it would be believed.
    """
    alone, noise, before = fit(
        session, names, start, noise, loss=loss, repeatability=repeatability, pretest=pretest
    )
    problem = build(session, names, start, noise, prior)
    return gauss_newton.add_prior(problem, alone), noise, before


def _held(weights: FloatArray, norms: FloatArray) -> FloatArray:
    """A loss whose weights are settled."""
    return weights


def _with_scatter(
    problem: Problem,
    session: Session,
    names: Sequence[str],
    noise: SessionNoise,
    loss: gauss_newton.Loss,
    repeatability: bool,
    pretest: bool,
    memory: Memory,
) -> tuple[Estimate, SessionNoise, dict[str, Component]]:
    """Solve, then add variance of each kind until its residuals fit."""
    estimate = gauss_newton.solve(problem, loss=loss)
    now = components(estimate, session, clipped=True)
    full = components(estimate, session)
    before = {name: full[name] if c.chi_square > c.high else c for name, c in now.items()}
    growing = [
        k for k, c in now.items() if not pretest or c.chi_square > c.high or getattr(noise, k) > 0
    ]
    if not repeatability or all(_settled(now[k], getattr(noise, k)) for k in growing):
        return estimate, noise, before
    for _ in range(20):
        noise = _inflate(noise, now, session, growing)
        problem = build(session, names, estimate.state, noise, problem.prior, memory)
        estimate = gauss_newton.solve(
            problem, loss=loss, max_iterations=1, weights=estimate.weights
        )
        now = components(estimate, session, clipped=True)
        if all(_settled(now[k], getattr(noise, k)) for k in growing):
            break
    problem = build(session, names, estimate.state, noise, problem.prior, memory)
    return gauss_newton.solve(problem, loss=loss, weights=estimate.weights), noise, before


def _settled(c: Component, scatter: float) -> bool:
    """A variance from some 60 degrees of freedom is uncertain by 18 %: 3 % is settled."""
    return abs(c.ratio - 1) < 0.03 or (scatter == 0 and c.ratio < 1)


def _outlier_weights(estimate: Estimate, session: Session) -> FloatArray:
    norms = gauss_newton.block_norms(estimate.residuals, estimate.blocks, estimate.weights)
    out = norms > gauss_newton.ROBUST_LIMIT
    n = len(session.accel_mean)
    for kind in (slice(0, n), slice(n, 2 * n), slice(2 * n, None)):
        if out[kind].sum() > FEW * len(out[kind]):
            out[kind] = False  # so many are not outliers but scatter
    return np.where(out, gauss_newton.LEFT_OUT, 1.0)


def _inflate(
    noise: SessionNoise, now: dict[str, Component], session: Session, growing: list[str]
) -> SessionNoise:
    """Scale the total variance of each kind by its ratio and give the increase to the scatter."""
    rest = float(np.mean(1 / session.rest_time))
    white = {
        "accel_repeatability": float(noise.accel_psd.mean()) * rest,
        "gyro_repeatability": float(noise.gyro_psd.mean()) * rest,
        "turn_repeatability": float(noise.turn_psd.mean() * session.turn_time.mean()),
    }
    changed: dict[str, Any] = {}
    for name in growing:
        scatter = getattr(noise, name) ** 2
        total = (scatter + white[name]) * now[name].ratio
        changed[name] = float(np.sqrt(max(total - white[name], 0.0)))
    return replace(noise, **changed)
