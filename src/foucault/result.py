"""What an estimator is given, what it returns, and what a procedure makes of it.

A procedure builds a `Problem`; any estimator turns it into an `Estimate`; the procedure adds
checks, a verdict and tables and returns a `Result`. N procedures and M estimators stay N + M.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault.arrays import FloatArray
from foucault.coefficients import CoefficientVector, Layout
from foucault.display import Shown, printer
from foucault.errors import Finding, Status, error, require
from foucault.models.imu import ImuModel
from foucault.models.layouts import Instrument, model_of, of_sensors
from foucault.models.size_effect import SizeEffect
from foucault.models.temperature import TemperatureModel
from foucault.symptoms import doubtful
from foucault.tables import Log

TableData = Mapping[str, npt.NDArray[Any]]


@dataclass(frozen=True)
class Linearised:
    """A problem linearised at one state: ``residuals + jacobian @ dx`` is white, unit variance."""

    residuals: FloatArray  # (m,) whitened residuals, observation minus prediction [1]
    # (m, n) derivative of the *prediction*, whitened [1 per unit of the state]
    jacobian: FloatArray
    # (m,) number of the observation (a rest, a turn) each row belongs to; -1 for a prior
    blocks: npt.NDArray[np.int64]


@dataclass(frozen=True)
class Problem:
    """A nonlinear least-squares problem with named coefficients and nuisance parameters."""

    layout: Layout  # the coefficients wanted; they are the first entries of every step
    start: Any  # state to start from (any object that `linearise` and `retract` understand)
    # ``(state, weights) -> Linearised``; `weights`, shape (blocks,), are the robust weights of the
    # observations (their information is multiplied by it)
    linearise: Callable[[Any, FloatArray], Linearised]
    # ``(state, step) -> state``; applies a step, shape (n,), also on a rotation
    retract: Callable[[Any, FloatArray], Any]
    # ``state -> ndarray``, shape (len(layout),), the coefficients of a state [SI]
    values: Callable[[Any], FloatArray]
    n_blocks: int  # number of observations [1]
    # Gaussian prior on the coefficients: values and prior_sd, infinite where there is none
    prior: CoefficientVector | None = None


@dataclass(frozen=True)
class Estimate:
    """What an estimator found."""

    coefficients: CoefficientVector
    state: Any  # the full state at the solution, nuisance parameters included
    status: Status  # how the computation ended
    iterations: int  # number of iterations used [1]
    residuals: FloatArray  # (m,) whitened residuals at the solution, prior rows last [1]
    # (m,) share of each residual that the fit absorbs, 0 to 1; their sum is the number of
    # parameters
    leverage: FloatArray
    blocks: npt.NDArray[np.int64]  # (m,) observation each residual belongs to, -1 for a prior
    chi_square: float  # sum of squares of the residuals [1]
    dof: int  # degrees of freedom: residuals minus parameters [1]
    # (n, n) Fisher information of the coefficients with the nuisance parameters eliminated
    information: FloatArray
    # (n_total, n_total) covariance of the whole step, nuisance parameters included
    state_cov: FloatArray
    weights: FloatArray  # (blocks,) robust weight of every observation
    # combinations of coefficients that the data cannot tell apart, in words
    weakest: tuple[str, ...] = ()
    # what the observations say without the prior, with covariance; None where they do not determine
    # all coefficients, or where nobody asked [SI]
    alone: CoefficientVector | None = None


SINGULAR = 1e8
"""Condition number of a matrix of scale factors and misalignments that no instrument has [1]."""


class Level(StrEnum):
    """How far a result can be trusted: every check passed, one failed, or it must not be used."""

    PASS = "pass"
    DOUBTFUL = "doubtful"
    UNUSABLE = "unusable"


CERTAIN = 1e-4
"""What chance makes more rarely than this is no chance: nothing passes beside it [1]."""


@dataclass(frozen=True)
class Check(Shown):
    """One test of a result: a number, its limits, and a sentence for people.

    `value`, `low` and `high` are in the unit [that `sentence` says]; `low` and `high` are None
    where the test has no limit on that side. `fails` is the level the verdict falls to when the
    number is outside. `p` is the probability [1] that chance makes so much of what the
    uncertainties do not account for, None where limits say all.
    """

    name: str
    value: float
    low: float | None
    high: float | None
    passed: bool
    sentence: str
    fails: Level = Level.DOUBTFUL
    p: float | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        # Nothing beyond its limit, and nothing that is no chance, has passed, whoever says so.
        beyond = (self.low is not None and self.value < self.low) or (
            self.high is not None and self.value > self.high
        )
        sure = self.p is not None and self.p < CERTAIN
        object.__setattr__(self, "passed", bool(self.passed) and not (beyond or sure))


@dataclass(frozen=True)
class Verdict(Shown):
    """Pass, doubtful or unusable, and why in plain sentences.

    Attributes
    ----------
    level : Level
        The worst that a failed check says.
    reasons : tuple of str
        Sentences of the checks that failed.
    """

    level: Level
    reasons: tuple[str, ...] = ()

    @classmethod
    def of(cls, checks: tuple[Check, ...]) -> Verdict:
        """Combine checks: the worst failed one decides; every failure is a reason."""
        order = (Level.PASS, Level.DOUBTFUL, Level.UNUSABLE)
        failed = [c for c in checks if not c.passed]
        level = max((c.fails for c in failed), key=order.index, default=Level.PASS)
        failed.sort(key=lambda c: -order.index(c.fails))
        return cls(level, tuple(c.sentence for c in failed))

    def doubted(self, findings: tuple[Finding, ...]) -> Verdict:
        """Return this verdict, lowered where a finding says that the numbers may be wrong.

        These come first: they may be why checks fail.

        Parameters
        ----------
        findings : tuple of Finding
            What was noticed; those with a doubt in `symptoms` count that are more than notes.
        """
        told = [
            f"{f.message} {f.cure}" for f in findings if doubtful(f.code) and f.severity != "note"
        ]
        rest = (reason for reason in self.reasons if reason not in told)
        level = Level.DOUBTFUL if told and self.level is Level.PASS else self.level
        return Verdict(level, (*told, *rest))


@dataclass(frozen=True)
class TimeBase:
    """What the clock of a log makes of the coefficients: one cause that nothing in a log shows."""

    # whose clock counted the time, see `tables.CLOCKS`; "several" for results of several clocks
    # merged, whose covariance is in seconds already
    source: str
    sd: float  # relative standard deviation of its rate [1]
    declared: bool  # whether that was declared; else it is usual for the source
    # coefficient -> its error per standard deviation of the clock [SI]; others do not depend on it
    error: Mapping[str, float] = field(default_factory=dict)

    @staticmethod
    def mean(results: Iterable[Result]) -> TimeBase | None:
        """Return the time base of results made one: theirs, where it is of one kind."""
        bases = [r.clock for r in results if r.clock is not None]
        if not bases:
            return None
        declared = all(b.declared for b in bases)
        if len({(b.source, b.sd) for b in bases}) > 1:
            return TimeBase("several", 0.0, declared)
        said: dict[str, list[float]] = {}
        for base in bases:
            for name, size in base.error.items():
                said.setdefault(name, []).append(size)
        mean = {name: float(np.mean(sizes)) for name, sizes in said.items()}
        return TimeBase(bases[0].source, bases[0].sd, declared, mean)

    def of(self, names: Iterable[str]) -> FloatArray:
        """Return the errors of the coefficients `names`, shape (n,) [SI]."""
        return np.array([self.error.get(name, 0.0) for name in names])


@dataclass(frozen=True)
class Result(Shown):
    """A calibration: coefficients with covariance, and everything needed to trust and use it.

    Attributes
    ----------
    procedure : str
        Name of the procedure, as in the campaign file.
    coefficients : CoefficientVector
        The coefficients with covariance, in the log's own time: what is right for whoever
        integrates with the same stamps [SI]. `in_seconds` has the error of the clock too.
    equation : str
        The model equation in words and symbols.
    frame : str
        The axes the coefficients refer to.
    gauge : str
        Which physical directions define the body axes.
    verdict : Verdict
        Pass, doubtful or unusable, with reasons.
    checks : tuple of Check
        Every test that was made, passed or not.
    findings : tuple of Finding
        What was noticed in the data.
    status : Status
        How the computation ended.
    instrument, site, validity, diagnostics, provenance : dict
        Plain JSON values; the keys are documented in the schema of result.json.
    tables : dict of str to table
        Tables for the report, saved as Parquet: name -> column -> array.
    temperature : TemperatureModel or None
        The coefficients as functions of temperature, where they are known so; `coefficients` are
        then those at its reference temperature.
    clock : TimeBase or None
        What the clock of the log adds to the uncertainty; None where nothing is known of it.
    """

    procedure: str
    coefficients: CoefficientVector
    equation: str
    frame: str
    gauge: str
    verdict: Verdict
    checks: tuple[Check, ...]
    findings: tuple[Finding, ...]
    status: Status
    instrument: dict[str, Any] = field(default_factory=dict)
    site: dict[str, Any] = field(default_factory=dict)
    validity: dict[str, Any] = field(default_factory=dict)
    diagnostics: dict[str, Any] = field(default_factory=dict)
    provenance: dict[str, Any] = field(default_factory=dict)
    tables: dict[str, TableData] = field(default_factory=dict)
    temperature: TemperatureModel | None = None
    clock: TimeBase | None = None

    @property
    def in_seconds(self) -> CoefficientVector:
        """The coefficients with the covariance in seconds: that of the clock is part of it."""
        vector = self.coefficients
        if self.clock is None or vector.cov is None:
            return vector
        error = self.clock.of(vector.names)
        return replace(vector, cov=vector.cov + np.outer(error, error))

    def __post_init__(self) -> None:
        # Wherever a result comes from, a pass does not stand beside a doubt.
        object.__setattr__(self, "verdict", self.verdict.doubted(self.findings))

    @property
    def model(self) -> Instrument:
        """The error model with these coefficients, but for what takes several samples to see."""
        return model_of(self.numbers().coefficients)

    @property
    def size_effect(self) -> SizeEffect:
        """Lever arms and delay of the accelerometers, which `apply` takes away too."""
        return SizeEffect.of(self.coefficients)

    def numbers(self) -> Result:
        """Return the result itself, which has a number for every coefficient of the instrument.

        Raises
        ------
        FoucaultError
            ``result.unknown``: the computation met no finite number for some of them;
            ``result.singular``: three axes of a triad lie in a plane.
        """
        vector = of_sensors(self.coefficients)
        lost = [n for n, v in zip(vector.names, vector.values, strict=True) if not np.isfinite(v)]
        if lost:
            more = f" and {len(lost) - 6} more" if len(lost) > 6 else ""
            raise error(
                "result.unknown", procedure=self.procedure, names=", ".join(lost[:6]) + more
            )
        model = model_of(self.coefficients)
        if isinstance(model, ImuModel):
            for triad, matrix in (("accel", model.accel_matrix), ("gyro", model.gyro_matrix)):
                if not np.linalg.cond(matrix) < SINGULAR:
                    raise error("result.singular", procedure=self.procedure, triad=triad)
        return self

    def apply(self, log: Log) -> Log:
        """Remove the calibrated errors from a log.

        Parameters
        ----------
        log : Log
            Readings of the same instrument, read with the same count scale [SI].

        Returns
        -------
        Log
            The same samples, compensated [SI].
        """
        require("log", log, Log)
        if self.temperature is not None:
            return self.temperature.apply(log)
        if isinstance(self.model, ImuModel):
            return self.size_effect.apply(self.model, log)
        return self.model.apply(log)

    def plot(self, name: str) -> Any:
        """Return a figure of the report, which shows itself in a notebook.

        Parameters
        ----------
        name : str
            Such as "residuals", "budget" or "correlation"; a wrong one is told which there are.
        """
        return printer().plot(self, name)

    def dataframe(self, name: str) -> Any:
        """Return a table as a DataFrame of pandas, the units of its columns in ``attrs["units"]``.

        Parameters
        ----------
        name : str
            "coefficients", or a key of `tables` such as "rests".
        """
        return printer().dataframe(self, name)

    def at(self, temperature: float) -> Result:
        """Return the result for one temperature, with coefficients that do not change with it.

        Parameters
        ----------
        temperature : float
            Temperature within the range of validity [K].
        """
        if self.temperature is None:
            raise error("temperature.option", option="--at")
        validity = self.validity | {"temperature": [temperature, temperature]}
        vector = self.temperature.at(temperature)
        return replace(self, coefficients=vector, validity=validity, temperature=None)


def provenance(source: Mapping[str, Any], seconds: float) -> dict[str, Any]:
    """Return what a result remembers of its making: versions, input, date, duration.

    `source`: where the input came from, as `Log.source` says it; `seconds`: how long the
    computation took [s].
    """
    import datetime

    return {
        "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "seconds": round(seconds, 3),
        "versions": dict(_versions()),
        "input": dict(source),
    }


@cache
def _versions() -> dict[str, str]:
    """Return the versions of what computes; looking them up takes milliseconds."""
    import importlib.metadata
    import platform

    packages = ("foucault", "numpy", "scipy", "numba")
    return {"python": platform.python_version()} | {
        name: importlib.metadata.version(name) for name in packages
    }
