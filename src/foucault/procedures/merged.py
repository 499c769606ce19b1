"""Results of one instrument made one: sessions merged, or an earlier result as prior of a new one.

Works for every procedure, because it works on results: see `estimate.fusion`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector, Prior
from foucault.diagnose import comparable
from foucault.diagnose.checks import check
from foucault.diagnose.left_out import LAYOUT_GROUPS
from foucault.errors import Finding, Status, error, finding
from foucault.estimate.fusion import Fused, Known, fused, with_sources
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models import cluster
from foucault.models.layouts import TIES, is_cluster
from foucault.result import Check, Level, Result, TimeBase, Verdict
from foucault.units import plain

Hashed = tuple[str, str, Result]
"""Name of a result for people, SHA-256 of its file, and the result."""


@dataclass(frozen=True)
class Earlier:
    """An earlier result of the instrument, as what is known before a session."""

    # label, sha256: what it is called, and the fingerprint of its file
    label: str
    sha256: str
    result: Result  # the result [SI]
    # by how much coefficients or groups may have changed since, one standard deviation [SI]
    growth: Mapping[str, float]
    inflate: float = 1.0  # factor of its standard deviations [1]

    def known(
        self, without: Iterable[str] = (), among: Iterable[str] | None = None, clock: str = ""
    ) -> Known:
        """Return what it says `among` some coefficients, less groups that are said otherwise.

        With the name of its `clock` in seconds, else in the time of its log.
        """
        whole = _measured(self.label, self.result)
        layout = whole.layout
        said = {int(i) for name in without if _in(layout.names, name) for i in layout.group(name)}
        kept = set(layout.names if among is None else among)
        vector = whole.chosen(n for i, n in enumerate(layout.names) if i not in said and n in kept)
        grown = np.zeros(len(vector))
        for name, sd in self.growth.items():
            if _in(vector.names, name) or not _in(layout.names, name):
                grown[vector.layout.group(name)] = sd  # unknown names raise with a suggestion
        assert vector.cov is not None
        cov = self.inflate**2 * vector.cov + np.diag(grown**2)
        return _known(self.result, replace(vector, cov=cov), clock)


def merged(results: Sequence[Hashed]) -> Result:
    """Merge results of one instrument whose logs are different.

    `results`: name, fingerprint and result, two or more, the first counts with its prior. Returns
    coefficients with the covariance of all data together, and how well they agree [SI]. Raises
    ``merge.*``: results that are not of one instrument, or not independent.
    """
    if len(results) < 2:
        raise error("merge.one", count=len(results))
    for k, (label, sha, result) in enumerate(results):
        for before in results[:k]:
            _fits(before, (label, sha, result))
    label, _, first = results[0]
    vector = _measured(label, first)
    every = [r for _, _, r in results]
    known = _known(first, vector, _clock_of(first, every))
    apart = _known(first, vector, _own_clock(first, label, every))
    checks, told, unlike = [], list[Finding](), set[str]()
    for label, _, result in results[1:]:
        vector = _measured(label, result)
        unlike |= _unlike(known.own.names, vector.names)
        # Whether two clocks of a kind are one nobody says: for the sum they are, else not.
        step = fused(apart, _known(result, vector, _own_clock(result, label, every)))
        checks.append(_agree(step, label, tests=len(results) - 1))
        apart = step.known
        known = fused(known, _known(result, vector, _clock_of(result, every))).known
    if unlike:
        told.append(finding("merge.only_some", names=", ".join(sorted(unlike))))
    checks += [_passed(label, result) for label, _, result in results]
    told += _shared_left_out([(label, result) for label, _, result in results])
    return _result(results, known, tuple(checks), tuple(told))


LEFT_OUT_MATTERS = 0.1
"""Share of a variance from which on it is told that results share a term [1]."""


def _shared_left_out(results: Sequence[tuple[str, Result]]) -> list[Finding]:
    """Say where results hold terms of one instrument that each counts as if they were its own."""
    counted = [(label, r) for label, r in results if "left_out" in r.diagnostics]
    large: list[set[str]] = []
    for _, result in counted:
        budget = result.diagnostics.get("budget") or {}
        total = np.maximum(result.coefficients.sd**2, 1e-300)
        large.append({
            g for g in result.diagnostics["left_out"]
            if g in LAYOUT_GROUPS and g in budget
            and float(np.max(np.asarray(budget[g]) / total)) > LEFT_OUT_MATTERS
        })  # fmt: skip
    shared = sorted({g for k, some in enumerate(large) for g in some if any(
        g in other.diagnostics["left_out"] for j, (_, other) in enumerate(counted) if j != k
    )})  # fmt: skip
    told = [finding("merge.left_out", names=", ".join(shared))] if shared else []
    without = [label for label, r in results if "left_out" not in r.diagnostics]
    if without and counted:
        told.append(finding("merge.left_out_only_some", labels=", ".join(without)))
    return told


def with_prior(result: Result, earlier: Earlier, own: Prior) -> Result:
    """Return the result of a session, an earlier one of the same instrument taken into account.

    `result`: of the session [SI]; `own`: prior that was given beside it, for coefficients or
    groups: it takes its place [SI].
    """
    _fits((earlier.label, earlier.sha256, earlier.result), ("the log", "", result))
    vector = result.coefficients
    before = earlier.known(without=own).own.names
    names, alone = _common(earlier, before, vector)
    left = [n for n in before if n not in names]
    told: tuple[Finding, ...] = ()
    if left:
        told = (finding("prior.left", label=earlier.label, names=", ".join(left)),)
    both = (result, earlier.result)
    step = fused(earlier.known(own, names, _clock_of(earlier.result, both)),
                 _known(result, alone, _clock_of(result, both)))  # fmt: skip
    clocks = _own_clock(earlier.result, earlier.label, both), _own_clock(result, "the log", both)
    apart = fused(earlier.known(own, names, clocks[0]), _known(result, alone, clocks[1]))
    agreement = _agree(apart, earlier.label, tests=1)
    kept = replace(result, coefficients=_over(vector, step.known.own), clock=TimeBase.mean(both))
    told += tuple(_shared_left_out([(earlier.label, earlier.result), ("the log", result)]))
    reasons = result.verdict.reasons + (() if agreement.passed else (agreement.sentence,))
    level = result.verdict.level
    if not agreement.passed and level is Level.PASS:
        level = Level.DOUBTFUL
    used = {"from": earlier.label, "sha256": earlier.sha256, "given": _given(step.known),
            "inputs": [*_inputs(earlier.result), *_before(earlier.result)]}  # fmt: skip
    rows = {n: [float(v), float(s)] for n, v, s in zip(vector.names, vector.values, vector.sd,
                                                        strict=True)}  # fmt: skip
    # Budget and bound are those of the session alone: they explain another covariance.
    alone_no_more = {k: v for k, v in result.diagnostics.items() if k not in ("budget", "bound")}
    return replace(
        kept, checks=(*result.checks, agreement), verdict=Verdict(level, reasons),
        findings=(*result.findings, *told),
        diagnostics=alone_no_more | {"without_earlier": rows} | _owed(step.known),
        provenance=result.provenance | {"prior": used},
    )  # fmt: skip


def foreseen_with_prior(
    vector: CoefficientVector, earlier: Earlier, own: Prior
) -> CoefficientVector:
    """Return what a session will know, an earlier result of the instrument taken into account.

    `vector`: what it is foreseen to know, with the priors it was lent [SI]; `own`: prior that is
    given beside it: it takes its place [SI].
    """
    before = earlier.known(without=own).own
    names, alone = _common(earlier, before.names, vector)
    lent = dict(zip(alone.names, alone.values.tolist(), strict=True))
    step = fused(Known(before.chosen(names)), Known(alone, lent))
    out = _over(vector, step.known.own)
    prior = vector.prior_sd.copy()
    prior[[vector.layout.index(name) for name in names]] = before.chosen(names).sd
    return replace(out, values=vector.values, prior_sd=prior)


def _common(
    earlier: Earlier, before: Sequence[str], vector: CoefficientVector
) -> tuple[list[str], CoefficientVector]:
    """Return what an earlier result and a session both know, and all that the session knows."""
    names = [n for n in before if n in vector.layout and vector.free[vector.layout.index(n)]]
    if not names:
        raise error("merge.nothing", one=earlier.label, other="this procedure")
    sure = np.isfinite(vector.sd) & (vector.sd > 0)
    return names, vector.chosen(n for n, s in zip(vector.names, sure, strict=True) if s)


def means_of(result: Result) -> dict[str, float]:
    """Return the means of the priors that were given to a result, by coefficient [SI]."""
    given = (result.provenance.get("prior") or {}).get("given") or {}
    names = result.coefficients.names
    return {
        name: float(mean)
        for key, (mean, _) in given.items()
        for name in names
        if name == key or name.startswith(f"{key}.")
    }


# -- what can be merged ------------------------------------------------------------------------


def _fits(one: Hashed, other: Hashed) -> None:
    """Refuse two results that are not of one instrument, or not independent."""
    (a, sha_a, first), (b, sha_b, second) = one, other
    for key, word in (("serial", "serial number"), ("name", "name")):
        mine, theirs = (str(r.instrument.get(key) or "").strip() for r in (first, second))
        if mine and theirs and mine == theirs:
            break  # the same serial number: its name may be spelled otherwise
        if mine and theirs:
            raise error("merge.instrument", one=a, other=b, what=word, first=mine, second=theirs)
    if is_cluster(first.coefficients) != is_cluster(second.coefficients):
        raise error("merge.models", one=a, other=b)
    if first.gauge != second.gauge:
        raise error("merge.gauge", one=a, other=b, first=first.gauge, second=second.gauge)
    for late, early, sha in ((other, a, sha_a), (one, b, sha_b)):
        if sha and sha in _texts(late[2].provenance.get("prior") or {}):
            raise error("merge.took_prior", late=late[0], early=early)
    if (sha_a and sha_a == sha_b) or logs_of(first) & logs_of(second):
        raise error("merge.same_log", one=a, other=b)


def _inputs(result: Result) -> list[dict[str, Any]]:
    made = result.provenance
    own = [made["input"]] if made.get("input") else []
    return [dict(one) for one in (*made.get("inputs", []), *own)]


def _before(result: Result) -> list[dict[str, Any]]:
    """Return the logs that went into the prior of a result, and into the prior of that."""
    return [dict(one) for one in (result.provenance.get("prior") or {}).get("inputs") or ()]


def logs_of(result: Result) -> set[str]:
    """Return the fingerprints of every log in a result, those of its prior too."""
    prints = [one.get("sha256") for one in (*_inputs(result), *_before(result))]
    return {part for text in prints if text for part in str(text).split(" + ")}


def _texts(value: Any) -> set[str]:
    return {str(v) for v in value.values() if isinstance(v, str)}


def _measured(label: str, result: Result) -> CoefficientVector:
    """Return the coefficients of the instrument that a result knows, with what it knows of them."""
    vector = result.coefficients
    if result.status not in (Status.CONVERGED,) or result.verdict.level is Level.UNUSABLE:
        raise error("merge.unusable", label=label, level=result.verdict.level.value,
                    status=result.status.value)  # fmt: skip
    sure = np.isfinite(vector.values) & np.isfinite(vector.sd) & (vector.sd > 0) & vector.free
    names = [
        name
        for name, good in zip(vector.names, sure, strict=True)
        if good and name not in TIES and name not in cluster.ATTITUDE
    ]
    if getattr(result, "temperature", None) is not None:
        raise error("merge.temperature", label=label)
    if not names:
        raise error("merge.nothing", one=label, other="the model")
    return vector.chosen(names)


def _in(names: Sequence[str], key: str) -> bool:
    return any(name == key or name.startswith(f"{key}.") for name in names)


def _unlike(one: Sequence[str], other: Sequence[str]) -> set[str]:
    """Return coefficients that only one has, of triads that both have."""
    triads = {n.partition(".")[0] for n in one} & {n.partition(".")[0] for n in other}
    return {n for n in set(one) ^ set(other) if n.partition(".")[0] in triads}


def _known(result: Result, vector: CoefficientVector, clock: str = "") -> Known:
    """Return what a result says of the coefficients `vector`, and what it owes to which gravity.

    With the name of a `clock` it is said in seconds, and owes the error of that clock too.
    """
    whole = result.coefficients
    at = [whole.layout.index(name) for name in vector.names]
    errors: dict[Any, FloatArray] = dict(comparable.gravity_errors(result, whole))
    owed = {site: error[at] for site, error in errors.items() if error[at].any()}
    base = result.clock
    if clock and base is not None and (error := base.of(vector.names)).any():
        assert vector.cov is not None
        vector = replace(vector, cov=vector.cov + np.outer(error, error))
        owed[(CLOCK, clock)] = error
    return with_sources(Known(vector, means_of(result)), owed)


CLOCK = "clock of the log"
"""Begins the source of an error that is a clock's, where that of gravity begins with a number."""


