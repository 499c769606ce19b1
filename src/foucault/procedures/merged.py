"""Results of one instrument made one: sessions merged, or an earlier result as prior of a new one.

Works for every procedure, because it works on results: see `estimate.fusion`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.coefficients import CoefficientVector
from foucault.diagnose.compare.comparable import gravity_site
from foucault.errors import Finding, Status, error, finding
from foucault.estimate.chi_square import chi_square_limits
from foucault.estimate.fusion import Fused, Known, fused
from foucault.models import cluster
from foucault.models.layouts import BESIDE, is_cluster
from foucault.models.references import gravity_slope
from foucault.result import Check, Level, Result, Verdict
from foucault.units import plain

FloatArray = npt.NDArray[np.float64]
Hashed = tuple[str, str, Result]
"""Name of a result for people, SHA-256 of its file, and the result."""


@dataclass(frozen=True)
class Earlier:
    """An earlier result of the instrument, as what is known before a session.

    Attributes
    ----------
    label, sha256 : str
        What it is called, and the fingerprint of its file.
    result : Result
        The result [SI].
    growth : mapping of str to float
        By how much coefficients or groups may have changed since, one standard deviation [SI].
    inflate : float
        Factor of its standard deviations [1].
    """

    label: str
    sha256: str
    result: Result
    growth: Mapping[str, float]
    inflate: float = 1.0

    def known(self, without: Iterable[str] = ()) -> Known:
        """Return what it says, less what is said otherwise about coefficients or groups."""
        whole = _measured(self.label, self.result)
        layout = whole.layout
        said = {int(i) for name in without if _in(layout.names, name) for i in layout.group(name)}
        vector = whole.chosen(n for i, n in enumerate(layout.names) if i not in said)
        grown = np.zeros(len(vector))
        for name, sd in self.growth.items():
            grown[vector.layout.group(name)] = sd  # unknown names raise with a suggestion
        assert vector.cov is not None
        cov = self.inflate**2 * vector.cov + np.diag(grown**2)
        return Known(replace(vector, cov=cov), means_of(self.result))

    def beside(self, result: Result, names: Sequence[str]) -> FloatArray | None:
        """Return the error of `names`, shape (n,) [SI], that both owe to the same gravity."""
        vector = self.result.coefficients.chosen(names)
        shared = _gravity(self.result, vector, (self.result, result))
        return None if shared is None else self.inflate * shared


def merged(results: Sequence[Hashed]) -> Result:
    """Merge results of one instrument whose logs are different.

    Parameters
    ----------
    results : sequence of (str, str, Result)
        Name, fingerprint and result, two or more; the first counts with its prior.

    Returns
    -------
    Result
        Coefficients with the covariance of all data together, and how well they agree [SI].

    Raises
    ------
    FoucaultError
        ``merge.*``: results that are not of one instrument, or not independent.
    """
    if len(results) < 2:
        raise error("merge.one", count=len(results))
    for k, (label, sha, result) in enumerate(results):
        for before in results[:k]:
            _fits(before, (label, sha, result))
    label, _, first = results[0]
    every = [r[2] for r in results]
    vector = _measured(label, first)
    known = Known(vector, means_of(first), _gravity(first, vector, every))
    checks, told, unlike = [], list[Finding](), set[str]()
    for label, _, result in results[1:]:
        vector = _measured(label, result)
        shared = _gravity(result, vector, every)
        unlike |= _unlike(known.vector.names, vector.names)
        step = fused(known, Known(vector, means_of(result), shared))
        checks.append(_agree(step, label, tests=len(results) - 1))
        known = step.known
    if unlike:
        told.append(finding("merge.only_some", names=", ".join(sorted(unlike))))
    checks += [_passed(label, result) for label, _, result in results]
    return _result(results, known, tuple(checks), tuple(told))


def with_prior(result: Result, earlier: Earlier, own: Mapping[str, tuple[float, float]]) -> Result:
    """Return the result of a session, an earlier one of the same instrument taken into account.

    Parameters
    ----------
    result : Result
        Of the session [SI].
    earlier : Earlier
        The earlier one.
    own : mapping of str to (float, float)
        Prior that was given beside it, for coefficients or groups: it takes its place [SI].
    """
    _fits((earlier.label, earlier.sha256, earlier.result), ("the log", "", result))
    before = earlier.known(without=own)
    vector = result.coefficients
    names = [
        n for n in before.vector.names if n in vector.layout and vector.free[vector.layout.index(n)]
    ]
    if not names:
        raise error("merge.nothing", one=earlier.label, other="this procedure")
    left = [n for n in before.vector.names if n not in names]
    told = (finding("prior.left", label=earlier.label, names=", ".join(left)),) if left else ()
    shared = earlier.beside(result, names)
    before = Known(before.vector.chosen(names), before.means, shared)
    sure = np.isfinite(vector.sd) & (vector.sd > 0)
    alone = vector.chosen(n for n, s in zip(vector.names, sure, strict=True) if s)
    same = None if shared is None else _gravity(result, alone, (earlier.result, result))
    step = fused(before, Known(alone, means_of(result), same))
    check = _agree(step, earlier.label, tests=1)
    kept = replace(result, coefficients=_over(vector, step.known.vector))
    reasons = result.verdict.reasons + (() if check.passed else (check.sentence,))
    level = result.verdict.level
    if not check.passed and level is Level.PASS:
        level = Level.DOUBTFUL
    said = result.provenance.get("prior") or {}
    used = said | {"from": earlier.label, "sha256": earlier.sha256,
                   "inputs": _inputs(earlier.result)}  # fmt: skip
    rows = {n: [float(v), float(s)] for n, v, s in zip(vector.names, vector.values, vector.sd,
                                                        strict=True)}  # fmt: skip
    return replace(
        kept, checks=(*result.checks, check), verdict=Verdict(level, reasons),
        findings=(*result.findings, *told),
        diagnostics=result.diagnostics | {"without_earlier": rows},
        provenance=result.provenance | {"prior": used},
    )  # fmt: skip


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
    if (sha_a and sha_a == sha_b) or _logs(first) & _logs(second):
        raise error("merge.same_log", one=a, other=b)


def _inputs(result: Result) -> list[dict[str, Any]]:
    made = result.provenance
    own = [made["input"]] if made.get("input") else []
    return [dict(one) for one in (*made.get("inputs", []), *own)]


def _logs(result: Result) -> set[str]:
    """Return the fingerprints of every log in a result, those of its prior too."""
    before = (result.provenance.get("prior") or {}).get("inputs") or []
    prints = [one.get("sha256") for one in (*_inputs(result), *before)]
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
        if good and name not in BESIDE and name not in cluster.ATTITUDE
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


def _gravity(
    result: Result, vector: CoefficientVector, among: Sequence[Result]
) -> FloatArray | None:
    """Return the error that local gravity makes, where another result was given the same."""
    site = gravity_site(result)
    if site is None or sum(gravity_site(other) == site for other in among) < 2:
        return None
    return np.asarray(gravity_slope(vector) * (site[1] / site[0]))


# -- what comes out ----------------------------------------------------------------------------


def _agree(step: Fused, label: str, tests: int) -> Check:
    """Return the test that a result agrees with those before."""
    if not step.dof:
        words = f"{label}: no coefficient in common with the others, so nothing to compare."
        return Check(f"agreement of {label}", 0.0, None, None, True, words)
    _, high = chi_square_limits(step.dof, 0.02, tests)  # 1 % on the side that matters
    passed = step.chi_square <= high
    words = (
        f"{label}: chi-square of the differences {plain(step.chi_square, 4)} of {step.dof} "
        f"degrees of freedom, at most {high:.1f} if nothing has changed."
    )
    if np.isfinite(step.change).any():
        worst = int(np.nanargmax(np.abs(step.change)))
        name = step.known.vector.names[worst]
        words += f" Farthest: {name}, {step.change[worst]:+.1f} standard deviations."
    if not passed:
        words += " The instrument changed, or an uncertainty is too small."
    return Check(f"agreement of {label}", step.chi_square, None, high, passed, words)


def _passed(label: str, result: Result) -> Check:
    level = result.verdict.level
    words = f"{label}: its own verdict is {level}."
    if result.verdict.reasons:
        words += f" {result.verdict.reasons[0]}"
    return Check(f"verdict of {label}", float("nan"), None, None, level is Level.PASS, words)


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
    priors = [r.provenance.get("prior") or {} for r in every]
    given = {k: v for one in reversed(priors) for k, v in (one.get("given") or {}).items()}
    return Result(
        procedure=" + ".join(procedures),
        coefficients=known.vector,
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
        ]},
        provenance={
            "versions": first.provenance.get("versions") or {},
            "created": max(str(r.provenance.get("created") or "") for r in every) or None,
            "inputs": [one for r in every for one in _inputs(r)],
            "prior": {
                "given": given,
                "inputs": [i for one in priors for i in one.get("inputs") or ()],
            },
        },
        tables={"merged": _table(results, known)},
    )  # fmt: skip


def _table(results: Sequence[Hashed], known: Known) -> dict[str, Any]:
    """Return one row per coefficient and result, the merged one last."""
    rows = [
        (name, label, vector.value(name), float(vector.chosen([name]).sd[0]))
        for name in known.vector.names
        for label, vector in (*((label, r.coefficients) for label, _, r in results),
                              ("merged", known.vector))
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
