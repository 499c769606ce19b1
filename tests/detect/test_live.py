"""The live detector against the one that sees the whole log, and what the checklist says."""

from __future__ import annotations

import os
import time as clock
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from foucault.detect.live import LiveRests, Rows
from foucault.detect.noise import without_spikes
from foucault.detect.stretches import How, find_rests
from foucault.diagnose.live import Watchman, checklist
from foucault.logs import read
from foucault.logs.description import LogDescription
from foucault.models.noise import grade
from foucault.plans.directions import hand_plan
from foucault.simulate.hand_rotated import draw_errors, simulate
from foucault.tables import Log
from make_session import SITE
from refusals import refuses

USED = LogDescription.model_validate(
    {
        "file": "session.csv",
        "rate": "100 Hz",
        "gyro": {"columns": [0, 1, 2], "unit": "rad/s"},
        "accel": {"columns": [3, 4, 5], "unit": "m/s^2"},
    }
)


def session(rate: float = 100.0, rests: int = 16, seed: int = 1, name: str = "mems") -> Log:
    plan = hand_plan(rests, 3.0, 1.5, 5.0, seed)
    typical = grade(name)
    return simulate(
        plan, model=draw_errors(name, seed), noise=typical.noise, site=SITE, rate=rate, seed=seed
    ).log


def fed(log: Log, pieces: float = 0.2, used: LogDescription = USED) -> tuple[LiveRests, Watchman]:
    """The log in pieces of so many seconds, looked at after each."""
    live = LiveRests()
    watchman = Watchman(live, used)
    step = max(1, round(pieces / log.interval))
    for start in range(0, len(log), step):
        live.add(log[start : start + step])
        watchman.findings()
    return live, watchman


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["mems", "tactical", "navigation"])
@pytest.mark.parametrize(("rate", "pieces", "seed"), [(100, 0.2, 1), (400, 0.05, 2), (50, 3.1, 3)])
def test_rests_are_those_of_the_finished_log(
    name: str, rate: float, pieces: float, seed: int
) -> None:
    log = session(rate, seed=seed, name=name)
    live, _ = fed(log, pieces)
    whole = find_rests(log)
    for _ in range(2):  # as they were found on the way, then decided from everything
        first, last, turns = live.rests()
        assert len(first) == len(whole) == 16
        assert not turns.any()
        assert np.abs(first - whole.first).max() <= whole.window
        assert np.abs(last - whole.last).max() <= whole.window
        live.finish()
    # The running sums begin at other samples: their rounding, relative to the quietest windows
    # (the square of 10 m/s^2 against that of 1e-4 m/s^2), is all that differs.
    assert live.limit == pytest.approx(whole.threshold, rel=1e-6)
    assert np.abs(first - whole.first).max() <= 1
    assert np.abs(last - whole.last).max() <= 1


def test_a_given_threshold_is_kept() -> None:
    log = session()
    live = LiveRests(How(window=0.4, shortest=0.8, threshold=4.0))
    for start in range(0, len(log), 30):
        live.add(log[start : start + 30])
    whole = find_rests(log, How(window=0.4, shortest=0.8, threshold=4.0))
    first, _, _ = live.rests()
    assert np.abs(first - whole.first).max() <= whole.window
    assert live.limit == 4.0


