"""What a session is held against: known norms, the Earth's rate, the clock, and what none sees."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.checks import SEEN, check, prior_check
from foucault.errors import Finding, finding
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import EARTH_RATE
from foucault.models.imu import ImuModel
from foucault.models.layouts import clock_slope, is_cluster
from foucault.result import Check, Estimate, Result, TimeBase
from foucault.tables import AXES, Clock, Log
from foucault.units import convert, display_unit, plain

if TYPE_CHECKING:
    from foucault.navigate.ins_filter import EarthSeen


def norm_with_cov(
    model: ImuModel, coefficients: CoefficientVector, accel: FloatArray, cov: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the compensated norm of mean specific forces, shape (n,), and its covariance, (n, n).

    ``d|f| = u' L^-1 (daccel - db - dL f - dK q(f))``, L the matrix of the accelerometers.

    `accel` (n, 3): mean readings [m/s^2]; `cov` (n, 3, 3): covariance of the readings [m^2/s^4].
    """
    f_b, _ = model.compensate(accel, None)
    assert f_b is not None
    norm = np.linalg.norm(f_b, axis=1)
    lever = (f_b / norm[:, None]) @ np.linalg.inv(model.accel_matrix)
    slopes = model.slopes(f_b, np.zeros_like(f_b), coefficients.names)
    slope = np.einsum("ni,nik->nk", lever, slopes.accel)
    joint = np.diag(np.einsum("ni,nij,nj->n", lever, cov, lever))
    if coefficients.cov is not None:
        joint = joint + slope @ coefficients.cov @ slope.T
    return norm, joint


def rate_norm_sd(
    model: ImuModel,
    coefficients: CoefficientVector,
    w_b: FloatArray,
    f_b: FloatArray | None,
    cov: FloatArray,
) -> FloatArray:
    """Return the standard deviation of the norm of compensated rates, shape (n,) [rad/s].

    ``|w| = u' w`` and ``w = W^-1 (gyro - b - G f)``, hence
    ``d|w| = u' W^-1 (dgyro - db - dW w - dG f)``.

    `w_b` (n, 3): compensated mean rates [rad/s]; `f_b` (n, 3) or None: specific force, which the
    g-sensitivity multiplies [m/s^2]; `cov` (n, 3, 3): covariance of the mean readings
    [rad^2/s^2].
    """
    norm = np.linalg.norm(w_b, axis=1)
    lever = (w_b / norm[:, None]) @ np.linalg.inv(model.gyro_matrix)
    force = np.zeros_like(w_b) if f_b is None else f_b
    slope = np.einsum("ni,nik->nk", lever, model.slopes(force, w_b, coefficients.names).gyro)
    variance = np.einsum("ni,nij,nj->n", lever, cov, lever)
    if coefficients.cov is not None:
        variance += np.einsum("nk,kl,nl->n", slope, coefficients.cov, slope)
    return np.asarray(np.sqrt(variance))


def no_latitude() -> Finding:
    """Say what the Earth's rotation adds to the gyro bias where the latitude is unknown."""
    sd = np.degrees(EARTH_RATE / np.sqrt(3)) * 3600
    return finding("session.no_latitude", sd=f"{sd:.0f}")


def earth_checks(earth: EarthSeen | None, false_alarm: float) -> list[Check]:
    """Return the check of the Earth's rate, failing by chance so often: `false_alarm` [1]."""
    if earth is None:
        return []
    limit = chi_square_limits(2, 2 * false_alarm)[1]
    given = _said(earth, limit)
    return [check("Earth's rate", "Earth's rate", earth.square, None, limit, given)]


def _said(earth: EarthSeen, limit: float) -> dict[str, str]:
    faster, sd, _ = earth.faster
    return {"rate": f"{1 + faster:.5f}", "sd": f"{sd:.1g}", "causes": _causes(earth, limit)}


