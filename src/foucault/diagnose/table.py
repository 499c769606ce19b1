"""A calibration on a table, alone or in a batch: its checks, findings, and tables of the report."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose import fit_checks, references
from foucault.diagnose.checks import (
    check,
    left_out_check,
    reversed_earth_at_rest,
    reversed_earth_check,
)
from foucault.diagnose.fit_checks import Judged, Limit
from foucault.diagnose.left_out import common_g_sensitivity, counted_size
from foucault.errors import Finding, finding
from foucault.estimate.table import ALONG, AT_REST, ENOUGH, FORCES, FOUND_IN, IN_SPINS, TableFit
from foucault.infer import mixed
from foucault.infer.drift import LeftOut, find_left_out
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models import turntable
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.noise import Readings
from foucault.models.turntable import RIG, Angles, State, Trust
from foucault.result import CERTAIN, Check, Level
from foucault.tables import AXES, Log, temperature_range
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


OF_TABLE = "errors of the table"  # Name of the check of all that is wrong with a table.

_SAID = {
    "tilt of the outer axis": "how plumb the table is (plumb_sd in [procedure])",
    "axes of the table that are not square": "how square its axes are (orthogonality_sd)",
    "zero errors of the table": "how large its zero errors are (zero_sd)",
    "errors of single positions": "how far single positions are off (position_sd)",
}
"""What is known of a table, and the setting that says it."""


def checks(e: TableFit) -> tuple[Check, ...]:
    """Return every test of the result; a failed one carries its reason."""
    estimate = e.estimate
    every = judged(e)
    # How a bad reading would be noticed, the control of the rests says in full.
    out = [c for c in fit_checks.checks(every) if c.name != "redundancy"] + _g_sensitivity(e)
    out += _same_bias(e)
    sign = reversed_earth_check(estimate.coefficients, e.model.site)
    sign = sign or _earth_at_rest(e)
    out += [sign] if sign is not None else []
    out += [_outliers(e), _controlled(e), *_rate_as_declared(e)]
    if isinstance(estimate.state.geometry, Angles):
        out = fit_checks.said_once(out + _table(e), OF_TABLE)
    out += left_out_check(
        _quadratic(every, e), LAYOUT, QUADRATIC,
        "Set accel_quadratic = true, in a plan that shows them.",
    )  # fmt: skip
    return tuple(out)


def judged(e: TableFit) -> Judged:
    """Return what every fit is asked, of a session on a table."""
    r, g = e.model.readings, e.estimate.state.geometry
    exact = isinstance(g, Angles) and not np.any(g.trust.common_sd) and not g.trust.position_sd
    return Judged(
        e.fit, _WHAT, r.noise_from, (r.start + r.time / 2)[e.model.rows % len(r)],
        found_in=FOUND_IN, limits=_LIMITS, cure="Measure more positions.",
        more="measure more positions", blocks=e.model.rows % len(r), named=partial(reading_name, r),
        said=_SAID, cause=dict.fromkeys(_WHAT, EXACT) if exact else {},
    )  # fmt: skip


EXACT = (
    "the angles of the table were taken as exact, and what they are off by is in these residuals: "
    "say how good they are (angle_sd in [procedure]), or look for what else is wrong"
)
"""What residuals beyond the noise are where a table is believed."""


def _quadratic(every: Judged, e: TableFit) -> LeftOut | None:
    """Return quadratic terms as the residuals show them, where they were not estimated."""
    fit, o = e.fit, e.model.options
    names = tuple(f"accel.quadratic.{a}" for a in AXES)
    if e.model.readings.accel is None or set(names) & set(o.names) or _counted(e, names[0]):
        return None
    more = replace(e.model, options=replace(o, names=(*o.names, *names)))
    slope = more.linearise(fit.state).jacobian[:, :, len(o.names) : len(o.names) + len(names)]
    columns = np.zeros((len(fit.white.residuals), len(names)))  # no prior of others knows them
    columns[: slope.shape[0] * slope.shape[1]] = fit.covariance.whiten(slope)
    return find_left_out(fit.white, names, columns, kinds=fit_checks.scattering(every))


def agreement(coefficients: CoefficientVector, likelihood: CoefficientVector) -> Check:
    """Compare another solution with the likelihood's: a bias of its own shows in no residual.

    `coefficients`: the solution, with covariance [SI]; `likelihood`: that of the likelihood [SI].
    """
    own = np.array([likelihood.value(name) for name in coefficients.names])
    off = np.abs(coefficients.values - own) / coefficients.sd
    worst = int(np.argmax(off))
    name, given = "agreement with the likelihood", {"name": coefficients.names[worst]}
    return check(name, name, float(off[worst]), None, 4.0, given)


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


def _counted(e: TableFit, name: str) -> bool:
    """Whether a term that is not estimated counts, and is tested, with its size."""
    return e.left_out is not None and name.rpartition(".")[0] in e.left_out.groups


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
    beside = common_g_sensitivity(e.left_out, e.model.site.gravity)
    return reversed_earth_at_rest(rates, up, M, e.model.site, sd, beside)


def _rates_at_rest(e: TableFit) -> tuple[FloatArray, FloatArray, float] | None:
    """Regress the rates at rest on the direction of up; None where too few rests tell.

    Returns (4, 3) slopes along up and what is left without it [rad/s], (4, 4) what a variance of
    one reading makes of these [1], and the scatter of a reading [rad/s].
    """
    r, state = e.model.readings, e.estimate.state
    rest = ~r.spin
    if r.gyro is None or rest.sum() < 9 or "gyro.scale.x" not in e.model.options.names:
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
    return fit, np.linalg.pinv(rows.T @ rows), max(float(scatter), float(noise))


def rest_slope(e: TableFit) -> Slope | None:
    """Tell how rates at rest follow the direction of up; None where g-sensitivity is estimated."""
    term, r = "gyro.g_sensitivity.xx", e.model.readings
    found = _rates_at_rest(e)
    if found is None or term in e.model.options.names or _counted(e, term):
        return None
    fit, _, scatter = found
    slope, spins = float(np.abs(fit[:3]).max()), r.rate[r.spin]
    one_sense = bool(np.all(spins > 0) or np.all(spins < 0))
    shift = slope / float(np.median(np.abs(spins))) if one_sense else 0.0
    return Slope(slope, float(scatter * np.sqrt(3 / np.sum(~r.spin))), shift)


def _same_bias(e: TableFit) -> list[Check]:
    """Compare the bias of the gyros at rest with that in spins, from which it is estimated.

    Where the heading is unknown the spins alone tell it, and a fit may give the rests a bias of
    their own: neither leaves residuals.
    """
    from scipy.special import stdtrit

    found, c = _rates_at_rest(e), e.estimate.coefficients
    names = [f"gyro.bias.{a}" for a in AXES]
    if found is None or not set(names) <= set(c.names) or not e.model.readings.spin.any():
        return []
    fit, variance, scatter = found
    at = [c.layout.index(name) for name in names]
    drift = counted_size(e.left_out, "gyro.bias drift")
    sd = np.sqrt(scatter**2 * variance[3, 3] + c.sd[at] ** 2 + drift**2)
    moved = fit[3] - c.values[at]
    k = int(np.argmax(np.abs(moved) / sd))
    dof = 3 * float(np.sum(~e.model.readings.spin)) - 12
    high = -float(stdtrit(dof, CERTAIN / 6))  # of three axes, either way
    scale, unit = UNITS["gyro"]
    given = {"name": names[k], "size": f"{plain(moved[k] * scale, 2)} {unit}"}
    return [check("bias at rest", "gyro bias at rest", float(abs(moved[k]) / sd[k]), None, high,
                  given)]  # fmt: skip


def _g_sensitivity(e: TableFit) -> list[Check]:
    found = rest_slope(e)
    c = e.estimate.coefficients
    if found is None:
        return []
    # It fails where it is more than chance and moves a scale factor by more than two sd.
    high = None
    if found.shift > 0:
        rate = found.slope / found.shift
        high = max(SIGNIFICANT * found.sd, 2 * float(c["gyro.scale"].sd.max()) * rate)
    given = {
        "size": f"{plain(np.degrees(found.slope) * 3600, 2)} deg/h per g",
        "sd": plain(np.degrees(found.sd) * 3600, 2), "ppm": found.shift * 1e6,
    }  # fmt: skip
    scale = UNITS["gyro"][0]
    top = None if high is None else high * scale
    return [
        check("g-sensitivity", "g-sensitivity [deg/h per g]", found.slope * scale, None, top, given)
    ]


def name_of(readings: Readings, block: int) -> str:
    """Return what the observation `block`, of `TableModel.rows` [1], is called."""
    n = len(readings)
    what = "specific force" if block < n else "rate"
    return f"{what} of {reading_name(readings, block % n)}"


def reading_name(readings: Readings, j: int) -> str:
    """Return what people call reading number `j` [1]."""
    kind = "spin" if readings.spin[j] else "rest"
    number = int(np.sum(readings.spin[: j + 1] == readings.spin[j]))
    return f"{kind} {number} ({readings.start[j]:.0f} s)"


def _rate_as_declared(e: TableFit) -> list[Check]:
    """Doubt gyro scale factors where declared rate and clock of the log contradict each other."""
    told = [f for f in e.model.readings.findings if f.code == "spin.rate_clock"]
    if not told or e.model.readings.gyro is None:
        return []
    name, given = "rate of the table", {"message": told[0].message}
    return [check(name, name, 1.0, None, 0.0, given)]


def _outliers(e: TableFit) -> Check:
    suspects = [name_of(e.model.readings, b) for b in e.suspects]
    left = ", ".join(name_of(e.model.readings, b) for b in e.outliers)
    key = "outliers left out" if left and not suspects else "outliers"
    given = {"suspects": ", ".join(suspects), "left": left}
    return check(key, "outliers", float(len(suspects)), None, 0.0, given)


def _controlled(e: TableFit) -> Check:
    """Say whether one wrong reading could have been seen and named; it never fails a result."""
    s = e.snooping
    rests = np.flatnonzero(e.model.kind == 0)
    name = "control of the rests"
    if not len(rests):
        return check("control without rests", name, float("nan"))
    share = float(np.mean(s.redundancy[rests]))
    blind = rests[s.dof[rests] == 0]
    # A table that is believed makes every position redundant, but names it just as well.
    alike = [j for j in rests if len(s.alike(int(j)))]
    worst = float(np.max(detectable(e)[rests])) * UNITS["accel"][0]
    key = "control blind" if len(blind) else "control alike" if alike else "control"
    given = {
        "blind": len(blind), "alike": len(alike), "of": len(rests),
        "size": f"{plain(worst, 2)} ug" if worst < 1000 else f"{plain(worst / 1000, 2)} mg",
    }  # fmt: skip
    return check(key, name, share, given=given)


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
    key = "angles of the table" if e.angle_suspects else "errors of the table"
    which = ", ".join(reading_name(e.model.readings, j) for j in e.angle_suspects)
    given = {"ratio": np.sqrt(value / dof), "which": which}
    passed = not e.angle_suspects
    return [check(key, OF_TABLE, value, None, high, given, passed=passed)]


def hints(e: TableFit, checks: Iterable[Check]) -> list[Finding]:
    """Return findings about the session, `checks` of the same fit: outliers, scatter, a wrong g."""
    left_out = any(c.name == QUADRATIC and not c.passed for c in checks)
    out = []
    for row in e.fit.outliers:
        what = name_of(e.model.readings, int(e.model.rows[row]))
        size = np.sqrt(e.snooping.test[row] / max(e.estimate.weights[row], 1e-12))
        out.append(finding("readings.outlier", what=what, size=f"{size:.0f}"))
    out += _wrong_angles(e)
    codes = {"accel": "session.common_scale"}
    if not e.model.readings.rate_logged:
        codes["gyro"] = "readings.common_rate"
    out += references.common_scale(e.estimate.coefficients, e.model.site.gravity, codes)
    return out + _g_sensitivity_found(e) + (_quadratic_found(e) if left_out else [])


def _wrong_angles(e: TableFit) -> list[Finding]:
    """Name the angles of the table that are far off, as the readings tell them."""
    g, out = e.estimate.state.geometry, []
    for j in e.wrong_angles:
        off = np.degrees(g.position[j])  # true angle minus the one that is said
        large = [k for k in (0, 1) if abs(off[k]) > 0.2 * np.abs(off).max()]
        words = " and ".join(
            f"{('middle', 'inner')[k]} angle is about {plain(abs(float(off[k])), 2)} deg off "
            f"(said {plain(float(np.degrees(g.readings_angles[j, k + 1])), 4)}, found "
            f"{plain(float(np.degrees(g.readings_angles[j, k + 1]) + off[k]), 4)} deg)"
            for k in large
        )
        out.append(finding("table.angle", reading=reading_name(e.model.readings, j), how=words))
    return out


def _g_sensitivity_found(e: TableFit) -> list[Finding]:
    """Tell of rates at rest that depend on orientation."""
    found = rest_slope(e)
    if found is None or not found.significant:
        return []
    size, shift = f"{np.degrees(found.slope) * 3600:.0f}", f"{found.shift * 1e6:.0f}"
    return [finding("readings.g_sensitivity", size=size, shift=shift)]


def _quadratic_found(e: TableFit) -> list[Finding]:
    """Try whether quadratic terms explain what the noise does not."""
    o, names = e.model.options, tuple(f"accel.quadratic.{a}" for a in AXES)
    before = [c for k, c in e.fit.before.items() if k.startswith("accel")]
    square = sum(c.chi_square for c in before)
    left = sum(c.redundancy for c in before) - len(names)
    if FORCES not in e.scatter or names[0] in o.names or left < 5 or o.prior is not None:
        return []
    if _counted(e, names[0]):
        return []
    more = replace(e.model, options=replace(o, names=(*o.names, *names)))
    after = mixed.solve(more, near=e.estimate.state).after
    remains = sum(c.chi_square for k, c in after.items() if k.startswith("accel"))
    if remains / left > 0.2 * square / (left + len(names)):
        return []
    return [finding("readings.quadratic", share=f"{100 * (1 - remains / square):.0f}")]


TRIADS = ("accel", "gyro")
_RESIDUALS = ("specific force at rest", "angular rate in spins")
_SCATTER = ("specific force", "rate")


def explained(
    triad: int, chi_square: float, high: float, redundancy: float, shared: float | None
) -> Check:
    """Check that the residuals of an instrument are like those of the fleet.

    `triad`: 0 for the accelerometers, 1 for the gyros [1]; `chi_square`: sum of squared residuals
    over their variances [1]; `high`: largest that chance explains [1]; `redundancy`: redundant
    readings of the instrument [1]; `shared` or None: redundant readings of the whole fleet, where
    the noise is known from nothing else [1].
    """
    what = _RESIDUALS[triad]
    name = f"noise of {what}"
    given: dict[str, Any] = {"what": f"the {what}"}
    if shared is not None and shared < ENOUGH:
        return check("fleet noise unknown", name, shared, ENOUGH, None, given)
    if redundancy < 0.5:
        return check("noise untested", name, float("nan"), None, None, given)
    given |= {"what": what, "ratio": np.sqrt(chi_square / redundancy), "redundancy": redundancy}
    return check("noise in the fleet", name, chi_square, None, high, given)


def scatter(triad: int, sd: float) -> Check:
    """Check that the readings belong together at all.

    `triad`: 0 for the accelerometers, 1 for the gyros [1]; `sd`: scatter of the readings about
    the model, per axis [SI].
    """
    kind, what = TRIADS[triad], _SCATTER[triad]
    scale, unit = UNITS[kind]
    size, limit = sd * scale, LARGE[kind] * scale
    given = {"what": what, "size": f"{plain(size, 3)} {unit}", "limit": f"{plain(limit, 3)} {unit}"}
    return check("scatter in the fleet", f"scatter of {what}", size, None, limit, given,
                 fails=Level.UNUSABLE)  # fmt: skip


def readings_of_many(
    r: Readings, coefficients: CoefficientVector, lever_arm: FloatArray, site: Site
) -> dict[str, FloatArray]:
    """Return the table "readings" of the report, see "readings" in tables.toml.

    `r`: means with the covariance of their noise, accelerometers and gyros [SI]; `coefficients`:
    the estimate with its covariance [SI]; `lever_arm` (3,): the accelerometers from the centre of
    the table, frame b [m].
    """
    assert r.accel is not None and r.gyro is not None
    model = ImuModel.from_coefficients(coefficients)
    h = turntable.mean_rate(r.rate, site.latitude or 0.0)
    f, w = model.compensate(r.accel, r.gyro)
    assert f is not None and w is not None
    axis = np.where(r.spin[:, None], w * np.sign(h)[:, None], f)
    up = axis / np.linalg.norm(axis, axis=1, keepdims=True)
    out = _columns(r, up, h, model, coefficients, lever_arm, (r.accel_cov, r.gyro_cov))
    return out | _residual_columns(r, out, site.gravity)


def _columns(
    r: Readings, up: FloatArray, h: FloatArray, model: ImuModel, coefficients: CoefficientVector,
    lever_arm: FloatArray, cov: tuple[FloatArray, FloatArray],
) -> dict[str, Any]:  # fmt: skip
    """Return the columns of "readings" in tables.toml but those of residuals.

    `up` (n, 3): frame b [1]; `h` (n,): mean rates [rad/s]; `cov` (n, 3, 3) each: what a specific
    force and a rate have for themselves [SI].
    """
    out: dict[str, Any] = {
        "start": r.start, "end": r.start + r.time, "time": r.time, "rate": r.rate, "turns": r.turns,
        **{name: r.angles[:, k] for k, name in enumerate(("outer", "middle", "inner"))},
        **references.triad_columns("up", up),
    }  # fmt: skip
    if r.accel is not None:
        # In spins the centripetal part is taken away, so that every norm must be local gravity.
        pushed = turntable.mean_force(up, np.where(r.spin, h, 0.0), 0.0, lever_arm)
        still = r.accel - pushed @ model.accel_matrix.T
        norm, joint = references.norm_with_cov(model, coefficients, still, cov[0])
        out |= references.triad_columns("accel", r.accel) | {
            "norm_before": np.linalg.norm(r.accel, axis=1), "norm_after": norm,
            "norm_sd": np.sqrt(np.diag(joint)),
        }  # fmt: skip
    if r.gyro is not None:
        out |= references.triad_columns("gyro", r.gyro)
    if r.gyro is not None and r.spin.any():
        w = model.compensate(r.accel, r.gyro)[1]
        assert w is not None
        spin = np.where(r.spin, 1.0, np.nan)  # the norm at rest is not calibrated by anything
        out |= {
            "rate_before": np.linalg.norm(r.gyro, axis=1) * spin,
            "rate_after": np.linalg.norm(w, axis=1) * spin,
            "rate_true": np.abs(h) * spin,
            "rate_sd": references.rate_norm_sd(model, coefficients, w, r.accel, cov[1]) * spin,
        }
    return out


def _residual_columns(
    r: Readings, norms: Mapping[str, FloatArray], gravity: float
) -> dict[str, FloatArray]:
    """Return the residuals of the norms over the sd of the noise: what the equations leave."""
    sd = [np.sqrt(np.trace(c, axis1=1, axis2=2) / 3) for c in (r.accel_cov, r.gyro_cov)]
    accel = np.where(r.spin, 0.0, norms["norm_after"] - gravity) / sd[0]
    gyro = np.nan_to_num(norms["rate_after"] - norms["rate_true"]) / sd[1]
    one = np.ones(len(r))
    return {
        "residual": np.maximum(np.abs(accel), np.abs(gyro)),
        "accel_residual": np.abs(accel),
        "gyro_residual": np.abs(gyro),
        "weight": one,
        "accel_weight": one,
        "gyro_weight": one,
        "detectable": np.full(len(r), np.nan),
    }


def rig_of_many(lever_arm: FloatArray, cov: FloatArray) -> dict[str, Any]:
    """Return the table "rig" of the report: the lever arm, where it was estimated.

    `lever_arm` (3,) or (0,): the accelerometers from the centre of the table, frame b [m]; `cov`
    (3, 3) or (0, 0): its covariance [m^2].
    """
    return _rig(_found("lever_arm", lever_arm, np.sqrt(np.diag(cov))))


def _found(name: str, value: FloatArray, sd: FloatArray) -> list[tuple[str, float, float, float]]:
    """Return the rows of a vector of which nothing was known before."""
    some = zip(AXES, value.tolist(), sd.tolist(), strict=False)
    return [(f"{name}.{axis}", v, s, np.inf) for axis, v, s in some]


def _rig(rows: Sequence[tuple[str, float, float, float]]) -> dict[str, Any]:
    """Return the table of names, values, sd and what was known before."""
    known = {c.name: c for c in RIG.coefficients}
    return {
        "name": np.array([r[0] for r in rows], str),
        "meaning": np.array([known[r[0]].meaning for r in rows], str),
        "kind": np.array([known[r[0]].kind for r in rows], str),
        "value": np.array([r[1] for r in rows], float),
        "sd": np.array([r[2] for r in rows], float),
        "prior_sd": np.array([r[3] for r in rows], float),
    }


NOISE = {
    "declared": "declared",
    "measured": "measured in the readings",
    "unknown": "unknown: from the residuals",
}
"""Where the noise of readings is from, in words: rows of a log that are means do not tell it."""


def readings_table(e: TableFit) -> dict[str, Any]:
    """Return the table "readings" of the report, see "readings" in tables.toml."""
    r, state = e.model.readings, e.estimate.state
    h = turntable.mean_rate(r.rate, e.model.site.latitude or 0.0)
    up, coefficients = state.geometry.directions(), e.estimate.coefficients
    of_all = _columns(r, up, h, state.model, coefficients, state.lever_arm, _covariances(e))
    return of_all | _tested_columns(e)


def _covariances(e: TableFit) -> tuple[FloatArray, FloatArray]:
    """Return the covariance that each reading has for itself, body axes, shape (n, 3, 3) [SI]."""
    r, model, n = e.model.readings, e.model, len(e.model.readings)
    out = np.concatenate([r.accel_cov, r.gyro_cov])
    own = e.fit.covariance.own * e.estimate.weights[:, None, None]
    out[model.rows] = np.swapaxes(model.axes, 1, 2) @ own @ model.axes
    return out[:n], out[n:]


def _tested_columns(e: TableFit) -> dict[str, FloatArray]:
    s, rows, n = e.snooping, e.model.rows, len(e.model.readings)
    tests, smallest, weights = np.zeros(2 * n), np.full(2 * n, np.nan), np.ones(2 * n)
    weights[rows] = e.estimate.weights
    # One number per observation: its test, as a multiple of what is expected.
    # A reading that was left out is tested with the tiny weight it keeps: undo that.
    test = s.test / np.maximum(e.estimate.weights, 1e-12)
    tests[rows] = np.where(s.dof > 0, np.sqrt(test / np.maximum(s.dof, 1)), 0.0)
    smallest[rows] = detectable(e)
    return {
        "residual": np.maximum(tests[:n], tests[n:]),
        "accel_residual": tests[:n],
        "gyro_residual": tests[n:],
        "weight": np.minimum(weights[:n], weights[n:]),
        "accel_weight": weights[:n],
        "gyro_weight": weights[n:],
        "detectable": smallest[:n],
    }


def rig_table(e: TableFit) -> dict[str, Any]:
    """Return the table "rig" of the report: what was found beside the coefficients."""
    estimate = e.estimate
    state: State = estimate.state
    at = len(estimate.coefficients)
    sd = np.sqrt(np.diag(estimate.state_cov))
    rows: list[tuple[str, float, float, float]] = []
    options = e.model.options
    if options.lever_arm:
        rows += _found("lever_arm", state.lever_arm, sd[at : at + 3])
    at += 3 * options.lever_arm + options.level + 3 * options.offset
    g = state.geometry
    if isinstance(g, Angles):
        from foucault.models.rotation import log

        rows += _found("mounting", -log(g.C_bk), sd[at : at + 3])
        at += 3
        for k in g.used:
            known = float(g.trust.common_sd[k])
            rows.append((turntable.COMMON[k], float(g.common[k]), float(sd[at]), known))
            at += 1
        if g.heading is not None:
            turned = float((g.heading + np.pi) % (2 * np.pi) - np.pi)
            last = at + (g.position.size if g.trust.position_sd > 0 else 0)
            rows.append(("table.heading", turned, float(sd[last]), np.inf))
    return _rig(rows)


def validity(readings: Readings, log: Log | None, site: Site) -> dict[str, Any]:
    """Return the ranges [SI] of the session, without a log too: beyond them is extrapolation."""
    out: dict[str, Any] = {"accel": [-site.gravity, site.gravity]}
    if log is not None:
        out["sampled"] = log.sampled
    if readings.interval > 0:
        out["rate"] = 1.0 / readings.interval
    if readings.gyro is not None:
        largest = float(np.abs(readings.gyro).max())
        out["gyro"] = [-largest, largest]
    return out if log is None else out | temperature_range(log)


def unseen(
    readings: Readings, site: Site, table_rate_sd: float, trust: Trust | None, quadratic: bool
) -> list[str]:
    """Say what a procedure on a table cannot see in principle, for result.json.

    `table_rate_sd`: relative sd of an error that all spin rates share [1]; `trust`: what is
    believed of the table, None for nothing; `quadratic`: whether the quadratic terms of the
    accelerometers are estimated.
    """
    out = [
        references.wrong_gravity(site.gravity_sd),
        "How the body axes lie in the case: they are those of the accelerometers (see gauge).",
        *references.BEYOND_THE_SESSION,
    ]
    if readings.gyro is not None and readings.spin.any():
        rate = references.believed(table_rate_sd, 1e-6, "ppm")
        out.insert(1, f"A wrong rate of the table: 1 ppm is 1 ppm in all gyro scales; {rate}.")
        spins = readings.rate[readings.spin]
        if np.all(spins > 0) or np.all(spins < 0):
            out.append(
                "The g-sensitivity of the gyros: with spins in one sense it looks like a scale "
                "factor and a misalignment. Spin both ways (both_senses), or estimate it."
            )
        rates = np.unique(np.round(np.abs(readings.rate[readings.spin]), 6))
        if len(rates) == 1:
            out.append("Gyro scale factors that change with the rate: all spins had the same.")
        push = 0.01 * float(np.max(readings.rate**2)) / 9.80665e-6
        out.append(
            f"Accelerometers apart from one another: in spins each centimetre is up to {push:.0f} "
            f"ug, and goes into scatter and bias."
        )
    if trust is not None and not np.any(trust.common_sd):
        out.append(
            "Errors of the table that all positions share, such as axes that are not square: they "
            "go into the coefficients, and the uncertainties do not know them."
        )
    if not quadratic:
        out.append("Quadratic terms of the accelerometers: about 0.6 of each goes into the bias.")
    return out
