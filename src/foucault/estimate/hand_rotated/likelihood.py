"""A session of rests and turns as a mixed model.

The readings and their Jacobian are those of `models.rests_and_turns`: the coefficients first, then
three attitude angles per rest. The heading of the first rest has a prior as wide as the circle; the
Earth's rotation, where it is modelled and visible, narrows it.

What the noise does not explain has a size for each kind of reading, found from the residuals: it is
the honest uncertainty of a hand-held rest, and zero on a stable table (design/README.md).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.coefficients import Layout
from foucault.infer.mixed import Fit, Linearisation, Source
from foucault.models.earth import EARTH_RATE
from foucault.models.imu import LAYOUT
from foucault.models.noise import TriadNoise
from foucault.models.rests_and_turns import Attitudes, Prediction, Session, predict
from foucault.models.rotation import exp
from foucault.models.session_noise import QUIET_ENDS, SessionNoise, window_covariance

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
        """Return the white rows of headings of which nothing is known: that of the first rest.

        Without gyros nothing ties the headings together, and each rest needs its own.
        """
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
            tied = rows(0, np.asarray(np.kron(self._slow[0], np.eye(3))).reshape(n, 3, -1))
            name = "slow noise of accelerometers"
            out.append(Source(name, shared=tied, noise=True, basis=slow))
        if s.gyro_mean is not None:
            rest = _roots(noise.gyro_psd / T + 2 * noise.gyro_carried / T**2)
            turn = np.linalg.cholesky(at.turn_noise + 2 * np.diag(noise.gyro_carried))
            out.append(Source("gyro noise", rows(n, np.concatenate([rest, turn])),
                              self._rounding(at), noise=True, type=kind, basis=basis))  # fmt: skip
            if _wanders(noise.slow.gyro):
                effect = np.concatenate([np.broadcast_to(np.eye(3), (n, 3, 3)), at.turn_bias])
                tied = np.einsum("iac,ij->iajc", effect, self._slow[1]).reshape(2 * n - 1, 3, -1)
                name = "slow noise of gyros"
                out.append(Source(name, shared=rows(n, tied), noise=True, basis=slow))
            if s.site.latitude is None:
                # One vector for the whole session, for the turns tie the headings together. It has
                # its full size over all directions: a third of its square per axis.
                out.append(Source("unknown Earth rate", None, rows(n, at.earth),
                                  EARTH_RATE / np.sqrt(3.0), type="B",
                                  basis="latitude not given: any direction"))  # fmt: skip
        if self.price is not None:
            out += [
                Source(SCATTER[name], mine[:, :, None] * np.eye(3), None, None, price=self.price,
                       unexplained=True, type="A",
                       basis="scatter of the residuals beyond the noise")
                for name, mine in self.kinds.items()
            ]  # fmt: skip
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
        return _root(accel), _root(window_covariance(start, end, self.noise.slow.gyro))


def session_of(fit: Fit) -> RestsAndTurns:
    """Return the model of a session that was fitted."""
    assert isinstance(fit.model, RestsAndTurns)
    return fit.model


def _wanders(triad: TriadNoise) -> bool:
    return bool(triad.bias_instability or triad.random_walk)


def _root(cov: FloatArray) -> FloatArray:
    """A root of a covariance that may be singular: a bias that hardly changes is one number."""
    size, axes = np.linalg.eigh(cov)
    return np.asarray(axes * np.sqrt(np.maximum(size, 0.0)))


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
