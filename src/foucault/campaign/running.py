"""What a campaign file asks for, done: read its log, calibrate, or simulate it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from foucault import display, logs, procedures, run_folder
from foucault.campaign import earlier
from foucault.campaign.holding import held, noise_of
from foucault.campaign.reading import Campaign, load
from foucault.campaign.tables import Said, SiteTable, parse_at
from foucault.campaign.writing import EXAMPLE, EXAMPLE_SITE, log_table
from foucault.coefficients import CoefficientVector, Layout
from foucault.errors import Finding, FoucaultError, doubting, error, finding, require
from foucault.files import make_folder, sha256, write_text
from foucault.kernels import ahead
from foucault.logs.checks import beside_another
from foucault.logs.description import LogDescription, describes_itself, description_of
from foucault.logs.follow import OnDisk
from foucault.models.earth import Site
from foucault.models.imu import Gauge, ImuModel
from foucault.models.layouts import Instrument, model_of
from foucault.models.left_out import Sizes
from foucault.models.noise import ImuNoise
from foucault.models.size_effect import SizeEffect
from foucault.procedures import Progress, silent
from foucault.result import Result
from foucault.tables import IndexedLog, Log

STREAMED = 1 << 28
"""A larger log stays on disk, where its procedure needs no more than blocks of it [1]."""

EXPLAIN = ("log.stuck", "log.triads_exchanged")
"""What is wrong with a log whatever is said of it after: an error begins with it."""

TRUTH_FILE = "truth.json"
SESSION_LOG = "log.csv"
SESSION_CAMPAIGN = "campaign.toml"


def read_log(campaign: Campaign, progress: Progress = silent, known: Log | None = None) -> Any:
    """Read the log of a campaign; its findings follow those of the campaign file.

    `known`: the log by its description, where that is read already.
    """
    procedure = procedures.load(campaign.procedure)
    if known is not None and procedure.read is logs.read and procedure.with_master is None:
        return replace(known, findings=_told(campaign) + known.findings)
    with nullcontext() if procedure.with_master is None else beside_another():
        log = procedure.read(
            campaign.log, campaign.folder, lambda done: progress(done, "reading the log")
        )
    if procedure.with_master is not None:
        log = procedure.with_master(log, campaign.master, campaign.folder)
    return replace(log, findings=_told(campaign) + log.findings)


def _told(campaign: Campaign) -> tuple[Finding, ...]:
    """What was noticed in the campaign file."""
    said, example = campaign.tables.site, SiteTable.model_validate(EXAMPLE_SITE)
    place = (said.gravity, said.latitude, said.height) == (None, example.latitude, example.height)
    name = campaign.instrument.get("name") == EXAMPLE
    unedited = " and ".join(["[site]"] * place + ["the name in [instrument]"] * name)
    if unedited and not (campaign.folder / TRUTH_FILE).exists():
        return (*campaign.findings, finding("campaign.template", what=unedited))
    return campaign.findings


def calibrate(
    campaign: Campaign | str | Path, progress: Progress | None = None, known: Log | None = None
) -> Result:
    """Read the log of a campaign and calibrate it.

    Parameters
    ----------
    campaign : Campaign, str or Path
        The campaign or its file.
    progress : callable
        Called with the fraction done and what is being done; None for a bar in a notebook, and
        for nothing elsewhere.
    known : Log
        The log by the campaign's description, where that is read already [SI]; None to read it.

    Returns
    -------
    Result
        Coefficients with covariance, checks and a verdict [SI].
    """
    tell = display.progress() if progress is None else progress
    require("campaign", campaign, Campaign, str, Path)
    if not isinstance(campaign, Campaign):
        campaign = load(campaign)
    procedure = procedures.load(campaign.procedure)
    if procedure.more == "none":
        refuse_more(campaign, f"'{campaign.procedure}'")
    log = None
    if procedure.streams(campaign.log):
        on_disk = OnDisk(campaign.log, campaign.folder, _told(campaign))
        log = on_disk if on_disk.size > STREAMED else None
    with ahead.compiling(campaign.procedure, tell):
        given = read_log(campaign, tell, known) if log is None else log

    def run(prior: earlier.Priors) -> Result:
        with doubting(f for f in given.findings if f.code in EXPLAIN):
            result = procedure.calibrate(
                given,
                site=campaign.site,
                settings=campaign.settings,
                noise=campaign.noise,
                prior=prior,
                sizes=campaign.sizes,
                instrument=campaign.instrument,
                progress=tell,
            )
        if progress is None:
            tell(1.0, "done")
        return earlier.with_given(result, prior)

    if campaign.earlier is None:
        return run(campaign.prior)
    return earlier.calibrated(campaign, campaign.earlier, run)


def refuse_more(campaign: Campaign, what: str) -> None:
    """Refuse a log in files that were recorded one by one."""
    files = getattr(campaign.log, "more", ())
    if files:
        able, each = (
            ", ".join(p for p in procedures.PROCEDURES if procedures.load(p).more == kind)
            for kind in ("stretches", "recordings")
        )
        raise error("log.more_moving", files=", ".join(files), what=what, allowed=able,
                    recordings=each)  # fmt: skip


# -- simulation ----------------------------------------------------------------------------


class Simulation(Protocol):
    """What a procedure's `simulate` returns."""

    @property
    def log(self) -> Log | IndexedLog:
        """What the instrument said [SI]."""
        ...

    @property
    def model(self) -> Instrument:
        """The errors it had."""
        ...

    def truth_json(self) -> dict[str, Any]:
        """Return the truth beside the coefficients."""
        ...


