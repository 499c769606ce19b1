"""North seeking against its Cramer-Rao bound: closed form and maximum likelihood.

Four stops of the base at 0, 180, 90, 270 deg. Many draws at headings all around: the sum of squared
errors over the bound, and NEES, two-sided at a family-wise false-alarm rate of 1 % for the whole
page. The bound comes from finite differences of the rotation of the Earth's rate and of gravity,
apart from the solvers' own derivatives.

Near ``w_z = 0`` no bound tells the truth: there ``w_z = sqrt(1 - M^2 - N^2)`` has no slope. With
the bound ``sd`` of w_z and ``s`` of M and N, all over the Earth's rate, a heading counts as regular
where the bend ``sd^2 / 2s`` is below `BENT`; the others are counted, and looked at apart.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from common import limits, must

from foucault.estimate.north import Fixes, Known, closed_form, solve
from foucault.estimate.north_reduction import Pairs
from foucault.infer.gauss_newton import chi_square_limits
from foucault.models.earth import EARTH_RATE
from foucault.models.north_seeker import attitude, earth_rate_b, up_b
from foucault.models.rotation import turned

G = 9.80665
DPH = np.pi / 648000
STOP_SD = 0.01 * DPH
"""Of the gyro at one stop [rad/s]."""
RATE_SD = STOP_SD / np.sqrt(2)
UP_SD = 20e-6 / np.sqrt(2)
"""20 ug at one stop."""
COV = np.diag([RATE_SD**2] * 2 + [(UP_SD * G) ** 2] * 2)
BENT = 0.005
HEADINGS = 60
ROUGH = np.radians(0.05)
"""Sd of a latitude that is known roughly: about as good as what the readings say of it."""
WRONG = 1.05
"""A standard deviation that is wrong by so much must be rejected."""

GENTLE = ((0, 0), (5, -5), (10, 10), (-15, 20), (25, 0), (0, -25), (25, 25))
STEEP = ((30, 30), (45, -45), (60, 60), (85, 0), (89, 0))
LATITUDES = (-75, -45, -20, 0, 20, 45, 60, 80)
TILTS = ((0, 0), (10, 10), (-30, 20), (45, -60), (60, 60), (0, 85), (89, 0), (-89, 0))
MODES = {"known": 0.0, "rough": ROUGH, "unknown": np.inf}


def numbers(x: np.ndarray) -> np.ndarray:
    """The four numbers of a set-up with heading, pitch, roll, latitude `x`, shape (n, 4)."""
    return np.hstack([earth_rate_b(*x.T)[:, :2], G * up_b(x[:, 1], x[:, 2])[:, :2]])


def slope(function, x: np.ndarray) -> np.ndarray:
    step = 1e-6 * np.eye(4)
    return np.stack([(function(x + d) - function(x - d)) / 2e-6 for d in step], axis=-1)


def bound(x: np.ndarray, latitude_sd: float) -> np.ndarray:
    """Covariance (n, 4, 4) that no unbiased solution undercuts; infinite where there is none."""
    J = slope(numbers, x)
    H = np.einsum("nki,kl,nlj->nij", J, np.linalg.inv(COV), J)
    # Exactly known is the limit: what the solver takes for exact, so that one formula serves.
    H[:, 3, 3] += 1.0 / max(latitude_sd, 1e-9) ** 2
    H += 1e-6 * np.eye(4)  # a thousand radians: what is not seen gets a bound of that size
    scale = np.sqrt(np.einsum("nii->ni", H))
    scale = scale[:, :, None] * scale[:, None, :]
    return np.linalg.inv(H / scale) / scale


def bend(x: np.ndarray, P: np.ndarray) -> np.ndarray:
    """How far from straight: what an error of w_z by its sd does to M and N, over their own."""
    J = slope(lambda x: earth_rate_b(*x.T)[:, 2:] / EARTH_RATE, x)[:, 0]
    return np.einsum("ni,nij,nj->n", J, P, J) / (2 * RATE_SD / EARTH_RATE)


def regular(x: np.ndarray, P: np.ndarray) -> np.ndarray:
    return bend(x, P) < BENT


def all_around(tilt, latitude: float, count: int = HEADINGS, first: float = 0.0) -> np.ndarray:
    heading = first + np.arange(count) * 360.0 / count
    return np.radians([(h, *tilt, latitude) for h in heading])


def drawn(x: np.ndarray, rng: np.random.Generator, share: float = 1.0) -> np.ndarray:
    return numbers(x) + share * rng.standard_normal((len(x), 4)) * np.sqrt(np.diag(COV))


def pairs_of(values: np.ndarray, share: float = 1.0) -> Pairs:
    n = len(values)
    gyro, tilt = np.zeros((n, 4, 4)), np.zeros((n, 4, 4))
    gyro[:, :2, :2], tilt[:, 2:, 2:] = share**2 * COV[:2, :2], share**2 * COV[2:, 2:]
    none = np.zeros(n)
    return Pairs(values, {"gyro noise": gyro, "tilt: noise": tilt}, none, none, np.zeros((n, 4)),
                 none, none, none, np.zeros((n, 2)), np.zeros((n, 2), np.int64))  # fmt: skip


def likelihood(values, x: np.ndarray, latitude: float, mode: str, share: float = 1.0) -> Fixes:
    """Solve; a rough heading decides between roots, as the roots have their own section."""
    if mode == "unknown":
        hemisphere = "north" if latitude >= 0 else "south"
        return solve(pairs_of(values, share), Known(G, hemisphere=hemisphere, near=x[:, 0]))
    return solve(pairs_of(values, share), Known(G, latitude, MODES[mode], near=x[:, 0]))


@dataclass
class Verdicts:
    """Sums of squares, judged when the whole page is known."""

    rows: list[tuple[float, int]] = field(default_factory=list)

    def add(self, squares: np.ndarray, each: int = 1) -> int:
        self.rows.append((float(squares.sum()), each * len(squares)))
        return len(self.rows) - 1

    def judge(self, row: int, scale: float = 1.0) -> bool:
        total, dof = self.rows[row]
        low, high = chi_square_limits(dof, tests=len(self.rows))
        return low <= total * scale <= high

    def words(self) -> tuple[str, bool]:
        """What the limits are, and whether they have power."""
        dof = [d for _, d in self.rows]
        caught = [not self.judge(i, f) for i in range(len(dof)) for f in (WRONG**2, WRONG**-2)]
        least = min(dof)
        within = [np.sqrt(v) for v in limits(least, tests=len(dof))]
        text = (
            f"{len(dof)} tests, 1 % false alarms for all together. With the fewest degrees of "
            f"freedom, {least}, RMS over bound must lie in {within[0]:.4f} to {within[1]:.4f}. "
            f"Power: with every standard deviation taken {100 * (WRONG - 1):.0f} % too small, or "
            f"too large, {sum(caught)} of {len(caught)} tests fail."
        )
        return text, sum(caught) >= 0.99 * len(caught)


def heading_errors(found: np.ndarray, x: np.ndarray) -> np.ndarray:
    return turned(found[:, 0] - x[:, 0])


def closed_rows(tilt, verdicts: Verdicts, draws: int, rng, test: str) -> list[tuple]:
    """One row per latitude mode, all latitudes together; `test` says against what."""
    rows = []
    for mode in ("known", "unknown"):
        over_bound, over_own, lost, left_out, asked = [], [], [], 0, 0
        for latitude in LATITUDES:
            x = all_around(tilt, latitude)
            P = bound(x, MODES[mode])
            wz = earth_rate_b(*x.T)[:, 2]
            keep = np.ones(len(x), bool)
            if mode == "unknown":  # of the other sign belong to the other root
                keep = regular(x, P) & (wz * (1 if latitude >= 0 else -1) > 0)
            asked, left_out = asked + len(x), left_out + np.sum(~keep)
            if not keep.any():
                continue
            y = np.repeat(x[keep], draws, axis=0)
            sd = np.sqrt(np.repeat(P[keep, 0, 0], draws))
            words = {
                "latitude": np.radians(latitude) if mode == "known" else None,
                "rate_sd": RATE_SD,
                "up_sd": UP_SD,
                "hemisphere": "north" if latitude >= 0 else "south",
            }
            exact = numbers(x[keep])
            own = closed_form(exact[:, :2], exact[:, 2:] / G, **words)[1][:, 0]
            values = drawn(y, rng)
            e = heading_errors(closed_form(values[:, :2], values[:, 2:] / G, **words)[0], y)
            over_bound.append((e / sd) ** 2)
            over_own.append((e / np.repeat(own, draws)) ** 2)
            lost.append(own**2 / P[keep, 0, 0])
        square = np.concatenate(over_bound)
        row = verdicts.add(square if test == "bound" else np.concatenate(over_own))
        loss = np.sqrt(np.concatenate(lost).mean())
        rows.append((tilt, mode, loss, np.sqrt(square.mean()), left_out / asked, row))
    return rows


def nees_of(found: Fixes, x: np.ndarray, mode: str) -> np.ndarray:
    """Squares in the rotation of the case, not in angles that are singular at 90 deg of pitch."""
    C = attitude(*found.angles[:, :3].T)
    R = np.einsum("nij,nkj->nik", attitude(*x[:, :3].T), C)
    # C_true = exp(-[phi x]) C_found for a small phi
    phi = 0.5 * np.stack([R[:, 1, 2] - R[:, 2, 1], R[:, 2, 0] - R[:, 0, 2],
                          R[:, 0, 1] - R[:, 1, 0]], 1)  # fmt: skip
    st, ct = np.sin(found.angles[:, 1]), np.cos(found.angles[:, 1])
    sg, cg = np.sin(found.angles[:, 2]), np.cos(found.angles[:, 2])
    E = np.zeros((len(C), 4, 4))  # change of the angles for a turn phi, then the latitude
    E[:, 0, 0], E[:, 0, 2] = sg / ct, -cg / ct
    E[:, 1, 0], E[:, 1, 2] = cg, sg
    E[:, 2, 0], E[:, 2, 1], E[:, 2, 2] = sg * st / ct, 1.0, -cg * st / ct
    E[:, 3, 3] = 1.0
    inverse = np.linalg.inv(E)
    cov = np.einsum("nij,njk,nlk->nil", inverse, found.cov, inverse)
    e = np.column_stack([phi, x[:, 3] - found.angles[:, 3]])
    size = 3 if mode == "known" else 4
    return np.einsum("ni,ni->n", e[:, :size],
                     np.linalg.solve(cov[:, :size, :size], e[:, :size, None])[..., 0])  # fmt: skip


def right_root(found: Fixes, x: np.ndarray, sd: np.ndarray) -> np.ndarray:
    """Where the solution and not the other one is nearer to the truth; sd of the bound (n, 4)."""
    off = [np.sum((turned(angles - x) / sd) ** 2, axis=1) for angles in (found.angles, found.other)]
    return ~(off[1] < off[0])  # the other one may not exist


def likelihood_row(tilt, mode: str, verdicts: Verdicts, draws: int, rng) -> list:
    """Heading, pitch, roll, latitude over bound and NEES of all latitudes together."""
    squares, nees, asked, left_out, other, silent = [], [], 0, 0, 0, 0
    for degrees in LATITUDES:
        latitude = np.radians(degrees)
        x = all_around(tilt, degrees)
        P = bound(x, MODES[mode])
        keep = regular(x, P)
        asked, left_out = asked + len(x), left_out + np.sum(~keep)
        if not keep.any():
            continue
        y = np.repeat(x[keep], draws, axis=0)
        sd = np.sqrt(np.repeat(np.einsum("nii->ni", P[keep]), draws, axis=0))
        if mode == "rough":  # the latitude that was given is off, by as much in one direction
            y[:, 3] += ROUGH * rng.standard_normal(len(y))
        found = likelihood(drawn(y, rng), y, latitude, mode)
        right = right_root(found, y, sd)
        other += np.sum(~right)
        silent += np.sum(~right & ~found.ambiguous) + np.sum(found.status != 0)
        e = (turned(found.angles - y) / sd)[right, : 3 if mode == "known" else 4]
        squares.append(e**2)
        nees.append(nees_of(found, y, mode)[right])
    all_squares, all_nees = np.concatenate(squares), np.concatenate(nees)
    rows = [verdicts.add(column) for column in all_squares.T]
    rows.append(verdicts.add(all_nees, all_squares.shape[1]))
    rms = np.sqrt(all_squares.mean(axis=0))
    score = all_nees.mean() / all_squares.shape[1]
    taken = other / (other + len(all_nees))
    return [tilt, mode, rms, score, left_out / asked, taken, silent, rows]


def bend_rows(draws: int, rng) -> list[str]:
    """RMS over bound against the bend, and the same set-ups with a quarter of the noise."""
    lines = []
    edges = (0.0, BENT, 4 * BENT, 16 * BENT, 64 * BENT, np.inf)
    for tilt, degrees, mode in (((10, 10), 10, "unknown"), ((89, 0), 45, "known"),
                                ((89, 0), 45, "unknown")):  # fmt: skip
        x = all_around(tilt, degrees, 360, 0.5)
        P = bound(x, MODES[mode])
        bends = bend(x, P)
        for low, high in pairwise(edges):
            here = (bends >= low) & (bends < high)
            if not here.any():
                continue
            y = np.repeat(x[here], draws, axis=0)
            sd = np.sqrt(np.repeat(np.einsum("nii->ni", P[here]), draws, axis=0))
            cells = []
            for share in (1.0, 0.25):
                values = drawn(y, rng, share)
                found = likelihood(values, y, np.radians(degrees), mode, share)
                right = right_root(found, y, share * sd)
                e = heading_errors(np.where(right[:, None], found.angles, found.other), y)
                e /= share * sd[:, 0]
                cells.append(f"{np.sqrt(np.mean(e**2)):.3f}")
            lines.append(
                f"| {pair(tilt)} | {degrees}, {mode} | {low:g} to {high:g} | {here.sum()} | "
                f"{' | '.join(cells)} |"
            )
    return lines


def pair(tilt) -> str:
    return f"{tilt[0]} / {tilt[1]}"


def closed_table(rows: list[tuple], verdicts: Verdicts) -> tuple[list[str], bool]:
    lines = ["| tilt | latitude | sd over bound, exact | RMS over bound | headings left out | "
             "inside |", "|---|---|--:|--:|--:|---|"]  # fmt: skip
    good = True
    for tilt, mode, loss, rms, left_out, row in rows:
        inside = verdicts.judge(row)
        good &= inside
        lines.append(f"| {pair(tilt)} | {mode} | {loss:.4f} | {rms:.4f} | {100 * left_out:.0f} % | "
                     f"{must(inside)} |")  # fmt: skip
    return lines, good


def likelihood_table(rows: list[list], verdicts: Verdicts) -> tuple[list[str], bool]:
    lines = [
        "| tilt | latitude | NEES / dof | heading | pitch | roll | latitude | headings left out | "
        "other root | inside |",
        "|---|---|--:|--:|--:|--:|--:|--:|--:|---|",
    ]
    good = True
    for tilt, mode, rms, score, left_out, taken, silent, numbers_ in rows:
        inside = all(verdicts.judge(i) for i in numbers_) and silent == 0
        good &= inside
        cells = " | ".join([f"{v:.4f}" for v in rms] + [""] * (4 - len(rms)))
        lines.append(f"| {pair(tilt)} | {mode} | {score:.4f} | {cells} | {100 * left_out:.0f} % | "
                     f"{100 * taken:.1f} % | {must(inside)} |")  # fmt: skip
    return lines, good


def main(draws: int = 60) -> tuple[bool, dict[str, object]]:
    rng, verdicts = np.random.default_rng(1), Verdicts()
    gentle = [r for t in GENTLE for r in closed_rows(t, verdicts, draws, rng, "bound")]
    steep = [r for t in STEEP for r in closed_rows(t, verdicts, draws, rng, "own")]
    best = [likelihood_row(t, m, verdicts, draws, rng) for t in TILTS for m in MODES]
    power, strong = verdicts.words()
    tables = [closed_table(gentle, verdicts), closed_table(steep, verdicts),
              likelihood_table(best, verdicts)]  # fmt: skip
    latitudes = ", ".join(map(str, LATITUDES))
    return strong and all((good for _, good in tables)), {
        "stop_sd": STOP_SD / DPH,
        "up_sd": UP_SD * np.sqrt(2) * 1000000.0,
        "headings": HEADINGS,
        "latitudes": latitudes,
        "draws": draws,
        "power": power,
        "bent": BENT,
        "gentle": tables[0][0],
        "steep": tables[1][0],
        "rough": np.degrees(ROUGH),
        "best": tables[2][0],
        "bend_rows": bend_rows(draws, rng),
    }
