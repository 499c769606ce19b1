"""Measure this package against its targets and its peers in one run; write README.md here.

Every case is a fresh process, so that imports, compilation and threads of one do not flatter
another. Real logs are looked for under $FOUCAULT_DATA (default ../shared/data); a case without
its log is left out and said to be.

Run: python benchmarks/run.py, all of it twice; or python benchmarks/run.py surroundings ... for
some groups, twice too, printed and not written.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import hand
import north_seeking
import on_table
import platform_tumble
import strapdown
import surroundings
import systematic
import transfer

import plans

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("FOUCAULT_DATA", ROOT.parent / "shared" / "data")).resolve()

LOAD_XSENS = f"""
import json, time
from pathlib import Path
from foucault.campaign import parse, read_log
folder = Path({str(DATA / "xsens_hand_rotated")!r})
campaign = parse('''
[site]
gravity = "9.81744 m/s^2"
[log]
format = "text"
header = "none"
time = {{ column = 0, unit = "s" }}
[log.accel]
file = "FOLDER/xsens_acc.mat.gz"
columns = [1, 2, 3]
unit = "count"
scale = "415 count/(m/s^2)"
zero = 33000
[log.gyro]
file = "FOLDER/xsens_gyro.mat.gz"
columns = [1, 2, 3]
unit = "count"
scale = "4778 count/(rad/s)"
zero = 32500
[procedure]
name = "PROCEDURE"
'''.replace("FOLDER", str(folder)).replace("PROCEDURE", PROCEDURE), "xsens.toml")
"""

TIME_SOLVE = (
    LOAD_XSENS
    + """
from foucault import procedures
log = read_log(campaign)
module = procedures.load(campaign.procedure)
best = 1e9
for _ in range(7):
    start = time.process_time()
    module.calibrate(log, site=campaign.site, settings=campaign.settings)
    best = min(best, time.process_time() - start)
print(json.dumps(best))
"""
)

# Another program's time is that of its process, which reads the files too.
TIME_WITH_READING = TIME_SOLVE.replace("log = read_log(campaign)\n", "").replace(
    "    module.calibrate(log,", "    module.calibrate(read_log(campaign),"
)

COMMAND = (
    LOAD_XSENS
    + """
import subprocess, sys, tempfile
with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "campaign.toml"
    file.write_text(campaign.text)
    command = [sys.executable, "-m", "foucault", "-q", "calibrate", str(file)]
    command += ["-o", folder + "/run"]
    best = 1e9
    for _ in range(3):
        start = time.perf_counter()
        code = subprocess.run(command, capture_output=True).returncode
        assert code in (0, 3), code  # 3: done, and doubtful
        best = min(best, time.perf_counter() - start)
print(json.dumps(best))
"""
)

IMPORT = """
import json, subprocess, sys, time
def seconds(code):
    best = 1e9
    for _ in range(7):
        start = time.perf_counter()
        subprocess.run([sys.executable, "-c", code], check=True)
        best = min(best, time.perf_counter() - start)
    return best
print(json.dumps(seconds("import foucault") - seconds("pass")))
"""

COMPILE = """
import json, time
import numpy as np
from foucault.kernels import moving, rotation
time0 = time.perf_counter()
x = np.zeros((50, 3)); t = np.arange(50.0); i = np.array([1]); j = np.array([20])
moving.moving_moments(x, 5)
rotation.integrate_turns(t, x, x, np.eye(3), i, j, False)
rotation.integrate_turns_rk4(t, x, i, j)
print(json.dumps(time.perf_counter() - time0))
"""

COMPILE_BATCH = """
import json, time
import numpy as np
from foucault.kernels.norm_observation import calibrate_batch
time0 = time.perf_counter()
x, one = np.zeros((1, 12, 3)), np.ones(12)
calibrate_batch(x, one, x, one, x, one, one, 9.8, True)
print(json.dumps(time.perf_counter() - time0))
"""

# The published gyro cost as one would write it with NumPy and SciPy: same rests, same start.
SCIPY_PEER = (
    LOAD_XSENS
    + """
