"""The ``[master]`` block of a campaign: which column of a table is what a master INS said.

What a block leaves out is looked for in the titles of the columns, as those of a reference are
(`logs.reference`): title and unit, such as ``velocity north (m/s)``.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from foucault.errors import error
from foucault.logs.layout import Block, ColumnName, FileLayout, TimeColumn, scaled_unit

Frame = Literal["ENU", "NED"]
Sense = Literal["clockwise", "counter-clockwise"]
Triple = tuple[ColumnName, ColumnName, ColumnName]


def _pair(block: str, columns: object, unit: object) -> None:
    if (columns is None) != (unit is None):
        missing = "unit" if unit is None else "columns"
        raise error("master.columns", file="The master's table", what=f"{block} has no `{missing}`")


class PositionColumns(Block):
    """Latitude and longitude, and the height where there is one."""

    columns: tuple[ColumnName, ColumnName] | Triple = Field(
        description="names or numbers from 0 for latitude, longitude, height"
    )
    unit: str = Field(description='unit of latitude and longitude, such as "deg" or "rad"')
    height_unit: str = Field("m", description="unit of the height")

    @model_validator(mode="after")
    def _units(self) -> PositionColumns:
        scaled_unit(self.unit, "angle")
        scaled_unit(self.height_unit, "length")
        return self


class VelocityColumns(Block):
    """Velocity of the master relative to the Earth."""

    columns: Triple | None = Field(
        None,
        description="names or numbers from 0, in the order of `frame`: east, north, up or north, "
        'east, down; a leading "-" flips the sign',
    )
    unit: str | None = Field(None, description='unit of one, such as "m/s"')
    frame: Frame = Field("ENU", description='"NED" where they are north, east, down')

    @model_validator(mode="after")
    def _whole(self) -> VelocityColumns:
        _pair("velocity", self.columns, self.unit)
        if self.columns is None and self.frame != "ENU":
            what = "frame is given without columns; titles say what is north"
            raise error("master.columns", file="The master's table", what=what)
        if self.unit is not None:
            scaled_unit(self.unit, "velocity")
        return self


class AttitudeColumns(Block):
    """Heading, pitch and roll of the master: nose up and right side down are positive."""

    columns: Triple | None = Field(
        None,
        description="names or numbers from 0 for heading, pitch, roll; a leading "
        '"-" flips the sign',
    )
    unit: str | None = Field(None, description='unit of one, such as "deg" or "rad"')
    sense: Sense = Field(
        "clockwise", description="how the heading counts from north, seen from above"
    )

    @model_validator(mode="after")
    def _whole(self) -> AttitudeColumns:
        _pair("attitude", self.columns, self.unit)
        if self.unit is not None:
            scaled_unit(self.unit, "angle")
        return self


class MasterDescription(FileLayout):
    """Where the table of a master INS is and what its columns mean."""

    time: TimeColumn | None = Field(
        None, description="the stamp of each message, on the slave's clock or the master's"
    )
    arrival: TimeColumn | None = Field(
        None, description="when each arrived on the slave's clock, where that is logged beside it"
    )
    position: PositionColumns | None = None
    velocity: VelocityColumns = Field(default_factory=lambda: VelocityColumns.model_validate({}))
    attitude: AttitudeColumns = Field(default_factory=lambda: AttitudeColumns.model_validate({}))

    @model_validator(mode="after")
    def _consistent(self) -> MasterDescription:
        self.dated(self.time is not None)
        if self.file is None:
            raise error("log.no_file")
        return self