def _clock_of(result: Result, others: Sequence[Result]) -> str:
    """Return the name of the clock of a result; none where all have one, and so one time."""
    kinds = {(r.clock.source, r.clock.sd) for r in (result, *others) if r.clock is not None}
    base = result.clock
    return "" if base is None or len(kinds) < 2 else f"{base.source} {base.sd!r}"


def _own_clock(result: Result, label: str, others: Sequence[Result]) -> str:
    """Return the name of the clock of a result where no two loggers have one.

    The oscillator of a sensor goes with it, and what changes in it is a change of the instrument.
    """
    sources = {r.clock.source for r in others if r.clock is not None}
    if sources <= {"sensor"} or result.clock is None:
        return ""
    return "sensor" if result.clock.source == "sensor" else label


def _given(known: Known) -> dict[str, list[float]]:
    """Return mean and sd of the priors that count in what is known [SI]."""
    own = known.own
    rows = zip(own.names, own.prior_sd.tolist(), strict=True)
    return {n: [known.means.get(n, 0.0), sd] for n, sd in rows if np.isfinite(sd)}


def _owed(known: Known) -> dict[str, Any]:
    """Return the diagnostics that say what coefficients owe to which gravity."""
    names = known.own.names
    errors: Iterable[tuple[Any, FloatArray]] = known.shared(names).items()
    errors = [(site, error) for site, error in errors if site[0] != CLOCK]
    return {comparable.KEY: comparable.as_kept({
        site: dict(zip(names, error.tolist(), strict=True)) for site, error in errors
    })}  # fmt: skip


