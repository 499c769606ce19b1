"""Where trials are computed: threads, processes of this machine, or a cluster of Dask.

The only file that knows Dask. `spread` gives a map as `monte_carlo` wants it. Over Dask the items
go in batches that take about a second each, so that what a batch costs beside its work stays
small; no more batches are out than the workers need to stay busy, so that a million trials are
never queued; results come back in order. A batch whose worker is lost is computed again by
another, and because a trial depends on nothing but its number, the content is the same.
"""

from __future__ import annotations

import hashlib
import logging
import os
import pickle
import platform
import signal
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cache, lru_cache
from itertools import islice
from operator import length_hint
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from foucault.cli.screen import Screen
from foucault.errors import FoucaultError, error, finding

if TYPE_CHECKING:
    from foucault.monte_carlo import Map

S = TypeVar("S")
T = TypeVar("T")

ANSWER, PATIENCE, LOOK = 10.0, 120.0, 5.0
"""How long a scheduler has to answer, how long it may be without workers, and how often the
number of workers is looked at [s]."""

BATCH, PER_WORKER = 1.0, 0.01
"""A batch should take so long, and at least so long per worker of the cluster, because all batches
pass through one scheduler [s]."""

MOST = 10_000  # Items in a batch [1].
AHEAD = 4  # Batches that are out per worker [1].
DEATHS = 10  # Workers of this machine that a batch may lose before it is given up [1].

PACKAGES = ("foucault", "numpy", "scipy", "numba")
THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")

Workers = Annotated[
    int | None, typer.Option(help="Threads; as many as processors if left out.", min=1, max=1024)
]
Scheduler = Annotated[
    str | None,
    typer.Option(help="Compute on the cluster of this Dask scheduler, such as tcp://host:8786."),
]
LocalCluster = Annotated[
    int | None,
    typer.Option(help="Compute in so many processes of this machine, by Dask.", min=1, max=1024),
]


@contextmanager
def spread(
    screen: Screen, workers: int | None, scheduler: str | None, local_cluster: int | None
) -> Iterator[Map]:
    """Yield a map over threads, over processes of this machine, or over a cluster.

    `screen`: told where the dashboard is; `workers`: threads, None takes as many as processors;
    `scheduler`: address of a Dask scheduler; `local_cluster`: processes.
    """
    options = {"--workers": workers, "--scheduler": scheduler, "--local-cluster": local_cluster}
    given = [name for name, value in options.items() if value is not None]
    if len(given) > 1:
        raise error("cluster.options", options=" and ".join(given))
    if scheduler is None and local_cluster is None:
        from foucault import monte_carlo

        yield monte_carlo.threads(workers or os.cpu_count() or 1)
        return
    try:
        import dask

        # It logs every worker that comes and goes; what matters is said by errors of ours.
        dask.config.set({"logging": {"distributed": "critical", "distributed.client": "critical"}})
        import distributed  # noqa: F401
    except ImportError:
        raise error("cluster.missing", option=given[0]) from None
    with ExitStack() as stack:
        address = _local(stack, local_cluster or 1) if scheduler is None else scheduler
        client = _connected(stack, address)
        screen.say(f"Dashboard: {client.dashboard_link}")
        map_ = _Over(client, address)
        map_.refuse_unlike(screen)
        yield map_


def _local(stack: ExitStack, processes: int) -> str:
    import dask
    import distributed

    stack.enter_context(dask.config.set({"distributed.scheduler.allowed-failures": DEATHS}))
    # Ctrl-C goes to all processes of a terminal; half a cluster cannot be closed in peace.
    heard = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        cluster = distributed.LocalCluster(
            n_workers=processes, threads_per_worker=1, dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL, preload=[__name__],
            env={name: os.environ[name] for name in THREADS if name in os.environ},
        )  # fmt: skip
        stack.enter_context(cluster)
    finally:
        signal.signal(signal.SIGINT, heard)
    return str(cluster.scheduler_address)


