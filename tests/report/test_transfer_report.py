"""The sections of a transfer alignment: what they draw, and that a run folder is enough."""

from __future__ import annotations

import shlex
from dataclasses import replace

import numpy as np
import pytest

from foucault import run_folder
from foucault.models.earth import Site
from foucault.models.rotation import exp
from foucault.procedures import transfer_alignment as procedure
from foucault.procedures.transfer_alignment.settings import NOISE
from foucault.report import html, transfer
from foucault.report.calibration import sections
from foucault.report.page import Code, Facts, Figure, Table
from foucault.units import parse

SITE = Site.at(np.radians(45.0), 100.0)
MINUTE = np.radians(1 / 60)
ALL = (
    transfer.mounting, transfer.done, transfer.delay, transfer.ignored,
    transfer.estimates, transfer.motion,
    transfer.innovations, transfer.bound, transfer.attitude, transfer.handed,
)  # fmt: skip


def calibrated(**chosen):
    settings = procedure.Settings(**chosen)
    made = procedure.simulate(
        procedure.Session(rate=100.0, with_outage=False), settings=settings, noise=NOISE,
        site=SITE, model=procedure.draw_errors("tactical", 3), seed=3,
    )  # fmt: skip
    return procedure.calibrate(made.log, site=SITE, settings=settings, noise=NOISE)


@pytest.fixture(scope="module")
def result():
    return calibrated()


@pytest.fixture(scope="module")
def bounded():
    return calibrated(filter="h_infinity", delay_method="likelihood")


def figures(section):
    return [b for b in section.blocks if isinstance(b, Figure)]


def tables(section):
    return [b for b in section.blocks if isinstance(b, Table)]


def facts(section):
    (block,) = [b for b in section.blocks if isinstance(b, Facts)]
    return dict(block.pairs)


def test_what_was_done(result, bounded):
    said = facts(transfer.done(result))
    messages = result.diagnostics["messages"]
    assert said["messages used"] == f"{messages['used']} of {messages['logged']}"
    passes = len(result.diagnostics["passes"]["values"])
    assert said["filter"] == f"Kalman, 46 states, {passes} passes"
    assert said["sd of a difference"] == "0.05 m/s, 1 arcmin each component"
    assert said["noise of the gyros"] == "0.06 °/√h"
    assert said["mount"] == "rigid"
    value, _, sd = said["delay"].split(" ms")[0].partition(" ± ")
    found = result.coefficients["master.delay"]
    assert float(value) == pytest.approx(1e3 * found.values[0], abs=1e-3)
    assert float(sd) == pytest.approx(1e3 * found.sd[0], rel=0.02)
    assert "gamma" not in said
    said = facts(transfer.done(bounded))
    least = bounded.diagnostics["filter"]["least_gamma"]
    assert f"1.20 times the least, {least:.4g}" in said["gamma"]
    assert said["bound of"] == "every state, in units of its prior"
    assert "starting from the likeliest" in said["delay"]


def test_a_delay_that_is_given_or_left_out_is_said():
    for method, used, words in (("80 ms", 0.08, "80 ms, as given"), ("none", 0.0, "none: ")):
        said = transfer._delay({"method": method, "used": used})
        assert said.startswith(words)


def test_delay_by_every_method_and_what_it_is_worth(bounded):
    section = transfer.delay(bounded)
    methods, parts = tables(section)
    names = ["the result: state of the filter", "likeliest", "what both turned"]
    assert [row[0] for row in methods.rows] == names
    known = bounded.diagnostics["delay"]
    values = [known["used"], known["likelihood"]["value"], known["rate_matching"]["value"]]
    for row, value in zip(methods.rows, values, strict=True):
        assert float(row[1]) == pytest.approx(1e3 * value, abs=1e-3)
    gone, tried = figures(section)
    heading = np.array(gone.data[0]["y"])
    np.testing.assert_allclose(
        heading, np.degrees(bounded.tables["delayed"]["heading"]), rtol=1e-4, atol=1e-9
    )
    assert f"{np.abs(heading).max():.2g}° of heading" in section.lead
    drawn = tried.data[1]
    log_l = bounded.tables["likelihood"]["log_likelihood"]
    np.testing.assert_allclose(sorted(drawn["y"]), np.sort(log_l.max() - log_l)[1:], rtol=1e-4)
    # Straight on, nothing shows the delay.
    assert parts.rows[0][2] != "not seen"
    assert parts.rows[-1][2] == "not seen"


