"""What a procedure adds to have what it does not estimate in its uncertainties.

A procedure says `Again`: the true motion of what it was made of, and its residuals, at the
stretches that were found, with something put into them. Nothing is detected again and no reading is
left out, so that the difference of two calls is what one size of a term does to the readings.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.infer import left_out, mixed
from foucault.infer.left_out import Columns, Judgement
from foucault.infer.mixed import Fit, Model, Source
from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.left_out import GRAVITY, NONE, Change, Motion, Sizes, changes, in_words, terms


@dataclass(frozen=True)
class Again:
    """A session reduced again."""

    # State -> the instrument, and the true motion of its samples. Where the accelerometers are not
    # calibrated the motion is that of the geometry: their biases would look like gravity.
    motion: Callable[[Any], tuple[ImuModel, Motion]]
    residuals: Callable[[Any, Change], FloatArray]  # state, what is put into it -> (n, d) [SI]


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

    `prior` or None: what is known of the coefficients [SI]; `sizes` or None: of what is not
    estimated [SI]; `how`: of `mixed.fit`.
    """
    if sizes is None:
        return mixed.fit(model, prior, **how), None
    of_site = {GRAVITY: (site.gravity_sd, "standard uncertainty of local gravity")}
    sizes = dict(sizes) | of_site
    found, judged = left_out.fit(
        model, columns(model.layout.names, site, sizes, again), prior, **how
    )
    return found, replace(judged, sizes={g: sizes[g] for g in judged.groups})


def columns(names: tuple[str, ...], site: Site, sizes: Sizes, again: Again) -> Columns:
    """Return what makes a source of every group that `names` leave out, at a state."""
    groups = [(g, [*some]) for g, some in groupby(terms(names, site, sizes), lambda t: t.group)]

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
