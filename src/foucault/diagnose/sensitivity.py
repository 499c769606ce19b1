"""How each output changes with each state along time, and when a coefficient is seen.

The curves are d(output)/d(state) as any linearised simulation or filter gives them. With white
noise on the outputs, their squares over its variance are the rate at which information comes in.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import Layout
from foucault.diagnose.information import Information


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives of the outputs by the states along time.

    Attributes
    ----------
    time : ndarray, shape (k,)
        Time of each sample [s].
    layout : Layout
        The states.
    outputs : tuple of str
        Names of the outputs.
    slopes : ndarray, shape (k, m, n)
        d(output)/d(state) at each sample [unit of the output / SI unit of the state].
    """

    time: FloatArray
    layout: Layout
    outputs: tuple[str, ...]
    slopes: FloatArray

    def pick(self, states: Iterable[str], outputs: Iterable[str] | None = None) -> Sensitivity:
        """Return the curves of some states, or groups of states such as ``gyro.drift``.

        Parameters
        ----------
        states : iterable of str
            Names or groups; unknown ones raise with a suggestion.
        outputs : iterable of str or None
            Names of outputs; None for all.
        """
        columns = [i for name in states for i in self.layout.group(name).tolist()]
        rows = [self.outputs.index(o) for o in (self.outputs if outputs is None else outputs)]
        return Sensitivity(
            self.time,
            Layout(tuple(self.layout.coefficients[i] for i in columns)),
            tuple(self.outputs[i] for i in rows),
            self.slopes[:, rows][:, :, columns],
        )

    def thinned(self, most: int = 1000) -> Sensitivity:
        """Return at most `most` samples at even steps, for figures; first and last stay.

        Parameters
        ----------
        most : int, shape ()
            Largest number of samples, at least 2 [1].
        """
        if len(self.time) <= most:
            return self
        keep = np.linspace(0, len(self.time) - 1, most).round().astype(np.intp)
        return replace(self, time=self.time[keep], slopes=self.slopes[keep])

    def times(self, factors: FloatArray) -> Sensitivity:
        """Return the curves per other units of the states, such as per prior.

        Parameters
        ----------
        factors : ndarray, shape (n,)
            Size of each new unit [SI unit of the state].
        """
        return replace(self, slopes=self.slopes * np.asarray(factors))

    def share(self, noise_sd: FloatArray | float = 1.0) -> FloatArray:
        """Return the part of each state's information that has come in, shape (k, n) [1].

        This is information about a state when all others are known; zero where none comes.

        Parameters
        ----------
        noise_sd : ndarray, shape (m,), or float
            Standard deviation of the white noise of each output [unit of the output].
        """
        white = self.slopes / np.asarray(noise_sd, float)[..., None]
        total = np.cumsum(np.sum(white**2, axis=1), axis=0)
        return np.asarray(total / np.where(total[-1] > 0, total[-1], 1.0))

    def when(self, share: float = 0.5, noise_sd: FloatArray | float = 1.0) -> FloatArray:
        """Return when each state's information reaches a share, shape (n,), NaN if never [s].

        Parameters
        ----------
        share : float
            Part of the information of the whole, above 0 to 1 [1].
        noise_sd : ndarray, shape (m,), or float
            Standard deviation of the white noise of each output [unit of the output].
        """
        # The last of a sum is 1 only to rounding.
        reached = self.share(noise_sd) >= share * (1 - 1e-12)
        first = self.time[np.argmax(reached, axis=0)]
        return np.where(reached.any(axis=0), first, np.nan)

    def information(self, noise_sd: FloatArray | float = 1.0) -> Information:
        """Return the information of all samples about the states.

        Parameters
        ----------
        noise_sd : ndarray, shape (m,), or float
            Standard deviation of the white noise of each output [unit of the output].
        """
        white = self.slopes / np.asarray(noise_sd, float)[..., None]
        n = len(self.layout)
        root = np.linalg.qr(white.reshape(-1, n), mode="r")
        return Information(self.layout, np.pad(root, ((0, n - len(root)), (0, 0))))
