"""The uncertainty of a planned systematic calibration in milliseconds, for a search.

A covariance does not depend on readings. What the filter does to it falls apart into actions that
can be kept and used again:

* At rest the errors of the sensors are constants, e = A z in east, north and up, with z the
  coefficients and A of the attitude. The errors x of navigation and e go by one linear equation
  that is the same in every attitude. So a rest of given length tells J (15 x 15) of (x, e) at its
  start and leaves ``x' = F x + G e + noise``: three matrices for every length, made once.
* A turn measures nothing: a transition and a noise, of the filter's own kernel at few samples a
  second, kept for every turn from every attitude.

Approximations: turns are sampled every `STEP` or less often than `SLOW`, rests begin and end on an
update, a drift over the session is constant in each rest and turn, and the uncertainty at the start
is that of the plan to beat. `procedures.systematic.plan`
has none of them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import ceil

import numpy as np

from foucault.arrays import FloatArray, IndexArray
from foucault.estimate.systematic import BETWEEN, STAYS, AtRest
from foucault.models.earth import Site, earth_rate_n
from foucault.models.ins_errors import Sensors, dynamics
from foucault.models.noise import ImuNoise
from foucault.navigate.increments import increments_of
from foucault.navigate.ins_filter import Updates, run
from foucault.navigate.strapdown import State
from foucault.plans.manoeuvres import Rest, Rotate
from foucault.plans.sequence import CalibrationSequence
from foucault.simulate.systematic import simulate_systematic

STEP, SLOW = np.radians(6.0), 10.0
"""Turns are sampled so that none of them turns more [rad], and at least so often [Hz]."""

KEPT = 20_000  # Turns and attitudes that are remembered [1].

Epoch = tuple[FloatArray, FloatArray]
"""Transition (9, 9 + p) and noise (9, 9) of a time without measurements."""

_ERRORS = Sensors.of(("gyro.bias", "accel.bias"))  # what any sensor error is at rest


@dataclass(frozen=True)
class Still:
    """What a rest does."""

    # (m, 15) ``root' root`` is what it tells of the errors of navigation at its start and of the
    # errors of gyros and accelerometers along n [SI]
    root: FloatArray
    moved: FloatArray  # (9, 15) how the errors of navigation at its end follow from them [SI]
    noise: FloatArray  # (9, 9) what else is uncertain at its end [SI]


Stills = dict[int, list[Still]]
"""First error of navigation that a rest starts anew with -> rests by number of updates.

