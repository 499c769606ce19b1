"""Judge a calibration on a table: every check, with its limits and its sentence."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose import fit_checks
from foucault.diagnose.checks import (
    left_out_check,
    reversed_earth_at_rest,
    reversed_earth_check,
)
from foucault.diagnose.fit_checks import Judged, Limit
from foucault.estimate.chi_square import chi_square_limits
from foucault.estimate.drift import LeftOut, find_left_out
from foucault.estimate.table.fit import TableFit
from foucault.estimate.table.likelihood import ALONG, AT_REST, FORCES, FOUND_IN, IN_SPINS
from foucault.models.imu import LAYOUT
from foucault.models.readings import Readings
from foucault.models.table_geometry import Angles
from foucault.result import Check, Level
from foucault.tables import AXES
from foucault.units import plain

UNITS = {
    "accel": (1 / 9.80665e-6, "ug"),
    "gyro": (180 / np.pi * 3600, "deg/h"),
    "rate": (1e6, "ppm"),
}
"""How people read scatter."""

SIGNIFICANT = 5.0
"""A dependence on orientation of this many sd is no chance, largest of nine as it is [1]."""

UNKNOWN_NOISE = "readings.noise_unknown"
"""Finding of a log of means for which no noise was declared."""

LARGE = {"accel": 0.05, "gyro": np.radians(0.1), "rate": 1e-2}
"""Scatter beyond the noise that is no longer a calibration: 5 mg [m/s^2], 0.1 deg/s [rad/s], 1 %
of the rate [1]."""

QUADRATIC = "quadratic terms of the accelerometers"
"""Name of the check of terms that were left out."""

_LIMITS = {
    source: Limit(
        f"The {what}", LARGE[triad], *UNITS[triad],
        "the table moved, or the readings do not belong together", Level.UNUSABLE,
    )
    for source, what, triad in (
        (FORCES, "specific force", "accel"), (AT_REST, "rate at rest", "gyro"),
        (IN_SPINS, "rate in spins", "gyro"), (ALONG, "rate of the spins", "rate"),
    )
}  # fmt: skip

_WHAT = {
    "accel at rest": "specific force at rest",
    "accel in spins": "specific force in spins",
    "gyro at rest": "angular rate at rest",
    "gyro in spins": "angular rate in spins, across the axis",
    "rate of spins": "angular rate in spins, along the axis",
}


def checks(e: TableFit) -> tuple[Check, ...]:
    """Return every test of the result; a failed one carries its reason."""
    estimate = e.estimate
    judged = _judged(e)
    # How a bad reading would be noticed, the control of the rests says in full.
    out = [c for c in fit_checks.checks(judged) if c.name != "redundancy"] + _g_sensitivity(e)
    sign = reversed_earth_check(estimate.coefficients, e.model.site)
    sign = sign or _earth_at_rest(e)
    out += [sign] if sign is not None else []
    out += [_outliers(e), _controlled(e), *_rate_as_declared(e)]
    if isinstance(estimate.state.geometry, Angles):
        out += _table(e)
    out += left_out_check(
        _quadratic(judged, e), LAYOUT, QUADRATIC,
        "Set accel_quadratic = true, in a plan that shows them.",
    )  # fmt: skip
    return tuple(out)


def _judged(e: TableFit) -> Judged:
    r = e.model.readings
    return Judged(
        e.fit, _WHAT, r.noise_from, (r.start + r.time / 2)[e.model.rows % len(r)],
        found_in=FOUND_IN, limits=_LIMITS, cure="Measure more positions.",
        more="measure more positions",
    )  # fmt: skip


def _quadratic(judged: Judged, e: TableFit) -> LeftOut | None:
    """Return quadratic terms as the residuals show them, where they were not estimated."""
    fit, o = e.fit, e.model.options
    names = tuple(f"accel.quadratic.{a}" for a in AXES)
    if e.model.readings.accel is None or set(names) & set(o.names):
        return None
    more = replace(e.model, options=replace(o, names=(*o.names, *names)))
    slope = more.linearise(fit.state).jacobian[:, :, len(o.names) : len(o.names) + len(names)]
    columns = np.zeros((len(fit.white.residuals), len(names)))  # no prior of others knows them
    columns[: slope.shape[0] * slope.shape[1]] = fit.covariance.whiten(slope)
    return find_left_out(fit.white, names, columns, kinds=fit_checks.scattering(judged))


def agreement(coefficients: CoefficientVector, likelihood: CoefficientVector) -> Check:
    """Compare another solution with the likelihood's: a bias of its own shows in no residual.

    `coefficients`: the solution, with covariance [SI]; `likelihood`: that of the likelihood [SI].
    """
    own = np.array([likelihood.value(name) for name in coefficients.names])
    off = np.abs(coefficients.values - own) / coefficients.sd
    worst, limit = int(np.argmax(off)), 4.0
    fine = bool(off[worst] <= limit)
    words = f"{coefficients.names[worst]} is {off[worst]:.1f} sd from the likelihood's" + (
        "."
        if fine
        else ": this solution neglects terms that are not small here, and its uncertainties do not "
        "know it."
    )
    return Check("agreement with the likelihood", float(off[worst]), None, limit, fine, words)


@dataclass(frozen=True)
class Slope:
    """How rates at rest depend on orientation: g-sensitivity where it is not the Earth's rate."""

    slope: float  # largest change of an axis per g [rad/s]
    sd: float  # its standard deviation [rad/s]
    # what it does to gyro scale factors, 0 where spins in both senses tell the two apart [1]
    shift: float

    @property
    def significant(self) -> bool:
        """Whether it is more than chance."""
        return self.slope > SIGNIFICANT * self.sd


