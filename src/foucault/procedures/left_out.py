"""What a procedure adds to have what it does not estimate in its uncertainties.

A procedure says `Again`: the true motion of what it was made of, and its residuals, at the
stretches that were found, with something put into them. Nothing is detected again and no reading is
left out, so that the difference of two calls is what one size of a term does to the readings.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.foresight import Extra
from foucault.infer import left_out, mixed
from foucault.infer.filtered import exchanged
from foucault.infer.left_out import Columns, Judgement, With
from foucault.infer.left_out_states import Group, Posterior, widened
from foucault.infer.mixed import Fit, Model, Source
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.left_out import (
    GRAVITY,
    NONE,
    Change,
    Motion,
    Sizes,
    Term,
    changes,
    in_words,
    of_imu,
    table,
    terms,
    told,
)
from foucault.models.noise import ImuNoise, SessionNoise, wander


@dataclass(frozen=True)
class Again:
    """A session reduced again."""

    # State -> the instrument, and the true motion of its samples. Where the accelerometers are not
    # calibrated the motion is that of the geometry: their biases would look like gravity.
    motion: Callable[[Any], tuple[ImuModel, Motion]]
    residuals: Callable[[Any, Change], FloatArray]  # state, what is put into it -> (n, d) [SI]
    white: tuple[float, float] = (np.nan, np.nan)  # noise of both triads, NaN where unknown [SI]
    # wander: sd of the drift of both biases over the session that the noise has already [SI]
    wander: tuple[float, float] = (0.0, 0.0)


def changed(site: Site, by: Change) -> Site:
    """Return another place."""
    latitude = None if site.latitude is None else site.latitude + by.latitude
    return replace(site, gravity=site.gravity + by.gravity, latitude=latitude)


def fit(
    model: Model,
    prior: CoefficientVector | None,
    sizes: Sizes | None,
    site: Site,
    again: Again,
    **how: Any,
) -> tuple[Fit, Judgement | None]:
    """Fit as `mixed.fit` does, with what is left out where sizes of it are declared.

    `prior` or None: what is known of the coefficients [SI]; `how`: of `mixed.fit`.
    """
    sizes = whole(sizes, site, again.white, again.wander)
    if sizes is None:
        return mixed.fit(model, prior, **how), None
    names = model.layout.names
    found, judged = left_out.fit(model, columns(names, site, sizes, again), prior, **how)
    return found, told_of(judged, names, site, sizes)


def told_of(judged: Judgement, names: tuple[str, ...], site: Site, sizes: Sizes) -> Judgement:
    """Return a judgement with its sizes [SI], and with the worst term of each group by its name.

    `names`: of the coefficients that are estimated.
    """
    members: dict[str, list[str]] = {}
    for term in terms(names, site, sizes):
        members.setdefault(term.group, []).append(term.name)
    worst = {
        g: (members[g][far[0]], far[1])
        for g in judged.groups
        if g in judged.seen and (far := left_out.farthest(judged.seen[g])) is not None
    }
    return replace(judged, sizes={g: sizes[g] for g in judged.groups}, worst=worst)


def planned(
    model: Model,
    prior: CoefficientVector | None,
    sizes: Sizes | None,
    site: Site,
    again: Again,
    sds: Mapping[str, float],
) -> tuple[Fit, Judgement | None]:
    """Return what a planned session will make of it; arguments as of `fit`.

    `sds`: source -> size of those to be found [SI].
    """
    sizes = whole(sizes, site, again.white, again.wander)
    if sizes is None:
        return mixed.planned(model, sds, prior), None
    made = columns(model.layout.names, site, sizes, again)
    found, judged = left_out.planned(model, made, prior, sds)
    return found, replace(judged, sizes={g: sizes[g] for g in judged.groups})


WORTH = 0.1
"""Share of a variance from which on it is said what another size of a group would buy [1]."""

BETTER = 10.0  # So many times as small is the size that is declared then [1].


def declared(
    at: Fit, judged: Judgement | None, prior: CoefficientVector | None, sds: Mapping[str, float]
) -> tuple[Extra, ...]:
    """Return what it would buy to know a size better, the largest of them, at no time of the plan.

    `at`, `judged`: as `planned` returned them; `sds`: as it was given them [SI].
    """
    model = at.model
    if judged is None or not isinstance(model, With):
        return ()

    def known(group: str) -> FloatArray:
        less = replace(model, sizes={group: 1 / BETTER})
        return mixed.planned(less, sds, prior).estimate.coefficients.sd

    return _bought(judged, model.layout.names, at.estimate.coefficients.sd, known)


def declared_states(
    at: Posterior, groups: Mapping[str, Group], judged: Judgement, reported: tuple[str, ...]
) -> tuple[Extra, ...]:
    """Return the same of a filter: `at` what it leaves, `judged` of it as `groups` are states."""

    def known(group: str) -> FloatArray:
        less = widened(at.states, groups, {group: 1 / BETTER})
        used = at.mean, at.states.prior_sd
        return exchanged(at.states, used, replace(less, values=at.mean)).chosen(reported).sd

    return _bought(judged, reported, at.states.chosen(reported).sd, known)


def _bought(
    judged: Judgement, names: tuple[str, ...], sd: FloatArray, known: Callable[[str], FloatArray]
) -> tuple[Extra, ...]:
    """Return what it buys to know the largest groups better; `known`: group -> sd then [SI]."""
    large = {g: s for g in judged.groups if (s := judged.share.get(g, 0.0)) > WORTH}
    out = []
    for group in sorted(large, key=lambda g: -large[g])[:3]:
        size = in_words(group, judged.sizes[group][0] / BETTER)
        what = f"{table().groups[group].what} known to {size}"
        out.append(Extra.of(what, 0.0, names, known(group) / sd))
    return tuple(out)


def whole(
    sizes: Sizes | None, site: Site, white: tuple[float, float], wander: tuple[float, float]
) -> Sizes | None:
    """Return sizes as the noise tells them, and that of local gravity, which `site` gives.

    `white`, `wander`: as of `Again` [SI].
    """
    sizes = None if sizes is None else told(sizes, *white)
    if sizes is None:
        return None
    gravity = site.gravity_sd, "standard uncertainty of local gravity"
    return less_wander(sizes, wander) | {GRAVITY: gravity}


def less_wander(sizes: Sizes, wanders: tuple[float, float]) -> dict[str, tuple[float, str]]:
    """Return sizes without what noise has of the drift of both biases: the larger of both counts.

    `wanders`: sd of that drift, see `wander_of` [SI].
    """
    out = dict(sizes)
    for triad, sd in zip(("accel", "gyro"), wanders, strict=True):
        size, basis = out.get(group := f"{triad}.bias drift", (0.0, ""))
        if size and sd:
            left = float(np.sqrt(max(size**2 - sd**2, 0.0)))
            out[group] = left, f"{basis}; less what [noise] has of it"
    return out


def told_beside(sizes: Sizes | None, noise: ImuNoise, span: float) -> Sizes | None:
    """Return sizes of an IMU as `noise` [SI] tells them, less its drifts over a `span` [s]."""
    sizes = None if sizes is None else told(sizes, noise.accel.white, noise.gyro.white)
    return None if sizes is None else less_wander(of_imu(sizes), wander_of(noise, span))


def wander_of(slow: ImuNoise | None, span: float) -> tuple[float, float]:
    """Return the sd of the change of both biases over a `span` [s] that declared noise makes [SI].

    `slow` or None: bias instability and random walk [SI].
    """
    if slow is None:
        return 0.0, 0.0
    ends, moment = np.array([0.0, span]), np.full(2, 1e-3 * span)
    found = [wander(triad, ends, moment) for triad in (slow.accel, slow.gyro)]
    sds = [float(np.sqrt(max(C[0, 0] + C[1, 1] - 2 * C[0, 1], 0.0))) for C in found]
    return sds[0], sds[1]


def white_of(noise: SessionNoise) -> tuple[float, float]:
    """Return the white noise of both triads of a session [SI]."""
    pairs = (noise.accel_psd, noise.slow.accel), (noise.gyro_psd, noise.slow.gyro)
    found = [max(float(np.sqrt(psd.mean())), triad.white) for psd, triad in pairs]
    return found[0], found[1]


def _groups(names: tuple[str, ...], site: Site, sizes: Sizes) -> list[tuple[str, list[Term]]]:
    return [(g, [*some]) for g, some in groupby(terms(names, site, sizes), lambda t: t.group)]


def likeliest(at: Fit, judged: Judgement, site: Site, again: Again) -> Change:
    """Return what all terms of an instrument together add to its readings, as they were found."""
    model, motion = again.motion(at.state)
    seen, sources = left_out.tested(at), {s.name: s for s in at.at.sources}
    accel, gyro = np.zeros_like(motion.f_b), np.zeros_like(motion.w_ib_b)
    for group, some in _groups(at.model.layout.names, site, judged.sizes):
        if group not in seen:
            continue
        times = mixed.size_of(sources[group], at.sds) * seen[group].u
        for k, by in zip(times, changes(some, model, motion), strict=True):
            accel += k * (0.0 if by.accel is None else by.accel)
            gyro += k * (0.0 if by.gyro is None else by.gyro)
    return Change(accel, gyro)


def columns(names: tuple[str, ...], site: Site, sizes: Sizes, again: Again) -> Columns:
    """Return what makes a source of every group that `names` leave out, at a state."""
    groups = _groups(names, site, sizes)

    def at(state: Any) -> tuple[Source, ...]:
        model, motion = again.motion(state)
        zero, out = again.residuals(state, NONE), []
        for group, some in groups:
            made = [again.residuals(state, by) - zero for by in changes(some, model, motion)]
            size, basis = sizes[group]
            words = f"left out, {in_words(group, size)}: {basis}"
            out.append(Source(group, shared=np.stack(made, axis=2), basis=words))
        return tuple(out)

    return at
