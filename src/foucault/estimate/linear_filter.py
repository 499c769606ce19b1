"""A linear system that is given epoch by epoch: Kalman filter, likelihood, smoother.

::

    x_k = Phi_k x_k-1 + u_k + w_k,    z_k = H_k x_k + v_k

What is linearised about a run that is not corrected on the way (a free run of a navigator, say) is
of this form, and can be filtered again and again, with other noise or another bound, at the cost of
the filter alone. The recursion is `kernels.linear_filter`.

References
----------
.. [1] G. J. Bierman, *Factorization Methods for Discrete Sequential Estimation*, 1977, chapter 10
   (the modified Bryson-Frazier smoother).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from foucault.kernels.linear_filter import linear_filter, linear_smoother

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class LinearSystem:
    """What happens from epoch to epoch, and what is measured.

    Attributes
    ----------
    Phi : ndarray, shape (m, b, n)
        Transition to each epoch from the one before, the first from the start; its rows beyond
        the first b are those of the identity [SI].
    half : ndarray, shape (m, n)
        Half of the variance of the white noise between them, which comes in half before the
        transition and half after [SI].
    H : ndarray, shape (m, q, n)
        Rows of what is measured [SI].
    z : ndarray, shape (m, q)
        What was measured [SI].
    R : ndarray, shape (m, q)
        Its variances; infinite where nothing was [SI].
    x0 : ndarray, shape (n,)
        Expected state at the start [SI].
    P0 : ndarray, shape (n, n)
        Its covariance [SI].
    jump : ndarray, shape (m, b), or None
        u, known steps of the state, which no noise comes with; None for none [SI].
    """

    Phi: FloatArray
    half: FloatArray
    H: FloatArray
    z: FloatArray
    R: FloatArray
    x0: FloatArray
    P0: FloatArray
    jump: FloatArray | None = None


@dataclass(frozen=True)
class LinearRun:
    """What a filter has found, epoch by epoch.

    Attributes
    ----------
    states, sd : ndarray, shape (m, n)
        Estimates after each epoch and their standard deviations [SI].
    innovation, variance : ndarray, shape (m, q)
        Of each measurement; NaN where nothing was measured, a NaN innovation alone where it lay
        beyond the gate [SI].
    predicted : ndarray, shape (m, n) or (0, n)
        Estimates before each epoch, where kept [SI].
    before : ndarray, shape (m, n, n) or (0, n, n)
        Their covariances, where kept [SI].
    cov : ndarray, shape (n, n)
        Covariance at the end [SI].
    margin : ndarray, shape (m,)
        Smallest ``1 - l P l' / gamma^2`` of each epoch; NaN for a Kalman filter [1].
    stopped : int or None
        Epoch at which an H-infinity filter of this gamma ceased to exist; nothing is known from
        there on [1].
    """

    states: FloatArray
    sd: FloatArray
    innovation: FloatArray
    variance: FloatArray
    predicted: FloatArray
    before: FloatArray
    cov: FloatArray
    margin: FloatArray
    stopped: int | None

    @cached_property
    def nis(self) -> FloatArray:
        """Normalised innovation squared of each epoch, shape (m,) [1]."""
        return np.asarray(np.nansum(self.innovation**2 / self.variance, axis=1))

    @property
    def log_likelihood(self) -> float:
        """Of all innovations [1]."""
        taken = np.isfinite(self.innovation)
        e, S = self.innovation[taken], self.variance[taken]
        return float(-0.5 * np.sum(e**2 / S + np.log(2.0 * np.pi * S)))


def given(cov: FloatArray, known: list[int]) -> FloatArray:
    """Return the covariance that is left once some of the states are known exactly.

    Parameters
    ----------
    cov : ndarray, shape (n, n)
        Covariance of all states [SI].
    known : list of int
        Which become known [1].
    """
    if not known:
        return cov
    across, own = cov[:, known], cov[np.ix_(known, known)]
    unit = np.sqrt(np.diag(own))  # states of many units
    gain = np.linalg.solve(own / np.outer(unit, unit), (across / unit).T)
    return np.asarray(cov - (across / unit) @ gain)


def kalman(system: LinearSystem, *, gate: float = np.inf, keep: bool = False) -> LinearRun:
    """Run a Kalman filter.

    Parameters
    ----------
    system : LinearSystem
        The system.
    gate : float, shape ()
        Measurements beyond so many standard deviations are left out [1].
    keep : bool
        Whether what `smoothed` needs is kept.
    """
    return filtered(system, np.zeros((0, len(system.x0))), np.inf, gate=gate, keep=keep)


def filtered(
    system: LinearSystem, L: FloatArray, limit: float, *, gate: float = np.inf, keep: bool = False
) -> LinearRun:
    """Run a filter whose error of ``L x`` stays below a bound, see `estimate.h_infinity`.

    Parameters
    ----------
    system : LinearSystem
        The system.
    L : ndarray, shape (r, n)
        What is wanted [SI].
    limit : float, shape ()
        Square of the bound gamma; infinite for a Kalman filter [1].
    gate : float, shape ()
        Measurements beyond so many standard deviations are left out [1].
    keep : bool
        Whether predictions are kept.
    """
    s = system
    jump = np.zeros(s.Phi.shape[:2]) if s.jump is None else s.jump
    x, sd, innovation, variance, predicted, before, cov, margin, stopped = linear_filter(
        s.Phi, jump, s.half, s.H, s.z, s.R, np.ascontiguousarray(L, float), float(limit),
        float(gate), s.x0, s.P0, keep,
    )  # fmt: skip
    return LinearRun(x, sd, innovation, variance, predicted, before, cov, margin,
                     None if stopped == len(s.Phi) else int(stopped))  # fmt: skip


@dataclass(frozen=True)
class LinearSmoothed:
    """A Kalman run as seen from its end.

    Attributes
    ----------
    states : ndarray, shape (m, n)
        Estimates [SI].
    cov : ndarray, shape (m, n, n)
        Covariances [SI].
    start : ndarray, shape (n,)
        Estimate of the state at the start [SI].
    start_cov : ndarray, shape (n, n)
        Its covariance [SI].
    """

    states: FloatArray
    cov: FloatArray
    start: FloatArray
    start_cov: FloatArray


def smoothed(system: LinearSystem, run: LinearRun) -> LinearSmoothed:
    """Smooth a run of `kalman` made with ``keep=True``.

    Parameters
    ----------
    system : LinearSystem
        The system.
    run : LinearRun
        What the filter found.
    """
    if len(run.before) != len(system.Phi):
        raise ValueError("a run to be smoothed must be made with keep=True")
    states, cov, adjoint, information = linear_smoother(
        system.Phi, system.H, system.R, run.innovation, run.predicted, run.before
    )
    P0 = system.P0
    return LinearSmoothed(states, cov, system.x0 - P0 @ adjoint, P0 - P0 @ information @ P0)
