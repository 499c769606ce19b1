"""A procedure as data: what differs between two of them, and what all do alike.

::

    log -> Procedure.calibrate -> solve -> Result       (all of it, for a report)
           Procedure.trial     -> solve -> Result       (one of many: without what a report shows)
    session -> Procedure.simulate -> simulation -> log
    plan -> Procedure.foreseen, Procedure.space         (preflight, optimise)

A module of `foucault.procedures.PROCEDURES` has its record as ``PROCEDURE``. The defaults of a
field are the usual case, so that a procedure states only what is its own.

Settings that several procedures have: each with one meaning and one description.

A field that only is there is an annotated type, to which a table of a campaign gives its default.
What is done with a field is a method of the class that has it.
"""

from __future__ import annotations

import pickle
import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, Generic, Literal, TypeVar

import numpy as np
from pydantic import AfterValidator, BaseModel, Field, ValidationInfo

from foucault import logs
from foucault.coefficients import CoefficientVector, Layout
from foucault.coefficients import Prior as Prior
from foucault.diagnose import left_out
from foucault.diagnose.fit_checks import against_the_plan, budget_json, chi_square_json
from foucault.diagnose.foresight import Extra, Foresight
from foucault.diagnose.references import with_clock
from foucault.errors import Finding, FoucaultError, error, finding
from foucault.infer import mixed
from foucault.infer.information import BLURRED, bound, information
from foucault.infer.left_out import Judgement
from foucault.logs.description import LogDescription
from foucault.logs.layout import FileLayout
from foucault.models import imu
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT, LINEAR_LOWER
from foucault.models.layouts import gravity_error, model_of, rate_slope, with_references
from foucault.models.left_out import GRAVITY, Sizes
from foucault.models.noise import ImuNoise, grade
from foucault.plans.optimise import StatedSpace, require_seen, weights_of
from foucault.procedures import Progress, load, silent, solvable
from foucault.procedures import left_out as beside
from foucault.procedures.chosen import Chosen, decided
from foucault.procedures.left_out import Again
from foucault.result import Check, Result, TableData, Verdict, provenance
from foucault.strict import Strict
from foucault.units import AngleSd, Quantity, RatioSd, Seconds

if TYPE_CHECKING:
    from foucault.arrays import FloatArray
    from foucault.procedures.stages import Stage


S = TypeVar("S", bound=BaseModel)
N = TypeVar("N", bound=BaseModel)


@dataclass(frozen=True)
class Given(Generic[S]):
    """What a calibration is given beside its log."""

    site: Site  # without latitude where the Earth's rotation is not to be modelled
    settings: S
    noise: ImuNoise | None  # of the instrument, None where it is not declared [SI]
    prior: Prior  # what is known beforehand [SI]
    progress: Progress = silent
    sizes: Sizes | None = None  # of what is not estimated, None: it is taken for nothing [SI]
    shown: bool = True  # whether a report will show it: a trial is one of many