@dataclass(frozen=True)
class Session:
    """A simulated session: its log, and the truth behind it."""

    campaign: Campaign
    simulation: Simulation  # log, true errors and whatever else is known to be true [SI]
    seed: int  # seed of all random numbers [1]
    # at which it holds what its calibration does not estimate, None: it holds the model alone [SI]
    sizes: Sizes | None = None

    @property
    def truth(self) -> CoefficientVector:
        """The coefficients the simulated instrument had, in the body axes of results."""
        model = self.simulation.model
        if isinstance(model, ImuModel):
            lower, C_cb = model.in_gauge(Gauge.LOWER)
            size: SizeEffect | None = getattr(self.simulation, "size_effect", None)
            beside: CoefficientVector | None = getattr(self.simulation, "beside", None)
            found = lower.coefficients()
            if size is not None:
                found = found.with_others(size.rotated(C_cb).coefficients())
            return found if beside is None else found.with_others(beside)
        whole: CoefficientVector = getattr(self.simulation, "truth", model.coefficients())
        return whole


def simulate(campaign: Campaign | str | Path, seed: int | None = None) -> Session:
    """Simulate the session that a campaign describes.

    Parameters
    ----------
    campaign : Campaign, str or Path
        The campaign or its file.
    seed : int or None, shape ()
        Seed; None takes that of the campaign [1].
    """
    require("campaign", campaign, Campaign, str, Path)
    if not isinstance(campaign, Campaign):
        campaign = load(campaign)
    seed = campaign.simulate.seed if seed is None else seed
    procedure = procedures.load(campaign.procedure)
    # Real gravity is not what the calibration will assume, but near it.
    offset = np.random.default_rng([seed, 9]).standard_normal() * campaign.site.gravity_sd
    beside = held(campaign, seed)
    session, settings, model = beside.session(campaign, _instrument(campaign, seed))
    simulation = procedure.simulate(
        session,
        settings=settings,
        model=model,
        noise=noise_of(campaign),
        site=beside.site(replace(campaign.site, gravity=campaign.site.gravity + float(offset))),
        seed=seed,
    )
    return Session(campaign, beside.simulation(simulation), seed, beside.sizes)


def _instrument(campaign: Campaign, seed: int) -> Instrument:
    """Draw the errors of the instrument, then set those the campaign gives."""
    procedure = procedures.load(campaign.procedure)
    drawn = procedure.draw_errors(campaign.simulate.grade, seed).coefficients()
    return model_of(drawn.with_values(given_errors(campaign, procedure.layout)))


def given_errors(campaign: Campaign, layout: Layout) -> dict[str, float]:
    """Return the coefficients that [simulate] sets to a value [SI]."""
    return {
        name: parse_at(
            f'simulate.errors."{name}"', text, layout.coefficients[layout.index(name)].kind
        )
        for name, text in campaign.simulate.errors.items()
    }


