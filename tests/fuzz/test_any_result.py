"""Results and units with anything in them: what can be believed, or one error."""

from __future__ import annotations

import copy
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from make_damage import places

from foucault import run_folder, units
from foucault.errors import FoucaultError
from make_result import make_result

JSON = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=6)),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=4), inner, max_size=3)
    ),
    max_leaves=5,
)


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("result")
    run_folder.save(make_result(), folder, "")
    return json.loads((folder / run_folder.RESULT_FILE).read_text())


def load(path: Path, text: str | bytes) -> None:
    """Load a result; one that is taken has coefficients and can be written again."""
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8", "surrogatepass"))
    try:
        result = run_folder.load_result(path, with_tables=False)
    except FoucaultError as problem:
        assert problem.message and problem.cure
        return
    assert len(result.coefficients.values) == len(result.coefficients.names)
    cov = result.coefficients.cov
    assert cov is None or not np.isinf(cov).any()


@given(data=st.data())
def test_anything_at_any_key(document: dict[str, Any], data: st.DataObject, tmp_path: Path) -> None:
    out = copy.deepcopy(document)
    for _ in range(data.draw(st.integers(1, 2))):
        *path, last = data.draw(st.sampled_from(places(out)))
        at = out
        for key in path:
            at = at[key]
        if data.draw(st.booleans()):
            at[last] = data.draw(JSON)
        else:
            del at[last]
    load(tmp_path / "result.json", json.dumps(out))


@given(cut=st.integers(0, 20000), content=st.binary(max_size=20))
def test_damaged_bytes(document: dict[str, Any], cut: int, content: bytes, tmp_path: Path) -> None:
    text = json.dumps(document).encode()
    load(tmp_path / "result.json", text[:cut] + content)


UNITS = st.one_of(
    st.sampled_from(["m", "m/s^2", "deg/sqrt(h)", "9^9^9^9 m", "(m", "m)", "m/0", "[m]", "µg"]),
    st.text(alphabet="mgsdeh/*^()0123456789. -+sqrtµ°²√%_'[]{}", max_size=20), st.text(max_size=12),
)  # fmt: skip


@given(number=st.one_of(st.floats().map(repr), st.text(max_size=8)), unit=UNITS,
       kind=st.sampled_from(list(units.KINDS)))  # fmt: skip
def test_any_unit(number: str, unit: str, kind: str) -> None:
    try:
        value = units.parse(f"{number} {unit}", kind)
    except FoucaultError as problem:
        assert problem.code.startswith("unit.")
        return
    assert isinstance(value, float) and math.isfinite(value)


@given(value=st.floats(-1e9, 1e9), kind=st.sampled_from(list(units.KINDS)))
def test_what_is_shown_is_read_again(value: float, kind: str) -> None:
    unit = units.display_unit(kind, value)
    text = f"{units.convert(value, kind, unit)!r} {unit}"
    assert units.parse(text, kind) == pytest.approx(value, rel=1e-12, abs=1e-300)
