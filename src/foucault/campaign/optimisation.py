"""Search for a better plan of a campaign, in a folder that can be killed and continued.

The folder holds optimise.json (what was asked), parts/*.parquet (restarts as they were finished),
and in the end restarts.parquet, found.json (the plan beside the one to beat) and campaign.toml,
which does the plan. Restarts come in rounds: those of the first begin from random plans; in every
later round half of them begin from the best plans of the rounds before. What a restart finds
depends on the seed, its number and the rounds before it, never on time or workers: asking for
more restarts in the same folder continues the search.

"""

from __future__ import annotations

import csv
import hashlib
import importlib.metadata
import io
import json
import time as clock
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from itertools import islice
from math import inf
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault import monte_carlo, procedures, units
from foucault.arrays import FloatArray
from foucault.campaign import earlier, study
from foucault.campaign.holding import session_of
from foucault.campaign.reading import Campaign, improvable, said_otherwise
from foucault.campaign.running import simulate
from foucault.campaign.writing import changed, resolved
from foucault.diagnose.foresight import Foresight
from foucault.errors import Finding, error, finding
from foucault.escape import csv_cell
from foucault.files import keep_others, parse_json, write_text
from foucault.models.noise import grade
from foucault.plans.limit import Limit
from foucault.plans.optimise import HOT, Comparison, Space, compare, descend
from foucault.procedures.record import Beforehand
from foucault.procedures.stages import Stage
from foucault.run_folder import CAMPAIGN_FILE

Turned = tuple[float, float, tuple[float, float, float]]

FOUND_FILE = "found.json"

GAIN = 0.9995  # Ratios above this are no gain: they are written as 1.000 [1].


@dataclass(frozen=True)
class Found:
    """A plan beside the one to beat."""

    procedure: str
    aim: str  # what was made small: "sd", or "time" for what is wanted among `needs`
    reference: str  # what the plan to beat is called
    # steps, reference_steps: both plans as tables: headings, then rows
    steps: tuple[tuple[str, ...], ...]
    reference_steps: tuple[tuple[str, ...], ...]
    # duration, reference_duration: time that they take [s]
    duration: float
    reference_duration: float
    # motion, reference_motion: beginning, end [s] and rates about x, y, z [rad/s] of each step,
    # where it is turned at rates; empty elsewhere
    motion: tuple[Turned, ...]
    reference_motion: tuple[Turned, ...]
    # needs, reference_needs: what both plans need of the rig, where that is said
    needs: tuple[Limit, ...]
    reference_needs: tuple[Limit, ...]
    # names, units: what is compared, and the units of `sd` and `reference_sd` for people
    names: tuple[str, ...]
    units: tuple[str, ...]
    weights: tuple[float, ...]  # how much each counts [1]
    unseen: tuple[str, ...]  # what no allowed plan shows
    cases: tuple[str, ...]
    # sd, reference_sd: standard deviations that would be stated, by case and name [units]
    sd: tuple[tuple[float, ...], ...]
    reference_sd: tuple[tuple[float, ...], ...]
    ratio: tuple[tuple[float, ...], ...]  # one over the other by case and name [1]
    # geometric_mean, worst: of the ratios of what counts, by case [1]
    geometric_mean: tuple[float, ...]
    worst: tuple[float, ...]
    # of each restart its number, cost, evaluations, whether it continued an earlier plan, and its
    # trace
    restarts: tuple[dict[str, Any], ...]
    evaluations: int  # plans that were judged [1]
    seed: int  # of the search [1]
    version: str
    allowed: str  # what plans were allowed, in words
    findings: tuple[Finding, ...]  # what the user should know

    @property
    def gained(self) -> bool:
        """Whether the plan is better than the one to beat, in the first case; or shorter."""
        if self.aim == "time":
            shorter = self.duration <= GAIN * self.reference_duration
            return shorter and not _broken(self.needs)
        return self.geometric_mean[0] <= GAIN

    @property
    def reference_broken(self) -> tuple[str, ...]:
        """Limits of the rig that the plan to beat breaks, in words."""
        return _broken(self.reference_needs)

    @property
    def possible_instead(self) -> bool:
        """Whether the rig can do this plan, and not the one to beat."""
        return bool(self.reference_broken) and not _broken(self.needs)

    @property
    def complete(self) -> bool:
        """Whether all is seen, the rig can do it, and it is better or the other is impossible."""
        useful = self.gained or self.possible_instead
        return not self.unseen and useful and not _broken(self.needs)

    @classmethod
    def of(
        cls, procedure: str, space: Space, plan: Any,
        rows: Mapping[str, npt.NDArray[Any]], seed: int, told: tuple[Finding, ...] = (),
    ) -> Found:  # fmt: skip
        """Compare a plan with the one to beat.

        `rows` (restarts,): columns of the restarts; `seed`: of the search [1].
        """
        c = compare(space, plan)
        total = int(rows["evaluations"].sum())
        kept = ("restart", "cost", "evaluations", "continued")
        found = cls(
            procedure=procedure,
            aim=getattr(space, "aim", "sd"),
            reference=space.reference_name,
            steps=space.steps(plan),
            reference_steps=space.steps(space.reference),
            duration=space.duration(plan),
            reference_duration=space.duration(space.reference),
            motion=_said(space, "motion", plan),
            reference_motion=_said(space, "motion", space.reference),
            needs=_said(space, "needs", plan),
            reference_needs=_said(space, "needs", space.reference),
            unseen=space.unseen,
            **_compared(c),
            restarts=tuple(
                {name: rows[name][i].item() for name in kept}
                | {"trace": _frozen(json.loads(trace))}
                for i, trace in enumerate(rows["trace"])
            ),
            evaluations=total,
            seed=seed,
            version=importlib.metadata.version("foucault"),
            allowed=space.limits,
            findings=told,
        )
        return replace(found, findings=(*told, *_judged(found)))

    def save(self, folder: str | Path) -> None:
        """Write it into the folder of the search."""
        write_text(Path(folder) / FOUND_FILE, json.dumps(asdict(self), indent=1) + "\n")


