"""How good a set of positions is, before anything is measured.

The norm of the specific force is known in every position u, and to first order one position gives
one equation for the errors of the accelerometers (bias b in g, matrix I + M, quadratic k)::

    |N| - 1 = u . b + u . M u + sum k_i u_i^3

Where the angles of the table are known, every axis gives an equation of its own::

    N_i - u_i = b_i + M_i . u

With unit noise in every reading the information of a plan is ``J' J``. Its D-efficiency compares
``det(J' J / n)``, per coefficient, with that of directions spread evenly over the sphere.

References
----------
.. [1] A. C. Atkinson, A. N. Donev, R. D. Tobias, *Optimum Experimental Designs, with SAS*, Oxford
   University Press, 2007, chapter 10 (D- and A-efficiency).
.. [2] W. Baarda, *A testing procedure for use in geodetic networks*, 1968 (internal and external
   reliability).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.errors import error, suggestion
from foucault.infer.information import INVISIBLE, Information
from foucault.models.imu import LAYOUT, LINEAR_LOWER
from foucault.plans.directions import spread_outer
from foucault.tables import AXES

_QUADRATIC = tuple(f"accel.quadratic.{a}" for a in AXES)
_LINEAR = tuple(n for n in LINEAR_LOWER if n.startswith("accel."))
_FULL = tuple(
    n for n in LAYOUT.names if n.split(".")[0] == "accel"
    and n.split(".")[1] in ("bias", "scale", "misalignment")
)  # fmt: skip

MODELS: dict[str, tuple[str, ...]] = {
    "accel": _LINEAR,
    "accel quadratic": (*_LINEAR, *_QUADRATIC),
    "accel table": _FULL,
}
"""What a plan can be judged for -> coefficients. The gyros' norm is judged as "accel" is."""

NOTICED = 4.13
"""Size of an error, in sd of its test value, that a test at 0.1 % finds in 80 % of cases [1]."""

NAMED = 0.95
"""Two bad positions whose residuals are alike to more than this cannot be told apart [1]."""


