"""North from a file, and the folder of that: all that its report needs.

A file is a campaign of a north seeker, or readings whose titles say all. The folder holds::

    north.json        every set-up: angles, covariance, bound, budget, checks, findings [SI, rad]
    fixes.csv         a row per set-up for a spreadsheet, in degrees
    fixes.parquet     the same in SI, with covariance and budget
    dwells.parquet    every reading with its fit and residual
    report.html       for people, written by `report.north`
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from foucault import run_folder
from foucault.arrays import FloatArray, IntArray, Made, Names, chosen, to_arrow
from foucault.campaign.reading import Campaign
from foucault.campaign.reading import load as load_campaign
from foucault.campaign.running import Case, opened, read_log
from foucault.campaign.tables import Said, SiteTable
from foucault.diagnose.left_out import judgement_json, table
from foucault.errors import error, finding
from foucault.escape import csv_cell
from foucault.estimate.north import Fixes
from foucault.estimate.north_reduction import Pairs
from foucault.kernels import ahead
from foucault.logs import indexed
from foucault.logs.indexed_own import description_of
from foucault.models.earth import Site
from foucault.models.left_out import ByNoise
from foucault.models.noise import mean_variance
from foucault.procedures import Progress, silent
from foucault.procedures.north_seeking.fix import Survey, find_north
from foucault.procedures.north_seeking.settings import Settings
from foucault.result import Level
from foucault.run_folder import Record
from foucault.tables import IndexedLog

PROCEDURE = "north_seeking"


def run(
    readings: str | Path,
    said: Said | None = None,
    settings: Mapping[str, Any] | None = None,
    *,
    calibration: str | Path | None = None,
    progress: Progress = silent,
) -> Survey:
    """Find the heading of every set-up of a file.

    `readings`: a campaign file, or a CSV or Parquet file whose titles carry the units; `said` or
    None: what is said beside it; `settings` or None: keys of [procedure] that go before those of
    the campaign [SI]; `calibration` or None: run folder or result.json of the calibration;
    `progress`: called with the fraction done and what is being done. Returns the solution of all
    set-ups [SI].
    """
    said = said or Said()
    with ahead.compiling(ahead.NORTH, progress):
        case = opened(readings, said, calibration, progress, lambda p, tell: _read(p, said, tell))
    campaign = case.campaign
    before = {} if campaign is None else campaign.settings.model_dump()
    chosen = Settings.model_validate(before | dict(settings or {}))
    if case.declared is None:
        _refuse_half(said, case.log)
    survey = find_north(
        case.log, site=_site(case, chosen), settings=chosen, noise=case.noise,
        calibration=case.calibration, prior={} if campaign is None else campaign.prior,
        instrument=case.instrument, progress=case.progress,
        sizes=ByNoise() if campaign is None else campaign.sizes,
    )  # fmt: skip
    findings = survey.findings
    if survey.compensation.serial and not case.instrument.get("serial"):
        findings += (finding("north.whose", serial=survey.compensation.serial),)
    made = survey.provenance | {"settings": chosen.model_dump(), "calibration": case.known}
    return replace(survey, findings=findings, provenance=made)


def _read(path: Path, said: Said, progress: Progress) -> tuple[IndexedLog, Campaign | None]:
    if path.suffix != ".toml":
        description, told = description_of(path, said.accel_reads)
        log: IndexedLog = indexed.read(description, path.parent)
        return replace(log, findings=told + log.findings), None
    campaign = load_campaign(path)
    if campaign.procedure != PROCEDURE:
        raise error("north.other_campaign", file=path, given=campaign.procedure)
    if said.accel_reads is not None:
        raise error("north.reads_declared", file=path)
    return read_log(campaign, progress), campaign


def _site(case: Case, settings: Settings) -> Site:
    site = case.site
    if case.log.latitude is not None and site.get("latitude") is None:
        return _of_log(case.log, site)
    if settings.unknown_latitude and site.get("gravity") is None and site.get("latitude") is None:
        raise error("north.fix_gravity")
    if not settings.unknown_latitude and site.get("latitude") is None:
        raise error("north.fix_latitude")
    return SiteTable.model_validate(site).site()


def _of_log(log: IndexedLog, site: Mapping[str, Any]) -> Site:
    """Return the place of the first set-up, where the log alone says the latitudes."""
    assert log.latitude is not None
    known = np.isfinite(log.latitude)
    said = set(log.setup[known].tolist())
    without = [name for k, name in enumerate(log.names) if k not in said]
    if without:
        raise error("north.place_missing", count=len(without), name=without[0])
    first = float(log.latitude[np.argmax(known)])
    return SiteTable.model_validate({**site, "latitude": first}).site()


def _refuse_half(said: Said, log: IndexedLog) -> None:
    """Refuse the noise of one triad where nothing says that of the other."""
    for given, mine, missing, other in (
        ("gyro", said.gyro_noise, "accelerometers", said.accel_noise),
        ("accelerometers", said.accel_noise, "gyro", said.gyro_noise),
    ):
        needed = missing == "gyro" or log.accel is not None
        if mine is not None and other is None and needed:
            raise error("north.noise_half", given=given, missing=missing)


Columns = dict[str, tuple[Any, str]]

ANGLES = ("heading", "pitch", "roll", "latitude")

UNRESOLVED = "sign of the vertical rate"
"""What the budget calls the uncertainty that covers both roots, where neither can be told."""

COVERED = {"north.ambiguous": "one heading", "north.dwell_short": "accuracy"}
"""Findings that say what a check says too -> the check."""

KEPT = 1000
"""Of more set-ups than this the worst so many are kept with their evidence; all of them, as
numbers, are in fixes.parquet [1]."""

ROUNDING = 1e-3
"""Part of a variance that may be missing in the sum of its sources [1]."""


def record(survey: Survey) -> Record:
    """Return what the folder of a survey keeps."""
    kept = _kept(survey)
    whole = survey.again(kept)
    about = run_folder.Later(lambda: _document(survey, kept, whole.fixes))
    tables = {"dwells": _dwells(survey, kept, whole.pairs), "fixes": _fixes(survey, kept)}
    made = run_folder.record("north", about, tables)
    return replace(made, texts={"fixes.csv": lambda: _csv(made.about)})


def _kept(survey: Survey) -> IntArray:
    """Return the set-ups that are kept with their evidence, in the order of the file [1]."""
    if len(survey) <= KEPT:
        return np.arange(len(survey))
    sd, levels = np.nan_to_num(survey.fixes.sd[:, 0], nan=np.inf), survey.levels
    last = np.partition(levels, -KEPT)[-KEPT]  # of those that are kept
    some = np.flatnonzero(levels >= last)
    rest = KEPT - int(np.sum(levels > last))
    least = np.partition(sd[levels == last], -rest)[-rest]
    some = some[(levels[some] > last) | (sd[some] >= least)]
    return np.sort(some[np.lexsort((-sd[some], -levels[some]))[:KEPT]])


# -- north.json ----------------------------------------------------------------------------


def _document(survey: Survey, kept: IntArray, whole: Fixes) -> dict[str, Any]:
    return {
        "instrument": survey.instrument,
        "site": survey.site.said,
        "known": {k: v[kept] if np.ndim(v) else v for k, v in vars(survey.known).items()},
        "noise": {"source": survey.noise_source} | asdict(survey.noise),
        "calibration": survey.calibration,
        "coefficients": {
            row["name"]: {k: row[k] for k in ("value", "sd", "unit")}
            for row in survey.compensation.coefficients.rows()
        },
        "drift_sd": "free" if np.isinf(survey.drift_sd) else survey.drift_sd,
        "findings": [f.as_dict() for f in survey.findings],
        **_left_out(survey),
        **({"norths": [asdict(n) for n in survey.norths]} if survey.norths[1:] else {}),
        **({"of": _all_of(survey)} if len(kept) < len(survey) else {}),
        "setups": _setups(survey, kept, whole),
        "provenance": survey.provenance,
    }


def _all_of(survey: Survey) -> dict[str, Any]:
    """Return what is said of all set-ups, where not all are kept."""
    sd = survey.fixes.sd[:, 0]
    sd = sd[np.isfinite(sd)]
    ends = [float(sd.min()), float(sd.max())] if len(sd) else []
    counts = np.bincount(survey.levels, minlength=len(Level)).tolist()
    verdicts = {str(level): count for level, count in zip(Level, counts, strict=True) if count}
    return {"setups": len(survey), "verdicts": verdicts, "heading_sd": ends}


def _left_out(survey: Survey) -> dict[str, Any]:
    """Return what was made of what is not estimated, and its table; nothing where none counts."""
    judged = survey.left_out
    if judged is None:
        return {}
    columns = {name: column.tolist() for name, column in table(judged).items()}
    return judgement_json(judged) | {"not_estimated": columns}


def _setups(survey: Survey, kept: IntArray, whole: Fixes) -> list[dict[str, Any]]:
    fixes, pairs, d = survey.fixes, survey.pairs, survey.dwells
    first = d.first
    rows = list(zip(first[kept].tolist(), first[kept + 1].tolist(), strict=True))
    numbers = {
        "angles": fixes.angles, "sd": fixes.sd, "bound": survey.bound, "cov": fixes.cov,
        "other": fixes.other, "away": fixes.other_square - fixes.square,
        "ambiguous": fixes.ambiguous, "clamped": fixes.clamped, "status": fixes.status,
        "values": pairs.values, "offset": pairs.offset, "drift": pairs.drift,
        "effect": survey.drift_effect, "chi_square": pairs.chi_square, "dof": pairs.dof,
        "heading": d.heading,
    }  # fmt: skip
    of = {name: x[kept].tolist() for name, x in numbers.items()}  # by far quicker than one by one
    of["start"] = [float(d.start[a:b].min()) for a, b in rows]
    of["end"] = [float((d.start[a:b] + d.time[a:b]).max()) for a, b in rows]
    of["measured"] = [float(d.time[a:b].sum()) for a, b in rows]
    of["dwells"] = [b - a for a, b in rows]
    parts = {name: part[:].tolist() for name, part in _parts(whole).items()}
    return [
        _setup(survey, i, {name: x[k] for name, x in of.items()},
               {name: part[k] for name, part in parts.items()})
        for k, i in enumerate(kept.tolist())
    ]  # fmt: skip


def _setup(
    survey: Survey, i: int, x: Mapping[str, Any], parts: Mapping[str, Sequence[float]]
) -> dict[str, Any]:
    verdict, sd = survey.verdicts[i], x["sd"]
    out: dict[str, Any] = {"name": survey.dwells.names[i]}
    for angle, *numbers in zip(ANGLES, x["angles"], sd, x["bound"], strict=True):
        out[angle] = dict(zip(("value", "sd", "bound"), numbers, strict=True))
    other = dict(zip(ANGLES, x["other"], strict=True))
    if survey.norths[1:]:
        out["headings"] = {n.name: n.heading(x["angles"][0], sd[0]) for n in survey.norths}
    return out | {
        "verdict": str(verdict.level),
        "reasons": list(verdict.reasons),
        "warnings": _warnings(survey, i),
        "reference_heading": x["heading"],
        "covariance": x["cov"],
        # standard deviations by source, negative where a source makes the sum smaller
        "budget": {
            name: dict(zip(ANGLES, part, strict=True))
            for name, part in parts.items()
            if name != UNRESOLVED or np.isfinite(part[0])
        },
        "ambiguous": x["ambiguous"],
        "other": other | {"square": x["away"]},
        "clamped": x["clamped"],
        "solved": x["status"] == 0,
        "rate": {"x": x["values"][0], "y": x["values"][1]},
        "specific_force": {"x": x["values"][2], "y": x["values"][3]},
        "gyro_offset": x["offset"],
        "gyro_drift": x["drift"],
        "drift_effect": x["effect"],
        "chi_square": {
            sensor: {"value": x["chi_square"][k], "dof": x["dof"][k]}
            for k, sensor in enumerate(("gyro", "accel"))
        },
        "dwells": x["dwells"],
        "measured": x["measured"],
        "start": x["start"],
        "duration": x["end"] - x["start"],
        "checks": [dict(vars(c)) for c in survey.checks[i]],
        "findings": [f.as_dict() for f in survey.setup_findings[i]],
    }


def _warnings(survey: Survey, i: int) -> str:
    """Return why a set-up did not pass, and what else was noticed, as one text."""
    failed = {c.name for c in survey.checks[i] if not c.passed}
    noticed = [
        f.message for f in survey.setup_findings[i]
        if f.severity != "note" and COVERED.get(f.code) not in failed
    ]  # fmt: skip
    return " ".join([*survey.verdicts[i].reasons, *noticed])


def _parts(fixes: Fixes) -> dict[str, Made]:
    """Return sds of the angles whose sources are known by source [rad]; NaN where it is none."""
    m = len(fixes)
    variances: dict[str, Callable[[slice], FloatArray]] = {
        name: v.__getitem__ for name, v in fixes.sources.items()
    }

    def unresolved(some: slice) -> FloatArray:
        known = [v[some] for v in fixes.sources.values()]
        cov = np.einsum("nii->ni", fixes.cov[some])[:, : known[0].shape[1]]
        rest = cov - sum(known)
        return np.where(rest[:, :1] > ROUNDING * cov[:, :1], rest, np.nan)

    starts = range(0, m, indexed.AT_ONCE)
    if any(np.isfinite(unresolved(slice(k, k + indexed.AT_ONCE))[:, 0]).any() for k in starts):
        variances[UNRESOLVED] = unresolved

    def sd(of: Callable[[slice], FloatArray]) -> Made:
        return Made(m, lambda some: np.sign(v := of(some)) * np.sqrt(np.abs(v)))

    return {name: sd(of) for name, of in variances.items()}


def _of_heading(part: Made) -> Made:
    return Made(part.size, lambda some: part[some][:, 0])


# -- tables --------------------------------------------------------------------------------


def _dwells(survey: Survey, kept: IntArray, pairs: Pairs) -> Columns:
    """Return the readings of `kept` with their fit, and what the figures need of them."""
    d, fit = survey.dwells.setups(kept), pairs.fit
    setup = d.setup
    each = pairs.values[setup]
    turned = each[:, 0] * d.sine + each[:, 1] * d.cosine
    out: Columns = {
        "setup": (setup, ""),
        "name": ([d.names[i] for i in d.setup.tolist()], ""),
        "start": (d.start, "s"),
        "time": (d.time, "s"),
        "index": (d.index, "rad"),
        "cosine": (d.cosine, "1"),
        "sine": (d.sine, "1"),
        "gyro": (d.gyro, "rad/s"),
        "gyro_fit": (fit, "rad/s"),
        "gyro_constant": (fit - turned, "rad/s"),  # offset and drift
        "gyro_sd": (np.sqrt(mean_variance(survey.noise.gyro, d.time, d.interval)), "rad/s"),
        "residual": (pairs.residuals, "1"),
    }
    if d.accel is None:
        return out
    sd = np.sqrt(mean_variance(survey.noise.accel, d.time, d.interval))
    if d.accel.shape[1] == 2:
        out["accel_x"], out["accel_y"] = (d.accel[:, 0], "m/s^2"), (d.accel[:, 1], "m/s^2")
    else:
        turned = each[:, 2] * d.sine + each[:, 3] * d.cosine
        out["accel"] = (d.accel[:, 0], "m/s^2")
        out["accel_constant"] = (_offset(d.accel[:, 0] - turned, sd, setup), "m/s^2")
        out["accel_residual"] = (pairs.accel_residuals, "1")
    return out | {"accel_sd": (sd, "m/s^2")}


def _offset(left: FloatArray, sd: FloatArray, setup: npt.NDArray[np.int64]) -> FloatArray:
    """Return the mean of what the tilt leaves of each set-up, for every row, shape (n,)."""
    weight = np.ones_like(sd) if not sd.all() else sd**-2
    return np.asarray((np.bincount(setup, weight * left) / np.bincount(setup, weight))[setup])


def _fixes(survey: Survey, kept: IntArray) -> Columns:
    """Return a row per set-up in SI; what is to know of it in words where it is `kept`."""
    f, d, m = survey.fixes, survey.dwells, len(survey)
    out: Columns = {"setup": (d.names, "")}
    for k, angle in enumerate(ANGLES):
        for said, name in (
            (f.angles, angle),
            (f.sd, f"{angle}_sd"),
            (survey.bound, f"{angle}_bound"),
        ):
            out[name] = (said[:, k], "rad")
    for i, one in enumerate(ANGLES):
        for k, two in enumerate(ANGLES[:i]):
            out[f"covariance_{two}_{one}"] = (f.cov[:, i, k], "rad^2")
    for source, part in _parts(f).items():
        out[f"heading_sd.{source}"] = (_of_heading(part), "rad")
    which = np.zeros(m, np.int64)
    which[kept] = 1 + np.arange(len(kept))
    words = Names(to_arrow(["", *(_warnings(survey, i) for i in kept.tolist())]))
    levels = Names(to_arrow([str(level) for level in Level]))
    return out | {
        "reference_heading": (d.heading, "rad"),
        "other_heading": (f.other[:, 0], "rad"),
        "ambiguous": (f.ambiguous, ""),
        "gyro_offset": (survey.pairs.offset, "rad/s"),
        "gyro_drift": (survey.pairs.drift, "rad/s^2"),
        "drift_effect": (survey.drift_effect, "rad"),
        "dwells": (np.diff(d.first), "1"),
        "measured": (np.bincount(d.setup, d.time, minlength=m), "s"),
        "verdict": (chosen(levels, survey.levels), ""),
        "warnings": (chosen(words, which), ""),
    }


def _csv(about: Mapping[str, Any]) -> str:
    """Return a row per set-up as people want it: degrees, and words."""
    titles = ["set-up"]
    for angle in ANGLES:
        titles += [f"{angle} (deg)", f"{angle} sd (deg)"]
    other_norths = [n["name"] for n in about.get("norths", ())[1:]]
    titles += [f"heading from {name} north (deg)" for name in other_norths]
    titles += ["bound of the heading sd (deg)", "reference heading (deg)", "other heading (deg)",
               "gyro offset (deg/h)", "dwells", "measured (s)", "verdict", "warnings"]  # fmt: skip
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(titles)
    for r in about["setups"]:
        cells = [r["name"]]
        for angle in ANGLES:
            value = _degrees(r[angle]["value"])
            turned = angle == "heading" and value == _degrees(2 * np.pi)  # rounded up to north
            cells += [_degrees(0.0) if turned else value, _degrees(r[angle]["sd"])]
        cells += [_degrees(r["headings"][name][0]) for name in other_norths]
        other = r["other"]["heading"] if r["ambiguous"] else None
        cells += [_degrees(v) for v in (r["heading"]["bound"], r["reference_heading"], other)]
        offset = "" if r["gyro_offset"] is None else f"{3600 * np.degrees(r['gyro_offset']):.6f}"
        cells += [offset, str(r["dwells"]), f"{r['measured']:.3f}", r["verdict"], r["warnings"]]
        writer.writerow([csv_cell("" if cell is None else cell) for cell in cells])
    return stream.getvalue()


def _degrees(value: float | None) -> str:
    return "" if value is None else f"{np.degrees(value):.6f}"
