"""Noise of an inertial sensor: white, bias instability, random walk and quantisation.

The discrete error of one axis, sampled every ``dt``, is::

    e_k = white / sqrt(dt) * n_k  +  m_k  +  r_k,    then rounded to `quantisation`
    m_k = exp(-dt / correlation_time) m_{k-1} + ...   stationary, sd = bias_instability
    r_k = r_{k-1} + random_walk * sqrt(dt) * n'_k

References
----------
.. [1] IEEE Std 952-1997, annex C (angle random walk, bias instability, rate random walk).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from foucault import units
from foucault.errors import error, suggestion


@dataclass(frozen=True)
class TriadNoise:
    """Noise of the three axes of one triad, equal on all axes."""

    # angle or velocity random walk [unit/sqrt(Hz)]: the sd of the mean over T is white/sqrt(T), so
    # white**2 is the two-sided power spectral density
    white: float = 0.0
    bias_instability: float = 0.0  # standard deviation of the first-order Markov bias [unit]
    correlation_time: float = 300.0  # correlation time of the Markov bias [s]
    random_walk: float = 0.0  # rate or acceleration random walk [unit/sqrt(s)]
    # step of the output [unit]; 0 for none. Increments carry their rounding to the next: what is
    # rounded is their sum, to steps of quantisation times the sample interval
    quantisation: float = 0.0


@dataclass(frozen=True)
class ImuNoise:
    """Noise of accelerometers [m/s^2] and gyros [rad/s].

    Attributes
    ----------
    accel, gyro : TriadNoise
        Noise of each triad; without noise where it is left out.
    """

    accel: TriadNoise = field(default_factory=TriadNoise)
    gyro: TriadNoise = field(default_factory=TriadNoise)


@dataclass(frozen=True)
class Grade:
    """A typical instrument class."""

    noise: ImuNoise  # its noise [SI]
    # for each coefficient group the standard deviation, over instruments of the class, of what one
    # has before calibration [SI]
    spread: dict[str, float]


# grade: accel white, gyro white; spreads of accel bias, gyro bias, and of scale factor and
# misalignment (both triads).
_GRADES = {
    "mems": ("120 ug/sqrt(Hz)", "0.3 deg/sqrt(h)", "30 mg", "1500 deg/h", "1 %", "30 arcmin"),
    "tactical": ("30 ug/sqrt(Hz)", "0.05 deg/sqrt(h)", "2 mg", "10 deg/h", "0.1 %", "3 arcmin"),
    "navigation": (
        "5 ug/sqrt(Hz)",
        "0.002 deg/sqrt(h)",
        "100 ug",
        "0.05 deg/h",
        "100 ppm",
        "20 arcsec",
    ),
}

GRADES = tuple(_GRADES)
"""Names of the typical classes."""


def grade(name: str, key: str = "grade") -> Grade:
    """Return a typical class of instruments; measure your own with an Allan plot.

    Parameters
    ----------
    name : str
        One of `GRADES`: "mems", "tactical" or "navigation".
    key : str
        What the class was given for, as an error calls it.

    Raises
    ------
    FoucaultError
        No class has that name.
    """
    if name not in _GRADES:
        raise error(
            "campaign.value", key=key, given=repr(name), hint=suggestion(name, GRADES),
            reason=f"it should be one of {', '.join(GRADES)}", more="",
        )  # fmt: skip
    accel_white, gyro_white, accel_bias, gyro_bias, scale, misalignment = _GRADES[name]
    spread = {
        "accel.bias": units.parse(accel_bias, "specific force"),
        "gyro.bias": units.parse(gyro_bias, "angular rate"),
    }
    for triad in ("accel", "gyro"):
        spread[f"{triad}.scale"] = units.parse(scale, "scale factor error")
        spread[f"{triad}.misalignment"] = units.parse(misalignment, "misalignment")
    noise = ImuNoise(
        TriadNoise(white=units.parse(accel_white, "velocity random walk")),
        TriadNoise(white=units.parse(gyro_white, "angle random walk")),
    )
    return Grade(noise, spread)


def rounding_bias(step: float, sd: float) -> float:
    """Return the sd of the constant error that rounding leaves in a long mean.

    A signal that moves by much less than a step is rounded the same way every time; averaging
    does not help. ``step / sqrt(12) * exp(-2 pi^2 (sd / step)^2)``: all of the rounding error
    without noise, none of it to speak of once the noise is half a step.

    `step`: step of the output [unit]; `sd`: standard deviation of single samples before rounding
    [unit].

    References
    ----------
    .. [1] B. Widrow, I. Kollar, *Quantization Noise*, Cambridge University Press, 2008,
       section 6 (the first harmonic of the rounding error).
    """
    if step <= 0:
        return 0.0
    return step / math.sqrt(12) * math.exp(-2 * (math.pi * sd / step) ** 2)


def carried_rounding(step: float, interval: float) -> float:
    """Return the variance of the sum of increments whose rounding is carried on [unit^2 s^2].

    `step`: step of the output [unit]; `interval`: sample interval [s].
    """
    return (step * interval) ** 2 / 12


def noise_json(noise: ImuNoise) -> dict[str, Any]:
    """Return the noise of a calibration for result.json.

    `noise`: noise of gyro and accelerometers [SI].
    """
    out: dict[str, Any] = {}
    for name in ("gyro", "accel"):
        parts = asdict(getattr(noise, name))
        out |= {f"{name}_{key}": value for key, value in parts.items() if key != "white"}
        out[f"{name}_white"] = [parts["white"]]  # as other procedures write it, axis by axis
    return out


def noise_of(said: Mapping[str, Any]) -> ImuNoise | None:
    """Return the noise that `noise_json` wrote; None where there is none.

    `said`: from result.json [SI].
    """
    if not said.get("gyro_white"):
        return None
    triads = {
        name: TriadNoise(said[f"{name}_white"][0], *(
            said[f"{name}_{f.name}"] for f in fields(TriadNoise) if f.name != "white"))
        for name in ("accel", "gyro")
    }  # fmt: skip
    return ImuNoise(**triads)
