"""The document result.json: its schema, and a `Result` as plain JSON values and back.

Values are SI with angles in radians; display values are there for people and are ignored when
a document is read. JSON knows no NaN and no infinity: both are written as null. A key may be
added within a version; changing or removing one makes a new version.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, JsonValue, model_validator
from typing_extensions import TypedDict

from foucault import units
from foucault.coefficients import Coefficient, CoefficientVector, Layout
from foucault.errors import ADVICE, Finding, Status
from foucault.files import plain_json
from foucault.models.temperature import TemperatureModel
from foucault.result import Check, Level, Result, TimeBase, Verdict

SCHEMA = "foucault.result/1"  # Name and version of the document.

MIGRATIONS: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {}
"""Schema name of an older document -> the step that makes the next version of it.

A step gets the document as plain JSON values and returns it with a newer schema name. Steps
follow one another until `SCHEMA` is reached. Version 1 is the first, so there is no step yet.
"""


Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
"""A number of JSON: a text that looks like one is none."""

Size = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0)]
"""A number that is no less than zero, such as a standard deviation."""

Flag = Annotated[bool, Field(strict=True)]

AGREES = 1e-6
"""Part by which a standard deviation may differ from the root of its variance, as rounding [1]."""


class CoefficientRow(BaseModel):
    """One coefficient: value and sd in the SI unit `unit`, and as people read them."""

    name: str
    symbol: str
    meaning: str
    kind: str = Field(description="What is measured, for instance 'angular rate'; fixes the unit")
    unit: str = Field(description="SI unit of value, sd and prior_sd")
    value: Number | None = Field(description="null where the computation met no finite number")
    sd: Size | None = Field(
        description="Standard deviation in the log's own time; null where unknown"
    )
    free: Flag = Field(description="true where estimated, false where held at its value")
    prior_sd: Size | None = Field(description="Standard deviation of the prior; null for none")
    display_unit: str
    display_value: Number | None
    display_sd: Size | None
    sd_seconds: Size | None = Field(
        None, description="Standard deviation in seconds: with that of the log's clock"
    )
    display_sd_seconds: Size | None = None

    @model_validator(mode="after")
    def _unit_is_si(self) -> Self:
        if self.kind not in units.KINDS:
            raise ValueError(f"kind '{self.kind}' of {self.name} is not known")
        if self.unit != units.KINDS[self.kind].si:
            raise ValueError(f"unit of {self.name} must be '{units.KINDS[self.kind].si}'")
        return self


class Covariance(BaseModel):
    """Covariance of the coefficients, in the products of their SI units."""

    names: list[str] = Field(description="Coefficient of each row and column")
    matrix: list[list[Number | None]]


class ClockDocument(BaseModel):
    """What the clock of the log adds to the uncertainty, as one cause; `sd` is without it."""

    source: str = Field(description="Whose clock: 'sensor', 'host', 'disciplined' or 'several'")
    sd: Size = Field(description="Relative standard deviation of its rate [1]")
    declared: Flag = Field(description="true where declared, false where usual for the source")
    error: dict[str, Number] = Field(
        description="Coefficient -> its error per standard deviation of the clock [SI unit of it]; "
        "the covariance in seconds is `covariance` plus its outer product"
    )


class VerdictRow(BaseModel):
    """How far the result can be trusted, and why."""

    level: Level
    reasons: list[str]


class CheckRow(BaseModel):
    """One test of the result. `low` or `high` is null where there is no limit on that side."""

    name: str
    value: Number | None
    low: Number | None
    high: Number | None
    passed: Flag
    sentence: str
    fails: Level = Field(description="Level the verdict falls to when the check fails")
    p: Number | None = Field(
        None, description="Probability that chance makes so much; null where the limits say all"
    )


class FindingRow(BaseModel):
    """Something noticed in the data that did not stop the work."""

    code: str
    severity: str
    message: str
    cure: str


class TableRow(BaseModel):
    """A table saved beside the document as Parquet."""

    file: str = Field(description="Path relative to result.json, with forward slashes")
    rows: int
    sha256: str


class CampaignRow(BaseModel):
    """The campaign file, with every default filled in, that led to this result."""

    file: str
    sha256: str


class TemperatureFunction(BaseModel):
    """One coefficient as a function of temperature."""

    name: str
    unit: str = Field(description="SI unit of the coefficient")
    weights: list[Number] = Field(
        description="polynomial: those of (T - reference)^k, k = 0, 1, ... [unit/K^k]; piecewise "
        "linear: the values at the knots [unit]"
    )
    scatter: Size | None = Field(
        description="sd about the function from one session to the next [unit]; null where unknown"
    )


class TemperatureDocument(BaseModel):
    """The coefficients as functions of temperature, in the order of `coefficients`."""

    kind: Literal["polynomial", "piecewise linear"]
    reference: Number = Field(description="temperature of `coefficients` and of T - reference [K]")
    low: Number = Field(description="below this temperature nothing is known [K]")
    high: Number = Field(description="above this temperature nothing is known [K]")
    knots: list[Number] = Field(description="of piecewise linear functions, else empty [K]")
    functions: list[TemperatureFunction]
    covariance: list[list[Number]] = Field(
        description="of all weights, those of a function side by side"
    )

    @model_validator(mode="after")
    def _shapes_agree(self) -> Self:
        terms = {len(f.weights) for f in self.functions}
        if len(terms) != 1:
            raise ValueError("functions must all have the same number of weights")
        if bool(self.knots) != (self.kind == "piecewise linear"):
            raise ValueError("knots are those of piecewise linear functions")
        if self.knots and (terms != {len(self.knots)} or len(self.knots) < 2):
            raise ValueError("there must be a weight for every knot, and two knots or more")
        if any(b <= a for a, b in zip(self.knots, self.knots[1:], strict=False)):
            raise ValueError("knots must rise")
        size = len(self.functions) * terms.pop()
        if [len(row) for row in self.covariance] != [size] * size or not size:
            raise ValueError(f"covariance must have {size} x {size} numbers")
        if not 0 < self.low <= self.reference <= self.high:
            raise ValueError("low, reference and high must rise")
        return self


_OPEN = ConfigDict(extra="allow")  # these keep keys that are not listed here


class Site(TypedDict, total=False):
    """Where the instrument stood."""

    __pydantic_config__ = _OPEN  # type: ignore[misc]
    gravity: Annotated[Number | None, Field(description="local gravity [m/s^2]")]
    gravity_source: Annotated[str | None, Field(description="'given' or 'normal gravity'")]
    latitude: Annotated[Number | None, Field(description="geodetic, positive north [rad]")]
    height: Annotated[Number | None, Field(description="above the ellipsoid [m]")]


class Instrument(TypedDict, total=False):
    """Which instrument was calibrated. An empty text means not given."""

    __pydantic_config__ = _OPEN  # type: ignore[misc]
    name: Annotated[str | None, Field(description="make and model")]
    serial: Annotated[str | None, Field(description="serial number")]
    operator: Annotated[str | None, Field(description="who made the measurement")]
    due: Annotated[str | None, Field(description="when it must be calibrated again")]
    note: Annotated[str | None, Field(description="anything else")]


Range = Annotated[list[Number | None], Field(min_length=2, max_length=2)]


class Validity(TypedDict, total=False):
    """What the session covered: outside it the result is extrapolated."""

    __pydantic_config__ = _OPEN  # type: ignore[misc]
    accel: Annotated[Range | None, Field(description="specific force of any axis [m/s^2]")]
    gyro: Annotated[Range | None, Field(description="angular rate of any axis [rad/s]")]
    temperature: Annotated[Range | None, Field(description="lowest and highest [K]")]
    temperature_mean: Annotated[Number | None, Field(description="mean over the session [K]")]
    rate: Annotated[Number | None, Field(description="sample rate of the log [Hz]")]
    sampled: Annotated[str | None, Field(description="'rate' or 'increment'")]


class Input(TypedDict, total=False):
    """A log that a result was made from."""

    __pydantic_config__ = _OPEN  # type: ignore[misc]
    file: Annotated[str | None, Field(description="its name")]
    sha256: Annotated[str | None, Field(description="its fingerprint")]
    description: Annotated[dict[str, JsonValue] | None, Field(description="how it was read")]


class Given(TypedDict, total=False):
    """What was known before a session."""

    __pydantic_config__ = _OPEN  # type: ignore[misc]
    given: Annotated[
        dict[str, Annotated[list[Number | None], Field(min_length=2, max_length=2)]],
        Field(description="mean and standard deviation of coefficients or groups [SI]"),
    ]
    inputs: Annotated[list[Input], Field(description="logs of the earlier result")]


class Provenance(TypedDict, total=False):
    """What the result was made from and with."""

    __pydantic_config__ = _OPEN  # type: ignore[misc]
    versions: Annotated[dict[str, str], Field(description="package name to version")]
    inputs: Annotated[list[Input], Field(description="input files: file, sha256, size, ...")]
    input: Annotated[Input | None, Field(description="the log of a session")]
    prior: Annotated[Given | None, Field(description="what was known before the session")]
    seed: Annotated[int | None, Field(description="seed of random numbers; null where unused")]
    created: Annotated[str | None, Field(description="date and time, ISO 8601 with offset")]
    seconds: Annotated[Number | None, Field(description="duration of the computation [s]")]


class ResultDocument(BaseModel):
    """A calibration result: coefficients with covariance, and what is needed to trust it."""

    model_config = ConfigDict(title="Foucault calibration result", populate_by_name=True)

    schema_: Literal["foucault.result/1"] = Field(alias="schema")
    procedure: str
    status: Status = Field(description="How the computation ended")
    advice: str = Field(description="What the status means for the user")
    verdict: VerdictRow
    instrument: Instrument
    site: Site
    equation: str = Field(description="Model equation: what the instrument says for what is true")
    frame: str = Field(description="Axes the coefficients refer to")
    gauge: str = Field(description="Which physical directions define these axes")
    validity: Validity
    coefficients: list[CoefficientRow]
    covariance: Covariance | None = Field(description="null where unknown")
    checks: list[CheckRow]
    findings: list[FindingRow]
    diagnostics: dict[str, JsonValue] = Field(description="Numbers of the procedure, all SI")
    provenance: Provenance
    campaign: CampaignRow | None = None
    tables: dict[str, TableRow]
    temperature: TemperatureDocument | None = Field(
        None, description="null where coefficients are not known as functions of temperature"
    )

    clock: ClockDocument | None = Field(
        None, description="null in results made before it was known"
    )

    @model_validator(mode="after")
    def _names_agree(self) -> Self:
        names = [row.name for row in self.coefficients]
        if len(set(names)) < len(names):
            raise ValueError("a coefficient appears twice")
        if self.covariance is not None:
            if self.covariance.names != names:
                raise ValueError("covariance.names differ from the names of the coefficients")
            if [len(r) for r in self.covariance.matrix] != [len(names)] * len(names):
                raise ValueError(f"covariance.matrix must have {len(names)} x {len(names)} numbers")
            for i, row in enumerate(self.coefficients):
                variance = self.covariance.matrix[i][i]
                if row.sd is None or variance is None or variance < 0:
                    continue  # a negative variance is told as such
                if not math.isclose(row.sd, math.sqrt(variance), rel_tol=AGREES, abs_tol=1e-300):
                    raise ValueError(f"sd of {row.name} is not the root of its variance")
        if self.temperature is not None and [f.name for f in self.temperature.functions] != names:
            raise ValueError("temperature.functions differ from the names of the coefficients")
        return self


def result_schema() -> dict[str, Any]:
    """Return the JSON schema of result.json."""
    return ResultDocument.model_json_schema(by_alias=True)


def migrated(doc: dict[str, Any]) -> dict[str, Any]:
    """Bring `doc`, a document of any known older version, to this version.

    A document whose version is not known is returned as it is, for the reader to refuse.
    """
    while (step := MIGRATIONS.get(str(doc.get("schema")))) is not None:
        doc = step(dict(doc))
    return doc


def document(result: Result) -> dict[str, Any]:
    """Return `result` as plain JSON values, without its tables."""
    vector = result.coefficients
    covariance = (
        None
        if vector.cov is None
        else {"names": list(vector.names), "matrix": plain_json(vector.cov)}
    )
    out = {
        "schema": SCHEMA,
        "procedure": result.procedure,
        "status": result.status.value,
        "advice": ADVICE[result.status],
        "verdict": {"level": result.verdict.level.value, "reasons": list(result.verdict.reasons)},
        "instrument": plain_json(result.instrument),
        "site": plain_json(result.site),
        "equation": result.equation,
        "frame": result.frame,
        "gauge": result.gauge,
        "validity": plain_json(result.validity),
        "coefficients": plain_json(_rows(result)),
        "covariance": covariance,
        "checks": [
            plain_json({k: v for k, v in vars(check).items() if k != "p" or v is not None})
            for check in result.checks
        ],
        "findings": [finding.as_dict() for finding in result.findings],
        "diagnostics": plain_json(result.diagnostics),
        "provenance": plain_json(result.provenance),
        "campaign": None,
        "tables": {},
    }
    if result.temperature is not None:
        out["temperature"] = _functions(result.temperature)
    if result.clock is not None:
        out["clock"] = plain_json(vars(result.clock))
    ResultDocument.model_validate(out)  # what is written can be read back
    return out


def _rows(result: Result) -> list[dict[str, Any]]:
    """Return one dictionary per coefficient, with both standard deviations."""
    rows = result.coefficients.rows()
    if result.clock is None:
        return rows
    both = zip(rows, result.in_seconds.rows(), strict=True)
    return [
        row | {"sd_seconds": one["sd"], "display_sd_seconds": one["display_sd"]}
        for row, one in both
    ]


def result_of(doc: ResultDocument, tables: dict[str, Any]) -> Result:
    """Return the `Result` that a validated document describes, with its `tables`."""
    return Result(
        procedure=doc.procedure,
        coefficients=_vector(doc),
        equation=doc.equation,
        frame=doc.frame,
        gauge=doc.gauge,
        verdict=Verdict(doc.verdict.level, tuple(doc.verdict.reasons)),
        checks=tuple(
            Check(**{**row.model_dump(), "value": _number(row.value), "fails": row.fails})
            for row in doc.checks
        ),
        findings=tuple(Finding(**row.model_dump()) for row in doc.findings),
        status=doc.status,
        instrument=dict(doc.instrument),
        site=dict(doc.site),
        validity=dict(doc.validity),
        diagnostics=dict(doc.diagnostics),
        provenance=dict(doc.provenance),
        tables=tables,
        temperature=None if doc.temperature is None else _temperature(doc),
        clock=None if doc.clock is None else TimeBase(**doc.clock.model_dump()),
    )


def _functions(model: TemperatureModel) -> dict[str, Any]:
    return {
        "kind": model.kind,
        "reference": model.reference,
        "low": model.low,
        "high": model.high,
        "knots": plain_json(model.knots),
        "functions": [
            {
                "name": c.name,
                "unit": c.unit,
                "weights": plain_json(w),
                "scatter": plain_json(float(s)),
            }
            for c, w, s in zip(model.layout.coefficients, model.weights, model.scatter, strict=True)
        ],
        "covariance": plain_json(model.cov),
    }


def _temperature(doc: ResultDocument) -> TemperatureModel:
    given = doc.temperature
    assert given is not None
    return TemperatureModel(
        _vector(doc).layout,
        np.array([f.weights for f in given.functions]),
        np.array(given.covariance),
        given.reference,
        given.low,
        given.high,
        np.array(given.knots),
        np.array([_number(f.scatter) for f in given.functions]),
    )


def _vector(doc: ResultDocument) -> CoefficientVector:
    rows = doc.coefficients
    cov = None
    if doc.covariance is not None:
        cov = np.array([[_number(v) for v in row] for row in doc.covariance.matrix])
    return CoefficientVector(
        Layout(tuple(Coefficient(r.name, r.symbol, r.kind, r.meaning) for r in rows)),
        np.array([_number(r.value) for r in rows], float),
        None if cov is None else cov.reshape(len(rows), len(rows)),
        np.array([r.free for r in rows], bool),
        np.array([np.inf if r.prior_sd is None else r.prior_sd for r in rows], float),
    )


def _number(value: float | None) -> float:
    return math.nan if value is None else value