def _compared(c: Comparison) -> dict[str, Any]:
    """Return the fields that come from the comparison, in the units that are shown."""
    shown = units.display_units(c.kinds, c.sd[0])
    return {
        "names": c.names,
        "units": shown,
        "weights": _tuple(c.weights),
        "cases": c.cases,
        "sd": tuple(_shown(row, c.kinds, shown) for row in c.sd),
        "reference_sd": tuple(_shown(row, c.kinds, shown) for row in c.reference_sd),
        "ratio": tuple(_tuple(row) for row in c.ratio),
        "geometric_mean": _tuple(c.geometric_mean),
        "worst": _tuple(c.worst),
    }


def _broken(needs: tuple[Limit, ...]) -> tuple[str, ...]:
    return tuple(limit.words for limit in needs if not limit.kept)


def _judged(found: Found) -> tuple[Finding, ...]:
    """Say what the rig cannot do of the plan to beat, or that nothing was gained on it."""
    ratio = found.geometric_mean[0]
    if found.possible_instead:
        broken = ", ".join(found.reference_broken)
        given = {"name": found.reference, "broken": broken, "ratio": ratio}
        return (finding("optimise.reference_limits", **given),)
    if found.gained:
        return ()
    if found.aim == "time":
        given = {"time": f"{found.duration:.0f}", "reference": f"{found.reference_duration:.0f}"}
        return (finding("optimise.no_time", evaluations=found.evaluations, **given),)
    return (finding("optimise.no_gain", evaluations=found.evaluations, ratio=ratio),)


def _said(space: Space, what: str, plan: Any) -> Any:
    """Return what a space may say of a plan, nothing where it does not."""
    method: Callable[[Any], Any] | None = getattr(space, what, None)
    return () if method is None else method(plan)


def _shown(sd: FloatArray, kinds: tuple[str, ...], shown: tuple[str, ...]) -> tuple[float, ...]:
    return tuple(
        units.convert(float(v), kind, unit) for v, kind, unit in zip(sd, kinds, shown, strict=True)
    )


def _tuple(values: FloatArray) -> tuple[float, ...]:
    return tuple(float(v) for v in values)


