"""What the motion of a tumble shows: sensitivities, information, stripped observability."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import Coefficient, Layout
from foucault.diagnose.information import Information
from foucault.diagnose.observability import LinearSegment, Observability, observability
from foucault.diagnose.sensitivity import Sensitivity
from foucault.estimate.tumble.fit import STATES, Fit, Prior, State, Tumble, sensitivities
from foucault.models.cluster import CONSTANTS
from foucault.models.rotation import cross_matrix, exp
from foucault.tables import AXES

STATE = Layout(
    (
        *(
            Coefficient(
                f"start.{word}", f"psi_{word[0]}", "angle", f"attitude at the start, {about}"
            )
            for word, about in (("east", "about East"), ("north", "about North"), ("up", "azimuth"))
        ),
        *CONSTANTS.coefficients,
    )
)
"""What the readings depend on: the attitude at the start, and the constants."""


# -- what the motion shows -------------------------------------------------------------------


def curves(tumble: Tumble, at: State, gravity: float, normalised: FloatArray) -> Sensitivity:
    """Return d(reading)/d(state) along the motion: attitude at the start, then 42 constants.

    `gravity`: local gravity [m/s^2]; `normalised` (42,): factors that turn SI into packed units.
    """
    scale = np.concatenate([np.ones(3), normalised, [1.0]])
    time, slopes = sensitivities(tumble, at, scale)
    return Sensitivity(
        time, STATE, tuple(AXES),
        gravity * slopes[:, :, : STATES - 1],
    )  # fmt: skip


def information_of(fit: Fit, prior: Prior) -> Information:
    """Return what the data alone say: of the attitude at the start, and of the constants."""
    n = STATES - 1
    values, vectors = np.linalg.eigh(fit.information[:n, :n])
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    return Information(STATE, root / prior.unit[:n])


def piecewise(
    rates: Sequence[FloatArray], attitudes: Sequence[FloatArray], times: Sequence[float],
    prior: Prior, reading_sd: float,
) -> Observability:  # fmt: skip
    """Return the stripped observability of a plan of constant segments.

    `rates` (3,): rate of each segment, frame p [rad/s]; `attitudes` (3, 3): C_pn in the middle of
    each segment [1]; `times`: how long each takes [s]; `prior`: its mean is where the model is
    linearised; `reading_sd`: standard deviation of a reading [local g].
    """
    segments = [
        _segment(prior.mean.constants, rate, C_pn, time)
        for rate, C_pn, time in zip(rates, attitudes, times, strict=True)
    ]
    return observability(segments, STATE, prior.sd[: STATES - 1], reading_sd)


def _segment(
    constants: FloatArray, rate: FloatArray, C_pn: FloatArray, time: float
) -> LinearSegment:
    """Linearise motion and readings at one attitude by central differences."""
    from foucault.kernels.cluster import actual_rate, inverse_input_axes, readings

    still = np.zeros(3)
    arms, Ti = np.zeros((3, 3)), np.empty((3, 3))

    def at(f: FloatArray, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        inverse_input_axes(theta, Ti)
        w = np.array(actual_rate(theta, Ti, *rate, *f))
        return w, np.array(readings(theta, *f, *w, *still, arms, 1.0))

    n, step = STATES - 1, 1e-6
    d = step * np.eye(n)
    # Of the states the first three alone, a rotation, change the force that is felt.
    force = exp(np.stack([-d[:, :3], d[:, :3]])) @ C_pn[:, 2]
    F, H = np.zeros((n, n)), np.zeros((3, n))
    for k in range(n):
        up = at(force[0, k], constants + d[k, 3:])
        down = at(force[1, k], constants - d[k, 3:])
        F[:3, k], H[:, k] = ((a - b) / (2 * step) for a, b in zip(up, down, strict=True))
    F[:3, :3] -= cross_matrix(rate)
    return LinearSegment(F, H, time)