def _earth_at_rest(e: TableFit) -> Check | None:
    """Look for a reversed Earth rate in the rests, where no g-sensitivity takes it up."""
    r, state, names = e.model.readings, e.estimate.state, e.model.options.names
    rest = ~r.spin
    if r.gyro is None or "gyro.scale.x" not in names or "gyro.g_sensitivity.xx" in names:
        return None
    M = state.model.gyro_matrix
    rates = r.gyro[rest] - state.geometry.earth()[0][rest] @ M.T
    # Rounding that is alike in many rests shows in no scatter, but in their covariance.
    noise = np.diagonal(r.gyro_cov[rest], axis1=1, axis2=2)
    sd = float(np.sqrt(noise.mean())) if rest.any() else 0.0
    up = state.geometry.directions()[rest]
    return reversed_earth_at_rest(rates, up, M, e.model.site, sd)


def rest_slope(e: TableFit) -> Slope | None:
    """Regress the rates at rest on the direction of up; None where g-sensitivity is estimated."""
    r, state = e.model.readings, e.estimate.state
    rest = ~r.spin
    if r.gyro is None or rest.sum() < 9 or "gyro.g_sensitivity.xx" in e.model.options.names:
        return None
    up = state.geometry.directions()[rest]
    # Of the Earth's rotation what is known is taken away; the rest is scatter here.
    earth = state.geometry.earth()[0][rest]
    rows = np.column_stack([up, np.ones(len(up))])
    rate = r.gyro[rest] - earth @ state.model.gyro_matrix.T
    fit = np.linalg.lstsq(rows, rate, rcond=None)[0]
    scatter = np.sqrt(np.sum((rate - rows @ fit) ** 2) / (3 * len(up) - 12))
    # Rounding that is alike in many rests shows in no scatter, but in their covariance.
    noise = np.sqrt(np.diagonal(r.gyro_cov[rest], axis1=1, axis2=2).mean(axis=0).max())
    scatter = max(float(scatter), float(noise))
    slope, spins = float(np.abs(fit[:3]).max()), r.rate[r.spin]
    one_sense = bool(np.all(spins > 0) or np.all(spins < 0))
    shift = slope / float(np.median(np.abs(spins))) if one_sense else 0.0
    return Slope(slope, float(scatter * np.sqrt(3 / len(up))), shift)


def _g_sensitivity(e: TableFit) -> list[Check]:
    found = rest_slope(e)
    c = e.estimate.coefficients
    if found is None or "gyro.scale.x" not in c.layout:
        return []
    # It fails where it is more than chance and moves a scale factor by more than two sd.
    high = None
    if found.shift > 0:
        rate = found.slope / found.shift
        high = max(SIGNIFICANT * found.sd, 2 * float(c["gyro.scale"].sd.max()) * rate)
    fine = high is None or found.slope <= high
    size = f"{plain(np.degrees(found.slope) * 3600, 2)} deg/h per g"
    sd = plain(np.degrees(found.sd) * 3600, 2)
    words = f"The rates at rest change with orientation by {size} (sd {sd})"
    words += (
        "."
        if fine
        else f": g-sensitivity. With spins in one sense it shifts gyro scale factors by up to "
        f"{found.shift * 1e6:.0f} ppm, which the uncertainties do not know. Set g_sensitivity = "
        f"true, or spin both ways."
    )
    scale = UNITS["gyro"][0]
    top = None if high is None else high * scale
    name = "g-sensitivity [deg/h per g]"
    return [Check(name, found.slope * scale, None, top, fine, words)]


