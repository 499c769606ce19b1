"""Noise of an inertial sensor, of its samples and of means over rests and turns.

The discrete error of one axis, sampled every ``dt``, is::

    e_k = white / sqrt(dt) * n_k  +  m_k  +  r_k,    then rounded to `quantisation`
    m_k = exp(-dt / correlation_time) m_{k-1} + ...   stationary, sd = bias_instability
    r_k = r_{k-1} + random_walk * sqrt(dt) * n'_k

Of means over rests and turns white noise makes independent observations, one 3 x 3 block each.
Bias instability and random walk tie them together: the bias averaged over one rest or turn is
correlated with the bias over every other, and their covariance matrix is known exactly.

References
----------
.. [1] IEEE Std 952-1997, annex C (angle random walk, bias instability, rate random walk).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from numbers import Real
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from foucault import units
from foucault.arrays import BoolArray, FloatArray
from foucault.errors import Finding, error, require, suggestion


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

    def __post_init__(self) -> None:
        for name, given in vars(self).items():
            require(f"noise.{name}", given, Real)
            if not 0 <= given < math.inf:
                raise error("noise.size", name=name, given=given)


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

    def __post_init__(self) -> None:
        for name in ("accel", "gyro"):
            require(f"noise.{name}", getattr(self, name), TriadNoise)


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
            "campaign.value", key=key, given=repr(name), hint=suggestion(str(name), GRADES),
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


QUIET_ENDS = 0.6
"""About how long a turn between two detected rests is still quiet, both ends together [s]."""

QUIETEST = 1e-9
"""Least white noise, [m/s^2/sqrt(Hz)] and [rad/s/sqrt(Hz)]: below what any instrument has, and far
enough above rounding that the estimation of a noise-free log settles."""


@dataclass(frozen=True)
class SessionNoise:
    """The noise of the readings of a session."""

    # accel_psd, gyro_psd: (3,) white noise power that acts on the mean of a rest [unit^2 s]
    accel_psd: FloatArray
    gyro_psd: FloatArray
    # (3,) white noise power that the integration over a turn adds up [rad^2/s]
    turn_psd: FloatArray
    slow: ImuNoise  # bias instability and random walk; its white part is not used here
    # accel_rounding, gyro_rounding: (3,) constant error of rounding in the mean of a rest [unit]:
    # another one in every rest for the accelerometers, the same in all rests for the gyros, which
    # always read their bias
    accel_rounding: FloatArray = field(default_factory=lambda: np.zeros(3))
    gyro_rounding: FloatArray = field(default_factory=lambda: np.zeros(3))
    # accel_carried, gyro_carried: (3,) variance of the sum of increments at an instant, whose
    # rounding goes on to the next reading: it counts at both ends of a rest or turn [unit^2 s^2]
    accel_carried: FloatArray = field(default_factory=lambda: np.zeros(3))
    gyro_carried: FloatArray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        for name in ("accel_psd", "gyro_psd", "turn_psd"):
            object.__setattr__(self, name, np.maximum(getattr(self, name), QUIETEST**2))

    @classmethod
    def declared(cls, noise: ImuNoise, interval: float, increments: bool = False) -> SessionNoise:
        """Take the noise as declared; rounding to steps acts as white noise, but of increments.

        `noise`: declared noise [SI]; `interval`: sample interval [s]; `increments`: whether the
        samples are means over their intervals, which carry rounding on.
        """

        def carried(triad: TriadNoise) -> FloatArray:
            return np.full(3, carried_rounding(triad.quantisation, interval))

        if increments:
            white = [np.full(3, triad.white**2) for triad in (noise.accel, noise.gyro)]
            return cls(
                white[0], white[1], white[1], noise,
                accel_carried=carried(noise.accel), gyro_carried=carried(noise.gyro),
            )  # fmt: skip

        def psd(triad: TriadNoise) -> FloatArray:
            return np.full(3, triad.white**2 + triad.quantisation**2 / 12 * interval)

        def rounding(triad: TriadNoise) -> FloatArray:
            sd = triad.white / np.sqrt(interval)
            return np.full(3, rounding_bias(triad.quantisation, sd))

        return cls(
            psd(noise.accel), psd(noise.gyro), psd(noise.gyro), noise,
            accel_rounding=rounding(noise.accel), gyro_rounding=rounding(noise.gyro),
        )  # fmt: skip

    @classmethod
    def measured(cls, accel: Any, gyro: Any) -> SessionNoise:
        """Take the noise as measured in rests, see `detect.noise.measure_noise`.

        `gyro`: None without gyros.
        """
        if gyro is None:
            zero = np.zeros(3)
            return cls(
                accel.psd_of_mean, zero, zero, ImuNoise(),
                accel_rounding=accel.rounding, accel_carried=accel.carried,
            )  # fmt: skip
        return cls(
            accel.psd_of_mean, gyro.psd_of_mean, gyro.psd, ImuNoise(),
            accel_rounding=accel.rounding, gyro_rounding=gyro.rounding,
            accel_carried=accel.carried, gyro_carried=gyro.carried,
        )  # fmt: skip


def window_covariance(start: FloatArray, end: FloatArray, noise: TriadNoise) -> FloatArray:
    """Return the covariance of the slow bias averaged over windows that do not overlap.

    Markov part, with tau the correlation time and T the lengths: ``s^2 2 tau/T (1 - tau/T
    (1 - exp(-T/tau)))`` on the diagonal, and off it ``s^2`` times the product of the averages
    of the two exponentials. Random walk: ``q^2 (t + T/3)`` on the diagonal, ``q^2`` times the
    middle of the earlier window off it (the bias of the model is the value at time zero).

    `start`, `end` (..., m): ends of the windows, counted from the start of each log [s]; `noise`:
    bias instability, correlation time and random walk [SI]. Returns (..., m, m): covariance
    [unit^2].
    """
    T = np.maximum(end - start, 1e-9)
    mid = (start + end) / 2
    tau = noise.correlation_time
    x, each = T / tau, np.arange(T.shape[-1])
    gap = np.abs(mid[..., :, None] - mid[..., None, :]) / tau
    # exp(-gap) sinh(x/2)/(x/2) for each window, kept from overflowing at long windows.
    shape = -np.expm1(-x) / x
    between = np.maximum(gap - (x[..., :, None] + x[..., None, :]) / 2, 0.0)
    markov = np.exp(-between) * (shape[..., :, None] * shape[..., None, :])
    small = x < 1e-4
    own = 2 / x * (1 - shape)
    markov[..., each, each] = np.where(small, 1 - x / 3, own)
    walk = np.minimum(mid[..., :, None], mid[..., None, :])
    walk[..., each, each] = start + T / 3
    return np.asarray(noise.bias_instability**2 * markov + noise.random_walk**2 * walk)


@dataclass(frozen=True)
class Readings:
    """Means over the positions of a session on a table."""

    # (n, 3) outer, middle and inner angle at the start, as the table or the plan says; NaN where
    # unknown [rad]
    angles: FloatArray
    # (n,) rate of the outer axis, counter-clockwise seen from above; 0 at rest [rad/s]
    rate: FloatArray
    turns: FloatArray  # (n,) turns that were averaged; whole for a spin, 0 at rest [1]
    # start, time: (n,) beginning and length of each average [s]
    start: FloatArray
    time: FloatArray
    accel: FloatArray | None  # (n, 3) mean specific force as measured, frame b [m/s^2]
    gyro: FloatArray | None  # (n, 3) mean rate w_ib_b as measured [rad/s]
    # accel_cov, gyro_cov: (n, 3, 3) covariance of the noise of these means [SI]
    accel_cov: FloatArray
    gyro_cov: FloatArray
    interval: float = 0.0  # sample interval of the log, 0 where it held means [s]
    # whether the rows of the log were means over their intervals, which carry rounding on
    increments: bool = False
    declared: bool = False  # whether the noise was declared, not measured
    findings: tuple[Finding, ...] = field(default=())  # what was noticed when they were made
    # bias instability and random walk that were declared: they are in the covariances, and tie the
    # readings together besides; None for none [SI]
    slow: ImuNoise | None = None
    rate_logged: bool = False  # whether the log tells the rates of the spins, and no plan

    def __len__(self) -> int:
        return len(self.rate)

    @property
    def spin(self) -> BoolArray:
        """Which readings are spins, shape (n,)."""
        return np.asarray(self.rate != 0.0)

    @property
    def noise_unknown(self) -> bool:
        """Whether nothing but the residuals of a fit tells the noise."""
        return any(f.code == "readings.noise_unknown" for f in self.findings)

    @property
    def noise_from(self) -> Literal["declared", "measured", "unknown"]:
        """Where the noise is from."""
        if self.declared:
            return "declared"
        return "unknown" if self.noise_unknown else "measured"

    def __getitem__(self, rows: BoolArray | npt.NDArray[np.intp]) -> Readings:
        """Return some of the readings, by mask or by number."""
        names = ("angles", "rate", "turns", "start", "time", "accel_cov", "gyro_cov")
        some = {name: getattr(self, name)[rows] for name in names}
        accel = None if self.accel is None else self.accel[rows]
        gyro = None if self.gyro is None else self.gyro[rows]
        return replace(self, accel=accel, gyro=gyro, **some)

    def with_noise(self, noise: ImuNoise) -> Readings:
        """Return the same readings with the covariance that declared `noise` [SI] gives them.

        White noise and rounding average out. Bias instability and random walk do so hardly, and
        tie one reading to the next: see `wander`.
        """
        accel = mean_variance(noise.accel, self.time, self.interval, self.increments)
        gyro = mean_variance(noise.gyro, self.time, self.interval, self.increments)
        return replace(
            self,
            accel_cov=accel[:, None, None] * np.eye(3),
            gyro_cov=gyro[:, None, None] * np.eye(3),
            declared=True,
            findings=tuple(f for f in self.findings if f.code != "readings.noise_unknown"),
            slow=slow_part(noise),
        )

    def wander(self) -> tuple[FloatArray | None, FloatArray | None]:
        """Return the covariance of the slow biases over all readings, as accel and gyro have them.

        Each shape (n, n), alike for the three axes [SI]; None where nothing slow was declared.
        """
        if self.slow is None:
            return None, None
        out = []
        for means, noise in ((self.accel, self.slow.accel), (self.gyro, self.slow.gyro)):
            none = means is None or not (noise.bias_instability or noise.random_walk)
            middle = self.start + self.time / 2
            out.append(None if none else wander(noise, middle, self.time))
        return out[0], out[1]

    def without_wander(self) -> Readings:
        """Return the same readings with the covariance of what is new in each of them alone."""
        if self.slow is None:
            return self
        quick = []
        for cov, noise in ((self.accel_cov, self.slow.accel), (self.gyro_cov, self.slow.gyro)):
            slow = wander_variance(noise, self.time)
            quick.append(cov - slow[:, None, None] * np.eye(3))
        return replace(self, accel_cov=quick[0], gyro_cov=quick[1])


def slow_part(noise: ImuNoise) -> ImuNoise | None:
    """Return bias instability and random walk alone, None where there is neither.

    `noise`: noise of the instrument [SI].
    """
    if not any(t.bias_instability or t.random_walk for t in (noise.accel, noise.gyro)):
        return None
    alone = (replace(t, white=0.0, quantisation=0.0) for t in (noise.accel, noise.gyro))
    return ImuNoise(*alone)


def wander(noise: TriadNoise, middle: FloatArray, time: FloatArray) -> FloatArray:
    """Return the covariance between means that declared wander of the bias makes, (n, n) [unit^2].

    The bias is the long-term one: a session that is shorter than the correlation time has one
    error of it in all its means, however many there are. A random walk starts with the first.
    Its part of the variance of each mean alone, which `Readings.accel_cov` or `gyro_cov` hold, is
    `wander_variance`.

    `noise`: noise of the triad [SI]; `middle` (n,): middle of each mean [s]; `time` (n,): length
    of each mean [s].
    """
    start = middle - time / 2
    first = float(start.min())
    return window_covariance(start - first, start - first + time, noise)


def wander_variance(noise: TriadNoise, time: FloatArray) -> FloatArray:
    """Return the variance of a mean by wander of the bias, each for itself, shape (n,) [unit^2].

    `noise`: noise of the triad [SI]; `time` (n,): length of each mean [s].
    """
    x = np.maximum(time / noise.correlation_time, 1e-6)
    markov = 2 * (x + np.expm1(-x)) / x**2
    return np.asarray(noise.bias_instability**2 * markov + noise.random_walk**2 * time / 3)


def mean_variance(
    noise: TriadNoise, time: FloatArray, interval: float, increments: bool = False
) -> FloatArray:
    """Return the variance of a mean, shape (n,) [unit^2].

    ``white^2 / T + B^2 m(T / T_c) + K^2 T / 3 + q^2 dt / (12 T) + rounding^2`` with
    ``m(x) = 2 (x - 1 + exp(-x)) / x^2``, the variance of the mean of a Markov process. Of
    increments the sum is rounded, and q adds ``2 (q dt)^2 / (12 T^2)`` alone.

    `noise`: noise of the triad [SI]; `time` (n,): length of each mean [s]; `interval`: sample
    interval, 0 where unknown [s]; `increments`: whether the samples are means over their
    intervals, which carry rounding on.
    """
    out = noise.white**2 / time + wander_variance(noise, time)
    if increments:
        out += 2 * carried_rounding(noise.quantisation, interval) / time**2
    elif interval > 0 and noise.quantisation > 0:
        out += noise.quantisation**2 * interval / (12 * time)
        out += rounding_bias(noise.quantisation, noise.white / np.sqrt(interval)) ** 2
    return np.asarray(np.maximum(out, 1e-24))
