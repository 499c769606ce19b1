"""What a point of a vehicle away from its master goes through, without errors and noise.

The slave sits at l from the master, in the master's body axes m. With everything resolved in m::

    r_s = r_m + C_em l        v_s = v_m + C_nm (w_em x l)
    f_s = f_m + w x (w x l) + w' x l - (G(r_s) - G(r_m))           w = w_im

G is gravitation, gravity without the centrifugal force of the Earth; its difference is 3e-6 of a
g per metre, which is 20 cm in 200 s. The integral of ``w' x l`` over an interval is ``(w(end) -
w(begin)) x l``; the rest is integrated as in `simulate.motion`. Nothing is left out: navigated
without errors, the increments lead to where the slave is.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from foucault.arrays import FloatArray
from foucault.models.earth import EARTH_RATE, earth_rate_n, gravity_n
from foucault.models.geodesy import displaced, east_north_up, ecef
from foucault.plans.manoeuvres import Segment, Start
from foucault.simulate.motion import Motion, TrueTrajectory, motion_of
from foucault.tables import whole_samples

_KEPT = 4  # motions whose increments are kept: trials that differ in noise share them


@dataclass(frozen=True)
class CarriedMotion:
    """A point of a vehicle that moves, with axes parallel to those of the master."""

    motion: Motion  # motion of the master at any time
    # label of each segment of the plan, its beginning and end [s]
    labels: list[tuple[str, float, float]]
    dtheta_m: FloatArray  # (n, 3) increments of angle, frame m [rad]
    dvel_m: FloatArray  # (n, 3) increments of velocity where the slave is, frame m [m/s]
    # (n + 1,) specific force along z of the master where the slave is, at both ends of the
    # intervals [m/s^2]
    lift: FloatArray
    C_mn: FloatArray  # (n, 3, 3) from East-North-Up to m in the middle of the intervals [1]
    truth: TrueTrajectory  # where the point is at the ends of the intervals; its axes b are m


@lru_cache(_KEPT)
def carried(
    plan: tuple[Segment, ...], start: Start, rate: float, lever: tuple[float, float, float]
) -> CarriedMotion:
    """Return what a point of a vehicle goes through; arrays are shared and read-only.

    `rate`: intervals in a second, the first ends at time 0 [Hz]; `lever`: from the master to the
    point, frame m [m].
    """
    motion, labels = motion_of(plan, start, lead=1.0 / rate)
    time = np.arange(-1, whole_samples(np.floor(motion.end * rate + 1e-9)) + 1) / rate
    arm = np.array(lever)
    f, w = motion.truth(time)
    master = motion.trajectory(time)
    truth = displaced_truth(master, w, arm)
    pull = _gravitation(truth) - _gravitation(master)  # frame e
    C_em = east_north_up(master.latitude, master.longitude) @ master.C_nb
    less_m = _rotated_back(C_em, pull)

    def reading(f_b: FloatArray, w_b: FloatArray) -> tuple[FloatArray, FloatArray]:
        return f_b + np.cross(w_b, np.cross(w_b, arm)), w_b

    dtheta, dvel = motion.increments(time, reading)
    dvel += np.cross(np.diff(w, axis=0), arm) - (less_m[1:] + less_m[:-1]) / (2 * rate)
    spin = np.gradient(w, 1.0 / rate, axis=0)
    there = f + np.cross(w, np.cross(w, arm)) + np.cross(spin, arm) - less_m
    C_nm = truth.C_nb
    middle = np.swapaxes(C_nm[1:] + C_nm[:-1], 1, 2) / 2
    made = (dtheta, dvel, np.ascontiguousarray(there[:, 2]), middle)
    later = TrueTrajectory(*(np.ascontiguousarray(getattr(truth, name)[1:]) for name in _TRUTH))
    for array in (*made, *(getattr(later, name) for name in _TRUTH)):
        array.setflags(write=False)
    return CarriedMotion(motion, labels, *made, later)


_TRUTH = ("time", "latitude", "longitude", "height", "velocity_n", "C_nb")


def displaced_truth(master: TrueTrajectory, w_im_m: FloatArray, arm: FloatArray) -> TrueTrajectory:
    """Return where a point of the vehicle is, its velocity, and C_nm in its own East-North-Up.

    `w_im_m` (n, 3): its angular rate, frame m [rad/s]; `arm` (3,): from the master to the point,
    frame m [m].
    """
    C_nm = master.C_nb
    w_em = w_im_m - _rotated_back(C_nm, earth_rate_n(master.latitude))
    arm_n = C_nm @ arm
    place = displaced(master.latitude, master.longitude, master.height, arm_n)
    v_n = master.velocity_n + _rotated(C_nm, np.cross(w_em, arm))
    # Its own East and North differ from those of the master by some 1e-7 rad per metre.
    C_en = east_north_up(master.latitude, master.longitude)
    C_own = np.swapaxes(east_north_up(place[0], place[1]), 1, 2) @ C_en
    return TrueTrajectory(master.time, *place, _rotated(C_own, v_n), C_own @ C_nm)


def _gravitation(at: TrueTrajectory) -> FloatArray:
    """Return gravity without the centrifugal force, frame e, shape (n, 3) [m/s^2]."""
    C_en = east_north_up(at.latitude, at.longitude)
    out = _rotated(C_en, gravity_n(at.latitude, at.height))
    out[:, :2] -= EARTH_RATE**2 * ecef(at.latitude, at.longitude, at.height)[:, :2]
    return out


def _rotated(C: FloatArray, x: FloatArray) -> FloatArray:
    return np.asarray((C @ x[:, :, None])[:, :, 0])


def _rotated_back(C: FloatArray, x: FloatArray) -> FloatArray:
    return np.asarray((x[:, None, :] @ C)[:, 0])
