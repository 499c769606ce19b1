"""Deflection: gyros on dither springs whose input axes bend under specific force.

The input axis of gyro i bends towards axis j by an angle that is proportional to the specific
force, and the gyro feels so much of the rate about j::

    D_ij(f) = T_ijk f_k,     r = (I + S_g + M_g + D(f)) w

The body moves far more slowly than the spring rings, so that the bending follows the force
without delay. Of the 27 numbers T_ijk the 18 with j unlike i are bendings; they are the
coefficients ``gyro.deflection.ijk``. How a dither wheel is made ties them together: a *model* says
``T = sum_p theta_p B_p`` with a constant B and fewer parameters. With j and k the axes that
follow i in a circle (x, y, z, x), and c = -1 or 1 for the sense of the wheel's spokes:

coupled6
    D_ij = a f_j + c b f_k,  D_ik = b f_k - c a f_j: what bends along the force bends across it
    as much, so that for a = b the wheel has no preferred direction;
direct6
    the same without what bends across the force;
direct6+transverse3
    the same with a size of its own for it, alike in both directions;
lateral3+axial6
    D_ij = l f_j + m f_i,  D_ik = l f_k + n f_i: a wheel as stiff in both directions;
direct12
    direct6 and the six from force along the input axis;
general18
    all of them;
symmetric6
    coupled6 with plus signs throughout. No wheel with spokes does so; it is here because the
    printed equations of the source do not tell, and one combination of it leaves no tilt.

**After whole turns** about a level axis through the angle theta at the gravity g, with u the
direction of this axis in the body, the attitude has turned (in the sense of psi and phi, estimate
against truth) about the axis itself and about up by::

    phi_N = 0,  phi_E = theta (g / 2) u' S u,     axis north
    phi_E = 0,  phi_N = -theta (g / 2) u' S u,    axis east
    phi_U = -theta (g / 2) (T_iji u_j - T_ijk u_i u_j u_k),    S_jm = e_ikm T_ijk

A quadratic form has six coefficients, so that no more than six combinations tilt.

What a gyro's scale factor does that no straight line does: asymmetry and non-linearity.

The rate that a gyro senses, ``r = (I + S_g + M_g) w``, is the input of its readout. The readout
answers, each axis by itself::

    y = r + a |r| + c r^3

The scale factor is that of the straight line times ``1 + a`` for positive and ``1 - a`` for
negative rates, so that the asymmetry a is half the difference of the two as a fraction of their
mean (IEEE Std 528 and 647 call the whole difference so). The cubic term c is the non-linearity
that is alike in both senses; a term in r^2 is not told from the asymmetry by a few rates, and the
even part is left to a alone.

Accelerometers that scale unlike in their two senses answer so too, without the cubic term.

r belongs to the instrument whatever axes w is written in, so the terms survive a change of axes or
of gauge without approximation.

References
----------
.. [1] Wu, Chen, Yan, Yuan, Guan, "Calibration and compensation of gyro sensitive-axis deflection
   under continuous rotation", Navigation and Control 2023(5), eqs. (1)-(12), (20)-(26).
.. [2] IEEE Std 528-2019 (scale factor, asymmetry, linearity error), IEEE Std 647-2006, annex A.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import Coefficient, CoefficientVector, Layout
from foucault.errors import error, suggestion
from foucault.models.imu_layout import BENDINGS, LAYOUT
from foucault.tables import AXES

GENERAL = tuple(f"gyro.deflection.{''.join(bending)}" for bending in BENDINGS)
"""Names of the 18 coefficients of T."""

_AT = tuple(tuple(AXES.index(a) for a in bending) for bending in BENDINGS)

# Parameter -> what it adds to T: the roles of (gyro, direction, force) and a factor. i is the gyro,
# j and k the two axes after it; a factor "c" is the chirality, "-c" its opposite.
_Terms = tuple[tuple[str, str], ...]
_ALONG: dict[str, _Terms] = {"ijj": (("ijj", "1"),), "ikk": (("ikk", "1"),)}
_AXIAL: dict[str, _Terms] = {"iji": (("iji", "1"),), "iki": (("iki", "1"),)}
_ACROSS: dict[str, _Terms] = {"ijk": (("ijk", "1"),), "ikj": (("ikj", "1"),)}
_MODELS: dict[str, dict[str, _Terms]] = {
    "coupled6": {
        "ijj": (("ijj", "1"), ("ikj", "-c")),
        "ikk": (("ikk", "1"), ("ijk", "c")),
    },
    "direct6": _ALONG,
    "direct6+transverse3": {**_ALONG, "transverse.i": (("ijk", "c"), ("ikj", "-c"))},
    "lateral3+axial6": {"lateral.i": (("ijj", "1"), ("ikk", "1")), **_AXIAL},
    "direct12": {**_ALONG, **_AXIAL},
    "general18": {**_ALONG, **_AXIAL, **_ACROSS},
    "symmetric6": {
        "ijj": (("ijj", "1"), ("ikj", "1")),
        "ikk": (("ikk", "1"), ("ijk", "1")),
    },
}

MODELS = tuple(_MODELS)
"""Names of the models."""


def bending(T: FloatArray, f_b: FloatArray) -> FloatArray:
    """Return D(f), shape (..., 3, 3) [rad].

    `T` (3, 3, 3) or (..., 3, 3, 3): gyro, direction, axis of the specific force [rad/(m/s^2)];
    `f_b` (..., 3): specific force [m/s^2].
    """
    if T.ndim > 3:  # one for every specific force
        return np.asarray(np.einsum("...ijk,...k->...ij", T, f_b))
    return np.asarray((f_b @ T.reshape(9, 3).T).reshape(*f_b.shape[:-1], 3, 3))


def felt(T: FloatArray, f_b: FloatArray, w_ib_b: FloatArray) -> FloatArray:
    """Return D(f) w, what the gyros feel because they bend, shape (..., 3) [rad/s].

    `T` (..., 3, 3, 3): gyro, direction, axis of the specific force [rad/(m/s^2)]; `f_b` (..., 3):
    specific force [m/s^2]; `w_ib_b` (..., 3): rate [rad/s].
    """
    products = w_ib_b[..., :, None] * f_b[..., None, :]
    flat = T.reshape(*T.shape[:-2], 9)
    return np.asarray(products.reshape(*products.shape[:-2], 9) @ np.swapaxes(flat, -1, -2))


@dataclass(frozen=True)
class DeflectionModel:
    """How a few parameters make the 18 coefficients of deflection."""

    name: str
    chirality: int  # -1 or 1: the sense of the spokes [1]
    layout: Layout
    basis: FloatArray  # (p, 3, 3, 3) B: what one unit of each parameter adds to T [1]

    def __len__(self) -> int:
        return len(self.layout)

    def tensor(self, theta: FloatArray) -> FloatArray:
        """Return T, shape (3, 3, 3) [rad/(m/s^2)].

        `theta` (p,): the parameters [rad/(m/s^2)].
        """
        return np.asarray(np.tensordot(theta, self.basis, 1))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Those of `GENERAL` that the model does not say to be zero."""
        return tuple(
            name
            for name, (i, j, k) in zip(GENERAL, _AT, strict=True)
            if self.basis[:, i, j, k].any()
        )

    @cached_property
    def slope(self) -> FloatArray:
        """Derivative of the coefficients `names` by the parameters, shape (len(names), p) [1]."""
        at = [_AT[GENERAL.index(name)] for name in self.names]
        return np.array([self.basis[:, i, j, k] for i, j, k in at])

    def general(self, vector: CoefficientVector) -> CoefficientVector:
        """Put the coefficients `names` in the place of the parameters; nothing else changes.

        What comes out needs no model to be applied: `models.imu` knows every name. Its
        covariance is singular where the model has fewer parameters than coefficients.

        `vector`: parameters of this model and whatever else was estimated with them [SI].
        """
        mine = np.array([vector.layout.index(name) for name in self.layout.names])
        rest = np.setdiff1d(np.arange(len(vector)), mine)
        before = int(np.count_nonzero(rest < mine.min()))
        new = slice(before, before + len(self.names))
        J = np.zeros((len(rest) + len(self.names), len(vector)))
        J[np.r_[: new.start, new.stop : len(J)], rest] = 1.0
        J[new, mine] = self.slope
        c = vector.layout.coefficients
        layout = Layout((
            *(c[i] for i in rest[:before]),
            *LAYOUT.subset(self.names).coefficients,
            *(c[i] for i in rest[before:]),
        ))  # fmt: skip
        # No prior (inf) on a parameter is none on what it makes.
        variance = (
            np.where(J != 0.0, J**2, 0.0)
            @ np.where(np.isfinite(vector.prior_sd), vector.prior_sd, 0.0) ** 2
        )
        open_ = (J[:, ~np.isfinite(vector.prior_sd)] != 0.0).any(axis=1)
        return CoefficientVector(
            layout,
            J @ vector.values,
            None if vector.cov is None else J @ vector.cov @ J.T,
            (J[:, vector.free] != 0.0).any(axis=1),
            np.where(open_, np.inf, np.sqrt(variance)),
        )


