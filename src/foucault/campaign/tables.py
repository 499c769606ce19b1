"""The tables of a campaign file, as pydantic models: every key, its kind and its meaning.

The first mistake in a table is one clear error with its full dotted key (`validate`).
"""

from __future__ import annotations

import json
import math
import re
import types
from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import cache
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

import numpy as np
from pydantic import BaseModel, Field, ValidationError, create_model, model_validator
from pydantic.fields import FieldInfo

from foucault import units
from foucault.coefficients import Layout
from foucault.errors import Finding, FoucaultError, error, finding, suggestion
from foucault.escape import toml_text
from foucault.logs.description import LogDescription
from foucault.logs.layout import FileLayout
from foucault.models import earth, left_out, noise, parts
from foucault.strict import Strict
from foucault.units import Angle, Force, Length, Quantity, Rate, Ratio, Seconds

GRAVITY_LIMITS = (9.7, 9.9)
"""Anything outside is a mistake: gravity on the surface lies in 9.764 .. 9.834 [m/s^2]."""

HEIGHT_LIMITS = (-500.0, 20e3)
"""From the lowest land to the highest aircraft; beyond, km were m or feet a mistake [m]."""

GRAVITY_ANOMALY = 500e-6
"""Largest believable departure from normal gravity, relative; anomalies reach 400 mGal."""


class Instrument(Strict):
    """What was calibrated; repeated in the result and the report."""

    name: str = ""
    """Make and model."""
    serial: str = ""
    """Serial number."""
    operator: str = ""
    """Who made the measurement."""
    due: str = ""
    """When it must be calibrated again."""
    note: str = ""
    """Anything else worth keeping, such as the temperature."""
    grade: Literal["consumer MEMS", "tactical MEMS", "tactical FOG", "navigation RLG"] | None = (
        Field(default=None, examples=["consumer MEMS"])
    )
    """Its class. What the calibration does not estimate has the typical size (1 sd) of this class
    in every uncertainty, and is tested. Left out, the noise of the log tells the class."""
    part: str | None = Field(default=None, examples=["ICM-20948"])
    """A part that `foucault parts` knows: its class, and the sizes that its data sheet states."""
    left_out: bool | None = Field(default=None, examples=[False])
    """false: what is not estimated is taken for nothing, as in a simulated instrument that holds
    nothing else. Left out, its sizes are as said here, or of the class that the noise tells."""
    accel_quadratic: Annotated[float, Quantity("quadratic")] | None = Field(default=None, ge=0)
    """Size of the accelerometers' quadratic terms, instead of that of the grade."""
    accel_cross: Annotated[float, Quantity("quadratic")] | None = Field(default=None, ge=0)
    """Size of the products of two axes in the accelerometers."""
    accel_asymmetry: Ratio | None = Field(default=None, ge=0)
    """Size of the asymmetry of the accelerometers' scale factors."""
    gyro_g_sensitivity: Annotated[float, Quantity("g-sensitivity")] | None = Field(
        default=None, ge=0
    )
    """Size of the gyros' g-sensitivity."""
    gyro_asymmetry: Ratio | None = Field(default=None, ge=0)
    """Size of the asymmetry of the gyros' scale factors."""
    gyro_cubic: Annotated[float, Quantity("cubic")] | None = Field(default=None, ge=0)
    """Size of the gyros' cubic terms."""
    gyro_deflection: Annotated[float, Quantity("deflection")] | None = Field(default=None, ge=0)
    """Size of the deflection of the gyros' axes under specific force."""
    accel_bias_drift: Force | None = Field(default=None, ge=0)
    """Size of the drift of the accelerometers' biases over the session, end minus start."""
    gyro_bias_drift: Rate | None = Field(default=None, ge=0)
    """Size of the drift of the gyros' biases over the session, end minus start."""
    accel_scale_drift: Ratio | None = Field(default=None, ge=0)
    """Size of the drift of the accelerometers' scale factors over the session."""
    gyro_scale_drift: Ratio | None = Field(default=None, ge=0)
    """Size of the drift of the gyros' scale factors over the session."""
    mag_quadratic: Ratio | None = Field(default=None, ge=0)
    """Size of the quadratic terms of a magnetometer, as a part of 50 uT at that field."""
    mag_cubic: Ratio | None = Field(default=None, ge=0)
    """Size of the cubic terms of a magnetometer, as a part of 50 uT at that field."""
    mag_bias_drift: Annotated[float, Quantity("magnetic field")] | None = Field(default=None, ge=0)
    """Size of the drift of the hard iron over the session, end minus start."""

    def sizes(self) -> dict[str, tuple[float, str]] | None:
        """Return the sizes of what is not estimated [SI], None where it is taken for nothing.

        What nothing is said of has the size that the noise of a log tells.
        """
        if self.left_out is False:
            sized = {g.replace(".", "_").replace(" ", "_") for g in left_out.table().groups}
            given = sorted((sized | {"grade"}) & self.model_fields_set)
            if given:
                raise error("left_out.off", keys=", ".join(given))
            return None
        known = left_out.table()
        said = {
            group: (size, "as given in the campaign")
            for group in known.groups
            if (size := getattr(self, group.replace(".", "_").replace(" ", "_"), None)) is not None
        }
        sheet: dict[str, tuple[float, str]] = {}
        grade: str | None = self.grade
        if self.part is not None:
            usual_too = {g for g, group in known.groups.items() if group.sizes}
            sheet = {g: s for g, s in parts.sizes_of(self.part).items() if g in usual_too}
            of = parts.part(self.part).grade
            grade = grade or (of if of in known.grades else None)
        if grade is None:
            return left_out.ByNoise(sheet | said)
        return left_out.sizes_of(grade) | sheet | said

    def named(self) -> dict[str, str]:
        """Return what a result repeats: which instrument it was, not what such ones are like."""
        return self.model_dump(include={"name", "serial", "operator", "due", "note"})


