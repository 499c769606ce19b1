"""Transfer alignment on a real vehicle: what a user gets, and how far it can be believed.

The noise of messages and slave is found in every other second of the log, as what makes the
innovations there likeliest, and judged in the rest; so with longer parts too. The lever arm is the
likeliest. Numbers shipped with the log and those of another program stand beside ours; they are not
truth. What can be judged without a truth is: whether the slave, navigated alone, keeps its heading;
whether two halves of the log agree; whether innovations are as large as was said, and independent.

The log is looked for under $FOUCAULT_DATA (default ../shared/data).
"""

from __future__ import annotations

import numpy as np
from common import limits, must
from scipy.optimize import minimize

from foucault.infer.filtered import autocorrelation
from foucault.infer.gauss_newton import chi_square_limits
from foucault.procedures.transfer_alignment.problem import (
    Solution,
    problem_of,
    solved,
)
from make_transfer_vehicle import (
    ARCMIN,
    ARCSEC,
    FOLDER,
    FOUND,
    LEVER,
    MS,
    PRIORS,
    PSINS,
    SHIPPED,
    UG,
    UNITS,
    apart,
    calibrated,
    closure,
    described,
    half,
    in_units,
    logged,
    on_one_clock,
)

LENGTHS = (1.0, 5.0, 10.0)  # of the parts, s; the noise that is used is of the first
SETTLED = 20  # messages
START = {"velocity": 3e-3, "attitude": 5.0, "accel": 400.0, "gyro": 0.15}
NOISE_UNITS = {"velocity": "m/s", "attitude": "arcsec", "accel": "ug/sqrt(Hz)",
               "gyro": "deg/sqrt(h)"}  # fmt: skip
CHANNELS = ("velocity east", "velocity north", "velocity up", "attitude 1", "attitude 2",
            "attitude 3")  # fmt: skip
BLOCKS = {"velocity": slice(0, 3), "attitude": slice(3, 6)}
STEP = 0.01  # m
ALL = ""
FLAT = "vertical = false"
ALONE = "left_out = false"
TIGHTER = PRIORS.replace("300 deg", "250 deg").replace("2000 ppm", "1000 ppm").replace(
    "10 mg", "5 mg").replace("30 arcmin", "20 arcmin")  # fmt: skip
WANTED = 1.5  # arcmin


def solution(c, log) -> Solution:
    """Filter without what only a report shows."""
    return solved(problem_of(log, c.site, c.settings, c.noise, c.prior), history=False)


def innovations(s: Solution) -> tuple[np.ndarray, np.ndarray]:
    """Return the innovations and their sds."""
    return s.fit.run.innovation, np.sqrt(s.fit.run.variance)


def parts(s: Solution, length: float, odd: bool) -> np.ndarray:
    """Return which messages are of the even or the odd parts of a length."""
    return np.floor(s.fit.system.time / length) % 2 == int(odd)


def likeliest_noise(log, lever, length: float, *, odd: bool = False) -> dict[str, float]:
    """Return the noise that makes the innovations of every other part likeliest."""

    def against(x: np.ndarray) -> float:
        noise = dict(zip(START, np.exp(x), strict=True))
        s = solution(described(ALL, noise, lever), log)
        z, sd = innovations(s)
        return float(np.sum((0.5 * (z / sd) ** 2 + np.log(sd))[parts(s, length, odd)]))

    found = minimize(against, np.log(list(START.values())), method="Nelder-Mead",
                     options={"xatol": 0.02, "fatol": 0.1, "maxfev": 200})  # fmt: skip
    return dict(zip(START, np.exp(found.x).tolist(), strict=True))


