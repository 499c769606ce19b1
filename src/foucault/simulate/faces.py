"""Simulate rests on the six faces, with turns about the vertical where they are wanted.

A rest on a face is off by a random angle about each of two level axes, the placement. A turn is
about an axis that is off the vertical by another one, for the support is not level, and its angle
is not quite what it should be::

    C_nb(t) = C_s Exp(phi s(t))      phi = angle axis_b for a turn, log(C_s' C_e) for a move

with a smooth s from 0 to 1, so that the true rate is ``phi s'``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from foucault.arrays import FloatArray
from foucault.models.earth import Site, earth_rate_n
from foucault.models.faces import SIX
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise
from foucault.models.rotation import aligning, exp, log
from foucault.simulate.hand_rotated import Simulation
from foucault.simulate.noise import sampled_log
from foucault.tables import whole_samples


@dataclass(frozen=True)
class FacePlan:
    """Rests, and the rotations between them."""

    C_nb: FloatArray  # (n, 3, 3) attitude of each rest, body to East-North-Up [1]
    # (n - 1, 3) rotation vector from each rest to the next, of any size, body axes [rad]
    rotation: FloatArray
    rest_time: FloatArray  # (n,) length of each rest [s]
    move_time: FloatArray  # (n - 1,) length of each rotation [s]

    @property
    def edges(self) -> tuple[FloatArray, FloatArray]:
        """Beginning and end of each rest, shape (n,) each [s]."""
        moves = np.concatenate([[0.0], self.move_time])
        starts = np.cumsum(moves) + np.concatenate([[0.0], np.cumsum(self.rest_time)[:-1]])
        return starts, starts + self.rest_time


def face_plan(
    *,
    rest_time: float = 10.0,
    move_time: float = 2.0,
    turn_time: float = 5.0,
    angle: float | tuple[float, float, float] | None = None,
    placement_sd: float = 0.0,
    level_sd: float = 0.0,
    angle_sd: float = 0.0,
    seed: int = 0,
) -> FacePlan:
    """Plan the six faces, and a turn and another rest on each face with an axis up.

    `rest_time`, `move_time`, `turn_time`: length of each rest, of a move to another face and of a
    turn [s]; `angle`: angle of the turns about the axis that is up, of all or of x, y and z, None
    plans no turns [rad]; `placement_sd`, `level_sd`, `angle_sd`: standard deviation of the tilt
    of each placement about each axis, of the axis of a turn against the vertical, and of its
    angle [rad]; `seed`: seed of headings and errors [1].
    """
    rng = np.random.default_rng(seed)
    z = np.array([0.0, 0.0, 1.0])
    attitudes: list[FloatArray] = []
    rotations: list[FloatArray] = []
    times: list[float] = []
    for axis, sign in (*SIX[4:], *SIX[:4]):  # z up first, as logs are described by default
        u = sign * np.eye(3)[axis]
        up_b = _tilted(u, placement_sd, rng)
        C = exp(rng.uniform(-np.pi, np.pi) * z) @ aligning(up_b, z)
        if attitudes:
            rotations.append(log(attitudes[-1].T @ C))
            times.append(move_time)
        attitudes.append(C)
        if angle is not None and sign > 0:
            nominal = float(np.broadcast_to(angle, 3)[axis])
            turned = (nominal + angle_sd * rng.standard_normal()) * _tilted(up_b, level_sd, rng)
            rotations.append(turned)
            times.append(turn_time)
            attitudes.append(C @ exp(turned))
    return FacePlan(
        np.array(attitudes), np.array(rotations), np.full(len(attitudes), rest_time),
        np.array(times),
    )  # fmt: skip


def _tilted(u: FloatArray, sd: float, rng: np.random.Generator) -> FloatArray:
    """Turn a unit vector by random angles about two axes across it."""
    draw = sd * rng.standard_normal(3)
    return np.asarray(exp(draw - (draw @ u) * u) @ u)


def simulate(
    plan: FacePlan,
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


def _truth(plan: FacePlan, site: Site, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return true specific force and rate, frame b, shape (n, 3) each, at any times."""
    starts, ends = plan.edges
    leg = np.clip(np.searchsorted(starts, time, side="right") - 1, 0, len(starts) - 1)
    moving = np.flatnonzero((time > ends[leg]) & (leg < len(starts) - 1))
    C_nb, w_b = plan.C_nb[leg], np.zeros((len(time), 3))
    j = leg[moving]
    span = plan.move_time[j][:, None]
    tau = (time[moving] - ends[j])[:, None] / span
    s = tau**3 * (10 - 15 * tau + 6 * tau**2)
    C_nb[moving] = plan.C_nb[j] @ exp(plan.rotation[j] * s)
    w_b[moving] = plan.rotation[j] * (30 * tau**2 * (1 - tau) ** 2 / span)
    if site.latitude is not None:
        w_b += np.einsum("nji,j->ni", C_nb, earth_rate_n(site.latitude))
    return site.gravity * C_nb[:, 2, :], w_b
