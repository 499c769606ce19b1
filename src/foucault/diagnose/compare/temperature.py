"""Results over temperature taken at one, that they may be compared.

A result whose coefficients are functions of temperature is compared at the mean temperature of the
results that are not, or at the mean of their references where all are. How far a coefficient is
from its function at each measurement belongs to what the function does not say of the instrument.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from foucault.diagnose.compare.comparable import Entry
from foucault.errors import Finding, finding
from foucault.units import ZERO_CELSIUS


def at_one_temperature(entries: Sequence[Entry]) -> tuple[list[Entry], list[Finding]]:
    """Return the results with coefficients that do not change with temperature.

    `entries`: the results, one whose functions do not reach the common temperature is refused
    [SI].
    """
    models = [getattr(e.result, "temperature", None) for e in entries]
    over = [(e, m) for e, m in zip(entries, models, strict=True) if m is not None]
    if not over:
        return list(entries), []
    warm = [
        e.result.validity.get("temperature_mean")
        for e, m in zip(entries, models, strict=True)
        if m is None
    ]
    known = [float(t) for t in warm if t is not None] or [float(m.reference) for _, m in over]
    common = float(np.mean(known))
    out = []
    for entry, model in zip(entries, models, strict=True):
        if model is None:
            out.append(entry)
            continue
        vector = model.at(common)
        extra = np.where(vector.free, np.nan_to_num(model.scatter) ** 2, 0.0)
        taken = replace(
            entry.result,
            coefficients=replace(vector, cov=vector.cov + np.diag(extra)),
            validity=dict(entry.result.validity) | {"temperature_mean": common},
            temperature=None,
        )
        out.append(replace(entry, result=taken))
    names = ", ".join(e.label for e, _ in over)
    degrees = f"{common - ZERO_CELSIUS:.1f}"
    return out, [finding("compare.at_temperature", names=names, temperature=degrees)]