def likeliest_lever(log, noise) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the lever arm, its sd, and how much likelier it is than none."""
    at, steps = np.array(LEVER), STEP * np.eye(3)

    def likely(lever: np.ndarray) -> float:
        return float(solution(described(ALL, noise, lever), log).fit.run.log_likelihood)

    here = likely(at)
    up, down = ([likely(at + sign * e) for e in steps] for sign in (1, -1))
    slope = (np.array(up) - down) / (2 * STEP)
    H = np.diag((np.array(up) + down - 2 * here) / STEP**2)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        H[i, j] = H[j, i] = (likely(at + steps[i] + steps[j]) - up[i] - up[j] + here) / STEP**2
    best = at - np.linalg.solve(H, slope)
    return best, np.sqrt(np.diag(np.linalg.inv(-H))), here - likely(0 * at)


def nis_rows(log) -> tuple[list[str], bool, dict[str, float]]:
    """Find the noise in every other part, and judge the innovations of the others."""
    lines = []
    good, first = True, {}
    for length in LENGTHS:
        for odd in (False, True):
            noise = likeliest_noise(log, LEVER, length, odd=odd)
            first = first or noise
            s = solution(described(ALL, noise, LEVER), log)
            z, sd = innovations(s)
            u = (z / sd)[parts(s, length, not odd)]
            low, high = limits(3 * len(u), 0.01, 2)
            nis = [float(np.mean(u[:, block] ** 2)) for block in BLOCKS.values()]
            good &= length != LENGTHS[0] or all(low < x < high for x in nis)
            cells = " | ".join([*(f"{x:.3g}" for x in noise.values()), *(f"{x:.3f}" for x in nis)])
            lines.append(f"| {length:g} s | {'odd' if odd else 'even'} | {cells} "
                         f"| {low:.3f} to {high:.3f} |")  # fmt: skip
    return lines, good, first


def channel_rows(s: Solution) -> list[str]:
    """Tell each channel by itself."""
    z, sd = innovations(s)
    lines = []
    t = s.fit.system.time
    times = [t < 30, (t >= 30) & (t < 75), t >= 75]
    for k, name in enumerate(CHANNELS):
        u = (z / sd)[:, k]
        rms = " | ".join(f"{np.sqrt(np.mean(u[p] ** 2)):.2f}" for p in (t > 0, *times))
        rho = autocorrelation(u, 5)[[0, 1, 2, 4]]
        lines.append(f"| {name} | {rms} | {', '.join(f'{r:.2f}' for r in rho)} |")
    return lines


def group_of(name: str) -> str:
    return next(group for group in UNITS if name.startswith(group))


def coefficient_rows(results: dict) -> list[str]:
    """Our numbers beside the others'."""
    lines = [f"| | {' | '.join(results)} | shipped | PSINS |",
             "|---|" + "--:|" * (len(results) + 2)]  # fmt: skip
    for name in next(iter(results.values())).coefficients.names:
        group = group_of(name)
        unit, label = UNITS[group]
        each = [r.coefficients[name] for r in results.values()]
        cells = [f"{c.values[0] / unit:.2f} +- {c.sd[0] / unit:.2f}" for c in each]
        for other in (SHIPPED, PSINS):
            k = "xyz".find(name[-1])
            cells.append(f"{other[group][k]:.2f}" if group in other else "")
        lines.append(f"| {name} [{label}] | {' | '.join(cells)} |")
    return lines


def check_rows(results: dict) -> list[str]:
    """What each says of itself."""
    lines = []
    for name, r in results.items():
        failed = ", ".join(
            f"{x.name} {x.value:.3g}" + (f" (limits {x.low or 0:.3f} to {x.high:.3f})")
            for x in r.checks if not x.passed
        )  # fmt: skip
        codes = ", ".join(f"`{f.code}`" for f in r.findings)
        lines.append(f"| {name} | {r.verdict.level.value} | {failed} | {codes} |")
    return lines


def closed(log, c) -> tuple[float, float]:
    """Return the heading error at the end and the largest [arcmin]."""
    values = [c[g].values for g in ("gyro.bias", "accel.bias", "installation")]
    _, err = closure(log, *values, float(c["master.delay"].values[0]))
    return err[-1] / ARCMIN, np.abs(err).max() / ARCMIN


def closure_rows(log, results: dict, first) -> tuple[list[str], bool]:
    """Navigate the slave alone with everybody's biases."""
    lines = []
    good = True
    for name, r in results.items():
        end, most = closed(log, r.coefficients)
        good &= name != "ours" or most < WANTED
        lines.append(f"| {name} | whole log | {end:.2f} | {most:.2f} |")
    delay = float(results["ours"].coefficients["master.delay"].values[0])
    for name, other in (("shipped", SHIPPED), ("PSINS", PSINS)):
        values = [in_units(g, other[g]) for g in ("gyro.bias", "accel.bias", "installation")]
        _, err = closure(log, *values, delay)
        lines.append(f"| {name} | whole log | {err[-1] / ARCMIN:.2f} "
                     f"| {np.abs(err).max() / ARCMIN:.2f} |")  # fmt: skip
    values = [first[g].values for g in ("gyro.bias", "accel.bias", "installation")]
    _, err = closure(log, *values, float(first["master.delay"].values[0]), begin=50.0)
    lines.append(f"| ours, of the first half | second half | {err[-1] / ARCMIN:.2f} "
                 f"| {np.abs(err).max() / ARCMIN:.2f} |")  # fmt: skip
    return lines, good


