"""How north was sought: dwells, noise, place, calibration, files and versions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from foucault import units
from foucault.coefficients import format_value
from foucault.report import certificate, ends
from foucault.report.ends import words
from foucault.report.north_detail import SENSORS, Setup, angle_unit, signed
from foucault.report.page import Block, Column, Facts, Section, Table
from foucault.report.uncertainty import shown
from foucault.units import plain

MOST_ROWS = 40
"""Dwells that are listed [1]."""


def measured(setup: Setup) -> Section:
    """Stops, their order and how long they took."""
    d, said = setup.dwells, setup.said
    order = [f"{v:.4g}" for v in np.degrees(d["index"]) % 360]
    times = d["time"]
    each = " to ".join(
        f"{plain(v, 4)}" for v in dict.fromkeys((float(times.min()), float(times.max())))
    )
    few = len(order) <= MOST_ROWS
    pairs = [
        ("dwells", f"{said['dwells']} of {each} s"),
        ("measured", f"{plain(said['measured'] / 60, 3)} min of {plain(said['duration'] / 60, 3)}"),
        ("order of the index angles", f"{', '.join(order)}°" if few else f"{order[0]}° and on"),
        ("accelerometers", _accelerometers(d)),
        ("offset of the gyro", _rate(said["gyro_offset"])),
        ("drift of the gyro", _drift(setup)),
        ("1 °/h/h of drift, if not estimated", _drift_effect(said["drift_effect"])),
    ]
    blocks: list[Block] = [Facts([p for p in pairs if p[1]])]
    if few:
        blocks.append(_dwell_table(setup))
    return Section("How it was measured", "", blocks)


def _accelerometers(d: Mapping[str, Any]) -> str:
    if "accel" in d:
        return "one, turning with the gyro"
    return "two, fixed to the case" if "accel_x" in d else "none"


def _rate(value: float | None) -> str:
    return "" if value is None else signed(f"{3600 * math.degrees(value):.4g} °/h")


def _drift(setup: Setup) -> str:
    sd = setup.about["drift_sd"]
    if sd == 0:
        return "not estimated"
    value = setup.said["gyro_drift"]
    text = "" if value is None else signed(f"{3600**2 * math.degrees(value):.3g} °/h/h")
    return text if sd == "free" else f"{text}, weighed"


def _drift_effect(value: float | None) -> str:
    if value is None:
        return ""
    degrees = math.degrees(value)
    moved = angle_unit(abs(degrees)).words(abs(degrees)) if abs(degrees) > 1e-7 else "nothing"
    return f"would move the heading by {moved}"


def _dwell_table(setup: Setup) -> Table:
    d = setup.dwells
    second = "accel_residual" in d
    columns = [
        Column("index [°]", "number"), Column("start [s]", "number"),
        Column("length [s]", "number", aside=True), Column("gyro [°/h]", "number"),
        Column("residual / sd", "number"),
    ]  # fmt: skip
    columns += [Column("accelerometer residual / sd", "number", aside=True)] * second
    rate = 3600 * np.degrees(d["gyro"])
    sd = 3600 * np.degrees(d["gyro_sd"])
    rows = []
    for i in range(len(rate)):
        cells = [f"{np.degrees(d['index'][i]) % 360:.2f}", f"{d['start'][i]:.1f}"]
        cells += [f"{d['time'][i]:.4g}", signed(format_value(rate[i], sd[i]))]
        cells.append(_residual(d["residual"][i]))
        cells += [_residual(d["accel_residual"][i])] if second else []
        rows.append(cells)
    return Table(columns, rows)


def _residual(value: float) -> str:
    return signed(f"{value:+.2f}") if np.isfinite(value) else "not tested"


def made_from(about: Mapping[str, Any]) -> list[Section | None]:
    """Noise, place, calibration and provenance."""
    return [_known(about), _calibration(about), _provenance(about)]


def _known(about: Mapping[str, Any]) -> Section:
    noise, known, site = about["noise"], about["known"], about["site"]
    pairs = [("noise", str(noise["source"]))]
    for sensor, kind in (("gyro", "angle random walk"), ("accel", "velocity random walk")):
        white = noise[sensor]["white"]
        unit = units.display_unit(kind, white)
        text = f"{plain(units.convert(white, kind, unit), 3)} {shown(unit)}"
        pairs.append((f"white noise, {SENSORS[sensor][1]}", text))
        slow = noise[sensor]["bias_instability"], noise[sensor]["random_walk"]
        if any(slow):
            pairs.append((f"slow noise, {SENSORS[sensor][1]}", "declared"))
    if known["latitude"] is None:
        pairs.append(("latitude", f"unknown, {known['hemisphere']}ern hemisphere"))
    elif isinstance(known["latitude"], list):
        low, high = (signed(f"{math.degrees(f(known['latitude'])):.5g}") for f in (min, max))
        pairs.append(("latitude", f"of each set‑up, {low}° to {high}°"))
    else:
        sd = math.degrees(known["latitude_sd"] or 0.0)
        near = f" ± {angle_unit(sd).words(sd)}" if sd > 1e-6 else ""
        place = signed(f"{math.degrees(known['latitude']):.5g}")
        pairs.append(("latitude", f"{place}°{near}"))
    if len({*np.atleast_1d(known["gravity"])}) > 1:
        pairs.append(("local gravity", "normal gravity at the latitude of each set‑up"))
    else:
        pairs.append(("local gravity", certificate.gravity(site)))
    if known["near"] is not None:
        pairs.append(("rough heading given", f"{math.degrees(known['near']):.4g}°"))
    if known["level_sd"] is not None:
        sd = math.degrees(known["level_sd"])
        pairs.append(("levelled to", angle_unit(sd).words(sd)))
    return Section("What was known before", "", [Facts([p for p in pairs if p[1]])])


def _calibration(about: Mapping[str, Any]) -> Section | None:
    coefficients = about["coefficients"]
    without = ""
    if not about["calibration"]:
        without = (
            "None was used: bias, scale factors and coupling count as zero, and the uncertainty "
            "knows nothing of them"
        )
        if not coefficients:
            return Section("Calibration", without + ".", [])
        without += " but what was known before:"
    from foucault.models.imu import LAYOUT

    rows = []
    for name, row in coefficients.items():
        kind = LAYOUT.coefficients[LAYOUT.index(name)].kind
        unit = units.display_unit(kind, abs(row["value"]))
        size = units.factor(unit, kind)
        sd = None if row["sd"] is None else row["sd"] / size
        text = signed(format_value(row["value"] / size, sd))
        rows.append([name, text, "" if not sd else plain(sd, 2), shown(unit)])
    columns = [Column("coefficient", "name"), Column("value", "number"),
               Column("± sd", "number"), Column("unit", "short")]  # fmt: skip
    used = about["calibration"]
    instrument = used.get("instrument") or {}
    facts = [
        (
            "instrument",
            " ".join(str(instrument[k]) for k in ("name", "serial") if instrument.get(k)),
        ),
        ("date", certificate.date(str(used.get("created") or ""))),
        ("place", certificate.place(used.get("site") or {})),
        ("verdict", str(used.get("verdict") or "")),
    ]
    return Section(
        "Calibration", without, [Facts([f for f in facts if f[1]]), Table(columns, rows)]
    )


def _provenance(about: Mapping[str, Any]) -> Section:
    made = about["provenance"]
    rows = [["created", str(made.get("created", ""))], ["seconds", str(made.get("seconds", ""))]]
    rows += [[f"readings: {k}", words(v)] for k, v in (made.get("input") or {}).items()]
    rows += [[f"calibration: {k}", str(v)] for k, v in (made.get("calibration") or {}).items()]
    settings = made.get("settings") or {}
    rows.append(["settings [SI]", words({k: v for k, v in settings.items() if v is not None})])
    rows.append(["versions", words(made.get("versions") or {})])
    return ends.provenance(rows)
