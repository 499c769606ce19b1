"""Several sources recorded together: sensors on one plate, and what is logged beside them.

Each source is a session of its own in a folder 1, 2 ..., written as it comes. What is made of them
at the end, or by `again` after a kill, are logs on one clock, that of the computer::

    imus/NAME.parquet   an IMU, with the temperature and the table angles that came beside it
    beside/N.csv        what came beside the IMUs, as it was sent
    campaign.toml       of the IMU, or of all as a fleet

The clock of each sensor is fitted to that of the computer (`clock.on_host`); what is slower or
faster than an IMU is joined to it as the files of one log are (`logs.merged`).
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from foucault import campaign as campaigns
from foucault.arrays import FloatArray
from foucault.campaign import running, writing
from foucault.capture import recording
from foucault.capture.clock import HOST_SD, on_host
from foucault.capture.frame import Frame, parsed
from foucault.capture.recording import CAMPAIGN, FRAME, RAW, Plug, Recording, rows_of, times_of
from foucault.errors import FoucaultError, error
from foucault.files import atomic, make_folder, write_text
from foucault.logs import own
from foucault.logs.layout import Temperature, scaled_unit
from foucault.logs.merged import on_one_clock, within
from foucault.tables import Log

IMUS, ASIDE, ASKED = "imus", "beside", "sources.json"

OF_TABLE = dict.fromkeys(own.ANGLES, "angle") | {"table_rate": "angular rate", "position": ""}
"""Fields of a table, and what they measure."""

Tell = Callable[[Sequence[tuple[Recording, float]]], None]


def record(
    plugs: Sequence[Plug], folder: Path, serials: Sequence[str] = (), *,
    seconds: float | None = None, silent: float | None = None, tell: Tell = lambda _now: None,
) -> dict[str, Any]:  # fmt: skip
    """Record sources together until they end, and return what there is to say of the session.

    `serials`: of the IMUs in the order of their sources, else what their frames say, else their
    number; `seconds` or None: how long [s]; `silent` or None: end where nothing comes of any for
    so long [s]; `tell`: as of `recording.record`.
    """
    names = [plug.source.name for plug in plugs]
    if twice := {n for n in names if names.count(n) > 1}:
        raise error("capture.twice", name=min(twice))
    if not any(plug.frame.imu for plug in plugs):
        raise error("capture.no_imu", names=", ".join(names))
    if twins := {s for s in serials if serials.count(s) > 1}:
        raise error("capture.twins", serial=min(twins))
    how = {"seconds": seconds, "silent": silent, "tell": tell}
    if len(plugs) == 1:
        return recording.record(plugs, [folder], **how)[0]  # type: ignore[arg-type]
    make_folder(folder)
    if (folder / ASKED).exists():
        raise error("capture.there", folder=folder)
    write_text(folder / ASKED, json.dumps({"sources": names, "serials": [*serials]}) + "\n")
    folders = [folder / str(k + 1) for k in range(len(plugs))]
    recording.record(plugs, folders, **how)  # type: ignore[arg-type]
    return joined(folder)


def again(folder: Path) -> dict[str, Any]:
    """Make the rows of a session once more from its bytes, and what is joined of several."""
    if not (folder / ASKED).is_file():
        return recording.again(folder)
    for one in _folders(folder):
        recording.again(one)
    return joined(folder)


def _folders(folder: Path) -> list[Path]:
    count = len(json.loads((folder / ASKED).read_text())["sources"])
    every = [folder / str(k + 1) for k in range(count)]
    return [one for one in every if (one / RAW).is_file()]


@dataclass(frozen=True)
class _Heard:
    """What was recorded of one source, on the clock of the computer."""

    folder: Path
    frame: Frame
    rows: FloatArray  # (n, columns) [units of the frame]
    own: FloatArray  # (n,) when each was made by the clock of its log [s]
    time: FloatArray  # (n,) the same by that of the computer [s]

    @classmethod
    def of(cls, folder: Path) -> _Heard:
        frame = parsed((folder / FRAME).read_text(), FRAME)
        rows = rows_of(folder, frame)
        rows = rows[np.isfinite(rows[:, -1])]
        if not len(rows):
            return cls(folder, frame, rows, rows[:, -1], rows[:, -1])
        own = times_of(frame, rows)
        return cls(folder, frame, rows, own, on_host(rows[:, -1], own))

    def column(self, name: str) -> FloatArray:
        return np.asarray(self.rows[:, self.frame.columns.index(name)])

    def has(self, names: Sequence[str]) -> list[str]:
        """Return which of the columns it has, where it was heard at all."""
        return [n for n in names if n in self.frame.columns] if len(self.rows) > 1 else []

    def beside(self, *names: str) -> dict[str, FloatArray]:
        """Return what goes with an IMU: its time, and columns in SI, shape (m,) each."""
        good = np.isfinite(np.column_stack([self.column(n) for n in names])).all(axis=1)
        good &= np.diff(self.time, prepend=-np.inf) > 0
        out = {"time": self.time[good]}
        for name in names:
            told, x = self.frame.field_of(name), self.column(name)[good]
            assert told is not None
            if name == "temperature":
                zero, size = Temperature(column=0, unit=told.unit or "degC").conversion()
                x = (x - zero[0]) * size[0]
            elif kind := OF_TABLE[name]:
                usual = {"angle": "deg", "angular rate": "deg/s"}[kind]
                x = x * scaled_unit(told.unit or usual, kind)
            out[name] = x
        return out


def joined(folder: Path) -> dict[str, Any]:
    """Put what was recorded on one clock, and return what there is to say of the session."""
    asked = json.loads((folder / ASKED).read_text())
    heard = [_Heard.of(one) for one in _folders(folder)]
    each = [json.loads((h.folder / recording.SAID).read_text()) for h in heard]
    said: dict[str, Any] = {"sources": asked["sources"], "each": each, "imus": {}, "left_out": {}}
    others = [h for h in heard if not h.frame.imu]
    imus = [h for h in heard if h.frame.imu]
    for h, name in zip(imus, _named(imus, asked["serials"]), strict=True):
        try:
            log = _with(h, others)
            own.write(log, make_folder(folder / IMUS) / f"{name}.parquet")
        except FoucaultError as problem:
            said["left_out"][name] = problem.message
        else:
            said["imus"][name] = len(log)
    for h in others:
        _write_aside(h, make_folder(folder / ASIDE) / f"{h.folder.name}.csv")
    write_text(folder / CAMPAIGN, _campaign(folder.name, [*said["imus"]]))
    write_text(folder / recording.SAID, json.dumps(said, indent=1) + "\n")
    return said


def _named(imus: Sequence[_Heard], given: Sequence[str]) -> list[str]:
    """Return the names of the IMUs: those given, else what their frames say, else their number."""
    out: list[str] = []
    for k, h in enumerate(imus):
        told = h.folder.name
        if "serial" in h.frame.columns and np.isfinite(h.column("serial")).any():
            told = f"{np.nanmedian(h.column('serial')):.0f}"
        name = re.sub(r"[^\w.+@()-]+", "_", given[k] if k < len(given) else told)
        out.append(name if name not in out else f"{name}-{h.folder.name}")
    return out


def _with(imu: _Heard, others: Sequence[_Heard]) -> Log:
    """Return the log of an IMU on the clock of the computer, with what came beside it [SI]."""
    log: Log = campaigns.read_log(campaigns.load(imu.folder / CAMPAIGN))
    order = np.argsort(imu.own, kind="stable")
    time = np.interp(log.time, imu.own[order], imu.time[order])
    kept = np.diff(time, prepend=-np.inf) > 0
    blocks = {"time": time[kept]} | {
        name: x[kept] for name in ("gyro", "accel", "mag", "temperature")
        if (x := getattr(log, name)) is not None
    }  # fmt: skip
    warm = next((h for h in others if h.has(["temperature"])), None)
    if log.temperature is None and warm is not None:
        blocks, _ = on_one_clock([blocks, warm.beside("temperature")],
                                 (imu.folder.name, warm.folder.name))  # fmt: skip
    table = next((h for h in others if h.has([*OF_TABLE])), None)
    if table is not None:
        blocks = _turned(blocks, table.beside(*table.has([*OF_TABLE])))
    known: Any = {k: x for k, x in blocks.items() if k not in OF_TABLE}
    return replace(log, **known, table=own.table_of(blocks))


def _turned(blocks: Mapping[str, FloatArray], table: Mapping[str, FloatArray]) -> dict[str, Any]:
    """Return the rows of an IMU at which a table said where it was, with what it said [SI]."""
    time, at = blocks["time"], table["time"]
    keep = within(time, float(np.median(np.diff(time))), at)
    if keep.sum() < 2:
        raise error("log.join_apart", files="the IMU and the table")
    out: dict[str, Any] = {name: x[keep] for name, x in blocks.items()}
    near = np.clip(np.searchsorted(0.5 * (at[1:] + at[:-1]), time[keep]), 0, len(at) - 1)
    for name, x in table.items():
        if name in own.ANGLES:  # goes on beyond a whole turn on the way
            out[name] = np.interp(time[keep], at, np.unwrap(x))
        elif name == "position":
            out[name] = np.rint(x[near]).astype(np.int64)
        elif name != "time":
            out[name] = np.interp(time[keep], at, x)
    return out


def _write_aside(h: _Heard, path: Path) -> None:
    """Write what came beside the IMUs, with units in the titles as those of a reference."""
    names = [n for n in h.frame.columns if n not in ("time", "counter")]
    titles = ["time (s)"]
    for name in names:
        one = h.frame.field_of(name) or h.frame.field_of(name.rpartition("_")[0])
        unit = one.unit if one is not None else ""
        titles.append(f"{name.replace('_', ' ')} ({unit})" if unit else name.replace("_", " "))
    rows = np.column_stack([h.time, *(h.column(n) for n in names)])
    rows = rows[np.diff(h.time, prepend=-np.inf) > 0]
    lines = [",".join(titles), *(",".join("" if x != x else repr(x) for x in row)
                                 for row in rows.tolist())]  # fmt: skip
    with atomic(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _campaign(name: str, imus: Sequence[str]) -> str:
    """Write the campaign of the session: of the IMU, or of all of them as a fleet."""
    file = f"{IMUS}/{imus[0]}.parquet" if len(imus) == 1 else f"{IMUS}/*.parquet"
    log = f'[log]\nfile = "{file}"\n# All on the clock of the computer that recorded them.\n' \
        f'clock = "host"\nclock_sd = "{1e6 * HOST_SD:.0f} ppm"\n'  # fmt: skip
    text = running.with_own_log(writing.template("hand_rotated"), log)
    return text.replace(writing.EXAMPLE, name)


def twins(now: Sequence[Recording]) -> int | None:
    """Return a serial number that two instruments say, None where there is none [1]."""
    told = [one.serial for one in now if one.serial is not None and one.frame.imu]
    return next((s for s in told if told.count(s) > 1), None)