def half_rows(c, log, drift: float) -> tuple[list[str], bool]:
    """Two halves by the stamps as they are, and with the drift of the clocks taken out."""
    raw, chi_raw = apart(c, log)
    one, chi_one = apart(c, on_one_clock(log, drift))
    lines = []
    lines += [f"| {n} | {raw[n]:+.2f} | {one[n]:+.2f} |" for n in raw]
    low, high = chi_square_limits(len(raw), 0.01)
    lines.append(f"| chi-square, {len(raw)} together ({low:.1f} to {high:.1f}) "
                 f"| {chi_raw:.1f} | {chi_one:.1f} |")  # fmt: skip
    return lines, max(map(abs, one.values())) < 3 and low < chi_one < high


def delay_rows(log, noise, ours) -> list[str]:
    """The delay by every way there is."""
    matched = ours.diagnostics["delay"]["rate_matching"]
    found, sd = matched["value"] / MS, matched["sd"] / MS
    lines = [f"| rate matching | {found:.3f} | {sd:.3f} |"]
    for how in ("attitude", "velocity", "velocity+attitude"):
        c = described(f'{ALL}\nmatching = "{how}"', noise, LEVER)
        s = solution(c, log)
        tau, words = s.states["master.delay"], s.status.value.replace("_", " ")
        lines.append(
            f"| filter, {how}: {words} | {tau.values[0] / MS:.3f} | {tau.sd[0] / MS:.3f} |"
        )
    c = described(f'{ALL}\ndelay_method = "likelihood"', noise, LEVER)
    fit = solution(c, log).likeliest
    assert fit is not None
    lines.append(f"| likelihood | {fit.delay / MS:.3f} | {fit.sd / MS:.3f} |")
    lines += ["", f"Drift of the stamps against the slave's clock {matched['drift'] * 1e6:.1f} +- "
              f"{matched['drift_sd'] * 1e6:.1f} ppm: {matched['drift'] * 100e3:.2f} ms over the "
              "log."]  # fmt: skip
    return lines


def flexure_rows(log, noise, likely: float) -> list[str]:
    """What a bending would explain."""
    lines = []
    for sd in (5.0, 30.0):
        for time in (0.5, 5.0):
            keys = f'{ALL}\nflexure_sd = "{sd:g} arcsec"\nflexure_time = "{time:g} s"'
            run = solution(described(keys, noise, LEVER), log).fit.run
            lines.append(f"| {sd:g} arcsec | {time:g} | {run.log_likelihood - likely:+.1f} |")
    return lines


def sensitivity_rows(log, noise, ours) -> list[str]:
    """What other choices change, in standard deviations of ours."""
    twice = {k: 2 * v for k, v in noise.items()}
    drift = ours.diagnostics["delay"]["rate_matching"]["drift"]
    tried = {
        "noise twice as large": (described(ALL, twice, LEVER), log),
        "velocity_sd 10 times as large": (
            described(ALL, noise | {"velocity": 10 * noise["velocity"]}, LEVER), log),
        "priors half as wide, or nearly": (described(ALL, noise, LEVER, priors=TIGHTER), log),
        "one pass": (described(f"{ALL}\npasses = 1", noise, LEVER), log),
        "five passes": (described(f"{ALL}\npasses = 5", noise, LEVER), log),
        "accel_bias_z = false": (described(f"{ALL}\naccel_bias_z = false", noise, LEVER), log),
        "without vertical velocity": (described(FLAT, noise, LEVER), log),
        ALONE: (described(ALONE, noise, LEVER), log),
        "no lever arm": (described(ALL, noise), log),
        "drift of the clocks taken out": (described(ALL, noise, LEVER), on_one_clock(log, drift)),
        'delay = "none"': (described(f'{ALL}\ndelay = "none"', noise, LEVER), log),
        "load = true": (described(f"{ALL}\nload = true", noise, LEVER), log),
    }  # fmt: skip
    c = ours.coefficients
    lines = []
    for words, (campaign, data) in tried.items():
        found = solution(campaign, data).states
        common = [n for n in c.names if n in found.layout.names]
        shift = {n: float((found[n].values[0] - c[n].values[0]) / c[n].sd[0]) for n in common}
        most = sorted(shift, key=lambda n: -abs(shift[n]))[:3]
        z = f"{found['accel.bias.z'].values[0] / UG:.0f}" if "accel.bias.z" in common else ""
        end = ""
        if z and "master.delay" in common:
            end = f"{closed(log, found)[1]:.2f}"
        lines.append(
            f"| {words} | {', '.join(f'{n} {shift[n]:+.1f}' for n in most)} | {z} "
            f"| {found['installation.y'].values[0] / ARCMIN:.2f} | {end} |"
        )
    return lines


