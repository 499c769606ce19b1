"""From a slave's log, its master's table and what was said of both to a solution.

Passes of the Kalman filter, the H-infinity filter where one is chosen, the hand-over.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import BoolArray, FloatArray, IntArray
from foucault.coefficients import CoefficientVector, Prior
from foucault.diagnose import transfer_motion as delay_checks
from foucault.diagnose.transfer import EACH, Evidence, whiteness
from foucault.diagnose.transfer_motion import ALIKE, BENDS
from foucault.errors import Finding, Status, error, finding
from foucault.estimate.delay import Delay, delay_of
from foucault.estimate.transfer import (
    DelayFit,
    HandOver,
    Linearisation,
    Slave,
    TransferFit,
    TransferModel,
    after_outage,
    hand_over,
    likeliest_delay,
    likeliest_flexure,
)
from foucault.guard.master import forces, turning
from foucault.infer import filtered
from foucault.infer.filtered import components
from foucault.infer.left_out import Judgement
from foucault.infer.left_out_states import Group
from foucault.infer.linear_filter import (
    LinearSmoothed,
    Shock,
    by_prior,
    h_infinity,
    kalman,
    least_gamma,
    shocks,
    smoothed,
)
from foucault.models.earth import Site, displaced, earth_rate_n, transport_rate
from foucault.models.left_out import Sizes
from foucault.models.noise import ImuNoise
from foucault.models.rotation import exp
from foucault.models.transfer import LIVELY, WANDER, MasterTable, Messages, states_of_transfer
from foucault.navigate.increments import Increments
from foucault.navigate.strapdown import State
from foucault.procedures.transfer_alignment.counted import LEVER, Counted, judged
from foucault.procedures.transfer_alignment.settings import (
    BEYOND,
    LEFT_OUT,
    NOISE,
    Settings,
    SlaveLog,
    common,
    even,
    placed,
    stamp,
)
from foucault.units import convert, plain

MINOR = {"transfer.noise", "strapdown.bridged", "delay.wild", "delay.wanders"}
"""What leaves forces to be compared with accelerations all the same."""

DRIFTS = 5.0  # A drift of the clocks of so many standard deviations is taken out [1].
DRIFTED = 1e-4  # If it makes so much over the log [s].
DIFFERS = 1e-3  # A delay that was given is told to be wrong if it is by so much [s].

WIDER = 5.0
"""The start attitude is that of the master with the nominal mounting: its error is that of the
mounting. The filter takes the two as independent; so many times as uncertain as it is, the start
tells nothing of the mounting that the first messages do not [1]."""

PLACE_SD = 1.0  # How well the position at the start is known; it hardly matters [m].


@dataclass(frozen=True)
class TransferProblem:
    """What is solved."""

    # slave and master, by the slave's clock as far as that is known, mount, and what was known
    # beforehand: one copy of the master's state at the start
    model: TransferModel
    table: MasterTable  # what the master said, with positions
    settings: Settings
    site: Site  # where it begins, for gravity
    # what was known of the coefficients and of what is found besides [SI]
    prior: CoefficientVector
    hand_over: float  # when the slave goes on alone [s]
    # what rate matching has found, where the delay starts from it or is checked by it
    delay: Delay | None
    findings: tuple[Finding, ...]
    counted: Counted  # the states that are not in the result
    groups: Mapping[str, Group]  # what of them, and of what was known, is judged

    def with_delay(self, delay: float) -> TransferProblem:
        """Return the problem with another delay known beforehand.

        `delay`: the delay [s].
        """
        slave, master = self.model.slave, self.model.master
        first, state = _start(slave.increments, self.table, master, delay, self.settings)
        start = replace(self.model.start, delay=delay, state=state)
        model = replace(self.model, slave=replace(slave, first=first), start=start)
        return replace(self, model=model)

    def with_settings(self, settings: Settings) -> TransferProblem:
        """Return the problem with another mount, or other messages to be matched."""
        mount = replace(settings.mount, load=self.counted.mount.load)
        counted = replace(self.counted, mount=mount)
        sd = _sd(settings, self.prior, self.model.slave.noise, counted)
        model = replace(self.model, mount=mount, matching=settings.matched, sd=sd)
        return replace(self, model=model, settings=settings, counted=counted)


def problem_of(
    log: SlaveLog,
    site: Site,
    settings: Settings,
    noise: ImuNoise | None,
    given: Prior,
    *,
    sizes: Sizes | None = None,
    match: bool = True,
) -> TransferProblem:
    """Bring both to one clock, find the delay to start from, and the state at the start.

    `site`: where it begins, see `input.there`; `noise`: noise of the slave [SI], None takes that of
    a tactical instrument; `match`: whether what both turned is compared, a simulated session
    without errors need not be.
    """
    hand_over, table, increments = common(log, even(placed(log.messages, site)), settings)
    said, told = table.messages, [*([] if noise else [assumed_noise()]), *increments.findings]
    attitudes = match and (settings.matching != "velocity" or settings.estimates_delay)
    matched = _matched(increments, table, said, settings) if attitudes else None
    if matched is not None and matched.wild.any():
        table = table[~_wild(matched)]
        said = table.messages
    bracket = (-BEYOND, settings.longest_delay + BEYOND)
    told += turning(increments, said, matched, settings.C_ms, bracket) if attitudes else []
    if match and settings.matching != "attitude" and {f.code for f in told} <= MINOR:
        told += forces(increments, said, matched, settings.C_ms)
    drifting: list[Finding] = []
    if matched is not None and matched.seen:
        told += delay_checks.of_wandering(matched)
        if "delay.wanders" not in {f.code for f in told}:
            said, drifting = _one_clock(said, matched)
    start = settings.known_delay
    if settings.estimates_delay:
        start = settings.longest_delay / 2
        if settings.delay_method == "rate matching":
            if matched is None:
                raise error("transfer.no_delay")
            if matched.seen:
                later = float(np.mean(said.time)) - matched.middle
                start = matched.delay + (matched.drift * later if drifting else 0.0)
    elif matched is not None and matched.seen:
        told += _differs(settings, matched)
    counted = Counted.of(settings, sizes, site, placed=log.messages.has_place)
    prior = counted.prior(settings, given)
    slave = Slave(increments, counted.sensors, noise or NOISE, 0, site.anomaly)
    first, state = _start(increments, table, said, start, settings)
    known = Linearisation(state, prior.values[: len(counted.sensors)],
                          prior["installation"].values, start)  # fmt: skip
    sd = _sd(settings, prior, slave.noise, counted)
    model = TransferModel(replace(slave, first=first), said, counted.mount, settings.matched,
                          known, sd, counted.names)  # fmt: skip
    groups = counted.judged_groups(prior, given)
    findings = (*told, *drifting)
    return TransferProblem(model, table, settings, site, prior, hand_over, matched, findings,
                           counted, groups)  # fmt: skip


def _differs(settings: Settings, found: Delay) -> list[Finding]:
    """Say so where the delay that was given is not the one that is found."""
    off = abs(found.delay - settings.known_delay)
    if off < max(DRIFTS * found.delay_sd, DIFFERS):
        return []
    given, delay, sd = (f"{1e3 * x:.1f}" for x in (settings.known_delay, found.delay,
                                                   found.delay_sd))  # fmt: skip
    return [finding("transfer.delay_differs", given=given, found=delay, sd=sd)]


def _matched(
    increments: Increments, table: MasterTable, said: Messages, settings: Settings
) -> Delay | None:
    """Match what both turned."""
    assert table.latitude is not None
    assert table.height is not None
    turning = earth_rate_n(table.latitude) + transport_rate(
        table.latitude, table.height, table.velocity_n
    )
    bracket = (-BEYOND, settings.longest_delay + BEYOND)
    return delay_of(increments, said.time, said.C_nm, w_in_n=turning, C_ms=settings.C_ms,
                    bracket=bracket)  # fmt: skip


def _wild(found: Delay) -> BoolArray:
    """Return the messages whose attitude no neighbour leads to, shape (k,)."""
    before, after = np.append(found.wild[0], found.wild), np.append(found.wild, found.wild[-1])
    return np.asarray(before & after)


def _one_clock(said: Messages, found: Delay) -> tuple[Messages, list[Finding]]:
    """Take out a drift of the clocks, if there is one."""
    total = found.drift * float(said.time[-1] - said.time[0])
    if not abs(found.drift) > DRIFTS * found.drift_sd or not abs(total) > DRIFTED:
        return said, []
    # About the middle of the messages: the delay of the result is the mean one.
    time = said.time - found.drift * (said.time - float(np.mean(said.time)))
    told = finding("transfer.drift", rate=f"{found.drift * 1e6:+.1f}",
                   sd=f"{found.drift_sd * 1e6:.1g}", total=f"{total * 1e3:+.1f}")  # fmt: skip
    return replace(said, time=time), [told]


def assumed_noise() -> Finding:
    """Say which noise was taken where none was stated."""
    return finding(
        "transfer.noise",
        gyro=plain(convert(NOISE.gyro.white, "angle random walk", "deg/sqrt(h)"), 2),
        accel=plain(convert(NOISE.accel.white, "velocity random walk", "ug/sqrt(Hz)"), 2),
    )


def _sd(
    settings: Settings, vector: CoefficientVector, noise: ImuNoise, counted: Counted
) -> FloatArray:
    """Return how well every state is known: phi, velocity, position, then the others [SI]."""
    mount = counted.mount
    layout = states_of_transfer(counted.sensors, mount, settings.matched, noise, counted.names)
    sd = np.empty(len(layout))
    mu_sd = float(np.max(vector["installation"].prior_sd))
    bends = [mount.flexure_sd]
    if mount.load:
        bends.append(0.3 * float(np.max(vector["load"].prior_sd)))  # at the start, by 0.3 g
    sd[0:3] = np.sqrt(settings.attitude_sd**2 + mu_sd**2 + np.sum(np.square(bends)))
    if settings.matching != "velocity":
        sd[0:3] *= WIDER
    sd[3:6], sd[6:9] = settings.velocity_sd, PLACE_SD
    sd[[layout.index(name) for name in vector.names]] = vector.prior_sd
    if mount.flexure_sd > 0:
        sd[layout.group("flexure")] = mount.flexure_sd
        sd[layout.group("flexure_rate")] = mount.flexure_sd * LIVELY / mount.flexure_time
    for i, name in enumerate(layout.names):
        if name in WANDER:
            triad = noise.gyro if name.startswith("gyro") else noise.accel
            sd[i] = triad.bias_instability
    return sd


def _start(
    increments: Increments, table: MasterTable, said: Messages, delay: float, settings: Settings
) -> tuple[int, State]:
    """Return the row next to the first message inside the log, and the slave's state there."""
    time, valid = increments.time, said.time - delay
    k = int(np.searchsorted(valid, time[1]))
    row = increments.row_at(float(valid[k]))
    ahead = float(time[row] - valid[k])
    w = increments.dtheta_b[row] / increments.dt[row]
    f = increments.dvel_b[row] / increments.dt[row]
    C_ms, lever = settings.C_ms, settings.mount.lever_m
    C_nm = said.C_nm[k] @ exp(C_ms @ w * ahead)
    pull = said.C_nm[k] @ C_ms @ f - [0.0, 0.0, 9.80665]
    v = said.velocity_n[k] + pull * ahead + C_nm @ np.cross(C_ms @ w, lever)
    place = place_of(table, k, lever)
    return row, State(*place, v, C_nm @ C_ms)


