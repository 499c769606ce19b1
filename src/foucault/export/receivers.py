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
    **dict.fromkeys(("json", "csv", "kalibr", "imucal", "px4", "ros2"), "programs"),
}
"""Name of a receiver -> its module, with ``WRITERS`` and ``AT_TEMPERATURES``."""

AXES_OF = {"px4": "forward-right-down"}
"""Axes of readings that are usual with a receiver, where they are not those of results."""

ALIASES = {"ros": "ros2", "ros1": "ros2", "imu_calib": "ros2"}
"""Other names of a receiver: the file of imu_calib is the same for ROS and ROS 2."""


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
    module = import_module(f"foucault.export.{RECEIVERS[receiver]}")
    can, text = module.WRITERS[receiver]
    if result.temperature is not None:
        if receiver not in module.AT_TEMPERATURES:
            raise error("temperature.receiver", receiver=receiver)
        text = module.AT_TEMPERATURES[receiver]
    if is_cluster(result.coefficients) or result.procedure == "north_seeking":
        said = _whole(result, receiver, axes, tuple(drop), force)
    else:
        axes = AXES_OF.get(receiver, OWN_AXES) if axes is None else axes
        said = text(
            request(result, receiver, can, axes=axes, drop=drop, noise=noise, log=log, force=force)
        )
    with atomic(path) as temporary:
        temporary.write_text(said, encoding="utf-8")
    return Path(path)


def _whole(
    result: Result, receiver: str, axes: str | None, drop: tuple[str, ...], force: bool
) -> str:
    """Return a result that is no IMU's for a receiver, in the axes and with all it has."""
    from foucault.export import own_axes

    if receiver not in own_axes.WRITERS:
        raise error("export.cluster", procedure=result.procedure, receiver=receiver,
                    allowed=", ".join(own_axes.WRITERS))  # fmt: skip
    if drop or axes is not None:
        raise error("export.whole", procedure=result.procedure,
                    option="--drop" if drop else "--axes")  # fmt: skip
    usable(result, force)
    return own_axes.WRITERS[receiver](result)
