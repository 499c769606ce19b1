"""What is doubtful of a transfer alignment: its delay, its motion, and how the messages scatter.

Of two instruments alone the turning says whether the offset found in it is seen, and right. Where
messages do not fit, what would explain it is looked for: a lever arm, a prior. A lever arm that
is wrong by d makes the velocities differ by ``C_nm (w x d)``, which the free run's equations take
as three states more. A prior that is too narrow is found by doing without it: what the messages
alone say then lies beyond it, and the innovations fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from foucault import units
from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.detect.noise import measure_noise, resolution
from foucault.detect.stretches import Rests
from foucault.diagnose import transfer as judge
from foucault.errors import Finding, Status, finding, listed
from foucault.estimate.delay import SEEN, UNLIKE, Delay
from foucault.estimate.transfer import likeliest_flexure
from foucault.guard.master import SURE_SD, of_size, of_wild
from foucault.infer import filtered
from foucault.infer.filtered import component
from foucault.infer.gauss_newton import FALSE_ALARM, chi_square_limits
from foucault.infer.linear_filter import extended, kalman
from foucault.models.noise import ImuNoise
from foucault.models.rotation import cross_matrix, exp
from foucault.models.rotation import log as rotation_vector
from foucault.tables import AXES, Log
from foucault.units import plain

NO_DELAY = 1e-3  # A delay below this is none [s].
WANDERS = 1e-3  # False-alarm rate of a delay that does not stay [1].
MATTERS = 1e-4  # A change of the delay below this is not told [s].
ASTRAY = np.radians(10.0)  # A mounting that is so far off is told [rad].
POORLY = np.radians(1.0)  # A mounting that is known no better is told [rad].

_AXES = (("right", "forward", "up"), ("left", "back", "down"))
_SWAPPED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Right, forward, up from forward, right, down."""


def checked(
    found: Delay, *, C_ms: FloatArray | None, messages: bool, elsewhere: Delay | None = None
) -> tuple[Finding, ...]:
    """Return what is doubtful about an offset.

    `C_ms` (3, 3) or None: mounting that was said [1]; `messages`: whether the second log holds
    messages of a master, which arrive late; `elsewhere` or None: a better one outside of the
    bracket.
    """
    told = [*_seen(found), *_place(found, elsewhere)]
    told += of_size(found)
    if not found.seen:
        return tuple(told)
    told += [*_clocks(found), *_mounting(found, C_ms)]
    if messages:
        told += _near_zero(found)
    return (*told, *of_wild(found))


QUIET, LEG = 4.0, 60.0
"""Parts of a log that show whether noise blurs its steps, and how long a leg is straight [s]."""

COARSE = 6.0
"""A rounding error this many times the noise of a leg's mean is told: those of legs differ [1]."""


