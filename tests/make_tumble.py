"""Simulated tumbles as a campaign file describes them, and their calibration."""

from __future__ import annotations

from functools import cache

import numpy as np

from foucault import campaign
from foucault.campaign.running import with_nothing_else
from foucault.procedures import platform_tumble

TEMPLATE = with_nothing_else(campaign.template("platform_tumble"))
PUBLISHED = 'average = "5 s"'
FAST = 'plan = "-x -z -y +z"\nrate = "5 deg/s"\nsegment = "60 s"'
SLOW = 'plan = "-x -z -y +z"\nrate = "0.02 deg/s"\nsegment = "1500 s"\naverage = "5 s"\npasses = 30'


def campaign_text(procedure="", simulate="", **other):
    """Return the template with these lines in [procedure] and [simulate], and other text."""
    text = TEMPLATE
    head, _, tail = text.partition("[simulate]")
    text = _with(head, procedure) + "[simulate]" + _with(tail, simulate)
    for old, new in other.items():
        start = text.index(f"\n{old} = ") + 1
        text = text[:start] + f"{old} = {new}" + text[text.index("\n", start) :]
    return text


def _with(text, lines):
    out = text.splitlines(keepends=True)
    for line in filter(None, lines.splitlines()):
        key = line.split(" =")[0]
        at = [k for k, old in enumerate(out) if old.removeprefix("# ").startswith(f"{key} = ")]
        out[at[0]] = line + "\n"
    return "".join(out)


@cache
def campaign_of(procedure=PUBLISHED, simulate="", **other):
    """Return the campaign of these lines; the same words give the same one."""
    return campaign.parse(campaign_text(procedure, simulate, **other))


@cache
def tumble(procedure=PUBLISHED, simulate="", seed=3, **other):
    """Return a campaign and its simulated session; the same words give the same ones."""
    made = campaign_of(procedure, simulate, **other)
    return made, campaign.simulate(made, seed)


def calibrate(made, log, trial=False, **words):
    """Calibrate a log with what its campaign says, and these words instead."""
    said = {
        "site": made.site, "settings": made.settings, "noise": made.noise, "prior": made.prior
    } | words  # fmt: skip
    return (platform_tumble.trial if trial else platform_tumble.calibrate)(log, **said)


def nees(result, truth):
    error = result.coefficients.values - truth.values
    return float(error @ np.linalg.solve(result.coefficients.cov, error))
