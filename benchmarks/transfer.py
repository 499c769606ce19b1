"""The benchmarks of transfer alignment, as code for processes of their own; see `run`.

Run these alone: python benchmarks/transfer.py
"""

from __future__ import annotations

# A slave of the publication's class beside its master: 240 s at 200 Hz, messages at 10 Hz.
FLIGHT = """
import json, time
import numpy as np
from foucault.models.earth import Site
from foucault.procedures.transfer_alignment.problem import problem_of
from foucault.procedures.transfer_alignment import simulate
from foucault.procedures.transfer_alignment.session import Session, draw_errors
from foucault.procedures.transfer_alignment.settings import NOISE, Settings
site, settings = Site.at(np.radians(32.0), 1000.0), Settings(delay="100 ms")
session = simulate(Session(with_outage=False), model=draw_errors("tactical", 1), noise=NOISE,
                   site=site, seed=1)
p = problem_of(session.log, site, settings, NOISE, {})
def best(function, rounds=5):
    function()
    out = 1e9
    for _ in range(rounds):
        start = time.thread_time()
        function()
        out = min(out, time.thread_time() - start)
    return out
"""

# The Kalman filter is one pass: the free run, the system, the filter. H-infinity is a run more on
# the same system, or the whole with it.
FILTERS = (
    FLIGHT
    + """
from foucault.infer.linear_filter import by_prior, h_infinity, least_gamma
from foucault.infer.linear_filter import kalman
def free(): return p.model.about(p.model.start)
system = free()
L = by_prior(system)
least = least_gamma(system, L)
# Limit: going through the samples once, and what the filter has to multiply, by BLAS.
from foucault.kernels.strapdown import FREE, strapdown
inc, P = p.model.slave.increments, system.P0
x0, none, history = p.model.start.state.packed(), np.zeros(0), np.empty((len(inc), 12))
def through():
    strapdown(inc.dtheta_b, inc.dvel_b, inc.dt, *inc.bends, 0, len(inc) - 1, x0, 0.0, FREE, none,
              np.zeros(3), history)
few = 109  # epochs whose products stay in the cache, 22 times
Phi, H = system.Phi[:few], system.H[:few]
back, gained = (np.ascontiguousarray(np.swapaxes(x, 1, 2)) for x in (Phi, H))
moved, corner, taken = Phi @ P, Phi @ back, gained @ H
def multiplied():
    for _ in range(22):
        np.matmul(Phi, P, out=moved)
        np.matmul(moved, back, out=corner)
        np.matmul(gained, H, out=taken)
products = best(multiplied)
limits = [best(through) + products, products]
print(json.dumps([best(run) for run in (
    lambda: kalman(free()), lambda: kalman(system),
    lambda: h_infinity(free(), L, 1.2 * least), lambda: h_infinity(system, L, 1.2 * least),
    lambda: least_gamma(system, L),
)] + limits))
"""
)

DELAY = (
    FLIGHT
    + """
from foucault.estimate.delay import delay_of
from foucault.estimate.transfer import likeliest_delay
from foucault.models.earth import earth_rate_n, transport_rate
t = p.table
turning = earth_rate_n(t.latitude) + transport_rate(t.latitude, t.height, t.velocity_n)
early = p.with_delay(0.2).model.loose(0.2)
increments, master = p.model.slave.increments, p.model.master
print(json.dumps([best(run, 3) for run in (
    lambda: delay_of(increments, master.time, master.C_nm, w_in_n=turning,
                     C_ms=settings.C_ms, bracket=(-0.3, 0.5)),
    lambda: likeliest_delay(early, (0.0, 0.2)),
)]))
"""
)

# The study command over the template, a fresh folder, two processes; wall clock.
STUDY = """
import json, subprocess, sys, tempfile, time
from pathlib import Path
from foucault import campaign
with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "campaign.toml"
    file.write_text(campaign.template("transfer_alignment"))
    start = time.perf_counter()
    code = subprocess.run(
        [sys.executable, "-m", "foucault", "montecarlo", str(file), "--trials", "50",
         "--workers", "2", "--output", str(Path(folder) / "study")], capture_output=True
    ).returncode
    assert code in (0, 3), code  # 3: done, and doubtful
    print(json.dumps(time.perf_counter() - start))
"""

if __name__ == "__main__":
    from run import transfer_rows

    for row in transfer_rows():
        print(row.markdown())
