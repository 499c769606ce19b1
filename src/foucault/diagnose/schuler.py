"""Fit the error of a stationary navigation by the terms of free inertial drift, and name them.

The horizontal position error (velocity error, where positions are not known) of a navigator that
stood still is linear in seven `TERMS`, which are found by generalised least squares: what white
sensor noise makes of the error is strongly correlated in time, and its covariance is known. A run
much shorter than the Schuler period cannot tell all terms apart: the covariance of the fit says
which, and what is seen is their decorrelated combination.

The error grows by the exact solution of a linear model: horizontal position, horizontal velocity
and attitude, E-N-U, estimate minus truth, with constant sensor errors (gyro eps, accelerometer D,
both resolved in n, measured minus true)::

    dE' = dV_E                 phi_E' = -dV_N/(R_M+h) + w_U phi_N - w_N phi_U - eps_E
    dN' = dV_N                 phi_N' =  dV_E/(R_N+h) - w_U phi_E - w_U dN/(R_M+h) - eps_N
    dV_E' = -g phi_N + 2 w_U dV_N + D_E
    dV_N' =  g phi_E - 2 w_U dV_E + D_N
    phi_U' = dV_E tan L/(R_N+h) + w_N phi_E + w_N dN/(R_M+h) - eps_U

with ``w_N = w_ie cos L, w_U = w_ie sin L``. Nothing but seven combinations of the ten constants
phi(0), dV_E(0), dV_N(0), eps, D_E, D_N ever shows in position or velocity (substitute
phi_E + D_N/g and phi_N - D_E/g); they are `TERMS`::

    velocity east, velocity north
    tilt about north   phi_N - D_E/g            seen as an acceleration to the west
    tilt about east    phi_E + D_N/g            seen as an acceleration to the north
    drift about east   eps_E + w_N phi_U - w_U D_E/g       a heading error is an east gyro drift
    drift about north  eps_N - w_U D_N/g
    drift about up     eps_U + w_N D_N/g

Within a few hours these are the well-known terms of a channel, with ``w_s = sqrt(g/R)``:
velocity ``sin(w_s t)/w_s``, tilt ``R (1 - cos w_s t)``, drift ``R (t - sin(w_s t)/w_s)``, azimuth
drift ``R w_N (t^2/2 - (1 - cos w_s t)/w_s^2)``; the 24 h and the Foucault period are in the exact
solution, which `responses` computes.

References
----------
.. [1] D. H. Titterton, J. L. Weston, *Strapdown Inertial Navigation Technology*, 2nd ed., 2004,
   sections 12.3 and 12.5.
.. [2] P. D. Groves, *Principles of GNSS, Inertial, and Multisensor Integrated Navigation
   Systems*, 2nd ed., 2013, section 5.7.
.. [3] C. F. Van Loan, "Computing integrals involving the matrix exponential", IEEE Trans.
   Automatic Control 23(3), 1978.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models import earth
from foucault.units import convert, display_unit, plain

STATES = ("east", "north", "velocity east", "velocity north", "phi east", "phi north", "phi up")
"""Rows of the solution: m, m, m/s, m/s, rad, rad, rad."""

TERMS = ("velocity east", "velocity north", "tilt about east", "tilt about north",
         "drift about east", "drift about north", "drift about up")  # fmt: skip
"""What can be seen in position or velocity: m/s, m/s, rad, rad, rad/s, rad/s, rad/s."""

KINDS = ("velocity", "velocity", "angle", "angle", "angular rate", "angular rate", "angular rate")
"""Kind of each term, a key of `units.KINDS`."""

_START = {0: 2, 1: 3, 2: 4, 3: 5}  # term -> the state it is the start of
_INPUT = {4: 4, 5: 5, 6: 6}  # term -> the state it drives, with a minus sign


@dataclass(frozen=True)
class Place:
    """Where the navigator stands."""

    latitude: float  # geodetic latitude [rad]
    height: float  # height above the ellipsoid [m]
    gravity: float  # local gravity [m/s^2]

    @property
    def radii(self) -> tuple[float, float]:
        """Radii of curvature plus height: of the meridian, of the prime vertical [m]."""
        meridian, across = earth.radii(self.latitude)
        return float(meridian) + self.height, float(across) + self.height

    @property
    def schuler_period(self) -> float:
        """2 pi sqrt(R/g), R the Gaussian mean radius [s]."""
        north, east = self.radii
        return 2 * math.pi * math.sqrt(math.sqrt(north * east) / self.gravity)

    @property
    def earth_rate(self) -> tuple[float, float]:
        """North and up component of the Earth's rate [rad/s]."""
        _, north, up = earth.earth_rate_n(self.latitude)
        return float(north), float(up)