def keep_recorded(folder: Path, truth: str, files: Iterable[str]) -> None:
    """Refuse to simulate over files that no simulation has written: no truth lies beside them."""
    for name in files:
        if (folder / name).exists() and not (folder / truth).exists():
            raise error("output.other", path=folder / name)


def save_session(session: Session, folder: str | Path) -> Path:
    """Write a simulated session as a user would have it, with the truth beside it.

    `folder`: gets log.csv, campaign.toml and truth.json, and what the procedure has besides.
    Returns the campaign file written; `calibrate` takes it as it is.
    """
    folder = Path(folder)
    keep_recorded(folder, TRUTH_FILE, (SESSION_LOG, SESSION_CAMPAIGN))
    make_folder(folder)
    log = session.simulation.log
    procedures.load(session.campaign.procedure).write(log, folder / SESSION_LOG)
    if hasattr(session.simulation, "write_beside"):
        session.simulation.write_beside(folder)
    write_text(folder / TRUTH_FILE, json.dumps(_truth(session), indent=1) + "\n")
    up = getattr(session.campaign.session, "first_rest", "z up")
    own = log_table(session.campaign.procedure, log, up=up)
    text = with_own_log(session.campaign.text, own)
    if session.seed != session.campaign.simulate.seed:
        text = with_seed(text, session.seed)
    if session.campaign.sizes is not None and not session.campaign.sizes:
        text = with_nothing_else(text)
    write_text(folder / SESSION_CAMPAIGN, text)
    return folder / SESSION_CAMPAIGN


def _truth(session: Session) -> dict[str, Any]:
    keep = ("name", "symbol", "value", "unit", "display_value", "display_unit")
    rows = session.truth.rows()
    return {
        "seed": session.seed,
        "grade": session.campaign.simulate.grade,
        "gauge": Gauge.LOWER.value,
        "coefficients": [{k: row[k] for k in keep} for row in rows],
        **session.simulation.truth_json(),
    }


_HEADER = re.compile(r"^[ \t]*\[+[ \t]*([A-Za-z_]+)", re.MULTILINE)


def with_own_log(text: str, own: str) -> str:
    """Let [log], and what else `own` holds, of a campaign's `text` be `own`; the rest stays."""
    starts = [m.start() for m in _HEADER.finditer(text)]
    names = [m.group(1) for m in _HEADER.finditer(text)]
    if "log" not in names:
        raise error("campaign.required", key="log", example="a table [log]", more="")
    edges = [*starts, len(text)]
    pieces = [text[: edges[0]]]
    said = {m.group(1) for m in _HEADER.finditer(own)}
    for name, start, end in zip(names, starts, edges[1:], strict=True):
        if name not in said:
            pieces.append(text[start:end])
        elif own + "\n" not in pieces:
            pieces.append(own + "\n")
    return "".join(pieces)


def with_nothing_else(text: str) -> str:
    """Let [instrument] of a campaign's `text` say that there is nothing but what is estimated."""
    line = "left_out = false  # a simulated instrument: it holds no more than [procedure] says"
    text = re.sub(r"^# left_out = false\n", "", text, flags=re.MULTILINE)
    head, found, rest = text.partition("[instrument]\n")
    if not found:
        return f"{text.rstrip()}\n\n[instrument]\n{line}\n"
    return f"{head}{found}{line}\n{rest}"


def with_seed(text: str, seed: int) -> str:
    """Let [simulate] of a campaign's `text` give `seed`, shape () [1]."""
    head, found, rest = text.partition("[simulate]")
    if not found:
        return f"{text.rstrip()}\n\n[simulate]\nseed = {seed}\n"
    changed, n = re.subn(
        r"^[ \t]*seed[ \t]*=.*$", f"seed = {seed}", rest, count=1, flags=re.MULTILINE
    )
    return head + found + (changed if n else f"\nseed = {seed}{rest}")


# -- A log from a campaign or from a file alone, and what is said beside it ----------------------


