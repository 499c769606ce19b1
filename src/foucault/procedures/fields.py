"""Settings that several procedures have: each with one meaning and one description."""

from __future__ import annotations

from dataclasses import replace

from pydantic import BaseModel, ConfigDict, Field

from foucault.models.earth import Site


class Strict(BaseModel):
    """A table of a campaign file: keys that it does not know are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class EarthRate(Strict):
    """Whether the Earth's rotation is modelled."""

    earth_rate: bool = Field(
        default=True, description="Model the Earth's rotation where the latitude is given."
    )

    def where(self, site: Site) -> Site:
        """Return the site as it is modelled: without latitude where the Earth is not to turn."""
        return site if self.earth_rate else replace(site, latitude=None)
