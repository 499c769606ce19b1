"""Monte Carlo studies that draw what a session says instead of its samples.

A study of `foucault.campaign.study` simulates every sample, detects the rests and calibrates as a
user's log is calibrated. Here only the first session is simulated; trials then draw the instrument,
the noise of the readings and every source of error that the model of the procedure names, and are
solved many at once by `foucault.infer.batched`. The folder is the same, its trials too but for
their seeds, which are those of whole blocks, and for verdicts, which take a log.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np

from foucault import monte_carlo, procedures
from foucault.arrays import FloatArray
from foucault.campaign import earlier, optimisation, study
from foucault.campaign.reading import Campaign
from foucault.campaign.running import given_errors
from foucault.campaign.study import Columns, Progress, silent
from foucault.diagnose.study import Study, nees
from foucault.errors import Status, error, library
from foucault.infer import mixed
from foucault.infer.batched import Plan, Solver
from foucault.kernels import trials
from foucault.models.noise import grade
from foucault.procedures.record import Procedure

JUDGED = "not judged"
"""Verdict of a trial without a log."""


@dataclass(frozen=True)
class Block:
    """A block of trials of a planned session."""

    plan: Plan
    names: tuple[str, ...]  # that are kept
    campaign: Campaign  # class of its instruments, and what [simulate] sets of them
    beside: FloatArray  # (p, k) what a reference that all trials share makes of them [SI]
    seed: int  # of the study [1]
    gpu: bool = False  # whether trials are solved there

    def __call__(self, numbers: range) -> Columns:
        """Draw and solve the trials of these numbers [1]."""
        count = len(numbers)
        seeds = np.random.SeedSequence(self.seed, spawn_key=(numbers.start, 1))
        of_errors, of_beside, of_readings = map(np.random.default_rng, seeds.spawn(3))
        truth = instruments(self.campaign, self.plan.names, count, of_errors)
        solved = self.plan.solve(truth, self.plan.drawn(count, of_readings), solver(self.gpu))
        off = of_beside.standard_normal((count, self.beside.shape[1])) @ self.beside.T
        at = [self.plan.names.index(name) for name in self.names]
        err = (solved.error + off)[:, at]
        cov = (solved.cov + self.beside @ self.beside.T)[:, at][:, :, at]
        sd = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
        dof = mixed.degrees(sd**2, solved.more[:, at])
        good = solved.converged & np.isfinite(err).all(axis=1)
        ended = np.where(good, str(Status.CONVERGED), str(Status.NOT_CONVERGED))
        out: Columns = {
            "trial": np.arange(numbers.start, numbers.stop), "status": ended,
            "verdict": np.full(count, JUDGED), "nees": np.where(good, nees(err, cov), np.nan),
        }  # fmt: skip
        for key, rows in (("error", err), ("sd", sd), ("dof", dof), ("bound", solved.bound[:, at])):
            out |= {f"{key}.{name}": rows[:, k] for k, name in enumerate(self.names)}
        return out


def solver(gpu: bool) -> Solver:
    """Return what solves trials: on the processor, or on a device of CUDA."""
    if not gpu:
        return cast("Solver", trials.solve_batch)
    with library("study.no_gpu"):  # a Numba may have left it to numba-cuda
        from foucault.kernels import cuda
    if reason := cuda.missing():
        raise error("study.no_gpu", reason=reason)
    return cuda.solve_batch


def block_of(campaign: Campaign, seed: int, gpu: bool = False) -> Block:
    """Plan the session of a campaign for many trials.

    `seed`: of the study [1]; `gpu`: whether they are to be solved there.
    """
    solver(gpu)  # before anything is begun
    procedure = procedures.load(campaign.procedure)
    known, _ = optimisation.beforehand(campaign)
    # As trials with logs: where nothing is declared, instruments hold the model alone.
    known = replace(known, sizes=campaign.sizes or None)
    with procedures.solvable():
        planned = procedure.planned(known, measured=True)
        true = planned if known.noise is not None else procedure.planned(known)
    if planned is None:
        raise error("study.not_batched", procedure=campaign.procedure)
    layout = planned.model.layout
    others = set(campaign.simulate.errors) - set(layout.names)
    if others:
        raise error("study.other_errors", names=", ".join(sorted(others)))
    shared = np.array(planned.found.coefficients.cov)
    shared = shared - planned.fit.estimate.state_cov[: len(layout), : len(layout)]
    size, axes = np.linalg.eigh(shared)
    beside = axes * np.sqrt(np.maximum(size, 0.0))
    beside = beside[:, size > 1e-9 * max(float(size.max()), 1e-300)]
    assert true is not None
    plan = Plan.of(planned.fit, planned.true, true.fit.at.sources)
    return Block(plan, study.names_of(campaign), campaign, beside, seed, gpu)


def instruments(
    campaign: Campaign, names: Sequence[str], count: int, rng: np.random.Generator
) -> FloatArray:
    """Draw coefficients of instruments, shape (count, p) [SI]; `count`: how many [1]."""
    procedure, wanted = procedures.load(campaign.procedure), campaign.simulate.grade
    if procedure.draw_errors is Procedure.draw_errors:
        spread = grade(wanted, "simulate.grade").spread
        sd = [spread.get(name.rpartition(".")[0], 0.0) for name in names]
        out = np.array(sd) * rng.standard_normal((count, len(names)))
    else:
        seeds = rng.integers(2**31, size=count).tolist()
        drawn = (procedure.draw_errors(wanted, seed).coefficients() for seed in seeds)
        out = np.array([one.chosen(names).values for one in drawn])
    said = given_errors(campaign, procedure.layout)
    at = [names.index(name) for name in said]
    out[:, at] = [*said.values()]
    return out


def run(
    campaign: Campaign,
    n: int,
    folder: str | Path,
    *,
    seed: int = 0,
    map: monte_carlo.Map | None = None,
    workers: int = 2,
    progress: Progress = silent,
    gpu: bool = False,
) -> Study:
    """Run a study, or the rest of one; arguments as of `study.run`.

    `n`: number of trials [1]; `seed`: seed of the study [1]; `workers`: number of threads [1];
    `gpu`: whether trials are solved on a device of CUDA, in threads of this process.
    """
    earlier.refuse(campaign, "a Monte Carlo study")
    block = block_of(campaign, seed, gpu)
    how = "gpu" if gpu else True
    kept = study.begun(campaign, folder, seed, block.plan.size, batched=how)
    kept.fill(block, n, map or monte_carlo.threads(workers), progress)
    kept.join(Path(folder) / study.TRIALS_FILE, n)
    return study.load(folder)[0]
