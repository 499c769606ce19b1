"""Trials solved one by one: compiled, in plain Python, on a device, and by dense matrices."""

from __future__ import annotations

import os
import pickle
import runpy
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from numba import cuda as of_numba

import plain_kernels
from commands import run
from foucault import campaign
from foucault.campaign import many, study
from foucault.infer.batched import Jet
from foucault.kernels import trials
from refusals import refuses

N, M, P, TRIALS = 8, 4, 3, 5

MOST, SMALL = 40, 1e-5


def dense(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return J (N, m) and H (m, N, m) of rows that each say something of two or three unknowns."""
    J, H = np.zeros((N, M)), np.zeros((M, N, M))
    for n in range(N):
        some = rng.permutation(M)[: 2 + n % 2]
        J[n, some] = rng.standard_normal(len(some))
        bent = 0.05 * rng.standard_normal((len(some), len(some)))
        H[some[:, None], n, some] = bent + bent.T
    return J, H


def followed(
    J: np.ndarray, H: np.ndarray, d: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return the Jacobian (N, m) and the prediction (N,) at d (m,)."""
    more = np.einsum("k,knm->nm", d, H)
    return J + more, (J + more / 2) @ d


def least_squares(
    J: np.ndarray, H: np.ndarray, y: np.ndarray, S: np.ndarray, d: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
    """Return d, its covariance, what is left of y and whether it settled: `trials.solve`."""
    good = False
    for _ in range(MOST):
        at, h = followed(J, H, d)
        step = np.linalg.solve(at.T @ S @ at, at.T @ S @ (y - h))
        d = d + step
        good = bool(np.abs(step).max() < SMALL)
        if good:
            break
    at, h = followed(J, H, d)
    return d, np.linalg.inv(at.T @ S @ at), y - h, good


def drawn(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return J, H, readings (b, N) and inverse covariances (b, N, N) of some trials."""
    rng = np.random.default_rng(seed)
    J, H = dense(rng)
    truth, e = 0.3 * rng.standard_normal((TRIALS, M)), 0.01 * rng.standard_normal((TRIALS, N))
    y = np.array([followed(J, H, d)[1] for d in truth]) + e
    A = rng.standard_normal((TRIALS, N, N))
    return J, H, y, A @ A.transpose(0, 2, 1) + np.eye(N)


def solved(form, jet: Jet, y: np.ndarray, S: np.ndarray | None, most: int = MOST):
    d, good = np.zeros((len(y), M)), np.zeros(len(y), bool)
    cov, left = np.empty((len(y), P, P)), np.empty_like(y)
    given = np.zeros((1, 1, 1)) if S is None else S
    form(*jet, y, given, S is not None, d, most, SMALL, cov, left, good)
    return d, cov, left, good


@pytest.mark.parametrize("form", ["compiled", "python"])
@pytest.mark.parametrize("spread", [False, True])
def test_a_trial_is_solved_as_by_dense_matrices(form: str, spread: bool) -> None:
    J, H, y, S = drawn(3)
    kernel = plain_kernels.kernel(form, trials, "solve_batch")
    found = solved(kernel, Jet.of(J, H), y, S if spread else None)
    for t in range(TRIALS):
        d, cov, left, good = least_squares(J, H, y[t], S[t] if spread else np.eye(N), np.zeros(M))
        assert good
        assert found[3][t]
        np.testing.assert_allclose(found[0][t], d, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(found[1][t], cov[:P, :P], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(found[2][t], left, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("form", ["compiled", "python"])
def test_readings_are_the_prediction_and_their_errors(form: str) -> None:
    J, H, e, _ = drawn(4)
    d, y = 0.3 * np.random.default_rng(1).standard_normal((TRIALS, M)), np.empty_like(e)
    plain_kernels.kernel(form, trials, "predict_batch")(*Jet.of(J, H), d, e, y)
    np.testing.assert_allclose(
        y, e + np.array([followed(J, H, one)[1] for one in d]), rtol=1e-13, atol=1e-15
    )


def test_what_the_readings_do_not_tell_is_not_a_number() -> None:
    J, H, y, _ = drawn(5)
    J[:, 1], H[1], H[:, :, 1] = J[:, 0], 0.0, 0.0  # two unknowns that only their sum shows
    H[0], H[:, :, 0] = 0.0, 0.0
    d, cov, _, good = solved(trials.solve_batch, Jet.of(J, H), y, None)
    assert not good.any()
    assert np.isnan(d).all()
    assert np.isnan(cov).all()


def test_without_an_iteration_it_stays_where_it_is() -> None:
    J, H, y, _ = drawn(6)
    d, cov, _, good = solved(trials.solve_batch, Jet.of(J, H), y, None, most=0)
    assert not good.any()
    assert (d == 0).all()
    np.testing.assert_allclose(cov[2], np.linalg.inv(J.T @ J)[:P, :P], rtol=1e-10)


# -- on a device ---------------------------------------------------------------------------------

NEAR = 64 * float(np.finfo(float).eps)
"""How far two programs of the same sums may be apart, in sd [1]."""

BLOCKS = """
import pickle, sys
from pathlib import Path
from foucault import campaign
from foucault.campaign import many
blocks = (many.block_of(campaign.parse(campaign.template(name), "campaign.toml"), 5, gpu=True)
          for name in sys.argv[2:])
Path(sys.argv[1]).write_bytes(pickle.dumps([block(range(1)) for block in blocks]))
"""


def simulated(*words: object) -> None:
    """Run Python with these words in Numba's simulator of a device."""
    env = os.environ | {"NUMBA_ENABLE_CUDASIM": "1"}
    done = subprocess.run(
        [sys.executable, "-W", "error", *map(str, words)], env=env, capture_output=True, text=True
    )
    assert done.returncode in (0, 3), done.stdout + done.stderr


def assert_near(ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> None:
    """Compare columns of trials: numbers to a few units in the last place of the sd."""
    assert [*ours] == [*theirs]
    for name, column in ours.items():
        if column.dtype != float:
            assert (column == theirs[name]).all(), name
        else:
            sd = ours.get(name.replace("error.", "sd."))  # an error may be next to nothing
            assert (np.isinf(column) == np.isinf(theirs[name])).all(), name
            other = column != theirs[name]  # of degrees of freedom some are infinite in both
            away = np.abs(column[other] - theirs[name][other])
            assert (away <= NEAR * np.abs(sd[other])).all(), name


def columns(folder: Path) -> dict[str, Any]:
    table = pq.read_table(folder / study.TRIALS_FILE)
    return {name: table[name].to_numpy() for name in table.column_names}


def test_a_device_solves_a_study_as_the_processor_does(tmp_path: Path) -> None:
    words = ("six_position", "-n", "3", "--seed", "5", "--batched")
    device = ("-m", "foucault", "montecarlo", *words, "-o", tmp_path / "device", "--gpu")
    simulated(*device)
    run("montecarlo", *words, "-o", tmp_path / "processor")
    assert_near(columns(tmp_path / "processor"), columns(tmp_path / "device"))
    done = run("montecarlo", *words, "-o", tmp_path / "device")  # goes on as it began
    assert done.exit_code == 1
    assert "batched is not what this one has" in " ".join(done.output.split())


@pytest.mark.thorough
def test_a_device_solves_what_else_has_means(tmp_path: Path) -> None:
    names = ("ferraris", "rate_table", "norm_observation")
    simulated("-c", BLOCKS, tmp_path / "blocks", *names)
    found = pickle.loads((tmp_path / "blocks").read_bytes())
    for name, theirs in zip(names, found, strict=True):
        c = campaign.parse(campaign.template(name), "campaign.toml")
        assert_near(many.block_of(c, 5)(range(1)), theirs)


@pytest.mark.skipif(of_numba.is_available(), reason="there is a device here")
def test_without_a_device_it_is_said_what_to_do(tmp_path: Path) -> None:
    with refuses("study.no_gpu", "driver"):
        many.solver(gpu=True)
    done = run("montecarlo", "six_position", "-n", "4", "-o", tmp_path / "s", "--batched", "--gpu")
    assert done.exit_code == 1
    assert "foucault[cuda]" in done.output
    assert not (tmp_path / "s").exists()


@pytest.mark.thorough
@pytest.mark.skipif(of_numba.is_available(), reason="there is a device here")
def test_the_benchmark_of_a_device_says_that_there_is_none(capsys: pytest.CaptureFixture) -> None:
    script = Path(__file__).parents[2] / "benchmarks" / "gpu.py"
    runpy.run_path(str(script), run_name="read")["main"](4, 1)
    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith("no device: --gpu needs an NVIDIA GPU")
    assert len(said) == 3
    assert all(" processor: " in line for line in said[1:])


@pytest.mark.parametrize("beside", [(), ("--batched", "--local-cluster", "2"),
                                    ("--batched", "--scheduler", "tcp://127.0.0.1:9")])  # fmt: skip
def test_a_device_has_no_part_in_what_else_is_asked(
    beside: tuple[str, ...], tmp_path: Path
) -> None:
    done = run("montecarlo", "six_position", "-n", "4", "-o", tmp_path / "s", "--gpu", *beside)
    assert done.exit_code == 1
    assert "not with --scheduler or --local-cluster" in " ".join(done.output.split())
    assert not (tmp_path / "s").exists()