def deflection_model(name: str, chirality: int = -1) -> DeflectionModel:
    """Return a model.

    `chirality`: -1 as in the source, or 1: the sense of the spokes. It is a matter of the
    hardware [1].
    """
    if name not in _MODELS:
        raise error(
            "deflection.model", name=name, hint=suggestion(name, MODELS), allowed=", ".join(MODELS)
        )
    if chirality not in (-1, 1):
        raise error("deflection.chirality", given=chirality)
    factor = {"1": 1.0, "c": float(chirality), "-c": float(-chirality)}
    coefficients, basis = [], []
    for i in range(3):
        role = {"i": i, "j": (i + 1) % 3, "k": (i + 2) % 3}
        for label, terms in _MODELS[name].items():
            B = np.zeros((3, 3, 3))
            for where, weight in terms:
                B[tuple(role[r] for r in where)] = factor[weight]
            coefficients.append(_parameter(label, role))
            basis.append(B)
    return DeflectionModel(name, chirality, Layout(tuple(coefficients)), np.array(basis))


def _parameter(label: str, role: dict[str, int]) -> Coefficient:
    kind, _, _ = label.rpartition(".")
    if kind:
        a = AXES[role["i"]]
        way = {"lateral": "towards", "transverse": "at right angles to"}[kind]
        meaning = f"gyro {a}: angle its input axis bends {way} a specific force across it"
        return Coefficient(f"deflection.{kind}.{a}", f"t_{kind[0]}{a}", "deflection", meaning)
    i, j, k = (AXES[role[r]] for r in label)
    return replace(
        LAYOUT.coefficients[LAYOUT.index(f"gyro.deflection.{i}{j}{k}")],
        name=f"deflection.{i}{j}{k}",
    )


