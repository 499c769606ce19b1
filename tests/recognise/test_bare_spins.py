"""Bare logs of spins: gravity that turns in the accelerometers tells order, signs and unit."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import make_bare as make
from foucault import campaign
from foucault.campaign.recognised import found
from foucault.recognise.reading import recognise
from foucault.tables import Log
from refusals import refuses

HEAD = "t,ax,ay,az,gx,gy,gz"


@cache
def spun(procedure: str) -> make.Columns:
    text = campaign.template(procedure).partition("# [optimise]")[0]
    log = campaign.simulate(campaign.parse(text), 1).simulation.log
    return make.Columns(log.time, log.accel, log.gyro)


def written(folder, c, accel=(1, 2, 3), gyro=(1, 2, 3), head=HEAD, clock=True, form="%.6f"):
    """Write a log whose columns x, y, z are those numbers of the instrument's, - turned round."""

    def taken(x, numbers):
        return np.sign(numbers) * x[:, np.abs(numbers) - 1]

    parts = [c.t] * clock + [taken(c.f, accel), taken(c.w, gyro)]
    head = head if clock else head.partition(",")[2]
    file = folder / "log.csv"
    file.write_text(make.text(head, parts, [form] * (6 + clock)))
    return file


@pytest.mark.parametrize(("accel", "gyro"), [
    ((1, 2, 3), (1, 2, 3)), ((1, 2, 3), (1, -2, 3)), ((-2, 3, 1), (2, 1, 3)),
    ((-2, 3, 1), (-3, -1, -2)),
])  # fmt: skip
def test_spins_about_level_axes_tell_order_and_signs_of_gyros(accel, gyro, tmp_path):
    c = spun("continuous_spin")
    seen = recognise([written(tmp_path, c, accel, gyro)])
    assert not seen.questions
    axes = next(line for line in seen.lines if line.what == "axes")
    assert axes.sure == "sure" and "turns predict gravity" in axes.why
    force, rate, clock, _ = make.off(seen, c_log(c), tmp_path)
    assert max(force, rate) < 2e-3 and clock < 1e-6
    assert found([tmp_path / "log.csv"]).session.procedure == "continuous_spin"


def c_log(c):
    return Log(time=c.t, accel=c.f, gyro=c.w)


@pytest.mark.parametrize("head", [HEAD, ""])
@pytest.mark.parametrize("per", [16.4, 131.0])
def test_spins_tell_the_size_of_counts(per, head, tmp_path):
    c = spun("continuous_spin")
    raw = make.Columns(c.t, c.f, np.round(c.w / make.DEGREE * per))
    seen = recognise([written(tmp_path, raw, head=head)])
    assert not seen.questions
    assert float(seen.log["gyro"]["scale"].split()[0]) == pytest.approx(per, rel=1e-3)
    assert make.off(seen, c_log(c), tmp_path)[1] < 2e-3


def test_spins_about_the_vertical_leave_axes_as_titled_and_say_so(tmp_path):
    held = found([written(tmp_path, spun("rate_table"))])
    axes = next(line for line in held.recognised.lines if line.what == "axes")
    assert axes.sure == "assumed" and "no turns tell" in axes.why
    assert held.session.procedure == "rate_table"


def test_a_rate_table_with_one_axis_turned_round_is_refused_with_the_placements(tmp_path):
    held = found([written(tmp_path, spun("rate_table"), gyro=(1, -2, 3))])
    assert held.session.procedure is None
    with refuses("recognise.no_session", "y up, y down", "turned round"):
        _ = held.campaign


def test_a_rate_table_without_a_clock_asks_for_the_rate(tmp_path):
    seen = recognise([written(tmp_path, spun("rate_table"), clock=False)])
    assert "no time column" in seen.questions[0].what
    seen = recognise([tmp_path / "log.csv"], {"rate": "20 Hz"})
    assert not seen.questions


def test_a_rate_table_without_titles_asks_for_the_gyros(tmp_path):
    c, file = spun("rate_table"), tmp_path / "log.csv"
    mixed = np.column_stack([c.f, c.w])[:, [4, 2, 0, 1, 3, 5]]
    file.write_text(make.text("", [c.t, mixed], ["%.6f"] * 7))
    with refuses("recognise.no_gyros", "no titles", "gyro.columns"):
        recognise([file])
    said = {"accel": {"columns": [3, 4, 2]}, "gyro": {"columns": [5, 1, 6]}}
    assert recognise([file], said).log["gyro"]["columns"] == [5, 1, 6]
    assert "gyro" not in recognise([file], {"accel": said["accel"]}).log


@pytest.mark.parametrize(
    "names", [HEAD, "t_s,a_x_m_s2,a_y_m_s2,a_z_m_s2,w_x_rad_s,w_y_rad_s,w_z_rad_s"]
)
def test_the_rate_of_a_log_that_hardly_rests_is_no_zero_of_its_gyros(names, tmp_path):
    t = np.arange(0.0, 70.0, 0.01)
    turns = ((t > 10) & (t < 65))[:, None]
    w = turns * np.stack([0.8 * np.sin(0.9 * t), 2 + 0.5 * np.sin(0.7 * t), 0.8 * np.cos(t)], 1)
    C = [Rotation.identity()]
    for turn in Rotation.from_rotvec(0.01 * w[:-1]):
        C.append(C[-1] * turn)
    f = 9.81 * Rotation.concatenate(C).as_matrix()[:, 2]
    rng = np.random.default_rng(1)
    c = make.Columns(t, f + 0.01 * rng.normal(size=f.shape), w + 1e-3 * rng.normal(size=f.shape))
    block = recognise([written(tmp_path, c, head=names)]).log["gyro"]
    assert not np.any(block.get("zero", 0.0)) and block["unit"] == "rad/s"