def place_of(table: MasterTable, k: int, lever_m: FloatArray) -> tuple[float, float, float]:
    """Return where the slave is by message k: latitude, longitude [rad], height [m].

    `k`: number of the message [1]; `lever_m` (3,): from the master to the slave [m].
    """
    assert table.latitude is not None
    assert table.longitude is not None
    assert table.height is not None
    at = (float(table.latitude[k]), float(table.longitude[k]), float(table.height[k]))
    a, b, c = displaced(*at, table.C_nb[k] @ lever_m)
    return float(a), float(b), float(c)


SETTLED = 0.5
"""Passes have settled if the last moved nothing by more than this of its uncertainty [1]."""

STILL = 0.1  # No further pass is made if the last moved nothing by more [1].


@dataclass(frozen=True)
class Solution(Evidence):
    """What was found."""

    problem: TransferProblem  # what was solved, the delay that it started from included
    # the fit of a Kalman filter: its covariance is the posterior Cramer-Rao bound
    kalman: TransferFit
    # gamma, least: bound of the H-infinity filter, and the least there is; infinite for a Kalman
    # filter [1]
    gamma: float
    least: float
    backward: LinearSmoothed | None  # the Kalman run as seen from its end, where wanted
    findings: list[Finding]  # what the user should know of how the passes ended
    judged: Judgement | None  # what was made of what is not estimated, where sizes were declared


