"""What small changes of a tumble's log do to its residuals and its solution, many at once.

Near a solution all is linear. A change that adds dz to the readings and has the gyros turn p by
da more between two residuals moves the trajectory by u and what the filter believes of it by y;
b = y - u obeys the recursion of any column of `kernels.cluster_information`::

    b = (I + F) b - A da      s = H b + dz      dw = L^-1 s      b = b - K s

with the gains of one pass over the log as it is: no change needs a pass of its own. White rows
``S`` that move by dw move the step of the solution by ``dx = cov S' dw``; what is left of the
residuals moves by ``dw - S dx`` and the attitude at the end by ``Y dx - b``. How late the
readings are shows most where the command steps, within an average too: that alone takes a pass.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.estimate.tumble import STATES, Prior, State, Tumble, apart, look
from foucault.infer.filtered import Whitened
from foucault.kernels.cluster_information import RESIDUAL, answer

SCALE = slice(21, 24)  # Torquer scale factors among the packed constants.


@dataclass(frozen=True)
class Change:
    """A small change of a log."""

    reading: FloatArray | None = None  # (n, 3) added to the readings [local g]
    command: FloatArray | None = None  # (n, 3) added to the command [rad/s]
    late: float = 0.0  # by so much older are the readings [s]

    def put(self, t: Tumble, times: float = 1.0) -> Tumble:
        """Return the log with so many `times` the change [1]."""
        given = {"reading": self.reading, "command": self.command}
        more = {k: getattr(t, k) + times * x for k, x in given.items() if x is not None}
        return replace(t, late=t.late + times * self.late, **more)


class Linear:
    """A log linearised about a state near its solution."""

    def __init__(self, t: Tumble, prior: Prior, at: State) -> None:
        self.t, self.prior, self.at = t, prior, at
        self.found = look(t, prior, at, rows=True, gains=True)
        self.miss, self.slope = prior.rows(at)
        self.rows = self.found.rows.reshape(-1, self.found.rows.shape[-1])

    @property
    def residuals(self) -> FloatArray:
        """White residuals at the solution, prior and all, shape (r,) [1]."""
        log = self.rows[:, RESIDUAL] - self.rows[:, :STATES] @ self.found.x
        return np.concatenate([log, self.miss - self.slope @ self.found.x])

    def answers(self, changes: Sequence[Change]) -> tuple[FloatArray, FloatArray]:
        """Return by what residuals (r, c) [1] and solution (46, c) answer changes of the log.

        The solution is in the order of `Fit.cov`.
        """
        dw, b = self._filtered(changes)
        found, S = self.found, self.rows[:, :STATES]
        dx = found.cov @ (S.T @ dw)
        Y, C_ip = found.out[1][0][:, :STATES], found.out[3][0]
        moved = dx * self.prior.unit[:, None]
        moved[:3] = C_ip.T @ (Y @ dx - b)
        return np.concatenate([dw - S @ dx, -self.slope @ dx]), moved

    def _filtered(self, changes: Sequence[Change]) -> tuple[FloatArray, FloatArray]:
        """Return by what the white rows (3 b, c) [1] and b at the end (3, c) [rad] answer."""
        t, ends, read = self.t, self.found.out[10], self._read
        starts = np.arange(0, len(t.dt), t.block)
        count = np.add.reduceat(t.used.astype(float), starts)
        some = count > 0
        now = np.concatenate([[0.0], np.cumsum(t.dt)])
        missed, turned = (np.zeros((len(ends), 3, len(changes))) for _ in range(2))
        for j, change in enumerate(changes):
            if change.reading is not None:
                total = np.add.reduceat(change.reading * t.used[:, None], starts)
                missed[read, :, j] = total[some] / count[some, None]
            if change.command is not None:
                angle = np.cumsum(change.command * t.dt[:, None], axis=0)
                for i in range(3):
                    at = np.interp(ends, now, np.concatenate([[0.0], angle[:, i]]))
                    turned[:, i, j] = np.diff(at, prepend=0.0)
        dw, b = self._white(turned, missed)
        dw = dw.reshape(-1, len(changes))
        for j, change in enumerate(changes):
            if change.late:
                later = look(replace(t, late=t.late + change.late), self.prior, self.at, rows=True)
                dw[:, j] += later.rows[..., RESIDUAL].ravel() - self.rows[:, RESIDUAL]
                b[:, j] += (later.out[1][0] - self.found.out[1][0])[:, RESIDUAL]
        return dw, b

    @property
    def _read(self) -> BoolArray:
        """Which steps of the filter have a residual."""
        return np.asarray(self.found.gains[:, 4, 0, 0] > 0)

    def _white(self, turned: FloatArray, missed: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return white rows (b, 3, c) [1] and b (3, c) [rad] of what is added in every step.

        `turned` (steps, 3, c): angles [rad]; `missed` (steps, 3, c): readings [local g], lost.
        """
        b = answer(self.found.gains, turned * (1 + self.at.constants[SCALE, None]), missed)
        dw = missed[self._read]
        return apart(dw, self.found.out[9], self.t.shared) if self.t.shared else dw, b

    def white(self, beside: FloatArray | None) -> Whitened:
        """Return the white rows at the solution; `beside` (b, 3, c) or None: as of `Whitened`."""
        rows, on = self.found.rows, self.prior.sought
        left = rows[..., RESIDUAL] - rows[..., :STATES] @ self.found.x
        # Roots of a covariance of so poor a condition are to be triangular.
        root = np.linalg.cholesky(self.found.cov[np.ix_(on, on)])
        return Whitened(left, rows[..., on] @ root, np.eye(len(on)), beside)

    def shifts(self, at: IntArray) -> dict[str, FloatArray]:
        """Return by what white rows (b, 3, k, 3) answer what stays from row `at` (k,) on [1].

        Of each kind one unit along each axis: of the drift [rad/s], of the attitude beside the
        command [rad], of the biases [local g]; and drift and biases that grow over the log.
        """
        ends, begins = self.found.out[10], np.flatnonzero(self._read)[at]
        number, length = np.arange(len(ends))[:, None], np.diff(ends, prepend=0.0)[:, None]
        on, grown = 1.0 * (number >= begins), (ends / ends[-1])[:, None]
        kinds = {
            "drift": (on * length, 0 * on), "attitude": (1.0 * (number == begins), 0 * on),
            "biases": (0 * on, on), "drift, slowly": (grown * length, 0 * grown),
            "biases, slowly": (0 * grown, grown),
        }  # fmt: skip

        def answered(*parts: FloatArray) -> FloatArray:
            turned, missed = (
                np.einsum("ek,ij->eikj", x, np.eye(3)).reshape(len(ends), 3, -1) for x in parts
            )
            return self._white(turned, missed)[0].reshape(-1, 3, parts[0].shape[1], 3)

        return {kind: answered(*parts) for kind, parts in kinds.items()}
