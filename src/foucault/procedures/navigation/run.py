"""One navigation of a log: where it starts, compensated, aligned, navigated, and compared.

What a navigation shows: contributions, terms of free inertial drift, and its checks.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose import schuler
from foucault.diagnose.alignment import POOR
from foucault.diagnose.checks import check
from foucault.diagnose.navigation import (
    Budget,
    NavigationError,
    budget,
    error_of,
    normalised_square,
)
from foucault.diagnose.schuler import Place
from foucault.errors import Finding, FoucaultError, error, finding
from foucault.infer.gauss_newton import chi_square_limits
from foucault.logs.reference import Reference
from foucault.models import earth
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.imu import LAYOUT, ImuModel
from foucault.models.ins_errors import Sensors
from foucault.models.noise import ImuNoise
from foucault.models.rotation import log as rotation_vector
from foucault.models.rotation import turned
from foucault.models.size_effect import LAYOUT as SIZE_EFFECT
from foucault.models.size_effect import LEVER, OFFSET, with_size_effect
from foucault.navigate import ins_filter as free_run
from foucault.navigate.align import measured_errors, sensor_errors, window
from foucault.navigate.increments import Increments, increments_of
from foucault.navigate.strapdown import State, Trajectory, navigate
from foucault.procedures.navigation.start import (
    Opening,
    Settings,
    Start,
    judged,
    shows_north,
    start_of,
)
from foucault.result import Check, Level, Result
from foucault.tables import AXES, Log
from foucault.units import factor, plain

Position = tuple[float, float, float]

SLOW = 1.0  # A slower start of what seems to rest is at rest [m/s].

WITH, WITHOUT, AS_MEASURED = "with calibration", "without calibration", "as measured"
"""Names of the runs."""


@dataclass(frozen=True)
class Task:
    """What all runs have in common."""

    log: Log  # the part that is used, as measured [SI]
    site: Site
    place: Position  # latitude, longitude [rad] and height [m] there
    settings: Settings
    seen: Opening  # the rest at the start
    noise: ImuNoise  # noise of the sensors [SI]
    reference: Reference | None  # what the runs are compared with

    @property
    def held(self) -> bool:
        return self.settings.vertical != "free"

    def state(self, start: Start) -> State:
        """Return the state at which a run starts."""
        return State(*self.place, self._velocity(start.time), start.C_nb)

    def _velocity(self, time: float) -> FloatArray:
        """Return what is given, zero after a rest, else what the reference says."""
        if self.settings.velocity is not None:
            return np.array(self.settings.velocity)
        if self.seen.end > self.seen.start or self.reference is None:
            return np.zeros(3)
        known = self.reference.velocity(time)
        # A steady drive reads as a rest does; positions of one that stands scatter.
        if known is None or (self.seen.found and np.linalg.norm(known) < SLOW):
            return np.zeros(3)
        return known


@dataclass(frozen=True)
class Made:
    """A run with everything it was made of."""

    name: str  # `WITH`, `WITHOUT` or `AS_MEASURED`
    log: Log  # compensated or not [SI]
    increments: Increments
    start: Start  # the attitude it starts with
    first: int  # row at whose end it starts [1]
    state: State
    trajectory: Trajectory  # every state from there on
    errors: NavigationError | None
    told: tuple[Finding, ...] = ()

    @classmethod
    def of(cls, task: Task, calibration: Result | None) -> Made:
        """Align, judge the alignment, and navigate."""
        log = task.log if calibration is None else calibration.apply(task.log)
        start = start_of(log, task.site, task.seen, task.settings, task.noise)
        bias_sd = bias_sds(None if calibration is None else calibration.coefficients)
        rests = task.reference is None or task.reference.still
        start = judged(start, log, task.site, task.seen, task.noise, bias_sd, rests)
        made = cls.navigated(task, AS_MEASURED if calibration is None else WITH, log, start)
        told = start.findings
        known = task.reference
        given = task.settings.velocity is not None or (
            known is not None and known.velocity(start.time) is not None
        )
        if task.seen.start == task.seen.end and not (task.seen.found or given):
            told += (finding("navigate.speed_at_start"),)
        return replace(made, told=told)

    @classmethod
    def navigated(cls, task: Task, name: str, log: Log, start: Start) -> Made:
        """Navigate from a start to the end."""
        increments = increments_of(log, gaps=task.settings.gaps)
        first = increments.row_at(start.time)
        if len(increments) - first < 3:
            raise error("navigate.too_short", end=plain(start.time, 9),
                        last=plain(float(increments.time[-1]), 9))  # fmt: skip
        state = task.state(start)
        trajectory = navigate(
            increments, state, first=first, gravity_offset=task.site.anomaly,
            vertical=task.settings.vertical or "free",
            heights=_heights(task, increments.time),
        )  # fmt: skip
        errors = None if task.reference is None else error_of(trajectory, task.reference)
        return cls(name, log, increments, start, first, state, trajectory, errors,
                   increments.findings)  # fmt: skip


def without(task: Task, main: Made) -> tuple[Made | None, list[Finding]]:
    """Navigate as measured; where that cannot be aligned, from the attitude of the other run."""
    told: list[Finding] = []
    try:
        start = start_of(task.log, task.site, task.seen, task.settings, task.noise)
        if start.method not in ("given", "level and given heading"):
            shows_north(task.log, task.site, task.seen, start)
    except FoucaultError as problem:
        told.append(finding("navigate.raw_start", reason=problem.message.rstrip(".")))
        start = main.start
    try:
        return Made.navigated(task, WITHOUT, task.log, start), told
    except FoucaultError as problem:
        return None, [*told, finding("navigate.raw_fails", reason=problem.message)]


def _heights(task: Task, time: FloatArray) -> FloatArray | None:
    known = task.reference
    if task.settings.vertical != "aided" or known is None or known.position is None:
        return None
    height = known.position[:, 2]
    said = np.isfinite(height)
    if not said.any():
        return None
    return np.interp(time, known.time[said], height[said], left=np.nan, right=np.nan)


def bias_sds(vector: CoefficientVector | None) -> tuple[float, float]:
    """Return how well gyro biases [rad/s] and accelerometer biases [m/s^2] are known."""
    out = []
    for triad in ("gyro", "accel"):
        names = [] if vector is None else [n for n in vector.names if n.startswith(f"{triad}.bias")]
        sd = np.array([]) if vector is None else vector.sd[[vector.layout.index(n) for n in names]]
        out.append(float(np.sqrt(np.mean(np.nan_to_num(sd) ** 2))) if len(sd) else 0.0)
    return out[0], out[1]


FAR = float(np.radians(0.5))
"""A reference that starts farther from the place that was given is of another place [rad]."""

WALK = 20.0  # A reference that moves by more during a rest shows that it is none [m].

PUSH, PUSHED = 2.0, 10.0
"""A speed that changes by more [m/s] within such a time [s]: no drift, the instrument was moved."""


def place_of(
    site: Site | None, longitude: float, reference: Reference | None, seen: Opening,
    position_sd: float | None = None,
) -> tuple[Site, Position]:  # fmt: skip
    """Return the site, and where the run starts: as the reference says, else as given.

    `longitude`: as given [rad]; `reference` or None: what is known of the trajectory; `position_sd`
    or None: how well the place that is given is known, then the run starts there [m].
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

    `log`: the part that is used [SI]; `longitude`: there [rad].
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
            way = float(np.hypot(*earth.displacement(*known[0], *known.T)[:, :2].T).max())
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
    site: Site | None, place: Position, told: tuple[Finding, ...]
) -> tuple[Finding, ...]:
    """Return a note where the Earth's rate contradicts the latitude of the reference.

    `place`: latitude, longitude [rad] and height [m] of the start.
    """
    given = site is not None and site.latitude is not None
    if given or not any(f.code == "alignment.latitude" for f in told):
        return ()
    latitude, longitude = (plain(float(np.degrees(x))) for x in place[:2])
    return (finding("navigate.latitude", latitude=latitude, longitude=longitude),)


