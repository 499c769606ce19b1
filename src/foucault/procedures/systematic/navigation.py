"""What a calibration is worth in navigation: a spin and a long rest, with it and without.

The navigation test of the source: x up, y east, z north; ten turns at 18 deg/s about east or north,
then 500 s of rest. The instrument is the one that was found; it is compensated by coefficients that
differ from its own as the covariance allows, one draw, so that what remains is no more nor less
than what is promised. Noise is left out: it is the same either way.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.models.deflection import DeflectionModel
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.layouts import model_of
from foucault.models.rotation import log as rotation_vector
from foucault.models.size_effect import SizeEffect
from foucault.navigate.align import align
from foucault.navigate.increments import increments_of
from foucault.navigate.state import State
from foucault.navigate.strapdown import navigate
from foucault.plans.systematic.built_in import navigation_test
from foucault.simulate.systematic import SystematicSimulation, simulate_systematic

RATE, BEFORE, REST = 50.0, 100.0, 500.0
"""Sample rate [Hz], rest before the spin, and after it [s]."""

EVERY = 5.0
"""Time between the points that are kept [s]."""


def navigation_tests(
    found: CoefficientVector, site: Site, model: DeflectionModel | None
) -> tuple[dict[str, npt.NDArray[Any]], list[dict[str, Any]]]:
    """Navigate the tests about east and about north.

    `found`: what was found, with covariance [SI]; `model` or None: the model of deflection, if
    there is one: then the tests are also done with everything but the deflection compensated.
    Returns `table`: which test, what is compensated, time since the spin began [s], velocity
    [m/s], and how far the attitude has moved since then [rad]: east, north, up; `ends`: of each
    test and compensation the tilt by the spin [rad] and the velocity at the end [m/s].
    """
    instrument, size = model_of(found), SizeEffect.of(found)
    assert isinstance(instrument, ImuModel)
    assert found.cov is not None
    values, vectors = np.linalg.eigh(found.cov / np.outer(found.sd, found.sd))
    z = np.random.default_rng(0).standard_normal(len(found))
    missed = found.sd * (vectors @ (np.sqrt(np.maximum(values, 0.0)) * z))
    told = CoefficientVector(found.layout, found.values + missed)
    ways = {"none": told.with_values(dict.fromkeys(told.names, 0.0)), "all": told}
    if model is not None:
        stiff = told.with_values(dict.fromkeys(model.names, 0.0))
        ways = {"none": ways["none"], "all but deflection": stiff, "all": told}
    rows: list[dict[str, npt.NDArray[Any]]] = []
    ends: list[dict[str, Any]] = []
    for about in ("east", "north"):
        made = simulate_systematic(navigation_test(about, before=BEFORE, rest=REST), site=site,
                                   model=instrument, rate=RATE, arms=size.arms,
                                   delay=size.delay)  # fmt: skip
        for way, by in ways.items():
            time, velocity, away = _navigated(made, by)
            n = len(time)
            rows.append({"about": np.full(n, about), "compensated": np.full(n, way), "time": time,
                         **_columns("velocity", velocity), **_columns("shift", away)})  # fmt: skip
            spun = made.sequence.actions[1].time
            at = int(np.searchsorted(time, spun - 1e-6))
            ends.append({"about": about, "compensated": way, "shift": away[at].tolist(),
                         "velocity": velocity[-1].tolist()})  # fmt: skip
    return {key: np.concatenate([row[key] for row in rows]) for key in rows[0]}, ends


def _columns(what: str, values: FloatArray) -> dict[str, npt.NDArray[Any]]:
    return {f"{what}_{way}": values[:, k] for k, way in enumerate(("east", "north", "up"))}


def _navigated(
    made: SystematicSimulation, by: CoefficientVector
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Align and navigate; return time since the spin began, velocity and change of attitude."""
    assert made.site.latitude is not None
    model = model_of(by)
    assert isinstance(model, ImuModel)
    increments = increments_of(SizeEffect.of(by).apply(model, made.log))
    first = increments.row_at(BEFORE)
    begin = align(increments, made.site, end=BEFORE)
    state = State.at_rest(begin.C_nb, made.site.latitude, 0.0, made.site.height)
    offset = made.site.anomaly
    run = navigate(increments, state, first=first, gravity_offset=offset, vertical="held")
    rows = np.arange(0, len(run.time), round(EVERY * RATE))
    time = run.time[rows]
    # C_est = (I - [phi x]) C_true
    phi = -rotation_vector(run.C_nb[rows] @ np.swapaxes(made.attitude(time), 1, 2))
    return time - time[0], run.velocity_n[rows], phi - phi[0]
