"""Allan deviation: seconds beside allantools in one run, and the memory of 1e8 samples.

    python benchmarks/allan.py

Targets: overlapping Allan deviation of 1e6 samples at 18 averaging times in 8 ms, warm; 1e8
samples within 4 GiB.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time

import numpy as np

LARGE = """
import json, resource, time
import numpy as np
from foucault.diagnose.allan import deviations
rate = np.random.default_rng(1).standard_normal(100_000_000)
start = time.perf_counter()
tau, deviation = deviations(rate, 0.01)
seconds = time.perf_counter() - start
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
print(json.dumps({"seconds": seconds, "peak": peak, "taus": len(tau)}))
"""


def best(function, *arguments, times: int = 9, **more) -> float:
    """Return the shortest of several runs [s]."""
    out = np.inf
    for _ in range(times):
        start = time.perf_counter()
        function(*arguments, **more)
        out = min(out, time.perf_counter() - start)
    return float(out)


def main() -> None:
    from foucault.diagnose.allan import deviations, measure, octaves

    rate = np.random.default_rng(1).standard_normal(1_000_000)
    m = octaves(len(rate))
    deviations(rate, 1.0)
    try:
        import allantools
    except ImportError:
        allantools = None
    for kind, name in (("overlapping", "oadev"), ("modified", "mdev"), ("hadamard", "ohdev")):
        ours = best(deviations, rate, 1.0, m, kind)
        line = f"{kind}, 1e6 samples, {len(m)} averaging times: {1e3 * ours:.1f} ms"
        if allantools is not None:
            peer = getattr(allantools, name)
            theirs = best(peer, rate, rate=1.0, data_type="freq", taus=m.astype(float), times=5)
            line += f"; allantools {1e3 * theirs:.0f} ms, {theirs / ours:.0f} times as long"
        print(line)
    print(f"with fit and intervals: {1e3 * best(measure, rate, 1.0):.0f} ms")
    done = subprocess.run([sys.executable, "-c", LARGE], capture_output=True, text=True, check=True)
    got = json.loads(done.stdout)
    print(
        f"1e8 samples, {got['taus']} averaging times: {got['seconds']:.2f} s, "
        f"peak {got['peak'] / 2**30:.2f} GiB with the 0.75 GiB of the samples"
    )


if __name__ == "__main__":
    main()
