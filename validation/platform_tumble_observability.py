"""What the tumble of the paper shows of its 45 unknowns, and what it leaves uncertain.

The rank of the stripped observability matrix for the plan cut into more and more segments of
constant rate; the weakest directions and strongest correlations of the bound; the slopes of the
readings, the paper's figures 4 to 7, against central differences of the simulator; the bound from
these differences alone where gyros have no noise; and the bound at other latitudes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from platform_tumble_setting import (
    ARCSEC,
    BLOCK,
    DEG,
    NAMES,
    SEED,
    SITE,
    SYMBOLS,
    G,
    Run,
    prior_of,
    run_of,
    session,
    silent,
)

from foucault.coefficients import CoefficientVector
from foucault.diagnose import tumble as evidence
from foucault.diagnose.observability import Observability
from foucault.diagnose.tumble import STATE
from foucault.estimate import tumble as estimation
from foucault.estimate.tumble import State
from foucault.models.cluster import CONSTANTS, SOURCE_SYMBOLS, ClusterModel, angles_of, normalised
from foucault.models.earth import Site
from foucault.models.rotation import exp, log
from foucault.plans.tumble import PUBLISHED, nominal

CUTS = {(1, 1, 1, 1): 24, (2, 2, 2, 2): 39, (8, 4, 8, 4): 45, (16, 8, 16, 8): 45}
"""Segments of each of the four steps, and the rank that is expected."""

# Directions: symbols and signs of the source, sd over that of the prior; correlations.
WEAKEST = (({"kg32x": 1, "kg32y": 1}, 0.13), ({"kg31x": 1, "kg31y": -1}, 0.12))
CORRELATED = ((("ka0", "ka2"), -0.98), (("kg11x", "kg11y"), 0.97))

FIGURES = {
    "figure 4: gyro biases": ["kg0x", "kg0y", "kg0z"],
    "figure 5: first-order terms of the x gyro": ["kg11x", "kg12x", "kg13x"],
    "figure 6: misalignments of the x gyro": ["Dxy", "Dxz"],
    "figure 7: y accelerometer": ["ka0y", "ka1y", "ka2y", "th_yz"],
}
GROUPS = {
    "gyro biases kg0": "kg0", "first-order terms kg1": "kg1", "second-order terms kg3": "kg3",
    "torquer scale factors dK": "dK", "gyro misalignments D": "D",
    "accelerometer biases ka0": "ka0",
    "accelerometer scale factors ka1": "ka1", "accelerometer squared terms ka2": "ka2",
    "accelerometer misalignments th": "th",
}  # fmt: skip
STEPS = (0.003, 0.03, 0.3)
"""Half widths of the differences, in sd of the prior."""
LATITUDES = (0.0, 28.0, 40.0, 60.0)


def zeroth() -> Run:
    """Errors and start of the first run of the table, readings without noise."""
    run = session(np.random.SeedSequence(SEED, spawn_key=(0,)))
    made = silent(run.simulation.plan, run.model, angles_of(run.truth.C_np.T))
    return run_of(made, 1)


# -- rank ------------------------------------------------------------------------------------


def cut(pieces: tuple[int, ...], constants: np.ndarray) -> Observability:
    """The plan in segments, at the attitude that it has in the middle of each."""
    told = nominal(PUBLISHED, float(SITE.latitude or 0.0))
    rates, path, times = [], [], []
    for (a, b), count in zip(pairwise(PUBLISHED.ends), pieces, strict=True):
        edges = np.linspace(a, b, count + 1)
        for low, high in pairwise(edges):
            k = int((low + high) / 2)  # the command of the second that holds the middle
            turn = exp(-told.rate[k] * ((low + high) / 2 - told.time[k]))
            path.append(turn @ told.C_pn[k])
            rates.append(told.command[k])
            times.append(float(high - low))
    prior = prior_of(np.zeros(3))
    prior = replace(prior, mean=State(prior.mean.C_np, constants))
    return evidence.piecewise(rates, path, times, prior, 1e-6)


def ranks(constants: np.ndarray) -> tuple[list[str], bool]:
    """Rank by number of segments, constants zero and as they are."""
    lines = []
    good, finest = True, None
    for pieces, expected in CUTS.items():
        zero, real = cut(pieces, np.zeros(42)), cut(pieces, constants)
        s = zero.singular_values / zero.singular_values[0]
        rest = f"{s[zero.rank]:.0e}" if zero.rank < len(s) else "-"
        good &= zero.rank == real.rank == expected and zero.exact
        lines.append(
            f"| {sum(pieces)} | {', '.join(map(str, pieces))} | {zero.rank} | {real.rank} | "
            f"{zero.smallest:.2e} | {rest} | {zero.powers} |"
        )
        finest = zero
    assert finest is not None
    s = finest.singular_values / finest.singular_values[0]
    growth = ", ".join(str(g.rank) for g in finest.gains)
    four = cut((1, 1, 1, 1), np.zeros(42))
    unseen = [f"`{c.words.split(':')[0]}`" for c in four.unseen]
    lines += [
        "",
        f"Expected: {', '.join(str(r) for r in CUTS.values())}. What a segment does not see stands "
        "still in it, so that the matrix may be stripped of the transitions.",
        "",
        f"{len(finest.gains)} segments, singular values over the largest (prior as unit of the "
        f"states, noise of a reading of the outputs, {finest.time_scale:.0f} s of time): "
        f"{', '.join(f'{v:.2g}' for v in s)}.",
        "",
        f"Rank after each of the {len(finest.gains)} segments: {growth}.",
        "",
        f"One segment per step, not seen at all: {'; '.join(unseen[:4])}, and {len(unseen) - 4} "
        "more.",
    ]
    return lines, good


# -- what remains ----------------------------------------------------------------------------


def directions(run: Run) -> tuple[list[str], bool]:
    """Weakest directions and strongest correlations of the bound."""
    fit = estimation.bound(run.tumble, run.prior, run.truth)
    sd = run.prior.sd[: len(STATE)]
    data = evidence.information_of(fit, run.prior)
    weakest = data.remaining(sd, 6)
    lines = []
    good = True
    for k, part in enumerate(weakest):
        expected = "-"
        if k < len(WEAKEST):
            shares, size = WEAKEST[k]
            words = " ".join(f"{'+' if v > 0 else '-'}{n}" for n, v in shares.items())
            expected = f"{words}, {size}"
            good &= {named(n) for n in part.shares} == set(shares)
            signs = [v * signed(n) * shares[named(n)] for n, v in part.shares.items()
                     if named(n) in shares]  # fmt: skip
            good &= abs(sum(np.sign(signs))) == len(shares) and abs(part.ratio - size) < 0.01
        lines.append(f"| {source_terms(part.shares)} | {part.ratio:.3f} | {expected} |")
    lines += ["", "| pair | correlation | expected |", "|---|--:|---|"]
    strong = data.with_prior(sd).correlated(0.9)
    found = {frozenset((named(a), named(b))): signed(a) * signed(b) * v for a, b, v in strong}
    for both, value in found.items():
        wanted = [v for kinds, v in CORRELATED if pair_of(both, kinds)]
        lines.append(
            f"| {', '.join(sorted(both))} | {value:+.3f} | {wanted[0] if wanted else '-'} |"
        )
    for kinds, value in CORRELATED:
        mine = [v for both, v in found.items() if pair_of(both, kinds)]
        good &= bool(mine) and abs(mine[0] - value) < 0.01
    lines += ["", "Limits: the two weakest directions, their ratios within 0.01, and the strongest "
              "pair of each kind within 0.01."]  # fmt: skip
    return lines, good


def pair_of(both: frozenset[str], kinds: tuple[str, str]) -> bool:
    """Whether a pair is of two kinds, on the same axis where they are kinds."""
    one, other = sorted(both)
    if one.startswith(kinds[0]) and other.startswith(kinds[1]):
        return both == set(kinds) or one[-1] == other[-1]
    return False


def named(name: str) -> str:
    """The source's symbol; of the attitude at the start, which it does not have, our name."""
    return SOURCE_SYMBOLS[name][0] if name in SOURCE_SYMBOLS else name


