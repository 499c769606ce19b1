"""What each coefficient of a calibration contributes to the error of a navigation.

The errors of navigation are propagated with the errors of the sensors (`estimate.ins_filter`);
an error of a coefficient acts twice, while the instrument is aligned and while it navigates::

    x(t) = (S(t) + Phi(t) A) c + Phi(t) (phi_0, v_0, p_0) + noise,     A = d phi_0 / d c

so that a level error and the accelerometer bias that made it cancel as they do in truth. With
c the value of a coefficient this is what correcting it was worth; with the covariance of the
coefficients it is what is left, beside the noise of alignment and sensors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray

STATES = 9  # phi, velocity, position; east, north, up each


@dataclass(frozen=True)
class Budget:
    """Contributions of p coefficients at m epochs; phi [rad], velocity [m/s], position [m]."""

    time: FloatArray  # (m,) epochs, of the log's clock [s]
    names: tuple[str, ...]
    # values, sd: (p,) what was corrected, and how well that is known; sd NaN where unknown [SI]
    values: FloatArray
    sd: FloatArray
    # (m, 9, p) errors of navigation per unit of each coefficient, alignment included [SI]
    response: FloatArray
    # (m, 9, 9) covariance that what is left of all coefficients makes [SI]
    coefficients: FloatArray
    # (m, 9, 9) covariance that errors of the start make: attitude, velocity and place [SI]
    alignment: FloatArray
    noise: FloatArray  # (m, 9, 9) covariance that sensor noise after the alignment makes [SI]
    # (3, 3) covariance of phi at the start, by noise and what is left of the coefficients [rad^2]
    start: FloatArray

    @property
    def cov(self) -> FloatArray:
        """Covariance of all of it, shape (m, 9, 9) [SI]."""
        return np.asarray(self.coefficients + self.alignment + self.noise)

    @property
    def worth(self) -> FloatArray:
        """Error that each coefficient made before it was corrected, shape (m, 9, p) [SI]."""
        return np.asarray(self.response * self.values)

    @property
    def left(self) -> FloatArray:
        """Standard deviation that each coefficient alone leaves, shape (m, 9, p) [SI]."""
        return np.abs(self.response) * np.nan_to_num(self.sd)

    def ranked(self, part: FloatArray) -> npt.NDArray[np.intp]:
        """Return coefficients by horizontal position error at the end, the largest first.

        `part` (m, 9, p): `worth` or `left` [SI].
        """
        return np.argsort(-np.hypot(part[-1, 6], part[-1, 7]), kind="stable")


def budget(
    time: FloatArray,
    transition: FloatArray,
    aligned: FloatArray,
    coefficients: tuple[tuple[str, ...], FloatArray, FloatArray | None],
    phi_cov: FloatArray,
    noise_cov: FloatArray,
    velocity_sd: float = 0.0,
    position_sd: float = 0.0,
) -> Budget:
    """Put together what every source makes of the errors of navigation.

    `time` (m,): epochs [s]; `transition` (m, 9, 9 + p): errors per unit of the errors at the
    start, and of each coefficient, after it [SI]; `aligned` (3, p): attitude error at the start
    per unit of each coefficient [rad per SI]; `coefficients` or None: names, values, shape (p,),
    and covariance, shape (p, p), where known [SI]; `phi_cov` (3, 3): covariance of the start
    attitude by noise alone [rad^2]; `noise_cov` (m, 9, 9): covariance that sensor noise makes
    [SI]; `velocity_sd`: of each component at the start [m/s]; `position_sd`: of the place at the
    start, east, north and up [m].
    """
    names, values, cov = coefficients
    total = transition[:, :, STATES:] + transition[:, :, :3] @ aligned
    start = np.diag(np.repeat([0.0, velocity_sd**2, position_sd**2], 3))
    start[:3, :3] = phi_cov
    first = transition[:, :, :STATES]
    known = np.zeros((len(names),) * 2) if cov is None else cov
    sd = np.full(len(names), np.nan) if cov is None else np.sqrt(np.diag(cov))
    return Budget(
        time, names, values, sd, total, total @ known @ np.swapaxes(total, 1, 2),
        first @ start @ np.swapaxes(first, 1, 2), noise_cov,
        phi_cov + aligned @ known @ aligned.T,
    )  # fmt: skip


def normalised_square(error: FloatArray, cov: FloatArray) -> float:
    """Return ``e' P^-1 e`` [1], chi-square distributed where P is right.

    `error` (k,): error [unit]; `cov` (k, k): its predicted covariance [unit^2].
    """
    return float(error @ np.linalg.solve(cov, error))
