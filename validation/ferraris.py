"""Six rests and three turns: a real session beside imucal, and consistency by simulation."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
from common import DATA, limits, word

from foucault.diagnose.study import nees
from foucault.logs import LogDescription, read
from foucault.models.earth import EARTH_RATE, Site
from foucault.models.noise import grade
from foucault.procedures import ferraris, six_position
from foucault.simulate.hand_rotated import draw_errors
from make_faces import IMUCAL

FOLDER = DATA / "ferraris_session"
PLACE = replace(Site.at(np.radians(48.8462), 60.0), gravity_sd=0.0)  # as it is simulated
THERE = Site(9.81, np.radians(49.6))  # where the session may have been taken; it is not known

ARCMIN = np.radians(1 / 60)
SESSIONS = 500

WHAT = {
    "K_a": "accelerometer scale factors", "R_a": "accelerometer axes",
    "b_a": "accelerometer bias [m/s^2]", "K_g": "gyro scale factors", "R_g": "gyro axes",
    "b_g": "gyro bias [deg/s]", "K_ga": "g-sensitivity [deg/s/(m/s^2)]",
}  # fmt: skip


def session():
    words = {
        "file": "example_ferraris_session.csv", "rate": "102.4 Hz",
        "accel": {"columns": ["acc_x", "acc_y", "acc_z"], "unit": "m/s^2"},
        "gyro": {"columns": ["gyr_x", "gyr_y", "gyr_z"], "unit": "deg/s"},
    }  # fmt: skip
    rows = json.loads((FOLDER / "example_ferraris_session_list.json").read_text())
    log = read(LogDescription.model_validate(words), FOLDER)
    return log, {name: (row["start"], row["end"]) for name, row in rows.items()}


def calibrated(log, site, **settings):
    return ferraris.calibrate(log, site=site, settings=ferraris.Settings(**settings))


def _terms(result):
    out = {k: np.array(v) for k, v in result.diagnostics["published"].items()}
    return out | {k: np.degrees(out[k]) for k in ("b_g", "K_ga")}


def published(log, sections) -> list[str]:
    words = {"solution": "published", "sections": sections}
    off = _terms(calibrated(log, THERE, earth_rate=False, **words))
    on = _terms(calibrated(log, THERE, **words))
    rows = [
        "| quantity | ours, Earth off | imucal | worst difference over largest | Earth on | on "
        "minus off, largest |",
        "|---|---|---|---|---|---|",
    ]
    for name, what in WHAT.items():
        want = np.array(IMUCAL[name])
        worst = np.abs(off[name] - want).max() / np.abs(want).max()
        change = np.abs(on[name] - off[name]).max()
        cells = [_list(x) for x in (off[name], want, on[name])]
        rows.append(
            f"| {what} | {cells[0]} | {cells[1]} | {worst:.0e} | {cells[2]} | {change:.2e} |"
        )
    return rows


def _list(x) -> str:
    shown = np.diag(x) if np.ndim(x) == 2 else x
    return ", ".join(f"{v:.10g}" for v in shown)


def likelihood(log, sections) -> list[str]:
    runs = {
        "published, sections": calibrated(log, THERE, solution="published", sections=sections),
        "likelihood, sections": calibrated(log, THERE, sections=sections),
        "likelihood, rests and turns found": calibrated(log, THERE),
        "the same, no Earth rate": calibrated(log, THERE, earth_rate=False),
    }
    names = runs["likelihood, sections"].coefficients.names
    rows = [
        "| coefficient | " + " | ".join(runs) + " |",
        "|---|" + "---|" * len(runs),
    ]
    shown = {name: i for i, name in enumerate(names)}
    units = {"accel.bias": (1e3 / 9.80665, "mg"), "gyro.bias": (np.degrees(3600), "deg/h")}
    for name in shown:
        group = name.rpartition(".")[0]
        scale, unit = units.get(group, (1e6, "ppm"))
        if group.endswith("misalignment"):
            scale, unit = 1 / ARCMIN, "arcmin"
        cells = []
        for result in runs.values():
            one = result.coefficients[name]
            cells.append(f"{one.values[0] * scale:.4g} ± {one.sd[0] * scale:.2g}")
        rows.append(f"| {name} [{unit}] | " + " | ".join(cells) + " |")
    rows.append("")
    for label, result in runs.items():
        rests = len(result.diagnostics["faces"])
        place = result.diagnostics["placement_sd"] / ARCMIN
        rows.append(
            f"- {label}: {result.verdict.level}, {rests} rests, placements off by {place:.1f} "
            f"arcmin (sd, from the residuals)."
        )
    return rows


def study(procedure, name, place, given, n) -> str:
    settings = procedure.Settings(placement_sd=given)
    plan = procedure.Session(placement_sd=place)
    names, noise = procedure.PROCEDURE.names(settings, procedure.Session()), grade(name).noise
    errors, covs = [], []
    for seed in range(n):
        model = draw_errors(name, seed)
        made = procedure.simulate(
            plan, settings=settings, model=model, noise=noise, site=PLACE, seed=seed
        )
        result = procedure.calibrate(made.log, site=PLACE, settings=settings, noise=noise)
        errors.append(result.coefficients.values - model.coefficients(names).values)
        covs.append(result.coefficients.cov)
    e, P = np.array(errors), np.array(covs)
    low, high = limits(n * len(names), tests=8)
    value = nees(e, P).mean() / len(names)
    z = np.sqrt(np.mean(e**2 / np.einsum("nii->ni", P), axis=0))
    inside = word(low < value < high)
    shown = f"{low:.3f} to {high:.3f}" if given is not None else "none"
    label = "as it was" if given is not None else "from the residuals"
    return (
        f"| {procedure.__name__.rpartition('.')[2]} | {name} | {place / ARCMIN:.0f} arcmin | "
        f"{label} | {value:.3f} | {shown} | {inside if given is not None else ''} | "
        f"{z.min():.2f} to {z.max():.2f} |"
    )


def consistency(n: int) -> list[str]:
    rows = [
        "| procedure | grade | placement, level and angle off by | told | NEES / coefficients | "
        "limits | inside | RMS error / sd, each coefficient |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for procedure in (six_position, ferraris):
        for name in ("mems", "tactical"):
            rows += [study(procedure, name, p, p, n) for p in (0.0, 5 * ARCMIN)]
    rows.append(study(ferraris, "tactical", 5 * ARCMIN, None, n))
    rows.append(study(ferraris, "tactical", 0.0, None, n))
    return rows


def main(n: int = SESSIONS) -> tuple[bool, dict[str, object]]:
    log, sections = session()
    earth = np.degrees(EARTH_RATE) * 3600
    return True, {
        "published": published(log, sections),
        "earth": earth,
        "likelihood": likelihood(log, sections),
        "n": n,
        "consistency": consistency(n),
    }