def test_nothing_of_the_future_is_used() -> None:
    """What is said at a moment is the same whatever comes later."""
    log = session()
    part = log[: len(log) // 2]
    whole, half = fed(log)[0], fed(part)[0]
    first, last, _ = half.rests()
    later, _, _ = whole.rests()
    assert np.abs(first - later[: len(first)]).max() <= half.samples
    assert last[-1] <= len(part)


@pytest.mark.thorough
def test_work_is_a_few_ms_per_second_of_data_at_a_thousand_hertz() -> None:
    log = session(1000.0, rests=40)
    fed(log[:2000])  # compile
    start = clock.process_time()
    live, _ = fed(log)
    spent = clock.process_time() - start
    assert len(live.rests()[0]) == 40
    assert spent < 0.03 * log.duration  # about 4 ms/s; the machine may be busy


def test_a_session_step_by_step() -> None:
    log = session()
    live = LiveRests()
    live.add(log[:5])
    assert not live.samples  # too little to know the rate
    live.add(log[5:300])
    seen = checklist(live, hold=4.0)
    assert seen.still is True
    assert seen.still_for == pytest.approx(3.0, abs=0.05)
    assert seen.hold == pytest.approx(1.5, abs=0.05)  # 4 s, half a window at either end apart
    assert [rest.up for rest in seen.rests] == ["+z up"]
    assert (seen.orientations, seen.complete) == (1, False)
    assert "-z up" in seen.missing
    assert "+z up" not in seen.missing
    assert dict(seen.visited)["+z up"]
    assert not dict(seen.visited)["-z up"]
    turn = find_rests(log).last[0] + 75
    live.add(log[300:turn])
    assert checklist(live).still is False
    live.add(log[turn:])
    seen = checklist(live)
    assert seen.complete
    assert seen.orientations == len(seen.rests) == 16
    assert seen.missing == ()


def test_many_rests_alike_are_not_enough() -> None:
    log = session(rests=6)
    again = np.concatenate([log.accel, log.accel, log.accel])
    live, _ = fed(Log(np.arange(len(again)) / 100, np.tile(log.gyro, (3, 1)), again, "rate"))
    seen = checklist(live)
    assert len(seen.rests) >= 16
    assert seen.orientations == 6
    assert not seen.complete


def test_a_log_that_moves_from_the_start_learns_when_it_rests() -> None:
    log = session()
    start = int(find_rests(log).last[0]) + 40  # in the middle of the first turn
    live, _ = fed(log[start:])
    assert len(live.rests()[0]) == len(find_rests(log[start:])) == 15


def codes(log: Log, used: LogDescription = USED) -> set[str]:
    return {item.code for item in fed(log, used=used)[1].findings()}


def test_a_good_session_has_no_warnings() -> None:
    assert codes(session()) == set()


@pytest.mark.thorough
def test_wrong_units_are_told_early() -> None:
    log = session()
    g = replace(log, accel=log.accel / 9.81)[:400]
    assert codes(g) == {"log.accel_unit"}
    assert codes(replace(log, gyro=np.degrees(log.gyro))) >= {"gyro.unit"}
    assert codes(replace(log, gyro=np.radians(log.gyro))) == {"gyro.unit"}


def test_exchanged_axes_are_told_after_six_rests() -> None:
    log = session()
    wrong = replace(log, gyro=log.gyro[:, [1, 0, 2]])
    assert codes(wrong) == {"gyro.left_handed"}
    six = int(find_rests(log).last[4])
    assert codes(wrong[:six]) == set()


@pytest.mark.thorough
def test_gaps_and_saturation_are_told() -> None:
    log = session()
    keep = np.delete(np.arange(len(log)), slice(1000, 1020))
    gap = Log(log.time[keep], log.gyro[keep], log.accel[keep], "rate")
    told = [item for item in fed(gap)[1].findings() if item.code == "log.gap"]
    assert len(told) == 1
    assert "about 20 samples are missing" in told[0].message
    assert "log.saturated" in codes(replace(log, gyro=np.clip(log.gyro, -1.5, 1.5)))


def test_orientation_of_the_first_rest_is_checked() -> None:
    log = session()
    log = replace(log, source={"description": {"accel": {"first_rest": "x up"}}})
    assert codes(log[:450]) == {"accel.orientation"}


def test_an_instrument_never_at_rest_is_told() -> None:
    rng = np.random.default_rng(0)
    n = 1000
    accel = np.array([0, 0, 9.81]) + rng.normal(0, 1.0, (n, 3))
    log = Log(np.arange(n) / 100, rng.normal(0, 0.5, (n, 3)), accel, "rate")
    assert codes(log) == {"watch.not_quiet"}


@pytest.mark.parametrize(("step", "code"), [(0.0, "log.time_repeated"), (-1, "log.time_backward")])
def test_time_that_does_not_run_forward_ends_it(step: float, code: str) -> None:
    log = session()
    time = log.time.copy()
    time[500:] += step - 0.01
    with refuses(code, "500") as problem:
        fed(replace(log, time=time))
    assert "500" in problem.value.message


def test_rows_grow() -> None:
    rows = Rows(2)
    parts = [np.full((n, 2), float(n)) for n in (1, 5000, 3, 20000)]
    for part in parts:
        rows.add(part)
    np.testing.assert_array_equal(rows.all, np.concatenate(parts))
    rows.clear()
    assert len(rows) == 0


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["imu0.log", "imu1.log"])
def test_rests_of_a_real_instrument(name: str) -> None:
    data = Path(os.environ.get("FOUCAULT_DATA", Path(__file__).parents[3] / "shared" / "data"))
    folder = data / "mpu9150_hand_rotated"
    if not folder.is_dir():
        pytest.skip(f"real logs are not there: {folder}")
    used = LogDescription.model_validate(
        {
            "file": name,
            "rate": "100 Hz",
            "accel": {"columns": [0, 1, 2], "unit": "m/s^2"},
            "gyro": {"columns": [3, 4, 5], "unit": "rad/s"},
        }
    )
    log = read(used, folder)
    live, watchman = fed(log, used=used)
    whole = find_rests(log)
    first, last, turns = live.rests()
    assert len(whole) == 22
    assert np.abs(first[~turns] - whole.first).max() <= whole.window
    assert np.abs(last[~turns] - whole.last).max() <= whole.window
    # Knocks that ring for one or two samples: of the finished log the same is said.
    assert [f.code for f in watchman.findings()] == ["log.spikes"]
    assert [f.code for f in without_spikes(log).findings] == ["log.spikes"]
    assert checklist(live).complete


def test_a_row_of_zeros_in_a_rest_does_not_cut_it_while_it_is_recorded() -> None:
    log = session()
    whole = find_rests(log)
    k = int(whole.first[6] + whole.last[6]) // 2
    bad = replace(log, gyro=log.gyro.copy(), accel=log.accel.copy())
    bad.gyro[k] = bad.accel[k] = 0.0
    assert len(find_rests(bad)) == 17
    live, watchman = fed(bad)
    for _ in range(2):
        first, last, _ = live.rests()
        assert len(first) == 16
        assert first[6] < k - 50
        assert last[6] > k + 50
        live.finish()
    (told,) = [f for f in watchman.findings() if f.code == "log.spikes"]
    assert f"the first at {log.time[k]:.9g} s" in told.message


def test_a_spike_while_it_is_recorded_is_counted_once_and_leaves_the_rests() -> None:
    log = session()
    whole = find_rests(log)
    bad = replace(log, gyro=log.gyro.copy())
    rows = (whole.first[[2, 9]] + whole.last[[2, 9]]) // 2
    bad.gyro[rows, 1] += 20 * np.std(log.gyro[whole.first[2] + 30 : whole.last[2] - 30, 1])
    live, watchman = fed(bad)
    live.finish()
    first, last, _ = live.rests()
    np.testing.assert_allclose(first, whole.first, atol=1)
    np.testing.assert_allclose(last, whole.last, atol=1)
    (told,) = watchman.findings()
    assert (told.code, "far from those before and after: 2 (gyro.y)" in told.message) == (
        "log.spikes",
        True,
    )
    clean, _ = fed(log)
    assert clean.spikes == []
