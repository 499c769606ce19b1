"""The receivers by name, and the one function that writes for any of them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from foucault.errors import error, suggestion
from foucault.export import magnetometer, ties
from foucault.export.densities import Densities, densities
from foucault.export.over_temperature import over_temperature
from foucault.export.quantities import Known, in_gauge
from foucault.export.request import (
    ALL,
    AXES,
    EXPORTED,
    FAMILIES,
    OWN_AXES,
    Request,
    family,
    request,
    usable,
)
from foucault.export.table import Receiver, Row, receivers, text_for
from foucault.files import atomic, keep_others
from foucault.models.layouts import is_cluster
from foucault.models.noise import ImuNoise
from foucault.result import Result
from foucault.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from foucault.logs.description import LogDescription

_CODE = {"c": "code", "python": "code", "json": "programs", "csv": "programs"}
"""Receivers that are programs of no one in particular -> module with their writer."""

RECEIVERS = (*_CODE, *receivers())  # Names of all receivers.

ALIASES = {
    "ros": "ros2", "ros1": "ros2", "imu_calib": "ros2", "vins": "vins-mono",
    "orbslam3": "orb-slam3", "orb_slam3": "orb-slam3",
    "fast-lio": "fast-lio2", "fast_lio": "fast-lio2",
    "lio_sam": "lio-sam", "msckf_vio": "msckf-vio", "sensor_msgs": "robot_localization",
    "robot-localization": "robot_localization", "kf_gins": "kf-gins", "open_vins": "openvins",
}  # fmt: skip
"""Other names of a receiver: the file of imu_calib is the same for ROS and ROS 2."""

NOISE = "noise"  # What ``--drop`` calls noise that a receiver wants and nobody knows.


_BY_AXES = ("accel.bias", "accel.scale", "gyro.bias", "gyro.scale")
"""Coefficients of which each axis has one."""


RATES = 0.01  # Rates that differ by more than this part are told [1].


def known_as(name: str) -> str:
    """Return the name of a receiver, by whichever of its names it is called."""
    name = ALIASES.get(name, name)
    every = (*RECEIVERS, *ties.FORMS)
    if name not in every:
        hint = suggestion(name, every)
        raise error("export.receiver", given=name, hint=hint, allowed=", ".join(every))
    return name


def write(
    result: Result,
    receiver: str,
    path: str | Path,
    *,
    axes: str | None = None,
    drop: Iterable[str] = (),
    noise: ImuNoise | Densities | None = None,
    rate: float | None = None,
    slot: int | None = None,
    log: LogDescription | None = None,
    force: bool = False,
) -> Path:
    """Write a result in the form of another program, whole or not at all.

    `axes`: axes of the receiver's readings, None takes those usual with it, else those of the log
    that was calibrated; `drop`: coefficients or groups that may be left out, "noise" too; `noise`
    or None: noise of the instrument, for receivers that want it [SI]; `rate` or None: of the
    readings that the receiver gets, where that is not the rate of the log [Hz]; `slot` or None:
    number of the sensor with a receiver that has several, that in the log where left out [1];
    `log` or None: how the calibrated log was read, for receivers of raw counts; `force`: export a
    result that is not usable, and replace a file that is no earlier export.
    """
    if not force:
        keep_others(path, [EXPORTED])
    receiver, drop = known_as(receiver), tuple(drop)
    if receiver in ties.FORMS:
        said = ties.text(result, receiver, force)
    elif is_cluster(result.coefficients) or result.procedure == "north_seeking":
        said = _whole(result, receiver, axes, drop, force)
    elif result.procedure == "magnetometer":
        said = _of_magnetometer(result, receiver, axes, drop, slot, force)
    elif receiver in _CODE:
        module: Any = import_module(f"foucault.export.{_CODE[receiver]}")
        can, text = module.WRITERS[receiver]
        if result.temperature is not None:
            text = _at_temperatures(module, receiver)
        axes = OWN_AXES if axes is None else axes
        drop = tuple(name for name in drop if name != NOISE)
        said = text(request(result, receiver, can, axes=axes, drop=drop, log=log, force=force))
    else:
        own = receivers()[receiver]
        own = own.of_slot(number_in(result) if own.slots and slot is None else slot or 0)
        said = _from_table(result, own, axes, drop, noise, rate, force)
    with atomic(path) as temporary:
        temporary.write_text(said, encoding="utf-8")
    return Path(path)


def number_in(result: Result) -> int:
    """Return which of the sensors of a vehicle a result is of, by the topic of its log [1]."""
    told = re.search(r"\w/(\d)$", str(_described(result).get("topic") or ""))
    return int(told[1]) if told else 0


_LOG_AXES = {"yx-z": "forward-right-down", "-yxz": "forward-left-up"}
"""Right, forward and up in the axes of a log -> what these are."""


def log_axes(result: Result) -> str:
    """Return the axes that a log had, by the columns it was read from; ours where none tell."""
    for triad in ("accel", "gyro"):
        block = _described(result).get(triad)
        columns = block.get("columns") if isinstance(block, Mapping) else None
        told = [re.fullmatch(r"(-?).*([xyz])(?:\W.*)?", str(c), re.I | re.S) for c in columns or ()]
        name = "".join(f"{m[1]}{m[2].lower()}" for m in told if m)
        if name in _LOG_AXES:
            return _LOG_AXES[name]
    return OWN_AXES


def _described(result: Result) -> Mapping[str, Any]:
    said = (result.provenance.get("input") or {}).get("description")
    return said if isinstance(said, Mapping) else {}


def _at_temperatures(module: Any, receiver: str) -> Any:
    if receiver not in module.AT_TEMPERATURES:
        raise error("temperature.receiver", receiver=receiver)
    return module.AT_TEMPERATURES[receiver]


def _whole(
    result: Result, receiver: str, axes: str | None, drop: tuple[str, ...], force: bool
) -> str:
    """Return a result that is no IMU's for a receiver, in the axes and with all it has."""
    from foucault.export import own_axes

    if receiver not in own_axes.WRITERS:
        more = receivers("magnetometers") if result.procedure == "magnetometer" else ()
        raise error("export.cluster", procedure=result.procedure, receiver=receiver,
                    allowed=", ".join((*own_axes.WRITERS, *more)))  # fmt: skip
    if drop or axes is not None:
        raise error("export.whole", procedure=result.procedure,
                    option="--drop" if drop else "--axes")  # fmt: skip
    usable(result, force)
    return own_axes.WRITERS[receiver](result)


