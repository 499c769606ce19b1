"""The calibration of a north seeker: exact, and as sure as is promised."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from foucault.coefficients import CoefficientVector
from foucault.diagnose.study import nees
from foucault.errors import Status
from foucault.estimate.north import (
    OnTurntable,
    Rig,
    calibrate_batch,
    names_of,
    tilts,
)
from foucault.estimate.north_reduction import reduce
from foucault.infer import mixed
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.north_seeker import (
    RATE_LEVEL,
    RATE_TILTED,
    SEEKER,
    Compensation,
    attitude,
)
from foucault.models.rotation import exp
from make_dwells import FIELD, QUIET, errors, leaning, level, make_dwells, size
from power import needed

LATITUDE = 0.7
SITE = Site.at(LATITUDE)
TILTED = leaning(8.0, -8.0, 0.0)
ONE_AXIS = names_of("one axis", True, False)
EACH = names_of("each", True, True)


def rig(poses, tilt="one axis", **words):
    accelerometers = words.pop("accelerometers", True)
    # Set-ups on a table that was tilted: its axis is vertical.
    words.setdefault("level_sd", 0.0 if tilt == "each" else np.inf)
    return Rig(poses[:, 0], words.pop("site", SITE), tilt, accelerometers, **words)


def model_of(pairs, table, names, **words):
    return OnTurntable(pairs, table, SEEKER.subset(names), **words)


def fit(pairs, table, names, **words):
    return mixed.fit(model_of(pairs, table, names, **words)).estimate


def solved(poses, instrument, tilt="one axis", names=None, noise=QUIET, **words):
    made = {k: words.pop(k) for k in ("accel", "offset", "seed", "dwell") if k in words}
    said = words.pop("said", poses)
    known = words.pop("known", Compensation())
    added = noise if noise is not QUIET else None
    pairs = reduce(make_dwells(poses, LATITUDE, instrument=instrument, noise=added, **made), noise)
    names = names or (ONE_AXIS if tilt == "one axis" else EACH)
    return fit(pairs, rig(said, tilt, **words), names, known=known)


def compare(found, instrument, rtol=1e-6):
    want = instrument.model.coefficients(found.coefficients.names).values
    scale = np.array([size(n) for n in found.coefficients.names])
    np.testing.assert_allclose(found.coefficients.values / scale, want / scale, atol=rtol)


# -- exact ---------------------------------------------------------------------------------------


def test_all_errors_at_once():
    gyro = errors((*RATE_LEVEL, "accel.bias.x", "accel.bias.y"), seed=3)
    compare(solved(level(), gyro, offset=2e-6), gyro)
    everything = errors(seed=4)
    accel = [n for n in SEEKER.names if n.startswith("accel")]
    held = Compensation(everything.model.coefficients(accel))
    compare(solved(TILTED, everything, "each", known=held, offset=2e-6), everything)
    # Three headings are enough, and two are not.
    compare(solved(level(3), gyro), gyro)
    poor = solved(level(2), gyro)
    assert poor.status is Status.UNOBSERVABLE
    assert poor.weakest


def test_a_table_off_the_vertical_does_not_touch_the_coefficients():
    """The axis leans by 3 arcmin: the accelerometers, which turn with the heading, show it."""
    gyro = errors((*RATE_LEVEL, "accel.bias.x", "accel.bias.y"), seed=5)
    lean = np.radians(3 / 60)
    psi = level()[:, 0]
    # Up, seen from a case on an axis that leans towards east, in headings of that axis.
    up = np.column_stack([-np.sin(lean) * np.cos(psi), -np.sin(lean) * np.sin(psi)])
    pitch = np.arcsin(up[:, 1])
    roll = np.arctan2(-up[:, 0], np.sqrt(1 - np.sum(up**2, axis=1)))
    # East of the case's own level plane stays where it was to second order.
    found = solved(np.column_stack([psi, pitch, roll]), gyro, said=level())
    scale = np.array([size(n) for n in ONE_AXIS])
    off = found.coefficients.values - gyro.model.coefficients(ONE_AXIS).values
    assert np.abs(off / scale).max() < 1e-3
    assert np.linalg.norm(found.state[-2:]) == pytest.approx(lean, rel=1e-4)


def test_a_common_error_of_the_headings_goes_into_the_couplings():
    """Off by d, x takes d of y and y minus d of x; nothing shows it."""
    d = 1e-3
    psi = level()
    found = solved(psi, None, said=psi + np.array([d, 0, 0]))
    c = dict(zip(found.coefficients.names, found.coefficients.values, strict=True))
    # y_b points d to the left of where it was said: its sensing axis is turned.
    assert c["gyro.misalignment.xy"] == pytest.approx(np.sin(d), rel=1e-4)
    assert c["gyro.misalignment.yx"] == pytest.approx(-np.sin(d), rel=1e-4)
    assert abs(c["gyro.scale.x"]) < 1e-6 and abs(c["gyro.bias.x"]) < 1e-12
    assert found.chi_square < 1e-3
    # What was said of it is in the uncertainty of both, fully correlated.
    sure = solved(psi, None)
    with_sd = solved(psi, None, heading_offset_sd=d)
    cov = with_sd.coefficients.cov - sure.coefficients.cov
    xy, yx = (with_sd.coefficients.names.index(f"gyro.misalignment.{a}") for a in ("xy", "yx"))
    assert cov[xy, xy] == pytest.approx(d**2, rel=1e-3)
    assert cov[xy, yx] == pytest.approx(-(d**2), rel=1e-3)


def test_without_accelerometers_the_level_counts():
    gyro = errors(RATE_LEVEL, seed=6)
    words = {"accel": None, "accelerometers": False, "names": names_of("one axis", False, False)}
    compare(solved(level(), gyro, level_sd=1e-4, **words), gyro)
    loose = solved(level(), gyro, level_sd=1e-3, **words).coefficients
    # The axis off by phi acts on the horizontal rate like phi sin L in every heading alike.
    assert loose.sd[loose.names.index("gyro.scale.x")] > 1e-4


def test_the_batch_is_the_single_solution():
    """Level, exact headings, equal noise: the regression of the paper."""
    poses = level()
    sd = FIELD.gyro.white / np.sqrt(60.0)
    rows, singles = [], []
    for seed in range(5):
        gyro = errors(RATE_LEVEL, seed=seed)
        d = make_dwells(poses, LATITUDE, instrument=gyro, accel=None, noise=FIELD, seed=seed,
                        offset=1e-6)  # fmt: skip
        rows.append(d.gyro.reshape(12, 4))
        table = rig(poses, accelerometers=False, level_sd=0.0)
        singles.append(fit(reduce(d, FIELD), table, RATE_LEVEL_ORDER))
    values, cov = calibrate_batch(np.array(rows), poses[:, 0], LATITUDE, sd)
    scale = np.array([size(n) for n in RATE_LEVEL])
    order = [RATE_LEVEL_ORDER.index(n) for n in RATE_LEVEL]
    for k, one in enumerate(singles):
        np.testing.assert_allclose(
            values[k] / scale, one.coefficients.values[order] / scale, atol=1e-6
        )
        mine = one.coefficients.cov[np.ix_(order, order)]
        np.testing.assert_allclose(cov / np.outer(scale, scale), mine / np.outer(scale, scale),
                                   rtol=1e-4, atol=1e-9)  # fmt: skip
    # The textbook: sd of a bias, and of a slope over 12 headings, from half differences.
    w = EARTH_RATE * np.cos(LATITUDE)
    np.testing.assert_allclose(np.sqrt(np.diag(cov))[:2], sd / np.sqrt(2) / np.sqrt(12), rtol=1e-9)
    np.testing.assert_allclose(
        np.sqrt(np.diag(cov))[2:], sd / np.sqrt(2) / np.sqrt(6) / w, rtol=1e-9
    )


RATE_LEVEL_ORDER = tuple(n for n in SEEKER.names if n in RATE_LEVEL)


def test_tilts_are_those_of_the_set_ups():
    ours = errors([n for n in SEEKER.names if n.startswith("accel")], seed=7)
    poses = TILTED + np.array([0.0, 0.0, 0.05])
    pairs = reduce(make_dwells(poses, LATITUDE, instrument=ours), QUIET)
    np.testing.assert_allclose(tilts(pairs, SITE.gravity, ours), poses[:, 1:], atol=1e-9)


@pytest.mark.parametrize("tilt", ["one axis", "each"])
def test_sources_are_the_slopes_of_what_they_are_errors_of(tilt):
    """An error of headings, latitude or accelerometers is what another rig would have predicted."""
    poses = TILTED if tilt == "each" else level()
    names = EACH if tilt == "each" else ONE_AXIS
    pairs = reduce(make_dwells(poses, LATITUDE, instrument=errors(seed=8), noise=FIELD), FIELD)
    own = [n for n in SEEKER.names if n.startswith("accel") and n not in names]
    sds = np.array([size(n) for n in own])

    def said(k=None, heading=0.0, latitude=0.0):
        c = CoefficientVector(SEEKER.subset(own), np.zeros(len(own)), np.diag(sds**2))
        if k is not None:
            c.values[k] += sds[k]
        site = replace(SITE, latitude=LATITUDE + latitude)
        table = rig(poses + np.array([heading, 0, 0]), tilt, site=site, heading_offset_sd=1e-5,
                    latitude_sd=1e-5)  # fmt: skip
        return model_of(pairs, table, names, known=Compensation(c))

    start = 1e-4 * np.random.default_rng(9).standard_normal(len(said().start))
    at = said().linearise(start)
    effect = {s.name: s.sd * s.shared for s in at.sources if s.shared is not None}

    def moved(**words):
        ends = [said(**{k: sign * v for k, v in words.items()}).linearise(start).residuals
                for sign in (1, -1)]  # fmt: skip
        return (ends[1] - ends[0]) / 2

    for name, words in (("common error of the headings", {"heading": 1e-5}),
                        ("latitude", {"latitude": 1e-5})):  # fmt: skip
        want = moved(**words)
        np.testing.assert_allclose(effect[name][..., 0], want, atol=1e-4 * np.abs(want).max())
    for k in range(len(own)):
        want = at.residuals - said(k=k).linearise(start).residuals
        scale = np.abs(effect["tilt: accelerometers"]).max()
        got = effect["tilt: accelerometers"][..., k]
        np.testing.assert_allclose(got, want, atol=2e-3 * scale)


# -- as sure as is promised ----------------------------------------------------------------------


def drawn(seed, *, tilted=False, heading_sd=0.0, offset_sd=0.0, latitude_sd=0.0, claimed=1.0):
    """Error and covariance of one calibration, everything drawn from what is claimed of it."""
    rng = np.random.default_rng([seed, 3])
    gyro = errors(RATE_TILTED if tilted else RATE_LEVEL, seed=seed)
    poses = TILTED if tilted else level()
    said = poses.copy()
    said[:, 0] += offset_sd * rng.standard_normal() + heading_sd * rng.standard_normal(len(poses))
    true = LATITUDE + latitude_sd * rng.standard_normal()
    d = make_dwells(poses, true, instrument=gyro, noise=FIELD, seed=seed, offset=1e-6)
    table = rig(said, "each" if tilted else "one axis", heading_sd=claimed * heading_sd,
                heading_offset_sd=claimed * offset_sd,
                latitude_sd=claimed * latitude_sd)  # fmt: skip
    found = fit(reduce(d, FIELD), table, EACH if tilted else ONE_AXIS)
    assert found.status is Status.CONVERGED
    want = gyro.model.coefficients(found.coefficients.names).values
    return found.coefficients.values - want, found.coefficients.cov, found


UNCERTAIN = {"heading_sd": 3e-4, "offset_sd": 2e-3, "latitude_sd": 5e-3}


@pytest.mark.thorough
@pytest.mark.parametrize("tilted", [False, True])
@pytest.mark.parametrize("said", [{}, UNCERTAIN], ids=["sure", "everything uncertain"])
def test_errors_have_the_size_that_was_promised(tilted, said):
    """A covariance that is 20 % off is found out in 99 % of cases, and noise whose sd is 5 %."""
    runs = [drawn(seed, tilted=tilted, **said) for seed in range(240)]
    errs, covs = (np.array([r[i] for r in runs]) for i in (0, 1))
    assert errs.size >= needed(1.2, tests=8)
    low, high = chi_square_limits(errs.size, tests=8)
    assert low < float(nees(errs, covs).sum()) < high
    low, high = chi_square_limits(sum(r[2].dof for r in runs), tests=8)
    assert low < sum(r[2].chi_square for r in runs) < high


def test_uncertainty_of_the_table_that_is_not_claimed_shows():
    runs = [drawn(seed, **UNCERTAIN, claimed=0.3) for seed in range(20)]
    total = float(nees(np.array([r[0] for r in runs]), np.array([r[1] for r in runs])).sum())
    assert total > chi_square_limits(20 * len(ONE_AXIS), tests=8)[1]


def sources(pairs, table, names=ONE_AXIS):
    model = model_of(pairs, table, names)
    return {s.name: s for s in model.linearise(model.start).sources}


def test_sources_of_the_covariance():
    pairs = reduce(make_dwells(level(), LATITUDE), FIELD)
    plain = sources(pairs, rig(level(), level_sd=0.0))
    assert set(plain) == {"gyro noise", "tilt: noise"}
    assert all(s.noise for s in plain.values())
    loose = sources(pairs, rig(level(), heading_sd=1e-3, level_sd=1e-4, latitude_sd=1e-3))
    assert set(loose) - set(plain) == {"reference headings", "latitude", "level of the table"}
    assert loose["level of the table"].shared is None, "an unknown, with a row of its own"
    blind = rig(level(), level_sd=1e-4, accelerometers=False)
    assert set(sources(pairs, blind)) == {"gyro noise", "level of the table"}
    assert not any(s.noise for name, s in loose.items() if name not in plain)
    w = EARTH_RATE * np.cos(LATITUDE)
    headings = loose["reference headings"]
    diagonal = np.sum((headings.sd * headings.each[:, :2]) ** 2, axis=(1, 2))
    np.testing.assert_allclose(diagonal, (1e-3 * w) ** 2, rtol=1e-6)


def test_the_covariance_of_tilts_is_that_of_the_rates_they_turn():
    pairs = reduce(make_dwells(TILTED, LATITUDE), FIELD)
    table = rig(TILTED, "each")
    S = pairs.sources["tilt: noise"]
    h = 1e-4
    slope = np.zeros((len(pairs), 2, 2))
    for k in range(2):
        ends = []
        for sign in (1.0, -1.0):
            values = pairs.values.copy()
            values[:, 2 + k] += sign * h
            model = model_of(replace(pairs, values=values), table, EACH)
            ends.append(model.linearise(model.start).residuals)
        slope[:, :, k] = (ends[0] - ends[1]) / (2 * h)
    want = np.einsum("mik,mkl,mjl->mij", slope, S[:, 2:, 2:], slope)
    root = sources(pairs, table, EACH)["tilt: noise"].each
    found = root @ np.swapaxes(root, 1, 2)
    np.testing.assert_allclose(found / EARTH_RATE**2, want / EARTH_RATE**2, rtol=1e-3, atol=1e-16)


def leaned(poses, phi):
    """Attitudes of set-ups on a table that leans by phi about East and North."""
    C = attitude(*poses.T) @ exp(-np.array([*phi, 0.0]))
    heading, pitch = np.arctan2(C[:, 1, 0], C[:, 1, 1]), np.arcsin(C[:, 1, 2])
    return np.column_stack([heading, pitch, np.arctan2(-C[:, 0, 2], C[:, 2, 2])])


def test_a_leaning_table_turns_the_headings_of_tilted_cases_together():
    poses = leaning(10.0, -10.0, 0.0) + np.array([0.0, 0.0, 0.05])
    pairs = reduce(make_dwells(poses, LATITUDE), FIELD)
    effect = sources(pairs, rig(poses, "each", level_sd=1e-3), EACH)["level of the table"]
    turned = sources(pairs, rig(poses, "each", heading_offset_sd=1.0), EACH)
    per_heading = turned["common error of the headings"].shared[..., 0]
    for k, phi in enumerate(1e-4 * np.eye(2)):
        moved = (leaned(poses, phi) - leaned(poses, -phi))[:, 0]
        away = (moved + np.pi) % (2 * np.pi) - np.pi
        want = per_heading * away[:, None] / 2e-4
        np.testing.assert_allclose(effect.shared[..., k], want, atol=1e-6 * EARTH_RATE)
