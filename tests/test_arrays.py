"""Directions that do not depend on the rounding of a library, and columns without pandas."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pytest

from foucault.arrays import (
    Names,
    begins,
    by_number,
    chosen,
    of_arrow,
    repeating,
    settled,
    to_arrow,
)


def test_directions_of_equal_values_do_not_depend_on_how_they_are_turned() -> None:
    rng = np.random.default_rng(4)
    V = np.linalg.qr(rng.standard_normal((5, 5)))[0].T
    values = np.array([3.0, 2.0, 2.0, 2.0, 1.0])
    turned = V.copy()
    turned[1:4] = np.linalg.qr(rng.standard_normal((3, 3)))[0] @ V[1:4]
    first, second = settled(values, V), settled(values, turned)
    np.testing.assert_allclose(first, second, atol=1e-12)
    np.testing.assert_allclose(first @ first.T, np.eye(5), atol=1e-12)
    # The same space, and those with a value of their own untouched.
    np.testing.assert_allclose(first[1:4].T @ first[1:4], V[1:4].T @ V[1:4], atol=1e-12)
    np.testing.assert_array_equal(first[[0, 4]], V[[0, 4]])
    assert not np.allclose(V[1:4], turned[1:4], atol=0.1)


@pytest.mark.parametrize(
    "values",
    [
        pa.array([1.5, None, -2.0, 4.0]),
        pa.array([1, 2, 3, 4], pa.int32()),
        pa.array([1, None, 3, 4]),
        pa.array([True, False, True, True]),
        pa.array(["a", None, "c", "d"]),
        pa.array([1, None, 3, 4], pa.timestamp("ns")),
        pa.array([], pa.float64()),
    ],
)
def test_a_column_is_what_pandas_would_make_of_it(values):
    for some in (values, pa.chunked_array([values, values]), values[1:], values[1:3]):
        made, expected = of_arrow(some), _by_pandas(some)
        assert made.dtype == expected.dtype
        np.testing.assert_array_equal(made, expected)


def _by_pandas(some):
    loose = {} if isinstance(some, pa.ChunkedArray) else {"zero_copy_only": False}
    return some.to_numpy(**loose)


@pytest.mark.parametrize(
    "values",
    [
        np.array([1.5, np.nan, -2.0]),
        np.array([1.5, 2.5, 3.5, 4.5])[::2],
        np.array([1, 2], np.int32),
        np.array([True, False] * 9),
        np.array(["a", "", "µ°", "bc"]),
        np.array([], "U1"),
        np.array(["a", None], object),
        np.array([], float),
    ],
)
def test_a_column_is_what_pyarrow_makes_of_it(values):
    made = to_arrow(values)
    made.validate(full=True)
    expected = pa.array(values)
    assert made.type == expected.type and made.null_count == expected.null_count
    np.testing.assert_array_equal(of_arrow(made), of_arrow(expected))


def test_names_are_read_as_a_tuple_of_words_would_be():
    words = ("a", "", "Zürich", "d")
    names = Names(pa.array(words))
    assert names == words and [*names] == [*words] and len(names) == 4
    assert names[np.int64(2)] == "Zürich" and names[-1] == "d" and names[1:3] == words[1:3]
    assert names.index("d") == 3 and "" in names and names != words[:3]
    with pytest.raises(IndexError):
        names[4]
    for some in (words, names):
        assert chosen(some, np.array([3, 0, 0])) == ("d", "a", "a")
    assert to_arrow(names[2:]).to_pylist() == ["Zürich", "d"]


def test_runs_begin_where_a_number_is_another_and_what_hangs_on_a_count_is_made_once_for_each():
    assert begins(np.array([3, 3, 0, 0, 0, 3])).tolist() == [True, False, True, False, False, True]
    assert begins(np.zeros(0, np.int64)).tolist() == []
    asked: list[int] = []
    found = by_number(np.array([4, 0, 4, 2]), lambda n: asked.append(n) or n / 2)
    assert found.tolist() == [2.0, 0.0, 2.0, 1.0]
    assert asked == [0, 2, 4]
    assert by_number(np.zeros(0, np.int64), float).tolist() == []


def test_what_repeats_is_its_first_part():
    x = np.array([0.0, 1.0, 2.0])
    assert repeating(np.tile(x, 4), 4).tolist() == x.tolist()
    for other, count in ((np.tile(x, 4), 5), (np.arange(6.0), 2), (np.full(6, np.nan), 2), (x, 0)):
        assert repeating(other, count) is other