def noise_rows(noise, plain) -> list[str]:
    lines = []
    for name, unit in NOISE_UNITS.items():
        lines.append(f"| {name} [{unit}] | {noise[name]:.4g} | {plain[name]:.4g} "
                     f"| {FOUND[name]:.4g} |")  # fmt: skip
    return lines


def bands(log, s: Solution) -> list[str]:
    """The spectrum of what the filter leaves of the attitudes."""
    z = s.fit.run.innovation[SETTLED:, 3:] / ARCSEC
    P = np.abs(np.fft.rfft(z - z.mean(axis=0), axis=0)) ** 2 / len(z)
    f = np.fft.rfftfreq(len(z), 0.1)
    lines = []
    for low, high in ((0.02, 0.1), (0.1, 0.3), (0.3, 1.0), (1.0, 2.0), (2.0, 3.5), (3.5, 5.0)):
        rms = np.sqrt(P[(f >= low) & (f < high)].mean(axis=0))
        lines.append(f"| {low:g} to {high:g} | {', '.join(f'{x:.1f}' for x in rms)} |")
    return lines


def main() -> tuple[bool, dict[str, object]]:
    """Return whether all that was wanted is so."""
    if not FOLDER.is_dir():
        print(f"skipped: {FOLDER} is missing; set FOUCAULT_DATA")
        return None
    log = logged()
    nis, nis_good, noise = nis_rows(log)
    plain = likeliest_noise(log, None, LENGTHS[0])
    lever, lever_sd, gain = likeliest_lever(log, FOUND)
    results = {
        "defaults": calibrated(described(priors=""), log),
        "priors stated": calibrated(described(), log),
        "ours": calibrated(described(ALL, FOUND, LEVER), log),
        "without vertical velocity": calibrated(described(FLAT, FOUND, LEVER), log),
        "model alone": calibrated(described(ALONE, FOUND, LEVER), log),
        "model alone, without vertical velocity": calibrated(
            described(f"{FLAT}\n{ALONE}", FOUND, LEVER), log
        ),
    }
    ours, c = results["ours"], described(ALL, FOUND, LEVER)
    s = solution(c, log)
    drift = ours.diagnostics["delay"]["rate_matching"]["drift"]
    halves, halves_good = half_rows(c, log, drift)
    closing, closing_good = closure_rows(log, results, calibrated(c, half(log, False)).coefficients)
    tau = float(ours.coefficients["master.delay"].values[0]) / MS
    arm = ", ".join(f"{1e3 * x:.0f} +- {1e3 * e:.0f}" for x, e in zip(lever, lever_sd, strict=True))
    bare = calibrated(described(ALL, FOUND), log).findings
    hint = next((f.message for f in bare if f.code == "transfer.lever"), "no finding.")
    good = {
        "the delay is 15.5 +- 0.5 ms": abs(tau - 15.5) < 0.5,
        f"the heading closes within {WANTED} arcmin": closing_good,
        "halves agree within three of their sds, drift taken out": halves_good,
        "NIS within its limits in the seconds where the noise was not found": nis_good,
    }
    return all(good.values()), {
        "verdicts": [f"* {words}: {must(fine)}" for words, fine in good.items()],
        "coefficient_rows": coefficient_rows(results),
        "check_rows": check_rows(results),
        "closing": closing,
        "halves": halves,
        "delay_rows": delay_rows(log, FOUND, ours),
        "nis": nis,
        "noise_rows": noise_rows(noise, plain),
        "channel_rows": channel_rows(s),
        "bands": bands(log, s),
        "flexure_rows": flexure_rows(log, FOUND, float(s.fit.run.log_likelihood)),
        "arm": arm,
        "gain": gain,
        "hint": hint,
        "sensitivity_rows": sensitivity_rows(log, FOUND, ours),
    }