# -- what comes out ----------------------------------------------------------------------------


def _agree(step: Fused, label: str, tests: int) -> Check:
    """Return the test that a result agrees with those before."""
    name = f"agreement of {label}"
    if not step.dof:
        return check("nothing in common", name, 0.0, given={"label": label})
    _, high = chi_square_limits(step.dof, 0.02, tests)  # 1 % on the side that matters
    farthest = ""
    if np.isfinite(step.change).any():
        worst = int(np.nanargmax(np.abs(step.change)))
        farthest = (f" Farthest: {step.known.vector.names[worst]}, {step.change[worst]:+.1f} "
                    "standard deviations.")  # fmt: skip
    given = {
        "label": label, "square": plain(step.chi_square, 4), "dof": step.dof, "farthest": farthest,
    }  # fmt: skip
    return check("agreement", name, step.chi_square, None, high, given)


def _passed(label: str, result: Result) -> Check:
    level, why = result.verdict.level, "".join(f" {one}" for one in result.verdict.reasons[:1])
    given = {"label": label, "level": level, "reason": why}
    return check("own verdict", f"verdict of {label}", np.nan, given=given,
                 passed=level is Level.PASS)  # fmt: skip


def _over(vector: CoefficientVector, better: CoefficientVector) -> CoefficientVector:
    """Return `vector` with what is better known of its coefficients in place."""
    assert vector.cov is not None
    at = [vector.layout.index(name) for name in better.names]
    values, cov, prior = vector.values.copy(), vector.cov.copy(), vector.prior_sd.copy()
    values[at], cov[np.ix_(at, at)], prior[at] = better.values, better.cov, better.prior_sd
    return replace(vector, values=values, cov=cov, prior_sd=prior)


