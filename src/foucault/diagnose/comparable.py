"""What of several results can be compared: the same coefficients in the same axes, and what they
share.

Body axes are a choice (see `models.imu.Gauge`). Where results chose differently, those that know
the whole accelerometer matrix are turned into one gauge with their covariance; where one does not,
only what no choice of axes moves is compared: biases, asymmetries and cubic terms act on what is
read or sensed, not on axes.

Two results of one log have the same noise, and a result that took another as its prior repeats it:
neither is a second measurement, and both are refused. Local gravity that two results were given for
the same site is wrong by the same amount in both; that error is shared, not independent.

Results in time, and models of their values solved by weighted least squares.

Results x_i with covariances P_i obey ``x_i = sum_j A_ij beta_j + e_i``: one constant value, a
straight line in time, or a step. Errors of different results are independent but for what they
share, ``e_i = own_i + L_i g`` with g of unit variance, which is solved for beside beta.

The error of local gravity that several results owe to the same number.

Two results that were given gravity of the same place are wrong by it in the same direction: their
difference does not know it, and more of them do not make it smaller. A procedure that uses gravity
otherwise than for the norm of specific force says itself what its error makes, and so does a result
that was made of others (merged, or with an earlier one as prior), site by site.

Results over temperature taken at one, that they may be compared.

A result whose coefficients are functions of temperature is compared at the mean temperature of the
results that are not, or at the mean of their references where all are. How far a coefficient is
from its function at each measurement belongs to what the function does not say of the instrument.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, cast

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import Coefficient, CoefficientVector, Layout
from foucault.errors import Finding, error, finding, listed
from foucault.models import cluster, imu
from foucault.models.imu import Gauge, ImuModel, coefficient_slot
from foucault.models.layouts import gravity_slope, is_cluster, is_imu, of_one_sample, of_sensors
from foucault.result import Level, Result
from foucault.units import ZERO_CELSIUS

DAY = 86400.0  # A slope over less says nothing of a year [s].


@dataclass(frozen=True)
class Series:
    """Results with the same coefficients, n of them, in order of time."""

    names: tuple[str, ...]  # (p,) coefficients
    time: FloatArray  # (n,) when each result holds, since 1970; NaN where unknown [s]
    values: FloatArray  # (n, p) coefficients [SI]
    cov: FloatArray  # (n, p, p) covariance of each result, what it shares with others included [SI]
    # (n, p, q) errors L that results share, per unit of each of their q sources [SI]
    shared: FloatArray

    def __len__(self) -> int:
        return len(self.values)

    @property
    def sd(self) -> FloatArray:
        """Standard deviations, shape (n, p) [SI]."""
        return np.sqrt(np.diagonal(self.cov, axis1=1, axis2=2))

    @property
    def dated(self) -> bool:
        """Whether a drift per year can be told: all times are known, and they span a day."""
        return bool(np.isfinite(self.time).all() and np.ptp(self.time) >= DAY)

    def only(self, columns: list[int]) -> Series:
        """Return some coefficients, `columns` are their numbers, shape (m,) [1]."""
        return replace(
            self,
            names=tuple(self.names[k] for k in columns),
            values=self.values[:, columns],
            cov=self.cov[:, columns][:, :, columns],
            shared=self.shared[:, columns],
        )

    def without(self, k: int) -> Series:
        """Return all coefficients but number `k`, shape () [1]."""
        return self.only([j for j in range(len(self.names)) if j != k])


@dataclass(frozen=True)
class Fit:
    """A model of the values in time, solved by weighted least squares."""

    # values, sd: (r, p) parameters and their standard deviations [SI, per unit of the design]
    values: FloatArray
    sd: FloatArray
    chi_square: float  # sum of squares left [1]
    dof: int  # its degrees of freedom [1]


def fit(series: Series, design: FloatArray) -> Fit:
    """Solve ``x_i = sum_j design_ij beta_j`` [SI]; `design` (n, r), its first column 1 [any]."""
    (n, p), r = series.values.shape, design.shape[1]
    if p == 0:
        return Fit(np.zeros((r, 0)), np.zeros((r, 0)), 0.0, 0)
    J, y, scale = _whitened(series, design[None])
    Q, R = np.linalg.qr(J[0])
    beta = np.linalg.solve(R, Q.T @ y)
    left = y - J[0] @ beta
    sd = np.linalg.norm(np.linalg.inv(R), axis=1)[: r * p].reshape(r, p) * scale
    values = beta[: r * p].reshape(r, p) * scale
    values[0] += series.values[0]
    return Fit(values, sd, float(left @ left), (n - r) * p)


def _whitened(series: Series, designs: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the equations of `designs` (m, n, r) [any] with errors of unit variance, and scales.

    Equations (m, n p + q, r p + q) with their right side (n p + q,) [1], and scales (p,) [SI].
    """
    (n, p), (m, _, r), q = series.values.shape, designs.shape, series.shared.shape[2]
    scale = np.median(series.sd, axis=0)
    shared = series.shared / scale[:, None]
    own = series.cov / np.outer(scale, scale) - shared @ shared.swapaxes(1, 2)
    white = np.linalg.inv(np.linalg.cholesky(own))
    moved = (series.values - series.values[0]) / scale  # values are many sd: keep the digits
    J = np.zeros((m, n * p + q, r * p + q))
    J[:, : n * p, : r * p] = np.einsum("mij,iab->miajb", designs, white).reshape(m, n * p, r * p)
    J[:, : n * p, r * p :] = (white @ shared).reshape(n * p, q)
    J[:, n * p :, r * p :] = np.eye(q)
    y = np.concatenate([np.einsum("iab,ib->ia", white, moved).ravel(), np.zeros(q)])
    return J, y, scale


