"""Observation model of a session of rests and turns: what the means and the turns should be.

At rest j the body has the attitude ``C_nb[j]`` in the local frame. Three things are observed::

    accelerometer mean   a_j = accel model of  f_j = C_nb[j]' (0, 0, g)
    gyro mean            w_j = gyro model of   C_nb[j]' w_ie_n   and f_j
    turn to rest j + 1   C_se(gyro model) = C_nb[j]' Exp(w_ie_n T_j) C_nb[j + 1]

where C_se integrates the compensated rate over the turn (s: body axes at its start, e: at its
end). The Earth term is the rotation of the local frame while the turn lasts. Unknown are the
coefficients of the model and one attitude per rest; heading is a nuisance that only the Earth's
rotation ties to north.

The turn residual is the rotation vector from modelled to measured, in s:
``rho = Log(C_se (C_nb[j]' Exp(w_ie_n T_j) C_nb[j+1])')``. With an error d_eps of the integrated
rotation in s, and body-side perturbations ``C_nb Exp(phi)``::

    d_rho = Jl^-1 d_eps + Jr^-1 phi_j - Jr^-1 (C_nb[j]' E C_nb[j+1]) phi_{j+1}
    d_eps = - int C_sb inv(L_g) (d_b + dL_g w + dG f) dt

An error of the accelerometers reaches the turns only through G, which makes it second order: the
Jacobian leaves it out.

What an instrument said on its six faces, and while it was turned about an axis of its case.

Case axes k are those of the faces: in a rest on a face one of them is vertical. Directions are
nominal ones; how far the instrument really was from them is part of the covariance.

What gyros said on a rate table: one mean per constant rate, and what was true of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.kernels.rotation import integrate_turns
from foucault.models.earth import Site, earth_rate_n
from foucault.models.imu import ImuModel, coefficient_slot
from foucault.models.noise import TriadNoise
from foucault.models.rotation import cross_matrix, exp, log, right_jacobian_inverse
from foucault.tables import AXES, GAP, Log, gaps


@dataclass(frozen=True)
class Session:
    """The data of a session, reduced to what the model needs."""

    log: Log  # the readings [SI]
    # first, last: (n,) first sample of each rest and the sample after its last
    first: IntArray
    last: IntArray
    site: Site  # gravity and, where known, latitude
    accel_mean: FloatArray  # (n, 3) mean specific force of each rest [m/s^2]
    gyro_mean: FloatArray | None  # (n, 3) mean rate of each rest [rad/s]

    @classmethod
    def reduce(cls, log: Log, first: IntArray, last: IntArray, site: Site) -> Session:
        """Average the rests of a log.

        `log`: the readings [SI], accelerometers must be present; `first`, `last` (n,): first
        sample of each rest and the sample after its last.
        """
        assert log.accel is not None

        def means(x: FloatArray) -> FloatArray:
            rows = [x[a:b].mean(axis=0) for a, b in zip(first, last, strict=True)]
            return np.stack(rows)

        gyro = None if log.gyro is None else means(log.gyro)
        return cls(log, first, last, site, means(log.accel), gyro)

    @property
    def rest_time(self) -> FloatArray:
        """Length of each rest, shape (n,) [s]."""
        return np.asarray((self.last - self.first) * self.log.interval)

    @property
    def turn_time(self) -> FloatArray:
        """Length of each turn, from the last sample of a rest to the first of the next [s]."""
        return self.log.time[self.first[1:]] - self.log.time[self.last[:-1] - 1]

    @cached_property
    def turns(self) -> tuple[Log, IntArray, IntArray]:
        """Return the samples of the turns alone, with first and last sample of each turn.

        One more sample on either side is kept, for the rule that integrates rates. Between
        turns the shortened log jumps in time; nothing is integrated there.
        """
        keep = np.zeros(len(self.log), bool)
        for a, b in zip(self.last[:-1] - 1, self.first[1:], strict=True):
            keep[max(a - 1, 0) : b + 2] = True
        place = np.cumsum(keep) - 1
        return self.log[np.flatnonzero(keep)], place[self.last[:-1] - 1], place[self.first[1:]]

    @cached_property
    def bridged(self) -> FloatArray:
        """How far turns are off where rows are missing in them, shape (n - 1,) [rad]."""
        return bridged(self.log, self.last[:-1] - 1, self.first[1:])

    @property
    def earth(self) -> FloatArray:
        """w_ie_n, frame n, shape (3,) [rad/s]; zero where the latitude is unknown."""
        return np.zeros(3) if self.site.latitude is None else earth_rate_n(self.site.latitude)


@dataclass(frozen=True)
class Attitudes:
    """Model and attitudes: the state of the estimation."""

    model: ImuModel
    C_nb: FloatArray  # (n, 3, 3) attitude of each rest, body to East-North-Up [1]


@dataclass(frozen=True)
class Prediction:
    """Residuals, observation minus prediction, and the Jacobian of the prediction."""

    # (k, 3) one row per observation: rests (accelerometer), rests (gyro), turns [SI]
    residuals: FloatArray
    # (k, 3, m) columns: the coefficients, then three attitude angles per rest [SI]
    jacobian: FloatArray
    # (n - 1, 3, 3) covariance of each turn from unit white noise of the gyro, times the given psd
    # [rad^2]
    turn_noise: FloatArray
    # (n - 1, 3, 3) rotation error per constant rate error of the gyro output, in s [s]
    turn_bias: FloatArray
    # (2 n - 1, 3, 3) what the Earth's rate, frame n, does to mean rates and turns [SI]
    earth: FloatArray
    turn_path: FloatArray  # (n - 1,) angle travelled [rad]
    C_se: FloatArray  # (n - 1, 3, 3) integrated rotation of each turn [1]


def predict(
    session: Session, names: Sequence[str], state: Attitudes, gyro_psd: FloatArray
) -> Prediction:
    """Compare a session with the model at a state.

    `gyro_psd` (3,): white noise power of the gyro outputs [rad^2/s].
    """
    model, C_nb = state.model, state.C_nb
    n, p = len(C_nb), len(names)
    f = session.site.gravity * C_nb[:, 2, :]  # C_nb' (0, 0, g), one row per rest
    w = np.einsum("nji,j->ni", C_nb, session.earth)
    accel, gyro = model.measure(f, w)
    gyro_rows = 0 if session.gyro_mean is None else n + n - 1
    J = np.zeros((n + gyro_rows, 3, p + 3 * n))
    r = np.empty((n + gyro_rows, 3))
    rest = np.arange(n)
    tilt = p + 3 * rest[:, None] + np.arange(3)  # attitude columns of each rest

    r[:n] = session.accel_mean - accel
    slopes = model.slopes(f, w, names)
    J[:n, :, :p] = slopes.accel
    J[rest[:, None, None], np.arange(3)[:, None], tilt[:, None, :]] = (
        slopes.accel_by_force @ cross_matrix(f)
    )
    if session.gyro_mean is None:
        empty = np.zeros((0, 3, 3))
        return Prediction(r, J, empty, empty, empty, np.zeros(0), empty)

    r[n : 2 * n] = session.gyro_mean - gyro
    J[n : 2 * n, :, :p] = slopes.gyro
    J[n + rest[:, None, None], np.arange(3)[:, None], tilt[:, None, :]] = (
        slopes.gyro_by_rate @ cross_matrix(w) + slopes.gyro_by_force @ cross_matrix(f)
    )
    r[2 * n :], noise, bias, by_rate, path, C_se = _turns(
        session, names, state, gyro_psd, J[2 * n :]
    )
    C_bn = np.swapaxes(C_nb, 1, 2)
    turned = by_rate @ C_bn[:-1] * session.turn_time[:, None, None]
    earth = np.concatenate([slopes.gyro_by_rate @ C_bn, turned])
    return Prediction(r, J, noise, bias, earth, path, C_se)


def misfit(session: Session, state: Attitudes, turns: tuple[Log, IntArray, IntArray]) -> FloatArray:
    """Return the residuals of `predict` alone, shape (k, 3) [SI].

    `turns`: log of the session's turns, and first and last sample of each, (n - 1,) [1].
    """
    model, C_nb = state.model, state.C_nb
    f = session.site.gravity * C_nb[:, 2, :]
    w = np.einsum("nji,j->ni", C_nb, session.earth)
    accel, gyro = model.measure(f, w)
    out = [session.accel_mean - accel]
    if session.gyro_mean is not None:
        log_, first, last = turns
        _, w_b = model.compensate(log_.accel, log_.gyro)
        w_b, none, summed = np.ascontiguousarray(w_b), np.empty((0, 3)), log_.sampled == "increment"
        C_se, *_ = integrate_turns(log_.time, w_b, none, np.zeros((3, 3)), first, last, summed)
        out += [session.gyro_mean - gyro, log(C_se @ np.swapaxes(_turned(session, C_nb), 1, 2))]
    return np.concatenate(out)


def _turned(session: Session, C_nb: FloatArray) -> FloatArray:
    """Return the rotation of each turn between attitudes, shape (n - 1, 3, 3) [1]."""
    earth = exp(session.earth * session.turn_time[:, None])
    return np.asarray(np.swapaxes(C_nb[:-1], 1, 2) @ earth @ C_nb[1:])


def _turns(
    session: Session, names: Sequence[str], state: Attitudes, gyro_psd: FloatArray, J: FloatArray
) -> tuple[FloatArray, ...]:
    """Fill the Jacobian of the turns in place; return residuals, noise, slopes, path, C_se."""
    model, C_nb = state.model, state.C_nb
    log_, first, last = session.turns
    n, p = len(C_nb), len(names)
    inverse = np.linalg.inv(model.gyro_matrix)
    f_b, w_b = model.compensate(log_.accel, log_.gyro)
    assert f_b is not None
    assert w_b is not None
    C_se, bias, scale, force, noise, path = integrate_turns(
        log_.time,
        np.ascontiguousarray(w_b),  # one layout, one compilation
        np.ascontiguousarray(f_b),
        inverse @ np.diag(gyro_psd) @ inverse.T,
        first,
        last,
        log_.sampled == "increment",
    )
    modelled = _turned(session, C_nb)
    rho = log(C_se @ np.swapaxes(modelled, 1, 2))
    right = right_jacobian_inverse(rho)
    left = np.swapaxes(right, 1, 2)

    # Columns of d_eps, turned into the prediction's sign: minus d_rho.
    bias_s = left @ bias @ inverse
    inputs = {"gyro_matrix": scale, "g_sensitivity": force}
    for column, name in enumerate(names):
        block, where = coefficient_slot(name)
        if block == "gyro_bias":
            J[:, :, column] = bias_s[:, :, where]
        elif block in inputs:
            columns = inputs[block].reshape(-1, 3, 3, 3)[:, :, :, where[1]]
            J[:, :, column] = np.einsum("nab,nbi,i->na", left, columns, inverse[:, where[0]])
    turn = np.arange(n - 1)
    start = p + 3 * turn[:, None] + np.arange(3)
    at = (turn[:, None, None], np.arange(3)[:, None])
    J[(*at, start[:, None, :])] = -right
    J[(*at, start[:, None, :] + 3)] = right @ modelled
    return rho, noise, bias_s, right, path, C_se


def bridged(log_: Log, first: IntArray, last: IntArray) -> FloatArray:
    """Return how far turns are off where rows are missing in them, about each axis, (m,) [rad].

    A gap is bridged by a straight line from the rate before to that after. What a line misses is
    seen where nothing is missing: it is drawn over as long a time everywhere in the turns, and the
    most that it misses is taken, for rows may be lost where it is fastest.

    `log_`: readings with gyros [SI]; `first`, `last` (m,): first and last sample of each turn.
    """
    assert log_.gyro is not None
    w, step, out = log_.gyro, np.diff(log_.time), np.zeros(len(first))
    wide = np.flatnonzero(gaps(step))
    own = np.searchsorted(first, wide, side="right") - 1
    held = (own >= 0) & (wide < last[own])
    turned = np.zeros_like(w)
    np.cumsum(step[:, None] * (w[:-1] + w[1:]) / 2, axis=0, out=turned[1:])
    missed: dict[int, float] = {}
    for gap, turn in zip(wide[held].tolist(), own[held].tolist(), strict=True):
        k = round(step[gap] / log_.interval)
        if k not in missed:
            off = [np.zeros((0, 3))]
            for a, b in zip(first.tolist(), last.tolist(), strict=True):
                time = log_.time[a + k : b + 1] - log_.time[a : b + 1 - k]
                line = time[:, None] * (w[a : b + 1 - k] + w[a + k : b + 1]) / 2
                missing = turned[a + k : b + 1] - turned[a : b + 1 - k] - line
                off.append(missing[time < (k + GAP - 1) * log_.interval])
            # Longer than any turn: all that turns do may have been done in it.
            some = np.concatenate(off)
            some = some if len(some) else turned[last] - turned[first]
            missed[k] = float(np.max(some**2))
        out[turn] += missed[k]
    return np.sqrt(out)


SIX = tuple((axis, sign) for axis in range(3) for sign in (1, -1))
"""The six faces: the case axis that is vertical, and +1 where it points up."""


@dataclass(frozen=True)
class FaceReadings:
    """Means over rests on faces."""

    up_k: FloatArray  # (n, 3) nominal direction of up, a case axis or its opposite [1]
    accel: FloatArray  # (n, 3) mean specific force as measured [m/s^2]
    gyro: FloatArray | None  # (n, 3) mean rate as measured [rad/s]
    # start, time: (n,) beginning and length of each rest [s]
    start: FloatArray
    time: FloatArray
    # (n,) rests with the same number are one placement: nothing but whole turns between them
    group: IntArray

    def __len__(self) -> int:
        return len(self.up_k)

    @property
    def axis(self) -> IntArray:
        """Number of the case axis that is vertical, shape (n,)."""
        return np.asarray(np.argmax(np.abs(self.up_k), axis=1), dtype=np.int64)

    @property
    def sign(self) -> FloatArray:
        """+1 where that axis points up, -1 where down, shape (n,) [1]."""
        return np.asarray(self.up_k.sum(axis=1))


@dataclass(frozen=True)
class TurnReadings:
    """Integrals over turns about case axes."""

    axis_k: FloatArray  # (m, 3) the case axis turned about, positive [1]
    angle: FloatArray  # (m,) angle turned about it, positive by the right hand [rad]
    up_k: FloatArray  # (m, 3) nominal direction of up when the turn starts [1]
    gyro: FloatArray  # (m, 3) integral of the rate as measured [rad]
    accel: FloatArray  # (m, 3) integral of the specific force as measured [m/s]
    bridged: FloatArray  # (m,) how far off the first is for rows that are missing [rad]
    # start, time: (m,) beginning and length of each integral [s]
    start: FloatArray
    time: FloatArray
    group: IntArray  # (m,) the placement, as in `FaceReadings`
    # first, last: (m,) first sample of each integral and the sample after its last
    first: IntArray
    last: IntArray

    def __len__(self) -> int:
        return len(self.angle)

    @property
    def axis(self) -> IntArray:
        """Number of the case axis turned about, shape (m,)."""
        return np.asarray(np.argmax(self.axis_k, axis=1), dtype=np.int64)

    @property
    def about_up(self) -> FloatArray:
        """+1 where the axis points up, -1 where down, 0 where it is level, shape (m,) [1]."""
        return np.asarray(np.sum(self.axis_k * self.up_k, axis=1))


def face_name(axis: int, sign: float) -> str:
    """Return a face in words, such as "x up".

    `axis`: 0, 1 or 2 for x, y or z [1]; `sign`: +1 where it points up [1].
    """
    return f"{AXES[axis]} {'up' if sign > 0 else 'down'}"


def turn_name(axis: int, angle: float, about_up: float) -> str:
    """Return a turn in words, such as "about x, x up, clockwise seen from above".

    `axis`: 0, 1 or 2 for x, y or z [1]; `angle`: angle about that axis [rad]; `about_up`: +1
    where the axis points up, -1 where down, 0 where it is level [1].
    """
    name = AXES[axis]
    if about_up == 0:
        return f"about {name}, {name} level, {'positive' if angle > 0 else 'negative'} sense"
    sense = "counter-clockwise" if angle * about_up > 0 else "clockwise"
    return f"about {name}, {face_name(axis, about_up)}, {sense} seen from above"


@dataclass(frozen=True)
class Steps:
    """What the gyros said at constant rates of the table."""

    up: FloatArray  # (n, 3) axis that is along the vertical, with its sense; fixture axes [1]
    placement: IntArray  # (n,) number of the placement; up is the same in all steps of one [1]
    rate: FloatArray  # (n,) rate of the table, counter-clockwise seen from above [rad/s]
    time: FloatArray  # (n,) how long was averaged [s]
    gyro: FloatArray  # (n, 3) mean rate as measured [rad/s]
    cov: FloatArray  # (n, 3, 3) covariance of the noise of these means [(rad/s)^2]
    # (n, 3) true mean specific force, fixture axes, for the g-sensitivity [m/s^2]
    force: FloatArray
    # (n,) when each step began; None: one right after the other [s]
    start: FloatArray | None = None
    # declared noise of the gyros whose bias wanders, which ties the steps together; it is not in
    # `cov` [SI]
    slow: TriadNoise | None = None
    # (n,) angle of the table when each step began, counter-clockwise from above; NaN where it did
    # not tell it [rad]
    azimuth: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.rate)

    @property
    def axis(self) -> IntArray:
        """Which axis is along the vertical, 0, 1 or 2, shape (n,)."""
        return np.asarray(np.abs(self.up).argmax(axis=1))

    @property
    def sense(self) -> FloatArray:
        """1 where that axis points up, -1 where it points down, shape (n,)."""
        return np.asarray(np.sign(np.take_along_axis(self.up, self.axis[:, None], 1)[:, 0]))

    @cached_property
    def level(self) -> FloatArray:
        """The next two axes of the fixture, which are level, shape (n, 3, 2) [1]."""
        eye = np.eye(3)
        return np.stack([eye[(self.axis + 1) % 3], eye[(self.axis + 2) % 3]], axis=2)

    @cached_property
    def azimuth_known(self) -> BoolArray:
        """Whether the table told its angle when a step began, shape (n,)."""
        told = np.zeros(len(self)) if self.azimuth is None else np.isfinite(self.azimuth)
        return np.asarray(told, bool)

    @cached_property
    def level_at_zero(self) -> FloatArray:
        """What is `level` where the table is at angle 0, as seen by the steps, (n, 3, 2) [1]."""
        angle = np.zeros(len(self)) if self.azimuth is None else self.azimuth
        turn = np.where(self.azimuth_known, angle, 0.0) * self.sense
        c, s = np.cos(turn), np.sin(turn)
        return np.asarray(self.level @ np.moveaxis(np.array([[c, s], [-s, c]]), 2, 0))

    @property
    def half_time(self) -> float:
        """When the session was half over [s]."""
        middle, half = self.middle, self.time / 2
        return float(((middle - half).min() + (middle + half).max()) / 2)

    @property
    def middle(self) -> FloatArray:
        """When each step was half over, shape (n,) [s]."""
        ends = np.concatenate([[0.0], np.cumsum(self.time)])
        start = self.start
        if start is None or not np.isfinite(start).all() or (np.diff(start) <= 0).any():
            start = ends[:-1]
        return np.asarray(start + self.time / 2)

    @property
    def turns(self) -> FloatArray:
        """Turns averaged, shape (n,) [1]."""
        return np.asarray(np.abs(self.rate) * self.time / (2 * np.pi))


def mean_force_of_steps(
    up: FloatArray,
    placement: IntArray,
    rate: FloatArray,
    accel: FloatArray | None,
    site: Site,
) -> FloatArray:
    """Return the true specific force of each step, fixture axes, shape (n, 3) [m/s^2].

    Gravity along up, and what grows with the square of the rate across it: the accelerometers see
    the centripetal acceleration of their place, and the gyros are taken to be there too.

    `up` (n, 3): axis that is along the vertical, with its sense [1]; `placement` (n,): number of
    the placement [1]; `rate` (n,): rate of the table [rad/s]; `accel` (n, 3) or None: mean
    specific force as measured [m/s^2].
    """
    force = site.gravity * up
    if accel is None:
        return force
    for p in np.unique(placement):
        mine = placement == p
        square = rate[mine] ** 2
        spread = square - square.mean()
        if spread @ spread > 0:
            slope = spread @ (accel[mine] - accel[mine].mean(axis=0)) / (spread @ spread)
            slope -= (slope @ up[mine][0]) * up[mine][0]
            force[mine] += square[:, None] * slope
    return np.asarray(force)
