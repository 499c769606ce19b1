"""Plans of a drive and a flight, and an integrator that shares nothing with the simulator."""

from __future__ import annotations

import numpy as np

from foucault.models.earth import EARTH_RATE, east_north_up, ecef, geodetic, gravity_n
from foucault.models.rotation import cross_matrix
from foucault.plans.manoeuvres import (
    Accelerate,
    Climb,
    Plan,
    Rest,
    Rotate,
    Start,
    Straight,
    STurn,
    Sway,
    Turn,
)
from foucault.simulate.motion import Motion

DEG = np.pi / 180

START = Start(50 * DEG, 10 * DEG, 200.0, heading=30 * DEG, pitch=1 * DEG, roll=-2 * DEG)


def drive(rounds: int = 8) -> Plan:
    """Plan a drive of a survey vehicle: people in it, a table in it, streets."""
    sway = Sway(40.0, 2.0, (1 * DEG, 1 * DEG, 1 * DEG), (0.02, 0.02, 0.03), tones=4)
    table = (
        Rotate("z", 90 * DEG, 20 * DEG), Rotate("north", -30 * DEG, 10 * DEG),
        Rotate("north", 30 * DEG, 10 * DEG),
    )  # fmt: skip
    street = (
        Accelerate(15.0, 10.0), Straight(20.0), Turn(80 * DEG, 10.0, banked=False),
        STurn(20 * DEG, 12.0, banked=False), Climb(5.0, angle=4 * DEG), Straight(10.0),
        Climb(5.0, angle=0.0), Turn(-120 * DEG, 15.0, ramp=2.0), Accelerate(0.0, 8.0), Rest(10.0),
    )  # fmt: skip
    return [Rest(60.0, label="align"), sway, *table, *(rounds * street)]


def flight(rounds: int = 5) -> Plan:
    """Plan a flight: take-off, climb, banked turns, gusts."""
    gusts = Sway(20.0, 1.5, (1 * DEG, 2 * DEG, 3 * DEG), (0.1, 0.1, 0.2), tones=3)
    leg = (
        Turn(100 * DEG, 40.0), Straight(10.0), Climb(30.0, height=-100.0), STurn(40 * DEG, 40.0),
        gusts,
    )  # fmt: skip
    begin = (
        Rest(30.0),
        Accelerate(80.0, 30.0),
        Climb(60.0, height=1000.0),
        Accelerate(200.0, 60.0),
    )
    return [*begin, *(rounds * leg)]


def integrated(
    motion: Motion, edges: np.ndarray, offset: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Integrate what the instrument feels in frame e, by Gauss's method of order 12.

    ``C_eb' = C_eb [w_ib_b x] - [w_ie x] C_eb``, ``v_e' = C_eb f_b + g_e - 2 w_ie x v_e``,
    ``r_e' = v_e``. Returns C_eb, v_e, r_e where `edges` end; starts as the motion does.
    """
    stages = 6
    x = (np.polynomial.legendre.leggauss(stages)[0] + 1) / 2
    powers = np.arange(1, stages + 1)
    inverse = np.linalg.inv(np.vander(x, stages, increasing=True))
    inner, outer = (x[:, None] ** powers / powers) @ inverse, (1 / powers) @ inverse
    h = np.diff(edges)
    f_b, w_b = motion.truth((edges[:-1, None] + h[:, None] * x).ravel())
    f_b, W = f_b.reshape(-1, stages, 3, 1), cross_matrix(w_b).reshape(-1, stages, 3, 3)
    earth = cross_matrix(np.array([0.0, 0.0, EARTH_RATE]))

    def slope(y: np.ndarray, i: int) -> np.ndarray:
        C, v = y[:, :9].reshape(-1, 3, 3), y[:, 9:12]
        L, lon, height = geodetic(y[:, 12:])
        g = (east_north_up(L, lon) @ gravity_n(L, height, offset)[:, :, None])[:, :, 0]
        dv = (C @ f_b[i])[:, :, 0] + g - 2 * v @ earth.T
        return np.concatenate([(C @ W[i] - earth @ C).reshape(-1, 9), dv, v], axis=1)

    at = motion.trajectory(edges[:1])
    C_en = east_north_up(at.latitude[0], at.longitude[0])
    r = ecef(at.latitude[0], at.longitude[0], at.height[0])
    y = np.concatenate([(C_en @ at.C_nb[0]).ravel(), C_en @ at.velocity_n[0], r])
    lost, nodes = np.zeros_like(y), np.tile(y, (stages, 1))
    for i in range(len(h)):
        for _ in range(20):
            before, nodes = nodes, y + h[i] * inner @ slope(nodes, i)
            if np.abs(nodes - before).max() < 3e-9:
                break
        step = h[i] * outer @ slope(nodes, i) + lost  # Kahan's sum
        lost, y = step - ((y + step) - y), y + step
        nodes = nodes + (y - nodes[-1])
    return y[:9].reshape(3, 3), y[9:12], y[12:]
