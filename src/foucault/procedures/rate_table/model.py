"""What gyros say on a rate table: several constant rates about each axis, and what spoils them.

In step k the table turns at the rate W_k about the vertical, and the placement of the instrument
says which of its axes is there: ``u`` in fixture axes. Over whole turns the mean rate is that of
table and Earth along u; with ``r = (I + S + M) w``::

    w = (W + v) u        gyro = r + A |r| + C r^3 + b + G f        f = g u + (centripetal)

v is the Earth's rate along up. What is not known of table, fixture, place and bias is a source of
error each: an error that all rates share, another one in every step, the tilts of u, the Earth's
rate where the latitude is unknown and where a step is no whole turn, a bias that moves.

A session on a rate table: what can be chosen of its calibration, and how one is simulated.

Judge a calibration on a rate table: can it be made, is it right, what do standards ask for.

References
----------
.. [1] IEEE Std 647-2006, annex A, and IEEE Std 952-1997, section 12 (rate table tests).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from foucault import units
from foucault.arrays import BoolArray, FloatArray
from foucault.coefficients import CoefficientVector, Layout
from foucault.diagnose.checks import check, reversed_earth_check
from foucault.diagnose.fit_checks import Judged
from foucault.diagnose.fit_checks import checks as fit_checks
from foucault.diagnose.rate_table import lacking, name_of
from foucault.errors import Finding, error, finding
from foucault.infer import mixed
from foucault.infer.information import BLURRED
from foucault.infer.left_out import Judgement
from foucault.infer.mixed import (
    NOISE_BASIS,
    Covariance,
    Fit,
    Linearisation,
    Source,
)
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import LAYOUT, ImuModel, Slopes
from foucault.models.noise import ImuNoise, wander
from foucault.models.rests_and_turns import Steps
from foucault.procedures import record
from foucault.procedures.chosen import Chosen
from foucault.result import Check
from foucault.simulate.rate_table import (
    RatePlan,
    RateTableSimulation,
    TableErrors,
    simulate_rate_table,
)
from foucault.strict import Strict
from foucault.tables import AXES
from foucault.units import AngleSd, RatioSd, Seconds, plain

TIMES = (np.inf, 1.0, 0.5, 0.25, 0.12, 0.06)
"""Correlation times that are tried, as parts of the session; infinite: a straight line [1]."""

PRICE = {"rate scatter": 6.0, "bias drift": 8.0}
"""Twice the log-likelihood that each kind of scatter must gain: that of the bias is the larger one
because it is chosen among several that differ in their correlation time [1]."""

FEWEST = 6  # With fewer readings beyond the unknowns no scatter is looked for [1].


@dataclass(frozen=True)
class RateTable:
    """The steps of a session, as `infer.mixed` has them."""

    steps: Steps
    names: tuple[str, ...]
    settings: Settings
    latitude: float | None = None  # geodetic latitude, positive north; None where unknown [rad]
    # where the noise is from; one that is unknown is found from the residuals
    noise: Literal["declared", "measured", "unknown"] = "declared"
    # correlation time of a bias that moves, if it does; 0: another bias in every step; infinite: a
    # straight line [s]
    bias_time: float = 0.0

    @property
    def layout(self) -> Layout:
        """The coefficients."""
        return LAYOUT.subset(self.names)

    @property
    def kinds(self) -> Mapping[str, BoolArray]:
        """All steps are of one kind."""
        return {"steps": np.ones((len(self.steps), 3), bool)}

    @property
    def vertical(self) -> float:
        """The Earth's rate along up, 0 where unknown [rad/s]."""
        return 0.0 if self.latitude is None else float(EARTH_RATE * np.sin(self.latitude))

    @property
    def level_sd(self) -> float:
        """Sd of the Earth's rate along each direction across up [rad/s].

        Its size is known with the latitude, its azimuth is not. A vector of which nothing is known,
        all places being alike, has a third of its square along any direction, along up too.
        """
        share = 1 / np.sqrt(3) if self.latitude is None else np.cos(self.latitude) / np.sqrt(2)
        return float(EARTH_RATE * abs(share))

    @property
    def looks_for_scatter(self) -> bool:
        """Whether scatter beyond the noise is looked for; it is not told from unknown noise."""
        enough = self.steps.gyro.size - len(self.names) >= FEWEST
        return self.settings.repeatability and self.noise != "unknown" and enough

    @cached_property
    def noise_root(self) -> FloatArray:
        """What the noise of each gyro does to each step, of any size if unknown, (n, 3, 3) [rad/s].

        Of noise that nobody knows it is taken that it is white: it averages out.
        """
        root = np.linalg.cholesky(self.steps.cov)
        if self.noise == "unknown":
            root = root * np.sqrt(np.median(self.steps.time) / self.steps.time)[:, None, None]
        return np.asarray(root)

    @property
    def start(self) -> ImuModel:
        """The straight lines through all readings, where there are enough to have them."""
        s, h = self.steps, self.steps.rate + self.vertical
        size = float(np.abs(h).max()) or 1.0
        rows = np.column_stack([h[:, None] * s.up / size, np.ones(len(h))])
        solved, _, rank, _ = np.linalg.lstsq(rows, s.gyro, rcond=1e-9)
        if rank < 4:
            return ImuModel()
        return ImuModel(gyro_matrix=np.asarray(solved[:3].T / size), gyro_bias=solved[3])

    def linearise(self, state: ImuModel) -> Linearisation:
        """Compare the readings with those of an instrument."""
        s = self.steps
        w = (s.rate + self.vertical)[:, None] * s.up
        slopes = state.slopes(s.force, w, self.names)
        miss = s.gyro - state.measure(s.force, w)[1]
        return Linearisation(miss, slopes.gyro, self._sources(slopes))

    def retract(self, state: ImuModel, step: FloatArray) -> ImuModel:
        """Add `step` (m,) to the coefficients [SI]."""
        return state.moved(self.names, step)

    def values(self, state: ImuModel) -> FloatArray:
        """Return the coefficients of an instrument [SI]."""
        return state.coefficients(self.names).values

    def _sources(self, slopes: Slopes) -> tuple[Source, ...]:
        s, chosen = self.steps, self.settings
        by_rate = slopes.gyro_by_rate @ s.up[:, :, None]  # by the rate about up
        jitter = by_rate * s.rate[:, None, None]
        h = (s.rate + self.vertical)[:, None, None]
        g = np.linalg.norm(s.force, axis=1)[:, None, None]
        tilted = (h * slopes.gyro_by_rate + g * slopes.gyro_by_force) @ s.level
        still = s.rate == 0.0
        level = slopes.gyro_by_rate @ s.level_at_zero * still[:, None, None]
        # A part of a turn begins at any azimuth. What is left of whole turns is rounding.
        left = np.abs(np.sinc(s.turns))[:, None, None] * ~still[:, None, None]
        parts = slopes.gyro_by_rate @ s.level * np.where(left > 1e-9, left, 0.0)
        kind, basis = NOISE_BASIS[self.noise]
        size = None if self.noise == "unknown" else 1.0
        out = [
            Source("gyro noise", self.noise_root, sd=size, noise=True, price=0.0,
                   type=kind, basis=basis),
            Source("rate of the table", shared=jitter, sd=chosen.table_rate_sd,
                   basis="table_rate_sd as given in the campaign"),
            Source("rate jitter", jitter, sd=chosen.rate_sd,
                   basis="rate_sd as given in the campaign"),
            Source("fixture", shared=self._of_placements(tilted), sd=chosen.fixture_sd,
                   basis="fixture_sd as given in the campaign"),
            Source("level Earth rate", shared=self._of_placements(level), sd=self.level_sd,
                   basis="Earth rate across the axis at rest, in any direction"),
            Source("parts of turns", parts, sd=self.level_sd,
                   basis="Earth rate across the axis that a part of a turn leaves"),
        ]  # fmt: skip
        if self.latitude is None:
            out.append(Source("unknown Earth rate", shared=by_rate, sd=self.level_sd,
                              basis="latitude not given: any direction"))  # fmt: skip
        if (lost := still & ~s.azimuth_known).any():
            # Rests of one placement are at one angle, as whole turns leave them, or else scatter.
            kind, basis = "A", "scatter of the rests, whose table angles the log does not tell"
            out.append(Source("angle of the table", level * lost[:, None, None], sd=None,
                              type=kind, basis=basis))  # fmt: skip
        if s.slow is not None:
            out.append(Source("slow noise of gyros", shared=self._slow, noise=True,
                              basis="slow noise as given in the campaign"))  # fmt: skip
        if self.looks_for_scatter:
            moved = mixed.scatter("bias drift", *self._bias, PRICE["bias drift"])
            # Another bias in every step is not told from noise that is larger than was said.
            moved = replace(moved, unexplained=self.bias_time == 0.0)
            out += [mixed.scatter("rate scatter", jitter, price=PRICE["rate scatter"]), moved]
        return tuple(out)

    def _of_placements(self, each: FloatArray) -> FloatArray:
        """Let the steps of a placement share their causes: (n, 3, c) -> (n, 3, p c)."""
        n, _, c = each.shape
        wide = np.zeros((n, 3, int(self.steps.placement.max()) + 1, c))
        wide[np.arange(n), :, self.steps.placement] = each
        return wide.reshape(n, 3, -1)

    @cached_property
    def _slow(self) -> FloatArray:
        """What wander of the bias that was declared does, white causes, shape (n, 3, 3 n)."""
        assert self.steps.slow is not None
        return self._alike(wander(self.steps.slow, self.steps.middle, self.steps.time))

    @cached_property
    def _bias(self) -> tuple[FloatArray | None, FloatArray | None]:
        """What a bias that moves by 1 rad/s does: in each step, or shared by them.

        A Gauss-Markov process, or a straight line of that root mean square about the middle of the
        session.
        """
        s = self.steps
        if self.bias_time == 0.0:
            return np.broadcast_to(np.eye(3), s.cov.shape), None
        if np.isinf(self.bias_time):
            line = s.middle - s.half_time
            line /= max(float(np.sqrt(np.mean(line**2))), 1e-12)
            return None, line[:, None, None] * np.eye(3)
        return None, self._alike(np.exp(-np.abs(s.middle[:, None] - s.middle) / self.bias_time))

    def _alike(self, cov: FloatArray) -> FloatArray:
        """Return white causes of what three axes do, each with the covariance `cov` over steps."""
        return mixed.tied(np.broadcast_to(np.eye(3), self.steps.cov.shape), mixed.root(cov))


