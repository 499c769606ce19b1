"""One rule for gaps: stamps that are rounded or late are none, wherever gaps are looked for."""

from types import SimpleNamespace

import numpy as np
import pytest

from foucault.detect.dwells import _cut
from foucault.diagnose.allan import _even
from foucault.diagnose.live import inspect
from foucault.errors import FoucaultError
from foucault.estimate.tumble import apart
from foucault.guard.rest import check_sequence
from foucault.logs import LogDescription
from foucault.logs.follow import RowFollower
from foucault.logs.merged import within
from foucault.models.earth import Site
from foucault.models.transfer import MasterTable
from foucault.procedures.delay import _of_log
from foucault.tables import IndexedLog, Log, gaps, usual_step

G = 9.80665
EVEN = np.arange(4000) / 700.0
LATE = np.random.default_rng(3).random(4000) < 0.02

STAMPS = {
    "rounded": np.round(EVEN, 3),  # steps of 1 and 2 ms, of which the median is 1
    "rounded to 10 ms": np.round(np.arange(4000) / 70.0, 2),
    "late": EVEN + 1e-3 * LATE,  # made good by the next
    "jitter": EVEN + np.random.default_rng(4).uniform(0, 0.5e-3, 4000),
}


@pytest.fixture(params=STAMPS, ids=[name.replace(" ", "_") for name in STAMPS])
def time(request):
    return STAMPS[request.param]


def log_at(time):
    noise = 1e-3 * np.random.default_rng(1).standard_normal((len(time), 6))
    return Log(time, noise[:, :3], np.array([0.0, 0.0, G]) + noise[:, 3:], "increment")


def with_gap(time):
    return np.delete(time, np.arange(2000, 2020))


def test_the_rule(time):
    assert not gaps(np.diff(time)).any()
    assert gaps(np.diff(with_gap(time))).sum() == 1


@pytest.mark.parametrize("rate", [300, 450, 700, 800, 900, 950, 1000])
def test_rounded_stamps_have_the_rate_of_their_samples(rate):
    stamps = np.round(np.arange(4000) / rate, 3)
    assert not gaps(np.diff(stamps)).any()
    assert 1 / usual_step(np.diff(stamps)) == pytest.approx(rate, rel=1e-3)


def test_samples_lost_here_and_there_are_gaps():
    stamps = np.arange(4000) / 1000.0
    for part in (0.002, 0.02, 0.1, 0.2):
        kept = stamps[np.random.default_rng(6).random(4000) >= part]
        step = np.diff(kept)
        assert (gaps(step) == (step > 1.5e-3)).all()
        assert usual_step(step) == pytest.approx(1e-3, rel=1e-9)


def test_inspection(time):
    assert inspect(log_at(time)).gaps == 0
    assert inspect(log_at(with_gap(time))).gaps == 1


def test_noise_is_measured_over_the_whole_log():
    for name in ("rounded", "rounded to 10 ms"):
        log = log_at(STAMPS[name])
        whole, found = _even(log)
        assert whole is log and not found
        part, found = _even(log_at(with_gap(STAMPS[name])))
        assert len(part) == 2000 and [f.code for f in found] == ["allan.gap"]


def test_rows_that_are_followed(time):
    """Increments over the usual interval where a gap is; over their own elsewhere."""
    words = {
        "file": "rows", "time": {"column": 0, "unit": "s"},
        "gyro": {"columns": [1, 2, 3], "unit": "rad", "kind": "increment"},
        "accel": {"columns": [4, 5, 6], "unit": "m/s", "kind": "increment"},
    }  # fmt: skip
    t = with_gap(time)
    step = np.diff(t, prepend=np.nan)
    usual = usual_step(step[1:])
    follower = RowFollower(LogDescription.model_validate(words), 7)
    rows = np.column_stack([t, np.full((len(t), 6), usual)])
    got = np.concatenate([follower.take(part).accel[:, 0] for part in np.array_split(rows, 5)])
    own = usual / step[1:]
    away = np.ones(len(own), bool)
    away[1999] = False  # the gap
    assert np.isclose(got[1:], own)[away].mean() > 0.998  # a block may end with a late stamp
    assert got[2000] == pytest.approx(1.0, rel=2e-2)


def test_two_files_on_one_clock(time):
    """The slower one at half the rate reads the faster one everywhere but at the gap."""
    usual = usual_step(np.diff(time))
    grid = time[0] + usual * (1 + 2 * np.arange(1900))
    assert within(grid, usual * 1.05, time)[5:-5].all()
    missing = ~within(grid, usual * 1.05, with_gap(time))[5:-5]
    assert 8 <= missing.sum() <= 13


def test_dwells(time):
    n = len(time)
    log = IndexedLog(time, np.zeros(n), np.zeros(n), None, np.zeros(n, int), ("one",))
    cuts, _ = _cut(log, 0, n, 0.0, 0.1)
    assert [(c.first, c.last) for c in cuts] == [(0, n)]


def test_messages_of_a_master(time):
    n = len(time)
    table = MasterTable(time, np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1)))
    assert table._gaps("m.csv") == ()
    k = n - 20
    table = MasterTable(with_gap(time), np.zeros((k, 3)), np.tile(np.eye(3), (k, 1, 1)))
    (found,) = table._gaps("m.csv")
    assert found.code == "master.gaps" and "20" in found.message


def test_a_sequence_on_a_table(time):
    rests = SimpleNamespace(spans=[])  # none is bridged
    found = SimpleNamespace(accel=np.array([[0, 0, 1.0], [0, 1.0, 0]]), rests=rests)
    site = Site(gravity=G, latitude=0.8)
    for t, gap in ((time, False), (with_gap(time), True)):
        with pytest.raises(FoucaultError) as ended:
            check_sequence(log_at(t), found, site)
        assert (ended.value.code == "systematic.gap") == gap


def test_attitudes_of_a_second_log(time):
    assert np.isfinite(_of_log(log_at(time), "second").C_nb).all()
    assert np.isnan(_of_log(log_at(with_gap(time)), "second").C_nb).any()


def test_what_neighbours_share_in_a_tumble(time):
    t = np.sort(time[:400])
    white = np.ones((400, 1, 1))
    out = apart(white, t, 0.4)[:, 0, 0]
    assert out[0] == 1.0 and not (out[1:] == 1.0).any()
    out = apart(white, np.concatenate([t[:200], t[200:] + 100 * (t[1] - t[0])]), 0.4)[:, 0, 0]
    assert np.flatnonzero(out == 1.0).tolist() == [0, 200]


def test_stamps_that_are_anything_are_no_rounded_clock():
    step = np.concatenate([np.full(40, 1e-3), np.full(41, 0.9)])
    for some in (step, step[::-1], np.zeros(0), np.full(3, 0.01), np.full(40, 1e12)):
        assert gaps(some).shape == some.shape
