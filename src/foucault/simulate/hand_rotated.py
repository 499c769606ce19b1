"""Simulate rests and moves between them: the log a user would save, with the truth beside it.

Between two rests the attitude is ``C_nb(t) = C_s Exp(phi s(t)) Exp(wobble b(t))`` with smooth
s from 0 to 1 and a smooth bump b, so that the true rate is known in closed form::

    w_nb_b = Exp(wobble b)' phi s' + wobble b'
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.models.earth import Site, earth_rate_n
from foucault.models.imu import LINEAR_LOWER, ImuModel
from foucault.models.noise import ImuNoise, grade
from foucault.models.rotation import exp, log
from foucault.plans.directions import RestPlan
from foucault.simulate.noise import sampled_log
from foucault.tables import Log, whole_samples


@dataclass(frozen=True)
class Simulation:
    """A simulated session."""

    log: Log  # what the instrument said [SI]
    model: ImuModel  # the errors it had: the truth
    # first, last: (n,) first sample of each rest and the sample after its last
    first: npt.NDArray[np.int64]
    last: npt.NDArray[np.int64]
    C_nb: FloatArray  # (n, 3, 3) true attitude of each rest [1]

    def truth_json(self) -> dict[str, Any]:
        """Return the truth beside the coefficients."""
        return {
            "rests": {
                "first": self.first.tolist(),
                "last": self.last.tolist(),
                "C_nb": self.C_nb.tolist(),
            }
        }


def draw_errors(grade_name: str, seed: int) -> ImuModel:
    """Draw the errors of one instrument of a class.

    `seed`: seed [1].
    """
    spread = grade(grade_name).spread
    vector = ImuModel().coefficients(LINEAR_LOWER)
    sd = np.array([spread[name.rpartition(".")[0]] for name in vector.names])
    values = sd * np.random.default_rng(seed).standard_normal(len(sd))
    return ImuModel.from_coefficients(
        vector.with_values(dict(zip(vector.names, values, strict=True)))
    )


def simulate(
    plan: RestPlan,
    *,
    model: ImuModel,
    noise: ImuNoise,
    site: Site,
    rate: float = 100.0,
    sampled: Literal["rate", "increment"] = "rate",
    seed: int = 0,
) -> Simulation:
    """Simulate the log of a plan.

    `noise`: its noise [SI]; `site`: gravity, and latitude if the Earth's rotation is to be felt;
    `rate`: sample rate [Hz]; `sampled`: instantaneous rates, or means over the interval before
    each sample; `seed`: seed of the noise [1].
    """
    starts, ends = plan.edges
    n = whole_samples(np.floor(ends[-1] * rate + 1e-9)) + 1
    readout = sampled_log(
        partial(_truth, plan, site), samples=n, rate=rate, sampled=sampled,
        model=model, noise=noise, rng=np.random.default_rng(seed),
    )  # fmt: skip
    first = np.ceil(starts * rate - 1e-9).astype(np.int64)
    last = np.floor(ends * rate + 1e-9).astype(np.int64) + 1
    if sampled == "increment":
        first[1:] += 1  # the first interval that lies in the rest as a whole
    return Simulation(readout, model, first, np.minimum(last, n), plan.C_nb)


class Drawn(Protocol):
    """A session whose plan is drawn."""

    rate: float  # sample rate [Hz]
    kind: Literal["rate", "increment"]  # instantaneous rates, or means over each interval

    def plan(self, settings: Any, seed: int) -> RestPlan:
        """Return what is done; `seed`: seed of what is drawn of it [1]."""


def simulate_drawn(
    session: Drawn, settings: Any, model: ImuModel, noise: ImuNoise, site: Site, seed: int
) -> Simulation:
    """Simulate a session: `seed` [1] gives one of its plan and one of its `noise` [SI]."""
    plan_seed, noise_seed = np.random.SeedSequence(seed).generate_state(2)
    return simulate(
        session.plan(settings, int(plan_seed)), model=model, noise=noise, site=site,
        rate=session.rate, sampled=session.kind, seed=int(noise_seed),
    )  # fmt: skip


def _truth(plan: RestPlan, site: Site, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return true specific force and rate, frame b, shape (n, 3) each, at any times."""
    starts, ends = plan.edges
    leg = np.clip(np.searchsorted(starts, time, side="right") - 1, 0, len(starts) - 1)
    turning = np.flatnonzero((time > ends[leg]) & (leg < len(starts) - 1))
    C_nb, w_b = plan.C_nb[leg], np.zeros((len(time), 3))
    j = leg[turning]
    span = plan.turn_time[j][:, None]
    tau = (time[turning] - ends[j])[:, None] / span
    s = tau**3 * (10 - 15 * tau + 6 * tau**2)
    phi = plan.rotation
    if phi is None:
        phi = log(np.swapaxes(plan.C_nb[:-1], 1, 2) @ plan.C_nb[1:])
    C, w = plan.C_nb[j] @ exp(phi[j] * s), phi[j] * (30 * tau**2 * (1 - tau) ** 2 / span)
    if plan.wobble is not None:
        wobble = exp(plan.wobble[j] * (64 * (tau * (1 - tau)) ** 3))
        bump_dot = 192 * (tau * (1 - tau)) ** 2 * (1 - 2 * tau) / span
        C = C @ wobble
        w = np.einsum("nji,nj->ni", wobble, w) + plan.wobble[j] * bump_dot
    C_nb[turning], w_b[turning] = C, w
    f_b = site.gravity * C_nb[:, 2, :]
    if plan.sway is not None:
        bump_ddot = 384 * tau * (1 - tau) * ((1 - 2 * tau) ** 2 - tau * (1 - tau)) / span**2
        f_b[turning] += np.einsum("nji,nj->ni", C, plan.sway[j] * bump_ddot)
    if site.latitude is not None:
        w_b += np.einsum("nji,j->ni", C_nb, earth_rate_n(site.latitude))
    return f_b, w_b
