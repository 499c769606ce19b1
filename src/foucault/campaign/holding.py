"""What a simulated instrument holds beside what its calibration estimates.

Where `[instrument]` declares sizes, each term that is not estimated is drawn at its size: those of
the model are put into the instrument, others into its samples, and the place is as far off as its
latitude may be (gravity is off in every simulation); lever arms, delays and clocks are the
procedure's to draw. Where nothing is declared it holds the model and what its procedure counts
`always`, and what is written of it says so.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from foucault import procedures
from foucault.arrays import FloatArray
from foucault.campaign.reading import Campaign
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.left_out import GRAVITY, LATITUDE, Motion, Sizes, Term, changes, terms, told
from foucault.models.noise import ImuNoise, grade
from foucault.tables import IndexedLog, Log

AnyLog = TypeVar("AnyLog", Log, IndexedLog)


@dataclass(frozen=True)
class Held:
    """What is drawn of the terms that are not estimated."""

    sizes: Sizes | None = None  # at which they were drawn, None: the instrument holds none [SI]
    # values: of coefficients [SI]; added: to the samples, terms whose size is the value drawn [SI]
    values: dict[str, float] = field(default_factory=dict)
    added: tuple[Term, ...] = ()
    latitude: float = 0.0  # how much further north it really is [rad]
    rng: np.random.Generator | None = None  # of what is drawn besides

    def session(self, campaign: Campaign, model: Any) -> tuple[Any, Any, Any]:
        """Return session, settings and instrument that are simulated."""
        drawn, model = procedures.load(campaign.procedure).drawn, self.model(model)
        if drawn is None or self.rng is None:
            return session_of(campaign), campaign.settings, model
        return drawn(session_of(campaign), campaign.settings, model, self.rng)

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
        """Return a simulation with what is added to its samples."""
        if not self.added:
            return simulation
        model = simulation.model if isinstance(simulation.model, ImuModel) else ImuModel()
        ends = simulation.log.time[[0, -1]]
        if hasattr(simulation, "recorded"):  # it goes on after its log
            return simulation.with_recorded(self.log(simulation.recorded, model, *ends))
        return replace(simulation, log=self.log(simulation.log, model, *ends))

    def log(self, log: AnyLog, model: ImuModel, begin: float, end: float) -> AnyLog:
        """Return a log with what is added to its samples; `begin`, `end`: of the session [s]."""
        logged = {name: getattr(log, name, None) for name in ("accel", "gyro", "mag")}
        read = {name: _on_axes(x, len(log.time)) for name, x in logged.items()}
        f_b, w_b = model.compensate(read["accel"], read["gyro"])
        assert f_b is not None
        assert w_b is not None
        at = Motion(log.time, f_b, w_b, begin, end, read["mag"])
        for term in self.added:
            (by,) = changes([term], model, at)
            for name, x in read.items():
                read[name] = x if (more := getattr(by, name)) is None else x + more
        more = {name: _as_read(read[name], x) for name, x in logged.items() if x is not None}
        return replace(log, **more)


def _on_axes(x: FloatArray | None, n: int) -> FloatArray:
    """Return what `n` samples say of three axes, (n, 3): one alone is y, two are x and y [SI]."""
    out = np.zeros((n, 3))
    if x is not None:
        out[:, _columns(x)] = x.reshape(n, -1)
    return out


def _as_read(x: FloatArray, like: FloatArray) -> FloatArray:
    """Return of three axes (n, 3) those that a log has, in the shape that it has them [SI]."""
    return np.asarray(x[:, _columns(like)].reshape(like.shape))


def _columns(x: FloatArray) -> slice:
    return {1: slice(1, 2), 2: slice(0, 2), 3: slice(0, 3)}[1 if x.ndim == 1 else x.shape[1]]


def held(campaign: Campaign, seed: int) -> Held:
    """Draw what a simulated instrument holds beside the model; `seed`: of the simulation [1]."""
    procedure = procedures.load(campaign.procedure)
    declared = bool(campaign.sizes) and procedure.counted
    sizes, always = _sizes(campaign) if declared else {}, procedure.always(campaign.settings)
    sizes = {**sizes, **always, **sizes}  # declared ones are drawn first, and count
    if not sizes:
        return Held()
    names = (*procedure.names(campaign.settings, campaign.session), *campaign.simulate.errors)
    rng = np.random.default_rng([seed, 11])
    drawn = []
    for t in terms(names, campaign.site, sizes):
        known = campaign.prior if t.group in always else {}  # it counts as [prior] says
        mean, sd = known.get(t.name, known.get(t.group, (0.0, t.size)))
        drawn.append(t._replace(size=mean + sd * float(rng.standard_normal())))
    own = [t for t in drawn if t.name in LAYOUT and t.name in procedure.layout]
    values = {t.name: t.size for t in own}
    added = tuple(t for t in drawn if t not in own and t.group != LATITUDE)
    north = sum(t.size for t in drawn if t.group == LATITUDE)
    if not declared:
        return Held(values=values, added=added)
    return Held(campaign.sizes, values, added, float(north), rng)


def session_of(campaign: Campaign) -> Any:
    """Return the session of a campaign, with what its readings scatter by where nobody says it."""
    if campaign.noise is not None:
        return campaign.session
    procedure = procedures.load(campaign.procedure)
    return procedure.scattered(campaign.session, campaign.settings, noise_of(campaign))


def noise_of(campaign: Campaign) -> ImuNoise:
    """Return the noise of a simulated instrument: as declared, else that of its class [SI]."""
    typical = grade(campaign.simulate.grade, "simulate.grade").noise
    return campaign.noise or procedures.load(campaign.procedure).noise or typical


def in_words(campaign: Campaign) -> str | None:
    """Say what instruments that are simulated hold beside the model; None where nobody asks."""
    procedure = procedures.load(campaign.procedure)
    if campaign.sizes is None or not (procedure.counted or campaign.sizes):
        return None
    if not procedure.counted:
        return f"nothing: simulated sessions of {procedure.name} hold the model alone"
    if not campaign.sizes:
        always = ", ".join(procedure.always(campaign.settings))
        alone = f"what is counted always ({always})" if always else "nothing"
        return f"{alone}: [instrument] declares no grade, part or size"
    return "all terms that are not estimated, drawn at the sizes of [instrument]"


def _sizes(campaign: Campaign) -> Sizes:
    """Return the sizes at which terms are drawn: as the noise of the simulation tells them."""
    procedure = procedures.load(campaign.procedure)
    noise = noise_of(campaign)
    found = told(campaign.sizes or {}, noise.accel.white, noise.gyro.white) or {}
    return {g: s for g, s in found.items() if g not in (GRAVITY, *procedure.otherwise)}
