"""Rests by hand and the turns between them.

The costs of the published hand-rotated method, as they were published.

Accelerometer: ``sum (g - |f|)^2`` over single samples of the rests. Gyro: ``sum |C_se' u_j -
u_{j+1}|^2`` with u the direction of the mean specific force of a rest, the bias held at the
mean of an initial rest, and a Runge-Kutta integration of the turns. Every residual has the same
weight. The likelihood of `procedures.hand_rotated` uses the second cost for its start.

References
----------
.. [1] D. Tedaldi, A. Pretto, E. Menegatti, "A robust and easy to implement method for IMU
   calibration without external equipments", ICRA 2014, eqs. (10) and (14).

A session of rests and turns as a mixed model.

The readings and their Jacobian are those of `models.rests_and_turns`: the coefficients first, then
three attitude angles per rest. The heading of the first rest has a prior as wide as the circle; the
Earth's rotation, where it is modelled and visible, narrows it.

What the noise does not explain has a size for each kind of reading, found from the residuals: it is
the honest uncertainty of a hand-held rest, and zero on a stable table (design/README.md).

It starts from linear and one-step solutions, in order: the norm gives the accelerometers, the rests
the gyro bias, the published cost the gyro matrix, dead reckoning the headings up to one, and the
Earth's rotation that one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.coefficients import Layout
from foucault.detect.stretches import Rests, runs
from foucault.errors import error
from foucault.estimate import norm_observation
from foucault.infer import gauss_newton
from foucault.infer.left_out import With
from foucault.infer.mixed import Fit, Linearisation, Source, root, scatter, tied
from foucault.kernels.rotation import integrate_turns, integrate_turns_rk4
from foucault.models.earth import EARTH_RATE
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.noise import QUIET_ENDS, SessionNoise, TriadNoise, window_covariance
from foucault.models.rests_and_turns import Attitudes, Prediction, Session, predict
from foucault.models.rotation import aligning, cross_matrix, exp
from foucault.result import Estimate, Linearised, Problem
from foucault.tables import AXES, Log

ACCEL_NAMES = tuple(
    [f"accel.bias.{a}" for a in AXES]
    + [f"accel.scale.{a}" for a in AXES]
    + [f"accel.misalignment.{m}" for m in ("yx", "zx", "zy")]
)
GYRO_NAMES = tuple(
    [f"gyro.scale.{a}" for a in AXES]
    + [f"gyro.misalignment.{o}{i}" for o in AXES for i in AXES if o != i]
)


def _problem(names: Sequence[str], model: ImuModel, linearise: object, n_blocks: int) -> Problem:
    """A problem whose state is the error model and whose steps change the named coefficients."""

    def values(state: ImuModel) -> FloatArray:
        return state.coefficients(names).values

    def retract(state: ImuModel, step: FloatArray) -> ImuModel:
        return state.moved(names, step)

    layout = LAYOUT.subset(names)
    return Problem(layout, model, linearise, retract, values, n_blocks)  # type: ignore[arg-type]


MOVES = 10.0
"""Variance over that of a window within, beyond which what should be one rest is none [1]."""


def find_published_rests(
    log: Log, *, initial_rest: float, factor: float, window: int, shortest: int
) -> Rests:
    """Find the rests of a log as the published method does, for comparison with other programs.

    A sample is at rest when the norm of the three accelerometer variances in the window around it
    is below a multiple of that of an initial rest.

    `log`: readings with accelerometers [SI]; `initial_rest`: length of the rest at the start of
    the log [s]; `factor`: threshold over the variance of that rest [1]; `window`: samples of the
    moving window, odd [1]; `shortest`: fewest samples of a rest [1]. Raises
    ``published.first_rest`` where the log moves in its first rest, which nothing is told by then.

    References
    ----------
    .. [1] D. Tedaldi, A. Pretto, E. Menegatti, ICRA 2014, eqs. (11), (12).
    """
    from foucault.kernels.moving import moving_moments

    assert log.accel is not None
    _, variance = moving_moments(np.ascontiguousarray(log.accel), window)
    level = np.linalg.norm(variance, axis=1)
    start = log.accel[: int(np.searchsorted(log.time, log.time[0] + initial_rest))]
    reference = float(np.linalg.norm(start.var(axis=0, ddof=1)))
    usual = MOVES * float(np.nanmedian(level[: len(start)]))
    if reference > usual > 0:
        moved = log.time[int(np.argmax(level > usual))] - log.time[0]
        raise error("published.first_rest", given=f"{initial_rest:.4g}", moved=f"{moved:.4g}")
    first, last = runs(level < factor * reference, shortest)
    relative = np.sqrt(level / reference)
    none = np.full(len(level), np.nan)
    return Rests(first, last, relative, relative, none, float(np.sqrt(factor)), window)


def fit_norms(readings: FloatArray, gravity: float, start: ImuModel) -> Estimate:
    """Fit the nine accelerometer coefficients to the norm of single readings.

    `readings` (m, 3): readings at rest [m/s^2]; `gravity`: local gravity [m/s^2]. Returns
    covariance from the residuals' own scatter; chi_square is twice the published cost.
    """

    def linearise(model: ImuModel, weights: FloatArray) -> Linearised:
        f_b, _ = model.compensate(readings, None)
        assert f_b is not None
        norm = np.linalg.norm(f_b, axis=1)
        lever = -(f_b / norm[:, None]) @ np.linalg.inv(model.accel_matrix)
        slopes = model.slopes(f_b, np.zeros(f_b.shape), ACCEL_NAMES).accel
        columns = np.einsum("ni,nij->nj", lever, slopes)
        return Linearised(gravity - norm, columns, np.arange(len(norm)))

    problem = _problem(ACCEL_NAMES, start, linearise, len(readings))
    return _with_own_scatter(gauss_newton.solve(problem, tolerance=1e-12))


def fit_directions(
    log: Log,
    up_b: FloatArray,
    first: IntArray,
    last: IntArray,
    start: ImuModel,
    *,
    runge_kutta: bool = False,
    max_iterations: int = 25,
) -> Estimate:
    """Fit gyro scale and misalignment to the change of the direction of gravity.

    `up_b` (n, 3): direction of the compensated specific force of each rest, frame b [1]; `first`,
    `last` (n - 1,): first and last sample of each turn; `start`: where to start, its gyro bias is
    held; `runge_kutta`: integrate as published instead of with the better rule of the kernels;
    `max_iterations`: limit of the Gauss-Newton steps [1]. Returns covariance from the residuals'
    own scatter; chi_square is twice the published cost.
    """
    assert log.gyro is not None
    gyro = log.gyro
    no_noise = np.zeros((3, 3))

    def linearise(model: ImuModel, weights: FloatArray) -> Linearised:
        _, w_b = model.compensate(None, gyro)
        assert w_b is not None
        w_b = np.ascontiguousarray(w_b)  # one layout, one compilation
        C_se, _, scale, _, _, _ = integrate_turns(
            log.time, w_b, w_b, no_noise, first, last, log.sampled == "increment"
        )
        C_used = integrate_turns_rk4(log.time, w_b, first, last) if runge_kutta else C_se
        C_es = np.swapaxes(C_used, 1, 2)
        inverse = np.linalg.inv(model.gyro_matrix)
        turned = C_es @ cross_matrix(up_b[:-1])  # change of C_es u per rotation error in s
        by_element = np.einsum("nab,nbik,io->naok", turned, scale.reshape(-1, 3, 3, 3), inverse)
        order = [(i, i) for i in range(3)]
        order += [(o, i) for o in range(3) for i in range(3) if o != i]
        J = -np.stack([by_element[:, :, o, i] for o, i in order], axis=2)
        miss = up_b[1:] - np.einsum("nij,nj->ni", C_es, up_b[:-1])
        return Linearised(miss.ravel(), J.reshape(-1, 9), np.repeat(np.arange(len(first)), 3))

    model = replace(start, g_sensitivity=np.zeros((3, 3)))
    problem = _problem(GYRO_NAMES, model, linearise, len(first))
    return _with_own_scatter(
        gauss_newton.solve(problem, tolerance=1e-12, max_iterations=max_iterations)
    )


def _with_own_scatter(estimate: Estimate) -> Estimate:
    """Scale the covariance by the residual variance: all that a method without noise knows."""
    variance = estimate.chi_square / max(estimate.dof, 1)
    c = estimate.coefficients
    assert c.cov is not None
    return replace(
        estimate,
        coefficients=replace(c, cov=c.cov * variance),
        state_cov=estimate.state_cov * variance,
        information=estimate.information / max(variance, 1e-300),
    )


HEADING_SD = np.pi / np.sqrt(3.0)
"""Standard deviation of a heading of which nothing is known [rad]."""

SCATTER = {
    "accel": "scatter of specific force between rests",
    "gyro": "scatter of rates between rests",
    "turns": "scatter of turns",
}
"""Kind of reading, in their order -> the source of what the noise does not explain of it."""


@dataclass(frozen=True)
class RestsAndTurns:
    """The model of a session: rests (specific force), rests (rate), turns, three numbers each."""

    session: Session
    names: tuple[str, ...]
    start: Attitudes
    noise: SessionNoise
    evaluated: tuple[str, str] = ("B", "")  # type and basis of the noise
    # twice the log-likelihood that scatter has to gain to be there; None: it is not looked for [1]
    price: float | None = None
    slipped: FloatArray | None = None  # (n,) how far the instrument turned within each rest [rad]

    @property
    def layout(self) -> Layout:
        """The coefficients."""
        return LAYOUT.subset(self.names)

    @cached_property
    def kinds(self) -> dict[str, BoolArray]:
        """Kind of reading -> its components, shape (k, 3)."""
        n = len(self.session.accel_mean)
        gyros = self.session.gyro_mean is not None
        kind = np.repeat(np.arange(3), [n, n, n - 1] if gyros else [n, 0, 0])
        rows = np.broadcast_to(kind[:, None], (len(kind), 3))
        return {name: rows == i for i, name in enumerate(SCATTER) if (rows == i).any()}

    def retract(self, state: Attitudes, step: FloatArray) -> Attitudes:
        """Apply `step` (m,): coefficients, then the rotation of each rest in body axes [SI]."""
        p = len(self.names)
        return Attitudes(
            state.model.moved(self.names, step[:p]), state.C_nb @ exp(step[p:].reshape(-1, 3))
        )

    def values(self, state: Attitudes) -> FloatArray:
        """Return the coefficients of a state, shape (p,) [SI]."""
        return state.model.coefficients(self.names).values

    def linearise(self, state: Attitudes) -> Linearisation:
        """Compare the session with the model."""
        at, known = self.predict(state), self._headings(state)
        named = ("unknown heading",) * len(known[0])
        return Linearisation(at.residuals, at.jacobian, tuple(self._sources(at)), known, named)

    def predict(self, state: Attitudes) -> Prediction:
        """Compare the session with its prediction."""
        return predict(self.session, self.names, state, self.noise.turn_psd)

    def _headings(self, state: Attitudes) -> tuple[FloatArray, FloatArray]:
        """White rows of unknown headings: of the first rest; without gyros of each."""
        n, p = len(state.C_nb), len(self.names)
        free = n if self.session.gyro_mean is None else 1
        rows = np.zeros((free, p + 3 * n))
        for j in range(free):  # heading turns about up, which is the third row of C_nb
            rows[j, p + 3 * j : p + 3 * j + 3] = state.C_nb[j, 2, :] / HEADING_SD
        D = state.C_nb[:free] @ np.swapaxes(self.start.C_nb[:free], 1, 2)
        turned = np.arctan2(D[:, 1, 0] - D[:, 0, 1], D[:, 0, 0] + D[:, 1, 1])
        return -turned / HEADING_SD, rows

    def _sources(self, at: Prediction) -> list[Source]:
        s, noise, (kind, basis) = self.session, self.noise, self.evaluated
        k, n, T = len(at.residuals), len(s.accel_mean), s.rest_time[:, None]

        def rows(first: int, part: FloatArray) -> FloatArray:
            out = np.zeros((k, *part.shape[1:]))
            out[first : first + len(part)] = part
            return out

        # Rounding of counts is carried on from reading to reading: it counts at both ends.
        accel = noise.accel_psd / T + 2 * noise.accel_carried / T**2 + noise.accel_rounding**2
        out = [
            Source("accelerometer noise", rows(0, _roots(accel)), noise=True, type=kind,
                   basis=basis),
            Source("unknown heading", basis="heading not given: the whole circle"),
        ]  # fmt: skip
        slow = "slow noise as given in the campaign"
        if _wanders(noise.slow.accel):
            shared = rows(0, tied(np.broadcast_to(np.eye(3), (n, 3, 3)), self._slow[0]))
            name = "slow noise of accelerometers"
            out.append(Source(name, shared=shared, noise=True, basis=slow))
        if s.gyro_mean is not None:
            rest = _roots(noise.gyro_psd / T + 2 * noise.gyro_carried / T**2)
            turn = np.linalg.cholesky(at.turn_noise + 2 * np.diag(noise.gyro_carried))
            out.append(Source("gyro noise", rows(n, np.concatenate([rest, turn])),
                              self._rounding(at), noise=True, type=kind, basis=basis))  # fmt: skip
            if s.bridged.any():
                lost = rows(2 * n, s.bridged[:, None, None] * np.eye(3))
                out.append(Source("gaps in turns", lost, type="A",
                                  basis="lines over as long a time in the turns"))  # fmt: skip
            if self.slipped is not None:
                # Its mean attitude is neither that at which a turn ended nor where the next began.
                beside = np.hypot(self.slipped[:-1], self.slipped[1:])
                out.append(Source("slips in rests", rows(2 * n, beside[:, None, None] * np.eye(3)),
                                  type="A", basis="rates left out, over their rests"))  # fmt: skip
            if _wanders(noise.slow.gyro):
                effect = np.concatenate([np.broadcast_to(np.eye(3), (n, 3, 3)), at.turn_bias])
                shared = rows(n, tied(effect, self._slow[1]))
                out.append(Source("slow noise of gyros", shared=shared, noise=True, basis=slow))
            if s.site.latitude is None:
                # One vector for the whole session, for the turns tie the headings together. It has
                # its full size over all directions: a third of its square per axis.
                out.append(Source("unknown Earth rate", None, rows(n, at.earth),
                                  EARTH_RATE / np.sqrt(3.0), type="B",
                                  basis="latitude not given: any direction"))  # fmt: skip
        if self.price is not None:
            out += [scatter(SCATTER[name], mine[:, :, None] * np.eye(3), price=self.price)
                    for name, mine in self.kinds.items()]  # fmt: skip
        return out

    def _rounding(self, at: Prediction) -> FloatArray | None:
        """What rounding of the gyros' bias does, shape (k, 3, 6): the same error in all rests.

        A turn is rounded alike too, but only where it is still quiet, near its ends, and how long
        that is is not known well enough to subtract the one from the other: they count as two.
        """
        if not self.noise.gyro_rounding.any():
            return None
        n = len(self.session.accel_mean)
        out = np.zeros((3 * n - 1, 3, 6))
        out[n : 2 * n, :, :3] = np.diag(self.noise.gyro_rounding)
        share = np.minimum(1.0, QUIET_ENDS / self.session.turn_time)[:, None, None]
        out[2 * n :, :, 3:] = at.turn_bias * self.noise.gyro_rounding * share
        return out

    @cached_property
    def _slow(self) -> tuple[FloatArray, FloatArray]:
        """Roots of the covariance of the slow bias: over the rests, over rests and turns [SI]."""
        s = self.session
        time = s.log.time - s.log.time[0]
        start, end = time[s.first], time[s.last - 1]
        accel = window_covariance(start, end, self.noise.slow.accel)
        start, end = np.append(start, end[:-1]), np.append(end, start[1:])
        return root(accel), root(window_covariance(start, end, self.noise.slow.gyro))


def slips(fit: Fit) -> FloatArray | None:
    """Return how far gyros that were left out say that each rest turned, (n,) [rad]; None: none."""
    time = session_of(fit).session.rest_time
    n, angle = len(time), np.zeros(len(time))
    out = [k - n for k in fit.outliers.tolist() if n <= k < 2 * n]
    angle[out] = time[out] * np.linalg.norm(fit.at.residuals[n:][out], axis=1)
    return angle if out else None


def session_of(fit: Fit) -> RestsAndTurns:
    """Return the model of a session that was fitted."""
    model = fit.model.model if isinstance(fit.model, With) else fit.model
    assert isinstance(model, RestsAndTurns)
    return model


def _wanders(triad: TriadNoise) -> bool:
    return bool(triad.bias_instability or triad.random_walk)


def _roots(variance: FloatArray) -> FloatArray:
    """Return standard deviations on diagonals, shape (n, 3, 3); `variance` (n, 3)."""
    return np.asarray(np.sqrt(variance)[:, :, None] * np.eye(3))


def middle(session: Session) -> FloatArray:
    """Return the middle of each observation: rests, rests again (their rates), turns [s]."""
    t = session.log.time
    rests = (t[session.first] + t[session.last - 1]) / 2
    if session.gyro_mean is None:
        return np.asarray(rests)
    turns = (t[session.last[:-1] - 1] + t[session.first[1:]]) / 2
    return np.concatenate([rests, rests, turns])


def first_guess(session: Session) -> Attitudes | None:
    """Return a state to start from, or None where the rests do not determine the norm.

    Linear norm observation for the accelerometers, the mean of the rests for the gyro bias, the
    published cost for the gyro matrix, dead reckoning between rests for heading, and a linear
    fit of the Earth's rotation for the heading of the first.
    """
    solved = norm_observation.solve(session.accel_mean, session.site.gravity)
    if solved is None:
        return None
    model = ImuModel(accel_matrix=solved[0], accel_bias=solved[1])
    f_b, _ = model.compensate(session.accel_mean, None)
    assert f_b is not None
    up_b = f_b / np.linalg.norm(f_b, axis=1)[:, None]
    z = np.array([0.0, 0.0, 1.0])
    if session.gyro_mean is None:
        return Attitudes(model, np.stack([aligning(u, z) for u in up_b]))
    weight = session.rest_time / session.rest_time.sum()
    model = replace(model, gyro_bias=weight @ session.gyro_mean)
    turns = (session.last[:-1] - 1, session.first[1:])
    model = fit_directions(session.log, up_b, *turns, model, max_iterations=4).state
    return reckoned(session, model, up_b)


def reckoned(session: Session, model: ImuModel, up_b: FloatArray) -> Attitudes:
    """Return the attitudes of all rests by dead reckoning with a `model`.

    `up_b` (n, 3): direction of up at each rest, frame b [1].
    """
    z = np.array([0.0, 0.0, 1.0])
    C_nb = np.empty((len(up_b), 3, 3))
    C_nb[0] = aligning(up_b[0], z)
    guess = Attitudes(model, np.broadcast_to(np.eye(3), C_nb.shape))
    C_se = predict(session, (), guess, np.ones(3)).C_se
    for j, C in enumerate(C_se):
        reached = C_nb[j] @ C
        C_nb[j + 1] = aligning(reached @ up_b[j + 1], z) @ reached
    return _with_heading(session, Attitudes(model, C_nb))


def _with_heading(session: Session, state: Attitudes) -> Attitudes:
    """Turn all attitudes about up so that the gyro means at rest see the Earth's rotation."""
    if session.site.latitude is None or session.gyro_mean is None:
        return state
    _, north, up = session.earth @ np.eye(3)
    # Horizontal Earth rate after a turn by psi about up: north (-sin psi, cos psi); linear in
    # cos and sin, and in the gyro bias.
    C_bn = np.swapaxes(state.C_nb, 1, 2)
    scale = state.model.gyro_matrix
    rows = np.concatenate(
        [
            np.broadcast_to(np.eye(3), C_bn.shape),
            (scale @ C_bn)[:, :, 1:2] * north,
            (scale @ C_bn)[:, :, 0:1] * north,
        ],
        axis=2,
    ).reshape(-1, 5)
    known = session.gyro_mean - (scale @ C_bn)[:, :, 2] * up
    x, *_ = np.linalg.lstsq(rows, known.ravel(), rcond=None)
    psi = np.arctan2(-x[4], x[3])
    turn = exp(np.array([0.0, 0.0, -psi]))
    return Attitudes(replace(state.model, gyro_bias=x[:3]), turn @ state.C_nb)
