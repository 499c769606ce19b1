"""Common instruments by their data sheets: noise, and sizes of what a calibration leaves out.

What a sheet says is data (``parts.toml``), each number with source, page and wording; here is what
is made of it. Of an axis that reads y of x, over a full scale of X::

    y = x + K x^2    best straight line misses by K X^2 / 2 = e X,  K = 2 e / X
    y = x + c x^3    best straight line misses by c X^3 / 4 = e X,  c = 4 e / X^2
    y = x + a |x|    scale factors 1 + a and 1 - a, which differ by A = 2 a

with e the nonlinearity and A the asymmetry of the scale factor as sheets state them. The best line
is that of least largest error: x^2 less X^2 / 2, and x^3 less 3 X^2 x / 4 (Chebyshev). All of the
nonlinearity goes to the quadratic of an accelerometer and to the cubic of a gyro, which is
symmetric by its construction.

A noise density d is one-sided: samples of bandwidth B have the variance d^2 B. Random walk N has
the two-sided density N^2 = d^2 / 2. (ADIS16460: 0.004 deg/s/sqrt(Hz) gives 0.170 deg/sqrt(h), as
its sheet says, 0.17; 0.2 mg/sqrt(Hz) gives 0.083 m/s/sqrt(h), 0.09.)

References
----------
.. [1] IEEE Std 528-2019, asymmetry, nonlinearity, random walk.
.. [2] JCGM 100:2008 (GUM), 4.3: standard uncertainty of type B from limits.
"""

from __future__ import annotations

import math
import re
import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import Field, model_validator

from foucault import units
from foucault.errors import error, suggestion
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.strict import Strict

_FILE = Path(__file__).with_suffix(".toml")

_TRIADS = {
    "accel": ("specific force", "velocity random walk", "accelerometer bias per kelvin",
              "quadratic"),
    "gyro": ("angular rate", "angle random walk", "gyro bias per kelvin", "g-squared sensitivity"),
}  # fmt: skip
_RATIOS = (
    "nonlinearity", "cross_axis", "scale_tolerance", "scale_repeatability", "scale_asymmetry",
    "scale_over_temperature",
)  # fmt: skip

QUANTITIES: dict[str, str] = {
    f"{triad}.{name}": kind
    for triad, (reading, walk, warming, rectified) in _TRIADS.items()
    for name, kind in {
        "range": reading, "density": walk, "random_walk": walk, "bias_instability": reading,
        "bias_repeatability": reading, "bias_over_temperature": reading, "bias_per_kelvin": warming,
        **dict.fromkeys(_RATIOS, "scale factor error"),
        "scale_per_kelvin": "scale factor per kelvin", "vibration_rectification": rectified,
    }.items()
} | {
    "accel.quadratic": "quadratic", "accel.cross_quadratic": "quadratic",
    "gyro.g_sensitivity": "g-sensitivity", "clock.tolerance": "scale factor error",
}  # fmt: skip
"""What a sheet may say -> its kind. A range is the least that can be chosen."""

SIZES: dict[str, str] = {
    "accel.quadratic": "quadratic", "accel.cross": "quadratic",
    "accel.asymmetry": "scale factor error", "gyro.g_sensitivity": "g-sensitivity",
    "gyro.asymmetry": "scale factor error", "gyro.cubic": "cubic", "clock": "scale factor error",
    "accel.bias drift": "specific force", "accel.scale drift": "scale factor error",
    "gyro.bias drift": "angular rate", "gyro.scale drift": "scale factor error",
}  # fmt: skip
"""Groups of terms that a calibration leaves out, and that sheets speak of -> their kind."""

LIMIT_SDS = 2.0
"""Standard deviations to a limit [1]. Even odds within limits give 1.7 (GUM 4.3.7), a triangle 2.4
(4.3.9), a tested tail 3: a size that is too large costs uncertainty, one too small costs truth."""

LEAST_RATE = math.radians(250.0)
"""Full scale of a gyro that turns by hand ask for; a lesser one that can be chosen is not what a
nonlinearity without a full scale is taken to be of [rad/s]."""

WARMING = 1.0
"""Change of temperature from start to end of a session after warming up; judgement [K]."""


class Source(Strict):
    """Where numbers were read."""

    title: str
    address: str
    primary: bool
    """Whether it is the sheet of the maker, and not another document that quotes it."""


