"""What a slave and its master turned between the same instants, relative to inertial space.

Between two epochs of the master, a to b by its stamps, and tau earlier by the slave's clock::

    phi_m = Log(C_im(a)' C_im(b))        phi_s = Log(C_is(a - tau)' C_is(b - tau))
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from foucault.arrays import BoolArray, FloatArray
from foucault.models.rotation import exp, log
from foucault.navigate.increments import Increments


@dataclass(frozen=True)
class Turns:
    """What a master turned between its epochs, relative to inertial space."""

    # start, end: (k,) epochs, as stamped [s]
    start: FloatArray
    end: FloatArray
    phi_m: FloatArray  # (k, 3) rotation vectors in the master's axes [rad]

    @cached_property
    def dt(self) -> FloatArray:
        """Lengths of the intervals, shape (k,) [s]."""
        return self.end - self.start

    @cached_property
    def interval(self) -> float:
        """Usual length of an interval [s]."""
        return float(np.median(self.dt))

    def __len__(self) -> int:
        return len(self.start)

    def __getitem__(self, rows: slice | BoolArray) -> Turns:
        """Return some of the intervals."""
        return Turns(self.start[rows], self.end[rows], self.phi_m[rows])


@dataclass(frozen=True)
class SlaveAttitude:
    """The attitude of the slave relative to its start, at any time.

    Between samples the angle follows the cubic that has the increments around it.
    """

    increments: Increments  # what its gyros added up [SI]

    @cached_property
    def history(self) -> FloatArray:
        """Attitude at the end of every interval relative to inertial space, shape (n, 3, 3)."""
        from foucault.kernels.inertial import from_start

        x = self.increments
        C_0s, _ = from_start(x.dtheta_b, np.zeros_like(x.dtheta_b), *x.bends)
        return np.asarray(C_0s)

    @cached_property
    def _bends(self) -> tuple[FloatArray, FloatArray]:
        """How much the increment before is less than each one, and the one after more [rad]."""
        theta, joined = self.increments.dtheta_b, self.increments.joined
        before, after = np.zeros_like(theta), np.zeros_like(theta)
        step = np.where(joined[1:, None], np.diff(theta, axis=0), 0.0)
        before[1:], after[:-1] = step, step
        return before, after

    @cached_property
    def cuts(self) -> FloatArray:
        """Ends of the intervals that are not joined to the one before, shape (c,) [s]."""
        return self.increments.time[1:][~self.increments.joined[1:]]

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return C_0s, shape (k, 3, 3), and the rate w_is_s, shape (k, 3) [rad/s].

        `time` (k,): when, within the log [s].
        """
        x = self.increments
        row = np.clip(np.searchsorted(x.time, time), 1, len(x) - 1)
        f = ((time - x.time[row - 1]) / (x.time[row] - x.time[row - 1]))[:, None]
        p = 1.0 - f
        theta, (before, after) = x.dtheta_b[row], (one[row] for one in self._bends)
        # Everett's formula for the integral of the rate through four ends of intervals
        part = f * theta + p * (p * p - 1) / 6 * before + f * (f * f - 1) / 6 * after
        rate = theta - (3 * p * p - 1) / 6 * before + (3 * f * f - 1) / 6 * after
        return self.history[row - 1] @ exp(part), rate / x.dt[row][:, None]

    def turned(self, start: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return phi_s, shape (k, 3) [rad], and its slope by the delay, shape (k, 3) [rad/s].

        `start`, `end` (k,): from when to when, by the slave's clock [s].
        """
        if np.array_equal(start[1:], end[:-1]):  # one look-up serves both
            C, w = self.at(np.append(start, end[-1:]))
            C_a, C_b, w_a, w_b = C[:-1], C[1:], w[:-1], w[1:]
        else:
            (C_a, w_a), (C_b, w_b) = self.at(start), self.at(end)
        phi = log(np.swapaxes(C_a, 1, 2) @ C_b)
        # Log(Exp(w_a d) Exp(phi) Exp(-w_b d)), to second order in phi
        fall, sum_ = w_a - w_b, w_a + w_b
        slope = fall - 0.5 * np.cross(phi, sum_) + np.cross(phi, np.cross(phi, fall)) / 12
        return phi, slope


def turns_of(time: FloatArray, C_nb: FloatArray, w_in_n: FloatArray | None = None) -> Turns:
    """Return what a master turned between its epochs.

    `time` (k,): epochs, as stamped, rising [s]; `C_nb` (k, 3, 3): its attitude [1]. Frame n
    cancels but for its own rate; `w_in_n` (k, 3): rate of frame n, of Earth and transport
    [rad/s], None where n does not turn. Left out, up to 15 deg/h of the Earth's rate go into the
    bias.
    """
    before = np.swapaxes(C_nb[:-1], 1, 2)
    if w_in_n is not None:
        between = 0.5 * (w_in_n[:-1] + w_in_n[1:]) * np.diff(time)[:, None]
        before = before @ exp(between)
    phi = np.full((len(time) - 1, 3), np.nan)
    both = before @ C_nb[1:]
    known = np.isfinite(both).all(axis=(1, 2))
    phi[known] = log(both[known])
    return Turns(time[:-1], time[1:], phi)


def inside(
    slave: SlaveAttitude, turns: Turns, delay: float, among: BoolArray | None = None
) -> BoolArray:
    """Return which intervals the slave's log covers without a gap, shape (k,).

    `delay`: the delay [s]; `among` (k,): those that may be used, None for all.
    """
    time = slave.increments.time
    a, b = turns.start - delay, turns.end - delay
    ok = (a >= time[0]) & (b <= time[-1])
    if among is not None:
        ok &= among
    if len(slave.cuts):
        # From the end of one interval to the beginning of the next: no epoch may lie in between.
        ok &= np.searchsorted(slave.cuts, a, side="right") == np.searchsorted(slave.cuts, b)
    return np.asarray(ok)
