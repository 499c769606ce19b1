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

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.estimate.ins_filter import FilterRun, run, start_cov
from foucault.estimate.systematic.fit import SystematicModel

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
    model: SystematicModel, first: FilterRun, estimate: CoefficientVector, prior: CoefficientVector
) -> tuple[FilterRun, FloatArray]:
    """Go on with the deflection from where the first step has ended, in one pass.

    `model`: the whole session, with the coefficients of the second step: those of the first, and
    more; `estimate`: what the first has found, with covariance [SI]; `prior`: what was known of
    those that it did not have: values and prior_sd [SI]. Returns the run, and the coefficients
    (p,) it began with [SI].
    """
    at_rest, increments, layout = model.at_rest, model.increments, model.sensors.layout
    values, sd = prior.values.copy(), prior.prior_sd.copy()
    keep = [layout.index(name) for name in estimate.layout.names]
    values[keep], sd[keep] = estimate.values, estimate.sd
    for group, reset in RESET.items():
        sd[layout.group(group)] = reset
    last = increments.row_at(float(first.time[-1]))
    P = start_cov(first.attitude_cov, at_rest.velocity_sd, at_rest.position_sd, sd)
    two = run(
        increments, first.trajectory.state(-1), model.sensors,
        at_rest.updates(increments, model.rests, model.site, last), P, model.noise, first=last,
        estimate=values, gravity_offset=model.site.anomaly, keep=True,
    )  # fmt: skip
    return two, values
