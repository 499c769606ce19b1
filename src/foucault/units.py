"""Units at the edge: the only file that knows deg/h, ug, ppm and arcsec.

Inside the package every number is SI with angles in radians. Text with a unit
("0.01 deg/h") becomes a float here, and a float becomes text for people here.

The vocabulary is our own set of pint definitions (units.txt), so that a symbol means what it means
in this field: ``g`` is the standard acceleration of free fall (never gram), ``ug`` is micro-g
(never microgram), ``h`` is the hour. Angle, ratio and count are dimensions of their own:
ppm, arcsec and count can therefore never be taken for one another.
"""

from __future__ import annotations

import difflib
import math
import re
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from numbers import Real
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Annotated, Any, SupportsFloat, cast

from annotated_types import Le

from foucault.errors import FoucaultError, error, require_word

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of free fall, the ``g`` of every unit string [m/s^2] (CGPM 1901)."""

ZERO_CELSIUS = 273.15  # 0 degC [K].

CELSIUS = ("degC", "°C", "C", "celsius")
"""Names of the one unit with an offset; only a temperature may be given in it."""

_DEFINITIONS = Path(__file__).with_name("units.txt").read_text(encoding="utf-8")


@dataclass(frozen=True)
class Kind:
    """What a number is: its SI unit, how people like to read it, and an example."""

    name: str
    si: str
    display: tuple[str, ...]
    example: str


def _kinds(rows: Iterable[tuple[str, str, str, str]]) -> dict[str, Kind]:
    return {name: Kind(name, si, tuple(show.split()), eg) for name, si, show, eg in rows}


# Display units run from small to large; `display_unit` picks among them by magnitude.
KINDS: dict[str, Kind] = _kinds(
    [
        ("time", "s", "ms s", "30 s"),
        ("delay", "s", "us ms s", "1 ms"),
        ("frequency", "Hz", "Hz", "100 Hz"),
        ("length", "m", "m", "250 m"),
        ("lever arm", "m", "mm m", "3 cm"),
        ("angle", "rad", "arcsec arcmin deg", "45 deg"),
        ("temperature", "K", "K", "25 degC"),
        ("temperature difference", "K", "K", "2 K"),
        ("specific force", "m/s^2", "ug mg", "50 ug"),
        ("gravity", "m/s^2", "m/s^2", "9.81234 m/s^2"),
        ("angular rate", "rad/s", "deg/h deg/s", "0.01 deg/h"),
        ("velocity", "m/s", "m/s", "0.1 m/s"),
        ("scale factor error", "ratio", "ppm percent", "200 ppm"),
        ("misalignment", "rad", "arcsec arcmin deg", "30 arcsec"),
        ("quadratic", "1/(m/s^2)", "ug/g^2 mg/g^2", "10 ug/g^2"),
        ("cubic", "1/(rad/s)^2", "ppb/(deg/s)^2 ppm/(deg/s)^2", "5 ppb/(deg/s)^2"),
        ("g-sensitivity", "rad/s/(m/s^2)", "deg/h/g deg/s/g", "1 deg/h/g"),
        ("deflection", "rad/(m/s^2)", "arcsec/g arcmin/g", "3 arcsec/g"),
        ("g-squared sensitivity", "rad/s/(m/s^2)^2", "deg/h/g^2 deg/s/g^2", "0.01 deg/h/g^2"),
        ("velocity random walk", "m/s^2/sqrt(Hz)", "ug/sqrt(Hz) mg/sqrt(Hz)", "100 ug/sqrt(Hz)"),
        ("angle random walk", "rad/s/sqrt(Hz)", "deg/sqrt(h)", "0.003 deg/sqrt(h)"),
        ("acceleration random walk", "m/s^2/sqrt(s)", "ug/sqrt(h)", "5 ug/sqrt(h)"),
        ("rate random walk", "rad/s/sqrt(s)", "deg/h/sqrt(h)", "0.02 deg/h/sqrt(h)"),
        ("acceleration ramp", "m/s^3", "ug/h ug/s mg/s", "10 ug/h"),
        ("rate ramp", "rad/s^2", "deg/h/h deg/h/s deg/s/s", "0.01 deg/h/h"),
        ("accelerometer bias per kelvin", "m/s^2/K", "ug/K mg/K", "100 ug/K"),
        ("gyro bias per kelvin", "rad/s/K", "deg/h/K deg/s/K", "0.1 deg/h/K"),
        ("scale factor per kelvin", "ratio/K", "ppm/K percent/K", "20 ppm/K"),
        ("magnetic field", "T", "nT uT", "0.3 uT"),
        ("magnetic field per kelvin", "T/K", "nT/K", "10 nT/K"),
        ("velocity increment", "m/s", "m/s", "0.001 m/s"),
        ("angle increment", "rad", "arcsec", "0.1 arcsec"),
        ("accelerometer count scale", "count/(m/s^2)", "count/(m/s^2)", "415 count/(m/s^2)"),
        ("gyro count scale", "count/(rad/s)", "count/(rad/s)", "4778 count/(rad/s)"),
        ("magnetometer count scale", "count/T", "count/uT", "6.7 count/uT"),
    ]
)


@cache
def _registry() -> Any:
    import pint

    registry: Any = pint.UnitRegistry(None, cache_folder=None)
    for line in _DEFINITIONS.strip().splitlines():
        registry.define(line)
    return registry


# A unit is words with powers, multiplied and divided; a number stands in front of it, not within.
_UNIT = re.compile(
    r"""\s*(?:1\s*(?=/))?            # "1/(m/s^2)"
    (?:(?:[A-Za-zµμ°%][A-Za-z_µμ°%]*   # a name
        | sqrt\s*\( | √\s*\(? | [()*/]
        | (?:\^|\*\*)\s*(?:[-+]?\d{1,2}(?:\.\d{1,3})?|\(\s*[-+]?\d(?:\s*/\s*\d)?\s*\)) | ²
        )\s*)+""",
    re.VERBOSE,
)
_DEGREES = re.compile(
    r"""\s*(?P<sign>[-+]?)\s*(?P<deg>\d{1,3}) \s*(?:°|d|deg)\s*
    (?P<min>\d{1,2}(?:\.\d+)?) \s*(?:'|′|m|min|arcmin)\s*
    (?:(?P<sec>\d{1,2}(?:\.\d+)?) \s*(?:"|″|''|s|sec|arcsec)\s*)?
    (?P<side>[NSEW]?)\s*""",
    re.VERBOSE,
)
_SIDED = re.compile(r"\s*(?P<deg>\d{1,3}(?:\.\d+)?)\s*(?:°|d|deg)\s*(?P<side>[NSEW])\s*")
_SIDES = {"latitude": "NS", "longitude": "EW"}

_SQRT = re.compile(r"sqrt\(([^()]+)\)")
_INTEGER = re.compile(r"(?<![\w.])(\d+)(?![\w.])")
# No digit, comma or point may follow: "1,5 deg" is not 1 of something.
_NUMBER = re.compile(
    r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?![\d.,])\s*(.*)$", re.DOTALL
)


def _known_units() -> list[str]:
    words: set[str] = set()
    for line in _DEFINITIONS.strip().splitlines():
        parts = [part.strip() for part in line.split("=")]
        words.add(parts[0])
        words.update(p for p in parts[2:] if p.isidentifier())
    return sorted(words)


_POWER = re.compile(r"(?<=[A-Za-z])(\d)")


def _pint_text(unit: str) -> str:
    text = unit.replace("µ", "u").replace("μ", "u").replace("°", "deg").replace("%", "percent")
    text = text.replace("^", "**").replace("²", "**2")
    text = re.sub(r"√\s*(\w+)", r"sqrt(\1)", text).replace("√", "sqrt")
    # Floats overflow where integers would grow without bound: 9^9^9^9.
    return _INTEGER.sub(r"\1.0", _SQRT.sub(r"((\1)**0.5)", text))


@cache
def _factor_and_dimension(unit: str) -> tuple[float, str]:
    """Return the SI value of one `unit` and its dimension as text."""
    if unit.strip() in ("", "1"):
        return 1.0, "dimensionless"
    if unit in (known := _common()):
        return known[unit]
    return _by_pint(unit)


@cache
def _common() -> dict[str, tuple[float, str]]:
    """Return what pint says of units that are often met: it takes a third of a second to load."""
    import json

    text = Path(__file__).with_name("units_common.json").read_text(encoding="utf-8")
    return {unit: (size, dimension) for unit, (size, dimension) in json.loads(text).items()}


def _by_pint(unit: str) -> tuple[float, str]:
    try:
        if not _UNIT.fullmatch(unit):  # what pint would go on to compute: "17.5 deg", "+8.8 deg"
            raise ValueError("not one unit")
        quantity = _registry().parse_expression(_pint_text(unit)).to_base_units()
        if not 0 < quantity.magnitude < math.inf:
            raise ValueError("nothing, or more than there is")
    except Exception as problem:  # pint raises many types; the user needs one clear sentence
        words = re.findall(r"[A-Za-z_]+", _pint_text(unit))
        known = _known_units()
        unknown = [w for w in words if w not in known and w != "sqrt"]
        near = [m for w in unknown for m in difflib.get_close_matches(w, known, n=2, cutoff=0.5)]
        usual = _POWER.sub(r"^\1", unit.replace("mps", "m/s"))
        with suppress(FoucaultError):
            if usual != unit and _factor_and_dimension(usual):
                near = [usual]
        hint = f" Did you mean {' or '.join(near)}?" if near else ""
        if not hint and re.match(r"\s*[-+*]?\s*[\d.]", unit):
            hint = " A quantity is one number and one unit."
        raise error("unit.unknown", unit=unit, hint=hint) from problem
    return float(quantity.magnitude), _dimension_text(quantity)


def _dimension_text(quantity: Any) -> str:
    powers = {k: round(float(v), 6) for k, v in dict(quantity.dimensionality).items()}
    # "ug/g^2" and "ppm/g" both mean a ratio per acceleration: a ratio is a pure number.
    powers.pop("[ratio]", None) if len(powers) > 1 else None
    return " ".join(f"{k}^{v:g}" for k, v in sorted(powers.items())) or "dimensionless"


def factor(unit: str, kind: str) -> float:
    """Give the SI value of one `unit`, after checking that it measures `kind`.

    Returns SI value of one `unit` [SI unit of the kind].
    """
    require_word("kind", kind, KINDS)
    want = KINDS[kind]
    value, dimension = _factor_and_dimension(unit)
    if dimension != _factor_and_dimension(want.si)[1]:
        raise error("unit.kind", unit=unit or "no unit", kind=kind, example=want.example)
    return value


def size(unit: str) -> float:
    """Give the SI value of one `unit` of whatever kind [SI]."""
    return _factor_and_dimension(unit)[0]


def powers(unit: str) -> dict[str, float]:
    """Give the power of each dimension in one `unit`, such as {"[length]": 1, "[time]": -2} [1]."""
    said = _factor_and_dimension(unit)[1]
    if said == "dimensionless":
        return {}
    return {name: float(power) for name, _, power in (p.partition("^") for p in said.split())}


def parse(text: object, kind: str, key: str = "value") -> float:
    """Turn text with a unit into an SI float.

    Parameters
    ----------
    text : str
        Number and unit, for instance ``"0.01 deg/h"``. A bare number is refused.
    kind : str
        What the number must be, a key of `KINDS`.
    key : str
        Name used in the error.

    Returns
    -------
    float
        The value [SI unit of the kind].
    """
    require_word("kind", kind, KINDS)
    want = KINDS[kind]
    if kind == "angle" and isinstance(text, str):
        angle = _degrees(text, key)
        if angle is not None:
            return angle
    match = _NUMBER.match(text) if isinstance(text, str) else None
    if match is None or not match.group(2).strip():
        raise error("unit.missing", key=key, given=repr(text), kind=kind, example=want.example)
    number, unit = float(match.group(1)), match.group(2).strip()
    if kind == "temperature" and unit in CELSIUS:
        return number + ZERO_CELSIUS
    value = number * factor(unit, kind)
    if not math.isfinite(value):
        raise error("unit.missing", key=key, given=repr(text), kind=kind, example=want.example)
    return value


def _degrees(text: str, key: str) -> float | None:
    """Read ``48d50m46s`` or ``48°50'46"N``; None where `text` is neither [rad]."""
    match = _DEGREES.fullmatch(text) or _SIDED.fullmatch(text)
    if match is None:
        return None
    said = match.groupdict()
    minutes, seconds = float(said.get("min") or 0), float(said.get("sec") or 0)
    side, sign = said["side"], said.get("sign") or ""
    wanted = _SIDES.get(re.split(r"[.-]", key)[-1], "NSEW")
    reason = (
        "minutes and seconds stay below 60" if minutes >= 60 or seconds >= 60
        else "only the last number has decimals" if "." in (said.get("min") or "")
        and said.get("sec") is not None
        else f"a sign beside {side}" if side and sign
        else f"{side} is no side of it" if side not in wanted
        else ""
    )  # fmt: skip
    if reason:
        raise error("unit.angle", key=key, given=repr(text), reason=reason)
    size = float(said["deg"]) + minutes / 60 + seconds / 3600
    return math.radians(-size if sign == "-" or side in ("S", "W") else size)


def convert(value: float, kind: str, unit: str) -> float:
    """Express an SI number in a unit.

    Parameters
    ----------
    value : float
        What is to be expressed [SI unit of `kind`].
    kind : str
        What it measures, such as "angular rate"; see `KINDS`.
    unit : str
        The unit, such as "deg/h"; one of another kind is refused.
    """
    if kind == "temperature" and unit in CELSIUS:
        return value - ZERO_CELSIUS
    return value / factor(unit, kind)


def display_unit(kind: str, magnitude: float) -> str:
    """Choose the unit people would read `magnitude` [SI] in: the largest that keeps it >= 1."""
    units = KINDS[kind].display
    best = units[0]
    for unit in units[1:]:
        if abs(magnitude) >= factor(unit, kind):
            best = unit
    return best


def display_units(kinds: Sequence[str], sizes: Iterable[float]) -> tuple[str, ...]:
    """Choose one unit for all of a kind, that of the middle one of those that are finite.

    `sizes` (n,): magnitudes, the infinite ones and those that are no number decide nothing [SI].
    """
    of_kind: dict[str, list[float]] = {kind: [] for kind in kinds}
    for kind, size in zip(kinds, sizes, strict=True):
        of_kind[kind] += [float(size)] if math.isfinite(size) else []
    unit = {kind: display_unit(kind, median(some or [0.0])) for kind, some in of_kind.items()}
    return tuple(unit[kind] for kind in kinds)


def plain(value: float, digits: int = 4) -> str:
    """Write `value`, shape () [any], to `digits` [1] significant digits, no exponent above 1e-6."""
    if not 1e-6 <= abs(value) < 1e15:
        return f"{value:.{digits}g}"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    text = f"{float(f'{value:.{digits}g}'):.{decimals}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def span(seconds: float) -> str:
    """Write a length of time, `seconds`, shape () [s], in the unit people would read it in."""
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if abs(seconds) >= size:
            return f"{plain(seconds / size)} {unit}"
    return f"{plain(seconds / 1e-6)} us"


def _is_real(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


SMALLEST = 1e-60  # Nothing that a person gives is so small, and nothing one over this [SI].

SIZES = {
    "time": (1e-12, 1e15), "delay": (1e-12, 1e15), "angle": (SMALLEST, 1e6),
    "length": (SMALLEST, 1e15), "angular rate": (SMALLEST, 1e15), "velocity": (SMALLEST, 1e15),
    "frequency": (SMALLEST, float("inf")),
}  # fmt: skip
"""Sizes of what a session has, by kind; beyond any, and still within the numbers of a computer
[SI]."""


@dataclass(frozen=True)
class Quantity:
    """Marks a pydantic field as a number with a unit, held in SI.

    ``rate: Annotated[float, Quantity("frequency")]`` takes ``"100 Hz"`` and gives 100.0. In a
    campaign file a bare ``100`` is refused; from Python a number is SI, as everywhere there.
    """

    kind: str

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import core_schema

        def read(value: object, info: Any) -> float:
            in_file = "locate" in (info.context or ())
            if not in_file and _is_real(value):
                return float(cast(SupportsFloat, value))
            try:
                key = str(info.field_name or "value")
                number = parse(value, self.kind, key)
                least, most = SIZES.get(self.kind, (SMALLEST, 1 / SMALLEST))
                if number and not least <= abs(number) <= most:
                    raise error("unit.range", key=key, given=repr(value))
                return number
            except FoucaultError as problem:
                # A reader that wants the place of the mistake too (a campaign file) says so.
                if in_file:
                    raise ValueError(problem) from None
                raise

        # Bounds that stand before this mark, as those of Field(gt=0) do, are in the schema so far.
        return core_schema.with_info_before_validator_function(read, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return {
            "type": "string",
            "description": f"{self.kind} with its unit",
            "examples": [KINDS[self.kind].example],
        }


Seconds = Annotated[float, Quantity("time")]
Angle = Annotated[float, Quantity("angle")]
Rate = Annotated[float, Quantity("angular rate")]
Ratio = Annotated[float, Quantity("scale factor error")]
Length = Annotated[float, Quantity("length")]
Velocity = Annotated[float, Quantity("velocity")]
Force = Annotated[float, Quantity("specific force")]

AngleSd = Annotated[float, Le(math.pi), Quantity("angle")]
"""An sd of half a turn says that nothing is known; beyond it, it only spoils the arithmetic."""

RatioSd = Annotated[float, Le(1.0), Quantity("scale factor error")]  # Likewise an sd of the whole.
