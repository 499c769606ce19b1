"""How far a plan takes a rig, and how far it may: rate, tilt, gimbals and cables."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray
from foucault.diagnose.foresight import Limit
from foucault.models.cluster import angles_of
from foucault.plans.tumble.torquing import TorquingPlan, nominal


@dataclass(frozen=True)
class Reach:
    """How far a rig is taken, or may be."""

    # largest angle between where up is in the cluster and where it was at the start [rad]
    tilt: float
    middle: float  # largest middle angle [rad]
    cable: float  # largest turn of the outer and of the inner gimbal from the start [rad]

    @classmethod
    def of(cls, C_pn: FloatArray) -> Reach:
        """Return how far a motion goes.

        `C_pn` (n, 3, 3): attitudes in close succession: maps East-North-Up to the cluster [1].
        """
        angles = np.unwrap(angles_of(C_pn), axis=0)
        return cls.since(C_pn[0], angles[0], C_pn, angles)

    @classmethod
    def since(
        cls, first: FloatArray, wound: FloatArray, C_pn: FloatArray, angles: FloatArray
    ) -> Reach:
        """Return how far a part of a motion goes from where the whole began.

        `first` (3, 3): attitude at the start [1]; `wound` (3,): outer, middle and inner angle
        there [rad]; `C_pn` (n, 3, 3): attitudes of the part [1]; `angles` (n, 3): its angles,
        counted on beyond whole turns [rad].
        """
        up = np.clip(C_pn[..., 2] @ first[:, 2], -1.0, 1.0)
        return cls(
            float(np.arccos(up).max()),
            float(np.abs(angles[:, 1]).max()),
            float(np.abs(angles - wound)[:, [0, 2]].max()),
        )


@dataclass(frozen=True)
class Limits:
    """What a rig allows; None where it allows everything."""

    rate: float | None = None  # largest rate about an axis [rad/s]
    # tilt, middle, cable: as in `Reach` [rad]
    tilt: float | None = None
    middle: float | None = None
    cable: float | None = None

    @property
    def angles(self) -> tuple[float, ...]:
        """The angles that are limited, shape (k,) [rad]."""
        return tuple(v for v in (self.tilt, self.middle, self.cable) if v is not None)

    def keep(self, reach: Reach) -> bool:
        """Whether so far is not too far."""
        far = ((reach.tilt, self.tilt), (reach.middle, self.middle), (reach.cable, self.cable))
        return all(limit is None or value <= limit for value, limit in far)


def needs(plan: TorquingPlan, limits: Limits) -> tuple[Limit, ...]:
    """Return rate, tilt and cable that a plan needs, beside what the rig allows."""
    # The Earth's rate does not matter to where the cluster points relative to the ground.
    reach, fastest = Reach.of(nominal(plan, 0.0).C_pn), float(np.abs(plan.rates).max())
    return (
        Limit("rate about an axis", "angular rate", fastest, limits.rate),
        Limit("tilt from the start", "angle", reach.tilt, limits.tilt),
        Limit("middle angle", "angle", reach.middle, limits.middle),
        Limit("turn of the outer and inner gimbal", "angle", reach.cable, limits.cable),
    )
