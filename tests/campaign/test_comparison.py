"""Comparing results: which they are, when they hold, limits, verdict, and the folder."""

from __future__ import annotations

import csv
import dataclasses
import datetime
import itertools
import json

import numpy as np
import pytest

from foucault import campaign, run_folder
from foucault.campaign import comparison, tolerance
from foucault.campaign.comparison import entries, moment
from make_compare import make_entries, make_results, moved
from refusals import refuses

DEG_H = np.radians(1 / 3600)


@pytest.fixture
def folders(tmp_path):
    """Four calibrations of one instrument in folders."""
    for i, result in enumerate(make_results(4)):
        run_folder.save(result, tmp_path / f"{2024 + i}")
    return [tmp_path / f"{2024 + i}" for i in range(4)]


def drifting(n=4, per_year=12.0):
    return [moved(r, gyro__bias__x=per_year * i) for i, r in enumerate(make_results(n, seed=11))]


@pytest.mark.thorough
def test_the_order_of_the_arguments_does_not_matter(folders):
    wanted = comparison.record(comparison.run(folders)).about
    wanted.pop("provenance")
    for some in itertools.permutations(folders):
        said = comparison.record(comparison.run(some)).about
        said.pop("provenance")
        assert json.dumps(said) == json.dumps(wanted)  # to the last bit


def test_results_say_their_instrument_and_the_date_of_their_computation(folders):
    found = comparison.run(folders)
    assert found.verdict.level == "pass" and len(found.instruments) == 1
    assert found.instruments[0].name == "MTi-28 0180-2214"
    assert [e.label for e in found.entries] == ["2024", "2025", "2026", "2027"]
    assert {e.dated for e in found.entries} == {"computed"}
    assert "compare.computed" in [f.code for f in found.findings]
    assert "has not changed by more than chance explains" in found.verdict.reasons[0]


def test_given_dates_order_the_results(folders):
    read = entries(folders, "2030-01-01,2029-01-01,,2028-01-01T12:00:00+02:00")
    assert [e.label for e in read] == ["2026", "2027", "2025", "2024"]
    assert [e.dated for e in read] == ["computed", "given", "given", "given"]
    assert read[1].time == datetime.datetime(2028, 1, 1, 10, tzinfo=datetime.UTC).timestamp()
    with refuses("compare.dates", "3 dates were given for 4 results"):
        entries(folders, "2030-01-01,,")
    with refuses("compare.date", "'soon' is no date"):
        moment("soon")


def test_a_list_says_folder_date_instrument_and_label(folders):
    file = folders[0].parent / "list.toml"
    file.write_text(
        '[[result]]\nfolder = "2025"\ndate = 2020-02-03\ninstrument = "IMU 7"\nlabel = "new"\n'
        '[[result]]\nfolder = "2024/result.json"\ndate = "2019-02-03"\ninstrument = "IMU 7"\n'
    )
    read = entries([file])
    assert [(e.label, e.instrument, e.dated) for e in read] == [
        ("2024", "IMU 7", "given"), ("new", "IMU 7", "given"),
    ]  # fmt: skip
    for text, words in (
        ("a = 1", "holds no"),
        ("[[result]]\ndate = 2020-01-01", "number 1 has no folder"),
        ('[[result]]\nfolder = "x"\ndaet = "2020-01-01"', "Did you mean 'date'"),
        ('[[result]]\nfolder = "x"\nlabel = 3', "is no text"),
        ("[[result", "list.toml"),
    ):
        file.write_text(text)
        with refuses("compare.list", words):
            entries([file])


def test_without_a_date_the_order_given_counts(tmp_path):
    for i, result in enumerate(make_results(3, instrument={})):
        kept = {k: v for k, v in result.provenance.items() if k != "created"}
        undated = dataclasses.replace(result, provenance=kept)
        run_folder.save(undated, tmp_path / f"r{i}")
    found = comparison.run([tmp_path / "r2", tmp_path / "r0", tmp_path / "r1"])
    assert [e.label for e in found.entries] == ["r2", "r0", "r1"]
    codes = [f.code for f in found.findings]
    assert "compare.undated" in codes and "compare.unnamed" in codes
    assert np.isnan(found.instruments[0].history.courses[0].drift)


