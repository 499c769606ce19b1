"""The two steps of the source: first without the deflection, then with it.

The first part of the session is filtered with the errors of the instrument alone (33 states). Its
coefficients start a second filter with those of the deflection (39 states) over the rest, with
uncertainties that are set anew: carried over they would be too small, for the first filter took
deflection for misalignment.

References
----------
.. [1] Wu, Chen, Yan, Yuan, Guan, "Calibration and compensation of gyro sensitive-axis deflection
   under continuous rotation", *Navigation and Control* 2023(5), eqs. (17)-(19).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from foucault.coefficients import CoefficientVector
from foucault.estimate.ins_filter import run, start_cov
from foucault.estimate.systematic.fit import AtRest, SystematicRun
from foucault.models.earth import Site, gravity
from foucault.models.ins_errors import Sensors
from foucault.models.noise import ImuNoise
from foucault.navigate.increments import Increments

RESET = {
    "gyro.bias": np.radians(0.003) / 3600.0,
    "gyro.scale": 5e-6,
    "gyro.misalignment": np.radians(5.0 / 3600.0),
    "accel.bias": 10e-6 * 9.80665,
    "accel.scale": 5e-6,
    "accel.misalignment": np.radians(5.0 / 3600.0),
    "accel.asymmetry": 5e-6,
}
"""Standard deviations that the second step starts with; others keep theirs [SI]."""


def second_step(
    increments: Increments,
    site: Site,
    first: SystematicRun,
    sensors: Sensors,
    rests: Sequence[tuple[int, int]],
    prior: CoefficientVector,
    noise: ImuNoise,
    *,
    at_rest: AtRest | None = None,
) -> SystematicRun:
    """Go on with the deflection from where the first step has ended, in one pass.

    `site`: where it stands, the latitude must be known; `sensors`: coefficients of the second
    step: those of the first, and more; `rests`: first and last row of each rest of the whole
    session, in order [1]; `prior`: what was known of those that the first step did not have:
    values and prior_sd [SI]; `noise`: white noise of the sensors [SI]; `at_rest`: what is known
    at rest, None takes the defaults.
    """
    assert site.latitude is not None
    at_rest = at_rest or AtRest()
    names = first.estimate.layout.names
    values, sd = prior.values.copy(), prior.prior_sd.copy()
    keep = [sensors.layout.index(name) for name in names]
    values[keep], sd[keep] = first.estimate.values, first.estimate.sd
    for group, reset in RESET.items():
        sd[sensors.layout.group(group)] = reset
    last = increments.row_at(float(first.run.time[-1]))
    P = start_cov(first.run.attitude_cov, at_rest.velocity_sd, at_rest.position_sd, sd)
    two = run(
        increments, first.run.trajectory.state(-1), sensors,
        at_rest.updates(increments, rests, site, last), P, noise, first=last, estimate=values,
        gravity_offset=site.gravity - float(gravity(site.latitude, site.height)), keep=True,
    )  # fmt: skip
    return SystematicRun(two, two.estimate, (values, two.coefficients[-1]))