def _result(
    results: Sequence[Hashed], known: Known, checks: tuple[Check, ...], told: tuple[Finding, ...]
) -> Result:
    first = results[0][2]
    every = [r for _, _, r in results]
    procedures = list(dict.fromkeys(r.procedure for r in every))
    same_site = all(r.site == first.site for r in every)
    return Result(
        procedure=" + ".join(procedures),
        coefficients=known.own,
        equation=first.equation,
        frame=first.frame,
        gauge=first.gauge,
        verdict=Verdict.of(checks),
        checks=checks,
        findings=told,
        status=Status.CONVERGED,
        instrument=next((dict(r.instrument) for r in every if r.instrument.get("serial")),
                        dict(first.instrument)),
        site=dict(first.site) if same_site else {},
        validity=_validity(every),
        diagnostics={"merged": [
            {"label": label, "sha256": sha, "procedure": r.procedure,
             "verdict": r.verdict.level.value}
            for label, sha, r in results
        ]} | _owed(known),
        provenance={
            "versions": first.provenance.get("versions") or {},
            "created": max(str(r.provenance.get("created") or "") for r in every) or None,
            "inputs": [one for r in every for one in _inputs(r)],
            "prior": {
                "given": _given(known),
                "inputs": [one for r in every for one in _before(r)],
            },
        },
        tables={"merged": _table(results, known.own)},
        clock=TimeBase.mean(every),
    )  # fmt: skip


def _table(results: Sequence[Hashed], own: CoefficientVector) -> dict[str, Any]:
    """Return one row per coefficient and result, the merged one last."""
    rows = [
        (name, label, vector.value(name), float(vector.chosen([name]).sd[0]))
        for name in own.names
        for label, vector in (*((label, r.coefficients) for label, _, r in results),
                              ("merged", own))
        if name in vector.layout
    ]  # fmt: skip
    keys = ("coefficient", "result", "value", "sd")
    return {key: np.array([row[k] for row in rows]) for k, key in enumerate(keys)}


def _validity(results: Sequence[Result]) -> dict[str, Any]:
    """Return the ranges that any of the sessions covered."""
    out: dict[str, Any] = {}
    for key in ("accel", "gyro", "temperature"):
        ranges = [r.validity[key] for r in results if r.validity.get(key)
                  and None not in r.validity[key]]  # fmt: skip
        if ranges:
            out[key] = [min(r[0] for r in ranges), max(r[1] for r in ranges)]
    sampled = {r.validity.get("sampled") for r in results}
    return out | ({"sampled": sampled.pop()} if len(sampled) == 1 else {})
