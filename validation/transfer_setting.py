"""What the studies of transfer alignment have in common: sessions, errors at the end, outages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from common import each

from foucault.coefficients import CoefficientVector
from foucault.diagnose.study import nees
from foucault.estimate.transfer import HandOver, after_outage
from foucault.infer.linear_filter import LinearRun, by_prior
from foucault.kernels.ins_filter import corrected
from foucault.models.earth import Site, displacement
from foucault.models.imu import ImuModel
from foucault.models.noise import ImuNoise
from foucault.models.rotation import log as rotation_vector
from foucault.navigate.increments import increments_of
from foucault.navigate.ins_filter import seen_at_place
from foucault.navigate.strapdown import State, navigate, state_of
from foucault.procedures.transfer_alignment import simulate
from foucault.procedures.transfer_alignment.problem import Solution, handed_over, problem_of, solved
from foucault.procedures.transfer_alignment.session import (
    Session,
    TransferSession,
    draw_errors,
)
from foucault.procedures.transfer_alignment.settings import NOISE, Settings

SITE = Site.at(np.radians(32.0), 1000.0)
DEG = np.radians(1.0)
ARCMIN, DEG_H, UG, PPM = DEG / 60, DEG / 3600, 9.80665e-6, 1e-6
UNITS = {"gyro.bias": (DEG_H, "deg/h"), "gyro.scale": (PPM, "ppm"), "accel.bias": (UG, "ug"),
         "installation": (ARCMIN, "arcmin"), "master.delay": (1e-3, "ms"),
         "load": (ARCMIN, "arcmin/g")}  # fmt: skip


def session_of(seed: int, session: Session, settings: Settings | None = None) -> TransferSession:
    """Draw a slave of the publication's class, and simulate its session."""
    model = draw_errors("tactical", seed)
    return simulate(session, settings=settings, model=model, noise=NOISE, site=SITE, seed=seed)


def drawn_delay(seed: int) -> float:
    """Draw a delay of 0 to 200 ms."""
    return float(np.random.default_rng([seed, 10]).uniform(0.0, 0.2))


def found_in(
    made: TransferSession,
    settings: Settings,
    *,
    noise: ImuNoise = NOISE,
    given: dict[str, tuple[float, float]] | None = None,
) -> Solution:
    """Calibrate as the procedure does."""
    return solved(problem_of(made.log, SITE, settings, noise, given or {}), history=False)


def unit_of(name: str) -> tuple[float, str]:
    """Return the unit that a coefficient is shown in."""
    return next(unit for group, unit in UNITS.items() if name.startswith(group))


@dataclass(frozen=True)
class Missed:
    """Errors of a calibration: coefficients and what is found besides, then phi and velocity.

    All have the sense of the error states: truth minus estimate of the coefficients goes with
    estimate minus truth of attitude and velocity. `err` has both turned about.
    """

    names: tuple[str, ...]
    err: np.ndarray
    cov: np.ndarray

    @property
    def sd(self) -> np.ndarray:
        return np.asarray(np.sqrt(np.diag(self.cov)))

    def nees(self) -> float:
        """Return the normalised square of all."""
        return float(nees(self.err, self.cov))


def missed(made: TransferSession, solution: Solution) -> Missed:
    """Return the errors of all states at the last message but position and what is not matched."""
    found, names = solution.fit, solution.states.names
    run, layout = found.run, solution.model.layout
    state = state_of(corrected(found.system.history[-1:], run.states[-1:, :9])[0])
    time = float(solution.model.slave.increments.time[found.system.rows[-1]])
    true = made.made.truth.state(int(np.argmin(np.abs(made.made.log.time - time))))
    phi = rotation_vector(true.C_nb @ state.C_nb.T)  # C_est = (I - phi x) C_true
    dv = state.velocity_n - true.velocity_n
    # To phi, velocity and position as seen at the place.
    T = np.eye(len(layout))
    T[:9, :9] = seen_at_place(found.system.history[-1:])[0]
    P = T @ run.cov @ T.T
    ends = ("phi.east", "phi.north", "phi.up", "velocity.east", "velocity.north", "velocity.up")
    ends = ends if solution.problem.settings.matched.vertical else ends[:-1]
    rows = [*(layout.index(name) for name in names), *range(len(ends))]
    off = np.concatenate([-phi, -dv])[: len(ends)]
    err = np.concatenate([solution.states.values - truth_of(made, names), off])
    return Missed((*names, *ends), err, P[np.ix_(rows, rows)])


def truth_of(made: TransferSession, names: Sequence[str]) -> np.ndarray:
    """Return the true values of what is found."""
    both = made.model.coefficients(), made.beside
    return np.array([next(v for v in both if n in v.names)[n].values[0] for n in names])


def position_error(
    made: TransferSession, state: State, time: float, estimate: CoefficientVector | None
) -> float:
    """Return by how much the slave, alone with a barometer, misses its place at the end [m]."""
    log = made.outage
    if estimate is not None:
        log = ImuModel.from_coefficients(estimate).apply(log)
    begin = len(made.made.log) - len(log)
    increments = increments_of(log)
    run = navigate(increments, state, first=increments.row_at(time), vertical="aided",
                   heights=made.made.barometer[begin:])  # fmt: skip
    end, true = run.state(-1), made.made.truth.state(-1)
    place = (true.latitude, true.longitude, true.height)
    away = displacement(*place, end.latitude, end.longitude, end.height)
    return float(np.linalg.norm(away[:2]))


def wanted(solution: Solution, what: str = "prior") -> np.ndarray:
    """Return L: what a filter is for, in units of its prior; or the position after the outage.

    The position, and a vertical velocity that is not matched, are left out of the first: a free
    run knows its place a thousand times worse at its end than at its start, and that alone would
    make gamma, and with it the filter.
    """
    system, s = solution.fit.system, solution.problem.settings
    if what == "navigation":
        return after_outage(system, s.sensors, s.outage)
    L = by_prior(system)
    return np.delete(L, (6, 7, 8) if s.vertical else (5, 6, 7, 8), axis=0)


def handed(solution: Solution, run: LinearRun | None = None) -> HandOver:
    """Hand over what was found, or what another filter of the same system has found."""
    found = solution.fit if run is None else replace(solution.fit, run=run)
    return handed_over(replace(solution, fit=found))


def after(made: TransferSession, solution: Solution, run: LinearRun | None = None) -> float:
    """Return the position error at the end of the outage [m]."""
    ho = handed(solution, run)
    time = float(solution.model.slave.increments.time[ho.row])
    return position_error(made, ho.state, time, ho.coefficients)


def one_copy(made: TransferSession) -> float:
    """Return the same of a slave without calibration, from one copy of the master's state [m]."""
    table = made.made.master
    place = (float(x[-1]) for x in (table.latitude, table.longitude, table.height))
    state = State(*place, table.velocity_n[-1], table.C_nb[-1] @ made.made.slave.C_0)
    return position_error(made, state, float(table.time[-1]), None)


def at_best(made: TransferSession) -> float:
    """Return the same of a slave whose errors and state are known: the noise alone [m]."""
    log, time = made.made.log, made.made.hand_over
    row = int(np.argmin(np.abs(log.time - time)))
    return position_error(made, made.made.truth.state(row), time, made.model.coefficients())


def outages(one: Callable[[int], dict[str, float]], seeds: Sequence[int]) -> dict[str, np.ndarray]:
    """Return what `one` gives for each seed, by two processes at most."""
    rows = list(each(one, seeds))
    return {key: np.array([row[key] for row in rows]) for key in rows[0]}
