"""The setting of the paper on the tumbling platform, shared by the scripts of that name.

Its plan of 5400 s at 0.1 deg/s, readings every 0.2 s with 1 ug of noise, gyros of 0.05 deg/h in
steps of 2 ms, errors drawn about its means, start 2, 3 and 5 deg off; latitude 40 deg, where it
states none. Rows, signs and units of its Table 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.estimate.tumble import Prior, State, Tumble
from foucault.models.cluster import (
    CONSTANTS,
    SOURCE_SYMBOLS,
    ClusterModel,
    angle_rates,
    angles_of,
    attitude_of,
    normalised,
)
from foucault.models.earth import Site, earth_rate_n
from foucault.models.noise import ImuNoise
from foucault.models.rotation import log
from foucault.plans.tumble import TorquingPlan
from foucault.procedures.platform_tumble import simulate as simulated
from foucault.procedures.platform_tumble.settings import (
    NOISE,
    PRIOR,
    Session,
    Settings,
    draw_printed,
)
from foucault.simulate.tumble import Acquisition, TumbleSimulation, simulate_tumble

G = 9.80665
DEG = np.radians(1.0)
ARCSEC = DEG / 3600
SITE = Site(G, 40 * DEG)
ARMS = (("5 cm", "0 m", "0 m"), ("0 m", "5 cm", "0 m"), ("0 m", "0 m", "5 cm"))
SETTINGS = Settings(arms=ARMS, latitude_sd="0 deg")
BLOCK = 5
"""Readings that are averaged to one residual, 1 s of them."""
SEED = 2015

# Source's symbol: unit, printed mean and std of |error|, and the bound of another program.
TABLE = {
    "alpha": ("arcsec", 0.7623, 0.6582, 0.03360), "beta": ("arcsec", 0.9561, 0.7562, 12.03221),
    "gamma": ("arcsec", 0.6812, 0.6213, 0.20916),
    "kg0x": ("deg/h", 0.0003, 0.0002, 0.00025), "kg0y": ("deg/h", 0.0004, 0.0003, 0.00024),
    "kg0z": ("deg/h", 0.0009, 0.0009, 0.00021),
    "kg11x": ("deg/h/g", 0.0033, 0.0027, 0.00228), "kg11y": ("deg/h/g", 0.0033, 0.0032, 0.00228),
    "kg11z": ("deg/h/g", 0.0049, 0.0058, 0.00229), "kg12x": ("deg/h/g", 0.0008, 0.0005, 0.00019),
    "kg12y": ("deg/h/g", 0.0011, 0.0007, 0.00018), "kg12z": ("deg/h/g", 0.0050, 0.0030, 0.00049),
    "kg13x": ("deg/h/g", 0.0005, 0.0003, 0.00023), "kg13y": ("deg/h/g", 0.0005, 0.0004, 0.00024),
    "kg13z": ("deg/h/g", 0.0047, 0.0030, 0.00045),
    "ka0x": ("ug", 0.2576, 0.0425, 0.12400), "ka0y": ("ug", 0.2378, 0.0486, 0.11972),
    "ka0z": ("ug", 0.3344, 0.0453, 0.04279),
    "ka1x": ("ppm", 0.1039, 0.0157, 0.02070), "ka1y": ("ppm", 0.0695, 0.0127, 0.02107),
    "ka1z": ("ppm", 0.0680, 0.0126, 0.02269),
    "Dxy": ("arcsec", 1.2220, 1.0543, 0.38376), "Dxz": ("arcsec", 2.4025, 1.6516, 0.15276),
    "Dyx": ("arcsec", 0.4462, 0.3202, 0.35543), "Dyz": ("arcsec", 1.4760, 1.1601, 0.15163),
    "Dzx": ("arcsec", 0.2205, 0.1823, 0.16229), "Dzy": ("arcsec", 0.3292, 0.3231, 0.21859),
    "th_yz": ("arcsec", 0.0323, 0.0291, 0.01060), "th_zx": ("arcsec", 0.0514, 0.0367, 0.02095),
    "th_zy": ("arcsec", 0.0427, 0.0480, 0.02185),
    "dKx": ("ppm", 1.4657, 0.2596, 0.79966), "dKy": ("ppm", 4.8297, 0.6462, 0.79247),
    "dKz": ("ppm", 2.0779, 0.4802, 0.66568),
    "ka2x": ("ug/g^2", 0.2431, 0.0387, 0.10728), "ka2y": ("ug/g^2", 0.2173, 0.0457, 0.10445),
    "ka2z": ("ug/g^2", 0.3648, 0.0481, 0.05116),
    "kg31x": ("deg/h/g^2", 0.0039, 0.0030, 0.00092),
    "kg31y": ("deg/h/g^2", 0.0043, 0.0037, 0.00090),
    "kg31z": ("deg/h/g^2", 0.0018, 0.0016, 0.00055),
    "kg32x": ("deg/h/g^2", 0.0012, 0.0008, 0.00100),
    "kg32y": ("deg/h/g^2", 0.0013, 0.0011, 0.00098),
    "kg32z": ("deg/h/g^2", 0.0024, 0.0015, 0.00057),
    "kg33x": ("deg/h/g^2", 0.0008, 0.0007, 0.00033),
    "kg33y": ("deg/h/g^2", 0.0029, 0.0020, 0.00032),
    "kg33z": ("deg/h/g^2", 0.0026, 0.0019, 0.00041),
}  # fmt: skip
SYMBOLS = tuple(TABLE)
NAME_OF = {symbol: name for name, (symbol, _) in SOURCE_SYMBOLS.items()}
NAMES = tuple(NAME_OF[symbol] for symbol in SYMBOLS)
UNITS = tuple(row[0] for row in TABLE.values())
MEAN, STD, OTHER = np.array([row[1:] for row in TABLE.values()]).T
SIZE = {
    "arcsec": ARCSEC, "deg/h": ARCSEC, "deg/h/g": ARCSEC, "deg/h/g^2": ARCSEC, "ug": 1e-6,
    "ug/g^2": 1e-6, "ppm": 1e-6,
}  # fmt: skip
"""Packed, where local gravity is 1; ARCSEC per second is one deg/h."""


@dataclass(frozen=True)
class Run:
    """One tumble: what the estimators get, and the truth."""

    tumble: Tumble
    prior: Prior
    truth: State
    C_pn: np.ndarray
    model: ClusterModel
    simulation: TumbleSimulation

    def errors(self, C_np: np.ndarray, constants: np.ndarray) -> np.ndarray:
        """Estimate minus truth, shape (45,): attitude, a rotation vector in p, and constants."""
        return np.append(log(self.C_pn @ C_np), constants - self.truth.constants)

    @property
    def to_source(self) -> np.ndarray:
        """Matrix that turns those into the rows, signs and units of the source."""
        out = np.zeros((45, 45))
        for row, (name, unit) in enumerate(zip(NAMES, UNITS, strict=True)):
            if row < 3:
                out[row, :3] = angle_rates(angles_of(self.C_pn))[row] / SIZE[unit]
            else:
                out[row, 3 + CONSTANTS.index(name)] = SOURCE_SYMBOLS[name][1] / SIZE[unit]
        return out

    def sd(self, cov: np.ndarray) -> np.ndarray:
        """Standard deviations of the rows of the source."""
        return np.sqrt(np.diag(self.to_source @ cov[:45, :45] @ self.to_source.T))


def prior_of(start: np.ndarray, attitude_sd: float = 5 * DEG) -> Prior:
    """Zero, give or take one mean of the table; attitude 5 deg."""
    sd = [PRIOR[name.rpartition(".")[0]][1] for name in CONSTANTS.names] * normalised(G)
    at = State(attitude_of(start).T, np.zeros(42))
    return Prior(at, np.concatenate([np.full(3, attitude_sd), sd, [0.0]]))


def run_of(made: TumbleSimulation, block: int = BLOCK, noise: ImuNoise = NOISE) -> Run:
    """What a simulation gives to the estimators; they are told the `noise`."""
    dt = np.diff(made.log.time)
    arms = made.acquisition.arms
    assert made.log.gyro is not None and made.log.accel is not None
    assert made.site.latitude is not None
    tumble = Tumble(
        dt, np.ascontiguousarray(made.log.gyro[:-1]), made.log.accel[1:] / G,
        np.ones(len(dt), bool), earth_rate_n(made.site.latitude), G, noise.gyro.white**2,
        (noise.accel.white / G) ** 2 / made.log.interval,
        np.zeros((3, 3)) if arms is None else arms, False, block,
    )  # fmt: skip
    truth = State(made.C_pn[0].T, made.model.packed(G))
    prior = prior_of(np.asarray(made.plan.start))
    return Run(tumble, prior, truth, made.C_pn[1], made.model, made)


def session(seeds: np.random.SeedSequence) -> Run:
    """One run of the setting of the source."""
    errors, noise = (int(s) for s in seeds.generate_state(2))
    made = simulated(Session(), settings=SETTINGS, model=draw_printed(errors), noise=NOISE,
                     site=SITE, seed=noise)  # fmt: skip
    return run_of(made)


def silent(
    plan: TorquingPlan, model: ClusterModel, start: np.ndarray, *, site: Site = SITE,
    integrator: str = "exponential",
) -> TumbleSimulation:  # fmt: skip
    """The same without noise."""
    return simulate_tumble(
        plan, model=model, noise=ImuNoise(), site=site, start=start,
        acquisition=Acquisition(arms=SETTINGS.lever_arms), integrator=integrator,
    )  # fmt: skip
