"""North from a navigation unit that stood still: its horizontal gyros as those of a north seeker.

The LN-100 of the log has its x axis up. With right = -z, forward = y, up = x (a rotation: right
times forward is up) the means of the two horizontal gyros and accelerometers are the four numbers
of a set-up, and the heading of the case is the azimuth of the unit's y axis. The unit does not
turn, so that nothing cancels its biases; its third gyro checks what the two say. Noise is measured
in the log: the Allan deviation falls as 1/tau, as that of angles that are off by Q at both ends of
every mean, ``ADEV = sqrt(3) Q / tau``; a mean over T then has the sd ``sqrt(2) Q / T``. The curve
has bumps, so that the largest Q of all averaging times is taken.

The log is looked for under $FOUCAULT_DATA (default ../shared/data).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from common import DATA, must

from foucault.coefficients import CoefficientVector
from foucault.diagnose.allan import measure_log
from foucault.estimate.north import Fixes, Known, solve
from foucault.estimate.north_reduction import Pairs
from foucault.infer.gauss_newton import FALSE_ALARM, chi_square_limits
from foucault.logs import LogDescription, read
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.north_seeker import SEEKER, Compensation
from foucault.tables import Log

DPH = np.pi / 648000
SITE = Site.at(np.radians(51.08))
REFERENCE = {"azimuth": (7.33, 7.29), "rate": 14.755, "latitude": 51.0826}
"""Of other programs: two-vector azimuth, two alignments; |w| [deg/h]; latitude [deg]."""
DESCRIPTION = {
    "file": "x_LN100_up.ins",
    "record": {"type": "float64", "columns": 7},
    "time": {"column": 0, "unit": "s"},
    "gyro": {"columns": [1, 2, 3], "unit": "deg/s"},
    "accel": {"columns": [4, 5, 6], "unit": "m/s^2"},
}
C_bu = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
"""Maps the unit's axes to right, forward, up."""
PARTS = (2, 3, 5, 10, 20, 30)
LIMIT = float(np.sqrt(chi_square_limits(1, 2 * FALSE_ALARM)[1]))
"""Of a standardized difference, 1 % false alarms."""
SCALES = ("gyro.scale.x", "gyro.scale.y")


def end_errors(log: Log) -> np.ndarray:
    """Angle and velocity errors at the ends of a mean, right, forward, up: (2, 3) [rad], [m/s]."""
    channels = measure_log(log).channels
    names = [[f"{triad}.{axis}" for axis in "xyz"] for triad in ("gyro", "accel")]
    Q = [[np.max(channels[n].tau * channels[n].deviation) for n in row] for row in names]
    return np.array(Q) / np.sqrt(3) @ np.abs(C_bu).T


