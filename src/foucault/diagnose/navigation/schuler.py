"""Fit the error of a stationary navigation by the terms of free inertial drift, and name them.

The horizontal position error (velocity error, where positions are not known) of a navigator that
stood still is linear in the seven terms of `diagnose.navigation.free_inertial`. They are found by
generalised least squares: what white sensor noise makes of the error is strongly correlated in
time, and its covariance is known. A run much shorter than the Schuler period cannot tell all terms
apart: the covariance of the fit says which, and what is seen is their decorrelated combination.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.diagnose.navigation.free_inertial import (
    KINDS,
    STATES,
    TERMS,
    Place,
    noise_covariance,
    responses,
)
from foucault.estimate.chi_square import chi_square_limits
from foucault.units import convert, display_unit, plain

EPOCHS = 120
"""Epochs that the fit uses; more would be as good as copies of one another [1]."""

ALIKE = 0.85
"""Correlation from which two terms count as hardly told apart: together known twice as well [1]."""

FLOOR = 1e-6
"""Part of the largest error that the reference is uncertain by at least [1]."""

SHORTEST = 60.0
"""Shortest run that is fitted [s]."""


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

    @property
    def fitted(self) -> FloatArray:
        """The sum of all terms, shape (m, 2) [m] or [m/s]."""
        return np.asarray(self.parts.sum(axis=2))

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


def _epochs(time: FloatArray) -> npt.NDArray[np.int64]:
    """Return evenly spread samples, the last one among them and the start not."""
    wanted = np.linspace(0.0, float(time[-1]), EPOCHS + 1)[1:]
    return np.unique(np.searchsorted(time, wanted - 1e-9).clip(1, len(time) - 1))