LOG_LINES = """\
# A spreadsheet of means, a row per step:  averaged = { column = "averaged", unit = "s" }

# The table; leave out what is not logged ("" in place of an angle), and list `rates` below instead.
[log.table]
columns = ["outer", "", ""]
unit = "rad"
rate = "table_rate"                     # counter-clockwise from above
rate_unit = "rad/s"
"""
"""What the log of a session on a rate table has beside the instrument's columns."""

Axis = Literal["x up", "x down", "y up", "y down", "z up", "z down"]


def in_si(rates: tuple[str, ...]) -> FloatArray:
    """Return rates written with their unit, such as "10 deg/s", shape (k,) [rad/s]."""
    return np.array([units.parse(text, "angular rate", "rates") for text in rates])


Rates = Annotated[tuple[str, ...], record.checked(in_si)]


class Settings(record.Robust, record.EarthRate, Chosen):
    """What can be chosen; the defaults suit most tables."""

    rates: Rates = ()
    """Rates of the table in each placement, in order, counter-clockwise seen from above positive;
    needed where the log carries no rate of the table. Rests between rates above 0.2 deg/s need not
    be listed."""
    axes: tuple[Axis, ...] = ()
    """Placements in order, such as x up; needed where the log has no accelerometers, checked where
    it has. An axis that is not named is not estimated."""
    asymmetry: bool = True
    """Estimate the asymmetry of each scale factor (3 more)."""
    cubic: bool = True
    """Estimate the cubic term of each scale factor (3 more)."""
    g_sensitivity: bool = False
    """Estimate the gyros' g-sensitivity too (9 more); needs every axis up and down."""
    rate_sd: record.RateSd = 0.0
    table_rate_sd: record.TableRateSd = 0.0
    fixture_sd: AngleSd = Field(default=0.0, ge=0)
    """Sd of the tilt of the instrument in each placement, about each level axis."""
    repeatability: record.Repeatability = True
    shortest: record.Shortest = 5.0

    @property
    def placed(self) -> tuple[str, ...]:
        """Axes of the instrument that were along the spin axis: all, unless `axes` names some."""
        return tuple(a for a in AXES if not self.axes or any(p.startswith(a) for p in self.axes))