@dataclass(frozen=True)
class Efficiency:
    """What a set of positions can tell of the coefficients of a model.

    All sd are for readings with noise of 1: in ug they are ug of bias, ppm of scale factor, urad
    of misalignment and ug/g^2 of the quadratic terms per ug of noise in one reading.
    """

    model: str  # A key of `MODELS`
    directions: FloatArray  # (n, 3) directions of up, case axes [1]
    information: Information  # of the coefficients of the model [1]
    rows: FloatArray  # (n, p) equations: of the norm, or where angles are known of one axis [1]

    @property
    def names(self) -> tuple[str, ...]:
        """The coefficients."""
        return self.information.layout.names

    @property
    def _axes(self) -> int:
        """Number of axes that have the equations `rows` each."""
        return len(self.names) // int(self.rows.shape[1])

    @property
    def equations(self) -> int:
        """Number of equations [1]."""
        return len(self.rows) * self._axes

    @property
    def redundant(self) -> int:
        """Number of equations beyond those that the coefficients need; never below 0 [1]."""
        return self.equations - self.information.rank

    @property
    def singular(self) -> bool:
        """Whether not all coefficients can be found."""
        return self.information.rank < len(self.names)

    @property
    def log10_det(self) -> float:
        """log10 of the determinant of the information per reading, -inf where singular [1]."""
        if self.singular:
            return float("-inf")
        _, log_det = np.linalg.slogdet(self.rows.T @ self.rows / len(self.rows))
        return float(log_det / np.log(10)) * self._axes

    @property
    def d_efficiency(self) -> float:
        """D-efficiency against the uniform sphere, 0 where singular [1]."""
        if self.singular:
            return 0.0
        return float(10 ** ((self.log10_det - _uniform(self.model)[0]) / len(self.names)))

    @property
    def a_efficiency(self) -> float:
        """Mean variance on the uniform sphere over that of the plan, 0 where singular [1]."""
        if self.singular:
            return 0.0
        return _uniform(self.model)[1] / (float(np.sum(self.sd**2)) * len(self.rows))

    @property
    def sd(self) -> FloatArray:
        """Sd of each coefficient, infinite where it cannot be found, shape (p,) [1]."""
        return self.information.sd

    @cached_property
    def _residuals(self) -> FloatArray:
        """How residuals follow from errors of the readings, shape (n, n)."""
        return np.eye(len(self.rows)) - self.rows @ np.linalg.pinv(self.rows)

    @property
    def share(self) -> FloatArray:
        """Share of the error of each position that its own residual shows, shape (n,) [1]."""
        share = np.diag(self._residuals)
        return np.where(share > INVISIBLE, share, 0.0)

    @property
    def likeness(self) -> float:
        """Largest correlation between the residuals that two bad positions leave [1]."""
        share = self.share
        seen = share > 0
        if seen.sum() < 2:
            return 1.0
        patterns = self._residuals[np.ix_(seen, seen)] / np.sqrt(np.outer(share[seen], share[seen]))
        np.fill_diagonal(patterns, 0.0)
        return float(np.abs(patterns).max())

    @property
    def noticed(self) -> bool:
        """Whether a large error in any one position leaves residuals."""
        return not self.singular and bool((self.share > 0).all())

    @property
    def named(self) -> bool:
        """Whether the residuals also say which position it was."""
        return self.noticed and self.likeness < NAMED

    @property
    def detectable(self) -> FloatArray:
        """Smallest error of each position that would be noticed, infinite if none, shape (n,) [1].

        In noise of one reading: `NOTICED` over the root of `share`.
        """
        with np.errstate(divide="ignore"):
            return np.asarray(NOTICED / np.sqrt(self.share))

    @property
    def influence(self) -> FloatArray:
        """Change of each coefficient of an axis per error of each position, shape (p, n) [1]."""
        return np.asarray(np.linalg.pinv(self.rows))

    @property
    def hidden_shift(self) -> float:
        """Largest shift of a coefficient, over its sd, by an error that goes unnoticed [1]."""
        if not self.noticed:
            return float("inf")
        sd = np.sqrt(np.diag(np.linalg.inv(self.rows.T @ self.rows)))
        return float(np.max(np.abs(self.influence) * self.detectable / sd[:, None]))

    @property
    def reason(self) -> str:
        """Which coefficients cannot be found or told apart, in words; empty where all can."""
        return _unseparated(self.information)

    @property
    def verdict(self) -> str:
        """The plan in one sentence."""
        if self.singular:
            return f"refused: {self.reason}"
        if not self.redundant:
            return "exactly determined: a bad position cannot be noticed"
        if not self.noticed:
            return "an error in some positions cannot be noticed"
        if not self.named:
            return "a bad position is noticed, but not which one it is"
        return "a bad position is noticed and named"