class SiteTable(Strict):
    """Where it was calibrated."""

    latitude: Angle | None = None
    """Geodetic latitude, positive north. Without it Earth rate is not modelled."""
    longitude: Angle | None = None
    """Longitude, positive east."""
    height: Length = 0.0
    """Height above the ellipsoid."""
    gravity: Annotated[float, Quantity("gravity")] | None = None
    """Local gravity; left out, normal gravity at latitude and height."""
    gravity_sd: Annotated[float, Quantity("gravity")] | None = Field(
        default=None, ge=0, examples=["0.0004 m/s^2"]
    )
    """Its standard uncertainty. Left out: that of the gravity model of the place, 40 mGal; a value
    of a gravimeter has its own, such as 0.00001 m/s^2."""
    date: str | None = Field(default=None, examples=["2026-05-04"])
    """Day of the session: the world magnetic model then says where magnetic north is, and the field
    itself. It needs the longitude too, and the extra `world`."""
    grid: str | None = Field(default=None, examples=["EPSG:32631"])
    """Projection, by a name that PROJ knows: where the north of its grid is. It needs the longitude
    too, and the extra `grid`."""

    @property
    def said(self) -> bool:
        """Whether a place or gravity is given."""
        return self.latitude is not None or self.gravity is not None

    def site(self) -> earth.Site:
        """Return the site, with normal gravity where none is given."""
        if self.latitude is not None and abs(self.latitude) > np.pi / 2:
            raise error("site.latitude", given=np.degrees(self.latitude))
        if not HEIGHT_LIMITS[0] <= self.height <= HEIGHT_LIMITS[1]:
            raise error("site.height", given=self.height)
        if self.gravity is None:
            if self.latitude is None:
                raise error("site.unknown")
            site = earth.Site.at(self.latitude, self.height)
        elif GRAVITY_LIMITS[0] <= self.gravity <= GRAVITY_LIMITS[1]:
            site = earth.Site(self.gravity, self.latitude, self.height)
        else:
            raise error("site.gravity", given=self.gravity)
        site = replace(site, longitude=self.longitude, date=self.date, grid=self.grid)
        return site if self.gravity_sd is None else replace(site, gravity_sd=self.gravity_sd)

    def findings(self) -> tuple[Finding, ...]:
        """Compare gravity as given with normal gravity."""
        if self.gravity is None or self.latitude is None:
            return ()
        normal = earth.gravity(self.latitude, self.height)
        off = abs(self.gravity / normal - 1)
        if off < GRAVITY_ANOMALY:
            return ()
        return (finding("site.gravity_differs", given=self.gravity, normal=normal, ppm=off * 1e6),)