class Session(Strict):
    """The session that `simulate` makes."""

    rates: Rates = (
        "10 deg/s",
        "-10 deg/s",
        "25 deg/s",
        "-25 deg/s",
        "50 deg/s",
        "-50 deg/s",
        "100 deg/s",
        "-100 deg/s",
    )
    """Rates in each placement, unless [procedure] lists them."""
    axes: tuple[Axis, ...] = ("x up", "x down", "y up", "y down", "z up", "z down")
    """Placements, unless [procedure] lists them."""
    step_time: Seconds = Field(default=30.0, gt=0)
    """Each rate is held for whole turns, at least so long."""
    rest_time: Seconds = Field(default=0.0, ge=0)
    """Length of a rest before each rate and after the last; 0: no rests."""
    asymmetry_sd: RatioSd = Field(default=100e-6, ge=0)
    """Sd of the asymmetry of the scale factors."""
    cubic_sd: RatioSd = Field(default=50e-6, ge=0)
    """Sd of the cubic term at the fastest rate."""
    rate: record.SampleRate = 20.0
    rows: record.Rows = "samples"


def planned(settings: Settings, session: Session) -> RatePlan:
    """Return what the table is to do."""
    rates = in_si(settings.rates or session.rates)
    plan = RatePlan(settings.axes or session.axes, rates, session.step_time)
    return plan.with_rests(session.rest_time) if session.rest_time else plan