NEWTON_STEPS = 30
"""More than are ever needed where the readout has an inverse: 4 to 6 are usual [1]."""


def readout(r: FloatArray, asymmetry: FloatArray, cubic: FloatArray) -> FloatArray:
    """Return ``r + a |r| + c r^3``, shape (..., 3) [rad/s].

    `r` (..., 3): rate sensed [rad/s]; `asymmetry` (3,): a, each axis [1]; `cubic` (3,): c, each
    axis [1/(rad/s)^2].
    """
    return np.asarray(r + asymmetry * np.abs(r) + cubic * r**3)


def readout_slope(r: FloatArray, asymmetry: FloatArray, cubic: FloatArray) -> FloatArray:
    """Return the derivative of `readout`, ``1 + a sign(r) + 3 c r^2``, shape (..., 3) [1].

    `r` (..., 3): rate sensed [rad/s]; `asymmetry` (3,): a, each axis [1]; `cubic` (3,): c, each
    axis [1/(rad/s)^2].
    """
    return np.asarray(1.0 + asymmetry * np.sign(r) + 3.0 * cubic * r**2)


def sensed(y: FloatArray, asymmetry: FloatArray, cubic: FloatArray) -> FloatArray:
    """Solve `readout` for r, exact to rounding, shape (..., 3) [rad/s].

    Newton's method on one side of zero, where the answer is ``k r + c r^3`` with
    ``k = 1 + a sign(y)``: from ``y / k`` it goes to the root without passing it.

    `y` (..., 3): readings without bias and g-sensitivity [rad/s]; `asymmetry` (3,): a, each axis,
    less than 1 in size [1]; `cubic` (3,): c, each axis [1/(rad/s)^2].

    With c < 0 the readout turns back at ``r^2 = -k / (3 c)``; no reading beyond has an inverse.
    """
    k = 1.0 + asymmetry * np.sign(y)
    r = np.asarray(y / k)
    if not cubic.any():
        return r
    for _ in range(NEWTON_STEPS):
        step = (k * r + cubic * r**3 - y) / (k + 3.0 * cubic * r**2)
        r = r - step
        if np.max(np.abs(step), initial=0.0) <= 4e-16 * np.max(np.abs(r), initial=1.0):
            break
    return r
