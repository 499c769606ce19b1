"""Rows of the table about computing on a cluster."""

from __future__ import annotations

# fmt: off
ROWS: tuple[tuple[str, str, str, str, str], ...] = (
    ("cluster.missing", "error",
     "A cluster is asked for, but the package that talks to it is not installed",
     "{option} needs the package distributed (Dask), which is not installed.",
     'Install it with `pip install "foucault[dask]"`, or leave {option} out to use threads.'),
    ("cluster.options", "error",
     "Two ways to compute are asked for at once",
     "{options} cannot be given together.",
     "Give one of them: --workers for threads, --local-cluster for processes on this machine, "
     "--scheduler for a cluster that is running."),
    ("cluster.no_answer", "error",
     "The address of a Dask scheduler does not answer",
     "No Dask scheduler answers at {address}: {reason}.",
     "Compare the address with what `dask scheduler` printed when it started (such as "
     "tcp://192.168.1.5:8786), and see that a firewall lets this machine reach it."),
    ("cluster.no_workers", "error",
     "A Dask scheduler without workers",
     "The scheduler at {address} has had no worker for {seconds:.0f} s.",
     "Start workers, for example `dask worker {address}`, and give the same command again: what "
     "was finished is kept."),
    ("cluster.version", "error",
     "A worker whose software differs from that of this machine",
     "Worker {worker} has {theirs}; this machine has {ours}.",
     "Results would depend on which worker computed them. Install the same versions on all "
     "workers, start them again, and give the same command again."),
    ("cluster.threads", "error",
     "A worker that computes with another number of BLAS threads",
     "Worker {worker} has {theirs}; this machine has {ours}.",
     "The last digits of sums depend on it. Start every worker with {ours}; `dask worker` does "
     "so where nothing else is set."),
    ("cluster.killed", "error",
     "Workers that died of what they were given",
     "{count} workers in turn ended while they computed the same trials. The last was {worker}.",
     "The usual reason is memory: give each worker more, or fewer threads, and look at its log. "
     "The same command again goes on from what was finished."),
    ("cluster.lost", "error",
     "The scheduler ended during the work",
     "The connection to the scheduler at {address} was lost.",
     "Start the scheduler and its workers again and give the same command: what was finished is "
     "kept."),
    ("cluster.processors", "warning",
     "Workers with different kinds of processors",
     "Workers have different kinds of processors: {kinds}.",
     "Numbers agree to rounding, but their last digits depend on which worker computed them. Use "
     "one kind where results must be the same to the last bit."),
)
# fmt: on
