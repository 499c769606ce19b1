"""What `long.toml` names is there: a row of a test that has another name hides nothing."""

from __future__ import annotations

import pytest

import make_long


@pytest.mark.parametrize("path", make_long.table())
def test_every_row_is_a_test(path: str) -> None:
    rows = make_long.table()[path]
    assert {name.partition("[")[0] for name in rows} <= make_long.there(path)


def test_cases_are_named_alone_but_where_most_are_long() -> None:
    cases = {"test_a": 0.1, "test_b[1]": 1.0, "test_b[2]": 0.1, "test_b[3]": 0.1}
    cases |= {"test_c[1]": 1.0, "test_c[2]": 0.5, "test_c[3]": 0.1}
    assert make_long.long_ones(cases, 1.0) == ["test_b[1]", "test_c"]
    assert make_long.long_ones(cases, 2.0) == ["test_b[1]", "test_c[1]"]