def known_checks(
    earth: EarthSeen | None, c: CoefficientVector, mean: FloatArray, alike: Mapping[str, str],
    false_alarm: float,
) -> list[Check]:  # fmt: skip
    """Return the checks of the Earth's rate and of what was known before.

    No instrument is off alike in the three coefficients of a group; where they are apart by more
    than the prior allows it is single ones that are off. An estimate x lies between what
    the data say and the mean m of the prior, and the surer the prior, the nearer to m, however far
    off the data are: the difference x - m has the variance ``sd_prior^2 - sd^2``, whatever the
    share of the prior is.

    `earth` or None: what the session says of the Earth's rate; `c`: the estimate, with covariance,
    and the standard deviations of its prior [SI]; `mean` (k,): mean of the prior [SI]; `alike`:
    group of three coefficients -> what puts all of them off alike; `false_alarm`: probability that
    each test of a group fails by chance [1].
    """
    from scipy.special import ndtri

    out, cause = earth_checks(earth, 2 * false_alarm), ""
    if not all(one.passed for one in out):
        cause = "the times or the latitude put it off, see the check of the Earth's rate"
    out.append(prior_check(c, (mean - c.values) / c.prior_sd, cause=cause))
    share = np.maximum(1.0 - (c.sd / c.prior_sd) ** 2, SEEN)
    miss, limit = (c.values - mean) / (c.prior_sd * np.sqrt(share)), -float(ndtri(false_alarm / 2))
    apart = chi_square_limits(2, 2 * false_alarm)[1]
    for group, why in alike.items():
        at = c.layout.group(group)
        z = float(miss[at].sum() / np.sqrt(len(at)))
        if float(miss[at] @ miss[at]) - z**2 > apart:
            continue
        given = {"group": group, "ppm": 1e6 * c.values[at].mean(), "off": abs(z), "cause": why}
        out.append(check("off alike", f"{group} alike", z, -limit, limit, given))
    return out


def earth_findings(earth: EarthSeen | None, false_alarm: float) -> list[Finding]:
    """Say what explains another Earth's rate, by chance so often: `false_alarm` [1]."""
    if earth is None or all(one.passed for one in earth_checks(earth, false_alarm)):
        return []
    limit = chi_square_limits(2, 2 * false_alarm)[1]
    return [finding("session.earth_rate", **_said(earth, limit))]


def likelier(
    earth: EarthSeen | None, shifts: list[Check], false_alarm: float
) -> tuple[EarthSeen | None, list[Check]]:
    """Return, where another Earth's rate and a change at once both show, what explains more.

    `false_alarm`: probability that the Earth's rate fails by chance [1].
    """
    if earth is None or all(c.passed for c in (*shifts, *earth_checks(earth, false_alarm))):
        return earth, shifts
    more = any(not c.passed and c.value > earth.square for c in shifts)
    return (None, shifts) if more else (earth, [c for c in shifts if c.passed])


def _causes(earth: EarthSeen, limit: float) -> str:
    """Say what explains it, the likelier first: what leaves a square of no more than `limit`."""
    (faster, sd, left), (north, north_sd, remains) = earth.faster, earth.farther_north
    mirrored = earth.left_by(np.array([0.0, -2.0 * np.sin(earth.latitude)]))
    some = [
        (left, f"the times of the log run {100 * abs(faster):.2g} % (+- {100 * sd:.1g}) "
               f"{'slow' if faster > 0 else 'fast'}"),
        (remains, f"the latitude is {np.degrees(north):+.2g} deg (+- {np.degrees(north_sd):.1g}) "
                  "off"),
    ]  # fmt: skip
    if mirrored <= limit:  # far off, and yet without anything that was fitted
        return "the latitude has the wrong sign"
    named = [words for rest, words in sorted(some) if rest <= limit]
    return "; or ".join(named) or (
        "neither times nor latitude explain it alone: the gyros may sense gravity"
    )


WORDS = {
    "sensor": "the sensor's own oscillator",
    "host": "the crystal of a host or logger",
    "disciplined": "a clock that is steered",
}
"""Whose clock it is -> the same in a sentence."""


