"""A line keeps the points that are seen, and only these."""

from __future__ import annotations

import numpy as np
import pytest

from foucault.report.chart import band, draw, line, log_axis
from foucault.report.page import Figure
from foucault.report.seen import FEW, PARTS, points, seen

RNG = np.random.default_rng(4)


def made(*data, **more) -> Figure:
    return seen(draw("chart.residuals", list(data), **more))


@pytest.mark.parametrize("y", [np.sin(np.arange(500) / 20), RNG.standard_normal(500).cumsum()])
def test_no_point_lies_farther_from_the_line_that_is_left_than_is_seen(y):
    p = np.column_stack([np.linspace(0.0, 1.0, len(y)), (y - y.min()) / np.ptp(y)])
    kept = points(p, 1.0 / PARTS)
    assert kept[0] and kept[-1] and kept.sum() < len(y)
    a = p[kept]
    along = np.diff(a, axis=0)
    share = np.einsum("nki,ki->nk", p[:, None] - a[:-1], along) / (along**2).sum(axis=1)
    near = a[:-1] + np.clip(share, 0, 1)[..., None] * along
    off = np.linalg.norm(p[:, None] - near, axis=2).min(axis=1)
    assert off.max() <= 1.0 / PARTS


def test_a_straight_line_is_its_ends_and_breaks_stay():
    p = np.column_stack([np.arange(9.0), np.zeros(9)])
    p[4] = np.nan
    np.testing.assert_array_equal(np.flatnonzero(points(p, 0.1)), [0, 3, 4, 5, 8])
    np.testing.assert_array_equal(points(np.full((3, 2), np.nan), 0.1), [True] * 3)
    assert points(np.zeros((2, 2)), 0.1).all()


def test_what_belongs_to_the_points_goes_with_them():
    x = np.linspace(0.0, 1.0, 4 * FEW)
    (trace,) = made(line("a", x, np.abs(x - 0.5), customdata=x.tolist())).data
    assert len(trace["x"]) == len(trace["y"]) == len(trace["customdata"]) < 6
    np.testing.assert_allclose(trace["customdata"], trace["x"], rtol=1e-5)


def test_an_axis_decides_what_is_seen():
    x = np.linspace(1.0, 100.0, 300)
    spike = 1e6 * (np.arange(300) == 0) + np.sin(x)
    whole, near = (len(made(line("a", x, spike), y=look).data[0]["x"])
                   for look in ("value", {"range": [-2, 2]}))  # fmt: skip
    assert whole < 6 < near
    assert len(made(line("a", x, x**2), y=log_axis("value")).data[0]["x"]) > 10


def test_short_lines_steps_and_bands_keep_their_shape():
    few = np.arange(FEW - 1.0)
    assert len(made(line("a", few, 0 * few)).data[0]["x"]) == FEW - 1
    x = np.arange(200.0)
    assert len(made(line("a", x, 0 * x, shape="hv")).data[0]["x"]) == 200
    (area,) = made(band("a", x, 0 * x - 1, 0 * x + 1)).data
    assert len(area["x"]) == 4