def _of_magnetometer(
    result: Result, receiver: str, axes: str | None, drop: tuple[str, ...], slot: int | None,
    force: bool,
) -> str:  # fmt: skip
    """Return a magnetometer's calibration for a receiver of that."""
    own = receivers("magnetometers").get(receiver)
    if own is None:
        return _whole(result, receiver, axes, drop, force)
    own = own.of_slot(number_in(result) if own.slots and slot is None else slot or 0)
    if not force and any(f.code in own.residual for f in result.findings):
        raise error("export.residual", receiver=own.name)
    axes = axes or own.axes or log_axes(result)
    known, about = magnetometer.knowledge(result, own, axes=axes, drop=drop, force=force)
    for row in own.rows:
        _within_limits(own, row, known)
    return text_for(own, known, about)


# -- The receivers of the table ------------------------------------------------------------------


def _from_table(
    result: Result, receiver: Receiver, axes: str | None, drop: tuple[str, ...],
    noise: ImuNoise | Densities | None, rate: float | None, force: bool,
) -> str:  # fmt: skip
    if result.temperature is not None and not (receiver.before or receiver.warms):
        raise error("temperature.receiver", receiver=receiver.name)
    if not force and any(f.code in receiver.residual for f in result.findings):
        raise error("export.residual", receiver=receiver.name)
    known, about = knowledge(
        result, receiver, axes=axes, drop=drop, noise=noise, rate=rate, force=force
    )
    rows = [row for row in receiver.rows if row.key and not row.warm]
    if receiver.apart and not any(row.calibrated(known).any() for row in rows):
        raise error("export.nothing", receiver=receiver.name, takes=", ".join(receiver.takes))
    missing = [row for row in receiver.rows if row.must and row.noise and row.told(known) is None]
    if missing and NOISE not in drop:
        raise _missing(receiver, missing, known)
    for row in receiver.rows:
        _within_limits(receiver, row, known)
    return text_for(receiver, known, about)


