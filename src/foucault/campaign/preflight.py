"""What the planned session of a campaign will show, told before it is made.

Procedures that plan a motion say it themselves (`foresee`). Of the others one session is simulated
and calibrated: its covariance is the prediction.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from foucault import procedures
from foucault.campaign import earlier
from foucault.campaign.mistakes import validate
from foucault.campaign.reading import Campaign
from foucault.campaign.running import simulate
from foucault.diagnose.foresight import Foresight
from foucault.errors import Finding, finding
from foucault.escape import csv_cell
from foucault.files import atomic, keep_others
from foucault.models.noise import grade
from foucault.procedures.record import Beforehand

PLAN = ("plan", "rate", "segment", "steps", "positions")
"""Keys of [procedure] that say how it is turned; another plan takes the place of them all."""

HEADINGS = ("coefficient", "sd", "prior_sd", "unit", "of_prior")
"""First line of the file that `write` writes."""


def foresee(campaign: Campaign, changes: Mapping[str, Any] | None = None) -> Foresight:
    """Return what the planned session of a campaign will show.

    `changes` or None: keys of [procedure] and what they shall say instead, as in the file. A
    `plan` takes the place of all that the file says of the plan, where a vehicle moves it is the
    `profile` of [simulate].
    """
    if campaign.earlier is not None:
        return earlier.foreseen(
            campaign, campaign.earlier,
            lambda prior: foresee(replace(campaign, prior=prior, earlier=None), changes),
        )  # fmt: skip
    procedure, changes = procedures.load(campaign.procedure), dict(changes or {})
    if "plan" in changes and "profile" in type(campaign.session).model_fields:
        other = {"profile": changes.pop("plan"), "manoeuvres": ()}
        moved = campaign.session.model_copy(update=other)
        campaign = replace(campaign, session=moved)
    if changes:
        replaced = ("name", *(PLAN if "plan" in changes else ()))
        kept = {k: v for k, v in campaign.tables.procedure.items() if k not in replaced}
        settings = validate(procedure.Settings, kept | changes, ("procedure",), ("name",))
        campaign = replace(campaign, settings=settings)
    if procedure.foresee is None:
        return _simulated(campaign)
    known, told = beforehand(campaign)
    found = procedure.foresee(known)
    if procedure.more == "recordings" and campaign.log.more:
        told = (*told, finding("systematic.recordings_planned"))
    return replace(found, findings=(*told, *found.findings))


def beforehand(campaign: Campaign) -> tuple[Beforehand[Any, Any], tuple[Finding, ...]]:
    """Return what a plan is judged by, and what was assumed for it."""
    c = campaign
    earlier.refuse(c, "a search")
    known = Beforehand(c.settings, c.session, c.site, c.noise, c.prior, wanted=c.wanted)
    if not procedures.load(c.procedure).assumes_noise or c.noise:
        return known, ()
    typical = grade(c.simulate.grade, "simulate.grade").noise
    return replace(known, typical=typical), (finding("preflight.typical", grade=c.simulate.grade),)


def _simulated(campaign: Campaign) -> Foresight:
    """Simulate a session and calibrate it: its covariance is what can be expected."""
    procedure, seed = procedures.load(campaign.procedure), campaign.simulate.seed
    log = simulate(campaign, seed).simulation.log
    result = procedure.calibrate(
        log, site=campaign.site, settings=campaign.settings, noise=campaign.noise,
        prior=campaign.prior,
    )  # fmt: skip
    found = result.coefficients
    lost = [n for n, s in zip(found.names, found.sd, strict=True) if not np.isfinite(s)]
    return Foresight(
        coefficients=found,
        linearised_at=f"one simulated session, seed {seed}",
        plan="that of [simulate]",
        duration=float(log.time[-1] - log.time[0]),
        states=len(found),
        rank=len(found) - len(lost),
        unseen=tuple(lost),
        weakest=tuple(result.diagnostics.get("weakest", ())),
        findings=(
            finding(
                "preflight.simulated", procedure=campaign.procedure, grade=campaign.simulate.grade
            ),
            *(f for f in result.findings if f.severity == "warning"),
        ),
    )


def write(foresight: Foresight, path: str | Path) -> None:
    """Write the table of coefficients as CSV, in the units that reports show."""
    keep_others(path, [",".join(HEADINGS).encode()])
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(HEADINGS)
    for row in foresight.rows():
        numbers = (row["display_sd"], row["display_prior_sd"], row["of_prior"])
        sd, before, share = ("" if v is None else f"{v:.6g}" for v in numbers)
        words = (row["name"], sd, before, row["display_unit"], share)
        lines.writerow([csv_cell(word) for word in words])
    with atomic(path) as temporary:
        temporary.write_text(text.getvalue(), encoding="utf-8")
