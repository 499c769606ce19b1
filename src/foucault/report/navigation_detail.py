"""What the page of a navigation says: numbers, motion, start, and what it was made from."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from foucault import units
from foucault.arrays import FloatArray
from foucault.diagnose.navigation.errors import circular_error
from foucault.report import certificate, ends
from foucault.report import figures_navigation as figures
from foucault.report.ends import check_table, words
from foucault.report.figures import FIRST, SECOND
from foucault.report.north_detail import angle_unit, check_of, signed
from foucault.report.page import Block, Column, Facts, Figure, Section, Table
from foucault.report.uncertainty import shown
from foucault.units import plain

if TYPE_CHECKING:
    from foucault.campaign.navigation.folder import NavigationRecord

Table_ = Mapping[str, npt.NDArray[Any]]

TINY = 0.001
"""Numbers of a smaller size are not written out [any]."""

METHODS = {
    "inertial_frame": "inertial frame",
    "two_vector": "two vectors",
    "kalman": "Kalman, zero velocity",
    "given": "given",
    "level and given heading": "levelled at rest, heading given",
}
"""Method of alignment -> words."""


class Seen:
    """A record with what the page needs of it at hand."""

    def __init__(self, record: NavigationRecord) -> None:
        self.about = record.about
        self.tables = record.tables

    @cached_property
    def names(self) -> list[str]:
        """Names of the runs that have a path."""
        some = ["trajectory", "trajectory_without"]
        return [r["name"] for r, t in zip(self.about["runs"], some, strict=False)
                if t in self.tables]  # fmt: skip

    @property
    def still(self) -> bool:
        """Whether it stood at a known site."""
        return bool((self.about["reference"] or {}).get("still"))

    @property
    def errors(self) -> Table_ | None:
        """Table of the errors, where there are any."""
        return self.tables.get("errors")

    @property
    def calibrated(self) -> bool:
        """Whether the errors of the sensors are in what was predicted."""
        return bool(self.about["calibration"])

    @property
    def predicted(self) -> str:
        """What the predicted error is to be called."""
        return "predicted" if self.calibrated else "noise and alignment alone"

    @property
    def by_what(self) -> str:
        """What is predicted, or by what."""
        return "as predicted" if self.calibrated else "by noise and alignment alone"

    def path(self, run: int) -> Table_:
        """Return the trajectory of a run."""
        return self.tables[("trajectory", "trajectory_without")[run]]

    def growth(self, run: int) -> Sequence[Mapping[str, Any]]:
        """Return the errors of a run at some ages; empty where there are none."""
        runs = self.about["runs"]
        return runs[run]["growth"] if run < len(runs) else []


def metres(value: float) -> str:
    """Write a distance [m] for people."""
    unit, size = figures.length_unit(abs(value))
    return f"{plain(value / size, 3)} {unit}"


def minutes(seconds: float) -> str:
    """Write a time [s] for people."""
    unit, size = figures.time_unit(seconds * (1 + 1e-6) if seconds >= 60 else 0.0)
    if 60 <= seconds <= 300:
        unit, size = "min", 60.0
    return f"{plain(seconds / size, 3)} {unit}"


def number(value: float | None) -> str:
    """Write a number to three digits, empty where there is none."""
    if value is None or not math.isfinite(value):
        return ""
    if 0 < abs(value) < TINY:
        return f"< {TINY}"
    return signed(plain(value, 3))


def in_words(seen: Seen) -> list[str]:
    """Say in a sentence or two what was found."""
    out = []
    runs, end = seen.about["runs"], seen.about["predicted"]["all"]
    rate = runs[0].get("radial_rate")
    if rate and rate["nmi/h"] is not None:
        out.append(f"Radial error over time: {plain(rate['nmi/h'], 3)} nmi/h (root mean square).")
    checks = seen.about["checks"]
    if len(checks) > 1:
        out.append(f"All {len(checks)} checks passed.")
    if seen.about["reference"] is None:
        out.append("Nothing was compared: there is no reference.")
    if not seen.calibrated:
        out.append("Nothing is known of the errors of the sensors: there is no calibration.")
    elif end["cep"]:
        age = minutes(seen.about["predicted"]["age"])
        out.append(f"Half of all such runs end within {metres(end['cep'])} after {age}.")
    return out


def numbers_of(seen: Seen) -> list[tuple[str, str]]:
    """Return what the map does not say in numbers."""
    about = seen.about
    out = [("navigated for", minutes(about["duration"]))]
    for k, run in enumerate(about["runs"]):
        rows = seen.growth(k)
        if rows and rows[-1]["horizontal"] is not None:
            east, north = run["end"]["east"], run["end"]["north"]
            text = f"{metres(rows[-1]['horizontal'])} ({metres(east)} east, {metres(north)} north)"
            out.append((f"at the end, {run['name']}", signed(text)))
    for run in about["runs"]:
        rate = run.get("radial_rate")
        if rate and rate["nmi/h"] is not None:
            text = f"{plain(rate['nmi/h'], 3)} nmi/h, {plain(rate['m/s'] * 3600, 3)} m/h"
            out.append((f"radial error over time, {run['name']}", text))
    end = about["predicted"]["all"]
    if end["cep"]:
        out.append((f"{seen.predicted}, half of all runs end within", metres(end["cep"])))
        text = f"{metres(end['east_sd'])} east, {metres(end['north_sd'])} north"
        out.append((f"{seen.predicted}, sd at the end", text))
    if about["settings"]["vertical"] == "held":
        out.append(("vertical channel", "height held"))
    else:
        out.append(("vertical channel", str(about["settings"]["vertical"])))
    return out


def spread(seen: Seen, count: int, about_path: bool) -> list[tuple[float, float, FloatArray]]:
    """Return centre and covariance of the predicted error at some ages."""
    b = seen.tables["budget"]
    rows = np.linspace(0, len(b["time"]) - 1, count + 1).round().astype(int)[1:]
    path = seen.path(0)
    out = []
    for i in rows:
        cov = np.array([[b["cov_east_east"][i], b["cov_east_north"][i]],
                        [b["cov_east_north"][i], b["cov_north_north"][i]]])  # fmt: skip
        at = [float(np.interp(b["time"][i], path["time"], path[c])) if about_path else 0.0
              for c in ("east", "north")]  # fmt: skip
        out.append((at[0], at[1], cov))
    return out


def marks(seen: Seen, path: Table_) -> list[tuple[str, float, float]]:
    """Return ages to mark on the path, some five of them."""
    age = path["time"] - path["time"][0]
    step = next((60 * t for t in figures.TICKS if age[-1] / (60 * t) <= 6), 86400)
    at = np.arange(step, age[-1], step)
    east, north = (np.interp(at, age, path[c]) for c in ("east", "north"))
    reach = max(float(np.ptp(path["east"])), float(np.ptp(path["north"])), 1e-9)
    out: list[tuple[str, float, float]] = []
    for t, e, n in zip(at, east, north, strict=True):
        if all(math.hypot(e - x, n - y) > 0.12 * reach for _, x, y in [*out, ("", 0.0, 0.0)]):
            out.append((minutes(float(t)), float(e), float(n)))
    return out


def half(e: Table_) -> FloatArray:
    """Return the radius that holds half of all errors, as predicted [m]."""
    cov = np.array([[e["cov_east_east"], e["cov_east_north"]],
                    [e["cov_east_north"], e["cov_north_north"]]])  # fmt: skip
    return circular_error(np.moveaxis(cov, -1, 0))


def half_at(seen: Seen, age: float) -> float | None:
    """Return that radius at an age [s]."""
    e = seen.errors
    return None if e is None else float(np.interp(age, e["age"], half(e)))


def growth_figure(seen: Seen, unit: tuple[str, float], share: int) -> Figure:
    """Draw the horizontal error on logarithmic axes: its slope tells its kind."""
    e = seen.errors
    assert e is not None
    lines = []
    for k, before in enumerate(("", "without_")[: len(seen.names)]):
        if f"{before}east" in e:
            y = np.hypot(e[f"{before}east"], e[f"{before}north"])
            lines.append((seen.names[k], y, (FIRST, SECOND)[k]))
    return figures.logarithmic(e["age"], lines[::-1], (seen.predicted, half(e)), unit, share)


def error_panels(seen: Seen, unit: tuple[str, float]) -> list[Block]:
    """East, north, up, velocity and heading errors with their bands."""
    e = seen.errors
    assert e is not None
    panels: list[tuple[str, FloatArray, FloatArray, FloatArray | None]] = []
    position = [("east", "east_east"), ("north", "north_north")]
    position += [("up", "up_up")] if seen.about["settings"]["vertical"] == "free" else []
    largest = max(
        [float(np.nanmax(np.abs(e[a]), initial=0.0)) for a, _ in position]
        + [2 * float(np.sqrt(e["cov_east_east"][-1]))]
    )
    name, size = figures.length_unit(largest)
    for a, c in position:
        if np.isfinite(e[a]).any():
            other = e.get(f"without_{a}")
            panels.append((f"{a} [{name}]", e[a] / size, np.sqrt(e[f"cov_{c}"]) / size,
                           None if other is None else other / size))  # fmt: skip
    for a in ("velocity_east", "velocity_north"):
        if np.isfinite(e[a]).any():
            title = f"{a.replace('velocity_', 'v ')} [m/s]"
            panels.append((title, e[a], np.sqrt(e[f"cov_{a}"]), e.get(f"without_{a}")))
    if np.isfinite(e["heading"]).any():
        panels.append(("heading [°]", np.degrees(e["heading"]),
                       np.degrees(np.sqrt(e["cov_phi_up"])),
                       _degrees(e.get("without_heading"))))  # fmt: skip
    if not panels:
        return []
    alt = "Errors against time with the bands of one and two standard deviations"
    names = (seen.names[0], "without calibration")
    return [figures.banded(e["age"], panels, unit, 150, alt, names, seen.predicted)]


def _degrees(x: Any) -> FloatArray | None:
    return None if x is None else np.degrees(x)


def motion(seen: Seen) -> Section:
    """Velocity, attitude and height of the path."""
    path = seen.path(0)
    age = path["time"] - path["time"][0]
    unit = figures.time_unit(float(age[-1]))
    velocity = [(a, path[f"velocity_{a}"]) for a in ("east", "north", "up")]
    if seen.about["settings"]["vertical"] != "free":
        del velocity[2]
    heading = np.degrees(np.unwrap(path["heading"]))
    level = [(a, np.degrees(path[a])) for a in ("pitch", "roll")]
    panels: list[Any] = [("velocity [m/s]", velocity), ("heading [°]", [("heading", heading)]),
                         ("pitch, roll [°]", level)]  # fmt: skip
    if seen.about["settings"]["vertical"] != "held":
        panels.append(("height [m]", [("height", path["height"])]))
    figure = figures.series(age, panels, unit, 150, "Velocity, attitude and height against time")
    lead = f"As navigated, {seen.names[0]}."
    return Section("Velocity and attitude", lead, [figure])


def start(seen: Seen) -> Section:
    """How each run was aligned."""
    columns = [
        Column("run"), Column("heading [°]", "number"), Column("± sd", "number"),
        Column("pitch [°]", "number"), Column("roll [°]", "number"), Column("± sd", "number"),
        Column("found by", aside=True),
    ]  # fmt: skip
    rows = []
    for run in seen.about["runs"]:
        s = run["start"]
        sd = np.degrees(np.sqrt(np.diag(np.array(s["covariance"], float))))
        rows.append([
            run["name"],
            *(signed(f"{np.degrees(s['heading']):.4f}").split()), _sd(sd[2]),
            signed(f"{np.degrees(s['pitch']):.4f}"), signed(f"{np.degrees(s['roll']):.4f}"),
            _sd(float(np.hypot(sd[0], sd[1]) / math.sqrt(2))),
            METHODS.get(s["method"], s["method"]),
        ])  # fmt: skip
    opening = seen.about["opening"]
    lead = "Standard deviations are those of sensor noise and of what was given"
    if opening["end"] > opening["start"]:
        lead = f"Aligned at rest for {minutes(opening['end'] - opening['start'])}. {lead}"
    if seen.calibrated:
        lead += ", with calibration those of its coefficients too"
    lead += "; those of errors that are not calibrated are not known. Heading is clockwise "
    lead += "from north, pitch nose up, roll right side down."
    return Section("Start", lead, [Table(columns, rows)])


def _sd(degrees: float) -> str:
    return angle_unit(degrees).words(degrees)


def checks(seen: Seen) -> Section | None:
    """Every test that the verdict rests on."""
    rows = tuple(check_of(c) for c in seen.about["checks"])
    lead = "Every test that the verdict rests on."
    return Section("Checks", lead, [check_table(rows)]) if rows else None


def known(seen: Seen) -> Section:
    """Noise, place, reference and calibration."""
    about = seen.about
    noise, site = about["noise"], about["site"]
    pairs = [("noise", str(noise["source"]))]
    for sensor, kind in (("gyro", "angle random walk"), ("accel", "velocity random walk")):
        white = noise[sensor]["white"]
        unit = units.display_unit(kind, white)
        pairs.append((f"white noise, {sensor}",
                      f"{plain(units.convert(white, kind, unit), 3)} {shown(unit)}"))  # fmt: skip
    pairs += [("place", certificate.place(site)), ("local gravity", certificate.gravity(site))]
    reference = about["reference"]
    if reference is None:
        pairs.append(("compared with", "nothing"))
    else:
        what = "the known site" if reference["still"] else str(reference.get("file", "reference"))
        pairs.append(("compared with", what))
    used = about["calibration"]
    if used:
        instrument = used.get("instrument") or {}
        name = " ".join(str(instrument[k]) for k in ("name", "serial") if instrument.get(k))
        text = f"{used['procedure']}, {used['verdict']}, {used['coefficients']} coefficients"
        made = certificate.date(str(used.get("created") or ""))
        pairs += [("calibration", text), ("of instrument", name), ("made", made)]
    return Section("What was known before", "", [Facts([p for p in pairs if p[1]])])


def made_from(seen: Seen) -> Section:
    """Files, settings and versions."""
    made = seen.about["provenance"]
    rows = [["created", str(made.get("created", ""))], ["seconds", str(made.get("seconds", ""))]]
    rows += [[f"log: {k}", words(v)] for k, v in (made.get("input") or {}).items()]
    for what in ("calibration", "reference"):
        rows += [[f"{what}: {k}", words(v)] for k, v in (made.get(what) or {}).items()]
    settings = {k: v for k, v in seen.about["settings"].items() if v is not None}
    rows.append(["settings [SI]", words(settings)])
    rows.append(["versions", words(made.get("versions") or {})])
    return ends.provenance(rows)
