"""The certificate of a result: which instrument, where, when, by whom, with what, until when."""

from __future__ import annotations

import datetime
from typing import Any

import numpy as np

from foucault.diagnose.time_base import WORDS
from foucault.report.page import Facts, Section
from foucault.result import Result
from foucault.units import ZERO_CELSIUS

SLOW = np.radians(0.1)
"""Slower rates are those of a north seeker, in degrees per hour [rad/s]."""

KNOWN = ("name", "serial", "operator", "due", "note")
"""Keys of the instrument that the certificate shows."""


def certificate(result: Result) -> Section | None:
    """Who and what; lines to fill in by hand where the campaign does not say."""
    instrument, facts = result.instrument, result.provenance
    if not (instrument or facts or result.site):
        return None
    pairs = [
        ("instrument", _text(instrument, "name")),
        ("serial number", _text(instrument, "serial")),
        ("operator", _text(instrument, "operator")),
        ("date", date(str(facts["created"])) if facts.get("created") else ""),
        ("temperature", _temperature(result.validity)),
        ("next calibration due", _text(instrument, "due")),
        *_site(result.site),
        *_clock(result),
        *_covered(result),
        ("procedure", result.procedure),
        *_positions(result),
        ("software", _software(facts)),
        *_log(facts),
    ]
    if _text(instrument, "note"):
        pairs.append(("note", _text(instrument, "note")))
    return Section("Certificate", "", [Facts([*pairs, ("signature", "")])])


def _text(block: dict[str, Any], key: str) -> str:
    return str(block.get(key) or "").strip()


def date(text: str) -> str:
    """Write an ISO date for people; anything else stays as it is."""
    try:
        moment = datetime.datetime.fromisoformat(text)
    except ValueError:
        return text
    return f"{moment.day} {moment:%B %Y, %H:%M} {moment:%Z}".strip()


def place(site: dict[str, Any]) -> str:
    """Write latitude and height for people."""
    parts = []
    if site.get("latitude") is not None:
        degrees = float(np.rad2deg(site["latitude"]))
        parts.append(f"{abs(degrees):.4f}° {'N' if degrees >= 0 else 'S'}")
    if site.get("height"):
        parts.append(f"{site['height']:.0f} m")
    return ", ".join(parts)


def gravity(site: dict[str, Any]) -> str:
    """Write local gravity, its uncertainty and where it is from."""
    if site.get("gravity") is None:
        return ""
    sd = site.get("gravity_sd")
    known = f" ± {sd:.6f}".rstrip("0") if sd else ""
    source = f" ({site['gravity_source']})" if site.get("gravity_source") else ""
    return f"{site['gravity']:.5f}{known} m/s²{source}"


def _site(site: dict[str, Any]) -> list[tuple[str, str]]:
    rows = [("place", place(site)), ("local gravity", gravity(site))]
    return [(what, words) for what, words in rows if words]


def _clock(result: Result) -> list[tuple[str, str]]:
    """Whose clock counted the time, and how well its rate is known."""
    base = result.clock
    if base is None or base.source == "several":
        return []
    known = "declared" if base.declared else "usual for it"
    return [("time base", f"{WORDS[base.source]} ± {base.sd * 1e6:.3g} ppm ({known})")]


def _temperature(validity: dict[str, Any]) -> str:
    """Return the range in °C, empty where the log has no temperature."""
    span = validity.get("temperature")
    if not span or any(v is None for v in span):
        return ""
    low, high = (v - ZERO_CELSIUS for v in span)
    mean = validity.get("temperature_mean")
    words = f"{low:.1f} to {high:.1f} °C"
    words = words if mean is None else f"{words}, mean {mean - ZERO_CELSIUS:.1f} °C"
    return words.replace("-", "−")


def _covered(result: Result) -> list[tuple[str, str]]:
    """The ranges outside which the result is extrapolated; of a triad that was calibrated."""
    rows = []
    triads = {name.partition(".")[0] for name in result.coefficients.names}
    for key, what, size, unit in (
        ("accel", "specific force covered", 1.0, "m/s²"),
        ("gyro", "rates covered", np.pi / 180, "°/s"),
    ):
        span = result.validity.get(key) if key in triads else None
        if span and None not in span:
            if key == "gyro" and max(map(abs, span)) < SLOW:
                size, unit = size / 3600, "°/h"
            low, high = (f"{v / size:.3g}".replace("-", "−") for v in span)
            rows.append((what, f"{low} to {high} {unit}"))
    return rows


def _positions(result: Result) -> list[tuple[str, str]]:
    """Plan, rests and spins of a session on a table."""
    table = result.tables.get("readings")
    if table is None or "outer" not in table:
        return []
    rate, turns = np.asarray(table["rate"], float), np.asarray(table["turns"], float)
    spin = rate != 0.0
    words = [_counted(int(np.sum(~spin)), "rest")] if not spin.all() else []
    if spin.any():
        each = " to ".join(f"{v:.0f}" for v in np.unique([turns[spin].min(), turns[spin].max()]))
        sizes = np.unique(np.round(np.degrees(rate[spin]), 3)).tolist()
        rates = ", ".join(f"{v:.4g}" for v in sizes).replace("-", "−")
        whole = f"{each} turn{'' if each == '1' else 's'}"
        words.append(f"{_counted(int(spin.sum()), 'spin')} of {whole} at {rates} °/s")
    rows = [("readings", ", ".join(words))]
    plan = str(result.diagnostics.get("plan") or "")
    return [("positions", plan), *rows] if plan else rows


def _counted(n: int, what: str) -> str:
    return f"{n} {what}{'s' * (n != 1)}"


def _software(facts: dict[str, Any]) -> str:
    version = facts.get("versions", {}).get("foucault")
    return f"Foucault {version}" if version else "Foucault"


def _log(facts: dict[str, Any]) -> list[tuple[str, str]]:
    """The first input file; provenance has all of it."""
    one: dict[str, Any] = facts.get("input") or next(iter(facts.get("inputs") or []), {})
    if not one.get("file"):
        return []
    digest = f", SHA-256 {one['sha256'][:12]}…" if one.get("sha256") else ""
    return [("log", f"{one['file']}{digest}")]
