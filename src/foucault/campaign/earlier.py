"""An earlier result as prior of a campaign, and results of one instrument merged.

``[prior] from = "run"`` names the run folder of the earlier result; `growth` and `inflate` say how
much less is known by now. What is done with it is in `procedures.merged`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from foucault import procedures
from foucault.campaign.tables import joined, kind_of_group, parse_at, validate
from foucault.coefficients import Prior
from foucault.errors import FoucaultError, Status, error
from foucault.files import sha256
from foucault.models.layouts import EVERY
from foucault.procedures.merged import (
    Earlier,
    Hashed,
    foreseen_with_prior,
    merged,
    with_prior,
)
from foucault.result import Result
from foucault.run_folder import load_result, result_file
from foucault.strict import Strict

if TYPE_CHECKING:
    from foucault.campaign.reading import Campaign
    from foucault.diagnose.foresight import Foresight

Priors = dict[str, tuple[float, float]]


class EarlierTable(Strict):
    """Keys of [prior] about an earlier result; every other key is a coefficient."""

    run: str = Field(
        alias="from",
        description="Run folder of an earlier result of this instrument; all of its covariance is "
        "used. An entry of its own takes its place for that coefficient.",
    )
    growth: dict[str, str] = Field(default={}, examples=[{"gyro.bias": "2 deg/h"}])
    """By how much coefficients or groups may have changed since, as a standard deviation."""
    inflate: float = Field(default=1.0, examples=[2.0])
    """Factor of all its standard deviations."""


KEYS = ("from", "growth", "inflate")


def split(raw: Mapping[str, Any]) -> tuple[dict[str, Any], EarlierTable | None]:
    """Part what [prior] says of an earlier result from the rest of a campaign."""
    prior = raw.get("prior")
    said = {k: prior[k] for k in KEYS if k in prior} if isinstance(prior, dict) else {}
    if not said or not isinstance(prior, dict):
        return dict(raw), None
    if "from" not in said:
        raise error("prior.alone", keys=" and ".join(said))
    if isinstance(said.get("growth"), dict):
        said["growth"] = joined(said["growth"])
    table = validate(EarlierTable, said, ("prior",))
    if not 0 < table.inflate < float("inf"):
        raise error("prior.growth", key="inflate", given=table.inflate, what="above zero")
    rest = {k: v for k, v in prior.items() if k not in KEYS}
    return {k: v for k, v in raw.items() if k != "prior"} | ({"prior": rest} if rest else {}), table


def written(table: EarlierTable, old: Path, new: Path) -> dict[str, Any]:
    """Return the keys of [prior], the folder relative to where the file will lie.

    `old`, `new`: folders of the campaign and of the copy.
    """
    run = Path(os.path.relpath(old / table.run, new)).as_posix()
    grown = {"growth": dict(table.growth)} if table.growth else {}
    return {"from": run, **grown, "inflate": table.inflate}


def read(table: EarlierTable, folder: Path) -> Earlier:
    """Read the earlier result that a campaign names.

    `table`: what [prior] says.
    """
    growth = {}
    for name, text in table.growth.items():
        sd = parse_at(f'prior.growth."{name}"', text, kind_of_group(name, EVERY))
        if not 0 <= sd < float("inf"):
            raise error("prior.growth", key=f'growth."{name}"', given=text, what="zero or more")
        growth[name] = sd
    _, sha, result = hashed(folder / table.run)
    return Earlier(table.run, sha, result, growth, table.inflate)


def calibrated(campaign: Campaign, table: EarlierTable, run: Callable[[Priors], Result]) -> Result:
    """Calibrate, and take the earlier result into account.

    The session is calibrated alone, so that it can contradict. Where it cannot tell all
    coefficients alone, or is refused for that, it is given the standard deviations of the earlier
    result to begin with; these are taken out again, and all of the covariance takes their place.

    `run`: calibrates with a prior, mean and standard deviation of coefficients or groups.
    """
    earlier = read(table, campaign.folder)
    known = earlier.known(without=campaign.prior).own

    def helped(names: Iterable[str]) -> Result:
        sure = zip(known.names, known.values.tolist(), known.sd.tolist(), strict=True)
        some = set(names)
        prior = {**campaign.prior, **{n: (v, sd) for n, v, sd in sure if n in some}}
        return with_given(run(prior), prior)

    try:
        result = run(campaign.prior)
    except FoucaultError as alone:
        try:
            result = helped(_estimated(campaign))
        except FoucaultError:
            raise alone from None
    else:
        if result.status is not Status.CONVERGED or not np.isfinite(result.coefficients.sd).all():
            result = helped(result.coefficients.names)
    return with_prior(replace(result, instrument=campaign.instrument), earlier, campaign.prior)


def _estimated(campaign: Campaign) -> tuple[str, ...]:
    """Return the coefficients that a calibration will have, as far as its procedure can tell."""
    procedure = procedures.load(campaign.procedure)
    if procedure.every_name is not None:
        return procedure.every_name(campaign.settings)
    return procedure.names(campaign.settings, campaign.session)


def foreseen(
    campaign: Campaign, table: EarlierTable, run: Callable[[Priors], Foresight]
) -> Foresight:
    """Say what a plan will show beside an earlier result.

    As in `calibrated`: the plan alone first, lent the standard deviations of the earlier result
    where it cannot tell all coefficients alone, then all of the covariance.

    `run`: foresees with a prior, mean and standard deviation of coefficients or groups.
    """
    before = read(table, campaign.folder)
    known = before.known(without=campaign.prior).own
    found = run(campaign.prior)
    if not np.isfinite(found.sd).all() or found.rank < found.states:
        lent = {
            name: (found.coefficients.value(name), float(sd))
            for name, sd in zip(known.names, known.sd, strict=True)
            if name in found.coefficients.layout
        }
        found = run({**campaign.prior, **lent})
    vector = foreseen_with_prior(found.coefficients, before, campaign.prior)
    hardly = tuple(n for n in found.hardly if n not in known.layout)
    return replace(found, coefficients=vector, hardly=hardly)


def with_given(result: Result, prior: Prior) -> Result:
    """Return a result that remembers which prior it was given."""
    if not prior:
        return result
    given = {name: [mean, sd] for name, (mean, sd) in prior.items()}
    return replace(result, provenance=result.provenance | {"prior": {"given": given}})


def refuse(campaign: Campaign, command: str) -> None:
    """Refuse an earlier result where `command` has no use for it."""
    if campaign.earlier is not None:
        raise error("prior.not_here", command=command)


def hashed(path: str | Path) -> Hashed:
    """Return the name, the fingerprint and the result of a run folder or its result.json."""
    path = Path(path)
    result = load_result(path, with_tables=False)
    if result.temperature is not None:
        raise error("temperature.as_prior", name=path)
    return str(path), sha256(result_file(path)), result


def merge(paths: Sequence[str | Path]) -> Result:
    """Merge the results of run folders of one instrument.

    `paths`: run folders or result.json files, two or more.
    """
    return merged([hashed(path) for path in paths])