def result_of(
    procedure: str,
    fit: mixed.Fit,
    checks: tuple[Check, ...],
    *,
    site: Site,
    findings: tuple[Finding, ...],
    tables: Mapping[str, TableData],
    diagnostics: Mapping[str, Any],
    validity: Mapping[str, Any] = MappingProxyType({}),
    described: tuple[str, str, str] = (imu.EQUATION, imu.FRAME, imu.Gauge.LOWER.value),
    table_rate_sd: float | None = 0.0,
    gain: FloatArray | None = None,
    bounded: bool = True,
    judged: Judgement | None = None,
) -> Result:
    """Make the result of a mixed model: its estimate with budget and bound, judged and described.

    `diagnostics`: what the procedure says beside that; it goes before what is said here;
    `described`: equation, frame and gauge; `table_rate_sd`: relative sd of an error that all spin
    rates share [1], None where neither that nor local gravity is in the coefficients; `gain`
    (p, n d) or None: of another estimate from the same readings than the fit's [SI]; `bounded`:
    False where nothing is known of the noise; `judged` or None: what was made of the terms that
    are not estimated.
    """
    found = fit.estimate.coefficients
    shared: dict[str, tuple[FloatArray, str, str]] = {}
    if bounded and checks:
        checks = (*checks, *against_the_plan(fit))
    if judged is not None:
        jumped = any(c.name == "jump" and not c.passed for c in checks)
        checks = (*checks, *left_out.checks(judged, jumped))
        tables = {**tables, "left_out": left_out.table(judged)}
        diagnostics = {**diagnostics, **left_out.judgement_json(judged)}
    if table_rate_sd is not None:
        fitted = judged is not None and GRAVITY in judged.groups
        beside = replace(site, gravity_sd=0.0) if fitted else site
        gravity, rate = gravity_error(found, beside), rate_slope(found) * table_rate_sd
        shared = {
            "local gravity": (gravity**2, "B", "standard uncertainty of local gravity"),
            "rate of the table": (
                rate**2, "B", "table_rate_sd as given; tilt of the outer axis",
            ),
        }  # fmt: skip
        found = with_references(found, beside, table_rate_sd)
    dof = mixed.degrees(found.sd**2, mixed.enlarged(fit, gain))
    said = {
        "iterations": fit.estimate.iterations,
        "chi_square": chi_square_json(fit.after),
        "chi_square_of_noise_alone": chi_square_json(fit.before),
        **budget_json(fit, shared, gain),
        **({"dof": [v if v < np.inf else None for v in dof]} if (dof < np.inf).any() else {}),
        **(bound(mixed.noise_alone(fit), fit.state) if bounded else {}),
    }
    equation, frame, gauge = described
    return Result(
        procedure, found, equation, frame, gauge, Verdict.of(checks), checks, findings,
        fit.estimate.status, site=site.as_dict(), validity=dict(validity),
        diagnostics=said | dict(diagnostics), tables=dict(tables),
    )  # fmt: skip


@dataclass(frozen=True)
class Beforehand(Generic[S, N]):
    """What a planned session is judged by."""

    settings: S  # its plan is among them, or in the session
    session: N
    site: Site
    noise: ImuNoise | None = None  # as declared [SI]
    prior: Prior = field(default_factory=dict)  # what is known beforehand [SI]
    typical: ImuNoise | None = None  # to reckon with where none is declared [SI]
    sizes: Sizes | None = None  # of what is not estimated [SI]
    seed: int = 0  # of what is drawn of the session [1]
    wanted: Any = None  # [optimise], where the procedure has it


@dataclass(frozen=True)
class Planned:
    """A session that was only planned: the model that it states, solved."""

    model: mixed.Model
    fit: mixed.Fit  # with what is not estimated among its sources
    true: Mapping[str, float]  # source -> its true size, of those that the readings tell [SI]
    prior: CoefficientVector  # [SI]
    log: Any  # simulated
    found: Result  # what a calibration would state
    judged: Judgement | None
    bought: tuple[Extra, ...]


@dataclass
class Stated(Generic[S, N]):
    """What a calibration would state of plans in some circumstances, each asked for once."""

    known: Beforehand[S, N]  # all but the plan
    # known, plan and circumstances -> sd of every coefficient (p,) [SI]
    sd: Callable[[Beforehand[S, N], Any, str], FloatArray]
    # (p,) what was stated before [SI]
    _kept: dict[tuple[str, bytes], FloatArray] = field(default_factory=dict, repr=False)

    def __call__(self, plan: Any, case: str) -> FloatArray:
        """Return the sd of every coefficient, shape (p,) [SI]."""
        key = case, pickle.dumps(plan)
        if key not in self._kept:
            self._kept[key] = self.sd(self.known, plan, case)
        return self._kept[key]


DRAWN = 3  # Other draws of a motion by hand that a preflight looks at [1].


def _held(_description: Any) -> bool:
    """Return False: every log is held as a whole."""
    return False


def _on_axes(log: Any) -> tuple[bool, bool]:
    """Take angles over the time of the log for the reference of the gyros."""
    return True, log.sampled == "increment"


def _nothing(_: Any) -> Sizes:
    """Return no size: nothing counts where none is declared."""
    return {}


def _steady(session: N, _settings: Any, _noise: ImuNoise) -> N:
    """Leave a session as it is: nothing is counted beyond the noise."""
    return session


def _of_an_imu(grade: str, seed: int) -> Any:
    """Draw the errors of an IMU; `seed`: seed [1]."""
    from foucault.simulate.hand_rotated import draw_errors

    return draw_errors(grade, seed)


