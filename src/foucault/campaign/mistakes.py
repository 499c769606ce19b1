"""One clear error for the first mistake in a table, with its full dotted key."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Collection, Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from foucault import units
from foucault.campaign.fields import dotted, fields_at, kind_of, models_in
from foucault.errors import FoucaultError, error, suggestion

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


MOST = 100_000
"""More of anything, rests or repetitions, than a session has [1]."""


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
