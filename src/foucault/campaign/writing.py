"""Campaign files written for people: the template to start from, and the file as resolved."""

from __future__ import annotations

import json
import os
import textwrap
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from foucault import procedures, units
from foucault.campaign import earlier
from foucault.campaign.reading import Campaign
from foucault.campaign.tables import Instrument, SimulateTable, SiteTable, dotted, kind_of
from foucault.escape import commented, toml_text
from foucault.logs.description import log_head
from foucault.models import left_out, parts
from foucault.procedures.record import Procedure
from foucault.run_folder import RESOLVED
from foucault.strict import description_of
from foucault.tables import IndexedLog, Log

_HEAD = """\
# Campaign file of Foucault.
# {summary}.
#
# A number with a dimension is text with its unit ("0.01 deg/h"); a bare number is refused.
# Known units: m s min h Hz rad deg arcmin arcsec g mg ug ppm percent count K, their products,
# quotients, powers and sqrt(). `foucault schema` prints what every key takes.
"""

LOG_TABLE = log_head(up=', first_rest = "z up"') + Path(__file__).with_name("log.toml").read_text(
    encoding="utf-8"
)

NOT_Z_UP = (', first_rest = "z up" }', " }")
"""A table begins where its plan does; `first_rest` may be given, and is checked then."""

WIDTH = 100  # Longest line of a template [1].

AVERAGED = 'averaged = { column = "averaged", unit = "s" }   # every row is a mean over that long\n'
"""Line of a log that holds means."""


def log_table(
    procedure: str, log: Log | IndexedLog | None = None, *, averaged: bool = False,
    up: str = "z up",
) -> str:  # fmt: skip
    """Write the table [log] for a log as `foucault simulate` writes it.

    `procedure`: a key of `procedures.PROCEDURES`, one that uses a table says what its log has
    more, and one with a log of its own writes all of it; `log`: the log that was simulated [SI],
    None for the template, where what a user's log may lack is commented out; `averaged`: whether
    a simulated log holds means, where it is not given itself; `up`: how a session by hand or on
    faces begins.
    """
    record = procedures.load(procedure)
    if record.log_table is not None:
        return record.log_table(log)
    more = record.log_lines
    averaged |= log is not None and log.averaged is not None
    if log is None and not averaged:
        lines = more.splitlines()
        more = "".join(f"{'# ' * (line[:1] not in ('#', ''))}{line}\n" for line in lines)
    first = NOT_Z_UP if more else ('"z up"', f'"{up}"')
    return LOG_TABLE.replace(*first) + AVERAGED * averaged + more


EXAMPLE = "example IMU"
"""Name of the instrument in the template; a real log under this name was not described."""

EXAMPLE_SITE = {"latitude": "48.8462 deg", "longitude": "2.3464 deg", "height": "60 m"}
"""Place in the template, where Foucault's pendulum hung: the Pantheon in Paris."""

SITE_NOTE = (
    "# CHANGE THIS to your own place: a wrong latitude or height is a wrong g, and a wrong g is",
    "# a wrong scale of every accelerometer that no residual can show.",
)

_NOISE = """\
# Left out, the noise is measured in the rests.
# [noise]
# grade = "mems"                        # mems, tactical, navigation: typical values
# part = "ICM-20948"                    # or the data sheet of one; `foucault parts` lists them
# [noise.accel]
# white = "120 ug/sqrt(Hz)"
# [noise.gyro]
# white = "0.3 deg/sqrt(h)"
"""

_PRIOR = """\
# What is known beforehand of a coefficient, or of every coefficient of a group; or, with its
# whole covariance, an earlier result of this instrument.
# [prior]
# from = "../earlier/run"
# "gyro.bias" = { mean = "0 deg/h", sd = "1000 deg/h" }
# "accel.scale.x" = { mean = "0 ppm", sd = "500 ppm" }
"""


_ERRORS = '# errors = { "gyro.bias.x" = "30 deg/h" }'


