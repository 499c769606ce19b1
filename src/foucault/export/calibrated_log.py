"""Remove the calibrated errors from a log, block by block, and say where it is extrapolated."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import Finding, FoucaultError, error, finding
from foucault.escape import json_remark
from foucault.logs import follow, own
from foucault.models.imu import ImuModel
from foucault.models.layouts import is_cluster, is_magnetometer
from foucault.models.size_effect import AFTER, BEFORE
from foucault.models.temperature import TemperatureModel
from foucault.procedures.platform_tumble.settings import of_a_command
from foucault.result import Level, Result
from foucault.tables import Log
from foucault.units import ZERO_CELSIUS

if TYPE_CHECKING:
    from foucault.logs.description import LogDescription
    from foucault.logs.raw import Progress

SHARE = 0.01
"""A range of validity leaves out the rarest samples of its own session; more are told [1]."""

MARGIN = 0.05
"""How far beyond a range, as part of its width, still counts as inside: noise and bias [1]."""

FAR = 0.5  # A single sample beyond a range by more than this part of its width is told [1].


@dataclass(frozen=True)
class Applied:
    """What was written."""

    path: Path
    samples: int  # number of samples [1]
    # what was noticed in the log, and how much of it is outside the validity
    findings: tuple[Finding, ...]


def calibrate_log(
    result: Result,
    description: LogDescription,
    folder: str | Path,
    path: str | Path,
    *,
    instrument: Mapping[str, Any] | None = None,
    sha256: str = "",
    force: bool = False,
    hold: bool = False,
    progress: Progress | None = None,
) -> Applied:
    """Write a calibrated log; memory does not grow with its length where the format allows.

    `path`: file to write: ``.csv``, ``.csv.gz``, ``.parquet`` or ``.npz``; `instrument` or None:
    name and serial number of the instrument that made the log, where known; `sha256`: fingerprint
    of the result file, to be kept in the log; `force`: go on where the result is unusable or of
    another instrument, or where a file is replaced that is no calibrated log; `hold`: where
    coefficients change with temperature and the log is outside their range, take those at the end
    of the range, instead of an error; `progress` or None: called with the fraction done, from 0
    to 1.
    """
    if not force:
        check_fits(result, description, instrument or {})
    if any((Path(folder) / name).resolve() == Path(path).resolve() for name in description.files()):
        raise error("apply.onto_itself", path=path)
    if not (force or _ours(Path(path))):
        raise error("output.other", path=path)
    if hold and result.temperature is None:
        raise error("temperature.option", option="--outside")
    logs = follow.blocks(description, folder, progress)
    blocks, remarks, seen = corrected(result, logs, sha256, force, hold)
    samples = own.write_blocks(blocks, path, remarks)
    return Applied(Path(path), samples, seen())


def corrected(
    result: Result, logs: Iterator[Log], sha256: str, force: bool, hold: bool = False
) -> tuple[Iterator[Log], dict[str, str], Callable[[], tuple[Finding, ...]]]:
    """Return the blocks of a log as they are corrected, what to write of that, what was noticed.

    `logs`: its blocks [SI]; `sha256`, `force`, `hold`: as for `calibrate_log`.
    """
    seen = _Seen(result)
    keep = {
        "sha256": sha256,
        "procedure": result.procedure,
        "verdict": result.verdict.level.value,
        "created": result.provenance.get("created"),
        "instrument": {key: result.instrument.get(key) for key in ("name", "serial")},
    }
    remarks = {own.CALIBRATED_KEY: json_remark(keep)}
    return _calibrated(result, logs, seen, force, hold), remarks, seen.findings


def _ours(path: Path) -> bool:
    """Whether nothing stands there but a log that was calibrated before."""
    from foucault.logs.description import LogDescription
    from foucault.logs.raw import open_raw

    if not path.is_file() or not path.stat().st_size:
        return True
    try:
        marker = open_raw(path, LogDescription.model_validate({"file": path.name})).marker
    except FoucaultError:  # it needs a description even to be opened
        return False
    return own.CALIBRATED in marker


def check_fits(result: Result, description: LogDescription, instrument: Mapping[str, Any]) -> None:
    """Refuse an unusable result, or one of an instrument that is not the log's."""
    if result.verdict.level is Level.UNUSABLE:
        reasons = " ".join(result.verdict.reasons) or "No reason is given."
        raise error("apply.unusable", reasons=reasons)
    for key, word in (("serial", "serial number"), ("name", "name")):
        one, other = result.instrument.get(key), instrument.get(key)
        if one and other:
            if str(one).strip() == str(other).strip():
                break  # the same serial number: its name may be spelled otherwise
            raise error("apply.instrument", what=word, result=one, log=other)
    was = (result.provenance.get("input") or {}).get("description") or {}
    now = description.model_dump(mode="json", exclude_none=True)
    for triad in ("accel", "gyro"):
        scales = [(d.get(triad) or {}).get("scale") for d in (was, now)]
        if None not in scales and _listed(scales[0]) != _listed(scales[1]):
            raise error("apply.scale", triad=triad, result=scales[0], log=scales[1])