def constant(series: Series) -> Fit:
    """Fit one value to all results of a `series`, shape (n,) [SI]."""
    return fit(series, np.ones((len(series), 1)))


def line(series: Series) -> Fit:
    """Fit a value in the middle of the time and a slope, both of `series`, shape (n,) [SI/s]."""
    return fit(series, np.stack([np.ones(len(series)), _from_middle(series.time)], axis=1))


def _from_middle(time: FloatArray) -> FloatArray:
    return cast(FloatArray, time - time.mean())


def step(series: Series) -> tuple[int, Fit]:
    """Fit a step after one of the results of a `series`, shape (n,): which, and the fit [SI]."""
    n = len(series)
    after = np.arange(n - 1)
    designs = np.ones((n - 1, n, 2))
    designs[:, :, 1] = np.arange(n) > after[:, None]
    J, y, _ = _whitened(series, designs)
    Q = np.linalg.qr(J)[0]
    left = y - (Q @ (Q.swapaxes(1, 2) @ y)[..., None])[..., 0]
    best = int(np.argmin(np.sum(left**2, axis=1)))
    return best, fit(series, designs[best])


Site = tuple[Any, ...]  # Gravity, its standard deviation, latitude and height.
KEY = "gravity_errors"  # Where a result that says so itself keeps them, in its diagnostics.


def gravity_errors(result: Result, vector: CoefficientVector) -> dict[Site, FloatArray]:
    """Return the errors that gravity makes in `vector`, per standard deviation of it.

    `vector`: its coefficients, turned perhaps into other axes [SI]. Returns (n,): site -> error of
    each coefficient [SI]; empty where gravity plays no part.
    """
    kept = result.diagnostics.get(KEY)
    if kept is not None:
        return {
            tuple(row["site"]): np.array([row["error"].get(n, 0.0) for n in vector.names])
            for row in kept
        }
    part = (result.diagnostics.get("budget") or {}).get("local gravity")
    gravity, sd = result.site.get("gravity"), result.site.get("gravity_sd")
    if not (part and gravity and sd) or is_cluster(result.coefficients):
        return {}
    return {site_of(result.site): gravity_slope(vector) * sd / gravity}


def site_of(said: Mapping[str, Any]) -> Site:
    """Return which gravity it is that a result was given, from its `site`."""
    gravity, sd, latitude, height = map(said.get, ("gravity", "gravity_sd", "latitude", "height"))
    return gravity, sd, latitude, height


def as_kept(errors: Mapping[Site, Mapping[str, float]]) -> list[dict[str, Any]]:
    """Return `errors`, site -> coefficient -> per sd of gravity [SI], as diagnostics keep them."""
    return [{"site": list(site), "error": dict(error)} for site, error in errors.items()]


def of_site(
    said: Mapping[str, Any], names: tuple[str, ...], error: FloatArray
) -> dict[str, list[dict[str, Any]]]:
    """Return the diagnostics of one gravity: `error` (n,) of names per sd of gravity [SI]."""
    return {KEY: as_kept({site_of(said): dict(zip(names, error.tolist(), strict=True))})}


UNMOVED = ("accel_bias", "gyro_bias", "accel_asymmetry", "gyro_asymmetry", "gyro_cubic")
"""Blocks of `ImuModel` that no choice of body axes changes."""

DEPENDENT = 1e-8
"""A coefficient of which the others leave a smaller share of the variance follows from them [1]."""