def solved(p: TransferProblem, *, history: bool) -> Solution:
    """Find the delay to start from, filter, and bound the filter where that is chosen.

    What happens at once makes innovations that depend on each other, as a mount that bends: it is
    looked for where nothing else than that is found.
    """
    p, likeliest = _started(p)
    fit = filtered.fit(p.model, passes=p.settings.passes, settled=STILL)
    s = _found(p, fit, likeliest, history=history)
    dependent, allowed = whiteness(s.fit.run)
    if dependent <= allowed or "transfer.flexure" not in {f.code for f in noticed(s)}:
        return s
    p, other, told = at_once(p, fit)
    if other is not fit:
        s = _found(p, other, likeliest, history=history)
    return replace(s, findings=[*told, *s.findings])


def noticed(s: Solution) -> list[Finding]:
    """Return all that was noticed of a solution."""
    arm = s.problem.groups.get(LEVER)
    arm_sd = arm.size if arm is not None else 0.0
    return delay_checks.findings(s, s.problem.findings, s.findings, arm_sd=arm_sd)


def _found(
    p: TransferProblem, fit: TransferFit, likeliest: DelayFit | None, *, history: bool
) -> Solution:
    settings, told = p.settings, None
    status, passes = _settled(p, fit)
    if p.counted.judged and status is not Status.NOT_FINITE:
        fit, prior, told = judged(fit, p.prior, p.groups, settings.reported)
        assert isinstance(fit.model, TransferModel)
        p = replace(p, model=fit.model, prior=prior)
    backward = None
    if history:
        kept = kalman(fit.system, keep=True)
        backward = smoothed(fit.system, kept)
    chosen, gamma, least = _bounded(p, fit)
    aside = {n.rpartition(".")[0] for names, *_ in p.counted.groups.values() for n in names}
    return Solution(
        model=p.model, fit=chosen, prior=p.prior, status=status, delay=p.delay,
        longest=settings.longest_delay, likeliest=likeliest, aside=(*LEFT_OUT, *sorted(aside)),
        problem=p, kalman=fit, gamma=gamma, least=least, backward=backward, findings=passes,
        judged=told,
    )  # fmt: skip


