"""What a pydantic model says about its fields: names in the file, kinds, sub-tables."""

from __future__ import annotations

import re
import types
from collections.abc import Mapping
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from foucault.escape import toml_text
from foucault.units import Quantity

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