def test_estimates_stand_in_their_bands(result):
    section = transfer.estimates(result)
    assert len(figures(section)) == 5
    gyro = figures(section)[0]
    band, line = gyro.data[0], gyro.data[1]
    unit = np.radians(1 / 3600)
    c = result.coefficients["gyro.bias.x"]
    end = len(line["y"]) - 1
    assert line["y"][end] == pytest.approx(c.values[0] / unit, rel=0.02)
    assert band["y"][end] - line["y"][end] == pytest.approx(2 * c.sd[0] / unit, rel=0.02)
    # Bands are clipped to the figure, and what was known beforehand does not set its scale.
    low, high = gyro.layout["yaxis3"]["range"]
    assert low - 1e-4 < min(band["y"]) < max(band["y"]) < high + 1e-4
    delay = figures(section)[-1]
    low, high = delay.layout["yaxis"]["range"]
    assert low < 1e3 * result.coefficients["master.delay"].values[0] < high
    assert high - low < 20.0


def test_what_each_manoeuvre_shows(result):
    section = transfer.motion(result)
    (table,) = tables(section)
    stretches = result.tables["stretches"]
    assert len(table.rows) == len(stretches["start"])
    at = [c.heading for c in table.columns].index("delay")
    # What is left after each multiplies to what is left after all.
    left = np.prod([float(row[at]) for row in table.rows])
    c = result.coefficients["master.delay"]
    assert np.log(left) == pytest.approx(np.log(c.sd[0] / c.prior_sd[0]), abs=0.8)
    first = next(row for row in table.rows if row[0].startswith("turns"))
    last = table.rows[-1]
    assert last[0] == "straight on"
    assert float(first[at]) < 0.1 < float(last[at])
    curves, path = figures(section)
    assert [t["name"] for t in curves.data] == [
        "gyro bias", "gyro scale", "accel bias", "installation", "delay",
    ]  # fmt: skip
    assert curves.share + path.share == 100
    assert len(curves.layout["shapes"]) == len(table.rows) - 1


def test_many_manoeuvres_are_counted_only(result):
    n = transfer.MOST + 1
    table = {k: np.repeat(v[:1], n) for k, v in result.tables["stretches"].items()}
    many = replace(result, tables=dict(result.tables) | {"stretches": table})
    section = transfer.motion(many)
    assert not tables(section)
    assert f"{n} manoeuvres" in section.lead
    assert transfer.changes(many) == []


def test_innovations_and_nis(result):
    section = transfer.innovations(result)
    velocity, attitude, nis = figures(section)
    table = result.tables["innovations"]
    for figure, of in ((velocity, "velocity"), (attitude, "attitude")):
        assert len(figure.data) == 2 * sum(k.startswith(of) and k.endswith("_sd") for k in table)
    time, ratio, (low, high) = transfer.grouped_nis(result.tables["innovations"])
    assert low < 1 < high
    assert low < ratio.min() < ratio.max() < high
    assert ratio.mean() == pytest.approx(1.0, abs=0.05)
    assert nis.data[0]["x"][0] == pytest.approx(time[0], rel=1e-5)
    spread = result.diagnostics["innovations"]["velocity"]["ratio"]
    assert f"velocity {spread:.3f} times" in section.lead


def test_nis_is_over_what_was_used(result):
    table = dict(result.tables["innovations"])
    table["velocity_east"] = np.where(np.arange(len(table["time"])) % 2, np.nan, 0.0)
    _, whole, _ = transfer.grouped_nis(result.tables["innovations"])
    _, fewer, _ = transfer.grouped_nis(table)
    n = sum(k.endswith("_sd") for k in table)
    np.testing.assert_allclose(fewer, whole * n / (n - 0.5), rtol=0.02)


def test_all_that_lies_far_out_is_drawn():
    must = np.zeros(10_000, bool)
    must[[17, 4444]] = True
    rows = transfer.chosen(must)
    assert {17, 4444} <= set(rows.tolist())
    assert len(rows) < 700


def test_bound_of_an_h_infinity_filter(result, bounded):
    assert transfer.bound(result) is None
    section = transfer.bound(bounded)
    (figure,) = figures(section)
    used = np.array(figure.data[0]["y"])
    np.testing.assert_allclose(used, 1 - bounded.tables["gamma"]["margin"], rtol=1e-5)
    assert np.all((used > 0) & (used < 1))
    assert f"{used.max():.2g}" in section.lead


def test_attitude_and_hand_over(result):
    section = transfer.attitude(result)
    course, sds = figures(section)
    smoothed = result.tables["smoothed"]
    heading = np.array(course.data[0]["y"])
    assert 0 <= heading[0] < 360
    turned = (heading - np.degrees(smoothed["heading"]) + 180) % 360 - 180
    np.testing.assert_allclose(turned, 0, atol=1e-2)
    np.testing.assert_allclose(sds.data[2]["y"], smoothed["phi_up_sd"] / MINUTE, rtol=1e-5)
    (table,) = tables(transfer.handed(result))
    rows = {row[0]: row for row in table.rows}
    state = result.diagnostics["hand_over"]
    sd = np.sqrt(np.diag(state["covariance"]))
    assert float(rows["velocity north"][1]) == pytest.approx(state["velocity"][1], abs=1e-3)
    assert float(rows["velocity north"][3]) == pytest.approx(sd[4], rel=0.05)
    assert float(rows["heading"][1]) == pytest.approx(np.degrees(state["heading"]), abs=1e-4)
    assert float(rows["heading"][3].split()[0]) == pytest.approx(sd[2] / MINUTE, rel=0.05)


