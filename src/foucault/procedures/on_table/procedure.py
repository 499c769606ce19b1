"""The record that the procedures on a table share."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from foucault.diagnose.foresight import Foresight
from foucault.models.earth import Site
from foucault.plans.table.search import PositionSpace, Wanted
from foucault.procedures import on_table
from foucault.procedures.on_table.session import LOG_LINES, TableSession, TableSettings, simulate
from foucault.procedures.record import Beforehand, Procedure

S = TypeVar("S", bound=TableSettings)
N = TypeVar("N", bound=TableSession)


def table_procedure(
    name: str,
    doc: str,
    Settings: type[S],
    Session: type[N],
    task_of: Callable[[S, Site], on_table.Task],
) -> Procedure[S, N]:
    """Return the record of a procedure on a table: they differ in the task that settings make."""

    def foresee(b: Beforehand[S, N]) -> Foresight:
        from foucault.procedures.on_table import plan

        return plan.foresee(task_of(b.settings, b.site), b)

    def space(b: Beforehand[S, N]) -> PositionSpace:
        from foucault.procedures.on_table import plan

        return plan.space(task_of(b.settings, b.site), b)

    return Procedure(
        name=name,
        doc=doc,
        Settings=Settings,
        Session=Session,
        solve=lambda log, given: on_table.solve(log, task_of(given.settings, given.site), given),
        simulation=simulate,
        names=lambda settings, _: settings.estimated(),
        foresee=foresee,
        space=space,
        Wanted=Wanted,
        assumes_noise=True,
        streams=True,
        # Nothing is needed of what is between two rests or spins.
        more="stretches",
        clocked=on_table.clocked,
        log_lines=LOG_LINES,
    )
