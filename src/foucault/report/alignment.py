"""What is said of a log that was aligned, and of the time offset of two logs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from foucault.coefficients import format_value
from foucault.models.ins_errors import azimuth_from_gyro_bias
from foucault.models.norths import North
from foucault.models.rotation import angles_of, turned
from foucault.procedures.alignment import Comparison
from foucault.procedures.delay import FoundDelay
from foucault.report import page
from foucault.report.headings import from_each_north
from foucault.units import convert, parse, plain

METHODS = {
    "inertial_frame": "inertial frame",
    "kalman": "Kalman, zero velocity",
    "two_vector": "two vectors",
    "two_position": "two positions",
}


def document(found: Comparison, name: str, norths: Sequence[North] = ()) -> page.Document:
    """Return the attitude by every method, side by side, and what limits it.

    `norths`: those that headings are given from, beside true north.
    """
    doubtful = any(item.severity == "warning" for item in found.findings)
    state, word = ("warning", "Something is doubtful") if doubtful else ("good", "North is seen")
    head = page.Heading(f"Alignment of {name}", [], state, word, [])
    limits = page.section("alignment.limits", _seen(found), _bias(found), _undeclared(found),
                     _sway(found))  # fmt: skip
    each = [(METHODS[one.method], float(one.angles[0]), float(one.angles_sd[0]))
            for one in found.found]  # fmt: skip
    return page.Document.of(
        head,
        _methods(found),
        from_each_north("method", each, norths),
        limits,
        page.findings(found.findings, "log"),
    )


def _methods(found: Comparison) -> page.Section | None:
    rows = []
    for one in found.found:
        both = zip(np.degrees(one.angles), np.degrees(one.angles_sd), strict=True)
        cells = [text for x, sd in both for text in (format_value(x, sd), f"{sd:.2g}")]
        rows.append([METHODS[one.method], *cells, f"{one.start:.1f} to {one.end:.1f}"])
    angles = [f"{angle} (deg): number | sd: number" for angle in ("heading", "pitch", "roll")]
    heads = page.columns("method", *angles, "window (s): number")
    return page.section("alignment.methods", page.Table(heads, rows))


def _seen(found: Comparison) -> str:
    return page.said(
        "alignment.limits.seen", rate=convert(found.rate_seen, "angular rate", "deg/h"),
        seen=np.degrees(found.latitude_seen), given=np.degrees(found.site.latitude or 0.0),
    )  # fmt: skip


def _bias(found: Comparison) -> str:
    if not found.gyro_bias_sd > 0:
        return ""
    bias = convert(found.gyro_bias_sd, "angular rate", "deg/h")
    limit = float(np.degrees(found.found[0].azimuth_bias_sd))
    return page.said("alignment.limits.bias", bias=plain(bias, 2), limit=plain(limit, 2))


def _sway(found: Comparison) -> str:
    sway = found.found[0].disturbance_sd
    if sway is None:
        return ""
    return page.said("alignment.limits.sway", sway=plain(1000 * float(np.mean(sway)), 2))


def _undeclared(found: Comparison) -> str:
    """Say what the biases would add that were not declared: the sds hold nothing of them."""
    gyro, accel = parse("0.01 deg/h", "angular rate"), parse("50 ug", "specific force")
    azimuth = float(np.degrees(azimuth_from_gyro_bias(gyro, found.site.latitude or 0.0)))
    level = float(np.degrees(accel / found.site.gravity))
    missing = [
        row for row, sd in (
            (("gyro bias", "--gyro-bias-sd",
              f"0.01 deg/h would add {plain(azimuth, 2)} deg of heading"), found.gyro_bias_sd),
            (("accelerometer bias", "--accel-bias-sd",
              f"50 ug would add {plain(level, 2)} deg of pitch and roll"), found.accel_bias_sd),
        ) if not sd > 0
    ]  # fmt: skip
    if not missing:
        return ""
    which, options, adds = zip(*missing, strict=True)
    bias = "bias" if len(missing) == 2 else which[0]
    return page.said(
        "alignment.limits.undeclared", bias=bias, options=", ".join(options), adds="; ".join(adds)
    )


# -- the time offset of two logs -------------------------------------------------------------


def offset(found: FoundDelay) -> page.Document:
    """Return the time offset of two logs, its drift, and how one lies in the axes of the other."""
    one = found.delay
    about = "" if not one.drift else f" at {one.middle - found.start:.1f} s"
    text = f"{format_value(1e3 * one.delay, 1e3 * one.delay_sd)} ± {1e3 * one.delay_sd:.2g} ms"
    level = found.verdict.level
    head = page.Heading(
        f"Delay: {text}{about}", [f"{100 * one.likeness:.3g} % of the turning is in both"],
        page.STATES[level], page.WORDS[level], list(found.verdict.reasons),
    )  # fmt: skip
    noticed = page.findings(found.findings, "logs")
    if one.delay_sd > 0 and not one.seen:
        return page.Document.of(head, noticed)
    return page.Document.of(head, _parts(found), _beside(found), noticed)


def _parts(found: FoundDelay) -> page.Section | None:
    one, start = found.delay, found.start
    wide = max(map(abs, one.bracket))  # A part that tells no more than where it was sought.
    rows = [
        [f"{a - start:.1f} to {b - start:.1f}",
         *((format_value(1e3 * x, 1e3 * sd), f"{1e3 * sd:.2g}") if sd < wide else ("not seen", ""))]
        for a, b, x, sd in zip(one.part_start, one.part_end, one.part_delay,
                               np.sqrt(np.diag(one.part_cov)), strict=True)
    ]  # fmt: skip
    clock = page.said("delay.parts.start", start=plain(start, 13)) if start else ""
    heads = page.columns("part (s) | delay (ms): number | sd: number")
    return page.section("delay.parts", clock, page.Table(heads, rows))


def _beside(found: FoundDelay) -> page.Section | None:
    one = found.delay
    heading, pitch, roll = np.degrees(turned(angles_of(one.C_ms)))
    sd = ", ".join(f"{x:.2g}" for x in np.degrees(np.sqrt(np.diag(one.mu_cov))))
    biases = [
        [convert(float(x), "angular rate", "deg/h") for x in row]
        for row in (one.bias, np.sqrt(np.diag(one.bias_cov)))
    ]
    bias = ", ".join(f"{format_value(x, s)} ± {s:.2g}" for x, s in zip(*biases, strict=True))
    late = ""
    if found.transport is not None:
        ms = 1e3 * np.asarray(found.transport)
        late = page.said("delay.beside.transport", mean=ms.mean(), least=ms.min(), most=ms.max())
    turn = page.said("delay.beside.mounting", heading=heading, pitch=pitch, roll=roll, sd=sd)
    return page.section("delay.beside", turn, page.said("delay.beside.bias", bias=bias), late)
