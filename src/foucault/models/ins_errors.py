"""How errors of attitude, velocity, position and sensors make one another: the psi-angle equations.

Frame l is the level frame of the *computed* position (East-North-Up turned about up by the wander
angle). Errors are estimate minus truth; that of the attitude is a rotation of the computed
attitude against the Earth, ``C_lb_est = (I - [psi x]) C_lb_true``; velocity and position errors are
resolved in l::

    psi' = -w_il x psi - C_lb u_g
    dv'  = f_l x psi - (2 w_ie + w_el) x dv + C_lb u_a + (g / R) diag(-1, -1, 2) dr
    dr'  = dv - w_el x dr

with u_g, u_a the errors of the readings, measured minus true. Nothing in them grows near a pole,
and psi does not depend on velocity or position. What users see as errors of the attitude, velocity
and heading at a place is relative to that place; with the tilt of the level frame by a wrong
position, theta = (-dr_y, dr_x, 0) / R, it is::

    phi = psi + theta,      v_est - v_true = dv - theta x v

A sensor error is a sum of *terms*: coefficient times an input (1, a rate, a specific force, a
product of them) on one output axis. `Sensors` takes any coefficients of `models.imu` and knows
their terms as numbers, so that no kernel knows a name. Why terms, and why psi in a wander frame:
design/README.md.

References
----------
.. [1] D. O. Benson, "A comparison of two approaches to pure-inertial and Doppler-inertial error
   analysis", *IEEE Trans. AES* 11 (1975) 447-455 (psi and phi).
.. [2] P. D. Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems*, 2nd ed., 2013, section 14.2.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray, IntArray
from foucault.coefficients import Coefficient, Layout, coefficients_of
from foucault.errors import error
from foucault.models.deflection import DeflectionModel
from foucault.models.earth import EARTH_RATE
from foucault.models.imu import LAYOUT, coefficient_slot
from foucault.models.noise import ImuNoise
from foucault.models.rotation import cross_matrix
from foucault.tables import AXES

STATES = Layout(coefficients_of("navigation"))
"""The nine errors of navigation; east and north are the axes of frame l."""

# Where the inputs of a term begin in the vector that the kernels make (`kernels.ins_transition`).
ONE, RATE, FORCE, PRODUCT, SIZE_OF_RATE, RATE_CUBED = 0, 1, 4, 7, 13, 16
SIZE_OF_FORCE, FORCE_BY_RATE, TIME = 19, 22, 43
_INPUTS = {
    "accel_matrix": FORCE, "accel_quadratic": PRODUCT,
    "gyro_matrix": RATE, "g_sensitivity": FORCE,
}  # fmt: skip
_OWN_AXIS = {
    "gyro_asymmetry": SIZE_OF_RATE, "gyro_cubic": RATE_CUBED, "accel_asymmetry": SIZE_OF_FORCE,
}  # fmt: skip

TURN_ON = "turn_on_"
"""Groups of what biases differ by from one switch-on to the next begin so."""


@dataclass(frozen=True)
class Sensors:
    """Coefficients of the error model of an IMU, as terms. Gyro coefficients come first."""

    layout: Layout
    coefficient: IntArray  # (t,) number of the coefficient of each term [1]
    axis: IntArray  # (t,) output: gyro x, y, z 0 to 2, accelerometer x, y, z 3 to 5; it rises [1]
    entry: IntArray  # (t,) input, numbered as in `kernels.ins_transition` [1]
    weight: FloatArray  # (t,) factor [1]

    @classmethod
    def of(cls, names: Iterable[str]) -> Sensors:
        """Return the terms of coefficients of `models.imu.LAYOUT`.

        `names`: names or groups of them ("gyro.bias"), unknown ones raise with a suggestion.
        """
        rows = np.unique(np.concatenate([[], *(LAYOUT.group(name) for name in names)]).astype(int))
        wanted = [LAYOUT.names[i] for i in rows]
        wanted.sort(key=lambda name: not name.startswith("gyro."))
        terms = [_term(name) for name in wanted]
        axis = np.array([t[0] for t in terms], np.int64)
        entry = np.array([t[1] for t in terms], np.int64)
        return cls(LAYOUT.subset(wanted), np.arange(len(terms), dtype=np.int64), axis, entry,
                   np.ones(len(terms)))  # fmt: skip

    def __len__(self) -> int:
        return len(self.layout)

    def with_deflection(self, model: DeflectionModel) -> Sensors:
        """Return these coefficients and the parameters of a model of deflection.

        `model`: its parameters follow the other coefficients of the gyros,
        `DeflectionModel.general` turns what is found of them into coefficients of
        `models.imu.LAYOUT`. Raises the coefficients bend the gyros already: a parameter would be
        one of them again.
        """
        twice = [n for n in self.layout.names if n.startswith(("gyro.deflection.", "deflection."))]
        if twice:
            raise error("deflection.twice", name=model.name, given=", ".join(twice[:3]))
        which, out, direction, force = np.nonzero(model.basis)
        c = self.layout.coefficients
        start, terms = self.gyros, int(np.sum(self.axis < 3))
        later = np.where(self.axis < 3, 0, len(model))

        def joined(mine: npt.NDArray[Any], new: Any) -> npt.NDArray[Any]:
            return np.concatenate([mine[:terms], new, mine[terms:]])

        return Sensors(
            Layout((*c[:start], *model.layout.coefficients, *c[start:])),
            joined(self.coefficient + later, start + which),
            joined(self.axis, out),
            joined(self.entry, FORCE_BY_RATE + 3 * force + direction),
            joined(self.weight, model.basis[which, out, direction, force]),
        )

    def with_wander(self, noise: ImuNoise) -> Sensors:
        """Return these coefficients and the part of the biases that wanders, where there is one.

        ``gyro.wander`` and ``accel.wander`` are first-order Markov processes beside the constant
        biases, which are then what the readings have in the long term.

        `noise`: noise of the triads [SI].
        """
        slow = {"gyro": noise.gyro, "accel": noise.accel}
        triads = tuple(name for name, triad in slow.items() if triad.bias_instability > 0)
        return self._with_biases("wander", "m", "what the bias of {} wanders by", triads)

    def with_drift(self, groups: Iterable[str]) -> Sensors:
        """Return these coefficients and the drift of some, end minus start of the log.

        ``drift.gyro.bias.x`` adds to the readings what the coefficient does, from -1/2 of it at the
        start of the increments to 1/2 at their end.

        `groups`: of biases and of scale factors that are among these coefficients.
        """
        mine, out = self.layout.names, self
        names = [n for g in groups for n in mine if n.startswith(f"{g}.")]
        for name in names:
            at, c = mine.index(name), self.layout.coefficients[mine.index(name)]
            drift = replace(c, name=f"drift.{name}", symbol=f"d{c.symbol}",
                            meaning=f"{c.meaning}, end minus start")  # fmt: skip
            some = self.coefficient == at
            entry = self.entry[some]
            later = np.where(entry == ONE, TIME, TIME + entry)  # r, r w and r f
            out = out._with_one(drift, self.axis[some], later, self.weight[some])
        return out

    def with_gravity(self, gravity: float) -> Sensors:
        """Return these coefficients and an error of local gravity.

        An instrument that stays where it is feels nothing else: all that the accelerometers read is
        too large by the same share.

        `gravity`: what is taken for it [m/s^2].
        """
        error = Coefficient("site.gravity", "dg", "gravity", "local gravity less what was taken")
        return self._with_one(error, np.arange(3, 6), np.arange(FORCE, FORCE + 3),
                              np.full(3, 1.0 / gravity))  # fmt: skip

    def _with_one(
        self, c: Coefficient, axis: IntArray, entry: IntArray, weight: FloatArray
    ) -> Sensors:
        """Return these coefficients and one more, the last of the gyros' or of all."""
        gyro, all_of = bool(axis[0] < 3), self.layout.coefficients
        at = self.gyros if gyro else len(self)
        before = int(np.sum(self.axis < 3)) if gyro else len(self.axis)

        def joined(mine: npt.NDArray[Any], new: Any) -> npt.NDArray[Any]:
            return np.concatenate([mine[:before], new, mine[before:]]).astype(mine.dtype)

        return Sensors(
            Layout((*all_of[:at], c, *all_of[at:])),
            joined(self.coefficient + (self.coefficient >= at), np.full(len(axis), at)),
            joined(self.axis, axis), joined(self.entry, entry), joined(self.weight, weight),
        )  # fmt: skip

    def with_turn_on(self, count: int) -> Sensors:
        """Return these coefficients and what the biases of each recording differ by from theirs.

        ``gyro.turn_on_1`` and so on are constants beside the biases; see `during`.

        `count`: number of recordings [1].
        """
        out = self
        for k in range(1, count + 1):
            words = f"what the bias of {{}} differs by in recording {k}"
            out = out._with_biases(f"{TURN_ON}{k}", f"e{k}", words)
        return out

    def during(self, recording: int) -> Sensors:
        """Return the terms as they are in one recording: the biases of others are not in it.

        `recording`: its number, from 0 [1].
        """
        if not self.turned_on.any():
            return self
        mine = np.array([n.split(".")[1] == f"{TURN_ON}{recording + 1}" for n in self.layout.names])
        out = (self.turned_on & ~mine)[self.coefficient]
        return replace(self, weight=np.where(out, 0.0, self.weight))

    def _with_biases(
        self, group: str, symbol: str, words: str, triads: tuple[str, ...] = ("gyro", "accel")
    ) -> Sensors:
        """Return these coefficients and others that act as biases of some triads."""
        start, terms = self.gyros, int(np.sum(self.axis < 3))
        c, parts = self.layout.coefficients, []
        g, a = (range(3 * (triad in triads)) for triad in ("gyro", "accel"))
        for number, triad in ((g, "gyro"), (a, "accel")):
            kind = {"gyro": "angular rate", "accel": "specific force"}[triad]
            parts.append([
                Coefficient(f"{triad}.{group}.{AXES[i]}", f"{symbol}_{triad[0]}{AXES[i]}", kind,
                            words.format(f"{triad} {AXES[i]}"))
                for i in number
            ])  # fmt: skip

        def joined(mine: npt.NDArray[Any], gyro: Any, accel: Any) -> npt.NDArray[Any]:
            return np.concatenate([mine[:terms], gyro, mine[terms:], accel]).astype(mine.dtype)

        later = np.where(self.axis < 3, 0, len(g))
        one = [ONE] * len(g), [ONE] * len(a)
        return Sensors(
            Layout((*c[:start], *parts[0], *c[start:], *parts[1])),
            joined(self.coefficient + later, [start + i for i in g],
                   [len(self) + len(g) + i for i in a]),
            joined(self.axis, list(g), [3 + i for i in a]),
            joined(self.entry, *one),
            joined(self.weight, np.ones(len(g)), np.ones(len(a))),
        )  # fmt: skip

    def without(self, which: npt.NDArray[np.bool_]) -> Sensors:
        """Return these coefficients without some.

        `which` (p,): those left out.
        """
        kept = ~which[self.coefficient]
        number = np.cumsum(~which) - 1
        names = [n for n, out in zip(self.layout.names, which, strict=True) if not out]
        return Sensors(self.layout.subset(names), number[self.coefficient[kept]], self.axis[kept],
                       self.entry[kept], self.weight[kept])  # fmt: skip

    @cached_property
    def wanders(self) -> npt.NDArray[np.bool_]:
        """Which of the coefficients are the wandering part of a bias, shape (p,)."""
        return np.array([n.split(".")[1] == "wander" for n in self.layout.names], bool)

    @cached_property
    def turned_on(self) -> npt.NDArray[np.bool_]:
        """Which of the coefficients are of one recording alone, shape (p,)."""
        return np.array([n.split(".")[1].startswith(TURN_ON) for n in self.layout.names], bool)

    @cached_property
    def gyros(self) -> int:
        """Number of coefficients that act on gyros; they come first."""
        return len(np.unique(self.coefficient[self.axis < 3]))

    @cached_property
    def most(self) -> int:
        """Largest input that is needed."""
        return int(self.entry.max(initial=0))

    @cached_property
    def states(self) -> Layout:
        """Errors of navigation, then the coefficients."""
        return Layout((*STATES.coefficients, *self.layout.coefficients))

    def readings(self, w_ib_b: FloatArray, f_b: FloatArray) -> FloatArray:
        """Return what one unit of each coefficient adds to the readings, shape (6, p) [SI].

        `w_ib_b` (3,): true rate [rad/s]; `f_b` (3,): true specific force [m/s^2].
        """
        from foucault.models.imu import products

        s = np.concatenate([
            [1.0], w_ib_b, f_b, products(f_b), np.abs(w_ib_b), w_ib_b**3, np.abs(f_b),
            np.outer(f_b, w_ib_b).ravel(),
        ])  # fmt: skip
        out = np.zeros((6, len(self)))
        np.add.at(out, (self.axis, self.coefficient), self.weight * s[self.entry])
        return out


