"""The mixed model: against closed forms, brute force, and its own statistics."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import chi2

from foucault.arrays import BoolArray, FloatArray
from foucault.coefficients import CoefficientVector, Layout
from foucault.errors import FoucaultError
from foucault.infer import batched, mixed
from foucault.infer.gauss_newton import student
from foucault.infer.information import information
from foucault.infer.mixed import Linearisation, Source
from foucault.models.imu import LAYOUT

NAMES = ("accel.bias.x", "accel.scale.x")


@dataclass(frozen=True)
class Line:
    """A toy: one axis read at known inputs, in placements that are each off by a little."""

    inputs: FloatArray  # (n,) [m/s^2]
    y: FloatArray  # (n,) [m/s^2]
    group: FloatArray  # (n,) number of the placement
    noise: float  # sd of a reading [m/s^2]
    placement: float | None = None  # sd of a placement; None: to be found [m/s^2]

    @property
    def layout(self) -> Layout:
        return LAYOUT.subset(NAMES)

    @property
    def start(self) -> FloatArray:
        return np.zeros(2)

    @property
    def kinds(self) -> dict[str, BoolArray]:
        return {"readings": np.ones((len(self.y), 1), bool)}

    def linearise(self, state: FloatArray) -> Linearisation:
        J = np.column_stack([np.ones_like(self.inputs), self.inputs])[:, None, :]
        miss = self.y - self.inputs - J[:, 0] @ state[:2]
        placed = (self.group[:, None] == np.unique(self.group))[:, None, :].astype(float)
        return Linearisation(miss[:, None], J, (
            Source("noise", each=np.ones((len(self.y), 1, 1)), sd=self.noise, noise=True),
            Source("placement", shared=placed, sd=self.placement, price=0.0),
        ))  # fmt: skip

    def retract(self, state: FloatArray, step: FloatArray) -> FloatArray:
        return state + step

    def values(self, state: FloatArray) -> FloatArray:
        return state


def drawn(rng: np.random.Generator, placements: int = 12, each: int = 4, sd: float = 2e-3) -> Line:
    group = np.repeat(np.arange(placements), each).astype(float)
    inputs = 9.8 * np.cos(group * 2.4) + 0.1 * rng.standard_normal(len(group))
    noise = 1e-3 * rng.standard_normal(len(group))
    off = sd * rng.standard_normal(placements)[group.astype(int)]
    return Line(inputs, 1.002 * inputs + 0.01 + off + noise, group, 1e-3)


def test_repeatability_of_a_balanced_session_is_that_of_the_analysis_of_variance() -> None:
    rng = np.random.default_rng(1)
    group = np.repeat(np.arange(10.0), 5)
    y = 0.3 + 2e-3 * rng.standard_normal(10)[group.astype(int)] + 1e-3 * rng.standard_normal(50)
    model = replace(drawn(rng), inputs=np.zeros(50), y=y, group=group, noise=1e-3)
    found, dof = mixed.repeatability(model, np.zeros(2), np.ones(50))
    means = y.reshape(10, 5).mean(axis=1)
    assert found["placement"] ** 2 == pytest.approx(means.var(ddof=1) - 1e-6 / 5, rel=1e-3)
    assert 0 < dof["placement"] < 9


@dataclass(frozen=True)
class TwoSizes(Line):
    """What is known of the placements and what is found of them have one name."""

    def linearise(self, state: FloatArray) -> Linearisation:
        at = super().linearise(state)
        return replace(at, sources=(*at.sources, replace(at.sources[1], sd=1e-3)))


@pytest.mark.parametrize("use", [mixed.fit, mixed.solve, mixed.foreseen])
def test_a_source_of_a_known_and_an_unknown_size_is_refused(use) -> None:
    line = drawn(np.random.default_rng(1))
    told = "The source 'placement' stands in the model with a size and without one."
    with pytest.raises(FoucaultError, match=told):
        use(TwoSizes(**vars(line)))


def test_budget_adds_up_and_the_bound_is_the_noise_alone() -> None:
    at = mixed.fit(drawn(np.random.default_rng(2)))
    parts = mixed.budget(at)
    assert set(parts) == {"noise", "placement"}
    np.testing.assert_allclose(sum(parts.values()), np.diag(at.estimate.state_cov), rtol=1e-9)
    problem = mixed.noise_alone(at)
    bound = information(problem.linearise(at.state, np.ones(48)), problem.layout).sd
    assert (bound < at.estimate.coefficients.sd).all()
    J = np.column_stack([np.ones(48), at.model.inputs])
    np.testing.assert_allclose(bound, 1e-3 * np.sqrt(np.diag(np.linalg.inv(J.T @ J))), rtol=1e-9)


@pytest.mark.parametrize("prior", [None, (0.0099, 1e-4)])
def test_held_out_readings_are_predicted_as_if_they_had_not_been_seen(prior) -> None:
    model = replace(drawn(np.random.default_rng(3)), placement=2e-3)
    known = prior and CoefficientVector.prior(model.layout, {"accel.bias.x": prior})
    at = mixed.fit(model, known)
    out = np.array([3, 4, 17])
    found = mixed.held_out(at, [out])
    J = np.column_stack([np.ones(48), model.inputs])
    C = 1e-6 * np.eye(48) + 4e-6 * (model.group[:, None] == model.group)
    kept = np.setdiff1d(np.arange(48), out)
    inverse, y = np.linalg.inv(C[np.ix_(kept, kept)]), model.y - model.inputs
    N = J[kept].T @ inverse @ J[kept]
    b = J[kept].T @ inverse @ y[kept]
    if prior:
        N[0, 0] += prior[1] ** -2
        b[0] += prior[0] / prior[1] ** 2
    x = np.linalg.solve(N, b)
    gain = C[np.ix_(out, kept)] @ inverse  # what readings of one placement share
    left = y[out] - J[out] @ x - gain @ (y[kept] - J[kept] @ x)
    B = J[out] - gain @ J[kept]
    cov = C[np.ix_(out, out)] - gain @ C[np.ix_(kept, out)] + B @ np.linalg.inv(N) @ B.T
    np.testing.assert_allclose(found.error[out, 0], left, rtol=1e-6)
    np.testing.assert_allclose(found.sd[out, 0], np.sqrt(np.diag(cov)), rtol=1e-6)
    assert found.score == pytest.approx(left @ np.linalg.solve(cov, left), rel=1e-6)
    assert (found.count, found.dof, found.scale) == pytest.approx((3, 3.0, 1.0))


def test_parts_that_are_held_out_are_each_judged_by_themselves() -> None:
    model = replace(drawn(np.random.default_rng(8)), placement=2e-3)
    at = mixed.fit(replace(model, y=model.y + np.where(model.group == 3, 0.02, 0.0)))
    parts = [np.flatnonzero(model.group == k) for k in range(12)]
    found = mixed.held_out(at, parts)
    assert found.scores.argmax() == 3 and found.score == pytest.approx(found.scores.sum())
    assert found.counts.tolist() == [4] * 12
    alone = mixed.held_out(at, parts[5:6])
    assert (alone.score, alone.count) == pytest.approx((found.scores[5], 4))


def test_a_part_is_predicted_with_sizes_that_do_not_know_it() -> None:
    model = drawn(np.random.default_rng(8))
    model = replace(model, y=model.y + np.where(model.group == 3, 0.2, 0.0))
    at, part, rest = mixed.fit(model), *(np.flatnonzero((model.group == 3) == k) for k in (1, 0))
    some = replace(
        model, inputs=model.inputs[rest], y=model.y[rest], group=model.group[rest],
    )  # fmt: skip
    sizes, dof = mixed.repeatability(some, np.zeros(2), np.ones(len(rest)))
    found, told = mixed.without(at, part)
    assert told == pytest.approx(dof["placement"], rel=1e-3)
    want = mixed.held_out(mixed.solve(model, sizes), [part])
    assert found.score == pytest.approx(want.score, rel=1e-3)
    assert found.score > 100 * mixed.held_out(at, [part]).score


def test_causes_that_readings_share_are_found_as_unknowns_with_a_prior_are() -> None:
    model = replace(drawn(np.random.default_rng(9)), placement=2e-3)
    found = mixed.causes(mixed.fit(model), "placement")
    A = np.column_stack([np.ones(48), model.inputs, model.group[:, None] == np.arange(12)])
    rows = np.vstack([A / 1e-3, np.eye(14)[2:] / 2e-3])
    want = np.linalg.lstsq(rows, np.append((model.y - model.inputs) / 1e-3, np.zeros(12)))[0]
    np.testing.assert_allclose(found, want[2:], atol=1e-9)
    assert mixed.causes(mixed.fit(model), "noise").size == 0


def test_a_held_out_reading_that_the_others_do_not_determine_is_not_predicted() -> None:
    """Two placements share one input: of the third alone the others say nothing."""
    model = replace(drawn(np.random.default_rng(8), 3, 2), placement=2e-3)
    alone = replace(model, inputs=np.array([1.0, 1.0, 1.0, 1.0, 5.0, 5.0]))
    found = mixed.held_out(mixed.fit(alone), [np.array([4, 5])])
    assert np.isnan(found.error[4:]).all() and np.isinf(found.sd[4:]).all()
    assert found.count == 1  # how much they differ
    parts, at = [np.array([0, 4]), np.array([1])], mixed.fit(model)
    twice, whole = mixed.held_out(at, parts, np.full((6, 1, 1), 2.0)), mixed.held_out(at, parts)
    np.testing.assert_allclose(twice.error, 2 * whole.error)
    np.testing.assert_allclose(twice.sd, 2 * whole.sd)
    assert twice.score == pytest.approx(whole.score) and twice.count == whole.count == 3


@dataclass(frozen=True)
class Tilted(Line):
    """A line whose inputs are turned by an angle that is known beforehand."""

    def linearise(self, state: FloatArray) -> Linearisation:
        at = super().linearise(state)
        J = np.concatenate([at.jacobian, self.inputs[:, None, None] ** 2], axis=2)
        rows = np.zeros((1, 3))
        rows[0, 2] = 1e4
        miss = at.residuals - J[:, :, 2] * state[2]
        known = (np.array([-1e4 * state[2]]), rows)
        return replace(at, residuals=miss, jacobian=J, known=known, known_from=("tilt",))

    @property
    def start(self) -> FloatArray:
        return np.zeros(3)

    def values(self, state: FloatArray) -> FloatArray:
        return state[:2]


def test_what_is_known_of_a_nuisance_is_a_row_of_the_budget() -> None:
    at = mixed.fit(Tilted(**vars(replace(drawn(np.random.default_rng(9)), placement=2e-3))))
    parts = mixed.budget(at)
    assert set(parts) == {"noise", "placement", "tilt"}
    np.testing.assert_allclose(sum(parts.values()), np.diag(at.estimate.state_cov)[:2], rtol=1e-9)


def test_a_model_is_linearised_once_at_a_state() -> None:
    at = mixed.fit(model := drawn(np.random.default_rng(10)))
    seen: list[FloatArray] = []

    class Counting:
        def __getattr__(self, name: str) -> object:
            return getattr(model, name)

        def linearise(self, state: FloatArray) -> Linearisation:
            seen.append(state)
            return model.linearise(state)

    found = mixed.fit(Counting())
    np.testing.assert_array_equal(found.state, at.state)
    assert all(a is not b for a, b in pairwise(seen))
    mixed.noise_alone(found).linearise(found.state, np.ones(48))
    assert sum(state is found.state for state in seen) == 1


def test_what_is_left_out_says_nothing_of_what_it_shares() -> None:
    model = replace(drawn(np.random.default_rng(4)), placement=2e-3)
    whole = mixed.fit(
        replace(model, y=model.y + np.where(np.arange(48) == 7, 0.1, 0.0)), robust=True
    )
    assert whole.outliers.tolist() == [7]
    kept = np.arange(48) != 7
    part = mixed.fit(replace(model, inputs=model.inputs[kept], y=model.y[kept],
                             group=model.group[kept]))  # fmt: skip
    np.testing.assert_allclose(whole.state, part.state, rtol=1e-5)


def test_held_out_parts_scatter_as_foreseen() -> None:
    rng, trials = np.random.default_rng(7), 400
    parts = [np.flatnonzero(np.arange(48) % 5 == k) for k in range(5)]
    found = [mixed.held_out(mixed.fit(replace(drawn(rng), placement=2e-3)), parts)
             for _ in range(trials)]  # fmt: skip
    total = sum(one.score / one.scale for one in found)
    low, high = chi2.ppf([0.005, 0.995], sum(one.dof for one in found))
    assert low < total < high
    assert sum(one.score > one.high for one in found) <= 11  # 1 %: more once in 1000


def test_a_source_that_is_not_there_is_seldom_found() -> None:
    rng, trials = np.random.default_rng(6), 300
    there = sum(
        mixed.repeatability(Priced(**vars(drawn(rng, sd=0.0))), np.zeros(2), np.ones(48))[0][
            "placement"
        ] > 0 for _ in range(trials)
    )  # fmt: skip
    assert there <= 9  # 1 %: more than 9 of 300 once in 1000


class Priced(Line):
    def linearise(self, state: FloatArray) -> Linearisation:
        at = super().linearise(state)
        return replace(at, sources=(at.sources[0], replace(at.sources[1], price=mixed.SIGNIFICANT)))


class Twice(Priced):
    """Nothing tells the priced source from one that is always added."""

    def linearise(self, state: FloatArray) -> Linearisation:
        at = super().linearise(state)
        named = replace(at.sources[1], name="named", price=0.0)
        return replace(at, sources=(*at.sources, named))


def test_what_another_source_explains_as_well_gains_nothing() -> None:
    rng = np.random.default_rng(8)
    for _ in range(5):
        model = Twice(**vars(drawn(rng, placements=30)))
        found, _ = mixed.repeatability(model, np.zeros(2), np.ones(120))
        alone, _ = mixed.repeatability(Line(**vars(model)), np.zeros(2), np.ones(120))
        assert found["placement"] == 0.0
        assert found["named"] == pytest.approx(alone["placement"], rel=1e-3)


@pytest.mark.parametrize("bad", [0, 1, 7])
def test_what_is_off_is_left_out_and_not_what_shares_its_placement(bad) -> None:
    model = replace(drawn(np.random.default_rng(8)), placement=1.0)
    at = mixed.fit(
        replace(model, y=model.y + np.where(np.arange(48) == bad, 0.1, 0.0)), robust=True
    )
    assert at.outliers.tolist() == [bad]
    kept = np.arange(48) != bad
    C = 1e-6 * np.eye(48) + 1.0 * (model.group[:, None] == model.group)
    r = at.at.residuals[:, 0]
    left = r[bad] - C[bad, kept] @ np.linalg.solve(C[np.ix_(kept, kept)], r[kept])
    var = C[bad, bad] - C[bad, kept] @ np.linalg.solve(C[np.ix_(kept, kept)], C[kept, bad])
    assert mixed.norms(at.at, at.covariance)[bad] == pytest.approx(abs(left) / var**0.5, rel=1e-3)


def test_the_likeliest_model_is_the_one_that_it_was_drawn_from() -> None:
    rng = np.random.default_rng(9)
    right = drawn(rng)
    wrong = replace(right, group=rng.permutation(right.group))
    assert mixed.likeliest([wrong, right], np.zeros(2), np.ones(48)) is right


def test_causes_that_readings_share_are_found_and_drawn_to_nothing() -> None:
    model = replace(drawn(np.random.default_rng(10)), placement=2e-3)
    at = mixed.fit(model)
    means = at.at.residuals[:, 0].reshape(12, 4).mean(axis=1)
    want = means * 4e-6 / (4e-6 + 1e-6 / 4)
    np.testing.assert_allclose(mixed.causes(at, "placement"), want, rtol=1e-6)
    assert not mixed.causes(at, "noise").size


def test_noise_that_nobody_knows_is_told_from_much_larger_errors_that_readings_share() -> None:
    rng = np.random.default_rng(11)
    found = [
        mixed.repeatability(Unknown(**vars(drawn(rng, sd=sd)), unit=unit), np.zeros(2), np.ones(48))
        for sd, unit in ((1.0, 1.0), (1.0, 1e-9), (1e-3, 1e6))
    ]
    for (size, dof), unit in zip(found, (1.0, 1e-9, 1e6), strict=True):
        assert size["noise"] * unit == pytest.approx(1e-3, rel=0.3)
        assert dof["noise"] == pytest.approx(36, abs=3)


@dataclass(frozen=True)
class Unknown(Line):
    unit: float = 1.0

    def linearise(self, state: FloatArray) -> Linearisation:
        at = super().linearise(state)
        noise, placed = at.sources
        each = self.unit * np.ones((len(self.y), 1, 1))
        return replace(
            at, sources=(replace(noise, each=each, sd=None, price=0.0), replace(placed, sd=1.0))
        )


def test_what_only_a_prior_tells_has_the_scatter_of_the_readings_in_its_uncertainty() -> None:
    model = drawn(np.random.default_rng(1), placements=16, each=1, sd=5e-3)
    model = replace(model, inputs=np.full(16, 9.8), y=model.y - model.inputs + 9.8)
    prior = CoefficientVector.prior(model.layout, {"accel.scale.x": (0.002, 1e-5)})
    at = mixed.fit(model, prior)
    assert at.estimate.coefficients.cov is not None
    sd = np.hypot(np.hypot(1e-3, at.sds["placement"]) / 4, 9.8e-5)
    assert at.found["placement"] > 3e-3
    assert at.estimate.coefficients.sd[0] == pytest.approx(sd, rel=1e-3)


@pytest.mark.parametrize("size", [0.0, 1.0, 300.0])
def test_sizes_are_those_of_the_largest_likelihood_however_far_from_the_noise(size: float) -> None:
    rng = np.random.default_rng(5)
    for _ in range(40):
        V = {}
        for name, rank in (("a", 20), ("b", 5), ("c", 12)):
            root = rng.standard_normal((40, rank))
            V[name] = root @ root.T * 10.0 ** rng.uniform(-3, 3)
        z = rng.standard_normal(40)
        z += size * np.linalg.cholesky(V["b"] + 1e-9 * np.eye(40)) @ rng.standard_normal(40)
        var, _ = mixed._most_likely(z, V)
        S = np.linalg.inv(np.eye(40) + sum(var[n] * V[n] for n in V))
        for name, v in V.items():
            score = z @ S @ v @ S @ z - np.sum(S * v)
            of = np.sqrt(2 * np.sum((S @ v) * (S @ v).T))  # its sd
            assert abs(score) < 0.05 * of or (var[name] == 0 and score < 0)


@pytest.mark.parametrize("noise", [5e-3, 1e-4, 1e-6])
def test_what_is_left_out_does_not_set_the_size_of_what_is_found(noise: float) -> None:
    rng = np.random.default_rng(11)
    model = Scattered(np.linspace(-9.8, 9.8, 40), np.zeros(40), np.arange(40.0), noise)
    y = model.inputs + noise * rng.standard_normal(40) + rng.standard_normal(40)
    right = mixed.repeatability(replace(model, y=y), np.zeros(2), np.ones(40))[0]["placement"]
    wrong = y + np.where(np.arange(40) == 7, 300.0, 0.0)
    weights = np.where(np.arange(40) == 7, 1e-6, 1.0)
    found = mixed.repeatability(replace(model, y=wrong), np.zeros(2), weights)[0]["placement"]
    assert found == pytest.approx(right, rel=0.1)


class Scattered(Line):
    """Another placement for every reading, of its own."""

    def linearise(self, state: FloatArray) -> Linearisation:
        at = super().linearise(state)
        own = Source("placement", each=np.ones((len(self.y), 1, 1)), sd=None, price=0.0)
        return replace(at, sources=(at.sources[0], replace(own, unexplained=True)))


def test_noise_is_judged_too_where_a_prior_is_needed_to_solve() -> None:
    rng = np.random.default_rng(12)
    model = Scattered(np.full(40, 9.8), 9.8 + 0.1 * rng.standard_normal(40), np.arange(40.0), 0.01)
    known = CoefficientVector.prior(model.layout, {"accel.bias.x": (0.0, 0.1)})
    at = mixed.fit(model, known, robust=True)
    assert at.before["readings"].chi_square > at.before["readings"].high
    assert at.after["readings"].inside
    assert np.isfinite(at.estimate.coefficients.sd).all()


def test_a_size_that_nothing_hides_is_stated_with_students_factor() -> None:
    rng, model = np.random.default_rng(5), drawn(np.random.default_rng(5))
    off = 2e-3 * rng.standard_normal(12)[model.group.astype(int)]
    y = 1.002 * model.inputs + off + 1e-6 * rng.standard_normal(len(off))
    at = mixed.fit(replace(model, y=y, noise=1e-6))
    told = at.found["placement"] * student(at.dof["placement"])
    assert at.sds["placement"] == pytest.approx(told, rel=1e-3)


@dataclass(frozen=True)
class Hidden(Line):
    """The same beside another error of every placement, of a known size, that was not there."""

    beside: float = 5e-3  # its sd [m/s^2]

    def linearise(self, state: FloatArray) -> Linearisation:
        at = super().linearise(state)
        placed = at.sources[1].shared
        return replace(at, sources=(*at.sources, Source("beside", shared=placed, sd=self.beside)))


def test_a_size_that_others_hide_is_not_stated_as_nothing() -> None:
    for seed in range(5):
        at = mixed.fit(Hidden(**vars(drawn(np.random.default_rng(seed), sd=1e-3))))
        assert at.found["placement"] == 0.0
        assert 5e-4 < at.sds["placement"] < 5e-3
        planned = mixed.planned(at.model, {"placement": 0.0})
        assert 1e-3 < planned.sds["placement"] < 5e-3


@pytest.mark.parametrize("placements", [4, 5, 6])
def test_few_contrasts_do_not_make_nothing_of_what_is_hidden(placements: int) -> None:
    """They count for as many as Student's factor takes them for."""
    model = Hidden(**vars(drawn(np.random.default_rng(1), placements=placements, sd=1e-3)))
    stated = mixed.fit(model).sds["placement"]
    assert 1e-3 < stated < 15e-3
    more = Hidden(**vars(drawn(np.random.default_rng(1), placements=placements + 4, sd=1e-3)))
    assert mixed.fit(more).sds["placement"] < stated


