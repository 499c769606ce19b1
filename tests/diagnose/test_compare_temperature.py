"""Results over temperature are compared at the temperature of the others."""

from __future__ import annotations

import dataclasses

import numpy as np

from foucault.campaign import comparison
from foucault.diagnose.comparable import at_one_temperature
from foucault.models.temperature import TemperatureModel
from make_compare import make_entries, make_results
from refusals import refuses


def over_temperature(result, slope, scatter=0.0):
    """Return a result at 300 K as straight lines from 280 to 320 K."""
    vector, n = result.coefficients, len(result.coefficients)
    weights = np.column_stack([vector.values, np.zeros(n)])
    weights[0, 1] = slope * vector.sd[0]
    cov = np.zeros((2 * n, 2 * n))
    cov[::2, ::2] = vector.cov
    model = TemperatureModel(
        vector.layout, weights, cov, 300.0, 280.0, 320.0, scatter=scatter * vector.sd
    )
    return dataclasses.replace(result, temperature=model)


def warm(result, kelvin):
    return dataclasses.replace(result, validity={"temperature_mean": kelvin})


def test_a_change_with_temperature_is_no_change_in_time():
    one, two = make_results(2)
    there = dataclasses.replace(
        two, coefficients=two.coefficients.with_values(
            {"accel.bias.x": two.coefficients.values[0] + 36 * one.coefficients.sd[0]}
        ),
    )  # fmt: skip
    plain = comparison.of(make_entries([one, warm(there, 312.0)]))
    assert plain.verdict.level == "doubtful"
    found = comparison.of(make_entries([over_temperature(one, 3.0), warm(there, 312.0)]))
    assert found.verdict.level == "pass"
    (said,) = [f for f in found.findings if f.code == "compare.at_temperature"]
    assert "compared at 38.9 °C: run 0." in said.message


def test_what_repeats_badly_is_known_less():
    entries = make_entries(make_results(2))
    entries[0] = dataclasses.replace(entries[0], result=over_temperature(entries[0].result, 0, 2.0))
    taken, _ = at_one_temperature(entries)
    was = entries[0].result.coefficients.sd
    np.testing.assert_allclose(taken[0].result.coefficients.sd, np.sqrt(5) * was)
    assert taken[1] is entries[1]


def test_beyond_its_range_a_function_is_refused():
    one, two = make_results(2)
    with refuses("temperature.asked_outside"):
        comparison.of(make_entries([over_temperature(one, 1.0), warm(two, 330.0)]))