3: velocity and position, which turns tell nothing of; 6: position, once it was measured; 9: none.
"""


@dataclass
class Quick:
    """Uncertainty of any sequence, with what is known of the instrument and its filter."""

    site: Site  # where it stands; the latitude must be known
    sensors: Sensors
    noise: ImuNoise  # white noise of the sensors [SI]
    at_rest: AtRest  # what is known at rest
    start: FloatArray  # (9 + p, 9 + p) covariance at the start [SI]
    # rests that are kept: the same for all that is estimated
    rests: Stills = field(default_factory=dict, repr=False)
    # turns that are kept
    _turns: dict[bytes, list[Epoch]] = field(default_factory=dict, repr=False)
    # (6, p) what the coefficients make of the readings at rest, attitude by attitude [SI]
    _felt: dict[bytes, FloatArray] = field(default_factory=dict, repr=False)

    def __getstate__(self) -> dict[str, object]:
        # What is remembered stays behind when it is sent to another process.
        return {**self.__dict__, "_turns": {}, "_felt": {}, "rests": {}}

    def cov(self, sequence: CalibrationSequence) -> FloatArray:
        """Return the covariance of the coefficients after a sequence, shape (p, p) [SI].

        `sequence`: rests, turns and spins, the first of them a rest.
        """
        P, begins = self.start, np.cumsum([0.0, *(a.time for a in sequence.actions)])
        for k, action in enumerate(sequence.actions):
            ramp = (begins[k] + begins[k + 1]) / 2 / begins[-1] - 0.5
            # What is kept is that of the rounded attitude, whichever way first led there.
            C_nb = sequence.attitudes[k].round(12) + 0.0
            if isinstance(action, Rotate):
                if abs(action.angle) > 0:
                    P = self._turned(P, action, C_nb, ramp)
            else:
                P = self._rested(P, action, C_nb, ramp, first=k == 0)
        return P[9:, 9:]

    def sd(self, sequence: CalibrationSequence) -> FloatArray:
        """Return standard deviations of the coefficients, shape (p,) [SI]; see `cov`."""
        return np.sqrt(np.diag(self.cov(sequence)))

    @cached_property
    def _drifts(self) -> tuple[list[int], list[int]]:
        """Coefficients that are drifts, and those that they are drifts of [1]."""
        names = self.sensors.layout.names
        drifts = [n for n in names if n.startswith("drift.")]
        return (
            [names.index(n) for n in drifts],
            [names.index(n.removeprefix("drift.")) for n in drifts],
        )

    # -- rests

    def _rested(
        self, P: FloatArray, rest: Rest, C_nb: FloatArray, ramp: float, *, first: bool
    ) -> FloatArray:
        anew = 9 if first else 3 if self.at_rest.decorrelate else 6
        kept, each = self.rests.setdefault(anew, []), self.at_rest.interval
        number = max(1, round(rest.time / each))
        if len(kept) < number:
            self.rests[anew] = kept = self._stills(2 * number, anew)
        still = kept[number - 1]
        B = np.zeros((15, len(P)))
        B[:9, :9] = np.eye(9)
        key = C_nb.tobytes()
        if key not in self._felt:
            if len(self._felt) >= KEPT:
                self._felt.clear()
            self._felt[key] = self._errors(C_nb)
        B[9:, 9:] = self._felt[key]
        drifts, of = self._drifts
        B[9:, [9 + k for k in drifts]] = ramp * B[9:, [9 + k for k in of]]
        for h in still.root @ B:  # one by one: together they may be 1e8 times what was known
            Ph = P @ h
            P = P - np.outer(Ph, Ph / (1.0 + h @ Ph))
        return _carried(P, still.moved @ B, still.noise)

    def _errors(self, C_nb: FloatArray) -> FloatArray:
        """Return what the coefficients make of the readings at rest, along n, shape (6, p)."""
        assert self.site.latitude is not None
        w, f = C_nb.T @ earth_rate_n(self.site.latitude), C_nb.T @ [0.0, 0.0, self.site.gravity]
        still = self._at_rest
        out = np.zeros((6, len(self.sensors)))
        out[:, still[0]] = still[1].readings(w, f)
        return np.kron(np.eye(2), C_nb) @ out

    @property
    def _at_rest(self) -> tuple[IndexArray, Sensors]:
        """Coefficients that are felt at rest: lever arms and delay are not."""
        s = self.sensors
        felt = s.entry < 31
        numbers = np.unique(s.coefficient[felt])
        layout = s.layout.subset([s.layout.names[i] for i in numbers])
        renumbered = np.searchsorted(numbers, s.coefficient[felt])
        return numbers, Sensors(layout, renumbered, s.axis[felt], s.entry[felt], s.weight[felt])

    def _stills(self, most: int, anew: int) -> list[Still]:
        """Return what rests of 1 to `most` updates do."""
        from scipy.linalg import expm

        assert self.site.latitude is not None
        each, g = self.at_rest.interval, self.site.gravity
        A = dynamics(
            _ERRORS, np.eye(3), earth_rate_n(self.site.latitude), np.array([0.0, 0.0, g]),
            earth_rate_n(self.site.latitude), np.zeros(3), g / 6.37e6,
        )  # fmt: skip
        step = expm(A * each)
        half = np.zeros(9)
        half[:3], half[3:6] = self.noise.gyro.white**2, self.noise.accel.white**2
        half *= each / 2
        sd = np.repeat([self.at_rest.velocity_sd, self.at_rest.position_sd], 3)
        P, moved, root, out = np.zeros((9, 9)), np.eye(9, 15), np.zeros((0, 15)), []
        for k in range(most):
            P = step[:9, :9] @ (P + np.diag(half)) @ step[:9, :9].T + np.diag(half)
            moved = step[:9, :9] @ moved
            moved[:, 9:] += step[:9, 9:]
            if k > 0 or anew > 3:
                S = P[3:, 3:] + np.diag(sd**2)
                gain = np.linalg.solve(S, P[3:]).T
                told = np.linalg.solve(np.linalg.cholesky(S), moved[3:])
                root = np.asarray(np.linalg.qr(np.vstack([root, told]), mode="r"))
                moved, P = moved - gain @ moved[3:], P - gain @ P[3:]
            if k == 0:
                P[anew:], P[:, anew:], moved[anew:] = 0.0, 0.0, 0.0
                known = sd if anew == 3 else np.full(9 - anew, STAYS)
                P[anew:, anew:] = np.diag(known**2)
            out.append(Still(root, moved, (P + P.T) / 2))
        return out

    # -- turns

    def _turned(self, P: FloatArray, turn: Rotate, C_nb: FloatArray, ramp: float) -> FloatArray:
        said = np.array([turn.angle, turn.rate, turn.ramp]).round(9)
        key = C_nb.tobytes() + said.tobytes() + turn.axis.encode()
        if key not in self._turns:
            if len(self._turns) >= KEPT:
                self._turns.clear()
            self._turns[key] = self._turn(turn, C_nb)
        sd = self.at_rest.turning_sd
        drifts, of = self._drifts
        for steady, noise in self._turns[key]:
            through = steady.copy()
            through[:, [9 + k for k in drifts]] = ramp * steady[:, [9 + k for k in of]]
            P = _carried(P, through, noise)
            for row in range(3, 6):
                if sd is not None:
                    P = P - np.outer(P[row], P[row] / (P[row, row] + sd**2))
        return P

    def _turn(self, turn: Rotate, C_nb: FloatArray) -> list[Epoch]:
        """Return what a turn does, by the kernel of the filter.

        One of each for the whole turn; one for every update, where turns have some.
        """
        rate = ceil(max(SLOW, turn.rate / STEP))
        still = Rest(1.0 / rate)
        made = CalibrationSequence("a turn", C_nb, (still, turn, still))
        log = simulate_systematic(made, site=self.site, rate=float(rate)).log
        last = len(log) - 2
        updated = self.at_rest.turning_sd is not None
        each = self.at_rest.interval if updated else BETWEEN
        rows = np.union1d(np.arange(1, last, round(each * rate))[1:], last)
        p, site = len(self.sensors), self.site
        assert site.latitude is not None
        found = run(
            increments_of(log), State.at_rest(C_nb, site.latitude, 0.0, site.height),
            self.sensors, Updates.none(rows), np.zeros((9 + p, 9 + p)), self.noise, first=1,
            keep=True,
        )  # fmt: skip
        q = np.repeat([self.noise.gyro.white**2, self.noise.accel.white**2, 0.0], 3) / 2
        out, through, noise = [], np.eye(9, 9 + p), np.zeros((9, 9))
        for Phi, T in zip(found.transitions, np.diff([1, *rows]) / rate, strict=True):
            through = Phi[:, :9] @ through
            through[:, 9:] += Phi[:, 9:]
            noise = Phi[:, :9] @ (noise + np.diag(q * T)) @ Phi[:, :9].T + np.diag(q * T)
            if updated:
                out.append((through, noise))
                through, noise = np.eye(9, 9 + p), np.zeros((9, 9))
        return out or [(through, noise)]


def _carried(P: FloatArray, through: FloatArray, noise: FloatArray) -> FloatArray:
    """Return the covariance after ``x' = through (x, z) + noise``; z stays."""
    out = P.copy()
    across = through @ P
    out[:9, 9:] = across[:, 9:]
    out[9:, :9] = across[:, 9:].T
    out[:9, :9] = across @ through.T + noise
    return out
