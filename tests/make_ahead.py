"""Write ``kernels/ahead.toml``: which kernels each procedure compiles, in two lanes.

A session of each procedure is simulated and calibrated with an empty cache. A lane takes the next
kernel when it is free: that from which the longest way of compiling leads to what is called, and
whose own parts are begun.

Run: python tests/make_ahead.py
"""

from __future__ import annotations

import functools
import json
import os
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Callable
from math import inf
from pathlib import Path
from random import Random

from foucault.kernels.ahead import NORTH, TABLE

WORTH = 2.5
"""A procedure that compiles for less is not worth two processes [s]."""

DRAWS, SPREAD = 2000, 0.9
"""So many ways to share are drawn, and so much the order of what is urgent is shaken [1]."""

SLACK = 0.05
"""A part is there for the other lane so long after it should be [s]."""

SPY = """
import json, sys, time
from numba.core import event
stack, out = [], []
def named(f):
    return f.__module__.removeprefix("foucault.kernels.") + "." + f.__name__
class Spy(event.Listener):
    def on_start(self, e):
        stack.append([time.process_time(), 0.0])
    def on_end(self, e):
        began, inner = stack.pop()
        took = time.process_time() - began
        f = e.data["dispatcher"].py_func
        ours = f.__module__.startswith("foucault.")
        if stack and ours:
            stack[-1][1] += took
        if ours:
            called = [f.__globals__.get(name) for name in f.__code__.co_names]
            parts = [named(g.py_func) for g in called if hasattr(g, "py_func")]
            out.append([named(f), took - inner, parts])
event.register("numba:compile", Spy())
from foucault.campaign import calibrate, north
from foucault.campaign.tables import Said
from foucault.kernels import ahead
ahead.table = lambda: {"lanes": {}, "signatures": {}}
if sys.argv[2] != ahead.NORTH:
    calibrate(sys.argv[1])
else:
    said = Said(latitude=0.8, gyro_noise=1e-6, accel_noise=1e-3)
    north.run(sys.argv[1].replace("campaign.toml", "log.csv"), said)
signatures = {}
for module in list(sys.modules.values()):
    where = getattr(module, "__name__", "")
    if where.startswith("foucault.kernels."):
        for f in vars(module).values():
            if hasattr(f, "signatures") and f.py_func.__module__ == where:
                name = where.removeprefix("foucault.kernels.") + "." + f.py_func.__name__
                signatures[name] = [", ".join(map(short, s)) for s in f.signatures if plain(s)]
print(json.dumps([out, {k: v for k, v in signatures.items() if v}]))
"""

TYPES = '''
from numba import types
SHORT = {"float64": "f8", "int64": "i8", "int8": "i1", "bool": "b1"}
def short(t):
    if not isinstance(t, types.Array):
        return SHORT[str(t)]
    return SHORT[str(t.dtype)] + "[" + ":," * (t.ndim - 1) + "::1]"
def plain(s):
    """Numbers written as arguments, and views whose rows are apart, are left to the call."""
    return all(t.layout == "C" if isinstance(t, types.Array) else str(t) in SHORT for t in s)
'''


def compiled(procedure: str) -> tuple[list[tuple[str, float, list[str]]], dict[str, list[str]]]:
    """Return what a session compiles (name, seconds, parts) in the order of ending; signatures."""
    with tempfile.TemporaryDirectory() as folder:
        foucault = [sys.executable, "-m", "foucault", "-q"]
        campaign = f"{folder}/campaign.toml"
        session = "north_seeking" if procedure == NORTH else procedure
        subprocess.run([*foucault, "init", session, "-o", campaign], check=True)
        subprocess.run([*foucault, "simulate", campaign, "-o", folder + "/s"], check=True)
        cold = os.environ | {"NUMBA_CACHE_DIR": folder + "/cache"}
        command = [sys.executable, "-c", TYPES + SPY, folder + "/s/campaign.toml", procedure]
        out = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, env=cold)
    found = json.loads(out.stdout.splitlines()[-1])
    return [(name, took, parts) for name, took, parts in found[0]], found[1]


def lanes(work: list[tuple[str, float, list[str]]]) -> list[list[str]]:
    """Share work between two lanes: of many ways drawn, the one that ends first."""
    seconds: dict[str, float] = defaultdict(float)
    parts: dict[str, set[str]] = defaultdict(set)
    for name, took, inner in work:
        seconds[name] += took
        parts[name] |= set(inner) - {name}
    after = {name: [other for other in seconds if name in parts[other]] for name in seconds}

    @functools.cache
    def way(name: str) -> float:
        return seconds[name] + max((way(other) for other in after[name]), default=0.0)

    def drawn(noise: Callable[[], float]) -> tuple[float, list[list[str]]]:
        """Give each lane what is next when it is free; it compiles again what is not ended yet."""
        weight = {name: way(name) * noise() for name in seconds}
        out: list[list[str]] = [[], []]
        free, ends = [0.0, 0.0], [dict[str, float](), dict[str, float]()]
        listed = set[str]()

        def compile_in(lane: int, name: str) -> None:
            if name in ends[lane] or ends[1 - lane].get(name, inf) + SLACK <= free[lane]:
                return
            for part in parts[name]:
                compile_in(lane, part)
            free[lane] += seconds[name]
            ends[lane][name] = free[lane]

        while left := [n for n in seconds if n not in listed and parts[n] <= listed]:
            lane = free.index(min(free))
            name = max(left, key=lambda n: weight[n])
            out[lane].append(name)
            listed.add(name)
            compile_in(lane, name)
        return max(free), out

    random = Random(1)
    ways = [drawn(lambda: random.uniform(1 - SPREAD, 1 + SPREAD)) for _ in range(DRAWS)]
    return min(ways)[1]


def main() -> None:
    """Write the table."""
    from foucault.procedures import PROCEDURES

    shared: dict[str, list[list[str]]] = {}
    signatures: dict[str, list[str]] = {}
    for procedure in (*PROCEDURES, NORTH):
        work, found = compiled(procedure)
        work = [(n, t, [p for p in parts if p in found]) for n, t, parts in work if n in found]
        print(procedure, f"{sum(t for _, t, _ in work):.1f} s in {len(work)} kernels")
        if sum(t for _, t, _ in work) > WORTH:
            shared[procedure] = lanes(work)
            for name in {n for lane in shared[procedure] for n in lane}:
                signatures[name] = sorted({*signatures.get(name, []), *found[name]})
    lines = ["# Written by tests/make_ahead.py.", "[lanes]"]
    for procedure, both in shared.items():
        lines += [f"{procedure} = ["]
        for lane in both:
            lines += ["  [", *[f'    "{name}",' for name in lane], "  ],"]
        lines += ["]"]
    lines += ["", "[signatures]"]
    lines += [
        f'"{name}" = [{", ".join(json.dumps(f"({s},)") for s in signatures[name])}]'
        for name in sorted(signatures)
    ]
    Path(TABLE).write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
