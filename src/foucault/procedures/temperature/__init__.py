"""Coefficients as functions of temperature, from calibrations at several temperatures or a ramp.

It glues: what sessions and ramps say and which functions are fitted to it (`temperature.evidence`),
the fit and how many terms it needs (`estimate.temperature`), and whether to trust it
(`diagnose.temperature`). The result is like any other: its coefficients are those at a reference
temperature, the functions are beside them, and `Result.apply` uses the functions.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from foucault.diagnose import temperature as diagnose
from foucault.diagnose.comparable import KEY, as_kept
from foucault.errors import Finding, Status, error, finding
from foucault.models.imu import INVERSES
from foucault.models.temperature import TemperatureModel
from foucault.procedures.merged import logs_of
from foucault.procedures.temperature import evidence
from foucault.procedures.temperature.evidence import (
    Ramp,
    Session,
    Settings,
    Task,
    celsius,
    distinct,
    model_of,
    solved,
    task_of,
)
from foucault.result import Level, Result, TimeBase, Verdict, provenance
from foucault.tables import AXES

__all__ = ["NAME", "Ramp", "Session", "Settings", "calibrate"]

NAME = "temperature"

HARDLY = 0.9  # An uncertainty above this part of the prior's is the prior's own [1].

UNIFORM = 1.0 / 12.0
"""Variance of a temperature that is anywhere in a span, over the square of the span [1]."""

_UNSEEN = (
    "Errors that all sessions share, such as those of the table: they do not average out, and the "
    "covariance of the functions does not know them. That of a gravity given to all, it does.",
    "How the instrument behaves while its temperature changes quickly: sessions and ramps show it "
    "near equilibrium.",
)

_UNSEEN_ONCE = (
    "What drifts with time: no temperature was visited twice, and where one came after the other "
    "in order, a drift of the instrument is an effect of temperature here, with no residual. Visit "
    "one of the first temperatures again at the end.",
)

_UNSEEN_RAMP = (
    "A ramp in one position shows the sum of a bias and of scale factor error, misalignment and "
    "g-sensitivity times specific force: their changes with temperature are told apart by sessions "
    "alone. Where none tells, all of it is taken for bias.",
    "A ramp takes a tilt of the fixture for a bias of the accelerometers: 1 arcsec is 4.8 ug.",
    "A ramp shows how biases change, not what they are: their level is that of the sessions.",
)


def calibrate(
    sessions: Sequence[Session], settings: Settings | None = None, ramps: Sequence[Ramp] = ()
) -> Result:
    """Fit functions of temperature to calibrations.

    `sessions`: calibrations of one instrument, in the order they were made in, with `visited`;
    `ramps`: logs at rest while the temperature changes. Returns the coefficients at the reference
    temperature, and the functions.
    """
    begun = time.perf_counter()
    settings = settings or Settings()
    _one_instrument(sessions)
    # Refuse sessions that count a log twice: by itself, merged, or in a prior.
    logs = [logs_of(s.result) for s in sessions]
    for i, j in combinations(range(len(sessions)), 2):
        if logs[i] & logs[j]:
            raise error("temperature.same_log", one=sessions[i].name, other=sessions[j].name)
    alone, common = evidence.taken_out(sessions)
    task = task_of(alone, settings, ramps)
    choice = solved(task, settings)
    model = evidence.put_back(model_of(task, choice), common)
    turning = settings.visited or any((r.rising != r.rising[0]).any() for r in ramps)
    seen = diagnose.Seen(
        task.layout, task.families, task.family, task.unit, task.spaces, task.evidence, choice,
        tuple(s.name for s in sessions), np.array([s.temperature for s in sessions]),
        task.temperatures, task.template.reference, task.template.knots, turning,
    )  # fmt: skip
    checks = diagnose.checks(seen)
    first = sessions[0].result
    return Result(
        procedure=NAME,
        coefficients=model.at(model.reference),
        equation=max((s.result.equation for s in sessions), key=_size),
        frame=first.frame,
        gauge=first.gauge,
        verdict=Verdict.of(checks),
        checks=checks,
        findings=(*_findings(sessions, task, model, settings), *diagnose.findings(seen)),
        status=Status.CONVERGED,
        instrument=dict(first.instrument),
        site=dict(first.site),
        validity=_validity(sessions, model),
        diagnostics=_facts(sessions, ramps, settings)
        | diagnose.facts(seen, model)
        | {KEY: as_kept(common)},
        provenance=_provenance(sessions, time.perf_counter() - begun),
        tables=_tables(seen, model, ramps),
        temperature=model,
        clock=TimeBase.mean(s.result for s in sessions),
    )


def _one_instrument(sessions: Sequence[Session]) -> None:
    """Refuse sessions that cannot be of one instrument, or in the same axes."""
    if not sessions:
        raise error("temperature.no_results")
    first = sessions[0]
    for other in sessions[1:]:
        for key in ("serial", "name"):
            one, two = (str(s.result.instrument.get(key) or "").strip() for s in (first, other))
            if one and two:
                if one != two:
                    raise error("temperature.instruments", one=first.name, other=other.name,
                                first=one, second=two)  # fmt: skip
                break
        for what in ("frame", "gauge"):
            one, two = (str(getattr(s.result, what)) for s in (first, other))
            if one != two:
                raise error("temperature.unlike", what=what, one=first.name, other=other.name,
                            first=one, second=two)  # fmt: skip
        scales = [_scales(s.result) for s in (first, other)]
        if None not in scales and scales[0] != scales[1]:
            raise error("temperature.unlike", what="count scale", one=first.name, other=other.name,
                        first=scales[0], second=scales[1])  # fmt: skip


def _description(result: Result) -> Mapping[str, Any] | None:
    said = (result.provenance.get("input") or {}).get("description")
    return said if isinstance(said, Mapping) else None


def _scales(result: Result) -> str | None:
    """Return the count scales that a log was read with; None where nothing is known of it."""
    said = _description(result)
    if said is None:
        return None
    scales = {t: (said.get(t) or {}).get("scale") for t in ("accel", "gyro")}
    words = (f"{t} {s if isinstance(s, str) else ', '.join(s)}" for t, s in scales.items() if s)
    return "; ".join(words) or "none"


def _size(equation: str) -> int:
    """Rank the equations, from the plainest to that with all terms."""
    known = list(INVERSES)
    return known.index(equation) if equation in known else -1


def _findings(
    sessions: Sequence[Session], task: Task, model: TemperatureModel, settings: Settings
) -> tuple[Finding, ...]:
    out = []
    asked = settings.orders.get("", 0)
    # Lever arms and delay are constant at any number of temperatures: that is no lack of them.
    known = zip(task.families, task.spaces.nested, task.temperatures, strict=True)
    lower = [name for name, spaces, count in known
             if max(len(spaces), count) <= asked and name not in settings.orders]  # fmt: skip
    if lower and not settings.knots:
        out.append(finding("temperature.lower_order", given=asked, families=", ".join(lower)))
    doubtful = [s.name for s in sessions if s.result.verdict.level is Level.DOUBTFUL]
    if doubtful:
        out.append(finding("temperature.doubtful", names=", ".join(doubtful)))
    dead = [s.name for s in sessions if s.dead]
    if dead:
        out.append(finding("temperature.dead", names=", ".join(dead)))
    guided = {
        n for s in sessions
        for n, sd, prior in zip(s.vector.names, s.vector.sd, s.vector.prior_sd, strict=True)
        if sd > HARDLY * prior
    }  # fmt: skip
    if guided:
        out.append(finding("temperature.prior", names=", ".join(sorted(guided))))
    out += _wide(sessions, model)
    outside = [s.name for s in sessions if not model.low <= s.temperature <= model.high]
    if outside:
        out.append(finding("temperature.beyond_knots", names=", ".join(outside),
                           low=celsius(model.low), high=celsius(model.high)))  # fmt: skip
    return tuple(out)


def _wide(sessions: Sequence[Session], model: TemperatureModel) -> list[Finding]:
    """Tell of a session that warmed so much that the mean is not the value at the mean."""
    worst = (0.0, "", 0.0)
    for s in sessions:
        span = s.high - s.low
        step = max(span / 2, 1e-3)
        T = np.clip(np.array([s.temperature - step, s.temperature, s.temperature + step]),
                    model.low, model.high)  # fmt: skip
        bend = np.abs(np.diff(model.values(T), 2, axis=0)[0]) / step**2
        sd = model.sd(T)[1]
        off = 0.5 * bend * UNIFORM * span**2 / np.where(sd > 0, sd, np.inf)
        worst = max(worst, (float(off.max()), s.name, span))
    if worst[0] <= 1.0:
        return []
    return [finding("temperature.wide", name=worst[1], span=f"{worst[2]:.1f}",
                    size=f"{worst[0]:.1f}")]  # fmt: skip


def _validity(sessions: Sequence[Session], model: TemperatureModel) -> dict[str, Any]:
    """Return what all sessions covered, and the range of temperatures."""
    out: dict[str, Any] = {"temperature": [model.low, model.high]}
    for key in ("accel", "gyro"):
        spans = [s.result.validity.get(key) for s in sessions]
        if all(span and None not in span for span in spans):
            low, high = max(v[0] for v in spans if v), min(v[1] for v in spans if v)
            if low < high:
                out[key] = [low, high]
    return out


def _facts(
    sessions: Sequence[Session], ramps: Sequence[Ramp], settings: Settings
) -> dict[str, Any]:
    temperatures = np.array([s.temperature for s in sessions])
    return {
        "unseen": [
            *_UNSEEN,
            *(_UNSEEN_ONCE if distinct(temperatures) == len(sessions) else ()),
            *(_UNSEEN_RAMP if ramps else ()),
        ],
        "sessions": [
            {
                "name": s.name,
                "temperature": s.temperature,
                "range": [s.low, s.high],
                "procedure": s.result.procedure,
                "verdict": s.result.verdict.level.value,
                "created": s.result.provenance.get("created"),
            }
            for s in sessions
        ],
        "ramps": [{"name": r.name, "range": [r.low, r.high]} for r in ramps],
        "asked": {
            "orders": dict(settings.orders),
            "knots": list(settings.knots),
            "scatter": dict(settings.scatter),
            "margin": settings.margin,
            "visited": settings.visited,
        },
    }


def _provenance(sessions: Sequence[Session], seconds: float) -> dict[str, Any]:
    """Return where it all came from; how logs were read where all were read alike."""
    first = _description(sessions[0].result)
    read: dict[str, Any] = {} if first is None else {"description": dict(first)}
    made = provenance(read, seconds)
    keep = ("file", "sha256", "size")
    made["inputs"] = [
        {"session": s.name}
        | {k: v for k, v in (s.result.provenance.get("input") or {}).items() if k in keep}
        for s in sessions
    ]
    return made


def _tables(seen: diagnose.Seen, model: TemperatureModel, ramps: Sequence[Ramp]) -> dict[str, Any]:
    out: dict[str, Any] = {
        "temperature_points": diagnose.points(seen),
        "temperature_curves": diagnose.curves(model),
    }
    if ramps:
        parts = [
            (r.name, r.temperature, np.sqrt(r.variance.mean(axis=0)),
             tuple(f"{t}.bias.{a}" for t in r.triads for a in AXES))
            for r in ramps
        ]  # fmt: skip
        out["temperature_ramps"] = diagnose.ramp_points(seen, model, parts)
    return out
