"""A procedure states its model; everything else is there: the smallest example of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import drawn_errors
from foucault.arrays import FloatArray
from foucault.diagnose.fit_checks import Judged, Limit, budget_json, checks, folds
from foucault.infer import mixed
from foucault.infer.gauss_newton import chi_square_limits
from foucault.infer.information import bound
from foucault.infer.mixed import SIGNIFICANT, Linearisation, Source
from foucault.models.imu import LAYOUT, ImuModel
from foucault.result import Verdict

RATE = np.repeat([-0.8, -0.4, 0.4, 0.8], 6)[:, None]  # of a record player [rad/s]


@dataclass(frozen=True)
class RecordPlayer:
    """``gyro = (1 + s) w (1 + jitter) + b + noise``: one gyro upright on a record player."""

    gyro: FloatArray  # (n, 1) mean readings [rad/s]
    layout = LAYOUT.subset(("gyro.bias.z", "gyro.scale.z"))
    start = ImuModel()
    kinds = {"steps": np.ones((24, 1), bool)}  # noqa: RUF012

    def linearise(self, state: ImuModel) -> Linearisation:
        w = RATE * [0.0, 0.0, 1.0]
        miss = self.gyro - state.measure(0 * w, w)[1][:, 2:]
        J = state.slopes(0 * w, w, self.layout.names).gyro[:, 2:]
        noise = Source("gyro noise", np.ones((24, 1, 1)), sd=1e-5, noise=True)
        jitter = Source(
            "rate jitter", RATE[:, :, None], sd=None, price=SIGNIFICANT, unexplained=True
        )
        return Linearisation(miss, J, (noise, jitter))

    def retract(self, state: ImuModel, step: FloatArray) -> ImuModel:
        return state.moved(self.layout.names, step)

    def values(self, state: ImuModel) -> FloatArray:
        return state.coefficients(self.layout.names).values


def session(rng: np.random.Generator, jitter: float = 0.0) -> RecordPlayer:
    errors = drawn_errors.drawn(RecordPlayer(RATE).linearise(ImuModel()), rng)
    return RecordPlayer(1.01 * RATE * (1 + jitter * rng.standard_normal((24, 1))) + 1e-3 + errors)


def test_a_model_gets_everything_else_for_free() -> None:
    at = mixed.fit(session(np.random.default_rng(1), jitter=1e-3))
    said = budget_json(at, {})["budget"]
    np.testing.assert_allclose(sum(map(np.array, said.values())), at.estimate.coefficients.sd**2)
    assert (
        np.array(bound(mixed.noise_alone(at), at.state)["bound"]) < at.estimate.coefficients.sd
    ).all()
    limits = {"rate jitter": Limit("The rate", 0.01, 1e6, "ppm", "the motor is worn")}
    unseen = mixed.held_out(at, folds(at, "steps", 4))
    tests = checks(Judged(at, {"steps": "the steps"}, "declared", np.arange(24.0),
                          {"steps": ("rate jitter",)}, limits, held_out=unseen))  # fmt: skip
    reasons = Verdict.of(tuple(tests)).reasons
    assert len(reasons) == 1 and "the declared noise is too small" in reasons[0]


def test_its_errors_are_as_large_as_it_says() -> None:
    rng, truth = np.random.default_rng(2), np.array([1e-3, 0.01])
    found = [mixed.fit(session(rng)).estimate.coefficients for _ in range(200)]
    nees = sum((c.values - truth) @ np.linalg.solve(c.cov, c.values - truth) for c in found)
    low, high = chi_square_limits(400)
    assert low < nees < high
