"""Sessions of every procedure, simulated one way: what the contracts and their tests calibrate.

A `Case` says which procedure, with which settings, session and noise; `made` simulates it, `solved`
calibrates what was made. What a procedure's own `Session` does not do (a table that leans, readings
without any simulator) is made where it is needed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import Any

import numpy as np
import pytest

from foucault import procedures
from foucault.coefficients import CoefficientVector
from foucault.infer import filtered, mixed
from foucault.models.earth import Site
from foucault.models.layouts import model_of
from foucault.models.noise import ImuNoise, TriadNoise, grade
from foucault.procedures.record import Beforehand, Procedure
from foucault.result import Result

SITE = replace(Site.at(np.radians(48.8462), 60.0), gravity_sd=0.0)
POLE = replace(Site.at(np.pi / 2), gravity_sd=0.0)
"""The Earth's rotation is vertical: nothing of it is unknown."""
ARCMIN = np.radians(1 / 60)
QUIET = ImuNoise()
LASER = ImuNoise(TriadNoise(white=5 * 9.80665e-6), TriadNoise(white=np.radians(0.0007) / 60))
"""5 ug/sqrt(Hz), 0.0007 deg/sqrt(h)."""
SEEKER = ImuNoise(TriadNoise(white=3e-4), TriadNoise(white=np.radians(0.003) / 60))
"""30 ug/sqrt(Hz), 0.003 deg/sqrt(h)."""
SLAVE = ImuNoise(TriadNoise(white=30 * 9.80665e-6), TriadNoise(white=np.radians(0.06) / 60))


@dataclass(frozen=True)
class Case:
    """A session of a procedure: what is done, what is wrong with it, and what is said of it."""

    procedure: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    session: Mapping[str, Any] = field(default_factory=dict)
    grade: str = "tactical"  # class of the instrument
    noise: ImuNoise | None = None  # None: of the class [SI]
    told: ImuNoise | None = None  # what is declared, where that is not the noise [SI]
    said: Mapping[str, Any] = field(default_factory=dict)  # settings that are not what was done
    site: Site = SITE
    prior: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # [SI]

    @cached_property
    def record(self) -> Procedure[Any, Any]:
        """The procedure."""
        return procedures.load(self.procedure)

    @cached_property
    def done(self) -> Any:
        """The settings of the session that is simulated."""
        return self.record.Settings.model_validate(self.settings)

    @cached_property
    def stated(self) -> Any:
        """The settings of its calibration."""
        return self.record.Settings.model_validate({**self.settings, **self.said})

    @cached_property
    def planned(self) -> Any:
        """The session."""
        return self.record.Session.model_validate(self.session)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The coefficients that are estimated."""
        return self.record.names(self.stated, self.planned)

    @property
    def sensors(self) -> ImuNoise:
        """The noise [SI]."""
        return self.noise or self.record.noise or grade(self.grade).noise

    @property
    def beforehand(self) -> Beforehand[Any, Any]:
        """What a plan is judged by."""
        return Beforehand(self.stated, self.planned, self.site, self.sensors, self.prior)


@cache
def _drawn(procedure: str, name: str, seed: int) -> Any:
    return procedures.load(procedure).draw_errors(name, seed)


def made(case: Case, seed: int, errors: Any = None, noise: ImuNoise | None = None) -> Any:
    """Simulate a session; `errors`: of the instrument, drawn where they are not given."""
    errors = _drawn(case.procedure, case.grade, seed) if errors is None else errors
    return case.record.simulate(
        case.planned, settings=case.done, model=errors, noise=noise or case.sensors,
        site=case.site, seed=seed,
    )  # fmt: skip


def solved(case: Case, log: Any, *, noise: Any = "declared", whole: bool = False) -> Result:
    """Calibrate: as one trial of many, or the whole of it; `noise`: None for not declared."""
    how: Callable[..., Result] = case.record.calibrate if whole else case.record.trial
    return how(
        log, site=case.site, settings=case.stated, prior=case.prior,
        noise=(case.told or case.sensors) if isinstance(noise, str) else noise,
    )  # fmt: skip


def instrument(case: Case, values: Mapping[str, float]) -> Any:
    """An instrument with these errors and no others [SI]."""
    return model_of(CoefficientVector.zeros(case.record.layout).with_values(dict(values)))


def truth(simulation: Any, names: tuple[str, ...]) -> np.ndarray:
    """The coefficients that a simulated instrument had, in the axes of results [SI]."""
    from foucault.campaign.running import Session

    whole = Session(None, simulation, 0).truth  # type: ignore[arg-type]
    return np.array([whole.value(name) for name in names])


def errors(result: Result, simulation: Any, names: tuple[str, ...]) -> tuple[np.ndarray, ...]:
    """Estimate minus truth (p,), and its covariance (p, p) [SI]."""
    c = result.coefficients
    at = [c.layout.index(name) for name in names]
    assert c.cov is not None
    return c.values[at] - truth(simulation, names), c.cov[np.ix_(at, at)]


def codes(result: Result) -> list[str]:
    """Codes of what was found."""
    return [f.code for f in result.findings]


def failed(result: Result) -> set[str]:
    """Names of the checks that were not passed."""
    return {c.name for c in result.checks if not c.passed}


@contextmanager
def fits():
    """Collect what the engine solves: mixed models and filtered ones."""
    found: list[Any] = []
    with pytest.MonkeyPatch.context() as patch:
        for engine in (mixed, filtered):
            fit = engine.fit
            patch.setattr(
                engine, "fit",
                lambda *a, fit=fit, **k: found.append(fit(*a, **k)) or found[-1],
            )  # fmt: skip
        yield found


@contextmanager
def shorter():
    """Leave out what more of a plan would buy: it takes most of the time."""
    from foucault.procedures.on_table import plan
    from foucault.procedures.platform_tumble import foresight

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plan, "_more", lambda *_, **__: ())
        patch.setattr(foresight, "more", lambda *_, **__: ())
        yield