LEANS = 0.1  # A prior with a larger share of the information than this pulls results together [1].
WARMER = 2.0  # Mean temperatures farther apart than this are worth a word [K].
NUDGE = 1e-5  # Step of a numerical derivative, beside angles of up to some degrees [SI].


@dataclass(frozen=True)
class Entry:
    """A result that is to be compared."""

    label: str  # what it is called
    result: Result  # the result [SI]
    instrument: str  # which instrument it is of
    time: float = float("nan")  # when it holds, since 1970; NaN where unknown [s]
    dated: str = ""  # where that is from: "given", "log", "computed", or nothing
    sha256: str = ""


@dataclass(frozen=True)
class Comparable:
    """Results brought to the same coefficients."""

    layout: Layout  # the coefficients that all of them have, p of them
    series: Series  # their values [SI]
    findings: tuple[Finding, ...]  # what the user should know


def comparable(entries: Sequence[Entry]) -> Comparable:
    """Bring results to the same coefficients in the same axes.

    Returns what they have in common [SI]. Raises ``compare.*``: results that are not independent,
    not of one kind, or with nothing in common.
    """
    refuse_dependent(entries)
    kinds = [_kind(e.result) for e in entries]
    for entry, kind in zip(entries, kinds, strict=True):
        if kind != kinds[0]:
            raise error(
                "compare.models", one=entries[0].label, kind=kinds[0], other=entry.label,
                unlike=kind,
            )  # fmt: skip
        if not np.isfinite(entry.result.coefficients.values).all():
            raise error("compare.not_finite", name=entry.label, status=entry.result.status.value)
    vectors, found = _in_one_gauge(entries, [_of_instrument(e) for e in entries])
    layout, told = _common(entries, vectors)
    found += told
    chosen = [v.chosen(layout.names) for v in vectors]
    cov = np.stack([v.cov for v in chosen if v.cov is not None])
    keep = _independent(cov)
    layout = layout.subset(layout.names[k] for k in keep)
    values = np.stack([v.values for v in chosen])
    shared, told = _gravity(entries, vectors, chosen, cov)
    found += told + _warnings(entries, layout)
    time = np.array([e.time for e in entries])
    whole = Series(chosen[0].names, time, values, cov, shared)
    return Comparable(layout, whole.only(keep), tuple(found))


# -- what cannot be compared -----------------------------------------------------------------


def refuse_dependent(entries: Sequence[Entry]) -> None:
    """Refuse results [SI] that share a log, or of which one was the prior of another.

    The file of a vehicle holds logs of several instruments, told apart by their topic.
    """
    topics = [_topic(e.result.provenance) for e in entries]
    logs = [_hashes(e.result.provenance, ("input", "inputs")) for e in entries]
    priors = [_hashes(e.result.provenance, ("prior",)) for e in entries]
    for i, j in combinations(range(len(entries)), 2):
        one, other = entries[i], entries[j]
        apart = None not in (topics[i], topics[j]) and topics[i] != topics[j]
        if (logs[i] & logs[j] and not apart) or (one.sha256 and one.sha256 == other.sha256):
            raise error("compare.same_log", one=one.label, other=other.label)
        for late, early in ((i, j), (j, i)):
            if priors[late] & (logs[early] | {entries[early].sha256}):
                names = {"late": entries[late].label, "early": entries[early].label}
                raise error("compare.took_prior", **names)
        if priors[i] & priors[j]:
            raise error("compare.same_prior", one=one.label, other=other.label)


def _topic(made: Mapping[str, Any]) -> str | None:
    """Return which of the instruments in a file a result is of."""
    said = (made.get("input") or {}).get("description") or {}
    return said.get("topic") if isinstance(said, Mapping) else None


def _hashes(value: Any, below: tuple[str, ...] | None = None) -> set[str]:
    """Return every SHA-256 that a part of a provenance names."""
    if isinstance(value, Mapping):
        parts = [v for k, v in value.items() if below is None or k in below]
        own = value.get("sha256") if below is None else None
        said = set(own.split(" + ")) if isinstance(own, str) else set[str]()
        return said.union(*(_hashes(part) for part in parts))
    if isinstance(value, list):
        return set[str]().union(*(_hashes(item) for item in value))
    return set()


def _kind(result: Result) -> str:
    return "a torqued cluster" if is_cluster(result.coefficients) else "an IMU"


# -- the same axes ---------------------------------------------------------------------------


