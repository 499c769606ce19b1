"""The checks of a mixed model, the same for every procedure that states one.

A procedure says what its kinds of reading are called, where its noise is from, and which scatter
is no longer a calibration; it adds checks of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from foucault.arrays import FloatArray, IntArray
from foucault.diagnose.checks import (
    change_checks,
    check,
    foreseen_check,
    judge_prior,
    plausible_scales,
    status_check,
)
from foucault.infer import mixed
from foucault.infer.drift import Drift, by_time, find_drift, jumps, settles
from foucault.infer.gauss_newton import FALSE_ALARM, TOLD, Component, chi_square_limits
from foucault.infer.information import information
from foucault.infer.left_out import ALIKE, With
from foucault.infer.mixed import Fit, HeldOut
from foucault.result import CERTAIN, Check, Level
from foucault.units import plain

if TYPE_CHECKING:
    from foucault.infer import filtered

TOO_MUCH = 5.0  # Residuals this many times the noise are no scatter: a term is missing [1].
TOLD_APART = 8.0  # With fewer degrees of freedom one wrong reading looks like scatter of all [1].
ENOUGH = 6.0  # Fewer numbers beyond those that the unknowns need hardly show a bad reading [1].
TESTED = 3.0  # Half a session with fewer degrees of freedom is not compared with the other [1].

MUCH = 0.25
"""A part that leaves this share of all that parts leave may hide behind what it makes [1]."""

STRAY = 1e-3  # How often chance names one of all parts that does not belong to the others [1].


class Limit(NamedTuple):
    """From what size on a scatter is no longer a calibration."""

    what: str  # what scatters, as a sentence begins
    largest: float  # [SI]
    factor: float  # size in `unit` per SI unit
    unit: str
    cause: str  # what else it is
    fails: Level = Level.DOUBTFUL


@dataclass(frozen=True)
class Judged:
    """A fit, and what its procedure says of it."""

    fit: Fit
    kinds: Mapping[str, str]  # kind of reading -> what people call it
    noise: Literal["declared", "measured", "unknown"]
    time: FloatArray | None = None  # (n,) middle of each reading; None: not known [s]
    # kind of reading -> sources whose size is found from it
    found_in: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    limits: Mapping[str, Limit] = field(default_factory=dict)  # source -> what is too much
    readings: str = "readings"
    cure: str = "Add readings."
    more: str = "repeat the readings"
    overstated: str = "the noise is"  # what is, where the residuals are too small
    too_much: float = TOO_MUCH  # residuals so many times the noise are no scatter [1]
    # kinds of reading without any noise, which says nothing of what is too much
    silent: frozenset[str] = frozenset()
    cause: Mapping[str, str] = field(default_factory=dict)  # kind -> why it does not fit
    # (n,) readings of one number are held out together; None: each by itself
    blocks: IntArray | None = None
    named: Callable[[int], str] | None = None  # number of these -> what people call them
    held_out: HeldOut | None = None  # where something else is predicted
    held_out_size: str = ""  # how large its errors are, in words that follow a comma
    predicted: str = ""  # what was held out, where not all `readings` are
    # with fewer degrees of freedom one wrong reading looks like scatter of all [1]
    told_apart: float = TOLD_APART
    # source that rows of what was known beforehand are -> what says so, after "Say", or "" where
    # nobody said anything
    said: Mapping[str, str] = field(default_factory=dict)


def checks(e: Judged) -> list[Check]:
    """Return the tests that every procedure makes; a failed one carries its reason."""
    estimate = e.fit.estimate
    out = [status_check(estimate.status, estimate.weakest), redundancy(e), *judge_prior(estimate)]
    out += known_checks(e.fit, e.said)
    out += plausible_scales(estimate.coefficients)
    out += change_checks(changes(e), estimate.coefficients.layout)
    out += [explained(e, kind) for kind in e.kinds if kind in e.fit.before]
    out += [_scatter(e, name) for name in e.limits if e.fit.found.get(name)]
    out += _even(e)
    return out + _held_out(e)


def known_checks(fit: Fit, said: Mapping[str, str]) -> list[Check]:
    """Compare nuisance parameters as found with what was known of them; none where none show.

    Of white rows z of what was known, ``cov(z) = I - R P R'``: what the readings tell of them.
    `said`: as of `Judged`.
    """
    from scipy.special import chdtrc, chdtri

    if fit.at.known is None:
        return []
    z, R = fit.at.known
    told = list[tuple[float, float, int, str]]()
    for what in dict.fromkeys(fit.at.known_from):
        if not said.get(what, what):
            continue
        mine = np.array([name == what for name in fit.at.known_from])
        seen = np.eye(int(mine.sum())) - R[mine] @ fit.estimate.state_cov @ R[mine].T
        share, along = np.linalg.eigh(seen)
        kept = share > KNOWN
        if kept.any():
            square = float(np.sum((along.T @ z[mine])[kept] ** 2 / share[kept]))
            told.append((float(chdtrc(kept.sum(), square)), square, int(kept.sum()), what))
    if not told:
        return []
    _, square, dof, what = min(told)
    high = np.sqrt(float(chdtri(dof, CERTAIN)) / dof)  # a little more is within what was said
    cure = said.get(what) or "how well it is known, or correct it"
    given = {"what": what, "cure": cure}
    return [check("known beforehand", BEFOREHAND, np.sqrt(square / dof), None, high, given)]


BEFOREHAND = "known beforehand"  # Name of the check of `known_checks`.
KNOWN = 1e-2  # Share of what was known that readings tell, below which it is not tested [1].


def said_once(every: list[Check], better: str) -> list[Check]:
    """Leave out what was known beforehand where a check that is worded better fails too.

    `better`: name of that check.
    """
    failed = any(c.name == better and not c.passed for c in every)
    return [c for c in every if not (failed and c.name == BEFOREHAND)]


def redundancy(e: Judged) -> Check:
    """Judge whether enough is left over to notice a wrong reading, beside causes that are known."""
    fit, at = e.fit, e.fit.white
    dof = sum(c.redundancy for c in fit.after.values())
    if _counts(e):  # of the readings alone, whatever was known beforehand
        kept = (at.blocks >= 0) & (fit.estimate.weights[at.blocks] > 0.5)
        J = at.jacobian[kept]
        size = np.linalg.norm(J, axis=0)
        dof = float(len(J) - np.linalg.matrix_rank(J[:, size > 0] / size[size > 0]))
    dof = round(dof, 6)  # often exactly `ENOUGH`
    n = int(np.sum(fit.estimate.weights > 0.5))
    given = {"n": n, "readings": e.readings, "cure": e.cure}
    return check("redundancy", "redundancy", dof, ENOUGH, None, given)


def explained(e: Judged, kind: str) -> Check:
    """Compare the residuals of one kind of reading with the noise, and say what follows.

    Declared noise that is contradicted fails, either way. Noise that was measured within readings
    is a lower limit of what differs between them: moderate scatter beyond it is accounted for, and
    what was measured too large only makes the uncertainties careful. Noise that nobody knows is
    told by enough redundant readings.
    """
    from scipy.special import chdtrc

    mine = e.found_in.get(kind, ())
    added = any(e.fit.found.get(name) for name in mine if name in _unexplained(e))
    others = any(e.fit.found.get(name) for name in _unexplained(e))
    # Scatter of one kind shows in the others too until it is known.
    c = e.fit.after[kind] if others and not added else e.fit.before[kind]
    what, name = e.kinds[kind], f"noise of {e.kinds[kind]}"
    told = {"what": what, "dof": _counted(c.redundancy)}
    if e.noise == "unknown":
        dof = sum(e.fit.dof.get(source, 0.0) for source in mine)
        told |= {"dof": _counted(dof), "more": e.more}
        return check("noise unknown", name, dof, TOLD, None, told)
    if c.redundancy < 0.5:
        return check("noise untested", name, float("nan"), None, None, told)
    ratio = float(np.sqrt(c.ratio))
    then = _then(e, kind, ratio, added, c.redundancy)
    given = told | {"ratio": ratio, "then": then, "overstated": e.overstated}
    if e.noise == "declared":
        quiet = _counts(e) and c.chi_square < c.low  # what is counted with was nothing
        return check("noise", name, c.chi_square, c.low, c.high, given, excused=quiet)
    known = added and c.redundancy >= e.told_apart
    high = max(c.high, e.too_much**2 * c.redundancy) if known else c.high
    careful = c.chi_square < c.low or c.chi_square <= high or (added and kind in e.silent)
    left = e.fit.after[kind]  # what is beyond the noise is accounted for, and nothing beyond that
    chance = float(chdtrc(left.redundancy, left.chi_square)) if left.redundancy >= 0.5 else 1.0
    return check("noise", name, c.chi_square, c.low, c.high, given, excused=careful, p=chance)


def _counts(e: Judged) -> bool:
    """Tell whether causes are counted with that may as well be nothing."""
    return bool(getattr(e.fit.model, "more", ()))


def _counted(dof: float) -> str:
    """Write degrees of freedom as people count: in whole numbers, where they are many."""
    return f"{dof:.0f}" if dof >= 10 else plain(dof, 2)


def _unexplained(e: Judged) -> set[str]:
    return {s.name for s in e.fit.at.sources if s.unexplained}


def _then(e: Judged, kind: str, ratio: float, added: bool, dof: float) -> str:
    """Say what residuals that are too large mean."""
    cause = e.cause.get(kind, "")
    if not added:
        return f", and the uncertainties do not know it{': ' if cause else ''}{cause}."
    if e.noise == "declared":
        cause = cause or "the declared noise is too small"
        return f": {cause}. The uncertainties include the scatter."
    if dof < e.told_apart:
        return (
            "; so few readings are redundant that one wrong reading would look like this too. "
            "The scatter is part of the uncertainties; measure more to tell."
        )
    if ratio > e.too_much and kind not in e.silent:
        cause = cause or (
            "something is wrong that is no scatter, such as lost samples, a wrong sample rate, or "
            "a term that is not estimated"
        )
        return (
            f", more than {e.too_much:g} times: {cause}. The scatter is part of the uncertainties, "
            "but such errors do not average out."
        )
    return "; the scatter was estimated and is part of the uncertainties."


def _scatter(e: Judged, name: str) -> Check:
    limit, sd = e.limits[name], e.fit.found[name]
    given = {
        "what": limit.what, "cause": limit.cause,
        "size": f"{plain(sd * limit.factor, 2)} {limit.unit}",
        "limit": f"{plain(limit.largest * limit.factor, 2)} {limit.unit}",
    }  # fmt: skip
    title = f"scatter of {limit.what.removeprefix('The ')} [{limit.unit}]"
    most = limit.largest * limit.factor
    return check("repeatability", title, sd * limit.factor, None, most, given, fails=limit.fails)


def _even(e: Judged) -> list[Check]:
    """Compare the residuals of the first and the second half of each kind of reading."""
    from scipy.special import fdtri

    if e.time is None:
        return []
    estimate, out = e.fit.estimate, []
    used = estimate.blocks >= 0
    white, free = estimate.residuals[used], 1 - estimate.leverage[used]
    if _counts(e):  # causes that all readings share are tested by themselves
        white, free = e.fit.own
    square = white**2
    blocks = estimate.blocks[used]
    kept = estimate.weights[blocks] > 0.5
    # Without noise halves differ for other reasons than chance.
    compared = set(e.kinds) - e.silent
    kinds = {kind: rows for kind, rows in e.fit.model.kinds.items() if kind in compared}
    for kind, rows in kinds.items():
        mine = np.flatnonzero(rows.any(axis=1))
        order = mine[np.argsort(e.time[mine], kind="stable")]
        halves = [np.isin(blocks, half) & rows.ravel() & kept for half in np.array_split(order, 2)]
        dof = [float(np.sum(free[half])) for half in halves]
        if min(dof) < TESTED:
            continue
        ratio = float(
            np.sum(square[halves[0]]) / dof[0] / max(np.sum(square[halves[1]]) / dof[1], 1e-300)
        )
        alpha = FALSE_ALARM / len(kinds) / 2
        low, high = 1 / fdtri(dof[1], dof[0], 1 - alpha), fdtri(dof[0], dof[1], 1 - alpha)
        given = {
            "what": e.kinds[kind], "worse": "first" if ratio > 1 else "second",
            "times": np.sqrt(max(ratio, 1 / max(ratio, 1e-300))),
        }  # fmt: skip
        name = f"evenness of {e.kinds[kind]}"
        out.append(check("evenness", name, ratio, float(low), float(high), given))
    return out


def _held_out(e: Judged) -> list[Check]:
    """Hold readings against what all others say of them, and name one that does not belong there.

    One-sided: a prediction that is better than promised is no fault of the result.
    """
    kept = np.flatnonzero(e.fit.estimate.weights > 0.5)
    number = kept if e.blocks is None else e.blocks[kept]
    blocks, where = np.unique(number, return_inverse=True)
    parts = [kept[where == k] for k in range(len(blocks))]
    found = e.held_out or (mixed.held_out(e.fit, parts) if len(parts) > 1 else None)
    if found is None or found.count == 0:
        return []
    stray = None if e.held_out or e.named is None else _stray(e.fit, found, parts)
    named = None
    if stray is not None and e.named is not None:
        named = e.named(int(blocks[stray[0]])), stray[1]
    return [held_out_check(found, e.predicted or e.readings, e.held_out_size, named)]


def held_out_check(
    found: HeldOut | filtered.HeldOut, what: str, size: str = "",
    stray: tuple[str, float] | None = None,
) -> Check:  # fmt: skip
    """Return the check of what was predicted from all others.

    `what`: was held out; `size`: how large its errors are, or where, in words that follow a comma;
    `stray` or None: the part that does not belong to the others, and how far off it is [sd].
    """
    ratio = float(np.sqrt(max(found.score, 0.0) / found.count))
    given = {"what": what.capitalize(), "size": size, "ratio": ratio}
    key = "held out"
    if stray is not None:
        key = "held out but one"
        given |= {"which": stray[0], "times": stray[1]}
    return check(
        key, f"held-out {what}", found.score, None, found.high, given, passed=stray is None
    )


def _stray(fit: Fit, found: HeldOut, parts: list[IntArray]) -> tuple[int, float] | None:
    """Return the part that does not belong to the others, and how far off it is [sd].

    One that is wrong makes the scatter that it hides behind: it is predicted with sizes that were
    found without it, where it may be one.
    """
    from scipy.special import fdtri

    counts, scores, alpha = found.counts, found.scores, STRAY / len(parts)

    def limit(count: float, dof: float) -> float:
        if not np.isfinite(dof):
            return chi_square_limits(count, 2 * alpha)[1]
        return float(count * fdtri(count, dof, 1 - alpha))

    limits = np.array([limit(n, np.inf) if n else np.inf for n in counts])
    worst = int(np.argmax(scores / limits))
    count, score = int(counts[worst]), float(scores[worst])
    if any(fit.found.values()):
        if score < MUCH * found.score:
            return None
        again, dof = mixed.without(fit, parts[worst])
        count, score = again.count, again.score
        if count == 0 or dof < TESTED:
            return None
        limits[worst] = limit(count, dof)
    return (worst, float(np.sqrt(score / count))) if score > limits[worst] else None


def against_the_plan(fit: Fit) -> list[Check]:
    """Compare the uncertainties with what preflight says of the same plan; see `foreseen_check`.

    A filter has no scatter to find: there the two differ by what is enlarged, which is a doubt.
    """
    problem = mixed.without_scatter(fit)
    if problem is None:
        return []
    at = problem.linearise(fit.state, np.ones(problem.n_blocks))
    return [foreseen_check(fit.estimate.coefficients, information(at, problem.layout).sd)]


def folds(fit: Fit, kind: str, count: int) -> list[IntArray]:
    """Return the readings of a kind in `count` parts [1], what was left out left out."""
    mine = np.flatnonzero(fit.model.kinds[kind].any(axis=1))
    mine = mine[fit.estimate.weights[mine] > 0.5]
    parts = [mine[np.arange(len(mine)) % count == k] for k in range(count)]
    return [part for part in parts if len(part)]


def changes(e: Judged) -> list[Drift]:
    """Return drift and jump of a coefficient that the residuals show most clearly, where any shows.

    Each looks like the others, and like what settles: of what is more than chance, the clearest is
    there alone. Drifts that are sources of the fit are in its uncertainties, and have a test of
    their own; one that was enlarged explains a jump, which is sought beside drifts of their size.
    Where scatter was found jumps are sought without it too, at the same share of false alarms.
    """
    if e.time is None:
        return []
    model, time, ramp = e.fit.model, e.time, by_time(e.time)
    counted = isinstance(model, With) and model.drifts
    if isinstance(model, With) and any(name.endswith(" drift") for name in model.sizes):
        own = replace(model, sizes={})
        e = replace(e, fit=mixed.solve(own, e.fit.sds, e.fit.estimate.weights, e.fit.state))
    ways: list[dict[float | None, FloatArray]] = [{}] if counted else [{None: ramp}]
    out = [one for way in (*ways, jumps(time)) if (one := _clearest(e, way)) is not None]
    drift = [one for one in out if one.when is None]
    shown = [one for one in drift if one.significant]
    known = e.noise != "unknown"
    off = {name: 0.0 for name in _unexplained(e) if known and e.fit.found.get(name)}
    jump = next((one for one in out if one.when is not None and one.significant), None)
    if (jump is None and (shown or not off)) or (shown and not known):
        return shown or out
    # It is asked again without scatter, which all of them look like, and what noise allows is no
    # jump, however quiet the others are: shaking is measured as noise.
    if off:
        e = replace(e, fit=mixed.solve(e.fit.model, {**e.fit.sds, **off}, e.fit.estimate.weights,
                                       e.fit.state))  # fmt: skip
    sure = _clearest(e, jumps(time), 1.0 if known else 0.0)
    if sure is None or not sure.significant:
        return shown or (out if jump is None else [*drift, *filter(None, [sure])])
    best = _clearest(e, jumps(time))
    slow = (_clearest(e, {None: shape}) for shape in (ramp, *settles(time)))
    steady = max(filter(None, slow), key=lambda one: one.explained, default=None)
    if best is None or steady is None:
        return [jump or sure]
    left = max(best.explained / best.ratio**2, 1.0)
    if best.explained - steady.explained > ALIKE * left:
        return [jump or sure]
    if jump is None:  # scatter may be all there is
        return out
    return [] if counted else shown or [steady]


def _clearest(
    e: Judged, moments: Mapping[float | None, FloatArray], least: float = 0.0
) -> Drift | None:
    fit = e.fit
    n, d, _ = fit.at.jacobian.shape
    names = fit.model.layout.names
    J, columns = fit.at.jacobian[:, :, : len(names)], dict[float | None, FloatArray]()
    for when, moment in moments.items():
        columns[when] = np.zeros((len(fit.white.residuals), len(names)))
        columns[when][: n * d] = fit.covariance.whiten(J * moment[:, None, None])
    least = 1.0 if _counts(e) else least
    return find_drift(fit.white, names, columns, kinds=scattering(e), least=least)


def scattering(e: Judged) -> IntArray:
    """Return a number for each reading, the same for those that have one scatter, shape (n,)."""
    out = np.zeros(len(e.fit.at.residuals), int)
    numbers: dict[tuple[str, ...], int] = {}
    for kind, rows in e.fit.model.kinds.items():
        out[rows.any(axis=1)] = numbers.setdefault(e.found_in.get(kind, (kind,)), len(numbers))
    return out


def chi_square_json(parts: Mapping[str, Component]) -> dict[str, list[float]]:
    """Return sums of squares, their limits and degrees of freedom, for result.json."""
    return {
        kind: [c.chi_square, c.low, c.high, c.redundancy]
        for kind, c in parts.items()
        if c.redundancy >= 0.5
    }


def budget_json(
    fit: Fit,
    more: Mapping[str, tuple[FloatArray, str, str]],
    gain: FloatArray | None = None,
) -> dict[str, object]:
    """Return budget and what its rows rest on, for result.json.

    `more`: source -> variance, type and basis of what is added to the covariance afterwards, such
    as local gravity [SI^2]; `gain` (p, n d) or None: of another estimate from the same readings.
    """
    parts = mixed.budget(fit, gain)
    rest = {"prior": ["B", "prior as given in the campaign"]} | mixed.bases(fit)
    for name, (variance, kind, basis) in more.items():
        parts[name] = parts.get(name, 0.0) + variance
        rest[name] = [kind, basis]
    shown = {name: v.tolist() for name, v in parts.items() if v.any()}
    return {"budget": shown, "sources": {name: rest[name] for name in shown if name in rest}}
