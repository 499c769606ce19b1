"""Where a navigation starts and what it is compared with, and what of that contradicts itself."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from foucault.errors import Finding, error, finding
from foucault.logs.reference import Reference
from foucault.models import geodesy
from foucault.models.earth import Site
from foucault.models.rotation import turned
from foucault.navigate.strapdown import Trajectory
from foucault.procedures.navigation.run import Place
from foucault.procedures.navigation.settings import Settings
from foucault.procedures.navigation.start import Opening
from foucault.tables import Log
from foucault.units import plain

FAR = float(np.radians(0.5))
"""A reference that starts farther from the place that was given is of another place [rad]."""

WALK = 20.0
"""A reference that moves by more during a rest shows that it is none [m]."""

PUSH, PUSHED = 2.0, 10.0
"""A speed that changes by more [m/s] within such a time [s]: no drift, the instrument was moved."""


def place_of(
    site: Site | None, longitude: float, reference: Reference | None, seen: Opening,
    position_sd: float | None = None,
) -> tuple[Site, Place]:  # fmt: skip
    """Return the site, and where the run starts: as the reference says, else as given.

    `site` or None: as given; `longitude`: as given [rad]; `reference` or None: what is known of
    the trajectory; `position_sd` or None: how well the place that is given is known, then the run
    starts there [m].
    """
    there = None
    if reference is not None and position_sd is None:
        there = reference.place(seen.start, seen.end)
    given = site is not None and site.latitude is not None
    if not given and there is None:
        if reference is None or reference.position is None:
            raise error("navigate.place")
        raise error("navigate.place_later", start=plain(seen.end, 9),
                    first=plain(float(reference.time[0]), 9),
                    last=plain(float(reference.time[-1]), 9))  # fmt: skip
    if reference is not None and reference.position is not None and given:
        _not_elsewhere(site, longitude if there is None else None, reference, seen.end)
    if there is None:
        assert site is not None
        assert site.latitude is not None
        return site, (site.latitude, longitude, site.height)
    assert reference is not None
    latitude, lon, height = (float(v) for v in there)
    if site is None:
        site = Site.at(latitude, height)
    elif not given:  # gravity was measured
        site = replace(site, latitude=latitude, height=height)
    return site, (latitude, lon, height if reference.has_height else site.height)


def _not_elsewhere(
    site: Site | None, longitude: float | None, reference: Reference, time: float
) -> None:
    """Refuse a reference that is far from the place that was given."""
    assert site is not None
    assert site.latitude is not None
    assert reference.position is not None
    known = np.flatnonzero(np.isfinite(reference.position[:, :2]).all(axis=1))
    if not len(known):
        return
    i = int(known[np.argmin(np.abs(reference.time[known] - time))])
    latitude, lon = (float(v) for v in reference.position[i, :2])
    apart = [site.latitude - latitude, 0.0 if longitude is None else longitude - lon]
    if np.abs(turned(np.array(apart))).max() > FAR:
        place = f"latitude {plain(np.degrees(site.latitude))} deg"
        place += "" if longitude is None else f", longitude {plain(np.degrees(longitude))} deg"
        raise error("navigate.elsewhere", given=place, latitude=plain(np.degrees(latitude)),
                    longitude=plain(np.degrees(lon)))  # fmt: skip


def reference_of(
    given: Reference | None, log: Log, seen: Opening, settings: Settings, site: Site,
    longitude: float,
) -> Reference | None:  # fmt: skip
    """Return what to compare with: the file, or the known site where it never moved.

    `given` or None: the file; `log`: the part that is used [SI]; `longitude`: there [rad].
    """
    if given is not None:
        if settings.still:
            raise error("navigate.two_references")
        return given
    if not (settings.still or seen.still):
        return None
    assert site.latitude is not None
    return Reference.site(log.time, site.latitude, longitude, site.height)


def vertical_of(settings: Settings, reference: Reference | None) -> Any:
    """Return what is done with the vertical channel."""
    heights = reference is not None and reference.position is not None and reference.has_height
    if settings.vertical == "aided" and not heights:
        what = "there is no reference" if reference is None else "the reference has none"
        raise error("navigate.aided", what=what)
    if settings.vertical is not None:
        return settings.vertical
    if reference is not None and reference.still:
        return "held"
    return "aided" if heights else "free"


def resting(reference: Reference, seen: Opening) -> None:
    """Refuse a rest during which the reference moves.

    Raises ``navigate.moving``: it is no rest.
    """
    inside = (reference.time >= seen.start) & (reference.time <= seen.end)
    way = 0.0
    if reference.position is not None:
        known = reference.position[inside & np.isfinite(reference.position).all(axis=1)]
        if len(known):
            way = float(np.hypot(*geodesy.displacement(*known[0], *known.T)[:, :2].T).max())
    elif reference.velocity_n is not None:
        speed = np.hypot(*reference.velocity_n[inside, :2].T)
        speed = speed[np.isfinite(speed)]
        way = float(np.median(speed)) * (seen.end - seen.start) if len(speed) else 0.0
    if way > WALK:
        raise error("navigate.moving", start=plain(seen.start), end=plain(seen.end),
                    way=plain(way, 3))  # fmt: skip


def pushed(settings: Settings, trajectory: Trajectory) -> tuple[Finding, ...]:
    """Return a warning where what is said to be still was moved, as no drift moves it."""
    steps = max(1, round(PUSHED / float(np.median(np.diff(trajectory.time)))))
    velocity = trajectory.velocity_n[:, :2]
    if not settings.still or len(velocity) <= steps:
        return ()
    change = float(np.hypot(*(velocity[steps:] - velocity[:-steps]).T).max())
    if change <= PUSH:
        return ()
    return (finding("navigate.not_still", change=plain(change, 3), time=plain(PUSHED)),)


def latitude_told(
    site: Site | None, place: Place, told: tuple[Finding, ...]
) -> tuple[Finding, ...]:
    """Return a note where the Earth's rate contradicts the latitude of the reference.

    `site` or None: as given; `place`: latitude, longitude [rad] and height [m] of the start.
    """
    given = site is not None and site.latitude is not None
    if given or not any(f.code == "alignment.latitude" for f in told):
        return ()
    latitude, longitude = (plain(float(np.degrees(x))) for x in place[:2])
    return (finding("navigate.latitude", latitude=latitude, longitude=longitude),)