def test_a_log_with_dates_says_when_it_was_recorded(tmp_path):
    described = campaign.parse(campaign.template("six_position"))
    runs = []
    for number, day in enumerate((3, 9)):
        file = campaign.save_session(campaign.simulate(described, number), tmp_path / f"{day}")
        log, text = file.parent / "log.csv", file.read_text()
        with log.open() as stream:
            rows = [row for row in csv.reader(stream) if not row[0].startswith("#")]
        start = datetime.datetime(2023, 5, day, 8, tzinfo=datetime.UTC)
        head, *samples = rows
        time = next(k for k, name in enumerate(head) if "time" in name)
        for row in samples:
            row[time] = (start + datetime.timedelta(seconds=float(row[time]))).isoformat()
        with log.open("w", newline="") as stream:
            csv.writer(stream).writerows([["time", *head[1:]], *samples])
        names = ", ".join(f'"{name}"' for name in head[1:4])
        other = ", ".join(f'"{name}"' for name in head[4:7])
        before, _, after = text.partition("[log]")
        rest = after[after.index("\n[") :]
        described_log = (
            '[log]\nfile = "log.csv"\ntime = { column = "time", unit = "iso" }\n'
            f'accel = {{ columns = [{names if "accel" in names else other}], unit = "m/s^2" }}\n'
        )
        file.write_text(before + described_log + rest)
        run_folder.save(campaign.calibrate(file), tmp_path / f"run{day}")
        runs.append(tmp_path / f"run{day}")
    read = entries(runs)
    assert [e.dated for e in read] == ["log", "log"]
    assert read[0].time == pytest.approx(moment("2023-05-03T08:00:00"), abs=60.0)
    (tmp_path / "alone").mkdir()
    (tmp_path / "alone" / "result.json").write_bytes((runs[0] / "result.json").read_bytes())
    alone = entries([tmp_path / "alone", runs[1]])
    assert sorted(e.dated for e in alone) == ["computed", "log"]  # its tables are not there


def test_which_instrument_must_be_clear(tmp_path):
    one, two = make_results(2)
    run_folder.save(one, tmp_path / "a")
    run_folder.save(dataclasses.replace(two, instrument={}), tmp_path / "b")
    with refuses("compare.which", "'b' does not say which instrument"):
        comparison.run([tmp_path / "a", tmp_path / "b"])
    found = comparison.run([tmp_path / "a", tmp_path / "b"], same=True)
    assert [one.name for one in found.instruments] == ["MTi-28 0180-2214"]
    with refuses("compare.one", "1 result was given"):
        comparison.run([tmp_path / "a"])
    with refuses("compare.same_log"):
        comparison.run([tmp_path / "a", tmp_path / "a"])


def test_a_drift_is_named_and_makes_the_verdict_doubtful():
    found = comparison.of(make_entries(drifting()))
    assert found.verdict.level == "doubtful"
    assert found.verdict.reasons[0].startswith("IMU 7 has changed: gyro.bias.x drifts by ")
    assert "per year" in found.verdict.reasons[0]


@pytest.mark.parametrize(
    ("text", "level", "words"),
    [
        ('"gyro.bias" = { change = "1000 deg/h" }', "pass", "has changed, within the tolerance"),
        ('"gyro.bias" = { drift_per_year = "1000 deg/h" }', "pass", "All 3 limits are kept."),
        (
            '"gyro.bias" = { change = "20 deg/h" }',
            "fail",
            "Out of tolerance: change of gyro.bias.x",
        ),
        ('"gyro.bias.x" = { drift_per_year = "8 deg/h" }', "fail", "limit 8 deg/h per year"),
        ('"accel.bias" = "1 g"', "doubtful", "All 3 limits are kept."),  # says nothing of changes
        ('"accel.bias" = "1 ug"', "fail", "Out of tolerance: value of accel.bias.x"),
        ('"accel.bias" = { limit = "1 g", sd = "1 ug" }', "doubtful", "Limit within"),
    ],
)
def test_limits_decide(text, level, words):
    found = comparison.of(make_entries(drifting()), tolerance.parse(text))
    assert found.verdict.level == level
    assert any(words in reason for reason in found.verdict.reasons), found.verdict.reasons


def test_a_limit_within_the_uncertainty_is_left_open():
    results = drifting()
    past = comparison.of(make_entries(results)).instruments[0].history
    k = past.series.names.index("gyro.bias.x")
    largest = max(abs(p.change[k]) for p in past.pairs)
    text = f'"gyro.bias.x" = {{ change = "{(largest + past.pairs[0].sd[k]) / DEG_H} deg/h" }}'
    found = comparison.of(make_entries(results), tolerance.parse(text))
    (decision,) = found.decisions
    assert decision.decision == "undecided" and decision.value == pytest.approx(largest)
    assert found.verdict.level == "doubtful"


