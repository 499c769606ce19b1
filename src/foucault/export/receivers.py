"""The receivers by name, and the one function that writes for any of them."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from foucault.errors import error, suggestion
from foucault.export.request import EXPORTED, OWN_AXES, request, usable
from foucault.files import atomic, keep_others
from foucault.models.layouts import is_cluster
from foucault.models.noise import ImuNoise
from foucault.result import Result

if TYPE_CHECKING:
    from foucault.logs.description import LogDescription

RECEIVERS = {
    "c": "c_header",
    "python": "python_module",
    "json": "json_matrices",
    "csv": "csv_table",
    "kalibr": "kalibr",
    "imucal": "imucal",
    "px4": "px4",
    "ros2": "ros2",
}
"""Name of a receiver -> its module: ``CAN``, the families it can express, and ``text``."""

AXES_OF = {"px4": "forward-right-down"}
"""Axes of readings that are usual with a receiver, where they are not those of results."""

ALIASES = {"ros": "ros2", "ros1": "ros2", "imu_calib": "ros2"}
"""Other names of a receiver: the file of imu_calib is the same for ROS and ROS 2."""

AT_TEMPERATURES = {"c": "c_temperature", "python": "python_temperature", "json": "json_matrices"}
"""The same of receivers that take coefficients which change with temperature."""


def write(
    result: Result,
    receiver: str,
    path: str | Path,
    *,
    axes: str | None = None,
    drop: Iterable[str] = (),
    noise: ImuNoise | None = None,
    log: LogDescription | None = None,
    force: bool = False,
) -> Path:
    """Write a result in the form of another program, whole or not at all.

    `axes`: axes of the receiver's readings, None takes those usual with it; `drop`: coefficients
    or groups that may be left out; `noise` or None: noise of the instrument, for receivers that
    want it [SI]; `log` or None: how the calibrated log was read, for receivers of raw counts;
    `force`: export a result that is not usable, and replace a file that is no earlier export.
    """
    if not force:
        keep_others(path, [EXPORTED])
    receiver = ALIASES.get(receiver, receiver)
    if receiver not in RECEIVERS:
        hint = suggestion(receiver, RECEIVERS)
        raise error("export.receiver", given=receiver, hint=hint, allowed=", ".join(RECEIVERS))
    if result.temperature is not None and receiver not in AT_TEMPERATURES:
        raise error("temperature.receiver", receiver=receiver)
    other = _not_of_an_imu(result)
    if other:
        return _written(path, _whole(result, other, receiver, axes, tuple(drop), force))
    module = import_module(f"foucault.export.{RECEIVERS[receiver]}")
    wanted = request(
        result,
        receiver,
        module.CAN,
        axes=AXES_OF.get(receiver, OWN_AXES) if axes is None else axes,
        drop=drop,
        noise=noise,
        log=log,
        force=force,
    )
    if result.temperature is not None:
        module = import_module(f"foucault.export.{AT_TEMPERATURES[receiver]}")
    return _written(path, module.text(wanted))


def _not_of_an_imu(result: Result) -> str:
    """Return the module that writes results which are no errors of an IMU, empty for an IMU."""
    if is_cluster(result.coefficients):
        return "cluster"
    return "north_seeker" if result.procedure == "north_seeking" else ""


def _whole(
    result: Result, module: str, receiver: str, axes: str | None, drop: tuple[str, ...], force: bool
) -> str:
    """Return the text for a receiver that takes all coefficients, in the axes they are in."""
    writers = import_module(f"foucault.export.{module}").WRITERS
    if receiver not in writers:
        raise error("export.cluster", procedure=result.procedure, receiver=receiver,
                    allowed=", ".join(writers))  # fmt: skip
    if drop or axes is not None:
        raise error("export.whole", procedure=result.procedure,
                    option="--drop" if drop else "--axes")  # fmt: skip
    usable(result, force)
    text: str = writers[receiver](result)
    return text


def _written(path: str | Path, text: str) -> Path:
    with atomic(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return Path(path)