def simulated(
    session: Session, settings: Settings, model: ImuModel, noise: ImuNoise, site: Site, seed: int
) -> RateTableSimulation:
    """Simulate a session; what is wrong with table and fixture is drawn from the settings.

    `model`: errors of the instrument, asymmetry and cubic terms are drawn where it has none;
    `seed`: seed of table, instrument and noise [1].
    """
    rng = np.random.default_rng([seed, 3])
    rates = in_si(settings.rates or session.rates)
    asymmetry = session.asymmetry_sd * rng.standard_normal(3)
    cubic = session.cubic_sd * rng.standard_normal(3) / max(float(np.abs(rates).max()), 1e-9) ** 2
    if not model.gyro_asymmetry.any():
        model = replace(model, gyro_asymmetry=asymmetry)
    if not model.gyro_cubic.any():
        model = replace(model, gyro_cubic=cubic)
    errors = TableErrors(
        settings.table_rate_sd * float(rng.standard_normal()),
        settings.rate_sd,
        settings.fixture_sd,
    )
    return simulate_rate_table(
        planned(settings, session), model=model, noise=noise, site=site, errors=errors,
        rate=session.rate, means=session.rows == "means", seed=seed,
    )  # fmt: skip


LARGE_DRIFT = 3.0
"""A bias that moves by more than this many times the noise of a step is no constant [1]."""

LARGE_TERM = 0.05
"""A scale factor that changes by more over its range is a wrong reading, not a gyro [1]."""


@dataclass(frozen=True)
class Solution:
    """A session on a rate table and what was made of it."""

    table: RateTable  # with the correlation time that was found
    fit: Fit
    site: Site  # gravity and latitude; None for a latitude that does not count
    left_out: Judgement | None = None  # what was made of the terms that are not estimated

    @property
    def steps(self) -> Steps:
        """What was measured [SI]."""
        return self.table.steps

    @property
    def model(self) -> ImuModel:
        """The error model found."""
        model: ImuModel = self.fit.state
        return model

    @property
    def scatter(self) -> float:
        """Relative scatter of the rates that was found [1]."""
        return self.fit.found.get("rate scatter", 0.0)

    @property
    def bias_sd(self) -> float:
        """How far the bias was found to move [rad/s]."""
        return self.fit.found.get("bias drift", 0.0)

    @cached_property
    def speed(self) -> FloatArray:
        """True rate along each axis in its steps, with sign, shape (n,) [rad/s]."""
        e, v = (
            float(mixed.causes(self.fit, name).sum())
            for name in ("rate of the table", "unknown Earth rate")
        )
        return (self.steps.rate * (1.0 + e) + self.table.vertical + v) * self.steps.sense


