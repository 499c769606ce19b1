"""What a transfer alignment does not estimate and counts with: states of the filter, and sizes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector, Layout, Prior
from foucault.estimate.transfer import TransferFit, TransferModel
from foucault.infer import filtered
from foucault.infer.filtered import components
from foucault.infer.left_out import Judgement
from foucault.infer.left_out_states import Group, Posterior, fit, of_priors, widened
from foucault.infer.linear_filter import kalman
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT
from foucault.models.ins_errors import Sensors
from foucault.models.layouts import BESIDE
from foucault.models.left_out import GRAVITY, LATITUDE, Sizes, of_imu
from foucault.models.transfer import COUNTED, LOAD, Mount
from foucault.procedures.transfer_alignment.settings import PRIOR, Settings


@dataclass(frozen=True)
class Counted:
    """The states that are not in the result."""

    sensors: Sensors  # errors of the slave that are states, those of the result among them
    mount: Mount
    # group -> names of its states, how large each is [SI], and what that rests on
    groups: Mapping[str, tuple[tuple[str, ...], float, str]]
    judged: bool  # whether sizes of them were declared

    @classmethod
    def of(cls, settings: Settings, sizes: Sizes | None, site: Site, *, placed: bool) -> Counted:
        """Return what is counted with.

        `placed`: whether the master says where it is.
        """
        asked, mount = settings.asked.layout.names, settings.mount
        out = dict[str, tuple[tuple[str, ...], float, str]]()
        said = {} if sizes is None else {**of_imu(sizes), **_of_the_rig(settings, site)}
        for group, sized in {**settings.always, **said}.items():
            names = tuple(n for n in _members(group) if n not in asked)
            idle = group == LATITUDE and (placed or site.latitude is None)
            if sized[0] > 0 and not idle:
                out[group] = (names, *sized)
        known = {*asked, *(n for names, *_ in out.values() for n in names)}
        out = {
            group: (some, size, basis) for group, (names, size, basis) in out.items()
            # A drift acts as its coefficient does, which has to be a state.
            if (some := tuple(n for n in names if n.removeprefix("drift.") in known))
        }  # fmt: skip
        sensors = Sensors.of(n for n in LAYOUT.names if n in known)
        load = mount.load or MOUNT in out
        return cls(sensors, replace(mount, load=load), out, sizes is not None)

    @property
    def names(self) -> tuple[str, ...]:
        """Those of `models.transfer.COUNTED`."""
        mine = {n for names, *_ in self.groups.values() for n in names}
        return tuple(n for n in COUNTED.names if n in mine)

    def prior(self, settings: Settings, given: Prior) -> CoefficientVector:
        """Return what was known of all of them, and of what is found besides.

        `given`: of coefficients or groups of coefficients [SI].
        """
        load = LOAD.names if self.mount.load and not settings.load else ()
        layout = Layout((
            *self.sensors.layout.coefficients, *BESIDE.subset(settings.beside).coefficients,
            *LOAD.subset(load).coefficients, *COUNTED.subset(self.names).coefficients,
        ))  # fmt: skip
        usual = {k: v for k, v in PRIOR.items() if any(n.startswith(f"{k}.") for n in layout.names)}
        if settings.estimates_delay:
            middle = settings.longest_delay / 2
            usual["master.delay"] = middle, settings.longest_delay / np.sqrt(12.0)
        for names, size, _ in self.groups.values():
            usual |= {n.rpartition(".")[0] if n in LAYOUT else n: (0.0, size) for n in names}
        return CoefficientVector.prior(layout, {**usual, **given})

    def judged_groups(self, prior: CoefficientVector, given: Prior) -> dict[str, Group]:
        """Return what is judged: what is counted with, as large as `prior` says, and the priors."""
        out = dict[str, Group]()
        for group, (names, _, basis) in self.groups.items():
            sd = float(prior.prior_sd[[prior.names.index(n) for n in names]].max())
            said = any(key == group or key in names for key in given)
            out[group] = Group("source", names, sd, "[prior]" if said else basis)
        known = [n for n in prior.names if n in LAYOUT or n.startswith("installation.")]
        aside = {n for g in out.values() for n in g.names}
        return out | of_priors(prior, [n for n in known if n not in aside])


LEVER, CLOCK, MOUNT = "lever arm", "rate of the messages' clock", "mount under load"
"""Groups of what holds the slave and times the messages."""

STATES = {
    GRAVITY: "site.gravity", LATITUDE: "site.latitude", CLOCK: "messages.rate",
    LEVER: "lever_arm", MOUNT: "load",
}  # fmt: skip
"""Groups that are no coefficients of the instrument -> their states."""


def _members(group: str) -> tuple[str, ...]:
    """Return the states of a group."""
    drift = f"drift.{group.removesuffix(' drift')}"
    key = STATES.get(group, drift if group.endswith(" drift") else group)
    layout = next(x for x in (LAYOUT, LOAD, COUNTED) if any(n.startswith(key) for n in x.names))
    return tuple(layout.names[i] for i in layout.group(key))


def _of_the_rig(settings: Settings, site: Site) -> Sizes:
    """Return what is not known of place, lever arm, mount and clocks."""
    out = {
        GRAVITY: (site.gravity_sd, "standard uncertainty of local gravity"),
        LEVER: (settings.lever_arm_sd, "lever_arm_sd"),
        CLOCK: (settings.clock_sd, "clock_sd"),
    }
    if not settings.load and settings.matching != "velocity":
        out[MOUNT] = (settings.load_sd, "load_sd")
    default = type(settings)()
    return {
        g: (size, f"{basis}, judgement" if basis in CHOSEN and getattr(default, basis) == size
            else basis)
        for g, (size, basis) in out.items()
    }  # fmt: skip


CHOSEN = ("lever_arm_sd", "clock_sd", "load_sd")
"""Settings that say how large something is, and have a usual size."""


def judged(
    at: TransferFit, prior: CoefficientVector, groups: Mapping[str, Group],
    reported: tuple[str, ...],
) -> tuple[TransferFit, CoefficientVector, Judgement]:  # fmt: skip
    """Enlarge what the messages contradict; return fit, what was known, and what was made of it.

    `prior`: what was known of the coefficients and of what is found besides [SI].
    """
    model = at.model
    assert isinstance(model, TransferModel)
    rows = [model.names.index(n) for n in prior.names]

    def solve(times: Mapping[str, float]) -> tuple[TransferFit, CoefficientVector]:
        if not times:
            return at, prior
        wide = widened(prior, groups, times)
        k, P0 = np.ones(len(model.names)), at.system.P0
        k[rows] = wide.prior_sd / prior.prior_sd
        system = replace(at.system, P0=P0 * np.outer(k, k))
        more = replace(model, sd=model.sd * k)
        return replace(at, model=more, system=system, run=kalman(system)), wide

    def posterior(found: tuple[TransferFit, CoefficientVector]) -> Posterior:
        fit_, known = found
        return Posterior(model.estimate(fit_, known), known.values, components(fit_))

    (found, wide), told = fit(solve, posterior, groups, reported)
    return found, wide, told


WHITE = {"white noise of gyros": np.arange(3), "white noise of accelerometers": np.arange(3, 6)}
"""White noise of the slave, and the states that it acts on: its attitude, its velocity."""
BASIS = {
    "state at the start": "attitude, velocity and place at the start, from the messages",
    "prior": "prior as given, or usual of a tactical instrument",
    "slow noise and bending": "slow noise as given, flexure_sd and flexure_time",
    "velocity of the messages": "velocity_sd",
    "attitude of the messages": "attitude_sd",
}


def budget(at: TransferFit, groups: Mapping[str, Group]) -> dict[str, FloatArray]:
    """Return the variance of every state after those of navigation by source, (n - first,) [SI]."""
    assert isinstance(at.model, TransferModel)
    names, first = at.model.names, at.model.first
    aside = {group: g.names for group, g in groups.items() if g.kind == "source"}
    taken = {n for some in aside.values() for n in some}
    known = {"prior": tuple(n for n in names[first:] if n not in taken), **aside}
    of = {source: np.array([names.index(n) for n in some], int) for source, some in known.items()}
    driven = {**WHITE, "slow noise and bending": np.arange(first, len(names))}
    parts = filtered.budget(at, {"state at the start": np.arange(first), **of}, driven)
    return {f"{n} of the messages" if n in at.model.kinds else n: v for n, v in parts.items()}