def name_of(readings: Readings, block: int) -> str:
    """Return what reading a number of an observation means, in words.

    `block`: number of the observation, see `estimate.table.likelihood.TableModel.rows` [1].
    """
    n = len(readings)
    what = "specific force" if block < n else "rate"
    return f"{what} of {reading_name(readings, block % n)}"


def reading_name(readings: Readings, j: int) -> str:
    """Return what people call a reading.

    `j`: its number [1].
    """
    kind = "spin" if readings.spin[j] else "rest"
    number = int(np.sum(readings.spin[: j + 1] == readings.spin[j]))
    return f"{kind} {number} ({readings.start[j]:.0f} s)"


def _rate_as_declared(e: TableFit) -> list[Check]:
    """Doubt gyro scale factors where declared rate and clock of the log contradict each other."""
    told = [f for f in e.model.readings.findings if f.code == "spin.rate_clock"]
    if not told or e.model.readings.gyro is None:
        return []
    return [Check("rate of the table", 1.0, None, 0.0, False, told[0].message)]


def _outliers(e: TableFit) -> Check:
    suspects = [name_of(e.model.readings, b) for b in e.suspects]
    fine = not suspects
    left = ", ".join(name_of(e.model.readings, b) for b in e.outliers)
    if suspects:
        words = (
            f"One of these readings is wrong, and with this plan they look alike: "
            f"{', '.join(suspects)}. None was left out: measure them again, or use a plan in "
            f"which a bad position can be named, such as dodecahedron 20 or 26."
        )
    elif left:
        words = f"Left out as wrong: {left}."
    else:
        words = "No reading differs from the others by more than chance."
    return Check("outliers", float(len(suspects)), None, 0.0, fine, words)


def _controlled(e: TableFit) -> Check:
    """Say whether one wrong reading could have been seen and named; it never fails a result."""
    s = e.snooping
    rests = np.flatnonzero(e.model.kind == 0)
    name = "control of the rests"
    if not len(rests):
        return Check(name, float("nan"), None, None, True, "There are no rests.")
    share = float(np.mean(s.redundancy[rests]))
    blind = rests[s.dof[rests] == 0]
    # A table that is believed makes every position redundant, but names it just as well.
    alike = [j for j in rests if len(s.alike(int(j)))]
    worst = float(np.max(detectable(e)[rests])) * UNITS["accel"][0]
    size = f"{plain(worst, 2)} ug" if worst < 1000 else f"{plain(worst / 1000, 2)} mg"
    if len(blind):
        words = (
            f"A wrong rest could not have been seen in {len(blind)} of {len(rests)} positions: "
            f"no other reading controls them."
        )
    elif alike:
        words = (
            f"One rest that is wrong along up would have been noticed from {size} on, but could "
            f"not have been named: {len(alike)} of {len(rests)} positions look like another."
        )
    else:
        words = (
            f"One rest that is wrong along up would have been noticed and named from {size} on; "
            f"smaller errors might have stayed unseen."
        )
    return Check(name, share, None, None, True, words)


def detectable(e: TableFit) -> FloatArray:
    """Return the smallest error of each observation that would be noticed, shape (k,) [SI]."""
    s, covariance = e.snooping, e.fit.covariance
    roots = np.linalg.cholesky(covariance.own * e.estimate.weights[:, None, None])
    size = np.linalg.norm(np.einsum("kij,kj->ki", roots, s.direction), axis=1)
    return np.asarray(s.detectable * size)


def _table(e: TableFit) -> list[Check]:
    """Compare the errors of the table that were found with what was believed of it."""
    estimate = e.estimate
    of_table = int(np.isfinite(estimate.state.geometry.prior()[1]).sum())
    rows = np.flatnonzero(estimate.blocks < 0)[:of_table]
    if not len(rows):
        return []
    value = float(np.sum(estimate.residuals[rows] ** 2))
    dof = float(np.sum(1 - estimate.leverage[rows]))
    high = chi_square_limits(max(dof, 1e-3))[1]
    if dof < 0.5:
        return []
    ratio, fine = np.sqrt(value / dof), value <= high
    words = f"The errors of the table are {ratio:.2f} times what was declared"
    if e.angle_suspects:
        which = ", ".join(reading_name(e.model.readings, j) for j in e.angle_suspects)
        words += (
            f". The angles of one position are wrong, and with this plan these look alike: "
            f"{which}. Look at the angles that were typed or logged there."
        )
        return [Check("errors of the table", value, None, high, False, words)]
    words += (
        "."
        if fine
        else ": the table is worse than it was said to be. Declare larger errors of the table, or "
        "use norm_observation, which believes nothing of it."
    )
    return [Check("errors of the table", value, None, high, fine, words)]