def require_determined(table: RateTable, prior: CoefficientVector | None) -> None:
    """Refuse steps that cannot separate the coefficients.

    `prior` or None: what is known of the coefficients [SI].
    """
    steps, names = table.steps, table.names
    at = table.linearise(table.start)
    # What is unknown of table and place is known so far that it can hide no coefficient.
    noise = [s for s in at.sources if s.name == "gyro noise"]
    every = np.ones(len(steps))
    columns = Covariance(noise, {"gyro noise": 1.0}, (len(steps), 3), every).whiten(at.jacobian)
    if prior is not None:
        columns = np.concatenate([columns, np.diag(1.0 / prior.prior_sd)])
    size = np.linalg.norm(columns, axis=0)
    unit = columns / np.where(size > 0, size, 1.0)
    squares, directions = np.linalg.eigh(unit.T @ unit)
    weak = directions.T[squares < squares[-1] / BLURRED**2]
    if not len(weak):
        return
    seen_in = np.linalg.norm(weak, axis=0)
    blind = [n for n, share in zip(names, seen_in, strict=True) if share > 0.2]
    listed = ", ".join(blind)
    tied = all(n.startswith(("gyro.g_sensitivity.", "gyro.bias.")) for n in blind)
    if tied and any(n.startswith("gyro.g_sensitivity.") for n in blind):
        seen = dict.fromkeys(name_of(u) for u in steps.up)
        raise error("rate_table.g_sensitivity", placements=", ".join(seen), names=listed)
    reason = "; ".join(lacking(steps))
    raise error(
        "rate_table.undetermined", steps=len(steps), names=listed,
        reason=f": {reason}" if reason else "",
    )  # fmt: skip


def checks(e: Solution) -> tuple[Check, ...]:
    """Return every test of the result; a failed one carries its reason."""
    sign = reversed_earth_check(e.fit.estimate.coefficients, e.site)
    return (*fit_checks(judged(e)), *_bent(e), *_drift(e), *([] if sign is None else [sign]))


def judged(e: Solution) -> Judged:
    """Return what every fit is asked, of a session on a rate table."""
    noise = e.table.noise
    return Judged(
        e.fit, {"steps": "steps"}, noise, e.steps.middle,
        found_in={"steps": ("gyro noise",) if noise == "unknown" else tuple(PRICE)},
        readings="steps", cure="Add rates.", more="add rates",
        cause={"steps": f"the rates scatter by {_ppm(e.scatter)} ppm"} if e.scatter else {},
        named=lambda k: f"step {k + 1} ({plain(float(np.degrees(e.steps.rate[k])), 4)} deg/s)",
    )  # fmt: skip


def _bent(e: Solution) -> list[Check]:
    """Judge how much the scale factors change with the rate, where that is estimated."""
    if e.model.straight:
        return []
    top = float(np.abs(e.steps.rate).max())
    change = np.maximum(np.abs(e.model.gyro_asymmetry), np.abs(e.model.gyro_cubic) * top**2)
    ppm = 1e6 * float(change.max())
    return [check("scale factor terms", "scale factor terms", ppm, None, 1e6 * LARGE_TERM)]


def _drift(e: Solution) -> list[Check]:
    """Judge a bias that moves: within the noise it is any gyro's, beyond it a constant is wrong."""
    if not e.bias_sd:
        return []
    noise = np.sqrt(np.trace(e.steps.cov, axis1=1, axis2=2) / 3)
    value = float(e.bias_sd / np.median(noise))
    return [check("bias drift", "bias drift", value, None, LARGE_DRIFT, {"moved": moved(e)})]


def moved(e: Solution) -> str:
    """Say how far the bias moved, and how fast."""
    size, time = plain(float(np.degrees(e.bias_sd)) * 3600, 2), e.table.bias_time
    if time == 0.0:
        return f"{size} deg/h (sd) from step to step"
    if np.isinf(time):
        return f"{size} deg/h (sd) along a straight line, and is that of the middle of the session"
    return f"{size} deg/h (sd) over {plain(time / 60, 2)} min"


def _ppm(share: float) -> str:
    return f"{1e6 * share:.3g}"


def hints(e: Solution) -> list[Finding]:
    """Return findings about the session: outliers, scatter, an unknown latitude."""
    out = []
    norms = mixed.norms(e.fit.at, e.fit.covariance)
    for k in e.fit.outliers.tolist():
        rate = plain(float(np.degrees(e.steps.rate[k])), 4)
        words = {"step": k + 1, "rate": rate, "placement": name_of(e.steps.up[k])}
        out.append(finding("rate_table.outlier", norm=f"{norms[k]:.0f}", **words))
    if e.scatter:
        out.append(finding("rate_table.scatter", ppm=_ppm(e.scatter)))
    if e.bias_sd:
        out.append(finding("rate_table.bias_moved", moved=moved(e)))
    if e.table.latitude is None:
        sd = np.degrees(EARTH_RATE / np.sqrt(3)) * 3600
        out.append(finding("rate_table.no_latitude", sd=f"{sd:.1f}"))
    return out