def dynamics(place: Place) -> FloatArray:
    """Return F, shape (7, 7) [SI], of ``x' = F x`` with the states of `STATES`."""
    r_north, r_east = place.radii
    w_n, w_u = place.earth_rate
    g, tan = place.gravity, math.tan(place.latitude)
    return np.array(
        [
            [0, 0, 1, 0, 0, 0, 0],
            [0, 0, 0, 1, 0, 0, 0],
            [0, 0, 0, 2 * w_u, 0, -g, 0],
            [0, 0, -2 * w_u, 0, g, 0, 0],
            [0, 0, 0, -1 / r_north, 0, w_u, -w_n],
            [0, -w_u / r_north, 1 / r_east, 0, -w_u, 0, 0],
            [0, w_n / r_north, tan / r_east, 0, w_n, 0, 0],
        ],
        float,
    )


def responses(time: FloatArray, place: Place) -> FloatArray:
    """Compute what one unit of every term of `TERMS` makes of the states of `STATES`.

    `time` (m,): time since the terms held [s]. Returns (m, 7, 7): states, then terms [SI].

    The attitude rows are exact for tilts and drifts that are attitude and gyro errors; of an
    accelerometer error they are that of the attitude which moves position alike.
    """
    from scipy.linalg import expm

    F = np.zeros((10, 10))
    F[:7, :7] = dynamics(place)
    for term, state in _INPUT.items():
        F[state, term + 3] = -1.0
    Phi = expm(F * np.asarray(time, float)[:, None, None])
    columns = [_START[k] if k in _START else k + 3 for k in range(len(TERMS))]
    return np.asarray(Phi[:, :7, columns])


def noise_covariance(
    time: FloatArray, place: Place, gyro_white: float, accel_white: float
) -> FloatArray:
    """Compute what the white noise of the sensors makes of the states, at all epochs together.

    ``P(t_i, t_j) = Phi(t_i - t_j) P(t_j)`` for t_i >= t_j, ref. [3] for P.

    `time` (m,): time since the start, rising [s]; `gyro_white`, `accel_white`: white noise
    [rad/s/sqrt(Hz)], [m/s^2/sqrt(Hz)]. Returns (m, 7, m, 7): covariance of the states at every
    pair of epochs [SI].
    """
    from scipy.linalg import expm

    m = len(time)
    F = dynamics(place)
    Q = np.diag([0, 0, accel_white**2, accel_white**2, *[gyro_white**2] * 3])
    block = np.zeros((14, 14))
    block[:7, :7], block[:7, 7:], block[7:, 7:] = -F, Q, F.T
    steps, which = np.unique(np.round(np.diff(time, prepend=0.0), 9), return_inverse=True)
    both = expm(block * steps[:, None, None])
    Phi = np.swapaxes(both[:, 7:, 7:], 1, 2)
    noise = Phi @ both[:, :7, 7:]
    out = np.zeros((m, 7, m, 7))
    P = np.zeros((7, 7))
    for i in range(m):
        step = Phi[which[i]]
        if i:
            out[i, :, :i] = np.einsum("ab,bjc->ajc", step, out[i - 1, :, :i])
            out[:i, :, i] = np.transpose(out[i, :, :i], (1, 2, 0))
        P = step @ P @ step.T + noise[which[i]]
        out[i, :, i] = (P + P.T) / 2
    return out