def _of_part(name: str) -> str:
    """Write what the data sheet of a part says; where it states no noise, that of the rests is."""
    known = parts.part(name)
    said = [f"# {t}: {basis}" for t, basis in parts.noise_basis(known.name).items()]
    lines = [
        f"# Of the data sheet of the {known.name}; `foucault parts {known.name}` prints the rest.",
        *(line for one in said for line in textwrap.wrap(one, WIDTH, subsequent_indent="#   ")),
    ]
    table = ["[noise]", f"part = {_text(known.name)}"]
    if parts.noise_of(known.name) is None:
        lines.append("# It does not state the noise of both triads: it is measured in the rests.")
        table = []
    return "\n".join([*lines, *table]) + "\n"


def template(procedure: str, part: str | None = None, grade: str | None = None) -> str:
    """Write a commented campaign file for `procedure`.

    It loads as it is, and with the log that `foucault simulate` makes it also runs as it is.
    `part`: an instrument whose noise is that of its data sheet, one of `models.parts`; `grade`: its
    class.
    """
    record = procedures.load(procedure)
    instrument = {"name": EXAMPLE, "serial": "0001", "operator": "", "note": ""}
    if part is not None:
        instrument["part"] = parts.part(part).name
    if grade is not None:
        left_out.sizes_of(grade)  # raises where it is not known
        instrument["grade"] = grade
    settings = ["[procedure]", f"name = {_text(procedure)}", *_commented(record.Settings, {})]
    blocks = [
        _HEAD.format(summary=record.summary),
        "\n".join(["[instrument]", *_commented(Instrument, _texts(instrument))]) + "\n",
        "\n".join(["[site]", *SITE_NOTE, *_commented(SiteTable, _texts(EXAMPLE_SITE))]) + "\n",
        log_table(procedure),
        "\n".join(settings) + "\n",
        (record.noise_lines or _NOISE) if part is None else _of_part(part),
        record.prior_lines or _PRIOR,
        "\n".join(["[simulate]", *_simulate_lines(record)]) + "\n",
        *([] if record.Wanted is None else [_wanted_lines(record.Wanted)]),
    ]
    return "\n".join(blocks)


def _wanted_lines(model: type[BaseModel]) -> str:
    lines = [line if line.startswith("#") else f"# {line}" for line in _commented(model, {})]
    head = ["# What `foucault optimise` may do to find a better plan:", "# [optimise]"]
    return "\n".join([*head, *lines]) + "\n"


def _simulate_lines(record: Procedure[Any, Any]) -> list[str]:
    usual = _texts({"grade": record.grade})
    return [
        *_commented(SimulateTable, usual, leave_out=("errors",)),
        *_commented(record.Session, {}),
        "# Coefficients set to a value instead of drawn:",
        record.errors_line or _ERRORS,
    ]


def _commented(
    model: type[BaseModel], values: Mapping[str, str], leave_out: tuple[str, ...] = ()
) -> list[str]:
    """Write every field with its description; one without a value becomes a comment."""
    out: list[str] = []
    for name, field in model.model_fields.items():
        if name in leave_out:
            continue
        out += [f"# {line}" for line in textwrap.wrap(description_of(model, name), 92)]
        value = values.get(name, default_text(field))
        out.append(f"{name} = {value}" if value is not None else f"# {name} = {sample(field)}")
        if len(out[-1]) > WIDTH and value is not None and value.startswith("["):
            items = field.get_default(call_default_factory=True)
            out[-1:] = [f"{name} = [", *(f"    {_text(item)}," for item in items), "]"]
    return out


def default_text(field: FieldInfo) -> str | None:
    """Return the default of a key as TOML, None where it has none."""
    value = field.get_default(call_default_factory=True)
    if value is None:
        return None
    kind = kind_of(field)
    if kind is None:
        return _text(value)
    unit = units.display_unit(kind, value)
    return _text(f"{units.convert(value, kind, unit):.12g} {unit}")


def sample(field: FieldInfo) -> str:
    """Return an example of what a key can say, as TOML."""
    kind = kind_of(field)
    if field.examples:
        return _text(field.examples[0])
    return _text(units.KINDS[kind].example) if kind is not None else "..."


def _texts(values: Mapping[str, str]) -> dict[str, str]:
    return {key: _text(value) for key, value in values.items()}