class _Noise(Strict):
    def over(self, start: noise.TriadNoise) -> noise.TriadNoise:
        """Replace in `start` what the file gives."""
        return replace(start, **self.model_dump(exclude_none=True))


class Said(Strict):
    """What is said beside a log; it goes before what a campaign file says."""

    latitude: Angle | None = None
    """Latitude of the site, positive north, such as "47.3 deg"."""
    longitude: Angle | None = None
    """Longitude of the site, such as "8.5 deg"."""
    height: Length | None = None
    """Height of the site, such as "430 m"."""
    gravity: Annotated[float, Quantity("gravity")] | None = None
    """Local gravity, such as "9.8072 m/s^2"."""
    date: str | None = None
    """Day, such as "2026-05-04": headings from magnetic north too."""
    grid: str | None = None
    """Projection, such as "EPSG:32631" (UTM zone 31 north): headings from that north too."""
    gyro_noise: Annotated[float, Quantity("angle random walk")] | None = Field(default=None, gt=0)
    """Angle random walk of the gyros, such as "0.003 deg/sqrt(h)"."""
    accel_noise: Annotated[float, Quantity("velocity random walk")] | None = Field(
        default=None, gt=0
    )
    """Velocity random walk of the accelerometers, such as "30 ug/sqrt(Hz)"."""
    accel_reads: Literal["gravity", "specific force"] | None = None
    """Sign of the accelerometers: specific force is +1 g upwards."""
    serial: str = ""
    """Serial number of the instrument, compared with the calibration."""
    log: dict[str, Any] = Field(default_factory=dict)
    """Keys of [log] that are known of a log without a campaign."""

    @property
    def site(self) -> dict[str, Any]:
        """The keys of [site] that are given [SI]."""
        return self.model_dump(include={*SiteTable.model_fields}, exclude_none=True)

    def over(self, declared: noise.ImuNoise | None) -> noise.ImuNoise | None:
        """Return the noise that a file declares, with what is said of it instead."""
        white = {"accel": self.accel_noise, "gyro": self.gyro_noise}
        given = {triad: value for triad, value in white.items() if value is not None}
        if not given:
            return declared
        start = declared or noise.ImuNoise(noise.TriadNoise(), noise.TriadNoise())
        changed = {t: replace(getattr(start, t), white=value) for t, value in given.items()}
        return replace(start, **changed)


class AccelNoise(_Noise):
    """Noise of the accelerometers."""

    white: Annotated[float, Quantity("velocity random walk")] | None = Field(default=None, ge=0)
    """Velocity random walk."""
    bias_instability: Force | None = Field(default=None, ge=0)
    """Standard deviation of a first-order Markov bias."""
    correlation_time: Seconds | None = Field(default=None, gt=0)
    """Correlation time of that bias."""
    random_walk: Annotated[float, Quantity("acceleration random walk")] | None = Field(
        default=None, ge=0
    )
    """Acceleration random walk."""
    quantisation: Force | None = Field(default=None, ge=0)
    """Step of the output; of increments, that of the sum over the sample interval."""


class GyroNoise(_Noise):
    """Noise of the gyros."""

    white: Annotated[float, Quantity("angle random walk")] | None = Field(default=None, ge=0)
    """Angle random walk."""
    bias_instability: Rate | None = Field(default=None, ge=0)
    """Standard deviation of a first-order Markov bias."""
    correlation_time: Seconds | None = Field(default=None, gt=0)
    """Correlation time of that bias."""
    random_walk: Annotated[float, Quantity("rate random walk")] | None = Field(default=None, ge=0)
    """Rate random walk."""
    quantisation: Rate | None = Field(default=None, ge=0)
    """Step of the output; of increments, that of the sum over the sample interval."""


class NoiseTable(Strict):
    """Noise of the sensors, where it is known better than the rests can tell."""

    grade: str | None = Field(default=None, json_schema_extra={"enum": [*noise.GRADES, None]})
    """Start from a typical class."""
    part: str | None = Field(default=None, examples=["ICM-20948"])
    """Start from the white noise in the data sheet of an instrument, one of `foucault parts`."""
    accel: AccelNoise | None = None
    gyro: GyroNoise | None = None

    def noise(self) -> noise.ImuNoise:
        """Return the noise: grade or data sheet, what is given for accel and gyro replaced."""
        if self.model_dump(exclude_none=True) == {}:
            raise error("noise.empty", allowed=", ".join(noise.GRADES))
        start = _started(self.grade, self.part)
        return noise.ImuNoise(
            start.accel if self.accel is None else self.accel.over(start.accel),
            start.gyro if self.gyro is None else self.gyro.over(start.gyro),
        )