def _term(name: str) -> tuple[int, int]:
    """Return output axis and input of a coefficient."""
    block, where = coefficient_slot(name)
    out, *inputs = where if isinstance(where, tuple) else (where,)
    if block == "deflection":
        direction, force = inputs
        entry = FORCE_BY_RATE + 3 * force + direction
    elif inputs:
        entry = _INPUTS[block] + inputs[0]
    else:
        entry = _OWN_AXIS[block] + out if block in _OWN_AXIS else ONE
    return (out if name.startswith("gyro.") else 3 + out), entry


def dynamics(
    sensors: Sensors,
    C_lb: FloatArray,
    w_ib_b: FloatArray,
    f_b: FloatArray,
    w_ie_l: FloatArray,
    w_el_l: FloatArray,
    stiffness: float,
) -> FloatArray:
    """Return the matrix A of ``x' = A x`` for ``x = (psi, dv, dr, coefficients)``.

    `C_lb` (3, 3): attitude [1]; `w_ib_b` (3,): rate of the body [rad/s]; `f_b` (3,): specific
    force [m/s^2]; `w_ie_l` (3,): rotation of the Earth, frame l [rad/s]; `w_el_l` (3,): transport
    rate, frame l [rad/s]; `stiffness`: g / R, the square of the Schuler frequency [1/s^2].
    Returns (9 + p, 9 + p): a, the text of this module written out [SI].
    """
    A = np.zeros((9 + len(sensors),) * 2)
    A[0:3, 0:3] = -cross_matrix(w_ie_l + w_el_l)
    A[3:6, 0:3] = cross_matrix(C_lb @ f_b)
    A[3:6, 3:6] = -cross_matrix(2 * w_ie_l + w_el_l)
    A[3:6, 6:9] = stiffness * np.diag([-1.0, -1.0, 2.0])
    A[6:9, 3:6] = np.eye(3)
    A[6:9, 6:9] = -cross_matrix(w_el_l)
    sensed = sensors.readings(w_ib_b, f_b)
    A[0:3, 9:] = -C_lb @ sensed[:3]
    A[3:6, 9:] = C_lb @ sensed[3:]
    return A


def at_place(radius: float, velocity_n: FloatArray) -> FloatArray:
    """Return the matrix from (psi, dv, dr) to what is seen at a place: (phi, velocity error, dr).

    `radius`: mean radius of curvature plus height [m]; `velocity_n` (3,): velocity [m/s]. Returns
    (9, 9): the two equations of the module's text [SI].
    """
    tilt = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]) / radius
    out = np.eye(9)
    out[0:3, 6:9] = tilt
    out[3:6, 6:9] = cross_matrix(velocity_n) @ tilt
    return out


def azimuth_from_gyro_bias(bias_sd: float, latitude: float) -> float:
    """Return the error of azimuth that a gyro bias along east makes, ``b / (w_ie cos L)`` [rad].

    `bias_sd`: standard deviation of the bias [rad/s]; `latitude`: where [rad].
    """
    return float(bias_sd / (EARTH_RATE * np.cos(latitude)))