def means(log: Log, parts: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Means of rate and specific force over each part, (parts, 3) each, and its length [s]."""
    each = len(log) // parts
    x = [v[: parts * each].reshape(parts, each, 3).mean(axis=1) @ C_bu.T
         for v in (log.gyro, log.accel)]  # fmt: skip
    return x[0], x[1], each * log.interval


def pairs_of(w: np.ndarray, f: np.ndarray, sd: np.ndarray) -> Pairs:
    """The two horizontal axes of each, with sd (2, 3) of gyros and accelerometers."""
    m, sources = len(w), {}
    for k, name in enumerate(("gyro noise", "tilt: noise")):
        cov = np.zeros((m, 4, 4))
        cov[:, [2 * k, 2 * k + 1], [2 * k, 2 * k + 1]] = sd[k, :2] ** 2
        sources[name] = cov
    none = np.zeros(m)
    return Pairs(np.hstack([w[:, :2], f[:, :2]]), sources, none, none, np.zeros((m, 4)), none, none,
                 none, np.zeros((m, 2)), np.zeros((m, 2), np.int64))  # fmt: skip


def from_vectors(w: np.ndarray, f: np.ndarray, sd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Latitude of three gyros and gravity, ``asin(w . u / |w|)``, and its sd, (m,) [rad]."""
    u = f / np.linalg.norm(f, axis=1, keepdims=True)
    size = np.linalg.norm(w, axis=1, keepdims=True)
    along = np.sum(w * u, axis=1, keepdims=True)
    latitude = np.arcsin(along / size)
    slope = (u - along / size**2 * w) / (size * np.cos(latitude))
    return latitude[:, 0], np.sqrt(np.sum((slope * sd[0]) ** 2, axis=1))


def common_scale(value: float, sd: float) -> Compensation:
    """A scale factor error that both gyros share."""
    layout = SEEKER.subset(SCALES)
    return Compensation(CoefficientVector(layout, np.full(2, value), np.full((2, 2), sd**2)))


def fixes(w: np.ndarray, f: np.ndarray, sd: np.ndarray) -> tuple[Fixes, Fixes]:
    """With the latitude of the place, and without it; the gyros' common scale is what |w| says."""
    known = Known(float(np.linalg.norm(f, axis=1).mean()), SITE.latitude)
    scale = float(np.linalg.norm(w, axis=1).mean()) / EARTH_RATE - 1
    share = float(np.linalg.norm(sd[0])) / EARTH_RATE
    pairs = pairs_of(w, f, sd)
    return (
        solve(pairs, known, common_scale(scale, share)),
        solve(pairs, replace(known, latitude=None), common_scale(scale, share)),
    )


def scatter_rows(log: Log, Q: np.ndarray) -> tuple[list[str], bool]:
    """Scatter of parts of the log over their sd."""
    lines = ["| parts of | quantity | scatter | sd | sum of squares over sd | must be below | "
             "covered |", "|--:|---|--:|--:|--:|--:|---|"]  # fmt: skip
    good, tests = True, 3 * len(PARTS)
    for parts in PARTS:
        w, f, time = means(log, parts)
        sd = np.sqrt(2) * Q / time
        latitude, latitude_sd = from_vectors(w, f, sd)
        known = fixes(w, f, sd)[0]
        size = np.linalg.norm(w, axis=1)
        size_sd = np.sqrt(np.sum((w / size[:, None] * sd[0]) ** 2, axis=1))
        for name, x, x_sd in (
            ("azimuth [deg]", azimuth_of(known), np.degrees(known.sd[:, 0])),
            ("latitude, vectors [deg]", np.degrees(latitude), np.degrees(latitude_sd)),
            ("rate [deg/h]", size / DPH, size_sd / DPH),
        ):
            square = float(np.sum((x - x.mean()) ** 2 / x_sd**2))
            # Twice the false alarm, as only the upper one of the two limits is asked for.
            limit = chi_square_limits(parts - 1, 2 * FALSE_ALARM, tests)[1]
            good &= square < limit
            lines.append(
                f"| {time:.0f} s | {name} | {x.std(ddof=1):.3f} | {np.sqrt(np.mean(x_sd**2)):.3f} "
                f"| {square:.2f} | {limit:.1f} | {must(square < limit)} |"
            )
    return lines, good


def azimuth_of(found: Fixes) -> np.ndarray:
    """Heading between -180 and 180 deg."""
    return np.degrees((found.angles[:, 0] + np.pi) % (2 * np.pi) - np.pi)


def page(log: Log) -> tuple[list[str], bool]:
    Q = end_errors(log)
    lines = [
        "| part | azimuth of y [deg] | sd | latitude, two gyros [deg] | sd | latitude, vectors "
        "[deg] | sd | rate [deg/h] | sd |",
        "|---|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for parts in (3, 1):
        w, f, time = means(log, parts)
        sd = np.sqrt(2) * Q / time
        known, unknown = fixes(w, f, sd)
        latitude, latitude_sd = from_vectors(w, f, sd)
        size = np.linalg.norm(w, axis=1)
        size_sd = np.sqrt(np.sum((w / size[:, None] * sd[0]) ** 2, axis=1))
        azimuth, azimuth_sd = azimuth_of(known), np.degrees(known.sd[:, 0])
        for i in range(parts):
            cells = (azimuth[i], azimuth_sd[i], np.degrees(unknown.angles[i, 3]),
                     np.degrees(unknown.sd[i, 3]), np.degrees(latitude[i]),
                     np.degrees(latitude_sd[i]), size[i] / DPH, size_sd[i] / DPH)  # fmt: skip
            name = "all" if parts == 1 else f"third {i + 1}"
            lines.append(f"| {name} | {' | '.join(f'{c:.3f}' for c in cells)} |")
    notes, good = whole(azimuth[0], azimuth_sd[0], latitude[0], latitude_sd[0], size[0],
                        size_sd[0], known)  # fmt: skip
    scatter, covered = scatter_rows(log, Q)
    arcsec = ", ".join(f"{q * 648000 / np.pi:.2f}" for q in Q[0])
    out = [
        f"Angle error at the ends of a mean, measured in the log: {arcsec} arcsec (right, forward, "
        "up).",
        "",
        *lines,
        "",
        *notes,
        "",
        f"Scatter of the parts of the log, {100 * FALSE_ALARM:g} % false alarms for all together:",
        "",
        *scatter,
    ]
    return out, good and covered


def whole(azimuth, azimuth_sd, latitude, latitude_sd, size, size_sd, known) -> tuple[list, bool]:
    """What the whole file says beside the references."""
    place = SITE.latitude
    assert place is not None
    missing = (latitude - place) / latitude_sd
    off = [abs(azimuth - a) / azimuth_sd for a in REFERENCE["azimuth"]]
    scale = size / EARTH_RATE - 1
    others = " and ".join(
        f"{a} ({o:.1f} sd)" for a, o in zip(REFERENCE["azimuth"], off, strict=True)
    )
    lines = [
        f"* Azimuth {azimuth:.3f} ± {azimuth_sd:.3f} deg; other programs {others}.",
        f"* Rate {size / DPH:.3f} ± {size_sd / DPH:.3f} deg/h, other programs "
        f"{REFERENCE['rate']}; the Earth's is {EARTH_RATE / DPH:.3f}. The log shows "
        f"{100 * scale:+.2f} %, {abs(scale) * EARTH_RATE / size_sd:.0f} sd.",
        f"* The third gyro: latitude {np.degrees(latitude):.4f} deg from the three gyros, "
        f"{missing:+.2f} sd from the place's {np.degrees(place):.2f}, other programs "
        f"{REFERENCE['latitude']}. "
        + (
            "All three lack the same share: their common scale, which is taken out here."
            if abs(missing) < LIMIT
            else "The three do not lack the same share: biases."
        ),
        f"* Against the Earth's rate at that latitude the two gyros then leave "
        f"{known.square[0]:.2f} (chi-square, one degree of freedom).",
    ]
    good = (
        max(off) < LIMIT and abs(missing) < LIMIT
        and abs(size / DPH - REFERENCE["rate"]) < 5e-4
        and abs(np.degrees(latitude) - REFERENCE["latitude"]) < 5e-4
        and known.square[0] < chi_square_limits(1)[1]
    )  # fmt: skip
    return lines, bool(good)


def main() -> tuple[bool, dict[str, object]]:
    if not (DATA / "ln100_static").is_dir():
        print(f"skipped: {DATA / 'ln100_static'} is missing; set FOUCAULT_DATA")
        return None
    log = read(LogDescription.model_validate(DESCRIPTION), DATA / "ln100_static")
    lines, good = page(log)
    return good, {"duration": log.duration, "lines": lines}