def _of_instrument(entry: Entry) -> CoefficientVector:
    """Return what belongs to the instrument, not to how it was mounted or stood in the end."""
    result = entry.result
    # Two loggers are wrong each by itself, so that only seconds compare; the oscillator of a sensor
    # goes with it, and what changes in it is a change of the instrument.
    own = result.clock is not None and result.clock.source == "sensor"
    vector = of_sensors(result.coefficients if own else result.in_seconds)
    return vector.chosen(n for n in vector.names if n not in cluster.ATTITUDE)


def _in_one_gauge(
    entries: Sequence[Entry], vectors: list[CoefficientVector]
) -> tuple[list[CoefficientVector], list[Finding]]:
    gauges = [e.result.gauge for e in entries]
    if len(set(gauges)) == 1:
        return vectors, []
    turned = [_turned(v, g) for v, g in zip(vectors, gauges, strict=True)]
    if all(v is not None for v in turned):
        which = ", ".join(
            e.label for e, g in zip(entries, gauges, strict=True) if g != Gauge.LOWER.value
        )
        told = finding("compare.turned", names=which, gauge=Gauge.LOWER.value)
        return [v for v in turned if v is not None], [told]
    kept = [v.chosen(n for n in v.names if _unmoved(n)) for v in vectors]
    said = "; ".join(dict.fromkeys(f"{e.label}: {e.result.gauge}" for e in entries))
    return kept, [finding("compare.gauge", gauges=said)]


def _unmoved(name: str) -> bool:
    return name in imu.LAYOUT and coefficient_slot(name)[0] in UNMOVED


def _turned(vector: CoefficientVector, gauge: str) -> CoefficientVector | None:
    """Return coefficients with their covariance in `Gauge.LOWER`; None where it cannot be told."""
    if gauge == Gauge.LOWER.value:
        return vector
    vector = of_one_sample(vector)
    if not is_imu(vector) or not _whole(vector, gauge):
        return None
    below = ("accel.misalignment.yx", "accel.misalignment.zx", "accel.misalignment.zy")
    angles = [n for n in imu.LAYOUT.names if n.startswith("accel.misalignment.")]
    names = tuple(
        n for n in imu.LAYOUT.names if n in below or (n in vector.layout and n not in angles)
    )

    def turned(x: FloatArray) -> FloatArray:
        model = ImuModel.from_coefficients(CoefficientVector(vector.layout, x))
        return model.in_gauge(Gauge.LOWER)[0].coefficients(names).values

    x = vector.values
    slope = np.stack(
        [(turned(x + d) - turned(x - d)) / (2 * NUDGE) for d in NUDGE * np.eye(len(x))], axis=1
    )
    free = np.array([bool(vector.free[np.abs(row) > DEPENDENT].any()) for row in slope])
    cov = None if vector.cov is None else slope @ vector.cov @ slope.T
    return CoefficientVector(imu.LAYOUT.subset(names), turned(x), cov, free)


def _whole(vector: CoefficientVector, gauge: str) -> bool:
    """Whether all of the accelerometer matrix is known: six numbers, or nine in axes of a rig."""
    places = [coefficient_slot(n) for n in vector.names]
    known = {where for block, where in places if block == "accel_matrix"}
    upper = {(i, j) for i in range(3) for j in range(3) if gauge != Gauge.UPPER.value or i <= j}
    return upper <= known


# -- the same coefficients -------------------------------------------------------------------


def _common(
    entries: Sequence[Entry], vectors: Sequence[CoefficientVector]
) -> tuple[Layout, list[Finding]]:
    """Return the coefficients that all results have measured."""
    every: dict[str, Coefficient] = {c.name: c for v in vectors for c in v.layout.coefficients}
    order = [*vectors[0].names, *(n for n in every if n not in vectors[0].layout)]
    missing = [n for n in order if any(n not in v.layout for v in vectors)]
    both = [n for n in order if n not in missing]
    held = [n for n in both if any(not v.free[v.layout.index(n)] for v in vectors)]
    sd = {n: [float(v.sd[v.layout.index(n)]) for v in vectors] for n in both}
    unknown = [n for n in both if n not in held and not all(0 < s < np.inf for s in sd[n])]
    found = []
    if missing:
        found.append(finding("compare.only_some", names=listed(missing)))
    if held:
        found.append(finding("compare.held", names=listed(held)))
    if unknown:
        found.append(finding("compare.no_sd", names=listed(unknown)))
    kept = [n for n in both if n not in held and n not in unknown]
    if not kept:
        raise error("compare.nothing", names=", ".join(e.label for e in entries))
    return Layout(tuple(every[n] for n in kept)), found


