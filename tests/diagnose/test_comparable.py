"""Which results can be compared, and of what: axes, models, logs and gravity that they share."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from foucault.coefficients import CoefficientVector
from foucault.diagnose.comparable import comparable
from foucault.models.imu import LAYOUT, Gauge, ImuModel
from foucault.models.layouts import gravity_slope
from foucault.result import Level
from make_compare import make_entries, make_results
from refusals import refuses
from sessions import codes


def changed(result, **changes):
    return dataclasses.replace(result, **changes)


def with_vector(result, **changes):
    vector = dataclasses.replace(result.coefficients, **changes)
    return changed(result, coefficients=vector)


def upper(result):
    """Return a result in the other gauge, its covariance turned by finite differences."""
    vector = result.coefficients
    names = [n for n in LAYOUT.names if n in vector.layout or n.startswith("accel.misalignment")]
    names = [n for n in names if n not in ("accel.misalignment.yx", "accel.misalignment.zx",
                                           "accel.misalignment.zy")]  # fmt: skip

    def turned(x):
        model = ImuModel.from_coefficients(CoefficientVector(vector.layout, x))
        return model.in_gauge(Gauge.UPPER)[0].coefficients(names).values

    x, h = vector.values, 1e-6
    J = np.stack([(turned(x + h * e) - turned(x - h * e)) / (2 * h) for e in np.eye(len(x))], 1)
    there = CoefficientVector(LAYOUT.subset(names), turned(x), J @ vector.cov @ J.T)
    return changed(result, coefficients=there, gauge=Gauge.UPPER.value)


def test_results_in_the_other_gauge_are_turned_with_their_covariance():
    one, two = make_results(2)
    direct = comparable(make_entries([one, two]))
    turned = comparable(make_entries([one, upper(two)]))
    assert "compare.turned" in codes(turned)
    assert turned.layout.names == direct.layout.names
    np.testing.assert_allclose(turned.series.values, direct.series.values, atol=1e-12)
    np.testing.assert_allclose(turned.series.sd, direct.series.sd, rtol=1e-5)
    scaled = direct.series.sd[1]
    np.testing.assert_allclose(
        turned.series.cov[1] / np.outer(scaled, scaled),
        direct.series.cov[1] / np.outer(scaled, scaled), atol=1e-5,
    )  # fmt: skip


def test_in_axes_of_a_rig_only_what_no_axes_change_is_compared():
    one, two = make_results(2)
    found = comparable(make_entries([one, changed(two, gauge="axes of the rig")]))
    assert "compare.gauge" in codes(found)
    assert [n.rpartition(".")[0] for n in found.layout.names] == ["accel.bias"] * 3 + [
        "gyro.bias"
    ] * 3


def test_what_only_some_have_or_held_or_do_not_know_is_left_out_and_said():
    one, two = make_results(2)
    few = changed(two, coefficients=two.coefficients.chosen(two.coefficients.names[:-2]))
    found = comparable(make_entries([one, few]))
    assert "compare.only_some" in codes(found) and len(found.layout) == 19
    free = np.ones(21, bool)
    free[3] = False
    found = comparable(make_entries([one, with_vector(two, free=free)]))
    assert "compare.held" in codes(found) and "accel.scale.x" not in found.layout
    cov = two.coefficients.cov.copy()
    cov[4], cov[:, 4] = np.nan, np.nan
    found = comparable(make_entries([one, with_vector(two, cov=cov)]))
    assert "compare.no_sd" in codes(found) and "accel.scale.y" not in found.layout
    with refuses("compare.nothing"):
        comparable(make_entries([one, with_vector(two, cov=None)]))


def test_coefficients_that_follow_from_others_tell_nothing_of_their_own():
    one, two = make_results(2)
    both = []
    for result in (one, two):
        vector = result.coefficients
        T = np.eye(21)
        T[20] = 0.0
        T[20, [18, 19]] = 0.4, -0.7  # the last is made of two others
        both.append(with_vector(result, values=T @ vector.values, cov=T @ vector.cov @ T.T))
    found = comparable(make_entries(both))
    assert found.layout.names == one.coefficients.names[:20]


def test_the_same_local_gravity_is_no_independent_error():
    results = []
    for result in make_results(2):
        slope = gravity_slope(result.coefficients) * 1e-2
        vector = dataclasses.replace(
            result.coefficients, cov=result.coefficients.cov + np.outer(slope, slope)
        )
        site = result.site | {"gravity_sd": 1e-2 * result.site["gravity"]}
        results.append(changed(result, coefficients=vector, site=site))
    found = comparable(make_entries(results))
    assert "compare.gravity" in codes(found) and found.series.shared.shape == (2, 21, 1)
    assert found.series.shared[0, 3, 0] == pytest.approx(
        -1e-2 * (1 + results[0].coefficients.value("accel.scale.x"))
    )
    away = changed(results[1], site=results[1].site | {"latitude": 0.1})
    apart = comparable(make_entries([results[0], away]))
    assert "compare.gravity" not in codes(apart) and apart.series.shared.shape == (2, 21, 0)


def test_what_else_is_worth_a_word():
    one, two = make_results(2)
    warm = [changed(r, validity={"temperature_mean": 293.0 + 9 * i})
            for i, r in enumerate((one, two))]  # fmt: skip
    assert "compare.temperature" in codes(comparable(make_entries(warm)))
    verdict = dataclasses.replace(two.verdict, level=Level.UNUSABLE)
    assert "compare.unusable" in codes(
        comparable(make_entries([one, changed(two, verdict=verdict)]))
    )
    leaning = [with_vector(r, prior_sd=1.5 * r.coefficients.sd) for r in (one, two)]
    assert "compare.prior" in codes(comparable(make_entries(leaning)))
    assert set(codes(comparable(make_entries([one, two])))) <= {"compare.gravity"}


def test_results_that_are_not_independent_are_refused():
    one, two = make_results(2)
    log = {"inputs": [], "input": one.provenance["inputs"][0]}
    again = changed(two, provenance=two.provenance | log)
    with refuses("compare.same_log", "same log"):
        comparable(make_entries([one, again]))
    entries = make_entries([one, two])
    with refuses("compare.same_log"):
        comparable([entries[0], dataclasses.replace(entries[1], sha256=entries[0].sha256)])
    leans = changed(two, provenance=two.provenance | {"prior": {"sha256": entries[0].sha256}})
    with refuses("compare.took_prior", "'run 1' took 'run 0', or a result"):
        comparable([entries[0], dataclasses.replace(entries[1], result=leans)])
    inputs = {"sha256": "e" * 64, "inputs": one.provenance["inputs"]}  # another result of its log
    leans = changed(two, provenance=two.provenance | {"prior": inputs})
    with refuses("compare.took_prior"):
        comparable([dataclasses.replace(entries[1], result=leans), entries[0]])
    prior = {"prior": {"from": "factory", "sha256": "f" * 64}}
    both = [changed(r, provenance=r.provenance | prior) for r in (one, two)]
    with refuses("compare.same_prior", "same earlier result"):
        comparable(make_entries(both))


def test_other_instruments_and_broken_numbers_are_refused():
    one, two = make_results(2)
    values = two.coefficients.values.copy()
    values[5] = np.nan
    with refuses("compare.not_finite"):
        comparable(make_entries([one, with_vector(two, values=values)]))
    from foucault.models.cluster import LAYOUT as CLUSTER

    cluster = changed(two, coefficients=CoefficientVector.zeros(CLUSTER))
    with refuses("compare.models", "torqued cluster"):
        comparable(make_entries([one, cluster]))