LITTLE = 0.3  # So much of its sd an error may be wrong by [1].

PLACES, LONGEST = 3, 5.0
"""What is left out of a log is so many moments at most [1], none of them longer [s]."""

STAYS = {
    "gyro.bias": "the biases of the gyros changed for good",
    "accel.bias": "the biases of the accelerometers changed for good",
    "installation": "the mounting of the slave changed for good",
}
"""What may change for good, where the filter estimates it."""


def at_once(
    p: TransferProblem, fit: TransferFit
) -> tuple[TransferProblem, TransferFit, list[Finding]]:
    """Leave out moments in which the slave's readings are not of its motion; name what stays.

    A spike moves attitude or velocity at once, and is over; a bias or a mounting stays another.
    Either is believed only where all is as it should be with it.
    """
    names = fit.model.names
    groups = {g: [i for i, n in enumerate(names) if n.rpartition(".")[0] == g] for g in STAYS}
    ways = {"gyros": np.arange(3), "accelerometers": np.arange(3, 6)}
    ways |= {g: np.array(at) for g, at in groups.items() if at}
    now, told = fit, list[Finding]()
    for _ in range(PLACES):
        system = now.system
        found = shocks(system, kalman(system, keep=True), ways)
        seen = sorted((w for w in ways if found[w].square > found[w].limit),
                      key=lambda w: -found[w].square)  # fmt: skip
        some = {w: one for w in seen if (one := _changed(now, ways[w], found[w], w in STAYS))}
        done = [w for w, one in some.items() if _explains(one)]
        stay = [w for w in done if w in STAYS and found[w].square > found[done[0]].square - ALIKE]
        if done and stay:
            when = f"{system.time[found[stay[0]].epoch]:.6g}"
            what = " or ".join(STAYS[w] for w in stay)
            return p, fit, [*told, finding("transfer.shift", time=when, what=what)]
        over = [w for w in (done or seen) if w not in STAYS]
        if not over:
            break
        if over[0] == "gyros" and np.sum(found["gyros"].size ** 2) > _small(fit):
            when = f"{system.time[found['gyros'].epoch]:.6g}"
            what = "the attitude changed otherwise than the gyros say (a spike, lost samples)"
            return p, fit, [finding("transfer.shift", time=when, what=what)] if done else []
        now = some[over[0]]
        model = now.model
        assert isinstance(model, TransferModel)
        _, begin, end, _ = model.shocks[-1]
        told.append(finding("transfer.mishap", what=over[0], begin=f"{begin:.6g}",
                            end=f"{end:.6g}"))  # fmt: skip
        if done:
            model = replace(p.model, shocks=model.shocks)
            now = filtered.fit(model, passes=p.settings.passes, settled=STILL)
            return (replace(p, model=model), now, told) if _explains(now) else (p, fit, [])
    return p, fit, []