EPOCHS = 120  # Epochs that the fit uses; more would be as good as copies of one another [1].

ALIKE = 0.85
"""Correlation from which two terms count as hardly told apart: together known twice as well [1]."""

FLOOR = 1e-6  # Part of the largest error that the reference is uncertain by at least [1].
SHORTEST = 60.0  # Shortest run that is fitted [s].


@dataclass(frozen=True)
class Combination:
    """Two terms that a run cannot tell apart, and what it shows of them."""

    # first, second: names of the terms
    first: str
    second: str
    correlation: float  # of their errors [1]
    factor: float  # what is seen is first + factor * second [unit of first per unit of second]
    # value, sd: of that combination [unit of first]
    value: float
    sd: float

    def sentence(self) -> str:
        """Say it for people."""
        kind = KINDS[TERMS.index(self.first)]
        unit = display_unit(kind, abs(self.sd))
        value, sd = (plain(convert(v, kind, unit), 3) for v in (self.value, self.sd))
        scale = self.factor * _size(self.second) / _size(self.first)
        step = f"{'+' if scale >= 0 else '-'} {plain(abs(scale), 3)}"
        return (
            f"This run hardly tells {self.first} from {self.second} (correlation "
            f"{self.correlation:+.2f}); best it shows {self.first} in {_unit(self.first)} {step} "
            f"times {self.second} in {_unit(self.second)}: {value} ± {sd} {unit}."
        )


def _unit(term: str) -> str:
    return {"velocity": "m/s", "angle": "arcsec", "angular rate": "deg/h"}[KINDS[TERMS.index(term)]]


def _size(term: str) -> float:
    return 1 / convert(1.0, KINDS[TERMS.index(term)], _unit(term))


@dataclass(frozen=True)
class SchulerFit:
    """The terms of free inertial drift found in an error."""

    # values, sd: (7,) terms of `TERMS`, and their standard deviations [m/s, rad, rad/s]
    values: FloatArray
    sd: FloatArray
    cov: FloatArray  # (7, 7) covariance [products of these]
    chi_square: float  # of the residuals, sensor noise alone expected [1]
    dof: int  # degrees of freedom [1]
    limits: tuple[float, float]  # between which chi_square lies in 99 % of all runs [1]
    time: FloatArray  # (m,) epochs since the start [s]
    # (m, 2) East and north error that was fitted [m], or [m/s] where `of` is "velocity"
    observed: FloatArray
    parts: FloatArray  # (m, 2, 7) what each term contributes to it [m] or [m/s]
    # (m, 2) what sensor noise may add since the start, standard deviation [m] or [m/s]
    noise_sd: FloatArray
    of: str
    place: Place

    def combinations(self) -> tuple[Combination, ...]:
        """Return the pairs of terms that this run cannot tell apart, most alike first."""
        correlation = self.cov / np.outer(self.sd, self.sd)
        pairs = [(i, j) for i in range(len(TERMS)) for j in range(i)]
        pairs = [(i, j) for i, j in pairs if abs(correlation[i, j]) > ALIKE]
        pairs.sort(key=lambda ij: -abs(correlation[ij]))
        return tuple(self._combined(j, i, float(correlation[i, j])) for i, j in pairs)

    def _combined(self, i: int, j: int, correlation: float) -> Combination:
        factor = -self.cov[i, j] / self.cov[j, j]  # the sum then has the smallest variance
        sd = self.sd[i] * math.sqrt(max(1 - correlation**2, 0.0))
        value = self.values[i] + factor * self.values[j]
        return Combination(TERMS[i], TERMS[j], correlation, float(factor), float(value), sd)

    def rows(self) -> list[dict[str, float | str | bool]]:
        """Return one dictionary per term: value, sd, largest correlation, metres at the end."""
        correlation = np.abs(self.cov / np.outer(self.sd, self.sd) - np.eye(len(TERMS)))
        w_n, _ = self.place.earth_rate
        out: list[dict[str, float | str | bool]] = []
        for k, name in enumerate(TERMS):
            row: dict[str, float | str | bool] = {
                "name": name,
                "kind": KINDS[k],
                "value": float(self.values[k]),
                "sd": float(self.sd[k]),
                "alike": TERMS[int(correlation[k].argmax())],
                "correlation": float(correlation[k].max()),
                "east": float(self.parts[-1, 0, k]),
                "north": float(self.parts[-1, 1, k]),
                "same_as": _same_as(name, float(self.values[k]), w_n, self.place.gravity),
            }
            out.append(row)
        return out


