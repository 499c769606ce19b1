"""Files that were sampled at their own instants, put together by their times."""

from __future__ import annotations

import numpy as np
import pytest

import make_bare as make
from foucault.campaign.recognised import found
from foucault.errors import FoucaultError
from foucault.logs import LogDescription, read
from foucault.logs.merged import means_at, smaller, within
from foucault.recognise.reading import recognise


def described(**more) -> LogDescription:
    return LogDescription.model_validate({
        "join": "times", "time": {"column": "t", "unit": "s"},
        "gyro": {"file": "gyro.csv", "columns": ["x", "y", "z"], "unit": "rad/s"},
        "accel": {"file": "accel.csv", "columns": ["x", "y", "z"], "unit": "m/s^2"}, **more,
    })  # fmt: skip


def write(folder, name: str, t: np.ndarray, x: np.ndarray, head: str = "t,x,y,z"):
    file = folder / f"{name}.csv"
    file.write_text(make.text(head, [t, x], ["%.9g"] * (1 + x.shape[1])))
    return file


def test_a_mean_over_an_interval_is_that_of_straight_lines():
    time = np.array([0.0, 0.5, 1.5, 2.0, 4.0])
    x = 3.0 * time - 1.0
    np.testing.assert_allclose(means_at(np.array([1.0, 2.2]), 0.9, time, x), [2.0, 5.6])
    both = means_at(np.array([1.0]), 1.0, time, np.column_stack([x, time > 1.6]))
    np.testing.assert_allclose(both, [[2.0, 0.0]])
    # Through intervals that touch, the integral is kept whatever was between the samples.
    rng = np.random.default_rng(0)
    fine, grid = np.sort(rng.uniform(0, 10, 400)), np.arange(1.0, 9.0, 0.25)
    y = rng.standard_normal(400)
    whole = means_at(np.array([(grid[0] + grid[-1]) / 2]), len(grid) * 0.25, fine, y)
    np.testing.assert_allclose(means_at(grid, 0.25, fine, y).mean(), whole[0], atol=1e-12)


@pytest.mark.parametrize(("k", "within_"), [(1.0, 0.01), (2.0, 0.01), (4.0, 0.01), (8.0, 0.01)])
def test_white_noise_reads_too_small_by_what_is_said(k, within_):
    x = np.random.default_rng(1).standard_normal(400_000)
    time = np.arange(len(x)) / k + 1e-3
    grid = np.arange(10.0, time[-1] - 10.0, 1.0 + 1e-3 / 7)  # all phases of the samples
    mean = means_at(grid, 1.0, time, x)
    assert mean.std() * np.sqrt(k) == pytest.approx(smaller(k), abs=within_)
    # Over many samples its density is right.
    rows = len(mean) // 200 * 200
    long = mean[:rows].reshape(-1, 200).mean(axis=1)
    assert long.std() * np.sqrt(200 * k) == pytest.approx(1.0, abs=0.08)


def test_intervals_outside_or_in_a_gap_are_left_out():
    time = np.concatenate([np.arange(0.0, 2.0, 0.1), np.arange(3.0, 5.0, 0.1)])
    grid = np.arange(0.0, 6.0, 0.5)
    np.testing.assert_array_equal(grid[within(grid, 0.5, time)], [0.5, 1.0, 1.5, 3.5, 4.0, 4.5])


def test_files_of_several_rates_are_one_log(tmp_path):
    fast, slow = np.arange(0.0, 60.0, 0.005) + 0.0013, np.arange(0.0, 60.0, 0.02)
    f = np.column_stack([np.sin(slow), np.cos(slow), 9.8 + 0 * slow])
    w = np.column_stack([np.cos(fast), np.sin(fast), 0.1 + 0 * fast])
    write(tmp_path, "accel", slow, f)
    write(tmp_path, "gyro", fast, w)
    warm = np.arange(-5.0, 70.0, 1.0)
    write(tmp_path, "warm", warm, 20 + 0.1 * warm[:, None], "t,T")
    log = read(described(temperature={"file": "warm.csv", "column": "T", "unit": "degC"}), tmp_path)
    np.testing.assert_allclose(log.time, slow[1:], atol=1e-9)
    np.testing.assert_allclose(log.accel, f[1:], atol=1e-8)
    np.testing.assert_allclose(log.gyro[:, 0], np.cos(log.time), atol=1e-4)
    np.testing.assert_allclose(log.temperature, 293.15 + 0.1 * log.time, atol=1e-6)
    note = next(f for f in log.findings if f.code == "log.joined")
    assert "at the 50 Hz of 'accel.csv'" in note.message
    assert "6 % too small" in note.message


def test_what_cannot_be_joined_by_times_is_refused(tmp_path):
    t, x = np.arange(0.0, 5.0, 0.01), np.zeros((500, 3))
    write(tmp_path, "accel", t, x)
    write(tmp_path, "gyro", t + 100.0, x)
    with pytest.raises(FoucaultError, match="no time in common"):
        read(described(), tmp_path)
    write(tmp_path, "gyro", t, x)
    write(tmp_path, "table", t, x[:, :1], "t,outer")
    table = {"file": "table.csv", "columns": ["outer", "", ""], "unit": "deg"}
    with pytest.raises(FoucaultError, match="readings of a table jump"):
        read(described(table=table), tmp_path)
    for more in ({"rate": 100.0, "time": None}, {"file": "accel.csv", "more": ["b.csv"]}):
        with pytest.raises(FoucaultError, match="needs rates and a time column"):
            described(**more)


def test_a_phones_files_of_different_rates_are_recognised(tmp_path):
    log = make.truth(1, 400.0, 16)
    one = write(tmp_path, "Accelerometer", log.time[2::4], log.accel[2::4])
    two = write(tmp_path, "Gyroscope", log.time[::2], log.gyro[::2])
    held = found([one, two])
    assert held.recognised.log["join"] == "times"
    assert held.session.procedure == "hand_rotated"
    assert 'join = "times"' in held.text
    rows = np.searchsorted(log.time, held.log.time - 1e-6)
    np.testing.assert_allclose(held.log.accel, log.accel[rows], atol=1e-6)
    # The same instants need no joining; other titles of time do not tell.
    both = [write(tmp_path, name, log.time[::4], x[::4])
            for name, x in (("Accelerometer", log.accel), ("Gyroscope", log.gyro))]  # fmt: skip
    assert "join" not in recognise(both).log
    write(tmp_path, "Gyroscope", log.time[::3], log.gyro[::3], "seconds,x,y,z")
    with pytest.raises(FoucaultError, match="different numbers of rows"):
        recognise(both)