class Stated(Strict):
    """One number of a sheet, as text with its unit under the word of how it is meant."""

    typical: str | None = None
    sd: str | None = None
    max: str | None = None
    over: str | None = None
    """Full scale that it belongs to."""
    page: str = Field(min_length=1)
    quote: str = Field(min_length=1)
    source: str = ""
    """Key of its source; that of the part where it is empty."""

    @model_validator(mode="after")
    def _one(self) -> Stated:
        if sum(text is not None for text in (self.typical, self.sd, self.max)) != 1:
            raise ValueError("one of typical, sd and max")
        return self

    @property
    def meant(self) -> str:
        """Return how it is meant: "typical", "sd" or "max"."""
        return next(word for word in ("typical", "sd", "max") if getattr(self, word) is not None)

    @property
    def text(self) -> str:
        """Return the number with its unit, as the sheet has it."""
        return str(getattr(self, self.meant))


class _Part(Strict):
    maker: str
    grade: str
    source: str
    numbers: dict[str, Stated]


class _File(Strict):
    sources: dict[str, Source]
    parts: dict[str, _Part]


@dataclass(frozen=True)
class Part:
    """An instrument by its data sheet."""

    name: str
    maker: str
    grade: str  # its class, such as "consumer MEMS"
    # what the sheet says, by the keys of `QUANTITIES`; what it does not say is not there
    numbers: dict[str, Stated]
    sources: dict[str, Source]  # where each of them was read

    def value(self, key: str) -> float | None:
        """Return a number of the sheet, one of `QUANTITIES`, None where it is not stated [SI]."""
        said = self.numbers.get(key)
        return None if said is None else units.parse(said.text, QUANTITIES[key], key)

    def sd(self, key: str) -> float | None:
        """Return the standard deviation that a number stands for, None without it [SI].

        What is typical counts as one, a limit as `LIMIT_SDS`.
        """
        value = self.value(key)
        if value is None:
            return None
        return value / LIMIT_SDS if self.numbers[key].meant == "max" else value

    def basis(self, key: str) -> str:
        """Return where a number that is stated is from: source, page and how it is meant."""
        said, source = self.numbers[key], self.sources[key]
        meant = {"typical": "typical", "sd": "1 sd", "max": f"limit, {LIMIT_SDS:g} sd"}[said.meant]
        place = f"page {said.page}" if said.page.isdigit() else said.page
        return f"{source.title}, {place}: {said.text} ({meant})"


@cache
def catalogue() -> dict[str, Part]:
    """Return every part by its name."""
    read = _File.model_validate(tomllib.loads(_FILE.read_text(encoding="utf-8")))
    return {
        name: Part(
            name, p.maker, p.grade, p.numbers,
            {key: read.sources[s.source or p.source] for key, s in p.numbers.items()},
        )
        for name, p in read.parts.items()
    }  # fmt: skip


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


def part(name: str) -> Part:
    """Return what the data sheet of an instrument says.

    `name`: such as "ICM-20948"; capitals, blanks and hyphens do not matter, an unknown one is
    refused.
    """
    known = catalogue()
    found = {_plain(one): one for one in known}.get(_plain(name))
    if found is None:
        raise error("part.unknown", name=name, known=", ".join(known), hint=suggestion(name, known))
    return known[found]


def quadratic_of(nonlinearity: float, full_scale: float) -> float:
    """Return K of y = x + K x^2 with the best straight line off by a share of full scale.

    ``K = 2 e / X`` [1/(m/s^2)], `nonlinearity`: e, largest error over full scale [1]; `full_scale`:
    X [m/s^2].
    """
    return 2 * nonlinearity / full_scale


def cubic_of(nonlinearity: float, full_scale: float) -> float:
    """Return c of y = x + c x^3 with the best straight line off by a share of full scale.

    ``c = 4 e / X^2`` [1/(rad/s)^2], `nonlinearity`: e, largest error over full scale [1];
    `full_scale`: X [rad/s].
    """
    return 4 * nonlinearity / full_scale**2


def random_walk_of(density: float) -> float:
    """Return the random walk of a one-sided noise `density` d as sheets state it, d / sqrt(2).

    Both [unit/sqrt(Hz)].
    """
    return density / math.sqrt(2)


_STATED: dict[str, tuple[str, float]] = {
    "accel.quadratic": ("accel.quadratic", 1.0),
    "accel.cross": ("accel.cross_quadratic", 1.0),
    "accel.asymmetry": ("accel.scale_asymmetry", 0.5),
    "gyro.g_sensitivity": ("gyro.g_sensitivity", 1.0),
    "gyro.asymmetry": ("gyro.scale_asymmetry", 0.5),
    "clock": ("clock.tolerance", 1.0),
}
"""Group -> the number that it is, and how much of it."""

_CURVED = {
    "accel.quadratic": ("accel", quadratic_of, "2 e / X", 0.0),
    "gyro.cubic": ("gyro", cubic_of, "4 e / X^2", LEAST_RATE),
}
"""Group -> triad, how it follows from the nonlinearity, and the least full scale [SI]."""


