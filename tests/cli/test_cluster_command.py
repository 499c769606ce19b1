"""Studies on Dask: the same content as threads give, whatever is killed, and clear mistakes."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import dask
import numpy as np
import psutil
import pyarrow.parquet as pq
import pytest
from distributed import Client, LocalCluster
from distributed.utils import get_mp_context
from llvmlite import binding

import foucault
from commands import run
from foucault import campaign
from foucault.campaign import optimisation, study
from foucault.cli import cluster
from foucault.cli.screen import Screen
from foucault.errors import FoucaultError
from refusals import refuses

TRIALS = 120
QUICK = """
[site]
latitude = "48 deg"
[log]
file = "log.csv"
[procedure]
name = "six_position"
[simulate]
rest_time = "4 s"
move_time = "1 s"
rate = "50 Hz"
"""
ONE_BLAS_THREAD = dict.fromkeys(cluster.THREADS, "1")
SILENT = Screen(quiet=True)


@pytest.fixture(autouse=True)
def one_blas_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """As the command line sets it before NumPy is loaded."""
    for name, value in ONE_BLAS_THREAD.items():
        monkeypatch.setenv(name, value)


def local(workers: int, **more: Any) -> LocalCluster:
    """Return a cluster of this machine, any port free for its dashboard."""
    return LocalCluster(
        n_workers=workers, threads_per_worker=1, dashboard_address="127.0.0.1:0",
        protocol="tcp://", silence_logs=50, **more,
    )  # fmt: skip


@pytest.fixture(scope="module")
def four() -> Iterator[Any]:
    """Four processes that other tests compute on, forked from one that has imported the package."""
    imported = ["distributed", "foucault.campaign.study", "foucault.campaign.optimisation"]
    with dask.config.set({"distributed.worker.multiprocessing-method": "forkserver"}):
        get_mp_context().set_forkserver_preload([*imported, "foucault.procedures.six_position"])
        with local(4, env=ONE_BLAS_THREAD) as made:
            yield made


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a campaign file whose trials are short."""
    path = tmp_path_factory.mktemp("quick") / "quick.toml"
    path.write_text(QUICK)
    return path


@pytest.fixture(scope="module")
def undisturbed(quick: Path) -> Path:
    """Return the study of one worker that nobody killed."""
    folder = quick.parent / "undisturbed"
    study.run(campaign.load(quick), TRIALS, folder, seed=2, workers=1)
    return folder / study.TRIALS_FILE


def over(address: str, described: campaign.Campaign, n: int, folder: Path, **more: Any) -> Path:
    """Run a study on the cluster at an address."""
    with cluster.spread(SILENT, None, address, None) as map_:
        study.run(described, n, folder, seed=2, map=map_, **more)
    return folder / study.TRIALS_FILE


# -- the same content ------------------------------------------------------------------------


@pytest.mark.thorough
def test_one_worker_four_threads_and_four_processes_give_identical_content(
    four: Any, quick: Path, undisturbed: Path, tmp_path: Path
) -> None:
    described = campaign.load(quick)
    study.run(described, TRIALS, tmp_path / "threads", seed=2, workers=4)
    processes = over(four.scheduler_address, described, TRIALS, tmp_path / "processes")
    threads = tmp_path / "threads" / study.TRIALS_FILE
    assert undisturbed.read_bytes() == threads.read_bytes() == processes.read_bytes()
    table = pq.read_table(processes)
    assert table["trial"].to_pylist() == list(range(TRIALS))
    assert len(set(table["seed"].to_pylist())) == TRIALS


@pytest.mark.thorough
def test_a_tumble_gives_identical_content(four: Any, tmp_path: Path) -> None:
    text = campaign.template("platform_tumble")
    described = campaign.parse(text, "platform_tumble.toml")
    study.run(described, 6, tmp_path / "one", seed=2, workers=1)
    processes = over(four.scheduler_address, described, 6, tmp_path / "processes")
    one = tmp_path / "one" / study.TRIALS_FILE
    assert one.read_bytes() == processes.read_bytes()


@pytest.mark.thorough
def test_a_search_finds_the_same_plan(four: Any, tmp_path: Path) -> None:
    asked = ("--restarts", 6, "--evaluations", 40, "--round", 4, "--seed", 3)
    file = tmp_path / "campaign.toml"
    text = campaign.template("platform_tumble").partition("# [optimise]")[0]
    file.write_text(f"{text}\n[optimise]\nlatitudes = []\ntruths = 1\n")
    ways = {"threads": ("--workers", 2), "processes": ("--scheduler", four.scheduler_address)}
    for name, way in ways.items():
        done = run("optimise", file, "-o", tmp_path / name, *asked, *way)
        assert done.exit_code in (0, 3), done.output
    for name in (optimisation.RESTARTS_FILE, optimisation.CAMPAIGN_FILE):
        here, there = tmp_path / "threads" / name, tmp_path / "processes" / name
        assert here.read_bytes() == there.read_bytes(), name


