"""What a file or its format says about itself, and what must still be described."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from foucault.errors import FoucaultError, error
from foucault.logs.raw import RawTable, open_raw

if TYPE_CHECKING:
    from foucault.logs.description import LogDescription


def describes_itself(path: Path) -> bool:
    """Tell whether the file at `path` says itself what its columns are, and in which units."""
    from foucault.logs.description import LogDescription

    plain = LogDescription.model_validate({"file": path.name})
    try:
        return open_raw(path, plain).described
    except FoucaultError:  # it needs a description even to be opened, or is not there
        return False


def complete(
    description: LogDescription, wanted: tuple[str, ...], raw: RawTable, path: Path
) -> tuple[LogDescription, tuple[str, ...]]:
    """Fill in what a file or its format says about itself; others must be described.

    `wanted`: blocks that the description takes from this file.
    """
    given = description.gyro is not None or description.accel is not None
    if given and (raw.declared is None or raw.marker):
        return description, wanted
    if raw.declared is None:
        have = ", ".join(raw.names) if raw.named else f"{len(raw.names)} unnamed columns"
        raise error("log.undescribed", file=path.name, have=have)
    if not raw.declared.keys() & {"gyro", "accel"}:
        raise error("log.cannot_guess", file=path.name, block="gyro", have=", ".join(raw.names),
                    example='columns = ["gyro_x", "gyro_y", "gyro_z"]')  # fmt: skip
    blocks = dict(raw.declared) if raw.marker else _over(raw.declared, description, path)
    said = description.model_dump(exclude={"time", "temperature", "table", "averaged"})
    if "time" in blocks:
        del said["rate"]
    filled = type(description).model_validate({**said, **blocks})
    return filled, tuple(name for name in blocks if name not in ("time", "clock"))


def _over(declared: Mapping[str, Any], description: LogDescription, path: Path) -> dict[str, Any]:
    """Let what a description gives take the place of what a format declares, key by key."""
    out: dict[str, Any] = {
        name: dict(block) if isinstance(block, Mapping) else block
        for name, block in declared.items()
    }
    if description.rate is not None:
        out.pop("time", None)
        out.pop("clock", None)
    if description.clock is not None:
        out["clock"] = description.clock
    for name in ("time", "gyro", "accel", "temperature", "table", "averaged"):
        block = getattr(description, name)
        if block is not None:
            given = block.model_dump(mode="json", exclude_unset=True)
            out[name] = out.get(name, {}) | given
    for name in ("gyro", "accel"):
        if "unit" not in out.get(name, {"unit": ""}):
            raise error("log.open_unit", file=path.name, block=name,
                        kind=out[name].get("kind", "rate"))  # fmt: skip
    return out