EPOCHS = 150  # Epochs at which contributions are computed [1].

TURNS = np.radians(2.0)
"""A body that turns by more does not keep its sensor errors constant in a level frame [rad]."""

SMALL = 1e-4
"""A coefficient is changed by what moves readings by this part of gravity or Earth's rate [1]."""

QUIETEST = (1e-9, 1e-7)  # White noise that a fit takes at least [rad/s/sqrt(Hz)], [m/s^2/sqrt(Hz)].


def budget_of(task: Task, made: Made, vector: CoefficientVector | None) -> Budget:
    """Propagate start errors, coefficients and noise along a run.

    `vector` or None: the coefficients that were corrected.
    """
    # Rows spread evenly from the start to the last epoch that is compared.
    last = len(made.increments) - 1
    if made.errors is not None:
        last = made.increments.row_at(float(made.errors.time[-1]))
    wanted = np.linspace(made.first, last, EPOCHS + 1)[1:]
    rows = np.unique(np.round(wanted).astype(np.int64))
    sensors, vector = _of_sensors(vector)
    sense = free_run.sensitivity(
        made.increments, made.state, sensors, rows, first=made.first,
        gravity_offset=task.site.anomaly, held=task.held,
    )  # fmt: skip
    noise = free_run.spread(
        made.increments, made.state, Sensors.of(()), rows, np.zeros((9, 9)), task.noise,
        first=made.first, gravity_offset=task.site.anomaly, held=task.held,
    )  # fmt: skip
    return budget(
        made.increments.time[rows], sense, _aligned(task, made, vector),
        (vector.names, vector.values, vector.cov), made.start.phi_cov, noise,
        made.start.velocity_sd, made.start.position_sd,
    )  # fmt: skip