def load(folder: str | Path) -> Found:
    """Read what a search has found."""
    path = Path(folder) / FOUND_FILE
    try:
        raw = parse_json(path.read_bytes())
        plain = {f.name: _frozen(raw[f.name]) for f in fields(Found)}
        for name, kind in (("findings", Finding), ("needs", Limit), ("reference_needs", Limit)):
            plain[name] = tuple(kind(**item) for item in plain[name])
    except (OSError, ValueError, KeyError, TypeError):  # of another version, or cut short
        raise error("optimise.missing", folder=folder) from None
    return Found(**plain)


def _frozen(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _frozen(v) for key, v in value.items()}
    return tuple(_frozen(v) for v in value) if isinstance(value, list) else value


RESTARTS_FILE = "restarts.parquet"

ROUND = 8  # Restarts in one round [1].
EVALUATIONS = 4000  # Plans that a restart judges, where its procedure does not say how many [1].
FINALISTS = 8  # So many of the best plans are judged without the approximations of the search [1].
AGAIN = 0.2  # How hot a descent begins that continues a plan of an earlier round, over `HOT` [1].


@dataclass(frozen=True)
class Restart:
    """A trial: one restart."""

    space: Space  # plans and how good they are
    evaluations: int  # plans that it judges [1]
    starts: Mapping[int, Any]  # restart -> plan, as JSON, from which it begins; the others draw [1]

    def __call__(self, index: int, seeds: np.random.SeedSequence) -> dict[str, Any]:
        """Run restart number `index`, shape () [1]."""
        begun = self.starts.get(index)
        start = None if begun is None else self.space.from_json(begun)
        hot = HOT if start is None else AGAIN * HOT
        best = descend(self.space, np.random.default_rng(seeds), self.evaluations, start, hot)
        return {
            "restart": index,
            "continued": start is not None,
            "cost": best.cost,
            "evaluations": best.evaluations,
            "plan": json.dumps(None if best.plan is None else self.space.as_json(best.plan)),
            "trace": json.dumps(best.trace),
        }


def run(
    campaign: Campaign,
    folder: str | Path,
    *,
    restarts: int = 32,
    evaluations: int | None = None,
    time_limit: float | None = None,
    seed: int = 0,
    map: monte_carlo.Map | None = None,
    workers: int = 2,
    size: int = ROUND,
    progress: study.Progress = study.silent,
) -> Found:
    """Search for a better plan, or go on with a search, in a folder.

    `campaign`: the procedure, the limits of the rig and what is wanted; `folder`: where the
    search is kept, one that was interrupted is continued; `restarts`: number of restarts [1];
    `evaluations`: plans that each of them judges, None takes what suits the procedure [1];
    `time_limit` or None: after which no further restart is begun, the first always is [s];
    `seed`: seed of the search [1]; `map`: where to compute, None takes threads; `workers`: number
    of threads [1]; `size`: restarts in one round, on a cluster, a multiple of its workers [1];
    `progress`: called with the number of restarts done and wanted. Returns the best plan beside
    the one to beat. Raises ``optimise.*``: nothing to search, limits that no plan keeps,
    coefficients that no allowed plan shows.
    """
    ends = inf if time_limit is None else clock.monotonic() + time_limit
    space = space_of(campaign)
    if evaluations is None:
        evaluations = procedures.load(campaign.procedure).evaluations or EVALUATIONS
    kept = _opened(campaign, folder, evaluations, seed, size)
    spread, rows = map or monte_carlo.threads(workers), dict[str, npt.NDArray[Any]]()
    for begin in range(0, restarts, size):
        n = min(begin + size, restarts)
        trial = Restart(space, evaluations, _starts(space, rows, begin, size))
        rows = kept.run(
            trial, n, seed, spread, lambda done, _: progress(done, restarts),
            lambda: clock.monotonic() > ends,
        )  # fmt: skip
        if clock.monotonic() > ends:
            break
    rows = kept.merge(max(restarts, kept.begun))  # an earlier search may have gone further
    return _concluded(campaign, space, rows, Path(folder), seed)


