"""Transfer alignment: the slave's errors from its master's messages, pass by pass.

The equations are those of `estimate.transfer_system`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from foucault.coefficients import CoefficientVector, Layout
from foucault.estimate.ins_filter import seen_at_place
from foucault.estimate.linear_filter import LinearRun, kalman, smoothed
from foucault.estimate.transfer_system import Free, Known, Slave, free_run
from foucault.models.rotation import exp
from foucault.models.transfer import Matching, Messages, Mount

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Transfer:
    """What a transfer alignment has found.

    Attributes
    ----------
    free : Free
        The last free run.
    run : LinearRun
        The last pass of the filter.
    at : Known
        The point it is linear about.
    passes : tuple of ndarray, each shape (n - 9,)
        All but the errors of navigation after each pass [SI].
    """

    free: Free
    run: LinearRun
    at: Known
    passes: tuple[FloatArray, ...]

    @property
    def point(self) -> FloatArray:
        """What is added to the states after the ninth, shape (n - 9,) [SI]."""
        return _point(self.free.layout, self.at)

    @property
    def estimate(self) -> CoefficientVector:
        """Coefficients, installation, and what else was a state, at the last message [SI]."""
        layout = Layout(self.free.layout.coefficients[9:])
        values = self.point + self.run.states[-1, 9:]
        return CoefficientVector(layout, values, self.run.cov[9:, 9:])


def _point(layout: Layout, at: Known) -> FloatArray:
    out = np.zeros(len(layout))
    p = len(at.coefficients)
    out[9 : 9 + p] = at.coefficients
    out[layout.group("installation")] = at.installation
    if "master.delay" in layout.names:
        out[layout.index("master.delay")] = at.delay
    return out[9:]


def solve(
    slave: Slave,
    master: Messages,
    mount: Mount,
    matching: Matching,
    prior: Known,
    sd: FloatArray,
    *,
    passes: int = 2,
    gate: float = np.inf,
) -> Transfer:
    """Estimate the slave's errors with a Kalman filter.

    Parameters
    ----------
    slave : Slave
        Its log.
    master : Messages
        What the master says.
    mount : Mount
        How they are fixed together.
    matching : Matching
        What of the messages is used.
    prior : Known
        What was known beforehand; the first pass is linear about it.
    sd : ndarray, shape (n,)
        How well, see `free_run` [SI].
    passes : int, shape ()
        How often; each later pass is linear about the start that the one before has found [1].
    gate : float, shape ()
        Measurements beyond so many standard deviations are left out in the last pass [1].
    """
    at, seen = prior, []
    for k in range(passes):
        again = k + 1 < passes
        free = free_run(slave, master, mount, matching, at, prior, sd)
        found = kalman(free.system, gate=np.inf if again else gate, keep=again)
        seen.append(_point(free.layout, at) + found.states[-1, 9:])
        if again:
            at = moved(free, at, smoothed(free.system, found).start)
    return Transfer(free, found, at, tuple(seen))


def moved(free: Free, at: Known, x: FloatArray) -> Known:
    """Return the point to be linear about next.

    Parameters
    ----------
    free : Free
        The run about the point `at`.
    at : Known
        The point.
    x : ndarray, shape (n,)
        Errors at the start [SI].
    """
    layout, p = free.layout, len(at.coefficients)
    seen = seen_at_place(at.state.packed()[None])[0] @ x[:9]
    state = replace(at.state, C_nb=exp(seen[:3]) @ at.state.C_nb,
                    velocity_n=at.state.velocity_n - seen[3:6])  # fmt: skip
    delay = at.delay
    if "master.delay" in layout.names:
        delay += float(x[layout.index("master.delay")])
    return Known(state, at.coefficients + x[9 : 9 + p],
                 at.installation + x[layout.group("installation")], delay)  # fmt: skip