def of_resolution(log: Log, noise: ImuNoise) -> list[Finding]:
    """Name a triad of a slave that is read in steps so coarse that its noise does not average them.

    `log`: readings [SI]; `noise`: of the slave [SI]. Where it moves by more than a step rounding is
    white, and increments that carry it on lose nothing.
    """
    size, out = max(16, round(QUIET / log.interval)), []
    rows = (
        ("gyros", log.gyro, noise.gyro, "angular rate"),
        ("accelerometers", log.accel, noise.accel, "specific force"),
    )
    for what, x, triad, kind in rows:
        lost = [0.0]
        for column in np.empty((0, 3)) if x is None else x.T:
            step = resolution(column)
            parts = column[: len(column) // size * size].reshape(-1, size)
            quiet = np.flatnonzero(parts.std(axis=1) < step)
            if len(quiet):
                found = measure_noise(
                    np.repeat(column[:, None], 3, axis=1), log.interval,
                    Rests(quiet * size, (quiet + 1) * size), np.full(3, step),
                    increments=log.sampled == "increment",
                )  # fmt: skip
                lost.append(float(found.rounding[0]) * len(quiet) / len(parts))
        if max(lost) > COARSE * triad.white / np.sqrt(LEG):
            unit = units.display_unit(kind, max(lost))
            sd = f"{plain(units.convert(max(lost), kind, unit), 2)} {unit}"
            out.append(finding("transfer.resolution", what=what, sd=sd))
    return out


def percent(part: float) -> str:
    """Write `part`, a part of one, shape () [1], in percent."""
    return f"{100 * part:.1f} %"


def _seen(found: Delay) -> list[Finding]:
    if found.likeness < UNLIKE:
        return [finding("delay.unlike", part=percent(found.likeness))]
    if found.match.converged and found.delay_sd <= SEEN:
        return []
    used, dt = found.match.used, float(np.mean(found.turns.dt[found.match.used]))
    change = np.diff(found.match.phi_s[used], axis=0) / dt
    noise = found.match.residual[used] / dt
    rate, left = (float(np.degrees(np.sqrt(np.mean(x**2)))) for x in (change, noise))
    sd = found.delay_sd if found.match.converged else np.inf
    return [finding("delay.not_seen", sd=plain(1e3 * sd, 2), rate=plain(rate, 2),
                    noise=plain(left, 2))]  # fmt: skip


def _place(found: Delay, elsewhere: Delay | None) -> list[Finding]:
    told = []
    if found.edge:
        more = ""
        apart = 0.0 if elsewhere is None else abs(elsewhere.delay - found.delay)
        if elsewhere is not None and elsewhere.likeness > found.likeness and apart > NO_DELAY:
            more = f" Over all they overlap, {_ms(elsewhere.delay)} ms fits best."
        low, high = (plain(edge, 4) for edge in found.bracket)
        told.append(finding("delay.edge", delay=_ms(found.delay), low=low, high=high, more=more))
    if len(found.rivals) and found.seen:
        others = ", ".join(_ms(x) for x in found.rivals)
        told.append(finding("delay.rivals", others=others, delay=_ms(found.delay)))
    return told


def _near_zero(found: Delay) -> list[Finding]:
    words = {"delay": _ms(found.delay, found.delay_sd), "sd": plain(1e3 * found.delay_sd, 2)}
    if abs(found.delay) < max(NO_DELAY, SURE_SD * found.delay_sd):
        return [finding("delay.validity", **words)]
    return [finding("delay.negative", **words)] if found.delay < 0 else []


def _clocks(found: Delay) -> list[Finding]:
    """Tell a delay that grows steadily, or does something else."""
    first, last = (found.delay + found.drift * (t - found.middle)
                   for t in (found.part_start[0], found.part_end[-1]))  # fmt: skip
    told = []
    if found.drift and abs(last - first) > MATTERS:
        told.append(finding(
            "delay.drift", rate=f"{1e6 * found.drift:.3g}", sd=f"{1e6 * found.drift_sd:.2g}",
            first=_ms(first, MATTERS), last=_ms(last, MATTERS), middle=plain(found.middle, 6),
        ))  # fmt: skip
    return [*told, *of_wandering(found)]


def of_wandering(found: Delay) -> list[Finding]:
    """Tell a delay that jumps or wanders, beside what a drift of the clocks makes of it."""
    from scipy.special import chdtrc

    sd = np.sqrt(np.diag(found.part_cov))
    seen = sd < SEEN  # the others say nothing
    centre = (found.part_start + found.part_end) / 2 - found.middle
    steady = found.delay + found.drift * centre
    off = (found.part_delay - steady)[seen]
    if np.sum(seen) > 2 and np.ptp(off) > MATTERS:
        size = float(off @ np.linalg.solve(found.part_cov[np.ix_(seen, seen)], off))
        if chdtrc(np.sum(seen) - 1 - bool(found.drift), size) < WANDERS:
            parts, sds = (
                ", ".join(x) for x in (map(_ms, found.part_delay), (plain(1e3 * x, 2) for x in sd))
            )
            return [finding("delay.wanders", parts=parts, sds=sds)]
    return []


def _mounting(found: Delay, C_ms: FloatArray | None) -> list[Finding]:
    size, axes = np.linalg.eigh(found.mu_cov)
    told = []
    sd = float(np.sqrt(size[-1]))
    angle = 0.0 if C_ms is None else float(np.linalg.norm(rotation_vector(C_ms.T @ found.C_ms)))
    if C_ms is not None and angle > max(ASTRAY, SURE_SD * sd):
        told.append(finding("delay.axes", angle=plain(np.degrees(angle), 3),
                            axes=_names(found.C_ms)))  # fmt: skip
    nearest = np.linalg.norm(rotation_vector(_SWAPPED.T @ found.C_ms))
    if C_ms is None and nearest < ASTRAY:
        told.append(finding("delay.north_east_down", axes=_names(found.C_ms)))
    if sd > POORLY:
        x, y, z = (axes[:, -1] * np.sign(axes[np.argmax(np.abs(axes[:, -1])), -1])).round(2) + 0.0
        told.append(finding("delay.mounting", axis=f"({x:.2f}, {y:.2f}, {z:.2f})",
                            sd=plain(np.degrees(sd), 2)))  # fmt: skip
    return told


def _names(C_ms: FloatArray) -> str:
    """Return along which axes of the master those of the slave lie, more or less."""
    place = np.argmax(np.abs(C_ms), axis=0)
    return ", ".join(_AXES[int(C_ms[place[i], i] < 0)][place[i]] for i in range(3))


def _ms(seconds: float, sd: float = MATTERS) -> str:
    """Write a delay in ms to the digits of its standard deviation."""
    digits = int(np.clip(1 - np.floor(np.log10(max(1e3 * sd, 1e-6))), 0, 4))
    return f"{1e3 * seconds:.{digits}f}"


FAR = 10.0  # A lever arm of which nothing is said is known so well [m].
UNSETTLED = 1.0  # The velocity at the start may be wrong by this where the lever arm is [m/s].

LONG, SEEN_M = 0.05, 0.5
"""A shorter lever arm is none; a component that is known worse is not seen [m]."""

LEFT = 0.3  # An arm leaves at most this part of what is too large about the innovations [1].
NEARLY = 1.2  # With the arm that is found innovations may be so many times as large as allowed [1].
SURELY = 1e-4  # False-alarm rate of a lever arm [1].

OUTLIER, FEW, MOST = 8.0, 0.01, 5
"""An innovation of so many standard deviations is none of this noise; if at most this part of the
messages has such; so many are named [1]."""

BENDS = 10.0
"""A bending that makes the innovations likelier by less is none, as a log-likelihood [1]."""

VISIBLE = 1e-6
"""A direction of which the messages say less, in units of its prior, is not tested [1]."""

WIDER = np.logspace(0.0, 4.0, 81)  # So many times as wide a prior is tried [1].

ALIKE = 6.0
"""Explanations whose log-likelihoods differ by less than half of it are not told apart [1]."""

LOOSE = 100.0  # Without priors means with priors so many times as wide [1].


@dataclass(frozen=True)
class LeverArm:
    """What the velocities say of the lever arm."""

    arm: FloatArray  # (3,) from the master to the slave, in the master's axes [m]
    cov: FloatArray  # (3, 3) its covariance, by how the innovations scatter [m^2]
    gain: float  # by how much the log-likelihood is higher than with the one that was given [1]
    # ratio, high: root mean square of the velocities' innovations, standardised, and its limit [1]
    ratio: float
    high: float

    @property
    def sd(self) -> FloatArray:
        """Standard deviation of each component, shape (3,) [m]."""
        return np.asarray(np.sqrt(np.diag(self.cov)))

    def off(self, other: FloatArray, sd: float = 0.0) -> float:
        """Return how far `other` (3,) [m], known to `sd` [m], is, squared, in sds [1]."""
        d = self.arm - other
        return float(d @ np.linalg.solve(self.cov + sd**2 * np.eye(3), d))


ARM = tuple(f"lever_arm.{axis}" for axis in AXES)
"""States of a lever arm that is counted with."""


def lever_arm(e: judge.Evidence) -> LeverArm | None:
    """Find the lever arm beside all that was estimated; None where velocities are not used."""
    if not np.isfinite(e.model.matching.velocity_sd):
        return None
    system = extended(e.fit.system, leverage(e), FAR)
    # As a state it is known to some size, enlarged where that is contradicted: here it is open.
    counted = [k for k, name in enumerate(e.model.names) if name in ARM]
    system.P0[counted] = system.P0[:, counted] = 0.0
    system.P0[range(3, 6), range(3, 6)] += UNSETTLED**2
    run = kalman(system)
    d, cov = run.states[-1, -3:], run.cov[-3:, -3:]
    if not (np.isfinite(d).all() and np.isfinite(cov).all()):
        return None
    gain = 0.5 * float(d @ np.linalg.solve(cov, d))
    scatter = component(run.white[:, e.model.kinds["velocity"]], judge.EACH)
    if scatter is None:
        return None
    cov = cov * max(1.0, scatter.ratio * scatter.count / scatter.redundancy)
    rms, _, high = scatter.rms
    return LeverArm(e.model.mount.lever_m + d, cov, gain, rms, high)


def leverage(e: judge.Evidence) -> FloatArray:
    """Return ``C_nm [w x]`` at messages, (m, 6, 3): velocity per lever arm [1/s]."""
    system, C_ms = e.fit.system, e.model.mount.C_ms @ exp(e.fit.point.installation)
    turning = e.model.master.C_nm[system.used] @ cross_matrix(system.w_ib_b @ C_ms.T)
    return np.concatenate([turning, np.zeros_like(turning)], axis=1)


def of_lever(e: judge.Evidence, sd: float) -> list[Finding]:
    """Say so where the velocities show another lever arm than was given, known to `sd` [m]."""
    found, given = lever_arm(e), e.model.mount.lever_m
    if found is None or found.off(given, sd) < chi_square_limits(3, 2 * SURELY)[1]:
        return []
    now = judge.spreads(e)["velocity"]
    little = now.chi_square > now.high and found.ratio**2 - 1.0 > LEFT * (now.ratio - 1.0)
    if little or found.ratio > NEARLY * found.high:
        return []  # something else is wrong, of which an arm takes a part
    seen = found.sd < SEEN_M
    if not np.linalg.norm((found.arm - given)[seen]) > LONG:
        return []
    arm = np.where(seen, found.arm, given)
    said = "none was given"
    if np.linalg.norm(given) > 0:
        said = f"what was given is {_metres(given)} m{_named(found, given)}"
    written = ", ".join(f'"{x:.3f} m"' for x in arm)
    return [finding("transfer.lever", found=_metres(found.arm), sd=_metres(found.sd), said=said,
                    gain=f"{found.gain:.0f}", written=written)]  # fmt: skip


def _metres(x: FloatArray) -> str:
    return "(" + ", ".join(f"{v:.3f}" for v in x) + ")"


def _named(found: LeverArm, given: FloatArray) -> str:
    """Say which mistake would have made the given arm of the one that is found."""
    others = {
        "the opposite of it": -given,
        "it with x reversed": given * [-1.0, 1.0, 1.0],
        "it with y reversed": given * [1.0, -1.0, 1.0],
        "it with z reversed": given * [1.0, 1.0, -1.0],
        "it with x and y exchanged": given[[1, 0, 2]],
        "it with forward, right, down taken for right, forward, up": given[[1, 0, 2]] * [1, 1, -1],
        "none at all": 0.0 * given,
    }
    # Arms are measured with a tape: some centimetres are no other arm.
    near = replace(found, cov=found.cov + LONG**2 * np.eye(3))
    off = {words: near.off(arm) for words, arm in others.items()}
    best = min(off, key=lambda words: off[words])
    clear = off[best] < min(chi_square_limits(3)[1], near.off(given))
    return f": what shows is {best}" if clear else ""


def narrow(e: judge.Evidence) -> list[tuple[str, CoefficientVector]]:
    """Return the priors that what is found contradicts, where the innovations fit without them.

    Returns group, and what the messages alone say of its coefficients; none where all is as it
    was said to be, or where innovations are too large without priors too [SI].
    """
    suspects = contradicted(e)
    if not suspects and judge.fits(e):
        return []
    # What priors hide of each other cannot be told: each that would do is named.
    named = [one for group in suspects for one in _freed(e, [group])]
    return named or _freed(e, _groups(e))


def _groups(e: judge.Evidence) -> list[str]:
    return list(dict.fromkeys(n.rpartition(".")[0] for n in e.states.names if n != "master.delay"))


def contradicted(e: judge.Evidence) -> list[str]:
    """Return the groups whose prior the messages contradict, those that explain it best.

    With u the estimate less its prior mean in units of its sd, and ``V = I - P`` with P its
    covariance in these units, ``u' V^+ u`` is chi-square where the prior is right [1]_: a prior
    that is narrow draws the estimate to itself, and makes u and V small alike.

    References
    ----------
    .. [1] C. R. Rao, "Large sample tests of statistical hypotheses", 1948 (the score test).
    """
    c, groups = e.states, _groups(e)
    assert c.cov is not None
    if not e.fit.nominal or not np.isfinite(c.cov).all():
        return []
    gains: dict[str, float] = {}
    for group in groups:
        at = c.layout.group(group)
        sd = c.prior_sd[at]
        u = (c.values - e.prior.values)[at] / sd
        size, axes = np.linalg.eigh(np.eye(len(at)) - c.cov[np.ix_(at, at)] / np.outer(sd, sd))
        seen = size > VISIBLE
        w, own = (axes.T @ u)[seen], size[seen]
        if not seen.any() or float(np.sum(w**2 / own)) < chi_square_limits(
            int(seen.sum()), 2 * FALSE_ALARM, len(groups)
        )[1]:  # fmt: skip
            continue
        # Twice the gain in log-likelihood by a prior that is k times as wide, the best k.
        more = (WIDER[:, None] ** 2 - 1.0) * own
        gain = np.sum(more / (1.0 + more) * w**2 / own - np.log1p(more), axis=1)
        gains[group] = float(gain.max())
    best = max(gains.values(), default=0.0)
    return [g for g in sorted(gains, key=lambda g: -gains[g]) if gains[g] > max(best - ALIKE, 0.0)]


def _freed(e: judge.Evidence, groups: Sequence[str]) -> list[tuple[str, CoefficientVector]]:
    """Return what the messages say of groups whose priors are wide, those that were wrong."""
    loose = [i for group in groups for i in e.model.layout.group(group)]
    if "installation" in groups:
        loose += [0, 1, 2]  # the start is turned as the mounting is
    wide = e.model.sd.copy()
    wide[loose] *= LOOSE
    found = filtered.fit(replace(e.model, sd=wide), passes=4, settled=1.0)
    freed = replace(e, fit=found)
    if not np.isfinite(found.run.white).any() or not judge.fits(freed):
        return []
    alone, mean = freed.states, e.prior.values
    limit = np.sqrt(chi_square_limits(1, FALSE_ALARM, len(alone))[1])
    off = np.abs(alone.values - mean) / np.hypot(alone.sd, alone.prior_sd)
    wrong = {n.rpartition(".")[0] for n, x in zip(alone.names, off, strict=True) if x > limit}
    return [(group, alone[group]) for group in groups if group in wrong]


def of_priors(e: judge.Evidence, priors: Sequence[tuple[str, CoefficientVector]]) -> list[Finding]:
    """Name the priors without which the innovations would fit."""
    out = []
    for group, alone in priors:
        mean = e.prior.values[[e.prior.layout.index(name) for name in alone.names]]
        away = alone.values - mean
        k = int(np.argmax(np.abs(away) / alone.prior_sd))
        kind = alone.layout.coefficients[k].kind
        unit = units.display_unit(kind, float(np.abs(away).max()))

        def said(value: float, kind: str = kind, unit: str = unit) -> str:
            return f"{plain(units.convert(float(value), kind, unit), 2)} {unit}"

        out.append(finding(
            "transfer.prior", group=group, name=alone.names[k], found=said(alone.values[k]),
            mean=said(mean[k]), prior=said(alone.prior_sd[k]),
            wide=said(2.0 * float(np.abs(away).max())),
        ))  # fmt: skip
    return out


def of_flexure(e: judge.Evidence) -> list[Finding]:
    """Offer the bending of the mount that makes the innovations likeliest, where one is seen."""
    if not e.fit.nominal or not np.isfinite(e.model.matching.attitude_sd):
        return []
    fit = likeliest_flexure(e.model, e.fit.point, e.fit.run.log_likelihood)
    if fit.gain < BENDS:
        return []
    worst, limit = judge.whiteness(fit.run)
    good = worst <= limit and judge.fits(replace(e, fit=replace(e.fit, run=fit.run)))
    left = "innovations are then as they should be" if good else "something else is left"
    arcmin = np.radians(1 / 60)
    return [finding(
        "transfer.flexure", sd=plain(fit.sd / arcmin, 3), time=plain(fit.time, 2),
        noise=plain(fit.attitude_sd / arcmin, 3), gain=f"{fit.gain:.0f}", left=left,
    )]  # fmt: skip


def of_outliers(e: judge.Evidence) -> list[Finding]:
    """Name the few messages that are off, where the others fit."""
    u, system = e.fit.run.white, e.fit.system
    with np.errstate(invalid="ignore"):
        off = np.asarray((np.abs(u) > OUTLIER).any(axis=1))
    if not 0 < np.sum(off) <= FEW * len(u):
        return []
    without = replace(system, R=np.where(off[:, None], np.inf, system.R))
    if not judge.fits(replace(e, fit=replace(e.fit, run=kalman(without)))):
        return []
    times = system.time[off] + e.fit.point.delay
    shown = listed([plain(round(float(t), 2), 13) for t in times], MOST)
    return [finding("transfer.outliers", count=len(times), limit=f"{OUTLIER:g}",
                    worst=plain(float(np.nanmax(np.abs(u))), 2), times=shown)]  # fmt: skip


TURNED, SPED = np.radians(10.0), 2.0
"""A vehicle that turns less, and changes its speed by less, does no manoeuvre [rad], [m/s]."""

CONTRADICT = 5.0
"""Delays by rate matching and by the filter differ by so many standard deviations [1]."""

WANTED = {
    "gyro.bias": "minutes more with the master",
    "gyro.scale": "turns of 90 deg and more about the axis, both ways",
    "accel.bias": "turns: while the heading stays a bias looks like a tilt",
    "installation": "S-turns and changes of speed",
    "master.delay": "turns and changes of speed: without them a delay changes nothing",
    "load": "steep turns",
}
"""Group of coefficients -> what shows them."""


EXPLAINS = {"delay.scale", "transfer.delay_differs", "transfer.force_axes", "transfer.force_size",
            "transfer.force_unit", "transfer.force_velocity", "transfer.gravity", "transfer.mirror",
            "transfer.mounting", "transfer.sense", "transfer.clock"}  # fmt: skip
"""What makes innovations large whatever was said of the messages."""


def findings(
    e: judge.Evidence, before: Sequence[Finding] = (), passes: Sequence[Finding] = (), *,
    arm_sd: float = 0.0,
) -> list[Finding]:  # fmt: skip
    """Return all that was noticed: of delay, motion, innovations and what would explain them.

    Where that explains large innovations, and where passes have not settled, nothing is said of
    what rests on the estimates.

    `arm_sd`: how well the lever arm was said to be known [m].
    """
    if EXPLAINS & {f.code for f in before}:
        return [*before, *_of_edge(e), *_straight(e)]
    if e.status is not Status.CONVERGED or "transfer.shift" in {f.code for f in passes}:
        return [*before, *passes, *_of_edge(e), *_straight(e)]
    priors = narrow(e)
    causes = [*of_priors(e, priors), *of_lever(e, arm_sd)] or of_outliers(e)
    told = [*before, *passes, *_of_edge(e), *_of_delay(e), *_straight(e)]
    # What was said to be known too well is not hidden by the motion.
    known = [group for group, _ in priors]
    told += [
        *unseen([n for n in judge.hardly(e) if n.rpartition(".")[0] not in known]),
        *_hidden(e),
    ]
    dependent, allowed = judge.whiteness(e.fit.run)
    if not causes and dependent > allowed:
        causes = of_flexure(e)
    return [*told, *(causes or _of_spread(e))]


def _of_edge(e: judge.Evidence) -> list[Finding]:
    if e.likeliest is None or not e.likeliest.at_edge:
        return []
    return [finding("transfer.edge", delay=_in_ms(e.likeliest.delay), longest=_in_ms(e.longest))]


def _of_delay(e: judge.Evidence) -> list[Finding]:
    out: list[Finding] = []
    limits = judge.bracket(e)
    if limits is None:
        return out
    found = e.states["master.delay"]
    tau, sd = float(found.values[0]), float(found.sd[0])
    if not limits[0] <= tau <= limits[1]:
        out.append(finding("transfer.outside", delay=_in_ms(tau), longest=_in_ms(e.longest)))
    if abs(tau) < 3 * sd + judge.NEAR and sd < judge.NEAR:
        out.append(finding("transfer.at_validity", delay=_in_ms(tau), sd=plain(sd * 1e3, 2)))
    return [*out, *_two_delays(e, tau, sd)]


def _two_delays(e: judge.Evidence, tau: float, sd: float) -> list[Finding]:
    """Say so where rate matching and the filter disagree on the delay."""
    if e.delay is None or not e.delay.seen:
        return []
    later = float(np.mean(e.model.master.time)) - e.delay.middle
    other, other_sd = e.delay.delay + e.delay.drift * later, e.delay.delay_sd
    if abs(other - tau) < max(CONTRADICT * float(np.hypot(sd, other_sd)), judge.NEAR):
        return []
    return [finding("transfer.delays", matched=_in_ms(other), matched_sd=plain(other_sd * 1e3, 2),
                    found=_in_ms(tau), sd=plain(sd * 1e3, 2))]  # fmt: skip


def _in_ms(seconds: float) -> str:
    return f"{seconds * 1e3:.1f}"


def _straight(e: judge.Evidence) -> list[Finding]:
    C, v = e.model.master.C_nm, e.model.master.velocity_n
    turn = float(np.max(np.linalg.norm(rotation_vector(C[0].T @ C), axis=1)))
    speed = float(np.ptp(np.linalg.norm(v, axis=1)))
    if turn > TURNED or speed > SPED:
        return []
    return [finding("transfer.straight", turn=f"{np.degrees(turn):.1f}", speed=f"{speed:.1f}")]


def unseen(names: Sequence[str]) -> list[Finding]:
    """Name the coefficients that a motion does not show, and what would show them."""
    if not names:
        return []
    groups = [g for g in WANTED if any(n == g or n.startswith(f"{g}.") for n in names)]
    wanted = "; ".join(WANTED[g] for g in groups)
    return [finding("transfer.unseen", names=", ".join(names), wanted=wanted)]


def _hidden(e: judge.Evidence) -> list[Finding]:
    names = judge.hidden(e)
    if not names:
        return []
    return [finding("transfer.hidden", names=", ".join(names))]


def _of_spread(e: judge.Evidence) -> list[Finding]:
    out = []
    units = {"velocity": (1.0, "m/s"), "attitude": (np.radians(1 / 60), "arcmin")}
    for name, s in judge.spreads(e).items():
        if s.inside or (s.chi_square < s.low and not e.fit.nominal):
            continue
        size, unit = units[name]
        # What the state is uncertain by belongs to the innovation, and not to the messages. It is
        # most at the start: the median is of a filter that has settled.
        run, block = e.fit.run, e.model.kinds[name]
        S = run.variance[:, block][np.isfinite(run.innovation[:, block])]
        given = getattr(e.model.matching, f"{name}_sd")
        left = given**2 + (s.ratio - 1.0) * float(np.median(S))
        if left <= 0:
            continue
        value = f"{plain(np.sqrt(left) / size, 2)} {unit}"
        code = "transfer.spread" if s.ratio > 1.0 else "transfer.narrow"
        out.append(finding(code, what=name, ratio=f"{s.rms[0]:.2f}", key=f"{name}_sd", value=value))
    return out
