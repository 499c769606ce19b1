"""What a plan needs of the rig, beside what the rig allows."""

from __future__ import annotations

from dataclasses import dataclass

from foucault import units

NOTHING = 1e-12  # What is needed or allowed and below this is rounding [SI].


@dataclass(frozen=True)
class Limit:
    """What a plan needs of the rig, and what the rig allows."""

    name: str  # of what, such as "middle angle"
    kind: str  # kind of its unit, as `units.KINDS` has it
    needed: float  # what the plan needs [SI]
    allowed: float | None = None  # what the rig allows; None where nothing was said [SI]
    unit: str | None = None  # unit it is written in; None for the largest of its kind

    @property
    def kept(self) -> bool:
        """Whether the plan keeps to it."""
        return self.allowed is None or self.needed <= self.allowed * (1 + 1e-9) + NOTHING

    @property
    def words(self) -> str:
        """What is needed, of what is allowed where that was said."""
        needed = f"{self.name} {self.said_needed}"
        return needed if self.allowed is None else f"{needed} of {self.said_allowed}"

    @property
    def said_needed(self) -> str:
        """What is needed, with its unit."""
        return said(self.needed, self.kind, self.unit)

    @property
    def said_allowed(self) -> str:
        """What is allowed, with its unit; empty where nothing was said."""
        return "" if self.allowed is None else said(self.allowed, self.kind, self.unit)


def said(value: float, kind: str, unit: str | None = None) -> str:
    """Write `value`, shape () [SI], in `unit`, or the largest of its kind: one side by side."""
    unit = unit or units.KINDS[kind].display[-1]
    value = 0.0 if abs(value) <= NOTHING else value
    return f"{units.plain(units.convert(value, kind, unit))} {unit}"