import numpy as np
from dataclasses import replace
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from foucault import procedures
log = read_log(campaign)
result = procedures.load("hand_rotated_published").calibrate(log, site=campaign.site)
rests = result.tables["rests"]
f = np.column_stack([rests[f"accel_{a}"] for a in "xyz"])
f_b, _ = result.model.compensate(f, None)
u = f_b / np.linalg.norm(f_b, axis=1)[:, None]
end = int(np.searchsorted(log.time, log.time[0] + 50)) + 1
w = log.gyro - log.gyro[:end].mean(axis=0)
pieces = [slice(a - 1, b) for a, b in zip(rests["last"][:-1], rests["first"][1:])]
def residuals(k):
    K = np.eye(3) + k.reshape(3, 3)
    out = []
    for j, piece in enumerate(pieces):
        rate = w[piece] @ K.T
        step = (rate[1:] + rate[:-1]) / 2 * np.diff(log.time[piece])[:, None]
        C = Rotation.identity()
        for r in Rotation.from_rotvec(step):
            C = C * r
        out.append(u[j + 1] - C.inv().apply(u[j]))
    return np.concatenate(out)
start = time.process_time()
least_squares(residuals, np.zeros(9))
print(json.dumps(time.process_time() - start))
"""
)

STUDY = """
import json, tempfile, time
from foucault.campaign import parse, study, template
campaign = parse(template("hand_rotated"), "template.toml")
with tempfile.TemporaryDirectory() as folder:
    study.run(campaign, 2, folder + "/warm")
    start = time.perf_counter()
    study.run(campaign, 500, folder + "/study", workers=2)
    print(json.dumps(time.perf_counter() - start))
"""

REPORT = """
import json, tempfile, time
from foucault import report, run_folder
from foucault.campaign import parse, simulate, template
from foucault.procedures import load
campaign = parse(template("hand_rotated"), "template.toml")
result = load("hand_rotated").calibrate(simulate(campaign, 1).simulation.log, site=campaign.site)
with tempfile.TemporaryDirectory() as folder:
    run_folder.save(result, folder)
    start = time.perf_counter()
    report.write(folder)
    print(json.dumps(time.perf_counter() - start))
