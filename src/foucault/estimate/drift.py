"""Did a coefficient drift during the session: residuals against time.

With white residuals r of a solution and its Jacobian J, a coefficient that changed in proportion to
time, by d from the first observation to the last, adds ``d c`` to the residuals, where c is the
coefficient's column of J times the time of each row, from -1/2 to 1/2. With c' the part of c that
the unknowns do not explain::

    d = c'.r / c'.c'        t = d |c'| / s

and t has Student's distribution, s the root mean square of what the drift leaves of the residuals:
scatter that was fitted to a drift does not hide it.

References
----------
.. [1] R. D. Cook, S. Weisberg, *Residuals and Influence in Regression*, Chapman and Hall, 1982,
   section 2.4 (added variables).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from foucault.estimate.chi_square import FALSE_ALARM
from foucault.result import Linearised
from foucault.tables import AXES

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

SHOWN = 1e-4
"""A drift of which less than this share shows in the residuals is not tested [1]."""

LITTLE = 0.01
"""A kind of observation with less than this share in a drift does not count [1]."""

ENOUGH = 3.0
"""With fewer degrees of freedom besides it a drift is not told from chance [1]."""


@dataclass(frozen=True)
class Drift:
    """The drift that the residuals show most clearly.

    Attributes
    ----------
    name : str
        The coefficient, or accel.scale or gyro.scale for all three alike.
    size, sd : float
        How much it changed from the first observation to the last [SI].
    dof : float
        Degrees of freedom that the sd was found from [1].
    limit : float
        `ratio` that chance allows for the largest of all [1].
    """

    name: str
    size: float
    sd: float
    dof: float
    limit: float = np.inf

    @property
    def ratio(self) -> float:
        """The drift over its sd, without sign [1]."""
        return abs(self.size) / self.sd

    @property
    def significant(self) -> bool:
        """Whether it is more than chance."""
        return self.ratio > self.limit


def by_time(time: FloatArray) -> FloatArray:
    """Return the time of each observation from -1/2, the first, to 1/2, the last, shape (k,) [1].

    Parameters
    ----------
    time : ndarray, shape (k,)
        Middle of each observation [s].
    """
    span = float(np.ptp(time))
    return np.asarray((time - time.min()) / span - 0.5) if span > 0 else np.zeros(len(time))


def find_drift(
    at: Linearised,
    names: Sequence[str],
    time: FloatArray,
    *,
    kinds: IntArray | None = None,
    candidates: FloatArray | None = None,
) -> Drift | None:
    """Look for the coefficient whose drift explains the residuals best.

    Parameters
    ----------
    at : Linearised
        The problem linearised at its solution, everything that was estimated in its columns.
    names : sequence of str, length p
        The coefficients, its first columns.
    time : ndarray, shape (blocks,)
        Middle of each observation [s].
    kinds : ndarray of int, shape (blocks,), or None
        Kind of each observation, which has a scatter of its own; None for one kind.
    candidates : ndarray, shape (m, p), or None
        What a drift of each coefficient does to the white residuals, where whitening mixes
        observations; None: each row of `at` times its time.

    Returns
    -------
    Drift or None
        None where nothing would show.
    """
    from scipy.special import stdtrit

    used = at.blocks >= 0
    moment = np.where(used, by_time(time)[at.blocks], 0.0)
    c = at.jacobian[:, : len(names)] * moment[:, None] if candidates is None else candidates
    what = list(names)
    for family in ("accel.scale", "gyro.scale"):  # what warms up changes all three alike
        mine = [k for k, name in enumerate(names) if name.startswith(f"{family}.")]
        if len(mine) == len(AXES):
            what.append(family)
            c = np.column_stack([c, c[:, mine].sum(axis=1)])
    size = np.linalg.norm(at.jacobian, axis=0)
    basis, s, _ = np.linalg.svd(at.jacobian[:, size > 0] / size[size > 0], full_matrices=False)
    basis = basis[:, s > 1e-10 * s.max(initial=0.0)]
    left = c - basis @ (basis.T @ c)
    r = at.residuals - basis @ (basis.T @ at.residuals)
    free = 1 - np.sum(basis**2, axis=1)
    kind = np.zeros(len(time), int) if kinds is None else kinds
    kind = np.where(used, kind[at.blocks], -1)
    square = np.sum(left**2, axis=0)
    shown = square > SHOWN * np.maximum(np.sum(c**2, axis=0), 1e-300)
    found: list[Drift] = []
    for k in np.flatnonzero(shown).tolist():
        drift = float(left[:, k] @ r / square[k])
        variance, dof = _variance(left[:, k], r - drift * left[:, k], free, kind)
        if dof >= ENOUGH and variance > 0:
            found.append(Drift(what[k], drift, float(np.sqrt(variance)), dof))
    if not found:
        return None
    alpha = FALSE_ALARM / len(found)
    told = [replace(one, limit=float(-stdtrit(one.dof, alpha / 2))) for one in found]
    return max(told, key=lambda one: one.ratio / one.limit)


def _variance(
    left: FloatArray, rest: FloatArray, free: FloatArray, kind: IntArray
) -> tuple[float, float]:
    """Return the variance of a drift and its degrees of freedom, each kind with its own scatter.

    Several scatters added have the degrees of freedom of Welch and Satterthwaite.
    """
    square = float(left @ left)
    parts, dofs = [], []
    for one in np.unique(kind[kind >= 0]):
        mine = kind == one
        share = float(left[mine] @ left[mine]) / square
        dof = float(np.sum(free[mine])) - share
        if share > LITTLE:
            if dof < 1:
                return 0.0, 0.0
            parts.append(share * float(rest[mine] @ rest[mine]) / dof / square)
            dofs.append(dof)
    total = sum(parts)
    wide = sum(v**2 / dof for v, dof in zip(parts, dofs, strict=True))
    return total, total**2 / wide if wide > 0 else 0.0