def _listed(scale: Any) -> list[str]:
    return [scale] * 3 if isinstance(scale, str) else [str(s) for s in scale]


def _calibrated(
    result: Result, logs: Iterator[Log], seen: _Seen, force: bool, hold: bool
) -> Iterator[Log]:
    model, apart = result.model, bool(result.size_effect)
    # A cluster always needs them, and says so itself.
    forced = isinstance(model, ImuModel) and model.gyros_feel_force
    for log, before, after in _beside(logs) if apart else ((log, None, None) for log in logs):
        file = log.source.get("file", "The log")
        if own.CALIBRATED in log.source.get("marker", "") and not force:
            raise error("apply.again", file=file)
        if log.gyro is not None and log.accel is None and forced:
            raise error("apply.needs_accel", file=file)
        if log.gyro is None and apart:
            raise error("apply.needs_gyro", file=file)
        if result.temperature is not None:
            if log.temperature is None or not hold:
                result.temperature.refuse_outside(log, seen.samples)
            seen.warmth(result.temperature, log)
        whole = _joined(before, log, after)
        if hold and result.temperature is not None and whole.temperature is not None:
            whole = replace(whole, temperature=result.temperature.held(whole.temperature))
        first = 0 if before is None else len(before)
        out = result.apply(whole)[first : first + len(log)]
        out = replace(
            log, accel=out.accel, gyro=out.gyro, mag=log.mag if out.mag is None else out.mag
        )
        seen.add(log, out)
        yield out


def _beside(logs: Iterator[Log]) -> Iterator[tuple[Log, Log | None, Log | None]]:
    """Yield each block, with the samples before and after it that its derivatives need."""
    before: Log | None = None
    log = next(logs, None)
    while log is not None:
        after = next(logs, None)
        yield log, before, None if after is None else after[:AFTER]
        before = _joined(before, log, None)[-BEFORE:]
        log = after


def _joined(before: Log | None, log: Log, after: Log | None) -> Log:
    some = [part for part in (before, log, after) if part is not None]
    if len(some) == 1:
        return log

    def both(name: str) -> FloatArray | None:
        blocks = [getattr(part, name) for part in some]
        return None if blocks[0] is None else np.concatenate(blocks)

    time = np.concatenate([part.time for part in some])
    return Log(time, both("gyro"), both("accel"), log.sampled, both("temperature"))