def _of_sensors(vector: CoefficientVector | None) -> tuple[Sensors, CoefficientVector]:
    """Return what of a calibration errors go with, in the order of the sensors; None: nothing."""
    names = () if vector is None else vector.names
    sensors = with_size_effect(
        Sensors.of(name for name in names if name not in SIZE_EFFECT),
        lever=any(name in LEVER for name in names), delay=any(name in OFFSET for name in names),
    )  # fmt: skip
    if vector is None:
        return sensors, CoefficientVector.zeros(sensors.layout)
    keep = [vector.layout.index(name) for name in sensors.layout.names]
    cov = None if vector.cov is None else vector.cov[np.ix_(keep, keep)]
    return sensors, CoefficientVector(sensors.layout, vector.values[keep], cov)


def _aligned(task: Task, made: Made, vector: CoefficientVector) -> FloatArray:
    """Return the start attitude error per unit of each coefficient, by aligning again."""
    out = np.zeros((3, len(vector)))
    if task.settings.attitude_given or not len(vector):
        return out
    rows = np.searchsorted(made.log.time, [task.seen.start, task.seen.end])
    # Rows beside the window feed the integration at its ends.
    rest = made.log[max(0, int(rows[0]) - 3) : int(rows[1]) + 4]
    for k, name in enumerate(vector.names):
        if name in SIZE_EFFECT:
            continue  # at rest there is none
        step = _step(name, rest, task.site.gravity)
        accel, gyro = _model(name, step).measure(*_readings(rest))
        shifted = replace(rest, accel=accel, gyro=gyro)
        found = start_of(shifted, task.site, task.seen, task.settings, task.noise)
        out[:, k] = -rotation_vector(found.C_nb @ made.start.C_nb.T) / step
    return out


