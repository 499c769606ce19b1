"""Simulate a hand-rotated session: the log a user would save, with the truth beside it.

Between two rests the attitude is ``C_nb(t) = C_s Exp(phi s(t)) Exp(wobble b(t))`` with smooth
s from 0 to 1 and a smooth bump b, so that the true rate is known in closed form::

    w_nb_b = Exp(wobble b)' phi s' + wobble b'
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.models.earth import Site, earth_rate_n
from foucault.models.imu import LINEAR_LOWER, ImuModel
from foucault.models.noise import ImuNoise, grade
from foucault.models.rotation import exp, log
from foucault.plans.hand_rotated import HandPlan
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
    plan: HandPlan,
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
    n = whole_samples(np.floor(plan.duration * rate)) + 1
    readout = sampled_log(
        partial(_truth, plan, site), samples=n, rate=rate, sampled=sampled,
        model=model, noise=noise, rng=np.random.default_rng(seed),
    )  # fmt: skip
    starts, ends = _rest_edges(plan)
    first = np.ceil(starts * rate - 1e-9).astype(np.int64)
    last = np.floor(ends * rate + 1e-9).astype(np.int64) + 1
    if sampled == "increment":
        first[1:] += 1  # the first interval that lies in the rest as a whole
    return Simulation(readout, model, first, np.minimum(last, n), plan.C_nb)


def _rest_edges(plan: HandPlan) -> tuple[FloatArray, FloatArray]:
    turns = np.concatenate([[0.0], plan.turn_time])
    starts = np.cumsum(turns) + np.concatenate([[0.0], np.cumsum(plan.rest_time)[:-1]])
    return starts, starts + plan.rest_time


def _truth(plan: HandPlan, site: Site, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return true specific force and rate, frame b, shape (n, 3) each, at any times."""
    starts, ends = _rest_edges(plan)
    leg = np.clip(np.searchsorted(starts, time, side="right") - 1, 0, len(starts) - 1)
    turning = np.flatnonzero((time > ends[leg]) & (leg < len(starts) - 1))
    C_nb = plan.C_nb[leg]
    w_nb = np.zeros((len(time), 3))
    a_n = np.zeros((len(time), 3))

    j = leg[turning]
    span = plan.turn_time[j][:, None]
    tau = (time[turning] - ends[j])[:, None] / span
    phi = log(np.swapaxes(plan.C_nb[:-1], 1, 2) @ plan.C_nb[1:])[j]
    s = tau**3 * (10 - 15 * tau + 6 * tau**2)
    s_dot = 30 * tau**2 * (1 - tau) ** 2 / span
    bump = 64 * (tau * (1 - tau)) ** 3
    bump_dot = 192 * (tau * (1 - tau)) ** 2 * (1 - 2 * tau) / span
    bump_ddot = 384 * tau * (1 - tau) * ((1 - 2 * tau) ** 2 - tau * (1 - tau)) / span**2
    wobble = exp(plan.wobble[j] * bump)
    C_nb[turning] = plan.C_nb[j] @ exp(phi * s) @ wobble
    w_nb[turning] = np.einsum("nji,nj->ni", wobble, phi * s_dot) + plan.wobble[j] * bump_dot
    a_n[turning] = plan.sway[j] * bump_ddot

    a_n[:, 2] += site.gravity
    w_ie = np.zeros(3) if site.latitude is None else earth_rate_n(site.latitude)
    f_b = np.einsum("nji,nj->ni", C_nb, a_n)
    w_b = w_nb + np.einsum("nji,j->ni", C_nb, w_ie)
    return f_b, w_b