def sizes_of(name: str, warming: float = WARMING) -> dict[str, tuple[float, str]]:
    """Return sizes of the terms that a calibration leaves out, where the data sheet has them.

    `name`: a part, as for `part`; `warming`: change of its temperature from start to end of a
    session, which makes the drifts [K]. Returns group, of `SIZES` -> one standard deviation [SI],
    and what it rests on; those of which the sheet says nothing are not there.

    The cross-axis sensitivity of a sheet is linear in the other axes, a misalignment, and no size
    of the cross terms of second order. A variation over all temperatures is no change by kelvin,
    from which the drifts follow.
    """
    of = part(name)
    out: dict[str, tuple[float, str]] = {}
    for group, (key, share) in _STATED.items():
        if (sd := of.sd(key)) is not None:
            out[group] = sd * share, of.basis(key) + (", halved" if share != 1.0 else "")
    for group, (triad, curved, formula, least) in _CURVED.items():
        if group not in out and (found := _curved(of, triad, least)) is not None:
            share, full_scale, said = found
            out[group] = curved(share, full_scale), f"{said}, {formula}"
    for triad in _TRIADS:
        for what in ("bias", "scale"):
            key = f"{triad}.{what}_per_kelvin"
            if (sd := of.sd(key)) is not None:
                out[f"{triad}.{what} drift"] = sd * warming, f"{of.basis(key)}, {warming:g} K"
    return {group: out[group] for group in SIZES if group in out}


def size_text(group: str, size: float) -> str:
    """Write a size in the unit that people read it in.

    `group`: one of `SIZES`; `size`: shape () [SI].
    """
    unit = units.display_unit(SIZES[group], size)
    return f"{units.plain(units.convert(size, SIZES[group], unit), 3)} {unit}"


def _curved(of: Part, triad: str, least: float) -> tuple[float, float, str] | None:
    """Return nonlinearity [1], full scale [SI] and basis; None where one of them is unknown."""
    key = f"{triad}.nonlinearity"
    share = of.sd(key)
    if share is None:
        return None
    kind = QUANTITIES[f"{triad}.range"]
    if (over := of.numbers[key].over) is not None:
        return share, units.parse(over, kind, key), f"{of.basis(key)} of {over}"
    lowest = of.value(f"{triad}.range")
    if lowest is None:
        return None
    full_scale = max(lowest, least)
    unit = {"accel": "g", "gyro": "deg/s"}[triad]
    shown = f"{units.plain(units.convert(full_scale, kind, unit))} {unit}"
    return share, full_scale, f"{of.basis(key)}, full scale not said, {shown} taken"


def noise_of(name: str) -> ImuNoise | None:
    """Return the white noise that the data sheet of an instrument `name` states [SI].

    Random walk where it is stated, else that of the noise density; limits are taken as they are.
    None where that of accelerometers or gyros is not stated. Bias instability is left out: the
    least value of an Allan plot says nothing of how long the bias stays what it is.
    """
    of = part(name)
    white = {triad: _white(of, triad) for triad in _TRIADS}
    if white["accel"] is None or white["gyro"] is None:
        return None
    return ImuNoise(TriadNoise(white=white["accel"]), TriadNoise(white=white["gyro"]))


def _white(of: Part, triad: str) -> float | None:
    walk, density = of.value(f"{triad}.random_walk"), of.value(f"{triad}.density")
    return walk if walk is not None else None if density is None else random_walk_of(density)


def noise_basis(name: str) -> dict[str, str]:
    """Return triad -> where its white noise is from; a triad without is not there.

    `name`: a part.
    """
    of = part(name)
    out = {}
    for triad in _TRIADS:
        walk, density = f"{triad}.random_walk", f"{triad}.density"
        if walk in of.numbers:
            out[triad] = of.basis(walk)
        elif density in of.numbers:
            out[triad] = f"{of.basis(density)}, over sqrt(2)"
    return out


def as_dict(name: str) -> dict[str, Any]:
    """Return what is known of a part, for JSON: numbers as the sheet has them and in SI.

    `name`: a part.
    """
    of = part(name)
    numbers = {
        key: {
            "text": said.text, "value": of.value(key), "unit": units.KINDS[QUANTITIES[key]].si,
            "meant": said.meant, "over": said.over, "page": said.page, "quote": said.quote,
            "source": of.sources[key].model_dump(),
        }
        for key, said in of.numbers.items()
    }  # fmt: skip
    sizes = {
        group: {"size": size, "unit": units.KINDS[SIZES[group]].si, "basis": basis}
        for group, (size, basis) in sizes_of(name).items()
    }
    return {
        "name": of.name, "maker": of.maker, "grade": of.grade, "numbers": numbers, "sizes": sizes,
    }  # fmt: skip
