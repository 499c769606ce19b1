"""North of many set-ups: the same numbers whatever the blocks, and whatever the number of cores."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest

from foucault.models.earth import Site
from foucault.models.imu import ImuModel
from foucault.models.left_out import sizes_of
from foucault.procedures.north_seeking import blocks
from foucault.procedures.north_seeking.fix import Survey, find_north
from foucault.simulate.north import NorthPlan, SeekerErrors, Stops, simulate_north
from make_north import LATITUDE, NOISE, many

FOUR = (0.0, 180.0, 90.0, 270.0)


@pytest.fixture(scope="module")
def log():
    """Eleven set-ups of four stops: one disturbed, one with other times, one without a stop."""
    plan = NorthPlan(many(11, 5.0), Stops(np.radians(FOUR), np.full(4, 90.0), 5.0))
    made = simulate_north(
        plan, model=ImuModel(), noise=NOISE, site=Site.at(LATITUDE), reference=False,
        errors=SeekerErrors(gyro_offset=2e-6), seed=3,
    ).log  # fmt: skip
    gyro, time = made.gyro.copy(), made.time.copy()
    gyro[5] += 2e-6
    time[13:16] += 4.0
    return replace(made, gyro=gyro, time=time).rows(np.delete(np.arange(len(made)), 23))


def found(log, monkeypatch, size: int, cores: int) -> Survey:
    monkeypatch.setattr(blocks, "BLOCK", size)
    monkeypatch.setattr(os, "cpu_count", lambda: cores)
    return find_north(log, site=Site.at(LATITUDE), noise=NOISE, sizes=sizes_of("tactical FOG"))


def numbers(survey: Survey) -> dict[str, np.ndarray]:
    f, p = survey.fixes, survey.pairs
    return {
        "angles": f.angles, "cov": f.cov, "square": f.square, "bound": survey.bound,
        "drift": survey.drift_effect, "chi": p.chi_square,
        "residuals": survey.again(np.arange(len(survey))).pairs.residuals,
        "levels": survey.levels, **f.sources,
    }  # fmt: skip


def test_any_number_of_cores_gives_the_same_bits(log, monkeypatch):
    one, four = (numbers(found(log, monkeypatch, 3, cores)) for cores in (1, 4))
    assert one.keys() == four.keys()
    for name, values in one.items():
        assert values.tobytes() == four[name].tobytes(), name


def test_blocks_of_any_size_find_the_same(log, monkeypatch):
    """What is summed over all set-ups is rounded otherwise, and nothing else."""
    whole, parts = (found(log, monkeypatch, size, 1) for size in (100, 3))
    assert [v.level for v in whole.verdicts] == [v.level for v in parts.verdicts]
    assert [f.message for f in whole.findings] == [f.message for f in parts.findings]
    for name, values in numbers(whole).items():
        np.testing.assert_allclose(numbers(parts)[name], values, rtol=1e-7, atol=1e-13,
                                   err_msg=name)  # fmt: skip
    assert {v.level.value for v in whole.verdicts} > {"doubtful"}


def test_the_worst_of_all_blocks_is_what_is_refused(log, monkeypatch):
    gyro = log.gyro.copy()
    gyro[[9, 33]] += [3e-4, 6e-4]
    text = []
    for size in (100, 3):
        with pytest.raises(Exception, match="times") as problem:
            found(replace(log, gyro=gyro), monkeypatch, size, 1)
        text.append(str(problem.value))
    assert text[0] == text[1]


def test_some_set_ups_again_are_what_they_were_with_all_that_is_said_of_them(log, monkeypatch):
    survey = found(log, monkeypatch, 4, 1)
    some = np.array([1, 5, 6, 10])
    again = survey.again(some)
    assert again.fixes.sources.keys() == survey.fixes.sources.keys()
    assert again.fixes.angles.tobytes() == survey.fixes.angles[some].tobytes()
    for name, variance in survey.fixes.sources.items():
        assert variance.shape == (11, 1)
        assert again.fixes.sources[name][:, :1].tobytes() == variance[some].tobytes()
    total = sum(again.fixes.sources.values())
    np.testing.assert_allclose(total, np.einsum("nii->ni", again.fixes.cov), rtol=1e-6)
    assert len(again.pairs.residuals) == len(survey.dwells.setups(some))