@pytest.mark.thorough
def test_the_seed_of_a_study_decides_what_is_simulated(quick: Path, tmp_path: Path) -> None:
    made = []
    for folder, seed, workers in (("a", 3, 1), ("b", 3, 2), ("c", 4, 1)):
        words = ("-n", 3, "-o", tmp_path / folder, "--seed", seed, "--workers", workers)
        assert run("montecarlo", quick, *words).exit_code in (0, 3)
        made.append((tmp_path / folder / study.TRIALS_FILE).read_bytes())
    assert made[0] == made[1] != made[2]


@pytest.mark.thorough
def test_a_study_of_means_goes_to_processes_too(tmp_path: Path) -> None:
    made = []
    for name, way in (("threads", ("--workers", 2)), ("processes", ("--local-cluster", 2))):
        words = ("six_position", "-n", 5000, "-o", tmp_path / name, "--batched", *way)
        assert run("montecarlo", *words).exit_code in (0, 3)
        made.append((tmp_path / name / study.TRIALS_FILE).read_bytes())
    assert made[0] == made[1]


# -- what is killed --------------------------------------------------------------------------


@pytest.mark.thorough
def test_a_worker_that_is_killed_changes_nothing(
    four: Any, quick: Path, undisturbed: Path, tmp_path: Path
) -> None:
    with Client(four) as client:
        before = client.run(os.getpid)
    victims = [*before.values()][:1]

    def kill(done: int, total: int) -> None:
        if done == 10 and victims:
            for pid in victims:
                os.kill(pid, signal.SIGKILL)
            victims.clear()

    described = campaign.load(quick)
    disturbed = over(four.scheduler_address, described, TRIALS, tmp_path, progress=kill)
    assert not victims
    assert disturbed.read_bytes() == undisturbed.read_bytes()


def begun(quick: Path, folder: Path, processes: int) -> subprocess.Popen[str]:
    """Begin a study on so many processes and wait until a part of it is finished."""
    command = [sys.executable, "-m", "foucault", "montecarlo", str(quick), "-n", str(TRIALS)]
    command += ["-o", str(folder), "--seed", "2", "--local-cluster", str(processes)]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        start_new_session=True,
    )  # fmt: skip
    had, deadline = len(finished(folder)), time.monotonic() + 60
    while len(finished(folder)) == had:
        assert time.monotonic() < deadline
        assert process.poll() is None, process.communicate()[0]
        time.sleep(0.002)
    return process


def finished(folder: Path) -> dict[str, int]:
    return {f.name: f.stat().st_mtime_ns for f in (folder / study.FOLDER).glob("0*.parquet")}


def ended(children: list[psutil.Process]) -> bool:
    return psutil.wait_procs(children, timeout=20)[1] == []


@pytest.mark.thorough
def test_a_study_that_is_interrupted_then_killed_then_resumed_equals_an_undisturbed_one(
    quick: Path, undisturbed: Path, tmp_path: Path
) -> None:
    process = begun(quick, tmp_path, 1)
    children = psutil.Process(process.pid).children(recursive=True)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: workers hear it too
    said = process.communicate(timeout=60)[0]
    assert process.returncode == 130
    assert "Dashboard: http://127.0.0.1:" in said
    assert "interrupted" in said and "Traceback" not in said
    assert ended(children)

    process = begun(quick, tmp_path, 2)
    children = psutil.Process(process.pid).children(recursive=True)
    process.kill()
    process.communicate()
    assert ended(children)
    kept = finished(tmp_path)
    assert not (tmp_path / study.TRIALS_FILE).exists()
    assert 2 <= len(kept) < len(finished(undisturbed.parent))

    study.run(campaign.load(quick), TRIALS, tmp_path, seed=2, workers=2)
    assert kept.items() <= finished(tmp_path).items()
    assert (tmp_path / study.TRIALS_FILE).read_bytes() == undisturbed.read_bytes()


def test_batches_that_kill_their_workers_end_the_work(four: Any) -> None:
    four.scheduler.allowed_failures, before = 0, four.scheduler.allowed_failures
    try:
        with (
            cluster.spread(SILENT, None, four.scheduler_address, None) as map_,
            pytest.raises(FoucaultError, match="1 workers in turn ended") as problem,
        ):
            list(map_(os._exit, [1]))
        assert problem.value.code == "cluster.killed" and "memory" in problem.value.cure
    finally:
        four.scheduler.allowed_failures = before


def test_a_scheduler_that_ends_is_an_error_that_says_so() -> None:
    with (
        local(1, processes=False) as other,
        cluster.spread(SILENT, None, other.scheduler_address, None) as map_,
    ):
        rows = map_(time.sleep, [0.0] + [0.05] * 400)
        next(iter(rows))
        other.close()
        with pytest.raises(FoucaultError, match=r"connection to the scheduler .* was lost"):
            list(rows)


