"""What a planned session of a north seeker will show: simulated without noise, solved, judged.

The covariance of a calibration depends on headings, stops, noise and prior, hardly on what is
read, so that it is known before the session. Fewer than three headings calibrate nothing: then it
is a fix that is judged, by the heading.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf

import numpy as np
from pydantic import Field

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector, Layout, coefficients_of
from foucault.detect.dwells import find_dwells
from foucault.diagnose.foresight import Extra, Foresight
from foucault.diagnose.left_out import foretold
from foucault.diagnose.north import stops
from foucault.errors import Finding, error, finding
from foucault.estimate.north import Known, solve
from foucault.infer.information import information
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.left_out import Sizes
from foucault.models.noise import ImuNoise, TriadNoise, grade
from foucault.models.north_seeker import SEEKER, Compensation
from foucault.plans import north as bound
from foucault.plans.limit import Limit
from foucault.plans.north import NorthSpace, Rig, schedule
from foucault.plans.north_stops import Conditions
from foucault.plans.optimise import require_seen, weights_of
from foucault.procedures.left_out import declared, told_beside
from foucault.procedures.north_seeking.counted import DRIFT, completed
from foucault.procedures.north_seeking.fix import (
    Z_COUPLING,
    Solution,
    accelerometers_before,
    find_north,
    held,
    require_latitude,
    solved,
)
from foucault.procedures.north_seeking.settings import Ramp, Session, Settings, Stop, simulated
from foucault.procedures.record import Beforehand, Prior
from foucault.simulate.north import NorthPlan, NorthSimulation, Stops
from foucault.strict import Strict
from foucault.units import AngleSd, Seconds, span

Judge = Callable[[Session], CoefficientVector]

ANGLES = Layout(coefficients_of("north"))
"""What a fix finds."""

FEWEST = 3
"""Headings that a calibration needs at least [1]."""

HARDLY = 0.9
"""A coefficient is hardly seen if more than this share of the prior is left [1]."""

LONGER = 300.0
"""What five more minutes would buy is told [s]."""

TILTED = "10 deg"
"""What going through the headings tilted too would buy is told."""

ROUNDING = np.radians(5e-4)
"""An index angle may be so far off a detent: plans are written to 0.001 deg [rad]."""


@dataclass(frozen=True)
class _Planned:
    """A session as planned, and all that its solution depends on."""

    settings: Settings
    site: Site
    noise: ImuNoise
    prior: Prior
    sizes: Sizes | None = None  # of what is not estimated [SI]

    def made(self, session: Session) -> NorthSimulation:
        """Simulate with nothing drawn: a perfect instrument on a perfect table, no noise."""
        sure = {"heading_sd": 0.0, "heading_offset_sd": 0.0, "index_sd": 0.0, "drift_sd": None}
        still = {"offset_sd": 0.0, "twice_per_turn_sd": 0.0, "gyro_drift": 0.0}
        return simulated(
            session.model_copy(update=still), settings=self.settings.model_copy(update=sure),
            model=ImuModel(), noise=ImuNoise(), site=self.site, seed=0,
        )  # fmt: skip

    def calibrated(self, session: Session) -> Solution:
        """Return the solution of the calibration."""
        s = self.settings
        dwells = find_dwells(self.made(session).log, settle=s.settle, shortest=s.shortest)
        stops(dwells, Known(self.site.gravity))
        return solved(dwells, self.site, s, self.noise, True, self.prior, self.sizes)

    def fixed(self, session: Session) -> CoefficientVector:
        """Return heading, pitch and roll of the set-ups, root mean square."""
        survey = find_north(
            self.made(session).log, site=self.site, settings=self.settings, noise=self.noise,
            prior=self.prior,
        )  # fmt: skip
        return CoefficientVector(ANGLES, np.zeros(3), survey.fixes.cov[:, :3, :3].mean(axis=0))


def foresee(b: Beforehand[Settings, Session]) -> Foresight:
    """Return what a planned session will show."""
    settings, session, site, noise, prior = b.settings, b.session, b.site, b.noise, b.prior
    if site.latitude is None:
        raise error("north.calibration_latitude")
    require_latitude(site.latitude)
    told: list[Finding] = []
    if noise is None or not noise.gyro.white > 0:
        noise = grade("navigation").noise
        told.append(finding("preflight.gyro_noise", given="0.002 deg/sqrt(h) and 5 ug/sqrt(Hz)"))
    told += silent(session, noise)
    p = _Planned(settings, site, noise, prior, b.sizes)
    if session.headings * len(session.tilts) < FEWEST:
        return _of_a_fix(p, session, told)
    return _of_a_calibration(p, session, told)


def silent(session: Session, noise: ImuNoise) -> tuple[Finding, ...]:
    """Say so where accelerometers are read that are declared to have no noise.

    `noise`: noise as declared [SI].
    """
    read = session.accelerometers != "none"
    return (finding("preflight.accel_noise"),) if read and noise.accel == TriadNoise() else ()


def _of_a_fix(p: _Planned, session: Session, told: list[Finding]) -> Foresight:
    found = p.fixed(session)
    motion = session.motion(p.settings.index_limit)
    return Foresight(
        coefficients=found,
        linearised_at="a level case",
        plan=f"{session.called}, {len(motion.index)} stops in a set-up",
        duration=_duration(session, motion),
        states=len(found),
        rank=len(found),
        limits=_limits(motion, p.settings),
        more=_more(p, session, p.fixed, found),
        findings=tuple(told),
    )


def _of_a_calibration(p: _Planned, session: Session, told: list[Finding]) -> Foresight:
    s = p.calibrated(session)
    fit = s.fit
    found = fit.estimate.coefficients
    of_data = information(
        fit.problem.linearise(fit.state, np.ones(fit.problem.n_blocks)), found.layout
    )
    share = found.sd / found.prior_sd
    hardly = tuple(n for n, left in zip(found.names, share, strict=True) if left > HARDLY)
    coupled = ", ".join(n for n in hardly if n in Z_COUPLING)
    others = [n for n in hardly if n not in Z_COUPLING]
    told += [finding("preflight.level", names=coupled)] if coupled else []
    if others:
        told.append(finding("preflight.unseen", count=len(others), names=", ".join(others)))
    motion = session.motion(p.settings.index_limit)
    told.append(_in_the_field(p, s, motion))
    m = session.headings * len(session.tilts)
    unseen = tuple(c.words for c in of_data.weakest() if not np.isfinite(c.factor))
    shown = of_data.with_prior(found.prior_sd).shown()

    def judge(longer: Session) -> CoefficientVector:
        return p.calibrated(longer).fit.estimate.coefficients

    return Foresight(
        **shown | {"rank": of_data.rank, "unseen": unseen},
        coefficients=found,
        linearised_at="an instrument without errors",
        plan=f"{m} set-ups of the {session.called}, {len(motion.index)} stops each",
        duration=_duration(session, motion),
        hardly=hardly,
        limits=_limits(motion, p.settings),
        more=(*declared(fit, s.judged, fit.problem.prior, {}), *_more(p, session, judge, found)),
        left_out=None if s.judged is None else foretold(s.judged),
        findings=(*told, *s.findings),
    )


def _in_the_field(p: _Planned, s: Solution, motion: Stops) -> Finding:
    """Say what a fix of the same stops will give with this calibration."""
    found = s.fit.estimate.coefficients
    more = held(accelerometers_before(p.settings, p.prior))
    keep = [i for i, name in enumerate(more.names) if name not in found.names]
    assert found.cov is not None and more.cov is not None
    n = len(found)
    cov = np.zeros((n + len(keep),) * 2)
    cov[:n, :n], cov[n:, n:] = found.cov, more.cov[np.ix_(keep, keep)]
    layout = SEEKER.subset([*found.names, *(more.names[i] for i in keep)])
    both = Compensation(CoefficientVector(layout, np.append(found.values, more.values[keep]), cov))
    known = Known(p.site.gravity, p.site.latitude, p.settings.latitude_sd,
                  "south" if (p.site.latitude or 0.0) < 0 else "north",
                  level_sd=p.settings.level_sd)  # fmt: skip
    sd, perfect = (
        float(np.degrees(np.sqrt(np.mean(solve(s.pairs, known, c).cov[:, 0, 0]))))
        for c in (both, Compensation())
    )
    return finding("preflight.heading", time=span(motion.length), sd=f"{sd:.3g}",
                   perfect=f"{perfect:.3g}")  # fmt: skip


def _duration(session: Session, motion: Stops) -> float:
    """Return how long it all takes, with what it takes to set up anew [s]."""
    m = session.headings * len(session.tilts)
    return m * motion.length + (m - 1) * NorthPlan.pause


def _limits(motion: Stops, settings: Settings) -> tuple[Limit, ...]:
    """Return what the stops need of the base."""
    out = [Limit("index angle", "angle", float(np.abs(motion.index).max()), settings.index_limit)]
    if settings.index_step is not None:
        step = settings.index_step
        off = float(np.abs(motion.index - step * np.rint(motion.index / step)).max())
        off = off if off > ROUNDING else 0.0
        out.append(Limit("index angle off its detent", "angle", off, 0.0))
    return tuple(out)


def _more(
    p: _Planned, session: Session, judge: Judge, found: CoefficientVector
) -> tuple[Extra, ...]:
    """Return what a little more would buy."""
    motion = session.motion(p.settings.index_limit)
    whole = _duration(session, motion)
    out = []
    for what, longer in _longer(p, session, motion):
        other = judge(longer)
        both = [n for n in found.names if n in other.names]
        keep, same = ([v.names.index(n) for n in both] for v in (found, other))
        time = _duration(longer, longer.motion(p.settings.index_limit)) - whole
        ratio = np.asarray(other.sd[same] / found.sd[keep])
        out.append(Extra.of(what, time, tuple(both), ratio))
    return tuple(out)


def _longer(p: _Planned, session: Session, motion: Stops) -> list[tuple[str, Session]]:
    """Return longer sessions, and what is more in them."""
    m = session.headings * len(session.tilts)
    grown = motion.dwell * (1 + LONGER / (m * motion.dwell.sum()))
    again = (np.append(motion.index, motion.index[0]), np.append(motion.dwell, motion.dwell[0]))
    out = [
        ("five more minutes, spread over all stops", _with(session, motion.index, grown)),
        ("the first stop once more in every set-up", _with(session, *again)),
    ]
    if m >= FEWEST:
        one = session.model_copy(update={"headings": session.headings + 1})
        out.append(("one more heading, evenly spread", one))
    tilted = len(set(session.tilts)) > 1 or p.settings.z_coupling == "no"
    if m >= FEWEST and not tilted and session.accelerometers != "none":
        both = session.model_copy(update={"tilts": (*session.tilts, TILTED)})
        out.append((f"the same headings tilted by {TILTED}", both))
    return out


def _with(session: Session, index: FloatArray, dwell: FloatArray) -> Session:
    """Return the session with these stops."""
    order = tuple(Stop.model_construct(index=float(a), dwell=float(t))
                  for a, t in zip(index, dwell, strict=True))  # fmt: skip
    return session.model_copy(update={"order": order})


SOUGHT = Layout(coefficients_of("north_plan"))
"""What a plan is made for."""


class Wanted(Strict):
    """What may be changed of the stops of the base in a set-up, and what is wanted."""

    weights: dict[str, float] = Field(default={})
    """How much each counts; here there is "heading" alone."""
    time: Seconds | None = Field(default=None, gt=0, examples=["300 s"])
    """Time of a set-up, moves included; left out, that of the stops in [simulate]."""
    stops: int = Field(default=24, ge=2)
    """Most stops of a set-up."""
    opposite: bool = True
    """Every stop has its opposite, so that what repeats with the index angle cancels."""
    drift: Ramp | None = Field(default=None, ge=0, examples=["0.1 deg/h/h"])
    """Linear drift of the gyro to expect, whose effect counts where the solution does not estimate
    it; left out, gyro_drift of [simulate]."""
    rough_sd: AngleSd | None = Field(default=None, gt=0, examples=["2 deg"])
    """Sd of a rough heading that will be known: then index angles count from it, and the stops can
    look east and west."""


def _drift(b: Beforehand[Settings, Session], noise: ImuNoise) -> float:
    """Return the linear drift of the gyro that a plan has to reckon with [rad/s^2].

    `noise`: of the instrument [SI]. What nobody says of it is as large as what is not estimated.
    """
    length = _duration(b.session, b.session.motion(b.settings.index_limit))
    size, _ = (told_beside(b.sizes, noise, length) or {}).get(DRIFT, (0.0, ""))
    return abs(b.session.gyro_drift) or size / length


def space(b: Beforehand[Settings, Session]) -> NorthSpace:
    """Return the orders of stops among which the best is searched.

    They are those that the base can do; the stops of the session are those to beat. The noise of
    the instrument must be known.
    """
    session, site, noise, wanted = b.session, b.site, b.noise, b.wanted
    settings, _ = completed(b.settings, b.sizes)
    weights = weights_of(SOUGHT, wanted.weights)
    if noise is None or not noise.gyro.white > 0:
        raise error("north_search.noise")
    if site.latitude is None:
        raise error("north.fix_latitude")
    level = settings.level_sd if session.accelerometers == "none" else None
    if session.accelerometers == "none" and level is None:
        raise error("north.level_sd")
    if wanted.rough_sd is not None and settings.unknown_latitude:
        raise error("north_search.latitude")
    conditions = Conditions(
        site.latitude, noise, settings.latitude_sd, not settings.unknown_latitude,
        index_sd=settings.index_sd, level_sd=level,
        offset_sd=inf if settings.gyro_offset_sd is None else settings.gyro_offset_sd,
    )  # fmt: skip
    known = bound.Known(
        conditions, _drift(b, noise) if wanted.drift is None else wanted.drift,
        settings.drift, settings.drift_sd,
        session.accelerometers == "case", wanted.rough_sd,
    )  # fmt: skip
    motion = session.motion(settings.index_limit)
    rig = Rig(
        total=motion.length if wanted.time is None else wanted.time,
        move=session.move,
        shortest=settings.shortest,
        settle=settings.settle if session.rows == "samples" else 0.0,
        most=wanted.stops,
        index_limit=inf if settings.index_limit is None else settings.index_limit,
        index_step=settings.index_step,
        opposite=wanted.opposite,
    )
    found = NorthSpace.of(rig, known, schedule(motion.index, motion.dwell, rig),
                          session.called, silent(session, noise))  # fmt: skip
    require_seen(SOUGHT.names, weights, np.array([not found.shows()]), found.limits)
    return found