@dataclass
class _Range:
    """How much of a log is outside one range of validity."""

    what: str
    low: float
    high: float
    unit: str
    floor: float
    scale: float = 1.0  # SI value of `unit`
    zero: float = 0.0  # SI value that `unit` calls 0
    count: int = 0
    outside: int = 0
    worst: float = 0.0
    furthest: float = np.nan

    def add(self, values: FloatArray) -> None:
        """Count the rows of `values`, shape (n, k) [SI], with any column outside."""
        beyond = np.maximum(self.low - values, values - self.high)
        margin = max(MARGIN * (self.high - self.low), self.floor)
        self.count += len(values)
        self.outside += int((beyond > margin).any(axis=1).sum())
        worst = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
        if beyond[worst] > self.worst:
            self.worst, self.furthest = float(beyond[worst]), float(values[worst])

    def words(self) -> str:
        """Say how much is outside; nothing where it is not worth telling."""
        far = max(FAR * (self.high - self.low), 2 * self.floor)
        if not self.outside or (self.outside <= SHARE * self.count and self.worst <= far):
            return ""
        shown = [(v - self.zero) / self.scale for v in (self.low, self.high, self.furthest)]
        return (
            f"{self.what} is outside {shown[0]:.4g} to {shown[1]:.4g} {self.unit} in "
            f"{100 * self.outside / self.count:.2g} % of the samples, at the furthest "
            f"{shown[2]:.4g} {self.unit}"
        )


@dataclass
class _Seen:
    """What was noticed while the blocks went by."""

    result: Result
    found: list[tuple[Finding, ...]] = field(default_factory=list)
    untouched: set[str] = field(default_factory=set)
    samples: int = 0
    beyond: int = 0
    first_beyond: int = -1
    span: tuple[float, float] = (np.inf, -np.inf)

    def __post_init__(self) -> None:
        self.ranges: dict[str, _Range] = {}
        for key, rest in (
            ("accel", ("the specific force", "m/s^2", 0.0)),
            ("gyro", ("the angular rate", "deg/s", np.radians(0.5), np.radians(1.0))),
            ("temperature", ("the temperature", "degC", 1.0, 1.0, ZERO_CELSIUS)),
        ):
            limits = self.result.validity.get(key)
            if key == "temperature" and self.result.temperature is not None:
                continue  # its functions are not extrapolated
            if limits is not None and None not in limits:
                what, unit, floor, *scale = rest
                self.ranges[key] = _Range(what, limits[0], limits[1], unit, floor, *scale)

    def warmth(self, model: TemperatureModel, log: Log) -> None:
        """Count the samples of one block that the functions of temperature do not hold at."""
        assert log.temperature is not None
        rows = np.flatnonzero(model.outside(log.temperature))
        if rows.size and not self.beyond:
            self.first_beyond = self.samples + int(rows[0])
        self.beyond += rows.size
        low, high = self.span
        T = log.temperature
        self.span = (min(low, float(T.min())), max(high, float(T.max())))

    def add(self, log: Log, out: Log) -> None:
        """Look at one block before and after."""
        self.samples += len(log)
        command = is_cluster(self.result.coefficients)
        self.found.append(of_a_command(log.findings) if command else log.findings)
        names = self.result.coefficients.names
        beside = is_magnetometer(self.result.coefficients)  # of an IMU that is another matter
        for key in ("mag",) if beside else ("accel", "gyro", "mag", "temperature"):
            values = getattr(out, key)
            if values is None:
                continue
            if key != "temperature" and not any(name.startswith(key) for name in names):
                self.untouched.add(key)
            elif key in self.ranges:
                self.ranges[key].add(values.reshape(len(out), -1))

    def findings(self) -> tuple[Finding, ...]:
        """Return everything noticed, the validity in one finding."""
        found = list(follow.merged(self.found))
        words = [text for text in (r.words() for r in self.ranges.values()) if text]
        if words:
            text = "; ".join(words)
            found.append(finding("apply.outside", words=text[0].upper() + text[1:]))
        found += [finding("apply.untouched", triad=t) for t in sorted(self.untouched)]
        model = self.result.temperature
        if model is not None and self.beyond:
            low, high = (f"{v - ZERO_CELSIUS:.2f}" for v in (model.low, model.high))
            found.append(finding("temperature.held_outside", count=self.beyond, low=low, high=high,
                                 row=self.first_beyond))  # fmt: skip
        if self.span[0] == self.span[1] and self.samples > 1:
            found.append(finding("temperature.constant", count=self.samples,
                                 given=f"{self.span[0] - ZERO_CELSIUS:.2f}"))  # fmt: skip
        return tuple(found)
