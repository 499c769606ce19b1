"""Tables of files: what is unknown is refused, and a docstring describes its field."""

from __future__ import annotations

from typing import Annotated

import pytest
from pydantic import Field, ValidationError

from foucault.strict import Strict, description_of

Length = Annotated[float, Field(gt=0, description="How long.")]


class Base(Strict):
    """A table."""

    one: float = 1.0
    """What is said in
    two lines."""
    two: Length = 2.0


class Child(Base):
    """One with more."""

    one: float = 3.0
    """Something else."""
    three: int = Field(default=3, description="As a keyword.")
    four: int = 4


def test_a_field_is_described_by_its_docstring_else_by_its_type():
    said = {name: description_of(Child, name) for name in Child.model_fields}
    assert said == {
        "one": "Something else.", "two": "How long.", "three": "As a keyword.", "four": "",
    }  # fmt: skip
    assert description_of(Base, "one") == "What is said in two lines."
    assert description_of(Base, "five") == ""


def test_the_schema_says_the_same():
    fields = Base.model_json_schema()["properties"]
    assert [fields[name]["description"] for name in ("one", "two")] == [
        "What is said in two lines.", "How long.",
    ]  # fmt: skip


def test_what_is_unknown_is_refused():
    with pytest.raises(ValidationError, match="Extra inputs"):
        Base(other=1.0)
    with pytest.raises(ValidationError, match="frozen"):
        Base().one = 2.0