"""


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    case: str
    ours: float
    target: float | None
    peer: str = ""
    peer_seconds: float | None = None
    limit: float | None = None
    again: float | None = None  # of the second run

    def markdown(self) -> str:
        both = [self.ours] if self.again is None else [self.ours, self.again]
        seconds, best = " / ".join(f"{v:.3g}" for v in both), min(both)
        target = f"{self.target:.3g} s" if self.target else ""
        met = "" if self.target is None else ("yes" if best <= self.target else "**no**")
        ratio = f"{self.peer_seconds / best:.1f}" if self.peer_seconds else ""
        peer = f"{self.peer}: {self.peer_seconds:.3g} s" if self.peer_seconds else ""
        limit = f"{self.limit:.3g} s | {best / self.limit:.2f}" if self.limit else " |"
        return f"| {self.case} | {seconds} s | {limit} | {peer} | {ratio} | {target} | {met} |"


def measure(code: str, **environment: str) -> float | list[float]:
    out = subprocess.run(
        [sys.executable, "-c", code],
        check=True,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"} | environment,
    )
    value: float | list[float] = json.loads(out.stdout.strip().splitlines()[-1])
    return value


def calibration_rows() -> list[Row]:
    """Measure a calibration, its parts and what it needs before."""
    out = []
    if (DATA / "xsens_hand_rotated").is_dir():
        likelihood = 'PROCEDURE = "hand_rotated"\n'
        published = 'PROCEDURE = "hand_rotated_published"\n'
        solve = measure(likelihood + TIME_SOLVE)
        recipe = measure(published + TIME_SOLVE)
        peer = measure(published + SCIPY_PEER)
        read = measure(published + TIME_WITH_READING)
        imu_tk = "imu_tk, C++, its process, which reads too, recorded"
        out += [
            Row("51,175-row log, full calibration with checks and held-out rests, CPU", solve,
                0.25),
            Row("same log, published recipe with reading its files, CPU", read, None, imu_tk, 0.76),
            Row("same log, published recipe, CPU", recipe, None,
                "its gyro cost alone in NumPy and SciPy, CPU", peer),
            Row("`foucault calibrate` end to end with report, wall", measure(likelihood + COMMAND),
                4.0),
        ]  # fmt: skip
    else:
        print(f"left out: no xsens_hand_rotated under {DATA}", file=sys.stderr)
    with tempfile.TemporaryDirectory() as cache:
        out += [
            Row("compiling the kernels of a session, once",
                measure(COMPILE, NUMBA_CACHE_DIR=cache), 15),
            Row("compiling the batch of a fleet, once",
                measure(COMPILE_BATCH, NUMBA_CACHE_DIR=cache), 15),
        ]  # fmt: skip
    out.append(Row("`import foucault`", measure(IMPORT), 0.35))
    out.append(Row("study of 500 sessions, two threads, wall", measure(STUDY), 60.0))
    out.append(Row("writing a report, first in a process, wall", measure(REPORT), 1.0))
    return out


def surrounding_rows() -> list[Row]:
    """Measure reading, states and deviations beside the least that has to be done for them."""
    (text, parsed, pandas), (table, decoded) = measure(surroundings.READ)
    kept, geodetic, turned = measure(surroundings.STATES)
    deviations, sums, allantools = measure(surroundings.ALLAN)
    one, batch = measure(surroundings.FLEET)
    return [
        Row("reading a CSV of 1e6 rows of seven numbers with all checks and SHA-256, CPU; limit: "
            "Arrow's parse and SHA-256", text, 0.4,
            "pandas.read_csv without checks or SHA-256", pandas, parsed),
        Row("the same from Parquet; limit: Arrow's decoding and SHA-256", table, 0.12,
            limit=decoded),
        Row("strapdown, all states of a million samples kept, each, CPU", kept, 65e-9),
        Row("the same with latitude, longitude, velocity and angles, each, CPU; limit: the states "
            "kept, and the kernel of the angles", geodetic, 130e-9, limit=kept + turned),
        Row("overlapping Allan deviation, 1e6 samples, 18 averaging times, CPU; limit: the sums "
            "of squares", deviations, 0.008, "allantools", allantools, sums),
        Row("norm observation, 20,000 IMUs of 24 means from one Parquet file to a judged table "
            "and a page, each, CPU; limit: the kernel of the batch, twice", one, 6e-4,
            limit=batch),
    ]  # fmt: skip


def table_rows() -> list[Row]:
    """Measure what calibrating on a table costs."""
    ours, peer = measure(on_table.BATCH), measure(on_table.ONE_AT_A_TIME)
    out = [
        Row("norm observation with unification and covariance, 10,000 IMUs in a batch, per IMU, "
            "CPU", ours, 1e-5, "the same norms in SciPy, one IMU after the other", peer),
    ]  # fmt: skip
    solve, whole, n = measure(on_table.COMMAND)
    case, allowed = f"one IMU from a {n:,}-row CSV, the solve alone", float(f"{whole / 20:.2g}")
    out.append(Row(case, solve, allowed, "the whole command with report, wall", whole))
    ferraris = on_table.ferraris_code(DATA)
    if ferraris is None:
        print(f"left out: no ferraris_session under {DATA}", file=sys.stderr)
    else:
        ours, peer = measure(ferraris)
        out.append(Row("Ferraris' method as published, with covariance, checks and result, CPU",
                       ours, None, "imucal, without them", peer))  # fmt: skip
    return out


def north_rows() -> list[Row]:
    """Measure what finding north costs."""
    ours, peer = measure(north_seeking.CLOSED_FORM), measure(north_seeking.NUMPY)
    what = "a million north fixes of four stops in closed form, with sd, two threads, each, wall"
    out = [
        Row(f"{what}, latitude known", ours["2 known"], 1.2e-7),
        Row(f"{what}, latitude known; limit: the kernel, into arrays that are used again".replace(
            "two threads, each, wall", "one thread, each, CPU"), ours["1 known"], 5.5e-8,
            "the same in NumPy without sd", peer, ours["kernel"]),
        Row(f"{what}, latitude unknown", ours["2 unknown"], 1.2e-7),
    ]  # fmt: skip
    (known, unknown), peer = measure(north_seeking.LIKELIHOOD), measure(north_seeking.SCIPY)
    what = "north fix by maximum likelihood in a batch of 20,000, with budget, each, CPU"
    out += [
        Row(f"{what}, latitude known", known, 1e-5, "one set-up in SciPy, no covariance", peer),
        Row(f"{what}, latitude unknown", unknown, 1e-5),
        Row("calibrating a north seeker, 12 headings, in a batch, each, CPU",
            measure(north_seeking.CALIBRATION), 1.5e-6),
    ]  # fmt: skip
    wall, used = measure(north_seeking.COMMAND)
    out += [
        Row("`foucault north` of a million set-ups in a Parquet file to verdicts, page and table, "
            "two threads, wall", wall, 5.0),
        Row("the same, CPU", used, None),
    ]  # fmt: skip
    return out


def tumble_rows() -> list[Row]:
    """Measure what a platform tumble costs."""
    every, averaged, published, whole, *limits = measure(platform_tumble.PASS)
    dense, filterpy = measure(platform_tumble.DENSE), measure(platform_tumble.FILTERPY)
    what = "tumble of 27,000 readings, 45 unknowns"
    given = "of 45 states, dense, matrices given, CPU"
    return [
        Row(f"{what}, one Gauss-Newton pass, CPU; limit: turning the cluster, and BLAS's Gram "
            "matrix of the white rows", every, 0.010, f"NumPy filter {given}", dense, limits[0]),
        Row(f"{what}, one Gauss-Newton pass, CPU", every, 0.010, f"filterpy {given}", filterpy),
        Row(f"{what}, one pass with residuals averaged over 1 s, CPU; limit: the same", averaged,
            0.005, f"NumPy filter {given}", dense, limits[1]),
        Row(f"{what}, the whole solution from a levelled start, CPU", whole, None),
        Row(f"{what}, the published filter of angles, CPU", published, 0.05,
            f"filterpy {given}", filterpy),
        Row("500 tumbles simulated and solved, two threads, wall", measure(platform_tumble.STUDY),
            15.0),
        Row("`foucault montecarlo` of 500 tumbles, two threads, wall",
            measure(platform_tumble.COMMAND), None),
    ]  # fmt: skip


def plan_rows() -> list[Row]:
    """Measure what a search for a better plan costs."""
    (bound, cost), dense = measure(plans.BOUND), measure(plans.DENSE)
    took, evaluations, reached = measure(plans.SEARCH)
    return [
        Row("bound of a tumble plan of 5400 s in steps of 15 s, CPU", bound, 1e-3,
            "NumPy covariance filter of 45 states, matrices given, CPU", dense),
        Row("the same in slots of 6 deg, as the search takes them, CPU", cost, None),
        Row(f"search for a tumble plan at 0.2 deg/s, {evaluations:,} plans, two threads, wall: "
            f"{reached:.3f} of the published plan's sd", took, 60.0),
    ]  # fmt: skip


def navigation_rows() -> list[Row]:
    """Measure what navigating from increments costs, a sample."""
    free, held, aided, back, kernel = measure(strapdown.MODERATE + strapdown.STRAPDOWN)
    long, *_, again = measure(strapdown.LONG + strapdown.STRAPDOWN)
    plain = measure(f"TESTS = {str(ROOT / 'tests')!r}\n" + strapdown.NUMPY)
    what = "strapdown navigation, all states of 250,000 samples kept, each sample, CPU"
    return [
        Row(f"{what}, height free; limit: the kernel, into a history that is used again", free,
            1 / 11e6, "the same steps in NumPy", plain, kernel),
        Row(f"{what}, height held", held, 1 / 11e6),
        Row(f"{what}, height aided", aided, 1 / 11e6),
        Row(f"{what}, backward", back, None),
        Row(f"{what}, height free; limit: likewise".replace("250,000", "a million"), long, 6.5e-8,
            limit=again),
        Row("zero-velocity filter of 33 states, updates at 1 Hz, each sample at 100 Hz, CPU",
            measure(strapdown.FILTER), 5e-7),
    ]  # fmt: skip


def systematic_rows() -> list[Row]:
    """Measure what a systematic calibration costs."""
    n, joint, published = measure(systematic.code(systematic.BOTH_STEPS, ROOT, DATA))
    what = f"systematic calibration, {n:,} samples, 92 min at 200 Hz"
    out = [
        Row(f"{what}, 39 states in one pass, CPU", joint, 0.6),
        Row(f"{what}, the published two steps of 33 and 39 states, CPU", published, 0.6),
    ]
    folder = DATA / "systematic_19_positions"
    if not folder.is_dir():
        print(f"left out: no systematic_19_positions under {DATA}", file=sys.stderr)
        return out
    n, states, passes = measure(systematic.code(systematic.THIRD_PARTY, ROOT, folder))
    what = (
        f"nineteen positions of another program, {n:,} samples, {states} states, five passes, CPU"
    )
    return [*out, Row(what, passes, 1.0)]


def transfer_rows() -> list[Row]:
    """Measure transfer alignment: 240 s at 200 Hz, messages at 10 Hz."""
    kalman, alone, bounded, bounded_alone, bisected, *limits = measure(transfer.FILTERS)
    matched, likeliest = measure(transfer.DELAY)
    what = "transfer alignment, 240 s at 200 Hz, messages at 10 Hz"
    return [
        Row(f"{what}, free run and Kalman filter, CPU; limit: going through the samples once, and "
            "the filter's", kalman, 0.02, limit=limits[0]),
        Row(f"{what}, the Kalman filter alone, CPU; limit: its matrix products by BLAS", alone,
            None, limit=limits[1]),
        Row(f"{what}, free run and H-infinity filter, CPU", bounded, 0.05),
        Row(f"{what}, the H-infinity filter alone, CPU", bounded_alone, None),
        Row(f"{what}, least gamma by bisection, CPU", bisected, 0.5),
        Row(f"{what}, delay by rate matching, CPU", matched, 0.1),
        Row(f"{what}, likeliest delay, CPU", likeliest, 0.5),
        Row("50 trials of foucault montecarlo transfer_alignment, two threads",
            measure(transfer.STUDY), 60.0),
    ]  # fmt: skip


def hand_rows() -> list[Row]:
    """Measure what a hand or a drill moves, and how the time grows with the session."""
    out = []
    for procedure, (what, _, _, target) in hand.CASES.items():
        one, two = measure(hand.code(procedure))
        out += [Row(f"{what}, from a log to a judged result, CPU", one, target),
                Row(f"{what}: the same of twice the length", two, None)]  # fmt: skip
    return out


GROUPS = {
    "calibration": calibration_rows, "surroundings": surrounding_rows, "table": table_rows,
    "north": north_rows, "tumble": tumble_rows, "plans": plan_rows, "navigation": navigation_rows,
    "systematic": systematic_rows, "transfer": transfer_rows, "hand": hand_rows,
}  # fmt: skip


def twice(names: list[str]) -> list[Row]:
    """Measure the groups of these names, all of them once and then once more."""
    first, second = ([row for name in names for row in GROUPS[name]()] for _ in range(2))
    again = {row.case + row.peer: row.ours for row in second}
    return [replace(row, again=again.get(row.case + row.peer)) for row in first]


def processor() -> str:
    """Return what this computer calls its processor, or of which kind it is."""
    told = Path("/proc/cpuinfo")
    lines = told.read_text().splitlines() if told.exists() else []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{named[0]}, {platform.machine()}" if named else platform.machine()


HEAD = [
    "| case | ours, run twice | limit | ours / limit | peer | peer / ours | target | met |",
    "|---|---|---|---|---|---|---|---|",
]


def main() -> None:
    if asked := sys.argv[1:]:
        wrong = sorted(set(asked) - set(GROUPS))
        if wrong:
            sys.exit(f"No group is called {', '.join(wrong)}: give some of {', '.join(GROUPS)}.")
        print("\n".join([*HEAD, *(row.markdown() for row in twice(asked))]))
        return
    table = twice(list(GROUPS))
    lines = [
        "# Benchmarks",
        "",
        "Written by `make bench`: every case in a fresh process, warm (best of several) unless "
        "it says otherwise, BLAS on one thread as the command line sets it, all cases run twice. "
        "The limit is the least that has to be done, as the case names it. Figures called recorded "
        "come from another machine and are quoted, not measured.",
        "",
        f"{processor()}, {os.cpu_count()} cores, Python {platform.python_version()}, "
        f"{time.strftime('%Y-%m-%d')}.",
        "",
        *HEAD,
        *[row.markdown() for row in table],
        "",
        "Dask, one process against two: `python benchmarks/scale.py`, which writes docs/scale.md.",
        "",
        "Reading ten million rows, with peak memory: `python benchmarks/read_ten_million.py`; all "
        "three Allan deviations and 1e8 samples: `python benchmarks/allan.py`; functions, "
        "files and moves between packages in a calibration: `python benchmarks/trace.py`.",
        "",
        "Not compared: what does other work. pyins navigates to latitude, longitude and angles at "
        "every step and its filter takes in an update at every sample; PSINS was timed on another "
        "machine. The peers of the tumble multiply whole matrices; ours knows their zeros, as any "
        "filter written for this problem would.",
        "",
        "What misses its target, and why. The targets were set where pandas takes .26 s for the "
        "CSV of a million rows: its row tells how fast the machine of this page is, which may be "
        "half as fast and, by the clock of a virtual machine, a fifth faster or slower within the "
        "hour. Reading: what is above the limit are the checks. Transfer alignment: the targets "
        "were set for 21 constants; 45 are estimated now.",
    ]
    text = "\n".join(lines) + "\n"
    (Path(__file__).parent / "README.md").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