@dataclass(frozen=True)
class Procedure(Generic[S, N]):
    """A method of calibration: its settings, its functions, and how its files are written."""

    name: str  # in a campaign file
    doc: str  # of its module
    Settings: type[S]  # [procedure]
    Session: type[N]  # [simulate], beside what all have there
    # Log and what is given -> the result, without what `calibrate` puts to all of them.
    solve: Callable[[Any, Given[S]], Result]
    simulation: Callable[..., Any]  # of a session; arguments as `simulate`, settings never None
    names: Callable[[S, N], tuple[str, ...]]  # coefficients that are estimated
    # Those of the result, where others follow from those that are estimated.
    every_name: Callable[[S], tuple[str, ...]] | None = None
    layout: Layout = imu.LAYOUT  # what a campaign may name in [prior]

    # Log and what is given -> the model that it states; None: it has no likelihood.
    observe: Callable[[Any, Given[S]], mixed.Model | None] | None = None
    # Model, log and what is given -> the session reduced again; None: it does not count what it
    # does not estimate.
    again: Callable[[Any, Any, Given[S]], Again] | None = None
    counts: bool = False  # whether it counts them though it has no such `again`
    # whether it does so too where none is declared, at the sizes of the grade that the noise tells
    counts_by_noise: bool = False
    # Settings and session -> what a little more of a plan would be: in words, and both changed.
    additions: Callable[[S, N], Sequence[tuple[str, S, N]]] | None = None
    # What is wrong with a session that its calibration has to find: source -> size [SI].
    sizes: Callable[[N, S], Mapping[str, float]] | None = None
    # A model whose readings do not show all -> the motion they lack, in words.
    lacking: Callable[[Any], Sequence[str]] | None = None
    # Relative sd of an error that all rates share and no source is; None: neither that nor local
    # gravity is in the coefficients [1].
    table_rate_sd: float | None = 0.0

    # Settings, session and site -> what is done, of a kind that `stages` knows.
    plan: Callable[[S, N, Site], Any] | None = None
    # The plan of a session: what it will show, where not as `observe` has it, and the plans that
    # may be sought.
    foresee: Callable[[Beforehand[S, N]], Foresight] | None = None
    space: Callable[[Beforehand[S, N]], Any] | None = None
    Wanted: type[BaseModel] | None = None  # [optimise], where there is a `space`
    evaluations: int | None = None  # plans that a restart judges, where not the usual number [1]
    assumes_noise: bool = False  # a plan is judged with the typical noise where none is declared

    # The instrument of a simulated session.
    grade: str = "mems"  # its class, where [simulate] names none
    noise: ImuNoise | None = None  # its noise, where not that of the class [SI]
    draw_errors: Callable[[str, int], Any] = _of_an_imu  # of a class and a seed
    by_hand: bool = False  # whether a session only roughly moves as it was planned: it is drawn
    # Session, settings, instrument and generator -> the three with what is not estimated beside
    # terms of the instrument, drawn at its size: lever arms, delays, clocks.
    drawn: Callable[[N, S, Any, np.random.Generator], tuple[N, S, Any]] | None = None
    # Settings -> sizes of what it counts although none is declared [SI].
    always: Callable[[S], Sizes] = _nothing
    # Session, settings and the noise of a class -> the session with the scatter that it counts
    # where no noise is declared.
    scattered: Callable[[N, S, ImuNoise], N] = _steady
    # Groups of terms that it estimates by other names, or draws by itself.
    otherwise: tuple[str, ...] = ()

    # The log.
    Description: type[FileLayout] = LogDescription  # [log]
    read: Callable[..., Any] = logs.read
    write: Callable[..., None] = logs.write
    Master: type[BaseModel] | None = None  # [master]
    with_master: Callable[..., Any] | None = None  # log, description and folder -> log with it
    # description -> whether it takes a log of that kind on disk too
    streams: Callable[[Any], bool] = _held
    by_rests: bool = False  # whether it goes by rests that can be said
    # What further files of a log are: none, stretches of one session (nothing is needed of what
    # is between them), or recordings of their own, each with biases of its own.
    more: Literal["none", "stretches", "recordings"] = "none"
    # Log -> whether angles over its time are the reference of the gyros, and whether it is sums.
    clocked: Callable[[Any], tuple[bool, bool]] = _on_axes

    # Texts of the template of a campaign; empty: those of an IMU.
    log_table: Callable[[Any], str] | None = None  # [log], of the template or of a simulated log
    log_lines: str = ""  # what is put to the [log] of an IMU
    noise_lines: str = ""
    prior_lines: str = ""
    errors_line: str = ""

    @property
    def counted(self) -> bool:
        """Whether it counts what it does not estimate, where sizes are given."""
        return self.counts or self.again is not None

    @property
    def summary(self) -> str:
        """What it does, in a sentence."""
        return self.doc.strip().splitlines()[0].rstrip(".")

    def stages(self, settings: S, session: N, site: Site) -> tuple[Stage, ...]:
        """Return what an operator does in a session."""
        from foucault.procedures.stages import stages  # which most runs do not need

        assert self.plan is not None
        return stages(self.plan(settings, session, site))

    def calibrate(
        self,
        log: Any,
        *,
        site: Site,
        settings: S | None = None,
        noise: ImuNoise | None = None,
        prior: Prior | None = None,
        sizes: Sizes | None = None,
        instrument: Mapping[str, Any] | None = None,
        progress: Progress = silent,
    ) -> Result:
        """Calibrate an instrument from a log; raises what is missing in it or wrong with it.

        `log`: readings, or means over poses where the procedure takes them [SI]; `site`: local
        gravity, and the latitude where the Earth's rotation is to be modelled; `settings` or None:
        what can be chosen, else the defaults; `noise` or None: of the instrument, else measured
        where the log shows it, and usual where it does not [SI]; `prior` or None: mean and sd of
        coefficients or groups of them [SI]; `sizes` or None: of every group of terms that is not
        estimated, and what each rests on, as `models.left_out.sizes_of` returns them, else they
        are taken for nothing [SI]; `instrument` or None: name, serial and so on, to be kept.
        """
        started = clock.monotonic()
        said = getattr(log, "description", log)  # of a log that stays on the disk
        if getattr(said, "rests", None) is not None and not self.by_rests:
            raise error("log.rests_unused", procedure=self.name)
        given = self._given(site, settings, noise, prior, progress, sizes)
        with solvable():
            result = decided(lambda g: self.solve(log, g), given)[0]
        progress(1.0, "done")
        if sizes and "left_out" not in result.tables:
            told = finding("left_out.not_counted", procedure=self.name)
            result = replace(result, findings=(*result.findings, told))
        result = replace(
            result,
            instrument=dict(instrument or {}),
            provenance=provenance(log.source, clock.monotonic() - started),
        )
        turned, summed = self.clocked(log)
        return with_clock(result, log.clock, turned=turned, summed=summed)

    def trial(
        self,
        log: Any,
        *,
        site: Site,
        settings: S | None = None,
        noise: ImuNoise | None = None,
        prior: Prior | None = None,
        sizes: Sizes | None = None,
    ) -> Result:
        """Calibrate without what only a report shows: one trial of many.

        Arguments as of `calibrate`; `noise`: of the instrument [SI]; `sizes`: of what is not
        estimated [SI].
        """
        with solvable():
            given = self._given(site, settings, noise, prior, silent, sizes)
            given = replace(given, shown=False)
            return decided(lambda g: self.solve(log, g), given)[0]

    def _given(
        self,
        site: Site,
        settings: S | None,
        noise: ImuNoise | None,
        prior: Prior | None,
        progress: Progress,
        sizes: Sizes | None = None,
    ) -> Given[S]:
        settings = settings or self.Settings()
        if isinstance(settings, EarthRate):
            site = settings.where(site)
        if self.again is None and not self.counts_by_noise:
            sizes = sizes or None  # none declared, and no grade is told by noise here
        return Given(site, settings, noise, prior or {}, progress, sizes)

    def foreseen(self, b: Beforehand[S, N], *, more: bool = True) -> Foresight | None:
        """Return what a planned session will show, None where nobody can say without calibrating.

        The session is simulated, with its noise, which decides how much of the rests is found
        quiet; the model that it states says the rest, hardly by what was read. `more`: whether to
        say what more of a plan would buy.
        """
        return decided(lambda b: self._foreseen(b, more=more), b)[0]

    def _foreseen(self, b: Beforehand[S, N], *, more: bool) -> Foresight | None:
        if self.foresee is not None:
            own = self.foresee(b)
            if b.sizes and own.left_out is None:
                told_of = finding("left_out.not_counted", procedure=self.name)
                own = replace(own, findings=(*own.findings, told_of))
            return own
        with solvable():
            planned = self.planned(b, more=more)
        if planned is None:
            return None
        model, fit, judged, log = planned.model, planned.fit, planned.judged, planned.log
        prior, found, bought = planned.prior, planned.found, planned.bought
        at = fit.problem.linearise(fit.state, fit.estimate.weights)
        info = information(at, model.layout).with_prior(prior.prior_sd)
        lost = {n for c in info.weakest(len(prior), BLURRED) for n in c.shares}
        blind = [k for k, n in enumerate(prior.names) if n in lost or np.isinf(info.sd[k])]
        cov = np.array(found.coefficients.cov)
        cov[blind, :] = cov[:, blind] = 0.0
        cov[blind, blind] = np.inf
        reason = "".join(f"; {lack}" for lack in (self.lacking(model) if self.lacking else ()))
        names = tuple(n for n in prior.names if n in lost)
        told = [finding("preflight.not_shown", names=", ".join(names), reason=reason)]
        told = told * bool(lost)
        if b.sizes and judged is None:
            told.append(finding("left_out.not_counted", procedure=self.name))
        if self.by_hand and more and not blind:
            told += self._other_draws(b, found.coefficients)
        length = float(log.time[-1] - log.time[0])
        if judged is not None and more and not blind:
            bought = (*bought, *self._added(b, found.coefficients, length))
        return Foresight(
            **info.shown(),
            coefficients=replace(found.coefficients, cov=cov),
            linearised_at=("means in [prior], " if b.prior else "") + "no errors",
            plan="that of [simulate]",
            duration=length,
            bound=np.array(found.diagnostics["bound"]),
            budget={k: np.array(v) for k, v in found.diagnostics["budget"].items()},
            hardly=names,
            left_out=None if judged is None else left_out.foretold(judged),
            more=tuple(one for one in bought if one.gains),
            findings=tuple(told),
        )

    def _other_draws(self, b: Beforehand[S, N], found: CoefficientVector) -> list[Finding]:
        """Say what a session gives whose motion is another draw of the same plan."""
        ratios = []
        for k in range(1, DRAWN + 1):
            with solvable():
                other = self.planned(replace(b, seed=b.seed + k))
            if other is not None and other.found.coefficients.names == found.names:
                ratios.append(other.found.coefficients.sd / found.sd)
        if not ratios or not np.isfinite(ratios).all():
            return []
        low, high = np.min(ratios, axis=0), np.max(ratios, axis=0)
        worst = int(np.argmax(np.maximum(high, 1 / low)))
        return [finding("preflight.by_hand", count=len(ratios), low=f"{low.min():.2g}",
                        high=f"{high.max():.2g}", name=found.names[worst])]  # fmt: skip

    def planned(
        self, b: Beforehand[S, N], *, more: bool = False, measured: bool = False
    ) -> Planned | None:
        """Return the model that a planned session states, solved; None where it states none.

        `more`: whether to say what it would buy to know a size better; `measured`: whether a noise
        that is not declared is measured in the session, and not known.
        """
        if self.observe is None:
            return None
        noise = b.noise or b.typical or self.noise or grade(self.grade).noise
        told = b.noise if measured else noise
        given = self._given(b.site, b.settings, told, b.prior, silent)
        usual = model_of(CoefficientVector.prior(self.layout, b.prior))
        log = self.simulate(
            b.session, settings=b.settings, model=usual, noise=noise, site=b.site, seed=b.seed
        ).log
        model = self.observe(log, given)
        if model is None:
            return None
        prior = CoefficientVector.prior(model.layout, b.prior)
        sizes = self.sizes(b.session, b.settings) if self.sizes else {}
        judged, bought = None, tuple[Extra, ...]()
        if self.again is None:
            fit = mixed.planned(model, sizes, prior)
        else:
            again = self.again(model, log, given)
            fit, judged = beside.planned(model, prior, b.sizes, given.site, again, sizes)
            bought = beside.declared(fit, judged, prior, sizes) if more else ()
        found = result_of(
            self.name, fit, (), site=given.site, findings=(), tables={}, diagnostics={},
            table_rate_sd=self.table_rate_sd, judged=judged,
        )  # fmt: skip
        return Planned(model, fit, sizes, prior, log, found, judged, bought)

    def _added(
        self, b: Beforehand[S, N], found: CoefficientVector, length: float
    ) -> tuple[Extra, ...]:
        """Foretell more of a plan, and settings that estimate more; `length`: of the plan [s]."""
        tried = list(self.additions(b.settings, b.session)) if self.additions else []
        for key in getattr(b.settings, "optional", ()):
            tried.append((f"{key} = true", b.settings.model_copy(update={key: True}), b.session))
        out = []
        for words, settings, session in tried:
            try:
                other = self.foreseen(replace(b, settings=settings, session=session), more=False)
            except FoucaultError:  # what this plan does not show
                continue
            assert other is not None
            names = [n for n in found.names if n in other.names]
            sd = [v.chosen(names).sd for v in (other.coefficients, found)]
            if np.isfinite(sd).all():
                longer = other.duration - length
                out.append(Extra.of(words, longer, tuple(names), sd[0] / sd[1]))
        return tuple(out)

    def simulate(
        self,
        session: N,
        *,
        model: Any,
        noise: ImuNoise,
        site: Site,
        seed: int,
        settings: S | None = None,
    ) -> Any:
        """Simulate a session.

        `session`: what is done; `model`: errors of the instrument; `seed`: seed of all random
        numbers [1]; `settings` or None: of the calibration to follow, for its plan, and for what is
        wrong with table and reference. Returns its log and what is true.
        """
        return self.simulation(
            session,
            settings=settings or self.Settings(),
            model=model,
            noise=noise,
            site=site,
            seed=seed,
        )


