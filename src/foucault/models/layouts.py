"""All coefficients of all models, and which model a set of them belongs to.

Names are unique over the models: one name has one kind, and one meaning.

What a reference that is not known exactly makes of the coefficients found by it.

Local gravity is common to all accelerometers, the rate of a table to all gyros: no reading shows
that either is wrong, so that its uncertainty is added to the covariance of the estimate. The clock
of the log is a third: it is kept apart (`result.TimeBase`), because who integrates with the same
clock has no error by it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector, Layout
from foucault.models import cluster, imu, magnetometer, pose, size_effect, transfer, two_imus
from foucault.models.cluster import ClusterModel
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT, ImuModel, coefficient_slot
from foucault.models.magnetometer import Magnetometer

BESIDE = Layout(
    (
        *transfer.INSTALLATION.coefficients, *transfer.DELAY.coefficients,
        *transfer.LOAD.coefficients,
    )
)  # fmt: skip
"""What is found of a slave on its master besides the errors of its sensors."""

TIES = Layout((
    *BESIDE.coefficients, *pose.LAYOUT.coefficients,
    *(c for c in two_imus.LAYOUT.coefficients if c.name.startswith(two_imus.ORDINALS)),
))  # fmt: skip
"""What ties an instrument to another one, and is no error of its readings."""

EVERY = Layout(
    (
        *imu.LAYOUT.coefficients,
        *size_effect.LAYOUT.coefficients,
        *(c for c in cluster.LAYOUT.coefficients if c.name not in imu.LAYOUT),
        *TIES.coefficients,
        *magnetometer.LAYOUT.coefficients,
    )
)
"""Every coefficient there is; to look up what a name means, not to estimate."""


def kind_of(name: str) -> str:
    """Return the kind of coefficient `name`, whatever model has it."""
    return EVERY.coefficients[EVERY.index(name)].kind


def is_cluster(vector: CoefficientVector) -> bool:
    """Whether `vector` belongs to a torqued cluster: commands, not readings of gyros."""
    return "gyro.torquer_scale.x" in vector.layout


Instrument = ImuModel | ClusterModel | Magnetometer
"""The error model of an instrument."""


def model_of(vector: CoefficientVector) -> Instrument:
    """Return the model with the coefficients of `vector`.

    Those of an attitude are left out, those of a mount, and lever arms and delay of accelerometers:
    see `models.size_effect`.
    """
    if is_cluster(vector):
        return ClusterModel.from_coefficients(vector)
    if is_magnetometer(vector):
        return Magnetometer.from_coefficients(vector)
    return ImuModel.from_coefficients(of_one_sample(vector))


def is_magnetometer(vector: CoefficientVector) -> bool:
    """Whether `vector` belongs to a magnetometer beside an IMU."""
    return "mag.bias.x" in vector.layout


def is_imu(vector: CoefficientVector) -> bool:
    """Whether `vector` is of an IMU: errors of its readings, and how it is mounted."""
    return all(name in imu.LAYOUT for name in of_one_sample(vector).names)


def of_sensors(vector: CoefficientVector) -> CoefficientVector:
    """Return what of a `vector` is an error of its sensors: how it is mounted is left out."""
    names = [name for name in vector.names if name not in TIES]
    return vector if len(names) == len(vector) else vector.chosen(names)


def of_one_sample(vector: CoefficientVector) -> CoefficientVector:
    """Return the errors of sensors that one sample shows: not lever arms, nor a delay."""
    vector = of_sensors(vector)
    names = [name for name in vector.names if name not in size_effect.LAYOUT]
    return vector if len(names) == len(vector) else vector.chosen(names)


def with_references(
    coefficients: CoefficientVector, site: Site, table_rate_sd: float = 0.0
) -> CoefficientVector:
    """Add the uncertainty of gravity and of a table's rate, each common to a whole triad.

    `coefficients`: the estimate, as if both were known [SI]; `table_rate_sd`: relative sd of an
    error that all spin rates share [1].
    """
    assert coefficients.cov is not None
    gravity = gravity_error(coefficients, site)
    rate = rate_slope(coefficients) * table_rate_sd
    cov = coefficients.cov + np.outer(gravity, gravity) + np.outer(rate, rate)
    return replace(coefficients, cov=cov)


def gravity_error(vector: CoefficientVector, site: Site) -> FloatArray:
    """Return what one standard deviation of local gravity makes of coefficients, shape (n,).

    `vector`: the coefficients [SI].
    """
    return gravity_slope(vector) * (site.gravity_sd / site.gravity)


def gravity_slope(vector: CoefficientVector) -> FloatArray:
    """Return how coefficients found by the norm of gravity change with the g that was assumed.

    A g assumed larger by the fraction e makes every specific force larger by it, and so the
    accelerometer matrix, the g-sensitivity and the deflection smaller by e and the quadratic terms
    by 2 e; an asymmetry stays what it is.

    `vector`: the coefficients, those of other models do not change with it. Returns (n,):
    derivative with respect to ln(g) [SI unit of each coefficient].
    """
    powers = {
        "accel_matrix": -1.0, "g_sensitivity": -1.0, "accel_quadratic": -2.0, "deflection": -1.0,
    }  # fmt: skip
    return _grown(vector, powers)


def rate_slope(vector: CoefficientVector) -> FloatArray:
    """Return how coefficients change with the logarithm of the rate that was assumed, (n,).

    `vector`: the coefficients, those of other models do not change with it [SI].
    """
    return _grown(vector, {"gyro_matrix": -1.0})


def clock_slope(vector: CoefficientVector, *, turned: bool, summed: bool) -> FloatArray:
    """Return how coefficients change with the rate of the clock that counted the log's time, (n,).

    A clock that is fast by the fraction e makes every interval longer by e. Two things hang on it.
    A gyro that is compared with an *angle* (`turned`: turns between rests, whole turns of a table
    over the log's time) is told that it turned slower by e, so that what multiplies the n-th power
    of the rate grows by n e. *Increments* (`summed`) are divided by the interval, so that all that
    the instrument says, bias and all, shrinks by e. A gyro that says rates and is compared with
    rates (those that a table was told, the Earth's) does not depend on the clock, nor does an
    accelerometer that says specific force.

    `vector`: the coefficients [SI]; `turned`: whether the reference of the gyros is an angle over
    the time of the log. Returns (n,): derivative with respect to the logarithm of the clock's
    rate [SI unit of each coefficient].
    """
    if is_cluster(vector):
        return _cluster_clock_slope(vector, summed=summed)
    # The asymmetries are ratios of what is sensed; the cubic term acts on the rate sensed, which
    # an increment has divided.
    powers = {
        "gyro_matrix": turned - summed, "deflection": turned - summed, "gyro_cubic": 2 * summed,
        "gyro_bias": -summed, "g_sensitivity": -summed,
        "accel_matrix": -summed, "accel_bias": -summed, "accel_quadratic": -summed,
    }  # fmt: skip
    return _grown(vector, powers)


def _grown(vector: CoefficientVector, powers: Mapping[str, float]) -> FloatArray:
    """Return how coefficients change where each block of the model grows by a power, (n,)."""
    known = [i for i, name in enumerate(vector.names) if name in LAYOUT]
    model = ImuModel.from_coefficients(vector.chosen(vector.names[i] for i in known))
    out = np.zeros(len(vector))
    for i in known:
        block, where = coefficient_slot(vector.names[i])
        out[i] = powers.get(block, 0.0) * getattr(model, block)[where]
    return out


def _cluster_clock_slope(vector: CoefficientVector, *, summed: bool) -> FloatArray:
    """Return the same of a torqued cluster: its gyros are commands, integrated over the log's time.

    The cluster turned by ``(I + K) w_c + drift`` over true time: drift and, where commands are
    rates, the torquer are said to be smaller by what the clock is fast.
    """
    out = np.zeros(len(vector))
    for i, name in enumerate(vector.names):
        triad, _, rest = name.partition(".")
        one = 1.0 if rest.startswith(("torquer_scale.", "scale.")) else 0.0
        if triad == "gyro":
            torqued = rest.startswith("torquer_scale.")
            out[i] = 0.0 if torqued and summed else -(one + vector.values[i])
        elif triad == "accel" and summed:
            out[i] = -(one + vector.values[i])
    # The directions of the input axes are angles between axes, whatever counts the time.
    out[[name.startswith("gyro.misalignment.") for name in vector.names]] = 0.0
    return out
