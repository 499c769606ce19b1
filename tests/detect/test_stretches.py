"""No rest, turn or dwell begins or ends at another sample without somebody deciding that it shall.

What was kept is written again by `python tests/make_stretches.py`, and then listed in CHANGELOG.md.
"""

from __future__ import annotations

import numpy as np
import pytest

import make_stretches as golden

QUICK = [
    pytest.param(case, marks=() if case.endswith("/1") else pytest.mark.thorough)
    for case in golden.CASES
]


@pytest.mark.parametrize("case", QUICK)
def test_stretches_begin_and_end_where_they_did(case: str) -> None:
    if case.startswith("real/") and not golden.REAL.is_dir():
        pytest.skip(f"real logs are not here: set FOUCAULT_DATA ({golden.REAL})")
    before, after = golden.kept()[case], golden.made(case)
    assert before.keys() == after.keys()
    for name, rows in before.items():
        assert same(rows, after[name]), f"{name}: {differs(rows, after[name])}"
    if "live" in after:  # a log that came in pieces has the rests of the whole one, to the sample
        assert after["live"] == after["rests"]


def same(a, b) -> bool:
    """Samples to the sample, times to ten microseconds."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[k], b[k]) for k in a)
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, float) or isinstance(b, float):
        return bool(np.isclose(a, b, rtol=1e-5, atol=1e-5))
    return a == b


def differs(a, b) -> str:
    if not isinstance(a, list) or not isinstance(b, list):
        return f"{a} -> {b}"
    return f"gone {[x for x in a if x not in b][:9]}, new {[x for x in b if x not in a][:9]}"


def test_a_boundary_that_moves_is_seen() -> None:
    assert same([[1, 5], [7, 9]], [[1, 5], [7, 9]])
    assert not same([[1, 5], [7, 9]], [[1, 5], [7, 10]])
    assert not same([[0.25, 1.0]], [[0.25, 1.25]])
    assert differs([[1, 5], [7, 9]], [[1, 5], [7, 10]]) == "gone [[7, 9]], new [[7, 10]]"
