"""What a simulated instrument holds beside what its calibration estimates.

Where `[instrument]` declares sizes, each term that is not estimated is drawn at its size: those of
the model are put into the instrument, drifts into its samples, and the place is as far off as its
latitude may be (gravity is off in every simulation). Where nothing is declared it holds the model
alone, and what is written of it says so.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from foucault import procedures
from foucault.campaign.reading import Campaign
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.left_out import GRAVITY, LATITUDE, Motion, Sizes, Term, changes, terms, told
from foucault.models.noise import grade
from foucault.tables import Log


@dataclass(frozen=True)
class Held:
    """What is drawn of the terms that are not estimated."""

    sizes: Sizes | None = None  # at which they were drawn, None: the instrument holds none [SI]
    # values: of coefficients [SI]; drifts: terms whose size is the value drawn [SI]
    values: dict[str, float] = field(default_factory=dict)
    drifts: tuple[Term, ...] = ()
    latitude: float = 0.0  # how much further north it really is [rad]

    def model(self, model: Any) -> Any:
        """Return an instrument with the terms of its model."""
        if not self.values:
            return model
        vector = model.coefficients(LAYOUT.names)
        return ImuModel.from_coefficients(vector.with_values(self.values))

    def site(self, site: Site) -> Site:
        """Return where it really is."""
        if site.latitude is None or not self.latitude:
            return site
        return replace(site, latitude=site.latitude + self.latitude)

    def simulation(self, simulation: Any) -> Any:
        """Return a simulation with the drifts in its samples."""
        return replace(simulation, log=self.log(simulation)) if self.drifts else simulation

    def log(self, simulation: Any) -> Log:
        """Return the log with the drifts in its samples."""
        log: Log = simulation.log
        zero = np.zeros((len(log.time), 3))
        read = [zero if x is None else x for x in (log.accel, log.gyro)]
        f_b, w_b = simulation.model.compensate(*read)
        at = Motion(log.time, f_b, w_b, *log.time[[0, -1]])
        for term in self.drifts:
            (by,) = changes([term], simulation.model, at)
            read = [x if more is None else x + more for x, more in zip(read, by[:2], strict=True)]
        accel, gyro = (None if x is None else r for x, r in zip((log.accel, log.gyro), read,
                                                                strict=True))  # fmt: skip
        return replace(log, accel=accel, gyro=gyro)


def held(campaign: Campaign, seed: int) -> Held:
    """Draw what a simulated instrument holds beside the model; `seed`: of the simulation [1]."""
    procedure = procedures.load(campaign.procedure)
    if not campaign.sizes or not procedure.counted:
        return Held()
    sizes = _sizes(campaign)
    names = (*procedure.names(campaign.settings, campaign.session), *campaign.simulate.errors)
    rng = np.random.default_rng([seed, 11])
    drawn = [
        t._replace(size=t.size * float(rng.standard_normal()))
        for t in terms(names, campaign.site, sizes)
    ]
    values = {t.name: t.size for t in drawn if t.name in LAYOUT}
    drifts = tuple(t for t in drawn if t.group.endswith(" drift"))
    north = sum(t.size for t in drawn if t.group == LATITUDE)
    return Held(campaign.sizes, values, drifts, float(north))


def in_words(campaign: Campaign) -> str | None:
    """Say what instruments that are simulated hold beside the model; None where nobody asks."""
    procedure = procedures.load(campaign.procedure)
    if campaign.sizes is None or not (procedure.counted or campaign.sizes):
        return None
    if not procedure.counted:
        return f"nothing: simulated sessions of {procedure.name} hold the model alone"
    if not campaign.sizes:
        return "nothing: [instrument] declares no grade, part or size"
    return "all terms that are not estimated, drawn at the sizes of [instrument]"


def _sizes(campaign: Campaign) -> Sizes:
    """Return the sizes at which terms are drawn: as the noise of the simulation tells them."""
    procedure = procedures.load(campaign.procedure)
    typical = grade(campaign.simulate.grade, "simulate.grade").noise
    noise = campaign.noise or procedure.noise or typical
    found = told(campaign.sizes or {}, noise.accel.white, noise.gyro.white) or {}
    return {g: s for g, s in found.items() if g != GRAVITY}
