"""A synthetic hand-rotated result with realistic numbers, for tests of what consumes results."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from foucault import units
from foucault.coefficients import CoefficientVector
from foucault.errors import Finding, Status
from foucault.models.imu import EQUATION, LAYOUT, LINEAR_LOWER, Gauge
from foucault.result import Check, Level, Result, Verdict

GRAVITY = 9.81744
N_RESTS = 24

# value spread and sd of each family of coefficients
_FAMILIES = {
    "accel.bias": ("30 mg", "60 ug"),
    "accel.scale": ("4000 ppm", "45 ppm"),
    "accel.misalignment": ("20 arcmin", "9 arcsec"),
    "gyro.bias": ("1200 deg/h", "4 deg/h"),
    "gyro.scale": ("5000 ppm", "180 ppm"),
    "gyro.misalignment": ("30 arcmin", "40 arcsec"),
}


def make_result(seed: int = 7, level: Level = Level.PASS, **changes: Any) -> Result:
    """Return a hand-rotated calibration of 24 rests; `changes` replace fields of the Result."""
    rng = np.random.default_rng(seed)
    checks = _checks(level)
    coefficients = _coefficients(rng)
    tables = {"rests": _rests(rng), "turns": _turns(rng)}
    tables["detection"] = _detection(rng, tables["rests"])
    result = Result(
        procedure="hand-rotated",
        coefficients=coefficients,
        equation=EQUATION,
        frame="body axes b, right-forward-up",
        gauge=Gauge.LOWER.value,
        verdict=Verdict.of(checks),
        checks=checks,
        findings=(
            Finding(
                "log.gap",
                "warning",
                "3 samples are missing between 211.40 s and 211.44 s.",
                "The turn there is integrated across the gap; check the logger's write rate.",
            ),
        ),
        status=Status.CONVERGED,
        instrument={"name": "MTi-28", "serial": "0180-2214", "operator": "", "grade": "mems"},
        site={
            "latitude": float(np.deg2rad(45.41)),
            "height": 31.0,
            "gravity": GRAVITY,
            "gravity_source": "given",
            "gravity_sd": 2e-5,
        },
        validity={"duration": 482.0, "temperature": [296.1, 299.4]},
        diagnostics=_diagnostics() | _uncertainty(coefficients),
        provenance={
            "versions": {"foucault": "0.1.0", "numpy": "2.4.6", "scipy": "1.17.1"},
            "inputs": [{"file": "session.csv", "sha256": "9f2c" * 16, "size": 7_340_120}],
            "seed": seed,
            "created": "2025-03-14T09:26:53+01:00",
            "seconds": 0.237,
        },
        tables=tables,
    )
    return dataclasses.replace(result, **changes)


def _coefficients(rng: np.random.Generator) -> CoefficientVector:
    layout = LAYOUT.subset(LINEAR_LOWER)
    spread, sd, prior = (np.empty(len(layout)) for _ in range(3))
    for i, c in enumerate(layout.coefficients):
        wide, narrow = _FAMILIES[c.name.rpartition(".")[0]]
        spread[i], sd[i] = units.parse(wide, c.kind), units.parse(narrow, c.kind)
        prior[i] = 3 * spread[i] if c.name.startswith("gyro.bias") else np.inf
    mixing = np.eye(len(layout)) + 0.25 * rng.normal(size=(len(layout), len(layout)))
    raw = mixing @ mixing.T
    scale = sd / np.sqrt(np.diag(raw)) * rng.uniform(0.7, 1.4, len(layout))
    cov = raw * np.outer(scale, scale)
    return CoefficientVector(
        layout, spread * rng.normal(size=len(layout)), (cov + cov.T) / 2, prior_sd=prior
    )


def _directions(rng: np.random.Generator) -> np.ndarray:
    """Up directions well spread, but with the region round -y left out."""
    k = np.arange(400) + 0.5
    z = 1 - 2 * k / 400
    angle = np.pi * (1 + 5**0.5) * k
    all_up = np.column_stack(
        [np.sqrt(1 - z * z) * np.cos(angle), np.sqrt(1 - z * z) * np.sin(angle), z]
    )
    allowed = all_up[all_up[:, 1] > -0.75]
    return allowed[rng.permutation(len(allowed))[:N_RESTS]]


def _rests(rng: np.random.Generator) -> dict[str, np.ndarray]:
    up = _directions(rng)
    start = 30.0 + np.arange(N_RESTS) * 18.5 + rng.uniform(0, 2, N_RESTS)
    start[0] = 0.0
    end = start + rng.uniform(6, 11, N_RESTS)
    end[0] = 28.0
    sd = rng.uniform(150e-6, 260e-6, N_RESTS) * 9.80665
    after = sd * rng.normal(size=N_RESTS)
    before = 0.25 * (up @ np.array([0.6, -0.8, 0.5])) + 0.03 * rng.normal(size=N_RESTS)
    held_sd = 1.25 * sd
    accel = up * (GRAVITY + before)[:, None]
    gyro = np.array([0.006, -0.004, 0.003]) + 2e-5 * rng.normal(size=(N_RESTS, 3))
    columns: dict[str, np.ndarray] = {
        "first": np.round(start * 100).astype(np.int64),
        "last": np.round(end * 100).astype(np.int64) + 1,
        "start": start,
        "end": end,
    }
    for name, block in (("accel", accel), ("gyro", gyro), ("up", up)):
        columns |= {f"{name}_{a}": block[:, i].copy() for i, a in enumerate("xyz")}
    held_out = held_sd * rng.normal(size=N_RESTS)
    held_out[5] = np.nan  # a rest that was not held out
    weight = np.ones(N_RESTS)
    weight[11] = 0.42
    residual = np.abs(rng.normal(size=(N_RESTS, 3))).max(axis=1)
    residual[11] = 4.1
    return columns | {
        "norm_before": GRAVITY + before,
        "norm_after": GRAVITY + after,
        "norm_sd": sd,
        "held_out": held_out,
        "held_out_sd": held_sd,
        "residual": residual,
        "weight": weight,
    }


def _turns(rng: np.random.Generator) -> dict[str, np.ndarray]:
    n = N_RESTS - 1
    start = 28.0 + np.arange(n) * 18.5
    angle = rng.uniform(0.6, 2.6, n)
    error = 8e-4 * rng.normal(size=(n, 3))
    return {
        "start": start,
        "end": start + rng.uniform(3, 7, n),
        "angle": angle,
        "path": angle * rng.uniform(1.0, 1.4, n),
        **{f"error_{a}": error[:, i].copy() for i, a in enumerate("xyz")},
        "residual": np.abs(rng.normal(size=(n, 2))).max(axis=1),
        "weight": np.ones(n),
    }


def _detection(rng: np.random.Generator, rests: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    time = np.linspace(0.0, float(rests["end"][-1]) + 6.0, 3000)
    quiet = np.zeros(time.size, bool)
    for start, end in zip(rests["start"], rests["end"], strict=True):
        quiet |= (time >= start) & (time <= end)
    moving = 10 ** (1.7 + 0.35 * np.sin(time * 1.3) + 0.1 * rng.normal(size=time.size))
    noise = 1 + 0.12 * rng.normal(size=time.size)
    accel = np.where(quiet, noise, moving)
    gyro = np.where(quiet, 1 + 0.1 * rng.normal(size=time.size), 3 * moving)
    return {
        "time": time,
        "accel_level": accel,
        "gyro_level": gyro,
        "level": np.maximum(accel, gyro),
    }


def _diagnostics() -> dict[str, Any]:
    return {
        "gravity": GRAVITY,
        "detection": {"threshold": 4.2, "window": 1.01, "rests": N_RESTS, "rest_time": 224.0},
        "coverage": {
            "missing": [
                {"direction": [0.0, -1.0, 0.0], "words": "y down"},
                {"direction": [0.31, -0.9, -0.31], "words": "y down, tilted to +x and -z"},
            ],
            "largest_gap": 0.71,
            "directions": 22,
        },
        "noise": {
            "source": "measured in the rests",
            "accel": [1.1e-3, 1.0e-3, 1.2e-3],
            "gyro": [8e-4, 7e-4, 8e-4],
        },
        "chi_square": {"accel": [14.8, 5.2, 30.6, 15], "gyro": [37.1, 18.4, 59.3, 34]},
    }


def _uncertainty(coefficients: CoefficientVector) -> dict[str, Any]:
    """Bound, budget and what was not seen, as a procedure gives them."""
    variance = coefficients.sd**2
    n = len(coefficients)
    gravity = np.where([name.startswith("accel.scale") for name in coefficients.names], 0.6, 0.0)
    accel = np.linspace(0.9, 0.1, n) * (1 - gravity)
    shares = {
        "accelerometer noise": accel,
        "gyro noise": 1 - accel - gravity,
        "local gravity": gravity,
    }
    return {
        "bound": (coefficients.sd / 1.25).tolist(),
        "weakest": ["+0.71 accel.bias.y -0.70 accel.scale.y: 6.2 times less certain together"],
        "budget": {source: (share * variance).tolist() for source, share in shares.items()},
        "unseen": ["A wrong local gravity: 1 ppm of g is 1 ppm in all scale factors."],
    }


def _checks(level: Level) -> tuple[Check, ...]:
    few = level is Level.UNUSABLE
    doubtful = level is Level.DOUBTFUL
    return (
        Check(
            "number of rests",
            7.0 if few else 24.0,
            9.0,
            None,
            not few,
            "7 rests cannot determine 9 accelerometer coefficients: add at least 5 rests in new "
            "orientations."
            if few
            else "24 rests are enough for 9 accelerometer coefficients.",
            Level.UNUSABLE,
        ),
        Check(
            "largest gap of orientations",
            0.71,
            None,
            0.6 if doubtful else 0.8,
            not doubtful,
            "No rest within 40 deg of y down: add rests there."
            if doubtful
            else "No direction is farther than 41 deg from a rest.",
        ),
        Check(
            "accelerometer chi-square",
            14.8,
            5.2,
            30.6,
            True,
            "The accelerometer residuals agree with the noise measured in the rests.",
        ),
        Check(
            "gyro chi-square",
            37.1,
            18.4,
            59.3,
            True,
            "The gyro residuals agree with the noise measured in the rests.",
        ),
        Check("held-out rests", 1.04, 0.6, 1.5, True, "Rests left out are predicted within sd."),
    )