def _changed(fit: TransferFit, at: IntArray, found: Shock, stays: bool) -> TransferFit | None:
    """Return the fit with states `at` (k,) changed at once [1], as long as it takes."""
    model, time = fit.model, fit.system.time
    assert isinstance(model, TransferModel)
    sd, k, beside, best = 10.0 * float(np.hypot(found.size, found.sd).max()), found.epoch, 0, None
    # What is just wide enough leaves the ends of it in.
    wide = False
    edges = np.concatenate([time[:1] - 1.0, (time[1:] + time[:-1]) / 2, time[-1:] + 1.0])
    while best is None or not (stays or wide):
        wide = best is not None and _explains(best)
        begin, end = (float(edges[np.clip(i, 0, len(time))]) for i in (k - beside, k + beside + 1))
        if best is not None and end - begin > LONGEST:
            break
        half = fit.system.half.copy()
        half[np.ix_((time >= begin) & (time < end), at)] += sd**2
        system = replace(fit.system, half=half)
        more = (tuple(at.tolist()), begin, end, sd)
        other = replace(model, shocks=(*model.shocks, more))
        best = replace(fit, model=other, system=system, run=kalman(system))
        beside += 1 + beside // 2
    return best


def _small(fit: TransferFit) -> float:
    """Return the square of an angle that a free run may be wrong by: ``g angle^2 / 2`` is little.

    Little beside what is not known of the biases of the accelerometers.
    """
    sd = [x for n, x in zip(fit.model.names, fit.run.sd[-1], strict=True) if "accel.bias" in n]
    return 2.0 * LITTLE * float(min(sd, default=np.inf)) / 9.80665


def _explains(fit: TransferFit) -> bool:
    """Tell whether innovations are no larger than they may be, and independent."""
    worst, limit = whiteness(fit.run)
    return worst <= limit and all(c.chi_square <= c.high for c in components(fit, EACH).values())


def ignoring_delay(s: Solution) -> Evidence:
    """Return the same, had the delay been ignored."""
    settings = s.problem.settings.model_copy(update={"gamma": None})
    p = replace(s.problem, settings=settings).with_delay(0.0)
    p = replace(p, model=p.model.without_delay())
    fit = filtered.fit(p.model, passes=settings.passes, settled=STILL)
    return replace(s, model=p.model, fit=_bounded(p, fit)[0])


def bent(p: TransferProblem) -> TransferProblem:
    """Return the problem with the bending that makes the innovations likeliest, if there is one."""
    if p.settings.matching == "velocity":
        return p
    s = solved(p, history=False)
    if s.status is not Status.CONVERGED:
        return p
    fit = likeliest_flexure(s.model, s.fit.point, s.fit.run.log_likelihood)
    if fit.gain < BENDS:
        return p
    return p.with_settings(p.settings.model_copy(update={
        "flexure_sd": fit.sd, "flexure_time": fit.time, "attitude_sd": fit.attitude_sd,
    }))  # fmt: skip


def gravity_error(s: Solution) -> FloatArray:
    """Return what one standard deviation of local gravity makes of `Solution.states`, shape (n,).

    A slave feels its weight and its bias alike: gravity believed too large is a bias too small.

    `s`: a transfer alignment solved [SI].
    """
    sd = s.problem.site.gravity_sd
    if not sd:
        return np.zeros(len(s.prior))
    return _response(s, s.model.heavier(sd))


