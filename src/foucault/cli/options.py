"""Options that carry a unit, turned into SI numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

KINDS = {
    "height": "length", "gravity": "gravity", "gyro_noise": "angle random walk",
    "accel_noise": "velocity random walk", "gyro_bias_sd": "angular rate",
    "accel_bias_sd": "specific force", "align": "time", "from": "time", "until": "time",
    "rate": "frequency", "at": "temperature", "reference": "temperature",
    "velocity_sd": "velocity", "position_sd": "length",
    "margin": "temperature difference", "hold": "time", "timeout": "time", "time": "time",
}  # fmt: skip
"""Kind of quantity of every option; the others are angles."""

POSITIVE = (
    "latitude_sd", "level_sd", "heading_sd", "accuracy", "index_sd", "gyro_noise", "accel_noise",
    "align", "until", "rate", "time", "velocity_sd", "position_sd",
)  # fmt: skip
"""Options that must be greater than zero."""

NOT_NEGATIVE = ("gyro_bias_sd", "accel_bias_sd", "margin", "hold", "timeout")
"""Options that may be zero, but no less."""


def parsed(texts: Mapping[str, str | None]) -> dict[str, Any]:
    """Turn options with units into SI numbers; a mistake names its option."""
    from foucault.campaign.mistakes import parse_at
    from foucault.errors import error
    from foucault.units import SMALLEST

    out = {}
    for key, text in texts.items():
        if text is None:
            continue
        option = "--" + key.replace("_", "-")
        out[key] = value = parse_at(option, text, KINDS.get(key, "angle"))
        least = "greater than 0" if key in POSITIVE and not value > 0 else ""
        least = "0 or more" if key in NOT_NEGATIVE and not value >= 0 else least
        if value and not SMALLEST < abs(value) < 1 / SMALLEST:
            least = "of a size that something has"
        if least:
            raise error("campaign.value", key=option, given=repr(text), hint="", more="",
                        reason=f"it should be {least}")  # fmt: skip
    return out


def span(option: str, text: str) -> tuple[float, float]:
    """Return start and end of a stretch of a log, "0 s to 300 s" [s]."""
    from foucault.errors import error
    from foucault.units import parse

    ends = text.split(" to ")
    if len(ends) != 2:
        raise error("log.span", option=option, given=text)
    start, end = (parse(one.strip(), "time", option) for one in ends)
    return start, end