def _started(grade: str | None, part: str | None) -> noise.ImuNoise:
    """Return the noise of a class or of a data sheet; none without either."""
    if part is None:
        return noise.ImuNoise() if grade is None else noise.grade(grade, "noise.grade").noise
    if grade is not None:
        raise error(
            "campaign.value", key="noise.part", given=repr(part), hint="", more="",
            reason="it stands beside noise.grade: give one of them",
        )  # fmt: skip
    stated = parts.noise_of(part)
    if stated is None:
        known = parts.part(part)
        lacks = sorted({"accel", "gyro"} - set(parts.noise_basis(known.name)))
        raise error("noise.part", name=known.name, lacks=" and ".join(lacks))
    return stated


class PriorEntry(Strict):
    """What is known of a coefficient, or of every coefficient of a group, beforehand."""

    mean: str = Field(description="Expected value with its unit.", examples=["0 deg/h"])
    sd: str = Field(description="Standard deviation with its unit.", examples=["10 deg/h"])


class SimulateTable(Strict):
    """How `foucault simulate` makes the instrument."""

    seed: int = Field(default=1, ge=0)
    """Seed of every random number."""
    grade: str = Field(default="mems", json_schema_extra={"enum": list(noise.GRADES)})
    """Typical class its errors and noise are drawn from."""
    errors: dict[str, str] = Field(default={}, examples=[{"gyro.bias.x": "30 deg/h"}])
    """Coefficients set to a value instead of drawn."""

    @model_validator(mode="before")
    @classmethod
    def _join(cls, raw: Any) -> Any:
        if isinstance(raw, dict) and isinstance(raw.get("errors"), dict):
            return raw | {"errors": joined(raw["errors"])}
        return raw


class CampaignFile(Strict):
    """A campaign of Foucault."""

    instrument: Instrument = Instrument()
    site: SiteTable = SiteTable()
    log: LogDescription
    master: dict[str, Any] = Field(default={})
    procedure: dict[str, Any]
    noise: NoiseTable | None = None
    prior: dict[str, PriorEntry] = Field(default={})
    simulate: dict[str, Any] = Field(default={})
    optimise: dict[str, Any] = Field(default={})

    @model_validator(mode="before")
    @classmethod
    def _join(cls, raw: Any) -> Any:
        if isinstance(raw, dict) and isinstance(raw.get("prior"), dict):
            return raw | {"prior": joined(raw["prior"])}
        return raw

    def __reduce__(self) -> tuple[Any, ...]:
        # A class that is made on the fly has no name by which pickle could find it.
        return _empty_with, (type(self).model_fields["log"].annotation,), self.__getstate__()


def _empty_with(log: type[FileLayout]) -> CampaignFile:
    model = file_with(log)
    return model.__new__(model)


@cache
def file_with(log: type[FileLayout]) -> type[CampaignFile]:
    """Return the model of a campaign file whose [log] is described by `log`."""
    if log is LogDescription:
        return CampaignFile
    return create_model("CampaignFile", __base__=CampaignFile, log=(log, ...))


def joined(table: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Undo TOML's nesting of ``gyro.bias = ...`` written without quotes."""
    out: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, dict) and value and not {"mean", "sd"} & value.keys():
            out |= joined(value, f"{before}{key}.")
        else:
            out[before + key] = value
    return out


_BARE = re.compile(r"[A-Za-z0-9_-]+")


def dotted(keys: tuple[str | int, ...]) -> str:
    """Write `keys`, shape (any,), as TOML would: ``prior."gyro.bias".sd``."""
    return ".".join(str(k) if _BARE.fullmatch(str(k)) else toml_text(k) for k in keys)


def kind_of(field: FieldInfo) -> str | None:
    """Return the kind of a field that holds a number with a unit, else None."""
    marks = [*field.metadata, *_marks(field.annotation)]
    return next((m.kind for m in marks if isinstance(m, Quantity)), None)