# -- plans that are judged by what a calibration would state of them ------------------------------

HERE = "the session in [simulate]"

P = TypeVar("P", bound=StatedSpace)
Does = Callable[[Beforehand[Any, Any], Any], dict[str, Any]]
"""What is known and a plan -> settings and session that do the plan."""


class Wanted(Strict):
    """What is wanted; procedures say what may be changed."""

    weights: dict[str, float] = Field(default={})
    """How much each coefficient or group counts; 1 where nothing is said, 0 to leave it out."""


def ends(b: Beforehand[Any, Any], speed: FloatArray) -> tuple[float, float]:
    """Return the slowest and the fastest rate that is wanted, else of `speed` (k,) [deg/s]."""
    told = ((b.wanted.slowest, speed.min()), (b.wanted.fastest, speed.max()))
    slow, fast = (float(found if said is None else np.degrees(said)) for said, found in told)
    return slow, fast


def _sd(name: str, does: Does, known: Beforehand[Any, Any], plan: Any, _: str) -> FloatArray:
    """Return the sd of every coefficient that a calibration would state, shape (p,) [SI]."""
    found = load(name).foreseen(replace(known, **does(known, plan)), more=False)
    assert found is not None
    return found.sd


def space_of(
    Space: type[P], name: str, b: Beforehand[Any, Any], does: Does, allowed: Any, reference: Any,
    widest: Any = None,
) -> tuple[P, tuple[str, ...]]:  # fmt: skip
    """Return the plans among which the best are sought, and what no allowed plan shows.

    `widest`: plan that shows all that any does, None: `reference`, the plan to beat.
    """
    names = load(name).names(b.settings, b.session)
    layout, stated = LAYOUT.subset(names), Stated(b, partial(_sd, name, does))
    weights = weights_of(layout, b.wanted.weights)
    sd = stated(reference if widest is None else widest, HERE)
    blind = require_seen(names, weights, ~np.isfinite(sd), allowed.words)
    return Space(
        allowed=allowed, names=names, kinds=tuple(c.kind for c in layout.coefficients),
        weights=weights, reference=reference, reference_name=HERE, cases=(HERE,), stated=stated,
    ), blind  # fmt: skip