def test_a_limit_of_a_drift_without_dates_cannot_be_kept():
    undated = [dataclasses.replace(e, time=float("nan")) for e in make_entries(make_results(3))]
    limits = tolerance.parse('"gyro.bias.x" = { drift_per_year = "8000 deg/h" }')
    found = comparison.of(undated, limits)
    assert [d.decision for d in found.decisions] == ["undecided"]


def test_a_limit_of_what_no_result_has_is_refused():
    limits = tolerance.parse('"accel.quadratic" = "10 ug/g^2"')
    with refuses("tolerance.not_estimated"):
        comparison.of(make_entries(make_results(2)), limits)


def test_longer_names_override_key_by_key():
    limits = tolerance.parse(
        '"gyro.bias" = { limit = "9 deg/h", sd = "1 deg/h", change = "2 deg/h" }\n'
        '"gyro.bias.x" = { drift_per_year = "3 deg/h" }\n"gyro.bias.y" = "5 deg/h"\n'
    )
    names = ("gyro.bias.x", "gyro.bias.y", "accel.bias.x")
    value, sd = limits.limits(names)
    np.testing.assert_allclose(value / DEG_H, [9, 5, np.inf])
    np.testing.assert_allclose(sd / DEG_H, [1, np.inf, np.inf])
    change, drift = limits.changes(names)
    np.testing.assert_allclose(change / DEG_H, [2, 2, np.inf])
    np.testing.assert_allclose(drift / DEG_H, [3, np.inf, np.inf])
    assert limits.as_json()["limits"]["gyro.bias.x"] == pytest.approx({"drift_per_year": 3 * DEG_H})
    with refuses("tolerance.no_limit"):
        tolerance.parse('"gyro.bias" = { change = "2 deg/h", sd = "1 deg/h" }')


def test_several_instruments_are_compared_by_their_latest_results():
    a, b = make_results(2), make_results(2, seed=8)
    found = comparison.of([*make_entries(a, "A"), *make_entries(b, "B")])
    assert [one.name for one in found.instruments] == ["A", "B"]
    np.testing.assert_array_equal(
        found.between.series.values, [a[1].coefficients.values, b[1].coefficients.values]
    )
    assert found.verdict.level == "pass" and len(found.verdict.reasons) == 3
    assert "cannot be told apart" in found.verdict.reasons[2]
    other = [moved(r, accel__bias__x=40.0) for r in b]
    apart = comparison.of([*make_entries(a, "A"), *make_entries(other, "B")])
    assert "differ in 1 of 21 coefficients" in apart.verdict.reasons[2]
    assert "among fewer than 8 none can stand out" in apart.verdict.reasons[2]


def test_an_instrument_unlike_the_others_is_doubtful():
    many = [
        e for i, r in enumerate(make_results(40)) for e in make_entries([r], f"SN{i:02d}")
    ]  # fmt: skip
    odd = dataclasses.replace(many[5], result=moved(many[5].result, gyro__scale__y=200.0))
    found = comparison.of([*many[:5], odd, *many[6:]])
    assert found.verdict.level == "doubtful"
    assert found.verdict.reasons[0].startswith(
        "Unlike the other instruments: SN05: gyro.scale.y (z = +"
    )


def test_results_that_agree_too_well_are_noted():
    results = make_results(6)
    same = [dataclasses.replace(r, coefficients=results[0].coefficients) for r in results]
    found = comparison.of(make_entries(same))
    assert "compare.too_alike" in [f.code for f in found.findings]
    assert found.verdict.level == "pass"


def test_the_folder_is_read_back_and_never_written_over_another(folders, tmp_path):
    record = comparison.record(comparison.run(folders), 0.5)
    about = record.about
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "report.html").write_text("old")
    record.save(tmp_path / "out")
    assert not (tmp_path / "out" / "report.html").exists()
    assert run_folder.read(tmp_path / "out", "comparison").about == json.loads(json.dumps(about))
    assert about["results"][0]["sha256"] and about["provenance"]["versions"]["foucault"]
    with refuses("output.kind", match=r"already holds result\.json"):
        record.save(folders[0])
    (tmp_path / "out" / "compare.json").write_text('{"schema": "foucault.compare/9"}')
    with refuses("result.schema"):
        run_folder.read(tmp_path / "out", "comparison")
