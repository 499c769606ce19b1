"""What a guide speaks of: a step to do, what is wanted, how well everything is known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np

from foucault import units
from foucault.arrays import FloatArray, IntArray
from foucault.campaign.tables import kind_of_group
from foucault.coefficients import CoefficientVector, Layout
from foucault.errors import error, suggestion
from foucault.infer import mixed
from foucault.infer.left_out import Judgement
from foucault.infer.mixed import Fit, Linearisation, Model, budget
from foucault.models.noise import grade
from foucault.models.rotation import aligning
from foucault.procedures.record import Given, Prior
from foucault.tables import Log


@dataclass(frozen=True)
class Step:
    """Something to do with the instrument."""

    kind: Literal["rest", "turn", "spin", "stop"]
    up: FloatArray  # (3,) what is up in it, frame b [1]
    seconds: float  # how long it then rests [s]
    C_nb: FloatArray | None = None  # (3, 3) attitude of that rest [1]
    rotation: FloatArray | None = None  # (3,) rotation vector that leads there, body axes [rad]
    name: str = ""  # of a position of a list
    angle: float = 0.0  # of a stop, clockwise from above [rad]

    @property
    def turn_time(self) -> float:
        """Time that a hand takes to get there, shape () [s]."""
        return QUICKEST if self.rotation is None else float(turn_time(self.rotation))

    def attitude(self) -> FloatArray:
        """Return how it then lies, C_nb, shape (3, 3) [1]; any way round where none is asked."""
        return aligning(self.up, UP) if self.C_nb is None else self.C_nb


UP = np.array([0.0, 0.0, 1.0])


PACE = np.radians(90.0)
"""Rate at which a hand is taken to turn; a turn lasts `QUICKEST` at least [rad/s]."""

QUICKEST = 1.5
"""[s]."""


def turn_time(rotation: FloatArray) -> FloatArray:
    """Return how long a hand takes, shape (...,) [s]; `rotation`: vectors (..., 3) [rad]."""
    return np.asarray(np.maximum(np.linalg.norm(rotation, axis=-1) / PACE, QUICKEST))


@dataclass(frozen=True)
class Wanted:
    """How well everything is to be known."""

    layout: Layout
    sd: FloatArray  # (p,) wanted standard deviations, infinite where any will do [SI]
    typical: FloatArray  # (p,) what a whole session of the usual plan gives [SI]

    @property
    def names(self) -> tuple[str, ...]:
        """Coefficients that are estimated."""
        return self.layout.names

    def groups(self) -> dict[str, list[int]]:
        """Return the coefficients of each group: name -> numbers."""
        out: dict[str, list[int]] = {}
        for k, name in enumerate(self.names):
            out.setdefault(name.rpartition(".")[0], []).append(k)
        return out

    @classmethod
    def of(cls, layout: Layout, typical: FloatArray, said: Mapping[str, str]) -> Wanted:
        """Return what is `said` of coefficients or groups, else the worst of its group.

        `typical` (p,): what a whole session of the usual plan gives [SI].
        """
        out = cls(layout, np.full(len(layout), np.inf), np.asarray(typical, float))
        for name, text in said.items():
            mine = [k for k, n in enumerate(layout.names) if n == name or n.startswith(name + ".")]
            if not mine:
                groups = sorted({*layout.names, *out.groups()})
                raise error("guide.wanted", name=name, hint=suggestion(name, groups),
                            allowed=", ".join(out.groups()))  # fmt: skip
            out.sd[mine] = units.parse(text, kind_of_group(name, layout), f"--want {name}")
        if not said:
            for mine in out.groups().values():
                out.sd[mine] = out.typical[mine].max()
        return out


@dataclass(frozen=True)
class Reached:
    """How well everything is known by what was seen."""

    sd: FloatArray  # (p,) [SI]
    model: Any  # what was solved, without what is left out
    at: Linearisation  # where it was solved, with what is left out
    sds: Mapping[str, float]  # source -> size that was found [SI]
    prior: CoefficientVector  # what was known beforehand [SI]
    C_nb: FloatArray  # (n, 3, 3) attitudes of the rests [1]
    state: Any  # [SI]
    # (p,) variance of what is left out, and the group that is most of it
    floor: FloatArray | None = None
    by: tuple[str, ...] = ()
    solved: bool = False

    @classmethod
    def of_fit(
        cls, fit: Fit, judged: Judgement | None, model: Model, prior: CoefficientVector,
        C_nb: FloatArray,
    ) -> Reached:  # fmt: skip
        """Return it of a session that was solved.

        `prior`: of the campaign [SI]; `C_nb` (n, 3, 3): where the fit has no attitudes [1].
        """
        sd, floor, by = fit.estimate.coefficients.sd, None, tuple[str, ...]()
        if judged is not None:
            parts = {k: v for k, v in budget(fit).items() if k in judged.groups}
            if parts:
                rows = np.array(list(parts.values()))
                floor = rows.sum(axis=0)
                by = tuple([*parts][k] for k in rows.argmax(axis=0))
        C_nb = getattr(fit.state, "C_nb", C_nb)
        return cls(sd, model, fit.at, fit.sds, prior, C_nb, fit.state, floor, by, True)

    @classmethod
    def foreseen(
        cls, model: Model, sds: Mapping[str, float], prior: CoefficientVector, C_nb: FloatArray
    ) -> Reached:
        """Return it of a session that is only linearised.

        `sds`: size of every source [SI]; `prior`: wide enough for all [SI]; `C_nb` (n, 3, 3):
        attitudes of the rests [1].
        """
        at = model.linearise(model.start)
        cov = cov_of(mixed.foreseen(model, prior, sds).jacobian)
        sd = np.sqrt(np.diag(cov)[: len(model.layout)])
        return cls(sd, model, at, sds, prior, C_nb, model.start)


def cov_of(white: FloatArray) -> FloatArray:
    """Return the covariance (m, m) by rows `white` (r, m) [1]; what is not seen is known."""
    size = np.linalg.norm(white, axis=0)
    size[size == 0] = 1.0
    cov = np.linalg.pinv((white / size).T @ (white / size), 1e-13, hermitian=True)
    return np.asarray(cov / np.outer(size, size))


WIDE = 3.0
"""Instruments are taken to be worse than usual by so much before they are calibrated [1]."""


def widely(wanted: Wanted, prior: Prior) -> CoefficientVector:
    """Return what is known beforehand, as wide as MEMS differ where nothing is.

    `prior`: of the campaign [SI].
    """
    typical = grade("mems").spread
    wide = {group: (0.0, WIDE * sd) for group, sd in typical.items()
            if any(n.startswith(group) for n in wanted.names)}  # fmt: skip
    known = CoefficientVector.prior(wanted.layout, wide | dict(prior))
    usual = np.where(np.isfinite(wanted.typical), wanted.typical, 1.0)
    sd = np.where(np.isfinite(known.prior_sd), known.prior_sd, 1e3 * usual)
    return replace(known, prior_sd=sd)


class Way(Protocol):
    """What of a guide depends on the procedure."""

    wanted: Wanted
    gyro: bool
    spins: bool = False  # whether quiet times that turn are looked at, too
    unlisted: bool = False  # whether the last was none of a list

    @property
    def done(self) -> tuple[int, int] | None:
        """How much of a list is done, and how much it has; None where there is no list [1]."""
        return None

    def first_step(self) -> Step:
        """Return what to begin with."""
        ...

    def reached(self, log: Log, first: IntArray, last: IntArray) -> Reached | None:
        """Return how well everything is known, None before anything is.

        `log`: readings [SI]; `first`, `last` (n,): first sample of each rest, or spin, and the
        sample after its last.
        """
        ...

    def candidates(self, reached: Reached) -> list[Step]:
        """Return what could be done next: of a list what is next, nothing where all is done."""
        ...

    def after(self, reached: Reached, steps: list[Step]) -> FloatArray:
        """Return the sd of every coefficient after each of `steps`, shape (k, p) [SI]."""
        ...

    def everything(self, log: Log, first: IntArray, last: IntArray, reached: Reached) -> Reached:
        """Return what would be known after everything possible; the others as of `reached`.

        `first`, `last` (n,): first sample of each rest, and the sample after its last.
        """
        ...

    def leave(self, folder: Path) -> Path | None:
        """Write what is calibrated beside the log; return its campaign, None: that of the log."""
        return None


@dataclass
class Begun(Way):
    """A session that has begun: what is asked of it, by whichever way it is recorded."""

    given: Given[Any]
    wanted: Wanted
    hold: float  # time to rest [s]
    gyro: bool = True

    @cached_property
    def prior(self) -> CoefficientVector:
        """What is known beforehand, as wide as instruments differ where nothing is."""
        return widely(self.wanted, self.given.prior)