def rest_check(task: Task, made: Made, vector: CoefficientVector | None) -> tuple[Check, ...]:
    """Test whether the rest at the start is what a calibration says, by all of its covariance.

    However a body stands, it reads gravity, and of the Earth's rate so much along up and across.
    """
    vector = _of_sensors(vector)[1]
    if vector.cov is None or not len(vector) or task.seen.end <= task.seen.start:
        return ()
    whole = increments_of(made.log, gaps=task.settings.gaps)
    part = whole[window(whole, task.seen.start, task.seen.end)]
    f, w, noise = measured_errors(part, sensor_errors(part, task.noise))
    rest = replace(made.log[:1], accel=f[None], gyro=w[None])
    of_force, of_rate = noise.mean_cov(float(part.dt.sum()))
    S, here = np.zeros((3, 3)), _seen(f, w)
    biases = ([f"{triad}.bias.{axis}" for axis in AXES] for triad in ("accel", "gyro"))
    for names, cov in zip((vector.names, *biases), (vector.cov, of_force, of_rate), strict=True):
        J = np.zeros((3, len(names)))
        for k, name in enumerate(names):
            if name not in SIZE_EFFECT:
                step = _step(name, rest, task.site.gravity)
                J[:, k] = (_seen(*_model(name, step).measure(f, w)) - here) / step
        S += J @ cov @ J.T
    S[0, 0] += task.site.gravity_sd**2
    assert task.site.latitude is not None
    level, up = earth.earth_rate_n(task.site.latitude)[1:]
    off = here - [task.site.gravity, up, level]
    # How much lies across up is off by no more than its two components are, wherever north is.
    most = chi_square_limits(1 + 1 + 2, 0.02)[1]  # only too large is a mistake
    unit = np.array([factor("ug", "specific force"), *2 * [factor("deg/h", "angular rate")]])
    force, along, across = (plain(x, 2) for x in off / unit)
    force_sd, up_sd, level_sd = (plain(x, 2) for x in np.sqrt(np.diag(S)) / unit)
    given = {"force": force, "up": along, "level": across,
             "force_sd": force_sd, "up_sd": up_sd, "level_sd": level_sd}  # fmt: skip
    square = normalised_square(off, S)
    return (check("rest at the start", "rest at the start", square, None, most, given),)


def _seen(f: FloatArray, w: FloatArray) -> FloatArray:
    """Return force, and rate along up and across, (3,), of `f`, `w` (3,) [m/s^2], [rad/s]."""
    size = float(np.linalg.norm(f))
    along = float(f @ w) / size
    return np.array([size, along, np.linalg.norm(w - along * f / size)])


def _model(name: str, value: float) -> ImuModel:
    return ImuModel.from_coefficients(CoefficientVector(LAYOUT.subset([name]), np.array([value])))


def _readings(rest: Log) -> tuple[FloatArray, FloatArray]:
    assert rest.accel is not None
    assert rest.gyro is not None
    return rest.accel, rest.gyro


def _step(name: str, rest: Log, gravity: float) -> float:
    """Return a step small enough for the response to be linear, large against rounding."""
    size = (gravity, EARTH_RATE)
    # Beside the readings gravity and rate along every axis, one of which may read nothing.
    probes = [
        np.concatenate([x, v * np.ones((1, 3))]) for x, v in zip(_readings(rest), size, strict=True)
    ]
    moved = _model(name, 1.0).measure(*probes)
    change = max(float(np.abs(m - x).max()) / v
                 for m, x, v in zip(moved, probes, size, strict=True))  # fmt: skip
    return SMALL / change