def _text(value: Any) -> str:
    """Write a value as TOML."""
    if isinstance(value, Mapping):
        inside = ", ".join(f"{dotted((k,))} = {_text(v)}" for k, v in value.items())
        return f"{{ {inside} }}" if inside else "{}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_text(v) for v in value) + "]"
    if value is None:
        return '""'  # a column that is not there: TOML knows no null
    if isinstance(value, float) and not abs(value) < float("inf"):
        return "nan" if value != value else ("inf" if value > 0 else "-inf")
    return toml_text(value) if isinstance(value, str) else json.dumps(value)


# -- the file as resolved ------------------------------------------------------------------


def resolved(campaign: Campaign, folder: str | Path, head: str = "") -> str:
    """Write the campaign with every default filled in, as it is kept in the run folder.

    Numbers are written in SI to the last bit, files relative to `folder`, so that the copy
    gives the same result from there. `head`: remarks to begin with.
    """
    tables = campaign.tables
    log = _exact(tables.log)
    relocate(log, campaign.folder, Path(folder))
    master = {} if campaign.master is None else _exact(campaign.master)
    relocate(master, campaign.folder, Path(folder))
    site = _exact(tables.site)
    note = ""
    if tables.site.gravity is None:
        note = f"# gravity: {campaign.site.gravity!r} m/s^2, {campaign.site.gravity_source}"
    blocks = [
        f"{RESOLVED.decode()}, in SI units.",
        *([head] if head else []),
        table_text("instrument", _exact(tables.instrument) | campaign.instrument),
        table_text("site", site) + note,
        table_text("log", log),
        *([table_text("master", master)] if master else []),
        table_text("procedure", {"name": campaign.procedure} | _exact(campaign.settings)),
    ]
    if tables.noise is not None:
        blocks.append(table_text("noise", _exact(tables.noise)))
    prior: dict[str, Any] = {k: v.model_dump() for k, v in tables.prior.items()}
    if campaign.earlier is not None:
        prior = earlier.written(campaign.earlier, campaign.folder, Path(folder)) | prior
    if prior:
        blocks.append(table_text("prior", prior))
    simulate = _exact(campaign.simulate) | _exact(campaign.session)
    blocks.append(table_text("simulate", simulate))
    return "\n\n".join(part.strip() for part in blocks) + "\n"


def changed(campaign: Campaign, changes: Mapping[str, Mapping[str, Any]], note: str) -> str:
    """Write the campaign as its file says it, some keys changed.

    Comments are lost; numbers keep the units that the file gives them. The log is one that is
    still to be made: its name stays.

    `changes`: table -> key -> value as in a file, None removes the key.
    """
    raw = tomllib.loads(campaign.text)
    for table, keys in changes.items():
        block = raw.setdefault(table, {})
        for key, value in keys.items():
            block.pop(key, None)
            if value is not None:
                block[key] = value
    blocks = [commented([note], "#"), *(table_text(name, block) for name, block in raw.items())]
    return "\n\n".join(part.strip() for part in blocks) + "\n"


def relocate(block: dict[str, Any], old: Path, new: Path) -> None:
    """Let the files that a table names be found from another folder."""
    for key, value in block.items():
        if isinstance(value, dict):
            relocate(value, old, new)
        elif key == "file":
            block[key] = Path(os.path.relpath(old / value, new)).as_posix()


def _exact(model: BaseModel) -> dict[str, Any]:
    """Return the fields that have a value; a quantity as text in SI, to the last bit."""
    out: dict[str, Any] = {}
    for name, field in type(model).model_fields.items():
        value, kind = getattr(model, name), kind_of(field)
        if value is None:
            continue
        if isinstance(value, BaseModel):
            out[name] = _exact(value)
        elif isinstance(value, tuple) and any(isinstance(item, BaseModel) for item in value):
            out[name] = [_exact(item) for item in value]
        else:
            out[name] = value if kind is None else f"{value!r} {units.KINDS[kind].si}"
    return out


def table_text(name: str, values: Mapping[str, Any]) -> str:
    """Write a table of a campaign."""
    lines = []
    for key, value in values.items():
        line = f"{dotted((key,))} = {_text(value)}"
        if len(line) > WIDTH and isinstance(value, list | tuple):  # one item in a line
            line = "\n".join([f"{dotted((key,))} = [", *(f"    {_text(v)}," for v in value), "]"])
        lines.append(line)
    return "\n".join([f"[{dotted((name,))}]", *lines, ""])