@pytest.mark.parametrize("kind", [Line, Hidden])
def test_a_batch_states_sizes_as_one_session_does(kind: type[Line]) -> None:
    model = kind(**vars(drawn(np.random.default_rng(3), sd=1e-3)))
    plan = batched.Plan.of(mixed.planned(model, {"placement": 1e-3}), {"placement": 1e-3})
    z = plan.drawn(50, np.random.default_rng(1)) @ plan.contrasts.T
    stated = plan._sizes(z)[1]["placement"]
    (V,) = (one.V for one in plan.spectra.values())
    for k in range(50):
        likely, _, _ = mixed.priced(z[k], {"placement": V}, {"placement": 0.0})
        var = {"placement": likely["placement"] ** 2}
        alone = mixed.mean_variance("placement", {"placement": V}, var, z[k])
        assert stated[k] == pytest.approx(alone, rel=1e-9) and stated[k] > 0


def test_degrees_of_freedom_are_those_of_the_residuals_that_tell_a_size() -> None:
    """Of 12 placements and two unknowns ten; none where all is known; more where it is a part."""
    one = replace(drawn(np.random.default_rng(2), each=1), noise=1e-9)
    at = mixed.fit(one)
    variance = at.estimate.coefficients.sd**2
    dof = mixed.degrees(variance, mixed.enlarged(at))
    np.testing.assert_allclose(dof, 10.0, rtol=5e-3)
    more = mixed.degrees(2 * variance, mixed.enlarged(at))  # beside as much that is known
    np.testing.assert_allclose(more, 20.0, rtol=5e-3)
    known = mixed.fit(replace(one, placement=2e-3))
    assert (mixed.degrees(variance, mixed.enlarged(known)) == np.inf).all()


def test_a_batch_has_the_degrees_of_freedom_of_one_session() -> None:
    model = drawn(np.random.default_rng(3))
    plan = batched.Plan.of(mixed.planned(model, {"placement": 2e-3}), {"placement": 2e-3})
    e = plan.drawn(5, np.random.default_rng(1))
    solved = plan.solve(np.zeros((5, 2)), e)
    for k in range(5):
        at = mixed.fit(replace(model, y=model.inputs + model.noise * e[k]))
        assert (mixed.enlarged(at) > 0).all()
        np.testing.assert_allclose(solved.more[k], mixed.enlarged(at), rtol=1e-2)