def not_stationary(
    reference: Reference | None, trajectory: Trajectory, errors: NavigationError | None
) -> str:
    """Return why the terms of free inertial drift cannot be fitted; empty where they can."""
    if reference is None or errors is None:
        return "there is nothing to compare with"
    if not np.isfinite(errors.position[:, :2]).all():
        return "the reference has no positions"
    if float(errors.age[-1]) < schuler.SHORTEST:
        return f"the run is shorter than {plain(schuler.SHORTEST)} s"
    if not reference.still:
        return "the instrument moved"
    some = trajectory.every(max(1, len(trajectory) // 500)).C_nb
    turned = np.linalg.norm(rotation_vector(some @ some[0].T), axis=-1).max()
    if turned > TURNS:
        return f"the instrument turned, by up to {plain(np.degrees(turned), 3)} deg"
    return ""


def schuler_of(
    site: Site, errors: NavigationError | None, noise: ImuNoise
) -> schuler.SchulerFit | None:
    """Fit the terms of free inertial drift to the error of a run that stood still."""
    if errors is None:
        return None
    assert site.latitude is not None
    place = Place(site.latitude, site.height, site.gravity)
    return schuler.fit(
        errors.age, errors.position[:, :2], place,
        gyro_white=max(noise.gyro.white, QUIETEST[0]),
        accel_white=max(noise.accel.white, QUIETEST[1]),
    )  # fmt: skip


def checks(
    errors: NavigationError | None, budget: Budget, noise_source: str, calibrated: bool
) -> tuple[Check, ...]:
    """Test whether the start is known, and whether the error is what was predicted.

    `errors` or None: error of the run; `calibrated`: without a calibration the prediction lacks
    the errors of the sensors.
    """
    sd = float(np.degrees(np.sqrt(budget.start[2, 2])))
    limit, name = float(np.degrees(POOR)), "heading at the start"
    out = [check(name, name, sd, None, limit, {"sd": plain(sd, 3)}, fails=Level.UNUSABLE)]
    ends = [] if errors is None else _ends(errors, budget)
    why = _lacking(bool(ends), budget, noise_source, calibrated)
    if why:  # nothing of it may look like a certificate
        key = "last epoch not judged" if ends else "not judged"
        given = {"why": why} | (_off(*ends[0]) if ends else {})
        out.append(check(key, "error at the last epoch", np.nan, given=given, passed=False))
        return tuple(out)
    for name, e, P, unit in ends:
        square = normalised_square(e, P)
        most = chi_square_limits(len(e), 0.02, len(ends))[1]  # only too large is a mistake
        given = _off(name, e, P, unit)
        out.append(check("last epoch", f"{name} at the last epoch", square, None, most, given))
    return tuple(out)


End = tuple[str, FloatArray, FloatArray, str]


def _ends(errors: NavigationError, budget: Budget) -> list[End]:
    """Return name, error, predicted covariance and unit of what is known at the last epoch."""
    last = budget.cov[-1]
    parts = [
        ("position", errors.position[-1, :2], last[6:8, 6:8], "m"),
        ("velocity", errors.velocity[-1, :2], last[3:5, 3:5], "m/s"),
        ("heading", np.degrees(errors.angles[-1, :1]),
         np.degrees(np.degrees(last[2:3, 2:3])), "deg"),
    ]  # fmt: skip
    return [(n, e, P, u) for n, e, P, u in parts if np.isfinite(e).all()]


def _lacking(compared: bool, budget: Budget, noise_source: str, calibrated: bool) -> str:
    """Return why a run cannot be judged; empty where it can."""
    if not compared:
        return "there is nothing to compare with at the last epoch"
    if not calibrated:
        return "without a calibration nothing is known of the errors of the sensors"
    if np.isnan(budget.sd).any():
        return "the calibration does not say how sure its coefficients are"
    return "the noise of the sensors is not known" if noise_source == "none" else ""


def _off(name: str, e: FloatArray, P: FloatArray, unit: str) -> dict[str, str]:
    size, sd = float(np.linalg.norm(e)), float(np.sqrt(np.trace(P)))
    return {"what": name.capitalize(), "off": plain(size, 3), "unit": unit, "sd": plain(sd, 3)}