def finished(folder: str | Path) -> int:
    """Return the number of restarts that a folder holds, of whatever search [1]."""
    if not (Path(folder) / study.FOLDER).is_dir():
        return 0
    kept = study.Parts(Path(folder), 1)
    return kept.begun - len(kept.missing(kept.begun))


def space_of(campaign: Campaign) -> Space:
    """Return the plans that a campaign allows.

    `campaign`: the procedure, the limits of the rig and what is wanted.
    """
    searched = procedures.load(campaign.procedure).space
    if searched is None:
        able = ", ".join(improvable())
        raise error("optimise.procedure", procedure=campaign.procedure, able=able)
    space: Space = searched(beforehand(campaign)[0])
    space.unseen  # noqa: B018  # refuses what cannot be before any work is done
    return space


def _opened(
    campaign: Campaign, folder: str | Path, evaluations: int, seed: int, size: int
) -> study.Parts:
    text = resolved(campaign, campaign.folder)
    wanted = campaign.wanted.model_dump_json()
    asked = {
        "procedure": campaign.procedure,
        "campaign_sha256": hashlib.sha256((text + wanted).encode()).hexdigest(),
        "seed": seed,
        "evaluations": evaluations,
        "round": size,
    }
    return study.opened(folder, asked, "search", 1, {"asked.toml": campaign.text})