def times_the_table(log: Log) -> bool:
    """Tell whether the rate of a table is its logged angle over the time of `log`."""
    table = log.table
    return (
        log.averaged is None and table is not None and bool(np.isfinite(table.angles[:, 0]).any())
    )


BY_CLOCK = "by_clock"
"""Diagnostic: derivative of the coefficients by the logarithm of the rate of the clock of all that
was logged, where it does not follow from what they are (p,) [SI]."""


def with_clock(result: Result, clock: Clock, *, turned: bool, summed: bool) -> Result:
    """Put what the clock of the log makes of the coefficients beside them, and say it.

    `result`: its covariance is that in the log's own time [SI]; `turned`: whether the reference
    of the gyros is an angle over the time of the log.
    """
    vector, known = result.coefficients, result.diagnostics.get(BY_CLOCK)
    slope = clock_slope(vector, turned=turned, summed=summed) if known is None else known
    slope = np.where(vector.free, slope, 0.0)
    finite = np.isfinite(slope) & (slope != 0.0)
    error = {
        name: float(v * clock.sd)
        for name, v, some in zip(vector.names, slope, finite, strict=True)
        if some
    }
    base = TimeBase(clock.source, clock.sd, clock.declared, error)
    sentence = _words(base, _what(base, vector) if known is None else _most(base, vector))
    unseen = [*(result.diagnostics.get("unseen") or ()), sentence]
    told = _alike(vector) if summed else ()
    return replace(
        result, clock=base, diagnostics=result.diagnostics | {"unseen": unseen},
        findings=(*result.findings, *told),
    )  # fmt: skip


ALIKE = 0.1  # Three scale factors within so much of their mean are off by one cause [1].

FAR = 2e-3
"""Gravity is not so far off anywhere, and few accelerometers are by chance all alike [1]."""


def _alike(vector: CoefficientVector) -> tuple[Finding, ...]:
    """Tell increments whose accelerometer scale factors are off alike: their interval is wrong."""
    names = [f"accel.scale.{axis}" for axis in AXES]
    if not all(name in vector.layout for name in names):
        return ()
    scales = np.array([vector.value(name) for name in names])
    mean = float(scales.mean())
    if not abs(mean) > FAR or not np.abs(scales - mean).max() < ALIKE * abs(mean):
        return ()
    return (finding("log.alike", percent=f"{100 * mean:+.3g}", clock=f"{-100 * mean:+.3g}"),)


def in_words(result: Result) -> str:
    """Say what stands in a table of coefficients, and what the clock adds in seconds."""
    base = result.clock
    if base is None or not base.error:
        return ""
    names = {"gyro": "gyros", "accel": "accelerometers"}
    heads = dict.fromkeys(name.partition(".")[0] for name in base.error)
    alike = heads.keys() <= names.keys()  # else it is another share of each
    triads = " to the " + " and ".join(names[head] for head in heads) if alike else ""
    return (
        f"sd in the log's own time; in seconds {WORDS[base.source]} adds {base.sd * 1e6:.3g} ppm"
        f"{triads}: `sd in seconds` of the report."
    )


def _what(base: TimeBase, vector: CoefficientVector) -> str:
    """Say which coefficients follow the clock, one by one."""
    drift = ("drift rates", "gyro.drift.") if is_cluster(vector) else ("gyro biases", "gyro.bias.")
    groups = (
        ("torquer scale factors", "gyro.torquer_scale."), ("gyro scale factors", "gyro.scale."),
        ("accelerometer scale factors", "accel.scale."), drift,
    )  # fmt: skip
    what = [what for what, start in groups if any(name.startswith(start) for name in base.error)]
    return f"a clock that is 1 ppm fast is 1 ppm in all {' and '.join(what) or 'coefficients'}"


