"""Allan deviations, and the noise that explains them.

Allan variance of one channel: deviations, their confidence, and the noises they show.

The overlapping Allan variance at tau = m dt, from the phase x (integral of the rate y)::

    sigma^2(tau) = <(x_{i+2m} - 2 x_{i+m} + x_i)^2> / (2 tau^2)

The modified one averages the difference over m neighbours first, the Hadamard variance takes
third differences (and does not see a ramp). Each noise has its own slope::

    sigma^2(tau) = 3 Q^2/tau^2 + N^2/tau + (2 ln 2/pi) B^2 + K^2 tau/3 + R^2 tau^2/2

The noises are always fitted to the overlapping Allan variance; the other kinds are shown with the
curve that the same noises have there.

Allan variance of a log: its part at rest, every axis, and the noise block of a campaign.

A campaign describes a slowly changing bias as a first-order Markov process, an Allan variance
finds flicker. They are matched where flicker shows most: the Allan deviation of the Markov
process peaks at 1.89 correlation times with 0.617 times its standard deviation, and both are
chosen so that this peak lies on the flat part of the fitted curve, sqrt(2 ln 2/pi) B = 0.664 B.
On either side of its peak the Markov process is quieter than flicker.

References
----------
.. [1] IEEE Std 952-1997, annex C; flicker, eq. (C.9) ff.; Markov noise, eq. (C.17) ff. (peak
   0.437 q_c sqrt(T_c), with sd = q_c sqrt(T_c/2)).
.. [2] W. J. Riley, "Handbook of Frequency Stability Analysis", NIST SP 1065, 2008, section 5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import get_args

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.detect.noise import without_spikes
from foucault.detect.stretches import How, Rests, find_rests
from foucault.diagnose.allan_fit import SPAN, Kind, degrees_of_freedom, expected, norm
from foucault.diagnose.settling import Event, calmed
from foucault.errors import Finding, FoucaultError, error, finding, suggestion
from foucault.logs.checks import rate_instead
from foucault.tables import AXES, Log, evened, gaps
from foucault.units import convert, display_unit, plain

KINDS: tuple[Kind, ...] = get_args(Kind)

LEAST = 256  # Fewest samples: seven octaves for five noises [1].

USEFUL = 5.0
"""Fewest degrees of freedom of a useful tau: the deviation is known to 32 % (1 sd) [1]."""

NOISES = ("quantisation", "white", "bias_instability", "random_walk", "ramp")
"""The five noises, in the order of their slopes; keys of [noise] where it has them."""

WORDS = {
    "gyro": (
        "quantisation",
        "angle random walk",
        "bias instability",
        "rate random walk",
        "rate ramp",
    ),
    "accel": (
        "quantisation",
        "velocity random walk",
        "bias instability",
        "acceleration random walk",
        "acceleration ramp",
    ),
}
"""What people call them."""

UNIT_KINDS = {
    "gyro": ("angle increment", "angle random walk", "angular rate", *WORDS["gyro"][3:]),
    "accel": ("velocity increment", "velocity random walk", "specific force", *WORDS["accel"][3:]),
}
"""What they are measured in: keys of `units.KINDS`."""


@dataclass(frozen=True)
class Noise:
    """One of the five noises in one channel."""

    name: str
    # value, sd: Q [unit s], N [unit/sqrt(Hz)], B [unit], K [unit/sqrt(s)] or R [unit/s]; sd is NaN
    # where the value is zero
    value: float
    sd: float
    seen: bool  # whether the data show it
    # low, high: interval that holds the truth with a probability of 95 % [as value]. Of a noise not
    # seen, low is 0 and high the upper limit; infinite where the data set none
    low: float
    high: float


@dataclass(frozen=True)
class Channel:
    """The Allan deviations of one channel and what they show."""

    kind: Kind
    interval: float  # sample interval [s]
    samples: int  # number of samples [1]
    tau: FloatArray  # (k,) averaging times [s]
    # deviation, low, high: (k,) deviations and their 95 % interval [unit]
    deviation: FloatArray
    low: FloatArray
    high: FloatArray
    dof: FloatArray  # (k,) equivalent degrees of freedom for the noises fitted and the excess [1]
    curve: FloatArray  # (k,) deviations that the noises fitted have on average [unit]
    parts: FloatArray  # (5, k) the same of each noise alone [unit]
    noises: tuple[Noise, ...]  # the five noises, in the order of `NOISES`
    # relative scatter of the variances about the curve that noise does not explain [1]
    excess: float
    longest: float  # longest useful averaging time, `USEFUL` [s]

    def noise(self, name: str) -> Noise:
        """Return the noise `name`, one of `NOISES`."""
        return self.noises[NOISES.index(name)]


def octaves(samples: int) -> IntArray:
    """Return factors 1, 2, 4, ... up to a quarter of the record of `samples` [1], shape (k,)."""
    return np.asarray(2 ** np.arange(int(np.log2(max(samples, 4))) - 1), np.int64)


def deviations(
    rate: FloatArray,
    interval: float,
    factors: IntArray | None = None,
    kind: Kind = "overlapping",
) -> tuple[FloatArray, FloatArray]:
    """Compute deviations of one channel.

    `rate` (n,): readings, evenly spaced [unit]; `interval`: of the samples [s]; `factors` (k,) or
    None: averaging times in samples, else `octaves` [1]. Returns averaging times (k,) [s] and
    deviations (k,) [unit]. Needs twice the memory of `rate`: 1.6 GB for 1e8 samples.
    """
    m = octaves(len(rate)) if factors is None else np.asarray(factors, np.int64)
    deviation = np.sqrt(_variances(_phase(rate), m, check_kind(kind)))
    return np.asarray(m * interval, float), np.asarray(deviation)


def _phase(rate: FloatArray) -> FloatArray:
    from foucault.kernels import allan

    phase = np.empty(len(rate) + 1)
    allan.integrate(rate, float(rate.mean()), phase)
    return phase


def _variances(phase: FloatArray, m: IntArray, kind: Kind) -> FloatArray:
    from foucault.kernels import allan

    largest = (len(phase) - (kind != "modified")) // SPAN[kind]
    wrong = m[(m < 1) | (m > largest)]
    if len(wrong):
        raise error("allan.factor", given=wrong[0], samples=len(phase) - 1, largest=largest)
    return np.asarray(getattr(allan, kind)(phase, m) * norm(kind, m))


def measure(
    rate: FloatArray, interval: float, kind: Kind = "overlapping", axis: str = "the channel"
) -> Channel:
    """Compute the deviations of one channel and find the noises in them.

    `rate` (n,): readings at rest, evenly spaced [unit]; `interval`: sample interval [s].
    """
    from scipy.special import gammaincinv

    from foucault.diagnose.allan_fit import CONFIDENCE, fit

    check(rate, interval, axis)
    n, m = len(rate), octaves(len(rate))
    phase = _phase(rate)
    allan = _variances(phase, m, "overlapping")
    found = fit(allan, n, m)
    shown = allan if kind == "overlapping" else _variances(phase, m, kind)
    # A ramp alone has no degrees of freedom: a trace of white noise, far below rounding, has.
    random = np.maximum(found.p, [0, 1e-12 * allan[0], 0, 0, 0])
    by_noise = degrees_of_freedom(kind, n, m, random)
    dof = 2 / (2 / by_noise + found.excess**2)
    edge = (1 + CONFIDENCE) / 2
    parts = expected(kind, m) * found.p
    # From units of one sample interval to seconds.
    scale = interval ** np.array([1.0, 0.5, 0.0, -0.5, -1.0])
    value = np.sqrt(found.p)
    sd = found.sd / (2 * np.where(value > 0, value, np.nan))
    columns = (value * scale, sd * scale, found.seen, np.sqrt(found.low) * scale,
               np.sqrt(found.high) * scale)  # fmt: skip
    return Channel(
        kind=kind,
        interval=interval,
        samples=n,
        tau=np.asarray(m * interval, float),
        deviation=np.sqrt(shown),
        low=np.sqrt(shown * dof / (2.0 * gammaincinv(dof / 2.0, edge))),
        high=np.sqrt(shown * dof / (2.0 * gammaincinv(dof / 2.0, 1 - edge))),
        dof=dof,
        curve=np.sqrt(parts.sum(axis=1)),
        parts=np.sqrt(parts.T),
        noises=tuple(
            Noise(name, float(v), float(s), bool(seen), float(low), float(high))
            for name, v, s, seen, low, high in zip(NOISES, *columns, strict=True)
        ),
        excess=found.excess,
        longest=float(interval * m[by_noise >= USEFUL][-1]),
    )


def check_kind(given: str) -> Kind:
    """Return `given` as a kind of deviation, or raise what the kinds are."""
    for kind in KINDS:
        if given == kind:
            return kind
    hint = suggestion(given, KINDS)
    raise error("allan.kind", given=given, allowed=", ".join(KINDS), hint=hint)


def check(rate: FloatArray, interval: float, axis: str = "the channel") -> None:
    """Raise what makes an Allan variance of `rate` (n,) [unit], each `interval` [s], impossible."""
    if len(rate) < LEAST:
        duration = f"{len(rate) * interval:.4g}"
        raise error("allan.too_short", samples=len(rate), duration=duration, least=LEAST)
    # A sum is finite only if every term is: no mask for the usual case.
    if not np.isfinite(rate.sum()):
        wrong = np.flatnonzero(~np.isfinite(rate))
        raise error("allan.not_finite", axis=axis, count=len(wrong), row=wrong[0])
    if rate.min() == rate.max():
        raise error("allan.constant", axis=axis)


MARKOV_PEAK = (0.6174, 1.8926)
"""Peak of the Allan deviation over the sd of the Markov noise; its tau over T_c [1]."""

FLAT = float(np.sqrt(2 * np.log(2) / np.pi))  # Allan deviation of flicker over B [1].
SMALL = 0.5  # A rest that covers less than this of the log is a small part of it [1].
MOVED = float(np.radians(0.3))  # What turns or tilts by less stays where it is [rad].
_WHOLE = 0.95  # a rest that covers this part of the log: the log does not move


@dataclass(frozen=True)
class LogAllan:
    """The Allan deviations of a log."""

    channels: dict[str, Channel]  # by axis: ``gyro.x`` [rad/s], ``accel.x`` [m/s^2]
    # start, end: first and last time used [s]
    start: float
    end: float
    findings: tuple[Finding, ...]


def measure_log(
    log: Log,
    *,
    axes: tuple[str, ...] = (),
    kind: Kind = "overlapping",
    rest: tuple[float, float] | None = None,
) -> LogAllan:
    """Find the noises of every axis of a log at rest.

    `axes`: such as ``gyro.x``, ``gyro`` or ``x``, empty for all; `kind`: of deviation to show;
    `rest` or None: start and end of the part at rest, else the whole log, or the longest rest of
    one that moves [s].
    """
    names = _chosen(log, axes)
    log = without_spikes(log.filled())
    part, told = _part_at_rest(log, rest)
    findings = [*(f for f in log.findings if f.code == "log.spikes"), *told]
    channels, stuck = {}, None
    for name in names:
        triad, axis = name.split(".")
        x = np.ascontiguousarray(getattr(part, triad)[:, AXES.index(axis)])
        x, events = calmed(x)
        try:
            channel = measure(x, part.interval, kind, name)
        except FoucaultError as problem:
            if problem.code != "allan.constant":
                raise
            stuck = problem
            findings.append(finding("allan.stuck", axis=name))
            continue
        channels[name] = channel
        findings += [_told(name, event, part) for event in events]
        findings += _quantised(name, x)
    if stuck is not None and not channels:
        raise stuck
    misfits = [f"{n} ({100 * c.excess:.2g} %)" for n, c in channels.items() if c.excess > 0]
    if misfits:
        findings.append(finding("allan.misfit", axes=", ".join(misfits)))
    findings += _hidden(channels)
    return LogAllan(channels, float(part.time[0]), float(part.time[-1]), tuple(findings))


def _told(name: str, event: Event, part: Log) -> Finding:
    """Say what was taken off an axis, in units for people."""
    kind = {"gyro": "angular rate", "accel": "specific force"}[name.partition(".")[0]]
    unit = display_unit(kind, abs(event.change))
    change = f"{plain(convert(event.change, kind, unit), 3)} {unit}"
    time = event.time * part.interval
    if event.kind == "jumps":
        return finding("allan.jumps", axis=name, change=change, time=f"{part.time[0] + time:.5g}")
    return finding("allan.settles", axis=name, change=change, time=f"{time:.3g}")


def _chosen(log: Log, wanted: tuple[str, ...]) -> list[str]:
    names = [f"{triad}.{AXES[i]}" for triad in ("gyro", "accel") for i in log.logged(triad)]
    for word in wanted:
        if not any(_means(word, name) for name in names):
            hint = suggestion(word, names)
            raise error("allan.axis", given=word, allowed=", ".join(names), hint=hint)
    return [n for n in names if not wanted or any(_means(word, n) for word in wanted)]


def _means(word: str, name: str) -> bool:
    return word == name or word in name.split(".")


def _part_at_rest(log: Log, rest: tuple[float, float] | None) -> tuple[Log, list[Finding]]:
    """Return the evenly sampled part of the log that does not move."""
    part = log if rest is None else _between(log, *rest)
    part, findings = _even(part)
    if len(part) < LEAST:
        duration = f"{part.duration:.4g}" if len(part) else "0"
        raise error("allan.too_short", samples=len(part), duration=duration, least=LEAST)
    gyro, accel = (None if _coarse(x) else x for x in (part.gyro, part.accel))
    fine = replace(part, gyro=gyro, accel=accel)
    if fine.gyro is None and fine.accel is None:
        return part, findings
    # Windows of fewer samples scatter so much that a log at rest seems to move now and then.
    rests = find_rests(fine, How(window=max(0.5, 51 * part.interval)))
    lengths = rests.last - rests.first
    longest = int(lengths.argmax()) if len(lengths) else -1
    covered = int(lengths[longest]) if len(lengths) else 0
    if covered + rests.window >= _WHOLE * len(part):
        return part, findings
    if rest is not None:
        span = {"start": f"{rest[0]:g}", "end": f"{rest[1]:g}"}
        return part, [*findings, finding("allan.moves", **span)]
    if covered < SMALL * len(part) and _stays(fine, rests):
        share = 100 * (1 - lengths.sum() / len(part))
        return part, [*findings, finding("allan.shaken", share=f"{share:.2g}")]
    if covered < LEAST:
        raise error("allan.no_rest", samples=covered, least=LEAST)
    whole = part.duration
    part = part[int(rests.first[longest]) : int(rests.last[longest])]
    span = {"start": f"{part.time[0]:.2f}", "end": f"{part.time[-1]:.2f}"}
    if covered < SMALL * (whole / part.interval):
        share = f"{100 * part.duration / whole:.2g}"
        return part, [*findings, finding("allan.small_part", share=share, **span)]
    return part, [*findings, finding("allan.longest_rest", **span)]


def _stays(log: Log, rests: Rests) -> bool:
    """Return whether the instrument is after each shake as it was before, and turns in none."""
    if len(rests) < 2 or log.gyro is None:  # without a gyro a turn about the vertical is not seen
        return False
    spans = list(zip(rests.first.tolist(), rests.last.tolist(), strict=True))
    rate = np.array([log.gyro[a:b].mean(axis=0) for a, b in spans])
    for k, (a, b) in enumerate(pairwise(spans)):
        turned = np.cumsum(log.gyro[a[1] : b[0]] - (rate[k] + rate[k + 1]) / 2, axis=0)
        if np.abs(turned).max(initial=0.0) * log.interval > MOVED:
            return False
    if log.accel is None:
        return True
    up = np.array([log.accel[a:b].mean(axis=0) for a, b in spans])
    up /= np.linalg.norm(up, axis=1)[:, None]
    return bool(np.abs(up - np.median(up, axis=0)).max() < MOVED)


def _coarse(x: FloatArray | None) -> bool:
    """Return whether all axes move within a few steps of their output: that is no motion."""
    if x is None:
        return True
    for column in x.T:
        step = np.abs(np.diff(column))
        if np.ptp(column) > 4 * np.min(step[step > 0], initial=np.inf):
            return False
    return True


def _between(log: Log, start: float, end: float) -> Log:
    part = log[int(np.searchsorted(log.time, start)) : int(np.searchsorted(log.time, end, "right"))]
    if len(part) == 0:
        edges = {"first": f"{log.time[0]:.9g}", "last": f"{log.time[-1]:.9g}"}
        raise error("allan.span", start=f"{start:g}", end=f"{end:g}", **edges)
    return part


def _even(log: Log) -> tuple[Log, list[Finding]]:
    """Return the longest part without a gap; refuse intervals that are not even."""
    if len(log) < 3:
        return log, []
    step = np.diff(evened(log.time))
    wide = gaps(step)
    off = (np.abs(step / log.interval - 1) > 0.1) & ~wide
    if off.mean() > 0.01:
        share, nominal = f"{100 * off.mean():.3g}", f"{log.interval:.6g}"
        raise error("allan.uneven", share=share, nominal=nominal, advice=rate_instead(log.time))
    if not wide.any():
        return log, []
    edges = np.concatenate([[0], np.flatnonzero(wide) + 1, [len(log)]])
    k = int(np.diff(edges).argmax())
    part = log[int(edges[k]) : int(edges[k + 1])]
    span = {"start": f"{part.time[0]:.9g}", "end": f"{part.time[-1]:.9g}"}
    return part, [finding("allan.gap", count=int(wide.sum()), **span)]


def _quantised(name: str, x: FloatArray) -> list[Finding]:
    step = np.abs(np.diff(x))
    repeated = float(np.mean(step == 0))
    if repeated <= 0.5:
        return []
    apart = step[step > 1e-9 * np.abs(x).max()]  # not what is left of divisions by the interval
    kind = {"gyro": "angular rate", "accel": "specific force"}[name.partition(".")[0]]
    size = float(apart.min()) if len(apart) else 0.0
    unit = display_unit(kind, size)
    values = {
        "share": f"{100 * repeated:.3g}",
        "step": f"{plain(convert(size, kind, unit), 3)} {unit}",
    }
    return [finding("allan.quantised", axis=name, **values)]


def _hidden(channels: dict[str, Channel]) -> list[Finding]:
    """Say which noises of long averaging times the record is too short for, alike axes together."""
    groups: dict[tuple[str, ...], list[str]] = {}
    for name, channel in channels.items():
        words = WORDS[name.split(".")[0]]
        pairs = zip(words[2:], channel.noises[2:], strict=True)
        unseen = tuple(word for word, noise in pairs if not noise.seen)
        groups.setdefault(unseen, []).append(name)
    return [
        finding(
            "allan.hidden",
            axis=", ".join(names),
            terms=", ".join(words),
            longest=f"{min(channels[name].longest for name in names):.3g}",
        )
        for words, names in groups.items()
        if words
    ]


def described(noise: Noise, triad: str, longest: float) -> tuple[str, str, str]:
    """Write value, sd and interval of a `noise` [SI], useful up to `longest` [s], for people."""
    kind = UNIT_KINDS[triad][NOISES.index(noise.name)]
    if noise.seen:
        unit = display_unit(kind, noise.value)
        value, sd, low, high = (
            convert(x, kind, unit) for x in (noise.value, noise.sd, noise.low, noise.high)
        )
        digits = max(0, 1 - math.floor(math.log10(sd)))
        shown = [f"{x:.{digits}f}" for x in (value, sd, low, high)]
        return f"{shown[0]} {unit}", shown[1], f"{shown[2]} to {shown[3]}"
    if not math.isfinite(noise.high):
        return "not seen", "", "no limit: the record is too short"
    unit = display_unit(kind, noise.high)
    short = "" if noise.name in NOISES[:2] else f" (tau up to {longest:.3g} s)"
    return (
        "not seen",
        "",
        f"below {plain(convert(noise.high, kind, unit), 2)} {unit}{short}",
    )


def deviation_table(measured: LogAllan) -> str:
    """Write the deviations of every axis as CSV text: one row per axis and averaging time, SI."""
    lines = ["axis,kind,tau,deviation,low,high,degrees_of_freedom,curve"]
    for name, c in measured.channels.items():
        columns = (c.tau, c.deviation, c.low, c.high, c.dof, c.curve)
        rows = zip(*columns, strict=True)
        lines += [",".join([name, c.kind, *(f"{v:.10g}" for v in row)]) for row in rows]
    return "\n".join(lines) + "\n"


def noise_block(measured: LogAllan) -> str:
    """Write the ``[noise]`` block of a campaign file.

    A campaign has one value for the three axes of a triad: the root mean square over the axes on
    which the noise was seen.
    """
    lines = [
        f"# Measured at rest, {measured.start:.6g} s to {measured.end:.6g} s: root mean square of",
        "# the axes on which a noise was seen.",
    ]
    for triad in ("accel", "gyro"):
        channels = [c for name, c in measured.channels.items() if name.startswith(triad)]
        keys = _triad_lines(triad, channels)
        lines += [f"[noise.{triad}]", *keys] if any(not k.startswith("#") for k in keys) else keys
    if not any(line.startswith("[") for line in lines):
        raise error("allan.nothing_seen")
    return "\n".join(lines) + "\n"


def _triad_lines(triad: str, channels: list[Channel]) -> list[str]:
    lines = []
    for i, name in enumerate(NOISES):
        values = [c.noises[i].value for c in channels if c.noises[i].seen]
        if not values:
            continue
        value = float(np.sqrt(np.mean(np.square(values))))
        said = f"{WORDS[triad][i]}, on {len(values)} of {len(channels)} axes"
        if name in ("white", "random_walk"):
            lines.append(_line(name, _text(value, triad, i), said))
        elif name == "bias_instability":
            time = float(np.exp(np.mean([np.log(_flattest(c)) for c in channels])))
            markov = _text(value * FLAT / MARKOV_PEAK[0], triad, i)
            said += f": flicker B = {_text(value, triad, i)},"
            lines.append(_line(name, markov, said))
            said = f"as Markov noise with its Allan peak on the flat part, at {time:.3g} s"
            lines.append(_line("correlation_time", f"{time / MARKOV_PEAK[1]:.3g} s", said))
        else:  # the key `quantisation` rounds each reading; this noise is lost between readings
            lines.append(f"# {said}, not a key of a campaign: {_text(value, triad, i)}")
    return lines


def _line(key: str, value: str, said: str) -> str:
    return f'{key} = "{value}"'.ljust(44) + f"# {said}"


def _flattest(channel: Channel) -> float:
    """Return the averaging time at which flicker is the largest share of the curve [s]."""
    others = np.square(np.delete(channel.parts, 2, axis=0)).sum(axis=0)
    return float(channel.tau[np.argmin(others)])


def _text(value: float, triad: str, i: int) -> str:
    kind = UNIT_KINDS[triad][i]
    unit = display_unit(kind, value)
    return f"{convert(value, kind, unit):.4g} {unit}"
