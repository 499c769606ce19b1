"""All coefficients of all models, and which model a set of them belongs to.

Names are unique over the models: one name has one kind, and one meaning.
"""

from __future__ import annotations

from foucault.coefficients import CoefficientVector, Layout
from foucault.models import cluster, imu, size_effect, transfer
from foucault.models.cluster import ClusterModel
from foucault.models.imu import ImuModel

BESIDE = Layout(
    (
        *transfer.INSTALLATION.coefficients, *transfer.DELAY.coefficients,
        *transfer.LOAD.coefficients,
    )
)  # fmt: skip
"""What is found of a slave on its master besides the errors of its sensors."""

EVERY = Layout(
    (
        *imu.LAYOUT.coefficients,
        *size_effect.LAYOUT.coefficients,
        *(c for c in cluster.LAYOUT.coefficients if c.name not in imu.LAYOUT),
        *BESIDE.coefficients,
    )
)
"""Every coefficient there is; to look up what a name means, not to estimate."""


def kind_of(name: str) -> str:
    """Return the kind of coefficient `name`, whatever model has it."""
    return EVERY.coefficients[EVERY.index(name)].kind


def is_cluster(vector: CoefficientVector) -> bool:
    """Whether `vector` belongs to a torqued cluster: commands, not readings of gyros."""
    return "gyro.torquer_scale.x" in vector.layout


def model_of(vector: CoefficientVector) -> ImuModel | ClusterModel:
    """Return the model with the coefficients of `vector`.

    Those of an attitude are left out, those of a mount, and lever arms and delay of accelerometers:
    see `models.size_effect`.
    """
    if is_cluster(vector):
        return ClusterModel.from_coefficients(vector)
    return ImuModel.from_coefficients(of_one_sample(vector))


def is_imu(vector: CoefficientVector) -> bool:
    """Whether `vector` is of an IMU: errors of its readings, and how it is mounted."""
    return all(name in imu.LAYOUT for name in of_one_sample(vector).names)


def of_sensors(vector: CoefficientVector) -> CoefficientVector:
    """Return what of a `vector` is an error of its sensors: how it is mounted is left out."""
    names = [name for name in vector.names if name not in BESIDE]
    return vector if len(names) == len(vector) else vector.chosen(names)


def of_one_sample(vector: CoefficientVector) -> CoefficientVector:
    """Return the errors of sensors that one sample shows: not lever arms, nor a delay."""
    vector = of_sensors(vector)
    names = [name for name in vector.names if name not in size_effect.LAYOUT]
    return vector if len(names) == len(vector) else vector.chosen(names)