def _most(base: TimeBase, vector: CoefficientVector) -> str:
    """Say which coefficient the clock changes most, against its standard deviation."""
    sd = dict(zip(vector.names, vector.sd.tolist(), strict=True))
    share = {n: abs(e) / sd[n] for n, e in base.error.items() if sd[n] > 0}
    worst = max(share, key=lambda n: share[n], default="")
    return f"a clock of all that was logged that is fast changes {worst} most"


def _words(base: TimeBase, what: str) -> str:
    if not base.error:
        return (
            "A wrong time base: no reference of this session is counted by the clock of the log, "
            "so that it changes no coefficient."
        )
    known = "declared" if base.declared else "taken for it; declare clock or clock_sd in [log]"
    return (
        f"A wrong time base: {what}. The time is that of {WORDS[base.source]}, "
        f"{base.sd * 1e6:.3g} ppm ({known}): part of every uncertainty in seconds, not of those in "
        "the log's own time."
    )


# -- what a session cannot see ---------------------------------------------------------------------

BEYOND_THE_SESSION = (
    "Specific force beyond 1 g: there the result is extrapolated.",
    "Other temperatures than that of the session.",
)
"""What no session at rest and at one temperature sees."""

EARTH_ROTATION = (
    "The Earth's rotation: where no latitude is used it cannot be told from gyro bias, and is part "
    "of its uncertainty."
)
"""What rests see of the Earth where it is not said where they are."""


def steps_unnoticed(gyro: float, accel: float) -> str:
    """Say that smaller steps of biases need not show.

    `gyro`, `accel`: step that does, of gyros [rad/s] and of accelerometers [m/s^2].
    """
    sizes = (("angular rate", gyro), ("specific force", accel))
    least = [f"{plain(convert(x, k, unit), 2)} {unit}" for k, x in sizes
             if (unit := display_unit(k, x))]  # fmt: skip
    return (
        f"Biases that change at once within the session, of the gyros by less than {least[0]} or "
        f"of the accelerometers by less than {least[1]}, and slow changes: they count as far as a "
        "drift or a wander is declared."
    )


def believed(sd: float, size: float, unit: str) -> str:
    """Say how well something is known: `sd` [SI], `size` of its `unit` [SI]."""
    if not sd:
        return "it was taken as exact"
    return f"its standard uncertainty, {sd / size:.3g} {unit}, is part of every uncertainty"


def wrong_gravity(sd: float) -> str:
    """Say what a wrong local gravity, known to `sd` [m/s^2], does."""
    known = believed(sd, 1e-5, "mGal")
    return (
        f"A wrong local gravity: 1 ppm of g is 1 ppm in all accelerometer scale factors; {known}."
    )


def triad_columns(name: str, x: FloatArray) -> dict[str, FloatArray]:
    """Return the columns of a table that vectors `x` (n, 3) [any unit] make."""
    return {f"{name}_{axis}": x[:, k] for k, axis in enumerate(AXES)}


def worst_residuals(estimate: Estimate) -> FloatArray:
    """Return the largest white residual of each observation with its sign, shape (n,) [1]."""
    rows = estimate.residuals[estimate.blocks >= 0].reshape(-1, 3)
    return np.asarray(np.take_along_axis(rows, np.abs(rows).argmax(axis=1)[:, None], 1)[:, 0])


COMMON = 1500e-6
"""All three scale factor errors alike and larger than this look like a wrong reference [1]."""


def common_scale(c: CoefficientVector, gravity: float, codes: Mapping[str, str]) -> list[Finding]:
    """Say which triad's scale factors look like a wrong reference; `gravity` [m/s^2]."""
    out = []
    for triad, code in codes.items():
        if f"{triad}.scale.x" not in c.layout:
            continue
        values = c[f"{triad}.scale"].values
        mean = float(values.mean())
        if abs(mean) > COMMON and float(np.ptp(values)) < abs(mean) / 3:
            out.append(finding(code, ppm=f"{mean * 1e6:.0f}", gravity=f"{gravity:.5f}"))
    return out