def efficiency(directions: FloatArray, model: str = "accel") -> Efficiency:
    """Judge a set of positions for a model.

    `directions` (n, 3): directions of up, case axes, unit vectors [1].
    """
    known = model_named(model)
    names = MODELS[known]
    rows = _rows(directions, known)
    square = np.kron(np.eye(len(names) // rows.shape[1]), rows)
    if known == "accel table":  # by output axis; the layout has bias, scale, misalignment
        square = square[:, _by_axis(names)]
    root = np.linalg.qr(square, mode="r")
    padded = np.zeros((len(names), len(names)))
    padded[: len(root)] = root
    layout = LAYOUT.subset(names)
    order = [names.index(n) for n in layout.names]
    return Efficiency(known, directions, Information(layout, padded[:, order]), rows)


def model_named(name: str) -> str:
    """Return the key of `MODELS` that `name` means, however it is joined."""
    known = " ".join(name.lower().replace("-", " ").replace("_", " ").split())
    if known not in MODELS:
        raise error(
            "plan.model", name=name, hint=suggestion(known, MODELS), allowed=", ".join(MODELS)
        )
    return known


def refuse_singular(plan: str, directions: FloatArray, model: str = "accel") -> Efficiency:
    """Judge a set of positions and refuse one that cannot determine the model.

    `directions` (n, 3): directions of up, case axes, unit vectors [1]. Raises ``plan.too_few``
    and ``plan.singular``.
    """
    found = efficiency(directions, model)
    words = {"plan": plan, "n": len(directions), "reason": found.reason}
    if found.equations < len(found.names):
        raise error("plan.too_few", equations=found.equations, needed=len(found.names), **words)
    if found.singular:
        raise error("plan.singular", **words)
    return found


def _rows(u: FloatArray, model: str) -> FloatArray:
    """Return the equations: of the norm, or of one axis where the angles are known."""
    x, y, z = u.T
    if model == "accel table":
        return np.stack([np.ones(len(u)), x, y, z], axis=1)
    columns = {f"accel.bias.{a}": u[:, i] for i, a in enumerate(AXES)}
    columns |= {f"accel.scale.{a}": u[:, i] ** 2 for i, a in enumerate(AXES)}
    columns |= {f"accel.quadratic.{a}": u[:, i] ** 3 for i, a in enumerate(AXES)}
    columns |= {f"accel.misalignment.{n}": v for n, v in zip(
        ("yx", "zx", "zy"), (x * y, x * z, y * z), strict=True
    )}  # fmt: skip
    return np.stack([columns[n] for n in MODELS[model]], axis=1)


def _by_axis(names: tuple[str, ...]) -> list[int]:
    """Return, for each name, its column among (bias, by x, by y, by z) of x, then y, then z."""
    out = []
    for name in names:
        _, what, where = name.split(".")
        axis, inputs = AXES.index(where[0]), AXES.index(where[-1])
        out.append(4 * axis + (0 if what == "bias" else 1 + inputs))
    return out


def _uniform(model: str) -> tuple[float, float]:
    """Return log10 det and trace of the inverse of the information on the uniform sphere."""
    z, weight = np.polynomial.legendre.leggauss(8)  # exact for the sixth powers of the rows
    azimuth = spread_outer(16)
    across = np.sqrt(1 - z**2)[:, None]
    u = np.stack(
        [across * np.cos(azimuth), across * np.sin(azimuth), np.broadcast_to(z[:, None], (8, 16))],
        axis=2,
    ).reshape(-1, 3)
    rows = _rows(u, model)
    M = (rows * np.repeat(weight / 32, 16)[:, None]).T @ rows
    axes = len(MODELS[model]) // len(M)
    log_det = float(np.linalg.slogdet(M)[1] / np.log(10))
    return axes * log_det, axes * float(np.trace(np.linalg.inv(M)))


def _unseparated(information: Information) -> str:
    """Say which coefficients are not seen, and which cannot be told from one another."""
    names, root = information.layout.names, information.root
    size = np.linalg.norm(root, axis=0)
    unseen = size <= INVISIBLE * max(float(size.max()), 1e-300)
    scaled = root / np.where(unseen, 1.0, size)
    _, s, Vt = np.linalg.svd(scaled)
    null = Vt[s <= INVISIBLE * max(float(s[0]), 1e-300)]
    linked = np.abs(null.T @ null) > 1e-9
    parts = [f"no position shows {_listed(names, np.flatnonzero(unseen))}"] if unseen.any() else []
    left = set(np.flatnonzero(linked.diagonal() & ~unseen).tolist())
    while left:
        group, grown = {min(left)}, set[int]()
        while grown != group:
            grown = set(group)
            group |= {j for i in grown for j in np.flatnonzero(linked[i]).tolist()} & left
        left -= group
        parts.append(f"{_listed(names, sorted(group))} cannot be told apart")
    return "; ".join(parts)


def _listed(names: tuple[str, ...], which: npt.ArrayLike) -> str:
    words = [names[i] for i in np.asarray(which).tolist()]
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