OF_A_STEP = ("gyro noise", "rate jitter", "rate scatter", "bias drift")
"""Sources that make one step differ from another."""


def step_table(e: Solution, start: FloatArray) -> dict[str, Any]:
    """Return the table "rate_steps".

    `start` (n,): when each step began [s].
    """
    s, n = e.steps, len(e.steps)
    rows, axis = np.arange(n), e.steps.axis
    gyro = s.gyro[rows, axis]
    w_b = e.model.compensate(s.force, s.gyro)[1]
    assert w_b is not None
    some = [source for source in e.fit.at.sources if source.name in OF_A_STEP]
    whole = Covariance(some, e.fit.sds, (n, 3), np.ones(n)).whole.reshape(n, 3, n, 3)
    back = np.linalg.inv(e.model.gyro_matrix)
    cov = back @ whole[rows, :, rows] @ back.T
    norms = e.fit.estimate.residuals[: 3 * n].reshape(n, 3)
    worst = np.take_along_axis(norms, np.abs(norms).argmax(axis=1)[:, None], 1)[:, 0]
    return {
        "start": start,
        "end": start + s.time,
        "placement": s.placement,
        "axis": np.array(AXES)[axis],
        "up": s.sense,
        "rate": s.rate,
        "rate_true": e.speed,
        "gyro": gyro,
        "turns": s.turns,
        "before": gyro - e.speed,
        "line": gyro - _lines(e)[0],
        "after": w_b[rows, axis] - e.speed,
        "after_sd": np.sqrt(cov[rows, axis, axis]),
        "residual": worst,
        "weight": e.fit.estimate.weights,
    }


def _lines(e: Solution) -> tuple[FloatArray, dict[str, dict[str, float]]]:
    """Fit a straight line to the steps about each axis; return it there, and what it says."""
    gyro = e.steps.gyro[np.arange(len(e.steps)), e.steps.axis]
    out, figures = np.full(len(e.steps), np.nan), {}
    for i, a in enumerate(AXES):
        mine = (e.steps.axis == i) & (e.fit.estimate.weights > 0.5)
        x, y = e.speed[mine], gyro[mine]
        senses = e.steps.rate[mine] * e.steps.sense[mine]
        if (senses >= 0).all() or (senses <= 0).all() or len(x) < 3:
            continue
        top = float(np.abs(x).max())
        straight = np.column_stack([x / top, np.ones_like(x)])
        slope, bias = np.linalg.lstsq(straight, y, rcond=None)[0]
        rows = e.steps.axis == i
        out[rows] = slope * e.speed[rows] / top + bias
        bent = np.linalg.lstsq(np.column_stack([straight, np.abs(x) / top]), y, rcond=None)[0]
        figures[a] = {
            "scale_factor": float(slope / top),
            # slope is the scale factor times the full scale: the quotient is of full scale.
            "nonlinearity": float(np.abs(y - straight @ [slope, bias]).max() / abs(slope)),
            "asymmetry": float(2 * bent[2] / bent[0]),
            "full_scale": top,
        }
    return out, figures


def standard_figures(e: Solution) -> dict[str, dict[str, float]]:
    """Return what IEEE Std 647 and 952 ask for, per axis, as plain values.

    ``scale_factor``: slope of the straight line through all steps [1]; ``nonlinearity``: largest
    deviation from it, as a fraction of full scale [1]; ``asymmetry``: difference of the slopes for
    positive and negative rates over their mean [1]; ``full_scale``: largest rate [rad/s].
    """
    return _lines(e)[1]


def drift_figures(e: Solution) -> dict[str, Any]:
    """Return how the bias moved, for result.json: ``sd`` [rad/s], ``time`` [s], ``kind``."""
    if not e.bias_sd:
        return {"sd": 0.0, "kind": "none"}
    if np.isinf(e.table.bias_time):
        return {"sd": e.bias_sd, "kind": "line"}
    kind = "Gauss-Markov" if e.table.bias_time else "steps"
    return {"sd": e.bias_sd, "kind": kind, "time": e.table.bias_time}
