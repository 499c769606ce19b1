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

from foucault.arrays import FloatArray
from foucault.estimate.tumble import STATES, Prior, State, Tumble, apart, look
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
        t, gains, (time, ends) = self.t, self.found.gains, self.found.out[9:]
        read = gains[:, 4, 0, 0] > 0
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
        turned *= 1 + self.at.constants[SCALE, None]
        b = answer(gains, turned, missed)
        dw = missed[read]
        if t.shared:
            dw = apart(dw, time, t.shared)
        dw = dw.reshape(-1, len(changes))
        for j, change in enumerate(changes):
            if change.late:
                later = look(replace(t, late=t.late + change.late), self.prior, self.at, rows=True)
                dw[:, j] += later.rows[..., RESIDUAL].ravel() - self.rows[:, RESIDUAL]
                b[:, j] += (later.out[1][0] - self.found.out[1][0])[:, RESIDUAL]
        return dw, b