def test_times_count_from_the_start_of_the_log(result):
    start = 1754380800.0
    tables_ = {name: {k: np.asarray(v) + start if k in ("time", "start", "end") else v
                      for k, v in table.items()}
               for name, table in result.tables.items()}  # fmt: skip
    d = result.diagnostics
    later = d | {"start": start, "hand_over": d["hand_over"] | {"time": 240.0 + start}}
    stamped = replace(result, tables=tables_, diagnostics=later)
    assert facts(transfer.done(stamped))["time 0"].startswith("1754380800 s of the slave's clock")
    assert "time 0" not in facts(transfer.done(result))
    assert "from 240 s on" in transfer.handed(stamped).lead
    for section in ALL:
        one, other = section(result), section(stamped)
        if one is None or section in (transfer.done, transfer.handed):
            continue
        assert one.lead == other.lead
        for a, b in zip(figures(one), figures(other), strict=True):
            for x, y in zip(a.data, b.data, strict=True):
                np.testing.assert_allclose(x["x"], y["x"], rtol=1e-5, atol=1e-5)
        assert [t.rows for t in tables(one)] == [t.rows for t in tables(other)]


def test_mounting_is_said_as_it_is_used(result):
    section = transfer.mounting(result)
    (table,) = tables(section)
    (code,) = [b for b in section.blocks if isinstance(b, Code)]
    said = {"np": np, "C_nm": np.eye(3)}
    exec(code.text, said)
    mu = result.coefficients["installation"].values
    np.testing.assert_allclose(said["C_ms"], exp(mu), atol=1e-9)  # nominally in its master's axes
    np.testing.assert_allclose(said["C_ns"], said["C_ms"])
    rows = {row[0]: [float(x.replace("−", "-")) for x in row[1:]] for row in table.rows}
    assert rows["heading"][0] == 0.0
    # A rotation about up turns y, forward, to the left: the heading falls.
    assert rows["heading"][1] == pytest.approx(-np.degrees(mu[2]), abs=2e-4)
    assert rows["pitch"][1] == pytest.approx(np.degrees(mu[0]), abs=2e-4)
    assert rows["roll"][1] == pytest.approx(np.degrees(mu[1]), abs=2e-4)


def test_what_ignoring_the_delay_does(result):
    section = transfer.ignored(result)
    drawn = figures(section)
    assert [f.layout["annotations"][0]["text"].split("</b>")[0] for f in drawn] == [
        "<b>gyro bias", "<b>installation",
    ]  # fmt: skip
    (table,) = tables(section)
    rows = {row[0]: row for row in table.rows}
    assert set(rows) == set(result.coefficients.names) - {"master.delay"}
    bias = result.coefficients["accel.bias.y"]
    ours, far = (float(rows["accel.bias.y"][k].replace("−", "-")) for k in (2, 4))
    assert ours == pytest.approx(1e3 * bias.values[0] / 9.80665, abs=2e-3)
    # Flying forward in a turn, 100 ms look like a bias of milli-g.
    assert abs(far - ours) > 1.0
    assert float(rows["accel.bias.y"][6]) > 10


def test_the_command_of_the_hand_over_can_be_copied(result):
    (code,) = [b for b in transfer.handed(result).blocks if isinstance(b, Code)]
    words = shlex.split(code.text)
    assert words[:2] == ["foucault", "navigate"]
    heading = words[words.index("--heading") + 1]
    state = result.diagnostics["hand_over"]
    assert parse(heading, "angle") == pytest.approx(state["heading"], abs=1e-6)
    assert parse(words[words.index("--from") + 1], "time") == pytest.approx(
        state["time"] - result.diagnostics["start"]
    )
    velocity = [parse(v, "velocity") for v in words[words.index("--velocity") + 1].split(", ")]
    assert velocity == pytest.approx(state["velocity"], abs=1e-4)
    sd = np.sqrt(np.diag(state["covariance"])[3:6])
    given = parse(words[words.index("--velocity-sd") + 1], "velocity")
    assert 0.9 * sd.min() < given < 1.1 * sd.max()


def test_nothing_is_shown_that_is_not_there(result):
    bare = replace(result, tables={}, diagnostics={})
    other = replace(result, procedure="systematic")
    own = {section(result).title for section in ALL if section is not transfer.bound}
    assert own <= {section.title for section in sections(result)}
    for less in (bare, other):
        assert not own & {section.title for section in sections(less)}


def test_the_report_is_made_from_the_run_folder(bounded, tmp_path):
    run_folder.save(bounded, tmp_path)
    page = html(run_folder.load_result(tmp_path))
    assert page == html(bounded)
    for title in ("Delay of the messages", "What the motion shows", "Bound of the filter"):
        assert title in page