def _starts(
    space: Space, rows: Mapping[str, npt.NDArray[Any]], begin: int, size: int
) -> dict[int, Any]:
    """Return the plans from which half of a round goes on: the best ones, each once.

    The first restart of all goes on from the plan to beat, where that is one of the space.
    """
    if not rows:
        first = getattr(space, "begin", None)
        return {} if first is None or space.cost(first) == inf else {0: space.as_json(first)}
    again = range(begin + size // 2, begin + size)
    return dict(zip(again, _best(rows, begin), strict=False))


def _best(rows: Mapping[str, npt.NDArray[Any]], n: int) -> list[Any]:
    """Return the plans of the first n restarts, each once, best first."""
    order = np.argsort(rows["cost"][:n], kind="stable")
    plans = dict.fromkeys(rows["plan"][order].tolist())
    return [json.loads(plan) for plan in plans if plan != "null"]


def _concluded(
    campaign: Campaign, space: Space, rows: Mapping[str, npt.NDArray[Any]], folder: Path,
    seed: int,
) -> Found:  # fmt: skip
    """Compare the best plan with the one to beat; write what was found."""
    cost = getattr(space, "exact_cost", space.cost)
    plans = map(space.from_json, _best(rows, len(rows["cost"])))
    possible = ((price, plan) for plan in plans if (price := cost(plan)) < inf)
    best = min(islice(possible, FINALISTS), key=itemgetter(0), default=None)
    if best is None:
        raise error("optimise.limits", tried=int(rows["evaluations"].sum()), limits=space.limits)
    plan = best[1]
    told = [*beforehand(campaign)[1], *getattr(space, "findings", ())]
    hardly = space.hardly(plan) if hasattr(space, "hardly") else ()
    if hardly:
        told.append(finding("optimise.hardly", count=len(hardly), names=", ".join(hardly)))
    found = Found.of(campaign.procedure, space, plan, rows, seed, tuple(told))
    text = changed(
        campaign, space.changes(plan),
        f"A plan found by foucault optimise: {found.geometric_mean[0]:.3f} times the sd of "
        f"{space.reference_name}, geometric mean.",
    )  # fmt: skip
    study.write_table(folder / RESTARTS_FILE, rows)
    write_text(folder / CAMPAIGN_FILE, text)
    found.save(folder)
    return found


# -- What the planned session of a campaign will show, told before it is made --------------------
# Where a procedure states no likelihood one session is simulated and calibrated: its covariance is
# the prediction.

PLAN = ("plan", "rate", "segment", "steps", "positions")
"""Keys of [procedure] that say how it is turned; another plan takes the place of them all."""

HEADINGS = ("coefficient", "sd", "prior_sd", "unit", "of_prior")
"""First line of the file that `write` writes."""


def foresee(campaign: Campaign, changes: Mapping[str, Any] | None = None) -> Foresight:
    """Return what the planned session of a campaign will show.

    `changes` or None: keys of [procedure] and what they shall say instead, as in the file. A
    `plan` takes the place of all that the file says of the plan, where a vehicle moves it is the
    `profile` of [simulate].
    """
    if campaign.earlier is not None:
        return earlier.foreseen(
            campaign, campaign.earlier,
            lambda prior: foresee(replace(campaign, prior=prior, earlier=None), changes),
        )  # fmt: skip
    procedure, campaign = procedures.load(campaign.procedure), _planned(campaign, changes)
    known, told = beforehand(campaign)
    found = procedure.foreseen(known)
    if found is None:
        return _simulated(campaign)
    if procedure.more == "recordings" and campaign.log.more:
        told = (*told, finding("systematic.recordings_planned"))
    return replace(found, findings=(*told, *found.findings))


def _planned(campaign: Campaign, changes: Mapping[str, Any] | None) -> Campaign:
    """Return a campaign with another plan."""
    changes = dict(changes or {})
    if "plan" in changes and "profile" in type(campaign.session).model_fields:
        other = {"profile": changes.pop("plan"), "manoeuvres": ()}
        moved = campaign.session.model_copy(update=other)
        campaign = replace(campaign, session=moved)
    return said_otherwise(campaign, changes, PLAN if "plan" in changes else ())


def stages(campaign: Campaign, changes: Mapping[str, Any] | None = None) -> tuple[Stage, ...]:
    """Return what an operator does in the planned session; `changes` as for `foresee`."""
    c = _planned(campaign, changes)
    return procedures.load(c.procedure).stages(c.settings, c.session, c.site)


def beforehand(campaign: Campaign) -> tuple[Beforehand[Any, Any], tuple[Finding, ...]]:
    """Return what a plan is judged by, and what was assumed for it."""
    c = campaign
    earlier.refuse(c, "a search")
    seed = c.simulate.seed
    known = Beforehand(
        c.settings, session_of(c), c.site, c.noise, c.prior, sizes=c.sizes, wanted=c.wanted,
        seed=seed,
    )  # fmt: skip
    procedure = procedures.load(c.procedure)
    if c.noise or not (procedure.assumes_noise or procedure.observe):
        return known, ()
    typical = grade(c.simulate.grade, "simulate.grade").noise
    return replace(known, typical=typical), (finding("preflight.typical", grade=c.simulate.grade),)


def _simulated(campaign: Campaign) -> Foresight:
    """Simulate a session and calibrate it: its covariance is what can be expected."""
    procedure, seed = procedures.load(campaign.procedure), campaign.simulate.seed
    session = simulate(campaign, seed)
    log = session.simulation.log
    result = procedure.calibrate(
        log, site=campaign.site, settings=campaign.settings, noise=campaign.noise,
        prior=campaign.prior, sizes=session.sizes,
    )  # fmt: skip
    found = result.coefficients
    lost = [n for n, s in zip(found.names, found.sd, strict=True) if not np.isfinite(s)]
    return Foresight(
        coefficients=found,
        linearised_at=f"one simulated session, seed {seed}",
        plan="that of [simulate]",
        duration=float(log.time[-1] - log.time[0]),
        states=len(found),
        rank=len(found) - len(lost),
        unseen=tuple(lost),
        weakest=tuple(result.diagnostics.get("weakest", ())),
        findings=(
            finding(
                "preflight.simulated", procedure=campaign.procedure, grade=campaign.simulate.grade
            ),
            *(f for f in result.findings if f.severity == "warning"),
        ),
    )


def write(foresight: Foresight, path: str | Path) -> None:
    """Write the table of coefficients as CSV, in the units that reports show."""
    keep_others(path, [",".join(HEADINGS).encode()])
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(HEADINGS)
    for row in foresight.rows():
        numbers = (row["display_sd"], row["display_prior_sd"], row["of_prior"])
        sd, before, share = ("" if v is None else f"{v:.6g}" for v in numbers)
        words = (row["name"], sd, before, row["display_unit"], share)
        lines.writerow([csv_cell(word) for word in words])
    write_text(path, text.getvalue())
