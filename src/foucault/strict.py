"""Tables of files that people write, as pydantic models: what is not known in one is refused.

The docstring of a field is its description. It is read where it is shown, in a template or in the
schema: to read it where the class is made, as pydantic can, takes every command some milliseconds
a class.
"""

from __future__ import annotations

import ast
import inspect
from functools import cache
from itertools import pairwise
from typing import Any, get_args

from pydantic import BaseModel, ConfigDict, field_validator


def _described(schema: dict[str, Any], model: type[BaseModel]) -> None:
    for name, field in model.model_fields.items():
        description = description_of(model, name)
        if description:
            schema["properties"][field.alias or name]["description"] = description


class Strict(BaseModel):
    """A table without keys that are not known, and that does not change."""

    model_config = ConfigDict(extra="forbid", frozen=True, json_schema_extra=_described)

    @field_validator("*", mode="before")
    @classmethod
    def _no_word_for_a_number(cls, value: Any, info: Any) -> Any:
        """Refuse true and false where a number is wanted: they would be taken for 1 and 0."""
        if isinstance(value, bool) and not _takes(cls.model_fields[info.field_name].annotation):
            raise ValueError("it should be a number, not true or false")
        return value


def _takes(annotation: Any) -> bool:
    """Tell whether true or false is among what a field may be."""
    word = annotation in (bool, Any) or isinstance(annotation, bool)
    return word or any(map(_takes, get_args(annotation)))


def description_of(model: type[BaseModel], name: str) -> str:
    """Return what a model says of its field `name`: its own docstring, or what its type says."""
    for kind in model.__mro__:
        if name in inspect.get_annotations(kind):
            own = _docstrings(kind).get(name)
            return own or model.model_fields[name].description or ""
    return ""


@cache
def _docstrings(kind: type) -> dict[str, str]:
    """Return field -> its docstring, lines joined."""
    (made,) = ast.parse(inspect.getsource(kind)).body
    assert isinstance(made, ast.ClassDef)
    return {
        field.target.id: " ".join(below.value.value.split())
        for field, below in pairwise(made.body)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(below, ast.Expr)
        and isinstance(below.value, ast.Constant)
        and isinstance(below.value.value, str)
    }