@dataclass(frozen=True)
class Case:
    """A log with what is known of it: what is said beside it goes before what its file says."""

    log: Any
    campaign: Campaign | None  # where the file is one
    instrument: dict[str, Any]
    site: Mapping[str, Any]  # keys of [site] [SI]
    declared: ImuNoise | None  # what the file says [SI]
    noise: ImuNoise | None
    calibration: Result | None
    known: Mapping[str, str]  # file and hash of the calibration
    progress: Progress  # of the work that follows

    @property
    def place(self) -> Site | None:
        """The site, None where nothing is said of it."""
        if self.site.get("latitude") is None and self.site.get("gravity") is None:
            return None
        return SiteTable.model_validate(self.site).site()


def calibration_of(path: Path) -> tuple[Result, dict[str, str]]:
    """Return the calibration of a run folder or result.json, with its file and hash."""
    result = run_folder.load_result(path, with_tables=False).numbers()
    file = run_folder.result_file(path)
    made = result.provenance | {"file": str(file)}
    return replace(result, provenance=made), {"file": str(file), "sha256": sha256(file)}


def read_any(
    path: Path | Sequence[Path], progress: Progress, *, whole: bool = False, one: bool = False,
    said: Mapping[str, Any] | None = None,
) -> tuple[Log, Campaign | None]:  # fmt: skip
    """Read the log of a campaign file, or a bare one, in one file or several.

    `said`: keys of [log] that are known of a bare one.
    A triad without a column for each axis is refused where the log has to be `whole`, files that
    were recorded one by one where it has to be `one`. Returns the campaign too, where there is one.
    """
    paths = [path] if isinstance(path, Path) else list(path)
    if len(paths) > 1 or paths[0].suffix != ".toml":
        description, told = _described(paths, said)
        if whole:
            description.whole()
        folder = paths[0].parent
        log = logs.read(description, folder, lambda part: progress(part, "reading the log"))
        return replace(log, findings=told + log.findings), None
    campaign = load(paths[0], calibrates=False)
    if one:
        refuse_more(campaign, "what reads a log by itself")
    if whole and isinstance(campaign.log, LogDescription):
        campaign.log.whole()
    log = read_log(campaign, progress)
    if not isinstance(log, Log):
        raise error("north.not_imu", procedure=campaign.procedure)
    return log, campaign


def _described(
    paths: Sequence[Path], said: Mapping[str, Any] | None
) -> tuple[LogDescription, tuple[Finding, ...]]:
    """Describe a bare log by its titles and numbers, or by titles alone where these do not tell."""
    if len(paths) == 1 and describes_itself(paths[0]):
        return LogDescription.model_validate({"file": paths[0].name}), ()
    from foucault.recognise.reading import question, recognise  # a campaign needs none of it

    try:
        seen = recognise(paths, said)
        if seen.questions:
            raise question(seen)
    except FoucaultError as problem:
        if len(paths) > 1 or said:
            raise
        try:
            return description_of(paths[0])
        except FoucaultError as other:
            raise (other if problem.code == "recognise.short" else problem) from None
    taken = "; ".join(f"{line.what} {line.took} ({line.sure})" for line in seen.lines)
    told = finding("recognise.taken", file=paths[0].name, taken=taken)
    return seen.description(), (told,)


Reader = Callable[[Path, Progress], tuple[Any, Campaign | None]]


def read_whole(
    path: Path, progress: Progress, said: Mapping[str, Any] | None = None
) -> tuple[Log, Campaign | None]:
    """Read a log that is navigated, aligned or matched; `said` as of `read_any`."""
    return read_any(path, progress, whole=True, one=True, said=said)


def opened(
    path: str | Path, said: Said, calibration: str | Path | None, progress: Progress,
    read: Reader | None = None,
) -> Case:  # fmt: skip
    """Read a log, and put together what is known of it.

    `said`: what is said beside it; `calibration` or None: run folder or result.json; `read`: reader
    of such logs, or None.
    """
    read = read or partial(read_whole, said=said.log)
    # A wrong calibration shows before a long log is read.
    result, known = (None, {}) if calibration is None else calibration_of(Path(calibration))
    log, found = read(Path(path), lambda part, words: progress(0.3 * part, words))
    instrument, site, noise = {}, {}, None
    if found is not None:
        instrument, site, noise = found.instrument, found.tables.site.model_dump(), found.noise
    return Case(
        log, found, instrument | ({"serial": said.serial} if said.serial else {}),
        site | said.site, noise, said.over(noise), result, known,
        lambda part, words: progress(0.3 + 0.6 * part, words),
    )  # fmt: skip
