"""Code for what is no IMU: a torqued cluster and a north seeker, in C, Python and JSON."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from foucault.coefficients import CoefficientVector, Layout
from foucault.export import write
from foucault.models.cluster import CONSTANTS, ClusterModel
from foucault.models.cluster import LAYOUT as CLUSTER
from foucault.models.layouts import BESIDE
from foucault.models.north_seeker import SEEKER, Compensation, earth_rate_b, up_b
from foucault.procedures.platform_tumble.settings import PRIOR
from foucault.result import Level, Result, Verdict
from make_exported import MAIN, load, run_c
from make_result import make_result
from make_terms import Same, with_terms
from refusals import refuses

GRAVITY = 9.81

NORTH_MAIN = r"""
#include <stdio.h>
#include "calibration.h"
int main(void)
{
    double index[5], gyro[5], accel[5], latitude, gravity, w[2], f[2], heading, pitch, roll;
    int k;
    while (scanf("%lf %lf", &latitude, &gravity) == 2) {
        for (k = 0; k < 5; k++)
            if (scanf("%lf %lf %lf", index + k, gyro + k, accel + k) != 3)
                return 1;
        foucault_components(5, index, gyro, w);
        foucault_components(5, index, accel, f);
        foucault_north(w, f, latitude, gravity, &heading, &pitch, &roll);
        printf("%.17g %.17g %.17g\n", heading, pitch, roll);
    }
    return 0;
}
"""


def of(procedure: str, layout: Layout, values: np.ndarray, **changes: Any) -> Result:
    vector = CoefficientVector(layout, values, np.diag(np.full(len(layout), 1e-20)))
    return make_result(procedure=procedure, coefficients=vector, tables={}, **changes)


@pytest.fixture
def cluster() -> Result:
    """Three times the usual errors: the terms of second order count, and an attitude besides."""
    rng = np.random.default_rng(1)
    sd = CoefficientVector.prior(CONSTANTS, PRIOR).prior_sd
    values = np.zeros(len(CLUSTER))
    at = [CLUSTER.index(name) for name in CONSTANTS.names]
    values[at] = 3 * sd * rng.standard_normal(len(sd))
    return of("platform_tumble", CLUSTER, values)


@pytest.fixture
def readings() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(2)
    return rng.uniform(-15, 15, (40, 3)), rng.uniform(-0.01, 0.01, (40, 3))


@pytest.fixture
def seeker() -> Result:
    sd = np.array([1e-2 if "scale" in n or "misalignment" in n else 1e-2 if "accel" in n else 1e-6
                   for n in SEEKER.names])  # fmt: skip
    return of("north_seeking", SEEKER, sd * np.random.default_rng(3).standard_normal(len(SEEKER)))


def stops(seeker: Result) -> tuple[np.ndarray, np.ndarray]:
    """Set-ups of five stops, with offsets: rows as the program reads them, and the truth."""
    rng = np.random.default_rng(4)
    n = 30
    angles = np.column_stack([rng.uniform(-np.pi, np.pi, n), *rng.uniform(-0.3, 0.3, (2, n))])
    latitude = rng.uniform(-1.2, 1.2, n)
    known = Compensation(seeker.coefficients)
    read = known.predict(earth_rate_b(*angles.T, latitude), GRAVITY * up_b(*angles.T[1:]))
    index = np.arange(5) * 2 * np.pi / 5 + rng.uniform(-0.2, 0.2, (n, 5))
    base = np.stack([np.sin(index), np.cos(index)], axis=-1)
    gyro = np.einsum("nki,ni->nk", base, read[:, :2]) + 1e-7
    accel = np.einsum("nki,ni->nk", base, read[:, 2:]) - 0.01
    rows = np.stack([index, gyro, accel], axis=-1).reshape(n, -1)
    return np.column_stack([latitude, np.full(n, GRAVITY), rows]), angles


def test_a_cluster_in_c(cluster: Result, readings: Any, tmp_path: Path, same: Same) -> None:
    text = write(cluster, "c", tmp_path / "calibration.h").read_text()
    assert "those of the cluster" in text
    f, w = cluster.model.compensate(*readings)
    how = ("-DFUNCTION=foucault_compensate", "-Wno-unused-function")
    got = run_c(tmp_path, MAIN, np.hstack(readings), *how)
    same(got[:, :3], f)
    same(got[:, 3:], w)


def test_a_cluster_in_python(cluster: Result, readings: Any, tmp_path: Path, same: Same) -> None:
    module = load(write(cluster, "python", tmp_path / "calibration.py"))
    f, w = cluster.model.compensate(*readings)
    pairs = zip(*(r.tolist() for r in readings), strict=True)
    got = [module.compensate(a, c) for a, c in pairs]
    same([one[0] for one in got], f)
    same([one[1] for one in got], w)


def test_a_cluster_in_json(cluster: Result, readings: Any, tmp_path: Path, same: Same) -> None:
    said = json.loads(write(cluster, "json", tmp_path / "calibration.json").read_text())
    assert said["format"] == "foucault.export.cluster/1"
    model = cluster.model
    assert isinstance(model, ClusterModel)
    np.testing.assert_array_equal(said["gyro_axes"], model.gyro_axes)
    np.testing.assert_array_equal(said["drift_g2"], model.drift_g2)
    same(np.array(said["input_inverse"]) @ model.input_axes, np.eye(3))
    assert "w = T^-1" in said["inverse"]


def test_a_north_seeker_in_c(seeker: Result, tmp_path: Path) -> None:
    write(seeker, "c", tmp_path / "calibration.h")
    rows, angles = stops(seeker)
    got = run_c(tmp_path, NORTH_MAIN, rows, "-Wno-unused-function")
    np.testing.assert_allclose(got, angles, atol=1e-12)


def test_a_north_seeker_in_python(seeker: Result, tmp_path: Path) -> None:
    module = load(write(seeker, "python", tmp_path / "calibration.py"))
    for row, angles in zip(*stops(seeker), strict=True):
        latitude, gravity, *rest = row.tolist()
        index, gyro, accel = np.reshape(rest, (5, 3)).T.tolist()
        parts = module.components(index, gyro), module.components(index, accel)
        np.testing.assert_allclose(module.north(*parts, latitude, gravity), angles, atol=1e-12)


def test_a_north_seeker_in_json(seeker: Result, tmp_path: Path) -> None:
    said = json.loads(write(seeker, "json", tmp_path / "calibration.json").read_text())
    known = Compensation(seeker.coefficients).model
    np.testing.assert_array_equal(said["gyro_matrix"], known.gyro_matrix[:2])
    np.testing.assert_array_equal(said["accel_bias"], known.accel_bias[:2])


@pytest.mark.parametrize("which", ["cluster", "seeker"])
def test_what_has_no_place(which: str, request: Any, tmp_path: Path) -> None:
    result: Result = request.getfixturevalue(which)
    for code, words in (
        ("export.cluster", {"receiver": "kalibr"}),
        ("export.whole", {"receiver": "c", "drop": ["gyro.bias"]}),
        ("export.whole", {"receiver": "json", "axes": "forward-right-down"}),
    ):
        with refuses(code) as caught:
            write(result, path=tmp_path / "x", **words)
        assert result.procedure in caught.value.message
    bad = of(result.procedure, result.coefficients.layout, result.coefficients.values,
             verdict=Verdict(Level.UNUSABLE, ("bad",)))  # fmt: skip
    with refuses("export.unusable"):
        write(bad, "c", tmp_path / "x")
    assert write(bad, "c", tmp_path / "x", force=True).is_file()


@pytest.mark.parametrize("receiver", ["c", "python"])
def test_no_g_sensitivity_no_block(receiver: str, tmp_path: Path) -> None:
    without = write(with_terms("gyro.bias"), receiver, tmp_path / "x").read_text().lower()
    assert "sensitivity[" not in without
    assert "g_sensitivity" not in without.replace("+ g_sensitivity f", "")
    assert "g_sensitivity" in write(
        with_terms("gyro.g_sensitivity"), receiver, tmp_path / "x"
    ).read_text().lower()  # fmt: skip


def test_what_a_slave_has_beside_its_sensors_is_left_out(tmp_path: Path) -> None:
    result = with_terms("gyro.bias", "accel.bias")
    vector = result.coefficients
    more = Layout((*vector.layout.coefficients, *BESIDE.coefficients))
    values = np.concatenate([vector.values, np.full(len(BESIDE), 0.1)])
    slave = of("transfer_alignment", more, values)
    got = write(slave, "c", tmp_path / "x").read_text().splitlines()
    want = write(result, "c", tmp_path / "y").read_text().splitlines()
    assert [line for line in got if "foucault_" in line] == [w for w in want if "foucault_" in w]


@pytest.mark.parametrize("receiver", ["c", "python", "json", "csv"])
def test_what_a_cube_says_of_its_mounting_is_no_slave(receiver: str, tmp_path: Path) -> None:
    """Six positions and turns say how each axis was clamped, under the same word."""
    result = with_terms("gyro.bias", "accel.bias")
    on_faces = replace(result, diagnostics={"mounting": [[0.0, 1e-3, 0.0]] * 3})
    got = write(on_faces, receiver, tmp_path / "x").read_text()
    assert "C_ms" not in got