FAST = 1e-4  # A clock so much too fast shows how the estimate hangs on it [1].


def clock_slope(s: Solution) -> FloatArray:
    """Return how `Solution.states` change with the clock that log and messages share, (n,) [SI].

    What a flight ties to the velocity of a master is a mixture of its turns and of gravity, so that
    it is tried: a clock that is fast for one of the two alone is a delay that drifts, and is seen.
    """
    return _response(s, s.model.faster(FAST)) / FAST


def _response(s: Solution, other: TransferModel) -> FloatArray:
    names = s.model.names[s.model.first :]
    return filtered.response(s.kalman, other)[[names.index(name) for name in s.prior.names]]


def handed_over(s: Solution) -> HandOver:
    """Hand over where the master said that it was, the slave's lever arm away."""
    last = int(np.flatnonzero(s.fit.system.used)[-1])
    here = place_of(s.problem.table, last, s.model.mount.lever_m)
    position = State(*here, np.zeros(3), np.eye(3))
    return hand_over(s.model.slave, s.fit, s.problem.hand_over, position=position)


def _started(p: TransferProblem) -> tuple[TransferProblem, DelayFit | None]:
    """Start from the likeliest delay of the bracket, or from what a filter finds from its middle.

    Rate matching has found what it starts from otherwise.
    """
    s = p.settings
    if not s.estimates_delay or s.delay_method == "rate matching":
        return p, None
    if s.delay_method == "likelihood":
        early = p.with_delay(s.longest_delay).model.loose(s.longest_delay)
        likeliest = likeliest_delay(early.without_delay(), (0.0, s.longest_delay))
        return p.with_delay(likeliest.delay), likeliest
    far = p.model.loose(float(p.prior["master.delay"].prior_sd[0]))
    return p.with_delay(filtered.fit(far).values[far.names.index("master.delay") - far.first]), None


def _settled(p: TransferProblem, fit: TransferFit) -> tuple[Status, list[Finding]]:
    """Tell whether the last pass still moved something; what one pass has found, a second tells."""
    if not np.isfinite(fit.run.states).all():
        return Status.NOT_FINITE, []
    s, passes = p.settings, fit.passes
    if len(passes) < 2:
        passes = filtered.fit(p.model).passes
    if len(passes) < 2:  # the second went astray
        passes = (p.model.values(fit.point), *passes)
    moved = replace(fit, passes=passes).moved
    if float(moved.max()) < SETTLED:
        return Status.CONVERGED, []
    name = p.model.names[p.model.first + int(np.argmax(moved))]
    told = finding("transfer.unsettled", before=len(passes) - 1, after=len(passes), name=name,
                   moved=plain(float(moved.max()), 2), more=min(len(passes) + 3, 10),
                   passes="1 pass was" if s.passes == 1 else f"{s.passes} passes were")  # fmt: skip
    return Status.NOT_CONVERGED, [told]


def _bounded(p: TransferProblem, fit: TransferFit) -> tuple[TransferFit, float, float]:
    """Filter the last system again with a bound, where that is chosen; gamma and the least."""
    system, settings, layout = fit.system, p.settings, p.model.layout
    if settings.filter == "kalman":
        return fit, np.inf, np.inf
    if settings.wanted == "prior":
        # A free run's position is never measured, its vertical velocity only where that is matched:
        # bounding what grows without a bound would leave nothing of the bound for the others.
        unseen = (6, 7, 8) if p.model.matching.vertical else (5, 6, 7, 8)
        # Nor is anything wanted of what is only counted with.
        aside = [layout.index(n) for n in p.prior.names if n not in settings.reported]
        L = np.delete(by_prior(system), (*unseen, *aside), axis=0)
    else:
        L = after_outage(system, p.counted.sensors, settings.outage)
    least = least_gamma(system, L)
    gamma = settings.gamma_factor * least if settings.gamma is None else settings.gamma
    run = h_infinity(system, L, gamma)
    if run.stopped is not None:
        raise error("transfer.gamma", given=plain(gamma, 4), least=plain(least, 4),
                    time=stamp(float(system.time[run.stopped])))  # fmt: skip
    return replace(fit, run=run), gamma, least