def knowledge(
    result: Result,
    receiver: Receiver,
    *,
    axes: str | None = None,
    drop: tuple[str, ...] = (),
    noise: ImuNoise | Densities | None = None,
    rate: float | None = None,
    force: bool = False,
) -> tuple[Known, list[str]]:
    """Return what a file of a receiver is made of, and what it says of that.

    Arguments as those of `write`; `rate`: of the readings [Hz].
    """
    axes = axes or receiver.axes or log_axes(result)
    coefficients = tuple(name for name in drop if name != NOISE)
    wanted = request(result, receiver.name, FAMILIES if receiver.before else receiver.takes,
                     axes=axes, drop=coefficients, force=force)  # fmt: skip
    model, C_cb = in_gauge(wanted.model, receiver.gauge)
    warmth = None
    if wanted.temperature is not None and receiver.warms:
        warmth = over_temperature(wanted.temperature, receiver.reference)
        model = replace(model, accel_bias=warmth.accel_bias, gyro_bias=warmth.gyro_bias)
    loud = densities(noise, result.diagnostics.get("noise"))
    turned = {name: _along(x, AXES[axes]) for name, x in loud.values.items()}
    rate = rate or result.validity.get("rate") or loud.rate
    local = result.site.get("gravity")
    kept = {*result.coefficients.names} - {*wanted.dropped.names}
    known = Known(
        model, turned, _sds(wanted, AXES[axes]), rate,
        float(local) if isinstance(local, int | float) else STANDARD_GRAVITY, loud.correlation,
        {} if warmth is None else warmth.values,
        seen={name: np.abs(AXES[axes]) @ [f"{name}.{axis}" in kept for axis in "xyz"] > 0
              for name in _BY_AXES},
    )  # fmt: skip
    about = wanted.statement() + _absent(receiver, kept)
    about += [] if warmth is None else warmth.said
    about += [said for row in receiver.rows if (said := row.lost(known, receiver.name))]
    if receiver.before:
        about += [
            "The calibration is not in this file, for the receiver has no place for it: give it",
            "readings that foucault apply has corrected, in a log or in the stream.",
        ]
    turn = np.degrees(np.linalg.norm(C_cb - np.eye(3)) / np.sqrt(2))
    if turn > 1e-9:
        about += [
            f"The receiver's body axes are turned by {turn:.3g} deg against the axes of the result."
        ]
    if any(row.noise for row in receiver.rows):
        about += loud.said or (
            "Noise: not known. Measure it with foucault allan on a log at rest.",
        )
    if receiver.wants_rate:
        about += [f"Rate of the readings: {'not known' if rate is None else f'{rate:.9g} Hz'}."]
        if rate and loud.rate and abs(loud.rate / rate - 1) > RATES:
            about += [
                f"The noise was measured at {loud.rate:.9g} Hz: N and K hold at both rates where",
                "readings were low-passed at half their rate; --rate says what the receiver gets.",
            ]
    if any(row.of == ("gravity",) for row in receiver.rows):
        about += [
            f"Local gravity: {'that of the calibration' if local else 'not known, 1 g taken'}."
        ]
    return known, about


def _along(x: np.ndarray, C_sb: np.ndarray) -> np.ndarray:
    """Return noises of three axes in the axes of the receiver, which are along the old ones."""
    return x if np.ndim(x) == 0 else x[np.abs(C_sb).argmax(axis=1)]


def _sds(wanted: Request, C_sb: np.ndarray) -> dict[str, np.ndarray]:
    """Return standard deviations of biases and scale factors by name; 0 where there is none."""
    vector = wanted.result.coefficients
    sd = dict(zip(vector.names, np.nan_to_num(vector.sd).tolist(), strict=True))
    return {
        name: np.abs(C_sb) @ [sd.get(f"{name}.{axis}", 0.0) for axis in "xyz"] for name in _BY_AXES
    }


def _absent(receiver: Receiver, kept: set[str]) -> list[str]:
    """Say what the receiver takes and was not calibrated, or dropped."""
    none = []
    for kind in receiver.takes:
        names = [name for name in ALL.names if family(name) == kind]
        if not kept & {*names}:
            none.append(kind)
        elif kind in _BY_AXES:
            none += [name for name in names if name not in kept]
    if not none or not kept:
        return []
    stays = "left out, the receiver keeps what it has" if receiver.apart else "written as no error"
    return [f"NOT CALIBRATED, {stays}: {', '.join(none)}."]


def _missing(receiver: Receiver, rows: list[Row], known: Known) -> Exception:
    keys = ", ".join(row.shown for row in rows)
    if known.rate is None and any(all(n in known.noise for n in row.of) for row in rows):
        return error("export.rate", receiver=receiver.name, keys=keys)
    return error("export.noise", receiver=receiver.name, keys=keys)


def _within_limits(receiver: Receiver, row: Row, known: Known) -> None:
    numbers = row.told(known) if row.limits else None
    if numbers is None or row.limits is None:
        return
    low, high = row.limits
    if (numbers < low).any() or (numbers > high).any():
        worst = numbers[np.argmax(np.maximum(low - numbers, numbers - high))]
        raise error("export.limits", receiver=receiver.name, key=row.shown, given=f"{worst:.6g}",
                    low=f"{low:g}", high=f"{high:g}", unit=row.unit)  # fmt: skip
