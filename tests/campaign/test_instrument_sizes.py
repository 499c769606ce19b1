"""What `[instrument]` says of what is not estimated: of a grade, a data sheet, or by itself."""

from __future__ import annotations

import pytest

from foucault.campaign import parse, template
from foucault.errors import FoucaultError
from foucault.models import left_out, parts

NAMED = 'name = "example IMU"\n'


def sizes(lines: str) -> dict[str, tuple[float, str]] | None:
    given = parse(template("hand_rotated").replace(NAMED, NAMED + lines), "a.toml").sizes
    return None if given is None else dict(given)


def test_nothing_said_is_what_the_noise_tells_and_off_is_nothing() -> None:
    assert sizes("") == {}
    assert sizes("left_out = false\n") is None


def test_a_part_has_its_class_and_what_its_sheet_states() -> None:
    got, sheet = sizes('part = "icm20948"\n'), parts.sizes_of("ICM-20948")
    usual = left_out.sizes_of("consumer MEMS")
    assert got is not None
    assert set(got) == set(usual)
    stated = {group for group in sheet if group in usual}
    assert len(stated) >= 3
    assert all(got[group] == sheet[group] for group in stated)
    assert all(got[group] == usual[group] for group in set(usual) - stated)


def test_what_is_declared_goes_before_the_sheet() -> None:
    got = sizes('part = "ICM-20948"\naccel_quadratic = "40 ug/g^2"\n')
    assert got is not None
    assert got["accel.quadratic"] == (
        pytest.approx(40e-6 / 9.80665, rel=1e-6),
        "as given in the campaign",
    )


def test_an_unknown_part_is_refused_with_the_nearest() -> None:
    with pytest.raises(FoucaultError, match="ICM-20948"):
        sizes('part = "ICM-20949"\n')