# -- of a calibration --------------------------------------------------------------------------

Quadratic = Annotated[bool, Field(description="Estimate the accelerometers' quadratic terms too.")]
Repeatability = Annotated[
    bool,
    Field(description="Estimate the scatter between readings that the noise does not explain."),
]
Window = Annotated[Seconds, Field(gt=0, description="Window of the rest detector.")]
Shortest = Annotated[Seconds, Field(gt=0, description="Shortest rest.")]
Threshold = Annotated[
    float | None,
    Field(
        gt=1,
        examples=[3.0],
        description="Level (1 = quiet) below which the instrument rests; default: from the data.",
    ),
]
RateSd = Annotated[
    RatioSd, Field(ge=0, description="Relative sd of the rate from one spin or step to the next.")
]
TableRateSd = Annotated[
    RatioSd, Field(ge=0, description="Relative sd of an error that all rates of the table share.")
]

# -- of a table ----------------------------------------------------------------------------------

PlumbSd = Annotated[
    AngleSd, Field(ge=0, description="Sd of the tilt of the outer axis, about each of two axes.")
]
OrthogonalitySd = Annotated[
    AngleSd, Field(ge=0, description="Sd of the angles between the table's axes.")
]
ZeroSd = Annotated[
    AngleSd, Field(ge=0, description="Sd of the zero errors of middle and inner angle.")
]
PositionSd = Annotated[
    AngleSd,
    Field(ge=0, description="Sd of the middle and inner angle from one position to the next."),
]

