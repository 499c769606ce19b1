"""What exports of coefficients that change with temperature share: their terms, as matrices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.models.imu import ImuModel
from foucault.models.layouts import of_one_sample
from foucault.models.temperature import TemperatureModel, without


@dataclass(frozen=True)
class TemperatureTerms:
    """Matrices as sums over functions of temperature, ``A(T) = sum of A_k phi_k(T)``."""

    functions: TemperatureModel  # phi_k, and where they hold [K]
    # A_k: the matrices that phi_k multiplies, in the axes of the export [SI per unit of phi_k]
    terms: tuple[ImuModel, ...]

    @classmethod
    def of(
        cls,
        functions: TemperatureModel,
        dropped: tuple[str, ...],
        turned: Callable[[ImuModel], ImuModel],
    ) -> TemperatureTerms:
        """Return the terms without the coefficients `dropped`, turned into other axes.

        `functions`: coefficients as functions of temperature [SI]; `turned`: what brings a model
        into the axes of the export, it is linear in all matrices.
        """
        functions = without(functions, tuple(n for n in dropped if n in functions.layout))
        out = []
        for k, column in enumerate(functions.weights.T):
            vector = of_one_sample(CoefficientVector(functions.layout, column))
            term = turned(ImuModel.from_coefficients(vector))
            if k > 0 and not functions.knots.size:  # the identity stands in the first term only
                term = replace(
                    term, accel_matrix=term.accel_matrix - np.eye(3),
                    gyro_matrix=term.gyro_matrix - np.eye(3),
                )  # fmt: skip
            out.append(term)
        return cls(functions, tuple(out))

    def block(self, name: str) -> FloatArray:
        """Return the terms of one matrix, shape (p, ...) [SI per unit of phi_k]."""
        return np.array([getattr(term, name) for term in self.terms])

    @property
    def pattern(self) -> ImuModel:
        """A model in which all is zero that is zero at every temperature, and nothing else."""
        names = [f.name for f in fields(ImuModel)]
        return ImuModel(**{n: np.abs(self.block(n)).sum(axis=0) for n in names})

    def statement(self) -> str:
        """Say what the functions are, for people."""
        f = self.functions
        if f.knots.size:
            return (
                f"Coefficients change with temperature, piecewise linear between {f.knots.size} "
                f"knots from {f.knots[0]:.2f} K to {f.knots[-1]:.2f} K."
            )
        return (
            f"Coefficients change with temperature T [K], as powers 0 to {len(self.terms) - 1} of "
            f"T - {f.reference:.2f} K."
        )