def dask_setup(_worker: Any) -> None:
    """Let a worker of this machine not hear Ctrl-C: we end it.

    Dask calls this in every worker that begins, those that replace a lost one too.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _connected(stack: ExitStack, address: str) -> Any:
    import asyncio

    import distributed

    try:
        kind = asyncio.run(asyncio.wait_for(_knock(address), ANSWER))
        if kind != "Scheduler":
            raise ValueError(f"what answers there is a Dask {kind.lower()}")
        client = distributed.Client(address, timeout=ANSWER)
    except TimeoutError:
        reason = f"nothing was heard for {ANSWER:.0f} s"
        raise error("cluster.no_answer", address=address, reason=reason) from None
    except (OSError, ValueError, TypeError) as problem:  # TypeError: tls:// without a certificate
        raise error("cluster.no_answer", address=address, reason=problem) from None
    return stack.enter_context(client)


async def _knock(address: str) -> str:
    """Return what kind of server answers; a client alone waits for ever for one that is mute."""
    from distributed import Security, rpc

    async with rpc(address, connection_args=Security().get_connection_args("client")) as server:
        return str((await server.identity())["type"])


# -- what must be the same everywhere --------------------------------------------------------


def _about() -> dict[str, str]:
    """Return what the last digits of a result depend on, here."""
    from llvmlite import binding

    threads = {name: os.environ.get(name, "unset") for name in THREADS}
    return _software() | threads | {"processor": binding.get_host_cpu_name()}


@cache
def _software() -> dict[str, str]:
    import importlib.metadata

    import foucault

    source = hashlib.sha256()
    for path in sorted(Path(foucault.__file__).parent.rglob("*.py")):
        source.update(path.read_bytes())
    said = {name: importlib.metadata.version(name) for name in PACKAGES}
    said["foucault"] += f" (source {source.hexdigest()[:8]})"
    return said | {"python": ".".join(platform.python_version_tuple()[:2])}


def _refuse(worker: str, there: dict[str, str], here: dict[str, str]) -> None:
    """Raise where the software of a worker is not that of this machine."""
    for code, names in (("cluster.version", (*PACKAGES, "python")), ("cluster.threads", THREADS)):
        unlike = [name for name in names if there[name] != here[name]]
        if unlike:
            mark = "=" if code == "cluster.threads" else " "
            theirs, ours = (
                ", ".join(f"{name}{mark}{said[name]}" for name in unlike) for said in (there, here)
            )
            raise error(code, worker=worker, theirs=theirs, ours=ours)


# -- on a worker -----------------------------------------------------------------------------


@lru_cache(maxsize=2)
def _unpacked(packed: bytes) -> Callable[[Any], Any]:
    """Return the function of a study; it is unpacked once per process, not once per batch."""
    function: Callable[[Any], Any] = pickle.loads(packed)
    return function


def _batch(packed: bytes, items: list[Any], here: dict[str, str]) -> tuple[list[Any], float]:
    """Apply a function to a batch; return what came out and the time that it took [s]."""
    from distributed import get_worker

    _refuse(get_worker().address, _about(), here)  # it may have come later than the others
    started = time.perf_counter()
    function = _unpacked(packed)
    return [function(item) for item in items], time.perf_counter() - started


# -- on this machine -------------------------------------------------------------------------


class _Over:
    """A map over the workers of a client."""

    def __init__(self, client: Any, address: str) -> None:
        self.client, self.address = client, address
        self.threads, self.looked = 0, -LOOK

    def __call__(self, function: Callable[[S], T], items: Iterable[S], /) -> Iterator[T]:
        packed, size = pickle.dumps(function), 1
        rest, out = iter(items), deque[Any]()
        try:
            while True:
                while len(out) < AHEAD * max(self.count(), 1):
                    batch = list(islice(rest, size))
                    if not batch:
                        break
                    out.append(self.client.submit(_batch, packed, batch, _about(), pure=False))
                if not out:
                    return
                done, seconds = self._result(out.popleft())
                size = self._size(seconds / len(done), length_hint(rest))
                yield from done
        finally:  # what was interrupted must not be computed to its end
            self.client.cancel([*out])

    def _size(self, seconds: float, left: int) -> int:
        """Return how many items to put into the next batch; a known rest is shared evenly."""
        aim = max(BATCH, PER_WORKER * self.threads)
        size = int(min(aim / max(seconds, 1e-6), MOST))
        return max(1, min(size, left // (2 * max(self.threads, 1))) if left else size)

    def count(self) -> int:
        """Return the number of threads of all workers, as it was a short time ago, shape () [1]."""
        now = time.monotonic()
        if now - self.looked >= LOOK:
            try:
                self.threads, self.looked = sum(self.client.nthreads().values()), now
            except OSError:
                raise error("cluster.lost", address=self.address) from None
        return self.threads

    def _result(self, future: Any) -> tuple[list[Any], float]:
        """Wait for a batch as long as there are workers."""
        from concurrent.futures import CancelledError

        from distributed import KilledWorker

        seen = time.monotonic()
        try:
            while True:
                try:
                    result: tuple[list[Any], float] = future.result(timeout=LOOK)
                    return result
                except TimeoutError:
                    if future.status == "error":  # the function's own
                        raise
                    now = time.monotonic()
                    seen = now if self.count() else seen
                    if now - seen > PATIENCE:
                        raise self._alone() from None
        except KilledWorker as problem:
            _, last, allowed = problem.args
            raise error("cluster.killed", count=allowed + 1, worker=last.address) from None
        except CancelledError:
            raise error("cluster.lost", address=self.address) from None

    def _alone(self) -> FoucaultError:
        return error("cluster.no_workers", address=self.address, seconds=PATIENCE)

    def refuse_unlike(self, screen: Screen) -> None:
        """Wait for a worker, then make sure that the software of all is that of this machine."""
        if not self.count():
            screen.say(f"Waiting for workers, {PATIENCE:.0f} s at most.")
        try:
            self.client.wait_for_workers(1, timeout=PATIENCE)
        except TimeoutError:
            raise self._alone() from None
        here = _about()
        kinds = Counter([here["processor"]])
        for worker, there in self.client.run(_about, on_error="return").items():
            if isinstance(there, Exception):  # it could not even be asked
                ours = f"foucault {here['foucault']}"
                raise error("cluster.version", worker=worker, theirs=repr(there), ours=ours)
            _refuse(worker, there, here)
            kinds[there["processor"]] += 1
        if len(kinds) > 1:
            screen.findings([finding("cluster.processors", kinds=", ".join(kinds))])