def signed(name: str) -> float:
    return SOURCE_SYMBOLS[name][1] if name in SOURCE_SYMBOLS else 1.0


def source_terms(shares: dict[str, float]) -> str:
    lead = np.sign(next(v * signed(n) for n, v in shares.items()))
    return " ".join(f"{lead * v * signed(n):+.2f} {named(n)}" for n, v in shares.items())


# -- slopes ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Slopes:
    """d(reading)/d(state), in sd of the prior: analytic, and by differences of the simulator."""

    analytic: np.ndarray
    differences: dict[float, np.ndarray]
    end: np.ndarray

    def apart(self, columns: list[int], step: float) -> float:
        """Largest difference of one curve over its largest value, the worst of `columns`."""
        d = self.differences[step][:, :, columns]
        off = np.abs(self.analytic[:, :, columns] - d).max(axis=(0, 1))
        return float((off / np.abs(d).max(axis=(0, 1))).max())


def shifted(run: Run, k: int, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Readings and final attitude with state k shifted by `size` (rotation in n, or packed)."""
    constants, C_np = run.truth.constants.copy(), run.truth.C_np
    if k < 3:
        C_np = exp(size * np.eye(3)[k]) @ C_np
    else:
        constants[k - 3] += size
    vector = CoefficientVector(CONSTANTS, constants / normalised(G))
    made = silent(
        run.simulation.plan, ClusterModel.from_coefficients(vector), angles_of(C_np.T),
        site=run.simulation.site,
    )  # fmt: skip
    return made.log.accel[1:] / G, made.C_pn[1]


def slopes(run: Run) -> Slopes:
    """All 45, with three widths of the differences."""
    sd = run.prior.sd
    unit = np.append(sd[:45], 1.0)
    _, analytic = estimation.sensitivities(run.tumble, run.truth, unit)
    shape = analytic[:, :, :45].shape
    differences = {step: np.empty(shape) for step in STEPS}
    end = np.empty((3, 45))
    for k in range(45):
        for step in STEPS:
            (a, C1), (b, C0) = (shifted(run, k, s * step * sd[k]) for s in (1, -1))
            differences[step][:, :, k] = (a - b) / (2 * step)
            if step == STEPS[0]:
                end[:, k] = log(C0 @ C1.T) / (2 * step)
    return Slopes(analytic[:, :, :45], differences, end)


def columns_of(symbols: list[str]) -> list[int]:
    return [3 + CONSTANTS.index(NAMES[SYMBOLS.index(s)]) for s in symbols]


def slope_table(run: Run, s: Slopes) -> tuple[list[str], bool]:
    """Largest deviation of each group; halved intervals and steps tell where it comes from."""
    half = session_with(run, 0.1)
    _, finer = estimation.sensitivities(half.tumble, half.truth, np.append(run.prior.sd[:45], 1.0))
    finer = finer[1::2, :, :45]
    groups = FIGURES | {
        words: [x for x in SYMBOLS[3:] if x.startswith(start)] for words, start in GROUPS.items()
    }
    lines = [
        "| curves | number | " + " | ".join(f"differences of ±{step:g} sd" for step in STEPS)
        + " | slopes at 0.1 s against 0.2 s |",
        "|---|--:|" + "--:|" * len(STEPS) + "--:|",
    ]  # fmt: skip
    for words, symbols in groups.items():
        at = columns_of(symbols)
        cells = " | ".join(f"{s.apart(at, step):.1e}" for step in STEPS)
        lines.append(f"| {words} | {len(at)} | {cells} | {moved(s.analytic, finer, at):.1e} |")
    at = [0, 1, 2]
    cells = " | ".join(f"{s.apart(at, step):.1e}" for step in STEPS)
    lines.append(f"| attitude at the start | 3 | {cells} | {moved(s.analytic, finer, at):.1e} |")
    every = s.apart(list(range(45)), STEPS[0])
    rest = moved(s.analytic, finer, list(range(3, 45))) / s.apart(list(range(3, 45)), STEPS[0])
    return [
        *lines,
        "",
        f"All 45 with the smallest step: at most {every:.1e}; wanted: 1e-6. With intervals half as "
        f"long the slopes move by {rest:.2f} of what is left, so that it is the interval of the "
        "filter, in which slopes are taken at the middle. Where wider differences are worse, it is "
        "the curvature of the readings. Terms that depend on specific force are as exact as the "
        "others, as the slope of drift by attitude is part of the filter.",
    ], every < 1e-6


def moved(coarse: np.ndarray, fine: np.ndarray, at: list[int]) -> float:
    off = np.abs(coarse - fine)[:, :, at].max(axis=(0, 1))
    return float((off / np.abs(fine[:, :, at]).max(axis=(0, 1))).max())


def session_with(run: Run, interval: float) -> Run:
    """The same motion in other intervals."""
    every = round(0.2 / interval)
    t = run.tumble
    tumble = replace(
        t, dt=np.full(every * len(t.dt), interval), command=np.repeat(t.command, every, axis=0),
        reading=np.repeat(t.reading, every, axis=0), used=np.repeat(t.used, every),
    )  # fmt: skip
    return replace(run, tumble=tumble)


def brute_force(run: Run, s: Slopes) -> tuple[list[str], bool]:
    """The bound without gyro noise, from differences of the simulator alone."""
    J = s.differences[STEPS[0]].reshape(-1, 45) / np.sqrt(run.tumble.accel_variance)
    cov = np.linalg.inv(J.T @ J + np.eye(45))
    map_ = np.eye(45)
    map_[:3] = -s.end  # truth ahead of the estimate, in p
    unit = np.append(np.ones(3), run.prior.sd[3:45])
    brute = run.sd(unit[:, None] * (map_ @ cov @ map_.T) * unit)
    fit = estimation.bound(replace(run.tumble, gyro_psd=0.0), run.prior, run.truth)
    ours = run.sd(fit.cov)
    apart = np.abs(ours / brute - 1)
    worst = int(apart.argmax())
    k = SYMBOLS.index("beta")
    return [
        f"Without gyro noise the readings are independent, and the bound is that of least squares "
        f"over the differences of ±{STEPS[0]:g} sd. It differs from the bound of the filter by at "
        f"most {100 * apart[worst]:.3f} % ({SYMBOLS[worst]}); beta at the end {brute[k]:.3f} "
        f"arcsec against {ours[k]:.3f}."
    ], bool(apart[worst] < 0.01)


# -- latitude --------------------------------------------------------------------------------


def latitudes(run: Run) -> list[str]:
    """The bound of the same cluster elsewhere."""
    sd = {}
    for latitude in LATITUDES:
        site = Site(G, latitude * DEG)
        start = angles_of(run.truth.C_np.T)
        there = run_of(silent(run.simulation.plan, run.model, start, site=site))
        fit = estimation.bound(there.tumble, there.prior, there.truth)
        sd[latitude] = np.append(there.sd(fit.cov), np.sqrt(fit.start_cov[2, 2]) / ARCSEC)
    home = sd[40.0]
    lines = []
    for latitude, values in sd.items():
        ratio = (values / home)[3:45]
        low, high = int(ratio.argmin()), int(ratio.argmax())
        lines.append(
            f"| {latitude:.0f} | {np.exp(np.log(ratio).mean()):.3f} | {ratio[low]:.3f} "
            f"{SYMBOLS[3 + low]} | {ratio[high]:.3f} {SYMBOLS[3 + high]} | {values[45]:.2f} | "
            f"{values[0]:.4f} | {values[1]:.2f} | {values[2]:.4f} |"
        )
    return lines


def main() -> tuple[bool, dict[str, object]]:
    run = zeroth()
    first, complete = ranks(run.truth.constants)
    second, expected = directions(replace(run, tumble=replace(run.tumble, block=BLOCK)))
    curves = slopes(run)
    third, right = slope_table(run, curves)
    fourth, bounded = brute_force(run, curves)
    return complete and expected and right and bounded, {
        "first": first,
        "second": second,
        "third": third,
        "fourth": fourth[0],
        "latitudes": latitudes(run),
    }