def _independent(cov: FloatArray) -> list[int]:
    """Return the coefficients that do not follow from others in any of the covariances.

    A model with fewer parameters than coefficients makes a covariance without an inverse; what
    follows from the others tells nothing of its own.
    """
    keep = list(range(cov.shape[1]))
    for P in cov:
        sd = np.sqrt(np.diag(P))
        rest = P / np.outer(sd, sd)
        kept: list[int] = []
        for k in keep:
            if rest[k, k] > DEPENDENT:
                kept.append(k)
                rest = rest - np.outer(rest[:, k], rest[k]) / rest[k, k]
        keep = kept
    return keep


# -- what they share -------------------------------------------------------------------------


def _gravity(
    entries: Sequence[Entry], vectors: Sequence[CoefficientVector],
    chosen: Sequence[CoefficientVector], cov: FloatArray,
) -> tuple[FloatArray, list[Finding]]:  # fmt: skip
    """Return the errors that a common local gravity makes, shape (n, p, sites) [SI]."""
    errors = [gravity_errors(e.result, v) for e, v in zip(entries, vectors, strict=True)]
    sites = list(dict.fromkeys(site for one in errors for site in one))
    together = [s for s in sites if sum(s in one for one in errors) > 1]
    none = np.zeros((*cov.shape[:2], 0))
    shared = np.zeros((*cov.shape[:2], len(together)))
    for i, one in enumerate(errors):
        where = [vectors[i].layout.index(n) for n in chosen[i].names]
        for s, site in enumerate(together):
            if site in one:
                shared[i, :, s] = one[site][where]
    own = cov - shared @ shared.swapaxes(1, 2)
    if not together or (np.linalg.eigvalsh(_scaled(own, cov))[:, 0] < DEPENDENT).any():
        return none, []
    return shared, [
        finding("compare.gravity", count=sum(any(s in one for s in together) for one in errors))
    ]


def _scaled(own: FloatArray, cov: FloatArray) -> FloatArray:
    sd = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
    return np.asarray(own / (sd[:, :, None] * sd[:, None, :]))


def _warnings(entries: Sequence[Entry], layout: Layout) -> list[Finding]:
    found = []
    bad = [e.label for e in entries if e.result.verdict.level is Level.UNUSABLE]
    if bad:
        found.append(finding("compare.unusable", names=listed(bad)))
    leaning = [n for n in layout.names if all(_leans(e.result, n) for e in entries)]
    if leaning:
        found.append(finding("compare.prior", names=listed(leaning), share=100 * LEANS))
    warm = {e.label: e.result.validity.get("temperature_mean") for e in entries}
    known = {label: float(t) for label, t in warm.items() if t is not None}
    if known and max(known.values()) - min(known.values()) > WARMER:
        said = ", ".join(f"{label} {t - ZERO_CELSIUS:.1f} °C" for label, t in known.items())
        found.append(finding("compare.temperature", temperatures=said))
    return found


def _leans(result: Result, name: str) -> bool:
    vector = result.coefficients
    if name not in vector.layout:
        return False
    one = vector.chosen([name])
    return bool((one.sd[0] / one.prior_sd[0]) ** 2 > LEANS)


def at_one_temperature(entries: Sequence[Entry]) -> tuple[list[Entry], list[Finding]]:
    """Return the results with coefficients that do not change with temperature.

    `entries`: the results, one whose functions do not reach the common temperature is refused
    [SI].
    """
    models = [getattr(e.result, "temperature", None) for e in entries]
    over = [(e, m) for e, m in zip(entries, models, strict=True) if m is not None]
    if not over:
        return list(entries), []
    warm = [
        e.result.validity.get("temperature_mean")
        for e, m in zip(entries, models, strict=True)
        if m is None
    ]
    known = [float(t) for t in warm if t is not None] or [float(m.reference) for _, m in over]
    common = float(np.mean(known))
    out = []
    for entry, model in zip(entries, models, strict=True):
        if model is None:
            out.append(entry)
            continue
        vector = model.at(common)
        extra = np.where(vector.free, np.nan_to_num(model.scatter) ** 2, 0.0)
        taken = replace(
            entry.result,
            coefficients=replace(vector, cov=vector.cov + np.diag(extra)),
            validity=dict(entry.result.validity) | {"temperature_mean": common},
            temperature=None,
        )
        out.append(replace(entry, result=taken))
    names = ", ".join(e.label for e, _ in over)
    degrees = f"{common - ZERO_CELSIUS:.1f}"
    return out, [finding("compare.at_temperature", names=names, temperature=degrees)]
