"""A procedure as data: what differs between two of them, and what all do alike.

::

    log -> Procedure.calibrate -> solve -> Result       (all of it, for a report)
           Procedure.trial     -> solve -> Result       (one of many: without what a report shows)
    session -> Procedure.simulate -> simulation -> log
    plan -> Procedure.foresee, Procedure.space          (preflight, optimise)

A module of `foucault.procedures.PROCEDURES` has its record as ``PROCEDURE``. The defaults of a
field are the usual case, so that a procedure states only what is its own.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

from pydantic import BaseModel

from foucault import logs
from foucault.coefficients import Layout
from foucault.diagnose.time_base import with_clock
from foucault.logs.description import LogDescription
from foucault.logs.layout import FileLayout
from foucault.models import imu
from foucault.models.earth import Site
from foucault.models.noise import ImuNoise
from foucault.procedures import Progress, silent, solvable
from foucault.procedures.fields import EarthRate
from foucault.result import Result, provenance

if TYPE_CHECKING:
    from foucault.arrays import FloatArray
    from foucault.diagnose.foresight import Foresight

S = TypeVar("S", bound=BaseModel)
N = TypeVar("N", bound=BaseModel)
Prior = Mapping[str, tuple[float, float]]
"""Mean and standard deviation of coefficients or groups of coefficients [SI]."""


@dataclass(frozen=True)
class Given(Generic[S]):
    """What a calibration is given beside its log."""

    site: Site  # without latitude where the Earth's rotation is not to be modelled
    settings: S
    noise: ImuNoise | None  # of the instrument, None where it is not declared [SI]
    prior: Prior  # what is known beforehand [SI]
    progress: Progress = silent
    shown: bool = True  # whether a report will show it: a trial is one of many


@dataclass(frozen=True)
class Beforehand(Generic[S, N]):
    """What a planned session is judged by."""

    settings: S  # its plan is among them, or in the session
    session: N
    site: Site
    noise: ImuNoise | None = None  # as declared [SI]
    prior: Prior = field(default_factory=dict)  # what is known beforehand [SI]
    typical: ImuNoise | None = None  # to reckon with where none is declared [SI]
    wanted: Any = None  # [optimise], where the procedure has it


def _on_axes(log: Any) -> tuple[bool, bool]:
    """Take angles over the time of the log for the reference of the gyros."""
    return True, log.sampled == "increment"


def _of_an_imu(grade: str, seed: int) -> Any:
    """Draw the errors of an IMU; `seed`: seed [1]."""
    from foucault.simulate.hand_rotated import draw_errors

    return draw_errors(grade, seed)


@dataclass(frozen=True)
class Procedure(Generic[S, N]):
    """A method of calibration: its settings, its functions, and how its files are written."""

    name: str  # in a campaign file
    doc: str  # of its module
    Settings: type[S]  # [procedure]
    Session: type[N]  # [simulate], beside what all have there
    # Log and what is given -> the result, without what `calibrate` puts to all of them.
    solve: Callable[[Any, Given[S]], Result]
    simulation: Callable[..., Any]  # of a session; arguments as `simulate`, settings never None
    names: Callable[[S, N], tuple[str, ...]]  # coefficients that are estimated
    # Those of the result, where others follow from those that are estimated.
    every_name: Callable[[S], tuple[str, ...]] | None = None
    layout: Layout = imu.LAYOUT  # what a campaign may name in [prior]

    # The plan of a session: what it will show, and the plans that may be sought.
    foresee: Callable[[Beforehand[S, N]], Foresight] | None = None
    space: Callable[[Beforehand[S, N]], Any] | None = None
    Wanted: type[BaseModel] | None = None  # [optimise], where there is a `space`
    evaluations: int | None = None  # plans that a restart judges, where not the usual number [1]
    assumes_noise: bool = False  # a plan is judged with the typical noise where none is declared

    # The instrument of a simulated session.
    grade: str = "mems"  # its class, where [simulate] names none
    noise: ImuNoise | None = None  # its noise, where not that of the class [SI]
    draw_errors: Callable[[str, int], Any] = _of_an_imu  # of a class and a seed

    # The log.
    Description: type[FileLayout] = LogDescription  # [log]
    read: Callable[..., Any] = logs.read
    write: Callable[..., None] = logs.write
    Master: type[BaseModel] | None = None  # [master]
    with_master: Callable[..., Any] | None = None  # log, description and folder -> log with it
    streams: bool = False  # whether it takes a log on disk too
    # What further files of a log are: none, stretches of one session (nothing is needed of what
    # is between them), or recordings of their own, each with biases of its own.
    more: Literal["none", "stretches", "recordings"] = "none"
    # Log -> whether angles over its time are the reference of the gyros, and whether it is sums.
    clocked: Callable[[Any], tuple[bool, bool]] = _on_axes
    # Log, given and result -> (n,) derivative by the rate of the clock, where that is tried [SI].
    clock_slope: Callable[[Any, Given[S], Result], FloatArray | None] | None = None

    # Texts of the template of a campaign; empty: those of an IMU.
    log_table: Callable[[Any], str] | None = None  # [log], of the template or of a simulated log
    log_lines: str = ""  # what is put to the [log] of an IMU
    noise_lines: str = ""
    prior_lines: str = ""
    errors_line: str = ""

    @property
    def summary(self) -> str:
        """What it does, in a sentence."""
        return self.doc.strip().splitlines()[0].rstrip(".")

    def calibrate(
        self,
        log: Any,
        *,
        site: Site,
        settings: S | None = None,
        noise: ImuNoise | None = None,
        prior: Prior | None = None,
        instrument: Mapping[str, Any] | None = None,
        progress: Progress = silent,
    ) -> Result:
        """Calibrate an instrument from a log.

        Parameters
        ----------
        log : Log, or what the procedure has instead
            Readings, or means over poses where the procedure takes them [SI].
        site : Site
            Local gravity, and the latitude where the Earth's rotation is to be modelled.
        settings : pydantic model or None
            `Settings` of the procedure: what can be chosen; None takes the defaults.
        noise : ImuNoise or None
            Noise of the instrument [SI]; None measures it where the log shows it, and takes what
            is usual where it does not.
        prior : mapping of str to (float, float) or None
            Mean and standard deviation of coefficients or groups of coefficients [SI].
        instrument : mapping or None
            Name, serial and so on, kept in the result.
        progress : callable
            Called with the fraction done and what is being done.

        Returns
        -------
        Result
            Coefficients with covariance, checks and a verdict [SI].

        Raises
        ------
        FoucaultError
            What is missing in the log or wrong with it: see `foucault.symptoms`.
        """
        started = clock.monotonic()
        given = self._given(site, settings, noise, prior, progress)
        with solvable():
            result = self.solve(log, given)
            slope = self.clock_slope(log, given, result) if self.clock_slope else None
        progress(1.0, "done")
        result = replace(
            result,
            instrument=dict(instrument or {}),
            provenance=provenance(log.source, clock.monotonic() - started),
        )
        turned, summed = self.clocked(log)
        return with_clock(result, log.clock, turned=turned, summed=summed, slope=slope)

    def trial(
        self,
        log: Any,
        *,
        site: Site,
        settings: S | None = None,
        noise: ImuNoise | None = None,
        prior: Prior | None = None,
    ) -> Result:
        """Calibrate without what only a report shows: one trial of many.

        Arguments as of `calibrate`; `noise`: of the instrument [SI]; `prior`: mean and standard
        deviation of coefficients or groups of coefficients [SI].
        """
        with solvable():
            return self.solve(
                log, replace(self._given(site, settings, noise, prior, silent), shown=False)
            )

    def _given(
        self,
        site: Site,
        settings: S | None,
        noise: ImuNoise | None,
        prior: Prior | None,
        progress: Progress,
    ) -> Given[S]:
        settings = settings or self.Settings()
        if isinstance(settings, EarthRate):
            site = settings.where(site)
        return Given(site, settings, noise, prior or {}, progress)

    def simulate(
        self,
        session: N,
        *,
        model: Any,
        noise: ImuNoise,
        site: Site,
        seed: int,
        settings: S | None = None,
    ) -> Any:
        """Simulate a session.

        `session`: what is done; `model`: errors of the instrument; `noise`: its noise [SI];
        `seed`: seed of all random numbers [1]; `settings` or None: of the calibration to follow,
        for its plan, and for what is wrong with table and reference. Returns its log and what is
        true.
        """
        return self.simulation(
            session,
            settings=settings or self.Settings(),
            model=model,
            noise=noise,
            site=site,
            seed=seed,
        )
