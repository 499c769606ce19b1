"""White noise N and random walk K of an instrument for other programs, and where they are from.

Best is a run of `foucault allan`: it holds, for each axis and for each triad, the pair that bounds
the measured curve (`diagnose.bounding_pair`). A campaign declares noise instead: white noise and a
random walk are taken as they are, and where there is a bias instability the pair bounds their
common curve. A procedure alone has measured white noise only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector
from foucault.diagnose.bounding_pair import FIRST, SPAN, Pair, bounding_pair
from foucault.errors import Status, error
from foucault.files import parse_json
from foucault.models.imu import FRAME, LAYOUT
from foucault.models.noise import ImuNoise, TriadNoise
from foucault.result import Level, Result, Verdict
from foucault.run_folder import result_file
from foucault.tables import AXES

ALLAN_FILE = "allan.json"  # What a run of `foucault allan` holds for programs.
UNLIKE = 1.5  # Axes whose noises differ by more than this factor are told [1].
LONG = 10.0  # A Markov process stands for a random walk up to its correlation time over this [1].

UNTIL = 1000.0
"""Up to where the curve of a declared noise is bounded, without an Allan run to say it [s]."""

_UNITS = {"accel": ("m/s^2/sqrt(Hz)", "m/s^2/sqrt(s)"), "gyro": ("rad/s/sqrt(Hz)", "rad/s/sqrt(s)")}


@dataclass(frozen=True)
class Densities:
    """The noise that estimators are told."""

    # accel.white ... gyro.walk (3,), and "one:accel.white" ... () of all axes together [SI]
    values: Mapping[str, FloatArray] = field(default_factory=dict)
    said: tuple[str, ...] = ()  # where it is from, line by line
    rate: float | None = None  # at which it was measured [Hz]
    last: float | None = None  # longest averaging time that it is known for [s]

    @property
    def correlation(self) -> float:
        """Correlation time of a Markov process that stands for the walk [s]."""
        return LONG * (self.last or UNTIL)


def densities(
    noise: ImuNoise | Densities | None, measured: Mapping[str, Any] | None = None
) -> Densities:
    """Return noise for estimators from what is known: an Allan run, a declaration, a procedure.

    `noise`: what was given or declared; `measured`: `diagnostics.noise` of a result, of which the
    white noise is taken where nothing else is known [SI].
    """
    if isinstance(noise, Densities):
        return noise
    values: dict[str, FloatArray] = {}
    said: list[str] = []
    for name in ("accel", "gyro"):
        triad: TriadNoise | None = None if noise is None else getattr(noise, name)
        if triad is not None and triad.white > 0:
            pair, words = _declared(triad)
            values |= _same(f"{name}.white", pair[0])
            if pair[1] > 0:
                values |= _same(f"{name}.walk", pair[1])
            said += [f"Noise of the {name}: declared in the campaign, {words}"]
        elif (white := (measured or {}).get(f"{name}_white")) and None not in white:
            each = np.resize(np.asarray(white, float), 3)
            values |= {f"{name}.white": each, f"one:{name}.white": np.asarray(each.max())}
            said += [f"Noise of the {name}: white noise measured at rest in the calibration; of",
                     "the axes the largest where there is one number for three."]  # fmt: skip
    return Densities(values, tuple(said))


def _same(name: str, value: float) -> dict[str, FloatArray]:
    return {name: np.full(3, value), f"one:{name}": np.asarray(value)}


def _declared(triad: TriadNoise) -> tuple[tuple[float, float], str]:
    if triad.bias_instability <= 0:
        return (triad.white, triad.random_walk), "white noise and random walk as they are."
    tau = 2.0 ** np.arange(-3, np.log2(UNTIL) + 1)
    curve = np.sqrt(allan_variance(triad, tau))
    pair = bounding_pair(tau, curve, curve, triad.white)
    if pair is None:
        raise error("export.no_pair", axis="the noise that is declared")
    return (pair.white, pair.walk), f"with its bias instability; {in_words(pair)}"


def allan_variance(noise: TriadNoise, tau: FloatArray) -> FloatArray:
    """Return the Allan variance of a declared noise, shape (k,) [unit^2], at `tau` (k,) [s].

    IEEE Std 952, annex C, for white noise, Markov noise of standard deviation `bias_instability`,
    and random walk.
    """
    x = tau / noise.correlation_time
    markov = 2 / x * (1 - (3 - 4 * np.exp(-x) + np.exp(-2 * x)) / (2 * x))
    return np.asarray(
        noise.white**2 / tau + noise.bias_instability**2 * markov + noise.random_walk**2 * tau / 3
    )


def in_words(pair: Pair) -> str:
    """Say what a pair bounds."""
    rise = (
        f"N is {pair.raised:.2f} of that of the fit"
        if pair.raised > 1.005
        else "N is that of the fit"
    )
    walk = "" if pair.seen else "; no walk was seen, K is what the record leaves room for"
    walk += "; beyond these times nothing is promised" if pair.last < FIRST * SPAN else ""
    return (
        f"N and K bound the Allan curve from {pair.first:.4g} s to {pair.last:.4g} s, "
        f"{pair.least:.2f} to {pair.most:.2f} times the deviation there; {rise}{walk}."
    )


def of_allan_run(folder: str | Path) -> Densities:
    """Return the noise for estimators of a run of `foucault allan`.

    `folder`: the folder it wrote, or its `allan.json`.
    """
    path = Path(folder)
    path = path / ALLAN_FILE if path.is_dir() else path
    try:
        said = parse_json(path.read_bytes())
        pairs = {k: None if v is None else _pair(v) for k, v in said["pairs"].items()}
        rates = [float(f"{1 / c['interval']:.9g}") for c in said["channels"].values()]
        Q = {name: _quantisation(c) for name, c in said["channels"].items()}
        warned = {f["code"]: str(f["message"]) for f in reversed(said.get("findings", ()))
                  if f["severity"] == "warning"}  # fmt: skip
    except (
        OSError,
        ValueError,
        LookupError,
        TypeError,
        AttributeError,
        ArithmeticError,
    ) as problem:
        raise error("export.allan_run", path=path, reason=problem) from None
    values: dict[str, FloatArray] = {}
    words: list[str] = []
    for triad in ("accel", "gyro"):
        one = pairs.get(triad)
        if one is None:
            if triad in pairs:
                raise error("export.no_pair", axis=f"the {triad}")
            continue
        axes = [pairs.get(f"{triad}.{axis}") or one for axis in AXES]
        for name in ("white", "walk"):
            values[f"{triad}.{name}"] = np.array([getattr(p, name) for p in axes])
            values[f"one:{triad}.{name}"] = np.asarray(getattr(one, name))
        unit = _UNITS[triad]
        words += [f"Noise of the {triad} from the Allan run {path.parent.name or path.name}: "
                  f"N = {one.white:.4g} {unit[0]}, K = {one.walk:.4g} {unit[1]}.",
                  in_words(one)]  # fmt: skip
        words += _unlike(triad, axes)
        steps = [Q.get(f"{triad}.{axis}", 0.0) for axis in AXES]
        if any(steps):
            angle = "rad" if triad == "gyro" else "m/s"
            shown = ", ".join(f"{q:.3g}" for q in steps)
            words += [
                f"Quantisation Q of x, y, z: {shown} {angle}, which the receiver does not",
                f"know: below {one.first:.3g} s the curve is higher by it.",
            ]
    last = [p.last for p in pairs.values() if p is not None]
    words += [f"The Allan run warned: {message}" for message in reversed(warned.values())]
    return Densities(values, tuple(words), max(rates), max(last, default=None))


def _pair(said: Mapping[str, Any]) -> Pair:
    numbers: dict[str, Any] = {f.name: float(said[f.name]) for f in fields(Pair)}
    return Pair(**numbers | {"seen": bool(said["seen"])})


def _quantisation(channel: Mapping[str, Any]) -> float:
    """Return Q of a channel where it was seen, else 0 [unit s]."""
    found = channel.get("noises", {}).get("quantisation", {})
    return float(found["value"]) if found.get("seen") else 0.0


def is_allan_run(path: str | Path) -> bool:
    """Return whether a folder was written by `foucault allan`, and by no calibration."""
    folder = Path(path)
    return folder.is_dir() and (folder / ALLAN_FILE).is_file() and not result_file(folder).is_file()


def no_calibration() -> Result:
    """Return the result of an instrument of which nothing but its noise is known."""
    none = CoefficientVector(LAYOUT.subset([]), np.zeros(0), np.zeros((0, 0)))
    return Result(
        "none, noise alone", none, "accel = f; gyro = w: the instrument is not calibrated", FRAME,
        "not known", Verdict(Level.PASS, ()), (), (), Status.CONVERGED,
    )  # fmt: skip


def _unlike(triad: str, axes: list[Pair]) -> list[str]:
    """Name the axis that stands for three, where they differ."""
    out = []
    for name, letter in (("white", "N"), ("walk", "K")):
        each = [getattr(p, name) for p in axes]
        if max(each) > UNLIKE * min(each):
            worst, shown = AXES[int(np.argmax(each))], ", ".join(f"{x:.3g}" for x in each)
            out += [f"The axes differ: {letter} of x, y, z is {shown}; where one number is for",
                    f"three, it bounds the curves of all, {worst} above all."]  # fmt: skip
    return out
