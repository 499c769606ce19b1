"""Kernels compiled before they are called: the table fits them, and is all that is needed."""

import importlib
import os
import subprocess
import sys

import pytest
from numba.core.sigutils import normalize_signature

from foucault import campaign
from foucault.kernels import ahead
from foucault.procedures import PROCEDURES

TABLE = ahead.table()


def test_the_table_names_what_there_is():
    assert set(TABLE["lanes"]) <= {*PROCEDURES, ahead.NORTH}
    names = {name for lanes in TABLE["lanes"].values() for lane in lanes for name in lane}
    assert names == set(TABLE["signatures"])
    for name in names:
        module, function = name.split(".")
        kernel = getattr(importlib.import_module(f"foucault.kernels.{module}"), function)
        arguments = kernel.py_func.__code__.co_argcount
        for signature in TABLE["signatures"][name]:
            assert len(normalize_signature(signature)[0]) == arguments


def test_only_what_is_missing_is_compiled(tmp_path):
    version = f"{sys.version_info[0]}{sys.version_info[1]}"
    assert ahead.missing(["pose.forward"], tmp_path)
    (tmp_path / "kernels_1").mkdir()
    (tmp_path / "kernels_1" / "pose.forward-7.py27.nbi").touch()
    assert ahead.missing(["pose.forward"], tmp_path)  # that of another Python
    (tmp_path / "kernels_1" / f"pose.forward-7.py{version}.nbi").touch()
    assert not ahead.missing(["pose.forward"], tmp_path)
    assert ahead.missing(["pose.forward", "pose.backward"], tmp_path)


def test_a_log_that_cannot_be_read_stops_the_compiling(tmp_path, monkeypatch):
    started = []
    real = subprocess.Popen
    monkeypatch.setattr(ahead, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(ahead.os, "cpu_count", lambda: 2)
    monkeypatch.setattr(
        ahead.subprocess, "Popen", lambda *a, **k: started.append(real(*a, **k)) or started[-1]
    )
    with (
        pytest.raises(OSError, match="no such log"),
        ahead.compiling("north_seeking", lambda *_: None),
    ):
        raise OSError("no such log")
    assert len(started) == (1 if hasattr(os, "fork") else 2)
    assert all(process.poll() is not None for process in started)
    already = len(started)
    with ahead.compiling("norm_observation", lambda *_: None):
        pass
    assert len(started) == already


def test_a_campaign_s_file_begins_it_before_it_is_read(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(ahead, "_start", lambda procedure: asked.append(procedure) or [])
    file = tmp_path / "campaign.toml"
    for text in ("", "[procedure]", "no = toml = at all", "\x00"):
        file.write_text(text, encoding="utf-8")
        ahead.begin(file)
    ahead.begin(tmp_path)
    assert not asked
    file.write_text('[procedure]\nname = "imu_pose"', encoding="utf-8")
    ahead.begin(file)
    with ahead.compiling("imu_pose", lambda *_: None):
        assert asked == ["imu_pose"]
    with ahead.compiling("imu_pose", lambda *_: None):
        assert asked == ["imu_pose"] * 2


CALIBRATE = """
import sys
from foucault.campaign import calibrate, north
from foucault.campaign.tables import Said
if sys.argv[2] != "north":
    calibrate(sys.argv[1])
else:
    said = Said(latitude=0.8, gyro_noise=1e-6, accel_noise=1e-3)
    north.run(sys.argv[1].replace("campaign.toml", "log.csv"), said)
for module in list(sys.modules.values()):
    if module.__name__.startswith("foucault.kernels."):
        for f in vars(module).values():
            if hasattr(f, "stats"):
                name = f.py_func.__module__.split(".")[-1] + "." + f.py_func.__name__
                for signature in f.signatures:
                    print(name, bool(f.stats.cache_misses), signature, sep="; ")
"""


def called(procedure, folder, **more):
    """Return the kernels that a calibration calls, whether it compiled them, and with what."""
    made = "north_seeking" if procedure == ahead.NORTH else procedure
    one = campaign.parse(campaign.template(made), f"{made}.toml")
    session = campaign.save_session(campaign.simulate(one, 1), folder / "session")
    out = subprocess.run(
        [sys.executable, "-c", CALIBRATE, str(session), procedure],
        check=True, capture_output=True, text=True, env=os.environ | more,
    ).stdout  # fmt: skip
    return [line.split("; ") for line in out.splitlines()]


@pytest.mark.thorough
@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="compiles ahead on two cores only")
def test_a_calibration_compiles_nothing_of_the_table_itself(tmp_path):
    rows = called("north_seeking", tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    compiled = {name for name, missed, _ in rows if missed == "True"}
    assert rows and not compiled & set(TABLE["signatures"])


@pytest.mark.thorough
@pytest.mark.parametrize("procedure", TABLE["lanes"])
def test_the_table_has_what_a_calibration_calls_it_with(procedure, tmp_path):
    """So that nothing of it is left to compile: what no cache is needed to see."""
    lanes = {name for lane in TABLE["lanes"][procedure] for name in lane}
    ours = [(n, used) for n, _, used in called(procedure, tmp_path) if n in TABLE["signatures"]]
    assert ours
    for name, used in ours:
        assert name in lanes
        ahead_ = [str(normalize_signature(s)[0]) for s in TABLE["signatures"][name]]
        assert used in ahead_, name


WARM = """
import sys
import numpy as np
from foucault.kernels.moving import moving_moments
for kind in sys.argv[1:]:
    mean, variance = moving_moments(np.arange(12, dtype=kind).reshape(4, 3), 3)
    assert mean[1].tolist() == [3.0, 4.0, 5.0] and variance[1, 0] == 9.0
    print(sum(moving_moments.stats.cache_hits.values()), "numba.np.linalg" in sys.modules)
"""


@pytest.mark.thorough
def test_what_is_compiled_is_loaded_without_what_compiles(tmp_path):
    env = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}

    def told(*kinds):
        run = [sys.executable, "-c", WARM, *kinds]
        return subprocess.run(run, check=True, capture_output=True, text=True, env=env).stdout

    assert told("f8").split() == ["0", "True"]
    assert told("f8", "i8").split() == ["1", "False", "1", "True"]