# -- of a simulated session ----------------------------------------------------------------------

RestTime = Annotated[Seconds, Field(gt=0, description="Length of each rest.")]
SampleRate = Annotated[float, Field(gt=0, description="Sample rate."), Quantity("frequency")]
Sampling = Annotated[
    Literal["rate", "increment"],
    Field(description="Instantaneous rates, or means over each interval."),
]
Rows = Annotated[
    Literal["samples", "means"],
    Field(description="A row per sample, or one mean per position, step or stop."),
]


class Stretch(Strict):
    """Which part of a log is used."""

    start: Seconds | None = None
    """Use the log from here on, such as "600 s"; times count from its start."""
    end: Seconds | None = Field(default=None, gt=0)
    """Use the log up to here, such as "90 min"."""
    gaps: Literal["stop", "bridge"] = "stop"
    """What to do where samples are missing."""


class EarthRate(Strict):
    """Whether the Earth's rotation is modelled."""

    earth_rate: bool = True
    """Model the Earth's rotation where the latitude is given."""

    def where(self, site: Site) -> Site:
        """Return the site as it is modelled: without latitude where the Earth is not to turn."""
        return site if self.earth_rate else replace(site, latitude=None)


class Terms(Chosen):
    """Which terms of the model of an IMU are estimated beside the linear ones."""

    accel_quadratic: Quadratic = False
    g_sensitivity: bool = False
    """Estimate the gyros' g-sensitivity too (9 more)."""

    def estimated(self, *, gyro: bool = True, turns: bool = True) -> tuple[str, ...]:
        """Return the names of all coefficients that are estimated.

        `gyro`: whether there are gyros; `turns`: whether they are turned, which shows their scale
        factors and misalignments.
        """
        families = ("accel.",) + (("gyro." if turns else "gyro.bias.",) if gyro else ())
        names = [n for n in LINEAR_LOWER if n.startswith(families)]
        more = ("accel.quadratic.",) * self.accel_quadratic
        more += ("gyro.g_sensitivity.",) * (self.g_sensitivity and gyro)
        return tuple(n for n in LAYOUT.names if n in names or n.startswith(more))


class Robust(Strict):
    """What is done with readings that contradict the others."""

    loss: Literal["robust", "squares"] = "robust"
    """robust: a reading that contradicts the others, beyond 3 sd, counts little or nothing;
    squares: all count in full."""

    @property
    def robust(self) -> bool:
        """Whether such readings are left out or weighted down."""
        return self.loss == "robust"


def checked(check: Callable[[Any], object]) -> AfterValidator:
    """Return the mark of a field that stays as it is given, where `check` does not refuse it.

    Where a file is read the error names the key.
    """

    def after(given: Any, info: ValidationInfo) -> Any:
        try:
            if given is not None:
                check(given)
        except FoucaultError as problem:
            if "locate" in (info.context or ()):
                raise ValueError(problem) from None
            raise
        return given

    return AfterValidator(after)
