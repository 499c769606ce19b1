"""Changes of a log of a tumble answered at once: as one more pass over each changed log does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_tumble import session

from foucault.estimate import tumble as estimation
from foucault.estimate.tumble import STATES, look
from foucault.estimate.tumble_answers import Change, Linear
from foucault.kernels.cluster_information import RESIDUAL
from foucault.models.rotation import exp, log


def one_pass(t, prior, at):
    """Return residuals, C_np at the end and the constants with the delay, by a pass over a log."""
    found = look(t, prior, at, rows=True)
    miss, slope = prior.rows(at)
    rows = found.rows[..., RESIDUAL] - found.rows[..., :STATES] @ found.x
    psi = found.out[1][0][:, :STATES] @ found.x - found.out[1][0][:, RESIDUAL]
    C_np = exp(t.w_ie_n * t.dt.sum()).T @ exp(psi) @ found.out[3][0]
    residuals = np.concatenate([rows.ravel(), miss - slope @ found.x])
    return residuals, C_np, (found.x * prior.unit)[3:]


def by_passes(t, prior, at, change):
    """Return how residuals and solution move with a change: half the difference of both signs."""
    (r, C, x), (s, D, y) = (one_pass(change.put(t, sign), prior, at) for sign in (0.5, -0.5))
    return r - s, np.concatenate([log(D.T @ C), x - y])


def changes(t):
    """Return a change of every kind, as large as a size of a term may be."""
    time, e = np.cumsum(t.dt), np.eye(3)
    ramp = (time / time[-1])[:, None]
    return [
        Change(1e-6 * ramp * e[0]),
        Change(1e-6 * t.reading[:, :1] * t.reading[:, 1:2] * e[2]),
        Change(command=1e-9 * ramp * e[1]),
        Change(command=1e-5 * t.command * t.reading[:, :1] * e[2]),
        Change(1e-6 * ramp * e[1], 1e-9 * ramp * e[0], 1e-4),
        Change(late=1e-3),
    ]


def made(kind):
    """Return a tumble, its prior and a state near its solution."""
    t, prior, *_ = session(block=5, sampled="increment" if kind == "mean" else "rate")
    if kind == "gap":  # for longer than an average, and at the end
        t.used[3000:3021] = t.used[-3:] = False
    if kind == "neighbours":
        t = replace(t, shared=-0.2)
    if kind == "every":
        t = replace(t, block=1)
    if kind == "delay":
        prior = replace(prior, sd=np.append(prior.sd[:45], 0.01))
    if kind == "uneven":
        t = replace(t, block=7)
    return t, prior, estimation.solve(t, prior).start


@pytest.mark.parametrize("kind", ["ends", "mean", "gap", "neighbours", "every", "delay", "uneven"])
def test_every_change_is_answered_as_by_a_pass_of_its_own(kind):
    t, prior, at = made(kind)
    some = changes(t)
    linear = Linear(t, prior, at)
    E, A = linear.answers(some)
    np.testing.assert_allclose(linear.residuals, one_pass(t, prior, at)[0], atol=1e-9)
    sd = np.sqrt(np.diag(linear.found.cov)) * prior.unit
    sd[:3], sd[sd == 0] = sd[:3].max(), 1.0
    # Slopes are taken at the middle of an average, in which the cluster turns by a degree, and
    # in the last case the command steps.
    near = 1e-2 if kind == "uneven" else 5e-4
    for j, change in enumerate(some):
        residuals, moved = by_passes(t, prior, at, change)
        off = np.linalg.norm(E[:, j] - residuals) / np.linalg.norm(residuals)
        assert off < near, j
        np.testing.assert_allclose(
            A[:, j] / sd, moved / sd, rtol=2e-3, atol=1e-3 * np.abs(moved / sd).max()
        )


def test_what_is_answered_adds_up():
    t, prior, at = made("ends")
    first, second = changes(t)[1], changes(t)[3]
    both = Change(first.reading, 2 * second.command, 1e-3)
    E, A = Linear(t, prior, at).answers([first, second, Change(late=1e-3), both])
    for x in (E, A):
        np.testing.assert_allclose(x[:, 0] + 2 * x[:, 1] + x[:, 2], x[:, 3], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("shared", [0.0, -0.2])
def test_what_stays_is_answered_as_the_change_of_the_log_that_it_is(shared):
    t, prior, at = made("every")
    linear, row = Linear(replace(t, shared=shared), prior, at), 1000
    begins = np.cumsum(t.dt)[:, None] > linear.found.out[10][row - 1] + 1e-9
    log = [Change(command=1e-9 * begins * np.eye(3)[1]), Change(1e-6 * begins * np.eye(3)[1])]
    E, _ = linear.answers(log)
    white, shifts = linear.white(None), linear.shifts(np.array([row]))
    for e, kind, size in zip(E.T, ("drift", "biases"), (1e-9, 1e-6), strict=True):
        own, pull = white.told(size * shifts[kind])
        np.testing.assert_allclose(own[0, 1, 1], e @ e, rtol=1e-4)
        np.testing.assert_allclose(pull[0, 1], e @ linear.residuals, atol=1e-4 * np.sqrt(e @ e))


def test_what_the_fit_absorbs_is_not_told():
    t, prior, at = made("ends")
    linear = Linear(t, prior, at)
    own, pull = linear.white(None).told(linear.shifts(np.array([0, 200]))["drift"])
    size = np.sqrt(np.einsum("kii->ki", own))
    assert (np.abs(pull[0]) < 1e-3 * size[0]).all() and (np.abs(pull[1]) > 1e-3 * size[1]).any()
