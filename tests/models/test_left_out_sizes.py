"""Typical sizes of what is not estimated, and what one size does to samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault import units
from foucault.coefficients import coefficients_of
from foucault.errors import FoucaultError
from foucault.models import left_out
from foucault.models.earth import Site
from foucault.models.imu import LAYOUT, LINEAR_LOWER, ImuModel
from foucault.models.left_out import Motion

SITE = Site.at(0.85, 60.0)
RNG = np.random.default_rng(1)
MOTION = Motion(np.linspace(5.0, 9.0, 50), 10 * RNG.standard_normal((50, 3)),
                RNG.standard_normal((50, 3)), 5.0, 9.0)  # fmt: skip


def test_every_group_has_a_size_of_every_grade_and_says_what_it_rests_on() -> None:
    table = left_out.table()
    for name, group in table.groups.items():
        units.factor(group.unit, group.kind)
        if not group.sizes:  # those of the place, of the rig, and of what [prior] says
            assert not group.basis
            continue
        assert len(group.sizes) == len(group.basis) == len(table.grades)
        assert all(group.basis) and min(group.sizes) > 0
        # No grade is worse than the one before it.
        assert list(group.sizes) == sorted(group.sizes, reverse=True)
        if not name.endswith(" drift") and name != left_out.LATITUDE:
            every = (*LAYOUT.coefficients, *coefficients_of("magnetometer_curved"))
            assert {c.kind for c in every if c.name.startswith(f"{name}.")} == {group.kind}
    sizes = left_out.sizes_of("consumer MEMS")
    # 600 ppm of the scale factor at 100 deg/s
    assert sizes["gyro.cubic"][0] * np.radians(100) ** 2 == pytest.approx(600e-6)
    assert left_out.in_words("accel.cross", sizes["accel.cross"][0]) == "250 ug/g^2"
    assert sizes["accel.cross"][1] == "consumer MEMS, judgement"


def test_a_grade_that_is_not_known_is_refused() -> None:
    told = "No typical sizes are known of an instrument of grade 'tactical FOGG'. Did you mean"
    with pytest.raises(FoucaultError, match=told):
        left_out.sizes_of("tactical FOGG")


def test_what_is_estimated_or_cannot_be_is_not_left_out() -> None:
    sizes = left_out.sizes_of("tactical FOG") | {left_out.GRAVITY: (1e-5, "gravimeter")}
    some = left_out.terms([*LINEAR_LOWER, "gyro.cubic.x"], SITE, sizes)
    assert len(some) == 3 + 15 + 3 + 9 + 3 + 2 + 18 + 12 + 2
    nowhere = left_out.terms(LINEAR_LOWER, replace(SITE, latitude=None), sizes)
    assert left_out.LATITUDE not in [t.group for t in nowhere]


def test_terms_of_a_magnetometer_are_left_out_where_there_is_one() -> None:
    """Data sheets state the deviation from the best straight line, as a part of the full scale."""
    sizes = left_out.sizes_of("consumer MEMS")
    assert not any(t.name.startswith("mag.") for t in left_out.terms(LINEAR_LOWER, SITE, sizes))
    field = np.linspace(-200e-6, 200e-6, len(MOTION.time))
    at = MOTION._replace(mag=field[:, None] * np.array([1.0, 0.5, -1.0]))
    some = [t for t in left_out.terms(["mag.bias.x"], SITE, sizes) if t.name.startswith("mag.")]
    assert [t.name for t in some[::3]] == ["mag.quadratic.x", "mag.cubic.x", "mag.bias drift x"]
    for k in range(0, 9, 3):
        made = [c.mag for c in left_out.changes(some[k : k + 3], ImuModel(), at)]
        assert [np.flatnonzero(x.any(axis=0)).tolist() for x in made] == [[0], [1], [2]]
        x = made[0][:, 0]
        if "drift" in some[k].name:
            assert x[-1] - x[0] == pytest.approx(50e-9)
        else:  # 0.1 % of 200 uT from the line that leaves least
            line = np.polynomial.chebyshev.chebfit(field / 200e-6, x, 3)
            assert np.abs(line[2:]).max() == pytest.approx(0.1e-2 * 200e-6, rel=0.03)


@pytest.mark.parametrize("group", [
    g for g in left_out.sizes_of("consumer MEMS") if g.startswith(("accel.", "gyro."))
])  # fmt: skip
def test_one_size_is_what_the_instrument_with_the_term_says_more(group) -> None:
    model = ImuModel(
        accel_matrix=np.eye(3) + 0.02 * RNG.standard_normal((3, 3)),
        gyro_matrix=np.eye(3) + 0.02 * RNG.standard_normal((3, 3)),
        accel_bias=0.3 * RNG.standard_normal(3), gyro_bias=0.01 * RNG.standard_normal(3),
    )  # fmt: skip
    size = left_out.sizes_of("consumer MEMS")[group]
    some = left_out.terms((), SITE, {group: size})
    plain = model.measure(MOTION.f_b, MOTION.w_ib_b)
    for term, change in zip(some, left_out.changes(some, model, MOTION), strict=True):
        if group.endswith(" drift"):
            added = (change.accel, change.gyro)[group.startswith("gyro")]
            other = (change.accel, change.gyro)[group.startswith("accel")]
            assert other is None and np.flatnonzero(added.any(axis=0)) == "xyz".index(term.name[-1])
            own = (MOTION.f_b, MOTION.w_ib_b)[group.startswith("gyro")][[0, -1]][
                :, "xyz".index(term.name[-1])
            ] if "scale" in group else np.ones(2)  # fmt: skip
            ends = added[[0, -1], "xyz".index(term.name[-1])]
            np.testing.assert_allclose(ends, size[0] * np.array([-0.5, 0.5]) * own)
            continue
        more = model.moved((term.name,), np.array([term.size])).measure(MOTION.f_b, MOTION.w_ib_b)
        for was, now, added in zip(plain, more, change[:2], strict=True):
            added = 0.0 if added is None else added
            np.testing.assert_allclose(now - was, added + 0 * was, atol=1e-15 + 1e-9 * term.size)