def test_no_more_batches_are_out_than_workers_need(four: Any) -> None:
    taken: list[int] = []

    def items() -> Iterator[int]:
        for i in range(10**6):
            taken.append(i)
            yield i

    with cluster.spread(SILENT, None, four.scheduler_address, None) as map_:
        rows = map_(abs, items())
        assert [next(rows) for _ in range(3)] == [0, 1, 2]
        assert len(taken) <= 4 * cluster.AHEAD * 4 + cluster.MOST * 4
        rows.close()


# -- mistakes ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options",
    [
        ("--workers", "2", "--scheduler", "tcp://127.0.0.1:1"),
        ("--workers", "2", "--local-cluster", "2"),
        ("--scheduler", "tcp://127.0.0.1:1", "--local-cluster", "2"),
    ],
)
def test_two_ways_to_compute_are_refused(options: tuple[str, ...], tmp_path: Path) -> None:
    result = run("montecarlo", "six_position", "-n", 2, "-o", tmp_path / "out", *options, code=1)
    assert f"{options[0]} and {options[2]} cannot be given together" in result.stderr
    assert not (tmp_path / "out").exists()


def test_an_address_that_does_not_answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "ANSWER", 0.4)
    with socket.socket() as mute:
        mute.bind(("127.0.0.1", 0))
        mute.listen()
        quiet = f"127.0.0.1:{mute.getsockname()[1]}"
        for address, words in (
            ("tcp://127.0.0.1:9", "nothing was heard for"),
            (quiet, "nothing was heard for"),
            ("somewhere", "missing port number"),
            ("mail://host:1", "unknown address scheme"),
            ("tls://127.0.0.1:9", "TLS expects"),
            ("", "missing port number"),  # of a variable that is not set
        ):
            result = run(
                "montecarlo", "six_position", "-o", tmp_path, "--scheduler", address, code=1
            )
            assert f"No Dask scheduler answers at {address}: {words}" in result.stderr
            assert "dask scheduler" in result.stderr


def test_the_address_of_a_worker_is_no_scheduler(four: Any) -> None:
    with Client(four) as client:
        worker = next(iter(client.nthreads()))
    with pytest.raises(FoucaultError, match="what answers there is a Dask worker"):
        over(worker, campaign.parse(QUICK), 2, Path("never"))


def test_a_scheduler_without_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "PATIENCE", 0.3)
    with (
        local(0) as empty,
        pytest.raises(FoucaultError, match="has had no worker for 0 s") as problem,
        cluster.spread(SILENT, None, empty.scheduler_address, None),
    ):
        pass
    assert f"dask worker {empty.scheduler_address}" in problem.value.cure


def test_workers_that_leave_for_good(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "PATIENCE", 0.3)
    monkeypatch.setattr(cluster, "LOOK", 0.1)
    with (
        local(1, processes=False) as other,
        cluster.spread(SILENT, None, other.scheduler_address, None) as map_,
    ):
        rows = map_(time.sleep, [0.0] + [0.3] * 40)
        next(iter(rows))
        other.scale(0)
        with pytest.raises(FoucaultError, match="has had no worker for 0 s"):
            list(rows)


def test_a_worker_with_other_software_is_named(four: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    other = cluster._software() | {"numpy": "1.9.9"}
    monkeypatch.setattr(cluster, "_software", lambda: other)
    with pytest.raises(FoucaultError, match=r"Worker tcp://127\.0\.0\.1:\d+ has numpy") as problem:
        over(four.scheduler_address, campaign.parse(QUICK), 2, Path("never"))
    assert f"numpy {np.__version__}; this machine has numpy 1.9.9" in problem.value.message
    late = cluster._about() | {"foucault": "0.0.9"}
    with (  # one that comes when the work has begun
        Client(four) as client,
        pytest.raises(FoucaultError, match=r"this machine has foucault 0\.0\.9"),
    ):
        client.submit(cluster._batch, b"", [1], late).result()


def test_a_worker_with_other_blas_threads_is_named(
    four: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    with refuses("cluster.threads", "has OPENBLAS_NUM_THREADS=1; this"):
        over(four.scheduler_address, campaign.parse(QUICK), 2, Path("never"))


def test_other_processors_are_told(
    four: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(binding, "get_host_cpu_name", lambda: "abacus")
    with cluster.spread(Screen(), None, four.scheduler_address, None):
        pass
    assert "different kinds of processors: abacus, " in capsys.readouterr().out


def test_without_the_package_it_is_said_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    result = run("montecarlo", "six_position", "-o", tmp_path, "--local-cluster", 2, code=1)
    assert "--local-cluster needs the package distributed" in result.stderr
    assert 'pip install "foucault[dask]"' in result.stderr


def test_one_file_knows_dask() -> None:
    root = Path(foucault.__file__).parent
    words = ("import dask", "import distributed", "from dask", "from distributed")
    knows = {
        p.relative_to(root) for p in root.rglob("*.py") if any(w in p.read_text() for w in words)
    }
    assert knows == {Path("cli/cluster.py")}
