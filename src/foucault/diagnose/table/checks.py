"""Judge a calibration on a table: every check, with its limits and its sentence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.checks import (
    drift_check,
    judge_prior,
    left_out_check,
    plausible_scales,
    reversed_earth_at_rest,
    reversed_earth_check,
    status_check,
)
from foucault.diagnose.coverage import Coverage
from foucault.errors import Status
from foucault.estimate import gauss_newton
from foucault.estimate.chi_square import TOLD, chi_square_limits
from foucault.estimate.drift import Drift, LeftOut, find_drift, find_left_out
from foucault.estimate.table.fit import (
    ENOUGH,
    GROUPS,
    KINDS,
    TableFit,
    group_components,
    kinds_of,
)
from foucault.estimate.table.likelihood import build
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT
from foucault.models.readings import Readings
from foucault.models.table_geometry import Angles
from foucault.result import Check, Level, Linearised
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

TOO_MUCH = 5.0
"""Residuals this many times the noise are no scatter of a good table: a term is missing [1]."""

UNKNOWN_NOISE = "readings.noise_unknown"
"""Finding of a log of means for which no noise was declared."""

LARGE = {"accel": 0.05, "gyro": np.radians(0.1), "rate": 1e-2}
"""Scatter beyond the noise that is no longer a calibration: 5 mg [m/s^2], 0.1 deg/s [rad/s], 1 %
of the rate [1]."""


@dataclass(frozen=True)
class TableEvidence:
    """Everything the checks look at."""

    readings: Readings  # what was observed [SI]
    site: Site
    fit: TableFit
    coverage: Coverage  # directions of up at the rests


def checks(e: TableEvidence) -> tuple[Check, ...]:
    """Return every test of the result; a failed one carries its reason."""
    estimate = e.fit.estimate
    out = [
        status_check(estimate.status, estimate.weakest),
        *plausible_scales(estimate.coefficients),
    ]
    out += [_explained(e, kind) for kind in KINDS if kind in e.fit.before]
    out += _scatter(e) + _g_sensitivity(e)
    sign = reversed_earth_check(estimate.coefficients, e.site)
    sign = sign or _earth_at_rest(e)
    out += [sign] if sign is not None else []
    out += [_outliers(e), _controlled(e), *_rate_as_declared(e)]
    if isinstance(estimate.state.geometry, Angles):
        out += _table(e)
    if estimate.coefficients.names == e.fit.options.names and estimate.status is Status.CONVERGED:
        out += drift_check(_clearest_drift(e), estimate.coefficients.layout)
        out += left_out_check(
            _quadratic(e), LAYOUT, "quadratic terms of the accelerometers",
            "Set accel_quadratic = true, in a plan that shows them.",
        )  # fmt: skip
    return tuple(out + judge_prior(estimate))


def _clearest_drift(e: TableEvidence) -> Drift | None:
    """Return the drift of a coefficient that the residuals show most clearly."""
    time = np.tile(e.readings.start + e.readings.time / 2, 2)
    return find_drift(_linearised(e), e.fit.options.names, time, kinds=_kinds(e))


def _quadratic(e: TableEvidence) -> LeftOut | None:
    """Return quadratic terms as the residuals show them, where they were not estimated."""
    fit, o, state = e.fit, e.fit.options, e.fit.estimate.state
    names = tuple(f"accel.quadratic.{a}" for a in AXES)
    if e.readings.accel is None or set(names) & set(o.names):
        return None
    more = build(
        fit.observed, (*o.names, *names), state, lever_arm=o.lever_arm, level=o.level,
        offset=o.offset,
    )  # fmt: skip
    slope = more.linearise(state, fit.estimate.weights).jacobian
    at, first = _linearised(e), len(o.names)
    columns = np.zeros((len(at.residuals), len(names)))  # no prior of others knows them
    columns[: len(slope)] = slope[:, first : first + len(names)]
    return find_left_out(at, names, columns, kinds=_kinds(e))


def _linearised(e: TableEvidence) -> Linearised:
    estimate, problem = e.fit.estimate, e.fit.problem
    at = problem.linearise(estimate.state, estimate.weights)
    return gauss_newton.with_prior(problem, estimate.state, at)


def _kinds(e: TableEvidence) -> IntArray:
    """Specific forces have one scatter, rates at rest and in spins each their own."""
    return np.maximum(kinds_of(e.readings, np.arange(2 * len(e.readings))), 1)


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


_WHAT = {
    "accel at rest": "specific force at rest",
    "accel in spins": "specific force in spins",
    "gyro at rest": "angular rate at rest",
    "gyro in spins": "angular rate in spins, across the axis",
    "rate of spins": "angular rate in spins, along the axis",
}


def _explained(e: TableEvidence, kind: str) -> Check:
    added = e.fit.scatter.get(GROUPS[kind], 0.0) > 0
    # Scatter of one kind shows in the others too until it is known.
    c = e.fit.after[kind] if e.fit.scatter and not added else e.fit.before[kind]
    what, name = _WHAT[kind], f"noise of {_WHAT[kind]}"
    if e.readings.noise_unknown:
        return _unknown(e, kind)
    if c.redundancy < 0.5:
        words = f"Nothing tests the noise of the {what}: no reading is redundant."
        return Check(name, float("nan"), None, None, True, words)
    ratio, inside = np.sqrt(c.ratio), c.low <= c.chi_square <= c.high
    dof = f"{plain(c.redundancy, 2)} redundant"
    declared = e.readings.declared
    if inside:
        words = f"The residuals of {what} are {ratio:.2f} times what the noise says ({dof})."
    elif c.chi_square < c.low:
        words = (
            f"The residuals of {what} are only {ratio:.2f} times what the noise says ({dof}): the "
            f"noise is overstated and so are the uncertainties."
        )
    elif added:
        words = f"The residuals of {what} are {ratio:.1f} times what the noise explains ({dof})"
        if declared:
            words += ": the declared noise is too small. The uncertainties include the scatter."
        elif c.redundancy < ENOUGH:
            words += (
                "; so few readings are redundant that one wrong reading would look like this too. "
                "The scatter is part of the uncertainties; measure more positions to tell."
            )
        elif ratio > TOO_MUCH:
            words += (
                ": the model lacks something, such as errors of the table, a drifting bias, "
                "g-sensitivity of the gyros, or quadratic terms. The scatter is part of the "
                "uncertainties, but such errors do not average out."
            )
        else:
            words += "; the scatter was estimated and is part of the uncertainties."
    else:
        words = (
            f"The residuals of {what} are {ratio:.1f} times what the noise explains ({dof}), and "
            f"the uncertainties do not know it."
        )
    if declared:
        return Check(name, c.chi_square, c.low, c.high, inside, words)
    # Measured noise is a lower limit: moderate scatter beyond it is accounted for, and what is
    # measured too large only makes the uncertainties careful.
    told = added and c.redundancy >= ENOUGH
    high = max(c.high, TOO_MUCH**2 * c.redundancy) if told else c.high
    return Check(name, c.chi_square, None, high, c.chi_square <= high, words)


def _unknown(e: TableEvidence, kind: str) -> Check:
    """Judge whether the residuals can tell a noise that nobody declared, and have told one."""
    group, what = GROUPS[kind], _WHAT[kind]
    # The noise of spins is in all directions, that of their rate comes on top along the axis.
    spins = {"gyro in spins", "rate of spins"}
    parts = group_components(e.fit.after)
    n = sum(parts[g].redundancy for g in (spins if group in spins else {group}) & set(parts))
    sources = spins if group == "rate of spins" else {group}
    if not sources & set(e.fit.scatter):
        n = 0.0  # what is found to be without noise was bent until it fits
    fine = n >= TOLD
    words = f"The noise of the {what} is unknown " + (
        f"and was taken from its residuals ({plain(n, 2)} redundant)."
        if fine
        else f"and the residuals do not tell it ({plain(n, 2)} redundant, {TOLD:g} needed): the "
        "uncertainties mean little. Declare [noise], or measure more positions."
    )
    return Check(f"noise of {what}", n, TOLD, None, fine, words)


def _scatter(e: TableEvidence) -> list[Check]:
    out = []
    names = {
        "accel": "specific force",
        "gyro at rest": "rate at rest",
        "gyro in spins": "rate in spins",
        "rate of spins": "rate of the spins",
    }
    for group, sd in e.fit.scatter.items():
        triad = group.split()[0]
        scale, unit = UNITS[triad]
        limit, size = LARGE[triad], f"{plain(sd * scale, 2)} {unit}"
        what = names[group]
        fine = sd <= limit
        words = f"The {what} scatters by {size} from one reading to the next beyond the noise" + (
            "."
            if fine
            else f", more than {plain(limit * scale, 2)} {unit}: the table moved, or the readings "
            f"do not belong together."
        )
        name = f"scatter of {what} [{unit}]"
        out.append(Check(name, sd * scale, None, limit * scale, fine, words, Level.UNUSABLE))
    return out


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


def _earth_at_rest(e: TableEvidence) -> Check | None:
    """Look for a reversed Earth rate in the rests, where no g-sensitivity takes it up."""
    r, state, names = e.readings, e.fit.estimate.state, e.fit.options.names
    rest = ~r.spin
    if r.gyro is None or "gyro.scale.x" not in names or "gyro.g_sensitivity.xx" in names:
        return None
    M = state.model.gyro_matrix
    rates = r.gyro[rest] - state.geometry.earth()[0][rest] @ M.T
    # Rounding that is alike in many rests shows in no scatter, but in their covariance.
    noise = np.diagonal(r.gyro_cov[rest], axis1=1, axis2=2)
    sd = float(np.sqrt(noise.mean())) if rest.any() else 0.0
    up = state.geometry.directions()[rest]
    return reversed_earth_at_rest(rates, up, M, e.site, sd)


def rest_slope(e: TableEvidence) -> Slope | None:
    """Regress the rates at rest on the direction of up; None where g-sensitivity is estimated."""
    r, state = e.readings, e.fit.estimate.state
    rest = ~r.spin
    if r.gyro is None or rest.sum() < 9 or "gyro.g_sensitivity.xx" in e.fit.options.names:
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


def _g_sensitivity(e: TableEvidence) -> list[Check]:
    found = rest_slope(e)
    c = e.fit.estimate.coefficients
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

    `block`: number of the observation, see `estimate.table.likelihood.build` [1].
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


def _rate_as_declared(e: TableEvidence) -> list[Check]:
    """Doubt gyro scale factors where declared rate and clock of the log contradict each other."""
    told = [f for f in e.readings.findings if f.code == "spin.rate_clock"]
    if not told or e.readings.gyro is None:
        return []
    return [Check("rate of the table", 1.0, None, 0.0, False, told[0].message)]


def _outliers(e: TableEvidence) -> Check:
    f = e.fit
    suspects = [name_of(e.readings, b) for b in f.suspects]
    fine = not suspects
    left = ", ".join(name_of(e.readings, b) for b in f.outliers)
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


def _controlled(e: TableEvidence) -> Check:
    """Say whether one wrong reading could have been seen and named; it never fails a result."""
    s, n = e.fit.snooping, len(e.readings)
    rests = np.flatnonzero((s.blocks < n) & ~e.readings.spin[s.blocks % n])
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


def detectable(e: TableEvidence) -> FloatArray:
    """Return the smallest error of each observation that would be noticed, shape (k,) [SI]."""
    s, o = e.fit.snooping, e.fit.observed
    roots = np.concatenate([o.accel_root, o.gyro_root])[s.blocks]
    size = np.linalg.norm(np.linalg.solve(roots, s.direction[:, :, None])[:, :, 0], axis=1)
    return np.asarray(s.detectable * size)


def _table(e: TableEvidence) -> list[Check]:
    """Compare the errors of the table that were found with what was believed of it."""
    estimate = e.fit.estimate
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
    if e.fit.angle_suspects:
        which = ", ".join(reading_name(e.readings, j) for j in e.fit.angle_suspects)
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
