"""What the user should know of a transfer alignment: delay, motion, and how messages scatter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from foucault.diagnose.transfer.causes import narrow, of_flexure, of_lever, of_outliers, of_priors
from foucault.diagnose.transfer.checks import (
    NEAR,
    Evidence,
    bracket,
    hardly,
    hidden,
    spreads,
    whiteness,
)
from foucault.errors import Finding, Status, finding
from foucault.models.rotation import log as rotation_vector
from foucault.units import plain

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
    e: Evidence, before: Sequence[Finding] = (), passes: Sequence[Finding] = ()
) -> list[Finding]:
    """Return all that was noticed: of delay, motion, innovations and what would explain them.

    `before`: what was noticed before. Where that explains large innovations, and where passes
    have not settled, nothing is said of what rests on the estimates.
    """
    if EXPLAINS & {f.code for f in before}:
        return [*before, *_of_edge(e), *_straight(e)]
    if e.status is not Status.CONVERGED:
        return [*before, *passes, *_of_edge(e), *_straight(e)]
    priors = narrow(e)
    causes = [*of_priors(e, priors), *of_lever(e)] or of_outliers(e)
    told = [*before, *passes, *_of_edge(e), *_of_delay(e), *_straight(e)]
    # What was said to be known too well is not hidden by the motion.
    known = [group for group, _ in priors]
    told += [*unseen([n for n in hardly(e) if n.rpartition(".")[0] not in known]), *_hidden(e)]
    dependent, allowed = whiteness(e.fit.run)
    if not causes and dependent > allowed:
        causes = of_flexure(e)
    return [*told, *(causes or _of_spread(e))]


def _of_edge(e: Evidence) -> list[Finding]:
    if e.likeliest is None or not e.likeliest.at_edge:
        return []
    return [finding("transfer.edge", delay=_ms(e.likeliest.delay), longest=_ms(e.longest))]


def _of_delay(e: Evidence) -> list[Finding]:
    out: list[Finding] = []
    limits = bracket(e)
    if limits is None:
        return out
    found = e.states["master.delay"]
    tau, sd = float(found.values[0]), float(found.sd[0])
    if not limits[0] <= tau <= limits[1]:
        out.append(finding("transfer.outside", delay=_ms(tau), longest=_ms(e.longest)))
    if abs(tau) < 3 * sd + NEAR and sd < NEAR:
        out.append(finding("transfer.at_validity", delay=_ms(tau), sd=plain(sd * 1e3, 2)))
    return [*out, *_two_delays(e, tau, sd)]


def _two_delays(e: Evidence, tau: float, sd: float) -> list[Finding]:
    """Say so where rate matching and the filter disagree on the delay."""
    if e.delay is None or not e.delay.seen:
        return []
    later = float(np.mean(e.model.master.time)) - e.delay.middle
    other, other_sd = e.delay.delay + e.delay.drift * later, e.delay.delay_sd
    if abs(other - tau) < max(CONTRADICT * float(np.hypot(sd, other_sd)), NEAR):
        return []
    return [finding("transfer.delays", matched=_ms(other), matched_sd=plain(other_sd * 1e3, 2),
                    found=_ms(tau), sd=plain(sd * 1e3, 2))]  # fmt: skip


def _ms(seconds: float) -> str:
    return f"{seconds * 1e3:.1f}"


def _straight(e: Evidence) -> list[Finding]:
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


def _hidden(e: Evidence) -> list[Finding]:
    names = hidden(e)
    if not names:
        return []
    return [finding("transfer.hidden", names=", ".join(names))]


def _of_spread(e: Evidence) -> list[Finding]:
    out = []
    units = {"velocity": (1.0, "m/s"), "attitude": (np.radians(1 / 60), "arcmin")}
    for name, s in spreads(e).items():
        if s.low <= s.ratio <= s.high or (s.ratio < s.low and not e.fit.nominal):
            continue
        size, unit = units[name]
        # What the state is uncertain by belongs to the innovation, and not to the messages. It is
        # most at the start: the median is of a filter that has settled.
        run, block = e.fit.run, e.model.kinds[name]
        S = run.variance[:, block][np.isfinite(run.innovation[:, block])]
        given = getattr(e.model.matching, f"{name}_sd")
        left = given**2 + (s.ratio**2 - 1.0) * float(np.median(S))
        if left <= 0:
            continue
        value = f"{plain(np.sqrt(left) / size, 2)} {unit}"
        code = "transfer.spread" if s.ratio > 1.0 else "transfer.narrow"
        out.append(finding(code, what=name, ratio=f"{s.ratio:.2f}",
                           key=f"{name}_sd", value=value))  # fmt: skip
    return out