def _marks(annotation: Any) -> list[Any]:
    own = list(getattr(annotation, "__metadata__", ()))
    if get_origin(annotation) in (Union, types.UnionType):
        own += [m for a in get_args(annotation) for m in _marks(a)]
    return own


def models_in(annotation: Any) -> list[type[BaseModel]]:
    """Return the models inside an annotation such as ``Noise | None`` or ``dict[str, Prior]``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    if get_origin(annotation) in (Annotated, Union, types.UnionType, dict, list, tuple):
        return [m for a in get_args(annotation) for m in models_in(a)]
    return []


def fields_at(model: type[BaseModel], loc: tuple[str | int, ...]) -> Mapping[str, FieldInfo]:
    """Return the fields of the table at `loc`, shape (any,), below `model`, by key."""
    models = [model]
    for key in loc:
        fields = _by_key(models)
        if key in fields:
            models = models_in(fields[str(key)].annotation)
        # else: a key of a dictionary or an entry of a list; the models stay
    return _by_key(models)


def _by_key(models: list[type[BaseModel]]) -> dict[str, FieldInfo]:
    return {f.alias or n: f for m in models for n, f in m.model_fields.items()}


Model = TypeVar("Model", bound=BaseModel)


def all_finite(tree: Any, where: tuple[str | int, ...] = ()) -> None:
    """Refuse nan and inf, which TOML can write and no key takes.

    `where` (any,): keys that lead to it.
    """
    if isinstance(tree, float) and not math.isfinite(tree):
        reason = "it should be a number that is finite"
        raise error("campaign.value", key=dotted(where), given=repr(tree), reason=reason, hint="",
                    more="")  # fmt: skip
    if isinstance(tree, Mapping | list):
        for key, value in tree.items() if isinstance(tree, Mapping) else enumerate(tree):
            all_finite(value, (*where, key))


def validate(
    model: type[Model],
    raw: Mapping[str, Any],
    where: tuple[str, ...] = (),
    also: Collection[str] = (),
) -> Model:
    """Check `raw` against `model`.

    `also`: keys of the table that the model does not know but that are allowed.
    """
    try:
        return model.model_validate(raw, context={"locate": True})
    except ValidationError as problem:
        raise _first(problem, model, raw, where, also) from None


MOST = 100_000  # More of anything, rests or repetitions, than a session has [1].


def countable(table: BaseModel, where: tuple[str, ...]) -> None:
    """Refuse counts that no session has, before anything is made so many times."""
    for name in type(table).model_fields:
        value = getattr(table, name)
        for item in value if isinstance(value, tuple | list) else (value,):
            if isinstance(item, BaseModel):
                countable(item, (*where, name))
            elif isinstance(item, int) and abs(item) > MOST and name != "seed":
                key = ".".join((*where, name))
                raise error("program.count", key=key, given=f"{item:g}", most=MOST)


def _first(
    problem: ValidationError,
    model: type[BaseModel],
    raw: Mapping[str, Any],
    where: tuple[str, ...],
    also: Collection[str],
) -> FoucaultError:
    details = sorted(problem.errors(), key=lambda d: d["type"] != "extra_forbidden")
    first = details[0]
    if first["type"] == "extra_forbidden":
        # A misspelt key usually makes another one missing: that is one mistake.
        beside = ("missing", first["loc"][:-1])
        details = [d for d in details if (d["type"], d["loc"][:-1]) != beside]
    rest = len(details) - 1
    more = f" ({rest} more {'mistakes' if rest > 1 else 'mistake'} beside it.)" if rest else ""
    loc = _keys(first["loc"], raw)
    key = dotted((*where, *loc))
    if first["type"] == "extra_forbidden":
        allowed = sorted({*fields_at(model, loc[:-1]), *(also if len(loc) == 1 else ())})
        table = dotted((*where, *loc[:-1]))
        return error(
            "campaign.key",
            key=key,
            hint=suggestion(str(loc[-1]), allowed),
            more=more,
            table=f"[{table}]" if table else "a campaign file",
            allowed=", ".join(allowed),
        )
    if first["type"] == "missing":
        return error("campaign.required", key=key, example=_example(model, loc), more=more)
    cause = first.get("ctx", {}).get("error")
    inner = cause.args[0] if cause is not None and cause.args else None
    if isinstance(inner, FoucaultError):
        placed = _placed(inner, key, str(loc[-1]))
        return FoucaultError(placed.code, placed.message + more, placed.cure)
    kind = _kind_at(model, loc)
    given = repr(first["input"] if kind is None else _said(raw, loc, first["input"]))
    reason = first["msg"].removeprefix("Value error, ").replace("Input should", "it should")
    if first["type"] in ("dict_type", "model_type"):
        keys = ", ".join(sorted(fields_at(model, loc)))
        reason = f"it should be a table, [{key}]" + (
            f", with keys of these: {keys}" if keys else ""
        )
    if kind is not None:
        reason = _in_units(reason, kind, first.get("ctx", {}))
    words = re.findall(r"'([^']+)'", reason)
    return error(
        "campaign.value",
        key=key,
        given=given if len(given) < 60 else given[:57] + "...",
        reason=reason.rstrip("."),
        hint=suggestion(str(first["input"]), words),
        more=more,
    )


def _kind_at(model: type[BaseModel], loc: tuple[str | int, ...]) -> str | None:
    """Return the kind of the quantity at `loc`, shape (any,), or None where there is none."""
    field = fields_at(model, loc[:-1]).get(str(loc[-1]))
    return None if field is None else kind_of(field)


def _said(raw: Any, loc: tuple[str | int, ...], read: Any) -> Any:
    """Return what the file says at `loc`, shape (any,), or `read` where it says nothing there."""
    try:
        for key in loc:
            raw = raw[key]
    except (KeyError, IndexError, TypeError):
        return read
    return raw


def _in_units(reason: str, kind: str, bounds: Mapping[str, Any]) -> str:
    """Write the bounds in `reason`, numbers in SI, with a unit that people use."""
    for bound in bounds.values():
        if isinstance(bound, int | float) and bound:
            unit = units.display_unit(kind, abs(bound))
            written = units.plain(units.convert(bound, kind, unit))
            reason = re.sub(rf"{re.escape(f'{bound:g}')}$|{re.escape(repr(bound))}$",
                            f"{written} {unit}", reason)  # fmt: skip
    return reason


def parse_at(key: str, text: str, kind: str) -> float:
    """Turn text with a unit into SI; a mistake in it names its dotted `key`."""
    try:
        return units.parse(text, kind, key)
    except FoucaultError as problem:
        raise _placed(problem, key, key) from None


def kind_of_group(name: str, layout: Layout, code: str = "prior.kind") -> str:
    """Return the kind of coefficient `name` or of all of group `name`; `code` refuses several."""
    members = [layout.coefficients[i] for i in layout.group(name)]
    kinds: list[str] = list(dict.fromkeys(c.kind for c in members))
    if len(kinds) > 1:
        groups = list(dict.fromkeys(f'"{c.name.rpartition(".")[0]}"' for c in members))
        raise error(code, name=name, kinds=", ".join(kinds), example=" and ".join(groups[:3]))
    return kinds[0]


def _placed(problem: FoucaultError, key: str, said: str) -> FoucaultError:
    """Name the full dotted key, once, where the error says `said` or nothing."""
    message = problem.message.removeprefix(f"{said}: ")
    return FoucaultError(problem.code, f"{key}: {message}", problem.cure)


def _keys(loc: tuple[str | int, ...], raw: Any) -> tuple[str | int, ...]:
    """Drop what pydantic adds to a location (names of union members) and keep the keys."""
    out: list[str | int] = []
    at = raw
    for i, key in enumerate(loc):
        if isinstance(at, Mapping):
            if key not in at and i < len(loc) - 1:
                continue  # the last key may be missing: that is the mistake
            out.append(key)
            at = at.get(key)
        elif isinstance(at, list) and isinstance(key, int) and key < len(at):
            out.append(key)
            at = at[key]
    return tuple(out) or loc


def _example(model: type[BaseModel], loc: tuple[str | int, ...]) -> str:
    field = fields_at(model, loc[:-1]).get(str(loc[-1]))
    if field is None:
        return f"{loc[-1]} = ..."
    if field.examples:
        return f"{loc[-1]} = {json.dumps(field.examples[0])}"
    kind = kind_of(field)
    if kind is not None:
        return f'{loc[-1]} = "{units.KINDS[kind].example}"'
    if models_in(field.annotation) or field.annotation == dict[str, Any]:
        return f"a table [{dotted(loc)}]"
    return field.description or f"{loc[-1]} = ..."
