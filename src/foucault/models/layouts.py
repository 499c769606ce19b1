"""All coefficients of all models, and which model a set of them belongs to.

Names are unique over the models: one name has one kind, and one meaning.
"""

from __future__ import annotations

from foucault.coefficients import CoefficientVector, Layout
from foucault.models import cluster, imu
from foucault.models.cluster import ClusterModel
from foucault.models.imu import ImuModel

EVERY = Layout(
    (
        *imu.LAYOUT.coefficients,
        *(c for c in cluster.LAYOUT.coefficients if c.name not in imu.LAYOUT),
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
    """Return the model with the coefficients of `vector`; those of an attitude are left out."""
    if is_cluster(vector):
        return ClusterModel.from_coefficients(vector)
    return ImuModel.from_coefficients(vector)
