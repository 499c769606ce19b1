"""Campaigns of transfer alignment for tests: quick ones, and logs that were spoiled."""

from __future__ import annotations

import numpy as np

from foucault import campaign
from foucault.procedures import transfer_alignment

QUICK = {"rate": '"100 Hz"', "message_rate": '"5 Hz"', "with_outage": "false"}
"""Of [simulate]: a sixth of the work."""
LEVER = '["1 m", "2 m", "-0.5 m"]'


def written(**keys) -> str:
    """Return the template with some keys changed; those of `QUICK` too, where nothing is said.

    Of two keys of one name the latter: [instrument] has left_out too.
    """
    wanted, lines = {**QUICK, **keys}, []
    for line in reversed(campaign.template("transfer_alignment").splitlines()):
        key, is_key, _ = line.removeprefix("# ").partition(" = ")
        lines.append(f"{key} = {wanted.pop(key)}" if is_key and key in wanted else line)
    assert not wanted, wanted
    return "\n".join(reversed(lines))


def described(**keys):
    return campaign.parse(written(**keys))


def faultless(**keys):
    """Return the campaign of a slave that has no errors but those of the result, and says so."""
    return described(**{"left_out": "false", **keys})


def made(c, seed=1):
    return campaign.simulate(c, seed)


def trial(c, log, **more):
    known = {"site": c.site, "settings": c.settings, "noise": c.noise, "prior": c.prior} | more
    return transfer_alignment.trial(log, **known)


def calibrated(c, log, **more):
    known = {"site": c.site, "settings": c.settings, "noise": c.noise, "prior": c.prior} | more
    return transfer_alignment.calibrate(log, **known)


def missed(result, session):
    """Return the errors of a result, and their NEES."""
    c = result.coefficients
    err = c.values - session.truth.chosen(c.names).values
    return err / c.sd, float(err @ np.linalg.solve(c.cov, err))
