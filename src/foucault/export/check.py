"""Read a receiver's file back, and say what in it looks wrong.

Beside the run that a file came from, each number is held against what the table would write, and
against what it would be after one of the usual mistakes, with y the number that is right::

    a sample sigma for a density   y rate^(p/2)        a density for a sample sigma  y rate^(-p/2)
    deg for rad                    y (180/pi)^p        g for m/s^2                   y / 9.80665^p
    a variance for a sigma         y^2                 a sigma for a variance        sqrt(y)
                                   (in SI, or in the unit of the file)

(p = 1 for a sigma, 2 for a variance; the first four also two at a time), and for a calibration
what the table would write of the inverse model, ``M^-1`` and ``-M^-1 b``. What agrees with one of
them to `CLOSE` and not with y is that mistake; what agrees with none is told as it is, for people
inflate noise and round numbers. Without a run only what no sensor can have is told (`POSSIBLE`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from foucault.arrays import FloatArray
from foucault.errors import Finding, FoucaultError, error, finding, suggestion
from foucault.export import magnetometer
from foucault.export.densities import Densities
from foucault.export.quantities import Known
from foucault.export.receivers import knowledge, known_as, log_axes, number_in
from foucault.export.request import inverse, known_axes
from foucault.export.syntax import Found
from foucault.export.table import (
    KINDS,
    TABLES,
    Receiver,
    Row,
    found_in,
    numbers_of,
    receivers,
)
from foucault.models.imu import ImuModel
from foucault.models.layouts import of_sensors
from foucault.models.noise import GRADES, ImuNoise, grade
from foucault.result import Result
from foucault.units import STANDARD_GRAVITY, convert, display_unit, plain, size

CLOSE = 0.01
"""Numbers that agree to this part of themselves are the same; people write two or three digits."""

POSSIBLE = {
    "accel.white": (1e-8, 0.5),
    "gyro.white": (1e-10, 0.05),
    "accel.walk": (0.0, 0.5),
    "gyro.walk": (0.0, 0.05),
    "accel.bias": (-20.0, 20.0),
    "gyro.bias": (-1.75, 1.75),
    "gravity": (9.7, 9.9),
    "rate": (0.5, 1e5),
    "mag.bias": (-2e-3, 2e-3),
    "mag.intensity": (2e-5, 7e-5),
}
"""Quantity -> the least and the most that any sensor has, or that there is on the Earth [SI]."""

DIFFERS = "differs from the run"
"""What is told of a key that differs in none of the usual ways, which may be meant."""

SCALES = (0.5, 2.0)
"""Scale factors of any sensor, and what a matrix and its inverse do to a length [1]."""

_SHOWN = {
    "accel.white": "velocity random walk",
    "gyro.white": "angle random walk",
    "accel.walk": "acceleration random walk",
    "gyro.walk": "rate random walk",
    "accel.bias": "specific force",
    "gyro.bias": "angular rate",
    "accel.true_bias": "specific force",
    "gyro.true_bias": "angular rate",
    "gyro.g": "g-sensitivity",
    "gyro.g_rotated": "g-sensitivity",
    "gravity": "gravity",
    "rate": "frequency",
    "correlation": "time",
    "mag.bias": "magnetic field",
    "mag.intensity": "magnetic field",
}
"""Quantity -> the kind of unit that it is shown in; others are ratios as they are."""


@dataclass(frozen=True)
class Line:
    """One key of a file."""

    key: str
    value: str  # what it means, in our units; "" where it is no number
    run: str  # the same of the run, "" without one
    typical: str  # grade of instrument that a white noise is nearest to
    said: str  # what is noticed, in a few words


@dataclass(frozen=True)
class Checked:
    """What a file says."""

    receiver: Receiver
    lines: tuple[Line, ...]
    findings: tuple[Finding, ...]


def recognised(text: str) -> Receiver:
    """Return the receiver whose keys a file has most of; raises ``export.unknown_file``."""
    bare = text.replace('"', "")

    def likeness(own: Receiver) -> tuple[float, int, int, bool]:
        wanted = [row for row in own.rows if row.key and row.must]
        shares = [(0.0, 0)]
        for slot in every_slot([own]):
            try:
                found = found_in(slot, text)
            except FoucaultError:
                continue
            there = sum(row.names()[0] in found for row in slot.rows if row.key and row.must)
            shares.append((max(there / len(wanted), 0.5 * (own.apart and found != {})), len(found)))
        model = sum(row.line.replace('"', "") in bare for row in own.rows if not row.key)
        # What our own writer says is for VINS-Fusion has the same keys as VINS-Mono.
        return *max(shares), model, own.title in text

    like = {own: likeness(own) for table in TABLES for own in receivers(table).values()}
    best = max(like, key=lambda own: like[own])
    if like[best][0] < 0.5:
        raise error("export.unknown_file", allowed=", ".join(receivers()))
    return best


def every_slot(some: Sequence[Receiver]) -> list[Receiver]:
    """Return receivers as they name each of their sensors."""
    return [own.of_slot(k) for own in some for k in range(len(own.slots) + 1)]


def checked(
    text: str,
    receiver: str | None = None,
    result: Result | None = None,
    *,
    noise: ImuNoise | Densities | None = None,
    rate: float | None = None,
    axes: str | None = None,
) -> Checked:
    """Read a file back and hold it against a run, or against what is possible at all.

    Of several sensors in it that of the run is looked at, or the one that has most keys; without
    a run all of them.

    `receiver`: whose it is, None finds out; `result`: the run it came from, where there is one;
    `noise`, `rate`, `axes`: as for `write`, the rate [Hz].
    """
    some = [recognised(text)] if receiver is None else _own(known_as(receiver))
    if axes is not None:
        known_axes(axes)
    found = {own: found_in(own, text) for own in every_slot(some)}
    held = [own for own in found if found[own]] or some
    held.sort(key=lambda own: -len(found.get(own, ())))
    if result is None:
        held = [own for own in held if own.title == held[0].title]
    else:
        of_mag = result.procedure == "magnetometer"
        same = [own for own in held if own.of_magnetometer == of_mag]
        if not same:
            raise error("export.check_other", procedure=result.procedure, title=held[0].title)
        number = number_in(result)
        held = ([own for own in same if own.slot == number] or same)[:1]
    lines: list[Line] = []
    noticed: list[Finding] = []
    for own in sorted(held, key=lambda own: own.slot):
        about = None if result is None else _known(result, own, noise, rate, axes)
        seen = _read(own, found.get(own, {}), about, rate)
        lines += seen[0]
        noticed += seen[1]
    return Checked(held[0], tuple(lines), tuple(noticed))


def _known(
    result: Result, own: Receiver, noise: ImuNoise | Densities | None, rate: float | None,
    axes: str | None,
) -> Known:  # fmt: skip
    """Return what the file of a run is made of."""
    if own.of_magnetometer:
        at = axes or own.axes or log_axes(result)
        return magnetometer.knowledge(result, own, axes=at, drop=(), force=True)[0]
    names = of_sensors(result.coefficients).names
    drop = tuple(n for n in names if n.rpartition(".")[0] not in own.takes)
    return knowledge(result, own, axes=axes, noise=noise, rate=rate, force=True,
                     drop=() if own.before else drop)[0]  # fmt: skip


def _read(
    own: Receiver, found: Found, about: Known | None, rate: float | None
) -> tuple[list[Line], list[Finding]]:
    """Return what the keys of one sensor say, and what is wrong with them."""
    rate = rate or _single(own, found, "rate") or (about.rate if about else None)
    reading = Known(ImuModel(), rate=rate, correlation=_single(own, found, "correlation"))
    if about is not None:
        about = replace(about, rate=rate, correlation=reading.correlation or about.correlation)
    lines: list[Line] = []
    noticed: list[Finding] = []
    for row in own.rows:
        if row.key and any(key in found for key in row.names()):
            line, seen = _line(own, row, found, reading, about)
            lines.append(line)
            noticed += seen
        elif row.key and row.must and not own.apart:
            noticed.append(finding("export.check_missing", receiver=own.name, key=row.shown))
    return lines, noticed


def _line(
    own: Receiver, row: Row, found: Found, reading: Known, about: Known | None
) -> tuple[Line, list[Finding]]:
    """Return what one key says, and what is wrong with it."""
    right = None if about is None else row.told(about)
    if own.apart:  # axes that are left out stay as they are: taken for right
        other = row.told(Known(ImuModel())) if right is None else right
        if other is not None and len(other) == len(row.names()):
            found = dict(zip(row.names(), other.tolist(), strict=True)) | found
    numbers = numbers_of(row, found)
    if numbers is None:
        given = ", ".join(str(w) for key in row.names() if isinstance(w := found.get(key), str))
        told = finding("export.check_text", receiver=own.name, key=row.shown, given=given)
        return Line(row.shown, "", "", "", "no number"), [told]
    if len(numbers) == 1 and own.syntax in ("python", "matlab"):  # one number stands for three
        numbers = np.resize(numbers, row.count)
    if len(numbers) != row.count:
        told = finding("export.check_count", receiver=own.name, key=row.shown,
                       given=len(numbers), wanted=row.count)  # fmt: skip
        return Line(row.shown, "", "", "", f"{len(numbers)} for {row.count} numbers"), [told]
    run = "" if about is None or right is None else _in_our_units(row, right, about)
    if said := _none(row, numbers):
        told = finding("export.check_possible", key=row.shown, words=said)
        return Line(row.shown, "", run, "", said), [told]
    if about is None or right is None:
        words, code = list(_impossible(row, numbers, reading)), "export.check_possible"
    else:
        words, code = _beside(row, numbers, right, about), "export.check_run"
    value, like = _in_our_units(row, numbers, reading), _typical(row, numbers, reading)
    seen = [finding(code, key=row.shown, words=w) for w in words if not w.startswith(DIFFERS)]
    return Line(row.shown, value, run, like, "; ".join(words)), seen


def _own(name: str) -> list[Receiver]:
    """Return the receivers of one name: of an IMU's calibration, of a magnetometer's."""
    if name not in receivers():
        hint = suggestion(name, receivers())
        raise error("export.receiver", given=name, hint=hint, allowed=", ".join(receivers()))
    return [receivers(table)[name] for table in TABLES if name in receivers(table)]


def _single(own: Receiver, found: Found, of: str) -> float | None:
    """Return a rate or a time that a file has [SI], None where it is none."""
    for row in own.rows:
        if row.of == (of,) and (numbers := numbers_of(row, found)) is not None:
            value = float(numbers[0] * row.one)
            return value if 0 < value < np.inf else None
    return None


# -- Beside the run ------------------------------------------------------------------------------


def _beside(row: Row, given: FloatArray, right: FloatArray, about: Known) -> list[str]:
    """Say in which of the usual ways a key differs from what the run gives; nothing where right."""
    if row.of[0] in ("rate", "gravity", "correlation") or row.of[0].endswith("_sd"):
        return [] if _same(given, right) else [DIFFERS]
    if _agree(row, given, right):
        return []
    close = [
        (word.count(" and "), float(np.abs(given - y).sum()), word)
        for word, y in _mistakes(row, right, about)
        if _agree(row, given, y) and not _agree(row, y, right)
    ]
    if close:  # one mistake is likelier than two that come to the same
        return [min(close)[-1]]
    if row.noise and (right > 0).all() and (given > 0).all():
        ratio = float(np.median(given / right)) ** (1 / KINDS[row.kind][0])  # of sigmas, as shown
        return [f"{DIFFERS}: {plain(ratio, 3)} times"]
    return [DIFFERS]


def _same(given: FloatArray, y: FloatArray) -> bool:
    return bool((np.abs(given - y) <= CLOSE * np.abs(y)).all())


def _agree(row: Row, given: FloatArray, y: FloatArray) -> bool:
    """Return whether numbers are the same, of matrices by what they differ from no error."""
    if row.noise:
        return _same(given, y)
    none = row.told(Known(ImuModel()))
    base = np.zeros_like(y) if none is None else none
    size = np.linalg.norm(y - base)
    return bool(np.linalg.norm(given - y) <= CLOSE * size)


def _mistakes(row: Row, y: FloatArray, about: Known) -> Iterator[tuple[str, FloatArray]]:
    """Yield what a key would be after each of the usual mistakes."""
    if row.of[0].startswith("mag."):
        yield from _mag_mistakes(row, y, about)
        return
    accel = row.of[0].startswith("accel")
    power, needs = KINDS[row.kind] if row.noise else (1, "")
    factors: dict[str, float] = {}
    if row.noise and about.rate and needs == "":
        factors["is a sample value, not a density"] = about.rate ** (power / 2)
    if row.noise and about.rate and needs == "rate":
        factors["is a density, not a value per sample"] = (row.times**2 * about.rate) ** (
            -power / 2
        )
    if row.noise and row.times != 1.0:
        factors[f"lacks the factor {row.times:.4g}"] = row.times**-power
    if accel:
        factors["is in g, not in m/s^2"] = STANDARD_GRAVITY**-power
    elif "deg" in row.unit:
        factors["is in radians, not in degrees"] = np.radians(1.0) ** power
    else:
        factors["is in degrees, not in radians"] = np.degrees(1.0) ** power
    whole = row.noise or row.of[0].endswith("bias")
    for word, factor in factors.items() if whole else ():
        yield word, y * factor
    for (one, f), (two, g) in combinations(factors.items(), 2) if whole else ():
        yield f"{one}, and {two}", y * f * g
    if row.noise:
        word = "is a variance, not a sigma" if power == 1 else "is a sigma, not a variance"
        exponent = 2.0 if power == 1 else 0.5
        yield word, (y * row.one) ** exponent / row.one
        yield word, y**exponent  # squared in the unit of the file
        for more, factor in factors.items():
            yield f"{word}, and {more}", (y * factor * row.one) ** exponent / row.one
    else:
        yield from _inverse_direction(row, y, about)


def _mag_mistakes(row: Row, y: FloatArray, about: Known) -> Iterator[tuple[str, FloatArray]]:
    """Yield what a key of a magnetometer would be in another unit, and in the other direction."""
    m = about.mag.model
    if row.unit:
        for unit in ("T", "uT", "nT", "G", "mG"):
            if unit != row.unit:
                yield f"is in {unit}, not in {row.unit}", y * row.one / size(unit)
    inverse_m = inverse(m.matrix)
    for other in (replace(m, bias=-m.bias), replace(m, matrix=inverse_m, bias=-inverse_m @ m.bias)):
        turned = row.told(replace(about, mag=replace(about.mag, model=other)))
        if turned is not None:
            yield "is the correction in the inverse direction", turned


def _inverse_direction(row: Row, y: FloatArray, about: Known) -> Iterator[tuple[str, FloatArray]]:
    """Yield what a key would be with the inverse of its matrix, of the model, and with -b for b."""
    word = "is the correction in the inverse direction"
    if _lengths(row.of[0], np.eye(3)) is not None and y.size == 9:
        yield word, inverse(y.reshape(3, 3) * row.one).ravel() / row.one
    m = about.model
    inv_a, inv_g = inverse(m.accel_matrix), inverse(m.gyro_matrix)
    turned = replace(
        m, accel_matrix=inv_a, gyro_matrix=inv_g, accel_bias=-inv_a @ m.accel_bias,
        gyro_bias=-inv_g @ m.gyro_bias, g_sensitivity=-inv_g @ m.g_sensitivity @ inv_a,
    )  # fmt: skip
    flipped = replace(
        m, accel_bias=-m.accel_bias, gyro_bias=-m.gyro_bias, g_sensitivity=-m.g_sensitivity
    )
    for other in (turned, flipped):
        told = row.told(replace(about, model=other))
        if told is not None:
            yield word, told


# -- What no sensor can have ---------------------------------------------------------------------


def _none(row: Row, numbers: FloatArray) -> str:
    """Say that numbers are none, or noise that is none."""
    if not np.isfinite(numbers).all():
        return "is not finite"
    noise = numbers[:: 4 if row.layout == "diagonal" else 1]
    return "is zero or negative" if row.noise and (noise <= 0).any() else ""


def _impossible(row: Row, numbers: FloatArray, reading: Known) -> Iterator[str]:
    for name, x in row.meant(numbers, reading).items():
        known = name.replace("true_bias", "bias")
        if known in POSSIBLE:
            low, high = POSSIBLE[known]
            if (x < low).any() or (x > high).any():
                yield f"is {_shown(name, x)}: no sensor has that"
        elif (lengths := _lengths(name, x)) is not None and (
            lengths.min() < SCALES[0] or lengths.max() > SCALES[1]
        ):
            yield "changes lengths by more than a factor of 2"


def _lengths(name: str, x: FloatArray) -> FloatArray | None:
    """Return by what a matrix, or scale factors, change lengths; None of what is neither."""
    form = name.partition(".")[2]
    if form in ("matrix", "inverse", "rest", "lower", "upper", "rotation", "upper_rotation"):
        return np.asarray(np.linalg.svd(x, compute_uv=False))
    if form == "correction":
        return np.asarray(np.linalg.svd(x + np.eye(3), compute_uv=False))
    if form == "of_rows":
        return np.asarray(np.linalg.svd(x, compute_uv=False))
    if form == "scale":
        return np.asarray(1 + x)
    return x if form in ("diagonal_inverse", "inner_diagonal", "outer_diagonal") else None


# -- In our units --------------------------------------------------------------------------------


def _in_our_units(row: Row, numbers: FloatArray, reading: Known) -> str:
    meant = row.meant(numbers, reading)
    if not meant:
        return "a value per sample; say --rate"
    return "; ".join(_shown(name, x) for name, x in meant.items())


def _shown(name: str, x: FloatArray) -> str:
    flat = np.ravel(x)
    kind = _SHOWN.get(name)
    if kind is None:
        return ", ".join(plain(float(v), 6) for v in flat + 0.0)
    unit = display_unit(kind, float(np.abs(flat).max()))
    return ", ".join(plain(convert(float(v), kind, unit), 4) for v in flat) + f" {unit}"


def _typical(row: Row, numbers: FloatArray, reading: Known) -> str:
    """Return the grade whose white noise is the nearest, where a row has white noise."""
    if not row.noise or not row.of[0].endswith("white") or not (numbers > 0).any():
        return ""
    x = next(iter(row.meant(numbers, reading).values()), None)
    if x is None:
        return ""
    triad = row.of[0].partition(".")[0]
    white = {name: getattr(grade(name).noise, triad).white for name in GRADES}
    mean = float(np.log(np.max(x)))
    return min(white, key=lambda name: abs(np.log(white[name]) - mean))


def mistakes(seen: Sequence[Finding]) -> bool:
    """Return whether something in a file is wrong for certain."""
    return any(one.severity == "warning" for one in seen)