def _same_as(name: str, value: float, w_n: float, gravity: float) -> str:
    """Say which error of a sensor or of the heading would look alike."""
    if name.startswith("tilt"):
        axis = "north" if name.endswith("east") else "east"
        signed = value * gravity * (1 if axis == "north" else -1)
        unit = display_unit("specific force", abs(signed))
        text = plain(convert(signed, "specific force", unit), 3)
        return f"an accelerometer bias of {text} {unit} to the {axis}"
    if name == "drift about east" and w_n > 1e-8:
        angle = value / w_n
        unit = display_unit("angle", abs(angle))
        return f"a heading error of {plain(convert(angle, 'angle', unit), 3)} {unit}"
    return ""


def fit(
    time: FloatArray,
    error: FloatArray,
    place: Place,
    *,
    gyro_white: float,
    accel_white: float,
    error_sd: float = 0.0,
    of: str = "position",
) -> SchulerFit:
    """Fit the horizontal error of a stationary run.

    `time` (n,): time since the start, rising [s]; `error` (n, 2): East and north, estimate minus
    truth: of position [m], or of velocity [m/s]; `gyro_white`, `accel_white`: white noise
    [rad/s/sqrt(Hz)], [m/s^2/sqrt(Hz)]; `error_sd`: standard deviation of the reference [m] or
    [m/s].

    The standard deviations grow by sqrt(chi_square / dof) where the fit is worse than noise: what
    is not in the model (a bias that wanders, a sway) is in them then.
    """
    some = _epochs(time)
    t, y = np.asarray(time[some], float), np.asarray(error[some], float)
    rows = [STATES.index(s) for s in ("east", "north")]
    rows = rows if of == "position" else [r + 2 for r in rows]
    A = responses(t, place)[:, rows]
    m = len(t)
    full = noise_covariance(t, place, gyro_white, accel_white)
    R = full[:, rows][:, :, :, rows].reshape(2 * m, 2 * m)
    noise_sd = np.sqrt(np.diag(R)).reshape(m, 2)
    R[np.diag_indices(2 * m)] += error_sd**2 + (FLOOR * np.abs(y).max() + 1e-9) ** 2
    half = np.linalg.cholesky(R)
    scale = np.linalg.norm(A.reshape(2 * m, -1), axis=0)
    white = np.linalg.solve(half, A.reshape(2 * m, -1) / scale)
    target = np.linalg.solve(half, y.ravel())
    U, s, Vt = np.linalg.svd(white, full_matrices=False)
    values = Vt.T @ ((U.T @ target) / s)
    cov = (Vt.T / s**2) @ Vt / np.outer(scale, scale)
    left = target - white @ values
    chi_square, dof = float(left @ left), 2 * m - len(TERMS)
    cov = cov * max(1.0, chi_square / dof)
    values = values / scale
    return SchulerFit(
        values, np.sqrt(np.diag(cov)), cov, chi_square, dof, chi_square_limits(dof, 0.01),
        t, y, A * values, noise_sd, of, place,
    )  # fmt: skip


def _epochs(time: FloatArray) -> IntArray:
    """Return evenly spread samples, the last one among them and the start not."""
    wanted = np.linspace(0.0, float(time[-1]), EPOCHS + 1)[1:]
    return np.unique(np.searchsorted(time, wanted - 1e-9).clip(1, len(time) - 1))
