"""Whether the planned motion of a campaign will see its coefficients, told before the session."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from foucault import procedures
from foucault.campaign.mistakes import validate
from foucault.campaign.reading import Campaign
from foucault.diagnose.foresight import Foresight
from foucault.errors import error
from foucault.files import atomic

PLAN = ("plan", "rate", "segment", "steps")
"""Keys of [procedure] that say how it is turned; another plan takes the place of them all."""

HEADINGS = ("coefficient", "sd", "prior_sd", "unit", "of_prior")
"""First line of the file that `write` writes."""


def able() -> tuple[str, ...]:
    """Return the names of the procedures whose planned motion can be judged."""
    return tuple(n for n in procedures.PROCEDURES if hasattr(procedures.load(n), "foresee"))


def foresee(campaign: Campaign, changes: Mapping[str, Any] | None = None) -> Foresight:
    """Return what the planned motion of a campaign will show.

    Parameters
    ----------
    campaign : Campaign
        The campaign; its log need not exist.
    changes : mapping of str to object, or None
        Keys of [procedure] and what they shall say instead, as in the file. A `plan` takes the
        place of all that the file says of the plan.
    """
    module = procedures.load(campaign.procedure)
    if not hasattr(module, "foresee"):
        raise error("preflight.procedure", procedure=campaign.procedure, able=", ".join(able()))
    settings = campaign.settings
    if changes:
        replaced = ("name", *(PLAN if "plan" in changes else ()))
        kept = {k: v for k, v in campaign.tables.procedure.items() if k not in replaced}
        settings = validate(module.Settings, kept | dict(changes), ("procedure",), ("name",))
    found: Foresight = module.foresee(
        settings,
        session=campaign.session,
        site=campaign.site,
        noise=campaign.noise,
        prior=campaign.prior,
    )
    return found


def write(foresight: Foresight, path: str | Path) -> None:
    """Write the table of coefficients as CSV, in the units that reports show.

    Parameters
    ----------
    foresight : Foresight
        What will be seen.
    path : str or Path
        File to write.
    """
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(HEADINGS)
    for row in foresight.rows():
        numbers = (row["display_sd"], row["display_prior_sd"], row["of_prior"])
        sd, before, share = ("" if v is None else f"{v:.6g}" for v in numbers)
        lines.writerow((row["name"], sd, before, row["display_unit"], share))
    with atomic(path) as temporary:
        temporary.write_text(text.getvalue(), encoding="utf-8")
