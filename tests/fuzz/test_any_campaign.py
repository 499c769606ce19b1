"""Campaign files with anything in them: a campaign, or one error that names the key."""

from __future__ import annotations

import copy
import datetime
import math
import tomllib
from functools import cache
from typing import Any

import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st
from make_damage import places

from foucault import campaign
from foucault.campaign.writing import changed
from foucault.errors import FoucaultError
from foucault.procedures import PROCEDURES
from refusals import refuses

TEXTS = st.one_of(
    st.sampled_from([
        "", " ", "nan", "inf", "-1 s", "0 s", "1e999 s", "1e-400 s", "1 s", "10 Hz", "-5 deg/h",
        "9**9**9**9 s", "1 (s", "1 s)", "1 __s", "0x10 s", "1,5 s", "١ s", "1 µs", "5 deg",
        "91 deg", "1 ppm", "x up", "../..", "log.csv\u0000", "auto", "none", "1e308 km",
        "1 m^99999", "\ud7ff",
    ]),
    st.text(max_size=8),
    st.builds("{} {}".format, st.floats(), st.sampled_from(["s", "deg", "Hz", "m", "g", "K"])),
)  # fmt: skip

VALUES = st.recursive(
    st.one_of(
        TEXTS, st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats(),
        st.just(datetime.date(2026, 1, 1)), st.just(datetime.time(1, 2)),
    ),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=6,
)  # fmt: skip


@cache
def known_keys(procedure: str) -> dict[str, Any]:
    """Every table of the template, with the keys that are commented out in it too."""
    lines = []
    for line in campaign.template(procedure).splitlines():
        bare = line.removeprefix("# ")
        try:
            tomllib.loads(bare)
            lines.append(bare if bare.startswith("[") or " = " in bare else line)
        except tomllib.TOMLDecodeError:
            lines.append(line)
    try:
        return tomllib.loads("\n".join(lines))
    except tomllib.TOMLDecodeError:
        return tomllib.loads(campaign.template(procedure))


@st.composite
def mistaken(draw: st.DrawFn, document: dict[str, Any]) -> dict[str, Any]:
    """Draw a document of which some places hold something else, or are gone."""
    out = copy.deepcopy(document)
    for _ in range(draw(st.integers(1, 3))):
        every = places(out)
        if not every:
            break
        *path, last = draw(st.sampled_from(every))
        at = out
        for key in path:
            at = at[key]
        how = draw(st.sampled_from(["value", "value", "value", "gone", "new"]))
        if how == "value":
            at[last] = draw(VALUES)
        elif how == "gone":
            del at[last]
        elif isinstance(at, dict):
            at[draw(st.text(max_size=6))] = draw(VALUES)
    return out


def finite(value: Any) -> bool:
    """Tell whether every number of a parsed model is finite."""
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, dict):
        return all(map(finite, value.values()))
    return all(map(finite, value)) if isinstance(value, list | tuple) else True


def taken(text: str) -> campaign.Campaign | None:
    """Parse a campaign, or return None where it is refused in words."""
    try:
        read = campaign.parse(text)
    except FoucaultError as problem:
        assert problem.message and problem.cure and len(str(problem)) < 5000
        return None
    for part in (read.settings, read.session, read.log, read.simulate, read.tables):
        assert finite(part.model_dump()), part
    return read


@pytest.mark.parametrize("procedure", PROCEDURES)
def test_templates_are_taken(procedure: str) -> None:
    assert taken(campaign.template(procedure)) is not None


@pytest.mark.thorough
@pytest.mark.parametrize("procedure", PROCEDURES)
@given(data=st.data())
def test_anything_at_any_key(procedure: str, data: st.DataObject) -> None:
    document = data.draw(mistaken(known_keys(procedure)))
    try:
        text = tomli_w.dumps(document)
    except (TypeError, ValueError, UnicodeEncodeError):
        return
    read = taken(text)
    if read is not None:
        again = campaign.parse(changed(read, {}, "the same"))
        assert (again.settings, again.session, again.log) == (
            read.settings, read.session, read.log
        )  # fmt: skip


@given(text=st.text(max_size=60))
def test_any_text(text: str) -> None:
    taken(text)


@given(content=st.binary(max_size=60), cut=st.integers(0, 3000))
def test_any_bytes(content: bytes, cut: int, tmp_path) -> None:
    good = campaign.template("hand_rotated").encode()
    path = tmp_path / "campaign.toml"
    path.write_bytes(good[:cut] + content + good[cut:])
    try:
        campaign.load(path)
    except FoucaultError as problem:
        assert problem.cure


@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
def test_numbers_that_are_none(value: str) -> None:
    text = campaign.template("hand_rotated").replace("held_out = 5", f"held_out = {value}")
    with refuses("campaign.value", match=r"procedure\.held_out"):
        campaign.parse(text)
